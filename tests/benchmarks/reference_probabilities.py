"""The reference probabilities of benchmark_problems.py: all of them, and those by sampling and by convolution anew.

    python tests/benchmarks/reference_probabilities.py [--sample [P3 P7 DampedOscillator15 ... RP38 Duffing ridges]]

All sampled ones without names; that takes about ten minutes.
"""

import argparse
from importlib import metadata

import numpy as np
import openturns as ot
from scipy.special import logsumexp, ndtr

from satsep_ot.methods.comparison import problems as benchmark_problems
from satsep_ot.methods.comparison.problems import getBenchmarkProblem, getBenchmarkProblems

CHUNK = 200_000


def importanceSampling(problem, points, shifts=0.0, scale=1.0, seed=0, chunk=CHUNK):
    """Mean and coefficient of variation with inputs from N(shift, scale^2 I), equally from each of the shifts."""
    generator = np.random.default_rng(seed)
    dimension = problem.getDistribution().getDimension()
    shifts = np.broadcast_to(np.atleast_2d(shifts), (len(np.atleast_2d(shifts)), dimension))
    total, total2 = 0.0, 0.0
    for _ in range(points // chunk):
        u = scale * generator.standard_normal((chunk, dimension)) + shifts[generator.integers(len(shifts), size=chunk)]
        standard = -0.5 * (u**2).sum(axis=1)
        logDensities = [-0.5 * (((u - shift) / scale) ** 2).sum(axis=1) for shift in shifts]
        logWeight = standard - logsumexp(logDensities, axis=0) + np.log(len(shifts)) + dimension * np.log(scale)
        w = np.where(problem.evaluate(u) <= 0.0, np.exp(logWeight), 0.0)
        total += w.sum()
        total2 += (w**2).sum()
    mean = total / points
    return mean, np.sqrt(total2 / points - mean**2) / mean / np.sqrt(points)


def conditionalSampling(conditional, dimension, points, seed=0):
    """Mean and coefficient of variation of E[conditional(U)], U standard normal.

    Points are from a normal law fitted to the failures by two rounds of 200,000, and a fifth from N(0, 1.5^2 I).
    """
    generator = np.random.default_rng(seed)
    laws = [(0.2, ot.Normal([0.0] * dimension, [1.5] * dimension, ot.CorrelationMatrix(dimension)))]

    def draw(size):
        shares = np.array([share for share, _ in laws])
        sizes = generator.multinomial(size, shares / shares.sum())
        u = np.vstack([_normalPoints(generator, law, n) for (_, law), n in zip(laws, sizes, strict=True)])
        density = sum(share * np.asarray(law.computePDF(u))[:, 0] for share, law in laws) / shares.sum()
        nominal = np.exp(-0.5 * (u**2).sum(axis=1)) / (2.0 * np.pi) ** (0.5 * dimension)
        return u, conditional(u) * nominal / density

    for _ in range(2):
        u, w = draw(CHUNK)
        mean = np.average(u, axis=0, weights=w)
        covariance = 1.2 * np.cov(u.T, aweights=w)
        laws = [laws[0], (0.8, ot.Normal(mean, ot.CovarianceMatrix(covariance)))]
    weights = np.concatenate([draw(CHUNK)[1] for _ in range(points // CHUNK)])
    return weights.mean(), weights.std() / weights.mean() / np.sqrt(len(weights))


def _normalPoints(generator, law, size):
    factor = np.linalg.cholesky(np.array(law.getCovariance()))
    return np.array(law.getMean()) + generator.standard_normal((size, law.getDimension())) @ factor.T


def dampedOscillator(force, points):
    """Closed form in S and Fs: log(Fs) - log(S) / 2 is normal."""
    problem = getBenchmarkProblem(f"DampedOscillator{force:g}")
    laws = [problem.getDistribution().getMarginal(i).getParameter() for i in range(8)]
    means, deviations = np.array(laws)[:, :2].T
    mean, deviation = means[7] - 0.5 * means[6], np.hypot(deviations[7], 0.5 * deviations[6])

    def conditional(u):
        x = np.column_stack([np.exp(means[:6] + deviations[:6] * u), np.ones(len(u)), np.zeros(len(u))])
        return ndtr((np.log(-problem.evaluate(x)) - mean) / deviation)

    return conditionalSampling(conditional, 6, points)


def rp38(points):
    """Closed form in the first input, in which the function is linear."""
    problem = getBenchmarkProblem("RP38")
    means = np.array(problem.getDistribution().getMean())

    def conditional(u):
        x = np.column_stack([np.zeros(len(u)), means[1:] * (1.0 + 0.1 * u)])
        intercept = problem.evaluate(x)
        x[:, 0] = 1.0
        slope = problem.evaluate(x) - intercept
        return ndtr(-(intercept + slope * means[0]) / (0.1 * means[0] * np.abs(slope)))

    return conditionalSampling(conditional, 6, points)


def duffing(points):
    """Around the most likely failure of each side, by the iteration of Hasofer, Lind, Rackwitz and Fiessler."""
    problem = getBenchmarkProblem("Duffing")
    displacement = problem._components
    designPoints = []
    for limit in (0.1, -0.06):
        u = np.zeros(200)
        for _ in range(20):
            values = displacement(np.vstack([u, u + 1e-4 * np.eye(200)]))
            gradient = (values[1:] - values[0]) / 1e-4
            u = (gradient @ u + limit - values[0]) * gradient / (gradient @ gradient)
        designPoints.append(u)
    return importanceSampling(problem, points, np.array(designPoints), chunk=20_000)


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


def main(sample=None):
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "scipy"))
    print(versions)
    for problem in getBenchmarkProblems():
        dimension = problem.getDistribution().getDimension()
        print(f"{problem.getName():22s} {dimension:3d} inputs  {problem.getProbability():.5e}  {problem.getSource()}")
    print(f"RP8 by convolution: {convolution():.6e}")
    shift = 3.0 * benchmark_problems._cosineDirection(30, 1)
    samplings = {
        "P3": lambda: importanceSampling(getBenchmarkProblem("P3"), 20_000_000, shift),
        "P7": lambda: importanceSampling(getBenchmarkProblem("P7"), 40_000_000, scale=1.25),
        "DampedOscillator15": lambda: dampedOscillator(15.0, 8_000_000),
        "DampedOscillator21.5": lambda: dampedOscillator(21.5, 8_000_000),
        "DampedOscillator27.5": lambda: dampedOscillator(27.5, 8_000_000),
        "RP38": lambda: rp38(8_000_000),
        "Duffing": lambda: duffing(400_000),
    }
    for name in samplings if sample == [] else sample or ():
        if name != "ridges":
            mean, variation = samplings[name]()
            print(f"{name} by importance sampling: {mean:.5e}, coefficient of variation {variation:.1e}", flush=True)
    if sample == [] or "ridges" in (sample or ()):
        print(f"Monte Carlo: {ridges(100_000_000)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sample", nargs="*", help="sample these again, all without names")
    main(parser.parse_args().sample)
