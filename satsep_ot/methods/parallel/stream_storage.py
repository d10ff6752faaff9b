"""What a stream of runs keeps in files: the rows as they are made, and what they gave so far."""

import contextlib
import dataclasses
import json
import os
import time
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from satsep_ot.methods.common.storage import namingFile, writeWhole
from satsep_ot.methods.parallel.block_summary import BlockSummary

# Between two checkpoints [s].
CHECKPOINT_INTERVAL = 2.0
_READ_SIZE = 1 << 24  # bytes at once


class RowFile:
    """An .npy file that grows row by row; made by :func:`openRowFile`.

    Written, not mapped: pages of a map would count as memory of the process.
    """

    def __init__(self, stream: IO[bytes], path: Path, done: int = 0, checksum: int = 0) -> None:
        self._stream, self._path = stream, path
        self._size, self._checksum = done, checksum

    def append(self, rows: np.ndarray) -> None:
        """Write rows (n, k) at the end."""
        written = np.ascontiguousarray(rows, dtype="<f8").data
        with namingFile(self._path):
            self._stream.write(written)
        self._size, self._checksum = self._size + len(rows), zlib.crc32(written, self._checksum)

    def checksum(self, size: int) -> int | None:
        """Of the first rows; None where these are not all that there are."""
        return self._checksum if size == self._size else None

    def sync(self) -> None:
        """Let what was written survive a power failure."""
        with namingFile(self._path):
            self._stream.flush()
            os.fsync(self._stream.fileno())


@contextlib.contextmanager
def openRowFile(path: Path, shape: tuple[int, int], done: int, checksum: int | None = None) -> Iterator[RowFile]:
    """A file of rows, which has its name when it is complete and ends on ".part" before.

    Parameters
    ----------
    path : :py:class:`pathlib.Path`
    shape : (int, int)
        Of the whole.
    done : int
        Rows that are there already; what follows them is written anew.
    checksum : int, optional
        Of these, where it is known.

    Raises
    ------
    ValueError
        These are not there, or not as they were written.
    """
    part = path.with_name(path.name + ".part")
    if done and not part.exists():
        raise ValueError(f"{part} is missing, whose rows the checkpoint counts; remove that to begin anew")
    with namingFile(path):
        stream = open(part, "r+b" if done else "wb")  # noqa: SIM115
        np.lib.format.write_array_header_2_0(stream, {"descr": "<f8", "fortran_order": False, "shape": shape})
        place = stream.tell() + 8 * shape[1] * done
        if stream.seek(0, os.SEEK_END) < place:
            stream.close()
            raise ValueError(f"{part} is shorter than the checkpoint says; remove both to begin anew")
        start = place - 8 * shape[1] * done
        stream.seek(start)
        found = 0
        while left := min(place - stream.tell(), _READ_SIZE):
            found = zlib.crc32(stream.read(left), found)
        if checksum is not None and found != checksum:
            stream.close()
            raise ValueError(f"{part} is not as it was written; remove it and the checkpoint to begin anew")
        stream.truncate()
    rows = RowFile(stream, path, done, found)
    try:
        yield rows
    finally:
        with namingFile(path), stream:
            rows.sync()
    os.replace(part, path)


class StreamProgress:
    """What the runs so far gave, and its file.

    Parameters
    ----------
    path : :py:class:`pathlib.Path` or None
        Continued from where it is there.
    fingerprint : dict
        What two runs must share for one to continue the other.

    Attributes
    ----------
    summary : BlockSummary or None
        None before the first run.
    checksum : int or None
        Of the rows that the file counts, where it is known.

    Raises
    ------
    ValueError
        The file is no checkpoint, or belongs to other runs.
    """

    def __init__(self, path: Path | None, fingerprint: dict[str, Any]) -> None:
        self._path, self._fingerprint = path, fingerprint
        self._saved = time.monotonic()
        self.summary: BlockSummary | None = None
        self.checksum: int | None = None
        if path is not None and path.exists():
            self.summary, self.checksum = _loaded(path, fingerprint)

    @property
    def runs(self) -> int:
        """How many there are."""
        return 0 if self.summary is None else self.summary.size

    def add(self, summary: BlockSummary) -> None:
        """Count the next runs in."""
        self.summary = summary if self.summary is None else self.summary.merged(summary)

    def saveNowAndThen(self, rows: RowFile | None) -> None:
        """Save if that is some seconds ago."""
        if time.monotonic() - self._saved > CHECKPOINT_INTERVAL:
            self._save(rows)

    @contextlib.contextmanager
    def savedAtLast(self, rows: RowFile | None) -> Iterator[None]:
        """A block after which it is saved, however it ends."""
        try:
            yield
        finally:
            self._save(rows)

    def _save(self, rows):
        """Not before the rows that it counts; numbers in JSON come back to the last bit."""
        if self._path is None or self.summary is None:
            return
        if rows is not None:
            rows.sync()
        summary = {key: np.asarray(value).tolist() for key, value in dataclasses.asdict(self.summary).items()}
        checksum = self.checksum if rows is None else rows.checksum(self.runs)
        text = json.dumps({"of": self._fingerprint, "summary": summary, "checksum": checksum})
        writeWhole(self._path, lambda stream: stream.write(text.encode()))
        self._saved = time.monotonic()


def _loaded(path, fingerprint):
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        differing = [key for key, value in fingerprint.items() if document["of"][key] != value]
        fields = {key: np.array(value) for key, value in document["summary"].items()}
        checksum = document.get("checksum")
    except (ValueError, KeyError, TypeError) as error:
        raise ValueError(f"{path} is no checkpoint of a stream ({error}); remove it to begin anew") from error
    if differing:
        raise ValueError(f"{path} is the checkpoint of other runs: {', '.join(differing)} differ")
    return BlockSummary(**{**fields, "size": int(fields["size"])}), checksum
