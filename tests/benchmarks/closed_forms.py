"""Print how far simulations are from closed forms and conservation laws (a few seconds).

PYTHONPATH=tests python tests/benchmarks/closed_forms.py
"""

import platform

import numpy as np
from scipy.interpolate import PchipInterpolator
from separation_cases import SQUARE, general_separation, mixed_springs, symmetric_separation
from test_closed_forms import INVERSE_MASS, MEASURED, of_table, off_centre_rate
from test_conservation import random_separation
from test_relative_orbit import CIRCULAR, MASSES, kepler, random_releases, release
from test_rotations import equation_7

import satsep_ot
from satsep_ot.dynamics.invariants import (
    angular_momentum,
    guide_loss,
    kinetic_energy,
    push_starts,
    spring_strokes,
    spring_work,
)
from satsep_ot.dynamics.relative_orbit import coast
from satsep_ot.dynamics.rotations import quaternion_from_euler_angles, quaternion_from_rotation_vector, rotation_matrix
from satsep_ot.dynamics.separation import Body, ForceLine, Springs, umbilical
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients, trajectory

ENERGY, STIFFNESS = 16.5, 22000.0


def axial_push():
    """v = sqrt(2 E / mu_r), t = arccos(1 - L / xi) / Omega, at the default tolerance."""
    outcome = simulate(symmetric_separation())
    velocity = np.sqrt(2.0 * ENERGY * INVERSE_MASS)
    time = np.arccos(1.0 - 0.03 / 0.04) / np.sqrt(STIFFNESS * INVERSE_MASS)
    print(f"axial push: v = {velocity:.6f} m/s, t = {1e3 * time:.3f} ms")
    yield "velocity of the axial push", abs(outcome.quantity("axial_velocity")[0] / velocity - 1.0)
    yield "release time of the axial push", np.abs(outcome.release_times[0] / time - 1.0).max()
    yield "rates of the symmetric separation [rad/s]", np.abs(outcome.base[0, 6:12]).max()


def conservation():
    """Angular momentum and energy of a separation in which nothing is symmetric, at tolerance 1e-12."""
    for force_line in ForceLine:
        name = force_line.name.lower()
        for kind, springs in (("", general_separation().springs), (", mixed springs", mixed_springs())):
            separation = general_separation(force_line, orbit=None, gradient_torque=False, springs=springs)
            energy, momentum = account(separation)
            rubbing = " with friction" if separation.guide_friction else ""
            yield f"angular momentum, {name}{kind}", momentum
            yield f"kinetic energy against work, {name}{rubbing}{kind}", energy
        accounts = [account(separation) for separation in (random_separation(seed, force_line) for seed in range(100))]
        energy, momentum = np.nanmax(accounts, axis=0)
        yield f"angular momentum, {name}, 100 random cases", momentum
        yield f"kinetic energy against work, {name}, 100 random cases", energy


def account(separation):
    """Relative errors of energy and angular momentum; NaN for a run that does not finish."""
    releases = trajectory(separation, [], tolerance=1e-12).release_times
    starts, works = push_starts(separation), separation.springs.scale > 0.0
    if not np.isfinite(releases[works]).all():
        return np.nan, np.nan
    times = np.unique([0.0, *starts[works], *releases[works]])
    states = trajectory(separation, times, tolerance=1e-12).states
    strokes = spring_strokes(separation, states)
    start, end = (
        [strokes[np.searchsorted(times, time) if time > 0.0 else 0, i] for i, time in enumerate(instants)]
        for instants in (starts, releases)
    )
    work = (spring_work(separation, start, end) - guide_loss(separation, releases, tolerance=1e-12)).sum()
    energy, momentum = kinetic_energy(separation, states), angular_momentum(separation, states)
    spin = np.linalg.norm(states[:, 9:12] @ separation.satellite.inertia, axis=1).max()
    change = np.linalg.norm(momentum - momentum[0], axis=1).max()
    gain = energy[-1] - energy[0]
    return abs(gain - work) / (abs(work) + energy[0]), change / (spin + np.linalg.norm(momentum[0]))


def effects():
    """A sliding foot, a torque-free body, tables, pins: see tests/test_closed_forms.py."""
    for compression, offset in ((0.04, 5e-3), (0.005, 5e-5)):
        rate, form, linear = off_centre_rate(compression, offset)
        where = f"xi = {1e3 * compression:g} mm, e = {1e3 * offset:g} mm"
        yield f"sliding foot, {where}", abs(rate / form - 1.0)
        yield f"the same with the lateral drift, {where}", abs(rate / linear - 1.0)
    separation = symmetric_separation(
        rates=[0.3, 1.0, -0.2], satellite=Body(100.0, [9.35, 12.0, 9.35], [0.0, 0.4, 0.0])
    )
    path = trajectory(separation, [0.2, 20.0], tolerance=1e-12)
    x, y, z = path.states[:, 9:12].T
    turned = (x[0] + 1j * z[0]) * np.exp(-1j * (12.0 - 9.35) / 9.35 * y[0] * 19.8)
    yield "torque-free axisymmetric body, 20 s [rad/s]", abs(x[1] + 1j * z[1] - turned)
    table = np.stack([MEASURED[:, 0], 5500.0 * (0.04 - MEASURED[:, 0])], axis=1)
    linear, sampled = (simulate(case, tolerance=1e-12).base for case in (symmetric_separation(), of_table(table)))
    yield "table of a linear spring against the spring", np.abs(sampled[0, 3:6] - linear[0, 3:6]).max()
    work = 4.0 * PchipInterpolator(*MEASURED.T).integrate(0.0, 0.03)
    velocity = simulate(of_table(MEASURED), tolerance=1e-12).quantity("axial_velocity")[0]
    yield "velocity of a measured table", abs(velocity / np.sqrt(2.0 * work * INVERSE_MASS) - 1.0)
    connector = umbilical(0.4, 0.22, 1500.0, 0.008, 0.0075, friction=18.0, engagement=0.006)
    separation = symmetric_separation(springs=Springs(SQUARE, 0.3, 5500.0, 0.04, 0.03).joined(connector))
    expected = ENERGY + 1500.0 * 0.0075 * (0.008 - 0.5 * 0.0075) - 18.0 * 0.006
    end = trajectory(separation, [], tolerance=1e-12).last_release
    yield "energy less the friction of pins", abs(kinetic_energy(separation, end[None])[0] / expected - 1.0)


def rotations():
    """Equation 7 for random angles; a spin through pitch = 90 deg, where Euler angles are singular."""
    worst = 0.0
    for angles in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 3)):
        matrix = rotation_matrix(quaternion_from_euler_angles(*angles))
        worst = max(worst, np.abs(matrix - equation_7(*angles).T).max())
    yield "quaternion against equation 7", worst
    rate = np.radians(100.0)
    separation = symmetric_separation(
        platform=Body(1200.0, [1500.0, 600.0, 1500.0]), satellite=Body(100.0, [9.35, 8.0, 9.35]), rates=[0.0, rate, 0.0]
    )
    path = trajectory(separation, [0.9, 1.8], tolerance=1e-12)
    turns = [np.array(quaternion_from_rotation_vector(0.0, rate * time, 0.0)) for time in path.times]
    yield "spin through pitch 90 deg", np.abs(path.states[:, 16:20] - turns).max()


def gradient():
    """d(v)/d(K), d(xi), d(L) and masses of the axial push by calculus, with the force jump at release (xi > L)."""
    separation = symmetric_separation()
    outcome = simulate_with_gradients(separation, quantities=["axial_velocity"])
    found = dict(zip(separation.parameter_names(), outcome.quantity_gradient("axial_velocity")[0], strict=True))
    velocity = np.sqrt(2.0 * ENERGY * INVERSE_MASS)
    expected = {
        "springs[0].stiffness": INVERSE_MASS * 0.03 * 0.025 / velocity,
        "springs[0].deformation": INVERSE_MASS * 5500.0 * 0.03 / velocity,
        "springs[0].stroke": INVERSE_MASS * 5500.0 * 0.01 / velocity,
        "satellite.mass": -ENERGY / (100.0**2 * velocity),
        "platform.mass": -ENERGY / (1200.0**2 * velocity),
    }
    yield "gradient of the axial push", max(abs(found[name] / value - 1.0) for name, value in expected.items())


def coast_after_release():
    """One revolution, Hill's equations for 0.6 m/s along the track, and Kepler's for both bodies."""
    period, still = CIRCULAR.period, release([0.0] * 3, [0.0] * 3)
    end = coast(still, 0.0, MASSES, CIRCULAR, [period])[0]
    yield "one revolution of the orbit [m]", np.linalg.norm(end[:3] - CIRCULAR.position)
    pushed = coast(release([0.0] * 3, [0.0, 0.6, 0.0]), 0.0, [1e12, 1.0], CIRCULAR, [period])[0]
    linear, distance = 3.0 * period * 0.6, np.linalg.norm(pushed[3:6])
    print(f"one orbit after 0.6 m/s along the track: {linear:.1f} m by Hill, {distance:.1f} m here")
    yield "distance after one orbit against Hill", abs(distance / linear - 1.0)
    worst, times = 0.0, np.linspace(0.0, period, 20)
    for state in random_releases(5):
        turn = rotation_matrix(state[16:20])
        platform, satellite = (
            kepler(CIRCULAR.position + share * turn @ state[:3], CIRCULAR.velocity + share * turn @ state[3:6], times)
            for share in (-np.longdouble(100.0) / 1300, np.longdouble(1200.0) / 1300)
        )
        difference = coast(state, 0.0, MASSES, CIRCULAR, times)[:, 3:6] - (satellite - platform)
        size = np.linalg.norm((satellite - platform).astype(float), axis=1).max()
        worst = max(worst, np.linalg.norm(difference.astype(float), axis=1).max() / size)
    yield "two bodies against Kepler, extended precision", worst


if __name__ == "__main__":
    print("PYTHONPATH=tests python tests/benchmarks/closed_forms.py")
    print(f"satsep-ot {satsep_ot.__version__}, numpy {np.__version__}, Python {platform.python_version()}")
    for part in (axial_push, conservation, effects, rotations, gradient, coast_after_release):
        for what, error in part():
            print(f"{what:64}{error:10.1e}")
