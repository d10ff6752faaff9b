"""One run of `ActiveSubspaceReliability`: its phases, and how it ends."""

import copy
import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.intervals import ConfidenceInterval
from satsep_ot.methods.common.run_log import CheckpointFile, fingerprintOf
from satsep_ot.methods.reliability.audits import WideDesign
from satsep_ot.methods.reliability.estimate import Block, CrudeEstimate, Estimate
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.low_fidelity import LowFidelity
from satsep_ot.methods.reliability.mode_sampling import ModeSampling
from satsep_ot.methods.reliability.outcome import Deferred, Ending, ReliabilityOutcome
from satsep_ot.methods.reliability.proposal import NOMINAL_SHARE
from satsep_ot.methods.reliability.recorder import RunRecorder, Stopped
from satsep_ot.methods.reliability.sensitivity import FailureSample
from satsep_ot.methods.reliability.settings import ReliabilitySettings
from satsep_ot.methods.reliability.subset_simulation import runSubsetSimulation
from satsep_ot.methods.reliability.surrogate import FEW_INPUTS
from satsep_ot.methods.reliability.surrogate_sampling import SurrogateSampling, Verdict
from satsep_ot.methods.reliability.surrogate_view import SurrogateView
from satsep_ot.openturns_adapter import generatorState, setGeneratorState

# Wide runs of an estimate from a surrogate and of one from modes, and with targets that say less.
_AUDITS = {"fast": (80, 250), "safe": (240, 500)}
_AUDITS_OF_ROUGH_TARGETS, _ROUGH_TARGET = 32, 0.1
# From this share of failures in the first runs on, the complement is estimated.
_COMPLEMENT_SHARE = 0.6
# Spread of the wide ones among the first runs.
_FIRST_SPREAD = 2.0
# Error of a verdict over all looks together.
_VERDICT_ERROR = 0.05
# Modes are given up for subset simulation where so many runs have brought no estimate of any use, or where after a
# block so many are known and still more come.
_HOPELESS_RUNS, _HOPELESS_VARIATION, _TOO_MANY_MODES = 0.4, 0.8, 15
_SUBSET_RUNS = 7 * 20
# First runs where a cheap model may save those that a surrogate of many inputs needs; target and largest number of
# runs of the cheap model alone.
_FIRST_RUNS_OF_TWO_MODELS = 12
_TARGET_OF_CHEAP, _RUNS_OF_CHEAP = 0.1, 10_000


class ReliabilityRun:
    """The state of one run.

    Parameters
    ----------
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
    settings : ReliabilitySettings
    limitState : LimitStateEvent, optional
        By default that of event and settings.

    Raises
    ------
    ValueError
        The checkpoint file is damaged, or that of another computation or model; the low-fidelity function has other
        inputs or outputs.

    Attributes
    ----------
    limitState : LimitStateEvent
    recorder : RunRecorder
        All true runs.
    surrogateSampling : SurrogateSampling or None
        The first phase.
    modeSampling : ModeSampling or None
        The second one, where the surrogate did not do.
    history : list of tuple
        After each block: number of runs, estimate, lower and upper bound at 95 %.
    """

    def __init__(self, event: Any, settings: ReliabilitySettings, limitState: LimitStateEvent | None = None) -> None:
        self.event = event
        self.settings = settings
        self.limitState = limitState or LimitStateEvent(
            event,
            settings.function,
            settings.composition,
            settings.smoothIndices,
            settings.surrogateComposition,
            settings.nonFinitePolicy,
        )
        if settings.checkpointFile is not None:
            things = {"distribution": self.limitState.distribution, "event": event, **settings.deciding()}
            file = CheckpointFile(settings.checkpointFile, fingerprintOf(**things), generatorState())
            self.limitState.keepRuns(file.log(), settings.checksModel)
            setGeneratorState(file.start)
            if settings.asks:
                self.limitState.askForRuns()
        self.generator = np.random.default_rng(ot.RandomGenerator.IntegerGenerate(2**31 - 1))
        self.recorder = RunRecorder(self.limitState, settings, self.generator)
        self._wideDesign = WideDesign(self.limitState.dimension, self.generator)
        self.initialSize = self._fullInitialSize = max(12, int(1.5 * self.limitState.dimension + 8))
        self._lowFidelity = None
        if settings.lowFidelity is not None:
            self._lowFidelity = LowFidelity(self.limitState, settings.lowFidelity)
        self.surrogateSampling: SurrogateSampling | None = None
        self.modeSampling: ModeSampling | None = None
        self.history: list[tuple[float, float, float, float]] = []
        self._looks = 0
        self._knownWeights: np.ndarray | None = None

    def compute(self) -> ReliabilityOutcome:
        """Make the run.

        Raises
        ------
        ValueError
            The evaluation limit is too small, an output is not finite, the composition is not the event's variable.
        RuntimeError
            The function failed, or the composition is not defined.
        """
        smallest = self.initialSize + 1
        if self.settings.maximumEvaluations < smallest:
            raise ValueError(
                f"the maximum number of evaluations is {self.settings.maximumEvaluations}; with "
                f"{self.limitState.dimension} inputs at least {smallest} are needed"
            )
        try:
            return self._computePhases()
        except Stopped:
            return self._conclude(Ending.STOPPED)

    def _audits(self, phase):
        number = _AUDITS[self.settings.mode][phase]
        rough = self.settings.targetCoefficientOfVariation > _ROUGH_TARGET and self.settings.mode == "fast"
        return _AUDITS_OF_ROUGH_TARGETS if rough and phase == 0 else number

    # The phases. -----------------------------------------------------------------------------------------------------

    def _computePhases(self):
        recorder, limitState = self.recorder, self.limitState
        if self.settings.knownRuns is not None:
            self._knownWeights = recorder.takeKnown(*self.settings.knownRuns)
        if self._lowFidelity is not None:
            self._runLowFidelity(self._lowFidelity)
        wide = self.initialSize // 2 if limitState.dimension <= FEW_INPUTS else 0
        if wide == 0 and self._lowFidelity is not None:
            # The others are made where the cheap model does not help.
            self.initialSize = _FIRST_RUNS_OF_TWO_MODELS
        first = recorder.evaluateNominal(self.initialSize - wide, "learning")
        recorder.checkComposition(first)
        if first.failed.mean() > _COMPLEMENT_SHARE:
            limitState.takeComplement()
            recorder.takeComplement()
        if wide:
            recorder.explore(self._wideDesign.draw(wide, _FIRST_SPREAD), "exploration")
        runs = recorder.runs()
        margins = runs.margins[runs.finite]
        if len(margins) == 0:
            return self._concludeCrude(Ending.NEVER_FINITE, spend=True)
        if np.ptp(margins) > 0.0:
            limitState.dropUnusedOutputs(runs.outputs[runs.finite])
            ending = self._sampleBySurrogate()
            if ending is not None:
                return self._conclude(ending)
        return self._sampleModes(constant=np.ptp(margins) == 0.0)

    def _runLowFidelity(self, lowFidelity):
        """The probability by the cheap model alone, for where it fails."""
        limitState = copy.copy(lowFidelity.limitState)
        settings = ReliabilitySettings(
            targetCoefficientOfVariation=_TARGET_OF_CHEAP, maximumEvaluations=_RUNS_OF_CHEAP, nonFinitePolicy="safe"
        )
        limitState.nonFinitePolicy = settings.nonFinitePolicy
        try:
            outcome = ReliabilityRun(self.event, settings, limitState).compute()
        except RuntimeError as error:
            raise RuntimeError(f"the low-fidelity function: {error}") from error
        if not limitState.complement:
            lowFidelity.learnFailures(outcome, self.generator)

    def _sampleBySurrogate(self) -> Ending | None:
        """How the run ended in its first phase; None where the second one has to follow."""
        settings, recorder = self.settings, self.recorder
        self.surrogateSampling = sampling = SurrogateSampling(
            recorder,
            self.limitState,
            self.generator,
            self._wideDesign,
            settings.targetCoefficientOfVariation,
            settings.maximumEvaluations,
            self._audits(0),
            self._lowFidelity,
            self._fullInitialSize,
        )
        while True:
            if recorder.remaining() < 2:
                return Ending.EVALUATIONS_USED
            blocks = len(sampling.blocks)
            verdict = sampling.step()
            if verdict is Verdict.REACHED:
                return Ending.TARGET_REACHED
            if verdict is not Verdict.GOES_ON:
                return None
            if len(sampling.blocks) > blocks:
                if blocks == 0:
                    self._estimateByKnownRuns(sampling.blocks)
                ending = self._note(Estimate(sampling.blocks), sampling.settle)
                if ending is not None:
                    return ending

    def _estimateByKnownRuns(self, blocks):
        """A first block of runs that were drawn before, without the surrogate, which has learnt them.

        The variance of a run is expected from the surrogate's failures, never from what the runs themselves gave.
        """
        if self._knownWeights is None or self.settings.knownRuns[2] is None:
            return
        known = dataclasses.replace(self.recorder.blocks[0], weights=self._knownWeights)
        proposal, share = blocks[0].proposal, blocks[0].surrogateProbability
        u = proposal.surrogate.expand(proposal.pool.points, self.generator)
        ratios = self.recorder.densityRatios(self.limitState.space.toPhysical(u), self.settings.knownRuns[2])
        ratio = float(np.average(ratios, weights=proposal.pool.weights * proposal.failure))
        blocks.insert(0, Block(known, 0, blocks[0].known, share * max(ratio - share, 0.0)))

    def _sampleModes(self, constant: bool) -> ReliabilityOutcome:
        """Importance sampling around failure modes, in which the estimate starts anew."""
        settings, recorder = self.settings, self.recorder
        self.modeSampling = sampling = ModeSampling(
            recorder,
            self.limitState,
            self.generator,
            self._wideDesign,
            settings.targetCoefficientOfVariation,
            settings.maximumEvaluations,
            self._audits(1),
            0 if self.surrogateSampling is None else self.surrogateSampling.audited,
        )
        runs = recorder.runs()
        self.history = []
        if not sampling.explore(runs.u[runs.failed]):
            return self._handOver(Ending.CONSTANT if constant else Ending.NO_FAILURE_REGION)
        start = recorder.used()
        while recorder.remaining() > 1:
            estimate = sampling.makeBlock()
            if estimate.coefficientOfVariation() <= settings.targetCoefficientOfVariation and sampling.settle():
                self._note(estimate, lambda: True)
                return self._conclude(Ending.TARGET_REACHED)
            ending = self._note(estimate, sampling.settle)
            if ending is not None:
                return self._conclude(ending)
            spent = recorder.used() - start > _HOPELESS_RUNS * settings.maximumEvaluations
            useless = spent and estimate.coefficientOfVariation() > _HOPELESS_VARIATION
            if useless or (not sampling.blocks and len(sampling.modes) > _TOO_MANY_MODES):
                return self._handOver(Ending.POOR_SURROGATE)
        return self._conclude(Ending.EVALUATIONS_USED)

    def _note(self, estimate: Estimate, settle: Callable[[], bool]) -> Ending | None:
        """Keep the state of the estimate; the ending where it decides on the allowed probability.

        What the wide runs have not seen can only add to the probability, so that "above" needs none of them. The k-th
        look takes ``1 / (k (k + 1))`` of the error that all looks share.
        """
        self.history.append((float(self.recorder.used()), estimate.probability, *estimate.interval(0.95)))
        allowed = self.settings.allowedProbability
        if allowed is None or estimate.effectiveFailures < 4.0 or len(estimate.blocks) < 2:
            return None
        if estimate.coefficientOfVariation() > self.settings.verdictCoefficientOfVariation:
            return None
        self._looks += 1
        lower, upper = estimate.interval(1.0 - _VERDICT_ERROR / (self._looks * (self._looks + 1)))
        if self.limitState.complement:
            lower, upper = 1.0 - upper, 1.0 - lower
        # Without a precision asked for, "above" needs no upper bound.
        unsettled = not self.limitState.complement and math.isinf(self.settings.verdictCoefficientOfVariation)
        if lower > allowed and (unsettled or settle()):
            return Ending.ABOVE_ALLOWED
        if upper < allowed and (self.limitState.complement or settle()):
            return Ending.BELOW_ALLOWED
        return None

    def _handOver(self, ending: Ending) -> ReliabilityOutcome:
        """Subset simulation with the runs that are left; where it finds no failure, crude Monte Carlo bounds it."""
        if ending is Ending.CONSTANT or self.recorder.remaining() < _SUBSET_RUNS:
            few = ending is not Ending.CONSTANT
            return self._concludeCrude(Ending.EVALUATIONS_USED if few else ending, spend=True)
        subset = runSubsetSimulation(
            lambda u: self.recorder.evaluate(u, "subset simulation"),
            self.limitState.dimension,
            self.recorder.remaining(),
            self.generator,
        )
        variation = subset.coefficientOfVariation
        if math.isinf(variation):
            self.recorder.nominal += subset.nominal
            return self._concludeCrude(ending, subset.upperBound, spend=True)
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

    def _spendOnNominalRuns(self):
        """Crude Monte Carlo with the evaluations that are left: nothing tells where better runs would be."""
        recorder, target = self.recorder, self.settings.targetCoefficientOfVariation
        while recorder.remaining() > 0 and not self._crudeEstimate().reaches(target):
            size = max(40, self.limitState.dimension, recorder.used() // 4)
            recorder.evaluateNominal(min(size, recorder.remaining()), "Monte Carlo")

    def _crudeEstimate(self):
        nominal = self.recorder.nominal
        return CrudeEstimate(sum(int(part.failed.sum()) for part in nominal), sum(map(len, nominal)))

    # Ways to end. ----------------------------------------------------------------------------------------------------

    def _conclude(self, ending: Ending) -> ReliabilityOutcome:
        """The estimate so far, whatever it is worth."""
        modes = self.modeSampling
        sampling: Any = self.surrogateSampling if modes is None else modes
        if sampling is None or not sampling.blocks:
            return self._concludeCrude(ending)
        estimate = Estimate(sampling.blocks)
        interval, remarks = estimate.confidenceInterval(), []
        diagnostics = estimate.diagnose()
        if modes is not None:
            diagnostics["modes"] = float(len(modes.modes))
        else:
            diagnostics["calibration"] = sampling.calibration.observed()
        # Only known runs stand before the first ones.
        proposed = sum(block.size for block in sampling.blocks if block.start > 0)
        nominal = sum(map(len, self.recorder.nominal)) + int(NOMINAL_SHARE * proposed)
        if estimate.failures == 0:
            # The surrogate alone says where failures would be, and true runs have found none there.
            interval = ConfidenceInterval(failures=0, runs=nominal)
            self.history = []
            remarks.append(f"no run failed, and only about {nominal} crude Monte Carlo runs bound the probability")
        elif not sampling.settled:
            interval = ConfidenceInterval(estimate.probability, estimate.variance, estimate.freedom, lowerOnly=True)
            remarks.append(
                "the probability is at least the lower bound: failures were seen, or may be there, that the estimate "
                "lacks"
            )
        if modes is not None and len(modes.modes) > 1 and self.settings.function is None:
            remarks.append(
                f"{len(modes.modes)} failure modes were found: where the function can give a margin for each, "
                "components (setComponents) save runs"
            )
        method = "ActiveSubspace" if modes is None else "ImportanceSampling"
        blocks, limitState, seed = list(sampling.blocks), self.limitState, int(self.generator.integers(2**31))
        return self._outcome(
            ending,
            *remarks,
            method=method,
            converged=ending in (Ending.TARGET_REACHED, Ending.ABOVE_ALLOWED, Ending.BELOW_ALLOWED),
            probability=min(max(estimate.probability, 0.0), 1.0),
            variance=estimate.variance,
            interval=interval,
            surrogateProbability=estimate.surrogateProbability or None,
            diagnostics=diagnostics,
            audits=sampling.audited,
            auditSpread=sampling.spread,
            estimate=estimate,
            # The same whenever it is asked for.
            failureSample=Deferred(lambda: Estimate(blocks).makeFailureSample(limitState, np.random.default_rng(seed))),
        )

    def _concludeCrude(
        self, ending: Ending, levelReached: float | None = None, spend: bool = False
    ) -> ReliabilityOutcome:
        """The crude Monte Carlo runs of the event itself are what is left where nothing else is; more where asked."""
        if self.limitState.complement:
            self.limitState.takeComplement()
            self.recorder.takeComplement()
        if spend:
            self._spendOnNominalRuns()
        for part in self.recorder.nominal:
            part.weights = np.ones(len(part))
        runs, estimate = Runs.concatenate(self.recorder.nominal), self._crudeEstimate()
        remarks = [f"the estimate is from {estimate.size} crude Monte Carlo runs"]
        if levelReached is not None:
            remarks.insert(
                0,
                "subset simulation found no failure before the evaluations ended, at a level of probability "
                f"{levelReached:.1e}, an "
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
            diagnostics={"true failures": float(estimate.failures)},
            levelReached=levelReached,
            failureSample=Deferred(lambda: FailureSample.ofMonteCarlo(runs.x, runs.failed)),
        )

    def _outcome(self, ending, *remarks, diagnostics, surrogateProbability=None, estimate=None, **fields):
        """The outcome with what is the same however a run ends."""
        settings, limitState = self.settings, self.limitState
        surrogate = None if self.surrogateSampling is None else self.surrogateSampling.surrogate
        runs = self.recorder.runs()
        if estimate is not None:
            estimate.mark(runs)
        if limitState.unknownNumber:
            remarks += (f"{limitState.unknownNumber} runs far from where inputs are likely gave no value",)
        if len(np.unique(runs.margins[runs.finite])) == 2:
            remarks += (
                "the event's variable takes only two values, which say of no run how near the limit is: a margin, or "
                "components (setComponents), would need fewer runs",
            )
        sentence = ending.value.format(
            target=settings.targetCoefficientOfVariation,
            maximum=settings.maximumEvaluations,
            first=self.initialSize,
            allowed=settings.allowedProbability,
        )
        searches = [part.search.gradients for part in (self.surrogateSampling, self.modeSampling) if part is not None]
        common = {
            "event": self.event,
            "distribution": limitState.distribution,
            "surrogateProbability": surrogateProbability,
            "phases": dict(self.recorder.phases),
            "diagnostics": diagnostics
            | {"not finite": float(limitState.nonFiniteNumber), "no value": float(limitState.unknownNumber)}
            | ({} if self._lowFidelity is None else {"low-fidelity runs": float(self._lowFidelity.evaluations)}),
            "gradients": sum(searches),
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
        outcome = ReliabilityOutcome(**(common | fields))
        return outcome.ofComplement() if limitState.complement else outcome
