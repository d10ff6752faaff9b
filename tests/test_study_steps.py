"""Steps of a study that are left out, ended at the verdict, or made side by side."""

import dataclasses

import pytest
from small_cases import MASS_AND_RATE, ROLLING, SMALL

from satsep_ot.model.case import parse_case
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.separation_study import SeparationStudy
from satsep_ot.studies.steps import Made, StudySteps, _sharper
from satsep_ot.studies.telling.document import results_document
from satsep_ot.studies.telling.results import Estimate
from satsep_ot.studies.telling.verdicts import Status, judge_all
from satsep_ot.studies.telling.words import StudyMethod

# The spin is normal with a standard deviation of 0.4 deg/s: 1 is at 2.5 of them, 10.8 at 27.
FAR = ROLLING.replace("rolling", "far").replace("1.0", "10.8")
CASE = f'name = "small"\n{SMALL}{MASS_AND_RATE}{ROLLING}allowed_probability = 0.1\n{FAR}allowed_probability = 1e-2\n'
SIZE = 20_000


def problem(text=CASE):
    return SeparationProblem(parse_case(text))


@pytest.fixture(scope="module")
def study():
    study = SeparationStudy(problem(), ["ActiveSubspace", "FORM", "MonteCarlo"], 3, SIZE, 30, toleranceSize=1)
    study.run()
    return study


def test_what_the_sample_decides_is_not_estimated_on(study):
    result = study.getResult()
    assert [row.method for row in result.rows_of("far")] == [StudyMethod.MONTE_CARLO]
    note = "0 violations: at most 1.5e-4 with 95 % confidence, less than a tenth of the allowed 0.01, which decides it"
    assert result.rows_of("far")[0].note.startswith(note)
    assert {verdict.requirement: verdict.status for verdict in judge_all(result)}["far"] is Status.MET
    # Neither drivers, nor halved tolerances, nor a most likely violation.
    for found in (result.drivers, result.tightened, result.violations):
        assert "far" not in found
    # Less than by a factor of ten is no reason to leave it at that.
    assert len(result.rows_of("rolling")) == 3
    assert "rolling" in result.tightened


def test_screening_can_be_switched_off():
    study = SeparationStudy(problem(), ["FORM", "MonteCarlo"], 3, SIZE, 0, 0, screening=False)
    study.run()
    assert len(study.getResult().rows_of("far")) == 2


def test_where_everything_is_decided_any_requirement_is_too():
    study = SeparationStudy(problem(CASE.replace(ROLLING + "allowed_probability = 0.1\n", "")), sampleSize=SIZE)
    study.run()
    assert [(row.requirement, row.method) for row in study.getResult().rows] == [
        ("far", StudyMethod.MONTE_CARLO),
        ("any requirement", StudyMethod.MONTE_CARLO),
    ]


def test_processes_change_no_number(tmp_path, study):
    other = SeparationStudy(problem(), ["ActiveSubspace", "FORM", "MonteCarlo"], 3, SIZE, 30, toleranceSize=1)
    other.setProcessNumber(2)
    other.setDirectory(tmp_path)
    other.run()
    paths = other.save()
    other.close()
    assert timeless(other) == timeless(study)
    assert list(other.getResult().diagnostics) == list(study.getResult().diagnostics) == ["rolling", "any requirement"]
    # The pictures, too, are the same.
    alone = study.save(tmp_path.parent / "alone")
    pictures = {path.name: path.read_bytes() for path in paths if path.suffix == ".svg"}
    assert pictures == {path.name: path.read_bytes() for path in alone if path.suffix == ".svg"}
    assert len(pictures) > 5
    study.close()
    with pytest.raises(ValueError, match="the number of processes is 0; it must be a whole number of at least 1"):
        other.setProcessNumber(0)


def timeless(study):
    document = results_document(study.getResult())
    return {
        **{key: value for key, value in document.items() if key not in ("finished", "rows")},
        "rows": [{**row, "seconds": 0.0} for row in document["rows"]],
    }


def test_runs_go_on_until_the_requirement_is_decided():
    # The probability is 0.0124: the first estimate, of at most 5 %, cannot tell it from 0.0115.
    steps = StudySteps(problem(CASE.replace("= 0.1\n", "= 0.0115\n")), 3, None)
    made = steps.estimate("rolling", StudyMethod.ACTIVE_SUBSPACE).value
    assert made.converged
    assert made.lower95 > 0.0115
    assert "further runs" in made.note or "the allowed one" in made.note
    # And end long before that where it is far from the limit.
    steps = StudySteps(problem(), 3, None, advises=False)
    assert steps.estimate("rolling", StudyMethod.ACTIVE_SUBSPACE).value.evaluations < made.evaluations


def test_an_estimate_that_has_not_converged_does_not_replace_one_that_has():
    row = Estimate("spin", StudyMethod.ACTIVE_SUBSPACE, 1e-3, 9e-4, 1.1e-3, 0.05, 1000, converged=True, note="first")
    made = [Made(row), Made(dataclasses.replace(row, evaluations=4000, converged=False, note="second"))]
    kept = _sharper(*made).value
    assert (kept.evaluations, kept.note) == (5000, "first; 4,000 further runs have not decided it")
    made[1] = Made(dataclasses.replace(made[1].value, converged=True))
    assert _sharper(*made).value.note == "second; 1,000 further runs came before it and left the verdict open"
