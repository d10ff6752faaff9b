"""One run, compiled: from a parameter vector to its events, its tape and its end.

The run is a chain of Runge-Kutta steps. No step crosses an event: the start of a push (its delay), a release (stroke
reached), a time asked for. A release is predicted from the stroke's rate and acceleration, the step is taken to it and
corrected by a short step, so that its cost is a fraction of a step. The accepted steps are kept on a tape, from which
`satsep_ot.dynamics.kernels.adjoint` computes exact derivatives.
"""

import math

import numpy as np

from satsep_ot.dynamics.kernels.compilation import inline, integers, kernel, larger, smaller
from satsep_ot.dynamics.kernels.constants import set_constants
from satsep_ot.dynamics.kernels.deck import PENETRATION_LIMIT, begin_watch, foot_is_clear, watch_deck
from satsep_ot.dynamics.kernels.envelope import enter_recess, follow_points, time_until_the_last_exit
from satsep_ot.dynamics.kernels.force_laws import force, next_knot
from satsep_ot.dynamics.kernels.gravity import ANCHOR_LIFE, move_anchor
from satsep_ot.dynamics.kernels.integration import (
    EIGHTH_ORDER,
    FIRST,
    FOURTH_ORDER,
    SECOND,
    STAGE_NUMBER,
    copy_state,
    error_ratio,
    finish,
    forget_slopes,
    full_step,
    stages,
    step_method,
)
from satsep_ot.dynamics.kernels.records import NO_GRAVITY, STATE_SIZE
from satsep_ot.dynamics.kernels.springs import (
    KNOT_DISTANCE,
    OFF,
    place_on_tables,
    start_push,
    start_springs,
    stroke_motion,
    switch,
)
from satsep_ot.dynamics.kernels.status import (
    INVALID_PARAMETERS,
    NO_EXIT,
    NO_RELEASE,
    NO_SPRING,
    OK,
    PENETRATION,
    STEP_UNDERFLOW,
    TOO_MANY_STEPS,
)
from satsep_ot.dynamics.kernels.vectors import norm

# What a step may err, as a share of what the run may: rates that the push nearly cancels, struts that turn fast.
STEP_MARGIN = 0.1
# Of both bodies together in a step on the way out of the recess [rad]: 3 of 20,000 tumblers in a test still missed a
# nearest point at 0.5.
LARGEST_TURN = 0.3
MAXIMUM_ATTEMPTS = 40  # at one step
MOST_CORRECTIONS = 4  # of a step onto a knot

NONE = np.int64(-1)  # no spring

# What ends a step.
NOTHING, PUSH_STARTS, RELEASE = integers(0, 1, 2)


@kernel
def fly(parameters, orbit, attitude, stops, horizon, tolerance, run, release_time, stop_states):
    """Simulate one run; returns its status.

    `release_time` (N,) and `stop_states`, STATE (len(stops),), are written, and `run` with its tape.
    """
    progress = run.progress
    status = start(parameters, orbit, attitude, horizon, tolerance, run, release_time)
    while status == OK and (is_under_way(progress) or progress.stop < stops.shape[0]):
        status = find_boundary(run, stops)
        if status == OK:
            status = predict_release(run)
        if status == OK:
            status = take_step(run)
        if status == OK:
            record_step(run)
            visit_stops(run, stops, stop_states)
            pass_event(run, release_time)
    if run.system.deck.height < -PENETRATION_LIMIT and status != INVALID_PARAMETERS and status != NO_SPRING:
        # It is why a run does not end, too.
        return PENETRATION
    return status


@inline
def is_under_way(progress):
    """Is a spring still to be released, a point in the recess, or may the satellite still come near the deck?"""
    return progress.to_release > 0 or progress.inside > 0 or progress.watching > 0


@inline
def last_step(run):
    """How many steps there is room for."""
    return run.tape.shape[0] - 1


@kernel
def start(parameters, orbit, attitude, horizon, tolerance, run, release_time):
    """Bring the run to t = 0; returns a status."""
    progress, state = run.progress, run.tape[0].state
    progress.step = 0
    progress.last = 0
    progress.stop = 0
    progress.evaluations = 0
    progress.time = 0.0
    run.tape[0].time = 0.0
    for n in range(4):
        state.q_1[n] = attitude[n]
    if not set_constants(parameters, orbit, run):
        return INVALID_PARAMETERS
    progress.horizon = horizon
    progress.tolerance = tolerance
    progress.step_tolerance = larger(STEP_MARGIN * tolerance, 1e-13)
    # A fourth-order step this short has an error of (w h)^5 / 120, well below the tolerance.
    progress.short = (0.6 * tolerance) ** 0.2 / progress.frequency
    progress.next_step = 9.0 * tolerance**0.125 / progress.frequency
    progress.longest_turn = np.inf
    progress.to_release, pushers = start_springs(run, release_time)
    if pushers == 0:
        return NO_SPRING
    forget_slopes(run.step)
    progress.inside = enter_recess(run)
    progress.watching = 1
    begin_watch(run)
    return OK


@kernel
def find_boundary(run, stops):
    """The next instant that no step may cross: the start of a push, the horizon, the end. Returns a status."""
    progress = run.progress
    if progress.step >= last_step(run):
        return TOO_MANY_STEPS
    progress.boundary = np.inf
    progress.boundary_event = NOTHING
    progress.boundary_spring = NONE
    if is_under_way(progress):
        if progress.time >= progress.horizon:
            return NO_RELEASE if progress.to_release > 0 else NO_EXIT
        progress.boundary = progress.horizon
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        if spring.is_pending and spring.delay < progress.boundary:
            progress.boundary = spring.delay
            progress.boundary_event = PUSH_STARTS
            progress.boundary_spring = i
    if progress.boundary == np.inf:
        progress.boundary = stops[-1]
    return OK


@kernel
def predict_release(run):
    """When the next release is to be expected, from the slope here, and the next knot of a table; returns a status."""
    progress, system, step = run.progress, run.system, run.step
    t = progress.time
    if system.gravity != NO_GRAVITY and t - system.anchor.time > 0.5 * ANCHOR_LIFE:
        move_anchor(t, system.anchor)
    copy_state(run.tape[progress.step].state, step.stage[0])
    if run.cubics.shape[0] > 0:
        place_on_tables(step.stage[0], run)
    stages(FIRST, SECOND, EIGHTH_ORDER, t, 0.0, run)
    soonest = np.inf
    expected = NONE
    progress.knot_in = np.inf
    progress.knot_spring = NONE
    knot_s = 0.0
    knot_rate = 0.0
    knot_acceleration = 0.0
    square = 0.0
    nearest_s = 0.0
    nearest_rate = 0.0
    nearest_acceleration = 0.0
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        if spring.is_pushing:
            s, rate, acceleration = stroke_motion(step.stage[0], step.slope[0], system, spring)
            stiffness = spring.stiffness
            if spring.has_table:
                # Steps that end at a knot of its table keep their order.
                knot = next_knot(spring, run.cubics, s + KNOT_DISTANCE)
                time = first_estimate(s, rate, acceleration, knot)
                if time < progress.knot_in:
                    progress.knot_in = time
                    progress.knot_spring = i
                    progress.knot = knot
                    knot_s = s
                    knot_rate = rate
                    knot_acceleration = acceleration
                _, slope, _, _ = force(spring, run.cubics, s)
                stiffness = larger(0.0, -slope)
            square += spring.scale * stiffness * system.inverse_reduced_mass
            time = first_estimate(s, rate, acceleration, spring.release_stroke)
            if time < soonest:
                soonest = time
                expected = i
                nearest_s = s
                nearest_rate = rate
                nearest_acceleration = acceleration
    progress.release_share = 0.0
    if expected >= 0:
        stroke = run.springs[expected].release_stroke
        progress.release_share = nearest_s / stroke
        limit = smaller(progress.boundary - t, 2.0 * progress.next_step)
        if 1e-15 < soonest < limit and square > 0.0:
            soonest = refined_estimate(soonest, nearest_s, nearest_rate, nearest_acceleration, stroke, square)
    progress.release_in = soonest
    progress.release_spring = expected
    if progress.knot_in < smaller(progress.boundary - t, progress.next_step) and square > 0.0:
        progress.knot_in = refined_estimate(
            progress.knot_in, knot_s, knot_rate, knot_acceleration, progress.knot, square
        )
    return OK


@inline
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


@kernel
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


@kernel
def longest_step(run):
    """As long a step as the error control, the knots of tables, the exits and the anchor allow [s]."""
    progress = run.progress
    h = progress.next_step
    if progress.to_release == 0 and (progress.inside > 0 or progress.watching > 0):
        if progress.inside > 0:
            # Coasting: end the step where the last point is about to leave the recess.
            h = smaller(h, 1.0001 * time_until_the_last_exit(run) + 1e-9)
        # So that a point of a tumbling body turns back once at most in a step, from the plane or from a wall.
        h = smaller(h, progress.longest_turn)
    h = smaller(h, progress.knot_in)
    if run.system.gravity != NO_GRAVITY:
        h = smaller(h, 0.5 * ANCHOR_LIFE)
    return h


@kernel
def set_allowed_error(progress, state, allowed):
    """The error that each number of the state may have in the next step."""
    tolerance = progress.step_tolerance
    for n in range(3):
        allowed.d[n] = tolerance * progress.length
        allowed.w[n] = tolerance * (progress.velocity + abs(state.w[n]))
        allowed.omega_1[n] = tolerance * (1e-3 + abs(state.omega_1[n]))
        allowed.omega_2[n] = tolerance * (1e-3 + abs(state.omega_2[n]))
    for n in range(12, STATE_SIZE):
        allowed.x[n] = tolerance


@kernel
def control_error(h, run):
    """After the stages of an eighth-order step of h [s]: returns whether its error is allowed, and else a shorter h."""
    progress = run.progress
    ratio = error_ratio(h, run.step)
    if ratio <= 1.0:
        suggestion = h * (smaller(6.0, 0.9 * ratio**-0.125) if ratio > 0.0 else 6.0)
        progress.next_step = suggestion if h >= progress.next_step else larger(progress.next_step, suggestion)
        return True, h
    if ratio < 1e30:
        h *= larger(0.2, 0.9 * ratio**-0.125)
    else:
        h *= 0.2
        forget_slopes(run.step)
        stages(FIRST, SECOND, EIGHTH_ORDER, progress.time, 0.0, run)
    progress.next_step = h
    return False, h


@kernel
def keep_step(progress, h, method, event, spring):
    """Keep how the step was taken."""
    progress.h = h
    progress.method = method
    progress.event = event
    progress.spring = spring


@kernel
def take_step(run):
    """A step to the boundary, to the expected release or as far as the error allows, into `run.step.end`.

    Returns a status.
    """
    progress, step = run.progress, run.step
    t, short = progress.time, progress.short
    release_in, expected = progress.release_in, progress.release_spring
    # A correction onto a release may have passed the boundary by less than a short step.
    limit = progress.boundary - t
    if release_in <= 1e-15:
        # Springs that reach their stroke at the same instant follow each other in steps of no length.
        if not progress.release_share > 0.999:
            return STEP_UNDERFLOW
        copy_state(run.tape[progress.step].state, step.end)
        keep_step(progress, 0.0, FOURTH_ORDER, RELEASE, expected)
        return OK
    h = longest_step(run)
    set_allowed_error(progress, run.tape[progress.step].state, step.allowed)
    # Not across a knot.
    landing = release_in < limit and release_in <= smaller(1.3 * h, progress.knot_in)
    h = release_in if landing else smaller(h, limit)
    corrections = MOST_CORRECTIONS if h == progress.knot_in else 0
    if short < h <= 2.0 * short:
        # Two short steps cost less than a long one.
        h *= 0.5
        landing = False
        corrections = 0
    for _ in range(MAXIMUM_ATTEMPTS):
        method = step_method(h, short)
        stages(SECOND, STAGE_NUMBER[method], method, t, h, run)
        if method == EIGHTH_ORDER:
            accepted, h = control_error(h, run)
            if not accepted:
                landing = False
                corrections = 0
                continue
        finish(method, h, step)
        if corrections > 0:
            # A knot is located, as a release is: the order of a step that ends beside it is lost.
            corrections -= 1
            time = time_to_knot(run)
            if 0.0 < h + time < limit and abs(time) > 1e-15:
                h += time
                continue
        if run.cubics.shape[0] > 0:
            time = time_to_passed_knot(run)
            if 0.0 < h + time < h:
                h += time
                landing = False
                continue
        spring, time = reached_release(step.slope[0], run, expected if landing else NONE)
        if spring < 0 or time > short:
            # No release in this step (or it is later than predicted: the next step lands).
            if h < limit:
                keep_step(progress, h, method, NOTHING, NONE)
            else:
                keep_step(progress, h, method, progress.boundary_event, progress.boundary_spring)
            return OK
        if time >= -short:
            spring, time = settle_on_release(t + h, run, spring, time)
            keep_step(progress, h + time, method, RELEASE, spring)
            return OK
        h += time
        landing = True
        expected = spring
    return STEP_UNDERFLOW


@kernel
def time_to_knot(run):
    """From the end of the step to the knot that it was to reach [s]; 0 where it is there, or does not come nearer."""
    progress, step = run.progress, run.step
    s, rate, _ = stroke_motion(step.end, step.slope[0], run.system, run.springs[progress.knot_spring])
    gap = progress.knot - s
    return gap / rate if rate > 0.0 and abs(gap) > 0.1 * KNOT_DISTANCE else 0.0


@kernel
def time_to_passed_knot(run):
    """From the end of the step back to the knot that it has passed nevertheless [s]; 0 where there is none.

    That is one that was not expected: of a spring that turns back, or that is quicker than it looked.
    """
    time = 0.0
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        if spring.is_pushing and spring.has_table:
            s, rate, _ = stroke_motion(run.step.end, run.step.slope[0], run.system, spring)
            start = run.cubics[spring.cubic].start
            if rate < 0.0 and spring.cubic > spring.first_cubic and s < start - KNOT_DISTANCE:
                time = smaller(time, (start - s) / rate)
            end = next_knot(spring, run.cubics, start)
            if rate > 0.0 and s > end + KNOT_DISTANCE:
                time = smaller(time, (end - s) / rate)
    return time


@kernel
def reached_release(slope, run, expected):
    """The spring that reached its stroke first at or before the end of the step (or the one expected to).

    Returns it, or -1, and the time from there to that; only rates matter, so any slope serves.
    """
    which = NONE
    time = np.inf
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        if spring.is_pushing:
            s, rate, _ = stroke_motion(run.step.end, slope, run.system, spring)
            gap = spring.release_stroke - s
            if (gap <= 0.0 or i == expected) and rate > 0.0 and gap < time * rate:
                which = i
                time = gap / rate
    return which, time


@kernel
def settle_on_release(t, run, spring, time):
    """Correct the end of the step at t by short steps until the first spring is exactly at its stroke.

    Returns that spring and the total correction [s].
    """
    step, frequency = run.step, run.progress.frequency
    total = 0.0
    for _ in range(6):
        copy_state(step.end, step.stage[0])
        if abs(time) * frequency < 1e-4:
            # Short enough for the midpoint rule (1e-13), or for a straight line; its slope takes up the remaining gap.
            number = FIRST + (2 if abs(time) * frequency > 1e-6 else 1)
            stages(FIRST, number, FOURTH_ORDER, t + total, time, run)
            slope = step.slope[number - 1]
            for _ in range(2):
                for n in range(STATE_SIZE):
                    step.end.x[n] += time * slope.x[n]
                total += time
                spring, time = reached_release(slope, run, spring)
            return spring, total
        stages(FIRST, STAGE_NUMBER[FOURTH_ORDER], FOURTH_ORDER, t + total, time, run)
        finish(FOURTH_ORDER, time, step)
        total += time
        spring, time = reached_release(step.slope[0], run, spring)
    return spring, total


@kernel
def record_step(run):
    """Put the step on the tape, and look at the envelope points within it."""
    progress = run.progress
    tape = run.tape[progress.step]
    tape.length = progress.h
    tape.method = progress.method
    tape.event = progress.event
    tape.spring = progress.spring
    copy_state(run.step.end, run.tape[progress.step + 1].state)
    if progress.watching > 0 and progress.h > 0.0:
        watch_deck(progress.step, run)
    if progress.inside > 0:
        progress.inside -= follow_points(progress.step, run)


@kernel
def visit_stops(run, stops, stop_states):
    """Reach the times asked for within the step, each by a step of its own: the chain does not depend on them."""
    progress = run.progress
    t = progress.time
    while progress.stop < stops.shape[0] and stops[progress.stop] <= t + progress.h:
        ahead = stops[progress.stop] - t
        method = step_method(ahead, progress.short)
        full_step(method, t, run.tape[progress.step].state, ahead, run, stop_states[progress.stop])
        progress.stop += 1


@kernel
def pass_event(run, release_time):
    """Go on to the end of the step, and let the event there happen."""
    progress = run.progress
    at_boundary = progress.event != RELEASE and progress.h >= progress.boundary - progress.time
    progress.time = progress.boundary if at_boundary else progress.time + progress.h
    progress.step += 1
    run.tape[progress.step].time = progress.time
    if progress.event == PUSH_STARTS:
        start_push(progress.spring, run)
    elif progress.event == RELEASE:
        switch(run.springs[progress.spring], OFF, run)
        release_time[progress.spring] = progress.time
        progress.to_release -= 1
        progress.last = progress.step
        if progress.to_release == 0:
            begin_coast(progress, run.tape[progress.step].state)
    if progress.watching > 0 and progress.to_release == 0:
        # What else is asked for may go on until the horizon; the watch ends there.
        over = progress.time >= progress.horizon or progress.step >= last_step(run)
        if over or foot_is_clear(run.tape[progress.step].state, run):
            progress.watching = 0


@kernel
def begin_coast(progress, state):
    """After the last release nothing is faster than the bodies' own rotation: steps as long as the error allows."""
    progress.next_step = np.inf
    rate = 1e-2
    for n in range(3):
        rate += abs(state.omega_1[n]) + abs(state.omega_2[n])
    progress.short = (0.6 * progress.tolerance) ** 0.2 / rate
    progress.longest_turn = LARGEST_TURN / (1e-3 + norm(state.omega_1) + norm(state.omega_2))
