"""Separation springs: where they act, how hard they push, and the reverse-mode derivative of that.

A force line says along which direction a spring pushes and where. Every force line gives, from the vector `delta`
between the two seats (platform axes), a stroke `s` and a unit vector; the force on the satellite is K (xi - s) along
it, applied at the satellite's seat, and its opposite acts on the platform at the same point, so momentum is exact.

* GUIDED: along the guide, n fixed in the platform; s = delta . n. It derives from V = K (xi - s)^2 / 2.
* STRUT: along the line between ball ends, which start the stowed length l_0 > 0 apart; s = |delta| - l_0.
  Hu et al. (2017), equation 8, is its limit l_0 -> 0, which is ill-posed: a zero-length strut buckles.

Row of the spring table: see the constants below. Hu et al. (2017), equations 4 to 8.
"""

import enum
import math

from numba import njit

from satsep_ot.dynamics.compilation import KERNEL


class ForceLine(enum.IntEnum):
    """Along which line a spring pushes."""

    GUIDED = 0
    STRUT = 1


GUIDED, STRUT = 0, 1  # the same, for the kernels

# Columns of the spring table of a run. Platform seat from the platform's CG, satellite seat from the satellite's CG
# (each in its body's axes), guide direction in platform axes, then stiffness, deformation, release stroke, delay.
PLATFORM_SEAT, SATELLITE_SEAT, GUIDE = 0, 3, 6
STIFFNESS, DEFORMATION, RELEASE_STROKE, DELAY = 9, 10, 11, 12
SPRING_COLUMNS = 13


@njit(**KERNEL)
def push_direction(system, i, px, py, pz):
    """Stroke and unit force direction (platform axes) of spring i, its satellite seat at p from the platform's CG."""
    spring, stowed_length = system.springs, system.c[37]
    ex, ey, ez = px - spring[i, 0], py - spring[i, 1], pz - spring[i, 2]
    if system.force_line == GUIDED:
        nx, ny, nz = spring[i, 6], spring[i, 7], spring[i, 8]
        return ex * nx + ey * ny + ez * nz - stowed_length, nx, ny, nz
    length = math.sqrt(ex * ex + ey * ey + ez * ez)
    inverse = 1.0 / length
    return length - stowed_length, ex * inverse, ey * inverse, ez * inverse
