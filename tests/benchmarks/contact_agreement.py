"""Contact against the truth set: largest errors by kind of case, and what contact costs beside the same run without it.

    python tests/benchmarks/contact_agreement.py

Errors of velocity and rates at the end of each case, over floors of 0.1 m/s and 0.1 rad/s. Costs are those of the case
over those of the same case without its contacts, in evaluations of the right-hand side and in processor time of one
thread, the least of five. Cases that end stuck are a kind of their own ("hang-up").
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

KINDS = ("deck", "bounce", "hold", "pin", "recess", "rails", "hang-up")


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


def kind_of(name):
    return "hang-up" if CONTACT_CASES[name]["results"]["status"] == "stuck" else name.split("_")[0]


def main():
    numba.set_num_threads(1)
    print("$ python tests/benchmarks/contact_agreement.py")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("numpy", "numba"))
    print(f"{versions}, Python {platform.python_version()}")
    print("kind    cases  largest error at tolerance    evaluations  over those without   time over that without")
    print("                 1e-8     1e-10     1e-13    with  without   median    most       median    most")
    for kind in KINDS:
        names = [name for name in CONTACT_CASES if kind_of(name) == kind]
        errors, work, ratios = {}, [], []
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
                work.append([simulate(one).evaluations[0] for one in (contact_separation(name), free)])
                ratios.append(seconds(contact_separation(name), 40) / seconds(free, 400))
        told = " ".join(f"{value:9.1e}" for value in errors.values())
        if ratios:
            count = np.array(work)
            share = count[:, 0] / count[:, 1]
            told += f" {np.median(count[:, 0]):7.0f} {np.median(count[:, 1]):8.0f}"
            told += f" {np.median(share):8.1f} {share.max():7.1f}"
            told += f"     {np.median(ratios):8.1f} {max(ratios):7.1f}"
        print(f"{kind:8s}{len(names):5d} {told}", flush=True)


if __name__ == "__main__":
    main()
