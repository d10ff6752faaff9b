"""Subset simulation: its levels, the size of its error, and what it makes of a limited number of evaluations."""

import math

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.reliability.limit_state import LimitStateEvent
from satsep_ot.methods.reliability.subset_simulation import (
    SubsetEstimate,
    _levelVariation,
    _onePass,
    runSubsetSimulation,
)


def limitState(limit, dimension=3, policy="raise", evaluate=None):
    """Failure where the first variable exceeds the limit, and the numbers of points of each call."""
    sizes = []

    def counted(u):
        u = np.asarray(u)
        sizes.append(len(u))
        return (limit - u[:, :1]) if evaluate is None else evaluate(u)[:, None]

    function = ot.PythonFunction(dimension, 1, func_sample=counted)
    vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(dimension)))
    event = ot.ThresholdEvent(vector, ot.LessOrEqual(), 0.0)
    return LimitStateEvent(event, nonFinitePolicy=policy), sizes


def simulate(limit, evaluations, seed=0, **options):
    event, sizes = limitState(limit, **options)
    generator = np.random.default_rng(seed)
    return runSubsetSimulation(event.evaluate, event.dimension, evaluations, generator), sizes


def test_seven_levels_fit_into_the_evaluations_and_chains_are_ten_long():
    estimate, sizes = simulate(4.5, 7000)
    # 100 chains: 1000 runs for the first level, 900 for each of the others, down to 3.4e-6.
    assert sizes[0] == 1000
    assert set(sizes[1:]) == {100}
    assert estimate.probability == pytest.approx(ot.DistFunc.pNormal(-4.5), rel=0.5)
    passes = (len(estimate.runs) - 1000) // 900
    assert len(estimate.runs) == 1000 + 900 * passes
    assert passes == 5
    # With few evaluations there are at least two chains, or there would be no level between them.
    _, sizes = simulate(4.5, 140)
    assert sizes[0] == 20


def test_a_frequent_event_takes_one_level_and_repeats_it_while_there_are_evaluations():
    estimate, sizes = simulate(0.5, 7000)
    # Another pass is begun where a tenth more than the last one took is left.
    assert sizes == [1000] * 6
    share = np.mean(estimate.runs.failed)
    assert estimate.probability == pytest.approx(share)
    # The error of independent runs, or what six of them happen to differ by.
    plain = math.sqrt((1.0 - share) / (share * 6000))
    assert 0.99 * plain < estimate.coefficientOfVariation < 2.5 * plain
    assert estimate.upperBound == pytest.approx(ot.DistFunc.pNormal(-0.5), rel=0.15)


def test_evaluations_that_end_early_leave_what_was_reached():
    event, _ = limitState(6.5)
    # Three levels of ten per cent are reached with 1000 + 900 + 900 runs.
    estimate = _onePass(event.evaluate, 3, 100, 2900, np.random.default_rng(0))
    assert estimate.probability == 0.0
    assert estimate.coefficientOfVariation == math.inf
    assert estimate.upperBound == pytest.approx(1e-3)
    assert len(estimate.runs) == 2800
    # At the last level that is affordable some have failed, less than a tenth: they count.
    event, _ = limitState(3.2)
    estimate = _onePass(event.evaluate, 3, 100, 2000, np.random.default_rng(0))
    assert len(estimate.runs) == 1900
    assert estimate.probability == pytest.approx(ot.DistFunc.pNormal(-3.2), rel=0.5)
    assert estimate.upperBound == pytest.approx(1e-2)
    assert 0.1 < estimate.coefficientOfVariation < 1.0


def test_a_function_that_no_level_leads_along_is_given_up():
    event, _ = limitState(0.0, evaluate=lambda u: np.ones(len(u)))
    estimate = _onePass(event.evaluate, 3, 100, 7000, np.random.default_rng(0))
    assert (estimate.probability, estimate.upperBound) == (0.0, 0.1)
    assert len(estimate.runs) == 1000


@pytest.mark.parametrize("policy", ["failure", "safe"])
def test_runs_that_are_not_finite_are_as_deep_on_their_side_as_can_be(policy):
    # A fifth of the points have no value.
    bound = ot.DistFunc.qNormal(0.8)
    estimate, _ = simulate(
        3.0, 7000, policy=policy, evaluate=lambda u: np.where(u[:, 1] > bound, np.nan, 3.0 - u[:, 0])
    )
    tail = ot.DistFunc.pNormal(-3.0)
    expected = 0.2 + 0.8 * tail if policy == "failure" else 0.8 * tail
    assert estimate.probability == pytest.approx(expected, rel=0.35)


def test_the_chains_are_stationary_and_move():
    """Points of the last level follow the normal law beyond it, and a chain's are not all the same."""
    event, _ = limitState(3.0)
    estimate = _onePass(event.evaluate, 3, 400, 30_000, np.random.default_rng(1))
    last = estimate.runs.u[-3600:]
    failed = last[last[:, 0] > 3.0]
    assert failed[:, 0].mean() == pytest.approx(ot.DistFunc.dNormal(3.0) / ot.DistFunc.pNormal(-3.0), abs=0.06)
    assert failed[:, 1].std() == pytest.approx(1.0, abs=0.12)
    assert len(np.unique(last[:, 0])) == 3600


def test_the_variation_of_a_level_grows_with_the_correlation_of_its_chains():
    generator = np.random.default_rng(0)
    independent = generator.random((10, 100))
    indicator = (independent <= 0.3).reshape(-1)
    share = indicator.mean()
    plain = math.sqrt((1.0 - share) / (share * 1000))
    assert _levelVariation(indicator, None, 0.3) == pytest.approx(plain)
    assert _levelVariation(indicator, independent, 0.3) == pytest.approx(plain, rel=0.15)
    # Chains that never move are worth their first point: ten times the variance.
    stuck = np.repeat(independent[:1], 10, axis=0)
    indicator = (stuck <= 0.3).reshape(-1)
    share = indicator.mean()
    expected = math.sqrt((1.0 - share) / (share * 1000) * 10.0)
    assert _levelVariation(indicator, stuck, 0.3) == pytest.approx(expected)
    assert _levelVariation(np.zeros(10, dtype=bool), None, 0.0) == math.inf
    assert _levelVariation(np.ones(10, dtype=bool), np.zeros((2, 5)), 0.0) == 0.0


def test_the_claimed_error_is_an_upper_bound_of_the_real_one():
    estimates = [simulate(3.0, 3000, seed)[0] for seed in range(20)]
    probabilities = np.array([estimate.probability for estimate in estimates])
    scatter = probabilities.std(ddof=1) / probabilities.mean()
    assert probabilities.mean() == pytest.approx(ot.DistFunc.pNormal(-3.0), rel=0.25)
    claimed = np.median([estimate.coefficientOfVariation for estimate in estimates])
    assert 0.9 * scatter < claimed < 3.0 * scatter
    assert all(isinstance(estimate, SubsetEstimate) for estimate in estimates)
