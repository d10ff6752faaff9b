"""Executors for functions and streams: processes on this machine, or a Dask cluster."""

import contextlib
import fcntl
import functools
import gc
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from multiprocessing import connection

from satsep_ot.methods.common.single_thread import singleThread


def processes(number: int | None = None) -> Callable[[], Executor]:
    """A callable that makes pools of processes on this machine.

    They start afresh instead of as copies of this process, whose threads a copy would not have; a script must
    therefore keep its own work below ``if __name__ == "__main__":``. Each uses one thread for linear algebra, leaves
    Ctrl-C to this process, and ends with it.

    Parameters
    ----------
    number : int, optional
        How many; by default as many as this process may use processors.

    Returns
    -------
    factory : callable
        Without arguments; gives a :class:`concurrent.futures.ProcessPoolExecutor`.

    Raises
    ------
    ValueError
        If the number is not a positive whole number.

    Examples
    --------
    >>> from satsep_ot.methods.parallel.executors import processes
    >>> with processes(2)() as pool:
    ...     pool.submit(abs, -1).result()
    1
    """
    if number is None:
        number = len(os.sched_getaffinity(0))
    if int(number) != number or number < 1:
        raise ValueError(f"the number of processes is {number}; it must be a whole number of at least 1")
    context = multiprocessing.get_context("spawn")
    return functools.partial(ProcessPoolExecutor, int(number), mp_context=context, initializer=_prepareProcess)


def _prepareProcess():
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    _endWithParent()
    singleThread().__enter__()


def _endWithParent():
    """Let the kernel kill this process when its parent ends, however that ends.

    Processes of a pool would otherwise wait for work for ever. A thread that waits for the parent would itself wait
    where a model that hangs holds the interpreter's lock.
    """
    # A pipe that the parent alone holds the other end of.
    pipe = multiprocessing.parent_process().sentinel
    fcntl.fcntl(pipe, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(pipe, fcntl.F_SETSIG, signal.SIGKILL)
    fcntl.fcntl(pipe, fcntl.F_SETFL, fcntl.fcntl(pipe, fcntl.F_GETFL) | fcntl.FASYNC)
    if connection.wait([pipe], timeout=0.0):
        os._exit(1)


@contextlib.contextmanager
def daskExecutor(address: str, timeout: float = 10.0) -> Iterator[Executor]:
    """The executor of a Dask cluster, for a ``with`` block.

    Parameters
    ----------
    address : str
        Of the scheduler, as it prints it: ``tcp://192.168.0.1:8786``.
    timeout : float
        Seconds to wait for it, and for its first worker.

    Raises
    ------
    ConnectionError
        If there is no scheduler at this address, or it has no worker.
    ImportError
        If Dask is not installed.
    """
    try:
        from distributed import Client
        from distributed.comm import get_address_host_port
    except ImportError as error:
        raise ImportError("a Dask cluster needs the package distributed, which is not installed") from error
    try:
        get_address_host_port(address)
    except ValueError as error:
        raise ConnectionError(f"{address} is no address of a Dask scheduler, such as tcp://192.168.0.1:8786") from error
    client = None
    try:
        client = Client(address, timeout=timeout, set_as_default=False)
    except Exception as error:
        # Of many kinds: what another kind of server answers is read as a number of bytes to allocate, for one.
        reason = str(error)
    if client is None:
        # A client that failed closes itself when it is collected, which never ends if another one just starts then.
        gc.collect()
        raise ConnectionError(f"no Dask scheduler answers at {address} within {timeout:g} s ({reason})")
    with client:
        try:
            client.wait_for_workers(1, timeout=timeout)
        except TimeoutError as error:
            raise ConnectionError(f"the Dask scheduler at {address} has no worker after {timeout:g} s") from error
        executor = client.get_executor(pure=False)
        try:
            yield executor
        finally:
            # The scheduler may be gone.
            with contextlib.suppress(Exception):
                executor.shutdown(wait=False)
