"""Faults that a worker has at a row, a given number of times, whichever process it runs in."""

import os
import signal
import threading
import time

import numpy as np


class DoublingWithFault:
    """Twice the input, rows (N, 1), with a fault in the first calls that hold a row.

    Parameters
    ----------
    fault : callable
        Called with what would be returned; returns what is returned in its place, or None.
    row : float
        Value of the row.
    times : int
        In how many calls.
    folder : path
        Keeps their number, for all processes.
    """

    def __init__(self, fault, row, times, folder):
        self.fault, self.row, self.times, self.folder = fault, row, times, str(folder)

    def __call__(self, X):
        X = np.asarray(X, dtype=float)
        if np.any(self.row == X) and self.is_due():
            changed = self.fault(2.0 * X)
            if changed is not None:
                return changed
        return 2.0 * X

    # A model that is asked through arrays.
    evaluate = __call__

    def is_due(self):
        """Whether there is to be one more fault, which counts."""
        for attempt in range(self.times):
            try:
                os.close(os.open(os.path.join(self.folder, f"fault-{attempt}"), os.O_CREAT | os.O_EXCL))
                return True
            except FileExistsError:
                pass
        return False


def kill_worker(values):
    os.kill(os.getpid(), signal.SIGKILL)


def sleep_for_ever(values):
    time.sleep(1000.0)


def pause(values):
    time.sleep(0.5)


def raise_error(values):
    raise ArithmeticError("the licence server is away")


def drop_row(values):
    return values[:-1]


def return_nan(values):
    return values * np.nan


def return_text(values):
    return "42"


def exit_process(values):
    raise SystemExit(3)


class Unpicklable(Exception):
    """It cannot be pickled, nor made again from its text."""

    def __init__(self, first, second):
        super().__init__(f"{first} and {second}")
        self.lock = threading.Lock()


def raise_unpicklable(values):
    raise Unpicklable("this", "that")


def return_lock(values):
    return threading.Lock()


def stop_process(values):
    os.kill(os.getpid(), signal.SIGSTOP)


def die_while_writing(marker):
    """A long result, of which half is written when this process is killed; where the marker is there, 7."""
    if os.path.exists(marker):
        return 7
    with open(marker, "w", encoding="ascii"):
        pass

    def watch(task):
        # The number of the system call, and its arguments: a file, an address, and the length of what is written.
        call = []
        while len(call) < 4 or int(call[3], 16) not in range(size, 2 * size):
            time.sleep(1e-4)
            with open(f"/proc/self/task/{task}/syscall", encoding="ascii") as stream:
                call = stream.read().split()
        os.kill(os.getpid(), signal.SIGKILL)

    size = 300_000_000
    threading.Thread(target=watch, args=(threading.get_native_id(),), daemon=True).start()
    return bytes(size)
