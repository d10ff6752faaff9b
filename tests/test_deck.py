"""Every run watches the satellite's foot over the deck, whatever pushes: against states on a grid and the truth set."""

import numpy as np
import openturns as ot
import pytest
from contact_cases import CONTACT_CASES, free_separation
from scipy.spatial.transform import Rotation
from separation_cases import BOX, SQUARE, general_separation, symmetric_separation

from satsep_ot.dynamics.separation import Body, ForceLine, Springs, Status, umbilical
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients, trajectory
from satsep_ot.model.case import parse_case
from satsep_ot.model.check_document import check_case
from satsep_ot.model.run_document import run_document
from satsep_ot.model.separation_function import SeparationError, SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.separation_study import SeparationStudy

FLAT = Body(100.0, [4.0, 6.0, 4.0], [0.0, 0.1, 0.0])
THREE = np.pi * np.array([1.0, 3.0, 5.0]) / 3.0


def springs(angle=THREE, radius=0.35, **changes):
    given = {"angle": angle, "radius": radius, "stiffness": 5500.0, "deformation": 0.04, "stroke": 0.03}
    return Springs(**{**given, **changes})


def heights(separation, times):
    """Of each watched point over the deck, by another rotation than the package's, (T, 1 + points) [m]."""
    states = trajectory(separation, times, tolerance=1e-11).states
    turns = Rotation.from_quat(states[:, [13, 14, 15, 12]]).as_matrix()
    ring = states[:, :3] + separation.platform.center_of_mass - turns @ separation.satellite.center_of_mass
    level = ring[:, 1] - separation.stowed_length
    edge = level - separation.springs.radius.max() * np.hypot(turns[:, 1, 0], turns[:, 1, 2])
    points = level[:, None] + np.einsum("tj,pj->tp", turns[:, 1], separation.recess_points())
    return np.column_stack([edge, points])


@pytest.mark.parametrize("name", [name for name, case in CONTACT_CASES.items() if case.get("without_contact")])
def test_what_the_truth_set_says_without_contact(name):
    """Depth and velocity where the deck holds nothing; the truth's depth is read off a grid of 2 ms."""
    truth = CONTACT_CASES[name]["without_contact"]
    separation = free_separation(name)
    outcome = simulate(separation)
    assert outcome.status[0] == Status.PENETRATION
    radius = CONTACT_CASES[name]["inputs"]["contact"]["deck"]["radius"]
    if radius == separation.springs.radius.max() and name != "deck_light_platform":
        assert 1e-3 * outcome.quantity("deck_height")[0] == pytest.approx(
            truth["smallest_height_of_ring_edge"], abs=2e-6
        )
        assert outcome.notices["time"][0] == pytest.approx(truth["at"], abs=2e-3)
    assert np.isnan(outcome.quantity("axial_velocity")).all()


SEPARATIONS = {
    "failed": symmetric_separation(satellite=FLAT, springs=springs(scale=[0.0, 1.0, 1.0])),
    "late": symmetric_separation(satellite=FLAT, springs=springs(delay=[0.02, 0.0, 0.0])),
    "failed strut": symmetric_separation(
        satellite=FLAT,
        springs=springs(scale=[0.0, 1.0, 1.0]),
        force_line=ForceLine.STRUT,
        stowed_length=0.04,
    ),
    "unequal strokes": symmetric_separation(
        satellite=FLAT, springs=springs(scale=[0.3, 1.0, 1.0], stroke=[0.0005, 0.03, 0.03])
    ),
    "impulse": symmetric_separation(angular_impulse=[2.9, 0.0, 0.3]),
    "envelope": symmetric_separation(
        satellite=FLAT, springs=springs(SQUARE, 0.2, scale=[0.0, 0.0, 1.0, 1.0]), envelope=BOX, recess_radius=0.6,
        recess_depth=0.25,
    ),
    "mounting error": symmetric_separation(
        satellite=FLAT, springs=springs(scale=[0.0, 1.0, 1.0]), mounting_error=[2e-3, 0.0, -1e-3]
    ),
    "general": general_separation(),
}  # fmt: skip


@pytest.mark.parametrize("name", SEPARATIONS)
def test_the_lowest_height_is_that_of_a_fine_grid(name):
    """Of all points and the ring's edge; each counts from its height at the start where that is below the deck."""
    separation = SEPARATIONS[name]
    outcome = simulate(separation)
    found = 1e-3 * outcome.quantity("deck_height")[0]
    grid = heights(separation, np.arange(0.0, 0.8, 1e-4))
    grid -= np.minimum(grid[0], 0.0)
    assert found == pytest.approx(grid.min(), abs=1e-6)
    assert (outcome.status[0] == Status.PENETRATION) == (found < -1e-4)
    assert (found < -1e-4) == (name != "general")
    if found < -1e-4:
        assert "mm below it at" in outcome.explain(0)
        point = outcome.notices["point"][0]
        assert grid[:, 1 + point].min() == pytest.approx(grid.min(), abs=1e-6)
        assert ("envelope point" in outcome.explain(0)) == (point >= 0)


def test_a_foot_that_is_clear_is_watched_no_longer():
    """A satellite that tumbles: to watch it until the horizon takes five times as many steps."""
    outcome = simulate(symmetric_separation(satellite=FLAT, springs=springs(SQUARE, 0.3, scale=[0.0, 1.0, 1.0, 1.0])))
    assert outcome.status[0] == Status.OK
    assert outcome.steps[0] < 15


def test_pins_that_hold_more_than_the_springs_push_draw_the_bodies_together():
    held = springs(scale=0.7).joined(umbilical(0.3, 0.35, 300.0, 0.01, 0.01, friction=300.0, engagement=0.006))
    outcome = simulate(symmetric_separation(satellite=FLAT, springs=held))
    assert outcome.status[0] == Status.PENETRATION
    assert outcome.quantity("deck_height")[0] < -1.0


def test_nothing_of_a_sunk_run_is_told_but_its_depth():
    separation = SEPARATIONS["failed"]
    outcome = simulate_with_gradients(separation)
    assert outcome.explain(0) == (
        "the satellite sinks more than 0.1 mm below the deck, where nothing stops it: the case has no contact; "
        "the edge of its ring at 60 deg is 33.7 mm below it at 460.2 ms"
    )
    assert np.isnan(outcome.quantity_gradient("axial_velocity")).all()
    assert np.isfinite(outcome.base[0]).sum() == 1


def test_neighbours_of_a_sunk_run_are_what_they_are_alone():
    separation = symmetric_separation(satellite=FLAT, springs=springs())
    rows = np.tile(separation.parameters(), (5, 1))
    rows[2, separation.parameter_names().index("springs[0].scale")] = 0.0
    outcome = simulate(separation, rows)
    assert outcome.status.tolist() == [0, 0, Status.PENETRATION, 0, 0]
    np.testing.assert_array_equal(outcome.base[1], simulate(separation).base[0])


@pytest.mark.parametrize("name", ["general", "mounting error"])
def test_gradient_of_the_height(name):
    """Also of one that counts from a start below the deck."""
    separation = general_separation() if name == "general" else symmetric_separation(
        satellite=FLAT, springs=springs(radius=[0.35, 0.349, 0.349], delay=[0.002, 0.0, 0.0]),
        mounting_error=[2e-3, 0.0, -1e-3],
    )  # fmt: skip
    outcome = simulate_with_gradients(separation, tolerance=1e-12)
    assert -0.1 < outcome.quantity("deck_height")[0] < 0.0
    names, nominal = separation.parameter_names(), separation.parameters()
    steps = {"springs[1].stiffness": 1.0, "springs[0].radius": 1e-6, "springs[0].delay": 1e-6, "satellite.mass": 1e-3,
             "satellite.center_of_mass.x": 1e-6, "mounting_error.x": 1e-6, "rates.z": 1e-6}  # fmt: skip
    for parameter, step in steps.items():
        change = step * (np.array(names) == parameter)
        around = simulate(separation, [nominal + change, nominal - change], tolerance=1e-13).quantity("deck_height")
        gradient = outcome.quantity_gradient("deck_height")[0][names.index(parameter)]
        assert gradient == pytest.approx((around[0] - around[1]) / (2.0 * step), rel=1e-4, abs=1e-6), parameter


CASE = """
name = "flat"
[platform]
mass = 1200.0
inertia = [1500.0, 600.0, 1500.0]
center_of_mass = [0.0, -1600.0, 0.0]
[satellite]
mass = 100.0
inertia = [4.0, 6.0, 4.0]
center_of_mass = [0.0, 100.0, 0.0]
[springs]
count = 3
radius = 350.0
stiffness = 5500.0
deformation = 40.0
stroke = 30.0
[inputs]
delay = { quantity = "springs.delay.1", distribution = "Exponential", lambda = 0.5 }
mass = { quantity = "satellite.mass", sigma = 0.5 }
[[requirements]]
quantity = "lateral_rate"
maximum = 9.0
[[requirements]]
quantity = "axial_velocity"
minimum = 0.4
"""


def test_check_and_simulate_warn():
    case = parse_case(CASE.replace("stroke = 30.0", "stroke = 30.0\nfailed = [1]"))
    checked = check_case(case)
    assert not checked.is_ok
    assert any("nominal run: the satellite sinks" in warning for warning in checked.warnings)
    document = run_document(case, [0.05])
    assert document["status"] == "PENETRATION"
    assert "33.7 mm below it at 460.2 ms" in document["message"]
    assert document["quantities"]["deck_height"] == pytest.approx(-33.656, abs=1e-3)
    assert document["quantities"]["axial_velocity"] is None
    assert document["at"] == [None]
    late = check_case(parse_case(CASE))
    assert late.is_ok
    assert any("% of the combinations of the inputs fail: the satellite sinks" in warning for warning in late.warnings)


def test_a_study_counts_sunk_runs_as_violations(tmp_path):
    case = parse_case(CASE)
    problem = SeparationProblem(case)
    ot.RandomGenerator.SetSeed(0)
    sample = problem.getDistribution().getSample(4000)
    with pytest.raises(SeparationError, match="the satellite sinks"):
        SeparationFunction(case).evaluate(sample)
    function = SeparationFunction(case, quantities=["axial_velocity", "deck_height"], countsEndings=True)
    velocity, height = function.evaluate(sample).T
    sunk = height < -0.1
    assert 0.005 < sunk.mean() < 0.2
    assert (velocity[sunk] < 0.4).all()
    assert (velocity[~sunk] > 0.4).all()
    assert np.isfinite(velocity).all()
    for name in problem.getRequirementNames():
        event = problem.getEvent(name)
        values = np.array(event.getFunction()(sample))[:, 0]
        violated = np.array([event.getOperator().compare(value, event.getThreshold()) for value in values])
        assert violated[sunk].all()
    study = SeparationStudy(problem, methods=["MonteCarlo"], sampleSize=4000, gradientSize=20)
    study.setDirectory(tmp_path / "study")
    study.run()
    result = study.getResult()
    assert result.sunk is not None
    assert abs(result.sunk - sunk.sum()) < 5.0 * np.sqrt(sunk.sum())
    assert all(row.probability >= result.sunk / 4000 for row in result.rows)
    study.save()
    page = (tmp_path / "study" / "report.html").read_text(encoding="utf-8")
    assert f"In {result.sunk:,} of 4,000 runs of the sample the satellite sinks" in page
