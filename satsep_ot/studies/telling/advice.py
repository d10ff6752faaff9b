"""Which tolerance to tighten, and what that buys."""

import dataclasses

from satsep_ot.studies.telling.results import HalvedTolerance, StudyResult
from satsep_ot.studies.telling.verdicts import Effect, Gain, best_estimate, compute_gain

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
        advice[requirement] = [
            Advice(
                name,
                result.tolerances[name].scatter,
                ratios.get(name),
                halves.get(name),
                compute_gain(now, halves[name]) if name in halves else Gain(Effect.UNKNOWN),
            )
            for name in dict.fromkeys([*list(ratios)[:_SHOWN], *halves])
        ]
    return {requirement: rows for requirement, rows in advice.items() if rows}


def best_advice(result: StudyResult, advice: dict[str, list[Advice]]) -> dict[str, Advice]:
    """The first advice for each requirement of which a violation is known and half of the tolerance was estimated."""
    best = {}
    for requirement, (first, *_) in advice.items():
        now = best_estimate(result.rows_of(requirement))
        if now is not None and now.probability and first.half and first.gain.effect is not Effect.NO_ESTIMATE:
            best[requirement] = first
    return best
