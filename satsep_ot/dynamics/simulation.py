"""Simulate many separations at once: `simulate` for their outcomes, `trajectory` for one over time."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from satsep_ot.dynamics.compilation import KERNEL, SOURCE_DIGEST, entry_point, prepare
from satsep_ot.dynamics.flight import MAXIMUM_STEPS, Follow, Tape, run
from satsep_ot.dynamics.integration import forget_slopes
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.relative_orbit import closest_approaches, stack_orbit
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.sensitivities import LANES, adjoint_sweep, sweep_size
from satsep_ot.dynamics.separation import LARGEST, PLATFORM, SATELLITE, Separation, Status, invalid_parameter
from satsep_ot.dynamics.springs import ForceLaw, table_segments
from satsep_ot.dynamics.system import (
    GRAVITY,
    GRAVITY_WITH_TORQUE,
    LAW,
    MARK_COLUMNS,
    NO_GRAVITY,
    SPRING_COLUMNS,
    SPRING_MARKS,
    SPRINGS,
    STATE_SIZE,
    WORK_SIZE,
)

SWEEP_CHUNK = 64  # runs whose tapes are kept for their sweeps; the result of a run does not depend on it
# Columns of the base that the coast after the release starts from: d, w, q1 and the time.
COAST_COLUMNS = [*range(6), *range(16, STATE_SIZE + 1)]
RUN_CHUNK = 1024  # runs between two looks at the keyboard, some 20 ms


class Store(NamedTuple):
    """Room for some runs, one in each slot, and for the step that is being made."""

    c: np.ndarray  # what runs depend on, see satsep_ot.dynamics.system
    marks: np.ndarray
    x: np.ndarray  # tapes: states, times, step lengths, and method, event and spring of each step
    t: np.ndarray
    h: np.ndarray
    kinds: np.ndarray
    exits: np.ndarray  # step, base and method of each point's exit, then see flight.Follow
    exit_h: np.ndarray
    exit_x: np.ndarray
    exit_clearance: np.ndarray
    closest_x: np.ndarray
    closest: np.ndarray
    work: np.ndarray
    start: np.ndarray
    room: np.ndarray
    room_x: np.ndarray


def _store(separation, slots):
    """A store whose c and marks hold what all runs share."""
    springs, points, planes = separation.springs, separation.recess_points(), separation.recess_planes
    spring_number, point_number = len(springs), len(points)
    tables = table_segments(springs.tables, spring_number)
    places = np.cumsum([SPRINGS + SPRING_COLUMNS * spring_number, tables.size, points.size, planes.size])
    c = np.zeros((slots, places[3]))
    for part, place in ((tables, places[0]), (points, places[1]), (planes, places[2])):
        c[:, place : place + part.size] = part.ravel()
    marks = np.zeros((slots, SPRING_MARKS + MARK_COLUMNS * spring_number), np.int64)
    marks[:, :SPRING_MARKS] = (
        spring_number, tables.shape[1], point_number, len(planes), separation.force_line, gravity_level(separation),
        *places[:3], np.count_nonzero(springs.laws == ForceLaw.TABLE), 0,
    )  # fmt: skip
    marks[:, SPRING_MARKS + LAW :: MARK_COLUMNS] = springs.laws
    return Store(
        c,
        marks,
        np.empty((slots, MAXIMUM_STEPS + 1, STATE_SIZE)),
        np.empty((slots, MAXIMUM_STEPS + 1)),
        np.empty((slots, MAXIMUM_STEPS)),
        np.empty((slots, 3, MAXIMUM_STEPS), np.int64),
        np.empty((slots, 3, point_number), np.int64),
        np.empty((slots, point_number)),
        np.empty((slots, point_number, STATE_SIZE)),
        np.empty((slots, point_number)),
        np.empty((slots, STATE_SIZE)),
        np.empty((slots, 5)),
        np.empty(WORK_SIZE),
        np.empty((point_number, 6)),
        np.empty(6),
        np.empty(STATE_SIZE),
    )


@njit(**KERNEL)
def slot_views(slot, store):
    """Tape and follow-up of the run in a slot."""
    return (
        Tape(
            store.x[slot], store.t[slot], store.h[slot], store.kinds[slot, 0], store.kinds[slot, 1],
            store.kinds[slot, 2],
        ),
        Follow(
            store.exits[slot, 0], store.exits[slot, 1], store.exit_h[slot], store.exits[slot, 2], store.exit_x[slot],
            store.exit_clearance[slot], store.closest_x[slot], store.closest[slot], store.start, store.room,
            store.room_x,
        ),
    )  # fmt: skip


def _entry_points(source_digest):
    """The compiled batch runs, kept on disk under keys that contain the digest of the sources."""

    @entry_point
    def run_rows(
        first, end, keep, parameters, orbit, attitude, horizon, tolerance, stops, store,
        base, release_time, status, steps, last, states,
    ):  # fmt: skip
        """Rows first to end - 1 of `parameters`, one after the other; with keep = 1 each in a slot of its own.

        Writes what the quantities are made of into `base`: state and time at the last release, smallest clearance,
        clearances at exit.
        """
        digest = source_digest  # noqa: F841 a closure variable enters the cache key only where it is used
        for row in range(first, end):
            slot = (row - first) * keep
            tape, follow = slot_views(slot, store)
            code, number, index = run(
                orbit, attitude, stops, horizon, tolerance, parameters[row], store.c[slot], store.marks[slot],
                store.work, tape, follow, release_time[row], states[row],
            )  # fmt: skip
            status[row] = code
            steps[row] = number
            last[row] = index
            for n in range(STATE_SIZE):
                base[row, n] = tape.x[index, n]
            base[row, STATE_SIZE] = tape.t[index]
            base[row, STATE_SIZE + 1] = follow.closest[0]
            for i in range(follow.clearance.shape[0]):
                base[row, STATE_SIZE + 2 + i] = follow.clearance[i]

    @entry_point
    def sweep_rows(first, end, parameters, store, status, last, columns, room, gradients):
        """Gradients (n, len(columns), P) of columns of the base, a multiple of LANES, of the runs in the slots."""
        digest = source_digest  # noqa: F841
        for row in range(first, end):
            if status[row] == 0:
                slot = row - first
                tape, follow = slot_views(slot, store)
                # What an earlier run left there may be infinite, and 0 times infinity is no number.
                forget_slopes(store.work)
                for block in range(0, columns.shape[0], LANES):
                    adjoint_sweep(
                        columns, block, last[row], parameters[row], store.work, store.c[slot], store.marks[slot], tape,
                        follow, room, gradients[row],
                    )  # fmt: skip

    return run_rows, sweep_rows


run_rows, sweep_rows = _entry_points(SOURCE_DIGEST)


def _in_threads(count, chunk, job):
    """Call job(first, end) for pieces of range(count), in as many threads as numba would use."""
    threads = min(numba.get_num_threads(), -(-count // chunk))
    pieces = [(first, min(count, first + chunk)) for first in range(0, count, chunk)]
    if threads <= 1:
        for piece in pieces:
            job(*piece)
        return
    with ThreadPoolExecutor(threads) as pool:
        try:
            for _ in pool.map(lambda piece: job(*piece), pieces):
                pass
        except BaseException:
            pool.shutdown(cancel_futures=True)
            raise


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

    def quantity(self, name: str) -> np.ndarray:
        """The quantity of that name for every run, shape (n,), in its own unit."""
        return self._table[name].value(self.base)

    def quantity_gradient(self, name: str) -> np.ndarray:
        """Its gradient with respect to the parameters, shape (n, P), by the chain rule through the base."""
        quantity = self._table[name]
        return np.einsum("nc,ncp->np", quantity.gradient(self.base), self.gradients[:, list(quantity.columns)])

    def explain(self, row: int) -> str:
        """One sentence on how run `row` ended; for invalid parameters it names the first and its value."""
        if self.status[row] == Status.INVALID_PARAMETERS:
            return invalid_parameter(self.separation, self.parameters[row]) or Status.INVALID_PARAMETERS.sentence
        return Status(self.status[row]).sentence


def gravity_level(separation: Separation) -> int:
    """The level of gravity that the kernels take."""
    if separation.orbit is None:
        return NO_GRAVITY
    return GRAVITY_WITH_TORQUE if separation.gradient_torque else GRAVITY


def parameter_rows(separation: Separation, parameters: ArrayLike | None) -> np.ndarray:
    """The parameter vectors as a contiguous (n, P) array; the nominal one if none is given."""
    nominal = separation.parameters()
    given = nominal if parameters is None else parameters
    # Kernels are compiled for arrays that can be written, as they all are but those that another process has sent.
    rows = np.require(np.atleast_2d(np.asarray(given, dtype=float)), requirements=["C", "A", "W"])
    if rows.ndim != 2 or rows.shape[1] != nominal.size:
        raise ValueError(f"parameters has shape {rows.shape}; (n, {nominal.size}) is allowed")
    return rows


def check_tolerance(tolerance: float) -> float:
    """Refuse a tolerance that double precision cannot give or that means nothing."""
    if not 1e-13 <= tolerance <= 1e-2:
        raise ValueError(f"tolerance = {tolerance}; 1e-13 to 1e-2 is allowed")
    return float(tolerance)


def simulate(separation: Separation, parameters: ArrayLike | None = None, tolerance: float = 1e-8) -> Outcome:
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
    return _simulate(separation, parameters, np.empty(0), tolerance)[0]


def simulate_with_gradients(
    separation: Separation,
    parameters: ArrayLike | None = None,
    quantities: list[str] | None = None,
    tolerance: float = 1e-8,
) -> Outcome:
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
    recontact = base_size(separation) - 1 if separation.recontact is not None else -1
    swept = sorted((set(wanted) | set(COAST_COLUMNS)) - {recontact}) if recontact in wanted else wanted
    columns = np.full(-(-len(swept) // LANES) * LANES, -1, np.int64)
    columns[: len(swept)] = swept
    outcome, _, gradients = _simulate(separation, parameters, np.empty(0), tolerance, columns)
    full = np.zeros((len(gradients), outcome.base.shape[1], gradients.shape[2]))
    full[:, swept] = gradients[:, : len(swept)]
    if recontact in wanted:
        by_coast = _coast(separation, outcome.parameters, outcome.base, gradient=True)[2]
        full[:, recontact] = np.einsum("nc,ncp->np", by_coast[:, COAST_COLUMNS], full[:, COAST_COLUMNS])
        full[:, recontact, [PLATFORM, SATELLITE]] += by_coast[:, -2:]
    return replace(outcome, gradients=full)


def base_size(separation: Separation) -> int:
    """How many columns the base of a separation has."""
    return STATE_SIZE + 2 + len(separation.recess_points()) + (separation.recontact is not None)


def _coast(separation, parameters, base, gradient=False):
    """Smallest distance in the window of re-contact, its time, and its gradient; see `relative_orbit`."""
    with np.errstate(over="ignore", invalid="ignore"):
        return closest_approaches(
            base[:, :STATE_SIZE], base[:, STATE_SIZE], parameters[:, [PLATFORM, SATELLITE]], stack_orbit(separation),
            separation.recontact, gradient,
        )  # fmt: skip


_NO_COLUMNS = np.empty(0, np.int64)


def _simulate(separation, parameters, stops, tolerance, columns=_NO_COLUMNS):
    """The outcome, the states at the times `stops` (n, S, 20), and the gradients of columns of the base (n, C, P)."""
    rows = parameter_rows(separation, parameters)
    n, spring_number = len(rows), len(separation.springs)
    common = (
        separation.platform_orbit(), separation.attitude, float(separation.horizon), check_tolerance(tolerance), stops
    )  # fmt: skip
    base, release_times = np.empty((n, base_size(separation))), np.empty((n, spring_number))
    status, steps, last = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int64)
    states = np.empty((n, len(stops), STATE_SIZE))
    gradients = np.full((n, len(columns), rows.shape[1]), np.nan)
    sweeping = len(columns) > 0

    def job(first, end):
        store = _store(separation, SWEEP_CHUNK if sweeping else 1)
        room = np.empty(sweep_size(spring_number, len(separation.recess_planes)))
        runs = first, end, int(sweeping), rows, *common, store, base, release_times, status, steps, last, states
        sweeps = first, end, rows, store, status, last, columns, room, gradients
        prepare({run_rows: runs, sweep_rows: sweeps})
        run_rows(*runs)
        if sweeping:
            sweep_rows(*sweeps)

    _in_threads(n, SWEEP_CHUNK if sweeping else RUN_CHUNK, job)
    points = len(separation.recess_points())
    # The smallest clearance of no points is infinite.
    results = base[:, : STATE_SIZE + 2 + points if points else STATE_SIZE + 1]
    flown = status == Status.OK
    status[flown & ~(np.abs(results) < LARGEST).all(axis=1)] = Status.STEP_UNDERFLOW
    if separation.recontact is not None:
        base[:, -1] = np.nan
        flown = status == Status.OK
        base[flown, -1] = _coast(separation, rows[flown], base[flown])[0]
        status[flown & ~np.isfinite(base[:, -1])] = Status.STEP_UNDERFLOW
    failed = status != Status.OK
    base[failed] = np.nan
    states[failed] = np.nan
    gradients[failed] = np.nan
    return Outcome(separation, rows, base, release_times, status, steps), states, gradients


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


def trajectory(
    separation: Separation, times: ArrayLike, parameters: ArrayLike | None = None, tolerance: float = 1e-8
) -> Trajectory:
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
        raise ValueError(f"times = {times.tolist()}; finite, ascending times that are not negative are allowed [s]")
    outcome, states, _ = _simulate(
        separation, None if parameters is None else np.atleast_2d(parameters)[:1], times, tolerance
    )
    return Trajectory(
        Status(outcome.status[0]), times, states[0], outcome.release_times[0], outcome.base[0, :STATE_SIZE].copy()
    )


def inertial_motion(states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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
