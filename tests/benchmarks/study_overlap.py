"""Ten studies of the reference case: do the intervals of ActiveSubspace and Monte Carlo overlap, and hold the truth?

    python tests/benchmarks/study_overlap.py [SEEDS]
    python tests/benchmarks/study_overlap.py tests/benchmarks/study_overlap.txt

Prints a line for each seed and requirement, then in how many studies every pair of intervals overlapped, and how many
intervals hold the probability that is known (satsep_ot.studies.method_benchmark.reference_probability). With a file in
place of a number, no study is made: the intervals are read from what was printed before.
"""

import re
import sys
from importlib import metadata
from pathlib import Path

from scipy import stats

from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.method_benchmark import reference_probability
from satsep_ot.studies.separation_study import SeparationStudy

METHODS = ("ActiveSubspace", "MonteCarlo")
INTERVAL = r"\S+ \[(\S+), (\S+)\]"


def print_truth(intervals):
    """Count and name the intervals: {(seed, requirement): (lower and upper of ActiveSubspace, of MonteCarlo)}."""
    for requirement in dict.fromkeys(requirement for _, requirement in intervals):
        truth, deviation = reference_probability(requirement)
        print(f"truth of {requirement:16s} {truth:.5e} +- {deviation:.1e} ({100 * deviation / truth:.2f} %)")
    for place, method in enumerate(METHODS):
        misses = []
        for (seed, requirement), pair in intervals.items():
            truth, deviation = reference_probability(requirement)
            beyond = max(pair[place][0] - truth, truth - pair[place][1])
            if beyond > 0.0:
                side = "below" if truth < pair[place][0] else "above"
                misses.append(f"  seed {seed}, {requirement}: it lies {side}, by {beyond / deviation:.2g} deviations")
        inside = len(intervals) - len(misses)
        chance = stats.binom.cdf(inside, len(intervals), 0.95)
        print(
            f"{method}: {inside} of {len(intervals)} intervals hold the truth; as few of independent ones that each do "
            f"so in 95 %: probability {chance:.2f}"
        )
        print("".join(f"{line}\n" for line in misses), end="")


def stored_intervals(path):
    """What `print_truth` takes, from what a former run printed."""
    found = re.findall(rf"^ *(\d+) (\S.*?) +{INTERVAL} +\d+ +{INTERVAL}", Path(path).read_text(), re.MULTILINE)
    return {(int(seed), name): ((float(a), float(b)), (float(c), float(d))) for seed, name, a, b, c, d in found}


def main(seeds=10):
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "numba"))
    print(f"reference case, seeds 0 to {seeds - 1}, 500,000 Monte Carlo runs each; {versions}")
    print(f"{'seed':4s} {'requirement':16s} {'ActiveSubspace':>40s} {'runs':>5s} {'Monte Carlo':>40s}  overlap")
    good = largest = 0
    intervals = {}
    for seed in range(seeds):
        study = SeparationStudy(SeparationProblem("reference"), list(METHODS), seed)
        study.computeSample()
        study.compareMethods()
        rows = study.getRows()
        overlaps = []
        for ours, crude in zip(rows[::2], rows[1::2], strict=True):
            intervals[seed, ours["requirement"]] = tuple((row["lower95"], row["upper95"]) for row in (ours, crude))
            overlaps.append(ours["lower95"] <= crude["upper95"] and crude["lower95"] <= ours["upper95"])
            largest = max(largest, ours["evaluations"] + ours["gradients"])
            numbers = [
                f"{row['probability']:.5e} [{row['lower95']:.5e}, {row['upper95']:.5e}]" for row in (ours, crude)
            ]
            print(
                f"{seed:4d} {ours['requirement']:16s} {numbers[0]:>40s} {ours['evaluations']:5d} {numbers[1]:>40s}  "
                f"{'yes' if overlaps[-1] else 'NO'}{'' if ours['converged'] else '  not converged: ' + ours['note']}",
                flush=True,
            )
        good += all(overlaps)
    print(f"studies in which every pair overlaps: {good} of {seeds}; most runs of one requirement: {largest}")
    print_truth(intervals)


if __name__ == "__main__":
    if sys.argv[1:] and not sys.argv[1].isdigit():
        print_truth(stored_intervals(sys.argv[1]))
    else:
        main(*map(int, sys.argv[1:2]))
