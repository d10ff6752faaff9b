"""Recompute the reference probabilities of benchmark_problems.py that have no closed form (about five minutes)."""

import numpy as np

from satsep_ot.methods import benchmark_problems
from satsep_ot.methods.benchmark_problems import getBenchmarkProblem

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


if __name__ == "__main__":
    shift = 3.0 * benchmark_problems._cosineDirection(30, 1)
    for name, points, *settings in (("P3", 20_000_000, shift), ("P7", 40_000_000, 0.0, 1.25)):
        mean, variation = importanceSampling(getBenchmarkProblem(name), points, *settings)
        print(f"{name}: {mean:.5e}, coefficient of variation {variation:.1e}")
    print(ridges(100_000_000))
