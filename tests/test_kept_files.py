"""Kept files that are not as they were written: named, and made again where that can be."""

import contextlib
import json
import os
import resource
import shutil
import subprocess
import sys

import numpy as np
import pytest
from small_cases import MASS_AND_RATE, ROLLING, SMALL

from satsep_ot import cli
from satsep_ot.methods.common.manifest import Manifest
from satsep_ot.methods.common.storage import readResult, writeResult, writeWhole
from satsep_ot.methods.comparison.benchmark import ReliabilityBenchmark
from satsep_ot.methods.comparison.problem import BenchmarkTask
from satsep_ot.methods.comparison.problems import getBenchmarkProblem
from satsep_ot.methods.parallel.stream_storage import openRowFile
from satsep_ot.studies import separation_study
from satsep_ot.studies.results_directory import ResultsDirectory
from satsep_ot.studies.study_runs import load_runs


def study(folder, *more):
    arguments = ["study", str(folder / "mine.toml"), "--output", str(folder / "results"), "--runs", "3000"]
    return cli.main([*arguments, "--tolerances", "1", "--methods", "ActiveSubspace", "FORM", "MonteCarlo", *more])


def numbers(folder):
    document = json.loads((folder / "results" / "results.json").read_text(encoding="utf-8"))
    for row in document["rows"]:
        del row["seconds"]
    return {name: value for name, value in document.items() if name != "finished"}


@pytest.fixture(scope="module", autouse=True)
def few_figures():
    """Figures take most of the time of a small study."""
    with pytest.MonkeyPatch.context() as patch:
        panels = separation_study.drawn_result_panels
        patch.setattr(separation_study, "drawn_result_panels", lambda *given: panels(*given)[:1])
        patch.setattr(separation_study, "run_panels", lambda *given: ())
        yield


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    (folder / "mine.toml").write_text(SMALL + MASS_AND_RATE + ROLLING, encoding="utf-8")
    assert study(folder) == 0
    return folder


@pytest.fixture
def folder(finished, tmp_path):
    shutil.copytree(finished, tmp_path / "study")
    return tmp_path / "study"


def cut(path):
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])


def holding_an_object(path):
    np.savez(path, document=np.array({"format": "anything"}, dtype=object))


def emptied(path):
    path.write_bytes(b"")


def flipped(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF
    path.write_bytes(data)


def probability(value):
    def edit(path):
        document = json.loads(path.read_text(encoding="utf-8"))
        assert document["result"]["probability"] is not None
        document["result"]["probability"] = value
        path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")

    return edit


DAMAGES = [
    *((name, damage) for name in ("steps/rolling--ActiveSubspace.npz", "runs/rolling--ActiveSubspace.npz")
      for damage in (cut, holding_an_object, emptied, flipped)),
    *((name, probability(value)) for name in ("steps/rolling--FORM.json", "steps/rolling--ActiveSubspace.json")
      for value in (1e-9, 7.5, float("nan"))),
    *((name, damage) for name in ("runs/sample.npy", "steps/sample.json", "steps/gradients.json", "results.json",
                                  "figures/separation--velocity.svg", "motion.json") for damage in (cut,)),
    ("steps/rolling--half--rate_y.json", probability(1e-9)),
]  # fmt: skip


@pytest.mark.parametrize(("name", "damage"), DAMAGES)
def test_what_was_changed_is_named_and_made_again(name, damage, finished, folder, capsys):
    path = folder / "results" / name
    damage(path)
    capsys.readouterr()
    assert study(folder, "--resume") == 0
    said = capsys.readouterr().err
    assert f"satsep-ot: {path} is not as it was written; what is in it is made again\n" in said
    assert numbers(folder) == numbers(finished)
    assert Manifest(folder / "results").changed() == []


@pytest.mark.parametrize("name", ["results.json", "motion.json", "case.toml"])
@pytest.mark.parametrize("damage", [cut, flipped, lambda path: path.write_bytes(path.read_bytes() + b" ")])
def test_report_names_what_was_changed_and_says_what_to_do(name, damage, folder, capsys):
    damage(folder / "results" / name)
    assert cli.main(["report", str(folder / "results")]) == 2
    said = capsys.readouterr().err
    assert f"{folder / 'results' / name}: it is not as the study wrote it; the command of the study" in said
    assert said.count("\n") == 1


@pytest.mark.parametrize("value", ["1e-9", "7.5", "NaN"])
def test_report_notices_an_edited_probability(value, folder, capsys):
    path = folder / "results" / "results.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    document["rows"][0]["probability"] = float(value)
    path.write_text(json.dumps(document, indent=2) + "\n", encoding="utf-8")
    assert cli.main(["report", str(folder / "results")]) == 2
    assert "not as the study wrote it" in capsys.readouterr().err
    # Without checksums, as in a directory of version 0.1.0, what is no number is still refused.
    (folder / "results" / "manifest.json").unlink()
    assert cli.main(["report", str(folder / "results")]) == (2 if value == "NaN" else 0)


def test_a_changed_case_is_not_continued(folder, capsys):
    cut(folder / "results" / "case.toml")
    assert study(folder, "--resume") == 2
    assert "has been changed since; give another directory, or put it back as it was" in capsys.readouterr().err


def test_runs_that_were_changed_are_not_loaded(folder):
    for name in ("sample.npy", "gradients.npz"):
        flipped(folder / "results" / "runs" / name)
        with pytest.raises(ValueError, match=r"is not as it was written; .* --resume makes it again"):
            load_runs(folder / "results", name.partition(".")[0])


def test_a_damaged_manifest_is_named_and_without_it_every_step_is_made_again(finished, folder, capsys):
    cut(folder / "results" / "manifest.json")
    assert study(folder, "--resume") == 2
    assert "remove it, and every step is made again" in capsys.readouterr().err
    assert cli.main(["report", str(folder / "results")]) == 2
    (folder / "results" / "manifest.json").unlink()
    assert study(folder, "--resume") == 0
    assert numbers(folder) == numbers(finished)


def test_a_step_without_a_checksum_is_not_finished(tmp_path):
    directory = ResultsDirectory(tmp_path, "study", {"seed": 0}, ["steps/*"])
    directory.keep(("spin", "FORM"), {"probability": 0.25})
    # As if the power had failed between the two files.
    writeWhole(directory.file("steps", ("spin", "SORM"), ".json"), lambda stream: stream.write(b'{"result": {}}'))
    directory.close()
    again = ResultsDirectory(tmp_path, "study", {"seed": 0}, ["steps/*"], resume=True)
    assert again.finished("spin", "FORM") == {"probability": 0.25}
    assert again.finished("spin", "SORM") is None
    again.close()


def test_a_benchmark_makes_an_edited_repetition_again(tmp_path):
    def run():
        benchmark = ReliabilityBenchmark([BenchmarkTask.of(getBenchmarkProblem("RP107"))], ["FORM"], repetitions=3)
        benchmark.setFile(tmp_path / "runs.jsonl")
        benchmark.run()
        return [row.error for row in benchmark.getResult().getRows()]

    path, before = tmp_path / "runs.jsonl", run()
    lines = path.read_text(encoding="utf-8").splitlines()
    edited = json.loads(lines[1])
    edited["row"]["probability"] = 1e-9
    path.write_text("\n".join([lines[0], json.dumps(edited), lines[2]]) + "\n", encoding="utf-8")
    assert run() == before
    assert len(path.read_text(encoding="utf-8").splitlines()) == 4


def test_every_damage_of_a_result_is_a_value_error(tmp_path):
    path = tmp_path / "whole.npz"
    writeResult(path, "A 1", {"x": np.arange(40.0), "y": np.array(["a", "bc"]), "n": 3})
    data, rng = path.read_bytes(), np.random.default_rng(0)
    damaged = tmp_path / "damaged.npz"
    for trial in range(1500):
        content = bytearray(data[: rng.integers(len(data))] if trial % 3 == 0 else data)
        for place in rng.integers(max(len(content), 1), size=trial % 4 + (trial % 3 != 0)):
            if content:
                content[place] = rng.integers(256)
        damaged.write_bytes(content)
        with contextlib.suppress(ValueError):
            readResult(damaged, "A 1")


def limited(program, folder, size=20_000):
    """A program whose files may have so many bytes: what a full disk does."""

    def limit():
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))

    return subprocess.run(
        [sys.executable, *program], cwd=folder, preexec_fn=limit, capture_output=True, text=True, timeout=120
    )


def test_a_full_disk_is_named_with_the_file(finished, tmp_path):
    program = ["-m", "satsep_ot", "study", str(finished / "mine.toml"), "--output", "out", "--runs", "3000"]
    done = limited([*program, "--methods", "MonteCarlo"], tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1] == "satsep-ot: out/runs/sample.npy: File too large"
    done = limited(["-m", "satsep_ot", "new", "mine.toml"], tmp_path, 1000)
    assert done.returncode == 2
    assert done.stderr == "satsep-ot: mine.toml: File too large\n"
    assert not (tmp_path / "mine.toml").exists()


def test_errors_of_writing_name_the_file_that_was_meant(tmp_path, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)

    def write_rows(path):
        with openRowFile(path, (1, 1), 0):
            pass

    for write in (lambda path: writeWhole(path, lambda stream: stream.write(b"x")), write_rows):
        with pytest.raises(OSError, match="No space left") as caught:
            write(tmp_path / "file")
        assert caught.value.filename == str(tmp_path / "file")


@pytest.mark.parametrize(
    ("name", "code"), [("steps/rolling--FORM.json", 0), ("origin.json", 2), ("manifest.json", 0), ("results.json", 0)]
)
def test_a_pipe_in_place_of_a_file_is_not_waited_for(name, code, folder):
    path = folder / "results" / name
    path.unlink()
    os.mkfifo(path)
    assert cli.main(["report", str(folder / "results")]) == (
        0 if name.startswith(("steps", "origin", "manifest")) else 2
    )
    assert study(folder, "--resume") == code


def test_a_foreign_step_is_refused_where_there_are_no_checksums(folder, capsys):
    origin = folder / "results" / "origin.json"
    document = json.loads(origin.read_text(encoding="utf-8"))
    del document["manifest"]
    origin.write_text(json.dumps(document), encoding="utf-8")
    holding_an_object(folder / "results" / "steps" / "rolling--ActiveSubspace.npz")
    assert study(folder, "--resume") == 2
    assert "remove it and the file beside it that ends on .json" in capsys.readouterr().err
