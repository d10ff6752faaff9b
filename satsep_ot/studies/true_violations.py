"""Which of many true runs violate which requirement."""

from collections.abc import Sequence

import numpy as np

from satsep_ot.dynamics.separation import Separation, Status
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.model.requirement import Requirement

# Runs simulated at once.
_CHUNK = 16_384


def true_violations(separation: Separation, requirements: Sequence[Requirement], parameters: np.ndarray) -> np.ndarray:
    """Which requirements each run violates.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`
    requirements : sequence of :class:`satsep_ot.model.requirement.Requirement`, length R
    parameters : ndarray, shape (n, P)
        Parameter vectors of the runs.

    Returns
    -------
    violated : ndarray of bool, shape (n, R + 1)
        In the last column, whether any of them is violated. A run that does not end well, as one in which the bodies
        do not come apart, violates every requirement.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.true_violations import true_violations
    >>> case = load_case("reference")
    >>> true_violations(case.separation, case.requirements, case.separation.parameters()[None]).any()
    np.False_
    """
    violated = np.ones((len(parameters), len(requirements) + 1), dtype=bool)
    for start in range(0, len(parameters), _CHUNK):
        rows = slice(start, start + _CHUNK)
        outcome = simulate(separation, parameters[rows])
        well = outcome.status == Status.OK
        for column, entry in enumerate(requirements):
            violated[rows, column] = ~(well & entry.is_met(outcome.quantity(entry.quantity)))
    violated[:, -1] = violated[:, :-1].any(axis=1)
    return violated
