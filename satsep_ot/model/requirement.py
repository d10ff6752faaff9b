"""A requirement: a limit on one quantity of interest."""

from dataclasses import dataclass

# The name under which the violation of any requirement is reported.
SYSTEM = "any requirement"


@dataclass(frozen=True)
class Requirement:
    """A limit on one quantity of interest.

    Parameters
    ----------
    name : str
        How people call it.
    quantity : str
        Name of the quantity of interest.
    limit : float
        In the quantity's unit.
    is_maximum : bool
        True if the quantity must not exceed the limit, False if it must not fall below it.
    allowed_probability : float, optional
        Largest probability of violation that is accepted.

    Examples
    --------
    >>> from satsep_ot.model.case import Requirement
    >>> print(Requirement("spin", "spin", 1.0, True))
    spin <= 1
    """

    name: str
    quantity: str
    limit: float
    is_maximum: bool
    allowed_probability: float | None = None

    def is_met(self, value: float) -> bool:
        """Whether a value of the quantity meets the requirement; the limit itself does."""
        return value <= self.limit if self.is_maximum else value >= self.limit

    def __str__(self) -> str:
        return f"{self.quantity} {'<=' if self.is_maximum else '>='} {self.limit:g}"
