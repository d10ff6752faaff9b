"""
FORM on the separation function
===============================

Our function in someone's FORM script: nothing but OpenTURNS from the second import on.

The event is not one of the case: a separation that is too fast for the satellite's sensors.
"""

import openturns as ot

from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

# All 35 inputs with their distributions, and one of the quantities of interest as a function of them.
distribution = SeparationProblem("reference").getDistribution()
velocity = ot.Function(SeparationFunction("reference", quantities=["axial_velocity"]))

# From here on it is OpenTURNS as everywhere; the gradient that FORM uses is exact.
variable = ot.CompositeRandomVector(velocity, ot.RandomVector(distribution))
event = ot.ThresholdEvent(variable, ot.Greater(), 0.606)
solver = ot.AbdoRackwitz()
solver.setStartingPoint(distribution.getMean())
algorithm = ot.FORM(solver, event)
algorithm.run()
result = algorithm.getResult()

factors = result.getImportanceFactors()
order = sorted(range(len(factors)), key=lambda index: -factors[index])
print(f"P(axial velocity > 0.606 m/s) by FORM: {result.getEventProbability():.2e}")
print(f"reliability index {result.getHasoferReliabilityIndex():.3f}")
for index in order[:5]:
    print(f"  {distribution.getDescription()[index]:22} {100.0 * factors[index]:5.1f} %")
