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

from numba import njit

from satsep_ot.dynamics.compilation import INLINE, KERNEL, ONCE, known
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


def sweep_size(spring_number, plane_number):
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
        m01 = a[m + LANES]
        m02 = a[m + 2 * LANES]
        m10 = a[m + 3 * LANES]
        m11 = a[m + 4 * LANES]
        m12 = a[m + 5 * LANES]
        m20 = a[m + 6 * LANES]
        m21 = a[m + 7 * LANES]
        m22 = a[m + 8 * LANES]
        o = known(target * LANES) + n
        a[o] += 2.0 * (q3 * (m10 - m01) + q2 * (m02 - m20) + q1 * (m21 - m12))
        a[o + LANES] += 2.0 * (q2 * (m01 + m10) + q3 * (m02 + m20) + q0 * (m21 - m12) - 2.0 * q1 * (m11 + m22))
        a[o + 2 * LANES] += 2.0 * (q1 * (m01 + m10) + q3 * (m12 + m21) + q0 * (m02 - m20) - 2.0 * q2 * (m00 + m22))
        a[o + 3 * LANES] += 2.0 * (q1 * (m02 + m20) + q2 * (m12 + m21) + q0 * (m10 - m01) - 2.0 * q3 * (m00 + m11))


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
            hx = a[X * LANES + n]
            hy = a[(X + 1) * LANES + n]
            hz = a[(X + 2) * LANES + n]
            along = hx * gx + hy * gy + hz * gz
            bar = a[(X + 6) * LANES + n] + slope * along
            vx = bar * gx
            vy = bar * gy
            vz = bar * gz
            a[(X + 7) * LANES + n] = along
            a[(X + 8) * LANES + n] = vx + a[(X + 3) * LANES + n]
            a[(X + 9) * LANES + n] = vy + a[(X + 4) * LANES + n]
            a[(X + 10) * LANES + n] = vz + a[(X + 5) * LANES + n]
            a[(X + 11) * LANES + n] = 0.0
            a[(X + 12) * LANES + n] = 0.0
            a[(X + 13) * LANES + n] = 0.0
            a[(X + 14) * LANES + n] = 0.0
            a[(X + 15) * LANES + n] = 0.0
            a[X_BLOCK * LANES + n] = -vx
            a[(X_BLOCK + 1) * LANES + n] = -vy
            a[(X_BLOCK + 2) * LANES + n] = -vz
            a[(X_BLOCK + 6) * LANES + n] = f * hx + bar * dx
            a[(X_BLOCK + 7) * LANES + n] = f * hy + bar * dy
            a[(X_BLOCK + 8) * LANES + n] = f * hz + bar * dz
    elif marks[FORCE_LINE] == STRUT:
        # The direction turns with the seats: d g = (1 - g g^T) d delta / |delta|.
        turning = f / math.sqrt(dx * dx + dy * dy + dz * dz)
        for n in range(LANES):
            hx = a[X * LANES + n]
            hy = a[(X + 1) * LANES + n]
            hz = a[(X + 2) * LANES + n]
            along = hx * gx + hy * gy + hz * gz
            bar = a[(X + 6) * LANES + n] + slope * along
            vx = bar * gx + turning * (hx - along * gx)
            vy = bar * gy + turning * (hy - along * gy)
            vz = bar * gz + turning * (hz - along * gz)
            a[(X + 7) * LANES + n] = along
            a[(X + 8) * LANES + n] = vx + a[(X + 3) * LANES + n]
            a[(X + 9) * LANES + n] = vy + a[(X + 4) * LANES + n]
            a[(X + 10) * LANES + n] = vz + a[(X + 5) * LANES + n]
            a[(X + 11) * LANES + n] = 0.0
            a[(X + 12) * LANES + n] = 0.0
            a[(X + 13) * LANES + n] = 0.0
            a[(X + 14) * LANES + n] = -bar
            a[(X + 15) * LANES + n] = 0.0
            a[X_BLOCK * LANES + n] = -vx
            a[(X_BLOCK + 1) * LANES + n] = -vy
            a[(X_BLOCK + 2) * LANES + n] = -vz
            a[(X_BLOCK + 6) * LANES + n] = 0.0
            a[(X_BLOCK + 7) * LANES + n] = 0.0
            a[(X_BLOCK + 8) * LANES + n] = 0.0
    else:
        # F = N n_2 with N = f / D, D = cosine + friction * sine, p = seat + s n_1, s = delta . n_2 / cosine.
        nx = c[k + 6]
        ny = c[k + 7]
        nz = c[k + 8]
        cosine = nx * r01 + ny * r11 + nz * r21
        sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
        balance = cosine / share
        # The friction is kinked where rod and plate are aligned: 0 is one of its slopes there.
        bend = 1.0 - c[GUIDE_FRICTION] * cosine / sine if sine > 1e-12 else 1.0
        force = f / balance
        inverse = 1.0 / cosine
        for n in range(LANES):
            hx = a[X * LANES + n]
            hy = a[(X + 1) * LANES + n]
            hz = a[(X + 2) * LANES + n]
            cx = a[(X + 3) * LANES + n]
            cy = a[(X + 4) * LANES + n]
            cz = a[(X + 5) * LANES + n]
            along = (hx * r01 + hy * r11 + hz * r21) / balance
            bar = (a[(X + 6) * LANES + n] + slope * along + cx * nx + cy * ny + cz * nz) * inverse
            by_balance = -along * force
            by_cosine = by_balance * bend - bar * s
            a[(X + 7) * LANES + n] = along
            a[(X + 8) * LANES + n] = bar * r01
            a[(X + 9) * LANES + n] = bar * r11
            a[(X + 10) * LANES + n] = bar * r21
            a[(X + 11) * LANES + n] = force * hx + bar * dx + by_cosine * nx
            a[(X + 12) * LANES + n] = force * hy + bar * dy + by_cosine * ny
            a[(X + 13) * LANES + n] = force * hz + bar * dz + by_cosine * nz
            a[(X + 14) * LANES + n] = 0.0
            a[(X + 15) * LANES + n] = by_balance * sine
            a[X_BLOCK * LANES + n] = cx - bar * r01
            a[(X_BLOCK + 1) * LANES + n] = cy - bar * r11
            a[(X_BLOCK + 2) * LANES + n] = cz - bar * r21
            a[(X_BLOCK + 6) * LANES + n] = s * cx + by_cosine * r01
            a[(X_BLOCK + 7) * LANES + n] = s * cy + by_cosine * r11
            a[(X_BLOCK + 8) * LANES + n] = s * cz + by_cosine * r21
    for n in range(LANES):
        along = a[(X + 7) * LANES + n]
        vx = a[(X + 8) * LANES + n]
        vy = a[(X + 9) * LANES + n]
        vz = a[(X + 10) * LANES + n]
        a[(X_BLOCK + 3) * LANES + n] = r00 * vx + r10 * vy + r20 * vz
        a[(X_BLOCK + 4) * LANES + n] = r01 * vx + r11 * vy + r21 * vz
        a[(X_BLOCK + 5) * LANES + n] = r02 * vx + r12 * vy + r22 * vz
        a[(X_BLOCK + 9) * LANES + n] = by_stiffness * along
        a[(X_BLOCK + 10) * LANES + n] = by_deformation * along
        a[(X_BLOCK + 11) * LANES + n] = 0.0
        a[(X_BLOCK + 12) * LANES + n] = 0.0
        a[(X_BLOCK + 13) * LANES + n] = value * along
        a[M * LANES + n] += vx * u
        a[(M + 1) * LANES + n] += vx * v + a[(X + 11) * LANES + n]
        a[(M + 2) * LANES + n] += vx * w
        a[(M + 3) * LANES + n] += vy * u
        a[(M + 4) * LANES + n] += vy * v + a[(X + 12) * LANES + n]
        a[(M + 5) * LANES + n] += vy * w
        a[(M + 6) * LANES + n] += vz * u
        a[(M + 7) * LANES + n] += vz * v + a[(X + 13) * LANES + n]
        a[(M + 8) * LANES + n] += vz * w
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
        tx = a[(S + 3) * LANES + n]
        ty = a[(S + 4) * LANES + n]
        tz = a[(S + 5) * LANES + n]
        px = a[(S + 6) * LANES + n]
        py = a[(S + 7) * LANES + n]
        pz = a[(S + 8) * LANES + n]
        # Of the force: from the sum, from (c - d) x F and from -c x F. Of the contact point c and of d: from these too.
        a[X * LANES + n] = a[S * LANES + n] + ty * bz - tz * by - py * cz + pz * cy
        a[(X + 1) * LANES + n] = a[(S + 1) * LANES + n] + tz * bx - tx * bz - pz * cx + px * cz
        a[(X + 2) * LANES + n] = a[(S + 2) * LANES + n] + tx * by - ty * bx - px * cy + py * cx
        a[(X + 3) * LANES + n] = fy * (tz - pz) - fz * (ty - py)
        a[(X + 4) * LANES + n] = fz * (tx - px) - fx * (tz - pz)
        a[(X + 5) * LANES + n] = fx * (ty - py) - fy * (tx - px)
        a[(X + 6) * LANES + n] = 0.0
        a[(S + 9) * LANES + n] -= fy * tz - fz * ty
        a[(S + 10) * LANES + n] -= fz * tx - fx * tz
        a[(S + 11) * LANES + n] -= fx * ty - fy * tx
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
        px = a[(S + 6) * LANES + n]
        py = a[(S + 7) * LANES + n]
        pz = a[(S + 8) * LANES + n]
        tx = a[(S + 3) * LANES + n] - px
        ty = a[(S + 4) * LANES + n] - py
        tz = a[(S + 5) * LANES + n] - pz
        a[(S + 9) * LANES + n] -= fy * pz - fz * py
        a[(S + 10) * LANES + n] -= fz * px - fx * pz
        a[(S + 11) * LANES + n] -= fx * py - fy * px
        # Rows X to X + 11: the adjoints of the sums of f n and f n b^T.
        a[X * LANES + n] = a[S * LANES + n] - (py * dz - pz * dy)
        a[(X + 1) * LANES + n] = a[(S + 1) * LANES + n] - (pz * dx - px * dz)
        a[(X + 2) * LANES + n] = a[(S + 2) * LANES + n] - (px * dy - py * dx)
        a[(X + 3) * LANES + n] = ty * r20 - tz * r10
        a[(X + 4) * LANES + n] = ty * r21 - tz * r11
        a[(X + 5) * LANES + n] = ty * r22 - tz * r12
        a[(X + 6) * LANES + n] = tz * r00 - tx * r20
        a[(X + 7) * LANES + n] = tz * r01 - tx * r21
        a[(X + 8) * LANES + n] = tz * r02 - tx * r22
        a[(X + 9) * LANES + n] = tx * r10 - ty * r00
        a[(X + 10) * LANES + n] = tx * r11 - ty * r01
        a[(X + 11) * LANES + n] = tx * r12 - ty * r02
        a[M * LANES + n] += tz * w10 - ty * w20
        a[(M + 1) * LANES + n] += tz * w11 - ty * w21
        a[(M + 2) * LANES + n] += tz * w12 - ty * w22
        a[(M + 3) * LANES + n] += tx * w20 - tz * w00
        a[(M + 4) * LANES + n] += tx * w21 - tz * w01
        a[(M + 5) * LANES + n] += tx * w22 - tz * w02
        a[(M + 6) * LANES + n] += ty * w00 - tx * w10
        a[(M + 7) * LANES + n] += ty * w01 - tx * w11
        a[(M + 8) * LANES + n] += ty * w02 - tx * w12
    for j in range(SUM_COLUMNS):
        factor = 1.0
        if j > 3:
            factor = r[j - 4]
        elif j > 0:
            factor = x[at + j - 1]
        # The adjoint of the matrix, and for j > 0 that of d or R.
        matrix = known((MATRIX + SUM_ROWS * j) * LANES)
        for n in range(SUM_ROWS * LANES):
            a[matrix + n] += factor * a[X * LANES + n]
        k = known(SUMS + SUM_ROWS * j)
        target = known((S + 8 + j if j < 4 else M + j - 4) * LANES)
        if j > 0:
            for n in range(LANES):
                a[target + n] += (
                    c[k] * a[X * LANES + n]
                    + c[k + 1] * a[(X + 1) * LANES + n]
                    + c[k + 2] * a[(X + 2) * LANES + n]
                    + c[k + 3] * a[(X + 3) * LANES + n]
                    + c[k + 4] * a[(X + 4) * LANES + n]
                    + c[k + 5] * a[(X + 5) * LANES + n]
                    + c[k + 6] * a[(X + 6) * LANES + n]
                    + c[k + 7] * a[(X + 7) * LANES + n]
                    + c[k + 8] * a[(X + 8) * LANES + n]
                    + c[k + 9] * a[(X + 9) * LANES + n]
                    + c[k + 10] * a[(X + 10) * LANES + n]
                    + c[k + 11] * a[(X + 11) * LANES + n]
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
            a[(X + 2) * LANES + lane] += sign * a[matrix + lane] * w[ROW + n]
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
                a[X * LANES + lane] += weight * a[matrix + lane]
        for j in range(SUM_ROWS):
            weight = sign * w[ROW + j]
            matrix = known((MATRIX + SUM_ROWS * (1 + row) + j) * LANES)
            for lane in range(LANES):
                a[(X + 1) * LANES + lane] += weight * a[matrix + lane]
        by_direction = known((g + 6 + axis) * LANES)
        by_arm = known((g + 3 + arm) * LANES)
        for lane in range(LANES):
            by_column = a[(X + 1) * LANES + lane]
            by_entry = a[X * LANES + lane] - stiffness * by_column
            a[(X + 3) * LANES + lane] -= direction * factor * by_column
            a[by_direction + lane] += factor * by_entry
            if row >= 3:
                a[by_arm + lane] += direction * by_entry
    at = known(g * LANES)
    for lane in range(LANES):
        constant = linear * a[(X + 2) * LANES + lane]
        by_stiffness = linear * a[(X + 3) * LANES + lane] + constant * c[k + DEFORMATION]
        for n in range(3):
            direction = c[k + 6 + n]
            by_stiffness += constant * direction * c[k + n]
            a[at + n * LANES + lane] += constant * stiffness * direction
            a[at + (6 + n) * LANES + lane] += constant * stiffness * c[k + n]
        a[at + 9 * LANES + lane] += scale * by_stiffness
        a[at + 10 * LANES + lane] += stiffness * constant
        a[at + 13 * LANES + lane] += c[k + STIFFNESS] * by_stiffness - (1.0 - linear) * a[(X + 2) * LANES + lane]


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
        v0 = a[row * LANES + n]
        v1 = a[(row + 1) * LANES + n]
        v2 = a[(row + 2) * LANES + n]
        b0 = j00 * v0 + j01 * v1 + j02 * v2
        b1 = j01 * v0 + j11 * v1 + j12 * v2
        b2 = j02 * v0 + j12 * v1 + j22 * v2
        a[row * LANES + n] = b0
        a[(row + 1) * LANES + n] = b1
        a[(row + 2) * LANES + n] = b2
        # h = I w enters as -w x h.
        e0 = o1 * b2 - o2 * b1
        e1 = o2 * b0 - o0 * b2
        e2 = o0 * b1 - o1 * b0
        a[target * LANES + n] += b1 * h2 - b2 * h1 + i00 * e0 + i01 * e1 + i02 * e2
        a[(target + 1) * LANES + n] += b2 * h0 - b0 * h2 + i01 * e0 + i11 * e1 + i12 * e2
        a[(target + 2) * LANES + n] += b0 * h1 - b1 * h0 + i02 * e0 + i12 * e1 + i22 * e2
        a[X * LANES + n] = e0 * o0 - b0 * a0
        a[(X + 1) * LANES + n] = e0 * o1 - b0 * a1
        a[(X + 2) * LANES + n] = e0 * o2 - b0 * a2
        a[(X + 3) * LANES + n] = e1 * o0 - b1 * a0
        a[(X + 4) * LANES + n] = e1 * o1 - b1 * a1
        a[(X + 5) * LANES + n] = e1 * o2 - b1 * a2
        a[(X + 6) * LANES + n] = e2 * o0 - b2 * a0
        a[(X + 7) * LANES + n] = e2 * o1 - b2 * a1
        a[(X + 8) * LANES + n] = e2 * o2 - b2 * a2
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
        vx = torque * a[row * LANES + n]
        vy = torque * a[(row + 1) * LANES + n]
        vz = torque * a[(row + 2) * LANES + n]
        wx = vy * nz - vz * ny
        wy = vz * nx - vx * nz
        wz = vx * ny - vy * nx
        a[(X + 9) * LANES + n] = hy * vz - hz * vy + i00 * wx + i01 * wy + i02 * wz
        a[(X + 10) * LANES + n] = hz * vx - hx * vz + i01 * wx + i11 * wy + i12 * wz
        a[(X + 11) * LANES + n] = hx * vy - hy * vx + i02 * wx + i12 * wy + i22 * wz
        a[X * LANES + n] = wx * nx
        a[(X + 1) * LANES + n] = wx * ny
        a[(X + 2) * LANES + n] = wx * nz
        a[(X + 3) * LANES + n] = wy * nx
        a[(X + 4) * LANES + n] = wy * ny
        a[(X + 5) * LANES + n] = wy * nz
        a[(X + 6) * LANES + n] = wz * nx
        a[(X + 7) * LANES + n] = wz * ny
        a[(X + 8) * LANES + n] = wz * nz


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
        vx = a[(KB + 3) * LANES + n]
        vy = a[(KB + 4) * LANES + n]
        vz = a[(KB + 5) * LANES + n]
        q = nx * vx + ny * vy + nz * vz
        a[OUT * LANES + n] -= rate * (vx - 3.0 * nx * q)
        a[(OUT + 1) * LANES + n] -= rate * (vy - 3.0 * ny * q)
        a[(OUT + 2) * LANES + n] -= rate * (vz - 3.0 * nz * q)
        # The adjoint of n stays in rows X + 12 to X + 14.
        a[(X + 12) * LANES + n] = 3.0 * rate * (along * vx + q * dx)
        a[(X + 13) * LANES + n] = 3.0 * rate * (along * vy + q * dy)
        a[(X + 14) * LANES + n] = 3.0 * rate * (along * vz + q * dz)
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
            gx = a[(X + 9) * LANES + n]
            gy = a[(X + 10) * LANES + n]
            gz = a[(X + 11) * LANES + n]
            a[M * LANES + n] += nx * gx
            a[(M + 1) * LANES + n] += nx * gy
            a[(M + 2) * LANES + n] += nx * gz
            a[(M + 3) * LANES + n] += ny * gx
            a[(M + 4) * LANES + n] += ny * gy
            a[(M + 5) * LANES + n] += ny * gz
            a[(M + 6) * LANES + n] += nz * gx
            a[(M + 7) * LANES + n] += nz * gy
            a[(M + 8) * LANES + n] += nz * gz
            a[(X + 12) * LANES + n] += r00 * gx + r01 * gy + r02 * gz
            a[(X + 13) * LANES + n] += r10 * gx + r11 * gy + r12 * gz
            a[(X + 14) * LANES + n] += r20 * gx + r21 * gy + r22 * gz
    # n = C_1^T e: the adjoint of C_1 is e h^T, with e = C_1 n.
    p00, p01, p02, p10, p11, p12, p20, p21, p22 = rotation_matrix_elements(w, u, v, z)
    ex = p00 * nx + p01 * ny + p02 * nz
    ey = p10 * nx + p11 * ny + p12 * nz
    ez = p20 * nx + p21 * ny + p22 * nz
    for n in range(LANES):
        hx = a[(X + 12) * LANES + n]
        hy = a[(X + 13) * LANES + n]
        hz = a[(X + 14) * LANES + n]
        a[(M + 9) * LANES + n] = ex * hx
        a[(M + 10) * LANES + n] = ex * hy
        a[(M + 11) * LANES + n] = ex * hz
        a[(M + 12) * LANES + n] = ey * hx
        a[(M + 13) * LANES + n] = ey * hy
        a[(M + 14) * LANES + n] = ey * hz
        a[(M + 15) * LANES + n] = ez * hx
        a[(M + 16) * LANES + n] = ez * hy
        a[(M + 17) * LANES + n] = ez * hz
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
        a0 = a[KB * LANES + n]
        a1 = a[(KB + 1) * LANES + n]
        a2 = a[(KB + 2) * LANES + n]
        b0 = a[(KB + 3) * LANES + n]
        b1 = a[(KB + 4) * LANES + n]
        b2 = a[(KB + 5) * LANES + n]
        a[OUT * LANES + n] = p1 * a2 - p2 * a1
        a[(OUT + 1) * LANES + n] = p2 * a0 - p0 * a2
        a[(OUT + 2) * LANES + n] = p0 * a1 - p1 * a0
        a[(OUT + 3) * LANES + n] = a0 + p1 * b2 - p2 * b1
        a[(OUT + 4) * LANES + n] = a1 + p2 * b0 - p0 * b2
        a[(OUT + 5) * LANES + n] = a2 + p0 * b1 - p1 * b0
        w0 = a1 * d2 - a2 * d1 + b1 * v2 - b2 * v1
        w1 = a2 * d0 - a0 * d2 + b2 * v0 - b0 * v2
        w2 = a0 * d1 - a1 * d0 + b0 * v1 - b1 * v0
        # Q' = (Q (x) [0, omega_2] - [0, omega_1] (x) Q) / 2; q1' = q1 (x) [0, omega_1] / 2.
        k0 = 0.5 * a[(KB + 12) * LANES + n]
        k1 = 0.5 * a[(KB + 13) * LANES + n]
        k2 = 0.5 * a[(KB + 14) * LANES + n]
        k3 = 0.5 * a[(KB + 15) * LANES + n]
        a[(OUT + 12) * LANES + n] = k1 * e0 + k2 * e1 + k3 * e2
        a[(OUT + 13) * LANES + n] = -k0 * e0 - k2 * f2 + k3 * f1
        a[(OUT + 14) * LANES + n] = -k0 * e1 + k1 * f2 - k3 * f0
        a[(OUT + 15) * LANES + n] = -k0 * e2 - k1 * f1 + k2 * f0
        u0 = -k0 * q1 + k1 * q0
        u1 = -k0 * q2 + k2 * q0
        u2 = -k0 * q3 + k3 * q0
        y0 = k2 * q3 - k3 * q2
        y1 = -k1 * q3 + k3 * q1
        y2 = k1 * q2 - k2 * q1
        k0 = 0.5 * a[(KB + 16) * LANES + n]
        k1 = 0.5 * a[(KB + 17) * LANES + n]
        k2 = 0.5 * a[(KB + 18) * LANES + n]
        k3 = 0.5 * a[(KB + 19) * LANES + n]
        a[(OUT + 16) * LANES + n] = k1 * p0 + k2 * p1 + k3 * p2
        a[(OUT + 17) * LANES + n] = -k0 * p0 - k2 * p2 + k3 * p1
        a[(OUT + 18) * LANES + n] = -k0 * p1 + k1 * p2 - k3 * p0
        a[(OUT + 19) * LANES + n] = -k0 * p2 - k1 * p1 + k2 * p0
        a[(OUT + 6) * LANES + n] = w0 - u0 + y0 - k0 * z1 + k1 * z0 + k2 * z3 - k3 * z2
        a[(OUT + 7) * LANES + n] = w1 - u1 + y1 - k0 * z2 - k1 * z3 + k2 * z0 + k3 * z1
        a[(OUT + 8) * LANES + n] = w2 - u2 + y2 - k0 * z3 + k1 * z2 - k2 * z1 + k3 * z0
        a[(OUT + 9) * LANES + n] = u0 + y0
        a[(OUT + 10) * LANES + n] = u1 + y1
        a[(OUT + 11) * LANES + n] = u2 + y2


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
        a[(S + 12) * LANES + n] = a[(KB + 6) * LANES + n]
    body_adjoint(
        c, PLATFORM_INERTIA, x[at + 6], x[at + 7], x[at + 8], x, row + 6, S + 12, OUT + 6, G_PLATFORM_INERTIA, a
    )
    body_adjoint(
        c, SATELLITE_INERTIA, x[at + 9], x[at + 10], x[at + 11], x, row + 9, S + 15, OUT + 9, G_SATELLITE_INERTIA, a
    )
    for n in range(LANES):
        b0 = a[(KB + 3) * LANES + n]
        b1 = a[(KB + 4) * LANES + n]
        b2 = a[(KB + 5) * LANES + n]
        a[S * LANES + n] = inverse_mass * b0
        a[(S + 1) * LANES + n] = inverse_mass * b1
        a[(S + 2) * LANES + n] = inverse_mass * b2
        a[G * LANES + n] += fx * b0 + fy * b1 + fz * b2
        # The moment on the platform as it is, that on the satellite turned by R^T.
        a0 = a[(S + 15) * LANES + n]
        a1 = a[(S + 16) * LANES + n]
        a2 = a[(S + 17) * LANES + n]
        a[(S + 3) * LANES + n] = r00 * a0 + r01 * a1 + r02 * a2
        a[(S + 4) * LANES + n] = r10 * a0 + r11 * a1 + r12 * a2
        a[(S + 5) * LANES + n] = r20 * a0 + r21 * a1 + r22 * a2
        a[(S + 6) * LANES + n] = a[(S + 12) * LANES + n]
        a[(S + 7) * LANES + n] = a[(S + 13) * LANES + n]
        a[(S + 8) * LANES + n] = a[(S + 14) * LANES + n]
        a[(S + 9) * LANES + n] = 0.0
        a[(S + 10) * LANES + n] = 0.0
        a[(S + 11) * LANES + n] = 0.0
        a[M * LANES + n] = sx * a0
        a[(M + 1) * LANES + n] = sx * a1
        a[(M + 2) * LANES + n] = sx * a2
        a[(M + 3) * LANES + n] = sy * a0
        a[(M + 4) * LANES + n] = sy * a1
        a[(M + 5) * LANES + n] = sy * a2
        a[(M + 6) * LANES + n] = sz * a0
        a[(M + 7) * LANES + n] = sz * a1
        a[(M + 8) * LANES + n] = sz * a2
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
            a[KB * LANES + n] = b * a[known(lam * LANES) + n]
        for later in range(i + 1, last + 1):
            b = h * A[method, later, i]
            if b != 0.0:
                for n in range(STATE_SIZE * LANES):
                    a[KB * LANES + n] += b * a[known((YB + later * STATE_SIZE) * LANES) + n]
        derivative_adjoint(t + C[method, i] * h, w, i * STATE_SIZE, K + i * STATE_SIZE, a, c, marks)
        for n in range(STATE_SIZE * LANES):
            a[known((YB + i * STATE_SIZE) * LANES) + n] = a[OUT * LANES + n]
    for i in range(last + 1):
        add(a, YB + i * STATE_SIZE, lam, ROWS)


@njit(**KERNEL)
def clearance_adjoint(x, i, lane, kind, c, marks, lam, follow, tail, a):
    """Add to one lane of the rows from `lam` on the adjoint of the clearance of envelope point i at state x.

    That is at its exit, whose time moves, or at a fixed or extremal time. Constants from row `tail`: CG of the
    platform, CG of the satellite, radius, depth, offsets of the planes.
    """
    point = follow.room
    point_motion(x, c, marks, i, point)
    _, wall = nearest_wall(c, marks, point)
    if wall == 0:
        rho = math.sqrt(point[0] * point[0] + point[2] * point[2])
        bx = -point[0] / rho
        by = 0.0
        bz = -point[2] / rho
        a[(tail + 6) * LANES + lane] += 1.0
    else:
        k = marks[PLANES] + PLANE_COLUMNS * (wall - 1)
        bx = c[k]
        by = c[k + 1]
        bz = c[k + 2]
        a[(tail + 7 + wall) * LANES + lane] -= 1.0
    if kind == AT_EXIT:
        # The exit waits for y = depth.
        drift = (bx * point[3] + by * point[4] + bz * point[5]) / point[4]
        by -= drift
        a[(tail + 7) * LANES + lane] += drift
    a[lam * LANES + lane] += bx
    a[(lam + 1) * LANES + lane] += by
    a[(lam + 2) * LANES + lane] += bz
    a[tail * LANES + lane] += bx
    a[(tail + 1) * LANES + lane] += by
    a[(tail + 2) * LANES + lane] += bz
    r = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    clear(a, M, NINE)
    for j in range(3):
        arm = c[marks[POINTS] + POINT_COLUMNS * i + j] - c[SATELLITE_CG + j]
        a[(M + j) * LANES + lane] = bx * arm
        a[(M + 3 + j) * LANES + lane] = by * arm
        a[(M + 6 + j) * LANES + lane] = bz * arm
        a[(tail + 3 + j) * LANES + lane] -= r[j] * bx + r[3 + j] * by + r[6 + j] * bz
    add_rotation_adjoint(a, M, x[12], x[13], x[14], x[15], lam + 12)


@njit(**ONCE)
def branch_adjoint(columns, block, index, step, w, c, marks, tape, follow, tail, a):
    """Add, at tape state `index`, the clearances that are reached from there by one step within step `step`."""
    point_number = marks[POINT_NUMBER]
    closest = int(follow.closest[1])
    kind = int(follow.closest[2])
    for i in range(point_number + 1):
        # Behind the exits of all points stands the smallest clearance, if it was met between the ends of a step.
        if i < point_number:
            wanted = follow.step[i] == step and follow.base[i] == index
        else:
            wanted = kind == INSIDE and int(follow.closest[3]) == step and index == step
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
            a[(X + 6) * LANES + lane] += a[(LAM + n) * LANES + lane] * w[K + n]
    k = G_SPRINGS + G_SPRING_SIZE * spring
    if event == PUSH_STARTS:
        # The step's end is the delay itself.
        for lane in range(LANES):
            speed = a[(X + 6) * LANES + lane]
            a[(k + 12) * LANES + lane] += a[MU * LANES + lane] + speed
            a[MU * LANES + lane] = -speed
        return
    _, rate, _ = seat_motion(w, START, K, c, marks, spring)
    for lane in range(LANES):
        bar = -(a[(X + 6) * LANES + lane] + a[MU * LANES + lane]) / rate
        a[(X + 6) * LANES + lane] = bar
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


@njit(**ONCE)
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
        top = max(top, follow.base[i])
    for index in range(top, -1, -1):
        if index == last:
            for lane in range(LANES):
                column = columns[block + lane]
                if 0 <= column < STATE_SIZE:
                    a[(LAM + column) * LANES + lane] += 1.0
                elif column == STATE_SIZE:
                    a[MU * LANES + lane] = 1.0
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
    if marks[POINT_NUMBER] > 0 and int(follow.closest[2]) == AT_START:
        for lane in range(LANES):
            if columns[block + lane] == STATE_SIZE + 1:
                clearance_adjoint(tape.x[0], int(follow.closest[1]), lane, INSIDE, c, marks, LAM, follow, tail, a)
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
    w = LAM * LANES + lane
    wx = a[w + 3 * LANES]
    wy = a[w + 4 * LANES]
    wz = a[w + 5 * LANES]
    dx = a[w] + wy * oz - wz * oy
    dy = a[w + LANES] + wz * ox - wx * oz
    dz = a[w + 2 * LANES] + wx * oy - wy * ox
    a[G * LANES + lane] += wx * ix + wy * iy + wz * iz
    # omega_1 = Omega + I_1^-1 (-Delta h + (c_1 - l_0 y) x Delta p).
    px = a[w + 6 * LANES]
    py = a[w + 7 * LANES]
    pz = a[w + 8 * LANES]
    ax, ay, az = times(c, PLATFORM_INVERSE_INERTIA, px, py, pz)
    # omega_2 = R^T Omega + I_2^-1 R^T h with h = Delta h - u x Delta p, u = R c_2.
    vx = a[w + 9 * LANES]
    vy = a[w + 10 * LANES]
    vz = a[w + 11 * LANES]
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
    m = M * LANES + lane
    a[m] = ox * vx + kx * bx + qx * p[17]
    a[m + LANES] = ox * vy + kx * by + qx * p[18]
    a[m + 2 * LANES] = ox * vz + kx * bz + qx * p[19]
    a[m + 3 * LANES] = oy * vx + ky * bx + qy * p[17]
    a[m + 4 * LANES] = oy * vy + ky * by + qy * p[18]
    a[m + 5 * LANES] = oy * vz + ky * bz + qy * p[19]
    a[m + 6 * LANES] = oz * vx + kz * bx + qz * p[17]
    a[m + 7 * LANES] = oz * vy + kz * by + qz * p[18]
    a[m + 8 * LANES] = oz * vz + kz * bz + qz * p[19]
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
    a[G_STOWED * LANES + lane] -= ey
    t = tail * LANES + lane
    a[t] += ex
    a[t + LANES] += ey
    a[t + 2 * LANES] += ez
    a[t + 3 * LANES] += r00 * qx + r10 * qy + r20 * qz
    a[t + 4 * LANES] += r01 * qx + r11 * qy + r21 * qz
    a[t + 5 * LANES] += r02 * qx + r12 * qy + r22 * qz
    # The rates that the impulses gave both bodies, for their inertias.
    k0 = x[9] - (r00 * ox + r10 * oy + r20 * oz)
    k1 = x[10] - (r01 * ox + r11 * oy + r21 * oz)
    k2 = x[11] - (r02 * ox + r12 * oy + r22 * oz)
    for j in range(3):
        b = bx if j == 0 else by if j == 1 else bz
        e = ax if j == 0 else ay if j == 1 else az
        q = (G_SATELLITE_INERTIA + 3 * j) * LANES + lane
        a[q] -= b * k0
        a[q + LANES] -= b * k1
        a[q + 2 * LANES] -= b * k2
        q = (G_PLATFORM_INERTIA + 3 * j) * LANES + lane
        a[q] -= e * (x[6] - ox)
        a[q + LANES] -= e * (x[7] - oy)
        a[q + 2 * LANES] -= e * (x[8] - oz)


@njit(**KERNEL)
def mounting_adjoint(p, lane, a, gradient):
    """From the adjoint of the initial quaternion of the satellite to that of the mounting error, a rotation vector."""
    square = p[MOUNTING_ERROR] ** 2 + p[MOUNTING_ERROR + 1] ** 2 + p[MOUNTING_ERROR + 2] ** 2
    scale = 0.5 - square / 48.0
    bend = -1.0 / 24.0 + square / 960.0
    if square > 1e-4:
        angle = math.sqrt(square)
        scale = math.sin(0.5 * angle) / angle
        bend = (0.5 * math.cos(0.5 * angle) - scale) / square
    q = (LAM + 12) * LANES + lane
    along = (
        a[q + LANES] * p[MOUNTING_ERROR]
        + a[q + 2 * LANES] * p[MOUNTING_ERROR + 1]
        + a[q + 3 * LANES] * p[MOUNTING_ERROR + 2]
    )
    for j in range(3):
        gradient[MOUNTING_ERROR + j] = scale * a[q + (1 + j) * LANES] + p[MOUNTING_ERROR + j] * (
            bend * along - 0.5 * scale * a[q]
        )


@njit(**KERNEL)
def parameter_adjoint(p, marks, lane, tail, a, gradient):
    """From the adjoints of the constants of a run to those of its parameters; see `flight.prepare`."""
    stowed = p[STOWED]
    g_stowed = a[G_STOWED * LANES + lane]
    for body in range(2):
        k = 10 * body
        q = (G_PLATFORM_INERTIA + 9 * body) * LANES + lane
        gradient[k] = -a[G * LANES + lane] / p[k] ** 2
        gradient[k + 1] = a[q]
        gradient[k + 2] = a[q + 4 * LANES]
        gradient[k + 3] = a[q + 8 * LANES]
        gradient[k + 4] = a[q + LANES] + a[q + 3 * LANES]
        gradient[k + 5] = a[q + 2 * LANES] + a[q + 6 * LANES]
        gradient[k + 6] = a[q + 5 * LANES] + a[q + 7 * LANES]
        for j in range(3):
            gradient[k + 7 + j] = a[(tail + 3 * body + j) * LANES + lane]
    gradient[RECESS_RADIUS] = a[(tail + 6) * LANES + lane]
    gradient[RECESS_DEPTH] = a[(tail + 7) * LANES + lane]
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
        ay = a[k + LANES]
        az = a[k + 2 * LANES]
        bx = a[k + 3 * LANES]
        by = a[k + 4 * LANES]
        bz = a[k + 5 * LANES]
        nx = a[k + 6 * LANES] - stowed * ax
        ny = a[k + 7 * LANES] - stowed * ay
        nz = a[k + 8 * LANES] - stowed * az
        g_stowed += ax * sb * sa + ay * (1.0 - cb) - az * sb * ca
        gradient[q] = radius * (ca * (az + bz) - sa * (ax + bx)) - sb * (ca * nx + sa * nz)
        gradient[q + 1] = ca * (ax + bx) + sa * (az + bz)
        gradient[q + 2] = a[k + 9 * LANES]
        gradient[q + 3] = a[k + 10 * LANES]
        gradient[q + 4] = 0.0
        by_deformation = marks[SPRING_MARKS + MARK_COLUMNS * i + LAW] == LINEAR and p[q + 3] < p[q + 4]
        gradient[q + 3 if by_deformation else q + 4] += a[k + 11 * LANES]
        gradient[q + 5] = cb * (ca * nz - sa * nx) - sb * ny
        gradient[q + 6] = a[k + 12 * LANES]
        gradient[q + 7] = a[k + 13 * LANES]
        gradient[7] -= ax
        gradient[8] -= ay
        gradient[9] -= az
        gradient[17] -= bx
        gradient[18] -= by
        gradient[19] -= bz
    gradient[STOWED] = g_stowed
    for wall in range(marks[PLANE_NUMBER]):
        gradient[COMMON_SIZE + SPRING_SIZE * marks[SPRING_NUMBER] + wall] = a[(tail + 8 + wall) * LANES + lane]
