"""Functions that workers fail at, a given number of times, whichever process they run in."""

import os
import signal
import threading
import time

import numpy as np


class Twice:
    """Twice the input, rows (N, 1); `deed` is done where a row holds `where`, the first `times` times."""

    def __init__(self, deed, where, times, folder):
        self.deed, self.where, self.times, self.folder = deed, where, times, str(folder)

    def __call__(self, X):
        X = np.asarray(X, dtype=float)
        if np.any(self.where == X) and self.isDue():
            changed = self.deed(2.0 * X)
            if changed is not None:
                return changed
        return 2.0 * X

    # A model that is asked through arrays.
    evaluate = __call__

    def isDue(self):
        """Whether it is to be done once more, which counts."""
        for attempt in range(self.times):
            try:
                os.close(os.open(os.path.join(self.folder, f"deed-{attempt}"), os.O_CREAT | os.O_EXCL))
                return True
            except FileExistsError:
                pass
        return False


def die(values):
    os.kill(os.getpid(), signal.SIGKILL)


def hang(values):
    time.sleep(1000.0)


def stop_short(values):
    time.sleep(0.5)


def raise_error(values):
    raise ArithmeticError("the licence server is away")


def lose_rows(values):
    return values[:-1]


def forget_values(values):
    return values * np.nan


def return_text(values):
    return "42"


def leave(values):
    raise SystemExit(3)


class Unsendable(Exception):
    """It cannot be pickled, nor made again from its text."""

    def __init__(self, first, second):
        super().__init__(f"{first} and {second}")
        self.lock = threading.Lock()


def raise_unsendable(values):
    raise Unsendable("this", "that")


def return_lock(values):
    return threading.Lock()


def stop(values):
    os.kill(os.getpid(), signal.SIGSTOP)
