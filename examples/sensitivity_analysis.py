"""
Sobol and HSIC indices of the separation function
=================================================

OpenTURNS' own sensitivity analysis on our function: Saltelli's Sobol indices of the clearance from some ten thousand
runs, which take a second, and HSIC indices from a given sample, without any further run.
"""

import openturns as ot
import openturns.viewer as otv

from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

ot.RandomGenerator.SetSeed(0)
problem = SeparationProblem("reference")
distribution = problem.getDistribution()
clearance = ot.Function(SeparationFunction("reference", quantities=["clearance"]))
names = problem.getInputNames()

experiment = ot.SobolIndicesExperiment(distribution, 1000)
inputs = experiment.generate()
outputs = clearance(inputs)
sobol = ot.SaltelliSensitivityAlgorithm(inputs, outputs, 1000)
sobol.setUseAsymptoticDistribution(True)
total = sobol.getTotalOrderIndices()
strongest = sorted(range(len(names)), key=lambda index: -total[index])[:6]
print(f"{len(inputs):,} runs for the Sobol indices of the clearance")
for index in strongest:
    print(f"  total index of {names[index]:15} {total[index]:.3f}")

# %%
# HSIC asks whether input and output are independent at all, from whatever sample there is; with the threshold of a
# requirement as a weight it asks about the tail.
sample = distribution.getSample(300)
values = clearance(sample)
kernels = []
for index in range(len(names)):
    kernel = ot.SquaredExponential(1)
    kernel.setScale(sample.getMarginal(index).computeStandardDeviation())
    kernels.append(kernel)
kernel = ot.SquaredExponential(1)
kernel.setScale(values.computeStandardDeviation())
hsic = ot.HSICEstimatorGlobalSensitivity([*kernels, kernel], sample, values, ot.HSICUStat())
indices = hsic.getR2HSICIndices()
ranked = sorted(range(len(names)), key=lambda index: -indices[index])[:6]
print(f"largest HSIC indices from {len(sample)} runs: {', '.join(names[index] for index in ranked)}")

graph = ot.SobolIndicesAlgorithm.DrawSobolIndices(
    [names[index] for index in strongest],
    [sobol.getFirstOrderIndices()[index] for index in strongest],
    [total[index] for index in strongest],
)
# The names belong below their marks; OpenTURNS' last drawable has them beside.
graph.erase(graph.getDrawables().getSize() - 1)
view = otv.View(graph)
labels = [names[index] for index in strongest]
view.getAxes()[0].set_xticks(range(1, len(labels) + 1), labels, fontsize=7)
