"""What a worker does: one chunk in a thread or a process, within its time limit, and the answer."""

import contextlib
import dataclasses
import faulthandler
import functools
import os
import pickle
import sys
import threading
import time
import traceback
import zlib
from collections.abc import Callable, Iterator
from typing import Any

from satsep_ot.methods.parallel.processor import processorDescription
from satsep_ot.openturns_adapter import errorMessage


@dataclasses.dataclass
class Answer:
    """The result of the work and the worker; an error as text, since an exception need not survive a pickle.

    Attributes
    ----------
    worker : str
    result : object
    reason : str or None
        Why there is no result.
    traceback : str
    processor : str
        See :func:`~satsep_ot.methods.parallel.processor.processorDescription`.
    """

    worker: str
    result: Any = None
    reason: str | None = None
    traceback: str = ""
    processor: str = dataclasses.field(default_factory=processorDescription)

    @staticmethod
    def of(worker: str, compute: Callable[[], Any]) -> "Answer":
        """The answer of a worker that computes."""
        try:
            return Answer(worker, compute())
        except BaseException as error:
            # Whatever it is: a model that calls sys.exit is not to end the process that waits for it.
            reason = f"{type(error).__name__}: {errorMessage(error)}"
            return Answer(worker, None, reason, traceback.format_exc())


def work_in_thread(function: Callable[[Any], Any], argument: Any) -> Answer:
    """The work on a chunk, in a thread of the process that waits for it."""

    def compute():
        with _one_thread():
            return function(argument)

    return Answer.of(f"thread {threading.current_thread().name}", compute)


def work_in_process(payload: bytes, argument: Any, timeout: float | None, parent: int) -> Answer:
    """The work on a chunk, in a process that is ended if it takes too long.

    Parameters
    ----------
    payload : bytes
        Of the :class:`~satsep_ot.methods.parallel.chunks.Work`.
    argument : object
    timeout : float or None
        Seconds.
    parent : int
        Number of the process that waits, which may be this one and is not ended.
    """

    def compute():
        # A worker's first chunk loads libraries too, which the time of a chunk is not meant for.
        function = load(payload)
        with _deadline(timeout if os.getpid() != parent else None), _one_thread():
            return function(argument)

    return Answer.of(_worker_name(), compute)


@functools.lru_cache(maxsize=8)
def load(payload: bytes) -> Callable[[Any], Any]:
    """The function of a payload, loaded once."""
    return pickle.loads(zlib.decompress(payload))


def _worker_name():
    """The address of a Dask worker, or which process this is."""
    distributed = sys.modules.get("distributed")
    if distributed is not None:
        with contextlib.suppress(ValueError):
            return distributed.get_worker().address
    return f"process {os.getpid()} on {os.uname().nodename}"


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
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
_deadlines_lock = threading.Lock()


@contextlib.contextmanager
def _deadline(seconds: float | None) -> Iterator[None]:
    """End this process if the block takes longer, from a thread of C that needs no lock of the interpreter."""
    if seconds is None:
        yield
        return
    me = threading.get_ident()
    with _deadlines_lock:
        _deadlines[me] = time.monotonic() + seconds
        _set_alarm()
    try:
        yield
    finally:
        with _deadlines_lock:
            del _deadlines[me]
            _set_alarm()


def _set_alarm():
    # A process has one alarm; a worker with several threads needs the earliest.
    faulthandler.cancel_dump_traceback_later()
    if _deadlines:
        left = min(_deadlines.values()) - time.monotonic()
        faulthandler.dump_traceback_later(max(left, 1e-3), exit=True, file=sys.__stderr__)
