"""Force laws: how hard a spring pushes at a stroke. A new law is one function and one row of `ForceLaw`.

A law takes the spring (a record), the cubics of all force-stroke tables and the stroke s, and returns the force f [N]
and its derivatives with respect to s, to the spring's stiffness and to its deformation. The spring's scale multiplies
all four.

The interpolation of tables is made in `satsep_ot.dynamics.springs`.
"""

import enum
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from satsep_ot.dynamics.kernels.compilation import choice, inline, kernel, larger


def linear_law(spring, cubics, s):
    """K (xi - s)."""
    gap = spring.deformation - s
    return spring.stiffness * gap, -spring.stiffness, gap, spring.stiffness


@inline
def cubic_at(spring, cubics, s):
    """The cubic of the table of a spring at a stroke: the first one also before its start."""
    low = spring.first_cubic
    high = spring.first_cubic + spring.cubic_number
    while high - low > 1:
        middle = (low + high) // 2
        if s >= cubics[middle].start:
            low = middle
        else:
            high = middle
    return low


def table_law(spring, cubics, s):
    """A measured force-stroke table, by the cubic that holds; stiffness and deformation play no part."""
    k = spring.cubic if spring.cubic >= 0 else cubic_at(spring, cubics, s)
    z = s - cubics[k].start
    a = cubics[k].coefficients
    return a[0] + z * (a[1] + z * (a[2] + z * a[3])), a[1] + z * (2.0 * a[2] + z * 3.0 * a[3]), 0.0, 0.0


def friction_law(spring, cubics, s):
    """Pins that hold back with a constant force, the spring's scale [N], while the bodies slide apart."""
    return -1.0, 0.0, 0.0, 0.0


class Law(NamedTuple):
    """A row of `ForceLaw`: the function of a law, and what is true of it."""

    function: Callable
    is_linear: bool = False  # f = a + b s, whatever a and b depend on: guided springs of such laws are summed up
    has_stiffness: bool = False  # stiffness and deformation say how hard it pushes, and it ends at s = deformation
    has_table: bool = False  # its force is a table's, at whose knots it bends and steps end
    holds_back: bool = False  # takes energy, and acts from the first push of another spring on


class ForceLaw(enum.IntEnum):
    """How the force of a spring depends on its stroke; each has the attributes of its `Law`."""

    LINEAR = Law(linear_law, is_linear=True, has_stiffness=True)
    TABLE = Law(table_law, has_table=True)
    FRICTION = Law(friction_law, is_linear=True, holds_back=True)

    function: Callable
    is_linear: bool
    has_stiffness: bool
    has_table: bool
    holds_back: bool

    def __new__(cls, *law):
        member = int.__new__(cls, len(cls.__members__))
        member._value_ = int(member)
        for name, value in Law(*law)._asdict().items():
            setattr(member, name, value)
        return member


_force = choice([law.function for law in ForceLaw])


@inline
def force(spring, cubics, s):
    """The force of a spring at the stroke s before its scale, and its three derivatives."""
    return _force(spring.law, spring, cubics, s)


@kernel
def next_knot(spring, cubics, s):
    """The first stroke beyond s at which the table of a spring starts another cubic."""
    k = cubic_at(spring, cubics, s)
    if cubics[k].start > s:
        return cubics[k].start
    return cubics[k + 1].start if k + 1 < spring.first_cubic + spring.cubic_number else np.inf


@kernel
def steepest_slope_and_work(spring, cubics, stroke):
    """The steepest slope of the force up to a stroke [N/m] and its work [J], without the scale.

    Close enough for a step size and a typical velocity.
    """
    start, slope, _, _ = force(spring, cubics, 0.0)
    if spring.is_linear:
        end, _, _, _ = force(spring, cubics, stroke)
        return abs(slope), 0.5 * stroke * (start + end)
    steepest = 0.0
    work = 0.0
    for n in range(8):
        value, slope, _, _ = force(spring, cubics, stroke * n / 8.0)
        steepest = larger(steepest, abs(slope))
        work += abs(value) * stroke / 8.0
    return steepest, work
