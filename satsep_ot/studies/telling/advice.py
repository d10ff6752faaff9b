"""Which tolerance to tighten, and what that buys."""

import dataclasses
import math

from satsep_ot.studies.telling.results import HalvedTolerance, StudyResult
from satsep_ot.studies.telling.verdicts import Effect, Gain, Status, best_estimate, compute_gain, judge_all
from satsep_ot.studies.telling.words import interval_text, probability_text

# Tolerances of a requirement that are shown with a tenth less scatter.
_SHOWN = 5


@dataclasses.dataclass(frozen=True)
class Advice:
    """What tightening one tolerance does to the probability of violating a requirement.

    Attributes
    ----------
    tolerance : str
    scatter : str
        As it is now, in words.
    ratio : float or None
        Factor of the probability with a tenth less scatter; None where it is not known.
    half : HalvedTolerance or None
        The estimate with half of the scatter; None where it was not made.
    gain : Gain
        Of that estimate.
    """

    tolerance: str
    scatter: str
    ratio: float | None
    half: HalvedTolerance | None
    gain: Gain


def tightening_advice(result: StudyResult) -> dict[str, list[Advice]]:
    """What tightening each tolerance buys: for each requirement, the tolerance that buys most first.

    Parameters
    ----------
    result : StudyResult

    Returns
    -------
    advice : dict of str to list of Advice
        Without the requirements of which nothing is known.
    """
    advice = {}
    for requirement, halved in result.tightened.items():
        now = best_estimate(result.rows_of(requirement))
        ratios = result.ratios.get(requirement, {})
        halves = {row.tolerance: row for row in halved}
        rows = [
            Advice(
                name,
                result.tolerances[name].scatter,
                ratios.get(name),
                halves.get(name),
                compute_gain(now, halves[name]) if name in halves else Gain(Effect.UNKNOWN),
            )
            for name in dict.fromkeys([*list(ratios)[:_SHOWN], *halves])
        ]
        advice[requirement] = sorted(rows, key=_probability_of_half)
    return {requirement: rows for requirement, rows in advice.items() if rows}


def _probability_of_half(row):
    """By what half of the tolerance leaves; those of which it is not known keep their order behind the others."""
    known = row.half is not None and row.gain.is_resolved and row.half.probability is not None
    return row.half.probability if known else math.inf


def best_advice(result: StudyResult, advice: dict[str, list[Advice]]) -> dict[str, Advice]:
    """The first advice for each requirement of which a violation is known and half of the tolerance was estimated."""
    best = {}
    for requirement, (first, *_) in advice.items():
        now = best_estimate(result.rows_of(requirement))
        if now is not None and now.probability and first.half and first.gain.effect is not Effect.NO_ESTIMATE:
            best[requirement] = first
    return best


def advice_sentences(result: StudyResult) -> dict[str, str]:
    """By requirement, which tolerance buys most; a requirement that is met needs none, and the sentence says so.

    Parameters
    ----------
    result : StudyResult

    Returns
    -------
    sentences : dict of str to str
    """
    statuses = {verdict.requirement: verdict.status for verdict in judge_all(result)}
    sentences = {}
    for requirement, top in best_advice(result, tightening_advice(result)).items():
        name, half, now = top.tolerance.replace("_", " "), top.half, best_estimate(result.rows_of(requirement))
        if half is None or now is None:
            continue
        start = f"tighten {name} (now {top.scatter})."
        if statuses[requirement] is Status.MET:
            start = f"met, nothing has to be tightened. {name} (now {top.scatter}) would buy most."
        found = (
            f"The probability is now {probability_text(now.probability)}. With half of the scatter a violation is "
            f"{top.gain}."
        )
        if top.gain.is_resolved:
            doubt = "" if half.converged else " (not converged)"
            interval = interval_text(half.lower95, half.upper95)
            found = (
                f"Half of its scatter changes the probability from {probability_text(now.probability)} to "
                f"{probability_text(half.probability)} ({interval}): {top.gain}{doubt}."
            )
        sentences[requirement] = f"{start} {found}"
    return sentences
