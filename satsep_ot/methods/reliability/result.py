"""What ActiveSubspaceReliability has found, how sure it is, and what it rests on."""

import dataclasses
import math
import os
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.deprecation import DeprecatedAlias
from satsep_ot.methods.common.intervals import ConfidenceInterval
from satsep_ot.methods.common.storage import readResult, storedFormat, writeResult
from satsep_ot.methods.reliability import graphs, sensitivity
from satsep_ot.methods.reliability.limit_state import Runs
from satsep_ot.methods.reliability.outcome import Deferred, Ending, ReliabilityOutcome
from satsep_ot.methods.reliability.sensitivity import (
    FailureSample,
    InputImportance,
    ParameterSensitivity,
    ReweightedProbability,
)
from satsep_ot.methods.reliability.surrogate_view import SurrogateView
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.openturns_adapter import fromXML, isPython
from satsep_ot.openturns_object import OpenTURNSObject

_FORMAT, _FORMAT_OF_0_1_0 = "ActiveSubspaceReliabilityResult 4", "ActiveSubspaceReliabilityResult 3"


class ActiveSubspaceReliabilityResult(OpenTURNSObject):
    """Result of :class:`~satsep_ot.methods.reliability.algorithm.ActiveSubspaceReliability`; made by its ``run()``.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
    >>> ot.RandomGenerator.SetSeed(0)
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["a + b"]), ot.RandomVector(ot.Normal(2)))
    >>> algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 4.0))
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> result.getConfidenceInterval(0.95).contains([ot.Normal().computeComplementaryCDF(4.0 / 2.0**0.5)])
    True
    >>> result.getEvaluationNumber() == sum(result.getPhases().values())
    True

    What a mean of 0.1 instead of 0 would do to the probability, without another run:

    >>> shifted = ot.Normal([0.1, 0.0], [1.0, 1.0], ot.CorrelationMatrix(2))
    >>> f"{result.computeProbability(shifted).probability / result.getProbabilityEstimate():.1f}"
    '1.2'
    """

    def __init__(self, outcome: ReliabilityOutcome) -> None:
        self._outcome = outcome

    def __setstate__(self, state):
        # A pickle of version 0.1.0 has each field as an attribute.
        if "_outcome" not in state:
            fields = {name.removeprefix("_"): value for name, value in state.items()}
            sample = fields["failureSample"]
            if sample is not None:
                values = dict(vars(sample))
                fields["failureSample"] = FailureSample(leastVariances=values.pop("expected"), **values)
            state = {"_outcome": _outcomeOf(_upgraded(fields))}
        vars(self).update(state)

    def _shown(self):
        lower, upper = self._outcome.interval.bounds(0.95)
        return {
            "probability": f"{self._outcome.probability:.4e}",
            "interval": f"[{lower:.4e}, {upper:.4e}]",
            "evaluations": self.getEvaluationNumber(),
            "converged": self._outcome.converged,
        }

    def getProbabilityEstimate(self) -> float:
        """The unbiased estimate of the probability of the event."""
        return self._outcome.probability

    def getEventProbability(self) -> float:
        """The same under the name that OpenTURNS' results of approximations such as FORM have."""
        return self._outcome.probability

    def getProbabilityDistribution(self) -> ot.Distribution:
        """What the confidence intervals say, as one distribution: its bilateral interval at any level is about
        `getConfidenceInterval`, exactly so at 90, 95 and 99 %.

        OpenTURNS' own results have a normal one here, whose lower bounds may be negative.
        """
        return self._outcome.interval.distribution()

    def getTimeDuration(self) -> float:
        """Seconds that ``run()`` took, those in the function included; 0 in a result of version 0.1.0."""
        return self._outcome.seconds

    def getVarianceEstimate(self) -> float:
        """Variance of the estimate."""
        return self._outcome.variance

    def getStandardDeviation(self) -> float:
        """Standard deviation of the estimate."""
        return math.sqrt(self._outcome.variance)

    def getCoefficientOfVariation(self) -> float:
        """Standard deviation over the estimate; infinite when the estimate is 0."""
        return (
            math.sqrt(self._outcome.variance) / self._outcome.probability
            if self._outcome.probability > 0.0
            else math.inf
        )

    def getConfidenceInterval(self, level: float = 0.95) -> ot.Interval:
        """Confidence interval of the probability, never empty.

        With no failure seen it is [0, about 3 / n] at 95 %, where n counts only the runs drawn from the distribution of
        the inputs itself; runs that a surrogate or subset simulation has proposed say nothing of other regions.
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"the confidence level is {level}; it must lie between 0 and 1")
        return ot.Interval(*self._outcome.interval.bounds(level))

    def getInterval(self) -> ConfidenceInterval:
        """What `getConfidenceInterval` follows from, at all levels."""
        return self._outcome.interval

    def getReliabilityIndex(self) -> float:
        """Generalised reliability index ``-Phi^-1(p)``; infinite when the estimate is 0 or 1."""
        if self._outcome.probability <= 0.0 or self._outcome.probability >= 1.0:
            return math.inf if self._outcome.probability <= 0.0 else -math.inf
        return -ot.DistFunc.qNormal(self._outcome.probability)

    def getSurrogateProbability(self) -> float | None:
        """The surrogate's own probability, **not** corrected and without a guarantee; None without a surrogate."""
        return self._outcome.surrogateProbability if self._outcome.method == "ActiveSubspace" else None

    def getEvaluationNumber(self, phase: str | None = None) -> int:
        """Number of true runs, of all phases or of one (see `getPhases`)."""
        if phase is None:
            return sum(self._outcome.phases.values())
        if phase not in self._outcome.phases:
            raise ValueError(f"there is no phase {phase!r}; there are {', '.join(self._outcome.phases)}")
        return self._outcome.phases[phase]

    def getPhases(self) -> dict[str, int]:
        """True runs of each phase."""
        return dict(self._outcome.phases)

    def getGradientNumber(self) -> int:
        """Number of exact gradients that were used to find failure modes; differences of runs count as runs."""
        return self._outcome.gradients

    def getAuditNumber(self) -> int:
        """Number of wide runs, which looked in all directions for failures that the estimate lacks."""
        return self._outcome.audits

    def getAuditSpread(self) -> float:
        """Standard deviation of the last wide runs, in standard space; 0 where there were none."""
        return self._outcome.auditSpread

    def computeEscapeProbability(self, share: float) -> float:
        """Probability that all wide runs miss a failure region that a share of such runs would hit.

        It is that of independent wide runs, ``(1 - share)^m``; these are spread more evenly and miss less.

        Parameters
        ----------
        share : float
            Probability of the region under N(0, s^2 I) in standard space, s the spread of the wide runs.
        """
        if not 0.0 <= share <= 1.0:
            raise ValueError(f"the share is {share}; it must lie between 0 and 1")
        return (1.0 - share) ** self._outcome.audits

    def getMethod(self) -> str:
        """Where the estimate comes from.

        ``"ActiveSubspace"``: a surrogate corrected by true runs. ``"ImportanceSampling"``: true runs around failure
        modes, where no surrogate does. ``"SubsetSimulation"``, or ``"MonteCarlo"`` where nothing was found: neither by
        that nor in a constant.
        """
        return self._outcome.method

    def getActiveDimensions(self) -> list[int]:
        """Number of active directions of each smooth component; empty without a surrogate."""
        return [] if self._outcome.view is None else list(self._getView().dimensions)

    def getDirections(self) -> ot.Matrix:
        """Orthonormal basis (d, k) of all active directions in standard space."""
        return ot.Matrix(self._getView().directions)

    def getDiagnostics(self) -> dict[str, float]:
        """Named numbers that tell how far the estimate can be trusted.

        ``effective sample size`` and ``largest weight share`` of the weights of the failed runs, ``Pareto k`` of the
        corrections (above 0.7 the interval is not to be trusted), ``true failures``, ``calibration`` (root mean square
        of the standardised errors of prediction of runs not yet seen, 1 when the surrogate knows its error), ``plain
        importance sampling`` (the estimate without the surrogate), ``missed failures`` (failed runs to which the
        surrogate gave less than 1 %), ``modes`` (failure modes found, where the estimate is importance sampling), ``not
        finite``, and ``no value`` (runs far from where inputs are likely in which the function failed).
        """
        return dict(self._outcome.diagnostics)

    def getConverged(self) -> bool:
        """Whether the target was reached with enough true failures and blocks."""
        return self._outcome.converged

    def getReason(self) -> str:
        """How the run ended, in a sentence, with what the estimate does not exclude."""
        outcome, sentence = self._outcome, self.getEndingSentence()
        if outcome.unseenBound is not None:
            bound = f"{outcome.unseenBound:.1e}"
            return f"{sentence}; a failure region of probability below {bound} that no run has reached is not excluded"
        if outcome.audits and outcome.converged:
            return (
                f"{sentence}; {outcome.audits} runs of {outcome.auditSpread:.1f} times the spread of the inputs looked "
                "in all directions: a region that a share x of such runs would hit escapes so many independent ones "
                f"with a probability of (1 - x)^{outcome.audits}"
            )
        return sentence

    def getEndingSentence(self) -> str:
        """How the run ended, in a sentence, without what `getUnseenBound` says."""
        return self._outcome.reason

    def getEnding(self) -> Ending:
        """How the run ended, as one of a few cases."""
        return self._outcome.ending

    def getUnseenBound(self) -> float | None:
        """Of a result of version 0.1.0: probability up to which a region that no run has reached is not excluded.

        None in other results, which say what their wide runs would have missed (`computeEscapeProbability`).
        """
        return self._outcome.unseenBound

    def getLevelReached(self) -> float | None:
        """Probability of the last level of a subset simulation that found no failure: an estimate, no bound.

        None where there was none.
        """
        return self._outcome.levelReached

    def getInputSample(self) -> ot.Sample:
        """Inputs of all true runs, under their names."""
        sample = ot.Sample(self._outcome.runs.x)
        sample.setDescription(self._outcome.distribution.getDescription())
        return sample

    def getOutputSample(self) -> ot.Sample:
        """Outputs of all true runs, under their names."""
        sample = ot.Sample(self._outcome.runs.outputs)
        sample.setDescription(self._outcome.outputDescription)
        return sample

    def getTrueRuns(self, outputNames: Sequence[str] | None = None) -> TrueRuns:
        """All true runs with their phases and weights, from which the estimate can be computed again, and saved.

        The run of the phase "composition check" is not among them: it is the event's own function, called once more at
        an input that is among them.

        Parameters
        ----------
        outputNames : sequence of str, optional
            By default the names of the function's outputs.
        """
        runs = self._outcome.runs
        return TrueRuns(
            runs.x,
            runs.outputs,
            runs.failed,
            runs.phases,
            runs.weights,
            runs.expected,
            tuple(self._outcome.distribution.getDescription()),
            tuple(self._outcome.outputDescription if outputNames is None else outputNames),
            self._outcome.surrogateProbability or 0.0,
        )

    def getEvent(self) -> ot.RandomVector:
        """The event whose probability it is.

        Raises
        ------
        RuntimeError
            Its function is in Python, so that it was not stored with a result that was loaded.
        """
        if self._outcome.event is None:
            raise RuntimeError("the event was not stored with the result; give it to load()")
        return self._outcome.event

    def getProbabilitySimulationResult(self) -> ot.ProbabilitySimulationResult:
        """The estimate as OpenTURNS' own result."""
        size = self.getEvaluationNumber()
        return ot.ProbabilitySimulationResult(
            self.getEvent(), self._outcome.probability, self._outcome.variance, size, 1
        )

    def getMetaModelResult(self) -> ot.MetaModelResult:
        """The surrogate of the smooth outputs as a native function of the physical inputs, with its runs."""
        view = self._getView()
        if view.metaModel is None:
            raise ValueError(view.reason)
        kept = self._outcome.runs.finite
        return ot.MetaModelResult(ot.Sample(self._outcome.runs.x[kept]), ot.Sample(view.outputs[kept]), view.metaModel)

    def getStandardSpaceDesignPoint(self) -> ot.Point:
        """The most likely violation found, in standard space: the failed true run nearest to the origin.

        A start of FORM; by itself it lies beyond the limit state, not on it.

        Raises
        ------
        RuntimeError
            No run has failed.
        """
        return ot.Point(self._outcome.runs.u[self._mostLikelyFailure()])

    def getPhysicalSpaceDesignPoint(self) -> ot.Point:
        """The most likely violation found, in physical units, see `getStandardSpaceDesignPoint`."""
        return ot.Point(self._outcome.runs.x[self._mostLikelyFailure()])

    def _mostLikelyFailure(self):
        runs = self._outcome.runs
        if not runs.failed.any():
            raise RuntimeError("no run has failed, so nothing is known of the failures")
        return int(np.argmin(np.where(runs.failed, (runs.u**2).sum(axis=1), np.inf)))

    # What the same true runs say beside the probability. ------------------------------------------------------------

    def computeParameterSensitivity(self, level: float = 0.95) -> list[ParameterSensitivity]:
        """Derivative of the probability with respect to every parameter of every input's distribution.

        From the true runs already made, by the score function, the copula held fixed.

        Parameters
        ----------
        level : float
            Of the intervals.

        Returns
        -------
        rows : list of :class:`~satsep_ot.methods.reliability.sensitivity.ParameterSensitivity`

        Raises
        ------
        RuntimeError
            No failure was seen, or the estimate is by subset simulation.
        """
        return sensitivity.computeParameterSensitivity(self._getFailureSample(level), self._outcome.distribution, level)

    def computeImportance(self, level: float = 0.95) -> list[InputImportance]:
        """Importance of each input for the event, from the true runs already made.

        Returns
        -------
        rows : list of :class:`~satsep_ot.methods.reliability.sensitivity.InputImportance`

        Raises
        ------
        RuntimeError
            No failure was seen, the estimate is by subset simulation, or it is not positive.
        """
        return sensitivity.computeImportance(self._getFailureSample(level), self._outcome.distribution, level)

    def getImportanceFactors(self) -> ot.PointWithDescription:
        """Share of each input in what tells failure from the inputs' distribution, see `computeImportance`.

        For a linear limit state of independent inputs these are about the importance factors of FORM.

        Raises
        ------
        RuntimeError
            As `computeImportance`.
        """
        return ot.PointWithDescription([(row.input, row.share) for row in self.computeImportance()])

    def computeProbability(self, distribution: ot.Distribution, level: float = 0.95) -> ReweightedProbability:
        """The probability if the inputs had another distribution, from the true runs already made.

        Parameters
        ----------
        distribution : :py:class:`openturns.Distribution`
            Of the same inputs; it may not reach beyond finite bounds of the first one.
        level : float
            Of the interval.

        Returns
        -------
        answer : :class:`~satsep_ot.methods.reliability.sensitivity.ReweightedProbability`
            With a warning where the weights no longer carry it.

        Raises
        ------
        ValueError
            The distribution has another dimension or reaches where no run can have been.
        RuntimeError
            No failure was seen, or the estimate is by subset simulation.
        """
        return sensitivity.computeProbability(
            self._getFailureSample(level), self._outcome.distribution, distribution, level
        )

    def getFailureSample(self) -> sensitivity.FailureSample:
        """The weighted points of the estimate, and which of its true runs have failed.

        Returns
        -------
        sample : :class:`~satsep_ot.methods.reliability.sensitivity.FailureSample`

        Raises
        ------
        RuntimeError
            No failure was seen, or the estimate is by subset simulation.
        """
        return self._getFailureSample(0.95)

    def _getFailureSample(self, level):
        if not 0.0 < level < 1.0:
            raise ValueError(f"the confidence level is {level}; it must lie between 0 and 1")
        if self._outcome.failureSample is None:
            raise RuntimeError(
                "the estimate is by subset simulation, whose runs are dependent: they give no sensitivities"
            )
        sample = self._outcome.failureSample.get()
        if not sample.failed.any():
            raise RuntimeError("no run has failed, so nothing is known of the failures")
        return sample

    def _getView(self):
        if self._outcome.view is None:
            raise RuntimeError("there is no surrogate, so there are no active directions")
        return self._outcome.view.get()

    # Files. ----------------------------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike) -> None:
        """Write the result to one file: an .npz archive of its arrays, a JSON document and OpenTURNS' XML.

        The file is written whole or not at all. The event is stored where its function is native to OpenTURNS;
        otherwise it has to be given to `load`.

        Parameters
        ----------
        path : str or path
            Ends on ``.npz``.
        """
        fields = {field.name: getattr(self._outcome, field.name) for field in dataclasses.fields(self._outcome)}
        fields = {name: value.get() if isinstance(value, Deferred) else value for name, value in fields.items()}
        # An event whose function is in Python would be stored as code that runs on loading.
        event = None if isPython(self._outcome.event) else self._outcome.event
        writeResult(path, _FORMAT, fields | {"ending": self._outcome.ending.name, "event": event})

    @staticmethod
    def load(path: str | os.PathLike, event: Any | None = None) -> "ActiveSubspaceReliabilityResult":
        """The result that `save` has written.

        Parameters
        ----------
        path : str or path
        event : optional
            Needed for `getEvent` and `getProbabilitySimulationResult` only, where the event's function is in Python.

        Raises
        ------
        ValueError
            The file is not such a result.
        """
        classes: dict[str, Callable[..., Any]] = {
            "runs": Runs,
            "interval": ConfidenceInterval,
            "view": SurrogateView,
            "failureSample": FailureSample,
        }
        objects = {"distribution": ot.Distribution(), "event": ot.RandomVector()}
        if storedFormat(path) == _FORMAT_OF_0_1_0:
            classes["failureSample"] = lambda expected, **values: FailureSample(leastVariances=expected, **values)
            fields = _upgraded(readResult(path, _FORMAT_OF_0_1_0, classes, objects))
        else:
            fields = readResult(path, _FORMAT, classes, objects)
            fields["ending"] = Ending[fields["ending"]]
        if fields["event"] is None:
            fields["event"] = event
        view = fields["view"]
        if view is not None and view.metaModel is not None:
            view.metaModel = fromXML(view.metaModel, ot.Function())
        fields["history"] = [tuple(row) for row in fields["history"]]
        return ActiveSubspaceReliabilityResult(_outcomeOf(fields))

    # Graphs. ---------------------------------------------------------------------------------------------------------

    def drawProbabilityConvergence(self) -> ot.Graph:
        """Estimate and 95 % interval against the number of true runs."""
        return graphs.drawConvergence(self._outcome.history)

    drawConvergence = DeprecatedAlias("drawProbabilityConvergence")

    def drawImportanceFactors(self) -> ot.Graph:
        """A pie of `getImportanceFactors`; `drawImportance` shows intervals and in which direction inputs fail.

        Raises
        ------
        RuntimeError
            As `computeImportance`.
        """
        return ot.SobolIndicesAlgorithm.DrawImportanceFactors(self.getImportanceFactors(), "Importance factors")

    def drawLimitState(self) -> ot.Graph:
        """Limit state of the surrogate in the first two active directions, with the true runs on it."""
        return graphs.drawLimitState(self._getView(), self._outcome.runs)

    def drawWeights(self) -> ot.Graph:
        """Share of the estimate that the failed runs of largest weight carry: the nearer to the diagonal, the better.

        Raises
        ------
        RuntimeError
            No failure was seen, or the estimate is by subset simulation.
        """
        return graphs.drawWeights(self._getFailureSample(0.5))

    def drawImportance(self, level: float = 0.95, number: int = 10) -> ot.Graph:
        """Mean and spread in failure of the most important inputs, in standard deviations, with intervals.

        Parameters
        ----------
        level : float
            Of the intervals.
        number : int
            Inputs shown.

        Raises
        ------
        RuntimeError
            No failure was seen, or the estimate is by subset simulation.
        """
        return graphs.drawImportance(self.computeImportance(level), number)


def _outcomeOf(fields):
    """The outcome of stored fields, in which what was computed on demand is there."""
    for name in ("view", "failureSample"):
        if fields[name] is not None:
            fields[name] = Deferred(lambda value=fields[name]: value)
    return ReliabilityOutcome(**fields)


def _upgraded(fields):
    """The fields of a result of version 0.1.0, which told how it ended in a sentence alone."""
    reason = fields["reason"]
    ending = next(ending for ending in Ending if reason.startswith(ending.value.partition("{")[0]))
    bound = fields["diagnostics"]["unseen bound"] if "is not excluded" in reason else None
    level = reason.partition("at a level of probability ")[2].partition(",")[0]
    return fields | {
        "ending": ending,
        # What is not excluded is said from the bound.
        "reason": reason.partition("; a failure region of probability below")[0],
        "unseenBound": bound,
        "levelReached": float(level) if level else None,
    }
