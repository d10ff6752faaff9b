"""Failure modes as densities: exact, whatever they have learnt, and in the directions that their failures show."""

import math

import numpy as np
import pytest
from scipy.stats import norm

from satsep_ot.methods.reliability.audits import WideDesign
from satsep_ot.methods.reliability.failure_modes import FailureMode, ModeProposal, explains, wideLogRatio
from satsep_ot.methods.reliability.mixture import GaussianMixture, normalLogDensity

TURNED = np.linalg.qr(np.random.default_rng(5).standard_normal((5, 5)))[0]


def planeMode(distance=3.0, direction=TURNED[:, 0]):
    return FailureMode.at(distance * direction, direction[:, None], compact=False)


def pairMode(compact=False):
    return FailureMode.at(3.0 * TURNED[:, 1], TURNED[:, 1:3], compact=compact)


def mergedMode():
    mode = planeMode()
    mode.merge(pairMode())
    return mode


def learntMode():
    """A mode of two directions that has learnt failures outside of a circle."""
    generator, mode = np.random.default_rng(2), pairMode()
    u = generator.standard_normal((40_000, 5))
    u = u[np.linalg.norm(u @ TURNED[:, 1:3], axis=1) > 2.5]
    mode.learn(u, np.full(len(u), 1.0 / 40_000), generator)
    return mode


def withPoint():
    mode = pairMode()
    mode.addPoint(2.0 * TURNED[:, 2])
    return mode


MODES = {
    "plane": planeMode,
    "two directions": pairMode,
    "compact": lambda: pairMode(compact=True),
    "merged": mergedMode,
    "learnt": learntMode,
    "with a point": withPoint,
    "near the origin": lambda: planeMode(0.01),
}


def weighted(logRatio, u, values):
    """Mean of values (n,) under the standard normal law, and its standard deviation, from points of a density."""
    terms = np.exp(-logRatio(u)) * values
    return terms.mean(), terms.std() / math.sqrt(len(u))


@pytest.mark.parametrize("make", MODES.values(), ids=MODES.keys())
def test_weights_of_a_mode_turn_its_points_into_standard_normal_ones(make):
    mode = make()
    u = mode.sample(40_000, np.random.default_rng(1))
    direction = mode.basis[:, 0]
    along, apart = u @ direction, u @ np.linalg.svd(mode.basis.T)[2][-1]
    for values, truth in (
        (np.ones(len(u)), 1.0),
        (along > 2.5, norm.sf(2.5)),
        (along < -1.0, norm.sf(1.0)),
        ((along > 2.0) * apart**2, norm.sf(2.0)),
    ):
        mean, deviation = weighted(mode.logRatio, u, values)
        assert abs(mean - truth) < 4.5 * deviation + 1e-12
        assert deviation < 0.1 * truth


def test_the_shell_is_the_standard_normal_law_beyond_a_radius():
    mode = pairMode()
    mode.shell, mode.radius = 1.0 - 1e-12, 2.0
    u = mode.sample(20_000, np.random.default_rng(1))
    radius = np.linalg.norm(u @ mode.basis, axis=1)
    assert radius.min() >= 2.0
    for r in (2.2, 3.0):
        share = math.exp(0.5 * (2.0**2 - r**2))
        assert abs((radius > r).mean() - share) < 4.0 * math.sqrt(share * (1.0 - share) / 20_000)
    # Its density knows the same: nothing inside, a constant outside.
    _, shell = mode.logDensities(u)
    np.testing.assert_allclose(shell, 2.0, rtol=1e-9)
    _, inside = mode.logDensities(np.zeros((1, 5)))
    assert inside[0] == -math.inf
    # A direction alone has no shell.
    assert planeMode().shell == 0.0


def test_a_mode_covers_what_is_beyond_its_plane():
    # The half-space that it was made for costs few runs, at any distance.
    for distance in (1.0, 3.0, 6.0):
        mode = planeMode(distance)
        assert mode.mass == pytest.approx(norm.sf(distance))
        u = mode.sample(4000, np.random.default_rng(0))
        mean, deviation = weighted(mode.logRatio, u, u @ TURNED[:, 0] > distance)
        assert abs(mean / norm.sf(distance) - 1.0) < 0.1
        assert deviation * math.sqrt(4000) < 2.5 * mean


def test_merged_modes_cover_the_limits_of_both():
    mode = mergedMode()
    # The directions of both, in one subspace.
    np.testing.assert_allclose(mode.basis @ mode.basis.T @ TURNED[:, :3], TURNED[:, :3], atol=1e-9)
    assert mode.mass == pytest.approx(2.0 * norm.sf(3.0))
    assert len(mode.points) == 2
    assert mode.young
    u = mode.sample(20_000, np.random.default_rng(0))
    for j in (0, 1):
        mean, deviation = weighted(mode.logRatio, u, u @ TURNED[:, j] > 3.0)
        assert deviation < 0.05 * mean
        assert abs(mean - norm.sf(3.0)) < 4.5 * deviation


def test_merging_keeps_to_the_largest_number_of_directions():
    d = 12
    modes = [FailureMode.at(3.0 * np.eye(d)[4 * k], np.eye(d)[:, 4 * k : 4 * k + 4], False) for k in range(3)]
    modes[0].merge(modes[1])
    modes[0].merge(modes[2])
    assert modes[0].basis.shape == (d, 5)
    u = modes[0].sample(20_000, np.random.default_rng(0))
    mean, deviation = weighted(modes[0].logRatio, u, np.ones(len(u)))
    assert abs(mean - 1.0) < 4.5 * deviation


def test_a_mode_is_young_until_it_has_failures_or_runs_in_vain():
    mode = planeMode()
    assert mode.young
    mode.given = 99
    assert mode.young
    mode.given = 100
    assert not mode.young
    mode.given, mode.effective = 0, 12.0
    assert not mode.young
    mode = withPoint()
    mode.effective, mode.given = 50.0, 500
    mode.addPoint(2.0 * TURNED[:, 2])
    # A new point is not known yet.
    assert mode.young


def test_learning_follows_the_failures():
    generator, mode = np.random.default_rng(0), planeMode()
    u = mode.sample(2000, generator)
    failed = u @ TURNED[:, 0] > 3.4
    weights = np.exp(-mode.logRatio(u)) / len(u)
    mode.learn(u[failed], weights[failed], generator)
    assert mode.mass == pytest.approx(norm.sf(3.4), rel=0.15)
    assert not mode.young
    assert mode.effective > 100
    assert mode.basis.shape == (5, 1)
    # What it draws now fails more often.
    again = mode.sample(2000, generator)
    assert (again @ TURNED[:, 0] > 3.4).mean() > failed.mean() + 0.05


def test_two_failures_teach_nothing():
    mode = planeMode()
    before = mode.mixture
    mode.learn(np.tile(3.5 * TURNED[:, 0], (2, 1)), np.full(2, 1e-3), np.random.default_rng(0))
    assert mode.mixture is before
    assert mode.mass == pytest.approx(norm.sf(3.0))
    assert mode.effective == pytest.approx(2.0)
    mode.learn(np.zeros((0, 5)), np.zeros(0), np.random.default_rng(0))
    assert mode.effective == 0.0


def curved(u):
    """The limit falls back on both sides of a direction."""
    return u @ TURNED[:, 0] - 2.5 - 0.8 * (u @ TURNED[:, 1]) ** 2


def shifted(u):
    """The plane is not the one that the mode was made for."""
    return u @ TURNED[:, 0] + 0.7 * u @ TURNED[:, 1] - 3.0


def narrow(u):
    """Failures are rare but near the plane of two directions."""
    return np.minimum(u @ TURNED[:, 0] - 2.5, 0.25 - np.abs(u @ TURNED[:, 1]))


@pytest.mark.parametrize("margin", [curved, shifted, narrow])
def test_failures_show_a_direction_that_the_mode_lacks(margin):
    generator = np.random.default_rng(0)
    u = generator.standard_normal((300_000, 5))
    u = u[margin(u) > 0.0][:400]
    mode = planeMode(2.5)
    mode.learn(u, np.full(len(u), 1e-5), generator)
    assert mode.basis.shape == (5, 2)
    np.testing.assert_allclose(mode.basis.T @ mode.basis, np.eye(2), atol=1e-9)
    assert np.linalg.norm(mode.basis.T @ TURNED[:, 1]) > 0.9
    assert mode.shell > 0.0
    points = mode.sample(20_000, generator)
    mean, deviation = weighted(mode.logRatio, points, np.ones(len(points)))
    assert abs(mean - 1.0) < 4.5 * deviation


def test_failures_of_a_plane_show_no_other_direction():
    generator = np.random.default_rng(0)
    direction, learnt = np.eye(30)[0], 0
    for _ in range(20):
        mode = planeMode(3.0, direction)
        u = generator.standard_normal((60, 30))
        u[:, 0] = 3.0 + generator.exponential(1.0 / 3.3, 60)
        mode.learn(u, np.full(60, 1e-5), generator)
        learnt += mode.basis.shape[1] - 1
    assert learnt <= 2


def test_the_proposal_of_modes_is_a_density():
    generator = np.random.default_rng(0)
    first, second = planeMode(), pairMode()
    second.mass = 0.1 * first.mass
    design = WideDesign(5, generator)
    proposal = ModeProposal([first, second], design, 2.5, 0.05, 0.2, generator)
    u, parts = proposal.sample(20_000, generator)
    counts = np.bincount(parts, minlength=4)
    np.testing.assert_allclose(counts / 20_000, proposal.shares, atol=1.1 / 20_000)
    np.testing.assert_allclose(proposal.shares[:2], [0.05, 0.2])
    # Both modes are young: each has a share that does not depend on its mass.
    np.testing.assert_allclose(proposal.shares[2:], 0.75 * np.array([1.0 / 1.1, 0.25]) / (1.0 / 1.1 + 0.25))
    truth = 1.0 - norm.cdf(3.0) ** 2
    failed = (u @ TURNED[:, 0] > 3.0) | (u @ TURNED[:, 1] > 3.0)
    mean, deviation = weighted(proposal.logRatio, u, failed)
    assert abs(mean - truth) < 4.5 * deviation
    mean, deviation = weighted(proposal.logRatio, u, np.ones(len(u)))
    assert abs(mean - 1.0) < 4.5 * deviation
    # No weight is larger than one over the nominal share.
    assert np.exp(-proposal.logRatio(u)).max() <= 20.0 * (1.0 + 1e-9)
    assert np.exp(-proposal.logRatio(5.0 * generator.standard_normal((500, 5)))).max() <= 20.0 * (1.0 + 1e-9)


def test_wide_runs_go_where_modes_do_not_explain_failures():
    generator, mode = np.random.default_rng(0), planeMode()
    proposal = ModeProposal([mode], WideDesign(5, generator), 2.5, 1e-9, 1.0 - 2e-9, generator)
    u = proposal.drawWide(4000)
    assert not explains([mode], u).any()
    assert explains([mode], 2.5 * generator.standard_normal((4000, 5))).mean() > 0.1
    # They still follow the density that their weights are by.
    mean, deviation = weighted(proposal.logRatio, u, u @ TURNED[:, 0] < -2.0)
    assert abs(mean - norm.cdf(-2.0)) < 4.5 * deviation


def test_a_mode_that_is_known_to_be_small_gets_few_runs_but_some():
    first, second = planeMode(), pairMode()
    for mode in (first, second):
        mode.effective = 50.0
    second.mass = 1e-9 * first.mass
    proposal = ModeProposal(
        [first, second], WideDesign(5, np.random.default_rng(0)), 2.0, 0.1, 0.1, np.random.default_rng(0)
    )
    np.testing.assert_allclose(proposal.shares[2:], 0.8 * np.array([1.0, 0.04]) / 1.04)


def test_a_proposal_stays_as_it_was_when_its_modes_learn():
    generator, mode = np.random.default_rng(0), planeMode()
    proposal = ModeProposal([mode], WideDesign(5, generator), 2.0, 0.1, 0.1, generator)
    u, _ = proposal.sample(500, generator)
    before = proposal.logRatio(u)
    failed = u @ TURNED[:, 0] > 3.2
    mode.learn(u[failed], np.exp(-before[failed]) / 500, generator)
    mode.merge(pairMode())
    mode.addPoint(2.0 * TURNED[:, 2])
    np.testing.assert_array_equal(proposal.logRatio(u), before)


def test_the_wide_density_is_that_of_its_points():
    u = np.array([[0.3, -1.2, 2.0]])
    wide = GaussianMixture(np.ones(1), np.zeros((1, 3)), 6.25 * np.eye(3)[None]).logDensity(u)
    np.testing.assert_allclose(wideLogRatio(u, 2.5), wide - normalLogDensity(u))
