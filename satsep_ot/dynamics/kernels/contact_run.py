"""One run with contact, compiled: as `run`, with the events of contacts, bolts and pins located between its steps.

Between events a step is that of the usual error control; only what acts enters the right-hand side. Each element has
conditions that hold in its mode (see `contact.look_at`). Where one no longer holds at the end of a step, the step is
shortened until it ends just before the event, and short steps lead over it. Forces are continuous at the events of
contacts and of pins, which therefore need no better place than a nanosecond; releases, and points that leave a surface
while they are loaded, are located to rounding.
"""

import numpy as np

from satsep_ot.dynamics.kernels.compilation import inline, integers, kernel, larger, smaller
from satsep_ot.dynamics.kernels.constants import set_constants
from satsep_ot.dynamics.kernels.contact import (
    BOLT,
    EXTENT,
    GAP,
    GONE,
    HOLDS,
    LOADED,
    OPEN,
    OUT,
    PINS,
    RAIL_END,
    RAIL_MOUTH,
    SLACK,
    SLIPS,
    STICKS,
    contact_mode,
    element_force,
    gap_rate,
    list_loaded,
    look_at,
    way_of_points,
)
from satsep_ot.dynamics.kernels.contact_setup import set_elements
from satsep_ot.dynamics.kernels.deck import begin_watch, foot_is_clear, lowest_between
from satsep_ot.dynamics.kernels.envelope import enter_recess
from satsep_ot.dynamics.kernels.gravity import ANCHOR_LIFE, move_anchor
from satsep_ot.dynamics.kernels.integration import (
    EIGHTH_ORDER,
    FIRST,
    FOURTH_ORDER,
    SECOND,
    STAGE_NUMBER,
    B,
    C,
    copy_state,
    finish,
    forget_slopes,
    full_step,
    stages,
    step_method,
)
from satsep_ot.dynamics.kernels.records import MAXIMUM_CONTACT_STEPS, MAXIMUM_EVENTS, NO_GRAVITY, STATE_SIZE
from satsep_ot.dynamics.kernels.run import (
    LARGEST_TURN,
    MAXIMUM_ATTEMPTS,
    NONE,
    NOTHING,
    PUSH_STARTS,
    RELEASE,
    STEP_MARGIN,
    begin_coast,
    control_error,
    keep_step,
    longest_step,
    record_step,
    set_allowed_error,
    visit_stops,
)
from satsep_ot.dynamics.kernels.springs import OFF, start_push, stroke_motion, switch
from satsep_ot.dynamics.kernels.status import (
    INVALID_PARAMETERS,
    NO_EXIT,
    NO_RELEASE,
    NO_SPRING,
    OK,
    STEP_UNDERFLOW,
    STUCK,
    TOO_MANY_EVENTS,
    TOO_MANY_STEPS,
)
from satsep_ot.dynamics.kernels.vectors import cross, dot, minus, norm, plus, rotation, times, vector

# What ends a step beside what `run` knows: an element changes its mode; a bolt lets go.
MODE_CHANGES, BOLT_RELEASE = integers(3, 4)

EVENT_TIME = 1e-9  # s, of events at which the force is continuous
JUMP_TIME = 1e-13  # s, of those at which it jumps
# A run whose bodies move against each other by less than two sliding speeds for so long is stuck.
STUCK_TIME = 0.25  # s
MOST_TRIES = 6  # to end a step at an event
# So is one whose bodies do not move against each other at all, for a shorter time.
CALM_SPEED, CALM_TIME = 1e-4, 0.02  # m/s, s
# A satellite that pins hold so long after the last push hangs on them.
HANG_TIME = 1.0  # s
# What a step may err, as a share of what the run may, at tolerances of LOOSE and above: stiff contacts damp what short
# steps would not err, contacts without damping multiply it. Less at smaller tolerances: event by event as expected.
LOOSE = 1e-8
RAIL_MARGIN, CONTACT_MARGIN, PINS_MARGIN, ELASTIC_MARGIN = 1000.0, 10.0, 0.3, 0.5
SLIDING_SPEED = 1e-3  # m/s


@kernel
def fly_with_contact(
    parameters, orbit, attitude, stops, horizon, tolerance, run, release_time, stop_states, angles, feet
):
    """Simulate one run with contact; returns its status. As `run.fly`."""
    progress, contact = run.progress, run.contact
    status = start(parameters, orbit, attitude, horizon, tolerance, run, release_time, angles, feet)
    while status == OK and (is_under_way(run) or progress.stop < stops.shape[0]):
        status = find_boundary(run, stops)
        if status == OK:
            status = take_step(run)
        if status == OK:
            add_impulse(run)
            record_step(run)
            visit_stops(run, stops, stop_states)
            status = pass_event(run, release_time)
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        element.final[0], element.final[1], element.final[2] = element.mode, element.anchor, element.sign
    if status == OK and contact.stuck > 0:
        return STUCK
    return status


@inline
def is_under_way(run):
    """Is anything to be released, a point in the recess, or may the bodies still touch?"""
    progress = run.progress
    going = progress.to_release > 0 or progress.inside > 0 or progress.watching > 0 or run.contact.held > 0
    return going and run.contact.stuck == 0


@kernel
def start(parameters, orbit, attitude, horizon, tolerance, run, release_time, angles, feet):
    """Bring the run to t = 0; returns a status."""
    progress, contact, state = run.progress, run.contact, run.tape[0].state
    progress.step = 0
    progress.last = 0
    progress.stop = 0
    progress.evaluations = 0
    progress.time = 0.0
    run.tape[0].time = 0.0
    contact.events = 0
    contact.impulse = 0.0
    contact.force = 0.0
    contact.force_of = NONE
    contact.force_step = NONE
    contact.last_contact = 0.0
    contact.last_contact_index = NONE
    contact.still_since = 0.0
    contact.calm_since = 0.0
    contact.stuck = 0
    contact.pushed_until = 0.0
    contact.hint = np.inf
    contact.known = 0
    contact.number_loaded = 0
    contact.way = 0.0
    contact.way_across = 0.0
    contact.number_watched = run.elements.shape[0]
    for i in range(run.elements.shape[0]):
        contact.watched[i] = i
        contact.seen[i] = -1
        group = run.elements[i].group
        contact.stands_along[i] = 1 if group in (RAIL_END, RAIL_MOUTH) else 0
    for n in range(4):
        state.q_1[n] = attitude[n]
    if not set_constants(parameters, orbit, run):
        return INVALID_PARAMETERS
    if parameters.contact.shape[0] > 0:
        run.system.ring_radius = parameters.contact[0].radius
        run.system.ring_spring = NONE
    # Where nothing pushes, what there is of a velocity is typical.
    progress.velocity = larger(progress.velocity, larger(norm(state.w), 1e-3))
    progress.horizon = horizon
    progress.tolerance = tolerance
    progress.next_step = 9.0 * tolerance**0.125 / progress.frequency
    progress.longest_turn = np.inf
    progress.knot_in = np.inf
    forget_slopes(run.step)
    start_springs(run, release_time)
    set_elements(parameters, run, angles, feet)
    progress.step_tolerance = larger(step_margin(tolerance, run) * tolerance, 1e-13)
    progress.short = (0.6 * tolerance) ** 0.2 / progress.frequency
    if progress.to_release == 0 and contact.held == 0 and run.elements.shape[0] == 0:
        return NO_SPRING
    progress.inside = enter_recess(run)
    progress.watching = 1
    begin_watch(run)
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        if element.mode == LOADED:
            keep_event(0.0, MODE_CHANGES, i, OPEN, LOADED, 0.0, run)
    if progress.to_release == 0:
        limit_turns(progress, state)
    return OK


@kernel
def step_margin(tolerance, run):
    """What a step may err, as a share of what the run may."""
    margin = RAIL_MARGIN
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        if element.kind == PINS:
            margin = smaller(margin, PINS_MARGIN)
        elif element.group not in (RAIL_END, RAIL_MOUTH):
            margin = smaller(margin, CONTACT_MARGIN)
        if element.kind != BOLT and element.kind != PINS and element.damping <= 0.0:
            margin = smaller(margin, ELASTIC_MARGIN)
    return larger(margin * smaller(1.0, tolerance / LOOSE) ** 0.8, STEP_MARGIN)


@kernel
def start_springs(run, release_time):
    """Which springs push at t = 0; pins with a stiffness are elements of contact."""
    number = 0
    run.system.number_beside = 0
    run.system.number_in_sums = 0
    run.system.sums[:] = 0.0
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        release_time[i] = np.nan
        spring.is_pushing = 0
        spring.is_pending = 0
        if spring.scale > 0.0 and not is_pins(i, run):
            number += 1
            spring.is_pending = 1
            if spring.holds_back:
                spring.delay = np.inf
    for i in range(run.springs.shape[0]):
        if run.springs[i].is_pending and run.springs[i].delay <= 0.0:
            start_push(i, run)
    run.progress.to_release = number


@inline
def is_pins(i, run):
    """Whether spring i is that of pins which are an element of contact."""
    found = False
    for k in range(run.elements.shape[0]):
        found = found or (run.elements[k].kind == PINS and run.elements[k].number == i)
    return found


@kernel
def keep_event(time, what, element, before, mode, speed, run):
    """Put an event on the list."""
    contact = run.contact
    if contact.events < MAXIMUM_EVENTS:
        event = run.events[contact.events]
        event.time = time
        event.what = what
        event.element = element
        event.before = before
        event.mode = mode
        event.speed = speed
    contact.events += 1


@kernel
def find_boundary(run, stops):
    """The next instant that no step may cross: start of a push, release of a bolt, horizon, end. Returns a status."""
    progress = run.progress
    if progress.step >= MAXIMUM_CONTACT_STEPS:
        return TOO_MANY_STEPS
    if run.contact.events > MAXIMUM_EVENTS:
        return TOO_MANY_EVENTS
    progress.boundary = np.inf
    progress.boundary_event = NOTHING
    progress.boundary_spring = NONE
    if is_under_way(run):
        if progress.time >= progress.horizon:
            if sticks(run):
                return STUCK
            return NO_EXIT if progress.to_release == 0 and progress.inside > 0 else NO_RELEASE
        progress.boundary = progress.horizon
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        if spring.is_pending and spring.delay < progress.boundary:
            progress.boundary = spring.delay
            progress.boundary_event = PUSH_STARTS
            progress.boundary_spring = i
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        if element.kind == BOLT and element.mode != GONE and element.release < progress.boundary:
            progress.boundary = larger(element.release, progress.time)
            progress.boundary_event = BOLT_RELEASE
            progress.boundary_spring = i
    if progress.boundary == np.inf:
        progress.boundary = stops[-1]
    return OK


@kernel
def sticks(run):
    """Whether any pins stick."""
    found = False
    for i in range(run.elements.shape[0]):
        found = found or run.elements[i].mode == STICKS
    return found


@kernel
def look_back(i, state, R, Omega, run):
    """Evaluate the conditions of element i where the step starts, and up to which way none can end."""
    element, contact = run.elements[i], run.contact
    if contact.known > 0 and contact.seen[i] == run.progress.step - 1:
        # They are those where the last step has ended.
        for k in range(3):
            element.before[k] = element.after[k]
            element.rate_before[k] = element.rate_after[k]
    else:
        look_at(state, R, Omega, run, element.before, element.rate_before, i)
    contact.seen[i] = run.progress.step
    contact.clear_gap[i] = -np.inf
    if element.mode == OPEN or element.mode == OUT or element.mode == GONE or element.mode == HOLDS:
        # Half of the way: bodies that vibrate within a step move by more than from its start to its end.
        way = contact.way_across if contact.stands_along[i] > 0 else contact.way
        contact.clear_gap[i] = way + 0.5 * element.before[GAP]
        contact.clear_extent[i] = contact.way + 0.5 * element.before[EXTENT]


@kernel
def look_at_start(state, run):
    """Evaluate the conditions, where the step starts, of the elements that were watched in the last one."""
    R = rotation(state.Q)
    Omega = times(R, state.omega_2)
    for k in range(run.contact.number_watched):
        look_back(run.contact.watched[k], state, R, Omega, run)


@kernel
def look_at_end(run):
    """Evaluate the conditions, where the step ends, of the elements for which one may have ended: watch these."""
    contact, step, start = run.contact, run.step, run.tape[run.progress.step].state
    way, across = way_of_points(start, step.end, contact)
    contact.way_ahead, contact.way_across_ahead = contact.way + way, contact.way_across + across
    R_0, R = rotation(start.Q), rotation(step.end.Q)
    Omega_0, Omega = times(R_0, start.omega_2), times(R, step.end.omega_2)
    number = 0
    for i in range(run.elements.shape[0]):
        ahead = contact.way_across_ahead if contact.stands_along[i] > 0 else contact.way_ahead
        if not (ahead < contact.clear_gap[i] and contact.way_ahead < contact.clear_extent[i]):
            if contact.seen[i] < run.progress.step:
                look_back(i, start, R_0, Omega_0, run)
            element = run.elements[i]
            look_at(step.end, R, Omega, run, element.after, element.rate_after, i)
            contact.watched[number] = i
            number += 1
    contact.number_watched = number


@inline
def needs_rounding(element, condition):
    """Whether the force jumps where a condition no longer holds."""
    return condition == EXTENT and element.mode != OPEN and element.mode != OUT


@inline
def crossing(before, after, rate_before, rate_after, h):
    """Where in a step of h [s] a condition that holds at its start ends, and how long it is over at the end."""
    if not before > 0.0:
        return 0.0, h
    time = h * before / (before - after)
    slope = (before - after) / h
    if rate_before == rate_before and rate_after == rate_after:
        # Newton's method on the cubic through both ends, held within the step.
        low = 0.0
        high = 1.0
        rise, slope_0, slope_1 = after - before, h * rate_before, h * rate_after
        bend = 3.0 * rise - 2.0 * slope_0 - slope_1
        twist = slope_0 + slope_1 - 2.0 * rise
        z = time / h
        for _ in range(30):
            value = before + z * (slope_0 + z * (bend + z * twist))
            if value > 0.0:
                low = z
            else:
                high = z
            change = slope_0 + z * (2.0 * bend + 3.0 * z * twist)
            following = z - value / change if change != 0.0 else 0.5 * (low + high)
            if not low < following < high:
                following = 0.5 * (low + high)
            if abs(following - z) < 1e-15:
                break
            z = following
        time = z * h
        slope = larger(-rate_after, 0.1 * slope)
    return time, -after / slope


@kernel
def first_event(h, run):
    """The first event in a step of h [s]: its time, how long it is over at the end, what it is and of which one.

    Then how good its place must be, and how long the latest is over of those at which a force jumps.
    """
    soonest = np.inf
    over = 0.0
    what = NOTHING
    which = NONE
    tolerance = EVENT_TIME
    latest = 0.0
    slope = run.step.slope[0]
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        if spring.is_pushing:
            s, rate, _ = stroke_motion(run.step.end, slope, run.system, spring)
            if s >= spring.release_stroke and rate > 0.0:
                s_0, rate_0, _ = stroke_motion(run.step.stage[0], slope, run.system, spring)
                before, after = spring.release_stroke - s_0, spring.release_stroke - s
                time, late = crossing(before, after, -rate_0, -rate, h)
                if time > 0.0:
                    latest = larger(latest, late)
                if time < soonest:
                    soonest, over, what, which, tolerance = time, late, RELEASE, i, JUMP_TIME
    for m in range(run.contact.number_watched):
        i = run.contact.watched[m]
        element = run.elements[i]
        for k in range(3):
            if element.after[k] < 0.0:
                time, late = crossing(
                    element.before[k], element.after[k], element.rate_before[k], element.rate_after[k], h
                )  # fmt: skip
                if needs_rounding(element, k) and time > 0.0:
                    latest = larger(latest, late)
                if time < soonest:
                    soonest, over, what, which = time, late, MODE_CHANGES, i
                    tolerance = JUMP_TIME if needs_rounding(element, k) else EVENT_TIME
    return soonest, over, what, which, tolerance, latest


@kernel
def passes_unseen(h, run):
    """Whether a surface may have been touched and left again within the step, by the cubics of the gaps."""
    for m in range(run.contact.number_watched):
        element = run.elements[run.contact.watched[m]]
        if element.mode == OPEN and element.rate_before[GAP] < 0.0 and element.rate_after[GAP] > 0.0:
            _, lowest = lowest_between(
                element.before[GAP], element.after[GAP], h * element.rate_before[GAP], h * element.rate_after[GAP]
            )  # fmt: skip
            if lowest < 0.0:
                return True
    return False


@kernel
def pending_event(run):
    """An element whose condition no longer holds where the last step has ended, at an event of another one; or -1."""
    for m in range(run.contact.number_watched):
        i = run.contact.watched[m]
        for k in range(3):
            if run.elements[i].after[k] < 0.0:
                return i
    return NONE


@kernel
def allow_rounding(allowed):
    """Stiff contacts turn the rounding of places into forces: no step needs to err less than that."""
    for n in range(3):
        allowed.d[n] += 1e-14
        allowed.w[n] += 1e-13
        allowed.omega_1[n] += 1e-13
        allowed.omega_2[n] += 1e-13
    for n in range(12, STATE_SIZE):
        allowed.x[n] += 1e-14


@inline
def holds_at_start(element):
    """Whether no condition of an element is violated where the step starts by more than rounding."""
    return element.before[0] > -1e-9 and element.before[1] > -1e-9 and element.before[2] > -1e-9


@kernel
def keep_only(which, run):
    """Leave but the event of element `which` for now, and take its conditions where the step starts."""
    for m in range(run.contact.number_watched):
        i = run.contact.watched[m]
        element = run.elements[i]
        for k in range(3):
            if i != which:
                element.after[k] = np.inf
            elif element.after[k] < 0.0 and element.before[k] <= 0.0:
                element.after[k] = smaller(element.before[k], -1e-300)
            else:
                element.after[k] = larger(element.before[k], 0.0)


@inline
def place_error(time, h, run):
    """How far the place of an event by a cubic through both ends of a step of h [s] may be off [s]."""
    frequency = run.contact.frequency if run.contact.number_loaded > 0 else run.contact.free_frequency
    phase = smaller(frequency * h, 1.5)
    z = time / h
    error = phase * phase * phase / 24.0 * z * z * (1.0 - z) * (1.0 - z) * h
    return smaller(larger(error, EVENT_TIME), 0.5 * time)


@inline
def first_step(run):
    """A step for the error control to begin with after an event [s]."""
    if run.contact.number_loaded > 0:
        return 6.0 * run.progress.step_tolerance**0.125 / run.contact.frequency
    return 1.0 / run.contact.free_frequency


@kernel
def take_step(run):
    """A step to the boundary, to the next event or as far as the error allows, to `run.step.end`; returns a status."""
    progress, step, contact = run.progress, run.step, run.contact
    t, limit = progress.time, progress.boundary - progress.time
    state = run.tape[progress.step].state
    if run.system.gravity != NO_GRAVITY and t - run.system.anchor.time > 0.5 * ANCHOR_LIFE:
        move_anchor(t, run.system.anchor)
    which = pending_event(run) if progress.step > 0 else NONE
    if which >= 0:
        copy_state(state, step.end)
        keep_step(progress, 0.0, FOURTH_ORDER, MODE_CHANGES, which)
        return OK
    copy_state(state, step.stage[0])
    stages(FIRST, SECOND, EIGHTH_ORDER, t, 0.0, run)
    look_at_start(state, run)
    set_allowed_error(progress, state, step.allowed)
    allow_rounding(step.allowed)
    h = smaller(longest_step(run), limit)
    if contact.hint < h:
        h = contact.hint
    contact.hint = np.inf
    aim = np.inf
    tries = 0
    for _ in range(2 * MAXIMUM_ATTEMPTS):
        method = step_method(h, progress.short)
        stages(SECOND, STAGE_NUMBER[method], method, t, h, run)
        if method == EIGHTH_ORDER:
            accepted, shorter = control_error(h, run)
            if not accepted:
                h = shorter
                continue
        finish(method, h, step)
        look_at_end(run)
        time, over, what, event_of, tolerance, late = first_event(h, run)
        if what == NOTHING:
            if h > 1e-9 and passes_unseen(h, run):
                h *= 0.5
                continue
            at_end = h >= limit
            if method == FOURTH_ORDER and h >= progress.next_step:
                progress.next_step = 4.0 * h
            if aim < np.inf:
                # It has ended just before the event.
                contact.hint = larger(2.0 * (aim - h), 4.0 * JUMP_TIME)
            keep_step(
                progress, h, method, progress.boundary_event if at_end else NOTHING,
                progress.boundary_spring if at_end else NONE,
            )  # fmt: skip
            return OK
        aim = time
        tries += 1
        if (over <= tolerance and late <= JUMP_TIME) or h <= JUMP_TIME:
            keep_step(progress, h, method, what, event_of)
            return OK
        if time <= 0.0 and what == MODE_CHANGES and h > 1e-6 and holds_at_start(run.elements[event_of]):
            # The condition may hold from the start on for a while: what touches at rest, what has just begun.
            h *= 0.1
            continue
        if time <= 0.0:
            # It is over where the step starts, within what an event's place may err by.
            copy_state(state, step.end)
            keep_only(event_of if what == MODE_CHANGES else NONE, run)
            keep_step(progress, 0.0, FOURTH_ORDER, what, event_of)
            return OK
        if tries > MOST_TRIES:
            # A condition that is far from a straight line over the step: nearer to it the next one sees more.
            h *= 0.5
        elif time > 4.0 * progress.short:
            # End before it; what is left is for short steps.
            h = time - place_error(time, h, run)
        else:
            # A little behind the place that the cubic, or the straight line, says.
            h = smaller(time + 0.5 * tolerance, h - 0.5 * smaller(over, 0.5 * h))
    return STEP_UNDERFLOW


@kernel
def add_impulse(run):
    """Add the normal forces of the step just taken to their impulse, by the quadrature of the step itself."""
    contact, progress = run.contact, run.progress
    if contact.number_loaded == 0 or progress.h == 0.0:
        return
    for i in range(STAGE_NUMBER[progress.method]):
        weight = B[progress.method, i]
        if weight != 0.0:
            contact.impulse += progress.h * weight * contact.stage_normal[i]
    largest = -1
    for i in range(STAGE_NUMBER[progress.method]):
        if contact.stage_largest[i] >= contact.force and (
            largest < 0 or contact.stage_largest[i] > contact.stage_largest[largest]
        ):
            largest = i
    if largest >= 0:
        locate_force(contact.stage_largest_of[largest], C[progress.method, largest] * progress.h, run)


@kernel
def normal_force_rate(state, slope, which, run):
    """Normal force of an element in a state, and its rate along a slope."""
    element, other = run.elements[which], run.step.combined
    _, _, _, N = element_force(state, rotation(state.Q), element, run)
    for n in range(STATE_SIZE):
        other.x[n] = state.x[n] + 1e-7 * slope.x[n]
    _, _, _, ahead = element_force(other, rotation(other.Q), element, run)
    return N, (ahead - N) * 1e7


@kernel
def locate_force(which, length, run):
    """Find and keep the largest normal force in the step just taken: of element `which`, at about `length`.

    Where it grows until the step ends, the next step goes on.
    """
    if which < 0:
        return
    contact, progress, step = run.contact, run.progress, run.step
    start, h, other = run.tape[progress.step], progress.h, run.step.other
    before, rate_before, best, force = 0.0, 0.0, length, -1.0
    for turn in range(12):
        if length == h:
            copy_state(step.end, other)
        else:
            full_step(step_method(length, progress.short), start.time, start.state, length, run, other)
        slope_at(other, run)
        N, rate = normal_force_rate(other, step.slope[0], which, run)
        if force < N:
            best, force = length, N
        if turn == 0 and ((length == h and rate > 0.0) or h < 1e-12):
            break
        change = 1e-3 * h if rate > 0.0 else -1e-3 * h
        if turn > 0 and rate != rate_before:
            change = -rate * (length - before) / (rate - rate_before)
        before, rate_before = length, rate
        following = smaller(larger(length + change, -0.1 * h), h)
        if abs(following - length) < 1e-7 * h:
            break
        length = following
    if force > contact.force:
        contact.force, contact.force_of, contact.force_step, contact.force_length = force, which, progress.step, best


@inline
def slope_at(state, run):
    """Write the slope in a state into that of the first stage."""
    copy_state(state, run.step.stage[0])
    stages(FIRST, SECOND, EIGHTH_ORDER, run.progress.time, 0.0, run)


@kernel
def change_mode(which, state, run):
    """The next mode of an element whose condition no longer holds, with its anchor and sign; returns what it was."""
    element = run.elements[which]
    mode = element.mode
    R = rotation(state.Q)
    if element.kind == PINS:
        spring = run.springs[element.number]
        if element.after[EXTENT] < 0.0:
            element.mode = GONE
        elif mode == STICKS:
            s = spring.release_stroke - element.after[EXTENT]
            rate = gap_rate(state, which, run)
            element.sign = 1.0 if s - element.anchor + element.damping * rate > 0.0 else -1.0
            element.mode = SLIPS
        else:
            s = spring.release_stroke - element.after[EXTENT]
            element.anchor = s - element.sign * spring.scale / element.stiffness
            element.mode = STICKS
        return mode
    if element.after[EXTENT] < 0.0:
        element.mode = OUT if mode != OUT else contact_mode(state, R, element, run.system)
    elif mode == OPEN:
        # One that opens faster than it can push has nothing to push with.
        bracket = 1.0 - element.damping * gap_rate(state, which, run)
        element.mode = LOADED if bracket > 0.0 else SLACK
    elif element.after[GAP] < 0.0:
        element.mode = OPEN
    else:
        element.mode = SLACK if mode == LOADED else LOADED
    return mode


@kernel
def pass_event(run, release_time):
    """Go on to the end of the step, and let the event there happen; returns a status."""
    progress, contact = run.progress, run.contact
    event, which = progress.event, progress.spring
    at_boundary = event != RELEASE and event != MODE_CHANGES and progress.h >= progress.boundary - progress.time
    progress.time = progress.boundary if at_boundary else progress.time + progress.h
    tape = run.tape[progress.step]
    progress.step += 1
    run.tape[progress.step].time = progress.time
    state = run.tape[progress.step].state
    to_release = progress.to_release
    contact.known = 1 if event != MODE_CHANGES and progress.h > 0.0 else 0
    if progress.h > 0.0:
        contact.way, contact.way_across = contact.way_ahead, contact.way_across_ahead
    if event == PUSH_STARTS:
        start_push(which, run)
    elif event == RELEASE:
        switch(run.springs[which], OFF, run)
        release_time[which] = progress.time
        progress.to_release -= 1
        progress.last = progress.step
        keep_event(progress.time, RELEASE, which, OPEN, OPEN, 0.0, run)
    elif event == BOLT_RELEASE:
        element = run.elements[which]
        tape.mode_before = element.mode
        element.mode = GONE
        contact.held -= 1
        progress.last = progress.step
        keep_event(progress.time, BOLT_RELEASE, which, HOLDS, GONE, 0.0, run)
        list_loaded(run)
    elif event == MODE_CHANGES:
        element = run.elements[which]
        tape.value = element.sign if element.mode == SLIPS else element.anchor
        tape.mode_before = change_mode(which, state, run)
        tape.mode = element.mode
        if tape.mode_before == LOADED:
            progress.last = progress.step
            contact.last_contact = progress.time
            contact.last_contact_index = progress.step
        if element.mode == GONE:
            contact.held -= 1
            release_time[element.number] = progress.time
            progress.last = progress.step
        keep_event(
            progress.time, MODE_CHANGES, which, tape.mode_before, element.mode, gap_rate(state, which, run), run
        )  # fmt: skip
        for k in range(3):
            element.after[k] = np.inf
        list_loaded(run)
        # What has begun to act may be stiffer than what was there.
        progress.next_step = first_step(run)
    if progress.to_release == 0 and to_release > 0:
        limit_turns(progress, state)
        contact.pushed_until = progress.time
    return watch(run)


@kernel
def limit_turns(progress, state):
    """When no spring pushes, let no step turn the bodies so far that a touch could be missed."""
    progress.longest_turn = LARGEST_TURN / (1e-3 + norm(state.omega_1) + norm(state.omega_2))


@kernel
def watch(run):
    """Find out whether the bodies can touch no more, or are stuck; returns a status."""
    progress, contact, state = run.progress, run.contact, run.tape[run.progress.step].state
    if not is_under_way(run):
        return OK
    over = progress.to_release == 0 and contact.held == 0
    free = progress.watching > 0 and over and contact.number_loaded == 0
    if free and foot_is_clear(state, run) and rails_are_clear(run):
        progress.watching = 0
        if progress.inside > 0:
            begin_coast(progress, state)
    # The satellite's speed against the platform, at its CG and at its ring.
    omega_1 = vector(state.omega_1)
    turn = minus(times(rotation(state.Q), state.omega_2), omega_1)
    moving = norm(minus(state.w, cross(omega_1, state.d)))
    speed = moving + norm(turn) * run.system.deck.reach
    if progress.to_release == 0 and contact.held > 0:
        late = progress.time - contact.pushed_until > HANG_TIME
        if hangs(state, moving, turn, late, run):
            contact.stuck = 1
    if speed > CALM_SPEED or progress.boundary < progress.horizon:
        contact.calm_since = progress.time
    if speed > 2.0 * SLIDING_SPEED or progress.boundary < progress.horizon:
        contact.still_since = progress.time
    elif progress.time - contact.still_since > STUCK_TIME or progress.time - contact.calm_since > CALM_TIME:
        if not over or contact.number_loaded > 0:
            contact.stuck = 1
        elif speed < 1e-9:
            progress.watching = 0
    if over and progress.time >= progress.horizon and contact.number_loaded == 0 and progress.inside == 0:
        progress.watching = 0
    return OK


@kernel
def hangs(state, moving, turn, late, run):
    """Whether pins hold the satellite when nothing pushes any more, and it has too little energy left to pull them out.

    Or when it is so late that it hangs on them, whatever it does.
    """
    system = run.system
    needed = np.inf
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        if element.mode == HOLDS:
            return False
        if element.mode == STICKS or element.mode == SLIPS:
            spring = run.springs[element.number]
            p = plus(state.d, times(rotation(state.Q), spring.satellite_seat))
            s = dot(spring.guide, minus(p, spring.platform_seat))
            needed = smaller(needed, spring.scale * (spring.release_stroke - s))
    inertia = system.satellite.inertia
    largest = larger(inertia[0], larger(inertia[4], inertia[8]))
    energy = 0.5 * (moving * moving / system.inverse_reduced_mass + largest * dot(turn, turn))
    return late or energy < needed


@kernel
def rails_are_clear(run):
    """Whether every contact of rails is beyond the extent of its surface."""
    clear = True
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        if element.high < np.inf:
            clear = clear and element.mode == OUT
    return clear
