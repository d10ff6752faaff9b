"""Ctrl-C ends a command within a second: one process does the work, and another one receives the signals."""

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from collections.abc import Callable

INTERRUPTED = 128 + signal.SIGINT  # the exit code, as shells have it
ENDING_TIME = 0.3  # s for the killed processes to end, and then for the message to be written

# linux/prctl.h
_SET_PARENT_DEATH_SIGNAL = 1
_SET_CHILD_SUBREAPER = 36
# A progress bar that is cut off leaves its line, and the cursor hidden.
_CLEAR = "\r\x1b[2K\x1b[?25h"


def supervise(kept: Callable[[], str]) -> None:
    """Do all that follows in a child of this process; to be called once, before there are threads.

    Only the child returns. This process, which shells and job managers know, waits for the child's end and ends with
    the same code or signal. On SIGINT and SIGTERM, unless they were ignored from the start on, it kills the child, ends
    what the child has started (by SIGTERM), and says what is kept. It says so, too, if the child ends by a signal. If
    it is killed itself, the kernel kills the child. Ctrl-Z stops both.

    A handler in the child is not reliable: libraries hold the interpreter's lock for seconds, and OpenTURNS (1.27)
    answers SIGINT itself while an algorithm runs, by a jump over Python's frames or a failure that would pass for the
    algorithm's result. So the child and what it starts are a process group of their own, which Ctrl-C does not reach.

    This needs Linux; elsewhere it does nothing, and Ctrl-C is Python's KeyboardInterrupt.

    Parameters
    ----------
    kept : callable
        Without arguments; what an interrupted command leaves, in words.
    """
    if sys.platform != "linux":
        return
    handled = {signal.SIGINT, signal.SIGTERM, signal.SIGTSTP}
    watched = {number for number in handled if signal.getsignal(number) != signal.SIG_IGN} | {signal.SIGCHLD}
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, watched)
    # Processes that a killed child leaves become children of this one, which can wait for them.
    ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1)
    parent = os.getpid()
    child = os.fork()
    return _watch(child, watched, kept) if child else _work(parent, before)


def _work(parent, before):
    """Make this process the child of that parent, with the signals blocked that were blocked before."""
    os.setpgid(0, 0)
    ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(INTERRUPTED)
    # Not in the foreground, it would otherwise be stopped by what it prints, on terminals that are set so.
    signal.signal(signal.SIGTTOU, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_SETMASK, before | {signal.SIGINT})
    # The process that removes the semaphores of a pool that was killed is not to warn of them: it inherits this.
    sys.warnoptions.append("ignore:resource_tracker:UserWarning")


def _watch(child, watched, kept):
    """Wait for the end of the child, or bring it about, and end."""
    os.setpgid(child, child)
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
        elif number == signal.SIGTSTP:
            os.killpg(child, signal.SIGSTOP)
            os.kill(os.getpid(), signal.SIGSTOP)
            os.killpg(child, signal.SIGCONT)
            continue
        else:
            os.kill(child, signal.SIGKILL)
        _end_rest(child)
        # A terminal that is held, or a full pipe, would hold us as well.
        speaker = threading.Thread(target=_say, args=(number, kept), daemon=True)
        speaker.start()
        speaker.join(ENDING_TIME)
        os._exit(128 + number)


def _end_rest(group):
    """End what the child has started, and wait for the end of all."""
    with contextlib.suppress(ProcessLookupError):
        # Not SIGKILL: the process that removes the semaphores of a pool ignores this, and ends when it has done so.
        os.killpg(group, signal.SIGTERM)
    limit = time.monotonic() + ENDING_TIME
    with contextlib.suppress(ChildProcessError):
        while time.monotonic() < limit:
            if not os.waitpid(-1, os.WNOHANG)[0]:
                time.sleep(0.002)


def _say(number, kept):
    how = "interrupted" if number == signal.SIGINT else f"ended by signal {number} ({signal.strsignal(number)})"
    clear = _CLEAR if os.isatty(2) and os.environ.get("TERM", "dumb") != "dumb" else ""
    with contextlib.suppress(OSError):
        os.write(2, os.fsencode(f"{clear}satsep-ot: {how}; {kept()}\n"))
