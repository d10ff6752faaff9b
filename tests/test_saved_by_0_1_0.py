"""What version 0.1.0 saved is read by this one: results, true runs, and pickles that name its modules."""

import gzip
import importlib
import json
import lzma
import pickle
import shutil
import sys
from pathlib import Path

import numpy as np
import openturns as ot
import pytest

from satsep_ot import moved_modules
from satsep_ot.methods.comparison.benchmark import ReliabilityBenchmark
from satsep_ot.methods.comparison.problem import BenchmarkTask
from satsep_ot.methods.comparison.problems import getBenchmarkProblem
from satsep_ot.methods.comparison.simulations import MonteCarlo
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegressionResult
from satsep_ot.methods.reliability.outcome import Ending
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult
from satsep_ot.methods.subspaces.ridge_approximation import RidgeApproximationResult
from satsep_ot.model.separation_problem import SeparationProblem

SAVED = Path(__file__).parent / "data" / "saved_by_0_1_0"
RIDGE = ot.SymbolicFunction(["a", "b"], ["a + 0.2 * b + 0.05 * a^2"])


def hexadecimal(*numbers):
    return [float(number).hex() for number in numbers]


def bounds(result):
    interval = result.getConfidenceInterval(0.95)
    return hexadecimal(interval.getLowerBound()[0], interval.getUpperBound()[0])


def unpickled(name):
    """A pickle of 0.1.0, with the warnings that its old names give."""
    with pytest.warns(DeprecationWarning, match="will be removed in 0.3"):
        return pickle.loads(gzip.decompress((SAVED / f"{name}.pickle.gz").read_bytes()))


# Results. -------------------------------------------------------------------------------------------------------------


def test_a_probability_is_loaded_with_all_that_it_answers():
    result = ActiveSubspaceReliabilityResult.load(SAVED / "reliability_reached.npz")
    assert hexadecimal(result.getProbabilityEstimate()) == ["0x1.7eaed85e3f42bp-14"]
    assert bounds(result) == ["0x1.7a1ccd319ac7ap-14", "0x1.834f0829e88aep-14"]
    assert result.getPhases() == {"learning": 88, "estimation": 211}
    assert result.getConverged()
    assert result.getMethod() == "ActiveSubspace"
    assert result.getEnding() is Ending.TARGET_REACHED
    assert result.getUnseenBound() == result.getDiagnostics()["unseen bound"] == pytest.approx(3.0 / 29.1)
    assert result.getReason().startswith("the target coefficient of variation, 0.5, was reached; a failure region")
    assert result.computeImportance()[0].share == pytest.approx(0.99053, abs=1e-5)
    assert result.getMetaModelResult().getMetaModel()([0.1, 0.2])[0] == pytest.approx(
        RIDGE([0.1, 0.2])[0] - 0.386, abs=1
    )
    assert result.getTrueRuns().computeProbability() == pytest.approx(result.getProbabilityEstimate(), rel=1e-12)
    assert result.getEvent().getThreshold() == 4.5


@pytest.mark.parametrize(
    ("name", "method", "ending", "level", "limits"),
    [
        (
            "handed_over",
            "SubsetSimulation",
            Ending.NO_FAILURE_REGION,
            None,
            ["0x1.b136fb2980e24p-20", "0x1.68f6d06572760p-11"],
        ),
        ("no_failure", "MonteCarlo", Ending.NO_FAILURE_REGION, 1e-6, ["0x0.0p+0", "0x1.278ea5fe9584cp-4"]),
        ("stopped", "MonteCarlo", Ending.STOPPED, None, ["0x0.0p+0", "0x1.3fd7198b97222p-2"]),
    ],
)
def test_a_probability_is_loaded_however_its_run_ended(name, method, ending, level, limits, tmp_path):
    result = ActiveSubspaceReliabilityResult.load(SAVED / f"reliability_{name}.npz")
    assert result.getMethod() == method
    assert result.getEnding() is ending
    assert result.getLevelReached() == level
    assert result.getUnseenBound() is None
    assert not result.getConverged()
    assert bounds(result) == limits
    # Saved again it is a file of this version.
    result.save(tmp_path / "again.npz")
    again = ActiveSubspaceReliabilityResult.load(tmp_path / "again.npz")
    assert bounds(again) == limits
    assert again.getEnding() is ending
    assert again.getReason() == result.getReason()


def test_true_runs_are_loaded():
    runs = TrueRuns.load(SAVED / "true_runs.npz")
    assert runs.outputNames == ("sag [m]",)
    assert len(runs) == 170
    assert hexadecimal(runs.computeProbability(), runs.inputs.sum()) == [
        "0x1.5f14281fe55e8p-10",
        "0x1.d79a18eb1b407p+8",
    ]


def test_regression_subspace_and_ridge_are_loaded():
    point = [0.5, -0.5]
    regression = MultivariatePolynomialRegressionResult.load(SAVED / "regression.npz")
    ridge = RidgeApproximationResult.load(SAVED / "ridge.npz")
    subspace = ActiveSubspaceResult.load(SAVED / "subspace.npz")
    assert regression.getMetaModel()(point)[0] == pytest.approx(RIDGE(point)[0], rel=1e-12)
    assert ridge.getMetaModel()(point)[0] == pytest.approx(float.fromhex("0x1.a581cd227e20dp-2"), rel=1e-12)
    assert hexadecimal(*subspace.getEigenvalues()) == ["0x1.16868522fbaedp+0", "0x1.c92af210c378bp-12"]


def test_a_benchmark_goes_on_from_its_file(tmp_path):
    path = Path(shutil.copy(SAVED / "benchmark.jsonl", tmp_path))
    before = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    benchmark = ReliabilityBenchmark(
        [BenchmarkTask.of(getBenchmarkProblem("RP22"))], [MonteCarlo(size=1000)], repetitions=2
    )
    benchmark.setFile(path)
    benchmark.run()
    row = benchmark.getResult().getRows()[0]
    assert row.repetitions == 2
    # Both seeds were there, each before one of FORM: nothing was made again.
    assert row.seconds == pytest.approx(np.mean([entry["row"]["seconds"] for entry in before[::2]]))
    assert len(path.read_text(encoding="utf-8").splitlines()) == len(before)


# Pickles. -------------------------------------------------------------------------------------------------------------


def test_pickled_results_answer_as_before():
    assert unpickled("true_runs").computeProbability() == float.fromhex("0x1.5f14281fe55e8p-10")
    probability = unpickled("reliability")
    assert hexadecimal(probability.getProbabilityEstimate()) == ["0x1.5f14281fe55e8p-10"]
    assert probability.getEnding() is Ending.EVALUATIONS_USED
    assert probability.computeImportance()[0].input == "a"
    assert probability.drawLimitState().getDrawables().getSize() == 3
    assert unpickled("regression").getMetaModel()([0.5, -0.5])[0] == pytest.approx(RIDGE([0.5, -0.5])[0], rel=1e-12)
    assert unpickled("ridge").getMetaModel()([0.5, -0.5])[0] == pytest.approx(0.4116279, rel=1e-6)
    assert hexadecimal(*unpickled("subspace").getEigenvalues()) == ["0x1.16868522fbaedp+0", "0x1.c92af210c378bp-12"]
    comparison = unpickled("comparison")
    assert comparison.getRow("MonteCarlo").probability == 0.036
    assert "36 failures" in comparison.toText()
    benchmark = unpickled("benchmark")
    assert [row.verdict for row in benchmark.getRows()] == ["open", "wrong"]
    assert "RP22" in benchmark.toText()


def check_functions(parallel, separation):
    np.testing.assert_array_equal(parallel([[1.0, 2.0], [0.0, 1.0]]), RIDGE([[1.0, 2.0], [0.0, 1.0]]))
    values = np.array(separation(SeparationProblem("reference").getDistribution().getMean()))
    # Velocity [m/s], release time [s] and clearance [mm] of the nominal run.
    expected = [
        float.fromhex(text) for text in ("0x1.3221a4310f81cp-1", "0x1.61d10ff9da168p-4", "0x1.90676fc483c17p+4")
    ]
    np.testing.assert_allclose(values[[0, 8, 9]], expected, rtol=1e-9)


def test_pickled_functions_are_evaluated():
    with gzip.open(SAVED / "separation_function.pickle.gz") as stream:
        separation = pickle.load(stream)
    check_functions(ot.Function(unpickled("parallel_function")), ot.Function(separation))


def test_functions_in_an_openturns_study_are_evaluated(tmp_path):
    path = tmp_path / "study.xml"
    path.write_bytes(lzma.decompress((SAVED / "functions.xml.xz").read_bytes()))
    study = ot.Study()
    study.setStorageManager(ot.XMLStorageManager(str(path)))
    with pytest.warns(DeprecationWarning, match="will be removed in 0.3"):
        study.load()
    functions = [ot.Function(), ot.Function()]
    for name, function in zip(("parallel", "separation"), functions, strict=True):
        study.fillObject(name, function)
    check_functions(*functions)


def test_a_result_of_another_version_is_refused_with_a_sentence(tmp_path):
    path = tmp_path / "result.npz"
    with np.load(SAVED / "reliability_stopped.npz", allow_pickle=False) as archive:
        arrays = dict(archive)
    document = json.loads(str(arrays.pop("document")))
    document["format"] = "ActiveSubspaceReliabilityResult 2"
    np.savez(path, document=np.array(json.dumps(document)), **arrays)
    with pytest.raises(ValueError, match=r"result\.npz holds no ActiveSubspaceReliabilityResult of this version"):
        ActiveSubspaceReliabilityResult.load(path)


# Old names of modules. ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("old", sorted(moved_modules.MOVED))
def test_every_old_name_leads_to_modules_that_exist(old):
    for home in moved_modules.MOVED[old]:
        assert importlib.import_module(f"satsep_ot.{home}")
    module = importlib.import_module(f"satsep_ot.{old}")
    with pytest.raises(AttributeError, match=rf"module 'satsep_ot.{old}' has no attribute 'Rocket'"):
        module.Rocket  # noqa: B018


def test_names_are_imported_from_where_they_were_with_a_warning():
    with pytest.warns(DeprecationWarning, match=r"use satsep_ot\.methods\.common\.intervals\.clopperPearson"):
        from satsep_ot.methods.reliability_result import clopperPearson
    assert clopperPearson(0, 10)[0] == 0.0
    # Packages of today that were modules.
    with pytest.warns(DeprecationWarning, match=r"use satsep_ot\.methods\.reliability\.algorithm\."):
        from satsep_ot.methods.reliability import ActiveSubspaceReliability
    with pytest.warns(DeprecationWarning, match=r"use satsep_ot\.methods\.comparison\."):
        from satsep_ot.methods.comparison import ReliabilityComparison
    assert ActiveSubspaceReliability.__name__ + ReliabilityComparison.__name__


def test_no_other_name_is_found():
    with pytest.raises(ModuleNotFoundError, match=r"satsep_ot\.methods\.rocket"):
        importlib.import_module("satsep_ot.methods.rocket")
    moved_modules.install()
    finders = [one for one in sys.meta_path if type(one).__module__ == moved_modules.__name__]
    assert len(finders) == 1
    assert finders[0].find_spec("methods.true_runs", None) is None
