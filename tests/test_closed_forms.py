"""Answers that are known without the simulator: closed forms, quadratures and other solvers.

The reference means (four springs of 5500 N/m, 40 mm, 30 mm on a ring of 300 mm; 100 kg on 1200 kg) unless said.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, minimize_scalar
from separation_cases import BOX, SQUARE, general_separation, symmetric_separation

from satsep_ot.dynamics.invariants import angular_momentum, kinetic_energy
from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.relative_orbit import Recontact
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.separation import Body, Pivot, Separation, Springs, umbilical
from satsep_ot.dynamics.simulation import inertial_motion, simulate, trajectory
from satsep_ot.dynamics.springs import ForceLine

INVERSE_MASS = 1.0 / 1200.0 + 1.0 / 100.0
STROKES = np.linspace(0.0, 0.03, 7)
MEASURED = np.stack([STROKES, [221.0, 204.0, 171.0, 150.0, 113.0, 88.0, 51.0]], axis=1)  # N, of no formula


def off_centre_rate(compression, offset):
    """Rate of a satellite whose CG is `offset` beside the axis, from springs that let go at their relaxed length.

    The platform is heavy, the CG lies in the plane of the plate, the rods slide on it. Returns the simulated rate
    [rad/s], the closed form at Omega t = pi / 2, and the solution of the linear equations with the lateral drift.
    """
    stiffness, radius, inertia, mass = 5500.0, 0.3, 9.35, 100.0
    separation = Separation(
        Body(1e12, [1e12] * 3),
        Body(mass, [inertia, 8.0, inertia], [offset, 0.0, 0.0]),
        Springs(SQUARE, radius, stiffness, compression, compression),
        ForceLine.NORMAL,
    )
    outcome = simulate(separation, tolerance=1e-12)
    total, time = 4.0 * stiffness, outcome.release_times.mean()
    push, swing = np.sqrt(total / mass), np.sqrt(total * radius**2 / (2.0 * inertia))
    size = total * compression * offset / inertia
    form = size * (push - swing * np.sin(swing * np.pi / (2.0 * push))) / (push**2 - swing**2)

    def slope(t, x):
        angle, rate, drift, velocity = x
        force = total * compression * np.cos(push * t)
        turn = -total * radius**2 / 2.0 * angle + (offset + drift) * force
        return [rate, turn / inertia, velocity, angle * force / mass]

    linear = solve_ivp(slope, (0.0, time), np.zeros(4), method="DOP853", rtol=1e-12, atol=1e-18).y[1, -1]
    return -outcome.quantity("rate_z")[0] * np.pi / 180.0, form, linear


def test_off_centre_push_on_a_sliding_foot():
    """omega = A (Omega sin Omega t - w_t sin w_t t) / (Omega^2 - w_t^2), w_t^2 = N K R^2 / (2 I), A = N K xi e / I.

    1.34919 deg/s at e = 5 mm, xi = L = 40 mm. The form leaves out that the foot pushes along the plate's normal: the
    tilted plate is driven sideways, and the arm e grows. That part is in proportion to m xi^2 / I: 3e-4 of the rate at
    xi = 40 mm, less than 2e-5 at xi = 5 mm; and the linear equations that hold it agree at every xi.
    """
    rate, form, _ = off_centre_rate(0.04, 5e-3)
    assert np.degrees(form) == pytest.approx(1.34919, rel=1e-5)
    assert rate == pytest.approx(form, rel=4e-4)
    assert rate != pytest.approx(form, rel=2e-4)
    rate, form, _ = off_centre_rate(0.005, 5e-5)
    assert rate == pytest.approx(form, rel=2e-5)
    for compression in (0.005, 0.04):
        rate, _, linear = off_centre_rate(compression, 5e-5)
        assert rate == pytest.approx(linear, rel=5e-6)


def test_torque_free_axisymmetric_body():
    """The transverse rate turns in the body at (I_a - I_t) / I_t w_a (Euler), the axial rate is constant."""
    separation = symmetric_separation(
        rates=[0.3, 1.0, -0.2], satellite=Body(100.0, [9.35, 12.0, 9.35], [0.0, 0.4, 0.0])
    )
    path = trajectory(separation, [0.2, 1.0, 5.0, 20.0], tolerance=1e-12)
    x, y, z = path.states[:, 9:12].T
    precession = (12.0 - 9.35) / 9.35 * y[0]
    expected = (x[0] + 1j * z[0]) * np.exp(-1j * precession * (path.times - path.times[0]))
    np.testing.assert_allclose(y, y[0], rtol=1e-9)
    np.testing.assert_allclose(x + 1j * z, expected, atol=1e-9)


def test_a_push_along_the_track_opens_distance():
    """Hill: 3 T dv = 10,218.6 m after one orbit at a = 6878.137 km and 0.6 m/s; two nonlinear orbits: 10,221.8 m."""
    axis = 6878137.0
    orbit = Orbit([axis, 0.0, 0.0], [0.0, np.sqrt(3.986004418e14 / axis), 0.0])
    # 18 J on 100 kg beside a heavy platform.
    separation = symmetric_separation(
        platform=Body(1e12, [1e12] * 3), satellite=Body(100.0, [9.35, 8.0, 9.35]), orbit=orbit, pivot=Pivot.PLATFORM,
        springs=Springs(SQUARE, 0.3, 6000.0, 0.04, 0.03), recontact=Recontact(1.0 - 1e-9, 1.0),
    )  # fmt: skip
    outcome = simulate(separation)
    assert outcome.quantity("axial_velocity")[0] == pytest.approx(0.6, rel=1e-6)
    distance = outcome.quantity("recontact_distance")[0]
    assert 3.0 * orbit.period * 0.6 == pytest.approx(10218.6, abs=0.1)
    assert distance == pytest.approx(3.0 * orbit.period * 0.6, rel=1e-3)
    assert distance == pytest.approx(10221.8, abs=0.1)


def test_smallest_distance_against_two_orbits_by_scipy():
    """Both bodies' Kepler problems, r'' = -mu r / r^3, integrated apart, and a scalar minimisation."""
    window = Recontact(0.05, 1.2)
    separation = general_separation(recontact=window)
    outcome = simulate(separation, tolerance=1e-12)
    velocity, distance = inertial_motion(outcome.base[:, :20])
    released, mu, masses = outcome.base[0, 20], separation.orbit.mu, np.array([1200.0, 100.0])

    def flight(start, times):
        return solve_ivp(
            lambda t, x: [*x[3:], *(-mu * x[:3] / np.linalg.norm(x[:3]) ** 3)], (0.0, times[-1]), start,
            method="DOP853", rtol=1e-13, atol=1e-6, t_eval=times, dense_output=True,
        )  # fmt: skip

    # The common CG: on its orbit until the release.
    period = separation.orbit.period
    centre = flight([*separation.orbit.position, *separation.orbit.velocity], [released]).y[:, -1]
    shares = np.array([-masses[1], masses[0]]) / masses.sum()
    times = np.linspace(window.start_orbits * period, window.end_orbits * period, 2000)
    platform, satellite = (flight(centre + share * np.array([*distance[0], *velocity[0]]), times) for share in shares)

    def apart(t):
        return np.linalg.norm(satellite.sol(t)[:3] - platform.sol(t)[:3])

    distances = np.linalg.norm(satellite.y[:3] - platform.y[:3], axis=0)
    i = np.clip(np.argmin(distances), 1, len(times) - 2)
    smallest = min(
        minimize_scalar(apart, bounds=(times[i - 1], times[i + 1]), method="bounded").fun, distances[0], distances[-1]
    )
    assert outcome.quantity("recontact_distance")[0] == pytest.approx(smallest, rel=1e-6)


def of_table(table, **changes):
    """Four springs with the same table."""
    springs = Springs(SQUARE, 0.3, 0.0, 0.0, 0.03, tables=[table] * 4)
    return symmetric_separation(springs=springs, **changes)


def test_a_table_that_samples_a_linear_spring_is_that_spring():
    """Force K (xi - s) at eleven strokes: the monotone cubics of collinear points are the line."""
    strokes = np.linspace(0.0, 0.03, 11)
    table = np.stack([strokes, 5500.0 * (0.04 - strokes)], axis=1)
    for offset in (0.0, 0.004):
        satellite = Body(100.0, [9.35, 8.0, 9.35], [offset, 0.4, -0.5 * offset])
        linear = simulate(symmetric_separation(satellite=satellite), tolerance=1e-12)
        measured = simulate(of_table(table, satellite=satellite), tolerance=1e-12)
        np.testing.assert_allclose(measured.base, linear.base, rtol=0, atol=1e-12)
        np.testing.assert_allclose(measured.release_times, linear.release_times, rtol=1e-12)


def test_work_and_time_of_a_table():
    """v^2 = 2 W(s) (1/m_1 + 1/m_2), t = integral of ds / v, with W the integral of the monotone cubics of the table."""
    work = PchipInterpolator(*MEASURED.T).antiderivative()
    outcome = simulate(of_table(MEASURED), tolerance=1e-12)

    def speed(s):
        return np.sqrt(8.0 * (work(s) - work(0.0)) * INVERSE_MASS)

    assert outcome.quantity("axial_velocity")[0] == pytest.approx(speed(0.03), rel=1e-11)
    # s = z^2 takes the singularity at the start out.
    knots = np.sqrt(STROKES)
    pieces = [quad(lambda z: 2.0 * z / speed(z * z), a, b, epsabs=0.0, epsrel=1e-12)[0] for a, b in pairwise(knots)]
    np.testing.assert_allclose(outcome.release_times[0], sum(pieces), rtol=1e-10)


@pytest.mark.parametrize("force_line", ForceLine)
def test_pins_take_their_friction_times_their_engagement(force_line):
    """Kinetic energy = sum K L (xi - L / 2) - F e, wherever the connector sits and however the bodies turn."""
    connector = umbilical(0.4, 0.22, 1500.0, 0.008, 0.0075, friction=18.0, engagement=0.006)
    separation = symmetric_separation(
        springs=symmetric_separation().springs.joined(connector), force_line=force_line,
        stowed_length=0.04 if force_line == ForceLine.STRUT else 0.0,
    )  # fmt: skip
    end = trajectory(separation, [], tolerance=1e-12).last_release
    expected = 16.5 + 1500.0 * 0.0075 * (0.008 - 0.5 * 0.0075) - 18.0 * 0.006
    assert kinetic_energy(separation, end[None])[0] == pytest.approx(expected, rel=1e-10)


def test_an_umbilical_turns_the_satellite_by_the_moment_of_its_impulse():
    """I omega = r x J, J = integral of K_u (xi_u - y) - F over the connector's pieces of harmonic motion of the push.

    A satellite so hard to turn that the push itself is a straight line.
    """
    mass, inertia, angle, radius = 100.0, 1e7, 0.7, 0.25
    stiffness, deformation, stroke, friction, engagement = 2000.0, 0.008, 0.006, 15.0, 0.005
    connector = umbilical(angle, radius, stiffness, deformation, stroke, friction, engagement)
    separation = symmetric_separation(
        platform=Body(1e13, [1e13] * 3), satellite=Body(mass, [inertia] * 3),
        springs=symmetric_separation().springs.joined(connector),
    )  # fmt: skip
    outcome = simulate(separation, tolerance=1e-13)
    y, v, t, impulse = 0.0, 0.0, 0.0, 0.0
    for end, hold in ((engagement, friction), (stroke, 0.0)):
        total = 4.0 * 5500.0 + stiffness
        frequency = np.sqrt(total / mass)
        rest = (4.0 * 5500.0 * 0.04 + stiffness * deformation - hold) / total

        def gap(s, y=y, v=v, frequency=frequency, rest=rest, end=end):
            return rest + (y - rest) * np.cos(frequency * s) + v / frequency * np.sin(frequency * s) - end

        time = brentq(gap, 0.0, 0.5 * np.pi / frequency, xtol=1e-16)
        sine, cosine = np.sin(frequency * time), np.cos(frequency * time)
        area = rest * time + (y - rest) * sine / frequency + v * (1.0 - cosine) / frequency**2
        impulse += (stiffness * deformation - hold) * time - stiffness * area
        y, v, t = end, v * cosine - (y - rest) * frequency * sine, t + time
        assert outcome.release_times[0, 5 if hold else 4] == pytest.approx(t, rel=1e-9)
    # r x J y, r = radius (cos, 0, sin).
    expected = radius * impulse / inertia * np.array([-np.sin(angle), 0.0, np.cos(angle)])
    np.testing.assert_allclose(outcome.base[0, 9:12], expected, atol=1e-6 * np.linalg.norm(expected))


def test_friction_in_the_guides_takes_the_work_of_its_force():
    """Loss = integral of mu N |n_1 x n_2| ds/dt, with N = f / (n_1 . n_2 + mu |n_1 x n_2|) on rods in their guides.

    Gauss quadrature in time, with forces and velocities from the states by vector algebra.
    """
    friction = 0.3
    separation = symmetric_separation(
        satellite=Body(100.0, [9.35, 8.0, 9.35], [0.02, 0.4, -0.01]), force_line=ForceLine.NORMAL,
        guide_friction=friction, rates=[0.05, 0.2, -0.1],
    )  # fmt: skip
    springs = separation.springs
    outcome = simulate(separation, tolerance=1e-12)
    events = np.unique([0.0, *outcome.release_times[0]])
    nodes, weights = np.polynomial.legendre.leggauss(16)
    times = np.concatenate([0.5 * (a + b) + 0.5 * (b - a) * nodes for a, b in pairwise(events)])
    weights = np.concatenate([0.5 * (b - a) * weights for a, b in pairwise(events)])
    states = trajectory(separation, times, tolerance=1e-12).states
    loss, up = 0.0, np.array([0.0, 1.0, 0.0])
    for time, weight, state in zip(times, weights, states, strict=True):
        turn, d, w, omega = rotation_matrix(state[12:16]), state[0:3], state[3:6], state[6:9]
        plate, spin = turn[:, 1], turn @ state[9:12]
        for i in np.flatnonzero(time < outcome.release_times[0]):
            seat = springs.radius[i] * np.array([np.cos(springs.angle[i]), 0.0, np.sin(springs.angle[i])])
            foot = seat - separation.platform.center_of_mass
            delta = d + turn @ (seat - separation.satellite.center_of_mass) - foot
            cosine, sine = plate @ up, np.linalg.norm(np.cross(plate, up))
            stroke = delta @ plate / cosine
            contact = foot + stroke * up
            # The plate's velocity past the contact point, along its normal: the foot stays on the plate.
            speed = (w + np.cross(spin, contact - d) - np.cross(omega, contact)) @ plate / cosine
            normal = springs.stiffness[i] * (springs.deformation[i] - stroke) / (cosine + friction * sine)
            loss += weight * friction * normal * sine * speed
    end = trajectory(separation, [0.0], tolerance=1e-12)
    gain = np.diff(kinetic_energy(separation, np.array([end.states[0], end.last_release])))[0]
    assert loss > 1e-2
    assert 16.5 - gain == pytest.approx(loss, rel=1e-8)


@pytest.mark.parametrize("force_line", ForceLine)
def test_an_impulse_changes_momenta_by_itself(force_line):
    """Delta p and Delta h at the ring centre on the satellite, the opposite on the platform: both jumps exactly."""
    p, h = np.array([0.4, -1.1, 0.7]), np.array([0.02, -0.03, 0.05])
    separation = general_separation(force_line, impulse=p, angular_impulse=h)
    after = trajectory(separation, [0.0]).states[0]
    before = trajectory(replace(separation, impulse=[0.0] * 3, angular_impulse=[0.0] * 3), [0.0]).states[0]
    turn = rotation_matrix(before[12:16])
    np.testing.assert_allclose(after[3:6] - before[3:6], INVERSE_MASS * p, rtol=1e-13)
    np.testing.assert_array_equal(after[[0, 1, 2, *range(12, 20)]], before[[0, 1, 2, *range(12, 20)]])
    # Arms from the CGs to the satellite's ring centre.
    arm_2 = -turn @ separation.satellite.center_of_mass
    arm_1 = before[0:3] + arm_2
    spin_2 = turn @ separation.satellite.inertia @ (after[9:12] - before[9:12])
    np.testing.assert_allclose(spin_2, h + np.cross(arm_2, p), atol=1e-14)
    spin_1 = separation.platform.inertia @ (after[6:9] - before[6:9])
    np.testing.assert_allclose(spin_1, -h - np.cross(arm_1, p), atol=1e-12)
    momenta = angular_momentum(separation, np.array([before, after]))
    np.testing.assert_allclose(momenta[1], momenta[0], atol=1e-13 * np.linalg.norm(momenta[0]))


@pytest.mark.parametrize("force_line", ForceLine)
def test_a_spring_that_has_failed_is_as_if_it_were_not_there(force_line):
    full = general_separation(force_line)
    springs = full.springs
    failed = replace(full, springs=replace(springs, scale=[1.0, 1.0, 0.0, 1.0]))
    kept = [0, 1, 3]
    values = {
        key: getattr(springs, key)[kept]
        for key in ("angle", "radius", "stiffness", "deformation", "stroke", "cant", "delay")
    }
    without = simulate(replace(full, springs=Springs(**values)), tolerance=1e-12)
    outcome = simulate(failed, tolerance=1e-12)
    np.testing.assert_allclose(outcome.base, without.base, rtol=1e-10, atol=1e-11)
    np.testing.assert_allclose(outcome.release_times[0, kept], without.release_times[0], rtol=1e-11)
    assert np.isnan(outcome.release_times[0, 2])


def test_a_straight_way_along_plane_walls():
    """Clearance of a point on a line: n . r - h is linear in the way, so it is smallest at the start or at the exit."""
    walls = np.array([[-1.0, -0.2, 0.0, -0.42], [0.0, 0.3, 1.0, -0.37], [1.0, 0.1, 1.0, -0.6]])
    separation = symmetric_separation(envelope=BOX, recess_depth=0.25, recess_planes=walls)
    outcome = simulate(separation)
    unit = walls / np.linalg.norm(walls[:, :3], axis=1, keepdims=True)
    inside = BOX[BOX[:, 1] < 0.25]
    ends = inside + np.array([0.0, 0.25, 0.0])
    at_exit = (ends @ unit[:, :3].T - unit[:, 3]).min(axis=1)
    smallest = min((inside @ unit[:, :3].T - unit[:, 3]).min(), at_exit.min())
    assert outcome.quantity("clearance")[0] == pytest.approx(1e3 * smallest, abs=1e-6)
    for i, expected in enumerate(at_exit, start=1):
        assert outcome.quantity(f"exit_clearance_{i}")[0] == pytest.approx(1e3 * expected, abs=1e-6)


def test_a_corner_that_swings_past_a_wall():
    """A spinning satellite: a point at the radius r is nearest to a wall at the distance h when it faces it, h - r.

    The smallest clearance lies inside the stay, neither at its start nor at the exit.
    """
    start = np.radians([20.0, -20.0])
    points = 0.3 * np.stack([np.cos(start), [0.0, 0.0], np.sin(start)], axis=1)
    separation = symmetric_separation(
        envelope=points, recess_depth=0.25, recess_planes=[[-1.0, 0.0, 0.0, -0.4]], angular_impulse=[0.0, 9.0, 0.0]
    )
    outcome = simulate(separation)
    rate = 9.0 * (1.0 / 8.0 + 1.0 / 600.0)
    assert outcome.quantity("rate_y")[0] == pytest.approx(np.degrees(9.0 / 8.0), rel=1e-9)
    assert outcome.quantity("clearance")[0] == pytest.approx(100.0, abs=1e-3)
    # 0.25 m: the push, and the rest of the way at its final speed.
    release, speed = outcome.release_times[0, 0], outcome.quantity("axial_velocity")[0]
    angle = start - rate * (release + (0.25 - 0.03) / speed)
    for i, expected in enumerate(400.0 - 300.0 * np.cos(angle), start=1):
        assert outcome.quantity(f"exit_clearance_{i}")[0] == pytest.approx(expected, abs=1e-3)
