"""
A benchmark study of one's own
==============================

Problems with known failure probability, several methods, several seeds: which method is right, and at what price? Two
problems in the manner of ``otbenchmark``; ``satsep-ot benchmark`` runs all of them with all methods.
"""

import numpy as np
import openturns as ot

from satsep_ot.methods.comparison.comparison import ReliabilityComparison
from satsep_ot.methods.comparison.methods import FORM, ActiveSubspace, SubsetSampling
from satsep_ot.methods.comparison.problems import getBenchmarkProblem

table = []
for name in ("P5", "RP8"):
    problem = getBenchmarkProblem(name)
    for method in (ActiveSubspace(0.1), SubsetSampling(levelSize=1000), FORM()):
        estimates, runs = [], []
        for seed in range(3):
            ot.RandomGenerator.SetSeed(seed)
            comparison = ReliabilityComparison(problem.getEvent(), [method])
            comparison.setComponents(*problem.getComponents())
            comparison.run()
            row = comparison.getResult().getRows()[0]
            if row.probability is not None:
                estimates.append(row.probability)
                runs.append(row.evaluations + row.gradients)
        error = np.sqrt(np.mean((np.array(estimates) / problem.getProbability() - 1.0) ** 2)) if estimates else np.inf
        table.append((name, method.name, problem.getProbability(), error, np.mean(runs) if runs else 0.0))

print("problem method          reference  error of 3 seeds    runs")
for name, method, reference, error, runs in table:
    print(f"{name:7} {method:15} {reference:.3e} {100.0 * error:15.1f} % {runs:7.0f}")
