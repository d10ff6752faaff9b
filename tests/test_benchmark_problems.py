"""Benchmark problems: their reference probabilities, and one contract for all."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.benchmark_problems import getBenchmarkProblem, getBenchmarkProblems

PROBLEMS = {problem.getName(): problem for problem in getBenchmarkProblems()}
# Published values (Rozsas and Slobbe 2019; Waarts 2000; Papaioannou 2015) beside those that the module computes.
PUBLISHED = {
    "P2": 6.62e-6,
    "RP91": 6.97e-4,
    "RP22": 4.207305e-3,
    "RP54": 9.98e-4,
    "RP63": 3.79e-4,
    "RP107": 2.92e-7,
    "FourBranch": 2.2228e-3,
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_problem_is_an_event_that_its_components_compose(name):
    problem = PROBLEMS[name]
    assert 0.0 < problem.getProbability() < 0.1
    assert problem.getSource()
    sample = problem.getDistribution().getSample(20)
    event = problem.getEvent()
    function, composition = problem.getComponents()
    direct = np.array(event.getFunction()(sample))
    assert direct.shape == (20, 1)
    np.testing.assert_allclose(np.array(composition(function(sample))), direct, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(problem.evaluate(np.array(sample)), direct[:, 0], rtol=1e-12, atol=1e-12)
    assert event.getOperator().compare(0.0, event.getThreshold())


@pytest.mark.parametrize("name", PUBLISHED)
def test_computed_references_agree_with_published_ones(name):
    assert PROBLEMS[name].getProbability() == pytest.approx(PUBLISHED[name], rel=0.05 if name == "RP91" else 0.02)


@pytest.mark.parametrize(
    "name", ["P3", "P4", "P5", "RP8", "RP14", "RP22", "RP91", "FourBranch", "Speed35", "Absolute35", "System35"]
)
def test_references_agree_with_monte_carlo(name):
    problem = PROBLEMS[name]
    ot.RandomGenerator.SetSeed(1)
    size = 200_000
    failures = np.count_nonzero(problem.evaluate(np.array(problem.getDistribution().getSample(size))) <= 0.0)
    expected = size * problem.getProbability()
    assert abs(failures - expected) < 4.0 * np.sqrt(expected)


def test_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="P1, P2"):
        getBenchmarkProblem("P99")
