"""Chunks of work on any executor: in order, few at once, and tried again on another worker if one fails.

pebble's pool of processes has time limits and names the task that killed its process, but it is no
``concurrent.futures.Executor``: clusters and executors that are given would need all of this beside it. loky and
``concurrent.futures`` report an error for every task of a pool whose process died. Neither they nor Dask have time
limits.
"""

import contextlib
import dataclasses
import logging
import math
import os
import statistics
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
from typing import Any

from satsep_ot.deprecation import DeprecatedAlias
from satsep_ot.methods.parallel.chunks import Chunk, ChunkError, Work
from satsep_ot.methods.parallel.processor import MixedProcessorsError
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
# A worker of a cluster that has not been heard of for so long, where others have, gets no work [s].
_SILENCE = 30.0
# Without any progress for so long it is said what is waited for [s].
_QUIET = 30.0
# Before the first chunk is finished, a measured time limit is so many times its least [-].
_UNMEASURED = 10.0
# For processes to end by themselves [s].
_ENDING = 5.0

_log = logging.getLogger("satsep_ot")


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
        self._measured: tuple[float, float] | None = None
        self._mixed = False
        self._processors: set[str] = set()
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

    def setMeasuredTimeout(self, factor: float = 20.0, least: float = 60.0) -> None:
        """Let a chunk take so many times the median time of those that are finished, and `least` seconds at least.

        Where nothing is finished yet it is ten times `least`. A worker that is stopped is found by this without a time
        that somebody must know beforehand. `setTimeout` goes before it.
        """
        if not (factor >= 1.0 and 0.0 < least < threading.TIMEOUT_MAX):
            raise ValueError(f"factor = {factor}, least = {least} s; they must be at least 1, and positive")
        self._measured = float(factor), float(least)

    def setMixedProcessorsAllowed(self, allowed: bool) -> None:
        """Whether workers may differ in processor and versions (default: no), and so in the last bits of numbers."""
        self._mixed = bool(allowed)

    def getProcessors(self) -> list[str]:
        """Processors and versions of the workers that have answered so far, one line each."""
        return sorted(self._processors)

    def setProcessors(self, processors: Iterable[str]) -> None:
        """What workers must have to be no mixture: such as those of this process, or of runs that are there already."""
        self._processors = set(processors)

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
            ending, self._executor = self._executor, None
            processes, kill = list((getattr(ending, "_processes", None) or {}).values()), _killer(ending)
            ending.shutdown(wait=not processes)
            limit = time.monotonic() + _ENDING
            for process in processes:
                # One that is stopped does not end by itself.
                process.join(max(limit - time.monotonic(), 0.0))
            kill()

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
                self._timeout,
                self._measured,
                self._maximumAttempts,
                self._clusterTimeLimit,
                self._factory is not None,
                self._mixed,
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


# Seconds that the thread of a pool is given to see that its processes are dead.
_MANAGER_SECONDS = 5.0


@dataclasses.dataclass(frozen=True)
class _Settings:
    """What a run on an executor takes from its scheduler."""

    timeout: float | None
    measured: tuple[float, float] | None
    maximumAttempts: int
    clusterTimeLimit: float
    replaceable: bool
    mixed: bool


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
        self._durations: list[float] = []
        self._silent: set[str] = set()
        self._said = 0.0

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
                self._sayWhatIsWaitedFor()
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
            self._silent = _silent_workers(self._scheduler.getExecutor())
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
                future = executor.submit(*call, **_preferred_workers(executor, chunk, self._silent))
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
                self._checkProcessor(answer.processor, attempt.executor)
                if answer.reason is not None:
                    cause = RuntimeError(f"on the worker:\n{answer.traceback}")
                    self._failed(attempt, answer.reason, answer.worker, cause=cause)
                    continue
                reason = self._check(attempt.chunk, answer.result)
                if reason:
                    self._failed(attempt, reason, answer.worker)
                    continue
                self._progress = time.monotonic()
                self._durations.append(self._progress - (attempt.started or attempt.submitted))
                yield attempt.chunk, answer.result
            elif self._isLate(attempt):
                self._attempts.remove(attempt)
                attempt.future.cancel()
                self._scheduler.discard(attempt.executor)
                limit = self._settings.timeout or self._measuredLimit()
                _log.warning("%s gave no answer within %.3g s and is tried elsewhere", attempt.chunk.label, limit)
                self._failed(attempt, f"it gave no answer within {limit:.3g} s", broken=True)

    def _checkProcessor(self, processor, executor):
        """Refuse a worker that may compute other last bits than those before; threads are of this process."""
        known = self._scheduler._processors
        if isinstance(executor, ThreadPoolExecutor) or processor in known:
            return
        if known and not self._settings.mixed:
            raise MixedProcessorsError(min(known), processor)
        known.add(processor)

    def _measuredLimit(self):
        """Of the time of a chunk [s], from those that are finished."""
        factor, least = self._settings.measured
        if not self._durations:
            return _UNMEASURED * least
        return max(least, factor * statistics.median(self._durations))

    def _sayWhatIsWaitedFor(self):
        """After some time without any progress, and again each time that this has doubled."""
        quiet = time.monotonic() - self._progress
        if quiet < _QUIET:
            self._said = 0.0
        elif self._attempts and quiet >= max(2.0 * self._said, _QUIET):
            self._said = quiet
            since = time.strftime("%H:%M:%S", time.localtime(time.time() - quiet))
            who = _workers_in_words(self._attempts[0].executor, self._silent)
            _log.warning("waiting for %s since %s: %s", who, since, self._attempts[0].chunk.label)

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
        now = time.monotonic()
        if attempt.started is None and attempt.future.running():
            attempt.started = now
        if timeout is None:
            if self._settings.measured is None or isinstance(attempt.executor, ThreadPoolExecutor):
                return False
            # A chunk in a queue has time for those before it.
            since = max(self._progress, attempt.submitted) if attempt.started is None else attempt.started
            return self._workers > 0 and now - since > self._measuredLimit()
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


def _silent_workers(executor):
    """Addresses of the workers of a cluster that have not been heard of for some time, while others have."""
    client = getattr(executor, "_client", None)
    if client is None:
        return set()
    with contextlib.suppress(Exception):
        # By default newer versions tell of some workers only.
        try:
            workers = client.scheduler_info(n_workers=-1)["workers"]
        except TypeError:
            workers = client.scheduler_info()["workers"]
        # By the clock of the scheduler.
        latest = max((worker["last_seen"] for worker in workers.values()), default=0.0)
        return {address for address, worker in workers.items() if latest - worker["last_seen"] > _SILENCE}
    return set()


def _workers_in_words(executor, silent):
    """Who may be the reason for a wait."""
    if silent:
        return f"worker {', '.join(sorted(silent))}, which is silent"
    processes = list((getattr(executor, "_processes", None) or {}).values())
    stopped = [str(process.pid) for process in processes if _is_stopped(process.pid)]
    if stopped:
        return f"worker process {', '.join(stopped)}, which is stopped"
    return f"worker processes {', '.join(str(process.pid) for process in processes)}" if processes else "the workers"


def _is_stopped(pid):
    with contextlib.suppress(OSError), open(f"/proc/{pid}/stat", encoding="utf-8", errors="replace") as stream:
        return stream.read().rpartition(")")[2].split()[0] in ("T", "t")
    return False


def _preferred_workers(executor, chunk, silent):
    """What asks a cluster for a worker that has not failed at the chunk, and that answers.

    A worker that fails at once is the first one to be idle, and would get all that is tried again.
    """
    failed = {worker for worker, _ in chunk.failures} | silent
    if not failed or not hasattr(executor, "_client") or isinstance(executor, ThreadPoolExecutor):
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
    _killer(executor)()


def _killer(executor):
    """What kills the processes of an executor, which does not know them any more once it is shut down."""
    processes = list((getattr(executor, "_processes", None) or {}).values())
    calls, results = getattr(executor, "_call_queue", None), getattr(executor, "_result_queue", None)
    manager = getattr(executor, "_executor_manager_thread", None)

    def kill():
        for process in processes:
            process.kill()
        executor.shutdown(wait=False, cancel_futures=True)
        if manager is not None:
            # It ends by itself where it sees that its processes are dead, and closes the pipe; two at once would fail.
            manager.join(_MANAGER_SECONDS)
        if manager is not None and manager.is_alive():
            with contextlib.suppress(AttributeError, OSError):
                # A process that was killed while it wrote has left half a result, whose rest is waited for as long as
                # anybody may write.
                results._writer.close()
            with contextlib.suppress(AttributeError, OSError):
                # The thread that fills the pipe of a pool waits for ever where nobody reads it any more.
                calls._reader.close()
            manager.join()
        for process in processes:
            process.join()

    return kill
