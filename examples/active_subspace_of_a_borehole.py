"""
Active subspace of a borehole
=============================

Active subspace and polynomial regression of a plain OpenTURNS function: the flow through a borehole.

Function and distributions: Morris, Mitchell, Ylvisaker, "Bayesian design and analysis of computer experiments: use of
derivatives in surface prediction", Technometrics 35 (1993). Eight inputs, one direction that matters.
"""

import numpy as np
import openturns as ot
import openturns.viewer as otv

from satsep_ot.methods.polynomials.distribution import PolynomialDistribution
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm

ot.RandomGenerator.SetSeed(0)
flow = ot.SymbolicFunction(
    ["rw", "r", "Tu", "Hu", "Tl", "Hl", "L", "Kw"],
    ["2 * pi_ * Tu * (Hu - Hl) / (log(r / rw) * (1 + 2 * L * Tu / (log(r / rw) * rw^2 * Kw) + Tu / Tl))"],
)
distribution = ot.JointDistribution(
    [
        ot.Normal(0.10, 0.0161812),  # radius of the borehole [m]
        ot.LogNormal(7.71, 1.0056),  # radius of influence [m]
        ot.Uniform(63070.0, 115600.0),  # transmissivity of the upper aquifer [m2/yr]
        ot.Uniform(990.0, 1110.0),  # potentiometric head of the upper aquifer [m]
        ot.Uniform(63.1, 116.0),  # transmissivity of the lower aquifer [m2/yr]
        ot.Uniform(700.0, 820.0),  # potentiometric head of the lower aquifer [m]
        ot.Uniform(1120.0, 1680.0),  # length of the borehole [m]
        ot.Uniform(9855.0, 12045.0),  # hydraulic conductivity of the borehole [m/yr]
    ]
)
distribution.setDescription(flow.getInputDescription())

# The subspace, from 200 gradients.
algorithm = ActiveSubspaceAlgorithm(flow, distribution)
algorithm.setSamplingSize(200)
algorithm.setDimension(1)
algorithm.run()
subspace = algorithm.getResult()
scores = subspace.getActivityScores()
print("eigenvalues", " ".join(f"{value:.3g}" for value in list(subspace.getEigenvalues())[:4]))
for name, score in sorted(zip(distribution.getDescription(), scores, strict=True), key=lambda pair: -pair[1])[:4]:
    print(f"  activity score of {name:3} {score:8.2f}")

# A quartic of the active variable, and how well it predicts runs that it has not seen.
regression = MultivariatePolynomialRegression(subspace.getActiveSample(), subspace.getOutputSample(), ot.Normal(1))
regression.run()
result = regression.getResult()
inputs = distribution.getSample(2000)
validation = result.getMetaModelValidation(subspace.getTransformation()(inputs), flow(inputs))
print(
    f"Q2 by leave-one-out {result.getQ2LeaveOneOut()[0]:.4f}, on 2,000 new points {validation.computeR2Score()[0]:.4f}"
)

# Its law follows from the roots of the quartic, without sampling. It is the surrogate's, not the function's.
law = PolynomialDistribution(result)
sample = np.array(flow(distribution.getSample(100_000)))[:, 0]
for limit in (120.0, 150.0):
    share = np.mean(sample > limit)
    print(f"P(flow > {limit:.0f} m3/yr): surrogate {law.computeComplementaryCDF(limit):.2e}, Monte Carlo {share:.2e}")

graph = subspace.drawSufficientSummary()
graph.setTitle("Flow through a borehole")
graph.setXTitle("active variable [standard deviations]")
graph.setYTitle("flow [m3/yr]")
view = otv.View(graph)
