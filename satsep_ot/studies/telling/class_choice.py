"""Which class of each tolerance to order: what each class leaves, and the cheapest set that meets all limits."""

import dataclasses
from collections.abc import Iterator

from satsep_ot.studies.telling.tolerance_curves import CurvePoint
from satsep_ot.studies.telling.words import probability_text


@dataclasses.dataclass(frozen=True)
class ClassRow:
    """One class of one tolerance, with all other tolerances as the case file has them.

    Attributes
    ----------
    tolerance, label : str
    scale : float
        Its size over the size of the case file.
    price : float
    points : dict of str to CurvePoint
        By requirement, the probability of a violation.
    meets : bool
        Whether all limits are met with it.
    """

    tolerance: str
    label: str
    scale: float
    price: float
    points: dict[str, CurvePoint]
    meets: bool


@dataclasses.dataclass(frozen=True)
class ClassSet:
    """One class of each tolerance that has classes, and the probabilities then, by new runs."""

    labels: dict[str, str]
    price: float
    points: dict[str, CurvePoint]

    @property
    def text(self) -> str:
        """The classes in words."""
        return ", ".join(f"{name.replace('_', ' ')} {label}" for name, label in self.labels.items())


@dataclasses.dataclass(frozen=True)
class ClassChoice:
    """The cheapest set of classes that meets all limits.

    Attributes
    ----------
    limits : dict of str to float
        The allowed probabilities.
    rows : tuple of ClassRow
    sets, tested : int
        Sets of classes that there are, and that were tested by runs; the others are dearer than the one chosen, or at
        least as loose in each tolerance as one that fails.
    chosen : ClassSet or None
        Confirmed by new runs of their own. None where no set meets all limits.
    tightest : ClassSet or None
        The set of the tightest classes, where none meets all limits.
    """

    limits: dict[str, float]
    rows: tuple[ClassRow, ...]
    sets: int
    tested: int
    chosen: ClassSet | None = None
    tightest: ClassSet | None = None

    def lines(self) -> Iterator[str]:
        """What each class leaves, and what to order."""
        for row in self.rows:
            found = ", ".join(f"{name} {point.text}" for name, point in row.points.items())
            verdict = "meets all limits" if row.meets else "does not meet all limits"
            yield f"{row.tolerance.replace('_', ' ')} {row.label} (price {row.price:g}): {found}; {verdict} alone"
        for name in dict.fromkeys(row.tolerance for row in self.rows):
            if not any(row.meets for row in self.rows if row.tolerance == name):
                yield f"No class of {name.replace('_', ' ')} alone meets all limits."
        if self.chosen is not None:
            found = ", ".join(
                f"{name} {point.text} of {probability_text(self.limits[name])}"
                for name, point in self.chosen.points.items()
            )
            yield (
                f"The cheapest set of classes that meets all limits: {self.chosen.text}; price {self.chosen.price:g}. "
                f"Confirmed by new runs: {found}. {self.tested} of {self.sets} sets were tested."
            )
        elif self.tightest is not None:
            missed = ", ".join(
                f"{name} {point.text} of {probability_text(self.limits[name])}"
                for name, point in self.tightest.points.items()
                if not point.meets(self.limits[name])
            )
            yield f"No set of classes meets all limits: the tightest, {self.tightest.text}, leaves {missed}."
