"""Ctrl-C ends a process that listens within a second, where an exception alone would crash it or go unheard."""

import signal
import subprocess
import sys
import time

import pytest

HEAD = """
import openturns as ot
from satsep_ot.interruption import last_words, listen
listen()
"""
IN_A_CALLBACK = """
def count(x):
    return [x[0] + sum(range(1000))]
vector = ot.CompositeRandomVector(ot.PythonFunction(2, 1, count), ot.RandomVector(ot.Normal(2)))
algorithm = ot.ProbabilitySimulationAlgorithm(ot.ThresholdEvent(vector, ot.Greater(), 1e9))
algorithm.setMaximumOuterSampling(10**9)
print("ready", flush=True)
with last_words(lambda: print("kept")):
    algorithm.run()
"""
WITHOUT_PYTHON = """
import numpy
matrix = numpy.ones((4000, 4000))
print("ready", flush=True)
with last_words(lambda: print("kept")):
    while True:
        numpy.linalg.svd(matrix)
"""
IN_PYTHON = """
print("ready", flush=True)
try:
    while True:
        pass
except KeyboardInterrupt:
    print("unwound")
    raise SystemExit(130)
"""


@pytest.mark.parametrize(
    ("program", "said"), [(IN_A_CALLBACK, "kept\n"), (WITHOUT_PYTHON, "kept\n"), (IN_PYTHON, "unwound\n")]
)
def test_an_interrupt_ends_the_process_within_a_second(program, said):
    with subprocess.Popen(
        [sys.executable, "-c", HEAD + program], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == "ready\n"
        time.sleep(0.3)
        start = time.perf_counter()
        process.send_signal(signal.SIGINT)
        out, errors = process.communicate(timeout=20)
        taken = time.perf_counter() - start
    assert (process.returncode, out, errors) == (130, said, "")
    assert taken < 1.5  # a second, and what a busy machine adds
