"""A real Dask cluster of this machine: the same bits, workers killed in the middle, hangs, wrong addresses."""

import functools
import logging
import os
import re
import signal
import socket
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import openturns as ot
import pytest
from fault_injection import DoublingWithFault, kill_worker, sleep_for_ever, stop_process

from satsep_ot.methods.parallel.executors import daskExecutor
from satsep_ot.methods.parallel.function import FunctionChunkError, ParallelFunction
from satsep_ot.methods.parallel.monte_carlo_stream import MonteCarloStream
from satsep_ot.methods.parallel.scheduler import workerNumber
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

distributed = pytest.importorskip("distributed")
pytestmark = pytest.mark.slow
POINTS = np.arange(200.0)[:, None]


def make_cluster(workers=2):
    return distributed.LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=True, host="127.0.0.1", dashboard_address="127.0.0.1:0",
        silence_logs=logging.CRITICAL,
    )  # fmt: skip


@pytest.fixture(scope="module")
def executor():
    with make_cluster() as cluster, daskExecutor(cluster.scheduler_address) as made:
        yield made


@pytest.fixture
def victims():
    """A cluster whose workers may be killed: Dask gives up one that dies again and again while it starts."""
    with make_cluster() as cluster, daskExecutor(cluster.scheduler_address) as made:
        yield cluster, made


def doubled(folder, fault=kill_worker, row=-1.0, times=0):
    return ot.PythonFunction(1, 1, func_sample=DoublingWithFault(fault, row, times, folder))


def slowly(x):
    time.sleep(0.02)
    return [2.0 * x[0]]


def worker_processes(cluster):
    return [nanny.pid for nanny in cluster.workers.values()]


def test_bits_of_the_simulator_and_its_gradient(executor):
    assert workerNumber(executor) == 2
    model = SeparationFunction("reference")
    ot.RandomGenerator.SetSeed(5)
    X = np.array(SeparationProblem("reference").getDistribution().getSample(600))
    values, gradients = model.evaluate(X), model.computeGradientSample(X[:40])
    function = ParallelFunction(model, executor)
    for chunk in (None, 97):
        function.setChunkSize(chunk)
        assert np.array_equal(function.evaluate(X), values)
        assert np.array_equal(function.computeGradientSample(X[:40]), gradients)


def test_bits_of_a_stream(executor):
    found = []
    for workers in (None, executor):
        ot.RandomGenerator.SetSeed(0)
        stream = MonteCarloStream(ot.SymbolicFunction(["a", "b"], ["a + b"]), ot.Normal(2), 50_000)
        stream.setEvents({"large": (0, ot.Greater(), 3.0)})
        stream.setExecutor(workers)
        stream.run()
        result = stream.getResult()
        found.append((result.getMean(), result.getStandardDeviation(), result.getEventNumber("large")))
    assert found[0] == found[1]


def test_a_function_of_a_script(executor):
    """A lambda that holds a number: it goes to the workers by value."""
    factor = 3.0
    function = ParallelFunction(ot.PythonFunction(1, 1, lambda x: [factor * x[0]]), executor)
    assert np.array_equal(function.evaluate(POINTS), 3.0 * POINTS)


def test_workers_that_are_killed_in_the_middle(victims):
    """Both, one after the other, from outside: not a row is lost or wrong."""
    cluster, executor = victims
    function = ParallelFunction(ot.PythonFunction(1, 1, slowly), executor)
    function.setChunkSize(4)
    done, killed = [], []
    function.setProgressCallback(done.append)

    def kill():
        for process, share in zip(worker_processes(cluster), (10.0, 50.0), strict=True):
            while not done or done[-1] < share:
                time.sleep(0.01)
            os.kill(process, signal.SIGKILL)
            killed.append(process)

    with ThreadPoolExecutor(1) as other:
        murders = other.submit(kill)
        assert np.array_equal(function.evaluate(POINTS), 2.0 * POINTS)
        murders.result()
    assert len(killed) == 2
    assert not set(killed) & set(worker_processes(cluster))


def test_a_scheduler_that_goes_away_in_the_middle(victims):
    cluster, executor = victims
    function = ParallelFunction(ot.PythonFunction(1, 1, slowly), executor)
    function.setChunkSize(4)
    done = []
    function.setProgressCallback(done.append)

    def close():
        while not done or done[-1] < 10.0:
            time.sleep(0.01)
        cluster.close()

    with ThreadPoolExecutor(1) as other:
        closed = other.submit(close)
        with pytest.raises(
            FunctionChunkError, match=r"could not be computed in .*(no answer came back|cannot be asked)"
        ) as caught:
            function.evaluate(POINTS)
        closed.result()
    assert len(caught.value.rows) >= 20
    assert np.array_equal(caught.value.values, 2.0 * POINTS[caught.value.rows])


def test_a_chunk_that_kills_its_workers_ends_the_run(victims, tmp_path):
    """With one attempt, which is four of Dask's: the chunk, or one that waited at the same worker, is named."""
    function = ParallelFunction(doubled(tmp_path, kill_worker, 150.0, 99), victims[1])
    function.setChunkSize(10)
    function.setMaximumAttempts(1)
    with pytest.raises(FunctionChunkError, match=r"rows \d+ to \d+ .*no answer came back \(KilledWorker") as caught:
        function.evaluate(POINTS)
    assert caught.value.first == 150 or "one of the" in str(caught.value)
    assert len(list(tmp_path.iterdir())) >= 4
    assert 0 in caught.value.rows
    assert 150 not in caught.value.rows
    assert np.array_equal(caught.value.values, 2.0 * POINTS[caught.value.rows])


def test_the_chunk_that_kills_its_workers_is_told_from_those_beside_it(victims, tmp_path):
    """With two attempts: the second one of all that were lost is alone. Each attempt here is one worker of Dask's."""
    cluster, executor = victims
    cluster.scheduler.allowed_failures = 0
    function = ParallelFunction(doubled(tmp_path, kill_worker, 150.0, 99), executor)
    function.setChunkSize(10)
    function.setMaximumAttempts(2)
    with pytest.raises(FunctionChunkError, match=r"rows 150 to 159 could not be computed in 2 attempts") as caught:
        function.evaluate(POINTS)
    assert "beside it" not in caught.value.failures[-1][1]
    assert len(list(tmp_path.iterdir())) == 2
    # Each attempt says which worker it lost.
    lost = [re.search(r"KilledWorker.*tcp://127\.0\.0\.1:\d+", reason) for _, reason in caught.value.failures]
    assert all(lost), caught.value.failures
    assert np.array_equal(caught.value.values, 2.0 * POINTS[caught.value.rows])
    assert not set(range(150, 160)) & set(caught.value.rows.tolist())


def fails_on(guilty, X):
    """Garbage, at once, from one worker, as where its disk is full or its licence is gone."""
    X = np.asarray(X)
    return np.nan * X if 150.0 in X and distributed.get_worker().address in guilty else 2.0 * X


def test_a_chunk_that_fails_on_one_worker_is_tried_on_another(executor):
    """Also where the broken one is idle first."""
    workers = sorted(executor._client.nthreads())
    for guilty in workers:
        model = ot.PythonFunction(1, 1, func_sample=functools.partial(fails_on, [guilty]))
        function = ParallelFunction(model, executor)
        function.setChunkSize(10)
        function.setMaximumAttempts(2)
        assert np.array_equal(function.evaluate(POINTS), 2.0 * POINTS)
    function = ParallelFunction(ot.PythonFunction(1, 1, func_sample=functools.partial(fails_on, workers)), executor)
    function.setChunkSize(10)
    with pytest.raises(FunctionChunkError, match=r"rows 150 to 159 .* 3 attempts, .*: the function returned") as caught:
        function.evaluate(POINTS)
    first, second, third = (worker for worker, _ in caught.value.failures)
    assert first != second
    assert {first, second, third} == set(workers)
    assert all(f"({worker})" in str(caught.value) for worker in workers)


def test_a_worker_that_hangs_is_ended(victims, tmp_path):
    function = ParallelFunction(doubled(tmp_path, sleep_for_ever, 150.0, 1), victims[1])
    function.setChunkSize(10)
    function.setTimeout(1.0)
    assert np.array_equal(function.evaluate(POINTS), 2.0 * POINTS)


def test_a_worker_that_is_stopped_is_waited_for_no_longer_than_the_limit(victims, tmp_path):
    """As by SIGSTOP, or on a machine that does not answer any more."""
    _, executor = victims
    function = ParallelFunction(doubled(tmp_path, stop_process, 150.0, 1), executor)
    function.setChunkSize(10)
    function.setTimeout(1.0)
    assert np.array_equal(function.evaluate(POINTS), 2.0 * POINTS)


def test_the_cluster_is_free_after_an_error(executor):
    def fail(x):
        raise ArithmeticError("no")

    function = ParallelFunction(ot.PythonFunction(1, 1, fail), executor)
    function.setChunkSize(1)
    with pytest.raises(FunctionChunkError, match=r"RuntimeError: (InternalException : )?no"):
        function.evaluate(POINTS)
    for _ in range(100):
        if not any(executor._client.processing().values()):
            return
        time.sleep(0.05)
    pytest.fail("chunks of the failed run are still computed")


def test_an_address_where_nobody_answers():
    with pytest.raises(ConnectionError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9 within 1 s"):
        daskExecutor("tcp://127.0.0.1:9", timeout=1.0).__enter__()


def test_an_address_where_something_else_answers():
    with socket.create_server(("127.0.0.1", 0)) as server, ThreadPoolExecutor(1) as other:

        def answer():
            connection, _ = server.accept()
            with connection:
                connection.sendall(b"HTTP/1.1 400 Bad Request\r\n\r\n")

        answered = other.submit(answer)
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(ConnectionError, match=f"no Dask scheduler answers at {address} within 2 s"):
            daskExecutor(address, timeout=2.0).__enter__()
        answered.result()


@pytest.mark.parametrize("address", ["", "nonsense", "nonsense:xx", "tcp://127.0.0.1"])
def test_what_is_no_address(address):
    with pytest.raises(ConnectionError, match=f"{address} is no address of a Dask scheduler, such as"):
        daskExecutor(address, timeout=1.0).__enter__()


def test_a_scheduler_without_workers():
    with make_cluster(0) as cluster, pytest.raises(ConnectionError, match="has no worker after 1 s"):
        daskExecutor(cluster.scheduler_address, timeout=1.0).__enter__()
