"""The true runs that a study has kept in its directory, loaded again."""

import dataclasses
import hashlib
import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.openturns_adapter import fromXML
from satsep_ot.studies.telling.plain_data import dataclass_from_plain, from_plain

# Runs of the Monte Carlo sample that are drawn from one seed.
BLOCK = 1024
SAMPLE = "sample"


@dataclasses.dataclass(frozen=True)
class SampleLimit:
    """A requirement as the sample sees it: the column of its quantity, and the limit."""

    column: int
    is_maximum: bool
    limit: float

    def violated(self, outputs: np.ndarray) -> np.ndarray:
        """Whether each of the outputs (n, q) violates it, shape (n,)."""
        values = outputs[:, self.column]
        return values > self.limit if self.is_maximum else values < self.limit


@dataclasses.dataclass(frozen=True)
class SampleSummary:
    """What the Monte Carlo sample of a study gave, and what its inputs can be drawn again from.

    Attributes
    ----------
    seconds : float
        That the runs took.
    size, seed : int
        Number of runs; seed of the first block.
    first_block : str
        Digest of the inputs of the first block.
    distribution : str
        Of the inputs, as XML.
    mean, deviation : tuple of float
        Of each output.
    violations : dict of str to int
        Runs that violate each requirement, and any of them.
    limits : dict of str to SampleLimit
        By requirement.
    inputs, outputs : tuple of str
        Their names with units.
    """

    seconds: float
    size: int
    seed: int
    first_block: str
    distribution: str
    mean: tuple[float, ...]
    deviation: tuple[float, ...]
    violations: dict[str, int]
    limits: dict[str, SampleLimit]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]

    @staticmethod
    def from_plain(data: dict[str, Any]) -> "SampleSummary":
        """From what stands in steps/sample.json, also as version 0.1.0 wrote it."""
        if "first block" in data:
            columns = {label.rpartition(" [")[0]: column for column, label in enumerate(data["outputs"])}
            limits = {
                name: {"column": columns[quantity], "is_maximum": is_maximum, "limit": limit}
                for name, (quantity, is_maximum, limit) in data["limits"].items()
            }
            data = {**data, "first_block": data["first block"], "limits": limits}
        return dataclass_from_plain(SampleSummary, data)


def list_runs(directory: str | os.PathLike) -> list[str]:
    """What there is to load.

    Parameters
    ----------
    directory : str or path
        Of a study, finished or not.

    Returns
    -------
    names : list of str
        "sample", the Monte Carlo runs that all requirements share; "gradients", those of the active subspaces; and the
        runs of each method for each requirement, such as "spin--ActiveSubspace".

    Raises
    ------
    ValueError
        It is no directory of a study.
    """
    directory = Path(directory)
    if not (directory / "origin.json").exists():
        raise ValueError(f"{directory} is not the directory of a study: it has no origin.json")
    return sorted(
        [path.stem for path in (directory / "runs").glob("*.npz") if not path.name.startswith(".")]
        + [SAMPLE] * (directory / "runs" / f"{SAMPLE}.npy").exists()
    )


def load_runs(directory: str | os.PathLike, name: str, size: int | None = None) -> TrueRuns:
    """True runs of a study: inputs, outputs, weights, and what each run was made for.

    Parameters
    ----------
    directory : str or path
    name : str
        One of `list_runs`.
    size : int, optional
        Load only the first runs. By default all.

    Returns
    -------
    runs : :class:`satsep_ot.methods.reliability.true_runs.TrueRuns`
        The event of the sample is that any requirement is violated.

    Raises
    ------
    ValueError
        There are no such runs, or the inputs of the sample, which are drawn again from its seed, are not those of the
        study here: another version of OpenTURNS, or another machine, may round them otherwise.

    Notes
    -----
    Nothing in the files is executed.

    Examples
    --------
    >>> import tempfile
    >>> from satsep_ot.model.separation_problem import SeparationProblem
    >>> from satsep_ot.studies.separation_study import SeparationStudy
    >>> from satsep_ot.studies.study_runs import list_runs, load_runs
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     study = SeparationStudy(SeparationProblem("reference"), ["MonteCarlo"], sampleSize=2000)
    ...     study.setDirectory(directory)
    ...     study.computeSample()
    ...     names, runs = list_runs(directory), load_runs(directory, "sample")
    >>> names, len(runs), runs.getInputSample().getDescription()[0]
    (['sample'], 2000, 'satellite_mass [kg]')
    """
    names = list_runs(directory)
    if name not in names:
        raise ValueError(f"there are no runs called {name!r} in {directory}; there are {', '.join(names) or 'none'}")
    directory = Path(directory)
    if name == SAMPLE:
        return _load_sample(directory, size)
    return _first(TrueRuns.load(directory / "runs" / f"{name}.npz"), size)


def _load_sample(directory, size):
    path = directory / "steps" / f"{SAMPLE}.json"
    try:
        summary = from_plain(SampleSummary, json.loads(path.read_text(encoding="utf-8"))["result"])
        distribution = fromXML(summary.distribution, ot.Distribution())
        outputs = np.load(directory / "runs" / f"{SAMPLE}.npy", mmap_mode="r", allow_pickle=False)
        first = sample_inputs(distribution, summary.seed, summary.size, BLOCK)
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{path} cannot be read: {error}") from error
    if inputs_digest(first) != summary.first_block:
        raise ValueError(
            f"the inputs of the sample of {directory} cannot be drawn again here: another version of OpenTURNS, or "
            "another machine, rounds otherwise; the outputs are in runs/sample.npy"
        )
    size = summary.size if size is None else min(size, summary.size)
    outputs = np.array(outputs[:size])
    violated = np.any([limit.violated(outputs) for limit in summary.limits.values()], axis=0)
    inputs = sample_inputs(distribution, summary.seed, summary.size, size)
    return TrueRuns.ofSample(inputs, outputs, violated, summary.inputs, summary.outputs)


def _first(runs, size):
    if size is None:
        return runs
    arrays = ("inputs", "outputs", "failed", "phases", "weights", "expected")
    return TrueRuns(
        *(getattr(runs, name)[:size] for name in arrays), runs.inputNames, runs.outputNames, runs.surrogateProbability
    )


def sample_inputs(distribution: ot.Distribution, seed: int, total: int, size: int) -> np.ndarray:
    """The inputs of the first runs of a Monte Carlo sample of a study.

    Parameters
    ----------
    distribution : :class:`openturns.Distribution`
    seed : int
        Of the first block; the next one has the next number.
    total, size : int
        Runs of the whole sample, and how many of them.

    Returns
    -------
    inputs : ndarray, shape (size, d)
    """
    state = ot.RandomGenerator.GetState()
    blocks = [np.empty((0, distribution.getDimension()))]
    try:
        for first in range(0, min(size, total), BLOCK):
            ot.RandomGenerator.SetSeed((seed + first // BLOCK) % 2**32)
            blocks.append(np.array(distribution.getSample(min(BLOCK, total - first))))
    finally:
        ot.RandomGenerator.SetState(state)
    return np.concatenate(blocks)[:size]


def inputs_digest(inputs: Any) -> str:
    """SHA-256 of an array's numbers, in hexadecimal digits."""
    return hashlib.sha256(np.ascontiguousarray(inputs, dtype="<f8").tobytes()).hexdigest()
