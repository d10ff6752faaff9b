"""Discrete inputs and atoms: conditioned on their values and summed, within the limit of the whole."""

import itertools

import numpy as np
import openturns as ot
import pytest
from scipy.stats import norm, poisson

from satsep_ot import ActiveSubspaceReliability, ConditionalReliability, ReliabilityComparison
from satsep_ot.methods.reliability.atoms import AtomicInputs


def threshold(formula, names, marginals, value, copula=None):
    law = ot.JointDistribution(marginals) if copula is None else ot.JointDistribution(marginals, copula)
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(names, [formula]), ot.RandomVector(law))
    return ot.ThresholdEvent(vector, ot.Greater(), value)


def answer(event, seed=0, **options):
    ot.RandomGenerator.SetSeed(seed)
    algorithm = ConditionalReliability(event)
    for key, value in options.items():
        getattr(algorithm.getAlgorithm(), f"set{key}")(value)
    algorithm.run()
    return algorithm.getResult()


def covers(result, truth, level=0.999):
    return result.getConfidenceInterval(level).contains([truth])


def switch():
    """A spring that fails with 2 % and lamps that burn out: x > 4 - 1.5 failed - 0.5 lamps."""
    marginals = [ot.Bernoulli(0.02), ot.Normal(), ot.Poisson(0.05)]
    event = threshold("x + 1.5 * failed + 0.5 * lamps", ["failed", "x", "lamps"], marginals, 4.0)
    truth = sum(
        (0.02 if failed else 0.98) * poisson.pmf(lamps, 0.05) * norm.sf(4.0 - 1.5 * failed - 0.5 * lamps)
        for failed in (0, 1)
        for lamps in range(12)
    )
    return event, truth


def test_the_sum_over_bernoulli_and_poisson():
    event, truth = switch()
    result = answer(event)
    assert covers(result, truth)
    assert result.getConverged()
    assert result.getCoefficientOfVariation() < 0.05
    parts = result.getParts()
    assert len(parts) == 2 * 7
    assert sum(part.weight for part in parts) == pytest.approx(1.0, abs=1e-9)
    assert [part.weight for part in parts] == sorted((part.weight for part in parts), reverse=True)
    for part in parts:
        exact = norm.sf(4.0 - 1.5 * part.values["failed"] - 0.5 * part.values["lamps"])
        assert part.result.getConfidenceInterval(0.9999).contains([exact])
        assert part.lower95 <= part.probability <= part.upper95
    assert result.getProbabilityEstimate() == sum(part.weight * part.probability for part in parts)
    assert result.getEvaluationNumber() == sum(part.evaluations for part in parts) <= 5000


def test_the_interval_of_the_sum_covers():
    event = threshold("x + 1.5 * failed", ["failed", "x"], [ot.Bernoulli(0.02), ot.Normal()], 4.0)
    truth = 0.98 * norm.sf(4.0) + 0.02 * norm.sf(2.5)
    inside = [covers(answer(event, seed, TargetCoefficientOfVariation=0.2), truth, 0.9) for seed in range(10)]
    assert sum(inside) >= 7


def test_a_mixture_with_an_atom():
    # No load with 30 %, else normal; and a part that is Dirac or uniform.
    load = ot.Mixture([ot.Dirac(0.0), ot.Normal(2.0, 1.0)], [0.3, 0.7])
    gap = ot.Mixture([ot.Uniform(0.0, 1.0), ot.FiniteDiscreteDistribution([[0.0], [3.0]], [0.5, 0.5])], [0.8, 0.2])
    event = threshold("load + x + gap", ["load", "x", "gap"], [load, ot.Normal(), gap], 6.0)
    ot.RandomGenerator.SetSeed(0)
    sample = np.array(event.getAntecedent().getDistribution().getSample(2_000_000)).sum(axis=1)
    truth = (sample > 6.0).mean()
    result = answer(event)
    assert len(result.getParts()) == 2 * 3
    assert covers(result, truth)
    continuous = [part for part in result.getParts() if not part.values]
    assert [part.weight for part in continuous] == [pytest.approx(0.7 * 0.8)]
    assert None in [row["load"] for row in result.getTable()]


def test_continuous_inputs_keep_their_dependence():
    correlation = ot.CorrelationMatrix(3)
    correlation[0, 2] = 0.8
    event = threshold(
        "a + b + c", ["a", "b", "c"], [ot.Normal(), ot.Bernoulli(0.1), ot.Normal()], 5.0, ot.NormalCopula(correlation)
    )
    sigma = (2.0 + 2.0 * 0.8) ** 0.5
    truth = 0.9 * norm.sf(5.0 / sigma) + 0.1 * norm.sf(4.0 / sigma)
    assert covers(answer(event), truth)


def test_where_no_continuous_input_is_left_one_run_tells():
    event = threshold("a * b", ["a", "b"], [ot.Bernoulli(0.25), ot.Geometric(0.9)], 1.5)
    result = answer(event)
    # Both exactly known, but for values rarer than 1e-12.
    assert result.getProbabilityEstimate() == pytest.approx(0.25 * 0.1, rel=1e-9)
    assert result.getEvaluationNumber() == len(result.getParts())
    assert covers(result, 0.025)
    assert result.getConverged()
    assert result.getReason() == f"all {len(result.getParts())} parts have converged"


def test_events_of_all_kinds_and_components():
    names, marginals = ["a", "b", "c"], [ot.Normal(), ot.Bernoulli(0.1), ot.Normal()]
    law = ot.JointDistribution(marginals)
    function = ot.SymbolicFunction(names, ["a + b", "c - b"])
    vector = ot.CompositeRandomVector(function, ot.RandomVector(law))
    first, second = (ot.ThresholdEvent(vector.getMarginal(i), ot.Greater(), 2.5) for i in range(2))
    domain = ot.Interval([2.5, 2.5], [9.0, 9.0], [True, True], [False, False])

    def probability(combine):
        parts = [(0.9, norm.sf(2.5), norm.sf(2.5)), (0.1, norm.sf(1.5), norm.sf(3.5))]
        return sum(weight * combine(p, q) for weight, p, q in parts)

    assert covers(answer(ot.UnionEvent([first, second])), probability(lambda p, q: p + q - p * q))
    assert covers(answer(ot.IntersectionEvent([first, second])), probability(lambda p, q: p * q))
    assert covers(answer(ot.DomainEvent(vector, domain)), probability(lambda p, q: p * q))
    largest = ot.ComposedFunction(ot.SymbolicFunction(["p", "q"], ["max(p, q)"]), function)
    event = ot.ThresholdEvent(ot.CompositeRandomVector(largest, ot.RandomVector(law)), ot.Greater(), 2.5)
    ot.RandomGenerator.SetSeed(0)
    algorithm = ConditionalReliability(event)
    algorithm.getAlgorithm().setComponents(function, ot.SymbolicFunction(["p", "q"], ["max(p, q)"]))
    algorithm.run()
    assert covers(algorithm.getResult(), probability(lambda p, q: p + q - p * q))


@pytest.mark.parametrize("maximum", [60, 200, 700])
def test_all_parts_together_stay_within_the_limit(maximum):
    runs = []

    def evaluate(x):
        x = np.asarray(x, dtype=float)
        runs.append(len(x))
        return x.sum(axis=1, keepdims=True)

    law = ot.JointDistribution(
        [ot.Bernoulli(0.3), ot.Normal(), ot.FiniteDiscreteDistribution([[0.0], [1.0]], [0.5, 0.5])]
    )
    vector = ot.CompositeRandomVector(ot.PythonFunction(3, 1, func_sample=evaluate), ot.RandomVector(law))
    result = answer(ot.ThresholdEvent(vector, ot.Greater(), 3.0), MaximumEvaluations=maximum)
    assert sum(runs) == result.getEvaluationNumber() <= maximum
    truth = 0.35 * norm.sf(3.0) + 0.5 * norm.sf(2.0) + 0.15 * norm.sf(1.0)
    assert covers(result, truth)
    if maximum == 60:
        assert not result.getConverged()
        assert "of 4 parts have not converged; together they may add up to" in result.getReason()


def test_too_small_a_limit_names_the_part():
    with pytest.raises(ValueError, match=r"given failed = 0, lamps = 0: the maximum number of evaluations is 8"):
        answer(switch()[0], MaximumEvaluations=8 * 14)


def test_more_than_64_combinations_are_refused_with_their_number():
    def inputs(*sizes):
        laws = [ot.FiniteDiscreteDistribution(np.arange(float(n))[:, None], [1.0 / n] * n) for n in sizes]
        return AtomicInputs(ot.JointDistribution([*laws, ot.Normal()]))

    assert len(list(inputs(8, 8).combinations())) == 64
    with pytest.raises(ValueError, match=r"have 65 combinations \(\w+: 5, \w+: 13\).*at most 64"):
        inputs(5, 13)
    event = threshold("a + b + x", ["a", "b", "x"], [ot.Poisson(9.0), ot.Poisson(9.0), ot.Normal()], 4.0)
    with pytest.raises(ValueError, match=r"combinations \(a: \d+, b: \d+\)"):
        answer(event)


def test_what_cannot_be_conditioned_is_refused_with_the_reason():
    correlation = ot.CorrelationMatrix(2)
    correlation[0, 1] = 0.5
    marginals = [ot.Bernoulli(0.1), ot.Normal()]
    for copula in (ot.NormalCopula(correlation), ot.ClaytonCopula(2.0)):
        with pytest.raises(ValueError, match="a may depend on other inputs"):
            answer(threshold("a + b", ["a", "b"], marginals, 3.0, copula))
    with pytest.raises(ValueError, match="no input is discrete or has atoms; use ActiveSubspaceReliability"):
        answer(threshold("a + b", ["a", "b"], [ot.Normal()] * 2, 3.0))
    with pytest.raises(ValueError, match="as ConditionalReliability does"):
        ActiveSubspaceReliability(threshold("a + b", ["a", "b"], marginals, 3.0)).run()
    algorithm = ConditionalReliability(threshold("a + b", ["a", "b"], marginals, 3.0))
    with pytest.raises(RuntimeError, match="no result yet"):
        algorithm.getResult()
    algorithm.getAlgorithm().setKnownRuns([[0.0, 1.0]], [[1.0]])
    with pytest.raises(ValueError, match="known runs cannot be given where inputs have atoms"):
        algorithm.run()
    with pytest.raises(TypeError, match="give a ThresholdEvent"):
        ConditionalReliability(ot.SymbolicFunction("x", "x"))
    result = answer(threshold("a", ["a", "b"], marginals, 0.5))
    with pytest.raises(ValueError, match="level"):
        result.getConfidenceInterval(0.0)


def test_a_failing_function_names_the_values():
    def evaluate(x):
        if np.asarray(x)[0, 0] == 1.0:
            raise ArithmeticError("no such spring")
        return np.asarray(x)[:, 1:]

    law = ot.JointDistribution([ot.Bernoulli(0.1), ot.Normal()])
    function = ot.PythonFunction(2, 1, func_sample=evaluate)
    function.setInputDescription(["spring", "x"])
    vector = ot.CompositeRandomVector(function, ot.RandomVector(law))
    with pytest.raises(RuntimeError, match=r"given spring = 1: .*no such spring"):
        answer(ot.ThresholdEvent(vector, ot.Greater(), 3.0))


def test_a_comparison_takes_it_where_inputs_have_atoms():
    event = threshold("a + b", ["a", "b"], [ot.Bernoulli(0.1), ot.Normal()], 3.0)
    ot.RandomGenerator.SetSeed(0)
    comparison = ReliabilityComparison(event, ["ActiveSubspace", "FORM"])
    comparison.setMaximumEvaluations(2000)
    comparison.run()
    ours, theirs = comparison.getResult().getRows()
    assert ours.lower95 < 0.9 * norm.sf(3.0) + 0.1 * norm.sf(2.0) < ours.upper95
    assert ours.converged
    assert ours.note == "all 2 parts have converged"
    assert ours.evaluations <= 2000
    assert theirs.probability is None


def test_each_part_has_a_checkpoint_of_its_own(tmp_path):
    event = threshold("a + b", ["a", "b"], [ot.Bernoulli(0.1), ot.Normal()], 3.0)
    first = answer(event, CheckpointFile=tmp_path / "runs")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["runs.1", "runs.2"]
    again = answer(event, 7, CheckpointFile=tmp_path / "runs")
    assert again.getProbabilityEstimate() == first.getProbabilityEstimate()


def test_every_combination_is_there_once():
    law = ot.JointDistribution([ot.Bernoulli(0.1), ot.Normal(), ot.Mixture([ot.Dirac(2.0), ot.Normal()], [0.5, 0.5])])
    found = [(tuple(part.fixed.items()), part.law.getDimension()) for part in AtomicInputs(law).combinations()]
    assert found == [
        (((0, spring), *((2, 2.0),) * fixed), 2 - fixed) for spring, fixed in itertools.product((0.0, 1.0), (1, 0))
    ]
