"""Blocks of runs as CSV files of a directory, for a simulator that runs elsewhere."""

import csv
import dataclasses
import hashlib
import io
import os
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.methods.common.storage import writeWhole
from satsep_ot.methods.reliability.ask_tell import AskTellReliability, checkInputs
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.openturns_object import OpenTURNSObject

# The column that names each run.
RUN = "run"
_BLOCK = re.compile("block-([0-9]+)-inputs[.]csv")
_TAG = 6  # hexadecimal digits


class RunsNeeded(Exception):
    """Runs are needed whose outputs are not there yet.

    Attributes
    ----------
    inputs, outputs : :py:class:`pathlib.Path`
        The file with the inputs, and that in which the outputs are looked for.
    size : int
        Number of the runs.
    columns : tuple of str
        What the file of the outputs holds.
    """

    def __init__(self, inputs: Path, outputs: Path, size: int, columns: Sequence[str]) -> None:
        super().__init__(f"{size} runs are needed: their inputs are in {inputs}; write their outputs to {outputs}")
        self.inputs, self.outputs, self.size, self.columns = inputs, outputs, size, tuple(columns)


@dataclasses.dataclass(frozen=True)
class RunOutputs:
    """What a run gave.

    Attributes
    ----------
    path : :py:class:`pathlib.Path`
        The file that has it.
    name : str
        Of the run.
    columns : dict of str to str
        Cells by the names of their columns.
    inputs : dict of str to float
        What was asked for, by the names of the inputs.
    """

    path: Path
    name: str
    columns: dict[str, str]
    inputs: dict[str, float]

    def values(self, names: Sequence[str], acceptsNonFinite: bool) -> list[float]:
        """Outputs of these names.

        Raises
        ------
        ValueError
            There is no such output, it is no number, or not finite where it has to be; or an input in another column is
            not as it was asked for.
        """
        for name in names:
            if name not in self.columns:
                raise ValueError(
                    f"{self.path} has no column {name!r}; give a column for each output: {', '.join(names)}"
                )
        found = [self._value(name) for name in names]
        shared = [name for name in self.inputs if name in self.columns and name not in names]
        if shared:
            asked = ot.Sample([[self.inputs[name] for name in shared]])
            asked.setDescription(shared)
            checkInputs(asked, np.array([list(map(self._value, shared))]), f"{self.path}, run {self.name}: ")
        if not acceptsNonFinite and not np.isfinite(found).all():
            raise ValueError(
                f"{self.path}: the run {self.name} has the outputs {found}, which must be finite; make it again, or "
                "begin anew with a policy that counts such runs as failures or as safe"
            )
        return found

    def _value(self, name):
        return _value(self.path, self.name, name, self.columns[name])


class RunFiles(OpenTURNSObject):
    """A directory in which ``block-N-inputs.csv`` asks for runs and ``block-N-outputs.csv`` answers.

    The first column of both is ``run``, the name of each run: its number, and six digits of a checksum of its inputs. A
    file of outputs has a column for each output, and its rows may stand in any order. Columns of inputs in it are
    compared with those that were asked for, where no output has their name; other columns are left alone. A cell that
    is empty or ``nan`` is an output that is not finite.

    Parameters
    ----------
    directory : str or path
        It is made by the first block. Several computations may share it, as for several events of one simulator: a run
        that one of them has asked for is there for the others.

    Examples
    --------
    >>> import tempfile
    >>> from satsep_ot.methods.reliability.run_files import RunFiles
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     len(RunFiles(directory).runs())
    0
    """

    def __init__(self, directory: str | os.PathLike) -> None:
        self._directory = Path(directory)

    def _shown(self):
        return {"directory": str(self._directory)}

    def runs(self) -> "dict[bytes, RunOutputs]":
        """All runs whose outputs are there, by the bytes of their inputs.

        Raises
        ------
        ValueError
            A file is not as it was written, or outputs do not fit to the inputs.
        """
        found: dict[bytes, RunOutputs] = {}
        for inputs in self._blocks():
            if _outputsOf(inputs).exists():
                found |= _answers(_outputsOf(inputs), inputs)
        return found

    def advance(self, study: AskTellReliability) -> ActiveSubspaceReliabilityResult:
        """Tell a computation all outputs that are there.

        Returns
        -------
        result : ActiveSubspaceReliabilityResult

        Raises
        ------
        RunsNeeded
            The computation needs runs whose outputs are not there; the file of their inputs is.
        ValueError
            A file is not as it was written, outputs do not fit to the inputs, or are not finite where they have to be.
        """
        known = self.runs()
        while (block := study.ask()) is not None:
            rows = list(np.array(block))
            missing = [row for row in rows if row.tobytes() not in known]
            if missing:
                path = self._pending(missing) or self._write(missing, list(block.getDescription()))
                raise RunsNeeded(path, _outputsOf(path), len(missing), [RUN, *study.getOutputNames()])
            names, acceptsNonFinite = study.getOutputNames(), study.acceptsNonFinite()
            study.tell(block, [known[row.tobytes()].values(names, acceptsNonFinite) for row in rows])
        return study.getResult()

    def tell(self, study: AskTellReliability, path: str | os.PathLike) -> Path:
        """Take the outputs of a block from a file, which is copied to where `advance` looks for it.

        Returns
        -------
        path : :py:class:`pathlib.Path`
            The copy.

        Raises
        ------
        ValueError
            The file is not a table of outputs of one block that was asked for, the block was told before, or an output
            is not finite where it has to be. Nothing is changed then.
        """
        given = Path(path)
        inputs = self._blockOf(given)
        kept = _outputsOf(inputs)
        if kept.exists():
            raise ValueError(f"{given}: {inputs.name} was told before, by {kept}; ask for the next block")
        _answers(given, inputs)
        content = given.read_bytes()
        writeWhole(kept, lambda stream: stream.write(content))
        try:
            self.advance(study)
        except RunsNeeded:
            pass
        except ValueError:
            kept.unlink()
            raise
        return kept

    def _blocks(self) -> list[Path]:
        found = [path for path in self._directory.glob("block-*-inputs.csv") if _BLOCK.fullmatch(path.name)]
        return sorted(found, key=_number)

    def _blockOf(self, given):
        """The file of inputs that has asked for the runs of a file of outputs."""
        names = [row[RUN] for row in _table(given)]
        if not names:
            raise ValueError(f"{given} has no rows; give a row for each run that was asked for")
        for inputs in self._blocks():
            if names[0] in {row[RUN] for row in _table(inputs)}:
                return inputs
        raise ValueError(
            f"{given}: the run {names[0]!r} was not asked for in {self._directory}; give the outputs of its own runs"
        )

    def _pending(self, rows):
        """The file that has asked for these runs already, and for no others; None where there is none."""
        wanted = [row.tobytes() for row in rows]
        for inputs in self._blocks():
            if not _outputsOf(inputs).exists() and [row.tobytes() for _, row in _readInputs(inputs)[1]] == wanted:
                return inputs
        return None

    def _write(self, rows, names):
        self._directory.mkdir(parents=True, exist_ok=True)
        blocks = self._blocks()
        first = 1 + sum(len(_table(path)) for path in blocks)
        path = self._directory / f"block-{_number(blocks[-1]) + 1 if blocks else 1}-inputs.csv"
        stream = io.StringIO()
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow([RUN, *names])
        for number, row in enumerate(rows, first):
            writer.writerow([f"{number}-{_tag(row)}", *map(repr, row.tolist())])
        return writeWhole(path, lambda file: file.write(stream.getvalue().encode()))


def _number(inputs):
    return int(_BLOCK.fullmatch(inputs.name)[1])


def _tag(row):
    return hashlib.sha256(np.ascontiguousarray(row, dtype="<f8").tobytes()).hexdigest()[:_TAG]


def _outputsOf(inputs):
    return inputs.with_name(inputs.name.replace("inputs", "outputs"))


def _table(path):
    """The rows of a CSV file, each a dict by column."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        rows = [row for row in csv.reader(io.StringIO(text), strict=True) if any(cell.strip() for cell in row)]
    except (UnicodeDecodeError, csv.Error) as error:
        raise ValueError(f"{path} is no CSV file of commas: {error}") from error
    header = [cell.strip() for cell in rows[0]] if rows else []
    if RUN not in header:
        raise ValueError(f"{path} has no column {RUN!r}; give the names of the runs as the file of the inputs has them")
    doubled = [name for name in header if header.count(name) > 1]
    if doubled:
        raise ValueError(f"{path} has two columns {doubled[0]!r}; give each one once")
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(header):
            raise ValueError(f"{path}: row {number} has {len(row)} cells; the header has {len(header)}")
    return [dict(zip(header, (cell.strip() for cell in row), strict=True)) for row in rows[1:]]


def _readInputs(path):
    """Names of the inputs, and (name of the run, inputs) of each run that a file has asked for."""
    rows, runs = _table(path), []
    names = [name for name in rows[0] if name != RUN] if rows else []
    for row in rows:
        values = np.array([_value(path, row[RUN], name, row[name]) for name in names])
        if row[RUN].partition("-")[2] != _tag(values):
            raise ValueError(
                f"{path}: the run {row[RUN]} is not as it was written; remove the file, and it is written again"
            )
        runs.append((row[RUN], values))
    return names, runs


def _value(path, run, name, text):
    try:
        return float(text) if text else float("nan")
    except ValueError:
        raise ValueError(f"{path}: {name!r} of the run {run} is {text!r}; give a number, or nothing") from None


def _answers(path, inputs):
    """The runs of a file of outputs, by the bytes of their inputs."""
    names, runs = _readInputs(inputs)
    rows = _table(path)
    given = {row[RUN]: row for row in rows}
    if len(given) < len(rows):
        raise ValueError(f"{path} has {len(rows)} rows for {len(given)} runs; give each run once")
    expected = [name for name, _ in runs]
    foreign = [name for name in given if name not in set(expected)]
    if foreign:
        raise ValueError(f"{path}: the run {foreign[0]!r} is none of {inputs.name}; give the runs of one block")
    absent = [name for name in expected if name not in given]
    if absent:
        raise ValueError(
            f"{path}: {len(absent)} of {len(expected)} runs are missing, the first is {absent[0]}; give the whole block"
        )
    return {
        values.tobytes(): RunOutputs(path, name, given[name], dict(zip(names, values.tolist(), strict=True)))
        for name, values in runs
    }
