"""Cost of the simulator on the reference case: cold compile, runs a second, gradients as a multiple of runs.

    python tests/benchmarks/simulator_speed.py

Ratios are from the same process, interleaved, and the smallest of several repetitions.
"""

import os
import subprocess
import sys
import tempfile
import time

# Before numba is loaded: an empty cache, so that the compilation is a cold one.
os.environ["NUMBA_CACHE_DIR"] = tempfile.mkdtemp()

from importlib import metadata

import numba
import numpy as np
import openturns as ot

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients
from satsep_ot.model.inputs import ParameterMap
from satsep_ot.model.separation_problem import SeparationProblem

SIZE = 2_000
COMPONENTS = ["axial_velocity", "rate_x", "rate_y", "rate_z", *(f"exit_clearance_{i}" for i in range(1, 5))]

# What a later process waits for.
LOAD = """
import time
start = time.perf_counter()
import numba, openturns
known = time.perf_counter()
import satsep_ot
imported = time.perf_counter()
from satsep_ot.dynamics.simulation import simulate_with_gradients
from satsep_ot.model.separation_problem import SeparationProblem
separation = SeparationProblem("reference").getCase().separation
ready = time.perf_counter()
simulate_with_gradients(separation)
first = time.perf_counter() - ready
print(f"import of openturns and numba: {known - start:.2f} s; of satsep_ot: {imported - known:.2f} s more;", end=" ")
print(f"its parts and the case: {ready - imported:.2f} s; first run and gradients, from the cache: {first:.2f} s")
"""


def main():
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "numpy", "numba"))
    print(f"{versions}, Python {sys.version.split()[0]}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; seed 0")
    problem = SeparationProblem("reference")
    separation = problem.getCase().separation
    ot.RandomGenerator.SetSeed(0)
    rows = ParameterMap(problem.getCase().inputs, separation).parameters(
        np.asarray(problem.getDistribution().getSample(SIZE))
    )
    start, used = time.perf_counter(), sum(os.times()[:4])
    simulate(separation, rows[:1])
    simulate_with_gradients(separation, rows[:1])
    seconds, used = time.perf_counter() - start, sum(os.times()[:4]) - used
    print(f"cold compile of runs and gradients: {seconds:.1f} s of the clock, {used:.1f} s of processor time")
    command = [sys.executable, "-c", LOAD]
    print(subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout, end="")
    numba.set_num_threads(1)
    jobs = {
        "runs": lambda: simulate(separation, rows),
        f"gradients of the {len(COMPONENTS)} components": lambda: simulate_with_gradients(separation, rows, COMPONENTS),
        f"gradients of all {len(quantity_table(separation))} quantities": lambda: simulate_with_gradients(
            separation, rows
        ),
    }
    best = dict.fromkeys(jobs, np.inf)
    for _ in range(7):
        for label, job in jobs.items():
            start = time.perf_counter()
            job()
            best[label] = min(best[label], time.perf_counter() - start)
    print(f"one thread, {SIZE:,} scattered runs, with gravity and clearance: {SIZE / best['runs']:,.0f} runs a second")
    for label, seconds in list(best.items())[1:]:
        print(f"{label}: {seconds / best['runs']:.1f} times the runs alone")


if __name__ == "__main__":
    main()
