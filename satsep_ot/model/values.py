"""Kinds of values that a key of a case file may have: what is allowed, what it is in SI, and its JSON Schema.

A kind is a small frozen dataclass that says what it accepts and how it converts that to SI. `read` does both, or raises
`Refused` with what is allowed; the reader of the file adds the file, the key and what was given.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from satsep_ot.dynamics.kernels.records import LARGEST
from satsep_ot.dynamics.parameter_vector import Sign
from satsep_ot.dynamics.rotations import quaternion_from_euler_angles
from satsep_ot.model.distributions import distribution_names
from satsep_ot.model.text import is_printable

MAXIMUM_SPRINGS = 1000


class Unit(NamedTuple):
    """A unit of the case file.

    Attributes
    ----------
    name : str
        As messages and tables write it; empty for a pure number.
    factor : float
        Its size in SI.
    mistaken : str
        The unit that a value may have been written in by mistake, a thousand times larger.
    smallest_scatter : float
        Nobody knows a value better than by this, half of the range of 99.8 % of its values.
    """

    name: str
    factor: float = 1.0
    mistaken: str = ""
    smallest_scatter: float = 0.0

    @property
    def label(self) -> str:
        """The name as uncertain inputs show it: 1 for a pure number."""
        return self.name or "1"


ONE = Unit("")
KILOGRAM = Unit("kg")
KILOGRAM_SQUARE_METRE = Unit("kg m2")
MILLIMETRE = Unit("mm", 1e-3, "m", 0.005)
KILOMETRE = Unit("km", 1e3)
DEGREE = Unit("deg", math.pi / 180.0, "rad")
DEGREE_PER_SECOND = Unit("deg/s", math.pi / 180.0)
MILLISECOND = Unit("ms", 1e-3, "s", 0.005)
SECOND = Unit("s")
METRE_PER_SECOND = Unit("m/s")
MILLIMETRE_PER_SECOND = Unit("mm/s", 1e-3, "m/s")
SECOND_PER_METRE = Unit("s/m")
KILOMETRE_PER_SECOND = Unit("km/s", 1e3)
CUBIC_KILOMETRE_PER_SQUARE_SECOND = Unit("km3/s2", 1e9)
NEWTON = Unit("N")
NEWTON_PER_METRE = Unit("N/m", 1.0, "N/mm")
NEWTON_SECOND = Unit("N s")
NEWTON_METRE_SECOND = Unit("N m s")
ORBITS = Unit("orbits")


class Refused(ValueError):
    """A value is not allowed; the message says what is.

    Attributes
    ----------
    given : optional
        The part of the value that is not allowed; None stands for all of it.
    """

    def __init__(self, allowed: str, given: Any = None) -> None:
        super().__init__(allowed)
        self.given = given


class Value(ABC):
    """A kind of value."""

    unit = ONE

    @abstractmethod
    def allowed(self, count: int = 0) -> str:
        """What is allowed, as the end of "it must be ..."; for `count` springs."""

    @abstractmethod
    def accepts(self, given: Any, count: int = 0) -> bool:
        """Whether a value of the file is allowed."""

    def convert(self, given: Any, count: int = 0) -> Any:
        """A value that is allowed, in SI."""
        return given

    def read(self, given: Any, count: int = 0) -> Any:
        """The value in SI. Raises Refused if it is not allowed."""
        if not self.accepts(given, count):
            raise Refused(self.allowed(count))
        return self.convert(given, count)

    @abstractmethod
    def schema(self) -> dict[str, Any]:
        """Its JSON Schema, without title and description."""

    @property
    def range(self) -> str:
        """The range of its numbers in words, empty if every number is allowed."""
        return ""


@dataclass(frozen=True)
class Number(Value):
    """A finite number of a sign, of a size below a limit."""

    unit: Unit = ONE
    sign: Sign = Sign.ANY
    below: float = math.inf

    def allowed(self, count: int = 0) -> str:
        return f"a {self._what} number{self._size}{self._in_unit}"

    @property
    def _what(self):
        return f"finite, {self.sign.value}" if self.sign.value else "finite"

    @property
    def _size(self):
        return f" of size below {self.below:g}" if self.below < math.inf else ""

    @property
    def _in_unit(self):
        return f" in {self.unit.name}" if self.unit.name else ""

    @property
    def range(self) -> str:
        size = f"size below {self.below:g}" if self.sign is Sign.ANY else f"below {self.below:g}"
        return ", ".join(part for part in (self.sign.value, size if self.below < math.inf else "") if part)

    def accepts(self, given: Any, count: int = 0) -> bool:
        return is_number(given) and abs(given) < self.below and self.sign.allows(given)

    def convert(self, given: Any, count: int = 0) -> float:
        return float(given) * self.unit.factor

    def schema(self) -> dict[str, Any]:
        limits: dict[str, Any] = {"type": "number"}
        if self.below < math.inf:
            limits["exclusiveMaximum"] = self.below
            limits["exclusiveMinimum"] = -self.below
        if self.sign is Sign.POSITIVE:
            limits["exclusiveMinimum"] = 0
        if self.sign is Sign.NOT_NEGATIVE:
            limits.pop("exclusiveMinimum", None)
            limits["minimum"] = 0
        return limits


@dataclass(frozen=True)
class Share(Number):
    """A number from 0 to 1, such as a probability."""

    def allowed(self, count: int = 0) -> str:
        return "a number from 0 to 1"

    @property
    def range(self) -> str:
        return "from 0 to 1"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return is_number(given) and 0 <= given <= 1

    def schema(self) -> dict[str, Any]:
        return {"type": "number", "minimum": 0, "maximum": 1}


def is_number(given: Any) -> bool:
    """Whether a value of the file is a finite number that is not far beyond any physical value."""
    # Integers too long for a float fail the comparison too.
    return isinstance(given, (int, float)) and not isinstance(given, bool) and bool(abs(given) < LARGEST)


def is_numbers(given: Any, size: int) -> bool:
    """Whether a value of the file is a list of so many finite numbers."""
    return isinstance(given, list) and len(given) == size and all(map(is_number, given))


@dataclass(frozen=True)
class PerSpring(Value):
    """One number for all springs, or a list with one for each; read as an array with one for each."""

    number: Number

    @property
    def unit(self) -> Unit:  # type: ignore[override]
        return self.number.unit

    @property
    def range(self) -> str:
        return self.number.range

    def allowed(self, count: int = 0) -> str:
        each = f"{count} of them" if count else "them"
        return f"{self.number.allowed()}, or a list of {each}, one for each spring"

    def accepts(self, given: Any, count: int = 0) -> bool:
        if isinstance(given, list):
            return len(given) == count and all(map(self.number.accepts, given))
        return self.number.accepts(given)

    def convert(self, given: Any, count: int = 0) -> np.ndarray:
        return np.full(count, given, dtype=float) * self.unit.factor

    def with_zeros(self) -> "PerSpring":
        """The same, where 0 stands for a spring that has no such number."""
        return PerSpring(replace(self.number, sign=Sign.NOT_NEGATIVE))

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [self.number.schema(), _list_of(self.with_zeros().number.schema(), 1, MAXIMUM_SPRINGS)]}


class Numbers(Value):
    """Numbers of one unit; read as an array."""

    def convert(self, given: Any, count: int = 0) -> np.ndarray:
        return np.array(given, dtype=float) * self.unit.factor


@dataclass(frozen=True)
class Angles(Numbers):
    """A list of angles, one for each spring."""

    unit: Unit = DEGREE

    def allowed(self, count: int = 0) -> str:
        return f"a list of 1 to {MAXIMUM_SPRINGS} finite numbers in {self.unit.name}, one for each spring"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return isinstance(given, list) and 1 <= len(given) <= MAXIMUM_SPRINGS and all(map(is_number, given))

    def schema(self) -> dict[str, Any]:
        return _list_of({"type": "number"}, 1, MAXIMUM_SPRINGS)


@dataclass(frozen=True)
class Vector(Numbers):
    """Three numbers along x, y and z."""

    unit: Unit

    def allowed(self, count: int = 0) -> str:
        return f"three finite numbers in {self.unit.name}"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return is_numbers(given, 3)

    def schema(self) -> dict[str, Any]:
        return _list_of({"type": "number"}, 3, 3)


@dataclass(frozen=True)
class Ends(Vector):
    """Two numbers, the smaller one first."""

    def allowed(self, count: int = 0) -> str:
        return f"two finite numbers in {self.unit.name}, the smaller one first"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return is_numbers(given, 2) and given[0] < given[1]

    def schema(self) -> dict[str, Any]:
        return _list_of({"type": "number"}, 2, 2)


@dataclass(frozen=True)
class Times(Value):
    """A list of different positive numbers; read as a tuple in ascending order."""

    unit: Unit
    most: float = math.inf

    def allowed(self, count: int = 0) -> str:
        return f"a list of different numbers in {self.unit.name}, above 0 and at most {self.most:g}"

    def accepts(self, given: Any, count: int = 0) -> bool:
        if (
            not isinstance(given, list)
            or not given
            or not all(is_number(time) and 0 < time <= self.most for time in given)
        ):
            return False
        return len({f"{time:g}" for time in given}) == len(given)

    def convert(self, given: Any, count: int = 0) -> tuple[float, ...]:
        return tuple(sorted(float(time) * self.unit.factor for time in given))

    def schema(self) -> dict[str, Any]:
        time = {"type": "number", "exclusiveMinimum": 0, "maximum": self.most}
        return {**_list_of(time, 1), "uniqueItems": True}


@dataclass(frozen=True)
class Direction(Vector):
    """Three numbers that are not all 0; read as a vector of length 1."""

    unit: Unit = ONE

    def allowed(self, count: int = 0) -> str:
        return "three finite numbers, not all 0"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return super().accepts(given) and any(given)

    def convert(self, given: Any, count: int = 0) -> np.ndarray:
        vector = super().convert(given)
        return vector / np.linalg.norm(vector)


@dataclass(frozen=True)
class Points(Numbers):
    """A list of at least one point."""

    unit: Unit

    def allowed(self, count: int = 0) -> str:
        return f"a list of points, each [x, y, z] in {self.unit.name}"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return isinstance(given, list) and len(given) > 0

    def convert(self, given: Any, count: int = 0) -> np.ndarray:
        for point in given:
            if not is_numbers(point, 3):
                raise Refused(self.allowed(), point)
        return super().convert(given)

    def schema(self) -> dict[str, Any]:
        return _list_of(Vector(self.unit).schema(), 1)


@dataclass(frozen=True)
class PointsOrNumber(Points):
    """A list of points, or how many of them there are; read as an array or as the number."""

    most: int = 120

    def allowed(self, count: int = 0) -> str:
        return f"a whole number from 0 to {self.most}, or {super().allowed()}"

    def accepts(self, given: Any, count: int = 0) -> bool:
        if isinstance(given, list):
            return 0 < len(given) <= self.most
        return isinstance(given, int) and not isinstance(given, bool) and 0 <= given <= self.most

    def convert(self, given: Any, count: int = 0) -> Any:
        return super().convert(given) if isinstance(given, list) else given

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [{"type": "integer", "minimum": 0, "maximum": self.most}, super().schema()]}


@dataclass(frozen=True)
class Tensor(Numbers):
    """Three principal values or a symmetric 3 x 3 matrix; read as a matrix."""

    unit: Unit

    def allowed(self, count: int = 0) -> str:
        return f"three principal moments, or a symmetric 3 x 3 matrix, of finite numbers in {self.unit.name}"

    def accepts(self, given: Any, count: int = 0) -> bool:
        if is_numbers(given, 3):
            return True
        if not isinstance(given, list) or len(given) != 3 or not all(is_numbers(row, 3) for row in given):
            return False
        tensor = np.array(given, dtype=float)
        return bool(np.abs(tensor - tensor.T).max() <= 1e-9 * np.abs(tensor).max())

    def convert(self, given: Any, count: int = 0) -> np.ndarray:
        tensor = super().convert(given)
        return np.diag(tensor) if tensor.ndim == 1 else 0.5 * (tensor + tensor.T)

    def schema(self) -> dict[str, Any]:
        row = _list_of({"type": "number"}, 3, 3)
        return {"anyOf": [_list_of({"type": "number", "exclusiveMinimum": 0}, 3, 3), _list_of(row, 3, 3)]}


@dataclass(frozen=True)
class Choice(Value):
    """One of some words, each of which stands for something; read as what it stands for."""

    meanings: dict[str, Any]

    def allowed(self, count: int = 0) -> str:
        return f"one of {', '.join(map(repr, self.meanings))}"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return isinstance(given, str) and given in self.meanings

    def convert(self, given: Any, count: int = 0) -> Any:
        return self.meanings[given]

    def schema(self) -> dict[str, Any]:
        return {"enum": list(self.meanings)}


@dataclass(frozen=True)
class Flag(Value):
    """True or false."""

    def allowed(self, count: int = 0) -> str:
        return "true or false"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return isinstance(given, bool)

    def schema(self) -> dict[str, Any]:
        return {"type": "boolean"}


@dataclass(frozen=True)
class Text(Value):
    """Any text."""

    def allowed(self, count: int = 0) -> str:
        return "a text in quotes"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return isinstance(given, str)

    def schema(self) -> dict[str, Any]:
        return {"type": "string"}


@dataclass(frozen=True)
class Word(Text):
    """One of some words, or what matches a pattern; the reader of the key has more to say than that."""

    words: tuple[str, ...]
    pattern: str

    def schema(self) -> dict[str, Any]:
        return {"anyOf": [{"enum": list(self.words)}, {"type": "string", "pattern": self.pattern}]}


@dataclass(frozen=True)
class DistributionName(Text):
    """The name of a univariate OpenTURNS distribution; what is not one is refused where it is built."""

    def schema(self) -> dict[str, Any]:
        return {"enum": distribution_names()}


@dataclass(frozen=True)
class Name(Text):
    """A name that fits into a line."""

    longest: int = 100

    def allowed(self, count: int = 0) -> str:
        return f"a name of 1 to {self.longest} printable characters"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return super().accepts(given) and 0 < len(given.strip()) <= len(given) <= self.longest and is_printable(given)

    def schema(self) -> dict[str, Any]:
        return {"type": "string", "minLength": 1, "maxLength": self.longest}


@dataclass(frozen=True)
class Names(Value):
    """A list of at least two names."""

    def allowed(self, count: int = 0) -> str:
        return "a list of at least two names of uncertain inputs"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return isinstance(given, list) and all(isinstance(name, str) for name in given)

    def schema(self) -> dict[str, Any]:
        # One name may stand for the inputs of all springs.
        return _list_of({"type": "string"}, 1)


@dataclass(frozen=True)
class SpringCount(Value):
    """How many springs there are."""

    def allowed(self, count: int = 0) -> str:
        return f"a whole number from 1 to {MAXIMUM_SPRINGS}"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return type(given) is int and 1 <= given <= MAXIMUM_SPRINGS

    def schema(self) -> dict[str, Any]:
        return {"type": "integer", "minimum": 1, "maximum": MAXIMUM_SPRINGS}


@dataclass(frozen=True)
class Whole(Value):
    """A whole number between two."""

    least: int = 1
    most: int = 10_000

    def allowed(self, count: int = 0) -> str:
        return f"a whole number from {self.least} to {self.most}"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return type(given) is int and self.least <= given <= self.most

    def schema(self) -> dict[str, Any]:
        return {"type": "integer", "minimum": self.least, "maximum": self.most}


@dataclass(frozen=True)
class SpringNumbers(Value):
    """Numbers of different springs, from 1; read as their indices."""

    def allowed(self, count: int = 0) -> str:
        return f"a list of different spring numbers, from 1 to {count}"

    def accepts(self, given: Any, count: int = 0) -> bool:
        if not isinstance(given, list) or not all(type(n) is int and 1 <= n <= count for n in given):
            return False
        return len(set(given)) == len(given)

    def convert(self, given: Any, count: int = 0) -> list[int]:
        return [n - 1 for n in given]

    def schema(self) -> dict[str, Any]:
        return {**_list_of(SpringCount().schema(), 0), "uniqueItems": True}


@dataclass(frozen=True)
class ForceTables(Value):
    """A force-stroke table of all springs, or of some by their numbers, as the file has it: the reader opens files."""

    def allowed(self, count: int = 0) -> str:
        return "rows [[stroke, force], ...] or the name of a CSV file"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return True

    def schema(self) -> dict[str, Any]:
        row = {"type": "array", "items": [{"type": "number"}, {"type": "number", "minimum": 0}], "minItems": 2}
        table = {"anyOf": [_list_of({**row, "maxItems": 2}, 2, 1000), {"type": "string", "minLength": 1}]}
        by_number = {"type": "object", "patternProperties": {"^[0-9]+$": table}, "additionalProperties": False}
        return {"anyOf": [*table["anyOf"], by_number]}


@dataclass(frozen=True)
class Attitude(Value):
    """Three angles or a quaternion; read as a quaternion of norm 1."""

    unit: Unit = DEGREE

    def allowed(self, count: int = 0) -> str:
        return f"roll, pitch, yaw in {self.unit.name}, or a quaternion [w, x, y, z] of norm 1"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return is_numbers(given, 3) or is_numbers(given, 4)

    def convert(self, given: Any, count: int = 0) -> np.ndarray:
        if len(given) == 3:
            return quaternion_from_euler_angles(*(float(angle) * self.unit.factor for angle in given))
        norm = math.hypot(*given)
        if abs(norm - 1.0) > 1e-6:
            raise Refused(f"{self.allowed()} (its norm is {norm:.6g})")
        return np.array(given, dtype=float) / norm

    def schema(self) -> dict[str, Any]:
        return _list_of({"type": "number"}, 3, 4)


@dataclass(frozen=True)
class Scatter(Value):
    """The size of a scatter: a positive number in the unit of the quantity, or a percentage of the nominal value."""

    def allowed(self, count: int = 0) -> str:
        return "a finite, positive number, or a percentage such as '1.5 %'"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return True

    def schema(self) -> dict[str, Any]:
        number = {"type": "number", "exclusiveMinimum": 0}
        return {"anyOf": [number, {"type": "string", "pattern": "^ *[0-9.eE+-]+ *%$"}]}


@dataclass(frozen=True)
class Scatters(Value):
    """Sizes of a scatter, as the file has them: the reader of the input says which are allowed."""

    def allowed(self, count: int = 0) -> str:
        return "a list of at least two different sizes, such as ['1 %', '3 %']"

    def accepts(self, given: Any, count: int = 0) -> bool:
        return isinstance(given, list) and len(given) > 1 and len(set(map(str, given))) == len(given)

    def schema(self) -> dict[str, Any]:
        return {**_list_of(Scatter().schema(), 2), "uniqueItems": True}


@dataclass(frozen=True)
class Prices(Value):
    """A list of numbers that are not negative."""

    def allowed(self, count: int = 0) -> str:
        each = f"{count} of them, " if count else ""
        return f"a list of finite, non-negative numbers, {each}one for each class"

    def accepts(self, given: Any, count: int = 0) -> bool:
        is_list = isinstance(given, list) and len(given) == (count or len(given))
        return is_list and all(is_number(price) and price >= 0 for price in given)

    def schema(self) -> dict[str, Any]:
        return _list_of({"type": "number", "minimum": 0}, 2)


def _list_of(item, least, most=None):
    limits = {"minItems": least} | ({} if most is None else {"maxItems": most})
    return {"type": "array", "items": item, **limits}
