"""Ctrl-C ends the program within a second, with its last words, wherever it is."""

import _thread
import contextlib
import os
import signal
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator

PATIENCE = 0.7  # s that an interrupt may go unheard
INTERRUPTED = 130  # the exit code, as shells have it

_last_words = []
_ending = threading.Lock()


@contextlib.contextmanager
def last_words(act: Callable[[], object]) -> Iterator[None]:
    """Within this block, an interrupt that ends the process calls `act` before: it keeps and says what there is.

    Parameters
    ----------
    act : callable
        Without arguments. The innermost block comes first.

    Examples
    --------
    >>> from satsep_ot.interruption import last_words
    >>> with last_words(lambda: print("interrupted")):
    ...     print("at work")
    at work
    """
    _last_words.append(act)
    try:
        yield
    except KeyboardInterrupt:
        # Whoever catches it keeps and says what there is: nobody else is to.
        _ending.acquire(blocking=False)
        raise
    finally:
        _last_words.remove(act)


def listen() -> None:
    """Let an interrupt end this process within a second; to be called once, in the main thread.

    Where only Python runs it raises KeyboardInterrupt, as ever. But OpenTURNS (1.27) answers the signal itself while an
    algorithm runs, by a jump over Python's frames that may corrupt them, and takes an exception of a callback for a
    failed run. So the signal is kept from the main thread and awaited by a second one. Where Python then runs below
    OpenTURNS, the process says its last words and ends on the spot; where no Python runs, the second thread ends it.
    What holds the interpreter meanwhile is waited for: Tvedt's formula for 100 inputs, some seconds.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    signal.signal(signal.SIGINT, _hear)
    threading.Thread(target=_await, daemon=True).start()


def end(code: int = INTERRUPTED) -> None:
    """End the process at once: libraries that were interrupted half-way may crash when they are taken down in order."""
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def _await():
    signal.sigwait({signal.SIGINT})
    _thread.interrupt_main()
    time.sleep(PATIENCE)
    _say_and_end()


def _hear(_, frame):
    while (frame := frame.f_back) is not None:
        if f"{os.sep}openturns{os.sep}" in frame.f_code.co_filename:
            _say_and_end()
    raise KeyboardInterrupt


def _say_interrupted():
    print("satsep-ot: interrupted", file=sys.stderr)


def _say_and_end():
    if not _ending.acquire(blocking=False):
        # Another thread is at it, and may take a little longer.
        time.sleep(5.0 * PATIENCE)
        end()
    try:
        for act in reversed(_last_words or [_say_interrupted]):
            act()
    except Exception:
        traceback.print_exc()
    finally:
        end()
