"""Limits on both sides, on absolute values, and on what the platform and the free flight are like."""

import dataclasses
import json

import numpy as np
import openturns as ot
import pytest
from small_cases import MASS_AND_RATE, SMALL

from satsep_ot.dynamics.free_flight import rotation_vector, turned
from satsep_ot.dynamics.quantities import coast_quantities
from satsep_ot.dynamics.rotations import quaternion_product
from satsep_ot.dynamics.separation import Body
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients, trajectory
from satsep_ot.model.case import CaseError, load_case, parse_case
from satsep_ot.model.check_document import check_case, check_document
from satsep_ot.model.requirement import Requirement
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.separation_study import SeparationStudy
from satsep_ot.studies.telling.figures import draw_density
from satsep_ot.studies.telling.results import RequirementEntry

COASTING = load_case("reference").text.replace("[springs]", "[coast]\ntimes = [40.0, 10.0]\n[springs]", 1)


def case_with(requirement):
    return parse_case(f"{SMALL}{MASS_AND_RATE}[[requirements]]\n{requirement}")


@pytest.mark.parametrize(
    ("keys", "text", "met", "violated", "words"),
    [
        ("between = [-0.5, 1.0]", "-0.5 <= rate_y <= 1", (-0.5, 0.0, 1.0), (-0.51, 1.01),
         "rate y between -0.5 and 1 deg/s"),
        ("maximum_absolute = 0.9", "|rate_y| <= 0.9", (-0.9, 0.3), (-1.0, 1.0),
         "absolute value of rate y at most 0.9 deg/s"),
        ("minimum_absolute = 0.9", "|rate_y| >= 0.9", (-0.9, 1.0), (-0.8, 0.0),
         "absolute value of rate y at least 0.9 deg/s"),
        ("maximum = 0.9", "rate_y <= 0.9", (-5.0, 0.9), (1.0,), "rate y at most 0.9 deg/s"),
    ],
)  # fmt: skip
def test_what_meets_a_limit_and_how_it_is_told(keys, text, met, violated, words):
    case = case_with(f'quantity = "rate_y"\n{keys}\n')
    entry = case.requirements[0]
    assert str(entry) == text
    assert all(entry.is_met(value) for value in met)
    assert not any(entry.is_met(value) for value in violated)
    assert RequirementEntry.of(entry, "deg/s").words == words
    key, value = keys.split(" = ")
    assert check_document(check_case(case))["requirements"][0][key] == pytest.approx(json.loads(value))


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ("between = [1.0, -1.0]", "between = [1.0, -1.0], but it must be two finite numbers in deg/s, the smaller"),
        ("maximum_absolute = -1.0", "maximum_absolute = -1.0, but it must be a finite, positive number in deg/s"),
        ("between = [-1.0, 1.0]\nmaximum = 2.0", "has more than one limit, but it must have exactly one of maximum, m"),
        ("allowed_probability = 0.1", "has no limit, but it must have exactly one of"),
    ],
)
def test_limits_that_are_none(keys, sentence):
    with pytest.raises(CaseError) as caught:
        case_with(f'quantity = "rate_y"\n{keys}\n')
    assert sentence in str(caught.value)


def test_every_way_to_a_probability_counts_both_sides():
    """The rate about y is Normal(0, 0.4) deg/s to rounding: P(|rate_y - 0.1| > 0.9) in closed form."""
    case = case_with('name = "rolling"\nquantity = "rate_y"\nbetween = [-0.8, 1.0]\n')
    problem = SeparationProblem(case)
    normal = ot.Normal(0.0, 0.4)
    truth = normal.computeCDF(-0.8) + normal.computeComplementaryCDF(1.0)
    ot.RandomGenerator.SetSeed(1)
    inputs = problem.getDistribution().getSample(20_000)
    rates = SeparationFunction(case, quantities=["rate_y"]).evaluate(inputs)[:, 0]
    outside = (rates < -0.8) | (rates > 1.0)
    for event in (problem.getEvent("rolling"), problem.getSystemEvent()):
        values = np.array(event.getFunction()(inputs[:500]))[:, 0]
        happens = [event.getOperator().compare(value, event.getThreshold()) for value in values]
        np.testing.assert_array_equal(happens, outside[:500])
    study = SeparationStudy(problem, ["ActiveSubspace", "MonteCarlo"], 2, 50_000, 20, toleranceSize=0)
    study.computeSample()
    study.compareMethods()
    for row in study.getResult().rows:
        assert row.lower95 <= truth <= row.upper95, row.method


def test_runs_that_count_as_violations_are_beyond_a_two_sided_limit():
    case = case_with('quantity = "rate_y"\nbetween = [-0.8, 1.0]\n')
    from satsep_ot.model.separation_function import violating_values

    assert not case.requirements[0].is_met(violating_values(case)["rate_y"])


def test_the_density_shows_both_ends():
    sample = np.random.default_rng(0).standard_normal(5000)
    ax = draw_density(sample, limit=(-2.0, 2.5))
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert "limit -2, 2.5" in labels
    share = np.mean((sample < -2.0) | (sample > 2.5))
    assert f"violated: {share:.2g}" in labels


def test_attitude_and_distance_at_a_time_are_those_of_the_motion():
    case = parse_case(COASTING)
    # Without gravity, and with a spin that makes the attitude at 40 s differ much from that at 10 s.
    separation = dataclasses.replace(case.separation, rates=np.radians([0.3, 5.0, -0.2]), orbit=None,
                                     gradient_torque=False, recontact=None)  # fmt: skip
    outcome = simulate(separation, tolerance=1e-12)
    released = float(np.nanmax(outcome.release_times))
    path = trajectory(separation, [0.0, released + 10.0, released + 40.0], tolerance=1e-12)
    for time, state in zip((10, 40), path.states[1:], strict=True):
        start = separation.attitude * [1.0, -1.0, -1.0, -1.0]
        turn = quaternion_product(start, quaternion_product(state[16:20], state[12:16]))
        expected = np.degrees(rotation_vector(turn[None])[0])
        found = [outcome.quantity(f"turn_{axis}_at_{time}_s")[0] for axis in "xyz"]
        np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
        assert outcome.quantity(f"attitude_error_at_{time}_s")[0] == pytest.approx(np.linalg.norm(expected), rel=1e-6)
        assert outcome.quantity(f"distance_at_{time}_s")[0] == pytest.approx(np.linalg.norm(state[:3]), rel=1e-8)


def test_a_symmetric_body_precesses_as_the_closed_form_says():
    """Its axis keeps its angle to the angular momentum and turns about it at |H| / I (Goldstein, section 5.6)."""
    inertia = np.diag([4.0, 2.0, 4.0])[None]
    rate = np.array([[0.1, 1.0, 0.0]])
    momentum = inertia[0] @ rate[0]
    after = turned(np.array([[1.0, 0.0, 0.0, 0.0]]), rate, inertia, 30.0)[0]
    axis = quaternion_product(quaternion_product(after, [0.0, 0.0, 1.0, 0.0]), after * [1.0, -1.0, -1.0, -1.0])[1:]
    h = momentum / np.linalg.norm(momentum)
    angle = 30.0 * np.linalg.norm(momentum) / 4.0
    start = np.array([0.0, 1.0, 0.0])
    expected = start * np.cos(angle) + np.cross(h, start) * np.sin(angle) + h * (h @ start) * (1.0 - np.cos(angle))
    np.testing.assert_allclose(axis, expected, atol=1e-7)


def test_the_new_quantities_of_a_known_motion():
    case = load_case("reference")
    separation = dataclasses.replace(case.separation, rates=np.radians([0.0, 30.0, 0.0]))
    outcome = simulate(separation, tolerance=1e-12)
    value = lambda name: outcome.quantity(name)[0]  # noqa: E731
    assert value("platform_rate") == pytest.approx(30.0, rel=1e-6)
    assert value("nutation_angle") == pytest.approx(0.0, abs=1e-6)
    assert value("half_cone_angle") == pytest.approx(0.0, abs=1e-6)
    speed = value("axial_velocity") * 100.0 / 1300.0
    assert value("platform_velocity_change") == pytest.approx(speed, rel=1e-9)
    # A satellite with its centre of mass aside is pushed aside too.
    aside = Body(100.0, case.separation.satellite.inertia, [0.02, 0.4, 0.01])
    outcome = simulate(dataclasses.replace(case.separation, satellite=aside), tolerance=1e-12)
    w = [outcome.base[0, outcome._columns[f"w_{axis}"]] for axis in "xyz"]
    assert value("half_cone_angle") == pytest.approx(np.degrees(np.arctan2(np.hypot(w[0], w[2]), w[1])), rel=1e-9)
    h = aside.inertia @ [outcome.base[0, outcome._columns[f"omega_2_{axis}"]] for axis in "xyz"]
    assert value("nutation_angle") == pytest.approx(np.degrees(np.arctan2(np.hypot(h[0], h[2]), abs(h[1]))), rel=1e-9)


def test_gradients_with_respect_to_the_inputs():
    case = parse_case(COASTING)
    names = [name for name in ("half_cone_angle", "nutation_angle", "platform_velocity_change", "platform_rate",
                               *coast_quantities(case.separation))]  # fmt: skip
    ot.RandomGenerator.SetSeed(3)
    x = np.array(SeparationProblem(case).getDistribution().getSample(1))
    function = SeparationFunction(case, quantities=names, tolerance=1e-11)
    gradients = function.computeGradientSample(x)[0]
    spread = np.array([row.distribution.getStandardDeviation()[0] for row in case.inputs])
    for column in (0, 1, 3, 8, 11, 14, 22, 29):
        step = 1e-3 * spread[column] * np.eye(len(spread))[column]
        upper, lower = function.evaluate(np.concatenate([x + step, x - step]))
        found, expected = spread[column] * gradients[column], (upper - lower) / 2e-3
        assert np.all(np.abs(found - expected) <= 2e-4 * np.abs(expected) + 1e-5 * np.abs(upper))


def test_times_that_are_not_allowed_and_a_time_that_is_not_asked_for():
    for times, words in (("[0.0]", "above 0 and at most 100"), ("[5.0, 5.0]", "different numbers"), ("3.0", "a list")):
        with pytest.raises(CaseError, match=words):
            parse_case(COASTING.replace("[40.0, 10.0]", times))
    text = COASTING + '\n[[requirements]]\nquantity = "distance_at_20_s"\nminimum = 5.0\n'
    with pytest.raises(CaseError, match=r"a time needs the table \[coast\]"):
        parse_case(text)
    entry = parse_case(text.replace("20_s", "10_s")).requirements[-1]
    assert entry == Requirement("distance_at_10_s", "distance_at_10_s", 5.0, False)
    assert simulate_with_gradients(parse_case(COASTING).separation, quantities=["distance_at_10_s"]).status[0] == 0
