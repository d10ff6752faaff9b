"""The probability of a violation against the size of a tolerance: curves, in words and as a table."""

import dataclasses
import enum
from collections.abc import Iterator, Sequence

from satsep_ot.studies.telling.words import capitalized, interval_text, probability_text


class Curves(enum.StrEnum):
    """Which curves a study makes new runs for; without these, its runs are only re-weighted, where they carry that."""

    NEEDED = "needed"
    ALL = "all"
    NONE = "none"


@dataclasses.dataclass(frozen=True)
class CurvePoint:
    """The probability of a violation with the scatter of tolerances scaled.

    Attributes
    ----------
    scale : float
        1 for the scatter of the case file.
    probability, lower95, upper95 : float or None
        None where no estimate could be made.
    runs : int
        New runs of the simulator; 0 where runs of the study were re-weighted.
    converged : bool
    """

    scale: float
    probability: float | None
    lower95: float | None
    upper95: float | None
    runs: int = 0
    converged: bool = True

    def meets(self, allowed: float) -> bool:
        """Whether the whole interval is at most the allowed probability."""
        return self.upper95 is not None and self.converged and self.upper95 <= allowed

    @property
    def text(self) -> str:
        """Probability and interval."""
        return f"{probability_text(self.probability)} ({interval_text(self.lower95, self.upper95)})"


@dataclasses.dataclass(frozen=True)
class ToleranceCurve:
    """The probability of violating a requirement against the size of one tolerance.

    Attributes
    ----------
    tolerance : str
    points : tuple of CurvePoint
        In the order of their scales.
    loosest : CurvePoint or None
        The loosest size that is known to meet the allowed probability, to about 5 %: confirmed by new runs where it has
        any. None where no size does, or none is allowed.
    """

    tolerance: str
    points: tuple[CurvePoint, ...]
    loosest: CurvePoint | None = None


@dataclasses.dataclass(frozen=True)
class TolerancePair:
    """Two tolerances whose scatter is scaled together, and the probability then, by new runs."""

    tolerances: tuple[str, ...]
    point: CurvePoint


@dataclasses.dataclass(frozen=True)
class RequirementCurves:
    """What the size of each of the strongest tolerances does to the probability of violating a requirement.

    Attributes
    ----------
    allowed : float or None
        Allowed probability.
    is_met : bool
        Whether it is met with the scatter of the case file: no advice is needed then.
    curves : tuple of ToleranceCurve
    pair : TolerancePair or None
        Where no size of one tolerance meets the allowed probability, the pair that does.
    has_searched_pairs : bool
        Whether pairs were tried.
    """

    allowed: float | None
    is_met: bool
    curves: tuple[ToleranceCurve, ...]
    pair: TolerancePair | None = None
    has_searched_pairs: bool = False

    def sentences(self) -> Iterator[str]:
        """What sizes meet the allowed probability."""
        if self.allowed is None:
            return
        for curve in self.curves:
            # Without a larger size that is known nothing can be said of a requirement that is met.
            if not curve.points or (self.is_met and (curve.loosest is None or curve.loosest.scale <= 1.0)):
                continue
            name, least, most = _words(curve.tolerance), curve.points[0], curve.points[-1]
            if curve.loosest is not None:
                confirmed = f", confirmed by {curve.loosest.runs:,} new runs" if curve.loosest.runs else ""
                bound = "at least " if curve.loosest.scale >= most.scale else ""
                verb = "may grow to" if self.is_met else "has to be at most"
                yield (
                    f"{capitalized(name)} {verb} {bound}{curve.loosest.scale:.2g} times its size alone: "
                    f"{curve.loosest.text}{confirmed}."
                )
            elif not self.is_met and least.probability is not None:
                yield f"No size of {name} alone meets it: {least.scale:g} times its size leaves {least.text}."
        if self.pair is not None:
            names = " and ".join(map(_words, self.pair.tolerances))
            yield (
                f"No size of one tolerance meets it, but {names} together at {self.pair.point.scale:.2g} times their "
                f"sizes do: {self.pair.point.text}, by {self.pair.point.runs:,} new runs."
            )
        elif self.has_searched_pairs:
            yield "No pair of these tolerances meets it either, down to 0.3 times their sizes."


def curve_lines(curves: dict[str, RequirementCurves]) -> Iterator[str]:
    """A line for each sentence on each requirement."""
    for requirement, found in curves.items():
        for sentence in found.sentences():
            yield f"{requirement}: {sentence}"


def curve_rows(found: RequirementCurves) -> list[tuple[str, Sequence[str]]]:
    """By tolerance, its points in words: scale, probability with interval, and how it is known."""
    return [
        (
            curve.tolerance,
            [
                f"{point.scale:g} times: {point.text}, {f'{point.runs:,} new runs' if point.runs else 're-weighted'}"
                for point in curve.points
            ],
        )
        for curve in found.curves
    ]


def _words(name):
    return name.replace("_", " ")
