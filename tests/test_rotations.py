import numpy as np
import pytest
from separation_cases import symmetric_separation

from satsep_ot.dynamics.rotations import (
    euler_angles,
    quaternion_from_euler_angles,
    quaternion_from_matrix,
    quaternion_from_rotation_vector,
    quaternion_product,
    rotation_matrix,
)
from satsep_ot.dynamics.separation import Body
from satsep_ot.dynamics.simulation import trajectory


def equation_7(phi, theta, psi):
    """T_LB of Hu et al. (2017), equation 7, with the "+" that its (2, 2) entry lost in print."""
    sf, cf, st, ct, sp, cp = np.sin(phi), np.cos(phi), np.sin(theta), np.cos(theta), np.sin(psi), np.cos(psi)
    return np.array(
        [
            [ct * cp, ct * sp, -st],
            [sf * st * cp - cf * sp, sf * st * sp + cf * cp, sf * ct],
            [cf * st * cp + sf * sp, cf * st * sp - sf * cp, cf * ct],
        ]
    )


def test_quaternion_agrees_with_equation_7():
    for phi, theta, psi in np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 3)):
        matrix = rotation_matrix(quaternion_from_euler_angles(phi, theta, psi))
        np.testing.assert_allclose(matrix, equation_7(phi, theta, psi).T, atol=1e-12)


def test_quaternion_from_matrix_is_the_inverse_of_rotation_matrix():
    random = np.random.default_rng(1).standard_normal((200, 4))
    # Half turns, where the scalar part is 0, and turns close to them.
    special = np.concatenate([np.eye(4), np.eye(4) + 1e-9, [[0.0, 0.6, 0.8, 0.0], [1e-12, 0.6, 0.0, -0.8]]])
    for quaternion in np.concatenate([random, special]):
        quaternion = quaternion / np.linalg.norm(quaternion)
        again = quaternion_from_matrix(rotation_matrix(quaternion))
        np.testing.assert_allclose(again * np.sign(again @ quaternion), quaternion, atol=1e-14)


def test_euler_angles_return_also_at_the_singularity():
    for phi, theta, psi in [(0.3, -0.7, 2.0), (0.1, np.pi / 2, 0.4), (-0.2, -np.pi / 2, 1.0)]:
        quaternion = quaternion_from_euler_angles(phi, theta, psi)
        again = quaternion_from_euler_angles(*euler_angles(quaternion))
        np.testing.assert_allclose(rotation_matrix(again), rotation_matrix(quaternion), atol=1e-12)


def test_product_of_turns_about_one_axis_adds_their_angles():
    turns = [np.array(quaternion_from_rotation_vector(0.0, angle, 0.0)) for angle in (0.3, 0.9, 1.2)]
    np.testing.assert_allclose(quaternion_product(turns[0], turns[1]), turns[2], atol=1e-15)


@pytest.mark.parametrize("angle", [1e-9, 9e-5, 1.1e-4, 3.0])
def test_rotation_vector_is_smooth_through_its_series(angle):
    quaternion = quaternion_from_rotation_vector(angle, 0.0, 0.0)
    np.testing.assert_allclose(quaternion, [np.cos(angle / 2), np.sin(angle / 2), 0.0, 0.0], rtol=1e-14, atol=1e-300)


def test_spin_about_the_separation_axis_passes_pitch_90_degrees():
    """Equation 3 is singular there; the spin of 100 deg/s is not disturbed."""
    rate = np.radians(100.0)
    separation = symmetric_separation(
        platform=Body(1200.0, [1500.0, 600.0, 1500.0]), satellite=Body(100.0, [9.35, 8.0, 9.35]), rates=[0.0, rate, 0.0]
    )
    path = trajectory(separation, [0.9, 1.8], tolerance=1e-12)
    for time, state in zip(path.times, path.states, strict=True):
        expected = np.array(quaternion_from_rotation_vector(0.0, rate * time, 0.0))
        np.testing.assert_allclose(state[16:20], expected, atol=1e-12)
        np.testing.assert_allclose(state[9:12], [0.0, rate, 0.0], atol=1e-12)
