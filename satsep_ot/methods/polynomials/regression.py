"""Multivariate polynomial regression with what is needed to judge it, as a native OpenTURNS function."""

import dataclasses
import math

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.common.settings import setting
from satsep_ot.methods.common.units import output_units
from satsep_ot.methods.polynomials.families import PolynomialFamilies
from satsep_ot.methods.polynomials.fit import fit_polynomial, shuffled_folds
from satsep_ot.methods.polynomials.regression_result import MultivariatePolynomialRegressionResult
from satsep_ot.openturns_object import OpenTURNSObject

# Tuning of Huber's estimator for 95 % efficiency under normal noise (Huber 1981).
HUBER_CONSTANT = 1.345
# E[min(z^2, 1.345 |z|)] of a standard normal z: the share of the variance of normal noise that its weights keep.
HUBER_SHARE = math.erf(HUBER_CONSTANT / math.sqrt(2.0))
HUBER_STEPS = 50
HIGHEST_DEGREE = 10


class MultivariatePolynomialRegression(OpenTURNSObject):
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
                f"The samples have shapes {self._points.shape} and {self._values.shape}; "
                "they must be (N, d) and (N, p)."
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
        self._degree = int(setting("MultivariatePolynomialRegression-Degree"))
        self._norm = float(setting("MultivariatePolynomialRegression-HyperbolicNorm"))
        self._weights: np.ndarray | None = None
        self._robust = False
        self._result: MultivariatePolynomialRegressionResult | None = None

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

    def _shown(self):
        return {
            "size": len(self._points),
            "inputs": self._points.shape[1],
            "outputs": self._values.shape[1],
            "degree": self._degree,
        }

    def setDegree(self, degree: int) -> None:
        """Highest total degree, 0 to 10 (default 4)."""
        if int(degree) != degree or not 0 <= degree <= HIGHEST_DEGREE:
            raise ValueError(f"The degree is {degree}; it must be an integer from 0 to {HIGHEST_DEGREE}.")
        self._degree = int(degree)

    def getDegree(self) -> int:
        """Highest total degree."""
        return self._degree

    def setHyperbolicNorm(self, norm: float) -> None:
        """Norm q of the index set, in (0, 1]: 1 (default) is the total degree, less drops interactions."""
        if not 0.0 < norm <= 1.0:
            raise ValueError(f"The norm of the index set is {norm}; it must be in (0, 1].")
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

        The noise variance and the intervals assume normal noise with outliers in it: they are right without
        outliers, and too wide rather than too narrow with them.
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
            raise ValueError(f"The highest degree is {highest}; it must be a whole number from 0 to {HIGHEST_DEGREE}.")
        if int(folds) != folds or folds < 2:
            raise ValueError(f"The number of folds is {folds}; it must be a whole number of at least 2.")
        blocks = shuffled_folds(len(self._points), folds)
        units = output_units(self._values)
        spread = (self._values / units).var(axis=0)
        spread[spread == 0.0] = 1.0
        errors = {}
        families = PolynomialFamilies.of(self._law())
        standardised = families.standardise(self._points)
        for degree in range(highest + 1):
            basis = families.basis(degree, self._norm)
            if 2 * basis.size > len(self._points):
                break
            try:
                fit = self._fit(basis, standardised)
            except ValueError:
                break
            squared = ((fit.k_fold(blocks) / units) ** 2 / spread).mean(axis=1)
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

    def _fit(self, basis, standardised):
        fit = fit_polynomial(basis, standardised, self._values, self._weights)
        if not self._robust:
            return fit
        base = np.ones(len(standardised)) if self._weights is None else self._weights
        for _ in range(HUBER_STEPS):
            error = np.abs(fit.residuals[:, 0])
            # Median absolute residual as the scale, consistent for normal noise.
            scale = np.median(error) / 0.6744897501960817
            if scale == 0.0:
                return fit
            weights = base * np.minimum(1.0, HUBER_CONSTANT * scale / np.maximum(error, np.finfo(float).tiny))
            previous = fit.coefficients
            fit = dataclasses.replace(
                fit_polynomial(basis, standardised, self._values, weights), residual_share=HUBER_SHARE
            )
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
        families = PolynomialFamilies.of(self._law())
        fit = self._fit(families.basis(self._degree, self._norm), families.standardise(self._points))
        self._result = MultivariatePolynomialRegressionResult(
            fit, self._points, self._values, families, self._descriptions
        )

    def getResult(self) -> MultivariatePolynomialRegressionResult:
        """The :class:`MultivariatePolynomialRegressionResult` of the last run."""
        if self._result is None:
            raise RuntimeError("There is no result yet: call run() first.")
        return self._result
