"""A requirement: a limit on one quantity of interest."""

from dataclasses import dataclass
from typing import Any

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
    center : float, optional
        Where given, the limit is on the distance ``|quantity - center|``: 0 for a limit on the absolute value, the
        middle of a range for a two-sided one.

    Examples
    --------
    >>> from satsep_ot.model.case import Requirement
    >>> print(Requirement("spin", "spin", 1.0, True))
    spin <= 1
    >>> print(Requirement("velocity", "axial_velocity", 0.05, True, center=0.6))
    0.55 <= axial_velocity <= 0.65
    """

    name: str
    quantity: str
    limit: float
    is_maximum: bool
    allowed_probability: float | None = None
    center: float | None = None

    def compared(self, value: Any) -> Any:
        """What is held against the limit, of a value of the quantity or an array of them."""
        return value if self.center is None else abs(value - self.center)

    def is_met(self, value: Any) -> Any:
        """Whether a value of the quantity, or each of an array, meets the requirement; the limit itself does."""
        return self.compared(value) <= self.limit if self.is_maximum else self.compared(value) >= self.limit

    @property
    def ends(self) -> tuple[float, ...]:
        """The values of the quantity on the limit."""
        if self.center is None:
            return (self.limit,)
        # Rounded as people have given them.
        return tuple(float(f"{self.center + side * self.limit:.12g}") for side in (-1.0, 1.0))

    def keys(self) -> dict[str, Any]:
        """The limit as the case file has it."""
        side = "maximum" if self.is_maximum else "minimum"
        if self.center is None:
            return {side: self.limit}
        return {f"{side}_absolute": self.limit} if self.center == 0.0 else {"between": list(self.ends)}

    def __str__(self) -> str:
        sign = "<=" if self.is_maximum else ">="
        if self.center is None:
            return f"{self.quantity} {sign} {self.limit:g}"
        if self.center == 0.0:
            return f"|{self.quantity}| {sign} {self.limit:g}"
        low, high = self.ends
        return f"{low:g} <= {self.quantity} <= {high:g}"
