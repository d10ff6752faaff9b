"""results.json: the one writer and the one reader of a `StudyResult`."""

import dataclasses
import json
import os
from collections.abc import Sequence
from typing import Any

from satsep_ot.dynamics.quantities import QUANTITIES
from satsep_ot.model.text import read_text_file
from satsep_ot.studies.telling.plain_data import from_plain, to_plain
from satsep_ot.studies.telling.remarks import remarks
from satsep_ot.studies.telling.results import Estimate, StudyResult
from satsep_ot.studies.telling.verdicts import judge_all

# Of results.json; version 0.1.0 wrote files without this number, which are read as well.
FORMAT = 2
_LONGEST_FILE = 1_000_000_000  # characters


class ReportError(ValueError):
    """A directory holds no results that can be read; the message says what is missing, and what to do.

    Examples
    --------
    >>> from satsep_ot.studies.telling.document import ReportError, read_results
    >>> try:
    ...     read_results("nowhere/results.json")
    ... except ReportError as error:
    ...     print("there is no such file" in str(error))
    True
    """


def results_document(result: StudyResult) -> dict[str, Any]:
    """All numbers of a study as plain data, with its verdicts and remarks, as they stand in results.json.

    Parameters
    ----------
    result : StudyResult

    Returns
    -------
    document : dict
    """
    verdicts = [
        {"requirement": one.requirement, "status": one.status, "sentence": one.sentence} for one in judge_all(result)
    ]
    return {"format": FORMAT, **to_plain(result), "verdicts": to_plain(verdicts), "remarks": remarks(result)}


def partial_document(case: str, seed: int, rows: Sequence[Estimate]) -> dict[str, Any]:
    """What stands in results.json while a study runs: the rows that are finished, and that it is not complete."""
    return {"format": FORMAT, "case": case, "seed": seed, "complete": False, "rows": to_plain(rows)}


def read_results(path: str | os.PathLike) -> StudyResult:
    """Read results.json.

    Parameters
    ----------
    path : str or path

    Returns
    -------
    result : StudyResult

    Raises
    ------
    ReportError
        The file is missing or damaged, a later version has written it, or the study was interrupted.
    """
    document = read_json(path)
    if document.get("complete") is False:
        raise ReportError(f"{path}: the study was interrupted; run it to its end for a report")
    if document.get("format", 1) not in (1, FORMAT):
        raise ReportError(
            f"{path}: it has the format {document['format']}, and this version reads 1 to {FORMAT}; use the version "
            "that has written it, or run the study again"
        )
    try:
        result = from_plain(StudyResult, document)
    except ValueError as error:
        raise ReportError(f"{path} is not what this version's study writes ({error}); run the study again") from error
    return result if "format" in document else _with_parts(result)


def _with_parts(result: StudyResult) -> StudyResult:
    """A result of version 0.1.0, which did not say what its quantities are made of."""
    quantities = {
        name: dataclasses.replace(
            values,
            norm_of=QUANTITIES[name].norm_of if name in QUANTITIES else (),
            part_of="clearance" if name.startswith("exit_clearance_") else "",
        )
        for name, values in result.quantities.items()
    }
    return dataclasses.replace(result, quantities=quantities)


def read_text(path: str | os.PathLike) -> str:
    """The text of a file that a study has written.

    Raises
    ------
    ReportError
        The file is missing or cannot be read.
    """
    try:
        return read_text_file(path, _LONGEST_FILE)
    except FileNotFoundError as error:
        raise ReportError(
            f"{path}: there is no such file; a report is made from what `satsep-ot study` writes"
        ) from error
    except ValueError as error:
        raise ReportError(str(error)) from error


def _refuse_constant(name):
    raise ValueError(f"{name} is no number there")


def read_json(path: str | os.PathLike) -> dict[str, Any]:
    """The object in a JSON file that a study has written.

    Raises
    ------
    ReportError
        The file is missing, cannot be read, or holds no JSON object.
    """
    try:
        document = json.loads(read_text(path), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        if isinstance(error, ReportError):
            raise
        raise ReportError(f"{path}: not valid JSON: {error}") from error
    if not isinstance(document, dict):
        raise ReportError(f"{path}: it must hold an object, as `satsep-ot study` writes it")
    return document
