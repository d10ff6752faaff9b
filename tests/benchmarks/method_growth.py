"""How the time of the methods grows: the active subspace with the inputs, the ridge with the points, moments with both.

    python tests/benchmarks/method_growth.py

The active subspace is of a linear, vectorised Python function without gradient, by central differences at the default
number of points: 2 d M evaluations of d numbers each. "Function" is the time inside OpenTURNS' call of it, which makes
a Python object of each number, "own" the rest. Times are of the processor, by one thread for what is ours. Growth is
from line to line, of the time and of d M.
"""

import math
import os
import sys
import time
from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot import ActiveSubspaceAlgorithm, MultivariatePolynomialRegression, RidgeApproximation
from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.subspaces import gradients

INPUTS = (50, 100, 200, 500)
SIZES = (1_000, 10_000, 100_000)


def seconds(task):
    start = time.process_time()
    task()
    return time.process_time() - start


def linear_function(inputs):
    weights = np.arange(1.0, inputs + 1.0)[:, None] / inputs
    return ot.PythonFunction(inputs, 1, func_sample=lambda points: np.asarray(points, dtype=float) @ weights)


def subspaces():
    called = [0.0]
    call = gradients.callFunction

    def timed(function, points):
        start = time.process_time()
        values = call(function, points)
        called[0] += time.process_time() - start
        return values

    gradients.callFunction = timed
    before = None
    print("active subspace by differences\n    d     M  time s  function  own s  growth of time, own, d M")
    for inputs in INPUTS:
        called[0] = 0.0
        algorithm = ActiveSubspaceAlgorithm(linear_function(inputs), ot.Normal(inputs))
        total = seconds(algorithm.run)
        size = algorithm.getSamplingSize()
        now = np.array([total, total - called[0], inputs * size])
        growth = "" if before is None else "  ".join(f"{factor:.1f}" for factor in now / before)
        print(f"{inputs:5d} {size:5d} {total:7.2f} {called[0]:9.2f} {now[1]:6.2f}  {growth}", flush=True)
        before = now
    gradients.callFunction = call


def ridges():
    before = None
    print("ridge approximation of exp(w.u / 2) with 1 % noise in 10 inputs\n  points  time s  growth of time, points")
    weights = np.arange(1.0, 11.0) / np.linalg.norm(np.arange(1.0, 11.0))
    for size in SIZES:
        inputs = np.array(ot.Normal(10).getSample(size))
        noise = np.array(ot.Normal(0.0, 0.01).getSample(size))
        algorithm = RidgeApproximation(inputs, np.exp(0.5 * inputs @ weights)[:, None] + noise, ot.Normal(10))
        now = np.array([seconds(algorithm.run), size])
        growth = "" if before is None else "  ".join(f"{factor:.1f}" for factor in now / before)
        print(f"{size:8d} {now[0]:7.2f}  {growth}", flush=True)
        before = now


def moments():
    law = ot.JointDistribution([ot.Uniform(-math.pi, math.pi)] * 3)
    inputs = law.getSample(1000)
    outputs = ot.SymbolicFunction(["a", "b", "c"], ["sin(a) + 7 * sin(b)^2 + 0.1 * c^4 * sin(a)"])(inputs)
    regression = MultivariatePolynomialRegression(inputs, outputs, law)
    regression.setDegree(8)
    fit = seconds(regression.run)
    result = regression.getResult()
    indices = seconds(lambda: [result.getSobolTotalIndex(i) for i in range(3)])
    families = [ot.StandardDistributionPolynomialFactory(law.getMarginal(i)) for i in range(3)]
    product = ot.OrthogonalProductPolynomialFactory(families)
    size = product.getEnumerateFunction().getBasisSizeFromTotalDegree(8)
    other = seconds(ot.LeastSquaresExpansion(inputs, outputs, law, product, size).run)
    print("Ishigami's function, 1,000 points, degree 8")
    print(f"ms: fit {1e3 * fit:.1f}, three total indices {1e3 * indices:.1f}, LeastSquaresExpansion {1e3 * other:.1f}")


def spaces():
    print("standard space of ot.Normal(d), s")
    for inputs in (500, 1000, 2000):
        law = ot.Normal(inputs)
        own = seconds(lambda law=law: StandardSpace(law))
        print(f"{inputs:5d} {own:7.2f}", flush=True)


if __name__ == "__main__":
    packages = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "scipy"))
    print(f"{packages}, Python {sys.version.split()[0]}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; seed 0")
    ot.RandomGenerator.SetSeed(0)
    with singleThread():
        for part in (subspaces, ridges, moments, spaces):
            part()
