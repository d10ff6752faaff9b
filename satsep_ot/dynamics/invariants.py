"""Energy and angular momentum of the two bodies about their common CG, over time.

The springs' forces are internal: the angular momentum is constant without gravity, and the kinetic energy grows by the
springs' work. The motion of the common CG itself has no part in either. Source: Goldstein, Poole, Safko, *Classical
Mechanics* (2002), sections 1.2 and 5.1.
"""

import numpy as np

from satsep_ot.dynamics.rotations import rotation_matrix_elements


def kinetic_energy(separation, states):
    """Kinetic energy of the relative motion and of both rotations, mu_r w^2 / 2 + sum_j omega_j . I_j omega_j / 2.

    Parameters
    ----------
    separation : satsep_ot.dynamics.separation.Separation
    states : array_like, shape (T, 20)
        See `satsep_ot.dynamics.system`.

    Returns
    -------
    energy : ndarray, shape (T,)
        [J]

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.dynamics.invariants import kinetic_energy
    >>> from satsep_ot.dynamics.separation import Body, Separation, Springs
    >>> from satsep_ot.dynamics.simulation import trajectory
    >>> springs = Springs([0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03)
    >>> separation = Separation(Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35]), springs)
    >>> energy = kinetic_energy(separation, trajectory(separation, [0.0, 0.1]).states)
    >>> print(f"{energy[1] - energy[0]:.6f} J")
    16.500000 J
    """
    states = np.asarray(states, dtype=float)
    platform, satellite = separation.platform, separation.satellite
    w, platform_rates, satellite_rates = states[:, 3:6], states[:, 6:9], states[:, 9:12]
    energy = _reduced_mass(separation) * np.sum(w * w, axis=1)
    energy += np.sum(platform_rates * (platform_rates @ platform.inertia), axis=1)
    return 0.5 * (energy + np.sum(satellite_rates * (satellite_rates @ satellite.inertia), axis=1))


def angular_momentum(separation, states):
    """Angular momentum about the common CG in inertial axes, C_1 (mu_r d x w + I_1 omega_1 + Q I_2 omega_2).

    Parameters
    ----------
    separation : satsep_ot.dynamics.separation.Separation
    states : array_like, shape (T, 20)
        See `satsep_ot.dynamics.system`.

    Returns
    -------
    momentum : ndarray, shape (T, 3)
        [N m s]

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.dynamics.invariants import angular_momentum
    >>> from satsep_ot.dynamics.separation import Body, Separation, Springs
    >>> from satsep_ot.dynamics.simulation import trajectory
    >>> springs = Springs([0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03)
    >>> platform, satellite = Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35], [0.01, 0.4, 0.0])
    >>> separation = Separation(platform, satellite, springs, rates=[0.01, 0.0, 0.0])
    >>> momentum = angular_momentum(separation, trajectory(separation, [0.0, 0.1]).states)
    >>> bool(np.allclose(momentum[1], momentum[0], rtol=1e-8))
    True
    """
    states = np.asarray(states, dtype=float)
    orbital = _reduced_mass(separation) * np.cross(states[:, 0:3], states[:, 3:6])
    spin = states[:, 6:9] @ separation.platform.inertia
    spin += _turned(states[:, 12:16], states[:, 9:12] @ separation.satellite.inertia)
    return _turned(states[:, 16:20], orbital + spin)


def _reduced_mass(separation):
    return 1.0 / (1.0 / separation.platform.mass + 1.0 / separation.satellite.mass)


def _turned(quaternions, vectors):
    """Body components turned into reference components, (T, 3)."""
    # The function behind the compiled one takes arrays, and needs no compilation.
    elements = np.array(rotation_matrix_elements.py_func(*quaternions.T)).reshape(3, 3, -1)
    return np.einsum("ijt,tj->ti", elements, vectors)
