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
from satsep_ot.methods.reliability.gaussian_process import GaussianProcess, chooseRows
from satsep_ot.methods.reliability.links import Identity, Link, candidateLinks
from satsep_ot.methods.subspaces.variable_projection import fit_ridge
from satsep_ot.methods.subspaces.variables import activeTransformation

# An error is never taken to be smaller than this share of a component's own spread: a polynomial that passes through
# the data is not known to be the truth elsewhere.
_SMALLEST_ERROR = 0.003
# The search for a subspace need not be more exact than the runs let it be: it is continued after the next block.
_SEARCH_STEPS = 6
_SEARCH_TOLERANCE = 1e-3
# A larger model must lower the estimated squared error of prediction by this factor to be preferred.
_PARSIMONY = 0.9
# Up to so many inputs a Gaussian process takes them all; it must raise the mean log density by this to be preferred.
FEW_INPUTS, _LEAST_GAIN = 10, 0.1
# Standardised errors beyond this count as this in a score.
_LARGEST_DEVIATION = 7.0
# Times that its coordinates are turned at first; later each time that models are chosen.
_TURNS = 2
# Points of each step of a search, and growth of the pool, where a process is slow to predict.
_PROCESS_POINTS, _PROCESS_POOL_FACTOR = 2500, 4.0
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
class RidgeFit:
    """A component's polynomial ridge: orthonormal directions (d, r), polynomial, and its estimated error."""

    model: RidgeModel
    directions: np.ndarray
    polynomial: PolynomialFit
    error: float
    least: float = 0.0

    def variables(self, active: np.ndarray, radius: np.ndarray | None) -> np.ndarray:
        """The polynomial's variables from active ones (n, r) and normalised inactive radii (n,)."""
        if self.model.radial:
            assert radius is not None, "a radial model has a radius"
            active = np.column_stack([active, radius])
        return active if active.shape[1] else np.zeros((len(active), 1))

    def predict(self, x: np.ndarray) -> np.ndarray:
        """Values (n,) at the variables."""
        return self.polynomial.predict(x)

    def predictBoth(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and standard deviations of their errors, each (n,): larger where a polynomial extrapolates."""
        error = max(self.error, self.least) * np.sqrt(1.0 + self.polynomial.relative_variance(x))
        return self.predict(x), error

    def refit(self, u: np.ndarray, column: np.ndarray, weights: np.ndarray) -> "RidgeFit":
        """The same model of other points."""
        initial = self.directions if self.model.degree > 1 and self.model.dimension else None
        return _fitModel(u, column, weights, dataclasses.replace(self.model, radial=False), initial)

    def score(self, weights: np.ndarray) -> float:
        """Mean logarithm of the density of prediction, but for a constant."""
        return -math.log(max(self.error, self.least, 1e-300)) - 0.5


class ProcessFit:
    """A component's Gaussian process of all inputs, through a link, in coordinates along its own active directions.

    A kernel with one length for each coordinate follows a function that varies along few directions only where these
    are coordinates.

    Parameters
    ----------
    u : array (n, d)
    column : array (n,)
    link : Link
    rotation : array (d, d)
        Orthogonal; its columns are the coordinates' directions.
    start : array, optional
        Hyper-parameters that the search starts from.
    search : bool
        Whether to look for hyper-parameters; else those of the start are kept.
    """

    def __init__(
        self,
        u: np.ndarray,
        column: np.ndarray,
        link: Link,
        rotation: np.ndarray,
        start: np.ndarray | None = None,
        search: bool = True,
    ) -> None:
        self.link, self.rotation = link, rotation
        self.model = RidgeModel(u.shape[1], 0)
        self.directions = np.eye(u.shape[1])
        values = link.forward(column)
        self._rows = chooseRows(values)
        self.process: GaussianProcess = GaussianProcess(u[self._rows] @ rotation, values[self._rows], start, search)
        self._logSlope = link.logSlope(column[self._rows])

    def variables(self, active: np.ndarray, radius: np.ndarray | None) -> np.ndarray:
        """The coordinates."""
        return active @ self.rotation

    def predict(self, x: np.ndarray) -> np.ndarray:
        """Linked values (n,) at the variables."""
        return self.process.predictMean(x)

    def predictBoth(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Linked values and standard deviations of their errors, each (n,)."""
        return self.process.predict(x)

    def refit(self, u: np.ndarray, column: np.ndarray, weights: np.ndarray) -> "ProcessFit":
        """The same link, coordinates and hyper-parameters with other points."""
        return ProcessFit(u, column, self.link, self.rotation, self.process.hyper, search=False)

    def turned(self, u: np.ndarray, column: np.ndarray, weights: np.ndarray) -> "ProcessFit":
        """A process of the same points in the coordinates of this one's active subspace.

        Constantine, Dow and Wang, SIAM Journal on Scientific Computing 36, 2014, with the gradients of the mean.
        """
        slopes = self.process.gradients(u[self._rows] @ self.rotation) @ self.rotation.T
        _, directions = np.linalg.eigh((slopes * weights[self._rows, None]).T @ slopes)
        return ProcessFit(u, column, self.link, directions[:, ::-1])

    def score(self, weights: np.ndarray) -> float:
        """Weighted mean logarithm of the density of each value by the others, but for a constant."""
        errors, deviations = self.process.leaveOneOut()
        logs = (
            -np.log(deviations)
            - 0.5 * np.minimum(np.abs(errors / deviations), _LARGEST_DEVIATION) ** 2
            + self._logSlope
        )
        return float(np.average(logs, weights=weights[self._rows]))


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
    reselect : bool
        Whether to choose the models anew; else those of the previous surrogate are fitted.
    maximumDimension, maximumDegree : int
        Limits of the choice.

    Attributes
    ----------
    searchPoints, largestPoolFactor : int, float
        Points of each step of a search for the failure region, and by how much the pool of points may grow.
    knownFailures : array (n, d) or None
        Where failures are expected before a search.
    """

    searchPoints, largestPoolFactor = 8000, 20.0
    knownFailures: np.ndarray | None = None

    def __init__(
        self,
        u: np.ndarray,
        values: np.ndarray,
        margin: Callable,
        weights: np.ndarray,
        previous: "LimitStateSurrogate | None" = None,
        reselect: bool = True,
        maximumDimension: int = 3,
        maximumDegree: int = 4,
    ) -> None:
        self._training = u, values, weights
        self._limit = self.margin = margin
        # Of a single component the limit state itself is fitted where a link may be learnt.
        self._single = values.shape[1] == 1
        self.inputs = u.shape[1]
        self.link: Link | None = None
        self.components: list[RidgeFit | ProcessFit] = []
        earlier = [None] * values.shape[1] if previous is None else previous.components
        for column, old in zip(values.T, earlier, strict=True):
            # The weights, or a mode's share, may have left too few runs for a model of the earlier size.
            if reselect or old is None or old.model.parameters(self.inputs) > 0.75 * len(u):
                self.components.append(self._choose(column, old, maximumDimension, maximumDegree))
            else:
                self.components.append(old.refit(u, self._processed(column, old), weights))
        if self._single and isinstance(self.components[0], ProcessFit):
            self.link = self.components[0].link
            self.margin = _first
        self.directions = _union([fit.directions for fit in self.components], self.inputs)
        # The inactive radius belongs to the complement of all active directions, so it comes second.
        self.radial = False
        if self.directions.shape[1] < self.inputs:
            radius = normalisedRadius(u, self.directions)
            self.components = [
                _withRadius(u, column, weights, fit, radius)
                for fit, column in zip(self.components, values.T, strict=True)
            ]
            self.radial = any(fit.model.radial for fit in self.components)
        self._rotations = [self.directions.T @ fit.directions for fit in self.components]
        self.calibration = np.ones(values.shape[1])
        if any(isinstance(fit, ProcessFit) for fit in self.components):
            self.searchPoints, self.largestPoolFactor = _PROCESS_POINTS, _PROCESS_POOL_FACTOR

    def _processed(self, column, fit=None):
        """What a Gaussian process of a component is fitted to: of a single one the limit state itself."""
        _, values, _ = self._training
        return self._limit(values) if self._single and not isinstance(fit, RidgeFit) else column

    def _choose(self, column, old, maximumDimension, maximumDegree):
        """The polynomial ridge or, of few inputs, the Gaussian process that predicts best."""
        u, _, weights = self._training
        ridge = old if isinstance(old, RidgeFit) else None
        best = _selectModel(u, column, weights, ridge, maximumDimension, maximumDegree)
        if self.inputs > FEW_INPUTS or best.error <= _smallestError(column):
            return best
        processed = self._processed(column)
        process = self._chooseProcess(processed, old, self._single)
        better = self._score(process, processed) > self._score(best, column) + _LEAST_GAIN
        return process if better else best

    def _chooseProcess(self, column, old, single):
        """The Gaussian process that predicts best: its link, and its coordinates."""
        u, _, weights = self._training
        earlier = old if isinstance(old, ProcessFit) else None
        rotation = np.eye(self.inputs) if earlier is None else earlier.rotation
        candidates = []
        for link in candidateLinks(column) if single else [Identity()]:
            same = earlier is not None and type(earlier.link) is type(link)
            candidates.append(ProcessFit(u, column, link, rotation, earlier.process.hyper if same else None))
        scores = [self._score(process, column) for process in candidates]
        best, highest = candidates[int(np.argmax(scores))], max(scores)
        for _ in range(_TURNS if earlier is None else 1):
            turned = best.turned(u, column, weights)
            score = self._score(turned, column)
            if score <= highest:
                break
            best, highest = turned, score
        return best

    def _score(self, fit, column):
        """Mean log density of predictions: of each run by the others, and three times that of the latest quarter.

        The latest runs were chosen by earlier fits, where a fit that only follows its runs is wrong first.
        """
        u, _, weights = self._training
        number = min(max(len(u) // 4, 8), 60)
        fewest = max(1.2 * (self.inputs + 2), fit.model.parameters(self.inputs))
        if len(u) < 3 * number or len(u) - number < fewest:
            return fit.score(weights)
        early, late = slice(None, -number), slice(-number, None)
        tested = fit.refit(u[early], column[early], weights[early])
        x = tested.variables(u[late] @ tested.directions, None)
        mean, deviation = tested.predictBoth(x)
        link = tested.link if isinstance(tested, ProcessFit) else Identity()
        values = link.forward(column[late])
        # The earlier runs may all have been alike.
        deviation = np.maximum(deviation, 1e-9 * max(float(np.abs(values).max()), 1e-290))
        standard = (values - mean) / deviation
        logs = (
            link.logSlope(column[late])
            - np.log(deviation)
            - 0.5 * np.minimum(np.abs(standard), _LARGEST_DEVIATION) ** 2
        )
        return 0.25 * fit.score(weights) + 0.75 * float(np.average(logs, weights=weights[late]))

    def score(self) -> float:
        """Mean logarithm of the density of prediction of a single component, but for a constant."""
        _, values, _ = self._training
        fit = self.components[0]
        return self._score(fit, self._processed(values[:, 0], fit))

    def targets(self, values: np.ndarray) -> np.ndarray:
        """What `predict` predicts (n, p) where the components have these values (n, p)."""
        return values if self.link is None else self.link.forward(self._limit(values))[:, None]

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
        return np.column_stack([fit.predict(x) for fit, x in zip(self.components, self._variables(y), strict=True)])

    def predictionErrors(self, y: np.ndarray) -> np.ndarray:
        """Standard deviations (n, p) of the errors of the components: larger where a polynomial extrapolates."""
        return self.predictBoth(y)[1]

    def predictBoth(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Components and the standard deviations of their errors, each (n, p), at variables of the surrogate (n, k)."""
        both = [fit.predictBoth(x) for fit, x in zip(self.components, self._variables(y), strict=True)]
        values, errors = zip(*both, strict=True)
        return np.column_stack(values), self.calibration * np.column_stack(errors)

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
        if exact or len(y) <= _NEAREST:
            values, errors = self.predictBoth(y)
            value, rows = self.margin(values), np.arange(len(y))
        else:
            values = self.predict(y)
            value = self.margin(values)
            rows = np.argpartition(np.abs(value), _NEAREST)[:_NEAREST]
            errors = self.predictionErrors(y[rows])
        squares = np.zeros(len(rows))
        for j, error in enumerate(errors.T):
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
        part.calibration = self.calibration[group]
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
            if isinstance(fit, ProcessFit):
                raise ValueError("the surrogate is a Gaussian process, for which there is no native function")
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


def _first(values):
    return values[:, 0]


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
    error = _predictionError(polynomial, weights, model.parameters(u.shape[1]))
    spread = math.sqrt(np.average((column - np.average(column, weights=weights)) ** 2, weights=weights))
    return RidgeFit(model, directions, polynomial, error, _SMALLEST_ERROR * spread)


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
            if model.parameters(d) > 0.9 * effective or best.error <= floor:
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
    if isinstance(fit, ProcessFit) or fit.error <= _smallestError(column) or fit.directions.shape[1] == u.shape[1]:
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
            best = RidgeFit(model, fit.directions, polynomial, error, fit.least)
    return best


def _union(directions, inputs):
    """Orthonormal basis of the sum of the subspaces."""
    stacked = np.hstack(directions)
    if stacked.shape[1] == 0:
        return stacked
    left, singular, _ = np.linalg.svd(stacked, full_matrices=False)
    return left[:, singular > 1e-8 * singular[0]][:, :inputs]
