"""The true runs that a study keeps: made again they give the same, and the estimates follow from them."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import openturns as ot
import pytest
from small_cases import LINEAR, MASS_AND_RATE, ROLLING, SMALL

from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.model.case import SYSTEM, parse_case
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.drivers import scaled_case
from satsep_ot.studies.results_directory import DirectoryError
from satsep_ot.studies.sample import BLOCK
from satsep_ot.studies.separation_study import SeparationStudy
from satsep_ot.studies.study_runs import list_runs, load_runs
from satsep_ot.studies.telling.results import HalvedTolerance
from satsep_ot.studies.telling.tables import tightened_lines

CASE = f"""name = "small"
{SMALL}{MASS_AND_RATE}[[correlation]]
inputs = ["mass", "rate_y"]
coefficient = 0.3
{ROLLING}"""
SIZE = 2 * BLOCK + 100


def problem():
    return SeparationProblem(parse_case(CASE))


@pytest.fixture(scope="module")
def directory(tmp_path_factory):
    path = tmp_path_factory.mktemp("study") / "results"
    methods = ["ActiveSubspace", "FORM", "SubsetSampling", "MonteCarlo"]
    study = SeparationStudy(problem(), methods, 3, SIZE, 30, toleranceSize=1)
    study.setDirectory(path, command="satsep-ot study small.toml")
    study.run()
    study.save()
    study.close()
    return path


@pytest.fixture(scope="module")
def results(directory):
    return json.loads((directory / "results.json").read_text(encoding="utf-8"))


def row(results, requirement, method):
    return next(one for one in results["rows"] if (one["requirement"], one["method"]) == (requirement, method))


def test_every_true_run_is_there(directory, results):
    methods = ("ActiveSubspace", "FORM", "SubsetSampling")
    names = {f"{requirement}--{method}" for requirement in ("rolling", "any-requirement") for method in methods}
    assert set(list_runs(directory)) == names | {"sample", "gradients", "rolling--half--rate_y"}
    for requirement, stem in (("rolling", "rolling"), (SYSTEM, "any-requirement")):
        for method in methods:
            kept, counted = len(load_runs(directory, f"{stem}--{method}")), row(results, requirement, method)
            # One run that only compares the components with the event is no part of the estimate.
            assert 0 <= counted["evaluations"] - kept <= (method == "ActiveSubspace")
    assert len(load_runs(directory, "sample")) == SIZE
    assert len(load_runs(directory, "gradients")) == 30


@pytest.mark.parametrize(
    ("name", "case", "of_any"),
    [
        ("sample", parse_case(CASE), False),
        ("gradients", parse_case(CASE), False),
        ("rolling--ActiveSubspace", parse_case(CASE), False),
        ("rolling--half--rate_y", scaled_case(parse_case(CASE), "rate_y", 0.5), False),
        ("rolling--SubsetSampling", parse_case(CASE), True),
    ],
)
def test_runs_that_are_made_again_give_the_same_bits(directory, name, case, of_any):
    runs = load_runs(directory, name)
    rows = np.linspace(0, len(runs) - 1, 50).astype(int)
    again = SeparationProblem(case)
    function = again.getEvent("rolling").getFunction() if of_any else again.getFunction()
    labels = list(function.getOutputDescription())
    columns = [labels.index(label) for label in runs.outputNames]
    assert list(function.getInputDescription()) == list(runs.inputNames)
    assert np.array_equal(np.array(function(ot.Sample(runs.inputs[rows])))[:, columns], runs.outputs[rows])
    assert runs.getInputSample().getDescription()[0] == "mass [kg]"
    assert runs.getOutputSample()[int(rows[1]), 0] == runs.outputs[rows[1], 0]


def test_the_estimates_follow_from_the_weights(directory, results):
    ours = load_runs(directory, "rolling--ActiveSubspace")
    assert ours.computeProbability() == pytest.approx(row(results, "rolling", "ActiveSubspace")["probability"], 1e-12)
    assert np.array_equal(ours.failed, np.abs(ours.outputs[:, 0]) > 1.0)
    halved = load_runs(directory, "rolling--half--rate_y")
    assert halved.computeProbability() == pytest.approx(results["tightened"]["rolling"][0]["probability"], rel=1e-12)
    assert results["tightened"]["rolling"][0]["note"].startswith(
        "the target coefficient of variation, 0.1, was reached"
    )
    sample = load_runs(directory, "sample")
    assert sample.computeProbability() == row(results, SYSTEM, "MonteCarlo")["probability"] > 0.0
    spin = sample.outputs[:, sample.outputNames.index("spin [deg/s]")]
    assert sample.computeProbability(spin > 1.0) == row(results, "rolling", "MonteCarlo")["probability"]
    subset = load_runs(directory, "any-requirement--SubsetSampling")
    # The margin is 1 at the nominal run, whose spin is 0, and 0 at the limit.
    assert np.array_equal(subset.failed, subset.outputs[:, 0] < 0.0)
    with pytest.raises(ValueError, match="has a weight"):
        subset.computeProbability()


def test_some_of_the_runs_are_the_first_ones(directory):
    whole = load_runs(directory, "sample")
    for size in (1, BLOCK, BLOCK + 1, SIZE, SIZE + 1):
        part = load_runs(directory, "sample", size)
        assert len(part) == min(size, SIZE)
        assert np.array_equal(part.inputs, whole.inputs[:size])
        assert np.array_equal(part.outputs, whole.outputs[:size])
    part, whole = load_runs(directory, "rolling--FORM", 2), load_runs(directory, "rolling--FORM")
    assert np.array_equal(part.inputs, whole.inputs[:2])


def test_whole_results_are_kept_too(directory, results):
    path = directory / "steps" / "rolling--ActiveSubspace.npz"
    result = ActiveSubspaceReliabilityResult.load(path, problem().getEvent("rolling"))
    assert result.getProbabilityEstimate() == row(results, "rolling", "ActiveSubspace")["probability"]


def test_the_directory_says_what_it_is(directory, results):
    origin = json.loads((directory / "origin.json").read_text(encoding="utf-8"))
    assert origin["kind"] == "study"
    assert "numpy" in origin["about"].pop("processor")
    assert origin["about"] == {"case": "small", "command": "satsep-ot study small.toml"}
    assert origin["identity"]["seed"] == results["seed"] == 3
    assert origin["identity"]["versions"].items() <= results["versions"].items()
    assert (directory / "case.toml").read_text(encoding="utf-8") == CASE


def test_what_is_not_there_is_refused(directory, tmp_path):
    with pytest.raises(ValueError, match="is not the directory of a study"):
        list_runs(tmp_path)
    with pytest.raises(ValueError, match=r"there are no runs called 'spin'.*; there are .*gradients"):
        load_runs(directory, "spin")


def test_inputs_that_cannot_be_drawn_again_are_not_made_up(directory, tmp_path):
    (tmp_path / "runs").mkdir()
    (tmp_path / "steps").mkdir()
    for name in ("origin.json", "runs/sample.npy", "steps/sample.json"):
        (tmp_path / name).write_bytes((directory / name).read_bytes())
    assert len(load_runs(tmp_path, "sample")) == SIZE
    path = tmp_path / "steps" / "sample.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    content["result"]["seed"] += 1
    path.write_text(json.dumps(content), encoding="utf-8")
    with pytest.raises(ValueError, match="cannot be drawn again here"):
        load_runs(tmp_path, "sample")
    path.write_text('{"result": {}}', encoding="utf-8")
    with pytest.raises(ValueError, match=r"sample.json cannot be read"):
        load_runs(tmp_path, "sample")


def test_the_sample_of_version_0_1_0_is_loaded(directory, tmp_path):
    shutil.copytree(directory, tmp_path / "old")
    path = tmp_path / "old" / "steps" / "sample.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    result = content["result"]
    result["first block"] = result.pop("first_block")
    result["limits"] = {"rolling": ["spin", True, 1.0]}
    path.write_text(json.dumps(content), encoding="utf-8")
    old, new = load_runs(tmp_path / "old", "sample"), load_runs(directory, "sample")
    assert np.array_equal(old.failed, new.failed)
    assert old.failed.any()


def test_another_case_is_refused_and_the_same_in_other_words_continued(directory):
    def study(text, seed=3):
        methods = ["ActiveSubspace", "FORM", "SubsetSampling", "MonteCarlo"]
        return SeparationStudy(SeparationProblem(parse_case(text)), methods, seed, SIZE, 30, toleranceSize=1)

    for text in (CASE.replace("0.03 }", "0.031 }"), CASE.replace("= 0.3\n", "= 0.31\n"), CASE.replace("1.0", "1.1")):
        assert text != CASE
        with pytest.raises(DirectoryError, match="holds another study, of another case"):
            study(text).setDirectory(directory, resume=True)
    with pytest.raises(DirectoryError, match="with seed = 3 instead of 4"):
        study(CASE, 4).setDirectory(directory, resume=True)
    with pytest.raises(DirectoryError, match="holds this study already"):
        study(CASE).saveRows(directory)
    again = study("# The same.\n" + CASE)
    again.setDirectory(directory, resume=True)
    again._runSample = again._keepMade = None
    again.run()
    assert len(again.getResult().rows) == 8
    again.close()


def test_a_sample_that_is_too_large_to_be_kept_gives_the_same(monkeypatch, tmp_path):
    whole = SeparationStudy(problem(), ["MonteCarlo"], 3, SIZE)
    whole.computeSample()
    monkeypatch.setattr("satsep_ot.studies.sample.LARGEST_FILE", SIZE - 1)
    part = SeparationStudy(problem(), ["MonteCarlo"], 3, SIZE)
    part.setDirectory(tmp_path)
    part.computeSample()
    part.close()
    assert list_runs(tmp_path) == []
    assert np.array_equal(part._sample, whole._sample)
    # The XML of the distribution numbers its parts as the process has come to them.
    ignored = {"seconds": 0.0, "distribution": ""}
    assert dataclasses.replace(part._summary, **ignored) == dataclasses.replace(whole._summary, **ignored)


def test_a_study_is_saved_where_it_was_told(tmp_path):
    study = SeparationStudy(problem(), ["MonteCarlo"], 3, SIZE)
    study.computeSample()
    with pytest.raises(ValueError, match="there is no directory to write to"):
        study.saveRows()
    first, second = study.saveRows(tmp_path / "first"), study.saveRows(tmp_path / "second")
    assert first.parent != second.parent
    assert first.read_bytes() == second.read_bytes()
    study.close()


def test_a_halved_tolerance_that_fails_leaves_the_rest_as_it_is(tmp_path, monkeypatch):
    def fail(*arguments):
        raise RuntimeError("mass = -1\nTraceback (most recent call last):\n  File\nValueError: mass = -1")

    def small():
        return SeparationStudy(problem(), ["ActiveSubspace", "MonteCarlo"], 3, 1000, 30, toleranceSize=1)

    monkeypatch.setattr("satsep_ot.studies.drivers.changed_probability", fail)
    study = small()
    study.setDirectory(tmp_path / "results")
    study.run()
    paths = study.save()
    study.close()
    result = study.getResult()
    assert result.tightened["rolling"] == (HalvedTolerance("rate_y", 0.5, note="RuntimeError: mass = -1"),)
    page = paths[-1].read_text(encoding="utf-8")
    assert "half the scatter of rate y: <strong>not converged</strong>: RuntimeError: mass = -1" in page
    assert "the estimate failed" in page
    assert "<strong>rolling</strong>: tighten" not in page
    assert list(tightened_lines(result)) == [
        "rolling with half the scatter of rate_y: the estimate failed: RuntimeError: mass = -1"
    ]
    # It counts as finished.
    monkeypatch.undo()
    again = small()
    again.setDirectory(tmp_path / "results", resume=True)
    again.run()
    again.close()
    assert again.getResult().tightened == result.tightened


def test_an_interrupt_of_a_halved_tolerance_is_one(monkeypatch):
    def interrupt(*arguments):
        raise RuntimeError("InternalException : KeyboardInterrupt")

    monkeypatch.setattr("satsep_ot.studies.drivers.changed_probability", interrupt)
    with pytest.raises(KeyboardInterrupt):
        SeparationStudy(problem(), ["ActiveSubspace"])._steps.halve("rolling", "rate_y")


def test_overwrite_leaves_what_others_have_put_into_the_folders_of_a_study(directory, tmp_path):
    copy = tmp_path / "results"
    shutil.copytree(directory, copy)
    own = {path.relative_to(copy) for path in copy.rglob("*") if path.is_file()}
    assert {str(path.parent) for path in own} == {".", "figures", "runs", "steps"}
    names = ("notes.txt", "mine.png", "kept/one.svg", "kept/sample.npy", "kept/spin.json", "kept/spin.npz")
    foreign = {Path(folder, name) for folder in ("figures", "runs", "steps") for name in names}
    for name in foreign:
        (copy / name).parent.mkdir(exist_ok=True)
        (copy / name).write_text("mine", encoding="utf-8")
    study = SeparationStudy(problem(), ["FORM"], 4, 100, 30, toleranceSize=0)
    study.setDirectory(copy, overwrite=True)
    left = {path.relative_to(copy) for path in copy.rglob("*") if path.is_file()}
    assert left == foreign | {Path("origin.json"), Path("manifest.json"), Path("case.toml")}
    assert {(copy / name).read_text(encoding="utf-8") for name in foreign} == {"mine"}
    study.close()


def test_a_study_can_be_told_the_same_directory_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study = SeparationStudy(problem(), ["FORM"], 3, 100, 30, toleranceSize=0)
    study.setDirectory(tmp_path / "results")
    study.setDirectory(tmp_path / "results", resume=True)
    study.run()
    assert study.save("results")[-1].samefile("results/report.html")
    # Where another one is refused, this one is still its own.
    (tmp_path / "foreign").mkdir()
    (tmp_path / "foreign" / "notes.txt").write_text("mine", encoding="utf-8")
    with pytest.raises(DirectoryError, match="holds other files"):
        study.save("foreign")
    other = SeparationStudy(problem(), ["FORM"], 3, 100, 30, toleranceSize=0)
    with pytest.raises(DirectoryError, match="another process is at work"):
        other.setDirectory("results", resume=True)
    study.save("elsewhere")
    other.setDirectory("results", resume=True)
    other.close()
    study.close()


def test_the_precision_that_is_asked_for_is_reached():
    study = SeparationStudy(SeparationProblem("reference"), targetCoefficientOfVariation=0.035)
    row = study._steps.estimate("lateral rate", "ActiveSubspace").value
    assert row.converged
    assert 0.02 < row.coefficient_of_variation <= 0.035
    with pytest.raises(ValueError, match=r"targetCoefficientOfVariation = 0\.001; it must be between 0\.01 and 0\.5"):
        SeparationStudy(problem(), targetCoefficientOfVariation=0.001)


def test_a_table_with_the_name_of_the_case_is_refused(tmp_path):
    (tmp_path / "case.toml").write_text("stroke_mm,force_N\n0,2\n10,1\n", encoding="utf-8")
    text = CASE.replace(LINEAR, 'table = "case.toml"\n')
    study = SeparationStudy(SeparationProblem(parse_case(text, str(tmp_path / "mine.toml"))), ["MonteCarlo"], 3, SIZE)
    with pytest.raises(DirectoryError, match=r"is called case.toml, .* rename it"):
        study.setDirectory(tmp_path / "results")
