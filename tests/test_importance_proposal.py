"""The Gaussian mixtures that new points are drawn from: densities, samples, and which components a fit keeps."""

import numpy as np
import openturns as ot
import pytest
from scipy.special import ndtr

from satsep_ot.methods.reliability.estimate import paretoShape
from satsep_ot.methods.reliability.mixture import (
    GaussianMixture,
    ModeMixture,
    _nextSmoothing,
    fitGaussianMixture,
    fitImportantRegion,
)
from satsep_ot.methods.reliability.proposal import Pool


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


def test_points_in_more_directions_than_their_clusters_can_tell_keep_the_clusters():
    """Each of a dozen clusters would need twice as many points as directions for a covariance of its own."""
    points = generator().normal(size=(1200, 100))
    points[:, 0] += 4.0
    mixture = fitGaussianMixture(points, generator())
    assert np.isfinite(mixture.logDensity(points)).all()
    assert mixture.sample(2000, generator())[:, 0].mean() == pytest.approx(4.0, abs=0.2)


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


def test_the_widened_copy_and_the_normal_bound_the_weights():
    mixture = example()
    defended = mixture.withDefence()
    assert defended.weights.sum() == pytest.approx(1.0)
    points = generator().normal(size=(5000, 2)) * 5.0
    normal = -0.5 * (points**2).sum(axis=1) - np.log(2.0 * np.pi)
    wide = GaussianMixture(SHARES, MEANS, 4.0 * COVARIANCES)
    expected = np.logaddexp.reduce(
        [np.log(0.75) + mixture.logDensity(points), np.log(0.15) + wide.logDensity(points), np.log(0.1) + normal]
    )
    np.testing.assert_allclose(defended.logDensity(points), expected, rtol=1e-12)
    # A tenth of the points come from the standard normal itself: none of them weighs more than ten.
    assert np.exp(normal - defended.logDensity(points)).max() <= 10.0


def test_densities_of_many_points_are_those_of_each():
    points = generator().normal(size=(9000, 2))
    whole = example().logDensity(points)
    for row in (0, 4095, 4096, 8191, 8192, 8999):
        assert whole[row] == pytest.approx(example().logDensity(points[row : row + 1])[0], rel=1e-14)


def test_a_fit_recovers_the_mixture_that_it_has_points_of():
    mixture = GaussianMixture(
        np.array([0.25, 0.75]), np.array([[-4.0, 0.0], [3.0, 2.0]]), np.array([0.2 * np.eye(2), np.diag([0.5, 2.0])])
    )
    points = mixture.sample(4000, generator())
    fitted = fitGaussianMixture(points, generator(), components=2)
    order = np.argsort(fitted.means[:, 0])
    np.testing.assert_allclose(fitted.weights[order], mixture.weights, atol=0.02)
    np.testing.assert_allclose(fitted.means[order], mixture.means, atol=0.08)
    covariances = fitted.factors @ fitted.factors.transpose(0, 2, 1)
    np.testing.assert_allclose(covariances[order], [0.2 * np.eye(2), np.diag([0.5, 2.0])], atol=0.12)


def test_the_standard_normal_counts_like_some_points_in_each_covariance():
    # 0.02 (k + 1)^2 = 0.18 points of it beside 50 of no spread at all, for two variables.
    points = np.repeat([[2.0, -1.0]], 50, axis=0)
    fitted = fitGaussianMixture(points, generator(), components=1)
    np.testing.assert_allclose(fitted.means, [[2.0, -1.0]])
    np.testing.assert_allclose(fitted.factors[0] ** 2, np.eye(2) * 0.18 / 50.18, rtol=1e-9)


@pytest.mark.parametrize(("dimension", "components"), [(1, 3), (2, 6), (5, 7), (9, 11), (20, 12)])
def test_more_directions_get_more_components(dimension, components):
    # As many clusters as there could be components, far from each other.
    centres = 50.0 * generator().normal(size=(20, dimension))
    points = np.repeat(centres, 400, axis=0) + generator().normal(size=(8000, dimension))
    assert len(fitGaussianMixture(points, generator()).weights) == components


def test_each_level_of_the_search_keeps_weights_that_vary_by_two_and_a_half():
    y = generator().normal(size=20_000)
    for limit in (2.0, 4.0, 8.0):
        value, scale = limit - y, np.full(len(y), 1e-3)
        smoothing = _nextSmoothing(np.zeros(len(y)), value, scale, np.inf)

        def variation(width, value=value):
            weight = ndtr(-value / width)
            return weight.std() / weight.mean()

        assert variation(smoothing) == pytest.approx(2.5, rel=0.1)
        # No level is smoother than the one before it.
        assert _nextSmoothing(np.zeros(len(y)), value, scale, 0.5 * smoothing) == pytest.approx(0.5 * smoothing)
    # 13.8 % of failures have this variation without any smoothing, and more of them less.
    assert _nextSmoothing(np.zeros(len(y)), 1.0 - y, np.full(len(y), 1e-3), np.inf) == 0.0
    assert _nextSmoothing(np.zeros(len(y)), 1.2 - y, np.full(len(y), 1e-3), np.inf) > 0.0


def test_the_search_widens_the_uncertain_band_to_twice_the_scale():
    mixture = fitImportantRegion(lambda y: (2.0 - y[:, 0], np.full(len(y), 0.5)), 1, generator())
    # The target is the normal density times Phi((y - 2) / (2 * 0.5)).
    y = np.linspace(-8.0, 8.0, 4001)
    target = np.exp(-0.5 * y**2) * ndtr(y - 2.0)
    mean = (target @ y) / target.sum()
    # 75 % of the points are of the fitted mixture, 15 % of its copy of twice the spread about the same means, and a
    # tenth is standard normal.
    assert 0.9 * mean == pytest.approx(float(mixture.weights @ mixture.means[:, 0]), abs=0.08)


def test_the_search_ends_with_nothing_where_too_few_points_carry_the_weight():
    # One point in 8000 is inside, whatever the smoothing: no mixture follows from it.
    def needle(y):
        value = np.full(len(y), 1.0)
        value[0] = -1.0
        return value, np.full(len(y), 1e-3)

    assert fitImportantRegion(needle, 2, generator()) is None


def test_selection_passes_the_share_of_an_empty_function_on():
    pool = Pool(np.zeros((3, 1)), np.array([1.0, 2.0, 1.0]))
    ones, first, none = np.ones(3), np.array([1.0, 0.0, 0.0]), np.zeros(3)
    np.testing.assert_allclose(pool.selection([(0.4, ones), (0.6, first)]), [0.7, 0.2, 0.1])
    np.testing.assert_allclose(pool.selection([(0.2, ones), (0.3, first), (0.5, none)]), [0.7, 0.2, 0.1])


def test_the_expectation_of_a_pool_and_its_variance():
    pool = Pool(np.zeros((4, 1)), np.array([1.0, 2.0, 0.0, 1.0]))
    mean, variance = pool.expectation(np.array([1.0, 1.0, 5.0, 0.0]))
    assert mean == pytest.approx(0.75)
    assert variance == pytest.approx(0.6875 / 4.0)


def test_the_pareto_shape_is_that_of_the_largest_fifth():
    # Exact quantiles of a generalised Pareto law above a bulk of four fifths.
    for shape in (-0.3, 0.25, 0.6):
        level = (np.arange(2000) + 0.5) / 2000
        tail = 5.0 + ((1.0 - level) ** -shape - 1.0) / shape
        bulk = np.linspace(0.0, 5.0, 8000)
        assert paretoShape(np.concatenate([bulk, tail])) == pytest.approx(shape, abs=0.05)
    # A few large ones among ten: the shape cannot be below the moments of the largest ten.
    assert paretoShape(np.array([1.0] * 9 + [1e6])) > 0.7
    assert paretoShape(np.concatenate([np.ones(200), [1e9]])) > 0.9


@pytest.mark.parametrize(
    ("limit", "options", "levels", "reached"),
    [(12.0, {}, 12, True), (20.0, {}, 14, False), (20.0, {"maximumLevels": 25}, 21, True)],
)
def test_the_search_is_given_up_after_fifteen_levels(limit, options, levels, reached):
    sizes = []

    def far(y):
        sizes.append(len(y))
        return limit - y[:, 0], np.full(len(y), 1e-3)

    mixture = fitImportantRegion(far, 1, generator(), **options)
    assert (mixture is not None) == reached
    # The closing one takes three times as many points; where the last but one shows nothing, it is not made.
    assert sizes == [8000] * (levels - reached) + [24_000] * reached
    assert not reached or mixture.means.max() == pytest.approx(limit, rel=0.05)


def test_clusters_that_are_close_to_each_other_are_told_apart():
    points = np.repeat([[-0.02], [0.02]], 200, axis=0)
    assert len(fitGaussianMixture(points, generator(), components=2).weights) == 2
    # Points that are all the same are one cluster.
    assert len(fitGaussianMixture(np.ones((50, 1)), generator(), components=2).weights) == 1
