"""Laws of polynomials of normals that are known in closed form."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.polynomial_distribution import PolynomialDistribution
from satsep_ot.methods.polynomial_regression import MultivariatePolynomialRegression


def law_of(r, function, degree=4):
    ot.RandomGenerator.SetSeed(6)
    inputs = np.array(ot.Normal(r).getSample(150))
    regression = MultivariatePolynomialRegression(inputs, function(inputs)[:, None], ot.Normal(r))
    regression.setDegree(degree)
    regression.run()
    return PolynomialDistribution(regression.getResult())


@pytest.mark.parametrize(("r", "tolerance"), [(1, 1e-12), (2, 2e-4), (3, 1e-3)])
def test_sum_of_squares_is_chi_square(r, tolerance):
    law = law_of(r, lambda y: (y**2).sum(axis=1))
    reference = ot.ChiSquare(float(r))
    for t in (0.3, 1.0, 4.0, 12.0):
        assert law.computeCDF(t) == pytest.approx(reference.computeCDF(t), abs=tolerance)
        assert law.computeCDF(t) + law.computeComplementaryCDF(t) == pytest.approx(1.0, abs=1e-12)
        assert abs(law.computeCDF(t) - reference.computeCDF(t)) <= 3.0 * law.computeCDFError(t) + 1e-12
    assert law.computeQuantile(0.9) == pytest.approx(reference.computeQuantile(0.9)[0], rel=1e-9 if r == 1 else 1e-2)
    assert law.computeCDF(-0.1) == 0.0
    if r == 1:
        assert law.computePDF(2.0) == pytest.approx(reference.computePDF(2.0), rel=1e-10)


@pytest.mark.parametrize("r", [1, 2, 3])
def test_linear_function_is_normal_far_into_the_tails(r):
    direction = np.array([3.0, -2.0, 1.0])[:r]
    law = law_of(r, lambda y: 1.0 + y @ direction)
    reference = ot.Normal(1.0, float(np.linalg.norm(direction)))
    assert (law.getMean(), law.getStandardDeviation()) == pytest.approx((1.0, reference.getSigma()[0]))
    for deviations in (-5.0, -1.0, 0.3, 5.0):
        t = 1.0 + deviations * reference.getSigma()[0]
        assert law.computeCDF(t) == pytest.approx(reference.computeCDF(t), rel=1e-8)
        assert law.computeComplementaryCDF(t) == pytest.approx(reference.computeComplementaryCDF(t), rel=1e-8)
        assert law.computePDF(t) == pytest.approx(reference.computePDF(t), rel=1e-8)
    for probability in (1e-6, 0.5, 1.0 - 1e-6):
        assert law.computeQuantile(probability) == pytest.approx(reference.computeQuantile(probability)[0], rel=1e-8)


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
        assert law.computePDF(t) == pytest.approx(density, rel=2e-3)


def test_constant_polynomial():
    law = law_of(1, lambda y: np.full(len(y), 2.0), degree=0)
    assert (law.computeCDF(1.9), law.computeCDF(2.1), law.computeComplementaryCDF(1.9)) == (0.0, 1.0, 1.0)
    assert law.computeQuantile(0.3) == pytest.approx(2.0)


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
    with pytest.raises(ValueError, match=r"\(0, 1\), got 1"):
        law_of(1, lambda y: y[:, 0]).computeQuantile(1.0)
