"""One run, compiled: from a parameter vector to its events, its tape and its end.

The run is a chain of Runge-Kutta steps. No step crosses an event: the start of a push (its delay), a release (stroke
reached), a time asked for. A release is predicted from the stroke's rate and acceleration, the step is taken to it and
corrected by a short step, so that its cost is a fraction of a step. The accepted steps are kept on a tape, from which
`satsep_ot.dynamics.sensitivities` computes exact derivatives.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from satsep_ot.dynamics.compilation import INLINE, KERNEL, known, larger, smaller
from satsep_ot.dynamics.gravity import ANCHOR_LIFE, move_anchor, place_anchor
from satsep_ot.dynamics.integration import (
    EIGHTH_ORDER,
    FIRST,
    FOURTH_ORDER,
    SECOND,
    STAGE_NUMBER,
    error_ratio,
    finish,
    forget_slopes,
    full_step,
    load,
    stages,
)
from satsep_ot.dynamics.rigid_body import seat_motion, times
from satsep_ot.dynamics.rotations import quaternion_from_rotation_vector, rotation_matrix_elements
from satsep_ot.dynamics.separation import (
    ANGULAR_IMPULSE,
    COMMON_SIZE,
    FRICTION_COEFFICIENT,
    IMPULSE,
    LARGEST,
    MOUNTING_ERROR,
    PLATFORM,
    RATES,
    RECESS_DEPTH,
    RECESS_RADIUS,
    SATELLITE,
    SPRING_SIZE,
    STOWED,
    Status,
)
from satsep_ot.dynamics.springs import FRICTION, LINEAR, STRUT, TABLE, add_to_sums, law, next_knot
from satsep_ot.dynamics.system import (
    ACTIVE,
    ALLOWED,
    ANCHOR,
    ANCHOR_TIME,
    DEFORMATION,
    DELAY,
    DEPTH,
    FORCE_LINE,
    GRAVITY_LEVEL,
    GUIDE_FRICTION,
    INVERSE_REDUCED_MASS,
    LAW,
    MARK_COLUMNS,
    MU,
    NEW,
    NO_GRAVITY,
    PENDING,
    PLANE_COLUMNS,
    PLANE_NUMBER,
    PLANES,
    PLATFORM_CG,
    PLATFORM_INERTIA,
    PLATFORM_INVERSE_INERTIA,
    POINT_COLUMNS,
    POINT_NUMBER,
    POINTS,
    PUSHING,
    RADIUS,
    RELEASE_STROKE,
    SATELLITE_CG,
    SATELLITE_INERTIA,
    SATELLITE_INVERSE_INERTIA,
    SCALE,
    SPRING_COLUMNS,
    SPRING_MARKS,
    SPRING_NUMBER,
    SPRINGS,
    START,
    STATE_SIZE,
    STIFFNESS,
    STOWED_LENGTH,
    SUM_COLUMNS,
    SUM_ROWS,
    SUMS,
    K,
    integers,
)

MAXIMUM_STEPS = 1000
# What a step may err, as a share of what the run may: rates that the push nearly cancels, struts that turn fast.
STEP_MARGIN = 0.1
PENETRATION_LIMIT = 1e-3  # m
# Of both bodies together in a step on the way out of the recess [rad]: 3 of 20,000 tumblers in a test still missed a
# nearest point at 0.5.
LARGEST_TURN = 0.3

NOBODY = np.int64(-1)  # no spring

# What ends a step.
NOTHING, PUSH_STARTS, RELEASE = integers(0, 1, 2)

# For the kernels, which take plain integers as constants.
OK, NO_RELEASE, NO_EXIT, STEP_UNDERFLOW, TOO_MANY_STEPS, PENETRATION, INVALID_PARAMETERS, NO_SPRING = integers(*Status)

# Where the smallest clearance is met.
AT_START, INSIDE, AT_EXIT = integers(0, 1, 2)


@njit(**KERNEL)
def invert_inertia(p, k, c, at):
    """Write the tensor of the six elements p[k:k+6] and its inverse into c[at:at+18].

    Returns whether it is positive definite and obeys the triangle inequality of principal moments.
    """
    xx, yy, zz, xy, xz, yz = p[k], p[k + 1], p[k + 2], p[k + 3], p[k + 4], p[k + 5]
    cxx, cxy, cxz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * cxx + xy * cxy + xz * cxz
    c[at], c[at + 1], c[at + 2] = xx, xy, xz
    c[at + 3], c[at + 4], c[at + 5] = xy, yy, yz
    c[at + 6], c[at + 7], c[at + 8] = xz, yz, zz
    inverse = 1.0 / determinant
    c[at + 9], c[at + 10], c[at + 11] = cxx * inverse, cxy * inverse, cxz * inverse
    c[at + 12], c[at + 13], c[at + 14] = cxy * inverse, (xx * zz - xz * xz) * inverse, (xy * xz - xx * yz) * inverse
    c[at + 15], c[at + 16], c[at + 17] = cxz * inverse, c[at + 14], (xx * yy - xy * xy) * inverse
    # Principal moments obey the triangle inequality where the second moment of mass, trace / 2 - inertia, has no
    # negative one.
    half = 0.5 * (xx + yy + zz) * (1.0 + 1e-9)
    a, b, d = half - xx, half - yy, half - zz
    return (
        xx > 0.0
        and xx * yy - xy * xy > 0.0
        and determinant > 0.0
        and a >= 0.0
        and b >= 0.0
        and d >= 0.0
        and a * b - xy * xy >= 0.0
        and a * d - xz * xz >= 0.0
        and b * d - yz * yz >= 0.0
        and a * (b * d - yz * yz) - xy * (xy * d + yz * xz) - xz * (xy * yz + b * xz) >= 0.0
    )


@njit(**KERNEL)
def place_springs(p, c, marks):
    """Fill the spring table from the parameters.

    Returns whether they are physical, the sum of the stiffnesses, twice the stored energy, the squares of the longest
    arms on both bodies, and the shortest release stroke and the largest deformation.
    """
    stowed = p[STOWED]
    valid = True
    stiffness = 0.0
    energy = 0.0
    arm1 = 0.0
    arm2 = 0.0
    deformation = 0.0
    shortest = np.inf
    for i in range(marks[SPRING_NUMBER]):
        q = COMMON_SIZE + SPRING_SIZE * i
        k = known(SPRINGS + SPRING_COLUMNS * i)
        kind = marks[SPRING_MARKS + MARK_COLUMNS * i + LAW]
        radius = p[q + 1]
        stroke = p[q + 4]
        scale = p[q + 7]
        valid = valid and radius >= 0.0 and stroke > 0.0 and p[q + 6] >= 0.0 and scale >= 0.0
        ca = math.cos(p[q])
        sa = math.sin(p[q])
        cb = math.cos(p[q + 5])
        sb = math.sin(p[q + 5])
        c[k + 6] = -sb * sa
        c[k + 7] = cb
        c[k + 8] = sb * ca
        # A stowed strut lies along its (canted) guide: the platform's seat is recessed by l_0 n, the satellite raised
        # by l_0 y.
        c[k] = radius * ca - stowed * c[k + 6] - p[7]
        c[k + 1] = stowed * (1.0 - cb) - p[8]
        c[k + 2] = radius * sa - stowed * c[k + 8] - p[9]
        c[k + 3] = radius * ca - p[17]
        c[k + 4] = -p[18]
        c[k + 5] = radius * sa - p[19]
        c[k + STIFFNESS] = p[q + 2]
        c[k + DEFORMATION] = p[q + 3]
        c[k + DELAY] = p[q + 6]
        c[k + SCALE] = scale
        c[k + RELEASE_STROKE] = stroke
        if kind == LINEAR:
            valid = valid and p[q + 2] > 0.0 and p[q + 3] > 0.0
            stroke = smaller(stroke, p[q + 3])
            c[k + RELEASE_STROKE] = stroke
            stiffness += scale * p[q + 2]
            energy += scale * p[q + 2] * stroke * (2.0 * p[q + 3] - stroke)
            deformation = larger(deformation, p[q + 3])
        elif kind != FRICTION:
            # Another law: slopes and work close enough for a step size and a typical velocity.
            steepest = 0.0
            for n in range(8):
                z = stroke * n / 8.0
                value, slope, _, _ = law(c, marks, i, z)
                steepest = larger(steepest, abs(slope))
                energy += scale * 2.0 * abs(value) * stroke / 8.0
            stiffness += scale * steepest
            deformation = larger(deformation, stroke)
        shortest = smaller(shortest, stroke)
        arm1 = larger(arm1, c[k] * c[k] + c[k + 1] * c[k + 1] + c[k + 2] * c[k + 2])
        arm2 = larger(arm2, c[k + 3] * c[k + 3] + c[k + 4] * c[k + 4] + c[k + 5] * c[k + 5])
    return valid, stiffness, energy, arm1, arm2, shortest, deformation


@njit(**KERNEL)
def prepare(p, orbit, c, marks, x):
    """Turn the parameter vector into the constants, the spring table and the initial state x.

    Returns whether the parameters are physical, an upper estimate of the fastest frequency [rad/s], the typical
    separation velocity [m/s], and the shortest stroke [m].
    """
    valid = p[0] > 0.0 and p[10] > 0.0 and p[FRICTION_COEFFICIENT] >= 0.0
    for n in range(p.shape[0]):
        valid = valid and abs(p[n]) < LARGEST
    c[INVERSE_REDUCED_MASS] = 1.0 / p[0] + 1.0 / p[10]
    valid = invert_inertia(p, PLATFORM + 1, c, PLATFORM_INERTIA) and valid
    valid = invert_inertia(p, SATELLITE + 1, c, SATELLITE_INERTIA) and valid
    stowed = p[STOWED]
    valid = valid and (stowed > 0.0 if marks[FORCE_LINE] == STRUT else stowed == 0.0)
    c[STOWED_LENGTH] = stowed
    c[GUIDE_FRICTION] = p[FRICTION_COEFFICIENT]
    for n in range(3):
        c[PLATFORM_CG + n] = p[7 + n]
        c[SATELLITE_CG + n] = p[17 + n]
    c[RADIUS] = p[RECESS_RADIUS]
    c[DEPTH] = p[RECESS_DEPTH]
    if marks[POINT_NUMBER] > 0:
        walls = c[RADIUS] > 0.0 or (c[RADIUS] == 0.0 and marks[PLANE_NUMBER] > 0)
        valid = valid and walls and c[DEPTH] > 0.0
    for n in range(marks[PLANE_NUMBER]):
        c[marks[PLANES] + PLANE_COLUMNS * n + 3] = p[COMMON_SIZE + SPRING_SIZE * marks[SPRING_NUMBER] + n]
    if marks[GRAVITY_LEVEL] != NO_GRAVITY:
        c[MU] = orbit[0]
        c[ANCHOR_TIME] = 0.0
        for n in range(6):
            c[ANCHOR + n] = orbit[1 + n]
        place_anchor(c)
    physical, stiffness, energy, arm1, arm2, shortest, deformation = place_springs(p, c, marks)
    q0, q1, q2, q3 = quaternion_from_rotation_vector(p[MOUNTING_ERROR], p[MOUNTING_ERROR + 1], p[MOUNTING_ERROR + 2])
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_matrix_elements(q0, q1, q2, q3)
    # The satellite's CG from the ring centre, in platform axes.
    ux = r00 * p[17] + r01 * p[18] + r02 * p[19]
    uy = r10 * p[17] + r11 * p[18] + r12 * p[19]
    uz = r20 * p[17] + r21 * p[18] + r22 * p[19]
    dx = ux - p[7]
    dy = uy - p[8] + stowed
    dz = uz - p[9]
    # Bolts or clamp band: Delta p at the ring centre and Delta h on the satellite, the opposite on the platform.
    ix = p[IMPULSE]
    iy = p[IMPULSE + 1]
    iz = p[IMPULSE + 2]
    x[0] = dx
    x[1] = dy
    x[2] = dz
    x[3] = p[RATES + 1] * dz - p[RATES + 2] * dy + c[INVERSE_REDUCED_MASS] * ix
    x[4] = p[RATES + 2] * dx - p[RATES] * dz + c[INVERSE_REDUCED_MASS] * iy
    x[5] = p[RATES] * dy - p[RATES + 1] * dx + c[INVERSE_REDUCED_MASS] * iz
    # The moments about both CGs of the impulse at the ring centre, whose arms are -u and -c_1 (the stowed length of a
    # strut lies along y between the two ring centres; the impulse acts at the satellite's).
    hx = p[ANGULAR_IMPULSE] - uy * iz + uz * iy
    hy = p[ANGULAR_IMPULSE + 1] - uz * ix + ux * iz
    hz = p[ANGULAR_IMPULSE + 2] - ux * iy + uy * ix
    kx = r00 * hx + r10 * hy + r20 * hz
    ky = r01 * hx + r11 * hy + r21 * hz
    kz = r02 * hx + r12 * hy + r22 * hz
    gx, gy, gz = times(c, SATELLITE_INVERSE_INERTIA, kx, ky, kz)
    x[9] = r00 * p[RATES] + r10 * p[RATES + 1] + r20 * p[RATES + 2] + gx
    x[10] = r01 * p[RATES] + r11 * p[RATES + 1] + r21 * p[RATES + 2] + gy
    x[11] = r02 * p[RATES] + r12 * p[RATES + 1] + r22 * p[RATES + 2] + gz
    hx = -p[ANGULAR_IMPULSE] + p[8] * iz - p[9] * iy - stowed * iz
    hy = -p[ANGULAR_IMPULSE + 1] + p[9] * ix - p[7] * iz
    hz = -p[ANGULAR_IMPULSE + 2] + p[7] * iy - p[8] * ix + stowed * ix
    gx, gy, gz = times(c, PLATFORM_INVERSE_INERTIA, hx, hy, hz)
    x[6] = p[RATES] + gx
    x[7] = p[RATES + 1] + gy
    x[8] = p[RATES + 2] + gz
    x[12] = q0
    x[13] = q1
    x[14] = q2
    x[15] = q3
    lever1 = arm1 * larger(c[10], larger(c[14], c[18]))
    lever2 = arm2 * larger(c[28], larger(c[32], c[36]))
    square = stiffness * (c[INVERSE_REDUCED_MASS] + lever1 + lever2)
    if marks[FORCE_LINE] == STRUT:
        square *= larger(1.0, deformation / stowed)
    for n in range(6, 12):
        square += x[n] * x[n]
    if marks[POINT_NUMBER] > 0:
        physical = physical and c[RADIUS] >= 0.0 and c[DEPTH] > 0.0
    return valid and physical, math.sqrt(square), math.sqrt(energy * c[INVERSE_REDUCED_MASS]), shortest


@njit(**KERNEL)
def point_motion(x, c, marks, i, out):
    """Write the position of envelope point i from the platform's ring centre and its velocity into out[0:6]."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    k = marks[POINTS] + POINT_COLUMNS * i
    u = c[k] - c[SATELLITE_CG]
    v = c[k + 1] - c[SATELLITE_CG + 1]
    w = c[k + 2] - c[SATELLITE_CG + 2]
    ax = x[0] + r00 * u + r01 * v + r02 * w
    ay = x[1] + r10 * u + r11 * v + r12 * w
    az = x[2] + r20 * u + r21 * v + r22 * w
    bx = x[10] * w - x[11] * v
    by = x[11] * u - x[9] * w
    bz = x[9] * v - x[10] * u
    out[0] = ax + c[PLATFORM_CG]
    out[1] = ay + c[PLATFORM_CG + 1]
    out[2] = az + c[PLATFORM_CG + 2]
    out[3] = x[3] + r00 * bx + r01 * by + r02 * bz - (x[7] * az - x[8] * ay)
    out[4] = x[4] + r10 * bx + r11 * by + r12 * bz - (x[8] * ax - x[6] * az)
    out[5] = x[5] + r20 * bx + r21 * by + r22 * bz - (x[6] * ay - x[7] * ax)


@njit(**INLINE)
def wall_clearance(c, marks, wall, point):
    """Clearance of a point (position, velocity: 6 numbers) from a wall: 0 is the cylinder, if any, then the planes."""
    if wall == 0:
        return c[RADIUS] - math.sqrt(point[0] * point[0] + point[2] * point[2]) if c[RADIUS] > 0.0 else np.inf
    k = marks[PLANES] + PLANE_COLUMNS * (wall - 1)
    return c[k] * point[0] + c[k + 1] * point[1] + c[k + 2] * point[2] - c[k + 3]


@njit(**INLINE)
def wall_approach(c, marks, wall, point):
    """A number of the sign of the speed at which a point comes near a wall, cheaper than the speed itself."""
    if wall == 0:
        return point[0] * point[3] + point[2] * point[5]
    k = marks[PLANES] + PLANE_COLUMNS * (wall - 1)
    return -(c[k] * point[3] + c[k + 1] * point[4] + c[k + 2] * point[5])


@njit(**INLINE)
def wall_growth(c, marks, wall, point):
    """How fast the clearance of a point from a wall shrinks [m/s]."""
    approach = wall_approach(c, marks, wall, point)
    if wall == 0:
        return approach / larger(math.sqrt(point[0] * point[0] + point[2] * point[2]), 1e-300)
    return approach


@njit(**KERNEL)
def nearest_wall(c, marks, point):
    """Smallest clearance of a point (position first), and the wall that it is from."""
    best = np.inf
    which = 0
    for wall in range(marks[PLANE_NUMBER] + 1):
        clearance = wall_clearance(c, marks, wall, point)
        if clearance < best:
            best = clearance
            which = wall
    return best, which


@njit(**INLINE)
def first_estimate(s, rate, acceleration, stroke):
    """Time until the stroke is reached [s] at constant acceleration; infinity where it never is."""
    gap = stroke - s
    if gap <= 0.0:
        return 0.0
    square = rate * rate + 2.0 * acceleration * gap
    if square <= 0.0:
        return np.inf
    # Free of cancellation for both signs of the acceleration.
    speed = rate + math.sqrt(square)
    return 2.0 * gap / speed if speed > 0.0 else np.inf


@njit(**KERNEL)
def refined_estimate(h, s, rate, acceleration, stroke, square):
    """The same from harmonic motion of squared frequency `square`, to fifth order, starting at h.

    That is s + rate sin(w h) / w + acceleration (1 - cos(w h)) / w^2, by its series.
    """
    gap = stroke - s
    if not 0.0 < h < 10.0 / math.sqrt(square):
        return h
    a3 = -square * rate / 6.0
    a4 = -square * acceleration / 24.0
    a5 = square * square * rate / 120.0
    for _ in range(6):
        value = h * (rate + h * (0.5 * acceleration + h * (a3 + h * (a4 + h * a5)))) - gap
        slope = rate + h * (acceleration + h * (3.0 * a3 + h * (4.0 * a4 + h * 5.0 * a5)))
        if not slope > 0.0:
            return np.inf
        change = value / slope
        h -= change
        if abs(change) < 1e-12:
            break
    return larger(h, 0.0)


@njit(**KERNEL)
def reached_release(w, slope, c, marks, expected):
    """The spring that reached its stroke first at or before the state w[NEW:] (or the one expected to).

    Returns it, or -1, and the time from there to that; only rates matter, so any slope serves.
    """
    spring = NOBODY
    time = np.inf
    for i in range(marks[SPRING_NUMBER]):
        if marks[SPRING_MARKS + MARK_COLUMNS * i + ACTIVE]:
            s, rate, _ = seat_motion(w, NEW, slope, c, marks, i)
            gap = c[SPRINGS + SPRING_COLUMNS * i + RELEASE_STROKE] - s
            if (gap <= 0.0 or i == expected) and rate > 0.0 and gap < time * rate:
                spring = i
                time = gap / rate
    return spring, time


@njit(**KERNEL)
def settle_on_release(t, w, c, marks, spring, time, frequency):
    """Correct the state w[NEW:] at t by short steps until the first spring is exactly at its stroke.

    Returns that spring and the total correction [s].
    """
    total = 0.0
    for _ in range(6):
        for n in range(STATE_SIZE):
            w[n] = w[NEW + n]
        if abs(time) * frequency < 1e-4:
            # Short enough for the midpoint rule (1e-13), or for a straight line; its slope takes up the remaining gap.
            number = FIRST + (2 if abs(time) * frequency > 1e-6 else 1)
            stages(FIRST, number, FOURTH_ORDER, t + total, time, w, c, marks)
            slope = K + (number - 1) * STATE_SIZE
            for _ in range(2):
                for n in range(STATE_SIZE):
                    w[NEW + n] += time * w[slope + n]
                total += time
                spring, time = reached_release(w, slope, c, marks, spring)
            return spring, total
        stages(FIRST, STAGE_NUMBER[FOURTH_ORDER], FOURTH_ORDER, t + total, time, w, c, marks)
        finish(FOURTH_ORDER, time, w)
        total += time
        spring, time = reached_release(w, K, c, marks, spring)
    return spring, total


class Follow(NamedTuple):
    """What is kept of the envelope points: for each its exit, and the smallest clearance of all."""

    step: np.ndarray  # step in which the point left the recess, -1 before (E,)
    base: np.ndarray  # index of the tape state from which the exit is reached by one step (E,)
    h: np.ndarray  # length of that step [s] (E,)
    method: np.ndarray  # its Runge-Kutta method (E,)
    x: np.ndarray  # state at the exit (E, STATE_SIZE)
    clearance: np.ndarray  # clearance at the exit [m] (E,)
    closest_x: np.ndarray  # state at the smallest clearance (STATE_SIZE,)
    closest: np.ndarray  # [clearance, point, AT_START | INSIDE | AT_EXIT, step, length of the step to it]
    start: np.ndarray  # position and velocity of each point where the step starts (E, 6)
    room: np.ndarray  # the same of one point (6,)
    room_x: np.ndarray  # a state (STATE_SIZE,)


@njit(**INLINE)
def step_method(h, short):
    """The Runge-Kutta method for a step of length h."""
    return FOURTH_ORDER if abs(h) <= short else EIGHTH_ORDER


@njit(**KERNEL)
def leave(follow, i, step, base, h, method, clearance):
    """Keep how point i left the recess."""
    follow.step[i] = step
    follow.base[i] = base
    follow.h[i] = h
    follow.method[i] = method
    follow.clearance[i] = clearance


@njit(**KERNEL)
def first_crossing(start, level, rise, slope0, slope1):
    """Where on [0, 1] a cubic first reaches a level above its start, and a place up to which it crosses it but once.

    The cubic rises by `rise`, with these slopes at its ends, to the level or back from a maximum. Where that is below
    the level both are its place, where what the cubic stands for may just be above.
    """
    bend = 3.0 * rise - 2.0 * slope0 - slope1
    twist = slope0 + slope1 - 2.0 * rise
    top = 1.0
    if not (0.0 <= slope0 <= 3.0 * rise and 0.0 <= slope1 <= 3.0 * rise):
        # It may turn: a maximum that is high enough comes before anything that it does behind it.
        square = bend * bend - 3.0 * twist * slope0
        if square > 0.0:
            divisor = math.sqrt(square) - bend
            peak = slope0 / divisor if divisor != 0.0 else 1.0
            if 0.0 < peak < 1.0:
                if start + peak * (slope0 + peak * (bend + peak * twist)) >= level:
                    top = peak
                elif start + rise < level:
                    return peak, peak
    low = 0.0
    high = top
    z = top
    for _ in range(20):
        value = start + z * (slope0 + z * (bend + z * twist)) - level
        if abs(value) < 1e-9 and z < top:
            break
        slope = slope0 + z * (2.0 * bend + z * 3.0 * twist)
        if value < 0.0:
            low = z
        else:
            high = z
        z = z - value / slope if slope > 0.0 else low
        if not low < z <= high:
            z = 0.5 * (low + high)
    return z, top


@njit(**KERNEL)
def locate_exit(step, tape, h, last, w, c, marks, follow, i, short):
    """Find and keep the instant at which point i leaves the recess: in `step`, at about its time h, not after `last`.

    Reached by one step from the nearer end of `step`. Returns its time in `step`, or -1 where the point stays inside.
    """
    depth = c[DEPTH]
    base = step
    t = tape.t[step]
    low = 0.0
    high = last
    if h > 0.5 * tape.h[step]:
        base = step + 1
        t += tape.h[step]
        h -= tape.h[step]
        low -= tape.h[step]
        high -= tape.h[step]
    x = follow.x[i]
    change = 0.0
    for _ in range(60):
        h += change
        full_step(step_method(h, short), t, tape.x[base], h, w, c, marks, x)
        point_motion(x, c, marks, i, follow.room)
        gap = depth - follow.room[1]
        change = gap / follow.room[4]
        if follow.room[4] > 0.0 and abs(change) < 1e-6:
            break
        # A point that turns may have other crossings: never beyond those that enclose the first one.
        if gap > 0.0:
            low = h
        else:
            high = h
        if not (follow.room[4] > 0.0 and low <= h + change <= high):
            change = 0.5 * (low + high) - h
            if high - low < 1e-9:
                # It grazes the plane.
                if gap > 1e-9:
                    return -1.0
                change = 0.0
                break
    # What is left of the way is a straight line: 1e-12 s^2 of acceleration at most.
    clearance, wall = nearest_wall(c, marks, follow.room)
    clearance -= change * wall_growth(c, marks, wall, follow.room)
    leave(follow, i, step, base, h, step_method(h, short), clearance)
    note_clearance(follow, follow.clearance[i], i, AT_EXIT, step, h, x)
    return h if base == step else h + tape.h[step]


@njit(**KERNEL)
def look_inside(step, tape, end, growth, shrinkage, w, c, marks, follow, i, wall, short):
    """Find and note the smallest clearance of point i from a wall within `step`, before its time `end`."""
    low = 0.0
    high = end
    side = 0
    for turn in range(20):
        length = low + (high - low) * growth / (growth - shrinkage)
        full_step(step_method(length, short), tape.t[step], tape.x[step], length, w, c, marks, follow.room_x)
        point_motion(follow.room_x, c, marks, i, follow.room)
        clearance = wall_clearance(c, marks, wall, follow.room)
        value = wall_growth(c, marks, wall, follow.room)
        # Its root only needs to be as good as the clearance.
        if abs(value) * (high - low) < 1e-10 or turn == 19:
            note_clearance(follow, clearance, i, INSIDE, step, length, follow.room_x)
            break
        # Regula falsi on how fast it shrinks, with half of a value that stays for a second turn (Illinois).
        if value > 0.0:
            low = length
            growth = value
            shrinkage *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            high = length
            shrinkage = value
            growth *= 0.5 if side < 0 else 1.0
            side = -1


@njit(**KERNEL)
def follow_points(step, tape, w, c, marks, follow, short):
    """Look at the step just taken: points that left the recess in it, and clearances that were smallest within it.

    Returns how many points left.
    """
    h = tape.h[step]
    depth = c[DEPTH]
    left = 0
    for i in range(marks[POINT_NUMBER]):
        if follow.step[i] >= 0:
            continue
        start = follow.start[i]
        point_motion(tape.x[step + 1], c, marks, i, follow.room)
        end = h
        exits = follow.room[1] >= depth
        if exits or (start[4] > 0.0 and follow.room[4] < 0.0):
            # By the cubic through both ends; a point that turns may have been outside in between.
            z = 1.0
            top = 1.0
            if h > 0.0:
                z, top = first_crossing(start[1], depth, follow.room[1] - start[1], h * start[4], h * follow.room[4])
            end = locate_exit(step, tape, z * h, top * h, w, c, marks, follow, i, short)
            exits = end >= 0.0
            if exits:
                left += 1
            else:
                end = h
                point_motion(tape.x[step + 1], c, marks, i, follow.room)
        for wall in range(marks[PLANE_NUMBER] + 1):
            # It shrank at the start and grows at the end: the point was nearest to the wall in between. Worth a look
            # only where the straight line from the start of the step comes closer than anything so far.
            if wall_approach(c, marks, wall, start) > 0.0 and wall_approach(c, marks, wall, follow.room) < 0.0:
                growth = wall_growth(c, marks, wall, start)
                shrinkage = wall_growth(c, marks, wall, follow.room)
                if wall_clearance(c, marks, wall, start) - growth * end < follow.closest[0] - 1e-9:
                    look_inside(step, tape, end, growth, shrinkage, w, c, marks, follow, i, wall, short)
                    point_motion(follow.x[i] if exits else tape.x[step + 1], c, marks, i, follow.room)
        for n in range(6):
            start[n] = follow.room[n]
    return left


@njit(**KERNEL)
def note_clearance(follow, clearance, point, kind, step, h, x):
    """Keep the smallest clearance so far and where it was met."""
    if clearance < follow.closest[0]:
        follow.closest[0] = clearance
        follow.closest[1] = point
        follow.closest[2] = kind
        follow.closest[3] = step
        follow.closest[4] = h
        for n in range(STATE_SIZE):
            follow.closest_x[n] = x[n]


class Tape(NamedTuple):
    """The steps of a run: step n leads from state n to state n + 1."""

    x: np.ndarray  # (MAXIMUM_STEPS + 1, STATE_SIZE)
    t: np.ndarray  # (MAXIMUM_STEPS + 1,)
    h: np.ndarray  # (MAXIMUM_STEPS,)
    method: np.ndarray
    event: np.ndarray  # what ends the step: NOTHING, PUSH_STARTS, RELEASE
    spring: np.ndarray  # which spring does


@njit(**KERNEL)
def clear_sums(c, marks):
    """No spring pushes."""
    marks[PUSHING] = 0
    for n in range(SUM_ROWS * SUM_COLUMNS):
        c[SUMS + n] = 0.0


@njit(**KERNEL)
def switch(spring, on, c, marks, w):
    """Let a spring push, or no longer."""
    marks[SPRING_MARKS + MARK_COLUMNS * spring + ACTIVE] = on
    marks[PUSHING] += 2 * on - 1
    if marks[PUSHING] == 0:
        clear_sums(c, marks)
    else:
        add_to_sums(spring, 2.0 * on - 1.0, c, marks, w)


@njit(**KERNEL)
def start_push(spring, c, marks, w):
    """Let a spring push; friction acts from the first push on."""
    for i in range(marks[SPRING_NUMBER]):
        m = SPRING_MARKS + MARK_COLUMNS * i
        if i == spring or (marks[m + LAW] == FRICTION and marks[m + PENDING]):
            marks[m + PENDING] = 0
            switch(i, SECOND, c, marks, w)


@njit(**KERNEL)
def start_springs(c, marks, w, release_time):
    """Which springs push at t = 0; returns how many are to be released and how many push.

    A scale of 0 is a spring that has failed: it takes no part.
    """
    number = 0
    pushers = 0
    clear_sums(c, marks)
    for i in range(marks[SPRING_NUMBER]):
        k = known(SPRINGS + SPRING_COLUMNS * i)
        m = SPRING_MARKS + MARK_COLUMNS * i
        release_time[i] = np.nan
        marks[m + ACTIVE] = 0
        marks[m + PENDING] = 0
        if c[k + SCALE] > 0.0:
            number += 1
            marks[m + PENDING] = 1
            if marks[m + LAW] == FRICTION:
                # Never the next push to start: it follows the first one.
                c[k + DELAY] = np.inf
            else:
                pushers += 1
    for i in range(marks[SPRING_NUMBER]):
        if marks[SPRING_MARKS + MARK_COLUMNS * i + PENDING] and c[SPRINGS + SPRING_COLUMNS * i + DELAY] <= 0.0:
            start_push(i, c, marks, w)
    return number, pushers


@njit(**KERNEL)
def run(orbit, attitude, stops, horizon, tolerance, p, c, marks, w, tape, follow, release_time, stop_x):
    """Simulate one run; returns (status, number of steps, index of the tape state at the last release).

    `c`, `marks`, `tape`, `follow`, `release_time` (N,) and `stop_x` (len(stops), STATE_SIZE) are written.
    """
    gravity = marks[GRAVITY_LEVEL] != NO_GRAVITY
    spring_number = marks[SPRING_NUMBER]
    x = tape.x[0]
    for n in range(4):
        x[16 + n] = attitude[n]
    valid, frequency, velocity, stroke = prepare(p, orbit, c, marks, x)
    if not valid:
        return INVALID_PARAMETERS, 0, 0
    # A fourth-order step this short has an error of (w h)^5 / 120, well below the tolerance.
    short = (0.6 * tolerance) ** 0.2 / frequency
    h_next = 9.0 * tolerance**0.125 / frequency
    step_tolerance = larger(STEP_MARGIN * tolerance, 1e-13)
    number, pushers = start_springs(c, marks, w, release_time)
    to_release = number
    if pushers == 0:
        return NO_SPRING, 0, 0
    turn = np.inf
    forget_slopes(w)
    inside = marks[POINT_NUMBER]
    follow.closest[0] = np.inf
    for i in range(marks[POINT_NUMBER]):
        follow.step[i] = -1
        point_motion(x, c, marks, i, follow.start[i])
        clearance, _ = nearest_wall(c, marks, follow.start[i])
        note_clearance(follow, clearance, i, AT_START, FIRST, 0.0, x)
        if follow.start[i, 1] >= c[DEPTH]:
            # Out of the recess from the start on, by its scatter: a step of no length leads to its "exit".
            leave(follow, i, FIRST, FIRST, 0.0, FOURTH_ORDER, clearance)
            inside -= 1
            for n in range(STATE_SIZE):
                follow.x[i, n] = x[n]
    stop = FIRST
    last = FIRST
    step = FIRST
    t = 0.0
    tape.t[0] = 0.0
    while to_release > 0 or inside > 0 or stop < stops.shape[0]:
        if step >= MAXIMUM_STEPS:
            return TOO_MANY_STEPS, step, last
        x = tape.x[step]
        # The next instant that no step may cross: the start of a push, the horizon, the end.
        boundary = np.inf
        event = NOTHING
        which = NOBODY
        if to_release > 0 or inside > 0:
            if t >= horizon:
                return NO_RELEASE if to_release > 0 else NO_EXIT, step, last
            boundary = horizon
        for i in range(spring_number):
            delay = c[SPRINGS + SPRING_COLUMNS * i + DELAY]
            if marks[SPRING_MARKS + MARK_COLUMNS * i + PENDING] and delay < boundary:
                boundary = delay
                event = PUSH_STARTS
                which = i
        if boundary == np.inf:
            boundary = stops[-1]
        limit = boundary - t  # a correction onto a release may have passed the boundary by less than a short step
        if gravity and t - c[ANCHOR_TIME] > 0.5 * ANCHOR_LIFE:
            move_anchor(t, c)
        # The next release, predicted from the slope here.
        load(x, w)
        stages(FIRST, SECOND, EIGHTH_ORDER, t, 0.0, w, c, marks)
        target = np.inf
        knot_time = np.inf
        expected = NOBODY
        square = 0.0
        nearest_s = 0.0
        nearest_rate = 0.0
        nearest_acceleration = 0.0
        for i in range(spring_number):
            if marks[SPRING_MARKS + MARK_COLUMNS * i + ACTIVE]:
                k = known(SPRINGS + SPRING_COLUMNS * i)
                s, rate, acceleration = seat_motion(w, START, K, c, marks, i)
                if s < -PENETRATION_LIMIT:
                    return PENETRATION, step, last
                square += c[k + SCALE] * c[k + STIFFNESS] * c[INVERSE_REDUCED_MASS]
                if marks[SPRING_MARKS + MARK_COLUMNS * i + LAW] == TABLE:
                    # The force bends at a knot of its table: steps that end there keep their order.
                    knot = next_knot(c, marks, i, s + 1e-7)
                    knot_time = smaller(knot_time, first_estimate(s, rate, acceleration, knot))
                time = first_estimate(s, rate, acceleration, c[k + RELEASE_STROKE])
                if time < target:
                    target = time
                    expected = i
                    nearest_s = s
                    nearest_rate = rate
                    nearest_acceleration = acceleration
        if expected >= 0 and target > 1e-15 and target < limit and target < 2.0 * h_next and square > 0.0:
            release_stroke = c[SPRINGS + SPRING_COLUMNS * expected + RELEASE_STROKE]
            target = refined_estimate(target, nearest_s, nearest_rate, nearest_acceleration, release_stroke, square)
        if target > 1e-15:
            h = h_next
            if to_release == 0 and inside > 0:
                # Coasting: end the step where the last point is about to leave the recess.
                ahead = 0.0
                for i in range(marks[POINT_NUMBER]):
                    if follow.step[i] < 0:
                        y_rate = follow.start[i, 4]
                        ahead = larger(ahead, (c[DEPTH] - follow.start[i, 1]) / y_rate) if y_rate > 0.0 else np.inf
                h = smaller(h, 1.0001 * ahead + 1e-9)
                # So that a point of a tumbling body turns back once at most in a step, from the plane or from a wall.
                h = smaller(h, turn)
            h = smaller(h, knot_time)
            if gravity:
                h = smaller(h, 0.5 * ANCHOR_LIFE)
            for n in range(3):
                w[ALLOWED + n] = step_tolerance * stroke
                w[ALLOWED + 3 + n] = step_tolerance * (velocity + abs(x[3 + n]))
                w[ALLOWED + 6 + n] = step_tolerance * (1e-3 + abs(x[6 + n]))
                w[ALLOWED + 9 + n] = step_tolerance * (1e-3 + abs(x[9 + n]))
            for n in range(12, STATE_SIZE):
                w[ALLOWED + n] = step_tolerance
            landing = target < limit and target <= 1.3 * h
            h = target if landing else smaller(h, limit)
            if short < h <= 2.0 * short:
                # Two short steps cost less than a long one.
                h *= 0.5
                landing = False
            attempt = 0
            while True:
                attempt += 1
                if attempt > 40:
                    return STEP_UNDERFLOW, step, last
                method = step_method(h, short)
                stages(SECOND, STAGE_NUMBER[method], method, t, h, w, c, marks)
                if method == EIGHTH_ORDER:
                    ratio = error_ratio(h, w)
                    if not ratio <= 1.0:
                        if not ratio < 1e30:
                            forget_slopes(w)
                            stages(FIRST, SECOND, EIGHTH_ORDER, t, 0.0, w, c, marks)
                        h *= larger(0.2, 0.9 * ratio**-0.125) if ratio < 1e30 else 0.2
                        h_next = h
                        landing = False
                        continue
                    suggestion = h * (smaller(6.0, 0.9 * ratio**-0.125) if ratio > 0.0 else 6.0)
                    h_next = suggestion if h >= h_next else larger(h_next, suggestion)
                finish(method, h, w)
                spring, time = reached_release(w, K, c, marks, expected if landing else NOBODY)
                if spring < 0 or time > short:
                    # No release in this step (or it is later than predicted: the next step lands).
                    if h < limit:
                        event = NOTHING
                        which = NOBODY
                    break
                if time < -short:
                    h += time
                    landing = True
                    expected = spring
                    continue
                event = RELEASE
                which, time = settle_on_release(t + h, w, c, marks, spring, time, frequency)
                h += time
                break
        else:
            # Springs that reach their stroke at the same instant follow each other in steps of no length.
            if not nearest_s > 0.999 * c[SPRINGS + SPRING_COLUMNS * expected + RELEASE_STROKE]:
                return STEP_UNDERFLOW, step, last
            h = 0.0
            method = FOURTH_ORDER
            event = RELEASE
            which = expected
            for n in range(STATE_SIZE):
                w[NEW + n] = x[n]
        new = tape.x[step + 1]
        for n in range(STATE_SIZE):
            new[n] = w[NEW + n]
        tape.h[step] = h
        tape.method[step] = method
        tape.event[step] = event
        tape.spring[step] = which
        if inside > 0:
            inside -= follow_points(step, tape, w, c, marks, follow, short)
        while stop < stops.shape[0] and stops[stop] <= t + h:
            # A time asked for is reached by a step of its own, so that the chain does not depend on it.
            ahead = stops[stop] - t
            full_step(step_method(ahead, short), t, x, ahead, w, c, marks, stop_x[stop])
            stop += 1
        t = boundary if event != RELEASE and h >= limit else t + h
        step += 1
        tape.t[step] = t
        if event == RELEASE:
            switch(which, FIRST, c, marks, w)
            release_time[which] = t
            to_release -= 1
            last = step
            if to_release == 0:
                # From here on nothing is faster than the bodies' own rotation: as long a step as the error allows.
                h_next = np.inf
                rate = 1e-2
                for n in range(6, 12):
                    rate += abs(new[n])
                short = (0.6 * tolerance) ** 0.2 / rate
                platform = math.sqrt(new[6] * new[6] + new[7] * new[7] + new[8] * new[8])
                satellite = math.sqrt(new[9] * new[9] + new[10] * new[10] + new[11] * new[11])
                turn = LARGEST_TURN / (1e-3 + platform + satellite)
        elif event == PUSH_STARTS:
            start_push(which, c, marks, w)
    return OK, step, last
