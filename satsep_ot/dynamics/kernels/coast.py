"""The coast after the release, compiled: both bodies on their orbits, and where they are nearest.

The theory is in `satsep_ot.dynamics.relative_orbit`.
"""

import math

import numpy as np
from scipy.integrate import DOP853

from satsep_ot.dynamics.kernels.compilation import SOURCE_DIGEST, entry_point, inline, kernel
from satsep_ot.dynamics.kernels.gravity import differential_gravity
from satsep_ot.dynamics.kernels.vectors import dot, minus, plus, put, scaled, vector

PARTS = 4  # of a step, each of which is looked at for a minimum

# Coefficients A of the stages, and below them the weights B of the result.
TABLE = np.vstack([DOP853.A[: DOP853.n_stages, : DOP853.n_stages], DOP853.B])
STAGE_NUMBER = TABLE.shape[1]

# State of a coast: r_1, rho, then their velocities; where the adjoints are flown, xi_1 and xi_2 stand behind rho and
# their slopes behind the velocities.
COAST_SIZE, ADJOINT_SIZE = 12, 24


@inline
def oblateness(ob, r):
    """The acceleration of J2 at a point [m/s2], with ob = 3/2 J2 mu R^2.

    -ob / r^5 ((1 - 5 z^2 / r^2) r + 2 z e_z), which is Vallado's with the factors in another order.
    """
    square = dot(r, r)
    factor = -ob / (square * square * math.sqrt(square))
    b = 1.0 - 5.0 * r[2] * r[2] / square
    return factor * b * r[0], factor * b * r[1], factor * (b + 2.0) * r[2]


@inline
def oblateness_difference(ob, r, d):
    """The acceleration of J2 at r + d less that at r [m/s2].

    With A = -ob / r^5 and B = (1 - 5 z^2 / r^2) r + 2 z e_z the difference is (dA) B + (A + dA) (dB), and

        dA = A ((1 + q)^(-5/2) - 1),   (1 + q)^5 - 1 = q (5 + 10 q + 10 q^2 + 5 q^3 + q^4),   q = d . (d + 2 r) / r^2
    """
    square = dot(r, r)
    a = -ob / (square * square * math.sqrt(square))
    q = dot(d, plus(d, scaled(2.0, r))) / square
    power = (1.0 + q) * (1.0 + q) * math.sqrt(1.0 + q)
    da = -a * q * (5.0 + q * (10.0 + q * (10.0 + q * (5.0 + q)))) / (power * (1.0 + power))
    ratio = r[2] * r[2] / square
    b = 1.0 - 5.0 * ratio
    db = -5.0 * (d[2] * (d[2] + 2.0 * r[2]) / square - q * ratio) / (1.0 + q)
    a += da
    return (
        da * b * r[0] + a * (b * d[0] + db * (r[0] + d[0])),
        da * b * r[1] + a * (b * d[1] + db * (r[1] + d[1])),
        da * (b + 2.0) * r[2] + a * ((b + 2.0) * d[2] + db * (r[2] + d[2])),
    )


@kernel
def gravity_gradient(mu, ob, r, u):
    """The derivative of gravity at the point r in the direction u: G u."""
    square = dot(r, r)
    cube = square * math.sqrt(square)
    along = dot(r, u) / square
    a = scaled(mu / cube, minus(scaled(3.0 * along, r), u))
    if ob != 0.0:
        factor = -ob / (cube * square)
        b = 1.0 - 5.0 * r[2] * r[2] / square
        db = -10.0 * r[2] * (u[2] - along * r[2]) / square
        # (dA) B + A (dB), with dA = -5 A r . u / r^2.
        across = db - 5.0 * along * b
        a = plus(a, scaled(factor, plus(scaled(across, r), scaled(b, u))))
        a = plus(a, (0.0, 0.0, 2.0 * factor * (u[2] - 5.0 * along * r[2])))
    return a


@kernel
def slope(y, size, mu, ob, k, row):
    """Write the slope of the state y[:size] of a coast into k[row, :size]."""
    half = size // 2
    out = k[row]
    for n in range(half):
        out[n] = y[half + n]
    r, rho = vector(y), vector(y, 3)
    square = dot(r, r)
    rate = mu / (square * math.sqrt(square))
    a = scaled(-rate, r)
    b = differential_gravity(rate, r, rho)
    if ob != 0.0:
        a = plus(a, oblateness(ob, r))
        b = plus(b, oblateness_difference(ob, r, rho))
    put(out, a, half)
    put(out, b, half + 3)
    for n in range(6, half, 3):
        # The adjoint of the platform, then that of the satellite.
        body = plus(r, rho) if n > 6 else r
        put(out, gravity_gradient(mu, ob, body, vector(y, n)), half + n)


@kernel
def advance(y, size, h, mu, ob, k, stage):
    """Take y[:size] one step of h [s] further; leaves the slope where it started in k[0]."""
    for i in range(TABLE.shape[0]):
        for n in range(size):
            stage[n] = 0.0
        for j in range(i):
            a = TABLE[i, j]
            if a != 0.0:
                for n in range(size):
                    stage[n] += a * k[j, n]
        for n in range(size):
            stage[n] = y[n] + h * stage[n]
        if i < k.shape[0]:
            slope(stage, size, mu, ob, k, i)
    for n in range(size):
        y[n] = stage[n]


@kernel
def product_and_square(nodes, accelerations, i, h, z):
    """rho . d rho / dz and |rho|^2 at the share z of the step of h [s] behind node i.

    On the polynomial of degree five that has position, velocity and acceleration of both nodes.
    """
    product = square = 0.0
    for n in range(3):
        start, velocity, acceleration = nodes[i, 3 + n], h * nodes[i, 9 + n], h * h * accelerations[i, n]
        a = nodes[i + 1, 3 + n] - start - velocity - 0.5 * acceleration
        b = h * nodes[i + 1, 9 + n] - velocity - acceleration
        c = h * h * accelerations[i + 1, n] - acceleration
        c3, c4, c5 = 10.0 * a - 4.0 * b + 0.5 * c, -15.0 * a + 7.0 * b - c, 6.0 * a - 3.0 * b + 0.5 * c
        value = start + z * (velocity + z * (0.5 * acceleration + z * (c3 + z * (c4 + z * c5))))
        product += value * (velocity + z * (acceleration + z * (3.0 * c3 + z * (4.0 * c4 + z * 5.0 * c5))))
        square += value * value
    return product, square


@kernel
def nearest(nodes, accelerations, times, first, last):
    """Where the distance is smallest between the nodes first and last: a node, and the time from it [s]."""
    node, offset, smallest, square = first, 0.0, np.inf, np.inf
    for i in range(first, last):
        h = times[i + 1] - times[i]
        before, square = product_and_square(nodes, accelerations, i, h, 0.0)
        if square < smallest:
            smallest, node, offset = square, i, 0.0
        for part in range(PARTS):
            low, high = part / PARTS, (part + 1.0) / PARTS
            after, square = product_and_square(nodes, accelerations, i, h, high)
            if before < 0.0 <= after:
                middle = least = 0.0
                for _ in range(25):
                    middle = 0.5 * (low + high)
                    product, least = product_and_square(nodes, accelerations, i, h, middle)
                    if product < 0.0:
                        low = middle
                    else:
                        high = middle
                if least < smallest:
                    smallest, node, offset = least, i, middle * h
            before = after
    if square < smallest:
        return last, 0.0
    return node, offset


def _entry_point(source_digest):
    """The compiled batch, kept on disk under a key that contains the digest of the sources."""

    @entry_point
    def approach_all(states, grids, mean_motion, mu, ob, scratch, with_adjoint, distance, time):
        """Fly every run from its release, a row of `states` (n, 24), to where the distance is smallest in its window.

        Leaves the state there in states[:, :12], or the adjoints at the release in states[:, 6:12] and
        states[:, 18:24]. A row of `grids`: eccentric anomaly from the release to the start and to the end of the
        window, the steps for each (whole numbers), p and s of `anomaly_after`. `scratch` holds states, rho'' and times
        of the nodes, then slopes and state of the stages.
        """
        digest = source_digest  # noqa: F841 a closure variable enters the cache key only where it is used
        nodes, accelerations, times, k, stage = scratch
        size = nodes.shape[1]
        for run in range(states.shape[0]):
            y, start, end, p, s = states[run], grids[run, 0], grids[run, 1], grids[run, 4], grids[run, 5]
            first, count = int(grids[run, 2]), int(grids[run, 3])
            last = first + count
            for i in range(last + 1):
                x = start * i / first if i < first else start
                if i > first:
                    x += (end - start) * (i - first) / count
                times[i] = (x - p * math.sin(x) + s * (1.0 - math.cos(x))) / mean_motion
            for i in range(last + 1):
                for n in range(size):
                    nodes[i, n] = y[n]
                advance(y, size, times[i + 1] - times[i] if i < last else 0.0, mu, ob, k, stage)
                for n in range(3):
                    accelerations[i, n] = k[0, 9 + n]
            node, h = nearest(nodes, accelerations, times, first, last)
            here = times[node]
            for n in range(size):
                y[n] = nodes[node, n]
            # The polynomial knows it to some 1e-9 of a step; Newton's method on the flown motion does the rest.
            for _ in range(6):
                if abs(h) < 1e-10:
                    break
                advance(y, size, h, mu, ob, k, stage)
                here += h
                product = bend = 0.0
                for n in range(3, 6):
                    product += y[n] * y[6 + n]
                    bend += y[6 + n] * y[6 + n] + y[n] * k[0, 6 + n]
                h = -product / bend if bend > 0.0 else 0.0
            distance[run], time[run] = math.sqrt(y[3] ** 2 + y[4] ** 2 + y[5] ** 2), here
            if with_adjoint:
                for n in range(6):
                    # A distance of 0 has no gradient: 0 is one of its subgradients.
                    y[18 + n] = y[3 + n % 3] / distance[run] if distance[run] > 0.0 else 0.0
                    y[12 + n], y[6 + n] = y[6 + n], 0.0
                for i in range(node, -1, -1):
                    advance(y, y.shape[0], times[i] - here, mu, ob, k, stage)
                    here = times[i]

    return approach_all


approach_all = _entry_point(SOURCE_DIGEST)
