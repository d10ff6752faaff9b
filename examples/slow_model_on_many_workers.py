"""
A slow model on many workers
============================

A model that takes 20 ms a point, here because it waits for another program as many do, is asked by several workers at
once. The numbers are the same, whoever computes them; the time is not.
"""

import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import openturns as ot
import openturns.viewer as otv

from satsep_ot.methods.parallel.function import FunctionChunkError, ParallelFunction
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability


def deflection(x):
    """Of a cantilever beam: load, length, modulus, moment of inertia."""
    time.sleep(0.02)
    force, length, modulus, inertia = x
    return [force * length**3 / (3.0 * modulus * inertia)]


model = ot.PythonFunction(4, 1, deflection)
distribution = ot.JointDistribution(
    [
        ot.LogNormalMuSigma(30e3, 3e3).getDistribution(),  # force [N]
        ot.Normal(2.5, 0.01),  # length [m]
        ot.LogNormalMuSigma(6.7e10, 3e9).getDistribution(),  # modulus [Pa]
        ot.LogNormalMuSigma(1.5e-5, 3e-7).getDistribution(),  # moment of inertia [m4]
    ]
)
distribution.setDescription(["force", "length", "modulus", "inertia"])
ot.RandomGenerator.SetSeed(0)
sample = np.array(distribution.getSample(64))

# %%
# Threads are enough for a model that waits. One that computes in Python needs processes, by
# ``satsep_ot.methods.parallel.executors.processes``, or a Dask cluster, by ``daskExecutor``: the line with the executor
# is all that changes.
seconds, values = {}, {}
for workers in (1, 2, 4, 8):
    with ThreadPoolExecutor(workers) as executor:
        function = ParallelFunction(model, executor)
        function.setChunkSize(4)
        begin = time.perf_counter()
        values[workers] = function.evaluate(sample)
        seconds[workers] = time.perf_counter() - begin
    same = np.array_equal(values[workers], values[1])
    print(f"{workers} workers: {seconds[workers]:.2f} s, the same bits: {same}")

graph = ot.Graph("64 points of 20 ms", "workers", "time [s]", True, "upper right")
graph.setLogScale(ot.GraphImplementation.LOGXY)
counts = list(seconds)
measured = ot.Curve(counts, [seconds[number] for number in counts])
measured.setLegend("measured")
measured.setPointStyle("circle")
ideal = ot.Curve(counts, [64 * 0.02 / number for number in counts])
ideal.setLegend("nothing lost")
ideal.setLineStyle("dashed")
graph.add(measured)
graph.add(ideal)
view = otv.View(graph)
view.getFigure().subplots_adjust(left=0.18)

# %%
# It is an OpenTURNS function: an event can be made of it, and the algorithms of this package and of OpenTURNS hand over
# whole samples.
with ThreadPoolExecutor(8) as executor:
    function = ot.Function(ParallelFunction(model, executor))
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, ot.RandomVector(distribution)), ot.Greater(), 0.21)
    algorithm = ActiveSubspaceReliability(event)
    algorithm.setTargetCoefficientOfVariation(0.1)
    algorithm.run()
result = algorithm.getResult()
print(f"P(deflection > 0.21 m) = {result.getProbabilityEstimate():.2e} by {result.getEvaluationNumber()} runs")

# %%
# What fails is tried again elsewhere, three times by default. Then the error names the rows, and has what was finished.
failing = ot.PythonFunction(4, 1, lambda x: [np.nan if x[1] == sample[42, 1] else x[1]])
with ThreadPoolExecutor(2) as executor:
    function = ParallelFunction(failing, executor)
    function.setChunkSize(4)
    try:
        function.evaluate(sample)
    except FunctionChunkError as error:
        print(error)
        finished = error.rows
print(f"{len(finished)} of {len(sample)} rows were finished")
