"""What can be computed of a separation by hand, to hold a simulated run against."""

import math
from dataclasses import dataclass, replace

import numpy as np

from satsep_ot.dynamics.invariants import spring_work
from satsep_ot.dynamics.quantities import STATE_FIELDS
from satsep_ot.dynamics.separation import Separation
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.dynamics.springs import Interpolation

_OFFSET = 1e-3  # m, of the centre of mass


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


@dataclass(frozen=True)
class HandFormula:
    """A number that can be computed by hand, and the same of a simulated run.

    Attributes
    ----------
    name, unit, formula : str
    by_hand, by_run : float
        NaN where the run failed.
    """

    name: str
    unit: str
    formula: str
    by_hand: float
    by_run: float


def hand_formulas(separation: Separation) -> list[HandFormula]:
    """What a separation gives by energy and momentum alone, beside its nominal run.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    rows : list of HandFormula
        The hand formulas leave out losses, the turn of the stack, and that springs turn the satellite back.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.hand_formulas import hand_formulas
    >>> for row in hand_formulas(load_case("reference").separation)[:3]:
    ...     print(f"{row.name}: {row.by_hand:.4g} {row.unit} by hand, {row.by_run:.4g} in the run")
    spring energy: 16.5 J by hand, 16.5 in the run
    separation velocity: 0.5979 m/s by hand, 0.5979 in the run
    momentum: 55.19 N s by hand, 55.19 in the run
    """
    platform, satellite = separation.platform, separation.satellite
    total = platform.mass + satellite.mass
    reduced = platform.mass * satellite.mass / total
    energy, velocity = push_energy(separation), push_velocity(separation)
    offset = np.array(satellite.center_of_mass) + np.array([_OFFSET, 0.0, 0.0])
    nominal = simulate(separation)
    aside = simulate(replace(separation, satellite=replace(satellite, center_of_mass=offset)))
    speed = float(np.linalg.norm(nominal.base[0, [STATE_FIELDS.index(f"w_{axis}") for axis in "xyz"]]))
    tip_off = float(aside.quantity("rate_z")[0] - nominal.quantity("rate_z")[0])
    inverse = float(np.linalg.inv(satellite.inertia)[2, 2])
    return [
        HandFormula("spring energy", "J", "sum of the works of the springs", energy, 0.5 * reduced * speed**2),
        HandFormula("separation velocity", "m/s", "sqrt(2 E / mu)", velocity, speed),
        HandFormula("momentum", "N s", "mu v", reduced * velocity, reduced * speed),
        HandFormula(
            "satellite's change of velocity", "m/s", "m_1 v / (m_1 + m_2)",
            platform.mass / total * velocity, platform.mass / total * speed,
        ),
        HandFormula(
            "platform's change of velocity", "m/s", "m_2 v / (m_1 + m_2)",
            satellite.mass / total * velocity, satellite.mass / total * speed,
        ),
        HandFormula(
            "tip-off per mm of offset", "deg/s", "mu v 1 mm / I_zz of the satellite",
            math.degrees(reduced * velocity * _OFFSET * inverse), abs(tip_off),
        ),
    ]  # fmt: skip


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
