"""From the parameters of a run to its constants and its initial state; and back, for their adjoints.

With the impulses Delta p and Delta h of bolts or a clamp band, u = R c_2 and the rates Omega of the stack:

    d = u - c_1 + l_0 y,   w = Omega x d + (1 / m_1 + 1 / m_2) Delta p
    omega_1 = Omega + I_1^-1 (-Delta h + (c_1 - l_0 y) x Delta p)
    omega_2 = R^T Omega + I_2^-1 R^T (Delta h - u x Delta p)
"""

import math

import numpy as np

from satsep_ot.dynamics.kernels.compilation import kernel, larger, smaller
from satsep_ot.dynamics.kernels.force_laws import steepest_slope_and_work
from satsep_ot.dynamics.kernels.gravity import place_anchor
from satsep_ot.dynamics.kernels.records import LARGEST, NO_GRAVITY
from satsep_ot.dynamics.kernels.vectors import (
    add_lane,
    add_product,
    cross,
    dot,
    lane,
    minus,
    plus,
    put,
    quaternion_from_rotation_vector,
    rotation,
    scaled,
    times,
    transposed_times,
    vector,
)


@kernel
def set_inertia(elements, body):
    """Write the tensor of six elements (xx, yy, zz, xy, xz, yz) and its inverse into the record of a body.

    Returns whether it is positive definite and obeys the triangle inequality of principal moments.
    """
    xx, yy, zz = vector(elements)
    xy, xz, yz = vector(elements, 3)
    cxx, cxy, cxz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    determinant = xx * cxx + xy * cxy + xz * cxz
    put(body.inertia, (xx, xy, xz))
    put(body.inertia, (xy, yy, yz), 3)
    put(body.inertia, (xz, yz, zz), 6)
    inverse = 1.0 / determinant
    cyz = xy * xz - xx * yz
    put(body.inverse_inertia, scaled(inverse, (cxx, cxy, cxz)))
    put(body.inverse_inertia, scaled(inverse, (cxy, xx * zz - xz * xz, cyz)), 3)
    put(body.inverse_inertia, scaled(inverse, (cxz, cyz, xx * yy - xy * xy)), 6)
    # Principal moments obey the triangle inequality where the second moment of mass, trace / 2 - inertia, has no
    # negative one.
    half = 0.5 * (xx + yy + zz) * (1.0 + 1e-9)
    a, b, c = half - xx, half - yy, half - zz
    return (
        xx > 0.0
        and xx * yy - xy * xy > 0.0
        and determinant > 0.0
        and a >= 0.0
        and b >= 0.0
        and c >= 0.0
        and a * b - xy * xy >= 0.0
        and a * c - xz * xz >= 0.0
        and b * c - yz * yz >= 0.0
        and a * (b * c - yz * yz) - xy * (xy * c + yz * xz) - xz * (xy * yz + b * xz) >= 0.0
    )


@kernel
def largest_lever(body, arm_square):
    """Upper estimate of the inverse inertia [1/kg] that a force feels at an arm."""
    inverse = body.inverse_inertia
    return arm_square * larger(inverse[0], larger(inverse[4], inverse[8]))


@kernel
def set_springs(parameters, run):
    """Fill the records of the springs from the parameters.

    Returns the sum of the stiffnesses, twice the stored energy, the squares of the longest arms on both bodies, the
    shortest release stroke and the largest deformation.
    """
    l_0 = parameters.common.stowed_length
    c_1, c_2 = parameters.common.platform.center_of_mass, parameters.common.satellite.center_of_mass
    stiffness = 0.0
    energy = 0.0
    arm_1 = 0.0
    arm_2 = 0.0
    deformation = 0.0
    shortest = np.inf
    run.system.ring_radius = -1.0
    for i in range(run.springs.shape[0]):
        given, spring = parameters.springs[i], run.springs[i]
        cos_a, sin_a = math.cos(given.angle), math.sin(given.angle)
        cos_b, sin_b = math.cos(given.cant), math.sin(given.cant)
        n_1 = (-sin_b * sin_a, cos_b, sin_b * cos_a)
        seat = (given.radius * cos_a, 0.0, given.radius * sin_a)
        put(spring.guide, n_1)
        # A stowed strut lies along its (canted) guide: the platform's seat is recessed by l_0 n_1, the satellite raised
        # by l_0 y.
        raised = scaled(l_0, (-n_1[0], 1.0 - cos_b, -n_1[2]))
        put(spring.platform_seat, minus(plus(seat, raised), c_1))
        put(spring.satellite_seat, minus(seat, c_2))
        spring.stiffness = given.stiffness
        spring.deformation = given.deformation
        spring.delay = given.delay
        spring.scale = given.scale
        spring.cubic = -1
        spring.release_stroke = given.stroke
        if given.radius > run.system.ring_radius:
            run.system.ring_radius = given.radius
            run.system.ring_spring = i
        reach = given.stroke
        if spring.has_stiffness:
            # It pushes until it is relaxed.
            spring.release_stroke = smaller(given.stroke, given.deformation)
            reach = given.deformation
        if not spring.holds_back:
            steepest, work = steepest_slope_and_work(spring, run.cubics, spring.release_stroke)
            stiffness += given.scale * steepest
            energy += given.scale * 2.0 * work
            deformation = larger(deformation, reach)
        shortest = smaller(shortest, spring.release_stroke)
        arm_1 = larger(arm_1, dot(spring.platform_seat, spring.platform_seat))
        arm_2 = larger(arm_2, dot(spring.satellite_seat, spring.satellite_seat))
    return stiffness, energy, arm_1, arm_2, shortest, deformation


@kernel
def are_allowed(parameters):
    """Whether every parameter is finite and within the limits of its sign."""
    allowed = True
    for n in range(parameters.vector.shape[0]):
        value, limits = parameters.vector[n], parameters.limits[n]
        allowed = allowed and abs(value) < LARGEST and limits[0] <= value <= limits[1]
    return allowed


@kernel
def set_constants(parameters, orbit, run):
    """Fill the constants, the springs and the initial state; returns whether the parameters are physical.

    Into `run.progress` go an upper estimate of the fastest frequency, the typical separation velocity and stroke.
    """
    given, system, state = parameters.common, run.system, run.tape[0].state
    valid = are_allowed(parameters)
    system.inverse_reduced_mass = 1.0 / given.platform.mass + 1.0 / given.satellite.mass
    valid = set_inertia(given.platform.inertia, system.platform) and valid
    valid = set_inertia(given.satellite.inertia, system.satellite) and valid
    put(system.platform.center_of_mass, given.platform.center_of_mass)
    put(system.satellite.center_of_mass, given.satellite.center_of_mass)
    l_0 = given.stowed_length
    system.stowed_length = l_0
    system.guide_friction = given.guide_friction
    system.recess_radius = given.recess_radius
    system.recess_depth = given.recess_depth
    for i in range(run.planes.shape[0]):
        run.planes[i].offset = parameters.offsets[i]
    if system.gravity != NO_GRAVITY:
        anchor = system.anchor
        anchor.mu = orbit[0]
        anchor.time = 0.0
        put(anchor.position, vector(orbit, 1))
        put(anchor.velocity, vector(orbit, 4))
        place_anchor(anchor)
    stiffness, energy, arm_1, arm_2, shortest, deformation = set_springs(parameters, run)
    set_initial_state(given, system, state)
    square = system.inverse_reduced_mass
    square += largest_lever(system.platform, arm_1) + largest_lever(system.satellite, arm_2)
    square *= stiffness
    if system.has_stowed_length:
        square *= larger(1.0, deformation / l_0)
    square += dot(state.omega_1, state.omega_1) + dot(state.omega_2, state.omega_2)
    run.progress.frequency = math.sqrt(square)
    run.progress.velocity = math.sqrt(energy * system.inverse_reduced_mass)
    run.progress.length = shortest
    return valid


@kernel
def set_initial_state(given, system, state):
    """The state of the stack at t = 0, after the impulses of bolts or a clamp band."""
    Delta_p, Delta_h, Omega = vector(given.impulse), vector(given.angular_impulse), vector(given.rates)
    error = given.mounting_error
    q0, q1, q2, q3 = quaternion_from_rotation_vector(error[0], error[1], error[2])
    state.Q[0] = q0
    put(state.Q, (q1, q2, q3), 1)
    R = rotation((q0, q1, q2, q3))
    # The satellite's CG from its ring centre, where the impulse acts.
    u = times(R, given.satellite.center_of_mass)
    # The platform's CG from there.
    arm = minus(given.platform.center_of_mass, (0.0, given.stowed_length, 0.0))
    d = minus(u, arm)
    put(state.d, d)
    put(state.w, plus(cross(Omega, d), scaled(system.inverse_reduced_mass, Delta_p)))
    L_1 = minus(cross(arm, Delta_p), Delta_h)
    put(state.omega_1, plus(Omega, times(system.platform.inverse_inertia, L_1)))
    L_2 = transposed_times(R, minus(Delta_h, cross(u, Delta_p)))
    put(state.omega_2, plus(transposed_times(R, Omega), times(system.satellite.inverse_inertia, L_2)))


@kernel
def initial_state_adjoint(parameters, run, sweep, n, gradient):
    """From lane n of the adjoint of the initial state to rates, impulses, CGs, inertias and stowed length.

    That of the matrix of Q is written.
    """
    given, system, state = parameters.common, run.system, run.tape[0].state
    chain = sweep.chain
    constants = chain.constants
    Delta_p, Delta_h, Omega = vector(given.impulse), vector(given.angular_impulse), vector(given.rates)
    c_2 = vector(given.satellite.center_of_mass)
    R = rotation(state.Q)
    u = times(R, c_2)
    arm = minus(given.platform.center_of_mass, (0.0, given.stowed_length, 0.0))
    by_w = lane(chain.state.w, n)
    by_d = plus(lane(chain.state.d, n), cross(by_w, Omega))
    by_omega_1 = lane(chain.state.omega_1, n)
    by_omega_2 = lane(chain.state.omega_2, n)
    by_L_1 = times(system.platform.inverse_inertia, by_omega_1)
    by_L_2 = times(system.satellite.inverse_inertia, by_omega_2)
    constants.inverse_reduced_mass[n] += dot(by_w, Delta_p)
    put(gradient.rates, plus(cross(state.d, by_w), plus(by_omega_1, times(R, by_omega_2))))
    # L_2 = R^T h with h = Delta h - u x Delta p.
    by_h = times(R, by_L_2)
    by_u = minus(by_d, cross(Delta_p, by_h))
    for row in range(9):
        chain.rotation[row, n] = 0.0
    add_product(chain.rotation, n, Omega, by_omega_2)
    add_product(chain.rotation, n, minus(Delta_h, cross(u, Delta_p)), by_L_2)
    add_product(chain.rotation, n, by_u, c_2)
    put(gradient.angular_impulse, minus(by_h, by_L_1))
    by_p = plus(minus(cross(by_L_1, arm), cross(by_h, u)), scaled(system.inverse_reduced_mass, by_w))
    put(gradient.impulse, by_p)
    by_arm = minus(cross(Delta_p, by_L_1), by_d)
    constants.stowed_length[n] -= by_arm[1]
    add_lane(constants.platform.center_of_mass, n, by_arm)
    add_lane(constants.satellite.center_of_mass, n, transposed_times(R, by_u))
    # The rates that the impulses gave both bodies, for their inertias.
    gained = minus(transposed_times(R, Omega), state.omega_2)
    add_product(constants.satellite.inertia, n, by_L_2, gained)
    add_product(constants.platform.inertia, n, by_L_1, minus(Omega, state.omega_1))


@kernel
def mounting_error_adjoint(given, by_Q, n, gradient):
    """From lane n of the adjoint of the initial Q to that of the mounting error, a rotation vector."""
    r = vector(given.mounting_error)
    square = dot(r, r)
    scale = 0.5 - square / 48.0
    bend = -1.0 / 24.0 + square / 960.0
    if square > 1e-4:
        angle = math.sqrt(square)
        scale = math.sin(0.5 * angle) / angle
        bend = (0.5 * math.cos(0.5 * angle) - scale) / square
    by_part = lane(by_Q, n, 1)
    along = bend * dot(by_part, r) - 0.5 * scale * by_Q[0, n]
    put(gradient.mounting_error, plus(scaled(scale, by_part), scaled(along, r)))


@kernel
def body_parameters_adjoint(given, adjoint, inverse_reduced_mass, n, gradient):
    """From lane n of the adjoints of a body's constants to those of its parameters."""
    inertia = adjoint.inertia
    gradient.mass = -inverse_reduced_mass[n] / (given.mass * given.mass)
    put(gradient.inertia, (inertia[0, n], inertia[4, n], inertia[8, n]))
    mixed = inertia[1, n] + inertia[3, n], inertia[2, n] + inertia[6, n], inertia[5, n] + inertia[7, n]
    put(gradient.inertia, mixed, 3)
    put(gradient.center_of_mass, lane(adjoint.center_of_mass, n))


@kernel
def constants_adjoint(parameters, run, sweep, n, gradient):
    """From lane n of the adjoints of the constants of a run to the gradient with respect to its parameters."""
    given, constants, common = parameters.common, sweep.chain.constants, gradient.common
    body_parameters_adjoint(given.platform, constants.platform, constants.inverse_reduced_mass, n, common.platform)
    body_parameters_adjoint(given.satellite, constants.satellite, constants.inverse_reduced_mass, n, common.satellite)
    common.recess_radius = constants.recess_radius[n]
    common.recess_depth = constants.recess_depth[n]
    common.guide_friction = constants.guide_friction[n]
    l_0 = given.stowed_length
    by_l_0 = constants.stowed_length[n]
    for i in range(run.springs.shape[0]):
        spring, adjoint, out = parameters.springs[i], sweep.springs[i], gradient.springs[i]
        cos_a, sin_a = math.cos(spring.angle), math.sin(spring.angle)
        cos_b, sin_b = math.cos(spring.cant), math.sin(spring.cant)
        by_a = lane(adjoint.platform_seat, n)
        by_b = lane(adjoint.satellite_seat, n)
        by_n = minus(lane(adjoint.guide, n), scaled(l_0, by_a))
        by_seat = plus(by_a, by_b)
        by_l_0 += dot(by_a, (sin_b * sin_a, 1.0 - cos_b, -sin_b * cos_a))
        out.angle = spring.radius * (cos_a * by_seat[2] - sin_a * by_seat[0])
        out.angle -= sin_b * (cos_a * by_n[0] + sin_a * by_n[2])
        out.radius = cos_a * by_seat[0] + sin_a * by_seat[2]
        if i == run.system.ring_spring:
            out.radius += constants.ring_radius[n]
        out.stiffness = adjoint.stiffness[n]
        out.deformation = adjoint.deformation[n]
        out.stroke = 0.0
        if run.springs[i].has_stiffness and spring.deformation < spring.stroke:
            out.deformation += adjoint.release_stroke[n]
        else:
            out.stroke = adjoint.release_stroke[n]
        out.cant = cos_b * (cos_a * by_n[2] - sin_a * by_n[0]) - sin_b * by_n[1]
        out.delay = adjoint.delay[n]
        out.scale = adjoint.scale[n]
        put(common.platform.center_of_mass, minus(common.platform.center_of_mass, by_a))
        put(common.satellite.center_of_mass, minus(common.satellite.center_of_mass, by_b))
    common.stowed_length = by_l_0
    for i in range(run.planes.shape[0]):
        gradient.offsets[i] = sweep.offsets[i, n]
