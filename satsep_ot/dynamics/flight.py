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

from satsep_ot.dynamics.compilation import KERNEL
from satsep_ot.dynamics.integration import EIGHTH_ORDER, FOURTH_ORDER, error_ratio, finish, full_step, stages
from satsep_ot.dynamics.rigid_body import derivative, seat_motion
from satsep_ot.dynamics.rotations import quaternion_from_rotation_vector, rotation_matrix_elements
from satsep_ot.dynamics.separation import COMMON_SIZE, RECESS_DEPTH, RECESS_RADIUS, SPRING_SIZE, STOWED
from satsep_ot.dynamics.system import (
    DEFORMATION,
    DELAY,
    GUIDED,
    INVERSE_REDUCED_MASS,
    RELEASE_STROKE,
    STATE_SIZE,
    STIFFNESS,
    STOWED_LENGTH,
)

MAXIMUM_STEPS = 500
PENETRATION_LIMIT = 1e-3  # m

# What ends a step.
NOTHING, PUSH_STARTS, RELEASE = 0, 1, 2

# Status codes of satsep_ot.dynamics.separation.Status.
OK, NO_RELEASE, NO_EXIT, STEP_UNDERFLOW, TOO_MANY_STEPS, PENETRATION, INVALID_PARAMETERS = range(7)

# Where the smallest clearance is met.
AT_START, INSIDE, AT_EXIT = 0, 1, 2


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
def prepare(p, orbit, force_line, c, springs, x):
    """Turn a parameter vector into the constants c, the spring table and the initial state x.

    Returns whether the parameters are physical, an upper estimate of the fastest frequency [rad/s], and the typical
    separation velocity [m/s].
    """
    valid = p[0] > 0.0 and p[10] > 0.0
    for n in range(p.shape[0]):
        valid = valid and math.isfinite(p[n])
    c[INVERSE_REDUCED_MASS] = 1.0 / p[0] + 1.0 / p[10]
    valid = invert_inertia(p, 1, c, 1) and valid
    valid = invert_inertia(p, 11, c, 19) and valid
    stowed = p[STOWED]
    valid = valid and (stowed == 0.0 if force_line == GUIDED else stowed > 0.0)
    c[STOWED_LENGTH] = stowed
    for n in range(7):
        c[38 + n] = orbit[n]
    stiffness = energy = arm1 = arm2 = deformation = 0.0
    for i in range(springs.shape[0]):
        q = COMMON_SIZE + SPRING_SIZE * i
        angle, radius, cant = p[q], p[q + 1], p[q + 5]
        valid = valid and radius >= 0.0 and p[q + 2] > 0.0 and p[q + 3] > 0.0 and p[q + 4] > 0.0 and p[q + 6] >= 0.0
        ca, sa, cb, sb = math.cos(angle), math.sin(angle), math.cos(cant), math.sin(cant)
        springs[i, 6], springs[i, 7], springs[i, 8] = -sb * sa, cb, sb * ca
        # A stowed strut lies along its (canted) guide: the platform's seat is recessed by l_0 n, the satellite raised
        # by l_0 y.
        springs[i, 0] = radius * ca - stowed * springs[i, 6] - p[7]
        springs[i, 1] = stowed * (1.0 - cb) - p[8]
        springs[i, 2] = radius * sa - stowed * springs[i, 8] - p[9]
        springs[i, 3], springs[i, 4], springs[i, 5] = radius * ca - p[17], -p[18], radius * sa - p[19]
        springs[i, STIFFNESS], springs[i, DEFORMATION] = p[q + 2], p[q + 3]
        springs[i, RELEASE_STROKE], springs[i, DELAY] = min(p[q + 4], p[q + 3]), p[q + 6]
        stiffness += p[q + 2]
        energy += p[q + 2] * springs[i, RELEASE_STROKE] * (p[q + 3] - 0.5 * springs[i, RELEASE_STROKE])
        deformation = max(deformation, p[q + 3])
        arm1 = max(arm1, springs[i, 0] ** 2 + springs[i, 1] ** 2 + springs[i, 2] ** 2)
        arm2 = max(arm2, springs[i, 3] ** 2 + springs[i, 4] ** 2 + springs[i, 5] ** 2)
    a, b, d, e = quaternion_from_rotation_vector(p[23], p[24], p[25])
    r = rotation_matrix_elements(a, b, d, e)
    x[0] = r[0] * p[17] + r[1] * p[18] + r[2] * p[19] - p[7]
    x[1] = r[3] * p[17] + r[4] * p[18] + r[5] * p[19] - p[8] + stowed
    x[2] = r[6] * p[17] + r[7] * p[18] + r[8] * p[19] - p[9]
    x[6], x[7], x[8] = p[20], p[21], p[22]
    x[3], x[4], x[5] = x[7] * x[2] - x[8] * x[1], x[8] * x[0] - x[6] * x[2], x[6] * x[1] - x[7] * x[0]
    x[9] = r[0] * x[6] + r[3] * x[7] + r[6] * x[8]
    x[10] = r[1] * x[6] + r[4] * x[7] + r[7] * x[8]
    x[11] = r[2] * x[6] + r[5] * x[7] + r[8] * x[8]
    x[12], x[13], x[14], x[15] = a, b, d, e
    lever1 = arm1 * max(c[10], c[14], c[18])
    lever2 = arm2 * max(c[28], c[32], c[36])
    square = stiffness * (c[INVERSE_REDUCED_MASS] + lever1 + lever2)
    if force_line != GUIDED:
        square *= max(1.0, deformation / stowed)
    square += p[20] ** 2 + p[21] ** 2 + p[22] ** 2
    return valid, math.sqrt(square), math.sqrt(2.0 * energy * c[INVERSE_REDUCED_MASS])


@njit(**KERNEL)
def point_motion(x, system, i):
    """Position of envelope point i from the platform's ring centre and its velocity, in platform axes."""
    p = system.parameters
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    u, v, w = system.points[i, 0] - p[17], system.points[i, 1] - p[18], system.points[i, 2] - p[19]
    ax, ay, az = (
        x[0] + r00 * u + r01 * v + r02 * w,
        x[1] + r10 * u + r11 * v + r12 * w,
        x[2] + r20 * u + r21 * v + r22 * w,
    )
    bx, by, bz = x[10] * w - x[11] * v, x[11] * u - x[9] * w, x[9] * v - x[10] * u
    vx = x[3] + r00 * bx + r01 * by + r02 * bz - (x[7] * az - x[8] * ay)
    vy = x[4] + r10 * bx + r11 * by + r12 * bz - (x[8] * ax - x[6] * az)
    vz = x[5] + r20 * bx + r21 * by + r22 * bz - (x[6] * ay - x[7] * ax)
    return ax + p[7], ay + p[8], az + p[9], vx, vy, vz


@njit(**KERNEL)
def release_prediction(s, rate, acceleration, stroke, square):
    """Time until the stroke is reached [s], from harmonic motion of squared frequency `square` to fifth order."""
    gap = stroke - s
    if gap <= 0.0:
        return 0.0
    h = (
        gap / max(rate, 1e-300)
        if acceleration <= 0.0
        else (math.sqrt(rate * rate + 2.0 * acceleration * gap) - rate) / acceleration
    )
    if not h < 10.0 / math.sqrt(square):
        return np.inf
    # s + rate sin(w h) / w + acceleration (1 - cos(w h)) / w^2, by its series.
    a3, a4, a5 = -square * rate / 6.0, -square * acceleration / 24.0, square * square * rate / 120.0
    for _ in range(6):
        value = h * (rate + h * (0.5 * acceleration + h * (a3 + h * (a4 + h * a5)))) - gap
        slope = rate + h * (acceleration + h * (3.0 * a3 + h * (4.0 * a4 + h * 5.0 * a5)))
        if not slope > 0.0:
            return np.inf
        change = value / slope
        h -= change
        if abs(change) < 1e-12:
            break
    return max(h, 0.0)


@njit(**KERNEL)
def reached_release(x, system, k, expected):
    """The spring that reached its stroke first at or before x (or the one expected to), and the time from x to that."""
    spring, time = -1, np.inf
    for i in range(system.springs.shape[0]):
        if system.active[i]:
            s, rate, _ = seat_motion(x, k, 0, system, i)
            gap = system.springs[i, RELEASE_STROKE] - s
            if (gap <= 0.0 or i == expected) and rate > 0.0 and gap / rate < time:
                spring, time = i, gap / rate
    return spring, time


@njit(**KERNEL)
def settle_on_release(t, x, system, work, spring, time, frequency):
    """Correct the state x at t by short steps until the first spring is exactly at its stroke.

    Returns that spring and the total correction [s].
    """
    total = 0.0
    for _ in range(6):
        if abs(time) * frequency < 1e-4:
            # Short enough for the midpoint rule to be exact (1e-13), and for its slope to take up the remaining gap.
            derivative(t + total, x, work.k, 0, system)
            for n in range(STATE_SIZE):
                work.y[0, n] = x[n] + 0.5 * time * work.k[0, n]
            derivative(t + total + 0.5 * time, work.y[0], work.k, 1, system)
            for _ in range(2):
                for n in range(STATE_SIZE):
                    x[n] += time * work.k[1, n]
                total += time
                spring, time = reached_release(x, system, work.k, spring)
            return spring, total
        full_step(FOURTH_ORDER, t + total, x, time, work, system, x)
        total += time
        spring, time = reached_release(x, system, work.k, spring)
    return spring, total


@njit(**KERNEL)
def locate_exit(t, x, h, system, work, i, short, out):
    """Step from x to the instant near t + h at which point i leaves the recess; returns the length of that step [s]."""
    for _ in range(8):
        full_step(FOURTH_ORDER if abs(h) <= short else EIGHTH_ORDER, t, x, h, work, system, out)
        _, ay, _, _, vy, _ = point_motion(out, system, i)
        change = (system.parameters[RECESS_DEPTH] - ay) / vy
        h += change
        if abs(change) < 1e-10:
            # At lateral velocities of 0.1 m/s this is 1e-11 m of clearance.
            break
    return h


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


@njit(**KERNEL)
def follow_points(step, tape, system, work, follow, short, room):
    """Look at the step just taken: points that left the recess in it, and clearances that were smallest within it.

    Returns how many points left.
    """
    t, h, x, new = tape.t[step], tape.h[step], tape.x[step], tape.x[step + 1]
    depth, radius = system.parameters[RECESS_DEPTH], system.parameters[RECESS_RADIUS]
    left = 0
    for i in range(system.points.shape[0]):
        if follow.step[i] >= 0:
            continue
        ax, ay, az, vx, vy, vz = point_motion(x, system, i)
        bx, by, bz, ux, uy, uz = point_motion(new, system, i)
        end, exits = h, False
        if by >= depth:
            exits = True
            # The crossing on the cubic through both ends, then located by steps from the nearer end.
            z = 1.0
            if h > 0.0:
                for _ in range(20):
                    value = _cubic(z, ay, h * vy, by, h * uy) - depth
                    slope = (_cubic(z + 1e-6, ay, h * vy, by, h * uy) - depth - value) * 1e6
                    if not slope > 0.0:
                        break
                    z = min(max(z - value / slope, 0.0), 1.0)
            base = step if z < 0.5 else step + 1
            start = t if base == step else t + h
            length = locate_exit(
                start, tape.x[base], z * h if base == step else (z - 1.0) * h, system, work, i, short, follow.x[i]
            )
            bx, by, bz, ux, uy, uz = point_motion(follow.x[i], system, i)
            follow.step[i], follow.base[i], follow.h[i] = step, base, length
            follow.method[i] = FOURTH_ORDER if abs(length) <= short else EIGHTH_ORDER
            follow.clearance[i] = radius - math.sqrt(bx * bx + bz * bz)
            end = length if base == step else h + length
            left += 1
        # d(rho^2)/dt / 2 changes from growing to shrinking: the point was nearest to the wall in between.
        growth, shrinkage = ax * vx + az * vz, bx * ux + bz * uz
        # Worth a look only where the straight line from the start of the step would come closer than anything so far.
        start_radius = math.sqrt(ax * ax + az * az)
        nearest = radius - start_radius - max(growth, 0.0) * end / start_radius
        if growth > 0.0 and shrinkage < 0.0 and nearest < follow.closest[0] - 1e-9:
            length = end * growth / (growth - shrinkage)
            for _ in range(4):
                full_step(FOURTH_ORDER if length <= short else EIGHTH_ORDER, t, x, length, work, system, room)
                cx, _, cz, wx, _, wz = point_motion(room, system, i)
                value = cx * wx + cz * wz
                # Regula falsi on the growth of rho^2: its root only needs to be as good as the clearance, 1e-6 m.
                if value > 0.0:
                    length += (end - length) * value / (value - shrinkage)
                else:
                    length *= growth / (growth - value)
            full_step(FOURTH_ORDER if length <= short else EIGHTH_ORDER, t, x, length, work, system, room)
            cx, _, cz, _, _, _ = point_motion(room, system, i)
            note_clearance(follow, radius - math.sqrt(cx * cx + cz * cz), i, INSIDE, step, length, room)
        if exits:
            note_clearance(follow, follow.clearance[i], i, AT_EXIT, step, follow.h[i], follow.x[i])
    return left


@njit(**KERNEL)
def _cubic(z, value0, slope0, value1, slope1):
    """The Hermite cubic on [0, 1]."""
    rise = value1 - value0
    return value0 + z * (slope0 + z * (3.0 * rise - 2.0 * slope0 - slope1 + z * (slope0 + slope1 - 2.0 * rise)))


@njit(**KERNEL)
def note_clearance(follow, clearance, point, kind, step, h, x):
    """Keep the smallest clearance so far and where it was met."""
    if clearance < follow.closest[0]:
        follow.closest[0], follow.closest[1], follow.closest[2] = clearance, point, kind
        follow.closest[3], follow.closest[4] = step, h
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
def run(orbit, attitude, stops, horizon, tolerance, system, pending, work, tape, follow, release_time, stop_x):
    """Simulate one run; returns (status, number of steps, index of the tape state at the last release).

    `system.active`, `work`, `tape`, `follow`, `release_time` (N,) and `stop_x` (len(stops), STATE_SIZE) are written.
    """
    springs, active, p = system.springs, system.active, system.parameters
    x = tape.x[0]
    x[16], x[17], x[18], x[19] = attitude[0], attitude[1], attitude[2], attitude[3]
    valid, frequency, velocity = prepare(p, orbit, system.force_line, system.c, springs, x)
    inside = system.points.shape[0]
    if not valid or (inside > 0 and not (p[RECESS_RADIUS] > 0.0 and p[RECESS_DEPTH] > 0.0)):
        return INVALID_PARAMETERS, 0, 0
    # A fourth-order step this short has an error of (w h)^5 / 120, well below the tolerance.
    short = (0.6 * tolerance) ** 0.2 / frequency
    h_next = 2.0 * tolerance**0.125 / frequency
    stroke = springs[0, RELEASE_STROKE]
    to_release = springs.shape[0]
    for i in range(to_release):
        stroke = min(stroke, springs[i, RELEASE_STROKE])
        active[i] = springs[i, DELAY] <= 0.0
        pending[i] = not active[i]
        release_time[i] = np.nan
    follow.closest[0] = np.inf
    for i in range(inside):
        follow.step[i] = -1
        ax, _, az, _, _, _ = point_motion(x, system, i)
        note_clearance(follow, p[RECESS_RADIUS] - math.sqrt(ax * ax + az * az), i, AT_START, 0, 0.0, x)
    stop, last, step, t = 0, 0, 0, 0.0
    tape.t[0] = 0.0
    while to_release > 0 or inside > 0 or stop < stops.shape[0]:
        if step >= MAXIMUM_STEPS:
            return TOO_MANY_STEPS, step, last
        x, new = tape.x[step], tape.x[step + 1]
        # The next instant that no step may cross: the start of a push, the horizon, the end.
        boundary, event, which = np.inf, NOTHING, -1
        if to_release > 0 or inside > 0:
            if t >= horizon:
                return NO_RELEASE if to_release > 0 else NO_EXIT, step, last
            boundary = horizon
        for i in range(pending.shape[0]):
            if pending[i] and springs[i, DELAY] < boundary:
                boundary, event, which = springs[i, DELAY], PUSH_STARTS, i
        if boundary == np.inf:
            boundary = stops[-1]
        limit = boundary - t  # a correction onto a release may have passed the boundary by less than a short step
        # The next release, predicted from the slope here.
        derivative(t, x, work.k, 0, system)
        square = 0.0
        for i in range(active.shape[0]):
            if active[i]:
                square += springs[i, STIFFNESS] * system.c[INVERSE_REDUCED_MASS]
        target, expected = np.inf, -1
        for i in range(active.shape[0]):
            if active[i]:
                s, rate, acceleration = seat_motion(x, work.k, 0, system, i)
                if s < -PENETRATION_LIMIT:
                    return PENETRATION, step, last
                time = release_prediction(s, rate, acceleration, springs[i, RELEASE_STROKE], square)
                if time < target:
                    target, expected = time, i
        if target > 1e-15:
            h = h_next
            if to_release == 0 and inside > 0:
                # Coasting: end the step where the last point is about to leave the recess.
                ahead = 0.0
                for i in range(follow.step.shape[0]):
                    if follow.step[i] < 0:
                        _, ay, _, _, vy, _ = point_motion(x, system, i)
                        ahead = max(ahead, (p[RECESS_DEPTH] - ay) / vy) if vy > 0.0 else np.inf
                h = min(h, 1.0001 * ahead + 1e-9)
            for n in range(3):
                work.scale[n] = tolerance * stroke
                work.scale[3 + n] = tolerance * (velocity + abs(x[3 + n]))
                work.scale[6 + n] = tolerance * (1e-3 + abs(x[6 + n]))
                work.scale[9 + n] = tolerance * (1e-3 + abs(x[9 + n]))
            for n in range(12, STATE_SIZE):
                work.scale[n] = tolerance
            landing = target < limit and target <= 1.3 * h
            h = target if landing else min(h, limit)
            attempt = 0
            while True:
                attempt += 1
                if attempt > 40:
                    return STEP_UNDERFLOW, step, last
                method = FOURTH_ORDER if h <= short else EIGHTH_ORDER
                stages(method, t, x, h, work, system)
                if method == EIGHTH_ORDER:
                    ratio = error_ratio(h, work)
                    if not ratio <= 1.0:
                        h *= max(0.2, 0.9 * ratio**-0.125) if ratio < 1e30 else 0.2
                        h_next, landing = h, False
                        continue
                    suggestion = h * (min(6.0, 0.9 * ratio**-0.125) if ratio > 0.0 else 6.0)
                    h_next = suggestion if h >= h_next else max(h_next, suggestion)
                finish(method, h, work, new)
                spring, time = reached_release(new, system, work.k, expected if landing else -1)
                if spring < 0 or time > short:
                    # No release in this step (or it is later than predicted: the next step lands).
                    if h < limit:
                        event, which = NOTHING, -1
                    break
                if time < -short:
                    h, landing, expected = h + time, True, spring
                    continue
                event = RELEASE
                which, time = settle_on_release(t + h, new, system, work, spring, time, frequency)
                h += time
                break
        elif expected >= 0:
            # Springs that reach their stroke at the same instant follow each other in steps of no length.
            h, method, event, which = 0.0, FOURTH_ORDER, RELEASE, expected
            new[:] = x
        tape.h[step], tape.method[step], tape.event[step], tape.spring[step] = h, method, event, which
        if inside > 0:
            inside -= follow_points(step, tape, system, work, follow, short, stop_x[stops.shape[0]])
        while stop < stops.shape[0] and stops[stop] <= t + h:
            # A time asked for is reached by a step of its own, so that the chain does not depend on it.
            ahead = stops[stop] - t
            full_step(FOURTH_ORDER if ahead <= short else EIGHTH_ORDER, t, x, ahead, work, system, stop_x[stop])
            stop += 1
        reached_boundary = event != RELEASE and h >= limit
        t = boundary if reached_boundary else t + h
        step += 1
        tape.t[step] = t
        if event == RELEASE:
            active[which] = False
            release_time[which] = t
            to_release -= 1
            last = step
            if to_release == 0:
                # From here on nothing is faster than the bodies' own rotation: as long a step as the error allows.
                h_next = np.inf
                rate = abs(new[6]) + abs(new[7]) + abs(new[8]) + abs(new[9]) + abs(new[10]) + abs(new[11])
                short = (0.6 * tolerance) ** 0.2 / (rate + 1e-2)
        elif event == PUSH_STARTS:
            active[which], pending[which] = True, False
    return OK, step, last
