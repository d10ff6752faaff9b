"""What can be computed of a separation by hand, to hold a simulated run against."""

import math
from dataclasses import replace

import numpy as np

from satsep_ot.dynamics.invariants import spring_work
from satsep_ot.dynamics.separation import Separation
from satsep_ot.dynamics.springs import Interpolation


def push_energy(separation: Separation) -> float:
    """Work of all springs on their way, without losses [J].

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    energy : float

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.hand_formulas import push_energy
    >>> round(push_energy(load_case("reference").separation), 9)
    16.5
    """
    springs = separation.springs
    return float(spring_work(separation, np.zeros(len(springs)), springs.release_strokes()).sum())


def push_velocity(separation: Separation) -> float:
    """Velocity between the bodies if all of `push_energy` goes along one line, sqrt(2 E / mu_r) [m/s].

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    velocity : float
        0 where the energy is negative.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.hand_formulas import push_velocity
    >>> round(push_velocity(load_case("reference").separation), 6)
    0.597913
    """
    inverse_mass = 1.0 / separation.platform.mass + 1.0 / separation.satellite.mass
    return math.sqrt(max(2.0 * push_energy(separation) * inverse_mass, 0.0))


def table_energies(separation: Separation) -> dict[Interpolation, float]:
    """`push_energy` by each interpolation of the force-stroke tables: straight lines give the trapezoidal rule.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    energies : dict of Interpolation to float
        [J]; empty without a table.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.hand_formulas import table_energies
    >>> table_energies(load_case("reference").separation)
    {}
    """
    springs = separation.springs
    if all(table is None for table in springs.tables):
        return {}
    return {
        kind: push_energy(replace(separation, springs=replace(springs, interpolation=kind))) for kind in Interpolation
    }
