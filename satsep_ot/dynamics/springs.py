"""The springs of a separation, and what the kernels take of them.

Force laws are rows of `satsep_ot.dynamics.kernels.force_laws`, force lines of `satsep_ot.dynamics.kernels.force_lines`.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from satsep_ot.dynamics.force_interpolation import Interpolation as Interpolation
from satsep_ot.dynamics.force_interpolation import force_pieces
from satsep_ot.dynamics.kernels.force_laws import ForceLaw as ForceLaw
from satsep_ot.dynamics.kernels.force_laws import Law as Law
from satsep_ot.dynamics.kernels.force_lines import ForceLine as ForceLine
from satsep_ot.dynamics.kernels.force_lines import Line as Line
from satsep_ot.dynamics.kernels.records import CUBIC, SPRING
from satsep_ot.dynamics.orbit import Array
from satsep_ot.dynamics.parameter_vector import Parameter, Sign, parameter_fields


@dataclass(frozen=True)
class Springs:
    """The separation springs; every number is an array of shape (N,), or one that holds for all.

    Parameters
    ----------
    angle : position on the ring [rad], seat at R (cos alpha, 0, sin alpha) from the ring centre (eq. 5).
    radius : ring radius R [m].
    stiffness : K [N/m], positive; 0 where another law than the linear one holds.
    deformation : initial compression xi [m], positive; 0 where another law than the linear one holds.
    stroke : L [m], positive; a linear spring is released at min(L, xi), another one at L.
    cant : tangential tilt of the guide [rad], towards increasing angle.
    delay : release delay tau [s], not negative.
    scale : factor of the force, 1 by default; 0 is a spring that has failed: it is absent. The force [N] of a FRICTION.
    tables : for each spring None or a measured force-stroke table, shape (K, 2): stroke [m], from 0, and force [N].
    laws : the `ForceLaw` of each spring; by default TABLE where there is a table and LINEAR elsewhere.
    interpolation : how the force is interpolated between the rows of the tables, MONOTONE by default.

    Raises
    ------
    ValueError
        If the shapes do not fit, or a table is not a table.

    Examples
    --------
    >>> from satsep_ot.dynamics.separation import Springs
    >>> len(Springs(angle=[0.8, 2.4, 3.9, 5.5], radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03))
    4
    """

    angle: Annotated[Array, Parameter()]
    radius: Annotated[Array, Parameter(Sign.NOT_NEGATIVE)]
    stiffness: Annotated[Array, Parameter(Sign.POSITIVE)]
    deformation: Annotated[Array, Parameter(Sign.POSITIVE)]
    stroke: Annotated[Array, Parameter(Sign.POSITIVE)]
    cant: Annotated[Array, Parameter()] = 0.0
    delay: Annotated[Array, Parameter(Sign.NOT_NEGATIVE)] = 0.0
    scale: Annotated[Array, Parameter(Sign.NOT_NEGATIVE)] = 1.0
    # None stands for the default while they are checked; afterwards they are there.
    tables: tuple = None  # type: ignore[assignment]
    laws: Array = None
    interpolation: Interpolation = Interpolation.MONOTONE

    def __post_init__(self):
        count = np.size(self.angle)
        for name in parameter_fields(Springs):
            value = np.asarray(getattr(self, name), dtype=float)
            if value.ndim > 1 or (value.ndim == 1 and value.size != count) or count == 0:
                raise ValueError(
                    f"springs.{name} has shape {value.shape}; it must be one number or {count} (at least 1)"
                )
            object.__setattr__(self, name, np.broadcast_to(value, count).copy())
        tables = (None,) * count if self.tables is None else tuple(self.tables)
        if len(tables) != count:
            raise ValueError(
                f"springs.tables has {len(tables)} entries; it must have one (or None) for each of {count} springs"
            )
        tables = tuple(
            None if table is None else _checked_table(i, table, self.stroke[i]) for i, table in enumerate(tables)
        )
        default = [ForceLaw.LINEAR if table is None else ForceLaw.TABLE for table in tables]
        laws = np.array(default if self.laws is None else self.laws, dtype=np.int64)
        if laws.shape != (count,) or any(
            ForceLaw(law).has_table != (tables[i] is not None) for i, law in enumerate(laws)
        ):
            raise ValueError(
                f"springs.laws = {laws.tolist()}; they must be one for each spring, and one with a table where there "
                "is a table"
            )
        object.__setattr__(self, "tables", tables)
        object.__setattr__(self, "laws", laws)
        object.__setattr__(self, "_pieces", self._make_pieces())

    def __len__(self) -> int:
        return self.angle.size

    def seats(self) -> np.ndarray:
        """The seats from the ring centre, R (cos alpha, 0, sin alpha) (eq. 5), shape (N, 3) [m]."""
        return np.stack(
            [self.radius * np.cos(self.angle), np.zeros(len(self)), self.radius * np.sin(self.angle)], axis=1
        )

    def guides(self) -> np.ndarray:
        """Directions of the guides in platform axes: y, tilted by the cant along the ring, shape (N, 3)."""
        ca, sa, cb, sb = np.cos(self.angle), np.sin(self.angle), np.cos(self.cant), np.sin(self.cant)
        return np.stack([-sb * sa, cb, sb * ca], axis=1)

    def release_strokes(self) -> np.ndarray:
        """The stroke at which each spring is released, min(L, xi) where it has a stiffness, else L, shape (N,) [m]."""
        return np.where(self.law_property("has_stiffness"), np.minimum(self.stroke, self.deformation), self.stroke)

    def law_property(self, name: str) -> np.ndarray:
        """For which springs a property of their law is true, bool (N,); see `satsep_ot.dynamics.springs.Law`."""
        return np.array([getattr(ForceLaw(law), name) for law in self.laws])

    def parameters(self) -> np.ndarray:
        """Eight numbers a spring, spring by spring, as they stand in the flat parameter vector, shape (8 N,)."""
        return np.stack([getattr(self, name) for name in parameter_fields(Springs)], axis=1).ravel()

    def with_parameters(self, vector: np.ndarray) -> "Springs":
        """The springs that have these parameters, with the same tables and laws: the inverse of `parameters`."""
        names = parameter_fields(Springs)
        columns = np.array(vector, dtype=float).reshape(len(self), len(names)).T
        # Not `replace`: a stroke that scatters may end beyond its table, which only the nominal one must not.
        changed = copy.copy(self)
        for name, column in zip(names, columns, strict=True):
            object.__setattr__(changed, name, column.copy())
        return changed

    def force_pieces(self) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
        """For each spring the cubics of its table, none without one; see `satsep_ot.dynamics.force_interpolation`.

        They follow from the stroke that the springs were made with: `with_parameters` leaves them as they are.
        """
        # Springs that version 0.1.0 saved do not have them.
        return self._pieces if hasattr(self, "_pieces") else self._make_pieces()

    def _make_pieces(self):
        none = np.empty(0), np.empty((0, 4))
        return tuple(
            none if table is None else force_pieces(table, stroke, self.interpolation)
            for table, stroke in zip(self.tables, self.stroke, strict=True)
        )

    def joined(self, other: "Springs") -> "Springs":
        """These springs and then those of `other`."""
        names = (*parameter_fields(Springs), "laws")
        values = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in names}
        return Springs(**values, tables=self.tables + other.tables, interpolation=self.interpolation)


def _checked_table(i, table, stroke):
    """The force-stroke table of spring i as an array, or an error that says what is wrong with it."""
    table = np.asarray(table, dtype=float)
    if table.ndim != 2 or table.shape[1] != 2 or len(table) < 2:
        raise ValueError(
            f"springs.tables[{i}] has shape {table.shape}; it must have two or more rows of stroke [m] and force [N]"
        )
    wrong = np.argwhere(~np.isfinite(table) | (table < [-np.inf, 0.0]))
    if wrong.size:
        row, column = wrong[0]
        raise ValueError(
            f"springs.tables[{i}]: {('stroke', 'force')[column]} = {table[row, column]} in row {row}; it must be "
            "finite, and a force not negative"
        )
    back = np.flatnonzero(np.diff(table[:, 0]) <= 0.0)
    if back.size:
        k = back[0]
        raise ValueError(
            f"springs.tables[{i}]: stroke {table[k + 1, 0]} m follows {table[k, 0]} m; strokes must ascend"
        )
    if table[0, 0] > 0.0 or table[-1, 0] < stroke:
        raise ValueError(
            f"springs.tables[{i}] goes from {table[0, 0]} to {table[-1, 0]} m; it must cover 0 to {stroke} m"
        )
    return table


def umbilical(
    angle: float,
    radius: float,
    stiffness: float,
    deformation: float,
    stroke: float,
    friction: float,
    engagement: float,
    pin_stiffness: float = 0.0,
) -> Springs:
    """An umbilical connector as two springs: its short, off-centre push, and the friction of its pins.

    Parameters
    ----------
    angle, radius : float
        Where it sits on the plane of the ring [rad, m].
    stiffness, deformation, stroke : float
        Of its spring [N/m, m, m].
    friction : float
        Force of the pins [N], not negative. It holds the bodies back while the pins are engaged, from the first push
        of any spring on (sliding friction, Coulomb's law; the bodies do not slide before that).
    engagement : float
        Stroke at which the pins leave the socket [m].
    pin_stiffness : float
        Stiffness of the pins while they stick [N/m]: they hold from t = 0 on up to their friction, slip against the
        motion, whichever way it goes, and stick again where it ends. 0: they only slide apart, with a constant force.

    Returns
    -------
    springs : Springs
        To be joined to the separation springs.

    Raises
    ------
    ValueError
        If the friction is negative.

    Examples
    --------
    >>> from satsep_ot.dynamics.separation import umbilical
    >>> len(umbilical(0.0, 0.25, 2000.0, 0.008, 0.006, friction=15.0, engagement=0.005))
    2
    """
    if not 0.0 <= friction < np.inf:
        raise ValueError(f"friction = {friction} N; it must be finite and not negative")
    return Springs(
        [angle, angle],
        radius,
        [stiffness, pin_stiffness],
        [deformation, 0.0],
        [stroke, engagement],
        scale=[1.0, friction],
        laws=[ForceLaw.LINEAR, ForceLaw.FRICTION],
    )


def table_cubics(springs: Springs) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The force-stroke tables of springs as piecewise cubics for the kernels.

    Parameters
    ----------
    springs : Springs

    Returns
    -------
    cubics : ndarray of records CUBIC
        One table after the other; see `satsep_ot.dynamics.force_interpolation`.
    first, number : ndarray of int, shape (N,)
        Where the cubics of each spring start, and how many they are.
    """
    pieces = springs.force_pieces()
    number = np.array([len(starts) for starts, _ in pieces])
    first = np.concatenate([[0], np.cumsum(number)[:-1]]).astype(np.int64)
    cubics = np.zeros(int(number.sum()), CUBIC)
    cubics["start"] = np.concatenate([starts for starts, _ in pieces])
    cubics["coefficients"] = np.concatenate([coefficients for _, coefficients in pieces])
    return cubics, first, number


def spring_records(springs: Springs) -> tuple[np.ndarray, np.ndarray]:
    """The springs as the kernels take them, without what the parameters of a run and the force line say.

    Parameters
    ----------
    springs : Springs

    Returns
    -------
    springs : ndarray of records SPRING, shape (N,)
    cubics : ndarray of records CUBIC
        Of all tables.
    """
    result = np.zeros(len(springs), SPRING)
    cubics, result["first_cubic"], result["cubic_number"] = table_cubics(springs)
    for name in ("stiffness", "deformation", "scale"):
        result[name] = getattr(springs, name)
    result["law"] = springs.laws
    result["cubic"] = -1
    for name in ("is_linear", "has_stiffness", "has_table", "holds_back"):
        result[name] = springs.law_property(name)
    return result, cubics


def force_functions(springs: Springs) -> list[Callable[[ArrayLike], np.ndarray]]:
    """For each spring its force [N], with its scale, as a function of the stroke [m]: what its law says."""
    records, cubics = spring_records(springs)

    def force_function(spring):
        law = ForceLaw(spring.law).function

        def force(strokes):
            forces = [law(spring, cubics, stroke)[0] for stroke in np.ravel(strokes)]
            return spring.scale * np.reshape(forces, np.shape(strokes))

        return force

    return [force_function(spring) for spring in records]
