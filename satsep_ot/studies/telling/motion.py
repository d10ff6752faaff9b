"""One run over time, as figures and the moving view show it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from satsep_ot.dynamics.invariants import spring_strokes
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.separation import Separation, Status
from satsep_ot.dynamics.simulation import trajectory
from satsep_ot.model.run_document import spring_names


class Motion(NamedTuple):
    """One run over time."""

    times: np.ndarray  # [s] (T,)
    gap: np.ndarray  # distance of the bodies' ring centres along the platform's y axis, 0 when stowed [m] (T,)
    velocity: np.ndarray  # axial separation velocity of the CGs [m/s] (T,)
    rates: np.ndarray  # body rates of the satellite [deg/s] (T, 3)
    strokes: np.ndarray  # of each spring while it pushes, NaN before and after [m] (T, N)
    release_times: np.ndarray  # [s] (N,); NaN for a spring that has failed
    release_strokes: np.ndarray  # [m] (N,)
    centres: np.ndarray  # satellite's ring centre from the platform's, in platform axes [m] (T, 3)
    attitudes: np.ndarray  # rotation matrices from satellite to platform axes (T, 3, 3)
    names: tuple  # of the springs, str (N,)
    pins: np.ndarray  # whether it is the pins of a connector, which hold back and do not push, bool (N,)


def compute_motion(
    separation: Separation, parameters: ArrayLike | None = None, end: float | None = None, size: int = 400
) -> Motion:
    """Simulate one run and read off what the figures over time show.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`
    parameters : array_like, shape (P,), optional
        The run; by default the nominal one.
    end : float, optional
        Until when [s]; by default half as long again as the last release.
    size : int
        Points in time, beside the releases.

    Returns
    -------
    motion : Motion

    Raises
    ------
    RuntimeError
        If the run fails; the message says how.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.telling.motion import compute_motion
    >>> motion = compute_motion(load_case("reference").separation)
    >>> print(f"{motion.velocity[-1]:.3f} m/s, {1e3 * motion.release_strokes[0]:.3f} mm")
    0.598 m/s, 30.000 mm
    """
    run = trajectory(separation, [0.0], parameters)
    if run.status != Status.OK:
        raise RuntimeError(f"the separation cannot be drawn: {run.status.sentence}")
    releases = run.release_times
    if end is None:
        end = 1.5 * np.nanmax(releases)
    times = np.unique(np.concatenate([np.linspace(0.0, end, size), releases[releases <= end]]))
    states = trajectory(separation, times, parameters).states
    flown = separation if parameters is None else separation.with_parameters(np.asarray(parameters))
    turns = np.array([rotation_matrix(quaternion) for quaternion in states[:, 12:16]])
    # The satellite's ring centre from the platform's, in platform axes.
    centre = states[:, 0:3] - turns @ flown.satellite.center_of_mass + flown.platform.center_of_mass
    pushing = (times[:, None] >= flown.springs.delay) & (times[:, None] <= releases)
    strokes = np.where(pushing, spring_strokes(flown, states), np.nan)
    return Motion(
        times=times,
        gap=centre[:, 1] - centre[0, 1],
        velocity=states[:, 4],
        rates=np.degrees(states[:, 9:12]),
        strokes=strokes,
        release_times=releases,
        # A spring that has failed never pushes.
        release_strokes=np.array([np.nanmax(column) if np.isfinite(column).any() else np.nan for column in strokes.T]),
        centres=centre,
        attitudes=turns,
        names=tuple(spring_names(separation)),
        pins=separation.springs.law_property("holds_back"),
    )
