"""Executors: a slow model on one and two workers, the simulator at ten million runs, on one process and on Dask.

    python tests/benchmarks/executors.py slow      a model of 50 ms a point, on threads, processes and Dask
    python tests/benchmarks/executors.py slow computes processes        only that of these, in a minute
    python tests/benchmarks/executors.py runs      100,000, a million and ten million runs in one process
    python tests/benchmarks/executors.py workers   a million runs in place, in two processes and on two Dask workers
    python tests/benchmarks/executors.py chunks    what handing out a chunk costs this process

"Waits" sleeps for 50 ms, as for another program. "Computes" is a loop that takes 50 ms on one free processor, and so
needs a free processor for each worker. What the machine has to give at that moment is measured beside it: two bare
Python processes that do nothing but the same loop, half as often each, against one of them. One worker, two workers,
one process and two take turns; each round gives ratios of its own, of which the median and the range are printed.
"""

import contextlib
import functools
import inspect
import logging
import os
import resource
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot.methods.parallel.executors import daskExecutor, processes
from satsep_ot.methods.parallel.function import ParallelFunction
from satsep_ot.methods.parallel.monte_carlo_stream import MonteCarloStream
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

POINTS = np.arange(40.0)[:, None]
ROUNDS = 7


def spin(steps):
    total = 0.0
    for step in range(steps):
        total += 0.5 * step
    return total


def waits(x):
    time.sleep(0.05)
    return [2.0 * x[0]]


class Computes:
    """The loop, as often as takes 50 ms here."""

    __name__ = "computes"

    def __init__(self):
        self.steps, seconds = 1 << 14, 0.0
        while seconds < 0.05:
            self.steps, begin = 2 * self.steps, time.process_time()
            spin(self.steps)
            seconds = time.process_time() - begin
        self.steps = int(self.steps * 0.05 / seconds)

    def __call__(self, x):
        spin(self.steps)
        return [2.0 * x[0]]


# Runs the loop as often as a line of its input says.
BARE = """
import sys
{spin}
for line in sys.stdin:
    for _ in range(int(line)):
        spin({steps})
    print(flush=True)
"""


class Bare:
    """Bare Python processes beside each other that share the evaluations."""

    def __init__(self, number, steps):
        code = BARE.format(spin=inspect.getsource(spin), steps=steps)
        options = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.processes = [subprocess.Popen([sys.executable, "-c", code], **options) for _ in range(number)]

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        for process in self.processes:
            process.stdin.close()
            process.wait()

    def run(self, size):
        for process in self.processes:
            print(size // len(self.processes), file=process.stdin, flush=True)
        for process in self.processes:
            process.stdout.readline()


@contextlib.contextmanager
def dask(workers):
    from distributed import LocalCluster

    cluster = LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    )  # fmt: skip
    with cluster, daskExecutor(cluster.scheduler_address) as executor:
        yield executor


def slow(*wanted):
    executors = {"threads": ThreadPoolExecutor, "processes": lambda number: processes(number)(), "Dask": dask}
    for model in (waits, Computes()):
        for name, make in executors.items():
            computes = model is not waits
            # Python runs one thread at a time.
            if (computes and name == "threads") or not set(wanted) <= {model.__name__, name}:
                continue
            with make(1) as one, make(2) as two, contextlib.ExitStack() as bare:
                batches = {}
                for number, executor in ((1, one), (2, two)):
                    function = ParallelFunction(ot.PythonFunction(1, 1, model), executor)
                    batches[number] = functools.partial(evaluated, function)
                    function.evaluate(POINTS[: 2 * number])
                    if computes:
                        pair = bare.enter_context(Bare(number, model.steps))
                        pair.run(number)
                        batches[-number] = functools.partial(pair.run, len(POINTS))
                used = time.process_time()
                rounds = [{key: seconds(batch) for key, batch in batches.items()} for _ in range(ROUNDS)]
                used = (time.process_time() - used) / (2 * ROUNDS)
            ratios = [times[1] / times[2] for times in rounds]
            alone, shared = (np.median([times[number] for times in rounds]) for number in (1, 2))
            print(
                f"{model.__name__:8s} {name:9s} {len(POINTS)} points of 50 ms: one worker {alone:.2f} s, "
                f"two {shared:.2f} s, {spread(ratios)} times as fast;\n"
                f"         this process itself used {1e3 * used:.0f} ms a batch",
                flush=True,
            )
            if computes:
                given = [times[-1] / times[-2] for times in rounds]
                shares = [100.0 * mine / theirs for mine, theirs in zip(ratios, given, strict=True)]
                print(
                    f"         two bare processes beside each other: {spread(given)} times as fast as one; "
                    f"of that the workers have {spread(shares, 0)} %",
                    flush=True,
                )


def evaluated(function):
    assert np.array_equal(function.evaluate(POINTS), 2.0 * POINTS)


def seconds(batch):
    begin = time.perf_counter()
    batch()
    return time.perf_counter() - begin


def spread(values, digits=2):
    return f"{np.median(values):.{digits}f} ({min(values):.{digits}f} to {max(values):.{digits}f})"


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
    {"slow": slow, "runs": runs, "workers": workers, "chunks": chunks}[sys.argv[1]](*sys.argv[2:])
    print(f"load {os.getloadavg()[0]:.1f} at the end")
