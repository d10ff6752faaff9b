"""Surrogates of failure modes, one for each, as a control variate of the sampling around modes.

Each mode has a surrogate of the limit state of its own, fitted to the runs that belong to it, so that a union of limits
that no single smooth function follows is followed piece by piece. Their union tells where runs are worth most, and its
probability is integrated over a pool of points; true runs correct it, so that a poor surrogate costs runs and no truth.
"""

import copy
import math

import numpy as np
from scipy.special import ndtr

from satsep_ot.methods.reliability.calibration import Calibration
from satsep_ot.methods.reliability.failure_modes import FailureMode, ModeProposal, membership
from satsep_ot.methods.reliability.limit_state import Runs
from satsep_ot.methods.reliability.proposal import CONFIRMING, LEARNING, LEARNING_RUNS, WIDTHS
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate

# Runs of a mode, for each input, and in all, below which it has no surrogate.
_LEAST_RUNS, _LEAST_RUNS_OF_INPUT = 20, 1.3
# Models are chosen anew when the runs have grown by this share.
_RESELECTION = 0.25
# Share of the runs that the surrogates have no part in.
PLAIN_SHARE = 0.4
_POOL_SIZE, _LARGEST_POOL = 10_000, 60_000
# Variance of the pool's integration, as a share of the target's.
_POOL_SHARE = 0.4


class ModeSurrogates:
    """Surrogates of all modes.

    Attributes
    ----------
    parts : list of LimitStateSurrogate or None
        One for each mode; None where its runs are too few.
    """

    def __init__(self) -> None:
        self.parts: list[LimitStateSurrogate | None] = []
        self._calibrations: list[Calibration] = []
        self._selectedAt = 0

    def fit(self, runs: Runs, modes: list[FailureMode]) -> None:
        """Fit to all runs that have a value, each of which belongs to the mode that draws it most often."""
        rows = np.flatnonzero(runs.finite & (runs.phases != "search"))
        u, margins = runs.u[rows], runs.margins[rows]
        belongs = membership(modes, u).argmax(axis=1)
        same = len(self.parts) == len(modes)
        reselect = not same or len(rows) >= (1.0 + _RESELECTION) * self._selectedAt
        if reselect:
            self._selectedAt = len(rows)
        if not same:
            self._calibrations = [Calibration() for _ in modes]
        earlier = self.parts if same else [None] * len(modes)
        self.parts = []
        for k, previous in enumerate(earlier):
            own = belongs == k
            if own.sum() < _LEAST_RUNS + _LEAST_RUNS_OF_INPUT * u.shape[1] or np.ptp(margins[own]) == 0.0:
                self.parts.append(None)
                continue
            values = margins[own]
            part = LimitStateSurrogate(u[own], values[:, None], _identity, _nearness(values), previous, reselect)
            part.calibration *= self._calibrations[k].factors()
            self.parts.append(part)

    def judge(self, runs: Runs, modes: list[FailureMode]) -> None:
        """Note how far runs that are not yet learnt are from their predictions."""
        belongs = membership(modes, runs.u).argmax(axis=1)
        for k, (part, calibration) in enumerate(zip(self.parts, self._calibrations, strict=True)):
            own = runs.finite & (belongs == k)
            if part is None or not own.any():
                continue
            value, error = part.predictBoth(part.reduce(runs.u[own]))
            margins = runs.margins[own]
            standardised = (part.targets(margins[:, None]) - value) / (error / calibration.factors())
            calibration.add(standardised, _nearness(margins))

    def standardised(self, u: np.ndarray) -> np.ndarray:
        """Predicted limit state over the size of its error, (n, number of parts); infinite without a surrogate."""
        columns = []
        for part in self.parts:
            if part is None:
                columns.append(np.full(len(u), np.inf))
            else:
                value, scale = part.limitState(part.reduce(u))
                columns.append(value / scale)
        return np.column_stack(columns)

    def failure(self, u: np.ndarray) -> np.ndarray:
        """Probability of failure at points (n, d), (n,)."""
        return _union(self.standardised(u), 1.0)


def _identity(values):
    return values[:, 0]


def _nearness(margins):
    """Weights (n,) that fall with the distance from the limit."""
    return 1.0 / (1.0 + (margins / max(np.median(np.abs(margins)), 1e-300)) ** 2)


def _union(standardised, width):
    """Probability (n,) that any of independent normal predictions fails, their errors so many times as wide."""
    return 1.0 - ndtr(standardised / width).prod(axis=1)


class SelectedProposal:
    """A mode proposal from which runs are selected where the surrogates are worth most.

    Weights are by the density, whose normalising constants are integrals over a pool of points.

    Parameters
    ----------
    proposal : ModeProposal
    surrogates : ModeSurrogates
    target : float
        Coefficient of variation.
    generator : :py:class:`numpy.random.Generator`

    Attributes
    ----------
    failure : array (N,)
        The surrogates' probability of failure at the points of the pool.
    probability, poolVariance : float
        Their probability of failure, and the variance of its integration.
    """

    def __init__(
        self, proposal: ModeProposal, surrogates: ModeSurrogates, target: float, generator: np.random.Generator
    ) -> None:
        self.proposal, self.surrogates = proposal, copy.copy(surrogates)
        size = _POOL_SIZE
        while True:
            self._u, self._parts = proposal.sample(size, generator)
            self._weights = np.exp(-proposal.logRatio(self._u))
            standardised = surrogates.standardised(self._u)
            self.failure = _union(standardised, 1.0)
            products = self._weights * self.failure
            self.probability, self.poolVariance = float(products.mean()), float(products.var()) / size
            missing = self.poolVariance / max(_POOL_SHARE * target * self.probability, 1e-300) ** 2
            if missing <= 1.0 or size == _LARGEST_POOL:
                break
            size = min(int(1.2 * missing * size), _LARGEST_POOL)
        bands = _bands(standardised)
        self._totals = (self._weights[:, None] * bands).mean(axis=0)
        self._shares = LEARNING
        self._select(bands)
        doubt = min(math.sqrt(self.runVariance() / LEARNING_RUNS) / max(self.probability * target, 1e-300), 1.0)
        self._shares = doubt * LEARNING + (1.0 - doubt) * CONFIRMING
        self._select(bands)

    def _select(self, bands):
        self._shares = np.where(self._totals > 0.0, self._shares, 0.0)
        self._shares *= (1.0 - PLAIN_SHARE) / self._shares.sum()
        self._selection = self._weights * (bands @ (self._shares / np.maximum(self._totals, 1e-300))) + PLAIN_SHARE
        self._selection /= self._selection.sum()

    def runVariance(self) -> float:
        """Variance that one true run is expected to add to the correction."""
        weights = self._weights / (len(self._weights) * self._selection)
        return float((self._selection * weights**2 * self.failure * (1.0 - self.failure)).sum())

    def logRatio(self, u: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the density over the standard normal one."""
        plain = math.log(PLAIN_SHARE) + self.proposal.logRatio(u)
        selected = _bands(self.surrogates.standardised(u)) @ (self._shares / np.maximum(self._totals, 1e-300))
        return np.logaddexp(plain, np.log(np.maximum(selected, 1e-300)))

    def sample(self, size: int, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Points (size, d), and for each what it was drawn for, as `ModeProposal.sample` has it."""
        chosen = generator.choice(len(self._selection), size=size, p=self._selection)
        return self._u[chosen], self._parts[chosen]

    def drawWide(self, size: int) -> np.ndarray:
        """Wide points (size, d)."""
        return self.proposal.drawWide(size)

    def drawFailures(self, size: int, generator: np.random.Generator) -> tuple[np.ndarray, float]:
        """Points (size, d) that fail as the surrogates see it, and by how much their pool inflates variances."""
        products = self._weights * self.failure
        chosen = generator.choice(len(products), size=size, p=products / products.sum())
        return self._u[chosen], 1.0 + size * float((products**2).sum()) / float(products.sum()) ** 2


def _bands(standardised):
    """Failures, and where they are uncertain at the widths, (n, 4)."""
    columns = [_union(standardised, 1.0)]
    for width in WIDTHS:
        share = _union(standardised, width)
        columns.append(np.sqrt(share * (1.0 - share)))
    return np.column_stack(columns)
