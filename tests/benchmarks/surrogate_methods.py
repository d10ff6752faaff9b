"""Surrogates without correction, and active-learning Kriging, on published problems of known probability.

    python tests/benchmarks/surrogate_methods.py

Each method has its default settings, but the population of AK-MCS stops at 30 % and its runs at 150. For each problem
the estimates over the probability, by seed ("none": no probability was given), and the mean number of evaluations and
gradients. PaperChain takes the problem's own gradient if there is one, else differences.
"""

import os
import sys
from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.comparison.comparison import ReliabilityComparison
from satsep_ot.methods.comparison.methods import (
    AKMCS,
    ChaosMonteCarlo,
    InverseRegressionChaos,
    PaperChain,
)
from satsep_ot.methods.comparison.problems import getBenchmarkProblem

PROBLEMS = ("RP8", "RP14", "RP22", "RP38", "RP53", "RP107", "FourBranch", "P1", "P2", "P5")
METHODS = (
    PaperChain,
    ChaosMonteCarlo,
    InverseRegressionChaos,
    lambda: AKMCS(0.3, maximumEvaluations=150),
)
# AK-MCS is for few inputs; a Gaussian process of many learns little from 200 runs.
LARGEST_OF_KRIGING = 10
SEEDS = 3


def main():
    packages = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy"))
    print(
        f"{packages}, Python {sys.version.split()[0]}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; seeds 0-2"
    )
    print(f"{'problem':12}{'probability':>12}  method                   estimate / probability            runs")
    for name in PROBLEMS:
        problem = getBenchmarkProblem(name)
        for make in METHODS:
            method = make()
            if isinstance(method, AKMCS) and problem.getDistribution().getDimension() > LARGEST_OF_KRIGING:
                continue
            ratios, runs = [], []
            for seed in range(SEEDS):
                ot.RandomGenerator.SetSeed(seed)
                comparison = ReliabilityComparison(problem.getEvent(), [method])
                comparison.setMaximumEvaluations(None)
                comparison.run()
                (row,) = comparison.getResult().getRows()
                ratios.append(
                    "none" if row.probability is None else f"{row.probability / problem.getProbability():.3g}"
                )
                runs.append(row.evaluations + row.gradients)
            told = ", ".join(ratios)
            print(
                f"{name:12}{problem.getProbability():12.3e}  {method.name:24} {told:30}{np.mean(runs):8.0f}", flush=True
            )


if __name__ == "__main__":
    with singleThread():
        main()
