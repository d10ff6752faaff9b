"""ActiveSubspaceReliability against known probabilities, and against bad input."""

import dataclasses
import math
import pickle

import numpy as np
import openturns as ot
import pytest
from reliability_events import covers, event, run, solve
from scipy.stats import norm

from satsep_ot.methods.common.intervals import ConfidenceInterval, clopperPearson
from satsep_ot.methods.comparison.problems import getBenchmarkProblem
from satsep_ot.methods.reliability import run as runs_of
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.estimate import paretoShape
from satsep_ot.methods.reliability.limit_state import LimitStateEvent
from satsep_ot.methods.reliability.outcome import Ending
from satsep_ot.methods.reliability.subset_simulation import SubsetEstimate, combineEstimates, runSubsetSimulation
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate
from satsep_ot.openturns_adapter import callFunction


@pytest.fixture(autouse=True)
def _seed():
    ot.RandomGenerator.SetSeed(0)


# Known problems. -----------------------------------------------------------------------------------------------------


# Some more than the most that any of five seeds took.
@pytest.mark.parametrize(
    ("name", "runs"),
    [
        ("P1", 350),
        ("P2", 320),
        ("P4", 400),
        ("P5", 220),
        ("Norm35", 450),
        ("Speed35", 260),
        ("Absolute35", 350),
        ("Minimum35", 350),
    ],
)
def test_known_probability_within_few_runs(name, runs):
    result, truth = solve(name)
    assert result.getConverged(), result.getReason()
    assert result.getEvaluationNumber() <= runs
    assert result.getEvaluationNumber("audit") >= 80
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.15)
    assert result.getCoefficientOfVariation() <= 0.05
    assert covers(result, truth)
    assert result.getDiagnostics()["true failures"] >= 15


@pytest.mark.slow
def test_noisy_ridge_and_system_of_eight_ridges():
    for name in ("P3", "System35"):
        result, truth = solve(name)
        assert result.getConverged(), result.getReason()
        interval = result.getConfidenceInterval(0.999)
        assert interval.getLowerBound()[0] < truth < interval.getUpperBound()[0]


@pytest.mark.slow
def test_a_system_of_many_modes_costs_some_hundred_runs():
    ot.RandomGenerator.SetSeed(3)
    result, truth = solve("System35")
    assert result.getConverged()
    assert result.getEvaluationNumber() < 1000
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.06)


def test_physical_inputs_and_both_operators():
    result, truth = solve("RP8")
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.1)
    above = event(lambda x: x.sum(axis=1), operator=ot.Greater(), threshold=3.0 * math.sqrt(3.0))
    algorithm = ActiveSubspaceReliability(above)
    algorithm.run()
    assert algorithm.getResult().getProbabilityEstimate() == pytest.approx(ot.DistFunc.pNormal(-3.0), rel=0.1)


def test_union_and_intersection_of_events():
    x = ot.RandomVector(ot.Normal(2))
    members = [
        ot.ThresholdEvent(ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], [f]), x), ot.Greater(), 2.0)
        for f in ("a", "b")
    ]
    single = ot.DistFunc.pNormal(-2.0)
    for kind, truth in ((ot.UnionEvent, 2.0 * single - single**2), (ot.IntersectionEvent, single**2)):
        algorithm = ActiveSubspaceReliability(kind(members))
        algorithm.run()
        assert algorithm.getResult().getProbabilityEstimate() == pytest.approx(truth, rel=0.15)


def test_a_single_input():
    algorithm = ActiveSubspaceReliability(event(lambda u: np.exp(u[:, 0]), 1, ot.Greater(), math.exp(3.0)))
    algorithm.run()
    result = algorithm.getResult()
    assert result.getConverged()
    assert result.getProbabilityEstimate() == pytest.approx(ot.DistFunc.pNormal(-3.0), rel=0.1)


def test_correlated_inputs_go_through_their_transformation():
    distribution = ot.JointDistribution(
        [ot.Gumbel(1.0, 2.0), ot.Normal(5.0, 3.0)], ot.NormalCopula(ot.CorrelationMatrix([[1.0, 0.7], [0.7, 1.0]]))
    )
    algorithm = ActiveSubspaceReliability(event(lambda x: x.sum(axis=1), 2, ot.Greater(), 22.0, distribution))
    algorithm.run()
    result = algorithm.getResult()
    failures = np.count_nonzero(np.array(distribution.getSample(200_000)).sum(axis=1) > 22.0)
    lower, upper = clopperPearson(failures, 200_000, 0.999)
    interval = result.getConfidenceInterval(0.999)
    assert interval.getLowerBound()[0] < upper
    assert interval.getUpperBound()[0] > lower


MARGINALS = {
    "uniform": (ot.Uniform(0.0, 1.0), 0.999),
    "U-shaped": (ot.Beta(0.3, 0.6, 0.0, 1.0), 0.9999),
    "arcsine": (ot.Arcsine(-1.0, 1.0), 0.99999),
    "with a gap": (ot.Mixture([ot.Uniform(0.0, 1.0), ot.Uniform(3.0, 4.0)], [0.99, 0.01]), 3.9),
    "heavy-tailed": (ot.Gumbel(1.0, 0.0), 7.0),
}


@pytest.mark.parametrize(("marginal", "limit"), MARGINALS.values(), ids=MARGINALS.keys())
def test_bounded_and_heavy_tailed_inputs_cost_few_runs(marginal, limit):
    other = ot.Uniform(0.0, 1.0)
    theEvent = event(lambda x: limit - x[:, 0], 2, distribution=ot.JointDistribution([marginal, other]))
    result = run(theEvent, TargetCoefficientOfVariation=0.2)
    assert result.getConverged()
    assert covers(result, marginal.computeComplementaryCDF(limit))
    assert result.getEvaluationNumber() < 200


def test_a_margin_that_is_flat_where_inputs_are_likely_costs_some_hundred_runs():
    result = run(event(lambda u: np.minimum(0.5, 3.0 - u[:, 0]), 2), TargetCoefficientOfVariation=0.1)
    assert result.getConverged()
    assert covers(result, norm.sf(3.0))
    assert result.getEvaluationNumber() < 1000


def test_a_small_target_takes_as_many_points_of_the_surrogate_as_it_needs():
    algorithm = ActiveSubspaceReliability(event(lambda u: 3.0 - u[:, 0] - 0.05 * u[:, 1] ** 2))
    algorithm.setTargetCoefficientOfVariation(0.01)
    algorithm.run()
    result = algorithm.getResult()
    assert result.getConverged()
    assert result.getCoefficientOfVariation() <= 0.01
    grid = np.linspace(-8.0, 8.0, 4001)
    truth = np.sum(norm.sf(3.0 - 0.05 * grid**2) * norm.pdf(grid)) * (grid[1] - grid[0])
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.03)


# Honesty. ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("shift", [0.1, 0.3])
def test_estimate_is_unbiased_and_covered_with_a_deliberately_poor_surrogate(monkeypatch, shift):
    # The fit is spoilt by a shift of the predicted limit state: a small one is corrected, a large one is noticed.
    original = LimitStateSurrogate.limitState

    def spoilt(self, y, exact=True):
        value, scale = original(self, y, exact)
        return value + shift, np.maximum(scale, 0.3)

    monkeypatch.setattr(LimitStateSurrogate, "limitState", spoilt)
    truth = norm.sf(3.0)
    linear = event(lambda u: 3.0 - u.sum(axis=1) / 2.0, dimension=4)
    results = [run(linear, seed, TargetCoefficientOfVariation=0.1) for seed in range(16)]
    assert abs(np.mean([result.getProbabilityEstimate() for result in results]) / truth - 1.0) < 0.1
    assert sum(covers(result, truth, 0.95) for result in results) >= 13
    assert all(result.getMethod() == "ImportanceSampling" for result in results) == (shift == 0.3)


@pytest.mark.slow
def test_intervals_cover_a_noisy_ridge():
    w = np.ones(5) / math.sqrt(5.0)

    def evaluate(u):
        return 2.5 - u @ w + 0.3 * np.sin(4.0 * u).sum(axis=1) / math.sqrt(5.0)

    generator = np.random.default_rng(1)
    shifted = generator.standard_normal((400_000, 5)) + 2.5 * w
    truth = np.mean((evaluate(shifted) <= 0.0) * np.exp(-2.5 * shifted @ w + 0.5 * 2.5**2))
    covered, ratios = 0, []
    for _ in range(12):
        algorithm = ActiveSubspaceReliability(event(evaluate, 5))
        algorithm.setTargetCoefficientOfVariation(0.1)
        algorithm.run()
        interval = algorithm.getResult().getConfidenceInterval(0.95)
        covered += interval.getLowerBound()[0] <= truth <= interval.getUpperBound()[0]
        ratios.append(algorithm.getResult().getProbabilityEstimate() / truth)
    assert covered >= 10
    assert abs(np.mean(ratios) - 1.0) < 0.1


def test_reported_runs_are_the_calls_of_the_function():
    calls = [0]

    def evaluate(u):
        calls[0] += len(u)
        return 3.0 - u[:, 0]

    algorithm = ActiveSubspaceReliability(event(evaluate))
    algorithm.run()
    result = algorithm.getResult()
    assert result.getEvaluationNumber() == calls[0] == sum(result.getPhases().values())
    assert result.getEvaluationNumber("learning") < calls[0]
    assert result.getGradientNumber() == 0
    assert result.getInputSample().getSize() == calls[0]


def test_a_norm_without_a_subspace_is_known_to_be_known_poorly():
    # Failure in the corners of a 1-norm: no direction is better than another one, the radius tells a little.
    algorithm = ActiveSubspaceReliability(getBenchmarkProblem("P7").getEvent())
    algorithm.setMaximumEvaluations(3000)
    algorithm.run()
    result = algorithm.getResult()
    assert result.getEvaluationNumber() <= 3000
    interval = result.getConfidenceInterval(0.95)
    assert interval.getLowerBound()[0] <= getBenchmarkProblem("P7").getProbability() <= interval.getUpperBound()[0]
    assert not result.getConverged()
    assert result.getCoefficientOfVariation() > 0.1


def test_all_runs_failed_and_a_frequent_event():
    for threshold in (-8.0, 0.3):
        algorithm = ActiveSubspaceReliability(event(lambda u: u[:, 0], operator=ot.Greater(), threshold=threshold))
        algorithm.run()
        interval = algorithm.getResult().getConfidenceInterval(0.999)
        assert interval.getLowerBound()[0] <= ot.DistFunc.pNormal(-threshold) <= interval.getUpperBound()[0]
        assert interval.getUpperBound()[0] > interval.getLowerBound()[0]


def test_a_probability_is_never_above_1():
    for seed in range(10):
        ot.RandomGenerator.SetSeed(seed)
        algorithm = ActiveSubspaceReliability(event(lambda u: u[:, 0] - 3.719, 1))
        algorithm.run()
        result = algorithm.getResult()
        assert 0.99 < result.getProbabilityEstimate() <= 1.0
        assert result.getConfidenceInterval(0.95).contains([result.getProbabilityEstimate()])
        assert result.computeProbability(ot.Normal(1)).probability <= 1.0


def bound(result, level=0.95):
    interval = result.getConfidenceInterval(level)
    return interval.getLowerBound()[0], interval.getUpperBound()[0]


@pytest.mark.parametrize(("value", "probability"), [(1.0, 0.0), (-1.0, 1.0)])
def test_constant_function_has_its_bound(value, probability):
    result = run(event(lambda u: np.full(len(u), value)), MaximumEvaluations=1000)
    lower, upper = bound(result)
    runs = result.getTrueRuns()
    nominal = int(np.count_nonzero(np.isin(runs.phases, ("learning", "Monte Carlo"))))
    assert result.getProbabilityEstimate() == probability
    # Only what was drawn from the inputs' own distribution bounds it.
    assert upper - lower == pytest.approx(1.0 - 0.05 ** (1.0 / nominal))
    assert result.getConverged() == (probability == 1.0)
    assert result.getEvaluationNumber() <= 1000
    assert runs.computeProbability() == probability
    assert result.getEnding() is Ending.CONSTANT
    assert "is constant in the first 12 runs" in result.getReason()
    assert result.getActiveDimensions() == []


def test_no_failure_seen_has_an_upper_bound():
    result = run(event(lambda u: 60.0 - u[:, 0]), MaximumEvaluations=1000)
    lower, upper = bound(result)
    assert result.getProbabilityEstimate() == lower == 0.0
    runs = result.getTrueRuns()
    nominal = runs.inputs[np.isfinite(runs.weights)]
    # The runs that bound it are those drawn from the inputs' own distribution.
    assert upper == pytest.approx(1.0 - 0.05 ** (1.0 / len(nominal)))
    assert len(runs) == result.getEvaluationNumber() == 1000
    np.testing.assert_allclose(nominal.std(axis=0), 1.0, atol=5.0 / math.sqrt(len(nominal)))
    np.testing.assert_allclose(nominal.mean(axis=0), 0.0, atol=4.0 / math.sqrt(len(nominal)))
    assert runs.computeProbability() == 0.0
    assert f"the estimate is from {len(nominal)} crude Monte Carlo runs" in result.getReason()
    assert result.getMethod() == "MonteCarlo"
    assert not result.getConverged()


@pytest.mark.parametrize("seed", range(2))
def test_a_jump_is_known_to_the_precision_that_is_asked(seed):
    for target, runs in ((0.1, 3300), (0.3, 2500)):
        jump = event(lambda u: np.where(u[:, 0] > 2.5, -1.0, 1.0), 12)
        result = run(jump, seed, TargetCoefficientOfVariation=target)
        assert covers(result, norm.sf(2.5))
        assert result.getConverged()
        assert result.getCoefficientOfVariation() <= target
        assert result.getEvaluationNumber() < runs


@pytest.mark.parametrize("seed", range(2))
def test_an_event_that_fails_nearly_always_is_known_by_its_complement(seed):
    for evaluate in (lambda u: np.where(u[:, 0] > -2.0, -1.0, 1.0), lambda u: -2.0 - u[:, 0]):
        result = run(event(evaluate, 12), seed)
        lower, upper = bound(result, 0.999)
        assert lower < norm.cdf(2.0) < upper
        # To 5 % of what is missing to 1.
        assert result.getStandardDeviation() <= 0.05 * (1.0 - result.getProbabilityEstimate()) * (1.0 + 1e-9)
        assert result.getConverged()
        runs = result.getTrueRuns()
        assert runs.computeProbability() == pytest.approx(result.getProbabilityEstimate(), rel=1e-9)
        assert runs.failed.mean() > 0.2
        np.testing.assert_array_equal(runs.failed, runs.outputs[:, 0] <= 0.0)


def test_failures_that_only_a_surrogate_claims_do_not_bound_the_probability():
    # A polynomial goes on beyond the bend; the event is impossible.
    result = run(event(lambda u: 4.0 - np.minimum(u[:, 0] + 0.1 * u[:, 1] ** 2, 3.9), 12), MaximumEvaluations=400)
    assert result.getDiagnostics()["true failures"] == 0.0
    assert not result.getConverged()
    lower, upper = bound(result)
    assert lower == 0.0
    # There are too few runs of the inputs' own distribution to say more.
    assert 3.0 / result.getEvaluationNumber() < upper < 0.2
    assert "crude Monte Carlo runs" in result.getReason()
    assert result.drawProbabilityConvergence().getDrawables().getSize() == 0


@pytest.mark.parametrize("seed", range(2))
def test_a_rare_region_without_values_is_bounded_before_the_end(seed):
    broken = event(lambda u: np.where(u[:, 1] > 2.0, np.nan, 3.0 - u[:, 0]), 12)
    tail, share = norm.sf(3.0), norm.sf(2.0)
    for policy, truth in (("failure", share + tail * (1.0 - share)), ("safe", tail * (1.0 - share))):
        result = run(broken, seed, NonFinitePolicy=policy, TargetCoefficientOfVariation=0.1)
        assert covers(result, truth)
        assert result.getDiagnostics()["not finite"] > 0


def test_runs_that_are_never_finite_keep_the_bound_of_their_policy():
    broken = event(lambda u: np.full(len(u), np.nan))
    for policy, probability in (("failure", 1.0), ("safe", 0.0)):
        result = run(broken, NonFinitePolicy=policy, MaximumEvaluations=500)
        assert result.getProbabilityEstimate() == probability
        assert result.getDiagnostics()["not finite"] == result.getEvaluationNumber()
        assert bound(result)[1] - bound(result)[0] > 3.0 / 500
        assert result.getEnding() is Ending.NEVER_FINITE
        assert result.getTrueRuns().computeProbability() == probability
    with pytest.raises(ValueError, match="not finite"):
        run(broken)


def test_a_function_that_raises_in_the_middle_leaves_its_runs():
    calls = [0]

    def evaluate(u):
        calls[0] += len(u)
        if calls[0] > 12:
            raise ArithmeticError("the simulator is out of memory")
        return 3.0 - u[:, 0]

    algorithm = ActiveSubspaceReliability(event(evaluate))
    with pytest.raises(RuntimeError, match=r"still has the 12 runs before it.*out of memory"):
        algorithm.run()
    inputs, outputs = algorithm.getRuns()
    assert inputs.getSize() == outputs.getSize() == 12
    with pytest.raises(RuntimeError, match="in a block of 6 runs of which none is kept; no run before it"):
        algorithm.run()
    with pytest.raises(RuntimeError, match=r"no true runs.*ended before its first block"):
        algorithm.getRuns()
    with pytest.raises(RuntimeError, match="run"):
        algorithm.getResult()


def test_a_function_that_raises_far_out_does_not_end_a_run():
    def evaluate(u):
        if (np.abs(u) > 4.5).any():
            raise ArithmeticError("no steady state")
        return 3.0 - u[:, 0]

    result = run(event(evaluate))
    assert result.getConverged()
    assert covers(result, norm.sf(3.0))
    assert "far from where inputs are likely gave no value" in result.getReason()


def test_too_few_evaluations_are_refused_with_the_least_number():
    algorithm = ActiveSubspaceReliability(event(lambda u: 3.0 - u[:, 0]))
    algorithm.setMaximumEvaluations(12)
    with pytest.raises(ValueError, match="with 3 inputs at least 13 are needed"):
        algorithm.run()
    algorithm.setMaximumEvaluations(13)
    algorithm.run()
    assert algorithm.getResult().getEvaluationNumber() <= 13
    assert not algorithm.getResult().getConverged()


@pytest.mark.parametrize("maximum", [13, 14, 30, 60, 99, 150, 230])
def test_no_run_is_made_beyond_the_maximum(maximum):
    for evaluate in (lambda u: 3.0 - u[:, 0], lambda u: np.where((u[:, 0] > 1.2) & (u[:, 1] > 0.8), -1.0, 1.0)):
        result = run(event(evaluate), maximum, MaximumEvaluations=maximum)
        assert result.getEvaluationNumber() == len(result.getTrueRuns()) <= maximum
        assert bound(result)[0] < result.getProbabilityEstimate() + 1e-12


def test_the_safe_mode_looks_longer_in_all_directions():
    fast, safe = (run(event(lambda u: 3.0 - u[:, 0]), Mode=mode) for mode in ("fast", "safe"))
    assert fast.getEvaluationNumber("audit") >= 80
    assert safe.getEvaluationNumber("audit") >= 240
    for result in (fast, safe):
        assert result.getConverged()
        assert covers(result, norm.sf(3.0))


def test_a_rough_target_costs_few_runs():
    result = run(event(lambda u: 3.0 - u[:, 0]), TargetCoefficientOfVariation=0.5)
    assert result.getConverged()
    assert result.getEvaluationNumber() <= 80
    assert result.getEvaluationNumber("audit") >= 32
    assert covers(result, norm.sf(3.0))


@pytest.mark.parametrize("seed", range(3))
def test_an_interval_is_as_wide_as_the_claimed_error(seed):
    # Of an exact surrogate and of a poor one.
    for evaluate in (lambda u: 3.0 - u[:, 0], lambda u: 2.5 - u[:, 0] - 0.3 * np.sin(4.0 * u[:, 1])):
        result = run(event(evaluate), seed)
        lower, upper = bound(result)
        assert result.getConverged()
        width = math.log(upper / lower) / result.getCoefficientOfVariation()
        # Normal quantiles at least, Student ones of a few degrees of freedom at most.
        assert 2.0 * 1.95 < width < 2.0 * 3.2


@pytest.mark.parametrize("index", [6.4, 9.0])
def test_the_rarest_events_have_no_floor(index):
    result = run(event(lambda u: index - u @ [0.6, 0.8, 0.0]))
    assert result.getConverged()
    assert result.getEvaluationNumber() < 300
    assert result.getProbabilityEstimate() == pytest.approx(norm.sf(index), rel=0.15)


# The verdict on an allowed probability. ------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_a_run_ends_as_soon_as_the_verdict_is_known(seed):
    truth = norm.sf(2.5)
    for allowed, ending in ((10.0 * truth, Ending.BELOW_ALLOWED), (0.1 * truth, Ending.ABOVE_ALLOWED)):
        result = run(
            event(lambda u: 2.5 - u[:, 0]), seed, AllowedProbability=allowed, TargetCoefficientOfVariation=0.01
        )
        assert result.getEnding() is ending
        assert result.getConverged()
        assert f"the allowed one, {allowed}" in result.getReason()
        assert covers(result, truth)
        assert result.getEvaluationNumber() < 250
    # What is allowed to be above needs no wide runs, and what is below all of them.
    below = run(event(lambda u: 2.5 - u[:, 0]), seed, AllowedProbability=0.1)
    assert below.getEvaluationNumber("audit") >= 80


def test_a_verdict_waits_for_the_precision_that_is_asked_for():
    truth = norm.sf(2.5)
    for allowed, ending in ((10.0 * truth, Ending.BELOW_ALLOWED), (0.1 * truth, Ending.ABOVE_ALLOWED)):
        algorithm = ActiveSubspaceReliability(event(lambda u: 2.5 - u[:, 0]))
        algorithm.setAllowedProbability(allowed, 0.1)
        algorithm.setTargetCoefficientOfVariation(0.01)
        ot.RandomGenerator.SetSeed(0)
        algorithm.run()
        result = algorithm.getResult()
        assert result.getEnding() is ending
        assert result.getCoefficientOfVariation() <= 0.1
        # Then both bounds of the interval are known.
        assert result.getConfidenceInterval(0.95).getUpperBound()[0] < 2.0 * truth
    with pytest.raises(ValueError, match=r"the coefficient of variation is 0\.0; it must be positive"):
        algorithm.setAllowedProbability(1e-3, 0.0)


def test_the_verdict_of_the_complement():
    truth = norm.cdf(2.5)
    for allowed, ending in ((0.9, Ending.ABOVE_ALLOWED), (0.9999, Ending.BELOW_ALLOWED)):
        result = run(event(lambda u: -2.5 - u[:, 0]), AllowedProbability=allowed, TargetCoefficientOfVariation=0.01)
        assert result.getEnding() is ending
        assert covers(result, truth)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.75, 1.3])
def test_few_verdicts_are_wrong(ratio):
    # A budget that a verdict is often reached with, near the allowed probability where it is hardest.
    truth, verdicts, wrong, repetitions = norm.sf(2.0), 0, 0, 300
    right = Ending.BELOW_ALLOWED if ratio > 1.0 else Ending.ABOVE_ALLOWED
    for seed in range(repetitions):
        result = run(
            event(lambda u: 2.0 - u[:, 0]), seed,
            AllowedProbability=ratio * truth, TargetCoefficientOfVariation=0.02, MaximumEvaluations=600,
        )  # fmt: skip
        ending = result.getEnding()
        reached = ending in (Ending.BELOW_ALLOWED, Ending.ABOVE_ALLOWED)
        verdicts += reached
        wrong += reached and ending is not right
    assert verdicts > 0.5 * repetitions
    # 5 %, and what 300 repetitions may add to it in one of a thousand cases.
    assert wrong <= 0.05 * repetitions + 3.1 * math.sqrt(0.05 * 0.95 * repetitions)


# After a hand-over. --------------------------------------------------------------------------------------------------


def handedOver(monkeypatch, probability, variation, level):
    """The result of a run that finds no failure, whose subset simulation finds what is told."""

    def simulation(evaluate, dimension, maximumEvaluations, generator):
        return SubsetEstimate(probability, variation, level, evaluate(np.zeros((maximumEvaluations, dimension))))

    monkeypatch.setattr(runs_of, "runSubsetSimulation", simulation)
    return run(event(lambda u: 60.0 - u[:, 0]), MaximumEvaluations=1000, TargetCoefficientOfVariation=0.3)


@pytest.mark.parametrize(("variation", "converged"), [(0.3, True), (0.31, False)])
def test_what_subset_simulation_found_is_the_result_after_a_hand_over(monkeypatch, variation, converged):
    result = handedOver(monkeypatch, 2e-3, variation, 2e-3)
    assert result.getMethod() == "SubsetSimulation"
    assert result.getEnding() is Ending.NO_FAILURE_REGION
    assert result.getProbabilityEstimate() == 2e-3
    assert result.getCoefficientOfVariation() == pytest.approx(variation)
    assert result.getVarianceEstimate() == pytest.approx((variation * 2e-3) ** 2)
    assert result.getConverged() == converged
    assert result.getEvaluationNumber() == 1000
    # A log-normal estimate: the bounds are factors of it.
    factor = math.exp(1.959964 * math.sqrt(math.log1p(variation**2)))
    assert bound(result) == pytest.approx((2e-3 / factor, 2e-3 * factor), rel=1e-5)
    with pytest.raises(ValueError, match="has a weight: they depend on each other"):
        result.getTrueRuns().computeProbability()


def test_a_hand_over_that_finds_nothing_keeps_the_bound_of_the_normal_runs(monkeypatch):
    result = handedOver(monkeypatch, 0.0, math.inf, 1e-5)
    assert "found no failure before the evaluations ended, at a level of probability 1.0e-05" in result.getReason()
    assert result.getLevelReached() == 1e-5
    assert result.getEnding() is Ending.NO_FAILURE_REGION
    assert result.getProbabilityEstimate() == 0.0
    assert not result.getConverged()
    # Six normal runs without failure.
    assert bound(result)[1] == pytest.approx(1.0 - 0.05 ** (1.0 / 6.0))
    assert result.getReliabilityIndex() == math.inf
    assert result.drawProbabilityConvergence().getDrawables().getSize() == 0


def test_a_periodic_function_of_many_inputs_is_covered():
    # A sum of waves: no polynomial of few directions shows it.
    result = run(event(lambda u: 4.5 - np.sin(7.0 * u).sum(axis=1), 20), MaximumEvaluations=2500)
    phase = 2.0 * math.pi * np.random.default_rng(0).random((200_000, 20))
    truth = np.mean(np.sin(phase).sum(axis=1) >= 4.5)
    assert covers(result, truth)
    assert result.getEvaluationNumber() <= 2500


def test_results_without_a_surrogate_or_an_estimate_say_so():
    sure = run(event(lambda u: np.full(len(u), -1.0)), MaximumEvaluations=500)
    assert sure.getReliabilityIndex() == -math.inf
    for level in (0.0, 1.0):
        with pytest.raises(ValueError, match="must lie between 0 and 1"):
            sure.getConfidenceInterval(level)
        with pytest.raises(ValueError, match="must lie between 0 and 1"):
            sure.computeImportance(level)
    stopped = run(event(lambda u: 3.0 - u[:, 0]), StopCallback=lambda: True)
    with pytest.raises(RuntimeError, match="no surrogate"):
        stopped.getDirections()


# Bad input. ----------------------------------------------------------------------------------------------------------


def test_values_that_are_not_finite_raise_or_are_counted():
    def evaluate(u):
        return np.where(u[:, 1] > 1.5, np.nan, 3.0 - u[:, 0])

    broken = event(evaluate)
    algorithm = ActiveSubspaceReliability(broken)
    with pytest.raises(ValueError, match=r"row \d+: input x0 = "):
        algorithm.run()
    share, tail = ot.DistFunc.pNormal(-1.5), ot.DistFunc.pNormal(-3.0)
    algorithm.setNonFinitePolicy("safe")
    algorithm.run()
    safe = algorithm.getResult()
    assert safe.getDiagnostics()["not finite"] > 0
    assert safe.getConfidenceInterval(0.999).getLowerBound()[0] < tail * (1.0 - share)
    assert safe.getConfidenceInterval(0.999).getUpperBound()[0] > tail * (1.0 - share)
    algorithm.setNonFinitePolicy("failure")
    algorithm.run()
    failure = algorithm.getResult()
    assert failure.getConfidenceInterval(0.999).getUpperBound()[0] > share
    assert failure.getProbabilityEstimate() > 10.0 * safe.getProbabilityEstimate()


@pytest.mark.parametrize("threshold", [math.inf, -math.inf, math.nan])
def test_non_finite_threshold_is_refused(threshold):
    with pytest.raises(ValueError, match="threshold"):
        ActiveSubspaceReliability(event(lambda u: u[:, 0], threshold=threshold)).run()


def test_callbacks_can_be_lambdas_and_stop():
    seen = []
    algorithm = ActiveSubspaceReliability(event(lambda u: 3.0 - u[:, 0]))
    algorithm.setProgressCallback(lambda percentage: seen.append(percentage))
    algorithm.setStopCallback(lambda: len(seen) >= 2)
    algorithm.run()
    result = algorithm.getResult()
    assert len(seen) == 2
    assert 0.0 < seen[0] < seen[1] <= 100.0
    assert "stop callback" in result.getReason()
    assert result.getEnding() is Ending.STOPPED
    assert not result.getConverged()
    assert result.getConfidenceInterval().getUpperBound()[0] > 0.0


@pytest.mark.parametrize("what", ["Progress", "Stop"])
def test_a_callback_that_cannot_be_called_is_refused_at_once(what):
    algorithm = ActiveSubspaceReliability(event(lambda u: 3.0 - u[:, 0]))
    getattr(algorithm, f"set{what}Callback")(None)
    with pytest.raises(TypeError, match=f"the {what.lower()} callback is of type int; it must be callable"):
        getattr(algorithm, f"set{what}Callback")(3)


@pytest.mark.parametrize(
    ("setter", "value"),
    [
        ("TargetCoefficientOfVariation", 0.0),
        ("TargetCoefficientOfVariation", 0.009),
        ("TargetCoefficientOfVariation", 0.51),
        ("TargetCoefficientOfVariation", math.nan),
        ("AllowedProbability", 0.0),
        ("AllowedProbability", 1.0),
        ("AllowedProbability", math.nan),
        ("MaximumEvaluations", 0),
        ("Mode", "brave"),
        ("NonFinitePolicy", "ignore"),
    ],
)
def test_bad_settings_are_refused(setter, value):
    algorithm = ActiveSubspaceReliability(event(lambda u: u[:, 0]))
    with pytest.raises(ValueError, match=str(value)):
        getattr(algorithm, f"set{setter}")(value)


def test_inputs_without_a_normal_standard_space_are_refused():
    for distribution in (
        ot.JointDistribution([ot.Normal(), ot.Bernoulli(0.5)]),
        ot.Student(3.0, [0.0] * 2, [1.0] * 2, ot.CorrelationMatrix(2)),
        ot.JointDistribution([ot.Normal(), ot.Normal()], ot.StudentCopula(3.0, ot.CorrelationMatrix(2))),
    ):
        with pytest.raises(ValueError, match="standard"):
            ActiveSubspaceReliability(event(lambda u: u[:, 0], 2, distribution=distribution)).run()


def test_components_that_do_not_compose_the_event_are_refused():
    function = ot.SymbolicFunction(["a", "b"], ["a", "b"])
    scalar = ot.SymbolicFunction(["a", "b"], ["a + b"])
    vector = ot.CompositeRandomVector(scalar, ot.RandomVector(ot.Normal(2)))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 3.0))
    algorithm.setComponents(function, ot.SymbolicFunction(["a", "b"], ["a - b"]))
    with pytest.raises(ValueError, match="does not give the event's variable"):
        algorithm.run()
    algorithm.setComponents(function, ot.SymbolicFunction(["a"], ["a"]))
    with pytest.raises(ValueError, match="must map the 2 outputs"):
        algorithm.run()
    algorithm.setComponents(function, scalar, [0, 5])
    with pytest.raises(ValueError, match="smooth indices"):
        algorithm.run()


@pytest.mark.parametrize("formula", ["sqrt(y)", "numpy"])
def test_a_composition_that_is_not_defined_where_a_surrogate_reaches_is_named(formula):
    component = ot.SymbolicFunction(["a", "b"], ["exp(2 * a) + 0.1 * b^2"])
    reduced = (
        ot.SymbolicFunction(["y"], [formula])
        if formula != "numpy"
        else ot.PythonFunction(
            1, 1, func_sample=lambda y: np.where(np.array(y) < 0.0, np.nan, np.abs(np.array(y)) ** 0.5)
        )
    )
    vector = ot.CompositeRandomVector(ot.ComposedFunction(reduced, component), ot.RandomVector(ot.Normal(2)))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 8.0))
    algorithm.setComponents(component, reduced)
    with pytest.raises(RuntimeError, match="must be defined for all their values, also where surrogates reach: "):
        algorithm.run()
    assert algorithm.getRuns()[0].getSize() > 0


def test_events_and_components_that_cannot_be_treated_are_refused_with_the_reason():
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["a", "b"]), ot.RandomVector(ot.Normal(2)))
    everywhere = ot.Interval([0.0] * 2, [1.0] * 2, [False] * 2, [False] * 2)
    with pytest.raises(ValueError, match="no finite bound"):
        LimitStateEvent(ot.DomainEvent(vector, everywhere))
    mesh = ot.IntervalMesher([2, 2]).build(ot.Interval(2))
    with pytest.raises(TypeError, match="has no limit state function; give an Interval or a LevelSet, or a union"):
        LimitStateEvent(ot.DomainEvent(vector, ot.MeshDomain(mesh)))
    two = ot.SymbolicFunction(["a", "b"], ["a", "b"])
    total = ot.SymbolicFunction(["p", "q"], ["p + q"])
    with pytest.raises(TypeError, match="for a ThresholdEvent only, not for a DomainEvent"):
        LimitStateEvent(ot.DomainEvent(vector, ot.Interval(2)), two, total)
    scalar = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["a + b"]), ot.RandomVector(ot.Normal(2)))
    threshold = ot.ThresholdEvent(scalar, ot.Greater(), 3.0)
    with pytest.raises(ValueError, match="has 1 inputs, but the event's distribution has 2"):
        LimitStateEvent(threshold, ot.SymbolicFunction(["a"], ["a"]), total)
    for indices in ([], [0, 2], [-1, 0]):
        with pytest.raises(ValueError, match=r"the smooth indices are .*; they must lie in 0 to 1"):
            LimitStateEvent(threshold, two, total, indices)
    with pytest.raises(ValueError, match="must map the 1 smooth outputs on 1 value, but it maps 2 on 1"):
        LimitStateEvent(threshold, two, total, [0])
    with pytest.raises(ValueError, match="'ignore'; give one of"):
        LimitStateEvent(threshold, nonFinitePolicy="ignore")


def test_there_is_nothing_to_get_before_a_run():
    algorithm = ActiveSubspaceReliability(event(lambda u: u[:, 0]))
    with pytest.raises(RuntimeError, match=r"no true runs: run\(\) was not called"):
        algorithm.getRuns()
    with pytest.raises(RuntimeError, match="no result yet"):
        algorithm.getResult()


# The result. ---------------------------------------------------------------------------------------------------------


def test_smooth_components_of_a_kinked_output_and_the_result_objects():
    # The third output is exact but kinked; its surrogate is composed of the first two.
    function = ot.SymbolicFunction(["a", "b", "c"], ["a + 0.05 * c", "b", "min(a + 0.05 * c, b)"])
    composition = ot.SymbolicFunction(["p", "q", "r"], ["r"])
    reduced = ot.SymbolicFunction(["p", "q"], ["min(p, q)"])
    vector = ot.CompositeRandomVector(ot.ComposedFunction(composition, function), ot.RandomVector(ot.Normal(3)))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 1.5))
    algorithm.setComponents(function, composition, [0, 1], reduced)
    algorithm.run()
    result = algorithm.getResult()
    truth = ot.DistFunc.pNormal(-1.5) * ot.DistFunc.pNormal(-1.5 / math.sqrt(1.0 + 0.05**2))
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.1)
    assert result.getActiveDimensions() == [1, 1]
    assert result.getDirections().getNbRows() == 3
    assert result.getReliabilityIndex() == pytest.approx(-ot.DistFunc.qNormal(result.getProbabilityEstimate()))
    simulation = result.getProbabilitySimulationResult()
    assert simulation.getProbabilityEstimate() == result.getProbabilityEstimate()
    assert simulation.getVarianceEstimate() == pytest.approx(result.getStandardDeviation() ** 2)
    surrogate = result.getMetaModelResult().getMetaModel()
    point = [0.3, -0.4, 1.2]
    np.testing.assert_allclose(surrogate(point), np.array(function(point))[:2], atol=1e-6)
    assert len(result.drawProbabilityConvergence().getDrawables()) == 3
    assert len(result.drawLimitState().getDrawables()) >= 2
    assert "probability=" in repr(result)
    inner, outer = result.getConfidenceInterval(0.5), result.getConfidenceInterval(0.99)
    assert outer.getLowerBound()[0] < inner.getLowerBound()[0] < inner.getUpperBound()[0] < outer.getUpperBound()[0]
    with pytest.raises(ValueError, match="level"):
        result.getConfidenceInterval(1.0)
    with pytest.raises(ValueError, match="phase"):
        result.getEvaluationNumber("nap")


def test_same_seed_gives_the_same_answer():
    estimates = []
    for seed in (3, 3, 4):
        ot.RandomGenerator.SetSeed(seed)
        algorithm = ActiveSubspaceReliability(event(lambda u: 3.0 - u[:, 0] - 0.1 * u[:, 1] ** 2))
        algorithm.run()
        estimates.append(algorithm.getResult().getProbabilityEstimate())
    assert estimates[0] == estimates[1] != estimates[2]


def test_a_surrogate_of_the_radius_has_no_native_function_and_one_of_one_direction_a_plain_picture():
    radial, _ = solve("P5")
    with pytest.raises(ValueError, match="inactive radius"):
        radial.getMetaModelResult()
    result = run(event(lambda u: 3.0 - u[:, 0], 12))
    graph = result.drawLimitState()
    assert graph.getTitle() == "Limit state along the active direction"
    active = np.array(result.getInputSample())[:, 0]
    lines = [np.array(d.getData()) for d in graph.getDrawables() if d.getImplementation().getClassName() == "Curve"]
    assert len(lines) == 1
    np.testing.assert_allclose(lines[0][:, 1], 0.0)
    assert np.ptp(lines[0][:, 0]) == pytest.approx(np.ptp(active), rel=1e-6)


def test_a_result_goes_to_another_process_and_keeps_the_names_of_the_outputs():
    function = ot.SymbolicFunction(["a", "b"], ["a + b"])
    function.setOutputDescription(["sag"])
    vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(2)))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 4.0))
    algorithm.run()
    result = algorithm.getResult()
    again = pickle.loads(pickle.dumps(result))
    assert again.getProbabilityEstimate() == result.getProbabilityEstimate()
    assert again.computeImportance() == result.computeImportance()
    assert again.getDirections() == result.getDirections()
    for sample in (again.getOutputSample(), algorithm.getRuns()[1]):
        assert list(sample.getDescription()) == ["sag"]
    assert again.getTrueRuns().outputNames == ("sag",)


def test_an_event_on_a_level_set_and_on_an_interval():
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["a", "b"]), ot.RandomVector(ot.Normal(2)))
    disc = ot.LevelSet(ot.SymbolicFunction(["p", "q"], ["p^2 + q^2"]), ot.GreaterOrEqual(), 9.0)
    box = ot.Interval([2.0, -1.0], [9.0, 1.0], [True, True], [False, True])
    points = np.array([[3.0, 0.0], [2.9, 0.0], [0.0, -3.1], [2.5, -1.1]])
    for domain, failed in ((disc, [True, False, True, False]), (box, [True, True, False, False])):
        event = LimitStateEvent(ot.DomainEvent(vector, domain))
        np.testing.assert_array_equal(event.evaluate(points).failed, failed)
    algorithm = ActiveSubspaceReliability(ot.DomainEvent(vector, disc))
    algorithm.run()
    assert algorithm.getResult().getProbabilityEstimate() == pytest.approx(math.exp(-4.5), rel=0.15)


# The parts. ----------------------------------------------------------------------------------------------------------


def test_clopper_pearson_is_the_inverse_of_the_binomial():
    lower, upper = clopperPearson(7, 200, 0.9)
    assert ot.Binomial(200, upper).computeCDF([7.0]) == pytest.approx(0.05, rel=1e-6)
    assert 1.0 - ot.Binomial(200, lower).computeCDF([6.0]) == pytest.approx(0.05, rel=1e-6)


def test_pareto_shape_of_exponential_and_heavy_tails():
    generator = np.random.default_rng(0)
    assert abs(paretoShape(generator.exponential(size=20_000))) < 0.1
    assert paretoShape(generator.pareto(1.5, size=20_000)) == pytest.approx(1.0 / 1.5, abs=0.15)


def test_subset_simulation_is_right_on_average_and_keeps_its_limit():
    limitState = LimitStateEvent(event(lambda u: 3.5 - u[:, 0], 10))
    generator = np.random.default_rng(0)
    estimates = [runSubsetSimulation(limitState.evaluate, 10, 3000, generator) for _ in range(20)]
    truth = ot.DistFunc.pNormal(-3.5)
    ratios = np.array([estimate.probability for estimate in estimates]) / truth
    assert all(len(estimate.runs) <= 3000 for estimate in estimates)
    assert abs(ratios.mean() - 1.0) < 4.0 * ratios.std() / math.sqrt(len(ratios))
    # The claimed error is an upper bound.
    assert np.median([estimate.coefficientOfVariation for estimate in estimates]) > 0.8 * ratios.std()


def test_subset_simulations_that_disagree_are_known_to_be_wrong():
    limitState = LimitStateEvent(event(lambda u: 2.0 - u[:, 0]))
    runs = limitState.evaluate(np.zeros((100, 3)))
    right, lost = SubsetEstimate(2e-4, 0.5, 2e-4, runs), SubsetEstimate(1e-7, 0.5, 1e-7, runs)
    both = combineEstimates([right, lost])
    assert both.probability == pytest.approx(1e-4, rel=1e-2)
    assert both.coefficientOfVariation == pytest.approx(1.0, rel=1e-2)
    assert combineEstimates([right, right]).coefficientOfVariation == pytest.approx(0.5 / math.sqrt(2.0))
    nothing = SubsetEstimate(0.0, math.inf, 1e-3, runs)
    assert combineEstimates([right, nothing]).coefficientOfVariation == pytest.approx(
        0.5 * math.hypot(1e-4, 1e-3) / 1e-4
    )
    assert math.isinf(combineEstimates([nothing, nothing]).coefficientOfVariation)


def test_a_function_is_called_with_the_values_that_it_is_given():
    function = ot.SymbolicFunction(["a", "b"], ["a - 2 * b", "b"])
    points = np.arange(12.0).reshape(2, 6).T
    np.testing.assert_array_equal(callFunction(function, points), points @ [[1.0, 0.0], [-2.0, 1.0]])
    np.testing.assert_array_equal(callFunction(function, points[::2].astype(int)), callFunction(function, points)[::2])


def test_unused_outputs_are_not_modelled():
    problem = getBenchmarkProblem("Norm35")
    limitState = LimitStateEvent(problem.getEvent(), *problem.getComponents())
    runs = limitState.evaluate(np.random.default_rng(0).standard_normal((50, 35)))
    before = limitState.surrogateMargin(limitState.smooth(runs.outputs))
    limitState.dropUnusedOutputs(runs.outputs)
    assert limitState.smoothIndices == [1, 3]
    np.testing.assert_array_equal(limitState.surrogateMargin(limitState.smooth(runs.outputs)), before)


def test_every_field_of_runs_is_concatenated():
    runs = LimitStateEvent(event(lambda u: u[:, 0])).evaluate(np.zeros((2, 3)))
    both = type(runs).concatenate([runs, runs])
    assert all(len(getattr(both, field.name)) == 4 for field in dataclasses.fields(runs))


def test_an_estimate_that_is_not_positive_has_an_interval_from_0():
    lower, upper = ConfidenceInterval(-1e-5, 1e-10, 1e9).bounds(0.95)
    assert lower == 0.0
    assert upper == pytest.approx(1.96e-5, rel=1e-3)
    assert ConfidenceInterval(0.0, 1.0, 1e9).bounds(0.95) == (0.0, 1.0)
