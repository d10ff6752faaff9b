"""
Other distributions, other dependence
=====================================

A case file is only one way to say what scatters. The function takes any joint distribution of its inputs: here the
masses come from weighings, the stiffnesses of two pairs of springs depend on each other by a Clayton copula, and
nothing else changes.
"""

import openturns as ot
import openturns.viewer as otv

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

ot.RandomGenerator.SetSeed(0)
problem = SeparationProblem("reference")
names = problem.getInputNames()
marginals = [problem.getDistribution().getMarginal(index) for index in range(len(names))]

# Twenty weighings of satellites of the series [kg], as a kernel density.
weighings = ot.Sample([[100.0 + 0.4 * ot.DistFunc.qNormal((k + 0.5) / 20.0)] for k in range(20)])
marginals[names.index("satellite_mass")] = ot.KernelSmoothing().build(weighings)

# Stiffnesses of one batch: low values come together, high ones do not.
springs = [names.index(f"stiffness_{k}") for k in (1, 2, 3, 4)]
pair = ot.ClaytonCopula(2.0)
blocks = ot.BlockIndependentCopula([pair, pair, ot.IndependentCopula(len(names) - 4)])

# The copula's blocks are springs 1 and 2, springs 3 and 4, and the rest: the inputs come in that order.
order = springs + [index for index in range(len(names)) if index not in springs]
distribution = ot.JointDistribution([marginals[index] for index in order], blocks)
distribution.setDescription([names[index] for index in order])
back = [order.index(index) for index in range(len(names))]
permutation = ot.Matrix(len(names), len(names))
for row, column in enumerate(back):
    permutation[row, column] = 1.0
reorder = ot.LinearFunction([0.0] * len(names), [0.0] * len(names), permutation)
velocity = ot.ComposedFunction(ot.Function(SeparationFunction("reference", quantities=["axial_velocity"])), reorder)

probabilities = {}
for label, law in (
    ("independent", ot.JointDistribution([marginals[index] for index in order])),
    ("Clayton", distribution),
):
    variable = ot.CompositeRandomVector(velocity, ot.RandomVector(law))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(variable, ot.Less(), 0.590))
    algorithm.run()
    probabilities[label] = algorithm.getResult()
    interval = probabilities[label].getConfidenceInterval(0.95)
    print(
        f"{label:11} P(axial velocity < 0.590 m/s) = {probabilities[label].getProbabilityEstimate():.2e}, "
        f"95 % interval {interval.getLowerBound()[0]:.2e} to {interval.getUpperBound()[0]:.2e}"
    )

# %%
# Two springs of a pair: low stiffnesses come together, which is what makes a slow separation more probable.
pairs = distribution.getMarginal([0, 1]).getSample(1000)
graph = ot.Graph(
    "Springs 1 and 2, Clayton copula", "stiffness of spring 1 [N/m]", "stiffness of spring 2 [N/m]", True, ""
)
graph.add(ot.Cloud(pairs, "black", "fcircle"))
view = otv.View(graph)
