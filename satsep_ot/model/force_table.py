"""Measured force-stroke tables: read from a CSV file, checked row by row."""

import csv
import io
import math
import os
from collections.abc import Sequence

import numpy as np

from satsep_ot.model.text import parsed_number, read_text_file
from satsep_ot.model.values import is_numbers

_MAXIMUM_ROWS = 1000
_LONGEST_FILE = 1_000_000  # characters
_HEADER = "a header such as 'stroke_mm,force_N'"


def force_table_text(path: str | os.PathLike) -> str:
    """The text of a CSV file.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    text : str
        With its line ends as they are, without a byte order mark.

    Raises
    ------
    ValueError
        In one sentence, if the file cannot be read or is far too long.

    Examples
    --------
    >>> from satsep_ot.model.force_table import force_table_text
    >>> try:
    ...     force_table_text(".")
    ... except ValueError as error:
    ...     print(error)
    .: it is a directory; give a regular file
    """
    try:
        return read_text_file(path, _LONGEST_FILE, newline="")
    except FileNotFoundError as error:
        raise ValueError(f"{path}: there is no such file") from error


def parse_force_table(text: str, where: str) -> np.ndarray:
    """A force-stroke table from the text of a CSV file: a header, then rows of stroke [mm] and force [N].

    Parameters
    ----------
    text : str
    where : str
        The name of the file, for messages.

    Returns
    -------
    table : ndarray, shape (K, 2)
        As `checked_force_table` returns it.

    Raises
    ------
    ValueError
        In one sentence that names the file, and where it is a row that is wrong, the row and its value. The header is
        row 1, as in a spreadsheet.

    Examples
    --------
    >>> from satsep_ot.model.force_table import parse_force_table
    >>> parse_force_table("stroke_mm,force_N\\n0,220\\n30,55", "spring.csv").tolist()
    [[0.0, 220.0], [0.03, 55.0]]
    """
    try:
        lines = [
            (number, cells)
            for number, cells in enumerate(csv.reader(io.StringIO(text, newline="")), start=1)
            if any(cells)
        ]
    except csv.Error as error:
        raise ValueError(f"{where}: the file cannot be read ({error})") from error
    if not lines:
        raise ValueError(f"{where}: the file is empty; it must have {_HEADER} and two or more rows")
    number, header = lines[0]
    if not any(math.isnan(parsed_number(cell)) for cell in header):
        raise ValueError(
            f"{where}: row {number} = '{_on_one_line(','.join(header))}' holds numbers; it must be {_HEADER}"
        )
    return checked_force_table(
        [[parsed_number(cell) for cell in cells] for _, cells in lines[1:]],
        where,
        [number for number, _ in lines[1:]],
        [_on_one_line(",".join(cells)) for _, cells in lines[1:]],
    )


def checked_force_table(
    rows: list, where: str, numbers: Sequence[int] | None = None, shown: Sequence[str] | None = None
) -> np.ndarray:
    """A force-stroke table from its rows, if they are such a table.

    Parameters
    ----------
    rows : list of [stroke, force]
        In mm and N.
    where : str
        What the table is called, for messages.
    numbers : sequence of int, optional
        What each row is called, by default from 1.
    shown : sequence of str, optional
        What was given in each row.

    Returns
    -------
    table : ndarray, shape (K, 2)
        Stroke [m], from 0, strictly ascending, and force [N], not negative.

    Raises
    ------
    ValueError
        In one sentence that names the row and its value.

    Examples
    --------
    >>> from satsep_ot.model.force_table import checked_force_table
    >>> checked_force_table([[0.0, 220.0], [30.0, 55.0]], "springs.table").tolist()
    [[0.0, 220.0], [0.03, 55.0]]
    >>> try:
    ...     checked_force_table([[0.0, 220.0], [30.0, 55.0], [20.0, 80.0]], "springs.table")
    ... except ValueError as error:
    ...     print(error)
    springs.table: row 3 = [20.0, 80.0]: the stroke must be above that of the row before, 30 mm
    """
    numbers = range(1, len(rows) + 1) if numbers is None else numbers
    shown = [_on_one_line(str(row)) for row in rows] if shown is None else shown
    if not 2 <= len(rows) <= _MAXIMUM_ROWS:
        raise ValueError(f"{where}: {len(rows)} rows of stroke [mm] and force [N]; there must be 2 to {_MAXIMUM_ROWS}")
    before = None
    for number, row, text in zip(numbers, rows, shown, strict=True):
        place = f"{where}: row {number} = {text}"
        if not is_numbers(row, 2):
            raise ValueError(f"{place}: it must be two finite numbers, stroke [mm] and force [N]")
        stroke, force = row
        if before is None and stroke != 0.0:
            raise ValueError(f"{place}: the first stroke must be 0 mm, where the spring is stowed")
        if before is not None and stroke <= before:
            raise ValueError(f"{place}: the stroke must be above that of the row before, {before:g} mm")
        if force < 0.0:
            raise ValueError(f"{place}: the force must not be negative: a spring pushes")
        before = stroke
    return np.array(rows, dtype=float) * [1e-3, 1.0]


def _on_one_line(text):
    """A row as a message quotes it."""
    return "".join(character if character.isprintable() else "?" for character in text[:60])
