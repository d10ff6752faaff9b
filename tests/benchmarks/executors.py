"""Executors: a slow model on one and two workers, the simulator at ten million runs, on one process and on Dask.

    python tests/benchmarks/executors.py slow      a model of 50 ms a point, on threads, processes and Dask
    python tests/benchmarks/executors.py runs      100,000, a million and ten million runs in one process
    python tests/benchmarks/executors.py workers   a million runs in place, in two processes and on two Dask workers

    python tests/benchmarks/executors.py chunks    what handing out a chunk costs this process

Ratios are interleaved, the best of three. "Waits" sleeps for 50 ms, as for another program; "computes" counts for 50 ms
of processor time, and so needs a free processor for each worker.
"""

import contextlib
import logging
import os
import resource
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot.methods.executors import daskExecutor, processes
from satsep_ot.methods.monte_carlo_stream import MonteCarloStream
from satsep_ot.methods.parallel_function import ParallelFunction
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

POINTS = np.arange(60.0)[:, None]


def waits(x):
    time.sleep(0.05)
    return [2.0 * x[0]]


def computes(x):
    end = time.thread_time() + 0.05
    while time.thread_time() < end:
        pass
    return [2.0 * x[0]]


@contextlib.contextmanager
def dask(workers):
    from distributed import LocalCluster

    cluster = LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    )  # fmt: skip
    with cluster, daskExecutor(cluster.scheduler_address) as executor:
        yield executor


def slow():
    executors = {"threads": ThreadPoolExecutor, "processes": lambda number: processes(number)(), "Dask": dask}
    for model in (waits, computes):
        for name, make in executors.items():
            if model is computes and name == "threads":
                # Python runs one thread at a time.
                continue
            with make(1) as one, make(2) as two:
                best = dict.fromkeys((one, two), np.inf)
                functions = {executor: ParallelFunction(ot.PythonFunction(1, 1, model), executor) for executor in best}
                for function in functions.values():
                    function.setChunkSize(1)
                    function.evaluate(POINTS[:6])
                for _ in range(3):
                    for executor, function in functions.items():
                        begin = time.perf_counter()
                        assert np.array_equal(function.evaluate(POINTS), 2.0 * POINTS)
                        best[executor] = min(best[executor], time.perf_counter() - begin)
            print(
                f"{model.__name__:8s} {name:9s} {len(POINTS)} points of 50 ms, one a chunk: "
                f"one worker {best[one]:.2f} s, two {best[two]:.2f} s, {best[one] / best[two]:.2f} times as fast",
                flush=True,
            )


def stream(size, executor=None):
    problem = SeparationProblem("reference")
    function = SeparationFunction("reference", quantities=[entry.quantity for entry in problem.getRequirements()])
    ot.RandomGenerator.SetSeed(0)
    made = MonteCarloStream(function, problem.getDistribution(), size)
    made.setExecutor(executor)
    made.setEvents(
        {
            entry.name: (entry.quantity, ot.Greater() if entry.is_maximum else ot.Less(), entry.limit)
            for entry in problem.getRequirements()
        }
    )
    begin, used = time.perf_counter(), time.process_time()
    made.run()
    return made.getResult(), time.perf_counter() - begin, time.process_time() - used


def memory(who=resource.RUSAGE_SELF):
    return resource.getrusage(who).ru_maxrss / 1024


def runs():
    stream(2048)
    print(f"{memory():.0f} MiB before", flush=True)
    for size in (100_000, 1_000_000, 10_000_000):
        result, seconds, used = stream(size)
        counts = {name: result.getEventNumber(name) for name in result.getEventNames()}
        print(
            f"{size:11,} runs: {seconds:7.1f} s, {used:7.1f} s of processor time ({1e6 * used / size:.1f} us a run), "
            f"{size / seconds:,.0f} runs a second; largest memory {memory():.0f} MiB\n"
            f"            {counts}, any {result.getEventNumber()}",
            flush=True,
        )


def workers():
    size = 1_000_000
    with processes(2)() as pool, dask(2) as cluster:
        executors = {"in place": None, "two processes": pool, "two Dask workers": cluster}
        for executor in executors.values():
            stream(20_000, executor)
        facts = set()
        for name, executor in executors.items():
            result, seconds, _ = stream(size, executor)
            facts.add((*result.getMean(), *result.getStandardDeviation(), result.getEventNumber()))
            print(f"{name:16s} {size:,} runs: {seconds:.1f} s; {memory():.0f} MiB in this process", flush=True)
        print(f"the results are {'the same' if len(facts) == 1 else 'NOT the same'} to the last bit")


def chunks():
    number, blocks, runs_of_a_block = 1000, 16, 4
    function = ot.SymbolicFunction(["x"], [f"x + {k}" for k in range(5)])
    with processes(2)() as pool, dask(2) as cluster:
        for name, executor in {"processes": pool, "Dask": cluster}.items():
            made = MonteCarloStream(function, ot.Normal(), number * blocks * runs_of_a_block)
            made.setBlockSize(runs_of_a_block)
            made.setChunkSize(blocks * runs_of_a_block)
            made.setExecutor(executor)
            used = time.process_time()
            made.run()
            used = time.process_time() - used
            print(
                f"{name}: {1e3 * used / number:.2f} ms of processor time for each chunk of {blocks} blocks", flush=True
            )
    print("(with Dask's scheduler in this process)")


if __name__ == "__main__":
    packages = ("satsep-ot", "openturns", "numpy", "numba", "distributed")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in packages)
    load = os.getloadavg()[0]
    print(f"{versions}, Python {sys.version.split()[0]}; {os.cpu_count()} cores, load {load:.1f} before; seed 0")
    {"slow": slow, "runs": runs, "workers": workers, "chunks": chunks}[sys.argv[1]]()
    print(f"load {os.getloadavg()[0]:.1f} at the end")
