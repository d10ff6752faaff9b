"""A directory that one study or benchmark writes to: whose it is, and which of its steps are finished."""

import contextlib
import dataclasses
import datetime
import enum
import fcntl
import hashlib
import json
import os
import re
import weakref
from collections.abc import Sequence
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from satsep_ot.methods.common.manifest import MANIFEST, Manifest, file_digest
from satsep_ot.methods.common.storage import TEMPORARY, writeWhole
from satsep_ot.model.text import read_text_file

ORIGIN = "origin.json"
_FORMAT = 1
_LONGEST_ORIGIN = 10_000_000  # characters
# The files of one step: folder and suffix.
_OF_STEP = (("steps", ".json"), ("steps", ".npz"), ("runs", ".npz"), ("runs", ".npy"))
# Names that stand as they are in the name of a file: words with single spaces between them.
_PLAIN = re.compile(r"\w+( \w+)*", re.ASCII)


class DirectoryError(ValueError):
    """A directory cannot be written to, or continued from; the message says why, and what to do.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from satsep_ot.studies.results_directory import DirectoryError, ResultsDirectory
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     _ = (Path(directory) / "notes.txt").write_text("mine")
    ...     try:
    ...         ResultsDirectory(directory, "study", {"seed": 0}, [])
    ...     except DirectoryError as error:
    ...         print("holds other files, such as notes.txt" in str(error))
    True
    """


class ResultsDirectory:
    """A directory, bound to what is computed in it.

    Every file appears whole or not at all, and `manifest.json` has its checksum. While the object lives, no other
    process can open the directory.

    Where it is continued, a step that is not as it was written is made again: with `resume`, its files are removed.

    Parameters
    ----------
    path : str or path
        Made where it does not exist. An empty one is taken.
    kind : str
        "study" or "benchmark".
    identity : dict of str to plain data
        What its results follow from: only where all of it is the same may they be continued.
    patterns : sequence of str
        The files that are written, as patterns within the directory: what `overwrite` removes.
    files : dict of str to str
        Texts to be kept from the start on, by their names within the directory.
    resume : bool
        Continue from what is there.
    overwrite : bool
        Remove what is there, of this or another study, and begin anew.
    about : dict, optional
        More for `origin.json`: names, the command, the processor. Nothing depends on it.

    Attributes
    ----------
    path : :class:`pathlib.Path`
    changed : list of :class:`pathlib.Path`
        Files that were not as they had been written where the directory was continued.

    Raises
    ------
    DirectoryError
        The directory holds other files, the results of something else, or those of the same and neither `resume` nor
        `overwrite` is asked for; or another process is at work in it.

    Examples
    --------
    >>> import tempfile
    >>> from satsep_ot.studies.results_directory import ResultsDirectory
    >>> with tempfile.TemporaryDirectory() as path:
    ...     directory = ResultsDirectory(path, "study", {"seed": 0}, ["steps/*"])
    ...     directory.keep(("spin", "FORM"), {"probability": 3.4e-3})
    ...     directory.close()
    ...     again = ResultsDirectory(path, "study", {"seed": 0}, ["steps/*"], resume=True)
    ...     again.finished("spin", "FORM"), again.finished("spin", "SORM")
    ({'probability': 0.0034}, None)
    """

    def __init__(
        self,
        path: str | os.PathLike,
        kind: str,
        identity: dict[str, Any],
        patterns: Sequence[str],
        files: dict[str, str] | None = None,
        resume: bool = False,
        overwrite: bool = False,
        about: dict | None = None,
    ) -> None:
        if resume and overwrite:
            raise DirectoryError("resume and overwrite exclude each other; give one of them")
        self.path = Path(path)
        self._kind, self._identity, self._patterns = kind, json.loads(json.dumps(identity)), (*patterns, MANIFEST)
        self.changed: list[Path] = []
        files = files or {}
        if self.path.exists() and not self.path.is_dir():
            raise DirectoryError(f"{self.path} is not a directory; give another one")
        self._refuse(resume, overwrite)
        self.path.mkdir(parents=True, exist_ok=True)
        self._lock()
        try:
            # Another process may have been here before the lock.
            begun = self._refuse(resume, overwrite)
            for pattern in (f"{TEMPORARY}*", f"*/{TEMPORARY}*"):
                for leftover in self.path.glob(pattern):
                    leftover.unlink(missing_ok=True)
            is_new = not begun or overwrite
            if is_new:
                self._begin(files, about or {})
            self._manifest = self._read_manifest()
            if not is_new:
                self._forget_changed(files)
            for name, text in files.items():
                if not (self.path / name).exists():
                    self.writeText(name, text)
                elif not self._manifest.knows(self.path / name):
                    self.record(self.path / name)
        except BaseException:
            self.close()
            raise

    def __repr__(self) -> str:
        return f"ResultsDirectory({str(self.path)!r}, {self._kind!r})"

    def close(self) -> None:
        """Let other processes open the directory."""
        self._unlock()

    def finished(self, *names: str) -> Any:
        """What `keep` has kept of a step; None where it is not finished.

        Raises
        ------
        DirectoryError
            What is kept cannot be read.
        """
        path = self.file("steps", names, ".json")
        if not path.exists():
            return None
        try:
            return json.loads(path.read_text(encoding="utf-8"))["result"]
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DirectoryError(f"{path} cannot be read ({error}); remove it, and its step is made again") from error

    def keep(self, names: Sequence[str], result: Any) -> None:
        """Keep a finished step.

        Parameters
        ----------
        names : sequence of str
            Of the step.
        result : plain data
            Numbers come back to the last bit.
        """
        text = json.dumps({"step": list(names), "result": result}, indent=1) + "\n"
        path = self.file("steps", names, ".json")
        self.record(writeWhole(path, lambda stream: stream.write(text.encode())))

    def record(self, *paths: Path) -> None:
        """Keep the checksums of files that were written here by others."""
        self._manifest.record(*paths)

    def folder(self, name: str) -> Path:
        """Path of a folder, which is made."""
        (self.path / name).mkdir(exist_ok=True)
        return self.path / name

    def file(self, folder: str, names: Sequence[str], suffix: str) -> Path:
        """Path of a file that belongs to a step; its folder is made."""
        return self.folder(folder) / (file_stem(names) + suffix)

    def writeText(self, name: str, text: str) -> Path:
        """Write a text file, whole or not at all.

        Returns
        -------
        path : :class:`pathlib.Path`
        """
        path = self.path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        writeWhole(path, lambda stream: stream.write(text.encode()))
        self.record(path)
        return path

    def _read_manifest(self):
        try:
            return Manifest(self.path)
        except ValueError as error:
            raise DirectoryError(f"{error}; remove it, and every step is made again") from error

    def _forget_changed(self, files):
        """Remove the files of steps that are not as they were written: what is not there is made again.

        A directory of version 0.1.0 has no checksums.
        """
        if not json.loads((self.path / ORIGIN).read_text(encoding="utf-8")).get("manifest"):
            return
        self.changed = self._manifest.changed()
        for path in self.changed:
            if path.relative_to(self.path).as_posix() in files:
                raise DirectoryError(f"{path} has been changed since; give another directory, or put it back as it was")
        unknown = [path for path in self.path.glob("steps/*.json") if not self._manifest.knows(path)]
        for path in [*self.changed, *unknown]:
            if path.parent.name not in ("steps", "runs"):
                continue
            # A step, what it gave in full, and its runs have one name.
            rest = [self.path / folder / f"{path.stem}{suffix}" for folder, suffix in _OF_STEP]
            for file in rest:
                file.unlink(missing_ok=True)
            self._manifest.forget(*rest)

    def _refuse(self, resume, overwrite):
        """Whether something has been begun here that is to be continued or removed; raises where it must not be."""
        if not self.path.exists():
            return False
        path = self.path / ORIGIN
        if not path.exists():
            foreign = sorted(entry.name for entry in self.path.iterdir() if not entry.name.startswith(TEMPORARY))
            if foreign:
                raise DirectoryError(
                    f"{self.path} holds other files, such as {foreign[0]}, and no {self._kind} that could be continued "
                    "or overwritten; give another directory"
                )
            return False
        try:
            origin = json.loads(read_text_file(path, _LONGEST_ORIGIN))
            known = origin["format"] == _FORMAT and origin["kind"] in ("study", "benchmark")
            kind, theirs = origin["kind"], dict(origin["identity"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise DirectoryError(f"{path} cannot be read ({error}); give another directory") from error
        if not known or kind != self._kind:
            what = f"a {kind}" if known else "what another version has written"
            raise DirectoryError(
                f"{self.path} holds {what}, not a {self._kind} of this version; give another directory"
            )
        if overwrite:
            return True
        differences = [
            _difference(key, theirs.get(key), self._identity.get(key))
            for key in {**self._identity, **theirs}
            if theirs.get(key) != self._identity.get(key)
        ]
        if differences:
            raise DirectoryError(
                f"{self.path} holds another {self._kind}, {'; '.join(differences)}: give another directory, or "
                "--overwrite to lose that one"
            )
        if not resume:
            raise DirectoryError(
                f"{self.path} holds this {self._kind} already: --resume continues from what is finished there, "
                "--overwrite begins anew, another directory keeps it"
            )
        return True

    def _begin(self, files, about):
        """Remove what an earlier study or benchmark left, and write whose the directory is."""
        origin = self.path / ORIGIN
        kept = json.loads(origin.read_text(encoding="utf-8")).get("files", {}) if origin.exists() else {}
        digests = {name: hashlib.sha256(text.encode()).hexdigest() for name, text in files.items()}
        for name, new in digests.items():
            path = self.path / name
            if name == ORIGIN or any(path.match(pattern) for pattern in self._patterns):
                raise DirectoryError(f"the file {name} cannot be kept in {self.path}: it needs another name")
            if path.exists() and file_digest(path) not in (new, kept.get(name)):
                raise DirectoryError(f"{path} has been changed since; give another directory, or move it")
        for name, old in kept.items():
            # What has been changed since, or lies elsewhere, is somebody else's.
            path = (self.path / name).resolve()
            inside = path.is_relative_to(self.path.resolve()) and path.is_file()
            if inside and file_digest(path) == old != digests.get(name):
                path.unlink()
        for pattern in self._patterns:
            for path in filter(Path.is_file, self.path.glob(pattern)):
                path.unlink()
        for folder in {pattern.rpartition("/")[0] for pattern in self._patterns} - {""}:
            # What somebody else has put there stays, and its folder with it.
            with contextlib.suppress(OSError):
                (self.path / folder).rmdir()
        content = {
            "format": _FORMAT,
            "kind": self._kind,
            "identity": self._identity,
            "files": digests,
            "manifest": MANIFEST,
            "about": about,
            "begun": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        }
        text = json.dumps(content, indent=2) + "\n"
        writeWhole(self.path / ORIGIN, lambda stream: stream.write(text.encode()))

    def _lock(self):
        # The system takes the lock back when the process ends, however it ends.
        descriptor = os.open(self.path, os.O_RDONLY)
        self._unlock = weakref.finalize(self, os.close, descriptor)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            self.close()
            raise DirectoryError(
                f"another process is at work in {self.path}; wait for its end, or give another directory"
            ) from error
        except OSError:
            # Some network file systems know no locks.
            pass


def _difference(key, theirs, ours):
    if key == "case":
        return "of another case"
    if isinstance(theirs, dict) and isinstance(ours, dict):
        changed = [name for name in {**theirs, **ours} if theirs.get(name) != ours.get(name)]
        return ", ".join(f"with {name} {theirs.get(name)} instead of {ours.get(name)}" for name in changed)
    return f"with {key} = {_shown(theirs)} instead of {_shown(ours)}"


def _shown(value):
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)


def file_stem(names: Sequence[str]) -> str:
    """The name of a file, without suffix, of what has these names; different names have different files.

    Examples
    --------
    >>> from satsep_ot.studies.results_directory import file_stem
    >>> file_stem(["lateral rate", "half", "satellite_cg_z"])
    'lateral-rate--half--satellite_cg_z'
    >>> file_stem(["../lateral-rate", "FORM"])
    '-lateral-rate--FORM-a73b3574'
    """
    plain = all(len(name) <= 60 and _PLAIN.fullmatch(name) for name in names)
    stem = "--".join(re.sub(r"\W+", "-", name, flags=re.ASCII)[:60] for name in names)
    return stem if plain else f"{stem}-{hashlib.sha256(json.dumps(list(names)).encode()).hexdigest()[:8]}"


def package_versions() -> dict[str, str]:
    """Versions of this package and of those that its numbers rest on.

    Examples
    --------
    >>> from satsep_ot.studies.results_directory import package_versions
    >>> package_versions()["openturns"].startswith("1.27")
    True
    """
    return {name: metadata.version(name) for name in ("satsep-ot", "openturns", "numpy", "scipy", "numba")}


def digest(*things: Any) -> str:
    """A digest of all numbers and names in dataclasses, arrays and OpenTURNS distributions.

    Parameters
    ----------
    things : plain data, dataclass, ndarray, :class:`openturns.Distribution`
        And tuples, lists and dictionaries of these.

    Returns
    -------
    digest : str
        SHA-256 in hexadecimal digits.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.studies.results_directory import digest
    >>> digest(ot.Normal(0.0, 1.0)) == digest(ot.Normal(0.0, 1.0 + 1e-15))
    False
    """
    found = hashlib.sha256()
    for part in _parts(things):
        found.update(repr(part).encode() + b"\n")
    return found.hexdigest()


def _parts(thing):
    if dataclasses.is_dataclass(thing):
        yield type(thing).__name__
        yield from _parts({field.name: getattr(thing, field.name) for field in dataclasses.fields(thing)})
    elif isinstance(thing, dict):
        yield "dict", len(thing)
        for key, value in thing.items():
            yield key
            yield from _parts(value)
    elif isinstance(thing, (tuple, list)):
        yield "list", len(thing)
        for value in thing:
            yield from _parts(value)
    elif isinstance(thing, np.ndarray):
        yield "array", thing.shape
        yield from thing.ravel().tolist()
    elif hasattr(thing, "getParameter"):
        # The text has the structure, to six digits; the parameters have all.
        yield repr(thing)
        yield from thing.getParameter()
    elif isinstance(thing, enum.Enum):
        yield thing.name
    else:
        yield thing.item() if isinstance(thing, np.generic) else thing
