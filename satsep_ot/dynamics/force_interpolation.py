"""Force-stroke tables as piecewise cubics: through every row of a short table, a fit to a long one.

The monotone interpolation takes the slopes of Fritsch and Butland, "A method for constructing local monotone piecewise
cubic interpolants", SIAM Journal on Scientific and Statistical Computing 5 (1984), as SciPy's `PchipInterpolator`.
"""

import enum

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator, PPoly

# A table of more rows is noise between one row and the next, as a load cell writes it: its rows are fitted.
MOST_ROWS = 100
_FEWEST_PIECES, _MOST_PIECES = 16, 128
# The work up to any stroke may differ from that of the rows by this share of the whole.
_WORK_ERROR = 1e-3
_NODES, _WEIGHTS = legendre.leggauss(4)


class Interpolation(enum.IntEnum):
    """How the force is interpolated between the rows of a table."""

    MONOTONE = 0
    LINES = 1


def interpolant(table: ArrayLike, interpolation: Interpolation = Interpolation.MONOTONE) -> PPoly:
    """The force [N] over the stroke [m] through every row of a table, shape (K, 2).

    Examples
    --------
    >>> from satsep_ot.dynamics.force_interpolation import Interpolation, interpolant
    >>> round(float(interpolant([[0.0, 220.0], [0.02, 100.0]], Interpolation.LINES)(0.01)), 9)
    160.0
    """
    strokes, forces = np.asarray(table, dtype=float).T
    if interpolation is Interpolation.LINES:
        return PPoly([np.diff(forces) / np.diff(strokes), forces[:-1]], strokes)
    return PchipInterpolator(strokes, forces)


def force_pieces(
    table: ArrayLike, stroke: float, interpolation: Interpolation = Interpolation.MONOTONE
) -> tuple[np.ndarray, np.ndarray]:
    """The cubics that stand for a table in the kernels.

    Up to 100 rows they are the interpolant. Of a longer table they are continuous cubics, 16 up to the stroke and more
    where the work needs them, each with the work and the impulse of the interpolant, and else with the least squared
    difference from it. Their ends follow each other as in time under a constant force, closer at the start.

    Parameters
    ----------
    table : array_like, shape (K, 2)
        Rows of stroke [m] and force [N], strokes strictly ascending.
    stroke : float
        Nominal stroke of the spring [m].
    interpolation : Interpolation

    Returns
    -------
    starts : ndarray, shape (P,)
    coefficients : ndarray, shape (P, 4)
        Ascending, from the start of the piece on.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.dynamics.force_interpolation import force_pieces
    >>> strokes = np.linspace(0.0, 0.03, 1000)
    >>> starts, coefficients = force_pieces(np.column_stack([strokes, 220.0 - 5500.0 * strokes]), 0.03)
    >>> len(starts), bool(np.allclose(coefficients[:, 1], -5500.0))
    (16, True)
    """
    rows = interpolant(table, interpolation)
    pieces = rows
    if len(rows.x) > MOST_ROWS:
        number = _FEWEST_PIECES
        pieces = _fitted(rows, _ends(rows, stroke, number))
        while _work_error(pieces, rows) > _WORK_ERROR and number < _MOST_PIECES:
            number *= 2
            pieces = _fitted(rows, _ends(rows, stroke, number))
    coefficients = np.zeros((len(pieces.x) - 1, 4))
    coefficients[:, : len(pieces.c)] = pieces.c[::-1].T
    return pieces.x[:-1].copy(), coefficients


def _ends(rows, stroke, number):
    """Where the pieces begin and end."""
    ends = stroke * (np.arange(number + 1) / number) ** 2
    beyond = rows.x[-1] - stroke
    more = min(int(np.ceil(beyond / (ends[-1] - ends[-2]) - 1e-9)), number) if beyond > 0.0 else 0
    return np.concatenate([ends, stroke + beyond * np.arange(1, more + 1) / max(more, 1)])


def _fitted(rows, ends):
    """The continuous cubics with these ends: least squares, with the work and the impulse of the rows on each piece."""
    lengths = np.diff(ends)
    places = np.union1d(rows.x, ends)
    places = places[(places >= ends[0]) & (places <= ends[-1])]
    halves = 0.5 * np.diff(places)[:, None]
    nodes = (places[:-1, None] + halves + halves * _NODES).ravel()
    by_stroke = (halves * _WEIGHTS).ravel()
    # The bodies' speed grows as the square root of the work.
    by_time = by_stroke / np.sqrt(np.maximum(rows.antiderivative()(nodes), 1e-300))
    k = np.clip(np.searchsorted(ends, nodes, side="right") - 1, 0, len(lengths) - 1)
    z, count, index = (nodes - ends[k]) / lengths[k], len(ends), np.arange(len(nodes))
    # Values at the ends, and two functions of each piece that vanish there.
    basis = np.zeros((len(nodes), count + 2 * len(lengths)))
    basis[index, k], basis[index, k + 1] = 1.0 - z, z
    basis[index, count + k] = z * (1.0 - z)
    basis[index, count + len(lengths) + k] = z * (1.0 - z) * (2.0 * z - 1.0)
    conditions = np.zeros((2 * len(lengths), len(nodes)))
    for row, weights in enumerate((by_stroke, by_time)):
        conditions[row * len(lengths) + k, index] = weights / np.bincount(k, weights)[k]
    forces, share = rows(nodes), by_stroke[:, None] / ends[-1]
    bound = conditions @ basis
    matrix = np.block([[basis.T @ (share * basis), bound.T], [bound, np.zeros((len(bound), len(bound)))]])
    given = np.concatenate([basis.T @ (share[:, 0] * forces), conditions @ forces])
    values, bend, twist = np.split(
        np.linalg.lstsq(matrix, given, rcond=None)[0][: basis.shape[1]], [count, count + len(lengths)]
    )
    # z (1 - z) (2 z - 1) = -z + 3 z^2 - 2 z^3.
    slope = np.diff(values) + bend - twist
    return PPoly(
        np.array([-2.0 * twist / lengths**3, (3.0 * twist - bend) / lengths**2, slope / lengths, values[:-1]]), ends
    )


def _work_error(pieces, rows):
    """The largest difference of the work up to a stroke, as a share of the whole."""
    ends = pieces.x[-1]
    strokes = np.union1d(np.linspace(0.0, ends, 4001), rows.x[rows.x <= ends])
    work = rows.antiderivative()(strokes)
    return np.abs(pieces.antiderivative()(strokes) - work).max() / max(np.abs(work).max(), 1e-300)
