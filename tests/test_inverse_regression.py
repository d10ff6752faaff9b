"""The older gradient-free estimators where they work, where they fail, and ridge approximation beside them."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.subspaces.estimation import subspace_distance
from satsep_ot.methods.subspaces.inverse_regression import localLinearDirections, slicedInverseRegression
from satsep_ot.methods.subspaces.variable_projection import fit_ridge


@pytest.fixture
def random():
    ot.RandomGenerator.SetSeed(1)
    return np.random.default_rng(1)


def test_both_find_a_monotone_ridge(random):
    w = np.linalg.qr(random.standard_normal((5, 1)))[0]
    points = random.standard_normal((3000, 5))
    values = np.exp(0.5 * points @ w[:, 0])
    for estimate in (slicedInverseRegression, localLinearDirections):
        found = estimate(points, values, 1)
        assert subspace_distance(found, w) < 0.1
        assert found[np.abs(found).argmax()] > 0.0


def test_sliced_inverse_regression_is_exact_in_slices_of_a_line():
    # One input decides the slices, and whitening takes the chance correlation with the other out.
    points = np.array([[-1.0, 1.0], [-1.0, -1.0], [1.0, 1.0], [1.0, -1.0]])
    assert slicedInverseRegression(points, points[:, 0], 1, slices=2).tolist() == [[1.0], [0.0]]


def test_sliced_inverse_regression_is_blind_to_even_functions(random):
    points = random.standard_normal((3000, 5))
    values = points[:, 0] ** 2
    assert subspace_distance(slicedInverseRegression(points, values, 1), np.eye(5)[:, :1]) > 0.3
    assert subspace_distance(localLinearDirections(points, values, 1), np.eye(5)[:, :1]) < 0.1


def test_ridge_approximation_is_far_ahead_in_25_inputs(random):
    w = np.linalg.qr(random.standard_normal((25, 2)))[0]
    points = random.standard_normal((260, 25))
    y = points @ w
    values = y[:, 0] + y[:, 1] ** 2 + 0.3 * y[:, 0] * y[:, 1]
    values += 0.1 * values.std() * random.standard_normal(260)
    assert subspace_distance(fit_ridge(points, values, 2).directions, w) < 0.1
    assert subspace_distance(slicedInverseRegression(points, values, 2), w) > 0.5
    assert subspace_distance(localLinearDirections(points, values, 2), w) > 0.3


def test_bad_data_is_refused():
    points = np.arange(12.0).reshape(6, 2)
    for arguments, message in (
        ((points, np.zeros(5), 1), r"got \(6, 2\) and \(5,\)"),
        ((points, np.full(6, np.nan), 1), "finite"),
        ((points, np.zeros(6), 3), "is 3; it must be 1 to 2"),
        ((points[:2], np.zeros(2), 1), "at least"),
    ):
        for estimate in (slicedInverseRegression, localLinearDirections):
            with pytest.raises(ValueError, match=message):
                estimate(*arguments)
    with pytest.raises(ValueError, match="slices is 1; it must be 2 to 6"):
        slicedInverseRegression(points, np.zeros(6), 1, slices=1)
    with pytest.raises(ValueError, match="at least 4 neighbours, got 3"):
        localLinearDirections(points, np.zeros(6), 1, neighbours=3)
