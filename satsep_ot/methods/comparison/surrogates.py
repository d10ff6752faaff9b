"""Methods that take the probability of a surrogate for that of the event: no true run corrects them, no interval holds.

Their error beside a method with an interval is what a table of them shows.
"""

import dataclasses
import math

import numpy as np
import openturns as ot

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.comparison.method import CountedProblem, ReliabilityMethod, Row
from satsep_ot.methods.polynomials.distribution import PolynomialDistribution
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.reliability.limit_state import Limit
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.methods.subspaces.inverse_regression import slicedInverseRegression
from satsep_ot.openturns_adapter import callFunction

_SETTINGS = dataclasses.dataclass(eq=False, repr=False)
# Up to this many variables the probability of a polynomial is computed, beyond it sampled.
_COMPUTED_VARIABLES = 3
_SAMPLE, _BLOCK = 1_000_000, 50_000
# Terms among which a sparse chaos chooses.
_CHAOS_TERMS = 1000


@_SETTINGS
class PaperChain(ReliabilityMethod):
    """Active subspace from gradients, quartic polynomial on its variables, and the probability of that polynomial.

    The chain of Hu, Chen, Zhao and Yao (Acta Astronautica 131, 2017), whose idea this project takes up: gradients at
    points drawn from the inputs' distribution, the dimension by the separated log-gap, the degree up to 4 by
    cross-validation. The probability is computed for up to three variables. What the polynomial misses near the limit,
    which such points rarely see, is an error of the probability.

    Parameters
    ----------
    size : int
        Points at which values and gradients are taken; by differences where the function has no gradient of its own.
    """

    size: int = 100

    name = "PaperChain"
    fixedSize = True
    # Gradients by differences take more.
    limits = ()

    def run(self, problem: CountedProblem) -> Row:
        search = ActiveSubspaceAlgorithm(problem.event.getFunction(), problem.distribution)
        search.setSamplingSize(self.size)
        search.run()
        subspace = search.getResult()
        if subspace.getDimension() == 0:
            return Row(self.name, note="all gradients are 0: there is no active subspace")
        margins = Limit.of(problem.event).margin(np.array(subspace.getOutputSample()))
        return _polynomialRow(self.name, np.array(subspace.getActiveSample()), margins)


@_SETTINGS
class InverseRegressionChaos(ReliabilityMethod):
    """Directions by sliced inverse regression, and a quartic chaos on them, whose probability is computed.

    Parameters
    ----------
    size : int
        Runs, drawn from the inputs' distribution.
    dimension : int
        Number of directions, at most that of the inputs.
    """

    size: int = 500
    dimension: int = 2

    name = "InverseRegressionChaos"
    fixedSize = True

    def run(self, problem: CountedProblem) -> Row:
        points, margins = _normalRuns(problem, self.size)
        directions = slicedInverseRegression(points, margins, min(self.dimension, points.shape[1]))
        return _polynomialRow(self.name, points @ directions, margins)


@_SETTINGS
class ChaosMonteCarlo(ReliabilityMethod):
    """OpenTURNS' sparse polynomial chaos (least angle regression) in standard space, and Monte Carlo on it.

    Parameters
    ----------
    size : int
        Runs, drawn from the inputs' distribution.
    sampleSize : int
        Points of the chaos, which cost no run.
    """

    size: int = 500
    sampleSize: int = 100_000

    name = "ChaosMonteCarlo"
    fixedSize = True

    def run(self, problem: CountedProblem) -> Row:
        points, margins = _normalRuns(problem, self.size)
        law = ot.Normal(points.shape[1])
        basis = ot.OrthogonalProductPolynomialFactory([ot.HermiteFactory()] * points.shape[1])
        selection = ot.LeastSquaresStrategy(
            ot.LeastSquaresMetaModelSelectionFactory(ot.LARS(), ot.CorrectedLeaveOneOut())
        )
        algorithm = ot.FunctionalChaosAlgorithm(
            points, margins[:, None], law, ot.FixedStrategy(basis, _CHAOS_TERMS), selection
        )
        algorithm.run()
        metaModel = algorithm.getResult().getMetaModel()
        failures = done = 0
        while done < self.sampleSize:
            block = min(_BLOCK, self.sampleSize - done)
            failures += int(np.count_nonzero(callFunction(metaModel, np.array(law.getSample(block))) <= 0.0))
            done += block
        terms = algorithm.getResult().getIndices().getSize()
        return _row(self.name, failures / done, f"{terms} terms, {failures} failures of {done} points of the chaos")


def _normalRuns(problem, size):
    """Points (n, d) of standard space and the margins there, at most 0 in the event."""
    space = StandardSpace(problem.distribution)
    points = space.generateSample(size)
    values = callFunction(problem.event.getFunction(), space.toPhysical(points))
    return points, Limit.of(problem.event).margin(values)


def _polynomialRow(name, active, margins):
    """The row of a polynomial of at most degree 4 in active variables, fitted to margins."""
    regression = MultivariatePolynomialRegression(active, margins[:, None], ot.Normal(active.shape[1]))
    regression.selectDegree(4)
    regression.run()
    result = regression.getResult()
    if active.shape[1] <= _COMPUTED_VARIABLES:
        probability = PolynomialDistribution(result).computeCDF(0.0)
    else:
        blocks = (np.array(ot.Normal(active.shape[1]).getSample(_BLOCK)) for _ in range(_SAMPLE // _BLOCK))
        probability = sum(np.count_nonzero(result.evaluate(block) <= 0.0) for block in blocks) / _SAMPLE
    score = result.getQ2LeaveOneOut()[0] if result.getVariance()[0] > 0.0 else math.nan
    known = f", Q2 {score:.4f}" if math.isfinite(score) else ""
    return _row(name, float(probability), f"{active.shape[1]} variables, degree {result.getDegree()}{known}")


def _row(name, probability, how):
    if not probability > 0.0:
        return Row(name, note=f"the surrogate never fails, which says nothing of the function: {how}")
    return Row(
        name,
        probability,
        converged=True,
        note=f"the probability of the surrogate, not corrected by true runs, and without an interval: {how}",
    )
