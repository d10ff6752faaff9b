"""Gravity as a separation feels it: the difference between two nearby points, and the gradient torque.

Sources: Battin, *An Introduction to the Mathematics and Methods of Astrodynamics* (1999), section 8.4 (difference of
two nearby central accelerations without cancellation) and 3.4 (Lagrange's f and g series); Wie, *Space Vehicle
Dynamics and Control* (2008), section 6.10 (gravity-gradient torque).
"""

import math

from numba import njit

from satsep_ot.dynamics.compilation import KERNEL

EARTH_GRAVITATIONAL_PARAMETER = 3.986004418e14  # m3/s2, WGS 84
EARTH_RADIUS = 6378137.0  # m, equatorial, WGS 84


@njit(**KERNEL)
def differential_gravity(rate, rx, ry, rz, dx, dy, dz):
    """g(r + d) - g(r) [m/s2] by Battin's formula, with rate = mu / |r|^3 [1/s2].

    Direct subtraction would lose nine of sixteen digits for d of some metres at |r| of 7e6 m.
    """
    q = (dx * (dx + 2.0 * rx) + dy * (dy + 2.0 * ry) + dz * (dz + 2.0 * rz)) / (rx * rx + ry * ry + rz * rz)
    w = (1.0 + q) * math.sqrt(1.0 + q)
    f = -q * (3.0 + q * (3.0 + q)) / (w * (1.0 + w))
    return -rate * (dx + f * (rx + dx)), -rate * (dy + f * (ry + dy)), -rate * (dz + f * (rz + dz))


@njit(**KERNEL)
def orbit_position(t, mu, rx, ry, rz, vx, vy, vz):
    """Position [m] at t [s] on the Kepler orbit through (r, v) at t = 0, by the f and g series to t^4.

    The first term left out is about |r| (n t)^5 / 120: 2e-6 m after 5 s in low Earth orbit, where the push lasts 0.1 s.
    """
    radius_squared = rx * rx + ry * ry + rz * rz
    u = mu / (radius_squared * math.sqrt(radius_squared))
    p = (rx * vx + ry * vy + rz * vz) / radius_squared
    q = (vx * vx + vy * vy + vz * vz) / radius_squared - u
    f = 1.0 + t * t * (-0.5 * u + t * (0.5 * u * p + t * (u * (3.0 * q - 15.0 * p * p + u) / 24.0)))
    g = t * (1.0 + t * t * (-u / 6.0 + t * 0.25 * u * p))
    return f * rx + g * vx, f * ry + g * vy, f * rz + g * vz


@njit(**KERNEL)
def gradient_torque(rate, nx, ny, nz, hx, hy, hz):
    """3 mu/r^3 n x (I n) [N m] with the unit vector n to (or from) the Earth and h = I n, all in body axes."""
    return 3.0 * rate * (ny * hz - nz * hy), 3.0 * rate * (nz * hx - nx * hz), 3.0 * rate * (nx * hy - ny * hx)
