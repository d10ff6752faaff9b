"""Reliability methods repeated over seeds where the probability is known."""

import dataclasses
import hashlib
import json
import os
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path

import openturns as ot

from satsep_ot.methods.common.storage import namingFile
from satsep_ot.methods.comparison.benchmark_result import WRONG, ReliabilityBenchmarkResult, summarise
from satsep_ot.methods.comparison.comparison import ReliabilityComparison
from satsep_ot.methods.comparison.method import ReliabilityMethod, Row
from satsep_ot.methods.comparison.methods import METHODS, makeMethod
from satsep_ot.methods.comparison.problem import BenchmarkTask
from satsep_ot.methods.parallel.chunks import Chunk, Work
from satsep_ot.methods.parallel.monte_carlo_stream import generatorLock
from satsep_ot.methods.parallel.scheduler import ChunkScheduler
from satsep_ot.openturns_object import OpenTURNSObject


class ReliabilityBenchmark(OpenTURNSObject):
    """Methods on problems, each pair repeated with the seeds ``seed``, ``seed + 1``, ...

    Every evaluation and gradient counts. An exception is an entry with its message and never a probability of 0.

    Parameters
    ----------
    tasks : sequence of BenchmarkTask
    methods : sequence of str or ReliabilityMethod, optional
        By default all of :data:`~satsep_ot.methods.comparison.methods.METHODS`.
    repetitions : int
    seed : int

    Notes
    -----
    The state of ``ot.RandomGenerator`` is as before after `run`.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.problems import getBenchmarkProblem
    >>> from satsep_ot.methods.comparison.benchmark import ReliabilityBenchmark
    >>> from satsep_ot.methods.comparison.problem import BenchmarkTask
    >>> benchmark = ReliabilityBenchmark([BenchmarkTask.of(getBenchmarkProblem("RP107"))], ["FORM"], repetitions=2)
    >>> benchmark.run()
    >>> row = benchmark.getResult().getRows()[0]
    >>> row.verdict, row.rank, row.error < 1e-6
    ('right', 1, True)
    """

    def __init__(
        self,
        tasks: Sequence[BenchmarkTask],
        methods: Sequence[str | ReliabilityMethod] | None = None,
        repetitions: int = 10,
        seed: int = 0,
    ) -> None:
        if repetitions < 1:
            raise ValueError(f"the number of repetitions is {repetitions}; it must be at least 1")
        self._tasks = list(tasks)
        self._methods = [makeMethod(method) for method in (METHODS if methods is None else methods)]
        for what, names in (
            ("problems", [task.name for task in self._tasks]),
            ("methods", [method.name for method in self._methods]),
        ):
            if len(set(names)) < len(names):
                raise ValueError(f"the names of the {what} must differ, but they are {', '.join(names)}")
        self._repetitions = repetitions
        self._seed = seed
        self._path: Path | None = None
        self._scheduler = ChunkScheduler()
        self._progressCallback: Callable[[str, float], None] | None = None
        # Rows of the repetitions, by problem and method, then by seed.
        self._known: dict[tuple[str, str], dict[int, Row]] | None = None

    def _shown(self):
        return {
            "problems": [task.name for task in self._tasks],
            "methods": [method.name for method in self._methods],
            "repetitions": self._repetitions,
            "seed": self._seed,
        }

    def setFile(self, path: str | os.PathLike | None) -> None:
        """Keep every repetition in a file of JSON lines, and continue from what it holds.

        A line belongs to a problem, a method with its settings and a seed; one that an interruption has cut is made
        again. All repetitions of the file count, also those beyond the number that is asked for now.
        """
        self._path = None if path is None else Path(path)

    def setProgressCallback(self, callback: Callable[[str, float], None] | None) -> None:
        """Called with a label and the share of all repetitions that is done, before each one and at the end."""
        self._progressCallback = callback

    def setExecutor(self, executor: Executor | Callable[[], Executor] | None) -> None:
        """What makes the repetitions, as for :class:`~satsep_ot.methods.parallel.function.ParallelFunction`.

        Each follows from its seed alone: the numbers, but for the seconds, do not depend on the executor. Processes
        suit best; the threads of a process take turns, since they share OpenTURNS' random generator.
        """
        self._scheduler = ChunkScheduler(executor)
        # Repetitions of some methods take many times as long as the median one.
        self._scheduler.setMeasuredTimeout(factor=1000.0, least=3600.0)

    def getScheduler(self) -> ChunkScheduler:
        """The :class:`~satsep_ot.methods.parallel.scheduler.ChunkScheduler`, for time limit and attempts."""
        return self._scheduler

    def run(self) -> None:
        """Make the repetitions that are not in the file.

        Raises
        ------
        ChunkError
            With an executor: a repetition could not be made, since its worker dies or hangs.
        """
        known: dict[tuple[str, str], dict[int, Row]] = {}
        self._known = known
        self._read(known)
        pairs = [(task, method) for task in self._tasks for method in self._methods]
        # Seed by seed: an interruption leaves every method with about as many repetitions.
        wanted = [
            (place, seed) for seed in range(self._seed, self._seed + self._repetitions) for place in range(len(pairs))
        ]
        rows = [known.setdefault((task.name, repr(method)), {}) for task, method in pairs]
        missing = [(place, seed) for place, seed in wanted if seed not in rows[place]]
        done = len(wanted) - len(missing)

        def chunks():
            for number, (place, seed) in enumerate(missing):
                task, method = pairs[place]
                self._report(f"{task.name}: {method.name}", done / len(wanted))
                yield Chunk(number, number + 1, (place, seed), f"{task.name}: {method.name} with the seed {seed}")

        try:
            for chunk, row in self._scheduler.run(Work(_Repetitions(pairs)), chunks(), inOrder=False):
                place, seed = chunk.argument
                rows[place][seed] = row
                task, method = pairs[place]
                self._append(task, method, seed, row)
                done += 1
        finally:
            self._scheduler.close()
        self._report("done", 1.0)

    def getResult(self) -> "ReliabilityBenchmarkResult":
        """The result; of the repetitions so far, while run() works or when it was interrupted."""
        if self._known is None:
            raise RuntimeError("there is no result yet; call run() first")
        return ReliabilityBenchmarkResult(self._summaries(self._known))

    def _report(self, label, share):
        if self._progressCallback is not None:
            self._progressCallback(label, share)

    def _read(self, known):
        if self._path is None or not self._path.exists():
            return
        for line in self._path.read_text(encoding="utf-8").splitlines():
            try:
                entry = json.loads(line)
                if entry.pop("sha256", None) not in (None, _digest(entry)):
                    # Not as it was written: it is made again, as one that was cut.
                    continue
                problem, method, seed = json.loads(entry["key"])
                known.setdefault((problem, method), {})[seed] = Row(**entry["row"])
            except (json.JSONDecodeError, KeyError, TypeError, ValueError):
                continue

    def _append(self, task, method, seed, row):
        if self._path is None:
            return
        with namingFile(self._path), self._path.open("a+b") as stream:
            # What an interruption has cut gets an end, so that the next line is one of its own.
            if stream.tell() > 0:
                stream.seek(-1, os.SEEK_END)
                if stream.read(1) != b"\n":
                    stream.write(b"\n")
            entry = {"key": json.dumps([task.name, repr(method), seed]), "row": dataclasses.asdict(row)}
            stream.write((json.dumps({"sha256": _digest(entry), **entry}) + "\n").encode())
            stream.flush()
            os.fsync(stream.fileno())

    def _summaries(self, known):
        summaries = []
        for task in self._tasks:
            pairs = [(method, known.get((task.name, repr(method)))) for method in self._methods]
            mine = [summarise(task, method, [rows[seed] for seed in sorted(rows)]) for method, rows in pairs if rows]
            ranked = sorted((row for row in mine if row.verdict != WRONG), key=lambda row: row.cost)
            for place, row in enumerate(ranked, start=1):
                row.rank = place
            summaries += mine
        return summaries


def _digest(entry):
    """Of a line of the file; numbers come back from JSON to the last bit."""
    return hashlib.sha256(json.dumps(entry).encode()).hexdigest()


class _Repetitions:
    """Makes the repetition of a pair of task and method with a seed: what a worker does."""

    def __init__(self, pairs):
        self.pairs = pairs

    def __call__(self, argument):
        place, seed = argument
        task, method = self.pairs[place]
        with generatorLock:
            state = ot.RandomGenerator.GetState()
            try:
                return _repetition(task, method, seed)
            finally:
                ot.RandomGenerator.SetState(state)


def _repetition(task, method, seed):
    ot.RandomGenerator.SetSeed(seed)
    comparison = ReliabilityComparison(task.event, [method])
    # The settings of each method say what it spends.
    comparison.setMaximumEvaluations(None)
    if task.components is not None:
        comparison.setComponents(*task.components)
    comparison.run()
    return comparison.getResult().getRows()[0]
