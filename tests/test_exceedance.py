"""Exceedance curves against a known law, and the numbers of tests without failures that the pages name."""

import re
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from satsep_ot.studies.exceedance import exceedance_curve

PAGE = Path(__file__).parents[1] / "docs" / "what-can-be-wrong.md"


@pytest.mark.parametrize("is_maximum", [True, False])
def test_the_band_holds_a_known_law_as_often_as_it_says(is_maximum):
    generator, held = np.random.default_rng(1), []
    for _ in range(100):
        curve = exceedance_curve(generator.standard_normal(500), is_maximum)
        truth = stats.norm.sf(curve.limits) if is_maximum else stats.norm.cdf(curve.limits)
        held.append((np.array(curve.lower95) <= truth) & (truth <= np.array(curve.upper95)))
        assert np.all(np.diff(curve.limits) > 0.0)
        assert min(curve.probabilities) == pytest.approx(1.0 / 500)
    # At least 95 % at each limit, and what 100 samples may lack of it in one of a thousand cases.
    assert np.mean(held) > 0.93
    assert np.mean(held, axis=0).min() > 0.95 - 3.1 * np.sqrt(0.95 * 0.05 / 100)


def test_a_limit_counts_as_met():
    # As many values lie beyond each limit as the share says, the limit itself not among them.
    values = np.random.default_rng(2).uniform(size=1000)
    curve = exceedance_curve(values)
    for limit, share in zip(curve.limits, curve.probabilities, strict=True):
        assert np.mean(values > limit) == pytest.approx(share)


def test_what_does_not_vary_or_is_not_finite_has_no_curve():
    assert exceedance_curve(np.full(10, 2.0)) is None
    assert exceedance_curve(np.array([1.0, np.nan])) is None
    assert exceedance_curve(np.empty(0)) is None


def test_the_numbers_of_tests_are_the_smallest_that_show_it():
    rows = re.findall(
        r"^\| ([\d.]+e-\d) \| ([\d,]+) \| ([\d,]+) \| ([\d,]+) \|$", PAGE.read_text(encoding="utf-8"), re.M
    )
    assert len(rows) == 4
    for probability, *numbers in rows:
        for failures, number in enumerate(int(text.replace(",", "")) for text in numbers):
            assert stats.binom.cdf(failures, number, float(probability)) <= 0.05
            assert stats.binom.cdf(failures, number - 1, float(probability)) > 0.05
