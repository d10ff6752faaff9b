"""Defaults from OpenTURNS' resource map."""

import re
import subprocess
import sys
from pathlib import Path

import openturns as ot
import pytest

from satsep_ot import ActiveSubspaceAlgorithm, MonteCarloStream, MultivariatePolynomialRegression, RidgeApproximation
from satsep_ot.methods.common.settings import SETTINGS, setting

DOCS = Path(__file__).parents[1] / "docs"
FUNCTION = ot.SymbolicFunction(["a", "b"], ["a + b"])


def ridge():
    inputs = ot.Normal(2).getSample(30)
    return RidgeApproximation(inputs, FUNCTION(inputs), ot.Normal(2))


def regression():
    inputs = ot.Normal(2).getSample(30)
    return MultivariatePolynomialRegression(inputs, FUNCTION(inputs))


# What an object made with another value of the setting shows of it.
SHOWS = {
    "ActiveSubspaceAlgorithm-BootstrapSize": (50, lambda: subspace().getBootstrapSize(), 50),
    "ActiveSubspaceAlgorithm-SamplingFactor": (100.0, lambda: subspace().getSamplingSize(), 70),
    "ActiveSubspaceAlgorithm-MaximumSamplingRatio": (2, lambda: subspace()._maximumSamplingSize, 84),
    "MultivariatePolynomialRegression-Degree": (2, lambda: regression().getDegree(), 2),
    "MultivariatePolynomialRegression-HyperbolicNorm": (0.5, lambda: regression()._norm, 0.5),
    "RidgeApproximation-LargestDimension": (1, lambda: ridge()._largestDimension, 1),
    "RidgeApproximation-LargestDegree": (2, lambda: ridge()._largestDegree, 2),
    "RidgeApproximation-StartsNumber": (7, lambda: ridge()._starts, 7),
    "RidgeApproximation-FoldsNumber": (3, lambda: ridge()._folds, 3),
    "MonteCarloStream-BlockSize": (64, lambda: MonteCarloStream(FUNCTION, ot.Normal(2), 100)._blockSize, 64),
}


def subspace():
    return ActiveSubspaceAlgorithm(FUNCTION, ot.Normal(2))


@pytest.mark.parametrize("name", sorted(set(SETTINGS) & set(SHOWS)))
def test_a_setting_of_the_resource_map_is_the_default_of_new_objects(name):
    value, show, expected = SHOWS[name]
    key, default = f"SatsepOT-{name}", SETTINGS[name][0]
    assert ot.ResourceMap.Get(key) == str(default) or float(ot.ResourceMap.Get(key)) == default
    change = ot.ResourceMap.SetAsScalar if isinstance(default, float) else ot.ResourceMap.SetAsUnsignedInteger
    change(key, value)
    try:
        assert show() == expected
    finally:
        change(key, default)
    assert show() != expected


def test_the_user_guide_lists_every_setting_with_its_default():
    page = (DOCS / "user-guide.md").read_text(encoding="utf-8")
    listed = dict(re.findall(r"^\| `SatsepOT-([\w-]+)` \| ([\d.]+) \|", page, re.M))
    assert listed == {name: f"{default:g}" for name, (default, _) in SETTINGS.items()}


def test_what_a_script_sets_before_the_import_stays():
    code = """
import openturns as ot
ot.ResourceMap.AddAsString("SatsepOT-RidgeApproximation-FoldsNumber", "{}")
from satsep_ot.methods.common.settings import setting
print(setting("RidgeApproximation-FoldsNumber"))
"""
    given = subprocess.run([sys.executable, "-c", code.format(9)], capture_output=True, text=True, check=True)
    assert given.stdout == "9\n"
    wrong = subprocess.run([sys.executable, "-c", code.format("many")], capture_output=True, text=True)
    assert "the resource map has SatsepOT-RidgeApproximation-FoldsNumber = 'many'; it must be a number" in wrong.stderr


def test_an_unknown_setting_is_an_error_of_the_package():
    with pytest.raises(KeyError):
        setting("Unknown")
