"""Estimates of a probability from blocks of true runs, crude Monte Carlo, and how exact they are."""

import dataclasses
import math
from typing import Any

import numpy as np

from satsep_ot.methods.common.intervals import ConfidenceInterval
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.sensitivity import FailureSample

# Above this shape of their largest values the mean and variance of the corrections are not to be trusted.
_LARGEST_PARETO_SHAPE = 0.7
# Corrections below this share of the wanted error do not matter.
_NEGLIGIBLE_SHARE = 0.2
# Points that carry the surrogate's share of the failure distribution.
_SURROGATE_POINTS = 10_000
# Failures of a crude Monte Carlo estimate that is believed.
_MINIMUM_FAILURES = 60
# A surrogate that knew another probability than the present one, by more than this share of it, has missed or invented
# the difference: runs of a weight of about this size would have had to find it.
_AGREEMENT, _MISSED_WEIGHT = 0.25, 20.0


@dataclasses.dataclass(frozen=True, eq=False)
class Block:
    """True runs of one proposal, which was made before they were known.

    The block's own estimate is ``surrogateProbability + mean(weights (failed - expected))``.

    Attributes
    ----------
    runs : Runs
        n runs, with their weights and the surrogate's probabilities of failure there, 0 without a surrogate.
    start : int
        Number of true runs that were recorded before them.
    known : int
        Evaluations that the proposal was made from.
    runVariance : float
        Variance that one run was expected to have, before the block was made.
    surrogateProbability, poolVariance : float
        The surrogate's probability of failure, 0 without one, and the variance of its integration.
    proposal : optional
        The `Proposal` or `SelectedProposal` that the runs were drawn from, where there is a surrogate.
    """

    runs: Runs
    start: int
    known: int
    runVariance: float
    surrogateProbability: float = 0.0
    poolVariance: float = 0.0
    proposal: Any = None

    @property
    def size(self) -> int:
        """Number of true runs n."""
        return len(self.runs)

    @property
    def corrections(self) -> np.ndarray:
        """``w (1_F - pi)`` of the runs, (n,)."""
        return self.runs.weights * (self.runs.failed - self.runs.expected)

    @property
    def leastSquares(self) -> np.ndarray:
        """``w^2 pi (1 - pi)``, (n,): the squared corrections by the surrogate's own account of its error."""
        return self.runs.weights**2 * self.runs.expected * (1.0 - self.runs.expected)


class Estimate:
    """The blocks' estimates combined.

    The share of a block follows from its size, from the variance that its proposal expected and from the runs that this
    one had seen, never from what the block's own runs gave, which would favour blocks that missed something.

    The variance is the larger of the observed and the expected one, with the variance of the surrogate's integration
    and the square of what one more run could have changed: the largest contribution of a run, or ``p / (1 + m)`` with
    m the effective number of failures.

    Parameters
    ----------
    blocks : list of Block
        At least one.
    """

    def __init__(self, blocks: list[Block]) -> None:
        self.blocks = list(blocks)
        sizes = np.array([block.size for block in blocks], dtype=float)
        known = np.array([block.known for block in blocks], dtype=float)
        own = np.array([block.surrogateProbability for block in blocks])
        expected = np.array([block.runVariance for block in blocks])
        means = own + [block.corrections.mean() for block in blocks]
        latest = float(sizes @ means) / float(sizes.sum())
        if (own > 0.0).all():
            latest = own[-1]
            expected = expected + _MISSED_WEIGHT * np.maximum(np.abs(own - latest) - _AGREEMENT * latest, 0.0)
        shares = sizes * known / np.maximum(expected, max((0.5 * latest) ** 2, 1e-300))
        self.shares = shares / shares.sum()
        self.probability = float(self.shares @ means)
        self.surrogateProbability = float(self.shares @ own)
        factors = self.shares / sizes
        corrections = [factor * block.corrections for factor, block in zip(factors, blocks, strict=True)]
        observed = sum(
            block.size / max(block.size - 1, 1) * float(((part - part.mean()) ** 2).sum())
            for part, block in zip(corrections, blocks, strict=True)
        )
        self._corrections = np.concatenate(corrections)
        failed = np.concatenate([block.runs.failed for block in blocks])
        weights = np.concatenate([factor * block.runs.weights for factor, block in zip(factors, blocks, strict=True)])
        self._failedWeights = weights[failed]
        squares = float((self._failedWeights**2).sum())
        self.effectiveFailures = float(self._failedWeights.sum()) ** 2 / squares if squares > 0.0 else 0.0
        sampled = max(observed, float((self.shares**2 * expected / sizes).sum()))
        largest = float(np.abs(self._corrections).max())
        self._doubt = max(self.probability / (1.0 + self.effectiveFailures), largest) ** 2
        self.variance = sampled + self._doubt
        self.variance += sum(
            sum(self.shares[j] for j in rows) ** 2 * self.blocks[rows[0]].poolVariance for rows in self._byPool()
        )
        # Effective number of runs behind the sampled variance (Satterthwaite): few large corrections make a long-tailed
        # error, as far as they are a part of it.
        least = np.concatenate([factor**2 * block.leastSquares for factor, block in zip(factors, blocks, strict=True)])
        contributions = self._corrections**2 + least
        squares = float((contributions**2).sum())
        self.freedom = math.inf
        if squares > 0.0 and sampled > 0.0:
            self.freedom = max(float(contributions.sum()) ** 2 / squares, 1.0) * (self.variance / sampled) ** 2
        self.failures = int(failed.sum())
        self.size = int(sizes.sum())

    def _byPool(self) -> list[list[int]]:
        """Positions of the blocks of each pool, whose error they share."""
        groups: dict[int, list[int]] = {}
        for j, block in enumerate(self.blocks):
            groups.setdefault(id(block.proposal) if block.proposal is not None else -j - 1, []).append(j)
        return list(groups.values())

    def mark(self, runs: Runs) -> None:
        """Write into all recorded runs what each is worth, so that the estimate is the surrogate's probability plus the
        mean of ``weights (failed - expected)`` over the runs with a weight."""
        runs.weights[:], runs.expected[:] = np.nan, 0.0
        for share, block in zip(self.shares, self.blocks, strict=True):
            rows = slice(block.start, block.start + block.size)
            runs.weights[rows] = block.runs.weights * share * self.size / block.size
            runs.expected[rows] = block.runs.expected

    def paretoShape(self) -> float:
        """Shape of the tail of the corrections, see `paretoShape`."""
        return paretoShape(np.abs(self._corrections))

    def hasLightTail(self, target: float = 0.0) -> bool:
        """Whether mean and variance of the corrections can be trusted: their tail is not too heavy, or none of them is
        of a size that matters at a target coefficient of variation."""
        negligible = float(np.abs(self._corrections).max()) <= _NEGLIGIBLE_SHARE * target * self.probability
        return negligible or self.paretoShape() <= _LARGEST_PARETO_SHAPE

    def coefficientOfVariation(self) -> float:
        """Standard deviation over the estimate; infinite where the estimate is not positive."""
        return math.sqrt(self.variance) / self.probability if self.probability > 0.0 else math.inf

    def confidenceInterval(self) -> ConfidenceInterval:
        """What the interval follows from."""
        return ConfidenceInterval(self.probability, self.variance, self.freedom)

    def interval(self, level: float) -> tuple[float, float]:
        """Log-normal interval with Student quantiles; from 0 where the estimate is not positive."""
        return self.confidenceInterval().bounds(level)

    def makeFailureSample(self, limitState: LimitStateEvent, generator: np.random.Generator) -> FailureSample:
        """The estimate as weighted points: the surrogate's failures, and the true runs' corrections of them."""
        parts = []
        for rows in self._byPool():
            proposal = self.blocks[rows[0]].proposal
            if proposal is None:
                continue
            share = float(self.shares[rows].sum())
            size = max(int(_SURROGATE_POINTS * share), 500)
            u, inflation = proposal.drawFailures(size, generator)
            none = np.zeros(size)
            part = FailureSample.ofGroup(
                limitState.space.toPhysical(u),
                np.full(size, share * proposal.probability / size),
                none,
                none.astype(bool),
                none,
                # The pool is itself a sample.
                inflation=inflation,
                common=proposal.poolVariance / proposal.probability**2,
            )
            parts.append(part)
        for share, block in zip(self.shares, self.blocks, strict=True):
            factor, runs = share / block.size, block.runs
            parts.append(
                FailureSample.ofGroup(
                    runs.x, factor * block.corrections, factor**2 * block.leastSquares, runs.failed, runs.weights
                )
            )
        sample = FailureSample.union(parts)
        # What one more run could have changed, as an error that the groups share by what they contribute.
        totals = np.bincount(sample.groups, sample.weights)
        positive = totals > 0.0
        sample.common[positive] += self._doubt / (self.probability * totals[positive])
        return sample

    def diagnose(self) -> dict[str, float]:
        """Numbers that tell how far the estimate can be trusted, see `ActiveSubspaceReliabilityResult`."""
        failed = np.concatenate([block.runs.failed for block in self.blocks])
        expected = np.concatenate([block.runs.expected for block in self.blocks])
        surrogate = np.concatenate([np.full(block.size, block.proposal is not None) for block in self.blocks])
        total = float(self._failedWeights.sum())
        return {
            "effective sample size": self.effectiveFailures,
            "largest weight share": float(self._failedWeights.max()) / total if total > 0.0 else 1.0,
            "Pareto k": self.paretoShape(),
            "true failures": float(self.failures),
            "plain importance sampling": total,
            "missed failures": float(np.count_nonzero(failed & surrogate & (expected < 0.01))),
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
