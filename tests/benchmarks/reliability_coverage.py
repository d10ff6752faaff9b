"""Repetitions of ActiveSubspaceReliability where the probability is known: runs, bias, real and claimed error.

    python tests/benchmarks/reliability_coverage.py [--problems P1 P2 ...] [--modes fast safe] [--repetitions 200]

A problem is one of those of `satsep-ot benchmark`; every run counts, those of learning too, and no gradient is used.
"""

import argparse
import time
from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot.methods.reliability import ActiveSubspaceReliability
from satsep_ot.studies.method_benchmark import benchmark_tasks

# Runs that each problem may take; elsewhere the default of the algorithm.
LIMITS = {"P6": 20_000, "P7": 20_000}
PROBLEMS = ("P1", "P2", "P3", "P4", "P5", "P6", "P7")


def repeat(event, components, mode, limit, seed):
    """One repetition: estimate, interval, coefficient of variation, runs, whether it converged, method."""
    ot.RandomGenerator.SetSeed(seed)
    algorithm = ActiveSubspaceReliability(event)
    if components is not None:
        algorithm.setComponents(*components)
    algorithm.setMode(mode)
    algorithm.setMaximumEvaluations(limit)
    algorithm.run()
    result = algorithm.getResult()
    interval = result.getConfidenceInterval(0.95)
    return (
        result.getProbabilityEstimate(),
        interval.getLowerBound()[0],
        interval.getUpperBound()[0],
        result.getCoefficientOfVariation(),
        result.getEvaluationNumber(),
        result.getConverged(),
        result.getMethod() == "ActiveSubspace",
    )


def summary(name, mode, truth, rows, seconds):
    """One line of the table."""
    columns = [np.array(column, dtype=float) for column in zip(*rows, strict=True)]
    estimate, lower, upper, claimed, runs, converged, own = columns
    ratio = estimate / truth
    covered = (lower <= truth) & (truth <= upper)
    known = claimed[np.isfinite(claimed)]
    squared = (known**2).mean() if len(known) else np.inf
    return (
        f"{name:25s} {mode:4s} {truth:10.3e} {runs.mean():7.0f} {runs.max():7.0f} {100 * (ratio.mean() - 1):+8.2f} "
        f"{100 * ratio.std(ddof=1) / np.sqrt(len(rows)):6.2f} "
        f"{100 * np.sqrt(((ratio - 1) ** 2).mean()):8.2f} {100 * np.sqrt(squared):8.2f} "
        f"{100 * covered.mean():6.1f} {100 * (truth < lower).mean():6.1f} {100 * (truth > upper).mean():6.1f} "
        f"{100 * converged.mean():6.1f} {100 * (1 - own.mean()):6.1f} {seconds / len(rows):7.2f}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", default=PROBLEMS)
    parser.add_argument("--modes", nargs="+", default=["fast"], choices=["fast", "safe"])
    parser.add_argument("--repetitions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the first repetition; the others follow")
    options = parser.parse_args()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "scipy"))
    print(f"{options.repetitions} repetitions, seeds from {options.seed}; {versions}")
    print(
        f"{'':25s} {'':4s} {'':>10s} {'mean':>7s} {'most':>7s} {'bias':>8s} {'+-':>6s} {'error':>8s} {'claimed':>8s} "
        f"{'inside':>6s} {'below':>6s} {'above':>6s} {'conv.':>6s} {'handed':>6s} {'seconds':>7s}"
    )
    print(
        f"{'problem':25s} {'mode':4s} {'truth':>10s} {'runs':>7s} {'runs':>7s} {'[%]':>8s} {'[%]':>6s} {'[%]':>8s} "
        f"{'[%]':>8s} {'[%]':>6s} {'[%]':>6s} {'[%]':>6s} {'[%]':>6s} {'[%]':>6s} {'each':>7s}"
    )
    for name in options.problems:
        (task,) = benchmark_tasks([name])
        for mode in options.modes:
            start = time.perf_counter()
            seeds = range(options.seed, options.seed + options.repetitions)
            rows = [repeat(task.event, task.components, mode, LIMITS.get(name, 5000), seed) for seed in seeds]
            print(summary(name, mode, task.probability, rows, time.perf_counter() - start), flush=True)


if __name__ == "__main__":
    main()
