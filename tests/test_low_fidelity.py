"""A cheap model beside the heavy one saves runs where it is nearly right, and costs no truth where it is wrong."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.low_fidelity import fitFailures
from satsep_ot.methods.reliability.mixture import normalLogDensity

INPUTS = 12
BETA = 3.2
TRUTH = ot.Normal().computeComplementaryCDF(BETA)


def vectorised(rule, inputs=INPUTS, outputs=1):
    return ot.PythonFunction(inputs, outputs, func_sample=lambda x: rule(np.array(x)).reshape(-1, outputs))


def summed(x):
    return x.sum(axis=1) / np.sqrt(x.shape[1])


HEAVY = vectorised(summed)
NEARLY = vectorised(lambda x: 2.0 * summed(x) + 1.0 + 0.1 * np.sin(3.0 * x[:, 0]))
UNRELATED = vectorised(lambda x: x[:, 0] - x[:, 1])


def algorithm_for(function=HEAVY, threshold=BETA, low=None, seed=0):
    ot.RandomGenerator.SetSeed(seed)
    vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(INPUTS)))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), threshold))
    algorithm.setLowFidelity(low)
    return algorithm


def result_of(*arguments, **settings):
    algorithm = algorithm_for(*arguments, **settings)
    algorithm.run()
    return algorithm.getResult()


def holds(result, truth=TRUTH):
    interval = result.getConfidenceInterval(0.99)
    return interval.getLowerBound()[0] < truth < interval.getUpperBound()[0]


def bent(x):
    """Three directions, too many for a ridge of few runs."""
    return summed(x) + 0.2 * np.sin(2.0 * x[:, 0]) * np.cos(2.0 * x[:, 1]) + 0.1 * np.cos(3.0 * x[:, 2])


def test_a_cheap_model_that_is_nearly_right_saves_runs():
    cheap = vectorised(lambda x: bent(x) + 0.02 * np.sin(4.0 * x[:, 4]))
    threshold = 3.2
    sample = np.random.default_rng(1).standard_normal((2_000_000, INPUTS))
    truth = (bent(sample) > threshold).mean()
    alone, together = (result_of(vectorised(bent), threshold, low) for low in (None, cheap))
    for result in (alone, together):
        assert result.getConverged()
        assert holds(result, truth)
    assert together.getEvaluationNumber() < 0.5 * alone.getEvaluationNumber()


@pytest.mark.parametrize("low", [NEARLY, UNRELATED], ids=["nearly right", "unrelated"])
def test_the_answer_is_the_heavy_model_s(low):
    result = result_of(low=low)
    assert result.getConverged()
    assert holds(result)
    assert result.getEvaluationNumber() <= 1.3 * result_of().getEvaluationNumber()


def test_a_mode_that_the_cheap_model_lacks_is_found():
    heavy = vectorised(lambda x: np.maximum(summed(x), (x[:, 0] - x[:, 1]) / np.sqrt(2.0)))
    result = result_of(heavy, low=HEAVY)
    truth = 1.0 - (1.0 - TRUTH) ** 2
    interval = result.getConfidenceInterval(0.99)
    assert interval.getUpperBound()[0] > truth
    assert result.getProbabilityEstimate() > 0.8 * truth or not result.getConverged()


def test_components_are_corrected_one_by_one():
    """The second component has no cheap model worth its name."""
    heavy = vectorised(lambda x: np.column_stack([summed(x), x[:, 0] - x[:, 1]]), outputs=2)
    cheap = vectorised(lambda x: np.column_stack([2.0 * summed(x), 0.0 * x[:, 0]]), outputs=2)
    largest = ot.SymbolicFunction(["a", "b"], ["max(a, b / sqrt(2))"])
    algorithm = algorithm_for(ot.ComposedFunction(largest, heavy), low=cheap)
    algorithm.setComponents(heavy, largest)
    algorithm.run()
    result = algorithm.getResult()
    assert result.getConverged()
    assert holds(result, 1.0 - (1.0 - TRUTH) ** 2)


@pytest.mark.parametrize(
    "low", [vectorised(lambda x: 0.0 * x[:, 0]), vectorised(lambda x: np.full(len(x), np.nan))], ids=["flat", "NaN"]
)
def test_a_cheap_model_that_never_fails_changes_nothing(low):
    result = result_of(low=low)
    assert result.getConverged()
    assert holds(result)


def test_values_that_a_cheap_model_lacks_are_no_matter():
    low = vectorised(lambda x: np.where(x[:, 0] < -1.0, np.nan, summed(x)))
    result = result_of(low=low)
    assert result.getConverged()
    assert holds(result)


def test_the_same_seed_gives_the_same_bits():
    first, second = (result_of(low=NEARLY) for _ in range(2))
    assert first.getProbabilityEstimate() == second.getProbabilityEstimate()
    assert first.getEvaluationNumber() == second.getEvaluationNumber()


def test_the_cheap_model_needs_the_same_inputs_and_outputs():
    algorithm = algorithm_for(low=ot.SymbolicFunction(["a"], ["a"]))
    with pytest.raises(ValueError, match="has 1 inputs and 1 outputs; it must have 12 and 1"):
        algorithm.run()


def test_a_cheap_model_that_raises_is_named():
    def fail(x):
        raise ValueError("no licence")

    with pytest.raises(RuntimeError, match=r"the low-fidelity function: .*no licence"):
        result_of(low=ot.PythonFunction(INPUTS, 1, fail))


def test_a_mixture_of_failures_covers_each_of_two_modes():
    generator = np.random.default_rng(0)
    points = generator.standard_normal((4000, 20))
    points[:2000, 0] += 3.0
    points[2000:, 1] -= 3.0
    mixture = fitFailures(points, generator)
    assert mixture.bases[0].shape[1] <= 3
    assert (mixture.logDensity(points) - normalLogDensity(points) > 0.0).mean() > 0.9
