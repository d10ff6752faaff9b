"""Surrogate of a limit state: polynomial ridges of smooth components, composed, with the size of their errors.

All in the standard normal space. The probability of failure at a point follows from normal errors around the
predictions of the components, carried through the composition by differences of one error's size.
"""

import copy
import dataclasses
import math
from collections.abc import Callable

import numpy as np
import openturns as ot
from scipy.sparse.csgraph import connected_components
from scipy.special import ndtr, ndtri
from scipy.stats import chi2

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.polynomials.basis import PolynomialBasis, number_of_terms
from satsep_ot.methods.polynomials.fit import PolynomialFit, fit_polynomial
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspaces.variable_projection import fit_ridge
from satsep_ot.methods.subspaces.variables import activeTransformation

# An error is never taken to be smaller than this share of a component's own spread: a polynomial that passes through
# the data is not known to be the truth elsewhere.
_SMALLEST_ERROR = 0.01
# The search for a subspace need not be more exact than the runs let it be: it is continued after the next block.
_SEARCH_STEPS = 6
_SEARCH_TOLERANCE = 1e-3
# A larger model must lower the estimated squared error of prediction by this factor to be preferred.
_PARSIMONY = 0.9
# A search over many points knows the size of the error from so many that are nearest to the limit.
_NEAREST = 500
# Points, so many times as far out as the runs, that tell which components fail together.
_PROBES, _PROBE_SPREAD = 2000, 3.0


@dataclasses.dataclass(frozen=True)
class RidgeModel:
    """Which polynomial ridge a component gets: number of directions, total degree, and the inactive radius or not."""

    dimension: int
    degree: int
    radial: bool = False

    def parameters(self, inputs: int) -> int:
        """Number of free parameters, with the parameters of the subspace."""
        r = self.dimension
        variables = r + int(self.radial)
        terms = number_of_terms(variables, self.degree) if variables else 1
        return terms + r * (inputs - r)


@dataclasses.dataclass
class ComponentFit:
    """A component's ridge: orthonormal directions (d, r), polynomial, and its estimated error of prediction."""

    model: RidgeModel
    directions: np.ndarray
    polynomial: PolynomialFit
    error: float

    def variables(self, active: np.ndarray, radius: np.ndarray | None) -> np.ndarray:
        """The polynomial's variables from active ones (n, r) and normalised inactive radii (n,)."""
        if self.model.radial:
            assert radius is not None, "a radial model has a radius"
            active = np.column_stack([active, radius])
        return active if active.shape[1] else np.zeros((len(active), 1))


def normalisedRadius(u: np.ndarray, directions: np.ndarray) -> np.ndarray:
    """The distance from the span of the directions (d, k), mapped to a standard normal variable: (n,)."""
    freedom = u.shape[1] - directions.shape[1]
    squared = (u**2).sum(axis=1) - ((u @ directions) ** 2).sum(axis=1)
    # Each tail through the function that does not round it to 0 or 1.
    lower, upper = chi2.cdf(squared, freedom), chi2.sf(squared, freedom)
    return np.where(lower < upper, ndtri(np.maximum(lower, 1e-300)), -ndtri(np.maximum(upper, 1e-300)))


def radiusFromNormal(t: np.ndarray, freedom: int) -> np.ndarray:
    """The inverse of `normalisedRadius`: distances for standard normal t."""
    return np.sqrt(np.where(t < 0.0, chi2.ppf(ndtr(t), freedom), chi2.isf(ndtr(-t), freedom)))


class LimitStateSurrogate:
    """Surrogate of a composed limit state.

    Parameters
    ----------
    u : array (n, d)
        Points in standard space.
    values : array (n, p)
        Smooth components there.
    margin : callable
        Maps component values (m, p) on limit state values (m,), at most 0 in failure.
    weights : array (n,)
        Weights of the fits.
    previous : LimitStateSurrogate, optional
        Its subspaces are the start of this fit.
    maximumDimension, maximumDegree : int
        Limits of the choice.
    """

    def __init__(
        self,
        u: np.ndarray,
        values: np.ndarray,
        margin: Callable,
        weights: np.ndarray,
        previous: "LimitStateSurrogate | None" = None,
        maximumDimension: int = 3,
        maximumDegree: int = 4,
    ) -> None:
        self.margin = margin
        self._training = u, values, weights
        self.inputs = u.shape[1]
        fits = []
        for index, column in enumerate(values.T):
            old = None if previous is None else previous.components[index]
            fits.append(_selectModel(u, column, weights, old, maximumDimension, maximumDegree))
        self.directions = _union([fit.directions for fit in fits], self.inputs)
        # The inactive radius belongs to the complement of all active directions, so it comes second.
        self.radial = False
        if self.directions.shape[1] < self.inputs:
            radius = normalisedRadius(u, self.directions)
            fits = [_withRadius(u, column, weights, fit, radius) for fit, column in zip(fits, values.T, strict=True)]
            self.radial = any(fit.model.radial for fit in fits)
        self.components: list[ComponentFit] = fits
        self._rotations = [self.directions.T @ fit.directions for fit in fits]
        spread = values.std(axis=0)
        self.errors = np.maximum([fit.error for fit in fits], _SMALLEST_ERROR * spread)

    def dimension(self) -> int:
        """Number of variables that the surrogate depends on: active directions, and the inactive radius if used."""
        return self.directions.shape[1] + int(self.radial)

    def reduce(self, u: np.ndarray) -> np.ndarray:
        """Points of standard space (n, d) to the variables of the surrogate (n, k)."""
        active = u @ self.directions
        return np.column_stack([active, normalisedRadius(u, self.directions)]) if self.radial else active

    def expand(self, y: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        """Random points (n, d) of standard space given the variables of the surrogate (n, k)."""
        k = self.directions.shape[1]
        noise = generator.standard_normal((len(y), self.inputs))
        noise -= (noise @ self.directions) @ self.directions.T
        if self.radial:
            radius = radiusFromNormal(y[:, k], self.inputs - k)
            noise *= (radius / np.linalg.norm(noise, axis=1))[:, None]
        return y[:, :k] @ self.directions.T + noise

    def predict(self, y: np.ndarray) -> np.ndarray:
        """Components (n, p) at variables of the surrogate (n, k)."""
        return np.column_stack(
            [fit.polynomial.predict(x) for fit, x in zip(self.components, self._variables(y), strict=True)]
        )

    def predictionErrors(self, y: np.ndarray) -> np.ndarray:
        """Standard deviations (n, p) of the errors of the components: larger where a polynomial extrapolates."""
        variances = [
            fit.polynomial.relative_variance(x) for fit, x in zip(self.components, self._variables(y), strict=True)
        ]
        return self.errors * np.sqrt(1.0 + np.column_stack(variances))

    def _variables(self, y):
        k = self.directions.shape[1]
        radius = y[:, k] if self.radial else None
        return [fit.variables(y[:, :k] @ a, radius) for fit, a in zip(self.components, self._rotations, strict=True)]

    def limitState(self, y: np.ndarray, exact: bool = True) -> tuple[np.ndarray, np.ndarray]:
        """Predicted limit state and the standard deviation of its error, each (n,).

        Parameters
        ----------
        y : array (n, k)
        exact : bool
            False: all points get the median deviation of the points that are nearest to the limit.
        """
        values = self.predict(y)
        value = self.margin(values)
        rows = np.arange(len(y))
        if not exact and len(y) > _NEAREST:
            rows = np.argpartition(np.abs(value), _NEAREST)[:_NEAREST]
        squares = np.zeros(len(rows))
        for j, error in enumerate(self.predictionErrors(y[rows]).T):
            shifted = values[rows]
            shifted[:, j] += error
            squares += (self.margin(shifted) - value[rows]) ** 2
        scale = np.sqrt(squares)
        if len(rows) < len(y):
            scale = np.full(len(y), np.median(scale))
        # A composition that is flat here would give 0: the composed value is then certain to rounding.
        return value, np.maximum(scale, 1e-12 * max(float(np.abs(value).max()), 1e-300))

    def groups(self, generator: np.random.Generator) -> list[list[int]]:
        """Components that fail together, such as the two parts of a norm; a series system has one group a mode.

        Where a point far out is safe again as soon as any one of several components takes its typical value, these
        belong together. None where components spread so wide do not fail.
        """
        _, values, _ = self._training
        typical, spread = np.median(values, axis=0), values.std(axis=0)
        points = typical + _PROBE_SPREAD * spread * generator.standard_normal((_PROBES, len(spread)))
        points = points[self.margin(points) <= 0.0]
        if len(points) == 0:
            return []
        needed = np.zeros((len(points), len(spread)), dtype=bool)
        for j, value in enumerate(typical):
            replaced = points.copy()
            replaced[:, j] = value
            needed[:, j] = self.margin(replaced) > 0.0
        together = (needed.T.astype(float) @ needed) > 0.0
        number, label = connected_components(together)
        return [np.flatnonzero(label == k).tolist() for k in range(number) if together[label == k].any()]

    def restricted(self, group: list[int]) -> "LimitStateSurrogate":
        """The surrogate of some components alone, the others at their typical values."""
        _, values, _ = self._training
        typical = np.median(values, axis=0)

        def margin(reduced):
            complete = np.repeat(typical[None], len(reduced), axis=0)
            complete[:, group] = reduced
            return self.margin(complete)

        part = copy.copy(self)
        part.margin = margin
        part.components = [self.components[j] for j in group]
        part.errors = self.errors[group]
        part.directions = _union([fit.directions for fit in part.components], self.inputs)
        part._rotations = [part.directions.T @ fit.directions for fit in part.components]
        return part

    def nativeFunction(self, space: StandardSpace) -> ot.Function:
        """The components as functions of the physical inputs, native to OpenTURNS, with exact derivatives."""
        if self.radial:
            raise ValueError("the surrogate depends on the inactive radius, for which there is no native function")
        u, values, weights = self._training
        functions = []
        for fit, column in zip(self.components, values.T, strict=True):
            if fit.model.dimension == 0:
                constant = [float(fit.polynomial.coefficients[0])]
                functions.append(ot.LinearFunction([0.0] * self.inputs, constant, ot.Matrix(1, self.inputs)))
                continue
            active = ot.Sample(u @ fit.directions)
            regression = MultivariatePolynomialRegression(
                active, ot.Sample(column[:, None]), ot.Normal(fit.model.dimension)
            )
            regression.setDegree(fit.model.degree)
            regression.setWeights(weights)
            regression.run()
            transformation = activeTransformation(space, fit.directions)
            functions.append(ot.ComposedFunction(regression.getResult().getMetaModel(), transformation))
        return ot.AggregatedFunction(functions)


def _basisFit(variables, column, weights, degree):
    if variables.shape[1] == 0:
        return fit_polynomial(PolynomialBasis(1, 0), np.zeros((len(column), 1)), column, weights)
    return fit_polynomial(PolynomialBasis(variables.shape[1], degree), variables, column, weights, allow_deficient=True)


def _predictionError(polynomial, weights, parameters):
    """Root mean square error of prediction by generalised cross-validation (Golub, Heath and Wahba, 1979), where the
    parameters of the subspace count."""
    effective = weights.sum() ** 2 / (weights**2).sum()
    slack = 1.0 - parameters / effective
    if slack <= 0.05:
        return math.inf
    return math.sqrt(np.average(polynomial.residuals**2, weights=weights)) / slack


def _smallestError(column):
    """An error that needs no larger model: below the smallest that is believed, or the rounding of a constant."""
    return max(0.5 * _SMALLEST_ERROR * float(column.std()), 1e-14 * float(np.abs(column).max()))


def _fitModel(u, column, weights, model, initial):
    directions = np.zeros((u.shape[1], 0))
    if model.degree == 1:
        # The one direction of a linear ridge is a linear regression's.
        linear = fit_polynomial(PolynomialBasis(u.shape[1], 1), u, column, weights, allow_deficient=True)
        directions = linear.coefficients[1:, None] / max(np.linalg.norm(linear.coefficients[1:]), 1e-300)
    elif model.dimension:
        directions = fit_ridge(
            u, column, model.dimension, model.degree, weights, 1, initial, _SEARCH_STEPS, _SEARCH_TOLERANCE
        ).directions
    polynomial = _basisFit(u @ directions, column, weights, model.degree)
    return ComponentFit(
        model, directions, polynomial, _predictionError(polynomial, weights, model.parameters(u.shape[1]))
    )


def _selectModel(u, column, weights, old, maximumDimension, maximumDegree):
    """The ridge with the smallest estimated error of prediction; a larger one must be clearly better."""
    d = u.shape[1]
    effective = weights.sum() ** 2 / (weights**2).sum()
    best = _fitModel(u, column, weights, RidgeModel(0, 0), None)
    # The best of each number of directions: with the inactive radius, fewer of them may do.
    ladder = [best]
    floor = _smallestError(column)
    # What the earlier surrogate has outgrown by more than one step need not be tried again.
    fewest = max(1, 0 if old is None else old.model.dimension - 1)
    lowest = max(1, 0 if old is None else old.model.degree - 1)
    for dimension in range(fewest, min(maximumDimension, d) + 1):
        improved, lower = False, None
        for degree in range(max(lowest, min(dimension, 2)), maximumDegree + 1):
            model = RidgeModel(dimension, degree)
            if model.parameters(d) > 0.75 * effective or best.error <= floor:
                break
            # A search starts where the one of a lower degree, or the earlier surrogate, has ended; but a linear fit
            # knows nothing of an even function.
            initial = None
            if lower is not None and degree > 2:
                initial = lower.directions
            elif old is not None and old.model.dimension >= dimension and old.model.degree > 1:
                initial = old.directions[:, :dimension]
            lower = fit = _fitModel(u, column, weights, model, initial)
            if fit.error < math.sqrt(_PARSIMONY) * best.error:
                best, improved = fit, True
        if improved:
            ladder.append(best)
        # A second direction may show where the first one does not (an even function), a third one after both.
        elif dimension > fewest:
            break
    if len(ladder) == 1 and fewest + lowest > 2:
        # The weights leave too few runs for a model of the earlier size.
        return _selectModel(u, column, weights, None, maximumDimension, maximumDegree)
    if best.error <= floor:
        return best
    errors = [_withRadius(u, column, weights, fit).error for fit in ladder]
    chosen = 0
    for index, error in enumerate(errors):
        if error < math.sqrt(_PARSIMONY) * errors[chosen] and errors[chosen] > floor:
            chosen = index
    return ladder[chosen]


def _withRadius(u, column, weights, fit, radius=None):
    """The same subspace with the inactive radius as one more variable, where that predicts clearly better."""
    best = fit
    if fit.error <= _smallestError(column) or fit.directions.shape[1] == u.shape[1]:
        return fit
    if radius is None:
        radius = normalisedRadius(u, fit.directions)
    for degree in (2, 4):
        model = RidgeModel(fit.model.dimension, max(degree, min(fit.model.degree, 4)), True)
        if model.parameters(u.shape[1]) > 0.75 * len(column):
            continue
        polynomial = _basisFit(np.column_stack([u @ fit.directions, radius]), column, weights, model.degree)
        error = _predictionError(polynomial, weights, model.parameters(u.shape[1]))
        if error < math.sqrt(_PARSIMONY) * best.error:
            best = ComponentFit(model, fit.directions, polynomial, error)
    return best


def _union(directions, inputs):
    """Orthonormal basis of the sum of the subspaces."""
    stacked = np.hstack(directions)
    if stacked.shape[1] == 0:
        return stacked
    left, singular, _ = np.linalg.svd(stacked, full_matrices=False)
    return left[:, singular > 1e-8 * singular[0]][:, :inputs]
