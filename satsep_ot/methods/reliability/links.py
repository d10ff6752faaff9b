"""Increasing links T with T(0) = 0: of a limit state only the sign matters, so T of it may be learnt in its place."""

import math
from typing import Protocol

import numpy as np


class Link(Protocol):
    """An increasing function that is 0 at 0."""

    def forward(self, values: np.ndarray) -> np.ndarray:
        """T of values (n,)."""

    def logSlope(self, values: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the derivative of T, with which densities are compared."""


class Identity:
    """The values themselves."""

    def forward(self, values: np.ndarray) -> np.ndarray:
        """The values (n,)."""
        return values

    def logSlope(self, values: np.ndarray) -> np.ndarray:
        """0 everywhere, (n,)."""
        return np.zeros(len(values))


class Compressed:
    """``asinh(g / scale)``: linear near the limit, logarithmic far from it.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.reliability.links import Compressed
    >>> Compressed(2.0).forward(np.array([0.0, 2.0])).round(3).tolist()
    [0.0, 0.881]
    """

    def __init__(self, scale: float) -> None:
        self._scale = scale

    def forward(self, values: np.ndarray) -> np.ndarray:
        """T of values (n,)."""
        return np.arcsinh(values / self._scale)

    def logSlope(self, values: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the derivative of T."""
        return -0.5 * np.log(values**2 + self._scale**2)


class Power:
    """``sign(g) ((1 + |g| / scale)^q - 1) / q``: a power far from the limit (Box and Cox, 1964, on both sides)."""

    def __init__(self, exponent: float, scale: float) -> None:
        self._exponent, self._scale = exponent, scale

    def forward(self, values: np.ndarray) -> np.ndarray:
        """T of values (n,)."""
        q = self._exponent
        return np.sign(values) * np.expm1(q * np.log1p(np.abs(values) / self._scale)) / q

    def logSlope(self, values: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the derivative of T."""
        return (self._exponent - 1.0) * np.log1p(np.abs(values) / self._scale) - math.log(self._scale)


def candidateLinks(values: np.ndarray) -> list[Link]:
    """The links that a limit state with these values (n,) is tried through."""
    sizes = np.abs(values)
    scale = float(np.median(sizes[sizes > 0.0])) if sizes.any() else 1.0
    return [Identity(), Compressed(scale), Power(1.0 / 3.0, scale)]
