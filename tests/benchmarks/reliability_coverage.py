"""Repetitions of ActiveSubspaceReliability where the probability is known: runs, bias, real and claimed error.

    python tests/benchmarks/reliability_coverage.py [--problems P1 P2 ...] [--modes fast safe] [--repetitions 200]
        [--target 0.05] [--rows rows.jsonl]

A problem is one of those of `satsep-ot benchmark`; every run counts, those of learning too, and no gradient is used.
Seconds are those of the processor. Each repetition is added to the file of rows as soon as it is known; the same
command continues after an interruption. The second column of the truth is its own error.
"""

import argparse
import json
import math
import time
from importlib import metadata
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.studies.method_benchmark import benchmark_tasks

# Runs that each problem may take at 0.05 and above; elsewhere the default of the algorithm.
LIMITS = {"P6": 20_000, "P7": 20_000}
# Head, second line of the head, width and format of each number.
COLUMNS = (
    ("", "reps", 4, "d"),
    ("", "truth", 10, ".3e"),
    ("+-", "[%]", 6, ".2f"),
    ("mean", "runs", 7, ".0f"),
    ("most", "runs", 7, ".0f"),
    ("bias", "[%]", 8, ".2f"),
    ("+-", "[%]", 6, ".2f"),
    ("error", "[%]", 8, ".2f"),
    ("claimed", "[%]", 8, ".2f"),
    ("inside", "[%]", 6, ".1f"),
    ("below", "[%]", 6, ".1f"),
    ("above", "[%]", 6, ".1f"),
    ("conv.", "[%]", 6, ".1f"),
    ("handed", "[%]", 6, ".1f"),
    ("seconds", "each", 7, ".2f"),
)
PROBLEMS = ("P1", "P2", "P3", "P4", "P5", "P6", "P7")


def repeat(event, components, mode, target, limit, seed):
    """One repetition, as a row of numbers with their names."""
    start = time.process_time()
    ot.RandomGenerator.SetSeed(seed)
    algorithm = ActiveSubspaceReliability(event)
    if components is not None:
        algorithm.setComponents(*components)
    algorithm.setMode(mode)
    algorithm.setTargetCoefficientOfVariation(target)
    algorithm.setMaximumEvaluations(math.ceil(limit * max(1.0, (0.05 / target) ** 2)))
    algorithm.run()
    result = algorithm.getResult()
    interval = result.getConfidenceInterval(0.95)
    return {
        "estimate": result.getProbabilityEstimate(),
        "lower": interval.getLowerBound()[0],
        "upper": interval.getUpperBound()[0],
        "claimed": result.getCoefficientOfVariation(),
        "runs": result.getEvaluationNumber(),
        "converged": result.getConverged(),
        "handed": result.getMethod() != "ActiveSubspace",
        "seconds": time.process_time() - start,
    }


def repetitions(task, mode, target, seeds, path):
    """The rows of all seeds: those in the file, and new ones, which are added to it."""
    known = {}
    if path.exists():
        for row in map(json.loads, path.read_text().splitlines()):
            if (row["problem"], row["mode"], row["target"]) == (task.name, mode, target):
                known[row["seed"]] = row
    for seed in seeds:
        if seed not in known:
            row = repeat(task.event, task.components, mode, target, LIMITS.get(task.name, 5000), seed)
            known[seed] = {"problem": task.name, "mode": mode, "target": target, "seed": seed} | row
            with path.open("a") as file:
                file.write(json.dumps(known[seed]) + "\n")
    return [known[seed] for seed in seeds]


def summary(task, mode, rows):
    """One line of the table."""
    columns = {
        key: np.array([row[key] for row in rows], dtype=float) for key in rows[0] if key not in ("problem", "mode")
    }
    truth = task.probability
    ratio = columns["estimate"] / truth
    below, above = truth < columns["lower"], truth > columns["upper"]
    known = columns["claimed"][np.isfinite(columns["claimed"])]
    squared = (known**2).mean() if len(known) else np.inf
    values = (
        len(rows),
        truth,
        100 * task.probabilityError,
        columns["runs"].mean(),
        columns["runs"].max(),
        100 * (ratio.mean() - 1),
        100 * ratio.std(ddof=1) / np.sqrt(len(rows)) if len(rows) > 1 else np.nan,
        100 * np.sqrt(((ratio - 1) ** 2).mean()),
        100 * np.sqrt(squared),
        100 * (~below & ~above).mean(),
        100 * below.mean(),
        100 * above.mean(),
        100 * columns["converged"].mean(),
        100 * columns["handed"].mean(),
        columns["seconds"].mean(),
    )
    numbers = (f"{value:{width}{form}}" for value, (*_, width, form) in zip(values, COLUMNS, strict=True))
    return " ".join([f"{task.name:25s} {mode:4s}", *numbers])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", default=PROBLEMS)
    parser.add_argument("--modes", nargs="+", default=["fast"], choices=["fast", "safe"])
    parser.add_argument("--repetitions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the first repetition; the others follow")
    parser.add_argument("--target", type=float, default=0.05, help="coefficient of variation at which each ends")
    parser.add_argument("--rows", type=Path, default=Path("reliability_coverage.jsonl"), help="file of the repetitions")
    options = parser.parse_args()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "scipy"))
    print(f"seeds from {options.seed}; {versions}")
    for head, *names in (("", *(column[0] for column in COLUMNS)), ("problem", *(column[1] for column in COLUMNS))):
        print(f"{head:30s}", *(f"{name:>{width}s}" for name, (*_, width, _) in zip(names, COLUMNS, strict=True)))
    for name in options.problems:
        (task,) = benchmark_tasks([name])
        for mode in options.modes:
            seeds = range(options.seed, options.seed + options.repetitions)
            rows = repetitions(task, mode, options.target, seeds, options.rows)
            print(summary(task, mode, rows), flush=True)


if __name__ == "__main__":
    main()
