"""Repetitions of ActiveSubspaceReliability where the probability is known: runs, bias, real and claimed error.

    python tests/benchmarks/reliability_coverage.py [--problems P1 P2 ...] [--modes fast safe] [--repetitions 200]
        [--rows rows.jsonl]

A problem is one of those of `satsep-ot benchmark`; every run counts, those of learning too, and no gradient is used.
Seconds are those of the processor. Each repetition is added to the file of rows as soon as it is known; the same
command continues after an interruption.
"""

import argparse
import json
import time
from importlib import metadata
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.methods.reliability import ActiveSubspaceReliability
from satsep_ot.studies.method_benchmark import benchmark_tasks

# Runs that each problem may take; elsewhere the default of the algorithm.
LIMITS = {"P6": 20_000, "P7": 20_000}
WIDTHS, DIGITS = (8, 6, 8, 8, 6, 6, 6, 6, 6), (2, 2, 2, 2, 1, 1, 1, 1, 1)
PROBLEMS = ("P1", "P2", "P3", "P4", "P5", "P6", "P7")


def repeat(event, components, mode, limit, seed):
    """One repetition, as a row of numbers with their names."""
    start = time.process_time()
    ot.RandomGenerator.SetSeed(seed)
    algorithm = ActiveSubspaceReliability(event)
    if components is not None:
        algorithm.setComponents(*components)
    algorithm.setMode(mode)
    algorithm.setMaximumEvaluations(limit)
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


def repetitions(task, mode, seeds, path):
    """The rows of all seeds: those in the file, and new ones, which are added to it."""
    known = {}
    if path.exists():
        for row in map(json.loads, path.read_text().splitlines()):
            if (row["problem"], row["mode"]) == (task.name, mode):
                known[row["seed"]] = row
    for seed in seeds:
        if seed not in known:
            row = repeat(task.event, task.components, mode, LIMITS.get(task.name, 5000), seed)
            known[seed] = {"problem": task.name, "mode": mode, "seed": seed} | row
            with path.open("a") as file:
                file.write(json.dumps(known[seed]) + "\n")
    return [known[seed] for seed in seeds]


def summary(name, mode, truth, rows):
    """One line of the table."""
    columns = {
        key: np.array([row[key] for row in rows], dtype=float) for key in rows[0] if key not in ("problem", "mode")
    }
    ratio = columns["estimate"] / truth
    below, above = truth < columns["lower"], truth > columns["upper"]
    known = columns["claimed"][np.isfinite(columns["claimed"])]
    squared = (known**2).mean() if len(known) else np.inf
    values = (
        100 * (ratio.mean() - 1),
        100 * ratio.std(ddof=1) / np.sqrt(len(rows)) if len(rows) > 1 else np.nan,
        100 * np.sqrt(((ratio - 1) ** 2).mean()),
        100 * np.sqrt(squared),
        100 * (~below & ~above).mean(),
        100 * below.mean(),
        100 * above.mean(),
        100 * columns["converged"].mean(),
        100 * columns["handed"].mean(),
    )
    numbers = " ".join(
        f"{value:{width}.{digits}f}" for value, width, digits in zip(values, WIDTHS, DIGITS, strict=True)
    )
    return (
        f"{name:25s} {mode:4s} {len(rows):4d} {truth:10.3e} {columns['runs'].mean():7.0f} {columns['runs'].max():7.0f} "
        f"{numbers} {columns['seconds'].mean():7.2f}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--problems", nargs="+", default=PROBLEMS)
    parser.add_argument("--modes", nargs="+", default=["fast"], choices=["fast", "safe"])
    parser.add_argument("--repetitions", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0, help="of the first repetition; the others follow")
    parser.add_argument("--rows", type=Path, default=Path("reliability_coverage.jsonl"), help="file of the repetitions")
    options = parser.parse_args()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "scipy"))
    print(f"seeds from {options.seed}; {versions}")
    print(
        f"{'':25s} {'':4s} {'':4s} {'':>10s} {'mean':>7s} {'most':>7s} {'bias':>8s} {'+-':>6s} {'error':>8s} "
        f"{'claimed':>8s} {'inside':>6s} {'below':>6s} {'above':>6s} {'conv.':>6s} {'handed':>6s} {'seconds':>7s}"
    )
    print(
        f"{'problem':25s} {'mode':4s} {'reps':4s} {'truth':>10s} {'runs':>7s} {'runs':>7s} {'[%]':>8s} {'[%]':>6s} "
        f"{'[%]':>8s} {'[%]':>8s} {'[%]':>6s} {'[%]':>6s} {'[%]':>6s} {'[%]':>6s} {'[%]':>6s} {'each':>7s}"
    )
    for name in options.problems:
        (task,) = benchmark_tasks([name])
        for mode in options.modes:
            seeds = range(options.seed, options.seed + options.repetitions)
            rows = repetitions(task, mode, seeds, options.rows)
            print(summary(name, mode, task.probability, rows), flush=True)


if __name__ == "__main__":
    main()
