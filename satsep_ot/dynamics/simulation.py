"""Simulate many separations at once: `simulate` for their outcomes, `trajectory` for one over time."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numba import njit, prange

from satsep_ot.dynamics.compilation import KERNEL, OPTIONS, SOURCE_DIGEST
from satsep_ot.dynamics.flight import MAXIMUM_STEPS, Follow, Tape, run
from satsep_ot.dynamics.integration import STAGES, Work
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.sensitivities import G_SPRING_SIZE, G_SPRINGS, LANES, Adjoint, adjoint_sweep
from satsep_ot.dynamics.separation import Separation, Status, invalid_parameter
from satsep_ot.dynamics.system import (
    CONSTANT_SIZE,
    GRAVITY,
    GRAVITY_WITH_TORQUE,
    NO_GRAVITY,
    SPRING_COLUMNS,
    STATE_SIZE,
    System,
)

CHUNK = 64  # runs that share their working arrays; the result of a run does not depend on it


@njit(**KERNEL)
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
            np.zeros(point_number, np.int64),
            np.zeros((point_number, STATE_SIZE)),
            np.zeros(point_number),
            np.zeros(STATE_SIZE),
            np.zeros(5),
        ),
        np.zeros((stop_number + 1, STATE_SIZE)),
    )


@njit(**KERNEL)
def collect(status, last, tape, follow, base):
    """Write what the quantities are made of:

    state and time at the last release, smallest clearance, clearances at exit.
    """
    if status != 0:
        base[:] = np.nan
        return
    for n in range(STATE_SIZE):
        base[n] = tape.x[last, n]
    base[STATE_SIZE] = tape.t[last]
    base[STATE_SIZE + 1] = follow.closest[0]
    for i in range(follow.clearance.shape[0]):
        base[STATE_SIZE + 2 + i] = follow.clearance[i]


@njit(**KERNEL)
def run_chunk(
    first, end, parameters, orbit, attitude, points, force_line, gravity, horizon, tolerance, stops,
    base, release_time, status, steps, states,
):  # fmt: skip
    """Rows first to end - 1 of `parameters`, one after the other."""
    c, springs, active, pending, work, tape, follow, stop_x = work_space(release_time.shape[1], points, stops.shape[0])
    for row in range(first, end):
        system = System(parameters[row], c, springs, active, points, force_line, gravity)
        code, number, last = run(
            orbit, attitude, stops, horizon, tolerance, system, pending, work, tape, follow, release_time[row], stop_x
        )
        status[row], steps[row] = code, number
        collect(code, last, tape, follow, base[row])
        for i in range(stops.shape[0]):
            for n in range(STATE_SIZE):
                states[row, i, n] = stop_x[i, n] if code == 0 else np.nan


@njit(**KERNEL)
def run_chunk_with_gradients(
    first, end, parameters, orbit, attitude, points, force_line, gravity, horizon, tolerance, columns,
    base, release_time, status, steps, gradients,
):  # fmt: skip
    """As `run_chunk`, with the gradients (n, len(columns), P) of columns of the base, a multiple of LANES."""
    spring_number, stops = release_time.shape[1], np.empty(0)
    c, springs, active, pending, work, tape, follow, stop_x = work_space(spring_number, points, 0)
    adjoint = Adjoint(
        np.zeros((STATE_SIZE, LANES)),
        np.zeros((STATE_SIZE, LANES)),
        np.zeros((1, LANES)),
        np.zeros((STATE_SIZE, LANES)),
        np.zeros((STAGES, STATE_SIZE, LANES)),
        np.zeros((18, LANES)),
        np.zeros((18, LANES)),
        np.zeros((G_SPRINGS + G_SPRING_SIZE * spring_number + 8, LANES)),
    )
    for row in range(first, end):
        system = System(parameters[row], c, springs, active, points, force_line, gravity)
        code, number, last = run(
            orbit, attitude, stops, horizon, tolerance, system, pending, work, tape, follow, release_time[row], stop_x
        )
        status[row], steps[row] = code, number
        collect(code, last, tape, follow, base[row])
        for block in range(0, columns.shape[0], LANES):
            if code == 0:
                adjoint_sweep(columns, block, last, system, work, tape, follow, adjoint, gradients[row])
            else:
                gradients[row, block : block + LANES] = np.nan


def _entry_points(source_digest):
    """The compiled batch runs, kept on disk under keys that contain the digest of the sources."""

    @njit(parallel=True, cache=True, **OPTIONS)
    def run_all(
        parameters, orbit, attitude, points, force_line, gravity, horizon, tolerance, stops,
        base, release_time, status, steps, states,
    ):  # fmt: skip
        """Every row of `parameters`, in parallel over chunks of rows."""
        digest = source_digest  # noqa: F841 a closure variable enters the cache key only where it is used
        count = parameters.shape[0]
        for chunk in prange((count + CHUNK - 1) // CHUNK):
            run_chunk(
                chunk * CHUNK, min(count, (chunk + 1) * CHUNK),
                parameters, orbit, attitude, points, force_line, gravity, horizon, tolerance, stops,
                base, release_time, status, steps, states,
            )  # fmt: skip

    @njit(parallel=True, cache=True, **OPTIONS)
    def run_all_with_gradients(
        parameters, orbit, attitude, points, force_line, gravity, horizon, tolerance, columns,
        base, release_time, status, steps, gradients,
    ):  # fmt: skip
        """Every row of `parameters` with gradients, in parallel over chunks of rows."""
        digest = source_digest  # noqa: F841
        count = parameters.shape[0]
        for chunk in prange((count + CHUNK - 1) // CHUNK):
            run_chunk_with_gradients(
                chunk * CHUNK, min(count, (chunk + 1) * CHUNK),
                parameters, orbit, attitude, points, force_line, gravity, horizon, tolerance, columns,
                base, release_time, status, steps, gradients,
            )  # fmt: skip

    return run_all, run_all_with_gradients


run_all, run_all_with_gradients = _entry_points(SOURCE_DIGEST)


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
    gradients : ndarray, shape (n, B, P), or None
        Exact derivatives of the base with respect to the parameters, where they were asked for; 0 in columns that were
        not.

    Examples
    --------
    >>> from satsep_ot.dynamics.simulation import simulate
    >>> from satsep_ot.dynamics.separation import Body, Separation, Springs
    >>> springs = Springs([0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03)
    >>> outcome = simulate(Separation(Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35]), springs))
    >>> print(outcome.explain(0), outcome.release_times.shape)
    the separation completed (1, 4)
    """

    separation: Separation
    parameters: np.ndarray
    base: np.ndarray
    release_times: np.ndarray
    status: np.ndarray
    steps: np.ndarray
    gradients: np.ndarray | None = None

    @cached_property
    def _table(self):
        return quantity_table(self.separation)

    def quantity(self, name):
        """The quantity of that name for every run, shape (n,), in its own unit."""
        return self._table[name].value(self.base)

    def quantity_gradient(self, name):
        """Its gradient with respect to the parameters, shape (n, P), by the chain rule through the base."""
        quantity = self._table[name]
        return np.einsum("nc,ncp->np", quantity.gradient(self.base), self.gradients[:, list(quantity.columns)])

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
    outcome, _ = _simulate(separation, parameters, np.empty(0), tolerance)
    return outcome


def simulate_with_gradients(separation, parameters=None, quantities=None, tolerance=1e-8):
    """Simulate n separations with the exact derivatives of quantities with respect to all parameters.

    They go through every located event (a release moves with the inputs, an exit too), by the reverse mode. A quantity
    has no derivative where the smallest clearance jumps to another point or time, or where a norm is 0; simultaneous
    releases do no harm.

    Parameters
    ----------
    separation, parameters, tolerance : as in `simulate`
    quantities : list of str, optional
        The quantities whose gradients are wanted, by default all.

    Returns
    -------
    outcome : Outcome
        With `gradients`, and `quantity_gradient` for those quantities.

    Raises
    ------
    ValueError
        If an argument is not allowed.
    """
    table = quantity_table(separation)
    unknown = set(quantities or ()) - set(table)
    if unknown:
        raise ValueError(f"quantities: {sorted(unknown)} is unknown; {sorted(table)} are allowed")
    wanted = sorted({column for name in quantities or table for column in table[name].columns})
    outcome, arguments = _prepare_outcome(separation, parameters)
    columns = np.full(-(-len(wanted) // LANES) * LANES, -1, np.int64)
    columns[: len(wanted)] = wanted
    rows = outcome.parameters
    gradients = np.empty((len(rows), len(columns), rows.shape[1]))
    run_all_with_gradients(
        *arguments, check_tolerance(tolerance), columns,
        outcome.base, outcome.release_times, outcome.status, outcome.steps, gradients,
    )  # fmt: skip
    full = np.zeros((len(rows), outcome.base.shape[1], rows.shape[1]))
    full[:, wanted] = gradients[:, : len(wanted)]
    return replace(outcome, gradients=full)


def _prepare_outcome(separation, parameters):
    """Room for the outcome of n runs, and the arguments of the kernels up to the horizon."""
    rows = parameter_rows(separation, parameters)
    points = np.ascontiguousarray(separation.recess_points())
    n = len(rows)
    outcome = Outcome(
        separation, rows, np.empty((n, STATE_SIZE + 2 + len(points))), np.empty((n, len(separation.springs))),
        np.empty(n, np.int64), np.empty(n, np.int64),
    )  # fmt: skip
    arguments = (
        rows, separation.platform_orbit(), separation.attitude, points, int(separation.force_line),
        gravity_level(separation), float(separation.horizon),
    )  # fmt: skip
    return outcome, arguments


def _simulate(separation, parameters, stops, tolerance):
    """The outcome, and the states at the times `stops` (n, S, 20)."""
    outcome, arguments = _prepare_outcome(separation, parameters)
    states = np.empty((len(outcome.parameters), len(stops), STATE_SIZE))
    run_all(
        *arguments, check_tolerance(tolerance), stops,
        outcome.base, outcome.release_times, outcome.status, outcome.steps, states,
    )  # fmt: skip
    return outcome, states


@dataclass(frozen=True)
class Trajectory:
    """One run over time: at the times asked for, in the order of `times`.

    Attributes
    ----------
    status : Status
    times : ndarray, shape (T,) [s]
    states : ndarray, shape (T, 20)
        See `satsep_ot.dynamics.system`.
    release_times : ndarray, shape (N,) [s]
    last_release : ndarray, shape (20,)
        The state at the last release.

    Examples
    --------
    >>> from satsep_ot.dynamics.separation import Body, Separation, Springs
    >>> from satsep_ot.dynamics.simulation import trajectory
    >>> springs = Springs([0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03)
    >>> separation = Separation(Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35]), springs)
    >>> print(trajectory(separation, [0.0, 0.05, 0.1]).states.shape)
    (3, 20)
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
    outcome, states = _simulate(
        separation, None if parameters is None else np.atleast_2d(parameters)[:1], times, tolerance
    )
    return Trajectory(
        Status(outcome.status[0]), times, states[0], outcome.release_times[0], outcome.base[0, :STATE_SIZE].copy()
    )


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
