"""What a reliability method is given, and what it answers; to add one, derive from `ReliabilityMethod`."""

import abc
import copy
import dataclasses
from collections.abc import Callable
from typing import ClassVar

import numpy as np
import openturns as ot

from satsep_ot.openturns_adapter import Counter


@dataclasses.dataclass
class CountedProblem:
    """What a method is given: an event that counts, and ways to use what is known of it.

    Attributes
    ----------
    event : :py:class:`openturns.ThresholdEvent`
    distribution : :py:class:`openturns.Distribution`
    counter : Counter
    components : tuple or None
        Arguments of :meth:`ActiveSubspaceReliability.setComponents`, counting as well.
    isFailure : callable
        Maps inputs (n, d) on the booleans (n,) of the event, which counts.
    report : callable
        To be called with a percentage; returns True when the method should stop.
    """

    event: ot.ThresholdEvent
    distribution: ot.Distribution
    counter: Counter
    components: tuple | None
    isFailure: Callable[[np.ndarray], np.ndarray]
    report: Callable[[float], bool]

    def remaining(self, wanted: int) -> int:
        """So many evaluations, or what the limit leaves of them."""
        counter = self.counter
        if counter.limit is None:
            return wanted
        return min(wanted, counter.limit - counter.evaluations - counter.gradients)


@dataclasses.dataclass
class Row:
    """Outcome of one method on one event. A number that the method does not have is None, never NaN or 0.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.method import Row
    >>> print(Row("FORM", probability=1e-3).upper95)
    None
    """

    method: str
    probability: float | None = None
    lower95: float | None = None
    upper95: float | None = None
    coefficient_of_variation: float | None = None
    evaluations: int = 0
    gradients: int = 0
    seconds: float = 0.0
    converged: bool = False
    note: str = ""


class ReliabilityMethod(abc.ABC):
    """A way to estimate a probability of failure. ``name`` is what tables show; ``fixedSize`` says that it spends a
    given number of evaluations whatever the error is, so that fewer would do for a larger one.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.comparison.comparison import ReliabilityComparison
    >>> from satsep_ot.methods.comparison.method import ReliabilityMethod, Row
    >>> class HundredRuns(ReliabilityMethod):
    ...     name = "HundredRuns"
    ...     def run(self, problem):
    ...         share = problem.isFailure(np.array(problem.distribution.getSample(100))).mean()
    ...         return Row(self.name, float(share))
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction("x", "x"), ot.RandomVector(ot.Normal()))
    >>> comparison = ReliabilityComparison(ot.ThresholdEvent(vector, ot.Greater(), 0.0), [HundredRuns()])
    >>> comparison.run()
    >>> comparison.getResult().getRow("HundredRuns").evaluations
    100
    """

    name: str
    fixedSize = False
    # Settings that bound the evaluations of a method.
    limits: ClassVar[tuple[str, ...]] = ("size", "maximumEvaluations")

    def getMaximumEvaluations(self) -> int | None:
        """The most evaluations that the settings allow; None where they do not say."""
        bounds = [getattr(self, name) for name in self.limits if hasattr(self, name)]
        return max(bounds) if bounds else None

    def within(self, budget: int) -> "ReliabilityMethod":
        """This method, or a copy of it that is set to spend no more than a budget of evaluations."""
        bound = self.getMaximumEvaluations()
        if bound is None or bound <= budget:
            return self
        method = copy.copy(self)
        for name in self.limits:
            if hasattr(method, name):
                setattr(method, name, min(getattr(method, name), budget))
        return method

    @abc.abstractmethod
    def run(self, problem: CountedProblem) -> Row:
        """Estimate; evaluations, gradients and seconds of the row are filled in by the comparison."""

    def __repr__(self) -> str:
        settings = ", ".join(f"{key}={value!r}" for key, value in vars(self).items() if key[0] != "_")
        return f"{type(self).__name__}({settings})"
