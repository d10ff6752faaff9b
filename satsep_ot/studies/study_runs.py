"""The true runs that a study has kept in its directory, loaded again."""

import json
import os
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.methods.common.manifest import Manifest
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.openturns_adapter import fromXML
from satsep_ot.studies.sample import BLOCK, SampleSummary, inputs_digest, sample_inputs
from satsep_ot.studies.telling.plain_data import from_plain

SAMPLE = "sample"


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
        There are no such runs, their file is not as it was written, or the inputs of the sample, which are drawn again
        from its seed, are not those of the study here: another version of OpenTURNS, or another machine, may round them
        otherwise.

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
    path = directory / "runs" / (f"{name}.npy" if name == SAMPLE else f"{name}.npz")
    manifest = Manifest(directory)
    if manifest.knows(path) and manifest.isChanged(path):
        raise ValueError(f"{path} is not as it was written; the command of the study with --resume makes it again")
    return _load_sample(directory, size) if name == SAMPLE else _first(TrueRuns.load(path), size)


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
