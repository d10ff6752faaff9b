"""An OpenTURNS function whose samples are evaluated by the workers of any executor."""

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.deprecation import DeprecatedAlias
from satsep_ot.methods.parallel.chunks import Chunk, ChunkError, Work
from satsep_ot.methods.parallel.scheduler import ChunkScheduler
from satsep_ot.openturns_adapter import Shared, callFunction, hasGradient, hasHessian
from satsep_ot.openturns_object import OpenTURNSObject

# Points of a chunk at most: larger ones gain nothing even where a point takes microseconds.
_LARGEST_CHUNK = 4096


class FunctionWork:
    """Values or gradients of a function at points, as arrays: what a worker does.

    Parameters
    ----------
    function : :py:class:`openturns.Function`, or what it can be made of
        A Python model that offers ``evaluate(X)``, ndarray (N, n) to (N, p), is asked through that.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.parallel.function import FunctionWork
    >>> work = FunctionWork(ot.SymbolicFunction(["a", "b"], ["a * b"]))
    >>> work.evaluate(np.array([[2.0, 3.0]])), work.gradients(np.array([[2.0, 3.0]])).shape
    (array([[6.]]), (1, 2, 1))
    """

    def __init__(self, function: Any) -> None:
        self.model = function
        self._function = None

    def __getstate__(self):
        return {"model": self.model, "_function": None}

    def __call__(self, argument):
        kind, X = argument
        return getattr(self, kind)(X)

    @property
    def function(self) -> ot.Function:
        """The OpenTURNS function."""
        if self._function is None:
            self._function = ot.Function(self.model)
        return self._function

    def hasGradient(self) -> bool:
        """Whether the function has a gradient of its own, not OpenTURNS' differences with one absolute step."""
        return hasattr(self.model, "computeGradientSample") or hasGradient(self.function)

    def hasHessian(self) -> bool:
        """Whether the function has a Hessian of its own."""
        return hasHessian(self.function)

    def evaluate(self, X: np.ndarray) -> np.ndarray:
        """Outputs (N, p) at the points (N, n)."""
        if hasattr(self.model, "evaluate"):
            return np.asarray(self.model.evaluate(X), dtype=float)
        return callFunction(self.function, X)

    def gradients(self, X: np.ndarray) -> np.ndarray:
        """Transposed Jacobians (N, n, p) at the points (N, n)."""
        if hasattr(self.model, "computeGradientSample"):
            return np.asarray(self.model.computeGradientSample(X), dtype=float)
        return np.stack([np.array(self.function.gradient(x)) for x in X])

    def hessians(self, X: np.ndarray) -> np.ndarray:
        """Hessians (N, n, n, p) at the points (N, n)."""
        return np.stack([np.array(self.function.hessian(x)) for x in X])


class ParallelFunction(OpenTURNSObject, ot.OpenTURNSPythonFunction):
    """A function whose samples are split into chunks that the workers of an executor evaluate.

    Parameters
    ----------
    function : :py:class:`openturns.Function`, or what it can be made of
        Taken as it is now. A Python model that offers ``evaluate(X)``, ndarray (N, n) to (N, p), and perhaps
        ``computeGradientSample(X)``, (N, n) to (N, n, p), is asked through these, which is quicker. A plain Python
        function becomes one by :py:class:`openturns.PythonFunction`.
    executor : :class:`concurrent.futures.Executor`, callable without arguments that makes one, or None
        For instance a ``ThreadPoolExecutor`` (functions that wait for another program), what
        :func:`~satsep_ot.methods.parallel.executors.processes` gives (Python functions that compute), that of
        :func:`~satsep_ot.methods.parallel.executors.daskExecutor`, or mpi4py's ``MPIPoolExecutor``. None (default)
        evaluates in place. One that a callable makes is ended by `close`, or by the end of a ``with`` block, and
        replaced where it breaks.

    Notes
    -----
    The values do not depend on the executor, the number of workers or the size of chunks, as long as the function's at
    a point does not depend on the points beside it. Gradients and Hessians are computed by the workers too, where the
    function has them.

    A chunk whose worker dies, does not answer in time, raises, or returns what it must not (another shape, NaN or
    infinity) is tried again; after the last attempt a `ChunkError` names its rows and what happened, and `getLastError`
    has it with what was finished. In place, the function's own error is raised.

    Copies share the executor; a pickle evaluates in place.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> import openturns as ot
    >>> from satsep_ot.methods.parallel.function import ParallelFunction
    >>> def slow(x):
    ...     return [x[0] ** 2]
    >>> with ThreadPoolExecutor(2) as pool:
    ...     function = ot.Function(ParallelFunction(ot.PythonFunction(1, 1, slow), pool))
    ...     print(function([[1.0], [2.0], [3.0]])[2])
    [9]
    """

    def __init__(self, function: Any, executor: Executor | Callable[[], Executor] | None = None) -> None:
        work = FunctionWork(function)
        whole = work.function
        super().__init__(whole.getInputDimension(), whole.getOutputDimension())
        self.setInputDescription(whole.getInputDescription())
        self.setOutputDescription(whole.getOutputDescription())
        self._work = Work(work)
        self._hasGradient, self._hasHessian = work.hasGradient(), work.hasHessian()
        self._scheduler = ChunkScheduler(executor)
        self._chunkSize: int | None = None
        self._nonFiniteAllowed = False
        self._progressCallback: Callable[[float], None] | None = None
        # OpenTURNS hides what the copies raise in text.
        self._lastError = Shared()

    def _shown(self):
        return {
            "inputs": self.getInputDimension(),
            "outputs": self.getOutputDimension(),
            "scheduler": self._scheduler,
        }

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def close(self) -> None:
        """End the executor, if a callable made it."""
        self._scheduler.close()

    def setChunkSize(self, size: int | None) -> None:
        """Points of a chunk; None (default) for four chunks to each worker, of 4096 points at most."""
        if size is not None and (int(size) != size or size < 1):
            raise ValueError(f"the chunk size is {size}; it must be a whole number of at least 1, or None")
        self._chunkSize = None if size is None else int(size)

    def setTimeout(self, timeout: float | None) -> None:
        """Seconds that a chunk may take on its worker, None (default) for no limit; needs an executor.

        The process of a chunk that takes longer is ended, after it has written to its standard error where it was. A
        thread cannot be ended: its chunk is tried again beside it.
        """
        self._scheduler.setTimeout(timeout)

    def setMaximumAttempts(self, number: int) -> None:
        """How often a chunk is tried (default 3)."""
        self._scheduler.setMaximumAttempts(number)

    def setClusterTimeLimit(self, seconds: float) -> None:
        """How long a cluster may be without any worker before there is an error (default 300 s)."""
        self._scheduler.setClusterTimeLimit(seconds)

    setPatience = DeprecatedAlias("setClusterTimeLimit")

    def setNonFiniteAllowed(self, allowed: bool) -> None:
        """Whether NaN and infinity are values that the function may have (default: no)."""
        self._nonFiniteAllowed = bool(allowed)

    def setProgressCallback(self, callback: Callable[[float], None] | None) -> None:
        """Called with the share of the sample that is done [%], chunk by chunk; None for nothing."""
        if callback is not None and not callable(callback):
            raise TypeError(f"the progress callback is of type {type(callback).__name__}; it must be callable")
        self._progressCallback = callback

    def getLastError(self) -> "FunctionChunkError | None":
        """The last :class:`FunctionChunkError` of this function or a copy of it, None if there was none."""
        return self._lastError.value

    def evaluate(self, X: ArrayLike) -> np.ndarray:
        """Outputs at each row.

        Parameters
        ----------
        X : array_like, shape (N, n)

        Returns
        -------
        Y : ndarray, shape (N, p)

        Raises
        ------
        FunctionChunkError
            If a chunk could not be evaluated.
        ValueError
            If the sample has another shape.
        """
        return self._compute("evaluate", X, (self.getOutputDimension(),))

    @property
    def computeGradientSample(self) -> Callable[[ArrayLike], np.ndarray]:
        """Gradients at each row: a method, X (N, n) to (N, n, p); it is there if the function has a gradient."""
        if not self._hasGradient:
            raise AttributeError("the function has no gradient of its own")
        shape = (self.getInputDimension(), self.getOutputDimension())
        return lambda X: self._compute("gradients", X, shape)

    @property
    def _gradient(self):
        batched = self.computeGradientSample
        return lambda x: batched([x])[0]

    @property
    def _hessian(self):
        if not self._hasHessian:
            raise AttributeError("the function has no Hessian of its own")
        n = self.getInputDimension()
        return lambda x: self._compute("hessians", [x], (n, n, self.getOutputDimension()))[0]

    def _exec(self, x):
        return self.evaluate([x])[0]

    def _exec_sample(self, X):
        return self.evaluate(X)

    def _compute(self, kind, X, shape):
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != self.getInputDimension():
            raise ValueError(f"the sample has shape {X.shape}; (N, {self.getInputDimension()}) is needed")
        values = np.empty((len(X), *shape))
        size = self._chunkSize
        if size is None:
            parts = 1 if self._scheduler.isInPlace() else 4 * max(self._scheduler.getWorkerNumber(), 1)
            size = min(max(-(-len(X) // parts), 1), _LARGEST_CHUNK)
        chunks = (
            Chunk(first, min(first + size, len(X)), (kind, X[first : first + size])) for first in range(0, len(X), size)
        )

        def check(chunk, result):
            return wrongResult(result, (chunk.end - chunk.first, *shape), self._nonFiniteAllowed)

        end = 0
        try:
            for chunk, result in self._scheduler.run(self._work, chunks, check):
                values[chunk.first : chunk.end] = result
                end = chunk.end
                if self._progressCallback is not None:
                    self._progressCallback(100.0 * end / len(X))
        except ChunkError as error:
            rows = [np.arange(end)]
            for first, result in sorted(error.finished.items()):
                values[first : first + len(result)] = result
                rows.append(np.arange(first, first + len(result)))
            rows = np.concatenate(rows)
            self._lastError.value = FunctionChunkError(error, rows, values[rows])
            raise self._lastError.value from error.__cause__
        return values


class FunctionChunkError(ChunkError):
    """Rows of a sample could not be evaluated; the others that were finished are here.

    Attributes
    ----------
    first, end : int
        Rows first to end - 1 could not be evaluated. A row that the function itself names counts from `first`.
    rows : ndarray of int, shape (K,)
        Rows of the sample that were finished.
    values : ndarray, shape (K, ...)
        What was computed for them.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> import openturns as ot
    >>> from satsep_ot.methods.parallel.function import FunctionChunkError, ParallelFunction
    >>> model = ot.PythonFunction(1, 1, lambda x: [1.0 / x[0]])
    >>> with ThreadPoolExecutor(1) as pool:
    ...     function = ParallelFunction(model, pool)
    ...     function.setChunkSize(1)
    ...     try:
    ...         function.evaluate([[4.0], [0.0]])
    ...     except FunctionChunkError as error:
    ...         error.first, error.rows.tolist(), error.values.tolist(), "division by zero" in str(error)
    (1, [0], [[0.25]], True)
    """

    def __init__(self, error: ChunkError, rows: np.ndarray, values: np.ndarray) -> None:
        super().__init__(error.first, error.end, error.failures, error.name)
        self.rows, self.values = rows, values

    def __reduce__(self):
        return FunctionChunkError, (ChunkError(*ChunkError.__reduce__(self)[1]), self.rows, self.values)


def wrongResult(result: Any, shape: tuple[int, ...], nonFiniteAllowed: bool = False) -> str | None:
    """What is wrong with an array that should have this shape and be finite; None where nothing is.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.parallel.function import wrongResult
    >>> wrongResult(np.array([[1.0], [np.nan]]), (2, 1))
    'the function returned [nan] in row 1 of these, which is not finite'
    """
    found = getattr(result, "shape", None)
    if found != shape:
        what = f"an array of shape {found}" if found is not None else f"a {type(result).__name__}"
        return f"the function returned {what}, where {shape} is needed"
    if not nonFiniteAllowed and not np.isfinite(result).all():
        row = int(np.argmin(np.isfinite(result.reshape(len(result), -1)).all(axis=1)))
        return f"the function returned {result[row].tolist()} in row {row} of these, which is not finite"
    return None
