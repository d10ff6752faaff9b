"""The coefficients of both Runge-Kutta methods satisfy the order conditions (Hairer, Norsett, Wanner, section II.2)."""

import numpy as np
import pytest

from satsep_ot.dynamics.kernels.integration import EIGHTH_ORDER, FOURTH_ORDER, STAGE_NUMBER, STAGE_WEIGHTS, A, B, C


@pytest.mark.parametrize(("method", "order"), [(EIGHTH_ORDER, 8), (FOURTH_ORDER, 4)])
def test_order_conditions(method, order):
    number = int(STAGE_NUMBER[method])
    a, b, c = A[method, :number, :number], B[method, :number], C[method, :number]
    # An explicit method, whose stages are taken at the times of their nodes; nothing belongs to stages that are not.
    assert (np.triu(a) == 0.0).all()
    np.testing.assert_allclose(a.sum(axis=1), c, atol=1e-14)
    assert not B[method, number:].any()
    assert not C[method, number:].any()
    np.testing.assert_array_equal(STAGE_WEIGHTS[method, :-1], A[method])
    np.testing.assert_array_equal(STAGE_WEIGHTS[method, -1], B[method])
    # Bushy trees of each order, and all trees of order 4.
    for k in range(1, order + 1):
        assert b @ c ** (k - 1) == pytest.approx(1.0 / k, abs=1e-14)
    assert b @ a @ c == pytest.approx(1.0 / 6.0, abs=1e-14)
    assert (b * c) @ a @ c == pytest.approx(1.0 / 8.0, abs=1e-14)
    assert b @ a @ c**2 == pytest.approx(1.0 / 12.0, abs=1e-14)
    assert b @ a @ a @ c == pytest.approx(1.0 / 24.0, abs=1e-14)
