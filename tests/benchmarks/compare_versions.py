"""Is this version as quick as another one? Runs, gradients, a regression, a reliability estimate and the cold compile.

    python tests/benchmarks/compare_versions.py OTHER_CHECKOUT [--rounds 7]

Each version works in a process of its own, on one thread; they take turns. What is printed is the processor time of the
other version over that of this one, medians over the rounds: above 1 this one is quicker.
"""

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
THREADS = dict.fromkeys(("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
COMPILE = """
import time
from satsep_ot.dynamics import simulation
from satsep_ot.model.separation_problem import SeparationProblem
simulation.prepare = lambda calls: None  # all in this process
separation = SeparationProblem("reference").getCase().separation
start = time.process_time()
simulation.simulate_with_gradients(separation)
print(time.process_time() - start)
"""
WORK = """
import sys, time
import numpy as np
import openturns as ot
import satsep_ot
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients

ot.TBB.SetThreadsNumber(1)
components = ["axial_velocity", "rate_x", "rate_y", "rate_z", *(f"exit_clearance_{i}" for i in range(1, 5))]
problem = satsep_ot.SeparationProblem("reference")
separation, distribution = problem.getCase().separation, problem.getDistribution()
nominal = separation.parameters()
rows = nominal * (1.0 + 0.01 * np.random.default_rng(0).standard_normal((1000, nominal.size)))
ot.RandomGenerator.SetSeed(0)
inputs = ot.Normal(6).getSample(2000)
names = [f"x{i}" for i in range(6)]
outputs = ot.SymbolicFunction(names, ["exp(0.3 * x0 + 0.1 * x1) + x2 * x3 + sin(x4) + x5"])(inputs)
limit = ot.SymbolicFunction(names, ["4.5 - x0 - x1 - 0.2 * x2 * x3 + 0.1 * (x4 + x5)"])


def fit():
    satsep_ot.MultivariatePolynomialRegression(inputs, outputs, ot.Normal(6)).run()


def estimate():
    ot.RandomGenerator.SetSeed(1)
    vector = ot.CompositeRandomVector(limit, ot.RandomVector(ot.Normal(6)))
    satsep_ot.ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Less(), 0.0)).run()


jobs = {
    "runs": lambda: simulate(separation, rows),
    "gradients of the components": lambda: simulate_with_gradients(separation, rows, components),
    "gradients of all quantities": lambda: simulate_with_gradients(separation, rows),
    "regression": fit,
    "reliability estimate": estimate,
}
for job in jobs.values():
    job()
print(satsep_ot.__file__, *jobs, sep=";", flush=True)
for line in sys.stdin:
    job = jobs[line.strip()]
    start = time.process_time()
    job()
    print(time.process_time() - start, flush=True)
"""


def environment(checkout, cache):
    return {**os.environ, **THREADS, "PYTHONPATH": str(checkout), "NUMBA_CACHE_DIR": str(cache)}


def cold_compile(checkout):
    """Processor time of the first run and its gradients, without a cache [s]."""
    with tempfile.TemporaryDirectory() as cache:
        command = [sys.executable, "-P", "-c", COMPILE]
        output = subprocess.run(
            command, env=environment(checkout, cache), stdout=subprocess.PIPE, text=True, check=True
        )
    return float(output.stdout)


def worker(checkout, cache):
    return subprocess.Popen(
        [sys.executable, "-P", "-W", "ignore", "-c", WORK], env=environment(checkout, cache), text=True, bufsize=1,
        stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip


def imported_jobs(child, checkout):
    """The file of the package that a worker has imported, which must be that of its checkout, and its jobs."""
    file, *jobs = child.stdout.readline().strip().split(";")
    if not Path(file).is_relative_to(checkout):
        raise RuntimeError(f"{file} was imported; it must be below {checkout}")
    return [file, *jobs]


def report(name, other, this, unit="ms"):
    factor = 1e3 if unit == "ms" else 1.0
    print(
        f"{name:30s} {statistics.median(other) / statistics.median(this):5.2f} "
        f"({factor * statistics.median(other):.3g} and {factor * statistics.median(this):.3g} {unit})"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", type=Path, help="a checkout of the other version")
    parser.add_argument("--rounds", type=int, default=7)
    options = parser.parse_args()
    checkouts = (options.other.resolve(), ROOT)
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("openturns", "numpy", "numba"))
    print(f"{versions}, Python {platform.python_version()}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}")
    print(f"the other version over this one, processor time, medians of {options.rounds} turns each")
    with tempfile.TemporaryDirectory() as cache:
        workers = [worker(checkout, Path(cache) / str(i)) for i, checkout in enumerate(checkouts)]
        (_, *jobs), _ = (imported_jobs(child, checkout) for child, checkout in zip(workers, checkouts, strict=True))
        for job in jobs:
            seconds = [], []
            for _ in range(options.rounds):
                for child, times in zip(workers, seconds, strict=True):
                    child.stdin.write(f"{job}\n")
                    times.append(float(child.stdout.readline()))
            report(job, *seconds)
        for child in workers:
            child.stdin.close()
            child.wait()
    # A compilation is long: fewer turns.
    times = [[cold_compile(checkout) for checkout in checkouts] for _ in range(max(1, options.rounds // 3))]
    report("cold compile", *zip(*times, strict=True), unit="s")


if __name__ == "__main__":
    main()
