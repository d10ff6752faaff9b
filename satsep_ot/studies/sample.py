"""The Monte Carlo sample of a study: its runs, what they gave, and its inputs drawn again from a seed."""

import dataclasses
import hashlib
import time
from collections.abc import Callable
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.dynamics.kernels.deck import PENETRATION_LIMIT
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.methods.common.storage import syncDirectory
from satsep_ot.methods.parallel.monte_carlo_stream import MonteCarloStream
from satsep_ot.methods.parallel.processor import processorDescription
from satsep_ot.model.case import SYSTEM
from satsep_ot.model.separation_function import NEVER_FREE, SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.openturns_adapter import toXML
from satsep_ot.studies.telling.plain_data import dataclass_from_plain

# Runs of the Monte Carlo sample that are drawn from one seed.
BLOCK = 1024
# The outputs of so many runs are kept in a file: about 100 bytes a run.
LARGEST_FILE = 10_000_000
# No requirement has this name, which is longer than any.
COUNTED_RUNS = "the satellite does not come off " + "." * 200


@dataclasses.dataclass(frozen=True)
class SampleLimit:
    """A requirement as the sample sees it: the column of its quantity, and the limit."""

    column: int
    is_maximum: bool
    limit: float
    center: float | None = None

    def violated(self, outputs: np.ndarray) -> np.ndarray:
        """Whether each of the outputs (n, q) violates it, shape (n,)."""
        values = outputs[:, self.column]
        values = values if self.center is None else np.abs(values - self.center)
        return values > self.limit if self.is_maximum else values < self.limit


@dataclasses.dataclass(frozen=True)
class SampleSummary:
    """What the Monte Carlo sample of a study gave, and what its inputs can be drawn again from.

    Attributes
    ----------
    seconds : float
        That the runs took.
    size, seed : int
        Number of runs; seed of the first block.
    first_block : str
        Digest of the inputs of the first block.
    distribution : str
        Of the inputs, as XML.
    mean, deviation : tuple of float
        Of each output.
    violations : dict of str to int
        Runs that violate each requirement, and any of them.
    limits : dict of str to SampleLimit
        By requirement.
    inputs, outputs : tuple of str
        Their names with units.
    processors : tuple of str
        Of this process and of the workers that made the runs, with versions.
    sunk : int
        Runs in which the satellite sinks into the deck or, with contact, does not come free: they violate every
        requirement.
    touched : float or None
        Share of the runs in which the bodies touched each other; None without contact, or where no file was kept.
    """

    seconds: float
    size: int
    seed: int
    first_block: str
    distribution: str
    mean: tuple[float, ...]
    deviation: tuple[float, ...]
    violations: dict[str, int]
    limits: dict[str, SampleLimit]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    sunk: int = 0
    touched: float | None = None
    processors: tuple[str, ...] = ()

    @staticmethod
    def from_plain(data: dict[str, Any]) -> "SampleSummary":
        """From what stands in steps/sample.json, also as version 0.1.0 wrote it."""
        if "first block" in data:
            columns = {label.rpartition(" [")[0]: column for column, label in enumerate(data["outputs"])}
            limits = {
                name: {"column": columns[quantity], "is_maximum": is_maximum, "limit": limit}
                for name, (quantity, is_maximum, limit) in data["limits"].items()
            }
            data = {**data, "first_block": data["first block"], "limits": limits}
        return dataclass_from_plain(SampleSummary, data)


def run_sample(
    problem: SeparationProblem,
    size: int,
    start: Callable[[], None],
    path: Path,
    checkpoint: Path | None = None,
    executor: Executor | Callable[[], Executor] | None = None,
    progress: Callable[[str, float], None] = lambda label, share: None,
    mixed: bool = False,
) -> SampleSummary:
    """Make the Monte Carlo runs of a study.

    Parameters
    ----------
    problem : :class:`satsep_ot.model.separation_problem.SeparationProblem`
    size : int
        Number of runs.
    start : callable
        Sets the seed of OpenTURNS' generator.
    path : :class:`pathlib.Path`
        The file for the outputs, which is written where the sample is not too large.
    checkpoint : :class:`pathlib.Path`, optional
        The file from which an interrupted sample is continued.
    executor : Executor or callable, optional
        As for :meth:`satsep_ot.methods.parallel.monte_carlo_stream.MonteCarloStream.setExecutor`.
    progress : callable
        Called with what is being done and the share of it that is done.
    mixed : bool
        Whether workers may differ from this process in processor and versions.

    Returns
    -------
    summary : SampleSummary
    """
    case, distribution = problem.getCase(), problem.getDistribution()
    model = SeparationFunction(case, countsEndings=True)
    counted = ("deck_height", ot.Less(), -1e3 * PENETRATION_LIMIT)
    if case.separation.has_contact():
        counted = ("last_contact", ot.Less(), 0.5 * NEVER_FREE)
    stream = MonteCarloStream(model, distribution, size)
    stream.setEvents(
        {
            entry.name: (entry.quantity, ot.Greater() if entry.is_maximum else ot.Less(), entry.limit, entry.center)
            for entry in problem.getRequirements()
        }
        | {COUNTED_RUNS: counted}
    )
    stream.setBlockSize(BLOCK)
    stream.setExecutor(executor)
    scheduler = stream.getScheduler()
    scheduler.setMeasuredTimeout()
    scheduler.setProcessors([processorDescription()])
    scheduler.setMixedProcessorsAllowed(mixed)
    if size <= LARGEST_FILE:
        stream.setOutputFile(path)
    if checkpoint is not None:
        stream.setCheckpointFile(checkpoint)
    label = f"{size:,} Monte Carlo runs"
    stream.setProgressCallback(lambda percentage: progress(label, 0.01 * percentage))
    progress(label, 0.0)
    begin = time.perf_counter()
    start()
    # The number that the stream, too, begins with.
    seed = ot.RandomGenerator.IntegerGenerate(2**31 - 1)
    start()
    stream.run()
    result = stream.getResult()
    if checkpoint is not None:
        # The file has its name before the step is called finished.
        syncDirectory(path.parent)
    columns = list(quantity_table(case.separation))
    return SampleSummary(
        seconds=time.perf_counter() - begin,
        size=size,
        seed=seed,
        first_block=inputs_digest(sample_inputs(distribution, seed, size, BLOCK)),
        distribution=toXML(distribution),
        mean=tuple(result.getMean()),
        deviation=tuple(result.getStandardDeviation()),
        violations={name: result.getEventNumber(name) for name in problem.getRequirementNames()}
        | {SYSTEM: result.getEventNumber()},
        sunk=result.getEventNumber(COUNTED_RUNS),
        touched=_touched(path, model) if case.separation.has_contact() else None,
        limits={
            entry.name: SampleLimit(columns.index(entry.quantity), entry.is_maximum, entry.limit, entry.center)
            for entry in problem.getRequirements()
        },
        inputs=tuple(model.getInputDescription()),
        outputs=tuple(model.getOutputDescription()),
        processors=tuple(scheduler.getProcessors()),
    )


def _touched(path, model):
    """The share of the runs in a file of outputs in which something touched."""
    if not path.exists():
        return None
    names = [label.rpartition(" [")[0] for label in model.getOutputDescription()]
    outputs = np.load(path, mmap_mode="r", allow_pickle=False)
    return float(np.mean(outputs[:, names.index("last_contact")] != 0.0))


def sample_inputs(distribution: ot.Distribution, seed: int, total: int, size: int) -> np.ndarray:
    """The inputs of the first runs of a Monte Carlo sample of a study.

    Parameters
    ----------
    distribution : :class:`openturns.Distribution`
    seed : int
        Of the first block; the next one has the next number.
    total, size : int
        Runs of the whole sample, and how many of them.

    Returns
    -------
    inputs : ndarray, shape (size, d)
    """
    state = ot.RandomGenerator.GetState()
    blocks = [np.empty((0, distribution.getDimension()))]
    try:
        for first in range(0, min(size, total), BLOCK):
            ot.RandomGenerator.SetSeed((seed + first // BLOCK) % 2**32)
            blocks.append(np.array(distribution.getSample(min(BLOCK, total - first))))
    finally:
        ot.RandomGenerator.SetState(state)
    return np.concatenate(blocks)[:size]


def inputs_digest(inputs: Any) -> str:
    """SHA-256 of an array's numbers, in hexadecimal digits."""
    return hashlib.sha256(np.ascontiguousarray(inputs, dtype="<f8").tobytes()).hexdigest()
