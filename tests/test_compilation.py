"""The compiled simulator: made once, by other processes, and the same machine code for all."""

import os
import subprocess
import sys

import numpy as np
import pytest
from numba import njit
from separation_cases import TRUTH_CASES, general_separation, mixed_springs, symmetric_separation, truth_separation

from satsep_ot.dynamics.kernels import compilation
from satsep_ot.dynamics.kernels.batch import run_rows, sweep_rows
from satsep_ot.dynamics.relative_orbit import Recontact
from satsep_ot.dynamics.separation import ForceLine
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients, trajectory

FUNCTIONS = """
from satsep_ot.dynamics.kernels.compilation import entry_point

@entry_point
def double(x):
    return 2.0 * x

@entry_point
def triple(x):
    return 3.0 * x
"""
# Prints how often each was found in the cache and what they give.
USE = """
import sys
from satsep_ot.dynamics.kernels.compilation import prepare
from functions import double, triple
{before}
prepare({{double: (1.0,), triple: (1.0,)}})
print([sum(function.stats.cache_hits.values()) for function in (double, triple)], double(2.0), triple(2.0))
print([sum(function.stats.cache_hits.values()) for function in (double, triple)])
"""
ALL_BITS = """
import hashlib
from test_compilation import kinds_of_separations
from satsep_ot.dynamics.kernels.coast import approach_all
from satsep_ot.dynamics.kernels.batch import run_rows, sweep_rows
from satsep_ot.dynamics.simulation import simulate_with_gradients
for name, separation in kinds_of_separations():
    outcome = simulate_with_gradients(separation)
    for values in (outcome.base, outcome.gradients):
        print(name, outcome.status[0], hashlib.sha256(values.tobytes()).hexdigest())
print([sum(function.stats.cache_hits.values()) for function in (run_rows, sweep_rows, approach_all)])
"""


def kinds_of_separations():
    """Every force line, with all that the kernels have a branch for."""
    for name in TRUTH_CASES:
        for force_line in ("guided", "strut"):
            yield f"{name} {force_line}", truth_separation(name, force_line)
    for force_line in ForceLine:
        yield f"general {force_line.name}", general_separation(force_line, recontact=Recontact(0.1, 0.2))
        yield f"mixed {force_line.name}", general_separation(force_line, springs=mixed_springs())


def output(program, folder):
    """What a program prints in a process with a compile cache in `folder`, where modules may be as well."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(folder / "cache")}
    environment["PYTHONPATH"] = os.pathsep.join([str(folder), *sys.path])
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", program], env=environment, stdout=subprocess.PIPE, text=True, check=True
    ).stdout


def test_what_the_cache_lacks_is_compiled_by_other_processes(tmp_path):
    (tmp_path / "functions.py").write_text(FUNCTIONS)
    program = USE.format(before="")
    assert output(program, tmp_path) == "[0, 0] 4.0 6.0\n[1, 1]\n"  # loaded at the call, compiled by nobody here
    assert output(program, tmp_path) == "[1, 1] 4.0 6.0\n[1, 1]\n"  # loaded by `prepare`


@pytest.mark.parametrize("executable", ["/nowhere/python", "/bin/embeds-a-snake", ""])
def test_without_other_processes_this_one_compiles(tmp_path, executable):
    (tmp_path / "functions.py").write_text(FUNCTIONS)
    program = USE.format(before=f"sys.executable = {executable!r}")
    assert output(program, tmp_path) == "[0, 0] 4.0 6.0\n[0, 0]\n"


def test_without_a_cache_this_process_compiles_and_says_so(monkeypatch):
    names = {}
    with pytest.warns(
        RuntimeWarning, match=r"'double'.*every process will compile it: set NUMBA_CACHE_DIR to a folder"
    ):
        # Numba has no folder for a function without a file.
        exec(FUNCTIONS.partition("@entry_point\ndef triple")[0], names)
    monkeypatch.setattr(subprocess, "Popen", None)
    compilation.prepare({names["double"]: (1.0,)})
    assert names["double"](2.0) == 4.0


def test_only_what_python_calls_becomes_machine_code():
    @compilation.inline
    def double(x):
        return 2.0 * x

    @compilation.kernel
    def next_double(x):
        return double(x) + 1.0

    function = njit(**compilation.OPTIONS)(lambda x: next_double(x) * double(x))
    assert function(3.0) == 42.0
    for compiled, has_code in ((function, True), (next_double, False), (double.compiled, False)):
        (made,) = compiled.overloads.values()
        engine = made.library.codegen._engine
        assert bool(engine.is_symbol_defined(made.fndesc.llvm_func_name)) == has_code


def test_the_digest_changes_with_any_source_below_the_folder(tmp_path):
    (tmp_path / "deeper").mkdir()
    files = [tmp_path / "a.py", tmp_path / "deeper" / "b.py"]
    for file in files:
        file.write_text("x = 1\n")
    digests = {compilation._digest(tmp_path)}
    for file in files:
        file.write_text("x = 2\n")
        digests.add(compilation._digest(tmp_path))
    assert len(digests) == 3
    assert compilation._digest(tmp_path) in digests


def test_one_compilation_serves_all_separations():
    for _, separation in kinds_of_separations():
        simulate_with_gradients(separation)
    rows = np.tile(symmetric_separation().parameters(), (2, 1))
    rows.setflags(write=False)
    simulate(symmetric_separation(orbit=None), rows)
    trajectory(symmetric_separation(), [0, 1])
    assert (len(run_rows.signatures), len(sweep_rows.signatures)) == (1, 1)


@pytest.mark.slow
def test_the_process_that_found_nothing_compiled_computes_the_same_bits_as_those_that_load(tmp_path):
    first = output(ALL_BITS, tmp_path)
    assert first.count(" 0 ") == 2 * sum(1 for _ in kinds_of_separations())
    assert first.endswith("[1, 1, 1]\n")
    assert output(ALL_BITS, tmp_path) == first


def test_without_compilation_the_kernels_are_plain_python_with_the_same_physics():
    program = (
        "from satsep_ot.dynamics.simulation import simulate_with_gradients\n"
        "from satsep_ot.model.case import load_case\n"
        "outcome = simulate_with_gradients(load_case('cubesat').separation)\n"
        "print([outcome.quantity('axial_velocity')[0], *outcome.quantity_gradient('axial_velocity')[0].tolist()])\n"
    )
    printed = []
    for setting in ("0", "1"):
        environment = {**os.environ, "NUMBA_DISABLE_JIT": setting}
        done = subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True, timeout=120
        )
        assert done.stderr == ""
        printed.append(np.array(eval(done.stdout)))
    assert np.abs(printed[1] - printed[0]).max() < 1e-9 * np.abs(printed[0]).max()
