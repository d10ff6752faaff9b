"""The coast after the release: Hill's equations, Kepler's in extended precision, scipy in ECI coordinates."""

import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.optimize import minimize_scalar
from separation_cases import general_separation, symmetric_separation

from satsep_ot.dynamics import relative_orbit
from satsep_ot.dynamics.gravity import EARTH_GRAVITATIONAL_PARAMETER as MU
from satsep_ot.dynamics.gravity import EARTH_RADIUS
from satsep_ot.dynamics.orbit import EARTH_J2, Orbit
from satsep_ot.dynamics.relative_orbit import Recontact, closest_approaches, coast
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.separation import Pivot

MASSES = np.array([1200.0, 100.0])
CIRCULAR = Orbit.from_elements(6878137.0, 0.0, 0.0, 0.0, 0.0, 0.0)
ORBITS = {
    "circular": CIRCULAR,
    "circular with J2": Orbit.from_elements(6878137.0, 0.0, 1.7, 0.4, 0.0, 0.9, j2=True),
    "eccentric": Orbit.from_elements(24e6, 0.7, 0.5, 0.1, 1.2, 0.3),
    "eccentric with J2": Orbit.from_elements(8e6, 0.15, 1.1, 2.0, 0.7, -2.0, j2=True),
}


def release(position, velocity, attitude=(1.0, 0.0, 0.0, 0.0)):
    """A state at the last release, in platform axes."""
    return np.concatenate([position, velocity, np.zeros(6), [1.0, 0.0, 0.0, 0.0], attitude])


def random_releases(count, seed=0, speed=0.6):
    rng = np.random.default_rng(seed)
    attitudes = rng.standard_normal((count, 4))
    attitudes /= np.linalg.norm(attitudes, axis=1, keepdims=True)
    push = [0.0, speed, 0.0] + 0.05 * speed * rng.standard_normal((count, 3))
    place = [0.0, 2.0, 0.0] + 0.05 * rng.standard_normal((count, 3))
    return np.array([release(*row) for row in zip(place, push, attitudes, strict=True)])


def approach(state, orbit, window, masses=MASSES, release_time=0.0):
    distance, time, _ = closest_approaches([state], [release_time], [masses], orbit, window)
    return distance[0], time[0]


def hill(position, velocity, n, t):
    """Clohessy and Wiltshire's solution of Hill's equations; x up, y along the track, z normal."""
    (x, y, z), (u, v, w), s, c = position, velocity, np.sin(n * t), np.cos(n * t)
    return np.array(
        [
            (4.0 - 3.0 * c) * x + s / n * u + 2.0 / n * (1.0 - c) * v,
            6.0 * (s - n * t) * x + y + 2.0 / n * (c - 1.0) * u + (4.0 * s / n - 3.0 * t) * v,
            c * z + s / n * w,
        ]
    )


@pytest.mark.parametrize(("along", "nonlinear"), [(0.6, 10221.8), (-0.6, 10215.4)])
def test_a_push_along_the_track_against_hill(along, nonlinear):
    """PHYSICS of a massive platform, so that O is its CG: 3 T v after one orbit, and a little more in truth."""
    period, n = CIRCULAR.period, 2.0 * np.pi / CIRCULAR.period
    linear = np.linalg.norm(hill([0.0] * 3, [0.0, along, 0.0], n, period))
    assert linear == pytest.approx(10218.6, abs=0.1)
    assert linear == pytest.approx(3.0 * period * abs(along), rel=1e-12)
    distance, time = approach(release([0.0] * 3, [0.0, along, 0.0]), CIRCULAR, Recontact(1.0 - 1e-9, 1.0), [1e12, 1.0])
    assert distance == pytest.approx(nonlinear, abs=0.1)
    assert distance == pytest.approx(linear, rel=1e-3)
    assert time == pytest.approx(period, rel=1e-8)


@pytest.mark.parametrize("push", [[0.6, 0.0, 0.0], [0.0, 0.0, 0.6], [-0.6, 0.0, 0.0]])
def test_a_push_across_the_track_comes_back(push):
    """Hill's equations bring a radial or normal push back to the start after one orbit."""
    distance, time = approach(release([0.0] * 3, push), CIRCULAR, Recontact(0.8, 1.1))
    assert distance < 0.4
    assert time == pytest.approx(CIRCULAR.period, abs=2.0)


def kepler(position, velocity, times):
    """Positions on a Kepler orbit in extended precision, by Kepler's equation and Lagrange's coefficients."""
    r0, v0, t = (np.asarray(value, np.longdouble) for value in (position, velocity, times))
    mu = np.longdouble(MU)
    radius = np.sqrt(r0 @ r0)
    axis = 1 / (2 / radius - v0 @ v0 / mu)
    n, p, s = np.sqrt(mu / axis**3), 1 - radius / axis, r0 @ v0 / np.sqrt(mu * axis)
    x = n * t
    for _ in range(100):
        x = x - (x - p * np.sin(x) + s * (1 - np.cos(x)) - n * t) / (1 - p * np.cos(x) + s * np.sin(x))
    f, g = 1 - axis / radius * (1 - np.cos(x)), t - (x - np.sin(x)) / n
    return f[:, None] * r0 + g[:, None] * v0


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="this machine has no extended precision")
@pytest.mark.parametrize("name", ["circular", "eccentric"])
def test_two_body_motion_against_kepler_in_extended_precision(name):
    orbit = ORBITS[name]
    times = np.linspace(0.0, 1.5 * orbit.period, 50)
    for state in random_releases(5):
        turn = rotation_matrix(state[16:20]).astype(np.longdouble)
        d, w = turn @ state[:3], turn @ state[3:6]
        share = np.longdouble(100.0) / 1300
        platform = kepler(orbit.position - share * d, orbit.velocity - share * w, times)
        satellite = kepler(orbit.position + (1 - share) * d, orbit.velocity + (1 - share) * w, times)
        motion = coast(state, 0.0, MASSES, orbit, times)
        size = np.linalg.norm((satellite - platform).astype(float), axis=1)
        error = np.linalg.norm((motion[:, 3:6] - (satellite - platform)).astype(float), axis=1)
        assert error.max() < 5e-9 * size.max()
        assert np.abs((motion[:, :3] - platform).astype(float)).max() < 0.02


def field(orbit, r):
    """The Earth's acceleration at r, and its potential, as textbooks print them (Vallado 2013, section 8.7)."""
    x, y, z = r
    radius = np.linalg.norm(r)
    acceleration, potential = -orbit.mu / radius**3 * r, -orbit.mu / radius
    if orbit.j2:
        c = 1.5 * EARTH_J2 * orbit.mu * EARTH_RADIUS**2 / radius**5
        ratio = 5.0 * z**2 / radius**2
        acceleration = acceleration + c * np.array([x * (ratio - 1.0), y * (ratio - 1.0), z * (ratio - 3.0)])
        sine = z / radius
        potential += orbit.mu * EARTH_J2 * EARTH_RADIUS**2 / radius**3 * (1.5 * sine**2 - 0.5)
    return acceleration, potential


def fly_with_scipy(state, orbit, end):
    """Both bodies in ECI coordinates, each on its own: a dense solution from the release."""
    turn = rotation_matrix(state[16:20])
    d, w = turn @ state[:3], turn @ state[3:6]
    start = np.concatenate(
        [
            np.concatenate([orbit.position + share * d, orbit.velocity + share * w])
            for share in (-100.0 / 1300.0, 1200.0 / 1300.0)
        ]
    )

    def slope(t, x):
        return np.concatenate([x[3:6], field(orbit, x[:3])[0], x[9:12], field(orbit, x[6:9])[0]])

    return solve_ivp(slope, (0.0, end), start, method="DOP853", rtol=3e-14, atol=1e-7, dense_output=True).sol


@pytest.mark.parametrize("name", ORBITS)
def test_motion_and_minimum_against_scipy(name):
    orbit = ORBITS[name]
    # Along and across the track, so that the minimum is at the start, inside, and at the end of the window.
    for attitude in ([1.0, 0.0, 0.0, 0.0], [0.7, 0.1, -0.3, 0.6], [0.5, 0.5, 0.5, 0.5]):
        state = release([0.05, 2.0, -0.03], [0.02, 0.6, 0.01], np.array(attitude) / np.linalg.norm(attitude))
        flown = fly_with_scipy(state, orbit, 1.2 * orbit.period)
        times = np.linspace(0.0, 1.2 * orbit.period, 30)
        motion, expected = coast(state, 0.0, MASSES, orbit, times), flown(times).T
        np.testing.assert_allclose(motion[:, :3], expected[:, :3], atol=1e-2)
        np.testing.assert_allclose(motion[:, 3:6], expected[:, 6:9] - expected[:, :3], atol=1e-5)
        np.testing.assert_allclose(motion[:, 9:12], expected[:, 9:12] - expected[:, 3:6], atol=1e-7)

        def distance(t, flown=flown):
            return np.linalg.norm(flown(t)[6:9] - flown(t)[:3])

        for window in (Recontact(), Recontact(0.1, 1.2), Recontact(0.4, 0.8)):
            grid = np.linspace(window.start_orbits * orbit.period, window.end_orbits * orbit.period, 400)
            values = np.array([distance(t) for t in grid])
            best = int(np.argmin(values))
            low, high = grid[max(best - 1, 0)], grid[min(best + 1, 399)]
            found = minimize_scalar(distance, bounds=(low, high), method="bounded", options={"xatol": 1e-4})
            smallest = min(values[best], found.fun)
            assert approach(state, orbit, window)[0] == pytest.approx(smallest, rel=1e-6, abs=1e-4)


@pytest.mark.parametrize("name", ["circular with J2", "eccentric with J2"])
def test_bodies_that_are_far_from_each_other_against_scipy(name):
    """Hundreds of kilometres apart the attraction differs by more than its first derivatives."""
    orbit = ORBITS[name]
    state = release([0.05, 2.0, -0.03], [150.0, 300.0, -100.0], np.array([0.7, 0.1, -0.3, 0.6]) / np.sqrt(0.95))
    times = np.linspace(0.0, 0.4 * orbit.period, 5)
    motion, expected = coast(state, 0.0, MASSES, orbit, times), fly_with_scipy(state, orbit, times[-1])(times).T
    apart = expected[:, 6:9] - expected[:, :3]
    assert np.linalg.norm(apart[-1]) > 2e5
    np.testing.assert_allclose(motion[:, 3:6], apart, atol=1e-9 * np.linalg.norm(apart[-1]))


@pytest.mark.parametrize("name", ORBITS)
def test_energy_of_both_bodies_is_constant(name):
    orbit = ORBITS[name]
    motion = coast(random_releases(1)[0], 0.0, MASSES, orbit, np.linspace(0.0, 2.0 * orbit.period, 40))
    for body in range(2):
        r, v = motion[:, :3] + body * motion[:, 3:6], motion[:, 6:9] + body * motion[:, 9:12]
        energy = np.array([0.5 * u @ u + field(orbit, x)[1] for x, u in zip(r, v, strict=True)])
        np.testing.assert_allclose(energy, energy[0], rtol=1e-10)


def test_the_common_cg_stays_on_the_orbit():
    """Both recoil: one revolution brings O back to where it was, to 1e-3 m, and the platform alone not."""
    motion = coast(release([0.0, 2.0, 0.0], [0.0, 0.6, 0.0]), 0.0, MASSES, CIRCULAR, [CIRCULAR.period])[0]
    assert np.linalg.norm(motion[:3] - CIRCULAR.position) > 100.0
    # Kepler's motion is not linear: over one orbit O leaves by 3 (m_1 m_2 / M^2) (w / n)^2 / a, some 0.03 m a unit.
    assert np.linalg.norm(motion[:3] + motion[3:6] / 13.0 - CIRCULAR.position) < 1.0
    still = coast(release([0.0] * 3, [0.0] * 3), 0.0, MASSES, CIRCULAR, [CIRCULAR.period])[0]
    assert np.linalg.norm(still[:3] - CIRCULAR.position) < 1e-3


def test_before_the_release_the_stack_flies_the_orbit():
    """A release later by a time is one from further along the orbit."""
    orbit, delay = ORBITS["eccentric"], 700.0
    later = coast(release([0.0] * 3, [0.0] * 3), 0.0, MASSES, orbit, [delay])[0]
    moved = Orbit(later[:3], later[6:9])
    for state in random_releases(3):
        assert approach(state, orbit, Recontact(), release_time=delay) == pytest.approx(
            approach(state, moved, Recontact()), rel=1e-8
        )


def test_the_minimum_is_located_inside_and_at_both_ends():
    along, across = release([0.0] * 3, [0.0, 0.6, 0.0]), release([0.0] * 3, [0.6, 0.0, 0.0])
    period = CIRCULAR.period
    assert approach(along, CIRCULAR, Recontact(0.2, 1.0))[1] == pytest.approx(0.2 * period, rel=1e-12)
    assert approach(across, CIRCULAR, Recontact(0.6, 0.9))[1] == pytest.approx(0.9 * period, rel=1e-12)
    distance, time = approach(across, CIRCULAR, Recontact(0.6, 1.3))
    motion = coast(across, 0.0, MASSES, CIRCULAR, time + np.array([-1.0, 0.0, 1.0]))
    around = np.linalg.norm(motion[:, 3:6], axis=1)
    assert around[1] == pytest.approx(distance, abs=1e-7)
    assert around[1] < min(around[0], around[2])
    assert motion[1, 3:6] @ motion[1, 9:12] == pytest.approx(0.0, abs=1e-7)


def high_order_differences(function, x, steps):
    """Central differences of the eighth order, one for each component."""
    weights = np.array([4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0])
    gradient = np.empty(x.size)
    for i, step in enumerate(steps):
        rows = np.tile(x, (8, 1))
        rows[:4, i] += step * np.arange(1, 5)
        rows[4:, i] -= step * np.arange(1, 5)
        values = function(rows)
        gradient[i] = weights @ (values[:4] - values[4:]) / step
    return gradient


# Position, velocity, rates, both quaternions, time and masses: as large as the smoothness of the distance allows.
STEPS = np.repeat([2e-3, 2e-4, 0.1, 0.01, 2e-4, 1.0, 50.0, 5.0], [3, 3, 6, 4, 4, 1, 1, 1])


@pytest.mark.parametrize("name", ORBITS)
@pytest.mark.parametrize("window", [Recontact(), Recontact(0.55, 0.9), Recontact(0.8, 1.3), Recontact(0.5, 3.2)])
def test_gradient_against_high_order_differences(name, window):
    orbit = ORBITS[name]

    def distances(rows):
        return closest_approaches(rows[:, :20], rows[:, 20], rows[:, 21:], orbit, window)[0]

    for state in random_releases(2, seed=3):
        x = np.concatenate([state, [40.0], MASSES])
        gradient = closest_approaches([state], [40.0], [MASSES], orbit, window, gradient=True)[2][0]
        expected = high_order_differences(distances, x, STEPS)
        # By blocks: each has its own unit.
        for block in (slice(0, 3), slice(3, 6), slice(6, 16), slice(16, 20), slice(20, 21), slice(21, 23)):
            noise = 1e-9 * distances(x[None])[0] / STEPS[block]
            np.testing.assert_allclose(
                gradient[block], expected[block], rtol=0, atol=1e-7 * np.linalg.norm(expected[block]) + noise.max()
            )


def test_gradient_soon_after_the_release():
    """A few steps only; the release was not at t = 0, and no axis is along another."""
    orbit, window = ORBITS["eccentric with J2"], Recontact(0.02, 0.05)
    state = random_releases(1, seed=5)[0]
    x = np.concatenate([state, [40.0], MASSES])
    gradient = closest_approaches([state], [40.0], [MASSES], orbit, window, gradient=True)[2][0]
    steps = np.diag(0.1 * STEPS)
    rows = np.concatenate([x + steps, x - steps])
    distances = closest_approaches(rows[:, :20], rows[:, 20], rows[:, 21:], orbit, window)[0]
    expected = (distances[:23] - distances[23:]) / (0.2 * STEPS)
    for block in (slice(0, 3), slice(3, 6), slice(6, 16), slice(16, 20), slice(20, 21), slice(21, 23)):
        np.testing.assert_allclose(
            gradient[block], expected[block], rtol=0, atol=1e-5 * np.linalg.norm(expected[block]) + 1e-9
        )
    assert np.abs(gradient[[0, 3, 16, 20, 21, 22]]).min() > 0.0


def test_a_distance_of_nothing_has_no_gradient_and_gets_none():
    distance, _, gradient = closest_approaches([np.zeros(20)], [0.0], [MASSES], CIRCULAR, gradient=True)
    assert distance[0] == 0.0
    assert (gradient == 0.0).all()


def test_a_run_does_not_depend_on_its_batch():
    states = random_releases(301)
    times, masses = np.linspace(0.0, 0.2, 301), np.tile(MASSES, (301, 1))
    orbit = ORBITS["eccentric with J2"]
    together = closest_approaches(states, times, masses, orbit, gradient=True)
    for i in (0, 7, 150, 151, 300):
        alone = closest_approaches(states[[i]], times[[i]], masses[[i]], orbit, gradient=True)
        for one, all_of_them in zip(alone, together, strict=True):
            np.testing.assert_array_equal(one[0], all_of_them[i])
    without = closest_approaches(states, times, masses, orbit)
    np.testing.assert_array_equal(without[0], together[0])
    assert without[2] is None


def test_rows_that_are_no_state_are_nan_and_harm_no_other():
    states = random_releases(4)
    states[1, 3], states[2, 17] = np.nan, np.inf
    distance, time, gradient = closest_approaches(
        states, [0.1] * 4, [MASSES, MASSES, MASSES, [1200.0, -1.0]], CIRCULAR, gradient=True
    )
    for value in (distance, time, gradient[:, 0]):
        assert np.isfinite(value).tolist() == [True, False, False, False]
    assert distance[0] == approach(states[0], CIRCULAR, Recontact(), release_time=0.1)[0]
    assert closest_approaches(np.empty((0, 20)), [], np.empty((0, 2)), CIRCULAR)[0].shape == (0,)


ANGLE = st.floats(-3.1, 3.1)


@settings(max_examples=30, deadline=None, derandomize=True)
@example(share=1.0, inclination=0.0, anomaly=0.0, speed=1.0, fast=False, j2=False)
@example(share=1.0, inclination=0.0, anomaly=0.0, speed=1.0, fast=False, j2=True)
@example(share=1.0, inclination=0.0, anomaly=0.0, speed=1.0, fast=True, j2=True)
@given(st.floats(0.0, 1.0), st.floats(0.0, 3.1), ANGLE, st.floats(0.01, 1.0), st.booleans(), st.booleans())
def test_twice_the_steps_change_nothing(share, inclination, anomaly, speed, fast, j2):
    """Eccentricities to 0.65 at speeds to 100 m/s, and at 1 m/s to 0.9, or to 0.85 with J2."""
    highest = 0.65 if fast else 0.85 if j2 else 0.9
    e, speed = highest * share, 100.0 * speed if fast else speed
    orbit = Orbit.from_elements(6.7e6 / (1.0 - e), e, inclination, 0.4, 0.3, anomaly, j2=j2)
    state, times = random_releases(1, 5, speed)[0], np.linspace(0.0, 1.0, 5) * orbit.period
    usual = coast(state, 0.1, MASSES, orbit, times)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(relative_orbit, "STEPS_PER_ORBIT", 2 * relative_orbit.STEPS_PER_ORBIT)
        fine = coast(state, 0.1, MASSES, orbit, times)
    size = np.linalg.norm(fine[:, 3:6], axis=1).max()
    assert np.abs(usual[:, 3:6] - fine[:, 3:6]).max() < 5e-8 * size


def test_the_order_of_the_method():
    state, ends = release([0.0, 2.0, 0.0], [0.0, 0.6, 0.0]), []
    for steps in (32, 48, 160):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(relative_orbit, "STEPS_PER_ORBIT", steps)
            ends.append(coast(state, 0.0, MASSES, CIRCULAR, [CIRCULAR.period])[0, 3:6])
    coarse, fine = (np.linalg.norm(end - ends[2]) for end in ends[:2])
    assert np.log(coarse / fine) / np.log(1.5) > 7.5


@pytest.mark.parametrize("pivot", Pivot)
def test_orbit_of_the_stack(pivot):
    separation = general_separation(pivot=pivot)
    orbit = separation.stack_orbit()
    if pivot == Pivot.STACK:
        np.testing.assert_allclose(orbit.position, separation.orbit.position, rtol=1e-15)
        np.testing.assert_allclose(orbit.velocity, separation.orbit.velocity, rtol=1e-15)
    else:
        arm = np.linalg.norm(orbit.position - separation.orbit.position)
        between = separation.satellite.center_of_mass - separation.platform.center_of_mass
        assert arm == pytest.approx(100.0 / 1300.0 * np.linalg.norm(between), rel=1e-6)
    assert orbit.j2 == separation.orbit.j2
    assert symmetric_separation(orbit=ORBITS["circular with J2"]).stack_orbit().j2


@pytest.mark.parametrize("ends", [(0.5, 0.5), (-0.1, 1.0), (1.0, 0.2), (0.0, 101.0), (np.nan, 1.0), (0.0, np.inf)])
def test_windows_that_are_not_allowed(ends):
    with pytest.raises(ValueError, match="it must be 0 <= start_orbits < end_orbits <= 100"):
        Recontact(*ends)


def test_arguments_that_are_not_allowed():
    escape = Orbit([7e6, 0.0, 0.0], [0.0, 1.2e4, 0.0])
    with pytest.raises(ValueError, match="not closed"):
        closest_approaches([np.zeros(20)], [0.0], [MASSES], escape)
    with pytest.raises(ValueError, match=r"the orbit has the eccentricity 0.95; it must be at most 0.9"):
        closest_approaches([np.zeros(20)], [0.0], [MASSES], Orbit.from_elements(2e8, 0.95, 0.1, 0.2, 0.3, 0.4))
    with pytest.raises(ValueError, match=re.escape("masses has shape (2, 2); it must be (1, 2)")):
        closest_approaches([np.zeros(20)], [0.0], [MASSES, MASSES], CIRCULAR)
    with pytest.raises(ValueError, match=r"times = \[-1.0\] s; they must be finite and not negative"):
        coast(np.zeros(20), 0.0, MASSES, CIRCULAR, [-1.0])
