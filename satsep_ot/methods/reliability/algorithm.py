"""Probability of failure by a surrogate that is corrected by true runs, or by true runs around failure modes."""

import dataclasses
import math
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.reliability.limit_state import NON_FINITE_POLICIES, checkedKind
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.run import ReliabilityRun
from satsep_ot.methods.reliability.settings import MODES, ReliabilitySettings
from satsep_ot.openturns_object import OpenTURNSObject

# Targets that the estimate is made for.
_SMALLEST_TARGET, _LARGEST_TARGET = 0.01, 0.5

__all__ = ["ActiveSubspaceReliability", "ActiveSubspaceReliabilityResult"]


class ActiveSubspaceReliability(OpenTURNSObject):
    """Probability of an event: importance sampling by a surrogate that learns from every run, or around failure modes.

    Each smooth component becomes a polynomial of one to three directions of the standard normal space, found without
    gradients, or a Gaussian process of up to 10 inputs. The probability that the surrogate with its error fails is
    integrated; true runs, drawn where the surrogate is unsure and where it fails, correct it: ``p = E[pi(Y)] + E[w
    (1_F - pi)]``. Each block of runs is unbiased whatever the surrogate is, since it is new to the surrogate that
    proposed it. Relatives: metamodel-based importance sampling (Dubourg, Sudret and Deheeger, Probabilistic
    Engineering Mechanics 33, 2013) and multifidelity importance sampling (Peherstorfer et al., Computer Methods in
    Applied Mechanics and Engineering 300, 2016).

    Wide runs look in all directions for failures that the estimate lacks. Where the surrogate does not explain what
    they hit, or is too poor, runs are drawn around failure modes, of which only labels count; where these promise
    nothing either, the algorithm hands over to subset simulation, or to crude Monte Carlo. Where more than 60 % of the
    first runs fail, it estimates the complement.

    Parameters
    ----------
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
        Inputs are continuous with an iso-probabilistic transformation to independent standard normal variables; for
        others there is :class:`~satsep_ot.methods.reliability.conditional.ConditionalReliability`. Where their
        distribution has only the default names X0, X1, ..., results use the names of the function's inputs.

    Raises
    ------
    TypeError
        The event is none of these.

    Notes
    -----
    Guaranteed is that each block is unbiased given its proposal, since its weights are exact. A failure region that no
    run has reached is not in the estimate nor in its interval; one that a share x of the wide runs would hit escapes m
    independent ones with the probability ``(1 - x)^m`` (`computeEscapeProbability` of the result). Regions that end in
    all directions of many inputs are the least visible. What was found and could not be resolved makes the interval
    one-sided, and is not called converged. The stopping rule looks at the data: the variance has a floor for that, and
    is never below what was expected before the runs. The section on the corrected probability in the theory says the
    details.

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
        self._runs: tuple[ot.Sample, ot.Sample] | None = None
        self._result: ActiveSubspaceReliabilityResult | None = None

    def _shown(self):
        return {
            "mode": self._settings.mode,
            "targetCoefficientOfVariation": self._settings.targetCoefficientOfVariation,
            "maximumEvaluations": self._settings.maximumEvaluations,
        }

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

    def setLowFidelity(self, function: ot.Function | None) -> None:
        """Give a cheap model of the same outputs, so that fewer runs of the function are needed (default None).

        Each modelled output is a learnt factor times the cheap one plus a discrepancy, where this predicts the runs
        better; elsewhere the cheap model has no part. The estimate is corrected by runs of the function as always, so
        that a wrong cheap model costs runs and no truth.

        Parameters
        ----------
        function : :py:class:`openturns.Function` or None
            With the inputs and outputs of the event's function or, where there are components, of their function. It
            is evaluated some ten thousand times for each estimate and some thousand times for each block of runs.
        """
        self._settings.lowFidelity = function

    def getLowFidelity(self) -> ot.Function | None:
        """Accessor to the cheap model."""
        return self._settings.lowFidelity

    def setTargetCoefficientOfVariation(self, value: float) -> None:
        """Stop at this coefficient of variation of the estimate (default 0.05)."""
        if not _SMALLEST_TARGET <= value <= _LARGEST_TARGET:
            raise ValueError(
                f"the target coefficient of variation is {value}; it must lie between {_SMALLEST_TARGET} and "
                f"{_LARGEST_TARGET}"
            )
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

    def setBlockSize(self, value: int | None) -> None:
        """Smallest number of true runs at once wherever the algorithm may choose it (default None).

        For a function that makes many runs in the time of one, as a cluster does. Blocks grow with the number of runs
        that there are in any case, and a block larger than it needs to be learns less from each of its runs. The first
        runs, searches for a limit and subset simulation keep their own sizes, and the wide runs of a block are asked
        for after its others.
        """
        if value is not None and (int(value) != value or value < 1):
            raise ValueError(f"the block size is {value}; it must be a positive integer, or None")
        self._settings.blockSize = None if value is None else int(value)

    def getBlockSize(self) -> int | None:
        """Accessor to the smallest number of true runs at once."""
        return self._settings.blockSize

    def setAllowedProbability(self, value: float | None, coefficientOfVariation: float = math.inf) -> None:
        """Stop, too, as soon as the probability is known to be above or below this one (default None).

        Parameters
        ----------
        value : float or None
        coefficientOfVariation : float
            No look at a larger coefficient of variation of the estimate stops the run. By default every look may.

        Notes
        -----
        All looks at the estimate together are wrong in at most 5 % of runs, as far as each interval holds: the k-th one
        takes ``0.05 / (k (k + 1))``. "Below" waits for the wide runs, "above" needs none.
        """
        if value is not None and not 0.0 < value < 1.0:
            raise ValueError(f"the allowed probability is {value}; it must lie between 0 and 1, both excluded")
        if not coefficientOfVariation > 0.0:
            raise ValueError(f"the coefficient of variation is {coefficientOfVariation}; it must be positive")
        self._settings.allowedProbability = None if value is None else float(value)
        self._settings.verdictCoefficientOfVariation = float(coefficientOfVariation)

    def getAllowedProbability(self) -> float | None:
        """Accessor to the allowed probability."""
        return self._settings.allowedProbability

    def setMode(self, mode: str) -> None:
        """``"fast"`` (default), or ``"safe"`` with more wide runs, which look in all directions for what is missing.

        Without 80 of them no estimate from a surrogate has converged, and without 250 none around failure modes; 240
        and 500 in the safe mode. For a target above 10 % the fast mode makes 32 with a surrogate.
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

    def setKnownRuns(
        self, inputSample: ArrayLike, outputSample: ArrayLike, distribution: ot.Distribution | None = None
    ) -> None:
        """Begin with runs that are there already; they are learnt from, and count as no evaluations.

        Parameters
        ----------
        inputSample : array (n, d)
            Physical inputs, from anywhere in the range of the event's distribution. n may be 0, which is the default.
        outputSample : array (n, p)
            What the event's function, or that of `setComponents`, gave.
        distribution : :py:class:`openturns.Distribution`, optional
            What the inputs were independently drawn from, all that were made, whatever they gave. Only where it is
            stated they are a part of an estimate from a surrogate, each by the ratio of the densities, and only where
            it is the event's own they bound the probability where no run fails.
        """
        inputs, outputs = (np.array(sample, dtype=float) for sample in (inputSample, outputSample))
        if inputs.ndim != 2 or outputs.ndim != 2 or len(inputs) != len(outputs):
            raise ValueError(
                f"the known runs have the shapes {inputs.shape} and {outputs.shape}; (n, d) and (n, p) are needed"
            )
        law = None if distribution is None else ot.Distribution(distribution)
        self._settings.knownRuns = (ot.Sample(inputs), ot.Sample(outputs), law) if len(inputs) else None

    def setProgressCallback(self, callback: Callable[[float], None] | None) -> None:
        """Called after each block of runs with the percentage of the evaluation limit that is used."""
        _refuseNotCallable("progress", callback)
        self._settings.progressCallback = callback

    def setStopCallback(self, callback: Callable[[], bool] | None) -> None:
        """Called after each block; when it returns True the run ends with what was reached."""
        _refuseNotCallable("stop", callback)
        self._settings.stopCallback = callback

    def setCheckpointFile(self, path: str | os.PathLike | None, checksModel: bool = True) -> None:
        """Keep every true run in this file, and continue from it where it is there; None (default) for no file.

        Each block of runs is in the file before the next one starts. A run() that was killed, or ended by an error or
        Ctrl-C, is continued by the same one: it goes on with the random numbers of the first one, whatever the
        seed is now, takes from the file the runs that are there, and gives the result, to the last bit, that it would
        have given. A run that failed is made again.

        Parameters
        ----------
        path : str or path, optional
            A file of its own for each computation. Reading it executes nothing.
        checksModel : bool
            Whether one run is made again at first, so that runs of another function are refused: beside names, no
            other trace of a Python function can be compared. False for a function that is noisy or dear.
        """
        self._settings.checkpointFile = None if path is None else Path(path)
        self._settings.checksModel = bool(checksModel)

    def asking(self, path: Path) -> "ActiveSubspaceReliability":
        """The same, whose run ends with `BlockNeeded` where a file lacks true runs; made by `AskTellReliability`."""
        algorithm = ActiveSubspaceReliability(self._event)
        algorithm._settings = dataclasses.replace(self._settings, checkpointFile=path, checksModel=False, asks=True)
        return algorithm

    def getResult(self) -> ActiveSubspaceReliabilityResult:
        """Accessor to the result of `run`."""
        if self._result is None:
            raise RuntimeError("there is no result yet; call run() first")
        return self._result

    def getRuns(self) -> tuple[ot.Sample, ot.Sample]:
        """Inputs and outputs of all true runs of the last run(), also of one that an error or Ctrl-C ended.

        Raises
        ------
        RuntimeError
            There are none: `run` was not called, or ended before its first block of runs.
        """
        if self._runs is None:
            raise RuntimeError("there are no true runs: run() was not called, or ended before its first block")
        return self._runs

    def conditioned(
        self, event: Any, fixed: dict[int, float], maximumEvaluations: int, number: int
    ) -> "ActiveSubspaceReliability":
        """The same for a part of the event, with values of some inputs; made by `ConditionalReliability`.

        Parameters
        ----------
        event : event
            Of the other inputs.
        fixed : dict of int to float
        maximumEvaluations, number : int
            Of this part.
        """
        settings = self._settings
        if settings.knownRuns is not None:
            raise ValueError("known runs cannot be given where inputs have atoms")
        algorithm = ActiveSubspaceReliability(event)
        file = settings.checkpointFile
        functions = [settings.function, settings.lowFidelity]
        if fixed:
            functions = [
                None if one is None else ot.ParametricFunction(one, list(fixed), list(fixed.values()))
                for one in functions
            ]
        algorithm._settings = dataclasses.replace(
            settings,
            function=functions[0],
            lowFidelity=functions[1],
            maximumEvaluations=maximumEvaluations,
            checkpointFile=None if file is None else file.with_name(f"{file.name}.{number + 1}"),
        )
        return algorithm

    @singleThread()
    def run(self) -> None:
        """Compute the probability.

        Raises
        ------
        ValueError
            The evaluation limit is too small, an output is not finite, the composition is not the event's variable, the
            known runs are of other inputs or outputs, or the checkpoint file is damaged, or that of another computation
            or model.
        RuntimeError
            The function failed; the message says in which phase and how many runs are kept (`getRuns`).
        KeyboardInterrupt
            Ctrl-C, also inside the function; `getRuns` has the runs before the present block.
        """
        self._runs = self._result = None
        start = time.perf_counter()
        run = ReliabilityRun(self._event, dataclasses.replace(self._settings))
        try:
            outcome = run.compute()
        finally:
            self._runs = run.recorder.samples()
        outcome.seconds = time.perf_counter() - start
        self._result = ActiveSubspaceReliabilityResult(outcome)


def _refuseNotCallable(what, callback):
    if callback is not None and not callable(callback):
        raise TypeError(f"the {what} callback is of type {type(callback).__name__}; it must be callable")
