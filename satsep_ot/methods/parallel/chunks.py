"""Chunks of work, the error of one that could not be finished, and the work itself as it is sent to workers."""

import dataclasses
import functools
import pickle
import zlib
from collections.abc import Callable, Sequence
from typing import Any

from satsep_ot.openturns_adapter import picklingGlobals

try:
    # It pickles functions of scripts and lambdas too, and comes with Dask.
    import cloudpickle as pickler
except ImportError:
    pickler = pickle


class ChunkError(RuntimeError):
    """A chunk could not be finished.

    Attributes
    ----------
    first, end : int
        Its rows are first to end - 1.
    failures : tuple of (str, str)
        Of each attempt the worker, where it is known, and how it ended.
    name : str
        What it is called in the message; empty for its rows.
    finished : dict of int to object
        Results of later chunks that had finished already, by their first row.

    Examples
    --------
    >>> from satsep_ot.methods.parallel.chunks import ChunkError
    >>> print(ChunkError(20, 30, [("process 7 on node3", "OSError: disk full"), ("", "its worker died")]))
    rows 20 to 29 could not be computed in 2 attempts, the last of which ended so: its worker died; before it: \
OSError: disk full (process 7 on node3)
    """

    def __init__(self, first: int, end: int, failures: Sequence[tuple[str, str]], name: str = "") -> None:
        self.first, self.end, self.failures, self.name = first, end, tuple(failures), name
        self.finished: dict[int, Any] = {}
        tries = "1 attempt, which" if self.attempts == 1 else f"{self.attempts} attempts, the last of which"
        what = name or f"rows {first} to {end - 1}"
        super().__init__(f"{what} could not be computed in {tries} ended so: {self.reason}")

    @property
    def attempts(self) -> int:
        """How often it was tried."""
        return len(self.failures)

    @property
    def reason(self) -> str:
        """How the last attempt ended, and those before it where that adds anything."""
        *before, (worker, last) = self.failures
        earlier = [
            f"{'the same' if reason == last else reason}{where and f' ({where})'}"
            for where, reason in before
            if where or reason != last
        ]
        return f"{last}{worker and f' ({worker})'}" + (f"; before it: {'; '.join(earlier)}" if earlier else "")

    def __reduce__(self):
        return ChunkError, (self.first, self.end, self.failures, self.name)


class Work:
    """A callable of one argument that is pickled once here and loaded once by each worker.

    Parameters
    ----------
    function : callable
        Not to be changed afterwards.

    Examples
    --------
    >>> import math
    >>> from satsep_ot.methods.parallel.chunks import Work
    >>> Work(math.sqrt).function(4.0)
    2.0
    """

    def __init__(self, function: Callable[[Any], Any]) -> None:
        self.function = function

    @functools.cached_property
    def payload(self) -> bytes:
        """The function as workers get it, with every chunk: they know it again by its bytes."""
        try:
            with picklingGlobals():
                pickled = pickler.dumps(self.function)
            # OpenTURNS' objects are XML in their pickles, a fifteenth of it when compressed.
            return zlib.compress(pickled, 1)
        except Exception as error:
            raise TypeError(
                f"the function cannot be sent to another process ({type(error).__name__}: {error}); define it at the "
                "top of a module, without locks and open files, or give a ThreadPoolExecutor"
            ) from error

    def __deepcopy__(self, memo):
        return self

    def __reduce__(self):
        return Work, (self.function,)


@dataclasses.dataclass(eq=False)
class Chunk:
    """Rows of a larger whole, and what the work is called with for them.

    Attributes
    ----------
    first, end : int
        The rows are first to end - 1.
    argument : object
    name : str
        What an error calls it; empty for its rows.
    failures : list of (str, str)
        Of each attempt so far the worker, where it is known, and how it ended.
    """

    first: int
    end: int
    argument: Any
    name: str = ""
    failures: list[tuple[str, str]] = dataclasses.field(default_factory=list)

    @property
    def label(self) -> str:
        """What messages call it."""
        return self.name or f"rows {self.first} to {self.end - 1}"

    def error(self, reason: str, worker: str = "") -> ChunkError:
        """The error after one more attempt that ended so."""
        return ChunkError(self.first, self.end, [*self.failures, (worker, reason)], self.name)
