"""Newton-Euler equations of the two bodies, reduced to their relative motion.

Hu et al. (2017), equations 1, 2, 9 and 10, with the reaction on the platform added. Free of cancellation: nothing but
the relative position (metres) is integrated, never coordinates of 7e6 m. R is the matrix of Q.
"""

from satsep_ot.dynamics.kernels.compilation import inline, kernel
from satsep_ot.dynamics.kernels.contact import contact_forces, contact_forces_adjoint
from satsep_ot.dynamics.kernels.gravity import (
    earth_vector,
    gradient_torque,
    gravity_adjoint,
    near_differential_gravity,
)
from satsep_ot.dynamics.kernels.records import GRAVITY_WITH_TORQUE, LANES, NO_GRAVITY
from satsep_ot.dynamics.kernels.springs import spring_forces, spring_forces_adjoint
from satsep_ot.dynamics.kernels.vectors import (
    add_lane,
    add_product,
    cross,
    dot,
    lane,
    matrix,
    minus,
    plus,
    put,
    put_lane,
    put_product,
    rotation,
    rotation_adjoint,
    scaled,
    times,
    transposed_times,
    vector,
)


@inline
def angular_acceleration(body, omega, M):
    """Equation 2: I omega' = M - omega x I omega, in body axes."""
    return times(body.inverse_inertia, minus(M, cross(omega, times(body.inertia, omega))))


@inline
def put_turn(slope, q, difference, total):
    """Write [-u . difference, q_0 difference + u x total] / 2, with u the vector part of q."""
    u = scaled(0.5, vector(q, 1))
    slope[0] = -dot(u, difference)
    put(slope, plus(scaled(0.5 * q[0], difference), cross(u, total)), 1)


@inline
def derivative(t, state, slope, run):
    """Write the time derivative of a state at time t into `slope`."""
    system = run.system
    R = rotation(state.Q)
    omega_1, omega_2 = vector(state.omega_1), vector(state.omega_2)
    F, M_2, M_1 = spring_forces(state, R, run)
    F, M_2, M_1 = contact_forces(state, R, run, F, M_2, M_1)
    M_2 = transposed_times(R, M_2)
    a = scaled(system.inverse_reduced_mass, F)
    if system.gravity != NO_GRAVITY:
        anchor = system.anchor
        e, rate = earth_vector(t, anchor, state.q_1)
        a = plus(a, near_differential_gravity(rate, anchor.inverse_square, e, state.d))
        if system.gravity == GRAVITY_WITH_TORQUE:
            # The same direction serves both bodies: they are metres apart at 7e6 m.
            n = scaled(anchor.inverse_radius, e)
            M_1 = plus(M_1, gradient_torque(rate, n, system.platform.inertia))
            M_2 = plus(M_2, gradient_torque(rate, transposed_times(R, n), system.satellite.inertia))
    # Equations 1.1 and 1.2.
    put(slope.d, minus(state.w, cross(omega_1, state.d)))
    put(slope.w, minus(a, cross(omega_1, state.w)))
    put(slope.omega_1, angular_acceleration(system.platform, omega_1, M_1))
    put(slope.omega_2, angular_acceleration(system.satellite, omega_2, M_2))
    # Equation 3 as quaternions: Q' = (Q (x) [0, omega_2] - [0, omega_1] (x) Q) / 2 and q_1' = q_1 (x) [0, omega_1] / 2.
    put_turn(slope.Q, state.Q, minus(omega_2, omega_1), plus(omega_2, omega_1))
    put_turn(slope.q_1, state.q_1, omega_1, omega_1)


@inline
def body_adjoint(body, omega, acceleration, by_acceleration, by_moment, by_omega, by_inertia):
    """Adjoint of I omega' = M - omega x I omega: from that of omega' to those of M, omega and I."""
    inertia, inverse = matrix(body.inertia), matrix(body.inverse_inertia)
    h = times(inertia, omega)
    for n in range(LANES):
        by_M = times(inverse, lane(by_acceleration, n))
        put_lane(by_moment, n, by_M)
        # h = I omega enters as -omega x h.
        by_h = cross(omega, by_M)
        add_lane(by_omega, n, plus(cross(by_M, h), times(inertia, by_h)))
        add_product(by_inertia, n, by_h, omega)
        add_product(by_inertia, n, scaled(-1.0, by_M), acceleration)


@kernel
def kinematics_adjoint(state, chain):
    """Write `chain.derivative` from `chain.slope`, as far as the motion of d, w, Q and q_1 goes."""
    d, w = vector(state.d), vector(state.w)
    omega_1 = vector(state.omega_1)
    difference, total = minus(state.omega_2, omega_1), plus(state.omega_2, omega_1)
    q_w, q = state.Q[0], vector(state.Q, 1)
    z_w, z = state.q_1[0], vector(state.q_1, 1)
    by_slope, by_state = chain.slope, chain.derivative
    for n in range(LANES):
        # d' = w - omega_1 x d; w' = F / mu + gravity - omega_1 x w.
        by_d, by_w = lane(by_slope.d, n), lane(by_slope.w, n)
        put_lane(by_state.d, n, cross(omega_1, by_d))
        put_lane(by_state.w, n, plus(by_d, cross(omega_1, by_w)))
        by_omega_1 = plus(cross(by_d, d), cross(by_w, w))
        # Q' = (Q (x) [0, omega_2] - [0, omega_1] (x) Q) / 2.
        k_w, k = 0.5 * by_slope.Q[0, n], scaled(0.5, lane(by_slope.Q, n, 1))
        by_state.Q[0, n] = dot(k, difference)
        put_lane(by_state.Q, n, minus(cross(total, k), scaled(k_w, difference)), 1)
        by_difference = minus(scaled(q_w, k), scaled(k_w, q))
        by_total = cross(k, q)
        by_omega_1 = plus(by_omega_1, minus(by_total, by_difference))
        put_lane(by_state.omega_2, n, plus(by_total, by_difference))
        # q_1' = q_1 (x) [0, omega_1] / 2.
        k_w, k = 0.5 * by_slope.q_1[0, n], scaled(0.5, lane(by_slope.q_1, n, 1))
        by_state.q_1[0, n] = dot(k, omega_1)
        put_lane(by_state.q_1, n, minus(cross(omega_1, k), scaled(k_w, omega_1)), 1)
        by_turn = plus(minus(scaled(z_w, k), scaled(k_w, z)), cross(k, z))
        put_lane(by_state.omega_1, n, plus(by_omega_1, by_turn))


@kernel
def derivative_adjoint(t, state, slope, run, sweep):
    """Vector-Jacobian products of `derivative`, from LANES adjoints of its result `slope` in `chain.slope`.

    Writes those of the state into `chain.derivative`, adds those of the constants.
    """
    chain, system = sweep.chain, run.system
    by_state, constants, inverse_mass = chain.derivative, chain.constants, system.inverse_reduced_mass
    R = rotation(state.Q)
    F, M_2, M_1 = spring_forces(state, R, run)
    F, M_2, _ = contact_forces(state, R, run, F, M_2, M_1)
    kinematics_adjoint(state, chain)
    body_adjoint(
        system.platform, vector(state.omega_1), vector(slope.omega_1), chain.slope.omega_1, chain.platform_torque,
        by_state.omega_1, constants.platform.inertia,
    )  # fmt: skip
    body_adjoint(
        system.satellite, vector(state.omega_2), vector(slope.omega_2), chain.slope.omega_2, chain.satellite_torque,
        by_state.omega_2, constants.satellite.inertia,
    )  # fmt: skip
    for n in range(LANES):
        by_w = lane(chain.slope.w, n)
        put_lane(chain.force, n, scaled(inverse_mass, by_w))
        constants.inverse_reduced_mass[n] += dot(F, by_w)
        # The moment on the platform as it is, that on the satellite turned by R^T.
        by_torque = lane(chain.satellite_torque, n)
        put_lane(chain.platform_moment, n, lane(chain.platform_torque, n))
        put_lane(chain.satellite_moment, n, times(R, by_torque))
        put_product(chain.rotation, n, M_2, by_torque)
    spring_forces_adjoint(state, R, run, sweep)
    contact_forces_adjoint(state, R, run, sweep)
    if system.gravity != NO_GRAVITY:
        gravity_adjoint(t, state, R, run, chain)
    rotation_adjoint(state.Q, chain.rotation, by_state.Q)
