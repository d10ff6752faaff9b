"""The probability of failure in what scatters, as a distribution over what is not known."""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import ndtr

from satsep_ot.methods.updating.experiments import Model
from satsep_ot.methods.updating.posterior import resample
from satsep_ot.methods.updating.two_level import TwoLevelInputs, normals

POINTS = 8192  # of what is drawn anew, which all values of the parameters share in the linear model
CENTRES = 24  # of the sampling density, for each limit, from so many values of the parameters:
REFERENCES = 8
SEARCH = 20_000  # points of the search for failures of the linear model
SEARCH_SPREADS = (2.5, 5.0)
NOMINAL_SHARE = 0.3  # of the points
RUNS = 12  # true runs for each value of the parameters and each limit, and for each limit in all:
LEAST_RUNS = 2000
WIDTH_RUNS = 200  # that tell how far the linear model is off
SMALLEST_SINGULAR_VALUE = 1e-3  # of the linear model, relative
LEAST_CHANCE = 1e-3  # that the true runs reckon with where the linear model sees no failure
DEFENSIVE_SHARE = 0.1  # of the true runs: where the linear model sees no failure


@dataclasses.dataclass(frozen=True)
class Limit:
    """A limit on outputs of a model.

    Attributes
    ----------
    name : str
    margin : callable
        From outputs (N, q) to margins (N,), negative where the limit is violated.
    smoothMargin : callable
        The same from the outputs of a linear model: uses only outputs that are smooth.
    allowed : float or None
        Largest probability that is accepted.
    """

    name: str
    margin: Callable[[np.ndarray], np.ndarray]
    smoothMargin: Callable[[np.ndarray], np.ndarray]
    allowed: float | None = None


class FailureProbabilities:
    """P(limit violated | parameters) for many values of the parameters.

    For each value a linear model of the outputs gives the probability by 8192 points of a sampling density that is
    centred on its failures; true runs at some of the points correct it, so that the result is unbiased whatever the
    linear model is worth.

    Parameters
    ----------
    inputs : :class:`~satsep_ot.methods.updating.two_level.TwoLevelInputs`
    model : Model
        Under the conditions of interest; NaN counts as a violation of every limit.
    limits : sequence of Limit
    """

    def __init__(self, inputs: TwoLevelInputs, model: Model, limits: Sequence[Limit]) -> None:
        self._inputs, self._model, self._limits = inputs, model, list(limits)
        self._size = len(inputs.getAnew())
        self.evaluations = 0

    def compute(self, parameters: np.ndarray) -> np.ndarray:
        """The probabilities.

        Parameters
        ----------
        parameters : ndarray (N, p)
            Standard normal values.

        Returns
        -------
        probabilities : ndarray (N, L)
            Of each limit; estimates with an error of some per cent each.
        """
        count = len(parameters)
        centre = parameters.mean(axis=0)
        quiet = np.zeros((1, self._size))
        at = self._inputs.toPhysical(parameters, np.repeat(quiet, count, axis=0))
        nominal = self._evaluate(at)
        slopes = self._model.computeGradientSample(self._inputs.toPhysical(centre[None, :], quiet))[0]
        if not np.isfinite(nominal).all():
            nominal = np.where(np.isfinite(nominal), nominal, np.nanmean(nominal, axis=0))
        shifts = self._centres(parameters, nominal, slopes)
        points, weights = self._points(shifts)
        moved = self._inputs.deviations(points)
        factors = self._inputs.sigmaFactors(parameters)
        widths = self._widths(parameters, nominal, slopes)
        runs = max(RUNS, LEAST_RUNS // count) if self._size else 1
        found = np.empty((count, len(self._limits)))
        picked, linear, shares = [], [], []
        # Where no sigma is uncertain the deviations are the same for all parameters.
        common = (moved * factors[0]) @ slopes if np.ptp(factors, axis=0).max(initial=0.0) == 0.0 else None
        for i in range(count):
            outputs = nominal[i] + (common if common is not None else (moved * factors[i]) @ slopes)
            for j, limit in enumerate(self._limits):
                chance = ndtr(-limit.smoothMargin(outputs) / widths[j])
                found[i, j] = weights @ chance
                rows, share = _pick(weights, chance, runs)
                picked.append(rows)
                linear.append(chance[rows])
                shares.append(weights[rows] / share)
        rows = np.concatenate(picked)
        owner = np.repeat(np.arange(count), len(self._limits) * runs)
        outputs = self._evaluate(self._inputs.toPhysical(parameters[owner], points[rows]))
        outputs = outputs.reshape(count, len(self._limits), runs, -1)
        for j, limit in enumerate(self._limits):
            some = outputs[:, j].reshape(count * runs, -1)
            failed = violated(limit, some).reshape(count, runs)
            chance = np.array(linear).reshape(count, len(self._limits), runs)[:, j]
            share = np.array(shares).reshape(count, len(self._limits), runs)[:, j]
            found[:, j] += (share * (failed - chance)).mean(axis=1)
        return np.clip(found, 0.0, 1.0)

    def _evaluate(self, physical):
        self.evaluations += len(physical)
        return self._model.evaluate(physical)

    def _centres(self, parameters, nominal, slopes):
        """Centres of failures in what is drawn anew, ndarray (S, a), from the linear model at some parameters."""
        if not self._size:
            return np.empty((0, 0))
        step = 1e-3
        moved = self._inputs.deviations(step * np.eye(self._size)) / step @ slopes
        lengths = np.linalg.norm(moved, axis=0)
        left, singular, _ = np.linalg.svd(moved / np.where(lengths > 0.0, lengths, 1.0), full_matrices=False)
        basis = left[:, singular > SMALLEST_SINGULAR_VALUE * max(singular[0], 1e-300)]
        some = nominal[np.linspace(0, len(nominal) - 1, min(REFERENCES, len(nominal))).astype(int)]
        directions = basis.T @ moved
        shifts = []
        for limit in self._limits:
            for outputs in some:
                for spread in SEARCH_SPREADS:
                    active = spread * normals(SEARCH, basis.shape[1])
                    failed = active[limit.smoothMargin(outputs + active @ directions) < 0.0]
                    if len(failed):
                        squares = (failed**2).sum(axis=1)
                        logs = -0.5 * squares * (1.0 - spread**-2)
                        likely = np.exp(logs - logs.max())
                        each = max(1, CENTRES // len(some))
                        shifts.append(failed[resample(likely / likely.sum(), each)] @ basis.T)
                        break
        return np.concatenate(shifts) if shifts else np.empty((0, self._size))

    def _points(self, shifts):
        """Points (M, a) of the sampling density, and their weights (M,), whose sum is about 1."""
        if not self._size:
            return np.empty((1, 0)), np.ones(1)
        points = normals(POINTS, self._size)
        nominal = round(NOMINAL_SHARE * POINTS) if len(shifts) else POINTS
        if len(shifts):
            points[nominal:] += shifts[np.arange(POINTS - nominal) % len(shifts)]
        density = np.full(POINTS, nominal / POINTS)
        for shift in shifts:
            density += (1.0 - nominal / POINTS) / len(shifts) * np.exp(points @ shift - 0.5 * (shift @ shift))
        return points, 1.0 / density / POINTS

    def _widths(self, parameters, nominal, slopes):
        """Standard deviation of the margins about those of the linear model, ndarray (L,)."""
        rows = np.arange(WIDTH_RUNS) * len(parameters) // WIDTH_RUNS
        drawn = normals(WIDTH_RUNS, self._size)
        outputs = self._evaluate(self._inputs.toPhysical(parameters[rows], drawn))
        factors = self._inputs.sigmaFactors(parameters[rows])
        linear = nominal[rows] + (self._inputs.deviations(drawn) * factors) @ slopes
        widths = []
        for limit in self._limits:
            true, found = limit.margin(outputs), limit.smoothMargin(linear)
            error = np.abs(true - found)[np.isfinite(true)]
            scale = float(np.abs(found).mean())
            widths.append(max(1.5 * float(np.sqrt((error**2).mean())) if len(error) else scale, 1e-9 * scale, 1e-300))
        return widths


def _pick(weights, chance, runs):
    """Points for true runs, and the probability of each to be picked, of which they are worth the reciprocal."""
    doubt = weights * np.sqrt(chance * (1.0 - chance))
    rest = weights * (chance + LEAST_CHANCE)
    share = (1.0 - DEFENSIVE_SHARE) * doubt / (doubt.sum() or 1.0) + DEFENSIVE_SHARE * rest / rest.sum()
    share /= share.sum()
    rows = resample(share, runs)
    return rows, share[rows]


def violated(limit: Limit, outputs: np.ndarray) -> np.ndarray:
    """Whether each of the outputs (N, q) violates a limit, ndarray (N,); what is NaN does."""
    return ~(limit.margin(outputs) >= 0.0)


@dataclasses.dataclass(frozen=True)
class ProbabilityDistribution:
    """A probability that is known only as a distribution.

    Attributes
    ----------
    values : ndarray (N,)
        Draws, each as likely as any other.
    """

    values: np.ndarray

    @property
    def mean(self) -> float:
        """The probability of the next event: what is not known and what scatters together."""
        return float(self.values.mean())

    @property
    def meanError(self) -> float:
        """Standard error of the mean from the number of draws."""
        return float(self.values.std() / np.sqrt(len(self.values)))

    def quantile(self, level: float) -> float:
        """The bound below which the probability is with a credibility of `level`."""
        return float(np.quantile(self.values, level))
