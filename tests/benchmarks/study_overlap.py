"""Ten studies of the reference case: do the intervals of ActiveSubspace and Monte Carlo overlap, and at what cost?

    python tests/benchmarks/study_overlap.py [SEEDS]

Prints a line for each seed and requirement, then in how many studies every pair of intervals overlapped.
"""

import sys
from importlib import metadata

from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.separation_study import SeparationStudy


def main(seeds=10):
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "numba"))
    print(f"reference case, seeds 0 to {seeds - 1}, 500,000 Monte Carlo runs each; {versions}")
    print(f"{'seed':4s} {'requirement':16s} {'ActiveSubspace':>34s} {'runs':>5s} {'Monte Carlo':>34s}  overlap")
    good = largest = 0
    for seed in range(seeds):
        study = SeparationStudy(SeparationProblem("reference"), ["ActiveSubspace", "MonteCarlo"], seed)
        study.computeSample()
        study.compareMethods()
        rows = study.getRows()
        overlaps = []
        for ours, crude in zip(rows[::2], rows[1::2], strict=True):
            overlaps.append(ours["lower95"] <= crude["upper95"] and crude["lower95"] <= ours["upper95"])
            largest = max(largest, ours["evaluations"] + ours["gradients"])
            numbers = [
                f"{row['probability']:.3e} [{row['lower95']:.3e}, {row['upper95']:.3e}]" for row in (ours, crude)
            ]
            print(
                f"{seed:4d} {ours['requirement']:16s} {numbers[0]:>34s} {ours['evaluations']:5d} {numbers[1]:>34s}  "
                f"{'yes' if overlaps[-1] else 'NO'}{'' if ours['converged'] else '  not converged: ' + ours['note']}",
                flush=True,
            )
        good += all(overlaps)
    print(f"studies in which every pair overlaps: {good} of {seeds}; most runs of one requirement: {largest}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2]))
