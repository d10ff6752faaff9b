"""One run of `ActiveSubspaceReliability`: its state, its phases, and how it ends."""

import math
from typing import Any

import numpy as np
import openturns as ot
from scipy.special import ndtr

from satsep_ot.methods.common.intervals import ConfidenceInterval
from satsep_ot.methods.reliability.estimate import MINIMUM_BLOCKS, Block, CrudeEstimate, Estimate
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.outcome import Deferred, Ending, ReliabilityOutcome
from satsep_ot.methods.reliability.proposal import NOMINAL_SHARE, Proposal, propose
from satsep_ot.methods.reliability.recorder import RunRecorder, Stopped
from satsep_ot.methods.reliability.sensitivity import FailureSample
from satsep_ot.methods.reliability.settings import ReliabilitySettings
from satsep_ot.methods.reliability.subset_simulation import SubsetEstimate, combineEstimates, runSubsetSimulation
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate
from satsep_ot.methods.reliability.surrogate_view import SurrogateView

# Refits cost time: they come after this share of new runs.
_REFIT_SHARE = 0.25
# Learning goes on while a block of runs is expected to save more runs than it costs.
_MAXIMUM_LEARNING_SHARE = 0.4
# A surrogate that shows no failure after so many of them will not learn to.
_UNEXPLAINED_FAILURES = 10


class ReliabilityRun:
    """The state of one run.

    Parameters
    ----------
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
    settings : ReliabilitySettings

    Attributes
    ----------
    limitState : LimitStateEvent
    recorder : RunRecorder
        All true runs.
    surrogate : LimitStateSurrogate or None
        The last one that was fitted.
    calibration : float or array (p,)
        Factor on the surrogate's errors, from how far runs that it had not seen were off.
    observedCalibration : float
        Root mean square of the standardised errors of prediction of the last block.
    blocks : list of Block
        Those of the estimate.
    subset : SubsetEstimate or None
        Of the subset simulation that the mode "safe" starts with.
    """

    def __init__(self, event: Any, settings: ReliabilitySettings) -> None:
        self.event = event
        self.settings = settings
        self.limitState = LimitStateEvent(
            event,
            settings.function,
            settings.composition,
            settings.smoothIndices,
            settings.surrogateComposition,
            settings.nonFinitePolicy,
        )
        self.generator = np.random.default_rng(ot.RandomGenerator.IntegerGenerate(2**31 - 1))
        self.recorder = RunRecorder(self.limitState, settings, self.generator)
        self.blockSize = max(40, self.limitState.dimension)
        self.initialSize = 2 * (self.limitState.dimension + 2)
        self.nominalSpread = math.nan
        self.surrogate: LimitStateSurrogate | None = None
        self.weightWidth = math.nan
        self.fittedAt = 0
        self.calibration: Any = 1.0
        self.observedCalibration = 1.0
        self.blocks: list[Block] = []
        self.history: list[tuple[float, float, float, float]] = []
        self.subset: SubsetEstimate | None = None

    def compute(self) -> ReliabilityOutcome:
        """Make the run.

        Raises
        ------
        ValueError
            The evaluation limit is too small, an output is not finite, the composition is not the event's variable.
        RuntimeError
            The function failed, or the composition is not defined.
        """
        smallest = self.initialSize + (MINIMUM_BLOCKS + 1) * self.blockSize
        if self.settings.maximumEvaluations < smallest:
            raise ValueError(
                f"the maximum number of evaluations is {self.settings.maximumEvaluations}; with "
                f"{self.limitState.dimension} inputs at least {smallest} are needed"
            )
        try:
            return self._computePhases()
        except Stopped:
            return self._conclude(Ending.STOPPED)

    # The phases. -----------------------------------------------------------------------------------------------------

    def _computePhases(self):
        recorder, limitState = self.recorder, self.limitState
        first = recorder.evaluateNominal(self.initialSize, "learning")
        recorder.checkComposition(first)
        margins = first.margins[first.finite]
        if len(margins) == 0:
            return self._concludeCrude(Ending.NEVER_FINITE)
        if np.ptp(margins) == 0.0:
            self._spendOnNominalRuns()
            return self._concludeCrude(Ending.CONSTANT)
        self.nominalSpread = float(margins.std())
        limitState.dropUnusedOutputs(first.outputs[first.finite])
        if self.settings.mode == "safe":
            self.subset = self._simulateSubsets("subset", self.settings.maximumEvaluations // 3)
        proposal = self._learn()
        if proposal is None:
            return self._handOver(Ending.NO_FAILURE_REGION)
        if self._missesKnownFailures():
            return self._handOver(Ending.FAILURES_MISSED)
        return self._estimate(proposal)

    def _learn(self) -> Proposal | None:
        """Fit, propose, run, refit: until more learning does not pay."""
        recorder, target = self.recorder, self.settings.targetCoefficientOfVariation
        limit = _MAXIMUM_LEARNING_SHARE * self.settings.maximumEvaluations + recorder.phases.get("subset", 0)
        # Quartics through the first normal points would invent failures far out.
        self._fit(maximumDegree=2 if self.settings.mode == "fast" else 4)
        proposal = self._propose()
        best, idle, earlier = math.inf, 0, 0.0
        while True:
            size = max(self.blockSize, int(_REFIT_SHARE * recorder.used()))
            if proposal is None:
                u = self._drawWide(size)
            else:
                u = proposal.draw(proposal.exploration, size, self.generator)[0]
            runs = recorder.evaluate(u, "learning")
            trusted = self._calibrate(runs)
            self._fit()
            exhausted = recorder.used() + size > limit
            # The search for the region is random and has a second chance.
            proposal = self._propose() or self._propose()
            if proposal is None:
                if exhausted or recorder.failures("learning") >= _UNEXPLAINED_FAILURES:
                    return None
                continue
            needed = proposal.runsNeeded(target)
            idle = 0 if needed < best - self.blockSize else idle + 1
            best = min(best, needed)
            enough = needed <= proposal.runsForFailures() or idle >= 2
            # A refit that moves the surrogate's probability has not been tested by runs that it had not seen.
            stable = abs(proposal.probability - earlier) < 0.15 * proposal.probability
            earlier = proposal.probability
            if exhausted or (trusted and stable and enough):
                return proposal

    def _estimate(self, proposal: Proposal) -> ReliabilityOutcome:
        """Unbiased blocks, each new to the surrogate that proposed it, until the target is reached."""
        recorder, target = self.recorder, self.settings.targetCoefficientOfVariation
        if proposal.losesToSubsetSimulation(recorder.remaining(), target):
            return self._handOver(Ending.POOR_SURROGATE)
        while True:
            size = self._nextSize(proposal)
            if size < 2:
                return self._conclude(Ending.EVALUATIONS_USED)
            u, chosen, weights = proposal.draw(proposal.selection, size, self.generator)
            runs = recorder.evaluate(u, "estimation")
            self.blocks.append(Block.of(proposal, chosen, weights, runs))
            estimate = Estimate(self.blocks)
            self.history.append((float(recorder.used()), estimate.probability, *estimate.interval(0.95)))
            if estimate.reaches(target):
                return self._conclude(Ending.TARGET_REACHED)
            self._calibrate(runs)
            if recorder.used() < (1.0 + _REFIT_SHARE) * self.fittedAt:
                continue
            self._fit()
            # Without a refit's proposal the earlier one stays valid. So it does where a refit contradicts the unbiased
            # estimate: that one cannot come from a poor fit.
            refitted = self._propose() or self._propose()
            if refitted is not None and estimate.agrees(refitted):
                proposal = refitted

    def _handOver(self, ending: Ending) -> ReliabilityOutcome:
        """Subset simulation with the runs that are left."""
        subset = self._simulateSubsets("subset simulation", self.recorder.remaining())
        if self.subset is not None:
            subset = combineEstimates([self.subset, subset])
        variation = subset.coefficientOfVariation
        if math.isinf(variation):
            self._spendOnNominalRuns()
            return self._concludeCrude(ending, subset.upperBound)
        squared = (variation * subset.probability) ** 2
        return self._outcome(
            ending,
            method="SubsetSimulation",
            converged=variation <= self.settings.targetCoefficientOfVariation,
            probability=subset.probability,
            variance=squared,
            interval=ConfidenceInterval(subset.probability, squared),
            diagnostics={"true failures": float(subset.runs.failed.sum())},
        )

    # Their steps. ----------------------------------------------------------------------------------------------------

    def _simulateSubsets(self, phase, evaluations):
        """Subset simulation; where it finds no failure, its first level bounds the probability as crude runs do."""
        subset = runSubsetSimulation(
            lambda u: self.recorder.evaluate(u, phase), self.limitState.dimension, evaluations, self.generator
        )
        if subset.probability == 0.0:
            self.recorder.nominal += subset.nominal
        return subset

    def _nextSize(self, proposal):
        """Runs of the next block of the estimate."""
        used, remaining = self.recorder.used(), self.recorder.remaining()
        needed = max(proposal.runsNeeded(self.settings.targetCoefficientOfVariation), proposal.runsForFailures())
        done = sum(block.size for block in self.blocks)
        missing = MINIMUM_BLOCKS - len(self.blocks)
        size = max(needed / MINIMUM_BLOCKS if missing > 0 else needed - done, self.blockSize, 0.1 * done)
        return int(min(size, max(10 * self.blockSize, 0.25 * used), remaining / max(missing, 1)))

    def _fit(self, maximumDegree=4):
        runs = self.recorder.runs()
        kept = runs.finite
        margins = runs.margins[kept]
        # Near the limit the fit counts most; the width follows the runs towards it.
        width = max(float(np.median(np.abs(margins))), 0.2 * self.nominalSpread)
        self.weightWidth = width
        self.fittedAt = self.recorder.used()
        self.surrogate = LimitStateSurrogate(
            runs.u[kept],
            self.limitState.smooth(runs.outputs[kept]),
            self.limitState.surrogateMargin,
            1.0 / (1.0 + (margins / width) ** 2),
            self.surrogate,
            maximumDegree=maximumDegree,
        )
        self.surrogate.errors = self.surrogate.errors * self.calibration

    def _calibrate(self, runs):
        """Compare the errors of prediction of new runs with what the surrogate expected, component by component.

        Returns
        -------
        trusted : bool
            Whether the surrogate knew the size of its errors and was wrong in no label that it was sure of.
        """
        kept = runs.finite
        y = self.surrogate.reduce(runs.u[kept])
        predicted = self.surrogate.predict(y)
        standardised = (self.limitState.smooth(runs.outputs[kept]) - predicted) / self.surrogate.predictionErrors(y)
        weight = 1.0 / (1.0 + (runs.margins[kept] / self.weightWidth) ** 2)
        squared = weight @ standardised**2
        total = weight.sum()
        self.observedCalibration = float(np.sqrt(squared.mean() / max(total, 1e-300)))
        # Ten runs' worth of belief in the present scale; the refit learns from these runs, so half of the correction
        # (in logarithm) remains.
        factor = np.sqrt((10.0 + squared) / (10.0 + total))
        self.calibration = np.clip(self.calibration * factor, 0.25, 100.0) ** 0.5
        value, scale = self.surrogate.limitState(y)
        wrong = np.abs(runs.failed[kept] - ndtr(-value / scale)) > 0.999
        return bool(factor.max() < 1.5) and not wrong.any()

    def _propose(self) -> Proposal | None:
        """Where to run next; None where the surrogate shows no failure region."""
        assert self.surrogate is not None, "there is a surrogate once the first runs are made"
        target = self.settings.targetCoefficientOfVariation
        return propose(self.surrogate, target, self.generator, self._withNonFinite)

    def _withNonFinite(self, failure):
        """The probability of failure where some runs have no finite value, which the surrogate knows nothing of."""
        count = self.limitState.nonFiniteNumber
        if count == 0:
            return failure
        share = count / self.recorder.used()
        return failure * (1.0 - share) + share * (self.settings.nonFinitePolicy == "failure")

    def _missesKnownFailures(self):
        """Whether runs of crude Monte Carlo, or without a finite value, failed against the surrogate: rare draws of
        the nominal distribution would have to find such failures again."""
        runs = self.recorder.blocks[0]
        value, scale = self.surrogate.limitState(self.surrogate.reduce(runs.u))
        lost = any((part.failed & ~part.finite).any() for part in self.recorder.blocks)
        return lost or bool((runs.failed & (ndtr(-value / scale) < 0.01)).any())

    def _drawWide(self, size):
        """Normal points of twice the spread in the active directions, for a surrogate that shows no failure."""
        u = self.generator.standard_normal((size, self.limitState.dimension))
        active = self.surrogate.directions
        return u + (u @ active) @ active.T

    def _spendOnNominalRuns(self):
        """Crude Monte Carlo with the evaluations that are left: nothing tells where better runs would be."""
        recorder, target = self.recorder, self.settings.targetCoefficientOfVariation
        while recorder.remaining() > 0 and not self._crudeEstimate().reaches(target):
            size = max(self.blockSize, recorder.used() // 4)
            recorder.evaluateNominal(min(size, recorder.remaining()), "Monte Carlo")

    def _crudeEstimate(self):
        nominal = self.recorder.nominal
        return CrudeEstimate(sum(int(part.failed.sum()) for part in nominal), sum(map(len, nominal)))

    # Ways to end. ----------------------------------------------------------------------------------------------------

    def _conclude(self, ending: Ending) -> ReliabilityOutcome:
        """The estimate so far, whatever it is worth."""
        if not self.blocks:
            return self._concludeCrude(ending)
        estimate = Estimate(self.blocks)
        interval, remarks, unseen = estimate.confidenceInterval(), [], None
        nominal = sum(map(len, self.recorder.nominal)) + NOMINAL_SHARE * estimate.size
        bound = 3.0 / max(nominal, 1)
        diagnostics = estimate.diagnose() | {"calibration": self.observedCalibration, "unseen bound": bound}
        if self.subset is not None:
            diagnostics["subset simulation"] = self.subset.probability
        if self.recorder.failures() == 0:
            # The surrogate alone says where failures would be, and true runs have found none there.
            interval = ConfidenceInterval(failures=0, runs=int(nominal))
            self.history = []
            remarks = [f"no run failed, and only about {interval.runs} crude Monte Carlo runs bound the probability"]
        elif self.settings.mode == "fast" and estimate.probability <= bound:
            unseen = bound
        blocks, limitState, seed = list(self.blocks), self.limitState, int(self.generator.integers(2**31))
        return self._outcome(
            ending,
            *remarks,
            method="ActiveSubspace",
            converged=ending is Ending.TARGET_REACHED,
            probability=min(max(estimate.probability, 0.0), 1.0),
            variance=estimate.variance,
            interval=interval,
            surrogateProbability=estimate.surrogateProbability,
            diagnostics=diagnostics,
            unseenBound=unseen,
            # The same whenever it is asked for.
            failureSample=Deferred(lambda: Estimate(blocks).makeFailureSample(limitState, np.random.default_rng(seed))),
        )

    def _concludeCrude(self, ending: Ending, levelReached: float | None = None) -> ReliabilityOutcome:
        """The crude Monte Carlo runs are what is left where nothing else is."""
        for part in self.recorder.nominal:
            part.weights = np.ones(len(part))
        runs, estimate = Runs.concatenate(self.recorder.nominal), self._crudeEstimate()
        remarks = [f"the estimate is from {estimate.size} crude Monte Carlo runs"]
        if levelReached is not None:
            remarks.insert(
                0,
                f"it found no failure before the evaluations ended, at a level of probability {levelReached:.1e}, an "
                "estimate and no bound",
            )
        return self._outcome(
            ending,
            *remarks,
            method="MonteCarlo",
            converged=estimate.reaches(self.settings.targetCoefficientOfVariation),
            probability=estimate.probability,
            variance=estimate.variance,
            interval=estimate.confidenceInterval(),
            diagnostics={"true failures": float(estimate.failures), "unseen bound": 3.0 / estimate.size},
            levelReached=levelReached,
            failureSample=Deferred(lambda: FailureSample.ofMonteCarlo(runs.x, runs.failed)),
        )

    def _outcome(self, ending, *remarks, diagnostics, surrogateProbability=None, **fields):
        """The outcome with what is the same however a run ends."""
        settings, limitState, surrogate = self.settings, self.limitState, self.surrogate
        runs = self.recorder.runs()
        sentence = ending.value.format(
            target=settings.targetCoefficientOfVariation, maximum=settings.maximumEvaluations, first=self.initialSize
        )
        common = {
            "event": self.event,
            "distribution": limitState.distribution,
            "surrogateProbability": surrogateProbability,
            "phases": dict(self.recorder.phases),
            "diagnostics": diagnostics | {"not finite": float(limitState.nonFiniteNumber)},
            "ending": ending,
            "reason": "; ".join([sentence, *remarks]),
            "unseenBound": None,
            "levelReached": None,
            "runs": runs,
            "history": list(self.history),
            "view": None if surrogate is None else Deferred(lambda: SurrogateView.of(surrogate, limitState, runs)),
            "failureSample": None,
            "outputDescription": list(limitState.function.getOutputDescription()),
        }
        return ReliabilityOutcome(**(common | fields))
