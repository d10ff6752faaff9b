"""Estimates of a probability from true runs: corrected surrogates, crude Monte Carlo, and when they are enough."""

import dataclasses
import math

import numpy as np

from satsep_ot.methods.common.intervals import ConfidenceInterval
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.proposal import Proposal
from satsep_ot.methods.reliability.sensitivity import FailureSample

# An estimate needs this many true failures and blocks beside the target coefficient of variation.
_MINIMUM_FAILURES, MINIMUM_BLOCKS = 60, 3
# Above this shape of their largest values the mean and variance of the corrections are not to be trusted.
_LARGEST_PARETO_SHAPE = 0.7
# Points that carry the surrogate's share of the failure distribution.
_SURROGATE_POINTS = 10_000
# Standard deviations within which a new surrogate agrees with the estimate so far.
_AGREEMENT = 5.0


@dataclasses.dataclass
class Block:
    """True runs that a surrogate proposed before it had seen them.

    Attributes
    ----------
    proposal : Proposal
        What the runs were drawn by.
    corrections : array (n,)
        ``w (1_F - pi)`` with the weights w of the runs and the surrogate's probabilities of failure pi.
    claimedSquares : array (n,)
        ``w^2 pi (1 - pi)``: the squared corrections by the surrogate's own account of its error.
    weights : array (n,)
        Standard normal density over the density of the runs.
    runs : Runs
    """

    proposal: Proposal
    corrections: np.ndarray
    claimedSquares: np.ndarray
    weights: np.ndarray
    runs: Runs

    @staticmethod
    def of(proposal: Proposal, chosen: np.ndarray, weights: np.ndarray, runs: Runs) -> "Block":
        """The block of runs at chosen points of the proposal's pool; the runs keep what they are worth."""
        failure = proposal.failure[chosen]
        runs.weights, runs.expected = weights, failure
        return Block(proposal, weights * (runs.failed - failure), weights**2 * failure * (1.0 - failure), weights, runs)

    @property
    def size(self) -> int:
        """Number of true runs."""
        return len(self.weights)


class Estimate:
    """Unbiased estimate from blocks, weighted by their sizes.

    Parameters
    ----------
    blocks : list of Block
        At least one.
    """

    def __init__(self, blocks: list[Block]) -> None:
        self.blocks = list(blocks)
        sizes = np.array([block.size for block in blocks], dtype=float)
        total = sizes.sum()
        share = sizes / total
        corrections = np.concatenate([block.corrections for block in blocks])
        claimed = np.concatenate([block.claimedSquares for block in blocks])
        self._corrections = np.abs(corrections)
        self.surrogateProbability = float(share @ [block.proposal.probability for block in blocks])
        self.probability = self.surrogateProbability + float(corrections.mean())
        centred = np.concatenate([block.corrections - block.corrections.mean() for block in blocks])
        observed = float((centred**2).sum()) * total / max(total - len(blocks), 1.0)
        # Runs that happened to agree with the surrogate do not make it more certain than it said that it was.
        self.variance = max(observed, float(claimed.sum())) / total**2
        # Blocks of the same pool share its error.
        for proposal, mine in self._byPool():
            self.variance += float(
                (np.array([block.size for block in mine]) / total).sum() ** 2 * proposal.poolVariance
            )
        # Effective number of runs behind the variance (Satterthwaite): few large corrections make a long-tailed error.
        contributions = corrections**2 + claimed
        squares = float((contributions**2).sum())
        self.freedom = max(float(contributions.sum()) ** 2 / squares, 1.0) if squares > 0.0 else math.inf
        self.failures = int(sum(block.runs.failed.sum() for block in blocks))
        self.size = int(total)

    def _byPool(self) -> list[tuple[Proposal, list[Block]]]:
        """The blocks of each pool, with the proposal of the first one."""
        groups: dict[int, list[Block]] = {}
        for block in self.blocks:
            groups.setdefault(id(block.proposal.pool), []).append(block)
        return [(mine[0].proposal, mine) for mine in groups.values()]

    def paretoShape(self) -> float:
        """Shape of the tail of the corrections, see `paretoShape`."""
        return paretoShape(self._corrections)

    def coefficientOfVariation(self) -> float:
        """Standard deviation over the estimate; infinite where the estimate is not positive."""
        return math.sqrt(self.variance) / self.probability if self.probability > 0.0 else math.inf

    def reaches(self, target: float) -> bool:
        """Whether the coefficient of variation is at most the target, and enough stands behind it to be believed."""
        return (
            self.coefficientOfVariation() <= target
            and self.failures >= _MINIMUM_FAILURES
            and len(self.blocks) >= MINIMUM_BLOCKS
            and self.paretoShape() <= _LARGEST_PARETO_SHAPE
        )

    def agrees(self, proposal: Proposal) -> bool:
        """Whether another surrogate's probability lies within five standard deviations of the estimate."""
        deviation = math.sqrt(self.variance + proposal.poolVariance) + 0.02 * abs(self.probability)
        return abs(proposal.probability - self.probability) <= _AGREEMENT * deviation

    def confidenceInterval(self) -> ConfidenceInterval:
        """What the interval follows from."""
        return ConfidenceInterval(self.probability, self.variance, self.freedom)

    def interval(self, level: float) -> tuple[float, float]:
        """Log-normal interval with Student quantiles; from 0 where the estimate is not positive."""
        return self.confidenceInterval().bounds(level)

    def makeFailureSample(self, limitState: LimitStateEvent, generator: np.random.Generator) -> FailureSample:
        """The estimate as weighted points: the surrogate's failures, and the true runs' corrections of them."""
        parts = []
        for proposal, mine in self._byPool():
            share = sum(block.size for block in mine) / self.size
            size = max(int(_SURROGATE_POINTS * share), 500)
            products = proposal.pool.weights * proposal.failure
            chosen = generator.choice(len(products), size=size, p=products / products.sum())
            u = proposal.surrogate.expand(proposal.pool.points[chosen], generator)
            none = np.zeros(size)
            part = FailureSample.ofGroup(
                limitState.space.toPhysical(u),
                np.full(size, share * proposal.probability / size),
                none,
                none.astype(bool),
                none,
                # The pool is itself a sample.
                inflation=1.0 + size * float((products**2).sum()) / float(products.sum()) ** 2,
                common=proposal.poolVariance / proposal.probability**2,
            )
            parts.append(part)
        for block in self.blocks:
            parts.append(
                FailureSample.ofGroup(
                    block.runs.x,
                    block.corrections / self.size,
                    block.claimedSquares / self.size**2,
                    block.runs.failed,
                    block.weights,
                )
            )
        return FailureSample.union(parts)

    def diagnose(self) -> dict[str, float]:
        """Numbers that tell how far the estimate can be trusted, see `ActiveSubspaceReliabilityResult`."""
        weights = np.concatenate([block.weights for block in self.blocks])
        failed = np.concatenate([block.runs.failed for block in self.blocks])
        expected = np.concatenate([block.runs.expected for block in self.blocks])
        failedWeights = weights[failed]
        total = failedWeights.sum()
        return {
            "effective sample size": float(total**2 / (failedWeights**2).sum()) if total > 0.0 else 0.0,
            "largest weight share": float(failedWeights.max() / total) if total > 0.0 else 1.0,
            "Pareto k": self.paretoShape(),
            "true failures": float(failed.sum()),
            "plain importance sampling": float((weights * failed).mean()),
            "missed failures": float(np.count_nonzero(failed & (expected < 0.01))),
        }


@dataclasses.dataclass(frozen=True)
class CrudeEstimate:
    """Crude Monte Carlo: the share of the failures among draws of the inputs' own distribution."""

    failures: int
    size: int

    @property
    def probability(self) -> float:
        """The share."""
        return self.failures / self.size

    @property
    def variance(self) -> float:
        """Of the share."""
        return self.probability * (1.0 - self.probability) / self.size

    def confidenceInterval(self) -> ConfidenceInterval:
        """What the interval follows from."""
        return ConfidenceInterval(failures=self.failures, runs=self.size)

    def reaches(self, target: float) -> bool:
        """Whether both bounds at 95 % are within twice the target, as they are of an estimate that reaches it.

        Its own coefficient of variation would be 0 where all runs have failed.
        """
        lower, upper = self.confidenceInterval().bounds(0.95)
        width = max(upper - self.probability, self.probability - lower)
        return self.failures >= _MINIMUM_FAILURES and width <= 2.0 * target * self.probability


def paretoShape(weights: np.ndarray) -> float:
    """Shape k of a generalised Pareto distribution fitted to the largest fifth of the weights.

    By probability-weighted moments (Hosking and Wallis, Technometrics 1987). Above 0.7 the mean of the weights hardly
    converges (Vehtari et al., Journal of Machine Learning Research 2024).

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.reliability.estimate import paretoShape
    >>> round(paretoShape(np.ones(100)), 2)
    0.0
    """
    ordered = np.sort(weights)
    tail = ordered[-max(len(ordered) // 5, min(len(ordered), 10)) :] - ordered[-max(len(ordered) // 5, 10) - 1 :][0]
    mean = tail.mean()
    if mean <= 1e-12 * max(abs(ordered[-1]), 1e-300):
        return 0.0
    n = len(tail)
    first = float((tail * (n - 0.65 - np.arange(n)) / n).mean())
    return float(2.0 - mean / (mean - 2.0 * first)) if mean > 2.0 * first else math.inf
