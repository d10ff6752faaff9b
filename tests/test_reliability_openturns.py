"""The reliability result speaks OpenTURNS: its names, its objects, and what can be started from it."""

import numpy as np
import openturns as ot
import pytest
from reliability_events import event, findNothing, run

from satsep_ot.methods.common.intervals import ConfidenceInterval

LEVELS = (0.5, 0.9, 0.95, 0.99)


def linear():
    function = ot.SymbolicFunction(["load", "mass", "rest"], ["3 * load - 6 * mass + 0.5 * rest"])
    law = ot.JointDistribution([ot.Normal(10.0, 2.0), ot.Normal(2.7, 0.7), ot.Uniform(-1.0, 1.0)])
    law.setDescription(["load", "mass", "rest"])
    vector = ot.CompositeRandomVector(function, ot.RandomVector(law))
    return ot.ThresholdEvent(vector, ot.Greater(), 38.0)


@pytest.fixture(scope="module")
def result():
    return run(linear())


def test_names_of_openturns_results(result):
    assert result.getEventProbability() == result.getProbabilityEstimate()
    assert result.getTimeDuration() > 0.0
    for name in ("drawImportanceFactors", "drawProbabilityConvergence"):
        graph = getattr(result, name)()
        assert isinstance(graph, ot.Graph)
        assert len(graph.getDrawables()) > 0


def test_importance_factors_are_about_those_of_form(result):
    factors = result.getImportanceFactors()
    assert list(factors.getDescription()) == ["load", "mass", "rest"]
    assert sum(factors) == pytest.approx(1.0)
    solver = ot.AbdoRackwitz()
    solver.setStartingPoint(linear().getAntecedent().getDistribution().getMean())
    algorithm = ot.FORM(solver, linear())
    algorithm.run()
    np.testing.assert_allclose(factors, algorithm.getResult().getImportanceFactors(), atol=0.03)


def test_the_most_likely_violation_starts_form_and_importance_sampling(result):
    standard, physical = result.getStandardSpaceDesignPoint(), result.getPhysicalSpaceDesignPoint()
    theEvent = linear()
    assert theEvent.getFunction()(physical)[0] > 38.0
    law = theEvent.getAntecedent().getDistribution()
    np.testing.assert_allclose(law.getIsoProbabilisticTransformation()(physical), standard, atol=1e-9)
    solver = ot.AbdoRackwitz()
    solver.setStartingPoint(physical)
    algorithm = ot.FORM(solver, theEvent)
    algorithm.run()
    found = algorithm.getResult()
    # A true run beyond the limit, nearly as likely as the likeliest point on it.
    assert found.getHasoferReliabilityIndex() <= standard.norm() < found.getHasoferReliabilityIndex() + 0.2
    ot.RandomGenerator.SetSeed(0)
    sampling = ot.PostAnalyticalImportanceSampling(ot.FORMResult(standard, theEvent, False))
    sampling.setMaximumCoefficientOfVariation(0.05)
    sampling.setBlockSize(100)
    sampling.setMaximumOuterSampling(100)
    sampling.run()
    other = sampling.getResult().getProbabilityEstimate()
    assert result.getEventProbability() == pytest.approx(other, rel=0.25)


def test_the_design_point_of_a_complement_is_in_the_event():
    found = run(event(lambda u: u[:, 0] - 1.5))
    assert found.getEventProbability() == pytest.approx(0.933, abs=0.02)
    assert found.getPhysicalSpaceDesignPoint()[0] < 1.5


def test_what_has_not_failed_has_no_design_point():
    found = run(event(lambda u: np.ones(len(u))), MaximumEvaluations=100)
    for name in ("getStandardSpaceDesignPoint", "getPhysicalSpaceDesignPoint", "getImportanceFactors"):
        with pytest.raises(RuntimeError, match="no run has failed"):
            getattr(found, name)()


@pytest.mark.parametrize(
    "interval",
    [
        ConfidenceInterval(1e-6, 1e-14, 20.0),
        ConfidenceInterval(1e-6, 1e-14, 20.0, lowerOnly=True),
        ConfidenceInterval(1e-3, 1e-8, complement=True),
        ConfidenceInterval(0.0, 1e-8),
        ConfidenceInterval(0.6, 0.04, 3.0),
        ConfidenceInterval(failures=0, runs=100),
        ConfidenceInterval(failures=100, runs=100),
        ConfidenceInterval(failures=7, runs=100),
        ConfidenceInterval(failures=7, runs=100, lowerOnly=True, complement=True),
    ],
    ids=repr,
)
def test_the_distribution_of_an_estimate_has_its_intervals(interval):
    law = interval.distribution()
    for level in LEVELS:
        lower, upper = interval.bounds(level)
        assert law.computeQuantile(0.5 - 0.5 * level)[0] == pytest.approx(lower, rel=1e-9, abs=1e-12)
        assert law.computeQuantile(0.5 + 0.5 * level)[0] == pytest.approx(upper, rel=1e-9)
    assert 0.0 <= law.getRange().getLowerBound()[0] <= law.getRange().getUpperBound()[0] <= 1.0 + 1e-12


def test_the_distribution_of_a_result_has_its_intervals(result):
    law = result.getProbabilityDistribution()
    for level in LEVELS:
        expected = result.getConfidenceInterval(level)
        found = law.computeBilateralConfidenceInterval(level)
        np.testing.assert_allclose(found.getLowerBound(), expected.getLowerBound(), rtol=1e-9)
        np.testing.assert_allclose(found.getUpperBound(), expected.getUpperBound(), rtol=1e-9)


def test_results_of_subset_simulation_speak_so_too(monkeypatch):
    findNothing(monkeypatch)
    found = run(event(lambda u: 2.5 - u[:, 0]))
    assert found.getMethod() == "SubsetSimulation"
    assert found.getPhysicalSpaceDesignPoint()[0] > 2.5
    assert found.getEventProbability() > 0.0
    with pytest.raises(RuntimeError, match="by subset simulation"):
        found.drawImportanceFactors()
