"""Benchmark problems: their reference probabilities, and one contract for all."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.comparison.problems import getBenchmarkProblem, getBenchmarkProblems

PROBLEMS = {problem.getName(): problem for problem in getBenchmarkProblems()}
# Published values (otbenchmark; RP8: RPRepo; P2: Papaioannou 2015), and how far their authors' methods leave them off.
PUBLISHED = {
    "P2": (6.62e-6, 1e-3),
    "RP8": (7.84e-4, 1e-2),
    "RP14": (7.7285e-4, 1e-4),
    "RP22": (4.20730551129961794e-3, 1e-8),
    "RP54": (9.98e-4, 1e-2),
    "RP63": (3.79e-4, 1e-2),
    "RP91": (6.97e-4, 1e-2),
    "RP107": (2.92e-7, 2e-2),
    "FourBranch": (2.222795066194439887e-3, 1e-8),
}


@pytest.mark.parametrize("name", PROBLEMS)
def test_every_problem_is_an_event_that_its_components_compose(name):
    problem = PROBLEMS[name]
    assert 0.0 < problem.getProbability() < 0.1
    assert problem.getSource()
    # Only what was sampled has an error, and one that a method need not be held against.
    assert (problem.getProbabilityError() > 0.0) == (name == "P3" or name.endswith("35"))
    assert problem.getProbabilityError() < 0.01
    sample = problem.getDistribution().getSample(20)
    event = problem.getEvent()
    function, composition = problem.getComponents()
    direct = np.array(event.getFunction()(sample))
    assert direct.shape == (20, 1)
    np.testing.assert_allclose(np.array(composition(function(sample))), direct, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(problem.evaluate(np.array(sample)), direct[:, 0], rtol=1e-12, atol=1e-12)
    assert event.getOperator().compare(0.0, event.getThreshold())


@pytest.mark.parametrize("name", PUBLISHED)
def test_computed_references_agree_with_published_ones(name):
    value, accuracy = PUBLISHED[name]
    assert PROBLEMS[name].getProbability() == pytest.approx(value, rel=accuracy)


def test_rp8_is_the_convolution_of_its_inputs():
    distribution = PROBLEMS["RP8"].getDistribution()
    total = distribution.getMarginal(0) + distribution.getMarginal(3)
    for place, factor in ((1, 2.0), (2, 2.0), (4, -5.0), (5, -5.0)):
        total = total + distribution.getMarginal(place) * factor
    assert ot.Distribution(total).computeCDF(0.0) == pytest.approx(PROBLEMS["RP8"].getProbability(), rel=1e-6)


def test_sum_of_absolute_values_agrees_with_importance_sampling():
    u = 1.25 * np.random.default_rng(3).standard_normal((250_000, 20))
    weights = 1.25**20 * np.exp(-0.5 * (1.0 - 1.25**-2) * (u**2).sum(axis=1)) * (PROBLEMS["P7"].evaluate(u) <= 0.0)
    error = weights.std() / np.sqrt(len(weights))
    assert abs(weights.mean() - PROBLEMS["P7"].getProbability()) < 4.0 * error < 0.2 * weights.mean()


# Variants. -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["P1", "P4", "RP8", "RP14", "RP91"])
def test_rotated_problem_is_the_same_event_and_no_input_is_special(name):
    problem, rotated = PROBLEMS[name], PROBLEMS[name].rotated()
    assert rotated.getName() == f"{name}-rotated"
    assert (rotated.getProbability(), rotated.getSource()) == (problem.getProbability(), problem.getSource())
    # The rotation, from what the rotated problem does to the inputs of the original one.
    d = problem.getDistribution().getDimension()
    u = np.array(rotated.getDistribution().getSample(5))
    matrix, _ = np.linalg.qr(np.random.default_rng(0).standard_normal((d, d)))
    signs = np.sign(np.diag(matrix.T @ np.random.default_rng(0).standard_normal((d, d))))
    turned = u @ (matrix * signs).T
    physical = np.array(problem.getDistribution().getInverseIsoProbabilisticTransformation()(turned))
    np.testing.assert_allclose(rotated.evaluate(u), problem.evaluate(physical), rtol=1e-9, atol=1e-9)
    assert np.abs(matrix).max() < 0.999
    other = problem.rotated(seed=1)
    assert np.abs(other.evaluate(u) - rotated.evaluate(u)).max() > 1e-3 * np.abs(rotated.evaluate(u)).max()


@pytest.mark.parametrize("name", ["P4", "RP8", "RP14", "RP54", "RP91", "FourBranch"])
def test_rescaled_problem_is_the_same_event_in_other_units(name):
    problem, rescaled = PROBLEMS[name], PROBLEMS[name].rescaled()
    distribution, scaled = problem.getDistribution(), rescaled.getDistribution()
    units = np.array(scaled.getStandardDeviation()) / np.array(distribution.getStandardDeviation())
    exponents = np.log10(units)
    np.testing.assert_allclose(exponents, np.round(exponents), atol=1e-9)
    assert np.ptp(exponents) > 1.0
    x = np.array(distribution.getSample(200))
    ratio = rescaled.evaluate(x * units) / problem.evaluate(x)
    np.testing.assert_allclose(ratio, ratio[0], rtol=1e-6)
    assert ratio[0] > 0.0
    np.testing.assert_allclose(
        np.array(scaled.getInverseIsoProbabilisticTransformation()(ot.Sample(1, x.shape[1]))),
        units * np.array(distribution.getInverseIsoProbabilisticTransformation()(ot.Sample(1, x.shape[1]))),
        rtol=1e-9,
        atol=1e-12,
    )
    function, composition = rescaled.getComponents()
    np.testing.assert_allclose(
        np.array(composition(function(x * units)))[:, 0], rescaled.evaluate(x * units), rtol=1e-12
    )


@pytest.mark.parametrize("name", ["P1-d7", "P2-d10", "P4-d4", "P4-d200", "P5-d3", "P6-d3", "RP107-d40"])
def test_resized_problem_keeps_its_kind_of_event(name):
    base, dimension = name.split("-d")
    problem = getBenchmarkProblem(name)
    assert problem.getName() == name
    assert problem.getDistribution().getDimension() == int(dimension)
    assert problem.getProbability() == pytest.approx(PROBLEMS[base].getProbability(), rel=1e-9)


@pytest.mark.parametrize("name", ["P4-d10", "P5-d3", "P4-rotated", "RP14-rescaled", "RP91-rotated-rescaled"])
def test_references_of_variants_agree_with_monte_carlo(name):
    problem = getBenchmarkProblem(name)
    ot.RandomGenerator.SetSeed(2)
    size = 100_000
    failures = np.count_nonzero(problem.evaluate(np.array(problem.getDistribution().getSample(size))) <= 0.0)
    expected = size * problem.getProbability()
    assert abs(failures - expected) < 4.0 * np.sqrt(expected)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("P1-turned", "'P1-turned' is no variant"),
        ("P1-rotated-d5", "'P1-rotated-d5' is no variant"),
        ("P1-d", "no variant"),
        ("P3-d10", "P3 has one number of inputs; another one can be had of P1, P2"),
        ("P4-d3", "P4 is there with 4 to 1000 inputs, not with 3"),
        ("P1-d2000", "not with 2000"),
    ],
)
def test_variants_that_do_not_exist_are_refused(name, message):
    with pytest.raises(ValueError, match=message):
        getBenchmarkProblem(name)


@pytest.mark.parametrize(
    "name", ["P3", "P4", "P5", "RP8", "RP14", "RP22", "RP91", "FourBranch", "Speed35", "Absolute35", "System35"]
)
def test_references_agree_with_monte_carlo(name):
    problem = PROBLEMS[name]
    ot.RandomGenerator.SetSeed(1)
    size = 200_000
    failures = np.count_nonzero(problem.evaluate(np.array(problem.getDistribution().getSample(size))) <= 0.0)
    expected = size * problem.getProbability()
    assert abs(failures - expected) < 4.0 * np.sqrt(expected)


def test_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="P1, P2"):
        getBenchmarkProblem("P99")
