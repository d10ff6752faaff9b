"""The weighted design keeps least squares well conditioned where the plain one does not."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.polynomial_basis import PolynomialBasis, fit_polynomial
from satsep_ot.methods.polynomial_design import christoffelDesign


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
