"""Active subspaces in the standard normal space (Constantine, Active Subspaces, SIAM 2015)."""

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.deprecation import DeprecatedAlias
from satsep_ot.methods.common.settings import setting
from satsep_ot.methods.common.standard_space import StandardSpace, nameInputs
from satsep_ot.methods.subspaces.analysis import analyse_gradients, flat_outputs
from satsep_ot.methods.subspaces.gradients import GradientSample, StandardModel
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult
from satsep_ot.openturns_adapter import hasGradient, raisingInterrupts
from satsep_ot.openturns_object import OpenTURNSObject

# With more inputs than this the default number of bootstrap replicates falls in proportion, to no less than that.
_FULL_INPUTS, _LEAST_REPLICATES = 50, 100
GRADIENT_METHODS = ("Automatic", "Exact", "CentralDifference", "ForwardDifference")


class ActiveSubspaceAlgorithm(OpenTURNSObject):
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

    The default dimension, all inputs where no gap separates any direction, comes from the separated log-gap
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

    def __init__(self, function: ot.Function | GradientSample, distribution: ot.Distribution) -> None:
        self._given = function if isinstance(function, GradientSample) else None
        self._function = None if self._given else ot.Function(function)
        self._gradientSampleFunction = getattr(function, "computeGradientSample", None)
        # Before the transformation, which may take long.
        d = distribution.getDimension()
        if self._function and self._function.getInputDimension() != d:
            raise ValueError(
                f"The function has {self._function.getInputDimension()} inputs but the distribution has dimension {d}."
            )
        if self._given and self._given.points.shape[1] != d:
            raise ValueError(
                f"The points have {self._given.points.shape[1]} coordinates but the distribution has dimension {d}."
            )
        self._space = StandardSpace(nameInputs(distribution, self._function) if self._function else distribution)
        self._outputs = list(self._function.getOutputDescription()) if self._function else None
        self._samplingSize = math.ceil(setting("ActiveSubspaceAlgorithm-SamplingFactor") * math.log(max(d, 2)))
        self._gradientMethod = "Automatic"
        self._bootstrapSize = _replicates(d)
        self._dimension: int | None = None
        self._weightFunction: Callable[[np.ndarray], ArrayLike] | None = None
        self._targetSubspaceError: float | None = None
        ratio = int(setting("ActiveSubspaceAlgorithm-MaximumSamplingRatio"))
        self._maximumSamplingSize = ratio * self._samplingSize
        self._step: float | None = None
        self._evaluations = 0
        self._gradients = 0
        self._result: ActiveSubspaceResult | None = None
        # Gradients of a run that was interrupted.
        self._interrupted: GradientSample | None = None

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
        algorithm = cls(GradientSample.of(standardSample, outputSample, gradientSample, weights), distribution)
        if isinstance(outputSample, ot.Sample):
            algorithm._outputs = list(outputSample.getDescription())
        return algorithm

    @classmethod
    def FromPhysicalGradientSample(
        cls,
        distribution: ot.Distribution,
        inputSample: ArrayLike,
        outputSample: ArrayLike,
        gradientSample: ArrayLike,
        weights: ArrayLike | None = None,
    ) -> "ActiveSubspaceAlgorithm":
        """The algorithm on runs with gradients that one already has, as a simulator wrote them; it evaluates nothing.

        Runs without gradients are for :class:`~satsep_ot.methods.subspaces.ridge_approximation.RidgeApproximation`.

        Parameters
        ----------
        distribution : :py:class:`openturns.Distribution`
            What the inputs were drawn from; for others give the ratios of the densities as weights.
        inputSample : array (M, d)
            Physical inputs, inside the range of the distribution.
        outputSample : array (M, p)
        gradientSample : array (M, d, p), or (M, d) for one output
            Derivatives with respect to the physical inputs.
        weights : array (M,), optional

        Examples
        --------
        >>> import numpy as np
        >>> import openturns as ot
        >>> from satsep_ot import ActiveSubspaceAlgorithm
        >>> law = ot.Normal([0.0, 0.0], [1.0, 2.0])
        >>> inputs = np.array(law.getSample(20))
        >>> search = ActiveSubspaceAlgorithm.FromPhysicalGradientSample(
        ...     law, inputs, inputs.sum(axis=1, keepdims=True), np.ones((20, 2))
        ... )
        >>> search.run()
        >>> search.getResult().getEigenvalues()[0].__round__(9)
        5.0
        """
        space = StandardSpace(distribution)
        inputs, gradients = (np.array(array, dtype=float) for array in (inputSample, gradientSample))
        if gradients.ndim == 2:
            gradients = gradients[:, :, None]
        space.refuseOutside(inputs)
        if gradients.shape[:2] != inputs.shape:
            raise ValueError(
                f"The gradients have shape {gradients.shape}; (M, d, p) with {inputs.shape} for (M, d) is needed."
            )
        points = space.toStandard(inputs)
        return cls.FromGradientSample(
            distribution, points, outputSample, space.chainGradient(points, gradients), weights
        )

    def _shown(self):
        return {
            "inputs": self._space.getDimension(),
            "samplingSize": self._samplingSize,
            "gradientMethod": self._gradientMethod,
        }

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

        "Automatic" takes the function's own gradient unless OpenTURNS would take differences for it, or all gradients
        of an output that varies are 0.
        """
        if method not in GRADIENT_METHODS:
            raise ValueError(f"The gradient method is {method!r}; it must be one of {', '.join(GRADIENT_METHODS)}.")
        self._gradientMethod = method

    def getGradientMethod(self) -> str:
        """How gradients are obtained."""
        return self._gradientMethod

    def setGradientSampleFunction(self, callable_: Callable[[np.ndarray], ArrayLike] | None) -> None:
        """A callable X (N, d) -> (N, d, p) of dg_j/dx_i at physical points, used for "Automatic" and "Exact"."""
        if not callable(callable_):
            raise TypeError(f"The gradient sample function is of type {type(callable_).__name__}; it must be callable.")
        self._gradientSampleFunction = callable_

    def setFiniteDifferenceStep(self, step: float | None) -> None:
        """Step in the standard space, in standard deviations; None (default) takes it from the estimated noise."""
        if step is not None and not 0.0 < step < math.inf:
            raise ValueError(f"The finite difference step is {step}; it must be positive and finite.")
        self._step = step

    def setBootstrapSize(self, bootstrapSize: int) -> None:
        """Number of bootstrap replicates, at least 2; by default 1000 with up to 50 inputs, and with more 50,000 over
        their number, but at least 100: the time of each grows with the cube of the inputs."""
        self._bootstrapSize = _integer("bootstrap size", bootstrapSize, 2)

    def getBootstrapSize(self) -> int:
        """Number of bootstrap replicates."""
        return self._bootstrapSize

    def setDimension(self, dimension: int | None) -> None:
        """Active dimension, 1 to the number of inputs, or None (default) to choose it."""
        if dimension is not None:
            dimension = _integer("dimension", dimension, 1)
            if dimension > self._space.getDimension():
                raise ValueError(f"The dimension is {dimension}; it must be 1 to {self._space.getDimension()}.")
        self._dimension = dimension

    def getDimension(self) -> int | None:
        """Active dimension that was asked for, None for the automatic choice."""
        return self._dimension

    def setWeightFunction(self, weightFunction: Callable[[np.ndarray], ArrayLike] | None) -> None:
        """A callable of the outputs, (M, p) -> (M,), that weights the points, for instance near a limit state."""
        if weightFunction is not None and not callable(weightFunction):
            raise TypeError(f"The weight function is of type {type(weightFunction).__name__}; it must be callable.")
        self._weightFunction = weightFunction

    def setTargetSubspaceError(self, target: float | None, maximumSamplingSize: int | None = None) -> None:
        """Add gradients until the upper 95 % band of the subspace distance is at most ``target``.

        Parameters
        ----------
        target : float or None
            In (0, 1); None (default) takes the sampling size as it is.
        maximumSamplingSize : int, optional
            Number of points to stop at in any case, by default ten times the default sampling size; the result's
            :meth:`~ActiveSubspaceResult.getRemarks` then says so.
        """
        if target is not None and not 0.0 < target < 1.0:
            raise ValueError(f"The target of the subspace error is {target}; it must be in (0, 1).")
        self._targetSubspaceError = target
        if maximumSamplingSize is not None:
            self._maximumSamplingSize = _integer("maximum sampling size", maximumSamplingSize, 1)

    def getEvaluationNumber(self) -> int:
        """Evaluations of the function so far, including finite differences and the estimate of the noise."""
        return self._evaluations

    def getGradientNumber(self) -> int:
        """Gradients of the function so far (of all outputs at a point; none when differences are taken)."""
        return self._gradients

    getEvaluationCallsNumber = DeprecatedAlias("getEvaluationNumber")
    getGradientCallsNumber = DeprecatedAlias("getGradientNumber")

    def run(self) -> None:
        """Take the gradients and estimate the subspace.

        Raises
        ------
        ValueError
            An output or a gradient that is not finite; a dimension asked of a constant function.
        KeyboardInterrupt
            Ctrl-C: the result is then of the gradients that were there, with a remark.
        """
        if self._given is not None:
            analysis = analyse_gradients(self._given, self._bootstrapSize, self._dimension)
        else:
            model = StandardModel(self._function, self._space, self._gradientSampleFunction)
            done: list[GradientSample] = []
            try:
                with raisingInterrupts():
                    analysis = self._analyse(model, done)
            except KeyboardInterrupt:
                self._result, self._interrupted = None, GradientSample.joined(done) if done else None
                raise
            finally:
                self._evaluations += model.evaluations
                self._gradients += model.gradients
        self._result, self._interrupted = ActiveSubspaceResult(self._space, analysis, self._outputs), None

    def _usesDifferences(self):
        if self._gradientMethod == "Automatic":
            return self._gradientSampleFunction is None and not hasGradient(self._function)
        return self._gradientMethod != "Exact"

    def _analyse(self, model, done):
        """Analysis of as many gradients of a model as the settings ask for; they are put into the list by and by."""
        differences, central = self._usesDifferences(), self._gradientMethod != "ForwardDifference"
        step = noise = None
        gradientNoise = 0.0
        replaced = np.array(False)
        wanted = self._samplingSize
        while True:
            points = self._space.generateSample(wanted - sum(map(len, done)))
            values = model.evaluate(points)
            if not differences:
                before = len(done)
                self._collect(model.exactGradients, points, values, model.blockSize(False), done)
                # OpenTURNS drops constants of about 1e-11 from the derivatives of a formula, for one.
                if self._gradientMethod == "Automatic":
                    replaced = flat_outputs(values, GradientSample.joined(done[before:]).gradients)
                differences = bool(replaced.any())
                if differences:
                    del done[before:]
            if differences:
                if step is None and self._step is None:
                    step, noise = model.differenceStep(points[0], values, central)
                    # Differences turn noise of the values into noise of each component of the gradient.
                    gradientNoise = noise / step * (math.sqrt(0.5) if central else math.sqrt(2.0))
                elif step is None:
                    step = self._step
                    # What rounding of the values makes of each component.
                    gradientNoise = np.finfo(float).eps * np.abs(values).max(axis=0) / step
                take = functools.partial(model.differences, step=step, central=central)
                self._collect(take, points, values, model.blockSize(True), done)
            sample = self._weighted(GradientSample.joined(done))
            analysis = analyse_gradients(sample, self._bootstrapSize, self._dimension, gradientNoise)
            if replaced.any():
                analysis.remarks.append(
                    f"differences are taken: the function's own gradients of output(s) "
                    f"{', '.join(map(str, np.flatnonzero(replaced)))} are 0, though the values vary."
                )
            target = self._targetSubspaceError
            if target is None or analysis.upper_distance <= target:
                break
            if len(sample) >= self._maximumSamplingSize:
                analysis.remarks.append(
                    f"The subspace error's upper band is {analysis.upper_distance:.3g} after {len(sample)} gradients, "
                    f"above the target {target:.3g}: the maximum sampling size was reached."
                )
                break
            wanted = min(math.ceil(1.5 * len(sample)), self._maximumSamplingSize)
        return dataclasses.replace(
            analysis, evaluations=model.evaluations, gradientCalls=model.gradients, step=step, noise=noise
        )

    @staticmethod
    def _collect(take, points, values, size, done):
        """Gradients at points, block by block, into a list of samples."""
        for start in range(0, len(points), size):
            some = slice(start, start + size)
            done.append(GradientSample.of(points[some], values[some], take(points[some], values[some])))

    def _weighted(self, sample):
        if self._weightFunction is None:
            return sample
        return dataclasses.replace(sample, weights=self._weights(sample.values))

    def _weights(self, values):
        weights = np.asarray(self._weightFunction(values), dtype=float).reshape(-1)
        if weights.shape != (len(values),) or not (weights.min() >= 0.0 and 0.0 < weights.max() < math.inf):
            raise ValueError("The weight function must return one finite number >= 0 for each point, not all 0.")
        return weights

    def getResult(self) -> ActiveSubspaceResult:
        """The :class:`ActiveSubspaceResult` of the last run; of the gradients that were there if it was interrupted."""
        if self._interrupted is not None:
            # Not at the interrupt itself, which is to end the run at once.
            analysis = analyse_gradients(self._weighted(self._interrupted), self._bootstrapSize, self._dimension)
            analysis.remarks.append(f"the run was interrupted after {len(self._interrupted)} gradients")
            self._result, self._interrupted = ActiveSubspaceResult(self._space, analysis, self._outputs), None
        if self._result is None:
            raise RuntimeError("There is no result yet: call run() first.")
        return self._result


def _replicates(inputs):
    """Default number of bootstrap replicates of so many inputs."""
    number = int(setting("ActiveSubspaceAlgorithm-BootstrapSize"))
    return min(number, max(_LEAST_REPLICATES, round(number * _FULL_INPUTS / inputs)))


def _integer(name, value, least):
    if int(value) != value or value < least:
        raise ValueError(f"The {name} is {value}; it must be an integer of at least {least}.")
    return int(value)
