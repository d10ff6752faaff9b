"""True runs in the order of their making, and a file of them from which a killed computation continues."""

import dataclasses
import hashlib
import json
import os
import re
from collections import deque
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.storage import namingFile, writeWhole
from satsep_ot.openturns_adapter import callFunction, errorMessage, exactText, hasGradient, raiseInterrupt

_FORMAT = "satsep_ot checkpoint 1"
_ADDRESS = re.compile(" at 0x[0-9a-f]+")
# After so many runs of a block that fail, no more of them are tried one by one.
_FAILURES = 3
# Values of one model agree to this share of themselves, whatever the machine.
_MODEL_TOLERANCE = 1e-6


class IncompleteBlockError(RuntimeError):
    """Some runs of a block failed; the others are kept.

    Attributes
    ----------
    values : array (n, p)
        NaN where there is none.
    done : array (n,) of bool
    """

    def __init__(self, message: str, values: np.ndarray, done: np.ndarray) -> None:
        super().__init__(message)
        self.values, self.done = values, done


@dataclasses.dataclass(frozen=True, eq=False)
class LoggedBlock:
    """Calls of one function.

    Attributes
    ----------
    function : str
        What was called.
    points, values : array (n, d), (n, p)
    done : array (n,) of bool
        False where the call failed; the values there are NaN.
    """

    function: str
    points: np.ndarray
    values: np.ndarray
    done: np.ndarray

    def plain(self) -> dict[str, Any]:
        """As JSON has it: numbers come back to the last bit."""
        values = [row if done else None for row, done in zip(self.values.tolist(), self.done.tolist(), strict=True)]
        return {"function": self.function, "inputs": self.points.tolist(), "outputs": values}

    @staticmethod
    def fromPlain(content: dict[str, Any]) -> "LoggedBlock":
        """What `plain` has made."""
        rows = content["outputs"]
        done = np.array([row is not None for row in rows])
        size = max((len(row) for row in rows if row is not None), default=1)
        values = np.array([[np.nan] * size if row is None else row for row in rows], dtype=float)
        return LoggedBlock(content["function"], np.array(content["inputs"], dtype=float), values, done)


class RunLog:
    """Calls of functions in their order: those that a checkpoint has are not made again.

    Parameters
    ----------
    blocks : iterable of LoggedBlock
        Calls that were made before.
    append : callable, optional
        Called with each new block.
    place : str
        Of the file, for messages.

    Attributes
    ----------
    refused : ValueError or None
        Raised where other calls than the kept ones were asked for: the caller may get another error instead.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.common.run_log import RunLog
    >>> made = []
    >>> log = RunLog(append=made.append)
    >>> log.values("square", np.array([[2.0], [3.0]]), np.square, 1).tolist()
    [[4.0], [9.0]]
    >>> RunLog(made).values("square", np.array([[2.0], [3.0]]), None, 1).tolist()
    [[4.0], [9.0]]
    """

    def __init__(
        self,
        blocks: Iterable[LoggedBlock] = (),
        append: Callable[[LoggedBlock], None] | None = None,
        place: str = "the checkpoint",
    ) -> None:
        self._kept, self._append, self._place = deque(blocks), append, place
        self.refused: ValueError | None = None

    def values(
        self,
        name: str,
        points: np.ndarray,
        call: Callable[[np.ndarray], np.ndarray],
        dimension: int,
        tolerant: bool = False,
    ) -> np.ndarray:
        """Values (n, p) of a function at points (n, d).

        Where a call with all points raises, they are tried one by one, and what succeeds is kept.

        Parameters
        ----------
        name : str
            Of the function, the same in each run.
        points : array (n, d)
        call : callable
            The function, of arrays.
        dimension : int
            p.
        tolerant : bool
            Whether a call that fails has the value NaN; by default it raises.

        Raises
        ------
        IncompleteBlockError
            Some calls failed.
        ValueError
            The checkpoint is of other calls.
        """
        if self._kept:
            block = self._next(name, points)
            error: Exception | None = None
        else:
            block, error = _made(name, points, call, dimension, tolerant)
            if self._append is not None and (tolerant or block.done.any()):
                self._append(block)
        if tolerant or block.done.all():
            return block.values.copy()
        if error is None:
            # An earlier run has left these.
            values = block.values.copy()
            try:
                values[~block.done] = self.values(name, points[~block.done], call, dimension)
            except IncompleteBlockError as incomplete:
                done = block.done.copy()
                values[~block.done], done[~block.done] = incomplete.values, incomplete.done
                raise IncompleteBlockError(str(incomplete), values, done) from incomplete
            return values
        if not block.done.any():
            raise error
        first = points[int(np.argmin(block.done))].tolist()
        raise IncompleteBlockError(
            f"{np.count_nonzero(~block.done)} of {len(points)} runs failed or were not tried, the first at input "
            f"{first}: {errorMessage(error)}",
            block.values,
            block.done,
        ) from error

    def gradient(self, name: str, point: np.ndarray, function: ot.Function) -> np.ndarray:
        """Gradient (d, p) of a function at a point (d,)."""
        shape = (function.getInputDimension(), function.getOutputDimension())
        row = self.values(
            f"gradient of the {name}",
            point[None],
            lambda x: np.array(function.gradient(x[0])).reshape(1, -1),
            shape[0] * shape[1],
        )
        return row.reshape(shape)

    def checkModel(self, name: str, call: Callable[[np.ndarray], np.ndarray]) -> None:
        """Make one run of the checkpoint again.

        Raises
        ------
        ValueError
            Its values are others.
        """
        for block in self._kept:
            if block.function == name and block.done.any():
                row = int(np.argmax(block.done))
                before, now = block.values[row], call(block.points[row : row + 1])[0]
                size = float(np.abs(before[np.isfinite(before)]).max(initial=0.0))
                if before.shape != now.shape or not np.allclose(
                    now, before, _MODEL_TOLERANCE, 1e-9 * size, equal_nan=True
                ):
                    raise ValueError(
                        f"{self._place} is the checkpoint of another model: at input {block.points[row].tolist()} it "
                        f"has the output {before.tolist()}, and the function gives {now.tolist()}; give another file, "
                        "or remove it to begin anew"
                    )
                return

    def _next(self, name, points):
        block = self._kept.popleft()
        if block.function != name or block.points.shape != points.shape or block.points.tobytes() != points.tobytes():
            self.refused = ValueError(
                f"{self._place} has other runs than this computation asks for, as another machine or another version "
                "of a package may; give another file, or remove it to begin anew"
            )
            raise self.refused
        return block


def _made(name, points, call, dimension, tolerant):
    """A block, and the first error; after some errors the rest is not tried, unless errors are tolerated."""
    done = np.ones(len(points), dtype=bool)
    try:
        return LoggedBlock(name, points, call(points), done), None
    except Exception as error:
        raiseInterrupt(error)
        first = error
    values, done = np.full((len(points), dimension), np.nan), ~done
    for row in range(len(points) if len(points) > 1 else 0):
        if not tolerant and row - np.count_nonzero(done) >= _FAILURES:
            break
        try:
            values[row], done[row] = call(points[row : row + 1])[0], True
        except Exception as error:
            raiseInterrupt(error)
            first = error if row == 0 else first
    return LoggedBlock(name, points, values, done), first


def loggedFunction(log: RunLog, name: str, function: ot.Function) -> ot.Function:
    """The same function, whose calls a log keeps, those of its own gradient too.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.common.run_log import RunLog, loggedFunction
    >>> function = loggedFunction(RunLog(), "square", ot.SymbolicFunction("x", "x^2"))
    >>> function([3.0])[0], function.gradient([3.0])[0, 0]
    (9.0, 6.0)
    """
    d, p = function.getInputDimension(), function.getOutputDimension()

    def evaluate(sample):
        return log.values(name, np.array(sample, dtype=float), lambda x: callFunction(function, x), p)

    if not hasGradient(function):
        return ot.PythonFunction(d, p, func_sample=evaluate)
    return ot.PythonFunction(
        d, p, func_sample=evaluate, gradient=lambda point: log.gradient(name, np.array(point, dtype=float), function)
    )


class CheckpointFile:
    """True runs in a file that grows line by line, each with a checksum of all lines so far.

    Parameters
    ----------
    path : str or path
        Continued where it is there. What a killed process has left of a last line is dropped.
    fingerprint : dict of str to str
        What two computations must share for one to continue the other, by names for messages.
    start : dict
        What is kept in a new file beside that, such as the state of a random generator.

    Attributes
    ----------
    start : dict
        As the file has it.

    Raises
    ------
    ValueError
        The file is damaged, no checkpoint, or that of another computation.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from satsep_ot.methods.common.run_log import CheckpointFile
    >>> point = np.array([[2.0]])
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     file = CheckpointFile(f"{directory}/runs", {"target": "0.05"}, {"seed": 7})
    ...     value = file.log().values("square", point, np.square, 1)
    ...     again = CheckpointFile(f"{directory}/runs", {"target": "0.05"}, {"seed": 8})
    ...     again.start, again.log().values("square", point, None, 1).tolist()
    ({'seed': 7}, [[4.0]])
    """

    def __init__(self, path: str | os.PathLike, fingerprint: dict[str, str], start: dict[str, Any]) -> None:
        self._path = Path(path)
        self._sections: dict[str, dict[str, Any]] = {}
        self._blocks: dict[str, list[LoggedBlock]] = {}
        if self._path.exists():
            self._read(fingerprint)
        else:
            self._checksum = ""
            self.start = start
            line = self._line({"format": _FORMAT, "of": fingerprint, "start": start})
            writeWhole(self._path, lambda stream: stream.write(line))
            self._size = len(line)

    def log(self, section: str = "") -> RunLog:
        """The calls of one section."""

        def append(block):
            self._append({"section": section, **block.plain()})

        return RunLog(self._blocks.pop(section, ()), append, str(self._path))

    def enterSection(self, section: str, state: dict[str, Any]) -> dict[str, Any]:
        """The state at the beginning of a section: the kept one, or this one, which is kept then."""
        if section not in self._sections:
            self._sections[section] = state
            self._append({"section": section, "state": state})
        return self._sections[section]

    def _read(self, fingerprint):
        content = self._path.read_bytes()
        whole = content[: content.rfind(b"\n") + 1]
        self._checksum, self._size = "", len(whole)
        header = None
        for number, line in enumerate(whole.splitlines(), 1):
            checksum, _, text = line.partition(b" ")
            if self._next(text) != checksum.decode("latin-1"):
                raise ValueError(
                    f"{self._path} is no checkpoint, or it is damaged: line {number} is not as it was written; give "
                    "another file, or remove it to begin anew"
                )
            document = json.loads(text)
            if header is None:
                header = document
                if document.get("format") != _FORMAT:
                    raise ValueError(f"{self._path} is a checkpoint of another version; remove it to begin anew")
                differing = sorted(
                    key
                    for key in fingerprint.keys() | document["of"].keys()
                    if fingerprint.get(key) != document["of"].get(key)
                )
                if differing:
                    raise ValueError(
                        f"{self._path} is the checkpoint of another computation, with another "
                        f"{', another '.join(differing)}; give another file, or remove it to begin anew"
                    )
            elif "state" in document:
                self._sections[document["section"]] = document["state"]
            else:
                self._blocks.setdefault(document["section"], []).append(LoggedBlock.fromPlain(document))
        if header is None:
            raise ValueError(f"{self._path} is no checkpoint; give another file, or remove it to begin anew")
        self.start = header["start"]
        if len(whole) < len(content):
            with namingFile(self._path):
                os.truncate(self._path, len(whole))

    def _next(self, text):
        """The checksum of this line and of all before it."""
        self._checksum = hashlib.sha256(self._checksum.encode() + text).hexdigest()
        return self._checksum

    def _line(self, document):
        text = json.dumps(document).encode()
        return f"{self._next(text)} ".encode() + text + b"\n"

    def _append(self, document):
        line = self._line(document)
        with namingFile(self._path), open(self._path, "ab") as stream:
            if stream.tell() != self._size:
                raise ValueError(f"{self._path} is written by another computation too; give each one its own file")
            stream.write(line)
            stream.flush()
            os.fsync(stream.fileno())
        self._size += len(line)


def fingerprintOf(**things: Any) -> dict[str, str]:
    """A digest of each of what a computation is given; of OpenTURNS objects with all their digits.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.common.run_log import fingerprintOf
    >>> fingerprintOf(law=ot.Normal()) == fingerprintOf(law=ot.Normal(0.0, 1.0 + 1e-15))
    False
    """
    # Where Python prints an address, it is another one in each process.
    texts = {name: _ADDRESS.sub("", exactText(thing)) for name, thing in things.items()}
    return {name: hashlib.sha256(text.encode()).hexdigest() for name, text in texts.items()}
