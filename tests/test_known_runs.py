"""Runs that one already has: learnt from, and a part of the estimate only where they were drawn for it."""

import numpy as np
import openturns as ot
import pytest
from reliability_events import covers, event
from scipy.stats import norm

from satsep_ot import ActiveSubspaceReliability


def answer(theEvent, inputs, outputs, law=None, seed=0, **options):
    ot.RandomGenerator.SetSeed(seed)
    algorithm = ActiveSubspaceReliability(theEvent)
    algorithm.setKnownRuns(inputs, outputs, law)
    for key, value in options.items():
        getattr(algorithm, f"set{key}")(value)
    algorithm.run()
    return algorithm.getResult()


def limit(u):
    return 2.0 - u[:, 0] - 0.3 * u[:, 1]


LIMIT_PROBABILITY = norm.sf(2.0 / np.hypot(1.0, 0.3))


def test_drawn_runs_are_a_part_of_the_estimate():
    for seed in range(8):
        points = np.random.default_rng(seed).standard_normal((400, 3))
        result = answer(event(limit), points, limit(points)[:, None], ot.Normal(3), seed=seed)
        assert covers(result, LIMIT_PROBABILITY)
        assert result.getEvaluationNumber() + 400 == result.getInputSample().getSize()
        runs = result.getTrueRuns()
        np.testing.assert_array_equal(runs.inputs[:400], points)
        assert runs.computeProbability() == pytest.approx(result.getProbabilityEstimate(), rel=1e-9)
        assert np.isfinite(runs.weights[:400]).all()
        # They have a share, and the runs that were made since have the larger one.
        assert 0.0 < runs.weights[:400].mean() < 0.5


def test_runs_of_another_distribution_count_by_the_ratio_of_densities():
    law = ot.Normal([1.5, 0.4, 0.0], [1.0, 1.0, 1.5], ot.CorrelationMatrix(3))
    for seed in range(4):
        ot.RandomGenerator.SetSeed(100 + seed)
        points = np.array(law.getSample(300))
        result = answer(event(limit), points, limit(points)[:, None], law, seed=seed)
        assert covers(result, LIMIT_PROBABILITY)
        runs = result.getTrueRuns()
        assert runs.computeProbability() == pytest.approx(result.getProbabilityEstimate(), rel=1e-9)
        shares = (
            runs.weights[:300]
            / np.exp(np.array(ot.Normal(3).computeLogPDF(points)) - np.array(law.computeLogPDF(points)))[:, 0]
        )
        # One share of the estimate for all of them.
        assert np.ptp(shares) < 1e-9 * shares[0]
        # They are no draws of the inputs' distribution.
        assert set(runs.phases[:300]) == {"known"}


def test_runs_of_a_distribution_that_hardly_reaches_the_failures_count_little():
    law = ot.Normal([-1.0, 0.0, 0.0], [0.7, 1.0, 1.0], ot.CorrelationMatrix(3))
    points = np.array(law.getSample(300))
    assert (limit(points) > 0.0).all()
    result = answer(event(limit), points, limit(points)[:, None], law)
    assert covers(result, LIMIT_PROBABILITY)
    nominal = np.exp(np.array(ot.Normal(3).computeLogPDF(points)) - np.array(law.computeLogPDF(points)))[:, 0]
    assert (result.getTrueRuns().weights[:300] / nominal).max() < 0.01


def test_runs_from_elsewhere_teach_and_estimate_nothing():
    points = np.random.default_rng(1).normal(2.5, 0.2, (100, 3))
    assert (limit(points) < 0.0).all()
    result = answer(event(limit), points, limit(points)[:, None])
    assert covers(result, LIMIT_PROBABILITY)
    runs = result.getTrueRuns()
    assert np.isnan(runs.weights[:100]).all()
    assert runs.computeProbability() == pytest.approx(result.getProbabilityEstimate(), rel=1e-9)
    assert set(runs.phases[:100]) == {"known"}
    assert "known" not in result.getPhases()


def test_runs_in_physical_units():
    law = ot.JointDistribution([ot.Uniform(2.0, 4.0), ot.LogNormal(1.0, 0.2)])
    function = ot.SymbolicFunction(["a", "b"], ["a + b"])
    theEvent = ot.ThresholdEvent(ot.CompositeRandomVector(function, ot.RandomVector(law)), ot.Greater(), 8.0)
    ot.RandomGenerator.SetSeed(3)
    inputs = law.getSample(200)
    result = answer(theEvent, inputs, function(inputs), law)
    np.testing.assert_allclose(np.array(result.getInputSample())[:200], inputs)
    truth = (np.array(function(law.getSample(10**6))) > 8.0).mean()
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.2)


@pytest.mark.parametrize("drawn", [True, False])
def test_only_drawn_runs_bound_what_never_failed(drawn):
    points = np.random.default_rng(0).standard_normal((2000, 3))
    result = answer(
        event(lambda u: np.ones(len(u))),
        points,
        np.ones((2000, 1)),
        ot.Normal(3) if drawn else None,
        MaximumEvaluations=200,
    )
    upper = result.getConfidenceInterval(0.95).getUpperBound()[0]
    nominal = int(np.isin(result.getTrueRuns().phases, ("learning", "Monte Carlo", "known, drawn")).sum())
    assert upper == pytest.approx(1.0 - 0.05 ** (1.0 / nominal))
    assert (nominal > 2000) == drawn


def test_known_runs_of_another_distribution_are_no_part_of_crude_monte_carlo():
    law = ot.Normal([1.0, 0.0, 0.0], [1.0, 1.0, 1.0], ot.CorrelationMatrix(3))
    points = np.array(law.getSample(50))
    result = answer(event(lambda u: np.ones(len(u))), points, np.ones((50, 1)), law, MaximumEvaluations=200)
    assert result.getMethod() == "MonteCarlo"
    assert np.isnan(result.getTrueRuns().weights[:50]).all()


def test_a_known_failure_leads_to_its_region():
    def corner(u):
        return np.minimum(3.0 - u[:, 0], 0.5 * (np.abs(u[:, 1:] + 3.4).max(axis=1) - 0.8))

    other = (norm.cdf(-2.6) - norm.cdf(-4.2)) ** 2
    truth = norm.sf(3.0) + other - norm.sf(3.0) * other
    points = np.array([[0.0, -3.4, -3.4], [0.0, 0.0, 0.0]])
    result = answer(event(corner), points, corner(points)[:, None])
    assert covers(result, truth)
    near = np.abs(np.array(result.getInputSample())[:, 1:] + 3.4).max(axis=1) < 1.5
    assert np.count_nonzero(near) > 5


def test_of_a_probable_event_the_complement_is_estimated_with_them():
    points = np.random.default_rng(4).standard_normal((300, 3))
    result = answer(event(lambda u: -limit(u)), points, -limit(points)[:, None], ot.Normal(3))
    assert covers(result, 1.0 - LIMIT_PROBABILITY)


def test_runs_without_a_value_are_left_out():
    points = np.random.default_rng(1).standard_normal((50, 3))
    values = limit(points)[:, None]
    values[7] = np.nan
    assert covers(answer(event(limit), points, values), LIMIT_PROBABILITY)


def test_what_does_not_fit_is_refused():
    algorithm = ActiveSubspaceReliability(event(limit))
    with pytest.raises(ValueError, match=r"the shapes \(3,\) and \(1, 1\); \(n, d\) and \(n, p\) are needed"):
        algorithm.setKnownRuns([1.0, 2.0, 3.0], [[1.0]])
    with pytest.raises(ValueError, match="are needed"):
        algorithm.setKnownRuns(np.ones((3, 3)), np.ones((2, 1)))
    with pytest.raises(ValueError, match="the known runs have 2 outputs, the function 1"):
        answer(event(limit), np.ones((3, 3)), np.ones((3, 2)))
    with pytest.raises(ValueError, match="of a distribution of dimension 2, the inputs have 3"):
        answer(event(limit), np.ones((3, 3)), np.ones((3, 1)), ot.Normal(2))
    with pytest.raises(ValueError, match=r"it must be \(n, 3\)"):
        answer(event(limit), np.ones((3, 2)), np.ones((3, 1)))
    uniform = ot.JointDistribution([ot.Uniform()] * 3)
    with pytest.raises(ValueError, match="Row 1 of the inputs is outside the range"):
        answer(event(limit, distribution=uniform), [[0.0] * 3, [2.0, 0.0, 0.0]], np.ones((2, 1)))
    # None is none.
    assert (
        answer(event(limit), np.ones((0, 3)), np.ones((0, 1))).getInputSample()
        == answer(event(limit), np.ones((0, 3)), np.ones((0, 1)), ot.Normal(3)).getInputSample()
    )
