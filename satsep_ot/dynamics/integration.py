"""Explicit Runge-Kutta steps: the eighth-order method of Dormand and Prince, and the classical fourth-order one.

The eighth-order method carries the long stretches at the tolerance asked for; the fourth-order one the stretches that
are so short that its error is far below the tolerance (between two releases, and the last correction onto an event),
at a third of the cost. Source: Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I* (1993), sections
II.1 and II.5.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.integrate import DOP853

from satsep_ot.dynamics.compilation import KERNEL
from satsep_ot.dynamics.rigid_body import derivative
from satsep_ot.dynamics.system import STATE_SIZE

STAGES = 12
EIGHTH_ORDER, FOURTH_ORDER = 0, 1

_classical_a = np.zeros((STAGES, STAGES))
_classical_a[1, 0], _classical_a[2, 1], _classical_a[3, 2] = 0.5, 0.5, 1.0
_classical_b = np.zeros(STAGES)
_classical_b[:4] = np.array([1.0, 2.0, 2.0, 1.0]) / 6.0
_classical_c = np.zeros(STAGES)
_classical_c[:4] = 0.0, 0.5, 0.5, 1.0

# Coefficients by method: A[method, stage, earlier stage], weights B, nodes C, number of stages; the error weights of
# the fifth and third order belong to the eighth-order method.
A = np.array([DOP853.A[:STAGES, :STAGES], _classical_a])
B = np.array([DOP853.B, _classical_b])
C = np.array([DOP853.C[:STAGES], _classical_c])
STAGE_NUMBER = np.array([STAGES, 4])
ERROR_5, ERROR_3 = DOP853.E5[:STAGES].copy(), DOP853.E3[:STAGES].copy()


class Work(NamedTuple):
    """Room for the stages of a step."""

    k: np.ndarray  # slopes (STAGES + 1, STATE_SIZE); the last row serves the corrections onto an event
    y: np.ndarray  # stage states (STAGES, STATE_SIZE)
    scale: np.ndarray  # error allowed in each component (STATE_SIZE,)


@njit(**KERNEL)
def stages(method, t, x, h, work, system):
    """Fill the stage states y and slopes k of one step of h [s] from x; k[0, :] must be the slope at x already."""
    k, y = work.k, work.y
    for n in range(STATE_SIZE):
        y[0, n] = x[n]
    for i in range(1, STAGE_NUMBER[method]):
        row = y[i]
        for n in range(STATE_SIZE):
            row[n] = 0.0
        for j in range(i):
            a = A[method, i, j]
            if a != 0.0:
                for n in range(STATE_SIZE):
                    row[n] += a * k[j, n]
        for n in range(STATE_SIZE):
            row[n] = x[n] + h * row[n]
        derivative(t + C[method, i] * h, row, k, i, system)


@njit(**KERNEL)
def finish(method, h, work, out):
    """Write the state at the end of the step into `out`, from its stages; `out` may be the state at its start."""
    k, y = work.k, work.y
    for n in range(STATE_SIZE):
        out[n] = 0.0
    for i in range(STAGE_NUMBER[method]):
        b = B[method, i]
        if b != 0.0:
            for n in range(STATE_SIZE):
                out[n] += b * k[i, n]
    for n in range(STATE_SIZE):
        out[n] = y[0, n] + h * out[n]


@njit(**KERNEL)
def full_step(method, t, x, h, work, system, out):
    """One whole step from x, without error control."""
    derivative(t, x, work.k, 0, system)
    stages(method, t, x, h, work, system)
    finish(method, h, work, out)


@njit(**KERNEL)
def error_ratio(h, work):
    """Estimated error of an eighth-order step over the error allowed, as in Hairer's DOP853."""
    k, scale = work.k, work.scale
    fifth = third = 0.0
    for n in range(STATE_SIZE):
        e5 = e3 = 0.0
        for i in range(STAGES):
            e5 += ERROR_5[i] * k[i, n]
            e3 += ERROR_3[i] * k[i, n]
        fifth += (e5 / scale[n]) ** 2
        third += (e3 / scale[n]) ** 2
    if fifth == 0.0:
        return 0.0
    return abs(h) * fifth / math.sqrt((fifth + 0.01 * third) * STATE_SIZE)
