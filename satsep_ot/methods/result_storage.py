"""A result in one file: an .npz archive of its arrays, a JSON document, and OpenTURNS' own XML for its objects."""

import contextlib
import dataclasses
import json
import os
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import IO, Any
from xml.etree import ElementTree

import numpy as np
import openturns as ot

_FORMAT = "ActiveSubspaceReliabilityResult 2"
# What a killed process leaves of a file that was not complete begins so.
TEMPORARY = ".unfinished-"


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

    Examples
    --------
    >>> import tempfile
    >>> from satsep_ot.methods.result_storage import writeWhole
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     writeWhole(f"{directory}/text", lambda stream: stream.write(b"content")).read_text()
    'content'
    """
    path = Path(path)
    temporary = path.with_name(f"{TEMPORARY}{os.getpid()}-{os.urandom(4).hex()}")
    try:
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


def toXML(thing: Any) -> str:
    """An OpenTURNS object as XML text."""
    with _file() as path:
        study = ot.Study()
        study.setStorageManager(ot.XMLStorageManager(str(path)))
        study.add("object", thing)
        study.save()
        return path.read_text(encoding="utf-8")


def fromXML(text: str, thing: Any) -> Any:
    """Fill an empty OpenTURNS object of the right class from `toXML`'s text, and return it.

    Raises
    ------
    ValueError
        The text is no XML, or holds a Python object: OpenTURNS stores these as pickles, which can execute anything
        when they are loaded.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.result_storage import fromXML, toXML
    >>> fromXML(toXML(ot.Normal(0.1, 1.0 / 3.0)), ot.Normal()).getParameter()[1] == 1.0 / 3.0
    True
    """
    try:
        tree = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise ValueError(f"the text is no XML: {error}") from error
    for element in tree.iter():
        if "python" in element.get("class", "").lower():
            raise ValueError(
                f"the text holds a {element.get('class')}, a pickle that can execute anything; only OpenTURNS' own "
                "objects are loaded"
            )
    with _file() as path:
        # Written anew, so that OpenTURNS reads what was checked, without entities and document types.
        path.write_bytes(ElementTree.tostring(tree, encoding="utf-8", xml_declaration=True))
        study = ot.Study()
        study.setStorageManager(ot.XMLStorageManager(str(path)))
        study.load()
        study.fillObject("object", thing)
    return thing


@contextlib.contextmanager
def _file():
    with tempfile.TemporaryDirectory() as directory:
        yield Path(directory) / "object.xml"


def writeResult(path: str | os.PathLike, fields: dict) -> None:
    """Write named fields: plain values, dataclasses of arrays and OpenTURNS objects.

    An event whose function is in Python is left out: it would be stored as code that runs on loading.
    """
    path = Path(path)
    if path.suffix != ".npz":
        raise ValueError(f"the file is {path}; its name must end on .npz")
    arrays, document = {}, {"format": _FORMAT}
    for name, value in fields.items():
        if name == "event" and "class=Python" in repr(value):
            # Looked at before it is made: the pickle of a function takes all that it refers to along.
            value = None
        if dataclasses.is_dataclass(value):
            content = {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
            arrays |= {f"{name}.{key}": part for key, part in content.items() if isinstance(part, np.ndarray)}
            document[name] = {key: _plain(part) for key, part in content.items() if not isinstance(part, np.ndarray)}
        else:
            document[name] = _plain(value)
    arrays["document"] = np.array(json.dumps(document))
    writeWhole(path, lambda stream: np.savez_compressed(stream, **arrays))  # type: ignore[arg-type]


def _plain(value):
    """A value that JSON knows: OpenTURNS objects become XML."""
    if value is None or isinstance(value, (bool, int, float, str, list, dict)):
        return value
    try:
        return toXML(value)
    except RuntimeError:
        # Functions that OpenTURNS cannot store.
        return None


def readResult(path: str | os.PathLike, classes: dict) -> dict:
    """The fields that `writeResult` has written.

    Parameters
    ----------
    path : str or path
    classes : dict
        Dataclass of each field that is one.

    Raises
    ------
    ValueError
        The file is not such a result.
    """
    try:
        with np.load(path, allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        document = json.loads(str(arrays.pop("document")))
        if document.pop("format") != _FORMAT:
            raise KeyError("format")
    except (KeyError, ValueError, EOFError, zipfile.BadZipFile) as error:
        raise ValueError(f"{path} is not a result written by save(), or of another version") from error
    fields = {}
    for name, value in document.items():
        if name in classes and value is not None:
            prefix = f"{name}."
            parts = {key.removeprefix(prefix): array for key, array in arrays.items() if key.startswith(prefix)}
            fields[name] = classes[name](**value, **parts)
        else:
            fields[name] = value
    fields["distribution"] = fromXML(fields["distribution"], ot.Distribution())
    if fields["event"] is not None:
        fields["event"] = fromXML(fields["event"], ot.RandomVector())
    view = fields["view"]
    if view is not None and view.metaModel is not None:
        view.metaModel = fromXML(view.metaModel, ot.Function())
    fields["history"] = [tuple(row) for row in fields["history"]]
    return fields
