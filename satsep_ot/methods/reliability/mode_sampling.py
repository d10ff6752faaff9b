"""Importance sampling around failure modes that exploration has found: for series systems, steps, corners, and whatever
a smooth surrogate does not follow.

Wide runs look in all directions. From each failure that no known mode explains, a search follows the limit to its
likeliest point there, by gradients where the function has slopes and by chains of failures where it has none. Runs are
drawn from all modes together and weighted exactly; only whether they fail counts.
"""

import itertools
import math

import numpy as np

from satsep_ot.methods.reliability.audits import WideDesign, auditSpread
from satsep_ot.methods.reliability.estimate import Block, Estimate
from satsep_ot.methods.reliability.failure_modes import FailureMode, ModeProposal, explains, membership
from satsep_ot.methods.reliability.limit_search import DistantPlanes, LimitSearch, isPlane, orthonormalBasis
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.mixture import logSumExp
from satsep_ot.methods.reliability.mode_surrogates import PLAIN_SHARE, ModeSurrogates, SelectedProposal
from satsep_ot.methods.reliability.recorder import RunRecorder

# A failure whose weight exceeds the estimate by this factor was not expected there.
_LARGEST_WEIGHT = 10.0
# Failures of one block that are followed.
_FOLLOWED = 6
_NOMINAL_SHARES = (0.05, 0.3, 0.6, 0.9)
# From this probability on, crude Monte Carlo may be the better proposal.
_FREQUENT = 3e-3
_MINIMUM_BLOCKS = 3
# Shares of wide runs while audits are missing, and after.
_AUDIT_SHARE, _LATER_AUDIT_SHARE = 0.2, 0.08
# Surrogates that make the variance of a run smaller than by this factor are used.
_HELPFUL = 0.5
# Their probability is not believed where it differs from the estimate by more than this factor.
_BELIEVED = 3.0
# Spreads of wide runs while no failure is known, and the runs, and their share of all, after which these are given up.
_SPREADS = (2.0, 3.0, 4.0, 1.5, 2.5, 3.5)
_FRUITLESS_RUNS, _FRUITLESS_SHARE = 1500, 0.3


class ModeSampling:
    """The state of the importance sampling of one run.

    Parameters
    ----------
    recorder : RunRecorder
    limitState : LimitStateEvent
    generator : :py:class:`numpy.random.Generator`
    wideDesign : WideDesign
    target : float
        Coefficient of variation.
    maximumEvaluations : int
    audits, audited : int
        Wide runs without which no estimate has converged, and those made before.

    Attributes
    ----------
    search : LimitSearch
    modes : list of FailureMode
    blocks : list of Block
        Those of the estimate: the ones since the last mode was found.
    audited : int
        Wide runs made.
    spread : float
        Standard deviation of the last of them.
    audits : int
        Wide runs that are needed.
    unresolved : int
        Failures that no mode explains and that the runs left did not suffice to follow.
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
        audited: int,
    ) -> None:
        self.search = LimitSearch(recorder, limitState, generator)
        self._recorder = recorder
        self._generator, self._wideDesign = generator, wideDesign
        self._target, self._maximum = target, maximumEvaluations
        self.audits = audits
        self._dimension = limitState.dimension
        self._distantPlanes = DistantPlanes()
        self.modes: list[FailureMode] = []
        self.blocks: list[Block] = []
        self.audited, self.spread, self.unresolved = audited, 2.0, 0
        self._all: list[tuple[Block, ModeProposal | SelectedProposal]] = []
        self._surrogates = ModeSurrogates()
        self._surrogatesHelp = False
        # All failures of the blocks, with weights by the mixture of their proposals.
        self._failures: tuple[np.ndarray, np.ndarray] | None = None

    # Finding modes. --------------------------------------------------------------------------------------------------

    def explore(self, failures: np.ndarray) -> bool:
        """Find modes from known failures (n, d), and by wide runs where there are none; False where none was found."""
        limit = min(_FRUITLESS_RUNS, _FRUITLESS_SHARE * self._maximum)
        for spread in itertools.cycle(_SPREADS):
            if len(failures) > 0 or self._recorder.used() > limit:
                break
            runs = self._recorder.explore(self._wideDesign.draw(min(40, self._left()), spread), "exploration")
            failures = runs.u[runs.failed]
        self._followAll(failures, 0.0)
        return bool(self.modes)

    def _left(self):
        return self._maximum - self._recorder.used()

    def _explainsOne(self, point):
        return bool(explains(self.modes, point[None])[0])

    def _follow(self, u, probability):
        """From a failure to its mode. True where the modes have changed."""
        search, d = self.search, self._dimension
        if self._left() < 3 * d + 60:
            self.unresolved += 1
            return False
        inside = search.bisect(np.zeros(d), u, 7)
        if self._explainsOne(inside):
            return False
        known = self._inKnownSubspace(inside)
        if known is not None:
            return known
        inside, normals = search.approachDesignPoint(inside, self._explainsOne)
        plane = isPlane(inside, normals)
        if not plane and not self._explainsOne(inside):
            # From where failures are likely the limit may look simpler.
            inside, _ = search.descend(inside, 12)
            inside, normals = search.approachDesignPoint(search.bisect(np.zeros(d), inside, 6), self._explainsOne)
            plane = isPlane(inside, normals)
        if self._explainsOne(inside):
            return False
        if plane:
            basis = orthonormalBasis([normals[-1], *normals[:-1]], 4, 0.2)
        else:
            # An intersection, a step, a band: the chain's mean shows directions in which the limit is flat.
            last, chain = search.descend(inside, 30)
            basis = orthonormalBasis([*normals[::-1], chain[len(chain) // 3 :].mean(axis=0)], 4, 0.35)
            inside = basis @ (basis.T @ last)
            inside = search.designPoint(basis, inside) if search.fails(inside[None])[0] else last
        point = basis @ (basis.T @ inside)
        distance = float(np.linalg.norm(point))
        if self._distantPlanes.takes(inside, normals, probability):
            return False
        if self._explainsOne(point * (1.0 + 0.1 / max(distance, 0.3))):
            return False
        self._add(FailureMode.at(point, basis, compact=not plane))
        return True

    def _inKnownSubspace(self, inside):
        """Whether a failure belongs to the subspace of a known mode: True where it adds a point, None where not."""
        for mode in self.modes:
            if mode.basis.shape[1] < 2:
                continue
            outside = inside - mode.basis @ (mode.basis.T @ inside)
            if self.search.fails(outside[None])[0]:
                continue
            point = mode.basis @ (mode.basis.T @ inside)
            distance = np.linalg.norm(point)
            if distance < 0.6 * np.linalg.norm(inside) and distance < mode.radius:
                continue
            point *= (max(distance, mode.radius) + 0.1) / distance
            if self.search.fails(point[None])[0]:
                point = self.search.bisect(np.zeros(self._dimension), point, 5)
                if self._explainsOne(1.02 * point):
                    return False
                mode.addPoint(point)
                return True
        return None

    def _add(self, new):
        """A new mode, or part of one that the same curved limit belongs to: the arc between their points fails."""
        a = new.points[0]
        for old in self.modes:
            b = max(old.points, key=lambda x: float(x @ a) / np.linalg.norm(x))
            first, second = float(np.linalg.norm(a)), float(np.linalg.norm(b))
            cosine = float(a @ b) / (first * second)
            if cosine < -0.9:
                continue
            middle = a / first + b / second
            middle *= (max(first, second) + 0.15 + 0.1 * abs(first - second)) / np.linalg.norm(middle)
            if math.acos(min(cosine, 1.0)) < 0.5 or self.search.fails(middle[None])[0]:
                old.merge(new)
                return
        self.modes.append(new)

    # Blocks. ---------------------------------------------------------------------------------------------------------

    def makeBlock(self) -> Estimate:
        """Draw a block, learn from it, and follow what it shows: the estimate with it."""
        probability = Estimate(self.blocks).probability if self.blocks else sum(mode.mass for mode in self.modes)
        proposal = self._propose(probability)
        size = self._recorder.blockSize(max(60, int(0.15 * self._recorder.used())))
        u, parts = proposal.sample(size, self._generator)
        # Wide runs last: they may have no value.
        order = np.argsort(parts == 1, kind="stable")
        u, parts = u[order], parts[order]
        start, known = len(self._recorder), self._recorder.used()
        pieces = []
        if (parts != 1).any():
            pieces.append(self._recorder.evaluate(u[parts != 1], "estimation"))
        if (parts == 1).any():
            pieces.append(self._recorder.explore(u[parts == 1], "audit"))
        runs = Runs.concatenate(pieces)
        runs.weights[:] = np.exp(-proposal.logRatio(u))
        if isinstance(proposal, SelectedProposal):
            runs.expected[:] = self._surrogates.failure(u)
            variance = proposal.runVariance()
            block = Block(runs, start, known, variance, proposal.probability, proposal.poolVariance, proposal)
        else:
            block = Block(runs, start, known, self._predictVariance(proposal, probability))
        self.blocks.append(block)
        self._judgeSurrogates(runs)
        self._all.append((block, proposal))
        self.audited += int(np.count_nonzero(parts == 1))
        for k, mode in enumerate(self.modes):
            mode.given += int(np.count_nonzero(parts == k + 2))
        estimate = Estimate(self.blocks)
        self._learn()
        self._surrogates.fit(self._recorder.runs(), self.modes)
        surprising = runs.failed & ((parts == 1) | (runs.weights > _LARGEST_WEIGHT * estimate.probability))
        self._followAll(runs.u[surprising], estimate.probability)
        return estimate

    def _propose(self, probability):
        wide = _AUDIT_SHARE if self.audited < self.audits else _LATER_AUDIT_SHARE
        if self._surrogatesHelp:
            wide = wide / PLAIN_SHARE
        self.spread = auditSpread(probability)
        shares = _NOMINAL_SHARES if probability > _FREQUENT and self._failures is not None else _NOMINAL_SHARES[:1]
        proposals = [
            ModeProposal(self.modes, self._wideDesign, self.spread, min(share, 0.98 - wide), wide, self._generator)
            for share in shares
        ]
        best = min(proposals, key=lambda proposal: self._predictVariance(proposal, probability))
        if not self._surrogatesHelp:
            return best
        selected = SelectedProposal(best, self._surrogates, self._target, self._generator)
        believed = probability / _BELIEVED < selected.probability < _BELIEVED * probability
        return selected if believed else best

    def _judgeSurrogates(self, runs):
        """Whether the surrogates, which have not learnt these runs, would have made their variance much smaller."""
        if not self._surrogates.parts:
            return
        self._surrogates.judge(runs, self.modes)
        squares = runs.weights**2
        corrections = runs.failed - self._surrogates.failure(runs.u)
        self._surrogatesHelp = bool(squares @ corrections**2 < _HELPFUL * (squares @ runs.failed))

    def _predictVariance(self, proposal, probability):
        """Variance of one run of a proposal, by the failures known before it."""
        if self._failures is None:
            return 10.0 * probability**2
        u, weights = self._failures
        second = float(weights @ np.exp(-proposal.logRatio(u)))
        return max(second - probability**2, 0.3 * probability**2)

    def _learn(self):
        """Each mode follows the failures of all blocks that belong to it."""
        u = np.concatenate([block.runs.u[block.runs.failed] for block, _ in self._all])
        if len(u) < 5:
            return
        total = sum(block.size for block, _ in self._all)
        logs = [math.log(block.size / total) + proposal.logRatio(u) for block, proposal in self._all]
        weights = np.exp(-logSumExp(np.column_stack(logs))) / total
        self._failures = u, weights
        belongs = membership(self.modes, u)
        for k, mode in enumerate(self.modes):
            mode.learn(u, weights * belongs[:, k], self._generator)

    def _followAll(self, failures, probability):
        """Follow failures that no mode explains; a changed set of modes starts the estimate again."""
        changed, followed = False, 0
        for u in failures[np.argsort((failures**2).sum(axis=1))]:
            if followed == _FOLLOWED:
                break
            if not self._explainsOne(u):
                followed += 1
                changed |= self._follow(u, probability)
        if changed:
            self.blocks = []
            self._surrogatesHelp = False
            self._surrogates.fit(self._recorder.runs(), self.modes)

    def settle(self) -> bool:
        """Make the wide runs that are missing; whether the estimate lacks nothing that is known.

        All modes are known, none came lately, nothing is unresolved, and the tail of the weights is not too heavy.
        """
        missing = min(self.audits - self.audited, self._left())
        if self._settled() and missing > 0:
            runs = self._recorder.explore(self._all[-1][1].drawWide(missing), "audit")
            self.audited += missing
            self._followAll(runs.u[runs.failed], Estimate(self.blocks).probability)
        return self.settled

    @property
    def settled(self) -> bool:
        """Whether the estimate lacks nothing that is known, and all wide runs were made."""
        return self._settled() and self.audited >= self.audits

    def _settled(self):
        return (
            len(self.blocks) >= _MINIMUM_BLOCKS
            and self.unresolved == 0
            and not any(mode.young for mode in self.modes)
            and Estimate(self.blocks).hasLightTail(self._target)
        )
