"""The probability that any of many satellites violates a requirement, in words."""

import dataclasses
from collections.abc import Iterator

from satsep_ot.studies.telling.words import interval_text, probability_text


@dataclasses.dataclass(frozen=True)
class FleetEstimate:
    """The probability that any satellite of a fleet violates a requirement.

    Attributes
    ----------
    size : int
        Number of satellites.
    shared : tuple of str
        Inputs whose value all of them share.
    single : float
        Probability that one of them violates it.
    probability, lower95, upper95 : float
        That any of them does.
    independent : float
        What it would be without shared inputs.
    violating : float or None
        Mean number of satellites that violate it where any does; None without a violation.
    failures, runs : int
        Runs that violate it from which the dependence is known, and runs of the other satellites for it.
    """

    size: int
    shared: tuple[str, ...]
    single: float
    probability: float
    lower95: float
    upper95: float
    independent: float
    violating: float | None = None
    failures: int = 0
    runs: int = 0

    @property
    def sentence(self) -> str:
        """In words."""
        text = (
            f"any of {self.size} satellites: {probability_text(self.probability)} "
            f"({interval_text(self.lower95, self.upper95)}), one of them: {probability_text(self.single)}"
        )
        if not self.shared:
            return f"{text}; the satellites share no input"
        if self.violating is None:
            return f"{text}; no violation is known, so that the upper bound counts all satellites apart"
        return (
            f"{text}; without shared inputs it would be {probability_text(self.independent)}, and where any violates "
            f"it, {self.violating:.3g} do on average"
        )


def fleet_lines(fleet: dict[str, FleetEstimate]) -> Iterator[str]:
    """A line for each requirement."""
    for requirement, estimate in fleet.items():
        yield f"{requirement}: {estimate.sentence}."
