"""A result in one file: an .npz archive of its arrays, a JSON document, and OpenTURNS' own XML for its objects."""

import contextlib
import dataclasses
import io
import json
import os
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np

from satsep_ot.openturns_adapter import fromXML, isPython, toXML

# Stands in the document for an array of the archive.
_ARRAY = "\x00array"
# What a killed process leaves of a file that was not complete begins so.
TEMPORARY = ".unfinished-"
# Bytes of an array that tell whether it becomes smaller, and the share of their size below which it is compressed.
_TRIED, _WORTH_COMPRESSING = 65_536, 0.9


@contextlib.contextmanager
def namingFile(path: str | os.PathLike) -> Iterator[None]:
    """A block whose errors name a file: the system does not say which one a full disk has no space for."""
    try:
        yield
    except OSError as error:
        error.filename, error.filename2 = os.fspath(path), None
        raise


def writeWhole(path: str | os.PathLike, write: Callable[[IO[bytes]], object]) -> Path:
    """Write a file that is there complete or not at all, even where the power fails in the middle.

    Parameters
    ----------
    path : str or path
        An earlier file of that name stays until the new one is complete.
    write : callable
        Writes the content to the binary stream that it is given.

    Returns
    -------
    path : :py:class:`pathlib.Path`

    Raises
    ------
    FileNotFoundError
        The folder does not exist.

    Examples
    --------
    >>> import tempfile
    >>> from satsep_ot.methods.common.storage import writeWhole
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     writeWhole(f"{directory}/text", lambda stream: stream.write(b"content")).read_text()
    'content'
    """
    path = Path(path)
    if not path.parent.is_dir():
        # The error of the system would name the temporary file.
        raise FileNotFoundError(f"{path} cannot be written: there is no folder {path.parent}")
    temporary = path.with_name(f"{TEMPORARY}{os.getpid()}-{os.urandom(4).hex()}")
    try:
        with namingFile(path):
            with temporary.open("xb") as stream:
                write(stream)
                stream.flush()
                os.fsync(stream.fileno())
            os.replace(temporary, path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise
    syncDirectory(path.parent)
    return path


def syncDirectory(path: str | os.PathLike) -> None:
    """Let the names of the files in a directory survive a power failure; their contents have calls of their own."""
    directory = os.open(path, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)


def writeResult(path: str | os.PathLike, kind: str, fields: dict) -> None:
    """Write named fields: plain values, arrays, dataclasses of these, and OpenTURNS objects.

    Parameters
    ----------
    path : str or path
        Ends on ``.npz``.
    kind : str
        What the file holds and in which version, for `readResult`.
    fields : dict

    Raises
    ------
    ValueError
        The name ends on something else, or an OpenTURNS object is in Python.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.common.storage import readResult, writeResult
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     writeResult(f"{directory}/a.npz", "A 1", {"x": np.ones(2), "law": ot.Normal(0.0, 3.0), "n": 3})
    ...     fields = readResult(f"{directory}/a.npz", "A 1", objects={"law": ot.Distribution()})
    >>> print(fields["x"], fields["law"], fields["n"])
    [1. 1.] Normal(mu = 0, sigma = 3) 3
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise ValueError(f"the file is {path}; its name must end on .npz")
    arrays: dict[str, np.ndarray] = {}
    document: dict[str, Any] = {"format": kind}
    for name, value in fields.items():
        if dataclasses.is_dataclass(value):
            content = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
            arrays |= {f"{name}.{key}": part for key, part in content.items() if isinstance(part, np.ndarray)}
            document[name] = {
                key: _plain(key, part) for key, part in content.items() if not isinstance(part, np.ndarray)
            }
        elif isinstance(value, np.ndarray):
            arrays[name] = value
            document[name] = _ARRAY
        else:
            document[name] = _plain(name, value)
    arrays["document"] = np.array(json.dumps(document))
    writeWhole(path, lambda stream: writeArrays(stream, arrays))


def writeArrays(stream: IO[bytes], arrays: dict[str, np.ndarray]) -> None:
    """Write an .npz archive that compresses what becomes smaller: numbers at random take time and no less space.

    Parameters
    ----------
    stream : binary stream
    arrays : dict of str to ndarray

    Examples
    --------
    >>> import io
    >>> import numpy as np
    >>> from satsep_ot.methods.common.storage import writeArrays
    >>> stream = io.BytesIO()
    >>> writeArrays(stream, {"zeros": np.zeros(10_000), "random": np.random.default_rng(0).random(10_000)})
    >>> len(stream.getvalue()) < 81_000, np.load(io.BytesIO(stream.getvalue()))["zeros"].shape
    (True, (10000,))
    """
    with zipfile.ZipFile(stream, "w") as archive:
        for name, array in arrays.items():
            content = io.BytesIO()
            np.lib.format.write_array(content, np.asanyarray(array), allow_pickle=False)
            beginning = content.getvalue()[:_TRIED]
            is_smaller = len(zlib.compress(beginning, 1)) < _WORTH_COMPRESSING * len(beginning)
            # Without a date, so that the same arrays make the same file.
            member = zipfile.ZipInfo(f"{name}.npy")
            member.compress_type = zipfile.ZIP_DEFLATED if is_smaller else zipfile.ZIP_STORED
            archive.writestr(member, content.getvalue())


def _plain(name, value):
    """A value that JSON knows: OpenTURNS objects become XML."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, (bool, int, float, str, list, dict)):
        return value
    if isPython(value):
        raise ValueError(f"the {name} is made of Python code, which is not stored: it would run on loading")
    return toXML(value)


def readResult(
    path: str | os.PathLike, kind: str, classes: dict | None = None, objects: dict | None = None
) -> dict[str, Any]:
    """The fields that `writeResult` has written.

    Parameters
    ----------
    path : str or path
    kind : str
        As it was written.
    classes : dict, optional
        Dataclass of each field that is one.
    objects : dict, optional
        An empty OpenTURNS object for each field that is one.

    Raises
    ------
    ValueError
        The file is not such a result.
    """
    document, arrays = _read(path)
    if document.pop("format", None) != kind:
        raise ValueError(f"{path} holds no {kind.split()[0]} of this version, as its save() writes it")
    try:
        return _fields(document, arrays, classes or {}, objects or {})
    except Exception as error:
        raise ValueError(f"{path} is damaged: its parts do not belong together ({error})") from error


def _fields(document, arrays, classes, objects):
    fields = {}
    for name, value in document.items():
        if value == _ARRAY:
            fields[name] = arrays[name]
        elif value is not None and name in classes:
            prefix = f"{name}."
            parts = {key.removeprefix(prefix): array for key, array in arrays.items() if key.startswith(prefix)}
            fields[name] = classes[name](**value, **parts)
        elif value is not None and name in objects:
            fields[name] = fromXML(value, objects[name])
        else:
            fields[name] = value
    return fields


def storedFormat(path: str | os.PathLike) -> str | None:
    """What a file holds and in which version, as `writeResult` was told; None where it is no such file."""
    return _read(path)[0].get("format")


def _read(path):
    """The document and the arrays of a file, both empty where it is none of `writeResult`."""
    # Read first: a damaged archive has places that are not in the file, and numpy leaves its file open then.
    content = io.BytesIO(Path(path).read_bytes())
    try:
        with np.load(content, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        document = json.loads(str(arrays.pop("document")))
    except Exception:
        # Of a damaged archive every reader below has errors of its own.
        document, arrays = {}, {}
    return (document, arrays) if isinstance(document, dict) else ({}, {})
