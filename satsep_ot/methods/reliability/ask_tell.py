"""A probability whose true runs are made elsewhere: ask for a block of runs, tell its outputs."""

import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.limit_state import BlockNeeded
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.openturns_object import OpenTURNSObject

# Inputs that went through text are the same to this share of themselves.
_SAME_INPUT = 1e-9


class _OutsideFunction(ot.OpenTURNSPythonFunction):
    """Has a number of inputs and of outputs, and their names, but no values."""

    def __init__(self, inputNames: Sequence[str], outputNames: Sequence[str]) -> None:
        super().__init__(len(inputNames), len(outputNames))
        self.setInputDescription(inputNames)
        self.setOutputDescription(outputNames)

    def _exec(self, x):
        raise NotImplementedError("this function is evaluated elsewhere; use AskTellReliability instead of run()")


def outsideFunction(inputNames: Sequence[str], outputNames: Sequence[str]) -> ot.Function:
    """A function whose values are computed elsewhere, for the event of an :class:`AskTellReliability`.

    Parameters
    ----------
    inputNames, outputNames : sequence of str

    Examples
    --------
    >>> from satsep_ot.methods.reliability.ask_tell import outsideFunction
    >>> outsideFunction(["mass", "force"], ["deflection"]).getOutputDescription()
    [deflection]
    """
    return ot.Function(_OutsideFunction(inputNames, outputNames))


class AskTellReliability(OpenTURNSObject):
    """`ActiveSubspaceReliability` for a simulator that runs elsewhere: on a cluster, by hand, in another program.

    `ask` gives the inputs of the next block of runs, `tell` takes them back with their outputs, and so on until `ask`
    gives None; then `getResult` has what the algorithm itself would have given with a function of the same values, to
    the last bit. All that was told, and the state of the random generator at the first `ask`, are in one file: any
    later process goes on from there with the same algorithm and file.

    Parameters
    ----------
    algorithm : ActiveSubspaceReliability
        With its settings, which are copied. The function of its event, or of its components, is never evaluated;
        `outsideFunction` makes one that needs no values.
    stateFile : str or path
        A file of its own for each computation, made by the first `ask`. Reading it executes nothing.

    Notes
    -----
    No gradient is asked for, also where the function has one. Components (`setComponents`) are not compared with the
    event's own function; the comparison counts as one evaluation all the same, as in a direct run. Each new process,
    and each block, makes the algorithm's own computations again from the start, without true runs.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot import ActiveSubspaceReliability, AskTellReliability
    >>> from satsep_ot.methods.reliability.ask_tell import outsideFunction
    >>> vector = ot.CompositeRandomVector(outsideFunction(["a", "b"], ["y"]), ot.RandomVector(ot.Normal(2)))
    >>> algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 3.0))
    >>> ot.RandomGenerator.SetSeed(0)
    >>> with tempfile.TemporaryDirectory() as directory:
    ...     study = AskTellReliability(algorithm, f"{directory}/state")
    ...     while (block := study.ask()) is not None:
    ...         x = np.array(block)
    ...         study.tell(block, x[:, :1] + 0.5 * x[:, 1:])
    >>> study.getResult().getConverged()
    True
    """

    def __init__(self, algorithm: ActiveSubspaceReliability, stateFile: str | os.PathLike) -> None:
        self._algorithm = algorithm.asking(Path(stateFile))
        self._file = Path(stateFile)
        self._needed: BlockNeeded | None = None

    def __getstate__(self):
        # The block is found again from the state file.
        return self.__dict__ | {"_needed": None}

    def _shown(self):
        return {"stateFile": str(self._file), "isBegun": self._file.exists()}

    def ask(self) -> ot.Sample | None:
        """Physical inputs (n, d) of the next block of runs, under their names; None where no run is needed any more.

        The same block until its outputs are told. ``exportToCSVFile`` of it writes a file with all digits.

        Raises
        ------
        ValueError
            The state is damaged, or that of another computation, or the settings cannot be used.
        """
        needed = self._advance()
        return None if needed is None else needed.inputs

    def tell(self, inputs: ArrayLike, outputs: ArrayLike) -> None:
        """Take the outputs of the block that `ask` gave; they are in the state when this returns.

        Parameters
        ----------
        inputs : array (n, d)
            As `ask` gave them, in the same order.
        outputs : array (n, p)
            What the simulator made of each. A run that is not finite is taken where the algorithm looks far from where
            inputs are likely, and elsewhere where `setNonFinitePolicy` says what it is.

        Raises
        ------
        ValueError
            The state is as for `ask`; the block was told before; the inputs are others; there are more or fewer rows
            or columns; an output is not finite. The state stays as it is.
        RuntimeError
            No run is needed any more.
        """
        needed = self._advance()
        x, y = np.array(inputs, dtype=float), np.array(outputs, dtype=float)
        self._refuseTold(x)
        if needed is None:
            raise RuntimeError("no block of runs is asked for any more; getResult() has the result")
        checkInputs(needed.inputs, x)
        shape = (needed.inputs.getSize(), len(needed.outputNames))
        if y.shape != shape:
            raise ValueError(f"the outputs have the shape {y.shape}; {shape} was asked for; tell the whole block")
        finite = np.isfinite(y).all(axis=1)
        if not finite.all() and not needed.allowsNonFinite:
            row = int(np.argmin(finite))
            raise ValueError(
                f"{np.count_nonzero(~finite)} of {len(y)} runs have an output that is not finite, the first is row "
                f"{row}: {y[row].tolist()}; make them again, or let setNonFinitePolicy of a new computation count such "
                "runs as failures or as safe"
            )
        # Another process may have told the block meanwhile, which keep() refuses: the next call looks again.
        self._needed = None
        needed.keep(y)

    def getResult(self) -> ActiveSubspaceReliabilityResult:
        """The result, where `ask` has given None.

        Raises
        ------
        RuntimeError
            Runs are still needed.
        """
        try:
            return self._algorithm.getResult()
        except RuntimeError:
            raise RuntimeError(
                "there is no result yet; tell the outputs of what ask() gives until it is None"
            ) from None

    def getOutputNames(self) -> list[str]:
        """Names of the outputs of a run, in their order; empty where no run is needed any more."""
        needed = self._advance()
        return [] if needed is None else list(needed.outputNames)

    def acceptsNonFinite(self) -> bool:
        """Whether an output of the block that `ask` gives may be a number that is not finite."""
        needed = self._advance()
        return needed is None or needed.allowsNonFinite

    def getRuns(self) -> tuple[ot.Sample, ot.Sample]:
        """Inputs and outputs of all runs that the last `ask` or `tell` found in the state.

        Raises
        ------
        RuntimeError
            There are none.
        """
        return self._algorithm.getRuns()

    def _advance(self) -> BlockNeeded | None:
        """The block that is needed next, by the algorithm's way through all that is in the state."""
        if self._needed is None:
            try:
                self._algorithm.run()
            except BlockNeeded as needed:
                self._needed = needed
        return self._needed

    def _refuseTold(self, x):
        try:
            told = np.array(self._algorithm.getRuns()[0])
        except RuntimeError:
            return
        if x.ndim == 2 and len(x) and x.shape[1] == told.shape[1]:
            starts = np.flatnonzero(_same(told, x[0]).all(axis=1))
            if any(len(told) >= k + len(x) and _same(told[k : k + len(x)], x).all() for k in starts):
                raise ValueError("this block of runs was told before; ask() has the next one")


def _same(expected, given):
    return np.isclose(given, expected, rtol=_SAME_INPUT, atol=0.0)


def checkInputs(asked: ot.Sample, given: np.ndarray, place: str = "") -> None:
    """Refuse inputs that are not those that were asked for.

    Parameters
    ----------
    asked : :py:class:`openturns.Sample`
        With the names of the inputs.
    given : array (n, d)
        May have gone through text.
    place : str
        Where they stand, for messages.

    Raises
    ------
    ValueError
        There are more or fewer of them, or one is another number.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.reliability.ask_tell import checkInputs
    >>> checkInputs(ot.Sample([[1.0 / 3.0]]), np.array([[0.33333333333]]))
    """
    expected = np.array(asked)
    if given.shape != expected.shape:
        raise ValueError(
            f"{place}the inputs have the shape {given.shape}; {expected.shape} was asked for; tell the whole block, as "
            "ask() gives it"
        )
    changed = ~_same(expected, given)
    if changed.any():
        row, column = map(int, np.argwhere(changed)[0])
        raise ValueError(
            f"{place}the inputs are not those that were asked for: {asked.getDescription()[column]} of row {row} is "
            f"{float(given[row, column])!r} where {float(expected[row, column])!r} was asked for; take them, in their "
            "order, from ask()"
        )
