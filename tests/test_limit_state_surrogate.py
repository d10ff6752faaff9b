"""Which polynomial ridge a component gets, how far it is trusted, and what is carried over to a refit."""

import math
from types import SimpleNamespace

import numpy as np
import openturns as ot
import pytest
from scipy.stats import chi2, norm

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.reliability import surrogate as limit_state_surrogate
from satsep_ot.methods.reliability.surrogate import (
    LimitStateSurrogate,
    ProcessFit,
    RidgeModel,
    _fitModel,
    _predictionError,
    normalisedRadius,
    radiusFromNormal,
)


def points(size, dimension, seed=0):
    return np.random.default_rng(seed).standard_normal((size, dimension))


def surrogate(u, *columns, margin=lambda values: 4.0 - values[:, 0], weights=None, **options):
    weights = np.ones(len(u)) if weights is None else weights
    return LimitStateSurrogate(u, np.column_stack(columns), margin, weights, **options)


def models(found):
    return [(fit.model.dimension, fit.model.degree, fit.model.radial) for fit in found.components]


# The choice of the model. --------------------------------------------------------------------------------------------


def test_a_component_gets_three_directions_and_degree_four_at_most():
    # Of so many inputs none gets a Gaussian process.
    u = points(400, 12)
    squares = (np.array([4.0, 3.0, 2.0, 1.5]) * u[:, :4] ** 2).sum(axis=1)
    assert models(surrogate(u, squares))[0][:2] == (3, 2)
    assert models(surrogate(u, squares, maximumDimension=4))[0][:2] == (4, 2)
    fifth = u[:, 0] ** 5
    assert models(surrogate(u, fifth))[0][1] == 4
    assert models(surrogate(u, fifth, maximumDegree=5))[0][1] == 5


def test_the_smallest_model_that_is_exact_is_taken():
    u = points(300, 5)
    line, bend, saddle = u @ [0.6, 0.8, 0.0, 0.0, 0.0], u[:, 2], u[:, 3] * u[:, 4]
    found = surrogate(u, np.full(300, 7.0), 2.0 + line, bend + 0.3 * bend**2, bend**3, bend**4, saddle)
    assert models(found) == [
        (0, 0, False), (1, 1, False), (1, 2, False), (1, 3, False), (1, 4, False), (2, 2, False)
    ]  # fmt: skip
    direction = found.components[1].directions[:, 0]
    np.testing.assert_allclose(direction * np.sign(direction[0]), [0.6, 0.8, 0.0, 0.0, 0.0], atol=1e-12)


def test_a_larger_model_must_lower_the_squared_error_by_a_tenth():
    u = points(400, 1)
    # A line, a bend and noise that are uncorrelated, and uncorrelated with all other polynomials, over these points.
    powers = np.column_stack([u**k for k in range(5)] + [points(400, 1, 1)])
    basis = np.linalg.qr(powers)[0] * math.sqrt(400.0)
    for share, degree in ((0.10, 1), (0.13, 2)):
        # The bend is so large beside the noise: without it the squared error is 9.5 or 12.5 % larger, with the
        # parameter that it costs.
        found = surrogate(u, 3.0 * basis[:, 1] + math.sqrt(share) * basis[:, 2] + basis[:, 5])
        assert models(found) == [(1, degree, False)]


def test_no_model_has_more_parameters_than_three_quarters_of_the_runs():
    assert RidgeModel(0, 0).parameters(10) == 1
    assert RidgeModel(1, 3).parameters(10) == 4 + 9
    assert RidgeModel(2, 2).parameters(10) == 6 + 16
    assert RidgeModel(1, 2, True).parameters(10) == 6 + 9
    assert RidgeModel(0, 2, True).parameters(10) == 3
    # 12 parameters of a parabola along one of ten directions: 16 runs for it.
    for size, dimension in ((15, 0), (16, 1)):
        u = points(size, 10)
        assert surrogate(u, u[:, 0] ** 2 + 3.0 * u[:, 0]).components[0].model.dimension in (dimension, 1)


def test_the_inactive_radius_is_used_where_it_tells_more_than_directions():
    u = points(400, 12)
    squared = (u**2).sum(axis=1)
    assert models(surrogate(u, squared)) == [(0, 4, True)]
    both = surrogate(u, u[:, 0], squared)
    assert both.radial
    assert both.dimension() == 2
    y = both.reduce(points(2000, 12, 5))
    # Points of standard space for values of the variables, and back.
    np.testing.assert_allclose(both.reduce(both.expand(y, np.random.default_rng(0))), y, atol=1e-8)
    np.testing.assert_allclose(y.std(axis=0), 1.0, atol=0.05)


# How exact it is. ----------------------------------------------------------------------------------------------------


def test_the_error_of_prediction_is_generalised_cross_validation_with_the_directions_as_parameters():
    polynomial = SimpleNamespace(residuals=np.array([1.0, -1.0] * 50))
    assert _predictionError(polynomial, np.ones(100), 20) == pytest.approx(1.0 / 0.8)
    # A run of weight 0 is none, for the effective number and for the mean.
    weights = np.repeat([1.0, 0.0], 50)
    polynomial = SimpleNamespace(residuals=np.where(weights > 0.0, 2.0, 100.0))
    assert _predictionError(polynomial, weights, 20) == pytest.approx(2.0 / 0.6)
    assert _predictionError(polynomial, weights, 47) == pytest.approx(2.0 / 0.06)
    assert _predictionError(polynomial, weights, 48) == math.inf


def test_the_error_of_prediction_is_that_of_new_points():
    generator = np.random.default_rng(0)
    found, fresh = [], []
    for seed in range(30):
        u = points(60, 8, seed)
        fit = _fitModel(u, u[:, 0] + generator.standard_normal(60), np.ones(60), RidgeModel(1, 2), None)
        found.append(fit.error)
        new = points(500, 8, 1000 + seed)
        error = fit.polynomial.predict(new @ fit.directions) - new[:, 0] - generator.standard_normal(500)
        fresh.append(np.median(np.abs(error)) / 0.6745)
    assert np.median(found) == pytest.approx(np.median(fresh), rel=0.15)


def test_an_error_is_never_taken_for_less_than_a_small_share_of_the_spread():
    u = points(100, 4)
    found = surrogate(u, 5.0 * u[:, 0], 0.1 * u[:, 1])
    least = 0.003 * np.array([5.0 * u[:, 0].std(), 0.1 * u[:, 1].std()])
    y = np.zeros((1, 2))
    # The polynomial of two terms is known best in the middle of its points, there to 1 / 100 of the variance.
    np.testing.assert_allclose(found.predictionErrors(y)[0], least * math.sqrt(1.01), rtol=2e-3)


def test_the_error_of_the_limit_state_is_that_of_its_components_together():
    u = points(200, 3)
    found = surrogate(u, u[:, 0], u[:, 1], margin=lambda v: 3.0 - 2.0 * v[:, 0] - v[:, 1])
    found.errors = np.array([0.3, 0.8])
    y = found.reduce(np.zeros((1, 3)))
    errors = found.predictionErrors(y)[0]
    value, scale = found.limitState(y)
    assert value[0] == pytest.approx(3.0)
    assert scale[0] == pytest.approx(math.hypot(2.0 * errors[0], errors[1]))
    # A composition that does not look at its components is certain to rounding, and not divided by 0.
    flat = surrogate(u, u[:, 0], margin=lambda v: np.where(v[:, 0] > 0.0, -5.0, 2.0))
    value, scale = flat.limitState(flat.reduce(np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])))
    np.testing.assert_allclose(scale, 5e-12)
    np.testing.assert_array_equal(norm.cdf(-value / scale), [1.0, 0.0])
    nothing = surrogate(u, u[:, 0], margin=lambda v: np.zeros(len(v)))
    assert (nothing.limitState(nothing.reduce(u[:2]))[1] > 0.0).all()


def test_a_search_takes_the_error_of_the_points_that_are_nearest_to_the_limit():
    u = points(300, 2)
    # The first component counts from 1 on.
    found = surrogate(u, u[:, 0], u[:, 1], margin=lambda v: 2.0 - np.where(v[:, 0] > 1.0, 9.0 * v[:, 0], v[:, 1]))
    found.errors = np.array([0.1, 0.2])
    y = found.reduce(points(3000, 2, 3))
    value, exact = found.limitState(y)
    same, quick = found.limitState(y, exact=False)
    np.testing.assert_array_equal(same, value)
    assert np.ptp(quick) == 0.0
    nearest = np.argsort(np.abs(value))[:500]
    assert quick[0] == pytest.approx(np.median(exact[nearest]))
    assert quick[0] < 0.5 * exact.max()
    few = y[:500]
    np.testing.assert_array_equal(found.limitState(few, exact=False)[1], found.limitState(few)[1])


# A refit. ------------------------------------------------------------------------------------------------------------


@pytest.fixture
def searches(monkeypatch):
    """Dimension, degree and start of each search for a subspace."""
    seen, original = [], limit_state_surrogate.fit_ridge

    def recorded(u, column, dimension, degree, weights, starts, initial, *limits):
        seen.append((dimension, degree, None if initial is None else initial.shape[1]))
        return original(u, column, dimension, degree, weights, starts, initial, *limits)

    monkeypatch.setattr(limit_state_surrogate, "fit_ridge", recorded)
    return seen


def test_a_refit_starts_where_the_earlier_fit_has_ended(searches):
    u = points(300, 5)
    noise = 0.5 * points(300, 1, 9)[:, 0]
    bent, linear = u[:, 0] ** 2 + noise, u[:, 0] + noise
    first = surrogate(u, bent)
    assert models(first) == [(1, 2, False)]
    # From nowhere for a parabola, then from the result of the degree below.
    assert searches[:3] == [(1, 2, None), (1, 3, 1), (1, 4, 1)]
    searches.clear()
    surrogate(u, bent, previous=first)
    assert searches[0] == (1, 2, 1)
    # A linear ridge knows nothing of a function that is even in another direction.
    straight = surrogate(u, linear)
    assert models(straight) == [(1, 1, False)]
    searches.clear()
    surrogate(u, bent, previous=straight)
    assert searches[0] == (1, 2, None)


def test_a_refit_does_not_try_again_what_was_outgrown_by_more_than_one_step(searches):
    u = points(500, 5)
    first = surrogate(u, u[:, 0] * u[:, 1] * u[:, 2] + u[:, 0] ** 2 + 0.3 * points(500, 1, 9)[:, 0])
    assert models(first) == [(3, 3, False)]
    searches.clear()
    second = surrogate(u, u[:, 0] * u[:, 1] * u[:, 2] + u[:, 0] ** 2 + 0.3 * points(500, 1, 9)[:, 0], previous=first)
    assert models(second) == [(3, 3, False)]
    assert min(searches)[:2] == (2, 2)
    # The earlier one's directions, as many of them as are asked for.
    assert searches[0] == (2, 2, 2)


# The parts. ----------------------------------------------------------------------------------------------------------


def test_the_normalised_radius_keeps_both_tails():
    directions = np.eye(6)[:, :2]
    for radius in (1e-60, 0.5, 2.0, 20.0, 37.0):
        u = np.array([[0.0, 0.0, radius, 0.0, 0.0, 0.0]])
        t = normalisedRadius(u, directions)
        assert norm.logcdf(t[0]) == pytest.approx(chi2.logcdf(radius**2, 4), rel=1e-6, abs=1e-12)
        assert norm.logsf(t[0]) == pytest.approx(chi2.logsf(radius**2, 4), rel=1e-6, abs=1e-12)
        np.testing.assert_allclose(radiusFromNormal(t, 4), radius, rtol=1e-9)
    # Beyond what a probability can hold it stays a number.
    assert np.isfinite(normalisedRadius(np.array([[0.0, 0.0, 1e3, 0.0, 0.0, 0.0], [0.0] * 6]), directions)).all()


def test_directions_of_all_components_together_have_no_one_twice():
    u = points(300, 5)
    found = surrogate(u, u[:, 0], u[:, 0] + 1e-12 * u[:, 3], u[:, 1] - u[:, 0], u[:, 1] * u[:, 0])
    assert found.directions.shape == (5, 2)
    np.testing.assert_allclose(found.directions.T @ found.directions, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(found.directions[2:], 0.0, atol=1e-6)


def test_a_part_of_the_components_has_the_others_at_their_typical_values():
    u = points(301, 4)
    columns = u[:, 0], u[:, 1] ** 2, u[:, 2] + 7.0
    found = surrogate(u, *columns, margin=lambda v: 20.0 - v.sum(axis=1))
    part = found.restricted([0])
    assert part.dimension() == 1
    typical = np.median(columns[1]) + np.median(columns[2])
    y = np.array([[1.5]]) * part.directions[0, 0]
    np.testing.assert_allclose(part.limitState(y)[0], 20.0 - 1.5 - typical, rtol=1e-9)
    np.testing.assert_allclose(part.limitState(y)[1], part.predictionErrors(y)[:, 0], rtol=1e-9)
    # The whole is as it was.
    assert found.dimension() == 3


def test_components_that_do_not_fail_however_wide_they_spread_have_no_groups():
    u = points(300, 5)
    found = surrogate(u, *u[:, :4].T, margin=lambda values: np.full(len(values), 1.0))
    assert found.groups(np.random.default_rng(0)) == []


def test_the_native_function_of_a_component_that_is_constant():
    u = points(100, 3)
    found = surrogate(u, u[:, 0] + 2.0, np.full(100, 7.0))
    native = found.nativeFunction(StandardSpace(ot.Normal([1.0] * 3, [2.0] * 3, ot.CorrelationMatrix(3))))
    np.testing.assert_allclose(native([4.0, 0.0, 1.0]), [3.5, 7.0], rtol=1e-12)
    np.testing.assert_allclose(
        np.array(native.gradient([4.0, 0.0, 1.0])), [[0.5, 0.0], [0.0] * 2, [0.0] * 2], atol=1e-9
    )


def test_inactive_radius_is_standard_normal_and_inverts():
    generator = np.random.default_rng(0)
    u = generator.standard_normal((20_000, 7))
    directions = np.eye(7)[:, :2]
    t = normalisedRadius(u, directions)
    assert abs(t.mean()) < 0.03
    assert abs(t.std() - 1.0) < 0.03
    np.testing.assert_allclose(radiusFromNormal(t, 5), np.linalg.norm(u[:, 2:], axis=1), rtol=1e-8)


def test_a_surrogate_whose_weights_leave_few_runs_gets_a_smaller_model():
    generator = np.random.default_rng(0)
    u = generator.standard_normal((300, 12))
    values = np.column_stack([u[:, 0] + 0.5 * u[:, 1] * u[:, 2] * u[:, 0]])
    large = LimitStateSurrogate(u, values, lambda v: 4.0 - v[:, 0], np.ones(300))
    assert large.components[0].model.dimension == 3
    weights = np.where(np.arange(300) < 20, 1.0, 1e-6)
    small = LimitStateSurrogate(u, values, lambda v: 4.0 - v[:, 0], weights, large)
    assert small.components[0].model.dimension == 1


def test_errors_of_prediction_grow_where_a_polynomial_extrapolates():
    generator = np.random.default_rng(0)
    standardised, constant = [], []
    for _ in range(30):
        u = generator.standard_normal((80, 12))
        truth = u[:, 0] + 0.3 * u[:, 0] ** 2
        noise = 0.3 * generator.standard_normal(80)
        found = LimitStateSurrogate(
            u, (truth + noise)[:, None], lambda v: 4.0 - v[:, 0], np.ones(80), maximumDimension=1
        )
        y = found.reduce(np.array([[0.0] * 12, [5.0] + [0.0] * 11]))
        error = found.predict(y)[:, 0] - [0.0, 12.5] + 0.3 * generator.standard_normal(2)
        standardised.append(error / found.predictionErrors(y)[:, 0])
        constant.append(error / found.predictionErrors(found.reduce(np.zeros((1, 12))))[0, 0])
    inside, outside = np.sqrt(np.mean(np.square(standardised), axis=0))
    assert 0.7 < inside < 1.3
    assert 0.6 < outside < 1.4
    assert np.sqrt(np.mean(np.square(constant), axis=0))[1] > 1.5


def test_a_process_follows_a_function_of_one_slanted_direction_in_its_active_subspace():
    generator = np.random.default_rng(0)
    direction = np.array([0.5, -0.5, 0.5, -0.5, 0.0, 0.0])

    def resonance(u):
        return 1.0 - 1.0 / (0.3 + (u @ direction - 0.5) ** 2) + 0.1 * u[:, 4]

    u, new = generator.standard_normal((120, 6)), generator.standard_normal((2000, 6))
    surrogate = LimitStateSurrogate(u, resonance(u)[:, None], lambda values: values[:, 0], np.ones(120))
    process = surrogate.components[0]
    assert isinstance(process, ProcessFit)
    np.testing.assert_allclose(process.rotation.T @ process.rotation, np.eye(6), atol=1e-12)
    assert abs(process.rotation[:, 0] @ direction) > 0.99

    plain = ProcessFit(u, resonance(u), process.link, np.eye(6))
    targets = process.link.forward(resonance(new))
    turned, straight = (
        np.sqrt(np.mean((fit.predict(fit.variables(new, None)) - targets) ** 2)) for fit in (process, plain)
    )
    assert turned < 0.5 * straight
