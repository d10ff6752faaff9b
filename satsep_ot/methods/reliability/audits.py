"""Wide runs: points of a normal law of larger spread, which look in all directions for failures nobody expects."""

from collections.abc import Callable

import numpy as np
from scipy.special import ndtri
from scipy.stats import qmc

from satsep_ot.methods.common.deferred_interrupts import deferredInterrupts

# Up to so many inputs points of a scrambled Sobol sequence, beyond them orthogonal pairs.
_SOBOL_INPUTS, _SOBOL_POINTS = 10, 256
# Points drawn at most for each one that is wanted.
_TRIALS = 20


class WideDesign:
    """Points that each follow N(0, I) and are spread more evenly than independent ones.

    Of 80 points a half-space with a share of 4 % is missed by 4 in 100 independent samples, by none of a scrambled
    Sobol sequence in 4 inputs and by 1 in 100 in 10, and by 1 in 100 of orthogonal pairs in 10 to 52 inputs.

    Parameters
    ----------
    dimension : int
        d.
    generator : :py:class:`numpy.random.Generator`

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.reliability.audits import WideDesign
    >>> design = WideDesign(20, np.random.default_rng(1))
    >>> u = design.draw(40, 2.0)
    >>> u.shape, bool(np.allclose(u[0], -u[20]))
    ((40, 20), True)
    """

    def __init__(self, dimension: int, generator: np.random.Generator) -> None:
        self._dimension, self._generator = dimension, generator
        # SciPy swallows an interrupt while it reads its table, which is half read then.
        with deferredInterrupts():
            self._sobol = qmc.Sobol(dimension, rng=generator) if dimension <= _SOBOL_INPUTS else None
        self._points = np.zeros((0, dimension))

    def draw(self, size: int, spread: float) -> np.ndarray:
        """The next points (size, d), times the spread."""
        while len(self._points) < size:
            self._points = np.vstack([self._points, self._more()])
        taken, self._points = self._points[:size], self._points[size:]
        return spread * taken

    def drawWhere(self, wanted: Callable[[np.ndarray], np.ndarray], size: int, spread: float) -> np.ndarray:
        """The next points (size, d), times the spread, of those that are wanted.

        Where few are wanted, the last of all points are taken for those that are missing.

        Parameters
        ----------
        wanted : callable
            Whether points (n, d) are wanted, (n,).
        size : int
        spread : float
        """
        taken = np.zeros((0, self._dimension))
        drawn = 0
        while len(taken) < size and drawn < _TRIALS * size:
            points = self.draw(2 * (size - len(taken)), spread)
            drawn += len(points)
            taken = np.vstack([taken, points[wanted(points)]])
        if len(taken) < size:
            taken = np.vstack([taken, points])
        return taken[:size]

    def _more(self):
        if self._sobol is not None:
            # Half of the spacing keeps the ends of the unit interval away.
            return ndtri(np.clip(self._sobol.random(_SOBOL_POINTS), 2.0**-31, 1.0 - 2.0**-31))
        d = self._dimension
        directions = np.linalg.qr(self._generator.standard_normal((d, d)))[0].T
        points = directions * np.sqrt(self._generator.chisquare(d, (d, 1)))
        return np.vstack([points, -points])


def auditSpread(probability: float) -> float:
    """Spread of wide runs that see a plane of the given probability about once in nine runs.

    Examples
    --------
    >>> from satsep_ot.methods.reliability.audits import auditSpread
    >>> round(auditSpread(1e-3), 2)
    2.85
    """
    index = -ndtri(min(max(probability, 1e-30), 0.4))
    return float(np.clip(1.0 + 0.6 * index, 1.5, 4.5))
