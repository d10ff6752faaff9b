"""Contact against the truth set: largest errors by kind of case, and what contact costs beside the same run without it.

    python tests/benchmarks/contact_agreement.py

Errors of velocity and rates at the end of each case, over floors of 0.1 m/s and 0.1 rad/s. Costs are processor times
of one thread, the least of five, over that of the case without its contacts.
"""

import platform
import sys
import time
from importlib import metadata
from pathlib import Path

import numba
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from contact_cases import CONTACT_CASES, contact_separation, free_separation

from satsep_ot.dynamics.simulation import simulate, trajectory

KINDS = ("deck", "bounce", "hold", "pin", "recess", "rails")


def error(state, truth):
    pairs = ((state[3:6], truth["dv_platform"]), (state[9:12], truth["w_sat"]))
    return max(np.linalg.norm(mine - expected) / max(0.1, np.linalg.norm(expected)) for mine, expected in pairs)


def seconds(separation, count):
    rows = np.repeat(separation.parameters()[None], count, axis=0)
    times = []
    for _ in range(5):
        begin = time.process_time()
        simulate(separation, rows)
        times.append((time.process_time() - begin) / count)
    return min(times)


def main():
    numba.set_num_threads(1)
    print("$ python tests/benchmarks/contact_agreement.py")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "numba"))
    print(f"{versions}, Python {platform.python_version()}")
    print("kind    cases  largest error at tolerance       cost over the run without contact")
    print("                 1e-8     1e-10     1e-13        least   median     most")
    for kind in KINDS:
        names = [name for name in CONTACT_CASES if name.startswith(kind)]
        errors, ratios = {}, []
        for tolerance in (1e-8, 1e-10, 1e-13):
            errors[tolerance] = max(
                error(
                    trajectory(contact_separation(name), [CONTACT_CASES[name]["t_end"]], tolerance=tolerance).states[0],
                    CONTACT_CASES[name]["results"]["at_t_end"],
                )
                for name in names
            )
        for name in names:
            free = free_separation(name)
            if free.springs.scale.any():
                ratios.append(seconds(contact_separation(name), 40) / seconds(free, 400))
        told = " ".join(f"{value:9.1e}" for value in errors.values())
        cost = f"{min(ratios):8.1f} {np.median(ratios):8.1f} {max(ratios):8.1f}" if ratios else ""
        print(f"{kind:8s}{len(names):5d} {told}     {cost}")


if __name__ == "__main__":
    main()
