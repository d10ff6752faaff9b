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

from satsep_ot.methods.reliability.audits import auditSpread
from satsep_ot.methods.reliability.low_fidelity import fitFailures
from satsep_ot.methods.reliability.mixture import (
    GaussianMixture,
    ModeMixture,
    fitGaussianMixture,
    fitImportantRegion,
    normalLogDensity,
)
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate

# Below this the arithmetic ends.
_SMALLEST_PROBABILITY = 1e-250
# A point is reached where the density is so much of that of failures on average.
_REACHED_SHARE = 0.01
# Points that stand for the distribution of the active variables. So many times more are taken where their error would
# be more than this share of the target.
_POOL_SIZE, _POOL_SHARE = 5_000, 0.4
# Up to so many active directions one mixture finds all modes by itself.
_SINGLE_SPACE = 3
# One mode alone is found with few points.
_MODE_POINTS = 3000
# Share of the runs that follow the distribution of the inputs itself.
NOMINAL_SHARE = 0.05
# Shares of the runs that go to the surrogate's failures, and where it is unsure, at three widths in its own errors:
# while the limit is learnt, and when failures are to be confirmed.
WIDTHS = (1.5, 4.0, 12.0)
LEARNING, CONFIRMING = np.array([0.35, 0.30, 0.18, 0.12]), np.array([0.72, 0.12, 0.07, 0.04])
# Runs after which a limit that is learnt is to be exact enough.
LEARNING_RUNS = 20.0
# The earlier mixture does where this share of its points is effective, wide points among them.
_LEAST_EFFECTIVE_SHARE, _WIDE_SHARE = 0.03, 0.3


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
    mixture : GaussianMixture or ModeMixture
        That the pool was drawn from.
    pool : Pool
        Population of N points that the runs are drawn from.
    failure : array (N,)
        The surrogate's probability of failure at the points of the pool.
    probability, poolVariance : float
        The surrogate's probability of failure and the variance of its integration over the pool.
    selection : array (N,)
        Probabilities of the pool's points.
    """

    surrogate: LimitStateSurrogate
    mixture: GaussianMixture | ModeMixture
    pool: Pool
    failure: np.ndarray
    probability: float
    poolVariance: float
    selection: np.ndarray

    def draw(self, size: int, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Points (size, d) of standard space, their positions in the pool and their weights."""
        chosen, weights = self.pool.select(self.selection, size, generator)
        return self.surrogate.expand(self.pool.points[chosen], generator), chosen, weights

    def drawFailures(self, size: int, generator: np.random.Generator) -> tuple[np.ndarray, float]:
        """Points (size, d) that fail as the surrogate sees it, and by how much their pool inflates variances."""
        products = self.pool.weights * self.failure
        chosen = generator.choice(len(products), size=size, p=products / products.sum())
        u = self.surrogate.expand(self.pool.points[chosen], generator)
        return u, 1.0 + size * float((products**2).sum()) / float(products.sum()) ** 2

    def reaches(self, u: np.ndarray) -> np.ndarray:
        """Whether points (n, d) of the limit are drawn about as often as failures are, (n,)."""
        y = self.surrogate.reduce(u)
        return self.mixture.logDensity(y) - normalLogDensity(y) > math.log(_REACHED_SHARE / self.probability)

    def runVariance(self) -> float:
        """Variance that one true run is expected to add to the correction."""
        weights = self.pool.weights / (len(self.selection) * np.maximum(self.selection, 1e-300))
        return float((self.selection * weights**2 * self.failure * (1.0 - self.failure)).sum())

    def runsNeeded(self, target: float) -> float:
        """Runs to this coefficient of variation, as far as the surrogate knows."""
        allowed = (target * self.probability) ** 2 - self.poolVariance
        return self.runVariance() / allowed if allowed > 0.0 else math.inf


def propose(
    surrogate: LimitStateSurrogate,
    target: float,
    generator: np.random.Generator,
    withNonFinite: Callable[[np.ndarray], np.ndarray],
    previous: Proposal | None = None,
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
    previous : Proposal, optional
        Of an earlier surrogate: where its mixture still covers the failures, it need not be searched anew.
    """
    k = surrogate.dimension()
    if k == 0:
        return None
    if surrogate.knownFailures is None:
        mixture = _followed(surrogate, generator, previous)
    else:
        mixture = _sought(surrogate, generator, previous)
    if mixture is None and k > _SINGLE_SPACE and not surrogate.radial:
        mixture = fitModes(surrogate, generator)
    if mixture is None:
        mixture = fitImportantRegion(
            lambda y: surrogate.limitState(y, exact=False), k, generator, size=surrogate.searchPoints
        )
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
        if missing <= 1.0 or factor == surrogate.largestPoolFactor:
            break
        factor = min(1.2 * missing * factor, surrogate.largestPoolFactor)

    bands = [failure]
    for width in WIDTHS:
        share = ndtr(-value / (width * scale))
        bands.append(np.sqrt(share * (1.0 - share)))
    everywhere = (NOMINAL_SHARE, np.ones(len(value)))

    def proposal(shares):
        selection = pool.selection([everywhere, *zip(shares, bands, strict=True)])
        return Proposal(surrogate, mixture, pool, failure, probability, variance, selection)

    learning = proposal(LEARNING)
    # Where the labels are nearly certain, runs confirm failures; elsewhere they learn the limit.
    doubt = min(math.sqrt(learning.runVariance() / LEARNING_RUNS) / (probability * target), 1.0)
    return proposal(doubt * LEARNING + (1.0 - doubt) * CONFIRMING)


def _sought(surrogate, generator, previous):
    """The mixture that a search finds from known failures, or from those of an earlier proposal of all inputs."""
    failures = surrogate.knownFailures
    if previous is not None and previous.surrogate.knownFailures is not None:
        failures, _ = previous.drawFailures(len(failures), generator)
    start = fitFailures(failures, generator)
    found = fitImportantRegion(
        lambda y: surrogate.limitState(y, exact=False),
        start.bases[0].shape[1],
        generator,
        size=surrogate.searchPoints,
        start=start,
        fit=fitFailures,
    )
    return found or start


def _followed(surrogate, generator, previous):
    """The mixture of an earlier proposal in the same variables, moved to the failures as they are seen now."""
    if previous is None or not isinstance(previous.mixture, GaussianMixture):
        return None
    earlier = previous.surrogate
    if surrogate.dimension() != earlier.dimension() or surrogate.radial != earlier.radial:
        return None
    # The same directions in another order or sign would be other variables.
    if surrogate.directions.shape[1] and not np.allclose(
        np.abs((surrogate.directions * earlier.directions).sum(axis=0)), 1.0, atol=0.1
    ):
        return None
    # Wide points beside it: the surrogate may have learnt of another region.
    k, mixture = surrogate.dimension(), previous.mixture
    wide = auditSpread(previous.probability) ** 2 * np.eye(k)[None]
    wider = GaussianMixture(
        np.append((1.0 - _WIDE_SHARE) * mixture.weights, _WIDE_SHARE),
        np.vstack([mixture.means, np.zeros((1, k))]),
        np.concatenate([mixture.covariances, wide]),
    )
    pool = Pool.draw(wider, _POOL_SIZE // 2, generator)
    value, scale = surrogate.limitState(pool.points, exact=False)
    weights = pool.weights * ndtr(-value / (2.0 * scale))
    if not weights.max() > 0.0:
        return None
    weights /= weights.max()
    total = float(weights.sum())
    if total**2 / float((weights**2).sum()) < _LEAST_EFFECTIVE_SHARE * len(weights):
        return None
    chosen = generator.choice(len(weights), size=1000, p=weights / total)
    return fitGaussianMixture(pool.points[chosen], generator).withDefence()


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
        pool = Pool.draw(mixture, _POOL_SIZE // 5, generator)
        value, scale = part.limitState(pool.points, exact=False)
        mixtures.append(mixture)
        bases.append(surrogate.directions.T @ part.directions)
        shares.append(pool.expectation(ndtr(-value / scale))[0])
    if not sum(shares) > 0.0:
        return None
    # A mode that the others hide at the typical values still gets runs.
    shares = np.maximum(np.array(shares) / sum(shares), 0.01)
    return ModeMixture(shares / shares.sum(), bases, mixtures)
