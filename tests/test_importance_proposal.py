"""The Gaussian mixtures that new points are drawn from: densities, samples, and which components a fit keeps."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.importance_proposal import GaussianMixture, ModeMixture, fitGaussianMixture


def generator():
    return np.random.default_rng(1)


SHARES = np.array([0.3, 0.7])
MEANS = np.array([[0.0, 1.0], [3.0, -1.0]])
COVARIANCES = np.array([[[1.0, 0.3], [0.3, 0.5]], [[0.4, -0.1], [-0.1, 2.0]]])


def example():
    return GaussianMixture(SHARES, MEANS, COVARIANCES)


def test_a_mixture_against_that_of_openturns():
    mixture = example()
    parts = [
        ot.Normal(mean.tolist(), ot.CovarianceMatrix(covariance.tolist()))
        for mean, covariance in zip(MEANS, COVARIANCES, strict=True)
    ]
    reference = ot.Mixture(parts, SHARES.tolist())
    points = generator().normal(size=(50, 2)) * 2.0
    np.testing.assert_allclose(mixture.logDensity(points), np.log(reference.computePDF(points))[:, 0], rtol=1e-12)
    sample = mixture.sample(200_000, generator())
    np.testing.assert_allclose(sample.mean(axis=0), reference.getMean(), atol=0.02)
    np.testing.assert_allclose(np.cov(sample.T), np.array(reference.getCovariance()), atol=0.05)


def test_a_mixture_of_modes_is_standard_across_its_subspace():
    basis = np.linalg.qr(generator().normal(size=(3, 2)))[0]
    modes = ModeMixture(np.array([1.0]), [basis], [example()])
    points = generator().normal(size=(20, 3))
    across = np.linalg.svd(basis)[0][:, 2]
    expected = example().logDensity(points @ basis) - 0.5 * (points @ across) ** 2 - 0.5 * np.log(2.0 * np.pi)
    np.testing.assert_allclose(modes.logDensity(points), expected, rtol=1e-12)
    sample = modes.sample(200_000, generator())
    np.testing.assert_allclose((sample @ basis).mean(axis=0), [2.1, -0.4], atol=0.02)
    assert np.std(sample @ across) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(("size", "kept"), [(3, False), (5, True)])
def test_a_component_needs_more_than_two_points_for_each_of_its_unknowns(size, kept):
    points = np.concatenate([generator().normal(size=(400, 1)), 30.0 + 0.1 * generator().normal(size=(size, 1))])
    mixture = fitGaussianMixture(points, generator(), components=2)
    assert (mixture.means > 20.0).any() == kept
    assert mixture.weights.sum() == pytest.approx(1.0)
