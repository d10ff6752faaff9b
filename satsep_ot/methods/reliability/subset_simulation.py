"""Subset simulation (Au and Beck, Probabilistic Engineering Mechanics 16, 2001) within a number of evaluations.

OpenTURNS' SubsetSampling has no limit on its evaluations and reports the lower bound of its error, which takes the
levels for independent; this one stops at the limit and reports the upper bound.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from satsep_ot.methods.reliability.limit_state import Runs

_CONDITIONAL_PROBABILITY = 0.1
_CHAIN_LENGTH = 10
# Levels that the evaluations must last for: down to a probability of about 1e-7.
_LEVELS = 7


@dataclasses.dataclass
class SubsetEstimate:
    """Outcome of `runSubsetSimulation`.

    Attributes
    ----------
    probability : float
        0 when no failure was reached.
    coefficientOfVariation : float
        Upper bound (levels fully correlated) of the estimate's error; infinite when no failure was reached.
    upperBound : float
        Probability of the last level reached: where no failure was found, the event is rarer than about this.
    runs : Runs
        All runs made.
    nominal : list of Runs
        Those of them that are independent draws of the standard normal distribution: the first level of each
        simulation. They are the objects that the function gave, not copies.
    """

    probability: float
    coefficientOfVariation: float
    upperBound: float
    runs: Runs
    nominal: list[Runs] = dataclasses.field(default_factory=list)


def runSubsetSimulation(
    evaluate: Callable[[np.ndarray], Runs], dimension: int, maximumEvaluations: int, generator: np.random.Generator
) -> SubsetEstimate:
    """Estimate the probability of failure in standard space; repeats itself while the evaluations allow it.

    Parameters
    ----------
    evaluate : callable
        Maps points (n, d) on their `Runs`.
    dimension : int
        d.
    maximumEvaluations : int
        At least 7 * 20.
    generator : :py:class:`numpy.random.Generator`

    Returns
    -------
    SubsetEstimate
    """
    chains = max(maximumEvaluations // (_LEVELS * _CHAIN_LENGTH), 2)
    passes: list[SubsetEstimate] = []
    remaining, used = maximumEvaluations, 0
    while not passes or 1.1 * used <= remaining:
        passes.append(_onePass(evaluate, dimension, chains, remaining, generator))
        used = len(passes[-1].runs)
        remaining -= used
    return combineEstimates(passes)


def combineEstimates(estimates: list[SubsetEstimate]) -> SubsetEstimate:
    """The mean of independent estimates; where they disagree, that is its error.

    Levels that have lost a failure region claim a small error all the same; other ones show it. Weights by the runs
    would favour small probabilities, which take more levels.
    """
    number = len(estimates)
    probabilities = np.array([estimate.probability for estimate in estimates])
    mean, error = float(probabilities.mean()), math.inf
    if mean > 0.0:
        # One that found nothing contributes its bound to the uncertainty.
        deviations = [
            part.probability * part.coefficientOfVariation if part.probability > 0.0 else part.upperBound
            for part in estimates
        ]
        within = float(np.square(deviations).sum()) / number**2
        between = float(probabilities.var(ddof=1)) / number if number > 1 else 0.0
        error = math.sqrt(max(within, between)) / mean
    bound = max(part.upperBound for part in estimates)
    nominal = [runs for part in estimates for runs in part.nominal]
    return SubsetEstimate(mean, error, bound, Runs.concatenate([part.runs for part in estimates]), nominal)


def _values(runs):
    """Limit state values where a run that is not finite is as deep in its side as can be."""
    return np.where(runs.finite, runs.margins, np.where(runs.failed, -1e300, 1e300))


def _onePass(evaluate, dimension, chains, budget, generator):
    """One subset simulation."""
    size = chains * _CHAIN_LENGTH
    runs = evaluate(generator.standard_normal((size, dimension)))
    parts = [runs]
    points, values = runs.u, _values(runs)
    probability, variation, step = 1.0, 0.0, 0.6
    chainValues = None
    while True:
        order = np.argsort(values)
        level = 0.5 * (values[order[chains - 1]] + values[order[chains]])
        failures = int(np.count_nonzero(values <= 0.0))
        if level <= 0.0 or failures >= chains:
            final, variation = failures / size, variation + _levelVariation(values <= 0.0, chainValues, 0.0)
            return SubsetEstimate(
                probability * final, variation, probability * final, Runs.concatenate(parts), parts[:1]
            )
        if len(values) > failures > 0 and budget - sum(map(len, parts)) < size - chains:
            final, variation = failures / size, variation + _levelVariation(values <= 0.0, chainValues, 0.0)
            bound = probability * _CONDITIONAL_PROBABILITY
            return SubsetEstimate(probability * final, variation, bound, Runs.concatenate(parts), parts[:1])
        if budget - sum(map(len, parts)) < size - chains or not level < values[order[-1]]:
            bound = probability * _CONDITIONAL_PROBABILITY
            return SubsetEstimate(0.0, math.inf, bound, Runs.concatenate(parts), parts[:1])
        variation += _levelVariation(values <= level, chainValues, level)
        probability *= _CONDITIONAL_PROBABILITY
        current, currentValues = points[order[:chains]], values[order[:chains]]
        pointList, valueList = [current], [currentValues]
        for _ in range(_CHAIN_LENGTH - 1):
            # Conditional sampling in standard space (Papaioannou et al., 2015): no rejection by the density.
            candidate = math.sqrt(1.0 - step**2) * current + step * generator.standard_normal(current.shape)
            runs = evaluate(candidate)
            parts.append(runs)
            candidateValues = _values(runs)
            accepted = candidateValues <= level
            current = np.where(accepted[:, None], candidate, current)
            currentValues = np.where(accepted, candidateValues, currentValues)
            step = min(max(step * math.exp(accepted.mean() - 0.44), 0.05), 0.95)
            pointList.append(current)
            valueList.append(currentValues)
        points, values = np.concatenate(pointList), np.concatenate(valueList)
        chainValues = np.array(valueList)


def _levelVariation(indicator, chainValues, level):
    """Coefficient of variation of a level's conditional probability, with the correlation of the chains."""
    share = indicator.mean()
    if share == 0.0:
        return math.inf
    correlation = 0.0
    if chainValues is not None and share < 1.0:
        inside = (chainValues <= level).astype(float) - share
        for lag in range(1, len(inside)):
            covariance = (inside[lag:] * inside[:-lag]).mean()
            correlation += 2.0 * (1.0 - lag / len(inside)) * covariance / (share * (1.0 - share))
    return math.sqrt((1.0 - share) / (share * len(indicator)) * (1.0 + max(correlation, 0.0)))
