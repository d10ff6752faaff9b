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

from typing import NamedTuple

import numpy as np

STATE_SIZE = 20

# Constants of a run: inverse reduced mass, inertia tensors and their inverses (row by row), stowed length, then the
# orbit of the platform's CG (gravitational parameter, ECI position and velocity).
INVERSE_REDUCED_MASS = 0
PLATFORM_INERTIA, PLATFORM_INVERSE_INERTIA, SATELLITE_INERTIA, SATELLITE_INVERSE_INERTIA = 1, 10, 19, 28
STOWED_LENGTH = 37
ORBIT = 38
CONSTANT_SIZE = 45

NO_GRAVITY, GRAVITY, GRAVITY_WITH_TORQUE = 0, 1, 2

# Columns of the spring table of a run. Platform seat from the platform's CG, satellite seat from the satellite's CG
# (three columns each, in its body's axes), guide direction in platform axes (three), and:
STIFFNESS, DEFORMATION, RELEASE_STROKE, DELAY = 9, 10, 11, 12
SPRING_COLUMNS = 13

GUIDED = 0  # satsep_ot.dynamics.springs.ForceLine.GUIDED, for the kernels


class System(NamedTuple):
    """What the right-hand side depends on, beside time and state."""

    parameters: np.ndarray  # the flat parameter vector of the run
    c: np.ndarray  # constants made from it, see above
    springs: np.ndarray  # spring table (N, SPRING_COLUMNS)
    active: np.ndarray  # which springs push now
    points: np.ndarray  # envelope points that start in the recess (E, 3), from the satellite's ring centre
    force_line: int
    gravity: int
