"""ActiveSubspaceReliability through contact, where quantities have kinks: repetitions against a large Monte Carlo.

    python tests/benchmarks/contact_reliability.py [--repetitions 100] [--runs 200000] [--rows FILE]

Two cases: a satellite whose ring is pressed into the deck since one of three springs has failed
(`tests/data/one_of_three_failed.toml`), and the 3U dispenser of the gallery, whose rails rattle. The estimator is that
of a study: the components of the problem, otherwise its defaults. "inside" is the share of all repetitions whose 95 %
interval holds the Monte Carlo probability, widened by two of its own standard errors; "honest" adds those that say that
they have not converged. Every repetition is kept in the file of rows at once; the same command continues.
"""

import argparse
import json
import time
from importlib import metadata
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

FAILED = Path(__file__).resolve().parents[1] / "data" / "one_of_three_failed.toml"
CASES = {"one_of_three_failed": FAILED, "deployer_3u": "deployer_3u"}
BLOCK = 10_000  # runs of the Monte Carlo at a time
FIT_BLOCKS = 200  # of points at which the fit is evaluated


def quadratic_terms(U):
    pairs = np.triu_indices(U.shape[1])
    return np.concatenate([np.ones((len(U), 1)), U, U[:, pairs[0]] * U[:, pairs[1]]], axis=1)


def monte_carlo(case, runs, seed=1):
    """Probability of each requirement by Monte Carlo, and its standard error.

    A quadratic fit to the first block is a control variate: its own probability is known from many points, and true
    runs say by how much the true one differs.
    """
    problem = SeparationProblem(case)
    distribution, requirements = problem.getDistribution(), problem.getRequirements()
    transformation = distribution.getIsoProbabilisticTransformation()
    function = SeparationFunction(case, quantities=[entry.quantity for entry in requirements], countsEndings=True)
    ot.RandomGenerator.SetSeed(seed)

    def violate(Y):
        pairs = zip(requirements, Y.T, strict=True)
        return np.stack([y > e.limit if e.is_maximum else y < e.limit for e, y in pairs], axis=1).astype(float)

    fit, differences = None, []
    for _ in range(runs // BLOCK):
        X = distribution.getSample(BLOCK)
        Y, terms = function.evaluate(X), quadratic_terms(np.array(transformation(X)))
        if fit is None:
            fit = np.linalg.lstsq(terms, Y, rcond=None)[0]
        differences.append(violate(Y) - violate(terms @ fit))
    random = np.random.default_rng(seed)
    blocks = [
        violate(quadratic_terms(random.standard_normal((BLOCK, distribution.getDimension()))) @ fit)
        for _ in range(FIT_BLOCKS)
    ]
    known, difference = np.concatenate(blocks), np.concatenate(differences)
    P = known.mean(axis=0) + difference.mean(axis=0)
    error = np.sqrt(known.var(axis=0) / len(known) + difference.var(axis=0) / len(difference))
    return {entry.name: (float(p), float(e)) for entry, p, e in zip(requirements, P, error, strict=True)}


def repeat(case, requirement, seed):
    """One repetition, as a row of numbers with their names."""
    start = time.process_time()
    problem = SeparationProblem(case)
    ot.RandomGenerator.SetSeed(seed)
    algorithm = ActiveSubspaceReliability(problem.getEvent(requirement))
    algorithm.setComponents(*problem.getComponents(requirement))
    algorithm.run()
    result = algorithm.getResult()
    interval = result.getConfidenceInterval(0.95)
    return {
        "estimate": result.getProbabilityEstimate(),
        "lower": interval.getLowerBound()[0],
        "upper": interval.getUpperBound()[0],
        "runs": result.getEvaluationNumber(),
        "converged": result.getConverged(),
        "method": result.getMethod(),
        "seconds": time.process_time() - start,
    }


def summary(name, requirement, truth, error, rows):
    """One line of the table."""
    lower, upper, estimate = (np.array([row[key] for row in rows]) for key in ("lower", "upper", "estimate"))
    converged = np.array([row["converged"] for row in rows])
    inside = (lower <= truth + 2.0 * error) & (truth - 2.0 * error <= upper)
    return (
        f"{name:20s} {requirement:14s} {len(rows):4d} {truth:10.3e} {100 * error / truth:6.2f} "
        f"{np.mean([row['runs'] for row in rows]):7.0f} {100 * (estimate.mean() / truth - 1):8.2f} "
        f"{100 * inside.mean():6.1f} {100 * converged.mean():6.1f} {100 * (inside | ~converged).mean():6.1f} "
        f"{np.mean([row['seconds'] for row in rows]):7.2f}"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repetitions", type=int, default=100)
    parser.add_argument("--runs", type=int, default=200_000, help="of the Monte Carlo")
    parser.add_argument("--cases", nargs="+", default=list(CASES))
    parser.add_argument("--rows", type=Path, default=Path("contact_reliability.jsonl"), help="file of the repetitions")
    options = parser.parse_args()
    known = {}
    if options.rows.exists():
        for row in map(json.loads, options.rows.read_text().splitlines()):
            known[row["case"], row["requirement"], row["seed"]] = row

    def keep(row):
        known[row["case"], row["requirement"], row["seed"]] = row
        with options.rows.open("a") as file:
            file.write(json.dumps(row) + "\n")

    print(f"$ python tests/benchmarks/contact_reliability.py --repetitions {options.repetitions} --runs {options.runs}")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "scipy"))
    print(f"seeds from 0, of the Monte Carlo 1; {versions}")
    print("case                 requirement    reps      truth  +-[%] mean runs bias[%] inside  conv. honest seconds")
    for name in options.cases:
        case = CASES[name]
        key = f"Monte Carlo of {options.runs}"
        if (name, key, 1) not in known:
            keep({"case": name, "requirement": key, "seed": 1, "truth": monte_carlo(case, options.runs)})
        for requirement, (truth, error) in known[name, key, 1]["truth"].items():
            for seed in range(options.repetitions):
                if (name, requirement, seed) not in known:
                    keep({"case": name, "requirement": requirement, "seed": seed} | repeat(case, requirement, seed))
            rows = [known[name, requirement, seed] for seed in range(options.repetitions)]
            print(summary(name, requirement, truth, error, rows), flush=True)


if __name__ == "__main__":
    main()
