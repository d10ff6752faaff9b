"""A case: a TOML file, in the units that engineers use, read into validated data in SI.

The annotated file `cases/reference.toml` of this package names every key with its unit and default; the table behind it
is `satsep_ot.model.parameters`.
"""

import json
import os
import re
import tomllib
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import openturns as ot

from satsep_ot.dynamics.separation import Separation
from satsep_ot.model.distributions import correlated_pairs
from satsep_ot.model.failures import PartFailure
from satsep_ot.model.inputs import UncertainInput
from satsep_ot.model.parameters import CORRELATION, REQUIREMENT, TABLES
from satsep_ot.model.reading.failures import read_failures
from satsep_ot.model.reading.inputs import read_copula, read_inputs
from satsep_ot.model.reading.requirements import read_requirements
from satsep_ot.model.reading.separation import read_separation
from satsep_ot.model.reading.table import CaseError, Table, tables
from satsep_ot.model.requirement import SYSTEM, Requirement
from satsep_ot.model.spelling import did_you_mean
from satsep_ot.model.text import read_text_file

__all__ = [
    "SYSTEM", "Case", "CaseError", "Requirement", "load_case", "load_uncertain_case", "new_case_text", "parse_case",
    "shipped_cases",
]  # fmt: skip

_LONGEST_FILE = 4_000_000  # characters
_MOST_PARTS = 100  # of a key
_PART = r"""(?:[A-Za-z0-9_-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')"""
_LONG_KEY = re.compile(rf"(?<![A-Za-z0-9_-]){_PART}(?:[ \t]*+\.[ \t]*+{_PART}){{{_MOST_PARTS},}}+")


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
    failures : tuple of :class:`satsep_ot.model.failures.PartFailure`
        Parts that fail with a probability; everything else of the case is with all parts in order.
    fleet : int
        Number of satellites; inputs that are shared have one value for all of them.

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
    failures: tuple[PartFailure, ...] = ()
    fleet: int = 1


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
    # A text in TOML is written as in JSON, which may have every character as it is.
    line = f"name = {json.dumps(name, ensure_ascii=False)}"
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
        text = read_text_file(path, _LONGEST_FILE)
    except FileNotFoundError as error:
        shipped = ", ".join(shipped_cases())
        raise CaseError(
            f"{path}: there is no such file, and no case of that name in the package ({shipped})"
            f"{did_you_mean(str(path), shipped_cases())}"
        ) from error
    except ValueError as error:
        raise CaseError(str(error)) from error
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
    return case_from_data(_toml(text, file), file, text)


def case_from_data(data: dict[str, Any], file: str, text: str = "", files: dict[str, str] | None = None) -> Case:
    """The case that plain data say, as a TOML file holds them.

    Parameters
    ----------
    data : dict
    file : str
        Name of the file, for messages.
    text : str
        The text of the file.
    files : dict of str to str, optional
        Force-stroke tables that were read before, as in `Case.files`; the others are read beside the file.

    Returns
    -------
    case : Case

    Raises
    ------
    CaseError
        As for `load_case`.
    """
    top = Table(file, TABLES[""], data, inner=[name for name in TABLES if name and "." not in name])
    files = dict(files or {})
    separation = read_separation(top, files)
    inputs = read_inputs(file, data.get("inputs", {}), separation)
    correlations = tables(file, CORRELATION, data.get("correlation", []), "correlation")
    requirements = tables(file, REQUIREMENT, data.get("requirements", []), "requirements")
    failures = read_failures(
        Table(file, TABLES["springs"], data["springs"]),
        tables(file, TABLES["umbilical"], data.get("umbilical", []), "umbilical", one=True),
        tables(file, TABLES["hold_down"], data.get("hold_down", []), "hold_down", one=True),
        separation,
    )
    copula = read_copula(correlations, inputs)
    _check_fleet(top, inputs, copula)
    return Case(
        name=top.read("name") or Path(file).stem,
        description=top.read("description"),
        separation=separation,
        inputs=inputs,
        requirements=read_requirements(requirements, separation),
        copula=copula,
        text=text,
        files=files,
        failures=failures,
        fleet=top.read("fleet"),
    )


def _check_fleet(top, inputs, copula):
    """Refuse inputs that are shared by nobody, or correlated with what each satellite has of its own."""
    shared = [row.name for row in inputs if row.is_shared]
    if shared and top.read("fleet") == 1:
        raise top.problem(
            f"inputs.{shared[0]} is shared, but by no other satellite; give `fleet` at the top of the file"
        )
    for first, second, _ in correlated_pairs([row.name for row in inputs], copula):
        if (first in shared) != (second in shared):
            raise top.problem(
                f"{first} and {second} are correlated, but only one of them is shared by the fleet; share both or none"
            )


def _toml(text, file):
    """What a text in TOML says."""
    # The time and memory of tomllib grow with the square of the parts of a key.
    if _LONG_KEY.search(text):
        raise CaseError(f"{file}: a key has more than {_MOST_PARTS} parts with dots between them, which no case needs")
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        reason = str(error)
    except RecursionError:
        reason = "tables or arrays are nested too deep"
    except ValueError:
        reason = "a whole number has more digits than any number of a case"
    raise CaseError(f"{file}: not valid TOML: {reason}")
