"""Where the next true runs go, and with which weights.

A large pool of points is drawn from a mixture that covers the important region, and the points of the expensive
function are drawn from the pool with unequal probabilities. The Hansen-Hurwitz weights of that second draw (Saerndal,
Swensson and Wretman, Model Assisted Survey Sampling, 1992, section 2.9) are exact whatever the shape of the selection
function is, so no normalising constant has to be integrated.
"""

import dataclasses
import math
from collections.abc import Callable

import numpy as np
from scipy.special import ndtr

from satsep_ot.methods.reliability.mixture import (
    GaussianMixture,
    ModeMixture,
    fitImportantRegion,
    normalLogDensity,
)
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate

# A polynomial that fails nowhere within six standard deviations has not seen the failures.
_SMALLEST_PROBABILITY = 1e-10
# Points that stand for the distribution of the active variables. So many times more are taken where their error would
# be more than this share of the target.
_POOL_SIZE, _LARGEST_POOL_FACTOR, _POOL_SHARE = 20_000, 25.0, 0.3
# Up to so many active directions one mixture finds all modes by itself.
_SINGLE_SPACE = 3
# One mode alone is found with few points.
_MODE_POINTS = 3000
# Share of an estimate's runs that follow the distribution of the inputs itself.
NOMINAL_SHARE = 0.1
# More failures are planned than the stop needs: to stop where failures happened to be many, and to go on where they
# happened to be few, would bias the estimate.
_PLANNED_FAILURES = 100


@dataclasses.dataclass
class Pool:
    """A finite population that stands for the standard normal distribution of the active directions.

    Attributes
    ----------
    points : array (N, k)
    weights : array (N,)
        Density of the standard normal over the density that the points were drawn from.
    """

    points: np.ndarray
    weights: np.ndarray

    @staticmethod
    def draw(mixture: GaussianMixture | ModeMixture, size: int, generator: np.random.Generator) -> "Pool":
        """A pool of ``size`` independent points of the mixture."""
        points = mixture.sample(size, generator)
        return Pool(points, np.exp(normalLogDensity(points) - mixture.logDensity(points)))

    def expectation(self, values: np.ndarray) -> tuple[float, float]:
        """Expectation of values under the standard normal, and the variance of that estimate."""
        products = self.weights * values
        return float(products.mean()), float(products.var() / len(products))

    def selection(self, functions: list[tuple[float, np.ndarray]]) -> np.ndarray:
        """Selection probabilities (N,) from pairs (share, values >= 0 at the points); shares of empty functions are
        passed on to the others."""
        probabilities = np.zeros(len(self.weights))
        for share, values in functions:
            products = self.weights * values
            total = products.sum()
            if total > 0.0:
                probabilities += share * products / total
        return probabilities / probabilities.sum()

    def select(
        self, probabilities: np.ndarray, size: int, generator: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray]:
        """Positions (size,) of points drawn with replacement, and their Hansen-Hurwitz weights."""
        chosen = generator.choice(len(probabilities), size=size, p=probabilities)
        return chosen, self.weights[chosen] / (len(probabilities) * probabilities[chosen])


@dataclasses.dataclass
class Proposal:
    """Where the next true runs go, and what the surrogate says there.

    Attributes
    ----------
    surrogate : LimitStateSurrogate
    pool : Pool
        Population of N points that the runs are drawn from.
    failure : array (N,)
        The surrogate's probability of failure at the points of the pool.
    probability, poolVariance : float
        The surrogate's probability of failure and the variance of its integration over the pool.
    selection, exploration : array (N,)
        Probabilities of the pool's points, for runs of the estimate and, wider, for runs to learn from.
    """

    surrogate: LimitStateSurrogate
    pool: Pool
    failure: np.ndarray
    probability: float
    poolVariance: float
    selection: np.ndarray
    exploration: np.ndarray

    def draw(
        self, selection: np.ndarray, size: int, generator: np.random.Generator
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (size, d) of standard space, their positions in the pool and their weights."""
        chosen, weights = self.pool.select(selection, size, generator)
        return self.surrogate.expand(self.pool.points[chosen], generator), chosen, weights

    def runVariance(self) -> float:
        """Variance that one true run is expected to add to the correction."""
        weights = self.pool.weights / (len(self.selection) * np.maximum(self.selection, 1e-300))
        return float((self.selection * weights**2 * self.failure * (1.0 - self.failure)).sum())

    def failureShare(self) -> float:
        """Share of failures among the true runs, as the surrogate expects it."""
        return float((self.selection * self.failure).sum())

    def runsNeeded(self, target: float) -> float:
        """Runs to this coefficient of variation, as far as the surrogate knows."""
        allowed = (target * self.probability) ** 2 - self.poolVariance
        return self.runVariance() / allowed if allowed > 0.0 else math.inf

    def runsForFailures(self) -> float:
        """Runs until as many have failed as are planned."""
        return _PLANNED_FAILURES / max(self.failureShare(), 0.05)

    def losesToSubsetSimulation(self, remaining: int, target: float) -> bool:
        """Whether subset simulation would be more exact with the remaining runs, by its usual error (Au and Beck)."""
        ours = math.sqrt(self.runVariance() / max(remaining, 1)) / self.probability
        levels = max(-math.log10(min(self.probability, 0.1)), 1.0)
        subset = levels * math.sqrt(9.0 * 3.0 * levels / max(remaining, 1))
        return ours > max(subset, target)


def propose(
    surrogate: LimitStateSurrogate,
    target: float,
    generator: np.random.Generator,
    withNonFinite: Callable[[np.ndarray], np.ndarray],
) -> Proposal | None:
    """Where to run next; None where the surrogate shows no failure region.

    Parameters
    ----------
    surrogate : LimitStateSurrogate
    target : float
        Coefficient of variation that is wanted of the estimate.
    generator : :py:class:`numpy.random.Generator`
    withNonFinite : callable
        Corrects the surrogate's probabilities of failure (n,) for runs without a finite value.
    """
    k = surrogate.dimension()
    if k == 0:
        return None
    mixture = fitModes(surrogate, generator) if k > _SINGLE_SPACE and not surrogate.radial else None
    if mixture is None:
        mixture = fitImportantRegion(lambda y: surrogate.limitState(y, exact=False), k, generator)
    if mixture is None:
        return None
    factor = 1.0
    while True:
        pool = Pool.draw(mixture, int(factor * _POOL_SIZE), generator)
        value, scale = surrogate.limitState(pool.points)
        failure = withNonFinite(ndtr(-value / scale))
        probability, variance = pool.expectation(failure)
        if probability < _SMALLEST_PROBABILITY:
            return None
        missing = variance / (_POOL_SHARE * target * probability) ** 2
        if missing <= 1.0 or factor == _LARGEST_POOL_FACTOR:
            break
        factor = min(1.2 * missing * factor, _LARGEST_POOL_FACTOR)

    def band(width):
        share = ndtr(-value / (width * scale))
        return np.sqrt(share * (1.0 - share))

    everywhere = np.ones(len(value))
    near, far = band(4.0), band(12.0)
    selection = pool.selection(
        [(NOMINAL_SHARE, everywhere), (0.15, failure), (0.35, band(1.5)), (0.25, near), (0.15, far)]
    )
    exploration = pool.selection([(0.15, everywhere), (0.15, failure), (0.35, near), (0.35, far)])
    return Proposal(surrogate, pool, failure, probability, variance, selection, exploration)


def fitModes(surrogate: LimitStateSurrogate, generator: np.random.Generator) -> ModeMixture | None:
    """A mixture for each group of components that fail together, in their own subspace; None where there is a single
    group.

    One mixture in the many directions of all components together is too poor to be sampled from.
    """
    groups = surrogate.groups(generator)
    mixtures, bases, shares = [], [], []
    for group in groups if len(groups) > 1 else []:
        part = surrogate.restricted(group)
        k = part.dimension()
        if k == 0:
            continue
        mixture = fitImportantRegion(
            lambda y, part=part: part.limitState(y, exact=False), k, generator, size=_MODE_POINTS
        )
        if mixture is None:
            continue
        pool = Pool.draw(mixture, _POOL_SIZE // 20, generator)
        value, scale = part.limitState(pool.points, exact=False)
        mixtures.append(mixture)
        bases.append(surrogate.directions.T @ part.directions)
        shares.append(pool.expectation(ndtr(-value / scale))[0])
    if not sum(shares) > 0.0:
        return None
    # A mode that the others hide at the typical values still gets runs.
    shares = np.maximum(np.array(shares) / sum(shares), 0.01)
    return ModeMixture(shares / shares.sum(), bases, mixtures)
