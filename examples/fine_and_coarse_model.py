"""
A fine and a coarse model
=========================

The viscous free fall of ``openturns.usecases``: how likely does a body that is thrown upwards rise above 480 m? The
fine model integrates its motion in 4,000 steps, the coarse one in 25. The coarse one is wrong by several metres, but
knows where failures are: with it, the probability of the fine model needs fewer runs of the fine model.
"""

import numpy as np
import openturns as ot
import openturns.viewer as otv
from openturns.usecases import viscous_free_fall

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability

fall = viscous_free_fall.ViscousFreeFall()
GRAVITY = 9.81  # m/s2
THRESHOLD = 480.0  # m


def highest_point(steps):
    """The largest altitude [m] of the body, by explicit Euler steps until the end of the use case's mesh."""

    def simulate(sample):
        altitude, speed, mass, drag = np.array(sample).T
        step, peak = (fall.tmax - fall.tmin) / steps, altitude
        for _ in range(steps):
            altitude = altitude + step * speed
            speed = speed - step * (GRAVITY + drag / mass * speed)
            peak = np.maximum(peak, altitude)
        return peak[:, None]

    function = ot.PythonFunction(fall.dim, 1, func_sample=simulate)
    function.setOutputDescription(["highest point [m]"])
    return function


fine, coarse = highest_point(4000), highest_point(25)
ot.RandomGenerator.SetSeed(0)
sample = fall.distribution.getSample(2000)
values = np.array([np.array(model(sample))[:, 0] for model in (fine, coarse)])
errors = values[1] - values[0]
print(f"correlation of the two models {np.corrcoef(values)[0, 1]:.4f}")
print(f"the coarse one is {errors.mean():.1f} m too high, with a standard deviation of {errors.std():.1f} m")

# %%
# The probability of the fine model, without the coarse one and with it.
event = ot.ThresholdEvent(ot.CompositeRandomVector(fine, ot.RandomVector(fall.distribution)), ot.Greater(), THRESHOLD)
results = {}
for name, low_fidelity in (("fine model alone", None), ("fine and coarse model", coarse)):
    ot.RandomGenerator.SetSeed(0)
    algorithm = ActiveSubspaceReliability(event)
    algorithm.setLowFidelity(low_fidelity)
    algorithm.run()
    results[name] = result = algorithm.getResult()
    interval = result.getConfidenceInterval(0.95)
    print(
        f"{name}: probability {result.getProbabilityEstimate():.3e}, 95 % interval {interval.getLowerBound()[0]:.3e} "
        f"to {interval.getUpperBound()[0]:.3e}, {result.getEvaluationNumber()} runs of the fine model"
    )

view = otv.View(results["fine and coarse model"].drawProbabilityConvergence())
