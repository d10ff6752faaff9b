"""Confidence intervals of probabilities: exact binomial ones, and log-normal ones of estimates with a variance."""

import dataclasses
import math

import numpy as np
import openturns as ot
from scipy import stats

# Where the distribution of an estimate has its knots, up to the median: the bounds at the usual levels are among them.
_LOWER_PROBABILITIES = np.concatenate([[1e-6, 1e-5, 1e-4, 1e-3], np.arange(1, 201) / 400.0])


def clopperPearson(failures: int, runs: int, level: float = 0.95) -> tuple[float, float]:
    """Exact interval of a binomial probability (Clopper and Pearson, Biometrika 1934).

    With no failure the lower bound is 0 and the upper bound is one-sided at the same level, about 3 / runs at 95 %.
    So an interval of 95 % holds the probability in at least 95 % of samples, but in 93.8 % at the worst where 3.0 to
    3.5 failures are expected.

    Examples
    --------
    >>> from satsep_ot.methods.common.intervals import clopperPearson
    >>> [round(bound, 4) for bound in clopperPearson(0, 1000)]
    [0.0, 0.003]
    """
    tail = 1.0 - level if failures in (0, runs) else 0.5 * (1.0 - level)
    lower = 0.0 if failures == 0 else float(stats.beta.ppf(tail, failures, runs - failures + 1))
    upper = 1.0 if failures == runs else float(stats.beta.isf(tail, failures + 1, runs - failures))
    return lower, upper


def logNormalInterval(
    probability: float, squaredVariation: float, level: float = 0.95, freedom: float = math.inf
) -> tuple[float, float]:
    """Interval of a positive estimate whose logarithm follows a normal law, with Student quantiles.

    Parameters
    ----------
    probability : float
        The estimate.
    squaredVariation : float
        Square of its coefficient of variation.
    level : float
    freedom : float
        Degrees of freedom of the variation.

    Examples
    --------
    >>> from satsep_ot.methods.common.intervals import logNormalInterval
    >>> [f"{bound:.3e}" for bound in logNormalInterval(1e-3, 0.1**2)]
    ['8.224e-04', '1.216e-03']
    """
    width = float(stats.t.ppf(0.5 + 0.5 * level, freedom)) * math.sqrt(math.log1p(squaredVariation))
    return probability * math.exp(-width), min(probability * math.exp(width), 1.0)


@dataclasses.dataclass(frozen=True)
class ConfidenceInterval:
    """The confidence interval of a probability, at any level.

    Attributes
    ----------
    probability, variance, freedom : float
        Of a log-normal estimate with Student quantiles; from 0 where the estimate is not positive.
    failures, runs : int
        Of a binomial estimate, which is used where ``runs`` is not 0.
    lowerOnly : bool
        The estimate lacks something: the upper bound is 1, the lower one as before.
    complement : bool
        All this is of the complement; the bounds are of the event.

    Examples
    --------
    >>> from satsep_ot.methods.common.intervals import ConfidenceInterval
    >>> [f"{bound:.3e}" for bound in ConfidenceInterval(1e-3, 1e-10, 50.0).bounds(0.95)]
    ['9.801e-04', '1.020e-03']
    """

    probability: float = 0.0
    variance: float = 0.0
    freedom: float = math.inf
    failures: int = 0
    runs: int = 0
    lowerOnly: bool = False
    complement: bool = False

    def bounds(self, level: float) -> tuple[float, float]:
        """Lower and upper bound at a level."""
        lower, upper = self._bounds(level)
        upper = 1.0 if self.lowerOnly else upper
        return (1.0 - upper, 1.0 - lower) if self.complement else (lower, upper)

    def distribution(self) -> ot.Distribution:
        """The distribution whose bilateral interval at any level is this one; where a bound is the same at all levels,
        that value has the probability 1/2.

        Examples
        --------
        >>> from satsep_ot.methods.common.intervals import ConfidenceInterval
        >>> print(ConfidenceInterval(failures=3, runs=1000).distribution().computeBilateralConfidenceInterval(0.95))
        [0.0006191, 0.00874202]
        """
        probabilities, quantiles = self._knots()
        masses = np.diff(probabilities)
        # Nothing lies beyond the outermost knots.
        masses[[0, -1]] += _LOWER_PROBABILITIES[0]
        widths = np.diff(quantiles)
        parts, weights = [], []
        if (widths > 0.0).any():
            # Stretches of zero width have no density, and stand beside the histogram.
            first, heights = quantiles[0], np.where(widths > 0.0, masses / np.where(widths > 0.0, widths, 1.0), 0.0)
            parts.append(ot.Histogram(first, widths[widths > 0.0].tolist(), heights[widths > 0.0].tolist()))
            weights.append(float(masses[widths > 0.0].sum()))
        for value in np.unique(quantiles[:-1][widths <= 0.0]):
            parts.append(ot.Dirac(float(value)))
            weights.append(float(masses[(widths <= 0.0) & (quantiles[:-1] == value)].sum()))
        return ot.Mixture(parts, weights) if len(parts) > 1 else parts[0]

    def quantiles(self, probabilities: np.ndarray) -> np.ndarray:
        """Quantiles (n,) of `distribution`.

        Examples
        --------
        >>> from satsep_ot.methods.common.intervals import ConfidenceInterval
        >>> interval = ConfidenceInterval(failures=0, runs=100)
        >>> [round(float(value), 4) for value in interval.quantiles([0.3, 0.975])], round(interval.bounds(0.95)[1], 4)
        ([0.0, 0.0295], 0.0295)
        """
        return np.interp(probabilities, *self._knots())

    def _knots(self):
        """Probabilities and the quantiles there."""
        halves = [self.bounds(1.0 - 2.0 * probability) for probability in _LOWER_PROBABILITIES]
        quantiles = np.array([lower for lower, _ in halves] + [upper for _, upper in halves[-2::-1]])
        return np.concatenate([_LOWER_PROBABILITIES, 1.0 - _LOWER_PROBABILITIES[-2::-1]]), quantiles

    def _bounds(self, level):
        if self.runs:
            return clopperPearson(self.failures, self.runs, level)
        if self.probability <= 0.0:
            quantile = float(stats.t.ppf(0.5 + 0.5 * level, self.freedom))
            return 0.0, min(max(self.probability, 0.0) + quantile * math.sqrt(self.variance), 1.0)
        return logNormalInterval(self.probability, self.variance / self.probability**2, level, self.freedom)
