"""How large the errors of a surrogate are against its own account of them."""

import numpy as np

# Squared standardised errors beyond this count as this; so many latest runs tell, or a quarter of all.
_LARGEST_SQUARE, _LATEST = 36.0, 30
# Runs that the first factor is worth, and what it may become.
_FIRST_FACTOR, _FIRST_RUNS, _LOWEST, _HIGHEST = 1.2, 4.0, 0.8, 5.0


class Calibration:
    """Factors on the errors of a surrogate's components, from runs that it predicted before it learnt them."""

    def __init__(self) -> None:
        self._squares: list[np.ndarray] = []
        self._weights: list[np.ndarray] = []

    def add(self, standardised: np.ndarray, weights: np.ndarray) -> None:
        """Standardised errors (n, p) of predictions, before any factor, and weights (n,)."""
        self._squares.append(standardised**2)
        self._weights.append(weights)

    def _latest(self):
        squares, weights = np.concatenate(self._squares), np.concatenate(self._weights)
        latest = max(_LATEST, len(weights) // 4)
        return np.minimum(squares[-latest:], _LARGEST_SQUARE), weights[-latest:]

    def factors(self) -> np.ndarray:
        """Factors (p,), or one (1,) for all before anything is known."""
        if not self._squares:
            return np.array([_FIRST_FACTOR])
        squares, weights = self._latest()
        factors = np.sqrt((_FIRST_RUNS + weights @ squares) / (_FIRST_RUNS + weights.sum()))
        return np.clip(factors, _LOWEST, _HIGHEST)

    def observed(self) -> float:
        """Root mean square of the latest standardised errors, 1 before any."""
        if not self._squares:
            return 1.0
        squares, weights = self._latest()
        return float(np.sqrt((weights @ squares).mean() / max(weights.sum(), 1e-300)))
