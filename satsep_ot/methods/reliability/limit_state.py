"""An OpenTURNS event seen from the standard normal space: true runs, their failures, a limit state of components."""

import copy
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.margins import thresholdMargin
from satsep_ot.methods.common.run_log import RunLog
from satsep_ot.methods.common.standard_space import StandardSpace, nameInputs
from satsep_ot.openturns_adapter import callFunction, domainMembers, eventKind, hasGradient, raiseInterrupt

NON_FINITE_POLICIES = ("raise", "failure", "safe")


@dataclasses.dataclass
class Runs:
    """True runs: points in standard and physical space, outputs, limit state values (at most 0 in failure), labels.

    ``phases`` says what each one was made for. A run of the estimate has its density over that it was drawn from in
    ``weights``, which is NaN for others, and the surrogate's probability of failure there in ``expected``.
    """

    u: np.ndarray
    x: np.ndarray
    outputs: np.ndarray
    margins: np.ndarray
    failed: np.ndarray
    finite: np.ndarray
    phases: np.ndarray
    weights: np.ndarray
    expected: np.ndarray

    def __len__(self) -> int:
        return len(self.u)

    @staticmethod
    def concatenate(parts: "list[Runs]") -> "Runs":
        """All runs of the parts, in order."""
        return Runs(*(np.concatenate([getattr(p, f.name) for p in parts]) for f in dataclasses.fields(Runs)))


@dataclasses.dataclass
class Limit:
    """Inputs, function and limit state of an event: margin (n,) of outputs (n, p), at most 0 in failure."""

    vector: ot.RandomVector
    function: ot.Function
    margin: Callable

    @staticmethod
    def of(event: Any) -> "Limit":
        """The limit state of an event, refusing what has none with the reason."""
        kind = checkedKind(event)
        if kind in ("UnionEvent", "IntersectionEvent"):
            combine = np.min if kind == "UnionEvent" else np.max
            # One that was wrapped, as OpenTURNS wraps the members of others, has its own methods inside.
            inner = event.getImplementation() if event.getClassName() == "RandomVector" else event
            parts = [Limit.of(member) for member in inner.getEventCollection()]
            sizes = np.cumsum([part.function.getOutputDimension() for part in parts])[:-1]

            def margin(outputs):
                pieces = np.split(outputs, sizes, axis=1)
                return combine([part.margin(piece) for part, piece in zip(parts, pieces, strict=True)], axis=0)

            return Limit(parts[0].vector, ot.AggregatedFunction([part.function for part in parts]), margin)
        vector = event.getAntecedent()
        if kind == "ThresholdEvent":
            compare = thresholdMargin(event.getOperator(), event.getThreshold())
            return Limit(vector, event.getFunction(), lambda outputs: compare(outputs[:, 0]))
        return Limit(vector, event.getFunction(), _domainMargin(event.getDomain().getImplementation()))


def checkedKind(event: Any) -> str:
    """Class name of an event that can be treated.

    Raises
    ------
    TypeError
        It is none: a function, for instance.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.reliability.limit_state import checkedKind
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction("a", "a"), ot.RandomVector(ot.Normal()))
    >>> checkedKind(ot.ThresholdEvent(vector, ot.Greater(), 2.0))
    'ThresholdEvent'
    """
    kind = eventKind(event)
    if kind not in ("ThresholdEvent", "DomainEvent", "UnionEvent", "IntersectionEvent"):
        raise TypeError(
            f"the event is a {kind}; give a ThresholdEvent, UnionEvent, IntersectionEvent or DomainEvent, of a "
            "function f for instance ot.ThresholdEvent(ot.CompositeRandomVector(f, ot.RandomVector(distribution)), "
            "ot.Greater(), threshold)"
        )
    return kind


def _domainMargin(domain: Any) -> Callable:
    """Limit state of a domain, at most 0 inside, of points (n, p)."""
    if isinstance(domain, ot.Interval):
        return _intervalMargin(domain)
    if isinstance(domain, ot.LevelSet):
        compare = thresholdMargin(domain.getOperator(), domain.getLevel())
        level = domain.getFunction()
        return lambda outputs: compare(callFunction(level, outputs)[:, 0])
    if type(domain) not in _COMPOSITIONS:
        raise TypeError(
            f"a DomainEvent on a {type(domain).__name__} has no limit state function; give an Interval or a LevelSet, "
            "or a union, intersection, difference or complement of these"
        )
    combine = _COMPOSITIONS[type(domain)]
    parts = [_domainMargin(member) for member in domainMembers(domain)]
    return lambda outputs: combine(*(part(outputs) for part in parts))


def _outside(margin):
    # A limit belongs to the domain, and so not to its complement.
    return np.where(margin == 0.0, np.finfo(float).tiny, -margin)


# Limit states of what is made of other domains, from theirs.
_COMPOSITIONS: dict[type, Callable] = {
    ot.DomainUnion: lambda *margins: np.min(margins, axis=0),
    ot.DomainIntersection: lambda *margins: np.max(margins, axis=0),
    ot.DomainComplement: _outside,
    ot.DomainDifference: lambda left, right: np.maximum(left, _outside(right)),
}


def _intervalMargin(domain: ot.Interval) -> Callable:
    bounds = [
        (j, sign, bound)
        for sign, side, finite in (
            (1.0, domain.getUpperBound(), domain.getFiniteUpperBound()),
            (-1.0, domain.getLowerBound(), domain.getFiniteLowerBound()),
        )
        for j, bound in enumerate(side)
        if finite[j]
    ]
    if not bounds:
        raise ValueError("the domain of the event has no finite bound, so every point is in it")
    return lambda outputs: np.max([sign * (outputs[:, j] - bound) for j, sign, bound in bounds], axis=0)


class BlockNeeded(BaseException):
    """A block of true runs is needed from elsewhere. No error: what keeps an error of a function does not keep it.

    Attributes
    ----------
    inputs : :py:class:`openturns.Sample`
        Physical inputs (n, d), under their names.
    outputNames : list of str
    allowsNonFinite : bool
        Whether an output may be a number that is not finite.
    keep : callable
        Takes the outputs, an array (n, p), into the log of the runs.
    """

    def __init__(
        self,
        inputs: ot.Sample,
        outputNames: list[str],
        allowsNonFinite: bool,
        keep: Callable[[np.ndarray], object],
    ) -> None:
        super().__init__(f"{inputs.getSize()} runs are needed")
        self.inputs, self.outputNames = inputs, outputNames
        self.allowsNonFinite, self.keep = allowsNonFinite, keep


class LimitStateEvent:
    """What an algorithm needs to know of an event.

    Parameters
    ----------
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
        A domain is an Interval, a LevelSet, or a union, intersection, difference or complement of these.
    function, composition : :py:class:`openturns.Function`, optional
        One true run is one evaluation of ``function``; ``composition`` of its outputs is the variable that a
        ThresholdEvent compares with its threshold.
    smoothIndices : sequence of int, optional
        Outputs of ``function`` that are modelled. By default all.
    surrogateComposition : :py:class:`openturns.Function`, optional
        Composition of the outputs in ``smoothIndices``. By default ``composition``.
    nonFinitePolicy : str
        What a run with a NaN or infinite output is: ``"raise"`` an error, a ``"failure"`` or ``"safe"``.

    Raises
    ------
    TypeError, ValueError
        Where the event cannot be treated, with the reason.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.reliability.limit_state import LimitStateEvent
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction("x", "2 * x"), ot.RandomVector(ot.Normal()))
    >>> event = LimitStateEvent(ot.ThresholdEvent(vector, ot.Greater(), 5.0))
    >>> runs = event.evaluate(np.array([[2.0], [3.0]]))
    >>> runs.failed.tolist(), runs.margins.tolist()
    ([False, True], [1.0, -1.0])
    """

    def __init__(
        self,
        event: ot.ThresholdEvent | ot.UnionEvent | ot.IntersectionEvent | ot.DomainEvent,
        function: ot.Function | None = None,
        composition: ot.Function | None = None,
        smoothIndices: Sequence[int] | None = None,
        surrogateComposition: ot.Function | None = None,
        nonFinitePolicy: str = "raise",
    ) -> None:
        if nonFinitePolicy not in NON_FINITE_POLICIES:
            raise ValueError(
                f"the policy for non-finite outputs is {nonFinitePolicy!r}; give one of {NON_FINITE_POLICIES}"
            )
        self._checkValue = None
        self._log = RunLog()
        self._asks = False
        self.complement = False
        self.nonFinitePolicy = nonFinitePolicy
        self.nonFiniteNumber = 0
        self.unknownNumber = 0
        kind = eventKind(event)
        limit = Limit.of(event)
        self.hasExactGradient = hasGradient(limit.function if function is None else function)
        self.space = StandardSpace(nameInputs(limit.vector.getDistribution(), limit.function))
        self.distribution = self.space.getDistribution()
        self.dimension = self.space.getDimension()
        if function is None:
            self.function = limit.function
            self._margin = limit.margin
            self.smoothIndices = list(range(self.function.getOutputDimension()))
            self._surrogateMargin = limit.margin
            return
        if kind != "ThresholdEvent":
            raise TypeError(f"components can be given for a ThresholdEvent only, not for a {kind}")
        if composition is None:
            raise TypeError("a component function needs the composition of its outputs; it is None")
        outputs = function.getOutputDimension()
        if function.getInputDimension() != self.dimension:
            raise ValueError(
                f"the component function has {function.getInputDimension()} inputs, but the event's distribution has "
                f"{self.dimension}"
            )
        if composition.getInputDimension() != outputs or composition.getOutputDimension() != 1:
            raise ValueError(
                f"the composition must map the {outputs} outputs of the component function on 1 value, but it maps "
                f"{composition.getInputDimension()} on {composition.getOutputDimension()}"
            )
        self.smoothIndices = list(range(outputs)) if smoothIndices is None else [int(i) for i in smoothIndices]
        if not self.smoothIndices or not all(0 <= i < outputs for i in self.smoothIndices):
            raise ValueError(f"the smooth indices are {self.smoothIndices}; they must lie in 0 to {outputs - 1}")
        reduced = composition if surrogateComposition is None else surrogateComposition
        if reduced.getInputDimension() != len(self.smoothIndices) or reduced.getOutputDimension() != 1:
            raise ValueError(
                f"the composition of the surrogate must map the {len(self.smoothIndices)} smooth outputs on 1 value, "
                f"but it maps {reduced.getInputDimension()} on {reduced.getOutputDimension()}"
            )
        self.function = function
        self._threshold = event.getThreshold()
        self._checkValue = lambda x: limit.margin(self._logged("event", limit.function, x))
        self._margin = lambda values: limit.margin(callFunction(composition, values))
        self._surrogateMargin = lambda values: limit.margin(callFunction(reduced, values))

    def withFunction(self, function: ot.Function) -> "LimitStateEvent":
        """The same limit state of another function with the same inputs and outputs, with runs of its own.

        Raises
        ------
        ValueError
            It has other numbers of inputs or outputs.
        """
        given, needed = ((one.getInputDimension(), one.getOutputDimension()) for one in (function, self.function))
        if given != needed:
            raise ValueError(
                f"the low-fidelity function has {given[0]} inputs and {given[1]} outputs; it must have {needed[0]} and "
                f"{needed[1]}, as the function of the event or of its components"
            )
        other = copy.copy(self)
        other.function, other.hasExactGradient = function, hasGradient(function)
        other.nonFinitePolicy, other.nonFiniteNumber, other.unknownNumber = "raise", 0, 0
        other._log, other._asks, other._checkValue = RunLog(), False, None
        return other

    def surrogateMargin(self, values: np.ndarray) -> np.ndarray:
        """Limit state (n,), at most 0 in failure, of the modelled outputs (n, p).

        Raises
        ------
        RuntimeError
            The composition is not defined everywhere: surrogates reach values that no run has.
        """
        rule = "the composition of the components must be defined for all their values, also where surrogates reach"
        try:
            margin = self._surrogateMargin(values)
        except Exception as error:
            raiseInterrupt(error)
            raise RuntimeError(f"{rule}: {error}") from error
        undefined = np.isnan(margin)
        if undefined.any():
            raise RuntimeError(f"{rule}: it is not a number at {ot.Point(values[undefined.argmax()])}")
        return -margin if self.complement else margin

    def dropUnusedOutputs(self, outputs: np.ndarray) -> None:
        """Do not model outputs whose change by six standard deviations leaves these runs' limit state as it is."""
        values = self.smooth(outputs)
        steps = 6.0 * values.std(axis=0)
        reference = self.surrogateMargin(values)
        used = []
        for j, step in enumerate(steps):
            moved = [values + sign * step * (np.arange(len(steps)) == j) for sign in (-1.0, 1.0)]
            if any((self.surrogateMargin(shifted) != reference).any() for shifted in moved):
                used.append(j)
        if not used or len(used) == len(steps):
            return
        full, margin, typical = list(self.smoothIndices), self._surrogateMargin, values.mean(axis=0)

        def reducedMargin(reduced):
            complete = np.repeat(typical[None], len(reduced), axis=0)
            complete[:, used] = reduced
            return margin(complete)

        self.smoothIndices = [full[j] for j in used]
        self._surrogateMargin = reducedMargin

    def checkComposition(self, x: np.ndarray, margin: float, spread: float) -> int:
        """Compare one run's composed value with the event's own function; returns the evaluations made (0 or 1).

        They may differ by rounding, beside the spread of the values and the threshold.
        """
        if self._checkValue is None:
            return 0
        if self._asks:
            # There is no other function to compare with. It counts all the same: the answer is that of a direct run.
            return 1
        direct = float(self._checkValue(x[None, :])[0])
        if not math.isclose(direct, margin, rel_tol=1e-6, abs_tol=1e-9 * spread + 1e-12 * abs(self._threshold)):
            raise ValueError(
                f"the composition of the components does not give the event's variable: it is {margin:.9g} from the "
                f"threshold where the event's function is {direct:.9g} from it, at input {x.tolist()}"
            )
        return 1

    def keepRuns(self, log: RunLog, checksModel: bool) -> None:
        """From now on take the runs that a log has, and give it the others.

        Raises
        ------
        ValueError
            The log is of another function, where that is to be checked.
        """
        if checksModel:
            log.checkModel("function", lambda x: callFunction(self.function, x))
        self._log = log

    def askForRuns(self) -> None:
        """From now on ask for the runs that the log lacks, by `BlockNeeded`, and for no gradient."""
        self._asks, self.hasExactGradient = True, False

    def _logged(self, name, function, x, tolerant=False):
        def call(points):
            if self._asks:
                raise self._needed(name, points, function, tolerant)
            return callFunction(function, points)

        return self._log.values(name, x, call, function.getOutputDimension(), tolerant)

    def _needed(self, name, x, function, tolerant):
        inputs, size = ot.Sample(x), function.getOutputDimension()
        inputs.setDescription(self.distribution.getDescription())
        return BlockNeeded(
            inputs,
            list(function.getOutputDescription()),
            tolerant or self.nonFinitePolicy != "raise",
            lambda outputs: self._log.values(name, x, lambda _: outputs, size, tolerant),
        )

    def evaluate(self, u: np.ndarray, phase: str = "", exploring: bool = False) -> Runs:
        """One true run at each point (n, d) of standard space.

        Parameters
        ----------
        u : array (n, d)
        phase : str
        exploring : bool
            The inputs are not likely: a run in which the function fails is not finite, and where the policy is to
            raise, a run that is not finite counts as safe and as unknown.

        Raises
        ------
        IncompleteBlockError
            Some runs failed; the others are kept.
        """
        x = self.space.toPhysical(u)
        return self.runsOf(u, x, self._logged("function", self.function, x, exploring), phase, exploring)

    def runsOf(self, u: np.ndarray, x: np.ndarray, outputs: np.ndarray, phase: str, exploring: bool) -> Runs:
        """Runs of given outputs (n, p), see `evaluate`."""
        margins = np.full(len(outputs), np.nan)
        failed = np.zeros(len(outputs), dtype=bool)
        finite = np.isfinite(outputs).all(axis=1)
        if finite.any():
            margins[finite] = (self._definedMargin if exploring else self._margin)(outputs[finite])
            finite &= np.isfinite(margins)
            failed[finite] = margins[finite] <= 0.0
        if not finite.all():
            row = int(np.argmin(finite))
            if self.nonFinitePolicy != "raise":
                failed[~finite] = self.nonFinitePolicy == "failure"
                self.nonFiniteNumber += int(np.count_nonzero(~finite))
            elif exploring:
                self.unknownNumber += int(np.count_nonzero(~finite))
            else:
                raise ValueError(
                    f"{np.count_nonzero(~finite)} of {len(x)} runs gave a value that is not finite, the first is row "
                    f"{row}: input {self._describe(x[row])}, output {outputs[row].tolist()}; setNonFinitePolicy can "
                    "count such runs as failures or as safe"
                )
        size = len(outputs)
        if self.complement:
            margins, failed = -margins, ~failed
        return Runs(u, x, outputs, margins, failed, finite, np.full(size, phase), np.full(size, np.nan), np.zeros(size))

    def _definedMargin(self, outputs):
        """Margins (n,), NaN where the composition is not defined."""
        try:
            return self._margin(outputs)
        except Exception as error:
            raiseInterrupt(error)
            if len(outputs) == 1:
                return np.full(1, np.nan)
            # One of them alone may be the reason.
            return np.concatenate([self._definedMargin(row[None]) for row in outputs])

    def exactGradient(self, u: np.ndarray, outputs: np.ndarray) -> np.ndarray:
        """Gradient (d,) of the limit state at a point of standard space, by the function's own gradient.

        Parameters
        ----------
        u : array (d,)
        outputs : array (p,)
            Of the function there.
        """
        jacobian = self._log.gradient("function", self.space.toPhysical(u[None])[0], self.function)
        steps = 1e-6 * np.maximum(np.abs(outputs), np.linalg.norm(jacobian, axis=0))
        steps = np.where(steps > 0.0, steps, 1e-6)
        margins = self._margin(np.vstack([outputs, outputs + np.diag(steps)]))
        slopes = (margins[1:] - margins[0]) / steps
        gradient = self.space.chainGradient(u[None], jacobian[None])[0] @ slopes
        return -gradient if self.complement else gradient

    def takeComplement(self) -> None:
        """From now on failures are the runs in which the event does not happen; again: in which it does."""
        self.complement = not self.complement

    def failsWhereNotFinite(self) -> bool:
        """Whether a run without a finite value counts as a failure of the event, or of its complement."""
        return (self.nonFinitePolicy == "failure") != self.complement

    def _describe(self, x):
        names = self.distribution.getDescription()
        return ", ".join(f"{name} = {value:.9g}" for name, value in zip(names, x, strict=True))

    def smooth(self, outputs: np.ndarray) -> np.ndarray:
        """The modelled outputs (n, p)."""
        return outputs[:, self.smoothIndices]
