"""Contact forces: points of one body against surfaces of the other, late bolts, pins that stick and slip.

With the contact point p and the arm p - d from the satellite's CG (platform axes), the unit direction nu of the force
on the satellite, the gap g (positive where they are apart) and the relative velocity v of both bodies at p,
dg/dt = nu . v:

    N = k (-g) (1 - lambda dg/dt)          while g < 0 and the bracket is positive, else 0 (Hunt and Crossley)
    F = N nu - mu N v_t / sqrt(|v_t|^2 + v_eps^2),   v_t = v - (nu . v) nu

on the satellite, and its opposite on the platform at the same point. The force is continuous where a contact begins
and ends. A bolt that has not let go is a ball joint, F = -k (D + T v) with D from its place on the platform to that on
the satellite. Pins that stick are a spring and a damper along their guide, F = -k (s - a) - k T ds/dt with the anchor
a; they slip where this reaches the force that they hold, and stick again where ds/dt is 0, with the anchor that keeps
the force.

Runs with contact are of the type `ContactRun`. What `rigid_body` adds for them is chosen by that type when it is
compiled: runs without contact do not know of it. Sources: Hunt and Crossley, "Coefficient of restitution interpreted as
damping in vibroimpact", Journal of Applied Mechanics 42 (1975); Iwan, "A distributed-element model for hysteresis",
Journal of Applied Mechanics 33 (1966), for the pins.
"""

import math

import numpy as np
from numba import types
from numba.extending import overload

from satsep_ot.dynamics.kernels.compilation import INLINE, choice, inline, integers, kernel, larger
from satsep_ot.dynamics.kernels.records import LANES, ContactRun
from satsep_ot.dynamics.kernels.vectors import (
    ZERO,
    add_lane,
    add_product,
    cross,
    dot,
    lane,
    minus,
    norm,
    plus,
    rotation,
    scaled,
    times,
    transposed_times,
    vector,
)

# Kinds of elements: a satellite's point against a plane or a curved surface of the platform, a platform's point against
# a face of the satellite, a bolt, pins.
PLANE, CURVED, FACE, BOLT, PINS = integers(0, 1, 2, 3, 4)
# What they belong to.
DECK, RECESS, RAIL_END, RAIL_MOUTH, HOLD_DOWN, CONNECTOR = integers(0, 1, 2, 3, 4, 5)
# Modes: apart; pushing; not pushing though the gap is negative, since it opens too fast; out of the surface's extent.
# A bolt holds or is gone; pins stick, slip or are gone.
OPEN, LOADED, SLACK, OUT, HOLDS, STICKS, SLIPS, GONE = integers(0, 1, 2, 3, 4, 5, 6, 7)
# A condition no longer holds where it is violated by more than rounding: points that only just touch would change their
# modes for ever.
DEAD_BAND, SLACKNESS = 1e-13, 1e-12  # m; 1, or m/s
# Conditions of a mode: on the gap, on the bracket, on the extent.
GAP, BRACKET, EXTENT = integers(0, 1, 2)


def cylinder(q, size):
    """The inside of a cylinder of radius `size` about the separation axis."""
    rho = math.sqrt(q[0] * q[0] + q[2] * q[2])
    inverse = 1.0 / rho if rho > 0.0 else 0.0
    return size - rho, (-q[0] * inverse, 0.0, -q[2] * inverse)


# Curved surfaces of the platform: from a place q from its ring centre and a size to the gap, the distance from the
# surface, which grows with the size by 1, and its gradient with respect to q, the direction of the force.
SURFACES = {
    "cylinder": cylinder,
}
_curved = choice(list(SURFACES.values()))
CURVATURE_STEP = 1e-5  # m, errs by its square over that of the radius of curvature


@inline
def place(state, R, element):
    """Contact point from the platform's CG and its arm from the satellite's, in platform axes."""
    if element.kind == FACE:
        p = vector(element.point)
        return p, minus(p, state.d)
    arm = times(R, element.point)
    return plus(state.d, arm), arm


@inline
def velocity_at(state, Omega, p, arm):
    """Of the satellite's material point at a contact less that of the platform's; Omega is R omega_2."""
    return minus(plus(state.w, cross(Omega, arm)), cross(state.omega_1, p))


@inline
def contact_velocity(state, R, p, arm):
    """The same from R."""
    return velocity_at(state, times(R, state.omega_2), p, arm)


@inline
def gap_and_direction(state, R, element, system, p, arm):
    """The gap, and the unit direction of the force on the satellite."""
    if element.kind == PLANE:
        nu = vector(element.normal)
        return dot(nu, p) - element.level - element.start, nu
    if element.kind == CURVED:
        gap, nu = _curved(element.wall, plus(p, system.platform.center_of_mass), element.level)
        return gap - element.start, nu
    m = vector(element.normal)
    return dot(m, transposed_times(R, arm)) - element.level - element.start, scaled(-1.0, times(R, m))


@inline
def normal_force(element, gap, rate):
    """k (-g) (1 - lambda dg/dt)."""
    return -element.stiffness * gap * (1.0 - element.damping * rate)


@inline
def element_force(state, R, element, run):
    """Force on the satellite of an element that acts, the contact point, its arm, and the normal force."""
    if element.kind == PINS:
        spring = run.springs[element.number]
        arm = times(R, spring.satellite_seat)
        p = plus(state.d, arm)
        n_1 = vector(spring.guide)
        s = dot(n_1, minus(p, spring.platform_seat))
        rate = dot(n_1, contact_velocity(state, R, p, arm))
        f = -element.sign * spring.scale
        if element.mode == STICKS:
            f = -element.stiffness * (s - element.anchor + element.damping * rate)
        return scaled(f, n_1), p, arm, 0.0
    p, arm = place(state, R, element)
    v = contact_velocity(state, R, p, arm)
    if element.kind == BOLT:
        extension = plus(minus(p, element.other), scaled(element.damping, v))
        return scaled(-element.stiffness, extension), p, arm, 0.0
    gap, nu = gap_and_direction(state, R, element, run.system, p, arm)
    rate = dot(nu, v)
    N = normal_force(element, gap, rate)
    v_t = minus(v, scaled(rate, nu))
    share = element.friction * N / math.sqrt(dot(v_t, v_t) + element.sliding * element.sliding)
    return minus(scaled(N, nu), scaled(share, v_t)), p, arm, N


@inline
def _contact_forces(state, R, run, F, M_2, M_1):
    total = 0.0
    largest = 0.0
    largest_of = -1
    for k in range(run.contact.number_loaded):
        F_i, p, arm, N = element_force(state, R, run.elements[run.contact.loaded[k]], run)
        F = plus(F, F_i)
        M_2 = plus(M_2, cross(arm, F_i))
        M_1 = minus(M_1, cross(p, F_i))
        total += N
        if largest < N:
            largest, largest_of = N, run.contact.loaded[k]
    run.contact.normal, run.contact.largest, run.contact.largest_of = total, largest, largest_of
    return F, M_2, M_1


@inline
def _keep_normal_forces(stage, run):
    run.contact.stage_normal[stage] = run.contact.normal
    run.contact.stage_largest[stage] = run.contact.largest
    run.contact.stage_largest_of[stage] = run.contact.largest_of


@kernel
def _contact_forces_adjoint(state, R, run, sweep):
    for k in range(run.contact.number_loaded):
        which = run.contact.loaded[k]
        if run.elements[which].kind == PINS:
            pins_adjoint(state, R, which, run, sweep)
        else:
            element_adjoint(state, R, which, run, sweep)


def contact_forces(state, R, run, F, M_2, M_1):
    """Add the forces of contact to force and moments, platform axes; those given where a run has no contact."""
    return _contact_forces(state, R, run, F, M_2, M_1) if isinstance(run, ContactRun) else (F, M_2, M_1)


def keep_normal_forces(stage, run):
    """Keep the normal forces of the stage just evaluated."""
    if isinstance(run, ContactRun):
        _keep_normal_forces(stage, run)


def sum_of_normal_forces(run):
    """Of the state that was evaluated last."""
    return run.contact.normal if isinstance(run, ContactRun) else 0.0


def contact_forces_adjoint(state, R, run, sweep):
    """Add what they contribute to the adjoints, from those of force and moments in the chain."""
    if isinstance(run, ContactRun):
        _contact_forces_adjoint(state, R, run, sweep)


def _has_contact(run):
    return isinstance(run, types.BaseNamedTuple) and run.instance_class is ContactRun


@overload(contact_forces, jit_options=INLINE, strict=False)
def _choose_forces(state, R, run, F, M_2, M_1):
    if _has_contact(run):
        return lambda state, R, run, F, M_2, M_1: _contact_forces(state, R, run, F, M_2, M_1)
    return lambda state, R, run, F, M_2, M_1: (F, M_2, M_1)


@overload(keep_normal_forces, jit_options=INLINE, strict=False)
def _choose_keeping(stage, run):
    if _has_contact(run):
        return lambda stage, run: _keep_normal_forces(stage, run)
    return lambda stage, run: None


@overload(sum_of_normal_forces, jit_options=INLINE, strict=False)
def _choose_sum(run):
    if _has_contact(run):
        return lambda run: run.contact.normal
    return lambda run: 0.0


@overload(contact_forces_adjoint, jit_options=INLINE, strict=False)
def _choose_adjoint(state, R, run, sweep):
    if _has_contact(run):
        return lambda state, R, run, sweep: _contact_forces_adjoint(state, R, run, sweep)
    return lambda state, R, run, sweep: None


@inline
def add_velocity(state, R, chain, by_state, n, by_v, p, arm):
    """From the adjoint of the velocity at a contact to the state's; returns those of p and of the arm."""
    Omega, omega_1 = times(R, state.omega_2), vector(state.omega_1)
    add_lane(by_state.w, n, by_v)
    by_Omega = cross(arm, by_v)
    add_lane(by_state.omega_2, n, transposed_times(R, by_Omega))
    add_product(chain.rotation, n, by_Omega, state.omega_2)
    add_lane(by_state.omega_1, n, cross(by_v, p))
    return cross(omega_1, by_v), cross(by_v, Omega)


@inline
def add_satellite_point(R, chain, by_state, n, by_p, by_arm, b):
    """From the adjoints of p = d + R b and of the arm R b; returns that of b."""
    by_arm = plus(by_arm, by_p)
    add_lane(by_state.d, n, by_p)
    add_product(chain.rotation, n, by_arm, b)
    return transposed_times(R, by_arm)


@inline
def add_gap(state, R, element, system, constants, adjoint, chain, n, by_g, by_nu, p, arm):
    """From the adjoints of gap and direction; returns those of p and of the arm."""
    if element.kind == PLANE:
        adjoint.level[n] -= by_g
        return scaled(by_g, vector(element.normal)), ZERO
    if element.kind == CURVED:
        q = plus(p, system.platform.center_of_mass)
        _, nu = _curved(element.wall, q, element.level)
        # The direction is the gradient of the gap: how it turns is a symmetric matrix, whose product with by_nu is the
        # derivative along by_nu.
        size = norm(by_nu)
        step = scaled(CURVATURE_STEP / size if size > 0.0 else 0.0, by_nu)
        _, ahead = _curved(element.wall, plus(q, step), element.level)
        _, behind = _curved(element.wall, minus(q, step), element.level)
        turning = scaled(0.5 * size / CURVATURE_STEP, minus(ahead, behind))
        by_p = plus(scaled(by_g, nu), turning)
        adjoint.level[n] += by_g
        add_lane(constants.platform.center_of_mass, n, by_p)
        return by_p, ZERO
    m = vector(element.normal)
    add_product(chain.rotation, n, scaled(-1.0, by_nu), m)
    by_place = scaled(by_g, m)
    add_product(chain.rotation, n, arm, by_place)
    adjoint.level[n] -= by_g
    return ZERO, times(R, by_place)


@inline
def add_point(state, R, element, adjoint, chain, by_state, n, by_p, by_arm):
    """From the adjoints of contact point and arm to those of the state and of the element's own point."""
    if element.kind == FACE:
        add_lane(by_state.d, n, scaled(-1.0, by_arm))
        add_lane(adjoint.point, n, plus(by_p, by_arm))
    else:
        add_lane(adjoint.point, n, add_satellite_point(R, chain, by_state, n, by_p, by_arm, vector(element.point)))


@kernel
def element_adjoint(state, R, which, run, sweep):
    """Add what a bolt or a contact contributes, from the adjoints of force and moments in the chain."""
    element, adjoint, chain, system = run.elements[which], sweep.elements[which], sweep.chain, run.system
    by_state, constants = chain.derivative, chain.constants
    p, arm = place(state, R, element)
    v = contact_velocity(state, R, p, arm)
    F, _, _, N = element_force(state, R, element, run)
    k, lam, mu = element.stiffness, element.damping, element.friction
    gap, nu = 0.0, ZERO
    if element.kind != BOLT:
        gap, nu = gap_and_direction(state, R, element, system, p, arm)
    rate = dot(nu, v)
    bracket = 1.0 - lam * rate
    v_t = minus(v, scaled(rate, nu))
    inverse = 1.0 / math.sqrt(dot(v_t, v_t) + element.sliding * element.sliding) if mu > 0.0 else 0.0
    extension = plus(minus(p, element.other), scaled(lam, v))
    for n in range(LANES):
        by_M_2, by_M_1 = lane(chain.satellite_moment, n), lane(chain.platform_moment, n)
        by_F = plus(lane(chain.force, n), minus(cross(by_M_2, arm), cross(by_M_1, p)))
        by_arm = cross(F, by_M_2)
        by_p = scaled(-1.0, cross(F, by_M_1))
        by_v = ZERO
        if element.kind == BOLT:
            by_D = scaled(-k, by_F)
            by_v = scaled(lam, by_D)
            by_p = plus(by_p, by_D)
            add_lane(adjoint.other, n, scaled(-1.0, by_D))
            adjoint.stiffness[n] -= dot(extension, by_F)
            adjoint.damping[n] += dot(v, by_D)
        else:
            across = dot(by_F, v_t) * inverse
            by_N = dot(by_F, nu) - mu * across + chain.normal[n]
            by_t = scaled(-mu * N * inverse, minus(by_F, scaled(across * inverse, v_t)))
            adjoint.friction[n] -= N * across
            adjoint.sliding[n] += mu * N * across * element.sliding * inverse * inverse
            by_g = -k * bracket * by_N
            by_rate = k * gap * lam * by_N - dot(by_t, nu)
            adjoint.stiffness[n] -= gap * bracket * by_N
            adjoint.damping[n] += k * gap * rate * by_N
            by_v = plus(by_t, scaled(by_rate, nu))
            by_nu = plus(scaled(N, by_F), minus(scaled(by_rate, v), scaled(rate, by_t)))
            by_q, by_a = add_gap(state, R, element, system, constants, adjoint, chain, n, by_g, by_nu, p, arm)
            by_p = plus(by_p, by_q)
            by_arm = plus(by_arm, by_a)
        by_q, by_a = add_velocity(state, R, chain, by_state, n, by_v, p, arm)
        add_point(state, R, element, adjoint, chain, by_state, n, plus(by_p, by_q), plus(by_arm, by_a))


@kernel
def pins_adjoint(state, R, which, run, sweep):
    """Add what pins contribute, from the adjoints of force and moments in the chain."""
    element, adjoint, chain = run.elements[which], sweep.elements[which], sweep.chain
    by_state = chain.derivative
    spring, by_spring = run.springs[element.number], sweep.springs[element.number]
    b, n_1 = vector(spring.satellite_seat), vector(spring.guide)
    F, p, arm, _ = element_force(state, R, element, run)
    f = dot(F, n_1)
    v = contact_velocity(state, R, p, arm)
    way = minus(p, spring.platform_seat)
    s, rate = dot(n_1, way), dot(n_1, v)
    k, T = element.stiffness, element.damping
    for n in range(LANES):
        by_M_2, by_M_1 = lane(chain.satellite_moment, n), lane(chain.platform_moment, n)
        by_F = plus(lane(chain.force, n), minus(cross(by_M_2, arm), cross(by_M_1, p)))
        by_arm = cross(F, by_M_2)
        by_p = scaled(-1.0, cross(F, by_M_1))
        by_f = dot(by_F, n_1)
        by_guide = scaled(f, by_F)
        if element.mode == STICKS:
            by_s, by_rate = -k * by_f, -k * T * by_f
            adjoint.stiffness[n] -= (s - element.anchor + T * rate) * by_f
            adjoint.anchor[n] += k * by_f
            by_guide = plus(by_guide, plus(scaled(by_s, way), scaled(by_rate, v)))
            by_way = scaled(by_s, n_1)
            by_p = plus(by_p, by_way)
            add_lane(by_spring.platform_seat, n, scaled(-1.0, by_way))
            by_q, by_a = add_velocity(state, R, chain, by_state, n, scaled(by_rate, n_1), p, arm)
            by_p, by_arm = plus(by_p, by_q), plus(by_arm, by_a)
        else:
            by_spring.scale[n] -= element.sign * by_f
        add_lane(by_spring.guide, n, by_guide)
        add_lane(by_spring.satellite_seat, n, add_satellite_point(R, chain, by_state, n, by_p, by_arm, b))


@inline
def acts(element):
    """Whether an element is in the right-hand side."""
    return element.mode == LOADED or HOLDS <= element.mode <= SLIPS


@kernel
def list_loaded(run):
    """Renew the list of the elements that act."""
    contact = run.contact
    number = 0
    for i in range(run.elements.shape[0]):
        if acts(run.elements[i]):
            contact.loaded[number] = i
            number += 1
    contact.number_loaded = number


@inline
def extent_height(state, R, element, system, p, arm):
    """y of the contact point from the ring centre of the body whose surface ends there."""
    if element.kind == FACE:
        return R[1] * arm[0] + R[4] * arm[1] + R[7] * arm[2] + system.satellite.center_of_mass[1]
    return p[1] + system.platform.center_of_mass[1]


@inline
def look_at(state, R, Omega, run, values, rates, which):
    """Write the conditions of the mode of element `which` in a state into `values`, and their rates."""
    element, system = run.elements[which], run.system
    for n in range(3):
        values[n] = np.inf
        rates[n] = np.nan
    if element.mode == GONE or element.kind == BOLT:
        return
    if element.kind == PINS:
        spring = run.springs[element.number]
        arm = times(R, spring.satellite_seat)
        p = plus(state.d, arm)
        n_1 = vector(spring.guide)
        s = dot(n_1, minus(p, spring.platform_seat))
        rate = dot(n_1, velocity_at(state, Omega, p, arm))
        values[EXTENT] = spring.release_stroke - s
        rates[EXTENT] = -rate
        if element.mode == STICKS:
            f = -element.stiffness * (s - element.anchor + element.damping * rate)
            values[GAP] = 1.0 - abs(f) / spring.scale + SLACKNESS
        else:
            values[GAP] = element.sign * rate + SLACKNESS
        return
    p, arm = place(state, R, element)
    v = velocity_at(state, Omega, p, arm)
    y = extent_height(state, R, element, system, p, arm)
    # In both axes the height changes as the points move along the platform's or the satellite's y axis.
    y_rate = v[1] if element.kind != FACE else -(R[1] * v[0] + R[4] * v[1] + R[7] * v[2])
    inside = y - element.low if y - element.low < element.high - y else element.high - y
    inside_rate = y_rate if y - element.low < element.high - y else -y_rate
    if element.mode == OUT:
        values[EXTENT] = -inside
        rates[EXTENT] = -inside_rate
        return
    values[EXTENT] = inside
    rates[EXTENT] = inside_rate
    gap, nu = gap_and_direction(state, R, element, system, p, arm)
    rate = dot(nu, v)
    bracket = 1.0 - element.damping * rate
    side = 1.0 if element.mode == OPEN else -1.0
    values[GAP] = side * gap + DEAD_BAND
    rates[GAP] = side * rate
    if element.mode == LOADED:
        values[BRACKET] = bracket + SLACKNESS
    elif element.mode == SLACK:
        values[BRACKET] = -bracket + SLACKNESS


@kernel
def way_of_points(start, end, contact):
    """How far a point of one body moves at most against the other between two states [m], on the straight way.

    Gaps and extents change by no more. The second way is across the separation axis, of either body: the gap from a
    surface along it changes by no more than that.
    """
    turn = 0.0
    for n in range(4):
        turn += (end.Q[n] - start.Q[n]) ** 2
    x, y, z = end.d[0] - start.d[0], end.d[1] - start.d[1], end.d[2] - start.d[2]
    across = math.sqrt(x * x + z * z)
    way = across + abs(y)
    reach = contact.satellite_reach
    if contact.platform_reach > 0.0:
        reach = larger(reach, contact.platform_reach + norm(start.d) + way)
    # What is at a distance of 1 moves by 2 sin(angle / 2) in a turn, quaternions by 2 sin(angle / 4).
    turned = 2.0 * math.sqrt(turn)
    # The axes of both bodies are not parallel: the sine of their angle from the quaternion.
    q = start.Q
    tilt = 2.0 * math.sqrt((q[1] * q[1] + q[3] * q[3]) * (q[0] * q[0] + q[2] * q[2])) + turned
    return way + turned * reach, across + tilt * abs(y) + turned * reach


@inline
def contact_mode(state, R, element, system):
    """The mode of an element within its extent, by gap and bracket."""
    p, arm = place(state, R, element)
    gap, nu = gap_and_direction(state, R, element, system, p, arm)
    if gap >= 0.0:
        return OPEN
    bracket = 1.0 - element.damping * dot(nu, contact_velocity(state, R, p, arm))
    return LOADED if bracket > 0.0 else SLACK


@kernel
def gap_rate(state, which, run):
    """Rate of the gap of an element; of pins that of their stroke."""
    element = run.elements[which]
    R = rotation(state.Q)
    if element.kind == PINS:
        spring = run.springs[element.number]
        arm = times(R, spring.satellite_seat)
        return dot(vector(spring.guide), contact_velocity(state, R, plus(state.d, arm), arm))
    p, arm = place(state, R, element)
    _, nu = gap_and_direction(state, R, element, run.system, p, arm)
    return dot(nu, contact_velocity(state, R, p, arm))
