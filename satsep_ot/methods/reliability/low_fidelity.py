"""A cheap model of the same components: where failures are expected, and what the heavy one is compared with.

Each component of the heavy model is a learnt factor times the cheap one plus a discrepancy, which is fitted as the
component itself would be (Kennedy and O'Hagan, Biometrika 87, 2000). Only the correction by heavy runs decides on the
probability; the cheap model says where they are worth most (Peherstorfer, Cui, Marzouk and Willcox, Computer Methods in
Applied Mechanics and Engineering 300, 2016).
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
import openturns as ot

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.reliability.limit_state import LimitStateEvent
from satsep_ot.methods.reliability.mixture import ModeMixture, fitGaussianMixture
from satsep_ot.methods.reliability.outcome import ReliabilityOutcome
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate, ProcessFit, RidgeFit, RidgeModel

# A component follows the cheap one where that raises the mean log density of predictions by so much.
_LEAST_GAIN = 0.1
# An error is never taken to be smaller than this share of a component's own spread.
_SMALLEST_ERROR = 1e-4
# Points that failures of the cheap model are known by.
_FAILURES = 4000
# Directions of a mixture, at most; less than the divergence from the standard normal is noise.
_DIRECTIONS, _LEAST_DIVERGENCE = 8, 0.02


class LowFidelity:
    """The cheap model.

    Parameters
    ----------
    limitState : LimitStateEvent
        Of the heavy model.
    function : :py:class:`openturns.Function`
        The cheap one.

    Attributes
    ----------
    limitState : LimitStateEvent
        Of the cheap model.
    evaluations : int
        Runs of it so far.
    failures : array (n, d)
        Points of standard space that follow its failures; none where it has not failed.
    """

    def __init__(self, limitState: LimitStateEvent, function: ot.Function) -> None:
        self.limitState = limitState.withFunction(function)
        self._heavy = limitState
        self.evaluations = 0
        self.failures = np.zeros((0, limitState.dimension))

    def values(self, u: np.ndarray) -> np.ndarray:
        """The modelled components (n, p) at points (n, d) of standard space, NaN where a run has no value."""
        self.evaluations += len(u)
        runs = self.limitState.evaluate(u, exploring=True)
        values = self._heavy.smooth(runs.outputs).astype(float)
        values[~np.isfinite(values).all(axis=1)] = np.nan
        return values

    def learnFailures(self, outcome: ReliabilityOutcome, generator: np.random.Generator) -> None:
        """Take the failures of a finished run of the cheap model."""
        self.evaluations += len(outcome.runs)
        sample = outcome.failureSample
        if sample is None:
            u = outcome.runs.u[outcome.runs.failed]
            weights = np.ones(len(u))
        else:
            found = sample.get()
            u, weights = self.limitState.space.toStandard(found.x), np.maximum(found.weights, 0.0)
        usable = np.isfinite(u).all(axis=1) & (weights > 0.0)
        if usable.any():
            weights = weights[usable] / weights[usable].sum()
            self.failures = u[usable][generator.choice(len(weights), size=_FAILURES, p=weights)]


@dataclasses.dataclass
class CorrectedFit:
    """A component that is a factor times the cheap one plus a discrepancy; its first variable is the cheap one."""

    factor: float
    discrepancy: RidgeFit | ProcessFit
    least: float

    @property
    def model(self) -> RidgeModel:
        """The model of the discrepancy."""
        return self.discrepancy.model

    @property
    def directions(self) -> np.ndarray:
        """The directions of the discrepancy."""
        return self.discrepancy.directions

    def predict(self, x: np.ndarray) -> np.ndarray:
        """Values (n,) at the variables (n, 1 + r)."""
        return self.factor * x[:, 0] + self.discrepancy.predict(x[:, 1:])

    def predictBoth(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and standard deviations of their errors, each (n,)."""
        value, error = self.discrepancy.predictBoth(x[:, 1:])
        return self.factor * x[:, 0] + value, np.maximum(error, self.least)


class CorrectedSurrogate(LimitStateSurrogate):
    """Surrogate of a composed limit state from a cheap model; its variables are all inputs.

    Parameters
    ----------
    u, values, margin, weights, reselect
        As for `LimitStateSurrogate`.
    lowFidelity : LowFidelity
    cheap : array (n, p)
        Components of the cheap model at the points.
    previous : CorrectedSurrogate, optional
    decided : bool
        Whether components follow the cheap ones, or do not, as those of the previous surrogate.
    """

    # Each point is a run of the cheap model.
    searchPoints = 2500

    def __init__(
        self,
        u: np.ndarray,
        values: np.ndarray,
        margin: Callable,
        weights: np.ndarray,
        lowFidelity: LowFidelity,
        cheap: np.ndarray,
        previous: "CorrectedSurrogate | None" = None,
        reselect: bool = True,
        decided: bool = False,
    ) -> None:
        self._training = u, values, weights
        self._limit = self.margin = margin
        self._single = False
        self.inputs = u.shape[1]
        self.link, self.radial = None, False
        self._lowFidelity = lowFidelity
        self._typical = np.nanmedian(cheap, axis=0) if np.isfinite(cheap).any() else np.zeros(cheap.shape[1])
        self.knownFailures = lowFidelity.failures
        self.scores: list[float] = []
        earlier = [None] * values.shape[1] if previous is None else previous.components
        cheap = self._complete(cheap)
        self.components = [
            self._correct(column, one, old, reselect, decided)
            for column, one, old in zip(values.T, cheap.T, earlier, strict=True)
        ]
        self.directions = np.eye(self.inputs)
        self.calibration = np.ones(values.shape[1])

    def _complete(self, cheap):
        return np.where(np.isfinite(cheap), cheap, self._typical)

    def _correct(self, column, cheap, old, reselect, decided):
        u, _, weights = self._training
        factor, least = self._factor(column, cheap, weights), _SMALLEST_ERROR * float(column.std())
        if not reselect and old is not None and old.model.parameters(self.inputs) <= 0.75 * len(u):
            factor = factor if old.factor else 0.0
            return CorrectedFit(factor, old.discrepancy.refit(u, column - factor * cheap, weights), least)
        found = []
        for rho in (factor, 0.0):
            if decided and old is not None and bool(rho) != bool(old.factor):
                continue
            start = old.discrepancy if old is not None and bool(old.factor) == bool(rho) else None
            fit = self._choose(column - rho * cheap, start, 3, 4)
            found.append((self._score(fit, column - rho * cheap), CorrectedFit(rho, fit, least)))
        if len(found) == 1:
            return found[0][1]
        (with_cheap, corrected), (without, plain) = found
        self.scores.append(with_cheap - without)
        return corrected if with_cheap > without + _LEAST_GAIN else plain

    @staticmethod
    def _factor(column, cheap, weights):
        """The factor of the weighted regression of the component on the cheap one."""
        centred = cheap - np.average(cheap, weights=weights)
        square = float((weights * centred**2).sum())
        return float((weights * centred * column).sum()) / square if square > 0.0 else 0.0

    def gain(self) -> float:
        """By how much the cheap model raises the mean log density of predictions of the component that it helps most;
        infinite where models were not chosen anew.
        """
        return max(self.scores, default=math.inf)

    def dimension(self) -> int:
        """Number of variables: all inputs."""
        return self.inputs

    def reduce(self, u: np.ndarray) -> np.ndarray:
        """Points of standard space (n, d) to the variables: the same."""
        return u

    def expand(self, y: np.ndarray, generator: np.random.Generator) -> np.ndarray:
        """Points (n, d) of standard space at the variables: the same."""
        return y

    def _variables(self, y):
        cheap = self._complete(self._lowFidelity.values(y))
        return [
            np.column_stack([one, fit.discrepancy.variables(y @ fit.directions, None)])
            for one, fit in zip(cheap.T, self.components, strict=True)
        ]

    def nativeFunction(self, space: StandardSpace) -> ot.Function:
        """There is none."""
        raise ValueError("the surrogate corrects a low-fidelity function, for which there is no native function")


def fitFailures(points: np.ndarray, generator: np.random.Generator) -> ModeMixture:
    """A mixture for failing points (n, d), in the directions in which they are not as the standard normal is.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.reliability.low_fidelity import fitFailures
    >>> generator = np.random.default_rng(0)
    >>> points = generator.standard_normal((2000, 20)) + 3.0 * np.eye(20)[0]
    >>> fitFailures(points, generator).bases[0].shape
    (20, 1)
    """
    n, d = points.shape
    moments, vectors = np.linalg.eigh(points.T @ points / n)
    divergence = moments - 1.0 - np.log(np.maximum(moments, 1e-12))
    order = np.argsort(divergence)[::-1][:_DIRECTIONS]
    kept = order[divergence[order] > _LEAST_DIVERGENCE + 3.0 * d / n]
    basis = vectors[:, kept if len(kept) else order[:1]]
    some = points[generator.choice(n, size=min(n, 1200), replace=False)] @ basis
    return ModeMixture(np.ones(1), [basis], [fitGaussianMixture(some, generator).withDefence()])
