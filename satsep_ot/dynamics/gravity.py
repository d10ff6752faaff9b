"""Gravity as a separation feels it: the difference between two nearby points, and the gradient torque.

Sources: Battin, *An Introduction to the Mathematics and Methods of Astrodynamics* (1999), section 8.4 (difference of
two nearby central accelerations without cancellation) and 3.4 (Lagrange's f and g series); Wie, *Space Vehicle
Dynamics and Control* (2008), section 6.10 (gravity-gradient torque).
"""

import math

from numba import njit

from satsep_ot.dynamics.compilation import INLINE, KERNEL, smaller
from satsep_ot.dynamics.system import (
    ANCHOR,
    ANCHOR_TIME,
    GRAVITY_RATE,
    GRAVITY_RATE_SLOPE,
    INVERSE_RADIUS,
    INVERSE_SQUARE,
    MU,
)

EARTH_GRAVITATIONAL_PARAMETER = 3.986004418e14  # m3/s2, WGS 84
EARTH_RADIUS = 6378137.0  # m, equatorial, WGS 84

# An expansion of the orbit about its anchor serves this long [s]: its direction is then good to (n t)^3 / 6, 2e-9
# in low Earth orbit, and mu / r^3 to e (n t)^2, 5e-6 e, of an acceleration of 1e-6 m/s2 a metre.
ANCHOR_LIFE = 2.0


@njit(**KERNEL)
def place_anchor(c):
    """Fill the constants that follow from the anchor's position and velocity."""
    x = c[ANCHOR]
    y = c[ANCHOR + 1]
    z = c[ANCHOR + 2]
    inverse_square = 1.0 / (x * x + y * y + z * z)
    c[INVERSE_SQUARE] = inverse_square
    c[INVERSE_RADIUS] = math.sqrt(inverse_square)
    rate = c[MU] * inverse_square * c[INVERSE_RADIUS]
    c[GRAVITY_RATE] = rate
    drift = x * c[ANCHOR + 3] + y * c[ANCHOR + 4] + z * c[ANCHOR + 5]
    c[GRAVITY_RATE_SLOPE] = -3.0 * rate * drift * inverse_square
    for n in range(3):
        c[ANCHOR + 6 + n] = -rate * c[ANCHOR + n]


@njit(**KERNEL)
def move_anchor(t, c):
    """Carry the anchor forward to t on its Kepler orbit, in strides of at most its life, by the f and g series."""
    while c[ANCHOR_TIME] < t:
        h = smaller(t - c[ANCHOR_TIME], ANCHOR_LIFE)
        u = c[GRAVITY_RATE]
        p = -c[GRAVITY_RATE_SLOPE] / (3.0 * u)
        q = -u
        for n in range(3):
            q += c[ANCHOR + 3 + n] * c[ANCHOR + 3 + n] * c[INVERSE_SQUARE]
        # Terms of the fourth order in h, and their derivatives: 1e-9 m a stride in low Earth orbit.
        f3 = 0.5 * u * p
        f4 = u * (3.0 * q - 15.0 * p * p + u) / 24.0
        g4 = 0.25 * u * p
        f = 1.0 + h * h * (-0.5 * u + h * (f3 + h * f4))
        g = h * (1.0 + h * h * (-u / 6.0 + h * g4))
        f_rate = h * (-u + h * (3.0 * f3 + h * 4.0 * f4))
        g_rate = 1.0 + h * h * (-0.5 * u + h * 4.0 * g4)
        for n in range(3):
            position = c[ANCHOR + n]
            velocity = c[ANCHOR + 3 + n]
            c[ANCHOR + n] = f * position + g * velocity
            c[ANCHOR + 3 + n] = f_rate * position + g_rate * velocity
        c[ANCHOR_TIME] += h
        place_anchor(c)


@njit(**INLINE)
def earth_vector(t, c, w, x, y, z):
    """The platform's CG from the Earth's centre [m] in platform axes (attitude w, x, y, z), and mu / r^3 there."""
    h = t - c[ANCHOR_TIME]
    ex = c[ANCHOR] + h * (c[ANCHOR + 3] + h * 0.5 * c[ANCHOR + 6])
    ey = c[ANCHOR + 1] + h * (c[ANCHOR + 4] + h * 0.5 * c[ANCHOR + 7])
    ez = c[ANCHOR + 2] + h * (c[ANCHOR + 5] + h * 0.5 * c[ANCHOR + 8])
    # The transposed rotation: v + 2 u x (u x v) - 2 w u x v with u the vector part.
    ax = 2.0 * (y * ez - z * ey)
    ay = 2.0 * (z * ex - x * ez)
    az = 2.0 * (x * ey - y * ex)
    return (
        ex - w * ax + y * az - z * ay,
        ey - w * ay + z * ax - x * az,
        ez - w * az + x * ay - y * ax,
        c[GRAVITY_RATE] + h * c[GRAVITY_RATE_SLOPE],
    )


@njit(**KERNEL)
def differential_gravity(rate, rx, ry, rz, dx, dy, dz):
    """g(r + d) - g(r) [m/s2] by Battin's formula, with rate = mu / |r|^3 [1/s2].

    Direct subtraction would lose nine of sixteen digits for d of some metres at |r| of 7e6 m.
    """
    q = (dx * (dx + 2.0 * rx) + dy * (dy + 2.0 * ry) + dz * (dz + 2.0 * rz)) / (rx * rx + ry * ry + rz * rz)
    w = (1.0 + q) * math.sqrt(1.0 + q)
    f = -q * (3.0 + q * (3.0 + q)) / (w * (1.0 + w))
    return -rate * (dx + f * (rx + dx)), -rate * (dy + f * (ry + dy)), -rate * (dz + f * (rz + dz))


@njit(**INLINE)
def near_differential_gravity(rate, inverse_square, rx, ry, rz, dx, dy, dz):
    """The same for |d| up to some kilometres, with 1 / |r|^2 given and (1 + q)^(-3/2) - 1 by its series.

    q is 1e-6 here, where the first term left out does not exist in double precision; at 1 km it is 1e-14 of d's share.
    """
    q = (dx * (dx + 2.0 * rx) + dy * (dy + 2.0 * ry) + dz * (dz + 2.0 * rz)) * inverse_square
    f = -q * (1.5 - q * (1.875 - q * (2.1875 - q * 2.4609375)))
    return -rate * (dx + f * (rx + dx)), -rate * (dy + f * (ry + dy)), -rate * (dz + f * (rz + dz))


@njit(**INLINE)
def gradient_torque(rate, nx, ny, nz, hx, hy, hz):
    """3 mu/r^3 n x (I n) [N m] with the unit vector n to (or from) the Earth and h = I n, all in body axes."""
    return 3.0 * rate * (ny * hz - nz * hy), 3.0 * rate * (nz * hx - nx * hz), 3.0 * rate * (nx * hy - ny * hx)
