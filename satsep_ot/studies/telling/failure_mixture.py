"""The probability of a violation where parts may fail: its parts, and their sum in words and as a table."""

import dataclasses
from collections.abc import Iterator

from satsep_ot.studies.telling.words import interval_text, probability_text

ALL_PARTS = "all parts in order"


@dataclasses.dataclass(frozen=True)
class FailureMode:
    """What has failed, how probable that is, and the probability of a violation then.

    Attributes
    ----------
    failed : str
        "all parts in order", or the one part that has failed.
    weight : float
        Probability that exactly this has failed.
    probability, lower95, upper95 : float
        Of a violation then.
    runs, violations : int or None
        Of the simulator, and how many of them violate the requirement; None for the first mode, which a study knows.
    """

    failed: str
    weight: float
    probability: float
    lower95: float
    upper95: float
    runs: int | None = None
    violations: int | None = None


@dataclasses.dataclass(frozen=True)
class FailureMixture:
    """The probability of violating a requirement, failures of parts included.

    Attributes
    ----------
    modes : tuple of FailureMode
        All parts in order, then each single failure.
    omitted : float
        Probability that two or more parts fail; the upper bound counts all of it as violations.
    probability, lower95, upper95 : float
        The sum over the modes, with the interval of a sum of independent estimates (Zou and Donner, Statistics in
        Medicine 27, 2008).
    """

    modes: tuple[FailureMode, ...]
    omitted: float
    probability: float
    lower95: float
    upper95: float

    @staticmethod
    def of(modes: tuple[FailureMode, ...], omitted: float) -> "FailureMixture":
        """The sum over modes."""
        total = sum(mode.weight * mode.probability for mode in modes)
        below = sum((mode.weight * (mode.probability - mode.lower95)) ** 2 for mode in modes) ** 0.5
        above = sum((mode.weight * (mode.upper95 - mode.probability)) ** 2 for mode in modes) ** 0.5
        return FailureMixture(modes, omitted, total, max(total - below, 0.0), min(total + above + omitted, 1.0))

    @property
    def sentence(self) -> str:
        """The total in words."""
        first = self.modes[0]
        return (
            f"{probability_text(self.probability)} with failures of parts "
            f"({interval_text(self.lower95, self.upper95)}), {probability_text(first.probability)} with "
            f"{ALL_PARTS}; two or more failures, together {probability_text(self.omitted)}, are counted in the upper "
            "bound only"
        )


def mixture_lines(mixtures: dict[str, FailureMixture]) -> Iterator[str]:
    """A line for each requirement, and one for each single failure."""
    for requirement, mixture in mixtures.items():
        yield f"{requirement}: {mixture.sentence}."
        for mode in mixture.modes[1:]:
            share = mode.weight * mode.probability
            yield (
                f"  {mode.failed} has failed ({probability_text(mode.weight)}): {probability_text(mode.probability)} "
                f"({interval_text(mode.lower95, mode.upper95)}, {mode.runs:,} runs), adds {probability_text(share)}"
            )
