"""What all tests need of their process."""

import signal


def pytest_configure():
    # A shell that runs the tests in the background has them ignore SIGINT; so would the programs that they interrupt.
    signal.signal(signal.SIGINT, signal.default_int_handler)
