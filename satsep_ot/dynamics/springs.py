"""Separation springs: where they act and how hard they push.

A force line says along which direction a spring pushes, and where. Each gives, from the vector `delta` between the two
seats (platform axes), a stroke s, its gradient g with respect to the motion of the contact point, and that point p. The
force on the satellite is f(s) along g; its opposite acts on the platform at the same p, so momentum is exact, and the
power is f ds/dt, so that a spring's work is the integral of f over its stroke.

* GUIDED: along the guide, n_1 fixed in the platform, at the satellite's seat; s = delta . n_1, g = n_1.
* STRUT: along the line between ball ends, which start the stowed length l_0 > 0 apart; s = |delta| - l_0,
  g = delta / |delta|. Hu et al. (2017), equation 8, is its limit l_0 -> 0, which is ill-posed: a zero-length strut
  buckles.
* NORMAL: a rod in the guide whose foot slides on the satellite's plate, with the normal n_2 = satellite y, at
  p = seat + s n_1; s = delta . n_2 / (n_1 . n_2), g = n_2 / (n_1 . n_2). The rod's balance along the guide, with the
  lateral load and the guide's friction coefficient, f = N (n_1 . n_2 + friction |n_1 x n_2|), gives the contact force
  N; friction takes the part of the work that it should. Only this line loads the guide laterally.

A force law says how f depends on the stroke. Every law returns f, its derivative with respect to s, and those with
respect to the spring's stiffness and deformation; the spring's `scale` multiplies it.

Hu et al. (2017), equations 4 to 8; Fritsch and Carlson, "Monotone piecewise cubic interpolation", SIAM Journal on
Numerical Analysis 17 (1980), for the tables.
"""

import enum
import math
from collections.abc import Sequence

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from satsep_ot.dynamics.compilation import INLINE, KERNEL, known, larger
from satsep_ot.dynamics.system import (
    COLUMN,
    DEFORMATION,
    FORCE_LINE,
    GUIDE_FRICTION,
    LAW,
    MARK_COLUMNS,
    ROW,
    SCALE,
    SEGMENT_NUMBER,
    SPRING_COLUMNS,
    SPRING_MARKS,
    SPRINGS,
    STIFFNESS,
    STOWED_LENGTH,
    SUM_COLUMNS,
    SUM_ROWS,
    SUMS,
    TABLE_COLUMNS,
    TABLES,
    integers,
)


class ForceLine(enum.IntEnum):
    """Along which line a spring pushes."""

    GUIDED = 0
    STRUT = 1
    NORMAL = 2


class ForceLaw(enum.IntEnum):
    """How the force of a spring depends on its stroke."""

    LINEAR = 0
    TABLE = 1
    FRICTION = 2


# For the kernels, which take plain integers as constants.
GUIDED, STRUT, NORMAL = integers(*ForceLine)
LINEAR, TABLE, FRICTION = integers(*ForceLaw)


@njit(**INLINE)
def linear_law(stiffness, deformation, s):
    """K (xi - s)."""
    return stiffness * (deformation - s), -stiffness, deformation - s, stiffness


@njit(**KERNEL)
def table_law(c, marks, i, s):
    """A measured force-stroke table, by its cubics; stiffness and deformation play no part."""
    k = marks[TABLES] + TABLE_COLUMNS * marks[SEGMENT_NUMBER] * i
    last = k + TABLE_COLUMNS * (marks[SEGMENT_NUMBER] - 1)
    while k < last and s >= c[k + TABLE_COLUMNS]:
        k += TABLE_COLUMNS
    z = s - c[k]
    value = c[k + 1] + z * (c[k + 2] + z * (c[k + 3] + z * c[k + 4]))
    return value, c[k + 2] + z * (2.0 * c[k + 3] + z * 3.0 * c[k + 4]), 0.0, 0.0


@njit(**KERNEL)
def next_knot(c, marks, i, s):
    """The first stroke beyond s at which the table of spring i starts another cubic."""
    k = marks[TABLES] + TABLE_COLUMNS * marks[SEGMENT_NUMBER] * i
    for n in range(marks[SEGMENT_NUMBER]):
        if c[k + TABLE_COLUMNS * n] > s:
            return c[k + TABLE_COLUMNS * n]
    return np.inf


@njit(**INLINE)
def friction_law():
    """Pins that hold back with a constant force, the spring's scale [N], while the bodies slide apart."""
    return -1.0, 0.0, 0.0, 0.0


@njit(**INLINE)
def law(c, marks, i, s):
    """The force of spring i at the stroke s before its scale, and its three derivatives."""
    kind = marks[known(SPRING_MARKS + MARK_COLUMNS * i + LAW)]
    if kind == TABLE:
        return table_law(c, marks, i, s)
    if kind == FRICTION:
        return friction_law()
    k = known(SPRINGS + SPRING_COLUMNS * i)
    return linear_law(c[k + STIFFNESS], c[k + DEFORMATION], s)


@njit(**INLINE)
def contact(c, marks, i, qx, qy, qz, mx, my, mz):
    """Geometry of spring i, its satellite seat at q from the platform's CG and the satellite's y axis along m.

    Returns the stroke, its gradient g (3), the contact point (3, from the platform's CG), and the contact force along
    g for a unit spring force (below 1 where the guide rubs). All in platform axes.
    """
    k = known(SPRINGS + SPRING_COLUMNS * i)
    ex = qx - c[k]
    ey = qy - c[k + 1]
    ez = qz - c[k + 2]
    nx = c[k + 6]
    ny = c[k + 7]
    nz = c[k + 8]
    if marks[FORCE_LINE] == GUIDED:
        return ex * nx + ey * ny + ez * nz, nx, ny, nz, qx, qy, qz, 1.0
    if marks[FORCE_LINE] == STRUT:
        length = math.sqrt(ex * ex + ey * ey + ez * ez)
        inverse = 1.0 / length
        return length - c[STOWED_LENGTH], ex * inverse, ey * inverse, ez * inverse, qx, qy, qz, 1.0
    cosine = nx * mx + ny * my + nz * mz
    inverse = 1.0 / cosine
    s = (ex * mx + ey * my + ez * mz) * inverse
    sine = math.sqrt(larger(0.0, 1.0 - cosine * cosine))
    share = cosine / (cosine + c[GUIDE_FRICTION] * sine)
    return (
        s, mx * inverse, my * inverse, mz * inverse, c[k] + s * nx, c[k + 1] + s * ny, c[k + 2] + s * nz, share,
    )  # fmt: skip


@njit(**KERNEL)
def row_and_column(i, c, marks, w):
    """What guided spring i adds to the sums, as a row w[ROW:] and a column w[COLUMN:]: see `add_to_sums`."""
    k = known(SPRINGS + SPRING_COLUMNS * i)
    stiffness = c[k + SCALE] * c[k + STIFFNESS]
    constant = -c[k + SCALE]
    if marks[SPRING_MARKS + MARK_COLUMNS * i + LAW] == LINEAR:
        constant = stiffness * (c[k + DEFORMATION] + c[k] * c[k + 6] + c[k + 1] * c[k + 7] + c[k + 2] * c[k + 8])
    w[COLUMN] = constant
    for n in range(3):
        direction = c[k + 6 + n]
        w[ROW + n] = direction
        w[COLUMN + 1 + n] = -stiffness * direction
        for m in range(3):
            w[ROW + 3 + 3 * n + m] = direction * c[k + 3 + m]
            w[COLUMN + 4 + 3 * n + m] = -stiffness * direction * c[k + 3 + m]


@njit(**KERNEL)
def add_to_sums(i, sign, c, marks, w):
    """Add guided spring i to the sums, or take it away: they make the right-hand side independent of their number.

    With the guide n, the satellite's seat b in its axes, the platform's seat a, and d and R of the state, the force
    f = K (xi - n . (d + R b - a)) of a linear spring is the product of the column (K (xi + n . a), -K n, -K n b^T)
    with (1, d, R), and that of pins is -scale. The sums of f n and f n b^T, the rows (n, n b^T), give every force and
    moment. Tables are not linear: they are left to `spring_sums`.
    """
    if marks[SPRING_MARKS + MARK_COLUMNS * i + LAW] == TABLE or marks[FORCE_LINE] != GUIDED:
        return
    row_and_column(i, c, marks, w)
    for j in range(SUM_COLUMNS):
        factor = sign * w[COLUMN + j]
        for n in range(SUM_ROWS):
            c[known(SUMS + SUM_ROWS * j) + n] += factor * w[ROW + n]


def table_segments(tables: Sequence[ArrayLike | None], size: int) -> np.ndarray:
    """Force-stroke tables as piecewise cubics for the kernels.

    Parameters
    ----------
    tables : sequence of (array_like of shape (K, 2) or None)
        Rows of stroke [m] and force [N] for each spring, strokes strictly ascending.
    size : int
        Number of springs.

    Returns
    -------
    segments : ndarray, shape (size, K - 1, 5)
        Start of each segment and the coefficients of its cubic in (s - start), ascending: the monotone interpolation of
        Fritsch and Carlson. Unused segments start at infinity.
    """
    longest = max((len(table) - 1 for table in tables if table is not None), default=1)
    segments = np.zeros((size, longest, 5))
    segments[:, :, 0] = np.inf
    for i, table in enumerate(tables):
        if table is not None:
            cubics = PchipInterpolator(table[:, 0], table[:, 1])
            segments[i, : len(table) - 1, 0] = cubics.x[:-1]
            segments[i, : len(table) - 1, 1:] = cubics.c[::-1].T
    return segments
