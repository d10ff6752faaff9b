"""Every default that a setter's documentation names is the one that a new object has."""

import inspect
import re

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.comparison.comparison import ReliabilityComparison
from satsep_ot.methods.parallel.function import ParallelFunction
from satsep_ot.methods.parallel.monte_carlo_stream import MonteCarloStream
from satsep_ot.methods.parallel.scheduler import ChunkScheduler
from satsep_ot.methods.polynomials.basis import PolynomialBasis
from satsep_ot.methods.polynomials.distribution import PolynomialDistribution
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.methods.subspaces.ridge_approximation import RidgeApproximation

FUNCTION = ot.SymbolicFunction(["a", "b", "c", "d"], ["a + b + c + d"])
LAW = ot.Normal(4)
POINTS = np.random.default_rng(0).standard_normal((30, 4))
OBJECTS = {
    "reliability": lambda: ActiveSubspaceReliability(
        ot.ThresholdEvent(ot.CompositeRandomVector(FUNCTION, ot.RandomVector(LAW)), ot.Greater(), 5.0)
    ),
    "active subspace": lambda: ActiveSubspaceAlgorithm(FUNCTION, LAW),
    "regression": lambda: MultivariatePolynomialRegression(POINTS, POINTS[:, :1]),
    "ridge": lambda: RidgeApproximation(POINTS, POINTS[:, :1], LAW),
    "scheduler": ChunkScheduler,
    "parallel function": lambda: ParallelFunction(FUNCTION),
    "stream": lambda: MonteCarloStream(FUNCTION, LAW, 100),
}
WORDS = {"None": None, "no": False}
# A number in brackets, with its unit; or the word or number that stands before "(default)".
PATTERN = re.compile(
    r"\(default:? (?P<inside>[\w.-]+?)(?P<unit> s| blocks)?\)"
    r"|(?P<before>\"\w+\"|None|\d+)(?:``)?(?: an error)? \(default\)"
)


def documentedDefault(setter):
    text = inspect.getdoc(setter) or ""
    if "(default" not in text:
        return None
    found = PATTERN.search(text)
    assert found, text
    word = (found["inside"] or found["before"]).strip('"')
    value = WORDS.get(word, word)
    if isinstance(value, str) and re.fullmatch(r"[\d.e-]+", value):
        value = float(value) if "." in value else int(value)
    # A chunk of so many blocks is given by its runs.
    return value * 1024 if found["unit"] == " blocks" else value, text


CASES = [
    (name, setter)
    for name, make in OBJECTS.items()
    for setter in dir(make())
    if re.match(r"set[A-Z]", setter)
    and setter in {key for kind in type(make()).__mro__ if "satsep_ot" in kind.__module__ for key in vars(kind)}
    and documentedDefault(getattr(make(), setter))
]


@pytest.mark.parametrize(("name", "setter"), CASES)
def test_setting_the_documented_default_changes_nothing(name, setter):
    changed, fresh = OBJECTS[name](), OBJECTS[name]()
    value, text = documentedDefault(getattr(changed, setter))
    getattr(changed, setter)(value)

    def attributes(instance):
        own = dict(vars(instance))
        scheduler = own.get("_scheduler")
        return own | (vars(scheduler) if scheduler else {})

    before, after = attributes(fresh), attributes(changed)
    plain = (int, float, str, bool, type(None))
    assert [key for key in before if isinstance(before[key], plain) and before[key] != after[key]] == [], text


def test_there_are_defaults_to_look_at():
    assert len(CASES) >= 20


@pytest.mark.parametrize(("name", "setter"), CASES)
def test_what_was_set_is_what_is_got(name, setter):
    instance = OBJECTS[name]()
    value, _ = documentedDefault(getattr(instance, setter))
    getter = getattr(instance, setter.replace("set", "get", 1), None)
    getattr(instance, setter)(value)
    assert getter is None or getter() == value


@pytest.mark.parametrize("name", OBJECTS)
def test_an_object_shows_its_class(name):
    instance = OBJECTS[name]()
    assert repr(instance).startswith(f"{type(instance).__name__}(")


def test_results_show_their_class_too():
    regression = OBJECTS["regression"]()
    regression.setDegree(2)
    regression.run()
    law = ot.JointDistribution([ot.Normal()] * 4)
    assert repr(regression.getResult()).startswith("MultivariatePolynomialRegressionResult(")
    assert repr(PolynomialBasis(2, 3)) == "PolynomialBasis(dimension=2, degree=3, size=10)"
    line = MultivariatePolynomialRegression(POINTS[:, :1], POINTS[:, :1] ** 2, ot.Normal(1))
    line.run()
    assert repr(PolynomialDistribution(line.getResult())) == "PolynomialDistribution(mean=1, standardDeviation=1.41421)"
    vector = ot.CompositeRandomVector(FUNCTION, ot.RandomVector(law))
    comparison = ReliabilityComparison(ot.ThresholdEvent(vector, ot.Greater(), 1.0), ["MonteCarlo"])
    assert repr(comparison) == "ReliabilityComparison(methods=['MonteCarlo'])"
    comparison.setMaximumEvaluations(1000)
    with pytest.raises(RuntimeError, match=r"call run\(\) first"):
        comparison.getResult()
    comparison.run()
    assert repr(comparison.getResult()) == "ReliabilityComparisonResult(methods=['MonteCarlo'])"
