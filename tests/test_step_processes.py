"""Processes of a study that die, in the middle of a result even."""

import os
import signal

import pytest
from fault_injection import die_while_writing, kill_worker

from satsep_ot.methods.parallel.executors import processes
from satsep_ot.methods.parallel.scheduler import endExecutor
from satsep_ot.studies.step_processes import StepError, StepProcesses


@pytest.fixture
def two():
    made = StepProcesses(2)
    yield made
    made.close()


@pytest.mark.skipif(not os.path.exists("/proc/self/syscall"), reason="needs the /proc of Linux")
def test_a_process_that_dies_while_it_writes_is_noticed(two, tmp_path):
    assert list(two.map(die_while_writing, [str(tmp_path / "map")])) == [7]
    assert two.beside(die_while_writing, str(tmp_path / "map"))() == 7


@pytest.mark.skipif(not os.path.exists("/proc/self/syscall"), reason="needs the /proc of Linux")
def test_a_pool_with_half_a_result_is_ended(tmp_path):
    pool = processes(2)()
    future = pool.submit(die_while_writing, str(tmp_path / "marker"))
    manager = pool._executor_manager_thread
    with pytest.raises(TimeoutError):
        future.result(timeout=5.0)
    endExecutor(pool)
    assert not manager.is_alive()


def test_processes_that_die_again_and_again_end_in_one_sentence(two):
    with pytest.raises(StepError, match="call 1 of 2 could not be made in 3 attempts"):
        list(two.map(kill_worker, [0, 1]))


def test_an_idle_process_that_died_is_replaced(two):
    assert list(two.map(abs, [-1, -2])) == [1, 2]
    for process in list(two._pool._processes.values()):
        os.kill(process.pid, signal.SIGKILL)
        process.join()
    assert list(two.map(abs, [-3])) == [3]


def test_one_process_is_this_one():
    alone = StepProcesses(1)
    assert alone.beside(os.getpid)() == os.getpid()
