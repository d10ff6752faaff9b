"""A separation: its data, from the stowed stack to the last release and out of the recess.

The model is that of Hu et al. (2017), section 2, made well-posed: see `satsep_ot.dynamics.kernels.force_lines` for
where the springs push and `satsep_ot.dynamics.kernels.rigid_body` for the equations of motion. A spring starts to push
at its delay and is released, once and for all, when its stroke reaches min(L, xi): a pusher never pulls. Both instants
are located as events; no step crosses them.
"""

import copy
import enum
from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated

import numpy as np

from satsep_ot.dynamics.contact import Contact, HoldDowns, Rails, elements_of
from satsep_ot.dynamics.kernels.records import LARGEST, named, record
from satsep_ot.dynamics.kernels.status import Status as Status
from satsep_ot.dynamics.orbit import Array, Orbit
from satsep_ot.dynamics.parameter_vector import (
    AXES,
    TENSOR,
    Parameter,
    Place,
    Sign,
    parameter_fields,
    places,
    record_fields,
)
from satsep_ot.dynamics.relative_orbit import Recontact
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.springs import ForceLine, Springs
from satsep_ot.dynamics.springs import umbilical as umbilical


class Pivot(enum.IntEnum):
    """The point that the joined stack turns about and that follows the orbit."""

    STACK = 0
    PLATFORM = 1


@dataclass(frozen=True)
class Body:
    """A rigid body.

    Parameters
    ----------
    mass : float
        Mass [kg], positive.
    inertia : array_like, shape (3,) or (3, 3)
        Inertia tensor about the body's CG in body axes [kg m2] (tensor elements, so I_xy = -sum m x y); three numbers
        mean principal axes.
    center_of_mass : array_like, shape (3,)
        CG from the centre of the spring ring, in body axes [m].

    Raises
    ------
    ValueError
        If the mass is not positive or the inertia is not that of a mass distribution.

    Examples
    --------
    >>> from satsep_ot.dynamics.separation import Body
    >>> Body(100.0, [9.35, 8.0, 9.35], [0.0, 0.4, 0.0]).parameters().size
    10
    """

    mass: Annotated[float, Parameter(Sign.POSITIVE)]
    inertia: Annotated[Array, Parameter((Sign.POSITIVE,) * 3 + (Sign.ANY,) * 3, TENSOR)]
    center_of_mass: Annotated[Array, Parameter(elements=AXES)] = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self):
        inertia = np.asarray(self.inertia, dtype=float)
        inertia = np.diag(inertia) if inertia.shape == (3,) else inertia
        if inertia.shape != (3, 3) or not np.array_equal(inertia, inertia.T):
            raise ValueError(
                f"inertia = {self.inertia!r}; it must be 3 principal moments or a symmetric 3 x 3 tensor [kg m2]"
            )
        object.__setattr__(self, "inertia", inertia)
        object.__setattr__(self, "center_of_mass", np.asarray(self.center_of_mass, dtype=float))

    def parameters(self) -> np.ndarray:
        """Mass, six tensor elements and CG, as they stand in the flat parameter vector, shape (10,)."""
        i = self.inertia
        return np.array([self.mass, i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2], *self.center_of_mass])

    def with_parameters(self, vector: np.ndarray) -> "Body":
        """The body that has these parameters: the inverse of `parameters`."""
        mass, *elements = vector[:7]
        return Body(float(mass), inertia_tensor(*elements), np.array(vector[7:]))


def inertia_tensor(xx: Array, yy: Array, zz: Array, xy: Array, xz: Array, yz: Array) -> np.ndarray:
    """Symmetric tensors of shape (..., 3, 3) from their elements, each of shape (...,) [kg m2]."""
    return np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=-1).reshape(*np.shape(xx), 3, 3)


def is_inertia(moments: np.ndarray) -> np.ndarray:
    """Whether a body can have these principal moments: all positive, none above the sum of the other two.

    Parameters
    ----------
    moments : ndarray, shape (..., 3)
        In ascending order [kg m2], as `numpy.linalg.eigvalsh` gives them.

    Returns
    -------
    possible : ndarray of bool, shape (...,)

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.dynamics.separation import is_inertia
    >>> print(is_inertia(np.array([[1.0, 2.0, 3.0], [1.0, 2.0, 3.1], [-1.0, 2.0, 2.0]])))
    [ True False False]
    """
    # The tolerance is that of a thin disc, whose moments are only known to some digits.
    return (moments[..., 0] > 0.0) & (moments[..., 0] + moments[..., 1] >= moments[..., 2] * (1.0 - 1e-9))


@dataclass(frozen=True)
class Separation:
    """Everything that one separation depends on, in SI units and radians.

    Body axes: y is the separation axis; both bodies' axes are parallel when stowed, but for the mounting error.

    Parameters
    ----------
    platform, satellite : Body
        The launch vehicle stage and the satellite.
    springs : Springs
        At least one.
    force_line : ForceLine
        GUIDED, STRUT or NORMAL.
    attitude : array_like, shape (4,)
        Quaternion of the platform at t = 0, body to ECI.
    rates : array_like, shape (3,)
        Rates of the stack at t = 0 in platform axes [rad/s].
    mounting_error : array_like, shape (3,)
        Rotation vector of the satellite in platform axes [rad], about the ring centre.
    stowed_length : float
        Distance l_0 between the seats of a stowed spring [m]; positive for STRUT, 0 for the others.
    pivot : Pivot
        The point of the stack that `orbit` speaks of.
    orbit : Orbit or None
        None: no gravity.
    gradient_torque : bool
        Whether the gravity-gradient torque acts.
    envelope : array_like, shape (E, 3), or None
        Points of the satellite from its ring centre in its axes [m]; their clearance in the recess is asked for.
    recess_radius, recess_depth : float
        The platform's recess [m]: a cylinder about y from its ring plane, y = 0, to y = depth. Radius 0: no cylinder.
    recess_planes : array_like, shape (W, 4), or None
        Plane walls of the recess: a normal into the free side and an offset h [m]; free is where normal . r >= h, with
        r from the platform's ring centre. Normals are scaled to length 1, the offsets with them.
    impulse, angular_impulse : array_like, shape (3,)
        What bolts or a clamp band give the satellite at t = 0, and the platform the opposite of: Delta p [N s] at the
        ring centre, and Delta h [N m s], in platform axes.
    guide_friction : float
        Friction coefficient between rod and guide. Only the NORMAL line loads the guide laterally: 0 for the others.
    recontact : Recontact or None
        The window in which the smallest distance after the release is asked for; it needs an orbit.
    horizon : float
        When the simulation gives up [s].
    contact, rails, hold_downs : Contact, Rails, HoldDowns or None
        What the bodies touch and what holds them; see `satsep_ot.dynamics.contact`. Without `contact` the deck holds
        nothing, and a run in which the satellite sinks into it fails.
    coast_times : tuple of float
        Times after the last release [s] at which distance and attitude are quantities of interest.

    Raises
    ------
    ValueError
        If a value is not allowed; the message names it.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.dynamics.separation import Body, Separation, Springs
    >>> from satsep_ot.dynamics.simulation import simulate
    >>> angle = np.pi * np.array([1, 3, 5, 7]) / 4
    >>> springs = Springs(angle, radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03)
    >>> separation = Separation(Body(1200.0, [1500.0, 600.0, 1500.0]), Body(100.0, [9.35, 8.0, 9.35]), springs)
    >>> print(f"{simulate(separation).quantity('axial_velocity')[0]:.6f} m/s")
    0.597913 m/s
    """

    platform: Body
    satellite: Body
    springs: Springs
    force_line: ForceLine = ForceLine.GUIDED
    attitude: Array = (1.0, 0.0, 0.0, 0.0)
    rates: Annotated[Array, Parameter(elements=AXES)] = (0.0, 0.0, 0.0)
    mounting_error: Annotated[Array, Parameter(elements=AXES)] = (0.0, 0.0, 0.0)
    stowed_length: Annotated[float, Parameter(Sign.POSITIVE)] = 0.0
    pivot: Pivot = Pivot.STACK
    orbit: Orbit | None = None
    gradient_torque: bool = False
    envelope: Array | None = None
    recess_radius: Annotated[float, Parameter(Sign.POSITIVE)] = 0.0
    recess_depth: Annotated[float, Parameter(Sign.POSITIVE)] = 0.0
    recess_planes: Array = None  # no planes; afterwards an array without rows
    impulse: Annotated[Array, Parameter(elements=AXES)] = (0.0, 0.0, 0.0)
    angular_impulse: Annotated[Array, Parameter(elements=AXES)] = (0.0, 0.0, 0.0)
    guide_friction: Annotated[float, Parameter(Sign.NOT_NEGATIVE)] = 0.0
    recontact: Recontact | None = None
    horizon: float = 10.0
    contact: Contact | None = None
    rails: Rails | None = None
    hold_downs: HoldDowns | None = None
    coast_times: tuple[float, ...] = ()

    def __post_init__(self):
        vectors = (("attitude", 4), ("rates", 3), ("mounting_error", 3), ("impulse", 3), ("angular_impulse", 3))
        for name, size in vectors:
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (size,):
                raise ValueError(f"{name} = {getattr(self, name)!r}; it must be {size} numbers")
            object.__setattr__(self, name, value)
        object.__setattr__(self, "force_line", ForceLine(self.force_line))
        norm = np.linalg.norm(self.attitude)
        if not 0.0 < norm < np.inf:
            raise ValueError(f"attitude = {self.attitude.tolist()}; it must be a quaternion of norm above 0")
        object.__setattr__(self, "attitude", self.attitude / norm)
        if not 0.0 < self.horizon < np.inf:
            raise ValueError(f"horizon = {self.horizon} s; it must be positive and finite")
        if self.gradient_torque and self.orbit is None:
            raise ValueError("gradient_torque is on without an orbit; give the orbit or switch it off")
        if self.recontact is not None and self.orbit is None:
            raise ValueError("recontact is asked for without an orbit; give the orbit or leave it out")
        planes = (
            np.zeros((0, 4)) if self.recess_planes is None else np.atleast_2d(np.array(self.recess_planes, dtype=float))
        )
        if planes.shape[1:] != (4,) or not np.isfinite(planes).all() or not planes[:, :3].any(axis=1).all():
            raise ValueError(
                f"recess_planes = {planes.tolist()}; each must be a normal, not 0, and an offset [m], all finite"
            )
        object.__setattr__(self, "recess_planes", planes / np.linalg.norm(planes[:, :3], axis=1, keepdims=True))
        if self.envelope is not None:
            points = np.atleast_2d(np.asarray(self.envelope, dtype=float))
            if points.shape[1:] != (3,) or not np.isfinite(points).all():
                raise ValueError(f"envelope has shape {points.shape}; it must be points of 3 finite coordinates [m]")
            object.__setattr__(self, "envelope", points)
        if self.contact is not None and self.contact.walls and self.envelope is None:
            raise ValueError("contact.walls is on without an envelope; give its points or switch it off")
        self._check_parameters()
        self.contact_elements()

    def _check_parameters(self):
        if self.envelope is not None and self.recess_points().size == 0:
            raise ValueError(
                f"envelope: no point lies in the recess, 0 <= y < {self.recess_depth} m (struts add their stowed "
                "length to y); give one that does"
            )
        problem = invalid_parameter(self, self.parameters())
        if problem:
            raise ValueError(problem)

    def parameters(self) -> np.ndarray:
        """The flat parameter vector, shape (P,); see `parameter_names`."""
        return np.concatenate(
            [
                self.platform.parameters(),
                self.satellite.parameters(),
                *(np.atleast_1d(getattr(self, name)) for name in parameter_fields(Separation)),
                self.springs.parameters(),
                self.recess_planes[:, 3],
                *(part.parameters() for part in self._contact_parts().values()),
            ]
        )

    def _contact_parts(self):
        """What there is of contact, by its name."""
        parts = {"contact": self.contact, "rails": self.rails, "hold_downs": self.hold_downs}
        return {name: part for name, part in parts.items() if part is not None}

    def contact_elements(self) -> tuple[np.ndarray, list[str]]:
        """The points that touch, bolts and pins, as records for the kernels, and their names; none without contact."""
        return elements_of(
            self.contact, self.rails, self.hold_downs, self.springs, self.recess_points(), self.recess_planes,
            self.recess_radius > 0.0,
        )  # fmt: skip

    def has_contact(self) -> bool:
        """Whether anything of `contact`, `rails`, `hold_downs` or pins that stick is there."""
        pins = self.springs.law_property("holds_back") & (self.springs.stiffness > 0.0)
        return bool(self._contact_parts()) or bool(pins.any())

    def with_parameters(self, vector: np.ndarray) -> "Separation":
        """The separation that has these parameters, and all else from this one: the inverse of `parameters`.

        Parameters
        ----------
        vector : array_like, shape (P,)
            In the order of `parameter_names` [SI].

        Returns
        -------
        separation : Separation
            Its `parameters` are the vector, to the last bit.

        Raises
        ------
        ValueError
            If the vector has another shape, or a value is not allowed; the message names it.

        Examples
        --------
        >>> from satsep_ot.model.case import load_case
        >>> separation = load_case("reference").separation
        >>> vector = separation.parameters()
        >>> vector[separation.parameter_names().index("satellite.mass")] = 110.0
        >>> separation.with_parameters(vector).satellite.mass
        110.0
        """
        vector = np.array(vector, dtype=float)
        where = self.parameter_places()
        if vector.shape != (len(where),):
            raise ValueError(f"the parameter vector has shape {vector.shape}; it must be ({len(where)},)")
        numbers: dict[str, list[float]] = {}
        for place, value in zip(where, vector, strict=True):
            owner = place.path.split(".")[0]
            numbers.setdefault(owner, []).append(float(value))
        # Not `replace`: attitude and planes, scaled to length 1 once more, would change in the last bit.
        changed = copy.copy(self)
        planes = self.recess_planes.copy()
        planes[:, 3] = numbers.pop("recess_planes", [])
        object.__setattr__(changed, "recess_planes", planes)
        for owner in ("platform", "satellite", "springs", *self._contact_parts()):
            part = getattr(self, owner).with_parameters(np.array(numbers.pop(owner)))
            object.__setattr__(changed, owner, part)
        for name, values in numbers.items():
            size = len(parameter_fields(Separation)[name].elements)
            object.__setattr__(changed, name, values[0] if size == 1 else np.array(values))
        changed._check_parameters()
        return changed

    def parameter_places(self) -> list[Place]:
        """What stands where in the flat parameter vector, P places; springs and planes are numbered from 0."""
        parts = self._contact_parts()
        return [
            *_COMMON_PLACES,
            *(place for i in range(len(self.springs)) for place in places(Springs, "springs", i)),
            *(Place("recess_planes.offset", "", Sign.ANY, i) for i in range(len(self.recess_planes))),
            *(place for name in ("contact", "rails") if name in parts for place in places(type(parts[name]), name)),
            *(place for i in range(len(parts.get("hold_downs", ()))) for place in places(HoldDowns, "hold_downs", i)),
        ]

    def parameter_names(self) -> list[str]:
        """The P names of the flat parameter vector."""
        return [place.name for place in self.parameter_places()]

    def unused_parameters(self) -> dict[str, str]:
        """Names of the parameters that play no part in this separation, each with the reason.

        Those of springs and guides are 0.
        """
        unused = self._zero_parameters()
        if self.envelope is None:
            recess = [place.name for place in self.parameter_places() if place.path.startswith("recess_")]
            unused |= dict.fromkeys(recess, "only the points of an envelope are followed through a recess")
        elif self.recess_radius == 0.0:
            unused["recess_radius"] = "planes alone bound the recess"
        return unused

    def parameter_signs(self) -> list[Sign]:
        """The sign that each of the P parameters must have in this separation; ZERO where it plays no part."""
        zero = self._zero_parameters()
        return [Sign.ZERO if place.name in zero else self._sign_needed(place) for place in self.parameter_places()]

    @cached_property
    def parameter_limits(self) -> np.ndarray:
        """The smallest and the largest number of each of these signs, shape (P, 2)."""
        return np.array([sign.limits for sign in self.parameter_signs()])

    def _zero_parameters(self):
        zero = {}
        if not self.force_line.has_stowed_length:
            zero["stowed_length"] = "only struts have a stowed length"
        if not self.force_line.loads_guide:
            zero["guide_friction"] = "only the force line NORMAL loads the guides laterally"
        for i in np.flatnonzero(~self.springs.law_property("has_stiffness")):
            # Pins that stick have a stiffness.
            sticks = self.springs.law_property("holds_back")[i] and self.springs.stiffness[i] > 0.0
            names = ("deformation",) if sticks else ("stiffness", "deformation")
            for name in names:
                zero[f"springs[{i}].{name}"] = "another law than the linear one holds for this spring"
        return zero

    def _sign_needed(self, place):
        if place.path in ("recess_radius", "recess_depth") and self.envelope is None:
            return Sign.ANY
        # Radius 0 is a recess without a cylinder, which planes must bound.
        if place.path == "recess_radius" and len(self.recess_planes):
            return Sign.NOT_NEGATIVE
        return place.sign

    def recess_points(self) -> np.ndarray:
        """The envelope points that start in the recess, shape (E', 3) [m]: those whose clearance is followed."""
        if self.envelope is None:
            return np.empty((0, 3))
        y = self.envelope[:, 1] + self.stowed_length  # a strut's satellite stands that much above the ring plane
        return self.envelope[(y >= 0.0) & (y < self.recess_depth)]

    def stack_orbit(self) -> Orbit:
        """The orbit of O, the common CG of the joined stack, at t = 0; only where there is an orbit.

        Where that is the platform's, the nominal masses and CGs say where O is.
        """
        if self.orbit is None:
            raise ValueError("the separation has no orbit")
        _, *motion = self.platform_orbit()
        share = self.satellite.mass / (self.platform.mass + self.satellite.mass)
        arm = share * (self.satellite.center_of_mass - self.platform.center_of_mass)
        turn = rotation_matrix(self.attitude)
        position = np.array(motion[:3]) + turn @ arm
        velocity = np.array(motion[3:]) + turn @ np.cross(self.rates, arm)
        return Orbit(position, velocity, self.orbit.mu, self.orbit.j2)

    def platform_orbit(self) -> np.ndarray:
        """mu, ECI position and velocity of the platform's CG at t = 0, shape (7,)."""
        if self.orbit is None:
            return np.zeros(7)
        pivot = self.platform.center_of_mass
        if self.pivot == Pivot.STACK:
            total = self.platform.mass + self.satellite.mass
            pivot = (self.platform.mass * pivot + self.satellite.mass * self.satellite.center_of_mass) / total
        arm = self.platform.center_of_mass - pivot
        turn = rotation_matrix(self.attitude)
        position = self.orbit.position + turn @ arm
        return np.concatenate([[self.orbit.mu], position, self.orbit.velocity + turn @ np.cross(self.rates, arm)])


# The flat parameter vector as the kernels take it: this record, one for each spring, then the offset of each plane.
_BODY_PARAMETERS = record(*record_fields(Body))
PARAMETERS = named(("platform", _BODY_PARAMETERS), ("satellite", _BODY_PARAMETERS), *record_fields(Separation))
SPRING_PARAMETERS = named(*record_fields(Springs))

_COMMON_PLACES = [*places(Body, "platform"), *places(Body, "satellite"), *places(Separation)]


def _first(path):
    return next(k for k, place in enumerate(_COMMON_PLACES) if place.path.startswith(path))


# Where the parameters of the bodies start in the flat vector.
PLATFORM, SATELLITE = _first("platform"), _first("satellite")


def invalid_parameter(separation: Separation, parameters: np.ndarray) -> str | None:
    """What is wrong with a parameter vector, in one sentence that names it; None if nothing is."""
    zero = separation._zero_parameters()
    for name, sign, value in zip(separation.parameter_names(), separation.parameter_signs(), parameters, strict=True):
        if not np.abs(value) < LARGEST:
            return f"{name} = {value}; it must be a finite number of size below {LARGEST:g}"
        if not sign.allows(value):
            return f"{name} = {value}; it must be {sign.value}" + (f", since {zero[name]}" if name in zero else "")
    for body, start in (("platform", PLATFORM), ("satellite", SATELLITE)):
        moments = np.linalg.eigvalsh(inertia_tensor(*parameters[start + 1 : start + 7]))
        if not is_inertia(moments):
            return (
                f"{body}.inertia has the principal moments {moments} kg m2; they must be positive, and none above "
                "the sum of the other two (triangle inequality)"
            )
    return None
