"""
Active subspaces of OpenTURNS' own use cases
============================================

A cantilever beam, a flood and the weight of a wing, as they are in ``openturns.usecases``: how many directions matter,
which inputs they are made of, and how well a polynomial of the active variable predicts runs that it has not seen.
"""

import openturns as ot
import openturns.viewer as otv
from openturns.usecases import cantilever_beam, flood_model, wingweight_function

from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm

ot.RandomGenerator.SetSeed(0)
beam, flood, wing = cantilever_beam.CantileverBeam(), flood_model.FloodModel(), wingweight_function.WingWeightModel()
cases = {
    "cantilever beam, deflection": (beam.model, beam.independentDistribution),
    # The formula's own gradient divides by zero; without one, differences take its place.
    "flood, water height": (ot.PythonFunction(8, 1, func_sample=flood.model.getMarginal(0)), flood.distribution),
    "wing, weight": (wing.model, wing.distribution),
}
results = {}
for name, (model, distribution) in cases.items():
    algorithm = ActiveSubspaceAlgorithm(model, distribution)
    algorithm.setSamplingSize(150)
    algorithm.setDimension(1)
    algorithm.run()
    subspace = algorithm.getResult()
    regression = MultivariatePolynomialRegression(
        subspace.getActiveSample(), subspace.getOutputSample(), ot.Normal(subspace.getDimension())
    )
    regression.run()
    surrogate = regression.getResult()
    inputs = distribution.getSample(1000)
    validation = surrogate.getMetaModelValidation(subspace.getTransformation()(inputs), model(inputs))
    results[name] = (subspace, validation.computeR2Score()[0])
    scores = subspace.getActivityScores()
    strongest = sorted(range(len(scores)), key=lambda index: -scores[index])[:3]
    print(
        f"{name}: {distribution.getDimension()} inputs, strongest "
        f"{', '.join(distribution.getDescription()[index] for index in strongest)}; "
        f"Q2 of one active variable on 1,000 new runs {results[name][1]:.4f}"
    )

# %%
# The water height against its one active variable, with the polynomial's band of prediction.
graph = results["flood, water height"][0].drawSufficientSummary()
graph.setTitle("Flood")
graph.setXTitle("active variable [standard deviations]")
graph.setYTitle("water height [m]")
view = otv.View(graph)
