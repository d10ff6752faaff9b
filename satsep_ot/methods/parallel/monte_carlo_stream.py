"""Monte Carlo of any size in constant memory: runs are drawn, made and counted block by block, on any executor."""

import contextlib
import hashlib
import math
import os
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.methods.common.margins import thresholdMargin
from satsep_ot.methods.common.settings import setting
from satsep_ot.methods.parallel.block_summary import BlockSummary
from satsep_ot.methods.parallel.chunks import Chunk, Work
from satsep_ot.methods.parallel.function import FunctionWork, wrongResult
from satsep_ot.methods.parallel.scheduler import ChunkScheduler
from satsep_ot.methods.parallel.stream_storage import StreamProgress, openRowFile
from satsep_ot.openturns_adapter import raisingInterrupts
from satsep_ot.openturns_object import OpenTURNSObject

# Blocks that a worker makes at once.
_CHUNK_BLOCKS = 16
# Seeds of the blocks of one stream differ: OpenTURNS takes them modulo this.
_SEEDS = 2**32
# OpenTURNS has one random generator for all threads of a process. What holds it may run a stream of its own.
generatorLock = threading.RLock()


class _BlockWork:
    """Draws, makes and summarises some blocks: what a worker does."""

    def __init__(self, function, distribution, size, blockSize, seed, events, keeps):
        self.function, self.distribution, self.events, self.keeps = function, distribution, events, keeps
        self.size, self.blockSize, self.seed = size, blockSize, seed

    def __call__(self, argument):
        """Summaries, and the rows to be kept, of the blocks first to end - 1; a message in place of wrong values."""
        first, end, X = argument
        if X is None:
            X = np.concatenate([self.draw(block) for block in range(first, end)])
        values = self.function.evaluate(X)
        wrong = wrongResult(values, (len(X), self.function.function.getOutputDimension()))
        if wrong:
            return wrong
        summaries = [
            BlockSummary.of(values[start : start + self.blockSize], self.events)
            for start in range(0, len(X), self.blockSize)
        ]
        kept = {"none": None, "outputs": values}.get(self.keeps)
        return summaries, np.hstack([X, values]) if self.keeps == "both" else kept

    def draw(self, block):
        """The inputs of a block, from a seed of its own."""
        count = min(self.blockSize, self.size - block * self.blockSize)
        with generatorLock:
            state = ot.RandomGenerator.GetState()
            ot.RandomGenerator.SetSeed((self.seed + block) % _SEEDS)
            try:
                return np.array(self.distribution.getSample(count))
            finally:
                ot.RandomGenerator.SetState(state)


class MonteCarloStream(OpenTURNSObject):
    """Moments of a function's outputs and probabilities of events by any number of runs, in constant memory.

    Parameters
    ----------
    function : :py:class:`openturns.Function`, or what it can be made of
        As for :class:`~satsep_ot.methods.parallel.function.ParallelFunction`.
    inputs : :py:class:`openturns.Distribution`, array (N, n) or iterable of arrays (., n)
        Where the runs come from: drawn, or given; a memory map of a file and a generator need no memory either.
    size : int, optional
        Number of runs; an array has one of its own.

    Notes
    -----
    Blocks of runs are drawn one by one, each from a seed of its own, by the workers; the seeds follow from one number
    of ``ot.RandomGenerator``. What the blocks gave is merged in their order. The result depends on the block size
    and on the seed; to the last bit it does not depend on the executor, the number of workers or the chunk size.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.parallel.monte_carlo_stream import MonteCarloStream
    >>> ot.RandomGenerator.SetSeed(0)
    >>> stream = MonteCarloStream(ot.SymbolicFunction(["a", "b"], ["a + b"]), ot.Normal(2), 100000)
    >>> stream.setEvents({"large": (0, ot.Greater(), 4.0)})
    >>> stream.run()
    >>> result = stream.getResult()
    >>> round(result.getStandardDeviation()[0], 2), round(result.getProbabilityEstimate("large"), 3)
    (1.41, 0.002)
    """

    def __init__(
        self, function: Any, inputs: ot.Distribution | np.ndarray | Iterable[np.ndarray], size: int | None = None
    ) -> None:
        self._work = FunctionWork(function)
        dimension = self._work.function.getInputDimension()
        self._distribution: ot.Distribution | None = None
        self._rows: np.ndarray | Iterator[np.ndarray] | None = None
        if hasattr(inputs, "computeCDF"):
            self._distribution = ot.Distribution(inputs)
            found = self._distribution.getDimension()
        elif hasattr(inputs, "__len__"):
            self._rows = inputs if isinstance(inputs, np.ndarray) else np.asarray(inputs, dtype=float)
            found = self._rows.shape[1] if self._rows.ndim == 2 else None
            size = len(self._rows) if size is None else size
        else:
            self._rows, found = iter(inputs), dimension
        if found != dimension:
            raise ValueError(f"the inputs have dimension {found}, the function has {dimension} inputs")
        if size is None or int(size) != size or size < 1:
            raise ValueError(f"the number of runs is {size}; it must be a whole number of at least 1")
        if isinstance(self._rows, np.ndarray) and size > len(self._rows):
            raise ValueError(f"{size} runs are wanted of {len(self._rows)} rows")
        self._size = int(size)
        self._blockSize = int(setting("MonteCarloStream-BlockSize"))
        self._chunkSize: int | None = None
        self._events: dict[str, tuple[int, ot.ComparisonOperator, float, float | None]] = {}
        self._scheduler = ChunkScheduler()
        self._file: Path | None = None
        self._keeps = "none"
        self._checkpoint: Path | None = None
        self._progressCallback: Callable[[float], None] | None = None
        self._result: MonteCarloStreamResult | None = None

    def _shown(self):
        return {"size": self._size, "blockSize": self._blockSize, "events": list(self._events)}

    def setEvents(self, events: Mapping[str, tuple]) -> None:
        """Events to be counted.

        Parameters
        ----------
        events : dict of str to (output, operator, threshold) or (output, operator, threshold, center)
            With a center that is not None, the distance of the output from it is compared. An output is its index or
            its name, which may leave out the unit in brackets; an operator is
            :py:class:`openturns.Greater` or another comparison.

        Raises
        ------
        ValueError
            No output, or more than one, has this name; a threshold is not finite.
        """
        labels = list(self._work.function.getOutputDescription())
        found = {}
        for name, (output, operator, threshold, *more) in events.items():
            column = _outputColumn(labels, output)
            operator = ot.ComparisonOperator(operator)
            # Refuses a threshold that is not finite.
            thresholdMargin(operator, threshold)
            center = None if not more or more[0] is None else float(more[0])
            found[name] = (column, operator, float(threshold), center)
        self._events = found

    def setExecutor(self, executor: Executor | Callable[[], Executor] | None) -> None:
        """What runs the blocks, as for :class:`~satsep_ot.methods.parallel.function.ParallelFunction`."""
        self._scheduler = ChunkScheduler(executor)

    def getScheduler(self) -> ChunkScheduler:
        """The :class:`~satsep_ot.methods.parallel.scheduler.ChunkScheduler`, for time limit and attempts of a chunk."""
        return self._scheduler

    def setBlockSize(self, size: int) -> None:
        """Runs of a block (default 1024), which is drawn at once: the result depends on it, as on the seed."""
        if int(size) != size or size < 1:
            raise ValueError(f"the block size is {size}; it must be a whole number of at least 1")
        self._blockSize = int(size)

    def setChunkSize(self, size: int) -> None:
        """Runs that a worker makes at once, rounded up to whole blocks; without it 16 blocks."""
        if int(size) != size or size < 1:
            raise ValueError(f"the chunk size is {size}; it must be a whole number of at least 1")
        self._chunkSize = int(size)

    def setOutputFile(self, path: str | os.PathLike | None, withInputs: bool = False) -> None:
        """Keep the outputs of all runs, (N, p), or inputs and outputs, (N, n + p), in an .npy file; None for none.

        ``numpy.load(path, mmap_mode="r")`` reads it without memory. It has its name when it is complete.
        """
        self._file = None if path is None else Path(path)
        self._keeps = "none" if path is None else "both" if withInputs else "outputs"

    def setCheckpointFile(self, path: str | os.PathLike | None) -> None:
        """Continue from this file where it is there, and keep in it what is done; None (default) for neither.

        An interrupted and continued run gives the same result as an uninterrupted one. A checkpoint of another
        distribution, seed, size or other events is refused. Arrays that are given as inputs are not compared; the
        function is compared by the names of its inputs and outputs only.
        """
        self._checkpoint = None if path is None else Path(path)

    def setProgressCallback(self, callback: Callable[[float], None] | None) -> None:
        """Called with the share of the runs that is done [%]; None for nothing."""
        if callback is not None and not callable(callback):
            raise TypeError(f"the progress callback is of type {type(callback).__name__}; it must be callable")
        self._progressCallback = callback

    def run(self) -> None:
        """Make the runs.

        Raises
        ------
        ChunkError
            If a chunk could not be finished. With a checkpoint file what was finished before it is kept.
        ValueError
            If the inputs end early, or the checkpoint belongs to other runs.
        KeyboardInterrupt
            Ctrl-C. The result is then that of the blocks so far, as where an error ends the run.
        """
        seed = ot.RandomGenerator.IntegerGenerate(2**31 - 1)
        events = tuple(self._events.values())
        work = _BlockWork(self._work, self._distribution, self._size, self._blockSize, seed, events, self._keeps)
        progress = StreamProgress(self._checkpoint, self._fingerprint(work))

        def check(chunk, result):
            return result if isinstance(result, str) else None

        with self._closing(), self._keeping(progress), self._rowFile(progress) as rows, progress.savedAtLast(rows):
            for chunk, (summaries, kept) in self._scheduler.run(Work(work), self._chunks(progress.runs), check):
                if rows is not None:
                    rows.append(kept)
                for summary in summaries:
                    progress.add(summary)
                progress.saveNowAndThen(rows)
                if self._progressCallback is not None:
                    self._progressCallback(100.0 * chunk.end / self._size)

    @contextlib.contextmanager
    def _keeping(self, progress):
        """At the end, and where the run is interrupted, the result is that of the blocks so far."""
        self._result = None
        try:
            with raisingInterrupts():
                yield
        finally:
            if progress.summary is not None:
                names = list(self._work.function.getOutputDescription())
                self._result = MonteCarloStreamResult(progress.summary, names, list(self._events))

    def _rowFile(self, progress):
        """The file of rows, after those that are done; nothing where none is wanted or it is complete."""
        done = progress.runs
        if self._file is None or (done == self._size and self._file.exists()):
            return contextlib.nullcontext()
        function = self._work.function
        width = function.getOutputDimension() + (function.getInputDimension() if self._keeps == "both" else 0)
        return openRowFile(self._file, (self._size, width), done, progress.checksum)

    def getResult(self) -> "MonteCarloStreamResult":
        """The :class:`MonteCarloStreamResult` of the last run."""
        if self._result is None:
            raise RuntimeError("there is no result yet: call run() first")
        return self._result

    @contextlib.contextmanager
    def _closing(self):
        try:
            yield
        finally:
            self._scheduler.close()

    def _fingerprint(self, work):
        """What two runs must share for one to continue the other."""
        function = self._work.function
        # OpenTURNS prints six digits of a distribution's parameters; the runs that it draws tell more.
        first = b"given" if self._distribution is None else work.draw(0).tobytes()
        # In the order of the counts.
        events = [
            [name, column, repr(operator), limit, *([] if center is None else [center])]
            for name, (column, operator, limit, center) in self._events.items()
        ]
        digest = hashlib.sha256(first).hexdigest()
        labels = [*function.getInputDescription(), *function.getOutputDescription()]
        return {
            "runs": self._size, "block": self._blockSize, "inputs": digest, "labels": labels, "events": events,
            "file": self._keeps,
        }  # fmt: skip

    def _chunks(self, done):
        """The chunks from the run `done` on, which begins a block."""
        blocks = _CHUNK_BLOCKS if self._chunkSize is None else -(-self._chunkSize // self._blockSize)
        step = blocks * self._blockSize
        rows = self._rows if self._rows is None or isinstance(self._rows, np.ndarray) else _Rows(self._rows, done)
        for first in range(done, self._size, step):
            end = min(first + step, self._size)
            X = None
            if rows is not None:
                X = np.array(rows[first:end], dtype=float)
                if len(X) < end - first:
                    raise ValueError(f"the inputs end after row {first + len(X) - 1}; {self._size} rows are needed")
                if X.shape != (end - first, self._work.function.getInputDimension()):
                    raise ValueError(
                        f"the inputs of rows {first} to {end - 1} have shape {X.shape}; "
                        f"({end - first}, {self._work.function.getInputDimension()}) is needed"
                    )
            yield Chunk(first, end, (first // self._blockSize, -(-end // self._blockSize), X))


def _outputColumn(labels, output):
    """Index of an output that is given by it, by its label, or by what stands before the unit there."""
    columns = [k for k, label in enumerate(labels) if label == output or label.startswith(f"{output} [")]
    if isinstance(output, (int, np.integer)) and 0 <= output < len(labels):
        return int(output)
    if len(columns) != 1:
        known = ", ".join(labels)
        raise ValueError(f"'{output}' is no output of the function; give its index or its name out of {known}")
    return columns[0]


class _Rows:
    """Rows of an iterable of arrays, taken in order."""

    def __init__(self, arrays, skipped):
        self._arrays, self._left = arrays, None
        while skipped and len(part := self._take(skipped)):
            skipped -= len(part)

    def __getitem__(self, rows):
        parts, wanted = [], rows.stop - rows.start
        while wanted:
            part = self._take(wanted)
            if not len(part):
                break
            parts.append(part)
            wanted -= len(part)
        return np.concatenate(parts) if parts else np.empty((0, 0))

    def _take(self, most):
        while self._left is None or not len(self._left):
            self._left = next(self._arrays, None)
            if self._left is None:
                return np.empty((0, 0))
            self._left = np.asarray(self._left, dtype=float)
        taken, self._left = self._left[:most], self._left[most:]
        return taken


class MonteCarloStreamResult(OpenTURNSObject):
    """What the runs of a :class:`MonteCarloStream` gave; see there."""

    def __init__(self, summary: BlockSummary, names: Sequence[str], events: Sequence[str]) -> None:
        self._summary, self._names, self._events = summary, names, events

    def _shown(self):
        counts = dict(zip([*self._events, "any of them"], self._summary.counts.tolist(), strict=True))
        return {"size": self._summary.size, "counts": counts}

    def getSize(self) -> int:
        """Number of runs."""
        return self._summary.size

    def getOutputDescription(self) -> list[str]:
        """Names of the outputs."""
        return list(self._names)

    def getMean(self) -> ot.Point:
        """Mean of each output, :py:class:`openturns.Point`."""
        return ot.Point(self._summary.mean)

    def getStandardDeviation(self) -> ot.Point:
        """Standard deviation of each output, :py:class:`openturns.Point`; 0 for a single run."""
        return ot.Point(np.sqrt(self._summary.squares / max(self._summary.size - 1, 1)))

    def getMin(self) -> ot.Point:
        """Smallest value of each output, :py:class:`openturns.Point`."""
        return ot.Point(self._summary.least)

    def getMax(self) -> ot.Point:
        """Largest value of each output, :py:class:`openturns.Point`."""
        return ot.Point(self._summary.most)

    def getEventNames(self) -> list[str]:
        """Names of the events."""
        return list(self._events)

    def getEventNumber(self, name: str | None = None) -> int:
        """How many runs are in an event; in any of them by default."""
        if name is not None and name not in self._events:
            raise ValueError(f"'{name}' is no event of these runs; they have {', '.join(self._events) or 'none'}")
        return int(self._summary.counts[-1 if name is None else self._events.index(name)])

    def getProbabilityEstimate(self, name: str | None = None) -> float:
        """The share of the runs in an event; in any of them by default."""
        return self.getEventNumber(name) / self._summary.size

    def getCoefficientOfVariation(self, name: str | None = None) -> float:
        """Of the probability estimate; infinite without a run in the event."""
        count = self.getEventNumber(name)
        return math.sqrt((1.0 - count / self._summary.size) / count) if count else math.inf

    def getConfidenceInterval(self, level: float = 0.95, name: str | None = None) -> ot.Interval:
        """The exact (Clopper-Pearson) interval of the probability, :py:class:`openturns.Interval`."""
        if not 0.0 < level < 1.0:
            raise ValueError(f"the level is {level}; it must be between 0 and 1")
        return ot.Interval(*clopperPearson(self.getEventNumber(name), self._summary.size, level))
