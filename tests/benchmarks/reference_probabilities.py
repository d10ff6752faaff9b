"""The reference probabilities of benchmark_problems.py: all of them, and those by sampling and by convolution anew.

    python tests/benchmarks/reference_probabilities.py [--sample]

About five minutes with the sampling.
"""

import sys
from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot.methods.comparison import problems as benchmark_problems
from satsep_ot.methods.comparison.problems import getBenchmarkProblem, getBenchmarkProblems

CHUNK = 200_000


def importanceSampling(problem, points, shift=0.0, scale=1.0, seed=0):
    """Mean and coefficient of variation with inputs from N(shift, scale^2 I)."""
    generator = np.random.default_rng(seed)
    dimension = problem.getDistribution().getDimension()
    total, total2 = 0.0, 0.0
    for _ in range(points // CHUNK):
        u = shift + scale * generator.standard_normal((CHUNK, dimension))
        logWeight = -0.5 * (u**2).sum(axis=1) + 0.5 * (((u - shift) / scale) ** 2).sum(axis=1)
        w = np.where(problem.evaluate(u) <= 0.0, np.exp(logWeight) * scale**dimension, 0.0)
        total += w.sum()
        total2 += (w**2).sum()
    mean = total / points
    return mean, np.sqrt(total2 / points - mean**2) / mean / np.sqrt(points)


def ridges(points, seed=0):
    """Probabilities of the events of the eight ridges by Monte Carlo."""
    generator = np.random.default_rng(seed)
    counts = dict.fromkeys(benchmark_problems._RIDGE_LIMITS, 0)
    for _ in range(points // CHUNK):
        outputs = benchmark_problems._ridgeOutputs(generator.standard_normal((CHUNK, 35)))
        for name, limit in benchmark_problems._RIDGE_LIMITS.items():
            counts[name] += int((limit(outputs) <= 0.0).sum())
    return {name: count / points for name, count in counts.items()}


def convolution():
    """RP8: a sum of independent inputs, which OpenTURNS adds by the characteristic function."""
    marginals = getBenchmarkProblem("RP8").getDistribution()
    terms = [marginals.getMarginal(i) * factor for i, factor in enumerate((1.0, 2.0, 2.0, 1.0, -5.0, -5.0))]
    total = terms[0]
    for term in terms[1:]:
        total = total + term
    return ot.Distribution(total).computeCDF(0.0)


def main(sample=False):
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "scipy"))
    print(versions)
    for problem in getBenchmarkProblems():
        dimension = problem.getDistribution().getDimension()
        print(f"{problem.getName():10s} {dimension:3d} inputs  {problem.getProbability():.5e}  {problem.getSource()}")
    print(f"RP8 by convolution: {convolution():.6e}")
    if sample:
        shift = 3.0 * benchmark_problems._cosineDirection(30, 1)
        for name, points, *settings in (("P3", 20_000_000, shift), ("P7", 40_000_000, 0.0, 1.25)):
            mean, variation = importanceSampling(getBenchmarkProblem(name), points, *settings)
            print(f"{name} by importance sampling: {mean:.5e}, coefficient of variation {variation:.1e}")
        print(f"Monte Carlo: {ridges(100_000_000)}")


if __name__ == "__main__":
    main("--sample" in sys.argv[1:])
