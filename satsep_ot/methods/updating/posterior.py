"""The posterior of standard normals from measurements: Laplace's approximation, importance sampling, Markov chains."""

import dataclasses
import enum
import math

import numpy as np
import openturns as ot
from scipy.special import logsumexp
from scipy.stats import norm, rankdata

from satsep_ot.methods.updating.experiments import MeasurementModel
from satsep_ot.methods.updating.likelihood import ExperimentLikelihood
from satsep_ot.methods.updating.two_level import TwoLevelInputs, normals

MOST_ITERATIONS = 50
MOST_LINEARIZATIONS = 6
STEP_TOLERANCE = 1e-9  # standard deviations
DIFFERENCE = 1e-2  # standard deviations, of differences of a function that is nearly a parabola
HALVINGS = 20
PILOT = 100  # values of the parameters at which true runs tell what the linear models neglect
# Of draws from Laplace's approximation: fewer are not trusted, and Markov chains take their place.
LEAST_EFFECTIVE_SIZE = 400.0
LARGEST_SHARE = 0.1  # of one draw in all weights
FREEDOM = 5  # degrees of freedom of the Student law
CHAINS = 40
LARGEST_RHAT = 1.01
STEPS = 250  # of each chain between two looks at R-hat
MOST_ROUNDS = 8
GOOD_ACCEPTANCE = 0.3


class UpdatingError(ValueError):
    """Measurements that cannot be used; the message says in one sentence which and why.

    Examples
    --------
    >>> from satsep_ot.methods.updating.posterior import UpdatingError
    >>> issubclass(UpdatingError, ValueError)
    True
    """


def resample(weights: np.ndarray, size: int) -> np.ndarray:
    """Indices of so many draws, each as often as its weight says, by systematic resampling from one random number."""
    places = (np.arange(size) + ot.RandomGenerator.Generate()) / size
    return np.minimum(np.searchsorted(np.cumsum(weights), places), len(weights) - 1)


class Method(enum.Enum):
    """What draws of a posterior are of; the value is what people read."""

    LAPLACE = "importance sampling from Laplace's approximation"
    STUDENT = "importance sampling from a Student law about Laplace's approximation"
    CHAINS = "Markov chains"


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Draws of the parameters after the measurements, with what they are worth.

    Attributes
    ----------
    draws : ndarray (N, p)
        Standard normal values of the parameters.
    weights : ndarray (N,)
        Of the draws; their sum is 1.
    mode, covariance : ndarray (p,), (p, p)
        Of Laplace's approximation; exact where all is linear and normal.
    method : Method
        What the draws are of.
    effectiveSize : float
        As many independent draws would be worth the same; of chains, for the worst parameter.
    rhat : float or None
        Largest R-hat of a parameter, of chains: near 1 where they agree.
    converged : bool
    acceptance : float or None
        Share of accepted steps, of chains.
    """

    draws: np.ndarray
    weights: np.ndarray
    mode: np.ndarray
    covariance: np.ndarray
    method: Method
    effectiveSize: float
    rhat: float | None
    converged: bool
    acceptance: float | None

    def moments(self, inputs: TwoLevelInputs) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of each parameter in its unit, ndarray (p,) each.

        The exact moments of Laplace's approximation stand in for those of its draws, so that the result is exact
        where all is linear and normal.
        """
        values = inputs.valuesOf(self.draws)
        centre = inputs.valuesOf(self.mode[None, :])[0]
        step = 1e-6
        shifted = inputs.valuesOf(self.mode + step * np.eye(len(self.mode)))
        slopes = (shifted - centre) / step
        linear = (self.draws - self.mode) @ slopes
        if self.method is not Method.LAPLACE:
            mean = self.weights @ values
            return mean, np.sqrt(self.weights @ (values - mean) ** 2)
        mean = self.weights @ values - linear.mean(axis=0)
        direct = self.weights @ (values - mean) ** 2
        variance = direct - (linear**2).mean(axis=0) + np.einsum("ik,ij,jk->k", slopes, self.covariance, slopes)
        return mean, np.sqrt(np.where(variance > 0.0, variance, direct))

    def resampled(self, size: int) -> np.ndarray:
        """So many draws of equal weight, ndarray (size, p), by systematic resampling."""
        return self.draws[resample(self.weights, size)]


class _Target:
    """The density of the parameters after the measurements, relative to Laplace's approximation."""

    def __init__(self, model: MeasurementModel) -> None:
        self.size = model.parameterNumber
        self._likelihoods = [ExperimentLikelihood(model, experiment) for experiment in model.experiments]
        for likelihood in self._likelihoods:
            if not likelihood.isPossible:
                raise UpdatingError(
                    f"test {likelihood.experiment.name} cannot be computed with all inputs at their means; check its "
                    "conditions"
                )
        self.mode = self._mostLikely()
        precision = -self._derivatives(self.mode)[1]
        values, vectors = np.linalg.eigh(precision)
        # Beforehand each parameter has the variance 1.
        self.root = vectors / np.sqrt(np.maximum(values, 1e-3))
        self.covariance = self.root @ self.root.T
        # What the linear models neglect is noise of theirs from now on.
        for likelihood in self._likelihoods:
            likelihood.logarithms(self.points(normals(PILOT, self.size)), learn=True)

    def _mostLikely(self):
        """The most likely parameters, with the inputs of each experiment that they let expect."""
        mode = np.zeros(self.size)
        for _ in range(MOST_LINEARIZATIONS):
            before, mode = mode, self._maximum(mode)
            for likelihood in self._likelihoods:
                at = likelihood.at
                likelihood.linearize(likelihood.likelyInputs(mode))
                if not likelihood.isPossible:
                    likelihood.linearize(at)
            if np.abs(mode - before).max(initial=0.0) < STEP_TOLERANCE:
                break
        return self._maximum(mode)

    def _maximum(self, point):
        """Newton's method with step halving, from a point (p,)."""
        value = self._normalLogarithm(point[None, :])[0]
        for _ in range(MOST_ITERATIONS):
            slope, curvature = self._derivatives(point)
            values, vectors = np.linalg.eigh(-curvature)
            step = vectors @ ((vectors.T @ slope) / np.maximum(np.abs(values), 1e-3))
            trials = point + 0.5 ** np.arange(HALVINGS)[:, None] * step
            found = self._normalLogarithm(trials)
            better = np.flatnonzero(found > value)
            if not len(better):
                return point
            point, value = trials[better[0]], found[better[0]]
            if np.abs(step).max(initial=0.0) < STEP_TOLERANCE:
                break
        return point

    def _normalLogarithm(self, parameters):
        """Logarithm of the density (N,) as if all that is drawn anew were normal."""
        return sum(one.normalLogarithm(parameters) for one in self._likelihoods) - 0.5 * (parameters**2).sum(axis=1)

    def _derivatives(self, point):
        """Gradient (p,) and Hessian (p, p) of that by central differences, exact where it is a parabola."""
        size = self.size
        steps = DIFFERENCE * np.eye(size)
        first, second = np.triu_indices(size, 1)
        points = np.concatenate([point[None, :], point + steps, point - steps, point + steps[first] + steps[second]])
        values = self._normalLogarithm(points)
        centre, ahead, behind, both = (
            values[0],
            values[1 : 1 + size],
            values[1 + size : 1 + 2 * size],
            values[1 + 2 * size :],
        )
        slope = (ahead - behind) / (2.0 * DIFFERENCE)
        hessian = np.diag((ahead + behind - 2.0 * centre) / DIFFERENCE**2)
        diagonal = np.diag(hessian)
        mixed = (both - centre) / DIFFERENCE**2 - (slope[first] + slope[second]) / DIFFERENCE
        mixed -= 0.5 * (diagonal[first] + diagonal[second])
        hessian[first, second] = hessian[second, first] = mixed
        return slope, hessian

    def points(self, whitened: np.ndarray) -> np.ndarray:
        """Draws of Laplace's approximation (N, p) from standard normals (N, p)."""
        return self.mode + whitened @ self.root.T

    def logWeights(self, whitened: np.ndarray) -> np.ndarray:
        """Estimates of the logarithm of the ratio of the densities, but for a constant, ndarray (N,)."""
        points = self.points(whitened)
        found = 0.5 * (whitened**2).sum(axis=1) - 0.5 * (points**2).sum(axis=1)
        for likelihood in self._likelihoods:
            found = found + likelihood.logarithms(points)
        return found


def samplePosterior(model: MeasurementModel, size: int = 4000) -> Posterior:
    """Draw from the posterior.

    Draws of Laplace's approximation, about the most likely parameters found with exact gradients, are weighted by
    importance sampling. Where their effective size is below 400 or one draw has a tenth of the weight, draws of a
    Student law with the same centre take their place, whose tails are heavier. Where these are no better, Markov chains
    that are reversible with respect to Laplace's approximation (preconditioned Crank-Nicolson, Cotter et al.,
    Statistical Science 2013) go on from there.

    Parameters
    ----------
    model : MeasurementModel
    size : int
        Draws.

    Returns
    -------
    posterior : Posterior

    Raises
    ------
    UpdatingError
        The model cannot be computed where all inputs have their means.
    """
    target = _Target(model)
    for method in (Method.LAPLACE, Method.STUDENT):
        whitened = normals(size, target.size)
        proposed = np.zeros(size)
        if method is Method.STUDENT:
            whitened *= np.sqrt(FREEDOM / (normals(size, FREEDOM) ** 2).sum(axis=1))[:, None]
            squares = (whitened**2).sum(axis=1)
            # What is left of the ratio to the normal density.
            proposed = 0.5 * (FREEDOM + target.size) * np.log1p(squares / FREEDOM) - 0.5 * squares
        logWeights = target.logWeights(whitened) + proposed
        if not np.isfinite(logWeights).any():
            raise UpdatingError("no draw near the most likely parameters can be computed; check the tests' conditions")
        weights = np.exp(logWeights - logsumexp(logWeights))
        effective = 1.0 / float((weights**2).sum())
        if effective >= LEAST_EFFECTIVE_SIZE and weights.max() <= LARGEST_SHARE:
            draws = target.points(whitened)
            return Posterior(draws, weights, target.mode, target.covariance, method, effective, None, True, None)
    return _chains(target, whitened[resample(weights, CHAINS)])


def _chains(target, state):
    """Markov chains from these whitened points (C, n) on, until they agree or have run long enough."""
    logWeights = target.logWeights(state)
    step, kept = 0.5, []
    for rounds in range(MOST_ROUNDS + 1):
        positions, accepted = [], 0
        for number in range(1, STEPS + 1):
            trial = math.sqrt(1.0 - step**2) * state + step * normals(*state.shape)
            found = target.logWeights(trial)
            uniform = np.array(ot.RandomGenerator.Generate(len(state)))
            isTaken = np.log(uniform) < found - logWeights
            state = np.where(isTaken[:, None], trial, state)
            logWeights = np.where(isTaken, found, logWeights)
            accepted += int(isTaken.sum())
            positions.append(np.column_stack([target.points(state), logWeights]))
            if rounds == 0 and number % 10 == 0:
                # The steps are made to fit while nothing is kept.
                step = min(1.0, step * (1.25 if accepted > GOOD_ACCEPTANCE * 10 * len(state) else 0.8))
                accepted = 0
        if rounds == 0:
            continue
        kept.append(np.stack(positions, axis=1))
        chains = np.concatenate(kept, axis=1)
        rhat = max(splitRhat(chains[:, :, k]) for k in range(chains.shape[2]))
        effective = min(effectiveSize(chains[:, :, k]) for k in range(chains.shape[2]))
        converged = rhat <= LARGEST_RHAT and effective >= LEAST_EFFECTIVE_SIZE
        if converged:
            break
    draws = chains[:, :, :-1].reshape(-1, target.size)
    weights = np.full(len(draws), 1.0 / len(draws))
    acceptance = accepted / (STEPS * len(state))
    return Posterior(
        draws, weights, target.mode, target.covariance, Method.CHAINS, effective, rhat, converged, acceptance
    )


def splitRhat(chains: np.ndarray) -> float:
    """Rank-normalised split R-hat (Vehtari et al., Bayesian Analysis 2021) of chains (C, N).

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.updating.posterior import splitRhat
    >>> steady = np.random.default_rng(0).normal(size=(8, 1000))
    >>> splitRhat(steady) < 1.01, splitRhat(steady + np.arange(8)[:, None]) > 1.5
    (True, True)
    """
    half = chains.shape[1] // 2
    ranks = rankdata(chains).reshape(chains.shape)
    scores = norm.ppf((ranks - 0.375) / (chains.size + 0.25))
    halves = np.concatenate([scores[:, :half], scores[:, half : 2 * half]])
    within = halves.var(axis=1, ddof=1).mean()
    between = half * halves.mean(axis=1).var(ddof=1)
    return float(math.sqrt((half - 1.0) / half + between / (half * within))) if within > 0.0 else 1.0


def effectiveSize(chains: np.ndarray) -> float:
    """Independent draws that chains (C, N) are worth for a mean, by Geyer's initial positive sequence.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.updating.posterior import effectiveSize
    >>> 6000 < effectiveSize(np.random.default_rng(0).normal(size=(8, 1000))) <= 8000
    True
    """
    count, length = chains.shape
    centred = chains - chains.mean(axis=1, keepdims=True)
    spectrum = np.fft.rfft(centred, 2 * length)
    covariances = np.fft.irfft(np.abs(spectrum) ** 2, 2 * length)[:, :length].mean(axis=0) / length
    within = covariances[0] * length / (length - 1.0)
    total = within * (length - 1.0) / length + chains.mean(axis=1).var(ddof=1)
    if total <= 0.0:
        return float(count * length)
    correlations = 1.0 - (within - covariances) / total
    pairs = correlations[: length // 2 * 2].reshape(-1, 2).sum(axis=1)
    positive = pairs[: int((pairs < 0.0).argmax()) if (pairs < 0.0).any() else len(pairs)]
    time = max(-1.0 + 2.0 * float(positive.sum()), 1.0 / math.log10(count * length))
    return min(count * length / time, float(count * length))
