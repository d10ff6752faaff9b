"""A function on any executor: the same bits for any workers and chunks, gradients, copies, failures, what is kept."""

import copy
import pickle
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numba
import numpy as np
import openturns as ot
import pytest
from fault_injection import DoublingWithFault, drop_row, kill_worker, raise_error, return_nan, return_text
from scipy import integrate, stats

from satsep_ot.methods.parallel.executors import processes
from satsep_ot.methods.parallel.function import FunctionChunkError, ParallelFunction
from satsep_ot.methods.parallel.worker import load
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

POINTS = np.arange(30.0)[:, None]


class Model(ot.OpenTURNSPythonFunction):
    """What a user writes: a slow function of a point, no gradient."""

    def __init__(self):
        super().__init__(2, 3)
        self.setInputDescription(["force [N]", "length [m]"])
        self.setOutputDescription(["a", "b", "c"])

    def _exec(self, x):
        time.sleep(1e-4)
        return [x[0] * x[1], np.sin(x[0]), x[0] / (1.0 + x[1] ** 2)]


class Asked(DoublingWithFault, ot.OpenTURNSPythonFunction):
    """The same through `evaluate`, for OpenTURNS."""

    def __init__(self, *arguments):
        ot.OpenTURNSPythonFunction.__init__(self, 1, 1)
        DoublingWithFault.__init__(self, *arguments)

    def _exec_sample(self, X):
        return self(X)

    def _exec(self, x):
        return self([x])[0]


@pytest.fixture(scope="module")
def pool():
    with processes(2)() as made:
        yield made


@pytest.fixture
def threads():
    with ThreadPoolExecutor(3) as made:
        yield made


def points(size, dimension=2):
    return np.random.default_rng(0).normal(size=(size, dimension))


@pytest.mark.parametrize("chunk", [None, 1, 7, 1000])
@pytest.mark.parametrize("model", [Model(), ot.SymbolicFunction(["x", "y"], ["x * y", "sin(x)", "x / (1 + y^2)"])])
def test_bits_do_not_depend_on_workers_and_chunks(model, chunk, threads, pool):
    X = points(53)
    expected = np.array(ot.Function(model)(ot.Sample(X)))
    for executor in (None, threads, pool):
        function = ParallelFunction(model, executor)
        function.setChunkSize(chunk)
        assert np.array_equal(function.evaluate(X), expected)
        assert np.array_equal(np.array(ot.Function(function)(ot.Sample(X))), expected)
    assert np.array_equal(np.array(ot.Function(function)(X[0])), expected[0])


SCRIPT = """
import math
import sys
import openturns as ot
from satsep_ot.methods.parallel.chunks import Work
from satsep_ot.methods.parallel.function import FunctionWork

FACTOR = 3.0

def factor(value):
    return FACTOR * math.sqrt(value)

class Model(ot.OpenTURNSPythonFunction):
    def __init__(self):
        super().__init__(1, 1)

    def _exec(self, x):
        return [factor(x[0])]

for number, model in enumerate((ot.PythonFunction(1, 1, lambda x: [factor(x[0])]), Model(), ot.Function(Model()))):
    with open(f"{sys.argv[1]}/{number}", "wb") as stream:
        stream.write(Work(FunctionWork(model)).payload)
"""


def test_functions_of_a_script_take_what_they_use_with_them(tmp_path):
    """Workers elsewhere do not have the script: its functions go by value, those inside OpenTURNS' pickles too."""
    pytest.importorskip("cloudpickle")
    (tmp_path / "script.py").write_text(SCRIPT, encoding="utf-8")
    subprocess.run([sys.executable, str(tmp_path / "script.py"), str(tmp_path)], check=True)
    for number in range(3):
        function = load((tmp_path / str(number)).read_bytes())
        assert function(("evaluate", np.array([[4.0]]))).tolist() == [[6.0]]


def test_a_plain_python_function(pool):
    factor = 3.0
    function = ParallelFunction(ot.PythonFunction(1, 1, lambda x: [factor * x[0]]), pool)
    assert np.array_equal(function.evaluate(POINTS), 3.0 * POINTS)


@pytest.mark.slow
def test_bits_of_the_simulator(pool, threads):
    """Values and exact gradients, in other processes and threads, in chunks that cut its own."""
    model = SeparationFunction("reference")
    ot.RandomGenerator.SetSeed(3)
    X = np.array(SeparationProblem("reference").getDistribution().getSample(2500))
    values, gradients = model.evaluate(X), model.computeGradientSample(X[:70])
    for executor in (None, threads, pool):
        function = ParallelFunction(model, executor)
        for chunk in (None, 33, 1999):
            function.setChunkSize(chunk)
            assert np.array_equal(function.evaluate(X), values)
            assert np.array_equal(function.computeGradientSample(X[:70]), gradients)
    whole = ot.Function(function)
    assert list(whole.getOutputDescription()) == list(model.getOutputDescription())
    assert np.array_equal(np.array(whole.gradient(X[0])), gradients[0])
    hessian, expected = whole.hessian(X[0]), ot.Function(model).hessian(X[0])
    assert np.array_equal(np.array(hessian.getSheet(2)), np.array(expected.getSheet(2)))


def test_gradients_are_there_where_the_function_has_them(threads):
    smooth = ot.SymbolicFunction(["x", "y"], ["x^2 * y", "exp(y)"])
    function = ParallelFunction(smooth, threads)
    X = points(11)
    expected = np.stack([np.array(smooth.gradient(x)) for x in X])
    assert np.array_equal(function.computeGradientSample(X), expected)
    assert np.array_equal(np.array(ot.Function(function).gradient(X[3])), expected[3])
    for k in range(2):
        found = np.array(ot.Function(function).hessian(X[3]).getSheet(k))
        assert np.array_equal(found, np.array(smooth.hessian(X[3]).getSheet(k)))
    without = ParallelFunction(Model(), threads)
    for name in ("computeGradientSample", "_gradient", "_hessian"):
        assert not hasattr(without, name)
    assert "DifferenceGradient" in repr(ot.Function(without).getGradient())


class Batched(ot.OpenTURNSPythonFunction):
    """A function that has all gradients at once."""

    def __init__(self):
        super().__init__(2, 1)

    def evaluate(self, X):
        return (X**2).sum(axis=1, keepdims=True)

    def computeGradientSample(self, X):
        return 2.0 * X[:, :, None]


def test_gradients_that_come_all_at_once_are_asked_for_so():
    X = points(11)
    made = []

    def pool():
        made.append(ThreadPoolExecutor(2))
        return made[-1]

    with ParallelFunction(Batched(), pool) as function:
        assert np.array_equal(function.evaluate(X), (X**2).sum(axis=1, keepdims=True))
        assert np.array_equal(function.computeGradientSample(X), 2.0 * X[:, :, None])
    # What a callable made is ended at the end of the block.
    assert len(made) == 1
    with pytest.raises(RuntimeError, match="shutdown"):
        made[0].submit(int)


def test_an_active_subspace_from_the_workers(threads):
    function = ot.SymbolicFunction(["a", "b"], ["exp(0.3 * a + 0.4 * b)"])
    directions = []
    for model in (function, ParallelFunction(function, threads)):
        ot.RandomGenerator.SetSeed(0)
        algorithm = ActiveSubspaceAlgorithm(model, ot.Normal(2))
        algorithm.setSamplingSize(50)
        algorithm.run()
        directions.append(np.array(algorithm.getResult().getDirections()))
    assert np.array_equal(*directions)


def test_a_failure_probability_from_the_workers(threads):
    """The whole algorithm, on an event whose function runs in threads: the same runs, the same number."""
    found = []
    for executor in (None, threads):
        function = ot.Function(ParallelFunction(ot.SymbolicFunction(["a", "b"], ["a + 0.1 * b^2"]), executor))
        vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(2)))
        ot.RandomGenerator.SetSeed(0)
        algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 3.0))
        algorithm.run()
        found.append(algorithm.getResult().getProbabilityEstimate())
    assert found[0] == found[1]
    exact = integrate.quad(lambda b: stats.norm.pdf(b) * stats.norm.sf(3.0 - 0.1 * b**2), -10.0, 10.0)[0]
    assert found[0] == pytest.approx(exact, rel=0.1)


def test_copies_share_the_executor_and_pickles_evaluate_in_place(threads):
    function = ParallelFunction(Model(), threads)
    X = points(5)
    assert copy.deepcopy(function)._scheduler is function._scheduler
    again = pickle.loads(pickle.dumps(function))
    assert again._scheduler.isInPlace()
    assert np.array_equal(again.evaluate(X), function.evaluate(X))
    marginal = ot.Function(function).getMarginal([1])
    assert np.array_equal(np.array(marginal(ot.Sample(X)))[:, 0], function.evaluate(X)[:, 1])


def test_each_worker_uses_one_thread_of_numba(threads):
    seen = []

    def count(X):
        seen.append(numba.get_num_threads())
        return np.asarray(X)

    before = numba.get_num_threads()
    ParallelFunction(ot.PythonFunction(1, 1, func_sample=count), threads).evaluate(POINTS)
    assert set(seen) == {1}
    assert numba.get_num_threads() == before


def test_two_workers_wait_at_the_same_time():
    running, most, lock = [0], [0], threading.Lock()

    def wait(x):
        with lock:
            running[0] += 1
            most[0] = max(most[0], running[0])
        time.sleep(0.02)
        with lock:
            running[0] -= 1
        return [x[0]]

    with ThreadPoolExecutor(2) as two:
        function = ParallelFunction(ot.PythonFunction(1, 1, wait), two)
        function.setChunkSize(1)
        assert np.array_equal(function.evaluate(POINTS), POINTS)
    assert most[0] == 2


@pytest.mark.parametrize("fault", [raise_error, drop_row, return_nan, return_text])
def test_what_a_worker_must_not_return_is_asked_for_again(fault, threads, tmp_path):
    function = ParallelFunction(Asked(fault, 6.0, 2, tmp_path), threads)
    function.setChunkSize(4)
    assert np.array_equal(function.evaluate(POINTS), 2.0 * POINTS)
    assert len(list(tmp_path.iterdir())) == 2
    assert function.getLastError() is None


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (raise_error, "ArithmeticError: the licence server is away"),
        (drop_row, r"the function returned an array of shape \(3, 1\), where \(4, 1\) is needed"),
        (return_nan, r"the function returned \[nan\] in row 0 of these, which is not finite"),
        (return_text, r"the function returned an array of shape \(\), where \(4, 1\) is needed"),
    ],
)
def test_after_the_last_attempt_rows_and_reason_are_named(fault, reason, threads, tmp_path):
    function = ParallelFunction(Asked(fault, 13.0, 99, tmp_path), threads)
    function.setChunkSize(4)
    function.setMaximumAttempts(2)
    with pytest.raises(FunctionChunkError, match=rf"rows 12 to 15 could not be computed in 2 attempts.*: {reason}"):
        function.evaluate(POINTS)
    # Through OpenTURNS, which tells the text alone: what was finished is still there.
    with pytest.raises((RuntimeError, FunctionChunkError), match="rows 12 to 15"):
        ot.Function(function)(ot.Sample(POINTS))
    error = function.getLastError()
    # A busy machine may still be making some of the chunks before it.
    assert {0, 4, 8} & set(error.rows.tolist())
    assert not {12, 13, 14, 15} & set(error.rows.tolist())
    assert np.array_equal(error.values, 2.0 * POINTS[error.rows])
    again = pickle.loads(pickle.dumps(error))
    assert np.array_equal(again.rows, error.rows)


def test_values_that_are_not_finite_where_they_are_allowed(threads, tmp_path):
    function = ParallelFunction(Asked(return_nan, 13.0, 99, tmp_path), threads)
    function.setChunkSize(1)
    function.setNonFiniteAllowed(True)
    assert np.flatnonzero(np.isnan(function.evaluate(POINTS)[:, 0])).tolist() == [13]


def test_progress_is_told(threads):
    function, told = ParallelFunction(Model(), threads), []
    function.setChunkSize(10)
    function.setProgressCallback(told.append)
    function.evaluate(points(40))
    assert told == [25.0, 50.0, 75.0, 100.0]
    function.setProgressCallback(None)
    assert function.evaluate(np.empty((0, 2))).shape == (0, 3)


def test_bad_arguments_are_named(threads):
    function = ParallelFunction(Model(), threads)
    with pytest.raises(ValueError, match=r"the sample has shape \(3, 1\); \(N, 2\) is needed"):
        function.evaluate(np.zeros((3, 1)))
    with pytest.raises(ValueError, match="the chunk size is 0"):
        function.setChunkSize(0)
    with pytest.raises(TypeError, match="the progress callback is of type int; it must be callable"):
        function.setProgressCallback(1)
    assert "inputs=2, outputs=3" in repr(function)


@pytest.mark.slow
def test_processes_that_are_killed_in_the_middle(tmp_path):
    with ParallelFunction(Asked(kill_worker, 6.0, 1, tmp_path), processes(2)) as function:
        function.setChunkSize(2)
        assert np.array_equal(function.evaluate(POINTS), 2.0 * POINTS)
