"""Runs in any number and constant memory: known moments and probabilities, the same bits anyhow, files, going on."""

import json
import math
import os
import shutil
import tracemalloc
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import openturns as ot
import pytest
from fault_injection import DoublingWithFault, raise_error, return_nan
from scipy import stats

from satsep_ot.methods.parallel import stream_storage
from satsep_ot.methods.parallel.block_summary import BlockSummary
from satsep_ot.methods.parallel.chunks import ChunkError
from satsep_ot.methods.parallel.executors import processes
from satsep_ot.methods.parallel.monte_carlo_stream import MonteCarloStream
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

SUM = ot.SymbolicFunction(["a", "b"], ["a + b", "a"])
SUM.setOutputDescription(["sum [m]", "first"])
EVENTS = {"large": ("sum", ot.Greater(), 3.0), "low": (1, ot.LessOrEqual(), -2.0)}


def stream(size=5000, executor=None, inputs=None, function=SUM):
    ot.RandomGenerator.SetSeed(7)
    made = MonteCarloStream(function, ot.Normal(2) if inputs is None else inputs, size)
    made.setBlockSize(100)
    made.setEvents(EVENTS)
    made.setExecutor(executor)
    return made


def facts(result):
    """Everything that a result says, to be compared bit by bit."""
    numbers = [result.getMean(), result.getStandardDeviation(), result.getMin(), result.getMax()]
    counts = [result.getEventNumber(name) for name in (None, *result.getEventNames())]
    return [result.getSize(), *counts, *np.concatenate([np.array(part) for part in numbers]).tolist()]


def run(made):
    made.run()
    return facts(made.getResult())


def test_moments_and_probabilities_are_the_known_ones():
    made = stream(200_000)
    made.setBlockSize(1024)
    made.run()
    result = made.getResult()
    error = 1.0 / math.sqrt(200_000)
    assert result.getMean()[0] == pytest.approx(0.0, abs=4.0 * math.sqrt(2.0) * error)
    assert result.getStandardDeviation()[0] == pytest.approx(math.sqrt(2.0), rel=3.0 * error)
    for name, probability in (("large", stats.norm.sf(3.0 / math.sqrt(2.0))), ("low", stats.norm.cdf(-2.0))):
        interval = result.getConfidenceInterval(0.999, name)
        assert interval.getLowerBound()[0] < probability < interval.getUpperBound()[0]
        share = result.getProbabilityEstimate(name)
        assert result.getCoefficientOfVariation(name) == pytest.approx(math.sqrt((1 - share) / (share * 200_000)))
    total = result.getEventNumber("large") + result.getEventNumber("low")
    assert max(map(result.getEventNumber, EVENTS)) < result.getEventNumber() <= total
    assert result.getOutputDescription() == ["sum [m]", "first"]
    assert "'any of them'" in repr(result)


def test_summaries_are_those_of_all_rows_together():
    rows = np.random.default_rng(0).normal(1e6, 1.0, size=(1000, 2))
    parts = [BlockSummary.of(part, ((0, ot.ComparisonOperator(ot.Greater()), 1e6),)) for part in np.split(rows, 8)]
    whole = parts[0]
    for part in parts[1:]:
        whole = whole.merged(part)
    assert np.allclose(whole.mean, rows.mean(axis=0), rtol=1e-15)
    assert np.allclose(whole.squares, 1000 * rows.var(axis=0), rtol=1e-9)
    assert np.array_equal(whole.least, rows.min(axis=0))
    assert np.array_equal(whole.most, rows.max(axis=0))
    assert whole.counts.tolist() == [np.count_nonzero(rows[:, 0] > 1e6)] * 2


@pytest.mark.parametrize("chunk", [1, 100, 250, 100_000])
def test_bits_do_not_depend_on_workers_and_chunks(chunk):
    expected = run(stream())
    with ThreadPoolExecutor(3) as pool:
        for executor in (None, pool):
            made = stream(executor=executor)
            made.setChunkSize(chunk)
            assert run(made) == expected


@pytest.mark.slow
def test_bits_of_the_simulator_in_other_processes():
    problem, found = SeparationProblem("reference"), []
    for executor in (None, processes(2)):
        ot.RandomGenerator.SetSeed(0)
        made = MonteCarloStream(SeparationFunction("reference"), problem.getDistribution(), 10_000)
        made.setExecutor(executor)
        made.setChunkSize(2048)
        made.setEvents(
            {
                entry.name: (entry.quantity, ot.Greater() if entry.is_maximum else ot.Less(), entry.limit)
                for entry in problem.getRequirements()
            }
        )
        made.run()
        found.append(made.getResult())
    assert facts(found[0]) == facts(found[1])
    # 8.40e-3 of ten million runs violate any requirement.
    interval = found[0].getConfidenceInterval(0.999)
    assert interval.getLowerBound()[0] < 8.40e-3 < interval.getUpperBound()[0]


def test_the_generator_of_the_user_goes_on_as_if_one_number_had_been_drawn():
    ot.RandomGenerator.SetSeed(7)
    ot.RandomGenerator.IntegerGenerate(2**31 - 1)
    expected = ot.RandomGenerator.Generate()
    stream(300).run()
    assert ot.RandomGenerator.Generate() == expected


def test_blocks_differ_and_so_do_streams():
    made = stream(200)
    drawn = []
    made.setOutputFile(None)
    work = ot.PythonFunction(2, 1, func_sample=lambda X: (drawn.append(np.array(X)), np.array(X)[:, :1])[1])
    for _ in range(2):
        other = MonteCarloStream(work, ot.Normal(2), 200)
        other.setBlockSize(100)
        other.setChunkSize(100)
        other.run()
    # The first row of each of four blocks.
    assert len({float(rows[0, 0]) for rows in drawn}) == 4


def test_inputs_that_are_given(tmp_path):
    rows = np.random.default_rng(1).normal(size=(1050, 2))
    expected = run(stream(None, inputs=rows))
    assert expected[0] == 1050
    assert expected[4] == pytest.approx(rows.sum(axis=1).mean(), rel=1e-12)
    np.save(tmp_path / "rows.npy", rows)
    mapped = np.load(tmp_path / "rows.npy", mmap_mode="r")
    with ThreadPoolExecutor(2) as pool:
        for given in (mapped, ot.Sample(rows), (part for part in np.array_split(rows, 13)), iter([rows, rows])):
            made = stream(1050, pool, given)
            made.setChunkSize(300)
            assert run(made) == expected
    with pytest.raises(ValueError, match="the inputs end after row 1049; 1060 rows are needed"):
        run(stream(1060, inputs=iter([rows])))
    with pytest.raises(ValueError, match="1060 runs are wanted of 1050 rows"):
        stream(1060, inputs=rows)


def test_outputs_are_kept_in_a_file(tmp_path):
    made = stream(530)
    made.setOutputFile(tmp_path / "runs.npy", withInputs=True)
    expected = run(made)
    kept = np.load(tmp_path / "runs.npy", mmap_mode="r")
    assert kept.shape == (530, 4)
    assert np.array_equal(kept[:, 2:], np.array(SUM(ot.Sample(np.array(kept[:, :2])))))
    assert kept[:, 2].min() == expected[8]
    assert run(stream(None, inputs=np.array(kept[:, :2]))) == expected
    made = stream(530)
    made.setOutputFile(tmp_path / "outputs.npy")
    run(made)
    assert np.array_equal(np.load(tmp_path / "outputs.npy"), kept[:, 2:])
    assert {path.name for path in tmp_path.iterdir()} == {"runs.npy", "outputs.npy"}


class Stopped(Exception):
    pass


def stop_at(share):
    def callback(done):
        if done >= share:
            raise Stopped

    return callback


@pytest.mark.parametrize("interval", [0.0, 1e9])
def test_an_interrupted_run_continues_to_the_same_result(interval, tmp_path, monkeypatch):
    monkeypatch.setattr(stream_storage, "CHECKPOINT_INTERVAL", interval)
    plain = stream()
    plain.setOutputFile(tmp_path / "plain.npy")
    expected = run(plain)
    drawn = []

    def again(callback):
        counted = ot.PythonFunction(2, 2, func_sample=lambda X: (drawn.append(len(X)), np.array(SUM(X)))[1])
        counted.setOutputDescription(SUM.getOutputDescription())
        made = stream(function=counted)
        made.setChunkSize(500)
        made.setCheckpointFile(tmp_path / "state.json")
        made.setOutputFile(tmp_path / "runs.npy")
        made.setProgressCallback(callback)
        return made

    for share in (30.0, 60.0):
        with pytest.raises(Stopped):
            again(stop_at(share)).run()
        assert not (tmp_path / "runs.npy").exists()
    assert run(again(None)) == expected
    assert sum(drawn) == 5000
    assert (tmp_path / "runs.npy").read_bytes() == (tmp_path / "plain.npy").read_bytes()
    # What is finished is not made again.
    assert run(again(None)) == expected
    assert sum(drawn) == 5000
    assert {path.name for path in tmp_path.iterdir()} == {"plain.npy", "runs.npy", "state.json"}


@pytest.mark.parametrize("interval", [0.0, 1e9])
def test_rows_are_in_the_file_before_a_checkpoint_counts_them(interval, tmp_path, monkeypatch):
    """A process may be killed right after any checkpoint, the last one included; its buffers are lost then."""
    monkeypatch.setattr(stream_storage, "CHECKPOINT_INTERVAL", interval)
    expected, replace, part = run(stream(530)), os.replace, tmp_path / "runs.npy.part"
    seen = []

    def replaced(source, target):
        replace(source, target)
        if str(target).endswith("state.json"):
            seen.append(json.loads((tmp_path / "state.json").read_text(encoding="utf-8"))["summary"]["size"])
            shutil.copy(part, tmp_path / f"{seen[-1]}.part")
            shutil.copy(target, tmp_path / f"{seen[-1]}.json")

    def made():
        one = stream(530)
        one.setChunkSize(100)
        one.setCheckpointFile(tmp_path / "state.json")
        one.setOutputFile(tmp_path / "runs.npy")
        return one

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", replaced)
        assert run(made()) == expected
    assert seen[-1] == 530
    whole = (tmp_path / "runs.npy").read_bytes()
    for number in set(seen):
        (tmp_path / "runs.npy").unlink()
        shutil.copy(tmp_path / f"{number}.part", part)
        shutil.copy(tmp_path / f"{number}.json", tmp_path / "state.json")
        assert run(made()) == expected
        assert (tmp_path / "runs.npy").read_bytes() == whole


def test_inputs_that_come_once_are_skipped_up_to_where_a_run_continues(tmp_path):
    rows = np.random.default_rng(1).normal(size=(1000, 2))
    expected = run(stream(1000, inputs=rows))
    for callback in (stop_at(50.0), None):
        # The same rows again, in parts of other sizes than the blocks.
        made = stream(1000, inputs=(part for part in np.array_split(rows, 13)))
        made.setCheckpointFile(tmp_path / "state.json")
        made.setProgressCallback(callback)
        made.getScheduler().setMaximumAttempts(1)
        if callback is None:
            assert run(made) == expected
        else:
            with pytest.raises(Stopped):
                made.run()


def test_inputs_that_end_before_what_a_checkpoint_counts_are_named(tmp_path):
    rows = np.random.default_rng(1).normal(size=(1000, 2))
    for given, callback, error in ((rows, stop_at(50.0), Stopped), (rows[:200], None, ValueError)):
        made = stream(1000, inputs=iter([given]))
        made.setChunkSize(300)
        made.setCheckpointFile(tmp_path / "state.json")
        made.setProgressCallback(callback)
        with pytest.raises(error) as caught:
            made.run()
    assert "the inputs end after row" in str(caught.value)


def test_a_chunk_is_of_the_size_that_was_asked_for_in_any_order():
    sizes = []
    function = ot.PythonFunction(2, 1, func_sample=lambda X: (sizes.append(len(X)), np.array(X)[:, :1])[1])
    for setters in (("setChunkSize", "setBlockSize"), ("setBlockSize", "setChunkSize")):
        made = MonteCarloStream(function, ot.Normal(2), 1000)
        for name in setters:
            getattr(made, name)({"setChunkSize": 250, "setBlockSize": 50}[name])
        made.run()
    assert set(sizes) == {250}


def stopped_in_the_middle(folder):
    """A stream with checkpoint and outputs, to be run again, and the file of the outputs so far."""
    made = stream(1000)
    made.setCheckpointFile(folder / "state.json")
    made.setOutputFile(folder / "runs.npy")
    made.setProgressCallback(stop_at(50.0))
    with pytest.raises(Stopped):
        made.run()
    made.setProgressCallback(None)
    return made, folder / "runs.npy.part"


def test_outputs_that_are_shorter_than_the_checkpoint_says_are_refused(tmp_path):
    made, part = stopped_in_the_middle(tmp_path)
    assert part.stat().st_size > 200
    os.truncate(part, 200)
    ot.RandomGenerator.SetSeed(7)
    with pytest.raises(ValueError, match="shorter than the checkpoint says; remove both to begin anew"):
        made.run()
    part.unlink()
    ot.RandomGenerator.SetSeed(7)
    with pytest.raises(ValueError, match=r"runs\.npy\.part is missing, whose rows the checkpoint counts"):
        made.run()


def test_outputs_that_were_changed_are_refused(tmp_path):
    made, part = stopped_in_the_middle(tmp_path)
    content = bytearray(part.read_bytes())
    content[len(content) // 2] ^= 1
    part.write_bytes(content)
    ot.RandomGenerator.SetSeed(7)
    with pytest.raises(ValueError, match=r"runs\.npy\.part is not as it was written; remove it and the checkpoint"):
        made.run()


def test_a_checkpoint_of_other_runs_is_refused(tmp_path):
    path = tmp_path / "state.json"
    made = stream(300)
    made.setCheckpointFile(path)
    made.run()
    other = stream(400)
    other.setCheckpointFile(path)
    with pytest.raises(ValueError, match="the checkpoint of other runs: runs differ"):
        other.run()
    # Counts are in the order of the events.
    permuted = stream(300)
    permuted.setEvents(dict(reversed(EVENTS.items())))
    permuted.setCheckpointFile(path)
    with pytest.raises(ValueError, match="the checkpoint of other runs: events differ"):
        permuted.run()
    nearly = stream(300, inputs=ot.Normal([0.0, 1e-9], [1.0, 1.0], ot.CorrelationMatrix(2)))
    nearly.setCheckpointFile(path)
    with pytest.raises(ValueError, match="the checkpoint of other runs: inputs differ"):
        nearly.run()
    ot.RandomGenerator.SetSeed(8)
    with pytest.raises(ValueError, match="the checkpoint of other runs: inputs differ"):
        made.run()
    for text in ("{", "[]", json.dumps({"of": {}})):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(ValueError, match="is no checkpoint of a stream"):
            made.run()


@pytest.mark.parametrize(("fault", "reason"), [(raise_error, "licence"), (return_nan, "is not finite")])
def test_rows_that_fail_are_named_and_the_others_kept(fault, reason, tmp_path):
    (tmp_path / "faults").mkdir()
    rows = np.arange(1000.0)[:, None]
    function = ot.PythonFunction(1, 1, func_sample=DoublingWithFault(fault, 450.0, 99, tmp_path / "faults"))
    made = MonteCarloStream(function, rows)
    made.setBlockSize(10)
    made.setChunkSize(100)
    made.setCheckpointFile(tmp_path / "state.json")
    with ThreadPoolExecutor(2) as pool:
        made.setExecutor(pool)
        with pytest.raises(ChunkError, match=f"rows 400 to 499 .* 3 attempts.*{reason}"):
            made.run()
        # The cause is away: the run goes on behind what it has.
        for path in (tmp_path / "faults").iterdir():
            path.unlink()
        function = ot.PythonFunction(1, 1, func_sample=DoublingWithFault(fault, 450.0, 0, tmp_path / "faults"))
        again = MonteCarloStream(function, rows)
        again.setBlockSize(10)
        again.setCheckpointFile(tmp_path / "state.json")
        told = []
        again.setChunkSize(100)
        again.setProgressCallback(told.append)
        again.run()
    assert told[0] == 50.0
    assert again.getResult().getMean()[0] == 999.0


def test_memory_does_not_grow_with_the_runs():
    def peak(size):
        made = stream(size)
        made.setBlockSize(1000)
        made.setChunkSize(2000)
        tracemalloc.start()
        made.run()
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    peak(4000)
    assert peak(200_000) < 1.5 * peak(4000)


def test_bad_arguments_are_named():
    made = stream(10)
    made.setEvents({"by its whole name": ("sum [m]", ot.Greater(), 3.0), "by its index": (np.int64(1), ot.Less(), 0.0)})
    with pytest.raises(ValueError, match=r"'1\.0' is no output of the function"):
        made.setEvents({"event": (1.0, ot.Greater(), 3.0)})
    with pytest.raises(ValueError, match="the inputs have dimension 3, the function has 2 inputs"):
        MonteCarloStream(SUM, ot.Normal(3), 10)
    for size in (None, 0, 1.5):
        with pytest.raises(ValueError, match=f"the number of runs is {size}; it must be a whole number of at least 1"):
            MonteCarloStream(SUM, ot.Normal(2), size)
    made = stream(10)
    with pytest.raises(ValueError, match="'weight' is no output of the function; give its index or its name out of"):
        made.setEvents({"heavy": ("weight", ot.Greater(), 1.0)})
    with pytest.raises(ValueError, match="it must be finite"):
        made.setEvents({"never": ("sum", ot.Greater(), math.inf)})
    for set_size in (made.setBlockSize, made.setChunkSize):
        with pytest.raises(ValueError, match="size is 0; it must be a whole number of at least 1"):
            set_size(0)
    with pytest.raises(TypeError, match="must be callable"):
        made.setProgressCallback(1)
    with pytest.raises(RuntimeError, match="call run"):
        made.getResult()
    made.run()
    with pytest.raises(ValueError, match="'heavy' is no event of these runs; they have large, low"):
        made.getResult().getEventNumber("heavy")
    with pytest.raises(ValueError, match="the level is 1"):
        made.getResult().getConfidenceInterval(1.0)
    assert repr(made) == "MonteCarloStream(size=10, blockSize=100, events=['large', 'low'])"
