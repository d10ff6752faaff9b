"""Dataclasses as plain data for JSON, and back, checked."""

import dataclasses
import enum
import types
import typing
from typing import Any


def to_plain(value: Any) -> Any:
    """Dataclasses, tuples and enumerations as dictionaries, lists and texts.

    A dataclass whose JSON is laid out in another way has a method `to_plain`, and `from_plain` to read it again.
    """
    if hasattr(value, "to_plain"):
        return value.to_plain()
    if dataclasses.is_dataclass(value):
        return {field.name: to_plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): to_plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_plain(one) for one in value]
    return value.value if isinstance(value, enum.Enum) else value


def from_plain(kind: Any, value: Any) -> Any:
    """The inverse of `to_plain`: plain data as a value of a type, such as a dataclass or ``tuple[float, ...]``.

    Keys that the dataclass does not know are ignored; those with a default may be missing.

    Raises
    ------
    ValueError
        The data are not of that type; the message names the field.

    Examples
    --------
    >>> import dataclasses
    >>> from satsep_ot.studies.telling.plain_data import from_plain, to_plain
    >>> @dataclasses.dataclass
    ... class Interval:
    ...     lower: float
    ...     upper: float | None = None
    >>> to_plain((Interval(1.0), Interval(2.0, 3.0)))
    [{'lower': 1.0, 'upper': None}, {'lower': 2.0, 'upper': 3.0}]
    >>> from_plain(tuple[Interval, ...], [{"lower": 1}])
    (Interval(lower=1.0, upper=None),)
    """
    origin, arguments = typing.get_origin(kind), typing.get_args(kind)
    if kind is Any:
        return value
    if origin is types.UnionType:
        # Only "or None" occurs.
        return None if value is None else from_plain(arguments[0], value)
    if hasattr(kind, "from_plain"):
        return kind.from_plain(value)
    if dataclasses.is_dataclass(kind):
        return dataclass_from_plain(kind, value)
    if origin is dict:
        return {key: from_plain(arguments[1], one) for key, one in _checked(dict, value).items()}
    if origin is tuple:
        return tuple(from_plain(arguments[0], one) for one in _checked(list, value))
    if issubclass(kind, enum.Enum):
        return kind(value)
    return float(_checked((int, float), value)) if kind is float else _checked(kind, value)


def dataclass_from_plain(kind: Any, value: Any) -> Any:
    """A dataclass from an object field by field, whether or not it has a `from_plain` of its own."""
    hints = typing.get_type_hints(kind)
    given = {}
    for field in dataclasses.fields(kind):
        required = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if field.name in _checked(dict, value):
            try:
                given[field.name] = from_plain(hints[field.name], value[field.name])
            except ValueError as error:
                raise ValueError(f"{field.name}: {error}") from error
        elif required:
            raise ValueError(f"{field.name} is missing")
    return kind(**given)


def _checked(kind, value):
    if not isinstance(value, kind) or (isinstance(value, bool) and kind is not bool):
        wanted = "number" if kind in (int, (int, float)) else {dict: "object", str: "text", bool: "boolean"}.get(kind)
        raise ValueError(f"{value!r:.40} is no {wanted or 'list'}")
    return value
