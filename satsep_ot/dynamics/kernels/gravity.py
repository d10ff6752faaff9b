"""Gravity as a separation feels it: the difference between two nearby points, and the gradient torque.

The platform's CG is on its Kepler orbit, expanded about an anchor that is moved along. Sources: Battin, *An
Introduction to the Mathematics and Methods of Astrodynamics* (1999), section 8.4 (difference of two nearby central
accelerations without cancellation) and 3.4 (Lagrange's f and g series); Wie, *Space Vehicle Dynamics and Control*
(2008), section 6.10 (gravity-gradient torque).
"""

import math

from satsep_ot.dynamics.kernels.compilation import inline, kernel, smaller
from satsep_ot.dynamics.kernels.records import GRAVITY_WITH_TORQUE, LANES
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
    turned_back,
    vector,
)

# An expansion of the orbit about its anchor serves this long [s]: its direction is then good to (n t)^3 / 6, 2e-9
# in low Earth orbit, and mu / r^3 to e (n t)^2, 5e-6 e, of an acceleration of 1e-6 m/s2 a metre.
ANCHOR_LIFE = 2.0


@kernel
def place_anchor(anchor):
    """Fill what follows from the anchor's position and velocity."""
    r = anchor.position
    anchor.inverse_square = 1.0 / dot(r, r)
    anchor.inverse_radius = math.sqrt(anchor.inverse_square)
    anchor.rate = anchor.mu * anchor.inverse_square * anchor.inverse_radius
    anchor.rate_slope = -3.0 * anchor.rate * dot(r, anchor.velocity) * anchor.inverse_square
    put(anchor.acceleration, scaled(-anchor.rate, r))


@kernel
def move_anchor(t, anchor):
    """Carry the anchor forward to t on its Kepler orbit, in strides of at most its life, by the f and g series."""
    while anchor.time < t:
        h = smaller(t - anchor.time, ANCHOR_LIFE)
        u = anchor.rate
        p = -anchor.rate_slope / (3.0 * u)
        q = dot(anchor.velocity, anchor.velocity) * anchor.inverse_square - u
        # Terms of the fourth order in h, and their derivatives: 1e-9 m a stride in low Earth orbit.
        f3 = 0.5 * u * p
        f4 = u * (3.0 * q - 15.0 * p * p + u) / 24.0
        g4 = 0.25 * u * p
        f = 1.0 + h * h * (-0.5 * u + h * (f3 + h * f4))
        g = h * (1.0 + h * h * (-u / 6.0 + h * g4))
        f_rate = h * (-u + h * (3.0 * f3 + h * 4.0 * f4))
        g_rate = 1.0 + h * h * (-0.5 * u + h * 4.0 * g4)
        for n in range(3):
            position = anchor.position[n]
            velocity = anchor.velocity[n]
            anchor.position[n] = f * position + g * velocity
            anchor.velocity[n] = f_rate * position + g_rate * velocity
        anchor.time += h
        place_anchor(anchor)


@inline
def earth_vector(t, anchor, q_1):
    """The platform's CG from the Earth's centre [m] in platform axes, and mu / r^3 there."""
    h = t - anchor.time
    e = plus(anchor.position, scaled(h, plus(anchor.velocity, scaled(0.5 * h, anchor.acceleration))))
    return turned_back(q_1, e), anchor.rate + h * anchor.rate_slope


@inline
def differential_gravity(rate, r, d):
    """g(r + d) - g(r) [m/s2] by Battin's formula, with rate = mu / |r|^3 [1/s2].

    Direct subtraction would lose nine of sixteen digits for d of some metres at |r| of 7e6 m.
    """
    q = dot(d, plus(d, scaled(2.0, r))) / dot(r, r)
    w = (1.0 + q) * math.sqrt(1.0 + q)
    f = -q * (3.0 + q * (3.0 + q)) / (w * (1.0 + w))
    return scaled(-rate, plus(d, scaled(f, plus(r, d))))


@inline
def near_differential_gravity(rate, inverse_square, r, d):
    """The same for |d| up to some kilometres, with 1 / |r|^2 given and (1 + q)^(-3/2) - 1 by its series.

    q is 1e-6 here, where the first term left out does not exist in double precision; at 1 km it is 1e-14 of d's share.
    """
    q = dot(d, plus(d, scaled(2.0, r))) * inverse_square
    f = -q * (1.5 - q * (1.875 - q * (2.1875 - q * 2.4609375)))
    return scaled(-rate, plus(d, scaled(f, plus(r, d))))


@inline
def gradient_torque(rate, n, inertia):
    """3 mu/r^3 n x (I n) [N m] with the unit vector n to (or from) the Earth, in body axes."""
    return scaled(3.0 * rate, cross(n, times(inertia, n)))


@inline
def torque_adjoint(factor, inertia, n, moment, by_inertia, by_direction):
    """Adjoint of factor * n x (I n), from that of the moment: writes that of n and adds that of I."""
    inertia = matrix(inertia)
    h = times(inertia, n)
    for m in range(LANES):
        v = scaled(factor, lane(moment, m))
        # The adjoint of h = I n; I is symmetric.
        w = cross(v, n)
        put_lane(by_direction, m, plus(cross(h, v), times(inertia, w)))
        add_product(by_inertia, m, w, n)


@kernel
def gravity_adjoint(t, state, R, run, chain):
    """Add what gravity contributes, to first order in |d| / |r| (1e-7 of an acceleration of 1e-6 m/s2)."""
    by_state, constants, system = chain.derivative, chain.constants, run.system
    e, rate = earth_vector(t, system.anchor, state.q_1)
    n = scaled(system.anchor.inverse_radius, e)
    d = vector(state.d)
    along = dot(n, d)
    for m in range(LANES):
        # Differential acceleration: -rate (d - 3 n (n . d)).
        by_a = lane(chain.slope.w, m)
        across = dot(n, by_a)
        add_lane(by_state.d, m, scaled(-rate, minus(by_a, scaled(3.0 * across, n))))
        put_lane(chain.direction, m, scaled(3.0 * rate, plus(scaled(along, by_a), scaled(across, d))))
    if system.gravity == GRAVITY_WITH_TORQUE:
        inertia, moment = system.platform.inertia, chain.platform_torque
        torque_adjoint(3.0 * rate, inertia, n, moment, constants.platform.inertia, chain.point)
        for m in range(LANES):
            add_lane(chain.direction, m, lane(chain.point, m))
        inertia, moment = system.satellite.inertia, chain.satellite_torque
        torque_adjoint(3.0 * rate, inertia, transposed_times(R, n), moment, constants.satellite.inertia, chain.point)
        for m in range(LANES):
            # The direction in satellite axes is R^T n.
            by_turned = lane(chain.point, m)
            add_product(chain.rotation, m, n, by_turned)
            add_lane(chain.direction, m, times(R, by_turned))
    # n = C_1^T e: the adjoint of C_1 is e h^T, with e = C_1 n.
    e = times(rotation(state.q_1), n)
    for m in range(LANES):
        put_product(chain.platform_rotation, m, e, lane(chain.direction, m))
    rotation_adjoint(state.q_1, chain.platform_rotation, by_state.q_1)
