"""What a polynomial regression tells: predictions with intervals, cross-validation, moments, sensitivities."""

import dataclasses
import functools
import math
import os
from collections.abc import Sequence

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.deprecation import DeprecatedAlias
from satsep_ot.methods.common.storage import readResult, writeResult
from satsep_ot.methods.common.units import output_units
from satsep_ot.methods.polynomials.basis import PolynomialBasis
from satsep_ot.methods.polynomials.families import PolynomialFamilies
from satsep_ot.methods.polynomials.fit import PolynomialFit, fit_polynomial, shuffled_folds
from satsep_ot.methods.polynomials.prediction import PolynomialPrediction, predict_hessian
from satsep_ot.moved_modules import restoring
from satsep_ot.openturns_object import OpenTURNSObject

# Minus the mean of the logarithm of a chi-square variable with one degree of freedom.
LOG_CHI_SQUARE = math.log(2.0) + np.euler_gamma
_FORMAT = "MultivariatePolynomialRegressionResult 2"


class MultivariatePolynomialRegressionResult(OpenTURNSObject):
    """Result of :class:`MultivariatePolynomialRegression`.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
    >>> inputs = np.linspace(-1.0, 1.0, 30)[:, None]
    >>> regression = MultivariatePolynomialRegression(inputs, np.exp(inputs))
    >>> regression.run()
    >>> result = regression.getResult()
    >>> bool(result.getQ2LeaveOneOut()[0] > 0.9999)
    True

    Kept in a file, and back to the last bit:

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     result.save(f"{directory}/regression.npz")
    ...     again = type(result).load(f"{directory}/regression.npz")
    >>> again.getCoefficients() == result.getCoefficients()
    True
    """

    def __init__(
        self,
        fit: PolynomialFit,
        points: np.ndarray,
        values: np.ndarray,
        families: PolynomialFamilies,
        descriptions: list[list[str] | None],
    ) -> None:
        self._fit = fit
        self._points = points
        self._values = values
        self._families = families
        self._descriptions = descriptions

    __setstate__ = restoring(_reduction="_families", _metaModel=None, _prediction=None, _moments=None)

    def _shown(self):
        return {"size": len(self._points), "degree": self.getDegree(), "terms": self._fit.basis.size}

    def getDegree(self) -> int:
        """Highest total degree."""
        return self._fit.basis.degree

    def getDistribution(self) -> ot.Distribution:
        """Law of the inputs under which the polynomials are orthonormal."""
        return self._families.law

    def getInputSample(self) -> ot.Sample:
        """Inputs, :py:class:`openturns.Sample` (N, d)."""
        return namedSample(self._points, self._descriptions[0])

    def getOutputSample(self) -> ot.Sample:
        """Outputs, :py:class:`openturns.Sample` (N, p)."""
        return namedSample(self._values, self._descriptions[1])

    def getIndices(self) -> np.ndarray:
        """Exponents of each term, ndarray of int (P, d); the first is the constant."""
        return self._fit.basis.indices.copy()

    def getCoefficients(self) -> ot.Sample:
        """Coefficients, :py:class:`openturns.Sample` (P, p)."""
        return ot.Sample(self._fit.coefficients)

    def getRank(self) -> int:
        """Numerical rank of the weighted design, which is its number of terms."""
        return self._fit.rank

    def getConditionNumber(self) -> float:
        """Condition number of the weighted design (estimate in the 1-norm)."""
        return float(self._fit.condition)

    @functools.cached_property
    def _prediction(self):
        families = self._families
        return PolynomialPrediction(self._fit.basis, self._fit.coefficients, families.centre, families.slope)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Predictions on arrays, (n, d) to (n, p); the fast way."""
        return np.ascontiguousarray(self._prediction.evaluate(points).T)

    def computeGradient(self, points: np.ndarray) -> np.ndarray:
        """Gradients at points (n, d): ndarray (n, d, p)."""
        return self._fit.predict_gradient(self._families.standardise(points)) * self._families.slope[:, None]

    def computeHessian(self, points: np.ndarray) -> np.ndarray:
        """Second derivatives at points (n, d): ndarray (n, d, d, p)."""
        hessian = predict_hessian(self._fit.basis, self._fit.coefficients, self._families.standardise(points))
        return hessian * (self._families.slope[:, None] * self._families.slope)[:, :, None]

    def getMetaModel(self) -> ot.Function:
        """The polynomial as a native :py:class:`openturns.Function` with exact derivatives."""
        return self._metaModel

    @functools.cached_property
    def _metaModel(self):
        basis = self._fit.basis
        d, p = basis.dimension, self._values.shape[1]
        product = ot.OrthogonalProductPolynomialFactory(self._families.members)
        enumerate_ = product.getEnumerateFunction()
        terms = [product.build(enumerate_.inverse(alpha)) for alpha in basis.indices.tolist()]
        if p == 1:
            expansion = ot.LinearCombinationFunction(terms, self._fit.coefficients[:, 0])
        else:
            expansion = ot.DualLinearCombinationFunction(terms, self._fit.coefficients)
        reduction = ot.LinearFunction(self._families.centre, [0.0] * d, ot.Matrix(np.diag(self._families.slope)))
        metaModel = ot.ComposedFunction(expansion, reduction)
        inputs, outputs = self._descriptions
        metaModel.setInputDescription(inputs or [f"x{i}" for i in range(d)])
        metaModel.setOutputDescription(outputs or [f"y{i}" for i in range(p)])
        return metaModel

    def getMetaModelResult(self) -> ot.MetaModelResult:
        """An :py:class:`openturns.MetaModelResult` of the samples and the native function."""
        return ot.MetaModelResult(self.getInputSample(), self.getOutputSample(), self.getMetaModel())

    def getMetaModelValidation(
        self, inputSample: ArrayLike | None = None, outputSample: ArrayLike | None = None
    ) -> ot.MetaModelValidation:
        """An :py:class:`openturns.MetaModelValidation`.

        On the sample given; without one on the leave-one-out predictions of the training sample, not on its fit.
        """
        if inputSample is None:
            predictions = self._values - self._fit.leave_one_out()
            if not np.isfinite(predictions).all():
                raise ValueError("A point of leverage 1 has no leave-one-out prediction: give a validation sample.")
            return ot.MetaModelValidation(ot.Sample(self._values), ot.Sample(predictions))
        return ot.MetaModelValidation(
            ot.Sample(np.asarray(outputSample, dtype=float)), self.getMetaModel()(inputSample)
        )

    def getResiduals(self) -> ot.Sample:
        """Observed minus fitted, :py:class:`openturns.Sample` (N, p)."""
        return ot.Sample(self._fit.residuals)

    def getLeverages(self) -> ot.Point:
        """Leverages, :py:class:`openturns.Point` (N)."""
        return ot.Point(self._fit.leverages)

    def getNoiseVariance(self) -> ot.Point:
        """Unbiased estimate of the noise variance of each output, at weight 1.

        Raises
        ------
        ValueError
            As many terms as points leave no residual to estimate it from.
        """
        return ot.Point(self._noise() ** 2)

    def _noise(self):
        """Standard deviation (p,) of the noise of each output."""
        deviation = self._fit.noise_deviation
        if deviation is None:
            points = self._fit.rank + self._fit.freedom
            raise ValueError(f"{points} points and as many terms leave no residual to estimate noise from.")
        return deviation

    def getLeaveOneOutResiduals(self) -> ot.Sample:
        """Errors of the fits without each point, e_i / (1 - h_i), :py:class:`openturns.Sample` (N, p)."""
        return ot.Sample(self._fit.leave_one_out())

    def getKFoldResiduals(self, folds: int | Sequence[ArrayLike] = 10) -> ot.Sample:
        """Errors of the fits without each block, (I - H_kk)^-1 e_k, :py:class:`openturns.Sample` (N, p).

        Parameters
        ----------
        folds : int or sequence of int arrays
            Number of blocks, drawn from ``ot.RandomGenerator``, or the blocks themselves.
        """
        if isinstance(folds, int):
            if not 2 <= folds <= len(self._points):
                raise ValueError(f"The number of folds is {folds}; it must be 2 to {len(self._points)}.")
            folds = shuffled_folds(len(self._points), folds)
        return ot.Sample(self._fit.k_fold([np.asarray(fold, dtype=int) for fold in folds]))

    def _q2(self, errors):
        units = output_units(self._values)
        values = self._values / units
        spread = ((values - values.mean(axis=0)) ** 2).sum(axis=0)
        if not (spread > 0.0).all():
            raise ValueError("An output is constant over the sample: Q2 is not defined for it.")
        return ot.Point(1.0 - ((np.asarray(errors) / units) ** 2).sum(axis=0) / spread)

    def getR2(self) -> ot.Point:
        """1 - residual over total sum of squares of each output, on the training sample."""
        return self._q2(self._fit.residuals)

    def getQ2LeaveOneOut(self) -> ot.Point:
        """1 - leave-one-out over total sum of squares of each output."""
        return self._q2(self._fit.leave_one_out())

    def getQ2KFold(self, folds: int | Sequence[ArrayLike] = 10) -> ot.Point:
        """1 - sum of squares of the block cross-validation over the total one, of each output."""
        return self._q2(self.getKFoldResiduals(folds))

    def getCoefficientsCovariance(self, output: int = 0) -> ot.CovarianceMatrix:
        """Covariance of the coefficients of one output, :py:class:`openturns.CovarianceMatrix` (P, P)."""
        return ot.CovarianceMatrix(self.getNoiseVariance()[output] * self._fit.relative_covariance())

    def getCoefficientsInterval(self, level: float = 0.95, output: int = 0) -> ot.Interval:
        """Student intervals of the coefficients of one output, :py:class:`openturns.Interval` (P).

        Conditional on the polynomial: they hold where the outputs are a polynomial of this degree plus independent
        noise. Of another function they say how well the nearest polynomial is known, if the noise dominates.
        """
        deviation = self._noise()[output] * np.sqrt(self._fit.relative_covariance().diagonal())
        half = self._quantile(level) * deviation
        coefficients = self._fit.coefficients[:, output]
        return ot.Interval(coefficients - half, coefficients + half)

    def _quantile(self, level):
        if not 0.0 < level < 1.0:
            raise ValueError(f"The confidence level is {level}; it must be in (0, 1).")
        return ot.Student(float(self._fit.freedom)).computeQuantile(0.5 + 0.5 * level)[0]

    def getPredictionVariance(self, points: np.ndarray, noise: bool = True) -> np.ndarray:
        """Variance of predictions at points (n, d): ndarray (n, p).

        Parameters
        ----------
        noise : bool
            True: of a new observation, sigma^2 (1 + q^T q); False: of the fitted mean, sigma^2 q^T q.
        """
        return self._predictionDeviation(points, noise) ** 2

    def _predictionDeviation(self, points, noise):
        relative = self._fit.relative_variance(self._families.standardise(points))
        return np.sqrt(relative + (1.0 if noise else 0.0))[:, None] * self._noise()

    def getPredictionInterval(
        self, points: np.ndarray, level: float = 0.95, noise: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Student intervals of predictions at points (n, d): lower and upper ndarray, each (n, p).

        Conditional on the polynomial: they hold where the outputs are a polynomial of this degree plus independent
        noise. If they are not (exp without noise, say), the interval of the mean holds far less often than its level,
        and less the more points there are; :meth:`getCrossValidatedInterval` does not assume it.
        """
        quantile = self._quantile(level)
        half = quantile * self._predictionDeviation(points, noise)
        mean = self.evaluate(points)
        return mean - half, mean + half

    def getCrossValidatedInterval(self, points: np.ndarray, level: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
        """Intervals of new outputs at points (n, d), from leave-one-out errors: lower and upper ndarray, each (n, p).

        The half width is the quantile of the absolute leave-one-out errors (the jackknife of Barber et al., Ann. Stat.
        49, 2021), whether or not the polynomial is the truth. It holds on average over new inputs that are drawn as
        those of the sample were, not at each of them; and with directions found from the same data (as by
        :class:`~satsep_ot.methods.subspaces.ridge_approximation.RidgeApproximation`) the errors look too small.

        Raises
        ------
        ValueError
            A point of leverage 1, or too few points for the level: (N + 1) level must not exceed N.
        """
        errors = np.abs(self._fit.leave_one_out())
        if not np.isfinite(errors).all():
            raise ValueError("A point of leverage 1 has no leave-one-out error: its interval is not known.")
        self._quantile(level)
        weights = np.ones(len(errors)) if self._fit.weights is None else self._fit.weights
        used = weights > 0.0
        errors, weights = errors[used], weights[used] / weights[used].mean()
        # One more point of average weight, of which nothing is known, may have any error.
        wanted = level * (weights.sum() + 1.0)
        if wanted > weights.sum():
            needed = math.ceil(level / (1.0 - level))
            raise ValueError(f"{len(errors)} points are too few for the level {level}: {needed} at least are needed.")
        half = np.empty(errors.shape[1])
        for output, column in enumerate(errors.T):
            order = np.argsort(column)
            place = np.searchsorted(np.cumsum(weights[order]), wanted * (1.0 - 1e-12))
            half[output] = column[order[place]]
        mean = self.evaluate(points)
        return mean - half, mean + half

    def computeSpread(self, points: np.ndarray) -> np.ndarray:
        """Standard deviation of the outputs about the polynomial at points (n, d), which may vary: ndarray (n, p).

        If the inputs are active variables y, it is the standard deviation of g given y. The logarithm of the squared
        leave-one-out errors is regressed on a quadratic, or on the regression's own degree if that is less (Harvey,
        Econometrica 44, 1976).

        Raises
        ------
        ValueError
            A point of leverage 1, or fewer points than terms of the quadratic.
        """
        errors = self._fit.leave_one_out()
        if not np.isfinite(errors).all():
            raise ValueError("A point of leverage 1 has no leave-one-out error: the spread is not known there.")
        # Errors at rounding level are none.
        smallest = 1e-15 * np.abs(self._values).max(axis=0) + np.finfo(float).tiny
        logarithm = 2.0 * np.log(np.maximum(np.abs(errors), smallest)) + LOG_CHI_SQUARE
        fitted = self._fit.basis
        degree = min(2, fitted.degree)
        basis = PolynomialBasis(fitted.dimension, degree, recurrence=fitted.recurrence[:, :degree])
        weights = self._fit.weights
        spread = fit_polynomial(basis, self._families.standardise(self._points), logarithm, weights)
        return np.exp(0.5 * spread.predict(self._families.standardise(points)))

    @functools.cached_property
    def _moments(self):
        """Squares (P, p) of the coefficients without the mean, in units (p,) of their own squared, and these units.

        A refusal where they are no moments under the distribution.
        """
        self._families.checkMoments(self._fit.basis)
        units = output_units(self._fit.coefficients)
        squares = (self._fit.coefficients / units) ** 2
        squares[0] = 0.0
        return squares, units

    def getMean(self) -> ot.Point:
        """Mean of the polynomial under the distribution of the inputs, :py:class:`openturns.Point` (p).

        Raises
        ------
        ValueError
            The distribution has no moments that high, as Student's with few degrees of freedom, or none that can be
            computed. Variance and Sobol indices raise this as well.
        """
        # The constant is the mean where the basis is orthonormal.
        _ = self._moments
        return ot.Point(self._fit.coefficients[0])

    def getVariance(self) -> ot.Point:
        """Variance of the polynomial under the distribution of the inputs, :py:class:`openturns.Point` (p)."""
        squares, units = self._moments
        return ot.Point(squares[1:].sum(axis=0) * units**2)

    def getSample(self, size: int) -> ot.Sample:
        """Outputs of the polynomial at inputs drawn from their distribution, :py:class:`openturns.Sample` (size, p)."""
        sample = ot.Sample(self.evaluate(np.array(self._families.law.getSample(size))))
        sample.setDescription(self.getMetaModel().getOutputDescription())
        return sample

    def getKernelDistribution(self, size: int = 100_000, output: int = 0) -> ot.KernelSmoothing:
        """Law of one output by kernel smoothing of a sample, an :py:class:`openturns.Distribution`.

        For any number of variables; for one to three standard normal ones
        :class:`~satsep_ot.methods.polynomials.distribution.PolynomialDistribution` has no sampling noise.
        """
        return ot.KernelSmoothing().build(self.getSample(size).getMarginal(output))

    def _share(self, selected, output):
        if output not in range(self._values.shape[1]):
            raise ValueError(f"The output is {output}; it must be 0 to {self._values.shape[1] - 1}.")
        squares = self._moments[0][:, output] * self._active().any(axis=1)
        total = squares.sum()
        if not total > 0.0:
            raise ValueError(f"Output {output} of the polynomial is constant: it has no Sobol indices.")
        return float(squares[selected].sum() / total)

    def getSobolIndex(self, variables: int | Sequence[int], output: int = 0) -> float:
        """Sobol index of one input (int) or the interaction index of several (sequence of int).

        Names and meaning of this and the next three are those of :py:class:`openturns.FunctionalChaosSobolIndices`.

        Raises
        ------
        ValueError
            There is no such input or output, an input is named twice, or the output is constant.
        """
        return self._share((self._active() == self._group(variables)).all(axis=1), output)

    def getSobolTotalIndex(self, variables: int | Sequence[int], output: int = 0) -> float:
        """Total Sobol index of one input, or of the interaction of several: the share of the terms with all of them."""
        return self._share(self._active()[:, self._group(variables)].all(axis=1), output)

    def getSobolGroupedIndex(self, variables: int | Sequence[int], output: int = 0) -> float:
        """Closed Sobol index of a group: the share of the terms that have inputs of the group only."""
        return self._share(~self._active()[:, ~self._group(variables)].any(axis=1), output)

    def getSobolGroupedTotalIndex(self, variables: int | Sequence[int], output: int = 0) -> float:
        """Total Sobol index of a group: the share of the terms that have any input of the group."""
        return self._share(self._active()[:, self._group(variables)].any(axis=1), output)

    getTotalSobolIndex = DeprecatedAlias("getSobolTotalIndex")

    def _active(self):
        return self._fit.basis.indices > 0

    def _group(self, variables):
        """Whether each input is among some, ndarray of bool (d,)."""
        d = self._fit.basis.dimension
        group = np.zeros(d, dtype=bool)
        given = np.atleast_1d(variables)
        numbers = {int(variable) for variable in given if variable in range(d)}
        if not len(given) or len(numbers) < len(given):
            raise ValueError(f"The inputs are {given.tolist()}; they must be different ones of 0 to {d - 1}.")
        group[list(numbers)] = True
        return group

    def getFunctionalChaosResult(self) -> ot.FunctionalChaosResult:
        """The polynomial as a native :py:class:`openturns.FunctionalChaosResult`, for all that OpenTURNS does with one.

        Its Sobol indices, random vector and validation are OpenTURNS' own; the basis is the same.
        """
        families = self._families
        product = ot.OrthogonalProductPolynomialFactory(families.members)
        enumeration = product.getEnumerateFunction()
        terms = ot.Indices([enumeration.inverse(alpha) for alpha in self._fit.basis.indices.tolist()])
        d = len(families.centre)
        forward = ot.LinearFunction(families.centre, [0.0] * d, ot.Matrix(np.diag(families.slope)))
        backward = ot.LinearFunction([0.0] * d, families.centre, ot.Matrix(np.diag(1.0 / families.slope)))
        functions = [product.build(term) for term in terms]
        return ot.FunctionalChaosResult(
            self.getInputSample(), self.getOutputSample(), families.law, forward, backward, product, terms,
            self.getCoefficients(), functions,
        )  # fmt: skip

    def getGradientMatrix(self, output: int = 0) -> ot.Matrix:
        """Expected outer product of the polynomial's gradient, E[grad grad^T], :py:class:`openturns.Matrix` (d, d).

        Exact from the coefficients, since the derivative has coefficients in the same orthonormal basis.
        """
        basis = self._fit.basis
        slopes = np.stack(
            [basis.derivative_coefficients(self._fit.coefficients[:, output], j) for j in range(basis.dimension)]
        )
        slopes *= self._families.slope[:, None]
        return ot.Matrix(slopes @ slopes.T)

    def save(self, path: str | os.PathLike) -> None:
        """Write the result to one file, whole or not at all: arrays, and the distribution as OpenTURNS' XML.

        What is loaded answers everything as this result does, to the last bit. For the polynomial alone put
        :meth:`getMetaModel` into an :py:class:`openturns.Study`.

        Parameters
        ----------
        path : str or path
            Ends on ``.npz``.
        """
        fields = {"law": self._families.law, "centre": self._families.centre, "slope": self._families.slope}
        fields |= {"points": self._points, "values": self._values, "descriptions": self._descriptions}
        writeResult(path, _FORMAT, fields | self._fit.fields())

    @staticmethod
    def load(path: str | os.PathLike) -> "MultivariatePolynomialRegressionResult":
        """The result that `save` has written.

        Parameters
        ----------
        path : str or path

        Raises
        ------
        ValueError
            The file is not such a result.
        """
        fields = readResult(path, _FORMAT, objects={"law": ot.Distribution()})
        families = dataclasses.replace(
            PolynomialFamilies.of(fields["law"]), centre=fields["centre"], slope=fields["slope"]
        )
        points, values = fields["points"], fields["values"]
        fit = PolynomialFit.of(fields, families.standardise(points), values)
        return MultivariatePolynomialRegressionResult(fit, points, values, families, fields["descriptions"])


def namedSample(array: np.ndarray, description: Sequence[str] | None) -> ot.Sample:
    """A sample under names, or under OpenTURNS' own where there are none."""
    sample = ot.Sample(array)
    if description is not None:
        sample.setDescription(description)
    return sample
