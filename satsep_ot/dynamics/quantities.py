"""Quantities of interest of a separation.

Each is one function of what a run leaves behind, the fields of its base (see `base_fields`), in SI units and radians. A
new quantity is one row of `QUANTITIES`.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from satsep_ot.dynamics.free_flight import complex_gradient, leaning, quaternion_products, rotation_vector, turned
from satsep_ot.dynamics.kernels.records import STATE
from satsep_ot.dynamics.parameter_vector import TENSOR
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
        What it depends on: m of `base_fields` and of the separation's parameters, such as "satellite.mass".
    value : callable
        From the values of these fields, shape (n, m), to the quantity, shape (n,).
    gradient : callable
        From the same to its derivatives with respect to them, shape (n, m).
    part_of : str
        The quantity that this one is a part of, as the clearance of one point is; empty for the others.
    norm_of : tuple of str
        The smooth quantities that this one is the norm of (of one, its absolute value): surrogates are made of these.
    is_main : bool
        Whether a report tells of it where no requirement limits it.
    """

    unit: str
    description: str
    fields: tuple[str, ...]
    value: Callable
    gradient: Callable
    part_of: str = ""
    norm_of: tuple[str, ...] = ()
    is_main: bool = True


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


def _smooth(unit, description, fields, function):
    """A smooth function of several fields, written so that it takes complex numbers."""
    return Quantity(unit, description, fields, function, complex_gradient(function), is_main=False)


def _size(unit, description, parts):
    """The norm of quantities, which need no field of their own: those of the parts, each as often as it occurs."""
    quantities = list(parts.values())
    ends = np.cumsum([len(part.fields) for part in quantities])[:-1]

    def value(values):
        return np.linalg.norm(_each(values, "value"), axis=0)

    def gradient(values):
        found = _each(values, "value")
        length = np.linalg.norm(found, axis=0)
        shares = found / np.where(length > 0.0, length, 1.0)
        return np.hstack([share[:, None] * one for share, one in zip(shares, _each(values, "gradient"), strict=True)])

    def _each(values, what):
        pieces = np.split(values, ends, axis=1)
        return [getattr(part, what)(piece) for part, piece in zip(quantities, pieces, strict=True)]

    fields = tuple(field for part in quantities for field in part.fields)
    return Quantity(unit, description, fields, value, gradient, norm_of=tuple(parts), is_main=False)


def _minor(quantity):
    return quantity._replace(is_main=False)


_W = ("w_x", "w_y", "w_z")
_OMEGA = ("omega_2_x", "omega_2_y", "omega_2_z")
_INERTIA = tuple(f"satellite.inertia.{element}" for element in TENSOR)
_ATTITUDE = tuple(f"{name}_{element}" for name in ("q_1", "Q") for element in _ELEMENTS[4])


def _tensor(columns):
    """Tensors (n, 3, 3) from their elements (n, 6) in the order of `TENSOR`."""
    places = {name: k for k, name in enumerate(TENSOR)}
    return np.stack(
        [np.stack([columns[:, places["".join(sorted(i + j))]] for j in "xyz"], axis=1) for i in "xyz"], axis=1
    )


def _platform_speed(values):
    share = values[:, 4] / (values[:, 3] + values[:, 4])
    # The squares of absurd runs would overflow.
    largest = np.maximum(np.abs(values[:, :3]).max(axis=1), np.finfo(float).tiny)
    return share * largest * np.sqrt(((values[:, :3] / largest[:, None]) ** 2).sum(axis=1))


def _nutation(component):
    def function(values):
        momentum = np.einsum("nij,nj->ni", _tensor(values[:, 3:]), values[:, :3])
        # The spin axis points to the side of the angular momentum.
        momentum = np.where(np.real(momentum[:, 1:2]) < 0.0, -momentum, momentum)
        return DEGREES * leaning(momentum[:, component], momentum[:, 2 - component], momentum[:, 1])

    return function


def _direction(component):
    return lambda values: DEGREES * leaning(values[:, component], values[:, 2 - component], values[:, 1])


_DIRECTION = {
    f"direction_{axis}": _smooth(
        "deg",
        f"angle of the separation velocity from the platform's y axis towards {axis}, at the last release",
        _W,
        _direction(component),
    )
    for axis, component in (("x", 0), ("z", 2))
}
_NUTATION = {
    f"nutation_{axis}": _smooth(
        "deg",
        f"angle of the satellite's angular momentum from its y axis towards {axis}, at the last release",
        (*_OMEGA, *_INERTIA),
        _nutation(component),
    )
    for axis, component in (("x", 0), ("z", 2))
}
_PLATFORM_RATES = {
    f"platform_rate_{axis}": _minor(
        scaled("deg/s", f"platform body rate about {axis} at the last release", f"omega_1_{axis}", DEGREES)
    )
    for axis in "xyz"
}

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
    **_PLATFORM_RATES,
    "platform_rate": _size("deg/s", "magnitude of the platform's rate at the last release", _PLATFORM_RATES),
    "platform_velocity_change": _smooth(
        "m/s",
        "speed of the platform from the common centre of mass after the last release, m_2 / (m_1 + m_2) times the "
        "separation speed: its change of velocity where the stack does not turn",
        (*_W, "platform.mass", "satellite.mass"),
        _platform_speed,
    ),
    **_DIRECTION,
    "half_cone_angle": _size(
        "deg", "angle between the separation velocity and the platform's y axis at the last release", _DIRECTION
    ),
    **_NUTATION,
    "nutation_angle": _size(
        "deg", "angle between the satellite's angular momentum and its y axis, to either side, after the last release",
        _NUTATION,
    ),
}  # fmt: skip

# Of separations with contact.
CONTACT_QUANTITIES = {
    "contact_impulse": scaled("N s", "impulse of all normal forces of contact", "contact_impulse"),
    "contact_force": scaled("N", "largest normal force of a point of contact", "contact_force"),
    "last_contact": scaled("s", "time at which the last contact ends; 0 where nothing has touched", "last_contact"),
}


# Further quantities have a time [s] in their name; the table [coast] of a case asks for them.
LONGEST_COAST = 100.0  # s


def coast_quantities(separation: Separation) -> dict[str, Quantity]:
    """The quantities at the times after the last release that are asked for, in a flight free of forces and torques.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from satsep_ot.dynamics.quantities import coast_quantities
    >>> from satsep_ot.model.case import load_case
    >>> list(coast_quantities(replace(load_case("reference").separation, coast_times=(10.0,))))[:2]
    ['distance_at_10_s', 'turn_x_at_10_s']
    """
    table: dict[str, Quantity] = {}
    for time in separation.coast_times:
        after = f"{time:g} s after the last release"
        table[f"distance_at_{time:g}_s"] = _smooth(
            "m", f"distance of the CGs {after}, without gravity", ("d_x", "d_y", "d_z", *_W), _distance(time)
        )
        turns = {
            f"turn_{axis}_at_{time:g}_s": _smooth(
                "deg",
                f"{axis} of the rotation vector of the satellite from the attitude of the stack at t = 0, {after}",
                (*_ATTITUDE, *_OMEGA, *_INERTIA),
                _turn(separation.attitude, time, component),
            )
            for component, axis in enumerate("xyz")
        }
        text = f"angle that the satellite has turned from the attitude of the stack at t = 0, {after}"
        table |= turns | {f"attitude_error_at_{time:g}_s": _size("deg", text, turns)}
    return table


def _distance(time):
    return lambda values: np.sqrt(((values[:, :3] + time * values[:, 3:]) ** 2).sum(axis=1))


def _turn(attitude, time, component):
    start = np.array([1.0, -1.0, -1.0, -1.0]) * attitude

    def function(values):
        released = quaternion_products(values[:, :4], values[:, 4:8])
        after = turned(released, values[:, 8:11], _tensor(values[:, 11:]), time)
        return DEGREES * rotation_vector(quaternion_products(start, after))[:, component]

    return function


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
    """The quantities of a separation, by name: those above, its clearances, contact, and what it asks for."""
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
    return table | coast_quantities(separation)
