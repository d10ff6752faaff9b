"""What the kernels work on: records with named fields, and what they are put together to. SI units, radians.

Platform axes unless said. Matrices stand row by row. A record is passed as one pointer.
"""

import math
from typing import Any, NamedTuple

import numpy as np

STAGES = 12  # of a Runge-Kutta step, at most
LANES = 8  # outputs that are differentiated together: one vector register of the processor
MAXIMUM_STEPS = 1000  # of a run, beside those for the knots of tables and for times asked for after it
CACHE_LINE = 64  # bytes, as many as one row of lanes
LARGEST = 1e30  # far beyond any physical value, so that no product overflows

NUMBER, INTEGER = np.float64, np.int64
VECTOR, MATRIX = (NUMBER, 3), (NUMBER, 9)


class Record(np.void):
    """An element of an array of records: in Python too its fields are attributes, as in compiled code."""

    @property
    def flat(self):
        # Every number of numpy has an attribute of this name.
        return self["flat"]

    def __getattr__(self, name):
        if name not in self.dtype.names:
            raise AttributeError(name)
        return self[name]

    def __setattr__(self, name, value):
        self[name] = value


def record(*fields: tuple) -> np.dtype:
    """A record type of these fields: name, type and, for an array, its shape."""
    taken = [name for name, *_ in fields if hasattr(np.void, name)]
    if taken:
        raise ValueError(f"{taken} are attributes of every number of numpy; a field must have another name")
    return np.dtype((Record, np.dtype(list(fields), align=True)))


def named(*fields: tuple, lanes: tuple = ()) -> np.dtype:
    """A record type whose numbers (or rows of lanes) also stand in one field `x`, one after the other.

    With lanes they stand in a field `flat`, too, all in one row.
    """
    parts = record(*fields)
    size = parts.itemsize // np.dtype((NUMBER, lanes)).itemsize
    whole = {"x": (NUMBER, (size, *lanes))}
    if lanes:
        whole["flat"] = (NUMBER, size * math.prod(lanes))
    union = {
        "names": [*whole, *parts.names],
        "formats": [*whole.values(), *(parts[name] for name in parts.names)],
        "offsets": [*(0 for _ in whole), *(parts.fields[name][1] for name in parts.names)],
        "itemsize": parts.itemsize,
    }
    return np.dtype((Record, np.dtype(union, align=True)))


def aligned_records(number: int, dtype: np.dtype) -> np.ndarray:
    """An array (number,) of records of zeros that begins with a cache line.

    A row of lanes that lies across two lines takes twice as long to load.
    """
    memory = np.zeros(number * dtype.itemsize + CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % CACHE_LINE
    return memory[start : start + number * dtype.itemsize].view(dtype)


def _state(*lanes):
    three, four = (NUMBER, (3, *lanes)), (NUMBER, (4, *lanes))
    return named(
        ("d", *three),  # position of the satellite's CG from the platform's CG
        ("w", *three),  # inertial relative velocity of the CGs
        ("omega_1", *three),  # platform body rates
        ("omega_2", *three),  # satellite body rates, satellite axes
        ("Q", *four),  # quaternion from satellite to platform axes
        ("q_1", *four),  # quaternion from platform to inertial axes
        lanes=lanes,
    )


STATE = _state()
STATE_SIZE = STATE["x"].shape[0]

BODY = record(("inertia", *MATRIX), ("inverse_inertia", *MATRIX), ("center_of_mass", *VECTOR))

# The orbit of the platform's CG is expanded about an anchor.
ANCHOR = record(
    ("mu", NUMBER),
    ("time", NUMBER),
    ("position", *VECTOR),  # ECI, from the centre of the Earth
    ("velocity", *VECTOR),
    ("acceleration", *VECTOR),
    ("inverse_square", NUMBER),  # 1 / r^2
    ("inverse_radius", NUMBER),
    ("rate", NUMBER),  # mu / r^3
    ("rate_slope", NUMBER),  # d/dt of it
)

SPRING = record(
    ("platform_seat", *VECTOR),  # from the platform's CG
    ("satellite_seat", *VECTOR),  # from the satellite's CG, satellite axes
    ("guide", *VECTOR),  # direction
    ("stiffness", NUMBER),
    ("deformation", NUMBER),
    ("release_stroke", NUMBER),
    ("delay", NUMBER),
    ("scale", NUMBER),
    ("law", INTEGER),  # its number in ForceLaw, and the properties of that law
    ("is_linear", INTEGER),
    ("has_stiffness", INTEGER),
    ("holds_back", INTEGER),
    ("has_table", INTEGER),
    ("in_sums", INTEGER),  # whether its force is part of the sums of the guided springs
    ("first_cubic", INTEGER),  # of its force-stroke table
    ("cubic_number", INTEGER),
    ("cubic", INTEGER),  # the one that holds in this step; -1 for the one at the stroke
    ("is_pending", INTEGER),  # still to push
    ("is_pushing", INTEGER),
)

# A piece of a force-stroke table: a cubic in the stroke from its start on, ascending coefficients.
CUBIC = record(("start", NUMBER), ("coefficients", NUMBER, 4))

# The forces of guided springs are the product of a matrix with (1, d, rotation matrix of Q): see `springs`.
SUM_ROWS, SUM_COLUMNS = 12, 13

# The smallest clearance of all points, and where it was met.
CLOSEST = record(
    ("clearance", NUMBER),
    ("point", INTEGER),
    ("kind", INTEGER),
    ("step", INTEGER),
    ("length", NUMBER),  # of the step to it [s]
    ("state", STATE),
)

# A part of the satellite's foot over the deck: see `deck`.
FOOT = record(
    ("height", NUMBER),  # where the current step ends [m]
    ("rate", NUMBER),  # of it [m/s]
    ("start", NUMBER),  # height at t = 0, at most 0, from which the others count
)

# How near the satellite comes to the deck.
DECK = record(
    ("edge", FOOT),  # of the ring
    ("reach", NUMBER),  # how far the foot reaches from the ring's centre [m]
    ("rise", NUMBER),  # rate at which all of it rises at least where the current step starts [m/s]
    # The lowest height so far: of what, and the step to it.
    ("height", NUMBER),
    ("what", INTEGER),
    ("step", INTEGER),
    ("length", NUMBER),
    ("method", INTEGER),
)

# What the motion depends on beside time and state.
SYSTEM = record(
    ("platform", BODY),
    ("satellite", BODY),
    ("inverse_reduced_mass", NUMBER),
    ("stowed_length", NUMBER),
    ("guide_friction", NUMBER),
    ("recess_radius", NUMBER),
    ("recess_depth", NUMBER),
    ("ring_radius", NUMBER),  # largest radius of a spring
    ("ring_spring", INTEGER),  # that has it
    ("force_line", INTEGER),
    ("has_stowed_length", INTEGER),  # whether the springs of this force line have one
    ("gravity", INTEGER),
    ("anchor", ANCHOR),
    ("sums", NUMBER, (SUM_COLUMNS, SUM_ROWS)),
    ("forces", NUMBER, SUM_ROWS),  # of the guided springs, where they were asked for last: what follows from the sums
    ("number_in_sums", INTEGER),  # of the springs that push now
    ("number_beside", INTEGER),  # and of those whose force is computed by itself
    ("closest", CLOSEST),
    ("deck", DECK),
)

MOTION = record(("position", *VECTOR), ("velocity", *VECTOR))

# A point of the envelope.
POINT = record(
    ("place", *VECTOR),  # from the satellite's ring centre, satellite axes
    ("exit_step", INTEGER),  # in which it left the recess, -1 before
    ("exit_base", INTEGER),  # index of the tape state from which the exit is reached by one step
    ("exit_length", NUMBER),  # of that step [s]
    ("exit_method", INTEGER),
    ("exit_clearance", NUMBER),
    ("exit_state", STATE),
    ("start", MOTION),  # where the current step starts
    ("foot", FOOT),
)

# A plane wall: free is where normal . r >= offset, with r from the platform's ring centre.
PLANE = record(("normal", *VECTOR), ("offset", NUMBER))

# The tape: each state, its time, and the step that leads on from there.
TAPE = record(
    ("state", STATE),
    ("time", NUMBER),
    ("length", NUMBER),
    ("method", INTEGER),
    ("event", INTEGER),  # what ends the step
    ("spring", INTEGER),  # which spring does, or which element of contact
    ("mode_before", INTEGER),  # of the element
    ("mode", INTEGER),
    ("value", NUMBER),  # of its anchor or sign before
)

# A point of one body against a surface of the other, a bolt or the pins of a connector: see `contact`.
ELEMENT = record(
    ("kind", INTEGER),
    ("group", INTEGER),
    ("number", INTEGER),  # in its group; of pins that of their spring
    ("wall", INTEGER),  # plane of the recess
    ("mode", INTEGER),
    ("point", *VECTOR),  # from the CG of its body, in the axes of that body
    ("other", *VECTOR),  # of a bolt on the platform, from its CG
    ("normal", *VECTOR),  # of a plane, in the axes of its owner
    ("level", NUMBER),  # normal . r of the plane from the owner's CG, or the radius of a cylinder
    ("start", NUMBER),  # gap at t = 0, at most 0, from which the gap counts
    ("stiffness", NUMBER),
    ("damping", NUMBER),  # lambda [s/m]; of a bolt and of pins T [s]
    ("friction", NUMBER),
    ("sliding", NUMBER),  # v_eps [m/s]
    ("low", NUMBER),  # it lives where low < y < high, y of the point from the other body's ring centre
    ("high", NUMBER),
    ("release", NUMBER),  # of a bolt [s]
    ("anchor", NUMBER),  # of pins that stick [m]
    ("sign", NUMBER),  # of pins that slip, the direction
    ("final", NUMBER, 3),  # mode, anchor and sign at the end of the run
    # The conditions of its mode at the start of the step and at its end, which hold where they are positive, and their
    # rates (NaN where none is known).
    ("before", NUMBER, 3),
    ("rate_before", NUMBER, 3),
    ("after", NUMBER, 3),
    ("rate_after", NUMBER, 3),
)

# What a run with contact has beside.
CONTACT = record(
    ("loaded", INTEGER, 160),  # elements that act
    ("number_loaded", INTEGER),
    # Elements whose conditions may end in this step, the last step at whose start each was looked at, and the ways
    # (see `contact.way_of_points`) up to which its gap and its extent need no look.
    ("watched", INTEGER, 160),
    ("number_watched", INTEGER),
    ("seen", INTEGER, 160),
    ("clear_gap", NUMBER, 160),
    ("clear_extent", NUMBER, 160),
    ("stands_along", INTEGER, 160),  # whether the surface is parallel to the separation axis
    # Of every point at most [m], by now and at the end of the step: as it is, and across the separation axis.
    ("way", NUMBER),
    ("way_across", NUMBER),
    ("way_ahead", NUMBER),
    ("way_across_ahead", NUMBER),
    ("satellite_reach", NUMBER),  # largest distance of a point from the CG of its body [m]
    ("platform_reach", NUMBER),
    # Sum of the normal forces, and the largest one, where they were asked for last and at the stages of the step.
    ("normal", NUMBER),
    ("largest", NUMBER),
    ("stage_normal", NUMBER, STAGES),
    ("stage_largest", NUMBER, STAGES),
    ("largest_of", INTEGER),  # element that has it
    ("stage_largest_of", INTEGER, STAGES),
    ("frequency", NUMBER),  # of the stiffest contact [rad/s]
    ("free_frequency", NUMBER),  # of the motion without contact
    ("held", INTEGER),  # bolts and pins that still hold
    ("known", INTEGER),  # whether the conditions at the end of the last step are those of all modes now
    ("hint", NUMBER),  # when the next event is expected, from now [s]
    ("still_since", NUMBER),  # since when nothing slides [s]
    ("calm_since", NUMBER),  # since when nothing moves either
    ("pushed_until", NUMBER),  # when the last spring lets go [s]
    ("stuck", INTEGER),
    ("events", INTEGER),
    ("impulse", NUMBER),  # of all normal forces [N s]
    ("force", NUMBER),  # largest normal force [N]
    ("force_of", INTEGER),  # element that has it, and the step to it
    ("force_step", INTEGER),
    ("force_length", NUMBER),
    ("last_contact", NUMBER),  # end of the last contact [s]
    ("last_contact_index", INTEGER),  # of its state on the tape; -1 where nothing has touched
)

# An event of a run with contact.
EVENT = record(
    ("time", NUMBER),
    ("what", INTEGER),
    ("element", INTEGER),
    ("before", INTEGER),  # its mode
    ("mode", INTEGER),
    ("speed", NUMBER),
)
MAXIMUM_EVENTS = 500
MAXIMUM_CONTACT_STEPS = 60000

# Scratch of a step.
STEP = record(
    ("stage", STATE, STAGES),
    ("slope", STATE, STAGES),
    ("combined", STATE),  # slopes, as a state
    ("end", STATE),
    ("allowed", STATE),  # error
    ("other", STATE),  # a state beside the chain
    ("motion", MOTION),
    ("row", NUMBER, SUM_ROWS),
    ("column", NUMBER, SUM_COLUMNS),
)

# Where a run is, and how it goes on.
PROGRESS = record(
    ("horizon", NUMBER),
    ("tolerance", NUMBER),
    ("step_tolerance", NUMBER),
    ("frequency", NUMBER),  # [rad/s], not below any of the motion
    ("velocity", NUMBER),  # typical one of the separation
    ("length", NUMBER),  # typical one of the strokes
    ("short", NUMBER),  # up to this a fourth-order step is exact enough [s]
    ("next_step", NUMBER),  # what the error control suggests [s]
    ("longest_turn", NUMBER),  # step that turns the bodies by no more than is allowed [s]
    ("time", NUMBER),
    ("step", INTEGER),  # index of the tape's current state
    ("evaluations", INTEGER),  # of the right-hand side
    ("last", INTEGER),  # that at the last release
    ("to_release", INTEGER),
    ("inside", INTEGER),  # points that are still in the recess
    ("watching", INTEGER),  # whether the satellite may still come near the deck
    ("stop", INTEGER),  # next of the times asked for
    # The next boundary, which no step may cross, and what happens there.
    ("boundary", NUMBER),
    ("boundary_event", INTEGER),
    ("boundary_spring", INTEGER),
    # The next release as it is expected, from now.
    ("release_in", NUMBER),
    ("release_spring", INTEGER),
    ("release_share", NUMBER),  # stroke by now over that at the release
    # The next knot of a table.
    ("knot_in", NUMBER),
    ("knot_spring", INTEGER),
    ("knot", NUMBER),  # its stroke
    # The step that was taken.
    ("h", NUMBER),
    ("method", INTEGER),
    ("event", INTEGER),
    ("spring", INTEGER),
)


# What a run leaves behind beside its release times and the clearances of its points at their exits.
RESULT = named(
    ("state", STATE),  # at the last release
    ("time", NUMBER),  # of it [s]
    ("clearance", NUMBER),  # smallest one of all points
    ("deck_height", NUMBER),  # smallest one over the deck
)
RESULT_SIZE = RESULT["x"].shape[0]

# When and where the satellite came nearest to the deck.
NOTICE = record(
    ("time", NUMBER),  # [s]
    ("point", INTEGER),  # of the envelope, -1 for the edge of the ring
    ("angle", NUMBER),  # of the place on the ring's edge, as that of a spring
)


class Run(NamedTuple):
    """All that one run works on."""

    system: Any  # record SYSTEM
    springs: Any  # SPRING (N,)
    cubics: Any  # CUBIC (M,)
    points: Any  # POINT (E,)
    planes: Any  # PLANE (W,)
    tape: Any  # TAPE (largest number of steps + 1,)
    step: Any  # record STEP
    progress: Any  # record PROGRESS


class ContactRun(NamedTuple):
    """The same of a run with contact: compiled functions take another way by this type."""

    system: Any
    springs: Any
    cubics: Any
    points: Any
    planes: Any
    tape: Any  # TAPE (MAXIMUM_CONTACT_STEPS + 1,)
    step: Any
    progress: Any
    elements: Any  # ELEMENT (M,)
    contact: Any  # record CONTACT
    events: Any  # EVENT (MAXIMUM_EVENTS,)


class Parameters(NamedTuple):
    """The parameters of one run: the flat vector and its parts, see `satsep_ot.dynamics.separation.PARAMETERS`."""

    vector: Any  # (P,)
    limits: Any  # (P, 2), smallest and largest value allowed
    common: Any  # record
    springs: Any  # records (N,)
    offsets: Any  # of the planes (W,)


class ContactParameters(NamedTuple):
    """The same of a run with contact."""

    vector: Any
    limits: Any
    common: Any
    springs: Any
    offsets: Any
    contact: Any  # records (1 or 0,)
    rails: Any  # records (1 or 0,)
    hold_downs: Any  # records (H,)


class Gradients(NamedTuple):
    """The derivatives of LANES outputs with respect to them."""

    common: Any  # records (LANES,)
    springs: Any  # records (LANES, N)
    offsets: Any  # (LANES, W)


_LANE = (LANES,)
_VECTOR_LANES, _MATRIX_LANES = (NUMBER, (3, LANES)), (NUMBER, (9, LANES))
STATE_ADJOINT = _state(LANES)
BODY_ADJOINT = record(("inertia", *_MATRIX_LANES), ("center_of_mass", *_VECTOR_LANES))
SPRING_ADJOINT = named(
    ("platform_seat", *_VECTOR_LANES),
    ("satellite_seat", *_VECTOR_LANES),
    ("guide", *_VECTOR_LANES),
    *((name, NUMBER, _LANE) for name in ("stiffness", "deformation", "release_stroke", "delay", "scale")),
    lanes=_LANE,
)
# The adjoint of one column of the sums over the guided springs.
COLUMN_ADJOINT = named(("rows", NUMBER, (SUM_ROWS, LANES)), lanes=_LANE)
# The adjoints of the constants of a run.
CONSTANTS_ADJOINT = named(
    ("platform", BODY_ADJOINT),
    ("satellite", BODY_ADJOINT),
    ("inverse_reduced_mass", NUMBER, _LANE),
    ("stowed_length", NUMBER, _LANE),
    ("guide_friction", NUMBER, _LANE),
    ("recess_radius", NUMBER, _LANE),
    ("recess_depth", NUMBER, _LANE),
    ("ring_radius", NUMBER, _LANE),
    ("sums", COLUMN_ADJOINT, SUM_COLUMNS),
    lanes=_LANE,
)
# The adjoints of state, time and constants on the way back, and scratch. They are one record, since the compiler makes
# vector instructions of a loop over lanes only where it sees that nothing else can lie where the loop writes.
CHAIN_ADJOINT = record(
    ("state", STATE_ADJOINT),
    ("constants", CONSTANTS_ADJOINT),
    ("derivative", STATE_ADJOINT),  # what the adjoint of one slope says of the state
    ("spring", SPRING_ADJOINT),  # what it says of one spring
    ("time", NUMBER, _LANE),
    ("branch", STATE_ADJOINT),  # of a state beside the chain
    ("slope", STATE_ADJOINT),
    ("stage", STATE_ADJOINT, STAGES),
    ("force", *_VECTOR_LANES),  # of the sums over the springs, platform axes
    ("platform_moment", *_VECTOR_LANES),
    ("satellite_moment", *_VECTOR_LANES),
    ("platform_torque", *_VECTOR_LANES),  # of all moments, each in the axes of its body
    ("satellite_torque", *_VECTOR_LANES),
    ("rotation", *_MATRIX_LANES),  # of the matrix of Q
    ("platform_rotation", *_MATRIX_LANES),  # of that of q_1
    ("forces", COLUMN_ADJOINT),  # of the product of the sums with d and R
    # What one spring passes on: of its force, its contact point and its stroke; of the size of its force, of its
    # satellite seat and of the satellite's y axis in platform axes.
    ("spring_force", *_VECTOR_LANES),
    ("point", *_VECTOR_LANES),
    ("stroke", NUMBER, _LANE),
    ("spring_size", NUMBER, _LANE),
    ("seat", *_VECTOR_LANES),
    ("plate", *_VECTOR_LANES),
    ("direction", *_VECTOR_LANES),  # to the Earth
    # Of a spring in the sums: of the slope of its law, of an entry of its column, and of its row.
    ("by_f_1", NUMBER, _LANE),
    ("by_column", NUMBER, _LANE),
    ("row_entries", COLUMN_ADJOINT),
    # Of the impulse of all normal forces, and of the normal forces of a stage beside what they do to the motion.
    ("impulse", NUMBER, _LANE),
    ("normal", NUMBER, _LANE),
    # The numbers of that row and of that column.
    ("row", NUMBER, SUM_ROWS),
    ("column", NUMBER, SUM_COLUMNS),
)


class Buffers(NamedTuple):
    """The memory of some runs, each in a slot of its own, and of the step and the sweep that are being made."""

    systems: Any  # SYSTEM (S,)
    springs: Any  # SPRING (S, N)
    cubics: Any  # CUBIC (M,), of all runs
    points: Any  # POINT (S, E)
    planes: Any  # PLANE (S, W)
    tapes: Any  # TAPE (S, largest number of steps + 1)
    steps: Any  # STEP (1,)
    progress: Any  # PROGRESS (1,)
    limits: Any  # see Parameters
    parameters: Any
    spring_parameters: Any
    offsets: Any
    gradients: Any  # see Gradients
    spring_gradients: Any
    offset_gradients: Any
    chains: Any  # CHAIN_ADJOINT (1,)
    spring_adjoints: Any  # SPRING_ADJOINT (N,)
    offset_adjoints: Any  # (W, LANES)


ELEMENT_ADJOINT = named(
    ("point", *_VECTOR_LANES),
    ("other", *_VECTOR_LANES),
    *((name, NUMBER, _LANE) for name in (
        "level", "stiffness", "damping", "friction", "sliding", "low", "high", "release", "anchor", "force",
    )),
    lanes=_LANE,
)  # fmt: skip


class ContactGradients(NamedTuple):
    """The derivatives of LANES outputs with respect to the parameters of a run with contact."""

    common: Any
    springs: Any
    offsets: Any
    contact: Any  # records (LANES, 1 or 0)
    rails: Any
    hold_downs: Any  # (LANES, H)


class ContactBuffers(NamedTuple):
    """What runs with contact need beside `Buffers`."""

    elements: Any  # ELEMENT (S, M)
    contacts: Any  # CONTACT (S,)
    events: Any  # EVENT (S, MAXIMUM_EVENTS)
    contact: Any  # see ContactParameters
    rails: Any
    hold_downs: Any
    angles: Any  # of the points on the ring's edge (K,)
    feet: Any  # or points given (K', 3)
    element_adjoints: Any  # ELEMENT_ADJOINT (M,)
    contact_gradients: Any  # see ContactGradients
    rail_gradients: Any
    hold_gradients: Any


class ContactSweep(NamedTuple):
    """The adjoints of LANES outputs on their way back through one run with contact."""

    chain: Any
    springs: Any
    offsets: Any
    elements: Any  # ELEMENT_ADJOINT (M,)


class Sweep(NamedTuple):
    """The adjoints of LANES outputs on their way back through one run."""

    chain: Any  # record CHAIN_ADJOINT
    springs: Any  # SPRING_ADJOINT (N,)
    offsets: Any  # of the planes (W, LANES)


# A number of a run that is differentiated: see `adjoint`.
OUTPUT = record(("kind", INTEGER), ("index", INTEGER))

NO_GRAVITY, GRAVITY, GRAVITY_WITH_TORQUE = np.array([0, 1, 2])
