"""Reliability methods repeated over seeds where the probability is known: bias, real error, coverage, cost."""

import csv
import dataclasses
import io
import json
import math
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.methods.benchmark_problems import BenchmarkProblem
from satsep_ot.methods.comparison import ReliabilityComparison
from satsep_ot.methods.reliability_methods import METHODS, ReliabilityMethod, Row, makeMethod

# An interval narrower than the digits of the reference is not held against a method.
_REFERENCE_ACCURACY = 5e-4
_LARGEST_BIAS = 0.02
_SMALLEST_COVERAGE = 0.9
_TARGET = 0.05


@dataclasses.dataclass(frozen=True)
class BenchmarkTask:
    """An event of known probability.

    Attributes
    ----------
    name : str
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
    probability : float
    components : tuple, optional
        Arguments of :meth:`ActiveSubspaceReliability.setComponents`.
    gradientCost : float
        Evaluations that one gradient is worth in time.

    Examples
    --------
    >>> from satsep_ot.methods.benchmark_problems import getBenchmarkProblem
    >>> from satsep_ot.methods.reliability_benchmark import BenchmarkTask
    >>> BenchmarkTask.of(getBenchmarkProblem("RP54")).name
    'RP54'
    """

    name: str
    event: object
    probability: float
    components: tuple | None = None
    gradientCost: float = 1.0

    @staticmethod
    def of(problem: BenchmarkProblem) -> "BenchmarkTask":
        """The task of a published problem."""
        function, composition = problem.getComponents()
        components = (function, composition) if function.getOutputDimension() > 1 else None
        return BenchmarkTask(problem.getName(), problem.getEvent(), problem.getProbability(), components)


@dataclasses.dataclass
class BenchmarkRow:
    """What the repetitions of one method on one event showed. A number that does not exist is None.

    Attributes
    ----------
    problem, method : str
    repetitions, failed : int
        Repetitions, and those without a probability.
    bias, biasError : float
        Of the mean over the repetitions, relative, with its standard error.
    error, claimed : float
        Root mean square of the relative errors, and of the coefficients of variation that the method gave.
    coverage : float
        Share of the repetitions whose 95 % interval holds the truth.
    evaluations, gradients, seconds : float
        Means.
    cost : float
        Runs to an error of 5 %: runs x (error / 5 %)^2. A method that was asked for an error, or has no choice of its
        runs, is not given fewer than it made.
    right : bool
        Bias below 2 % and coverage at least 90 %, both as far as the number of repetitions can tell; a method without
        an interval needs an error below 2 %. A repetition without a probability is never right.
    rank : int
        Place by cost among the methods that are right on this problem.
    message : str
        Of the first repetition that failed.
    """

    problem: str
    method: str
    repetitions: int
    failed: int
    bias: float | None = None
    biasError: float | None = None
    error: float | None = None
    claimed: float | None = None
    coverage: float | None = None
    evaluations: float | None = None
    gradients: float | None = None
    seconds: float | None = None
    cost: float | None = None
    right: bool = False
    rank: int | None = None
    message: str = ""


class ReliabilityBenchmark:
    """Methods on problems, each pair repeated with the seeds ``seed``, ``seed + 1``, ...

    Every evaluation and gradient counts. An exception is an entry with its message and never a probability of 0.

    Parameters
    ----------
    tasks : sequence of BenchmarkTask
    methods : sequence of str or ReliabilityMethod, optional
        By default all of :data:`~satsep_ot.methods.reliability_methods.METHODS`.
    repetitions : int
    seed : int

    Notes
    -----
    The state of ``ot.RandomGenerator`` is as before after `run`.

    Examples
    --------
    >>> from satsep_ot.methods.benchmark_problems import getBenchmarkProblem
    >>> from satsep_ot.methods.reliability_benchmark import BenchmarkTask, ReliabilityBenchmark
    >>> benchmark = ReliabilityBenchmark([BenchmarkTask.of(getBenchmarkProblem("RP107"))], ["FORM"], repetitions=2)
    >>> benchmark.run()
    >>> row = benchmark.getResult().getRows()[0]
    >>> row.right, row.rank, row.error < 1e-6
    (True, 1, True)
    """

    def __init__(
        self,
        tasks: Sequence[BenchmarkTask],
        methods: Sequence[str | ReliabilityMethod] | None = None,
        repetitions: int = 10,
        seed: int = 0,
    ):
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
        self._path = None
        self._progressCallback = None
        self._result = None

    def __repr__(self):
        return (
            f"ReliabilityBenchmark(problems={[task.name for task in self._tasks]}, "
            f"methods={[method.name for method in self._methods]}, repetitions={self._repetitions}, seed={self._seed})"
        )

    def setFile(self, path: str | os.PathLike | None) -> None:
        """Keep every repetition in a file of JSON lines, and continue from what it holds.

        A line belongs to a problem, a method with its settings and a seed; one that an interruption has cut is made
        again.
        """
        self._path = None if path is None else Path(path)

    def setProgressCallback(self, callback: Callable[[str, float], None] | None) -> None:
        """Called with a label and the share of all repetitions that is done, before each one and at the end."""
        self._progressCallback = callback

    def run(self) -> None:
        """Make the repetitions that are not in the file."""
        known = self._read()
        rows = {}
        total, done = len(self._tasks) * len(self._methods) * self._repetitions, 0
        state = ot.RandomGenerator.GetState()
        try:
            # Seed by seed: an interruption leaves every method with about as many repetitions.
            for seed in range(self._seed, self._seed + self._repetitions):
                for task in self._tasks:
                    for method in self._methods:
                        self._report(f"{task.name}: {method.name}", done / total)
                        key = json.dumps([task.name, repr(method), seed])
                        if key not in known:
                            known[key] = _repetition(task, method, seed)
                            self._append(key, known[key])
                        rows.setdefault((task.name, method.name), []).append(known[key])
                        done += 1
                        self._result = ReliabilityBenchmarkResult(self._summaries(rows))
        finally:
            ot.RandomGenerator.SetState(state)
        self._report("done", 1.0)

    def getResult(self) -> "ReliabilityBenchmarkResult":
        """Accessor to the result; of the repetitions so far, when run() was interrupted."""
        if self._result is None:
            raise RuntimeError("there is no result yet; call run() first")
        return self._result

    def _report(self, label, share):
        if self._progressCallback is not None:
            self._progressCallback(label, share)

    def _read(self):
        if self._path is None or not self._path.exists():
            return {}
        known = {}
        for line in self._path.read_text(encoding="utf-8").splitlines():
            try:
                entry = json.loads(line)
                known[entry["key"]] = Row(**entry["row"])
            except (json.JSONDecodeError, KeyError, TypeError):
                continue
        return known

    def _append(self, key, row):
        if self._path is None:
            return
        with self._path.open("a+b") as stream:
            # What an interruption has cut gets an end, so that the next line is one of its own.
            if stream.tell() > 0:
                stream.seek(-1, os.SEEK_END)
                if stream.read(1) != b"\n":
                    stream.write(b"\n")
            stream.write((json.dumps({"key": key, "row": dataclasses.asdict(row)}) + "\n").encode())

    def _summaries(self, rows):
        summaries = []
        for task in self._tasks:
            pairs = [(method, rows.get((task.name, method.name))) for method in self._methods]
            mine = [_summary(task, method, part) for method, part in pairs if part]
            for place, row in enumerate(sorted((r for r in mine if r.right), key=lambda r: r.cost), start=1):
                row.rank = place
            summaries += mine
        return summaries


def _repetition(task, method, seed):
    ot.RandomGenerator.SetSeed(seed)
    comparison = ReliabilityComparison(task.event, [method])
    if task.components is not None:
        comparison.setComponents(*task.components)
    comparison.run()
    return comparison.getResult().getRows()[0]


def _summary(task, method, rows):
    """A `BenchmarkRow` without its rank."""
    found = [row for row in rows if row.probability is not None]
    failed = [row for row in rows if row.probability is None]
    summary = BenchmarkRow(task.name, method.name, len(rows), len(failed), message=failed[0].note if failed else "")
    summary.evaluations = float(np.mean([row.evaluations for row in rows]))
    summary.gradients = float(np.mean([row.gradients for row in rows]))
    summary.seconds = float(np.mean([row.seconds for row in rows]))
    if not found:
        return summary
    ratios = np.array([row.probability for row in found]) / task.probability
    summary.bias = float(ratios.mean() - 1.0)
    summary.biasError = float(ratios.std(ddof=1) / math.sqrt(len(ratios))) if len(ratios) > 1 else None
    summary.error = float(np.sqrt(((ratios - 1.0) ** 2).mean()))
    claims = [row.coefficient_of_variation for row in found if row.coefficient_of_variation is not None]
    summary.claimed = float(np.sqrt(np.mean(np.square(claims)))) if claims else None
    intervals = [(row.lower95, row.upper95) for row in found if row.lower95 is not None]
    if intervals:
        low, high = np.array(intervals).T
        slack = _REFERENCE_ACCURACY * task.probability
        summary.coverage = float(np.mean((low <= task.probability + slack) & (task.probability - slack <= high)))
    runs = summary.evaluations + task.gradientCost * summary.gradients
    factor = (summary.error / _TARGET) ** 2
    summary.cost = runs * (factor if method.fixedSize else max(factor, 1.0))
    unbiased = abs(summary.bias) <= _LARGEST_BIAS + 2.0 * (summary.biasError or 0.0)
    if summary.coverage is None:
        summary.right = not failed and summary.error <= _LARGEST_BIAS
    else:
        tolerance = 2.0 * math.sqrt(_SMALLEST_COVERAGE * (1.0 - _SMALLEST_COVERAGE) / len(found))
        summary.right = not failed and unbiased and summary.coverage >= _SMALLEST_COVERAGE - tolerance
    return summary


class ReliabilityBenchmarkResult:
    """Rows of a `ReliabilityBenchmark`.

    Parameters
    ----------
    rows : list of BenchmarkRow

    Examples
    --------
    >>> from satsep_ot.methods.reliability_benchmark import BenchmarkRow, ReliabilityBenchmarkResult
    >>> row = BenchmarkRow("P1", "FORM", repetitions=1, failed=0, bias=0.0, error=0.0, cost=204.0, right=True)
    >>> ReliabilityBenchmarkResult([row]).getRightMethods()
    ['FORM']
    """

    def __init__(self, rows: list[BenchmarkRow]):
        self._rows = rows

    def __repr__(self):
        return f"ReliabilityBenchmarkResult(rows={len(self._rows)})"

    def getRows(self) -> list[BenchmarkRow]:
        """Accessor to the rows: problem by problem, the methods in their order."""
        return self._rows

    def getRightMethods(self) -> list[str]:
        """Methods that are right on every problem."""
        methods = dict.fromkeys(row.method for row in self._rows)
        return [method for method in methods if all(row.right for row in self._rows if row.method == method)]

    def getTable(self) -> list[dict]:
        """The rows as dictionaries of plain numbers, ready for JSON."""
        return [dataclasses.asdict(row) for row in self._rows]

    def toCSV(self) -> str:
        """The rows as comma-separated values with a header; what does not exist is empty."""
        stream = io.StringIO()
        writer = csv.DictWriter(stream, [field.name for field in dataclasses.fields(BenchmarkRow)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.getTable())
        return stream.getvalue()

    def toMarkdown(self) -> str:
        """One Markdown table, best method first on each problem."""
        header = [*_COLUMNS]
        lines = ["| " + " | ".join(header) + " |", "| --- | --- |" + " ---: |" * (len(header) - 2)]
        lines += ["| " + " | ".join(cells) + " |" for cells in self._cells()]
        return "\n".join(lines)

    def toText(self) -> str:
        """The same table with aligned columns."""
        cells = [list(_COLUMNS), *self._cells()]
        widths = [max(len(row[column]) for row in cells) for column in range(len(_COLUMNS))]
        return "\n".join(
            "  ".join(
                text.ljust(width) if column < 2 else text.rjust(width)
                for column, (text, width) in enumerate(zip(row, widths, strict=True))
            ).rstrip()
            for row in cells
        )

    def _cells(self):
        problems = list(dict.fromkeys(row.problem for row in self._rows))
        rows = sorted(
            self._rows,
            key=lambda row: (
                problems.index(row.problem),
                row.rank or math.inf,
                math.inf if row.cost is None else row.cost,
            ),
        )
        return [[_cell(form, row) for form in _COLUMNS.values()] for row in rows]

    def drawCost(self) -> ot.Graph:
        """Runs to an error of 5 % on each problem, of the methods that are right there."""
        problems = list(dict.fromkeys(row.problem for row in self._rows))
        methods = list(dict.fromkeys(row.method for row in self._rows if row.right))
        graph = ot.Graph(
            f"Problems, from the left: {', '.join(problems)}", "problem", "runs to an error of 5 %", True, "upper left"
        )
        palette = ot.Drawable.BuildDefaultPalette(max(len(methods), 1))
        styles = ("fcircle", "square", "diamond", "triangleup", "plus", "times", "star")
        for place, method in enumerate(methods):
            points = [
                [problems.index(row.problem) + 1.0, row.cost]
                for row in self._rows
                if row.method == method and row.right
            ]
            graph.add(ot.Cloud(ot.Sample(points), palette[place], styles[place % len(styles)], method))
        graph.setLogScale(ot.GraphImplementation.LOGY)
        return graph

    def drawErrors(self) -> ot.Graph:
        """Measured against claimed error; above the diagonal a method claims too much."""
        rows = [row for row in self._rows if row.claimed and row.error]
        graph = ot.Graph("Measured and claimed error", "claimed", "measured", True, "upper left")
        methods = list(dict.fromkeys(row.method for row in rows))
        palette = ot.Drawable.BuildDefaultPalette(max(len(methods), 1))
        for place, method in enumerate(methods):
            points = [[row.claimed, row.error] for row in rows if row.method == method]
            graph.add(ot.Cloud(ot.Sample(points), palette[place], "fcircle", method))
        if rows:
            edges = [min(min(row.claimed, row.error) for row in rows), max(max(row.claimed, row.error) for row in rows)]
            graph.add(ot.Curve(edges, edges))
            graph.setLogScale(ot.GraphImplementation.LOGXY)
        return graph


def _percent(value):
    return "" if value is None else f"{100.0 * value:.2f}" if abs(value) < 0.1 else f"{100.0 * value:.0f}"


def _number(value):
    return "" if value is None else f"{value:,.0f}"


# Columns of the tables: what is read from a row.
_COLUMNS: dict[str, Callable[[BenchmarkRow], str]] = {
    "problem": lambda row: row.problem,
    "method": lambda row: row.method,
    "rank": lambda row: "" if row.rank is None else str(row.rank),
    "right": lambda row: "yes" if row.right else "no",
    "bias [%]": lambda row: _percent(row.bias),
    "+- [%]": lambda row: _percent(row.biasError),
    "error [%]": lambda row: _percent(row.error),
    "claimed [%]": lambda row: _percent(row.claimed),
    "inside [%]": lambda row: "" if row.coverage is None else f"{100.0 * row.coverage:.0f}",
    "evaluations": lambda row: _number(row.evaluations),
    "gradients": lambda row: _number(row.gradients),
    "runs to 5 %": lambda row: _number(row.cost),
    "no answer": lambda row: f"{row.failed} of {row.repetitions}" if row.failed else "",
}


def _cell(form, row):
    return form(row).replace("|", "/")
