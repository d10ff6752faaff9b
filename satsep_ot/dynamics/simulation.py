"""Simulate many separations at once: `simulate` for their outcomes, `trajectory` for one over time."""

from dataclasses import dataclass

import numpy as np
from numba import njit, prange

from satsep_ot.dynamics.compilation import OPTIONS
from satsep_ot.dynamics.flight import MAXIMUM_STEPS, Follow, Tape, run
from satsep_ot.dynamics.integration import STAGES, Work
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.rigid_body import CONSTANT_SIZE, GRAVITY, GRAVITY_WITH_TORQUE, NO_GRAVITY, STATE_SIZE, System
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.separation import Separation, Status, invalid_parameter
from satsep_ot.dynamics.springs import SPRING_COLUMNS

CHUNK = 64  # runs that share their working arrays; the result of a run does not depend on it


@njit(**OPTIONS)
def work_space(spring_number, points, stop_number):
    """The working arrays of a chunk of runs."""
    point_number = points.shape[0]
    return (
        np.zeros(CONSTANT_SIZE),
        np.zeros((spring_number, SPRING_COLUMNS)),
        np.zeros(spring_number, np.bool_),
        np.zeros(spring_number, np.bool_),
        Work(np.zeros((STAGES + 1, STATE_SIZE)), np.zeros((STAGES, STATE_SIZE)), np.ones(STATE_SIZE)),
        Tape(
            np.zeros((MAXIMUM_STEPS + 1, STATE_SIZE)),
            np.zeros(MAXIMUM_STEPS + 1),
            np.zeros(MAXIMUM_STEPS),
            np.zeros(MAXIMUM_STEPS, np.int64),
            np.zeros(MAXIMUM_STEPS, np.int64),
            np.zeros(MAXIMUM_STEPS, np.int64),
        ),
        Follow(
            np.zeros(point_number, np.int64),
            np.zeros(point_number, np.int64),
            np.zeros(point_number),
            np.zeros((point_number, STATE_SIZE)),
            np.zeros(point_number),
            np.zeros(STATE_SIZE),
            np.zeros(5),
        ),
        np.zeros((stop_number + 1, STATE_SIZE)),
    )


@njit(**OPTIONS)
def collect(status, last, tape, follow, base):
    """Write what the quantities are made of: state and time at the last release, smallest clearance, clearances at exit."""
    if status != 0:
        base[:] = np.nan
        return
    for n in range(STATE_SIZE):
        base[n] = tape.x[last, n]
    base[STATE_SIZE] = tape.t[last]
    base[STATE_SIZE + 1] = follow.closest[0]
    for i in range(follow.clearance.shape[0]):
        base[STATE_SIZE + 2 + i] = follow.clearance[i]


@njit(parallel=True, **OPTIONS)
def run_all(
    parameters, orbit, attitude, points, force_line, gravity, horizon, tolerance, base, release_time, status, steps
):
    """Every row of `parameters`, in parallel over chunks of rows."""
    count = parameters.shape[0]
    for chunk in prange((count + CHUNK - 1) // CHUNK):
        c, springs, active, pending, work, tape, follow, stop_x = work_space(release_time.shape[1], points, 0)
        for row in range(chunk * CHUNK, min(count, (chunk + 1) * CHUNK)):
            system = System(parameters[row], c, springs, active, points, force_line, gravity)
            code, number, last = run(
                orbit,
                attitude,
                np.empty(0),
                horizon,
                tolerance,
                system,
                pending,
                work,
                tape,
                follow,
                release_time[row],
                stop_x,
            )
            status[row], steps[row] = code, number
            collect(code, last, tape, follow, base[row])


@njit(**OPTIONS)
def run_one(parameters, orbit, attitude, points, stops, force_line, gravity, horizon, tolerance, spring_number):
    """One run with the states at the times asked for and at the steps."""
    c, springs, active, pending, work, tape, follow, stop_x = work_space(spring_number, points, stops.shape[0])
    release_time = np.zeros(spring_number)
    system = System(parameters, c, springs, active, points, force_line, gravity)
    code, number, last = run(
        orbit, attitude, stops, horizon, tolerance, system, pending, work, tape, follow, release_time, stop_x
    )
    return code, tape.x[: number + 1], tape.t[: number + 1], last, release_time, stop_x[: stops.shape[0]]


@dataclass(frozen=True)
class Outcome:
    """What n runs gave.

    Attributes
    ----------
    separation : Separation
    parameters : ndarray, shape (n, P)
        One row a run; see `Separation.parameter_names`.
    base : ndarray, shape (n, B)
        What the quantities are made of; see `satsep_ot.dynamics.quantities`. NaN in a row whose status is not OK.
    release_times : ndarray, shape (n, N)
        When each spring was released [s].
    status : ndarray of int, shape (n,)
        A `Status` for each run.
    steps : ndarray of int, shape (n,)
        Integration steps taken.
    """

    separation: Separation
    parameters: np.ndarray
    base: np.ndarray
    release_times: np.ndarray
    status: np.ndarray
    steps: np.ndarray

    def quantity(self, name):
        """The quantity of that name for every run, shape (n,), in its own unit."""
        return quantity_table(self.separation)[name].value(self.base)

    def explain(self, row):
        """One sentence on how run `row` ended; for invalid parameters it names the first and its value."""
        if self.status[row] == Status.INVALID_PARAMETERS:
            return invalid_parameter(self.separation, self.parameters[row]) or Status.INVALID_PARAMETERS.sentence
        return Status(self.status[row]).sentence


def gravity_level(separation):
    """The level of gravity that the kernels take."""
    if separation.orbit is None:
        return NO_GRAVITY
    return GRAVITY_WITH_TORQUE if separation.gradient_torque else GRAVITY


def parameter_rows(separation, parameters):
    """The parameter vectors as a contiguous (n, P) array; the nominal one if none is given."""
    nominal = separation.parameters()
    rows = np.ascontiguousarray(np.atleast_2d(nominal if parameters is None else np.asarray(parameters, dtype=float)))
    if rows.ndim != 2 or rows.shape[1] != nominal.size:
        raise ValueError(f"parameters has shape {rows.shape}; (n, {nominal.size}) is allowed")
    return rows


def check_tolerance(tolerance):
    """Refuse a tolerance that double precision cannot give or that means nothing."""
    if not 1e-13 <= tolerance <= 1e-2:
        raise ValueError(f"tolerance = {tolerance}; 1e-13 to 1e-2 is allowed")
    return float(tolerance)


def simulate(separation, parameters=None, tolerance=1e-8):
    """Simulate n separations.

    Parameters
    ----------
    separation : Separation
        What does not vary, and the nominal parameters.
    parameters : array_like, shape (n, P), optional
        One parameter vector a run; by default one run with the nominal ones.
    tolerance : float
        Relative accuracy of the outcome.

    Returns
    -------
    outcome : Outcome
        A run that fails has a status that says how; the others are not affected.

    Raises
    ------
    ValueError
        If the shape or the tolerance is not allowed.
    """
    rows = parameter_rows(separation, parameters)
    points = np.ascontiguousarray(separation.recess_points())
    n, spring_number = len(rows), len(separation.springs)
    base = np.empty((n, STATE_SIZE + 2 + len(points)))
    release_times, status, steps = np.empty((n, spring_number)), np.empty(n, np.int64), np.empty(n, np.int64)
    run_all(
        rows, separation.platform_orbit(), separation.attitude, points, int(separation.force_line),
        gravity_level(separation), float(separation.horizon), check_tolerance(tolerance), base, release_times, status, steps,
    )  # fmt: skip
    return Outcome(separation, rows, base, release_times, status, steps)


@dataclass(frozen=True)
class Trajectory:
    """One run over time: at the times asked for, in the order of `times`.

    Attributes
    ----------
    status : Status
    times : ndarray, shape (T,) [s]
    states : ndarray, shape (T, 20)
        See `satsep_ot.dynamics.rigid_body`.
    release_times : ndarray, shape (N,) [s]
    last_release : ndarray, shape (20,)
        The state at the last release.
    """

    status: Status
    times: np.ndarray
    states: np.ndarray
    release_times: np.ndarray
    last_release: np.ndarray


def trajectory(separation, times, parameters=None, tolerance=1e-8):
    """One run, landed on exactly at each of the times.

    Parameters
    ----------
    separation : Separation
    times : array_like, shape (T,)
        Ascending, not negative [s].
    parameters : array_like, shape (P,), optional
    tolerance : float

    Returns
    -------
    trajectory : Trajectory

    Raises
    ------
    ValueError
        If the times are not ascending, or another argument is not allowed.
    """
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or not np.isfinite(times).all() or (np.diff(times) < 0.0).any() or (times < 0.0).any():
        raise ValueError("times: finite, ascending times that are not negative are allowed")
    rows = parameter_rows(separation, parameters)
    code, states, _, last, release_times, at_times = run_one(
        rows[0], separation.platform_orbit(), separation.attitude, np.ascontiguousarray(separation.recess_points()), times,
        int(separation.force_line), gravity_level(separation), float(separation.horizon), check_tolerance(tolerance),
        len(separation.springs),
    )  # fmt: skip
    return Trajectory(Status(code), times, at_times, release_times, states[last].copy())


def inertial_motion(states):
    """Inertial velocity difference and distance of the CGs, from states (..., 20).

    Returns
    -------
    velocity, position : ndarray, shape (..., 3)
        v_2 - v_1 [m/s] and u_2 - u_1 [m] in inertial axes.
    """
    turns = np.array([rotation_matrix(q) for q in states.reshape(-1, STATE_SIZE)[:, 16:20]]).reshape(
        *states.shape[:-1], 3, 3
    )
    return (turns @ states[..., 3:6, None])[..., 0], (turns @ states[..., 0:3, None])[..., 0]
