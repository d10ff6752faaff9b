"""Wide runs: normal in every direction, and spread more evenly than independent points."""

import numpy as np
import pytest
from scipy import stats

from satsep_ot.methods.reliability.audits import WideDesign, auditSpread


@pytest.mark.parametrize("dimension", [1, 4, 10, 11, 40, 300])
def test_each_wide_point_is_standard_normal_times_the_spread(dimension):
    generator = np.random.default_rng(dimension)
    direction = np.ones(dimension) / np.sqrt(dimension)
    along, first, radius = [], [], []
    for _ in range(40):
        u = WideDesign(dimension, generator).draw(50, 2.5) / 2.5
        # One point of each design: these are independent.
        point = u[generator.integers(50)]
        along.append(point @ direction)
        first.append(point[0])
        radius.append(point @ point)
        assert np.isfinite(u).all()
    assert stats.kstest(along, "norm").pvalue > 1e-3
    assert stats.kstest(first, "norm").pvalue > 1e-3
    assert stats.kstest(radius, stats.chi2(dimension).cdf).pvalue > 1e-3


@pytest.mark.parametrize("dimension", [4, 10, 20, 52])
def test_a_half_space_is_missed_more_rarely_than_by_independent_points(dimension):
    # With a share of 4 % it is missed by 80 independent points in 0.96^80 = 3.8 % of cases.
    limit, generator, missed = stats.norm.isf(0.04), np.random.default_rng(1), 0
    for _ in range(300):
        u = WideDesign(dimension, generator).draw(80, 1.0)
        directions = generator.standard_normal((10, dimension))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        missed += np.count_nonzero((u @ directions.T).max(axis=0) < limit)
    assert missed / 3000 < 0.02


@pytest.mark.parametrize("dimension", [3, 12])
def test_parts_of_a_design_go_on_where_the_last_one_ended(dimension):
    whole = WideDesign(dimension, np.random.default_rng(0)).draw(40, 2.0)
    design = WideDesign(dimension, np.random.default_rng(0))
    parts = np.vstack([design.draw(7, 2.0), design.draw(0, 3.0), design.draw(33, 1.0)])
    np.testing.assert_allclose(np.vstack([parts[:7], 2.0 * parts[7:]]), whole)


def test_a_design_does_not_run_out():
    u = WideDesign(2, np.random.default_rng(0)).draw(1000, 1.0)
    assert u.shape == (1000, 2)
    assert len(np.unique(u, axis=0)) == 1000


def test_wide_runs_see_a_plane_of_the_expected_probability_about_once_in_nine():
    for probability in (1e-2, 1e-4, 1e-6):
        share = stats.norm.sf(stats.norm.isf(probability) / auditSpread(probability))
        assert 1.0 / 13.0 < share < 1.0 / 5.0
    # Whatever is asked, the spread stays within bounds.
    assert auditSpread(0.0) == 4.5
    assert auditSpread(1.0) == 1.5
    assert auditSpread(-1e-3) == 4.5
    spreads = [auditSpread(probability) for probability in np.logspace(-12, 0, 50)]
    assert (np.diff(spreads) <= 0.0).all()


def test_points_are_drawn_where_they_are_wanted():
    design = WideDesign(3, np.random.default_rng(0))
    u = design.drawWhere(lambda points: points[:, 0] > 0.5, 60, 2.0)
    assert u.shape == (60, 3)
    assert (u[:, 0] > 0.5).all()
    # Nowhere: the number stays.
    assert design.drawWhere(lambda points: np.zeros(len(points), dtype=bool), 60, 2.0).shape == (60, 3)
