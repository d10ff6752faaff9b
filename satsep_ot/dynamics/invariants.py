"""Energy and angular momentum of the two bodies about their common CG, over time.

The springs' forces are internal: the angular momentum is constant without gravity, and the kinetic energy grows by the
springs' work. The motion of the common CG itself has no part in either. Source: Goldstein, Poole, Safko, *Classical
Mechanics* (2002), sections 1.2 and 5.1.
"""

from itertools import pairwise

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from satsep_ot.dynamics.kernels.vectors import rotation
from satsep_ot.dynamics.separation import Separation
from satsep_ot.dynamics.simulation import trajectory
from satsep_ot.dynamics.springs import force_functions

_NODES = 16  # of a quadrature
_PIECES = 8  # of the time between two events: the force bends at the knots of a table


def kinetic_energy(separation: Separation, states: ArrayLike) -> np.ndarray:
    """Kinetic energy of the relative motion and of both rotations, mu_r w^2 / 2 + sum_j omega_j . I_j omega_j / 2.

    Parameters
    ----------
    separation : satsep_ot.dynamics.separation.Separation
    states : array_like, shape (T, 20)
        See `satsep_ot.dynamics.kernels.records`.

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


def angular_momentum(separation: Separation, states: ArrayLike) -> np.ndarray:
    """Angular momentum about the common CG in inertial axes, C_1 (mu_r d x w + I_1 omega_1 + Q I_2 omega_2).

    Parameters
    ----------
    separation : satsep_ot.dynamics.separation.Separation
    states : array_like, shape (T, 20)
        See `satsep_ot.dynamics.kernels.records`.

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


def spring_strokes(separation: Separation, states: ArrayLike) -> np.ndarray:
    """The stroke of every spring as the bodies lie, whether it pushes or not; see `satsep_ot.dynamics.springs`.

    Parameters
    ----------
    separation : satsep_ot.dynamics.separation.Separation
    states : array_like, shape (T, 20)
        See `satsep_ot.dynamics.kernels.records`.

    Returns
    -------
    strokes : ndarray, shape (T, N)
        [m]

    Examples
    --------
    >>> from satsep_ot.dynamics.invariants import spring_strokes
    >>> from satsep_ot.dynamics.separation import Body, Separation, Springs
    >>> from satsep_ot.dynamics.simulation import trajectory
    >>> springs = Springs([0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03)
    >>> separation = Separation(Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35]), springs)
    >>> path = trajectory(separation, [0.0, 0.05])
    >>> print([f"{stroke:.4f}" for stroke in spring_strokes(separation, path.states)[:, 0]])
    ['0.0000', '0.0112']
    """
    return _strokes_and_shares(separation, np.asarray(states, dtype=float))[0]


def spring_work(separation: Separation, start: ArrayLike, end: ArrayLike) -> np.ndarray:
    """The work of each spring between two strokes, the integral of its force, by Gauss quadrature.

    Parameters
    ----------
    separation : satsep_ot.dynamics.separation.Separation
        Without friction in the guides, which takes a part of this work.
    start, end : array_like, shape (N,)
        Strokes at the start of each push and at its release [m].

    Returns
    -------
    work : ndarray, shape (N,)
        [J]; 0 for a spring that has failed.

    Examples
    --------
    >>> from satsep_ot.dynamics.invariants import spring_work
    >>> from satsep_ot.dynamics.separation import Body, Separation, Springs
    >>> springs = Springs([0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03)
    >>> separation = Separation(Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35]), springs)
    >>> print(spring_work(separation, [0.0] * 4, [0.03] * 4))
    [4.125 4.125 4.125 4.125]
    """
    springs, start, end = separation.springs, np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    nodes, weights = legendre.leggauss(_NODES)
    force, pieces = force_functions(springs), springs.force_pieces()
    work = np.zeros(len(springs))
    for i in np.flatnonzero(springs.scale > 0.0):
        low, high = sorted((start[i], end[i]))
        knots = pieces[i][0]
        for a, b in pairwise([low, *knots[(low < knots) & (knots < high)], high]):
            forces = force[i](0.5 * (a + b + (b - a) * nodes))
            work[i] += np.sign(end[i] - start[i]) * 0.5 * (b - a) * (weights @ forces)
    return work


def push_starts(separation: Separation) -> np.ndarray:
    """When each spring starts to push: at its delay, and pins with the first push of any other spring.

    Parameters
    ----------
    separation : satsep_ot.dynamics.separation.Separation

    Returns
    -------
    times : ndarray, shape (N,)
        [s]; NaN for a spring that has failed.

    Examples
    --------
    >>> from satsep_ot.dynamics.invariants import push_starts
    >>> from satsep_ot.dynamics.separation import Body, Separation, Springs
    >>> springs = Springs([0.8, 2.4], 0.3, 5500.0, 0.04, 0.03, delay=[0.0, 2e-3])
    >>> print(push_starts(Separation(Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35]), springs)))
    [0.    0.002]
    """
    springs = separation.springs
    works, pins = springs.scale > 0.0, springs.law_property("holds_back")
    first = np.min(springs.delay[works & ~pins], initial=np.inf)
    return np.where(works, np.where(pins, first, springs.delay), np.nan)


def guide_loss(separation: Separation, releases: ArrayLike, tolerance: float = 1e-8) -> np.ndarray:
    """What friction in its guide takes of the work of each spring of the nominal run, the integral of its power.

    The force line says which share of the spring's force reaches the bodies (see
    `satsep_ot.dynamics.kernels.force_lines`): friction takes the rest. Gauss quadrature between the events of the run.

    Parameters
    ----------
    separation : satsep_ot.dynamics.separation.Separation
    releases : array_like, shape (N,)
        When each spring is released [s], NaN for one that has failed.
    tolerance : float
        Of the trajectory.

    Returns
    -------
    loss : ndarray, shape (N,)
        [J]; 0 without friction.

    Examples
    --------
    >>> from satsep_ot.dynamics.invariants import guide_loss
    >>> from satsep_ot.dynamics.separation import Body, ForceLine, Separation, Springs
    >>> from satsep_ot.dynamics.simulation import trajectory
    >>> springs = Springs([0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03)
    >>> platform, satellite = Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35], [0.02, 0.4, 0.0])
    >>> separation = Separation(platform, satellite, springs, ForceLine.NORMAL, guide_friction=0.2)
    >>> loss = guide_loss(separation, trajectory(separation, []).release_times)
    >>> bool((0.0 < loss).all() and loss.sum() < 0.01 * 16.5)
    True
    """
    springs, starts, loss = separation.springs, push_starts(separation), np.zeros(len(separation.springs))
    if not separation.guide_friction:
        return loss
    force = force_functions(springs)
    nodes, weights = legendre.leggauss(_NODES)
    # From values at the nodes to derivatives there, on [-1, 1].
    differentiate = legendre.legvander(nodes, _NODES - 2) @ legendre.legder(
        np.linalg.inv(legendre.legvander(nodes, _NODES - 1))
    )
    events = np.unique([*starts[np.isfinite(starts)], *np.asarray(releases)[np.isfinite(releases)]])
    ends = np.concatenate([np.linspace(start, end, _PIECES, endpoint=False) for start, end in pairwise(events)])
    for start, end in pairwise([*ends, events[-1]]):
        states = trajectory(separation, 0.5 * (start + end + (end - start) * nodes), tolerance=tolerance).states
        strokes, shares = _strokes_and_shares(separation, states)
        for i in np.flatnonzero((starts <= start) & (end <= releases)):
            taken = (1.0 - shares[:, i]) * force[i](strokes[:, i])
            loss[i] += weights @ (taken * (differentiate @ strokes[:, i]))
    return loss


def _strokes_and_shares(separation, states):
    """The stroke of each spring, and the share of its force that reaches the bodies, as its line says: (T, N) each."""
    springs, stowed = separation.springs, separation.stowed_length
    ring, guides = springs.seats(), springs.guides()
    # A stowed strut lies along its guide: the platform's seat is recessed by l_0 n, the satellite raised by l_0 y.
    platform_seats = ring + stowed * ([0.0, 1.0, 0.0] - guides) - separation.platform.center_of_mass
    satellite_seats = ring - separation.satellite.center_of_mass
    result = np.empty((2, len(states), len(springs)))
    for k, state in enumerate(states):
        turn = np.array(rotation(state[12:16])).reshape(3, 3)
        deltas = state[:3] + satellite_seats @ turn.T - platform_seats
        for i, delta in enumerate(deltas):
            stroke, _, _, share = separation.force_line.function(
                delta, guides[i], turn[:, 1], stowed, separation.guide_friction
            )
            result[:, k, i] = stroke, share
    return result


def _reduced_mass(separation):
    return 1.0 / (1.0 / separation.platform.mass + 1.0 / separation.satellite.mass)


def _turned(quaternions, vectors):
    """Body components turned into reference components, (T, 3)."""
    elements = np.array(rotation(quaternions.T)).reshape(3, 3, -1)
    return np.einsum("ijt,tj->ti", elements, vectors)
