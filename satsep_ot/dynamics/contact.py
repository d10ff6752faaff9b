"""What the bodies touch and what holds them: the deck, walls, the rails of a dispenser, late bolts.

The laws of contact are those of `satsep_ot.dynamics.kernels.contact`.
"""

import copy
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from satsep_ot.dynamics.kernels import contact as kernel
from satsep_ot.dynamics.kernels.records import ELEMENT, named
from satsep_ot.dynamics.orbit import Array
from satsep_ot.dynamics.parameter_vector import Parameter, Sign, parameter_fields, record_fields
from satsep_ot.dynamics.springs import Springs

LARGEST_NUMBER = 160  # of elements of one separation
SLIDING_SPEED = 1e-3


class _Part:
    """Parameters in a block of their own, of which a separation may have none."""

    def parameters(self) -> np.ndarray:
        """The numbers as they stand in the flat parameter vector."""
        return np.concatenate([np.atleast_1d(getattr(self, name)) for name in self._fields()])

    def with_parameters(self, vector: np.ndarray) -> Any:
        """The same with these parameters: the inverse of `parameters`."""
        numbers = [float(number) for number in vector]
        values = {}
        for name, entry in self._fields().items():
            size = len(entry.elements)
            values[name] = numbers[0] if size == 1 else np.array(numbers[:size])
            del numbers[:size]
        # Not a new one: a scattered value may be one that the nominal one must not be.
        changed = copy.copy(self)
        for name, value in values.items():
            object.__setattr__(changed, name, value)
        return changed

    def _fields(self):
        return parameter_fields(type(self))


@dataclass(frozen=True)
class Contact(_Part):
    """Contact of the satellite's foot with the deck, and of envelope points with the walls of the recess.

    Parameters
    ----------
    radius : of the edge of the satellite's ring [m].
    level : height of the deck over the platform's ring centre (for struts over where the stowed satellite stands) [m].
    stiffness : of each point [N/m].
    restitution, impact_speed : share of the speed [m/s] of an impact that is left after it; above 0, at most 1. Both
        give the damping lambda of the law of Hunt and Crossley.
    damping : lambda [s/m] beside that.
    friction : coefficient of friction.
    sliding_speed : below which friction fades [m/s].
    points : number of points on the ring's edge, or their places from the satellite's ring centre, (K, 3) [m]; 0: the
        deck holds nothing.
    first_angle : of the points on the ring [rad].
    walls : whether the walls of the recess hold the envelope points.
    surface : what the curved wall of the recess is, of which the radius is the size: one of
        `satsep_ot.dynamics.kernels.contact.SURFACES`. Clearances are those from a cylinder.

    Raises
    ------
    ValueError
        If a value is not allowed.
    """

    radius: Annotated[float, Parameter(Sign.POSITIVE)]
    level: Annotated[float, Parameter()] = 0.0
    stiffness: Annotated[float, Parameter(Sign.POSITIVE)] = 1e7
    restitution: Annotated[float, Parameter(Sign.POSITIVE)] = 0.5
    impact_speed: Annotated[float, Parameter(Sign.POSITIVE)] = 5e-3
    damping: Annotated[float, Parameter(Sign.NOT_NEGATIVE)] = 0.0
    friction: Annotated[float, Parameter(Sign.NOT_NEGATIVE)] = 0.2
    sliding_speed: Annotated[float, Parameter(Sign.POSITIVE)] = SLIDING_SPEED
    points: Any = 48
    first_angle: float = 0.0
    walls: bool = False
    surface: str = "cylinder"

    def __post_init__(self):
        _check_restitution("contact", self.restitution)
        if self.surface not in kernel.SURFACES:
            raise ValueError(f"contact.surface = {self.surface!r}; it must be one of {', '.join(kernel.SURFACES)}")
        if np.ndim(self.points) == 0:
            if not (int(self.points) == self.points and 0 <= self.points <= 120):
                raise ValueError(f"contact.points = {self.points}; it must be a number from 0 to 120, or places")
            object.__setattr__(self, "points", int(self.points))
        else:
            places = np.atleast_2d(np.array(self.points, dtype=float))
            if places.ndim != 2 or places.shape[1] != 3 or len(places) > 120 or not np.isfinite(places).all():
                raise ValueError(f"contact.points has shape {places.shape}; it must be at most 120 rows of x, y, z [m]")
            object.__setattr__(self, "points", places)

    def angles(self) -> np.ndarray:
        """Angles of the points on the ring [rad]."""
        if np.ndim(self.points):
            return np.empty(0)
        return self.first_angle + 2.0 * np.pi * np.arange(self.points) / max(self.points, 1)

    def feet(self) -> np.ndarray:
        """The points that are given, (K, 3) [m]."""
        return np.array(self.points) if np.ndim(self.points) else np.empty((0, 3))


@dataclass(frozen=True)
class Rails(_Part):
    """The square channel of a dispenser, in the platform, and the rails of the satellite in it.

    Parameters
    ----------
    half_width : of the satellite across its rails [m].
    clearance : between each rail and its wall [m]; negative for an interference.
    satellite : ends of the satellite's rails, (2,), y from its ring centre [m].
    mouth : end of the channel, y from the platform's ring centre [m].
    stiffness, restitution, impact_speed, damping, friction, sliding_speed : as of `Contact`.

    Raises
    ------
    ValueError
        If a value is not allowed.
    """

    half_width: Annotated[float, Parameter(Sign.POSITIVE)]
    clearance: Annotated[float, Parameter()]
    satellite: Annotated[Array, Parameter(elements=("start", "end"))]
    mouth: Annotated[float, Parameter()]
    stiffness: Annotated[float, Parameter(Sign.POSITIVE)] = 1e6
    restitution: Annotated[float, Parameter(Sign.POSITIVE)] = 0.5
    impact_speed: Annotated[float, Parameter(Sign.POSITIVE)] = 5e-3
    damping: Annotated[float, Parameter(Sign.NOT_NEGATIVE)] = 0.0
    friction: Annotated[float, Parameter(Sign.NOT_NEGATIVE)] = 0.1
    sliding_speed: Annotated[float, Parameter(Sign.POSITIVE)] = SLIDING_SPEED

    def __post_init__(self):
        _check_restitution("rails", self.restitution)
        ends = np.array(self.satellite, dtype=float)
        if ends.shape != (2,) or not ends[0] < ends[1]:
            raise ValueError(f"rails.satellite = {self.satellite!r}; it must be two ends [m], the smaller one first")
        object.__setattr__(self, "satellite", ends)
        if not ends[0] < self.mouth:
            raise ValueError(
                f"rails.mouth = {self.mouth} m; it must be above rails.satellite = {ends.tolist()} m: the channel does "
                "not overlap the satellite's rails"
            )
        if not self.half_width + self.clearance > 0.0:
            raise ValueError(f"rails.clearance = {self.clearance} m; it must be above -{self.half_width} m")


@dataclass(frozen=True)
class HoldDowns:
    """Bolts, or the segments of a clamp band, that let go late: ball joints until their release.

    Parameters
    ----------
    angle, radius : place on the ring's plane, arrays of shape (H,) or one for all [rad, m].
    release : when each lets go [s].
    stiffness : [N/m].
    damping_ratio : zeta; the damping time is T = 2 zeta sqrt(m_r / k) with the reduced mass m_r.
    damping_time : T [s] beside that.

    Raises
    ------
    ValueError
        If the shapes do not fit, or a release is not finite.
    """

    angle: Annotated[Array, Parameter()]
    radius: Annotated[Array, Parameter(Sign.NOT_NEGATIVE)]
    release: Annotated[Array, Parameter(Sign.NOT_NEGATIVE)]
    stiffness: Annotated[Array, Parameter(Sign.POSITIVE)] = 1e8
    damping_ratio: Annotated[Array, Parameter(Sign.NOT_NEGATIVE)] = 0.2
    damping_time: Annotated[Array, Parameter(Sign.NOT_NEGATIVE)] = 0.0

    def __post_init__(self):
        count = np.size(self.angle)
        for name in parameter_fields(HoldDowns):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.ndim > 1 or (value.ndim == 1 and value.size != count) or count == 0:
                raise ValueError(f"hold_downs.{name} has shape {value.shape}; it must be one number or {count}")
            object.__setattr__(self, name, np.broadcast_to(value, count).copy())
        if not np.isfinite(self.release).all():
            raise ValueError(
                f"hold_downs.release = {self.release.tolist()} s; each must be finite: it is never released"
            )

    def __len__(self) -> int:
        return self.angle.size

    def parameters(self) -> np.ndarray:
        """Six numbers each, as they stand in the flat parameter vector, shape (6 H,)."""
        return np.stack([getattr(self, name) for name in parameter_fields(HoldDowns)], axis=1).ravel()

    def with_parameters(self, vector: np.ndarray) -> "HoldDowns":
        """The same with these parameters: the inverse of `parameters`."""
        return HoldDowns(*np.array(vector, dtype=float).reshape(len(self), -1).T)

    def joined(self, other: "HoldDowns") -> "HoldDowns":
        """These and then those of `other`."""
        names = parameter_fields(HoldDowns)
        return HoldDowns(*(np.concatenate([getattr(self, name), getattr(other, name)]) for name in names))


CONTACT_PARAMETERS = named(*record_fields(Contact))
RAIL_PARAMETERS = named(*record_fields(Rails))
HOLD_DOWN_PARAMETERS = named(*record_fields(HoldDowns))


def _check_restitution(owner, restitution):
    if not 0.0 < restitution <= 1.0:
        raise ValueError(f"{owner}.restitution = {restitution}; it must be above 0 and at most 1")


def elements_of(
    contact: Contact | None,
    rails: Rails | None,
    hold_downs: HoldDowns | None,
    springs: Springs,
    points: np.ndarray,
    planes: np.ndarray,
    has_cylinder: bool,
) -> tuple[np.ndarray, list[str]]:
    """The elements of contact of a separation, without the numbers of a run, and what messages call each.

    Parameters
    ----------
    contact, rails, hold_downs, springs
        As of the separation.
    points, planes : ndarray
        Envelope points and plane walls of the recess.
    has_cylinder : bool
        Whether the recess has a cylinder.

    Returns
    -------
    elements : ndarray of records ELEMENT, shape (M,)
    names : list of str

    Raises
    ------
    ValueError
        If there are more than 160.
    """
    rows: list[dict[str, Any]] = []
    names: list[str] = []

    def add(name, **values):
        rows.append(values)
        names.append(name)

    if contact is not None:
        for number in range(len(contact.angles()) + len(contact.feet())):
            add(f"deck{number}", kind=kernel.PLANE, group=kernel.DECK, number=number, normal=(0.0, 1.0, 0.0))
        if contact.walls:
            curved = list(kernel.SURFACES).index(contact.surface)
            for number in range(len(points)):
                if has_cylinder:
                    add(f"cyl{number}", kind=kernel.CURVED, group=kernel.RECESS, number=number, wall=curved)
                for wall, plane in enumerate(planes):
                    add(
                        f"plane{wall}.{number}", kind=kernel.PLANE, group=kernel.RECESS, number=number, wall=wall,
                        normal=plane[:3],
                    )  # fmt: skip
    if rails is not None:
        corners = [(x, z) for x in (1.0, -1.0) for z in (1.0, -1.0)]
        for x, z in corners:
            for axis in (0, 2):
                side = (x, 0.0, 0.0) if axis == 0 else (0.0, 0.0, z)
                letter, where = "xyz"[axis], f"{x:g}{z:g}"
                for word, end in (("bot", 0.0), ("top", 1.0)):
                    add(
                        f"{word}_{letter}{where}", kind=kernel.PLANE, group=kernel.RAIL_END, other=(x, end, z),
                        normal=tuple(-number for number in side),
                    )  # fmt: skip
                add(f"mouth_{letter}{where}", kind=kernel.FACE, group=kernel.RAIL_MOUTH, other=(x, 0.0, z), normal=side)
    for number in range(0 if hold_downs is None else len(hold_downs)):
        add(f"hold{number}", kind=kernel.BOLT, group=kernel.HOLD_DOWN, number=number)
    for number, i in enumerate(np.flatnonzero(springs.law_property("holds_back") & (springs.stiffness > 0.0))):
        if springs.scale[i] > 0.0:
            add(f"pin{number}", kind=kernel.PINS, group=kernel.CONNECTOR, number=i)
    if len(rows) > LARGEST_NUMBER:
        raise ValueError(f"the contacts are {len(rows)} points; they must be at most {LARGEST_NUMBER}: give fewer")
    elements = np.zeros(len(rows), ELEMENT)
    for element, row in zip(elements, rows, strict=True):
        for name, value in row.items():
            element[name] = value
    return elements, names


def element_places(separation: Any) -> tuple[np.ndarray, np.ndarray]:
    """Where the elements of contact of a separation are, in their order.

    Parameters
    ----------
    separation : Separation

    Returns
    -------
    places : ndarray, shape (M, 3)
        From the ring centre of the body whose point it is, in its axes [m].
    on_platform : ndarray of bool, shape (M,)
        Whether that is the platform; else the satellite.
    """
    elements, _ = separation.contact_elements()
    contact, rails, bolts = separation.contact, separation.rails, separation.hold_downs

    def on_ring(angle, radius):
        return radius * np.cos(angle), 0.0, radius * np.sin(angle)

    def place(element):
        number = element["number"]
        if element["group"] == kernel.DECK:
            feet = contact.feet()
            return feet[number] if len(feet) else on_ring(contact.angles()[number], contact.radius)
        if element["group"] == kernel.RECESS:
            return separation.recess_points()[number]
        if element["group"] == kernel.HOLD_DOWN:
            return on_ring(bolts.angle[number], bolts.radius[number])
        if element["group"] == kernel.CONNECTOR:
            return separation.springs.seats()[number]
        x, end, z = element["other"]
        if element["group"] == kernel.RAIL_END:
            return x * rails.half_width, rails.satellite[int(end)], z * rails.half_width
        width = rails.half_width + rails.clearance
        return x * width, rails.mouth, z * width

    places = np.array([place(element) for element in elements]).reshape(-1, 3)
    return places, elements["group"] == kernel.RAIL_MOUTH
