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
from typing import NamedTuple

import numpy as np
from numba import njit

from satsep_ot.dynamics.compilation import KERNEL
from satsep_ot.dynamics.flight import AT_EXIT, AT_START, INSIDE, NOTHING, PUSH_STARTS, RELEASE, point_motion
from satsep_ot.dynamics.gravity import orbit_position
from satsep_ot.dynamics.integration import EIGHTH_ORDER, STAGE_NUMBER, A, B, C, stages
from satsep_ot.dynamics.rigid_body import cross, derivative, seat_motion, spring_sums, times
from satsep_ot.dynamics.rotations import rotation_matrix_elements
from satsep_ot.dynamics.separation import COMMON_SIZE, SPRING_SIZE, STOWED
from satsep_ot.dynamics.springs import push_direction
from satsep_ot.dynamics.system import (
    DEFORMATION,
    GUIDED,
    INVERSE_REDUCED_MASS,
    ORBIT,
    PLATFORM_INERTIA,
    SATELLITE_INERTIA,
    STATE_SIZE,
    STIFFNESS,
)

LANES = 8  # outputs differentiated together: one vector register of the processor

# Rows of the parameter adjoint: reduced mass, inertia tensors, stowed length, then a block a spring (platform seat,
# satellite seat, guide, stiffness, deformation, release stroke, delay); behind them the CGs and the recess.
G_PLATFORM_INERTIA, G_SATELLITE_INERTIA, G_STOWED, G_SPRINGS, G_SPRING_SIZE = 1, 10, 19, 20, 13


class Adjoint(NamedTuple):
    """Room for a sweep; every array has LANES columns."""

    lam: np.ndarray  # adjoint of the state (STATE_SIZE,)
    branch: np.ndarray  # the same for a step beside the chain
    mu: np.ndarray  # adjoint of the time (1,)
    kb: np.ndarray  # adjoint of a slope (STATE_SIZE,)
    yb: np.ndarray  # adjoints of the stage states (STAGES, STATE_SIZE,)
    s: np.ndarray  # sums over springs (18,), see `derivative_adjoint`
    m: np.ndarray  # adjoints of two rotation matrices (18,)
    g: np.ndarray  # adjoints of the constants of the run, rows as above


@njit(**KERNEL)
def add_rotation_adjoint(m, row, q0, q1, q2, q3, out, at):
    """Add to the quaternion adjoint out[at:at+4, lane] what the adjoint of its rotation matrix, m[row:row+9, lane],
    says.
    """
    for n in range(LANES):
        m00, m01, m02 = m[row, n], m[row + 1, n], m[row + 2, n]
        m10, m11, m12 = m[row + 3, n], m[row + 4, n], m[row + 5, n]
        m20, m21, m22 = m[row + 6, n], m[row + 7, n], m[row + 8, n]
        out[at, n] += 2.0 * (q3 * (m10 - m01) + q2 * (m02 - m20) + q1 * (m21 - m12))
        out[at + 1, n] += 2.0 * (q2 * (m01 + m10) + q3 * (m02 + m20) + q0 * (m21 - m12) - 2.0 * q1 * (m11 + m22))
        out[at + 2, n] += 2.0 * (q1 * (m01 + m10) + q3 * (m12 + m21) + q0 * (m02 - m20) - 2.0 * q2 * (m00 + m22))
        out[at + 3, n] += 2.0 * (q1 * (m02 + m20) + q2 * (m12 + m21) + q0 * (m10 - m01) - 2.0 * q3 * (m00 + m11))


@njit(**KERNEL)
def seat_adjoint(x, r, i, stroke_bar, stroke_row, out, m, g, system):
    """Add to the adjoints what the adjoint of spring i's stroke, stroke_bar[stroke_row, lane], says."""
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    springs = system.springs
    u, v, w = springs[i, 3], springs[i, 4], springs[i, 5]
    qx, qy, qz = (
        x[0] + r00 * u + r01 * v + r02 * w,
        x[1] + r10 * u + r11 * v + r12 * w,
        x[2] + r20 * u + r21 * v + r22 * w,
    )
    _, ex, ey, ez = push_direction(system, i, qx, qy, qz)
    dx, dy, dz = qx - springs[i, 0], qy - springs[i, 1], qz - springs[i, 2]
    guided = 1.0 if system.force_line == GUIDED else 0.0
    k = G_SPRINGS + G_SPRING_SIZE * i
    for n in range(LANES):
        bar = stroke_bar[stroke_row, n]
        vx, vy, vz = bar * ex, bar * ey, bar * ez
        out[0, n] += vx
        out[1, n] += vy
        out[2, n] += vz
        g[k, n] -= vx
        g[k + 1, n] -= vy
        g[k + 2, n] -= vz
        g[k + 3, n] += r00 * vx + r10 * vy + r20 * vz
        g[k + 4, n] += r01 * vx + r11 * vy + r21 * vz
        g[k + 5, n] += r02 * vx + r12 * vy + r22 * vz
        g[k + 6, n] += guided * bar * dx
        g[k + 7, n] += guided * bar * dy
        g[k + 8, n] += guided * bar * dz
        g[G_STOWED, n] -= bar
        m[0, n] += vx * u
        m[1, n] += vx * v
        m[2, n] += vx * w
        m[3, n] += vy * u
        m[4, n] += vy * v
        m[5, n] += vy * w
        m[6, n] += vz * u
        m[7, n] += vz * v
        m[8, n] += vz * w


@njit(**KERNEL)
def spring_adjoint(x, r, i, s, m, g, system):
    """Add what spring i contributes to the adjoints, from those of the sums over the springs, in platform axes.

    They stand in `s`: force on the satellite in rows 0 to 2, moment about the satellite's CG in 3 to 5, moment on the
    platform in 6 to 8. The adjoint of d goes to rows 9 to 11, that of Q's matrix to `m`.
    """
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    springs = system.springs
    u, v, w = springs[i, 3], springs[i, 4], springs[i, 5]
    bx, by, bz = r00 * u + r01 * v + r02 * w, r10 * u + r11 * v + r12 * w, r20 * u + r21 * v + r22 * w
    qx, qy, qz = x[0] + bx, x[1] + by, x[2] + bz
    stroke, ex, ey, ez = push_direction(system, i, qx, qy, qz)
    dx, dy, dz = qx - springs[i, 0], qy - springs[i, 1], qz - springs[i, 2]
    stiffness, compression = springs[i, STIFFNESS], springs[i, DEFORMATION] - stroke
    f = stiffness * compression
    fx, fy, fz = f * ex, f * ey, f * ez
    guided = 1.0 if system.force_line == GUIDED else 0.0
    # A strut's direction turns with the seats: d e = (1 - e e^T) d delta / |delta|.
    turning = 0.0 if system.force_line == GUIDED else f / math.sqrt(dx * dx + dy * dy + dz * dz)
    k = G_SPRINGS + G_SPRING_SIZE * i
    for n in range(LANES):
        tx, ty, tz = s[3, n], s[4, n], s[5, n]
        px, py, pz = s[6, n], s[7, n], s[8, n]
        # Adjoint of the force: from the sum, from b x F and from -(d + b) x F.
        hx = s[0, n] + ty * bz - tz * by - (py * qz - pz * qy)
        hy = s[1, n] + tz * bx - tx * bz - (pz * qx - px * qz)
        hz = s[2, n] + tx * by - ty * bx - (px * qy - py * qx)
        along = hx * ex + hy * ey + hz * ez
        g[k + 9, n] += compression * along
        g[k + 10, n] += stiffness * along
        bar = -stiffness * along
        g[G_STOWED, n] -= bar
        # Adjoint of delta: through the stroke and, for a strut, through the direction.
        vx = bar * ex + turning * (hx - along * ex)
        vy = bar * ey + turning * (hy - along * ey)
        vz = bar * ez + turning * (hz - along * ez)
        g[k + 6, n] += guided * (f * hx + bar * dx)
        g[k + 7, n] += guided * (f * hy + bar * dy)
        g[k + 8, n] += guided * (f * hz + bar * dz)
        g[k, n] -= vx
        g[k + 1, n] -= vy
        g[k + 2, n] -= vz
        # Adjoint of the contact point d + b.
        vx -= fy * pz - fz * py
        vy -= fz * px - fx * pz
        vz -= fx * py - fy * px
        s[9, n] += vx
        s[10, n] += vy
        s[11, n] += vz
        vx += fy * tz - fz * ty
        vy += fz * tx - fx * tz
        vz += fx * ty - fy * tx
        g[k + 3, n] += r00 * vx + r10 * vy + r20 * vz
        g[k + 4, n] += r01 * vx + r11 * vy + r21 * vz
        g[k + 5, n] += r02 * vx + r12 * vy + r22 * vz
        m[0, n] += vx * u
        m[1, n] += vx * v
        m[2, n] += vx * w
        m[3, n] += vy * u
        m[4, n] += vy * v
        m[5, n] += vy * w
        m[6, n] += vz * u
        m[7, n] += vz * v
        m[8, n] += vz * w


@njit(**KERNEL)
def body_adjoint(c, inertia, o, slope, n_bar, row, out, at, g, g_row):
    """Adjoint of I w' = M - w x I w: from that of w', n_bar[row:row+3], to those of M (written there), w and I."""
    o0, o1, o2 = o
    a0, a1, a2 = slope[at], slope[at + 1], slope[at + 2]
    h0, h1, h2 = times(c, inertia, o0, o1, o2)
    k = inertia + 9
    i00, i01, i02 = c[inertia], c[inertia + 1], c[inertia + 2]
    i11, i12, i22 = c[inertia + 4], c[inertia + 5], c[inertia + 8]
    j00, j01, j02, j11, j12, j22 = c[k], c[k + 1], c[k + 2], c[k + 4], c[k + 5], c[k + 8]
    for n in range(LANES):
        v0, v1, v2 = n_bar[row, n], n_bar[row + 1, n], n_bar[row + 2, n]
        b0, b1, b2 = j00 * v0 + j01 * v1 + j02 * v2, j01 * v0 + j11 * v1 + j12 * v2, j02 * v0 + j12 * v1 + j22 * v2
        n_bar[row, n], n_bar[row + 1, n], n_bar[row + 2, n] = b0, b1, b2
        # h = I w enters as -w x h.
        e0, e1, e2 = o1 * b2 - o2 * b1, o2 * b0 - o0 * b2, o0 * b1 - o1 * b0
        out[at, n] += b1 * h2 - b2 * h1 + i00 * e0 + i01 * e1 + i02 * e2
        out[at + 1, n] += b2 * h0 - b0 * h2 + i01 * e0 + i11 * e1 + i12 * e2
        out[at + 2, n] += b0 * h1 - b1 * h0 + i02 * e0 + i12 * e1 + i22 * e2
        g[g_row, n] += e0 * o0 - b0 * a0
        g[g_row + 1, n] += e0 * o1 - b0 * a1
        g[g_row + 2, n] += e0 * o2 - b0 * a2
        g[g_row + 3, n] += e1 * o0 - b1 * a0
        g[g_row + 4, n] += e1 * o1 - b1 * a1
        g[g_row + 5, n] += e1 * o2 - b1 * a2
        g[g_row + 6, n] += e2 * o0 - b2 * a0
        g[g_row + 7, n] += e2 * o1 - b2 * a1
        g[g_row + 8, n] += e2 * o2 - b2 * a2


@njit(**KERNEL)
def gravity_adjoint(t, x, r, kb, s, m, g, out, system):
    """Add what gravity contributes, to first order in |d| / |r| (1e-7 of an acceleration of 1e-6 m/s2)."""
    c = system.c
    ex, ey, ez = orbit_position(t, c[ORBIT], c[39], c[40], c[41], c[42], c[43], c[44])
    radius = math.sqrt(ex * ex + ey * ey + ez * ez)
    rate = c[ORBIT] / (radius * radius * radius)
    ex, ey, ez = ex / radius, ey / radius, ez / radius
    p = rotation_matrix_elements(x[16], x[17], x[18], x[19])
    nx, ny, nz = p[0] * ex + p[3] * ey + p[6] * ez, p[1] * ex + p[4] * ey + p[7] * ez, p[2] * ex + p[5] * ey + p[8] * ez
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    ux, uy, uz = r00 * nx + r10 * ny + r20 * nz, r01 * nx + r11 * ny + r21 * nz, r02 * nx + r12 * ny + r22 * nz
    torque = 3.0 * rate if system.gravity == 2 else 0.0
    ax, ay, az = times(c, PLATFORM_INERTIA, nx, ny, nz)
    bx, by, bz = times(c, SATELLITE_INERTIA, ux, uy, uz)
    dx, dy, dz = x[0], x[1], x[2]
    along = nx * dx + ny * dy + nz * dz
    for n in range(LANES):
        # Differential acceleration: -rate (d - 3 n (n . d)).
        vx, vy, vz = kb[3, n], kb[4, n], kb[5, n]
        q = nx * vx + ny * vy + nz * vz
        out[0, n] -= rate * (vx - 3.0 * nx * q)
        out[1, n] -= rate * (vy - 3.0 * ny * q)
        out[2, n] -= rate * (vz - 3.0 * nz * q)
        hx, hy, hz = (
            3.0 * rate * (along * vx + q * dx),
            3.0 * rate * (along * vy + q * dy),
            3.0 * rate * (along * vz + q * dz),
        )
        # Gradient torque on the platform, 3 rate n x (I n); s[12:15] is the adjoint of its moment.
        vx, vy, vz = torque * s[12, n], torque * s[13, n], torque * s[14, n]
        wx, wy, wz = vy * nz - vz * ny, vz * nx - vx * nz, vx * ny - vy * nx
        hx += ay * vz - az * vy + c[1] * wx + c[2] * wy + c[3] * wz
        hy += az * vx - ax * vz + c[4] * wx + c[5] * wy + c[6] * wz
        hz += ax * vy - ay * vx + c[7] * wx + c[8] * wy + c[9] * wz
        g[1, n] += wx * nx
        g[2, n] += wx * ny
        g[3, n] += wx * nz
        g[4, n] += wy * nx
        g[5, n] += wy * ny
        g[6, n] += wy * nz
        g[7, n] += wz * nx
        g[8, n] += wz * ny
        g[9, n] += wz * nz
        # The same for the satellite, in its axes: u = R^T n; s[15:18] is the adjoint of its moment.
        vx, vy, vz = torque * s[15, n], torque * s[16, n], torque * s[17, n]
        wx, wy, wz = vy * uz - vz * uy, vz * ux - vx * uz, vx * uy - vy * ux
        g[10, n] += wx * ux
        g[11, n] += wx * uy
        g[12, n] += wx * uz
        g[13, n] += wy * ux
        g[14, n] += wy * uy
        g[15, n] += wy * uz
        g[16, n] += wz * ux
        g[17, n] += wz * uy
        g[18, n] += wz * uz
        gx = by * vz - bz * vy + c[19] * wx + c[20] * wy + c[21] * wz
        gy = bz * vx - bx * vz + c[22] * wx + c[23] * wy + c[24] * wz
        gz = bx * vy - by * vx + c[25] * wx + c[26] * wy + c[27] * wz
        m[0, n] += nx * gx
        m[1, n] += nx * gy
        m[2, n] += nx * gz
        m[3, n] += ny * gx
        m[4, n] += ny * gy
        m[5, n] += ny * gz
        m[6, n] += nz * gx
        m[7, n] += nz * gy
        m[8, n] += nz * gz
        hx += r00 * gx + r01 * gy + r02 * gz
        hy += r10 * gx + r11 * gy + r12 * gz
        hz += r20 * gx + r21 * gy + r22 * gz
        # n = C_1^T e: the adjoint of C_1 is e h^T.
        m[9, n], m[10, n], m[11, n] = ex * hx, ex * hy, ex * hz
        m[12, n], m[13, n], m[14, n] = ey * hx, ey * hy, ey * hz
        m[15, n], m[16, n], m[17, n] = ez * hx, ez * hy, ez * hz
    add_rotation_adjoint(m, 9, x[16], x[17], x[18], x[19], out, 16)


@njit(**KERNEL)
def derivative_adjoint(t, x, slope, adjoint, out, system):
    """Vector-Jacobian products of `rigid_body.derivative`, for LANES adjoints kb (STATE_SIZE, LANES) of its result.

    Writes those of the state into `out`, adds those of the constants to g; `slope` is its result at x.
    """
    c, kb, s, m, g = system.c, adjoint.kb, adjoint.s, adjoint.m, adjoint.g
    r = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    fx, fy, fz, sx, sy, sz, _, _, _ = spring_sums(x, r, system)
    r00, r01, r02, r10, r11, r12, r20, r21, r22 = r
    inverse_mass = c[INVERSE_REDUCED_MASS]
    d0, d1, d2, v0, v1, v2 = x[0], x[1], x[2], x[3], x[4], x[5]
    p0, p1, p2, o0, o1, o2 = x[6], x[7], x[8], x[9], x[10], x[11]
    q0, q1, q2, q3 = x[12], x[13], x[14], x[15]
    z0, z1, z2, z3 = x[16], x[17], x[18], x[19]
    for n in range(LANES):
        # d' = w - omega_1 x d; w' = F / mu + gravity - omega_1 x w.
        a0, a1, a2 = kb[0, n], kb[1, n], kb[2, n]
        b0, b1, b2 = kb[3, n], kb[4, n], kb[5, n]
        out[0, n] = p1 * a2 - p2 * a1
        out[1, n] = p2 * a0 - p0 * a2
        out[2, n] = p0 * a1 - p1 * a0
        out[3, n] = a0 + p1 * b2 - p2 * b1
        out[4, n] = a1 + p2 * b0 - p0 * b2
        out[5, n] = a2 + p0 * b1 - p1 * b0
        s[0, n], s[1, n], s[2, n] = inverse_mass * b0, inverse_mass * b1, inverse_mass * b2
        g[0, n] += fx * b0 + fy * b1 + fz * b2
        w0 = a1 * d2 - a2 * d1 + b1 * v2 - b2 * v1
        w1 = a2 * d0 - a0 * d2 + b2 * v0 - b0 * v2
        w2 = a0 * d1 - a1 * d0 + b0 * v1 - b1 * v0
        # Q' = (Q (x) [0, omega_2] - [0, omega_1] (x) Q) / 2; q1' = q1 (x) [0, omega_1] / 2.
        k0, k1, k2, k3 = 0.5 * kb[12, n], 0.5 * kb[13, n], 0.5 * kb[14, n], 0.5 * kb[15, n]
        e0, e1, e2 = o0 - p0, o1 - p1, o2 - p2
        f0, f1, f2 = o0 + p0, o1 + p1, o2 + p2
        out[12, n] = k1 * e0 + k2 * e1 + k3 * e2
        out[13, n] = -k0 * e0 - k2 * f2 + k3 * f1
        out[14, n] = -k0 * e1 + k1 * f2 - k3 * f0
        out[15, n] = -k0 * e2 - k1 * f1 + k2 * f0
        u0 = -k0 * q1 + k1 * q0
        u1 = -k0 * q2 + k2 * q0
        u2 = -k0 * q3 + k3 * q0
        y0 = k2 * q3 - k3 * q2
        y1 = -k1 * q3 + k3 * q1
        y2 = k1 * q2 - k2 * q1
        k0, k1, k2, k3 = 0.5 * kb[16, n], 0.5 * kb[17, n], 0.5 * kb[18, n], 0.5 * kb[19, n]
        out[16, n] = k1 * p0 + k2 * p1 + k3 * p2
        out[17, n] = -k0 * p0 - k2 * p2 + k3 * p1
        out[18, n] = -k0 * p1 + k1 * p2 - k3 * p0
        out[19, n] = -k0 * p2 - k1 * p1 + k2 * p0
        out[6, n] = w0 - u0 + y0 - k0 * z1 + k1 * z0 + k2 * z3 - k3 * z2
        out[7, n] = w1 - u1 + y1 - k0 * z2 - k1 * z3 + k2 * z0 + k3 * z1
        out[8, n] = w2 - u2 + y2 - k0 * z3 + k1 * z2 - k2 * z1 + k3 * z0
        out[9, n], out[10, n], out[11, n] = u0 + y0, u1 + y1, u2 + y2
        for j in range(6):
            s[12 + j, n] = kb[6 + j, n]
    body_adjoint(c, PLATFORM_INERTIA, (p0, p1, p2), slope, s, 12, out, 6, g, G_PLATFORM_INERTIA)
    body_adjoint(c, SATELLITE_INERTIA, (o0, o1, o2), slope, s, 15, out, 9, g, G_SATELLITE_INERTIA)
    for n in range(LANES):
        # The moment on the platform as it is, that on the satellite turned by R^T.
        s[6, n], s[7, n], s[8, n] = s[12, n], s[13, n], s[14, n]
        a0, a1, a2 = s[15, n], s[16, n], s[17, n]
        s[3, n] = r00 * a0 + r01 * a1 + r02 * a2
        s[4, n] = r10 * a0 + r11 * a1 + r12 * a2
        s[5, n] = r20 * a0 + r21 * a1 + r22 * a2
        m[0, n], m[1, n], m[2, n] = sx * a0, sx * a1, sx * a2
        m[3, n], m[4, n], m[5, n] = sy * a0, sy * a1, sy * a2
        m[6, n], m[7, n], m[8, n] = sz * a0, sz * a1, sz * a2
        s[9, n], s[10, n], s[11, n] = 0.0, 0.0, 0.0
    for i in range(system.springs.shape[0]):
        if system.active[i]:
            spring_adjoint(x, r, i, s, m, g, system)
    if system.gravity != 0:
        gravity_adjoint(t, x, r, kb, s, m, g, out, system)
    add_rotation_adjoint(m, 0, q0, q1, q2, q3, out, 12)
    for n in range(LANES):
        out[0, n] += s[9, n]
        out[1, n] += s[10, n]
        out[2, n] += s[11, n]


@njit(**KERNEL)
def step_adjoint(method, t, x, h, work, system, lam, adjoint):
    """Pull the adjoint `lam` (STATE_SIZE, LANES) of the end of a step back to its start, in place."""
    kb, yb = adjoint.kb, adjoint.yb
    derivative(t, x, work.k, 0, system)
    stages(method, t, x, h, work, system)
    last = STAGE_NUMBER[method] - 1
    for i in range(last, -1, -1):
        for j in range(STATE_SIZE):
            for n in range(LANES):
                kb[j, n] = B[method, i] * lam[j, n]
        for later in range(i + 1, last + 1):
            a = A[method, later, i]
            if a != 0.0:
                for j in range(STATE_SIZE):
                    for n in range(LANES):
                        kb[j, n] += a * yb[later, j, n]
        for j in range(STATE_SIZE):
            for n in range(LANES):
                kb[j, n] *= h
        derivative_adjoint(t + C[method, i] * h, work.y[i], work.k[i], adjoint, yb[i], system)
    for i in range(last + 1):
        for j in range(STATE_SIZE):
            for n in range(LANES):
                lam[j, n] += yb[i, j, n]


@njit(**KERNEL)
def clearance_adjoint(x, i, lane, at_exit, system, lam, adjoint, tail):
    """Add to one lane the adjoint of the clearance of envelope point i at state x.

    That is at its exit, whose time moves, or at a fixed or extremal time. Parameter rows from `tail`: CG of the
    platform, CG of the satellite, radius, depth.
    """
    p, m, g = system.parameters, adjoint.m, adjoint.g
    m[:9] = 0.0
    ax, _, az, vx, vy, vz = point_motion(x, system, i)
    rho = math.sqrt(ax * ax + az * az)
    bx, by, bz = -ax / rho, 0.0, -az / rho
    if at_exit:
        by = (ax * vx + az * vz) / (rho * vy)
        g[tail + 7, lane] -= by
    g[tail + 6, lane] += 1.0
    lam[0, lane] += bx
    lam[1, lane] += by
    lam[2, lane] += bz
    g[tail, lane] += bx
    g[tail + 1, lane] += by
    g[tail + 2, lane] += bz
    r = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    for j in range(3):
        arm = system.points[i, j] - p[17 + j]
        m[j, lane] += bx * arm
        m[3 + j, lane] += by * arm
        m[6 + j, lane] += bz * arm
        g[tail + 3 + j, lane] -= r[j] * bx + r[3 + j] * by + r[6 + j] * bz
    add_rotation_adjoint(m, 0, x[12], x[13], x[14], x[15], lam, 12)


@njit(**KERNEL)
def branch_adjoint(columns, block, index, step, system, work, tape, follow, adjoint, tail):
    """Add, at tape state `index`, the clearances that are reached from there by one step within step `step`."""
    point_number = system.points.shape[0]
    closest, kind = int(follow.closest[1]), int(follow.closest[2])
    for i in range(point_number + 1):
        # Behind the exits of all points stands the smallest clearance, if it was met between the ends of a step.
        if i < point_number:
            wanted = follow.step[i] == step and follow.base[i] == index
        else:
            wanted = kind == INSIDE and int(follow.closest[3]) == step and index == step
        if not wanted:
            continue
        adjoint.branch[:] = 0.0
        used = False
        for lane in range(LANES):
            column = columns[block + lane]
            if i == point_number:
                if column == STATE_SIZE + 1:
                    clearance_adjoint(follow.closest_x, closest, lane, False, system, adjoint.branch, adjoint, tail)
                    used = True
            elif column == STATE_SIZE + 2 + i or (column == STATE_SIZE + 1 and kind == AT_EXIT and closest == i):
                clearance_adjoint(follow.x[i], i, lane, True, system, adjoint.branch, adjoint, tail)
                used = True
        if used:
            h = follow.h[i] if i < point_number else follow.closest[4]
            method = follow.method[i] if i < point_number else EIGHTH_ORDER
            step_adjoint(method, tape.t[index], tape.x[index], h, work, system, adjoint.branch, adjoint)
            for n in range(STATE_SIZE):
                for lane in range(LANES):
                    adjoint.lam[n, lane] += adjoint.branch[n, lane]


@njit(**KERNEL)
def event_adjoint(index, event, spring, system, work, tape, adjoint):
    """Correct the adjoints at tape state `index` for the length of the step before it, which its event decides."""
    x, lam, mu, s, m, g = tape.x[index], adjoint.lam, adjoint.mu, adjoint.s, adjoint.m, adjoint.g
    derivative(tape.t[index], x, work.k, 0, system)
    for lane in range(LANES):
        s[0, lane] = 0.0
    for n in range(STATE_SIZE):
        for lane in range(LANES):
            s[0, lane] += lam[n, lane] * work.k[0, n]
    k = G_SPRINGS + G_SPRING_SIZE * spring
    if event == PUSH_STARTS:
        # The step's end is the delay itself.
        for lane in range(LANES):
            g[k + 12, lane] += mu[0, lane] + s[0, lane]
            mu[0, lane] = -s[0, lane]
        return
    _, rate, _ = seat_motion(x, work.k, 0, system, spring)
    for lane in range(LANES):
        s[0, lane] = -(s[0, lane] + mu[0, lane]) / rate
        g[k + 11, lane] -= s[0, lane]
    m[:9] = 0.0
    seat_adjoint(x, rotation_matrix_elements(x[12], x[13], x[14], x[15]), spring, s, 0, lam, m, g, system)
    add_rotation_adjoint(m, 0, x[12], x[13], x[14], x[15], lam, 12)


@njit(**KERNEL)
def adjoint_sweep(columns, block, last, system, work, tape, follow, adjoint, gradients):
    """Gradients of the base's columns[block:block + LANES] with respect to all parameters, from a finished run.

    They go into gradients[block:block + LANES, :]; a column of -1 gives 0. `system.active` is walked back.
    """
    active, lam, mu = system.active, adjoint.lam, adjoint.mu
    tail = G_SPRINGS + G_SPRING_SIZE * system.springs.shape[0]
    lam[:] = 0.0
    mu[:] = 0.0
    adjoint.g[:] = 0.0
    active[:] = False
    # Steps behind the last release matter only to clearances.
    top = last
    for i in range(system.points.shape[0]):
        top = max(top, follow.base[i])
    for index in range(top, -1, -1):
        if index == last:
            for lane in range(LANES):
                column = columns[block + lane]
                if 0 <= column < STATE_SIZE:
                    lam[column, lane] += 1.0
                elif column == STATE_SIZE:
                    mu[0, lane] = 1.0
        branch_adjoint(columns, block, index, index, system, work, tape, follow, adjoint, tail)
        if index > 0:
            step = index - 1
            event, spring = tape.event[step], tape.spring[step]
            if event != NOTHING:
                active[spring] = event == RELEASE
            branch_adjoint(columns, block, index, step, system, work, tape, follow, adjoint, tail)
            if event != NOTHING:
                event_adjoint(index, event, spring, system, work, tape, adjoint)
            if tape.h[step] != 0.0:
                step_adjoint(tape.method[step], tape.t[step], tape.x[step], tape.h[step], work, system, lam, adjoint)
    if system.points.shape[0] > 0 and int(follow.closest[2]) == AT_START:
        for lane in range(LANES):
            if columns[block + lane] == STATE_SIZE + 1:
                clearance_adjoint(tape.x[0], int(follow.closest[1]), lane, False, system, lam, adjoint, tail)
    initial_adjoint(system, tape.x[0], adjoint, tail, block, gradients)
    for lane in range(LANES):
        parameter_adjoint(system, lane, adjoint.g, tail, gradients[block + lane])


@njit(**KERNEL)
def initial_adjoint(system, x, adjoint, tail, block, gradients):
    """From the adjoint of the initial state to those of rates, mounting error, CGs and stowed length; see `prepare`."""
    p, lam, m, g = system.parameters, adjoint.lam, adjoint.m, adjoint.g
    r = rotation_matrix_elements(x[12], x[13], x[14], x[15])
    angle_squared = p[23] ** 2 + p[24] ** 2 + p[25] ** 2
    scale, bend = 0.5 - angle_squared / 48.0, -1.0 / 24.0 + angle_squared / 960.0
    if angle_squared > 1e-4:
        angle = math.sqrt(angle_squared)
        scale = math.sin(0.5 * angle) / angle
        bend = (0.5 * math.cos(0.5 * angle) - scale) / angle_squared
    for n in range(LANES):
        # w = Omega x d.
        wx, wy, wz = lam[3, n], lam[4, n], lam[5, n]
        ox, oy, oz = cross(x[0], x[1], x[2], wx, wy, wz)
        dx, dy, dz = cross(wx, wy, wz, p[20], p[21], p[22])
        dx, dy, dz = dx + lam[0, n], dy + lam[1, n], dz + lam[2, n]
        # omega_2 = R^T Omega.
        ux, uy, uz = lam[9, n], lam[10, n], lam[11, n]
        gradients[block + n, 20] = ox + lam[6, n] + r[0] * ux + r[1] * uy + r[2] * uz
        gradients[block + n, 21] = oy + lam[7, n] + r[3] * ux + r[4] * uy + r[5] * uz
        gradients[block + n, 22] = oz + lam[8, n] + r[6] * ux + r[7] * uy + r[8] * uz
        # d = R c_2 - c_1 + l_0 y.
        g[G_STOWED, n] += dy
        g[tail, n] -= dx
        g[tail + 1, n] -= dy
        g[tail + 2, n] -= dz
        for j in range(3):
            u = lam[9 + j, n]
            m[j, n] = p[20] * u + dx * p[17 + j]
            m[3 + j, n] = p[21] * u + dy * p[17 + j]
            m[6 + j, n] = p[22] * u + dz * p[17 + j]
            g[tail + 3 + j, n] += r[j] * dx + r[3 + j] * dy + r[6 + j] * dz
    add_rotation_adjoint(m, 0, x[12], x[13], x[14], x[15], lam, 12)
    for n in range(LANES):
        along = lam[13, n] * p[23] + lam[14, n] * p[24] + lam[15, n] * p[25]
        for j in range(3):
            gradients[block + n, 23 + j] = scale * lam[13 + j, n] + p[23 + j] * (
                bend * along - 0.5 * scale * lam[12, n]
            )


@njit(**KERNEL)
def parameter_adjoint(system, lane, g, tail, gradient):
    """From the adjoints of the constants of a run to those of its parameters; see `prepare`."""
    p = system.parameters
    stowed = p[STOWED]
    g_stowed = g[G_STOWED, lane]
    for body in range(2):
        k, q = 10 * body, 1 + 9 * body
        gradient[k] = -g[0, lane] / p[k] ** 2
        gradient[k + 1], gradient[k + 2], gradient[k + 3] = g[q, lane], g[q + 4, lane], g[q + 8, lane]
        gradient[k + 4] = g[q + 1, lane] + g[q + 3, lane]
        gradient[k + 5] = g[q + 2, lane] + g[q + 6, lane]
        gradient[k + 6] = g[q + 5, lane] + g[q + 7, lane]
        for j in range(3):
            gradient[k + 7 + j] = g[tail + 3 * body + j, lane]
    gradient[27], gradient[28] = g[tail + 6, lane], g[tail + 7, lane]
    for i in range(system.springs.shape[0]):
        k, q = G_SPRINGS + G_SPRING_SIZE * i, COMMON_SIZE + SPRING_SIZE * i
        angle, radius, cant = p[q], p[q + 1], p[q + 5]
        ca, sa, cb, sb = math.cos(angle), math.sin(angle), math.cos(cant), math.sin(cant)
        ax, ay, az = g[k, lane], g[k + 1, lane], g[k + 2, lane]
        bx, by, bz = g[k + 3, lane], g[k + 4, lane], g[k + 5, lane]
        nx, ny, nz = g[k + 6, lane] - stowed * ax, g[k + 7, lane] - stowed * ay, g[k + 8, lane] - stowed * az
        g_stowed += ax * sb * sa + ay * (1.0 - cb) - az * sb * ca
        gradient[q] = radius * (ca * (az + bz) - sa * (ax + bx)) - sb * (ca * nx + sa * nz)
        gradient[q + 1] = ca * (ax + bx) + sa * (az + bz)
        gradient[q + 2] = g[k + 9, lane]
        gradient[q + 3], gradient[q + 4] = g[k + 10, lane], 0.0
        gradient[q + 4 if p[q + 4] <= p[q + 3] else q + 3] += g[k + 11, lane]
        gradient[q + 5] = cb * (ca * nz - sa * nx) - sb * ny
        gradient[q + 6] = g[k + 12, lane]
        gradient[7], gradient[8], gradient[9] = gradient[7] - ax, gradient[8] - ay, gradient[9] - az
        gradient[17], gradient[18], gradient[19] = gradient[17] - bx, gradient[18] - by, gradient[19] - bz
    gradient[26] = g_stowed
