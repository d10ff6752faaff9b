"""Ground tests: their table, the conditions of each, and the separation under these conditions."""

import copy
import csv
import io
import math
import os
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from satsep_ot.dynamics.quantities import CONTACT_QUANTITIES, quantity_table
from satsep_ot.dynamics.separation import Separation, Status
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients
from satsep_ot.model.case import Case, CaseError, case_from_data
from satsep_ot.model.inputs import ParameterMap, UncertainInput, scatter_targets
from satsep_ot.model.parameters import TABLES
from satsep_ot.model.reading.table import shown, shown_key
from satsep_ot.model.spelling import did_you_mean
from satsep_ot.model.text import is_printable, parsed_number, read_text_file

COLUMNS = ("test", "quantity", "value", "sigma")
ABSENT = "none"  # in a cell: the test has no such key or table, as orbit = none
_MOST_ROWS = 2000
_LONGEST_FILE = 1_000_000  # characters
_CHUNK = 16384  # runs at once
_HEADER = "a header that begins 'test,quantity,value,sigma'"
# What has the signs that these sizes lack, beside the parts of norms.
_SIGNED = {
    "lateral_velocity": ("axial_velocity", "direction_x", "direction_z"),
    "platform_velocity_change": ("axial_velocity", "direction_x", "direction_z"),
}
# Of a test these parts of the case say nothing.
_OF_FLIGHT = ("requirements", "correlation")


@dataclass(frozen=True)
class TestRow:
    """One measured number.

    Parameters
    ----------
    quantity : str
        A quantity of interest, or an uncertain input by its name or its key.
    value, sigma : float
        In its unit; `sigma` is the standard deviation of the error of the measurement.
    row : int
        Of the file, where the header is row 1.
    """

    __test__ = False
    quantity: str
    value: float
    sigma: float
    row: int


@dataclass(frozen=True)
class GroundTest:
    """One test: its conditions, and what was measured.

    Parameters
    ----------
    name : str
    separation : :class:`satsep_ot.dynamics.separation.Separation`
        The nominal separation under the conditions of the test [SI].
    conditions : dict of str to str
        How it differs from the case, by key.
    rows : tuple of TestRow
    """

    name: str
    separation: Separation
    conditions: dict[str, str]
    rows: tuple[TestRow, ...]


def load_ground_tests(path: str | os.PathLike, case: Case) -> list[GroundTest]:
    """Read the tests of a CSV file.

    Parameters
    ----------
    path : str or path
        With the columns test, quantity, value and sigma, and one for each key of the case in which a test differed.
    case : Case

    Returns
    -------
    tests : list of GroundTest
        In the order of the file.

    Raises
    ------
    CaseError
        In one sentence, if the file cannot be read or a row is not allowed.
    """
    try:
        text = read_text_file(path, _LONGEST_FILE, newline="")
    except FileNotFoundError as error:
        raise CaseError(f"{path}: there is no such file; give a CSV file with {_HEADER}") from error
    except ValueError as error:
        raise CaseError(str(error)) from error
    return parse_ground_tests(text, case, str(path))


def parse_ground_tests(text: str, case: Case, file: str = "tests") -> list[GroundTest]:
    """Read the tests from the text of a CSV file.

    Parameters
    ----------
    text : str
    case : Case
    file : str
        Name of the file, for messages.

    Returns
    -------
    tests : list of GroundTest

    Raises
    ------
    CaseError
        As for `load_ground_tests`.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.ground_tests import parse_ground_tests
    >>> text = "test,quantity,value,sigma,satellite.mass\\ndrop 1,axial_velocity,0.61,0.001,95"
    >>> [test] = parse_ground_tests(text, load_case("reference"))
    >>> test.name, test.separation.satellite.mass, test.rows[0].value
    ('drop 1', 95.0, 0.61)
    """
    header, lines = _cells(text, file)
    keys = [name for name in header if name not in COLUMNS]
    found: dict[str, tuple[dict[str, str], list[TestRow]]] = {}
    for number, cells in lines:
        where = f"{file}: row {number}"
        given = dict(zip(header, cells, strict=True))
        name = given["test"]
        if not name or len(name) > 100 or not is_printable(name):
            raise CaseError(f"{where}: test = {shown(name)}, but it must be a name of 1 to 100 printable characters")
        conditions = {key: given[key] for key in keys if given[key]}
        first, rows = found.setdefault(name, (conditions, []))
        if conditions != first:
            key = next(key for key in keys if conditions.get(key) != first.get(key))
            raise CaseError(
                f"{where}: {key} = {given[key] or 'nothing'}, but the rows before of test {name} have "
                f"{first.get(key) or 'nothing'}; all rows of a test must have the same conditions"
            )
        rows.append(_row(given, number, where))
    separations: dict[str, Separation] = {}
    tests = []
    for name, (conditions, rows) in found.items():
        key = repr(sorted(conditions.items()))
        if key not in separations:
            separations[key] = _separation(case, conditions, f"{file}: test {name}")
        test = GroundTest(name, separations[key], conditions, tuple(rows))
        _check_quantities(test, case, file)
        tests.append(test)
    return tests


def _cells(text, file):
    """The header, and the rows below it with their numbers."""
    try:
        every = list(enumerate(csv.reader(io.StringIO(text, newline="")), start=1))
    except csv.Error as error:
        raise CaseError(f"{file}: the file cannot be read ({error})") from error
    filled = [(number, [cell.strip() for cell in cells]) for number, cells in every if any(map(str.strip, cells))]
    if not filled:
        raise CaseError(f"{file}: the file is empty; it must have {_HEADER} and a row for each measured number")
    header, lines = filled[0][1], filled[1:]
    for name in COLUMNS:
        if header.count(name) != 1:
            what = "is missing" if name not in header else "stands there twice"
            raise CaseError(f"{file}: the column {name} {what}; the file must have {_HEADER}, with commas between")
    for name in header:
        if header.count(name) > 1 or not name:
            raise CaseError(f"{file}: the column {shown(name)} stands there twice; each must have a name of its own")
    if not lines:
        raise CaseError(f"{file}: there is no test; give a row for each measured number")
    if len(lines) > _MOST_ROWS:
        raise CaseError(f"{file}: {len(lines)} rows, but there must be at most {_MOST_ROWS}")
    for number, cells in lines:
        if len(cells) != len(header):
            raise CaseError(
                f"{file}: row {number} has {len(cells)} cells, but it must have {len(header)}, as the header"
            )
    return header, lines


def _row(given, number, where):
    value, sigma = parsed_number(given["value"]), parsed_number(given["sigma"])
    if not math.isfinite(value):
        raise CaseError(
            f"{where}: value = {shown(given['value'])}, but it must be a finite number with a decimal point"
        )
    if not given["sigma"]:
        raise CaseError(f"{where}: sigma is missing; it must be the standard deviation of the measurement's error")
    if not 0.0 < sigma < math.inf:
        raise CaseError(
            f"{where}: sigma = {shown(given['sigma'])}, but it must be positive: the standard deviation of the "
            "measurement's error"
        )
    return TestRow(given["quantity"], value, sigma, number)


def _separation(case, conditions, where):
    """The separation under the conditions of a test."""
    numbers = {key: cell for key, cell in conditions.items() if _is_parameter(case.separation, key, cell)}
    others = {key: cell for key, cell in conditions.items() if key not in numbers}
    separation = case.separation
    if others:
        if not case.text:
            raise CaseError(f"{where}: {min(others)} can only be changed in a case that comes from a file")
        data = copy.deepcopy(tomllib.loads(case.text))
        for part in _OF_FLIGHT:
            data.pop(part, None)
        for key, cell in others.items():
            _change(data, key, cell, where)
        # Inputs whose quantity this separation lacks play no part in the test.
        data.pop("inputs", None)
        if "orbit" not in data:
            data.pop("recontact", None)
        try:
            separation = case_from_data(data, where, files=case.files).separation
        except CaseError as error:
            raise CaseError(f"{where} cannot be used: {str(error).removeprefix(where + ': ')}") from error
    if not numbers:
        return separation
    targets, vector = scatter_targets(separation), separation.parameters()
    places = {name: index for index, name in enumerate(separation.parameter_names())}
    for key, cell in numbers.items():
        value = parsed_number(cell)
        if key not in targets or not math.isfinite(value):
            raise CaseError(
                f"{where}: {key} = {shown(cell)}, but it must be a finite number, and the test must have one"
            )
        for name in targets[key].parameters:
            vector[places[name]] = value * targets[key].unit.factor
    try:
        return separation.with_parameters(vector)
    except ValueError as error:
        raise CaseError(f"{where}: the conditions are not possible: {error}") from error


def _is_parameter(separation, key, cell):
    return key in scatter_targets(separation) and cell != ABSENT and not cell.startswith("[")


def _change(data, key, cell, where):
    """Set a key of the data of a case to what a cell says."""
    table, _, name = key.rpartition(".")
    tables = {name: one for name, one in TABLES.items() if name not in (*_OF_FLIGHT, "inputs")}
    if key in tables and cell != ABSENT:
        raise CaseError(f"{where}: {key} = {shown(cell)}, but a whole table can only be {ABSENT}; give one of its keys")
    if key not in tables and (table not in tables or name not in tables[table].keys):
        every = [f"{one.name}.{row.key}".lstrip(".") for one in tables.values() for row in one.rows]
        hint = did_you_mean(key, [*every, *tables]) or "; a column must be one of its keys, such as satellite.mass"
        raise CaseError(f"{where}: {shown_key(key)} is no key of the case{hint}")
    if cell == ABSENT:
        holder = data.get(table, {}) if table else data
        if isinstance(holder, dict):
            holder.pop(name, None)
        return
    try:
        value = tomllib.loads(f"value = {cell.replace(';', ',')}")["value"]
    except (tomllib.TOMLDecodeError, RecursionError, ValueError):
        value = cell
    holder = data.setdefault(table, {}) if table else data
    if not isinstance(holder, dict):
        raise CaseError(f"{where}: {key} cannot be changed: the case has several [[{table}]]; give {table}.{name}.1")
    holder[name] = value


def _check_quantities(test, case, file):
    table = quantity_table(test.separation)
    first: dict[str, int] = {}
    for row in test.rows:
        where = f"{file}: row {row.row}: quantity = {shown(row.quantity)}"
        pieces = measured_inputs(case, row.quantity)
        if row.quantity in first and len(pieces) < 2:
            raise CaseError(
                f"{where} stands in row {first[row.quantity]} too, for the same test; give one value with its sigma, "
                "or another name to another test"
            )
        first[row.quantity] = row.row
        if row.quantity in table:
            if row.quantity in CONTACT_QUANTITIES:
                raise CaseError(f"{where} has no gradient, which the update needs; give velocities and rates")
            parts = _SIGNED.get(row.quantity, table[row.quantity].norm_of)
            if parts:
                raise CaseError(
                    f"{where} has lost the signs of what it is made of, which the update needs; give "
                    f"{' and '.join(parts)}"
                )
        elif not pieces:
            known = [*table, *(one.name for one in case.inputs)]
            hint = did_you_mean(row.quantity, known) or f"; there are {', '.join(known)}"
            raise CaseError(f"{where} is neither a quantity of this case nor an uncertain input{hint}")
        elif len(pieces) > 1 and case.inputs[pieces[0]].is_shared_by_tests:
            raise CaseError(f"{where} is shared by tests and flight; say which one it is, as in {row.quantity}_1")


def measured_inputs(case: Case, name: str) -> list[int]:
    """Indices of the uncertain inputs that the name or the key of a measured input stands for.

    Parameters
    ----------
    case : Case
    name : str
        Of an input, of an entry with `.each`, or a key such as "springs.stiffness.2".

    Returns
    -------
    indices : list of int
        Several for an entry with `.each`, of which a further piece was measured; empty if there is none.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.ground_tests import measured_inputs
    >>> case = load_case("reference")
    >>> measured_inputs(case, "springs.stiffness.2"), measured_inputs(case, "stiffness"), measured_inputs(case, "mass")
    ([15], [14, 15, 16, 17], [])
    """
    found = [i for i, row in enumerate(case.inputs) if row.name == name]
    if not found:
        found = [i for i, row in enumerate(case.inputs) if name in (row.entry, f"{row.key}.each")]
    if not found:
        target = scatter_targets(case.separation).get(name)
        found = [i for i, row in enumerate(case.inputs) if target is not None and row.parameters == target.parameters]
    return found


def changed_inputs(case: Case, separation: Separation) -> tuple[int, ...]:
    """Indices of the uncertain inputs whose nominal value is another one in a test: they are of another piece there."""
    names = separation.parameter_names()
    there = dict(zip(names, separation.parameters(), strict=True))
    here = dict(zip(case.separation.parameter_names(), case.separation.parameters(), strict=True))
    return tuple(
        i
        for i, row in enumerate(case.inputs)
        if any(there.get(name, here[name]) != here[name] for name in row.parameters)
    )


class SeparationModel:
    """Quantities of a separation as a function of the uncertain inputs of a case, NaN where a run fails.

    Parameters
    ----------
    inputs : sequence of :class:`satsep_ot.model.inputs.UncertainInput`
        Each moves its parameters by its deviation from its reference, whatever their nominal values are here.
    separation : :class:`satsep_ot.dynamics.separation.Separation`
    quantities : sequence of str

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.ground_tests import SeparationModel
    >>> case = load_case("reference")
    >>> model = SeparationModel(case.inputs, case.separation, ["axial_velocity"])
    >>> model.evaluate([[row.reference for row in case.inputs]]).round(4).tolist()
    [[0.5979]]
    """

    def __init__(self, inputs: Sequence[UncertainInput], separation: Separation, quantities: Sequence[str]) -> None:
        known = set(separation.parameter_names())
        there = [replace(row, parameters=tuple(name for name in row.parameters if name in known)) for row in inputs]
        self._map = ParameterMap(there, separation)
        self._separation, self._quantities = separation, list(quantities)

    def evaluate(self, X: Any) -> np.ndarray:
        """Quantities (N, Q) of inputs (N, d)."""
        X = np.asarray(X, dtype=float)
        parts = []
        for start in range(0, len(X), _CHUNK):
            outcome = simulate(self._separation, self._map.parameters(X[start : start + _CHUNK]))
            values = np.column_stack([outcome.quantity(name) for name in self._quantities])
            values[outcome.status != Status.OK] = np.nan
            parts.append(values)
        return np.concatenate(parts)

    def computeGradientSample(self, X: Any) -> np.ndarray:
        """Their derivatives (N, d, Q)."""
        parameters = self._map.parameters(np.asarray(X, dtype=float))
        outcome = simulate_with_gradients(self._separation, parameters, quantities=self._quantities)
        return np.stack([self._map.gradient(outcome.quantity_gradient(name)) for name in self._quantities], axis=2)
