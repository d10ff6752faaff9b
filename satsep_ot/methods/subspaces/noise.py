"""Noise of a computed function."""

import math
from collections.abc import Callable

import numpy as np


def estimate_noise(
    function: Callable, point: np.ndarray, direction: np.ndarray, spacing: float = 1e-6
) -> tuple[np.ndarray, int]:
    """Level of the noise of a computed function along a line (Moré and Wild, SIAM J. Sci. Comput. 33, 2011).

    Parameters
    ----------
    function : callable
        (n, d) ndarray to (n, p) ndarray.
    point, direction : ndarray (d,)
    spacing : float
        First distance of the nine points along the line; it is adapted.

    Returns
    -------
    noise : ndarray (p,)
        Standard deviation of the noise of each output; rounding level where none is seen.
    evaluations : int
    """
    order = 8
    evaluations = 0
    rounding = noise = np.empty(0)
    for attempt in range(4):
        line = point + spacing * (np.arange(order + 1) - order / 2)[:, None] * direction
        values = function(line)
        evaluations += len(line)
        if attempt == 0:
            rounding = np.finfo(float).eps * np.abs(values).max(axis=0)
            noise = np.full(values.shape[1], np.nan)
        differences = values
        levels, changes = [], []
        for k in range(1, order + 1):
            differences = np.diff(differences, axis=0)
            gamma = math.factorial(k) ** 2 / math.factorial(2 * k)
            levels.append(np.sqrt(gamma * np.mean(differences**2, axis=0)))
            changes.append((differences.min(axis=0) < 0.0) & (differences.max(axis=0) > 0.0))
        levels, changes = np.array(levels), np.array(changes)
        for k in range(order - 3):
            window = levels[k : k + 3]
            agree = (window.max(axis=0) <= 4.0 * window.min(axis=0)) & changes[k]
            fresh = np.isnan(noise) & agree
            noise[fresh] = window[0][fresh]
        still = np.mean(np.diff(values, axis=0) == 0.0, axis=0) > 0.5
        if not np.isnan(noise).any():
            break
        # Too close when values repeat, too far when the smooth part dominates every difference.
        spacing *= 100.0 if still[np.isnan(noise)].any() else 0.01
    return np.maximum(np.where(np.isnan(noise), rounding, noise), rounding), evaluations
