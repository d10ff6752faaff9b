"""Runs, errors and coverage of ActiveSubspaceReliability on problems of known probability, beside their prices.

    python tests/benchmarks/published_problems.py [--seeds 20] [--target 0.05] [--names RP38 Leaf] [--evaluations 5000]

One row for each problem: median runs with their range, root mean square error and median claimed error of converged
runs, the share of 95 % intervals that hold the truth, confidently wrong runs (converged, and the truth outside of the
99.9 % interval), and process time. Problems of the separation have components, as a study gives them.
"""

import argparse
import math
import time
from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot import ActiveSubspaceReliability
from satsep_ot.methods.comparison.problems import getBenchmarkProblem, getBenchmarkProblemNames


def estimate(problem, seed, target, evaluations):
    """One run: result and process time."""
    ot.RandomGenerator.SetSeed(seed)
    algorithm = ActiveSubspaceReliability(problem.getEvent())
    if problem.getComponents()[0].getOutputDimension() > 1:
        algorithm.setComponents(*problem.getComponents())
    algorithm.setTargetCoefficientOfVariation(target)
    algorithm.setMaximumEvaluations(evaluations)
    start = time.process_time()
    algorithm.run()
    return algorithm.getResult(), time.process_time() - start


def describe(problem, outcomes):
    """The row of a problem."""
    truth = problem.getProbability()
    dimension = problem.getEvent().getAntecedent().getDistribution().getDimension()
    results = [result for result, _ in outcomes]
    converged = [result for result in results if result.getConverged()]
    runs = [result.getEvaluationNumber() for result in results]
    errors = [result.getProbabilityEstimate() / truth - 1.0 for result in converged]
    inside = {level: [_holds(result, level, truth) for result in converged] for level in (0.95, 0.999)}
    methods = ", ".join(sorted({result.getMethod() for result in results}))
    return (
        f"{problem.getName():23s} {dimension:4d} {truth:10.3e}"
        f" {np.median(runs):6.0f} {min(runs):5d} to {max(runs):5d}"
        f" {100.0 * math.sqrt(np.mean(np.square(errors))) if errors else math.nan:6.1f}"
        f" {100.0 * np.median([r.getCoefficientOfVariation() for r in converged]) if converged else math.nan:6.1f}"
        f" {sum(inside[0.95]):3d} of {len(converged):3d} of {len(results):3d} {len(converged) - sum(inside[0.999]):3d}"
        f" {np.median([seconds for _, seconds in outcomes]):6.2f}  {methods}"
    )


def _holds(result, level, truth):
    interval = result.getConfidenceInterval(level)
    return interval.getLowerBound()[0] <= truth <= interval.getUpperBound()[0]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=20, help="number of seeds, from 0 on")
    parser.add_argument("--target", type=float, default=0.05, help="coefficient of variation")
    parser.add_argument("--evaluations", type=int, default=5000, help="largest number of runs")
    parser.add_argument("--names", nargs="*", help="problems, by default all")
    options = parser.parse_args()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("openturns", "numpy", "scipy", "satsep_ot"))
    print(f"target {options.target}, seeds 0 to {options.seeds - 1}, at most {options.evaluations} runs; {versions}")
    print(
        "problem                    d      truth   runs from to        real claimed  95 % of conv. wrong seconds method"
    )
    for name in options.names or getBenchmarkProblemNames():
        problem = getBenchmarkProblem(name)
        outcomes = [estimate(problem, seed, options.target, options.evaluations) for seed in range(options.seeds)]
        print(describe(problem, outcomes), flush=True)


if __name__ == "__main__":
    main()
