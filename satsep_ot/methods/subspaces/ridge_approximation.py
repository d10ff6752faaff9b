"""Ridge approximation: active subspace and surrogate of a function from its values alone."""

import math
import os

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.deprecation import DeprecatedAlias
from satsep_ot.methods.common.settings import setting
from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.common.storage import readResult, writeResult
from satsep_ot.methods.common.units import output_units
from satsep_ot.methods.polynomials.fit import PolynomialFit, shuffled_folds
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.polynomials.regression_result import MultivariatePolynomialRegressionResult, namedSample
from satsep_ot.methods.subspaces.graphs import drawSufficientSummary
from satsep_ot.methods.subspaces.variable_projection import RidgeFit, cross_validate_ridge, fit_ridge
from satsep_ot.methods.subspaces.variables import activeTransformation, inverseActiveTransformation
from satsep_ot.openturns_object import OpenTURNSObject

_FORMAT = "RidgeApproximationResult 1"


class RidgeApproximation(OpenTURNSObject):
    """Active subspace and polynomial surrogate without gradients, f(x) ~ p(W^T T(x)).

    Parameters
    ----------
    inputSample : :py:class:`openturns.Sample` or array (N, d)
        Physical inputs.
    outputSample : :py:class:`openturns.Sample` or array (N, p)
        Outputs; several share the directions.
    distribution : :py:class:`openturns.Distribution`
        Of the inputs; T is its iso-probabilistic transformation.

    Notes
    -----
    Variable projection of Hokanson and Constantine, SIAM J. Sci. Comput. 40 (2018). Dimension and degree are chosen
    by nested cross-validation unless they are set: the simplest pair (fewest unknowns) whose mean squared prediction
    error is within one standard error of the best. At least 3 (d r + P) points are recommended; with fewer the
    result's remarks say so.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.subspaces.ridge_approximation import RidgeApproximation
    >>> ot.RandomGenerator.SetSeed(0)
    >>> distribution = ot.Normal(4)
    >>> function = ot.SymbolicFunction(["a", "b", "c", "e"], ["(a + b + c + e)^2"])
    >>> inputs = distribution.getSample(100)
    >>> algorithm = RidgeApproximation(inputs, function(inputs), distribution)
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> print(result.getDimension(), result.getDegree(), round(result.getDirections()[0, 0], 6))
    1 2 0.5
    """

    def __init__(self, inputSample: ArrayLike, outputSample: ArrayLike, distribution: ot.Distribution) -> None:
        physical = np.array(inputSample, dtype=float)
        self._values = np.array(outputSample, dtype=float)
        d = distribution.getDimension()
        if physical.ndim != 2 or self._values.ndim != 2 or len(physical) != len(self._values) or physical.shape[1] != d:
            raise ValueError(
                f"The samples have shapes {physical.shape} and {self._values.shape}; they must be (N, {d}) and (N, p)."
            )
        finite = np.isfinite(physical).all(axis=1) & np.isfinite(self._values).all(axis=1)
        if not finite.all():
            raise ValueError(
                f"A fit needs finite data, but {int((~finite).sum())} of {len(finite)} rows are not, "
                f"the first is row {int((~finite).argmax())}."
            )
        self._space = StandardSpace(distribution)
        self._space.refuseOutside(physical)
        self._physical = physical
        self._points = self._space.toStandard(physical)
        self._outputs = list(outputSample.getDescription()) if isinstance(outputSample, ot.Sample) else None
        self._dimension: int | None = None
        self._degree: int | None = None
        self._largestDimension = min(int(setting("RidgeApproximation-LargestDimension")), d)
        self._largestDegree = int(setting("RidgeApproximation-LargestDegree"))
        self._weights: np.ndarray | None = None
        self._starts = int(setting("RidgeApproximation-StartsNumber"))
        self._folds = int(setting("RidgeApproximation-FoldsNumber"))
        self._result: RidgeApproximationResult | None = None

    @classmethod
    def FromStandardSample(
        cls, standardSample: ArrayLike, outputSample: ArrayLike, distribution: ot.Distribution
    ) -> "RidgeApproximation":
        """The algorithm on runs whose inputs are given as points (N, d) of the standard space.

        Examples
        --------
        >>> import openturns as ot
        >>> from satsep_ot import RidgeApproximation
        >>> law = ot.JointDistribution([ot.Uniform(0.0, 1.0), ot.Gumbel()])
        >>> points = ot.Normal(2).getSample(30)
        >>> outputs = ot.SymbolicFunction(["u", "v"], ["u + v"])(points)
        >>> algorithm = RidgeApproximation.FromStandardSample(points, outputs, law)
        >>> algorithm.run()
        >>> algorithm.getResult().getDirections()[0, 0].__round__(6)
        0.707107
        """
        return cls(StandardSpace(distribution).toPhysical(standardSample), outputSample, distribution)

    def _shown(self):
        return {
            "size": len(self._points),
            "inputs": self._points.shape[1],
            "dimension": self._dimension,
            "degree": self._degree,
        }

    def setDimension(self, dimension: int | None) -> None:
        """Number of directions, 0 to d, or None (default) to choose it up to the largest."""
        if dimension is not None and not 0 <= dimension <= self._points.shape[1]:
            raise ValueError(f"The dimension is {dimension}; it must be 0 to {self._points.shape[1]}.")
        self._dimension = dimension

    def setLargestDimension(self, dimension: int) -> None:
        """Largest dimension of the automatic choice (default 3)."""
        if not 0 <= dimension <= self._points.shape[1]:
            raise ValueError(f"The largest dimension is {dimension}; it must be 0 to {self._points.shape[1]}.")
        self._largestDimension = dimension

    def setDegree(self, degree: int | None) -> None:
        """Total degree, 1 to 10, or None (default) to choose it up to 4."""
        if degree is not None and not 1 <= degree <= 10:
            raise ValueError(f"The degree is {degree}; it must be 1 to 10.")
        self._degree = degree

    def setWeights(self, weights: ArrayLike | None) -> None:
        """Weights (N,), not negative; None for equal ones. A point of weight 0 takes no part."""
        if weights is not None:
            weights = np.array(weights, dtype=float).reshape(-1)
            if weights.shape != (len(self._points),) or not (
                np.isfinite(weights).all() and weights.min() >= 0.0 < weights.max()
            ):
                raise ValueError(
                    f"The weights must be {len(self._points)} finite numbers >= 0, at least one of them positive."
                )
        self._weights = weights

    def setStartsNumber(self, starts: int) -> None:
        """Number of random starts beside the starts from the quadratic fit (default 2)."""
        if starts < 0:
            raise ValueError(f"The number of random starts is {starts}; it must be at least 0.")
        self._starts = starts

    def setFoldsNumber(self, folds: int) -> None:
        """Folds of the cross-validation (default 5)."""
        if not 2 <= folds <= len(self._points):
            raise ValueError(f"The number of folds is {folds}; it must be 2 to {len(self._points)}.")
        self._folds = folds

    @singleThread()
    def run(self) -> None:
        """Choose dimension and degree by cross-validation where they are open, and fit."""
        scores = self._crossValidate()
        best = min(scores, key=lambda pair: scores[pair].mean())
        allowed = scores[best].mean() + scores[best].std(ddof=1) / math.sqrt(len(scores[best]))
        # Errors at rounding level are equal.
        good = [pair for pair in scores if scores[pair].mean() <= max(allowed, 1e-16)]
        d = self._points.shape[1]
        r, k = min(good, key=lambda pair: d * pair[0] + math.comb(pair[0] + pair[1], pair[1]))
        fit = fit_ridge(self._points, self._values, r, k, self._weights, self._starts)
        q2 = {pair: 1.0 - float(score.mean()) for pair, score in scores.items()}
        self._result = RidgeApproximationResult(
            self._space, self._physical, self._points, self._values, self._weights, fit, k, q2, self._outputs
        )

    def _crossValidate(self):
        """Mean squared errors of each block, in units of the variances, by (dimension, degree)."""
        weight = np.ones(len(self._points)) if self._weights is None else self._weights
        used = weight > 0.0
        points, values, weight = self._points[used], self._values[used] / output_units(self._values), weight[used]
        blocks = shuffled_folds(len(points), self._folds)
        smallest = len(points) - max(len(block) for block in blocks)
        dimensions = range(self._largestDimension + 1) if self._dimension is None else [self._dimension]
        degrees = range(1, self._largestDegree + 1) if self._degree is None else [self._degree]
        pairs = [(r, k) for r in dimensions for k in degrees if (r > 0 or k == degrees[0]) and not 1 == k < r]
        # Twice as many points as terms, or the fit of a fold is noise.
        pairs = [(r, k) for r, k in pairs if 2 * math.comb(r + k, k) <= smallest] or pairs[:1]
        mean = np.average(values, axis=0, weights=weight)
        spread = np.average((values - mean) ** 2, axis=0, weights=weight)
        scale = np.where(spread > 0.0, spread, 1.0)
        scores = {}
        for r, k in pairs:
            errors = cross_validate_ridge(points, values, r, k, weight, blocks, self._starts)
            squared = (errors**2 / scale).mean(axis=1)
            scores[r, k] = np.array([np.average(squared[block], weights=weight[block]) for block in blocks])
        return scores

    def getResult(self) -> "RidgeApproximationResult":
        """The :class:`RidgeApproximationResult` of the last run."""
        if self._result is None:
            raise RuntimeError("There is no result yet: call run() first.")
        return self._result


class RidgeApproximationResult(OpenTURNSObject):
    """Result of :class:`RidgeApproximation`.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.subspaces.ridge_approximation import RidgeApproximation
    >>> ot.RandomGenerator.SetSeed(0)
    >>> inputs = ot.Normal(3).getSample(80)
    >>> outputs = ot.SymbolicFunction(["a", "b", "c"], ["exp(0.1 * (a + 2 * b + 2 * c))"])(inputs)
    >>> algorithm = RidgeApproximation(inputs, outputs, ot.Normal(3))
    >>> algorithm.setDimension(1)
    >>> algorithm.run()
    >>> metaModel = algorithm.getResult().getMetaModel()
    >>> bool(abs(metaModel([1.0, 1.0, 1.0])[0] - np.exp(0.5)) < 1e-3)
    True
    """

    def __init__(
        self,
        space: StandardSpace,
        physical: np.ndarray,
        points: np.ndarray,
        values: np.ndarray,
        weights: np.ndarray | None,
        fit: RidgeFit,
        degree: int,
        q2: dict[tuple[int, int], float],
        outputs: list[str] | None = None,
    ) -> None:
        self._space = space
        self._physical = physical
        self._points = points
        self._values = values
        self._weights = weights
        self._fit = fit
        self._degree = degree
        self._q2 = q2
        self._outputs = outputs
        self._regression: MultivariatePolynomialRegressionResult | None = None

    _derived = ("_regression",)
    # Names of the outputs; results of 0.1.0 have none.
    _outputs: list[str] | None = None

    def _shown(self):
        return {"inputs": self._points.shape[1], "dimension": self.getDimension(), "degree": self._degree}

    def getDimension(self) -> int:
        """Number of directions."""
        return self._fit.directions.shape[1]

    def getDegree(self) -> int:
        """Total degree of the polynomial."""
        return self._degree

    def getDirections(self) -> ot.Matrix:
        """Orthonormal columns W, (d, r) :py:class:`openturns.Matrix`, the largest component of each positive."""
        return ot.Matrix(self._fit.directions)

    def getStandardSpace(self) -> StandardSpace:
        """The :class:`~satsep_ot.methods.common.standard_space.StandardSpace` that was used."""
        return self._space

    def getConverged(self) -> bool:
        """Whether the Gauss-Newton iteration converged."""
        return self._fit.converged

    isConverged = DeprecatedAlias("getConverged")

    def getIterationNumber(self) -> int:
        """Gauss-Newton steps of the best start."""
        return self._fit.iterations

    def getRelativeError(self) -> float:
        """Weighted residual over total sum of squares, averaged over the outputs, on the training sample."""
        return self._fit.loss

    def getQ2(self) -> float:
        """Nested cross-validated Q2 of what was chosen: the directions were refitted in every fold."""
        return self._q2[self.getDimension(), self._degree]

    def getQ2ByDimensionAndDegree(self) -> dict[tuple[int, int], float]:
        """Nested cross-validated Q2 of everything that was tried, a dict by (dimension, degree)."""
        return dict(self._q2)

    def getRemarks(self) -> list[str]:
        """Sentences on what a reader should know: few points for the unknowns, an iteration that did not converge."""
        d, r = self._fit.directions.shape
        unknowns = d * r + self._fit.polynomial.basis.size
        remarks = self._space.getRemarks()
        if len(self._points) < 3 * unknowns:
            remarks.append(
                f"{len(self._points)} points for {unknowns} unknowns: {3 * unknowns} are recommended (3 for each)."
            )
        if not self._fit.converged:
            remarks.append(f"The directions had not converged after {self._fit.iterations} Gauss-Newton steps.")
        return remarks

    def _needDirections(self):
        if self.getDimension() == 0:
            raise ValueError(
                "There is no active variable: a constant predicts as well as any ridge; set the dimension."
            )

    def getTransformation(self) -> ot.Function:
        """Physical inputs to active variables, y = W^T T(x), a native :py:class:`openturns.Function`."""
        self._needDirections()
        return activeTransformation(self._space, self._fit.directions)

    def getInverseTransformation(self) -> ot.Function:
        """Active variables to the physical inputs with inactive variables 0, x = T^-1(W y), a native function."""
        self._needDirections()
        return inverseActiveTransformation(self._space, self._fit.directions)

    def getActiveSample(self) -> ot.Sample:
        """Active variables of the sample, :py:class:`openturns.Sample` (N, r)."""
        self._needDirections()
        return ot.Sample(self._points @ self._fit.directions)

    def getRegressionResult(self) -> MultivariatePolynomialRegressionResult:
        """Regression on the active variables,
        a :class:`~satsep_ot.methods.polynomials.regression_result.MultivariatePolynomialRegressionResult`.

        Its intervals and cross-validation take the directions as known: :meth:`getQ2` does not.
        """
        self._needDirections()
        if self._regression is None:
            regression = MultivariatePolynomialRegression(
                self.getActiveSample(), self.getOutputSample(), ot.Normal(self.getDimension())
            )
            regression.setDegree(self._degree)
            regression.setWeights(self._weights)
            regression.run()
            self._regression = regression.getResult()
        return self._regression

    def getMetaModel(self) -> ot.ComposedFunction | ot.LinearFunction:
        """The surrogate of the physical inputs, a native :py:class:`openturns.Function` with exact derivatives."""
        if self.getDimension() == 0:
            d, p = self._points.shape[1], self._values.shape[1]
            metaModel = ot.LinearFunction([0.0] * d, self._fit.polynomial.coefficients[0], ot.Matrix(p, d))
        else:
            metaModel = ot.ComposedFunction(self.getRegressionResult().getMetaModel(), self.getTransformation())
        metaModel.setInputDescription(self._space.getDistribution().getDescription())
        metaModel.setOutputDescription(self._outputNames())
        return metaModel

    def _outputNames(self):
        return self._outputs or [f"y{i}" for i in range(self._values.shape[1])]

    def getInputSample(self) -> ot.Sample:
        """Physical inputs, :py:class:`openturns.Sample` (N, d)."""
        return namedSample(self._physical, self._space.getDistribution().getDescription())

    def getOutputSample(self) -> ot.Sample:
        """Outputs, :py:class:`openturns.Sample` (N, p)."""
        return namedSample(self._values, self._outputNames())

    def getMetaModelResult(self) -> ot.MetaModelResult:
        """An :py:class:`openturns.MetaModelResult` of the physical sample and the surrogate."""
        return ot.MetaModelResult(self.getInputSample(), self.getOutputSample(), self.getMetaModel())

    def drawSufficientSummary(self, output: int = 0, level: float = 0.95) -> ot.Graph:
        """One output against the first one or two active variables, :py:class:`openturns.Graph`."""
        self._needDirections()
        if not 0 <= output < self._values.shape[1]:
            raise ValueError(f"The output is {output}; it must be 0 to {self._values.shape[1] - 1}.")
        active = self._points @ self._fit.directions
        name = self._outputs[output] if self._outputs else f"output {output}"
        return drawSufficientSummary(active, self._values[:, output], self._weights, name, level)

    def save(self, path: str | os.PathLike) -> None:
        """Write the result to one file, whole or not at all: arrays, and the distribution as OpenTURNS' XML.

        What is loaded answers everything as this result does, to the last bit. For the surrogate alone put
        :meth:`getMetaModel` into an :py:class:`openturns.Study`.

        Parameters
        ----------
        path : str or path
            Ends on ``.npz``.
        """
        fit = self._fit
        fields = {"distribution": self._space.getDistribution(), "physical": self._physical, "points": self._points}
        fields |= {"values": self._values, "highestDegree": self._degree, "outputs": self._outputs}
        fields |= {name: getattr(fit, name) for name in ("directions", "loss", "converged", "iterations")}
        fields["q2"] = [[*pair, value] for pair, value in self._q2.items()]
        writeResult(path, _FORMAT, fields | fit.polynomial.fields())

    @staticmethod
    def load(path: str | os.PathLike) -> "RidgeApproximationResult":
        """The result that `save` has written.

        Parameters
        ----------
        path : str or path

        Raises
        ------
        ValueError
            The file is not such a result.
        """
        fields = readResult(path, _FORMAT, objects={"distribution": ot.Distribution()})
        points, values, directions = fields["points"], fields["values"], fields["directions"]
        polynomial = PolynomialFit.of(fields, points @ directions, values)
        fit = RidgeFit(directions, polynomial, *(fields[name] for name in ("loss", "converged", "iterations")))
        q2 = {(r, degree): value for r, degree, value in fields["q2"]}
        return RidgeApproximationResult(
            StandardSpace(fields["distribution"]), fields["physical"], points, values, fields["weights"], fit,
            fields["highestDegree"], q2, fields.get("outputs"),
        )  # fmt: skip
