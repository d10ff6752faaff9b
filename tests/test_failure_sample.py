"""What the true runs of one probability say beside it: sensitivities, importance, other distributions, files."""

import dataclasses
import math

import numpy as np
import openturns as ot
import pytest
from reliability_events import findNothing

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.sensitivity import (
    FailureSample,
    computeImportance,
    computeParameterSensitivity,
    computeProbability,
)

phi = ot.DistFunc.dNormal
tail = ot.Normal().computeComplementaryCDF


@pytest.fixture(autouse=True)
def _seed():
    ot.RandomGenerator.SetSeed(0)


def solve(formula, distribution, threshold, target=0.02):
    names = [f"x{i}" for i in range(distribution.getDimension())]
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(names, [formula]), ot.RandomVector(distribution))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), threshold))
    algorithm.setTargetCoefficientOfVariation(target)
    algorithm.run()
    result = algorithm.getResult()
    assert result.getConverged()
    return result


def checkDerivatives(rows, truth, largest=0.1):
    """Each derivative within its 99.9 % interval, which is not wide."""
    for row in rows:
        expected = truth[row.input, row.parameter]
        assert row.lower <= expected <= row.upper, row
        scale = max(abs(value) for value in truth.values())
        assert row.upper - row.lower < 2.0 * max(largest * abs(expected), 0.03 * scale) * 3.3, row


def differences(probability, marginals):
    """Central differences of a function of marginals, by input and parameter."""
    truth = {}
    for index, marginal in enumerate(marginals):
        for place, name in enumerate(marginal.getParameterDescription()):
            values = []
            step = 1e-4 * marginal.getStandardDeviation()[0]
            for sign in (1.0, -1.0):
                changed = [ot.Distribution(other) for other in marginals]
                parameter = np.array(marginal.getParameter())
                parameter[place] += sign * step
                changed[index].setParameter(parameter)
                values.append(probability(changed))
            truth[f"x{index}", name.removesuffix("_0")] = (values[0] - values[1]) / (2.0 * step)
    return truth


# Sensitivity to the parameters. --------------------------------------------------------------------------------------


def test_derivatives_of_a_linear_normal_problem():
    mean, deviation, slope = np.array([1.0, -2.0, 5.0]), np.array([0.5, 2.0, 1.0]), np.array([2.0, 0.8, 0.0])
    total = math.sqrt(((slope * deviation) ** 2).sum())
    index = 3.0
    result = solve(
        "2 * x0 + 0.8 * x1 + 1e-9 * x2",
        ot.Normal(mean, deviation, ot.CorrelationMatrix(3)),
        float(slope @ mean + index * total),
    )
    truth = {}
    for i in range(3):
        truth[f"x{i}", "mu"] = phi(index) * slope[i] / total
        truth[f"x{i}", "sigma"] = phi(index) * index * slope[i] ** 2 * deviation[i] / total**2
    rows = result.computeParameterSensitivity(0.999)
    assert [(row.input, row.parameter) for row in rows] == list(truth)
    checkDerivatives(rows, truth)
    first = rows[0]
    assert first.value == 1.0
    assert first.elasticity == pytest.approx(first.derivative * 0.5 / result.getProbabilityEstimate())


def test_derivatives_with_correlated_normal_inputs():
    correlation = ot.CorrelationMatrix([[1.0, 0.6], [0.6, 1.0]])
    result = solve("x0 + x1", ot.Normal([0.0, 1.0], [1.0, 2.0], correlation), 9.0)

    def probability(marginals):
        (m0, s0), (m1, s1) = (marginal.getParameter() for marginal in marginals)
        return tail((9.0 - m0 - m1) / math.sqrt(s0**2 + s1**2 + 1.2 * s0 * s1))

    truth = differences(probability, [ot.Normal(0.0, 1.0), ot.Normal(1.0, 2.0)])
    checkDerivatives(result.computeParameterSensitivity(0.999), truth)


def test_derivatives_with_a_copula_and_other_marginals():
    marginals = [ot.Gumbel(0.5, 1.0), ot.LogNormal(0.2, 0.3, 0.0)]
    copula = ot.ClaytonCopula(1.5)
    threshold = 9.0

    def probability(changed):
        # The sum exceeds the threshold: over the levels of the second input, the conditional law of the first one.
        v, weight = np.polynomial.legendre.leggauss(400)
        v, weight = 0.5 * (v + 1.0), 0.5 * weight
        second = [changed[1].computeQuantile(level)[0] for level in v]
        u = [changed[0].computeCDF(threshold - value) for value in second]
        # The derivative of the copula's distribution function in its second argument.
        below = [
            b ** (-2.5) * (a ** (-1.5) + b ** (-1.5) - 1.0) ** (-1.0 / 1.5 - 1.0) for a, b in zip(u, v, strict=True)
        ]
        return float(weight @ (1.0 - np.array(below)))

    result = solve("x0 + x1", ot.JointDistribution(marginals, copula), threshold)
    assert result.getProbabilityEstimate() == pytest.approx(probability(marginals), rel=0.1)
    rows = result.computeParameterSensitivity(0.999)
    truth = differences(probability, marginals)
    checkDerivatives(rows, truth, 0.25)


def test_derivatives_at_the_bounds_of_a_uniform_input():
    marginals = [ot.Uniform(-1.0, 1.5), ot.Normal(0.0, 0.5)]

    def probability(changed):
        a, b = changed[0].getParameter()
        mu, sigma = changed[1].getParameter()
        x, weight = np.polynomial.legendre.leggauss(100)
        x = a + 0.5 * (b - a) * (x + 1.0)
        return 0.5 * float(weight @ [tail((2.0 - value - mu) / sigma) for value in x])

    result = solve("x0 + x1", ot.JointDistribution(marginals), 2.0, 0.01)
    truth = differences(probability, marginals)
    rows = result.computeParameterSensitivity(0.95)
    for row in rows:
        assert row.derivative == pytest.approx(
            truth[row.input, row.parameter], abs=0.15 * max(map(abs, truth.values()))
        )


def test_a_bound_at_which_the_density_jumps_has_no_score_and_says_so():
    generator = np.random.default_rng(0)
    for marginal, jumping in (
        (ot.Exponential(1.0, 0.0), {"gamma"}),
        (ot.TruncatedDistribution(ot.Normal(0.0, 1.0), -1.0, 1.0), {"lowerBound", "upperBound"}),
        (ot.Triangular(0.0, 1.0, 3.0), set()),
        (ot.WeibullMin(1.0, 3.0, 0.0), set()),
    ):
        x = np.array(marginal.getSample(2000))
        sample = FailureSample.ofMonteCarlo(x, generator.random(2000) < 0.5)
        rows = computeParameterSensitivity(sample, ot.JointDistribution([marginal]), 0.95)
        assert {row.parameter for row in rows if row.derivative is None} == jumping
        assert all("jumps" in row.note for row in rows if row.derivative is None)


def test_intervals_of_the_derivatives_cover():
    # Monte Carlo samples: the cheapest estimate whose derivative is known.
    truth = phi(1.0)
    covered = 0
    for _ in range(100):
        x = np.array(ot.Normal(1).getSample(300))
        row = computeParameterSensitivity(FailureSample.ofMonteCarlo(x, x[:, 0] > 1.0), ot.Normal(1), 0.9)[0]
        covered += row.lower <= truth <= row.upper
    assert 80 <= covered <= 98


# Importance. ---------------------------------------------------------------------------------------------------------


def test_importance_of_a_linear_problem_and_of_two_sided_failure():
    result = solve("0.8 * x0 + 0.6 * x1 + 1e-9 * x2", ot.Normal(3), 3.0)
    rows = result.computeImportance(0.999)
    shift = phi(3.0) / tail(3.0)
    for row, alpha in zip(rows, (0.8, 0.6, 0.0), strict=True):
        assert row.shiftLower <= alpha * shift <= row.shiftUpper
        spread = math.sqrt(1.0 + alpha**2 * (3.0 * shift - shift**2))
        assert row.spreadLower <= spread <= row.spreadUpper
    assert rows[0].share == pytest.approx(0.64, abs=0.06)
    assert sum(row.share for row in rows) == pytest.approx(1.0)
    both = solve("abs(x0) + 1e-9 * x1", ot.Normal(2), 3.0).computeImportance()
    assert both[0].share > 0.95
    assert abs(both[0].shift) < 0.2
    assert both[0].spread == pytest.approx(math.sqrt(1.0 + 3.0 * shift), rel=0.05)


# Other distributions. ------------------------------------------------------------------------------------------------


def test_probability_under_changed_tolerances():
    result = solve("0.8 * x0 + 0.6 * x1", ot.Normal(2), 3.0)
    for mean, deviation in (([0.2, 0.0], [1.0, 1.0]), ([0.0, 0.0], [0.9, 1.05]), ([-0.1, 0.1], [1.0, 0.95])):
        other = ot.Normal(mean, deviation, ot.CorrelationMatrix(2))
        truth = tail((3.0 - 0.8 * mean[0] - 0.6 * mean[1]) / math.hypot(0.8 * deviation[0], 0.6 * deviation[1]))
        answer = result.computeProbability(other, 0.999)
        assert answer.lower <= truth <= answer.upper
        assert not answer.warning
        assert answer.coefficientOfVariation < 0.1
    same = result.computeProbability(ot.Normal(2))
    assert same.probability == pytest.approx(result.getProbabilityEstimate(), rel=1e-9)
    assert same.upper == pytest.approx(result.getConfidenceInterval().getUpperBound()[0], rel=0.01)


@pytest.mark.parametrize("correlation", [0.0, 0.4])
def test_new_weights_are_the_ratio_of_the_joint_densities(correlation):
    matrix = ot.CorrelationMatrix(3)
    matrix[0, 1] = correlation
    copula = ot.NormalCopula(matrix) if correlation else ot.IndependentCopula(3)
    marginals = [ot.Normal(), ot.Uniform(-1.0, 1.0), ot.Exponential(2.0)]
    first = ot.JointDistribution(marginals, copula)
    other = ot.JointDistribution([ot.Normal(0.1, 0.9), *marginals[1:]], copula)
    x = np.array(first.getSample(4000))
    failed = x.sum(axis=1) > 0.5
    ratio = np.array(other.computePDF(x))[:, 0] / np.array(first.computePDF(x))[:, 0]
    answer = computeProbability(FailureSample.ofMonteCarlo(x, failed), first, other, 0.95)
    assert answer.probability == pytest.approx((failed * ratio).mean(), rel=1e-12)


def test_weights_that_no_longer_carry_the_answer_are_named():
    result = solve("0.8 * x0 + 0.6 * x1", ot.Normal(2), 3.0)
    answer = result.computeProbability(ot.Normal([-6.0, 5.0], [0.2, 0.2], ot.CorrelationMatrix(2)))
    assert "run the algorithm" in answer.warning
    with pytest.raises(ValueError, match="has 3 inputs"):
        result.computeProbability(ot.Normal(3))


def test_a_distribution_that_reaches_where_no_run_was_is_refused():
    first = ot.JointDistribution([ot.Uniform(0.0, 1.0)])
    sample = FailureSample.ofMonteCarlo(np.array([[0.2], [0.9]]), np.array([False, True]))
    with pytest.raises(ValueError, match=r"X0 reaches to 2.*bound of the first one is 1"):
        computeProbability(sample, first, ot.JointDistribution([ot.Uniform(0.0, 2.0)]), 0.95)
    narrower = computeProbability(sample, first, ot.JointDistribution([ot.Uniform(0.5, 1.0)]), 0.95)
    assert narrower.probability == pytest.approx(1.0)


def test_a_spread_that_is_hardly_known_does_not_make_an_input_important():
    # Corrections leave a spread below 0 of the second input, known to about 0.7; the first one is shifted by 3.
    x = np.column_stack([np.full(12, 3.0) + 0.5 * (-1.0) ** np.arange(12), np.zeros(12)])
    x[10:, 1] = [1.0, 2.0]
    weights = np.concatenate([np.full(10, 1e-3), [4e-3, -4e-3]])
    sample = dataclasses.replace(FailureSample.ofMonteCarlo(x, np.ones(12, dtype=bool)), weights=weights)
    first, second = computeImportance(sample, ot.Normal(2), 0.95)
    assert second.spread == 0.0
    assert second.spreadUpper > 1.0
    assert first.share > 0.8


# Where there is nothing to say. --------------------------------------------------------------------------------------


def test_no_failure_and_subset_simulation_have_no_sensitivities(monkeypatch):
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["1"]), ot.RandomVector(ot.Normal(2)))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 2.0))
    algorithm.setMaximumEvaluations(500)
    algorithm.run()
    with pytest.raises(RuntimeError, match="no run has failed"):
        algorithm.getResult().computeImportance()
    algorithm = ActiveSubspaceReliability(
        ot.ThresholdEvent(
            ot.CompositeRandomVector(ot.SymbolicFunction(["a"], ["a"]), ot.RandomVector(ot.Normal(1))),
            ot.Greater(),
            2.0,
        )
    )
    findNothing(monkeypatch)
    algorithm.setMaximumEvaluations(600)
    algorithm.run()
    assert algorithm.getResult().getMethod() == "SubsetSimulation"
    with pytest.raises(RuntimeError, match="subset simulation"):
        algorithm.getResult().computeParameterSensitivity()


# Files. --------------------------------------------------------------------------------------------------------------


def test_a_result_is_the_same_after_loading(tmp_path):
    result = solve(
        "0.8 * x0 + 0.6 * x1 + 0.1 * x2^2", ot.JointDistribution([ot.Normal(), ot.Normal(), ot.Normal(0.5, 1.2)]), 4.0
    )
    path = tmp_path / "result.npz"
    result.save(path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["result.npz"]
    loaded = ActiveSubspaceReliabilityResult.load(path)
    assert repr(loaded) == repr(result)
    for name in (
        "getProbabilityEstimate", "getVarianceEstimate", "getReliabilityIndex", "getSurrogateProbability", "getPhases",
        "getActiveDimensions", "getDiagnostics", "getConverged", "getReason", "getMethod", "getInputSample",
        "getOutputSample", "getConfidenceInterval", "computeParameterSensitivity", "computeImportance",
    ):  # fmt: skip
        assert getattr(loaded, name)() == getattr(result, name)(), name
    other = ot.JointDistribution([ot.Normal(0.1, 1.0), ot.Normal(), ot.Normal(0.5, 1.2)])
    assert loaded.computeProbability(other) == result.computeProbability(other)
    point = [0.1, 0.2, 0.3]
    assert loaded.getMetaModelResult().getMetaModel()(point) == result.getMetaModelResult().getMetaModel()(point)
    assert loaded.getProbabilitySimulationResult().getProbabilityEstimate() == result.getProbabilityEstimate()
    for draw in ("drawProbabilityConvergence", "drawLimitState", "drawWeights", "drawImportance"):
        assert repr(getattr(loaded, draw)()) == repr(getattr(result, draw)())
    with pytest.raises(ValueError, match=r"must end on \.npz"):
        result.save(tmp_path / "result.pickle")
    for kept in (result, result.getTrueRuns()):
        with pytest.raises(FileNotFoundError, match=r"away.result\.npz cannot be written: there is no folder .*away$"):
            kept.save(tmp_path / "away" / "result.npz")
    (tmp_path / "other.npz").write_text("nothing", encoding="utf-8")
    with pytest.raises(ValueError, match="holds no ActiveSubspaceReliabilityResult"):
        ActiveSubspaceReliabilityResult.load(tmp_path / "other.npz")


def test_an_event_in_python_is_given_again_on_loading(tmp_path):
    function = ot.PythonFunction(2, 1, func_sample=lambda x: np.asarray(x).sum(axis=1, keepdims=True))
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(2))), ot.Greater(), 4.0)
    algorithm = ActiveSubspaceReliability(event)
    algorithm.run()
    algorithm.getResult().save(tmp_path / "result.npz")
    loaded = ActiveSubspaceReliabilityResult.load(tmp_path / "result.npz")
    for needing in (loaded.getProbabilitySimulationResult, loaded.getEvent):
        with pytest.raises(RuntimeError, match="give it to load"):
            needing()
    again = ActiveSubspaceReliabilityResult.load(tmp_path / "result.npz", event)
    assert again.getEvent() == event
    assert again.getProbabilitySimulationResult().getProbabilityEstimate() == loaded.getProbabilityEstimate()
    assert dataclasses.asdict(again.computeImportance()[0]) == dataclasses.asdict(loaded.computeImportance()[0])


def test_parameters_that_have_no_score_say_why():
    random = np.random.default_rng(0)
    copula = ot.NormalCopula(ot.CorrelationMatrix([[1.0, 0.5], [0.5, 1.0]]))
    dependent = ot.JointDistribution([ot.Uniform(0.0, 1.0), ot.TruncatedNormal(0.0, 1.0, -40.0, 40.0)], copula)
    x = np.array(dependent.getSample(500))
    rows = computeParameterSensitivity(FailureSample.ofMonteCarlo(x, random.random(500) < 0.5), dependent, 0.95)
    notes = {(row.input, row.parameter): row.note for row in rows}
    assert "uniform input that depends on others" in notes["X0", "a"]
    # Bounds that no double can tell from infinity.
    assert "does not depend on the parameter" in notes["X1", "b"]
    assert not notes["X1", "mu"]


def test_weights_with_a_large_error_are_named_though_many_runs_failed():
    # Half of the runs failed, all with the same small effect on a probability that one large correction makes unsure.
    law = ot.Normal(1)
    x = np.array(law.getSample(200))
    sample = FailureSample.ofMonteCarlo(x, np.arange(200) % 2 == 0)
    sample.weights[0] = 1.0
    answer = computeProbability(sample, law, law, 0.95)
    assert "error of more than half of the probability" in answer.warning
    assert answer.coefficientOfVariation > 0.5
    # A correction that takes more than all of it leaves 0 and a bound, and nothing to share out.
    sample.weights[0] = -1.0
    with pytest.raises(RuntimeError, match=r"there is no importance: the estimate, -0\.5.*, is not positive"):
        computeImportance(sample, law, 0.95)
    answer = computeProbability(sample, law, law, 0.95)
    assert (answer.probability, answer.lower, answer.coefficientOfVariation) == (0.0, 0.0, math.inf)
    assert 0.0 < answer.upper <= 1.0
    assert "error of more than half" in answer.warning


class Linked(ot.PythonDistribution):
    """A normal law whose parameters can only be changed together."""

    def __init__(self):
        super().__init__(1)

    def getRange(self):
        return ot.Normal().getRange()

    def computeCDF(self, x):
        return ot.Normal().computeCDF(x)

    def computePDF(self, x):
        return ot.Normal().computePDF(x)

    def getParameter(self):
        return [0.0]

    def getParameterDescription(self):
        return ["knob"]

    def setParameter(self, parameter):
        raise ValueError("only together")


def test_a_parameter_that_cannot_be_changed_by_itself_has_no_derivative():
    law = ot.Distribution(Linked())
    x = np.array(ot.Normal().getSample(200))
    rows = computeParameterSensitivity(FailureSample.ofMonteCarlo(x, x[:, 0] > 0.5), law, 0.95)
    assert [row.note for row in rows] == ["the parameter cannot be changed by itself"]
    assert rows[0].derivative is None
