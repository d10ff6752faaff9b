"""A supervised process ends at Ctrl-C, whatever it does, says what is kept, and leaves no process.

How soon it ends is measured by tests/benchmarks/interrupt_times.py.
"""

import contextlib
import fcntl
import os
import pty
import signal
import subprocess
import sys
import termios
import time
from pathlib import Path

import pytest

from satsep_ot.interruption import supervise

HEAD = """
import os, signal, subprocess, sys, time
from satsep_ot.interruption import supervise
supervise(lambda: "all is kept")
"""
READY = 'print("ready", os.getpid(), flush=True)\n'
IN_A_CALLBACK = f"""
import openturns as ot
def count(x):
    return [x[0] + sum(range(1000))]
vector = ot.CompositeRandomVector(ot.PythonFunction(2, 1, count), ot.RandomVector(ot.Normal(2)))
algorithm = ot.ProbabilitySimulationAlgorithm(ot.ThresholdEvent(vector, ot.Greater(), 1e9))
algorithm.setMaximumOuterSampling(10**9)
{READY}
algorithm.run()
"""
WITHOUT_PYTHON = f"""
import numpy
matrix = numpy.ones((4000, 4000))
{READY}
while True:
    numpy.linalg.svd(matrix)
"""
HOLDING_THE_LOCK = f"""
import ctypes
{READY}
ctypes.PyDLL(None).sleep(30)
"""
IN_PYTHON = f"""
{READY}
while True:
    pass
"""
DEAF = f"""
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda *_: None)
{READY}
while True:
    try:
        time.sleep(30)
    except KeyboardInterrupt:
        pass
"""
WITH_CHILDREN = """
sleeps = "import time; time.sleep(100)"
children = [subprocess.Popen([sys.executable, "-c", sleeps], stderr=subprocess.DEVNULL) for _ in range(2)]
print("ready", os.getpid(), *(child.pid for child in children), flush=True)
time.sleep(30)
"""
WITH_A_POOL = """
from satsep_ot.methods.parallel.executors import processes
pool = processes(2)()
for _ in range(4):
    pool.submit(time.sleep, 30)
print("ready", os.getpid(), *pool._processes, flush=True)
time.sleep(30)
"""
WAITING = f"""
{READY}
time.sleep(30)
"""


@contextlib.contextmanager
def running(program, **options):
    """The process that is signalled, and the numbers of those that work."""
    # Without a buffer, which would read beyond the first line.
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "bufsize": 0, "start_new_session": True} | options
    with subprocess.Popen([sys.executable, "-c", HEAD + program], **options) as process:
        try:
            word, *numbers = process.stdout.readline().split()
            assert word == b"ready"
            yield process, [int(number) for number in numbers]
        finally:
            process.kill()


def end(process, send):
    send()
    out, errors = process.communicate(timeout=60)
    return process.returncode, out.decode(), errors.decode()


def state(number):
    """As the kernel tells it: R and S for running, T for stopped, Z for ended."""
    try:
        return Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return "Z"


def is_there(number):
    return state(number) != "Z"


def wait_until(numbers, states):
    limit = time.monotonic() + 60.0
    while not all(state(number) in states for number in numbers):
        assert time.monotonic() < limit
        time.sleep(0.01)


@pytest.mark.parametrize("group", [False, True])
@pytest.mark.parametrize("program", [IN_A_CALLBACK, WITHOUT_PYTHON, HOLDING_THE_LOCK, IN_PYTHON, DEAF])
def test_an_interrupt_ends_the_process(program, group):
    with running(program) as (process, workers):
        time.sleep(0.1)
        ended = end(process, lambda: (os.killpg if group else os.kill)(process.pid, signal.SIGINT))
        assert ended == (130, "", "satsep-ot: interrupted; all is kept\n")
        assert not any(map(is_there, workers))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("program", [WITH_CHILDREN, WITH_A_POOL])
def test_what_it_has_started_ends_too(program, number):
    with running(program) as (process, workers):
        assert len(workers) == 3
        code, _, errors = end(process, lambda: os.killpg(process.pid, number))
        assert code == 128 + number
        # Neither tracebacks of workers nor warnings about what they leave.
        assert errors.endswith("; all is kept\n")
        assert errors.count("\n") == 1
        assert not any(map(is_there, workers))


def test_two_interrupts_are_as_one():
    with running(WITH_CHILDREN) as (process, _):
        ended = end(process, lambda: [process.send_signal(signal.SIGINT) for _ in range(2)])
        assert ended == (130, "", "satsep-ot: interrupted; all is kept\n")


def test_it_tells_how_else_the_process_ended():
    with running(HOLDING_THE_LOCK) as (process, _):
        ended = end(process, lambda: process.send_signal(signal.SIGTERM))
        assert ended == (143, "", "satsep-ot: ended by signal 15 (Terminated); all is kept\n")
    with running(WAITING) as (process, workers):
        ended = end(process, lambda: os.kill(workers[0], signal.SIGKILL))
        assert ended == (137, "", "satsep-ot: ended by signal 9 (Killed); all is kept\n")


def test_nothing_outlives_a_process_that_is_killed():
    with running(HOLDING_THE_LOCK) as (process, workers):
        process.kill()
        wait_until(workers, "Z")


def test_a_process_whose_parent_has_ended_already_ends_at_once():
    """Before the kernel could be told to end it with its parent."""
    works = "import os\nfrom satsep_ot.interruption import _work\n_work(os.getppid() + {}, set())\nprint('works')"
    pool = """
import multiprocessing, os
from types import SimpleNamespace
from satsep_ot.methods.parallel.executors import _endWithParent
parent, child = os.pipe()
multiprocessing.parent_process = lambda: SimpleNamespace(sentinel=parent)
os.close(child) if {} else None
_endWithParent()
print('works')"""
    for program, ended in ((works, 130), (pool, 1)):
        for parent, expected in ((0, (0, b"works\n")), (1, (ended, b""))):
            process = subprocess.run([sys.executable, "-c", program.format(parent)], stdout=subprocess.PIPE, timeout=30)
            assert (process.returncode, process.stdout) == expected


def test_codes_and_output_are_passed_on():
    with running(READY + "print('said'); sys.stderr.write('warned'); sys.exit(3)") as (process, _):
        assert end(process, lambda: None) == (3, "said\n", "warned")


def test_ctrl_z_stops_the_work_too_until_it_is_to_go_on():
    with running(IN_PYTHON) as (process, workers):
        for _ in range(2):
            process.send_signal(signal.SIGTSTP)
            wait_until([process.pid, *workers], "T")
            process.send_signal(signal.SIGCONT)
            wait_until([process.pid, *workers], "RS")
        os.kill(workers[0], signal.SIGSTOP)
        wait_until(workers, "T")
        assert end(process, lambda: process.send_signal(signal.SIGINT))[0] == 130


def test_an_interrupt_that_is_ignored_from_the_start_on_stays_ignored():
    """As in the background of a shell script."""

    def ignore():
        signal.signal(signal.SIGINT, signal.SIG_IGN)

    with running(READY + "time.sleep(0.3); print('done')", preexec_fn=ignore) as (process, _):
        assert end(process, lambda: os.killpg(process.pid, signal.SIGINT)) == (0, "done\n", "")


def test_nobody_needs_to_read_what_it_says():
    full = "os.set_blocking(2, False)\ntry:\n    while True:\n        os.write(2, bytes(4096))\n"
    full += "except BlockingIOError:\n    os.set_blocking(2, True)\n"
    with running(full + WAITING) as (process, _):
        process.send_signal(signal.SIGINT)
        assert process.wait(timeout=60) == 130


def test_a_terminal_gets_its_cursor_back():
    """Ctrl-C typed in the middle of a progress bar, at a terminal that lets only the foreground print."""
    ours, theirs = pty.openpty()
    attributes = termios.tcgetattr(theirs)
    attributes[3] |= termios.TOSTOP
    termios.tcsetattr(theirs, termios.TCSANOW, attributes)

    def take():
        fcntl.ioctl(theirs, termios.TIOCSCTTY, 0)

    bar = "sys.stderr.write('\\x1b[?25lhalf of it'); sys.stderr.flush()\n"
    environment = {**os.environ, "TERM": "xterm"}
    with running(bar + WAITING, stdin=theirs, stderr=theirs, preexec_fn=take, env=environment) as (process, _):
        os.close(theirs)
        os.write(ours, b"\x03")
        assert process.wait(timeout=60) == 130
    shown = os.read(ours, 4096).decode()
    os.close(ours)
    assert shown == "\x1b[?25lhalf of it^C\r\x1b[2K\x1b[?25hsatsep-ot: interrupted; all is kept\r\n"


def test_other_systems_keep_what_python_does(monkeypatch):
    monkeypatch.setattr(sys, "platform", "darwin")
    monkeypatch.setattr(os, "fork", None)
    supervise(str)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
