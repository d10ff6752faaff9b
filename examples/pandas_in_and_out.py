"""
pandas in, pandas out
=====================

Measured inputs come as a table, results leave as one. A data frame with a column for each input goes through the
function and comes back with a column for each quantity; units stay in the names. It needs pandas, which the
package itself does not: ``pip install pandas``.
"""

import numpy as np
import openturns as ot
import pandas

from satsep_ot.model.distributions import build_distribution
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

ot.RandomGenerator.SetSeed(0)
problem = SeparationProblem("reference")
function = SeparationFunction("reference")

# A table of 500 separations, as it might come from a spreadsheet: OpenTURNS makes data frames of samples itself.
inputs = problem.getDistribution().getSample(500).asDataFrame()
outputs = pandas.DataFrame(
    function.evaluate(inputs.to_numpy()), columns=list(function.getOutputDescription()), index=inputs.index
)
# Body rates are among the inputs, before the push, and among the quantities, after it.
both = inputs.add_prefix("before: ").join(outputs)
print(
    outputs[["axial_velocity [m/s]", "lateral_rate [deg/s]", "clearance [mm]"]].describe().loc[["mean", "std", "max"]]
)

# %%
# Which inputs go with the lateral rate about z? And a distribution fitted to a column goes back into a case.
correlations = inputs.corrwith(both["rate_z [deg/s]"]).abs().sort_values(ascending=False)
print(correlations.head(4).round(2).to_string())
weighed = inputs["satellite_mass [kg]"]
fitted = build_distribution("Normal", {"mu": weighed.mean(), "sigma": weighed.std()})
print(f"fitted to {len(weighed)} masses: {fitted}")
offset = np.hypot(inputs["satellite_cg_x [mm]"], inputs["satellite_cg_z [mm]"])
fast = outputs["lateral_rate [deg/s]"] > 1.5
print(f"{fast.sum()} of {len(both)} above 1.5 deg/s, with a mean CG offset of {offset[fast].mean():.2f} mm")
print(f"mean CG offset of all: {offset.mean():.2f} mm")
