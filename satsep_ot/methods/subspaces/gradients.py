"""Gradients of a model at points of the standard space, exact or by differences, counted and checked."""

import dataclasses
import math
import sys
from collections.abc import Callable, Sequence

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.common.units import output_units
from satsep_ot.methods.subspaces.noise import estimate_noise
from satsep_ot.openturns_adapter import callFunction, interruptible

# Numbers handed to the model at once, of which OpenTURNS makes Python objects: more no longer fit into the cache.
BLOCK_NUMBERS = 25_000
# Points that are handed to it in any case, so that a model that shares them among processes can do so.
LEAST_BLOCK = 500
# Gradients that a function is asked for one by one before they count as done.
EXACT_BLOCK = 10


@dataclasses.dataclass(frozen=True, eq=False)
class GradientSample:
    """Gradients at points of the standard space, and what they come with.

    Attributes
    ----------
    points : ndarray (M, d)
    values : ndarray (M, p)
    gradients : ndarray (M, d, p)
        With respect to the standard variables.
    weights : ndarray (M,) or None
    """

    points: np.ndarray
    values: np.ndarray
    gradients: np.ndarray
    weights: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.points)

    @staticmethod
    def of(
        points: ArrayLike, values: ArrayLike, gradients: ArrayLike, weights: ArrayLike | None = None
    ) -> "GradientSample":
        """A sample whose shapes and numbers are checked.

        Parameters
        ----------
        points : array (M, d)
        values : array (M, p), or (M,) for one output
        gradients : array (M, d, p), or (M, d) for one output
        weights : array (M,), optional
            Not negative, at least one positive.

        Raises
        ------
        ValueError
            Shapes that do not match, a number that is not finite, weights that are not allowed.
        """
        points, values, gradients = (np.array(array, dtype=float) for array in (points, values, gradients))
        values = values.reshape(len(values), -1)
        if gradients.ndim == 2:
            gradients = gradients[:, :, None]
        count, d = points.shape if points.ndim == 2 else (0, 0)
        if count < 1 or gradients.shape != (count, d, values.shape[1]) or len(values) != count:
            raise ValueError(
                f"Points {points.shape}, outputs {values.shape} and gradients {gradients.shape} do not match: "
                "(M, d), (M, p) and (M, d, p) with M >= 1 are needed."
            )
        if weights is not None:
            weights = np.array(weights, dtype=float)
            if weights.shape != (count,) or not (np.isfinite(weights).all() and weights.min() >= 0 < weights.max()):
                raise ValueError(f"The weights must be {count} finite numbers >= 0, at least one of them positive.")
        for name, array in (("points", points), ("outputs", values), ("gradients", gradients)):
            finite = np.isfinite(array.reshape(count, -1)).all(axis=1)
            if not finite.all():
                row = int((~finite).argmax())
                raise ValueError(
                    f"The {name} must be finite, but {int((~finite).sum())} of {count} rows are not, the first is row "
                    f"{row} at the standard point {points[row].tolist()}."
                )
        return GradientSample(points, values, gradients, weights)

    @staticmethod
    def joined(samples: Sequence["GradientSample"]) -> "GradientSample":
        """Samples one after the other, without weights."""
        parts = ([getattr(sample, name) for sample in samples] for name in ("points", "values", "gradients"))
        return GradientSample(*map(np.concatenate, parts))


class StandardModel:
    """A function of physical inputs, seen from the standard space.

    Parameters
    ----------
    function : :py:class:`openturns.Function`
    space : :class:`~satsep_ot.methods.common.standard_space.StandardSpace`
    gradientSampleFunction : callable, optional
        X (N, d) -> (N, d, p) of dg_j/dx_i at physical points, asked in place of the function's own gradient.

    Attributes
    ----------
    evaluations, gradients : int
        Made so far.
    """

    def __init__(
        self,
        function: ot.Function,
        space: StandardSpace,
        gradientSampleFunction: Callable[[np.ndarray], ArrayLike] | None = None,
    ) -> None:
        self._function = function
        self._space = space
        self._gradientSampleFunction = gradientSampleFunction
        self.evaluations = 0
        self.gradients = 0

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Outputs (n, p) at standard points (n, d), in blocks.

        Raises
        ------
        ValueError
            An output is not finite.
        """
        return self._evaluatePhysical(self._space.toPhysical(points))

    def _evaluatePhysical(self, physical):
        parts = []
        block = max(LEAST_BLOCK, BLOCK_NUMBERS // physical.shape[1])
        for start in range(0, len(physical), block):
            some = physical[start : start + block]
            values = callFunction(self._function, some)
            self.evaluations += len(values)
            if not np.isfinite(values).all():
                row = int((~np.isfinite(values).all(axis=1)).argmax())
                raise ValueError(
                    f"The function returned {values[row].tolist()} at the physical point {some[row].tolist()}: "
                    "an active subspace needs finite outputs."
                )
            parts.append(values)
        return np.concatenate(parts)

    def exactGradients(self, points: np.ndarray, values: np.ndarray | None = None) -> np.ndarray:
        """The function's own gradients (n, d, p), in the standard space; they need no values.

        Examples
        --------
        >>> import numpy as np
        >>> import openturns as ot
        >>> from satsep_ot.methods.common.standard_space import StandardSpace
        >>> from satsep_ot.methods.subspaces.gradients import StandardModel
        >>> model = StandardModel(ot.SymbolicFunction("x", "x^2"), StandardSpace(ot.Normal(1.0, 2.0)))
        >>> model.exactGradients(np.array([[1.0]])).tolist(), model.gradients
        ([[[12.0]]], 1)
        """
        physical = self._space.toPhysical(points)
        shape = (*physical.shape, self._function.getOutputDimension())
        if self._gradientSampleFunction is not None:
            gradients = np.asarray(self._gradientSampleFunction(physical), dtype=float)
            if gradients.shape != shape:
                raise ValueError(
                    f"The gradient sample function must return an array of shape {shape}, got {gradients.shape}."
                )
        else:
            with interruptible():
                gradients = np.stack([np.array(self._function.gradient(x)) for x in physical])
        self.gradients += len(physical)
        return self._space.chainGradient(points, gradients)

    def differenceStep(self, point: np.ndarray, values: np.ndarray, central: bool) -> tuple[float, np.ndarray]:
        """Step that balances noise and truncation for a function of unit spread, and the noise (p,).

        It is (3 eta)^(1/3) for central differences, 1.68 eta^(1/2) for others; ``values`` (n, p) tell the spread.
        """
        direction = self._space.generateSample(1)[0]
        direction /= np.linalg.norm(direction)
        units = output_units(values)
        noise, _ = estimate_noise(lambda line: self.evaluate(line) / units, point, direction)
        spread = (values / units).std(axis=0)
        # An output that does not vary would make any noise infinite beside its spread.
        relative = float(np.max(np.where(spread > noise, noise / np.where(spread > 0.0, spread, 1.0), 0.0)))
        relative = max(relative, np.finfo(float).eps)
        step = (3.0 * relative) ** (1.0 / 3.0) if central else 1.68 * math.sqrt(relative)
        return min(step, 0.5), noise * units

    def differences(self, points: np.ndarray, values: np.ndarray, step: float, central: bool) -> np.ndarray:
        """Gradients (n, d, p) by differences at points (n, d) with values (n, p)."""
        ahead = self._shiftedValues(points, step)
        behind = self._shiftedValues(points, -step) if central else values[:, None, :]
        return (ahead - behind) / (2.0 * step if central else step)

    def blockSize(self, differences: bool) -> int:
        """Points whose gradients are taken together: after each block they are there, whatever happens to the next."""
        d = self._space.getDimension()
        if differences:
            return max(1, LEAST_BLOCK // d, BLOCK_NUMBERS // d**2)
        return EXACT_BLOCK if self._gradientSampleFunction is None else sys.maxsize

    def _shiftedValues(self, points, shift):
        """Outputs (n, d, p) at points (n, d) moved along one axis after the other."""
        physical = self._space.shiftedPhysical(points, shift)
        return self._evaluatePhysical(physical.reshape(-1, physical.shape[2])).reshape(*points.shape, -1)
