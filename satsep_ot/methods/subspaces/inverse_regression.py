"""Directions from values alone by the older ways, to compare ridge approximation with."""

import math

import numpy as np
from scipy import linalg

from satsep_ot.methods.subspaces.estimation import estimate_subspace, orient


def _checked(points, values, dimension, least):
    points, values = np.asarray(points, dtype=float), np.asarray(values, dtype=float)
    if points.ndim != 2 or values.shape != (len(points),):
        raise ValueError(f"Points (n, d) and values (n,) are needed, got {points.shape} and {values.shape}.")
    if not (np.isfinite(points).all() and np.isfinite(values).all()):
        raise ValueError("Directions need finite points and values.")
    if not 1 <= dimension <= points.shape[1]:
        raise ValueError(f"The dimension is {dimension}; it must be 1 to {points.shape[1]}.")
    if len(points) < least:
        raise ValueError(f"{points.shape[1]} inputs need at least {least} points, got {len(points)}.")
    return points, values


def slicedInverseRegression(points: np.ndarray, values: np.ndarray, dimension: int, slices: int = 10) -> np.ndarray:
    """Directions from the means of the inputs over slices of the output.

    Blind to functions that are even along a direction: there the means of all slices are 0.

    Parameters
    ----------
    points : ndarray (n, d)
        In the standard normal space, n > d.
    values : ndarray (n,)
    dimension : int
        Number of directions, 1 to d.
    slices : int
        Groups of nearly equal size, more than ``dimension``.

    Returns
    -------
    ndarray (d, dimension)
        Orthonormal columns, largest component positive.

    Raises
    ------
    ValueError
        Shapes, non-finite data, too few points or slices.

    References
    ----------
    Li, J. Am. Stat. Assoc. 86 (1991).

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.subspaces.inverse_regression import slicedInverseRegression
    >>> points = np.random.default_rng(0).standard_normal((2000, 3))
    >>> found = slicedInverseRegression(points, np.exp(points @ [0.6, 0.0, 0.8]), 1)[:, 0]
    >>> bool(abs(found - [0.6, 0.0, 0.8]).max() < 0.05)
    True
    """
    points, values = _checked(points, values, dimension, np.shape(points)[-1] + 1)
    if not dimension < slices <= len(points):
        raise ValueError(f"The number of slices is {slices}; it must be {dimension + 1} to {len(points)}.")
    centred = points - points.mean(axis=0)
    # Whitened: chance correlations of the sample would tilt the directions.
    triangle = linalg.qr(centred, mode="r")[0][: points.shape[1]] / math.sqrt(len(points))
    white = linalg.solve_triangular(triangle, centred.T, trans="T").T
    groups = np.array_split(np.argsort(values, kind="stable"), slices)
    means = np.stack([math.sqrt(len(group) / len(points)) * white[group].mean(axis=0) for group in groups])
    _, _, right = np.linalg.svd(means, full_matrices=True)
    return orient(linalg.qr(linalg.solve_triangular(triangle, right[:dimension].T), mode="economic")[0])


def localLinearDirections(
    points: np.ndarray, values: np.ndarray, dimension: int, neighbours: int | None = None
) -> np.ndarray:
    """Directions from gradients of linear fits to the neighbours of each point.

    Parameters
    ----------
    points, values, dimension
        As in :func:`slicedInverseRegression`.
    neighbours : int, optional
        Points of each fit, more than d + 1; by default 1.7 d, at least d + 2.

    Returns
    -------
    ndarray (d, dimension)
        Orthonormal columns, largest component positive.

    References
    ----------
    Constantine, Active Subspaces (SIAM 2015), algorithm 1.2.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.subspaces.inverse_regression import localLinearDirections
    >>> points = np.random.default_rng(0).standard_normal((500, 2))
    >>> localLinearDirections(points, (points @ [0.6, 0.8]) ** 2, 1)[:, 0].round(1).tolist()
    [0.6, 0.8]
    """
    d = np.shape(points)[-1]
    count = max(d + 2, math.ceil(1.7 * d)) if neighbours is None else neighbours
    if count < d + 2:
        raise ValueError(f"A linear fit in {d} inputs needs at least {d + 2} neighbours, got {count}.")
    points, values = _checked(points, values, dimension, count)
    gradients = np.empty((len(points), d, 1))
    for place, centre in enumerate(points):
        distances = ((points - centre) ** 2).sum(axis=1)
        near = np.argpartition(distances, count - 1)[:count]
        design = np.column_stack([np.ones(count), points[near] - centre])
        gradients[place, :, 0] = np.linalg.lstsq(design, values[near], rcond=None)[0][1:]
    return estimate_subspace(gradients)[1][:, :dimension]
