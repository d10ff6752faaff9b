"""Contact in case files: keys, defaults, uncertain inputs, refusals, what a run prints."""

import json
from pathlib import Path

import numpy as np
import openturns as ot
import pytest
from test_deck import CASE

from satsep_ot import cli
from satsep_ot.dynamics.separation import Status
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.model.case import CaseError, parse_case
from satsep_ot.model.run_document import run_document
from satsep_ot.model.schema import case_schema
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.separation_study import SeparationStudy

FAILED = CASE.replace("stroke = 30.0", "stroke = 30.0\nfailed = [1]")
CONTACT = "[contact]\nradius = 350\nfriction = 0.1\nv_eps = 2.0\n"
BOLTS = """
[[hold_down]]
angle = 30
radius = 300
release = 5
[[hold_down]]
angle = 200
radius = 310
release = 3
stiffness = 2e8
points = 3
arc = 40
"""
RAILS = "[rails]\nhalf_width = 50\nclearance = 0.25\nsatellite = [0, 340]\nmouth = 360\n"
PINS = """
[umbilical]
angle = 10
radius = 200
stiffness = 1000
deformation = 8
stroke = 6
friction = 40
engagement = 5
"""


def with_tables(*tables, case=CASE):
    first, inputs = case.split("[inputs]")
    return first + "\n".join(tables) + "\n[inputs]" + inputs


def test_keys_and_defaults():
    separation = parse_case(with_tables(CONTACT, BOLTS, RAILS, PINS)).separation
    contact, bolts, rails = separation.contact, separation.hold_downs, separation.rails
    assert (contact.radius, contact.friction, contact.sliding_speed) == pytest.approx((0.35, 0.1, 2e-3))
    assert (contact.stiffness, contact.restitution, contact.impact_speed, contact.points) == pytest.approx(
        (1e7, 0.5, 5e-3, 48)
    )
    np.testing.assert_allclose(np.degrees(bolts.angle), [30.0, 180.0, 200.0, 220.0])
    np.testing.assert_allclose(bolts.release, [5e-3, 3e-3, 3e-3, 3e-3])
    np.testing.assert_allclose(bolts.stiffness, [1e8, 2e8, 2e8, 2e8])
    ends = (rails.half_width, rails.clearance, *rails.satellite, rails.mouth)
    assert ends == pytest.approx((0.05, 2.5e-4, 0.0, 0.34, 0.36))
    assert separation.springs.stiffness[-1] == 1e8
    assert parse_case(with_tables("[contact]")).separation.contact.radius == pytest.approx(0.35)
    feet = parse_case(with_tables("[contact]\npoints = [[300, 0, 0], [0, 0, 300], [-200, 0, -200]]")).separation
    np.testing.assert_allclose(feet.contact.points[1], [0.0, 0.0, 0.3])
    assert parse_case(with_tables("[contact]\ndamping = 600")).separation.contact.restitution == 1.0
    assert {"contact", "hold_down", "rails"} <= set(case_schema()["properties"])


INPUTS = {
    "contact.friction": "contact.friction", "contact.stiffness": "contact.stiffness",
    "contact.v_eps": "contact.sliding_speed", "contact.restitution": "contact.restitution",
    "hold_down.2.release": "hold_downs[1].release",
    "hold_down.1.radius": "hold_downs[0].radius", "rails.clearance": "rails.clearance", "rails.mouth": "rails.mouth",
    "umbilical.pin_stiffness": "springs[4].stiffness",
}  # fmt: skip


def test_every_parameter_may_be_uncertain():
    rows = "\n".join(f'"{name}" = {{ quantity = "{name}", sigma = "1 %" }}' for name in INPUTS)
    text = with_tables(CONTACT, BOLTS, RAILS, PINS).replace("[inputs]", f"[inputs]\n{rows}")
    case = parse_case(text)
    by_name = {row.name: row.parameters for row in case.inputs}
    for name, parameter in INPUTS.items():
        assert by_name[name] == (parameter,)


@pytest.mark.parametrize(
    ("table", "words"),
    [
        ("[contact]\nradius = 0.0", "contact.radius = 0.0, but it must be a finite, positive number in mm"),
        ("[contact]\nstiffness = -1.0", "contact.stiffness = -1.0, but it must be a finite, positive number in N/m"),
        ("[contact]\nrestitution = 1.2", "contact.restitution = 1.2, but it must be above 0 and at most 1"),
        ("[contact]\nfriction = -0.1", "contact.friction = -0.1, but it must be a finite, not negative number"),
        (
            "[contact]\npoints = 3.5",
            "contact.points = 3.5, but it must be a whole number from 0 to 120, or a list of points",
        ),
        ("[contact]\nwalls = true", "contact.walls is on without an envelope"),
        ("[contact]\ndamping = 1.0\nrestitution = 0.5", "contact has both restitution and damping; give one of them"),
        (
            "[[hold_down]]\nangle = 0\nradius = 300",
            "release is missing; it must be a finite, not negative number in ms",
        ),
        ("[[hold_down]]\nangle = 0\nradius = 300\nrelease = inf", "release = inf, but it must be a finite"),
        ("[rails]\nhalf_width = 50\nclearance = 0.2\nsatellite = [400, 700]\nmouth = 360", "does not overlap"),
        ("[rails]\nhalf_width = 50\nclearance = 0.2\nsatellite = [340, 0]\nmouth = 360", "the smaller one first"),
        (RAILS + "[contact]\nfricton = 0.1", "contact.fricton is not a known key; did you mean 'friction'?"),
    ],
)
def test_refusals(table, words):
    with pytest.raises(CaseError) as error:
        parse_case(with_tables(table))
    assert words in str(error.value)
    assert "\n" not in str(error.value)


def test_a_failed_spring_with_contact(tmp_path, capsys):
    """What fails without contact is resolved with it, and the run says what touched what and when."""
    assert simulate(parse_case(FAILED).separation).status[0] == Status.PENETRATION
    case = parse_case(with_tables("[contact]\nradius = 350\n", case=FAILED))
    document = run_document(case, [0.05, 0.2])
    assert document["status"] == "OK"
    assert document["quantities"]["axial_velocity"] == pytest.approx(0.361, abs=1e-3)
    assert document["quantities"]["last_contact"] == document["at_last_release"]["t"] == document["events"][-1]["t"]
    assert {event["what"] for event in document["events"]} >= {"is pressed", "lets go", "releases"}
    assert document["energy"]["contact_work"] < 0.0
    assert len(document["at"]) == 2
    path = tmp_path / "mine.toml"
    path.write_text(with_tables("[contact]\nradius = 350\n", case=FAILED), encoding="utf-8")
    assert cli.main(["simulate", str(path), "--json", "--at", "0.1"]) == 0
    assert json.loads(capsys.readouterr().out)["events"] == document["events"]
    assert cli.main(["simulate", str(path)]) == 0
    assert "by contact, bolts" in capsys.readouterr().out
    assert cli.main(["check", str(path)]) == 0
    assert "Contact: 48 x points on the deck" in " ".join(capsys.readouterr().out.split())


def test_gradients_of_a_case_with_contact():
    case = parse_case(
        with_tables("[contact]\nradius = 350\n", case=FAILED).replace(
            "[inputs]", '[inputs]\nfriction = { quantity = "contact.friction", sigma = 0.02 }'
        )
    )
    function = SeparationFunction(case, quantities=["axial_velocity", "lateral_rate"], tolerance=1e-11)
    x = np.array([[row.distribution.getMean()[0] for row in case.inputs]])
    gradient = function.computeGradientSample(x)[0]
    step = np.diag([1e-4, 1e-4, 1e-3])
    values = [function.evaluate(x + sign * step) for sign in (1.0, -1.0)]
    differences = (values[0] - values[1]) / (2.0 * np.diag(step))[:, None]
    np.testing.assert_allclose(gradient, differences, rtol=1e-4, atol=1e-7)


def test_interference_that_is_too_large_is_stuck():
    text = with_tables(RAILS.replace("clearance = 0.25", "clearance = -0.2"))
    document = run_document(parse_case(text))
    assert document["status"] == "STUCK"
    assert document["message"] == "the satellite is stuck: something still pushes or holds, and nothing moves any more"


def test_a_study_of_a_case_with_contact(tmp_path):
    """It says what touches, how often, and counts runs that do not come free: pins that may hold more than the push."""
    pins = PINS.replace("friction = 40", "friction = 500").replace("engagement = 5", "engagement = 20")
    text = with_tables("[contact]\nradius = 350\n", pins).replace(
        "[inputs]",
        '[inputs]\nhold = { quantity = "umbilical.friction", distribution = "Uniform", a = 400.0, b = 680.0 }',
    )
    text = text.replace('distribution = "Exponential", lambda = 0.5', 'distribution = "Uniform", a = 0, b = 1')
    case = parse_case(text.replace("maximum = 9.0", "maximum = 300.0").replace("minimum = 0.4", "minimum = 0.05"))
    study = SeparationStudy(SeparationProblem(case), methods=["MonteCarlo"], sampleSize=400, gradientSize=40)
    study.setDirectory(tmp_path / "study")
    study.run()
    result = study.getResult()
    assert 0 < result.sunk < 400
    assert 0.0 < result.touched <= 1.0
    assert all(row.probability >= result.sunk / 400 for row in result.rows)
    study.save()
    page = (tmp_path / "study" / "report.html").read_text(encoding="utf-8")
    assert "% of the runs of the sample the bodies touch each other" in page
    assert "They push each other by springs with damping and friction" in page
    assert "In the nominal run" in page


def test_reliability_through_contact():
    """The estimate of a failed spring whose ring is pressed into the deck holds the truth, or says that it may not."""
    problem = SeparationProblem(Path(__file__).parent / "data" / "one_of_three_failed.toml")
    ot.RandomGenerator.SetSeed(3)
    algorithm = ActiveSubspaceReliability(problem.getEvent("tumbling"))
    algorithm.setComponents(*problem.getComponents("tumbling"))
    algorithm.run()
    result = algorithm.getResult()
    interval = result.getConfidenceInterval(0.95)
    # By Monte Carlo with a control variate, tests/benchmarks/contact_reliability.py.
    assert interval.getLowerBound()[0] < 3.52e-3 < interval.getUpperBound()[0] or not result.getConverged()
