"""Missions simulated one by one: parts fail or not, and satellites share inputs, as a case says. The slow truth."""

import numpy as np

from satsep_ot.model.failures import set_failed
from satsep_ot.model.inputs import ParameterMap, joint_distribution
from satsep_ot.studies.true_violations import true_violations

_CHUNK = 100_000


def violations_with_failures(case, missions):
    """Missions that violate each requirement, and any, where each part fails by itself with its probability."""
    distribution, scatter = joint_distribution(case.inputs, case.copula), ParameterMap(case.inputs, case.separation)
    random, counts = np.random.default_rng(7), 0
    for start in range(0, missions, _CHUNK):
        size = min(_CHUNK, missions - start)
        parameters = scatter.parameters(np.array(distribution.getSample(size)))
        for failure in case.failures:
            failed = random.random(size) < failure.probability
            some = parameters[failed]
            set_failed(some, case.separation, failure)
            parameters[failed] = some
        counts = counts + true_violations(case.separation, case.requirements, parameters).sum(axis=0)
    return counts


def fleets_with_a_violation(case, missions):
    """Fleets in which any satellite violates each requirement, or any."""
    distribution, scatter = joint_distribution(case.inputs, case.copula), ParameterMap(case.inputs, case.separation)
    shared, counts = [row.is_shared for row in case.inputs], 0
    for start in range(0, missions, _CHUNK):
        size = min(_CHUNK, missions - start)
        common, any_of = np.array(distribution.getSample(size)), False
        for _ in range(case.fleet):
            inputs = np.array(distribution.getSample(size))
            inputs[:, shared] = common[:, shared]
            any_of = any_of | true_violations(case.separation, case.requirements, scatter.parameters(inputs))
        counts = counts + any_of.sum(axis=0)
    return counts
