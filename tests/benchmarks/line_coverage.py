"""Which lines do the tests not reach? Kernels run as plain Python for it: coverage does not see compiled code.

    python tests/benchmarks/line_coverage.py FOLDER [TEST ...]

Four runs, put together in FOLDER: those tests of the simulator that take no more than some seconds with its kernels as
plain Python; all fast tests (or those named) as ever, with the processes that they start; the slow ones of a cluster;
and the simulator's once more, in a copy whose lines not seen so far say when they are reached, compiled as they are.
Prints the share of each file and the lines missed.
"""

import argparse
import json
import math
import os
import platform
import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import coverage
import pytest
from mutation_check import Order, run_tests, simulator_tests

ROOT = Path(__file__).resolve().parents[2]
# One thread: a test that takes too long is interrupted in it, others would run to their end.
PLAIN = {"NUMBA_DISABLE_JIT": "1", "NUMBA_NUM_THREADS": "1"}
MARK = "reached "
CLUSTER = [f"tests/test_{name}.py" for name in ("dask", "study_workers", "chunk_scheduler")]
# What cannot be reached in a test, or is there for type checkers alone, is left out.
CONFIGURATION = """
[run]
source = satsep_ot
data_file = {folder}/coverage
parallel = true
patch = subprocess, fork, _exit

[report]
exclude_also =
    if TYPE_CHECKING:
    @abc.abstractmethod
    if __name__ == "__main__":
"""


def recorder(folder):
    file = folder / "configuration"
    file.write_text(CONFIGURATION.format(folder=folder), encoding="utf-8")
    return coverage.Coverage(config_file=str(file))


def measure(folder, run, tests):
    durations = folder / "durations.json"
    if run == "durations":
        if durations.exists():
            return
        plugin = Order()
        run_tests(tests, plugin)
        durations.write_text(json.dumps(plugin.measured | dict.fromkeys(plugin.failed, math.inf)))
        return
    record = recorder(folder)
    record.start()
    if run == "plain":
        # A test is not to be interrupted here, where the interruption may leave the record locked.
        run_tests(tests, Order(json.loads(durations.read_text()), limit=600.0))
    else:
        pytest.main(["-q", "-p", "no:cacheprovider", "-m", "slow" if run == "slow" else "not slow", *tests])
    record.stop()
    record.save()


def mark(folder):
    """A copy of the package and its tests in which each line of the simulator that was missed prints where it is."""
    record = recorder(folder)
    record.combine(keep=True)
    copy = folder / "marked"
    shutil.rmtree(copy, ignore_errors=True)
    for part in ("satsep_ot", "tests"):
        shutil.copytree(ROOT / part, copy / part, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", copy)
    for path in sorted((ROOT / "satsep_ot" / "dynamics").rglob("*.py")):
        name = path.relative_to(ROOT)
        lines = path.read_text(encoding="utf-8").splitlines()
        for number in reversed(record.analysis2(str(path))[3]):
            indent, statement = re.fullmatch(r"( *)(.*)", lines[number - 1]).groups()
            # Nothing may stand before a further branch.
            if not statement.startswith(("elif ", "else:", "except", "finally:")):
                lines.insert(number - 1, f'{indent}print("{MARK}{name}:{number}")')
        (copy / name).write_text("\n".join(lines) + "\n", encoding="utf-8")
    return copy


def note_marks(folder, said):
    """Add the lines that have said so to what coverage has recorded."""
    reached = {}
    for name, number in sorted(set(re.findall(rf"{MARK}(\S+\.py):(\d+)", said))):
        reached.setdefault(str(ROOT / name), []).append(int(number))
    data = coverage.CoverageData(basename=str(folder / "coverage.marked"))
    data.add_lines(reached)
    data.write()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("tests", nargs="*")
    parser.add_argument("--report", action="store_true", help="print what an earlier run has left in FOLDER")
    parser.add_argument("--run", choices=("durations", "plain", "compiled", "slow"), help=argparse.SUPPRESS)
    options = parser.parse_intermixed_args()
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    if options.run:
        measure(folder, options.run, options.tests)
        return
    motion = [*simulator_tests(ROOT), "satsep_ot/dynamics"]
    runs = {"durations": motion, "plain": motion, "compiled": options.tests or ["tests", "satsep_ot"], "slow": CLUSTER}
    for run, tests in runs.items() if not options.report else []:
        environment = os.environ | (PLAIN if tests is motion else {})
        command = [sys.executable, __file__, str(folder), "--run", run, *tests]
        subprocess.run(command, cwd=ROOT, env=environment, check=True)
    if not options.report:
        copy = mark(folder)
        # Without the doctests, whose output would not be the expected one.
        command = [sys.executable, "-m", "pytest", "-q", "-s", "-p", "no:cacheprovider", "-m", "not slow", *motion[:-1]]
        environment = os.environ | {"PYTHONPATH": str(copy)}
        done = subprocess.run(command, cwd=copy, env=environment, check=True, stdout=subprocess.PIPE, text=True)
        note_marks(folder, done.stdout)
    record = recorder(folder)
    record.combine(keep=True)
    print(f"$ python tests/benchmarks/line_coverage.py {' '.join(['FOLDER', *options.tests])}")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("coverage", "pytest", "numba"))
    print(f"Python {platform.python_version()}, {versions}")
    record.report(show_missing=True, skip_covered=True)


if __name__ == "__main__":
    main()
