"""Probability of an event with discrete inputs and atoms: a sum over their values, each part estimated by itself."""

import dataclasses
import math
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.atoms import AtomicInputs, Combination
from satsep_ot.methods.reliability.limit_state import Limit
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.openturns_adapter import callFunction, eventKind
from satsep_ot.openturns_object import OpenTURNSObject

# Points that the interval of a sum is taken from.
_POINTS = 1 << 17


class ConditionalReliability(OpenTURNSObject):
    """Probability of an event some of whose inputs are discrete, or have atoms: ``p = sum_k q_k p_k``.

    For each combination k of the values, of probability q_k, `ActiveSubspaceReliability` estimates the probability p_k
    of the event given these values; where no continuous input is left it is one run.

    Parameters
    ----------
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
        Inputs are continuous, Bernoulli, Poisson, Dirac, finite discrete or of any other discrete law, or mixtures of
        these; those with atoms are independent of all others. At most 64 combinations.

    Raises
    ------
    TypeError
        The event is none of these.

    Notes
    -----
    The settings are those of `getAlgorithm`: each part is estimated to the target coefficient of variation, with which
    the sum is at least as exact; the maximum number of evaluations is that of all parts together, of which the
    likeliest comes first, and each may take its share of what the earlier ones have left. The interval of the sum is
    that of a sum of independent numbers, distributed as the parts' intervals say (`getProbabilityDistribution`).

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot import ConditionalReliability
    >>> ot.RandomGenerator.SetSeed(0)
    >>> law = ot.JointDistribution([ot.Bernoulli(0.01), ot.Normal()])
    >>> function = ot.SymbolicFunction(["failed", "x"], ["x + 2 * failed"])
    >>> vector = ot.CompositeRandomVector(function, ot.RandomVector(law))
    >>> algorithm = ConditionalReliability(ot.ThresholdEvent(vector, ot.Greater(), 4.0))
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> truth = 0.99 * ot.DistFunc.pNormal(-4.0) + 0.01 * ot.DistFunc.pNormal(-2.0)
    >>> result.getConfidenceInterval(0.95).contains([truth]), len(result.getParts())
    (True, 2)
    """

    def __init__(self, event: ot.ThresholdEvent | ot.UnionEvent | ot.IntersectionEvent | ot.DomainEvent) -> None:
        self._event = event
        self._algorithm = ActiveSubspaceReliability(event)
        self._result: ConditionalReliabilityResult | None = None

    def _shown(self):
        return self._algorithm._shown()

    def getAlgorithm(self) -> ActiveSubspaceReliability:
        """What estimates each part; its settings are those of all. With a checkpoint file each part has one of its own,
        whose name ends on its number."""
        return self._algorithm

    def getResult(self) -> "ConditionalReliabilityResult":
        """Accessor to the result of `run`."""
        if self._result is None:
            raise RuntimeError("there is no result yet; call run() first")
        return self._result

    @singleThread()
    def run(self) -> None:
        """Compute the probability.

        Raises
        ------
        ValueError
            Inputs with atoms are none, depend on others, or have more than 64 combinations; the evaluation limit is too
            small; and what `ActiveSubspaceReliability` raises.
        RuntimeError
            The function failed.
        """
        self._result = None
        limit = Limit.of(self._event)
        distribution = ot.Distribution(limit.vector.getDistribution())
        if list(distribution.getDescription()) == list(ot.Description.BuildDefault(distribution.getDimension(), "X")):
            distribution.setDescription(limit.function.getInputDescription())
        inputs = AtomicInputs(distribution)
        combinations = sorted(inputs.combinations(), key=lambda part: -part.probability)
        left, parts = self._algorithm.getMaximumEvaluations(), []
        for number, combination in enumerate(combinations):
            share = left // (len(combinations) - number)
            part = self._estimate(limit, combination, share, number, distribution.getDescription())
            left -= part.evaluations
            parts.append(part)
        self._result = ConditionalReliabilityResult(
            parts, inputs.omitted, self._algorithm.getTargetCoefficientOfVariation()
        )

    def _estimate(self, limit, combination, share, number, names):
        values = {names[i]: value for i, value in combination.fixed.items()}
        if combination.law is None:
            if share < 1:
                raise ValueError(f"the maximum number of evaluations is too small: none is left for {values}")
            point = np.array([[combination.fixed[i] for i in range(len(names))]])
            failed = bool(limit.margin(callFunction(limit.function, point))[0] <= 0.0)
            return ConditionalPart(
                values, combination.probability, float(failed), float(failed), float(failed), 1, True
            )
        algorithm = self._algorithm.conditioned(
            _conditionedEvent(self._event, combination), combination.fixed, share, number
        )
        try:
            algorithm.run()
        except (ValueError, RuntimeError) as error:
            raise type(error)(f"given {_described(values)}: {error}") from error
        result = algorithm.getResult()
        interval = result.getConfidenceInterval(0.95)
        return ConditionalPart(
            values,
            combination.probability,
            result.getProbabilityEstimate(),
            interval.getLowerBound()[0],
            interval.getUpperBound()[0],
            result.getEvaluationNumber(),
            result.getConverged(),
            result,
        )


def _conditionedEvent(event, combination: Combination):
    """The event given values of some inputs, of the law of the others; members of a union share one random vector."""
    source = ot.RandomVector(combination.law)

    def conditioned(event):
        kind = eventKind(event)
        inner = event.getImplementation() if event.getClassName() == "RandomVector" else event
        if kind in ("UnionEvent", "IntersectionEvent"):
            members = [conditioned(member) for member in inner.getEventCollection()]
            return (ot.UnionEvent if kind == "UnionEvent" else ot.IntersectionEvent)(members)
        function = event.getFunction()
        if combination.fixed:
            function = ot.ParametricFunction(function, list(combination.fixed), list(combination.fixed.values()))
        vector = ot.CompositeRandomVector(function, source)
        if kind == "DomainEvent":
            return ot.DomainEvent(vector, event.getDomain())
        return ot.ThresholdEvent(vector, event.getOperator(), event.getThreshold())

    return conditioned(event)


def _described(values):
    return ", ".join(f"{name} = {value:g}" for name, value in values.items()) or "the continuous parts"


@dataclasses.dataclass(frozen=True, eq=False)
class ConditionalPart:
    """The event given values of the inputs with atoms.

    Attributes
    ----------
    values : dict of str to float
        Of the inputs that have one; the others are in their continuous parts.
    weight : float
        Probability of these values.
    probability, lower95, upper95 : float
        Of the event given them.
    evaluations : int
    converged : bool
    result : ActiveSubspaceReliabilityResult or None
        None where a single run tells.
    """

    values: dict[str, float]
    weight: float
    probability: float
    lower95: float
    upper95: float
    evaluations: int
    converged: bool
    result: ActiveSubspaceReliabilityResult | None = None


class ConditionalReliabilityResult(OpenTURNSObject):
    """Result of `ConditionalReliability`; made by its ``run()``.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot import ConditionalReliability
    >>> ot.RandomGenerator.SetSeed(0)
    >>> law = ot.JointDistribution([ot.Bernoulli(0.5), ot.Dirac(3.0)])
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["a * b"]), ot.RandomVector(law))
    >>> algorithm = ConditionalReliability(ot.ThresholdEvent(vector, ot.Greater(), 2.0))
    >>> algorithm.run()
    >>> print(algorithm.getResult())
    ConditionalReliabilityResult
      probability: 5.0000e-01
      interval: [5.0000e-01, 5.0000e-01]
      parts: 2
      evaluations: 2
      converged: True
    """

    _derived = ("_sums",)

    def __init__(self, parts: list[ConditionalPart], omitted: float, target: float) -> None:
        self._parts, self._omitted, self._target = parts, omitted, target
        self._sums: np.ndarray | None = None

    def _shown(self):
        interval = self.getConfidenceInterval()
        return {
            "probability": f"{self.getProbabilityEstimate():.4e}",
            "interval": f"[{interval.getLowerBound()[0]:.4e}, {interval.getUpperBound()[0]:.4e}]",
            "parts": len(self._parts),
            "evaluations": self.getEvaluationNumber(),
            "converged": self.getConverged(),
        }

    def getParts(self) -> list[ConditionalPart]:
        """The parts, the likeliest values first."""
        return list(self._parts)

    def getTable(self) -> list[dict[str, Any]]:
        """The parts as rows of plain values, for instance for ``pandas.DataFrame``; None where an input has no single
        value."""
        names = list(dict.fromkeys(name for part in self._parts for name in part.values))
        return [
            {name: part.values.get(name) for name in names}
            | {
                field.name: getattr(part, field.name)
                for field in dataclasses.fields(part)
                if field.name not in ("values", "result")
            }
            for part in self._parts
        ]

    def getProbabilityEstimate(self) -> float:
        """The sum."""
        return sum(part.weight * part.probability for part in self._parts)

    def getVarianceEstimate(self) -> float:
        """Its variance."""
        return sum(part.weight**2 * part.result.getVarianceEstimate() for part in self._parts if part.result)

    def getStandardDeviation(self) -> float:
        """Standard deviation of the sum."""
        return math.sqrt(self.getVarianceEstimate())

    def getCoefficientOfVariation(self) -> float:
        """Standard deviation over the estimate; infinite where that is 0."""
        probability = self.getProbabilityEstimate()
        return self.getStandardDeviation() / probability if probability > 0.0 else math.inf

    def getConfidenceInterval(self, level: float = 0.95) -> ot.Interval:
        """Confidence interval of the sum, conditional on what those of the parts are, see `ConditionalReliability`."""
        if not 0.0 < level < 1.0:
            raise ValueError(f"the confidence level is {level}; it must lie between 0 and 1")
        if self._sums is None:
            self._sums = self._drawSums()
        lower, upper = np.quantile(self._sums, [0.5 - 0.5 * level, 0.5 + 0.5 * level])
        return ot.Interval(float(lower), min(float(upper) + self._omitted, 1.0))

    def _drawSums(self):
        # The same whenever it is asked for.
        generator = np.random.default_rng(0)
        sums = np.zeros(_POINTS)
        for part in self._parts:
            if part.result is None:
                sums += part.weight * part.probability
            else:
                sums += part.weight * part.result.getInterval().quantiles(generator.random(_POINTS))
        return sums

    def getEvaluationNumber(self) -> int:
        """True runs of all parts."""
        return sum(part.evaluations for part in self._parts)

    def getConverged(self) -> bool:
        """Whether the target was reached: by each part, or by the sum whatever the probabilities of others are."""
        open_ = sum(part.weight * part.upper95 for part in self._parts if not part.converged)
        return open_ <= self._target * self.getProbabilityEstimate()

    def getReason(self) -> str:
        """What is to be known of the estimate, in a sentence."""
        missing = [part for part in self._parts if not part.converged]
        if not missing:
            return f"all {len(self._parts)} parts have converged"
        largest = max(missing, key=lambda part: part.weight * part.upper95)
        return (
            f"{len(missing)} of {len(self._parts)} parts have not converged; together they may add up to "
            f"{sum(part.weight * part.upper95 for part in missing):.1e}, the largest one given "
            f"{_described(largest.values)}"
        )
