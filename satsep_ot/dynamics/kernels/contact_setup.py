"""From the parameters of a run with contact to its elements; and back, for their adjoints."""

import math

import numpy as np

from satsep_ot.dynamics.kernels.compilation import inline, kernel, larger, smaller
from satsep_ot.dynamics.kernels.contact import (
    BOLT,
    CURVED,
    DECK,
    HOLD_DOWN,
    HOLDS,
    LOADED,
    OPEN,
    OUT,
    PINS,
    RAIL_END,
    RAIL_MOUTH,
    RECESS,
    STICKS,
    add_gap,
    add_satellite_point,
    contact_mode,
    extent_height,
    gap_and_direction,
    gap_rate,
    list_loaded,
    place,
)
from satsep_ot.dynamics.kernels.integration import EIGHTH_ORDER, FIRST, SECOND, copy_state, stages
from satsep_ot.dynamics.kernels.records import LANES, STATE_SIZE
from satsep_ot.dynamics.kernels.vectors import (
    ZERO,
    add_lane,
    clear_rows,
    dot,
    lane,
    minus,
    plus,
    put,
    rotation,
    rotation_adjoint,
    scaled,
    times,
    vector,
)

PIN_DAMPING_TIME = 1e-4  # of pins that stick, T [s]
TOUCHES = 1e-12  # gap [m] and its rate [m/s] that are none


@kernel
def hunt_crossley_damping(restitution, speed):
    """lambda [s/m] for a coefficient of restitution e at an impact speed, and its derivatives with respect to both.

    u = lambda speed solves -e u - ln(1 - e u) = u - ln(1 + u).
    """
    e = restitution
    if e >= 1.0:
        return 0.0, -1.5 / speed, 0.0
    low = 0.0
    high = 1.0 / e
    # The root for a restitution near 1; Newton's method, held between its bounds.
    u = smaller(1.5 * (1.0 - e * e) / (1.0 + e * e * e), 0.5 * high)
    for _ in range(200):
        rest = 1.0 - e * u
        value = -e * u - math.log(rest) - u + math.log(1.0 + u)
        if value > 0.0:
            high = u
        else:
            low = u
        slope = e * e * u / rest - u / (1.0 + u)
        following = u - value / slope if slope > 0.0 else low
        if not low < following < high:
            following = 0.5 * (low + high)
        change = following - u
        u = following
        if abs(change) <= 1e-15 * u:
            break
    rest = larger(1.0 - e * u, 1e-300)
    by_u = e * e * u / rest - u / (1.0 + u)
    by_e = e * u * u / rest
    slope = -by_e / by_u if by_u != 0.0 else -1.5
    return u / speed, slope / speed, -u / (speed * speed)


@inline
def damping_of(given):
    """lambda of the contacts of a part of the parameters; 0 where there is none."""
    if given.shape[0] == 0:
        return 0.0
    lam, _, _ = hunt_crossley_damping(given[0].restitution, given[0].impact_speed)
    return lam + given[0].damping


@inline
def set_law(element, given, damping):
    """Stiffness, damping and friction of a contact."""
    element.stiffness = given.stiffness
    element.damping = damping
    element.friction = given.friction
    element.sliding = given.sliding_speed


@inline
def on_ring(angle, radius):
    """A place on the ring's plane from its centre."""
    return radius * math.cos(angle), 0.0, radius * math.sin(angle)


@kernel
def set_element(parameters, element, run, angles, feet, contact_damping, rail_damping):
    """Fill the numbers of an element from the parameters; its kind, group and number are there."""
    c_1, c_2 = parameters.common.platform.center_of_mass, parameters.common.satellite.center_of_mass
    l_0 = parameters.common.stowed_length
    group, number = element.group, element.number
    element.low, element.high, element.start = -np.inf, np.inf, 0.0
    if group == DECK:
        given = parameters.contact[0]
        foot = vector(feet[number]) if feet.shape[0] > 0 else on_ring(angles[number], given.radius)
        put(element.point, minus(foot, c_2))
        element.level = given.level + l_0 - c_1[1]
        set_law(element, given, contact_damping)
    elif group == RECESS:
        put(element.point, minus(run.points[number].place, c_2))
        element.high = parameters.common.recess_depth
        if element.kind == CURVED:
            element.level = parameters.common.recess_radius
        else:
            element.level = parameters.offsets[element.wall] - dot(element.normal, c_1)
        set_law(element, parameters.contact[0], contact_damping)
    elif group == RAIL_END:
        given = parameters.rails[0]
        x, end, z = vector(element.other)
        w = given.half_width
        put(element.point, minus((x * w, given.satellite[1] if end > 0.0 else given.satellite[0], z * w), c_2))
        element.level = -w - given.clearance - dot(element.normal, c_1)
        element.high = given.mouth
        set_law(element, given, rail_damping)
    elif group == RAIL_MOUTH:
        given = parameters.rails[0]
        x, _, z = vector(element.other)
        w = given.half_width + given.clearance
        put(element.point, minus((x * w, given.mouth, z * w), c_1))
        element.level = given.half_width - dot(element.normal, c_2)
        element.low, element.high = given.satellite[0], given.satellite[1]
        set_law(element, given, rail_damping)
    elif group == HOLD_DOWN:
        given = parameters.hold_downs[number]
        put(element.point, minus(on_ring(given.angle, given.radius), c_2))
        element.stiffness = given.stiffness
        reduced = 1.0 / run.system.inverse_reduced_mass
        element.damping = given.damping_time + 2.0 * given.damping_ratio * math.sqrt(reduced / given.stiffness)
        element.release = given.release
    else:
        element.stiffness = parameters.springs[number].stiffness
        element.damping = PIN_DAMPING_TIME


@kernel
def set_elements(parameters, run, angles, feet):
    """Fill all elements, and let begin those that act at t = 0."""
    contact, state = run.contact, run.tape[0].state
    contact.number_loaded = 0
    contact.held = 0
    R = rotation(state.Q)
    stiffest = 0.0
    contact_damping, rail_damping = damping_of(parameters.contact), damping_of(parameters.rails)
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        set_element(parameters, element, run, angles, feet, contact_damping, rail_damping)
        if element.kind == PINS:
            spring = run.springs[element.number]
            p = plus(state.d, times(R, spring.satellite_seat))
            element.anchor = dot(spring.guide, minus(p, spring.platform_seat))
            element.mode = STICKS
            contact.held += 1
        elif element.kind == BOLT:
            # The bodies were bolted as they are mounted.
            p, _ = place(state, R, element)
            put(element.other, p)
            element.mode = HOLDS
            contact.held += 1
        else:
            start_contact(state, R, element, run)
        stiffest = larger(stiffest, element.stiffness)
    begin_touching(run)
    list_loaded(run)
    set_frequency(run, stiffest)


@kernel
def start_contact(state, R, element, run):
    """The mode of a contact at t = 0 by its gap; what touches is OPEN for the time being."""
    p, arm = place(state, R, element)
    gap, _ = gap_and_direction(state, R, element, run.system, p, arm)
    if element.group == DECK or element.group == RECESS:
        # The surfaces were matched on the ground.
        element.start = smaller(gap, 0.0)
        gap -= element.start
    y = extent_height(state, R, element, run.system, p, arm)
    if not element.low < y < element.high:
        element.mode = OUT
    elif gap < -TOUCHES:
        element.mode = contact_mode(state, R, element, run.system)
    else:
        element.mode = OPEN


@kernel
def begin_touching(run):
    """Load what touches at t = 0 and is being closed, by its speed or by what pushes then."""
    step, state = run.step, run.tape[0].state
    copy_state(state, step.stage[0])
    stages(FIRST, SECOND, EIGHTH_ORDER, 0.0, 0.0, run)
    for n in range(STATE_SIZE):
        step.other.x[n] = state.x[n] + 1e-6 * step.slope[0].x[n]
    R = rotation(state.Q)
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        if element.mode == OPEN:
            p, arm = place(state, R, element)
            gap, _ = gap_and_direction(state, R, element, run.system, p, arm)
            if gap < TOUCHES:
                rate = gap_rate(state, i, run)
                later = gap_rate(step.other, i, run)
                if rate < -TOUCHES or (rate < TOUCHES and later - rate < -TOUCHES):
                    element.mode = LOADED


@kernel
def set_frequency(run, stiffest):
    """Upper estimates of the fastest frequency with contact, for the lengths of steps."""
    system, progress = run.system, run.progress
    arm_1 = 0.0
    arm_2 = 0.0
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        if element.kind != PINS:
            square = dot(element.point, element.point)
            if element.group == RAIL_MOUTH:
                arm_1 = larger(arm_1, square)
            else:
                arm_2 = larger(arm_2, square)
    run.contact.satellite_reach, run.contact.platform_reach = math.sqrt(arm_2), math.sqrt(arm_1)
    inverse = system.satellite.inverse_inertia
    lever = system.inverse_reduced_mass + arm_2 * larger(inverse[0], larger(inverse[4], inverse[8]))
    inverse = system.platform.inverse_inertia
    lever += arm_1 * larger(inverse[0], larger(inverse[4], inverse[8]))
    run.contact.frequency = math.sqrt(stiffest * lever)
    run.contact.free_frequency = progress.frequency
    progress.frequency = larger(progress.frequency, run.contact.frequency)


@inline
def law_adjoint(adjoint, n, out):
    """Add what a contact's law says to the gradient of its parameters."""
    out.stiffness += adjoint.stiffness[n]
    out.damping += adjoint.damping[n]
    out.friction += adjoint.friction[n]
    out.sliding_speed += adjoint.sliding[n]


@inline
def ring_adjoint(angle, radius, by_place):
    """From the adjoint of a place on the ring to those of its angle and its radius."""
    cosine, sine = math.cos(angle), math.sin(angle)
    return radius * (cosine * by_place[2] - sine * by_place[0]), cosine * by_place[0] + sine * by_place[2]


@inline
def damping_adjoint(given, n, gradient):
    """From the gradient of lambda to those of restitution and impact speed."""
    if given.shape[0] > 0:
        _, by_e, by_speed = hunt_crossley_damping(given[0].restitution, given[0].impact_speed)
        gradient[n, 0].restitution = by_e * gradient[n, 0].damping
        gradient[n, 0].impact_speed = by_speed * gradient[n, 0].damping


@kernel
def elements_adjoint(parameters, run, sweep, angles, feet, n, gradient):
    """From lane n of the adjoints of the elements to the gradients of their parameters and the run's constants."""
    constants = sweep.chain.constants
    by_c_1, by_c_2 = constants.platform.center_of_mass, constants.satellite.center_of_mass
    clear_gradient(gradient.contact, n)
    clear_gradient(gradient.rails, n)
    clear_gradient(gradient.hold_downs, n)
    for i in range(run.elements.shape[0]):
        element, adjoint = run.elements[i], sweep.elements[i]
        group, number = element.group, element.number
        by_point, by_level = lane(adjoint.point, n), adjoint.level[n]
        if group == DECK:
            given, out = parameters.contact[0], gradient.contact[n, 0]
            if feet.shape[0] == 0:
                _, by_radius = ring_adjoint(angles[number], given.radius, by_point)
                out.radius += by_radius
            add_lane(by_c_2, n, scaled(-1.0, by_point))
            out.level += by_level
            constants.stowed_length[n] += by_level
            by_c_1[1, n] -= by_level
            law_adjoint(adjoint, n, out)
        elif group == RECESS:
            add_lane(by_c_2, n, scaled(-1.0, by_point))
            constants.recess_depth[n] += adjoint.high[n]
            if element.kind == CURVED:
                constants.recess_radius[n] += by_level
            else:
                sweep.offsets[element.wall, n] += by_level
                add_lane(by_c_1, n, scaled(-by_level, vector(element.normal)))
            law_adjoint(adjoint, n, gradient.contact[n, 0])
        elif group == RAIL_END:
            given, out = parameters.rails[0], gradient.rails[n, 0]
            x, end, z = vector(element.other)
            add_lane(by_c_2, n, scaled(-1.0, by_point))
            out.half_width += x * by_point[0] + z * by_point[2] - by_level
            out.clearance -= by_level
            out.satellite[1 if end > 0.0 else 0] += by_point[1]
            add_lane(by_c_1, n, scaled(-by_level, vector(element.normal)))
            out.mouth += adjoint.high[n]
            law_adjoint(adjoint, n, out)
        elif group == RAIL_MOUTH:
            given, out = parameters.rails[0], gradient.rails[n, 0]
            x, _, z = vector(element.other)
            across = x * by_point[0] + z * by_point[2]
            add_lane(by_c_1, n, scaled(-1.0, by_point))
            out.half_width += across + by_level
            out.clearance += across
            out.mouth += by_point[1]
            add_lane(by_c_2, n, scaled(-by_level, vector(element.normal)))
            out.satellite[0] += adjoint.low[n]
            out.satellite[1] += adjoint.high[n]
            law_adjoint(adjoint, n, out)
        elif group == HOLD_DOWN:
            given, out = parameters.hold_downs[number], gradient.hold_downs[n, number]
            add_lane(by_c_2, n, scaled(-1.0, by_point))
            by_angle, by_radius = ring_adjoint(given.angle, given.radius, by_point)
            out.angle += by_angle
            out.radius += by_radius
            out.release += adjoint.release[n]
            by_T = adjoint.damping[n]
            out.damping_time += by_T
            root = math.sqrt(1.0 / (run.system.inverse_reduced_mass * given.stiffness))
            out.damping_ratio += 2.0 * root * by_T
            out.stiffness += adjoint.stiffness[n] - given.damping_ratio * root / given.stiffness * by_T
            constants.inverse_reduced_mass[n] -= given.damping_ratio * root / run.system.inverse_reduced_mass * by_T
        else:
            sweep.springs[number].stiffness[n] += adjoint.stiffness[n]
    damping_adjoint(parameters.contact, n, gradient.contact)
    damping_adjoint(parameters.rails, n, gradient.rails)


@kernel
def clear_gradient(rows, n):
    """Set the gradients of a part of the parameters to 0."""
    for i in range(rows.shape[1]):
        for m in range(rows[n, i].x.shape[0]):
            rows[n, i].x[m] = 0.0


@kernel
def start_adjoint(run, sweep):
    """Add what the elements' start says of the initial state: where bolts hold, anchors, gaps below 0."""
    chain, state = sweep.chain, run.tape[0].state
    R = rotation(state.Q)
    clear_rows(chain.rotation)
    for i in range(run.elements.shape[0]):
        element, adjoint = run.elements[i], sweep.elements[i]
        for n in range(LANES):
            if element.kind == BOLT:
                # The place on the platform is that of the satellite's point at t = 0.
                by_other = lane(adjoint.other, n)
                b = vector(element.point)
                add_lane(adjoint.point, n, add_satellite_point(R, chain, chain.state, n, by_other, ZERO, b))
            elif element.kind == PINS:
                spring, by_spring = run.springs[element.number], sweep.springs[element.number]
                by_way = scaled(adjoint.anchor[n], vector(spring.guide))
                b = vector(spring.satellite_seat)
                p = plus(state.d, times(R, b))
                add_lane(by_spring.platform_seat, n, scaled(-1.0, by_way))
                add_lane(by_spring.guide, n, scaled(adjoint.anchor[n], minus(p, spring.platform_seat)))
                add_lane(by_spring.satellite_seat, n, add_satellite_point(R, chain, chain.state, n, by_way, ZERO, b))
            elif element.start < 0.0:
                # Its gap counts from that at the start, g - g(0): the adjoint of the level is less that of the gap.
                by_gap = -adjoint.level[n] if element.kind == CURVED else adjoint.level[n]
                p, arm = place(state, R, element)
                by_p, _ = add_gap(
                    state, R, element, run.system, chain.constants, adjoint, chain, n, by_gap, ZERO, p, arm
                )  # fmt: skip
                b = vector(element.point)
                add_lane(adjoint.point, n, add_satellite_point(R, chain, chain.state, n, by_p, ZERO, b))
    rotation_adjoint(state.Q, chain.rotation, chain.state.Q)
