"""Print how far simulations are from closed forms and conservation laws (a few seconds).

PYTHONPATH=tests python tests/benchmarks/closed_forms.py
"""

import platform
from dataclasses import replace

import numpy as np
from separation_cases import general_separation, symmetric_separation
from test_relative_orbit import CIRCULAR, MASSES, kepler, random_releases, release
from test_rotations import equation_7
from test_simulation import angular_momentum, kinetic_energy

import satsep_ot
from satsep_ot.dynamics.relative_orbit import coast
from satsep_ot.dynamics.rotations import quaternion_from_euler_angles, quaternion_from_rotation_vector, rotation_matrix
from satsep_ot.dynamics.separation import Body, ForceLine
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients, trajectory

ENERGY, INVERSE_MASS, STIFFNESS = 16.5, 1.0 / 1200.0 + 1.0 / 100.0, 22000.0


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
    springs = replace(general_separation().springs, delay=0.0)
    for force_line in ForceLine:
        separation = general_separation(
            force_line, orbit=None, gradient_torque=False, springs=springs, mounting_error=[0.0, 0.0, 0.0]
        )
        states = trajectory(separation, [0.0, 0.04, 0.3], tolerance=1e-12).states
        momenta = [angular_momentum(separation, state) for state in states]
        name = force_line.name.lower()
        change = max(np.linalg.norm(momentum - momenta[0]) for momentum in momenta[1:])
        yield f"angular momentum, {name}", change / np.linalg.norm(momenta[0])
        work = np.sum(springs.stiffness * springs.stroke * (springs.deformation - 0.5 * springs.stroke))
        gain = kinetic_energy(separation, states[-1]) - kinetic_energy(separation, states[0])
        yield f"kinetic energy against spring work, {name}", abs(gain / work - 1.0)


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
    for part in (axial_push, conservation, rotations, gradient, coast_after_release):
        for what, error in part():
            print(f"{what:48}{error:10.1e}")
