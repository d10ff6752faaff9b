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

# Runs of a mode, and beside them for each input, below which it has no surrogate of its subspace, or of all inputs.
_LEAST_RUNS, _LEAST_RUNS_OF_INPUT = 15, 1.3
# Models are chosen anew when the runs have grown by this share.
_RESELECTION = 0.25
# A point is near a mode where this draws at least as many as this share of the largest density over the nominal one.
_NEAR = math.log(1e-3)
# A run belongs to a mode where no other one draws it more often than this share of the mode's own.
_BESIDE = 0.2
# Standardised error of a value that belongs to another mode.
_EXCLUDED = 6.0
# Share of the runs that the surrogates have no part in.
PLAIN_SHARE = 0.4
_POOL_SIZE, _LARGEST_POOL = 10_000, 60_000
# Variance of the pool's integration, as a share of the target's.
_POOL_SHARE = 0.4


class ModeSurrogate:
    """Surrogate of the limit state near one mode: of the coordinates of its subspace, or of all inputs.

    Parameters
    ----------
    mode : FailureMode
    basis : array (d, r)
        Orthonormal; of the coordinates.
    u : array (n, d)
    margins : array (n,)
    previous : ModeSurrogate, optional
        Its models are the start of this fit.
    reselect : bool
        Whether to choose models anew.
    """

    def __init__(
        self,
        mode: FailureMode,
        basis: np.ndarray,
        u: np.ndarray,
        margins: np.ndarray,
        previous: "ModeSurrogate | None" = None,
        reselect: bool = True,
    ) -> None:
        self._mode, self.basis = copy.copy(mode), basis
        earlier: LimitStateSurrogate | None = None
        if previous is not None and previous.basis.shape == basis.shape and np.allclose(previous.basis, basis):
            earlier = previous.surrogate
        self.surrogate: LimitStateSurrogate = LimitStateSurrogate(
            u @ basis, margins[:, None], _identity, _nearness(margins), earlier, reselect or earlier is None
        )

    def score(self) -> float:
        """Mean logarithm of the density of prediction."""
        return self.surrogate.score()

    def standardised(self, u: np.ndarray) -> np.ndarray:
        """Predicted limit state over the size of its error, (n,); infinite far from the mode."""
        near = isNear(self._mode, u)
        standardised = np.full(len(u), np.inf)
        if near.any():
            value, scale = self.surrogate.limitState(self.surrogate.reduce(u[near] @ self.basis))
            standardised[near] = value / scale
        return standardised

    def errors(self, u: np.ndarray, margins: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Errors of known values (n,), over their size, and this size, on the scale that the surrogate is fitted on."""
        value, size = self.surrogate.predictBoth(self.surrogate.reduce(u @ self.basis))
        return ((self.surrogate.targets(margins[:, None]) - value) / size)[:, 0], size[:, 0]

    def logLikelihood(self, u: np.ndarray, margins: np.ndarray) -> np.ndarray:
        """Logarithm (n,) of the density of values; a large error counts as one that is excluded."""
        errors, size = self.errors(u, margins)
        link = self.surrogate.link
        logSlope = 0.0 if link is None else link.logSlope(margins)
        return logSlope - np.log(size) - 0.5 * np.minimum(np.abs(errors), _EXCLUDED) ** 2


class ModeSurrogates:
    """Surrogates of all modes.

    Attributes
    ----------
    parts : list of ModeSurrogate or None
        One for each mode; None where its runs are too few.
    """

    def __init__(self) -> None:
        self.parts: list[ModeSurrogate | None] = []
        self._calibrations: list[Calibration] = []
        self._selectedAt = 0

    def fit(self, runs: Runs, modes: list[FailureMode]) -> None:
        """Fit to all runs that have a value and belong to one mode."""
        rows = np.flatnonzero(runs.finite & (runs.phases != "search"))
        u, margins = runs.u[rows], runs.margins[rows]
        if len(self.parts) != len(modes):
            self.parts, self._calibrations = [None] * len(modes), [Calibration() for _ in modes]
            self._selectedAt = 0
        belongs = self._assign(u, margins, modes)
        reselect = len(rows) >= (1.0 + _RESELECTION) * self._selectedAt
        if reselect:
            self._selectedAt = len(rows)
        for k, mode in enumerate(modes):
            own = belongs == k
            part = self.parts[k] = self._fitOne(mode, u[own], margins[own], self.parts[k], reselect)
            if part is not None:
                part.surrogate.calibration *= self._calibrations[k].factors()

    @staticmethod
    def _fitOne(mode, u, margins, previous, reselect):
        n, d = u.shape
        if n < _LEAST_RUNS + _LEAST_RUNS_OF_INPUT * mode.basis.shape[1] or np.ptp(margins) == 0.0:
            return None
        ofAll = n >= _LEAST_RUNS + _LEAST_RUNS_OF_INPUT * d
        if previous is not None and not reselect:
            return ModeSurrogate(mode, previous.basis, u, margins, previous, False)
        part = ModeSurrogate(mode, mode.basis, u, margins, previous)
        if ofAll:
            whole = ModeSurrogate(mode, np.eye(d), u, margins, previous)
            part = whole if whole.score() > part.score() else part
        return part

    def _assign(self, u, margins, modes):
        """The mode (n,) of each run: which draws it most often, and whose surrogate, where all have one, has its value;
        -1 where none does clearly, or where it is near none."""
        logs = np.log(np.maximum(membership(modes, u), 1e-300))
        near = np.column_stack([isNear(mode, u) for mode in modes])
        logs[~near] = -np.inf
        if len(self.parts) == len(modes) and all(part is not None for part in self.parts):
            for k, part in enumerate(self.parts):
                logs[:, k] += part.logLikelihood(u, margins)
        best = logs.argmax(axis=1)
        others = logs.copy()
        others[np.arange(len(u)), best] = -np.inf
        highest = logs.max(axis=1)
        clear = others.max(axis=1, initial=-np.inf) < highest + math.log(_BESIDE)
        return np.where(np.isfinite(highest) & clear, best, -1)

    def judge(self, runs: Runs, modes: list[FailureMode]) -> None:
        """Note how far runs that are not yet learnt are from their predictions."""
        belongs = self._assign(runs.u, runs.margins, modes)
        for k, (part, calibration) in enumerate(zip(self.parts, self._calibrations, strict=True)):
            own = runs.finite & (belongs == k)
            if part is None or not own.any():
                continue
            errors, _ = part.errors(runs.u[own], runs.margins[own])
            calibration.add((errors * calibration.factors())[:, None], _nearness(runs.margins[own]))

    def standardised(self, u: np.ndarray) -> np.ndarray:
        """Predicted limit state over the size of its error, (n, number of modes); infinite without a surrogate."""
        infinite = np.full(len(u), np.inf)
        return np.column_stack([infinite if part is None else part.standardised(u) for part in self.parts])

    def failure(self, u: np.ndarray) -> np.ndarray:
        """Probability of failure at points (n, d), (n,)."""
        return _union(self.standardised(u), 1.0)


def isNear(mode: FailureMode, u: np.ndarray) -> np.ndarray:
    """Whether points (n, d) are near a mode, (n,)."""
    return mode.logRatio(u) + math.log(max(mode.mass, 1e-300)) > _NEAR


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
        self.surrogates.parts = list(surrogates.parts)
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
