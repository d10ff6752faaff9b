"""How near the satellite comes to the deck, the plane of the platform's ring, on which it stands before the push.

Watched are the edge of the satellite's ring, a circle at the largest radius of the springs, and the envelope points in
the recess. With y_c the height of the ring's centre and (R_10, R_11, R_12) the deck's normal in satellite axes, the
lowest point of the edge is at

    y_c - r sqrt(R_10^2 + R_12^2)

which is a smooth function of the state: nothing is sampled round the ring. A point that starts below the deck, by a
mounting error, is measured from there: the surfaces were matched on the ground.
"""

import math

import numpy as np

from satsep_ot.dynamics.kernels.compilation import inline, integers, kernel, larger, smaller
from satsep_ot.dynamics.kernels.integration import FIRST, full_step, step_method
from satsep_ot.dynamics.kernels.vectors import (
    add_lane,
    clear_rows,
    cross,
    dot,
    minus,
    norm,
    plus,
    rotation,
    rotation_adjoint,
    scaled,
    times,
    vector,
)

# More than this below the deck, and the bodies are in each other.
PENETRATION_LIMIT = 1e-4  # m
# What is lowest: the ring's edge, or an envelope point by its number.
RING_EDGE = integers(-1)[0]
RESOLUTION = 1e-10  # m


@inline
def deck_motion(state, system):
    """The deck's normal in satellite axes and its rate; height of the satellite's CG over the deck, and its rate."""
    R = rotation(state.Q)
    omega_1 = vector(state.omega_1)
    normal = R[3], R[4], R[5]
    # A row of R' = R [omega_2] - [omega_1] R.
    turning = plus(
        cross(normal, state.omega_2),
        minus(scaled(omega_1[0], (R[6], R[7], R[8])), scaled(omega_1[2], (R[0], R[1], R[2]))),
    )
    height = state.d[1] + system.platform.center_of_mass[1] - system.stowed_length
    return normal, turning, height, state.w[1] - omega_1[2] * state.d[0] + omega_1[0] * state.d[2]


@inline
def watched_height(what, motion, run):
    """Height of the lowest point of the ring's edge, or of an envelope point, and its rate, from `deck_motion`."""
    normal, turning, height, rate = motion
    arm = scaled(-1.0, vector(run.system.satellite.center_of_mass))
    if what >= 0:
        arm = plus(arm, vector(run.points[what].place))
        return height + dot(normal, arm), rate + dot(turning, arm)
    radius = run.system.ring_radius
    sine = math.sqrt(normal[0] * normal[0] + normal[2] * normal[2])
    if sine > 0.0:
        tilting = (normal[0] * turning[0] + normal[2] * turning[2]) / sine
    else:
        tilting = math.sqrt(turning[0] * turning[0] + turning[2] * turning[2])
    return height + dot(normal, arm) - radius * sine, rate + dot(turning, arm) - radius * tilting


@inline
def watched(what, run):
    """The record of what is watched."""
    return run.system.deck.edge if what < 0 else run.points[what].foot


@kernel
def keep_if_lowest(height, what, step, length, run):
    """Keep the lowest height so far, what has it, and the step to it from the start of `step`."""
    deck = run.system.deck
    if height < deck.height:
        deck.height = height
        deck.what = what
        deck.step = step
        deck.length = length
        deck.method = step_method(length, run.progress.short)


@kernel
def begin_watch(run):
    """Look at the heights at t = 0."""
    deck = run.system.deck
    motion = deck_motion(run.tape[0].state, run.system)
    deck.height = np.inf
    deck.reach = run.system.ring_radius
    for what in range(RING_EDGE, run.points.shape[0]):
        foot = watched(what, run)
        foot.height, foot.rate = watched_height(what, motion, run)
        foot.start = smaller(foot.height, 0.0)
        keep_if_lowest(foot.height - foot.start, what, FIRST, 0.0, run)
        if what >= 0:
            place = run.points[what].place
            deck.reach = larger(deck.reach, math.sqrt(place[0] * place[0] + place[2] * place[2]))
    deck.rise = slowest_rise(motion, run)


@inline
def lowest_between(start, end, slope_0, slope_1):
    """Where on [0, 1] the cubic of these values and slopes is lowest inside, and its value; else 1 and the end."""
    rise = end - start
    bend = 3.0 * rise - 2.0 * slope_0 - slope_1
    twist = slope_0 + slope_1 - 2.0 * rise
    square = bend * bend - 3.0 * twist * slope_0
    z = 1.0
    if square > 0.0:
        root = math.sqrt(square)
        if bend > 0.0:
            z = -slope_0 / (bend + root)
        elif twist != 0.0:
            z = (root - bend) / (3.0 * twist)
        if not 0.0 < z < 1.0:
            z = 1.0
    return z, start + z * (slope_0 + z * (bend + z * twist))


@inline
def slowest_rise(motion, run):
    """Rate at which every part of the foot rises at least, from `deck_motion`."""
    _, turning, _, rate = motion
    tilting = math.sqrt(turning[0] * turning[0] + turning[2] * turning[2])
    return rate - dot(turning, run.system.satellite.center_of_mass) - run.system.deck.reach * tilting


@kernel
def watch_deck(step, run):
    """Look at the heights within the step just taken."""
    deck = run.system.deck
    motion = deck_motion(run.tape[step + 1].state, run.system)
    before = deck.rise
    deck.rise = slowest_rise(motion, run)
    # Mostly all of the foot rises from the start of the step to its end.
    if before < 0.0 or deck.rise < 0.0:
        watch_feet(step, motion, run)


@kernel
def watch_feet(step, motion, run):
    """Look at the heights within the step just taken, one after the other; `motion` is that of the deck at its end."""
    deck, tape = run.system.deck, run.tape[step]
    h = tape.length
    motion_before = deck_motion(tape.state, run.system)
    for what in range(RING_EDGE, run.points.shape[0]):
        foot = watched(what, run)
        start, start_rate = watched_height(what, motion_before, run)
        foot.height, foot.rate = watched_height(what, motion, run)
        z, height = lowest_between(start, foot.height, h * start_rate, h * foot.rate)
        if height - foot.start < deck.height - RESOLUTION:
            # What a cubic errs by on a smooth way down and up again is a small part of the way.
            way = smaller(start, foot.height) - height
            turn = run.progress.frequency * h
            if z < 1.0 and way * turn * turn > run.progress.tolerance * run.progress.length:
                locate_lowest(step, z * h, what, foot, run)
            else:
                keep_if_lowest(height - foot.start, what, step, z * h, run)


@kernel
def locate_lowest(step, length, what, foot, run):
    """Find and keep the lowest height of what is watched, in `step`, at about `length`."""
    tape, other = run.tape[step], run.step.other
    before, rate_before = tape.length, foot.rate
    height = np.inf
    for _ in range(8):
        full_step(step_method(length, run.progress.short), tape.time, tape.state, length, run, other)
        height, rate = watched_height(what, deck_motion(other, run.system), run)
        # The secant method on the rate.
        slope = (rate_before - rate) / (before - length)
        change = -rate / slope if slope > 0.0 else 0.0
        height += 0.5 * rate * change
        if not 0.0 < length + change < tape.length:
            break
        before, rate_before = length, rate
        length += change
        # Its place must be good for derivatives: they count on a rate of 0 there.
        if abs(change) < 1e-6 * tape.length:
            break
    keep_if_lowest(height - foot.start, what, step, length, run)


@kernel
def foot_is_clear(state, run):
    """Whether no later motion, free of springs, can bring the foot of the satellite below the deck.

    Sufficient, not necessary: the ring's centre rises faster than any tilting lowers the foot, until it is as high
    above the deck as the foot reaches out; or it is already there and rises.
    """
    system, radius = run.system, run.system.deck.reach
    R = rotation(state.Q)
    sine = math.sqrt(R[3] * R[3] + R[5] * R[5])
    _, _, height, _ = deck_motion(state, system)
    height -= dot((R[3], R[4], R[5]), system.satellite.center_of_mass)
    d, w, omega_1 = vector(state.d), vector(state.w), vector(state.omega_1)
    turn = minus(times(R, state.omega_2), omega_1)
    n_2 = (R[1], R[4], R[7])
    u = times(R, system.satellite.center_of_mass)
    rising = w[1] - cross(omega_1, d)[1] - cross(turn, u)[1]
    if not rising > 0.0:
        return False
    if height > radius:
        return True
    time = (radius - height) / rising
    size_1, size_2 = norm(omega_1), norm(state.omega_2)
    # Bounds of what turning does to the rates of tilt and height: Euler's equations, Coriolis and centripetal terms.
    both = (size_1 + size_2) * (size_1 + size_2)
    falling = both * (norm(d) + norm(u)) + 2.0 * size_1 * norm(w)
    tilting = norm(cross(turn, n_2))
    return height > radius * sine and rising > radius * (tilting + time * both) + time * falling


@kernel
def deck_height_adjoint(state, n, factor, run, sweep, by_state):
    """Add to lane n of the adjoints `factor` times what the height of the lowest point says in a state."""
    system, deck, chain = run.system, run.system.deck, sweep.chain
    constants = chain.constants
    R = rotation(state.Q)
    clear_rows(chain.rotation)
    by_state.d[1, n] += factor
    constants.platform.center_of_mass[1, n] += factor
    constants.stowed_length[n] -= factor
    add_lane(constants.satellite.center_of_mass, n, scaled(-factor, (R[3], R[4], R[5])))
    arm = scaled(-1.0, vector(system.satellite.center_of_mass))
    if deck.what >= 0:
        arm = plus(arm, vector(run.points[deck.what].place))
    else:
        sine = math.sqrt(R[3] * R[3] + R[5] * R[5])
        constants.ring_radius[n] -= factor * sine
        if sine > 0.0:
            arm = minus(arm, scaled(system.ring_radius / sine, (R[3], 0.0, R[5])))
    add_lane(chain.rotation, n, scaled(factor, arm), 3)
    rotation_adjoint(state.Q, chain.rotation, by_state.Q)


@inline
def starts_below(run):
    """Whether the lowest point started below the deck, from where its height counts then."""
    return watched(run.system.deck.what, run).start < 0.0


@kernel
def set_notice(notice, run):
    """Say when and where the satellite came nearest to the deck, for a person."""
    deck = run.system.deck
    tape = run.tape[deck.step]
    notice.time = tape.time + deck.length
    notice.point = deck.what
    notice.angle = 0.0
    if deck.what < 0:
        # A turn within the step moves the lowest place of the edge little: the nearer end says where it is.
        nearer = deck.step if 2.0 * deck.length < tape.length else deck.step + 1
        R = rotation(run.tape[nearer].state.Q)
        notice.angle = math.atan2(-R[5], -R[3])
