"""True runs of a function with what each one is worth in the estimate of a probability, and their file."""

import dataclasses
import json
import os
import zipfile
from collections.abc import Sequence
from typing import Any

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.common.storage import writeArrays, writeWhole
from satsep_ot.openturns_object import OpenTURNSObject

_FORMAT = "TrueRuns 1"
_ARRAYS = ("inputs", "outputs", "failed", "phases", "weights", "expected")


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class TrueRuns(OpenTURNSObject):
    """True runs, in the order in which they were made.

    The probability of failure is ``surrogateProbability`` plus the mean of ``weights * (failed - expected)`` over the
    runs whose weight is a number: for a Monte Carlo sample, whose weights are 1, the share of the failures; for an
    importance sample the mean of the weighted failures; with a surrogate its probability, corrected by true runs.

    Attributes
    ----------
    inputs : array (n, d)
    outputs : array (n, p)
    failed : array (n,) of bool
        Whether the event happened; all False where the runs were made without one.
    phases : array (n,) of str
        What each run was made for.
    weights : array (n,)
        Density of the inputs over the density that the run was drawn from, times the share of the run's block in the
        estimate over its share of the runs; NaN for a run that is no part of the estimate, since the run, or the next
        ones, depend on what it gave.
    expected : array (n,)
        The surrogate's probability of failure at the run, before it was made; 0 without a surrogate.
    inputNames, outputNames : tuple of str
        With the unit, as in "mass [kg]", where there is one.
    surrogateProbability : float

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.reliability.true_runs import TrueRuns
    >>> x = np.array([[0.5], [1.5], [2.5], [3.5]])
    >>> runs = TrueRuns.ofSample(x, 2.0 * x, x[:, 0] > 3.0, ("x [m]",), ("y [m]",))
    >>> runs.computeProbability()
    0.25
    >>> runs.getOutputSample().getDescription()[0]
    'y [m]'
    """

    inputs: np.ndarray
    outputs: np.ndarray
    failed: np.ndarray
    phases: np.ndarray
    weights: np.ndarray
    expected: np.ndarray
    inputNames: tuple[str, ...]
    outputNames: tuple[str, ...]
    surrogateProbability: float = 0.0

    def __len__(self) -> int:
        return len(self.inputs)

    def _shown(self):
        phases = zip(*np.unique(self.phases, return_counts=True), strict=True)
        return {
            "size": len(self),
            "inputs": len(self.inputNames),
            "outputs": self.outputNames,
            "phases": ", ".join(f"{name}: {count}" for name, count in phases),
        }

    @staticmethod
    def ofSample(
        inputs: np.ndarray,
        outputs: np.ndarray,
        failed: np.ndarray,
        inputNames: Sequence[str],
        outputNames: Sequence[str],
        phase: str = "Monte Carlo",
        weight: float = 1.0,
    ) -> "TrueRuns":
        """Runs of one phase and one weight: 1 for draws of the inputs' distribution, NaN for runs without a weight."""
        size = len(inputs)
        return TrueRuns(
            inputs, outputs, failed, np.full(size, phase), np.full(size, float(weight)), np.zeros(size),
            tuple(inputNames), tuple(outputNames),
        )  # fmt: skip

    def getInputSample(self) -> ot.Sample:
        """The inputs, with their names."""
        return _described(self.inputs, self.inputNames)

    def getOutputSample(self) -> ot.Sample:
        """The outputs, with their names."""
        return _described(self.outputs, self.outputNames)

    def computeProbability(self, failed: ArrayLike | None = None) -> float:
        """The probability of failure again, from the runs and their weights.

        Parameters
        ----------
        failed : array_like (n,) of bool, optional
            Whether another event happened; by default the event of the runs. The estimate is unbiased too, but the runs
            were not made for it; with a surrogate, whose expectations are of the first event, it is plain importance
            sampling.

        Raises
        ------
        ValueError
            No run has a weight: runs of subset simulation and of searches for a design point depend on each other.
        """
        rows = np.isfinite(self.weights)
        if not rows.any():
            raise ValueError(f"no run of {', '.join(np.unique(self.phases))} has a weight: they depend on each other")
        if failed is not None:
            return float((self.weights[rows] * np.asarray(failed, dtype=bool)[rows]).mean())
        return self.surrogateProbability + float((self.weights * (self.failed - self.expected))[rows].mean())

    def save(self, path: str | os.PathLike) -> None:
        """Write the runs to an .npz archive, whole or not at all.

        It holds the arrays by their names here, and ``document``, a JSON text with the rest.

        Parameters
        ----------
        path : str or path
        """
        document = {
            "format": _FORMAT,
            "inputNames": list(self.inputNames),
            "outputNames": list(self.outputNames),
            "surrogateProbability": self.surrogateProbability,
        }
        arrays = {name: getattr(self, name) for name in _ARRAYS} | {"document": np.array(json.dumps(document))}
        writeWhole(path, lambda stream: writeArrays(stream, arrays))

    @staticmethod
    def load(path: str | os.PathLike) -> "TrueRuns":
        """The runs that `save` has written. Nothing in the file is executed.

        Raises
        ------
        ValueError
            The file holds no such runs.
        """
        try:
            with np.load(path, allow_pickle=False) as archive:
                document = json.loads(str(archive["document"]))
                if document["format"] != _FORMAT:
                    raise KeyError("format")
                arrays = {name: archive[name] for name in _ARRAYS}
            names: dict[str, Any] = {name: tuple(document[name]) for name in ("inputNames", "outputNames")}
            return TrueRuns(**arrays, **names, surrogateProbability=float(document["surrogateProbability"]))
        except (KeyError, ValueError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise ValueError(f"{path} holds no true runs that save() of this version has written") from error


def _described(values, names):
    sample = ot.Sample(np.asarray(values, dtype=float))
    sample.setDescription(names)
    return sample
