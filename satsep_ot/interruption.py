"""Ctrl-C ends a command within a second, whatever it does: the process that hears it only watches another at work."""

import contextlib
import ctypes
import os
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path

INTERRUPTED = 128 + signal.SIGINT  # the exit code, as shells have it
PATIENCE = 0.3  # s that the killed processes may take to end, and then the last words to be said

# linux/prctl.h
_SET_PARENT_DEATH_SIGNAL = 1
_SET_CHILD_SUBREAPER = 36
# A progress bar that is cut off leaves its line, and the cursor hidden.
_CLEAR = "\r\x1b[2K\x1b[?25h"


def supervise(kept: Callable[[], str]) -> None:
    """Do all that follows in a child of this process; to be called once, before there are threads.

    Only the child returns. This process, whose number shells and job managers know, waits for the child's end and ends
    likewise. On SIGINT and SIGTERM, unless they were ignored from the start on, it kills the child, ends what the child
    has started (by SIGTERM), and says what is kept. It says so, too, if the child dies of a signal. If it is killed
    itself, the kernel kills the child.

    No handler in the child could be relied on: libraries hold the interpreter's lock for seconds, and OpenTURNS (1.27)
    answers SIGINT itself while an algorithm runs, by a jump over Python's frames or a failure that would pass for the
    algorithm's result. So the child and what it starts do not get SIGINT at all.

    Parameters
    ----------
    kept : callable
        Without arguments; what an interrupted command leaves, in words.
    """
    watched = {number for number in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(number) != signal.SIG_IGN}
    watched.add(signal.SIGCHLD)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, watched)
    control = ctypes.CDLL(None).prctl
    # What a killed child leaves becomes ours.
    control(_SET_CHILD_SUBREAPER, 1)
    parent = os.getpid()
    child = os.fork()
    if child:
        _watch(child, watched, kept)
    control(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(INTERRUPTED)
    signal.pthread_sigmask(signal.SIG_SETMASK, before | {signal.SIGINT})


def _watch(child, watched, kept):
    """Wait for the end of the child, or bring it about, and end."""
    while True:
        number = signal.sigwait(watched)
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended and os.WIFEXITED(status):
            os._exit(os.WEXITSTATUS(status))
        if ended:
            number = os.WTERMSIG(status)
        elif number == signal.SIGCHLD:
            # The child was stopped, or something that it had left has ended.
            continue
        else:
            os.kill(child, signal.SIGKILL)
        _end_all()
        # A terminal that is held, or a full pipe, would hold us as well.
        speaker = threading.Thread(target=_say, args=(number, kept), daemon=True)
        speaker.start()
        speaker.join(PATIENCE)
        os._exit(128 + number)


def _end_all():
    """Wait for the end of all children, and end those that come to us when their parent ends."""
    limit = time.monotonic() + PATIENCE
    while time.monotonic() < limit:
        try:
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
        except ChildProcessError:
            return
        # Not SIGKILL: the one that removes the semaphores of a pool ignores this, and ends when it has done so.
        for orphan in _children():
            os.kill(orphan, signal.SIGTERM)
        time.sleep(0.002)


def _children():
    try:
        return [int(number) for number in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split()]
    except OSError:
        return []


def _say(number, kept):
    how = "interrupted" if number == signal.SIGINT else f"ended by signal {number} ({signal.strsignal(number)})"
    clear = _CLEAR if os.isatty(2) and os.environ.get("TERM", "dumb") != "dumb" else ""
    with contextlib.suppress(OSError):
        os.write(2, os.fsencode(f"{clear}satsep-ot: {how}; {kept()}\n"))
