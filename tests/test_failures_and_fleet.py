"""Parts that fail with a probability, and fleets with shared inputs, against missions simulated one by one."""

import json

import numpy as np
import openturns as ot
import pytest
from brute_force import fleets_with_a_violation, violations_with_failures
from scipy import stats
from small_cases import BODIES, LINEAR, MASS_AND_RATE, ROLLING

from satsep_ot import cli
from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.model.case import SYSTEM, CaseError, load_case, parse_case
from satsep_ot.model.failures import failed_separation
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.failure_mixture import failure_mixtures, mode_weights
from satsep_ot.studies.fleet import fleet_estimate
from satsep_ot.studies.separation_study import SeparationStudy
from satsep_ot.studies.telling.document import read_results
from satsep_ot.studies.telling.failure_mixture import FailureMixture, FailureMode, mixture_lines
from satsep_ot.studies.telling.verdicts import Status, judge_all

LATERAL = """[[requirements]]
name = "lateral"
quantity = "lateral_rate"
maximum = 1.0
allowed_probability = 0.05
"""
FAILING = f"{BODIES}{LINEAR}failure_probability = [0.03, 0.01]\n{MASS_AND_RATE}{ROLLING}{LATERAL}"


def fleet_text(size=5, shared="mass", extra=""):
    inputs = f"""[inputs]
mass = {{ quantity = "satellite.mass", sigma = 0.03{", shared = true" if shared == "mass" else ""} }}
rate_y = {{ quantity = "initial.rates.y", sigma = 0.4{", shared = true" if shared == "rate" else ""} }}
cant = {{ quantity = "springs.cant.each", sigma = 0.05 }}
"""
    return f"fleet = {size}\n{BODIES}{LINEAR}{inputs}{ROLLING}{extra}"


def known_by_sample(case, size=60_000):
    """The probabilities of one satellite by crude Monte Carlo, and the runs that violate each requirement."""
    study = SeparationStudy(SeparationProblem(case), ["MonteCarlo"], 3, size, 10, toleranceSize=0)
    study.computeSample()
    study.compareMethods()
    return study


def test_weights_of_the_modes_sum_to_1():
    failures = parse_case(FAILING).failures
    assert [failure.part for failure in failures] == ["spring 1", "spring 2"]
    weights, omitted = mode_weights(failures)
    assert weights == pytest.approx([0.97 * 0.99, 0.03 * 0.99, 0.97 * 0.01])
    assert omitted == pytest.approx(0.03 * 0.01)


def test_failures_agree_with_missions_simulated_one_by_one():
    case = parse_case(FAILING)
    study = known_by_sample(case)
    study.computeFailures()
    mixtures = study.getResult().failures
    ot.RandomGenerator.SetSeed(5)
    counts = violations_with_failures(case, 20_000)
    for name, count in zip(["rolling", "lateral", SYSTEM], counts, strict=True):
        mixture, (lower, upper) = mixtures[name], clopperPearson(int(count), 20_000)
        assert mixture.lower95 <= upper
        assert lower <= mixture.upper95
        assert [mode.failed for mode in mixture.modes] == ["all parts in order", "spring 1", "spring 2"]
    # One of two springs pushes alone: the satellite tumbles in every run.
    assert mixtures["lateral"].modes[1].probability == 1.0
    assert mixtures["lateral"].modes[0].probability == 0.0
    assert mixtures["lateral"].probability == pytest.approx(0.03 * 0.99 + 0.97 * 0.01, rel=1e-3)
    verdict = judge_all(study.getResult())[1]
    assert verdict.status is Status.MET
    assert "The sum decides." in verdict.sentence


def test_a_sum_that_is_above_the_allowed_probability_is_not_met():
    modes = (FailureMode("all parts in order", 0.99, 1e-4, 0.9e-4, 1.1e-4), FailureMode("x", 0.01, 0.5, 0.4, 0.6, 9, 4))
    mixture = FailureMixture.of(modes, 1e-5)
    assert mixture.probability == pytest.approx(0.99e-4 + 5e-3)
    # The error of the second part, and the omitted failures above.
    assert mixture.lower95 == pytest.approx(mixture.probability - np.hypot(0.99e-5, 1e-3))
    assert mixture.upper95 == pytest.approx(mixture.probability + np.hypot(0.99e-5, 1e-3) + 1e-5)
    assert list(mixture_lines({"spin": mixture}))[1] == ("  x has failed (0.01): 0.5 (0.4 to 0.6, 9 runs), adds 5e-3")


def test_connectors_and_bolts_fail_too(tmp_path, capsys):
    text = load_case("reference").text
    umbilical = """
[umbilical]
angle = 30.0
radius = 250.0
stiffness = 2000.0
deformation = 8.0
stroke = 6.0
friction = 15.0
engagement = 5.0
failure_probability = 1e-3
[[hold_down]]
angle = 0.0
radius = 300.0
release = 1.0
failure_probability = 2e-3
failed_release = 20.0
points = 2
arc = 10.0
[[hold_down]]
angle = 90.0
radius = 300.0
release = 1.0
failure_probability = 3e-3
failed_release = 30.0
"""
    case = parse_case(text.replace("[envelope] ", f"{umbilical}\n[envelope] ", 1))
    assert [(failure.part, failure.probability) for failure in case.failures] == [
        ("umbilical connector 1", 1e-3), ("hold-down 1", 2e-3), ("hold-down 2", 3e-3),
    ]  # fmt: skip
    path = tmp_path / "case.toml"
    path.write_text(case.text, encoding="utf-8")
    assert cli.main(["check", str(path)]) == 0
    assert "hold-down 1 fails with a probability of 0.002" in capsys.readouterr().out
    assert failed_separation(case.separation, case.failures[0]).springs.scale.tolist() == [1, 1, 1, 1, 0, 15]
    assert failed_separation(case.separation, case.failures[1]).hold_downs.release.tolist() == [0.02, 0.02, 0.001]
    assert failed_separation(case.separation, case.failures[2]).hold_downs.release.tolist() == [0.001, 0.001, 0.03]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("[0.03, 0.01]", "1.5", "failure_probability = 1.5, but it must be a number from 0 to 1"),
        ("[0.03, 0.01]", "[0.1, -0.1]", "failure_probability = [0.1, -0.1], but it must be"),
        ("[0.03, 0.01]", "0.1\nfailed = [2]", "of spring 2 is 0.1, but it has failed already"),
        ("[platform]", "fleet = 0\n[platform]", "fleet = 0, but it must be a whole number from 1 to 10000"),
        ("sigma = 0.03", "sigma = 0.03, shared = true", "inputs.mass is shared, but by no other satellite"),
        ("sigma = 0.03", "sigma = 0.03, shared = 1", "shared = 1, but it must be true or false"),
    ],
)
def test_what_is_wrong_is_one_sentence(old, new, words):
    with pytest.raises(CaseError) as caught:
        parse_case(FAILING.replace(old, new, 1))
    assert words in str(caught.value)


def test_shared_and_own_inputs_may_not_be_correlated():
    text = fleet_text() + '[[correlation]]\ninputs = ["mass", "rate_y"]\ncoefficient = 0.5\n'
    with pytest.raises(CaseError, match="mass and rate_y are correlated, but only one of them is shared"):
        parse_case(text)


@pytest.mark.parametrize("shared", ["mass", "rate"])
def test_a_fleet_agrees_with_missions_simulated_one_by_one(shared):
    """The rate decides almost alone: satellites that share it violate together, others apart."""
    case = parse_case(fleet_text(shared=shared))
    study = known_by_sample(case)
    study.computeFleet()
    estimate = study.getResult().fleet["rolling"]
    ot.RandomGenerator.SetSeed(6)
    count = int(fleets_with_a_violation(case, 10_000)[0])
    lower, upper = clopperPearson(count, 10_000)
    assert estimate.lower95 <= upper
    assert lower <= estimate.upper95
    if shared == "mass":
        assert estimate.probability == pytest.approx(estimate.independent, rel=0.02)
    else:
        assert estimate.single < estimate.probability < 0.8 * estimate.independent
    assert estimate.violating == pytest.approx(5.0 * estimate.single / estimate.probability, rel=1e-9)


def test_a_weighted_sample_gives_the_same_fleet():
    """Runs of a density around the limit, weighted, and crude ones: one answer, known in closed form."""
    case = parse_case(fleet_text(shared="rate").replace("sigma = 0.05", "sigma = 1e-6"))
    p = 2.0 * stats.norm.sf(2.5)
    random = np.random.default_rng(1)
    wide = random.normal(0.0, 1.2, 4000)
    rows = np.abs(wide) > 1.0
    inputs = np.column_stack([random.normal(1.0, 0.03, 4000), wide, random.normal(0.0, 1e-6, (4000, 2))])[rows]
    weights = (stats.norm.pdf(wide, 0.0, 0.4) / stats.norm.pdf(wide, 0.0, 1.2))[rows]
    estimate = fleet_estimate(case, "rolling", (p, 0.9 * p, 1.1 * p), inputs, weights)
    # All satellites have the same rate: the fleet fails as one.
    assert estimate.probability == pytest.approx(p, rel=1e-3)
    assert estimate.violating == pytest.approx(5.0, rel=1e-3)


def test_fleets_of_all_or_nothing_shared_are_closed_forms():
    apart = parse_case(fleet_text(shared=""))
    known, none = (1e-3, 0.8e-3, 1.3e-3), (np.empty((0, 4)), np.empty(0))
    estimate = fleet_estimate(apart, "rolling", known, *none)
    assert estimate.probability == pytest.approx(1.0 - (1.0 - 1e-3) ** 5)
    together = parse_case(fleet_text(shared="").replace("sigma", "shared = true, sigma"))
    assert fleet_estimate(together, "rolling", known, *none).probability == 1e-3
    # Nothing is known of the dependence where no run violates: the bounds hold for all of it.
    unknown = fleet_estimate(parse_case(fleet_text()), "rolling", (0.0, 0.0, 1e-5), *none)
    assert (unknown.probability, unknown.upper95) == (0.0, 5e-5)
    assert "no violation is known" in unknown.sentence


def test_the_command_tells_of_both(tmp_path, capsys):
    path = tmp_path / "case.toml"
    path.write_text(FAILING.replace("[platform]", "fleet = 3\n[platform]", 1), encoding="utf-8")
    options = ["--methods", "MonteCarlo", "--runs", "20000", "--tolerances", "0", "--output", str(tmp_path / "out")]
    assert cli.main(["study", str(path), *options]) == 0
    text = capsys.readouterr().out
    assert "spring 1 has failed (0.0297): 1 (" in text
    assert "any of 3 satellites: " in text
    assert "fleet of 3" not in text
    result = read_results(tmp_path / "out" / "results.json")
    assert set(result.failures) == set(result.fleet) == {"rolling", "lateral", SYSTEM}
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "With failures of parts" in page
    assert "All satellites of the fleet" in page
    # What is resumed is read again as it was.
    assert cli.main(["study", str(path), *options, "--resume", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    assert again["failures"]["lateral"]["modes"][1]["violations"] == result.failures["lateral"].modes[1].violations


def test_mixtures_of_what_is_known_alone():
    case = parse_case(FAILING)
    assert list(failure_mixtures(case, {"rolling": (0.01, 0.009, 0.011)})) == ["rolling"]
