"""The cases of the package: each says where its numbers come from, and can be studied."""

import re
from importlib import resources

import numpy as np
import openturns as ot
import pytest

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.model.case import load_case, shipped_cases
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

GALLERY = [name for name in shipped_cases() if name != "reference"]


def test_the_gallery_is_there():
    assert {"cubesat", "deployer_3u", "deployer_12u", "one_spring_failed", "ring_400kg", "spinning_stage"} <= set(
        GALLERY
    )


@pytest.mark.parametrize("name", GALLERY)
def test_numbers_have_sources(name):
    text = (resources.files("satsep_ot.model") / "cases" / f"{name}.toml").read_text(encoding="utf-8")
    sources = set(re.findall(r"^#   \[(\w+)\]", text, re.MULTILINE))
    assert "J" in sources
    assert len(sources) > 1
    used = set(re.findall(r"\[([A-Z]+\d*)(?=[\]:;, ])", text))
    assert used <= sources
    # Every mass, inertia, spring and limit line names one.
    for line in text.splitlines():
        if re.match(r"(mass|stiffness|deformation|stroke|radius|count|angles|maximum|minimum) = [-\d\[]", line):
            assert "#" in line, line


@pytest.mark.parametrize("name", GALLERY)
def test_violations_are_rare_but_there(name):
    """A gallery whose probabilities are 0 or 1 would show nothing."""
    problem = SeparationProblem(name)
    ot.RandomGenerator.SetSeed(0)
    model = SeparationFunction(name)
    size = 1_000 if problem.getCase().separation.has_contact() else 20_000
    values = model.evaluate(np.array(problem.getDistribution().getSample(size)))
    columns = list(quantity_table(problem.getCase().separation))
    shares = []
    for entry in problem.getRequirements():
        column = values[:, columns.index(entry.quantity)]
        shares.append(np.mean(column > entry.limit if entry.is_maximum else column < entry.limit))
    assert max(shares) > 0.0
    assert max(shares) < 0.05


def test_springs_of_a_batch_are_correlated():
    ot.RandomGenerator.SetSeed(0)
    sample = SeparationProblem("ring_400kg").getDistribution().getSample(5000)
    names = [row.name for row in load_case("ring_400kg").inputs]
    first, last = names.index("stiffness_1"), names.index("stiffness_8")
    assert sample.computeLinearCorrelation()[first, last] == pytest.approx(0.5, abs=0.04)
