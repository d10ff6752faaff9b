"""The probability of a violation where parts fail with a probability of their own."""

import math
from collections.abc import Callable

import numpy as np

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.model.case import SYSTEM, Case
from satsep_ot.model.failures import PartFailure, failed_separation, set_failed
from satsep_ot.model.inputs import ParameterMap, joint_distribution
from satsep_ot.studies.telling.failure_mixture import ALL_PARTS, FailureMixture, FailureMode
from satsep_ot.studies.true_violations import true_violations

# Runs of a failure are added in blocks until what it adds is known to this part of the sum, or there are enough.
_BLOCK = 16_384
_MOST_RUNS = 131_072
_PRECISION = 0.02


def mode_weights(failures: tuple[PartFailure, ...]) -> tuple[list[float], float]:
    """The probability of no failure and of each single one, and the probability of two or more.

    Examples
    --------
    >>> from satsep_ot.model.failures import PartFailure
    >>> from satsep_ot.studies.failure_mixture import mode_weights
    >>> weights, omitted = mode_weights((PartFailure("a", 0.1, {}), PartFailure("b", 0.2, {})))
    >>> [round(weight, 3) for weight in weights], round(omitted, 3)
    ([0.72, 0.08, 0.18], 0.02)
    """
    works = [1.0 - failure.probability for failure in failures]
    weights = [math.prod(works)]
    for k, failure in enumerate(failures):
        weights.append(failure.probability * math.prod(works[:k] + works[k + 1 :]))
    return weights, max(1.0 - math.fsum(weights), 0.0)


def failure_mixtures(
    case: Case,
    known: dict[str, tuple[float, float, float]],
    progress: Callable[[str, float], None] = lambda label, share: None,
) -> dict[str, FailureMixture]:
    """The probability of each violation with failures of parts.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
        With failures.
    known : dict of str to (float, float, float)
        By requirement, or "any requirement", the probability with all parts in order and its 95 % bounds.
    progress : callable
        Called with what is being done and the share of it that is done.

    Returns
    -------
    mixtures : dict of str to FailureMixture
        By the requirements that are known. The runs are drawn from OpenTURNS' generator; all requirements share them.
    """
    weights, omitted = mode_weights(case.failures)
    names = [*(entry.name for entry in case.requirements), SYSTEM]
    modes = {name: [FailureMode(ALL_PARTS, weights[0], *known[name])] for name in names if name in known}
    for k, (failure, weight) in enumerate(zip(case.failures, weights[1:], strict=True)):
        progress(f"{failure.part} has failed", k / len(case.failures))
        runs, counts = _count(case, failure, weight, modes, names)
        for name, found in modes.items():
            count = int(counts[names.index(name)])
            found.append(FailureMode(failure.part, weight, count / runs, *clopperPearson(count, runs), runs, count))
    return {name: FailureMixture.of(tuple(found), omitted) for name, found in modes.items()}


def _count(case, failure, weight, modes, names):
    """How many runs there were with a part failed, and how many of them violate each requirement, and any."""
    separation = failed_separation(case.separation, failure)
    distribution = joint_distribution(case.inputs, case.copula)
    scatter = ParameterMap(case.inputs, case.separation)
    runs, counts = 0, np.zeros(len(names), dtype=int)
    while runs < _MOST_RUNS:
        parameters = scatter.parameters(np.asarray(distribution.getSample(_BLOCK)))
        set_failed(parameters, case.separation, failure)
        counts += np.count_nonzero(true_violations(separation, case.requirements, parameters), axis=0)
        runs += _BLOCK
        if all(_is_known(weight, int(counts[names.index(name)]), runs, found) for name, found in modes.items()):
            break
    return runs, counts


def _is_known(weight, count, runs, modes):
    """Whether a failure adds an error that is small beside the sum of what is known."""
    lower, upper = clopperPearson(count, runs)
    total = sum(mode.weight * mode.upper95 for mode in modes) + weight * upper
    return weight * (upper - lower) <= 2.0 * _PRECISION * total
