"""Vectors of three numbers and matrices of nine, row by row, as tuples or as fields of records.

Unit quaternions [w, x, y, z] turn body components into reference components. Sources: Hu et al., Acta Astronautica 131
(2017), equations 3 and 7; Kuipers, *Quaternions and Rotation Sequences* (1999), chapter 5.
"""

import math

from satsep_ot.dynamics.kernels.compilation import inline, kernel
from satsep_ot.dynamics.kernels.records import LANES

ZERO = (0.0, 0.0, 0.0)


@inline
def vector(a, first=0):
    """Three numbers of a field as a tuple."""
    return a[first], a[first + 1], a[first + 2]


@inline
def matrix(a):
    """Nine numbers of a field as a tuple."""
    return a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], a[8]


@inline
def plus(a, b):
    """a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@inline
def minus(a, b):
    """a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@inline
def scaled(factor, a):
    """factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]


@inline
def dot(a, b):
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inline
def cross(a, b):
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inline
def norm(a):
    """|a|."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@inline
def times(matrix, a):
    """The product of a matrix and a vector."""
    return (
        matrix[0] * a[0] + matrix[1] * a[1] + matrix[2] * a[2],
        matrix[3] * a[0] + matrix[4] * a[1] + matrix[5] * a[2],
        matrix[6] * a[0] + matrix[7] * a[1] + matrix[8] * a[2],
    )


@inline
def transposed_times(matrix, a):
    """The product of the transposed matrix and a vector."""
    return (
        matrix[0] * a[0] + matrix[3] * a[1] + matrix[6] * a[2],
        matrix[1] * a[0] + matrix[4] * a[1] + matrix[7] * a[2],
        matrix[2] * a[0] + matrix[5] * a[1] + matrix[8] * a[2],
    )


@inline
def put(target, a, first=0):
    """Write a vector into a field."""
    target[first] = a[0]
    target[first + 1] = a[1]
    target[first + 2] = a[2]


@inline
def rotation(q):
    """The matrix that turns body components into reference components."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    return (
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )


@inline
def turned_back(q, a):
    """Reference components of a vector turned into body components: a - 2 w u x a + 2 u x (u x a), u = (x, y, z)."""
    u = (q[1], q[2], q[3])
    twice = scaled(2.0, cross(u, a))
    return plus(minus(a, scaled(q[0], twice)), cross(u, twice))


@inline
def quaternion_from_rotation_vector(rx, ry, rz):
    """The quaternion of a turn by the angle |r| about r [rad]."""
    half = 0.5 * math.sqrt(rx * rx + ry * ry + rz * rz)
    # sin(half) / (2 half), by its series where the quotient would be 0 / 0.
    scale = 0.5 * (1.0 - half * half / 6.0) if half < 1e-4 else 0.5 * math.sin(half) / half
    return math.cos(half), scale * rx, scale * ry, scale * rz


# Adjoints stand in fields of shape (3, LANES) or (9, LANES): those of LANES outputs beside each other.


@inline
def lane(field, n, first=0):
    """The vector of lane n, from row `first` on."""
    return field[first, n], field[first + 1, n], field[first + 2, n]


@inline
def put_lane(field, n, a, first=0):
    """Write a vector into lane n."""
    field[first, n] = a[0]
    field[first + 1, n] = a[1]
    field[first + 2, n] = a[2]


@inline
def add_lane(field, n, a, first=0):
    """Add a vector to lane n."""
    field[first, n] += a[0]
    field[first + 1, n] += a[1]
    field[first + 2, n] += a[2]


@inline
def put_product(field, n, a, b):
    """Write the matrix a b^T into lane n of a matrix."""
    put_lane(field, n, scaled(a[0], b))
    put_lane(field, n, scaled(a[1], b), 3)
    put_lane(field, n, scaled(a[2], b), 6)


@inline
def add_product(field, n, a, b):
    """Add the matrix a b^T to lane n of a matrix."""
    field[0, n] += a[0] * b[0]
    field[1, n] += a[0] * b[1]
    field[2, n] += a[0] * b[2]
    field[3, n] += a[1] * b[0]
    field[4, n] += a[1] * b[1]
    field[5, n] += a[1] * b[2]
    field[6, n] += a[2] * b[0]
    field[7, n] += a[2] * b[1]
    field[8, n] += a[2] * b[2]


@inline
def clear_rows(field):
    """Set a field of rows to zero."""
    for row in range(field.shape[0]):
        for n in range(LANES):
            field[row, n] = 0.0


@inline
def add_rows(target, source):
    """Add a field of rows to another one."""
    for row in range(target.shape[0]):
        for n in range(LANES):
            target[row, n] += source[row, n]


@inline
def clear(adjoint):
    """Set a record of adjoints to zero."""
    numbers = adjoint.flat
    for n in range(numbers.shape[0]):
        numbers[n] = 0.0


@inline
def add(target, source):
    """Add a record of adjoints to another one."""
    numbers, others = target.flat, source.flat
    for n in range(numbers.shape[0]):
        numbers[n] += others[n]


@kernel
def copy(target, source):
    """Write a record of adjoints over another one."""
    numbers, others = target.flat, source.flat
    for n in range(numbers.shape[0]):
        numbers[n] = others[n]


@kernel
def add_scaled(target, factor, source):
    """Add a multiple of a record of adjoints to another one."""
    numbers, others = target.flat, source.flat
    for n in range(numbers.shape[0]):
        numbers[n] += factor * others[n]


@inline
def quaternion_adjoint(q, m):
    """From the adjoint m of the matrix `rotation(q)`, row by row, to that of the quaternion, its numbers taken as free.

    Numbers, or arrays of one shape.
    """
    q0, q1, q2, q3 = q[0], q[1], q[2], q[3]
    return (
        2.0 * (q3 * (m[3] - m[1]) + q2 * (m[2] - m[6]) + q1 * (m[7] - m[5])),
        2.0 * (q2 * (m[1] + m[3]) + q3 * (m[2] + m[6]) + q0 * (m[7] - m[5]) - 2.0 * q1 * (m[4] + m[8])),
        2.0 * (q1 * (m[1] + m[3]) + q3 * (m[5] + m[7]) + q0 * (m[2] - m[6]) - 2.0 * q2 * (m[0] + m[8])),
        2.0 * (q1 * (m[2] + m[6]) + q2 * (m[5] + m[7]) + q0 * (m[3] - m[1]) - 2.0 * q3 * (m[0] + m[4])),
    )


@inline
def rotation_adjoint(q, by_rotation, target):
    """Add to the adjoint of a quaternion, `target` (4, LANES), what that of its matrix says, (9, LANES)."""
    q = (q[0], q[1], q[2], q[3])
    for n in range(LANES):
        by_q = quaternion_adjoint(q, (*lane(by_rotation, n), *lane(by_rotation, n, 3), *lane(by_rotation, n, 6)))
        target[0, n] += by_q[0]
        target[1, n] += by_q[1]
        target[2, n] += by_q[2]
        target[3, n] += by_q[3]
