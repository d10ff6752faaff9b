"""Importance sampling by a surrogate of the limit state that learns from every run.

Each block is drawn where the surrogate is unsure and where it fails, and corrects the surrogate's own probability. Wide
runs look in all directions for failures that the surrogate does not show.
"""

import dataclasses
import enum
import math

import numpy as np
from scipy.special import ndtr

from satsep_ot.methods.reliability.audits import WideDesign, auditSpread
from satsep_ot.methods.reliability.calibration import Calibration
from satsep_ot.methods.reliability.estimate import Block, Estimate
from satsep_ot.methods.reliability.limit_search import DistantPlanes, LimitSearch
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.low_fidelity import CorrectedSurrogate, LowFidelity
from satsep_ot.methods.reliability.proposal import Proposal, propose
from satsep_ot.methods.reliability.recorder import KNOWN, KNOWN_DRAWN, RunRecorder
from satsep_ot.methods.reliability.surrogate import FEW_INPUTS, LimitStateSurrogate

# Models are chosen anew when the runs have grown by this share.
_RESELECTION = 0.25
# Failing runs to which the surrogate gave less are hits: wide ones, and others.
_SMALLEST_EXPECTED, _SMALLEST_EXPECTED_PROPOSED = 1e-2, 1e-3
# The surrogate agrees with a limit where it fails so far beyond it and is safe so far before it; a hit in about the
# direction of one that was looked at is the same.
_BEYOND, _BEFORE, _SAME_DIRECTION = 0.25, 0.35, 0.9
# A surrogate that needs more runs than this, and has not become better for so many blocks, is left after so many runs
# and two for each input.
_DEAR_RUNS, _IDLE_BLOCKS, _PATIENCE = 2500, 4, 200
# A surrogate that shows no failure region is given up after so many runs, and four for each input.
_FRUITLESS_RUNS = 40
# Standard deviations within which surrogate and estimate agree, and beyond which they contradict each other.
_AGREEMENT, _CONTRADICTION = 3.0, 5.0
# Gain of a cheap model, in the mean log density of predictions, with which few first runs do.
_LARGE_GAIN = 1.9
# Gain with which it is kept, and with which it is taken up later.
_SAME_GAIN, _OTHER_GAIN = 0.1, 0.3
# After so many times the first runs it is not looked at any more whether a cheap model helps.
_UNDECIDED = 4
# Shares of wide runs while audits are missing, and after.
_AUDIT_SHARE, _LATER_AUDIT_SHARE = 0.4, 0.15


class Verdict(enum.Enum):
    """What the surrogate's sampling says after a block."""

    GOES_ON = "goes on"
    REACHED = "the target is reached"
    UNEXPLAINED = "failures that the surrogate does not explain"
    NO_REGION = "the surrogate shows no failure region"
    CONTRADICTED = "surrogate and true runs keep contradicting each other"
    DEAR = "the surrogate is too poor"


class SurrogateSampling:
    """The state of the sampling by a surrogate. Wide runs are learnt from where inputs are few: in many inputs their
    radius would swamp a fit.

    Parameters
    ----------
    recorder : RunRecorder
        With the first runs.
    limitState : LimitStateEvent
    generator : :py:class:`numpy.random.Generator`
    wideDesign : WideDesign
    target : float
        Coefficient of variation.
    maximumEvaluations : int
    audits : int
        Wide runs without which no estimate has converged.
    lowFidelity : LowFidelity, optional
    initialSize : int
        First runs of a surrogate that no cheap model helps.

    Attributes
    ----------
    surrogate : LimitStateSurrogate or None
        The last one that was fitted.
    blocks : list of Block
    audited : int
        Wide runs made.
    spread : float
        Standard deviation of the last of them.
    calibration : Calibration
        From the errors of prediction of the latest runs.
    """

    def __init__(
        self,
        recorder: RunRecorder,
        limitState: LimitStateEvent,
        generator: np.random.Generator,
        wideDesign: WideDesign,
        target: float,
        maximumEvaluations: int,
        audits: int,
        lowFidelity: LowFidelity | None = None,
        initialSize: int = 0,
    ) -> None:
        self._lowFidelity, self._initialSize = lowFidelity, initialSize
        self._cheap: np.ndarray | None = None
        self.search = LimitSearch(recorder, limitState, generator)
        self._recorder, self._limitState, self._generator = recorder, limitState, generator
        self._wideDesign = wideDesign
        self._target, self._maximum, self._audits = target, maximumEvaluations, audits
        self.surrogate: LimitStateSurrogate | None = None
        self._proposal: Proposal | None = None
        self.blocks: list[Block] = []
        self.audited, self.spread = 0, 2.0
        self.calibration = Calibration()
        self._selectedAt = 0
        self._weightWidth = math.nan
        self._leastWidth = 0.2 * float(recorder.runs().margins[recorder.runs().finite].std())
        # Failures that the surrogate did not expect, and the rows of all runs that ever were.
        self._hits: list[np.ndarray] = []
        self._noted: set[int] = set()
        self._distantPlanes = DistantPlanes()
        self._idle, self._contradicted, self._best = 0, 0, math.inf

    def step(self) -> Verdict:
        """Fit, propose, look whether this is the end, and make a block."""
        self._fit()
        proposal = self._propose()
        if proposal is None:
            return self._exploreLow()
        self._proposal = proposal
        self.spread = auditSpread(proposal.probability)
        if self.blocks and self._reaches(proposal):
            if self.audited < self._audits:
                self._audit(min(self._audits - self.audited, self._left()))
                return Verdict.GOES_ON
            return Verdict.REACHED if self._explainsHits() else Verdict.UNEXPLAINED
        needed = proposal.runsNeeded(self._target)
        self._idle = 0 if needed < 0.85 * self._best else self._idle + 1
        self._best = min(self._best, needed)
        patience = _PATIENCE + 2 * self._limitState.dimension
        estimate = Estimate(self.blocks) if self.blocks else None
        if (estimate is not None and len(self.blocks) > 3 and not self._agrees(estimate, proposal, _CONTRADICTION)) or (
            estimate is not None and estimate.coefficientOfVariation() <= self._target
        ):
            self._contradicted += 1
        else:
            self._contradicted = 0
        if self._contradicted > _IDLE_BLOCKS:
            return Verdict.CONTRADICTED
        if needed > _DEAR_RUNS and self._idle >= _IDLE_BLOCKS and self._recorder.used() > patience:
            return Verdict.DEAR
        self._makeBlock(proposal)
        return Verdict.GOES_ON

    def settle(self) -> bool:
        """Make the wide runs that are missing; whether the surrogate explains all failures."""
        if self.audited < self._audits:
            self._audit(min(self._audits - self.audited, self._left()))
        return self._explainsHits() and self.settled

    @property
    def settled(self) -> bool:
        """Whether no failure is known that the surrogate does not explain, and all wide runs were made."""
        return not self._hits and self.audited >= self._audits

    def _reaches(self, proposal):
        """Whether the estimate is as exact as wanted, its tail not too heavy, and the latest surrogate agrees with it.

        A surrogate that has just learnt of more than the blocks have seen has to confirm it first.
        """
        estimate = Estimate(self.blocks)
        return (
            len(self.blocks) > 1
            and self._agrees(estimate, proposal, _AGREEMENT)
            and estimate.coefficientOfVariation() <= self._target
            and estimate.hasLightTail(self._target)
        )

    @staticmethod
    def _agrees(estimate, proposal, deviations):
        """Whether the surrogate's probability lies within so many standard deviations of the estimate."""
        allowed = deviations * math.sqrt(estimate.variance + proposal.poolVariance)
        return estimate.probability > 0.0 and abs(proposal.probability - estimate.probability) <= allowed

    def _left(self):
        return self._maximum - self._recorder.used()

    # Learning. -------------------------------------------------------------------------------------------------------

    def _learningRuns(self):
        """Runs that surrogates are fitted to: no clusters of searches, and with many inputs no wide ones."""
        runs = self._recorder.runs()
        kept = runs.finite & (runs.phases != "search")
        if self._limitState.dimension > FEW_INPUTS:
            kept &= runs.phases != "audit"
        return runs, np.flatnonzero(kept)

    def _fit(self):
        runs, rows = self._learningRuns()
        margins = runs.margins[rows]
        # Near the limit the fit counts most; the width follows the runs towards it.
        self._weightWidth = max(float(np.median(np.abs(margins))), self._leastWidth)
        reselect = self._recorder.used() >= (1.0 + _RESELECTION) * self._selectedAt
        if reselect:
            self._selectedAt = self._recorder.used()
        data = (
            runs.u[rows],
            self._limitState.smooth(runs.outputs[rows]),
            self._limitState.surrogateMargin,
            1.0 / (1.0 + (margins / self._weightWidth) ** 2),
        )
        found, isCorrected = None, isinstance(self.surrogate, CorrectedSurrogate)
        if isCorrected or (reselect and self._recorder.used() <= _UNDECIDED * self._initialSize):
            found = self._fitCorrected(data, runs.u, rows, reselect)
        if found is None:
            missing = min(self._initialSize - self._recorder.used(), self._left() - 1)
            if missing > 0:
                self._recorder.evaluateNominal(missing, "learning")
                self._selectedAt = 0
                self._fit()
                return
            plain = None if isCorrected else self.surrogate
            found = LimitStateSurrogate(*data, plain, reselect=reselect)
        if self.surrogate is not None and type(self.surrogate) is not type(found):
            # Few large corrections of a poor model beside the small ones of a good one would make a heavy tail.
            self.blocks.clear()
        self.surrogate = found
        self.surrogate.calibration *= self.calibration.factors()

    def _fitCorrected(self, data, u, rows, reselect):
        """The surrogate from the cheap model; None where there is none, or it does not help."""
        if self._lowFidelity is None or self._limitState.complement or len(self._lowFidelity.failures) == 0:
            return None
        known = 0 if self._cheap is None else len(self._cheap)
        values = self._lowFidelity.values(u[known:])
        self._cheap = values if self._cheap is None else np.vstack([self._cheap, values])
        previous = self.surrogate if isinstance(self.surrogate, CorrectedSurrogate) else None
        # Blocks that were made by it are worth more than a better model.
        decided = previous is not None and self._recorder.used() > _UNDECIDED * self._initialSize
        found = CorrectedSurrogate(*data, self._lowFidelity, self._cheap[rows], previous, reselect, decided)
        least = _OTHER_GAIN if previous is None else _SAME_GAIN
        if self._recorder.used() < self._initialSize:
            least = _LARGE_GAIN
        return found if decided or found.gain() > least else None

    def _keepErrors(self, runs, calibration):
        rows = runs.finite
        y = self.surrogate.reduce(runs.u[rows])
        errors = self.surrogate.predictionErrors(y) / calibration
        targets = self.surrogate.targets(self._limitState.smooth(runs.outputs[rows]))
        standardised = (targets - self.surrogate.predict(y)) / errors
        weights = 1.0 / (1.0 + (runs.margins[rows] / self._weightWidth) ** 2)
        self.calibration.add(standardised, weights)

    # Runs. -----------------------------------------------------------------------------------------------------------

    def _propose(self):
        """Where to run next; None where the surrogate shows no failure region."""
        # A new choice of models is searched anew: it may show regions that the earlier ones did not.
        anew = self._selectedAt == self._recorder.used()
        for previous in (None, self._proposal) if anew else (self._proposal, None):
            proposal = propose(self.surrogate, self._target, self._generator, self._withNonFinite, previous)
            if proposal is not None:
                return proposal
        return None

    def _withNonFinite(self, failure):
        """The probability of failure where some runs have no finite value, which the surrogate knows nothing of."""
        count = self._limitState.nonFiniteNumber
        if count == 0:
            return failure
        share = count / self._recorder.used()
        return failure * (1.0 - share) + share * self._limitState.failsWhereNotFinite()

    def _size(self):
        return self._recorder.blockSize(max(8, int(0.12 * self._recorder.used())))

    def _exploreLow(self):
        """Runs where a surrogate without a failure region is lowest."""
        if self._recorder.used() > _FRUITLESS_RUNS + 4 * self._limitState.dimension:
            return Verdict.NO_REGION
        u = 1.5 * self._generator.standard_normal((2000, self._limitState.dimension))
        value, _ = self.surrogate.limitState(self.surrogate.reduce(u), exact=False)
        size = self._size()
        chosen = self._generator.choice(np.argsort(value)[: max(100, 4 * size)], size, replace=False)
        runs = self._recorder.explore(u[chosen], "exploration")
        self._keepErrors(runs, self.calibration.factors())
        return Verdict.GOES_ON

    def _makeBlock(self, proposal):
        size = self._size()
        share = _AUDIT_SHARE if self.audited < self._audits else _LATER_AUDIT_SHARE
        if self._limitState.dimension > FEW_INPUTS and not (self.blocks and self._nearlyReached()):
            # In many inputs nothing is learnt from wide runs: they wait until the estimate is worth them.
            share = 0.1
        wide = min(max(round(size * share + self._generator.random() - 0.5), 1), max(size - 2, 0))
        u, chosen, weights = proposal.draw(size - wide, self._generator)
        start = len(self._recorder)
        # Of the error of a cheap model little can be learnt: the first blocks are worth as much as later ones.
        isCorrected = isinstance(self.surrogate, CorrectedSurrogate)
        known = self._initialSize if isCorrected else self._recorder.used()
        calibration = self.calibration.factors()
        runs = self._recorder.evaluate(u, "estimation")
        runs = dataclasses.replace(runs, weights=weights, expected=proposal.failure[chosen])
        self.blocks.append(
            Block(runs, start, known, proposal.runVariance(), proposal.probability, proposal.poolVariance, proposal)
        )
        self._keepErrors(runs, calibration)
        self._noteHits(start + np.flatnonzero(runs.failed & (runs.expected < _SMALLEST_EXPECTED_PROPOSED)))
        if wide:
            self._audit(wide)

    def _nearlyReached(self):
        return Estimate(self.blocks[-3:]).coefficientOfVariation() < 0.4

    def _audit(self, size):
        # Where the surrogate expects failures, another failure region could not be told from its own.
        start = len(self._recorder)
        wide = self._wideDesign.drawWhere(lambda u: self._failure(u) < 0.5, size, self.spread)
        runs = self._recorder.explore(wide, "audit")
        self.audited += size
        if self._limitState.dimension <= FEW_INPUTS:
            self._keepErrors(runs, self.calibration.factors())
        self._noteHits(start + np.flatnonzero(runs.failed & (self._failure(runs.u) < _SMALLEST_EXPECTED)))

    # Hits. -----------------------------------------------------------------------------------------------------------

    def _failure(self, u):
        """The surrogate's probability of failure at points (n, d)."""
        value, scale = self.surrogate.limitState(self.surrogate.reduce(u))
        return self._withNonFinite(ndtr(-value / scale))

    def _noteHits(self, rows):
        """Failures at these rows of the recorded runs are hits, each of them once."""
        u = self._recorder.runs().u
        self._hits += [u[row] for row in rows if row not in self._noted]
        self._noted.update(rows.tolist())

    def _explainsHits(self):
        """Whether the surrogate has the limit right behind every hit.

        It is looked at where failures are likeliest: that a surrogate gives a run that it has learnt its own label
        proves nothing.
        """
        runs = self._recorder.runs()
        rows = np.flatnonzero(runs.failed & np.isin(runs.phases, ("estimation", KNOWN, KNOWN_DRAWN)))
        self._noteHits(rows[self._failure(runs.u[rows]) < _SMALLEST_EXPECTED_PROPOSED])
        seen: list[np.ndarray] = []
        for u in sorted(self._hits, key=lambda hit: float(hit @ hit)):
            if any(float(u @ point) > _SAME_DIRECTION * np.linalg.norm(u) * np.linalg.norm(point) for point in seen):
                continue
            if self._left() < 2 * len(u) + 40:
                return False
            point = self.search.bisect(np.zeros(len(u)), u, 5)
            if len(u) <= FEW_INPUTS or self._failure(point[None])[0] < _SMALLEST_EXPECTED:
                point, normals = self.search.approachDesignPoint(point)
                distance = np.linalg.norm(point)
                if self._distantPlanes.takes(point, normals, self._proposal.probability):
                    continue
                points = point * (1.0 + np.array([[-_BEFORE], [_BEYOND]]) / distance)
                before, beyond = self._failure(points)
                if before > 0.5 or beyond < 0.5 or not self._proposal.reaches(points[1:])[0]:
                    return False
            seen += [u, point]
        self._hits = []
        return True

    def failures(self) -> np.ndarray:
        """Failures known so far, (n, d)."""
        runs: Runs = self._recorder.runs()
        return runs.u[runs.failed]
