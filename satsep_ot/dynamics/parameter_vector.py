"""The flat parameter vector: which fields stand in it, under which names, and which values make sense.

A field of a dataclass stands in the vector if its annotation says so, `mass: Annotated[float, Parameter(...)]`. The
order of the fields is their order in the vector.
"""

import enum
import functools
import math
from dataclasses import dataclass
from typing import get_type_hints

AXES = ("x", "y", "z")
TENSOR = ("xx", "yy", "zz", "xy", "xz", "yz")


class Sign(enum.Enum):
    """Which sign a number may have; the value says it in words.

    Examples
    --------
    >>> from satsep_ot.dynamics.parameter_vector import Sign
    >>> [sign.allows(0.0) for sign in Sign]
    [True, False, True, True]
    """

    ANY = ""
    POSITIVE = "positive"
    NOT_NEGATIVE = "not negative"
    ZERO = "0"

    @property
    def limits(self) -> tuple[float, float]:
        """The smallest and the largest number of this sign: one statement for Python and for the kernels."""
        return _LIMITS[self]

    def allows(self, value: float) -> bool:
        """Whether a number has this sign."""
        lowest, highest = self.limits
        return bool(lowest <= value <= highest)


_LIMITS = {
    Sign.ANY: (-math.inf, math.inf),
    Sign.POSITIVE: (math.nextafter(0.0, 1.0), math.inf),
    Sign.NOT_NEGATIVE: (0.0, math.inf),
    Sign.ZERO: (0.0, 0.0),
}


@dataclass(frozen=True)
class Parameter:
    """In the annotation of a field: its numbers stand in the flat parameter vector.

    Parameters
    ----------
    sign : Sign or tuple of Sign
        Of its numbers, where they play a part; one for all, or one for each element.
    elements : tuple of str
        Names of its numbers; ("",) for a single number.
    """

    sign: Sign | tuple[Sign, ...] = Sign.ANY
    elements: tuple[str, ...] = ("",)

    def signs(self) -> tuple[Sign, ...]:
        """The sign of each element."""
        return self.sign if isinstance(self.sign, tuple) else (self.sign,) * len(self.elements)


@dataclass(frozen=True)
class Place:
    """One number of the flat parameter vector.

    Attributes
    ----------
    path : str
        The field from the separation on, for example "springs.stroke" or "platform.center_of_mass".
    element : str
        Which number of the field, for example "x"; empty for a single number.
    sign : Sign
        Of the number, where it plays a part.
    index : int or None
        Which spring, or which plane of the recess.

    Examples
    --------
    >>> from satsep_ot.dynamics.parameter_vector import Place, Sign
    >>> Place("springs.stroke", "", Sign.POSITIVE, 1).name
    'springs[1].stroke'
    """

    path: str
    element: str
    sign: Sign
    index: int | None = None

    @property
    def name(self) -> str:
        """How messages call it."""
        owner, _, field = self.path.partition(".")
        path = self.path if self.index is None else f"{owner}[{self.index}].{field}"
        return f"{path}.{self.element}" if self.element else path


@functools.cache
def parameter_fields(owner: type) -> dict[str, Parameter]:
    """The fields of a dataclass that stand in the flat parameter vector, in its order.

    Parameters
    ----------
    owner : type

    Returns
    -------
    fields : dict of str to Parameter

    Examples
    --------
    >>> from satsep_ot.dynamics.parameter_vector import parameter_fields
    >>> from satsep_ot.dynamics.separation import Body
    >>> list(parameter_fields(Body))
    ['mass', 'inertia', 'center_of_mass']
    """
    return {
        name: entry
        for name, hint in get_type_hints(owner, include_extras=True).items()
        for entry in getattr(hint, "__metadata__", ())
        if isinstance(entry, Parameter)
    }


def record_fields(owner: type) -> list[tuple]:
    """The same as fields of a record of numbers: names, and how many numbers where they are several.

    Parameters
    ----------
    owner : type

    Returns
    -------
    fields : list of tuple

    Examples
    --------
    >>> from satsep_ot.dynamics.parameter_vector import record_fields
    >>> from satsep_ot.dynamics.separation import Body
    >>> record_fields(Body)
    [('mass', 'f8'), ('inertia', 'f8', 6), ('center_of_mass', 'f8', 3)]
    """
    sizes = {name: len(field.elements) for name, field in parameter_fields(owner).items()}
    return [(name, "f8") if size == 1 else (name, "f8", size) for name, size in sizes.items()]


def places(owner: type, path: str = "", index: int | None = None) -> list[Place]:
    """The places of the numbers of a dataclass in the flat parameter vector.

    Parameters
    ----------
    owner : type
    path : str
        Of the dataclass from the separation on.
    index : int, optional
        Which spring.

    Returns
    -------
    places : list of Place
    """
    return [
        Place(f"{path}.{name}" if path else name, element, sign, index)
        for name, field in parameter_fields(owner).items()
        for element, sign in zip(field.elements, field.signs(), strict=True)
    ]
