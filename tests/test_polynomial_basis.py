"""The polynomial basis and its least squares against brute force, numpy and closed forms."""

import math
import tracemalloc

import numpy as np
import pytest
from numpy.polynomial import hermite_e, legendre
from threadpoolctl import threadpool_info, threadpool_limits

from satsep_ot.methods.polynomials import fit as polynomial_fit
from satsep_ot.methods.polynomials.basis import PolynomialBasis, number_of_terms, total_degree_indices
from satsep_ot.methods.polynomials.fit import fit_polynomial
from satsep_ot.methods.polynomials.prediction import predict, predict_gradient, predict_hessian


def hermite(order, x):
    return hermite_e.hermeval(x, np.eye(order + 1)[order]) / math.sqrt(math.factorial(order))


def brute_force(basis, points):
    return np.array(
        [
            np.prod([hermite(order, x) for order, x in zip(alpha, points.T, strict=True)], axis=0)
            for alpha in basis.indices
        ]
    )


@pytest.fixture
def random():
    return np.random.default_rng(7)


@pytest.mark.parametrize("dimension", [1, 2, 3, 6])
@pytest.mark.parametrize("norm", [1.0, 0.6])
def test_basis_and_prediction_match_products_of_numpy_polynomials(random, dimension, norm):
    basis = PolynomialBasis(dimension, 4, norm)
    points = random.standard_normal((1500, dimension))
    reference = brute_force(basis, points)
    np.testing.assert_allclose(basis.evaluate(points), reference, atol=1e-11, rtol=1e-11)
    coefficients = random.standard_normal((basis.size, 2))
    np.testing.assert_allclose(predict(basis, coefficients, points), reference.T @ coefficients, atol=1e-10)
    np.testing.assert_allclose(predict(basis, coefficients[:, 0], points), reference.T @ coefficients[:, 0], atol=1e-10)


def test_ten_variables_are_split_by_degree(random):
    basis = PolynomialBasis(10, 4)
    assert basis.size == number_of_terms(10, 4) == 1001
    points = random.standard_normal((30, 10))
    coefficients = random.standard_normal(basis.size)
    np.testing.assert_allclose(
        predict(basis, coefficients, points), brute_force(basis, points).T @ coefficients, rtol=1e-9
    )


def test_index_sets():
    assert len(total_degree_indices(6, 4)) == 210
    hyperbolic = total_degree_indices(3, 4, 0.5)
    assert all((np.sqrt(alpha).sum()) ** 2 <= 4.0 + 1e-9 for alpha in hyperbolic)
    everything = total_degree_indices(3, 4)
    inside = [tuple(a) for a in everything if np.sqrt(a).sum() ** 2 <= 4.0 + 1e-9]
    assert sorted(inside) == sorted(map(tuple, hyperbolic))


def test_derivatives_match_differences_of_the_polynomial(random):
    # A recurrence with all three coefficients: Jacobi-like, made by shifting Legendre.
    order = np.arange(5)
    a = np.sqrt((2 * order + 1) * (2 * order + 3)) / (order + 1)
    c = -order / (order + 1) * np.sqrt((2 * order + 3) / np.maximum(2 * order - 1, 1))
    shifted = np.column_stack([2.0 * a, -a, c])
    basis = PolynomialBasis(2, 5, recurrence=np.array([shifted, shifted]))
    points = random.uniform(0.0, 1.0, (20, 2))
    third = legendre.legval(2.0 * points[:, 0] - 1.0, [0, 0, 0, 1]) * math.sqrt(7.0)
    position = basis.indices.tolist().index([3, 0])
    np.testing.assert_allclose(basis.evaluate(points)[position], third, atol=1e-12)
    coefficients = random.standard_normal(basis.size)
    gradient = predict_gradient(basis, coefficients, points)
    hessian = predict_hessian(basis, coefficients, points)
    for j in range(2):
        step = 1e-5 * np.eye(2)[j]
        forward, backward = points + step, points - step
        np.testing.assert_allclose(
            gradient[:, j],
            (predict(basis, coefficients, forward) - predict(basis, coefficients, backward)) / 2e-5,
            rtol=1e-6,
            atol=1e-5,
        )
        np.testing.assert_allclose(
            hessian[:, j],
            (predict_gradient(basis, coefficients, forward) - predict_gradient(basis, coefficients, backward)) / 2e-5,
            rtol=1e-6,
            atol=1e-4,
        )


def test_no_variable_is_the_constant():
    basis = PolynomialBasis(0, 4)
    fit = fit_polynomial(basis, np.empty((5, 0)), np.arange(5.0))
    assert fit.coefficients.tolist() == pytest.approx([2.0])
    assert fit.predict(np.empty((2, 0))).tolist() == pytest.approx([2.0, 2.0])


@pytest.mark.parametrize("weighted", [False, True])
@pytest.mark.parametrize("outputs", [None, 3])
def test_fit_leave_one_out_and_folds_match_numpy_and_refitting(random, weighted, outputs):
    basis = PolynomialBasis(2, 3)
    points = random.standard_normal((40, 2))
    values = random.standard_normal(40 if outputs is None else (40, outputs))
    weights = random.uniform(0.1, 2.0, 40) if weighted else None
    fit = fit_polynomial(basis, points, values, weights)
    scale = np.ones(40) if weights is None else np.sqrt(weights)
    design = basis.evaluate(points).T * scale[:, None]
    reference = np.linalg.lstsq(design, (values.T * scale).T, rcond=None)[0]
    np.testing.assert_allclose(fit.coefficients, reference, atol=1e-12)
    hat = design @ np.linalg.pinv(design)
    np.testing.assert_allclose(fit.leverages, np.diag(hat), atol=1e-12)

    def errors_without(block):
        kept = np.setdiff1d(np.arange(40), block)
        refit = fit_polynomial(basis, points[kept], values[kept], None if weights is None else weights[kept])
        return values[block] - refit.predict(points[block])

    alone = np.concatenate([errors_without(np.array([i])) for i in range(40)])
    np.testing.assert_allclose(fit.leave_one_out(), alone, rtol=1e-12, atol=1e-12)
    folds = np.array_split(random.permutation(40), 6)
    found = fit.k_fold(folds)
    for fold in folds:
        np.testing.assert_allclose(found[fold], errors_without(fold), rtol=1e-11, atol=1e-12)


def test_quartic_is_reproduced(random):
    points = random.standard_normal((200, 3))

    def quartic(x):
        return 1.0 + x[:, 0] ** 4 - 3.0 * x[:, 0] * x[:, 1] ** 2 * x[:, 2] + x[:, 2] ** 3

    fit = fit_polynomial(PolynomialBasis(3, 4), points, quartic(points))
    fresh = 3.0 * random.standard_normal((100, 3))
    np.testing.assert_allclose(fit.predict(fresh), quartic(fresh), rtol=1e-9, atol=1e-9)


def test_rank_is_named(random):
    basis = PolynomialBasis(2, 2)
    with pytest.raises(ValueError, match=r"6 terms needs at least 6 points, got 5"):
        fit_polynomial(basis, random.standard_normal((5, 2)), np.zeros(5))
    repeated = np.repeat(random.standard_normal((4, 2)), 5, axis=0)
    with pytest.raises(ValueError, match="rank 4 only"):
        fit_polynomial(basis, repeated, np.zeros(20))
    line = random.standard_normal((20, 1)) * np.array([1.0, 2.0])
    with pytest.raises(ValueError, match="rank 3 only"):
        fit_polynomial(basis, line, np.zeros(20))
    weights = np.zeros(20)
    weights[:4] = 1.0
    with pytest.raises(ValueError, match="rank 4 only"):
        fit_polynomial(basis, random.standard_normal((20, 2)), np.zeros(20), weights)


def test_deficient_fit_on_demand_is_the_one_of_minimum_norm(random):
    basis = PolynomialBasis(2, 2)
    points = np.repeat(random.standard_normal((4, 2)), 5, axis=0)
    values = random.standard_normal(20)
    fit = fit_polynomial(basis, points, values, allow_deficient=True)
    reference = np.linalg.lstsq(basis.evaluate(points).T, values, rcond=None)[0]
    assert fit.rank == 4
    np.testing.assert_allclose(fit.coefficients, reference, atol=1e-10)
    np.testing.assert_allclose(fit.leverages, 0.2, atol=1e-10)


def test_point_of_leverage_one_has_no_prediction():
    points = np.array([[0.0]] * 5 + [[1.0]])
    fit = fit_polynomial(PolynomialBasis(1, 1), points, np.array([1.0, 2.0, 3.0, 4.0, 5.0, 9.0]))
    errors = fit.leave_one_out()
    assert np.isinf(errors[5])
    assert errors[0] == pytest.approx(-2.5)
    assert np.isinf(fit.k_fold([np.array([4, 5])])[[4, 5]]).all()


def test_bad_data_is_refused(random):
    basis = PolynomialBasis(2, 1)
    points = random.standard_normal((10, 2))
    values = np.zeros(10)
    values[3] = np.nan
    with pytest.raises(ValueError, match="first is row 3"):
        fit_polynomial(basis, points, values)
    with pytest.raises(ValueError, match="10 finite numbers >= 0"):
        fit_polynomial(basis, points, np.zeros(10), np.full(10, -1.0))
    with pytest.raises(ValueError, match=r"shape \(3, 4\); it must be \(n, 2\)"):
        basis.evaluate(np.zeros((3, 4)))
    for arguments in ((-1, 2), (1, -1)):
        with pytest.raises(ValueError, match="at least 0"):
            PolynomialBasis(*arguments)
    with pytest.raises(ValueError, match=r"\(0, 1\]"):
        PolynomialBasis(1, 1, 2.0)


@pytest.mark.parametrize("weighted", [False, True])
def test_long_designs_are_factorised_in_blocks(random, weighted, monkeypatch):
    basis = PolynomialBasis(2, 3)
    points, values = random.standard_normal((1000, 2)), random.standard_normal((1000, 2))
    weights = random.uniform(0.0, 1.0, 1000) if weighted else None
    whole = fit_polynomial(basis, points, values, weights)
    monkeypatch.setattr(polynomial_fit, "BLOCK_NUMBERS", 12)
    monkeypatch.setattr(polynomial_fit, "ROWS_PER_COLUMN", 3)
    blocks = fit_polynomial(basis, points, values, weights)
    np.testing.assert_allclose(blocks.coefficients, whole.coefficients, atol=1e-13)
    np.testing.assert_allclose(blocks.leverages, whole.leverages, atol=1e-13)
    # An estimate that depends on the signs of the rows.
    assert blocks.condition == pytest.approx(whole.condition, rel=0.5)


def test_overflow_is_named_and_constants_look_at_the_points():
    points = np.full((5, 1), 1e200) * np.arange(1.0, 6.0)[:, None]
    with np.errstate(over="ignore", invalid="ignore"), pytest.raises(ValueError, match="overflow at points as large"):
        fit_polynomial(PolynomialBasis(1, 3), points, np.zeros(5))
    with pytest.raises(ValueError, match="first is row 2"):
        fit_polynomial(PolynomialBasis(1, 0), np.array([[0.0], [1.0], [np.nan]]), np.zeros(3))


def test_covariance_of_the_coefficients(random):
    basis = PolynomialBasis(2, 2)
    points, weights = random.standard_normal((40, 2)), random.uniform(0.5, 2.0, 40)
    design = basis.evaluate(points)
    covariance = fit_polynomial(basis, points, np.zeros(40), weights).relative_covariance()
    np.testing.assert_allclose(covariance, np.linalg.inv((design * weights) @ design.T), atol=1e-12)


@pytest.mark.parametrize(("dimension", "size"), [(1, 25), (1, 1000), (2, 61), (3, 400), (5, 700)])
@pytest.mark.parametrize("weighted", [False, True])
def test_normal_equations_lose_no_digit_that_matters(random, dimension, size, weighted, monkeypatch):
    basis = PolynomialBasis(dimension, 4)
    points = random.standard_normal((size, dimension))
    values = 1e6 + np.column_stack([np.exp(points.sum(axis=1) / dimension), random.standard_normal(size)])
    weights = random.uniform(0.1, 2.0, size) if weighted else None
    found = fit_polynomial(basis, points, values, weights)
    monkeypatch.setattr(polynomial_fit, "NORMAL_CONDITION", 0.0)
    reference = fit_polynomial(basis, points, values, weights)
    scale = np.abs(reference.coefficients).max(axis=0)
    assert (np.abs(found.coefficients - reference.coefficients) / scale).max() < 1e-12
    np.testing.assert_allclose(found.leverages, reference.leverages, rtol=1e-11, atol=1e-12)


def test_normal_equations_are_left_where_they_would_lose_digits(random, monkeypatch):
    basis = PolynomialBasis(2, 4)
    # So close together that the polynomials are nearly dependent.
    points = 0.1 * random.standard_normal((200, 2))
    values = random.standard_normal(200)
    fit = fit_polynomial(basis, points, values)
    assert fit.condition > 1e4
    monkeypatch.setattr(polynomial_fit, "NORMAL_CONDITION", 0.0)
    assert np.array_equal(fit.coefficients, fit_polynomial(basis, points, values).coefficients)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_data_that_are_not_finite_are_named_on_every_way(random, bad):
    basis = PolynomialBasis(2, 1)
    for row, column in ((7, 0), (7, 1)):
        points, values = random.standard_normal((40, 2)), random.standard_normal((40, 2))
        values[row, column] = bad
        with pytest.raises(ValueError, match="first is row 7"):
            fit_polynomial(basis, points, values)
        values[row, column] = 0.0
        points[row, column] = bad
        with np.errstate(invalid="ignore"), pytest.raises(ValueError, match="first is row 7"):
            fit_polynomial(basis, points, values)


@pytest.mark.parametrize(
    ("dimension", "size", "threads"),
    [
        # Few products, for which the libraries start no threads; then one thread; then as many as they like.
        (7, 2047, 2),
        (7, 2048, 1),
        (1, 100_000, 1),
        (298, 1000, 1),
        (299, 1000, 2),
    ],
)
def test_only_large_fits_use_several_threads(dimension, size, threads, monkeypatch):
    """A degree of 1 has a term more than variables; the work is that of the normal equations."""
    seen = []

    def number(*arguments):
        seen.extend(library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas")

    monkeypatch.setattr(polynomial_fit, "_least_squares", number)
    with threadpool_limits(2, user_api="blas"):
        fit_polynomial(PolynomialBasis(dimension, 1), np.zeros((size, dimension)), np.zeros(size))
    assert set(seen) == {threads}


def test_the_memory_of_a_fit_does_not_grow_with_the_points(random):
    basis = PolynomialBasis(3, 4)
    points = random.standard_normal((200_000, 3))
    values = points.sum(axis=1)
    fit = fit_polynomial(basis, points[:1000], values[:1000])

    def peak(task):
        tracemalloc.start()
        task()
        largest = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return largest

    # The design would take 56 MB, the answers take 1.6 MB.
    for task in (
        lambda: fit_polynomial(basis, points, values),
        lambda: polynomial_fit._factorise(basis, points, values[:, None], None),
        lambda: fit.relative_variance(points),
        lambda: fit.predict(points),
    ):
        assert peak(task) < 12e6


def test_shapes_that_do_not_match_are_refused(random):
    with pytest.raises(ValueError, match=r"recurrence has shape \(1, 3, 3\); it must be \(2, 3, 3\)"):
        PolynomialBasis(2, 3, recurrence=np.zeros((1, 3, 3)))
    with pytest.raises(ValueError, match=r"values have shape \(3,\); it must be \(4,\) or \(4, p\)"):
        fit_polynomial(PolynomialBasis(1, 1), np.arange(4.0)[:, None], np.arange(3.0))


def test_a_fold_without_which_there_is_no_fit_has_no_prediction():
    # Two of three points are left out of a line: the factorisation of what is left breaks down.
    fit = fit_polynomial(PolynomialBasis(1, 1), np.array([[0.0], [1.0], [3.0]]), np.array([0.0, 1.0, 2.0]))
    assert np.isinf(fit.k_fold([np.array([0, 1])])[:2]).all()
    assert np.isinf(fit.k_fold([np.array([0, 1, 2])])).all()


@pytest.mark.parametrize("weighted", [False, True])
def test_the_noise_is_that_of_the_residuals_over_the_spare_points(random, weighted):
    points, weights = random.standard_normal((12, 1)), random.uniform(0.5, 2.0, 12) if weighted else None
    values = random.standard_normal((12, 2))
    fit = fit_polynomial(PolynomialBasis(1, 3), points, values, weights)
    squares = (fit.residuals.T**2 * (1.0 if weights is None else weights)).sum(axis=1)
    np.testing.assert_allclose(fit.noise_deviation**2, squares / 8.0)
    exact = fit_polynomial(PolynomialBasis(1, 3), points[:4], values[:4])
    assert exact.noise_deviation is None
