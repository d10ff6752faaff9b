"""Print scatter and probabilities of the reference case by Monte Carlo (about a minute for a million runs).

python tests/benchmarks/reference_scatter.py [RUNS] [SEED]
"""

import platform
import sys
import time

import numpy as np
import openturns as ot

import satsep_ot
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

BLOCK = 100_000
# Further limits than those of the case, so that agreement is seen at two levels of probability.
FURTHER = (("lateral_rate", 2.0, True), ("axial_velocity", 0.592, False))


def main(runs, seed):
    """Sample block by block: nothing but the quantities is kept."""
    problem = SeparationProblem("reference")
    function, distribution = SeparationFunction("reference"), problem.getDistribution()
    labels = list(function.getOutputDescription())
    names = [label.split(" ")[0] for label in labels]
    nominal = simulate(problem.getCase().separation)
    ot.RandomGenerator.SetSeed(seed)
    start = time.perf_counter()
    blocks = [min(BLOCK, runs - done) for done in range(0, runs, BLOCK)]
    values = np.concatenate([function.evaluate(np.asarray(distribution.getSample(size))) for size in blocks])
    seconds = time.perf_counter() - start
    print(f"{runs:,} runs in {seconds:.0f} s\n")
    print(f"{'quantity':26}{'nominal':>14}{'mean':>14}{'deviation':>14}{'0.1 %':>14}{'99.9 %':>14}")
    for column, (name, label) in enumerate(zip(names, labels, strict=True)):
        low, high = np.quantile(values[:, column], [0.001, 0.999])
        numbers = (nominal.quantity(name)[0], values[:, column].mean(), values[:, column].std(ddof=1), low, high)
        print(f"{label:26}" + "".join(f"{number:14.6g}" for number in numbers))
    print(f"\n{'violation':26}{'failures':>10}{'probability':>14}{'95 % interval':>28}")
    limits = [(entry.quantity, entry.limit, entry.is_maximum) for entry in problem.getRequirements()]
    violated = np.zeros(runs, dtype=bool)
    for place, (name, limit, is_maximum) in enumerate((*limits, *FURTHER)):
        column = values[:, names.index(name)]
        beyond = column > limit if is_maximum else column < limit
        if place < len(limits):
            violated |= beyond
        print_probability(f"{name} {'>' if is_maximum else '<'} {limit:g}", int(beyond.sum()), runs)
    print_probability("any requirement", int(violated.sum()), runs)


def print_probability(name, failures, runs):
    """One line with the Clopper-Pearson interval."""
    lower, upper = clopperPearson(failures, runs)
    print(f"{name:26}{failures:10d}{failures / runs:14.4e}{lower:15.4e} .. {upper:.4e}")


if __name__ == "__main__":
    size = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    first = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    print(f"python tests/benchmarks/reference_scatter.py {size} {first}")
    versions = f"openturns {ot.__version__}, numpy {np.__version__}, Python {platform.python_version()}"
    print(f"satsep-ot {satsep_ot.__version__}, {versions}")
    main(size, first)
