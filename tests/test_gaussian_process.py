"""Gaussian processes against the textbook's formulas, with dense matrices."""

import numpy as np
import pytest
from scipy import optimize, stats

from satsep_ot.methods.reliability import gaussian_process
from satsep_ot.methods.reliability.gaussian_process import GaussianProcess, chooseRows


def smooth(x):
    return np.sin(1.5 * x[:, 0]) + 0.4 * x[:, 1] ** 2 - 0.3 * x[:, 0] * x[:, 1]


@pytest.fixture(scope="module")
def data():
    x = np.random.default_rng(0).standard_normal((40, 2))
    return x, smooth(x)


@pytest.fixture(scope="module")
def noisy(data):
    x, values = data
    return x, values + 0.1 * np.random.default_rng(2).standard_normal(len(x))


def denseCovariance(process, a, b):
    """Covariance (n, m) of the latent values, by its definition."""
    amplitude, noise, trend = np.exp(2.0 * process.hyper[[0, 3, 4]])
    r = np.sqrt(5.0) * np.linalg.norm((a[:, None] - b[None]) / np.exp(process.hyper[1:3]), axis=2)
    inner = a @ b.T
    return amplitude * (1.0 + r + r**2 / 3.0) * np.exp(-r) + 30.0 * (1.0 + inner) + trend * inner**2, noise


def test_the_gradient_of_the_objective_is_its_slope(noisy, monkeypatch):
    starts = []

    def minimize(objective, start, **options):
        starts.append(np.array(start))
        differences = [
            (objective(start + step)[0] - objective(start - step)[0]) / 2e-4 for step in 1e-4 * np.eye(len(start))
        ]
        np.testing.assert_allclose(objective(start)[1], differences, rtol=1e-4, atol=1e-4 * np.abs(differences).max())
        return optimize.OptimizeResult(x=start, fun=objective(start)[0])

    monkeypatch.setattr(gaussian_process.optimize, "minimize", minimize)
    # From the prior and from shorter lengths, and from elsewhere.
    GaussianProcess(*noisy)
    assert len(starts) == 2
    assert (starts[1][1:3] < starts[0][1:3]).all()
    GaussianProcess(*noisy, start=np.array([0.3, -0.5, 0.8, -2.0, -1.0]))
    assert len(starts) == 3


def test_predictions_are_those_of_the_dense_formulas(noisy):
    x, values = noisy
    process = GaussianProcess(x, values)
    new = 1.5 * np.random.default_rng(1).standard_normal((30, 2))
    prior, noise = denseCovariance(process, x, x)
    cross, _ = denseCovariance(process, new, x)
    own, _ = denseCovariance(process, new, new)
    inverse = np.linalg.inv(prior + (noise + 1e-9) * np.eye(len(x)))
    mean = values.mean() + cross @ inverse @ (values - values.mean())
    variance = np.diag(own - cross @ inverse @ cross.T) + noise
    found, deviation = process.predict(new)
    np.testing.assert_allclose(found, mean, atol=1e-6)
    np.testing.assert_allclose(found, process.predictMean(new), rtol=1e-12)
    np.testing.assert_allclose(deviation, values.std() * np.sqrt(variance), rtol=1e-3)


def test_leaving_one_out_is_what_the_others_predict(noisy):
    x, values = noisy
    process = GaussianProcess(x, values)
    errors, deviations = process.leaveOneOut()
    centred = (values - values.mean()) / values.std()
    prior, noise = denseCovariance(process, x, x)
    prior += (noise + 1e-9) * np.eye(len(x))
    for i in (0, 7, 39):
        rest = np.arange(40) != i
        weights = np.linalg.solve(prior[np.ix_(rest, rest)], prior[rest, i])
        assert errors[i] == pytest.approx(values.std() * (centred[i] - weights @ centred[rest]), rel=1e-4, abs=1e-6)
        deviation = np.sqrt(prior[i, i] - weights @ prior[rest, i])
        assert deviations[i] == pytest.approx(values.std() * deviation, rel=1e-4)


def test_the_claimed_error_is_the_real_one():
    generator = np.random.default_rng(3)
    x = generator.standard_normal((60, 2))
    new = generator.standard_normal((400, 2))
    mean, deviation = GaussianProcess(x, smooth(x)).predict(new)
    standardised = (smooth(new) - mean) / deviation
    assert 0.2 < np.sqrt(np.mean(np.minimum(standardised**2, 25.0))) < 1.5
    assert np.abs(mean - smooth(new)).mean() < 0.02
    # Noise is found and is part of the claim.
    noisy = smooth(x) + 0.3 * generator.standard_normal(60)
    mean, deviation = GaussianProcess(x, noisy).predict(new)
    standardised = (smooth(new) + 0.3 * generator.standard_normal(400) - mean) / deviation
    assert 0.7 < np.sqrt(np.mean(standardised**2)) < 1.4


def test_predictions_scale_with_the_values(data):
    x, values = data
    new = np.random.default_rng(1).standard_normal((10, 2))
    mean, deviation = GaussianProcess(x, values).predict(new)
    for scale in (1e-9, 1e12):
        scaledMean, scaledDeviation = GaussianProcess(x, scale * values + 3.0 * scale).predict(new)
        np.testing.assert_allclose(scaledMean, scale * (mean + 3.0), rtol=1e-4)
        np.testing.assert_allclose(scaledDeviation, scale * deviation, rtol=1e-3)


def test_equal_values_and_equal_points_do_no_harm():
    x = np.repeat(np.random.default_rng(0).standard_normal((6, 2)), 5, axis=0)
    mean, deviation = GaussianProcess(x, x[:, 0]).predict(x)
    np.testing.assert_allclose(mean, x[:, 0], atol=0.05)
    assert np.isfinite(deviation).all()
    mean, deviation = GaussianProcess(x, np.full(30, 7.0)).predict(3.0 * x)
    np.testing.assert_allclose(mean, 7.0)
    assert (deviation < 1e-6).all()


def test_a_kept_start_is_not_searched(data):
    start = np.array([0.3, -0.5, 0.8, -2.0, -1.0])
    np.testing.assert_array_equal(GaussianProcess(*data, start=start, search=False).hyper, start)


def test_of_many_points_those_near_0_are_kept():
    values = np.random.default_rng(0).standard_normal(1000)
    rows = chooseRows(values)
    assert len(rows) == len(np.unique(rows)) == 360
    assert set(np.argsort(np.abs(values))[:240]) <= set(rows)
    # The others are spread over all the rest.
    assert np.abs(values[rows]).max() > 2.0
    np.testing.assert_array_equal(chooseRows(values[:360]), np.arange(360))
    few = stats.norm.rvs(size=5, random_state=0)
    np.testing.assert_array_equal(chooseRows(few), np.arange(5))


def test_gradients_are_the_slopes_of_the_mean(data):
    x, values = data
    process = GaussianProcess(x, values)
    points, step = np.random.default_rng(5).standard_normal((7, 2)), 1e-3
    differences = [
        (process.predictMean(points + shift) - process.predictMean(points - shift)) / (2.0 * step)
        for shift in step * np.eye(2)
    ]
    np.testing.assert_allclose(process.gradients(points), np.column_stack(differences), rtol=1e-4, atol=1e-5)
