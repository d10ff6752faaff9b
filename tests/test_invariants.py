"""Energy and angular momentum, against sums over both bodies and the laws that they obey."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from separation_cases import general_separation, mixed_springs

from satsep_ot.dynamics.invariants import angular_momentum, kinetic_energy, spring_strokes, spring_work
from satsep_ot.dynamics.rotations import quaternion_product, rotation_matrix
from satsep_ot.dynamics.separation import Body, Separation, Springs
from satsep_ot.dynamics.simulation import trajectory
from satsep_ot.dynamics.springs import ForceLaw, ForceLine


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None, derandomize=True)
def test_against_the_sum_over_two_bodies_in_inertial_axes(seed):
    """Each body's own mass, velocity and spin, as the definitions say, for a state that means nothing."""
    rng = np.random.default_rng(seed)
    separation, states = general_separation(), rng.standard_normal((3, 20))
    for quaternion in (states[:, 12:16], states[:, 16:20]):
        quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    energy, momentum = kinetic_energy(separation, states), angular_momentum(separation, states)
    total = separation.platform.mass + separation.satellite.mass
    for i, x in enumerate(states):
        turn = rotation_matrix(x[16:20])
        d, w = turn @ x[0:3], turn @ x[3:6]
        expected_energy, expected_momentum = 0.0, np.zeros(3)
        for body, share, rates, quaternion in (
            (separation.platform, -separation.satellite.mass / total, x[6:9], x[16:20]),
            (separation.satellite, separation.platform.mass / total, x[9:12], quaternion_product(x[16:20], x[12:16])),
        ):
            axes = rotation_matrix(quaternion)
            inertia, omega = axes @ body.inertia @ axes.T, axes @ rates
            expected_energy += 0.5 * body.mass * (share * w) @ (share * w) + 0.5 * omega @ inertia @ omega
            expected_momentum += body.mass * np.cross(share * d, share * w) + inertia @ omega
        assert energy[i] == pytest.approx(expected_energy, rel=1e-13)
        np.testing.assert_allclose(momentum[i], expected_momentum, atol=1e-12 * np.linalg.norm(expected_momentum))


@pytest.mark.parametrize("force_line", ForceLine)
def test_springs_keep_the_angular_momentum_and_the_coast_the_energy(force_line):
    separation = general_separation(force_line, orbit=None, gradient_torque=False)
    path = trajectory(separation, np.linspace(0.0, 3.0, 40), tolerance=1e-12)
    momentum = angular_momentum(separation, path.states)
    np.testing.assert_allclose(momentum, momentum[:1].repeat(40, axis=0), atol=1e-10 * np.linalg.norm(momentum[0]))
    free = kinetic_energy(separation, path.states)[path.times > path.release_times.max()]
    assert free.size > 20
    np.testing.assert_allclose(free, free[0], rtol=1e-11)


def test_a_single_off_centre_spring():
    """All its energy, K L (xi - L / 2), is in the motion, whatever share of it turns the satellite."""
    separation = Separation(
        Body(50.0, [10.0, 12.0, 9.0]),
        Body(20.0, [1.0, 1.2, 0.9], [0.02, 0.3, -0.05]),
        Springs(0.7, 0.2, 4e3, 0.05, 0.04),
    )
    energy = kinetic_energy(separation, trajectory(separation, [0.0, 0.3], tolerance=1e-12).states)
    assert energy[1] - energy[0] == pytest.approx(4e3 * 0.04 * 0.03, rel=1e-9)


@pytest.mark.parametrize("force_line", ForceLine)
@pytest.mark.parametrize("springs", ["linear", "mixed"])
def test_the_energy_gained_is_the_work_of_the_springs(force_line, springs):
    """With delays, cants, a mounting error and an impulse; tables, the friction of a connector and a failed spring."""
    changes = {} if springs == "linear" else {"springs": mixed_springs()}
    separation = general_separation(force_line, orbit=None, gradient_torque=False, guide_friction=0.0, **changes)
    releases = trajectory(separation, [], tolerance=1e-12).release_times
    pushing = separation.springs.scale > 0.0
    times = np.unique([0.0, *separation.springs.delay, *releases[pushing]])
    states = trajectory(separation, times, tolerance=1e-12).states
    strokes = spring_strokes(separation, states)
    start, end = (
        np.array([strokes[np.searchsorted(times, t if push else 0.0), i] for i, (t, push) in enumerate(pairs)])
        for pairs in (zip(instants, pushing, strict=True) for instants in (separation.springs.delay, releases))
    )
    stroke, linear = separation.springs.stroke, separation.springs.laws == ForceLaw.LINEAR
    stroke = np.where(linear, np.minimum(stroke, separation.springs.deformation), stroke)
    np.testing.assert_allclose(end[pushing], stroke[pushing], rtol=1e-9)
    energy = kinetic_energy(separation, states)
    work = spring_work(separation, start, end)
    assert (work[~pushing] == 0.0).all()
    assert energy[-1] - energy[0] == pytest.approx(work.sum(), rel=1e-10)
