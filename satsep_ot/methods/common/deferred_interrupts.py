"""Ctrl-C that waits for the end of a block which would swallow it, or be broken by it."""

import contextlib
import signal
import threading
from collections.abc import Iterator


@contextlib.contextmanager
def deferredInterrupts() -> Iterator[None]:
    """A block after which Ctrl-C that came inside has its effect; short ones only. In other threads it does nothing.

    Examples
    --------
    >>> import signal
    >>> from satsep_ot.methods.common.deferred_interrupts import deferredInterrupts
    >>> try:
    ...     with deferredInterrupts():
    ...         signal.raise_signal(signal.SIGINT)
    ...         print("the end of the block")
    ... except KeyboardInterrupt:
    ...     print("interrupted")
    the end of the block
    interrupted
    """
    handler = signal.getsignal(signal.SIGINT)
    # Python calls handlers in its main thread only, which alone may set them.
    if threading.current_thread() is not threading.main_thread() or not callable(handler):
        yield
        return
    seen: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: seen.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if seen:
            signal.raise_signal(signal.SIGINT)
