"""Whether a requirement is met, in words, from a probability with its interval and the allowed probability."""

from collections.abc import Iterable, Sequence
from typing import NamedTuple

MET, NOT_MET, UNDECIDED, NO_ALLOWANCE, UNKNOWN = "met", "not met", "undecided", "no allowed probability", "no estimate"
# The methods whose intervals are relied on, the first one before the other.
_DECIDING = ("ActiveSubspace", "MonteCarlo")
TOO_RARE = "too rare to resolve with these runs"
NO_ESTIMATE = "the estimate failed"


class Verdict(NamedTuple):
    """What is known of one requirement.

    Attributes
    ----------
    requirement, status, sentence : str
        The status is one of "met", "not met", "undecided", "no allowed probability", "no estimate".
    row : dict or None
        The row of the table that it rests on.
    """

    requirement: str
    status: str
    sentence: str
    row: dict | None


def best_row(rows: Iterable[dict]) -> dict | None:
    """The row that others are judged by: that of ActiveSubspace if it has converged, else that of MonteCarlo.

    Chosen by name, not by its width: the narrower of two may hold the truth less often than each does.

    Parameters
    ----------
    rows : sequence of dict
        Of one requirement.

    Returns
    -------
    row : dict or None
        None where none of them has converged to a probability with an interval.

    Examples
    --------
    >>> from satsep_ot.studies.telling.verdicts import best_row
    >>> row = {"method": "MonteCarlo", "probability": 0.0, "lower95": 0.0, "upper95": 3e-5, "converged": True}
    >>> best_row([row])["upper95"]
    3e-05
    """
    return next(iter(_rows_with_interval(rows)), None)


def contradiction(rows: Iterable[dict]) -> str:
    """A sentence where the intervals of ActiveSubspace and MonteCarlo have no probability in common.

    Chance does that at most 1 time in 20 (1 in 180 where both are as wide); else one of them has missed failures.

    Parameters
    ----------
    rows : sequence of dict
        Of one requirement.

    Returns
    -------
    sentence : str
        Empty where they overlap or one of them is missing.

    Examples
    --------
    >>> from satsep_ot.studies.telling.verdicts import contradiction
    >>> row = {"method": "MonteCarlo", "lower95": 2e-3, "upper95": 3e-3, "converged": True}
    >>> other = {"method": "ActiveSubspace", "lower95": 1.2e-3, "upper95": 1.4e-3, "converged": True}
    >>> contradiction([row, other])
    'the intervals of ActiveSubspace (1.2e-3 to 1.4e-3) and MonteCarlo (2e-3 to 3e-3) do not overlap'
    """
    found = _rows_with_interval(rows)
    if len(found) < 2 or max(row["lower95"] for row in found) <= min(row["upper95"] for row in found):
        return ""
    texts = [f"{row['method']} ({digits(row['lower95'])} to {digits(row['upper95'])})" for row in found]
    return f"the intervals of {' and '.join(texts)} do not overlap"


def with_bound(note: str, rows: Iterable[dict]) -> str:
    """A remark on what a surrogate may have missed, with what Monte Carlo, which has none, says of it.

    Parameters
    ----------
    note : str
        Why ActiveSubspace ended.
    rows : sequence of dict
        Of the same requirement.

    Returns
    -------
    note : str
        Unchanged where nothing may have been missed or there is no interval of MonteCarlo.

    Examples
    --------
    >>> from satsep_ot.studies.telling.verdicts import with_bound
    >>> row = {"method": "MonteCarlo", "lower95": 0.0, "upper95": 1.5e-4, "converged": True, "evaluations": 20000}
    >>> note = "a failure region of probability below 3.6e-02 that no run has pointed at is not excluded"
    >>> print(with_bound(note, [row]).removeprefix(note))
     by these runs; 20,000 Monte Carlo runs bound the whole probability, any such region included, by 1.5e-4
    """
    crude = _monte_carlo_row(rows)
    if crude is None or not note.endswith("no run has pointed at is not excluded"):
        return note
    return (
        f"{note} by these runs; {crude['evaluations']:,} Monte Carlo runs bound the whole probability, any such region "
        f"included, by {digits(crude['upper95'])}"
    )


def _monte_carlo_row(rows):
    return next((row for row in _rows_with_interval(rows) if row["method"] == "MonteCarlo"), None)


def _missed(row, rows, allowed):
    """A sentence on failures that a surrogate may have missed where a requirement is said to be met."""
    if row["method"] == "MonteCarlo":
        return ""
    crude = _monte_carlo_row(rows)
    if crude is None:
        return " A failure region that none of its runs has pointed at is in neither number: MonteCarlo would bound it."
    upper = digits(crude["upper95"])
    text = f" {crude['evaluations']:,} Monte Carlo runs, which need no surrogate, bound it by {upper}"
    return f"{text}." if crude["upper95"] <= allowed else f"{text} only; more of them would show that none was missed."


def _why_unknown(rows):
    """What kept a requirement from an interval that can be relied on."""
    found = {row["method"]: row for row in rows if row["method"] in _DECIDING}
    texts = [
        f"{method} gave no probability"
        if row["upper95"] is None
        else f"{method} did not converge ({digits(row['lower95'])} to {digits(row['upper95'])})"
        for method, row in found.items()
    ]
    why = " and ".join(texts) or f"Only {' or '.join(_DECIDING)} can decide, and none of them was run"
    advice = " or ".join(method for method in _DECIDING if method not in found)
    return f"{why}: nothing can be said." + (f" Run {advice}." if advice else "")


def _rows_with_interval(rows):
    """The rows that may be judged by, the best one first."""
    found = {row["method"]: row for row in rows if row["upper95"] is not None and row["converged"]}
    return [found[method] for method in _DECIDING if method in found]


def is_resolved(now: dict | None, then: dict) -> bool:
    """Whether the estimate of a changed case says something of it.

    Parameters
    ----------
    now : dict or None
        The row that the requirement is judged by.
    then : dict
        A row of the changed case, with a probability.

    Returns
    -------
    resolved : bool
        False where its runs saw no violation, or did not converge to fewer violations, and their interval reaches
        further up than that of the case as it is: the lack of runs, not the change, has made it so wide.

    Examples
    --------
    >>> from satsep_ot.studies.telling.verdicts import is_resolved
    >>> now = {"probability": 5e-6, "lower95": 4e-6, "upper95": 6e-6, "converged": True}
    >>> is_resolved(now, {"probability": 0.0, "lower95": 0.0, "upper95": 4e-3, "converged": False})
    False
    """
    if now is None or then["upper95"] <= now["upper95"]:
        return True
    return then["probability"] > 0.0 and (then["converged"] or then["probability"] >= now["probability"])


def digits(probability: float) -> str:
    """A probability in three digits.

    Examples
    --------
    >>> from satsep_ot.studies.telling.verdicts import digits
    >>> digits(2.654e-4), digits(0.005), digits(0.0123), digits(0.0), digits(None)
    ('2.65e-4', '5e-3', '0.0123', '0', 'none')
    """
    if probability is None:
        return "none"
    if probability >= 0.01 or probability <= 0.0:
        return f"{probability:.3g}"
    mantissa, exponent = f"{probability:.2e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def in_words(probability: float) -> str:
    """A probability as a number of separations.

    Examples
    --------
    >>> from satsep_ot.studies.telling.verdicts import in_words
    >>> in_words(2.654e-4), in_words(0.3), in_words(0.0)
    ('about 1 separation in 3,800', '30 % of the separations', 'no separation of those tried')
    """
    if probability <= 0.0:
        return "no separation of those tried"
    if probability > 0.1:
        return f"{100.0 * probability:.3g} % of the separations"
    return f"about 1 separation in {float(f'{1.0 / probability:.2g}'):,.0f}"


def headline(verdicts: Sequence[Verdict]) -> str:
    """All verdicts in one sentence, the worst first.

    Parameters
    ----------
    verdicts : sequence of Verdict

    Returns
    -------
    text : str

    Examples
    --------
    >>> from satsep_ot.studies.telling.verdicts import Verdict, headline
    >>> headline([Verdict("spin", "met", "", None), Verdict("clearance", "not met", "", None)])
    'Not met: clearance. Met with 95 % confidence: spin.'
    """
    if not verdicts:
        return "The case has no requirements."
    groups = {}
    for verdict in verdicts:
        groups.setdefault(verdict.status, []).append(verdict.requirement)
    if list(groups) == [MET]:
        return f"{'Every' if len(verdicts) > 1 else 'The'} requirement is met with 95 % confidence."
    texts = {
        NOT_MET: "Not met: {}.",
        UNDECIDED: "Undecided with these runs: {}.",
        UNKNOWN: "Without an estimate: {}.",
        MET: "Met with 95 % confidence: {}.",
        NO_ALLOWANCE: "Without an allowed probability to compare with: {}.",
    }
    return " ".join(text.format(", ".join(groups[status])) for status, text in texts.items() if status in groups)


def judge(requirement: str, rows: Sequence[dict], allowed: float | None = None) -> Verdict:
    """The verdict on one requirement.

    Parameters
    ----------
    requirement : str
    rows : sequence of dict
        Of this requirement, as in results.json.
    allowed : float, optional
        Largest accepted probability of violation.

    Returns
    -------
    verdict : Verdict
        "met" only where the whole 95 % interval of `best_row` is at most the allowed probability, "not met" only where
        all of it is above. Where the intervals of ActiveSubspace and MonteCarlo do not overlap, both must be.

    Examples
    --------
    >>> from satsep_ot.studies.telling.verdicts import judge
    >>> row = {"method": "MonteCarlo", "probability": 2e-4, "lower95": 1e-4, "upper95": 4e-4, "converged": True}
    >>> judge("spin", [row], 1e-3).status, judge("spin", [row], 3e-4).status
    ('met', 'undecided')
    """
    row = best_row(rows)
    if row is None:
        return Verdict(requirement, UNKNOWN, _why_unknown(rows), None)
    lower, upper = row["lower95"], row["upper95"]
    known = f"{in_words(row['probability'])}; with 95 % confidence between {digits(lower)} and {digits(upper)}"
    known = known[0].upper() + known[1:]
    doubt = contradiction(rows)
    if doubt:
        found = _rows_with_interval(rows)
        lower, upper = min(one["lower95"] for one in found), max(one["upper95"] for one in found)
        known = f"{doubt[0].upper()}{doubt[1:]}; taken together they reach from {digits(lower)} to {digits(upper)}"
    if allowed is None:
        return Verdict(requirement, NO_ALLOWANCE, f"{known}. The case file names no allowed probability.", row)
    if upper <= allowed:
        missed = "" if doubt else _missed(row, rows, allowed)
        return Verdict(requirement, MET, f"{known}: all of it within the allowed {digits(allowed)}.{missed}", row)
    if lower > allowed:
        return Verdict(requirement, NOT_MET, f"{known}: all of it above the allowed {digits(allowed)}.", row)
    return Verdict(
        requirement, UNDECIDED, f"{known}: the allowed {digits(allowed)} lies within. More runs can decide it.", row
    )
