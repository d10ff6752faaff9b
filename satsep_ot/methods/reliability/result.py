"""What ActiveSubspaceReliability has found, how sure it is, and what it rests on."""

import dataclasses
import math
import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.intervals import IntervalLaw
from satsep_ot.methods.common.storage import readResult, writeResult
from satsep_ot.methods.reliability import sensitivity as fs
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, Runs
from satsep_ot.methods.reliability.proposal import Pool, paretoShape
from satsep_ot.methods.reliability.surrogate import LimitStateSurrogate
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.openturns_adapter import fromXML

# Points that carry the surrogate's share of the failure distribution.
_SURROGATE_POINTS = 10_000
_CONTOUR_POINTS = 61
_FORMAT = "ActiveSubspaceReliabilityResult 3"


@dataclasses.dataclass
class Block:
    """True runs that a surrogate proposed before it had seen them.

    Attributes
    ----------
    surrogate : LimitStateSurrogate
    failure : array (N,)
        The surrogate's probability of failure at the points of the pool.
    pool : Pool
        Population that the runs were drawn from.
    surrogateProbability, poolVariance : float
        The surrogate's probability and the variance of its integration.
    corrections : array (n,)
        ``w (1_F - pi)``.
    expected : array (n,)
        ``w^2 pi (1 - pi)``: the squared corrections that the surrogate expected.
    weights : array (n,)
        Standard normal density over the density of the runs.
    runs : Runs
    """

    surrogate: LimitStateSurrogate
    failure: np.ndarray
    pool: Pool
    surrogateProbability: float
    poolVariance: float
    corrections: np.ndarray
    expected: np.ndarray
    weights: np.ndarray
    runs: Runs

    @property
    def size(self) -> int:
        """Number of true runs."""
        return len(self.weights)


class Estimate:
    """Unbiased estimate from blocks, weighted by their sizes.

    Parameters
    ----------
    blocks : list of Block
        At least one.
    """

    def __init__(self, blocks: list[Block]) -> None:
        sizes = np.array([block.size for block in blocks], dtype=float)
        total = sizes.sum()
        share = sizes / total
        corrections = np.concatenate([block.corrections for block in blocks])
        expected = np.concatenate([block.expected for block in blocks])
        self._corrections = np.abs(corrections)
        self.surrogateProbability = float(share @ [block.surrogateProbability for block in blocks])
        self.probability = self.surrogateProbability + float(corrections.mean())
        centred = np.concatenate([block.corrections - block.corrections.mean() for block in blocks])
        observed = float((centred**2).sum()) * total / max(total - len(blocks), 1.0)
        # Runs that happened to agree with the surrogate do not make it more certain than it said that it was.
        self.variance = max(observed, float(expected.sum())) / total**2
        # Blocks of the same pool share its error.
        for pool in {id(block.pool): block.pool for block in blocks}.values():
            mine = [index for index, block in enumerate(blocks) if block.pool is pool]
            self.variance += float(share[mine].sum() ** 2 * blocks[mine[0]].poolVariance)
        # Effective number of runs behind the variance (Satterthwaite): few large corrections make a long-tailed error.
        contributions = corrections**2 + expected
        squares = float((contributions**2).sum())
        self.freedom = max(float(contributions.sum()) ** 2 / squares, 1.0) if squares > 0.0 else math.inf
        self.failures = int(sum(block.runs.failed.sum() for block in blocks))
        self.size = int(total)

    def paretoShape(self) -> float:
        """Shape of the tail of the corrections, see `paretoShape`."""
        return paretoShape(self._corrections)

    def coefficientOfVariation(self) -> float:
        """Standard deviation over the estimate; infinite where the estimate is not positive."""
        return math.sqrt(self.variance) / self.probability if self.probability > 0.0 else math.inf

    def law(self) -> IntervalLaw:
        """Law of the interval."""
        return IntervalLaw(self.probability, self.variance, self.freedom)

    def interval(self, level: float) -> tuple[float, float]:
        """Log-normal interval with Student quantiles; from 0 where the estimate is not positive."""
        return self.law().bounds(level)


def failureSampleOf(
    blocks: list[Block], limitState: LimitStateEvent, generator: np.random.Generator
) -> fs.FailureSample:
    """The blocks' estimate as weighted points: the surrogate's failures, and the true runs' corrections of them."""
    total = sum(block.size for block in blocks)
    x, weights, expected, groups, failed, ratios = [], [], [], [], [], []
    inflation, common = [], []

    def add(points, weight, variance, inflated, shared, failures, ratio):
        groups.append(np.full(len(points), len(inflation)))
        x.append(points)
        weights.append(weight)
        expected.append(variance)
        failed.append(failures)
        ratios.append(ratio)
        inflation.append(inflated)
        common.append(shared)

    for mine in {id(block.pool): [other for other in blocks if other.pool is block.pool] for block in blocks}.values():
        first, share = mine[0], sum(block.size for block in mine) / total
        size = max(int(_SURROGATE_POINTS * share), 500)
        products = first.pool.weights * first.failure
        chosen = generator.choice(len(products), size=size, p=products / products.sum())
        u = first.surrogate.expand(first.pool.points[chosen], generator)
        none = np.zeros(size)
        add(
            limitState.space.toPhysical(u),
            np.full(size, share * first.surrogateProbability / size),
            none,
            # The pool is itself a sample.
            1.0 + size * float((products**2).sum()) / float(products.sum()) ** 2,
            first.poolVariance / first.surrogateProbability**2,
            none.astype(bool),
            none,
        )
    for block in blocks:
        add(
            block.runs.x,
            block.corrections / total,
            block.expected / total**2,
            1.0,
            0.0,
            block.runs.failed,
            block.weights,
        )
    return fs.FailureSample(  # type: ignore[call-arg]
        *(np.concatenate(part) for part in (x, weights, expected, groups)),
        np.array(inflation),
        np.array(common),
        np.concatenate(failed),
        np.concatenate(ratios),
    )


@dataclasses.dataclass
class SurrogateView:
    """What of a surrogate outlives the run: its directions, its native function, and the picture of its limit.

    Attributes
    ----------
    directions : array (d, k)
    dimensions : list of int
        Active directions of each component.
    active : array (n, k)
        The variables of the surrogate at the true runs.
    outputs : array (n, p)
        The modelled outputs there.
    metaModel : :py:class:`openturns.Function` or None
    reason : str
        Why there is no native function.
    axes, contour : array (2, m), array (m * m,)
        The surrogate's limit state in the plane of the first two variables, the first one fast; empty with one
        variable.
    """

    directions: np.ndarray
    dimensions: list[int]
    active: np.ndarray
    outputs: np.ndarray
    metaModel: ot.Function | None
    reason: str
    axes: np.ndarray
    contour: np.ndarray

    @staticmethod
    def of(surrogate: LimitStateSurrogate, limitState: LimitStateEvent, runs: Runs) -> "SurrogateView":
        """The view of a surrogate."""
        active = surrogate.reduce(runs.u)
        metaModel, reason = None, ""
        try:
            metaModel = surrogate.nativeFunction(limitState.space)
        except ValueError as error:
            reason = str(error)
        axes, contour = np.zeros((2, 0)), np.zeros(0)
        if active.shape[1] > 1:
            # The level 0 where the other active variables are at their median among the failed runs.
            rows = runs.failed if runs.failed.any() else np.ones(len(active), dtype=bool)
            bounds = [(active[:, j].min() - 0.5, active[:, j].max() + 0.5) for j in range(2)]
            axes = np.array([np.linspace(*bound, _CONTOUR_POINTS) for bound in bounds])
            first, second = np.meshgrid(*axes)
            y = np.repeat(np.median(active[rows], axis=0)[None], first.size, axis=0)
            y[:, 0], y[:, 1] = first.reshape(-1), second.reshape(-1)
            contour = surrogate.margin(surrogate.predict(y))
        dimensions = [fit.model.dimension for fit in surrogate.components]
        outputs = limitState.smooth(runs.outputs)
        return SurrogateView(surrogate.directions, dimensions, active, outputs, metaModel, reason, axes, contour)


class ActiveSubspaceReliabilityResult:
    """Result of :class:`~satsep_ot.methods.reliability.algorithm.ActiveSubspaceReliability`; made by its ``run()``.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
    >>> ot.RandomGenerator.SetSeed(0)
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["a + b"]), ot.RandomVector(ot.Normal(2)))
    >>> algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 4.0))
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> result.getConfidenceInterval(0.95).contains([ot.Normal().computeComplementaryCDF(4.0 / 2.0**0.5)])
    True
    >>> result.getEvaluationNumber() == sum(result.getPhases().values())
    True

    What a mean of 0.1 instead of 0 would do to the probability, without another run:

    >>> shifted = ot.Normal([0.1, 0.0], [1.0, 1.0], ot.CorrelationMatrix(2))
    >>> f"{result.computeProbability(shifted).probability / result.getProbabilityEstimate():.1f}"
    '1.2'
    """

    def __init__(
        self,
        event: Any,
        distribution: ot.Distribution,
        probability: float,
        variance: float,
        interval: Any,
        surrogateProbability: float | None,
        phases: dict[str, int],
        diagnostics: dict[str, Any],
        converged: bool,
        reason: str,
        method: str,
        runs: Any,
        history: list,
        view: Any,
        failureSample: Any,
        outputDescription: Sequence[str],
    ) -> None:
        self._event = event
        self._distribution = distribution
        self._probability = probability
        self._variance = variance
        self._interval = interval
        self._surrogateProbability = surrogateProbability
        self._phases = phases
        self._diagnostics = diagnostics
        self._converged = converged
        self._reason = reason
        self._method = method
        self._runs = runs
        self._history = history
        self._view = view
        self._failureSample = failureSample
        self._outputDescription = list(outputDescription)

    def __getstate__(self):
        # What is made when it is asked for is made from functions that no other process could import.
        fields = dict(vars(self))
        fields["_view"] = None if self._view is None else self._getView()
        if callable(self._failureSample):
            fields["_failureSample"] = self._failureSample()
        return fields

    def __repr__(self) -> str:
        interval = self.getConfidenceInterval()
        return (
            f"ActiveSubspaceReliabilityResult(probability={self._probability:.4e}, "
            f"interval=[{interval.getLowerBound()[0]:.4e}, {interval.getUpperBound()[0]:.4e}], "
            f"evaluations={self.getEvaluationNumber()}, converged={self._converged})"
        )

    def getProbabilityEstimate(self) -> float:
        """The unbiased estimate of the probability of the event."""
        return self._probability

    def getVarianceEstimate(self) -> float:
        """Variance of the estimate."""
        return self._variance

    def getStandardDeviation(self) -> float:
        """Standard deviation of the estimate."""
        return math.sqrt(self._variance)

    def getCoefficientOfVariation(self) -> float:
        """Standard deviation over the estimate; infinite when the estimate is 0."""
        return math.sqrt(self._variance) / self._probability if self._probability > 0.0 else math.inf

    def getConfidenceInterval(self, level: float = 0.95) -> ot.Interval:
        """Confidence interval of the probability, never empty.

        With no failure seen it is [0, about 3 / n] at 95 %, where n counts only the runs drawn from the distribution of
        the inputs itself; runs that a surrogate or subset simulation has proposed say nothing of other regions.
        """
        if not 0.0 < level < 1.0:
            raise ValueError(f"the confidence level is {level}; it must lie between 0 and 1")
        return ot.Interval(*self._interval.bounds(level))

    def getReliabilityIndex(self) -> float:
        """Generalised reliability index ``-Phi^-1(p)``; infinite when the estimate is 0 or 1."""
        if self._probability <= 0.0 or self._probability >= 1.0:
            return math.inf if self._probability <= 0.0 else -math.inf
        return -ot.DistFunc.qNormal(self._probability)

    def getSurrogateProbability(self) -> float | None:
        """The surrogate's own probability, **not** corrected and without a guarantee; None where there is none."""
        return self._surrogateProbability

    def getEvaluationNumber(self, phase: str | None = None) -> int:
        """Number of true runs, of all phases or of one (see `getPhases`)."""
        if phase is None:
            return sum(self._phases.values())
        if phase not in self._phases:
            raise ValueError(f"there is no phase {phase!r}; there are {', '.join(self._phases)}")
        return self._phases[phase]

    def getPhases(self) -> dict[str, int]:
        """True runs of each phase."""
        return dict(self._phases)

    def getGradientNumber(self) -> int:
        """Number of gradients: 0, the directions are found without."""
        return 0

    def getMethod(self) -> str:
        """``"ActiveSubspace"``, or ``"SubsetSimulation"`` after a hand-over, or ``"MonteCarlo"`` where nothing was
        found: neither by that nor in a constant."""
        return self._method

    def getActiveDimensions(self) -> list[int]:
        """Number of active directions of each smooth component; empty without a surrogate."""
        return [] if self._view is None else list(self._getView().dimensions)

    def getDirections(self) -> ot.Matrix:
        """Orthonormal basis (d, k) of all active directions in standard space."""
        return ot.Matrix(self._getView().directions)

    def getDiagnostics(self) -> dict[str, float]:
        """Named numbers that tell how far the estimate can be trusted.

        ``effective sample size`` and ``largest weight share`` of the weights of the failed runs, ``Pareto k`` of the
        corrections (above 0.7 the interval is not to be trusted), ``true failures``, ``calibration`` (root mean square
        of the standardised errors of prediction of runs not yet seen, 1 when the surrogate knows its error), ``plain
        importance sampling`` (the estimate without the surrogate), ``unseen bound`` (3 over the number of runs drawn as
        by Monte Carlo), ``missed failures`` (failed runs to which the surrogate gave less than 1 %), ``not finite``.
        """
        return dict(self._diagnostics)

    def getConverged(self) -> bool:
        """Whether the target was reached with enough true failures and blocks."""
        return self._converged

    def getReason(self) -> str:
        """Why the algorithm ended, in a sentence."""
        return self._reason

    def getInputSample(self) -> ot.Sample:
        """Inputs of all true runs, under their names."""
        sample = ot.Sample(self._runs.x)
        sample.setDescription(self._distribution.getDescription())
        return sample

    def getOutputSample(self) -> ot.Sample:
        """Outputs of all true runs, under their names."""
        sample = ot.Sample(self._runs.outputs)
        sample.setDescription(self._outputDescription)
        return sample

    def getTrueRuns(self, outputNames: Sequence[str] | None = None) -> TrueRuns:
        """All true runs with their phases and weights, from which the estimate can be computed again, and saved.

        The run of the phase "composition check" is not among them: it is the event's own function, called once more at
        an input that is among them.

        Parameters
        ----------
        outputNames : sequence of str, optional
            By default those of the function.
        """
        runs = self._runs
        return TrueRuns(
            runs.x,
            runs.outputs,
            runs.failed,
            runs.phases,
            runs.weights,
            runs.expected,
            tuple(self._distribution.getDescription()),
            tuple(self._outputDescription if outputNames is None else outputNames),
            self._surrogateProbability or 0.0,
        )

    def getEvent(self) -> ot.RandomVector:
        """The event whose probability it is.

        Raises
        ------
        RuntimeError
            Its function is in Python, so that it was not stored with a result that was loaded.
        """
        if self._event is None:
            raise RuntimeError("the event was not stored with the result; give it to load()")
        return self._event

    def getProbabilitySimulationResult(self) -> ot.ProbabilitySimulationResult:
        """The estimate as OpenTURNS' own result."""
        size = self.getEvaluationNumber()
        return ot.ProbabilitySimulationResult(self.getEvent(), self._probability, self._variance, size, 1)

    def getMetaModelResult(self) -> ot.MetaModelResult:
        """The surrogate of the smooth outputs as a native function of the physical inputs, with its runs."""
        view = self._getView()
        if view.metaModel is None:
            raise ValueError(view.reason)
        kept = self._runs.finite
        return ot.MetaModelResult(ot.Sample(self._runs.x[kept]), ot.Sample(view.outputs[kept]), view.metaModel)

    # What the same true runs say beside the probability. ------------------------------------------------------------

    def computeParameterSensitivity(self, level: float = 0.95) -> list[fs.ParameterSensitivity]:
        """Derivative of the probability with respect to every parameter of every input's distribution.

        From the true runs already made, by the score function, the copula held fixed.

        Parameters
        ----------
        level : float
            Of the intervals.

        Returns
        -------
        rows : list of :class:`~satsep_ot.methods.reliability.sensitivity.ParameterSensitivity`

        Raises
        ------
        RuntimeError
            No failure was seen, or the estimate is by subset simulation.
        """
        return fs.computeParameterSensitivity(self._getFailureSample(level), self._distribution, level)

    def computeImportance(self, level: float = 0.95) -> list[fs.InputImportance]:
        """Importance of each input for the event, from the true runs already made.

        Returns
        -------
        rows : list of :class:`~satsep_ot.methods.reliability.sensitivity.InputImportance`

        Raises
        ------
        RuntimeError
            No failure was seen, the estimate is by subset simulation, or it is not positive.
        """
        return fs.computeImportance(self._getFailureSample(level), self._distribution, level)

    def computeProbability(self, distribution: ot.Distribution, level: float = 0.95) -> fs.ReweightedProbability:
        """The probability if the inputs had another distribution, from the true runs already made.

        Parameters
        ----------
        distribution : :py:class:`openturns.Distribution`
            Of the same inputs; it may not reach beyond finite bounds of the first one.
        level : float
            Of the interval.

        Returns
        -------
        answer : :class:`~satsep_ot.methods.reliability.sensitivity.ReweightedProbability`
            With a warning where the weights no longer carry it.

        Raises
        ------
        ValueError
            The distribution has another dimension or reaches where no run can have been.
        RuntimeError
            No failure was seen, or the estimate is by subset simulation.
        """
        return fs.computeProbability(self._getFailureSample(level), self._distribution, distribution, level)

    def _getFailureSample(self, level):
        if not 0.0 < level < 1.0:
            raise ValueError(f"the confidence level is {level}; it must lie between 0 and 1")
        if self._failureSample is None:
            raise RuntimeError(
                "the estimate is by subset simulation, whose runs are dependent: they give no sensitivities"
            )
        if callable(self._failureSample):
            self._failureSample = self._failureSample()
        if not self._failureSample.failed.any():
            raise RuntimeError("no run has failed, so nothing is known of the failures")
        return self._failureSample

    def _getView(self):
        if self._view is None:
            raise RuntimeError("there is no surrogate, so there are no active directions")
        if callable(self._view):
            self._view = self._view()
        return self._view

    # Files. ----------------------------------------------------------------------------------------------------------

    def save(self, path: str | os.PathLike) -> None:
        """Write the result to one file: an .npz archive of its arrays, a JSON document and OpenTURNS' XML.

        The file is written whole or not at all. The event is stored where its function is native to OpenTURNS;
        otherwise it has to be given to `load`.

        Parameters
        ----------
        path : str or path
            Ends on ``.npz``.
        """
        writeResult(path, _FORMAT, {name.removeprefix("_"): value for name, value in self.__getstate__().items()})

    @staticmethod
    def load(path: str | os.PathLike, event: Any | None = None) -> "ActiveSubspaceReliabilityResult":
        """The result that `save` has written.

        Parameters
        ----------
        path : str or path
        event : optional
            Needed for `getEvent` and `getProbabilitySimulationResult` only, where the event's function is in Python.

        Raises
        ------
        ValueError
            The file is not such a result.
        """
        fields = readResult(
            path,
            _FORMAT,
            {"runs": Runs, "interval": IntervalLaw, "view": SurrogateView, "failureSample": fs.FailureSample},
            {"distribution": ot.Distribution(), "event": ot.RandomVector()},
        )
        if fields["event"] is None:
            fields["event"] = event
        view = fields["view"]
        if view is not None and view.metaModel is not None:
            view.metaModel = fromXML(view.metaModel, ot.Function())
        fields["history"] = [tuple(row) for row in fields["history"]]
        return ActiveSubspaceReliabilityResult(**fields)

    # Graphs. ---------------------------------------------------------------------------------------------------------

    def drawConvergence(self) -> ot.Graph:
        """Estimate and 95 % interval against the number of true runs."""
        graph = ot.Graph("Convergence of the probability", "true runs", "probability", True, "upper right")
        if not self._history:
            return graph
        runs, probability, lower, upper = (list(column) for column in zip(*self._history, strict=True))
        for values, legend, style in (
            (probability, "estimate", "solid"),
            (lower, "95 % interval", "dashed"),
            (upper, "", "dashed"),
        ):
            curve = ot.Curve(runs, values)
            curve.setLegend(legend)
            curve.setLineStyle(style)
            curve.setColor("black")
            graph.add(curve)
        return graph

    def drawLimitState(self) -> ot.Graph:
        """Limit state of the surrogate in the first two active directions, with the true runs on it."""
        view = self._getView()
        active = view.active
        if active.shape[1] < 2:
            active = np.column_stack([active, self._runs.margins])[:, :2]
            graph = ot.Graph("Limit state along the active direction", "active variable", "limit state", True, "")
            edges = [float(active[:, 0].min()), float(active[:, 0].max())]
            limit = ot.Curve(edges, [0.0, 0.0])
        else:
            graph = ot.Graph("Limit state in the active plane", "active variable 1", "active variable 2", True, "")
            size = view.axes.shape[1]
            limit = ot.Contour(size, size, ot.Sample(view.contour[:, None]))
            limit.setX(ot.Sample(view.axes[0][:, None]))
            limit.setY(ot.Sample(view.axes[1][:, None]))
            limit.setLevels([0.0])
            limit.setDrawLabels(False)
        limit.setColor("black")
        limit.setLegend("limit")
        for failed, color, legend in ((False, "blue", "safe runs"), (True, "red", "failed runs")):
            rows = (self._runs.failed == failed) & self._runs.finite
            if rows.any():
                graph.add(ot.Cloud(ot.Sample(active[rows][:, :2]), color, "fcircle" if failed else "circle", legend))
        graph.add(limit)
        graph.setLegendPosition("upper right")
        _addRoom(graph, above=0.3)
        return graph

    def drawWeights(self) -> ot.Graph:
        """Share of the estimate that the failed runs of largest weight carry: the nearer to the diagonal, the better.

        Raises
        ------
        RuntimeError
            No failure was seen, or the estimate is by subset simulation.
        """
        sample = self._getFailureSample(0.5)
        weights = np.sort(sample.ratios[sample.failed])[::-1]
        share = np.concatenate([[0.0], np.cumsum(weights) / weights.sum()])
        runs = np.arange(len(share), dtype=float)
        graph = ot.Graph(
            "Weights of the failed runs", "failed runs, largest weight first", "share", True, "lower right"
        )
        for values, legend, style in (
            (share, "of the sum of the weights", "solid"),
            (runs / runs[-1], "all equal", "dashed"),
        ):
            curve = ot.Curve(runs, values)
            curve.setLegend(legend)
            curve.setLineStyle(style)
            curve.setColor("black")
            graph.add(curve)
        return graph

    def drawImportance(self, level: float = 0.95, number: int = 10) -> ot.Graph:
        """Mean and spread in failure of the most important inputs, in standard deviations, with intervals.

        Parameters
        ----------
        level : float
            Of the intervals.
        number : int
            Inputs shown.

        Raises
        ------
        RuntimeError
            No failure was seen, or the estimate is by subset simulation.
        """
        rows = sorted(self.computeImportance(level), key=lambda row: -row.share)[:number][::-1]
        vertical = "inputs, the most important at the top"
        graph = ot.Graph("Inputs in failure", "standard deviations of the input", vertical, True, "lower right")
        # The heights are no numbers.
        graph.setTickLocation(ot.GraphImplementation.TICKX)
        heights = np.arange(1.0, len(rows) + 1.0)
        for color, style, offset, name, values in (
            (
                "blue",
                "fcircle",
                0.12,
                "mean (0: does not matter)",
                [(r.shift, r.shiftLower, r.shiftUpper) for r in rows],
            ),
            (
                "red",
                "square",
                -0.12,
                "spread (1: does not matter)",
                [(r.spread, r.spreadLower, r.spreadUpper) for r in rows],
            ),
        ):
            points = [[value, height + offset] for (value, _, _), height in zip(values, heights, strict=True)]
            for (_, lower, upper), height in zip(values, heights, strict=True):
                bar = ot.Curve([lower, upper], [height + offset, height + offset])
                bar.setColor(color)
                graph.add(bar)
            graph.add(ot.Cloud(ot.Sample(points), color, style, name))
        for row, height in zip(rows, heights, strict=True):
            text = ot.Text([[0.5, height + 0.35]], [f"{row.input}: {100.0 * row.share:.0f} %"])
            text.setColor("black")
            text.setTextSize(1.1)
            graph.add(text)
        _addRoom(graph, below=0.25, above=0.05)
        return graph


def _addRoom(graph, below=0.0, above=0.0):
    """Extend the vertical axis by shares of its length, for the legend."""
    box = graph.getBoundingBox()
    lower, upper = box.getLowerBound(), box.getUpperBound()
    height = upper[1] - lower[1]
    graph.setBoundingBox(ot.Interval([lower[0], lower[1] - below * height], [upper[0], upper[1] + above * height]))


def diagnose(blocks: list[Block], calibration: float, nominalRuns: int, notFinite: int) -> dict[str, float]:
    """The diagnostics of an estimate, see `ActiveSubspaceReliabilityResult.getDiagnostics`."""
    weights = np.concatenate([block.weights for block in blocks])
    failed = np.concatenate([block.runs.failed for block in blocks])
    corrections = np.abs(np.concatenate([block.corrections for block in blocks]))
    failedWeights = weights[failed]
    total = failedWeights.sum()
    probability = np.where(weights > 0.0, failed - np.concatenate([b.corrections for b in blocks]) / weights, 0.0)
    return {
        "effective sample size": float(total**2 / (failedWeights**2).sum()) if total > 0.0 else 0.0,
        "largest weight share": float(failedWeights.max() / total) if total > 0.0 else 1.0,
        "Pareto k": paretoShape(corrections),
        "true failures": float(failed.sum()),
        "calibration": calibration,
        "plain importance sampling": float((weights * failed).mean()),
        "unseen bound": 3.0 / max(nominalRuns, 1),
        "missed failures": float(np.count_nonzero(failed & (probability < 0.01))),
        "not finite": float(notFinite),
    }
