"""Run reliability methods on one event under the same accounting: evaluations, gradients, seconds, failures to run.

To add a method, derive from `ReliabilityMethod`, or from `SimulationMethod` for a simulation algorithm of OpenTURNS.
"""

import abc
import csv
import dataclasses
import io
import math
import time
from collections.abc import Callable, Sequence

import numpy as np
import openturns as ot
import openturns.experimental as otexp

from satsep_ot.methods.limit_state_event import Limit, callFunction, eventKind
from satsep_ot.methods.reliability import ActiveSubspaceReliability
from satsep_ot.methods.reliability_result import clopperPearson
from satsep_ot.methods.standard_space import StandardSpace


class Counter:
    """Numbers of evaluations and gradients, kept outside of the functions that OpenTURNS copies."""

    def __init__(self):
        self.evaluations = 0
        self.gradients = 0


def hasGradient(function: ot.Function) -> bool:
    """Whether a function, or every part of a composed one, has a gradient that is not by finite differences.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.comparison import hasGradient
    >>> hasGradient(ot.SymbolicFunction("x", "x^2")), hasGradient(ot.PythonFunction(1, 1, lambda x: x))
    (True, False)
    """
    return "FiniteDifference" not in repr(function.getGradient())


def countingFunction(function: ot.Function, counter: Counter, distribution: ot.Distribution) -> ot.Function:
    """The same function, counting its evaluations and gradients in ``counter``.

    A function without a gradient of its own gets centred differences whose steps are 1e-3 standard deviations of each
    input, which are evaluations; OpenTURNS' own step is the same number for all inputs, whatever their size. The
    Hessian is by differences: of gradients where there are any, otherwise of values.
    """
    d, p = function.getInputDimension(), function.getOutputDimension()
    steps = 1e-3 * np.array(distribution.getStandardDeviation())

    # Closures: a copy of the Python function by OpenTURNS shares them, so nothing is counted in a copy and lost.
    def evaluate(sample):
        values = callFunction(function, np.asarray(sample, dtype=float))
        counter.evaluations += len(values)
        return values

    def gradient(point):
        counter.gradients += 1
        return np.array(function.gradient(point))

    def hessian(point):
        result = np.empty((d, d, p))
        for i, step in enumerate(steps):
            shift = np.zeros(d)
            shift[i] = step
            result[i] = (gradient(np.asarray(point) + shift) - gradient(np.asarray(point) - shift)) / (2.0 * step)
        return 0.5 * (result + result.transpose(1, 0, 2))

    if hasGradient(function):
        return ot.PythonFunction(d, p, func_sample=evaluate, gradient=gradient, hessian=hessian)
    counting = ot.PythonFunction(d, p, func_sample=evaluate)
    counting.setGradient(ot.CenteredFiniteDifferenceGradient(steps.tolist(), counting.getEvaluation()))
    # The rounding error of a second difference is divided by the square of the step.
    counting.setHessian(ot.CenteredFiniteDifferenceHessian((30.0 * steps).tolist(), counting.getEvaluation()))
    return counting


@dataclasses.dataclass
class CountedProblem:
    """What a method is given: an event that counts, and ways to use what is known of it.

    Attributes
    ----------
    event : :py:class:`openturns.ThresholdEvent`
    distribution : :py:class:`openturns.Distribution`
    counter : Counter
    components : tuple or None
        Arguments of :meth:`ActiveSubspaceReliability.setComponents`, counting as well.
    isFailure : callable
        Maps inputs (n, d) on the booleans (n,) of the event, which counts.
    report : callable
        To be called with a percentage; returns True when the method should stop.
    """

    event: ot.ThresholdEvent
    distribution: ot.Distribution
    counter: Counter
    components: tuple | None
    isFailure: Callable[[np.ndarray], np.ndarray]
    report: Callable[[float], bool]


@dataclasses.dataclass
class Row:
    """Outcome of one method on one event. A number that the method does not have is None, never NaN or 0.

    Examples
    --------
    >>> from satsep_ot.methods.comparison import Row
    >>> print(Row("FORM", probability=1e-3).upper95)
    None
    """

    method: str
    probability: float | None = None
    lower95: float | None = None
    upper95: float | None = None
    coefficient_of_variation: float | None = None
    evaluations: int = 0
    gradients: int = 0
    seconds: float = 0.0
    converged: bool = False
    note: str = ""


class ReliabilityMethod(abc.ABC):
    """A way to estimate a probability of failure. ``name`` is what tables show.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.comparison import ReliabilityComparison, ReliabilityMethod, Row
    >>> class HundredRuns(ReliabilityMethod):
    ...     name = "HundredRuns"
    ...     def run(self, problem):
    ...         share = problem.isFailure(np.array(problem.distribution.getSample(100))).mean()
    ...         return Row(self.name, float(share))
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction("x", "x"), ot.RandomVector(ot.Normal()))
    >>> comparison = ReliabilityComparison(ot.ThresholdEvent(vector, ot.Greater(), 0.0), [HundredRuns()])
    >>> comparison.run()
    >>> comparison.getResult().getRow("HundredRuns").evaluations
    100
    """

    name: str

    @abc.abstractmethod
    def run(self, problem: CountedProblem) -> Row:
        """Estimate; evaluations, gradients and seconds of the row are filled in by the comparison."""

    def __repr__(self):
        settings = ", ".join(f"{key}={value!r}" for key, value in vars(self).items())
        return f"{type(self).__name__}({settings})"


def _raiseInterrupt(error):
    """OpenTURNS turns an interrupt inside a Python function into a RuntimeError: turn it back."""
    if "KeyboardInterrupt" in str(error):
        raise KeyboardInterrupt from error


def _logNormalInterval(probability, variation):
    width = 1.959963984540054 * math.sqrt(math.log1p(variation**2))
    return probability * math.exp(-width), min(probability * math.exp(width), 1.0)


class ActiveSubspace(ReliabilityMethod):
    """`ActiveSubspaceReliability`, with the components of the comparison where there are any.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumEvaluations : int
    mode : str
        ``"fast"`` or ``"safe"``.

    Notes
    -----
    `getLastResult` has all that the row does not.

    Examples
    --------
    >>> from satsep_ot.methods.comparison import ActiveSubspace
    >>> ActiveSubspace(targetCoefficientOfVariation=0.1).name
    'ActiveSubspace'
    """

    name = "ActiveSubspace"

    def __init__(self, targetCoefficientOfVariation=0.05, maximumEvaluations=5000, mode="fast"):
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumEvaluations = maximumEvaluations
        self.mode = mode

    def getLastResult(self):
        """The `ActiveSubspaceReliabilityResult` of the last run."""
        return self._result

    def __repr__(self):
        return (
            f"ActiveSubspace(targetCoefficientOfVariation={self.targetCoefficientOfVariation}, "
            f"maximumEvaluations={self.maximumEvaluations}, mode={self.mode!r})"
        )

    def run(self, problem):
        algorithm = ActiveSubspaceReliability(problem.event)
        if problem.components is not None:
            algorithm.setComponents(*problem.components)
        algorithm.setTargetCoefficientOfVariation(self.targetCoefficientOfVariation)
        algorithm.setMaximumEvaluations(self.maximumEvaluations)
        algorithm.setMode(self.mode)
        percentage = [0.0]
        algorithm.setProgressCallback(lambda value: percentage.__setitem__(0, value))
        algorithm.setStopCallback(lambda: problem.report(percentage[0]))
        algorithm.run()
        self._result = result = algorithm.getResult()
        interval = result.getConfidenceInterval(0.95)
        variation = result.getCoefficientOfVariation()
        return Row(
            self.name,
            result.getProbabilityEstimate(),
            interval.getLowerBound()[0],
            interval.getUpperBound()[0],
            variation if math.isfinite(variation) else None,
            converged=result.getConverged(),
            note=result.getReason(),
        )


class FORM(ReliabilityMethod):
    """First-order method by Abdo-Rackwitz, by SQP where that does not reach the limit state, at last by Cobyla.

    The search starts at 0.1 in every coordinate of the standard space: at the origin itself the gradient of a norm or
    of an absolute value does not exist. There is no interval: nothing tells how far the limit state is from its tangent
    plane.

    Parameters
    ----------
    maximumIterations : int
        Of each solver.
    start : float
        Coordinate of the starting point in standard space.

    Examples
    --------
    >>> from satsep_ot.methods.comparison import FORM
    >>> FORM(start=0.2).name
    'FORM'
    """

    name = "FORM"

    def __init__(self, maximumIterations=100, start=0.1):
        self.maximumIterations = maximumIterations
        self.start = start

    def solve(self, problem, algorithmClass):
        """Result of FORM or SORM, whether the design point was reached, and a note."""
        space = StandardSpace(problem.distribution)
        start = space.toPhysical(np.full((1, space.getDimension()), self.start))[0]
        notes = []
        for solver in (ot.AbdoRackwitz(), ot.SQP(), ot.Cobyla()):
            solver.setStartingPoint(start)
            solver.setMaximumIterationNumber(self.maximumIterations)
            solver.setMaximumCallsNumber(30 * self.maximumIterations)
            algorithm = algorithmClass(solver, problem.event)
            try:
                algorithm.run()
            except RuntimeError as error:
                _raiseInterrupt(error)
                notes.append(f"{solver.getClassName()}: {error}")
                continue
            result = algorithm.getResult()
            optimum = result.getOptimizationResult()
            notes.append(
                f"{solver.getClassName()}: reliability index {result.getHasoferReliabilityIndex():.4f} after "
                f"{optimum.getCallsNumber()} calls"
            )
            return result, optimum.getStatus() == ot.OptimizationResult.SUCCESS, "; ".join(notes)
        raise RuntimeError("no solver reached the limit state: " + "; ".join(notes))

    def run(self, problem):
        result, converged, note = self.solve(problem, ot.FORM)
        return Row(self.name, result.getEventProbability(), converged=converged, note=note)


class SORM(FORM):
    """Second-order method at FORM's design point: Breitung's formula, with those of Hohenbichler and Tvedt in the note.

    The Hessian is by differences: 2 d gradients, or about 2 d^2 evaluations of a function without gradient.

    Examples
    --------
    >>> from satsep_ot.methods.comparison import SORM
    >>> SORM(maximumIterations=50).name
    'SORM'
    """

    name = "SORM"

    def run(self, problem):
        result, converged, note = self.solve(problem, ot.SORM)
        for formula in ("Hohenbichler", "Tvedt"):
            try:
                note += f"; {formula} {getattr(result, f'getEventProbability{formula}')():.3e}"
            except RuntimeError:
                note += f"; {formula} not defined here"
        return Row(self.name, result.getEventProbabilityBreitung(), converged=converged, note=note)


class MonteCarlo(ReliabilityMethod):
    """Crude Monte Carlo with the Clopper-Pearson interval.

    Parameters
    ----------
    size : int
        Number of evaluations.
    blockSize : int
        Evaluations at a time.

    Examples
    --------
    >>> from satsep_ot.methods.comparison import MonteCarlo
    >>> MonteCarlo(size=10000).name
    'MonteCarlo'
    """

    name = "MonteCarlo"

    def __init__(self, size=1_000_000, blockSize=50_000):
        self.size = int(size)
        self.blockSize = int(blockSize)

    def run(self, problem):
        failures = done = 0
        stopped = False
        while done < self.size and not stopped:
            block = min(self.blockSize, self.size - done)
            failures += int(np.count_nonzero(problem.isFailure(np.asarray(problem.distribution.getSample(block)))))
            done += block
            stopped = problem.report(100.0 * done / self.size) and done < self.size
        share = failures / done
        lower, upper = clopperPearson(failures, done)
        note = f"{failures} failures" + (", stopped by the stop callback" if stopped else "")
        variation = math.sqrt((1.0 - share) / (share * done)) if failures else None
        return Row(self.name, share, lower, upper, variation, converged=not stopped, note=note)


class SimulationMethod(ReliabilityMethod):
    """Base of OpenTURNS' simulation algorithms: `build` makes the algorithm."""

    interval_note = ""

    @abc.abstractmethod
    def build(self, problem: CountedProblem):
        """The OpenTURNS algorithm, ready to run."""

    def run(self, problem):
        algorithm = self.build(problem)
        algorithm.run()
        result = algorithm.getResult()
        probability, variation = result.getProbabilityEstimate(), result.getCoefficientOfVariation()
        if not (probability > 0.0 and 0.0 <= variation < math.inf):
            return Row(self.name, note=f"no usable estimate: probability {probability:g} with variation {variation:g}")
        incomplete = self.incomplete(problem, algorithm)
        if incomplete:
            return Row(self.name, note=incomplete)
        lower, upper = _logNormalInterval(probability, variation)
        return Row(self.name, probability, lower, upper, variation, converged=True, note=self.interval_note)

    def incomplete(self, problem: CountedProblem, algorithm) -> str:
        """Why the result does not stand for the event; empty when it does."""
        return ""


class SubsetSampling(SimulationMethod):
    """OpenTURNS' subset sampling.

    Parameters
    ----------
    levelSize : int
        Evaluations of each level.
    conditionalProbability : float
        p0; blocks are p0 times the level, since larger ones break the chains.

    Examples
    --------
    >>> from satsep_ot.methods.comparison import SubsetSampling
    >>> SubsetSampling(levelSize=2000).name
    'SubsetSampling'
    """

    name = "SubsetSampling"
    interval_note = "the claimed error takes the levels for independent, so the interval is somewhat short"

    def __init__(self, levelSize=4000, conditionalProbability=0.1):
        self.levelSize = int(levelSize)
        self.conditionalProbability = conditionalProbability

    def build(self, problem):
        algorithm = ot.SubsetSampling(problem.event)
        block = max(int(self.conditionalProbability * self.levelSize), 1)
        algorithm.setBlockSize(block)
        algorithm.setMaximumOuterSampling(math.ceil(self.levelSize / block))
        algorithm.setConditionalProbability(self.conditionalProbability)
        return algorithm

    def incomplete(self, problem, algorithm):
        # OpenTURNS reports the product of its levels also where they stop short of the event.
        reached = algorithm.getThresholdPerStep()[-1]
        if reached == problem.event.getThreshold():
            return ""
        return f"the levels ended at {reached:g}, short of the threshold {problem.event.getThreshold():g}"


class ImportanceSampling(SimulationMethod):
    """FORM, then importance sampling around its design point; blind to every other failure mode.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumEvaluations : int
        Of the sampling.

    Examples
    --------
    >>> from satsep_ot.methods.comparison import ImportanceSampling
    >>> ImportanceSampling(maximumEvaluations=5000).name
    'ImportanceSampling'
    """

    name = "ImportanceSampling"

    def __init__(self, targetCoefficientOfVariation=0.05, maximumEvaluations=20_000):
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumEvaluations = maximumEvaluations

    def build(self, problem):
        result, converged, note = FORM().solve(problem, ot.FORM)
        if not converged:
            raise RuntimeError(f"FORM has no design point to sample around: {note}")
        algorithm = ot.PostAnalyticalImportanceSampling(result)
        return _limited(algorithm, self.targetCoefficientOfVariation, self.maximumEvaluations)


class DirectionalSampling(SimulationMethod):
    """OpenTURNS' directional sampling; its evaluations per direction add to the limit on directions.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumDirections : int

    Examples
    --------
    >>> from satsep_ot.methods.comparison import DirectionalSampling
    >>> DirectionalSampling(maximumDirections=100).name
    'DirectionalSampling'
    """

    name = "DirectionalSampling"

    def __init__(self, targetCoefficientOfVariation=0.05, maximumDirections=5000):
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumDirections = maximumDirections

    def build(self, problem):
        algorithm = ot.DirectionalSampling(problem.event)
        return _limited(algorithm, self.targetCoefficientOfVariation, self.maximumDirections)


class LineSampling(SimulationMethod):
    """OpenTURNS' line sampling along FORM's design point, the direction kept fixed.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumLines : int

    Examples
    --------
    >>> from satsep_ot.methods.comparison import LineSampling
    >>> LineSampling(maximumLines=100).name
    'LineSampling'
    """

    name = "LineSampling"

    def __init__(self, targetCoefficientOfVariation=0.05, maximumLines=1000):
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumLines = maximumLines

    def build(self, problem):
        result, converged, note = FORM().solve(problem, ot.FORM)
        if not converged:
            raise RuntimeError(f"FORM has no design point to take the direction from: {note}")
        algorithm = otexp.LineSampling(problem.event, result.getStandardSpaceDesignPoint())
        algorithm.setAdaptiveImportantDirection(False)
        return _limited(algorithm, self.targetCoefficientOfVariation, self.maximumLines, block=10)


def _limited(algorithm, target, maximum, block=100):
    algorithm.setMaximumCoefficientOfVariation(target)
    algorithm.setBlockSize(block)
    algorithm.setMaximumOuterSampling(math.ceil(maximum / block))
    return algorithm


class NAIS(SimulationMethod):
    """OpenTURNS' non-parametric adaptive importance sampling.

    Parameters
    ----------
    levelSize : int
        Evaluations of each level.
    quantile : float
        Share of the points that the next level is fitted to.

    Examples
    --------
    >>> from satsep_ot.methods.comparison import NAIS
    >>> NAIS(levelSize=1000).name
    'NAIS'
    """

    name = "NAIS"

    def __init__(self, levelSize=2000, quantile=0.1):
        self.levelSize = levelSize
        self.quantile = quantile

    def build(self, problem):
        algorithm = ot.NAIS(problem.event, self.quantile)
        algorithm.setBlockSize(1000)
        algorithm.setMaximumOuterSampling(math.ceil(self.levelSize / 1000))
        return algorithm


# The methods by name, each with its default settings.
METHODS: dict[str, type[ReliabilityMethod]] = {
    method.name: method
    for method in (
        ActiveSubspace,
        FORM,
        SORM,
        SubsetSampling,
        MonteCarlo,
        ImportanceSampling,
        DirectionalSampling,
        LineSampling,
        NAIS,
    )
}
DEFAULT_METHODS = ("ActiveSubspace", "FORM", "SORM", "SubsetSampling", "MonteCarlo")


class ReliabilityComparison:
    """Several methods on one event, with every evaluation and gradient counted.

    An exception is a row with its message and without a probability.

    Parameters
    ----------
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
    methods : sequence of str or ReliabilityMethod, optional
        Names of `METHODS` for default settings. By default ActiveSubspace, FORM, SORM, SubsetSampling, MonteCarlo.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.comparison import MonteCarlo, ReliabilityComparison
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction("x", "x"), ot.RandomVector(ot.Normal()))
    >>> event = ot.ThresholdEvent(vector, ot.Greater(), 2.0)
    >>> comparison = ReliabilityComparison(event, ["FORM", MonteCarlo(size=10000)])
    >>> comparison.run()
    >>> rows = comparison.getResult().getRows()
    >>> f"{rows[0].probability:.5f}", rows[0].lower95, rows[1].evaluations
    ('0.02275', None, 10000)
    """

    def __init__(self, event, methods: Sequence[str | ReliabilityMethod] | None = None):
        self._event = event
        self._methods = [_method(method) for method in (DEFAULT_METHODS if methods is None else methods)]
        self._components = None
        self._progressCallback = None
        self._rowCallback = None
        self._stopCallback = None
        self._result = None

    def __repr__(self):
        return f"ReliabilityComparison(methods={[method.name for method in self._methods]})"

    def setComponents(self, function, composition, smoothIndices=None, surrogateComposition=None) -> None:
        """Components for ActiveSubspace, see :meth:`ActiveSubspaceReliability.setComponents`."""
        self._components = (function, composition, smoothIndices, surrogateComposition)

    def setProgressCallback(self, callback: Callable[[str, float], None] | None) -> None:
        """Called with the name of the running method and its percentage: 0 at its start, 100 at its end."""
        self._progressCallback = callback

    def setRowCallback(self, callback: Callable[[Row], None] | None) -> None:
        """Called with the row of each method as soon as it is there."""
        self._rowCallback = callback

    def setStopCallback(self, callback: Callable[[], bool] | None) -> None:
        """When it returns True the running method ends with what it has, and no other is started."""
        self._stopCallback = callback

    def run(self) -> None:
        """Run the methods one after the other."""
        self._result = ReliabilityComparisonResult([])
        for method in self._methods:
            if self._stopCallback is not None and self._stopCallback():
                return
            row = self._runMethod(method)
            self._result.getRows().append(row)
            if self._rowCallback is not None:
                self._rowCallback(row)

    def getResult(self) -> "ReliabilityComparisonResult":
        """Accessor to the rows; those so far, when run() was interrupted."""
        if self._result is None:
            raise RuntimeError("there is no result yet; call run() first")
        return self._result

    def _runMethod(self, method):
        counter = Counter()

        def report(percentage):
            if self._progressCallback is not None:
                self._progressCallback(method.name, percentage)
            return bool(self._stopCallback is not None and self._stopCallback())

        report(0.0)
        start = time.perf_counter()
        try:
            row = method.run(self._problem(counter, report))
        except Exception as error:
            _raiseInterrupt(error)
            row = Row(method.name, note=f"{type(error).__name__}: {error}")
        row.seconds = time.perf_counter() - start
        row.evaluations, row.gradients = counter.evaluations, counter.gradients
        report(100.0)
        return row

    def _problem(self, counter, report):
        limit = Limit.of(self._event)
        distribution = limit.vector.getDistribution()
        components = self._components
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

        def isFailure(x):
            values = callFunction(counting, x)
            if not np.isfinite(values).all():
                row = int(np.argmin(np.isfinite(values).all(axis=1)))
                raise ValueError(f"the event's variable is not finite at input {x[row].tolist()}")
            return compare(values) <= 0.0

        return CountedProblem(event, distribution, counter, components, isFailure, report)


def _method(method):
    if isinstance(method, ReliabilityMethod):
        return method
    if method not in METHODS:
        raise ValueError(f"no reliability method is called {method!r}; there are {', '.join(METHODS)}")
    return METHODS[method]()


class ReliabilityComparisonResult:
    """Rows of a `ReliabilityComparison`.

    Parameters
    ----------
    rows : list of Row

    Examples
    --------
    >>> from satsep_ot.methods.comparison import ReliabilityComparisonResult, Row
    >>> result = ReliabilityComparisonResult([Row("FORM", 1e-3, evaluations=12, converged=True)])
    >>> print(result.toCSV().splitlines()[1])
    FORM,0.001,,,,12,0,0.0,True,
    """

    def __init__(self, rows: list[Row]):
        self._rows = rows

    def __repr__(self):
        return f"ReliabilityComparisonResult(methods={[row.method for row in self._rows]})"

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
        stream = io.StringIO()
        writer = csv.DictWriter(stream, [field.name for field in dataclasses.fields(Row)], lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.getTable())
        return stream.getvalue()

    def toMarkdown(self) -> str:
        """The rows as a Markdown table."""
        names = [field.name for field in dataclasses.fields(Row)]
        lines = ["| " + " | ".join(names) + " |", "|" + " --- |" * len(names)]
        for row in self.getTable():
            cells = ["" if v is None else f"{v:.4g}" if isinstance(v, float) else str(v) for v in row.values()]
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
        return "\n".join(lines)

    def drawProbabilities(self) -> ot.Graph:
        """Probability of each method with its 95 % interval, on a logarithmic axis."""
        graph = ot.Graph("Probability by method", "probability", "method", True, "upper right")
        shown = [row for row in self._rows if row.probability]
        for height, row in enumerate(shown):
            color = ot.Drawable.BuildDefaultPalette(len(shown))[height]
            graph.add(ot.Cloud([[row.probability, height]], color, "fcircle", row.method))
            if row.lower95 is not None and row.lower95 > 0.0:
                bar = ot.Curve([row.lower95, row.upper95], [height, height])
                bar.setColor(color)
                bar.setLineWidth(2.0)
                graph.add(bar)
        graph.setLogScale(ot.GraphImplementation.LOGX)
        return graph
