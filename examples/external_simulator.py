"""
Your own simulator, another program
===================================

A simulator that is a program of its own reads inputs and writes outputs as text; nothing here knows what it computes.
It has no gradient and costs time, so the number of runs counts: the failure probability takes some hundred.
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import openturns as ot
import openturns.viewer as otv

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability

# The program, which may be in any language: a line of inputs in, a line with the output out. Here: the largest
# displacement of a mass on a spring with damping, after a push of force f for a time t.
PROGRAM = """
import math, sys
for line in sys.stdin:
    mass, stiffness, damping, force, duration = map(float, line.split())
    x = v = peak = 0.0
    step = 2e-3
    for k in range(1500):
        push = force if k * step < duration else 0.0
        v += step * (push - stiffness * x - damping * v) / mass
        x += step * v
        peak = max(peak, x)
    print(repr(peak))
"""
directory = tempfile.TemporaryDirectory()
program = Path(directory.name) / "simulator.py"
program.write_text(PROGRAM, encoding="utf-8")


def simulate(sample):
    """All points of a sample by one call of the program."""
    lines = "\n".join(" ".join(repr(float(value)) for value in point) for point in sample)
    done = subprocess.run([sys.executable, str(program)], input=lines, capture_output=True, text=True, check=True)
    return np.array([[float(line)] for line in done.stdout.split()])


distribution = ot.JointDistribution(
    [
        ot.LogNormalMuSigma(2.0, 0.05).getDistribution(),  # mass [kg]
        ot.Normal(200.0, 10.0),  # stiffness [N/m]
        ot.Uniform(1.0, 3.0),  # damping [N s/m]
        ot.Normal(15.0, 1.0),  # force [N]
        ot.Uniform(0.18, 0.22),  # duration [s]
    ]
)
distribution.setDescription(["mass", "stiffness", "damping", "force", "duration"])
model = ot.PythonFunction(5, 1, func_sample=simulate)
event = ot.ThresholdEvent(ot.CompositeRandomVector(model, ot.RandomVector(distribution)), ot.Greater(), 0.15)

ot.RandomGenerator.SetSeed(0)
algorithm = ActiveSubspaceReliability(event)
algorithm.setTargetCoefficientOfVariation(0.1)
algorithm.run()
result = algorithm.getResult()
directory.cleanup()
interval = result.getConfidenceInterval(0.95)
lower, upper = interval.getLowerBound()[0], interval.getUpperBound()[0]
print(f"P(peak > 0.15 m) = {result.getProbabilityEstimate():.2e}, 95 % interval {lower:.2e} to {upper:.2e}")
print(f"{result.getEvaluationNumber()} runs of the program, {result.getGradientNumber()} gradients")

# %%
# The same runs say which input drives the failures.
for row in sorted(result.computeImportance(), key=lambda row: -row.share)[:3]:
    print(f"  {row.input:10} {100.0 * row.share:5.1f} %, {row.shift:+.2f} standard deviations in failure")

view = otv.View(result.drawImportance())
