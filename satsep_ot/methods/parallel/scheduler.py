"""Chunks of work on any executor: in order, few at once, and tried again on another worker if one fails.

pebble's pool of processes has time limits and names the task that killed its process, but it is no
``concurrent.futures.Executor``: clusters and executors that are given would need all of this beside it. loky and
``concurrent.futures`` report an error for every task of a pool whose process died. Neither they nor Dask have time
limits.
"""

import dataclasses
import math
import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
from typing import Any

from satsep_ot.deprecation import DeprecatedAlias
from satsep_ot.methods.parallel.chunks import Chunk, ChunkError, Work
from satsep_ot.methods.parallel.worker import work_in_process, work_in_thread

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
    whole pool breaks, it is not known which chunk broke it: all chunks that ran are tried again, the last time one by
    one, so that the error names the right one.

    Copies share the executor; a pickle works in place.

    Examples
    --------
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> from satsep_ot.methods.parallel.chunks import Chunk, Work
    >>> from satsep_ot.methods.parallel.scheduler import ChunkScheduler
    >>> with ThreadPoolExecutor(2) as pool:
    ...     chunks = (Chunk(i, i + 1, [i]) for i in range(5))
    ...     [total for _, total in ChunkScheduler(pool).run(Work(sum), chunks)]
    [0, 1, 2, 3, 4]
    """

    def __init__(self, executor: Executor | Callable[[], Executor] | None = None) -> None:
        if not (executor is None or callable(executor) or isinstance(executor, Executor)):
            raise TypeError(
                f"the executor is a {type(executor).__name__}; it must be a concurrent.futures.Executor, a "
                "callable that makes one, or None (a Dask client gives one by get_executor)"
            )
        self._factory = executor if not isinstance(executor, Executor) else None
        self._executor = executor if isinstance(executor, Executor) else None
        self._timeout: float | None = None
        self._maximumAttempts = 3
        self._clusterTimeLimit = 300.0

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
            raise ValueError(f"the timeout is {timeout} s; it must be positive, or None")
        self._timeout = timeout

    def setMaximumAttempts(self, number: int) -> None:
        """How often a chunk is tried before the run ends with an error (default 3)."""
        if int(number) != number or number < 1:
            raise ValueError(f"the maximum of attempts is {number}; it must be a whole number of at least 1")
        self._maximumAttempts = int(number)

    def setClusterTimeLimit(self, seconds: float) -> None:
        """How long a cluster may be without any worker before the run ends with an error (default 300 s)."""
        if not seconds >= 0.0:
            raise ValueError(f"the time without workers is {seconds} s; it must be a number of at least 0")
        self._clusterTimeLimit = seconds

    setPatience = DeprecatedAlias("setClusterTimeLimit")

    def isInPlace(self) -> bool:
        """Whether there is no executor."""
        return self._factory is None and self._executor is None

    def getWorkerNumber(self) -> int:
        """How many chunks can run at the same time, as far as the executor tells; 1 in place."""
        return 1 if self.isInPlace() else workerNumber(self.getExecutor())

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
            Taken one by one: at most four for each worker are kept at a time.
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
            settings = _Settings(
                self._timeout, self._maximumAttempts, self._clusterTimeLimit, self._factory is not None
            )
            yield from _Run(self, settings, work, check, inOrder).results(iter(chunks))

    def getExecutor(self) -> Executor:
        """The executor, which is made now if it must be."""
        if self._executor is None:
            if self._factory is None:
                raise ValueError("work in place has no executor")
            self._executor = self._factory()
        return self._executor

    def discard(self, executor: Executor | None = None) -> None:
        """Give up the executor, if it was made here and is this one, with all that it does; by default any."""
        if self._factory is not None and self._executor is not None and executor in (None, self._executor):
            discarded, self._executor = self._executor, None
            endExecutor(discarded)


@dataclasses.dataclass(frozen=True)
class _Settings:
    """What a run on an executor takes from its scheduler."""

    timeout: float | None
    maximumAttempts: int
    clusterTimeLimit: float
    replaceable: bool


@dataclasses.dataclass(eq=False)
class _Attempt:
    """A chunk that an executor has: gone when it is finished, since Dask keeps a result as long as its future lives."""

    chunk: Chunk
    executor: Executor
    future: Future
    isolated: bool
    submitted: float
    started: float | None = None


class _Run:
    """The state of one run on an executor."""

    def __init__(self, scheduler, settings, work, check, inOrder):
        self._scheduler, self._settings = scheduler, settings
        self._work, self._check, self._inOrder = work, check, inOrder
        self._attempts: list[_Attempt] = []
        # Chunks to be tried again, and whether without others beside them.
        self._retries: list[tuple[Chunk, bool]] = []
        self._workers, self._counted = 1, -math.inf
        # When a chunk was last finished, and since when the cluster has had no worker.
        self._progress = time.monotonic()
        self._deserted: float | None = None

    def results(self, chunks):
        waiting, finished = {}, {}
        nextNumber = shown = 0
        try:
            while True:
                self._countWorkers()
                while self._mayStart() and nextNumber - shown < 4 * max(self._workers, 1):
                    chunk = next(chunks, None)
                    if chunk is None:
                        chunks = iter(())
                        break
                    waiting[chunk] = nextNumber
                    nextNumber += 1
                    self._start(chunk)
                self._startRetries()
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
        for attempt in self._attempts:
            attempt.future.cancel()
        self._scheduler.discard()

    def _countWorkers(self):
        """Count the workers now and then; a cluster without any is waited for, but not for ever."""
        now = time.monotonic()
        if now - self._counted < _WORKER_POLL and (self._workers or now - self._counted < _POLL):
            return
        pending = [attempt.chunk for attempt in self._attempts] + [chunk for chunk, _ in self._retries]
        try:
            self._counted, self._workers = now, self._scheduler.getWorkerNumber()
        except Exception as error:
            if not pending:
                raise
            reason = f"the cluster cannot be asked for its workers any more ({type(error).__name__}: {error})"
            raise pending[0].error(reason) from error
        limit = self._settings.clusterTimeLimit
        if self._workers:
            self._progress = now if self._deserted is not None else self._progress
            self._deserted = None
        elif self._deserted is None:
            self._deserted = self._progress = now
        elif now - self._deserted > limit and pending:
            raise pending[0].error(f"the cluster has had no worker for {limit:g} s")

    def _mayStart(self):
        """Whether a new chunk may start: two for each worker, none beside one that must be alone."""
        return not self._retries and len(self._attempts) < 2 * max(self._workers, 1) and not self._isIsolating()

    def _isIsolating(self):
        return any(attempt.isolated for attempt in self._attempts)

    def _startRetries(self):
        for retry in sorted(self._retries, key=lambda retry: (retry[1], retry[0].first)):
            if self._isIsolating() or (retry[1] and self._attempts):
                return
            self._retries.remove(retry)
            self._start(*retry)

    def _start(self, chunk, isolated=False):
        for _ in range(2):
            executor = self._scheduler.getExecutor()
            submitted = time.monotonic()
            if isinstance(executor, ThreadPoolExecutor):
                call = (work_in_thread, self._work.function, chunk.argument)
            else:
                call = (work_in_process, self._work.payload, chunk.argument, self._settings.timeout, os.getpid())
            try:
                future = executor.submit(*call, **_preferred_workers(executor, chunk))
            except Exception as error:
                # A pool is found to be broken, or shut down, here where no chunk of ours was with it.
                problem = error
                self._scheduler.discard(executor)
                continue
            self._attempts.append(_Attempt(chunk, executor, future, isolated, submitted))
            return
        cure = "" if self._settings.replaceable else "; give a callable that makes an executor to have it replaced"
        reason = f"the executor takes no work ({type(problem).__name__}: {problem}){cure}"
        raise chunk.error(reason) from problem

    def _finished(self):
        """Chunks that have finished well, with their results; the others are put back or end the run."""
        done, _ = wait([attempt.future for attempt in self._attempts], timeout=_POLL, return_when=FIRST_COMPLETED)
        for attempt in list(self._attempts):
            if attempt.future in done:
                self._attempts.remove(attempt)
                answer = self._answer(attempt)
                if answer is None:
                    continue
                if answer.reason is not None:
                    cause = RuntimeError(f"on the worker:\n{answer.traceback}")
                    self._failed(attempt, answer.reason, answer.worker, cause=cause)
                    continue
                reason = self._check(attempt.chunk, answer.result)
                if reason:
                    self._failed(attempt, reason, answer.worker)
                    continue
                self._progress = time.monotonic()
                yield attempt.chunk, answer.result
            elif self._isLate(attempt):
                self._attempts.remove(attempt)
                attempt.future.cancel()
                self._scheduler.discard(attempt.executor)
                self._failed(attempt, f"it gave no answer within {self._settings.timeout:g} s", broken=True)

    def _answer(self, attempt):
        """What the worker answered; None where it died, after which the chunk is put back or ends the run."""
        try:
            return attempt.future.result()
        except BrokenExecutor as error:
            self._scheduler.discard(attempt.executor)
            timeout = self._settings.timeout
            late = "" if timeout is None else f", or took longer than {timeout:g} s and was ended"
            self._failed(attempt, f"its worker died{late} ({type(error).__name__}: {error})", broken=True)
        except Exception as error:
            # Dask, too, reports an error for every chunk that waited at a worker that died.
            lost = f"no answer came back ({type(error).__name__}: {error})"
            self._failed(attempt, lost, broken=True, cause=error)
        return None

    def _isLate(self, attempt):
        timeout = self._settings.timeout
        if timeout is None:
            return False
        now = time.monotonic()
        if attempt.started is None and attempt.future.running():
            attempt.started = now
        if attempt.started is None:
            # It waits in a queue, or it runs and the executor does not say so: another chunk that ends shows progress.
            quiet = now - max(self._progress, attempt.submitted)
            return self._workers > 0 and quiet > _SILENT_FACTOR * timeout + _SILENT_GRACE
        if not isinstance(attempt.executor, ThreadPoolExecutor):
            timeout = 2.0 * timeout + _GRACE
        return now - attempt.started > timeout

    def _failed(self, attempt, reason, worker="", broken=False, cause=None):
        """Put a chunk back, or end the run: an attempt ended so, and where it is broken it may have been another's."""
        chunk, others = attempt.chunk, len(self._attempts)
        left = self._settings.maximumAttempts - len(chunk.failures) - 1
        if left <= 0:
            if broken and others and not attempt.isolated:
                reason += f"; it may have been one of the {others} chunks beside it"
            raise chunk.error(reason, worker) from cause
        chunk.failures.append((worker, reason))
        self._retries.append((chunk, broken and left == 1))


def _preferred_workers(executor, chunk):
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
    # mpi4py's pool has a public attribute, the pools of the standard library and of loky have a private one.
    return getattr(executor, "num_workers", None) or getattr(executor, "_max_workers", None) or os.cpu_count() or 1


def endExecutor(executor: Executor) -> None:
    """Shut an executor down without waiting for its work: its processes are killed; threads go on."""
    processes = list((getattr(executor, "_processes", None) or {}).values())
    for process in processes:
        process.kill()
    executor.shutdown(wait=bool(processes), cancel_futures=True)
