"""Monte Carlo of any size in constant memory: runs are drawn, made and counted block by block, on any executor."""

import contextlib
import dataclasses
import hashlib
import json
import math
import os
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.methods.common.margins import thresholdMargin
from satsep_ot.methods.parallel.function import FunctionWork, wrongResult
from satsep_ot.methods.parallel.scheduler import Chunk, ChunkScheduler, Work

# Blocks that a worker makes at once.
_CHUNK_BLOCKS = 16
# Between two checkpoints [s].
_CHECKPOINT_INTERVAL = 2.0
# Seeds of the blocks of one stream differ: OpenTURNS takes them modulo this.
_SEEDS = 2**32
# OpenTURNS has one random generator for all threads of a process. What holds it may run a stream of its own.
generatorLock = threading.RLock()


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
    >>> from satsep_ot.methods.parallel.monte_carlo_stream import BlockSummary
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
    def of(values: np.ndarray, events: Sequence[tuple[int, ot.ComparisonOperator, float]]) -> "BlockSummary":
        """The summary of outputs (n, p); an event is (column, comparison operator, threshold)."""
        inside = [thresholdMargin(operator, limit)(values[:, column]) <= 0.0 for column, operator, limit in events]
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


class MonteCarloStream:
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
    of ``ot.RandomGenerator``. What the blocks gave is merged in their order. The result depends on the block size, as
    on the seed, but on neither the executor nor the number of workers nor the chunk size, down to the last bit.

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
        self._distribution = self._rows = None
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
            raise ValueError(f"the number of runs is {size}; a whole number from 1 on is needed")
        if isinstance(self._rows, np.ndarray) and size > len(self._rows):
            raise ValueError(f"{size} runs are wanted of {len(self._rows)} rows")
        self._size = int(size)
        self._blockSize = 1024
        self._chunkSize = None
        self._events = {}
        self._scheduler = ChunkScheduler()
        self._file, self._keeps, self._checkpoint = None, "none", None
        self._progressCallback = None
        self._result = None

    def __repr__(self) -> str:
        return f"MonteCarloStream(size={self._size}, blockSize={self._blockSize}, events={list(self._events)})"

    def setEvents(self, events: Mapping[str, tuple[int | str, ot.ComparisonOperator, float]]) -> None:
        """Events to be counted.

        Parameters
        ----------
        events : dict of str to (output, operator, threshold)
            An output is its index or its name, which may leave out the unit in brackets; an operator is
            :py:class:`openturns.Greater` or another comparison.
        """
        labels = list(self._work.function.getOutputDescription())
        names = [label.split(" [")[0] for label in labels]
        columns = dict(zip(names, range(len(names)), strict=True)) | dict(zip(labels, range(len(names)), strict=True))
        found = {}
        for name, (output, operator, threshold) in events.items():
            column = columns.get(output, output)
            if not isinstance(column, (int, np.integer)) or not 0 <= column < len(names):
                raise ValueError(f"'{output}' is no output of the function; it has {', '.join(names)}")
            operator = ot.ComparisonOperator(operator)
            # Refuses a threshold that is not finite.
            thresholdMargin(operator, threshold)
            found[name] = (column, operator, float(threshold))
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
            raise ValueError(f"the block size is {size}; a whole number from 1 on is allowed")
        self._blockSize = int(size)

    def setChunkSize(self, size: int) -> None:
        """Runs that a worker makes at once, rounded up to whole blocks; without it 16 blocks."""
        if int(size) != size or size < 1:
            raise ValueError(f"the chunk size is {size}; a whole number from 1 on is allowed")
        self._chunkSize = int(size)

    def setOutputFile(self, path: str | os.PathLike | None, withInputs: bool = False) -> None:
        """Keep the outputs of all runs, (N, p), or inputs and outputs, (N, n + p), in an .npy file; None for none.

        ``numpy.load(path, mmap_mode="r")`` reads it without memory. It has its name when it is complete.
        """
        self._file = None if path is None else Path(path)
        self._keeps = "none" if path is None else "both" if withInputs else "outputs"

    def setCheckpointFile(self, path: str | os.PathLike | None) -> None:
        """Continue from this file where it is there, and keep in it what is done; None (default) for neither.

        The result of a run that was interrupted and continued is that of one that was not. A checkpoint of another
        distribution, seed, size or other events is refused. Arrays that are given as inputs are not compared, and of
        the function only the names of its inputs and outputs.
        """
        self._checkpoint = None if path is None else Path(path)

    def setProgressCallback(self, callback: Callable[[float], None] | None) -> None:
        """Called with the share of the runs that is done [%]; None for nothing."""
        if callback is not None and not callable(callback):
            raise TypeError(f"the progress callback must be callable, got {type(callback).__name__}")
        self._progressCallback = callback

    def run(self) -> None:
        """Make the runs.

        Raises
        ------
        ChunkError
            If a chunk could not be finished. With a checkpoint file what was finished before it is kept.
        ValueError
            If the inputs end early, or the checkpoint is that of other runs.
        """
        seed = ot.RandomGenerator.IntegerGenerate(2**31 - 1)
        events = tuple(self._events.values())
        work = _BlockWork(
            self._work, self._distribution, self._size, self._blockSize, seed, events, self._keeps
        )  # fmt: skip
        state = _State(self._checkpoint, self._fingerprint(work))
        width = work.function.function.getOutputDimension()
        width += work.function.function.getInputDimension() if self._keeps == "both" else 0

        def check(chunk, result):
            return result if isinstance(result, str) else None

        complete = self._file is None or (state.runs == self._size and self._file.exists())
        file = contextlib.nullcontext() if complete else _RowFile(self._file, (self._size, width), state.runs)
        with self._closing(), file as rows, state.savedAtLast(rows):
            for chunk, (summaries, kept) in self._scheduler.run(Work(work), self._chunks(state.runs), check):
                if rows is not None:
                    rows.append(kept)
                for summary in summaries:
                    state.add(summary)
                state.saveNowAndThen(rows)
                if self._progressCallback is not None:
                    self._progressCallback(100.0 * chunk.end / self._size)
        names = list(self._work.function.getOutputDescription())
        self._result = MonteCarloStreamResult(state.summary, names, list(self._events))

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
        # In their order, which is that of the counts.
        events = [[name, column, repr(operator), limit] for name, (column, operator, limit) in self._events.items()]
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


class _RowFile:
    """An .npy file that grows row by row, and has its name when it is complete.

    Written, not mapped: pages of a map would count as memory of the process.
    """

    def __init__(self, path, shape, done):
        self._path, self._shape, self._done = path, shape, done
        self._part = path.with_name(path.name + ".part")

    def __enter__(self):
        if self._done and not self._part.exists():
            raise ValueError(f"{self._part} is missing, whose rows the checkpoint counts; remove that to begin anew")
        self._stream = open(self._part, "r+b" if self._done else "wb")
        header = {"descr": "<f8", "fortran_order": False, "shape": self._shape}
        np.lib.format.write_array_header_2_0(self._stream, header)
        place = self._stream.tell() + 8 * self._shape[1] * self._done
        self._stream.seek(0, os.SEEK_END)
        if self._stream.tell() < place:
            self._stream.close()
            raise ValueError(f"{self._part} is shorter than the checkpoint says; remove both to begin anew")
        self._stream.seek(place)
        self._stream.truncate()
        return self

    def append(self, rows):
        self._stream.write(np.ascontiguousarray(rows, dtype="<f8").data)

    def sync(self):
        self._stream.flush()
        os.fsync(self._stream.fileno())

    def __exit__(self, kind, *rest):
        self.sync()
        self._stream.close()
        if kind is None:
            os.replace(self._part, self._path)


class _State:
    """What the runs so far gave, and its file."""

    def __init__(self, path, fingerprint):
        self._path, self._fingerprint = path, fingerprint
        self.runs, self.summary, self._saved = 0, None, time.monotonic()
        if path is not None and path.exists():
            self._load()

    def _load(self):
        try:
            document = json.loads(self._path.read_text(encoding="utf-8"))
            differing = [key for key, value in self._fingerprint.items() if document["of"][key] != value]
            fields = {key: np.array(value) for key, value in document["summary"].items()}
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{self._path} is no checkpoint of a stream ({error}); remove it to begin anew") from error
        if differing:
            raise ValueError(f"{self._path} is the checkpoint of other runs: {', '.join(differing)} differ")
        self.summary = BlockSummary(**{**fields, "size": int(fields["size"])})
        self.runs = self.summary.size

    def add(self, summary):
        self.summary = summary if self.summary is None else self.summary.merged(summary)
        self.runs = self.summary.size

    def saveNowAndThen(self, rows):
        if self._path is not None and time.monotonic() - self._saved > _CHECKPOINT_INTERVAL:
            self._save(rows)

    @contextlib.contextmanager
    def savedAtLast(self, rows):
        try:
            yield
        finally:
            if self._path is not None and self.summary is not None:
                self._save(rows)

    def _save(self, rows):
        """Whole or not at all, and not before the rows that it counts; numbers in JSON come back to the last bit."""
        if rows is not None:
            rows.sync()
        summary = {key: np.asarray(value).tolist() for key, value in dataclasses.asdict(self.summary).items()}
        part = self._path.with_name(self._path.name + ".part")
        with open(part, "w", encoding="utf-8") as stream:
            json.dump({"of": self._fingerprint, "summary": summary}, stream)
            stream.flush()
            os.fsync(stream.fileno())
        os.replace(part, self._path)
        self._saved = time.monotonic()


class MonteCarloStreamResult:
    """What the runs of a :class:`MonteCarloStream` gave; see there."""

    def __init__(self, summary: BlockSummary, names: Sequence[str], events: Sequence[str]) -> None:
        self._summary, self._names, self._events = summary, names, events

    def __repr__(self) -> str:
        counts = dict(zip([*self._events, "any of them"], self._summary.counts.tolist(), strict=True))
        return f"MonteCarloStreamResult(size={self._summary.size}, counts={counts})"

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
            raise ValueError(f"the level is {level}; a number between 0 and 1 is allowed")
        return ot.Interval(*clopperPearson(self.getEventNumber(name), self._summary.size, level))
