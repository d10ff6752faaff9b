"""
The probability that anything goes wrong
========================================

A review asks for each requirement, and for the mission: how likely is it that any of them is violated? That is an event
of its own, ``getSystemEvent()``: the smallest margin is below 0. Violations that come together count once, so that its
probability lies between the largest one and the sum.
"""

import openturns as ot

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.model.separation_problem import SeparationProblem

ot.RandomGenerator.SetSeed(0)
problem = SeparationProblem("ring_400kg")
results = {}
for name in [*problem.getRequirementNames(), None]:
    # None is the system: getComponents() gives the smooth parts of all requirements, which one true run computes.
    event = problem.getSystemEvent() if name is None else problem.getEvent(name)
    algorithm = ActiveSubspaceReliability(event)
    algorithm.setComponents(*problem.getComponents(name))
    algorithm.run()
    results[event.getName()] = algorithm.getResult()

for name, result in results.items():
    interval = result.getConfidenceInterval(0.95)
    print(
        f"{name:16} {result.getProbabilityEstimate():.3e}, with 95 % confidence {interval.getLowerBound()[0]:.2e} to "
        f"{interval.getUpperBound()[0]:.2e}, {result.getEvaluationNumber()} runs"
    )

# The parts themselves: a function from the inputs to components, and what makes the smallest margin of them.
function, composition, smooth, _ = problem.getComponents()
print(f"components: {', '.join(function.getOutputDescription())}; smooth: {smooth}")
mean = problem.getDistribution().getMean()
print(f"smallest margin at the means: {composition(function(mean))[0]:.2f} of the nominal run's")

# The event is OpenTURNS' own: any of its algorithms takes it.
monte_carlo = ot.ProbabilitySimulationAlgorithm(problem.getSystemEvent())
monte_carlo.setMaximumOuterSampling(20)
monte_carlo.setBlockSize(1000)
monte_carlo.run()
print(f"by 20,000 runs of Monte Carlo: {monte_carlo.getResult().getProbabilityEstimate():.1e}")
