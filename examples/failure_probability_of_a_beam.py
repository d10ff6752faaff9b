"""
Failure probability of a beam
=============================

Failure probability of a plain OpenTURNS function by ActiveSubspaceReliability: the deflection of a cantilever beam.

The beam is that of OpenTURNS' own use cases; Monte Carlo stands beside it to check.
"""

import openturns as ot
import openturns.viewer as otv
from openturns.usecases import cantilever_beam

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability

ot.RandomGenerator.SetSeed(0)
beam = cantilever_beam.CantileverBeam()
distribution = beam.independentDistribution
variable = ot.CompositeRandomVector(beam.model, ot.RandomVector(distribution))
event = ot.ThresholdEvent(variable, ot.Greater(), 0.23)

algorithm = ActiveSubspaceReliability(event)
algorithm.setTargetCoefficientOfVariation(0.05)
algorithm.run()
result = algorithm.getResult()
interval = result.getConfidenceInterval(0.95)
print(f"P(deflection > 0.23 m) = {result.getProbabilityEstimate():.3e}")
print(f"95 % interval [{interval.getLowerBound()[0]:.3e}, {interval.getUpperBound()[0]:.3e}]")
print(f"evaluations {result.getEvaluationNumber()}, active dimension {result.getActiveDimensions()}")
print(result.getReason())

monteCarlo = ot.ProbabilitySimulationAlgorithm(event, ot.MonteCarloExperiment())
monteCarlo.setBlockSize(100_000)
monteCarlo.setMaximumOuterSampling(10)
monteCarlo.setMaximumCoefficientOfVariation(0.02)
monteCarlo.run()
check = monteCarlo.getResult()
share, size = check.getProbabilityEstimate(), check.getOuterSampling() * check.getBlockSize()
bounds = check.getProbabilityDistribution().computeBilateralConfidenceInterval(0.95)
lower, upper = bounds.getLowerBound()[0], bounds.getUpperBound()[0]
print(f"Monte Carlo {share:.3e} [{lower:.3e}, {upper:.3e}] by {size:,} evaluations")

view = otv.View(result.drawProbabilityConvergence())
