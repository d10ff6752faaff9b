"""Exact derivatives of a run with contact: as `adjoint`, with the events of contacts, bolts and pins.

The force is continuous where a contact begins or ends, and where pins stick or slip: such an event moves with the
inputs without any effect of first order, unless it is the one that the quantities are taken at. Where the force jumps
(a spring or a bolt lets go, pins leave their socket, a loaded point leaves its surface) the formula of `adjoint` holds.
"""

from satsep_ot.dynamics.kernels.adjoint import (
    FORCE_OUTPUT,
    IMPULSE_OUTPUT,
    LAST_CONTACT_OUTPUT,
    STATE_OUTPUT,
    TIME_OUTPUT,
    begin_sweep,
    branch_adjoint,
    end_sweep,
    event_adjoint,
    last_index,
    switch_back,
)
from satsep_ot.dynamics.kernels.compilation import kernel
from satsep_ot.dynamics.kernels.contact import (
    FACE,
    GONE,
    OPEN,
    OUT,
    PINS,
    SLACK,
    SLIPS,
    STICKS,
    add_gap,
    add_point,
    add_satellite_point,
    add_velocity,
    contact_velocity,
    element_adjoint,
    extent_height,
    gap_and_direction,
    gap_rate,
    list_loaded,
    place,
)
from satsep_ot.dynamics.kernels.contact_run import BOLT_RELEASE, MODE_CHANGES
from satsep_ot.dynamics.kernels.contact_setup import elements_adjoint, start_adjoint
from satsep_ot.dynamics.kernels.integration import (
    EIGHTH_ORDER,
    FIRST,
    SECOND,
    copy_state,
    full_step,
    stages,
    step_adjoint,
    step_method,
)
from satsep_ot.dynamics.kernels.records import LANES, STATE_SIZE, Gradients
from satsep_ot.dynamics.kernels.run import NOTHING
from satsep_ot.dynamics.kernels.vectors import (
    ZERO,
    add,
    add_lane,
    add_product,
    clear,
    clear_rows,
    copy,
    dot,
    minus,
    plus,
    rotation,
    rotation_adjoint,
    scaled,
    times,
    vector,
)


@kernel
def sweep_run_with_contact(outputs, final, last, parameters, run, sweep, gradients, angles, feet):
    """Gradients of LANES outputs of a finished run with contact; `final` is the index of the tape's last state."""
    chain = sweep.chain
    begin_sweep(run, sweep)
    for i in range(run.elements.shape[0]):
        element = run.elements[i]
        clear(sweep.elements[i])
        element.mode, element.anchor, element.sign = int(element.final[0]), element.final[1], element.final[2]
    list_loaded(run)
    first = last_index(outputs, last, run)
    for index in range(final, -1, -1):
        counts = index <= first
        if index == last:
            for n in range(LANES):
                if outputs[n].kind == STATE_OUTPUT:
                    chain.state.x[outputs[n].index, n] += 1.0
                elif outputs[n].kind == TIME_OUTPUT:
                    chain.time[n] = 1.0
        ends_contact = index == run.contact.last_contact_index
        for n in range(LANES):
            if ends_contact and outputs[n].kind == LAST_CONTACT_OUTPUT:
                chain.time[n] = 1.0
        if counts:
            branch_adjoint(outputs, index, index, run, sweep)
            if index == run.contact.force_step:
                force_adjoint(outputs, index, run, sweep)
        if index > 0:
            step = index - 1
            tape = run.tape[step]
            if tape.event != NOTHING and (counts or tape.event >= MODE_CHANGES):
                undo(tape, index, run, sweep)
            if counts:
                branch_adjoint(outputs, index, step, run, sweep)
                for n in range(LANES):
                    chain.impulse[n] = 1.0 if outputs[n].kind == IMPULSE_OUTPUT else 0.0
                if tape.event >= MODE_CHANGES:
                    change_adjoint(index, index == last or ends_contact, run, sweep)
                elif tape.event != NOTHING:
                    event_adjoint(index, tape.event, tape.spring, run, sweep)
                if tape.length != 0.0:
                    step_adjoint(tape.method, tape.time, tape.state, tape.length, run, sweep, chain.state)
                for n in range(LANES):
                    chain.impulse[n] = 0.0
    start_adjoint(run, sweep)
    for n in range(LANES):
        elements_adjoint(parameters, run, sweep, angles, feet, n, gradients)
    end_sweep(outputs, parameters, run, sweep, Gradients(gradients.common, gradients.springs, gradients.offsets))


@kernel
def force_adjoint(outputs, index, run, sweep):
    """Add what the largest normal force says, which is reached from tape state `index` by one step.

    Its time does not count: the force does not change there.
    """
    chain, contact, tape, other = sweep.chain, run.contact, run.tape[index], run.step.other
    used = False
    for n in range(LANES):
        used = used or outputs[n].kind == FORCE_OUTPUT
    if not used or contact.force_of < 0:
        return
    method = step_method(contact.force_length, run.progress.short)
    full_step(method, tape.time, tape.state, contact.force_length, run, other)
    clear(chain.derivative)
    clear_rows(chain.rotation)
    clear_rows(chain.force)
    clear_rows(chain.platform_moment)
    clear_rows(chain.satellite_moment)
    for n in range(LANES):
        chain.normal[n] = 1.0 if outputs[n].kind == FORCE_OUTPUT else 0.0
    element_adjoint(other, rotation(other.Q), contact.force_of, run, sweep)
    rotation_adjoint(other.Q, chain.rotation, chain.derivative.Q)
    copy(chain.branch, chain.derivative)
    if contact.force_length != 0.0:
        step_adjoint(method, tape.time, tape.state, contact.force_length, run, sweep, chain.branch)
    add(chain.state, chain.branch)


@kernel
def undo(tape, index, run, sweep):
    """Undo the event of a step."""
    if tape.event < MODE_CHANGES:
        switch_back(tape.event, tape.spring, run, sweep)
        return
    element = run.elements[tape.spring]
    if element.kind == PINS and tape.mode_before == SLIPS and tape.mode == STICKS:
        anchor_adjoint(run.tape[index].state, tape.spring, tape.value, run, sweep)
    element.mode = tape.mode_before
    if tape.mode_before == SLIPS:
        element.sign = tape.value
    elif tape.mode_before == STICKS:
        element.anchor = tape.value
    list_loaded(run)


@kernel
def anchor_adjoint(state, which, sign, run, sweep):
    """Pins stick at the anchor s - sign F / k: pass its adjoint on."""
    element, adjoint = run.elements[which], sweep.elements[which]
    spring, by_spring = run.springs[element.number], sweep.springs[element.number]
    k = element.stiffness
    for n in range(LANES):
        by_spring.scale[n] -= sign * adjoint.anchor[n] / k
        adjoint.stiffness[n] += sign * spring.scale / (k * k) * adjoint.anchor[n]
    pass_stroke(state, which, adjoint.anchor, 1.0, run, sweep)
    for n in range(LANES):
        adjoint.anchor[n] = 0.0


@kernel
def pass_stroke(state, which, by_stroke, factor, run, sweep):
    """Add to the adjoints of the state and of the spring what that of the stroke of pins says."""
    element, chain = run.elements[which], sweep.chain
    spring, by_spring = run.springs[element.number], sweep.springs[element.number]
    R = rotation(state.Q)
    b, n_1 = vector(spring.satellite_seat), vector(spring.guide)
    way = minus(plus(state.d, times(R, b)), spring.platform_seat)
    clear_rows(chain.rotation)
    for n in range(LANES):
        by_s = factor * by_stroke[n]
        by_p = scaled(by_s, n_1)
        add_lane(by_spring.guide, n, scaled(by_s, way))
        add_lane(by_spring.platform_seat, n, scaled(-by_s, n_1))
        add_lane(by_spring.satellite_seat, n, add_satellite_point(R, chain, chain.state, n, by_p, ZERO, b))
    rotation_adjoint(state.Q, chain.rotation, chain.state.Q)


@kernel
def change_adjoint(index, is_last, run, sweep):
    """Correct the adjoints for the length of a step that ends where an element changes its mode, or a bolt lets go."""
    chain, step, tape = sweep.chain, run.step, run.tape[index - 1]
    state, which = run.tape[index].state, tape.spring
    element, adjoint = run.elements[which], sweep.elements[which]
    before, after = tape.mode_before, tape.mode
    leaves = after == OUT or before == OUT
    jumps = (leaves and before != OPEN and after != OPEN) or after == GONE
    if tape.event == MODE_CHANGES and not jumps and not is_last:
        return
    copy_state(state, step.stage[0])
    stages(FIRST, SECOND, EIGHTH_ORDER, run.tape[index].time, 0.0, run)
    slope = step.slope[0]
    along = chain.stroke
    for n in range(LANES):
        along[n] = chain.impulse[n] * run.contact.normal
    for m in range(STATE_SIZE):
        for n in range(LANES):
            along[n] += chain.state.x[m, n] * slope.x[m]
    if tape.event == BOLT_RELEASE:
        for n in range(LANES):
            adjoint.release[n] += chain.time[n] + along[n]
            chain.time[n] = -along[n]
        return
    if element.kind == PINS:
        rate = gap_rate(state, which, run)
        for n in range(LANES):
            along[n] = -(along[n] + chain.time[n]) / rate
            sweep.springs[element.number].release_stroke[n] -= along[n]
        pass_stroke(state, which, along, 1.0, run, sweep)
        return
    R = rotation(state.Q)
    p, arm = place(state, R, element)
    v = contact_velocity(state, R, p, arm)
    _, nu = gap_and_direction(state, R, element, run.system, p, arm)
    speed = dot(nu, v)
    if leaves:
        axis = (0.0, 1.0, 0.0) if element.kind != FACE else (R[1], R[4], R[7])
        rate = dot(axis, v) if element.kind != FACE else -dot(axis, v)
    elif after == SLACK:
        for m in range(STATE_SIZE):
            step.other.x[m] = state.x[m] + 1e-8 * slope.x[m]
        rate = (gap_rate(step.other, which, run) - speed) * 1e8
    else:
        rate = speed
    clear_rows(chain.rotation)
    for n in range(LANES):
        by = -(along[n] + chain.time[n]) / rate
        if leaves:
            extent_adjoint(state, R, element, run.system, adjoint, chain, n, by, arm)
        elif after == SLACK:
            # The bracket 1 - lambda dg/dt is 0: dg/dt = 1 / lambda.
            adjoint.damping[n] += by / (element.damping * element.damping)
            by_v = scaled(by, nu)
            by_nu = scaled(by, v)
            by_p, by_arm = add_gap(
                state, R, element, run.system, chain.constants, adjoint, chain, n, 0.0, by_nu, p, arm
            )  # fmt: skip
            by_q, by_a = add_velocity(state, R, chain, chain.state, n, by_v, p, arm)
            add_point(state, R, element, adjoint, chain, chain.state, n, plus(by_p, by_q), plus(by_arm, by_a))
        else:
            by_p, by_arm = add_gap(
                state, R, element, run.system, chain.constants, adjoint, chain, n, by, ZERO, p, arm
            )  # fmt: skip
            add_point(state, R, element, adjoint, chain, chain.state, n, by_p, by_arm)
    rotation_adjoint(state.Q, chain.rotation, chain.state.Q)


@kernel
def extent_adjoint(state, R, element, system, adjoint, chain, n, by, arm):
    """Add what the height of a point over the end of a surface says: y less the limit that it crosses."""
    y_axis = (0.0, 1.0, 0.0)
    if element.kind == FACE:
        by_arm = scaled(by, (R[1], R[4], R[7]))
        add_product(chain.rotation, n, arm, (0.0, by, 0.0))
        chain.constants.satellite.center_of_mass[1, n] += by
        y = extent_height(state, R, element, system, vector(element.point), arm)
        if 2.0 * y < element.low + element.high:
            adjoint.low[n] -= by
        else:
            adjoint.high[n] -= by
        add_point(state, R, element, adjoint, chain, chain.state, n, ZERO, by_arm)
    else:
        chain.constants.platform.center_of_mass[1, n] += by
        adjoint.high[n] -= by
        add_point(state, R, element, adjoint, chain, chain.state, n, scaled(by, y_axis), ZERO)
