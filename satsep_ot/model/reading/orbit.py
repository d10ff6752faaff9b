"""The orbit, the attitude that follows from it, and the window of the re-contact, from their tables."""

import math

import numpy as np

from satsep_ot.dynamics.gravity import EARTH_RADIUS
from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.relative_orbit import Recontact, check_orbit
from satsep_ot.dynamics.rotations import quaternion_from_matrix, rotation_matrix
from satsep_ot.model.reading.table import Table

# The ways to give an orbit, by the keys that choose each.
_WAYS = {
    "altitude": ("altitude",),
    "perigee_altitude": ("perigee_altitude", "apogee_altitude"),
    "semi_major_axis": ("semi_major_axis",),
    "position": ("position", "velocity"),
}
_ANGLES = ("inclination", "right_ascension", "argument_of_perigee", "true_anomaly")


def read_orbit(table: Table | None, initial: Table) -> tuple[Orbit | None, np.ndarray]:
    """The orbit (None without gravity), and the platform's attitude in its inertial axes.

    Parameters
    ----------
    table : Table or None
        [orbit]
    initial : Table
        [initial], which may give the attitude.

    Returns
    -------
    orbit : Orbit or None
    attitude : ndarray, shape (4,)
        Quaternion, body to inertial.

    Raises
    ------
    CaseError
        If keys are missing, not allowed, or contradict each other.
    """
    if table is None:
        return None, initial.read("attitude")
    way = _way(table)
    mu, j2 = table.read("gravitational_parameter"), table.read("j2")
    turned = [key for key in _ANGLES if key in table]
    if way == "altitude" and not turned:
        return _circular_orbit(table, initial.read("attitude"), mu, j2)
    if way == "position":
        if turned:
            raise table.problem(f"orbit.position and orbit.{turned[0]} are both given; give one of them")
        position, velocity = table.read("position", is_needed=True), table.read("velocity", is_needed=True)
        orbit = _build(table, Orbit, position, velocity, mu, j2)
    else:
        axis, eccentricity = _axis_and_eccentricity(table, way)
        angles = [table.read(key, is_needed=key == "inclination") for key in _ANGLES]
        orbit = _build(table, Orbit.from_elements, axis, eccentricity, *angles, mu, j2)
    return orbit, _pushed_attitude(table, initial, orbit, way)


def read_recontact(table: Table | None, orbit: Orbit | None) -> Recontact | None:
    """The window in which the smallest distance is looked for; None where it is not."""
    if table is None:
        return None
    if orbit is None:
        raise table.problem("the table [recontact] needs the table [orbit]")
    ends = [table.read(key) for key in table.rows.keys]
    try:
        check_orbit(orbit)
        return Recontact(*ends)
    except ValueError as error:
        raise table.problem(f"[recontact] cannot be used: {error}") from error


def _way(table):
    """The key that chooses the way in which the orbit is given."""
    given = [way for way, keys in _WAYS.items() if any(key in table for key in keys)]
    if len(given) > 1:
        raise table.problem(f"orbit.{given[0]} and orbit.{given[1]} are both given; give one of {', '.join(_WAYS)}")
    if not given:
        raise table.problem(f"orbit.altitude is missing; give it in km, or one of {', '.join(list(_WAYS)[1:])}")
    if "eccentricity" in table and given[0] != "semi_major_axis":
        raise table.problem("orbit.eccentricity needs orbit.semi_major_axis")
    return given[0]


def _build(table, build, *arguments):
    try:
        return build(*arguments)
    except ValueError as error:
        raise table.problem(str(error)) from error


def _circular_orbit(table, attitude, mu, j2):
    """A circular orbit whose plane follows from the attitude of the platform and the direction of the push."""
    if j2:
        raise table.problem(
            "orbit.inclination is missing; with j2 the plane of the orbit matters, and altitude leaves it open"
        )
    radius = EARTH_RADIUS + table.read("altitude")
    position, velocity = table.read("push")
    to_inertial = rotation_matrix(attitude)
    orbit = Orbit(
        position=to_inertial @ (radius * np.array(position, dtype=float)),
        velocity=to_inertial @ (math.sqrt(mu / radius) * np.array(velocity, dtype=float)),
        mu=mu,
    )
    return orbit, attitude


def _axis_and_eccentricity(table, way):
    """Semi-major axis [m] and eccentricity, from whichever keys say them."""
    if way == "semi_major_axis":
        eccentricity = table.read("eccentricity")
        return table.read("semi_major_axis"), eccentricity
    if way == "altitude":
        return EARTH_RADIUS + table.read("altitude"), 0.0
    perigee, apogee = (table.read(key, is_needed=True) for key in _WAYS["perigee_altitude"])
    if apogee < perigee:
        raise table.error("apogee_altitude", "at least the perigee_altitude")
    axis = EARTH_RADIUS + 0.5 * (perigee + apogee)
    return axis, 0.5 * (apogee - perigee) / axis


def _pushed_attitude(table, initial, orbit, way):
    """The attitude as given, or the one that points y where the push says, in the local horizontal of the orbit."""
    if "push" not in table and ("attitude" in initial or way == "position"):
        return initial.read("attitude")
    if "attitude" in initial:
        raise table.problem(
            "orbit.push and initial.attitude are both given, and each says where y points; give one of them"
        )
    up = orbit.position / np.linalg.norm(orbit.position)
    normal = np.cross(orbit.position, orbit.velocity)
    if not np.linalg.norm(normal) > 0.0:
        raise table.problem("orbit.push needs an orbit with a plane; position and velocity are parallel")
    normal /= np.linalg.norm(normal)
    body_up, body_along = table.read("push")
    orbit_axes = np.column_stack([up, np.cross(normal, up), normal])
    body_axes = np.column_stack([body_up, body_along, np.cross(body_up, body_along)]).astype(float)
    return quaternion_from_matrix(orbit_axes @ body_axes.T)
