"""Probabilities of the reference case by Monte Carlo: the truth that reliability methods are held against.

    python tests/benchmarks/reference_truth.py [RUNS] [SEED]

Each block of runs has its own seed, SEED + block, and its counts are printed as they come.
"""

import sys
from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

BLOCK = 250_000


def main(runs=10_000_000, seed=0):
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "numba"))
    print(f"reference case, {runs:,} runs in blocks of {BLOCK:,}, seeds from {seed}; {versions}", flush=True)
    problem = SeparationProblem("reference")
    requirements = problem.getRequirements()
    function = SeparationFunction("reference", quantities=[entry.quantity for entry in requirements])
    distribution = problem.getDistribution()
    counts = dict.fromkeys([*(entry.name for entry in requirements), "any requirement"], 0)
    done = 0
    for block in range(-(-runs // BLOCK)):
        ot.RandomGenerator.SetSeed(seed + block)
        size = min(BLOCK, runs - done)
        values = function.evaluate(np.asarray(distribution.getSample(size)))
        violated = [
            column > entry.limit if entry.is_maximum else column < entry.limit
            for entry, column in zip(requirements, values.T, strict=True)
        ]
        for name, failed in zip(counts, [*violated, np.any(violated, axis=0)], strict=True):
            counts[name] += int(np.count_nonzero(failed))
        done += size
        print(f"{done:11,} {counts}", flush=True)
    for name, count in counts.items():
        lower, upper = clopperPearson(count, runs)
        print(f"{name:16s} {count:7d} of {runs:,}: {count / runs:.5e} [{lower:.5e}, {upper:.5e}] (95 %)")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
