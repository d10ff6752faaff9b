"""Runs of a separation as plain data that a page can draw moving: the bodies' shapes, and where they are over time."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from satsep_ot.dynamics.contact import element_places
from satsep_ot.dynamics.separation import Separation
from satsep_ot.dynamics.simulation import contact_events
from satsep_ot.studies.telling.motion import compute_motion

_FRAMES = 48  # of the push, and as many of the flight after it


def satellite_shape(separation: Separation) -> tuple[np.ndarray, list[list[int]]]:
    """A solid that stands for the satellite, in its axes from its ring centre.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    points : ndarray, shape (n, 3)
        The envelope, or without one a box as wide as the spring ring and twice as high as the centre of mass [m].
    faces : list of list of int
        Corners of each flat face of the convex hull, in order around it.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.telling.animation import satellite_shape
    >>> points, faces = satellite_shape(load_case("reference").separation)
    >>> len(points), sorted(len(face) for face in faces)
    (8, [4, 4, 4, 4, 4, 4])
    """
    points = separation.envelope
    if points is not None:
        try:
            return points, _flat_faces(points)
        except QhullError:
            # Points in a plane or on a line have no hull: a box around them stands for them.
            half = np.abs(points[:, [0, 2]]).max() or 0.1
            height = points[:, 1].max()
    else:
        half, height = float(np.max(separation.springs.radius)), 2.0 * separation.satellite.center_of_mass[1]
    if not height > 0.1 * half:
        height = 2.0 * half
    half = half or 0.25 * height
    points = np.array([[x, y, z] for y in (0.0, height) for x in (-half, half) for z in (-half, half)])
    return points, _flat_faces(points)


def _flat_faces(points):
    """Faces of the convex hull, its triangles in one plane taken together."""
    hull = ConvexHull(points)
    planes = {}
    for triangle, equation in zip(hull.simplices, hull.equations, strict=True):
        planes.setdefault(tuple(np.round(equation, 6) + 0.0), set()).update(triangle.tolist())
    faces = []
    for plane, corners in planes.items():
        corners, normal = sorted(corners), np.array(plane[:3])
        around = points[corners] - points[corners].mean(axis=0)
        first = around[0] / np.linalg.norm(around[0])
        second = np.cross(normal, first)
        order = np.argsort(np.arctan2(around @ second, around @ first))
        faces.append([corners[k] for k in order])
    return faces


def animation_data(separation: Separation, runs: Mapping[str, ArrayLike]) -> dict:
    """Everything that the moving view of a report draws.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`
    runs : dict of str to array_like, shape (P,)
        Parameters of each run, by the label under which it is chosen.

    Returns
    -------
    data : dict
        Plain lists: ``shape`` (points, faces), ``platform`` (ring radius, recess radius and depth), and for each run
        ``times`` [s], ``centres`` [m] and ``turns`` (quaternions w, x, y, z) of the satellite in platform axes, the
        last release [s], the seats and release times of all that pushes, and of each contact its name, its place, the
        body that this is on, its time and the speed that it begins with. Half of the frames cover the push, half
        the flight until the satellite has gone about one and a half of its sizes.

    Raises
    ------
    RuntimeError
        If a run fails; the message says how.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.telling.animation import animation_data
    >>> separation = load_case("reference").separation
    >>> data = animation_data(separation, {"nominal": separation.parameters()})
    >>> len(data["runs"]["nominal"]["times"]) == len(data["runs"]["nominal"]["turns"])
    True
    """
    points, faces = satellite_shape(separation)
    size = float(np.ptp(points, axis=0).max())
    data: dict[str, Any] = {
        "shape": {"points": _rounded(points), "faces": faces},
        "platform": {
            "ring": float(np.max(separation.springs.radius)),
            "recess_radius": float(separation.recess_radius) if separation.envelope is not None else 0.0,
            "recess_depth": float(separation.recess_depth) if separation.envelope is not None else 0.0,
        },
        "size": size,
        "runs": {},
    }
    for label, parameters in runs.items():
        push = compute_motion(separation, parameters, size=_FRAMES)
        last = float(np.nanmax(push.release_times))
        end = max(1.5 * size / abs(push.velocity[-1]), 3.0 * last)
        flight = compute_motion(separation, parameters, end=end, size=_FRAMES)
        later = flight.times > push.times[-1]
        times = np.concatenate([push.times, flight.times[later]])
        centres = np.concatenate([push.centres, flight.centres[later]])
        turns = np.concatenate([push.attitudes, flight.attitudes[later]])
        pushers = np.flatnonzero(~push.pins)
        seats = separation.with_parameters(np.asarray(parameters)).springs.seats()
        data["runs"][label] = {
            "times": _rounded(times),
            "centres": _rounded(centres),
            "turns": _rounded(_quaternions(turns)),
            "pushEnd": float(push.times[-1]),
            "release": last,
            "seats": _rounded(seats[pushers]),
            "releases": [None if np.isnan(time) else time for time in _rounded(push.release_times[pushers])],
            "touches": _touches(separation, parameters),
        }
    return data


def _touches(separation, parameters):
    """What touches from when to when [s], how fast it comes [m/s], and where, for the moving view."""
    if not separation.has_contact():
        return []
    flown = separation.with_parameters(np.asarray(parameters))
    places, on_platform = element_places(flown)
    number = {name: i for i, name in enumerate(flown.contact_elements()[1])}
    touches, open_ones = [], {}
    for event in contact_events(separation, parameters):
        if event.what in ("is pressed", "engages"):
            i = number[event.name]
            touch = {"name": event.name, "from": round(event.time, 7), "to": None, "speed": round(-event.speed, 7)}
            touches.append(touch | {"place": _rounded(places[i]), "onPlatform": bool(on_platform[i])})
            open_ones[event.name] = touches[-1]
        elif event.name in open_ones and event.what in ("lets go", "leaves"):
            open_ones.pop(event.name)["to"] = round(event.time, 7)
    return touches


def _rounded(values):
    return np.round(values, 7).tolist()


def _quaternions(matrices):
    """Quaternions (w, x, y, z) of rotation matrices over time, without a change of sign on the way."""
    quaternions = Rotation.from_matrix(matrices).as_quat(canonical=True)[:, [3, 0, 1, 2]]
    signs = np.sign(np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1]))
    quaternions[1:] *= np.cumprod(np.where(signs < 0.0, -1.0, 1.0))[:, None]
    return quaternions
