"""Active subspaces in the standard normal space (Constantine, Active Subspaces, SIAM 2015)."""

import math
from collections.abc import Callable

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.common.standard_space import StandardSpace, nameInputs
from satsep_ot.methods.subspaces.noise import estimate_noise
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult
from satsep_ot.openturns_adapter import hasGradient

# Points handed to the model at once when differences are taken.
DIFFERENCE_BLOCK = 20000
GRADIENT_METHODS = ("Automatic", "Exact", "CentralDifference", "ForwardDifference")


class ActiveSubspaceAlgorithm:
    """Active subspace of a function under a distribution, from gradients in the standard space.

    Parameters
    ----------
    function : :py:class:`openturns.Function`
        Physical inputs to outputs. A Python model that offers ``computeGradientSample(X)``, ndarray (N, d) to
        ndarray (N, d, p), may be given itself; its method is then used for all gradients at once.
    distribution : :py:class:`openturns.Distribution`
        Of the physical inputs; see :class:`~satsep_ot.methods.common.standard_space.StandardSpace` for what is refused.

    Notes
    -----
    With one output the matrix is E[grad g grad g^T]; with several it is the sum of theirs, each divided by the
    output's variance over the sample. The gradient in U follows from that in X through the transformation's own.

    Where OpenTURNS would take differences with its fixed absolute step, differences in the standard space are
    taken here, with a step from the estimated noise of the function.

    The default dimension is that of the separated log-gap
    (:func:`~satsep_ot.methods.subspaces.dimension.gap_dimension`); the ladle, the share of
    energy and nested cross-validation of the surrogate are reported where they disagree.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
    >>> ot.RandomGenerator.SetSeed(0)
    >>> function = ot.SymbolicFunction(["a", "b"], ["exp(0.3 * a + 0.4 * b)"])
    >>> algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(2))
    >>> algorithm.setSamplingSize(50)
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> directions = result.getDirections()
    >>> print(result.getDimension(), round(directions[0, 0], 6), round(directions[1, 0], 6))
    1 0.6 0.8
    """

    def __init__(self, function: ot.Function, distribution: ot.Distribution) -> None:
        batched = getattr(function, "computeGradientSample", None)
        self._function = None if function is None else ot.Function(function)
        self._space = StandardSpace(distribution if function is None else nameInputs(distribution, self._function))
        d = self._space.getDimension()
        if self._function is not None and self._function.getInputDimension() != d:
            raise ValueError(
                f"The function has {self._function.getInputDimension()} inputs but the distribution has dimension {d}."
            )
        self._gradientSampleFunction = batched
        self._samplingSize = math.ceil(60.0 * math.log(max(d, 2)))
        self._gradientMethod = "Automatic"
        self._bootstrapSize = 1000
        self._dimension = None
        self._weightFunction = None
        self._targetSubspaceError = None
        self._maximumSamplingSize = 10 * self._samplingSize
        self._step = None
        self._data = None
        self._evaluations = 0
        self._gradients = 0
        self._result = None

    @classmethod
    def FromGradientSample(
        cls,
        distribution: ot.Distribution,
        standardSample: ArrayLike,
        outputSample: ArrayLike,
        gradientSample: ArrayLike,
        weights: ArrayLike | None = None,
    ) -> "ActiveSubspaceAlgorithm":
        """The algorithm on gradients that are already there; it evaluates nothing.

        Parameters
        ----------
        distribution : :py:class:`openturns.Distribution`
        standardSample : array (M, d)
            Points in the standard space.
        outputSample : array (M, p)
            Outputs at these points.
        gradientSample : array (M, d, p), or (M, d) for one output
            Gradients with respect to the standard variables.
        weights : array (M,), optional
            Not negative, at least one positive.
        """
        algorithm = cls(None, distribution)
        d = algorithm._space.getDimension()
        points = np.array(standardSample, dtype=float)
        values = np.array(outputSample, dtype=float)
        gradients = np.array(gradientSample, dtype=float)
        values = values.reshape(len(values), -1)
        if gradients.ndim == 2:
            gradients = gradients[:, :, None]
        count = len(points)
        if count < 1 or points.shape != (count, d) or gradients.shape != (count, d, values.shape[1]):
            raise ValueError(
                f"Points {points.shape}, outputs {values.shape} and gradients {gradients.shape} do not match: "
                f"(M, {d}), (M, p) and (M, {d}, p) with M >= 1 are needed."
            )
        if weights is not None:
            weights = np.array(weights, dtype=float)
            if weights.shape != (count,) or not (np.isfinite(weights).all() and weights.min() >= 0 < weights.max()):
                raise ValueError(f"The weights must be {count} finite numbers >= 0, at least one of them positive.")
        _refuse_not_finite(points, values, gradients)
        algorithm._data = (points, values, gradients, weights)
        return algorithm

    def __repr__(self) -> str:
        return (
            f"ActiveSubspaceAlgorithm(inputs={self._space.getDimension()}, samplingSize={self._samplingSize}, "
            f"gradientMethod={self._gradientMethod})"
        )

    def getDistribution(self) -> ot.Distribution:
        """Distribution of the physical inputs."""
        return self._space.getDistribution()

    def setSamplingSize(self, samplingSize: int) -> None:
        """Number M of points at which gradients are taken, at least 1; fewer than inputs is allowed.

        By default alpha k log d with alpha = 10, k = 6 eigenvalues and d at least 2 (Constantine 2015, section 3.1).
        """
        self._samplingSize = _integer("sampling size", samplingSize, 1)

    def getSamplingSize(self) -> int:
        """Number of points at which gradients are taken."""
        return self._samplingSize

    def setGradientMethod(self, method: str) -> None:
        """How gradients are obtained: "Automatic", "Exact", "CentralDifference" or "ForwardDifference".

        "Automatic" takes the function's own gradient unless OpenTURNS would take differences for it.
        """
        if method not in GRADIENT_METHODS:
            raise ValueError(f"The gradient method must be one of {', '.join(GRADIENT_METHODS)}, got {method!r}.")
        self._gradientMethod = method

    def getGradientMethod(self) -> str:
        """How gradients are obtained."""
        return self._gradientMethod

    def setGradientSampleFunction(self, callable_: Callable[[np.ndarray], ArrayLike] | None) -> None:
        """A callable X (N, d) -> (N, d, p) of dg_j/dx_i at physical points, used for "Automatic" and "Exact"."""
        if not callable(callable_):
            raise TypeError(f"The gradient sample function must be callable, got {type(callable_).__name__}.")
        self._gradientSampleFunction = callable_

    def setFiniteDifferenceStep(self, step: float | None) -> None:
        """Step in the standard space, in standard deviations; None (default) takes it from the estimated noise."""
        if step is not None and not 0.0 < step < math.inf:
            raise ValueError(f"The finite difference step must be positive and finite, got {step}.")
        self._step = step

    def setBootstrapSize(self, bootstrapSize: int) -> None:
        """Number of bootstrap replicates, at least 2 (default 1000)."""
        self._bootstrapSize = _integer("bootstrap size", bootstrapSize, 2)

    def getBootstrapSize(self) -> int:
        """Number of bootstrap replicates."""
        return self._bootstrapSize

    def setDimension(self, dimension: int | None) -> None:
        """Active dimension, 1 to the number of inputs, or None (default) to choose it."""
        if dimension is not None:
            dimension = _integer("dimension", dimension, 1)
            if dimension > self._space.getDimension():
                raise ValueError(f"The dimension must be 1 to {self._space.getDimension()}, got {dimension}.")
        self._dimension = dimension

    def getDimension(self) -> int | None:
        """Active dimension that was asked for, None for the automatic choice."""
        return self._dimension

    def setWeightFunction(self, weightFunction: Callable[[np.ndarray], ArrayLike] | None) -> None:
        """A callable of the outputs, (M, p) -> (M,), that weights the points, for instance near a limit state."""
        if weightFunction is not None and not callable(weightFunction):
            raise TypeError(f"The weight function must be callable, got {type(weightFunction).__name__}.")
        self._weightFunction = weightFunction

    def setTargetSubspaceError(self, target: float | None, maximumSamplingSize: int | None = None) -> None:
        """Add gradients until the upper 95 % band of the subspace distance is at most ``target``.

        Parameters
        ----------
        target : float or None
            In (0, 1); None (default) takes the sampling size as it is.
        maximumSamplingSize : int, optional
            Where to stop anyhow, by default ten times the default sampling size; the result's
            :meth:`~ActiveSubspaceResult.getRemarks` then says so.
        """
        if target is not None and not 0.0 < target < 1.0:
            raise ValueError(f"The target of the subspace error must be in (0, 1), got {target}.")
        self._targetSubspaceError = target
        if maximumSamplingSize is not None:
            self._maximumSamplingSize = _integer("maximum sampling size", maximumSamplingSize, 1)

    def getEvaluationCallsNumber(self) -> int:
        """Evaluations of the function so far, those of finite differences and of the noise included."""
        return self._evaluations

    def getGradientCallsNumber(self) -> int:
        """Gradients of the function so far (of all outputs at a point; none when differences are taken)."""
        return self._gradients

    def _evaluate(self, standardPoints):
        """Outputs (n, p) at standard points, in blocks, counted and checked."""
        parts = []
        for start in range(0, len(standardPoints), DIFFERENCE_BLOCK):
            physical = self._space.toPhysical(standardPoints[start : start + DIFFERENCE_BLOCK])
            values = np.array(self._function(physical))
            self._evaluations += len(values)
            if not np.isfinite(values).all():
                row = int((~np.isfinite(values).all(axis=1)).argmax())
                raise ValueError(
                    f"The function returned {values[row].tolist()} at the physical point {physical[row].tolist()}: "
                    "an active subspace needs finite outputs."
                )
            parts.append(values)
        return np.concatenate(parts)

    def _usesDifferences(self):
        if self._gradientMethod == "Automatic":
            return self._gradientSampleFunction is None and not hasGradient(self._function)
        return self._gradientMethod != "Exact"

    def _exactGradients(self, points):
        physical = self._space.toPhysical(points)
        d, p = physical.shape[1], self._function.getOutputDimension()
        if self._gradientSampleFunction is not None:
            gradients = np.asarray(self._gradientSampleFunction(physical), dtype=float)
            if gradients.shape != (len(physical), d, p):
                raise ValueError(
                    f"The gradient sample function must return an array of shape {(len(physical), d, p)}, "
                    f"got {gradients.shape}."
                )
        else:
            gradients = np.stack([np.array(self._function.gradient(x)) for x in physical])
        self._gradients += len(physical)
        return self._space.chainGradient(points, gradients)

    def _differenceStep(self, points, values, central):
        """Step that balances noise and truncation for a function of unit spread: (3 eta)^(1/3) or 1.68 eta^(1/2)."""
        if self._step is not None:
            return self._step, None
        direction = self._space.generateSample(1)[0]
        direction /= np.linalg.norm(direction)
        noise, _ = estimate_noise(self._evaluate, points[0], direction)
        spread = values.std(axis=0)
        # An output that does not vary would make any noise infinite beside its spread.
        relative = float(np.max(np.where(spread > noise, noise / np.where(spread > 0.0, spread, 1.0), 0.0)))
        relative = max(relative, np.finfo(float).eps)
        step = (3.0 * relative) ** (1.0 / 3.0) if central else 1.68 * math.sqrt(relative)
        return min(step, 0.5), noise

    def _differences(self, points, values, step, central):
        count, d = points.shape
        gradients = np.empty((count, d, values.shape[1]))
        block = max(1, DIFFERENCE_BLOCK // (2 * d))
        shifts = step * np.eye(d)
        for start in range(0, count, block):
            some = points[start : start + block]
            ahead = self._evaluate((some[:, None, :] + shifts).reshape(-1, d)).reshape(len(some), d, -1)
            if central:
                behind = self._evaluate((some[:, None, :] - shifts).reshape(-1, d)).reshape(len(some), d, -1)
                gradients[start : start + block] = (ahead - behind) / (2.0 * step)
            else:
                gradients[start : start + block] = (ahead - values[start : start + block, None, :]) / step
        return gradients

    def run(self) -> None:
        """Take the gradients and estimate the subspace.

        Raises
        ------
        ValueError
            An output or a gradient that is not finite; a dimension asked of a constant function.
        """
        noise = step = None
        if self._data is not None:
            self._result = ActiveSubspaceResult(self._space, *self._data, self._bootstrapSize, self._dimension)
            self._result._setCost(0, 0, None, None)
            return
        differences = self._usesDifferences()
        central = self._gradientMethod != "ForwardDifference"
        d = self._space.getDimension()
        points = np.empty((0, d))
        values = np.empty((0, self._function.getOutputDimension()))
        gradients = np.empty((0, d, values.shape[1]))
        wanted = self._samplingSize
        while True:
            fresh = self._space.generateSample(wanted - len(points))
            freshValues = self._evaluate(fresh)
            if differences:
                if step is None:
                    step, noise = self._differenceStep(fresh, freshValues, central)
                freshGradients = self._differences(fresh, freshValues, step, central)
            else:
                freshGradients = self._exactGradients(fresh)
            _refuse_not_finite(fresh, freshValues, freshGradients)
            points = np.concatenate([points, fresh])
            values = np.concatenate([values, freshValues])
            gradients = np.concatenate([gradients, freshGradients])
            weights = None
            if self._weightFunction is not None:
                weights = np.asarray(self._weightFunction(values), dtype=float).reshape(-1)
                if weights.shape != (len(values),) or not (weights.min() >= 0.0 and 0.0 < weights.max() < math.inf):
                    raise ValueError(
                        "The weight function must return one finite number >= 0 for each point, not all 0."
                    )
            gradientNoise = 0.0
            if noise is not None:
                # Differences turn noise of the values into noise of each component of the gradient.
                gradientNoise = noise / step * (math.sqrt(0.5) if central else math.sqrt(2.0))
            result = ActiveSubspaceResult(
                self._space, points, values, gradients, weights, self._bootstrapSize, self._dimension, gradientNoise
            )
            target = self._targetSubspaceError
            if target is None:
                break
            reached = result._subspaceErrorUpper()
            if reached <= target:
                break
            if len(points) >= self._maximumSamplingSize:
                result._remarks.append(
                    f"The subspace error's upper band is {reached:.3g} after {len(points)} gradients, above the target "
                    f"{target:.3g}: the maximum sampling size was reached."
                )
                break
            wanted = min(math.ceil(1.5 * len(points)), self._maximumSamplingSize)
        result._setCost(self._evaluations, self._gradients, step, noise)
        self._result = result

    def getResult(self) -> ActiveSubspaceResult:
        """The :class:`ActiveSubspaceResult` of the last run."""
        if self._result is None:
            raise RuntimeError("There is no result yet: call run() first.")
        return self._result


def _integer(name, value, least):
    if int(value) != value or value < least:
        raise ValueError(f"The {name} must be an integer of at least {least}, got {value}.")
    return int(value)


def _refuse_not_finite(points, values, gradients):
    for name, array in (("points", points), ("outputs", values), ("gradients", gradients)):
        finite = np.isfinite(array.reshape(len(array), -1)).all(axis=1)
        if not finite.all():
            raise ValueError(
                f"The {name} must be finite, but {int((~finite).sum())} of {len(array)} rows are not, the first is row "
                f"{int((~finite).argmax())} at the standard point {points[int((~finite).argmax())].tolist()}."
            )
