"""The tables and lines of a study on a terminal."""

import dataclasses

from rich.console import Console

from satsep_ot.studies.telling.results import Estimate, HalvedTolerance, Sizes, StudyResult, Tolerance
from satsep_ot.studies.telling.tables import estimates_table, note_lines, tightened_lines
from satsep_ot.studies.telling.words import StudyMethod

ROW = Estimate(
    "lateral rate", StudyMethod.ACTIVE_SUBSPACE, 2.5e-4, 2.25e-4, 2.75e-4, 0.05, 500_000, 117, 123.4, converged=True
)
EMPTY = StudyResult(
    "reference", "", 0, True, "", {}, Sizes(1, 1, 0, 0.05, ()), (), (), {}, {}, {}, {}, {}, {}, {}, {}, False, ()
)


def with_rows(*rows):
    return dataclasses.replace(EMPTY, rows=rows)


def printed(table):
    console = Console(width=80, highlight=False)
    with console.capture() as capture:
        console.print(table)
    return capture.get()


def test_the_table_fits_a_terminal_of_80_columns():
    other = dataclasses.replace(ROW, method=StudyMethod.SUBSET_SAMPLING, lower95=None)
    text = printed(estimates_table(with_rows(ROW, other)))
    for words in (
        "ActiveSubspace", "SubsetSampling", "2.500e-04", "2.25e-04..2.75e-04", "500,000", "123.4", "none", "seconds",
    ):  # fmt: skip
        assert words in text
    rare = dataclasses.replace(ROW, probability=2.5e-104, lower95=2.25e-104, upper95=2.71e-103)
    text = printed(estimates_table(with_rows(rare)))
    assert "…" not in text
    assert "2.500e-104  2.2e-104..2.7e-103" in text


def test_notes_are_printed_as_they_are():
    row = Estimate("spin", StudyMethod.FORM, converged=True, note="SQP: at [red]")
    assert list(note_lines(with_rows(row))) == ["[bold]spin[/bold]", r"  FORM: SQP: at \[red]"]


def test_what_halving_a_tolerance_buys_is_told():
    names = ("mass", "stroke", "cant")
    halved = (
        HalvedTolerance("mass", 0.5, 2e-4, 1e-4, 4e-4, 100, converged=False, note="few"),
        HalvedTolerance("stroke", 0.5, 2e-4, 1e-4, 4e-4, 100, converged=True),
        HalvedTolerance("cant", 0.5, note="RuntimeError: [x]"),
    )
    tolerances = {name: Tolerance("sigma 1", (name,), name) for name in names}
    result = dataclasses.replace(EMPTY, tolerances=tolerances, tightened={"spin": halved})
    assert list(tightened_lines(result)) == [
        "spin with half the scatter of mass: 2.00e-04 (1.00e-04..4.00e-04), not converged: few",
        "spin with half the scatter of stroke: 2.00e-04 (1.00e-04..4.00e-04)",
        "spin with half the scatter of cant: the estimate failed: RuntimeError: [x]",
    ]
