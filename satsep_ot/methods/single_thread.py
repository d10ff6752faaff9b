"""Linear algebra on one thread where the matrices are small.

A search for a subspace does some ten thousand factorisations of matrices of a few hundred rows. Split over threads,
each of them waits longer for its threads than it computes, the more so on a machine that others use as well: measured
here, minutes instead of seconds.
"""

import contextlib
import functools

from threadpoolctl import ThreadpoolController


@functools.cache
def _controller():
    # The libraries are looked for once; that is slower than switching them.
    return ThreadpoolController()


@contextlib.contextmanager
def singleThread():
    """A block (or, as a decorator, a function) in which the linear algebra libraries use one thread; then as before."""
    with _controller().limit(limits=1, user_api="blas"):
        yield
