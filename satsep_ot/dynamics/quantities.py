"""Quantities of interest of a separation.

Each is one function of what a run leaves behind, the fields of its base (see `base_fields`), in SI units and radians. A
new quantity is one row of `QUANTITIES`.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from satsep_ot.dynamics.kernels.records import STATE
from satsep_ot.dynamics.separation import Separation

DEGREES = 180.0 / math.pi

_ELEMENTS = {3: ("x", "y", "z"), 4: ("w", "x", "y", "z")}
STATE_FIELDS = [f"{name}_{element}" for name in STATE.names[1:] for element in _ELEMENTS[STATE[name].shape[0]]]


class Quantity(NamedTuple):
    """A named quantity of interest.

    Attributes
    ----------
    unit, description : str
    fields : tuple of str
        What it depends on, m of `base_fields`.
    value : callable
        From the values of these fields, shape (n, m), to the quantity, shape (n,).
    gradient : callable
        From the same to its derivatives with respect to them, shape (n, m).
    part_of : str
        The quantity that this one is a part of, as the clearance of one point is; empty for the others.
    norm_of : tuple of str
        The smooth quantities that this one is the norm of (of one, its absolute value): surrogates are made of these.
    """

    unit: str
    description: str
    fields: tuple[str, ...]
    value: Callable
    gradient: Callable
    part_of: str = ""
    norm_of: tuple[str, ...] = ()


def scaled(unit: str, description: str, field: str, factor: float = 1.0) -> Quantity:
    """One field in another unit."""
    return Quantity(
        unit, description, (field,), lambda values: factor * values[:, 0], lambda values: np.full(values.shape, factor)
    )


def norm(
    unit: str, description: str, fields: tuple[str, ...], factor: float = 1.0, norm_of: tuple[str, ...] = ()
) -> Quantity:
    """The length of the vector of several fields, in another unit; `norm_of` as in `Quantity`."""

    def gradient(values):
        length = np.linalg.norm(values, axis=1, keepdims=True)
        # A norm has no gradient at 0: 0 is one of its subgradients.
        return factor * values / np.where(length > 0.0, length, 1.0)

    def value(values):
        return factor * np.linalg.norm(values, axis=1)

    return Quantity(unit, description, fields, value, gradient, norm_of=norm_of)


QUANTITIES = {
    "axial_velocity": scaled(
        "m/s",
        "separation velocity along the platform's y axis at the last release (inertial difference of the CGs)",
        "w_y",
    ),
    "rate_x": scaled("deg/s", "satellite body rate about x at the last release", "omega_2_x", DEGREES),
    "rate_y": scaled(
        "deg/s", "satellite body rate about y, the separation axis, at the last release", "omega_2_y", DEGREES
    ),
    "rate_z": scaled("deg/s", "satellite body rate about z at the last release", "omega_2_z", DEGREES),
    "lateral_rate": norm(
        "deg/s",
        "satellite rate across the separation axis, sqrt(rate_x^2 + rate_z^2)",
        ("omega_2_x", "omega_2_z"),
        DEGREES,
        ("rate_x", "rate_z"),
    ),
    "spin": norm(
        "deg/s", "absolute satellite rate about the separation axis, |rate_y|", ("omega_2_y",), DEGREES, ("rate_y",)
    ),
    "tip_off_rate": norm(
        "deg/s",
        "magnitude of the satellite's rate at the last release, sqrt(rate_x^2 + rate_y^2 + rate_z^2)",
        ("omega_2_x", "omega_2_y", "omega_2_z"),
        DEGREES,
        ("rate_x", "rate_y", "rate_z"),
    ),
    "lateral_velocity": norm(
        "m/s",
        "separation velocity across the platform's y axis at the last release (inertial difference of the CGs)",
        ("w_x", "w_z"),
    ),
    "release_time": scaled("s", "time of the last release", "time"),
    "deck_height": scaled(
        "mm",
        "smallest height of the satellite's foot over the deck, less that at the start where this is below 0",
        "deck_height",
        1e3,
    ),
}

# Of separations with contact.
CONTACT_QUANTITIES = {
    "contact_impulse": scaled("N s", "impulse of all normal forces of contact", "contact_impulse"),
    "contact_force": scaled("N", "largest normal force of a point of contact", "contact_force"),
    "last_contact": scaled("s", "time at which the last contact ends; 0 where nothing has touched", "last_contact"),
}


def base_fields(separation: Separation) -> list[str]:
    """The names of the B numbers that a run leaves behind.

    Parameters
    ----------
    separation : Separation

    Returns
    -------
    fields : list of str
        The state at the last release, "d_x" to "q_1_z" (see `satsep_ot.dynamics.kernels.records`), its "time", the
        smallest "clearance", the smallest "deck_height", the clearance of each followed envelope point at the instant
        at which it leaves the recess, "exit_clearance_1" and so on, and the "recontact_distance" where it is asked for.

    Examples
    --------
    >>> from satsep_ot.dynamics.quantities import base_fields
    >>> from satsep_ot.dynamics.separation import Body, Separation, Springs
    >>> springs = Springs([0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03)
    >>> base_fields(Separation(Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35]), springs))[3:9]
    ['w_x', 'w_y', 'w_z', 'omega_1_x', 'omega_1_y', 'omega_1_z']
    """
    exits = [f"exit_clearance_{i + 1}" for i in range(len(separation.recess_points()))]
    contacts = ["contact_impulse", "contact_force", "last_contact"] * separation.has_contact()
    recontact = ["recontact_distance"] * (separation.recontact is not None)
    return [*STATE_FIELDS, "time", "clearance", "deck_height", *exits, *contacts, *recontact]


def quantity_table(separation: Separation) -> dict[str, Quantity]:
    """The quantities of a separation, by name: those above, and with an envelope its clearances."""
    table = dict(QUANTITIES)
    points = separation.recess_points()
    if len(points):
        table["clearance"] = scaled(
            "mm", "smallest clearance of the envelope points in the recess until they have left it", "clearance", 1e3
        )
    for i, point in enumerate(points):
        place = ", ".join(f"{1e3 * coordinate:g}" for coordinate in point)
        name = f"exit_clearance_{i + 1}"
        table[name] = scaled(
            "mm",
            f"clearance of the envelope point ({place}) mm at the instant at which it leaves the recess",
            name,
            1e3,
        )._replace(part_of="clearance")
    if separation.has_contact():
        table |= CONTACT_QUANTITIES
    if separation.recontact is not None:
        window = separation.recontact
        table["recontact_distance"] = scaled(
            "m",
            f"smallest distance of the CGs, {window.start_orbits:g} to {window.end_orbits:g} orbits after the release",
            "recontact_distance",
        )
    return table
