"""The polynomial regression against OpenTURNS, refitting, closed forms and known noise."""

import copy
import pickle

import numpy as np
import openturns as ot
import pytest
from time_ratio import time_ratio

from satsep_ot.methods.polynomials import regression as polynomial_regression
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression

FUNCTION = ot.SymbolicFunction(["a", "b", "c"], ["1 + a * b + c^2 * a", "b^4 - a^3 * c"])
LAWS = {
    "normal": ot.Normal([1.0, -2.0, 0.0], [2.0, 0.5, 1.0], ot.CorrelationMatrix(3)),
    "classic": ot.JointDistribution([ot.Uniform(1.0, 3.0), ot.Beta(2.0, 3.0, 0.0, 4.0), ot.Gamma(2.0, 3.0, 1.0)]),
    "other": ot.JointDistribution([ot.Gumbel(2.0, 1.0), ot.LogNormal(0.0, 0.2, 1.0), ot.Normal(10.0, 0.1)]),
}


class UniformInPython(ot.PythonDistribution):
    """Between 0 and 1."""

    def __init__(self):
        super().__init__(1)

    def getRange(self):
        return ot.Interval(0.0, 1.0)

    def computeCDF(self, point):
        return min(max(point[0], 0.0), 1.0)

    def computePDF(self, point):
        return float(0.0 <= point[0] <= 1.0)


def fitted(law, size=200, degree=4, noise=0.0, **options):
    ot.RandomGenerator.SetSeed(11)
    inputs = law.getSample(size)
    outputs = np.array(FUNCTION(inputs))
    outputs = outputs + noise * np.array(ot.Normal(2).getSample(size))
    regression = MultivariatePolynomialRegression(inputs, outputs, law)
    regression.setDegree(degree)
    for name, value in options.items():
        getattr(regression, name)(value)
    regression.run()
    return regression.getResult()


@pytest.mark.parametrize("name", sorted(LAWS))
def test_quartic_and_its_derivatives_are_exact(name):
    law = LAWS[name]
    result = fitted(law)
    metaModel = result.getMetaModel()
    fresh = law.getSample(40)
    truth = np.array(FUNCTION(fresh))
    np.testing.assert_allclose(result.evaluate(fresh), truth, rtol=1e-9, atol=1e-9 * np.abs(truth).max())
    np.testing.assert_allclose(np.array(metaModel(fresh)), truth, rtol=1e-9, atol=1e-9 * np.abs(truth).max())
    gradient, hessian = result.computeGradient(fresh), result.computeHessian(fresh)
    for k in range(5):
        for found, exact in (
            (gradient[k], FUNCTION.gradient(fresh[k])),
            (metaModel.gradient(fresh[k]), FUNCTION.gradient(fresh[k])),
        ):
            exact = np.array(exact)
            np.testing.assert_allclose(np.array(found), exact, atol=1e-7 * np.abs(exact).max())
        exact = np.array(FUNCTION.hessian(fresh[k]))
        np.testing.assert_allclose(hessian[k], exact, atol=1e-6 * np.abs(exact).max())
        np.testing.assert_allclose(np.array(metaModel.hessian(fresh[k])), exact, atol=1e-6 * np.abs(exact).max())


@pytest.mark.parametrize("degree", [1, 3, 4])
def test_coefficients_agree_with_openturns(degree):
    law = LAWS["normal"]
    result = fitted(law, degree=degree, noise=0.3)
    factory = ot.OrthogonalProductPolynomialFactory([ot.HermiteFactory()] * 3)
    size = result.getIndices().shape[0]
    # OpenTURNS works in its standardised variables, as here.
    standard = ot.Sample((np.array(result.getInputSample()) - [1.0, -2.0, 0.0]) / [2.0, 0.5, 1.0])
    expansion = ot.LeastSquaresExpansion(standard, result.getOutputSample(), ot.Normal(3), factory, size, "QR")
    expansion.run()
    order = factory.getEnumerateFunction()
    positions = [order.inverse(alpha) for alpha in result.getIndices().tolist()]
    found = expansion.getResult()
    rows = {int(i): c for i, c in zip(found.getIndices(), np.array(found.getCoefficients()), strict=True)}
    reference = np.array([rows[i] for i in positions])
    np.testing.assert_allclose(np.array(result.getCoefficients()), reference, atol=1e-10 * np.abs(reference).max())


@pytest.mark.parametrize("name", sorted(LAWS))
def test_metamodel_survives_study_and_pickle_bit_for_bit(name, tmp_path):
    result = fitted(LAWS[name], noise=0.1)
    metaModel = result.getMetaModel()
    fresh = LAWS[name].getSample(50)
    expected = np.array(metaModel(fresh))
    path = str(tmp_path / "study.xml")
    study = ot.Study()
    study.setStorageManager(ot.XMLStorageManager(path))
    study.add("metaModel", metaModel)
    study.save()
    reader = ot.Study()
    reader.setStorageManager(ot.XMLStorageManager(path))
    reader.load()
    loaded = ot.Function()
    reader.fillObject("metaModel", loaded)
    assert np.array_equal(np.array(loaded(fresh)), expected)
    assert np.array_equal(np.array(pickle.loads(pickle.dumps(metaModel))(fresh)), expected)


def test_openturns_result_and_validation():
    result = fitted(LAWS["normal"], degree=2, noise=0.1)
    inner = result.getMetaModelResult()
    fresh = LAWS["normal"].getSample(300)
    assert np.array_equal(np.array(inner.getMetaModel()(fresh)), np.array(result.getMetaModel()(fresh)))
    validation = ot.MetaModelValidation(FUNCTION(fresh), inner.getMetaModel()(fresh))
    mine = result.getMetaModelValidation(fresh, FUNCTION(fresh))
    assert np.array(mine.computeR2Score()) == pytest.approx(np.array(validation.computeR2Score()))
    errors = np.array(result.getLeaveOneOutResiduals())
    outputs = np.array(result.getOutputSample())
    score = 1.0 - (errors**2).sum(axis=0) / ((outputs - outputs.mean(axis=0)) ** 2).sum(axis=0)
    np.testing.assert_allclose(np.array(result.getQ2LeaveOneOut()), score, rtol=1e-12)
    np.testing.assert_allclose(np.array(result.getMetaModelValidation().computeR2Score()), score, rtol=1e-10)


def test_moments_and_sobol_indices_in_closed_form():
    # g = 1 + 2 a + 3 b c under standard normals: variance 4 + 9, S_a = 4/13, S_bc = 9/13.
    ot.RandomGenerator.SetSeed(0)
    inputs = ot.Normal(3).getSample(100)
    regression = MultivariatePolynomialRegression(
        inputs, ot.SymbolicFunction(["a", "b", "c"], ["1 + 2 * a + 3 * b * c"])(inputs), ot.Normal(3)
    )
    regression.run()
    result = regression.getResult()
    assert result.getMean()[0] == pytest.approx(1.0)
    assert result.getVariance()[0] == pytest.approx(13.0)
    assert result.getSobolIndex(0) == pytest.approx(4.0 / 13.0)
    assert result.getSobolIndex(1) == pytest.approx(0.0, abs=1e-20)
    assert result.getSobolIndex([1, 2]) == pytest.approx(9.0 / 13.0)
    assert result.getSobolTotalIndex(1) == pytest.approx(9.0 / 13.0)
    np.testing.assert_allclose(np.array(result.getGradientMatrix()), np.diag([4.0, 9.0, 9.0]), atol=1e-12)


def test_families_are_orthonormal_under_the_inputs_own_law():
    # Uniform, Beta and Gamma inputs bring Legendre, Jacobi and Laguerre: g = a b + c has its moments in closed form.
    law = LAWS["classic"]
    ot.RandomGenerator.SetSeed(0)
    inputs = law.getSample(200)
    regression = MultivariatePolynomialRegression(
        inputs, ot.SymbolicFunction(["a", "b", "c"], ["a * b + c"])(inputs), law
    )
    regression.run()
    result = regression.getResult()
    mean, variance = np.array(law.getMean()), np.array(law.getStandardDeviation()) ** 2
    product = (variance[0] + mean[0] ** 2) * (variance[1] + mean[1] ** 2) - (mean[0] * mean[1]) ** 2
    assert result.getMean()[0] == pytest.approx(mean[0] * mean[1] + mean[2], rel=1e-10)
    assert result.getVariance()[0] == pytest.approx(product + variance[2], rel=1e-9)
    assert result.getSobolIndex(2) == pytest.approx(variance[2] / (product + variance[2]), rel=1e-9)


def test_coefficients_agree_with_openturns_on_other_families():
    law = ot.JointDistribution([ot.Uniform(-1.0, 1.0), ot.Gamma(3.0, 1.0, 0.0)])
    ot.RandomGenerator.SetSeed(4)
    inputs = law.getSample(150)
    outputs = ot.SymbolicFunction(["a", "b"], ["exp(a) * log(1 + b)"])(inputs)
    regression = MultivariatePolynomialRegression(inputs, outputs, law)
    regression.run()
    result = regression.getResult()
    factory = ot.OrthogonalProductPolynomialFactory(
        [ot.StandardDistributionPolynomialFactory(law.getMarginal(i)) for i in range(2)]
    )
    expansion = ot.LeastSquaresExpansion(inputs, outputs, law, factory, 15, "QR")
    expansion.run()
    found = expansion.getResult()
    rows = dict(zip(map(int, found.getIndices()), np.array(found.getCoefficients())[:, 0], strict=True))
    order = factory.getEnumerateFunction()
    reference = np.array([rows[order.inverse(alpha)] for alpha in result.getIndices().tolist()])
    np.testing.assert_allclose(
        np.array(result.getCoefficients())[:, 0], reference, atol=1e-10 * np.abs(reference).max()
    )


@pytest.mark.parametrize("degree", [1, 2, 7, 10])
def test_every_degree_up_to_ten_is_exact_on_its_polynomials(degree):
    law = ot.Normal(2)
    ot.RandomGenerator.SetSeed(8)
    inputs = np.array(law.getSample(400))
    function = ot.SymbolicFunction(["a", "b"], [f"(0.5 * a + 0.3 * b)^{degree} + b"])
    regression = MultivariatePolynomialRegression(inputs, function(inputs), law)
    regression.setDegree(degree)
    regression.run()
    result = regression.getResult()
    fresh = 0.5 * np.array(law.getSample(30))
    np.testing.assert_allclose(result.evaluate(fresh), np.array(function(fresh)), atol=1e-9)
    np.testing.assert_allclose(np.array(result.getMetaModel()(fresh)), result.evaluate(fresh), atol=1e-11)


def test_huber_fit_satisfies_its_equations():
    ot.RandomGenerator.SetSeed(3)
    inputs = np.array(ot.Normal(1).getSample(80))
    outputs = 1.0 + inputs + 0.1 * np.array(ot.Student(2.0).getSample(80))
    regression = MultivariatePolynomialRegression(inputs, outputs, ot.Normal(1))
    regression.setDegree(1)
    regression.setRobust(True)
    regression.run()
    residuals = np.array(regression.getResult().getResiduals())[:, 0]
    scale = np.median(np.abs(residuals)) / 0.6744897501960817
    # Huber (1981), equation 7.3.1: sum psi(r / s) x = 0 with psi clipped at 1.345.
    score = np.clip(residuals / scale, -1.345, 1.345)
    assert abs(score.sum()) < 1e-5
    assert abs(score @ inputs[:, 0]) < 1e-5


def test_spread_of_exact_data_is_at_rounding_level_and_follows_noise():
    ot.RandomGenerator.SetSeed(9)
    inputs = np.array(ot.Normal(1).getSample(3000))
    noise = np.exp(0.5 * inputs) * np.array(ot.Normal(1).getSample(3000))
    place = np.array([[-1.0], [0.0], [1.0]])
    for outputs, expected in ((inputs**2 + 0.1 * noise, 0.1 * np.exp(0.5 * place)), (inputs**2, None)):
        regression = MultivariatePolynomialRegression(inputs, outputs, ot.Normal(1))
        regression.run()
        spread = regression.getResult().computeSpread(place)
        if expected is None:
            assert spread.max() < 1e-12
        else:
            np.testing.assert_allclose(spread, expected, rtol=0.15)


def test_intervals_cover_at_their_level():
    law = ot.Normal(2)
    function = ot.SymbolicFunction(["a", "b"], ["1 + a - 2 * a * b"])
    ot.RandomGenerator.SetSeed(5)
    inside = {"coefficient": [], "mean": [], "observation": []}
    fresh = law.getSample(20)
    for _ in range(120):
        inputs = law.getSample(40)
        outputs = np.array(function(inputs)) + 0.5 * np.array(ot.Normal().getSample(40))
        regression = MultivariatePolynomialRegression(inputs, outputs, law)
        regression.setDegree(2)
        regression.run()
        result = regression.getResult()
        interval = result.getCoefficientsInterval(0.9)
        position = result.getIndices().tolist().index([1, 1])
        inside["coefficient"].append(interval.getLowerBound()[position] <= -2.0 <= interval.getUpperBound()[position])
        truth = np.array(function(fresh))
        lower, upper = result.getPredictionInterval(fresh, 0.9, noise=False)
        inside["mean"].append(((lower <= truth) & (truth <= upper)).mean())
        observed = truth + 0.5 * np.array(ot.Normal().getSample(20))
        lower, upper = result.getPredictionInterval(fresh, 0.9)
        inside["observation"].append(((lower <= observed) & (observed <= upper)).mean())
    # Four standard errors of 120 binomial trials are 0.11.
    for name, hits in inside.items():
        assert abs(np.mean(hits) - 0.9) < 0.11, name


def test_default_law_standardises_a_badly_scaled_sample():
    ot.RandomGenerator.SetSeed(1)
    inputs = np.array(ot.Normal([1e5, -1e-6], [3.0, 1e-9], ot.CorrelationMatrix(2)).getSample(80))
    outputs = ((inputs[:, :1] - 1e5) / 3.0) ** 3 + (inputs[:, 1:] + 1e-6) / 1e-9
    regression = MultivariatePolynomialRegression(inputs, outputs)
    regression.run()
    result = regression.getResult()
    assert result.getConditionNumber() < 1e3
    assert result.getQ2LeaveOneOut()[0] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.parametrize("how", ["robust", "weights of 0"])
def test_intervals_of_robust_fits_and_of_fits_without_some_points_hold(how):
    """Under normal noise: Huber's weights take a sixth of the residuals' squares, and points of weight 0 are none."""
    random = np.random.default_rng(0)
    weights = np.r_[np.zeros(20), np.ones(10)]
    inside, variances, repetitions = np.zeros(2), [], 1000
    for _ in range(repetitions):
        inputs = random.standard_normal((30, 1))
        outputs = 1.0 + inputs[:, 0] + 0.3 * random.standard_normal(30)
        options = {"Robust": True} if how == "robust" else {"Weights": weights}
        result = lineOf(inputs[:, 0], outputs, **options)
        variances.append(result.getNoiseVariance()[0])
        point = random.standard_normal((1, 1))
        mean = 1.0 + point[0, 0]
        for index, (noise, value) in enumerate(((True, mean + 0.3 * random.standard_normal()), (False, mean))):
            lower, upper = result.getPredictionInterval(point, 0.95, noise)
            inside[index] += lower[0, 0] < value < upper[0, 0]
    np.testing.assert_allclose(inside / repetitions, 0.95, atol=0.02)
    assert np.mean(variances) == pytest.approx(0.09, rel=0.03)


def test_weights_of_0_leave_no_degree_of_freedom():
    result = lineOf([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 5.0, 7.0], Weights=[1.0, 1.0, 0.0, 0.0])
    with pytest.raises(ValueError, match="2 points and as many terms leave no residual"):
        result.getNoiseVariance()


@pytest.mark.parametrize(
    ("law", "degree"),
    [(ot.Student(5.0), 3), (ot.Student(2.5), 2), (ot.Pareto(1.0, 3.0, 0.0), 2), (ot.LogNormal(0.0, 2.0, 0.0), 2)],
)
def test_moments_that_the_law_does_not_have_are_refused(law, degree):
    inputs = np.array(ot.Uniform(1.5, 3.0).getSample(50))
    regression = MultivariatePolynomialRegression(inputs, inputs**degree, law)
    regression.setDegree(degree)
    regression.run()
    result = regression.getResult()
    for ask in (
        result.getMean,
        result.getVariance,
        lambda: result.getSobolIndex(0),
        lambda: result.getSobolTotalIndex(0),
    ):
        with pytest.raises(ValueError, match=rf"moments of order {2 * degree} do not exist or cannot be computed"):
            ask()
    # The polynomial itself is right.
    assert result.getMetaModel()([2.0])[0] == pytest.approx(2.0**degree)
    regression.setDegree(0)
    regression.run()
    assert regression.getResult().getVariance()[0] == 0.0


@pytest.mark.parametrize(
    ("law", "mean", "variance"),
    [
        # x^2: E[x^4] - E[x^2]^2 = 24 - 4 for Laplace; 3 s^4 (n - 2) / (n - 4) - s^4, s^2 = n / (n - 2) for Student.
        (ot.Laplace(), 2.0, 20.0),
        (ot.Student(20.0), 20.0 / 18.0, (20.0 / 18.0) ** 2 * (3.0 * 18.0 / 16.0 - 1.0)),
        # Two narrow modes at -3 and 3: between them the density is next to nothing.
        (ot.Mixture([ot.Normal(-3.0, 1e-2), ot.Normal(3.0, 1e-2)]), 9.0001, 36.0002e-4),
    ],
)
def test_moments_under_laws_with_long_tails_or_two_modes(law, mean, variance):
    inputs = np.linspace(-4.0, 4.0, 50)[:, None]
    regression = MultivariatePolynomialRegression(inputs, inputs**2, law)
    regression.setDegree(2)
    regression.run()
    assert regression.getResult().getMean()[0] == pytest.approx(mean, rel=1e-6)
    assert regression.getResult().getVariance()[0] == pytest.approx(variance, rel=1e-4)


def test_sobol_indices_take_less_than_the_fit_of_openturns():
    law = ot.JointDistribution([ot.Uniform(-np.pi, np.pi)] * 3)
    inputs = law.getSample(1000)
    outputs = ot.SymbolicFunction(["a", "b", "c"], ["sin(a) + 7 * sin(b)^2 + 0.1 * c^4 * sin(a)"])(inputs)
    families = [ot.StandardDistributionPolynomialFactory(law.getMarginal(i)) for i in range(3)]
    product = ot.OrthogonalProductPolynomialFactory(families)
    size = product.getEnumerateFunction().getBasisSizeFromTotalDegree(8)
    regression = MultivariatePolynomialRegression(inputs, outputs, law)
    regression.setDegree(8)
    regression.run()

    def indices():
        # A new result each time: it keeps what it has found.
        result = copy.deepcopy(regression.getResult())
        return [result.getSobolTotalIndex(i) for i in range(3)]

    assert time_ratio(indices, ot.LeastSquaresExpansion(inputs, outputs, law, product, size).run) < 1.0
    assert indices() == pytest.approx([0.5576, 0.4424, 0.2437], abs=0.01)


def test_weights_and_robust_fit_resist_outliers():
    law = ot.Normal(1)
    ot.RandomGenerator.SetSeed(3)
    inputs = np.array(law.getSample(100))
    outputs = 2.0 * inputs + 0.01 * np.array(law.getSample(100))
    outputs[:8] += 5.0
    slopes = {}
    for name in ("plain", "robust", "weighted"):
        regression = MultivariatePolynomialRegression(inputs, outputs, law)
        regression.setDegree(1)
        if name == "robust":
            regression.setRobust(True)
        if name == "weighted":
            regression.setWeights([0.0] * 8 + [1.0] * 92)
        regression.run()
        slopes[name] = np.array(regression.getResult().getCoefficients())[:, 0]
    assert np.abs(slopes["plain"] - [0.0, 2.0]).max() > 0.2
    assert np.abs(slopes["robust"] - [0.0, 2.0]).max() < 0.02
    assert np.abs(slopes["weighted"] - [0.0, 2.0]).max() < 0.005


def test_degree_is_chosen_by_cross_validation():
    law = ot.Normal(2)
    ot.RandomGenerator.SetSeed(2)
    inputs = law.getSample(120)
    outputs = (
        np.array(ot.SymbolicFunction(["a", "b"], ["a * b + a^2"])(inputs)) + 0.1 * np.array(law.getSample(120))[:, :1]
    )
    regression = MultivariatePolynomialRegression(inputs, outputs, law)
    errors = regression.selectDegree()
    assert regression.getDegree() == 2
    assert sorted(errors) == [0, 1, 2, 3, 4]
    assert errors[1] > 3.0 * errors[2]


def test_k_fold_agrees_with_refitting():
    result = fitted(LAWS["normal"], size=60, degree=2, noise=0.5)
    inputs, outputs = np.array(result.getInputSample()), np.array(result.getOutputSample())
    folds = [np.arange(start, 60, 4) for start in range(4)]
    found = np.array(result.getKFoldResiduals(folds))
    for fold in folds:
        kept = np.setdiff1d(np.arange(60), fold)
        regression = MultivariatePolynomialRegression(inputs[kept], outputs[kept], LAWS["normal"])
        regression.setDegree(2)
        regression.run()
        expected = outputs[fold] - regression.getResult().evaluate(inputs[fold])
        np.testing.assert_allclose(found[fold], expected, rtol=1e-12, atol=1e-12)
    assert result.getQ2KFold(5)[0] < result.getR2()[0]


def test_too_few_or_repeated_points_are_refused_with_the_rank():
    inputs = np.array(ot.Normal(2).getSample(14))
    with pytest.raises(ValueError, match="15 terms needs at least 15 points, got 14"):
        MultivariatePolynomialRegression(inputs, inputs[:, :1]).run()
    repeated = np.repeat(inputs[:5], 6, axis=0)
    with pytest.raises(ValueError, match="rank 5 only"):
        MultivariatePolynomialRegression(repeated, repeated[:, :1]).run()
    constant = np.column_stack([np.array(ot.Normal(1).getSample(40)), np.ones(40)])
    with pytest.raises(ValueError, match="15 terms but the 40 points give rank 5"):
        MultivariatePolynomialRegression(constant, constant[:, :1]).run()


def test_bad_arguments_are_refused():
    inputs = np.array(ot.Normal(2).getSample(20))
    values = inputs[:, :1].copy()
    values[7] = np.inf
    with pytest.raises(ValueError, match="outputs must be finite, but 1 of 20 rows are not, the first is row 7"):
        MultivariatePolynomialRegression(inputs, values)
    regression = MultivariatePolynomialRegression(inputs, inputs)
    with pytest.raises(ValueError, match="0 to 10"):
        regression.setDegree(11)
    with pytest.raises(ValueError, match="one output"):
        regression.setRobust(True)
    with pytest.raises(ValueError, match="20 finite numbers"):
        regression.setWeights([1.0])
    with pytest.raises(RuntimeError, match=r"call run\(\) first"):
        regression.getResult()
    for law in (ot.Normal(3), ot.JointDistribution([ot.Normal()] * 2, ot.ClaytonCopula(2.0))):
        with pytest.raises(ValueError, match="distribution"):
            MultivariatePolynomialRegression(inputs, inputs, law)


def test_no_noise_estimate_without_spare_points():
    inputs = np.array([[0.0], [1.0], [3.0]])
    regression = MultivariatePolynomialRegression(inputs, inputs**2)
    regression.setDegree(2)
    regression.run()
    with pytest.raises(ValueError, match="no residual"):
        regression.getResult().getNoiseVariance()


def test_constant_output_has_no_scores():
    inputs = np.array(ot.Normal(1).getSample(20))
    regression = MultivariatePolynomialRegression(inputs, np.ones((20, 1)))
    regression.setDegree(1)
    regression.run()
    with pytest.raises(ValueError, match="constant"):
        regression.getResult().getQ2LeaveOneOut()


def test_hyperbolic_set_rank_and_leverages():
    total, hyperbolic = (fitted(LAWS["normal"], noise=0.1, setHyperbolicNorm=norm) for norm in (1.0, 0.5))
    # Of degree 4 in three variables: 35 terms, against those with (sum of square roots)^2 <= 4.
    assert (total.getRank(), hyperbolic.getRank()) == (35, 16)
    for result in (total, hyperbolic):
        leverages = np.array(result.getLeverages())
        # The hat matrix is a projection: its trace is its rank, its diagonal lies between 0 and 1.
        assert leverages.sum() == pytest.approx(result.getRank(), rel=1e-10)
        assert leverages.min() > 0.0
        assert leverages.max() < 1.0
    with pytest.raises(ValueError, match=r"is 1.5; it must be in \(0, 1\]"):
        fitted(LAWS["normal"], setHyperbolicNorm=1.5)


def test_a_row_with_one_number_that_is_not_finite_is_named():
    inputs = np.arange(12.0).reshape(6, 2)
    for row, column in ((3, 0), (3, 1)):
        spoilt = inputs.copy()
        spoilt[row, column] = np.nan
        with pytest.raises(ValueError, match=r"inputs must be finite, but 1 of 6 rows are not, the first is row 3"):
            MultivariatePolynomialRegression(spoilt, inputs)
        with pytest.raises(ValueError, match=r"outputs must be finite, but 1 of 6 rows are not, the first is row 3"):
            MultivariatePolynomialRegression(inputs, spoilt)


def test_the_smallest_degree_within_one_standard_error_is_taken():
    ot.RandomGenerator.SetSeed(2)
    inputs = np.array(ot.Normal(1).getSample(300))
    noise = np.array(ot.Normal(1).getSample(300))
    # The mean squared error of a line is 1 + 2 bend^2 beside 1, whose standard error is 0.08.
    for bend, degree in ((0.05, 1), (0.5, 2)):
        regression = MultivariatePolynomialRegression(inputs, inputs + bend * inputs**2 + noise, ot.Normal(1))
        errors = regression.selectDegree()
        assert regression.getDegree() == degree
        # In units of the outputs' standard deviation; degree 0 predicts their mean.
        assert list(errors) == [0, 1, 2, 3, 4]
        assert errors[0] == pytest.approx(1.0, abs=0.02)
        spread = np.std(inputs + bend * inputs**2 + noise)
        assert errors[1] == pytest.approx(np.sqrt(1.0 + 2.0 * bend**2) / spread, rel=0.1)


def test_degrees_are_compared_where_there_are_two_points_for_each_term():
    inputs = np.linspace(-2.0, 2.0, 9)[:, None]
    regression = MultivariatePolynomialRegression(inputs, inputs**2, ot.Normal(1))
    assert list(regression.selectDegree(highest=6)) == [0, 1, 2, 3]
    regression = MultivariatePolynomialRegression(inputs[:8], inputs[:8] ** 2, ot.Normal(1))
    assert list(regression.selectDegree(highest=6)) == [0, 1, 2, 3]
    regression = MultivariatePolynomialRegression(inputs[:7], inputs[:7] ** 2, ot.Normal(1))
    assert list(regression.selectDegree(highest=6)) == [0, 1, 2]


def test_the_logarithm_of_the_spread_is_a_parabola_or_of_the_fits_own_degree():
    ot.RandomGenerator.SetSeed(4)
    inputs = np.array(ot.Normal(1).getSample(200))
    outputs = inputs + (1.0 + inputs**4) * np.array(ot.Normal(1).getSample(200))
    place = np.linspace(-2.0, 2.0, 9)[:, None]
    for degree, order in ((0, 1), (1, 2), (2, 3), (4, 3)):
        regression = MultivariatePolynomialRegression(inputs, outputs, ot.Normal(1))
        regression.setDegree(degree)
        regression.run()
        logarithm = np.log(regression.getResult().computeSpread(place))[:, 0]
        # Differences of the next order vanish, those before do not.
        assert np.abs(np.diff(logarithm, order)).max() < 1e-9
        assert np.abs(np.diff(logarithm, order - 1)).max() > 1e-3


def test_samples_that_do_not_match_or_are_empty_are_refused():
    for inputs, outputs in ((np.zeros((3, 1)), np.zeros((4, 1))), (np.zeros(3), np.zeros((3, 1)))):
        with pytest.raises(ValueError, match=r"they must be \(N, d\) and \(N, p\)"):
            MultivariatePolynomialRegression(inputs, outputs)
    for inputs, outputs in ((np.zeros((0, 1)), np.zeros((0, 1))), (np.zeros((3, 0)), np.zeros((3, 1)))):
        with pytest.raises(ValueError, match="samples are empty"):
            MultivariatePolynomialRegression(inputs, outputs)


def lineOf(inputs, outputs, degree=1, **options):
    regression = MultivariatePolynomialRegression(np.array(inputs)[:, None], np.array(outputs)[:, None], ot.Normal(1))
    regression.setDegree(degree)
    for name, value in options.items():
        getattr(regression, f"set{name}")(value)
    regression.run()
    return regression.getResult()


def test_a_point_without_which_there_is_no_fit_is_named():
    result = lineOf([0.0, 0.0, 0.0, 1.0], [1.0, 2.0, 3.0, 5.0])
    with pytest.raises(ValueError, match="no leave-one-out prediction: give a validation sample"):
        result.getMetaModelValidation()
    with pytest.raises(ValueError, match="spread is not known there"):
        result.computeSpread([[0.5]])


def test_numbers_of_folds_levels_and_constants_are_checked():
    result = lineOf([0.0, 1.0, 2.0, 4.0], [1.0, 2.0, 3.5, 5.0])
    for folds in (1, 5):
        with pytest.raises(ValueError, match=f"folds is {folds}; it must be 2 to 4"):
            result.getKFoldResiduals(folds)
    with pytest.raises(ValueError, match=r"level is 1.0; it must be in \(0, 1\)"):
        result.getPredictionInterval([[0.5]], 1.0)
    with pytest.raises(ValueError, match="constant: it has no Sobol indices"):
        lineOf([0.0, 1.0, 2.0, 4.0], [1.0] * 4, degree=0).getSobolIndex(0)
    regression = MultivariatePolynomialRegression([[1.0]], [[1.0]], ot.Normal(1))
    with pytest.raises(ValueError, match="1 points are too few to compare degrees"):
        regression.selectDegree()


def test_degrees_that_cannot_be_fitted_are_not_compared():
    # Four different points: a cubic is the last that they determine.
    inputs = np.repeat([0.0, 1.0, 2.0, 3.0], 4)[:, None]
    regression = MultivariatePolynomialRegression(inputs, np.exp(inputs), ot.Normal(1))
    assert list(regression.selectDegree(highest=6)) == [0, 1, 2, 3]


def test_the_robust_fit_of_exact_data_with_outliers_is_exact():
    # More than half of the points lie on the line: their scale is 0, and nothing more is to be weighted.
    outputs = np.where(np.arange(11) == 7, 100.0, 2.0 * np.arange(11.0))
    result = lineOf(np.arange(11.0), np.where(np.arange(11) == 7, 14.0, outputs), Robust=True)
    np.testing.assert_allclose(result.evaluate([[3.0]]), [[6.0]])


def test_a_robust_fit_that_goes_on_says_so(monkeypatch):
    ot.RandomGenerator.SetSeed(3)
    inputs = np.array(ot.Normal(1).getSample(80))[:, 0]
    outputs = 1.0 + inputs + np.array(ot.Student(1.1).getSample(80))[:, 0]
    settled = lineOf(inputs, outputs, Robust=True)
    monkeypatch.setattr(polynomial_regression, "HUBER_STEPS", 2)
    with pytest.raises(RuntimeError, match="did not converge in 2 steps: the coefficients still change by"):
        lineOf(inputs, outputs, Robust=True)
    # What changes by less than 1e-4 is as good as settled.
    monkeypatch.setattr(polynomial_regression, "HUBER_STEPS", 15)
    nearly = lineOf(inputs, outputs, Robust=True)
    np.testing.assert_allclose(np.array(nearly.getCoefficients()), np.array(settled.getCoefficients()), rtol=1e-3)


def test_an_output_that_is_constant_decides_nothing_about_the_degree():
    ot.RandomGenerator.SetSeed(2)
    inputs = np.array(ot.Normal(1).getSample(60))
    outputs = np.hstack([inputs**2, np.full((60, 1), 3.0)])
    regression = MultivariatePolynomialRegression(inputs, outputs, ot.Normal(1))
    errors = regression.selectDegree()
    assert regression.getDegree() == 2
    assert np.isfinite(list(errors.values())).all()


def test_an_input_may_have_a_distribution_in_python():
    law = ot.JointDistribution([ot.Distribution(UniformInPython())] * 3)
    ot.RandomGenerator.SetSeed(11)
    inputs = ot.JointDistribution([ot.Uniform(0.0, 1.0)] * 3).getSample(100)
    regression = MultivariatePolynomialRegression(inputs, FUNCTION(inputs), law)
    regression.run()
    point = [0.2, 0.5, 0.7]
    assert regression.getResult().getMetaModel()(point) == pytest.approx(np.array(FUNCTION(point)), abs=1e-9)


def test_bad_degrees_and_folds_are_named():
    regression = MultivariatePolynomialRegression(np.zeros((30, 1)), np.zeros((30, 1)), ot.Normal(1))
    for highest in (-1, 11, 1.5):
        with pytest.raises(
            ValueError, match=f"The highest degree is {highest}; it must be a whole number from 0 to 10"
        ):
            regression.selectDegree(highest)
    for folds in (1, 2.5):
        with pytest.raises(
            ValueError, match=f"The number of folds is {folds}; it must be a whole number of at least 2"
        ):
            regression.selectDegree(4, folds)


def test_samples_keep_their_names():
    inputs = ot.Normal(2).getSample(30)
    inputs.setDescription(["mass", "rate"])
    outputs = ot.SymbolicFunction(["a", "b"], ["a + b"])(inputs)
    outputs.setDescription(["sag"])
    regression = MultivariatePolynomialRegression(inputs, outputs)
    regression.setDegree(1)
    regression.run()
    result = regression.getResult()
    assert list(result.getInputSample().getDescription()) == ["mass", "rate"]
    assert list(result.getMetaModelResult().getOutputSample().getDescription()) == ["sag"]


def test_sobol_indices_and_the_native_chaos_result_are_those_of_openturns():
    law = ot.JointDistribution([*(LAWS["classic"].getMarginal(i) for i in range(3)), ot.Normal(10.0, 0.1)])
    function = ot.SymbolicFunction(["a", "b", "c", "e"], ["1 + a * b + c^2 * a + e", "b^4 - a^3 * c"])
    function.setOutputDescription(["load", "gap"])
    ot.RandomGenerator.SetSeed(3)
    inputs = law.getSample(300)
    regression = MultivariatePolynomialRegression(inputs, function(inputs), law)
    regression.run()
    result = regression.getResult()
    native = result.getFunctionalChaosResult()
    point = [2.0, 1.0, 1.5, 10.1]
    assert native.getMetaModel()(point) == pytest.approx(np.array(function(point)))
    assert list(native.getMetaModel().getOutputDescription()) == ["load", "gap"]
    assert ot.FunctionalChaosRandomVector(native).getMean() == pytest.approx(np.array(result.getMean()))
    reference = ot.FunctionalChaosSobolIndices(native)
    for output in (0, 1):
        for group in (0, 3, [0, 1], [1, 3], [0, 1, 2]):
            for name in ("getSobolIndex", "getSobolTotalIndex", "getSobolGroupedIndex", "getSobolGroupedTotalIndex"):
                expected = getattr(reference, name)(np.atleast_1d(group).tolist(), output)
                assert getattr(result, name)(group, output) == pytest.approx(expected, abs=1e-12), name
    with pytest.raises(ValueError, match=r"The inputs are \[4\]; they must be different ones of 0 to 3"):
        result.getSobolIndex(4)
    with pytest.raises(ValueError, match=r"are \[1, 1\]; they must be different ones of 0 to 3"):
        result.getSobolGroupedIndex([1, 1])
    with pytest.raises(ValueError, match=r"are \[\]; they must be different ones of 0 to 3"):
        result.getSobolGroupedIndex([])
    with pytest.raises(ValueError, match="The output is 2; it must be 0 to 1"):
        result.getSobolTotalIndex(0, 2)


@pytest.mark.parametrize("law", [ot.Pareto(1.0, 1.0, 0.0), ot.Student(1.5)])
def test_a_law_without_variance_is_refused_in_a_sentence(law):
    inputs = ot.Uniform(2.0, 3.0).getSample(30)
    regression = MultivariatePolynomialRegression(inputs, inputs, law)
    with pytest.raises(ValueError, match="has no finite mean and standard deviation, so that no polynomials"):
        regression.run()


@pytest.mark.parametrize("weighted", [False, True])
def test_the_cross_validated_interval_holds_where_the_polynomial_is_not_the_truth(weighted):
    random = np.random.default_rng(5)
    held, assumed = [], []
    for _ in range(40):
        inputs, fresh = random.standard_normal((100, 2)), random.standard_normal((50, 2))
        truth = np.exp(0.5 * fresh.sum(axis=1, keepdims=True))
        regression = MultivariatePolynomialRegression(
            inputs, np.exp(0.5 * inputs.sum(axis=1, keepdims=True)), ot.Normal(2)
        )
        regression.setDegree(3)
        if weighted:
            regression.setWeights(np.r_[np.ones(80), np.zeros(20)])
        regression.run()
        for found, interval in (
            (held, regression.getResult().getCrossValidatedInterval(fresh)),
            (assumed, regression.getResult().getPredictionInterval(fresh, noise=False)),
        ):
            found.append(np.mean((interval[0] <= truth) & (truth <= interval[1])))
    assert 0.92 < np.mean(held) < 0.99
    assert np.mean(assumed) < 0.7


def test_the_cross_validated_interval_needs_points_for_its_level():
    random = np.random.default_rng(5)
    inputs = random.standard_normal((15, 1))
    regression = MultivariatePolynomialRegression(inputs, np.sin(inputs), ot.Normal(1))
    regression.setDegree(1)
    regression.run()
    with pytest.raises(ValueError, match=r"15 points are too few for the level 0\.95: 19 at least"):
        regression.getResult().getCrossValidatedInterval(inputs)
    lower, upper = regression.getResult().getCrossValidatedInterval(inputs, 0.9)
    # (15 + 1) 0.9 = 14.4: the largest error of all.
    largest = np.abs(np.array(regression.getResult().getLeaveOneOutResiduals())).max()
    np.testing.assert_allclose(upper - lower, 2.0 * largest)
    with pytest.raises(ValueError, match=r"confidence level is 1\.0; it must be in"):
        regression.getResult().getCrossValidatedInterval(inputs, 1.0)
