"""Methods that draw points: crude Monte Carlo and the simulation algorithms of OpenTURNS.

To add one of OpenTURNS, derive from `SimulationMethod`.
"""

import abc
import dataclasses
import math
from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.common.intervals import clopperPearson, logNormalInterval
from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.comparison.approximations import FORM
from satsep_ot.methods.comparison.method import CountedProblem, ReliabilityMethod, Row
from satsep_ot.methods.reliability.limit_state import Limit
from satsep_ot.methods.subspaces.variable_projection import fit_ridge
from satsep_ot.openturns_adapter import callFunction, lastLevel, latinHypercube, lineSampling


class MonteCarlo(ReliabilityMethod):
    """Crude Monte Carlo with the Clopper-Pearson interval.

    Parameters
    ----------
    size : int
        Number of evaluations.
    blockSize : int
        Evaluations at a time.
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


# The settings of a method are the fields of a dataclass; two methods are equal only if they are the same object.
_SETTINGS = dataclasses.dataclass(eq=False, repr=False)


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
        probability, variation = result.getProbabilityEstimate(), self.variation(algorithm)
        if not (probability > 0.0 and 0.0 <= variation < math.inf):
            return Row(self.name, note=f"no usable estimate: probability {probability:g} with variation {variation:g}")
        incomplete = self.incomplete(problem, algorithm)
        if incomplete:
            return Row(self.name, note=incomplete)
        lower, upper = logNormalInterval(probability, variation**2)
        return Row(self.name, probability, lower, upper, variation, converged=True, note=self.interval_note)

    def variation(self, algorithm: Any) -> float:
        """The coefficient of variation of the estimate."""
        return algorithm.getResult().getCoefficientOfVariation()

    def incomplete(self, problem: CountedProblem, algorithm: Any) -> str:
        """Why the result does not stand for the event; empty when it does."""
        return ""


@_SETTINGS
class SubsetSampling(SimulationMethod):
    """OpenTURNS' subset sampling.

    Parameters
    ----------
    levelSize : int
        Evaluations of each level.
    conditionalProbability : float
        p0; blocks are p0 times the level, since larger ones break the chains.
    """

    levelSize: int = 4000
    conditionalProbability: float = 0.1

    name = "SubsetSampling"
    fixedSize = True
    interval_note = "the error is the upper bound of Au and Beck (2001), of levels that depend on each other"

    def build(self, problem: CountedProblem) -> Any:
        algorithm = ot.SubsetSampling(problem.event)
        block = max(int(self.conditionalProbability * self.levelSize), 1)
        algorithm.setBlockSize(block)
        algorithm.setMaximumOuterSampling(math.ceil(self.levelSize / block))
        algorithm.setConditionalProbability(self.conditionalProbability)
        return algorithm

    def variation(self, algorithm: Any) -> float:
        # OpenTURNS adds the squares of the levels' errors up, from the second level on: independent levels, the first
        # without an error. Real errors are about twice as large.
        cumulated = np.array(algorithm.getCoefficientOfVariationPerStep())
        first = math.sqrt((1.0 - self.conditionalProbability) / (self.conditionalProbability * self.levelSize))
        if len(cumulated) < 2:
            return algorithm.getResult().getCoefficientOfVariation()
        return first + float(np.sqrt(np.maximum(np.diff(cumulated**2), 0.0)).sum())

    def incomplete(self, problem: CountedProblem, algorithm: Any) -> str:
        reached = lastLevel(algorithm)
        if reached == problem.event.getThreshold():
            return ""
        return f"the levels ended at {reached:g}, short of the threshold {problem.event.getThreshold():g}"


@_SETTINGS
class ImportanceSampling(SimulationMethod):
    """FORM, then importance sampling around its design point (OpenTURNS' PostAnalyticalImportanceSampling); it
    misses every other failure mode.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumEvaluations : int
        Of the sampling.
    """

    targetCoefficientOfVariation: float = 0.05
    maximumEvaluations: int = 20_000

    name = "ImportanceSampling"
    algorithmClass = ot.PostAnalyticalImportanceSampling

    def build(self, problem: CountedProblem) -> Any:
        result, converged, note = FORM().solve(problem, ot.FORM)
        if not converged:
            raise RuntimeError(f"FORM has no design point to sample around: {note}")
        maximum = problem.remaining(self.maximumEvaluations)
        return _limited(self.algorithmClass(result), self.targetCoefficientOfVariation, maximum)


class ControlledImportanceSampling(ImportanceSampling):
    """`ImportanceSampling` with the tangent plane at the design point as control variate.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumEvaluations : int
        Of the sampling.
    """

    name = "ControlledImportanceSampling"
    algorithmClass = ot.PostAnalyticalControlledImportanceSampling


@_SETTINGS
class ExperimentSampling(SimulationMethod):
    """Base of crude sampling in blocks of a design: `experiment` makes the design.

    The interval is from the scatter between the blocks, which is what such designs need.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumEvaluations : int
    blockSize : int
    """

    targetCoefficientOfVariation: float = 0.05
    maximumEvaluations: int = 1_000_000
    blockSize: int = 10_000

    @abc.abstractmethod
    def experiment(self, problem: CountedProblem) -> ot.WeightedExperiment:
        """The design of one block."""

    def build(self, problem: CountedProblem) -> Any:
        algorithm = ot.ProbabilitySimulationAlgorithm(problem.event, self.experiment(problem))
        return _limited(algorithm, self.targetCoefficientOfVariation, self.maximumEvaluations, self.blockSize)


class LatinHypercube(ExperimentSampling):
    """Latin hypercube sampling, shuffled anew for every block."""

    name = "LatinHypercube"

    def experiment(self, problem: CountedProblem) -> ot.WeightedExperiment:
        return latinHypercube()


class QuasiMonteCarlo(ExperimentSampling):
    """Sobol' sequence, shifted at random, so that its scatter can be seen."""

    name = "QuasiMonteCarlo"

    def experiment(self, problem: CountedProblem) -> ot.WeightedExperiment:
        sequence = ot.SobolSequence(problem.distribution.getDimension())
        experiment = ot.LowDiscrepancyExperiment(sequence, 1, False)
        experiment.setRandomize(True)
        return experiment


@_SETTINGS
class LevelMethod(SimulationMethod):
    """An algorithm of OpenTURNS that fits its density level by level, with a fixed number of points each."""

    levelSize: int = 4000
    quantile: float = 0.1

    fixedSize = True
    algorithm: ClassVar[Callable[..., Any]]

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
    """

    name = "CrossEntropy"
    algorithm = ot.StandardSpaceCrossEntropyImportanceSampling


@_SETTINGS
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
    """

    levelSize: int = 2000

    name = "NAIS"

    @staticmethod
    def algorithm(event: ot.ThresholdEvent, quantile: float) -> Any:
        return ot.NAIS(ot.StandardEvent(event), quantile)


@_SETTINGS
class DirectionalSampling(SimulationMethod):
    """OpenTURNS' directional sampling; its evaluations per direction add to the limit on directions.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumDirections : int
    """

    targetCoefficientOfVariation: float = 0.05
    maximumDirections: int = 5000

    name = "DirectionalSampling"

    def build(self, problem: CountedProblem) -> Any:
        algorithm = ot.DirectionalSampling(problem.event)
        return _limited(algorithm, self.targetCoefficientOfVariation, self.maximumDirections)


@_SETTINGS
class LineSampling(SimulationMethod):
    """OpenTURNS' line sampling along FORM's design point, the direction kept fixed.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumLines : int
    """

    targetCoefficientOfVariation: float = 0.05
    maximumLines: int = 1000

    name = "LineSampling"

    def direction(self, problem: CountedProblem) -> ArrayLike:
        """Direction of the lines in standard space."""
        result, converged, note = FORM().solve(problem, ot.FORM)
        if not converged:
            raise RuntimeError(f"FORM has no design point to take the direction from: {note}")
        return result.getStandardSpaceDesignPoint()

    def build(self, problem: CountedProblem) -> Any:
        algorithm = lineSampling(problem.event, self.direction(problem))
        return _limited(algorithm, self.targetCoefficientOfVariation, self.maximumLines, block=10)


class ActiveLineSampling(LineSampling):
    """Line sampling along the active direction of 2 (d + 2) normal points, found without gradients.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumLines : int
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
    algorithm.setMaximumOuterSampling(max(maximum // block, 1))
    return algorithm
