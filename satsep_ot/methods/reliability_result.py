"""What ActiveSubspaceReliability has found, how sure it is, and what it rests on."""

import dataclasses
import math

import numpy as np
import openturns as ot
from scipy import stats

from satsep_ot.methods.importance_proposal import Pool, paretoShape
from satsep_ot.methods.limit_state_event import Runs


def clopperPearson(failures: int, runs: int, level: float = 0.95) -> tuple[float, float]:
    """Exact interval of a binomial probability (Clopper and Pearson, Biometrika 1934).

    With no failure the lower bound is 0 and the upper bound is one-sided at the same level, about 3 / runs at 95 %.

    Examples
    --------
    >>> from satsep_ot.methods.reliability_result import clopperPearson
    >>> [round(bound, 4) for bound in clopperPearson(0, 1000)]
    [0.0, 0.003]
    """
    tail = 1.0 - level if failures in (0, runs) else 0.5 * (1.0 - level)
    lower = 0.0 if failures == 0 else float(stats.beta.ppf(tail, failures, runs - failures + 1))
    upper = 1.0 if failures == runs else float(stats.beta.isf(tail, failures + 1, runs - failures))
    return lower, upper


@dataclasses.dataclass
class Block:
    """True runs that a surrogate proposed before it had seen them.

    Attributes
    ----------
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

    def __init__(self, blocks: list[Block]):
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

    def interval(self, level: float) -> tuple[float, float]:
        """Log-normal interval with Student quantiles; from 0 where the estimate is not positive."""
        quantile = float(stats.t.ppf(0.5 + 0.5 * level, self.freedom))
        if self.probability <= 0.0:
            return 0.0, min(max(self.probability, 0.0) + quantile * math.sqrt(self.variance), 1.0)
        width = quantile * math.sqrt(math.log1p(self.coefficientOfVariation() ** 2))
        return self.probability * math.exp(-width), min(self.probability * math.exp(width), 1.0)


class ActiveSubspaceReliabilityResult:
    """Result of :class:`~satsep_ot.methods.reliability.ActiveSubspaceReliability`; made by its ``run()``.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.reliability import ActiveSubspaceReliability
    >>> ot.RandomGenerator.SetSeed(0)
    >>> vector = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["a + b"]), ot.RandomVector(ot.Normal(2)))
    >>> algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 4.0))
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> result.getConfidenceInterval(0.95).contains([ot.Normal().computeComplementaryCDF(4.0 / 2.0**0.5)])
    True
    >>> result.getEvaluationNumber() == sum(result.getPhases().values())
    True
    """

    def __init__(
        self,
        event,
        probability,
        variance,
        interval,
        surrogateProbability,
        phases,
        diagnostics,
        converged,
        reason,
        method,
        surrogate,
        limitState,
        runs,
        history,
    ):
        self._event = event
        self._probability = probability
        self._variance = variance
        self._interval = interval
        self._surrogateProbability = surrogateProbability
        self._phases = phases
        self._diagnostics = diagnostics
        self._converged = converged
        self._reason = reason
        self._method = method
        self._surrogate = surrogate
        self._limitState = limitState
        self._runs = runs
        self._history = history

    def __repr__(self):
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
        """Confidence interval of the probability, never empty: with no failure seen it is [0, about 3 / runs]."""
        if not 0.0 < level < 1.0:
            raise ValueError(f"the confidence level is {level}; it must lie between 0 and 1")
        lower, upper = self._interval(level)
        return ot.Interval(lower, upper)

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
        """``"ActiveSubspace"``, or ``"SubsetSimulation"`` after a hand-over, or ``"MonteCarlo"`` for a constant."""
        return self._method

    def getActiveDimensions(self) -> list[int]:
        """Number of active directions of each smooth component; empty without a surrogate."""
        return [] if self._surrogate is None else [fit.model.dimension for fit in self._surrogate.components]

    def getDirections(self) -> ot.Matrix:
        """Orthonormal basis (d, k) of all active directions in standard space."""
        if self._surrogate is None:
            raise RuntimeError("there is no surrogate, so there are no active directions")
        return ot.Matrix(self._surrogate.directions)

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
        """Inputs of all true runs."""
        return ot.Sample(self._runs.x)

    def getOutputSample(self) -> ot.Sample:
        """Outputs of all true runs."""
        return ot.Sample(self._runs.outputs)

    def getProbabilitySimulationResult(self) -> ot.ProbabilitySimulationResult:
        """The estimate as OpenTURNS' own result."""
        size = self.getEvaluationNumber()
        return ot.ProbabilitySimulationResult(self._event, self._probability, self._variance, size, 1)

    def getMetaModelResult(self) -> ot.MetaModelResult:
        """The surrogate of the smooth outputs as a native function of the physical inputs, with its runs."""
        if self._surrogate is None:
            raise RuntimeError("there is no surrogate")
        kept = self._runs.finite
        metaModel = self._surrogate.nativeFunction(self._limitState.space)
        outputs = self._limitState.smooth(self._runs.outputs[kept])
        return ot.MetaModelResult(ot.Sample(self._runs.x[kept]), ot.Sample(outputs), metaModel)

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
        if self._surrogate is None:
            raise RuntimeError("there is no surrogate, so there is no active plane")
        surrogate = self._surrogate
        active = surrogate.reduce(self._runs.u)
        if active.shape[1] < 2:
            active = np.column_stack([active, self._runs.margins])[:, :2]
            graph = ot.Graph("Limit state along the active direction", "active variable", "limit state", True, "")
        else:
            graph = ot.Graph("Limit state in the active plane", "active variable 1", "active variable 2", True, "")
            graph.add(self._limitContour(active))
        for failed, color, legend in ((False, "blue", "safe runs"), (True, "red", "failed runs")):
            rows = (self._runs.failed == failed) & self._runs.finite
            if rows.any():
                graph.add(ot.Cloud(ot.Sample(active[rows][:, :2]), color, "fcircle" if failed else "circle", legend))
        graph.setLegendPosition("upper right")
        return graph

    def _limitContour(self, active):
        """The level 0 where the other active variables are at their median among the failed runs."""
        rows = self._runs.failed if self._runs.failed.any() else np.ones(len(active), dtype=bool)
        centre = np.median(active[rows], axis=0)
        size = 61
        bounds = [(active[:, j].min() - 0.5, active[:, j].max() + 0.5) for j in range(2)]
        first, second = np.meshgrid(*(np.linspace(*bound, size) for bound in bounds))
        y = np.repeat(centre[None], size**2, axis=0)
        y[:, 0], y[:, 1] = first.reshape(-1), second.reshape(-1)
        values = self._surrogate.margin(self._surrogate.predict(y))
        contour = ot.Contour(size, size, ot.Sample(values[:, None]))
        contour.setX(ot.Sample(np.linspace(*bounds[0], size)[:, None]))
        contour.setY(ot.Sample(np.linspace(*bounds[1], size)[:, None]))
        contour.setLevels([0.0])
        contour.setLegend("surrogate's limit")
        return contour


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
