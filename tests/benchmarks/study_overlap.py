"""Ten studies of the reference case: do the intervals of ActiveSubspace and Monte Carlo overlap, and hold the truth?

    python tests/benchmarks/study_overlap.py [SEEDS]
    python tests/benchmarks/study_overlap.py tests/benchmarks/study_overlap.txt

Prints a line for each seed and requirement, then in how many studies every pair of intervals overlapped, how many
intervals hold the probability that is known (satsep_ot.studies.method_benchmark.reference_probability), and how far the
estimates are off in units of the error that they claim. With a file in place of a number, no study is made: the numbers
are read from what was printed before.
"""

import math
import re
import sys
from importlib import metadata
from pathlib import Path

from scipy import stats

from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.method_benchmark import reference_probability
from satsep_ot.studies.separation_study import SeparationStudy

METHODS = ("ActiveSubspace", "MonteCarlo")
INTERVAL = r"(\S+) \[(\S+), (\S+)\]"


def print_truth(estimates):
    """Judge {(seed, requirement): (estimate, lower, upper) of ActiveSubspace, the same of MonteCarlo}."""
    for requirement in dict.fromkeys(requirement for _, requirement in estimates):
        truth, deviation = reference_probability(requirement)
        print(f"truth of {requirement:16s} {truth:.5e} +- {deviation:.1e} ({100 * deviation / truth:.2f} %)")
    for place, method in enumerate(METHODS):
        misses, scores = [], []
        for (seed, requirement), rows in estimates.items():
            truth, deviation = reference_probability(requirement)
            estimate, lower, upper = rows[place]
            # A 95 % interval is 3.92 standard errors wide; of a probability, on the logarithmic scale.
            scores.append(math.log(estimate / truth) / (math.log(upper / lower) / 3.92))
            beyond = max(lower - truth, truth - upper)
            if beyond > 0.0:
                side = "below" if truth < lower else "above"
                misses.append(
                    f"  seed {seed}, {requirement}: it lies {side}, by {beyond / deviation:.2g} deviations; the "
                    f"estimate is {100 * (estimate / truth - 1):+.1f} % off, {abs(scores[-1]):.2f} claimed errors"
                )
        inside = len(estimates) - len(misses)
        chance = stats.binom.cdf(inside, len(estimates), 0.95)
        print(
            f"{method}: {inside} of {len(estimates)} intervals hold the truth; as few of independent ones that each do "
            f"so in 95 %: probability {chance:.2f}"
        )
        print("".join(f"{line}\n" for line in misses), end="")
        sizes = sorted(map(abs, scores), reverse=True)
        print(
            f"  in units of the claimed errors, all {len(scores)}: largest {', '.join(f'{z:.2f}' for z in sizes[:3])}; "
            f"mean square {sum(z * z for z in scores) / len(scores):.2f}"
        )


def stored_estimates(path):
    """What `print_truth` takes, from what a former run printed."""
    found = re.findall(rf"^ *(\d+) (\S.*?) +{INTERVAL} +\d+ +{INTERVAL}", Path(path).read_text(), re.MULTILINE)
    return {
        (int(seed), name): (tuple(map(float, numbers[:3])), tuple(map(float, numbers[3:])))
        for seed, name, *numbers in found
    }


def main(seeds=10):
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "numba"))
    print(f"reference case, seeds 0 to {seeds - 1}, 500,000 Monte Carlo runs each; {versions}")
    print(f"{'seed':4s} {'requirement':16s} {'ActiveSubspace':>40s} {'runs':>5s} {'Monte Carlo':>40s}  overlap")
    good = largest = 0
    estimates = {}
    for seed in range(seeds):
        study = SeparationStudy(SeparationProblem("reference"), list(METHODS), seed)
        study.computeSample()
        study.compareMethods()
        rows = study.getRows()
        overlaps = []
        for ours, crude in zip(rows[::2], rows[1::2], strict=True):
            estimates[seed, ours["requirement"]] = tuple(
                (row["probability"], row["lower95"], row["upper95"]) for row in (ours, crude)
            )
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
    print_truth(estimates)


if __name__ == "__main__":
    if sys.argv[1:] and not sys.argv[1].isdigit():
        print_truth(stored_estimates(sys.argv[1]))
    else:
        main(*map(int, sys.argv[1:2]))
