"""Probability of failure by polynomial ridges of smooth components, corrected by true runs."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import openturns as ot
from scipy.special import ndtr

from satsep_ot.methods.common.intervals import IntervalLaw
from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.reliability.limit_state import NON_FINITE_POLICIES, LimitStateEvent, Runs, checkedKind
from satsep_ot.methods.reliability.proposal import ModeMixture, Pool, fitImportantRegion
from satsep_ot.methods.reliability.result import (
    ActiveSubspaceReliabilityResult,
    Block,
    Estimate,
    SurrogateView,
    diagnose,
    failureSampleOf,
)
from satsep_ot.methods.reliability.sensitivity import FailureSample
from satsep_ot.methods.reliability.subset_simulation import combineEstimates, runSubsetSimulation
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate
from satsep_ot.openturns_adapter import errorMessage, raiseInterrupt

__all__ = ["ActiveSubspaceReliability", "ActiveSubspaceReliabilityResult"]

_MODES = ("fast", "safe")
# Stop needs this many true failures and blocks beside the target coefficient of variation. More are planned: to stop
# where failures happened to be many, and to go on where they happened to be few, would bias the estimate.
_MINIMUM_FAILURES, _PLANNED_FAILURES = 60, 100
_MINIMUM_BLOCKS = 3
# Refits cost time: they come after this share of new runs.
_REFIT_SHARE = 0.25
# Learning goes on while a block of runs is expected to save more runs than it costs.
_MAXIMUM_LEARNING_SHARE = 0.4
# A surrogate that shows no failure after so many of them will not learn to.
_UNEXPLAINED_FAILURES = 10
# A polynomial that fails nowhere within six standard deviations has not seen the failures.
_SMALLEST_PROBABILITY = 1e-10
# Above this shape of their largest values the mean and variance of the corrections are not to be trusted.
_LARGEST_PARETO_SHAPE = 0.7
# Points that stand for the distribution of the active variables. So many times more are taken where their error would
# be more than this share of the target.
_POOL_SIZE, _LARGEST_POOL_FACTOR, _POOL_SHARE = 20_000, 25.0, 0.3
# Up to so many active directions one mixture finds all modes by itself.
_SINGLE_SPACE = 3
# One mode alone is found with few points.
_MODE_POINTS = 3000


class _Stopped(Exception):
    """The stop callback asked to end."""


@dataclasses.dataclass
class _Proposal:
    """Where the next true runs go, and what the surrogate says there."""

    surrogate: LimitStateSurrogate
    pool: Pool
    failure: np.ndarray
    probability: float
    poolVariance: float
    selection: np.ndarray  # probabilities of the pool's points for runs of the estimate
    exploration: np.ndarray  # and for runs to learn from, wider

    def runVariance(self) -> float:
        """Expected variance that one true run adds to the correction."""
        weights = self.pool.weights / (len(self.selection) * np.maximum(self.selection, 1e-300))
        return float((self.selection * weights**2 * self.failure * (1.0 - self.failure)).sum())

    def failureShare(self) -> float:
        """Expected share of failures among the true runs."""
        return float((self.selection * self.failure).sum())


def _refuseNotCallable(what, callback):
    if callback is not None and not callable(callback):
        raise TypeError(f"the {what} callback must be callable, got {type(callback).__name__}")


class ActiveSubspaceReliability:
    """Probability of an event: surrogate on active subspaces, corrected by true runs to an unbiased estimate.

    Each smooth component becomes a polynomial of one to three directions of the standard normal space, found without
    gradients. The probability that the surrogate with its error fails is integrated; true runs, drawn where the
    surrogate is unsure and where it fails, correct it: ``p = E[pi(Y)] + E[w (1_F - pi)]``, which is unbiased whatever
    the surrogate is, since every block of runs is new to the surrogate that proposed it. Relatives: metamodel-based
    importance sampling (Dubourg, Sudret and Deheeger, Probabilistic Engineering Mechanics 33, 2013) and multifidelity
    importance sampling (Peherstorfer et al., Computer Methods in Applied Mechanics and Engineering 300, 2016).

    Where the surrogate promises less than subset simulation does with the same runs, the algorithm hands over to it.

    Parameters
    ----------
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
        Inputs are continuous with an iso-probabilistic transformation to independent standard normal variables. Where
        their distribution has no names but OpenTURNS' X0, X1, ..., results take those of the function's inputs.

    Raises
    ------
    TypeError
        The event is none of these.

    Notes
    -----
    A failure region that neither the surrogate nor a true run has pointed at is not in the estimate nor in its
    interval: the diagnostic ``unseen bound`` says how much probability such a region may have. The stopping rule looks
    at the data, which the requirement of 60 failures and 3 blocks keeps harmless.

    Where no true run has failed, only the n runs drawn from the distribution of the inputs itself bound the
    probability, by ``1 - 0.05^(1/n)`` at 95 %; the runs of the surrogate's proposals and of the chains of subset
    simulation do not. After a hand-over that found no failure, or where the first runs are all alike, such runs are
    made until they reach the target or the evaluations end.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
    >>> ot.RandomGenerator.SetSeed(0)
    >>> function = ot.SymbolicFunction(["a", "b", "c"], ["exp(0.2 * a + 0.1 * b) + 0.01 * c"])
    >>> vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(3)))
    >>> algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 2.0))
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> interval = result.getConfidenceInterval(0.95)
    >>> result.getConverged(), interval.getLowerBound()[0] < 9.7e-4 < interval.getUpperBound()[0]
    (True, True)
    """

    def __init__(self, event: ot.ThresholdEvent | ot.UnionEvent | ot.IntersectionEvent | ot.DomainEvent) -> None:
        checkedKind(event)
        self._event = event
        self._components = (None, None, None, None)
        self._targetCoefficientOfVariation = 0.05
        self._maximumEvaluations = 5000
        self._mode = "fast"
        self._nonFinitePolicy = "raise"
        self._progressCallback = None
        self._stopCallback = None
        self._result = None
        self._phases: dict[str, int] = {}
        self._runs: list[Runs] = []

    def __repr__(self) -> str:
        return (
            f"ActiveSubspaceReliability(mode={self._mode}, "
            f"targetCoefficientOfVariation={self._targetCoefficientOfVariation}, "
            f"maximumEvaluations={self._maximumEvaluations})"
        )

    def setComponents(
        self,
        function: ot.Function,
        composition: ot.Function,
        smoothIndices: Sequence[int] | None = None,
        surrogateComposition: ot.Function | None = None,
    ) -> None:
        """Give the smooth outputs that the event's variable is composed of: a norm, a maximum, a minimum.

        Parameters
        ----------
        function : :py:class:`openturns.Function`
            Inputs to p outputs; one true run is one evaluation of it.
        composition : :py:class:`openturns.Function`
            The p outputs to the variable that the event compares with its threshold. Defined for all their values, also
            those that no run has: surrogates extrapolate. Clip what a root or a logarithm is taken of.
        smoothIndices : sequence of int, optional
            Outputs that get a surrogate. By default all.
        surrogateComposition : :py:class:`openturns.Function`, optional
            Composition of the smooth outputs alone. By default ``composition``.

        Notes
        -----
        `run` raises a RuntimeError where a composition is not defined; `getRuns` still has the true runs.
        """
        self._components = (function, composition, smoothIndices, surrogateComposition)

    def setTargetCoefficientOfVariation(self, value: float) -> None:
        """Stop at this coefficient of variation of the estimate (default 0.05)."""
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"the target coefficient of variation is {value}; it must be positive")
        self._targetCoefficientOfVariation = float(value)

    def getTargetCoefficientOfVariation(self) -> float:
        """Accessor to the target coefficient of variation."""
        return self._targetCoefficientOfVariation

    def setMaximumEvaluations(self, value: int) -> None:
        """Largest number of true runs, all phases together (default 5000)."""
        if int(value) != value or value < 1:
            raise ValueError(f"the maximum number of evaluations is {value}; it must be a positive integer")
        self._maximumEvaluations = int(value)

    def getMaximumEvaluations(self) -> int:
        """Accessor to the largest number of true runs."""
        return self._maximumEvaluations

    def setMode(self, mode: str) -> None:
        """``"fast"`` (default) learns from normal points; ``"safe"`` starts from a short subset simulation as well.

        The safe mode spends a third of the evaluations on it: its failed points show regions that a smooth surrogate
        of normal points misses, and its estimate is an independent check.
        """
        if mode not in _MODES:
            raise ValueError(f"the mode is {mode!r}; give one of {_MODES}")
        self._mode = mode

    def getMode(self) -> str:
        """Accessor to the mode."""
        return self._mode

    def setNonFinitePolicy(self, policy: str) -> None:
        """What a run with a non-finite output is: ``"raise"`` an error (default), a ``"failure"`` or ``"safe"``."""
        if policy not in NON_FINITE_POLICIES:
            raise ValueError(f"the policy for non-finite outputs is {policy!r}; give one of {NON_FINITE_POLICIES}")
        self._nonFinitePolicy = policy

    def setProgressCallback(self, callback: Callable[[float], None] | None) -> None:
        """Called after each block of runs with the percentage of the evaluation limit that is used."""
        _refuseNotCallable("progress", callback)
        self._progressCallback = callback

    def setStopCallback(self, callback: Callable[[], bool] | None) -> None:
        """Called after each block; when it returns True the run ends with what was reached."""
        _refuseNotCallable("stop", callback)
        self._stopCallback = callback

    def getResult(self) -> ActiveSubspaceReliabilityResult:
        """Accessor to the result of `run`."""
        if self._result is None:
            raise RuntimeError("there is no result yet; call run() first")
        return self._result

    def getRuns(self) -> tuple[ot.Sample, ot.Sample]:
        """Inputs and outputs of all true runs so far, also of a run() that an error ended.

        Raises
        ------
        RuntimeError
            There are none: `run` was not called, or ended before its first block of runs.
        """
        if not self._runs:
            raise RuntimeError("there are no true runs: run() was not called, or ended before its first block")
        runs = Runs.concatenate(self._runs)
        inputs, outputs = ot.Sample(runs.x), ot.Sample(runs.outputs)
        inputs.setDescription(self._limitState.distribution.getDescription())
        outputs.setDescription(self._limitState.function.getOutputDescription())
        return inputs, outputs

    # The phases. -----------------------------------------------------------------------------------------------------

    @singleThread()
    def run(self) -> None:
        """Compute the probability.

        Raises
        ------
        ValueError
            The evaluation limit is too small, an output is not finite, the composition is not the event's variable.
        RuntimeError
            The function failed; the message says in which phase and how many runs are kept (`getRuns`).
        """
        self._result = None
        self._runs = []
        self._phases = {}
        self._limitState = LimitStateEvent(self._event, *self._components, nonFinitePolicy=self._nonFinitePolicy)
        self._generator = np.random.default_rng(ot.RandomGenerator.IntegerGenerate(2**31 - 1))
        self._blockSize = max(40, self._limitState.dimension)
        self._blocks: list[Block] = []
        self._history: list[tuple[float, float, float, float]] = []
        self._initial = None
        # Independent draws of the inputs' own distribution: a Monte Carlo sample, which bounds what was not seen.
        self._nominal: list[Runs] = []
        self._subset = None
        self._surrogate: Any = None
        self._calibration = 1.0
        self._observedCalibration = 1.0
        initialSize = 2 * (self._limitState.dimension + 2)
        smallest = initialSize + (_MINIMUM_BLOCKS + 1) * self._blockSize
        if self._maximumEvaluations < smallest:
            raise ValueError(
                f"the maximum number of evaluations is {self._maximumEvaluations}; with {self._limitState.dimension} "
                f"inputs at least {smallest} are needed"
            )
        try:
            self._runPhases(initialSize)
        except _Stopped:
            self._finish(False, "stopped by the stop callback")

    def _runPhases(self, initialSize):
        dimension = self._limitState.dimension
        self._initial = self._evaluateNominal(initialSize, "learning")
        self._checkComposition(self._initial)
        margins = self._initial.margins[self._initial.finite]
        if len(margins) == 0 or np.ptp(margins) == 0.0:
            what = "not finite in any of" if len(margins) == 0 else "constant in"
            if len(margins) > 0:
                self._spendOnNominalRuns()
            self._finishFromNominalRuns(
                f"the event's variable is {what} the first {initialSize} runs, so nothing can be learnt"
            )
            return
        self._nominalSpread = float(margins.std())
        self._limitState.dropUnusedOutputs(self._initial.outputs[self._initial.finite])
        if self._mode == "safe":
            self._subset = runSubsetSimulation(
                lambda u: self._evaluate(u, "subset"), dimension, self._maximumEvaluations // 3, self._generator
            )
            if self._subset.probability == 0.0:
                self._nominal += self._subset.nominal
        proposal = self._learn()
        if proposal is None:
            self._handOver("the surrogate shows no failure region")
        elif self._missesKnownFailures():
            self._handOver("true runs have failed where the surrogate is sure of safety")
        else:
            self._estimate(proposal)

    def _learn(self) -> _Proposal | None:
        """Fit, propose, run, refit: until more learning does not pay."""
        limit = _MAXIMUM_LEARNING_SHARE * self._maximumEvaluations + self._phases.get("subset", 0)
        # Quartics through the first normal points would invent failures far out.
        self._fit(maximumDegree=2 if self._mode == "fast" else 4)
        proposal = self._propose()
        best, idle, earlier = math.inf, 0, 0.0
        while True:
            size = max(self._blockSize, int(_REFIT_SHARE * self._used()))
            u = self._drawWide(size) if proposal is None else self._drawRuns(proposal, proposal.exploration, size)[0]
            runs = self._evaluate(u, "learning")
            trusted = self._calibrate(runs)
            self._fit()
            exhausted = self._used() + size > limit
            # The search for the region is random and has a second chance.
            proposal = self._propose() or self._propose()
            if proposal is None:
                failures = sum(part.failed[part.phases == "learning"].sum() for part in self._runs)
                if exhausted or failures >= _UNEXPLAINED_FAILURES:
                    return None
                continue
            needed = self._runsNeeded(proposal)
            idle = 0 if needed < best - self._blockSize else idle + 1
            best = min(best, needed)
            enough = needed <= self._runsForFailures(proposal) or idle >= 2
            # A refit that moves the surrogate's probability has not been tested by runs that it had not seen.
            stable = abs(proposal.probability - earlier) < 0.15 * proposal.probability
            earlier = proposal.probability
            if exhausted or (trusted and stable and enough):
                return proposal

    def _estimate(self, proposal: _Proposal) -> None:
        """Unbiased blocks, each new to the surrogate that proposed it, until the target is reached."""
        target = self._targetCoefficientOfVariation
        while True:
            remaining = self._maximumEvaluations - self._used()
            if not self._blocks and self._subsetIsBetter(proposal, remaining):
                self._handOver("the surrogate explains too little of the limit state: no usable active subspace")
                return
            needed = max(self._runsNeeded(proposal), self._runsForFailures(proposal))
            done = sum(block.size for block in self._blocks)
            missing = _MINIMUM_BLOCKS - len(self._blocks)
            size = max(needed / _MINIMUM_BLOCKS if missing > 0 else needed - done, self._blockSize, 0.1 * done)
            size = int(min(size, max(10 * self._blockSize, 0.25 * self._used()), remaining / max(missing, 1)))
            if size < 2:
                self._finish(False, f"the maximum number of evaluations, {self._maximumEvaluations}, was reached")
                return
            u, chosen, weights = self._drawRuns(proposal, proposal.selection, size)
            runs = self._evaluate(u, "estimation")
            failure = proposal.failure[chosen]
            runs.weights, runs.expected = weights, failure
            self._blocks.append(
                Block(
                    proposal.surrogate,
                    proposal.failure,
                    proposal.pool,
                    proposal.probability,
                    proposal.poolVariance,
                    weights * (runs.failed - failure),
                    weights**2 * failure * (1.0 - failure),
                    weights,
                    runs,
                )
            )
            estimate = Estimate(self._blocks)
            self._history.append((float(self._used()), estimate.probability, *estimate.interval(0.95)))
            if (
                estimate.coefficientOfVariation() <= target
                and estimate.failures >= _MINIMUM_FAILURES
                and len(self._blocks) >= _MINIMUM_BLOCKS
                and estimate.paretoShape() <= _LARGEST_PARETO_SHAPE
            ):
                self._finish(
                    True, f"the target coefficient of variation, {target}, was reached{self._unseen(estimate)}"
                )
                return
            self._calibrate(runs)
            if self._used() < (1.0 + _REFIT_SHARE) * self._fittedAt:
                continue
            self._fit()
            # Without a refit's proposal the earlier one stays valid. So it does where a refit contradicts the unbiased
            # estimate: that one cannot come from a poor fit.
            refitted = self._propose() or self._propose()
            if refitted is not None and self._isConsistent(refitted, estimate):
                proposal = refitted

    # Their steps. ----------------------------------------------------------------------------------------------------

    def _used(self):
        return sum(self._phases.values())

    def _evaluateNominal(self, size, phase):
        """True runs drawn from the distribution of the inputs itself, whatever the earlier ones gave."""
        return self._evaluate(self._generator.standard_normal((size, self._limitState.dimension)), phase, nominal=True)

    def _evaluate(self, u, phase, nominal=False):
        """True runs at u, recorded; the callbacks are served afterwards."""
        try:
            runs = self._limitState.evaluate(u, phase)
        except ValueError:
            raise
        except Exception as error:
            raiseInterrupt(error)
            kept = sum(map(len, self._runs))
            before = f"getRuns() still has the {kept} runs before it" if kept else "no run before it is there to keep"
            raise RuntimeError(
                f"the function failed in the phase {phase!r}, in a block of {len(u)} runs of which none is kept; "
                f"{before}: {errorMessage(error)}"
            ) from error
        self._runs.append(runs)
        if nominal:
            self._nominal.append(runs)
        self._phases[phase] = self._phases.get(phase, 0) + len(runs)
        if self._progressCallback is not None:
            self._progressCallback(100.0 * self._used() / self._maximumEvaluations)
        if self._stopCallback is not None and self._stopCallback():
            raise _Stopped
        return runs

    def _checkComposition(self, runs):
        if runs.finite.any():
            row = int(np.argmax(runs.finite))
            spread = float(np.ptp(runs.margins[runs.finite]))
            checked = self._limitState.checkComposition(runs.x[row], runs.margins[row], spread)
            if checked:
                self._phases["composition check"] = checked

    def _fit(self, maximumDegree=4):
        runs = Runs.concatenate(self._runs)
        kept = runs.finite
        margins = runs.margins[kept]
        # Near the limit the fit counts most; the width follows the runs towards it.
        width = max(float(np.median(np.abs(margins))), 0.2 * self._nominalSpread)
        self._weightWidth = width
        self._fittedAt = self._used()
        self._surrogate = LimitStateSurrogate(
            runs.u[kept],
            self._limitState.smooth(runs.outputs[kept]),
            self._limitState.surrogateMargin,
            1.0 / (1.0 + (margins / width) ** 2),
            self._surrogate,
            maximumDegree=maximumDegree,
        )
        self._surrogate.errors = self._surrogate.errors * self._calibration

    def _calibrate(self, runs):
        """Compare the errors of prediction of new runs with what the surrogate expected, component by component.

        Returns
        -------
        trusted : bool
            Whether the surrogate knew the size of its errors and was wrong in no label that it was sure of.
        """
        kept = runs.finite
        y = self._surrogate.reduce(runs.u[kept])
        predicted = self._surrogate.predict(y)
        standardised = (self._limitState.smooth(runs.outputs[kept]) - predicted) / self._surrogate.predictionErrors(y)
        weight = 1.0 / (1.0 + (runs.margins[kept] / self._weightWidth) ** 2)
        squared = weight @ standardised**2
        total = weight.sum()
        self._observedCalibration = float(np.sqrt(squared.mean() / max(total, 1e-300)))
        # Ten runs' worth of belief in the present scale; the refit learns from these runs, so half of the correction
        # (in logarithm) remains.
        factor = np.sqrt((10.0 + squared) / (10.0 + total))
        self._calibration = np.clip(self._calibration * factor, 0.25, 100.0) ** 0.5
        value, scale = self._surrogate.limitState(y)
        wrong = np.abs(runs.failed[kept] - ndtr(-value / scale)) > 0.999
        return bool(factor.max() < 1.5) and not wrong.any()

    def _propose(self) -> _Proposal | None:
        """Where to run next; None where the surrogate shows no failure region."""
        surrogate, generator = self._surrogate, self._generator
        k = surrogate.dimension()
        if k == 0:
            return None
        mixture = self._modes() if k > _SINGLE_SPACE and not surrogate.radial else None
        if mixture is None:
            mixture = fitImportantRegion(lambda y: surrogate.limitState(y, exact=False), k, generator)
        if mixture is None:
            return None
        factor = 1.0
        while True:
            pool = Pool.draw(mixture, int(factor * _POOL_SIZE), generator)
            value, scale = surrogate.limitState(pool.points)
            failure = self._withNonFinite(ndtr(-value / scale))
            probability, variance = pool.expectation(failure)
            if probability < _SMALLEST_PROBABILITY:
                return None
            missing = variance / (_POOL_SHARE * self._targetCoefficientOfVariation * probability) ** 2
            if missing <= 1.0 or factor == _LARGEST_POOL_FACTOR:
                break
            factor = min(1.2 * missing * factor, _LARGEST_POOL_FACTOR)

        def band(width):
            share = ndtr(-value / (width * scale))
            return np.sqrt(share * (1.0 - share))

        nominal = np.ones(len(value))
        near, far = band(4.0), band(12.0)
        selection = pool.selection([(0.1, nominal), (0.15, failure), (0.35, band(1.5)), (0.25, near), (0.15, far)])
        exploration = pool.selection([(0.15, nominal), (0.15, failure), (0.35, near), (0.35, far)])
        return _Proposal(surrogate, pool, failure, probability, variance, selection, exploration)

    def _withNonFinite(self, failure):
        """The probability of failure where some runs have no finite value, which the surrogate knows nothing of."""
        count = self._limitState.nonFiniteNumber
        if count == 0:
            return failure
        share = count / self._used()
        return failure * (1.0 - share) + share * (self._nonFinitePolicy == "failure")

    def _modes(self) -> ModeMixture | None:
        """A mixture for each group of components that fail together, in their own subspace; None where there is a
        single group.

        One mixture in the many directions of all components together is too poor to be sampled from.
        """
        surrogate, generator = self._surrogate, self._generator
        groups = surrogate.groups(generator)
        mixtures, bases, shares = [], [], []
        for group in groups if len(groups) > 1 else []:
            part = surrogate.restricted(group)
            k = part.dimension()
            if k == 0:
                continue
            mixture = fitImportantRegion(
                lambda y, part=part: part.limitState(y, exact=False), k, generator, size=_MODE_POINTS
            )
            if mixture is None:
                continue
            pool = Pool.draw(mixture, _POOL_SIZE // 20, generator)
            value, scale = part.limitState(pool.points, exact=False)
            mixtures.append(mixture)
            bases.append(surrogate.directions.T @ part.directions)
            shares.append(pool.expectation(ndtr(-value / scale))[0])
        if not sum(shares) > 0.0:
            return None
        # A mode that the others hide at the typical values still gets runs.
        shares = np.maximum(np.array(shares) / sum(shares), 0.01)
        return ModeMixture(shares / shares.sum(), bases, mixtures)

    @staticmethod
    def _isConsistent(proposal, estimate):
        """Whether the surrogate's probability lies within five standard deviations of the estimate so far."""
        deviation = math.sqrt(estimate.variance + proposal.poolVariance) + 0.02 * abs(estimate.probability)
        return abs(proposal.probability - estimate.probability) <= 5.0 * deviation

    def _missesKnownFailures(self):
        """Whether runs drawn as by Monte Carlo, or without a finite value, failed against the surrogate: rare draws of
        the nominal distribution would have to find such failures again."""
        runs = self._initial
        value, scale = self._surrogate.limitState(self._surrogate.reduce(runs.u))
        lost = any((part.failed & ~part.finite).any() for part in self._runs)
        return lost or bool((runs.failed & (ndtr(-value / scale) < 0.01)).any())

    def _drawRuns(self, proposal, selection, size):
        """Points of standard space, their positions in the pool and their weights."""
        chosen, weights = proposal.pool.select(selection, size, self._generator)
        return proposal.surrogate.expand(proposal.pool.points[chosen], self._generator), chosen, weights

    def _drawWide(self, size):
        """Normal points of twice the spread in the active directions, for a surrogate that shows no failure."""
        u = self._generator.standard_normal((size, self._limitState.dimension))
        active = self._surrogate.directions
        return u + (u @ active) @ active.T

    def _runsNeeded(self, proposal):
        """Runs of this proposal to the target, as far as the surrogate knows."""
        allowed = (self._targetCoefficientOfVariation * proposal.probability) ** 2 - proposal.poolVariance
        return proposal.runVariance() / allowed if allowed > 0.0 else math.inf

    def _runsForFailures(self, proposal):
        return _PLANNED_FAILURES / max(proposal.failureShare(), 0.05)

    def _subsetIsBetter(self, proposal, remaining):
        """Whether subset simulation would be more exact with the remaining runs, by its usual error (Au and Beck)."""
        ours = math.sqrt(proposal.runVariance() / max(remaining, 1)) / proposal.probability
        levels = max(-math.log10(min(proposal.probability, 0.1)), 1.0)
        subset = levels * math.sqrt(9.0 * 3.0 * levels / max(remaining, 1))
        return ours > max(subset, self._targetCoefficientOfVariation)

    # Ways to end. ----------------------------------------------------------------------------------------------------

    def _unseen(self, estimate):
        """What the interval does not say, for a probability that the runs drawn as by Monte Carlo cannot reach."""
        bound = 3.0 / (len(self._initial) + 0.1 * estimate.size)
        if self._mode == "safe" or estimate.probability > bound:
            return ""
        return f"; a failure region of probability below {bound:.1e} that no run has pointed at is not excluded"

    def _finish(self, converged, reason):
        if not self._blocks:
            self._finishFromNominalRuns(reason)
            return
        estimate = Estimate(self._blocks)
        law = estimate.law()
        # A tenth of the proposals follow the distribution of the inputs.
        nominal = sum(map(len, self._nominal)) + 0.1 * estimate.size
        diagnostics = diagnose(self._blocks, self._observedCalibration, nominal, self._limitState.nonFiniteNumber)
        if self._subset is not None:
            diagnostics["subset simulation"] = self._subset.probability
        if not any(part.failed.any() for part in self._runs):
            # The surrogate alone says where failures would be, and true runs have found none there.
            law = IntervalLaw(failures=0, runs=int(nominal))
            self._history = []
            reason += f"; no run failed, and only about {law.runs} runs as by Monte Carlo bound the probability"
        self._store(
            min(max(estimate.probability, 0.0), 1.0),
            estimate.variance,
            law,
            estimate.surrogateProbability,
            diagnostics,
            converged,
            reason,
            "ActiveSubspace",
            self._laterFailureSample(),
        )

    def _laterFailureSample(self):
        """Made when it is asked for, and the same whenever that is."""
        blocks, limitState = list(self._blocks), self._limitState
        seed = int(self._generator.integers(2**31))
        return lambda: failureSampleOf(blocks, limitState, np.random.default_rng(seed))

    def _spendOnNominalRuns(self):
        """Up to the evaluations that are left, as by Monte Carlo: nothing tells where better ones would be."""
        while self._used() < self._maximumEvaluations and not self._nominalRunsSuffice():
            size = max(self._blockSize, self._used() // 4)
            self._evaluateNominal(min(size, self._maximumEvaluations - self._used()), "Monte Carlo")

    def _nominalRunsSuffice(self):
        """Whether both bounds at 95 % are within twice the target, as they are of an estimate that reaches it.

        Its own coefficient of variation would be 0 where all runs have failed.
        """
        failures, size = sum(int(part.failed.sum()) for part in self._nominal), sum(map(len, self._nominal))
        lower, upper = IntervalLaw(failures=failures, runs=size).bounds(0.95)
        share = failures / size
        width = max(upper - share, share - lower)
        return failures >= _MINIMUM_FAILURES and width <= 2.0 * self._targetCoefficientOfVariation * share

    def _finishFromNominalRuns(self, reason):
        """The runs drawn as by Monte Carlo are what is left where nothing else is."""
        runs = Runs.concatenate(self._nominal)
        for part in self._nominal:
            part.weights = np.ones(len(part))
        failures, size = int(runs.failed.sum()), len(runs)
        share = failures / size
        variance = share * (1.0 - share) / size
        self._store(
            share,
            variance,
            IntervalLaw(failures=failures, runs=size),
            None,
            {
                "true failures": float(failures),
                "unseen bound": 3.0 / size,
                "not finite": float(self._limitState.nonFiniteNumber),
            },
            self._nominalRunsSuffice(),
            f"{reason}; the estimate is from {size} runs drawn as by Monte Carlo",
            "MonteCarlo",
            FailureSample.ofMonteCarlo(runs.x, runs.failed),
        )

    def _handOver(self, why):
        """Subset simulation with the runs that are left."""
        remaining = self._maximumEvaluations - self._used()
        subset = runSubsetSimulation(
            lambda u: self._evaluate(u, "subset simulation"), self._limitState.dimension, remaining, self._generator
        )
        reason = f"handed over to subset simulation: {why}"
        if subset.probability == 0.0:
            self._nominal += subset.nominal
        if self._subset is not None:
            subset = combineEstimates([self._subset, subset])
        variation = subset.coefficientOfVariation
        if math.isinf(variation):
            self._spendOnNominalRuns()
            self._finishFromNominalRuns(
                f"{reason}; it found no failure before the evaluations ended, at a level of probability "
                f"{subset.upperBound:.1e}, an estimate and no bound"
            )
            return
        squared = (variation * subset.probability) ** 2
        self._store(
            subset.probability,
            squared,
            IntervalLaw(subset.probability, squared),
            None,
            {"true failures": float(subset.runs.failed.sum()), "not finite": float(self._limitState.nonFiniteNumber)},
            variation <= self._targetCoefficientOfVariation,
            reason,
            "SubsetSimulation",
            None,
        )

    def _store(
        self, probability, variance, law, surrogateProbability, diagnostics, converged, reason, method, failureSample
    ):
        runs, surrogate, limitState = Runs.concatenate(self._runs), self._surrogate, self._limitState
        self._result = ActiveSubspaceReliabilityResult(
            self._event,
            limitState.distribution,
            probability,
            variance,
            law,
            surrogateProbability,
            dict(self._phases),
            diagnostics,
            converged,
            reason,
            method,
            runs,
            list(self._history),
            None if surrogate is None else lambda: SurrogateView.of(surrogate, limitState, runs),
            failureSample,
            limitState.function.getOutputDescription(),
        )
