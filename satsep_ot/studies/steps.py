"""What the steps of a study compute that can be made side by side, each from its own seed."""

import dataclasses
import math
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.comparison.active_subspace import ActiveSubspace
from satsep_ot.methods.comparison.comparison import ReliabilityComparison
from satsep_ot.methods.comparison.method import ReliabilityMethod
from satsep_ot.methods.comparison.methods import METHODS
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.model.case import SYSTEM
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.openturns_adapter import errorMessage, raiseInterrupt
from satsep_ot.studies import drivers
from satsep_ot.studies.surrogates import fit_component
from satsep_ot.studies.telling.results import Component, Estimate, HalvedTolerance
from satsep_ot.studies.telling.verdicts import Status, deciding_precision, judge
from satsep_ot.studies.telling.words import StudyMethod

# Where no precision is asked for: the coefficients of variation that a verdict waits for, without advice and with
# advice on tolerances, which rests on the same runs.
VERDICT_PRECISION, ADVICE_PRECISION = 0.1, 0.05
# Runs of ActiveSubspace for a requirement, at a precision of 5 % and above.
_BUDGET = 5000
# They are spent on an undecided requirement where it is expected to take at most so many times what is left of them.
_HOPEFUL = 2.0


@dataclasses.dataclass(frozen=True)
class Made:
    """What a step has made.

    Attributes
    ----------
    value : Estimate or HalvedTolerance
    runs : TrueRuns or None
        The runs that it took; None where none are kept.
    result : ActiveSubspaceReliabilityResult or None
        Of an estimate by ActiveSubspace.
    """

    value: Any
    runs: TrueRuns | None = None
    result: ActiveSubspaceReliabilityResult | None = None


@dataclasses.dataclass(frozen=True)
class StudySteps:
    """The steps of a study that follow from its case and settings alone.

    Attributes
    ----------
    problem : :class:`satsep_ot.model.separation_problem.SeparationProblem`
    seed : int
        Of the study; each step starts from one made of this and its own name.
    precision : float or None
        Coefficient of variation at which ActiveSubspace ends. None: as soon as the requirement is decided and the
        probability known as well as it has to be, or the runs are spent.
    advises : bool
        Whether advice on tolerances rests on the estimates.
    """

    problem: SeparationProblem
    seed: int
    precision: float | None
    advises: bool = True

    def start(self, *names: str) -> None:
        """Set OpenTURNS' seed to that of the step with these names."""
        digits = np.frombuffer("/".join(names).encode(), dtype=np.uint8)
        ot.RandomGenerator.SetSeed(int(np.random.SeedSequence([self.seed, *digits]).generate_state(1)[0] >> 1))

    @property
    def level_together(self) -> float:
        """The level of each interval at which those of all requirements hold at once with 95 % (Bonferroni)."""
        return 1.0 - 0.05 / len(self.problem.getRequirements())

    def event(self, requirement: str) -> ot.RandomVector:
        """The event that a requirement, or any of them, is violated."""
        return self.problem.getSystemEvent() if requirement == SYSTEM else self.problem.getEvent(requirement)

    def estimate(self, requirement: str, name: StudyMethod) -> Made:
        """The probability of violating a requirement by a method other than MonteCarlo."""
        self.start(requirement, name)
        if name == StudyMethod.ACTIVE_SUBSPACE:
            return self._estimate_by_active_subspace(requirement)
        parts: list[tuple[np.ndarray, np.ndarray]] = []
        comparison = self._comparison(requirement, METHODS[name]())
        comparison.setRunsCallback(lambda inputs, outputs: parts.append((inputs, outputs)))
        comparison.run()
        runs = _unweighted(name, self.event(requirement), parts) if parts else None
        return Made(Estimate.of(requirement, comparison.getResult().getRows()[0]), runs)

    def halve(self, requirement: str, tolerance: str) -> Made:
        """The probability of violating a requirement with half the scatter of one tolerance."""
        self.start(requirement, "half", tolerance)
        case = drivers.scaled_case(self.problem.getCase(), tolerance, 0.5)
        try:
            result = drivers.changed_probability(case, requirement)
        except Exception as error:
            # As with a method that fails: the study's other numbers stand without this one.
            raiseInterrupt(error)
            return Made(HalvedTolerance(tolerance, 0.5, note=f"{type(error).__name__}: {errorMessage(error)}"))
        interval = result.getConfidenceInterval(0.95)
        halved = HalvedTolerance(
            tolerance,
            0.5,
            result.getProbabilityEstimate(),
            interval.getLowerBound()[0],
            interval.getUpperBound()[0],
            result.getEvaluationNumber(),
            result.getConverged(),
            result.getEndingSentence(),
        )
        return Made(halved, result.getTrueRuns(self._output_description(requirement)))

    def fit_component(
        self, name: str, values: np.ndarray, gradients: np.ndarray, points: np.ndarray
    ) -> Component | None:
        """The active subspace and regression of a smooth component; see :func:`satsep_ot.studies.surrogates`."""
        self.start("subspace", name)
        return fit_component(self.problem.getDistribution(), points, values, gradients)

    def _comparison(self, requirement: str, method: ReliabilityMethod) -> ReliabilityComparison:
        comparison = ReliabilityComparison(self.event(requirement), [method])
        comparison.setMaximumEvaluations(None)
        comparison.setComponents(*self.problem.getComponents(None if requirement == SYSTEM else requirement))
        return comparison

    def _output_description(self, requirement):
        function, _, _, _ = self.problem.getComponents(None if requirement == SYSTEM else requirement)
        return function.getOutputDescription()

    def _estimate_by_active_subspace(self, requirement):
        if self.precision is not None:
            budget = math.ceil(_BUDGET * max(1.0, (0.05 / self.precision) ** 2))
            return self._run_active_subspace(requirement, ActiveSubspace(self.precision, budget))
        allowed = self._allowed(requirement)
        first = self._run_active_subspace(
            requirement,
            ActiveSubspace(
                ADVICE_PRECISION,
                _BUDGET,
                allowedProbability=allowed,
                verdictCoefficientOfVariation=ADVICE_PRECISION if self.advises else VERDICT_PRECISION,
            ),
        )
        if allowed is None or judge(requirement, [first.value], allowed).status is not Status.UNDECIDED:
            return first
        left, precision = _BUDGET - first.value.evaluations, deciding_precision(first.value, allowed)
        needed = first.value.evaluations * (first.value.coefficient_of_variation / precision) ** 2
        if needed > _HOPEFUL * left:
            # Runs that would most likely leave it open are for the user to ask for.
            return first
        second = self._run_active_subspace(requirement, ActiveSubspace(precision, left, allowedProbability=allowed))
        return _sharper(first, second)

    def _allowed(self, requirement):
        entries = {entry.name: entry.allowed_probability for entry in self.problem.getRequirements()}
        return entries.get(requirement)

    def _run_active_subspace(self, requirement, method):
        comparison = self._comparison(requirement, method)
        comparison.run()
        estimate = Estimate.of(requirement, comparison.getResult().getRows()[0])
        if estimate.probability is None:
            return Made(estimate)
        result = method.getLastResult()
        # A table says once for all requirements what their wide runs would have missed.
        estimate = dataclasses.replace(
            estimate,
            note=result.getEndingSentence(),
            audits=result.getAuditNumber(),
            audit_spread=result.getAuditSpread(),
            upper_together=result.getConfidenceInterval(self.level_together).getUpperBound()[0],
        )
        return Made(estimate, result.getTrueRuns(self._output_description(requirement)), result)


def _sharper(first: Made, second: Made) -> Made:
    """The second of two estimates where it has ended by itself, else the first; the runs are those of both."""
    kept, other = (second, first) if second.value.converged else (first, second)
    note = f"{kept.value.note}; {other.value.evaluations:,} further runs "
    note += "came before it and left the verdict open" if kept is second else "have not decided it"
    both = dataclasses.replace(
        kept.value,
        evaluations=first.value.evaluations + second.value.evaluations,
        gradients=first.value.gradients + second.value.gradients,
        seconds=first.value.seconds + second.value.seconds,
        note=note,
    )
    return dataclasses.replace(kept, value=both)


def _unweighted(phase, event, parts):
    """Runs of a method that gives its runs no weights."""
    inputs, outputs = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    happens, threshold = event.getOperator(), event.getThreshold()
    failed = np.array([happens.compare(value, threshold) for value in outputs[:, 0].tolist()])
    function = event.getFunction()
    return TrueRuns.ofSample(
        inputs, outputs, failed, function.getInputDescription(), function.getOutputDescription(), phase, np.nan
    )


@dataclasses.dataclass(frozen=True)
class Step:
    """One step to be made: its names, the kind of its value, the method of `StudySteps` with its arguments, a label."""

    names: tuple[str, ...]
    kind: type
    method: str
    arguments: tuple[str, ...]
    label: str

    def make(self, steps: StudySteps) -> Made:
        """What the step makes."""
        return getattr(steps, self.method)(*self.arguments)
