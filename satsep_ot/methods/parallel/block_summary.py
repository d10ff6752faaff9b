"""What remains of many runs: sums from which their moments follow, extremes, and counts of events."""

import dataclasses
from collections.abc import Sequence

import numpy as np

from satsep_ot.methods.common.margins import thresholdMargin


def _compared(values, center=None):
    return values if center is None else np.abs(values - center)


@dataclasses.dataclass
class BlockSummary:
    """What remains of the runs of a block, or of many.

    Attributes
    ----------
    size : int
    mean, squares, least, most : ndarray, shape (p,)
        Of each output: mean, sum of the squared deviations from it, smallest and largest value.
    counts : ndarray of int, shape (E + 1,)
        Runs in each event, and in any of them.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.parallel.block_summary import BlockSummary
    >>> parts = [BlockSummary.of(np.array([[1.0], [3.0]]), ()), BlockSummary.of(np.array([[8.0]]), ())]
    >>> both = parts[0].merged(parts[1])
    >>> both.size, both.mean.tolist(), both.squares.tolist()
    (3, [4.0], [26.0])
    """

    size: int
    mean: np.ndarray
    squares: np.ndarray
    least: np.ndarray
    most: np.ndarray
    counts: np.ndarray

    @staticmethod
    def of(values: np.ndarray, events: Sequence[tuple]) -> "BlockSummary":
        """The summary of outputs (n, p); an event is (column, comparison operator, threshold) and perhaps a center."""
        inside = [
            thresholdMargin(operator, limit)(_compared(values[:, column], *center)) <= 0.0
            for column, operator, limit, *center in events
        ]
        counts = [int(np.count_nonzero(hits)) for hits in inside]
        counts.append(int(np.count_nonzero(np.any(inside, axis=0))) if inside else 0)
        mean = values.mean(axis=0)
        squares = ((values - mean) ** 2).sum(axis=0)
        return BlockSummary(
            len(values), mean, squares, values.min(axis=0), values.max(axis=0), np.array(counts, dtype=np.int64)
        )

    def merged(self, other: "BlockSummary") -> "BlockSummary":
        """The summary of the runs of both (Chan, Golub, LeVeque, The American Statistician 37, 1983, eq. 2.1)."""
        size = self.size + other.size
        difference = other.mean - self.mean
        return BlockSummary(
            size,
            self.mean + difference * (other.size / size),
            self.squares + other.squares + difference**2 * (self.size * other.size / size),
            np.minimum(self.least, other.least),
            np.maximum(self.most, other.most),
            self.counts + other.counts,
        )
