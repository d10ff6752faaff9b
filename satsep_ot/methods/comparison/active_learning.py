"""AK-MCS: a Gaussian process that learns the sign of the limit state at the points of a Monte Carlo population."""

import dataclasses
import math

import numpy as np
import openturns as ot
from scipy import stats

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.comparison.method import CountedProblem, ReliabilityMethod, Row
from satsep_ot.methods.reliability.limit_state import Limit
from satsep_ot.openturns_adapter import callFunction

# The criteria of the papers: every sign is right with 97.7 %, and no point promises more than this.
LEAST_U = 2.0
LARGEST_FEASIBILITY = 1e-3
# Hyperparameters are optimised at every run up to so many, then at every fifth.
_OFTEN, _SELDOM = 60, 5
_LARGEST_POPULATION = 1_000_000
# Standard deviations beyond which nothing is left of a normal density.
_FARTHEST = 100.0


@dataclasses.dataclass(eq=False, repr=False)
class AKMCS(ReliabilityMethod):
    """Active learning with a Gaussian process and Monte Carlo (Echard, Gayton and Lemaire, Structural Safety 33, 2011).

    A population is drawn from the inputs' distribution; 12 of its points are run. A Gaussian process (Matern 5/2, a
    length for each input, constant trend) predicts the limit state at all points of the population, and the point whose
    sign it knows least, by the learning function U, is run next, until U is at least 2 everywhere. The population grows
    until its own coefficient of variation meets the target.

    Parameters
    ----------
    targetCoefficientOfVariation : float
        Of the population.
    maximumEvaluations : int
    populationSize : int
        Points at first.

    Notes
    -----
    The criterion is about the points of the population, under the Gaussian process: it can be met before any failure is
    found, since far from all runs the process may be sure of what it does not know. So a stop without a failure is no
    probability here, and the interval of a row is that of the population alone.
    """

    targetCoefficientOfVariation: float = 0.05
    maximumEvaluations: int = 300
    populationSize: int = 10_000

    name = "AKMCS"
    criterion = "U >= 2 at all points"

    def run(self, problem: CountedProblem) -> Row:
        space = StandardSpace(problem.distribution)
        margin, function = Limit.of(problem.event).margin, problem.event.getFunction()

        def evaluate(points):
            return margin(callFunction(function, space.toPhysical(points)))

        population = space.generateSample(self.populationSize)
        first = min(max(12, space.getDimension() + 2), self.maximumEvaluations)
        points = population[:first]
        margins = evaluate(points)
        process, ended = _Process(space.getDimension()), ""
        while not ended:
            mean, deviation = process.fitted(points, margins, population)
            place, met = self.choose(mean, deviation)
            failures = int(np.count_nonzero(mean <= 0.0))
            if met:
                if not self._populationIsSmall(failures, len(population)):
                    break
                population = np.concatenate([population, space.generateSample(len(population))])
                continue
            if len(points) >= self.maximumEvaluations:
                ended = f"the limit of {self.maximumEvaluations} evaluations was reached"
            elif problem.report(100.0 * len(points) / self.maximumEvaluations):
                ended = "stopped by the stop callback"
            else:
                points = np.vstack([points, population[place]])
                margins = np.append(margins, evaluate(population[place : place + 1]))
        return self._row(failures, len(population), len(points), ended)

    def choose(self, mean: np.ndarray, deviation: np.ndarray) -> tuple[int, bool]:
        """Place of the point to be run next, and whether the criterion is met, from predictions at the population."""
        learning = np.abs(mean) / deviation
        place = int(learning.argmin())
        return place, bool(learning[place] >= LEAST_U)

    def _populationIsSmall(self, failures, size):
        """Whether more points are needed for the target; without a failure nothing says how many."""
        if not failures or 2 * size > _LARGEST_POPULATION:
            return False
        return math.sqrt((size - failures) / (failures * size)) > self.targetCoefficientOfVariation

    def _row(self, failures, size, runs, ended):
        how = ended or f"the criterion ({self.criterion}) was met after {runs} runs"
        if not failures:
            return Row(self.name, note=f"{how}, and no point of the population fails: that is no probability")
        lower, upper = clopperPearson(failures, size)
        variation = math.sqrt((size - failures) / (failures * size))
        note = f"{how}; the interval is that of the population of {size} points, without the error of the process"
        return Row(self.name, failures / size, lower, upper, variation, converged=not ended, note=note)


class AKMCSFeasibility(AKMCS):
    """`AKMCS` with the expected feasibility function of Bichon et al. (AIAA Journal 46, 2008), until it is below 0.001.

    Parameters
    ----------
    targetCoefficientOfVariation : float
        Of the population.
    maximumEvaluations : int
    populationSize : int
        Points at first.
    """

    name = "AKMCSFeasibility"
    criterion = "expected feasibility <= 0.001"

    def choose(self, mean: np.ndarray, deviation: np.ndarray) -> tuple[int, bool]:
        """Place of the point to be run next, and whether the criterion is met, from predictions at the population."""
        # With a band of two standard deviations around the limit.
        middle = np.clip(-mean / deviation, -_FARTHEST, _FARTHEST)
        low, high, normal = middle - 2.0, middle + 2.0, stats.norm
        feasibility = (
            mean * (2.0 * normal.cdf(middle) - normal.cdf(low) - normal.cdf(high))
            - deviation * (2.0 * normal.pdf(middle) - normal.pdf(low) - normal.pdf(high))
            + 2.0 * deviation * (normal.cdf(high) - normal.cdf(low))
        )
        place = int(feasibility.argmax())
        return place, bool(feasibility[place] <= LARGEST_FEASIBILITY)


class _Process:
    """OpenTURNS' Gaussian process regression, whose hyperparameters are kept from one fit to the next."""

    def __init__(self, dimension):
        self.basis = ot.ConstantBasisFactory(dimension).build()
        self.covariance = ot.MaternModel([1.0] * dimension, [1.0], 2.5)

    def fitted(self, points, margins, population):
        """Mean and standard deviation (n,) at the population, of the process given margins (m,) at points."""
        scale = float(margins.std())
        if not scale > 0.0:
            raise ValueError(f"the limit state is {margins[0]:g} at all of the first {len(margins)} runs")
        fitter = ot.GaussianProcessFitter(points, (margins / scale)[:, None], self.covariance, self.basis)
        fitter.setOptimizeParameters(len(points) <= _OFTEN or len(points) % _SELDOM == 0)
        fitter.run()
        self.covariance = fitter.getResult().getCovarianceModel()
        regression = ot.GaussianProcessRegression(fitter.getResult())
        regression.run()
        result = regression.getResult()
        sample = ot.Sample(population)
        variance = ot.GaussianProcessConditionalCovariance(result).getConditionalMarginalVariance(sample)
        deviation = np.sqrt(np.maximum(np.array(variance)[:, 0], np.finfo(float).tiny))
        return scale * np.array(result.getMetaModel()(sample))[:, 0], scale * deviation
