"""The probability that any of many satellites violates a requirement, with inputs that they share.

Of N satellites V violate it. Each satellite counts alike, so that

    P(V >= 1) = E[sum of 1_j / V over the satellites j that violate it] = N E[1_1 / (1 + V')]
              = N p E[1 / (1 + V') | 1_1]

where 1_1 says that the first one violates it, p is the probability of that, and V' is the number of the others that do.
The others have the shared inputs of the first one and their own inputs anew. So the runs of one satellite that violate
the requirement, with their weights, give the answer for the fleet, however rare a violation is.
"""

import math

import numpy as np
from scipy import stats

from satsep_ot.model.case import SYSTEM, Case
from satsep_ot.model.inputs import ParameterMap, joint_distribution
from satsep_ot.studies.telling.fleet import FleetEstimate
from satsep_ot.studies.true_violations import true_violations

# Runs of other satellites in all, and violations from which they start.
_RUNS = 200_000
_MOST_FAILURES = 4_000
_MOST_REPETITIONS = 20


def fleet_estimate(
    case: Case, requirement: str, known: tuple[float, float, float], inputs: np.ndarray, weights: np.ndarray
) -> FleetEstimate:
    """The probability that any satellite of the fleet of a case violates a requirement.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
    requirement : str
        Its name, or "any requirement".
    known : (float, float, float)
        The probability for one satellite with its 95 % bounds.
    inputs : ndarray, shape (m, d)
        Of runs of one satellite that violate the requirement.
    weights : ndarray, shape (m,)
        Density of the inputs over the density that each run was drawn from, to a common factor.

    Returns
    -------
    estimate : FleetEstimate
        Exact in what the satellites share; the interval holds the errors of `known` and of the runs of the others,
        which are drawn from OpenTURNS' generator.
    """
    size, (p, lower, upper) = case.fleet, known
    shared = tuple(row.name for row in case.inputs if row.is_shared)
    apart = _any_of(size, p)
    if not shared:
        return FleetEstimate(size, shared, p, apart, _any_of(size, lower), _any_of(size, upper), apart)
    if len(shared) == len(case.inputs):
        return FleetEstimate(size, shared, p, p, lower, upper, apart, float(size) if p > 0.0 else None)
    if len(inputs) < 2 or p <= 0.0:
        # Whatever they share, between one violation of all together and N apart.
        return FleetEstimate(size, shared, p, apart, lower, min(size * upper, 1.0), apart)
    rows = np.linspace(0, len(inputs) - 1, min(len(inputs), _MOST_FAILURES, max(_RUNS // (size - 1), 2))).astype(int)
    inputs, weights = inputs[rows], weights[rows]
    shares, runs = _shares(case, requirement, inputs)
    weights = weights / weights.sum()
    mean = float(weights @ shares)
    error = math.sqrt(float(((weights * (shares - mean)) ** 2).sum()) * len(rows) / (len(rows) - 1))
    spread = float(stats.t.ppf(0.975, len(rows) - 1)) * error / mean
    # Both errors are of factors: their logarithms add.
    below, above = (math.hypot(math.log(bound / p), spread) if bound > 0.0 else math.inf for bound in (lower, upper))
    value = size * p * mean
    low, high = max(value * math.exp(-below), lower), min(value * math.exp(above), size * upper, 1.0)
    return FleetEstimate(size, shared, p, min(value, 1.0), low, high, apart, 1.0 / mean, failures=len(rows), runs=runs)


def _any_of(size, probability):
    """The probability of any of some independent events."""
    return -math.expm1(size * math.log1p(-probability)) if probability < 1.0 else 1.0


def _shares(case, requirement, inputs):
    """1 / (1 + V') of each run that violates the requirement, the mean of some repetitions, and the runs for it."""
    others = case.fleet - 1
    repetitions = max(1, min(_MOST_REPETITIONS, _RUNS // (others * len(inputs))))
    number = others * repetitions
    distribution = joint_distribution(case.inputs, case.copula)
    scatter = ParameterMap(case.inputs, case.separation)
    shared = np.array([row.is_shared for row in case.inputs])
    column = [*(entry.name for entry in case.requirements), SYSTEM].index(requirement)
    sample = np.array(distribution.getSample(number * len(inputs)))
    # Shared inputs are independent of the others.
    sample[:, shared] = np.repeat(inputs[:, shared], number, axis=0)
    violated = true_violations(case.separation, case.requirements, scatter.parameters(sample))[:, column]
    counts = violated.reshape(len(inputs), repetitions, others).sum(axis=2)
    return (1.0 / (1.0 + counts)).mean(axis=1), len(sample)
