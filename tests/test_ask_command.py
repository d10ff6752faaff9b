"""`satsep-ot ask` and `tell`: the bits of the function through files, and one sentence for what is wrong."""

import csv
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import openturns as ot
import pytest
from small_cases import MASS_AND_RATE, ROLLING, SMALL
from test_cli import refused

from satsep_ot import ActiveSubspaceReliability, cli
from satsep_ot.model.case import load_case
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.heavy_runs import load_question

CASE = SMALL + MASS_AND_RATE + ROLLING


@pytest.fixture
def case(tmp_path):
    path = tmp_path / "small.toml"
    path.write_text(CASE, encoding="utf-8")
    return path


def heavy_program(case, block, outputs, change=lambda rows: rows):
    """The simulator of the case with a little more of everything, as a program that reads and writes files."""
    with open(block, newline="") as stream:
        asked = list(csv.DictReader(stream))
    model = SeparationFunction(load_case(case), quantities=["rate_y"])
    labels = list(model.getInputDescription())
    values = model.evaluate([[float(row[label]) for label in labels] for row in asked])[:, 0]
    rows = [
        {"run": row["run"], model.getOutputDescription()[0]: repr(1.02 * float(value))}
        for row, value in zip(asked, values, strict=True)
    ]
    rows = change(rows)
    with open(outputs, "w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)


def begun(case, state, *more):
    return ["ask", str(state), "--case", str(case), "--requirement", "rolling", *more]


def answered(case, state, tmp_path, capsys):
    """Ask and tell to the end; what was printed last."""
    block, outputs = tmp_path / "block.csv", tmp_path / "outputs.csv"
    while cli.main(["ask", str(state), str(block)]) == 4:
        assert "runs are needed: their inputs are in" in capsys.readouterr().out
        heavy_program(case, block, outputs)
        assert cli.main(["tell", str(state), str(outputs)]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("alone", [[], ["--alone"]])
def test_ask_and_tell_give_the_bits_of_the_function(alone, case, tmp_path, capsys):
    state = tmp_path / "state"
    assert cli.main(begun(case, state, "--block", "20", "--seed", "3", *alone)) == 4
    printed = capsys.readouterr().out
    assert "with the columns run, rate_y [deg/s] to `satsep-ot tell" in printed
    # The case is in the state.
    case.rename(tmp_path / "other.toml")
    printed = answered(tmp_path / "other.toml", state, tmp_path, capsys)
    assert "rolling: probability " in printed
    assert "the target coefficient of variation" in printed

    problem = SeparationProblem(load_case(state / "case.toml"))
    simulator, composition = problem.getMeasuredComponents("rolling")
    heavy = ot.PythonFunction(2, 1, func_sample=lambda x: 1.02 * np.array(simulator(x)))
    heavy.setInputDescription(simulator.getInputDescription())
    heavy.setOutputDescription(simulator.getOutputDescription())
    event = ot.ThresholdEvent(
        ot.CompositeRandomVector(
            ot.ComposedFunction(composition, heavy), ot.RandomVector(problem.getDistribution())
        ),
        ot.Greater(), 1.0,
    )  # fmt: skip
    algorithm = ActiveSubspaceReliability(event)
    algorithm.setComponents(heavy, composition)
    algorithm.setTargetCoefficientOfVariation(0.1)
    algorithm.setBlockSize(20)
    algorithm.setLowFidelity(None if alone else simulator)
    ot.RandomGenerator.SetSeed(3)
    algorithm.run()
    _, study = load_question(state)
    assert study.ask() is None
    result, direct = study.getResult(), algorithm.getResult()
    assert result.getProbabilityEstimate() == direct.getProbabilityEstimate()
    assert result.getInputSample() == direct.getInputSample()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows[1:], "runs are missing"),
        (lambda rows: [row | {"rate_y [deg/s]": "nan"} for row in rows], "which must be finite"),
        (lambda rows: [row | {"mass [kg]": "2.0"} for row in rows], "the inputs are not those that were asked for"),
        (lambda rows: [row | {"run": "1-abcdef"} for row in rows], "was not asked for"),
        (lambda rows: [{"run": row["run"], "rate": "1"} for row in rows], "has no column 'rate_y [deg/s]'"),
    ],
)
def test_what_does_not_fit_is_one_sentence_and_nothing_is_lost(change, message, case, tmp_path, capsys):
    state, block, outputs = tmp_path / "state", tmp_path / "block.csv", tmp_path / "outputs.csv"
    assert cli.main(begun(case, state)) == 4
    assert cli.main(["ask", str(state), str(block)]) == 4
    before = {path: path.read_bytes() for path in state.iterdir()}
    assert block.read_bytes() == before[state / "block-1-inputs.csv"]
    heavy_program(case, block, outputs, change)
    capsys.readouterr()
    assert message in refused(["tell", str(state), str(outputs)], capsys)
    assert {path: path.read_bytes() for path in state.iterdir()} == before
    heavy_program(case, block, outputs)
    assert cli.main(["tell", str(state), str(outputs)]) == 0
    capsys.readouterr()
    assert "block-1-inputs.csv was told before" in refused(["tell", str(state), str(outputs)], capsys)
    # The runs of another question.
    other = tmp_path / "other"
    assert cli.main(begun(case, other, "--seed", "8")) == 4
    capsys.readouterr()
    assert "was not asked for in" in refused(["tell", str(other), str(outputs)], capsys)


def test_runs_without_a_value_count_as_asked(case, tmp_path, capsys):
    state, block, outputs = tmp_path / "state", tmp_path / "block.csv", tmp_path / "outputs.csv"
    assert cli.main(begun(case, state, "--non-finite", "failure")) == 4
    cli.main(["ask", str(state), str(block)])
    heavy_program(case, block, outputs, lambda rows: [rows[0] | {"rate_y [deg/s]": ""}, *rows[1:]])
    assert cli.main(["tell", str(state), str(outputs)]) == 0
    assert "taken, and kept as" in capsys.readouterr().out


def test_the_state_of_another_question_is_refused(case, tmp_path, capsys):
    state = tmp_path / "state"
    assert "holds no question; begin one with --case" in refused(["ask", str(state)], capsys)
    assert cli.main(begun(case, state)) == 4
    assert cli.main(begun(case, state)) == 4
    capsys.readouterr()
    before = {path: path.read_bytes() for path in state.iterdir()}
    assert "holds another question (question.json differs)" in refused(begun(case, state, "--seed", "1"), capsys)
    case.write_text(CASE.replace("maximum = 1.0", "maximum = 1.1"), encoding="utf-8")
    assert "holds another question (case.toml differs)" in refused(begun(case, state), capsys)
    assert "is no requirement of this case" in refused([*begun(case, tmp_path / "no")[:-1], "rooling"], capsys)
    assert not (tmp_path / "no").exists()
    assert "holds other files" in refused(begun(case, tmp_path), capsys)
    assert {path: path.read_bytes() for path in state.iterdir()} == before
    # The file of the state belongs to its case.
    (state / "case.toml").write_bytes(case.read_bytes())
    assert "is the checkpoint of another computation" in refused(["ask", str(state)], capsys)
    (state / "question.json").write_text("{}", encoding="utf-8")
    assert "question.json cannot be read" in refused(["ask", str(state)], capsys)


MODEL = """
import openturns as ot
from satsep_ot import ActiveSubspaceReliability
from satsep_ot.methods.reliability.ask_tell import outsideFunction

vector = ot.CompositeRandomVector(outsideFunction(["load", "play"], ["stress"]), ot.RandomVector(ot.Normal(2)))
algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 2.5))
algorithm.setTargetCoefficientOfVariation(0.2)
"""


def test_a_model_in_python(tmp_path, capsys):
    model, state = tmp_path / "model.py", tmp_path / "state"
    assert "there is no such file" in refused(["ask", str(state), "--model", str(model)], capsys)
    model.write_text("algorithm = 3\n", encoding="utf-8")
    assert "must define algorithm, an ActiveSubspaceReliability; it is 3" in refused(
        ["ask", str(state), "--model", str(model)], capsys
    )
    model.write_text(MODEL, encoding="utf-8")
    assert cli.main(["ask", str(state), "--model", str(model), "--block", "30"]) == 4
    block, outputs = tmp_path / "block.csv", tmp_path / "outputs.csv"
    while cli.main(["ask", str(state), str(block)]) == 4:
        with open(block, newline="") as stream, open(outputs, "w", newline="") as written:
            writer = csv.writer(written)
            writer.writerow(["run", "stress"])
            for row in csv.DictReader(stream):
                writer.writerow([row["run"], float(row["load"]) + 0.1 * float(row["play"]) ** 2])
        assert cli.main(["tell", str(state), str(outputs)]) == 0
        capsys.readouterr()
    assert "model.py: probability" in capsys.readouterr().out
    # Another algorithm cannot go on with this state.
    model.write_text(MODEL.replace("2.5", "2.6"), encoding="utf-8")
    assert "with another event" in refused(["ask", str(state)], capsys)


@pytest.mark.slow
def test_the_loop_of_the_page_ends_with_the_probability(case, tmp_path):
    page = (Path(__file__).parent.parent / "docs" / "two-models.md").read_text(encoding="utf-8")
    loop = next(block for block in re.findall(r"```sh\n(.*?)```", page, re.DOTALL) if block.startswith("while"))
    # The program of the page, and the command, in the folder of the loop.
    (tmp_path / "my_program").write_text(
        f"#!{sys.executable}\nimport sys\nsys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from test_ask_command import heavy_program\n"
        f"heavy_program({str(case)!r}, *sys.argv[1:])\n"
    )
    (tmp_path / "satsep-ot").write_text(
        f"#!{sys.executable}\nfrom satsep_ot.__main__ import main\nraise SystemExit(main())\n"
    )
    for name in ("my_program", "satsep-ot"):
        (tmp_path / name).chmod(0o755)
    where = os.environ | {"PATH": f"{tmp_path}:{os.environ['PATH']}", "PYTHONPATH": str(Path(__file__).parent.parent)}
    begin = "satsep-ot ask state --case small.toml --requirement rolling --block 60 --precision 0.3 > /dev/null\n"
    done = subprocess.run(["sh", "-c", begin + loop], cwd=tmp_path, env=where, capture_output=True, text=True)
    assert done.returncode != 2, done.stderr
    assert re.search(r"^rolling: probability \d\.\d+e-\d+, 95 % interval", done.stdout, re.MULTILINE)
