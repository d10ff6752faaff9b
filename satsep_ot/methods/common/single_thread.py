"""Linear algebra on one thread where the matrices are small.

A search for a subspace does some ten thousand factorisations of matrices of a few hundred rows. Split over threads,
each of them waits longer for its threads than it computes, the more so on a machine that others use as well: measured
here, minutes instead of seconds.
"""

import contextlib
import functools
import importlib

from threadpoolctl import ThreadpoolController


@functools.cache
def _libraries():
    # Only what is loaded is found. Looking once is enough, and far slower than switching.
    for user in ("numpy.linalg", "scipy.linalg"):
        importlib.import_module(user)
    return ThreadpoolController().select(user_api="blas").lib_controllers


class singleThread(contextlib.ContextDecorator):
    """A block (or, as a decorator, a function) in which the linear algebra libraries use one thread; then as before.

    It takes some microseconds, less than threadpoolctl's own, which looks at more than the number of threads.
    """

    def __enter__(self):
        self._switched = [(library, library.get_num_threads()) for library in _libraries()]
        self._switched = [(library, number) for library, number in self._switched if number != 1]
        for library, _ in self._switched:
            library.set_num_threads(1)

    def __exit__(self, *exception):
        for library, number in self._switched:
            library.set_num_threads(number)

    def _recreate_cm(self):
        # Calls of a decorated function may be nested: each keeps its own numbers.
        return singleThread()
