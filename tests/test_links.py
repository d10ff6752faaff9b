"""Links: increasing, 0 at 0, with the derivative that they claim, at any size of the values."""

import numpy as np
import pytest

from satsep_ot.methods.reliability.links import Compressed, Identity, Power, candidateLinks

LINKS = [Identity(), Compressed(2.0), Compressed(1e-9), Power(1.0 / 3.0, 0.5), Power(0.5, 1e6)]
NAMES = ["identity", "compressed", "compressed to 1e-9", "cube root", "square root"]


@pytest.mark.parametrize("link", LINKS, ids=NAMES)
def test_a_link_increases_and_keeps_the_sign(link):
    values = np.concatenate([-np.logspace(12, -12, 200), [0.0], np.logspace(-12, 12, 200)])
    linked = link.forward(values)
    assert (np.diff(linked) > 0.0).all()
    np.testing.assert_array_equal(np.sign(linked), np.sign(values))


@pytest.mark.parametrize("link", LINKS, ids=NAMES)
def test_the_slope_of_a_link_is_its_derivative(link):
    values = np.concatenate([-np.logspace(6, -3, 40), np.logspace(-3, 6, 40)])
    step = 1e-5 * np.abs(values)
    difference = (link.forward(values + step) - link.forward(values - step)) / (2.0 * step)
    np.testing.assert_allclose(link.logSlope(values), np.log(difference), atol=1e-5)


def test_the_candidates_follow_the_scale_of_the_values():
    values = np.random.default_rng(0).standard_normal(101)
    for scale in (1e-6, 1.0, 1e9):
        for link, scaled in zip(candidateLinks(values)[1:], candidateLinks(scale * values)[1:], strict=True):
            np.testing.assert_allclose(scaled.forward(scale * values), link.forward(values), rtol=1e-9)


def test_values_that_are_all_0_have_links():
    for link in candidateLinks(np.zeros(5)):
        np.testing.assert_array_equal(link.forward(np.zeros(5)), 0.0)
        assert np.isfinite(link.logSlope(np.zeros(5))).all()
