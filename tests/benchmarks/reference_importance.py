"""Probabilities of the reference case by importance sampling: sharper than Monte Carlo, and held against it.

    python tests/benchmarks/reference_importance.py [RUNS] [SEED]

Points are drawn from a mixture of standard normal densities: one in ten around the origin, which bounds every weight
by 10, and the others around failed points of a first Monte Carlo sample, as many for each requirement. Of these points
only the part along the gradients of the smooth components is kept, so that the other inputs stay as they are.
"""

import sys
from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.openturns_adapter import callFunction
from satsep_ot.studies.method_benchmark import REFERENCE_RUNS, REFERENCE_VIOLATIONS

BLOCK = 100_000
FIRST = 100_000
NOMINAL = 0.1
CENTRES = 20


def violations(function, requirements, x):
    """Which runs violate each requirement, and any of them: (n, requirements + 1)."""
    values = function.evaluate(x)
    failed = [
        column > entry.limit if entry.is_maximum else column < entry.limit
        for entry, column in zip(requirements, values.T, strict=True)
    ]
    return np.column_stack([*failed, np.any(failed, axis=0)])


def centres(problem, space, function, requirements, generator):
    """Centres (k, d) of the mixture and their shares, of sum 1 - NOMINAL."""
    u = generator.standard_normal((FIRST, space.getDimension()))
    x = space.toPhysical(u)
    failed = violations(function, requirements, x)
    points, shares = [], []
    for place, entry in enumerate(requirements):
        components, _, smooth, _ = problem.getComponents(entry.name)
        values = callFunction(components, x[: FIRST // 10])[:, smooth]
        slopes = np.linalg.lstsq(u[: FIRST // 10], values - values.mean(axis=0))[0]
        basis = np.linalg.qr(slopes)[0]
        chosen = u[failed[:, place]][:CENTRES]
        points.append(chosen @ basis @ basis.T)
        shares.append(np.full(len(chosen), (1.0 - NOMINAL) / len(requirements) / len(chosen)))
    return np.concatenate(points), np.concatenate(shares)


def main(runs=1_000_000, seed=0):
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "numba"))
    print(f"reference case, {runs:,} runs of importance sampling, seed {seed}; {versions}", flush=True)
    generator = np.random.default_rng(seed)
    problem = SeparationProblem("reference")
    requirements = problem.getRequirements()
    function = SeparationFunction("reference", quantities=[entry.quantity for entry in requirements])
    space = StandardSpace(problem.getDistribution())
    means, shares = centres(problem, space, function, requirements, generator)
    means, shares = np.vstack([means, np.zeros(means.shape[1])]), np.append(shares, NOMINAL)
    names = [*(entry.name for entry in requirements), "any requirement"]
    sums, squares, largest = np.zeros(len(names)), np.zeros(len(names)), np.zeros(len(names))
    for done in range(0, runs, BLOCK):
        size = min(BLOCK, runs - done)
        u = means[generator.choice(len(shares), size=size, p=shares)] + generator.standard_normal(
            (size, means.shape[1])
        )
        # Density of the mixture over the standard normal one.
        ratio = np.exp(u @ means.T - 0.5 * (means**2).sum(axis=1)) @ shares
        terms = violations(function, requirements, space.toPhysical(u)) / ratio[:, None]
        sums += terms.sum(axis=0)
        squares += (terms**2).sum(axis=0)
        largest = np.maximum(largest, terms.max(axis=0))
    estimates = sums / runs
    deviations = np.sqrt((squares / runs - estimates**2) / runs)
    for name, estimate, deviation, top in zip(names, estimates, deviations, largest, strict=True):
        print(
            f"{name:16s} {estimate:.5e} +- {deviation:.1e} ({100 * deviation / estimate:.2f} %), largest share of a "
            f"run {100 * top / (runs * estimate):.3f} %"
        )
    for name, estimate, deviation in zip(names, estimates, deviations, strict=True):
        share = REFERENCE_VIOLATIONS[name] / REFERENCE_RUNS
        other = np.sqrt(share * (1.0 - share) / REFERENCE_RUNS)
        print(
            f"{name:16s} {share:.5e} +- {other:.1e} by Monte Carlo differs by "
            f"{(share - estimate) / np.hypot(deviation, other):+.2f} standard errors of the difference"
        )


if __name__ == "__main__":
    ot.RandomGenerator.SetSeed(0)
    main(*map(int, sys.argv[1:3]))
