"""Tables and lines of text for a terminal."""

from collections.abc import Iterator

from rich import markup
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from satsep_ot.model.text import printable
from satsep_ot.studies.telling.advice import advice_sentences, tightening_advice
from satsep_ot.studies.telling.failure_mixture import mixture_lines
from satsep_ot.studies.telling.fleet import fleet_lines
from satsep_ot.studies.telling.remarks import audit_remarks, remarks
from satsep_ot.studies.telling.results import StudyResult
from satsep_ot.studies.telling.tolerance_curves import curve_lines
from satsep_ot.studies.telling.verdicts import any_violation, headline, judge_all
from satsep_ot.studies.telling.words import interval_text, probability_text


def escape(text: str) -> str:
    """A text as rich's markup prints it as it is, but for control characters, which a terminal would obey."""
    return markup.escape(printable(text))


def make_table(title: str, *columns: str) -> Table:
    """An empty table whose names and numbers are not cut on a narrow terminal; texts fold.

    Parameters
    ----------
    title : str
    columns : str
        Their headers; one that begins with ">" is aligned at the right. A unit in square brackets stands in a line of
        its own: a column of numbers is as wide as its longest word.

    Returns
    -------
    table : :class:`rich.table.Table`
    """
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, title_style="bold")
    for name in columns:
        right = name.startswith(">")
        header = name.removeprefix(">").replace(" [", "\n[")
        table.add_column(
            escape(header), justify="right" if right else "left", overflow="fold", no_wrap=right and "\n" in header
        )
    table.columns[0].no_wrap = True
    return table


def narrow(table: Table) -> Table:
    """The same table with as little between its columns as a terminal of 80 columns needs."""
    table.pad_edge, table.show_edge, table.collapse_padding = False, False, True
    return table


def print_study(console: Console, result: StudyResult) -> None:
    """Print what a study found: verdicts, table, remarks, tightened tolerances.

    Parameters
    ----------
    console : :class:`rich.console.Console`
    result : StudyResult
    """
    verdicts = judge_all(result)
    console.print(f"[bold]{escape(headline(verdicts))}[/bold]")
    told = any_violation(result)
    if told is not None:
        row = told.row
        interval = interval_text(row.lower95, row.upper95)
        console.print(f"Any requirement violated: {probability_text(row.probability)} ({interval})")
    for verdict in verdicts:
        console.print(f"  {escape(verdict.requirement)}: {escape(verdict.sentence)}")
    console.print()
    console.print(estimates_table(result))
    console.print("[bold]Remarks[/bold]")
    for line in note_lines(result):
        console.print(line)
    console.print()
    for remark in [*remarks(result), *audit_remarks(result)]:
        console.print(f"[bold]![/bold] {escape(remark)}")
    for line in further_lines(result):
        console.print(escape(line))
    for requirement, sentence in advice_sentences(result).items():
        console.print(f"[bold]{escape(requirement)}[/bold]: {escape(sentence)}")
    for line in tightened_lines(result):
        console.print(escape(line))


def further_lines(result: StudyResult) -> Iterator[str]:
    """What else was asked of the study: sizes of tolerances, classes, failures of parts, the fleet; a line each."""
    yield from curve_lines(result.curves)
    if result.classes is not None:
        yield from result.classes.lines()
    yield from mixture_lines(result.failures)
    yield from fleet_lines(result.fleet)


def estimates_table(result: StudyResult) -> Table:
    """Probability, interval and cost of each method, requirement by requirement."""
    table = narrow(make_table(f"Probability of violating a requirement: {escape(result.case)}", "method"))
    for column in ("probability", "95 % interval", "evaluations", "gradients", "seconds"):
        table.add_column(column, justify="right", no_wrap=True)
    for requirement, rows in result.rows_by_requirement().items():
        table.add_row(f"[bold]{escape(requirement)}[/bold]")
        for row in rows:
            table.add_row(
                row.method,
                "none" if row.probability is None else f"{row.probability:.3e}",
                "none" if row.lower95 is None else f"{_in_eight(row.lower95)}..{_in_eight(row.upper95)}",
                f"{row.evaluations:,}",
                f"{row.gradients:,}",
                f"{row.seconds:.1f}",
            )
    return table


def note_lines(result: StudyResult) -> Iterator[str]:
    """What each estimate's numbers do not say, a line of rich's markup each, requirement by requirement."""
    for requirement, rows in result.rows_by_requirement().items():
        yield f"[bold]{escape(requirement)}[/bold]"
        for row in rows:
            text = "" if row.converged else "[bold]not converged[/bold]: "
            yield f"  {row.method}: {text}{escape(row.note)}"


def tightened_lines(result: StudyResult) -> Iterator[str]:
    """What halving each tolerance buys, a line each."""
    for requirement, rows in tightening_advice(result).items():
        for advice in rows:
            half = advice.half
            if half is None:
                continue
            found = str(advice.gain)
            if half.probability is None:
                found = f"{advice.gain}: {half.note}"
            else:
                if advice.gain.is_resolved:
                    found = f"{half.probability:.2e} ({half.lower95:.2e}..{half.upper95:.2e})"
                if not half.converged:
                    found += f", not converged: {half.note}"
            yield f"{requirement} with half the scatter of {half.tolerance}: {found}"


def _in_eight(probability):
    """Three digits, or two where the exponent has three: no line of a table is longer for it."""
    text = f"{probability:.2e}"
    return text if len(text) <= 8 else f"{probability:.1e}"
