"""What drives a probability: how scatter is told, tolerances that are tightened, and the most likely violation."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import openturns as ot
import pytest
from small_cases import MASS_AND_RATE, ROLLING, SMALL

from satsep_ot.model.case import load_case, parse_case
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies import drivers
from satsep_ot.studies.telling import scatter

CASE = f"""{SMALL}{MASS_AND_RATE}{ROLLING}[[requirements]]
name = "never"
quantity = "axial_velocity"
minimum = -5.0
"""


@pytest.fixture(scope="module")
def problem():
    return SeparationProblem(parse_case(CASE, "mine.toml"))


def test_scatter_in_words():
    row = load_case("reference").inputs[0]
    assert (
        scatter.describe_scatter(replace(row, distribution=ot.Distribution(ot.Uniform(1.0, 2.5))))
        == "1 to 2.5 kg, uniform"
    )
    # An interval that is narrow beside its mean still has a width.
    for low, high, words in ((199.5, 200.5, "199.5 to 200.5"), (-1e6, 0.1 - 1e6, "-1000000 to -999999.9")):
        narrow = replace(row, distribution=ot.Distribution(ot.Uniform(low, high)))
        assert scatter.describe_scatter(narrow) == f"{words} kg, uniform"
    gumbel = ot.Distribution(ot.Gumbel(1.0, 2.0))
    assert scatter.describe_scatter(replace(row, distribution=gumbel)) == f"{gumbel} kg"


def test_scatter_of_several_inputs_in_words():
    rows = drivers.tolerances(load_case("reference"))["stiffness"]
    changed = [replace(row, distribution=ot.Distribution(ot.Normal(1.0, 11.0 * k))) for k, row in enumerate(rows, 1)]
    assert scatter.describe_scatters(changed) == "sigma 11 to 44 N/m"
    assert scatter.describe_scatters([changed[0], changed[1], changed[0]]) == "sigma 11 N/m; sigma 22 N/m"
    flat = replace(rows[0], distribution=ot.Distribution(ot.Uniform(1.0, 2.5)))
    assert scatter.describe_scatters([*changed[:2], flat]) == "sigma 11 N/m; sigma 22 N/m; 1 to 2.5 N/m, uniform"
    assert scatter.describe_scatter(replace(changed[0], unit="1")) == "sigma 11"


def test_what_several_inputs_are_in_words():
    case = load_case("reference")
    rows = drivers.tolerances(case)["stiffness"]
    assert scatter.describe_inputs(rows[:1]) == "stiffness of spring 1"
    assert scatter.describe_inputs([rows[0], rows[2]]) == "stiffness of springs 1, 3"
    for words, text in (
        (["mass of all", "mass of all"], "mass of all"),
        (["one thing", "another"], "one thing; another"),
    ):
        assert scatter.describe_inputs([replace(case.inputs[0], description=word) for word in words]) == text
    # A description of the file stands for all of its inputs.
    key = 'quantity = "springs.stiffness.each"'
    own = case.text.replace(key, f'{key}, description = "wire"')
    assert own != case.text
    assert scatter.describe_inputs(drivers.tolerances(parse_case(own))["stiffness"]) == "wire"


def test_a_tolerance_that_is_none_is_named():
    with pytest.raises(ValueError, match=r"'colour' is no tolerance of this case; it has .*satellite_mass"):
        drivers.scaled_case(load_case("reference"), "colour", 0.5)


class Told:
    """A result whose re-weighted probability is told, or what is raised instead."""

    def __init__(self, answer):
        self.answer = answer

    def getProbabilityEstimate(self):
        return 1e-3

    def computeProbability(self, distribution):
        if isinstance(self.answer, Exception):
            raise self.answer
        return self.answer


def test_what_cannot_be_told_is_left_out_and_an_interrupt_is_one(problem):
    case = problem.getCase()
    for error in (RuntimeError("no run has failed"), ValueError("it reaches further")):
        assert drivers.tightened_probabilities(case, Told(error), ["mass"]) == {}
    with pytest.raises(KeyboardInterrupt):
        drivers.tightened_probabilities(case, Told(RuntimeError("KeyboardInterrupt: in Python")), ["mass"])


def test_the_most_likely_violation_and_none_where_nothing_violates(problem):
    found = drivers.most_likely_violation(problem, "rolling")
    assert found.distance == pytest.approx(2.5, rel=0.01)
    assert abs(found.standard[1]) == pytest.approx(2.5, rel=0.01)
    assert drivers.most_likely_violation(problem, "never") is None


def test_the_nearest_true_violation_stands_where_the_search_ends_in_an_error(problem, monkeypatch):
    sample = ot.Sample(np.array(problem.getDistribution().getSample(20_000)))

    class Failing:
        message = "InternalException : no convergence"

        def __init__(self, *arguments):
            pass

        def run(self):
            raise RuntimeError(self.message)

    monkeypatch.setattr(drivers.ot, "FORM", Failing)
    found = drivers.most_likely_violation(problem, "rolling", sample)
    assert 2.5 < found.distance < 3.0
    assert math.isclose(found.distance, np.linalg.norm(found.standard))
    # Nor does a search that ends inside make a violation of what is none.
    origin = SimpleNamespace(getStandardSpaceDesignPoint=lambda: [0.1, 0.1])
    astray = SimpleNamespace(run=lambda: None, getResult=lambda: origin)
    monkeypatch.setattr(drivers.ot, "FORM", lambda *arguments: astray)
    assert drivers.most_likely_violation(problem, "rolling", sample).distance == found.distance
    assert drivers.most_likely_violation(problem, "rolling") is None
    # Nor one that ends where no run succeeds: with a mass below 0.
    origin.getStandardSpaceDesignPoint = lambda: [-60.0, 0.1]
    assert drivers.most_likely_violation(problem, "rolling", sample).distance == found.distance
    monkeypatch.setattr(drivers.ot, "FORM", Failing)
    monkeypatch.setattr(Failing, "message", "KeyboardInterrupt: in Python")
    with pytest.raises(KeyboardInterrupt):
        drivers.most_likely_violation(problem, "rolling", sample)
