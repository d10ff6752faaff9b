"""ReliabilityBenchmark: what the repetitions are reduced to, who is right, what an interruption leaves."""

import json
import math
import os
import signal
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import openturns as ot
import pytest
from fault_injection import DoublingWithFault

from satsep_ot.methods.comparison.benchmark import ReliabilityBenchmark
from satsep_ot.methods.comparison.benchmark_result import BenchmarkRow, ReliabilityBenchmarkResult
from satsep_ot.methods.comparison.method import ReliabilityMethod, Row
from satsep_ot.methods.comparison.problem import BenchmarkTask
from satsep_ot.methods.comparison.problems import getBenchmarkProblem
from satsep_ot.methods.comparison.simulations import MonteCarlo
from satsep_ot.methods.parallel.chunks import ChunkError
from satsep_ot.methods.parallel.executors import processes
from satsep_ot.methods.parallel.monte_carlo_stream import MonteCarloStream

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


def task(name="task", **options):
    vector = ot.CompositeRandomVector(ot.SymbolicFunction("x", "x"), ot.RandomVector(ot.Normal()))
    return BenchmarkTask(name, ot.ThresholdEvent(vector, ot.Greater(), 2.3), TRUTH, **options)


class Streaming(ReliabilityMethod):
    """A method that draws from a stream, which takes the random generator for itself, as a repetition does."""

    name = "Streaming"

    def run(self, problem):
        stream = MonteCarloStream(problem.event.getFunction(), problem.event.getAntecedent().getDistribution(), 1000)
        stream.setEvents({"event": (0, problem.event.getOperator(), problem.event.getThreshold())})
        stream.run()
        return Row(self.name, stream.getResult().getProbabilityEstimate("event"))


def rows(methods, repetitions=4, probabilityError=0.0, **options):
    benchmark = ReliabilityBenchmark([task(probabilityError=probabilityError)], methods, repetitions)
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
    assert row.verdict == "open"


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
    assert [row.verdict for row in found.values()] == ["wrong", "wrong", "wrong", "open", "open"]
    assert {name: row.rank for name, row in found.items()} == {
        "biased": None, "over-confident": None, "sometimes silent": None, "dear": 2, "cheap": 1,
    }  # fmt: skip
    silent = found["sometimes silent"]
    assert (silent.failed, silent.repetitions) == (2, 4)
    assert "no idea" in silent.message
    assert silent.bias == pytest.approx(0.0)


def test_a_verdict_needs_repetitions_that_could_have_told_otherwise():
    exact, noisy = [1.01, 0.99], [1.2, 0.8]
    methods = [Told("exact", exact, 0.01), Told("noisy", noisy, 0.2), Told("same", [1.019])]
    few, many = rows(methods, 2), rows(methods, 12)
    # Two repetitions are no evidence, but for a method that always says the same.
    assert [(row.verdict, row.needed) for row in few.values()] == [("open", 10), ("open", 800), ("right", None)]
    # A spread of 20 % needs (20 / 1)^2 repetitions to be known to 1 %.
    assert [row.verdict for row in many.values()] == ["right", "open", "right"]
    assert many["noisy"].needed == math.ceil((np.std(noisy * 6, ddof=1) / 0.01) ** 2)
    assert rows([Told("noisy", noisy, 0.2)], 440)["noisy"].verdict == "right"
    assert rows([Told("once", [1.03])], 1)["once"].verdict == "open"


def test_two_repetitions_that_happen_to_agree_do_not_condemn():
    # Student's interval of two values 0.5 % apart is 3 % wide on each side.
    assert rows([Told("agreeing", [1.03, 1.035], 0.05)], 2)["agreeing"].verdict == "open"
    assert rows([Told("biased", [1.03, 1.035], 0.05)], 12)["biased"].verdict == "wrong"


def test_too_seldom_inside_is_wrong_only_when_chance_does_not_explain_it():
    # Of 20, 14 or fewer happen with 1.1 % probability where 90 % are inside; 15 or fewer with 4.3 %.
    def coverage(missed):
        ratios = [1.0] * (20 - missed) + [1.004, 0.996] * (missed // 2) + [1.004] * (missed % 2)
        return rows([Told("told", ratios, 0.001)], 20)["told"]

    assert (coverage(6).coverage, coverage(6).verdict) == (0.7, "wrong")
    assert (coverage(5).coverage, coverage(5).verdict) == (0.75, "right")


def test_the_error_of_the_reference_is_not_held_against_a_method():
    assert rows([Told("same", [1.05])], 2)["same"].verdict == "wrong"
    row = rows([Told("same", [1.05])], 2, probabilityError=0.02)["same"]
    assert (row.verdict, row.biasError) == ("right", pytest.approx(0.02))
    # An interval of 1.96 % beside a reference that is known to 1.96 %: together they reach 2.8 %.
    near, far = ([1.0 + offset] * 12 for offset in (0.027, 0.029))
    assert rows([Told("near", near, 0.01)], 12, probabilityError=0.01)["near"].coverage == 1.0
    assert rows([Told("far", far, 0.01)], 12, probabilityError=0.01)["far"].coverage == 0.0


def test_repetitions_beyond_those_asked_for_count(tmp_path):
    path = tmp_path / "runs.jsonl"
    method = Told("told", [1.01, 0.99], 0.01)
    assert rows([method], 12, File=path)["told"].repetitions == 12
    assert rows([method], 2, File=path)["told"].repetitions == 12
    assert method.calls == 12


def test_summary_is_over_all_problems_and_ranks_the_methods_that_are_nowhere_wrong():
    def row(problem, method, verdict, cost):
        return BenchmarkRow(problem, method, repetitions=20, failed=0, cost=cost, verdict=verdict)

    result = ReliabilityBenchmarkResult(
        [
            row("A", "sure", "right", 400.0), row("A", "cheap", "right", 10.0), row("A", "slow", "open", 4000.0),
            row("B", "sure", "right", 600.0), row("B", "cheap", "wrong", 1.0), row("B", "slow", "right", 9000.0),
            row("B", "half", "right", 5.0),
        ]
    )  # fmt: skip
    assert result.getRightMethods() == ["sure"]
    summaries = [(s.method, s.right, s.open, s.wrong, s.cost) for s in result.getSummaries()]
    assert summaries == [
        ("sure", 2, 0, 0, 1000.0), ("slow", 1, 1, 0, 13000.0), ("half", 1, 0, 0, None), ("cheap", 1, 0, 1, None),
    ]  # fmt: skip
    lines = [line.split("  ") for line in result.toText().splitlines()]
    slow = next(line for line in lines[-4:] if line[0] == "slow")
    assert [cell.strip() for cell in slow if cell.strip()][-3:] == ["4,000 (x 10)", "9,000 (x 15)", "13,000 (x 13)"]
    cheap = next(line for line in lines[-4:] if line[0] == "cheap")
    assert [cell.strip() for cell in cheap if cell.strip()][-2:] == ["10 (x 0.025)", "wrong"]
    # More problems than methods: the problems go down the page.
    long = ReliabilityBenchmarkResult([row(problem, "sure", "right", 100.0) for problem in "ABC"])
    assert [line.split() for line in long.toText().splitlines()[5:]] == [
        ["method", "sure"], ["right", "3"], ["open", "0"], ["wrong", "0"],
        ["A", "100"], ["B", "100"], ["C", "100"], ["all", "300"],
    ]  # fmt: skip


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


def without_seconds(benchmark):
    return [{**row, "seconds": None} for row in benchmark.getResult().getTable()]


def sampled(*more):
    """Methods that search and draw, on a problem with components and one without."""
    tasks = [BenchmarkTask.of(getBenchmarkProblem(name)) for name in ("RP8", "P4-d10")]
    return ReliabilityBenchmark(tasks, ["FORM", MonteCarlo(2000), *more], 3)


def test_threads_change_no_number_and_leave_the_generator_alone(tmp_path):
    ot.RandomGenerator.SetSeed(7)
    expected = ot.RandomGenerator.Generate()
    alone, threaded = sampled(), sampled()
    alone.run()
    ot.RandomGenerator.SetSeed(7)
    with ThreadPoolExecutor(3) as pool:
        threaded.setExecutor(pool)
        threaded.setFile(tmp_path / "runs.jsonl")
        threaded.run()
    assert ot.RandomGenerator.Generate() == expected
    assert without_seconds(threaded) == without_seconds(alone)
    assert len((tmp_path / "runs.jsonl").read_text(encoding="utf-8").splitlines()) == 12


@pytest.mark.slow
def test_processes_change_no_number():
    alone, spread = sampled("ActiveSubspace"), sampled("ActiveSubspace")
    alone.run()
    spread.setExecutor(processes(2))
    shares = []
    spread.setProgressCallback(lambda label, share: shares.append(share))
    spread.run()
    assert without_seconds(spread) == without_seconds(alone)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_a_method_may_run_a_stream():
    row = rows([Streaming()])["Streaming"]
    assert row.failed == 0
    assert abs(row.bias) < 0.5


class Deadly(ReliabilityMethod):
    """Plain counting, but the process ends, a number of times, where a file is not there."""

    name = "Deadly"

    def __init__(self, folder, times):
        self.folder, self.times = str(folder), times

    def __repr__(self):
        return "Deadly()"

    def run(self, problem):
        sample = problem.event.getAntecedent().getSample(100)
        if sample[0, 0] < 0.0 and DoublingWithFault(None, 0.0, self.times, self.folder).is_due():
            os.kill(os.getpid(), signal.SIGKILL)
        failures = int(np.count_nonzero(problem.isFailure(np.array(sample))))
        return Row(self.name, failures / 100.0)


@pytest.mark.slow
def test_a_worker_that_dies_is_replaced_and_a_repetition_that_kills_is_named(tmp_path):
    expected = rows([Deadly(tmp_path, 0)], 6)["Deadly"]
    path = tmp_path / "runs.jsonl"
    with pytest.raises(
        ChunkError, match=r"^task: Deadly with the seed \d could not be computed in 3 attempts.*worker died"
    ):
        rows([Deadly(tmp_path, 99)], 6, Executor=processes(2), File=path)
    # Of six seeds some draw nothing below zero first; what was finished is kept, the rest is made.
    assert 0 < len(path.read_text(encoding="utf-8").splitlines()) < 6
    for fault in tmp_path.glob("fault-*"):
        fault.unlink()
    found = rows([Deadly(tmp_path, 2)], 6, Executor=processes(2), File=path)["Deadly"]
    assert len(list(tmp_path.glob("fault-*"))) == 2
    assert (found.bias, found.error, found.repetitions) == (expected.bias, expected.error, 6)


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


def test_the_active_subspace_does_not_care_for_axes_and_units():
    """The limit state in other coordinates and units has the same probability, found for about as many runs."""
    names = ("P5-d5", "P5-d5-rotated-rescaled")
    benchmark = ReliabilityBenchmark([BenchmarkTask.of(getBenchmarkProblem(n)) for n in names], ["ActiveSubspace"], 2)
    benchmark.run()
    plain, turned = benchmark.getResult().getRows()
    for row in (plain, turned):
        assert row.failed == 0
        assert row.error < 0.02
    assert turned.evaluations < 1.3 * plain.evaluations


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
    assert wrong.verdict == "wrong"
    verdicts = {(row.problem, row.method): row.verdict for row in result.getRows()}
    assert verdicts["FourBranch", "ActiveSubspace"] == "open"
    assert verdicts["RP107", "FORM"] == "right"
    assert result.getRightMethods() == []
    assert len(result.toCSV().splitlines()) == 7
    # Eight lines of repetitions, five of the summary.
    assert len(result.toMarkdown().splitlines()) == 8 + 1 + 5
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


def test_a_method_that_never_answers_is_wrong_and_has_no_error():
    row = rows([Told("mute", [None])])["mute"]
    assert (row.verdict, row.failed, row.repetitions) == ("wrong", 4, 4)
    assert "no idea" in row.message
    assert row.error is None
    assert row.evaluations == 100.0


def test_a_benchmark_shows_what_it_is_made_of():
    benchmark = ReliabilityBenchmark([task()], [Told("a", [1.0])], 2)
    assert repr(benchmark) == "ReliabilityBenchmark(problems=['task'], methods=['a'], repetitions=2, seed=0)"
    assert benchmark.getScheduler().isInPlace()
    benchmark.run()
    assert repr(benchmark.getResult()) == "ReliabilityBenchmarkResult(rows=1)"
