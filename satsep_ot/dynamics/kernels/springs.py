"""The springs of a run: which of them push, what they do to the bodies, and how their strokes go on.

With the guide n of a guided spring, its satellite seat b, its platform seat a, and d and R of the state, the stroke
s = n . (d + R b - a) is linear in (1, d, R). So is the force f = f_0 + f_1 s of a law that is linear in the stroke:
the product of the column (f_0 - f_1 n . a, f_1 n, f_1 n b^T) with (1, d, R). The sums of f n and f n b^T, the rows
(n, n b^T), give every force and moment. One matrix, the sum of column times row, makes the right-hand side independent
of the number of springs. The force of any other spring is computed by itself.
"""

import numpy as np

from satsep_ot.dynamics.kernels.compilation import inline, integers, kernel
from satsep_ot.dynamics.kernels.force_laws import cubic_at, force
from satsep_ot.dynamics.kernels.force_lines import contact, contact_adjoint
from satsep_ot.dynamics.kernels.records import LANES, SUM_COLUMNS, SUM_ROWS
from satsep_ot.dynamics.kernels.vectors import (
    ZERO,
    add_lane,
    add_product,
    add_rows,
    add_scaled,
    clear,
    copy,
    cross,
    dot,
    lane,
    minus,
    plus,
    put_lane,
    rotation,
    scaled,
    times,
    transposed_times,
    vector,
)

KNOT_DISTANCE = 1e-10  # from where on a stroke is at a knot of its table [m]

OFF, ON = integers(0, 1)
# Where the columns of d and of the rows of R start, and the rows of a matrix.
COLUMNS, ROWS = integers(1, 4, 7, 10), integers(0, 3, 6)


@kernel
def row_and_column(spring, cubics, scratch):
    """What a guided spring adds to the sums, as a row and a column of `scratch`: a record of the step or the chain."""
    f_0, f_1, _, _ = force(spring, cubics, 0.0)
    f_0 *= spring.scale
    f_1 *= spring.scale
    scratch.column[0] = f_0 - f_1 * dot(spring.guide, spring.platform_seat)
    for n in range(3):
        direction = spring.guide[n]
        scratch.row[n] = direction
        scratch.column[1 + n] = f_1 * direction
        for m in range(3):
            entry = direction * spring.satellite_seat[m]
            scratch.row[3 + 3 * n + m] = entry
            scratch.column[4 + 3 * n + m] = f_1 * entry


@kernel
def clear_sums(system):
    """No spring is in the sums: exactly nothing is left of those that were."""
    system.number_in_sums = 0
    for j in range(SUM_COLUMNS):
        for n in range(SUM_ROWS):
            system.sums[j, n] = 0.0


@kernel
def switch(spring, on, run):
    """Let a spring push, or no longer."""
    system = run.system
    sign = 2 * on - 1
    spring.is_pushing = on
    if not spring.in_sums:
        system.number_beside += sign
        return
    system.number_in_sums += sign
    if system.number_in_sums == 0:
        clear_sums(system)
        return
    row_and_column(spring, run.cubics, run.step)
    for j in range(SUM_COLUMNS):
        factor = sign * run.step.column[j]
        for n in range(SUM_ROWS):
            system.sums[j, n] += factor * run.step.row[n]


@kernel
def start_push(which, run):
    """Let a spring push; what holds back acts from the first push on."""
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        if i == which or (spring.holds_back and spring.is_pending):
            spring.is_pending = 0
            switch(spring, ON, run)


@kernel
def start_springs(run, release_time):
    """Which springs push at t = 0; returns how many are to be released and how many push.

    A scale of 0 is a spring that has failed: it takes no part.
    """
    number = 0
    pushers = 0
    clear_sums(run.system)
    run.system.number_beside = 0
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        release_time[i] = np.nan
        spring.is_pushing = 0
        spring.is_pending = 0
        if spring.scale > 0.0:
            number += 1
            spring.is_pending = 1
            if spring.holds_back:
                # Never the next push to start: it follows the first one.
                spring.delay = np.inf
            else:
                pushers += 1
    for i in range(run.springs.shape[0]):
        if run.springs[i].is_pending and run.springs[i].delay <= 0.0:
            start_push(i, run)
    return number, pushers


@inline
def guided_forces(state, R, system):
    """Force and moments of the springs in the sums, as `spring_forces` has them; fills `system.forces`."""
    d, forces = vector(state.d), system.forces
    for n in range(SUM_ROWS):
        forces[n] = (
            system.sums[0, n]
            + system.sums[1, n] * d[0]
            + system.sums[2, n] * d[1]
            + system.sums[3, n] * d[2]
            + system.sums[4, n] * R[0]
            + system.sums[5, n] * R[1]
            + system.sums[6, n] * R[2]
            + system.sums[7, n] * R[3]
            + system.sums[8, n] * R[4]
            + system.sums[9, n] * R[5]
            + system.sums[10, n] * R[6]
            + system.sums[11, n] * R[7]
            + system.sums[12, n] * R[8]
        )
    F = (forces[0], forces[1], forces[2])
    # The sum of f n b^T by its rows; with those of R it gives the sum of (R b) x f n.
    x, y, z = (forces[3], forces[4], forces[5]), (forces[6], forces[7], forces[8]), (forces[9], forces[10], forces[11])
    u, v, w = (R[0], R[1], R[2]), (R[3], R[4], R[5]), (R[6], R[7], R[8])
    M_2 = (dot(v, z) - dot(w, y), dot(w, x) - dot(u, z), dot(u, y) - dot(v, x))
    return F, M_2, minus(cross(F, d), M_2)


@inline
def spring_forces(state, R, run):
    """The springs' force on the satellite, its moment about the satellite's CG, and the moment on the platform.

    All in platform axes.
    """
    system = run.system
    F, M_2, M_1 = ZERO, ZERO, ZERO
    if system.number_in_sums > 0:
        F, M_2, M_1 = guided_forces(state, R, system)
    if system.number_beside > 0:
        d = vector(state.d)
        n_2 = (R[1], R[4], R[7])
        for i in range(run.springs.shape[0]):
            spring = run.springs[i]
            if spring.is_pushing and not spring.in_sums:
                delta = minus(plus(d, times(R, spring.satellite_seat)), spring.platform_seat)
                s, g, point, share = contact(system, spring, delta, n_2)
                f, _, _, _ = force(spring, run.cubics, s)
                F_i = scaled(spring.scale * share * f, g)
                p = plus(spring.platform_seat, point)
                F = plus(F, F_i)
                M_2 = plus(M_2, cross(minus(p, d), F_i))
                M_1 = minus(M_1, cross(p, F_i))
    return F, M_2, M_1


@inline
def stroke_motion(state, slope, system, spring):
    """Stroke of a spring in a state with a slope, its rate, and its acceleration.

    That is up to the terms of second order in the rates: for prediction.
    """
    R = rotation(state.Q)
    delta = minus(plus(state.d, times(R, spring.satellite_seat)), spring.platform_seat)
    s, g, point, _ = contact(system, spring, delta, (R[1], R[4], R[7]))
    # Velocity of the satellite's material point at the contact in platform axes, with its arms from both CGs.
    p = plus(spring.platform_seat, point)
    arm = minus(p, state.d)
    rate = dot(g, minus(plus(state.w, cross(times(R, state.omega_2), arm)), cross(state.omega_1, p)))
    acceleration = dot(g, minus(plus(slope.w, cross(times(R, slope.omega_2), arm)), cross(slope.omega_1, p)))
    return s, rate, acceleration


@kernel
def place_on_tables(state, run):
    """For each spring with a table the cubic that holds in the step that starts at a state.

    No step crosses a knot, and at a knot the stroke alone does not tell on which side the step lies.
    """
    for i in range(run.springs.shape[0]):
        spring = run.springs[i]
        if spring.is_pushing and spring.has_table:
            s, rate, _ = stroke_motion(state, state, run.system, spring)
            ahead = KNOT_DISTANCE if rate >= 0.0 else -KNOT_DISTANCE
            spring.cubic = cubic_at(spring, run.cubics, s + ahead)


@kernel
def stroke_adjoint(state, R, spring, f, slope, run, sweep, by_state, by_spring):
    """From the adjoints of a spring's force, contact point and stroke to those of all that they depend on.

    f is its force with the scale, `slope` the derivative. That of the matrix R is added to `sweep.chain.rotation`.
    """
    chain = sweep.chain
    b = vector(spring.satellite_seat)
    delta = minus(plus(state.d, times(R, b)), spring.platform_seat)
    contact_adjoint(run.system, spring, delta, (R[1], R[4], R[7]), f, slope, chain)
    for n in range(LANES):
        by_seat = lane(chain.seat, n)
        put_lane(chain.spring.satellite_seat, n, transposed_times(R, by_seat))
        add_product(chain.rotation, n, by_seat, b)
        chain.rotation[1, n] += chain.plate[0, n]
        chain.rotation[4, n] += chain.plate[1, n]
        chain.rotation[7, n] += chain.plate[2, n]
    add_rows(by_state.d, chain.seat)
    add_rows(by_spring.platform_seat, chain.spring.platform_seat)
    add_rows(by_spring.satellite_seat, chain.spring.satellite_seat)
    add_rows(by_spring.guide, chain.spring.guide)


@kernel
def spring_force_adjoint(state, R, i, run, sweep):
    """Add what spring i contributes, from the adjoints of force and moments in the chain."""
    chain, spring, by_spring = sweep.chain, run.springs[i], sweep.springs[i]
    d = vector(state.d)
    delta = minus(plus(d, times(R, spring.satellite_seat)), spring.platform_seat)
    s, g, point, share = contact(run.system, spring, delta, (R[1], R[4], R[7]))
    value, slope, by_stiffness, by_deformation = force(spring, run.cubics, s)
    f = spring.scale * value
    F = scaled(f * share, g)
    p = plus(spring.platform_seat, point)
    arm = minus(p, d)
    for n in range(LANES):
        by_M_2 = lane(chain.satellite_moment, n)
        by_M_1 = lane(chain.platform_moment, n)
        # F enters as itself, as (p - d) x F and as -p x F.
        by_F = plus(lane(chain.force, n), minus(cross(by_M_2, arm), cross(by_M_1, p)))
        put_lane(chain.spring_force, n, by_F)
        put_lane(chain.point, n, cross(F, minus(by_M_2, by_M_1)))
        chain.stroke[n] = 0.0
        add_lane(chain.derivative.d, n, cross(by_M_2, F))
    stroke_adjoint(state, R, spring, f, spring.scale * slope, run, sweep, chain.derivative, by_spring)
    for n in range(LANES):
        by_f = chain.spring_size[n]
        by_spring.scale[n] += value * by_f
        by_spring.stiffness[n] += spring.scale * by_stiffness * by_f
        by_spring.deformation[n] += spring.scale * by_deformation * by_f


@inline
def sum_rows(a):
    """The SUM_ROWS numbers of a field as a tuple."""
    return a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8], a[9], a[10], a[11]


@inline
def sum_product(a, b, n):
    """The product of SUM_ROWS numbers with lane n of as many rows."""
    return (
        a[0] * b[0, n] + a[1] * b[1, n] + a[2] * b[2, n] + a[3] * b[3, n] + a[4] * b[4, n] + a[5] * b[5, n]
        + a[6] * b[6, n] + a[7] * b[7, n] + a[8] * b[8, n] + a[9] * b[9, n] + a[10] * b[10, n] + a[11] * b[11, n]
    )  # fmt: skip


@inline
def add_factors_adjoint(first, sums, by_forces, target, row):
    """Add what the adjoint of the forces says of three factors, of d or of a row of R, to `target` from `row` on."""
    a, b, c = sum_rows(sums[first]), sum_rows(sums[first + 1]), sum_rows(sums[first + 2])
    for n in range(LANES):
        by_factors = sum_product(a, by_forces, n), sum_product(b, by_forces, n), sum_product(c, by_forces, n)
        add_lane(target, n, by_factors, row)


@kernel
def guided_forces_adjoint(state, R, run, chain):
    """The same for all springs in the sums at once; their forces stand in `run.system`."""
    sums, forces, product, by_state = run.system.sums, run.system.forces, chain.forces.rows, chain.derivative
    d = vector(state.d)
    F = (forces[0], forces[1], forces[2])
    x, y, z = (forces[3], forces[4], forces[5]), (forces[6], forces[7], forces[8]), (forces[9], forces[10], forces[11])
    u, v, w = (R[0], R[1], R[2]), (R[3], R[4], R[5]), (R[6], R[7], R[8])
    for n in range(LANES):
        by_M_1 = lane(chain.platform_moment, n)
        a, b, c = minus(lane(chain.satellite_moment, n), by_M_1)
        add_lane(by_state.d, n, cross(by_M_1, F))
        # The adjoints of the sums of f n and of f n b^T, row by row.
        put_lane(product, n, minus(lane(chain.force, n), cross(by_M_1, d)))
        put_lane(product, n, minus(scaled(b, w), scaled(c, v)), 3)
        put_lane(product, n, minus(scaled(c, u), scaled(a, w)), 6)
        put_lane(product, n, minus(scaled(a, v), scaled(b, u)), 9)
        add_lane(chain.rotation, n, minus(scaled(c, y), scaled(b, z)))
        add_lane(chain.rotation, n, minus(scaled(a, z), scaled(c, x)), 3)
        add_lane(chain.rotation, n, minus(scaled(b, x), scaled(a, y)), 6)
    add_factors_adjoint(COLUMNS[0], sums, product, by_state.d, ROWS[0])
    add_factors_adjoint(COLUMNS[1], sums, product, chain.rotation, ROWS[0])
    add_factors_adjoint(COLUMNS[2], sums, product, chain.rotation, ROWS[1])
    add_factors_adjoint(COLUMNS[3], sums, product, chain.rotation, ROWS[2])
    for j in range(SUM_COLUMNS):
        factor = 1.0
        if j > 3:
            factor = R[j - 4]
        elif j > 0:
            factor = d[j - 1]
        add_scaled(chain.constants.sums[j], factor, chain.forces)


@inline
def spring_forces_adjoint(state, R, run, sweep):
    """From the adjoints of force and moments in the chain to those of the state and of all springs that push."""
    if run.system.number_in_sums > 0:
        guided_forces_adjoint(state, R, run, sweep.chain)
    if run.system.number_beside > 0:
        for i in range(run.springs.shape[0]):
            if run.springs[i].is_pushing and not run.springs[i].in_sums:
                spring_force_adjoint(state, R, i, run, sweep)


@kernel
def collect_sums(i, sign, run, sweep):
    """Add to the adjoints of guided spring i what that of the sums' matrix says, times `sign`.

    The matrix gathers from the end of the run on: a spring takes it once with -1 at its release and once with 1 at the
    start of its push.
    """
    chain, spring = sweep.chain, run.springs[i]
    if not spring.in_sums:
        return
    by_sums, by_forces, by_row, by_spring = chain.constants.sums, chain.forces, chain.row_entries, chain.spring
    by_f_1, by_column = chain.by_f_1, chain.by_column
    row_and_column(spring, run.cubics, chain)
    row = sum_rows(chain.row)
    n_1, a, b = vector(spring.guide), vector(spring.platform_seat), vector(spring.satellite_seat)
    along = dot(n_1, a)
    # The law is linear in the stroke, f = f_0 + f_1 s, and so are its derivatives.
    f_0, f_1, stiffness_0, deformation_0 = force(spring, run.cubics, 0.0)
    _, _, stiffness_1, deformation_1 = force(spring, run.cubics, 1.0)
    scale = spring.scale
    f_0 *= scale
    f_1 *= scale
    stiffness_1 -= stiffness_0
    deformation_1 -= deformation_0
    clear(by_row)
    for j in range(SUM_COLUMNS):
        add_scaled(by_row, chain.column[j], by_sums[j])
    for n in range(LANES):
        by_f_1[n] = 0.0
    for j in range(SUM_ROWS):
        # An entry of the row, n_1 or n_1 b^T, stands in the column as well, times f_1.
        entry = chain.row[j]
        copy(by_forces, by_sums[1 + j])
        for n in range(LANES):
            by_column[n] = sum_product(row, by_forces.rows, n)
            by_f_1[n] += entry * by_column[n]
        for n in range(LANES):
            by_row.rows[j, n] += f_1 * by_column[n]
    clear(by_spring)
    for n in range(LANES):
        by_f_0 = sum_product(row, by_sums[0].rows, n)
        by_slope = by_f_1[n] - along * by_f_0
        by_constant = -f_1 * by_f_0
        by_n_1 = lane(by_row.rows, n)
        by_product = (*lane(by_row.rows, n, 3), *lane(by_row.rows, n, 6), *lane(by_row.rows, n, 9))
        put_lane(by_spring.guide, n, plus(plus(by_n_1, times(by_product, b)), scaled(by_constant, a)))
        put_lane(by_spring.satellite_seat, n, transposed_times(by_product, n_1))
        put_lane(by_spring.platform_seat, n, scaled(by_constant, n_1))
        by_spring.scale[n] = (f_0 * by_f_0 + f_1 * by_slope) / scale
        by_spring.stiffness[n] = scale * (stiffness_0 * by_f_0 + stiffness_1 * by_slope)
        by_spring.deformation[n] = scale * (deformation_0 * by_f_0 + deformation_1 * by_slope)
    add_scaled(sweep.springs[i], sign, by_spring)
