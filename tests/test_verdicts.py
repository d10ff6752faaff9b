"""The verdict on a requirement: by an interval that is chosen beforehand, and by both where they do not overlap."""

import numpy as np
import pytest
from scipy import stats

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.studies.telling.verdicts import Verdict, best_row, contradiction, headline, judge, with_bound


def row(method, lower, upper, converged=True):
    return {
        "method": method, "probability": None if upper is None else 0.5 * (lower + upper), "lower95": lower,
        "upper95": upper, "converged": converged, "evaluations": 1000,
    }  # fmt: skip


ACTIVE = row("ActiveSubspace", 1.0e-3, 2.0e-3)
FORM = row("FORM", None, None)


@pytest.mark.parametrize(
    ("rows", "method"),
    [
        # Never by their widths: the narrower of two holds the truth less often than each does.
        ([row("MonteCarlo", 1.4e-3, 1.5e-3), FORM, ACTIVE], "ActiveSubspace"),
        ([row("MonteCarlo", 0.0, 5e-3), ACTIVE], "ActiveSubspace"),
        ([row("MonteCarlo", 0.0, 5e-3), {**ACTIVE, "converged": False}], "MonteCarlo"),
        ([row("MonteCarlo", 0.0, 5e-3), row("ActiveSubspace", None, None)], "MonteCarlo"),
        ([ACTIVE, FORM], "ActiveSubspace"),
        # SubsetSampling's interval, by its own account, is not one to judge by.
        ([row("SubsetSampling", 1e-3, 2e-3), FORM], None),
        ([], None),
    ],
)
def test_which_row_decides_is_settled_beforehand(rows, method):
    for order in (rows, rows[::-1]):
        best = best_row(iter(order))
        assert (best and best["method"]) == method


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
        rows = [{**ACTIVE, "method": "MonteCarlo"}, {**other, "method": "ActiveSubspace"}]
    verdict = judge("spin", rows, allowed)
    assert verdict.status == status
    assert verdict.sentence.startswith("The intervals of ActiveSubspace (")
    assert "do not overlap; taken together they reach from 1e-3 to 4e-3" in verdict.sentence
    assert verdict.row["method"] == "ActiveSubspace"
    assert "do not overlap" in judge("spin", rows).sentence


def test_an_estimate_that_did_not_converge_contradicts_nobody():
    assert contradiction([{**ACTIVE, "converged": False}, row("MonteCarlo", 3e-3, 4e-3)]) == ""
    assert judge("spin", [{**ACTIVE, "converged": False}, row("MonteCarlo", 3e-3, 4e-3)], 4e-3).status == "met"
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
        ([], "Only ActiveSubspace or MonteCarlo can decide, and none of them was run: nothing can be said. Run "
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
    assert judge("spin", rows, 1e-3) == ("spin", "no estimate", sentence, None)


def test_headlines_of_none_one_and_all():
    assert headline([]) == "The case has no requirements."
    met = Verdict("spin", "met", "", None)
    assert headline([met]) == "The requirement is met with 95 % confidence."
    assert headline([met, met]) == "Every requirement is met with 95 % confidence."


UNSEEN = (
    "the target was reached; a failure region of probability below 3.6e-02 that no run has pointed at is not excluded"
)


def test_what_a_surrogate_may_have_missed_is_bounded_where_it_is_called_met():
    crude = {**row("MonteCarlo", 5e-4, 4e-3), "evaluations": 20_000}
    assert "within the allowed 5e-3. 20,000 Monte Carlo runs" in judge("spin", [ACTIVE, crude], 5e-3).sentence
    assert judge("spin", [ACTIVE, crude], 5e-3).sentence.endswith("which need no surrogate, bound it by 4e-3.")
    assert judge("spin", [ACTIVE, crude], 3e-3).sentence.endswith(
        "bound it by 4e-3 only; more of them would show that none was missed."
    )
    assert judge("spin", [ACTIVE], 3e-3).sentence.endswith("MonteCarlo would bound it.")
    # Where it decides by itself, and where nothing is called met, there is nothing to add.
    assert judge("spin", [crude], 5e-3).sentence.endswith("within the allowed 5e-3.")
    assert judge("spin", [ACTIVE, crude], 1.5e-3).sentence.endswith("More runs can decide it.")
    assert with_bound(UNSEEN, [ACTIVE, crude]).endswith(
        "by these runs; 20,000 Monte Carlo runs bound the whole probability, any such region included, by 4e-3"
    )
    assert with_bound(UNSEEN, [ACTIVE]) == UNSEEN
    assert with_bound("the target was reached", [ACTIVE, crude]) == "the target was reached"
