"""The command `satsep-ot benchmark` and its problems."""

import json

import pytest

from satsep_ot.cli import main
from satsep_ot.studies.method_benchmark import REFERENCE_VIOLATIONS, benchmark_names, benchmark_tasks, save_benchmark


def test_names_stand_for_published_problems_and_for_the_reference_case():
    tasks = benchmark_tasks(["reference", "RP8", "RP8"])
    assert [task.name for task in tasks] == [
        "reference-lateral-rate", "reference-spin", "reference-axial-velocity", "reference-clearance",
        "reference-any-requirement", "RP8",
    ]  # fmt: skip
    assert all(task.gradientCost > 1.0 for task in tasks[:5])
    # A violation of any requirement is at least as likely as that of each, and at most their sum.
    probabilities = [task.probability for task in tasks[:5]]
    assert max(probabilities[:4]) <= probabilities[4] <= sum(probabilities[:4])
    assert len(REFERENCE_VIOLATIONS) == 5
    assert set(benchmark_names()) >= {"P1", "FourBranch", "reference-spin"}


def test_unknown_problems_and_methods_are_refused_with_the_known_ones(tmp_path, capsys):
    output = ["--output", str(tmp_path / "out")]
    assert main(["benchmark", "--problems", "P99", *output]) == 2
    assert "'P99' is no benchmark problem; there are published, reference, P1" in capsys.readouterr().err
    assert main(["benchmark", "--problems", "RP107", "--methods", "Magic", *output]) == 2
    assert "there are ActiveSubspace, FORM" in capsys.readouterr().err
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
    assert "right on all of these: FORM, ActiveLineSampling" in captured.out
    assert "RP107: FORM" in captured.err
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "benchmark.csv", "benchmark.json", "benchmark.md", "runs.jsonl",
    ]  # fmt: skip
    runs = (tmp_path / "runs.jsonl").read_text(encoding="utf-8")
    assert len(runs.splitlines()) == 4
    assert main([*arguments, "--json"]) == 0
    assert (tmp_path / "runs.jsonl").read_text(encoding="utf-8") == runs
    table = json.loads(capsys.readouterr().out)
    assert [row["method"] for row in table] == ["FORM", "ActiveLineSampling"]
    assert table == json.loads((tmp_path / "benchmark.json").read_text(encoding="utf-8"))


def test_files_are_written_whole_or_not_at_all(tmp_path):
    class Broken:
        def toMarkdown(self):
            return "fine"

        def toCSV(self):
            return "fine"

        def getTable(self):
            return [{"bias": float("nan")}]

    with pytest.raises(ValueError, match="not JSON compliant"):
        save_benchmark(Broken(), tmp_path)
    assert not list(tmp_path.iterdir())
