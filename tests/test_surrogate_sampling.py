"""Importance sampling by a learning surrogate: when it ends, what it does not explain, and what its proposals find."""

import math

import numpy as np
import pytest
from reliability_events import event, recorded
from scipy.special import ndtr
from scipy.stats import norm

from satsep_ot.methods.reliability.audits import WideDesign
from satsep_ot.methods.reliability.estimate import Estimate
from satsep_ot.methods.reliability.proposal import propose
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate
from satsep_ot.methods.reliability.surrogate_sampling import SurrogateSampling, Verdict

ROOT = np.array([0.6, 0.8, 0.0, 0.0])


def plane(u):
    return 3.0 - u @ ROOT


def samplingOf(evaluate, seed=0, dimension=4, target=0.05, maximum=2000, audits=80):
    """The sampling after the first runs, and the recorder of its runs."""
    limitState, recorder, generator = recorded(event(evaluate, dimension), maximum, seed)
    design = WideDesign(dimension, generator)
    recorder.evaluateNominal(8, "learning")
    recorder.explore(design.draw(6, 2.0), "exploration")
    return SurrogateSampling(recorder, limitState, generator, design, target, maximum, audits), recorder


def verdictOf(sampling, recorder):
    verdict = Verdict.GOES_ON
    while verdict is Verdict.GOES_ON and recorder.remaining() > 1:
        verdict = sampling.step()
    return verdict


@pytest.mark.parametrize("seed", range(3))
def test_a_plane_is_known_after_few_runs_and_all_wide_ones(seed):
    sampling, recorder = samplingOf(plane, seed)
    assert verdictOf(sampling, recorder) is Verdict.REACHED
    assert sampling.audited >= 80
    assert recorder.phases["estimation"] <= 80
    estimate = Estimate(sampling.blocks)
    assert len(sampling.blocks) >= 2
    assert estimate.coefficientOfVariation() <= 0.05
    assert estimate.probability == pytest.approx(norm.sf(3.0), rel=0.1)
    assert sampling.settled


def test_wide_runs_are_made_before_the_end_whatever_their_number():
    for audits in (0, 200):
        sampling, recorder = samplingOf(plane, audits=audits)
        assert verdictOf(sampling, recorder) is Verdict.REACHED
        assert sampling.audited >= audits
        assert sampling.audited == recorder.phases["audit"]


def test_a_mode_that_the_surrogate_has_not_learnt_ends_the_sampling():
    # Many inputs, of which wide runs are not learnt: a step that these show stays unexplained.
    def evaluate(u):
        return np.where(u[:, 2] < -4.0, -1.0, 3.0 - u[:, :2] @ [0.6, 0.8])

    sampling, recorder = samplingOf(evaluate, dimension=12)
    assert verdictOf(sampling, recorder) is Verdict.UNEXPLAINED
    assert not sampling.settled
    assert (sampling.failures()[:, 2] < -4.0).any()


def test_a_surrogate_that_has_the_limit_right_explains_its_hits():
    sampling, recorder = samplingOf(plane)
    assert verdictOf(sampling, recorder) is Verdict.REACHED
    # Failures that earlier surrogates did not expect: of the plane, the present one has the limit.
    sampling._hits = [np.array([2.5, 3.0, 0.5, 1.0]), np.array([3.5, 1.5, -2.0, 1.0])]
    assert not sampling.settled
    assert sampling.settle()
    assert sampling._hits == []


def test_a_surrogate_without_the_limit_does_not_explain_a_hit():
    def evaluate(u):
        return np.where(u[:, 2] < -9.0, -1.0, plane(u))

    sampling, recorder = samplingOf(evaluate)
    assert verdictOf(sampling, recorder) is Verdict.REACHED
    sampling._hits = [np.array([0.0, 0.0, -9.5, 0.0])]
    assert not sampling.settle()
    assert not sampling.settled


def test_a_surrogate_that_expects_failures_far_before_the_limit_does_not_explain_a_hit(monkeypatch):
    sampling, recorder = samplingOf(plane)
    assert verdictOf(sampling, recorder) is Verdict.REACHED
    monkeypatch.setattr(sampling, "_failure", lambda u: (u @ ROOT > 1.0).astype(float))
    sampling._hits = [np.array([2.5, 3.0, 0.5, 1.0])]
    assert not sampling.settle()


def test_a_hit_cannot_be_explained_without_runs():
    sampling, recorder = samplingOf(plane, maximum=300)
    assert verdictOf(sampling, recorder) is Verdict.REACHED
    recorder.explore(np.zeros((recorder.remaining() - 20, 4)), "other")
    sampling._hits = [np.array([2.5, 3.0, 0.5, 1.0])]
    assert not sampling.settle()
    assert recorder.remaining() == 20


def test_each_failure_is_a_hit_once():
    sampling, _ = samplingOf(plane)
    for rows in ([1, 2], [2, 3], [3]):
        sampling._noteHits(np.array(rows))
    assert len(sampling._hits) == 3


def test_a_function_without_failures_is_given_up_after_few_runs():
    sampling, recorder = samplingOf(lambda u: 60.0 - u[:, 0])
    assert verdictOf(sampling, recorder) is Verdict.NO_REGION
    assert recorder.used() < 100
    assert sampling.blocks == []


def test_the_end_needs_two_blocks_and_a_surrogate_that_agrees():
    sampling, recorder = samplingOf(plane)
    assert verdictOf(sampling, recorder) is Verdict.REACHED
    proposal = sampling._proposal
    estimate = Estimate(sampling.blocks)
    assert sampling._reaches(proposal)
    sampling.blocks, kept = sampling.blocks[-1:], sampling.blocks
    assert not sampling._reaches(proposal)
    sampling.blocks = kept
    # It has just learnt of twice as much.
    proposal.probability = 2.0 * estimate.probability
    assert not sampling._reaches(proposal)
    proposal.probability = estimate.probability
    sampling._target = 0.5 * estimate.coefficientOfVariation()
    assert not sampling._reaches(proposal)


def test_blocks_are_new_to_the_surrogate_that_proposed_them():
    sampling, recorder = samplingOf(plane, maximum=100)
    verdictOf(sampling, recorder)
    runs = recorder.runs()
    for block in sampling.blocks:
        rows = slice(block.start, block.start + block.size)
        np.testing.assert_array_equal(runs.u[rows], block.runs.u)
        assert (runs.phases[rows] == "estimation").all()
        assert block.known == block.start
        # The surrogate of the proposal was fitted to what was there before.
        assert len(block.proposal.surrogate._training[0]) <= block.start
        # What it said of each run, and the weight, are kept as they were.
        y = block.proposal.surrogate.reduce(block.runs.u)
        value, scale = block.proposal.surrogate.limitState(y)
        np.testing.assert_allclose(block.runs.expected, ndtr(-value / scale), atol=1e-9)
    # The recorder's own runs are worth nothing until an estimate marks them.
    assert np.isnan(runs.weights).all()


def test_wide_runs_go_where_the_surrogate_expects_no_failure():
    def ball(u):
        return 2.0 - np.linalg.norm(u, axis=1)

    sampling, _ = samplingOf(ball)
    while sampling.step() is Verdict.GOES_ON:
        pass
    runs = sampling._recorder.runs()
    wide = runs.phases == "audit"
    # Of runs that are so wide more than half would fail.
    assert wide.sum() >= 20
    assert runs.failed[wide].mean() < 0.3


@pytest.mark.parametrize("policy", ["failure", "safe"])
def test_runs_that_are_not_finite_count_by_their_policy_beside_the_surrogate(policy):
    sampling, _ = samplingOf(plane)
    np.testing.assert_array_equal(sampling._withNonFinite(np.array([0.0, 0.2])), [0.0, 0.2])
    limitState = sampling._limitState
    limitState.nonFinitePolicy, limitState.nonFiniteNumber = policy, 7
    # 7 of 14 runs.
    expected = [0.5, 0.6] if policy == "failure" else [0.0, 0.1]
    np.testing.assert_allclose(sampling._withNonFinite(np.array([0.0, 0.2])), expected)


def twoSides(both, seed=0):
    """Surrogate of a single limit, or of two opposite ones, by 200 runs."""
    u = np.random.default_rng(seed).standard_normal((200, 2)) * 1.8
    values = 3.0 - (np.abs(u[:, 0]) if both else u[:, 0]) + 0.05 * u[:, 1]
    return LimitStateSurrogate(u, values[:, None], lambda v: v[:, 0], np.ones(200))


def test_a_proposal_finds_a_region_that_the_surrogate_has_only_just_learnt():
    generator = np.random.default_rng(0)

    def proposalOf(surrogate, previous=None):
        return propose(surrogate, 0.3, generator, lambda failure: failure, previous)

    single = proposalOf(twoSides(False))
    assert single.probability == pytest.approx(norm.sf(3.0), rel=0.15)
    for previous in (None, single):
        both = proposalOf(twoSides(True), previous)
        assert both.probability == pytest.approx(2.0 * norm.sf(3.0), rel=0.25)
        points, _, weights = both.draw(4000, generator)
        for side in (1.0, -1.0):
            inside = side * points[:, 0] > 3.0
            assert inside.mean() > 0.1
            mean, deviation = (weights * inside).mean(), (weights * inside).std() / math.sqrt(4000)
            assert abs(mean - norm.sf(3.0)) < 4.5 * deviation + 0.05 * norm.sf(3.0)


def test_many_inputs_take_no_wide_runs_first_and_learn_nothing_from_them():
    sampling, recorder = samplingOf(lambda u: 3.0 - u[:, :25].sum(axis=1) / 5.0, dimension=30)
    assert verdictOf(sampling, recorder) is Verdict.REACHED
    runs = recorder.runs()
    wide = np.count_nonzero(runs.phases == "audit")
    assert wide >= 80
    assert len(sampling.surrogate._training[0]) == len(runs) - wide
