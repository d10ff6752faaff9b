"""
Calibration of the springs from measured rates
==============================================

After a separation the satellite's gyroscopes give three body rates, and the launcher the separation velocity. Which
stiffnesses did the four springs have? OpenTURNS' Bayesian calibration tells, with the case's scatter as the prior and
exact gradients. The four measurements are nearly linear in the stiffnesses, but one combination leaves no trace: two
opposite springs stiffer and the other two softer by the same amount. So the single values stay as uncertain as this
combination, while what the motion depends on is found: the differences of opposite springs to 1 N/m, the sum as well as
the velocity is measured.
"""

import openturns as ot
import openturns.viewer as otv

from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

ot.RandomGenerator.SetSeed(1)
problem = SeparationProblem("reference")
distribution = problem.getDistribution()
names = problem.getInputNames()
springs = [names.index(f"stiffness_{k}") for k in (1, 2, 3, 4)]
measured = ["axial_velocity", "rate_x", "rate_y", "rate_z"]
function = ot.Function(SeparationFunction("reference", quantities=measured))

# A separation whose springs are known here, and its measurement: 1 mm/s and 0.005 deg/s of noise.
true = [5560.0, 5450.0, 5530.0, 5490.0]
inputs = distribution.getMean()
for index, stiffness in zip(springs, true, strict=True):
    inputs[index] = stiffness
noise = [0.001, 0.005, 0.005, 0.005]
measurement = function(inputs) + ot.Normal([0.0] * 4, noise).getRealization()

# Everything but the springs is taken at its mean, about which the model is linearised by its own gradient.
mean = distribution.getMean()
gradient = function.gradient(mean)
design = ot.Matrix(len(measured), len(springs))
for row in range(len(measured)):
    for column, index in enumerate(springs):
        design[row, column] = gradient[index, row]
prior = [mean[index] for index in springs]
prior_covariance, noise_covariance = ot.CovarianceMatrix(4), ot.CovarianceMatrix(4)
for k in range(4):
    prior_covariance[k, k] = 55.0**2
    noise_covariance[k, k] = noise[k] ** 2
# One observation of four outputs, told as four of one output: their errors are independent and of their own size.
calibration = ot.GaussianLinearCalibration(
    ot.Sample([[value] for value in function(mean)]),
    design,
    ot.Sample([[value] for value in measurement]),
    prior,
    prior_covariance,
    noise_covariance,
)
calibration.run()
result = calibration.getResult()
posterior = result.getParameterPosterior()
estimate, deviation = posterior.getMean(), posterior.getStandardDeviation()
for k in range(4):
    print(f"spring {k + 1}: true {true[k]:.0f} N/m, found {estimate[k]:.0f} +- {deviation[k]:.0f}, before 5500 +- 55")

# %%
# The combinations that the motion depends on.
combinations = {"all": [1, 1, 1, 1], "1 - 3": [1, 0, -1, 0], "2 - 4": [0, 1, 0, -1], "unseen": [1, -1, 1, -1]}
found = {}
for label, weights in combinations.items():
    mean_value = sum(w * e for w, e in zip(weights, estimate, strict=True))
    covariance = posterior.getCovariance()
    variance = sum(weights[i] * weights[j] * covariance[i, j] for i in range(4) for j in range(4))
    true_value = sum(w * t for w, t in zip(weights, true, strict=True))
    found[label] = (true_value, mean_value, variance**0.5)
    print(f"{label:6}: true {true_value:7.0f} N/m, found {mean_value:7.0f} +- {variance**0.5:.0f}")

# %%
# What the measurements say of one spring alone.
graph = ot.Graph("Spring 1", "stiffness [N/m]", "probability density [1/(N/m)]", True, "upper left")
for label, law, style in (
    ("before", ot.Normal(5500.0, 55.0), "dashed"),
    ("after", posterior.getMarginal(0), "solid"),
):
    curve = law.drawPDF(5300.0, 5700.0, 401).getDrawable(0)
    curve.setLegend(label)
    curve.setColor("black")
    curve.setLineStyle(style)
    graph.add(curve)
graph.add(ot.Cloud([[true[0], 0.0]], "black", "fcircle", "true"))
view = otv.View(graph)
