"""Separation springs: where they act and how hard they push.

A force line says along which direction a spring pushes and where. Every force line gives, from the vector `delta`
between the two seats (platform axes), a stroke `s` and a unit vector; the force on the satellite is K (xi - s) along
it, applied at the satellite's seat, and its opposite acts on the platform at the same point, so momentum is exact.

* GUIDED: along the guide, n fixed in the platform; s = delta . n. It derives from V = K (xi - s)^2 / 2.
* STRUT: along the line between ball ends, which start the stowed length l_0 > 0 apart; s = |delta| - l_0.
  Hu et al. (2017), equation 8, is its limit l_0 -> 0, which is ill-posed: a zero-length strut buckles.

Hu et al. (2017), equations 4 to 8.
"""

import enum
import math

from numba import njit

from satsep_ot.dynamics.compilation import KERNEL
from satsep_ot.dynamics.system import GUIDED, STOWED_LENGTH


class ForceLine(enum.IntEnum):
    """Along which line a spring pushes."""

    GUIDED = 0
    STRUT = 1


@njit(**KERNEL)
def push_direction(system, i, px, py, pz):
    """Stroke and unit force direction (platform axes) of spring i, its satellite seat at p from the platform's CG."""
    spring, stowed_length = system.springs, system.c[STOWED_LENGTH]
    ex, ey, ez = px - spring[i, 0], py - spring[i, 1], pz - spring[i, 2]
    if system.force_line == GUIDED:
        nx, ny, nz = spring[i, 6], spring[i, 7], spring[i, 8]
        return ex * nx + ey * ny + ez * nz - stowed_length, nx, ny, nz
    length = math.sqrt(ex * ex + ey * ey + ez * ez)
    inverse = 1.0 / length
    return length - stowed_length, ex * inverse, ey * inverse, ez * inverse
