"""Time, memory and files of `satsep-ot study`, and its time over the time of its own 500,000 simulations.

All from a warm compile cache but the last with `--cold`. The ratio is of times of one run of the command; processor
time is told beside it, since the clock depends on what else the machine does.

python tests/benchmarks/study_cost.py [--cold]
"""

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path

from satsep_ot.model.case import load_case, parse_case
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.separation_study import SeparationStudy

SIGMAS = 27.0


def run(what, directory, *arguments, environment=None, screen=None):
    """Run the command and print what it took; its screen goes into a file where one is given."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    command = [sys.executable, "-m", "satsep_ot", "study", *arguments, "--output", str(directory)]
    made = subprocess.run(command, check=True, env=environment, capture_output=True, text=True)
    if screen is not None:
        screen.write_text(made.stdout, encoding="utf-8")
    seconds = time.perf_counter() - start
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    processor = used.ru_utime + used.ru_stime - before.ru_utime - before.ru_stime
    print(f"{what}: {seconds:.0f} s of the clock, {processor:.0f} s of processor time, load {os.getloadavg()[0]:.1f}")
    return json.loads((directory / "results.json").read_text(encoding="utf-8")), seconds, processor


def simulations():
    """Processor time of 500,000 simulations as a study makes them: drawn, run, counted and kept."""
    study = SeparationStudy(SeparationProblem("reference"))
    # The first run loads what was compiled.
    SeparationStudy(SeparationProblem("reference"), sampleSize=1000).computeSample()
    start = time.process_time()
    study.computeSample()
    return time.process_time() - start


def far_case(folder):
    """A case of the package with the limit of one requirement moved to 27 standard deviations from the mean."""
    case = load_case("ring_400kg")
    study = SeparationStudy(SeparationProblem(case), ["MonteCarlo"], sampleSize=20_000)
    study.computeSample()
    values = study.getResult().quantities["axial_velocity"]
    limit = values.mean - SIGMAS * values.deviation
    text = case.text.replace("minimum = 0.494 ", f"minimum = {limit:.4f} ")
    assert text != case.text
    parse_case(text)
    path = folder / "far.toml"
    path.write_text(text, encoding="utf-8")
    return path


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cold", action="store_true", help="also from a cold compile cache")
    parser.add_argument(
        "--screen", type=Path, metavar="FILE", help="keep the screen of the study, and its results beside"
    )
    options = parser.parse_args()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "numba"))
    print(f"{versions}, Python {sys.version.split()[0]}; {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f} before")
    own = simulations()
    print(f"500,000 simulations: {own:.1f} s of processor time")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        kept = folder / "study" if options.screen is None else options.screen.with_suffix("")
        results, seconds, processor = run("satsep-ot study, seed 0, all methods", kept, screen=options.screen)
        crude = next(row["seconds"] for row in results["rows"] if row["method"] == "MonteCarlo")
        size = sum(path.stat().st_size for path in kept.rglob("*") if path.is_file())
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        print(f"  its own 500,000 simulations: {crude:.1f} s of the clock")
        print(f"  ratio by the clock {seconds / crude:.1f}, of processor time {processor / own:.1f}")
        print(f"  largest memory of a process {used.ru_maxrss / 1024:.0f} MiB, results {size / 2**20:.0f} MiB")
        run("satsep-ot study --quick", folder / "quick", "--quick")
        far = far_case(folder)
        results, *_ = run(f"ring_400kg, axial velocity {SIGMAS:g} sigma from its limit", folder / "far", str(far))
        methods = [row["method"] for row in results["rows"] if row["requirement"] == "axial velocity"]
        print(f"  methods that ran on the axial velocity: {', '.join(methods)}")
        if options.cold:
            environment = {**os.environ, "NUMBA_CACHE_DIR": f"{folder}/cache"}
            run("satsep-ot study from a cold compile cache", folder / "cold", environment=environment)


if __name__ == "__main__":
    main()
