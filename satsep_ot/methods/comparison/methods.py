"""The reliability methods that can be compared, each with documented settings and under the same accounting.

To add a method, derive from `ReliabilityMethod`, or from `SimulationMethod` for a simulation algorithm of OpenTURNS.
"""

import abc
import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import openturns as ot
import openturns.experimental as otexp
from numpy.typing import ArrayLike

from satsep_ot.methods.common.intervals import clopperPearson, logNormalInterval
from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.limit_state import Limit
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.subspaces.variable_projection import fit_ridge
from satsep_ot.openturns_adapter import Counter, callFunction, errorMessage, multiFORMProbability, raiseInterrupt

# Along lines through standard space: how far a limit state is looked for, and in steps of which size.
_LARGEST_DISTANCE = 9.0
_ROOT_STEP = 0.9871


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
    >>> from satsep_ot.methods.comparison.methods import Row
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
    """A way to estimate a probability of failure. ``name`` is what tables show; ``fixedSize`` says that it spends a
    given number of evaluations whatever the error is, so that fewer would do for a larger one.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.comparison.comparison import ReliabilityComparison
    >>> from satsep_ot.methods.comparison.methods import ReliabilityMethod, Row
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
    fixedSize = False

    @abc.abstractmethod
    def run(self, problem: CountedProblem) -> Row:
        """Estimate; evaluations, gradients and seconds of the row are filled in by the comparison."""

    def __repr__(self) -> str:
        settings = ", ".join(f"{key}={value!r}" for key, value in vars(self).items())
        return f"{type(self).__name__}({settings})"


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
    >>> from satsep_ot.methods.comparison.methods import ActiveSubspace
    >>> ActiveSubspace(targetCoefficientOfVariation=0.1).name
    'ActiveSubspace'
    """

    name = "ActiveSubspace"

    def __init__(
        self, targetCoefficientOfVariation: float = 0.05, maximumEvaluations: int = 5000, mode: str = "fast"
    ) -> None:
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumEvaluations = maximumEvaluations
        self.mode = mode

    def getLastResult(self) -> ActiveSubspaceReliabilityResult:
        """The `ActiveSubspaceReliabilityResult` of the last run."""
        return self._result

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}(targetCoefficientOfVariation={self.targetCoefficientOfVariation}, "
            f"maximumEvaluations={self.maximumEvaluations}, mode={self.mode!r})"
        )

    def run(self, problem: CountedProblem) -> Row:
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


class SafeActiveSubspace(ActiveSubspace):
    """`ActiveSubspace` in its mode ``"safe"``, which starts with a short subset simulation: for failure that nothing
    near the mean points at.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import SafeActiveSubspace
    >>> SafeActiveSubspace(maximumEvaluations=10000).mode
    'safe'
    """

    name = "SafeActiveSubspace"

    def __init__(self, targetCoefficientOfVariation: float = 0.05, maximumEvaluations: int = 20_000) -> None:
        super().__init__(targetCoefficientOfVariation, maximumEvaluations, "safe")


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
    >>> from satsep_ot.methods.comparison.methods import FORM
    >>> FORM(start=0.2).name
    'FORM'
    """

    name = "FORM"

    def __init__(self, maximumIterations: int = 100, start: float = 0.1) -> None:
        self.maximumIterations = maximumIterations
        self.start = start

    def solve(self, problem: CountedProblem, algorithmClass: Any) -> tuple[Any, bool, str]:
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
                raiseInterrupt(error)
                notes.append(f"{solver.getClassName()}: {errorMessage(error)}")
                continue
            result = algorithm.getResult()
            optimum = result.getOptimizationResult()
            notes.append(
                f"{solver.getClassName()}: reliability index {result.getHasoferReliabilityIndex():.4f} after "
                f"{optimum.getCallsNumber()} calls"
            )
            return result, optimum.getStatus() == ot.OptimizationResult.SUCCESS, "; ".join(notes)
        raise RuntimeError("no solver reached the limit state: " + "; ".join(notes))

    def run(self, problem: CountedProblem) -> Row:
        result, converged, note = self.solve(problem, ot.FORM)
        return Row(self.name, result.getEventProbability(), converged=converged, note=note)


class MultiFORM(FORM):
    """First-order system reliability over several design points, found one after the other (Der Kiureghian and
    Dakessian, Structural Safety 20, 1998), each by Abdo-Rackwitz.

    Parameters
    ----------
    maximumDesignPoints : int

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import MultiFORM
    >>> MultiFORM(maximumDesignPoints=2).name
    'MultiFORM'
    """

    name = "MultiFORM"

    def __init__(self, maximumDesignPoints: int = 4, maximumIterations: int = 100, start: float = 0.1) -> None:
        super().__init__(maximumIterations, start)
        self.maximumDesignPoints = maximumDesignPoints

    def run(self, problem: CountedProblem) -> Row:
        space = StandardSpace(problem.distribution)
        solver = ot.AbdoRackwitz()
        solver.setStartingPoint(space.toPhysical(np.full((1, space.getDimension()), self.start))[0])
        solver.setMaximumIterationNumber(self.maximumIterations)
        solver.setMaximumCallsNumber(30 * self.maximumIterations)
        algorithm = ot.MultiFORM(solver, problem.event)
        algorithm.setMaximumDesignPointsNumber(self.maximumDesignPoints)
        algorithm.run()
        result = algorithm.getResult()
        note = f"{len(result.getFORMResultCollection())} design points"
        return Row(self.name, multiFORMProbability(result), converged=True, note=note)


class SORM(FORM):
    """Second-order method at FORM's design point, by Breitung's formula.

    The Hessian is by differences: 2 d gradients, or about 2 d^2 evaluations of a function without gradient.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import SORM
    >>> SORM(maximumIterations=50).name
    'SORM'
    """

    name = "SORM"
    formula = "Breitung"

    def run(self, problem: CountedProblem) -> Row:
        result, converged, note = self.solve(problem, ot.SORM)
        for formula in ("Breitung", "Hohenbichler", "Tvedt"):
            try:
                value = getattr(result, f"getEventProbability{formula}")()
            except RuntimeError as error:
                if formula == self.formula:
                    raise
                raiseInterrupt(error)
                note += f"; {formula} not defined here"
                continue
            if formula == self.formula:
                probability = value
            else:
                note += f"; {formula} {value:.3e}"
        return Row(self.name, probability, converged=converged, note=note)


class SORMHohenbichler(SORM):
    """`SORM` by the formula of Hohenbichler and Rackwitz."""

    name = "SORMHohenbichler"
    formula = "Hohenbichler"


class SORMTvedt(SORM):
    """`SORM` by the formula of Tvedt."""

    name = "SORMTvedt"
    formula = "Tvedt"


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
    >>> from satsep_ot.methods.comparison.methods import MonteCarlo
    >>> MonteCarlo(size=10000).name
    'MonteCarlo'
    """

    name = "MonteCarlo"
    fixedSize = True

    def __init__(self, size: int = 1_000_000, blockSize: int = 50_000) -> None:
        self.size = int(size)
        self.blockSize = int(blockSize)

    def run(self, problem: CountedProblem) -> Row:
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
    def build(self, problem: CountedProblem) -> Any:
        """The OpenTURNS algorithm, ready to run."""

    def run(self, problem: CountedProblem) -> Row:
        algorithm = self.build(problem)
        algorithm.run()
        result = algorithm.getResult()
        probability, variation = result.getProbabilityEstimate(), result.getCoefficientOfVariation()
        if not (probability > 0.0 and 0.0 <= variation < math.inf):
            return Row(self.name, note=f"no usable estimate: probability {probability:g} with variation {variation:g}")
        incomplete = self.incomplete(problem, algorithm)
        if incomplete:
            return Row(self.name, note=incomplete)
        lower, upper = logNormalInterval(probability, variation**2)
        return Row(self.name, probability, lower, upper, variation, converged=True, note=self.interval_note)

    def incomplete(self, problem: CountedProblem, algorithm: Any) -> str:
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
    >>> from satsep_ot.methods.comparison.methods import SubsetSampling
    >>> SubsetSampling(levelSize=2000).name
    'SubsetSampling'
    """

    name = "SubsetSampling"
    fixedSize = True
    interval_note = "the claimed error takes the levels for independent, so the interval is somewhat short"

    def __init__(self, levelSize: int = 4000, conditionalProbability: float = 0.1) -> None:
        self.levelSize = int(levelSize)
        self.conditionalProbability = conditionalProbability

    def build(self, problem: CountedProblem) -> Any:
        algorithm = ot.SubsetSampling(problem.event)
        block = max(int(self.conditionalProbability * self.levelSize), 1)
        algorithm.setBlockSize(block)
        algorithm.setMaximumOuterSampling(math.ceil(self.levelSize / block))
        algorithm.setConditionalProbability(self.conditionalProbability)
        return algorithm

    def incomplete(self, problem: CountedProblem, algorithm: Any) -> str:
        # OpenTURNS reports the product of its levels also where they stop short of the event.
        reached = algorithm.getThresholdPerStep()[-1]
        if reached == problem.event.getThreshold():
            return ""
        return f"the levels ended at {reached:g}, short of the threshold {problem.event.getThreshold():g}"


class ImportanceSampling(SimulationMethod):
    """FORM, then importance sampling around its design point (OpenTURNS' PostAnalyticalImportanceSampling); blind to
    every other failure mode.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumEvaluations : int
        Of the sampling.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import ImportanceSampling
    >>> ImportanceSampling(maximumEvaluations=5000).name
    'ImportanceSampling'
    """

    name = "ImportanceSampling"
    algorithmClass = ot.PostAnalyticalImportanceSampling

    def __init__(self, targetCoefficientOfVariation: float = 0.05, maximumEvaluations: int = 20_000) -> None:
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumEvaluations = maximumEvaluations

    def build(self, problem: CountedProblem) -> Any:
        result, converged, note = FORM().solve(problem, ot.FORM)
        if not converged:
            raise RuntimeError(f"FORM has no design point to sample around: {note}")
        return _limited(self.algorithmClass(result), self.targetCoefficientOfVariation, self.maximumEvaluations)


class ControlledImportanceSampling(ImportanceSampling):
    """`ImportanceSampling` with the tangent plane at the design point as control variate.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumEvaluations : int
        Of the sampling.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import ControlledImportanceSampling
    >>> ControlledImportanceSampling().name
    'ControlledImportanceSampling'
    """

    name = "ControlledImportanceSampling"
    algorithmClass = ot.PostAnalyticalControlledImportanceSampling


class ExperimentSampling(SimulationMethod):
    """Base of crude sampling in blocks of a design: `experiment` makes the design.

    The interval is from the scatter between the blocks, which is what such designs need.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumEvaluations : int
    blockSize : int
    """

    def __init__(
        self, targetCoefficientOfVariation: float = 0.05, maximumEvaluations: int = 1_000_000, blockSize: int = 10_000
    ) -> None:
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumEvaluations = maximumEvaluations
        self.blockSize = blockSize

    @abc.abstractmethod
    def experiment(self, problem: CountedProblem) -> None:
        """The design of one block."""

    def build(self, problem: CountedProblem) -> Any:
        algorithm = ot.ProbabilitySimulationAlgorithm(problem.event, self.experiment(problem))
        return _limited(algorithm, self.targetCoefficientOfVariation, self.maximumEvaluations, self.blockSize)


class LatinHypercube(ExperimentSampling):
    """Latin hypercube sampling, shuffled anew for every block: OpenTURNS' default repeats one permutation, which is
    biased.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import LatinHypercube
    >>> LatinHypercube(blockSize=1000).name
    'LatinHypercube'
    """

    name = "LatinHypercube"

    def experiment(self, problem: CountedProblem) -> ot.WeightedExperiment:
        experiment = ot.LHSExperiment()
        experiment.setAlwaysShuffle(True)
        return experiment


class QuasiMonteCarlo(ExperimentSampling):
    """Sobol' sequence, shifted at random, so that its scatter can be seen.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import QuasiMonteCarlo
    >>> QuasiMonteCarlo(blockSize=1024).name
    'QuasiMonteCarlo'
    """

    name = "QuasiMonteCarlo"

    def experiment(self, problem: CountedProblem) -> ot.WeightedExperiment:
        sequence = ot.SobolSequence(problem.distribution.getDimension())
        experiment = ot.LowDiscrepancyExperiment(sequence, 1, False)
        experiment.setRandomize(True)
        return experiment


class LevelMethod(SimulationMethod):
    """An algorithm of OpenTURNS that fits its density level by level, with a fixed number of points each."""

    fixedSize = True
    algorithm: Callable[[ot.ThresholdEvent, float], Any]

    def __init__(self, levelSize: int, quantile: float) -> None:
        self.levelSize = levelSize
        self.quantile = quantile

    def build(self, problem: CountedProblem) -> Any:
        algorithm = self.algorithm(problem.event, self.quantile)
        algorithm.setBlockSize(1000)
        algorithm.setMaximumOuterSampling(math.ceil(self.levelSize / 1000))
        return algorithm


class CrossEntropy(LevelMethod):
    """OpenTURNS' cross-entropy importance sampling in standard space, a normal density with free mean and spread.

    Parameters
    ----------
    levelSize : int
        Evaluations of each level.
    quantile : float
        Share of the points that the next level is fitted to.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import CrossEntropy
    >>> CrossEntropy(levelSize=2000).name
    'CrossEntropy'
    """

    name = "CrossEntropy"
    algorithm = ot.StandardSpaceCrossEntropyImportanceSampling

    def __init__(self, levelSize: int = 4000, quantile: float = 0.1) -> None:
        super().__init__(levelSize, quantile)


class DirectionalSampling(SimulationMethod):
    """OpenTURNS' directional sampling; its evaluations per direction add to the limit on directions.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumDirections : int

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import DirectionalSampling
    >>> DirectionalSampling(maximumDirections=100).name
    'DirectionalSampling'
    """

    name = "DirectionalSampling"

    def __init__(self, targetCoefficientOfVariation: float = 0.05, maximumDirections: int = 5000) -> None:
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumDirections = maximumDirections

    def build(self, problem: CountedProblem) -> Any:
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
    >>> from satsep_ot.methods.comparison.methods import LineSampling
    >>> LineSampling(maximumLines=100).name
    'LineSampling'
    """

    name = "LineSampling"

    def __init__(self, targetCoefficientOfVariation: float = 0.05, maximumLines: int = 1000) -> None:
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumLines = maximumLines

    def direction(self, problem: CountedProblem) -> ArrayLike:
        """Direction of the lines in standard space."""
        result, converged, note = FORM().solve(problem, ot.FORM)
        if not converged:
            raise RuntimeError(f"FORM has no design point to take the direction from: {note}")
        return result.getStandardSpaceDesignPoint()

    def build(self, problem: CountedProblem) -> Any:
        # With OpenTURNS' own step of 1 a limit state at a whole distance is lost on half of the lines.
        roots = ot.SafeAndSlow(ot.Brent(), _LARGEST_DISTANCE, _ROOT_STEP)
        algorithm = otexp.LineSampling(problem.event, self.direction(problem), roots)
        # The adaptive direction jumps to whichever failure comes nearest, and the estimate with it.
        algorithm.setAdaptiveImportantDirection(False)
        return _limited(algorithm, self.targetCoefficientOfVariation, self.maximumLines, block=10)


class ActiveLineSampling(LineSampling):
    """Line sampling along the active direction of 2 (d + 2) normal points, found without gradients.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumLines : int

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import ActiveLineSampling
    >>> ActiveLineSampling(maximumLines=100).name
    'ActiveLineSampling'
    """

    name = "ActiveLineSampling"

    def direction(self, problem: CountedProblem) -> ArrayLike:
        space = StandardSpace(problem.distribution)
        u = space.generateSample(2 * (space.getDimension() + 2))
        margins = Limit.of(problem.event).margin(callFunction(problem.event.getFunction(), space.toPhysical(u)))
        direction = fit_ridge(u, margins, 1, 2).directions[:, 0]
        # Towards failure.
        return direction * -np.sign(direction @ (u.T @ (margins - margins.mean())))


def _limited(algorithm, target, maximum, block=100):
    algorithm.setMaximumCoefficientOfVariation(target)
    algorithm.setBlockSize(block)
    algorithm.setMaximumOuterSampling(math.ceil(maximum / block))
    return algorithm


class NAIS(LevelMethod):
    """OpenTURNS' non-parametric adaptive importance sampling, in standard space, since it refuses bounded inputs.

    Its density is a kernel smoothing of the failed points in all inputs, which needs a number of points that grows
    exponentially with their number: right with 4 inputs, biased low by a quarter with 20 and worthless with 35.

    Parameters
    ----------
    levelSize : int
        Evaluations of each level.
    quantile : float
        Share of the points that the next level is fitted to.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.methods import NAIS
    >>> NAIS(levelSize=1000).name
    'NAIS'
    """

    name = "NAIS"

    @staticmethod
    def algorithm(event: ot.ThresholdEvent, quantile: float) -> Any:
        return ot.NAIS(ot.StandardEvent(event), quantile)

    def __init__(self, levelSize: int = 2000, quantile: float = 0.1) -> None:
        super().__init__(levelSize, quantile)


# The methods by name, each with its default settings.
METHODS: dict[str, type[ReliabilityMethod]] = {
    method.name: method
    for method in (
        ActiveSubspace,
        SafeActiveSubspace,
        FORM,
        MultiFORM,
        SORM,
        SORMHohenbichler,
        SORMTvedt,
        SubsetSampling,
        MonteCarlo,
        LatinHypercube,
        QuasiMonteCarlo,
        ImportanceSampling,
        ControlledImportanceSampling,
        CrossEntropy,
        NAIS,
        DirectionalSampling,
        LineSampling,
        ActiveLineSampling,
    )
}


def makeMethod(method: str | ReliabilityMethod) -> ReliabilityMethod:
    """The method of that name with its default settings, or the method itself."""
    if isinstance(method, ReliabilityMethod):
        return method
    if method not in METHODS:
        raise ValueError(f"no reliability method is called {method!r}; there are {', '.join(METHODS)}")
    return METHODS[method]()
