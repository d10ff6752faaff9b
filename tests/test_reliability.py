"""ActiveSubspaceReliability against known probabilities, and against bad input."""

import dataclasses
import math

import numpy as np
import openturns as ot
import pytest
from scipy.stats import norm

from satsep_ot.methods import reliability
from satsep_ot.methods.benchmark_problems import getBenchmarkProblem
from satsep_ot.methods.importance_proposal import GaussianMixture, ModeMixture, Pool, fitImportantRegion, paretoShape
from satsep_ot.methods.limit_state_event import LimitStateEvent, callFunction
from satsep_ot.methods.limit_state_surrogate import LimitStateSurrogate, normalisedRadius, radiusFromNormal
from satsep_ot.methods.reliability import ActiveSubspaceReliability
from satsep_ot.methods.reliability_result import clopperPearson
from satsep_ot.methods.subset_simulation import SubsetEstimate, combineEstimates, runSubsetSimulation


@pytest.fixture(autouse=True)
def _seed(monkeypatch):
    ot.RandomGenerator.SetSeed(0)
    # Smaller than by default: quicker, and the intervals have to know.
    monkeypatch.setattr(reliability, "_POOL_SIZE", 20_000)


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
    original, spoilt = reliability.ActiveSubspaceReliability._propose, []

    def propose(self):
        proposal = original(self)
        if self._blocks:
            spoilt.append(proposal)
            proposal = dataclasses.replace(proposal, probability=200.0 * proposal.probability)
        return proposal

    monkeypatch.setattr(reliability.ActiveSubspaceReliability, "_propose", propose)
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
    assert "handed over" in result.getReason()
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
    assert "constant" in result.getReason()
    assert result.getActiveDimensions() == []


def test_no_failure_seen_has_an_upper_bound():
    algorithm = ActiveSubspaceReliability(event(lambda u: 60.0 - u[:, 0]))
    algorithm.setMaximumEvaluations(1000)
    algorithm.run()
    result = algorithm.getResult()
    interval = result.getConfidenceInterval(0.95)
    assert result.getProbabilityEstimate() == 0.0
    assert interval.getLowerBound()[0] == 0.0
    assert 0.0 < interval.getUpperBound()[0] < 1.0
    assert not result.getConverged()


def test_values_that_are_not_finite_raise_or_are_counted():
    def evaluate(u):
        return np.where(u[:, 1] > 1.5, np.nan, 3.0 - u[:, 0])

    broken = event(evaluate)
    algorithm = ActiveSubspaceReliability(broken)
    with pytest.raises(ValueError, match=r"row \d+: input X0 = "):
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
    with pytest.raises(RuntimeError, match=r"after \d+ runs.*out of memory"):
        algorithm.run()
    inputs, outputs = algorithm.getRuns()
    assert 0 < inputs.getSize() == outputs.getSize() <= 60
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
