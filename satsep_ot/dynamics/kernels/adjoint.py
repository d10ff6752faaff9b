"""Exact derivatives of a run by the reverse mode: the tape of steps is walked backwards, with eight outputs at a time.

A step is differentiated as it was taken (a discrete adjoint, step lengths frozen). The length of a step that ends in
an event is not frozen: it follows from the event's condition, so a release or an exit moves with the inputs. With
phi(x) = 0 the condition, f the slope there and lambda the adjoint of the state at the event,

    lambda* = lambda - phi_x (lambda . f + mu) / (phi_x . f)

is the adjoint of the step's end at frozen length, mu the adjoint of the event's time. The state is continuous across a
release although the force jumps, so nothing else is needed. Sources: Galan, Feehery, Barton, "Parametric sensitivity
functions for hybrid discrete/continuous systems", Applied Numerical Mathematics 31 (1999); Hairer, Norsett, Wanner
(1993), section II.6.
"""

from satsep_ot.dynamics.kernels.compilation import integers, kernel
from satsep_ot.dynamics.kernels.constants import (
    constants_adjoint,
    initial_state_adjoint,
    mounting_error_adjoint,
)
from satsep_ot.dynamics.kernels.contact import sum_of_normal_forces
from satsep_ot.dynamics.kernels.deck import deck_height_adjoint, starts_below
from satsep_ot.dynamics.kernels.envelope import AT_EXIT, AT_START, INSIDE, clearance_adjoint
from satsep_ot.dynamics.kernels.integration import (
    EIGHTH_ORDER,
    FIRST,
    SECOND,
    copy_state,
    full_step,
    stages,
    step_adjoint,
)
from satsep_ot.dynamics.kernels.records import LANES, STATE_SIZE, Gradients
from satsep_ot.dynamics.kernels.run import NOTHING, PUSH_STARTS, RELEASE
from satsep_ot.dynamics.kernels.springs import (
    OFF,
    ON,
    clear_sums,
    collect_sums,
    place_on_tables,
    stroke_adjoint,
    stroke_motion,
    switch,
)
from satsep_ot.dynamics.kernels.vectors import add, clear, clear_rows, rotation, rotation_adjoint

# Which number of a run is differentiated: one of the state at the last release, its time, the smallest clearance, the
# clearance of one point at its exit, the smallest height over the deck; or none.
STATE_OUTPUT, TIME_OUTPUT, CLEARANCE_OUTPUT, EXIT_OUTPUT, NO_OUTPUT, DECK_OUTPUT = integers(0, 1, 2, 3, 4, 5)
# Of a run with contact: the impulse of the normal forces, the largest one, the end of the last contact.
IMPULSE_OUTPUT, FORCE_OUTPUT, LAST_CONTACT_OUTPUT = integers(6, 7, 8)


@kernel
def sweep_run(outputs, last, parameters, run, sweep, gradients):
    """Gradients of LANES outputs (records OUTPUT) of a finished run with respect to its parameters, into `gradients`.

    `last` is the index of the tape's state at the last release. What pushes in `run` is walked back.
    """
    chain = sweep.chain
    begin_sweep(run, sweep)
    for index in range(last_index(outputs, last, run), -1, -1):
        if index == last:
            for n in range(LANES):
                if outputs[n].kind == STATE_OUTPUT:
                    chain.state.x[outputs[n].index, n] += 1.0
                elif outputs[n].kind == TIME_OUTPUT:
                    chain.time[n] = 1.0
        # First what is reached from here within the step that starts here, then within the one that ends here: its
        # event lies between the two.
        if run.cubics.shape[0] > 0:
            place_on_tables(run.tape[index].state, run)
        branch_adjoint(outputs, index, index, run, sweep)
        if index > 0:
            step = index - 1
            event = run.tape[step].event
            if event != NOTHING:
                switch_back(event, run.tape[step].spring, run, sweep)
            if run.cubics.shape[0] > 0:
                place_on_tables(run.tape[step].state, run)
            branch_adjoint(outputs, index, step, run, sweep)
            if event != NOTHING:
                event_adjoint(index, event, run.tape[step].spring, run, sweep)
            tape = run.tape[step]
            if tape.length != 0.0:
                step_adjoint(tape.method, tape.time, tape.state, tape.length, run, sweep, chain.state)
    end_sweep(outputs, parameters, run, sweep, gradients)


@kernel
def last_index(outputs, last, run):
    """Index of the last state of the tape that matters: steps behind the last release matter to exits and heights."""
    for n in range(LANES):
        if outputs[n].kind == DECK_OUTPUT and run.system.deck.step > last:
            last = run.system.deck.step
    for i in range(run.points.shape[0]):
        if run.points[i].exit_base > last:
            last = run.points[i].exit_base
    return last


@kernel
def begin_sweep(run, sweep):
    """All adjoints are 0, and no spring pushes."""
    chain = sweep.chain
    clear(chain.state)
    clear(chain.constants)
    for n in range(LANES):
        chain.time[n] = 0.0
        chain.impulse[n] = 0.0
    for i in range(run.springs.shape[0]):
        clear(sweep.springs[i])
        run.springs[i].is_pushing = OFF
    clear_rows(sweep.offsets)
    clear_sums(run.system)
    run.system.number_beside = 0


@kernel
def branch_adjoint(outputs, index, step, run, sweep):
    """Add, at tape state `index`, the clearances that are reached from there by one step within step `step`."""
    chain, closest, tape = sweep.chain, run.system.closest, run.tape[index]
    for i in range(run.points.shape[0]):
        point = run.points[i]
        if point.exit_step == step and point.exit_base == index:
            used = False
            # A step of no length: the point was out from the start on, and its time does not move.
            kind = AT_EXIT if point.exit_length != 0.0 else INSIDE
            is_closest = closest.kind == AT_EXIT and closest.point == i
            for n in range(LANES):
                output = outputs[n]
                is_exit = output.kind == EXIT_OUTPUT and output.index == i
                if is_exit or (output.kind == CLEARANCE_OUTPUT and is_closest):
                    if not used:
                        clear(chain.branch)
                    used = True
                    clearance_adjoint(point.exit_state, i, n, kind, run, sweep, chain.branch)
            if used:
                step_adjoint(point.exit_method, tape.time, tape.state, point.exit_length, run, sweep, chain.branch)
                add(chain.state, chain.branch)
    if run.points.shape[0] > 0 and closest.kind == INSIDE and closest.step == step and index == step:
        used = False
        for n in range(LANES):
            if outputs[n].kind == CLEARANCE_OUTPUT:
                if not used:
                    clear(chain.branch)
                used = True
                clearance_adjoint(closest.state, closest.point, n, INSIDE, run, sweep, chain.branch)
        if used:
            step_adjoint(EIGHTH_ORDER, tape.time, tape.state, closest.length, run, sweep, chain.branch)
            add(chain.state, chain.branch)
    deck = run.system.deck
    if deck.step == step and index == step and deck.length != 0.0:
        used = False
        for n in range(LANES):
            if outputs[n].kind == DECK_OUTPUT:
                if not used:
                    clear(chain.branch)
                    full_step(deck.method, tape.time, tape.state, deck.length, run, run.step.other)
                used = True
                deck_height_adjoint(run.step.other, n, 1.0, run, sweep, chain.branch)
        if used:
            step_adjoint(deck.method, tape.time, tape.state, deck.length, run, sweep, chain.branch)
            add(chain.state, chain.branch)


@kernel
def event_adjoint(index, event, which, run, sweep):
    """Correct the adjoints at tape state `index` for the length of the step before it, which its event decides."""
    chain, step, state = sweep.chain, run.step, run.tape[index].state
    spring, by_spring = run.springs[which], sweep.springs[which]
    copy_state(state, step.stage[0])
    stages(FIRST, SECOND, EIGHTH_ORDER, run.tape[index].time, 0.0, run)
    # lambda . f
    along = chain.stroke
    for n in range(LANES):
        along[n] = chain.impulse[n] * sum_of_normal_forces(run)
    for m in range(STATE_SIZE):
        for n in range(LANES):
            along[n] += chain.state.x[m, n] * step.slope[0].x[m]
    if event == PUSH_STARTS:
        # The step's end is the delay itself.
        for n in range(LANES):
            by_spring.delay[n] += chain.time[n] + along[n]
            chain.time[n] = -along[n]
        return
    _, rate, _ = stroke_motion(step.stage[0], step.slope[0], run.system, spring)
    clear_rows(chain.spring_force)
    clear_rows(chain.point)
    for n in range(LANES):
        chain.stroke[n] = -(along[n] + chain.time[n]) / rate
        by_spring.release_stroke[n] -= chain.stroke[n]
    clear_rows(chain.rotation)
    stroke_adjoint(state, rotation(state.Q), spring, 0.0, 0.0, run, sweep, chain.state, by_spring)
    rotation_adjoint(state.Q, chain.rotation, chain.state.Q)


@kernel
def switch_back(event, which, run, sweep):
    """Undo an event for the springs; before the first push nothing holds back either."""
    if event == RELEASE:
        collect_sums(which, -1.0, run, sweep)
        switch(run.springs[which], ON, run)
        return
    pushing = False
    for i in range(run.springs.shape[0]):
        pushing = pushing or (i != which and run.springs[i].is_pushing and not run.springs[i].holds_back)
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        if i == which or (not pushing and spring.is_pushing and spring.holds_back):
            collect_sums(i, 1.0, run, sweep)
            switch(spring, OFF, run)


@kernel
def end_sweep(outputs, parameters, run, sweep, gradients):
    """From the adjoints of the initial state and of the constants to those of the parameters."""
    chain, closest, state = sweep.chain, run.system.closest, run.tape[0].state
    if run.points.shape[0] > 0 and closest.kind == AT_START:
        for n in range(LANES):
            if outputs[n].kind == CLEARANCE_OUTPUT:
                clearance_adjoint(state, closest.point, n, INSIDE, run, sweep, chain.state)
    # The height counts from that at the start where this is below the deck, and may be that at the start.
    factor = 1.0 if run.system.deck.length == 0.0 else 0.0
    factor -= 1.0 if starts_below(run) else 0.0
    for n in range(LANES):
        if outputs[n].kind == DECK_OUTPUT and factor != 0.0:
            deck_height_adjoint(state, n, factor, run, sweep, chain.state)
    for i in range(run.springs.shape[0]):
        if run.springs[i].is_pushing:
            collect_sums(i, 1.0, run, sweep)
    for n in range(LANES):
        for k in range(gradients.common[n].x.shape[0]):
            gradients.common[n].x[k] = 0.0
        initial_state_adjoint(parameters, run, sweep, n, gradients.common[n])
    rotation_adjoint(state.Q, chain.rotation, chain.state.Q)
    for n in range(LANES):
        gradient = Gradients(gradients.common[n], gradients.springs[n], gradients.offsets[n])
        mounting_error_adjoint(parameters.common, chain.state.Q, n, gradient.common)
        constants_adjoint(parameters, run, sweep, n, gradient)
