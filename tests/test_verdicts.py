"""The verdict on a requirement: by an interval that is chosen beforehand, and by both where they do not overlap."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.studies.telling.results import Estimate, HalvedTolerance
from satsep_ot.studies.telling.verdicts import (
    Status,
    Verdict,
    best_estimate,
    compute_gain,
    contradiction,
    headline,
    judge,
)
from satsep_ot.studies.telling.words import StudyMethod


def row(method, lower, upper, converged=True):
    probability = None if upper is None else 0.5 * (lower + upper)
    return Estimate("spin", StudyMethod(method), probability, lower, upper, evaluations=1000, converged=converged)


ACTIVE = row("ActiveSubspace", 1.0e-3, 2.0e-3)
FORM = row("FORM", None, None)


@pytest.mark.parametrize(
    ("rows", "method"),
    [
        # Never by their widths: the narrower of two holds the truth less often than each does.
        ([row("MonteCarlo", 1.4e-3, 1.5e-3), FORM, ACTIVE], "ActiveSubspace"),
        ([row("MonteCarlo", 0.0, 5e-3), ACTIVE], "ActiveSubspace"),
        ([row("MonteCarlo", 0.0, 5e-3), replace(ACTIVE, converged=False)], "MonteCarlo"),
        ([row("MonteCarlo", 0.0, 5e-3), row("ActiveSubspace", None, None)], "MonteCarlo"),
        ([ACTIVE, FORM], "ActiveSubspace"),
        # SubsetSampling's interval, by its own account, is not one to judge by.
        ([row("SubsetSampling", 1e-3, 2e-3), FORM], None),
        ([], None),
    ],
)
def test_which_row_decides_is_settled_beforehand(rows, method):
    for order in (rows, rows[::-1]):
        best = best_estimate(iter(order))
        assert (best and best.method) == method


@pytest.mark.parametrize(
    ("allowed", "status"),
    [(1e-2, "met"), (2e-3, "met"), (1.99e-3, "undecided"), (1e-3, "undecided"), (9.9e-4, "not met")],
)
def test_the_whole_interval_decides(allowed, status):
    assert judge("spin", [FORM, ACTIVE], allowed).status == status
    # A wider interval beside it that overlaps changes nothing.
    assert judge("spin", [ACTIVE, row("MonteCarlo", 0.0, 5e-3)], allowed).status == status
    assert contradiction([ACTIVE, row("MonteCarlo", 2e-3, 5e-3)]) == ""


@pytest.mark.parametrize(
    ("allowed", "status"),
    [(1e-2, "met"), (4e-3, "met"), (3e-3, "undecided"), (1.5e-3, "undecided"), (1e-3, "undecided"), (5e-4, "not met")],
)
@pytest.mark.parametrize("turned", [False, True])
def test_two_intervals_that_do_not_overlap_decide_together(allowed, status, turned):
    other = row("MonteCarlo", 3e-3, 4e-3)
    rows = [other, ACTIVE]
    if turned:
        rows = [replace(ACTIVE, method=StudyMethod.MONTE_CARLO), replace(other, method=StudyMethod.ACTIVE_SUBSPACE)]
    verdict = judge("spin", rows, allowed)
    assert verdict.status == status
    assert verdict.sentence.startswith("The intervals of ActiveSubspace (")
    assert "do not overlap; taken together they reach from 1e-3 to 4e-3" in verdict.sentence
    assert verdict.row.method == "ActiveSubspace"
    assert "do not overlap" in judge("spin", rows).sentence


def test_an_estimate_that_did_not_converge_contradicts_nobody():
    assert contradiction([replace(ACTIVE, converged=False), row("MonteCarlo", 3e-3, 4e-3)]) == ""
    assert judge("spin", [replace(ACTIVE, converged=False), row("MonteCarlo", 3e-3, 4e-3)], 4e-3).status == "met"
    assert judge("spin", [FORM], 4e-3).status == "no estimate"


def test_the_interval_of_monte_carlo_holds_the_truth_as_often_as_the_report_says():
    runs = 100_000
    counts = np.arange(100)
    lower, upper = np.array([clopperPearson(int(count), runs) for count in counts]).T
    expected = np.concatenate([np.linspace(0.01, 40.0, 2000), np.linspace(2.99, 3.5, 500)])
    probability = expected[:, None] / runs
    inside = (lower <= probability) & (probability <= upper)
    coverage = (stats.binom.pmf(counts, runs, probability) * inside).sum(axis=1)
    one_sided = (expected > 2.99) & (expected < 3.5)
    assert coverage[~one_sided].min() >= 0.95
    assert round(coverage[one_sided].min(), 3) == 0.938


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        ([], "Only ActiveSubspace or MonteCarlo can decide, and neither was run: nothing can be said. Run "
             "ActiveSubspace or MonteCarlo."),
        (
            [FORM, row("ActiveSubspace", 0.0, 3.53e-3, converged=False)],
            "ActiveSubspace did not converge (0 to 3.53e-3): nothing can be said. Run MonteCarlo.",
        ),
        (
            [row("ActiveSubspace", None, None, converged=False)],
            "ActiveSubspace gave no probability: nothing can be said. Run MonteCarlo.",
        ),
    ],
)  # fmt: skip
def test_why_nothing_can_be_said(rows, sentence):
    assert judge("spin", rows, 1e-3) == Verdict("spin", Status.UNKNOWN, sentence, None)


@pytest.mark.parametrize(
    ("estimate", "allowed", "sentence"),
    [
        (row("ActiveSubspace", 9e-4, 1.1e-3), 9.5e-4, "--precision 0.018."),
        (
            replace(row("MonteCarlo", 0.0, 3e-3), probability=0.0),
            1e-3,
            "About 3,000 runs without a violation would decide it",
        ),
        (row("MonteCarlo", 5e-4, 2e-3), 1.5e-3, "--runs "),
        (
            row("ActiveSubspace", 9e-4, 1.1e-3),
            1.001e-3,
            "may still leave it open, so near is the estimate: satsep-ot study case.toml --precision 0.01.",
        ),
    ],
)
def test_what_is_undecided_names_the_command_that_decides_it(estimate, allowed, sentence):
    verdict = judge("spin", [estimate], allowed)
    assert verdict.status == "undecided"
    assert sentence in verdict.sentence


def test_headlines_of_none_one_and_all():
    assert headline([]) == "The case has no requirements."
    met = Verdict("spin", Status.MET, "", None)
    assert headline([met]) == "The requirement is met with 95 % confidence."
    assert (
        headline([met, met])
        == "Each requirement is met with 95 % confidence; whether all are met at once was not computed."
    )


def test_no_violation_is_never_a_bare_zero_and_the_caution_is_not_in_each_verdict():
    none = replace(row("MonteCarlo", 0.0, 5.99e-6), probability=0.0, evaluations=500_000)
    sentence = judge("spin", [none], 1e-3).sentence
    known = "None in 500,000 runs; with 95 % confidence fewer than 1 in 160,000"
    assert sentence == f"{known}: within the allowed 1e-3."
    crude = replace(row("MonteCarlo", 5e-4, 4e-3), evaluations=20_000)
    for rows in ([ACTIVE, crude], [ACTIVE]):
        verdict = judge("spin", rows, 5e-3)
        assert verdict.sentence.endswith("within the allowed 5e-3.")
        assert verdict.is_plain
    assert not judge("spin", [ACTIVE, crude], 1.5e-3).is_plain


def test_gains_are_told_in_words():
    def now(probability, spread=1.1):
        bounds = probability / spread, probability * spread
        return Estimate("spin", StudyMethod.ACTIVE_SUBSPACE, probability, *bounds, converged=True)

    def then(probability, spread=1.1, converged=True, **changed):
        half = HalvedTolerance("mass", 0.5, probability, probability / spread, probability * spread, 10, converged)
        return replace(half, **changed)

    def gain(before, after):
        return str(compute_gain(before, after))

    assert gain(now(1e-3), then(2.5e-4)) == "4 times less"
    assert gain(now(1e-3), then(2e-3)) == "2 times more"
    assert gain(now(1e-3), then(1e-8)) == "more than 100 times less"
    assert gain(now(1e-3), then(9.5e-4)) == "no difference that these runs show"
    assert gain(now(1e-3), then(0.0)) == "no violation left in these runs"
    # Runs that end without an answer must not look like a worse case.
    assert gain(now(1e-3), then(0.0, upper95=1.09e-3)) == "no violation left in these runs"
    assert gain(now(1e-3), then(0.0, upper95=1.11e-3)) == "too rare to resolve with these runs"
    assert gain(now(1e-3), then(9e-4, 2.0, converged=False)) == "too rare to resolve with these runs"
    assert gain(now(1e-3), then(9e-4, 2.0)) == "no difference that these runs show"
    assert gain(now(1e-3), then(1.1e-3, 2.0, converged=False)) == "no difference that these runs show"
    assert gain(None, then(1e-3)) == ""
    assert gain(now(1e-3), HalvedTolerance("mass", 0.5, note="it failed")) == "the estimate failed"
