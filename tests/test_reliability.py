"""ActiveSubspaceReliability against known probabilities, and against bad input."""

import dataclasses
import math
import pickle
from types import SimpleNamespace

import numpy as np
import openturns as ot
import pytest
from scipy.stats import norm

from satsep_ot.methods.common.intervals import ConfidenceInterval, clopperPearson
from satsep_ot.methods.comparison.problems import getBenchmarkProblem
from satsep_ot.methods.reliability import proposal as proposals
from satsep_ot.methods.reliability import run as runs_of
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.estimate import Estimate, paretoShape
from satsep_ot.methods.reliability.limit_state import LimitStateEvent
from satsep_ot.methods.reliability.mixture import GaussianMixture, ModeMixture, fitImportantRegion
from satsep_ot.methods.reliability.outcome import Ending
from satsep_ot.methods.reliability.proposal import Pool, Proposal, fitModes
from satsep_ot.methods.reliability.run import ReliabilityRun
from satsep_ot.methods.reliability.settings import ReliabilitySettings
from satsep_ot.methods.reliability.subset_simulation import SubsetEstimate, combineEstimates, runSubsetSimulation
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate, normalisedRadius, radiusFromNormal
from satsep_ot.openturns_adapter import callFunction


@pytest.fixture(autouse=True)
def _seed(monkeypatch):
    ot.RandomGenerator.SetSeed(0)
    # Smaller than by default: quicker, and the intervals have to know.
    monkeypatch.setattr(proposals, "_POOL_SIZE", 20_000)


def event(evaluate, dimension=3, operator=None, threshold=0.0, distribution=None):
    """An event on a vectorised Python function of an array."""
    function = ot.PythonFunction(
        dimension, 1, func_sample=lambda x: np.asarray(evaluate(np.asarray(x)), dtype=float).reshape(-1, 1)
    )
    vector = ot.CompositeRandomVector(function, ot.RandomVector(distribution or ot.Normal(dimension)))
    return ot.ThresholdEvent(vector, operator or ot.LessOrEqual(), threshold)


def solve(name, **options):
    problem = getBenchmarkProblem(name)
    algorithm = ActiveSubspaceReliability(problem.getEvent())
    if problem.getComponents()[0].getOutputDimension() > 1:
        algorithm.setComponents(*problem.getComponents())
    for key, value in options.items():
        getattr(algorithm, f"set{key}")(value)
    algorithm.run()
    return algorithm.getResult(), problem.getProbability()


# Known problems. -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "runs"),
    [
        ("P1", 965),
        ("P2", 655),
        ("P4", 809),
        ("P5", 560),
        ("Norm35", 600),
        ("Speed35", 600),
        ("Absolute35", 600),
        ("Minimum35", 700),
    ],
)
def test_known_probability_within_few_runs(name, runs):
    result, truth = solve(name)
    assert result.getConverged(), result.getReason()
    assert result.getEvaluationNumber() <= runs
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.12)
    assert result.getCoefficientOfVariation() <= 0.05
    interval = result.getConfidenceInterval(0.999)
    assert interval.getLowerBound()[0] < truth < interval.getUpperBound()[0]
    assert result.getDiagnostics()["true failures"] >= 60


def test_the_radius_alone_is_preferred_to_directions_that_only_fit_the_noise():
    # With this seed three random directions and the radius fit as well as the radius, and the next refit was wild.
    ot.RandomGenerator.SetSeed(4)
    result, truth = solve("P5")
    assert result.getConverged()
    assert result.getActiveDimensions() == [0]
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.05)
    assert result.getEvaluationNumber() < 560


def test_a_refit_that_contradicts_the_estimate_proposes_no_runs(monkeypatch):
    original, spoilt = ReliabilityRun._propose, []

    def propose(self):
        proposal = original(self)
        if self.blocks:
            spoilt.append(proposal)
            proposal = dataclasses.replace(proposal, probability=200.0 * proposal.probability)
        return proposal

    monkeypatch.setattr(ReliabilityRun, "_propose", propose)
    algorithm = ActiveSubspaceReliability(event(lambda u: 3.0 - u.sum(axis=1) / math.sqrt(3.0)))
    algorithm.run()
    result = algorithm.getResult()
    assert spoilt
    assert result.getConverged()
    assert result.getProbabilityEstimate() == pytest.approx(ot.DistFunc.pNormal(-3.0), rel=0.1)


@pytest.mark.slow
def test_noisy_ridge_and_system_of_eight_ridges():
    for name in ("P3", "System35"):
        result, truth = solve(name)
        assert result.getConverged(), result.getReason()
        interval = result.getConfidenceInterval(0.999)
        assert interval.getLowerBound()[0] < truth < interval.getUpperBound()[0]


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


# Honesty. ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_estimate_is_unbiased_and_covered_with_a_deliberately_poor_surrogate(monkeypatch):
    # The fit is spoilt by a shift of the predicted limit state of a third of a standard deviation.
    original = LimitStateSurrogate.limitState

    def spoilt(self, y, exact=True):
        value, scale = original(self, y, exact)
        return value + 0.3, np.maximum(scale, 0.3)

    monkeypatch.setattr(LimitStateSurrogate, "limitState", spoilt)
    truth = ot.DistFunc.pNormal(-3.0)
    linear = event(lambda u: 3.0 - u.sum(axis=1) / 2.0, dimension=4)
    ratios, surrogates, covered = [], [], 0
    for _ in range(12):
        algorithm = ActiveSubspaceReliability(linear)
        algorithm.setTargetCoefficientOfVariation(0.1)
        algorithm.run()
        result = algorithm.getResult()
        interval = result.getConfidenceInterval(0.95)
        covered += interval.getLowerBound()[0] <= truth <= interval.getUpperBound()[0]
        ratios.append(result.getProbabilityEstimate() / truth)
        surrogates.append(result.getSurrogateProbability() / truth)
    assert abs(np.mean(surrogates) - 1.0) > 0.15
    assert abs(np.mean(ratios) - 1.0) < 0.1
    assert covered >= 10


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


def test_hand_over_to_subset_simulation_after_few_runs_without_a_subspace():
    # A sum of waves: no polynomial of few directions shows it.
    waves = event(lambda u: 4.5 - np.sin(7.0 * u).sum(axis=1), 20)
    algorithm = ActiveSubspaceReliability(waves)
    algorithm.setMaximumEvaluations(2500)
    algorithm.run()
    result = algorithm.getResult()
    assert result.getMethod() == "SubsetSimulation"
    assert result.getEnding() in (Ending.NO_FAILURE_REGION, Ending.POOR_SURROGATE)
    assert result.getReason().startswith("handed over to subset simulation: the surrogate")
    assert result.getEvaluationNumber("learning") < 250
    phase = 2.0 * math.pi * np.random.default_rng(0).random((200_000, 20))
    truth = np.mean(np.sin(phase).sum(axis=1) >= 4.5)
    interval = result.getConfidenceInterval(0.99)
    assert interval.getLowerBound()[0] <= truth <= interval.getUpperBound()[0]


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


def test_safe_mode_stays_within_the_evaluations():
    result, truth = solve("P5", Mode="safe", MaximumEvaluations=3000)
    assert result.getEvaluationNumber() <= 3000
    assert result.getEvaluationNumber("subset") > 0
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.2)
    assert result.getDiagnostics()["subset simulation"] > 0.0


# Bad input. ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("value", "probability"), [(1.0, 0.0), (-1.0, 1.0)])
def test_constant_function_has_its_bound(value, probability):
    algorithm = ActiveSubspaceReliability(event(lambda u: np.full(len(u), value)))
    algorithm.run()
    result = algorithm.getResult()
    interval = result.getConfidenceInterval(0.95)
    runs = result.getEvaluationNumber()
    assert result.getProbabilityEstimate() == probability
    assert interval.getUpperBound()[0] - interval.getLowerBound()[0] == pytest.approx(1.0 - 0.05 ** (1.0 / runs))
    # What never fails may do so in the rest of the runs; what always fails is soon known to 10 %.
    assert runs == (5000 if probability == 0.0 else 90)
    assert result.getConverged() == (probability == 1.0)
    assert result.getEnding() is Ending.CONSTANT
    assert "is constant in the first 10 runs" in result.getReason()
    assert result.getActiveDimensions() == []


def test_no_failure_seen_has_an_upper_bound():
    algorithm = ActiveSubspaceReliability(event(lambda u: 60.0 - u[:, 0]))
    algorithm.setMaximumEvaluations(1000)
    algorithm.run()
    result = algorithm.getResult()
    interval = result.getConfidenceInterval(0.95)
    assert result.getProbabilityEstimate() == 0.0
    assert interval.getLowerBound()[0] == 0.0
    runs = result.getTrueRuns()
    nominal = runs.inputs[np.isfinite(runs.weights)]
    # The runs that bound it are those drawn from the inputs' own distribution, and the rest of the evaluations is.
    assert interval.getUpperBound()[0] == pytest.approx(1.0 - 0.05 ** (1.0 / len(nominal)))
    assert len(runs) == result.getEvaluationNumber() == 1000
    assert len(nominal) > 10 + result.getEvaluationNumber("Monte Carlo")
    np.testing.assert_allclose(nominal.std(axis=0), 1.0, atol=5.0 / math.sqrt(len(nominal)))
    np.testing.assert_allclose(nominal.mean(axis=0), 0.0, atol=4.0 / math.sqrt(len(nominal)))
    assert runs.computeProbability() == 0.0
    assert f"the estimate is from {len(nominal)} crude Monte Carlo runs" in result.getReason()
    assert result.getMethod() == "MonteCarlo"
    assert not result.getConverged()


def test_normal_runs_of_a_subset_simulation_without_a_failure_bound_the_probability_too():
    algorithm = ActiveSubspaceReliability(event(lambda u: 60.0 - u[:, 0]))
    algorithm.setMode("safe")
    algorithm.setMaximumEvaluations(900)
    algorithm.run()
    runs = algorithm.getResult().getTrueRuns()
    nominal = np.isfinite(runs.weights)
    # The first runs, the first level of each of two subset simulations, and what was left in the end.
    both = sum((nominal & (runs.phases == phase)).sum() for phase in ("subset", "subset simulation"))
    assert both > 20
    assert nominal.sum() == 10 + both + algorithm.getResult().getEvaluationNumber("Monte Carlo")
    bound = algorithm.getResult().getConfidenceInterval(0.95).getUpperBound()[0]
    assert bound == pytest.approx(1.0 - 0.05 ** (1.0 / nominal.sum()))


def test_a_jump_that_the_first_runs_do_not_show_is_left_to_monte_carlo():
    for target, converged in ((0.05, False), (0.15, True)):
        ot.RandomGenerator.SetSeed(0)
        algorithm = ActiveSubspaceReliability(event(lambda u: np.where(u[:, 0] > 1.5, -1.0, 1.0)))
        algorithm.setTargetCoefficientOfVariation(target)
        algorithm.setMaximumEvaluations(2000)
        algorithm.run()
        result = algorithm.getResult()
        assert set(result.getPhases()) == {"learning", "Monte Carlo"}
        assert (result.getEvaluationNumber() < 2000) == converged
        interval = result.getConfidenceInterval(0.999)
        assert interval.getLowerBound()[0] < ot.DistFunc.pNormal(-1.5) < interval.getUpperBound()[0]
        assert result.getConverged() == converged == (result.getCoefficientOfVariation() <= target)


def test_an_event_that_has_failed_in_all_of_the_first_runs_is_not_taken_for_certain():
    for seed in range(5):
        ot.RandomGenerator.SetSeed(seed)
        algorithm = ActiveSubspaceReliability(event(lambda u: np.where(u[:, 0] > -2.0, -1.0, 1.0)))
        algorithm.run()
        result = algorithm.getResult()
        interval = result.getConfidenceInterval(0.999)
        assert interval.getLowerBound()[0] < ot.DistFunc.pNormal(2.0) < interval.getUpperBound()[0]
        assert interval.getLowerBound()[0] > 0.8
        assert result.getConverged()


def test_failures_that_only_a_surrogate_claims_do_not_bound_the_probability():
    # The polynomial goes on beyond the bend; the event is impossible.
    algorithm = ActiveSubspaceReliability(event(lambda u: 4.0 - np.minimum(u[:, 0] + 0.1 * u[:, 1] ** 2, 3.9)))
    algorithm.setMaximumEvaluations(1000)
    algorithm.run()
    result = algorithm.getResult()
    assert result.getMethod() == "ActiveSubspace"
    assert result.getDiagnostics()["true failures"] == 0.0
    interval = result.getConfidenceInterval(0.95)
    assert interval.getLowerBound()[0] == 0.0
    runs = int(10 + 0.1 * result.getEvaluationNumber("estimation"))
    assert interval.getUpperBound()[0] == pytest.approx(1.0 - 0.05 ** (1.0 / runs))
    assert f"no run failed, and only about {runs} crude Monte Carlo runs bound the probability" in result.getReason()
    assert result.drawConvergence().getDrawables().getSize() == 0


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


def test_runs_that_are_never_finite_keep_the_bound_of_their_policy():
    broken = event(lambda u: np.full(len(u), np.nan))
    for policy, probability in (("failure", 1.0), ("safe", 0.0)):
        algorithm = ActiveSubspaceReliability(broken)
        algorithm.setNonFinitePolicy(policy)
        algorithm.run()
        result = algorithm.getResult()
        assert result.getProbabilityEstimate() == probability
        assert result.getDiagnostics()["not finite"] == result.getEvaluationNumber()
        interval = result.getConfidenceInterval()
        assert interval.getUpperBound()[0] - interval.getLowerBound()[0] > 0.05
        assert not result.getConverged()
        assert result.getEnding() is Ending.NEVER_FINITE


def test_all_runs_failed_and_a_frequent_event():
    for threshold in (-8.0, 0.3):
        algorithm = ActiveSubspaceReliability(event(lambda u: u[:, 0], operator=ot.Greater(), threshold=threshold))
        algorithm.run()
        interval = algorithm.getResult().getConfidenceInterval(0.999)
        assert interval.getLowerBound()[0] <= ot.DistFunc.pNormal(-threshold) <= interval.getUpperBound()[0]
        assert interval.getUpperBound()[0] > interval.getLowerBound()[0]


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


@pytest.mark.parametrize("threshold", [math.inf, -math.inf, math.nan])
def test_non_finite_threshold_is_refused(threshold):
    with pytest.raises(ValueError, match="threshold"):
        ActiveSubspaceReliability(event(lambda u: u[:, 0], threshold=threshold)).run()


def test_a_function_that_raises_in_the_middle_leaves_its_runs():
    calls = [0]

    def evaluate(u):
        calls[0] += len(u)
        if calls[0] > 60:
            raise ArithmeticError("the simulator is out of memory")
        return 3.0 - u[:, 0]

    algorithm = ActiveSubspaceReliability(event(evaluate))
    with pytest.raises(RuntimeError, match=r"still has the 50 runs before it.*out of memory"):
        algorithm.run()
    inputs, outputs = algorithm.getRuns()
    assert inputs.getSize() == outputs.getSize() == 50
    with pytest.raises(RuntimeError, match="in a block of 10 runs of which none is kept; no run before it"):
        algorithm.run()
    with pytest.raises(RuntimeError, match=r"no true runs.*ended before its first block"):
        algorithm.getRuns()
    with pytest.raises(RuntimeError, match="run"):
        algorithm.getResult()


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


@pytest.mark.parametrize(
    ("setter", "value"),
    [
        ("TargetCoefficientOfVariation", 0.0),
        ("MaximumEvaluations", 0),
        ("Mode", "brave"),
        ("NonFinitePolicy", "ignore"),
    ],
)
def test_bad_settings_are_refused(setter, value):
    algorithm = ActiveSubspaceReliability(event(lambda u: u[:, 0]))
    with pytest.raises(ValueError, match=str(value)):
        getattr(algorithm, f"set{setter}")(value)


def test_too_few_evaluations_are_refused_with_the_least_number():
    algorithm = ActiveSubspaceReliability(event(lambda u: u[:, 0]))
    algorithm.setMaximumEvaluations(50)
    with pytest.raises(ValueError, match="at least 170"):
        algorithm.run()


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
    assert len(result.drawConvergence().getDrawables()) == 3
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


# The parts. ----------------------------------------------------------------------------------------------------------


def test_clopper_pearson_is_the_inverse_of_the_binomial():
    lower, upper = clopperPearson(7, 200, 0.9)
    assert ot.Binomial(200, upper).computeCDF([7.0]) == pytest.approx(0.05, rel=1e-6)
    assert 1.0 - ot.Binomial(200, lower).computeCDF([6.0]) == pytest.approx(0.05, rel=1e-6)


def test_pool_weights_integrate_exactly_whatever_the_selection():
    generator = np.random.default_rng(0)
    mixture = GaussianMixture(np.array([1.0]), np.full((1, 2), 2.0), np.eye(2)[None]).withDefence()
    pool = Pool.draw(mixture, 200_000, generator)
    truth = ot.DistFunc.pNormal(-2.0) ** 2
    inside = (pool.points > 2.0).all(axis=1)
    mean, variance = pool.expectation(inside.astype(float))
    assert abs(mean - truth) < 4.0 * math.sqrt(variance)
    probabilities = pool.selection([(0.5, np.ones(len(inside))), (0.5, np.abs(pool.points[:, 0])), (0.3, 0.0 * inside)])
    chosen, weights = pool.select(probabilities, 200_000, generator)
    terms = weights * inside[chosen]
    assert abs(terms.mean() - mean) < 4.0 * terms.std() / math.sqrt(len(terms))


def test_modes_in_subspaces_of_their_own_have_an_exact_density():
    generator = np.random.default_rng(0)
    bases = [np.eye(6)[:, [0]], np.linalg.qr(generator.standard_normal((6, 2)))[0]]
    mixtures = [
        GaussianMixture(np.array([1.0]), np.array([[3.0]]), np.array([[[0.3]]])),
        GaussianMixture(
            np.array([0.4, 0.6]), np.array([[2.0, 1.0], [-3.0, 0.0]]), np.array([np.eye(2), 0.5 * np.eye(2)])
        ),
    ]
    modes = ModeMixture(np.array([0.3, 0.7]), bases, mixtures)
    pool = Pool.draw(modes, 100_000, generator)
    # The weights turn the sample into a standard normal one, for any function.
    for h, truth in (
        (np.ones(100_000), 1.0),
        ((pool.points[:, 0] > 2.5).astype(float), ot.DistFunc.pNormal(-2.5)),
        (np.where(pool.points @ bases[1][:, 0] < -2.5, pool.points[:, 0] ** 2, 0.0), None),
    ):
        mean, variance = pool.expectation(h)
        if truth is None:
            a = bases[1][0, 0]
            tail = ot.DistFunc.pNormal(-2.5)
            truth = (1.0 - a**2) * tail + a**2 * (tail + 2.5 * ot.DistFunc.dNormal(2.5))
        assert abs(mean - truth) < 5.0 * math.sqrt(variance)
        assert math.sqrt(variance) < 0.1 * truth


def test_components_that_fail_together_are_a_group_and_the_modes_of_a_system_are_not():
    generator = np.random.default_rng(0)
    u = generator.standard_normal((300, 5))

    def margin(values):
        norm = np.hypot(values[:, 0], values[:, 1])
        return np.min([4.0 - norm, 3.0 - np.abs(values[:, 2]), 3.5 - values[:, 3]], axis=0)

    surrogate = LimitStateSurrogate(u, u[:, :4], margin, np.ones(300))
    assert surrogate.groups(generator) == [[0, 1], [2], [3]]
    part = surrogate.restricted([0, 1])
    assert part.dimension() == 2
    y = np.array([[4.1, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(part.limitState(y)[0], 4.0 - np.linalg.norm(y, axis=1), atol=0.05)
    assert LimitStateSurrogate(u, u[:, :3], lambda v: 2.0 - v.min(axis=1), np.ones(300)).groups(generator) == [
        [0, 1, 2]
    ]


@pytest.mark.slow
def test_a_system_of_many_modes_costs_some_hundred_runs():
    ot.RandomGenerator.SetSeed(3)
    result, truth = solve("System35")
    assert result.getConverged()
    assert result.getEvaluationNumber() < 1000
    assert result.getProbabilityEstimate() == pytest.approx(truth, rel=0.06)


def test_important_region_finds_both_modes_and_reports_none():
    generator = np.random.default_rng(0)
    mixture = fitImportantRegion(lambda y: (4.0 - np.abs(y[:, 0]), np.full(len(y), 0.05)), 3, generator)
    pool = Pool.draw(mixture, 50_000, generator)
    mean, variance = pool.expectation((np.abs(pool.points[:, 0]) > 4.0).astype(float))
    assert mean == pytest.approx(2.0 * ot.DistFunc.pNormal(-4.0), rel=0.05)
    assert math.sqrt(variance) < 0.03 * mean
    # All further than any number of levels reaches.
    assert fitImportantRegion(lambda y: (1e6 - y[:, 0], np.full(len(y), 1e-3)), 1, generator, maximumLevels=2) is None


def test_pareto_shape_of_exponential_and_heavy_tails():
    generator = np.random.default_rng(0)
    assert abs(paretoShape(generator.exponential(size=20_000))) < 0.1
    assert paretoShape(generator.pareto(1.5, size=20_000)) == pytest.approx(1.0 / 1.5, abs=0.15)


def test_inactive_radius_is_standard_normal_and_inverts():
    generator = np.random.default_rng(0)
    u = generator.standard_normal((20_000, 7))
    directions = np.eye(7)[:, :2]
    t = normalisedRadius(u, directions)
    assert abs(t.mean()) < 0.03
    assert abs(t.std() - 1.0) < 0.03
    np.testing.assert_allclose(radiusFromNormal(t, 5), np.linalg.norm(u[:, 2:], axis=1), rtol=1e-8)


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


def test_a_surrogate_whose_weights_leave_few_runs_gets_a_smaller_model():
    generator = np.random.default_rng(0)
    u = generator.standard_normal((300, 10))
    values = np.column_stack([u[:, 0] + 0.5 * u[:, 1] * u[:, 2] * u[:, 0]])
    large = LimitStateSurrogate(u, values, lambda v: 4.0 - v[:, 0], np.ones(300))
    assert large.components[0].model.dimension == 3
    weights = np.where(np.arange(300) < 20, 1.0, 1e-6)
    small = LimitStateSurrogate(u, values, lambda v: 4.0 - v[:, 0], weights, large)
    assert small.components[0].model.dimension == 1


def test_errors_of_prediction_grow_where_a_polynomial_extrapolates():
    generator = np.random.default_rng(0)
    standardised, constant = [], []
    for _ in range(30):
        u = generator.standard_normal((80, 4))
        truth = u[:, 0] + 0.3 * u[:, 0] ** 2
        noise = 0.3 * generator.standard_normal(80)
        surrogate = LimitStateSurrogate(
            u, (truth + noise)[:, None], lambda v: 4.0 - v[:, 0], np.ones(80), maximumDimension=1
        )
        y = surrogate.reduce(np.array([[0.0] * 4, [5.0, 0.0, 0.0, 0.0]]))
        error = surrogate.predict(y)[:, 0] - [0.0, 12.5] + 0.3 * generator.standard_normal(2)
        standardised.append(error / surrogate.predictionErrors(y)[:, 0])
        constant.append(error / surrogate.errors[0])
    inside, outside = np.sqrt(np.mean(np.square(standardised), axis=0))
    assert 0.7 < inside < 1.3
    assert 0.6 < outside < 1.4
    assert np.sqrt(np.mean(np.square(constant), axis=0))[1] > 1.5


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


# The decisions, from numbers told to them. ----------------------------------------------------------------------------


def bare(blocks=(), phases=(), settings=(), **attributes):
    """A run that has not begun, with what its steps look at."""
    run = ReliabilityRun(event(lambda u: u[:, 0]), ReliabilitySettings(**dict(settings)))
    run.recorder.blocks += blocks
    run.recorder.phases |= dict(phases)
    for name, value in attributes.items():
        assert hasattr(run, name), name
        setattr(run, name, value)
    return run


def proposal(probability=1e-3, poolVariance=0.0, exploration=None, **methods):
    """A proposal of which only these numbers are looked at, and what its methods answer."""
    told = Proposal(None, None, None, probability, poolVariance, None, exploration)
    for name, method in ({"runVariance": lambda: 0.0, "failureShare": lambda: 0.5} | methods).items():
        setattr(told, name, method)
    return told


def sizesOfRuns(evaluate, dimension=3, **options):
    """Numbers of points that the function was called with, and the result."""
    sizes = []

    def counted(u):
        sizes.append(len(u))
        return evaluate(u)

    algorithm = ActiveSubspaceReliability(event(counted, dimension))
    for key, value in options.items():
        getattr(algorithm, f"set{key}")(value)
    algorithm.run()
    return sizes, algorithm.getResult()


def blocksOfPlan(monkeypatch, needed, maximum=5000, dimension=3):
    """Sizes of the learning blocks and of the estimate's where so many runs are needed and the target is never met."""
    monkeypatch.setattr(proposals, "_POOL_SIZE", 1000)
    monkeypatch.setattr(Proposal, "runsNeeded", lambda self, target: needed)
    monkeypatch.setattr(Proposal, "runsForFailures", lambda self: 0.0)
    sizes, result = sizesOfRuns(
        lambda u: 3.0 - u[:, 0], dimension, MaximumEvaluations=maximum, TargetCoefficientOfVariation=1e-9
    )
    assert "maximum number" in result.getReason()
    assert result.getEnding() is Ending.EVALUATIONS_USED
    assert result.getEvaluationNumber() in (maximum, maximum - 1)
    learning = int(np.searchsorted(np.cumsum(sizes), result.getEvaluationNumber("learning"))) + 1
    return sizes[:learning], sizes[learning:]


def test_the_planned_runs_come_in_three_blocks_and_more_in_tenths(monkeypatch):
    learning, blocks = blocksOfPlan(monkeypatch, 300.0, 1000)
    # Two points for each unknown of a linear function first, then blocks of 40 until more learning no longer pays.
    assert learning == [10, 40, 40, 40]
    assert blocks[:3] == [100, 100, 100]
    done = np.cumsum(blocks)
    assert blocks[3:-1] == [max(40, int(0.1 * before)) for before in done[2:-2]]
    assert blocks[-2] > 40


def test_no_block_is_larger_than_ten_of_the_smallest_or_a_quarter_of_the_runs(monkeypatch):
    learning, blocks = blocksOfPlan(monkeypatch, math.inf, 5000)
    used = sum(learning) + np.concatenate([[0], np.cumsum(blocks)])
    assert blocks[:-1] == [max(400, int(0.25 * before)) for before in used[:-2]]
    assert blocks[0] == 400 < blocks[-2]


def test_the_runs_that_are_left_are_shared_by_the_three_blocks_that_are_required(monkeypatch):
    learning, blocks = blocksOfPlan(monkeypatch, math.inf, 430)
    left = 430 - sum(learning)
    assert len(blocks) == 3
    assert all(abs(size - left / 3) < 1.0 for size in blocks)


def test_a_block_has_a_run_for_each_input(monkeypatch):
    _, blocks = blocksOfPlan(monkeypatch, 0.0, 700, 60)
    assert blocks[:4] == [60, 60, 60, 60]


@pytest.mark.parametrize(
    ("variation", "failures", "shape", "converged"),
    [
        (0.05, 60, 0.7, True),
        (0.0501, 1000, 0.0, False),
        (0.01, 59, 0.0, False),
        (0.01, 1000, 0.71, False),
    ],
)
def test_the_end_needs_the_target_three_blocks_sixty_failures_and_a_tail_that_is_not_heavy(
    monkeypatch, variation, failures, shape, converged
):
    class Told(Estimate):
        def __init__(self, blocks):
            super().__init__(blocks)
            self.failures = failures

        def coefficientOfVariation(self):
            return variation

        def paretoShape(self):
            return shape

    monkeypatch.setattr(runs_of, "Estimate", Told)
    sizes, result = sizesOfRuns(lambda u: 3.0 - u[:, 0], MaximumEvaluations=800)
    assert result.getConverged() == converged
    assert result.getEnding() is (Ending.TARGET_REACHED if converged else Ending.EVALUATIONS_USED)
    blocks = len(sizes) - list(np.cumsum(sizes)).index(result.getEvaluationNumber("learning")) - 1
    assert (blocks == 3) == converged
    assert result.getEvaluationNumber() < 800 if converged else result.getEvaluationNumber() == 800


def test_a_refit_is_believed_within_five_standard_deviations_of_the_estimate():
    # 5 (sqrt(3^2 + 4^2) 1e-5 + 2 % of 1e-3) = 3.5e-4.
    estimate = Estimate.__new__(Estimate)
    estimate.probability, estimate.variance = 1e-3, 9e-10
    for probability, believed in ((1.349e-3, True), (1.351e-3, False), (0.651e-3, True), (0.649e-3, False)):
        refitted = proposal(probability=probability, poolVariance=1.6e-9)
        assert estimate.agrees(refitted) == believed


def test_subset_simulation_is_preferred_where_it_would_be_more_exact():
    # Four levels of 675 runs with chains that cost a factor of 3: 4 sqrt(3 * 9 * 4 / 2700) = 0.8.
    def better(ours, probability=1e-4, remaining=2700, target=0.05):
        variance = remaining * (ours * probability) ** 2
        told = proposal(probability=probability, runVariance=lambda: variance)
        return told.losesToSubsetSimulation(remaining, target)

    assert not better(0.79)
    assert better(0.81)
    # A frequent event takes one level.
    assert not better(0.09, 0.5)
    assert better(0.11, 0.5)
    # What reaches the target is good enough.
    assert not better(0.81, target=0.9)


def test_runs_that_the_target_and_the_failures_need():
    # (5 % of 1e-3)^2 - (3e-5)^2 = (4e-5)^2 is left for the runs.
    assert proposal(poolVariance=9e-10, runVariance=lambda: 1.6e-7).runsNeeded(0.05) == pytest.approx(100.0)
    assert proposal(poolVariance=25e-10, runVariance=lambda: 1.6e-7).runsNeeded(0.05) == math.inf
    # A hundred failures are planned, so that fewer than 60 are unlikely; but never more than 2000 runs for them.
    assert proposal(failureShare=lambda: 0.5).runsForFailures() == pytest.approx(200.0)
    assert proposal(failureShare=lambda: 0.001).runsForFailures() == pytest.approx(2000.0)


def test_what_a_run_of_a_proposal_is_worth():
    pool = Pool(np.zeros((4, 1)), np.array([1.0, 2.0, 1.0, 1.0]))
    failure, selection = np.array([1.0, 0.5, 0.0, 0.1]), np.array([0.3, 0.2, 0.4, 0.1])
    told = Proposal(None, pool, failure, 0.5, 0.0, selection, selection)
    # Weights over four times the selection: 2.5 where the surrogate is at a half, 2.5 at a tenth.
    assert told.runVariance() == pytest.approx(0.2 * 2.5**2 * 0.25 + 0.1 * 2.5**2 * 0.09)
    assert told.failureShare() == pytest.approx(0.3 + 0.1 + 0.01)


def test_runs_that_are_not_finite_count_by_their_policy_beside_the_surrogate():
    # 10 of 100 runs were not finite.
    for policy, expected in (("failure", [0.1, 0.28]), ("safe", [0.0, 0.18])):
        limitState = SimpleNamespace(nonFiniteNumber=10)
        run = bare(
            phases={"learning": 60, "estimation": 40}, settings={"nonFinitePolicy": policy}, limitState=limitState
        )
        np.testing.assert_allclose(run._withNonFinite(np.array([0.0, 0.2])), expected)


def calibrated(error, margins, failed=None, value=1.0, calibration=1.0):
    """`_calibrate` of runs whose predictions are off by so many of the expected errors."""
    size = len(margins)
    surrogate = SimpleNamespace(
        reduce=lambda u: u,
        predict=lambda y: np.zeros((size, 1)),
        predictionErrors=lambda y: np.full((size, 1), 2.0),
        limitState=lambda y: (np.full(size, value), np.ones(size)),
    )
    runs = SimpleNamespace(
        finite=np.ones(size, dtype=bool),
        u=np.zeros((size, 1)),
        outputs=np.full((size, 1), 2.0 * error),
        margins=np.asarray(margins, dtype=float),
        failed=np.zeros(size, dtype=bool) if failed is None else np.asarray(failed),
    )
    limitState = SimpleNamespace(smooth=lambda outputs: outputs)
    run = bare(surrogate=surrogate, limitState=limitState, weightWidth=3.0, calibration=calibration)
    return run._calibrate(runs), run


def test_errors_of_prediction_are_scaled_by_new_runs():
    trusted, run = calibrated(1.0, np.zeros(90))
    assert trusted
    assert run.observedCalibration == pytest.approx(1.0)
    assert run.calibration == pytest.approx(1.0)
    # Twice as far off as expected: with ten runs' worth of belief, sqrt((10 + 4 * 90) / 100), half of it kept.
    trusted, run = calibrated(2.0, np.zeros(90))
    assert not trusted
    assert run.observedCalibration == pytest.approx(2.0)
    assert run.calibration == pytest.approx(math.sqrt(math.sqrt(3.7)))
    # A factor below 1.5 is no surprise.
    assert calibrated(1.51, np.zeros(90))[0]
    assert not calibrated(1.6, np.zeros(90))[0]
    # A run as far from the limit as the width of the weights counts half.
    _, run = calibrated(2.0, np.full(180, 3.0))
    assert run.calibration == pytest.approx(math.sqrt(math.sqrt(3.7)))
    # One block changes the scale within bounds, and what was learnt before counts.
    assert calibrated(1e6, np.zeros(90))[1].calibration == pytest.approx(10.0)
    assert calibrated(0.0, np.zeros(10**6))[1].calibration == pytest.approx(0.5)
    assert calibrated(1.0, np.zeros(90), calibration=4.0)[1].calibration == pytest.approx(2.0)


def test_a_surrogate_that_was_sure_of_a_wrong_label_is_not_trusted():
    # Three standard deviations on the safe side leave 1.3e-3 for failure, more than one in a thousand.
    failed = np.arange(40) == 7
    assert calibrated(1.0, np.zeros(40), failed, value=3.0)[0]
    assert not calibrated(1.0, np.zeros(40), failed, value=3.2)[0]
    assert not calibrated(1.0, np.zeros(40), np.zeros(40, dtype=bool), value=-3.2)[0]


def test_a_normal_run_that_failed_where_the_surrogate_is_sure_is_missed():
    def misses(value, failed=True, other=(False, True)):
        surrogate = SimpleNamespace(reduce=lambda u: u, limitState=lambda y: (np.array([value]), np.array([1.0])))
        first = SimpleNamespace(u=np.zeros((1, 1)), failed=np.array([failed]), finite=np.array([True]))
        part = SimpleNamespace(failed=np.array([other[0], False]), finite=np.array([other[1], True]))
        return bare(blocks=[first, part], surrogate=surrogate)._missesKnownFailures()

    # One in a hundred lies 2.33 standard deviations off.
    assert misses(2.4)
    assert not misses(2.2)
    assert not misses(2.4, failed=False)
    # No surrogate can point at failures without a finite value.
    assert misses(-1.0, other=(True, False))
    assert not misses(-1.0, other=(True, True))


def test_points_without_a_known_failure_region_are_spread_twice_as_wide():
    directions = np.array([[0.6], [0.8], [0.0]])
    run = bare(
        generator=np.random.default_rng(0),
        limitState=SimpleNamespace(dimension=3),
        surrogate=SimpleNamespace(directions=directions),
    )
    u = run._drawWide(20_000)
    np.testing.assert_allclose((u @ directions).std(), 2.0, rtol=0.02)
    np.testing.assert_allclose((u @ [0.8, -0.6, 0.0]).std(), 1.0, rtol=0.02)
    np.testing.assert_allclose(u[:, 2].std(), 1.0, rtol=0.02)


def test_learning_without_a_failure_region_ends_at_two_fifths_of_the_evaluations(monkeypatch):
    monkeypatch.setattr(ReliabilityRun, "_propose", lambda self: None)
    sizes, result = sizesOfRuns(lambda u: 9.0 - u[:, 0], MaximumEvaluations=1000)
    assert "shows no failure region" in result.getReason()
    learning = list(np.cumsum(sizes)).index(result.getEvaluationNumber("learning")) + 1
    used = np.cumsum(sizes[:learning])
    # A quarter more each time, at least 40, until one more of them would lead beyond 400.
    assert sizes[1:learning] == [max(40, int(0.25 * before)) for before in used[:-1]]
    assert used[-2] + sizes[learning - 2] <= 400 < used[-1] + sizes[learning - 1]


def test_learning_ends_after_ten_failures_that_no_surrogate_explains(monkeypatch):
    monkeypatch.setattr(ReliabilityRun, "_propose", lambda self: None)
    # So many of each call's runs fail, the others are far from the limit; the first call has 10 runs, the next ones 40.
    for failing, blocks in ((5, 1), (4, 2)):
        sizes, result = sizesOfRuns(
            lambda u, failing=failing: np.where(np.arange(len(u)) < failing, -1.0, 9.0 + u[:, 0]),
            MaximumEvaluations=2000,
        )
        assert "shows no failure region" in result.getReason()
        assert result.getEvaluationNumber("learning") == 10 + 40 * blocks
        assert sizes[: 1 + blocks] == [10] + [40] * blocks


def test_runs_near_the_limit_count_most_in_a_fit(monkeypatch):
    seen = []

    def surrogate(u, values, margin, weights, previous, maximumDegree):
        seen.append((u, weights, maximumDegree))
        return SimpleNamespace(errors=np.array([0.3]))

    monkeypatch.setattr(runs_of, "LimitStateSurrogate", surrogate)
    margins = np.array([0.0, 1.0, -2.0, 0.5, 1.5, np.nan])
    runs = LimitStateEvent(event(lambda u: u[:, 0])).evaluate(np.arange(18.0).reshape(6, 3))
    runs = dataclasses.replace(runs, margins=margins, finite=np.isfinite(margins))
    limitState = SimpleNamespace(smooth=lambda outputs: outputs, surrogateMargin=None)
    # The median distance is 1; among runs all close to the limit, a fifth of the first runs' spread counts as close.
    for spread, width in ((1.0, 1.0), (10.0, 2.0)):
        run = bare(
            blocks=[runs], phases={"learning": 6}, limitState=limitState, nominalSpread=spread,
            calibration=np.array([2.0]),
        )  # fmt: skip
        run._fit()
        u, weights, degree = seen.pop()
        assert len(u) == 5
        assert degree == 4
        np.testing.assert_allclose(weights, 1.0 / (1.0 + (margins[:5] / width) ** 2))
        assert weights[0] == 1.0
        np.testing.assert_allclose(run.surrogate.errors, [0.6])


def linearProposal(limit, deviation=0.02, target=0.05):
    """Where runs go whose surrogate is limit - y, known to a standard deviation."""
    surrogate = SimpleNamespace(
        dimension=lambda: 1,
        radial=False,
        limitState=lambda y, exact=True: (limit - y[:, 0], np.full(len(y), deviation)),
    )
    return proposals.propose(surrogate, target, np.random.default_rng(0), lambda failure: failure)


def test_no_run_of_a_proposal_weighs_more_than_ten_nominal_ones():
    found = linearProposal(3.0)
    assert found.probability == pytest.approx(ot.DistFunc.pNormal(-3.0 / math.hypot(1.0, 0.02)), rel=0.05)
    size = len(found.selection)
    mean = found.pool.weights.mean()
    # A tenth of the runs are of crude Monte Carlo, of those to learn from 15 %.
    for probabilities, share in ((found.selection, 0.1), (found.exploration, 0.15)):
        largest = (found.pool.weights / (size * probabilities)).max()
        assert largest <= mean / share * (1.0 + 1e-9)
        assert largest > 0.99 * mean / share
        assert probabilities.sum() == pytest.approx(1.0)


def test_runs_go_to_failures_and_where_the_surrogate_is_unsure():
    found = linearProposal(3.0)
    y = found.pool.points[:, 0]
    # Deep in the failure region only the tenth that is of crude Monte Carlo goes, and a sixth or so to all failures.
    deep = y > 4.2
    weights = found.pool.weights / found.pool.weights.sum()
    failing = weights * found.failure / (weights @ found.failure)
    for probabilities, nominal in ((found.selection, 0.1), (found.exploration, 0.15)):
        np.testing.assert_allclose(probabilities[deep], (nominal * weights + 0.15 * failing)[deep], rtol=1e-3)
    # The rest goes where the surrogate is unsure, in bands of several widths; learning looks further around. Two thirds
    # of the runs of the estimate lie within eight standard deviations of the limit, three quarters of the others within
    # twenty-four.
    for probabilities, shares in (
        (found.selection, (0.19, 0.45, 0.67, 0.84)),
        (found.exploration, (0.08, 0.21, 0.46, 0.74)),
    ):
        for deviations, share in zip((1, 3, 8, 24), shares, strict=True):
            near = np.abs(y - 3.0) < deviations * 0.02
            assert probabilities[near].sum() == pytest.approx(share, abs=0.015)


def test_the_pool_grows_with_the_target_up_to_a_bound(monkeypatch):
    monkeypatch.setattr(proposals, "_POOL_SIZE", 2000)
    sizes = []
    for target in (0.2, 0.02, 1e-6):
        found = linearProposal(3.0, target=target)
        sizes.append(len(found.selection))
        if target > 1e-3:
            # Its error is at most three tenths of the target.
            assert math.sqrt(found.poolVariance) <= 0.3 * target * found.probability
    assert sizes[0] == 2000 < sizes[1] < sizes[2] == 50_000


def test_a_surrogate_that_fails_nowhere_within_six_deviations_has_seen_no_failure():
    assert linearProposal(6.3).probability > 1e-10
    assert linearProposal(6.45) is None


def test_a_safe_run_spends_a_third_on_subset_simulation_first():
    result, _ = solve("P5", Mode="safe", MaximumEvaluations=3000)
    assert 500 < result.getEvaluationNumber("subset") <= 1000


def test_a_probability_below_what_the_runs_can_exclude_says_so():
    rare, _ = solve("P2")
    bound = rare.getDiagnostics()["unseen bound"]
    # The first runs and a tenth of the estimate's are of crude Monte Carlo: 3 over their number.
    nominal = 2 * (40 + 2) + 0.1 * rare.getEvaluationNumber("estimation")
    assert bound == pytest.approx(3.0 / nominal)
    assert f"of probability below {bound:.1e} that no run has reached" in rare.getReason()
    assert rare.getUnseenBound() == bound
    frequent = event(lambda u: 1.0 - u[:, 0])
    algorithm = ActiveSubspaceReliability(frequent)
    algorithm.run()
    assert algorithm.getResult().getProbabilityEstimate() > algorithm.getResult().getDiagnostics()["unseen bound"]
    assert "excluded" not in algorithm.getResult().getReason()
    assert algorithm.getResult().getUnseenBound() is None


def systemOf(*limits, size=300):
    """A surrogate of a series system of so many normal variables with these limits."""
    u = np.random.default_rng(0).standard_normal((size, len(limits) + 1))
    return LimitStateSurrogate(u, u[:, : len(limits)], lambda v: (np.array(limits) - v).min(axis=1), np.ones(size))


def modesOf(surrogate):
    return fitModes(surrogate, np.random.default_rng(0))


def proposalOf(surrogate):
    return proposals.propose(surrogate, 0.05, np.random.default_rng(0), lambda failure: failure)


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


def test_each_mode_of_a_system_has_runs_in_proportion_to_its_probability():
    limits = np.array([2.5, 3.0, 3.5, 4.5])
    surrogate, generator = systemOf(*limits), np.random.default_rng(0)
    modes = fitModes(surrogate, generator)
    shares = norm.sf(limits) / norm.sf(limits).sum()
    # One that the others hide gets a hundredth of the runs all the same.
    shares[3] = 0.01
    np.testing.assert_allclose(modes.shares, shares / shares.sum(), rtol=0.25)
    assert modes.shares.sum() == pytest.approx(1.0)
    for index, (basis, mixture) in enumerate(zip(modes.bases, modes.mixtures, strict=True)):
        direction = surrogate.directions @ basis
        np.testing.assert_allclose(np.abs(direction[:, 0]), np.eye(5)[index], atol=1e-9)
        # Nine tenths of a mode's points are beyond or near its limit.
        y = mixture.sample(2000, np.random.default_rng(1)) * direction[index, 0]
        assert 0.6 < (y > limits[index] - 0.5).mean() < 0.95
    proposal = proposals.propose(surrogate, 0.05, generator, lambda failure: failure)
    assert proposal.probability == pytest.approx(1.0 - norm.cdf(limits).prod(), rel=0.05)


@pytest.mark.parametrize(("number", "apart"), [(2, False), (3, False), (4, True)])
def test_only_more_than_three_directions_are_searched_mode_by_mode(monkeypatch, number, apart):
    asked = []
    monkeypatch.setattr(proposals, "fitModes", lambda surrogate, generator: asked.append(True))
    assert proposalOf(systemOf(*[3.0] * number)).probability == pytest.approx(number * norm.sf(3.0), rel=0.1)
    assert bool(asked) == apart


def test_components_that_fail_together_have_no_modes_of_their_own():
    surrogate = systemOf(3.0, 3.0, 3.0, 3.0)
    surrogate.margin = lambda v: 4.0 - np.linalg.norm(v, axis=1)
    assert modesOf(surrogate) is None


def learningBlocks(told, maximum=5000, mode="fast"):
    """How many blocks are learnt from where each refit's proposal is (probability, runs needed, trusted) as told.

    200 runs are needed for failures; the last that is told stays.
    """
    blocks, degrees = [], []
    run = bare(
        phases={"learning": 10}, settings={"maximumEvaluations": maximum, "mode": mode}, blockSize=40, generator=None
    )

    def current():
        return told[min(max(len(blocks) - 1, 0), len(told) - 1)]

    def evaluate(size, phase):
        blocks.append(size)
        run.recorder.phases[phase] += size

    def propose():
        probability, needed, _ = current()
        return proposal(
            probability, runsNeeded=lambda target: needed, runsForFailures=lambda: 200.0,
            draw=lambda selection, size, generator: (size, None, None),
        )  # fmt: skip

    run._fit = lambda maximumDegree=4: degrees.append(maximumDegree)
    run._propose = propose
    run.recorder.evaluate = evaluate
    run._calibrate = lambda runs: current()[2]
    found = run._learn()
    assert found.probability == current()[0]
    assert blocks[:3] == [40] * len(blocks[:3])
    # Quartics through the first normal points would invent failures far out; points of subset simulation are there.
    assert degrees == [2 if mode == "fast" else 4] + [4] * len(blocks)
    return len(blocks)


def test_learning_ends_when_the_surrogate_is_trusted_stable_and_enough():
    assert learningBlocks([(1e-3, 100.0, True)]) == 2
    assert learningBlocks([(1e-3, 100.0, True)], mode="safe") == 2
    # As many as failures need are enough, and more are not.
    assert learningBlocks([(1e-3, 200.0, True)]) == 2
    # A probability that moves by more than 15 % is not stable.
    assert learningBlocks([(1e-3, 100.0, True), (1.16e-3, 100.0, True)]) == 2
    assert learningBlocks([(1e-3, 100.0, True), (1.19e-3, 100.0, True)]) == 3
    assert learningBlocks([(1e-3, 100.0, True), (0.88e-3, 100.0, True)]) == 2
    assert learningBlocks([(1e-3, 100.0, True), (0.86e-3, 100.0, True)]) == 3
    assert learningBlocks([(1e-3, 100.0, False)] * 4 + [(1e-3, 100.0, True)]) == 5


def test_learning_goes_on_while_a_block_saves_more_runs_than_it_costs():
    # Every block saves a hundred runs, then none: twice in vain is enough.
    saving = [(1e-3, 1000.0 - 100.0 * i, True) for i in range(5)]
    assert learningBlocks(saving) == 7
    # It saves less than it costs.
    assert learningBlocks([(1e-3, 1000.0 - 39.0 * i, True) for i in range(9)]) == 3
    assert learningBlocks([(1e-3, 1000.0 - 41.0 * i, True) for i in range(9)] + [(1e-3, 250.0, True)]) > 9
    # Two fifths of the evaluations are the limit: with 500, that is 10 + 4 * 40 runs.
    assert learningBlocks([(1e-3, 100.0, False)], 500) == 4


def handedOver(monkeypatch, *estimates, mode="fast", evaluations=1000):
    """The result of a run without a surrogate, whose subset simulations find what is told."""
    left = list(estimates)

    def simulation(evaluate, dimension, maximumEvaluations, generator):
        probability, variation, bound = left.pop(0)
        return SubsetEstimate(probability, variation, bound, evaluate(np.zeros((maximumEvaluations, dimension))))

    monkeypatch.setattr(runs_of, "runSubsetSimulation", simulation)
    monkeypatch.setattr(ReliabilityRun, "_propose", lambda self: None)
    _, result = sizesOfRuns(
        lambda u: 9.0 - u[:, 0],
        MaximumEvaluations=evaluations,
        Mode=mode,
        TargetCoefficientOfVariation=0.3,
    )
    assert not left
    return result


@pytest.mark.parametrize(("variation", "converged"), [(0.3, True), (0.31, False)])
def test_what_subset_simulation_found_is_the_result_after_a_hand_over(monkeypatch, variation, converged):
    result = handedOver(monkeypatch, (2e-3, variation, 2e-3))
    assert result.getMethod() == "SubsetSimulation"
    assert result.getProbabilityEstimate() == 2e-3
    assert result.getCoefficientOfVariation() == pytest.approx(variation)
    assert result.getVarianceEstimate() == pytest.approx((variation * 2e-3) ** 2)
    assert result.getConverged() == converged
    assert result.getEvaluationNumber() == 1000
    # A log-normal estimate: the bounds are factors of it.
    interval = result.getConfidenceInterval(0.95)
    factor = math.exp(1.959964 * math.sqrt(math.log1p(variation**2)))
    assert interval.getLowerBound()[0] == pytest.approx(2e-3 / factor, rel=1e-5)
    assert interval.getUpperBound()[0] == pytest.approx(2e-3 * factor, rel=1e-5)


def test_a_hand_over_that_finds_nothing_keeps_the_bound_of_the_normal_runs(monkeypatch):
    result = handedOver(monkeypatch, (0.0, math.inf, 1e-5))
    assert "found no failure before the evaluations ended, at a level of probability 1.0e-05" in result.getReason()
    assert result.getLevelReached() == 1e-5
    assert result.getEnding() is Ending.NO_FAILURE_REGION
    assert result.getProbabilityEstimate() == 0.0
    assert not result.getConverged()
    # Ten normal runs without failure.
    assert result.getConfidenceInterval(0.95).getUpperBound()[0] == pytest.approx(1.0 - 0.05**0.1)


def test_both_subset_simulations_of_a_safe_run_count_after_a_hand_over(monkeypatch):
    result = handedOver(monkeypatch, (1e-3, 0.3, 1e-3), (3e-3, 0.3, 3e-3), mode="safe", evaluations=3000)
    assert result.getEvaluationNumber("subset") == 1000
    assert result.getProbabilityEstimate() == pytest.approx(2e-3)
    # They differ by more than they claim: that is the error of their mean.
    assert result.getCoefficientOfVariation() == pytest.approx(0.5)


# Events, and what is got from an algorithm and its result. ------------------------------------------------------------


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


def test_events_and_components_that_cannot_be_treated_are_refused_with_the_reason():
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["a", "b"]), ot.RandomVector(ot.Normal(2)))
    everywhere = ot.Interval([0.0] * 2, [1.0] * 2, [False] * 2, [False] * 2)
    with pytest.raises(ValueError, match="no finite bound"):
        LimitStateEvent(ot.DomainEvent(vector, everywhere))
    mesh = ot.IntervalMesher([2, 2]).build(ot.Interval(2))
    with pytest.raises(TypeError, match="has no limit state function; give an Interval or a LevelSet"):
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


def test_a_run_hands_over_where_subset_simulation_would_be_more_exact(monkeypatch):
    monkeypatch.setattr(Proposal, "losesToSubsetSimulation", lambda self, remaining, target: True)
    _, result = sizesOfRuns(lambda u: 2.0 - u[:, 0], MaximumEvaluations=2000)
    assert "explains too little of the limit state" in result.getReason()
    assert result.getEnding() is Ending.POOR_SURROGATE
    assert result.getLevelReached() is None
    assert result.getMethod() == "SubsetSimulation"
    assert list(result.getPhases()) == ["learning", "subset simulation"]


def test_modes_without_a_failure_region_are_left_out(monkeypatch):
    assert len(modesOf(systemOf(3.0, 3.2, 40.0, 3.4)).shares) == 3
    # A component that is constant has no direction to search along.
    u = np.random.default_rng(0).standard_normal((300, 6))
    values = np.column_stack([u[:, :3], np.ones(300)])
    surrogate = LimitStateSurrogate(u, values, lambda v: 3.0 - v.max(axis=1), np.ones(300))
    surrogate.groups = lambda generator: [[0], [1], [2], [3]]
    assert len(modesOf(surrogate).shares) == 3
    # Nor is one whose region is not found.
    found, fit = [], proposals.fitImportantRegion

    def missingTheFirst(*arguments, **options):
        found.append(fit(*arguments, **options) if found else None)
        return found[-1]

    monkeypatch.setattr(proposals, "fitImportantRegion", missingTheFirst)
    assert len(modesOf(systemOf(3.0, 3.2, 3.3, 3.4)).shares) == 3
    assert len(found) == 4


def test_results_without_a_surrogate_or_an_estimate_say_so(monkeypatch):
    sure = ActiveSubspaceReliability(event(lambda u: np.full(len(u), -1.0)))
    sure.run()
    assert sure.getResult().getReliabilityIndex() == -math.inf
    never = handedOver(monkeypatch, (0.0, math.inf, 1e-5))
    assert never.getReliabilityIndex() == math.inf
    assert never.drawConvergence().getDrawables().getSize() == 0
    for level in (0.0, 1.0):
        with pytest.raises(ValueError, match="must lie between 0 and 1"):
            never.getConfidenceInterval(level)
        with pytest.raises(ValueError, match="must lie between 0 and 1"):
            sure.getResult().computeImportance(level)
    stopped = ActiveSubspaceReliability(event(lambda u: 3.0 - u[:, 0]))
    stopped.setStopCallback(lambda: True)
    stopped.run()
    with pytest.raises(RuntimeError, match="no surrogate"):
        stopped.getResult().getDirections()


def test_a_surrogate_of_the_radius_has_no_native_function_and_one_of_one_direction_a_plain_picture():
    radial, _ = solve("P5")
    with pytest.raises(ValueError, match="inactive radius"):
        radial.getMetaModelResult()
    _, result = sizesOfRuns(lambda u: 3.0 - u[:, 0])
    graph = result.drawLimitState()
    assert graph.getTitle() == "Limit state along the active direction"
    active = np.array(result.getInputSample())[:, 0]
    lines = [np.array(d.getData()) for d in graph.getDrawables() if d.getImplementation().getClassName() == "Curve"]
    assert len(lines) == 1
    np.testing.assert_allclose(lines[0][:, 1], 0.0)
    assert np.ptp(lines[0][:, 0]) == pytest.approx(np.ptp(active), rel=1e-6)


def test_an_estimate_that_is_not_positive_has_an_interval_from_0():
    lower, upper = ConfidenceInterval(-1e-5, 1e-10, 1e9).bounds(0.95)
    assert lower == 0.0
    assert upper == pytest.approx(1.96e-5, rel=1e-3)
    assert ConfidenceInterval(0.0, 1.0, 1e9).bounds(0.95) == (0.0, 1.0)


def test_a_probability_is_never_above_1():
    for seed in range(10):
        ot.RandomGenerator.SetSeed(seed)
        algorithm = ActiveSubspaceReliability(event(lambda u: u[:, 0] - 3.719, 1))
        algorithm.run()
        result = algorithm.getResult()
        assert 0.99 < result.getProbabilityEstimate() <= 1.0
        assert result.getConfidenceInterval(0.95).contains([result.getProbabilityEstimate()])
        assert result.computeProbability(ot.Normal(1)).probability <= 1.0


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


@pytest.mark.parametrize("what", ["Progress", "Stop"])
def test_a_callback_that_cannot_be_called_is_refused_at_once(what):
    algorithm = ActiveSubspaceReliability(event(lambda u: 3.0 - u[:, 0]))
    getattr(algorithm, f"set{what}Callback")(None)
    with pytest.raises(TypeError, match=f"the {what.lower()} callback must be callable, got int"):
        getattr(algorithm, f"set{what}Callback")(3)
