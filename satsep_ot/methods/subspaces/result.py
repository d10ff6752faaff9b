"""What an active subspace tells: spectrum, directions, maps, scores, graphs."""

import dataclasses
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike
from scipy import linalg

from satsep_ot.deprecation import DeprecatedAlias
from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.common.storage import readResult, writeResult
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.polynomials.regression_result import MultivariatePolynomialRegressionResult, namedSample
from satsep_ot.methods.subspaces.analysis import SubspaceAnalysis, flat_outputs
from satsep_ot.methods.subspaces.estimation import quantile_bands, reflected_bands, subspace_distance
from satsep_ot.methods.subspaces.graphs import addBand, drawScores, drawSufficientSummary
from satsep_ot.methods.subspaces.variables import activeTransformation, inverseActiveTransformation, surrogate_degree
from satsep_ot.openturns_object import OpenTURNSObject

_FORMAT = "ActiveSubspaceResult 1"


def _checkLevel(level):
    if not 0.0 < level < 1.0:
        raise ValueError(f"The confidence level is {level}; it must be in (0, 1).")


class ActiveSubspaceResult(OpenTURNSObject):
    """Result of :class:`ActiveSubspaceAlgorithm`.

    Intervals are bootstrap quantiles over the gradient sample, all outputs of a point together. Those of eigenvalues,
    scores and the error bound are reflected on the logarithmic scale, which takes their bias back
    (:func:`~satsep_ot.methods.subspaces.estimation.reflected_bands`). They hold on two conditions: for eigenvalues that
    stand alone, since within a group of equal ones (:meth:`getRepeatedGroups`) no bootstrap covers at its level; and
    for a sample that has seen the steep parts of the function. Where few long gradients decide (:meth:`hasHeavyTail`),
    their upper bounds are infinite, since nothing bounds what longer ones would add; a steep part on 2 % of the points
    that no point of the sample lies in is not noticed by any interval.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
    >>> ot.RandomGenerator.SetSeed(0)
    >>> function = ot.SymbolicFunction(["a", "b", "c"], ["(a + b)^2 + 0.01 * c"])
    >>> algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(3))
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> result.getTransformation().getOutputDimension()
    1
    >>> graph = result.drawEigenvalues()

    Kept in a file, and back to the last bit:

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     result.save(f"{directory}/subspace.npz")
    ...     again = type(result).load(f"{directory}/subspace.npz")
    >>> again.getEigenvaluesInterval() == result.getEigenvaluesInterval()
    True
    """

    def __init__(self, space: StandardSpace, analysis: SubspaceAnalysis, outputs: Sequence[str] | None = None) -> None:
        self._space = space
        self._outputs = None if outputs is None else list(outputs)
        self._analysis = analysis
        self._regression: MultivariatePolynomialRegressionResult | None = None

    def __setstate__(self, state):
        if "_analysis" not in state:
            # A pickle of version 0.1.0 has the fields of the analysis beside the space.
            names = [field.name for field in dataclasses.fields(SubspaceAnalysis) if f"_{field.name}" in state]
            analysis = SubspaceAnalysis(**{name: state[f"_{name}"] for name in names})
            state = {"_space": state["_space"], "_analysis": analysis, "_regression": None}
        vars(self).update(state)

    _derived = ("_regression",)
    # Names of the outputs; results of 0.1.0 have none.
    _outputs: list[str] | None = None

    def _shown(self):
        return {
            "inputs": len(self._analysis.eigenvalues),
            "outputs": self._analysis.values.shape[1],
            "gradients": len(self._analysis.points),
            "dimension": self._analysis.dimension,
        }

    def getEigenvalues(self) -> ot.Point:
        """All d eigenvalues, decreasing, in units of the output squared; without unit for several outputs.

        Where an output is so small or large that its square cannot be represented, a remark names the unit.
        """
        return ot.Point(self._analysis.eigenvalues)

    def getEigenvaluesInterval(self, level: float = 0.95) -> ot.Interval:
        """Bootstrap interval of each eigenvalue, an :py:class:`openturns.Interval`.

        On the conditions that the class names; without upper bounds under a heavy tail.
        """
        _checkLevel(level)
        return self._interval(*self._eigenvalueBands(level))

    def _interval(self, lower, upper):
        """The interval of these bands (k,); without upper bounds where the gradients have a heavy tail."""
        bounded = not self._analysis.heavy_tailed
        return ot.Interval(
            lower, upper if bounded else np.full(len(upper), np.inf), [True] * len(lower), [bounded] * len(lower)
        )

    def getEffectiveGradientNumber(self) -> float:
        """How many gradients decide: (sum of squared lengths)^2 / sum of their squares, at most their number."""
        return self._analysis.effective_gradients

    def hasHeavyTail(self) -> bool:
        """Whether few long gradients decide the eigenvalues: fewer than a fifth of them, and than 60."""
        return self._analysis.heavy_tailed

    def _eigenvalueBands(self, level):
        return reflected_bands(self._analysis.eigenvalues, self._analysis.eigenvalueReplicates, level)

    def getResolvedEigenvaluesNumber(self) -> int:
        """How many eigenvalues the gradients can resolve; the others are reported as 0."""
        return self._analysis.resolved

    def getEigenvectors(self) -> ot.Matrix:
        """All eigenvectors as the columns of a (d, d) :py:class:`openturns.Matrix`, largest component positive."""
        return ot.Matrix(self._analysis.vectors)

    def getSubspaceError(self) -> ot.Point:
        """Bootstrap mean of the distance ||W W^T - V V^T||_2 for the dimensions 1, 2, ..."""
        return ot.Point(self._analysis.distances.mean(axis=0))

    def getSubspaceErrorInterval(self, level: float = 0.95) -> ot.Interval:
        """Bootstrap quantile interval of the subspace distance for the dimensions 1, 2, ...

        It is the error of the sampling alone: that the function has these directions only where it was sampled, or that
        differences have errors of their own, is not in it.
        """
        _checkLevel(level)
        return ot.Interval(*quantile_bands(self._analysis.distances, level))

    def getDimension(self) -> int:
        """Active dimension: all inputs where no gap separates any direction, and 0 for a constant function.

        :meth:`hasReduction` tells whether it is less than the number of inputs.
        """
        return self._analysis.dimension

    def hasReduction(self) -> bool:
        """Whether there are fewer active directions than inputs."""
        return self._analysis.reduced

    def getDimensionChoices(self) -> dict[str, Any]:
        """What each criterion says: a dict with "gap", "ladle", "energy", "chosen" and "agree".

        A criterion by which no direction stands out says None. Where they disagree and the points suffice,
        "crossValidation" tells which of them predicts best; without any gap, which dimension up to 5 does.
        """
        return dict(self._analysis.choices)

    def getRemarks(self) -> list[str]:
        """Sentences on what a reader should know.

        Unresolved eigenvalues, no reduction, criteria that disagree, a target missed, a heavy tail of the gradients, an
        inexact transformation of the inputs.
        """
        return [*self._analysis.remarks, *self._space.getRemarks()]

    def isConstant(self) -> bool:
        """Whether the gradients are 0 up to rounding and up to the noise of the differences, and the values agree."""
        analysis = self._analysis
        return analysis.constant and not flat_outputs(analysis.values, analysis.gradients).any()

    def getRepeatedGroups(self, level: float = 0.95) -> list[list[int]]:
        """Runs of eigenvalues whose bands overlap: within a run the single vectors mean nothing, their span does.

        Returns
        -------
        list of list of int
            Positions from 0; groups of at least two among the resolved eigenvalues that are not 0.
        """
        _checkLevel(level)
        lower, upper = self._eigenvalueBands(level)
        groups: list[list[int]] = []
        group: list[int] = []
        floor = (len(lower) * np.finfo(float).eps) ** 2 * self._analysis.eigenvalues[0]
        for i in range(self._analysis.resolved):
            if not self._analysis.eigenvalues[i] > floor:
                break
            if group and upper[i] < lower[i - 1]:
                groups.append(group)
                group = []
            group.append(i)
        groups.append(group)
        return [group for group in groups if len(group) > 1]

    def getDirections(self) -> ot.Matrix:
        """Active directions W1 as orthonormal columns, (d, r) :py:class:`openturns.Matrix`."""
        return ot.Matrix(self._active())

    def _active(self):
        return self._analysis.vectors[:, : self._analysis.dimension]

    def _needDirections(self):
        if self._analysis.dimension == 0:
            reason = "the function is constant" if self.isConstant() else "all gradients are 0, though the values vary"
            raise ValueError(f"There is no active variable: {reason}.")

    def getTransformation(self) -> ot.Function:
        """Physical inputs to active variables, y = W1^T T(x), a native :py:class:`openturns.Function`."""
        self._needDirections()
        return activeTransformation(self._space, self._active())

    def getInverseTransformation(self) -> ot.Function:
        """Active variables to the physical inputs with inactive variables 0, x = T^-1(W1 y), a native function."""
        self._needDirections()
        return inverseActiveTransformation(self._space, self._active())

    def getStandardSpace(self) -> StandardSpace:
        """The :class:`~satsep_ot.methods.common.standard_space.StandardSpace` that was used."""
        return self._space

    def getStandardSample(self) -> ot.Sample:
        """Points in the standard space, :py:class:`openturns.Sample` (M, d)."""
        return ot.Sample(self._analysis.points)

    def getOutputSample(self) -> ot.Sample:
        """Outputs at the points, :py:class:`openturns.Sample` (M, p)."""
        return namedSample(self._values(), self._outputs)

    def _values(self):
        return self._analysis.values * self._unit()

    def _unit(self):
        return 1.0 if self._analysis.units is None else self._analysis.units

    def getGradientSample(self) -> np.ndarray:
        """Gradients in the standard space, ndarray (M, d, p)."""
        return self._analysis.gradients * self._unit()

    def getWeights(self) -> ot.Point:
        """Weights of the points, which sum to 1."""
        if self._analysis.weights is None:
            return ot.Point(len(self._analysis.points), 1.0 / len(self._analysis.points))
        return ot.Point(self._analysis.weights / self._analysis.weights.sum())

    def getAverageGradient(self) -> ot.Point:
        """Unit vector along the mean gradient (one output): exact for a ridge that rises everywhere."""
        if self._analysis.gradients.shape[2] != 1:
            raise ValueError(f"The average gradient needs one output, there are {self._analysis.gradients.shape[2]}.")
        mean = np.array(self.getWeights()) @ self._analysis.gradients[:, :, 0]
        length = np.linalg.norm(mean)
        if not length > 0.0:
            raise ValueError("The mean gradient is 0: it has no direction.")
        return ot.Point(mean / length)

    def getAverageTransformation(self) -> ot.Function:
        """Physical inputs to the single variable along the average gradient, a native :py:class:`openturns.Function`.

        The alternative to :meth:`getTransformation` for a function that rises everywhere in one direction.
        """
        return activeTransformation(self._space, np.array(self.getAverageGradient())[:, None])

    def getActivityScores(self, dimension: int | None = None) -> ot.Point:
        """Activity score of each input, sum_{j <= n} lambda_j w_ij^2 (Constantine and Diaz 2017).

        Parameters
        ----------
        dimension : int, optional
            n; by default the active dimension, d where there is no reduction. With n = d they are the
            derivative-based measures.

        Notes
        -----
        They belong to the standard variables. For dependent inputs the i-th standard variable is the i-th input
        given those before it (Rosenblatt), so the scores depend on the order of the inputs.
        """
        n = self._scoreDimension(dimension, len(self._analysis.eigenvalues))
        if n == len(self._analysis.eigenvalues):
            return self.getDerivativeBasedIndices()
        return ot.Point((self._analysis.vectors[:, :n] ** 2) @ self._analysis.eigenvalues[:n])

    def getActivityScoresInterval(self, level: float = 0.95, dimension: int | None = None) -> ot.Interval:
        """Bootstrap interval of the activity scores, on the conditions that the class names."""
        _checkLevel(level)
        if (self._analysis.dimension if dimension is None else dimension) == len(self._analysis.eigenvalues):
            return self.getDerivativeBasedIndicesInterval(level)
        n = self._scoreDimension(dimension, self._analysis.vectorReplicates.shape[2])
        replicates = np.einsum(
            "bij,bj->bi", self._analysis.vectorReplicates[:, :, :n] ** 2, self._analysis.eigenvalueReplicates[:, :n]
        )
        return self._interval(*reflected_bands(np.array(self.getActivityScores(n)), replicates, level))

    def _scoreDimension(self, dimension, largest):
        if dimension is None:
            return self._analysis.dimension
        if not 0 <= dimension <= largest:
            raise ValueError(f"Activity scores exist here for dimensions 0 to {largest}, got {dimension}.")
        return dimension

    def _squares(self):
        return ((self._analysis.gradients**2) / self._analysis.scales).sum(axis=2)

    def getDerivativeBasedIndices(self) -> ot.Point:
        """Derivative-based sensitivity nu_i = E[(dg/du_i)^2], summed over outputs in units of their scale."""
        return ot.Point(np.array(self.getWeights()) @ self._squares())

    def getDerivativeBasedIndicesInterval(self, level: float = 0.95) -> ot.Interval:
        """Bootstrap interval of the derivative-based sensitivity, on the conditions that the class names."""
        _checkLevel(level)
        weights = self._analysis.counts * np.array(self.getWeights())
        total = weights.sum(axis=1, keepdims=True)
        replicates = (weights / np.where(total > 0.0, total, 1.0)) @ self._squares()
        return self._interval(*reflected_bands(np.array(self.getDerivativeBasedIndices()), replicates, level))

    def getTotalSobolBound(self) -> ot.Point:
        """Upper bounds nu_i / Var g of the total Sobol indices in U (Poincare inequality; one output).

        Reference: Sobol and Kucherenko, Math. Comput. Simul. 79 (2009).
        """
        if self._analysis.values.shape[1] != 1:
            raise ValueError(
                f"The bound on total Sobol indices needs one output, there are {self._analysis.values.shape[1]}."
            )
        if self._analysis.constant or not self._analysis.variances[0] > 0.0:
            raise ValueError("The function is constant over the sample: it has no Sobol indices.")
        return ot.Point(np.array(self.getDerivativeBasedIndices()) / self._analysis.variances[0])

    def getErrorBound(self) -> float:
        """Bound on the root mean square error of E[g | y]: square root of the trailing sum of eigenvalues.

        It follows from the Poincare inequality of the standard normal law, whose constant is 1
        (Constantine, Dow and Wang, SIAM J. Sci. Comput. 36, 2014).
        """
        return float(np.sqrt(self._analysis.eigenvalues[self._analysis.dimension :].sum()) * self._boundUnit())

    def _boundUnit(self):
        # The eigenvalues of several outputs have no unit.
        return 1.0 if self._analysis.units is None or len(self._analysis.units) > 1 else self._analysis.units[0]

    def getErrorBoundInterval(self, level: float = 0.95) -> ot.Interval:
        """Bootstrap interval (1-dimensional) of the error bound, on the conditions that the class names."""
        _checkLevel(level)
        unit = self._boundUnit()
        replicates = np.sqrt(self._analysis.eigenvalueReplicates[:, self._analysis.dimension :].sum(axis=1))
        lower, upper = reflected_bands(np.array([self.getErrorBound() / unit]), replicates[:, None], level)
        return self._interval(lower * unit, upper * unit)

    def getEvaluationNumber(self) -> int:
        """Evaluations of the function, including finite differences and the estimate of the noise."""
        return self._analysis.evaluations

    def getGradientNumber(self) -> int:
        """Gradients of the function (of all outputs at a point); 0 when differences were taken."""
        return self._analysis.gradientCalls

    getEvaluationCallsNumber = DeprecatedAlias("getEvaluationNumber")
    getGradientCallsNumber = DeprecatedAlias("getGradientNumber")

    def getFiniteDifferenceStep(self) -> float | None:
        """Step of the differences in the standard space, None when there were none."""
        return self._analysis.step

    def getNoise(self) -> ot.Point | None:
        """Estimated noise of each output (standard deviation), None when it was not needed."""
        return None if self._analysis.noise is None else ot.Point(self._analysis.noise)

    def getActiveSample(self) -> ot.Sample:
        """Active variables at the points, :py:class:`openturns.Sample` (M, r)."""
        self._needDirections()
        return ot.Sample(self._analysis.points @ self._active())

    def getRegressionResult(self) -> MultivariatePolynomialRegressionResult:
        """Regression of the outputs on the active variables: E[g | y] and, by its ``computeSpread``, the spread.

        Returns
        -------
        :class:`~satsep_ot.methods.polynomials.regression_result.MultivariatePolynomialRegressionResult`
            Of degree 4, or less if there are fewer than two points for each term.

        Notes
        -----
        Its intervals and its cross-validation take the directions as known.
        """
        self._needDirections()
        if self._regression is None:
            dimension = self._analysis.dimension
            regression = MultivariatePolynomialRegression(
                self.getActiveSample(), self.getOutputSample(), ot.Normal(dimension)
            )
            regression.setDegree(surrogate_degree(len(self._analysis.points), dimension))
            regression.setWeights(self._analysis.weights)
            regression.run()
            self._regression = regression.getResult()
        return self._regression

    def drawEigenvalues(self, level: float = 0.95) -> ot.Graph:
        """Eigenvalues on a logarithmic scale with their bootstrap band, :py:class:`openturns.Graph`."""
        _checkLevel(level)
        # Below there is rounding only, which has no place on a logarithmic scale.
        floor = (len(self._analysis.eigenvalues) * np.finfo(float).eps) ** 2 * self._analysis.eigenvalues[0]
        number = max(1, int((self._analysis.eigenvalues[: self._analysis.resolved] > floor).sum()))
        left = len(self._analysis.eigenvalues) - number
        title = "Eigenvalues with bootstrap band" + (f", {left} of {number + left} are 0" if left else "")
        graph = ot.Graph(title, "number", "eigenvalue", True, "upper right")
        if self._analysis.eigenvalues[0] > 0.0:
            graph.setLogScale(ot.GraphImplementation.LOGY)
        lower, upper = (np.maximum(band[:number], floor) for band in self._eigenvalueBands(level))
        if self._analysis.heavy_tailed:
            upper = None
        addBand(graph, self._analysis.eigenvalues[:number], lower, upper, level)
        return graph

    def drawSubspaceError(self, level: float = 0.95) -> ot.Graph:
        """Bootstrap mean and band of the subspace distance by dimension, :py:class:`openturns.Graph`."""
        _checkLevel(level)
        graph = ot.Graph("Subspace distance with bootstrap band", "dimension", "distance", True, "upper right")
        number = min(self._analysis.distances.shape[1], max(1, len(self._analysis.eigenvalues) - 1))
        lower, upper = quantile_bands(self._analysis.distances[:, :number], level)
        addBand(graph, self._analysis.distances[:, :number].mean(axis=0), lower, upper, level)
        return graph

    def drawActivityScores(self, level: float = 0.95, names: Sequence[str] | None = None) -> ot.Graph:
        """Activity scores with bootstrap intervals, largest first, :py:class:`openturns.Graph`."""
        interval = self.getActivityScoresInterval(level)
        lower = np.array(interval.getLowerBound())
        upper = None if self._analysis.heavy_tailed else np.array(interval.getUpperBound())
        names = list(names or self._space.getDistribution().getDescription())
        return drawScores(np.array(self.getActivityScores()), lower, upper, names)

    def drawSufficientSummary(self, output: int = 0, level: float = 0.95) -> ot.Graph:
        """Output against the first active variables with the regression on them.

        Parameters
        ----------
        output : int
            Which output.
        level : float
            Level of the band of prediction (one active variable).

        Returns
        -------
        :py:class:`openturns.Graph`
            One active variable: points, regression and its band. More: points in the plane of the first two over
            the contours of the regression on these two.
        """
        self._needDirections()
        _checkLevel(level)
        if not 0 <= output < self._analysis.values.shape[1]:
            raise ValueError(f"The output is {output}; it must be 0 to {self._analysis.values.shape[1] - 1}.")
        active = self._analysis.points @ self._active()
        name = self._outputs[output] if self._outputs else f"output {output}"
        return drawSufficientSummary(active, self._values()[:, output], self._analysis.weights, name, level)

    def compareDirections(self, directions: ArrayLike) -> float:
        """Distance ||W W^T - V V^T||_2 of the active subspace to another one given by (d, r) columns."""
        other = linalg.qr(np.array(directions, dtype=float), mode="economic")[0]
        return subspace_distance(self._active(), other)

    def save(self, path: str | os.PathLike) -> None:
        """Write the result to one file, whole or not at all: arrays, and the distribution as OpenTURNS' XML.

        What is loaded answers everything as this result does, to the last bit, bootstrap intervals included. For the
        map to the active variables alone put :meth:`getTransformation` into an :py:class:`openturns.Study`.

        Parameters
        ----------
        path : str or path
            Ends on ``.npz``.
        """
        fields = {field.name: getattr(self._analysis, field.name) for field in dataclasses.fields(SubspaceAnalysis)}
        writeResult(path, _FORMAT, fields | {"distribution": self._space.getDistribution(), "outputs": self._outputs})

    @staticmethod
    def load(path: str | os.PathLike) -> "ActiveSubspaceResult":
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
        space = StandardSpace(fields["distribution"])
        names = [field.name for field in dataclasses.fields(SubspaceAnalysis) if field.name in fields]
        analysis = SubspaceAnalysis(**{name: fields[name] for name in names})
        return ActiveSubspaceResult(space, analysis, fields.get("outputs"))
