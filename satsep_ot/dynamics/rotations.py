"""Rotations: unit quaternions [w, x, y, z] turn body components into reference components.

Sources: Hu et al., Acta Astronautica 131 (2017), equations 3 and 7; Kuipers, *Quaternions and Rotation Sequences*
(1999), chapter 5.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from satsep_ot.dynamics.kernels.vectors import quaternion_from_rotation_vector as quaternion_from_rotation_vector
from satsep_ot.dynamics.kernels.vectors import rotation


def rotation_matrix(quaternion: ArrayLike) -> np.ndarray:
    """The 3 x 3 matrix that turns body components into reference components.

    Parameters
    ----------
    quaternion : array_like, shape (4,)
        A unit quaternion [w, x, y, z].

    Examples
    --------
    >>> from satsep_ot.dynamics.rotations import rotation_matrix
    >>> print(rotation_matrix([1.0, 0.0, 0.0, 0.0]).astype(int).tolist())
    [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    """
    return np.array(rotation(np.asarray(quaternion, dtype=float).tolist())).reshape(3, 3)


def quaternion_from_matrix(matrix: ArrayLike) -> np.ndarray:
    """The unit quaternion of a rotation matrix (3, 3), body to reference; the inverse of `rotation_matrix`.

    Its components' products make up 4 q q^T, of which the row with the largest diagonal element is taken.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.dynamics.rotations import quaternion_from_matrix
    >>> print(quaternion_from_matrix(np.diag([1.0, -1.0, -1.0])).tolist())
    [0.0, 1.0, 0.0, 0.0]
    """
    (a, b, c), (d, e, f), (g, h, i) = np.asarray(matrix, dtype=float)
    products = np.array(
        [
            [1.0 + a + e + i, h - f, c - g, d - b],
            [h - f, 1.0 + a - e - i, b + d, c + g],
            [c - g, b + d, 1.0 - a + e - i, f + h],
            [d - b, c + g, f + h, 1.0 - a - e + i],
        ]
    )
    row = products[np.argmax(np.diag(products))]
    return row / np.linalg.norm(row)


def quaternion_product(left: ArrayLike, right: ArrayLike) -> np.ndarray:
    """The quaternion product left (x) right, shape (4,): first the turn `right`, then the turn `left`."""
    (w, *v), (other_w, *other_v) = np.asarray(left, dtype=float), np.asarray(right, dtype=float)
    v, other_v = np.array(v), np.array(other_v)
    return np.concatenate([[w * other_w - v @ other_v], w * other_v + other_w * v + np.cross(v, other_v)])


def quaternion_from_euler_angles(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """The quaternion of the 3-2-1 Euler angles of equation 7: yaw about z, then pitch about y, then roll about x.

    Parameters
    ----------
    roll, pitch, yaw : float
        The angles phi, theta, psi [rad].

    Returns
    -------
    quaternion : ndarray, shape (4,)
        Body to reference. The transposed matrix of equation 7 is `rotation_matrix` of it.

    Examples
    --------
    >>> from satsep_ot.dynamics.rotations import quaternion_from_euler_angles
    >>> print(quaternion_from_euler_angles(0.0, 0.0, 0.0).tolist())
    [1.0, 0.0, 0.0, 0.0]
    """
    turns = [
        [math.cos(0.5 * angle), *(math.sin(0.5 * angle) * np.eye(3)[axis])]
        for angle, axis in ((yaw, 2), (pitch, 1), (roll, 0))
    ]
    return quaternion_product(quaternion_product(turns[0], turns[1]), turns[2])


def euler_angles(quaternion: ArrayLike) -> tuple[float, float, float]:
    """The 3-2-1 Euler angles (roll, pitch, yaw) [rad] of a quaternion; at pitch = +-90 deg roll is reported as 0."""
    matrix = rotation_matrix(quaternion)
    across = math.hypot(matrix[0, 0], matrix[1, 0])
    pitch = math.atan2(-matrix[2, 0], across)
    if across < 1e-12:
        # Roll and yaw turn about the same axis there: only their sum or difference exists.
        return 0.0, pitch, math.atan2(-matrix[0, 1], matrix[1, 1])
    return math.atan2(matrix[2, 1], matrix[2, 2]), pitch, math.atan2(matrix[1, 0], matrix[0, 0])
