"""Estimates from blocks of true runs: shares, variances, freedom, and the same again from the marked runs."""

import math

import numpy as np
import pytest
from reliability_events import event, recorded
from scipy.stats import norm

from satsep_ot.methods.reliability.estimate import Block, CrudeEstimate, Estimate
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.sensitivity import computeProbability
from satsep_ot.methods.reliability.true_runs import TrueRuns


def block(weights, failed, expected=0.0, start=0, known=100, runVariance=0.0, own=0.0, poolVariance=0.0, proposal=None):
    """A block of runs of which only the weights, the labels and what was expected matter."""
    n = len(weights)
    runs = Runs(
        np.zeros((n, 1)), np.zeros((n, 1)), np.zeros((n, 1)), np.ones(n), np.asarray(failed, dtype=bool),
        np.ones(n, dtype=bool), np.full(n, "estimation"), np.asarray(weights, dtype=float), np.full(n, expected, float),
    )  # fmt: skip
    return Block(runs, start, known, runVariance, own, poolVariance, proposal)


def importanceBlock(size, generator, start=0, known=100, shift=3.0):
    """Runs of a shifted normal law on the event u > 3, with what a run was expected to add."""
    u = generator.standard_normal(size) + shift
    weights = np.exp(0.5 * shift**2 - shift * u)
    return block(weights, u > 3.0, start=start, known=known, runVariance=6e-6)


def test_an_estimate_of_one_block_is_its_own():
    one = block([0.1, 0.2, 0.3, 0.4], [True, False, True, False], expected=0.5, own=0.05)
    # 0.05 + (0.05 - 0.1 + 0.15 - 0.2) / 4
    assert Estimate([one]).probability == pytest.approx(0.05 - 0.1 / 4.0)
    assert Estimate([one]).surrogateProbability == 0.05
    assert Estimate([one]).failures == 2
    assert Estimate([one]).size == 4


def test_shares_follow_what_was_expected_and_never_what_was_found():
    weights = np.full(10, 1e-3)
    half = np.arange(10) < 5
    plain = [block(weights, half, runVariance=1e-6), block(np.tile(weights, 3), np.tile(half, 3), runVariance=1e-6)]
    np.testing.assert_allclose(Estimate(plain).shares, [0.25, 0.75])
    # Twice as exact a run, and twice as much known before.
    better = [block(weights, half, runVariance=2e-6), block(weights, half, runVariance=1e-6)]
    np.testing.assert_allclose(Estimate(better).shares, [1.0 / 3.0, 2.0 / 3.0])
    later = [block(weights, half, runVariance=1e-6), block(weights, half, runVariance=1e-6, known=300)]
    np.testing.assert_allclose(Estimate(later).shares, [0.25, 0.75])
    # The labels change nothing, with a surrogate that gives its own probability.
    for failed in (half, ~half, np.zeros(10, bool)):
        told = [block(weights, failed, runVariance=2e-6, own=5e-4), block(weights, half, runVariance=1e-6, own=5e-4)]
        np.testing.assert_allclose(Estimate(told).shares, [1.0 / 3.0, 2.0 / 3.0])


def test_a_block_of_a_surrogate_that_knew_another_probability_counts_less():
    weights, half = np.full(10, 1e-3), np.arange(10) < 5
    shares = []
    for own in (1e-3, 1.2e-3, 3e-3, 1e-4):
        blocks = [block(weights, half, runVariance=1e-6, own=own), block(weights, half, runVariance=1e-6, own=1e-3)]
        shares.append(Estimate(blocks).shares[0])
    # Within a quarter nothing is made of it.
    assert shares[0] == shares[1] == pytest.approx(0.5)
    assert shares[2] < 0.05
    assert shares[3] < 0.2


def test_the_variance_is_the_real_one_and_the_interval_covers():
    generator, truth = np.random.default_rng(0), norm.sf(3.0)
    estimates = [
        Estimate([importanceBlock(40, generator), importanceBlock(80, generator, 40, 140)]) for _ in range(1000)
    ]
    ratios = np.array([one.probability for one in estimates]) / truth
    claimed = np.array([one.coefficientOfVariation() for one in estimates])
    assert abs(ratios.mean() - 1.0) < 4.0 * ratios.std() / math.sqrt(len(ratios))
    # With few runs more is claimed: one run more could have changed the estimate.
    assert 0.95 < np.sqrt(np.mean(claimed**2)) / ratios.std() < 1.35
    inside = np.mean([lower <= truth <= upper for lower, upper in (one.interval(0.95) for one in estimates)])
    assert 0.94 < inside < 0.995


def test_one_more_run_could_have_disagreed():
    # A surrogate that all runs confirm: the observed variance is 0, the estimate is not certain.
    for size in (5, 50):
        sure = block(np.full(size, 2e-3), np.ones(size, bool), expected=1.0, own=1e-3)
        estimate = Estimate([sure])
        assert estimate.probability == pytest.approx(1e-3)
        assert estimate.effectiveFailures == pytest.approx(size)
        assert estimate.coefficientOfVariation() >= 1.0 / (1.0 + size) * (1.0 - 1e-9)
        assert estimate.coefficientOfVariation() < 1.5 / (1.0 + size)
    # Without a failure there is no estimate to be relative to.
    none = Estimate([block(np.ones(10), np.zeros(10, bool))])
    assert none.probability == 0.0
    assert none.coefficientOfVariation() == math.inf
    assert none.interval(0.95)[0] == 0.0


def test_the_expected_variance_is_a_floor():
    weights, half = np.full(10, 1e-3), np.arange(10) < 5
    low = Estimate([block(weights, half, runVariance=1e-12)])
    high = Estimate([block(weights, half, runVariance=1e-4)])
    assert high.variance >= 1e-4 / 10
    assert low.variance < high.variance


def test_blocks_of_one_pool_share_its_error():
    weights, half, pool = np.full(10, 1e-3), np.arange(10) < 5, object()
    alone = Estimate([block(weights, half), block(weights, half)]).variance

    def added(first, second):
        blocks = [block(weights, half, poolVariance=1e-6, proposal=part) for part in (first, second)]
        return Estimate(blocks).variance - alone

    assert added(pool, pool) == pytest.approx(1e-6)
    assert added(object(), object()) == pytest.approx(0.5e-6)


def test_few_large_corrections_have_little_freedom():
    even = Estimate([block(np.full(100, 1e-3), np.ones(100, bool))])
    uneven = Estimate([block(np.append(np.full(99, 1e-5), 1e-2), np.ones(100, bool))])
    assert even.freedom > 50.0
    assert uneven.freedom < 5.0
    lower, upper = uneven.interval(0.95)
    assert upper / lower > math.exp(2.0 * 1.96 * math.sqrt(math.log1p(uneven.coefficientOfVariation() ** 2)))


def test_the_estimate_again_from_marked_runs():
    _, recorder, generator = recorded(event(lambda u: 3.0 - u[:, 0], 2))
    recorder.evaluateNominal(7, "learning")
    blocks = []
    for size, own in ((30, 1.2e-3), (50, 1.4e-3)):
        start = len(recorder)
        u = generator.standard_normal((size, 2)) + [3.0, 0.0]
        runs = recorder.evaluate(u, "estimation")
        runs.weights, runs.expected = np.exp(4.5 - 3.0 * u[:, 0]), np.full(size, 0.4)
        blocks.append(Block(runs, start, start, 1e-6, own))
        recorder.explore(generator.standard_normal((4, 2)), "audit")
    estimate, runs = Estimate(blocks), recorder.runs()
    estimate.mark(runs)
    assert np.array_equal(np.isfinite(runs.weights), runs.phases == "estimation")
    true = TrueRuns(
        runs.x, runs.outputs, runs.failed, runs.phases, runs.weights, runs.expected, ("a", "b"), ("y",),
        estimate.surrogateProbability,
    )  # fmt: skip
    assert true.computeProbability() == pytest.approx(estimate.probability, rel=1e-12)
    # What was marked for another estimate is forgotten.
    Estimate(blocks[:1]).mark(runs)
    assert np.count_nonzero(np.isfinite(runs.weights)) == 30


def test_the_failure_sample_has_the_probability_of_the_estimate():
    limitState = LimitStateEvent(event(lambda u: 3.0 - u[:, 0], 2))
    generator = np.random.default_rng(0)
    blocks = []
    for size in (200, 300):
        u = generator.standard_normal((size, 2)) + [3.0, 0.0]
        runs = limitState.evaluate(u, "estimation")
        runs.weights = np.exp(4.5 - 3.0 * u[:, 0])
        blocks.append(Block(runs, 0, 100, 3e-6))
    estimate = Estimate(blocks)
    sample = estimate.makeFailureSample(limitState, generator)
    same = computeProbability(sample, limitState.distribution, limitState.distribution, 0.95)
    assert same.probability == pytest.approx(estimate.probability, rel=1e-9)


def test_crude_monte_carlo_is_the_share_of_failures():
    crude = CrudeEstimate(80, 1000)
    assert crude.probability == 0.08
    assert crude.variance == pytest.approx(0.08 * 0.92 / 1000)
    lower, upper = crude.confidenceInterval().bounds(0.95)
    assert lower < 0.08 < upper
    # Sixty failures at least, and the width that is asked for.
    assert not CrudeEstimate(59, 590).reaches(0.5)
    assert CrudeEstimate(80, 1000).reaches(0.15)
    assert not CrudeEstimate(80, 1000).reaches(0.1)
    assert CrudeEstimate(100, 100).reaches(0.05)
    assert not CrudeEstimate(0, 100_000).reaches(0.5)
