"""An update by ground tests on a terminal."""

from rich.console import Console
from rich.table import Table

from satsep_ot.studies.telling.tables import escape, make_table, narrow
from satsep_ot.studies.telling.update_results import (
    UpdateResult,
    misfit_sentence,
    outlook_sentences,
    sampling_sentence,
    shown_value,
)
from satsep_ot.studies.telling.words import probability_text


def print_update(console: Console, result: UpdateResult) -> None:
    """Print what an update found: contradictions, probabilities, what was learnt, what more tests would buy.

    Parameters
    ----------
    console : :class:`rich.console.Console`
    result : UpdateResult
    """
    console.print(f"[bold]{escape(result.headline)}[/bold]")
    for row in result.contradictions:
        console.print(f"[bold]![/bold] {escape(misfit_sentence(row))}")
    for remark in result.remarks:
        console.print(f"[bold]![/bold] {escape(remark)}")
    console.print()
    if result.probabilities:
        console.print(_probabilities(result))
    if result.learnt:
        console.print(_learnt(result))
    console.print(_misfits(result))
    console.print("[bold]What more tests would buy[/bold]")
    for row in result.outlooks:
        for sentence in outlook_sentences(row, result.next_test):
            console.print(f"  {escape(row.requirement)}: {escape(sentence)}")
    console.print(escape(sampling_sentence(result)))


def _probabilities(result) -> Table:
    table = narrow(
        make_table("Probability of violating a requirement", "", ">mean", ">95 % bound", ">allowed", "verdict")
    )
    for row in result.probabilities:
        table.add_row(f"[bold]{escape(row.requirement)}[/bold]", "", "", "", "")
        allowed = "" if row.allowed is None else f"{row.allowed:g}"
        for name, found in (("before", row.before), ("after", row.after)):
            table.add_row(
                f"  {name}",
                probability_text(found.mean),
                probability_text(found.upper95),
                allowed if name == "after" else "",
                row.verdict if name == "after" else "",
            )
    return table


def _learnt(result) -> Table:
    table = narrow(
        make_table("What the tests say of what they share with the flight", "", "unit", "before", "after", "95 %")
    )
    for row in result.learnt:
        table.add_row(
            escape(f"{row.name} {row.kind}"),
            "" if row.unit == "1" else row.unit,
            f"{shown_value(row.before, row.before_sigma)} +- {row.before_sigma:.2g}",
            f"{shown_value(row.after, row.after_sigma)} +- {row.after_sigma:.2g}",
            f"{shown_value(row.lower95, row.after_sigma)}..{shown_value(row.upper95, row.after_sigma)}",
        )
    return table


def _misfits(result) -> Table:
    title = "Measured against predicted, in standard deviations of the prediction"
    table = narrow(make_table(title, "test", "quantity", ">measured", ">predicted", ">deviation", ">from others", ""))
    for row in result.misfits:
        table.add_row(
            escape(row.experiment or "all, mean"),
            escape(row.quantity),
            shown_value(row.value, row.sigma),
            shown_value(row.predicted, row.sigma),
            f"{row.deviation:+.1f}",
            "" if row.fromOthers is None else f"{row.fromOthers:+.1f}",
            "[bold]contradicts[/bold]" if row.contradicts else "",
        )
    return table
