"""The coast after the release: both bodies on their own orbits, and how close they come again.

Until the last release the common CG, O, flies the orbit; from then on each body flies freely in the Earth's field g
(central, with J2 where asked), starting from d and w = d' (inertial axes) between the CGs:

    u_1 = -(m_2 / M) d,   u_2 = (m_1 / M) d,   M = m_1 + m_2,   the same for the velocities
    r_1'' = g(r_1),   rho'' = g(r_1 + rho) - g(r_1),   rho = r_2 - r_1

The difference is written without cancellation (Battin 1999, section 8.4; `oblateness_difference`), so a distance of a
metre keeps its digits at seven thousand kilometres from the centre of the Earth. The steps, of the eighth-order method
of Dormand and Prince (Hairer, Norsett, Wanner 1993, section II.5), are equal in the eccentric anomaly of O: a motion
whose course is known needs no error control.

The gradient comes from the adjoint of the coast. The gradient G of g is symmetric, so with any solution xi of
xi'' = G(r(t)) xi the number xi . v - xi' . x is constant over every variation x, v = x' of an orbit r(t). With xi = 0
and xi' = n, the unit vector of rho, at the minimum, and flown back to the release from there,

    n . x(minimum) = xi'(release) . x(release) - xi(release) . v(release)

once for each body. The time of a minimum inside the window does not enter (envelope theorem), and the ends of the
window do not move with a run.

Validated for eccentricities to 0.65 at relative speeds to 100 m/s, and at 1 m/s to 0.9, or to 0.85 with J2: twice the
steps change the motion by less than 5e-8 of the distance. At 0.9 with J2 they change it by 1e-6 on an equatorial orbit.
There is no drag, and the Earth has no surface.

J2: Vallado, *Fundamentals of Astrodynamics and Applications* (2013), section 8.7. Kepler's equation from any point of
the orbit: Battin (1999), section 4.3.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numba import get_num_threads
from numpy.typing import ArrayLike

from satsep_ot.dynamics.gravity import EARTH_RADIUS
from satsep_ot.dynamics.kernels.coast import ADJOINT_SIZE, COAST_SIZE, STAGE_NUMBER, approach_all
from satsep_ot.dynamics.kernels.compilation import prepare
from satsep_ot.dynamics.kernels.records import STATE_SIZE
from satsep_ot.dynamics.kernels.vectors import quaternion_adjoint, rotation
from satsep_ot.dynamics.orbit import EARTH_J2, Orbit

MAXIMUM_ORBITS = 100.0
MAXIMUM_ECCENTRICITY = 0.9
GRADIENT_SIZE = STATE_SIZE + 3
STEPS_PER_ORBIT = 40  # a circular one
RUNS_PER_THREAD = 100  # before another thread is worth its start


@dataclass(frozen=True)
class Recontact:
    """The window of the coast in which the smallest distance of the two CGs is looked for.

    Parameters
    ----------
    start_orbits, end_orbits : float
        Its ends, in periods of the orbit after the last release; 0 <= start < end <= 100. The start leaves out the
        separation itself.

    Raises
    ------
    ValueError
        If the ends are not allowed.

    Examples
    --------
    >>> from satsep_ot.dynamics.relative_orbit import Recontact
    >>> Recontact(end_orbits=3.0)
    Recontact(start_orbits=0.1, end_orbits=3.0)
    """

    start_orbits: float = 0.1
    end_orbits: float = 1.0

    def __post_init__(self):
        if not 0.0 <= self.start_orbits < self.end_orbits <= MAXIMUM_ORBITS:
            raise ValueError(
                f"the window of re-contact is {self.start_orbits} to {self.end_orbits} orbits; it must be "
                f"0 <= start_orbits < end_orbits <= {MAXIMUM_ORBITS:g}"
            )


def anomaly_after(angle: np.ndarray, p: np.ndarray, s: np.ndarray) -> np.ndarray:
    """The changes x of the eccentric anomaly (n,) for changes `angle` of the mean anomaly (n,) [rad].

    Kepler's equation from any point of the orbit: angle = x - p sin x + s (1 - cos x), with p = e cos E and s = e sin E
    there. The right-hand side grows with x and differs from it by less than 2, which brackets Newton's method.
    """
    low, high = angle - 2.0, angle + 2.0
    x, open_ = angle, np.ones(angle.shape, bool)
    for _ in range(60):
        sine, cosine = np.sin(x), np.cos(x)
        value = x - p * sine + s * (1.0 - cosine) - angle
        low, high = np.where(value > 0.0, low, x), np.where(value > 0.0, x, high)
        new = x - value / (1.0 - p * cosine + s * sine)
        new = np.where((new >= low) & (new <= high), new, 0.5 * (low + high))
        # One that has converged stays as it is, so that it does not depend on the others.
        still = open_ & (np.abs(new - x) > 1e-15 * (1.0 + np.abs(new)))
        x, open_ = np.where(open_, new, x), still
        if not open_.any():
            break
    return x


def check_orbit(orbit: Orbit) -> None:
    """Refuse an orbit that no coast can be computed on, with a ValueError."""
    if not math.isfinite(orbit.period):
        raise ValueError("the orbit is not closed, so it has no period; its velocity must be below that of escape")
    radius = np.linalg.norm(orbit.position)
    momentum, energy = (
        np.cross(orbit.position, orbit.velocity),
        0.5 * orbit.velocity @ orbit.velocity - orbit.mu / radius,
    )
    eccentricity = math.sqrt(max(0.0, 1.0 + 2.0 * energy * (momentum @ momentum) / orbit.mu**2))
    if not eccentricity <= MAXIMUM_ECCENTRICITY:
        raise ValueError(
            f"the orbit has the eccentricity {eccentricity:.4g}; it must be at most {MAXIMUM_ECCENTRICITY}"
        )


class KeplerOrbit(NamedTuple):
    """O on its orbit at n times."""

    position: np.ndarray  # [m] (3, n)
    velocity: np.ndarray  # [m/s] (3, n)
    p: np.ndarray  # e cos E (n,)
    s: np.ndarray  # e sin E (n,)
    mean_motion: float  # [rad/s]
    eccentricity: float


def kepler_orbit(orbit: Orbit, times: np.ndarray) -> KeplerOrbit:
    """O at the times (n,) on its closed orbit, by Lagrange's coefficients in the eccentric anomaly."""
    check_orbit(orbit)
    mean_motion = 2.0 * math.pi / orbit.period
    axis = (orbit.mu / mean_motion**2) ** (1.0 / 3.0)
    radius, root = math.sqrt(orbit.position @ orbit.position), math.sqrt(orbit.mu * axis)
    p, s = 1.0 - radius / axis, orbit.position @ orbit.velocity / root
    x = anomaly_after(mean_motion * times, p, s)
    sine, cosine = np.sin(x), np.cos(x)
    new_radius = axis * (1.0 - p * cosine + s * sine)
    f, g = 1.0 - axis / radius * (1.0 - cosine), times - (x - sine) / mean_motion
    f_rate, g_rate = -root / (new_radius * radius) * sine, 1.0 - axis / new_radius * (1.0 - cosine)
    position, velocity = orbit.position[:, None], orbit.velocity[:, None]
    return KeplerOrbit(
        f * position + g * velocity, f_rate * position + g_rate * velocity, p * cosine - s * sine,
        p * sine + s * cosine, mean_motion, math.hypot(p, s),
    )  # fmt: skip


def _fly(states, release_times, masses, orbit, start, end, with_adjoint):
    """Distance and time (n,), what the kernel leaves (n, 24), O at the release and the platforms' matrices (3, 3, n).

    The window is from `start` to `end`, mean anomalies since the release (n,).
    """
    o = kepler_orbit(orbit, release_times)
    turn = np.array(rotation(states[:, 16:20].T)).reshape(3, 3, -1)
    share = masses[:, 1] / (masses[:, 0] + masses[:, 1])
    y = np.zeros((len(states), ADJOINT_SIZE))
    for i in range(3):
        d, w = (
            turn[i, 0] * states[:, j] + turn[i, 1] * states[:, j + 1] + turn[i, 2] * states[:, j + 2] for j in (0, 3)
        )
        y[:, i], y[:, 3 + i] = o.position[i] - share * d, d
        y[:, 6 + i], y[:, 9 + i] = o.velocity[i] - share * w, w
    # At the perigee the motion is faster than the eccentric anomaly by 1 / sqrt(1 - e); and the error of a method of
    # order 8 grows with the square of the orbits.
    density = STEPS_PER_ORBIT / (2.0 * math.pi * math.sqrt(1.0 - o.eccentricity))
    density *= max(1.0, end.max(initial=0.0) / (2.0 * math.pi)) ** 0.25
    start, end = anomaly_after(start, o.p, o.s), anomaly_after(end, o.p, o.s)
    grids = np.stack([start, end, np.ceil(density * start), np.ceil(density * (end - start)), o.p, o.s], axis=1)
    node_number = 1 + int((grids[:, 2] + grids[:, 3]).max(initial=0.0))
    ob = 1.5 * EARTH_J2 * orbit.mu * EARTH_RADIUS**2 if orbit.j2 else 0.0
    distance, time = np.empty(len(y)), np.empty(len(y))

    def fly_part(part):
        scratch = tuple(
            np.empty(shape)
            for shape in (
                (node_number, COAST_SIZE), (node_number, 3), node_number, (STAGE_NUMBER, ADJOINT_SIZE), ADJOINT_SIZE,
            )
        )  # fmt: skip
        arguments = (
            y[part], grids[part], o.mean_motion, orbit.mu, ob, scratch, with_adjoint, distance[part], time[part]
        )  # fmt: skip
        prepare({approach_all: arguments})
        approach_all(*arguments)

    threads = min(get_num_threads(), 1 + len(y) // RUNS_PER_THREAD)
    ends = np.linspace(0, len(y), threads + 1).astype(int)
    parts = [slice(*pair) for pair in pairwise(ends)]
    if threads == 1:
        fly_part(parts[0])
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(fly_part, parts))
    return distance, time, y, o, turn


def _release_gradient(states, masses, orbit, y, o, turn):
    """The gradients (n, 23) from the adjoints that the kernel leaves."""
    m1, m2 = masses.T
    total, share = m1 + m2, np.zeros(len(y))
    gradient, matrix = np.zeros((len(y), GRADIENT_SIZE)), np.empty_like(turn)
    rate = orbit.mu / (o.position[0] ** 2 + o.position[1] ** 2 + o.position[2] ** 2) ** 1.5
    for i in range(3):
        # Derivatives with respect to r_1, r_2, v_1, v_2 in inertial axes, then to d and w there.
        r1, r2, v1, v2 = -y[:, 18 + i], y[:, 21 + i], y[:, 6 + i], -y[:, 9 + i]
        by_d, by_w = (m1 * r2 - m2 * r1) / total, (m1 * v2 - m2 * v1) / total
        gradient[:, 20] += (r1 + r2) * o.velocity[i] - (v1 + v2) * rate * o.position[i]
        for j in range(3):
            gradient[:, j] += turn[i, j] * by_d
            gradient[:, 3 + j] += turn[i, j] * by_w
            matrix[i, j] = by_d * states[:, j] + by_w * states[:, 3 + j]
            share += turn[i, j] * ((r1 + r2) * states[:, j] + (v1 + v2) * states[:, 3 + j])
    gradient[:, 21], gradient[:, 22] = share * m2 / total**2, -share * m1 / total**2
    gradient[:, 16:20] = np.stack(quaternion_adjoint(states[:, 16:20].T, matrix.reshape(9, len(y))), axis=1)
    return gradient


def closest_approaches(
    states: ArrayLike,
    release_times: ArrayLike,
    masses: ArrayLike,
    orbit: Orbit,
    window: Recontact | None = None,
    gradient: bool = False,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The smallest distance of the two CGs in a window of the coast after the last release, for n runs.

    Parameters
    ----------
    states : array_like, shape (n, 20)
        At the last release; see `satsep_ot.dynamics.kernels.records`.
    release_times : array_like, shape (n,)
        When that was [s].
    masses : array_like, shape (n, 2)
        Of the platform and the satellite [kg].
    orbit : Orbit
        Of O at t = 0; see `satsep_ot.dynamics.separation.Separation.stack_orbit`.
    window : Recontact, optional
        By default `Recontact()`.
    gradient : bool
        Whether the exact gradients are wanted.

    Returns
    -------
    distance : ndarray, shape (n,)
        [m]; NaN for a state that is not finite.
    time : ndarray, shape (n,)
        When that is [s] since the last release.
    gradient : ndarray, shape (n, 23), or None
        With respect to the state (the numbers of the quaternion taken as free), the release time and the two masses,
        the orbit of O being fixed. There is none where two minima are equally close, or where the distance is 0.

    Raises
    ------
    ValueError
        If a shape is not allowed, or the orbit is not closed or too eccentric.

    Examples
    --------
    0.6 m/s along the track, without recoil of the platform: 10.2 km after one orbit.

    >>> import numpy as np
    >>> from satsep_ot.dynamics.orbit import Orbit
    >>> from satsep_ot.dynamics.relative_orbit import Recontact, closest_approaches
    >>> orbit = Orbit.from_elements(6878137.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    >>> state = np.zeros((1, 20))
    >>> state[0, [4, 12, 16]] = 0.6, 1.0, 1.0
    >>> distance, time, _ = closest_approaches(state, [0.0], [[1e12, 1.0]], orbit, Recontact(0.999999, 1.0))
    >>> print(f"{distance[0]:.1f} m after {time[0]:.0f} s")
    10221.8 m after 5677 s
    """
    window = Recontact() if window is None else window
    states, release_times, masses = (np.asarray(value, dtype=float) for value in (states, release_times, masses))
    count = len(states)
    for name, value, shape in (
        ("states", states, (count, STATE_SIZE)),
        ("release_times", release_times, (count,)),
        ("masses", masses, (count, 2)),
    ):
        if value.shape != shape:
            raise ValueError(f"{name} has shape {value.shape}; it must be {shape}")
    rows = np.isfinite(states).all(axis=1) & np.isfinite(release_times) & (masses > 0.0).all(axis=1)
    states, release_times, masses = states[rows], release_times[rows], masses[rows]
    start, end = (np.full(len(states), 2.0 * math.pi * orbits) for orbits in (window.start_orbits, window.end_orbits))
    distance, time, y, o, turn = _fly(states, release_times, masses, orbit, start, end, gradient)
    result = np.full((count, 2), np.nan)
    result[rows] = np.stack([distance, time], axis=1)
    if not gradient:
        return *result.T, None
    gradients = np.full((count, GRADIENT_SIZE), np.nan)
    gradients[rows] = _release_gradient(states, masses, orbit, y, o, turn)
    return *result.T, gradients


def coast(state: np.ndarray, release_time: float, masses: ArrayLike, orbit: Orbit, times: ArrayLike) -> np.ndarray:
    """Both bodies on their orbits after the last release of one run.

    Parameters
    ----------
    state : array_like, shape (20,)
        At the last release; see `satsep_ot.dynamics.kernels.records`.
    release_time : float
        When that was [s].
    masses : array_like, shape (2,)
        Of the platform and the satellite [kg].
    orbit : Orbit
        Of O at t = 0; see `satsep_ot.dynamics.separation.Separation.stack_orbit`.
    times : array_like, shape (T,)
        Since the last release [s].

    Returns
    -------
    motion : ndarray, shape (T, 12)
        ECI position of the platform's CG [m] and position of the satellite's from there [m], then their velocities
        [m/s].

    Raises
    ------
    ValueError
        If a time is negative, or the orbit is not closed or too eccentric.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.dynamics.orbit import Orbit
    >>> from satsep_ot.dynamics.relative_orbit import coast
    >>> orbit = Orbit.from_elements(6878137.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    >>> state = np.zeros(20)
    >>> state[[4, 12, 16]] = 0.6, 1.0, 1.0
    >>> print(coast(state, 0.0, [1200.0, 100.0], orbit, [0.0, 60.0]).shape)
    (2, 12)
    """
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or not ((times >= 0.0) & (times < np.inf)).all():
        raise ValueError(f"times = {times.tolist()} s; they must be finite and not negative")
    count = len(times)
    states, masses = (np.tile(np.asarray(value, dtype=float), (count, 1)) for value in (state, masses))
    # A window without length at each time.
    angles = 2.0 * math.pi / orbit.period * times
    return _fly(states, np.full(count, float(release_time)), masses, orbit, angles, angles, False)[2][:, :COAST_SIZE]
