"""How large a tolerance may be, and which class of each to order: curves, pairs, classes with prices."""

import json

import openturns as ot
import pytest
from scipy import optimize, stats
from small_cases import BODIES, LINEAR

from satsep_ot import cli
from satsep_ot.methods.parallel.executors import processes
from satsep_ot.model.case import CaseError, parse_case
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.class_choice import class_choice
from satsep_ot.studies.quick_probability import quick_probability
from satsep_ot.studies.separation_study import SeparationStudy
from satsep_ot.studies.telling.document import read_results
from satsep_ot.studies.telling.tolerance_curves import CurvePoint, Curves
from satsep_ot.studies.tolerance_curves import requirement_curves


def case_with(first=0.4, second=0.4, allowed="1e-3", classes="", more=""):
    """Rates of 0.4 deg/s about y from two sources, of which the case file calls one a rate and the other an impulse.

    The satellite's moment of inertia is 0.01 kg m2 and the platform's 1 kg m2: an impulse of h gives h / 0.01 rad/s.
    """
    unit = 0.01 * 3.141592653589793 / 180.0
    return parse_case(
        f"{BODIES}{LINEAR}[inputs]\n"
        f'rate = {{ quantity = "initial.rates.y", sigma = {first}{classes} }}\n'
        f'kick = {{ quantity = "impulse.angular_momentum.y", sigma = {second * unit}{more} }}\n'
        f'mass = {{ quantity = "satellite.mass", sigma = 0.01 }}\n'
        f'[[requirements]]\nname = "rolling"\nquantity = "spin"\nmaximum = 1.0\nallowed_probability = {allowed}\n'
    )


def truth(first, second):
    """P(|rate + kick| > 1 deg/s) of two normal rates."""
    return 2.0 * stats.norm.sf(1.0 / (first**2 + second**2) ** 0.5)


def curves(case, result=None, makes_runs=True, spread=map):
    allowed = case.requirements[0].allowed_probability
    p = truth(0.4, 0.4)
    now = CurvePoint(1.0, p, 0.97 * p, 1.03 * p)
    return requirement_curves(case, "rolling", allowed, now, ["rate", "kick"], result, makes_runs, spread=spread)


def test_quick_probabilities_are_right_and_repeatable():
    case = case_with()
    for sizes in ((0.4, 0.4), (0.2, 0.2)):
        found = quick_probability(case_with(*sizes), "rolling", 3)
        assert found.lower95 <= truth(*sizes) <= found.upper95, sizes
    assert quick_probability(case, "rolling", 3) == quick_probability(case, "rolling", 3)


def test_a_violation_that_no_method_finds_is_bounded_below_the_allowed_probability():
    case = case_with(0.01, 0.01, allowed="2e-4")
    found = quick_probability(case, "rolling", 3)
    assert found.probability == 0.0
    assert found.upper95 <= 2e-4
    assert found.converged
    assert found.runs >= 3.7 / 2e-4


def test_each_point_of_a_curve_says_how_it_is_known():
    case = case_with(allowed="0.02")
    study = SeparationStudy(SeparationProblem(case), ["ActiveSubspace"], 1, 2000, 20)
    study.compareMethods()
    found = curves(case, study.getReliabilityResult("rolling"))
    points = {point.scale: point for point in found.curves[0].points}
    assert list(points) == [0.3, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0]
    for scale, point in points.items():
        slack = 0.15 * truth(0.4 * scale, 0.4)
        assert point.lower95 - slack <= truth(0.4 * scale, 0.4) <= point.upper95 + slack, scale
    # Near the case its own runs carry the answer, far from it they do not.
    assert (points[0.85].runs, points[1.0].runs) == (0, 0)
    assert points[0.3].runs > 0 or points[2.0].runs > 0
    # Without new runs only what is carried is there.
    carried = curves(case, study.getReliabilityResult("rolling"), makes_runs=False)
    assert 2 <= len(carried.curves[0].points) <= 8
    assert all(point.runs == 0 for point in carried.curves[0].points)


def test_the_loosest_size_that_meets_the_limit_is_found_and_confirmed():
    case = case_with(allowed="0.03")
    root = optimize.brentq(lambda scale: truth(0.4 * scale, 0.4) - 0.03, 0.1, 1.5)
    loosest = curves(case).curves[0].loosest
    # Its upper bound is at most the limit, so that it is a little tighter than the root.
    assert 0.75 * root <= loosest.scale <= root
    assert loosest.upper95 <= 0.03
    assert loosest.runs > 0


def test_processes_change_no_point_of_a_curve():
    case = case_with(allowed="0.05")
    with processes(2)() as pool:
        assert curves(case, spread=pool.map) == curves(case)


def test_where_no_size_of_one_tolerance_meets_the_limit_a_pair_does():
    case = case_with(allowed="1e-3")
    # Even without the other one, each alone leaves more than allowed.
    assert truth(0.0, 0.4) > 1e-3 > truth(0.2, 0.2)
    found = curves(case)
    assert all(curve.loosest is None for curve in found.curves)
    assert found.pair.tolerances in (("rate", "kick"), ("kick", "rate"))
    assert truth(0.4 * found.pair.point.scale, 0.4 * found.pair.point.scale) < 1e-3
    text = " ".join(found.sentences())
    assert "No size of rate alone meets it: 0.3 times its size leaves" in text
    assert "No size of one tolerance meets it, but" in text
    never = curves(case_with(allowed="1e-12"))
    assert never.pair is None
    assert "No pair of these tolerances" in " ".join(never.sentences())


def test_a_requirement_that_is_met_is_told_how_far_it_may_be_loosened():
    found = curves(case_with(allowed="0.2"))
    text = " ".join(found.sentences())
    assert found.is_met
    assert "may grow to" in text
    assert "has to be" not in text
    # What is known of the size of the case alone is no advice.
    assert list(curves(case_with(allowed="0.2"), makes_runs=False).sentences()) == []


CLASSES = ", classes = [0.4, 0.3, 0.2], prices = [1, 2, 5]"
OTHERS = CLASSES.replace("0.4, 0.3, 0.2", '"100 %", "75 %", "50 %"')


def impulse_classes():
    unit = 0.01 * 3.141592653589793 / 180.0
    return f", classes = [{0.4 * unit}, {0.3 * unit}, {0.2 * unit}], prices = [1, 3, 4]"


def test_the_cheapest_pair_of_classes_is_found_where_no_single_class_meets_the_limit():
    case = case_with(allowed="2.5e-3", classes=CLASSES, more=impulse_classes())
    # By hand: (0.3, 0.2) leaves 5.5e-3, (0.2, 0.3) the same, (0.2, 0.2) 4.1e-4, any with 0.4 more than 0.02.
    assert truth(0.2, 0.2) < 2.5e-3 < truth(0.2, 0.3) < truth(0.4, 0.2)
    choice = class_choice(case)
    assert not any(row.meets for row in choice.rows)
    assert choice.chosen.labels["rate"] == "0.2 deg/s"
    assert choice.chosen.price == 9.0
    point = choice.chosen.points["rolling"]
    assert point.lower95 <= truth(0.2, 0.2) <= point.upper95 <= 2.5e-3
    lines = list(choice.lines())
    assert "No class of rate alone meets all limits." in lines
    assert "No class of kick alone meets all limits." in lines
    assert lines[-1].startswith("The cheapest set of classes that meets all limits: rate 0.2 deg/s, kick ")
    assert (choice.sets, len(choice.rows)) == (9, 6)
    # Sets as loose as one that fails are not run.
    assert choice.tested < 9


def test_the_cheapest_of_several_sets_and_none():
    # (0.2, 0.3) costs 8 and meets 8e-3, (0.3, 0.2) costs 6.
    choice = class_choice(case_with(allowed="8e-3", classes=CLASSES, more=impulse_classes()))
    assert choice.chosen.labels["rate"] == "0.3 deg/s"
    assert choice.chosen.price == 6.0
    none = class_choice(case_with(allowed="1e-7", classes=CLASSES, more=impulse_classes()))
    assert none.chosen is None
    assert "No set of classes meets all limits: the tightest, rate 0.2 deg/s" in list(none.lines())[-1]


def test_without_prices_each_step_costs_one():
    rows = case_with(classes=", classes = [0.4, 0.1, 0.2]").inputs
    assert [(one.label, one.price) for one in rows[0].classes] == [
        ("0.4 deg/s", 0.0), ("0.1 deg/s", 2.0), ("0.2 deg/s", 1.0),
    ]  # fmt: skip
    assert [one.scale for one in rows[0].classes] == pytest.approx([1.0, 0.25, 0.5])


@pytest.mark.parametrize(
    ("classes", "words"),
    [
        (', classes = ["one"]', "classes = ['one'], but it must be a list of at least two different sizes"),
        (', classes = [0.1, "wide"]', "classes = 'wide', but it must be a finite, positive number in deg/s, or a perc"),
        (", classes = [0.1, -1]", "classes = -1, but it must be a finite, positive number in deg/s"),
        (', classes = [0.1, "5 %"]', "the nominal value is 0, which has no percentage"),
        (", classes = [0.1, 0.2], prices = [1]", "prices = [1], but it must be a list of finite, non-negative"),
        (", prices = [1, 2]", "inputs.rate.prices needs `classes`"),
    ],
)  # fmt: skip
def test_classes_that_are_none(classes, words):
    with pytest.raises(CaseError) as caught:
        case_with(classes=classes)
    assert words in str(caught.value)


def test_a_group_has_classes_once_and_a_distribution_none():
    same = ', group = "all", classes = [0.1, 0.2]'
    with pytest.raises(CaseError, match=r"inputs.rate and inputs.kick are of the group all and both have classes"):
        case_with(classes=same, more=same)
    text = """[inputs]
mass = { quantity = "satellite.mass", distribution = "Normal", mu = 1.0, sigma = 0.1, classes = [0.1, 0.2] }
"""
    with pytest.raises(CaseError, match=r"classes = .* left out beside `distribution`"):
        parse_case(BODIES + LINEAR + text)


def test_a_study_tells_of_sizes_and_classes(tmp_path, capsys):
    case = case_with(allowed="2.5e-3", classes=CLASSES, more=impulse_classes())
    path = tmp_path / "case.toml"
    path.write_text(case.text, encoding="utf-8")
    options = ["--methods", "ActiveSubspace", "MonteCarlo", "--runs", "5000", "--output", str(tmp_path / "out")]
    assert cli.main(["study", str(path), *options]) == 0
    text = capsys.readouterr().out
    assert "rolling: No size of rate alone meets it" in text
    assert "The cheapest set of classes that meets all limits: rate 0.2 deg/s" in text
    result = read_results(tmp_path / "out" / "results.json")
    assert result.classes.chosen.price == 9.0
    assert result.curves["rolling"].pair is not None
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Which class to order" in page
    assert "How large each tolerance may be" in page
    document = json.loads((tmp_path / "out" / "results.json").read_text(encoding="utf-8"))
    assert document["curves"]["rolling"]["curves"][0]["points"][0]["scale"] == 0.3


def test_a_study_makes_the_curves_that_are_asked_for():
    problem = SeparationProblem(case_with(allowed="0.2"))
    found = {}
    for which in Curves:
        study = SeparationStudy(problem, ["ActiveSubspace"], 1, 2000, 20, toleranceSize=1, curves=which)
        study.compareMethods()
        study.computeCurves()
        found[which] = study.getResult().curves
    assert found[Curves.NONE] == {}
    # It is met: no new runs unless all curves are asked for.
    points = {which: [p for c in found[which]["rolling"].curves for p in c.points] for which in ("needed", "all")}
    assert not any(point.runs for point in points["needed"])
    assert any(point.runs for point in points["all"])
    with pytest.raises(ValueError, match="'some' is not a valid Curves"):
        SeparationStudy(problem, curves="some")


def test_groups_that_are_asked_for_and_one_that_is_none(tmp_path, capsys):
    path = tmp_path / "case.toml"
    path.write_text(case_with(allowed="0.02").text, encoding="utf-8")
    options = ["--methods", "ActiveSubspace", "--runs", "2000", "--output", str(tmp_path / "out")]
    assert cli.main(["study", str(path), *options, "--groups", "mas"]) == 2
    message = capsys.readouterr().err
    assert "'mas' is no tolerance of this case; it has rate, kick, mass; did you mean 'mass'?" in message
    assert cli.main(["study", str(path), *options, "--groups", "mass", "--curves", "none"]) == 0
    result = read_results(tmp_path / "out" / "results.json")
    assert [row.tolerance for row in result.tightened["rolling"]] == ["mass"]
    ot.RandomGenerator.SetSeed(0)
