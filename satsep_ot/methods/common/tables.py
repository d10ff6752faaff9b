"""Tables of text, Markdown and comma-separated values."""

import csv
import io
from collections.abc import Sequence


def markdownTable(cells: list[list[str]], names: int) -> str:
    """A Markdown table whose first columns are names and whose other columns are numbers.

    Parameters
    ----------
    cells : list of rows of str
        The first row is the header.
    names : int
        Number of columns that are aligned on the left.

    Examples
    --------
    >>> from satsep_ot.methods.common.tables import markdownTable
    >>> print(markdownTable([["method", "runs"], ["FORM", "12"]], 1))
    | method | runs |
    | --- | ---: |
    | FORM | 12 |
    """
    header, *rows = [[cell.replace("|", "\\|") for cell in row] for row in cells]
    rule = "|" + " --- |" * names + " ---: |" * (len(header) - names)
    return "\n".join([f"| {' | '.join(header)} |", rule, *(f"| {' | '.join(row)} |" for row in rows)])


def textTable(cells: list[list[str]], names: int) -> str:
    """A table of text whose first columns are names, on the left, and whose other columns are numbers, on the right.

    Parameters
    ----------
    cells : list of rows of str
        The first row is the header.
    names : int
        Number of columns that are aligned on the left.

    Examples
    --------
    >>> from satsep_ot.methods.common.tables import textTable
    >>> print(textTable([["method", "runs"], ["FORM", "12"]], 1))
    method  runs
    FORM      12
    """
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    return "\n".join(
        "  ".join(
            text.ljust(width) if column < names else text.rjust(width)
            for column, (text, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in cells
    )


def csvTable(rows: Sequence[dict], names: Sequence[str]) -> str:
    """Comma-separated values with a header; what is None is empty.

    Parameters
    ----------
    rows : sequence of dict
    names : sequence of str
        The columns.

    Examples
    --------
    >>> from satsep_ot.methods.common.tables import csvTable
    >>> print(csvTable([{"method": "FORM", "lower": None}], ["method", "lower"]), end="")
    method,lower
    FORM,
    """
    stream = io.StringIO()
    writer = csv.DictWriter(stream, names, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return stream.getvalue()
