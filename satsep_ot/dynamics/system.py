"""What the kernels of a run share: the layout of state, constants and spring table.

State of a run (20 numbers, SI, radians), platform axes unless said:

====== ==========================================================================================
0-2    d, position of the satellite's CG from the platform's CG
3-5    w, inertial relative velocity of the CGs
6-8    platform body rates
9-11   satellite body rates, satellite axes
12-15  Q, quaternion from satellite to platform axes
16-19  q1, quaternion from platform to inertial axes
====== ==========================================================================================
"""

from typing import Any

import numpy as np

# A field that holds an array, and is given as anything that makes one.
Array = np.ndarray | Any

STATE_SIZE = 20


def integers(*values: int) -> np.ndarray:
    """Constants for the kernels: numba compiles a function anew for every Python integer that it is called with."""
    return np.array(values, dtype=np.int64)


# What a run depends on beside time and state stands in two flat arrays, since compiled functions pass every array as
# seven arguments. Numbers, `c`: inverse reduced mass, inertia tensors and their inverses (row by row), stowed length,
# friction coefficient of the guides; the orbit of the platform's CG: gravitational parameter, the anchor that the
# motion is expanded about (time, ECI position, velocity, acceleration), and there 1/r^2, 1/r, mu/r^3 and its rate of
# change; the CGs of platform and satellite from their ring centres; radius and depth of the recess.
INVERSE_REDUCED_MASS = np.int64(0)
PLATFORM_INERTIA, PLATFORM_INVERSE_INERTIA, SATELLITE_INERTIA, SATELLITE_INVERSE_INERTIA = integers(1, 10, 19, 28)
STOWED_LENGTH, GUIDE_FRICTION = integers(37, 38)
MU, ANCHOR_TIME, ANCHOR, INVERSE_SQUARE, INVERSE_RADIUS, GRAVITY_RATE, GRAVITY_RATE_SLOPE = integers(
    39, 40, 41, 50, 51, 52, 53
)
PLATFORM_CG, SATELLITE_CG, RADIUS, DEPTH = integers(54, 57, 60, 61)
# Then what guided springs sum up to, see `springs.add_to_sums`: SUM_COLUMNS columns of SUM_ROWS.
SUMS, SUM_ROWS, SUM_COLUMNS = integers(62, 12, 13)
# Then the spring table, spring by spring: platform seat from the platform's CG, satellite seat from the satellite's CG
# (three columns each, in its body's axes), guide direction in platform axes (three), and what is named here.
SPRINGS, SPRING_COLUMNS = integers(218, 14)
STIFFNESS, DEFORMATION, RELEASE_STROKE, DELAY, SCALE = integers(9, 10, 11, 12, 13)
# Then, at places that `marks` tells: the force-stroke tables of the springs as cubics, TABLE_COLUMNS a segment; the
# envelope points that start in the recess, from the satellite's ring centre; the planes of the recess, unit normal into
# the free side and offset.
TABLE_COLUMNS, POINT_COLUMNS, PLANE_COLUMNS = integers(5, 3, 4)

# Whole numbers, `marks`: how many springs, segments a table, points, planes; the force line, the level of gravity;
# where tables, points and planes start; how many springs have tables, and how many push now; then for each spring
# whether it pushes, whether it is still to start, and its law.
SPRING_NUMBER, SEGMENT_NUMBER, POINT_NUMBER, PLANE_NUMBER, FORCE_LINE, GRAVITY_LEVEL = np.arange(6)
TABLES, POINTS, PLANES, TABLE_NUMBER, PUSHING = integers(6, 7, 8, 9, 10)
SPRING_MARKS, MARK_COLUMNS = integers(11, 3)
ACTIVE, PENDING, LAW = integers(0, 1, 2)

# A step works in one flat array `w`: STAGES stage states, their slopes, the state at its end, the error allowed in each
# component; then what the guided springs do, and the row and the column that one of them adds to the sums.
STAGES = 12
START, K, NEW, ALLOWED = integers(0, STAGES * STATE_SIZE, 2 * STAGES * STATE_SIZE, (2 * STAGES + 1) * STATE_SIZE)
FORCES = ALLOWED + STATE_SIZE
ROW = FORCES + SUM_ROWS
COLUMN = ROW + SUM_ROWS
WORK_SIZE = COLUMN + SUM_COLUMNS

NO_GRAVITY, GRAVITY, GRAVITY_WITH_TORQUE = integers(0, 1, 2)
