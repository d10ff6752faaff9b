"""What OpenTURNS users expect of every object: names, text, a notebook table, equality, storage in a study.

A class inherits :class:`OpenTURNSObject` and says in `_shown` what its text shows.
"""

import base64
import dataclasses
import functools
import html
import math
import pickle
import types
from typing import Any, ClassVar

import numpy as np
import openturns as ot

from satsep_ot.openturns_adapter import isOpenTURNS, sameObjects

# Their state is not what they are.
_BY_IDENTITY = (type, types.FunctionType, types.BuiltinFunctionType, types.MethodType)
# How a study keeps an object of this package: an ot.Description of this mark, the class and the pickle as text.
_MARK = "satsep_ot object 1"


class OpenTURNSObject:
    """Name, text, notebook table and equality of an object, as OpenTURNS' own have them.

    Two objects are equal if they are of one class and of one state; what follows from the rest of the state, such as
    cached properties and the attributes named in ``_derived``, does not count.

    Examples
    --------
    >>> import copy
    >>> from satsep_ot.openturns_object import OpenTURNSObject
    >>> class Design(OpenTURNSObject):
    ...     def __init__(self, size):
    ...         self._size = size
    ...     def _shown(self):
    ...         return {"size": self._size}
    >>> design = Design(3)
    >>> design.setName("first")
    >>> design, design.getClassName(), copy.deepcopy(design) == design, design == Design(3)
    (Design(size=3), 'Design', True, False)
    >>> print(design)
    Design "first"
      size: 3
    """

    _name = "Unnamed"
    # Attributes that follow from the others.
    _derived: ClassVar[tuple[str, ...]] = ()

    def _shown(self) -> dict[str, Any]:
        """What the text shows, by what it is called."""
        raise NotImplementedError(f"{type(self).__name__} does not say what its text shows")

    def getClassName(self) -> str:
        """Name of the class."""
        return type(self).__name__

    def getName(self) -> str:
        """Name of the object, "Unnamed" by default."""
        return self._name

    def setName(self, name: str) -> None:
        """Give the object a name."""
        # Not by setattr: the object may be frozen.
        vars(self)["_name"] = str(name)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join(f'{key}={value}' for key, value in self._shown().items())})"

    def __str__(self) -> str:
        lines = [type(self).__name__ + ("" if self._name == "Unnamed" else f' "{self._name}"')]
        lines += [f"  {key}: {value}" for key, value in self._shown().items()]
        return "\n".join(lines + [f"  remark: {remark}" for remark in self._shownRemarks()])

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        cells = [(key, str(value)) for key, value in self._shown().items()]
        cells += [("remark", remark) for remark in self._shownRemarks()]
        rows = "".join(f"<tr><th>{html.escape(key)}</th><td>{html.escape(value)}</td></tr>" for key, value in cells)
        title = html.escape(str(self).splitlines()[0])
        return f"<table><caption>{title}</caption><tbody>{rows}</tbody></table>"

    def _shownRemarks(self):
        return self.getRemarks() if hasattr(self, "getRemarks") else []

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and _sameState(self, other)

    def __getstate__(self) -> dict[str, Any]:
        cached = _cached(type(self))
        return {name: value for name, value in vars(self).items() if name not in cached}

    # As OpenTURNS' objects, which can change.
    __hash__ = None  # type: ignore[assignment]


def _sameState(first, second):
    left_out = {*_cached(type(first)), *getattr(type(first), "_derived", ())}
    own = type(first).__getstate__ is not object.__getstate__
    states = [thing.__getstate__() if own else vars(thing) for thing in (first, second)]
    return _same(*({key: value for key, value in state.items() if key not in left_out} for state in states))


def _cached(kind):
    """Names of the cached properties of a class."""
    properties = (item for parent in kind.__mro__ for item in vars(parent).items())
    return {name for name, value in properties if isinstance(value, functools.cached_property)}


def _same(first, second):
    """Whether two values are equal, arrays and NaN included."""
    if first is second:
        return True
    if type(first) is not type(second):
        return False
    if isinstance(first, np.ndarray):
        return first.shape == second.shape and np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
    if isinstance(first, dict):
        return first.keys() == second.keys() and all(_same(value, second[key]) for key, value in first.items())
    if isinstance(first, (list, tuple)):
        return len(first) == len(second) and all(map(_same, first, second))
    if isinstance(first, float):
        return first == second or (math.isnan(first) and math.isnan(second))
    if dataclasses.is_dataclass(first) and not isinstance(first, OpenTURNSObject):
        return all(_same(*(getattr(x, field.name) for x in (first, second))) for field in dataclasses.fields(first))
    if isOpenTURNS(first):
        return sameObjects(first, second)
    if type(first).__eq__ is object.__eq__ and hasattr(first, "__dict__") and not isinstance(first, _BY_IDENTITY):
        return _sameState(first, second)
    return bool(first == second)


def addToStudy(study: ot.Study, label: str, thing: OpenTURNSObject) -> None:
    """Put an object of this package into a study, beside OpenTURNS' own objects; ``study.save()`` writes it.

    Parameters
    ----------
    study : :py:class:`openturns.Study`
    label : str
    thing : object of a public class of ``satsep_ot``

    Raises
    ------
    TypeError
        It is none, or holds what cannot be pickled, such as a lambda as a callback.

    Notes
    -----
    A study takes no Python class, so the object becomes an :py:class:`openturns.Description` that holds its pickle,
    as OpenTURNS itself stores Python functions. Like these it can execute anything when it is read: read only studies
    that you trust. Results also have ``save`` and ``load``, which execute nothing.

    Examples
    --------
    >>> import tempfile
    >>> import openturns as ot
    >>> from satsep_ot import MultivariatePolynomialRegression, addToStudy, readFromStudy
    >>> inputs = ot.Normal(1).getSample(20)
    >>> regression = MultivariatePolynomialRegression(inputs, inputs)
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     study = ot.Study(f"{directory}/study.xml")
    ...     addToStudy(study, "regression", regression)
    ...     study.save()
    ...     again = ot.Study(f"{directory}/study.xml")
    ...     again.load()
    ...     readFromStudy(again, "regression") == regression
    True
    """
    if not isinstance(thing, OpenTURNSObject):
        raise TypeError(f"{label!r} is a {type(thing).__name__}; give an object of satsep_ot, or use study.add()")
    try:
        text = base64.b64encode(pickle.dumps(thing)).decode("ascii")
    except (AttributeError, TypeError, RuntimeError, pickle.PicklingError) as error:
        raise TypeError(
            f"{label!r} cannot be stored: {error}; take functions of a module, not lambdas, for its model and callbacks"
        ) from error
    study.add(label, ot.Description([_MARK, type(thing).__name__, text]))


def readFromStudy(study: ot.Study, label: str) -> Any:
    """The object that `addToStudy` has put into a study, which has been loaded; read only studies that you trust.

    Parameters
    ----------
    study : :py:class:`openturns.Study`
    label : str

    Raises
    ------
    ValueError
        There is no object of this package under the label.
    """
    stored = ot.Description()
    found = study.hasObject(label)
    if found:
        try:
            study.fillObject(label, stored)
        except (TypeError, RuntimeError):
            found = False
    if not found or stored.getSize() != 3 or stored[0] != _MARK:
        raise ValueError(f"the study has no object of satsep_ot under {label!r}; addToStudy() puts one there")
    return pickle.loads(base64.b64decode(stored[2]))
