"""Parts that fail with a probability, from the tables of springs, connectors and hold-downs."""

from collections.abc import Iterable

import numpy as np

from satsep_ot.dynamics.separation import Separation
from satsep_ot.model.failures import PartFailure
from satsep_ot.model.inputs import umbilical_springs
from satsep_ot.model.reading.table import Table


def read_failures(
    springs: Table, connectors: Iterable[Table], hold_downs: Iterable[Table], separation: Separation
) -> tuple[PartFailure, ...]:
    """The parts whose `failure_probability` is above 0: springs, then connectors, then hold-downs.

    Parameters
    ----------
    springs : Table
    connectors, hold_downs : iterable of Table
    separation : Separation
        The one that was read from them.

    Returns
    -------
    failures : tuple of PartFailure

    Raises
    ------
    CaseError
        If a probability is not from 0 to 1, or a key is missing or of no use.
    """
    failures = [*_springs(springs, separation), *_connectors(connectors, separation), *_hold_downs(hold_downs)]
    return tuple(failure for failure in failures if failure.probability > 0.0)


def _springs(table, separation):
    own = len(separation.springs) - 2 * len(umbilical_springs(separation))
    probabilities = table.read("failure_probability", own)
    for i, probability in enumerate(np.broadcast_to(probabilities, own)):
        if probability > 0.0 and separation.springs.scale[i] == 0.0:
            raise table.problem(
                f"springs.failure_probability of spring {i + 1} is {probability:g}, but it has failed already; give 0 "
                "there"
            )
        yield PartFailure(f"spring {i + 1}", float(probability), {f"springs[{i}].scale": 0.0})


def _connectors(tables, separation):
    for number, (table, i) in enumerate(zip(tables, umbilical_springs(separation), strict=True), start=1):
        parameters = {f"springs[{i}].scale": 0.0}
        yield PartFailure(f"umbilical connector {number}", table.read("failure_probability"), parameters)


def _hold_downs(tables):
    first = 0
    for number, table in enumerate(tables, start=1):
        joints = range(first, first + int(table.read("points")))
        first = joints.stop
        probability = table.read("failure_probability")
        late = table.read("failed_release", is_needed=probability > 0.0)
        if late is not None and probability == 0.0:
            raise table.problem(f"{table.path}.failed_release needs a failure_probability above 0")
        if late is not None and late <= table.read("release"):
            raise table.error("failed_release", "later than `release`")
        if probability > 0.0:
            parameters = {f"hold_downs[{joint}].release": late for joint in joints}
            yield PartFailure(f"hold-down {number}", probability, parameters)
