"""The satellite after the last release, free of forces and torques; derivatives by the complex step."""

from collections.abc import Callable

import numpy as np

# A step of the integration turns the satellite by at most so much: its error is below 1e-8 of that.
_LARGEST_TURN = 0.05  # rad
_MOST_STEPS = 2**16
# The complex step (Squire and Trapp, SIAM Review 40, 1998) has no cancellation, so that it may be this small.
_COMPLEX_STEP = 1e-30


def angle_of(lateral: np.ndarray, axial: np.ndarray) -> np.ndarray:
    """The angle between a vector and an axis from its sizes across and along it [rad], for complex numbers too."""
    safe = np.where(axial == 0.0, 1e-300, axial)
    return np.arctan(lateral / safe) + np.where(np.real(axial) < 0.0, np.pi, 0.0)


def leaning(across: np.ndarray, other: np.ndarray, axial: np.ndarray) -> np.ndarray:
    """One component of the angle between a vector and an axis [rad], smooth where the vector is along the axis.

    The angle is the norm of this and the same with `across` and `other` exchanged.
    """
    lateral = np.sqrt(across**2 + other**2)
    straight = np.real(lateral) == 0.0
    along = np.where(np.real(axial) == 0.0, 1e-300, axial)
    return np.where(
        straight,
        across / along,
        across / np.where(straight, 1.0, lateral) * angle_of(np.where(straight, 1.0, lateral), axial),
    )


def quaternion_products(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Products of quaternions (n, 4) row by row; one side may be a single quaternion, and numbers may be complex."""
    left, right = np.broadcast_arrays(left, right)
    w, v, other_w, other_v = left[:, :1], left[:, 1:], right[:, :1], right[:, 1:]
    scalar = w * other_w - (v * other_v).sum(axis=1, keepdims=True)
    return np.concatenate([scalar, w * other_v + other_w * v + np.cross(v, other_v)], axis=1)


def turned(quaternion: np.ndarray, rate: np.ndarray, inertia: np.ndarray, time: float) -> np.ndarray:
    """The attitude of a free rigid body after a time, by the classical Runge-Kutta method.

    Parameters
    ----------
    quaternion : ndarray, shape (n, 4)
        Body to inertial.
    rate : ndarray, shape (n, 3)
        In body axes [rad/s].
    inertia : ndarray, shape (n, 3, 3)
        [kg m2]
    time : float
        [s]

    Returns
    -------
    quaternion : ndarray, shape (n, 4)
        Of norm 1. The steps of a row follow from its own rate, so that it does not depend on the others; NaN where
        they would be more than 65,536.
    """
    inverse = np.linalg.inv(inertia)
    # The rate of a tumbling body changes, by at most the ratio of its moments.
    fastest = np.linalg.norm(np.real(rate), axis=1) * np.linalg.cond(np.real(inertia))
    wanted = np.maximum(fastest * time / _LARGEST_TURN, 1.0)
    steps = 2.0 ** np.ceil(np.log2(np.where(np.isfinite(wanted), wanted, np.inf)))
    result = np.full(quaternion.shape, np.nan, dtype=np.result_type(quaternion, rate, inertia))
    for count in np.unique(steps[steps <= _MOST_STEPS]):
        rows = steps == count
        result[rows] = _integrated(quaternion[rows], rate[rows], inertia[rows], inverse[rows], time, int(count))
    return result


def _integrated(q, w, inertia, inverse, time, count):
    def slopes(q, w):
        momentum = np.einsum("nij,nj->ni", inertia, w)
        spin = np.concatenate([np.zeros_like(w[:, :1]), w], axis=1)
        return 0.5 * quaternion_products(q, spin), -np.einsum("nij,nj->ni", inverse, np.cross(w, momentum))

    h = time / count
    for _ in range(count):
        a, b = slopes(q, w), None
        b = slopes(q + 0.5 * h * a[0], w + 0.5 * h * a[1])
        c = slopes(q + 0.5 * h * b[0], w + 0.5 * h * b[1])
        d = slopes(q + h * c[0], w + h * c[1])
        q, w = (old + h / 6.0 * (a[k] + 2.0 * b[k] + 2.0 * c[k] + d[k]) for k, old in enumerate((q, w)))
    return q / np.sqrt((q**2).sum(axis=1, keepdims=True))


def rotation_vector(quaternion: np.ndarray) -> np.ndarray:
    """The rotation vectors (n, 3) of quaternions of norm 1 (n, 4) [rad], of the smaller of the two angles."""
    quaternion = np.where(np.real(quaternion[:, :1]) < 0.0, -quaternion, quaternion)
    scalar, vector = quaternion[:, :1], quaternion[:, 1:]
    size = np.sqrt((vector**2).sum(axis=1, keepdims=True))
    straight = np.real(size) == 0.0
    size = np.where(straight, 1.0, size)
    return np.where(straight, 2.0 * vector, 2.0 * angle_of(size, scalar) * vector / size)


def complex_gradient(function: Callable[[np.ndarray], np.ndarray]) -> Callable[[np.ndarray], np.ndarray]:
    """The derivatives (n, m) of a function of (n, m), analytic and taken row by row, by the complex step."""

    def gradient(values):
        columns = []
        for column in range(values.shape[1]):
            moved = values.astype(complex)
            moved[:, column] += 1j * _COMPLEX_STEP
            columns.append(function(moved).imag / _COMPLEX_STEP)
        return np.column_stack(columns)

    return gradient
