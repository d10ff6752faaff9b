"""The envelope points in the recess: their clearances from its walls, and how they leave it.

Wall 0 is the cylinder, if any, then come the planes.
"""

import math

import numpy as np

from satsep_ot.dynamics.kernels.compilation import inline, integers, kernel, larger
from satsep_ot.dynamics.kernels.integration import FIRST, FOURTH_ORDER, copy_state, full_step, step_method
from satsep_ot.dynamics.kernels.vectors import (
    add_lane,
    add_product,
    clear_rows,
    cross,
    dot,
    minus,
    plus,
    put,
    rotation,
    rotation_adjoint,
    scaled,
    times,
    transposed_times,
    vector,
)

# Where the smallest clearance is met.
AT_START, INSIDE, AT_EXIT = integers(0, 1, 2)


@kernel
def point_motion(state, system, point, motion):
    """Write the position of an envelope point from the platform's ring centre and its velocity into `motion`."""
    R = rotation(state.Q)
    b = minus(point.place, system.satellite.center_of_mass)
    p = plus(state.d, times(R, b))
    put(motion.position, plus(p, system.platform.center_of_mass))
    turning = times(R, cross(state.omega_2, b))
    put(motion.velocity, minus(plus(state.w, turning), cross(state.omega_1, p)))


@inline
def distance_from_axis(motion):
    """Of a point from the axis of the cylinder [m]."""
    return math.sqrt(motion.position[0] * motion.position[0] + motion.position[2] * motion.position[2])


@inline
def wall_clearance(run, wall, motion):
    """Clearance of a point from a wall [m]."""
    if wall == 0:
        radius = run.system.recess_radius
        return radius - distance_from_axis(motion) if radius > 0.0 else np.inf
    plane = run.planes[wall - 1]
    return dot(plane.normal, motion.position) - plane.offset


@inline
def approach(run, wall, motion):
    """A number of the sign of the speed at which a point comes near a wall, cheaper than the speed itself."""
    if wall == 0:
        return motion.position[0] * motion.velocity[0] + motion.position[2] * motion.velocity[2]
    return -dot(run.planes[wall - 1].normal, motion.velocity)


@inline
def approach_speed(run, wall, motion):
    """The speed at which a point comes near a wall [m/s]."""
    speed = approach(run, wall, motion)
    if wall == 0:
        return speed / larger(distance_from_axis(motion), 1e-300)
    return speed


@kernel
def nearest_wall(run, motion):
    """Smallest clearance of a point, and the wall that it is from."""
    smallest = np.inf
    which = 0
    for wall in range(run.planes.shape[0] + 1):
        clearance = wall_clearance(run, wall, motion)
        if clearance < smallest:
            smallest = clearance
            which = wall
    return smallest, which


@kernel
def keep_exit(point, step, base, h, method, clearance):
    """Keep how a point left the recess."""
    point.exit_step = step
    point.exit_base = base
    point.exit_length = h
    point.exit_method = method
    point.exit_clearance = clearance


@kernel
def keep_if_closest(closest, clearance, point, kind, step, h, state):
    """Keep the smallest clearance so far and where it was met."""
    if clearance < closest.clearance:
        closest.clearance = clearance
        closest.point = point
        closest.kind = kind
        closest.step = step
        closest.length = h
        copy_state(state, closest.state)


@kernel
def first_crossing(start, level, rise, slope_0, slope_1):
    """Where on [0, 1] a cubic first reaches a level above its start, and a place up to which it crosses it but once.

    The cubic rises by `rise`, with these slopes at its ends, to the level or back from a maximum. Where that is below
    the level both are its place, where what the cubic stands for may just be above.
    """
    bend = 3.0 * rise - 2.0 * slope_0 - slope_1
    twist = slope_0 + slope_1 - 2.0 * rise
    top = 1.0
    if not (0.0 <= slope_0 <= 3.0 * rise and 0.0 <= slope_1 <= 3.0 * rise):
        # It may turn: a maximum that is high enough comes before anything that it does behind it.
        square = bend * bend - 3.0 * twist * slope_0
        if square > 0.0:
            divisor = math.sqrt(square) - bend
            peak = slope_0 / divisor if divisor != 0.0 else 1.0
            if 0.0 < peak < 1.0:
                if start + peak * (slope_0 + peak * (bend + peak * twist)) >= level:
                    top = peak
                elif start + rise < level:
                    return peak, peak
    low = 0.0
    high = top
    z = top
    for _ in range(20):
        value = start + z * (slope_0 + z * (bend + z * twist)) - level
        if abs(value) < 1e-9 and z < top:
            break
        slope = slope_0 + z * (2.0 * bend + z * 3.0 * twist)
        if value < 0.0:
            low = z
        else:
            high = z
        z = z - value / slope if slope > 0.0 else low
        if not low < z <= high:
            z = 0.5 * (low + high)
    return z, top


@kernel
def locate_exit(step, i, h, last, run):
    """Find and keep the instant at which point i leaves the recess: in `step`, at about its time h, not after `last`.

    Reached by one step from the nearer end of `step`. Returns its time in `step`, or -1 where the point stays inside.
    """
    point, system, motion, short = run.points[i], run.system, run.step.motion, run.progress.short
    length = run.tape[step].length
    base = step
    t = run.tape[step].time
    low = 0.0
    high = last
    if h > 0.5 * length:
        base = step + 1
        t += length
        h -= length
        low -= length
        high -= length
    change = 0.0
    for _ in range(60):
        h += change
        full_step(step_method(h, short), t, run.tape[base].state, h, run, point.exit_state)
        point_motion(point.exit_state, system, point, motion)
        gap = system.recess_depth - motion.position[1]
        change = gap / motion.velocity[1]
        if motion.velocity[1] > 0.0 and abs(change) < 1e-6:
            break
        # A point that turns may have other crossings: never beyond those that enclose the first one.
        if gap > 0.0:
            low = h
        else:
            high = h
        if not (motion.velocity[1] > 0.0 and low <= h + change <= high):
            change = 0.5 * (low + high) - h
            if high - low < 1e-9:
                # It grazes the plane.
                if gap > 1e-9:
                    return -1.0
                change = 0.0
                break
    # What is left of the way is a straight line: 1e-12 s^2 of acceleration at most.
    clearance, wall = nearest_wall(run, motion)
    clearance -= change * approach_speed(run, wall, motion)
    keep_exit(point, step, base, h, step_method(h, short), clearance)
    keep_if_closest(system.closest, clearance, i, AT_EXIT, step, h, point.exit_state)
    return h if base == step else h + length


@kernel
def locate_smallest_clearance(step, i, wall, end, low_speed, high_speed, run):
    """Find and keep the smallest clearance of point i from a wall within `step`, before its time `end`.

    The point approaches the wall at low_speed > 0 at the start, and leaves it at the end, high_speed < 0.
    """
    motion, state, short = run.step.motion, run.step.other, run.progress.short
    start = run.tape[step]
    low = 0.0
    high = end
    side = 0
    for turn in range(20):
        h = low + (high - low) * low_speed / (low_speed - high_speed)
        full_step(step_method(h, short), start.time, start.state, h, run, state)
        point_motion(state, run.system, run.points[i], motion)
        speed = approach_speed(run, wall, motion)
        # Its root only needs to be as good as the clearance.
        if abs(speed) * (high - low) < 1e-10 or turn == 19:
            keep_if_closest(run.system.closest, wall_clearance(run, wall, motion), i, INSIDE, step, h, state)
            break
        # Regula falsi on the speed, with half of a value that stays for a second turn (Illinois).
        if speed > 0.0:
            low = h
            low_speed = speed
            high_speed *= 0.5 if side > 0 else 1.0
            side = 1
        else:
            high = h
            high_speed = speed
            low_speed *= 0.5 if side < 0 else 1.0
            side = -1


@kernel
def enter_recess(run):
    """Look at the points at t = 0; returns how many are in the recess."""
    system, state = run.system, run.tape[0].state
    inside = run.points.shape[0]
    system.closest.clearance = np.inf
    for i in range(run.points.shape[0]):
        point = run.points[i]
        point.exit_step = -1
        point_motion(state, system, point, point.start)
        clearance, _ = nearest_wall(run, point.start)
        keep_if_closest(system.closest, clearance, i, AT_START, FIRST, 0.0, state)
        if point.start.position[1] >= system.recess_depth:
            # Out of the recess from the start on, by its scatter: a step of no length leads to its "exit".
            keep_exit(point, FIRST, FIRST, 0.0, FOURTH_ORDER, clearance)
            copy_state(state, point.exit_state)
            inside -= 1
    return inside


@kernel
def follow_points(step, run):
    """Look at the step just taken: points that left the recess in it, and clearances that were smallest within it.

    Returns how many points left.
    """
    system, motion = run.system, run.step.motion
    h, state = run.tape[step].length, run.tape[step + 1].state
    depth = system.recess_depth
    left = 0
    for i in range(run.points.shape[0]):
        point = run.points[i]
        if point.exit_step >= 0:
            continue
        start = point.start
        point_motion(state, system, point, motion)
        end = h
        exits = motion.position[1] >= depth
        if exits or (start.velocity[1] > 0.0 and motion.velocity[1] < 0.0):
            # By the cubic through both ends; a point that turns may have been outside in between.
            z = 1.0
            top = 1.0
            if h > 0.0:
                rise = motion.position[1] - start.position[1]
                z, top = first_crossing(start.position[1], depth, rise, h * start.velocity[1], h * motion.velocity[1])
            end = locate_exit(step, i, z * h, top * h, run)
            exits = end >= 0.0
            if exits:
                left += 1
            else:
                end = h
                point_motion(state, system, point, motion)
        for wall in range(run.planes.shape[0] + 1):
            # It came nearer at the start and goes away at the end: the point was nearest to the wall in between. Worth
            # a look only where the straight line from the start of the step comes closer than anything so far.
            if approach(run, wall, start) > 0.0 and approach(run, wall, motion) < 0.0:
                speed = approach_speed(run, wall, start)
                if wall_clearance(run, wall, start) - speed * end < system.closest.clearance - 1e-9:
                    leaving = approach_speed(run, wall, motion)
                    locate_smallest_clearance(step, i, wall, end, speed, leaving, run)
                    if exits:
                        point_motion(point.exit_state, system, point, motion)
                    else:
                        point_motion(state, system, point, motion)
        put(start.position, motion.position)
        put(start.velocity, motion.velocity)
    return left


@kernel
def time_until_the_last_exit(run):
    """Until the last point leaves the recess, at constant velocities [s]; infinite where one does not."""
    ahead = 0.0
    for i in range(run.points.shape[0]):
        if run.points[i].exit_step < 0:
            start = run.points[i].start
            gap, rate = run.system.recess_depth - start.position[1], start.velocity[1]
            ahead = larger(ahead, gap / rate) if rate > 0.0 else np.inf
    return ahead


@kernel
def clearance_adjoint(state, i, n, kind, run, sweep, by_state):
    """Add to lane n of the adjoints what the clearance of envelope point i at a state says.

    That is at its exit, whose time moves, or at a fixed or extremal time.
    """
    point, system, motion = run.points[i], run.system, run.step.motion
    chain = sweep.chain
    constants = chain.constants
    point_motion(state, system, point, motion)
    _, wall = nearest_wall(run, motion)
    if wall == 0:
        by_p = scaled(-1.0 / distance_from_axis(motion), (motion.position[0], 0.0, motion.position[2]))
        constants.recess_radius[n] += 1.0
    else:
        by_p = vector(run.planes[wall - 1].normal)
        sweep.offsets[wall - 1, n] -= 1.0
    if kind == AT_EXIT:
        # The exit waits for y = depth.
        drift = dot(by_p, motion.velocity) / motion.velocity[1]
        by_p = (by_p[0], by_p[1] - drift, by_p[2])
        constants.recess_depth[n] += drift
    # p = d + R b + c_1 with b from the satellite's CG.
    b = minus(point.place, system.satellite.center_of_mass)
    R = rotation(state.Q)
    add_lane(by_state.d, n, by_p)
    add_lane(constants.platform.center_of_mass, n, by_p)
    add_lane(constants.satellite.center_of_mass, n, scaled(-1.0, transposed_times(R, by_p)))
    clear_rows(chain.rotation)
    add_product(chain.rotation, n, by_p, b)
    rotation_adjoint(state.Q, chain.rotation, by_state.Q)
