"""Quantities of interest as functions of what a run leaves behind."""

import numpy as np
import pytest
from separation_cases import TRUTH_CASES, truth_separation

from satsep_ot.dynamics.quantities import QUANTITIES
from satsep_ot.dynamics.simulation import simulate


@pytest.mark.parametrize("force_line", ["guided", "strut"])
@pytest.mark.parametrize("case", TRUTH_CASES)
def test_rates_of_the_truth_cases(case, force_line):
    """The tip-off rate is the size of all of the satellite's rate, the lateral rate and the spin are its parts."""
    outcome = simulate(truth_separation(case, force_line), tolerance=1e-12)
    x, y, z = np.degrees(TRUTH_CASES[case]["results"][force_line]["at_last_release"]["w_sat"])
    truth = {"tip_off_rate": np.sqrt(x**2 + y**2 + z**2), "lateral_rate": np.hypot(x, z), "spin": abs(y)}
    for name, value in truth.items():
        assert outcome.quantity(name)[0] == pytest.approx(value, rel=1e-9, abs=1e-9), name


@pytest.mark.parametrize("name", QUANTITIES)
def test_gradients_with_respect_to_the_base(name):
    quantity = QUANTITIES[name]
    values = np.random.default_rng(2).normal(size=(6, len(quantity.fields)))
    differences = np.zeros(values.shape)
    for column in range(values.shape[1]):
        step = 1e-6 * np.eye(values.shape[1])[column]
        differences[:, column] = (quantity.value(values + step) - quantity.value(values - step)) / 2e-6
    np.testing.assert_allclose(quantity.gradient(values), differences, rtol=1e-7, atol=1e-7)


@pytest.mark.parametrize("name", ["tip_off_rate", "lateral_rate", "spin", "lateral_velocity"])
def test_the_gradient_of_a_norm_at_0_is_a_subgradient(name):
    values = np.zeros((1, len(QUANTITIES[name].fields)))
    assert QUANTITIES[name].value(values) == 0.0
    assert not QUANTITIES[name].gradient(values).any()
