"""Multivariate polynomial regression with what is needed to judge it, as a native OpenTURNS function."""

import dataclasses
import functools
import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.common.storage import readResult, writeResult
from satsep_ot.methods.polynomials.basis import PolynomialBasis, PolynomialFit, fit_polynomial, hermite_recurrence
from satsep_ot.methods.polynomials.prediction import PolynomialPrediction

# Tuning of Huber's estimator for 95 % efficiency under normal noise (Huber 1981).
HUBER_CONSTANT = 1.345
# E[min(z^2, 1.345 |z|)] of a standard normal z: what its weights leave of the variance of normal noise.
HUBER_SHARE = math.erf(HUBER_CONSTANT / math.sqrt(2.0))
HUBER_STEPS = 50
# Minus the mean of the logarithm of a chi-square variable with one degree of freedom.
LOG_CHI_SQUARE = math.log(2.0) + np.euler_gamma
HIGHEST_DEGREE = 10
_FORMAT = "MultivariatePolynomialRegressionResult 2"


def shuffled_folds(size: int, folds: int) -> list[np.ndarray]:
    """Positions 0 to ``size`` - 1 in random blocks of nearly equal size, from ``ot.RandomGenerator``.

    Examples
    --------
    >>> from satsep_ot.methods.polynomials.regression import shuffled_folds
    >>> [len(block) for block in shuffled_folds(5, 2)]
    [3, 2]
    """
    order = np.array(ot.RandomGenerator.Generate(size)).argsort(kind="stable")
    return [np.sort(block) for block in np.array_split(order, min(folds, size))]


def _isNormal(distribution):
    return isinstance(distribution.getImplementation(), ot.Normal)


# The most common bases: they are not changed by anyone, and take longer to set up than a small fit.
_hermiteBasis = functools.lru_cache(maxsize=32)(PolynomialBasis)


def _named(array, description):
    sample = ot.Sample(array)
    if description is not None:
        sample.setDescription(description)
    return sample


@dataclasses.dataclass
class _Reduction:
    """Inputs to the variables of the polynomial families, z = slope (x - centre)."""

    law: ot.Distribution
    families: list
    centre: np.ndarray
    slope: np.ndarray

    @staticmethod
    def of(law):
        """That of a law with independent marginals."""
        families = []
        centre, slope = np.array(law.getMean()), 1.0 / np.array(law.getStandardDeviation())
        if _isNormal(law):
            return _Reduction(law, [ot.HermiteFactory()] * len(centre), centre, slope)
        for i in range(law.getDimension()):
            marginal = law.getMarginal(i)
            if _isNormal(marginal):
                families.append(ot.HermiteFactory())
                continue
            family = ot.StandardDistributionPolynomialFactory(marginal)
            measure = family.getMeasure()
            # So that mean and standard deviation go to those of the family's own measure.
            slope[i] *= measure.getStandardDeviation()[0]
            centre[i] -= measure.getMean()[0] / slope[i]
            families.append(family)
        return _Reduction(law, families, centre, slope)

    def apply(self, points):
        return (np.asarray(points, dtype=float) - self.centre) * self.slope


class MultivariatePolynomialRegression:
    """Least squares on orthonormal polynomials of several variables, of total degree 4 by default.

    Parameters
    ----------
    inputSample : array (N, d) or :py:class:`openturns.Sample`
        Inputs, best the active variables.
    outputSample : array (N, p) or :py:class:`openturns.Sample`
        Outputs.
    distribution : :py:class:`openturns.Distribution`, optional
        Law of the inputs, with independent continuous marginals: the polynomials are orthonormal under it (Hermite
        for normal, Legendre for uniform, Laguerre for gamma, Jacobi for beta, computed for any other marginal).
        By default independent normals with the mean and the standard deviation of the sample.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
    >>> ot.RandomGenerator.SetSeed(0)
    >>> function = ot.SymbolicFunction(["a", "b"], ["1 + a - b^3 * a"])
    >>> inputs = ot.Normal(2).getSample(60)
    >>> regression = MultivariatePolynomialRegression(inputs, function(inputs), ot.Normal(2))
    >>> regression.run()
    >>> result = regression.getResult()
    >>> print(round(result.getMetaModel()([2.0, 1.0])[0], 9), round(result.getVariance()[0], 9))
    1.0 16.0
    """

    def __init__(
        self, inputSample: ArrayLike, outputSample: ArrayLike, distribution: ot.Distribution | None = None
    ) -> None:
        self._points = np.array(inputSample, dtype=float)
        self._values = np.array(outputSample, dtype=float)
        if self._points.ndim != 2 or self._values.ndim != 2 or len(self._points) != len(self._values):
            raise ValueError(
                f"The samples must have shapes (N, d) and (N, p), got {self._points.shape} and {self._values.shape}."
            )
        if len(self._points) < 1 or self._points.shape[1] < 1 or self._values.shape[1] < 1:
            raise ValueError(f"The samples are empty: shapes {self._points.shape} and {self._values.shape}.")
        for name, array in (("inputs", self._points), ("outputs", self._values)):
            finite = np.isfinite(array).all(axis=1)
            if not finite.all():
                row = int((~finite).argmax())
                raise ValueError(
                    f"The {name} must be finite, but {int((~finite).sum())} of {len(array)} rows are not, "
                    f"the first is row {row}: {array[row].tolist()}."
                )
        self._distribution = None if distribution is None else self._checkedDistribution(distribution)
        self._descriptions = [
            list(sample.getDescription()) if isinstance(sample, ot.Sample) else None
            for sample in (inputSample, outputSample)
        ]
        self._degree = 4
        self._norm = 1.0
        self._weights = None
        self._robust = False
        self._result = None

    def _checkedDistribution(self, distribution):
        distribution = ot.Distribution(distribution)
        d = self._points.shape[1]
        if distribution.getDimension() != d:
            raise ValueError(f"The distribution has dimension {distribution.getDimension()}, the inputs {d}.")
        if not (distribution.isContinuous() and distribution.hasIndependentCopula()):
            raise ValueError(
                "The distribution must have independent continuous marginals; for others work in the standard space."
            )
        return distribution

    def __repr__(self) -> str:
        return (
            f"MultivariatePolynomialRegression(size={len(self._points)}, inputs={self._points.shape[1]}, "
            f"outputs={self._values.shape[1]}, degree={self._degree})"
        )

    def setDegree(self, degree: int) -> None:
        """Highest total degree, 0 to 10 (default 4)."""
        if int(degree) != degree or not 0 <= degree <= HIGHEST_DEGREE:
            raise ValueError(f"The degree must be an integer from 0 to {HIGHEST_DEGREE}, got {degree}.")
        self._degree = int(degree)

    def getDegree(self) -> int:
        """Highest total degree."""
        return self._degree

    def setHyperbolicNorm(self, norm: float) -> None:
        """Norm q of the index set, in (0, 1]: 1 (default) is the total degree, less drops interactions."""
        if not 0.0 < norm <= 1.0:
            raise ValueError(f"The norm of the index set must be in (0, 1], got {norm}.")
        self._norm = float(norm)

    def setWeights(self, weights: ArrayLike | None) -> None:
        """Weights (N,), not negative: the sum of weight times squared residual is minimised; None for equal ones."""
        if weights is not None:
            weights = np.array(weights, dtype=float).reshape(-1)
            if weights.shape != (len(self._points),) or not (np.isfinite(weights).all() and (weights >= 0.0).all()):
                raise ValueError(f"The weights must be {len(self._points)} finite numbers >= 0.")
        self._weights = weights

    def setRobust(self, robust: bool) -> None:
        """Huber's estimator by reweighting (one output): points far off the fit count less.

        The noise variance and the intervals are those of normal noise that outliers are mixed with: they are right
        without outliers, and too wide rather than too narrow with them.
        """
        if robust and self._values.shape[1] != 1:
            raise ValueError(f"The robust fit needs one output, there are {self._values.shape[1]}.")
        self._robust = bool(robust)

    def selectDegree(self, highest: int = 4, folds: int = 10) -> dict:
        """Set the degree by block cross-validation with parsimony.

        The smallest degree whose mean squared prediction error is within one standard error of the best one
        (Hastie, Tibshirani and Friedman 2009, section 7.10). Folds are drawn from ``ot.RandomGenerator``.

        Returns
        -------
        dict
            Root mean squared prediction error by degree that could be fitted, averaged over the outputs in units
            of their standard deviation.

        Raises
        ------
        ValueError
            The highest degree or the number of folds is not allowed, or there are too few points.
        """
        if int(highest) != highest or not 0 <= highest <= HIGHEST_DEGREE:
            raise ValueError(f"The highest degree is {highest}; a whole number from 0 to {HIGHEST_DEGREE} is allowed.")
        if int(folds) != folds or folds < 2:
            raise ValueError(f"The number of folds is {folds}; a whole number from 2 on is allowed.")
        blocks = shuffled_folds(len(self._points), folds)
        spread = self._values.var(axis=0)
        spread[spread == 0.0] = 1.0
        errors = {}
        reduction = self._reduction()
        reduced = reduction.apply(self._points)
        for degree in range(highest + 1):
            basis = self._basis(reduction.families, degree)
            if 2 * basis.size > len(self._points):
                break
            try:
                fit = self._fit(basis, reduced)
            except ValueError:
                break
            squared = (fit.k_fold(blocks) ** 2 / spread).mean(axis=1)
            errors[degree] = np.array([squared[block].mean() for block in blocks])
        if not errors:
            raise ValueError(f"{len(self._points)} points are too few to compare degrees: two at least are needed.")
        best = min(errors, key=lambda degree: errors[degree].mean())
        allowed = errors[best].mean() + errors[best].std(ddof=1) / math.sqrt(len(blocks))
        # Errors at rounding level are equal: an exact fit of low degree must not lose to a higher one.
        self._degree = min(degree for degree in errors if errors[degree].mean() <= max(allowed, 1e-24))
        return {degree: float(np.sqrt(error.mean())) for degree, error in errors.items()}

    def _law(self):
        if self._distribution is not None:
            return self._distribution
        scale = self._points.std(axis=0)
        # An input that does not vary is found by the rank, with its own message.
        scale[scale == 0.0] = 1.0
        return ot.Distribution(ot.Normal(self._points.mean(axis=0), scale, ot.CorrelationMatrix(len(scale))))

    def _reduction(self):
        return _Reduction.of(self._law())

    def _basis(self, families, degree):
        if all(isinstance(family, ot.HermiteFactory) for family in families):
            return _hermiteBasis(len(families), degree, self._norm)
        recurrences = []
        for family in families:
            if isinstance(family, ot.HermiteFactory):
                recurrences.append(hermite_recurrence(degree))
            else:
                rows = [list(family.getRecurrenceCoefficients(order)) for order in range(degree)]
                recurrences.append(np.array(rows).reshape(degree, 3))
        return PolynomialBasis(len(families), degree, self._norm, np.array(recurrences))

    def _fit(self, basis, reduced):
        fit = fit_polynomial(basis, reduced, self._values, self._weights)
        if not self._robust:
            return fit
        base = np.ones(len(reduced)) if self._weights is None else self._weights
        for _ in range(HUBER_STEPS):
            error = np.abs(fit.residuals[:, 0])
            # Median absolute residual as the scale, consistent for normal noise.
            scale = np.median(error) / 0.6744897501960817
            if scale == 0.0:
                return fit
            weights = base * np.minimum(1.0, HUBER_CONSTANT * scale / np.maximum(error, 1e-300))
            previous = fit.coefficients
            fit = fit_polynomial(basis, reduced, self._values, weights)
            fit.residual_share = HUBER_SHARE
            if np.abs(fit.coefficients - previous).max() <= 1e-10 * np.abs(fit.coefficients).max():
                return fit
        change = np.abs(fit.coefficients - previous).max() / np.abs(fit.coefficients).max()
        if change > 1e-4:
            raise RuntimeError(
                f"The robust fit did not converge in {HUBER_STEPS} steps: the coefficients still change by "
                f"{change:.2g} relative to the largest."
            )
        return fit

    def run(self) -> None:
        """Fit.

        Raises
        ------
        ValueError
            Fewer points than terms, or a rank below the number of terms; the rank is named.
        """
        reduction = self._reduction()
        fit = self._fit(self._basis(reduction.families, self._degree), reduction.apply(self._points))
        self._result = MultivariatePolynomialRegressionResult(
            fit, self._points, self._values, reduction, self._descriptions
        )

    def getResult(self) -> "MultivariatePolynomialRegressionResult":
        """The :class:`MultivariatePolynomialRegressionResult` of the last run."""
        if self._result is None:
            raise RuntimeError("There is no result yet: call run() first.")
        return self._result


class MultivariatePolynomialRegressionResult:
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
        self, fit: PolynomialFit, points: np.ndarray, values: np.ndarray, reduction: Any, descriptions: Any
    ) -> None:
        self._fit = fit
        self._points = points
        self._values = values
        self._reduction = reduction
        self._descriptions = descriptions
        self._metaModel = None

    def __repr__(self) -> str:
        return (
            f"MultivariatePolynomialRegressionResult(size={len(self._points)}, degree={self.getDegree()}, "
            f"terms={self._fit.basis.size})"
        )

    def getDegree(self) -> int:
        """Highest total degree."""
        return self._fit.basis.degree

    def getDistribution(self) -> ot.Distribution:
        """Law of the inputs under which the polynomials are orthonormal."""
        return self._reduction.law

    def getInputSample(self) -> ot.Sample:
        """Inputs, :py:class:`openturns.Sample` (N, d)."""
        return _named(self._points, self._descriptions[0])

    def getOutputSample(self) -> ot.Sample:
        """Outputs, :py:class:`openturns.Sample` (N, p)."""
        return _named(self._values, self._descriptions[1])

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
        reduction = self._reduction
        return PolynomialPrediction(self._fit.basis, self._fit.coefficients, reduction.centre, reduction.slope)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Predictions on arrays, (n, d) to (n, p); the fast way."""
        return np.ascontiguousarray(self._prediction.evaluate(points).T)

    def computeGradient(self, points: np.ndarray) -> np.ndarray:
        """Gradients at points (n, d): ndarray (n, d, p)."""
        return self._fit.predict_gradient(self._reduction.apply(points)) * self._reduction.slope[:, None]

    def computeHessian(self, points: np.ndarray) -> np.ndarray:
        """Second derivatives at points (n, d): ndarray (n, d, d, p)."""
        hessian = self._fit.basis.predict_hessian(self._reduction.apply(points), self._fit.coefficients)
        return hessian * (self._reduction.slope[:, None] * self._reduction.slope)[:, :, None]

    def getMetaModel(self) -> ot.Function:
        """The polynomial as a native :py:class:`openturns.Function` with exact derivatives."""
        if self._metaModel is None:
            basis = self._fit.basis
            d = basis.dimension
            product = ot.OrthogonalProductPolynomialFactory(self._reduction.families)
            enumerate_ = product.getEnumerateFunction()
            terms = [product.build(enumerate_.inverse(alpha)) for alpha in basis.indices.tolist()]
            if self._values.shape[1] == 1:
                expansion = ot.LinearCombinationFunction(terms, self._fit.coefficients[:, 0])
            else:
                expansion = ot.DualLinearCombinationFunction(terms, self._fit.coefficients)
            reduction = ot.LinearFunction(self._reduction.centre, [0.0] * d, ot.Matrix(np.diag(self._reduction.slope)))
            metaModel = ot.ComposedFunction(expansion, reduction)
            inputs, outputs = self._descriptions
            metaModel.setInputDescription(inputs or [f"x{i}" for i in range(d)])
            metaModel.setOutputDescription(outputs or [f"y{i}" for i in range(self._values.shape[1])])
            self._metaModel = metaModel
        return self._metaModel

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
        """Unbiased estimate of the noise variance of each output (that of weight 1).

        Raises
        ------
        ValueError
            As many terms as points leave no residual to estimate it from.
        """
        if self._fit.freedom <= 0:
            points = self._fit.rank + self._fit.freedom
            raise ValueError(f"{points} points and as many terms leave no residual to estimate noise from.")
        return ot.Point(self._fit.noise_variance)

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
                raise ValueError(f"The number of folds must be 2 to {len(self._points)}, got {folds}.")
            folds = shuffled_folds(len(self._points), folds)
        return ot.Sample(self._fit.k_fold([np.asarray(fold, dtype=int) for fold in folds]))

    def _q2(self, errors):
        spread = ((self._values - self._values.mean(axis=0)) ** 2).sum(axis=0)
        if not (spread > 0.0).all():
            raise ValueError("An output is constant over the sample: Q2 is not defined for it.")
        return ot.Point(1.0 - (np.asarray(errors) ** 2).sum(axis=0) / spread)

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
        """Student intervals of the coefficients of one output, :py:class:`openturns.Interval` (P)."""
        deviation = np.sqrt(np.array(self.getCoefficientsCovariance(output)).diagonal())
        half = self._quantile(level) * deviation
        coefficients = self._fit.coefficients[:, output]
        return ot.Interval(coefficients - half, coefficients + half)

    def _quantile(self, level):
        if not 0.0 < level < 1.0:
            raise ValueError(f"The confidence level must be in (0, 1), got {level}.")
        return ot.Student(float(self._fit.freedom)).computeQuantile(0.5 + 0.5 * level)[0]

    def getPredictionVariance(self, points: np.ndarray, noise: bool = True) -> np.ndarray:
        """Variance of predictions at points (n, d): ndarray (n, p).

        Parameters
        ----------
        noise : bool
            True: of a new observation, sigma^2 (1 + q^T q); False: of the fitted mean, sigma^2 q^T q.
        """
        relative = self._fit.relative_variance(self._reduction.apply(points))
        return (relative + (1.0 if noise else 0.0))[:, None] * np.array(self.getNoiseVariance())

    def getPredictionInterval(
        self, points: np.ndarray, level: float = 0.95, noise: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Student intervals of predictions at points (n, d): lower and upper ndarray, each (n, p)."""
        quantile = self._quantile(level)
        half = quantile * np.sqrt(self.getPredictionVariance(points, noise))
        mean = self.evaluate(points)
        return mean - half, mean + half

    def computeSpread(self, points: np.ndarray) -> np.ndarray:
        """Standard deviation of the outputs about the polynomial at points (n, d), which may vary: ndarray (n, p).

        Where the inputs are active variables, it is that of g given y. The logarithm of the squared leave-one-out
        errors is regressed on a
        quadratic, or on the regression's own degree if that is less (Harvey, Econometrica 44, 1976).

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
        spread = fit_polynomial(basis, self._reduction.apply(self._points), logarithm, weights)
        return np.exp(0.5 * spread.predict(self._reduction.apply(points)))

    def getMean(self) -> ot.Point:
        """Mean of the polynomial under the law of the inputs, :py:class:`openturns.Point` (p).

        Raises
        ------
        ValueError
            The law has no moments that high, as Student's with few degrees of freedom, or none that can be computed. So
            do variance and Sobol indices.
        """
        self._requireMoments()
        return ot.Point(self._fit.coefficients[0])

    def getVariance(self) -> ot.Point:
        """Variance of the polynomial under the law of the inputs, :py:class:`openturns.Point` (p)."""
        self._requireMoments()
        return ot.Point((self._fit.coefficients[1:] ** 2).sum(axis=0))

    def getSample(self, size: int) -> ot.Sample:
        """Outputs of the polynomial at inputs sampled from their law, :py:class:`openturns.Sample` (size, p)."""
        sample = ot.Sample(self.evaluate(np.array(self._reduction.law.getSample(size))))
        sample.setDescription(self.getMetaModel().getOutputDescription())
        return sample

    def getKernelDistribution(self, size: int = 100_000, output: int = 0) -> ot.KernelSmoothing:
        """Law of one output by kernel smoothing of a sample, an :py:class:`openturns.Distribution`.

        For any number of variables; for one to three standard normal ones
        :class:`~satsep_ot.methods.polynomials.distribution.PolynomialDistribution` has no sampling noise.
        """
        return ot.KernelSmoothing().build(self.getSample(size).getMarginal(output))

    def _requireMoments(self):
        """Refuse what rests on the orthonormality of the polynomials where the law does not give it."""
        basis, law = self._fit.basis, self._reduction.law
        for variable, family in enumerate(self._reduction.families):
            degree = int(basis.indices[:, variable].max(initial=0))
            if isinstance(family, ot.HermiteFactory) or degree == 0:
                continue
            # Over the standard normal of the same level, up to 9 standard deviations.
            nodes, weights = np.polynomial.legendre.leggauss(2000)
            nodes, weights = 9.0 * nodes, 9.0 * weights * np.exp(-40.5 * nodes**2) / math.sqrt(2.0 * math.pi)
            marginal = law.getMarginal(variable)
            levels = [(ot.DistFunc.pNormal(-abs(node)), node > 0.0) for node in nodes.tolist()]
            points = np.array([marginal.computeQuantile(*level)[0] for level in levels])
            z = (points - self._reduction.centre[variable]) * self._reduction.slope[variable]
            univariate = PolynomialBasis(1, degree, recurrence=basis.recurrence[[variable], :degree])
            with np.errstate(all="ignore"):
                square = univariate.evaluate(z[:, None])[degree] ** 2 @ weights
            if not abs(square - 1.0) < 1e-2:
                raise ValueError(
                    f"Under the law {marginal} of input {variable} the polynomial of degree {degree} has the mean "
                    f"square {square:.3g} instead of 1: moments of order {2 * degree} do not exist or cannot be "
                    "computed. Lower the degree, or take the moments of getSample()."
                )

    def _share(self, selected, output):
        self._requireMoments()
        coefficients = self._fit.coefficients[:, output] ** 2
        total = coefficients[1:].sum()
        if not total > 0.0:
            raise ValueError(f"Output {output} of the polynomial is constant: it has no Sobol indices.")
        return float(coefficients[selected].sum() / total)

    def getSobolIndex(self, variables: int | Sequence[int], output: int = 0) -> float:
        """Sobol index of one input (int) or the interaction index of several (sequence of int)."""
        inside = np.zeros(self._fit.basis.dimension, dtype=bool)
        inside[np.atleast_1d(variables)] = True
        return self._share(((self._fit.basis.indices > 0) == inside).all(axis=1), output)

    def getTotalSobolIndex(self, variable: int, output: int = 0) -> float:
        """Total Sobol index of one input."""
        return self._share(self._fit.basis.indices[:, variable] > 0, output)

    def getGradientMatrix(self, output: int = 0) -> ot.Matrix:
        """Expected outer product of the polynomial's gradient, E[grad grad^T], :py:class:`openturns.Matrix` (d, d).

        Exact from the coefficients, since the derivative has coefficients in the same orthonormal basis.
        """
        basis = self._fit.basis
        slopes = np.stack(
            [basis.derivative_coefficients(self._fit.coefficients[:, output], j) for j in range(basis.dimension)]
        )
        slopes *= self._reduction.slope[:, None]
        return ot.Matrix(slopes @ slopes.T)

    def save(self, path: str | os.PathLike) -> None:
        """Write the result to one file, whole or not at all: arrays, and the law of the inputs as OpenTURNS' XML.

        What is loaded answers everything as this result does, to the last bit. For the polynomial alone put
        :meth:`getMetaModel` into an :py:class:`openturns.Study`.

        Parameters
        ----------
        path : str or path
            Ends on ``.npz``.
        """
        fields = {"law": self._reduction.law, "centre": self._reduction.centre, "slope": self._reduction.slope}
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
        reduction = _Reduction.of(fields["law"])
        reduction.centre, reduction.slope = fields["centre"], fields["slope"]
        points, values = fields["points"], fields["values"]
        fit = PolynomialFit.of(fields, reduction.apply(points), values)
        return MultivariatePolynomialRegressionResult(fit, points, values, reduction, fields["descriptions"])
