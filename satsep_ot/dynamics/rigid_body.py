"""Newton-Euler equations of the two bodies, reduced to their relative motion.

Hu et al. (2017), equations 1, 2, 9 and 10, with the reaction on the platform added. Free of cancellation: nothing but
the relative position (metres) is integrated, never coordinates of 7e6 m.
"""

from numba import njit

from satsep_ot.dynamics.compilation import INLINE, known
from satsep_ot.dynamics.gravity import earth_vector, gradient_torque, near_differential_gravity
from satsep_ot.dynamics.rotations import rotation_matrix_elements
from satsep_ot.dynamics.springs import GUIDED, TABLE, contact, law
from satsep_ot.dynamics.system import (
    ACTIVE,
    FORCE_LINE,
    FORCES,
    GRAVITY_LEVEL,
    INVERSE_RADIUS,
    INVERSE_REDUCED_MASS,
    INVERSE_SQUARE,
    LAW,
    MARK_COLUMNS,
    PLATFORM_INERTIA,
    PLATFORM_INVERSE_INERTIA,
    PUSHING,
    SATELLITE_INERTIA,
    SATELLITE_INVERSE_INERTIA,
    SCALE,
    SPRING_COLUMNS,
    SPRING_MARKS,
    SPRING_NUMBER,
    SPRINGS,
    SUM_ROWS,
    SUMS,
    TABLE_NUMBER,
)


@njit(**INLINE)
def times(c, k, x, y, z):
    """The product of the 3 x 3 matrix stored row by row from c[k] with (x, y, z)."""
    return (
        c[k] * x + c[k + 1] * y + c[k + 2] * z,
        c[k + 3] * x + c[k + 4] * y + c[k + 5] * z,
        c[k + 6] * x + c[k + 7] * y + c[k + 8] * z,
    )


@njit(**INLINE)
def guided_sums(x, at, r, c):
    """Forces and moments of the guided springs by their sums, as `spring_sums` has them; fills x[FORCES:]."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    dx = x[at]
    dy = x[at + 1]
    dz = x[at + 2]
    for n in range(SUM_ROWS):
        x[FORCES + n] = (
            c[SUMS + n]
            + c[SUMS + 12 + n] * dx
            + c[SUMS + 24 + n] * dy
            + c[SUMS + 36 + n] * dz
            + c[SUMS + 48 + n] * r00
            + c[SUMS + 60 + n] * r01
            + c[SUMS + 72 + n] * r02
            + c[SUMS + 84 + n] * r10
            + c[SUMS + 96 + n] * r11
            + c[SUMS + 108 + n] * r12
            + c[SUMS + 120 + n] * r20
            + c[SUMS + 132 + n] * r21
            + c[SUMS + 144 + n] * r22
        )
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
    # Moment about the satellite's CG, the sum of (R b) x f n; and -(d + R b) x f n on the platform.
    sx = r10 * w20 + r11 * w21 + r12 * w22 - r20 * w10 - r21 * w11 - r22 * w12
    sy = r20 * w00 + r21 * w01 + r22 * w02 - r00 * w20 - r01 * w21 - r02 * w22
    sz = r00 * w10 + r01 * w11 + r02 * w12 - r10 * w00 - r11 * w01 - r12 * w02
    return fx, fy, fz, sx, sy, sz, dz * fy - dy * fz - sx, dx * fz - dz * fx - sy, dy * fx - dx * fy - sz


@njit(**INLINE)
def spring_sums(x, at, r, c, marks):
    """Force on the satellite, its moment about the satellite's CG, and the moment on the platform; platform axes."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    guided = marks[FORCE_LINE] == GUIDED
    fx, fy, fz, sx, sy, sz, px, py, pz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if guided and marks[PUSHING] > 0:
        fx, fy, fz, sx, sy, sz, px, py, pz = guided_sums(x, at, r, c)
    if guided and marks[TABLE_NUMBER] == 0:
        return fx, fy, fz, sx, sy, sz, px, py, pz
    dx = x[at]
    dy = x[at + 1]
    dz = x[at + 2]
    for i in range(marks[SPRING_NUMBER]):
        m = known(SPRING_MARKS + MARK_COLUMNS * i)
        if marks[m + ACTIVE] and not (guided and marks[m + LAW] != TABLE):
            k = known(SPRINGS + SPRING_COLUMNS * i)
            u = c[k + 3]
            v = c[k + 4]
            w = c[k + 5]
            qx = dx + r00 * u + r01 * v + r02 * w
            qy = dy + r10 * u + r11 * v + r12 * w
            qz = dz + r20 * u + r21 * v + r22 * w
            s, gx, gy, gz, cx, cy, cz, share = contact(c, marks, i, qx, qy, qz, r01, r11, r21)
            f, _, _, _ = law(c, marks, i, s)
            f *= c[k + SCALE] * share
            gx *= f
            gy *= f
            gz *= f
            fx += gx
            fy += gy
            fz += gz
            px -= cy * gz - cz * gy
            py -= cz * gx - cx * gz
            pz -= cx * gy - cy * gx
            cx -= dx
            cy -= dy
            cz -= dz
            sx += cy * gz - cz * gy
            sy += cz * gx - cx * gz
            sz += cx * gy - cy * gx
    return fx, fy, fz, sx, sy, sz, px, py, pz


@njit(**INLINE)
def derivative(t, x, at, row, c, marks):
    """Write the time derivative of the state x[at : at + STATE_SIZE] at time t into x[row : row + STATE_SIZE]."""
    r = rotation_matrix_elements(x[at + 12], x[at + 13], x[at + 14], x[at + 15])
    fx, fy, fz, sx, sy, sz, px, py, pz = spring_sums(x, at, r, c, marks)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    # The moment on the satellite, from platform into satellite axes.
    mx = r00 * sx + r10 * sy + r20 * sz
    my = r01 * sx + r11 * sy + r21 * sz
    mz = r02 * sx + r12 * sy + r22 * sz
    o1x = x[at + 6]
    o1y = x[at + 7]
    o1z = x[at + 8]
    o2x = x[at + 9]
    o2y = x[at + 10]
    o2z = x[at + 11]
    ax = c[INVERSE_REDUCED_MASS] * fx
    ay = c[INVERSE_REDUCED_MASS] * fy
    az = c[INVERSE_REDUCED_MASS] * fz
    if marks[GRAVITY_LEVEL] != 0:
        ex, ey, ez, rate = earth_vector(t, c, x[at + 16], x[at + 17], x[at + 18], x[at + 19])
        gx, gy, gz = near_differential_gravity(rate, c[INVERSE_SQUARE], ex, ey, ez, x[at], x[at + 1], x[at + 2])
        ax += gx
        ay += gy
        az += gz
        if marks[GRAVITY_LEVEL] == 2:
            nx = ex * c[INVERSE_RADIUS]
            ny = ey * c[INVERSE_RADIUS]
            nz = ez * c[INVERSE_RADIUS]
            hx, hy, hz = times(c, PLATFORM_INERTIA, nx, ny, nz)
            gx, gy, gz = gradient_torque(rate, nx, ny, nz, hx, hy, hz)
            px += gx
            py += gy
            pz += gz
            # The same direction serves both bodies: they are metres apart at 7e6 m.
            ux = r00 * nx + r10 * ny + r20 * nz
            uy = r01 * nx + r11 * ny + r21 * nz
            uz = r02 * nx + r12 * ny + r22 * nz
            hx, hy, hz = times(c, SATELLITE_INERTIA, ux, uy, uz)
            gx, gy, gz = gradient_torque(rate, ux, uy, uz, hx, hy, hz)
            mx += gx
            my += gy
            mz += gz
    x[row] = x[at + 3] - (o1y * x[at + 2] - o1z * x[at + 1])
    x[row + 1] = x[at + 4] - (o1z * x[at] - o1x * x[at + 2])
    x[row + 2] = x[at + 5] - (o1x * x[at + 1] - o1y * x[at])
    x[row + 3] = ax - (o1y * x[at + 5] - o1z * x[at + 4])
    x[row + 4] = ay - (o1z * x[at + 3] - o1x * x[at + 5])
    x[row + 5] = az - (o1x * x[at + 4] - o1y * x[at + 3])
    hx, hy, hz = times(c, PLATFORM_INERTIA, o1x, o1y, o1z)
    vx, vy, vz = times(
        c, PLATFORM_INVERSE_INERTIA, px - o1y * hz + o1z * hy, py - o1z * hx + o1x * hz, pz - o1x * hy + o1y * hx
    )
    x[row + 6] = vx
    x[row + 7] = vy
    x[row + 8] = vz
    hx, hy, hz = times(c, SATELLITE_INERTIA, o2x, o2y, o2z)
    vx, vy, vz = times(
        c, SATELLITE_INVERSE_INERTIA, mx - o2y * hz + o2z * hy, my - o2z * hx + o2x * hz, mz - o2x * hy + o2y * hx
    )
    x[row + 9] = vx
    x[row + 10] = vy
    x[row + 11] = vz
    # Equation 3 as quaternions: Q' = (Q (x) [0, omega_2] - [0, omega_1] (x) Q) / 2 and q1' = q1 (x) [0, omega_1] / 2.
    w = 0.5 * x[at + 12]
    u = 0.5 * x[at + 13]
    v = 0.5 * x[at + 14]
    z = 0.5 * x[at + 15]
    x[row + 12] = -u * (o2x - o1x) - v * (o2y - o1y) - z * (o2z - o1z)
    x[row + 13] = w * (o2x - o1x) + v * (o2z + o1z) - z * (o2y + o1y)
    x[row + 14] = w * (o2y - o1y) + z * (o2x + o1x) - u * (o2z + o1z)
    x[row + 15] = w * (o2z - o1z) + u * (o2y + o1y) - v * (o2x + o1x)
    w = 0.5 * x[at + 16]
    u = 0.5 * x[at + 17]
    v = 0.5 * x[at + 18]
    z = 0.5 * x[at + 19]
    x[row + 16] = -u * o1x - v * o1y - z * o1z
    x[row + 17] = w * o1x + v * o1z - z * o1y
    x[row + 18] = w * o1y + z * o1x - u * o1z
    x[row + 19] = w * o1z + u * o1y - v * o1x


@njit(**INLINE)
def seat_motion(x, at, row, c, marks, i):
    """Stroke of spring i in the state x[at:] with the slope x[row:], its rate, and its acceleration.

    That is up to the terms of second order in the rates: for prediction.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_matrix_elements(
        x[at + 12], x[at + 13], x[at + 14], x[at + 15]
    )
    k = known(SPRINGS + SPRING_COLUMNS * i)
    u = c[k + 3]
    v = c[k + 4]
    w = c[k + 5]
    qx = x[at] + r00 * u + r01 * v + r02 * w
    qy = x[at + 1] + r10 * u + r11 * v + r12 * w
    qz = x[at + 2] + r20 * u + r21 * v + r22 * w
    s, gx, gy, gz, cx, cy, cz, _ = contact(c, marks, i, qx, qy, qz, r01, r11, r21)
    # Velocity of the satellite's material point at the contact in platform axes: arm from the satellite's CG, turned.
    bx = cx - x[at]
    by = cy - x[at + 1]
    bz = cz - x[at + 2]
    ox = r00 * x[at + 9] + r01 * x[at + 10] + r02 * x[at + 11]
    oy = r10 * x[at + 9] + r11 * x[at + 10] + r12 * x[at + 11]
    oz = r20 * x[at + 9] + r21 * x[at + 10] + r22 * x[at + 11]
    rate = (
        gx * (x[at + 3] + oy * bz - oz * by - x[at + 7] * cz + x[at + 8] * cy)
        + gy * (x[at + 4] + oz * bx - ox * bz - x[at + 8] * cx + x[at + 6] * cz)
        + gz * (x[at + 5] + ox * by - oy * bx - x[at + 6] * cy + x[at + 7] * cx)
    )
    ox = r00 * x[row + 9] + r01 * x[row + 10] + r02 * x[row + 11]
    oy = r10 * x[row + 9] + r11 * x[row + 10] + r12 * x[row + 11]
    oz = r20 * x[row + 9] + r21 * x[row + 10] + r22 * x[row + 11]
    acceleration = (
        gx * (x[row + 3] + oy * bz - oz * by - x[row + 7] * cz + x[row + 8] * cy)
        + gy * (x[row + 4] + oz * bx - ox * bz - x[row + 8] * cx + x[row + 6] * cz)
        + gz * (x[row + 5] + ox * by - oy * bx - x[row + 6] * cy + x[row + 7] * cx)
    )
    return s, rate, acceleration
