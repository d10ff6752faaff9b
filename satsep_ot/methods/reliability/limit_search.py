"""Runs that find where failure begins: bisections, directions of steepest descent, chains of failures."""

import math
from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

from satsep_ot.methods.reliability.limit_state import LimitStateEvent
from satsep_ot.methods.reliability.recorder import RunRecorder

# Step of the differences of a gradient, in standard deviations.
_STEP = 0.02
# Candidates of a chain's step, and the share of failures that its step size aims at.
_CANDIDATES, _ACCEPTANCE = 3, 0.35
_GRADIENTS = 4  # of one search
# A region beyond a plane of less than this share of the probability does not matter, with a margin of its distance; of
# more planes in directions of their own than this number, they may be one curved limit, and matter.
_NEGLIGIBLE, _MARGIN, _FEW_PLANES, _SAME_DIRECTION = 0.01, 0.4, 3, 0.9


class LimitSearch:
    """Searches of the limit state from single points. All runs are true runs, counted in the phase ``"search"``.

    A point that gives no value, since the function fails there or is not finite, counts as safe in a search, unless the
    policy for such runs is ``"failure"``.

    Parameters
    ----------
    recorder : RunRecorder
    limitState : LimitStateEvent
    generator : :py:class:`numpy.random.Generator`

    Attributes
    ----------
    gradients : int
        Exact gradients that were asked for.
    """

    def __init__(self, recorder: RunRecorder, limitState: LimitStateEvent, generator: np.random.Generator) -> None:
        self._recorder = recorder
        self._limitState = limitState
        self._generator = generator
        self.gradients = 0

    def fails(self, u: np.ndarray) -> np.ndarray:
        """Whether points (n, d) fail, (n,); none where there are too few evaluations left to tell."""
        if self._recorder.remaining() < len(u):
            return np.zeros(len(u), dtype=bool)
        return self._recorder.explore(u, "search").failed

    def bisect(self, safe: np.ndarray, failing: np.ndarray, steps: int) -> np.ndarray:
        """A failing point between the two, nearer to the limit by a factor of two for each step."""
        for _ in range(steps):
            middle = 0.5 * (safe + failing)
            if self.fails(middle[None])[0]:
                failing = middle
            else:
                safe = middle
        return failing

    def steepestDescent(self, u: np.ndarray) -> np.ndarray | None:
        """Unit direction (d,) in which the limit state falls most at a failing point; None where it is flat, or where
        too few evaluations are left.

        By the function's exact gradient, or by forward differences. A difference across the limit, where another
        component may hold the value, is taken on the other side.
        """
        if self._recorder.remaining() < 2 * len(u) + 1:
            return None
        if self._limitState.hasExactGradient:
            here = self._recorder.explore(u[None], "search")
            slope = self._limitState.exactGradient(u, here.outputs[0])
            self.gradients += 1
            return _normalised(-slope)
        steps = _STEP * np.eye(len(u))
        runs = self._recorder.explore(np.vstack([u, u + steps]), "search")
        value, ahead = runs.margins[0], runs.margins[1:]
        slope = (ahead - value) / _STEP
        beyond = np.flatnonzero(~runs.failed[1:])
        if runs.failed[0] and len(beyond):
            behind = self._recorder.explore(u - steps[beyond], "search")
            slope[beyond] = np.where(behind.failed, (value - behind.margins) / _STEP, 0.0)
        return _normalised(-np.where(np.isfinite(slope), slope, 0.0))

    def descend(self, u: np.ndarray, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """A chain of failures from u towards where failures are likely.

        Preconditioned Crank-Nicolson moves (Cotter et al., Statistical Science 28, 2013) of which the nearest failing
        candidate is taken: a search more than a sample.

        Returns
        -------
        last : array (d,)
        failing : array (m, d)
            All failing points of the chain, u first.
        """
        d, size = len(u), 0.4
        current, failing = u, [u]
        for step in range(steps):
            noise = self._generator.standard_normal((_CANDIDATES, d))
            candidates = math.sqrt(1.0 - size**2) * current + size * noise
            failed = self.fails(candidates)
            size = min(max(size * math.exp(0.5 * (failed.mean() - _ACCEPTANCE)), 0.08), 0.8)
            if failed.any():
                failing += list(candidates[failed])
                nearest = _nearest(candidates[failed])
                if nearest @ nearest < current @ current or self._generator.random() < 0.5:
                    current = nearest
            if step > 4 and d > 10 and np.linalg.norm(current) < math.sqrt(d) + 1.0:
                break
        return current, np.array(failing)

    def approachDesignPoint(
        self, inside: np.ndarray, known: Callable[[np.ndarray], bool] | None = None
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Steps of Hasofer and Lind (Journal of the Engineering Mechanics Division 100, 1974) from a failing point near
        the limit, by bisections, so that any increasing function of the limit state gives the same.

        Parameters
        ----------
        inside : array (d,)
        known : callable, optional
            Whether a point (d,) is known: then there is nothing to look for, and it is what is returned.

        Returns
        -------
        inside : array (d,)
            A failing point near the limit, as near to the origin as was found.
        normals : list of array (d,)
            Directions of steepest descent on the way, the last one the latest; none where the limit state is flat.
        """
        d = len(inside)
        normals: list[np.ndarray] = []
        while len(normals) < _GRADIENTS:
            normal = self.steepestDescent(inside * (1.0 + _STEP / np.linalg.norm(inside)))
            if normal is None:
                break
            parallel = bool(normals) and float(normal @ normals[-1]) > 0.98
            normals.append(normal)
            distance = max(float(normal @ inside), 0.3)
            beyond = (distance + 0.25) * normal
            if known is not None and known(beyond):
                return beyond, normals
            if self.fails(beyond[None])[0]:
                inside = self.bisect(np.zeros(d), beyond, 6)
                if parallel or np.linalg.norm(inside) > distance - 0.1:
                    break
            else:
                if parallel:
                    break
                inside = self.bisect(beyond, inside, 6)
                if np.linalg.norm(inside - beyond) < 0.1:
                    break
        return inside, normals

    def designPoint(self, basis: np.ndarray, start: np.ndarray) -> np.ndarray:
        """The failing point nearest to the origin in a subspace, by random moves from a failing point of it.

        Parameters
        ----------
        basis : array (d, r)
            Orthonormal.
        start : array (d,)
        """
        origin = np.zeros(len(start))
        point, size = self.bisect(origin, start, 5), 0.5
        for _ in range(10):
            moves = size * self._generator.standard_normal((_CANDIDATES, basis.shape[1])) @ basis.T
            candidates = point + moves
            lengths = np.linalg.norm(candidates, axis=1)
            candidates *= np.minimum(1.0, (np.linalg.norm(point) - 0.02) / lengths)[:, None]
            failed = self.fails(candidates)
            if failed.any():
                point = self.bisect(origin, _nearest(candidates[failed]), 3)
            else:
                size *= 0.7
        return point


def isPlane(inside: np.ndarray, normals: list[np.ndarray]) -> bool:
    """Whether the last normal leads from the origin to the point (d,), as it does at a nearest failing point."""
    return bool(normals) and float(normals[-1] @ inside) > 0.9 * float(np.linalg.norm(inside)) - 0.15


class DistantPlanes:
    """Planes beyond which failures are too unlikely to matter.

    The limit of a region on many sides, such as outside of a sphere, has planes of little probability each: they are
    left only while they are few.
    """

    def __init__(self) -> None:
        self._normals: list[np.ndarray] = []

    def takes(self, inside: np.ndarray, normals: list[np.ndarray], probability: float) -> bool:
        """Whether a failing point (d,), reached with these normals, lies behind such a plane.

        Parameters
        ----------
        inside : array (d,)
        normals : list of array (d,)
        probability : float
            Of all failures that are known.
        """
        distance = float(np.linalg.norm(inside))
        if not isPlane(inside, normals) or ndtr(_MARGIN - distance) >= _NEGLIGIBLE * probability:
            return False
        if all(float(normal @ inside) < _SAME_DIRECTION * distance for normal in self._normals):
            self._normals.append(inside / distance)
        return len(self._normals) <= _FEW_PLANES


def orthonormalBasis(columns: list[np.ndarray], largest: int, least: float) -> np.ndarray:
    """Orthonormal basis (d, r) of vectors in their order, r at most ``largest``.

    A vector that lies in the span of those before it, but for a share of at most ``least`` of its length, is left out.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.reliability.limit_search import orthonormalBasis
    >>> orthonormalBasis([np.array([2.0, 0.0]), np.array([1.0, 0.1])], 2, 0.2)
    array([[1.],
           [0.]])
    """
    basis: list[np.ndarray] = []
    for column in columns:
        rest = column / np.linalg.norm(column)
        # Twice is enough.
        for _ in range(2):
            for direction in basis:
                rest = rest - (direction @ rest) * direction
        length = np.linalg.norm(rest)
        if length > least and len(basis) < largest:
            basis.append(rest / length)
    return np.column_stack(basis)


def _nearest(points):
    return points[np.argmin((points**2).sum(axis=1))]


def _normalised(vector):
    length = float(np.linalg.norm(vector))
    return vector / length if math.isfinite(length) and length > 0.0 else None
