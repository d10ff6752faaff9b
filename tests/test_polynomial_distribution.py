"""Laws of polynomials of normals that are known in closed form."""

import pickle

import numpy as np
import openturns as ot
import pytest
from scipy import special
from time_ratio import time_ratio

from satsep_ot.methods.polynomials import distribution as polynomial_distribution
from satsep_ot.methods.polynomials.distribution import PolynomialDistribution
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression


def law_of(r, function, degree=4):
    ot.RandomGenerator.SetSeed(6)
    inputs = np.array(ot.Normal(r).getSample(150))
    regression = MultivariatePolynomialRegression(inputs, function(inputs)[:, None], ot.Normal(r))
    regression.setDegree(degree)
    regression.run()
    return PolynomialDistribution(regression.getResult())


@pytest.mark.parametrize(("r", "tolerance"), [(1, 1e-12), (2, 1e-12), (3, 1e-12)])
def test_sum_of_squares_is_chi_square(r, tolerance):
    law = law_of(r, lambda y: (y**2).sum(axis=1))
    reference = ot.ChiSquare(float(r))
    for t in (0.3, 1.0, 4.0, 12.0):
        assert law.computeCDF(t) == pytest.approx(reference.computeCDF(t), abs=tolerance)
        assert law.computeCDF(t) + law.computeComplementaryCDF(t) == pytest.approx(1.0, abs=1e-12)
        assert abs(law.computeCDF(t) - reference.computeCDF(t)) <= 3.0 * law.computeCDFError(t) + 1e-12
    assert law.computeQuantile(0.9) == pytest.approx(reference.computeQuantile(0.9)[0], rel=1e-9)
    assert law.computeCDF(-0.1) == 0.0
    assert law.computePDF(2.0) == pytest.approx(reference.computePDF(2.0), rel=1e-10)


@pytest.mark.parametrize("r", [1, 2, 3])
def test_linear_function_is_normal_far_into_the_tails(r):
    direction = np.array([3.0, -2.0, 1.0])[:r]
    law = law_of(r, lambda y: 1.0 + y @ direction)
    reference = ot.Normal(1.0, float(np.linalg.norm(direction)))
    assert (law.getMean(), law.getStandardDeviation()) == pytest.approx((1.0, reference.getSigma()[0]))
    # Close to the middle the half sphere is cut in two sharply.
    tolerance = 1e-8 if r < 3 else 1e-6
    for deviations in (-5.0, -1.0, 0.3, 5.0):
        t = 1.0 + deviations * reference.getSigma()[0]
        assert law.computeCDF(t) == pytest.approx(reference.computeCDF(t), rel=tolerance)
        assert law.computeComplementaryCDF(t) == pytest.approx(reference.computeComplementaryCDF(t), rel=tolerance)
        assert law.computePDF(t) == pytest.approx(reference.computePDF(t), rel=tolerance if r < 3 else 1e-3)
    for probability in (1e-6, 0.5, 1.0 - 1e-6):
        assert law.computeQuantile(probability) == pytest.approx(
            reference.computeQuantile(probability)[0], rel=tolerance
        )


def test_quartic_with_four_roots_agrees_with_its_intervals():
    # (y^2 - 1)(y^2 - 4) <= 0 on 1 <= |y| <= 2.
    law = law_of(1, lambda y: ((y**2 - 1.0) * (y**2 - 4.0))[:, 0])
    normal = ot.Normal()
    assert law.computeCDF(0.0) == pytest.approx(2.0 * (normal.computeCDF(2.0) - normal.computeCDF(1.0)), abs=1e-10)
    # The minimum is -9/4 at y^2 = 5/2: nothing below it.
    assert law.computeCDF(-2.26) == 0.0


def test_general_polynomial_agrees_with_sampling():
    def function(y):
        return y[:, 0] + 0.3 * y[:, 1] ** 2 * y[:, 0] - 0.2 * y[:, 1] ** 3

    law = law_of(2, function)
    values = function(np.array(ot.Normal(2).getSample(200000)))
    for t in (-3.0, 0.0, 2.0):
        assert law.computeCDF(t) == pytest.approx((values <= t).mean(), abs=0.005)
        density = (law.computeCDF(t + 1e-3) - law.computeCDF(t - 1e-3)) / 2e-3
        assert law.computePDF(t) == pytest.approx(density, rel=1e-2)


def by_sections(law_function, t):
    """P(p > t) for two variables by numpy's roots on 4001 sections, independent of lines through the origin."""
    nodes = np.linspace(-8.0, 8.0, 4001)
    probabilities = []
    for node in nodes:
        line = np.linspace(-1.0, 1.0, 5)
        power = np.polyfit(line, law_function(np.column_stack([line, np.full(5, node)])), 4)
        roots = np.roots(power - np.r_[0.0, 0.0, 0.0, 0.0, t])
        edges = np.r_[-9.0, np.sort(roots.real[np.abs(roots.imag) < 1e-9]), 9.0]
        above = np.polyval(power, 0.5 * (edges[1:] + edges[:-1])) > t
        probabilities.append(
            np.abs(np.diff(special.ndtr(-np.abs(edges)) * np.sign(edges) - (edges > 0.0)))[above].sum()
        )
    weights = np.exp(-0.5 * nodes**2)
    return weights @ probabilities / weights.sum()


@pytest.mark.parametrize("seed", range(4))
def test_stated_error_holds_far_in_the_tail(seed):
    random = np.random.default_rng(seed)
    a = random.standard_normal(5)

    def function(y):
        return (
            a[0] * y[:, 0] + a[1] * y[:, 1] + 0.3 * a[2] * y[:, 0] * y[:, 1]
            + 0.2 * a[3] * y[:, 0] ** 2 * y[:, 1] + 0.05 * a[4] * y[:, 1] ** 4
        )  # fmt: skip

    law = law_of(2, function)
    t = law.computeQuantile(1.0 - 1e-5)
    probability, error = law.computeComplementaryCDF(t), law.computeCDFError(t)
    assert probability == pytest.approx(1e-5, rel=1e-8)
    # The sections have an error of their own, below 1e-3 of the probability.
    assert abs(by_sections(function, t) - probability) <= error + 1e-3 * probability
    assert error <= 0.02 * probability


@pytest.mark.parametrize("r", [2, 3])
def test_stated_errors_hold_where_lines_touch_the_boundary(r, monkeypatch):
    def function(y):
        return (y[:, 0] - 2.0) ** 2 + y[:, 1] ** 2 + (y[:, 2] * y[:, 0] if r == 3 else 0.0)

    law = law_of(r, function)
    monkeypatch.setattr(polynomial_distribution, "PLANE_LINES", 20000)
    monkeypatch.setattr(polynomial_distribution, "POLAR_NODES", 160)
    monkeypatch.setattr(polynomial_distribution, "AZIMUTH_NODES", 320)
    reference = law_of(r, function)
    for t in (0.3, 2.0, 20.0):
        assert abs(law.computeCDF(t) - reference.computeCDF(t)) <= law.computeCDFError(t) < 1e-3
        assert abs(law.computePDF(t) - reference.computePDF(t)) <= law.computePDFError(t) + 1e-6


@pytest.mark.parametrize(("r", "size"), [(1, 10_000), (2, 100_000)])
def test_an_exact_probability_costs_less_than_drawing_a_sample(r, size):
    law, variables = law_of(r, lambda y: y[:, 0] + 0.1 * y[:, -1] ** 4), ot.Normal(r)
    assert time_ratio(lambda: law.computeCDF(1.0), lambda: variables.getSample(size)) < 1.0


def test_constant_polynomial():
    law = law_of(1, lambda y: np.full(len(y), 2.0), degree=0)
    assert (law.computeCDF(1.9), law.computeCDF(2.1), law.computeComplementaryCDF(1.9)) == (0.0, 1.0, 1.0)
    assert law.computeQuantile(0.3) == pytest.approx(2.0)


def test_kernel_density_of_a_sample_lies_beside_the_exact_one():
    ot.RandomGenerator.SetSeed(1)
    inputs = np.array(ot.Normal(2).getSample(100))
    regression = MultivariatePolynomialRegression(inputs, inputs[:, :1] + 0.2 * inputs[:, 1:] ** 2, ot.Normal(2))
    regression.run()
    result = regression.getResult()
    exact, sampled = PolynomialDistribution(result), result.getKernelDistribution()
    assert result.getSample(7).getSize() == 7
    for t in (-1.0, 0.5, 2.0):
        assert sampled.computeCDF(t) == pytest.approx(exact.computeCDF(t), abs=0.01)
        assert sampled.computePDF(t) == pytest.approx(exact.computePDF(t), rel=0.05)
    graph = exact.drawPDF()
    drawn = np.array(graph.getDrawable(0).getData())
    assert (0.5 * (drawn[1:, 1] + drawn[:-1, 1]) @ np.diff(drawn[:, 0])) == pytest.approx(0.999, abs=0.01)
    with pytest.raises(ValueError, match=r"is 1.0; it must be in \(0, 1\)"):
        exact.drawPDF(1.0)


def test_other_laws_and_dimensions_are_refused():
    inputs = np.array(ot.Normal(4).getSample(80))
    for columns, given, message in (
        (4, ot.Normal(4), "1 to 3 variables, got 4"),
        (1, ot.Uniform(-5.0, 5.0), "standard normal"),
    ):
        regression = MultivariatePolynomialRegression(inputs[:, :columns], inputs[:, :1], given)
        regression.setDegree(1)
        regression.run()
        with pytest.raises(ValueError, match=message):
            PolynomialDistribution(regression.getResult())
    with pytest.raises(ValueError, match=r"is 1.0; it must be in \(0, 1\)"):
        law_of(1, lambda y: y[:, 0]).computeQuantile(1.0)


def test_threshold_that_is_no_number_is_refused_and_infinity_has_its_limits():
    law = law_of(2, lambda y: y[:, 0] ** 3 + y[:, 1])
    for compute in (law.computeCDF, law.computeComplementaryCDF, law.computePDF, law.computeCDFError):
        with pytest.raises(ValueError, match="is nan; it must be a number"):
            compute(float("nan"))
    infinity = float("inf")
    assert (law.computeCDF(infinity), law.computeComplementaryCDF(infinity)) == pytest.approx((1.0, 0.0), abs=1e-12)
    assert (law.computeCDF(-infinity), law.computeComplementaryCDF(-infinity)) == pytest.approx((0.0, 1.0), abs=1e-12)


def test_an_output_that_is_not_there_is_named():
    inputs = np.linspace(-3.0, 3.0, 20)[:, None]
    regression = MultivariatePolynomialRegression(inputs, inputs**2, ot.Normal(1))
    regression.run()
    for output in (-1, 1):
        with pytest.raises(ValueError, match=f"output is {output}; it must be 0 to 0"):
            PolynomialDistribution(regression.getResult(), output)


@pytest.mark.parametrize("r", [1, 2, 3])
def test_an_openturns_distribution_in_all_that_takes_one(r):
    law = law_of(r, lambda y: (y**2).sum(axis=1))
    native, reference = law.getDistribution(), ot.ChiSquare(float(r))
    assert isinstance(native, ot.Distribution)
    for t in (0.3, 1.0, 4.0):
        assert native.computeCDF(t) == pytest.approx(reference.computeCDF(t), abs=1e-12)
        assert native.computePDF(t) == pytest.approx(reference.computePDF(t), rel=1e-9)
        assert native.computeSurvivalFunction(t) == pytest.approx(reference.computeSurvivalFunction(t), rel=1e-9)
    assert native.computeQuantile(0.9)[0] == pytest.approx(reference.computeQuantile(0.9)[0], rel=1e-9)
    assert native.computeQuantile(0.1, True)[0] == pytest.approx(reference.computeQuantile(0.9)[0], rel=1e-9)
    assert native.getMean()[0] == pytest.approx(r)
    assert native.getStandardDeviation()[0] == pytest.approx(np.sqrt(2.0 * r))
    assert native.getSkewness()[0] == pytest.approx(np.sqrt(8.0 / r))
    assert native.getKurtosis()[0] == pytest.approx(3.0 + 12.0 / r)
    # E[X^3] of a chi square variable.
    assert native.getMoment(3)[0] == pytest.approx(r * (r + 2) * (r + 4))
    assert native.getRange().contains([1.0])
    assert not native.getRange().contains([-0.1])
    assert native.drawPDF().getDrawables().getSize() == 1
    ot.RandomGenerator.SetSeed(1)
    sample = native.getSample(20000)
    assert sample.computeMean()[0] == pytest.approx(r, abs=5.0 * np.sqrt(2.0 * r / 20000))
    assert ot.FittingTest.Kolmogorov(sample[:1000], reference).getPValue() > 1e-3
    # In a random vector, a joint distribution and a Sobol analysis.
    joint = ot.JointDistribution([native, ot.Normal()])
    function = ot.SymbolicFunction(["a", "b"], ["a + b"])
    outputs = ot.CompositeRandomVector(function, ot.RandomVector(joint)).getSample(20000)
    assert outputs.computeVariance()[0] == pytest.approx(2.0 * r + 1.0, rel=0.1)
    indices = ot.SaltelliSensitivityAlgorithm(joint, 4000, function, False).getFirstOrderIndices()
    assert list(indices) == pytest.approx([2.0 * r / (2.0 * r + 1.0), 1.0 / (2.0 * r + 1.0)], abs=0.1)
    assert pickle.loads(pickle.dumps(native)).computeCDF(1.0) == native.computeCDF(1.0)


def test_arrays_are_taken_value_by_value():
    law = law_of(1, lambda y: y[:, 0] ** 2)
    points = np.array([[0.5, 1.0], [2.0, 3.0]])
    for method in (
        law.computeCDF,
        law.computeComplementaryCDF,
        law.computePDF,
        law.computeSurvivalFunction,
        law.computeCDFError,
    ):
        values = method(points)
        assert values.shape == (2, 2)
        assert values[1, 0] == method(2.0)
    assert law.computeQuantile([0.1, 0.5]).tolist() == [law.computeQuantile(0.1), law.computeQuantile(0.5)]
    assert law.computeQuantile([0.1, 0.5], True).tolist() == pytest.approx(law.computeQuantile([0.9, 0.5]).tolist())
    assert law.drawCDF().getDrawables().getSize() == 1


def test_a_constant_polynomial_is_a_dirac_distribution():
    law = law_of(1, lambda y: np.full(len(y), 2.0), degree=0)
    assert law.getDistribution().isDiscrete()
    assert law.getDistribution().getMean()[0] == pytest.approx(2.0)
    assert law.getMoment(2) == pytest.approx(4.0)
    with pytest.raises(ValueError, match="constant: it has no skewness"):
        law.getSkewness()
    with pytest.raises(ValueError, match=r"order of a moment is 1\.5; it must be a whole number of at least 0"):
        law.getMoment(1.5)
    with pytest.raises(ValueError, match=r"level is 1\.0; it must be in"):
        law.drawCDF(1.0)
