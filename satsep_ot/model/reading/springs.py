"""Springs, umbilical connectors and the force line, from their tables."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from satsep_ot.dynamics.separation import Springs, umbilical
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.model.force_table import checked_force_table, force_table_text, parse_force_table
from satsep_ot.model.reading.table import CaseError, Table, shown, shown_key
from satsep_ot.model.values import MILLIMETRE, Name


def read_springs(table: Table, files: dict[str, str]) -> Springs:
    """The separation springs.

    Parameters
    ----------
    table : Table
        [springs]
    files : dict of str to str
        The texts of the CSV files read so far, by their paths from the folder of the case; those read here are added.

    Returns
    -------
    springs : Springs

    Raises
    ------
    CaseError
        If a key is missing or not allowed.
    """
    angle = _angles(table)
    count = len(angle)
    values = {"angle": angle}
    for row in table.rows.rows:
        if row.holder == "springs" and row.parameter not in ("angle", "stiffness", "deformation"):
            values[row.parameter] = table.read(row.key, count)
    values["scale"][table.read("failed", count) or []] = 0.0
    force_tables = _force_tables(table, values["stroke"], files)
    for name in ("stiffness", "deformation"):
        values[name] = _of_linear_springs(table, name, force_tables)
    return Springs(**values, tables=force_tables, interpolation=table.read("interpolation"))


def read_umbilicals(tables: list[Table], pin_stiffness: float) -> Iterator[Springs]:
    """The springs of each umbilical connector; its pins have that stiffness [N/m] where the file says no other."""
    for table in tables:
        given = {row.key: table.read(row.key) for row in table.rows.rows if row.field}
        if given["pin_stiffness"] is None:
            given["pin_stiffness"] = pin_stiffness
        yield umbilical(**given)


def read_force_line(table: Table) -> ForceLine:
    """The force line; what only another one has must be left out."""
    line = table.read("force_line")
    length = table.read("stowed_length", is_needed=line.has_stowed_length)
    name = line.name.lower()
    if length > 0.0 and not line.has_stowed_length:
        raise table.error("stowed_length", f"left out for {name} springs: only a strut has one")
    if length == 0.0 and line.has_stowed_length:
        raise table.error(
            "stowed_length", "positive for a strut: a strut whose ends coincide has no direction, and buckles"
        )
    if table.read("guide_friction") > 0.0 and not line.loads_guide:
        reason = "only the force line 'normal' loads the guides laterally"
        raise table.error("guide_friction", f"left out for {name} springs: {reason}")
    return line


def _angles(table):
    """The angles of the seats as they are given, or of so many springs at equal distances."""
    angles = table.read("angles")
    if angles is None:
        if "count" not in table:
            allowed = table.rows["count"].value.allowed()
            raise table.problem(f"springs.count is missing; it must be {allowed}, unless `angles` are given")
        count = table.read("count")
        # Hu et al. (2017), equation 4: a ring that is its own mirror image.
        return (2.0 * np.arange(count) + 1.0) * math.pi / count
    if "count" in table and table.data["count"] != len(angles):
        raise table.error("count", f"{len(angles)}, the number of angles given, or left out")
    table.read("count")
    return angles


def _of_linear_springs(table, key, force_tables):
    """A positive number for each spring but those that have a force-stroke table, whose number is 0."""
    measured, count = [entry is not None for entry in force_tables], len(force_tables)
    if all(measured):
        if key in table:
            raise table.error(key, "left out: every spring has a force-stroke table instead")
        return np.zeros(count)
    if not any(measured) or not isinstance(table.data.get(key), list):
        return np.where(measured, 0.0, table.read(key, count, is_needed=True))
    values = table.read_as(table.rows[key].value.with_zeros(), key, count)
    if not np.array_equal(values == 0.0, measured):
        raise table.error(key, "0 for each spring that has a force-stroke table, and positive for the others")
    return values


def _force_tables(table, stroke, files):
    """The force-stroke table [m, N] of each spring, or None."""
    value, count = table.read("table") or {}, len(stroke)
    keys = [str(n) for n in range(1, count + 1)]
    # One table for all, or one for each spring that is named by its number.
    entries = value if isinstance(value, dict) else dict.fromkeys(keys, value)
    for key in entries:
        if key not in keys:
            raise table.problem(f"springs.table.{shown_key(key)} is not a known key; the springs are 1 to {count}")
    found = []
    for key, needed in zip(keys, stroke, strict=True):
        where = f"{table.file}: springs.table" + (f".{key}" if isinstance(value, dict) else "")
        found.append(_force_table(table, where, entries[key], needed, files) if key in entries else None)
    return tuple(found)


def _force_table(table, where, value, stroke, files):
    is_file = isinstance(value, str)
    if not isinstance(value, list) and not (is_file and Name(longest=1000).accepts(value)):
        raise CaseError(f"{where} = {shown(value)}, but it must be {table.rows['table'].value.allowed()}")
    try:
        rows = _read_file(table, value, files) if is_file else checked_force_table(value, where)
    except ValueError as error:
        raise CaseError(f"{where}: {error}" if is_file else str(error)) from error
    if rows[-1, 0] < stroke:
        end, needed = rows[-1, 0] / MILLIMETRE.factor, stroke / MILLIMETRE.factor
        raise CaseError(
            f"{where}: the last stroke is {end:g} mm, but it must be the spring's stroke of {needed:g} mm or more"
        )
    return rows


def _read_file(table, name, files):
    """The table of a CSV file in the folder of the case or below: a case reads nothing that does not belong to it."""
    folder = Path(table.file).parent
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise ValueError(f"{name!r} must be in the folder of the case file or below: name it from there, without '..'")
    if not (folder / name).resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{name!r} is a link out of the folder of the case file; put the file itself there")
    if name not in files:
        files[name] = force_table_text(folder / name)
    return parse_force_table(files[name], str(folder / name))
