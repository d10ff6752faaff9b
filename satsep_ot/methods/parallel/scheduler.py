"""Chunks of work on any executor: in order, few at once, and tried again elsewhere where a worker fails."""

import contextlib
import dataclasses
import faulthandler
import functools
import math
import os
import pickle
import sys
import threading
import time
import traceback
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
from typing import Any

from satsep_ot.openturns_adapter import errorMessage, picklingGlobals

try:
    # It pickles functions of scripts and lambdas too, and comes with Dask.
    import cloudpickle as pickler
except ImportError:
    pickler = pickle

# Between two looks at the clocks of chunks [s].
_POLL = 0.2
# Between two looks at how many workers there are, which may ask over the network [s].
_WORKER_POLL = 5.0
# An executor that hands chunks to its workers ahead of time says that they run before they do: its clock on this side
# is one for the case that the worker's own, which ends it on time, has stopped with the worker [s].
_GRACE = 60.0
# Of an executor that does not say what runs (Dask, which also starts a chunk anew whose worker died), the clock is when
# a chunk of the run was last finished.
_SILENT_FACTOR, _SILENT_GRACE = 8.0, 60.0


class ChunkError(RuntimeError):
    """A chunk could not be finished.

    Attributes
    ----------
    first, end : int
        Its rows are first to end - 1.
    failures : tuple of (str, str)
        Of each attempt the worker, where it is known, and how it ended.
    name : str
        What it is called in the message; empty for its rows.
    finished : dict of int to object
        Results of later chunks that had finished already, by their first row.

    Examples
    --------
    >>> from satsep_ot.methods.parallel.scheduler import ChunkError
    >>> print(ChunkError(20, 30, [("process 7 on node3", "OSError: disk full"), ("", "its worker died")]))
    rows 20 to 29 could not be computed in 2 attempts, the last of which ended so: its worker died; before it: \
OSError: disk full (process 7 on node3)
    """

    def __init__(self, first: int, end: int, failures: Sequence[tuple[str, str]], name: str = "") -> None:
        self.first, self.end, self.failures, self.name = first, end, tuple(failures), name
        self.finished: dict[int, Any] = {}
        tries = "1 attempt, which" if self.attempts == 1 else f"{self.attempts} attempts, the last of which"
        what = name or f"rows {first} to {end - 1}"
        super().__init__(f"{what} could not be computed in {tries} ended so: {self.reason}")

    @property
    def attempts(self) -> int:
        """How often it was tried."""
        return len(self.failures)

    @property
    def reason(self) -> str:
        """How the last attempt ended, and those before it where that adds anything."""
        *before, (worker, last) = self.failures
        earlier = [
            f"{'the same' if reason == last else reason}{where and f' ({where})'}"
            for where, reason in before
            if where or reason != last
        ]
        return f"{last}{worker and f' ({worker})'}" + (f"; before it: {'; '.join(earlier)}" if earlier else "")

    def __reduce__(self):
        return ChunkError, (self.first, self.end, self.failures, self.name)


class Work:
    """A callable of one argument that is pickled once here and loaded once by each worker.

    Parameters
    ----------
    function : callable
        Not to be changed afterwards.

    Examples
    --------
    >>> import math
    >>> from satsep_ot.methods.parallel.scheduler import Work
    >>> Work(math.sqrt).function(4.0)
    2.0
    """

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function = function

    @functools.cached_property
    def payload(self) -> bytes:
        """The function as workers get it, with every chunk: they know it again by its bytes."""
        try:
            with picklingGlobals():
                pickled = pickler.dumps(self.function)
            # OpenTURNS' objects are XML in their pickles, a fifteenth of it when compressed.
            return zlib.compress(pickled, 1)
        except Exception as error:
            raise TypeError(
                f"the function cannot be sent to another process ({type(error).__name__}: {error}); define it at the "
                "top of a module, without locks and open files, or give a ThreadPoolExecutor"
            ) from error

    def __deepcopy__(self, memo):
        return self

    def __reduce__(self):
        return Work, (self.function,)


@dataclasses.dataclass(eq=False)
class Chunk:
    """Rows first to end - 1, and what the work is called with for them; named, where an error is not to say "rows"."""

    first: int
    end: int
    argument: Any
    name: str = ""
    failures: list[tuple[str, str]] = dataclasses.field(default_factory=list)
    alone: bool = False
    future: Future | None = None
    executor: Executor | None = None
    submitted: float = 0.0
    started: float | None = None

    def error(self, reason: str, worker: str = "") -> ChunkError:
        """The error after one more attempt that ended so."""
        return ChunkError(self.first, self.end, [*self.failures, (worker, reason)], self.name)


@dataclasses.dataclass
class _Answer:
    """What the work gave on which worker, or what it raised, as text: an exception need not survive a pickle."""

    worker: str
    result: Any = None
    reason: str | None = None
    traceback: str = ""

    @staticmethod
    def of(worker, compute):
        try:
            return _Answer(worker, compute())
        except BaseException as error:
            # Whatever it is: a model that calls sys.exit is not to end the process that waits for it.
            return _Answer(worker, None, f"{type(error).__name__}: {errorMessage(error)}", traceback.format_exc())


class ChunkScheduler:
    """Run chunks of work on an executor.

    Parameters
    ----------
    executor : :class:`concurrent.futures.Executor`, callable without arguments that makes one, or None
        None runs the work in place. An executor that is given is left as it is; one that is made here is ended by
        `close`, and replaced where it breaks or hangs.

    Notes
    -----
    A chunk whose worker dies, does not answer in time, raises or returns what it must not is tried again. Where a
    whole pool breaks, nobody knows which chunk broke it: all that were with it are tried again, the last time one by
    one, so that the error names the right one.

    Copies share the executor; a pickle works in place.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> from satsep_ot.methods.parallel.scheduler import Chunk, ChunkScheduler, Work
    >>> with ThreadPoolExecutor(2) as pool:
    ...     chunks = (Chunk(i, i + 1, [i]) for i in range(5))
    ...     [total for _, total in ChunkScheduler(pool).run(Work(sum), chunks)]
    [0, 1, 2, 3, 4]
    """

    def __init__(self, executor: Executor | Callable[[], Executor] | None = None) -> None:
        if not (executor is None or callable(executor) or isinstance(executor, Executor)):
            raise TypeError(
                f"the executor is a {type(executor).__name__}; a concurrent.futures.Executor, a callable that makes "
                "one, or None is allowed (a Dask client gives one by get_executor)"
            )
        self._factory = executor if not isinstance(executor, Executor) else None
        self._executor = executor if isinstance(executor, Executor) else None
        self._timeout: float | None = None
        self._maximumAttempts = 3
        self._patience = 300.0

    def __repr__(self) -> str:
        kind = type(self._executor or self._factory).__name__
        return f"ChunkScheduler(executor={kind}, timeout={self._timeout}, maximumAttempts={self._maximumAttempts})"

    def __deepcopy__(self, memo):
        return self

    def __reduce__(self):
        return ChunkScheduler, ()

    def setTimeout(self, timeout: float | None) -> None:
        """Seconds that a chunk may take on its worker; None (default) for no limit.

        The process of a chunk that takes longer is ended, after it has written to its standard error where it was. A
        thread cannot be ended: its chunk is tried again beside it.
        """
        if timeout is not None and not 0.0 < timeout < threading.TIMEOUT_MAX:
            raise ValueError(f"the timeout is {timeout} s; a positive number or None is allowed")
        self._timeout = timeout

    def setMaximumAttempts(self, number: int) -> None:
        """How often a chunk is tried before the run ends with an error (default 3)."""
        if int(number) != number or number < 1:
            raise ValueError(f"the maximum of attempts is {number}; a whole number from 1 on is allowed")
        self._maximumAttempts = int(number)

    def setPatience(self, seconds: float) -> None:
        """How long a cluster may be without any worker before the run ends with an error (default 300 s)."""
        if not seconds >= 0.0:
            raise ValueError(f"the patience is {seconds} s; a number from 0 on is allowed")
        self._patience = seconds

    def isInPlace(self) -> bool:
        """Whether there is no executor."""
        return self._factory is None and self._executor is None

    def getWorkerNumber(self) -> int:
        """How many chunks can run at the same time, as far as the executor tells; 1 in place."""
        return 1 if self.isInPlace() else workerNumber(self._current())

    def close(self) -> None:
        """End the executor, if it was made here; the next run makes another."""
        if self._factory is not None and self._executor is not None:
            self._executor.shutdown(wait=True)
            self._executor = None

    def run(
        self,
        work: Work,
        chunks: Iterable[Chunk],
        check: Callable[[Chunk, Any], str | None] = lambda chunk, result: None,
        inOrder: bool = True,
    ) -> Iterator[tuple[Chunk, Any]]:
        """Chunks and their results.

        Parameters
        ----------
        work : Work
        chunks : iterable of Chunk
            Taken as there is room: no more are kept than four for each worker.
        check : callable, optional
            What is wrong with the result of a chunk; None where nothing is.
        inOrder : bool
            Whether they come in the order of the chunks, or each as soon as it is there.

        Raises
        ------
        ChunkError
            If a chunk has failed as often as allowed. In place, what the work raises is raised as it is.
        """
        if self.isInPlace():
            for chunk in chunks:
                result = work.function(chunk.argument)
                reason = check(chunk, result)
                if reason:
                    raise chunk.error(reason)
                yield chunk, result
        else:
            yield from _Run(self, work, check, inOrder).results(iter(chunks))

    def _current(self):
        if self._executor is None:
            self._executor = self._factory()
        return self._executor

    def _discard(self, executor):
        """Give up an executor that was made here, with all that it does at present."""
        if self._factory is not None and self._executor is executor:
            self._executor = None
            endExecutor(executor)


class _Run:
    """The state of one run on an executor."""

    def __init__(self, scheduler, work, check, inOrder):
        self._scheduler, self._work, self._check, self._inOrder = scheduler, work, check, inOrder
        self._running = []
        self._again = []
        self._workers, self._looked, self._lonely = 1, -math.inf, None
        self._moved = time.monotonic()

    def results(self, chunks):
        waiting, finished = {}, {}
        nextNumber = shown = 0
        try:
            while True:
                self._look()
                while self._mayStart() and nextNumber - shown < 4 * max(self._workers, 1):
                    chunk = next(chunks, None)
                    if chunk is None:
                        chunks = iter(())
                        break
                    waiting[chunk] = nextNumber
                    nextNumber += 1
                    self._start(chunk)
                self._startAgain()
                if not waiting:
                    return
                for chunk, result in self._finished():
                    finished[waiting.pop(chunk)] = chunk, result
                while finished and (shown in finished or not self._inOrder):
                    yield finished.pop(shown if self._inOrder else min(finished))
                    shown += 1
        except ChunkError as error:
            error.finished = {chunk.first: result for chunk, result in finished.values()}
            self._end()
            raise
        except BaseException:
            self._end()
            raise

    def _end(self):
        for chunk in self._running:
            chunk.future.cancel()
        if self._scheduler._executor is not None:
            self._scheduler._discard(self._scheduler._executor)

    def _look(self):
        """Count the workers now and then; a cluster without any is waited for, but not for ever."""
        now = time.monotonic()
        if now - self._looked < _WORKER_POLL and (self._workers or now - self._looked < _POLL):
            return
        try:
            self._looked, self._workers = now, workerNumber(self._scheduler._current())
        except Exception as error:
            if not self._running:
                raise
            chunk = self._running[0]
            reason = f"the cluster cannot be asked for its workers any more ({type(error).__name__}: {error})"
            raise chunk.error(reason) from error
        if self._workers:
            self._moved = now if self._lonely is not None else self._moved
            self._lonely = None
        elif self._lonely is None:
            self._lonely = self._moved = now
        elif now - self._lonely > self._scheduler._patience and self._running:
            chunk = self._running[0]
            reason = f"the cluster has had no worker for {self._scheduler._patience:g} s"
            raise chunk.error(reason)

    def _mayStart(self):
        """Whether a new chunk may start: two for each worker, none beside one that must be alone."""
        return not self._again and len(self._running) < 2 * max(self._workers, 1) and not self._isAlone()

    def _isAlone(self):
        return any(chunk.alone for chunk in self._running)

    def _startAgain(self):
        if self._isAlone():
            return
        for chunk in sorted(self._again, key=lambda chunk: (chunk.alone, chunk.first)):
            if not chunk.alone or not self._running:
                self._again.remove(chunk)
                self._start(chunk)

    def _start(self, chunk):
        scheduler = self._scheduler
        for _ in range(2):
            executor = scheduler._current()
            chunk.executor, chunk.submitted, chunk.started = executor, time.monotonic(), None
            if isinstance(executor, ThreadPoolExecutor):
                call = (_inThread, self._work.function, chunk.argument)
            else:
                call = (_inWorker, self._work.payload, chunk.argument, scheduler._timeout, os.getpid())
            try:
                chunk.future = executor.submit(*call, **_elsewhere(executor, chunk))
            except Exception as error:
                # A pool is found to be broken, or shut down, here where no chunk of ours was with it.
                problem = error
                scheduler._discard(executor)
                continue
            self._running.append(chunk)
            return
        cure = "" if scheduler._factory is not None else "; give a callable that makes an executor to have it replaced"
        reason = f"the executor takes no work ({type(problem).__name__}: {problem}){cure}"
        raise chunk.error(reason) from problem

    def _finished(self):
        """Chunks that finished well meanwhile, with their results; the others are put back or end the run."""
        done, _ = wait([chunk.future for chunk in self._running], timeout=_POLL, return_when=FIRST_COMPLETED)
        for chunk in list(self._running):
            if chunk.future in done:
                self._running.remove(chunk)
                # Dask keeps a result in the cluster, and makes it again where it is lost, as long as its future lives.
                future, chunk.future = chunk.future, None
                try:
                    answer = future.result()
                except BrokenExecutor as error:
                    self._scheduler._discard(chunk.executor)
                    timeout = self._scheduler._timeout
                    late = "" if timeout is None else f", or took longer than {timeout:g} s and was ended"
                    self._failed(chunk, f"its worker died{late} ({type(error).__name__}: {error})", broken=True)
                    continue
                except Exception as error:
                    # Dask, too, blames every chunk that waited at a worker that died.
                    lost = f"no answer came back ({type(error).__name__}: {error})"
                    self._failed(chunk, lost, broken=True, cause=error)
                    continue
                if answer.reason is not None:
                    cause = RuntimeError(f"on the worker:\n{answer.traceback}")
                    self._failed(chunk, answer.reason, answer.worker, cause=cause)
                    continue
                reason = self._check(chunk, answer.result)
                if reason:
                    self._failed(chunk, reason, answer.worker)
                    continue
                self._moved = time.monotonic()
                yield chunk, answer.result
            elif self._hangs(chunk):
                self._running.remove(chunk)
                chunk.future.cancel()
                self._scheduler._discard(chunk.executor)
                self._failed(chunk, f"it gave no answer within {self._scheduler._timeout:g} s", broken=True)

    def _hangs(self, chunk):
        timeout = self._scheduler._timeout
        if timeout is None:
            return False
        now = time.monotonic()
        if chunk.started is None and chunk.future.running():
            chunk.started = now
        if chunk.started is None:
            # It waits in a queue, or it runs and nobody says so: a matter of whether anything moves.
            quiet = now - max(self._moved, chunk.submitted)
            return self._workers > 0 and quiet > _SILENT_FACTOR * timeout + _SILENT_GRACE
        if not isinstance(chunk.executor, ThreadPoolExecutor):
            timeout = 2.0 * timeout + _GRACE
        return now - chunk.started > timeout

    def _failed(self, chunk, reason, worker="", broken=False, cause=None):
        left = self._scheduler._maximumAttempts - len(chunk.failures) - 1
        others = len(self._running)
        if left <= 0 and broken and others and not chunk.alone:
            reason += f"; it may have been one of the {others} chunks beside it"
        if left <= 0:
            raise chunk.error(reason, worker) from cause
        chunk.failures.append((worker, reason))
        chunk.alone = broken and left == 1
        self._again.append(chunk)


def _elsewhere(executor, chunk):
    """What asks a cluster for a worker that has not failed at the chunk.

    A worker that fails at once is the first one to be idle, and would get all that is tried again.
    """
    failed = {worker for worker, _ in chunk.failures}
    if not chunk.failures or not hasattr(executor, "_client") or isinstance(executor, ThreadPoolExecutor):
        return {}
    others = [address for address in executor._client.nthreads() if address not in failed]
    return {"workers": others, "allow_other_workers": True} if others else {}


def workerNumber(executor: Executor) -> int:
    """How many chunks an executor can run at the same time; 0 for a cluster whose workers are yet to come.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> from satsep_ot.methods.parallel.scheduler import workerNumber
    >>> with ThreadPoolExecutor(3) as pool:
    ...     workerNumber(pool)
    3
    """
    client = getattr(executor, "_client", None)
    if client is not None:
        return sum(client.nthreads().values())
    # mpi4py's pool says it in public, those of the standard library and of loky do not.
    return getattr(executor, "num_workers", None) or getattr(executor, "_max_workers", None) or os.cpu_count() or 1


def endExecutor(executor: Executor) -> None:
    """Shut an executor down without waiting for what it does: its processes are killed; threads cannot be."""
    processes = list((getattr(executor, "_processes", None) or {}).values())
    for process in processes:
        process.kill()
    executor.shutdown(wait=bool(processes), cancel_futures=True)


# On the side of the worker. -------------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=8)
def _load(payload):
    return pickle.loads(zlib.decompress(payload))


def _inThread(function, argument):
    def compute():
        with _oneThread():
            return function(argument)

    return _Answer.of(f"thread {threading.current_thread().name}", compute)


def _inWorker(payload, argument, timeout, parent):
    """The work on a chunk, in a process that is ended if it takes too long; not if it is the one that waits."""

    def compute():
        # A worker's first chunk loads libraries too, which the time of a chunk is not meant for.
        function = _load(payload)
        with _deadline(timeout if os.getpid() != parent else None), _oneThread():
            return function(argument)

    return _Answer.of(_thisWorker(), compute)


def _thisWorker():
    """The address of a Dask worker, or which process this is."""
    distributed = sys.modules.get("distributed")
    if distributed is not None:
        with contextlib.suppress(ValueError):
            return distributed.get_worker().address
    return f"process {os.getpid()} on {os.uname().nodename}"


@contextlib.contextmanager
def _oneThread():
    """One thread of numba in this thread of ours: the executor's workers share the processors already.

    A library that is not loaded is not loaded here. The linear algebra libraries have one setting for the whole
    process, which `processes` and Dask make when they start one.
    """
    numba = sys.modules.get("numba")
    if numba is None:
        yield
        return
    number = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        yield
    finally:
        numba.set_num_threads(number)


_deadlines: dict[int, float] = {}
_deadlinesLock = threading.Lock()


@contextlib.contextmanager
def _deadline(seconds):
    """End this process if the block takes longer, from a thread of C that needs no lock of the interpreter."""
    if seconds is None:
        yield
        return
    me = threading.get_ident()
    with _deadlinesLock:
        _deadlines[me] = time.monotonic() + seconds
        _setAlarm()
    try:
        yield
    finally:
        with _deadlinesLock:
            del _deadlines[me]
            _setAlarm()


def _setAlarm():
    # A process has one alarm; a worker with several threads needs the earliest.
    faulthandler.cancel_dump_traceback_later()
    if _deadlines:
        left = min(_deadlines.values()) - time.monotonic()
        faulthandler.dump_traceback_later(max(left, 1e-3), exit=True, file=sys.__stderr__)
