"""Probability of failure by polynomial ridges of smooth components, corrected by true runs."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import openturns as ot

from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.reliability.limit_state import NON_FINITE_POLICIES, checkedKind
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.run import ReliabilityRun
from satsep_ot.methods.reliability.settings import MODES, ReliabilitySettings

__all__ = ["ActiveSubspaceReliability", "ActiveSubspaceReliabilityResult"]


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
        their distribution has only the default names X0, X1, ..., results use the names of the function's inputs.

    Raises
    ------
    TypeError
        The event is none of these.

    Notes
    -----
    A failure region that no run has reached and that the surrogate does not show is not in the estimate nor in its
    interval: `getUnseenBound` of the result says how much probability such a region may have. The stopping rule looks
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
        self._settings = ReliabilitySettings()
        self._run: ReliabilityRun | None = None
        self._result: ActiveSubspaceReliabilityResult | None = None

    def __repr__(self) -> str:
        return (
            f"ActiveSubspaceReliability(mode={self._settings.mode}, "
            f"targetCoefficientOfVariation={self._settings.targetCoefficientOfVariation}, "
            f"maximumEvaluations={self._settings.maximumEvaluations})"
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
        settings = self._settings
        settings.function, settings.composition = function, composition
        settings.smoothIndices, settings.surrogateComposition = smoothIndices, surrogateComposition

    def setTargetCoefficientOfVariation(self, value: float) -> None:
        """Stop at this coefficient of variation of the estimate (default 0.05)."""
        if not (math.isfinite(value) and value > 0.0):
            raise ValueError(f"the target coefficient of variation is {value}; it must be positive")
        self._settings.targetCoefficientOfVariation = float(value)

    def getTargetCoefficientOfVariation(self) -> float:
        """Accessor to the target coefficient of variation."""
        return self._settings.targetCoefficientOfVariation

    def setMaximumEvaluations(self, value: int) -> None:
        """Largest number of true runs, all phases together (default 5000)."""
        if int(value) != value or value < 1:
            raise ValueError(f"the maximum number of evaluations is {value}; it must be a positive integer")
        self._settings.maximumEvaluations = int(value)

    def getMaximumEvaluations(self) -> int:
        """Accessor to the largest number of true runs."""
        return self._settings.maximumEvaluations

    def setMode(self, mode: str) -> None:
        """``"fast"`` (default) learns from normal points; ``"safe"`` starts from a short subset simulation as well.

        The safe mode spends a third of the evaluations on it: its failed points show regions that a smooth surrogate
        of normal points misses, and its estimate is an independent check.
        """
        if mode not in MODES:
            raise ValueError(f"the mode is {mode!r}; give one of {MODES}")
        self._settings.mode = mode

    def getMode(self) -> str:
        """Accessor to the mode."""
        return self._settings.mode

    def setNonFinitePolicy(self, policy: str) -> None:
        """What a run with a non-finite output is: ``"raise"`` an error (default), a ``"failure"`` or ``"safe"``."""
        if policy not in NON_FINITE_POLICIES:
            raise ValueError(f"the policy for non-finite outputs is {policy!r}; give one of {NON_FINITE_POLICIES}")
        self._settings.nonFinitePolicy = policy

    def setProgressCallback(self, callback: Callable[[float], None] | None) -> None:
        """Called after each block of runs with the percentage of the evaluation limit that is used."""
        _refuseNotCallable("progress", callback)
        self._settings.progressCallback = callback

    def setStopCallback(self, callback: Callable[[], bool] | None) -> None:
        """Called after each block; when it returns True the run ends with what was reached."""
        _refuseNotCallable("stop", callback)
        self._settings.stopCallback = callback

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
        if self._run is None or not self._run.recorder.blocks:
            raise RuntimeError("there are no true runs: run() was not called, or ended before its first block")
        runs, limitState = self._run.recorder.runs(), self._run.limitState
        inputs, outputs = ot.Sample(runs.x), ot.Sample(runs.outputs)
        inputs.setDescription(limitState.distribution.getDescription())
        outputs.setDescription(limitState.function.getOutputDescription())
        return inputs, outputs

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
        self._run = self._result = None
        self._run = ReliabilityRun(self._event, dataclasses.replace(self._settings))
        self._result = ActiveSubspaceReliabilityResult(self._run.compute())


def _refuseNotCallable(what, callback):
    if callback is not None and not callable(callback):
        raise TypeError(f"the {what} callback must be callable, got {type(callback).__name__}")
