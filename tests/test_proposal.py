"""Where runs of a surrogate go: pools, modes of components, the important region, and the selection among them."""

import math
from types import SimpleNamespace

import numpy as np
import openturns as ot
import pytest
from scipy.stats import norm

from satsep_ot.methods.reliability import proposal as proposals
from satsep_ot.methods.reliability.mixture import GaussianMixture, ModeMixture, fitImportantRegion
from satsep_ot.methods.reliability.proposal import Pool, Proposal, fitModes
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate


def test_pool_weights_integrate_exactly_whatever_the_selection():
    generator = np.random.default_rng(0)
    mixture = GaussianMixture(np.array([1.0]), np.full((1, 2), 2.0), np.eye(2)[None]).withDefence()
    pool = Pool.draw(mixture, 200_000, generator)
    truth = ot.DistFunc.pNormal(-2.0) ** 2
    inside = (pool.points > 2.0).all(axis=1)
    mean, variance = pool.expectation(inside.astype(float))
    assert abs(mean - truth) < 4.0 * math.sqrt(variance)
    probabilities = pool.selection([(0.5, np.ones(len(inside))), (0.5, np.abs(pool.points[:, 0])), (0.3, 0.0 * inside)])
    chosen, weights = pool.select(probabilities, 200_000, generator)
    terms = weights * inside[chosen]
    assert abs(terms.mean() - mean) < 4.0 * terms.std() / math.sqrt(len(terms))


def test_modes_in_subspaces_of_their_own_have_an_exact_density():
    generator = np.random.default_rng(0)
    bases = [np.eye(6)[:, [0]], np.linalg.qr(generator.standard_normal((6, 2)))[0]]
    mixtures = [
        GaussianMixture(np.array([1.0]), np.array([[3.0]]), np.array([[[0.3]]])),
        GaussianMixture(
            np.array([0.4, 0.6]), np.array([[2.0, 1.0], [-3.0, 0.0]]), np.array([np.eye(2), 0.5 * np.eye(2)])
        ),
    ]
    modes = ModeMixture(np.array([0.3, 0.7]), bases, mixtures)
    pool = Pool.draw(modes, 100_000, generator)
    # The weights turn the sample into a standard normal one, for any function.
    for h, truth in (
        (np.ones(100_000), 1.0),
        ((pool.points[:, 0] > 2.5).astype(float), ot.DistFunc.pNormal(-2.5)),
        (np.where(pool.points @ bases[1][:, 0] < -2.5, pool.points[:, 0] ** 2, 0.0), None),
    ):
        mean, variance = pool.expectation(h)
        if truth is None:
            a = bases[1][0, 0]
            tail = ot.DistFunc.pNormal(-2.5)
            truth = (1.0 - a**2) * tail + a**2 * (tail + 2.5 * ot.DistFunc.dNormal(2.5))
        assert abs(mean - truth) < 5.0 * math.sqrt(variance)
        assert math.sqrt(variance) < 0.1 * truth


def test_components_that_fail_together_are_a_group_and_the_modes_of_a_system_are_not():
    generator = np.random.default_rng(0)
    u = generator.standard_normal((300, 5))

    def margin(values):
        norm = np.hypot(values[:, 0], values[:, 1])
        return np.min([4.0 - norm, 3.0 - np.abs(values[:, 2]), 3.5 - values[:, 3]], axis=0)

    surrogate = LimitStateSurrogate(u, u[:, :4], margin, np.ones(300))
    assert surrogate.groups(generator) == [[0, 1], [2], [3]]
    part = surrogate.restricted([0, 1])
    assert part.dimension() == 2
    y = np.array([[4.1, 0.0], [1.0, 1.0]])
    np.testing.assert_allclose(part.limitState(y)[0], 4.0 - np.linalg.norm(y, axis=1), atol=0.05)
    assert LimitStateSurrogate(u, u[:, :3], lambda v: 2.0 - v.min(axis=1), np.ones(300)).groups(generator) == [
        [0, 1, 2]
    ]


def test_important_region_finds_both_modes_and_reports_none():
    generator = np.random.default_rng(0)
    mixture = fitImportantRegion(lambda y: (4.0 - np.abs(y[:, 0]), np.full(len(y), 0.05)), 3, generator)
    pool = Pool.draw(mixture, 50_000, generator)
    mean, variance = pool.expectation((np.abs(pool.points[:, 0]) > 4.0).astype(float))
    assert mean == pytest.approx(2.0 * ot.DistFunc.pNormal(-4.0), rel=0.05)
    assert math.sqrt(variance) < 0.03 * mean
    # All further than any number of levels reaches.
    assert fitImportantRegion(lambda y: (1e6 - y[:, 0], np.full(len(y), 1e-3)), 1, generator, maximumLevels=2) is None


def systemOf(*limits, size=300):
    """A surrogate of a series system of so many normal variables with these limits."""
    u = np.random.default_rng(0).standard_normal((size, len(limits) + 1))
    return LimitStateSurrogate(u, u[:, : len(limits)], lambda v: (np.array(limits) - v).min(axis=1), np.ones(size))


def modesOf(surrogate):
    return fitModes(surrogate, np.random.default_rng(0))


def proposalOf(surrogate):
    return proposals.propose(surrogate, 0.05, np.random.default_rng(0), lambda failure: failure)


def test_each_mode_of_a_system_has_runs_in_proportion_to_its_probability():
    limits = np.array([2.5, 3.0, 3.5, 4.5])
    surrogate, generator = systemOf(*limits), np.random.default_rng(0)
    modes = fitModes(surrogate, generator)
    shares = norm.sf(limits) / norm.sf(limits).sum()
    # One that the others hide gets a hundredth of the runs all the same.
    shares[3] = 0.01
    np.testing.assert_allclose(modes.shares, shares / shares.sum(), rtol=0.25)
    assert modes.shares.sum() == pytest.approx(1.0)
    for index, (basis, mixture) in enumerate(zip(modes.bases, modes.mixtures, strict=True)):
        direction = surrogate.directions @ basis
        np.testing.assert_allclose(np.abs(direction[:, 0]), np.eye(5)[index], atol=1e-9)
        # Nine tenths of a mode's points are beyond or near its limit.
        y = mixture.sample(2000, np.random.default_rng(1)) * direction[index, 0]
        assert 0.6 < (y > limits[index] - 0.5).mean() < 0.95
    proposal = proposals.propose(surrogate, 0.05, generator, lambda failure: failure)
    assert proposal.probability == pytest.approx(1.0 - norm.cdf(limits).prod(), rel=0.05)


@pytest.mark.parametrize(("number", "apart"), [(2, False), (3, False), (4, True)])
def test_only_more_than_three_directions_are_searched_mode_by_mode(monkeypatch, number, apart):
    asked = []
    monkeypatch.setattr(proposals, "fitModes", lambda surrogate, generator: asked.append(True))
    assert proposalOf(systemOf(*[3.0] * number)).probability == pytest.approx(number * norm.sf(3.0), rel=0.1)
    assert bool(asked) == apart


def test_components_that_fail_together_have_no_modes_of_their_own():
    surrogate = systemOf(3.0, 3.0, 3.0, 3.0)
    surrogate.margin = lambda v: 4.0 - np.linalg.norm(v, axis=1)
    assert modesOf(surrogate) is None


def test_modes_without_a_failure_region_are_left_out(monkeypatch):
    assert len(modesOf(systemOf(3.0, 3.2, 40.0, 3.4)).shares) == 3
    # A component that is constant has no direction to search along.
    u = np.random.default_rng(0).standard_normal((300, 6))
    values = np.column_stack([u[:, :3], np.ones(300)])
    surrogate = LimitStateSurrogate(u, values, lambda v: 3.0 - v.max(axis=1), np.ones(300))
    surrogate.groups = lambda generator: [[0], [1], [2], [3]]
    assert len(modesOf(surrogate).shares) == 3
    # Nor is one whose region is not found.
    found, fit = [], proposals.fitImportantRegion

    def missingTheFirst(*arguments, **options):
        found.append(fit(*arguments, **options) if found else None)
        return found[-1]

    monkeypatch.setattr(proposals, "fitImportantRegion", missingTheFirst)
    assert len(modesOf(systemOf(3.0, 3.2, 3.3, 3.4)).shares) == 3
    assert len(found) == 4


# The selection. ------------------------------------------------------------------------------------------------------


def linearProposal(limit, deviation=0.02, target=0.05, previous=None):
    """Where runs go whose surrogate is limit - y, known to a standard deviation."""
    surrogate = SimpleNamespace(
        dimension=lambda: 1,
        radial=False,
        knownFailures=None,
        directions=np.full((4, 1), 0.5),
        searchPoints=8000,
        largestPoolFactor=20.0,
        limitState=lambda y, exact=True: (limit - y[:, 0], np.full(len(y), deviation)),
    )
    return proposals.propose(surrogate, target, np.random.default_rng(0), lambda failure: failure, previous)


def test_what_a_run_of_a_proposal_is_worth():
    pool = Pool(np.zeros((4, 1)), np.array([1.0, 2.0, 1.0, 1.0]))
    failure, selection = np.array([1.0, 0.5, 0.0, 0.1]), np.array([0.3, 0.2, 0.4, 0.1])
    told = Proposal(None, None, pool, failure, 0.5, 0.0, selection)
    # Weights over four times the selection: 2.5 where the surrogate is at a half, 2.5 at a tenth.
    assert told.runVariance() == pytest.approx(0.2 * 2.5**2 * 0.25 + 0.1 * 2.5**2 * 0.09)


def test_runs_that_the_target_needs():
    def needed(poolVariance):
        told = Proposal(None, None, None, None, 1e-3, poolVariance, None)
        told.runVariance = lambda: 1.6e-7
        return told.runsNeeded(0.05)

    # (5 % of 1e-3)^2 - (3e-5)^2 = (4e-5)^2 is left for the runs.
    assert needed(9e-10) == pytest.approx(100.0)
    assert needed(25e-10) == math.inf


@pytest.mark.parametrize("limit", [1.0, 3.0, 6.0])
def test_no_run_of_a_proposal_weighs_more_than_twenty_nominal_ones(limit):
    found = linearProposal(limit)
    assert found.probability == pytest.approx(norm.sf(limit / math.hypot(1.0, 0.02)), rel=0.06)
    weights = found.pool.weights / (len(found.selection) * found.selection)
    assert weights.max() <= 20.0 * found.pool.weights.mean() * (1.0 + 1e-9)
    assert found.selection.sum() == pytest.approx(1.0)


def test_weights_of_the_selection_give_the_surrogate_its_own_probability():
    found = linearProposal(3.0)
    chosen, weights = found.pool.select(found.selection, 100_000, np.random.default_rng(1))
    terms = weights * found.failure[chosen]
    assert abs(terms.mean() - found.probability) < 4.0 * terms.std() / math.sqrt(len(terms))


def test_a_surrogate_that_is_sure_has_its_failures_confirmed_and_one_in_doubt_its_limit_learnt():
    shares = []
    for deviation in (0.001, 0.3):
        found = linearProposal(3.0, deviation)
        y = found.pool.points[:, 0]
        shares.append((found.selection[y > 3.0].sum(), found.selection[np.abs(y - 3.0) < 2.0 * deviation].sum()))
    (sure, _), (doubtful, near) = shares
    assert sure > 0.75
    assert doubtful < sure - 0.1
    assert near > 0.35


def test_the_pool_grows_with_the_target_up_to_a_bound(monkeypatch):
    monkeypatch.setattr(proposals, "_POOL_SIZE", 2000)
    sizes = []
    for target in (0.3, 0.02, 1e-6):
        found = linearProposal(3.0, target=target)
        sizes.append(len(found.selection))
        if target > 1e-3:
            # Its error is at most four tenths of the target.
            assert math.sqrt(found.poolVariance) <= 0.4 * target * found.probability
    assert sizes[0] == 2000 < sizes[1] < sizes[2] <= 40_000


def test_the_surrogate_of_the_rarest_events_has_no_floor():
    for limit in (6.45, 9.3, 12.0):
        assert linearProposal(limit).probability == pytest.approx(norm.sf(limit / math.hypot(1.0, 0.02)), rel=0.2)
    assert linearProposal(60.0) is None


def test_a_proposal_of_the_same_surrogate_follows_the_earlier_one():
    first = linearProposal(3.0)
    again = linearProposal(3.1, previous=first)
    assert again.probability == pytest.approx(norm.sf(3.1 / math.hypot(1.0, 0.02)), rel=0.06)
    # One that the earlier mixture does not reach is searched anew.
    far = linearProposal(7.0, previous=first)
    assert far.probability == pytest.approx(norm.sf(7.0 / math.hypot(1.0, 0.02)), rel=0.15)


def test_a_point_is_reached_where_it_is_drawn_a_hundredth_as_often_as_failures():
    """Failures of probability 1e-3 and a normal density around 3: exp(3 y - 4.5) 1e-3 is to be 0.01 or more."""
    surrogate = SimpleNamespace(reduce=lambda u: u[:, :1])
    mixture = GaussianMixture(np.ones(1), np.full((1, 1), 3.0), np.ones((1, 1, 1)))
    proposal = Proposal(surrogate, mixture, None, None, 1e-3, 0.0, None)
    y = (math.log(10.0) + 4.5) / 3.0
    assert proposal.reaches(np.array([[y - 0.1, 9.0], [y + 0.1, 0.0]])).tolist() == [False, True]


def test_a_proposal_that_follows_an_earlier_one_needs_no_search(monkeypatch):
    first = linearProposal(3.0)
    monkeypatch.setattr(proposals, "fitImportantRegion", lambda *arguments, **options: None)
    assert linearProposal(3.1) is None
    assert linearProposal(3.1, previous=first) is not None
