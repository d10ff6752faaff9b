"""What a cheap model beside the heavy one saves, and whether the intervals hold: pairs of exactly known probability.

    python tests/benchmarks/two_models.py [REPETITIONS] [--seed N] [--workers N]

The heavy model is ``a u + 0.25 sin(2 b u) cos(c u) + 0.2 cos(2 e u)`` with orthonormal directions in 20 inputs; its
probability is an integral over three of them. To the cheap model is added what no ridge of few runs follows, until the
correlation is the one named. The last pair's heavy model fails in one more mode.
"""

import argparse
import sys
import time
from concurrent.futures import ProcessPoolExecutor

import numpy as np
import openturns as ot
from scipy.special import ndtr

import satsep_ot
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability

INPUTS = 20
THRESHOLD, OTHER_THRESHOLD = 3.0, 3.1
PAIRS = {"0.999": 0.999, "0.99": 0.99, "0.9": 0.9, "0.5": 0.5, "uncorrelated": 0.0, "a mode less": 0.999}
A, B, C, E, F, G = np.linalg.qr(np.random.default_rng(0).standard_normal((INPUTS, 6)))[0].T


def heavy(u):
    """The margin's variable (n,) of all pairs but the last."""
    return u @ A + 0.25 * np.sin(2.0 * u @ B) * np.cos(u @ C) + 0.2 * np.cos(2.0 * u @ E)


def heavy_of(name, u):
    """The heavy model of a pair."""
    return np.maximum(heavy(u), u @ F + THRESHOLD - OTHER_THRESHOLD) if name == "a mode less" else heavy(u)


def cheap_of(name, u):
    """The cheap model of a pair."""
    correlation = PAIRS[name]
    # Unit variance to three digits each: so that the correlation is the one named.
    error = (0.8 * np.sin(3.0 * u @ G) + 0.6 * np.sqrt(2.0) * np.cos(4.0 * u @ B + u @ G)) * 1.2
    ratio = np.sqrt(1.0 / correlation**2 - 1.0) if correlation else 1.0
    return 2.0 * ((heavy(u) if correlation else 0.0) + 1.02 * ratio * error) + 1.0


def known_probability(name):
    """Of the heavy model, by Gauss-Hermite rules along three directions."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(80)
    weights = weights / weights.sum()
    b, c, e = np.meshgrid(nodes, nodes, nodes, indexing="ij")
    product = weights[:, None, None] * weights[:, None] * weights
    shift = 0.25 * np.sin(2.0 * b) * np.cos(c) + 0.2 * np.cos(2.0 * e)
    probability = float((product * ndtr(shift - THRESHOLD)).sum())
    if name == "a mode less":
        # The other mode's direction is independent of all the others.
        probability += (1.0 - probability) * float(ndtr(-OTHER_THRESHOLD))
    return probability


def function(rule):
    """An OpenTURNS function of a vectorised one."""
    return ot.PythonFunction(INPUTS, 1, func_sample=lambda x: rule(np.array(x))[:, None])


def estimate(task):
    """One estimate: runs, probability, claimed coefficient of variation, whether it is inside, converged, seconds."""
    name, with_cheap, seed = task
    ot.RandomGenerator.SetSeed(seed)
    vector = ot.CompositeRandomVector(function(lambda u: heavy_of(name, u)), ot.RandomVector(ot.Normal(INPUTS)))
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), THRESHOLD))
    if with_cheap:
        algorithm.setLowFidelity(function(lambda u: cheap_of(name, u)))
    start = time.perf_counter()
    algorithm.run()
    seconds, result, truth = time.perf_counter() - start, algorithm.getResult(), known_probability(name)
    interval = result.getConfidenceInterval(0.95)
    inside = interval.getLowerBound()[0] <= truth <= interval.getUpperBound()[0]
    probability = result.getProbabilityEstimate()
    claimed = result.getCoefficientOfVariation()
    return result.getEvaluationNumber(), probability / truth - 1.0, claimed, inside, result.getConverged(), seconds


def measured_correlation(name):
    """Of heavy and cheap."""
    u = np.random.default_rng(1).standard_normal((200_000, INPUTS))
    return float(np.corrcoef(heavy_of(name, u), cheap_of(name, u))[0, 1])


def main(arguments=None):
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("repetitions", type=int, nargs="?", default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args(arguments)
    print("$ python tests/benchmarks/two_models.py", *(sys.argv[1:] if arguments is None else arguments))
    print(f"satsep_ot {satsep_ot.__version__}, numpy {np.__version__}, openturns {ot.__version__}")
    columns = "runs: median  most  bias [%]  +-   error [%]  claimed  inside  conv.  s"
    print("cheap model    correlation  probability", columns, sep="  ")
    seeds = range(options.seed, options.seed + options.repetitions)
    with ProcessPoolExecutor(options.workers) as pool:
        # The first five pairs have the same heavy model.
        rows = [("0.999", False), *((name, True) for name in PAIRS), ("a mode less", False)]
        for name, with_cheap in rows:
            found = list(pool.map(estimate, [(name, with_cheap, seed) for seed in seeds]))
            columns = [np.array(column) for column in zip(*found, strict=True)]
            runs, errors, claimed, inside, converged, seconds = columns
            correlation = f"{measured_correlation(name):11.4f}" if with_cheap else 11 * " "
            label = name if with_cheap else ("none" if name != "a mode less" else "none, two modes")
            scatter = 100.0 * errors.std() / np.sqrt(len(errors))
            print(
                f"{label:15s}{correlation}  {known_probability(name):11.4e}  {np.median(runs):12.0f}{runs.max():6.0f}"
                f"{100.0 * errors.mean():10.2f}{scatter:5.2f}{100.0 * np.sqrt((errors**2).mean()):11.2f}"
                f"{100.0 * np.median(claimed):9.2f}{100.0 * inside.mean():8.1f}{100.0 * converged.mean():7.1f}"
                f"{np.median(seconds):5.1f}",
                flush=True,
            )


if __name__ == "__main__":
    main()
