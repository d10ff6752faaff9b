"""The separation as an OpenTURNS function: uncertain inputs in, quantities of interest out."""

import os
from collections.abc import Sequence
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.separation import Status
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients
from satsep_ot.model.case import Case, load_uncertain_case
from satsep_ot.model.inputs import ParameterMap
from satsep_ot.openturns_object import OpenTURNSObject

# Runs simulated at once: large enough to keep every thread busy, small enough for constant memory.
_CHUNK = 16384
# The same for derivatives, of which a run has hundreds.
_GRADIENT_CHUNK = 2048


# Endings of a run that a study counts as violations: of a satellite that does not come off as it should.
COUNTED = (Status.PENETRATION, Status.STUCK, Status.TOO_MANY_EVENTS)


NEVER_FREE = -1.0  # s, the end of the last contact of a counted run


class SeparationError(RuntimeError):
    """A separation could not be simulated; the message names the row, the status and the inputs.

    Examples
    --------
    >>> from satsep_ot.model.separation_function import SeparationError, SeparationFunction
    >>> try:
    ...     SeparationFunction("reference").evaluate([[-1.0] * 35])
    ... except SeparationError as error:
    ...     print("row 0" in str(error))
    True
    """


class SeparationFunction(OpenTURNSObject, ot.OpenTURNSPythonFunction):
    """Quantities of interest of a separation as a function of its uncertain inputs.

    Parameters
    ----------
    case : Case, str or path, default "reference"
        As for :func:`satsep_ot.model.case.load_case`.
    tolerance : float, default 1e-8
        Relative accuracy of each simulation.
    quantities : sequence of str, optional
        Names of the quantities of interest wanted, in this order. Default: all. Gradients of fewer cost less. Ask for
        fewer here rather than by a function's `getMarginal`, whose Hessian has no diagonal in OpenTURNS 1.27.
    countsEndings : bool, default False
        What a run is whose bodies do not come apart as they should (`COUNTED`, as where the satellite sinks into the
        deck): an error, or with True a violation of every requirement. Its quantities are then beyond their limits by
        the distance of the nominal run from these, those without a limit are those of the nominal run, and gradients
        are 0; `deck_height` is its own.

    Notes
    -----
    Hand it to OpenTURNS as ``ot.Function(SeparationFunction(case))``. The descriptions hold names and units. Samples
    are simulated in parallel; a row's result does not depend on the sample that it is in. The object holds no counters
    and no caches: copies and pickles of it are equal to it.

    The gradient is exact where the quantity is smooth: not where two springs release at the same instant and their
    order swaps, where the minimum clearance moves to another point, or at the kinks of norms at 0.

    Raises
    ------
    CaseError
        If the case cannot be used or has no uncertain inputs.
    ValueError
        If a quantity is unknown.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.model.separation_function import SeparationFunction
    >>> function = ot.Function(SeparationFunction("reference"))
    >>> function.getInputDimension(), function.getInputDescription()[0], function.getOutputDescription()[0]
    (35, 'satellite_mass [kg]', 'axial_velocity [m/s]')
    """

    # Functions that version 0.1.0 saved have none.
    _violating: dict[str, float] | None = None

    def __init__(
        self,
        case: Case | str | str | os.PathLike = "reference",
        tolerance: float = 1e-8,
        quantities: Sequence[str] | None = None,
        countsEndings: bool = False,
    ) -> None:
        case = load_uncertain_case(case)
        table = quantity_table(case.separation)
        names = tuple(table if quantities is None else quantities)
        for name in names:
            if name not in table:
                raise ValueError(f"'{name}' is no quantity of this case; it has {', '.join(table)}")
        super().__init__(len(case.inputs), len(names))
        self.setInputDescription([row.label for row in case.inputs])
        self.setOutputDescription([f"{name} [{table[name].unit}]" for name in names])
        self._quantities = names
        self._separation = case.separation
        self._tolerance = tolerance
        self._map = ParameterMap(case.inputs, case.separation)
        self._violating = violating_values(case) if countsEndings else None

    def _shown(self):
        return {"inputs": self.getInputDimension(), "quantities": list(self._quantities), "tolerance": self._tolerance}

    def evaluate(self, X: Any) -> np.ndarray:
        """Quantities of interest of each row.

        Parameters
        ----------
        X : array_like, shape (N, n)
            Inputs, in their units.

        Returns
        -------
        Y : ndarray, shape (N, Q)
            Quantities of interest, in their units.

        Raises
        ------
        SeparationError
            If a run fails: the rows, their inputs and the reason.

        Examples
        --------
        >>> from satsep_ot.model.separation_function import SeparationFunction
        >>> from satsep_ot.model.separation_problem import SeparationProblem
        >>> mean = SeparationProblem("reference").getDistribution().getMean()
        >>> print(SeparationFunction("reference").evaluate([mean])[0, 0].round(4))
        0.5979
        """
        X = self._checked(X)
        Y = np.empty((len(X), self.getOutputDimension()))
        for start in range(0, len(X), _CHUNK):
            rows = slice(start, start + _CHUNK)
            outcome, counted = self._run(simulate, X, rows)
            for column, name in enumerate(self._quantities):
                values = outcome.quantity(name)
                if self._violating is not None:
                    values[counted & ~np.isfinite(values)] = self._violating[name]
                Y[rows, column] = values
        return Y

    def computeGradientSample(self, X: Any) -> np.ndarray:
        """Gradients of every quantity of interest at each row.

        Parameters
        ----------
        X : array_like, shape (N, n)
            Inputs, in their units.

        Returns
        -------
        gradients : ndarray, shape (N, n, Q)
            The transposed Jacobian of each row, as OpenTURNS has it: [row, input, quantity].

        Raises
        ------
        SeparationError
            If a run fails.
        """
        X = self._checked(X)
        gradients = np.empty((len(X), self.getInputDimension(), self.getOutputDimension()))
        for start in range(0, len(X), _GRADIENT_CHUNK):
            rows = slice(start, start + _GRADIENT_CHUNK)
            outcome, counted = self._run(simulate_with_gradients, X, rows, quantities=self._quantities)
            for column, name in enumerate(self._quantities):
                gradients[rows, :, column] = self._map.gradient(outcome.quantity_gradient(name))
            gradients[rows][counted] = 0.0
        return gradients

    def _exec(self, x):
        return self.evaluate([x])[0]

    def _exec_sample(self, X):
        return self.evaluate(X)

    def _gradient(self, x):
        return self.computeGradientSample([x])[0]

    def _hessian(self, x):
        # Differences of the exact gradient, with a step of a thousandth of each input's spread: OpenTURNS' own would be
        # differences of values with one absolute step for kilograms and metres alike.
        x = np.asarray(x, dtype=float)
        steps = 1e-3 * np.where(self._map.spread > 0.0, self._map.spread, 1.0)
        points = np.concatenate([x + np.diag(steps), x - np.diag(steps)])
        gradients = self.computeGradientSample(points)
        n = len(x)
        hessian = (gradients[:n] - gradients[n:]) / (2.0 * steps[:, None, None])
        return 0.5 * (hessian + hessian.transpose(1, 0, 2))

    def _run(self, simulation, X, rows, **options):
        parameters = self._map.parameters(X[rows])
        outcome = simulation(self._separation, parameters, tolerance=self._tolerance, **options)
        counted = np.isin(outcome.status, COUNTED) & (self._violating is not None)
        failed = np.flatnonzero((outcome.status != Status.OK) & ~counted)
        if failed.size:
            raise SeparationError(self._failure(X, rows.start + failed, outcome.explain(failed[0])))
        return outcome, counted

    def _checked(self, X):
        X = np.asarray(X, dtype=float)
        if X.ndim != 2 or X.shape[1] != self.getInputDimension():
            raise ValueError(f"the sample has shape {X.shape}; it must be (N, {self.getInputDimension()})")
        # In parts: a sample may be the map of a file that is larger than the memory.
        for start in range(0, len(X), _CHUNK):
            wrong = np.argwhere(~np.isfinite(X[start : start + _CHUNK]))
            if wrong.size:
                row, column = start + wrong[0, 0], wrong[0, 1]
                raise SeparationError(
                    f"{self._map.names[column]} = {X[row, column]} in row {row}: every input must be finite"
                )
        return X

    def _failure(self, X, rows, reason):
        values = ", ".join(
            f"{name} = {value:.9g} {unit}"
            for name, value, unit in zip(self._map.names, X[rows[0]], self._map.units, strict=True)
        )
        more = f" (nor could {len(rows) - 1} other of the {len(X)} rows)" if len(rows) > 1 else ""
        return f"row {rows[0]} could not be simulated{more}: {reason}; its inputs are {values}"


def violating_values(case: Case) -> dict[str, float]:
    """What stands for the quantities of a run that violates every requirement, in their units.

    Parameters
    ----------
    case : Case

    Returns
    -------
    values : dict of str to float
        By quantity: as far beyond its limit as the nominal run is before it (where it has two, the first one counts),
        and the nominal value where there is no limit. Of a norm the first part is the norm, the others are 0.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.separation_function import violating_values
    >>> f"{violating_values(load_case('reference'))['axial_velocity']:.3f}"
    '0.582'
    """
    outcome, table = simulate(case.separation), quantity_table(case.separation)
    nominal = {name: float(outcome.quantity(name)[0]) for name in table}
    values = {name: value if np.isfinite(value) else 0.0 for name, value in nominal.items()}
    if "last_contact" in values:
        # No run that ends well has it: a study counts by it.
        values["last_contact"] = NEVER_FREE
    for entry in reversed(case.requirements):
        distance = abs(entry.compared(nominal[entry.quantity]) - entry.limit)
        distance = distance if 0.0 < distance < np.inf else abs(entry.limit) or 1.0
        value = entry.limit + distance if entry.is_maximum else entry.limit - distance
        if entry.center is not None:
            value = entry.center + max(value, 0.0)
        values[entry.quantity] = value
        parts = table[entry.quantity].norm_of
        values |= {part: value if part == parts[0] else 0.0 for part in parts}
        values |= {name: value for name, quantity in table.items() if quantity.part_of == entry.quantity}
    return values
