"""The command `satsep-ot benchmark` and its problems."""

import json
import math
import types

import matplotlib.image
import pytest

from satsep_ot.cli import main
from satsep_ot.methods.comparison.approximations import FORM
from satsep_ot.methods.comparison.benchmark import ReliabilityBenchmark
from satsep_ot.studies import method_benchmark
from satsep_ot.studies.method_benchmark import (
    REFERENCE_IMPORTANCE,
    REFERENCE_RUNS,
    REFERENCE_VIOLATIONS,
    benchmark_names,
    benchmark_tasks,
    reference_probability,
    save_benchmark,
    table_keeper,
)


def test_names_stand_for_published_problems_and_for_the_reference_case():
    tasks = benchmark_tasks(["reference", "RP8", "RP8"])
    assert [task.name for task in tasks] == [
        "reference-lateral-rate", "reference-spin", "reference-axial-velocity", "reference-clearance",
        "reference-any-requirement", "RP8",
    ]  # fmt: skip
    assert all(task.gradientCost > 1.0 for task in tasks[:5])
    # 2530 violations in ten million runs are known to 2 %, and importance sampling to 0.8 %.
    assert tasks[0].probabilityError == pytest.approx(0.0076, rel=0.02)
    # A violation of any requirement is at least as likely as that of each, and at most their sum.
    probabilities = [task.probability for task in tasks[:5]]
    assert max(probabilities[:4]) <= probabilities[4] <= sum(probabilities[:4])
    assert len(REFERENCE_VIOLATIONS) == 5
    assert set(benchmark_names()) >= {"P1", "FourBranch", "reference-spin"}


@pytest.mark.parametrize("requirement", REFERENCE_VIOLATIONS)
def test_both_references_agree_and_are_taken_together(requirement):
    share = REFERENCE_VIOLATIONS[requirement] / REFERENCE_RUNS
    estimate, deviation = REFERENCE_IMPORTANCE[requirement]
    error = math.sqrt(share / REFERENCE_RUNS)
    assert abs(share - estimate) < 3.0 * math.hypot(error, deviation)
    probability, combined = reference_probability(requirement)
    assert min(share, estimate) <= probability <= max(share, estimate)
    assert combined == pytest.approx(error * deviation / math.hypot(error, deviation), rel=0.01)


def test_variants_are_problems_of_the_same_probability():
    tasks = {task.name: task for task in benchmark_tasks(["variants", "P3"])}
    assert tasks["P3-rotated"].probability == tasks["P3"].probability
    assert tasks["P4-d25-rotated-rescaled"].event.getFunction().getInputDimension() == 25
    assert {name.split("-")[0] for name in tasks} == {"P1", "P2", "P3", "P4", "P5", "RP8", "RP54"}


def test_unknown_problems_and_methods_are_refused_with_the_known_ones(tmp_path, capsys):
    output = ["--output", str(tmp_path / "out")]
    assert main(["benchmark", "--problems", "P99", *output]) == 2
    assert "'P99' is no benchmark problem; there are published, variants, reference, P1" in capsys.readouterr().err
    assert main(["benchmark", "--problems", "P1-turned", *output]) == 2
    assert "'P1-turned' is no variant" in capsys.readouterr().err
    assert main(["benchmark", "--problems", "RP107", "--methods", "Magic", *output]) == 2
    assert "there are ActiveSubspace, SafeActiveSubspace, FORM" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    (tmp_path / "file").touch()
    assert main(["benchmark", "--output", str(tmp_path / "file")]) == 2
    with pytest.raises(SystemExit):
        main(["benchmark", "--repetitions", "0"])


def test_the_command_prints_a_table_writes_files_and_continues(tmp_path, capsys):
    arguments = ["benchmark", "--problems", "RP107", "--methods", "FORM", "ActiveLineSampling", "--repetitions", "2"]
    arguments += ["--output", str(tmp_path)]
    assert main(arguments) == 0
    captured = capsys.readouterr()
    assert captured.out.splitlines()[1].startswith("RP107")
    # Two repetitions tell of a method that always says the same, and of no other.
    assert "right on all of these: FORM\n" in captured.out
    assert "open: the repetitions are too few" in captured.out
    assert "RP107: FORM" in captured.err
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "benchmark.csv", "benchmark.json", "benchmark.md", "cost.png", "errors.png", "origin.json", "runs.jsonl",
    ]  # fmt: skip
    assert matplotlib.image.imread(tmp_path / "cost.png").min() < 0.5
    runs = (tmp_path / "runs.jsonl").read_text(encoding="utf-8")
    assert len(runs.splitlines()) == 4
    assert main(arguments) == 2
    assert "holds this benchmark already: --resume continues" in capsys.readouterr().err
    assert main([*arguments, "--resume", "--json"]) == 0
    assert (tmp_path / "runs.jsonl").read_text(encoding="utf-8") == runs
    table = json.loads(capsys.readouterr().out)
    assert [row["method"] for row in table] == ["FORM", "ActiveLineSampling"]
    assert table == json.loads((tmp_path / "benchmark.json").read_text(encoding="utf-8"))


def test_an_interruption_says_what_there_is_and_the_command_continues(tmp_path, capsys, monkeypatch):
    run = FORM.run

    def interrupted(method, problem):
        if (tmp_path / "runs.jsonl").exists():
            raise KeyboardInterrupt
        return run(method, problem)

    arguments = ["benchmark", "--problems", "RP107", "--methods", "FORM", "--repetitions", "3"]
    arguments += ["--output", str(tmp_path)]
    with monkeypatch.context() as patch:
        patch.setattr(FORM, "run", interrupted)
        assert main(arguments) == 130
    said = capsys.readouterr().err
    assert f"interrupted; what was finished is kept in {tmp_path}: the same command with --resume" in said
    assert "benchmark.md has a table of all but the latest" in said
    assert len((tmp_path / "runs.jsonl").read_text(encoding="utf-8").splitlines()) == 1
    assert main([*arguments, "--resume", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["repetitions"] == 3
    # Begun anew, with another method.
    assert main([*arguments[:4], "SORM", *arguments[5:], "--overwrite", "--json"]) == 0
    assert [row["method"] for row in json.loads(capsys.readouterr().out)] == ["SORM"]
    assert len((tmp_path / "runs.jsonl").read_text(encoding="utf-8").splitlines()) == 3


def test_the_table_of_a_benchmark_that_runs_is_kept_in_a_twentieth_of_the_time(tmp_path, monkeypatch):
    now, saved = [0.0], []

    def save(result, directory, drawn):
        assert not drawn
        saved.append((now[0], [row.repetitions for row in result.getRows()]))
        save_benchmark(result, directory, drawn)
        now[0] += 0.12

    def follow(label, share):
        keep()
        now[0] += 1.0

    monkeypatch.setattr(method_benchmark, "time", types.SimpleNamespace(monotonic=lambda: now[0]))
    monkeypatch.setattr(method_benchmark, "save_benchmark", save)
    benchmark = ReliabilityBenchmark(benchmark_tasks(["RP107"]), ["FORM"], 4)
    keep = table_keeper(benchmark, tmp_path)
    benchmark.setProgressCallback(follow)
    benchmark.run()
    assert saved == [(0.0, []), (pytest.approx(3.12), [3])]
    assert json.loads((tmp_path / "benchmark.json").read_text(encoding="utf-8"))[0]["repetitions"] == 3


def test_files_are_written_whole_or_not_at_all(tmp_path):
    class Broken:
        def toMarkdown(self):
            return "fine"

        def toCSV(self):
            return "fine"

        def getTable(self):
            return [{"bias": float("nan")}]

        def getRows(self):
            return []

    with pytest.raises(ValueError, match="not JSON compliant"):
        save_benchmark(Broken(), tmp_path)
    assert not list(tmp_path.iterdir())
