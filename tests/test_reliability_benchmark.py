"""ReliabilityBenchmark: what the repetitions are reduced to, who is right, what an interruption leaves."""

import json
import math

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.benchmark_problems import getBenchmarkProblem
from satsep_ot.methods.reliability_benchmark import BenchmarkTask, ReliabilityBenchmark
from satsep_ot.methods.reliability_methods import MonteCarlo, ReliabilityMethod, Row

TRUTH = 1e-2


class Told(ReliabilityMethod):
    """A method that says what it is told, once for each repetition, for 100 evaluations."""

    def __init__(self, name, ratios, variation=None, size=100, fixed=False):
        self.name, self.ratios, self.variation, self.size, self.fixedSize = name, list(ratios), variation, size, fixed
        self.calls = 0

    def __repr__(self):
        return self.name

    def run(self, problem):
        problem.isFailure(np.zeros((self.size, 1)))
        ratio = self.ratios[self.calls % len(self.ratios)]
        self.calls += 1
        if ratio is None:
            raise ArithmeticError("no idea")
        if self.variation is None:
            return Row(self.name, ratio * TRUTH)
        half = 1.96 * self.variation * ratio * TRUTH
        return Row(self.name, ratio * TRUTH, ratio * TRUTH - half, ratio * TRUTH + half, self.variation)


def task(name="task", gradientCost=1.0):
    vector = ot.CompositeRandomVector(ot.SymbolicFunction("x", "x"), ot.RandomVector(ot.Normal()))
    return BenchmarkTask(name, ot.ThresholdEvent(vector, ot.Greater(), 2.3), TRUTH, gradientCost=gradientCost)


def rows(methods, repetitions=4, **options):
    benchmark = ReliabilityBenchmark([task()], methods, repetitions)
    for name, value in options.items():
        getattr(benchmark, f"set{name}")(value)
    benchmark.run()
    return {row.method: row for row in benchmark.getResult().getRows()}


def test_bias_error_coverage_and_cost_are_those_of_the_repetitions():
    row = rows([Told("honest", [0.9, 1.1, 0.95, 1.05], 0.06, fixed=True)])["honest"]
    assert row.bias == pytest.approx(0.0, abs=1e-12)
    assert row.error == pytest.approx(math.sqrt((0.01 + 0.01 + 0.0025 + 0.0025) / 4))
    assert row.biasError == pytest.approx(np.std([0.9, 1.1, 0.95, 1.05], ddof=1) / 2.0)
    assert row.claimed == pytest.approx(0.06)
    assert row.coverage == 1.0
    assert row.evaluations == 100.0
    assert row.cost == pytest.approx(100.0 * (row.error / 0.05) ** 2)
    assert row.right


def test_a_method_that_is_wrong_has_no_rank_however_cheap():
    found = rows(
        [
            Told("biased", [0.5], size=2),
            Told("over-confident", [0.9, 1.1, 0.9, 1.1], 0.001, size=2),
            Told("sometimes silent", [1.0, None], 0.05, size=2),
            Told("dear", [1.0, 1.01], 0.05, size=1000),
            Told("cheap", [1.0, 1.01], 0.05, size=200),
        ]
    )
    assert {name: row.rank for name, row in found.items()} == {
        "biased": None, "over-confident": None, "sometimes silent": None, "dear": 2, "cheap": 1,
    }  # fmt: skip
    silent = found["sometimes silent"]
    assert (silent.failed, silent.repetitions) == (2, 4)
    assert "no idea" in silent.message
    assert silent.bias == pytest.approx(0.0)


def test_a_method_that_was_asked_for_an_error_is_not_given_fewer_runs_than_it_made():
    found = rows([Told("asked", [1.001], 0.05), Told("fixed", [1.001], 0.05, fixed=True)])
    assert found["asked"].cost == 100.0
    assert found["fixed"].cost < 1.0


def test_an_interrupted_benchmark_continues_where_it_was(tmp_path):
    path = tmp_path / "runs.jsonl"
    method = Told("told", [1.0, 1.02], 0.05)

    def interrupt(label, share):
        if share >= 0.5:
            raise KeyboardInterrupt

    benchmark = ReliabilityBenchmark([task()], [method], 4)
    benchmark.setFile(path)
    benchmark.setProgressCallback(interrupt)
    with pytest.raises(KeyboardInterrupt):
        benchmark.run()
    assert benchmark.getResult().getRows()[0].repetitions == 2
    assert method.calls == 2
    # A line that was being written when the power failed.
    with path.open("a", encoding="utf-8") as stream:
        stream.write('{"key": "[\\"task\\", ')
    benchmark.setProgressCallback(None)
    benchmark.run()
    assert method.calls == 4
    assert benchmark.getResult().getRows()[0].repetitions == 4
    complete = [line for line in path.read_text(encoding="utf-8").splitlines() if line.endswith("}}")]
    assert [json.loads(line)["row"]["evaluations"] for line in complete] == [100] * 4
    # Nothing is left to do; another seed, another setting or another problem is.
    benchmark.run()
    assert method.calls == 4


def test_other_settings_are_not_taken_from_the_file(tmp_path):
    path = tmp_path / "runs.jsonl"
    for size in (1000, 2000):
        assert rows([MonteCarlo(size)], 1, File=path)["MonteCarlo"].evaluations == size


def test_seeds_repeat_and_the_state_of_the_generator_is_kept():
    ot.RandomGenerator.SetSeed(7)
    expected = ot.RandomGenerator.Generate()
    ot.RandomGenerator.SetSeed(7)
    first = rows([MonteCarlo(500)])["MonteCarlo"]
    assert ot.RandomGenerator.Generate() == expected
    assert rows([MonteCarlo(500)])["MonteCarlo"].error == first.error > 0.0


def test_published_problem_with_components_and_tables():
    benchmark = ReliabilityBenchmark(
        [BenchmarkTask.of(getBenchmarkProblem(name)) for name in ("FourBranch", "RP107")],
        ["ActiveSubspace", "FORM", "ActiveLineSampling"],
        2,
    )
    labels = []
    benchmark.setProgressCallback(lambda label, share: labels.append((label, share)))
    benchmark.run()
    assert labels[0] == ("FourBranch: ActiveSubspace", 0.0)
    assert labels[-1] == ("done", 1.0)
    result = benchmark.getResult()
    assert len(result.getRows()) == 6
    # Four branches: one design point says a quarter.
    wrong = next(row for row in result.getRows() if (row.problem, row.method) == ("FourBranch", "FORM"))
    assert not wrong.right
    assert "ActiveSubspace" in result.getRightMethods()
    assert "FORM" not in result.getRightMethods()
    assert len(result.toCSV().splitlines()) == 7
    assert len(result.toMarkdown().splitlines()) == 8
    assert result.toText().splitlines()[1].startswith("FourBranch")
    assert [row["method"] for row in result.getTable()][:2] == ["ActiveSubspace", "FORM"]
    assert len(result.drawCost().getDrawables()) >= 2
    assert len(result.drawErrors().getDrawables()) >= 2


def test_bad_settings_are_refused():
    with pytest.raises(ValueError, match="repetitions is 0"):
        ReliabilityBenchmark([task()], ["FORM"], 0)
    with pytest.raises(ValueError, match="names of the problems must differ"):
        ReliabilityBenchmark([task(), task()], ["FORM"])
    with pytest.raises(ValueError, match="no reliability method"):
        ReliabilityBenchmark([task()], ["Magic"])
    with pytest.raises(RuntimeError, match="run"):
        ReliabilityBenchmark([task()], ["FORM"]).getResult()
