"""What repetitions of reliability methods show where the probability is known: bias, real error, coverage, cost."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
import openturns as ot
from scipy.special import bdtr, stdtrit

from satsep_ot.methods.common.tables import csvTable, latexTable, markdownTable, textTable
from satsep_ot.methods.comparison.method import ReliabilityMethod, Row
from satsep_ot.methods.comparison.problem import BenchmarkTask
from satsep_ot.openturns_object import OpenTURNSObject

# An interval narrower than the digits of the reference is not held against a method.
_REFERENCE_ACCURACY = 5e-4
_LARGEST_BIAS = 0.02
_SMALLEST_COVERAGE = 0.9
_TARGET = 0.05
# What it takes to be called right: repetitions, and a standard error of the bias at which twice the limit would show.
_LEAST_REPETITIONS = 10
_BIAS_RESOLUTION = 0.5 * _LARGEST_BIAS
# Chance to call a method wrong whose intervals hold the truth in just the smallest share.
_SIGNIFICANCE = 0.025
RIGHT, WRONG, OPEN = "right", "wrong", "open"


@dataclasses.dataclass
class BenchmarkRow:
    """What the repetitions of one method on one event showed. A number that does not exist is None.

    Attributes
    ----------
    problem, method : str
    repetitions, failed : int
        Repetitions, and those without a probability.
    bias, biasError : float
        Relative bias of the mean over the repetitions, and its standard error, which includes the reference's.
    error, claimed : float
        Root mean square of the relative errors, and of the coefficients of variation that the method gave.
    coverage : float
        Share of the repetitions whose 95 % interval holds the truth, the interval widened by the reference's
        where that is itself an estimate.
    evaluations, gradients, seconds : float
        Means.
    cost : float
        Runs to an error of 5 %: runs x (error / 5 %)^2. A method that was asked for an error, or has no choice of its
        runs, is not given fewer than it made.
    verdict : str
        ``"wrong"``: the 95 % interval of the bias (Student) is all above 2 % or all below -2 %, or the intervals hold
        the truth so seldom that a method with a coverage of 90 % would do so with less than 2.5 % probability, or a
        repetition has no probability. ``"right"``: not wrong, and the repetitions are evidence: ten or more, and a
        standard error of the bias of at most 1 % beside the reference's, so that a bias of 4 % would have
        shown; two are enough of a method without an interval that says the same whatever the seed. ``"open"``:
        neither.
    needed : int
        Repetitions after which an open verdict would be none.
    rank : int
        Place by cost among the methods that are not wrong on this problem.
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
    verdict: str = OPEN
    needed: int | None = None
    rank: int | None = None
    message: str = ""


@dataclasses.dataclass
class MethodSummary:
    """A method over all problems of a benchmark.

    Attributes
    ----------
    method : str
    right, open, wrong : int
        Numbers of problems by verdict.
    cost : float or None
        Runs to an error of 5 %, all problems together; None of a method that is wrong on one or has not been there.
    costs : dict
        Of each problem by its name, whatever the verdict.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.benchmark_result import BenchmarkRow, ReliabilityBenchmarkResult
    >>> row = BenchmarkRow("P1", "FORM", repetitions=2, failed=0, cost=204.0, verdict="right")
    >>> ReliabilityBenchmarkResult([row]).getSummaries()[0].cost
    204.0
    """

    method: str
    right: int
    open: int
    wrong: int
    cost: float | None
    costs: dict[str, float]


def summarise(task: BenchmarkTask, method: ReliabilityMethod, rows: Sequence[Row]) -> BenchmarkRow:
    """What the repetitions of a method on a task show, without a rank."""
    found = [row for row in rows if row.probability is not None]
    failed = [row for row in rows if row.probability is None]
    summary = BenchmarkRow(task.name, method.name, len(rows), len(failed), message=failed[0].note if failed else "")
    summary.evaluations = float(np.mean([row.evaluations for row in rows]))
    summary.gradients = float(np.mean([row.gradients for row in rows]))
    summary.seconds = float(np.mean([row.seconds for row in rows]))
    if not found:
        summary.verdict = WRONG
        return summary
    ratios = np.array([row.probability for row in found]) / task.probability
    summary.bias = float(ratios.mean() - 1.0)
    spread = float(ratios.std(ddof=1)) if len(ratios) > 1 else None
    if spread is not None:
        summary.biasError = math.hypot(spread / math.sqrt(len(ratios)), task.probabilityError)
    summary.error = float(np.sqrt(((ratios - 1.0) ** 2).mean()))
    claims = [row.coefficient_of_variation for row in found if row.coefficient_of_variation is not None]
    summary.claimed = float(np.sqrt(np.mean(np.square(claims)))) if claims else None
    intervals = [(row.lower95, row.upper95) for row in found if row.lower95 is not None]
    inside = None
    if intervals:
        # The interval of the difference between the estimate and the reference, as both are independent.
        low, high = np.array(intervals).T
        estimates = np.array([row.probability for row in found if row.lower95 is not None])
        slack = max(_REFERENCE_ACCURACY, 1.96 * task.probabilityError) * task.probability
        below = task.probability < estimates - np.hypot(estimates - low, slack)
        above = task.probability > estimates + np.hypot(high - estimates, slack)
        inside = int(np.count_nonzero(~(below | above)))
        summary.coverage = inside / len(intervals)
    runs = summary.evaluations + task.gradientCost * summary.gradients
    factor = (summary.error / _TARGET) ** 2
    summary.cost = runs * (factor if method.fixedSize else max(factor, 1.0))
    if failed or (inside is not None and bdtr(inside, len(intervals), _SMALLEST_COVERAGE) < _SIGNIFICANCE):
        summary.verdict = WRONG
        return summary
    summary.needed = _LEAST_REPETITIONS
    if spread is None:
        return summary
    width = stdtrit(len(ratios) - 1, 1.0 - _SIGNIFICANCE) * spread / math.sqrt(len(ratios))
    same = inside is None and spread < _REFERENCE_ACCURACY
    if abs(summary.bias) > _LARGEST_BIAS + math.hypot(width, 2.0 * task.probabilityError):
        summary.verdict, summary.needed = WRONG, None
    elif same or len(rows) >= max(_LEAST_REPETITIONS, (spread / _BIAS_RESOLUTION) ** 2):
        summary.verdict, summary.needed = RIGHT, None
    else:
        summary.needed = max(_LEAST_REPETITIONS, math.ceil((spread / _BIAS_RESOLUTION) ** 2))
    return summary


class ReliabilityBenchmarkResult(OpenTURNSObject):
    """Rows of a `ReliabilityBenchmark`.

    Parameters
    ----------
    rows : list of BenchmarkRow

    Examples
    --------
    >>> from satsep_ot.methods.comparison.benchmark_result import BenchmarkRow, ReliabilityBenchmarkResult
    >>> row = BenchmarkRow("P1", "FORM", repetitions=2, failed=0, bias=0.0, error=0.0, cost=204.0, verdict="right")
    >>> ReliabilityBenchmarkResult([row]).getRightMethods()
    ['FORM']
    """

    def __init__(self, rows: list[BenchmarkRow]) -> None:
        self._rows = rows

    def _shown(self):
        return {"rows": len(self._rows)}

    def getRows(self) -> list[BenchmarkRow]:
        """Accessor to the rows: problem by problem, the methods in their order."""
        return self._rows

    def getRightMethods(self) -> list[str]:
        """Methods that are right on every problem."""
        return [summary.method for summary in self.getSummaries() if summary.right == len(self._problems())]

    def getSummaries(self) -> list["MethodSummary"]:
        """What each method is over all problems: first those that are nowhere wrong, by their total cost."""
        summaries = []
        for method in dict.fromkeys(row.method for row in self._rows):
            rows = [row for row in self._rows if row.method == method]
            count = {verdict: sum(row.verdict == verdict for row in rows) for verdict in (RIGHT, OPEN, WRONG)}
            costs = {row.problem: row.cost for row in rows if row.cost is not None}
            complete = len(rows) == len(self._problems()) and count[WRONG] == 0
            cost = sum(costs.values()) if complete else None
            summaries.append(MethodSummary(method, count[RIGHT], count[OPEN], count[WRONG], cost, costs))
        return sorted(summaries, key=lambda summary: (summary.cost is None, summary.cost, summary.wrong))

    def _problems(self):
        return list(dict.fromkeys(row.problem for row in self._rows))

    def getTable(self) -> list[dict]:
        """The rows as dictionaries of plain numbers, ready for JSON."""
        return [dataclasses.asdict(row) for row in self._rows]

    def toCSV(self) -> str:
        """The rows as comma-separated values with a header; what does not exist is empty."""
        return csvTable(self.getTable(), [field.name for field in dataclasses.fields(BenchmarkRow)])

    def toMarkdown(self) -> str:
        """Two Markdown tables: methods by problem, the best first, and methods over all problems."""
        return f"{markdownTable(self._cells(), 2)}\n\n{markdownTable(self._summaryCells(), 1)}"

    def toLatex(self) -> str:
        """The same two tables in LaTeX, see :func:`~satsep_ot.methods.common.tables.latexTable`."""
        return f"{latexTable(self._cells(), 2)}\n\n{latexTable(self._summaryCells(), 1)}"

    def toText(self) -> str:
        """The same tables with aligned columns, then why there was no answer where there was none."""
        messages = [f"{row.problem}, {row.method}: {row.message}" for row in self._rows if row.failed]
        parts = [textTable(self._cells(), 2), textTable(self._summaryCells(), 1), "\n".join(messages)]
        return "\n\n".join(part for part in parts if part)

    def _cells(self):
        rows = sorted(
            self._rows,
            key=lambda row: (
                self._problems().index(row.problem),
                row.rank or math.inf,
                math.inf if row.cost is None else row.cost,
            ),
        )
        return [[*_COLUMNS], *([form(row) for form in _COLUMNS.values()] for row in rows)]

    def _summaryCells(self):
        """Methods by problems: runs to an error of 5 %, and as a multiple of the first method's.

        Whichever are more go down the page.
        """
        problems, summaries = self._problems(), self.getSummaries()
        first = summaries[0] if summaries else None
        header = ["method", "right", "open", "wrong", *problems, "all"]
        verdicts = {(row.problem, row.method): row.verdict for row in self._rows}
        cells = []
        for summary in summaries:
            counts = [str(count) for count in (summary.right, summary.open, summary.wrong)]
            costs = []
            for problem in problems:
                verdict = verdicts.get((problem, summary.method))
                if verdict in (None, WRONG):
                    costs.append("" if verdict is None else "wrong")
                else:
                    costs.append(_multiple(summary.costs.get(problem), first.costs.get(problem)))
            cells.append([summary.method, *counts, *costs, _multiple(summary.cost, first.cost)])
        table = [header, *cells]
        return table if len(problems) <= len(summaries) else [list(column) for column in zip(*table, strict=True)]

    def drawCost(self) -> ot.Graph:
        """Runs to an error of 5 % on each problem, of the methods that are not wrong there."""
        problems = self._problems()
        rows = [row for row in self._rows if row.verdict != WRONG and row.cost]
        graph = ot.Graph("Cost of the methods that are not wrong", "runs to an error of 5 %", "", True)
        self._addClouds(graph, [(row, [row.cost, -float(problems.index(row.problem))]) for row in rows])
        if rows:
            # Problems from the top down; their names stand on the left, above the line, where room is kept for them.
            costs = [row.cost for row in rows if row.cost]
            least, most = min(costs) / 1.5, max(costs) * 1.5
            left = least * (least / most) ** (0.014 * max(map(len, problems)))
            names = ot.Text([[left, 0.2 - place] for place in range(len(problems))], problems, "right")
            names.setColor("black")
            graph.add(names)
            graph.setLogScale(ot.GraphImplementation.LOGX)
            graph.setBoundingBox(ot.Interval([left, 0.5 - len(problems)], [most, 0.5]))
            graph.setTickLocation(ot.GraphImplementation.TICKX)
        return graph

    def drawErrors(self) -> ot.Graph:
        """Measured against claimed error; above the diagonal a method claims too much."""
        rows = [row for row in self._rows if row.claimed and row.error]
        graph = ot.Graph("Measured and claimed error", "claimed", "measured", True)
        self._addClouds(graph, [(row, [row.claimed, row.error]) for row in rows])
        if rows:
            errors = [error for row in rows for error in (row.claimed, row.error) if error]
            edges = [min(errors), max(errors)]
            diagonal = ot.Curve(edges, edges)
            diagonal.setColor("black")
            graph.add(diagonal)
            graph.setLogScale(ot.GraphImplementation.LOGXY)
        return graph

    def _addClouds(self, graph, points):
        """A cloud for each method from pairs of a row and a point, and the legend beside the graph."""
        methods = list(dict.fromkeys(row.method for row in self._rows))
        palette = ot.Drawable.BuildDefaultPalette(max(len(methods), 1))
        styles = ("fcircle", "fsquare", "fdiamond", "ftriangleup", "plus", "times", "star")
        for place, method in enumerate(methods):
            mine = [point for row, point in points if row.method == method]
            if mine:
                graph.add(ot.Cloud(ot.Sample(mine), palette[place], styles[place % len(styles)], method))
        graph.setLegendPosition("upper left")
        graph.setLegendCorner([1.02, 1.0])


def _percent(value):
    return "" if value is None else f"{100.0 * value:.2f}" if abs(value) < 0.1 else f"{100.0 * value:.0f}"


def _number(value):
    return "" if value is None else f"{value:,.0f}" if value < 1e9 else f"{value:.1e}"


# Columns of the tables: what is read from a row.
_COLUMNS: dict[str, Callable[[BenchmarkRow], str]] = {
    "problem": lambda row: row.problem,
    "method": lambda row: row.method,
    "rank": lambda row: "" if row.rank is None else str(row.rank),
    "verdict": lambda row: row.verdict if row.needed is None else f"open, needs {row.needed}",
    "repetitions": lambda row: str(row.repetitions),
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


def _multiple(cost, least):
    """A cost, and how often it holds another one."""
    if cost is None:
        return ""
    return _number(cost) if not least or cost == least else f"{_number(cost)} (x {cost / least:.3g})"
