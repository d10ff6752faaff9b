"""Run reliability methods on one event under the same accounting: evaluations, gradients, seconds, failures to run."""

import dataclasses
import os
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.methods.common.run_log import CheckpointFile, fingerprintOf, loggedFunction
from satsep_ot.methods.common.tables import csvTable, latexTable, markdownTable, textTable
from satsep_ot.methods.comparison.method import CountedProblem, ReliabilityMethod, Row
from satsep_ot.methods.comparison.methods import makeMethod
from satsep_ot.methods.reliability.limit_state import Limit, checkedKind
from satsep_ot.openturns_adapter import (
    Counter,
    callFunction,
    countingFunction,
    errorMessage,
    eventKind,
    generatorState,
    raiseInterrupt,
    setGeneratorState,
)
from satsep_ot.openturns_object import OpenTURNSObject

# A method that may make more is named before a comparison without a limit begins.
TOLD_EVALUATIONS = 100_000
DEFAULT_METHODS = ("ActiveSubspace", "FORM", "SORM", "SubsetSampling", "MonteCarlo")


class ReliabilityComparison(OpenTURNSObject):
    """Several methods on one event, with every evaluation and gradient counted.

    An exception is a row with its message and without a probability.

    Parameters
    ----------
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
    methods : sequence of str or ReliabilityMethod, optional
        Names of `METHODS` for default settings. By default ActiveSubspace, FORM, SORM, SubsetSampling, MonteCarlo.

    Raises
    ------
    TypeError
        The event is none of these.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.comparison.comparison import ReliabilityComparison
    >>> from satsep_ot.methods.comparison.simulations import MonteCarlo
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction("x", "x"), ot.RandomVector(ot.Normal()))
    >>> event = ot.ThresholdEvent(vector, ot.Greater(), 2.0)
    >>> comparison = ReliabilityComparison(event, ["FORM", MonteCarlo(size=10000)])
    >>> comparison.run()
    >>> rows = comparison.getResult().getRows()
    >>> f"{rows[0].probability:.5f}", rows[0].lower95, rows[1].evaluations
    ('0.02275', None, 10000)
    """

    def __init__(
        self,
        event: ot.ThresholdEvent | ot.UnionEvent | ot.IntersectionEvent | ot.DomainEvent,
        methods: Sequence[str | ReliabilityMethod] | None = None,
    ) -> None:
        checkedKind(event)
        self._event = event
        self._methods = [makeMethod(method) for method in (DEFAULT_METHODS if methods is None else methods)]
        self._components: tuple | None = None
        self._progressCallback: Callable[[str, float], None] | None = None
        self._rowCallback: Callable[[Row], None] | None = None
        self._runsCallback: Callable[[np.ndarray, np.ndarray], None] | None = None
        self._stopCallback: Callable[[], bool] | None = None
        self._budget: int | None = None
        self._checkpointFile: Path | None = None
        self._checksModel = True
        self._announces = True
        self._result: ReliabilityComparisonResult | None = None

    def _shown(self):
        return {"methods": [method.name for method in self._methods]}

    def setComponents(
        self,
        function: ot.Function,
        composition: ot.Function,
        smoothIndices: Sequence[int] | None = None,
        surrogateComposition: ot.Function | None = None,
    ) -> None:
        """Components for ActiveSubspace, see :meth:`ActiveSubspaceReliability.setComponents`."""
        kind = eventKind(self._event)
        if kind != "ThresholdEvent":
            raise TypeError(f"components can be given for a ThresholdEvent only, not for a {kind}")
        self._components = (function, composition, smoothIndices, surrogateComposition)

    def setProgressCallback(self, callback: Callable[[str, float], None] | None) -> None:
        """Called with the name of the running method and its percentage: 0 at its start, 100 at its end."""
        self._progressCallback = callback

    def setRowCallback(self, callback: Callable[[Row], None] | None) -> None:
        """Called with the row of each method as soon as it is there."""
        self._rowCallback = callback

    def setRunsCallback(self, callback: Callable[[np.ndarray, np.ndarray], None] | None) -> None:
        """Called with the inputs (n, d) and outputs (n, p) of every true run, in the order of their making."""
        self._runsCallback = callback

    def setStopCallback(self, callback: Callable[[], bool] | None) -> None:
        """When it returns True the running method ends with what it has, and no other is started."""
        self._stopCallback = callback

    def setMaximumEvaluations(self, number: int | None) -> None:
        """Limit of the evaluations and gradients of each method, together.

        A method whose settings bound its evaluations is set to this bound; any other ends where its next evaluations
        would exceed it, without a probability. None is no limit.

        Without a call of this method, run() begins with a warning that names the methods that may make more than
        100,000 evaluations.
        """
        if number is not None and (int(number) != number or number < 1):
            raise ValueError(
                f"the maximum of evaluations is {number}; it must be a whole number of at least 1, or None"
            )
        self._budget = None if number is None else int(number)
        self._announces = False

    def setCheckpointFile(self, path: str | os.PathLike | None, checksModel: bool = True) -> None:
        """Keep every true run in this file, and continue from it where it is there; None (default) for no file.

        Each call of the event's function is in the file before the next one. A run() that was killed is continued by
        the same one: every method begins at the random numbers at which it began, takes from the file the runs that are
        there, and gives the row that it would have given, but for the seconds. Reading the file executes nothing.

        Parameters
        ----------
        path : str or path, optional
            A file of its own for each comparison. Runs of cheap functions take longer to write than to make.
        checksModel : bool
            Whether one run is made again at first, which no row counts, so that runs of another function are refused:
            beside names, no other trace of a Python function can be compared. False for a function that is noisy.
        """
        self._checkpointFile = None if path is None else Path(path)
        self._checksModel = bool(checksModel)

    def run(self) -> None:
        """Run the methods one after the other.

        Raises
        ------
        ValueError
            The checkpoint file is damaged, or that of another comparison or model.
        """
        dear = {method.name: method.getMaximumEvaluations() or 0 for method in self._methods}
        told = ", ".join(f"{name} up to {number:,}" for name, number in dear.items() if number > TOLD_EVALUATIONS)
        if self._announces and told:
            warnings.warn(
                f"no limit of evaluations is set: {told}; setMaximumEvaluations() sets one for each method, "
                "or None for no limit and no warning",
                stacklevel=2,
            )
        self._result = ReliabilityComparisonResult([])
        file = self._openCheckpoint()
        for place, method in enumerate(self._methods):
            if self._stopCallback is not None and self._stopCallback():
                return
            row = self._runMethod(method, None if file is None else self._continueMethod(file, place))
            self._result.getRows().append(row)
            if self._rowCallback is not None:
                self._rowCallback(row)

    def getResult(self) -> "ReliabilityComparisonResult":
        """Accessor to the rows; those so far, when run() was interrupted."""
        if self._result is None:
            raise RuntimeError("there is no result yet; call run() first")
        return self._result

    def _openCheckpoint(self):
        if self._checkpointFile is None:
            return None
        things = {
            "distribution": Limit.of(self._event).vector.getDistribution(),
            "event": self._event,
            "components": self._components,
            "methods": self._methods,
            "maximum of evaluations": self._budget,
        }
        return CheckpointFile(self._checkpointFile, fingerprintOf(**things), {})

    def _continueMethod(self, file, place):
        """The true runs of a method that are there; random numbers go on as at its beginning."""
        section = f"{place} {self._methods[place].name}"
        setGeneratorState(file.enterSection(section, generatorState()))
        log = file.log(section)
        if place == 0 and self._checksModel:
            for name, function in self._ownFunctions().items():
                log.checkModel(name, lambda x, function=function: callFunction(function, x))
        return log

    def _ownFunctions(self):
        """The user's functions, by the names that a checkpoint knows."""
        functions = {"function": Limit.of(self._event).function}
        return functions if self._components is None else {**functions, "components": self._components[0]}

    def _runMethod(self, method, log):
        counter = Counter(self._runsCallback, self._budget)
        if self._budget is not None:
            method = method.within(self._budget)

        def report(percentage):
            if self._progressCallback is not None:
                self._progressCallback(method.name, percentage)
            return bool(self._stopCallback is not None and self._stopCallback())

        report(0.0)
        start = time.perf_counter()
        try:
            row = method.run(self._problem(counter, report, log))
        except Exception as error:
            raiseInterrupt(error)
            if log is not None and log.refused is not None:
                raise log.refused from error
            row = Row(method.name, note=f"{type(error).__name__}: {errorMessage(error)}")
        row.seconds = time.perf_counter() - start
        row.evaluations, row.gradients = counter.evaluations, counter.gradients
        report(100.0)
        return row

    def _problem(self, counter, report, log):
        limit = Limit.of(self._event)
        components = self._components
        if log is not None:
            own = {name: loggedFunction(log, name, function) for name, function in self._ownFunctions().items()}
            limit.function = own["function"]
            if components is not None:
                components = (own["components"], *components[1:])
        distribution = limit.vector.getDistribution()
        if eventKind(self._event) == "ThresholdEvent":
            function = limit.function
            operator, threshold = self._event.getOperator(), self._event.getThreshold()
        else:
            # Any other event becomes: its limit state function is at most 0; the outputs are its components.
            function = ot.PythonFunction(
                limit.function.getInputDimension(),
                1,
                func_sample=lambda x: limit.margin(callFunction(limit.function, np.asarray(x, dtype=float)))[:, None],
            )
            operator, threshold = ot.LessOrEqual(), 0.0
            if components is None:
                composition = ot.PythonFunction(
                    limit.function.getOutputDimension(),
                    1,
                    func_sample=lambda y: limit.margin(np.asarray(y, dtype=float))[:, None],
                )
                components = (limit.function, composition, None, None)
        counting = countingFunction(function, counter, distribution)
        vector = ot.CompositeRandomVector(counting, ot.RandomVector(distribution))
        event = ot.ThresholdEvent(vector, operator, threshold)
        if components is not None:
            components = (countingFunction(components[0], counter, distribution), *components[1:])
        compare = Limit.of(event).margin

        return CountedProblem(
            event, distribution, counter, components, lambda x: compare(callFunction(counting, x)) <= 0.0, report
        )


class ReliabilityComparisonResult(OpenTURNSObject):
    """Rows of a `ReliabilityComparison`.

    Parameters
    ----------
    rows : list of Row

    Examples
    --------
    >>> from satsep_ot.methods.comparison.comparison import ReliabilityComparisonResult
    >>> from satsep_ot.methods.comparison.method import Row
    >>> result = ReliabilityComparisonResult([Row("FORM", 1e-3, evaluations=12, converged=True)])
    >>> print(result.toCSV().splitlines()[1])
    FORM,0.001,,,,12,0,0.0,True,
    """

    def __init__(self, rows: list[Row]) -> None:
        self._rows = rows

    def _shown(self):
        return {"methods": [row.method for row in self._rows]}

    def getRows(self) -> list[Row]:
        """Accessor to the rows."""
        return self._rows

    def getRow(self, method: str) -> Row:
        """The row of a method."""
        for row in self._rows:
            if row.method == method:
                return row
        raise ValueError(f"there is no row for {method!r}; there are {[row.method for row in self._rows]}")

    def getTable(self) -> list[dict]:
        """The rows as dictionaries of plain numbers, ready for JSON."""
        return [dataclasses.asdict(row) for row in self._rows]

    def toCSV(self) -> str:
        """The rows as comma-separated values with a header; what a method does not have is empty."""
        return csvTable(self.getTable(), [field.name for field in dataclasses.fields(Row)])

    def toMarkdown(self) -> str:
        """The rows as a Markdown table."""
        return markdownTable(self._cells(), 1)

    def toLatex(self) -> str:
        """The rows as a LaTeX table, see :func:`~satsep_ot.methods.common.tables.latexTable`; without the notes."""
        return latexTable([row[:-1] for row in self._cells()], 1)

    def toText(self) -> str:
        """The same table with aligned columns, and below it what the methods say of their results."""
        notes = [f"{row.method}: {row.note}" for row in self._rows if row.note]
        return "\n\n".join(
            part for part in (textTable([row[:-1] for row in self._cells()], 1), "\n".join(notes)) if part
        )

    def _cells(self):
        rows = [
            ["" if v is None else f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()]
            for row in self.getTable()
        ]
        return [[field.name for field in dataclasses.fields(Row)], *rows]

    def drawProbabilities(self) -> ot.Graph:
        """Probability of each method with its 95 % interval, on a logarithmic axis."""
        graph = ot.Graph("Probability by method", "probability", "", True, "upper left")
        # The legend stands beside the axes, where it hides nothing, in the order of the bars.
        graph.setLegendCorner([1.02, 1.0])
        graph.setTickLocation(ot.GraphImplementation.TICKX)
        shown = [row for row in self._rows if row.probability]
        for place, row in enumerate(shown):
            height = -float(place)
            color = ot.Drawable.BuildDefaultPalette(len(shown))[place]
            graph.add(ot.Cloud([[row.probability, height]], color, "fcircle", row.method))
            if row.lower95 is not None and row.lower95 > 0.0:
                bar = ot.Curve([row.lower95, row.upper95], [height, height])
                bar.setColor(color)
                bar.setLineWidth(2.0)
                graph.add(bar)
        graph.setLogScale(ot.GraphImplementation.LOGX)
        return graph
