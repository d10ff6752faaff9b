"""Failure modes as densities to draw from: mixtures and shells in subspaces of their own, learnt from labels alone.

Only which runs fail is used, so that nothing depends on the scale of the function or on how steep it is: a mode that is
a thousand times as steep as another one, or flat but for a jump, is the same.
"""

import copy
import dataclasses
import math

import numpy as np
from scipy.special import ndtr
from scipy.stats import chi2

from satsep_ot.methods.reliability.audits import WideDesign
from satsep_ot.methods.reliability.limit_search import orthonormalBasis
from satsep_ot.methods.reliability.mixture import GaussianMixture, fitGaussianMixture, logSumExp, normalLogDensity

# Largest number of directions of a mode, at its birth and when its failures show more.
_LARGEST_RANK, _LARGEST_INFORMED_RANK = 5, 6
_LARGEST_MIXTURE = 16
# A mode is known once its failures are worth so many equal ones; one that has had so many runs in vain is none.
_KNOWN_FAILURES, _RUNS_IN_VAIN = 12.0, 100
# Smallest share of the runs of a mode that is known, and of one that is not.
_LEAST_SHARE, _YOUNG_SHARE = 0.04, 0.25
# Failures are explained where the modes draw as many as this share of the largest density over the nominal one.
_EXPLAINED = math.log(0.03)
# Points that tell how many wide ones are explained, and the share of others below which all are drawn.
_WIDE_POINTS, _LEAST_UNEXPLAINED = 4000, 0.1


@dataclasses.dataclass
class FailureMode:
    """A failure region as a density: in a subspace a Gaussian mixture and a shell, standard normal outside of it.

    The shell has all directions of the subspace alike and begins at the distance of the nearest known failure, so that
    a region on all sides, such as outside of a sphere, is covered.

    Attributes
    ----------
    basis : array (d, r)
        Orthonormal.
    mixture : GaussianMixture
        In r dimensions.
    radius : float
        Where the shell begins.
    shell : float
        Its share; 0 in one dimension.
    mass : float
        Probability of the failures that belong to the mode, as known so far.
    points : list of array (d,)
        Likeliest failing points that were found.
    effective : float
        Effective number of failures behind the mass.
    given : int
        Runs that were drawn for it.
    """

    basis: np.ndarray
    mixture: GaussianMixture
    radius: float
    shell: float
    mass: float
    points: list[np.ndarray]
    effective: float = 0.0
    given: int = 0

    @staticmethod
    def at(point: np.ndarray, basis: np.ndarray, compact: bool) -> "FailureMode":
        """The mode around a likeliest failing point (d,) in a subspace (d, r).

        Parameters
        ----------
        point : array (d,)
        basis : array (d, r)
        compact : bool
            The region ends in all directions of the subspace; else it is beyond a plane through the point.
        """
        z = basis.T @ point
        distance = max(float(np.linalg.norm(z)), 0.3)
        r = len(z)
        covariance = 0.4 * np.eye(r) if compact else _beyondPlane(z / distance, distance)
        mean = z * (1.0 + 1.0 / (distance * (distance + 1.0)))
        mixture = GaussianMixture(np.ones(1), mean[None], covariance[None]).withDefence()
        return FailureMode(
            basis, mixture, max(distance - 0.1, 0.2), 0.2 if r > 1 else 0.0, float(ndtr(-distance)), [basis @ z]
        )

    @property
    def young(self) -> bool:
        """Whether too little is known of it."""
        return self.effective < _KNOWN_FAILURES and self.given < _RUNS_IN_VAIN

    def logDensities(self, u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Logarithms (n,) of the densities of mixture and shell over the standard normal one."""
        z = u @ self.basis
        beyond = (z**2).sum(axis=1) >= self.radius**2
        shell = np.where(beyond, -chi2.logsf(self.radius**2, z.shape[1]), -np.inf)
        return self.mixture.logDensity(z) - normalLogDensity(z), shell

    def logRatio(self, u: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the density over the standard normal one."""
        mixture, shell = self.logDensities(u)
        if self.shell == 0.0:
            return mixture
        return np.logaddexp(math.log1p(-self.shell) + mixture, math.log(self.shell) + shell)

    def sample(self, size: int, generator: np.random.Generator) -> np.ndarray:
        """Independent points (size, d)."""
        d, r = self.basis.shape
        u = generator.standard_normal((size, d))
        z = self.mixture.sample(size, generator)
        rows = generator.random(size) < self.shell
        if rows.any():
            v = generator.standard_normal((int(rows.sum()), r))
            tail = generator.random(len(v)) * chi2.sf(self.radius**2, r)
            z[rows] = v * (np.sqrt(chi2.isf(tail, r)) / np.linalg.norm(v, axis=1))[:, None]
        return u + (z - u @ self.basis) @ self.basis.T

    def addPoint(self, point: np.ndarray) -> None:
        """Cover one more likeliest failing point (d,) of the same subspace."""
        z = self.basis.T @ point
        distance = max(float(np.linalg.norm(z)), 0.3)
        share = 1.0 / (len(self.points) + 1)
        self.mixture = GaussianMixture(
            np.append((1.0 - share) * self.mixture.weights, share),
            np.vstack([self.mixture.means, z * (1.0 + 1.0 / (distance * (distance + 1.0)))]),
            np.concatenate([self.mixture.covariances, _beyondPlane(z / distance, distance)[None]]),
        )
        self.points.append(self.basis @ z)
        self.radius = min(self.radius, max(distance - 0.1, 0.2))
        self.effective, self.given = 0.0, 0

    def merge(self, other: "FailureMode") -> None:
        """Take in another mode that belongs to the same limit: the subspace holds both."""
        basis = orthonormalBasis([*self.points, *other.points, *self.basis.T, *other.basis.T], _LARGEST_RANK, 0.25)
        weights, means, covariances = [], [], []
        for mode in (self, other):
            turned = basis.T @ mode.basis
            outside = np.eye(basis.shape[1]) * (1.0 + 1e-6) - turned @ turned.T
            weights.append(mode.mass * mode.mixture.weights)
            means.append(mode.mixture.means @ turned.T)
            covariances.append(turned @ mode.mixture.covariances @ turned.T + outside)
        joined = np.concatenate(weights)
        joined = np.maximum(joined, 1e-3 * joined.max())
        self.mixture = GaussianMixture(joined / joined.sum(), np.concatenate(means), np.concatenate(covariances))
        self.basis, self.radius = basis, min(self.radius, other.radius)
        self.shell = 0.3 if basis.shape[1] > 1 else 0.0
        self.mass += other.mass
        self.points += other.points
        self.effective, self.given = 0.0, 0

    def learn(self, u: np.ndarray, weights: np.ndarray, generator: np.random.Generator) -> None:
        """Follow weighted failures of the mode.

        Parameters
        ----------
        u : array (n, d)
            Points that have failed.
        weights : array (n,)
            Their sum is the probability of the mode.
        generator : :py:class:`numpy.random.Generator`
        """
        total = float(weights.sum())
        self.effective = total**2 / float((weights**2).sum()) if total > 0.0 else 0.0
        if self.effective < 3.0:
            return
        self.mass = total
        shares = weights / total
        self._inform(u, shares)
        r = self.basis.shape[1]
        if self.effective < 3.0 * (r + 1) + 4.0:
            return
        if r > 1:
            mixture, shell = self.logDensities(u)
            shell = math.log(self.shell) + shell
            belongs = np.exp(shell - np.logaddexp(math.log1p(-self.shell) + mixture, shell))
            self.shell = float(np.clip(shares @ belongs, 0.15, 0.85))
        z = u @ self.basis
        distances = np.linalg.norm(z, axis=1)
        order = np.argsort(distances)
        nearest = distances[order[np.searchsorted(np.cumsum(shares[order]), 0.01)]] - 0.02
        self.radius = max(min(nearest, self.radius + 0.1), 0.2)
        size = int(np.clip(1.5 * self.effective, 30.0, 800.0))
        components = max(1, min(int(self.effective / (4.0 * (r + 1))), _LARGEST_MIXTURE))
        chosen = generator.choice(len(u), size, p=shares)
        self.mixture = fitGaussianMixture(z[chosen], generator, components, 8).withDefence()

    def _inform(self, u, shares):
        """One direction more where the failures differ from the standard normal law outside of the subspace."""
        d, r = self.basis.shape
        free = d - r
        if free == 0 or r >= _LARGEST_INFORMED_RANK or self.effective < max(12.0, 0.4 * free):
            return
        outside = u - (u @ self.basis) @ self.basis.T
        mean = shares @ outside
        squared = float(mean @ mean)
        if squared > max((free + 4.0 * math.sqrt(2.0 * free)) / self.effective, 0.04):
            direction = mean / math.sqrt(squared)
        else:
            centred = outside - mean
            values, vectors = np.linalg.eigh((centred * shares[:, None]).T @ centred)
            # The directions of the subspace have no variance. The others lie within the edges of Marchenko and Pastur.
            values, vectors = values[r:], vectors[:, r:]
            noise = math.sqrt(free / self.effective)
            smallest = 0.75 * max(1.0 - noise, 0.0) ** 2 - 0.1 * noise
            if noise < 0.75 and values[0] < min(smallest, 0.6):
                direction = vectors[:, 0]
            elif values[-1] > max(1.3 * (1.0 + noise) ** 2, 1.5):
                direction = vectors[:, -1]
            else:
                return
        covariances = np.tile(np.eye(r + 1), (len(self.mixture.weights), 1, 1))
        covariances[:, :r, :r] = self.mixture.covariances
        shift = np.full(len(covariances), shares @ (u @ direction))
        self.basis = np.column_stack([self.basis, direction])
        self.mixture = GaussianMixture(self.mixture.weights, np.column_stack([self.mixture.means, shift]), covariances)
        self.shell = max(self.shell, 0.15)


def membership(modes: list[FailureMode], u: np.ndarray) -> np.ndarray:
    """Shares (n, number of modes) in which points (n, d) belong to the modes, by how often these draw them."""
    logs = np.column_stack([math.log(max(mode.mass, 1e-300)) + mode.logRatio(u) for mode in modes])
    return np.exp(logs - logSumExp(logs)[:, None])


def explains(modes: list[FailureMode], u: np.ndarray) -> np.ndarray:
    """Whether the modes draw failures at points (n, d) often enough, (n,)."""
    if not modes:
        return np.zeros(len(u), dtype=bool)
    logs = [mode.logRatio(u) + math.log(max(mode.mass, 1e-300)) for mode in modes]
    return np.max(logs, axis=0) > _EXPLAINED


class ModeProposal:
    """Density that a block of runs is drawn from: the inputs' own, a wide one, and all modes, as they are now.

    Wide runs go where the modes do not explain failures: beside them no other failure region could be seen.

    Weights are by the density of the whole (the balance heuristic: Veach and Guibas, SIGGRAPH 1995).

    Parameters
    ----------
    modes : list of FailureMode
    wideDesign : WideDesign
        Where the wide points come from.
    spread : float
        Their standard deviation.
    nominal, wide : float
        Shares of the runs that follow the inputs' distribution and the wide one.
    generator : :py:class:`numpy.random.Generator`
    """

    def __init__(
        self,
        modes: list[FailureMode],
        wideDesign: WideDesign,
        spread: float,
        nominal: float,
        wide: float,
        generator: np.random.Generator,
    ) -> None:
        self._modes = [copy.copy(mode) for mode in modes]
        self._wideDesign, self._spread = wideDesign, spread
        masses = np.array([mode.mass for mode in modes])
        least = [_YOUNG_SHARE if mode.young else _LEAST_SHARE for mode in modes]
        shares = np.maximum(masses / masses.sum(), least)
        self.shares = np.concatenate([[nominal, wide], (1.0 - nominal - wide) * shares / shares.sum()])
        points = spread * generator.standard_normal((_WIDE_POINTS, len(modes[0].basis)))
        self._unexplained = float(np.mean(~explains(self._modes, points)))

    def logRatio(self, u: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the density over the standard normal one."""
        wide = wideLogRatio(u, self._spread)
        if self._isRestricted:
            wide = np.where(explains(self._modes, u), -np.inf, wide - math.log(self._unexplained))
        columns = [np.zeros(len(u)), wide, *(mode.logRatio(u) for mode in self._modes)]
        return logSumExp(np.log(self.shares) + np.column_stack(columns))

    @property
    def _isRestricted(self):
        return self._unexplained > _LEAST_UNEXPLAINED

    def drawWide(self, size: int) -> np.ndarray:
        """Wide points (size, d)."""
        if self._isRestricted:
            return self._wideDesign.drawWhere(lambda u: ~explains(self._modes, u), size, self._spread)
        return self._wideDesign.draw(size, self._spread)

    def sample(self, size: int, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Points (size, d), and for each what it was drawn for: 0 nominal, 1 wide, from 2 on the modes."""
        # Numbers in proportion to the shares, the remainders at random.
        positions = (np.arange(size) + generator.random()) / size
        parts = np.minimum(np.searchsorted(np.cumsum(self.shares), positions), len(self.shares) - 1)
        u = generator.standard_normal((size, len(self._modes[0].basis)))
        u[parts == 1] = self.drawWide(int(np.count_nonzero(parts == 1)))
        for k, mode in enumerate(self._modes):
            rows = parts == k + 2
            u[rows] = mode.sample(int(np.count_nonzero(rows)), generator)
        return u, parts


def wideLogRatio(u: np.ndarray, spread: float) -> np.ndarray:
    """Logarithm (n,) of the density of N(0, spread^2 I) over the standard normal one."""
    return 0.5 * (u**2).sum(axis=1) * (1.0 - spread**-2) - u.shape[1] * math.log(spread)


def _beyondPlane(direction, distance):
    """Covariance of the standard normal law beyond a plane at a distance along a direction (r,)."""
    along = 1.0 / max(distance, 1.0) ** 2 + 0.05
    return np.eye(len(direction)) - (1.0 - along) * np.outer(direction, direction)
