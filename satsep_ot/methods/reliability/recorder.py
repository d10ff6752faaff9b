"""True runs made in blocks and kept, whatever algorithm asks for them."""

import numpy as np
import openturns as ot

from satsep_ot.methods.common.run_log import IncompleteBlockError
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.settings import ReliabilitySettings
from satsep_ot.openturns_adapter import errorMessage, raiseInterrupt

# Phases of runs that were there before.
KNOWN, KNOWN_DRAWN = "known", "known, drawn"
# Densities that differ by less are one.
_SAME_DENSITY = 1e-9


class Stopped(Exception):
    """The stop callback asked to end."""


class RunRecorder:
    """Makes true runs in blocks, counts them by phase, keeps them, and serves the callbacks after each block.

    Parameters
    ----------
    limitState : LimitStateEvent
    settings : ReliabilitySettings
    generator : :py:class:`numpy.random.Generator`

    Attributes
    ----------
    blocks : list of Runs
        All true runs, block by block.
    nominal : list of Runs
        Those of them that are draws of the inputs' own distribution, whatever earlier runs gave: a crude Monte Carlo
        sample, which bounds what was not seen.
    phases : dict of str to int
        Evaluations of each phase.
    """

    def __init__(
        self, limitState: LimitStateEvent, settings: ReliabilitySettings, generator: np.random.Generator
    ) -> None:
        self._limitState = limitState
        self._settings = settings
        self._generator = generator
        self.blocks: list[Runs] = []
        self.nominal: list[Runs] = []
        self.phases: dict[str, int] = {}

    def __len__(self) -> int:
        return sum(map(len, self.blocks))

    def used(self) -> int:
        """Evaluations of all phases."""
        return sum(self.phases.values())

    def remaining(self) -> int:
        """Evaluations that are left."""
        return self._settings.maximumEvaluations - self.used()

    def blockSize(self, least: int) -> int:
        """Runs of the next block: so many, or as many as the user asks for, as far as evaluations are left."""
        return min(max(least, self._settings.blockSize or 1), self.remaining())

    def runs(self) -> Runs:
        """All true runs in their order."""
        return Runs.concatenate(self.blocks)

    def samples(self) -> tuple[ot.Sample, ot.Sample] | None:
        """Inputs and outputs of all true runs, under their names; None where there are none."""
        if not self.blocks:
            return None
        runs = self.runs()
        inputs, outputs = ot.Sample(runs.x), ot.Sample(runs.outputs)
        inputs.setDescription(self._limitState.distribution.getDescription())
        outputs.setDescription(self._limitState.function.getOutputDescription())
        return inputs, outputs

    def evaluate(self, u: np.ndarray, phase: str) -> Runs:
        """True runs at points (n, d) of standard space.

        Raises
        ------
        ValueError
            An output is not finite, and the policy is to raise.
        RuntimeError
            The function failed; the message says in which phase and how many runs are kept. Where it fails in some
            runs of a block only, the others are kept.
        Stopped
            The stop callback asked for it; the runs are kept.
        """
        runs = self._make(u, phase)
        self._serveCallbacks()
        return runs

    def explore(self, u: np.ndarray, phase: str) -> Runs:
        """True runs at points (n, d) that may be far from where inputs are likely.

        A run in which the function fails, or which is not finite, counts as unknown, and as safe; where the policy for
        runs that are not finite is another one than to raise, these follow it.

        Raises
        ------
        Stopped
            The stop callback asked for it; the runs are kept.
        """
        runs = self._limitState.evaluate(u, phase, exploring=True)
        self._keep(runs, phase)
        self._serveCallbacks()
        return runs

    def evaluateNominal(self, size: int, phase: str) -> Runs:
        """So many true runs drawn from the distribution of the inputs itself."""
        runs = self._make(self._generator.standard_normal((size, self._limitState.dimension)), phase)
        self.nominal.append(runs)
        self._serveCallbacks()
        return runs

    def takeKnown(self, inputs: ot.Sample, outputs: ot.Sample, law: ot.Distribution | None) -> np.ndarray:
        """Runs that are there already, which count as no evaluations.

        Parameters
        ----------
        inputs, outputs : :py:class:`openturns.Sample`
        law : :py:class:`openturns.Distribution` or None
            What the inputs were drawn from, where it is known.

        Returns
        -------
        ratios : array (n,)
            Density of the inputs over that one; NaN where it is not known.

        Raises
        ------
        ValueError
            They, or their distribution, have other inputs or outputs, or an input is outside the range of the inputs'
            distribution.
        """
        x, y = np.array(inputs), np.array(outputs)
        size = self._limitState.function.getOutputDimension()
        if y.shape[1] != size:
            raise ValueError(f"the known runs have {y.shape[1]} outputs, the function {size}")
        self._limitState.space.refuseOutside(x)
        ratios = np.full(len(x), np.nan) if law is None else self.densityRatios(x, law)
        drawn = bool((np.abs(ratios - 1.0) < _SAME_DENSITY).all())
        phase = KNOWN_DRAWN if drawn else KNOWN
        runs = self._limitState.runsOf(self._limitState.space.toStandard(x), x, y, phase, exploring=True)
        self.blocks.append(runs)
        if drawn:
            self.nominal.append(runs)
        return ratios

    def densityRatios(self, x: np.ndarray, law: ot.Distribution) -> np.ndarray:
        """Density of the inputs over another one (n,), at physical points (n, d).

        Raises
        ------
        ValueError
            The other one has another dimension.
        """
        distribution = self._limitState.distribution
        if law.getDimension() != distribution.getDimension():
            raise ValueError(
                f"the known runs are of a distribution of dimension {law.getDimension()}, the inputs have "
                f"{distribution.getDimension()}"
            )
        own, other = (np.array(part.computeLogPDF(x))[:, 0] for part in (distribution, law))
        return np.exp(own - other)

    def takeComplement(self) -> None:
        """The runs so far, seen from the complement of the event."""
        for part in self.blocks:
            part.margins, part.failed = -part.margins, ~part.failed

    def checkComposition(self, runs: Runs) -> None:
        """Compare the composition of one of these runs with the event's own function, which is an evaluation more.

        Raises
        ------
        ValueError
            They differ.
        """
        if runs.finite.any():
            row = int(np.argmax(runs.finite))
            spread = float(np.ptp(runs.margins[runs.finite]))
            checked = self._limitState.checkComposition(runs.x[row], runs.margins[row], spread)
            if checked:
                self.phases["composition check"] = checked

    def _make(self, u, phase):
        try:
            runs = self._limitState.evaluate(u, phase)
        except ValueError:
            raise
        except IncompleteBlockError as error:
            before, done = len(self), error.done
            x = self._limitState.space.toPhysical(u[done])
            self._keep(self._limitState.runsOf(u[done], x, error.values[done], phase, exploring=True), phase)
            raise RuntimeError(
                f"the function failed in the phase {phase!r}; getRuns() has the other {np.count_nonzero(done)} runs of "
                f"the block and the {before} before it: {error}"
            ) from error
        except Exception as error:
            raiseInterrupt(error)
            kept = len(self)
            before = f"getRuns() still has the {kept} runs before it" if kept else "no run before it is there to keep"
            raise RuntimeError(
                f"the function failed in the phase {phase!r}, in a block of {len(u)} runs of which none is kept; "
                f"{before}: {errorMessage(error)}"
            ) from error
        self._keep(runs, phase)
        return runs

    def _keep(self, runs, phase):
        self.blocks.append(runs)
        self.phases[phase] = self.phases.get(phase, 0) + len(runs)

    def _serveCallbacks(self):
        settings = self._settings
        if settings.progressCallback is not None:
            settings.progressCallback(100.0 * self.used() / settings.maximumEvaluations)
        if settings.stopCallback is not None and settings.stopCallback():
            raise Stopped
