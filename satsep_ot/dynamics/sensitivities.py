"""Exact derivatives of a run by the reverse mode: the tape of steps is walked backwards, with eight outputs at a time.

A step is differentiated as it was taken (a discrete adjoint, step lengths frozen). The length of a step that ends in
an event is not frozen: it follows from the event's condition, so a release or an exit moves with the inputs. With
phi(x) = 0 the condition, f the slope there and lambda the adjoint of the state at the event,

    lambda* = lambda - phi_x (lambda . f + mu) / (phi_x . f)

is the adjoint of the step's end at frozen length, mu the adjoint of the event's time. The state is continuous across a
release although the force jumps, so nothing else is needed. Sources: Galan, Feehery, Barton, "Parametric sensitivity
functions for hybrid discrete/continuous systems", Applied Numerical Mathematics 31 (1999); Hairer, Norsett, Wanner
(1993), section II.6.
"""

import math

import numpy as np
from numba import njit

from satsep_ot.dynamics.compilation import INLINE, KERNEL, known, larger
from satsep_ot.dynamics.flight import (
    AT_EXIT,
    AT_START,
    INSIDE,
    NOTHING,
    PUSH_STARTS,
    RELEASE,
    clear_sums,
    nearest_wall,
    point_motion,
    switch,
)
from satsep_ot.dynamics.gravity import earth_vector
from satsep_ot.dynamics.integration import (
    EIGHTH_ORDER,
    FIRST,
    SECOND,
    STAGE_NUMBER,
    A,
    B,
    C,
    load,
    stages,
)
from satsep_ot.dynamics.rigid_body import seat_motion, spring_sums, times
from satsep_ot.dynamics.rotations import rotation_matrix_elements
from satsep_ot.dynamics.separation import (
    ANGULAR_IMPULSE,
    COMMON_SIZE,
    FRICTION_COEFFICIENT,
    IMPULSE,
    MOUNTING_ERROR,
    RATES,
    RECESS_DEPTH,
    RECESS_RADIUS,
    SPRING_SIZE,
    STOWED,
)
from satsep_ot.dynamics.springs import FRICTION, GUIDED, LINEAR, STRUT, TABLE, contact, law, row_and_column
from satsep_ot.dynamics.system import (
    ACTIVE,
    COLUMN,
    DEFORMATION,
    FORCE_LINE,
    FORCES,
    GRAVITY_LEVEL,
    GUIDE_FRICTION,
    INVERSE_RADIUS,
    INVERSE_REDUCED_MASS,
    LAW,
    MARK_COLUMNS,
    PLANE_COLUMNS,
    PLANE_NUMBER,
    PLANES,
    PLATFORM_INERTIA,
    PLATFORM_INVERSE_INERTIA,
    POINT_COLUMNS,
    POINT_NUMBER,
    POINTS,
    PUSHING,
    ROW,
    SATELLITE_CG,
    SATELLITE_INERTIA,
    SATELLITE_INVERSE_INERTIA,
    SCALE,
    SPRING_COLUMNS,
    SPRING_MARKS,
    SPRING_NUMBER,
    SPRINGS,
    STAGES,
    START,
    STATE_SIZE,
    STIFFNESS,
    SUM_COLUMNS,
    SUM_ROWS,
    SUMS,
    K,
    integers,
)

LANES = 8  # outputs differentiated together: one vector register of the processor

# A sweep works in one flat array of rows with LANES numbers each, at offsets that the compiler knows, so that it can
# make vector instructions of the loops over lanes:
# adjoints of the state, of the time, of a slope, of the state that the slope is taken at; sums over springs (adjoints
# of force 0-2, moment on the satellite 3-5 and on the platform 6-8 in platform axes, d 9-11, moments in body axes
# 12-17); two rotation matrices; what one spring or body adds to the constants; the state beside the chain; the stages.
LAM, MU, KB, OUT, S, M, X, BRANCH, YB = integers(0, 20, 21, 41, 61, 79, 97, 141, 161)
THREE, NINE, ROWS = integers(3, 9, STATE_SIZE)
# Then those of the sums of the guided springs, and of the constants of a run: reduced mass, inertia tensors, stowed
# length, guide friction, a block a spring (platform seat, satellite seat, guide, stiffness, deformation, release
# stroke, delay, scale); behind them the CGs, the recess's radius and depth, and the offsets of its planes.
MATRIX = YB + STAGES * STATE_SIZE
G = MATRIX + SUM_ROWS * SUM_COLUMNS
G_PLATFORM_INERTIA, G_SATELLITE_INERTIA, G_STOWED, G_FRICTION = G + 1, G + 10, G + 19, G + 20
G_SPRINGS, G_SPRING_SIZE = integers(G + 21, 14)
# What a spring adds, from row X: adjoints of its force 0-2, of its contact point 3-5, of its stroke 6, of the size of
# its force 7, of its satellite seat 8-10 and of the satellite's y axis 11-13 in platform axes, stowed length 14, guide
# friction 15, and its block 16-29.
X_BLOCK = X + 16


def places(row: int, count: int) -> np.ndarray:
    """Where `count` rows of a sweep's array start, from `row` on."""
    return integers(*range(LANES * row, LANES * (row + count), LANES))


# The places of rows in that array, and those of the rows behind a place: numba compiles every sum and product of an
# index at its own cost.
X0, X1, X2, X3, X4, X5, X6, X7, X8, X9, X10, X11, X12, X13, X14, X15 = places(X, 16)
B0, B1, B2, B3, B4, B5, B6, B7, B8, B9, B10, B11, B12, B13 = places(X_BLOCK, 14)
S0, S1, S2, S3, S4, S5, S6, S7, S8, S9, S10, S11, S12, S13, S14, S15, S16, S17 = places(S, 18)
M0, M1, M2, M3, M4, M5, M6, M7, M8, M9, M10, M11, M12, M13, M14, M15, M16, M17 = places(M, 18)
(
    KB0, KB1, KB2, KB3, KB4, KB5, KB6, KB7, KB8, KB9, KB10, KB11, KB12, KB13, KB14, KB15, KB16, KB17, KB18, KB19,
) = places(KB, 20)  # fmt: skip
(
    OUT0, OUT1, OUT2, OUT3, OUT4, OUT5, OUT6, OUT7, OUT8, OUT9,
    OUT10, OUT11, OUT12, OUT13, OUT14, OUT15, OUT16, OUT17, OUT18, OUT19,
) = places(OUT, 20)  # fmt: skip
LAM0, MU0, G0, G_STOWED0 = integers(*(LANES * np.array([LAM, MU, G, G_STOWED])))
L1, L2, L3, L4, L5, L6, L7, L8, L9, L10, L11, L12, L13 = places(1, 13)


def sweep_size(spring_number: int, plane_number: int) -> int:
    """Numbers that the working array of a sweep takes."""
    return LANES * (G_SPRINGS + G_SPRING_SIZE * spring_number + 8 + plane_number)


@njit(**INLINE)
def clear(a, row, count):
    """Set `count` rows from `row` on to zero."""
    for n in range(count * LANES):
        a[known(row * LANES) + n] = 0.0


@njit(**INLINE)
def add(a, source, target, count):
    """Add `count` rows from `source` on to those from `target` on."""
    for n in range(count * LANES):
        a[known(target * LANES) + n] += a[known(source * LANES) + n]


@njit(**KERNEL)
def add_rotation_adjoint(a, row, q0, q1, q2, q3, target):
    """Add to a quaternion adjoint, rows target to target + 3, what that of its matrix says, rows row to row + 8."""
    for n in range(LANES):
        m = known(row * LANES) + n
        m00 = a[m]
        m01 = a[m + L1]
        m02 = a[m + L2]
        m10 = a[m + L3]
        m11 = a[m + L4]
        m12 = a[m + L5]
        m20 = a[m + L6]
        m21 = a[m + L7]
        m22 = a[m + L8]
        o = known(target * LANES) + n
        a[o] += 2.0 * (q3 * (m10 - m01) + q2 * (m02 - m20) + q1 * (m21 - m12))
        a[o + L1] += 2.0 * (q2 * (m01 + m10) + q3 * (m02 + m20) + q0 * (m21 - m12) - 2.0 * q1 * (m11 + m22))
        a[o + L2] += 2.0 * (q1 * (m01 + m10) + q3 * (m12 + m21) + q0 * (m02 - m20) - 2.0 * q2 * (m00 + m22))
        a[o + L3] += 2.0 * (q1 * (m02 + m20) + q2 * (m12 + m21) + q0 * (m10 - m01) - 2.0 * q3 * (m00 + m11))


@njit(**KERNEL)
def spring_adjoint(x, at, r, i, target, a, c, marks):
    """From the adjoints of spring i's force, contact point and stroke (rows X to X + 6) to all that they depend on.

    The adjoint of d is added to the rows from `target` on, that of Q's matrix to the rows from M on.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    k = known(SPRINGS + SPRING_COLUMNS * i)
    u = c[k + 3]
    v = c[k + 4]
    w = c[k + 5]
    qx = x[at] + r00 * u + r01 * v + r02 * w
    qy = x[at + 1] + r10 * u + r11 * v + r12 * w
    qz = x[at + 2] + r20 * u + r21 * v + r22 * w
    s, gx, gy, gz, _, _, _, share = contact(c, marks, i, qx, qy, qz, r01, r11, r21)
    value, slope, by_stiffness, by_deformation = law(c, marks, i, s)
    scale = c[k + SCALE]
    f = scale * value
    slope *= scale
    by_stiffness *= scale
    by_deformation *= scale
    dx = qx - c[k]
    dy = qy - c[k + 1]
    dz = qz - c[k + 2]
    if marks[FORCE_LINE] == GUIDED:
        for n in range(LANES):
            hx = a[X0 + n]
            hy = a[X1 + n]
            hz = a[X2 + n]
            along = hx * gx + hy * gy + hz * gz
            bar = a[X6 + n] + slope * along
            vx = bar * gx
            vy = bar * gy
            vz = bar * gz
            a[X7 + n] = along
            a[X8 + n] = vx + a[X3 + n]
            a[X9 + n] = vy + a[X4 + n]
            a[X10 + n] = vz + a[X5 + n]
            a[X11 + n] = 0.0
            a[X12 + n] = 0.0
            a[X13 + n] = 0.0
            a[X14 + n] = 0.0
            a[X15 + n] = 0.0
            a[B0 + n] = -vx
            a[B1 + n] = -vy
            a[B2 + n] = -vz
            a[B6 + n] = f * hx + bar * dx
            a[B7 + n] = f * hy + bar * dy
            a[B8 + n] = f * hz + bar * dz
    elif marks[FORCE_LINE] == STRUT:
        # The direction turns with the seats: d g = (1 - g g^T) d delta / |delta|.
        turning = f / math.sqrt(dx * dx + dy * dy + dz * dz)
        for n in range(LANES):
            hx = a[X0 + n]
            hy = a[X1 + n]
            hz = a[X2 + n]
            along = hx * gx + hy * gy + hz * gz
            bar = a[X6 + n] + slope * along
            vx = bar * gx + turning * (hx - along * gx)
            vy = bar * gy + turning * (hy - along * gy)
            vz = bar * gz + turning * (hz - along * gz)
            a[X7 + n] = along
            a[X8 + n] = vx + a[X3 + n]
            a[X9 + n] = vy + a[X4 + n]
            a[X10 + n] = vz + a[X5 + n]
            a[X11 + n] = 0.0
            a[X12 + n] = 0.0
            a[X13 + n] = 0.0
            a[X14 + n] = -bar
            a[X15 + n] = 0.0
            a[B0 + n] = -vx
            a[B1 + n] = -vy
            a[B2 + n] = -vz
            a[B6 + n] = 0.0
            a[B7 + n] = 0.0
            a[B8 + n] = 0.0
    else:
        # F = N n_2 with N = f / D, D = cosine + friction * sine, p = seat + s n_1, s = delta . n_2 / cosine.
        nx = c[k + 6]
        ny = c[k + 7]
        nz = c[k + 8]
        cosine = nx * r01 + ny * r11 + nz * r21
        sine = math.sqrt(larger(0.0, 1.0 - cosine * cosine))
        balance = cosine / share
        # The friction is kinked where rod and plate are aligned: 0 is one of its slopes there.
        bend = 1.0 - c[GUIDE_FRICTION] * cosine / sine if sine > 1e-12 else 1.0
        force = f / balance
        inverse = 1.0 / cosine
        for n in range(LANES):
            hx = a[X0 + n]
            hy = a[X1 + n]
            hz = a[X2 + n]
            cx = a[X3 + n]
            cy = a[X4 + n]
            cz = a[X5 + n]
            along = (hx * r01 + hy * r11 + hz * r21) / balance
            bar = (a[X6 + n] + slope * along + cx * nx + cy * ny + cz * nz) * inverse
            by_balance = -along * force
            by_cosine = by_balance * bend - bar * s
            a[X7 + n] = along
            a[X8 + n] = bar * r01
            a[X9 + n] = bar * r11
            a[X10 + n] = bar * r21
            a[X11 + n] = force * hx + bar * dx + by_cosine * nx
            a[X12 + n] = force * hy + bar * dy + by_cosine * ny
            a[X13 + n] = force * hz + bar * dz + by_cosine * nz
            a[X14 + n] = 0.0
            a[X15 + n] = by_balance * sine
            a[B0 + n] = cx - bar * r01
            a[B1 + n] = cy - bar * r11
            a[B2 + n] = cz - bar * r21
            a[B6 + n] = s * cx + by_cosine * r01
            a[B7 + n] = s * cy + by_cosine * r11
            a[B8 + n] = s * cz + by_cosine * r21
    for n in range(LANES):
        along = a[X7 + n]
        vx = a[X8 + n]
        vy = a[X9 + n]
        vz = a[X10 + n]
        a[B3 + n] = r00 * vx + r10 * vy + r20 * vz
        a[B4 + n] = r01 * vx + r11 * vy + r21 * vz
        a[B5 + n] = r02 * vx + r12 * vy + r22 * vz
        a[B9 + n] = by_stiffness * along
        a[B10 + n] = by_deformation * along
        a[B11 + n] = 0.0
        a[B12 + n] = 0.0
        a[B13 + n] = value * along
        a[M0 + n] += vx * u
        a[M1 + n] += vx * v + a[X11 + n]
        a[M2 + n] += vx * w
        a[M3 + n] += vy * u
        a[M4 + n] += vy * v + a[X12 + n]
        a[M5 + n] += vy * w
        a[M6 + n] += vz * u
        a[M7 + n] += vz * v + a[X13 + n]
        a[M8 + n] += vz * w
    add(a, X + 8, target, THREE)
    add(a, X + 14, G_STOWED, THREE - 1)
    add(a, X_BLOCK, G_SPRINGS + G_SPRING_SIZE * i, G_SPRING_SIZE)


@njit(**KERNEL)
def push_adjoint(x, at, r, i, a, c, marks):
    """Add what spring i contributes, from the adjoints of the sums over the springs in rows S to S + 8."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    k = known(SPRINGS + SPRING_COLUMNS * i)
    u = c[k + 3]
    v = c[k + 4]
    w = c[k + 5]
    dx = x[at]
    dy = x[at + 1]
    dz = x[at + 2]
    qx = dx + r00 * u + r01 * v + r02 * w
    qy = dy + r10 * u + r11 * v + r12 * w
    qz = dz + r20 * u + r21 * v + r22 * w
    s, gx, gy, gz, cx, cy, cz, share = contact(c, marks, i, qx, qy, qz, r01, r11, r21)
    f, _, _, _ = law(c, marks, i, s)
    f *= c[k + SCALE] * share
    fx = f * gx
    fy = f * gy
    fz = f * gz
    bx = cx - dx
    by = cy - dy
    bz = cz - dz
    for n in range(LANES):
        tx = a[S3 + n]
        ty = a[S4 + n]
        tz = a[S5 + n]
        px = a[S6 + n]
        py = a[S7 + n]
        pz = a[S8 + n]
        # Of the force: from the sum, from (c - d) x F and from -c x F. Of the contact point c and of d: from these too.
        a[X0 + n] = a[S0 + n] + ty * bz - tz * by - py * cz + pz * cy
        a[X1 + n] = a[S1 + n] + tz * bx - tx * bz - pz * cx + px * cz
        a[X2 + n] = a[S2 + n] + tx * by - ty * bx - px * cy + py * cx
        a[X3 + n] = fy * (tz - pz) - fz * (ty - py)
        a[X4 + n] = fz * (tx - px) - fx * (tz - pz)
        a[X5 + n] = fx * (ty - py) - fy * (tx - px)
        a[X6 + n] = 0.0
        a[S9 + n] -= fy * tz - fz * ty
        a[S10 + n] -= fz * tx - fx * tz
        a[S11 + n] -= fx * ty - fy * tx
    spring_adjoint(x, at, r, i, S + 9, a, c, marks)


@njit(**KERNEL)
def sums_adjoint(x, at, r, a, c):
    """The same as `push_adjoint` for all guided springs at once, by their sums; x[FORCES:] is filled."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    dx = x[at]
    dy = x[at + 1]
    dz = x[at + 2]
    fx = x[FORCES]
    fy = x[FORCES + 1]
    fz = x[FORCES + 2]
    w00 = x[FORCES + 3]
    w01 = x[FORCES + 4]
    w02 = x[FORCES + 5]
    w10 = x[FORCES + 6]
    w11 = x[FORCES + 7]
    w12 = x[FORCES + 8]
    w20 = x[FORCES + 9]
    w21 = x[FORCES + 10]
    w22 = x[FORCES + 11]
    for n in range(LANES):
        px = a[S6 + n]
        py = a[S7 + n]
        pz = a[S8 + n]
        tx = a[S3 + n] - px
        ty = a[S4 + n] - py
        tz = a[S5 + n] - pz
        a[S9 + n] -= fy * pz - fz * py
        a[S10 + n] -= fz * px - fx * pz
        a[S11 + n] -= fx * py - fy * px
        # Rows X to X + 11: the adjoints of the sums of f n and f n b^T.
        a[X0 + n] = a[S0 + n] - (py * dz - pz * dy)
        a[X1 + n] = a[S1 + n] - (pz * dx - px * dz)
        a[X2 + n] = a[S2 + n] - (px * dy - py * dx)
        a[X3 + n] = ty * r20 - tz * r10
        a[X4 + n] = ty * r21 - tz * r11
        a[X5 + n] = ty * r22 - tz * r12
        a[X6 + n] = tz * r00 - tx * r20
        a[X7 + n] = tz * r01 - tx * r21
        a[X8 + n] = tz * r02 - tx * r22
        a[X9 + n] = tx * r10 - ty * r00
        a[X10 + n] = tx * r11 - ty * r01
        a[X11 + n] = tx * r12 - ty * r02
        a[M0 + n] += tz * w10 - ty * w20
        a[M1 + n] += tz * w11 - ty * w21
        a[M2 + n] += tz * w12 - ty * w22
        a[M3 + n] += tx * w20 - tz * w00
        a[M4 + n] += tx * w21 - tz * w01
        a[M5 + n] += tx * w22 - tz * w02
        a[M6 + n] += ty * w00 - tx * w10
        a[M7 + n] += ty * w01 - tx * w11
        a[M8 + n] += ty * w02 - tx * w12
    for j in range(SUM_COLUMNS):
        factor = 1.0
        if j > 3:
            factor = r[j - 4]
        elif j > 0:
            factor = x[at + j - 1]
        # The adjoint of the matrix, and for j > 0 that of d or R.
        matrix = known((MATRIX + SUM_ROWS * j) * LANES)
        for n in range(SUM_ROWS * LANES):
            a[matrix + n] += factor * a[X0 + n]
        k = known(SUMS + SUM_ROWS * j)
        target = known((S + 8 + j if j < 4 else M + j - 4) * LANES)
        if j > 0:
            for n in range(LANES):
                a[target + n] += (
                    c[k] * a[X0 + n]
                    + c[k + 1] * a[X1 + n]
                    + c[k + 2] * a[X2 + n]
                    + c[k + 3] * a[X3 + n]
                    + c[k + 4] * a[X4 + n]
                    + c[k + 5] * a[X5 + n]
                    + c[k + 6] * a[X6 + n]
                    + c[k + 7] * a[X7 + n]
                    + c[k + 8] * a[X8 + n]
                    + c[k + 9] * a[X9 + n]
                    + c[k + 10] * a[X10 + n]
                    + c[k + 11] * a[X11 + n]
                )


@njit(**KERNEL)
def collect_sums(i, sign, w, c, marks, a):
    """Add to the adjoints of guided spring i what that of the sums' matrix says, times `sign`; see `add_to_sums`.

    The matrix gathers from the end of the run on: a spring takes it once with -1 at its release and once with 1 at the
    start of its push.
    """
    kind = marks[SPRING_MARKS + MARK_COLUMNS * i + LAW]
    if kind == TABLE or marks[FORCE_LINE] != GUIDED:
        return
    row_and_column(i, c, marks, w)
    k = known(SPRINGS + SPRING_COLUMNS * i)
    g = G_SPRINGS + G_SPRING_SIZE * i
    scale = c[k + SCALE]
    stiffness = scale * c[k + STIFFNESS]
    linear = 1.0 if kind == LINEAR else 0.0
    # Rows X to X + 3: of the row's entry, of the column's entry, of the column's constant and of the stiffness.
    clear(a, X, NINE)
    for n in range(SUM_ROWS):
        matrix = known((MATRIX + n) * LANES)
        for lane in range(LANES):
            a[X2 + lane] += sign * a[matrix + lane] * w[ROW + n]
    for row in range(SUM_ROWS):
        # The entries that hold one component of n: alone, then with each component of b.
        axis = row if row < 3 else (row - 3) // 3
        arm = (row - 3) % 3
        direction = c[known(k + 6 + axis)]
        factor = 1.0 if row < 3 else c[known(k + 3 + arm)]
        clear(a, X, THREE - 1)
        for j in range(SUM_COLUMNS):
            weight = sign * w[COLUMN + j]
            matrix = known((MATRIX + SUM_ROWS * j + row) * LANES)
            for lane in range(LANES):
                a[X0 + lane] += weight * a[matrix + lane]
        for j in range(SUM_ROWS):
            weight = sign * w[ROW + j]
            matrix = known((MATRIX + SUM_ROWS * (1 + row) + j) * LANES)
            for lane in range(LANES):
                a[X1 + lane] += weight * a[matrix + lane]
        by_direction = known((g + 6 + axis) * LANES)
        by_arm = known((g + 3 + arm) * LANES)
        for lane in range(LANES):
            by_column = a[X1 + lane]
            by_entry = a[X0 + lane] - stiffness * by_column
            a[X3 + lane] -= direction * factor * by_column
            a[by_direction + lane] += factor * by_entry
            if row >= 3:
                a[by_arm + lane] += direction * by_entry
    at = known(g * LANES)
    for lane in range(LANES):
        constant = linear * a[X2 + lane]
        by_stiffness = linear * a[X3 + lane] + constant * c[k + DEFORMATION]
        for n in range(3):
            direction = c[k + 6 + n]
            by_stiffness += constant * direction * c[k + n]
            a[at + n * LANES + lane] += constant * stiffness * direction
            a[at + (6 + n) * LANES + lane] += constant * stiffness * c[k + n]
        a[at + L9 + lane] += scale * by_stiffness
        a[at + L10 + lane] += stiffness * constant
        a[at + L13 + lane] += c[k + STIFFNESS] * by_stiffness - (1.0 - linear) * a[X2 + lane]


@njit(**INLINE)
def body_adjoint(c, inertia, o0, o1, o2, slope, at, row, target, g_row, a):
    """Adjoint of I w' = M - w x I w: from that of w', rows row to row + 2, to those of M (written there), w and I."""
    a0 = slope[at]
    a1 = slope[at + 1]
    a2 = slope[at + 2]
    h0, h1, h2 = times(c, inertia, o0, o1, o2)
    i00 = c[inertia]
    i01 = c[inertia + 1]
    i02 = c[inertia + 2]
    i11 = c[inertia + 4]
    i12 = c[inertia + 5]
    i22 = c[inertia + 8]
    j00 = c[inertia + 9]
    j01 = c[inertia + 10]
    j02 = c[inertia + 11]
    j11 = c[inertia + 13]
    j12 = c[inertia + 14]
    j22 = c[inertia + 17]
    for n in range(LANES):
        o = row * LANES + n
        q = target * LANES + n
        v0 = a[o]
        v1 = a[o + L1]
        v2 = a[o + L2]
        b0 = j00 * v0 + j01 * v1 + j02 * v2
        b1 = j01 * v0 + j11 * v1 + j12 * v2
        b2 = j02 * v0 + j12 * v1 + j22 * v2
        a[o] = b0
        a[o + L1] = b1
        a[o + L2] = b2
        # h = I w enters as -w x h.
        e0 = o1 * b2 - o2 * b1
        e1 = o2 * b0 - o0 * b2
        e2 = o0 * b1 - o1 * b0
        a[q] += b1 * h2 - b2 * h1 + i00 * e0 + i01 * e1 + i02 * e2
        a[q + L1] += b2 * h0 - b0 * h2 + i01 * e0 + i11 * e1 + i12 * e2
        a[q + L2] += b0 * h1 - b1 * h0 + i02 * e0 + i12 * e1 + i22 * e2
        a[X0 + n] = e0 * o0 - b0 * a0
        a[X1 + n] = e0 * o1 - b0 * a1
        a[X2 + n] = e0 * o2 - b0 * a2
        a[X3 + n] = e1 * o0 - b1 * a0
        a[X4 + n] = e1 * o1 - b1 * a1
        a[X5 + n] = e1 * o2 - b1 * a2
        a[X6 + n] = e2 * o0 - b2 * a0
        a[X7 + n] = e2 * o1 - b2 * a1
        a[X8 + n] = e2 * o2 - b2 * a2
    add(a, X, g_row, NINE)


@njit(**INLINE)
def torque_adjoint(c, inertia, torque, nx, ny, nz, row, a):
    """Adjoint of the gradient torque, torque * n x (I n), from that of the moment in rows row to row + 2.

    That of n goes to rows X + 9 to X + 11, that of I to rows X to X + 8.
    """
    hx, hy, hz = times(c, inertia, nx, ny, nz)
    i00 = c[inertia]
    i01 = c[inertia + 1]
    i02 = c[inertia + 2]
    i11 = c[inertia + 4]
    i12 = c[inertia + 5]
    i22 = c[inertia + 8]
    for n in range(LANES):
        o = row * LANES + n
        vx = torque * a[o]
        vy = torque * a[o + L1]
        vz = torque * a[o + L2]
        wx = vy * nz - vz * ny
        wy = vz * nx - vx * nz
        wz = vx * ny - vy * nx
        a[X9 + n] = hy * vz - hz * vy + i00 * wx + i01 * wy + i02 * wz
        a[X10 + n] = hz * vx - hx * vz + i01 * wx + i11 * wy + i12 * wz
        a[X11 + n] = hx * vy - hy * vx + i02 * wx + i12 * wy + i22 * wz
        a[X0 + n] = wx * nx
        a[X1 + n] = wx * ny
        a[X2 + n] = wx * nz
        a[X3 + n] = wy * nx
        a[X4 + n] = wy * ny
        a[X5 + n] = wy * nz
        a[X6 + n] = wz * nx
        a[X7 + n] = wz * ny
        a[X8 + n] = wz * nz


@njit(**KERNEL)
def gravity_adjoint(t, x, at, r, a, c, marks):
    """Add what gravity contributes, to first order in |d| / |r| (1e-7 of an acceleration of 1e-6 m/s2)."""
    w = x[at + 16]
    u = x[at + 17]
    v = x[at + 18]
    z = x[at + 19]
    nx, ny, nz, rate = earth_vector(t, c, w, u, v, z)
    nx *= c[INVERSE_RADIUS]
    ny *= c[INVERSE_RADIUS]
    nz *= c[INVERSE_RADIUS]
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    dx = x[at]
    dy = x[at + 1]
    dz = x[at + 2]
    along = nx * dx + ny * dy + nz * dz
    for n in range(LANES):
        # Differential acceleration: -rate (d - 3 n (n . d)).
        vx = a[KB3 + n]
        vy = a[KB4 + n]
        vz = a[KB5 + n]
        q = nx * vx + ny * vy + nz * vz
        a[OUT0 + n] -= rate * (vx - 3.0 * nx * q)
        a[OUT1 + n] -= rate * (vy - 3.0 * ny * q)
        a[OUT2 + n] -= rate * (vz - 3.0 * nz * q)
        # The adjoint of n stays in rows X + 12 to X + 14.
        a[X12 + n] = 3.0 * rate * (along * vx + q * dx)
        a[X13 + n] = 3.0 * rate * (along * vy + q * dy)
        a[X14 + n] = 3.0 * rate * (along * vz + q * dz)
    if marks[GRAVITY_LEVEL] == 2:
        torque_adjoint(c, PLATFORM_INERTIA, 3.0 * rate, nx, ny, nz, S + 12, a)
        add(a, X, G_PLATFORM_INERTIA, NINE)
        add(a, X + 9, X + 12, THREE)
        ux = r00 * nx + r10 * ny + r20 * nz
        uy = r01 * nx + r11 * ny + r21 * nz
        uz = r02 * nx + r12 * ny + r22 * nz
        torque_adjoint(c, SATELLITE_INERTIA, 3.0 * rate, ux, uy, uz, S + 15, a)
        add(a, X, G_SATELLITE_INERTIA, NINE)
        for n in range(LANES):
            # u = R^T n.
            gx = a[X9 + n]
            gy = a[X10 + n]
            gz = a[X11 + n]
            a[M0 + n] += nx * gx
            a[M1 + n] += nx * gy
            a[M2 + n] += nx * gz
            a[M3 + n] += ny * gx
            a[M4 + n] += ny * gy
            a[M5 + n] += ny * gz
            a[M6 + n] += nz * gx
            a[M7 + n] += nz * gy
            a[M8 + n] += nz * gz
            a[X12 + n] += r00 * gx + r01 * gy + r02 * gz
            a[X13 + n] += r10 * gx + r11 * gy + r12 * gz
            a[X14 + n] += r20 * gx + r21 * gy + r22 * gz
    # n = C_1^T e: the adjoint of C_1 is e h^T, with e = C_1 n.
    p00, p01, p02, p10, p11, p12, p20, p21, p22 = rotation_matrix_elements(w, u, v, z)
    ex = p00 * nx + p01 * ny + p02 * nz
    ey = p10 * nx + p11 * ny + p12 * nz
    ez = p20 * nx + p21 * ny + p22 * nz
    for n in range(LANES):
        hx = a[X12 + n]
        hy = a[X13 + n]
        hz = a[X14 + n]
        a[M9 + n] = ex * hx
        a[M10 + n] = ex * hy
        a[M11 + n] = ex * hz
        a[M12 + n] = ey * hx
        a[M13 + n] = ey * hy
        a[M14 + n] = ey * hz
        a[M15 + n] = ez * hx
        a[M16 + n] = ez * hy
        a[M17 + n] = ez * hz
    add_rotation_adjoint(a, M + 9, w, u, v, z, OUT + 16)


@njit(**KERNEL)
def kinematics_adjoint(x, at, a):
    """Adjoint of the motion of d, w, Q and q1, from that of the slope, KB, to that of the state, OUT."""
    d0 = x[at]
    d1 = x[at + 1]
    d2 = x[at + 2]
    v0 = x[at + 3]
    v1 = x[at + 4]
    v2 = x[at + 5]
    p0 = x[at + 6]
    p1 = x[at + 7]
    p2 = x[at + 8]
    e0 = x[at + 9] - p0
    e1 = x[at + 10] - p1
    e2 = x[at + 11] - p2
    f0 = x[at + 9] + p0
    f1 = x[at + 10] + p1
    f2 = x[at + 11] + p2
    q0 = x[at + 12]
    q1 = x[at + 13]
    q2 = x[at + 14]
    q3 = x[at + 15]
    z0 = x[at + 16]
    z1 = x[at + 17]
    z2 = x[at + 18]
    z3 = x[at + 19]
    for n in range(LANES):
        # d' = w - omega_1 x d; w' = F / mu + gravity - omega_1 x w.
        a0 = a[KB0 + n]
        a1 = a[KB1 + n]
        a2 = a[KB2 + n]
        b0 = a[KB3 + n]
        b1 = a[KB4 + n]
        b2 = a[KB5 + n]
        a[OUT0 + n] = p1 * a2 - p2 * a1
        a[OUT1 + n] = p2 * a0 - p0 * a2
        a[OUT2 + n] = p0 * a1 - p1 * a0
        a[OUT3 + n] = a0 + p1 * b2 - p2 * b1
        a[OUT4 + n] = a1 + p2 * b0 - p0 * b2
        a[OUT5 + n] = a2 + p0 * b1 - p1 * b0
        w0 = a1 * d2 - a2 * d1 + b1 * v2 - b2 * v1
        w1 = a2 * d0 - a0 * d2 + b2 * v0 - b0 * v2
        w2 = a0 * d1 - a1 * d0 + b0 * v1 - b1 * v0
        # Q' = (Q (x) [0, omega_2] - [0, omega_1] (x) Q) / 2; q1' = q1 (x) [0, omega_1] / 2.
        k0 = 0.5 * a[KB12 + n]
        k1 = 0.5 * a[KB13 + n]
        k2 = 0.5 * a[KB14 + n]
        k3 = 0.5 * a[KB15 + n]
        a[OUT12 + n] = k1 * e0 + k2 * e1 + k3 * e2
        a[OUT13 + n] = -k0 * e0 - k2 * f2 + k3 * f1
        a[OUT14 + n] = -k0 * e1 + k1 * f2 - k3 * f0
        a[OUT15 + n] = -k0 * e2 - k1 * f1 + k2 * f0
        u0 = -k0 * q1 + k1 * q0
        u1 = -k0 * q2 + k2 * q0
        u2 = -k0 * q3 + k3 * q0
        y0 = k2 * q3 - k3 * q2
        y1 = -k1 * q3 + k3 * q1
        y2 = k1 * q2 - k2 * q1
        k0 = 0.5 * a[KB16 + n]
        k1 = 0.5 * a[KB17 + n]
        k2 = 0.5 * a[KB18 + n]
        k3 = 0.5 * a[KB19 + n]
        a[OUT16 + n] = k1 * p0 + k2 * p1 + k3 * p2
        a[OUT17 + n] = -k0 * p0 - k2 * p2 + k3 * p1
        a[OUT18 + n] = -k0 * p1 + k1 * p2 - k3 * p0
        a[OUT19 + n] = -k0 * p2 - k1 * p1 + k2 * p0
        a[OUT6 + n] = w0 - u0 + y0 - k0 * z1 + k1 * z0 + k2 * z3 - k3 * z2
        a[OUT7 + n] = w1 - u1 + y1 - k0 * z2 - k1 * z3 + k2 * z0 + k3 * z1
        a[OUT8 + n] = w2 - u2 + y2 - k0 * z3 + k1 * z2 - k2 * z1 + k3 * z0
        a[OUT9 + n] = u0 + y0
        a[OUT10 + n] = u1 + y1
        a[OUT11 + n] = u2 + y2


@njit(**KERNEL)
def derivative_adjoint(t, x, at, row, a, c, marks):
    """Vector-Jacobian products of `rigid_body.derivative`, for LANES adjoints of its result in rows KB to KB + 19.

    Writes those of the state x[at:] into rows OUT to OUT + 19, adds those of the constants to the rows from G on;
    x[row:] is its result.
    """
    r = rotation_matrix_elements(x[at + 12], x[at + 13], x[at + 14], x[at + 15])
    fx, fy, fz, sx, sy, sz, _, _, _ = spring_sums(x, at, r, c, marks)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    inverse_mass = c[INVERSE_REDUCED_MASS]
    kinematics_adjoint(x, at, a)
    for n in range(6 * LANES):
        a[S12 + n] = a[KB6 + n]
    body_adjoint(
        c, PLATFORM_INERTIA, x[at + 6], x[at + 7], x[at + 8], x, row + 6, S + 12, OUT + 6, G_PLATFORM_INERTIA, a
    )
    body_adjoint(
        c, SATELLITE_INERTIA, x[at + 9], x[at + 10], x[at + 11], x, row + 9, S + 15, OUT + 9, G_SATELLITE_INERTIA, a
    )
    for n in range(LANES):
        b0 = a[KB3 + n]
        b1 = a[KB4 + n]
        b2 = a[KB5 + n]
        a[S0 + n] = inverse_mass * b0
        a[S1 + n] = inverse_mass * b1
        a[S2 + n] = inverse_mass * b2
        a[G0 + n] += fx * b0 + fy * b1 + fz * b2
        # The moment on the platform as it is, that on the satellite turned by R^T.
        a0 = a[S15 + n]
        a1 = a[S16 + n]
        a2 = a[S17 + n]
        a[S3 + n] = r00 * a0 + r01 * a1 + r02 * a2
        a[S4 + n] = r10 * a0 + r11 * a1 + r12 * a2
        a[S5 + n] = r20 * a0 + r21 * a1 + r22 * a2
        a[S6 + n] = a[S12 + n]
        a[S7 + n] = a[S13 + n]
        a[S8 + n] = a[S14 + n]
        a[S9 + n] = 0.0
        a[S10 + n] = 0.0
        a[S11 + n] = 0.0
        a[M0 + n] = sx * a0
        a[M1 + n] = sx * a1
        a[M2 + n] = sx * a2
        a[M3 + n] = sy * a0
        a[M4 + n] = sy * a1
        a[M5 + n] = sy * a2
        a[M6 + n] = sz * a0
        a[M7 + n] = sz * a1
        a[M8 + n] = sz * a2
    guided = marks[FORCE_LINE] == GUIDED
    if guided and marks[PUSHING] > 0:
        sums_adjoint(x, at, r, a, c)
    for i in range(marks[SPRING_NUMBER]):
        m = SPRING_MARKS + MARK_COLUMNS * i
        if marks[m + ACTIVE] and not (guided and marks[m + LAW] != TABLE):
            push_adjoint(x, at, r, i, a, c, marks)
    if marks[GRAVITY_LEVEL] != 0:
        gravity_adjoint(t, x, at, r, a, c, marks)
    add_rotation_adjoint(a, M, x[at + 12], x[at + 13], x[at + 14], x[at + 15], OUT + 12)
    add(a, S + 9, OUT, THREE)


@njit(**KERNEL)
def step_adjoint(method, t, x, h, w, c, marks, lam, a):
    """Pull the adjoint of the end of a step, rows lam to lam + 19, back to its start, in place."""
    last = STAGE_NUMBER[method] - 1
    load(x, w)
    stages(FIRST, last + 1, method, t, h, w, c, marks)
    for i in range(last, -1, -1):
        b = h * B[method, i]
        for n in range(STATE_SIZE * LANES):
            a[KB0 + n] = b * a[known(lam * LANES) + n]
        for later in range(i + 1, last + 1):
            b = h * A[method, later, i]
            if b != 0.0:
                for n in range(STATE_SIZE * LANES):
                    a[KB0 + n] += b * a[known((YB + later * STATE_SIZE) * LANES) + n]
        derivative_adjoint(t + C[method, i] * h, w, i * STATE_SIZE, K + i * STATE_SIZE, a, c, marks)
        for n in range(STATE_SIZE * LANES):
            a[known((YB + i * STATE_SIZE) * LANES) + n] = a[OUT0 + n]
    for i in range(last + 1):
        add(a, YB + i * STATE_SIZE, lam, ROWS)


@njit(**KERNEL)
def clearance_adjoint(x, i, lane, kind, c, marks, lam, follow, tail, a):
    """Add to one lane of the rows from `lam` on the adjoint of the clearance of envelope point i at state x.

    That is at its exit, whose time moves, or at a fixed or extremal time. Constants from row `tail`: CG of the
    platform, CG of the satellite, radius, depth, offsets of the planes.
    """
    o = lam * LANES + lane
    t = tail * LANES + lane
    point = follow.room
    point_motion(x, c, marks, i, point)
    _, wall = nearest_wall(c, marks, point)
    if wall == 0:
        rho = math.sqrt(point[0] * point[0] + point[2] * point[2])
        bx = -point[0] / rho
        by = 0.0
        bz = -point[2] / rho
        a[t + L6] += 1.0
    else:
        k = marks[PLANES] + PLANE_COLUMNS * (wall - 1)
        bx = c[k]
        by = c[k + 1]
        bz = c[k + 2]
        a[t + L7 + wall * LANES] -= 1.0
    if kind == AT_EXIT:
        # The exit waits for y = depth.
        drift = (bx * point[3] + by * point[4] + bz * point[5]) / point[4]
        by -= drift
        a[t + L7] += drift
    a[o] += bx
    a[o + L1] += by
    a[o + L2] += bz
    a[t] += bx
    a[t + L1] += by
    a[t + L2] += bz
    r = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    clear(a, M, NINE)
    for j in range(3):
        arm = c[marks[POINTS] + POINT_COLUMNS * i + j] - c[SATELLITE_CG + j]
        row = j * LANES + lane
        a[row + M0] = bx * arm
        a[row + M3] = by * arm
        a[row + M6] = bz * arm
        a[t + L3 + j * LANES] -= r[j] * bx + r[3 + j] * by + r[6 + j] * bz
    add_rotation_adjoint(a, M, x[12], x[13], x[14], x[15], lam + 12)


@njit(**KERNEL)
def branch_adjoint(columns, block, index, step, w, c, marks, tape, follow, tail, a):
    """Add, at tape state `index`, the clearances that are reached from there by one step within step `step`."""
    point_number = marks[POINT_NUMBER]
    closest = np.int64(follow.closest[1])
    kind = np.int64(follow.closest[2])
    for i in range(point_number + 1):
        # Behind the exits of all points stands the smallest clearance, if it was met between the ends of a step.
        if i < point_number:
            wanted = follow.step[i] == step and follow.base[i] == index
        else:
            wanted = kind == INSIDE and np.int64(follow.closest[3]) == step and index == step
        if not wanted:
            continue
        clear(a, BRANCH, ROWS)
        used = False
        for lane in range(LANES):
            column = columns[block + lane]
            if i == point_number:
                if column == STATE_SIZE + 1:
                    clearance_adjoint(follow.closest_x, closest, lane, INSIDE, c, marks, BRANCH, follow, tail, a)
                    used = True
            elif column == STATE_SIZE + 2 + i or (column == STATE_SIZE + 1 and kind == AT_EXIT and closest == i):
                # A step of no length: the point was out from the start on, and its time does not move.
                moves = AT_EXIT if follow.h[i] != 0.0 else INSIDE
                clearance_adjoint(follow.x[i], i, lane, moves, c, marks, BRANCH, follow, tail, a)
                used = True
        if used:
            h = follow.h[i] if i < point_number else follow.closest[4]
            method = follow.method[i] if i < point_number else EIGHTH_ORDER
            step_adjoint(method, tape.t[index], tape.x[index], h, w, c, marks, BRANCH, a)
            add(a, BRANCH, LAM, ROWS)


@njit(**KERNEL)
def event_adjoint(index, event, spring, w, c, marks, tape, a):
    """Correct the adjoints at tape state `index` for the length of the step before it, which its event decides."""
    x = tape.x[index]
    load(x, w)
    stages(FIRST, SECOND, EIGHTH_ORDER, tape.t[index], 0.0, w, c, marks)
    clear(a, X, NINE)
    for n in range(STATE_SIZE):
        for lane in range(LANES):
            a[X6 + lane] += a[(LAM + n) * LANES + lane] * w[K + n]
    k = G_SPRINGS + G_SPRING_SIZE * spring
    if event == PUSH_STARTS:
        # The step's end is the delay itself.
        for lane in range(LANES):
            speed = a[X6 + lane]
            a[(k + 12) * LANES + lane] += a[MU0 + lane] + speed
            a[MU0 + lane] = -speed
        return
    _, rate, _ = seat_motion(w, START, K, c, marks, spring)
    for lane in range(LANES):
        bar = -(a[X6 + lane] + a[MU0 + lane]) / rate
        a[X6 + lane] = bar
        a[(k + 11) * LANES + lane] -= bar
    clear(a, M, NINE)
    r = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    spring_adjoint(x, START, r, spring, LAM, a, c, marks)
    add_rotation_adjoint(a, M, x[12], x[13], x[14], x[15], LAM + 12)


@njit(**KERNEL)
def switch_back(event, spring, w, c, marks, a):
    """Undo an event for the springs; before the first push friction does not act either."""
    if event == RELEASE:
        collect_sums(spring, -1.0, w, c, marks, a)
        switch(spring, SECOND, c, marks, w)
        return
    pushing = False
    for i in range(marks[SPRING_NUMBER]):
        m = SPRING_MARKS + MARK_COLUMNS * i
        pushing = pushing or (i != spring and marks[m + ACTIVE] and marks[m + LAW] != FRICTION)
    for i in range(marks[SPRING_NUMBER]):
        m = SPRING_MARKS + MARK_COLUMNS * i
        if i == spring or (not pushing and marks[m + ACTIVE] and marks[m + LAW] == FRICTION):
            collect_sums(i, 1.0, w, c, marks, a)
            switch(i, FIRST, c, marks, w)


@njit(**KERNEL)
def adjoint_sweep(columns, block, last, p, w, c, marks, tape, follow, a, gradients):
    """Gradients of the base's columns[block:block + LANES] with respect to all parameters, from a finished run.

    They go into gradients[block:block + LANES, :]; a column of -1 gives 0. `marks` are walked back.
    """
    tail = G_SPRINGS + G_SPRING_SIZE * marks[SPRING_NUMBER]
    clear(a, LAM, STATE_SIZE + 1)
    clear(a, MATRIX, tail + 8 + marks[PLANE_NUMBER] - MATRIX)
    clear_sums(c, marks)
    # Steps behind the last release matter only to clearances.
    top = last
    for i in range(marks[SPRING_NUMBER]):
        marks[SPRING_MARKS + MARK_COLUMNS * i + ACTIVE] = 0
    for i in range(marks[POINT_NUMBER]):
        if follow.base[i] > top:
            top = follow.base[i]
    for index in range(top, -1, -1):
        if index == last:
            for lane in range(LANES):
                column = columns[block + lane]
                if 0 <= column < STATE_SIZE:
                    a[(LAM + column) * LANES + lane] += 1.0
                elif column == STATE_SIZE:
                    a[MU0 + lane] = 1.0
        # First what is reached from here within the step that starts here, then within the one that ends here: its
        # event lies between the two.
        for step in range(index, index - 2, -1):
            if step < index and step >= 0 and tape.event[step] != NOTHING:
                switch_back(tape.event[step], tape.spring[step], w, c, marks, a)
            branch_adjoint(columns, block, index, step, w, c, marks, tape, follow, tail, a)
        if index > 0:
            step = index - 1
            if tape.event[step] != NOTHING:
                event_adjoint(index, tape.event[step], tape.spring[step], w, c, marks, tape, a)
            if tape.h[step] != 0.0:
                step_adjoint(tape.method[step], tape.t[step], tape.x[step], tape.h[step], w, c, marks, LAM, a)
    if marks[POINT_NUMBER] > 0 and np.int64(follow.closest[2]) == AT_START:
        for lane in range(LANES):
            if columns[block + lane] == STATE_SIZE + 1:
                clearance_adjoint(tape.x[0], np.int64(follow.closest[1]), lane, INSIDE, c, marks, LAM, follow, tail, a)
    for i in range(marks[SPRING_NUMBER]):
        if marks[SPRING_MARKS + MARK_COLUMNS * i + ACTIVE]:
            collect_sums(i, 1.0, w, c, marks, a)
    x = tape.x[0]
    for lane in range(LANES):
        initial_adjoint(p, c, x, lane, tail, a, gradients[block + lane])
    add_rotation_adjoint(a, M, x[12], x[13], x[14], x[15], LAM + 12)
    for lane in range(LANES):
        mounting_adjoint(p, lane, a, gradients[block + lane])
        parameter_adjoint(p, marks, lane, tail, a, gradients[block + lane])


@njit(**KERNEL)
def initial_adjoint(p, c, x, lane, tail, a, gradient):
    """From the adjoint of the initial state to those of rates, impulses, mounting error, CGs and stowed length.

    See `flight.prepare`.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    ix = p[IMPULSE]
    iy = p[IMPULSE + 1]
    iz = p[IMPULSE + 2]
    ox = p[RATES]
    oy = p[RATES + 1]
    oz = p[RATES + 2]
    # w = Omega x d + Delta p / mu.
    w = LAM0 + lane
    wx = a[w + L3]
    wy = a[w + L4]
    wz = a[w + L5]
    dx = a[w] + wy * oz - wz * oy
    dy = a[w + L1] + wz * ox - wx * oz
    dz = a[w + L2] + wx * oy - wy * ox
    a[G0 + lane] += wx * ix + wy * iy + wz * iz
    # omega_1 = Omega + I_1^-1 (-Delta h + (c_1 - l_0 y) x Delta p).
    px = a[w + L6]
    py = a[w + L7]
    pz = a[w + L8]
    ax, ay, az = times(c, PLATFORM_INVERSE_INERTIA, px, py, pz)
    # omega_2 = R^T Omega + I_2^-1 R^T h with h = Delta h - u x Delta p, u = R c_2.
    vx = a[w + L9]
    vy = a[w + L10]
    vz = a[w + L11]
    bx, by, bz = times(c, SATELLITE_INVERSE_INERTIA, vx, vy, vz)
    gradient[RATES] = x[1] * wz - x[2] * wy + px + r00 * vx + r01 * vy + r02 * vz
    gradient[RATES + 1] = x[2] * wx - x[0] * wz + py + r10 * vx + r11 * vy + r12 * vz
    gradient[RATES + 2] = x[0] * wy - x[1] * wx + pz + r20 * vx + r21 * vy + r22 * vz
    # The adjoint of h; what turns with R: h, Omega and, through u, d and the arm of Delta p.
    hx = r00 * bx + r01 * by + r02 * bz
    hy = r10 * bx + r11 * by + r12 * bz
    hz = r20 * bx + r21 * by + r22 * bz
    ux = r00 * p[17] + r01 * p[18] + r02 * p[19]
    uy = r10 * p[17] + r11 * p[18] + r12 * p[19]
    uz = r20 * p[17] + r21 * p[18] + r22 * p[19]
    qx = dx - iy * hz + iz * hy
    qy = dy - iz * hx + ix * hz
    qz = dz - ix * hy + iy * hx
    kx = p[ANGULAR_IMPULSE] - uy * iz + uz * iy
    ky = p[ANGULAR_IMPULSE + 1] - uz * ix + ux * iz
    kz = p[ANGULAR_IMPULSE + 2] - ux * iy + uy * ix
    m = M0 + lane
    a[m] = ox * vx + kx * bx + qx * p[17]
    a[m + L1] = ox * vy + kx * by + qx * p[18]
    a[m + L2] = ox * vz + kx * bz + qx * p[19]
    a[m + L3] = oy * vx + ky * bx + qy * p[17]
    a[m + L4] = oy * vy + ky * by + qy * p[18]
    a[m + L5] = oy * vz + ky * bz + qy * p[19]
    a[m + L6] = oz * vx + kz * bx + qz * p[17]
    a[m + L7] = oz * vy + kz * by + qz * p[18]
    a[m + L8] = oz * vz + kz * bz + qz * p[19]
    gradient[ANGULAR_IMPULSE] = hx - ax
    gradient[ANGULAR_IMPULSE + 1] = hy - ay
    gradient[ANGULAR_IMPULSE + 2] = hz - az
    ex = p[7]
    ey = p[8] - p[STOWED]
    ez = p[9]
    gradient[IMPULSE] = c[INVERSE_REDUCED_MASS] * wx - (hy * uz - hz * uy) + (ay * ez - az * ey)
    gradient[IMPULSE + 1] = c[INVERSE_REDUCED_MASS] * wy - (hz * ux - hx * uz) + (az * ex - ax * ez)
    gradient[IMPULSE + 2] = c[INVERSE_REDUCED_MASS] * wz - (hx * uy - hy * ux) + (ax * ey - ay * ex)
    # The adjoint of the arm c_1 - l_0 y; and d = u - c_1 + l_0 y.
    ex = iy * az - iz * ay - dx
    ey = iz * ax - ix * az - dy
    ez = ix * ay - iy * ax - dz
    a[G_STOWED0 + lane] -= ey
    t = tail * LANES + lane
    a[t] += ex
    a[t + L1] += ey
    a[t + L2] += ez
    a[t + L3] += r00 * qx + r10 * qy + r20 * qz
    a[t + L4] += r01 * qx + r11 * qy + r21 * qz
    a[t + L5] += r02 * qx + r12 * qy + r22 * qz
    # The rates that the impulses gave both bodies, for their inertias.
    k0 = x[9] - (r00 * ox + r10 * oy + r20 * oz)
    k1 = x[10] - (r01 * ox + r11 * oy + r21 * oz)
    k2 = x[11] - (r02 * ox + r12 * oy + r22 * oz)
    for j in range(3):
        b = bx if j == 0 else by if j == 1 else bz
        e = ax if j == 0 else ay if j == 1 else az
        q = (G_SATELLITE_INERTIA + 3 * j) * LANES + lane
        a[q] -= b * k0
        a[q + L1] -= b * k1
        a[q + L2] -= b * k2
        q = (G_PLATFORM_INERTIA + 3 * j) * LANES + lane
        a[q] -= e * (x[6] - ox)
        a[q + L1] -= e * (x[7] - oy)
        a[q + L2] -= e * (x[8] - oz)


@njit(**KERNEL)
def mounting_adjoint(p, lane, a, gradient):
    """From the adjoint of the initial quaternion of the satellite to that of the mounting error, a rotation vector."""
    u = p[MOUNTING_ERROR]
    v = p[MOUNTING_ERROR + 1]
    w = p[MOUNTING_ERROR + 2]
    square = u * u + v * v + w * w
    scale = 0.5 - square / 48.0
    bend = -1.0 / 24.0 + square / 960.0
    if square > 1e-4:
        angle = math.sqrt(square)
        scale = math.sin(0.5 * angle) / angle
        bend = (0.5 * math.cos(0.5 * angle) - scale) / square
    q = (LAM + 12) * LANES + lane
    along = a[q + L1] * u + a[q + L2] * v + a[q + L3] * w
    for j in range(3):
        gradient[MOUNTING_ERROR + j] = scale * a[q + (1 + j) * LANES] + p[MOUNTING_ERROR + j] * (
            bend * along - 0.5 * scale * a[q]
        )


@njit(**KERNEL)
def parameter_adjoint(p, marks, lane, tail, a, gradient):
    """From the adjoints of the constants of a run to those of its parameters; see `flight.prepare`."""
    stowed = p[STOWED]
    g_stowed = a[G_STOWED0 + lane]
    for body in range(2):
        k = 10 * body
        q = (G_PLATFORM_INERTIA + 9 * body) * LANES + lane
        gradient[k] = -a[G0 + lane] / (p[k] * p[k])
        gradient[k + 1] = a[q]
        gradient[k + 2] = a[q + L4]
        gradient[k + 3] = a[q + L8]
        gradient[k + 4] = a[q + L1] + a[q + L3]
        gradient[k + 5] = a[q + L2] + a[q + L6]
        gradient[k + 6] = a[q + L5] + a[q + L7]
        for j in range(3):
            gradient[k + 7 + j] = a[(tail + 3 * body + j) * LANES + lane]
    t = tail * LANES + lane
    gradient[RECESS_RADIUS] = a[t + L6]
    gradient[RECESS_DEPTH] = a[t + L7]
    gradient[FRICTION_COEFFICIENT] = a[G_FRICTION * LANES + lane]
    for i in range(marks[SPRING_NUMBER]):
        k = (G_SPRINGS + G_SPRING_SIZE * i) * LANES + lane
        q = COMMON_SIZE + SPRING_SIZE * i
        radius = p[q + 1]
        ca = math.cos(p[q])
        sa = math.sin(p[q])
        cb = math.cos(p[q + 5])
        sb = math.sin(p[q + 5])
        ax = a[k]
        ay = a[k + L1]
        az = a[k + L2]
        bx = a[k + L3]
        by = a[k + L4]
        bz = a[k + L5]
        nx = a[k + L6] - stowed * ax
        ny = a[k + L7] - stowed * ay
        nz = a[k + L8] - stowed * az
        g_stowed += ax * sb * sa + ay * (1.0 - cb) - az * sb * ca
        gradient[q] = radius * (ca * (az + bz) - sa * (ax + bx)) - sb * (ca * nx + sa * nz)
        gradient[q + 1] = ca * (ax + bx) + sa * (az + bz)
        gradient[q + 2] = a[k + L9]
        gradient[q + 3] = a[k + L10]
        gradient[q + 4] = 0.0
        by_deformation = marks[SPRING_MARKS + MARK_COLUMNS * i + LAW] == LINEAR and p[q + 3] < p[q + 4]
        gradient[q + 3 if by_deformation else q + 4] += a[k + L11]
        gradient[q + 5] = cb * (ca * nz - sa * nx) - sb * ny
        gradient[q + 6] = a[k + L12]
        gradient[q + 7] = a[k + L13]
        gradient[7] -= ax
        gradient[8] -= ay
        gradient[9] -= az
        gradient[17] -= bx
        gradient[18] -= by
        gradient[19] -= bz
    gradient[STOWED] = g_stowed
    for wall in range(marks[PLANE_NUMBER]):
        gradient[COMMON_SIZE + SPRING_SIZE * marks[SPRING_NUMBER] + wall] = a[t + L8 + wall * LANES]
