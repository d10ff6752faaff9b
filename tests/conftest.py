"""What all tests need of their process."""

import os
import signal

# Before numpy is loaded. Matrices in tests are small: several threads wait for each other longer than they compute.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


def pytest_configure():
    # A shell that runs the tests in the background has them ignore SIGINT; so would the programs that they interrupt.
    signal.signal(signal.SIGINT, signal.default_int_handler)
