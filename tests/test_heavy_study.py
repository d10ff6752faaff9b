"""A study by the runs of another simulator: it says what it waits for, goes on, and its requirements share runs."""

import csv
import json

import pytest
from small_cases import MASS_AND_RATE, ROLLING, SMALL
from test_cli import refused

from satsep_ot import cli
from satsep_ot.model.case import load_case
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.studies.telling.document import read_results

SLOW = '[[requirements]]\nname = "slow"\nquantity = "axial_velocity"\nminimum = 0.25\nallowed_probability = 0.2\n'
CASE = SMALL + MASS_AND_RATE + ROLLING + SLOW
NAMES = ["rate_y", "axial_velocity"]


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CASE, encoding="utf-8")
    return path


def command(case, tmp_path, *more):
    return [
        "study", str(case), "--output", str(tmp_path / "results"), "--heavy", str(tmp_path / "runs"), "--runs", "5000",
        "--gradients", "20", *more,
    ]  # fmt: skip


def heavy_program(case, runs, change=lambda rows: rows):
    """Rates that are 2 % larger than ours, and velocities as ours, for each block that has no outputs yet."""
    model = SeparationFunction(load_case(case), quantities=NAMES)
    labels, outputs = list(model.getInputDescription()), list(model.getOutputDescription())
    for block in runs.glob("block-*-inputs.csv"):
        path = block.with_name(block.name.replace("inputs", "outputs"))
        if path.exists():
            continue
        with open(block, newline="") as stream:
            asked = list(csv.DictReader(stream))
        values = model.evaluate([[float(row[label]) for label in labels] for row in asked]) * [1.02, 1.0]
        rows = [
            {"run": row["run"], **dict(zip(outputs, map(repr, value), strict=True))}
            for row, value in zip(asked, values.tolist(), strict=True)
        ]
        rows = change(rows)
        with open(path, "w", newline="") as stream:
            writer = csv.DictWriter(stream, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
        return path
    return None


def finished(arguments, case, runs, capsys):
    """How often runs were asked for until the study was done."""
    for count in range(200):
        code = cli.main(arguments)
        captured = capsys.readouterr()
        if code == 0:
            return count
        assert code == 4
        line = captured.err.splitlines()[-1]
        assert "runs are needed: their inputs are in" in line
        assert line.endswith(
            "with the columns run, rate_y [deg/s], axial_velocity [m/s], and give the same command again"
        )
        assert heavy_program(case, runs)
    raise AssertionError


def test_a_heavy_study_waits_goes_on_and_gives_the_probabilities_of_the_heavy_model(case, tmp_path, capsys):
    runs, arguments = tmp_path / "runs", command(case, tmp_path, "--block", "30", "--precision", "0.2")
    blocks = finished(arguments, case, runs, capsys)
    result = read_results(tmp_path / "results" / "results.json")
    rows = {row.requirement: row for row in result.rows}
    assert list(rows) == ["rolling", "slow", "any requirement"]
    assert all(row.converged and row.note.startswith("heavy runs; ") for row in rows.values())
    # |1.02 rate_y| > 1 deg/s, of a normal rate with a deviation of 0.4 deg/s.
    assert rows["rolling"].lower95 < 0.01424 < rows["rolling"].upper95
    assert "The probabilities are those of the heavy runs" in result.assumptions[0]
    made = sum(len(path.read_text().splitlines()) - 1 for path in runs.glob("block-*-outputs.csv"))
    # What one requirement has asked for serves the others.
    assert made < sum(row.evaluations for row in rows.values())
    assert blocks == len(list(runs.glob("block-*-inputs.csv")))
    # Another study of the same separation asks for no run that is there, and one of another is refused.
    path = tmp_path / "again"
    again = [str(path) if argument == str(tmp_path / "results") else argument for argument in arguments]
    assert finished(again, case, runs, capsys) == 0
    same = json.loads((path / "results.json").read_text())["rows"]
    assert [row["probability"] for row in same] == [row.probability for row in rows.values()]
    case.write_text(CASE.replace("sigma = 0.4", "sigma = 0.41"), encoding="utf-8")
    again[again.index(str(path))] = str(tmp_path / "third")
    assert cli.main(again) == 2
    assert "holds the heavy runs of another separation" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[1:], "runs are missing"),
        (lambda rows: [row | {"rate_y [deg/s]": "inf"} for row in rows], "which must be finite"),
        (lambda rows: [row | {"mass [kg]": "2.0"} for row in rows], "the inputs are not those that were asked for"),
        (lambda rows: [{"run": row["run"], "axial_velocity [m/s]": "1"} for row in rows], "has no column 'rate_y"),
    ],
)
def test_outputs_that_do_not_fit_are_one_sentence_and_nothing_is_lost(change, message, case, tmp_path, capsys):
    runs, arguments = tmp_path / "runs", command(case, tmp_path)
    assert cli.main(arguments) == 4
    before = {path: path.read_bytes() for path in runs.iterdir()}
    path = heavy_program(case, runs, change)
    capsys.readouterr()
    assert cli.main(arguments) == 2
    assert message in capsys.readouterr().err.splitlines()[-1]
    path.unlink()
    assert {path: path.read_bytes() for path in runs.iterdir()} == before
    heavy_program(case, runs)
    assert cli.main(arguments) == 4


def test_what_a_heavy_study_cannot_do_is_refused(case, tmp_path, capsys):
    assert "--heavy takes no --methods" in refused(command(case, tmp_path, "--methods", "FORM"), capsys)
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "notes.txt").write_text("mine")
    assert cli.main(command(case, tmp_path)) == 2
    assert "holds other files, and no heavy runs of a study" in capsys.readouterr().err
