"""How a run ended, and what it has found, field by field."""

import dataclasses
import enum
from collections.abc import Callable
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.intervals import ConfidenceInterval
from satsep_ot.methods.reliability.limit_state import Runs
from satsep_ot.methods.reliability.sensitivity import FailureSample

# Phases whose runs follow the distribution of the inputs itself.
NOMINAL_PHASES = ("learning", "Monte Carlo", "known, drawn")


class Ending(enum.Enum):
    """How the run of an `ActiveSubspaceReliability` ended; the value is the beginning of its sentence.

    Examples
    --------
    >>> from satsep_ot.methods.reliability.outcome import Ending
    >>> Ending.STOPPED.value
    'stopped by the stop callback'
    """

    TARGET_REACHED = "the target coefficient of variation, {target}, was reached"
    EVALUATIONS_USED = "the maximum number of evaluations, {maximum}, was reached"
    ABOVE_ALLOWED = "the probability is above the allowed one, {allowed}, with 95 % confidence over all looks"
    BELOW_ALLOWED = "the probability is below the allowed one, {allowed}, with 95 % confidence over all looks"
    STOPPED = "stopped by the stop callback"
    CONSTANT = "the event's variable is constant in the first {first} runs, so nothing can be learnt"
    NEVER_FINITE = "the event's variable is not finite in any of the first {first} runs, so nothing can be learnt"
    NO_FAILURE_REGION = "handed over to subset simulation: the surrogate shows no failure region"
    FAILURES_MISSED = "handed over to subset simulation: true runs have failed where the surrogate is sure of safety"
    POOR_SURROGATE = (
        "handed over to subset simulation: the surrogate explains too little of the limit state: no usable active "
        "subspace"
    )


class Deferred:
    """A value that is computed when it is first asked for; in a pickle it is the value alone.

    Parameters
    ----------
    compute : callable
        Gives the value.

    Examples
    --------
    >>> from satsep_ot.methods.reliability.outcome import Deferred
    >>> Deferred(lambda: 6 * 7).get()
    42
    """

    def __init__(self, compute: Callable[[], Any]) -> None:
        self._compute: Callable[[], Any] | None = compute
        self._value: Any = None

    def get(self) -> Any:
        """The value."""
        if self._compute is not None:
            self._value, self._compute = self._compute(), None
        return self._value

    def __getstate__(self):
        return {"_compute": None, "_value": self.get()}


@dataclasses.dataclass(kw_only=True)
class ReliabilityOutcome:
    """What a run has found; `ActiveSubspaceReliabilityResult` answers from it, and stores it field by field.

    Attributes
    ----------
    event : event, or None
        None in a result that was loaded, where its function is in Python.
    distribution : :py:class:`openturns.Distribution`
    probability, variance : float
        The estimate and its variance.
    interval : ConfidenceInterval
    surrogateProbability : float or None
        The surrogate's own probability, not corrected; 1 where it is of the complement and there is no surrogate.
    phases : dict of str to int
        Evaluations of each phase.
    diagnostics : dict of str to float
    method : str
        ``"ActiveSubspace"``, ``"SubsetSimulation"`` or ``"MonteCarlo"``: what the estimate comes from.
    converged : bool
    ending : Ending
    reason : str
        The ending in words, with what else is to be known of the estimate.
    unseenBound : float or None
        Of a result of version 0.1.0: a failure region that no run has reached may have a probability up to this, and
        the interval says nothing of it. None where the interval covers it, or the estimate is larger.
    levelReached : float or None
        Probability of the last level of a subset simulation that found no failure: an estimate, no bound.
    runs : Runs
    history : list of tuple
        After each block: number of runs, estimate, lower and upper bound at 95 %.
    view : Deferred or None
        The `SurrogateView`; None without a surrogate.
    failureSample : Deferred or None
        The `FailureSample`; None after subset simulation.
    outputDescription : list of str
    audits : int
        Wide runs that looked in all directions for failures that the estimate lacks.
    auditSpread : float
        Standard deviation of the last of them, in standard space.
    gradients : int
        Exact gradients that were used.
    seconds : float
        That the run took; 0 in a result of version 0.1.0.
    """

    event: Any
    distribution: ot.Distribution
    probability: float
    variance: float
    interval: ConfidenceInterval
    surrogateProbability: float | None
    phases: dict[str, int]
    diagnostics: dict[str, float]
    method: str
    converged: bool
    ending: Ending
    reason: str
    unseenBound: float | None
    levelReached: float | None
    runs: Runs
    history: list[tuple[float, float, float, float]]
    view: Deferred | None
    failureSample: Deferred | None
    outputDescription: list[str]
    audits: int = 0
    auditSpread: float = 0.0
    gradients: int = 0
    seconds: float = 0.0

    def ofComplement(self) -> "ReliabilityOutcome":
        """The outcome of the event itself, where this one is of its complement."""
        runs = dataclasses.replace(
            self.runs, failed=~self.runs.failed, margins=-self.runs.margins, expected=1.0 - self.runs.expected
        )
        nominal = np.isin(runs.phases, NOMINAL_PHASES)
        return dataclasses.replace(
            self,
            probability=1.0 - self.probability,
            interval=dataclasses.replace(self.interval, complement=not self.interval.complement),
            surrogateProbability=1.0 - (self.surrogateProbability or 0.0),
            runs=runs,
            history=[(number, 1.0 - p, 1.0 - upper, 1.0 - lower) for number, p, lower, upper in self.history],
            failureSample=Deferred(lambda: FailureSample.ofMonteCarlo(runs.x[nominal], runs.failed[nominal])),
        )
