"""A case: a TOML file, in the units that engineers use, read into validated data in SI.

The annotated file `cases/reference.toml` of this package names every key with its unit and default.
"""

import itertools
import json
import math
import os
import re
import tomllib
from dataclasses import dataclass, field, replace
from importlib import resources
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.dynamics.gravity import EARTH_GRAVITATIONAL_PARAMETER, EARTH_RADIUS
from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.relative_orbit import Recontact, check_orbit, stack_orbit
from satsep_ot.dynamics.rotations import quaternion_from_euler_angles, quaternion_from_matrix, rotation_matrix
from satsep_ot.dynamics.separation import Body, Pivot, Separation, Springs, umbilical
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.model.force_table import checked_force_table, force_table_text, parse_force_table
from satsep_ot.model.inputs import (
    Target,
    UncertainInput,
    build_distribution,
    check_range,
    did_you_mean,
    normal_copula,
    scatter_targets,
)

_DEGREE = math.pi / 180.0
_MILLI = 1e-3
_KILO = 1e3
_MAXIMUM_SPRINGS = 1000
_LONGEST_FILE = 4_000_000  # characters
# Where the push, along y, points -> where the position and the horizontal part of the velocity point in body axes at
# t = 0.
_PUSHES = {
    "along-track": ((1, 0, 0), (0, 1, 0)),
    "against-track": ((1, 0, 0), (0, -1, 0)),
    "up": ((0, 1, 0), (0, 0, 1)),
    "down": ((0, -1, 0), (0, 0, 1)),
    "normal": ((0, 0, 1), (1, 0, 0)),
    "anti-normal": ((0, 0, 1), (-1, 0, 0)),
}


class CaseError(ValueError):
    """A case file cannot be used; the message names the file, the key, what was given and what is allowed.

    Examples
    --------
    >>> from satsep_ot.model.case import CaseError, load_case
    >>> try:
    ...     load_case("nothing.toml")
    ... except CaseError as error:
    ...     print("there is no such file" in str(error))
    True
    """


# The name under which the violation of any requirement is reported.
SYSTEM = "any requirement"


@dataclass(frozen=True)
class Requirement:
    """A limit on one quantity of interest.

    Parameters
    ----------
    name : str
        How people call it.
    quantity : str
        Name of the quantity of interest.
    limit : float
        In the quantity's unit.
    is_maximum : bool
        True if the quantity must not exceed the limit, False if it must not fall below it.
    allowed_probability : float, optional
        Largest probability of violation that is accepted.

    Examples
    --------
    >>> from satsep_ot.model.case import Requirement
    >>> print(Requirement("spin", "spin", 1.0, True))
    spin <= 1
    """

    name: str
    quantity: str
    limit: float
    is_maximum: bool
    allowed_probability: float | None = None

    def is_met(self, value: float) -> bool:
        """Whether a value of the quantity meets the requirement; the limit itself does."""
        return value <= self.limit if self.is_maximum else value >= self.limit

    def __str__(self) -> str:
        return f"{self.quantity} {'<=' if self.is_maximum else '>='} {self.limit:g}"


@dataclass(frozen=True)
class Case:
    """What a case file says.

    Parameters
    ----------
    name, description : str
    separation : :class:`satsep_ot.dynamics.separation.Separation`
        The nominal separation [SI].
    inputs : tuple of :class:`satsep_ot.model.inputs.UncertainInput`
    requirements : tuple of Requirement
    copula : :class:`openturns.NormalCopula`, optional
        Dependence of the inputs, in their order. None: independent.
    text : str
        The case file as it was read; empty for a case that does not come from one.
    files : dict of str to str
        The force-stroke tables that it names, as they were read, by their paths from its folder.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> case = load_case("reference")
    >>> print(len(case.inputs), case.requirements[0])
    35 lateral_rate <= 2.5
    """

    name: str
    description: str
    separation: Separation
    inputs: tuple[UncertainInput, ...] = ()
    requirements: tuple[Requirement, ...] = ()
    copula: ot.NormalCopula | None = None
    text: str = ""
    files: dict[str, str] = field(default_factory=dict)


def shipped_cases() -> list[str]:
    """Names of the cases in the package.

    Examples
    --------
    >>> from satsep_ot.model.case import shipped_cases
    >>> "reference" in shipped_cases()
    True
    """
    folder = resources.files("satsep_ot.model") / "cases"
    return sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))


def new_case_text(like: str, name: str) -> str:
    """The text of a case of the package under another name, as a case file to start from.

    Parameters
    ----------
    like : str
        One of `shipped_cases`.
    name : str

    Returns
    -------
    text : str

    Examples
    --------
    >>> from satsep_ot.model.case import new_case_text, parse_case
    >>> parse_case(new_case_text("cubesat", "mine")).name
    'mine'
    """
    # A text in TOML is written as in JSON.
    line = f"name = {json.dumps(name)}"
    return re.sub(r"^name = .*$", lambda _: line, load_case(like).text, count=1, flags=re.MULTILINE)


def load_case(source: str | os.PathLike | Case = "reference") -> Case:
    """Read a case.

    Parameters
    ----------
    source : str, path or Case
        The name of a case in the package, or the path of a TOML file. A Case is returned as it is.

    Returns
    -------
    case : Case

    Raises
    ------
    CaseError
        In one sentence, if the file cannot be read or says something that is not allowed.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> case = load_case("reference")
    >>> case.separation.satellite.mass, len(case.inputs), [str(requirement) for requirement in case.requirements][0]
    (100.0, 35, 'lateral_rate <= 2.5')
    """
    if isinstance(source, Case):
        return source
    if isinstance(source, str) and source in shipped_cases():
        text = (resources.files("satsep_ot.model") / "cases" / f"{source}.toml").read_text(encoding="utf-8")
        return parse_case(text, f"{source}.toml")
    path = Path(source)
    try:
        with path.open(encoding="utf-8") as stream:
            text = stream.read(_LONGEST_FILE + 1)
    except FileNotFoundError as error:
        shipped = ", ".join(shipped_cases())
        raise CaseError(
            f"{path}: there is no such file, and no case of that name in the package ({shipped})"
            f"{did_you_mean(str(path), shipped_cases())}"
        ) from error
    except UnicodeDecodeError as error:
        raise CaseError(f"{path}: the file is not UTF-8 text, as TOML must be") from error
    except (OSError, ValueError) as error:
        raise CaseError(f"{path}: the file cannot be read ({getattr(error, 'strerror', None) or error})") from error
    if len(text) > _LONGEST_FILE:
        raise CaseError(f"{path}: the file has more than {_LONGEST_FILE} characters, which no case needs")
    return parse_case(text, str(path))


def load_uncertain_case(source: str | os.PathLike | Case = "reference") -> Case:
    """Read a case that has at least one uncertain input.

    Parameters
    ----------
    source : str, path or Case
        As for `load_case`.

    Returns
    -------
    case : Case

    Raises
    ------
    CaseError
        As for `load_case`, and if the case has no uncertain input.

    Examples
    --------
    >>> from satsep_ot.model.case import load_uncertain_case
    >>> len(load_uncertain_case("reference").inputs)
    35
    """
    case = load_case(source)
    if not case.inputs:
        raise CaseError(f"{case.name}: the case has no uncertain inputs; give at least one in its table [inputs]")
    return case


def parse_case(text: str, file: str = "case") -> Case:
    """Read a case from the text of a TOML file.

    Parameters
    ----------
    text : str
    file : str
        Name of the file, for messages.

    Returns
    -------
    case : Case

    Raises
    ------
    CaseError
        As for `load_case`.

    Examples
    --------
    >>> from satsep_ot.model.case import CaseError, parse_case
    >>> try:
    ...     parse_case("[platform]\\nmas = 3.0", "mine.toml")
    ... except CaseError as error:
    ...     print(error)
    mine.toml: platform.mas is not a known key; did you mean 'mass'?
    """
    try:
        data = tomllib.loads(text)
    except (tomllib.TOMLDecodeError, ValueError, RecursionError) as error:
        reason = "tables or arrays are nested too deep" if isinstance(error, RecursionError) else str(error)
        raise CaseError(f"{file}: not valid TOML: {reason}") from error
    sections = (
        "name", "description", "horizon", "platform", "satellite", "springs", "umbilical", "impulse", "initial",
        "orbit", "recontact", "envelope", "inputs", "correlation", "requirements",
    )  # fmt: skip
    root = _Table(file, "", data, sections)
    # Misspelt keys are reported before missing ones: the first usually explains the second.
    tables = {
        key: root.table(key, keys, optional=key not in ("platform", "satellite", "springs"))
        for key, keys in _TABLE_KEYS.items()
    }
    separation = _separation(root, tables)
    entries = data.get("inputs", {})
    if not isinstance(entries, dict):
        raise root.error("inputs", entries, "a table with one entry for each uncertain input")
    inputs = _inputs(file, entries, separation)
    return Case(
        name=root.name("name", "") if "name" in root else Path(file).stem,
        description=root.text("description", ""),
        separation=separation,
        inputs=inputs,
        requirements=_requirements(root, separation),
        copula=_copula(root, inputs),
        text=text,
        files=root.texts,
    )


_BODY_KEYS = ("mass", "inertia", "center_of_mass")
_TABLE_KEYS = {
    "platform": _BODY_KEYS,
    "satellite": _BODY_KEYS,
    "springs": (
        "count", "angles", "radius", "stiffness", "deformation", "stroke", "cant", "delay", "scale", "failed",
        "table", "force_line", "stowed_length", "guide_friction",
    ),
    "impulse": ("momentum", "angular_momentum"),
    "initial": ("attitude", "rates", "velocity", "mounting_error", "pivot"),
    "orbit": (
        "altitude", "perigee_altitude", "apogee_altitude", "semi_major_axis", "eccentricity", "inclination",
        "right_ascension", "argument_of_perigee", "true_anomaly", "position", "velocity", "push",
        "gravitational_parameter", "gradient_torque", "j2",
    ),
    "recontact": ("start_orbits", "end_orbits"),
    "envelope": ("half_width", "height", "points", "recess_radius", "recess_depth", "planes"),
}  # fmt: skip
_MISSING = object()


class _Table:
    """One table of the file, read key by key; every refusal names file, key, what was given and what is allowed."""

    def __init__(self, file, path, data, keys, texts=None):
        self.file, self.path, self.data = file, path, data
        # Of the further files that were read, by their names.
        self.texts = {} if texts is None else texts
        for key in data:
            if key not in keys:
                hint = did_you_mean(key, keys) or f"; the keys here are {', '.join(keys)}"
                raise CaseError(f"{file}: {self.key(key)} is not a known key{hint}")

    def __contains__(self, key):
        return key in self.data

    def key(self, key):
        return f"{self.path}.{_key_shown(key)}" if self.path else _key_shown(key)

    def error(self, key, given, allowed):
        return CaseError(f"{self.file}: {self.key(key)} = {_shown(given)}, but it must be {allowed}")

    def get(self, key, default, allowed):
        if key in self.data:
            return self.data[key]
        if default is _MISSING:
            raise CaseError(f"{self.file}: {self.key(key)} is missing; it must be {allowed}")
        return default

    def table(self, key, keys, optional=False):
        data = self.get(key, None if optional else _MISSING, f"a table, [{key}]")
        if data is None:
            return None
        if not isinstance(data, dict):
            raise self.error(key, data, f"a table, [{key}]")
        return _Table(self.file, self.key(key), data, keys, self.texts)

    def tables(self, key, keys, one=False):
        """The tables of a list, each headed [[key]]; none where it is left out. With `one`, a single [key] will do."""
        entries = self.data.get(key, [])
        if one and isinstance(entries, dict):
            return [_Table(self.file, self.key(key), entries, keys)]
        if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
            raise self.error(key, entries, f"a list of tables, each headed [[{key}]]")
        return [_Table(self.file, f"{self.key(key)}[{n}]", entry, keys) for n, entry in enumerate(entries, start=1)]

    def text(self, key, default=_MISSING):
        value = self.get(key, default, "a text")
        if not isinstance(value, str):
            raise self.error(key, value, "a text in quotes")
        return value

    def name(self, key, default):
        value = self.text(key, default)
        if not _is_name(value):
            raise self.error(key, value, _NAME)
        return value

    def choice(self, key, choices, default):
        value = self.get(key, default, "")
        if not isinstance(value, str) or value not in choices:
            raise self.error(key, value, f"one of {', '.join(repr(choice) for choice in choices)}")
        return value

    def flag(self, key, default):
        value = self.get(key, default, "")
        if not isinstance(value, bool):
            raise self.error(key, value, "true or false")
        return value

    def number(self, key, unit, default=_MISSING, sign=None, below=math.inf):
        """A finite number; sign is None, "positive" or "not negative", `below` bounds its size."""
        allowed = _allowed("a finite number", unit, sign, below)
        value = self.get(key, default, allowed)
        if not _is_number(value, sign, below):
            raise self.error(key, value, allowed)
        return float(value)

    def vector(self, key, unit, default=_MISSING):
        allowed = f"three finite numbers in {unit}"
        return np.array(self._numbers(key, self.get(key, default, allowed), 3, allowed, None, math.inf))

    def per_spring(self, key, unit, count, default=_MISSING, sign=None, below=math.inf):
        """One number for all springs, or one for each."""
        one = _allowed("a finite number", unit, sign, below)
        allowed = f"{one}, or a list of {count} of them, one for each spring"
        value = self.get(key, default, allowed)
        if isinstance(value, list):
            return np.array(self._numbers(key, value, count, allowed, sign, below))
        if not _is_number(value, sign, below):
            raise self.error(key, value, allowed)
        return np.full(count, float(value))

    def points(self, key, unit):
        allowed = f"a list of points, each [x, y, z] in {unit}"
        value = self.get(key, _MISSING, allowed)
        if not isinstance(value, list) or not value:
            raise self.error(key, value, allowed)
        return np.array([self._numbers(key, point, 3, allowed, None, math.inf) for point in value])

    def _numbers(self, key, value, count, allowed, sign, below):
        if not isinstance(value, list) or len(value) != count or not all(_is_number(v, sign, below) for v in value):
            raise self.error(key, value, allowed)
        return [float(v) for v in value]


_NAME = "a name of 1 to 100 printable characters"


def _is_name(value, longest=100):
    return 0 < len(value.strip()) <= len(value) <= longest and value.isprintable()


def _shown(value):
    """A value as a message quotes it: on one line, and not too much of it."""
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."


def _key_shown(key):
    """A key as TOML writes it: in quotes unless it is a plain word."""
    return key if re.fullmatch(r"[A-Za-z0-9_.-]{1,60}", key) else _shown(key)


def _allowed(what, unit, sign, below):
    size = f" of size below {below:g}" if below < math.inf else ""
    return what.replace("finite", f"finite, {sign}" if sign else "finite") + size + (f" in {unit}" if unit else "")


def _is_number(value, sign=None, below=math.inf):
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    # Far beyond any physical value, so that no product overflows; integers too long for a float fall here too.
    if not abs(value) < 1e30:
        return False
    return abs(value) < below and not (sign == "positive" and value <= 0) and not (sign == "not negative" and value < 0)


def _separation(root, tables):
    springs = _springs(tables["springs"])
    for connector in _umbilicals(root):
        springs = springs.joined(connector)
    force_line, stowed_length, guide_friction = _force_line(tables["springs"])
    initial = tables["initial"] or _Table(root.file, "initial", {}, _TABLE_KEYS["initial"])
    orbit, attitude = _orbit(tables["orbit"], initial)
    gradient_torque = False if orbit is None else tables["orbit"].flag("gradient_torque", False)
    velocity = initial.vector("velocity", "m/s", [0.0, 0.0, 0.0])
    if orbit is not None:
        orbit = replace(orbit, velocity=orbit.velocity + velocity)
    envelope, recess_radius, recess_depth, planes = _envelope(tables["envelope"])
    impulse = tables["impulse"] or _Table(root.file, "impulse", {}, _TABLE_KEYS["impulse"])
    pivots = {"stack": Pivot.STACK, "platform": Pivot.PLATFORM}
    zero = [0.0, 0.0, 0.0]
    arguments = dict(
        platform=_body(tables["platform"]),
        satellite=_body(tables["satellite"]),
        springs=springs,
        force_line=force_line,
        stowed_length=stowed_length,
        attitude=tuple(attitude),
        rates=tuple(initial.vector("rates", "deg/s", zero) * _DEGREE),
        mounting_error=tuple(initial.vector("mounting_error", "deg", zero) * _DEGREE),
        pivot=pivots[initial.choice("pivot", tuple(pivots), "stack")],
        orbit=orbit,
        gradient_torque=gradient_torque,
        envelope=envelope,
        recess_radius=recess_radius,
        recess_depth=recess_depth,
        recess_planes=planes,
        impulse=impulse.vector("momentum", "N s", zero),
        angular_impulse=impulse.vector("angular_momentum", "N m s", zero),
        guide_friction=guide_friction,
        recontact=_recontact(tables["recontact"], orbit),
        horizon=root.number("horizon", "s", Separation.horizon, "positive", below=1e3),
    )
    try:
        separation = Separation(**arguments)
        if separation.recontact is not None:
            # The CG of the stack may be on another orbit than the platform's.
            check_orbit(stack_orbit(separation))
    except ValueError as error:
        raise CaseError(f"{root.file}: {error}") from error
    return separation


def _body(table):
    mass = table.number("mass", "kg", sign="positive")
    center_of_mass = table.vector("center_of_mass", "mm") * _MILLI
    allowed = "three principal moments, or a symmetric 3 x 3 matrix, of finite numbers in kg m2"
    value = table.get("inertia", _MISSING, allowed)
    if not isinstance(value, list) or len(value) != 3:
        raise table.error("inertia", value, allowed)
    if all(_is_number(element) for element in value):
        inertia = np.diag([float(element) for element in value])
    else:
        inertia = np.array([table._numbers("inertia", row, 3, allowed, None, math.inf) for row in value])
    if np.abs(inertia - inertia.T).max() > 1e-9 * np.abs(inertia).max():
        raise table.error("inertia", value, allowed)
    inertia = 0.5 * (inertia + inertia.T)
    moments = np.linalg.eigvalsh(inertia)
    shown = ", ".join(f"{moment:.6g}" for moment in moments)
    if moments[0] <= 0.0:
        raise table.error("inertia", value, f"positive definite (its principal moments are {shown} kg m2)")
    if moments[0] + moments[1] < moments[2] * (1.0 - 1e-9):
        raise table.error(
            "inertia",
            value,
            f"such that no principal moment exceeds the sum of the other two ({shown} kg m2 are given)",
        )
    return Body(mass=mass, inertia=inertia, center_of_mass=center_of_mass)


def _springs(table):
    allowed = f"a whole number from 1 to {_MAXIMUM_SPRINGS}"
    angles = table.get("angles", None, "")
    if angles is None:
        count = table.get("count", _MISSING, f"{allowed}, unless `angles` are given")
    else:
        per_spring = f"a list of 1 to {_MAXIMUM_SPRINGS} finite numbers in deg, one for each spring"
        if not isinstance(angles, list) or not 1 <= len(angles) <= _MAXIMUM_SPRINGS or not all(map(_is_number, angles)):
            raise table.error("angles", angles, per_spring)
        count = table.get("count", len(angles), "")
        if count != len(angles):
            raise table.error("count", count, f"{len(angles)}, the number of angles given, or left out")
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= _MAXIMUM_SPRINGS:
        raise table.error("count", count, allowed)
    if angles is None:
        # Hu et al. (2017), equation 4: a ring that is its own mirror image.
        angle = (2.0 * np.arange(count) + 1.0) * math.pi / count
    else:
        angle = np.array(angles, dtype=float) * _DEGREE
    stroke = table.per_spring("stroke", "mm", count, sign="positive") * _MILLI
    scale = table.per_spring("scale", "", count, 1.0, sign="not negative")
    scale[_failed(table, count)] = 0.0
    force_tables = _force_tables(table, stroke)
    return Springs(
        angle=angle,
        radius=table.per_spring("radius", "mm", count, sign="not negative") * _MILLI,
        stiffness=_of_linear_springs(table, "stiffness", "N/m", force_tables),
        deformation=_of_linear_springs(table, "deformation", "mm", force_tables) * _MILLI,
        stroke=stroke,
        cant=table.per_spring("cant", "deg", count, 0.0, below=90.0) * _DEGREE,
        delay=table.per_spring("delay", "ms", count, 0.0, sign="not negative") * _MILLI,
        scale=scale,
        tables=force_tables,
    )


def _of_linear_springs(table, key, unit, force_tables):
    """A positive number for each spring but those that have a force-stroke table, whose number is 0."""
    measured = [entry is not None for entry in force_tables]
    if all(measured):
        if key in table:
            raise table.error(key, table.data[key], "left out: every spring has a force-stroke table instead")
        return np.zeros(len(measured))
    if not any(measured) or not isinstance(table.get(key, None, ""), list):
        return np.where(measured, 0.0, table.per_spring(key, unit, len(measured), sign="positive"))
    values = table.per_spring(key, unit, len(measured), sign="not negative")
    if not np.array_equal(values == 0.0, measured):
        raise table.error(
            key, table.data[key], "0 for each spring that has a force-stroke table, and positive for the others"
        )
    return values


def _failed(table, count):
    """Indices of the springs that have failed."""
    value = table.get("failed", [], "")
    allowed = f"a list of different spring numbers, from 1 to {count}"
    if not isinstance(value, list) or not all(type(n) is int and 1 <= n <= count for n in value):
        raise table.error("failed", value, allowed)
    if len(set(value)) < len(value):
        raise table.error("failed", value, allowed)
    return [n - 1 for n in value]


def _force_tables(table, stroke):
    """The force-stroke table [m, N] of each spring, or None."""
    value, count = table.get("table", {}, ""), len(stroke)
    keys = [str(n) for n in range(1, count + 1)]
    # One table for all, or one for each spring that is named by its number.
    entries = value if isinstance(value, dict) else dict.fromkeys(keys, value)
    for key in entries:
        if key not in keys:
            raise CaseError(
                f"{table.file}: springs.table.{_key_shown(key)} is not a known key; the springs are 1 to {count}"
            )
    tables = []
    for key, needed in zip(keys, stroke, strict=True):
        where = f"{table.file}: springs.table" + (f".{key}" if isinstance(value, dict) else "")
        tables.append(_force_table(table, where, entries[key], needed) if key in entries else None)
    return tuple(tables)


def _force_table(table, where, value, stroke):
    if not (isinstance(value, list) or (isinstance(value, str) and _is_name(value, longest=1000))):
        raise CaseError(
            f"{where} = {_shown(value)}, but it must be rows [[stroke, force], ...] or the name of a CSV file"
        )
    is_file = isinstance(value, str)
    try:
        rows = _read_table(table, value) if is_file else checked_force_table(value, where)
    except ValueError as error:
        raise CaseError(f"{where}: {error}" if is_file else str(error)) from error
    if rows[-1, 0] < stroke:
        end, needed = rows[-1, 0] / _MILLI, stroke / _MILLI
        raise CaseError(
            f"{where}: the last stroke is {end:g} mm, but it must be the spring's stroke of {needed:g} mm or more"
        )
    return rows


def _read_table(table, name):
    """The table of a CSV file in the folder of the case or below: a case reads nothing that does not belong to it."""
    folder = Path(table.file).parent
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise ValueError(f"{name!r} must be in the folder of the case file or below: name it from there, without '..'")
    if name not in table.texts:
        table.texts[name] = force_table_text(folder / name)
    return parse_force_table(table.texts[name], str(folder / name))


_UMBILICAL_KEYS = ("angle", "radius", "stiffness", "deformation", "stroke", "friction", "engagement")


def _umbilicals(root):
    """The springs of each umbilical connector."""
    for table in root.tables("umbilical", _UMBILICAL_KEYS, one=True):
        yield umbilical(
            table.number("angle", "deg") * _DEGREE,
            table.number("radius", "mm", sign="not negative") * _MILLI,
            table.number("stiffness", "N/m", sign="positive"),
            table.number("deformation", "mm", sign="positive") * _MILLI,
            table.number("stroke", "mm", sign="positive") * _MILLI,
            table.number("friction", "N", sign="not negative"),
            table.number("engagement", "mm", sign="positive") * _MILLI,
        )


def _force_line(table):
    """The force line, the stowed length of struts [m], and the friction coefficient of the guides."""
    lines = {line.name.lower(): line for line in ForceLine}
    line = lines[table.choice("force_line", tuple(lines), "guided")]
    length = table.number("stowed_length", "mm", _MISSING if line is ForceLine.STRUT else 0.0, "not negative")
    if line is not ForceLine.STRUT and length > 0.0:
        raise table.error("stowed_length", length, f"left out for {line.name.lower()} springs: only a strut has one")
    if line is ForceLine.STRUT and length == 0.0:
        reason = "a strut whose ends coincide has no direction, and buckles"
        raise table.error("stowed_length", length, f"positive for a strut: {reason}")
    friction = table.number("guide_friction", "", 0.0, "not negative")
    if line is not ForceLine.NORMAL and friction > 0.0:
        reason = "only the force line 'normal' loads the guides laterally"
        raise table.error("guide_friction", friction, f"left out for {line.name.lower()} springs: {reason}")
    return line, length * _MILLI, friction


def _attitude(table):
    allowed = "roll, pitch, yaw in deg, or a quaternion [w, x, y, z] of norm 1"
    value = table.get("attitude", [0.0, 0.0, 0.0], allowed)
    if not isinstance(value, list) or len(value) not in (3, 4) or not all(_is_number(element) for element in value):
        raise table.error("attitude", value, allowed)
    if len(value) == 3:
        return quaternion_from_euler_angles(*(float(angle) * _DEGREE for angle in value))
    norm = math.hypot(*value)
    if abs(norm - 1.0) > 1e-6:
        raise table.error("attitude", value, f"{allowed} (its norm is {norm:.6g})")
    return np.array(value, dtype=float) / norm


# The ways to give an orbit, by the keys that choose each.
_ORBITS = {
    "altitude": ("altitude",),
    "perigee_altitude": ("perigee_altitude", "apogee_altitude"),
    "semi_major_axis": ("semi_major_axis",),
    "position": ("position", "velocity"),
}
_ANGLES = ("right_ascension", "argument_of_perigee", "true_anomaly")


def _orbit(table, initial):
    """The orbit (None without gravity), and the platform's attitude in its inertial axes."""
    if table is None:
        return None, _attitude(initial)
    given = [way for way, keys in _ORBITS.items() if any(key in table for key in keys)]
    if len(given) > 1:
        raise CaseError(
            f"{table.file}: orbit.{given[0]} and orbit.{given[1]} are both given; give one of {', '.join(_ORBITS)}"
        )
    if not given:
        raise CaseError(
            f"{table.file}: orbit.altitude is missing; give it in km, or one of {', '.join(list(_ORBITS)[1:])}"
        )
    way = given[0]
    if "eccentricity" in table and way != "semi_major_axis":
        raise CaseError(f"{table.file}: orbit.eccentricity needs orbit.semi_major_axis")
    mu = table.number(
        "gravitational_parameter", "km3/s2", EARTH_GRAVITATIONAL_PARAMETER / _KILO**3, "positive"
    ) * _KILO**3  # fmt: skip
    j2 = table.flag("j2", False)
    turned = [key for key in ("inclination", *_ANGLES) if key in table]
    if way == "altitude" and not turned:
        return _circular_orbit(table, _attitude(initial), mu, j2)
    if way == "position":
        if turned:
            raise CaseError(f"{table.file}: orbit.position and orbit.{turned[0]} are both given; give one of them")
        orbit = _build_orbit(
            table, Orbit, table.vector("position", "km") * _KILO, table.vector("velocity", "km/s") * _KILO, mu, j2
        )
    else:
        axis, eccentricity = _axis_and_eccentricity(table, way)
        angles = [table.number("inclination", "deg"), *(table.number(key, "deg", 0.0) for key in _ANGLES)]
        orbit = _build_orbit(
            table, Orbit.from_elements, axis, eccentricity, *(angle * _DEGREE for angle in angles), mu, j2
        )
    return orbit, _pushed_attitude(table, initial, orbit, way)


def _build_orbit(table, build, *arguments):
    try:
        return build(*arguments)
    except ValueError as error:
        raise CaseError(f"{table.file}: {error}") from error


def _circular_orbit(table, attitude, mu, j2):
    """A circular orbit whose plane follows from the attitude of the platform and the direction of the push."""
    if j2:
        raise CaseError(
            f"{table.file}: orbit.inclination is missing; with j2 the plane of the orbit matters, and altitude leaves "
            "it open"
        )
    radius = EARTH_RADIUS + table.number("altitude", "km", sign="positive") * _KILO
    position, velocity = _PUSHES[table.choice("push", tuple(_PUSHES), "along-track")]
    to_inertial = rotation_matrix(attitude)
    orbit = Orbit(
        position=to_inertial @ (radius * np.array(position, dtype=float)),
        velocity=to_inertial @ (math.sqrt(mu / radius) * np.array(velocity, dtype=float)),
        mu=mu,
    )
    return orbit, attitude


def _axis_and_eccentricity(table, way):
    """Semi-major axis [m] and eccentricity, from whichever keys say them."""
    if way == "semi_major_axis":
        eccentricity = table.number("eccentricity", "", 0.0, "not negative", below=1.0)
        return table.number("semi_major_axis", "km", sign="positive") * _KILO, eccentricity
    if way == "altitude":
        return EARTH_RADIUS + table.number("altitude", "km", sign="positive") * _KILO, 0.0
    perigee = table.number("perigee_altitude", "km", sign="positive") * _KILO
    apogee = table.number("apogee_altitude", "km", sign="positive") * _KILO
    if apogee < perigee:
        raise table.error("apogee_altitude", table.data["apogee_altitude"], "at least the perigee_altitude")
    axis = EARTH_RADIUS + 0.5 * (perigee + apogee)
    return axis, 0.5 * (apogee - perigee) / axis


def _pushed_attitude(table, initial, orbit, way):
    """The attitude as given, or the one that points y where the push says, in the local horizontal of the orbit."""
    if "push" not in table and ("attitude" in initial or way == "position"):
        return _attitude(initial)
    if "attitude" in initial:
        raise CaseError(
            f"{table.file}: orbit.push and initial.attitude are both given, and each says where y points; give one of "
            "them"
        )
    up = orbit.position / np.linalg.norm(orbit.position)
    normal = np.cross(orbit.position, orbit.velocity)
    if not np.linalg.norm(normal) > 0.0:
        raise CaseError(f"{table.file}: orbit.push needs an orbit with a plane; position and velocity are parallel")
    normal /= np.linalg.norm(normal)
    body_up, body_along = _PUSHES[table.choice("push", tuple(_PUSHES), "along-track")]
    orbit_axes = np.column_stack([up, np.cross(normal, up), normal])
    body_axes = np.column_stack([body_up, body_along, np.cross(body_up, body_along)]).astype(float)
    return quaternion_from_matrix(orbit_axes @ body_axes.T)


def _recontact(table, orbit):
    if table is None:
        return None
    if orbit is None:
        raise CaseError(f"{table.file}: the table [recontact] needs the table [orbit]")
    ends = (table.number(name, "orbits", getattr(Recontact, name)) for name in _TABLE_KEYS["recontact"])
    try:
        check_orbit(orbit)
        return Recontact(*ends)
    except ValueError as error:
        raise CaseError(f"{table.file}: [recontact] cannot be used: {error}") from error


def _envelope(table):
    if table is None:
        return None, 0.0, 0.0, None
    if "points" in table:
        for key in ("half_width", "height"):
            if key in table:
                raise CaseError(f"{table.file}: envelope.points and envelope.{key} are both given; give one of them")
        points = table.points("points", "mm") * _MILLI
    else:
        half_width = table.number("half_width", "mm", sign="positive") * _MILLI
        height = table.number("height", "mm", sign="positive") * _MILLI
        sides = (-half_width, half_width)
        points = np.array([[x, y, z] for y in (0.0, height) for x in sides for z in sides])
    planes = [
        [*_unit_vector(plane, "normal"), plane.number("offset", "mm") * _MILLI]
        for plane in table.tables("planes", ("normal", "offset"))
    ]
    recess_radius = 0.0
    if "recess_radius" in table or not planes:
        recess_radius = table.number("recess_radius", "mm", sign="positive") * _MILLI
    return points, recess_radius, table.number("recess_depth", "mm", sign="positive") * _MILLI, planes or None


def _unit_vector(table, key):
    vector = table.vector(key, "any unit")
    if not vector.any():
        raise table.error(key, table.data[key], "a vector that is not 0")
    return vector / np.linalg.norm(vector)


_SCATTER_KEYS = ("sigma", "three_sigma", "plus_minus", "distribution")


def _inputs(file, entries, separation):
    names = separation.parameter_names()
    nominal = dict(zip(names, separation.parameters(), strict=True))
    targets = scatter_targets(separation)
    inputs, taken = [], set()
    for name, entry in entries.items():
        path = f"inputs.{_key_shown(name)}"
        if not _is_name(name):
            raise CaseError(f"{file}: {path} must have {_NAME}")
        if not isinstance(entry, dict):
            raise CaseError(
                f'{file}: {path} = {_shown(entry)}, but it must be a table such as {{ quantity = "...", sigma = 1.0 }}'
            )
        if "distribution" in entry:
            # The distribution's own parameters are further keys: checked against it below.
            table = _Table(file, path, entry, tuple(entry))
        else:
            table = _Table(file, path, entry, ("quantity", "description", "mean", *_SCATTER_KEYS))
        for input_name, target in _targets(table, name, targets):
            if input_name in taken:
                raise CaseError(f"{file}: {path} gives a second input the name '{input_name}'; names must differ")
            taken.add(input_name)
            inputs.append(replace(_input(table, input_name, target, nominal), entry=name))
    return tuple(inputs)


def _targets(table, name, targets):
    """The (name, target) pairs of one entry: one, or one for each spring or connector."""
    quantity = table.text("quantity")
    base = quantity.removesuffix(".each")
    if base != quantity and base in targets:
        single = [key for key in targets if key.rpartition(".")[0] == base]
        if single:
            return [(f"{name}_{key.rpartition('.')[2]}", targets[key]) for key in single]
    if quantity not in targets:
        general = [key for key in targets if not key.rsplit(".", 1)[-1].isdigit()]
        each = [f"{key.rpartition('.')[0]}.each" for key in targets if key not in general]
        hint = (
            did_you_mean(quantity, [*general, *each])
            or f" such as {', '.join(general[:3])}, ... ({len(general)} in all)"
        )
        raise table.error("quantity", quantity, f"a quantity of this case{hint}")
    return [(name, targets[quantity])]


def _input(table, name, target: Target, nominal):
    # Springs that differ have no common value: moved together, their input is the deviation from it.
    values = {float(f"{nominal[parameter] / target.factor:.15g}") for parameter in target.parameters}
    reference = values.pop() if len(values) == 1 else 0.0
    description = table.text("description", target.description)
    if len(values) > 0:
        description = f"deviation of the {description}"
    # Next to `distribution`, sigma is a parameter of it.
    given = ["distribution"] if "distribution" in table else [key for key in _SCATTER_KEYS if key in table]
    if len(given) != 1:
        what = " and ".join(given) if given else "no scatter"
        raise CaseError(
            f"{table.file}: {table.path} has {what}, but it must have exactly one of {', '.join(_SCATTER_KEYS)}"
        )
    try:
        distribution = _distribution(table, given[0], target.unit, reference)
        row = UncertainInput(name, description, target.unit, distribution, target.parameters, target.factor, reference)
        check_range(row, nominal)
    except CaseError:
        raise
    except ValueError as error:
        raise CaseError(f"{table.file}: {table.path} cannot be used: {error}") from error
    return row


def _distribution(table, kind, unit, reference):
    if kind == "distribution":
        parameters = {
            key: table.number(key, unit) for key in table.data if key not in ("distribution", "quantity", "description")
        }
        return build_distribution(table.text("distribution"), parameters)
    size = _scatter_size(table, kind, unit, reference)
    mean = table.number("mean", unit, reference)
    if kind == "plus_minus":
        return build_distribution("Uniform", {"a": mean - size, "b": mean + size})
    return build_distribution("Normal", {"mu": mean, "sigma": size / 3.0 if kind == "three_sigma" else size})


def _scatter_size(table, kind, unit, reference):
    """The size of a scatter given as a number or as a percentage of the nominal value."""
    value = table.data[kind]
    if isinstance(value, str) and value.endswith("%"):
        try:
            percent = float(value[:-1])
        except ValueError:
            percent = math.nan
        size = 0.01 * percent * abs(reference)
        if _is_number(size, "positive"):
            return size
        if reference == 0.0 and _is_number(percent, "positive"):
            raise table.error(kind, value, f"a number in {unit}: the nominal value is 0, which has no percentage")
    elif _is_number(value, "positive"):
        return float(value)
    raise table.error(kind, value, f"a finite, positive number in {unit}, or a percentage such as '1.5 %'")


def _copula(root, inputs):
    """The copula of the tables [[correlation]], or None."""
    names = [row.name for row in inputs]
    correlations = {}
    for table in root.tables("correlation", ("inputs", "coefficient", "rank")):
        allowed = "a list of at least two names of uncertain inputs"
        given = table.get("inputs", _MISSING, allowed)
        if not isinstance(given, list) or not all(isinstance(name, str) for name in given):
            raise table.error("inputs", given, allowed)
        members = [name for one in given for name in _input_names(table, one, inputs)]
        if len(members) < 2 or len(set(members)) < len(members):
            raise table.error("inputs", given, f"{allowed}, each once")
        kinds = [key for key in ("coefficient", "rank") if key in table]
        if len(kinds) != 1:
            what = "both" if kinds else "neither coefficient nor rank"
            raise CaseError(
                f"{root.file}: {table.path} has {what}, but it must have exactly one of coefficient and rank"
            )
        value = table.number(kinds[0], "", below=1.0)
        # Spearman's coefficient of a normal copula is 6 / pi arcsin(R / 2).
        value = 2.0 * math.sin(math.pi / 6.0 * value) if kinds[0] == "rank" else value
        for pair in itertools.combinations(sorted(members, key=names.index), 2):
            if pair in correlations:
                raise CaseError(f"{root.file}: {table.path} correlates {' and '.join(pair)} a second time")
            correlations[pair] = value
    try:
        return normal_copula(names, correlations)
    except ValueError as error:
        raise CaseError(f"{root.file}: correlation cannot be used: {error}") from error


def _input_names(table, name, inputs):
    """The inputs that a name stands for: one, or all of an entry that makes one for every spring."""
    found = [row.name for row in inputs if name in (row.name, row.entry)]
    if not found:
        known = [row.name for row in inputs]
        hint = did_you_mean(name, known) or (
            f"; there are {', '.join(known[:4])}, ..." if known else "; there are none"
        )
        raise table.error("inputs", name, f"an uncertain input of the table [inputs]{hint}")
    return found


def _requirements(root, separation):
    known = quantity_table(separation)
    requirements = []
    keys = ("name", "quantity", "maximum", "minimum", "allowed_probability")
    for table in root.tables("requirements", keys):
        quantity = table.text("quantity")
        if quantity not in known:
            hint = did_you_mean(quantity, known)
            if quantity == "clearance":
                hint = "; a clearance needs the table [envelope]"
            if quantity == "recontact_distance":
                hint = "; a re-contact distance needs the table [recontact]"
            raise table.error("quantity", quantity, f"one of {', '.join(known)}{hint}")
        limits = [key for key in ("maximum", "minimum") if key in table]
        if len(limits) != 1:
            what = "both" if limits else "neither maximum nor minimum"
            raise CaseError(
                f"{root.file}: {table.path} has {what}, but it must have exactly one of maximum and minimum"
            )
        allowed = None
        if "allowed_probability" in table:
            allowed = table.number("allowed_probability", "", sign="positive", below=1.0)
        name = table.name("name", quantity)
        if any(other.name == name for other in requirements):
            raise table.error("name", name, "different from the names of the other requirements")
        if name == SYSTEM:
            raise table.error("name", name, "another name: this one stands for the violation of any of them")
        limit = table.number(limits[0], known[quantity].unit)
        requirements.append(Requirement(name, quantity, limit, limits[0] == "maximum", allowed))
    return tuple(requirements)
