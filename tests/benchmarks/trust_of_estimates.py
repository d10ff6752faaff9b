"""ActiveSubspaceReliability on random systems of known probability: how often can its answer be trusted?

    python tests/benchmarks/trust_of_estimates.py [--seeds 0 150] [--rows rows.jsonl] [--package PATH]
        [--processes 1] [--seconds 120] [--target 0.05] [--evaluations 5000]

The systems are those of random_systems.py, where the seeds to design with and those that are opened once stand. Each is
one output without components; the algorithm has its default settings but for target and limit. The seed of a system is
the seed of its run. ``--package`` takes the package from another checkout. A run that takes longer than ``--seconds``
is ended with its process and counts as not finished. Rows are added to the file as soon as they are known, and the same
command continues after an interruption.

*Confidently wrong*: converged, and the truth outside the 99.9 % interval.
"""

import argparse
import json
import math
import multiprocessing
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).resolve().parent))
from random_systems import DESIGN, random_system

LEVELS = {"95": 0.95, "999": 0.999}
OWN_METHODS = ("ActiveSubspace", "ImportanceSampling")


def estimate(seed, target, evaluations):
    """One run, as a row of numbers with their names."""
    import openturns as ot

    from satsep_ot import ActiveSubspaceReliability

    system = random_system(seed)
    ot.RandomGenerator.SetSeed(seed)
    start = time.process_time()
    algorithm = ActiveSubspaceReliability(system.event())
    algorithm.setTargetCoefficientOfVariation(target)
    algorithm.setMaximumEvaluations(evaluations)
    algorithm.run()
    result = algorithm.getResult()
    row = {
        "estimate": result.getProbabilityEstimate(),
        "claimed": result.getCoefficientOfVariation(),
        "runs": result.getEvaluationNumber(),
        "seconds": time.process_time() - start,
        "converged": result.getConverged(),
        "method": result.getMethod(),
    }
    for name, level in LEVELS.items():
        interval = result.getConfidenceInterval(level)
        row |= {f"lower{name}": interval.getLowerBound()[0], f"upper{name}": interval.getUpperBound()[0]}
    return row


def _serve(connection, package):
    """In a process of its own: first the versions, then a row, or what went wrong, for each seed that comes."""
    if package:
        sys.path.insert(0, package)
    from importlib import metadata

    import satsep_ot

    place = Path(satsep_ot.__file__).parent.parent
    if package and place != Path(package).resolve():
        connection.send({"error": f"the package came from {place}, not from {package}"})
        return
    versions = {name: metadata.version(name) for name in ("openturns", "numpy", "scipy")}
    connection.send(versions | {"satsep_ot": satsep_ot.__version__})
    while True:
        seed, target, evaluations = connection.recv()
        try:
            connection.send(estimate(seed, target, evaluations))
        except Exception as error:
            connection.send({"error": f"{type(error).__name__}: {error}".splitlines()[0]})


class Worker:
    """A process that runs one system after the other; it is ended, and started again, where one takes too long.

    Parameters
    ----------
    package : str or None
        Checkout to take the package from.

    Raises
    ------
    RuntimeError
        When the package comes from elsewhere.
    """

    def __init__(self, package):
        self._package = package
        self._start()

    def _start(self):
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs, self._package), daemon=True)
        self._process.start()
        theirs.close()
        self.versions = self._connection.recv()
        if "error" in self.versions:
            raise RuntimeError(self.versions["error"])

    def run(self, seed, target, evaluations, seconds):
        """The row of a system: of its run, of an error, or of no answer in time."""
        self._connection.send((seed, target, evaluations))
        row = {"error": "not finished"}
        try:
            if self._connection.poll(seconds):
                row = self._connection.recv()
        except EOFError:
            row = {"error": "the process ended without an answer"}
        if "error" in row:
            self.close()
            self._start()
        system = random_system(seed)
        head = {"seed": seed, "kind": system.kind, "dimension": system.dimension, "truth": system.probability}
        return head | {"target": target, "evaluations": evaluations} | row

    def close(self):
        """End the process."""
        self._process.kill()
        self._process.join()


def status(row):
    """One word for how a run ended."""
    if "error" in row:
        return "not finished" if row["error"] == "not finished" else "error"
    handed = row["method"] not in OWN_METHODS
    if row["converged"]:
        return "handed, conv." if handed else "converged"
    return "handed over" if handed else "refused"


def inside(row, name):
    """Whether the truth is in the interval of a level."""
    return row[f"lower{name}"] <= row["truth"] <= row[f"upper{name}"]


def line(row):
    """A row of the table."""
    head = f"{row['seed']:6d} {row['kind']:9s} {row['dimension']:3d} {row['truth']:10.3e} "
    if "error" in row:
        return head + f"{status(row)}" + ("" if status(row) == "not finished" else f": {row['error']}")
    bounds = " ".join(f"{row[bound]:10.3e}" for bound in ("lower95", "upper95", "lower999", "upper999"))
    mark = " WRONG" if row["converged"] and not inside(row, "999") else ""
    return head + f"{row['estimate']:10.3e} {bounds} {row['runs']:5d} {row['seconds']:7.2f} {status(row)}{mark}"


def summary(rows):
    """What the table says, a line each."""
    ends = Counter(map(status, rows))
    yield f"{len(rows)} systems: " + ", ".join(f"{number} {name}" for name, number in ends.most_common())
    converged = [row for row in rows if row.get("converged")]
    if not converged:
        return
    wrong = [row for row in converged if not inside(row, "999")]
    errors = np.array([row["estimate"] / row["truth"] - 1.0 for row in converged])
    claimed = np.array([row["claimed"] for row in converged])
    count = len(converged)
    yield f"converged: {count} ({100 * count / len(rows):.1f} %)"
    yield f"confidently wrong: {len(wrong)} of {count} converged ({100 * len(wrong) / count:.1f} %)"
    covered = sum(inside(row, "95") for row in converged)
    yield f"95 % intervals of converged ones that hold the truth: {covered} of {count} ({100 * covered / count:.1f} %)"
    runs = np.median([row["runs"] for row in converged])
    seconds = np.median([row["seconds"] for row in converged])
    yield f"medians of converged ones: {runs:.0f} runs, {seconds:.2f} s"
    real, said = (100.0 * math.sqrt(float((values**2).mean())) for values in (errors, claimed))
    yield f"relative error of converged ones, root of the mean square: {real:.1f} % real, {said:.1f} % claimed"
    right = errors[[inside(row, "999") for row in converged]]
    if len(right):
        yield f"the same without the confidently wrong ones: {100.0 * math.sqrt(float((right**2).mean())):.1f} % real"
    answered = [row for row in rows if "error" not in row]
    outside = sum(not inside(row, "999") for row in answered if not row["converged"])
    yield f"not converged, and the truth outside the 99.9 % interval: {outside} of {len(answered) - count}"
    yield "kind        systems  converged  confidently wrong  median runs"
    for kind in sorted({row["kind"] for row in rows}):
        mine = [row for row in converged if row["kind"] == kind]
        total = sum(row["kind"] == kind for row in rows)
        middle = f"{np.median([row['runs'] for row in mine]):12.0f}" if mine else f"{'-':>12s}"
        yield f"{kind:9s} {total:9d} {len(mine):10d} {sum(not inside(row, '999') for row in mine):18d} {middle}"


def run(seeds, path=None, package=None, target=0.05, evaluations=5000, seconds=120.0, processes=1):
    """Rows of all seeds, those of a file and new ones, which are added to it; and the versions of the new ones."""
    known = {}
    if path is not None and path.exists():
        known = {row["seed"]: row for row in map(json.loads, path.read_text().splitlines())}
        if any((row["target"], row["evaluations"]) != (target, evaluations) for row in known.values()):
            raise ValueError(f"{path} has rows of another target or limit; give another file to --rows")
    new = [seed for seed in seeds if seed not in known]
    workers = [Worker(package) for _ in range(min(processes, len(new)))]
    versions = workers[0].versions if workers else {}

    def one(seed):
        worker = workers.pop()
        row = worker.run(seed, target, evaluations, seconds)
        workers.append(worker)
        if path is not None:
            with path.open("a") as file:
                file.write(json.dumps(row) + "\n")
        return row

    with ThreadPoolExecutor(processes) as executor:
        known |= {row["seed"]: row for row in executor.map(one, new)}
    for worker in workers:
        worker.close()
    return [known[seed] for seed in seeds], versions


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(DESIGN.start, DESIGN.stop), help="first, and one beyond")
    parser.add_argument("--package", help="checkout to take the package from")
    parser.add_argument("--rows", type=Path, help="file of the rows; by default none is kept")
    parser.add_argument("--processes", type=int, default=1, choices=(1, 2))
    parser.add_argument("--seconds", type=float, default=120.0, help="after which a run is ended")
    parser.add_argument("--target", type=float, default=0.05, help="coefficient of variation at which each ends")
    parser.add_argument("--evaluations", type=int, default=5000, help="limit of runs")
    options = parser.parse_args()
    limits = options.target, options.evaluations, options.seconds
    rows, versions = run(range(*options.seeds), options.rows, options.package, *limits, options.processes)
    first, last = options.seeds[0], options.seeds[1] - 1
    print(f"seeds {first} to {last}, target {options.target:g}, at most {options.evaluations} runs")
    print(", ".join(f"{name} {version}" for name, version in versions.items()))
    print("  seed kind        d      truth   estimate  95 % interval         99.9 % interval        runs seconds")
    for row in rows:
        print(line(row))
    for text in summary(rows):
        print(text)


if __name__ == "__main__":
    main()
