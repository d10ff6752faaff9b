"""Explicit Runge-Kutta steps: the eighth-order method of Dormand and Prince, and the classical fourth-order one.

The eighth-order method carries the long stretches at the tolerance asked for; the fourth-order one the stretches that
are so short that its error is far below the tolerance (between two releases, and the last correction onto an event),
at a third of the cost. Source: Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I* (1993), sections
II.1 and II.5.
"""

import math

import numpy as np
from numba import njit
from scipy.integrate import DOP853

from satsep_ot.dynamics.compilation import INLINE, KERNEL, known
from satsep_ot.dynamics.rigid_body import derivative
from satsep_ot.dynamics.system import ALLOWED, NEW, STAGES, STATE_SIZE, K, integers

EIGHTH_ORDER, FOURTH_ORDER = integers(0, 1)

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

# With B as one more stage.
STAGE_WEIGHTS = np.concatenate([A, B[:, None]], axis=1)
ERROR_5, ERROR_3 = DOP853.E5[:STAGES].copy(), DOP853.E3[:STAGES].copy()


# Where a step's stages start; and the stage behind the first.
FIRST, SECOND = integers(0, 1)


@njit(**INLINE)
def combine(method, stage, h, w, target):
    """The state that a stage is taken at, or with STAGES the one at the step's end, into w[target:].

    All slopes take part, those with a weight of 0 too: they must be finite. The sum over them has a fixed length, which
    the compiler unrolls.
    """
    at = known(target)
    for n in range(STATE_SIZE):
        total = 0.0
        for j in range(STAGES):
            total += STAGE_WEIGHTS[method, stage, j] * w[K + j * STATE_SIZE + n]
        w[at + n] = w[n] + h * total


@njit(**INLINE)
def forget_slopes(w):
    """Make the slopes of a step finite that had none."""
    for n in range(STAGES * STATE_SIZE):
        w[K + n] = 0.0


@njit(**KERNEL)
def stages(first, end, method, t, h, w, c, marks):
    """Fill the stages first to end - 1 of a step of h [s] from the state w[0:STATE_SIZE]; those before are there."""
    for i in range(first, end):
        at = known(i * STATE_SIZE)
        if i > 0:
            combine(method, i, h, w, at)
        derivative(t + C[method, i] * h, w, at, known(K + at), c, marks)


@njit(**INLINE)
def load(x, w):
    """Take the state x as the start of a step."""
    for n in range(STATE_SIZE):
        w[n] = x[n]


@njit(**INLINE)
def finish(method, h, w):
    """Write the state at the end of the step into w[NEW:], from its stages."""
    combine(method, STAGES, h, w, NEW)


@njit(**KERNEL)
def full_step(method, t, x, h, w, c, marks, out):
    """One whole step from x to `out`, without error control."""
    load(x, w)
    stages(FIRST, STAGE_NUMBER[method], method, t, h, w, c, marks)
    finish(method, h, w)
    for n in range(STATE_SIZE):
        out[n] = w[NEW + n]


@njit(**KERNEL)
def error_ratio(h, w):
    """Estimated error of an eighth-order step over the error allowed, as in Hairer's DOP853."""
    # The sums stand where two stage states stood, which are not needed any more.
    for n in range(STATE_SIZE):
        e5 = 0.0
        e3 = 0.0
        for i in range(STAGES):
            e5 += ERROR_5[i] * w[K + i * STATE_SIZE + n]
            e3 += ERROR_3[i] * w[K + i * STATE_SIZE + n]
        w[STATE_SIZE + n] = e5
        w[2 * STATE_SIZE + n] = e3
    fifth = 0.0
    third = 0.0
    for n in range(STATE_SIZE):
        inverse = 1.0 / w[ALLOWED + n]
        e5 = w[STATE_SIZE + n] * inverse
        e3 = w[2 * STATE_SIZE + n] * inverse
        fifth += e5 * e5
        third += e3 * e3
    if fifth == 0.0:
        return 0.0
    return abs(h) * fifth / math.sqrt((fifth + 0.01 * third) * STATE_SIZE)
