"""Gaussian mixtures that cover the region where a cheap score says that failures are, in a few active directions.

A mixture is fitted to the important region by the improved cross-entropy method (Papaioannou, Geyer and Straub,
Reliability Engineering and System Safety 191, 2019); it costs cheap score evaluations only.
"""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from scipy.special import log_ndtr

_LOG_2PI = math.log(2.0 * math.pi)
# Share of the pool that is drawn from the standard normal itself, and from the widened mixture: they bound the weights.
_NOMINAL_SHARE = 0.1
_WIDE_SHARE = 0.15
# Points of each level, and those that a mixture is fitted to.
_LEARNING_POINTS, _FITTING_POINTS = 8000, 1200
_BLOCK = 4096  # points


def normalLogDensity(y: np.ndarray) -> np.ndarray:
    """Logarithm of the standard normal density of the rows of y."""
    return -0.5 * (y**2).sum(axis=1) - 0.5 * y.shape[1] * _LOG_2PI


def logSumExp(logs: np.ndarray) -> np.ndarray:
    """Logarithm of the sum of exponentials of each row."""
    largest = logs.max(axis=1)
    return largest + np.log(np.exp(logs - largest[:, None]).sum(axis=1))


class GaussianMixture:
    """Mixture of normal densities.

    Parameters
    ----------
    weights : array (K,)
        Positive, of sum 1.
    means : array (K, k)
    covariances : array (K, k, k)

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.reliability.mixture import GaussianMixture
    >>> mixture = GaussianMixture(np.array([1.0]), np.zeros((1, 2)), np.eye(2)[None])
    >>> round(float(mixture.logDensity(np.zeros((1, 2)))[0]), 6)
    -1.837877
    """

    def __init__(self, weights: np.ndarray, means: np.ndarray, covariances: np.ndarray) -> None:
        self.weights = weights
        self.means = means
        self.covariances = covariances
        self.factors = np.linalg.cholesky(covariances)
        self._inverses = np.linalg.inv(self.factors)

    def logComponents(self, y: np.ndarray) -> np.ndarray:
        """Logarithms of weight times density, (n, K)."""
        columns = []
        for weight, mean, factor, inverse in zip(self.weights, self.means, self.factors, self._inverses, strict=True):
            z = (y - mean) @ inverse.T
            constant = math.log(weight) - np.log(np.diag(factor)).sum() - 0.5 * len(mean) * _LOG_2PI
            columns.append(constant - 0.5 * np.einsum("ij,ij->i", z, z))
        return np.column_stack(columns)

    def logDensity(self, y: np.ndarray) -> np.ndarray:
        """Logarithm of the density, (n,)."""
        logs = np.empty(len(y))
        # The components of all points at once can take hundreds of MiB.
        for start in range(0, len(y), _BLOCK):
            rows = slice(start, start + _BLOCK)
            logs[rows] = logSumExp(self.logComponents(y[rows]))
        return logs

    def sample(self, size: int, generator: np.random.Generator) -> np.ndarray:
        """Independent points, (size, k)."""
        which = generator.choice(len(self.weights), size=size, p=self.weights)
        noise = generator.standard_normal((size, self.means.shape[1]))
        return self.means[which] + np.einsum("nij,nj->ni", self.factors[which], noise)

    def withDefence(self) -> "GaussianMixture":
        """This mixture, a widened copy of it and the standard normal: no weight can be larger than 1 over its share."""
        k = self.means.shape[1]
        return GaussianMixture(
            np.concatenate(
                [
                    (1.0 - _NOMINAL_SHARE - _WIDE_SHARE) * self.weights,
                    _WIDE_SHARE * self.weights,
                    [_NOMINAL_SHARE],
                ]
            ),
            np.concatenate([self.means, self.means, np.zeros((1, k))]),
            np.concatenate([self.covariances, 4.0 * self.covariances, np.eye(k)[None]]),
        )


@dataclasses.dataclass
class ModeMixture:
    """Mixtures in subspaces of their own, standard normal outside of these, with the density of them all.

    Sampling from all modes and weighting by the density of the whole is the balance heuristic (Veach and Guibas,
    SIGGRAPH 1995).

    Attributes
    ----------
    shares : array (m,)
        Of sum 1.
    bases : list of array (k, r)
        Orthonormal basis of each subspace.
    mixtures : list of GaussianMixture
        In r dimensions each.
    """

    shares: np.ndarray
    bases: list[np.ndarray]
    mixtures: list[GaussianMixture]

    def logDensity(self, y: np.ndarray) -> np.ndarray:
        """Logarithm of the density, (n,)."""
        columns = []
        for share, basis, mixture in zip(self.shares, self.bases, self.mixtures, strict=True):
            z = y @ basis
            columns.append(math.log(share) + mixture.logDensity(z) - normalLogDensity(z))
        return normalLogDensity(y) + logSumExp(np.column_stack(columns))

    def sample(self, size: int, generator: np.random.Generator) -> np.ndarray:
        """Independent points, (size, k)."""
        which = generator.choice(len(self.shares), size=size, p=self.shares)
        y = generator.standard_normal((size, len(self.bases[0])))
        for index, (basis, mixture) in enumerate(zip(self.bases, self.mixtures, strict=True)):
            rows = which == index
            z = mixture.sample(int(np.count_nonzero(rows)), generator)
            y[rows] += (z - y[rows] @ basis) @ basis.T
        return y


def fitGaussianMixture(
    points: np.ndarray, generator: np.random.Generator, components: int | None = None, iterations: int = 20
) -> GaussianMixture:
    """Expectation-maximisation for equally weighted points (n, k); components that lose their points are dropped."""
    n, k = points.shape
    if components is None:
        components = 3 if k == 1 else min(max(6, 2 + k), 12)
    # Start from points far from each other (k-means++), moved to the centres of their clusters, so that each mode
    # receives a component.
    centres = points[[int(generator.integers(n))]]
    distance = ((points - centres[0]) ** 2).sum(axis=1)
    while len(centres) < components and distance.sum() > 0.0:
        centres = np.vstack([centres, points[generator.choice(n, p=distance / distance.sum())]])
        distance = np.minimum(distance, ((points - centres[-1]) ** 2).sum(axis=1))
    for _ in range(10):
        nearest = np.argmin((centres**2).sum(axis=1) - 2.0 * points @ centres.T, axis=1)
        centres = np.array([points[nearest == j].mean(axis=0) for j in range(len(centres)) if (nearest == j).any()])
    count = len(centres)
    mixture = GaussianMixture(np.full(count, 1.0 / count), centres, np.repeat(np.eye(k)[None], count, axis=0))
    earlier = -math.inf
    for _ in range(iterations):
        logs = mixture.logComponents(points)
        density = logSumExp(logs)
        if density.mean() < earlier + 3e-3:
            break
        earlier = float(density.mean())
        responsibility = np.exp(logs - density[:, None])
        totals = responsibility.sum(axis=0)
        kept = totals > 2.0 * (k + 1)
        if not kept.any():
            # Too many directions for the covariances of any cluster: the clusters themselves must do.
            break
        responsibility, totals = responsibility[:, kept], totals[kept]
        means = (responsibility.T @ points) / totals[:, None]
        covariances = np.empty((len(totals), k, k))
        for index, mean in enumerate(means):
            centred = points - mean
            covariances[index] = (centred.T * responsibility[:, index]) @ centred
            # Pseudo-observations of the standard normal, which is what most directions of a failure region follow:
            # without them the noise of many covariances makes the weights degenerate.
            prior = 0.02 * (k + 1) ** 2
            covariances[index] += prior * np.eye(k)
            covariances[index] /= totals[index] + prior
        mixture = GaussianMixture(totals / totals.sum(), means, covariances)
    return mixture


def _fitDefended(points, generator):
    return fitGaussianMixture(points, generator).withDefence()


def fitImportantRegion(
    limitState: Callable,
    dimension: int,
    generator: np.random.Generator,
    maximumLevels: int = 15,
    size: int = _LEARNING_POINTS,
    start: GaussianMixture | ModeMixture | None = None,
    fit: Callable = _fitDefended,
) -> Any:
    """A mixture that covers the region where a cheap function says failure, weighted by the standard normal density.

    Parameters
    ----------
    limitState : callable
        Maps points (n, k) on pairs ``(value, scale)`` of arrays (n,): failure is value <= 0, known up to the scale.
    dimension : int
        k.
    generator : :py:class:`numpy.random.Generator`
    maximumLevels : int
        Largest number of intermediate distributions.
    size : int
        Points of each of them.
    start : GaussianMixture or ModeMixture, optional
        The first distribution; by default the standard normal.
    fit : callable
        Fits a mixture to points (n, k), given them and the generator.

    Returns
    -------
    mixture : GaussianMixture, or what `fit` gives, or None
        None when no failure region of any probability was reached.
    """
    mixture: Any = start
    if mixture is None:
        mixture = GaussianMixture(np.ones(1), np.zeros((1, dimension)), np.eye(dimension)[None])
    smoothing = math.inf
    last = False
    for level in range(maximumLevels):
        # The last level takes more points: points of large weight show the modes that the mixture lacks.
        closing = last
        y = mixture.sample(3 * size if closing else size, generator)
        value, scale = limitState(y)
        logWeight = normalLogDensity(y) - mixture.logDensity(y)
        earlier, smoothing = smoothing, _nextSmoothing(logWeight, value, scale, smoothing)
        # Where the mixture cannot follow the region any closer, what it reaches must do.
        last = smoothing == 0.0 or smoothing > 0.9 * earlier or level >= maximumLevels - 2
        # The uncertain band is part of the target: it is widened to twice the scale.
        logTarget = logWeight + log_ndtr(-value / np.maximum(0.0 if last else smoothing, 2.0 * scale))
        weight = np.exp(logTarget - logTarget.max())
        if weight.sum() ** 2 / (weight**2).sum() < 4.0 * (dimension + 2):
            return None
        chosen = generator.choice(len(y), size=_FITTING_POINTS, p=weight / weight.sum())
        mixture = fit(y[chosen], generator)
        if closing:
            break
    return mixture


def _nextSmoothing(logWeight, value, scale, largest):
    """The smallest smoothing whose weights have a coefficient of variation of at most 2.5; 0 at the end."""

    def variation(smoothing):
        logTarget = logWeight + log_ndtr(-value / np.maximum(smoothing, 2.0 * scale))
        weight = np.exp(logTarget - logTarget.max())
        return weight.std() / weight.mean()

    if variation(0.0) <= 2.5:
        return 0.0
    # A few points and digits do: the next level starts from its own.
    logWeight, value, scale = logWeight[::4], value[::4], scale[::4]
    upper = min(largest, 10.0 * float(np.abs(value).max()))
    lower = 0.0
    for _ in range(14):
        middle = 0.5 * (lower + upper)
        lower, upper = (lower, middle) if variation(middle) <= 2.5 else (middle, upper)
    return upper
