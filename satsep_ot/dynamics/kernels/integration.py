"""Explicit Runge-Kutta steps: the eighth-order method of Dormand and Prince, and the classical fourth-order one.

The eighth-order method carries the long stretches at the tolerance asked for; the fourth-order one the stretches that
are so short that its error is far below the tolerance (between two releases, and the last correction onto an event),
at a third of the cost. Source: Hairer, Norsett, Wanner, *Solving Ordinary Differential Equations I* (1993), sections
II.1, II.5 and II.6.
"""

import math

import numpy as np
from scipy.integrate import DOP853

from satsep_ot.dynamics.kernels.compilation import inline, integers, kernel
from satsep_ot.dynamics.kernels.contact import keep_normal_forces
from satsep_ot.dynamics.kernels.records import LANES, STAGES, STATE_SIZE
from satsep_ot.dynamics.kernels.rigid_body import derivative, derivative_adjoint
from satsep_ot.dynamics.kernels.vectors import add

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


@inline
def step_method(h, short):
    """The Runge-Kutta method for a step of length h."""
    return FOURTH_ORDER if abs(h) <= short else EIGHTH_ORDER


@inline
def copy_state(source, target):
    """Write a state over another one."""
    for n in range(STATE_SIZE):
        target.x[n] = source.x[n]


@inline
def combine(method, stage, h, step, target):
    """The state that a stage is taken at, or with STAGES the one at the step's end, into `target`.

    All slopes take part, those with a weight of 0 too: they must be finite. The sum over them has a fixed length, which
    the compiler unrolls. It goes to a fixed place first: the compiler makes vector instructions of the loop only where
    it sees that no slope lies where the loop writes.
    """
    for n in range(STATE_SIZE):
        total = 0.0
        for j in range(STAGES):
            total += STAGE_WEIGHTS[method, stage, j] * step.slope[j].x[n]
        step.combined.x[n] = step.stage[0].x[n] + h * total
    copy_state(step.combined, target)


@inline
def forget_slopes(step):
    """Make the slopes of a step finite that had none."""
    for j in range(STAGES):
        for n in range(STATE_SIZE):
            step.slope[j].x[n] = 0.0


@kernel
def stages(first, end, method, t, h, run):
    """Fill the stages first to end - 1 of a step of h [s] from `run.step.stage[0]`; those before are there."""
    step = run.step
    for i in range(first, end):
        state = step.stage[i]
        if i > 0:
            combine(method, i, h, step, state)
        derivative(t + C[method, i] * h, state, step.slope[i], run)
        keep_normal_forces(i, run)
    run.progress.evaluations += end - first


@inline
def finish(method, h, step):
    """Write the state at the end of the step into `step.end`, from its stages."""
    combine(method, STAGES, h, step, step.end)


@kernel
def full_step(method, t, state, h, run, out):
    """One whole step from a state to `out`, without error control."""
    copy_state(state, run.step.stage[0])
    stages(FIRST, STAGE_NUMBER[method], method, t, h, run)
    combine(method, STAGES, h, run.step, out)


@kernel
def error_ratio(h, step):
    """Estimated error of an eighth-order step over the error allowed, as in Hairer's DOP853."""
    # The sums stand where two stage states stood, which are not needed any more.
    fifth_order, third_order = step.stage[1].x, step.stage[2].x
    for n in range(STATE_SIZE):
        e5 = 0.0
        e3 = 0.0
        for i in range(STAGES):
            e5 += ERROR_5[i] * step.slope[i].x[n]
            e3 += ERROR_3[i] * step.slope[i].x[n]
        fifth_order[n] = e5
        third_order[n] = e3
    fifth = 0.0
    third = 0.0
    for n in range(STATE_SIZE):
        inverse = 1.0 / step.allowed.x[n]
        e5 = fifth_order[n] * inverse
        e3 = third_order[n] * inverse
        fifth += e5 * e5
        third += e3 * e3
    if fifth == 0.0:
        return 0.0
    return abs(h) * fifth / math.sqrt((fifth + 0.01 * third) * STATE_SIZE)


@kernel
def step_adjoint(method, t, state, h, run, sweep, by_state):
    """Pull the adjoint of the end of a step of h [s] from a state back to its start, in place."""
    step, chain = run.step, sweep.chain
    last = STAGE_NUMBER[method] - 1
    copy_state(state, step.stage[0])
    stages(FIRST, last + 1, method, t, h, run)
    by_end, by_slope, by_derivative = by_state.flat, chain.slope.flat, chain.derivative.flat
    for i in range(last, -1, -1):
        weight = h * B[method, i]
        for n in range(STATE_SIZE * LANES):
            by_slope[n] = weight * by_end[n]
        for n in range(LANES):
            chain.normal[n] = weight * chain.impulse[n]
        for later in range(i + 1, last + 1):
            weight = h * A[method, later, i]
            if weight != 0.0:
                by_later = chain.stage[later].flat
                for n in range(STATE_SIZE * LANES):
                    by_slope[n] += weight * by_later[n]
        derivative_adjoint(t + C[method, i] * h, step.stage[i], step.slope[i], run, sweep)
        by_stage = chain.stage[i].flat
        for n in range(STATE_SIZE * LANES):
            by_stage[n] = by_derivative[n]
    for i in range(last + 1):
        add(by_state, chain.stage[i])
