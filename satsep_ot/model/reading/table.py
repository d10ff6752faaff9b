"""One table of a case file, read key by key; every refusal names file, key, what was given and what is allowed."""

import re
from collections.abc import Iterable, Sequence
from typing import Any

from satsep_ot.model.rows import ABSENT, NEEDED, CaseTable
from satsep_ot.model.spelling import did_you_mean
from satsep_ot.model.values import Refused, Value


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


class Table:
    """One table of the file.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    rows : CaseTable
        What its keys are.
    data : dict
        What the file says.
    path : str, optional
        What messages call the table; by default the name of `rows`.
    inner : sequence of str
        Keys that are tables themselves.
    is_open : bool
        Whether other keys than those of `rows` are allowed.

    Raises
    ------
    CaseError
        If a key is not known.
    """

    def __init__(
        self,
        file: str,
        rows: CaseTable,
        data: dict[str, Any],
        path: str | None = None,
        inner: Sequence[str] = (),
        is_open: bool = False,
    ) -> None:
        self.file, self.rows, self.data = file, rows, data
        self.path = rows.name if path is None else path
        known = [*rows.keys, *inner]
        for key in data:
            if key not in known and not is_open:
                hint = did_you_mean(key, known) or f"; the keys here are {', '.join(known)}"
                raise CaseError(f"{file}: {self.name_of(key)} is not a known key{hint}")

    def __contains__(self, key: str) -> bool:
        return key in self.data

    def name_of(self, key: str) -> str:
        """How messages call a key."""
        return f"{self.path}.{shown_key(key)}" if self.path else shown_key(key)

    def error(self, key: str, allowed: str, given: Any = None) -> CaseError:
        """The refusal of a key: what was given (by default what the file says), and what is allowed."""
        given = self.data[key] if given is None else given
        return CaseError(f"{self.file}: {self.name_of(key)} = {shown(given)}, but it must be {allowed}")

    def problem(self, sentence: str) -> CaseError:
        """The refusal of the table for another reason."""
        return CaseError(f"{self.file}: {sentence}")

    def read(self, key: str, count: int = 0, is_needed: bool = False) -> Any:
        """The value of a key in SI, or its default; None where there is neither.

        Parameters
        ----------
        key : str
        count : int
            How many springs there are, for keys of springs.
        is_needed : bool
            Whether the key is needed here, whatever its row says.

        Raises
        ------
        CaseError
            If it is missing, or not allowed.
        """
        row = self.rows[key]
        if key not in self.data:
            if is_needed or row.default is NEEDED:
                raise CaseError(f"{self.file}: {self.name_of(key)} is missing; it must be {row.value.allowed(count)}")
            if row.default is ABSENT:
                return None
            default = list(row.default) if isinstance(row.default, tuple) else row.default
            return row.value.read(default, count)
        return self.read_as(row.value, key, count)

    def read_as(self, value: Value, key: str, count: int = 0) -> Any:
        """The value of a key that the file gives, read as another kind of value than its row has."""
        try:
            return value.read(self.data[key], count)
        except Refused as error:
            raise self.error(key, str(error), error.given) from error

    def exactly_one_of(self, keys: Sequence[str], none_given: str, several_given: str = "both") -> str:
        """The one of some keys that the file gives; a refusal if it gives none or several."""
        given = [key for key in keys if key in self]
        if len(given) != 1:
            allowed = ", ".join(keys) if len(keys) > 2 else " and ".join(keys)
            what = several_given if given else none_given
            raise self.problem(f"{self.path} has {what}, but it must have exactly one of {allowed}")
        return given[0]


def tables(file: str, rows: CaseTable, entries: Any, path: str, one: bool = False) -> list[Table]:
    """The tables of a list, each headed [[name]]; with `one`, a single table headed [name] will do."""
    if one and isinstance(entries, dict):
        return [Table(file, rows, entries, path)]
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        heading = path.rpartition(".")[2]
        raise CaseError(
            f"{file}: {path} = {shown(entries)}, but it must be a list of tables, each headed [[{heading}]]"
        )
    return [Table(file, rows, entry, f"{path}[{n}]") for n, entry in enumerate(entries, start=1)]


def shown(value: Any) -> str:
    """A value as a message quotes it: on one line, and not too much of it."""
    try:
        text = repr(value)
    except ValueError:
        # Python writes no number of more than some thousand digits.
        text = "a number of very many digits"
    return text if len(text) <= 60 else text[:57] + "..."


def shown_key(key: str) -> str:
    """A key as TOML writes it: in quotes unless it is a plain word."""
    return key if re.fullmatch(r"[A-Za-z0-9_.-]{1,60}", key) else shown(key)


def example_of(known: Iterable[str], count: int = 3) -> str:
    """The first of some words, for a message: "a, b, c, ... (12 in all)"."""
    known = list(known)
    return f"{', '.join(known[:count])}, ... ({len(known)} in all)"
