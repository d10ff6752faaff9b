"""Chunks on any executor: order, room, another attempt for each way to fail, and the error after the last."""

import copy
import math
import multiprocessing
import os
import pickle
import re
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool

import numpy as np
import pytest
from fault_injection import (
    DoublingWithFault,
    drop_row,
    exit_process,
    kill_worker,
    pause,
    raise_error,
    raise_unpicklable,
    return_lock,
    sleep_for_ever,
    stop_process,
)
from process_tree import descendants, survivors

from satsep_ot.methods.parallel import scheduler as chunk_scheduler
from satsep_ot.methods.parallel.chunks import Chunk, ChunkError, Work
from satsep_ot.methods.parallel.executors import processes
from satsep_ot.methods.parallel.processor import MixedProcessorsError, processorDescription
from satsep_ot.methods.parallel.scheduler import ChunkScheduler, endExecutor, workerNumber


def chunks(number, rows=2):
    for first in range(0, number * rows, rows):
        yield Chunk(first, first + rows, np.arange(first, first + rows, dtype=float)[:, None])


def same_shape(chunk, result):
    return None if np.shape(result) == (chunk.end - chunk.first, 1) else f"shape {np.shape(result)}"


def run(scheduler, function, number=10):
    parts = [result for _, result in scheduler.run(Work(function), chunks(number), same_shape)]
    return np.concatenate(parts)[:, 0]


EXPECTED = 2.0 * np.arange(20)


class Late:
    """Earlier chunks take longer."""

    def __call__(self, X):
        time.sleep(0.02 if X[0, 0] % 8 == 0 else 0.0)
        return 2.0 * X


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_results_come_in_order(workers):
    with ThreadPoolExecutor(workers) as pool:
        assert np.array_equal(run(ChunkScheduler(pool), Late()), EXPECTED)
    assert np.array_equal(run(ChunkScheduler(), Late()), EXPECTED)


def test_no_more_chunks_are_taken_than_there_is_room_for():
    taken = []

    def counted():
        for chunk in chunks(1000):
            taken.append(chunk.first)
            yield chunk

    with ThreadPoolExecutor(2) as pool:
        results = ChunkScheduler(pool).run(Work(Late()), counted())
        next(results)
        assert len(taken) <= 9
        results.close()


@pytest.mark.parametrize("fault", [raise_error, drop_row, exit_process])
def test_a_chunk_that_fails_twice_is_tried_a_third_time(fault, tmp_path):
    with ThreadPoolExecutor(2) as pool:
        assert np.array_equal(run(ChunkScheduler(pool), DoublingWithFault(fault, 6.0, 2, tmp_path)), EXPECTED)
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (raise_error, "ArithmeticError: the licence server is away"),
        (drop_row, r"shape \(1, 1\)"),
        (exit_process, "SystemExit: 3"),
    ],
)
def test_a_chunk_that_always_fails_is_named(fault, reason, tmp_path):
    with ThreadPoolExecutor(2) as pool:
        with pytest.raises(ChunkError, match=rf"rows 6 to 7 could not .* 3 attempts.*: {reason}") as caught:
            run(ChunkScheduler(pool), DoublingWithFault(fault, 6.0, 99, tmp_path))
        # The pool of the caller is left as it was.
        assert pool.submit(abs, -1).result() == 1
    assert (caught.value.first, caught.value.end, caught.value.attempts) == (6, 8, 3)
    assert len(list(tmp_path.iterdir())) == 3
    assert all(worker.startswith("thread ThreadPoolExecutor") for worker, _ in caught.value.failures)
    assert str(caught.value).count("the same (thread ") == 2
    if fault is raise_error:
        assert "fault_injection.py" in str(caught.value.__cause__)


def test_later_chunks_that_were_finished_are_kept(tmp_path):
    def fail_late(X):
        if X[0, 0] == 2.0:
            time.sleep(0.1)
            raise ArithmeticError
        return 2.0 * X

    seen = []
    with ThreadPoolExecutor(2) as pool:
        results = ChunkScheduler(pool).run(Work(fail_late), chunks(50))
        with pytest.raises(ChunkError) as caught:
            seen.extend(chunk.first for chunk, _ in results)
    assert seen == [0]
    assert {4, 6} <= set(caught.value.finished)
    assert np.array_equal(caught.value.finished[4], [[8.0], [10.0]])


def test_a_thread_that_hangs_is_left_and_its_chunk_tried_beside_it(tmp_path):
    begun, tried_again = threading.Event(), threading.Event()

    def double(X):
        if X[0, 0] == 6.0 and begun.is_set():
            tried_again.set()
        elif X[0, 0] == 6.0:
            begun.set()
            tried_again.wait()
        return 2.0 * X

    with ThreadPoolExecutor(2) as pool:
        scheduler = ChunkScheduler(pool)
        scheduler.setTimeout(0.1)
        assert np.array_equal(run(scheduler, double), EXPECTED)
        scheduler.setMaximumAttempts(1)
        with pytest.raises(ChunkError, match=r"rows 6 to 7 .* 1 attempt.* it gave no answer within 0\.1 s"):
            run(scheduler, DoublingWithFault(pause, 6.0, 1, tmp_path))


def test_in_place_the_error_is_that_of_the_work(tmp_path):
    with pytest.raises(ArithmeticError, match="the licence server is away"):
        run(ChunkScheduler(), DoublingWithFault(raise_error, 6.0, 1, tmp_path))
    with pytest.raises(ChunkError, match=r"rows 6 to 7 .* 1 attempt, which ended so: shape \(1, 1\)"):
        run(ChunkScheduler(), DoublingWithFault(drop_row, 6.0, 99, tmp_path))


def test_without_chunks_there_is_nothing_to_do():
    with ThreadPoolExecutor(1) as pool:
        for executor in (None, pool):
            assert not list(ChunkScheduler(executor).run(Work(Late()), iter(())))


def test_an_executor_that_was_shut_down():
    pool = ThreadPoolExecutor(1)
    pool.shutdown()
    with pytest.raises(ChunkError, match=r"rows 0 to 1 .*takes no work \(RuntimeError.*give a callable"):
        run(ChunkScheduler(pool), Late())


def test_an_executor_that_is_shut_down_in_the_middle():
    pool, seen = ThreadPoolExecutor(1), []

    def read():
        for chunk, _ in ChunkScheduler(pool).run(Work(Late()), chunks(50)):
            seen.append(chunk.first)
            pool.shutdown(wait=False, cancel_futures=True)

    with pytest.raises(ChunkError, match=r"takes no work \(RuntimeError.*give a callable"):
        read()
    assert seen[0] == 0
    assert len(seen) < 50


class Refusing(ThreadPoolExecutor):
    """Its workers cannot be started, the first times."""

    refusals = 0

    def __init__(self, error):
        super().__init__(1)
        self.error = error

    def submit(self, *arguments):
        if Refusing.refusals > 0:
            Refusing.refusals -= 1
            raise self.error
        return super().submit(*arguments)


@pytest.mark.parametrize(
    "error", [BrokenProcessPool("a process died"), BlockingIOError("no more processes"), KeyError()]
)
def test_an_executor_that_breaks_when_it_gets_work(error):
    """It is asked twice; where a callable makes executors the second one is another."""
    Refusing.refusals = 2
    with Refusing(error) as pool, pytest.raises(ChunkError, match=rf"takes no work \({type(error).__name__}.*; give a"):
        run(ChunkScheduler(pool), Late())
    Refusing.refusals = 1
    made = []
    scheduler = ChunkScheduler(lambda: made.append(Refusing(error)) or made[-1])
    assert np.array_equal(run(scheduler, Late()), EXPECTED)
    assert len(made) == 2
    scheduler.close()
    Refusing.refusals = 99
    with pytest.raises(ChunkError, match=rf"rows 0 to 1 .*takes no work \({type(error).__name__}.*\)$"):
        run(scheduler, Late())
    Refusing.refusals = 0


def test_what_is_no_executor_is_refused():
    with pytest.raises(TypeError, match=r"the executor is a str; it must be a concurrent\.futures\.Executor"):
        ChunkScheduler("threads")
    scheduler = ChunkScheduler()
    for set_option, value in (
        (scheduler.setTimeout, 0.0), (scheduler.setTimeout, np.inf), (scheduler.setTimeout, np.nan),
        (scheduler.setMaximumAttempts, 0), (scheduler.setMaximumAttempts, 1.5), (scheduler.setClusterTimeLimit, -1.0),
        (scheduler.setClusterTimeLimit, np.nan), (processes, 0), (processes, 1.5),
    ):  # fmt: skip
        with pytest.raises(ValueError, match="must be"):
            set_option(value)


def test_copies_share_the_executor_and_pickles_have_none():
    with ThreadPoolExecutor(3) as pool:
        scheduler = ChunkScheduler(pool)
        assert copy.deepcopy(scheduler).getWorkerNumber() == 3
        assert pickle.loads(pickle.dumps(scheduler)).isInPlace()
        assert "ThreadPoolExecutor" in repr(scheduler)
    assert not scheduler.isInPlace()


def test_errors_survive_a_pickle():
    error = pickle.loads(pickle.dumps(ChunkError(0, 5, [("process 7", "it died"), ("", "it died")])))
    assert (error.first, error.end, error.attempts) == (0, 5, 2)
    assert error.failures == (("process 7", "it died"), ("", "it died"))
    assert str(error) == (
        "rows 0 to 4 could not be computed in 2 attempts, the last of which ended so: it died; before it: "
        "the same (process 7)"
    )
    assert str(ChunkError(0, 5, [("", "it died"), ("", "it died")])).endswith("ended so: it died")


def test_work_that_cannot_be_sent_says_so():
    with pytest.raises(TypeError, match="cannot be sent to another process"):
        Work(threading.Lock().acquire).payload  # noqa: B018


class Cluster(ThreadPoolExecutor):
    """As Dask's executor: it has a client that knows the workers, and its futures do not say that they run."""

    def __init__(self, workers):
        super().__init__(2)
        self._client, self.workers = self, workers

    def nthreads(self):
        return {str(i): 1 for i in range(self.workers)}


def test_a_cluster_without_workers_is_waited_for_but_not_for_ever():
    with Cluster(0) as cluster:
        assert workerNumber(cluster) == 0
        scheduler = ChunkScheduler(cluster)
        scheduler.setClusterTimeLimit(0.3)
        release = threading.Event()
        with pytest.raises(ChunkError, match=r"rows 0 to 1 .* the cluster has had no worker for 0\.3 s"):
            run(scheduler, lambda X: release.wait(20.0))
        release.set()
        scheduler.setClusterTimeLimit(60.0)
        threading.Timer(0.3, lambda: setattr(cluster, "workers", 2)).start()
        assert np.array_equal(run(scheduler, Late()), EXPECTED)


def test_a_cluster_that_cannot_be_asked_any_more_is_named(monkeypatch):
    def away():
        raise OSError("the scheduler is away")

    monkeypatch.setattr(chunk_scheduler, "_WORKER_POLL", 0.0)
    with Cluster(2) as cluster:
        results = ChunkScheduler(cluster).run(Work(Late()), chunks(50))
        next(results)
        cluster.nthreads = away
        with pytest.raises(ChunkError, match=r"cannot be asked for its workers any more \(OSError: the sched"):
            list(results)
        # Before there is a chunk to name, the cluster's own error is raised.
        with pytest.raises(OSError, match="the scheduler is away"):
            run(ChunkScheduler(cluster), Late())


def test_a_cluster_that_is_away_when_every_chunk_is_to_be_tried_again(monkeypatch, tmp_path):
    monkeypatch.setattr(chunk_scheduler, "_WORKER_POLL", 0.0)

    def away():
        raise OSError("the scheduler is away")

    def lose_cluster(values):
        cluster.nthreads = away
        raise ArithmeticError

    with Cluster(2) as cluster:
        one_chunk = DoublingWithFault(lose_cluster, 0.0, 1, tmp_path)
        with pytest.raises(ChunkError, match=r"rows 0 to 1 .* 2 attempts.*cannot be asked for its workers any more"):
            run(ChunkScheduler(cluster), one_chunk, 1)


def test_there_are_as_many_processes_as_processors_unless_told():
    for arguments, number in (((), len(os.sched_getaffinity(0))), ((3,), 3)):
        with processes(*arguments)() as pool:
            assert workerNumber(pool) == number


WITHOUT = """
import sys
sys.modules.update({blocked})
from satsep_ot.methods.parallel.chunks import Work
from satsep_ot.methods.parallel.executors import daskExecutor
print(Work(abs).__reduce__()[1], len(Work(abs).payload) > 0)
try:
    Work(lambda x: x).payload
except TypeError as error:
    print(error)
try:
    with daskExecutor("tcp://127.0.0.1:9"):
        pass
except ImportError as error:
    print(error)
"""


def test_packages_that_may_be_missing_are_not_missed_before_they_are_needed():
    blocked = dict.fromkeys(["cloudpickle", "dill", "distributed"])
    command = [sys.executable, "-c", WITHOUT.format(blocked=blocked)]
    said = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60).stdout.splitlines()
    assert said[0] == "(<built-in function abs>,) True"
    assert "cannot be sent to another process (PicklingError" in said[1]
    assert said[2] == "a Dask cluster needs the package distributed, which is not installed"


# Processes. -----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_processes_that_die_once_or_twice(tmp_path):
    """Their pool is broken for all chunks in it; the factory makes another, and every chunk is finished."""
    scheduler = ChunkScheduler(processes(2))
    assert np.array_equal(run(scheduler, DoublingWithFault(kill_worker, 6.0, 2, tmp_path)), EXPECTED)
    assert len(list(tmp_path.iterdir())) == 2
    scheduler.close()
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_the_chunk_that_kills_is_told_from_those_beside_it(tmp_path):
    scheduler = ChunkScheduler(processes(2))
    with pytest.raises(ChunkError, match=r"rows 6 to 7 .* 3 attempts.*its worker died") as caught:
        run(scheduler, DoublingWithFault(kill_worker, 6.0, 99, tmp_path))
    assert caught.value.first == 6
    assert "beside it" not in str(caught.value)
    assert not multiprocessing.active_children()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (exit_process, "SystemExit: 3 .process"),
        (raise_unpicklable, "Unpicklable: this and that .process"),
        (return_lock, "no answer came back .TypeError: cannot pickle"),
    ],
)
def test_what_cannot_come_back_from_a_process(fault, reason, tmp_path):
    """Neither exits nor exceptions of a model end this process or its pool."""
    with processes(2)() as pool:
        scheduler = ChunkScheduler(pool)
        assert np.array_equal(run(scheduler, DoublingWithFault(fault, 6.0, 2, tmp_path)), EXPECTED)
        with pytest.raises(ChunkError, match=rf"rows 6 to 7 .*3 attempts.*{reason}"):
            run(scheduler, DoublingWithFault(fault, 6.0, 99, tmp_path))
        assert pool.submit(abs, -1).result() == 1


@pytest.mark.slow
def test_a_process_that_is_stopped_is_replaced(tmp_path, monkeypatch):
    """It cannot end itself any more."""
    monkeypatch.setattr(chunk_scheduler, "_GRACE", 0.5)
    scheduler = ChunkScheduler(processes(2))
    scheduler.setTimeout(1.0)
    assert np.array_equal(run(scheduler, DoublingWithFault(stop_process, 6.0, 1, tmp_path)), EXPECTED)
    scheduler.close()
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_process_that_hangs_is_ended(tmp_path):
    scheduler = ChunkScheduler(processes(2))
    scheduler.setTimeout(0.5)
    assert np.array_equal(run(scheduler, DoublingWithFault(sleep_for_ever, 6.0, 1, tmp_path)), EXPECTED)
    scheduler.close()
    assert not multiprocessing.active_children()


@pytest.mark.slow
def test_a_broken_pool_that_was_given_cannot_be_replaced(tmp_path):
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        with pytest.raises(ChunkError, match=r"takes no work .*give a callable that makes an executor"):
            run(ChunkScheduler(pool), DoublingWithFault(kill_worker, 6.0, 1, tmp_path))
        endExecutor(pool)


PARENT = """
import ctypes
import os
import sys
import time

from satsep_ot.methods.parallel.executors import processes
from satsep_ot.methods.parallel.processor import MixedProcessorsError, processorDescription

def process(_):
    time.sleep(0.2)
    return os.getpid()

def sleep_for_ever(_):
    # It holds the lock of the interpreter: no other thread of its process runs any more.
    ctypes.PyDLL(None).sleep(1000)

if __name__ == "__main__":
    pool = processes(2)()
    print(*set(pool.map(process, range(6))), flush=True)
    pool.submit(sleep_for_ever, 0)
    sys.stdin.read()
"""


@pytest.mark.slow
def test_processes_end_with_a_parent_that_is_killed(tmp_path):
    """One that waits for work, and one that can do nothing about it itself."""
    script = tmp_path / "parent.py"
    script.write_text(PARENT, encoding="utf-8")
    with subprocess.Popen(
        [sys.executable, str(script)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL
    ) as parent:
        workers = set(map(int, parent.stdout.readline().split()))
        assert len(workers) == 2
        assert workers <= descendants(parent.pid)
        time.sleep(0.5)
        parent.kill()
    assert not survivors(workers)


def test_the_time_limit_follows_from_the_chunks_that_are_finished():
    scheduler = ChunkScheduler(ThreadPoolExecutor(1))
    scheduler.setMeasuredTimeout(20.0, 60.0)
    settings = chunk_scheduler._Settings(None, scheduler._measured, 3, 300.0, True, False)
    work = chunk_scheduler._Run(scheduler, settings, Work(sum), None, True)
    assert work._measuredLimit() == 600.0
    work._durations = [1.0, 1.0, 2.0, 500.0]
    assert work._measuredLimit() == 60.0
    work._durations = [6.0, 7.0, 8.0]
    assert work._measuredLimit() == 140.0
    for wrong in ((0.5, 60.0), (20.0, 0.0), (20.0, math.nan)):
        with pytest.raises(ValueError, match="must be at least 1, and positive"):
            scheduler.setMeasuredTimeout(*wrong)


@pytest.mark.parametrize("row", [6.0, pytest.param(0.0, marks=pytest.mark.slow)])
def test_a_stopped_process_is_told_and_its_chunk_tried_elsewhere(row, tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(chunk_scheduler, "_QUIET", 0.5)
    scheduler = ChunkScheduler(processes(2))
    scheduler.setMeasuredTimeout(20.0, 6.0)
    assert np.array_equal(run(scheduler, DoublingWithFault(stop_process, row, 1, tmp_path)), EXPECTED)
    scheduler.close()
    said = [record.getMessage() for record in caplog.records if record.name == "satsep_ot"]
    sentence = r"waiting for worker process \d+, which is stopped since \d\d:\d\d:\d\d: rows "
    assert any(re.search(sentence, message) for message in said)
    assert any("is tried elsewhere" in message for message in said)
    assert not multiprocessing.active_children()


def test_a_process_that_is_stopped_without_work_does_not_hold_up_the_end(monkeypatch):
    monkeypatch.setattr(chunk_scheduler, "_ENDING", 0.5)
    scheduler = ChunkScheduler(processes(2))
    pool = scheduler.getExecutor()
    assert pool.submit(abs, -1).result() == 1
    for process in pool._processes.values():
        os.kill(process.pid, signal.SIGSTOP)
    scheduler.close()
    assert not multiprocessing.active_children()


class InThisProcess(Executor):
    def submit(self, call, *arguments, **options):
        future = Future()
        future.set_result(call(*arguments))
        return future


def answers_of(processors):
    """An executor in this process whose workers say that they have these processors, one after the other."""
    names = iter(processors)

    class Workers(InThisProcess):
        def submit(self, call, *arguments, **options):
            future = super().submit(call, *arguments, **options)
            future.result().processor = next(names)
            return future

    return Workers()


def test_a_mixture_of_processors_is_refused_or_accepted_and_told():
    chunks = [Chunk(i, i + 1, [i]) for i in range(3)]
    scheduler = ChunkScheduler(answers_of(["Zen", "Zen", "Xeon"]))
    with pytest.raises(MixedProcessorsError, match="a worker has Xeon, where Zen is used") as caught:
        list(scheduler.run(Work(sum), iter(chunks)))
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)
    scheduler = ChunkScheduler(answers_of(["Zen", "Zen", "Xeon"]))
    scheduler.setMixedProcessorsAllowed(True)
    assert [result for _, result in scheduler.run(Work(sum), iter(chunks))] == [0, 1, 2]
    assert scheduler.getProcessors() == ["Xeon", "Zen"]
    scheduler = ChunkScheduler(answers_of(["Zen", "Zen", "Zen"]))
    scheduler.setProcessors(["Xeon"])
    with pytest.raises(MixedProcessorsError, match="a worker has Zen, where Xeon is used"):
        list(scheduler.run(Work(sum), iter(chunks)))


def test_workers_of_this_machine_have_its_processor():
    scheduler = ChunkScheduler(processes(1))
    scheduler.setProcessors([processorDescription()])
    assert len(list(scheduler.run(Work(sum), iter([Chunk(0, 1, [1])])))) == 1
    assert scheduler.getProcessors() == [processorDescription()]
    scheduler.close()


def test_workers_that_the_scheduler_has_not_heard_of_get_no_work():
    class Client:
        def scheduler_info(self, n_workers=5):
            assert n_workers == -1
            return {"workers": {"tcp://a": {"last_seen": 100.0}, "tcp://b": {"last_seen": 60.0}}}

        def nthreads(self):
            return {"tcp://a": 1, "tcp://b": 1}

    executor = InThisProcess()
    executor._client = Client()
    silent = chunk_scheduler._silent_workers(executor)
    assert silent == {"tcp://b"}
    preferred = chunk_scheduler._preferred_workers(executor, Chunk(0, 1, None), silent)
    assert preferred == {"workers": ["tcp://a"], "allow_other_workers": True}
    assert chunk_scheduler._workers_in_words(executor, silent) == "worker tcp://b, which is silent"
    assert chunk_scheduler._preferred_workers(executor, Chunk(0, 1, None), set()) == {}
