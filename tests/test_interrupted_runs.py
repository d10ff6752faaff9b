"""A study and a benchmark that are killed, or interrupted, and continued give what uninterrupted ones give."""

import json
import signal
import subprocess
import sys

import numpy as np
import pytest

from satsep_ot.studies.study_runs import list_runs, load_runs

pytestmark = pytest.mark.slow

CASE = """
name = "small"
[platform]
mass = 10
inertia = [1, 1, 1]
center_of_mass = [0, -100, 0]
[satellite]
mass = 1
inertia = [0.01, 0.01, 0.01]
center_of_mass = [0, 100, 0]
[springs]
count = 2
radius = 100
stroke = 10
table = "tables/push.csv"
[inputs]
mass = { quantity = "satellite.mass", sigma = 0.03 }
rate_y = { quantity = "initial.rates.y", sigma = 0.4 }
cant = { quantity = "springs.cant.each", sigma = 0.02 }
[[requirements]]
name = "rolling"
quantity = "spin"
maximum = 1.0
[[requirements]]
name = "slow"
quantity = "axial_velocity"
minimum = 0.245
"""
METHODS = ["ActiveSubspace", "FORM", "SubsetSampling", "MonteCarlo"]


def case_file(folder):
    (folder / "tables").mkdir()
    (folder / "tables" / "push.csv").write_text("stroke_mm,force_N\n0,2.0\n10,1.0\n", encoding="utf-8")
    path = folder / "small.toml"
    path.write_text(CASE, encoding="utf-8")
    return path


def start(*arguments):
    command = [sys.executable, "-m", "satsep_ot", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish(*arguments):
    with start(*arguments) as process:
        out, errors = process.communicate(timeout=500)
    assert process.returncode == 0, errors
    return out, errors


def stop(label, number, *arguments):
    """Start the program, and send it a signal as soon as it says that it is at this label."""
    with start(*arguments) as process:
        while label not in (line := process.stderr.readline()):
            assert line, f"it ended before {label}"
        process.send_signal(number)
        _, errors = process.communicate(timeout=60)
    return process.returncode, errors


def without_timings(path):
    """The numbers of results.json; the time of day and the seconds are what an interruption may change."""
    results = json.loads((path / "results.json").read_text(encoding="utf-8"))
    del results["finished"]
    for row in results["rows"]:
        del row["seconds"]
    return results


def test_a_study_that_is_killed_again_and_again(tmp_path):
    case = case_file(tmp_path)
    options = ["--seed", 5, "--runs", 300_000, "--tolerances", 1, "--methods", *METHODS]
    finish("study", case, "--output", tmp_path / "whole", *options)
    cut = ["study", case, "--output", tmp_path / "cut", *options]
    code, errors = stop("Monte Carlo runs", signal.SIGINT, *cut)
    assert code == 130, errors
    assert f"what was finished is kept in {tmp_path / 'cut'}: the same command with --resume continues" in errors
    for label in ("active subspaces from gradients", "rolling: SubsetSampling", "slow: ActiveSubspace"):
        code, errors = stop(label, signal.SIGKILL, *cut, "--resume")
        assert code == -signal.SIGKILL, errors
    code, errors = stop("any requirement: ActiveSubspace", signal.SIGINT, *cut, "--resume")
    assert code == 130, errors
    for label in ("slow: half the scatter", "figures and report"):
        code, errors = stop(label, signal.SIGKILL, *cut, "--resume")
        assert code == -signal.SIGKILL, errors
    _, errors = finish(*cut, "--resume")
    assert without_timings(tmp_path / "cut") == without_timings(tmp_path / "whole")
    # The same files, and no leftovers.
    left, right = (
        sorted(str(path.relative_to(tmp_path / name)) for path in (tmp_path / name).rglob("*"))
        for name in ("cut", "whole")
    )
    assert left == right
    for name in list_runs(tmp_path / "whole"):
        one, other = load_runs(tmp_path / "cut", name), load_runs(tmp_path / "whole", name)
        assert np.array_equal(one.inputs, other.inputs)
        assert np.array_equal(one.outputs, other.outputs)
        assert np.array_equal(one.weights, other.weights, equal_nan=True)
    for name in ("motion.json", "case.toml", "tables/push.csv"):
        assert (tmp_path / "cut" / name).read_bytes() == (tmp_path / "whole" / name).read_bytes()
    # The directory has all that is needed: the case in it is the same case.
    out, _ = finish("study", tmp_path / "cut" / "case.toml", "--output", tmp_path / "cut", *options, "--resume")
    assert "report.html" in out


def test_a_benchmark_that_is_killed_and_interrupted(tmp_path):
    options = ["--problems", "RP8", "RP107", "--methods", "ActiveSubspace", "FORM", "--repetitions", 4]
    finish("benchmark", "--output", tmp_path / "whole", *options)
    cut = ["benchmark", "--output", tmp_path / "cut", *options]
    code, errors = stop("RP107: ActiveSubspace", signal.SIGKILL, *cut)
    assert code == -signal.SIGKILL, errors
    # As by a power failure, in the middle of a line.
    with (tmp_path / "cut" / "runs.jsonl").open("a", encoding="utf-8") as stream:
        stream.write('{"key": "[\\"RP8')
    code, errors = stop("RP8: FORM", signal.SIGINT, *cut, "--resume")
    assert code == 130, errors
    assert "--resume continues" in errors
    finish(*cut, "--resume")
    tables = []
    for name in ("cut", "whole"):
        table = json.loads((tmp_path / name / "benchmark.json").read_text(encoding="utf-8"))
        tables.append([{key: value for key, value in row.items() if key != "seconds"} for row in table])
    assert tables[0] == tables[1]
