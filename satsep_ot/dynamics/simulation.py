"""Simulate many separations at once: `simulate` for their outcomes, `trajectory` for one over time."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import ArrayLike

from satsep_ot.dynamics.contact import CONTACT_PARAMETERS, HOLD_DOWN_PARAMETERS, RAIL_PARAMETERS
from satsep_ot.dynamics.kernels import records
from satsep_ot.dynamics.kernels.adjoint import (
    CLEARANCE_OUTPUT,
    DECK_OUTPUT,
    EXIT_OUTPUT,
    FORCE_OUTPUT,
    IMPULSE_OUTPUT,
    LAST_CONTACT_OUTPUT,
    NO_OUTPUT,
    STATE_OUTPUT,
    TIME_OUTPUT,
)
from satsep_ot.dynamics.kernels.batch import run_rows, sweep_rows
from satsep_ot.dynamics.kernels.compilation import prepare
from satsep_ot.dynamics.kernels.contact import GONE, LOADED, OPEN, OUT, SLACK, SLIPS, STICKS
from satsep_ot.dynamics.kernels.contact_batch import run_contact_rows, sweep_contact_rows
from satsep_ot.dynamics.kernels.records import (
    LANES,
    LARGEST,
    MAXIMUM_CONTACT_STEPS,
    MAXIMUM_STEPS,
    RESULT_SIZE,
    STATE,
    STATE_SIZE,
    Buffers,
    ContactBuffers,
)
from satsep_ot.dynamics.kernels.run import RELEASE
from satsep_ot.dynamics.quantities import STATE_FIELDS, base_fields, quantity_table
from satsep_ot.dynamics.relative_orbit import closest_approaches
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.separation import (
    PARAMETERS,
    PLATFORM,
    SATELLITE,
    SPRING_PARAMETERS,
    Separation,
    Status,
    invalid_parameter,
)
from satsep_ot.dynamics.springs import spring_records

CONTACT_SWEEP_CHUNK = 4  # the same of runs with contact, whose tapes are longer
CONTACT_CHUNK = 128
SWEEP_CHUNK = 64  # runs whose tapes are kept for their sweeps; the result of a run does not depend on it
# What the coast after the release starts from.
COAST_FIELDS = [*(field for field in STATE_FIELDS if field.startswith(("d_", "w_", "q_1_"))), "time"]
DECK_COLUMN = STATE_SIZE + 2  # of the base
KNOT_STEPS = 3  # for each row of a table: one to its knot, and what is left of the step that it cuts
KINK_STEPS = 300  # for each spring whose guide has friction, which is kinked at zero tilt: 250 of them at 1e-13
STEPS_PER_SECOND = 100  # for times asked for: a coast of 1000 s by the tolerance 1e-13 at 60 deg/s takes half of them
RUN_CHUNK = 1024  # runs between two looks at the keyboard, some 20 ms


def _most_steps(separation, stops):
    """How many steps a run may take: beside a fixed number some for each knot of a table and each second asked for."""
    if separation.has_contact():
        return MAXIMUM_CONTACT_STEPS
    knots = sum(len(starts) for starts, _ in separation.springs.force_pieces())
    kinks = KINK_STEPS * len(separation.springs) if separation.force_line.loads_guide else 0
    seconds = stops[-1] if len(stops) else 0.0
    return MAXIMUM_STEPS + KNOT_STEPS * knots + kinks + int(STEPS_PER_SECOND * seconds)


def _buffers(separation, slots, steps):
    """The memory of some runs, which holds what all runs of the separation share."""
    points, planes = separation.recess_points(), separation.recess_planes
    spring_number, point_number, plane_number = len(separation.springs), len(points), len(planes)
    springs, cubics = spring_records(separation.springs)
    buffers = Buffers(
        systems=np.zeros(slots, records.SYSTEM),
        springs=np.zeros((slots, spring_number), records.SPRING),
        cubics=cubics,
        points=np.zeros((slots, point_number), records.POINT),
        planes=np.zeros((slots, plane_number), records.PLANE),
        tapes=np.zeros((slots, steps + 1), records.TAPE),
        steps=np.zeros(1, records.STEP),
        progress=np.zeros(1, records.PROGRESS),
        limits=separation.parameter_limits,
        parameters=np.zeros(1, PARAMETERS),
        spring_parameters=np.zeros(spring_number, SPRING_PARAMETERS),
        offsets=np.empty(plane_number),
        gradients=np.zeros(LANES, PARAMETERS),
        spring_gradients=np.zeros((LANES, spring_number), SPRING_PARAMETERS),
        offset_gradients=np.empty((LANES, plane_number)),
        chains=records.aligned_records(1, records.CHAIN_ADJOINT),
        spring_adjoints=records.aligned_records(spring_number, records.SPRING_ADJOINT),
        offset_adjoints=np.empty((plane_number, LANES)),
    )
    buffers.systems["force_line"] = separation.force_line
    buffers.systems["has_stowed_length"] = separation.force_line.has_stowed_length
    buffers.systems["gravity"] = gravity_level(separation)
    buffers.springs[:] = springs
    buffers.springs["in_sums"] = springs["is_linear"] * separation.force_line.is_fixed
    buffers.points["place"] = points
    buffers.planes["normal"] = planes[:, :3]
    return buffers


def _contact_buffers(separation, slots):
    """What runs with contact need beside `_buffers`."""
    elements, _ = separation.contact_elements()
    contact = separation.contact
    counts = (int(contact is not None), int(separation.rails is not None), len(separation.hold_downs or ()))
    types = (CONTACT_PARAMETERS, RAIL_PARAMETERS, HOLD_DOWN_PARAMETERS)
    buffers = ContactBuffers(
        np.zeros((slots, len(elements)), records.ELEMENT),
        np.zeros(slots, records.CONTACT),
        np.zeros((slots, records.MAXIMUM_EVENTS), records.EVENT),
        *(np.zeros(count, kind) for count, kind in zip(counts, types, strict=True)),
        np.empty(0) if contact is None else contact.angles(),
        np.empty((0, 3)) if contact is None else contact.feet(),
        records.aligned_records(len(elements), records.ELEMENT_ADJOINT),
        *(np.zeros((LANES, count), kind) for count, kind in zip(counts, types, strict=True)),
    )
    buffers.elements[:] = elements
    return buffers


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
        What the quantities are made of; see `satsep_ot.dynamics.quantities.base_fields`. NaN in a row whose status is
        not OK.
    release_times : ndarray, shape (n, N)
        When each spring was released [s].
    status : ndarray of int, shape (n,)
        A `Status` for each run.
    steps : ndarray of int, shape (n,)
        Integration steps taken.
    evaluations : ndarray of int, shape (n,)
        Evaluations of the right-hand side.
    notices : ndarray of records, shape (n,)
        Of a run whose status is PENETRATION: when (`time` [s]) and where the satellite was lowest, at the envelope
        point of that number (`point`, of `Separation.recess_points`) or at the edge of its ring (-1) at an `angle`
        [rad].
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
    evaluations: np.ndarray
    notices: np.ndarray
    gradients: np.ndarray | None = None

    @cached_property
    def _table(self):
        return quantity_table(self.separation)

    @cached_property
    def _columns(self):
        return {field: column for column, field in enumerate(base_fields(self.separation))}

    def quantity(self, name: str) -> np.ndarray:
        """The quantity of that name for every run, shape (n,), in its own unit."""
        quantity = self._table[name]
        # Runs without a result may have parameters that are no numbers.
        with np.errstate(all="ignore"):
            return quantity.value(self._fields(quantity))

    def _fields(self, quantity):
        """What a quantity depends on, columns of the base and of the parameters, shape (n, m)."""
        if all(field in self._columns for field in quantity.fields):
            return self.base[:, [self._columns[field] for field in quantity.fields]]
        columns = [
            self.base[:, self._columns[field]] if field in self._columns else self.parameters[:, self._places[field]]
            for field in quantity.fields
        ]
        return np.column_stack(columns)

    @cached_property
    def _places(self):
        return {name: place for place, name in enumerate(self.separation.parameter_names())}

    def quantity_gradient(self, name: str) -> np.ndarray:
        """Its gradient with respect to the parameters, shape (n, P), by the chain rule through the base.

        Raises
        ------
        ValueError
            If the runs were made without gradients.
        """
        if self.gradients is None:
            raise ValueError("the runs have no gradients; simulate_with_gradients gives them")
        quantity = self._table[name]
        with np.errstate(all="ignore"):
            by_field = quantity.gradient(self._fields(quantity))
        ran = [place for place, field in enumerate(quantity.fields) if field in self._columns]
        columns = [self._columns[quantity.fields[place]] for place in ran]
        gradient = np.einsum("nc,ncp->np", by_field[:, ran], self.gradients[:, columns])
        for place, field in enumerate(quantity.fields):
            if field not in self._columns:
                gradient[:, self._places[field]] += by_field[:, place]
        return gradient

    def explain(self, row: int) -> str:
        """One sentence on how run `row` ended; for invalid parameters it names the first and its value."""
        if self.status[row] == Status.PENETRATION:
            return self._penetration(row)
        if self.status[row] == Status.INVALID_PARAMETERS:
            return invalid_parameter(self.separation, self.parameters[row]) or Status.INVALID_PARAMETERS.sentence
        if self.status[row] == Status.TOO_MANY_STEPS:
            released = np.count_nonzero(np.isfinite(self.release_times[row]))
            reached = f"{released} of {np.count_nonzero(self.separation.springs.scale)} springs were released by then"
            return f"{Status.TOO_MANY_STEPS.sentence} ({self.steps[row]:,} steps; {reached})"
        return Status(self.status[row]).sentence

    def _penetration(self, row):
        notice, depth = self.notices[row], -1e3 * self.base[row, DECK_COLUMN]
        what = f"the edge of its ring at {math.degrees(notice.angle) % 360.0:.0f} deg"
        if notice.point >= 0:
            place = ", ".join(f"{1e3 * number:g}" for number in self.separation.recess_points()[notice.point])
            what = f"its envelope point ({place}) mm"
        return f"{Status.PENETRATION.sentence}; {what} is {depth:.3g} mm below it at {1e3 * notice.time:.4g} ms"


def gravity_level(separation: Separation) -> int:
    """The level of gravity that the kernels take."""
    if separation.orbit is None:
        return records.NO_GRAVITY
    return records.GRAVITY_WITH_TORQUE if separation.gradient_torque else records.GRAVITY


def parameter_rows(separation: Separation, parameters: ArrayLike | None) -> np.ndarray:
    """The parameter vectors as a contiguous (n, P) array; the nominal one if none is given."""
    nominal = separation.parameters()
    given = nominal if parameters is None else parameters
    # Kernels are compiled for arrays that can be written, as they all are but those that another process has sent.
    rows = np.require(np.atleast_2d(np.asarray(given, dtype=float)), requirements=["C", "A", "W"])
    if rows.ndim != 2 or rows.shape[1] != nominal.size:
        raise ValueError(f"parameters has shape {rows.shape}; it must be (n, {nominal.size})")
    return rows


def check_tolerance(tolerance: float) -> float:
    """Refuse a tolerance that double precision cannot give or that means nothing."""
    if not 1e-13 <= tolerance <= 1e-2:
        raise ValueError(f"tolerance = {tolerance}; it must be between 1e-13 and 0.01")
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
        raise ValueError(f"quantities: {sorted(unknown)} is unknown; they must be among {sorted(table)}")
    fields = base_fields(separation)
    wanted = {field for name in quantities or table for field in table[name].fields}
    recontact = "recontact_distance" in wanted
    if recontact:
        wanted = wanted.union(COAST_FIELDS) - {"recontact_distance"}
    swept = [column for column, field in enumerate(fields) if field in wanted]
    outputs = np.zeros(-(-len(swept) // LANES) * LANES, records.OUTPUT)
    outputs["kind"] = NO_OUTPUT
    for output, column in zip(outputs, swept, strict=False):
        output["kind"], output["index"] = _output(column, len(separation.recess_points()))
    outcome, _, gradients = _simulate(separation, parameters, np.empty(0), tolerance, outputs)
    full = np.zeros((len(gradients), len(fields), gradients.shape[2]))
    full[:, swept] = gradients[:, : len(swept)]
    if recontact:
        by_coast = _coast(separation, outcome.parameters, outcome.base, gradient=True)[2]
        start = [fields.index(field) for field in COAST_FIELDS]
        full[:, -1] = np.einsum("nc,ncp->np", by_coast[:, start], full[:, start])
        full[:, -1, [PLATFORM, SATELLITE]] += by_coast[:, -2:]
    return replace(outcome, gradients=full)


def _output(column, point_number):
    """What the kernels call a column of the base, with `point_number` envelope points."""
    if column < STATE_SIZE:
        return STATE_OUTPUT, column
    if column < RESULT_SIZE:
        return (TIME_OUTPUT, CLEARANCE_OUTPUT, DECK_OUTPUT)[column - STATE_SIZE], 0
    if column < RESULT_SIZE + point_number:
        return EXIT_OUTPUT, column - RESULT_SIZE
    return (IMPULSE_OUTPUT, FORCE_OUTPUT, LAST_CONTACT_OUTPUT)[column - RESULT_SIZE - point_number], 0


def _coast(separation, parameters, base, gradient=False):
    """Smallest distance in the window of re-contact, its time, and its gradient; see `relative_orbit`."""
    with np.errstate(over="ignore", invalid="ignore"):
        return closest_approaches(
            base[:, :STATE_SIZE], base[:, STATE_SIZE], parameters[:, [PLATFORM, SATELLITE]], separation.stack_orbit(),
            separation.recontact, gradient,
        )  # fmt: skip


_NO_OUTPUTS = np.zeros(0, records.OUTPUT)


def _simulate(separation, parameters, stops, tolerance, outputs=_NO_OUTPUTS, listed=None):
    """The outcome, the states at the times `stops` (n, S, 20), and the gradients of outputs (n, C, P).

    The events of a single run with contact are appended to `listed`.
    """
    rows = parameter_rows(separation, parameters)
    n, point_number = len(rows), len(separation.recess_points())
    common = (
        separation.platform_orbit(), separation.attitude, float(separation.horizon), check_tolerance(tolerance), stops
    )  # fmt: skip
    results, exit_clearances = np.zeros(n, records.RESULT), np.empty((n, point_number))
    release_times = np.full((n, len(separation.springs)), np.nan)
    status, steps, evaluations, last = (np.empty(n, np.int64) for _ in range(4))
    states, notices = np.zeros((n, len(stops)), STATE), np.zeros(n, records.NOTICE)
    gradients = np.full((n, len(outputs), rows.shape[1]), np.nan)
    sweeping = len(outputs) > 0
    most_steps = _most_steps(separation, stops)

    spare: list[Buffers] = []  # the memory of threads between two pieces
    touching = separation.has_contact()
    contacts = np.zeros((n, 3))
    sweep_chunk = CONTACT_SWEEP_CHUNK if touching else SWEEP_CHUNK

    def contact_job(first, end):
        slots = sweep_chunk if sweeping else 1
        buffers, more = _buffers(separation, slots, most_steps), _contact_buffers(separation, slots)
        runs = (
            first, end, int(sweeping), rows, *common, buffers, more, results, exit_clearances, release_times, status,
            steps, evaluations, last, states, contacts,
        )  # fmt: skip
        sweeps = first, end, rows, buffers, more, status, steps, last, outputs, gradients
        prepare({run_contact_rows: runs, sweep_contact_rows: sweeps} if sweeping else {run_contact_rows: runs})
        with np.errstate(all="ignore"):
            run_contact_rows(*runs)
            if sweeping:
                sweep_contact_rows(*sweeps)
        if listed is not None:
            listed.extend(more.events[0][: min(more.contacts[0].events, records.MAXIMUM_EVENTS)].copy())

    def job(first, end):
        try:
            buffers = spare.pop()
        except IndexError:
            buffers = _buffers(separation, SWEEP_CHUNK if sweeping else 1, most_steps)
        runs = (
            first, end, int(sweeping), rows, *common, buffers, results, exit_clearances, release_times, status, steps,
            evaluations, last, states, notices,
        )  # fmt: skip
        sweeps = first, end, rows, buffers, status, last, outputs, gradients
        prepare({run_rows: runs, sweep_rows: sweeps})
        # As plain Python (NUMBA_DISABLE_JIT=1) they would warn of what the status says.
        with np.errstate(all="ignore"):
            run_rows(*runs)
            if sweeping:
                sweep_rows(*sweeps)
        spare.append(buffers)

    if touching:
        _in_threads(n, sweep_chunk if sweeping else CONTACT_CHUNK, contact_job)
    else:
        _in_threads(n, SWEEP_CHUNK if sweeping else RUN_CHUNK, job)
    base = np.full((n, len(base_fields(separation))), np.nan)
    base[:, :RESULT_SIZE] = results["x"]
    base[:, RESULT_SIZE : RESULT_SIZE + point_number] = exit_clearances
    if touching:
        base[:, RESULT_SIZE + point_number : RESULT_SIZE + point_number + 3] = contacts
    # The smallest clearance of no points is infinite.
    computed = base if point_number else np.delete(base, STATE_SIZE + 1, axis=1)
    computed = computed[:, : computed.shape[1] - (separation.recontact is not None)]
    flown = status == Status.OK
    status[flown & ~(np.abs(computed) < LARGEST).all(axis=1)] = Status.STEP_UNDERFLOW
    if separation.recontact is not None:
        flown = status == Status.OK
        base[flown, -1] = _coast(separation, rows[flown], base[flown])[0]
        status[flown & ~np.isfinite(base[:, -1])] = Status.STEP_UNDERFLOW
    failed = status != Status.OK
    # How deep it sank is the one thing that such a run tells.
    sunk = status == Status.PENETRATION
    heights = base[sunk, DECK_COLUMN]
    base[failed] = np.nan
    base[sunk, DECK_COLUMN] = heights
    states["x"][failed & ~sunk & (status != Status.STUCK)] = np.nan
    gradients[failed] = np.nan
    return Outcome(separation, rows, base, release_times, status, steps, evaluations, notices), states["x"], gradients


@dataclass(frozen=True)
class Trajectory:
    """One run over time: at the times asked for, in the order of `times`.

    Attributes
    ----------
    status : Status
    times : ndarray, shape (T,) [s]
    states : ndarray, shape (T, 20)
        See `satsep_ot.dynamics.kernels.records`. NaN where the run failed; where its status is PENETRATION, those of
        bodies that nothing keeps apart.
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
        raise ValueError(f"times = {times.tolist()}; they must be finite, not negative and ascending [s]")
    outcome, states, _ = _simulate(
        separation, None if parameters is None else np.atleast_2d(parameters)[:1], times, tolerance
    )
    return Trajectory(
        Status(outcome.status[0]), times, states[0], outcome.release_times[0], outcome.base[0, :STATE_SIZE].copy()
    )


class ContactEvent(NamedTuple):
    """An event of a run with contact.

    Attributes
    ----------
    time : float
        [s]
    name : str
        Of the spring, point, bolt or pins.
    what : str
        "is pressed" (at t = 0), "engages", "lets go", "closes" (a gap that was still negative), "leaves" or "enters"
        the extent of a surface, "releases", "slips", "sticks".
    speed : float
        Rate of the gap, or of the stroke of pins [m/s].
    """

    time: float
    name: str
    what: str
    speed: float


def contact_events(
    separation: Separation, parameters: ArrayLike | None = None, tolerance: float = 1e-8
) -> list[ContactEvent]:
    """The events of one run with contact, in their order; none for a separation without contact.

    Parameters
    ----------
    separation : Separation
    parameters : array_like, shape (P,), optional
    tolerance : float

    Returns
    -------
    events : list of ContactEvent
        At most 500.

    Raises
    ------
    ValueError
        If an argument is not allowed.
    """
    if not separation.has_contact():
        return []
    listed: list = []
    rows = None if parameters is None else np.atleast_2d(parameters)[:1]
    _simulate(separation, rows, np.empty(0), tolerance, listed=listed)
    names = separation.contact_elements()[1]
    return [_contact_event(event, names) for event in listed]


_MODE_WORDS = {OPEN: "lets go", SLACK: "lets go", OUT: "leaves", STICKS: "sticks", SLIPS: "slips", GONE: "releases"}


def _contact_event(event, names):
    """An event as people read it."""
    if event.what == RELEASE:
        return ContactEvent(float(event.time), f"spring {event.element + 1}", "releases", 0.0)
    what = _MODE_WORDS.get(event.mode, "engages")
    if event.mode == LOADED and event.time == 0.0:
        what = "is pressed"
    elif event.mode == OPEN and event.before == SLACK:
        what = "closes"
    elif event.before == OUT:
        what = "enters"
    return ContactEvent(float(event.time), names[event.element], what, float(event.speed))


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
