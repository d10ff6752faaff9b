"""A separation: its data, and its simulation from the stowed stack to the last release and out of the recess.

The model is that of Hu et al. (2017), section 2, made well-posed: see `satsep_ot.dynamics.springs` for the force lines
and `satsep_ot.dynamics.rigid_body` for the equations of motion. A spring starts to push at its delay and is released,
once and for all, when its stroke reaches min(L, xi): a pusher never pulls. Both instants are located as events; no
step crosses them.
"""

import enum
from dataclasses import dataclass, field

import numpy as np

from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.springs import ForceLine

# The flat parameter vector of a run. A uncertain input or a design variable is a direction in this space.
_INERTIA_NAMES = ("xx", "yy", "zz", "xy", "xz", "yz")
_BODY_NAMES = ("mass", *(f"inertia.{name}" for name in _INERTIA_NAMES), *(f"center_of_mass.{axis}" for axis in "xyz"))
_COMMON_NAMES = (
    *(f"platform.{name}" for name in _BODY_NAMES),
    *(f"satellite.{name}" for name in _BODY_NAMES),
    *(f"rates.{axis}" for axis in "xyz"),
    *(f"mounting_error.{axis}" for axis in "xyz"),
    "stowed_length",
    "recess.radius",
    "recess.depth",
)
_SPRING_NAMES = ("angle", "radius", "stiffness", "deformation", "stroke", "cant", "delay")


class Pivot(enum.IntEnum):
    """The point that the joined stack turns about and that follows the orbit."""

    STACK = 0
    PLATFORM = 1


class Status(enum.IntEnum):
    """How a run ended; `sentence` says it in words."""

    OK = 0
    NO_RELEASE = 1
    NO_EXIT = 2
    STEP_UNDERFLOW = 3
    TOO_MANY_STEPS = 4
    PENETRATION = 5
    INVALID_PARAMETERS = 6

    @property
    def sentence(self):
        return _SENTENCES[self]


_SENTENCES = {
    Status.OK: "the separation completed",
    Status.NO_RELEASE: "a spring was not released within the horizon",
    Status.NO_EXIT: "an envelope point did not leave the recess within the horizon",
    Status.STEP_UNDERFLOW: "the step size fell below the resolution of time: the motion is too violent or not finite",
    Status.TOO_MANY_STEPS: "the motion needed more steps than are allowed: it is too violent for the horizon",
    Status.PENETRATION: "the bodies penetrate each other by more than 1 mm at a spring seat",
    Status.INVALID_PARAMETERS: "a parameter is not finite or not physical",
}


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

    mass: float
    inertia: np.ndarray
    center_of_mass: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self):
        inertia = np.asarray(self.inertia, dtype=float)
        inertia = np.diag(inertia) if inertia.shape == (3,) else inertia
        if inertia.shape != (3, 3) or not np.array_equal(inertia, inertia.T):
            raise ValueError(
                f"inertia = {self.inertia!r}; it is 3 principal moments or a symmetric 3 x 3 tensor [kg m2]"
            )
        object.__setattr__(self, "inertia", inertia)
        object.__setattr__(self, "center_of_mass", np.asarray(self.center_of_mass, dtype=float))

    def parameters(self):
        """Mass, six tensor elements and CG, as they stand in the flat parameter vector."""
        i = self.inertia
        return np.array([self.mass, i[0, 0], i[1, 1], i[2, 2], i[0, 1], i[0, 2], i[1, 2], *self.center_of_mass])


@dataclass(frozen=True)
class Springs:
    """The separation springs; every field is an array of shape (N,), or a number that holds for all.

    Parameters
    ----------
    angle : position on the ring [rad], seat at R (cos alpha, 0, sin alpha) from the ring centre (eq. 5).
    radius : ring radius R [m].
    stiffness : K [N/m], positive.
    deformation : initial compression xi [m], positive.
    stroke : L [m], positive; the spring is released at min(L, xi).
    cant : tangential tilt of the guide [rad], towards increasing angle.
    delay : release delay tau [s], not negative.

    Examples
    --------
    >>> from satsep_ot.dynamics.separation import Springs
    >>> len(Springs(angle=[0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03))
    4
    """

    angle: np.ndarray
    radius: np.ndarray
    stiffness: np.ndarray
    deformation: np.ndarray
    stroke: np.ndarray
    cant: np.ndarray = 0.0
    delay: np.ndarray = 0.0

    def __post_init__(self):
        count = np.size(self.angle)
        for name in _SPRING_NAMES:
            value = np.asarray(getattr(self, name), dtype=float)
            if value.ndim > 1 or (value.ndim == 1 and value.size != count) or count == 0:
                raise ValueError(
                    f"springs.{name} has shape {value.shape}; one number or {count} (at least 1) are allowed"
                )
            object.__setattr__(self, name, np.broadcast_to(value, count).copy())

    def __len__(self):
        return self.angle.size

    def parameters(self):
        """Seven numbers a spring, spring by spring, as they stand in the flat parameter vector."""
        return np.stack([getattr(self, name) for name in _SPRING_NAMES], axis=1).ravel()


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
        GUIDED or STRUT.
    stowed_length : float
        Distance l_0 between the seats of a stowed spring [m]; positive for STRUT, 0 for GUIDED.
    attitude : array_like, shape (4,)
        Quaternion of the platform at t = 0, body to ECI.
    rates : array_like, shape (3,)
        Rates of the stack at t = 0 in platform axes [rad/s].
    mounting_error : array_like, shape (3,)
        Rotation vector of the satellite in platform axes [rad], about the ring centre.
    pivot : Pivot
        The point of the stack that `orbit` speaks of.
    orbit : Orbit or None
        None: no gravity.
    gradient_torque : bool
        Whether the gravity-gradient torque acts.
    envelope : array_like, shape (E, 3), or None
        Points of the satellite from its ring centre in its axes [m], whose clearance in the recess is asked for.
    recess_radius, recess_depth : float
        The platform's recess [m]: a cylinder about y from its ring plane, y = 0, up to y = depth.
    horizon : float
        When the simulation gives up [s].

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
    stowed_length: float = 0.0
    attitude: np.ndarray = (1.0, 0.0, 0.0, 0.0)
    rates: np.ndarray = (0.0, 0.0, 0.0)
    mounting_error: np.ndarray = (0.0, 0.0, 0.0)
    pivot: Pivot = Pivot.STACK
    orbit: Orbit | None = None
    gradient_torque: bool = False
    envelope: np.ndarray | None = None
    recess_radius: float = 0.0
    recess_depth: float = 0.0
    horizon: float = 10.0

    def __post_init__(self):
        for name, size in (("attitude", 4), ("rates", 3), ("mounting_error", 3)):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.shape != (size,):
                raise ValueError(f"{name} = {getattr(self, name)!r}; {size} numbers are allowed")
            object.__setattr__(self, name, value)
        norm = np.linalg.norm(self.attitude)
        if not 0.0 < norm < np.inf:
            raise ValueError(f"attitude = {self.attitude.tolist()}; a quaternion of norm above 0 is allowed")
        object.__setattr__(self, "attitude", self.attitude / norm)
        if not 0.0 < self.horizon < np.inf:
            raise ValueError(f"horizon = {self.horizon} s; a positive time is allowed")
        if self.gradient_torque and self.orbit is None:
            raise ValueError("gradient_torque is on without an orbit; give the orbit or switch it off")
        if self.envelope is not None:
            points = np.atleast_2d(np.asarray(self.envelope, dtype=float))
            if points.shape[1:] != (3,) or not np.isfinite(points).all():
                raise ValueError(f"envelope has shape {points.shape}; finite points of 3 coordinates [m] are allowed")
            object.__setattr__(self, "envelope", points)
            if self.recess_points().size == 0:
                raise ValueError(
                    f"envelope: no point lies in the recess, 0 <= y < {self.recess_depth} m; give one that does"
                )
        problem = invalid_parameter(self, self.parameters())
        if problem:
            raise ValueError(problem)

    def parameters(self):
        """The flat parameter vector, shape (P,); see `parameter_names`."""
        return np.concatenate(
            [
                self.platform.parameters(),
                self.satellite.parameters(),
                self.rates,
                self.mounting_error,
                [self.stowed_length, self.recess_radius, self.recess_depth],
                self.springs.parameters(),
            ]
        )

    def parameter_names(self):
        """The P names of the flat parameter vector."""
        springs = [f"springs[{i}].{name}" for i in range(len(self.springs)) for name in _SPRING_NAMES]
        return [*_COMMON_NAMES, *springs]

    def recess_points(self):
        """The envelope points that start in the recess, shape (E', 3) [m]: those whose clearance is followed."""
        if self.envelope is None:
            return np.empty((0, 3))
        y = self.envelope[:, 1]
        return self.envelope[(y >= 0.0) & (y < self.recess_depth)]

    def platform_orbit(self):
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


COMMON_SIZE = len(_COMMON_NAMES)
SPRING_SIZE = len(_SPRING_NAMES)

# Positions in the flat parameter vector, for the kernels.
PLATFORM, SATELLITE, RATES, MOUNTING_ERROR = 0, 10, 20, 23
STOWED, RECESS_RADIUS, RECESS_DEPTH = 26, 27, 28


def invalid_parameter(separation, parameters):
    """What is wrong with a parameter vector, in one sentence that names it; None if nothing is."""
    names = separation.parameter_names()
    for name, value in zip(names, parameters, strict=True):
        last = name.split(".")[-1]
        if not np.isfinite(value):
            return f"{name} = {value}; a finite number is allowed"
        if last in ("mass", "stiffness", "deformation", "stroke") and value <= 0.0:
            return f"{name} = {value}; a positive number is allowed"
        if name.startswith("springs") and last in ("radius", "delay") and value < 0.0:
            return f"{name} = {value}; a number that is not negative is allowed"
    for body, start in (("platform", PLATFORM), ("satellite", SATELLITE)):
        xx, yy, zz, xy, xz, yz = parameters[start + 1 : start + 7]
        moments = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if moments[0] <= 0.0:
            return f"{body}.inertia has the principal moments {moments} kg m2; positive ones are allowed"
        if moments[0] + moments[1] < moments[2] * (1.0 - 1e-9):
            return (
                f"{body}.inertia has the principal moments {moments} kg m2; none may exceed the sum of the other two "
                "(triangle inequality)"
            )
    stowed = parameters[STOWED]
    if separation.force_line == ForceLine.STRUT and stowed <= 0.0:
        return (
            f"stowed_length = {stowed} m; a strut needs a positive one, since with coinciding seats it has no "
            "direction and buckles"
        )
    if separation.force_line == ForceLine.GUIDED and stowed != 0.0:
        return f"stowed_length = {stowed} m; a guided spring has 0 (only struts have a stowed length)"
    if separation.envelope is not None and (parameters[RECESS_RADIUS] <= 0.0 or parameters[RECESS_DEPTH] <= 0.0):
        return f"recess = {parameters[RECESS_RADIUS : RECESS_DEPTH + 1]} m; a positive radius and depth are allowed"
    return None
