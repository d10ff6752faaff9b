"""Prediction through powers keeps its digits, whichever way it goes."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.polynomials import prediction as polynomial_prediction
from satsep_ot.methods.polynomials.basis import PolynomialBasis
from satsep_ot.methods.polynomials.prediction import PolynomialPrediction

LAWS = [ot.Normal(), ot.Uniform(-1.0, 1.0), ot.Gamma(1.5, 1.0), ot.Beta(2.0, 3.0, 0.0, 1.0), ot.Gumbel()]


def recurrence_of(law, degree):
    family = ot.StandardDistributionPolynomialFactory(law)
    rows = np.array([list(family.getRecurrenceCoefficients(order)) for order in range(degree)])
    return rows, family.getMeasure()


def in_extended_precision(basis, points):
    """Values (size, n) of the basis with the recurrences in long double."""
    points = points.astype(np.longdouble)
    values = np.ones((basis.size, len(points)), dtype=np.longdouble)
    for variable, recurrence in enumerate(basis.recurrence.astype(np.longdouble)):
        x = points[:, variable]
        table = [np.ones_like(x), recurrence[0, 0] * x + recurrence[0, 1]]
        for a, b, c in recurrence[1:]:
            table.append((a * x + b) * table[-1] + c * table[-2])
        values *= np.array(table)[basis.indices[:, variable]]
    return values


@pytest.mark.parametrize("law", LAWS, ids=lambda law: law.getClassName())
@pytest.mark.parametrize(("degree", "tolerance"), [(4, 1e-14), (10, 1e-12)])
@pytest.mark.parametrize("horner", [False, True])
def test_error_is_as_stated(law, degree, tolerance, horner, monkeypatch):
    monkeypatch.setattr(polynomial_prediction, "HORNER_COEFFICIENTS", 1000 if horner else 0)
    random = np.random.default_rng(0)
    recurrence, measure = recurrence_of(law, degree)
    places = np.array([measure.computeQuantile(p)[0] for p in np.linspace(1e-4, 1.0 - 1e-4, 60)])
    basis = PolynomialBasis(2, degree, recurrence=np.array([recurrence] * 2))
    points = random.choice(places, (400, 2))
    coefficients = random.standard_normal((basis.size, 1))
    reference = in_extended_precision(basis, points)
    error = PolynomialPrediction(basis, coefficients).evaluate(points)[0] - coefficients[:, 0] @ reference
    assert (np.abs(error) <= tolerance * (np.abs(coefficients[:, 0]) @ np.abs(reference))).all()


@pytest.mark.parametrize("dimension", [0, 1, 2, 3, 5, 10])
@pytest.mark.parametrize("norm", [1.0, 0.5])
@pytest.mark.parametrize("outputs", [1, 3])
@pytest.mark.parametrize("block", [1, 1 << 17])
def test_every_way_agrees_with_the_basis(dimension, norm, outputs, block, monkeypatch):
    monkeypatch.setattr(polynomial_prediction, "BLOCK_NUMBERS", block)
    random = np.random.default_rng(1)
    recurrence = np.array([recurrence_of(LAWS[i % 5], 3)[0] for i in range(dimension)]).reshape(dimension, 3, 3)
    basis = PolynomialBasis(dimension, 3, norm, recurrence)
    coefficients = random.standard_normal((basis.size, outputs))
    points = random.uniform(0.1, 0.9, (600, dimension))
    centre, slope = random.uniform(-1.0, 1.0, dimension), random.uniform(0.5, 2.0, dimension)
    found = PolynomialPrediction(basis, coefficients, centre, slope).evaluate(points)
    np.testing.assert_allclose(found, coefficients.T @ basis.evaluate((points - centre) * slope), atol=1e-10)


def test_constant_and_wrong_shapes():
    constant = PolynomialPrediction(PolynomialBasis(2, 0), np.array([[3.0, 4.0]]))
    assert constant.evaluate(np.zeros((2, 2))).tolist() == [[3.0, 3.0], [4.0, 4.0]]
    with pytest.raises(ValueError, match=r"shape \(4,\); it must be \(n, 2\)"):
        constant.evaluate(np.zeros(4))
