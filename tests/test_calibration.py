"""Factors on the errors of a surrogate."""

import math

import numpy as np
import pytest

from satsep_ot.methods.reliability.calibration import Calibration


def calibrationOf(*parts):
    calibration = Calibration()
    for part in parts:
        calibration.add(part, np.ones(len(part)))
    return calibration


def test_errors_scale_with_what_new_runs_show():
    assert Calibration().factors() == 1.2
    assert Calibration().observed() == 1.0
    ones = np.ones((96, 1))
    for errors, factor in ((ones, 1.0), (2.0 * ones, math.sqrt((4.0 + 4.0 * 96.0) / 100.0)), (0.0 * ones, 0.8)):
        calibration = calibrationOf(*[errors] * 4)
        assert calibration.factors() == pytest.approx([factor], rel=1e-6)
        assert calibration.observed() == pytest.approx(errors[0, 0])


def test_one_wild_run_is_not_the_whole_and_the_factor_has_bounds():
    assert calibrationOf(np.full((40, 1), 1e6)).factors()[0] == 5.0
    errors = np.ones((40, 1))
    errors[3] = 1e6
    assert calibrationOf(errors).factors()[0] < 1.5


def test_only_the_latest_runs_tell_of_the_present_surrogate():
    ones = np.ones((96, 1))
    assert calibrationOf(10.0 * ones, ones).factors() == pytest.approx([1.0])


def test_each_component_has_its_own_factor():
    errors = np.column_stack([np.ones(50), np.full(50, 3.0)])
    first, second = calibrationOf(errors).factors()
    assert first == pytest.approx(1.0)
    assert second > 2.5
