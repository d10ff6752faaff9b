"""Quantities of interest of a separation.

Each is one function of the base: what a run leaves behind (columns of a (n, B) array, SI, radians): the state at the
last release (see `satsep_ot.dynamics.system`), its time, the smallest clearance, and the clearance of each
followed envelope point at the instant at which it leaves the recess. A new quantity is one row of `QUANTITIES`.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from satsep_ot.dynamics.separation import Separation
from satsep_ot.dynamics.system import STATE_SIZE

TIME, CLEARANCE = STATE_SIZE, STATE_SIZE + 1
DEGREES = 180.0 / math.pi


class Quantity(NamedTuple):
    """A named quantity of interest:

    `value` and `gradient` take the base (n, B); `columns` are those that it depends on. `part_of` names the quantity
    that this one is a part of, as the clearance of one point is; it is empty for the others.
    """

    unit: str
    description: str
    columns: tuple
    value: Callable
    gradient: Callable  # (n, len(columns))
    part_of: str = ""


def _scaled(unit, description, column, factor=1.0):
    return Quantity(
        unit,
        description,
        (column,),
        lambda base: factor * base[:, column],
        lambda base: np.full((len(base), 1), factor),
    )


def _norm(unit, description, columns, factor=1.0):
    def gradient(base):
        norm = np.linalg.norm(base[:, columns], axis=1, keepdims=True)
        # A norm has no gradient at 0: 0 is one of its subgradients.
        return factor * base[:, columns] / np.where(norm > 0.0, norm, 1.0)

    return Quantity(
        unit, description, columns, lambda base: factor * np.linalg.norm(base[:, columns], axis=1), gradient
    )


QUANTITIES = {
    "axial_velocity": _scaled(
        "m/s", "separation velocity along the platform's y axis at the last release (inertial difference of the CGs)", 4
    ),
    "rate_x": _scaled("deg/s", "satellite body rate about x at the last release", 9, DEGREES),
    "rate_y": _scaled("deg/s", "satellite body rate about y, the separation axis, at the last release", 10, DEGREES),
    "rate_z": _scaled("deg/s", "satellite body rate about z at the last release", 11, DEGREES),
    "lateral_rate": _norm(
        "deg/s", "satellite rate across the separation axis, sqrt(rate_x^2 + rate_z^2)", (9, 11), DEGREES
    ),
    "spin": _norm("deg/s", "absolute satellite rate about the separation axis, |rate_y|", (10,), DEGREES),
    "tip_off_rate": _norm(
        "deg/s",
        "magnitude of the satellite's rate at the last release, sqrt(rate_x^2 + rate_y^2 + rate_z^2)",
        (9, 10, 11),
        DEGREES,
    ),
    "lateral_velocity": _norm(
        "m/s",
        "separation velocity across the platform's y axis at the last release (inertial difference of the CGs)",
        (3, 5),
    ),
    "release_time": _scaled("s", "time of the last release", TIME),
}


def quantity_table(separation: Separation) -> dict[str, Quantity]:
    """The quantities of a separation, by name: those above, and with an envelope its clearances."""
    table = dict(QUANTITIES)
    points = separation.recess_points()
    if len(points):
        table["clearance"] = _scaled(
            "mm", "smallest clearance of the envelope points in the recess until they have left it", CLEARANCE, 1e3
        )
    for i, point in enumerate(points):
        place = ", ".join(f"{1e3 * coordinate:g}" for coordinate in point)
        table[f"exit_clearance_{i + 1}"] = _scaled(
            "mm",
            f"clearance of the envelope point ({place}) mm at the instant at which it leaves the recess",
            CLEARANCE + 1 + i,
            1e3,
        )._replace(part_of="clearance")
    if separation.recontact is not None:
        window = separation.recontact
        table["recontact_distance"] = _scaled(
            "m",
            f"smallest distance of the CGs, {window.start_orbits:g} to {window.end_orbits:g} orbits after the release",
            CLEARANCE + 1 + len(points),
        )
    return table
