"""Which lines do the fast tests not reach? Kernels run as plain Python for it: coverage does not see compiled code.

    python tests/benchmarks/line_coverage.py FOLDER [TEST ...]

Two runs, put together in FOLDER: the tests of the simulator with its kernels as plain Python, each for some
seconds at most, and the other fast tests (or those named) as ever. Prints the share of each file and the lines missed.
"""

import argparse
import os
import platform
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import coverage
import pytest
from mutation_check import ALL_MOTION, Order, run_tests

ROOT = Path(__file__).resolve().parents[2]
# What cannot be reached in a test, or is there for type checkers alone.
EXCLUDED = ["if TYPE_CHECKING:", "@abc.abstractmethod", 'if __name__ == "__main__":']


def recorder(folder, **options):
    record = coverage.Coverage(source=["satsep_ot"], data_file=str(folder / "coverage"), **options)
    for pattern in EXCLUDED:
        record.exclude(pattern)
    return record


def measure(folder, plain, tests):
    record = recorder(folder, data_suffix=True)
    record.start()
    if plain:
        from satsep_ot.dynamics.rotations import rotation_matrix_elements

        # The function behind a compiled one, where nothing is compiled.
        rotation_matrix_elements.py_func = rotation_matrix_elements
        run_tests(tests, Order())
    else:
        pytest.main(["-q", "-p", "no:cacheprovider", "-m", "not slow", *tests])
    record.stop()
    record.save()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("tests", nargs="*", default=["tests", "satsep_ot"])
    parser.add_argument("--run", choices=("plain", "compiled"), help=argparse.SUPPRESS)
    options = parser.parse_intermixed_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    if options.run:
        measure(options.folder, options.run == "plain", options.tests)
        return
    motion = [f"tests/test_{name}.py" for name in (*ALL_MOTION, "force_table")] + ["satsep_ot/dynamics"]
    for run, tests in (("plain", motion), ("compiled", options.tests)):
        environment = os.environ | ({"NUMBA_DISABLE_JIT": "1"} if run == "plain" else {})
        command = [sys.executable, __file__, str(options.folder.resolve()), "--run", run, *tests]
        subprocess.run(command, cwd=ROOT, env=environment, check=True)
    record = recorder(options.folder)
    record.combine(keep=True)
    print(f"$ python tests/benchmarks/line_coverage.py {' '.join(sys.argv[1:])}")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("coverage", "pytest", "numba"))
    print(f"Python {platform.python_version()}, {versions}")
    record.report(show_missing=True, skip_covered=True)


if __name__ == "__main__":
    main()
