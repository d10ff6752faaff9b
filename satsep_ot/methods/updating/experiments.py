"""Experiments and what was measured in them, as functions of the standard normals of a two-level model."""

import dataclasses
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import openturns as ot

from satsep_ot.methods.updating.two_level import TwoLevelInputs, normals
from satsep_ot.openturns_adapter import callFunction, interruptible


class Model(Protocol):
    """A function of physical inputs, row by row; what cannot be computed is NaN."""

    def evaluate(self, X: np.ndarray) -> np.ndarray:
        """Outputs (N, q) of inputs (N, d)."""
        ...

    def computeGradientSample(self, X: np.ndarray) -> np.ndarray:
        """Their derivatives (N, d, q)."""
        ...


class FunctionModel:
    """An OpenTURNS function as a `Model`.

    Parameters
    ----------
    function : :py:class:`openturns.Function`
    """

    def __init__(self, function: ot.Function) -> None:
        self._function = ot.Function(function)

    def evaluate(self, X: np.ndarray) -> np.ndarray:
        """Outputs (N, q) of inputs (N, d)."""
        return callFunction(self._function, X)

    def computeGradientSample(self, X: np.ndarray) -> np.ndarray:
        """Their derivatives (N, d, q)."""
        with interruptible():
            return np.stack([np.array(self._function.gradient(x)) for x in X])


@dataclasses.dataclass(frozen=True)
class Measurement:
    """One measured number.

    Attributes
    ----------
    name : str
        Of what was measured.
    index : int
        The output of the model, or the input.
    value, error : float
        The number, and the standard deviation of its normal error.
    isInput : bool
        Whether an input was measured.
    """

    name: str
    index: int
    value: float
    error: float
    isInput: bool = False


@dataclasses.dataclass(frozen=True)
class Experiment:
    """One run of the real thing under known conditions.

    Attributes
    ----------
    name : str
    model : Model
        What computes the outputs under these conditions; experiments that share one object are computed together.
    measurements : tuple of Measurement
    own : tuple of int
        Inputs that are of another piece in this experiment, whatever is shared among the others.
    """

    name: str
    model: Any
    measurements: tuple[Measurement, ...]
    own: tuple[int, ...] = ()

    @property
    def measuresOutputs(self) -> bool:
        """Whether an output of the model was measured, not inputs alone."""
        return any(not row.isInput for row in self.measurements)

    @property
    def values(self) -> np.ndarray:
        """The measured numbers, ndarray (k,)."""
        return np.array([row.value for row in self.measurements])

    @property
    def errors(self) -> np.ndarray:
        """Their standard deviations, ndarray (k,)."""
        return np.array([row.error for row in self.measurements])


class MeasurementModel:
    """All K measurements of experiments: predictions, and the likelihood of the parameters that they share.

    Parameters
    ----------
    inputs : :class:`~satsep_ot.methods.updating.two_level.TwoLevelInputs`
    experiments : sequence of Experiment

    Attributes
    ----------
    values, errors : ndarray (K,)
    labels : list of (str, str)
        Experiment and quantity of each measurement.
    evaluations, gradients : int
        Runs made so far.
    """

    def __init__(self, inputs: TwoLevelInputs, experiments: Sequence[Experiment]) -> None:
        self.inputs, self.experiments = inputs, list(experiments)
        rows = [(experiment.name, row) for experiment in self.experiments for row in experiment.measurements]
        self.values = np.array([row.value for _, row in rows])
        self.errors = np.array([row.error for _, row in rows])
        self.labels = [(name, row.name) for name, row in rows]
        self.evaluations = self.gradients = 0

    @property
    def parameterNumber(self) -> int:
        """Number of parameters, p."""
        return len(self.inputs.getParameters())

    def predict(self, parameters: np.ndarray) -> np.ndarray:
        """Draws of the measurements without error, ndarray (N, K), at parameters (N, p); NaN where a run fails."""
        columns = []
        for experiment in self.experiments:
            drawn = normals(len(parameters), len(self.inputs.getAnew()) + len(experiment.own))
            columns.append(self.outputs(experiment, self.inputs.toPhysical(parameters, drawn, experiment.own)))
        return np.concatenate(columns, axis=1)

    def outputs(self, experiment: Experiment, physical: np.ndarray) -> np.ndarray:
        """What would be measured in an experiment without error, ndarray (N, k), at inputs (N, d)."""
        rows = experiment.measurements
        outputs = np.empty((len(physical), 0))
        if experiment.measuresOutputs:
            outputs = experiment.model.evaluate(physical)
            self.evaluations += len(physical)
        return np.column_stack([physical[:, r.index] if r.isInput else outputs[:, r.index] for r in rows])

    def slopes(self, experiment: Experiment, physical: np.ndarray) -> np.ndarray:
        """Its derivatives (k, d) at inputs (d,)."""
        slopes = np.zeros((len(experiment.measurements), len(physical)))
        gradient = np.empty((len(physical), 0))
        if experiment.measuresOutputs:
            gradient = experiment.model.computeGradientSample(physical[None, :])[0]
            self.gradients += 1
        for column, row in enumerate(experiment.measurements):
            if row.isInput:
                slopes[column, row.index] = 1.0
            else:
                slopes[column] = gradient[:, row.index]
        return slopes
