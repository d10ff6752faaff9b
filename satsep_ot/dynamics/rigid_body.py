"""Newton-Euler equations of the two bodies, reduced to their relative motion.

Hu et al. (2017), equations 1, 2, 9 and 10, with the reaction on the platform added. Free of cancellation: nothing but
the relative position (metres) is integrated, never coordinates of 7e6 m.
"""

import math

from numba import njit

from satsep_ot.dynamics.compilation import KERNEL
from satsep_ot.dynamics.gravity import differential_gravity, gradient_torque, orbit_position
from satsep_ot.dynamics.rotations import rotation_matrix_elements
from satsep_ot.dynamics.springs import push_direction
from satsep_ot.dynamics.system import (
    DEFORMATION,
    INVERSE_REDUCED_MASS,
    ORBIT,
    PLATFORM_INERTIA,
    PLATFORM_INVERSE_INERTIA,
    SATELLITE_INERTIA,
    SATELLITE_INVERSE_INERTIA,
    STIFFNESS,
)


@njit(**KERNEL)
def times(c, k, x, y, z):
    """The product of the 3 x 3 matrix stored row by row from c[k] with (x, y, z)."""
    return (
        c[k] * x + c[k + 1] * y + c[k + 2] * z,
        c[k + 3] * x + c[k + 4] * y + c[k + 5] * z,
        c[k + 6] * x + c[k + 7] * y + c[k + 8] * z,
    )


@njit(**KERNEL)
def cross(ax, ay, az, bx, by, bz):
    """The vector product a x b."""
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(**KERNEL)
def spring_sums(x, r, system):
    """Force on the satellite, its moment about the satellite's CG, and the moment on the platform; platform axes."""
    springs, active = system.springs, system.active
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    fx = fy = fz = sx = sy = sz = px = py = pz = 0.0
    for i in range(springs.shape[0]):
        if active[i]:
            u, v, w = springs[i, 3], springs[i, 4], springs[i, 5]
            bx, by, bz = r00 * u + r01 * v + r02 * w, r10 * u + r11 * v + r12 * w, r20 * u + r21 * v + r22 * w
            qx, qy, qz = x[0] + bx, x[1] + by, x[2] + bz
            s, nx, ny, nz = push_direction(system, i, qx, qy, qz)
            f = springs[i, STIFFNESS] * (springs[i, DEFORMATION] - s)
            nx, ny, nz = f * nx, f * ny, f * nz
            fx += nx
            fy += ny
            fz += nz
            sx += by * nz - bz * ny
            sy += bz * nx - bx * nz
            sz += bx * ny - by * nx
            px -= qy * nz - qz * ny
            py -= qz * nx - qx * nz
            pz -= qx * ny - qy * nx
    return fx, fy, fz, sx, sy, sz, px, py, pz


@njit(**KERNEL)
def derivative(t, x, k, row, system):
    """Write the time derivative of the state x at time t into k[row, :]."""
    c, gravity = system.c, system.gravity
    r = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    fx, fy, fz, sx, sy, sz, px, py, pz = spring_sums(x, r, system)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    # The moment on the satellite, from platform into satellite axes.
    sx, sy, sz = r00 * sx + r10 * sy + r20 * sz, r01 * sx + r11 * sy + r21 * sz, r02 * sx + r12 * sy + r22 * sz
    o1x, o1y, o1z, o2x, o2y, o2z = x[6], x[7], x[8], x[9], x[10], x[11]
    h1x, h1y, h1z = times(c, PLATFORM_INERTIA, o1x, o1y, o1z)
    h2x, h2y, h2z = times(c, SATELLITE_INERTIA, o2x, o2y, o2z)
    ax, ay, az = c[INVERSE_REDUCED_MASS] * fx, c[INVERSE_REDUCED_MASS] * fy, c[INVERSE_REDUCED_MASS] * fz
    if gravity != 0:
        ex, ey, ez = orbit_position(t, c[ORBIT], c[39], c[40], c[41], c[42], c[43], c[44])
        p = rotation_matrix_elements(x[16], x[17], x[18], x[19])
        # Position of the platform's CG from the Earth's centre, in platform axes.
        ex, ey, ez = (
            p[0] * ex + p[3] * ey + p[6] * ez,
            p[1] * ex + p[4] * ey + p[7] * ez,
            p[2] * ex + p[5] * ey + p[8] * ez,
        )
        squared = ex * ex + ey * ey + ez * ez
        rate = c[ORBIT] / (squared * math.sqrt(squared))
        gx, gy, gz = differential_gravity(rate, ex, ey, ez, x[0], x[1], x[2])
        ax, ay, az = ax + gx, ay + gy, az + gz
        if gravity == 2:
            inverse = 1.0 / math.sqrt(squared)
            nx, ny, nz = ex * inverse, ey * inverse, ez * inverse
            mx, my, mz = times(c, PLATFORM_INERTIA, nx, ny, nz)
            mx, my, mz = gradient_torque(rate, nx, ny, nz, mx, my, mz)
            px, py, pz = px + mx, py + my, pz + mz
            # The same direction serves both bodies: they are metres apart at 7e6 m.
            ux, uy, uz = r00 * nx + r10 * ny + r20 * nz, r01 * nx + r11 * ny + r21 * nz, r02 * nx + r12 * ny + r22 * nz
            mx, my, mz = times(c, SATELLITE_INERTIA, ux, uy, uz)
            mx, my, mz = gradient_torque(rate, ux, uy, uz, mx, my, mz)
            sx, sy, sz = sx + mx, sy + my, sz + mz
    vx, vy, vz = cross(o1x, o1y, o1z, x[0], x[1], x[2])
    k[row, 0], k[row, 1], k[row, 2] = x[3] - vx, x[4] - vy, x[5] - vz
    vx, vy, vz = cross(o1x, o1y, o1z, x[3], x[4], x[5])
    k[row, 3], k[row, 4], k[row, 5] = ax - vx, ay - vy, az - vz
    vx, vy, vz = cross(o1x, o1y, o1z, h1x, h1y, h1z)
    k[row, 6], k[row, 7], k[row, 8] = times(c, PLATFORM_INVERSE_INERTIA, px - vx, py - vy, pz - vz)
    vx, vy, vz = cross(o2x, o2y, o2z, h2x, h2y, h2z)
    k[row, 9], k[row, 10], k[row, 11] = times(c, SATELLITE_INVERSE_INERTIA, sx - vx, sy - vy, sz - vz)
    # Equation 3 as quaternions: Q' = (Q (x) [0, omega_2] - [0, omega_1] (x) Q) / 2 and q1' = q1 (x) [0, omega_1] / 2.
    w, u, v, z = x[12], x[13], x[14], x[15]
    k[row, 12] = 0.5 * (-u * (o2x - o1x) - v * (o2y - o1y) - z * (o2z - o1z))
    k[row, 13] = 0.5 * (w * (o2x - o1x) + v * (o2z + o1z) - z * (o2y + o1y))
    k[row, 14] = 0.5 * (w * (o2y - o1y) + z * (o2x + o1x) - u * (o2z + o1z))
    k[row, 15] = 0.5 * (w * (o2z - o1z) + u * (o2y + o1y) - v * (o2x + o1x))
    w, u, v, z = x[16], x[17], x[18], x[19]
    k[row, 16] = 0.5 * (-u * o1x - v * o1y - z * o1z)
    k[row, 17] = 0.5 * (w * o1x + v * o1z - z * o1y)
    k[row, 18] = 0.5 * (w * o1y + z * o1x - u * o1z)
    k[row, 19] = 0.5 * (w * o1z + u * o1y - v * o1x)


@njit(**KERNEL)
def seat_motion(x, k, row, system, i):
    """Stroke of spring i, its rate, and its acceleration up to the terms of second order in the rates (for
    prediction).
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    u, v, w = system.springs[i, 3], system.springs[i, 4], system.springs[i, 5]
    qx, qy, qz = (
        x[0] + r00 * u + r01 * v + r02 * w,
        x[1] + r10 * u + r11 * v + r12 * w,
        x[2] + r20 * u + r21 * v + r22 * w,
    )
    s, nx, ny, nz = push_direction(system, i, qx, qy, qz)
    ax, ay, az = cross(x[9], x[10], x[11], u, v, w)
    bx, by, bz = cross(x[6], x[7], x[8], qx, qy, qz)
    rate = (
        nx * (x[3] + r00 * ax + r01 * ay + r02 * az - bx)
        + ny * (x[4] + r10 * ax + r11 * ay + r12 * az - by)
        + nz * (x[5] + r20 * ax + r21 * ay + r22 * az - bz)
    )
    ax, ay, az = cross(k[row, 9], k[row, 10], k[row, 11], u, v, w)
    bx, by, bz = cross(k[row, 6], k[row, 7], k[row, 8], qx, qy, qz)
    acceleration = (
        nx * (k[row, 3] + r00 * ax + r01 * ay + r02 * az - bx)
        + ny * (k[row, 4] + r10 * ax + r11 * ay + r12 * az - by)
        + nz * (k[row, 5] + r20 * ax + r21 * ay + r22 * az - bz)
    )
    return s, rate, acceleration
