"""Checksums of the files of a directory, in one file that appears whole."""

import hashlib
import json
import os
from pathlib import Path

from satsep_ot.methods.common.storage import writeWhole

MANIFEST = "manifest.json"


class Manifest:
    """The SHA-256 of each file that was written to a directory, as ``manifest.json`` there keeps it.

    Parameters
    ----------
    directory : str or path

    Raises
    ------
    ValueError
        What is there is not what `record` writes.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from satsep_ot.methods.common.manifest import Manifest
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     file = Path(directory) / "a.txt"
    ...     _ = file.write_text("as it was written")
    ...     Manifest(directory).record(file)
    ...     before = Manifest(directory).changed()
    ...     _ = file.write_text("as somebody edited it")
    ...     before, [path.name for path in Manifest(directory).changed()]
    ([], ['a.txt'])
    """

    def __init__(self, directory: str | os.PathLike) -> None:
        self._directory = Path(directory)
        self._path = self._directory / MANIFEST
        self._digests: dict[str, str] = {}
        if self.isThere():
            try:
                digests = json.loads(self._path.read_text(encoding="utf-8"))["sha256"]
                self._digests = {str(name): str(digest) for name, digest in digests.items()}
            except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
                raise ValueError(f"{self._path} cannot be read ({error})") from error

    def isThere(self) -> bool:
        """Whether the directory has a manifest: version 0.1.0 wrote none."""
        return self._path.is_file()

    def record(self, *paths: str | os.PathLike) -> None:
        """Keep the checksums of files of the directory as they are now; without any, an empty manifest."""
        for path in map(Path, paths):
            self._digests[self._name(path)] = file_digest(path)
        self._write()

    def forget(self, *paths: Path) -> None:
        """Drop the checksums of files."""
        for path in paths:
            self._digests.pop(self._name(path), None)
        self._write()

    def knows(self, path: Path) -> bool:
        """Whether there is a checksum of a file."""
        return self._name(path) in self._digests

    def isChanged(self, path: Path) -> bool:
        """Whether a file is not as it was written; what has no checksum was not written by this manifest's owner."""
        return not path.is_file() or self._digests.get(self._name(path)) != file_digest(path)

    def changed(self) -> list[Path]:
        """The files that are there and not as they were written."""
        paths = [self._directory / name for name in sorted(self._digests)]
        return [path for path in paths if path.exists() and self.isChanged(path)]

    def _name(self, path):
        return Path(path).relative_to(self._directory).as_posix()

    def _write(self):
        text = json.dumps({"sha256": dict(sorted(self._digests.items()))}, indent=1) + "\n"
        writeWhole(self._path, lambda stream: stream.write(text.encode()))


def file_digest(path: str | os.PathLike) -> str:
    """SHA-256 of a file, in hexadecimal digits."""
    with open(path, "rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
