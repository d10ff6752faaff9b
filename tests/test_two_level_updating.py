"""Two-level updating of any function: conjugate closed forms, calibration, Markov chains, misfit, further tests."""

import math

import numpy as np
import openturns as ot
import pytest
from scipy import stats

from satsep_ot.methods.updating import posterior as posterior_module
from satsep_ot.methods.updating.algorithm import TwoLevelUpdating
from satsep_ot.methods.updating.experiments import Experiment, FunctionModel, Measurement, MeasurementModel
from satsep_ot.methods.updating.failure_probability import FailureProbabilities, Limit
from satsep_ot.methods.updating.misfit import findMisfits, madeUpCampaigns
from satsep_ot.methods.updating.next_experiments import NextExperiments, failureFreeNumber, neededNumber
from satsep_ot.methods.updating.posterior import (
    Method,
    UpdatingError,
    effectiveSize,
    samplePosterior,
    splitRhat,
)
from satsep_ot.methods.updating.two_level import TwoLevelInputs, normals

MATRIX = np.array([[1.0, 2.0, 0.5, -1.0], [0.3, -1.0, 1.0, 2.0]])
MEAN, SIGMA = np.array([1.0, 2.0, 3.0, 4.0]), np.array([0.5, 1.0, 2.0, 0.3])


def linear_model(matrix):
    matrix = np.atleast_2d(matrix)
    zero = [0.0] * matrix.shape[1]
    return FunctionModel(ot.LinearFunction(zero, [0.0] * len(matrix), ot.Matrix(matrix.tolist())))


def mean_experiments(values, sigma=0.5, error=0.5):
    """Inputs with one uncertain mean of sigma 1, measured in so many experiments."""
    inputs = TwoLevelInputs(ot.Normal(0.0, sigma), meanUncertainty=[1.0])
    model = linear_model([1.0])
    return inputs, [Experiment(f"t{k}", model, (Measurement("y", 0, v, error),)) for k, v in enumerate(values)]


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_linear_normal_inputs_have_the_conjugate_posterior(correlation):
    ot.RandomGenerator.SetSeed(1)
    copula = ot.CorrelationMatrix(4)
    copula[1, 3] = correlation
    distribution = ot.JointDistribution(
        [ot.Normal(m, s) for m, s in zip(MEAN, SIGMA, strict=True)], ot.NormalCopula(copula)
    )
    inputs = TwoLevelInputs(distribution, [0, 2], [0.0, 0.7, 0.0, 0.2])
    model, errors = linear_model(MATRIX), np.array([0.3, 0.2])
    values = MATRIX @ MEAN + np.array([[1.0, -1.0], [0.5, 0.3], [-0.8, 1.2]])
    experiments = [
        Experiment(f"t{k}", model, tuple(Measurement(f"y{j}", j, values[k, j], errors[j]) for j in range(2)))
        for k in range(3)
    ]
    experiments.append(Experiment("scale", model, (Measurement("x1", 1, 2.2, 0.1, isInput=True),)))
    updating = TwoLevelUpdating(inputs, experiments)
    updating.run()
    found = updating.getResult().getMoments()
    # Parameters: x0, x2, and the means of x1 and x3.
    order = [0, 2, 1, 3]
    prior, covariance = MEAN[order], np.diag([0.5, 2.0, 0.7, 0.2]) ** 2
    scatter = np.array([[1.0, correlation * 0.3], [correlation * 0.3, 0.09]])
    drawn = MATRIX[:, [1, 3]] @ scatter @ MATRIX[:, [1, 3]].T + np.diag(errors**2)
    design = np.vstack([MATRIX[:, order]] * 3 + [[0.0, 0.0, 1.0, 0.0]])
    noise = np.zeros((7, 7))
    noise[:6, :6], noise[6, 6] = np.kron(np.eye(3), drawn), 1.0 + 0.01
    gain = covariance @ design.T @ np.linalg.inv(design @ covariance @ design.T + noise)
    expected = prior + gain @ (np.append(values.ravel(), 2.2) - design @ prior)
    sigma = np.sqrt(np.diag(covariance - gain @ design @ covariance))
    np.testing.assert_allclose(found[0], expected, atol=1e-6)
    np.testing.assert_allclose(found[1], sigma, atol=1e-6)
    assert updating.getResult().getPosterior().effectiveSize > 0.999 * 4000


def test_an_input_of_another_piece_teaches_nothing_of_the_shared_one():
    ot.RandomGenerator.SetSeed(2)
    inputs = TwoLevelInputs(ot.Normal(2), shared=[0, 1])
    model = linear_model(np.eye(2))
    experiment = Experiment("dummy", model, tuple(Measurement(f"y{j}", j, 1.5, 0.01) for j in range(2)), own=(0,))
    updating = TwoLevelUpdating(inputs, [experiment])
    updating.run()
    mean, sigma = updating.getResult().getMoments()
    np.testing.assert_allclose(mean, [0.0, 1.5 / 1.0001], atol=1e-6)
    np.testing.assert_allclose(sigma, [1.0, 0.01 / math.sqrt(1.0001)], atol=1e-6)


def curved_inputs():
    distribution = ot.JointDistribution([ot.Normal(), ot.Uniform(-1.0, 1.0), ot.Normal(0.0, 0.5)])
    return TwoLevelInputs(distribution, [0], [0.0, 0.0, 0.5], [0.0, 0.0, 0.3])


CURVED = ot.SymbolicFunction(["a", "b", "c"], ["a + b + 0.15 * a * c + c", "a - 0.7 * b + 0.1 * b^2"])


def curved_experiments(values):
    model = FunctionModel(CURVED)
    return [
        Experiment(f"t{k}", model, tuple(Measurement(f"y{j}", j, row[j], 0.15) for j in range(2)))
        for k, row in enumerate(values)
    ]


def test_ranks_of_60_truths_are_uniform():
    """Simulation-based calibration (Talts et al. 2018): a nonlinear model, a uniform input, a sigma unknown."""
    ot.RandomGenerator.SetSeed(3)
    inputs, ranks = curved_inputs(), []
    model = MeasurementModel(inputs, curved_experiments(np.zeros((4, 2))))
    for _ in range(60):
        truth = normals(1, 3)
        values = (model.predict(truth)[0] + model.errors * normals(8)).reshape(4, 2)
        posterior = samplePosterior(MeasurementModel(inputs, curved_experiments(values)), 2000)
        assert posterior.converged
        ranks.append((posterior.resampled(99) < truth).sum(axis=0))
    for column in np.array(ranks).T:
        counts = np.bincount(column // 20, minlength=5)
        assert ((counts - 12.0) ** 2 / 12.0).sum() < stats.chi2.ppf(0.999, 4), counts


@pytest.fixture(scope="module")
def quadrature():
    """y = a + b + 0.2 a^2 with a shared and b uniform, measured three times; mean and sigma of a by quadrature."""
    inputs = TwoLevelInputs(ot.JointDistribution([ot.Normal(), ot.Uniform(-1.0, 1.0)]), [0])
    model = FunctionModel(ot.SymbolicFunction(["a", "b"], ["a + b + 0.2 * a * a"]))
    values = (0.9, 1.6, 0.4)
    tests = [Experiment(str(k), model, (Measurement("y", 0, v, 0.1),)) for k, v in enumerate(values)]
    a, b = np.linspace(-4.0, 4.0, 2001), np.linspace(-1.0, 1.0, 2001)
    density = np.exp(-0.5 * a**2)
    for value in values:
        density *= np.exp(-0.5 * ((value - a[:, None] - b - 0.2 * a[:, None] ** 2) / 0.1) ** 2).mean(axis=1)
    density /= density.sum()
    mean = density @ a
    return MeasurementModel(inputs, tests), mean, math.sqrt(density @ (a - mean) ** 2)


def test_posterior_is_that_of_integration_by_quadrature(quadrature):
    model, mean, sigma = quadrature
    ot.RandomGenerator.SetSeed(4)
    posterior = samplePosterior(model, 20_000)
    found = posterior.moments(model.inputs)
    assert found[0][0] == pytest.approx(mean, abs=0.02 * sigma + 5.0 * sigma / math.sqrt(posterior.effectiveSize))
    assert found[1][0] == pytest.approx(sigma, rel=0.05)


def test_markov_chains_have_the_same_posterior(quadrature, monkeypatch):
    model, mean, sigma = quadrature
    ot.RandomGenerator.SetSeed(5)
    # No importance sampling is good enough.
    monkeypatch.setattr(posterior_module, "LARGEST_SHARE", 0.0)
    posterior = samplePosterior(model, 1000)
    assert posterior.method is Method.CHAINS
    assert posterior.converged
    assert posterior.rhat <= 1.01
    found = posterior.moments(model.inputs)
    assert found[0][0] == pytest.approx(mean, abs=5.0 * sigma / math.sqrt(posterior.effectiveSize))
    assert found[1][0] == pytest.approx(sigma, rel=0.1)


def test_chains_that_do_not_agree_are_said_not_to():
    """One measurement of a sum of squares leaves a sphere, far from a normal law."""
    ot.RandomGenerator.SetSeed(6)
    inputs = TwoLevelInputs(ot.Normal(4), [0, 1, 2, 3])
    model = FunctionModel(ot.SymbolicFunction(["a", "b", "c", "d"], ["a + 0.6 * b^2 + 0.6 * c^2 + 0.6 * d^2"]))
    updating = TwoLevelUpdating(inputs, [Experiment("t", model, (Measurement("y", 0, 4.0, 0.3),))])
    updating.run()
    posterior = updating.getResult().getPosterior()
    assert posterior.method is Method.CHAINS
    assert not posterior.converged
    assert "The Markov chains do not agree" in updating.getResult().getRemarks()[0]


def test_diagnostics_see_a_chain_that_drifts_and_one_that_is_slow():
    noise = np.random.default_rng(1).normal(size=(8, 2000))
    slow = np.zeros_like(noise)
    for k in range(1, noise.shape[1]):
        slow[:, k] = 0.9 * slow[:, k - 1] + noise[:, k]
    # An autoregression of 0.9 is worth 1 / 19 of its length.
    assert effectiveSize(slow) == pytest.approx(16_000 / 19, rel=0.25)
    assert splitRhat(noise + np.linspace(0.0, 3.0, 2000)) > 1.1
    assert splitRhat(noise) < 1.01


def test_a_right_campaign_is_rarely_contradicted_and_a_wrong_one_nearly_always():
    ot.RandomGenerator.SetSeed(6)
    inputs, experiments = curved_inputs(), curved_experiments(np.zeros((5, 2)))
    model = MeasurementModel(inputs, experiments)
    campaigns = madeUpCampaigns(model)
    sigma = campaigns.std(axis=0)
    alarms = np.zeros(2)
    for number in range(100):
        values = model.predict(normals(1, 3))[0] + model.errors * normals(10)
        off = 3.0 * sigma * (np.arange(10) % 2 == number % 2)
        for kind, measured in enumerate((values, values + off)):
            again = MeasurementModel(inputs, curved_experiments(measured.reshape(5, 2)))
            alarms[kind] += any(row.contradicts for row in findMisfits(again, campaigns))
    assert alarms[0] <= 10
    assert alarms[1] >= 80


def test_contradictory_and_impossible_measurements_are_refused_in_a_sentence():
    ot.RandomGenerator.SetSeed(7)
    shared = TwoLevelInputs(ot.Normal(), [0])
    model = linear_model([1.0])
    two = [Experiment(name, model, (Measurement("y", 0, v, 0.01),)) for name, v in (("one", 0.5), ("two", 0.9))]
    with pytest.raises(UpdatingError, match=r"test (one|two): y = 0\.\d contradicts the other tests \((one|two)\)"):
        TwoLevelUpdating(shared, two).run()
    with pytest.raises(UpdatingError, match=r"test one: y = 40 lies 4\d standard deviations from .* check its unit"):
        TwoLevelUpdating(shared, [Experiment("one", model, (Measurement("y", 0, 40.0, 0.1),))]).run()


@pytest.mark.parametrize(("value", "error"), [(0.0, 0.0), (0.0, -1.0), (math.nan, 1.0), (0.0, math.inf)])
def test_errors_that_are_not_positive_are_refused(value, error):
    inputs, _ = mean_experiments([0.0])
    experiment = Experiment("t", linear_model([1.0]), (Measurement("y", 0, value, error),))
    with pytest.raises(UpdatingError, match="both must be finite, and the sigma positive"):
        TwoLevelUpdating(inputs, [experiment])


def test_no_experiment_is_refused():
    with pytest.raises(UpdatingError, match="there is no test with a measurement"):
        TwoLevelUpdating(TwoLevelInputs(ot.Normal(), [0]), [])


def test_what_cannot_be_computed_at_the_means_is_refused():
    class Failing:
        def evaluate(self, X):
            return np.full((len(X), 1), np.nan)

        def computeGradientSample(self, X):
            return np.full((len(X), 1, 1), np.nan)

    experiment = Experiment("t", Failing(), (Measurement("y", 0, 0.0, 1.0),))
    with pytest.raises(UpdatingError, match="made-up runs of the tests cannot be computed"):
        TwoLevelUpdating(TwoLevelInputs(ot.Normal(), [0]), [experiment]).run()


def test_inputs_are_refused_with_what_is_wrong():
    correlation = ot.CorrelationMatrix([[1.0, 0.5], [0.5, 1.0]])
    with pytest.raises(ValueError, match="share both of them or neither"):
        TwoLevelInputs(ot.JointDistribution([ot.Normal()] * 2, ot.NormalCopula(correlation)), [0])
    with pytest.raises(ValueError, match="finite numbers >= 0"):
        TwoLevelInputs(ot.Normal(2), meanUncertainty=[1.0, -1.0])
    with pytest.raises(ValueError, match="indices from 0 to 1"):
        TwoLevelInputs(ot.Normal(2), [2])
    with pytest.raises(ValueError, match="normal copula or independent"):
        TwoLevelInputs(ot.JointDistribution([ot.Normal()] * 2, ot.ClaytonCopula(2.0)))
    with pytest.raises(ValueError, match="one uncertainty of the mean"):
        TwoLevelInputs(ot.Normal(2), meanUncertainty=[1.0, 2.0], groups=["g", "g"])


def test_probabilities_are_those_of_the_closed_form_whatever_is_unknown():
    """y = a + b + c with a shared, the mean of b and the sigma of c unknown: P(y > 3 | parameters) is normal."""
    ot.RandomGenerator.SetSeed(8)
    inputs = TwoLevelInputs(ot.Normal(3), [0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.3])
    limit = Limit("high", lambda Y: 3.0 - Y[:, 0], lambda Y: 3.0 - Y[:, 0], 1e-2)
    parameters = normals(50, 3)
    found = FailureProbabilities(inputs, linear_model([1.0, 1.0, 1.0]), [limit]).compute(parameters)[:, 0]
    values = inputs.valuesOf(parameters)
    exact = stats.norm.sf((3.0 - values[:, 0] - values[:, 1]) / np.hypot(1.0, values[:, 2]))
    # The first is the shared value itself, the second the mean of b, the third the sigma of c.
    np.testing.assert_allclose(found, exact, rtol=0.3)
    assert np.mean(found / exact) == pytest.approx(1.0, abs=0.06)


def test_probabilities_where_nothing_scatters_are_0_or_1():
    ot.RandomGenerator.SetSeed(9)
    inputs = TwoLevelInputs(ot.Normal(), [0])
    limit = Limit("high", lambda Y: 1.0 - Y[:, 0], lambda Y: 1.0 - Y[:, 0])
    parameters = normals(100, 1)
    found = FailureProbabilities(inputs, linear_model([1.0]), [limit]).compute(parameters)[:, 0]
    np.testing.assert_array_equal(found, parameters[:, 0] > 1.0)


def test_a_poor_linear_model_leaves_probabilities_unbiased():
    ot.RandomGenerator.SetSeed(10)
    inputs = TwoLevelInputs(ot.Normal(2), [0])
    model = FunctionModel(ot.SymbolicFunction(["a", "b"], ["0.3 * a + b + 0.4 * b^2"]))
    limit = Limit("high", lambda Y: 3.0 - Y[:, 0], lambda Y: 3.0 - Y[:, 0])
    parameters = normals(400, 1)
    found = FailureProbabilities(inputs, model, [limit]).compute(parameters)[:, 0]
    root = np.sqrt(1.0 + 1.6 * (3.0 - 0.3 * parameters[:, 0]))
    exact = stats.norm.sf((root - 1.0) / 0.8) + stats.norm.cdf((-root - 1.0) / 0.8)
    assert found.mean() == pytest.approx(exact.mean(), rel=0.15)


def test_more_experiments_are_expected_to_narrow_the_bound_as_the_conjugate_answer_says():
    """y = x, its mean known to 0.5, sigma 1: the mean after n tests without error has the variance 1 / (4 + n)."""
    ot.RandomGenerator.SetSeed(11)
    inputs = TwoLevelInputs(ot.Normal(), meanUncertainty=[0.5])
    limit = Limit("high", lambda Y: 2.5 - Y[:, 0], lambda Y: 2.5 - Y[:, 0], 0.02)
    parameters = normals(4000, 1)
    chances = stats.norm.sf(2.5 - 0.5 * parameters)
    futures = NextExperiments(inputs, parameters, chances, [limit])
    experiment = Experiment("t", linear_model([1.0]), (Measurement("y", 0, 0.0, 1e-6),))
    rows = futures.measured(experiment, (0, 4, 20))["high"]
    for row in rows:
        sigma = 1.0 / math.sqrt(4.0 + row.number)
        means = math.sqrt(0.25 - sigma**2) * np.random.default_rng(2).normal(size=100_000)
        high, low = (stats.norm.sf(2.5 - means - side * 1.645 * sigma) for side in (1.0, -1.0))
        assert row.bound == pytest.approx(high.mean(), rel=0.15)
        assert row.width == pytest.approx((high - low).mean(), rel=0.15)
        assert row.decided == pytest.approx(np.mean((high <= 0.02) | (low > 0.02)), abs=0.12)


def test_counts_of_failure_free_tests_update_the_probability_as_bayes_says():
    inputs = TwoLevelInputs(ot.Normal(), meanUncertainty=[0.5])
    limit = Limit("high", lambda Y: Y[:, 0], lambda Y: Y[:, 0], 1e-2)
    # Uniform on [0, 1]: after n failure-free tests a beta law, whose bound at 95 % is 1 - 0.05^(1 / (n + 1)).
    chances = ((np.arange(4000) + 0.5) / 4000)[:, None]
    rows = NextExperiments(inputs, np.zeros((4000, 1)), chances, [limit]).counted((0, 10, 100, 500))["high"]
    for row in rows:
        assert row.bound == pytest.approx(1.0 - 0.05 ** (1.0 / (row.number + 1)), rel=0.05)
    assert [row.number for row in rows] == [0, 10, 100]
    # Before any test the chance is above the limit with 95 %, which decides; failure-free tests make it open again.
    assert [row.decided for row in rows] == [1.0, 0.0, 0.0]
    assert neededNumber(rows) == 0


def test_failure_free_number_is_the_binomial_one():
    number = failureFreeNumber(0.05)
    assert (1.0 - 0.05) ** number <= 0.05 < (1.0 - 0.05) ** (number - 1)
