"""The orbit that a separation happens on: where the stack is at t = 0, and which field it flies in.

Sources: Curtis, *Orbital Mechanics for Engineering Students* (2014), section 4.6 (position and velocity from the
classical elements); Pavlis et al., "The development and evaluation of the Earth Gravitational Model 2008", Journal of
Geophysical Research 117 (2012), for J2.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from satsep_ot.dynamics.gravity import EARTH_GRAVITATIONAL_PARAMETER, EARTH_RADIUS

# -sqrt(5) C_20 of EGM2008 (tide-free), C_20 = -4.84165143790815e-4. It belongs to a radius 0.7 m below that of WGS 84,
# which changes the acceleration by 2e-7 of itself.
EARTH_J2 = 1.082626173852e-3


# A field that holds an array, and is given as anything that makes one.
Array = np.ndarray | Any


@dataclass(frozen=True)
class Orbit:
    """Where the pivot of the stack is at t = 0.

    Parameters
    ----------
    position, velocity : array_like, shape (3,)
        ECI position [m] and velocity [m/s]; with `j2`, z is the Earth's axis.
    mu : float
        Gravitational parameter [m3/s2], by default the Earth's (WGS 84).
    j2 : bool
        Whether the Earth's oblateness acts on the coast after the release (see
        `satsep_ot.dynamics.relative_orbit`).

    Raises
    ------
    ValueError
        If a vector has not 3 finite coordinates, the position is 0 or mu is not positive.

    Examples
    --------
    >>> from satsep_ot.dynamics.orbit import Orbit
    >>> print(Orbit([6.878e6, 0.0, 0.0], [0.0, 7.61e3, 0.0]).position.tolist())
    [6878000.0, 0.0, 0.0]
    """

    position: Array
    velocity: Array
    mu: float = EARTH_GRAVITATIONAL_PARAMETER
    j2: bool = False

    def __post_init__(self):
        for name in ("position", "velocity"):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (3,) or not np.isfinite(value).all():
                raise ValueError(f"orbit.{name} = {getattr(self, name)!r}; it must be 3 finite coordinates")
            object.__setattr__(self, name, value)
        if not np.linalg.norm(self.position) > 0.0:
            raise ValueError("orbit.position is the centre of the Earth; it must be a point away from it")
        if not 0.0 < self.mu < np.inf:
            raise ValueError(f"orbit.mu = {self.mu} m3/s2; it must be positive and finite")

    @classmethod
    def from_elements(
        cls,
        semi_major_axis: float,
        eccentricity: float,
        inclination: float,
        right_ascension: float,
        argument_of_perigee: float,
        true_anomaly: float,
        mu: float = EARTH_GRAVITATIONAL_PARAMETER,
        j2: bool = False,
    ) -> "Orbit":
        """The orbit of the classical elements at t = 0.

        In the perifocal axes P (to the perigee) and Q (along the motion there), with p = a (1 - e^2):

            r = p / (1 + e cos nu) (cos nu P + sin nu Q),   v = sqrt(mu / p) (-sin nu P + (e + cos nu) Q)

        Parameters
        ----------
        semi_major_axis : float
            a [m], positive.
        eccentricity : float
            e, from 0 to below 1.
        inclination, right_ascension, argument_of_perigee, true_anomaly : float
            i, Omega, omega, nu [rad]. On a circular orbit only omega + nu has a meaning, on an equatorial one
            only Omega + omega.
        mu, j2 : as for the class

        Returns
        -------
        orbit : Orbit

        Raises
        ------
        ValueError
            If a is not positive, e is outside [0, 1), or the perigee is below the Earth's surface.

        Examples
        --------
        >>> from satsep_ot.dynamics.orbit import Orbit
        >>> orbit = Orbit.from_elements(7.0e6, 0.01, 0.9, 0.0, 0.0, 0.0)
        >>> print(f"{orbit.position[0]:.0f} m, {orbit.period:.1f} s")
        6930000 m, 5828.5 s
        """
        angles = (inclination, right_ascension, argument_of_perigee, true_anomaly)
        if not np.isfinite(angles).all():
            raise ValueError(f"the angles of the orbit are {angles} rad; they must be finite")
        if not 0.0 < semi_major_axis < np.inf:
            raise ValueError(f"semi_major_axis = {semi_major_axis} m; it must be positive and finite")
        if not 0.0 <= eccentricity < 1.0:
            raise ValueError(f"eccentricity = {eccentricity}; it must be at least 0 and below 1 (a closed orbit)")
        perigee = semi_major_axis * (1.0 - eccentricity)
        if perigee < EARTH_RADIUS:
            raise ValueError(
                f"the perigee is {1e-3 * perigee:.6g} km from the centre of the Earth (semi_major_axis = "
                f"{1e-3 * semi_major_axis:.6g} km, eccentricity = {eccentricity:g}); it must be above "
                f"the surface, {1e-3 * EARTH_RADIUS:.6g} km"
            )
        ci, si = math.cos(inclination), math.sin(inclination)
        cn, sn = math.cos(right_ascension), math.sin(right_ascension)
        cw, sw = math.cos(argument_of_perigee), math.sin(argument_of_perigee)
        to_perigee = np.array([cn * cw - sn * sw * ci, sn * cw + cn * sw * ci, sw * si])
        along = np.array([-cn * sw - sn * cw * ci, -sn * sw + cn * cw * ci, cw * si])
        parameter = semi_major_axis * (1.0 - eccentricity**2)
        c, s = math.cos(true_anomaly), math.sin(true_anomaly)
        position = parameter / (1.0 + eccentricity * c) * (c * to_perigee + s * along)
        velocity = math.sqrt(mu / parameter) * (-s * to_perigee + (eccentricity + c) * along)
        return cls(position, velocity, mu, j2)

    @property
    def period(self) -> float:
        """Time of one revolution without J2 [s]; infinite when the orbit is not closed."""
        inverse_axis = 2.0 / np.linalg.norm(self.position) - self.velocity @ self.velocity / self.mu
        return 2.0 * math.pi / math.sqrt(self.mu * inverse_axis**3) if inverse_axis > 0.0 else math.inf
