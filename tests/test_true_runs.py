"""True runs with their weights: the estimate again from them, and their file."""

import json

import numpy as np
import openturns as ot
import pytest
from reliability_events import findNothing

from satsep_ot.methods.common.storage import TEMPORARY, writeWhole
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.openturns_adapter import fromXML, toXML


def result_of(formula, threshold, maximum=1500, mode="fast", dimension=3):
    ot.RandomGenerator.SetSeed(1)
    names = [f"x{i}" for i in range(dimension)]
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(names, [formula]), ot.RandomVector(ot.Normal(dimension)))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), threshold))
    algorithm.setMaximumEvaluations(maximum)
    algorithm.setMode(mode)
    algorithm.run()
    return algorithm.getResult()


@pytest.mark.parametrize("mode", ["fast", "safe"])
def test_the_estimate_again_from_the_weights(mode):
    result = result_of("x0 + 0.5 * x1 + 0.1 * x1^2", 4.0, mode=mode)
    assert result.getMethod() == "ActiveSubspace"
    runs = result.getTrueRuns(["load"])
    assert runs.computeProbability() == pytest.approx(result.getProbabilityEstimate(), rel=1e-12)
    assert runs.outputNames == ("load",)
    assert runs.getInputSample() == result.getInputSample()
    counts = {name: int(np.count_nonzero(runs.phases == name)) for name in np.unique(runs.phases)}
    assert counts == result.getPhases()
    assert np.array_equal(np.isfinite(runs.weights), runs.phases == "estimation")
    # The runs are plain importance sampling too, of this and of any other event.
    expected = result.getDiagnostics()["plain importance sampling"]
    assert runs.computeProbability(runs.failed) == pytest.approx(expected, rel=1e-12)
    assert runs.computeProbability(runs.outputs[:, 0] > 4.0) == pytest.approx(expected, rel=1e-12)


def test_the_first_runs_of_a_constant_are_a_monte_carlo_sample():
    runs = result_of("2.0 + 0.0 * x0", 1.0).getTrueRuns()
    nominal = np.isin(runs.phases, ("learning", "Monte Carlo"))
    assert np.array_equal(runs.weights, np.where(nominal, 1.0, np.nan), equal_nan=True)
    assert runs.failed.all()
    assert runs.computeProbability() == 1.0


def test_the_estimate_again_from_runs_around_modes_and_of_a_complement():
    step = "(x0 > 2.5) ? 1 : -1"
    for formula, threshold, method in (
        (step, 0.0, "ImportanceSampling"),
        ("(x0 > -2.0) ? 1 : -1", 0.0, "ImportanceSampling"),
        ("x0 + 0.5 * x1", -2.5, "ActiveSubspace"),
    ):
        result = result_of(formula, threshold, maximum=3000, dimension=12)
        assert result.getMethod() == method
        runs = result.getTrueRuns()
        assert runs.computeProbability() == pytest.approx(result.getProbabilityEstimate(), rel=1e-9)
        assert np.array_equal(runs.failed, runs.outputs[:, 0] > threshold)


def test_runs_of_subset_simulation_have_no_weights(monkeypatch):
    findNothing(monkeypatch)
    result = result_of("x0", 2.0, maximum=600)
    assert result.getMethod() == "SubsetSimulation"
    with pytest.raises(ValueError, match=r"no run of .*subset simulation has a weight"):
        result.getTrueRuns().computeProbability()


def test_runs_are_saved_and_loaded_bit_for_bit(tmp_path):
    runs = result_of("x0 + 0.5 * x1 + 0.1 * x1^2", 4.0).getTrueRuns(["load [N]"])
    runs.save(tmp_path / "runs.npz")
    again = TrueRuns.load(tmp_path / "runs.npz")
    for name in ("inputs", "outputs", "failed", "phases", "weights", "expected"):
        assert np.array_equal(getattr(again, name), getattr(runs, name), equal_nan=name == "weights")
    assert (again.inputNames, again.outputNames) == (runs.inputNames, runs.outputNames)
    assert again.computeProbability() == runs.computeProbability()
    assert again.getOutputSample().getDescription()[0] == "load [N]"
    # As the documentation says: numpy alone reads them.
    with np.load(tmp_path / "runs.npz", allow_pickle=False) as archive:
        assert np.array_equal(archive["inputs"], runs.inputs)
        assert json.loads(str(archive["document"]))["outputNames"] == ["load [N]"]


def test_what_holds_no_runs_is_refused(tmp_path):
    path = tmp_path / "runs.npz"
    for content in (b"", b"PK", b"text"):
        path.write_bytes(content)
        with pytest.raises(ValueError, match="holds no true runs"):
            TrueRuns.load(path)
    np.savez(path, document=np.array(json.dumps({"format": "TrueRuns 0"})))
    with pytest.raises(ValueError, match="holds no true runs"):
        TrueRuns.load(path)
    # A pickle inside is not loaded: numpy refuses it, and so do we.
    np.savez(path, document=np.array([{"format": "TrueRuns 1"}], dtype=object))
    with pytest.raises(ValueError, match="holds no true runs"):
        TrueRuns.load(path)


def test_a_file_is_whole_or_not_there(tmp_path):
    path = tmp_path / "file"
    path.write_text("before", encoding="utf-8")

    def fail(stream):
        stream.write(b"half of the con")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        writeWhole(path, fail)
    assert path.read_text(encoding="utf-8") == "before"
    assert [entry.name for entry in tmp_path.iterdir()] == ["file"]
    seen = []

    def look(stream):
        stream.write(b"after")
        seen.extend(entry.name for entry in tmp_path.iterdir() if entry.name.startswith(TEMPORARY))

    writeWhole(path, look)
    assert len(seen) == 1
    assert path.read_text(encoding="utf-8") == "after"


def test_stored_objects_of_python_are_refused_before_they_are_loaded(tmp_path):
    """OpenTURNS stores them as pickles: loading one could run any program."""
    text = toXML(ot.Function(ot.PythonFunction(1, 1, lambda x: x)))
    with pytest.raises(ValueError, match="holds a PythonEvaluation, a pickle that can execute anything"):
        fromXML(text, ot.Function())
    # In another writing of the same name, too.
    with pytest.raises(ValueError, match="PythonEvaluation"):
        fromXML(text.replace('"PythonEvaluation"', '"&#80;ythonEvaluation"'), ot.Function())
    with pytest.raises(ValueError, match="no XML"):
        fromXML("<openturns-study>", ot.Function())
    path = tmp_path / "result.npz"
    result_of("x0 + x1 + x2", 4.0).save(path)
    with np.load(path, allow_pickle=False) as archive:
        arrays = dict(archive)
    document = json.loads(str(arrays["document"]))
    document["distribution"] = text
    np.savez(path, **{**arrays, "document": np.array(json.dumps(document))})
    with pytest.raises(ValueError, match="a pickle that can execute anything"):
        ActiveSubspaceReliabilityResult.load(path)


def test_a_function_in_python_is_not_pickled_only_to_be_left_out(tmp_path):
    """It may refer to anything, of any size."""

    class Heavy:
        pickled = 0

        def __reduce__(self):
            Heavy.pickled += 1
            return int, ()

    heavy = Heavy()
    function = ot.PythonFunction(2, 1, lambda x: [x[0] + (0.5 if heavy else 0.0) * x[1]])
    vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(2)))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 3.0))
    ot.RandomGenerator.SetSeed(0)
    algorithm.run()
    result, before = algorithm.getResult(), Heavy.pickled
    result.save(tmp_path / "result.npz")
    assert Heavy.pickled == before
    again = ActiveSubspaceReliabilityResult.load(tmp_path / "result.npz")
    assert again.getTrueRuns().computeProbability() == result.getTrueRuns().computeProbability()
