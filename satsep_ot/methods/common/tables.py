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


_LATEX = {
    "\\": r"\textbackslash{}", "{": r"\{", "}": r"\}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": r"\textless{}", ">": r"\textgreater{}",
}  # fmt: skip
# Columns of text beyond this share of a line's characters are paragraphs.
_LINE, _PARAGRAPH = 90, 24


def latexTable(cells: list[list[str]], names: int) -> str:
    r"""A tabular environment of LaTeX, for ``\usepackage{booktabs}``; what LaTeX would read as a command is escaped.

    Columns fit the line: text that is longer than 24 characters stands in paragraphs, which share what the other
    columns leave of it.

    Parameters
    ----------
    cells : list of rows of str
        The first row is the header.
    names : int
        Number of columns that are aligned on the left.

    Examples
    --------
    >>> from satsep_ot.methods.common.tables import latexTable
    >>> print(latexTable([["method", "runs"], ["A_B", "5 %"]], 1))
    \begin{tabular}{@{}lr@{}}
    \toprule
    method & runs \\
    \midrule
    A\_B & 5 \% \\
    \bottomrule
    \end{tabular}
    """
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    long = [column for column, width in enumerate(widths) if width > _PARAGRAPH]
    taken = sum(width + 2 for column, width in enumerate(widths) if column not in long)
    share = max(0.15, (1.0 - taken / _LINE) / max(len(long), 1))
    kinds = "".join(
        rf"p{{{share:.2f}\linewidth}}" if column in long else "l" if column < names else "r"
        for column in range(len(widths))
    )
    lines = [" & ".join("".join(_LATEX.get(sign, sign) for sign in cell) for cell in row) + r" \\" for row in cells]
    head, *rows = lines
    begin = rf"\begin{{tabular}}{{@{{}}{kinds}@{{}}}}"
    return "\n".join([begin, r"\toprule", head, r"\midrule", *rows, r"\bottomrule", r"\end{tabular}"])


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
