"""The springs of a separation for its kernels, and for accounts of one run in Python.

Force laws are rows of `satsep_ot.dynamics.kernels.force_laws`, force lines of `satsep_ot.dynamics.kernels.force_lines`.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from satsep_ot.dynamics.kernels.force_laws import ForceLaw, Law
from satsep_ot.dynamics.kernels.force_lines import ForceLine, Line
from satsep_ot.dynamics.kernels.records import CUBIC, SPRING, memory

if TYPE_CHECKING:
    from satsep_ot.dynamics.separation import Springs

__all__ = ["ForceLaw", "ForceLine", "Law", "Line", "force_of", "spring_records", "table_cubics"]


def table_cubics(tables: Sequence[ArrayLike | None]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force-stroke tables as piecewise cubics for the kernels.

    Parameters
    ----------
    tables : sequence of (array_like of shape (K, 2) or None)
        Rows of stroke [m] and force [N] for each spring, strokes strictly ascending.

    Returns
    -------
    cubics : ndarray of records CUBIC
        One table after the other: the monotone interpolation of Fritsch and Carlson.
    first, number : ndarray of int, shape (N,)
        Where the cubics of each spring start, and how many they are.
    """
    number = np.array([0 if table is None else len(table) - 1 for table in tables])
    first = np.concatenate([[0], np.cumsum(number)[:-1]]).astype(np.int64)
    cubics = memory(int(number.sum()), CUBIC)
    for start, count, table in zip(first, number, tables, strict=True):
        if table is not None:
            pieces = PchipInterpolator(*np.asarray(table, dtype=float).T)
            cubics["start"][start : start + count] = pieces.x[:-1]
            cubics["coefficients"][start : start + count] = pieces.c[::-1].T
    return cubics, first, number


def spring_records(springs: "Springs", force_line: ForceLine) -> tuple[np.ndarray, np.ndarray]:
    """The springs as the kernels take them, without what the parameters of a run say.

    Parameters
    ----------
    springs : satsep_ot.dynamics.separation.Springs
    force_line : ForceLine

    Returns
    -------
    springs : ndarray of records SPRING, shape (N,)
    cubics : ndarray of records CUBIC
        Of all tables.
    """
    result = memory(len(springs), SPRING)
    cubics, result["first_cubic"], result["cubic_number"] = table_cubics(springs.tables)
    for name in ("stiffness", "deformation", "scale"):
        result[name] = getattr(springs, name)
    result["law"] = springs.laws
    for name in ("is_linear", "has_stiffness", "has_table", "holds_back"):
        result[name] = springs.law_property(name)
    result["in_sums"] = result["is_linear"] * force_line.is_fixed
    return result, cubics


def force_of(springs: "Springs", i: int, strokes: ArrayLike) -> np.ndarray:
    """The force of spring i [N] at some strokes [m], with its scale, as its law says it."""
    records, cubics = spring_records(springs, ForceLine.GUIDED)
    law = ForceLaw(springs.laws[i]).function
    forces = [law(records[i], cubics, stroke)[0] for stroke in np.ravel(strokes)]
    return springs.scale[i] * np.reshape(forces, np.shape(strokes))
