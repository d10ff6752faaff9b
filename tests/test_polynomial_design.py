"""The weighted design keeps least squares well conditioned where the plain one does not."""

import itertools

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.polynomials.basis import PolynomialBasis
from satsep_ot.methods.polynomials.design import christoffelDesign, dOptimalDesign
from satsep_ot.methods.polynomials.fit import fit_polynomial


def test_weighted_normal_matrix_is_the_identity_on_average():
    ot.RandomGenerator.SetSeed(1)
    points, weights = christoffelDesign(2, 3, 40000)
    design = PolynomialBasis(2, 3).evaluate(points)
    # Entries of w psi_j psi_k are bounded by P = 10: four standard errors are at most 0.1.
    np.testing.assert_allclose((design * weights) @ design.T / len(points), np.eye(10), atol=0.1)


def test_it_is_better_conditioned_than_random_points():
    ot.RandomGenerator.SetSeed(2)
    basis = PolynomialBasis(3, 4)
    ratios = []
    for _ in range(10):
        points, weights = christoffelDesign(3, 4, 3 * basis.size)
        plain = np.array(ot.Normal(3).getSample(3 * basis.size))
        values = np.zeros(len(points))
        ratios.append(
            fit_polynomial(basis, plain, values).condition / fit_polynomial(basis, points, values, weights).condition
        )
    assert np.median(ratios) > 2.0


def test_no_points_are_refused():
    with pytest.raises(ValueError, match="at least one variable and one point, got 2 and 0"):
        christoffelDesign(2, 2, 0)


def test_d_optimal_points_on_an_interval_are_those_of_guest():
    # Guest (1958): the ends and the zeros of the derivative of the Legendre polynomial of the degree.
    candidates = np.linspace(-1.0, 1.0, 2001)
    found = candidates[dOptimalDesign(candidates[:, None], 4, 5)]
    np.testing.assert_allclose(found, [-1.0, -np.sqrt(3.0 / 7.0), 0.0, np.sqrt(3.0 / 7.0), 1.0], atol=1e-3)


def test_d_optimal_design_is_the_best_of_all_subsets():
    random = np.random.default_rng(4)
    candidates = random.standard_normal((12, 2))
    rows = PolynomialBasis(2, 1).evaluate(candidates).T

    def determinant(chosen):
        return np.linalg.det(rows[list(chosen)].T @ rows[list(chosen)])

    best = max(determinant(chosen) for chosen in itertools.combinations_with_replacement(range(12), 4))
    assert determinant(dOptimalDesign(candidates, 1, 4)) == pytest.approx(best)


def test_d_optimal_design_beats_random_points():
    random = np.random.default_rng(5)
    basis = PolynomialBasis(2, 3)
    candidates = random.standard_normal((400, 2))
    rows = basis.evaluate(candidates).T
    chosen = dOptimalDesign(candidates, 3, 20)
    assert len(chosen) == 20
    logarithm = np.linalg.slogdet(rows[chosen].T @ rows[chosen])[1]
    others = [random.choice(400, 20, replace=False) for _ in range(200)]
    assert logarithm > max(np.linalg.slogdet(rows[other].T @ rows[other])[1] for other in others) + 3.0


def test_d_optimal_design_names_what_is_missing():
    line = np.linspace(0.0, 1.0, 30)[:, None] * np.array([1.0, 2.0])
    with pytest.raises(ValueError, match="6 terms but the candidates give rank 3 only"):
        dOptimalDesign(line, 2, 8)
    with pytest.raises(ValueError, match="at least 6 points, got 5"):
        dOptimalDesign(np.eye(2), 2, 5)
    with pytest.raises(ValueError, match="finite"):
        dOptimalDesign(np.full((9, 2), np.nan), 1, 5)
