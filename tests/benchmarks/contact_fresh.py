"""Contact on cases that no list holds, against `tests/contact_reference.py`, which shares nothing with the package.

    python tests/benchmarks/contact_fresh.py [--seed 0] [--cases 10]

Rings, masses, inertias, restitution, friction, points, late bolts and rails are drawn; every third platform is lighter
than the satellite, every second case has gravity. Errors of velocity and rates 20 ms after the last release (rails: at
it), over floors of 0.1 m/s and 0.1 rad/s, at the default tolerance and at 1e-12. The reference steps over kinks; what
it gives is good to some 1e-9, and less where rails rattle.
"""

import argparse
import platform
import sys
from importlib import metadata
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from contact_cases import CONTACT_CASES, contact_separation
from contact_reference import fresh_case, solve

from satsep_ot.dynamics.separation import Status
from satsep_ot.dynamics.simulation import simulate, trajectory

KINDS = ("deck", "deck", "bolt", "deck", "rails")


def errors(case, tolerances=(1e-8, 1e-12)):
    """Of one case at each tolerance, its status, and how many times its points have touched."""
    CONTACT_CASES["fresh"] = {"inputs": case}
    separation = contact_separation("fresh")
    outcome = simulate(separation)
    last = float(np.nanmax(outcome.release_times[0]))
    end = last if "rails" in case["contact"] else last + 0.02
    dv, w, _ = solve(case, end)
    found = []
    for tolerance in tolerances:
        state = trajectory(separation, [end], tolerance=tolerance).states[0]
        pairs = ((state[3:6], dv), (state[9:12], w))
        found.append(max(np.linalg.norm(a - b) / max(0.1, np.linalg.norm(b)) for a, b in pairs))
    return found, Status(outcome.status[0]), float(outcome.quantity("contact_force")[0])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=int, default=10)
    options = parser.parse_args()
    random = np.random.default_rng(options.seed)
    print(f"$ python tests/benchmarks/contact_fresh.py --seed {options.seed} --cases {options.cases}")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "scipy", "numba"))
    print(f"{versions}, Python {platform.python_version()}")
    print("case        satellite  platform [kg]  gravity  force [N]   error at 1e-8  at 1e-12  status")
    for i in range(options.cases):
        kind = KINDS[i % len(KINDS)]
        case = fresh_case(random, kind)
        found, status, force = errors(case)
        gravity = "yes" if case["gravity"] else "no"
        print(
            f"{i:2d} {kind:8s} {case['satellite']['mass']:9.1f} {case['platform']['mass']:10.1f}      "
            f"{gravity:6s} {force:9.1f}       {found[0]:9.1e} {found[1]:9.1e}  {status.name}",
            flush=True,
        )


if __name__ == "__main__":
    main()
