"""Active subspaces in the standard normal space (Constantine, Active Subspaces, SIAM 2015)."""

import math

import numpy as np
import openturns as ot
from scipy import linalg

from satsep_ot.methods.active_variables import (
    activeTransformation,
    drawSufficientSummary,
    inverseActiveTransformation,
    surrogate_degree,
)
from satsep_ot.methods.polynomial_basis import PolynomialBasis, fit_polynomial
from satsep_ot.methods.ridge_approximation import orient, subspace_distance
from satsep_ot.methods.standard_space import StandardSpace

# Candidates for the dimension are 0 to this: a surrogate of more active variables is no gain.
LARGEST_DIMENSION = 10
# Points handed to the model at once when differences are taken.
DIFFERENCE_BLOCK = 20000
# Below this many rows for each input, a bootstrap replicate may span less than the whole sample.
ROWS_FOR_CHOLESKY = 4
GRADIENT_METHODS = ("Automatic", "Exact", "CentralDifference", "ForwardDifference")


def estimate_subspace(gradients, scales=None, weights=None):
    """Eigenvalues and eigenvectors of sum_j E[grad g_j grad g_j^T] / scale_j, by SVD of the stacked gradients.

    Parameters
    ----------
    gradients : ndarray (M, d, p)
        Gradients in the standard space.
    scales : ndarray (p,), optional
        Divisor of each output's part, for instance its variance; 1 by default.
    weights : ndarray (M,), optional
        Not negative; normalised to sum 1.

    Returns
    -------
    eigenvalues : ndarray (d,)
        Decreasing; exactly 0 where fewer than d gradients leave them unresolved.
    vectors : ndarray (d, d)
        Orthonormal columns, the largest component of each positive.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.active_subspace import estimate_subspace
    >>> eigenvalues, vectors = estimate_subspace(np.array([[[3.0], [4.0]], [[6.0], [8.0]]]))
    >>> eigenvalues.round(12).tolist(), vectors[:, 0].round(12).tolist()
    ([62.5, 0.0], [0.6, 0.8])
    """
    rows = _stacked_rows(gradients, scales, weights)
    if len(rows) > rows.shape[1]:
        rows = linalg.qr(rows, mode="r", check_finite=False)[0][: rows.shape[1]]
    _, singular, vectors = np.linalg.svd(rows, full_matrices=True)
    eigenvalues = np.zeros(rows.shape[1])
    eigenvalues[: len(singular)] = singular**2
    return eigenvalues, orient(vectors.T)


def _stacked_rows(gradients, scales, weights):
    """Rows (M p, d), the outputs of a point together, with rows^T rows the matrix of the active subspace."""
    count, d, p = gradients.shape
    scale = np.ones(p) if scales is None else 1.0 / np.sqrt(scales)
    weight = np.full(count, 1.0 / count) if weights is None else weights / weights.sum()
    return (gradients.transpose(0, 2, 1) * scale[:, None] * np.sqrt(weight)[:, None, None]).reshape(count * p, d)


def bootstrap_subspace(gradients, size, largest, scales=None, weights=None):
    """Bootstrap of the gradient rows, all outputs of a point together.

    Parameters
    ----------
    gradients, scales, weights
        As in :func:`estimate_subspace`.
    size : int
        Number of replicates.
    largest : int
        Number of leading vectors kept.

    Returns
    -------
    counts : ndarray (size, M)
        How often each point was drawn.
    eigenvalues : ndarray (size, d)
    vectors : ndarray (size, d, largest)
    """
    count, d, p = gradients.shape
    # One draw from OpenTURNS' generator seeds numpy's, which draws many integers far faster.
    generator = np.random.default_rng(ot.RandomGenerator.IntegerGenerate(2**31 - 1))
    counts = generator.multinomial(count, np.full(count, 1.0 / count), size=size)
    factors = counts.astype(float)
    if weights is not None:
        # The drawn weights are normalised anew, as in the estimate itself.
        drawn = counts @ (weights / weights.sum())
        factors /= np.where(drawn > 0.0, drawn, 1.0)[:, None]
    rows = _stacked_rows(gradients, scales, weights)
    factors = np.repeat(factors, p, axis=1)
    eigenvalues = np.zeros((size, d))
    vectors = np.empty((size, d, largest))
    whitened = triangle = None
    if len(rows) >= ROWS_FOR_CHOLESKY * d and count >= 2 * d:
        whitened, triangle = linalg.qr(rows, mode="economic", check_finite=False)
        products = (whitened[:, :, None] * whitened[:, None, :]).reshape(len(rows), d * d)
    block = max(1, 4_000_000 // (max(d, len(rows)) * d))
    for start in range(0, size, block):
        factor = factors[start : start + block]
        if triangle is not None:
            try:
                # The replicate is sqrt(D) Q R with Q^T D Q = L L^T well conditioned, so its singular values are
                # those of L^T R: no squaring of R, whose range of scales is the interesting one.
                lower = np.linalg.cholesky((factor @ products).reshape(-1, d, d))
                replicates = lower.transpose(0, 2, 1) @ triangle
            except np.linalg.LinAlgError:
                replicates = np.sqrt(factor)[:, :, None] * rows
        else:
            replicates = np.sqrt(factor)[:, :, None] * rows
        _, singular, right = np.linalg.svd(replicates, full_matrices=replicates.shape[1] < d)
        eigenvalues[start : start + block, : singular.shape[1]] = singular**2
        vectors[start : start + block] = right[:, :largest].transpose(0, 2, 1)
    return counts, eigenvalues, vectors


def bootstrap_distances(vectors, replicates):
    """Distances ||W W^T - V V^T||_2 between leading subspaces of dimension 1 to ``largest``.

    Parameters
    ----------
    vectors : ndarray (d, d)
    replicates : ndarray (size, d, largest)

    Returns
    -------
    ndarray (size, largest)
    """
    overlap = vectors.T @ replicates
    distances = np.zeros((len(replicates), replicates.shape[2]))
    for r in range(1, replicates.shape[2] + 1):
        outside = overlap[:, r:, :r]
        if outside.shape[1]:
            gram = outside.transpose(0, 2, 1) @ outside
            distances[:, r - 1] = np.sqrt(np.clip(np.linalg.eigvalsh(gram)[:, -1], 0.0, 1.0))
    return distances


def ladle_dimension(eigenvalues, vectors, replicates):
    """Dimension by the ladle estimator of Luo and Li, Biometrika 103 (2016).

    The k that minimises the sum of the next eigenvalue and of the bootstrap variability
    1 - |det(W_k^T V_k)| of the first k vectors, each normalised by its sum over k (the latter plus 1).

    Returns
    -------
    int
        0 for equal eigenvalues and for a zero matrix.
    """
    d = len(eigenvalues)
    if not eigenvalues[0] > 0.0:
        return 0
    if d == 1:
        return 1
    # All d vectors always span everything: that choice would need no data.
    largest = min(replicates.shape[2], d - 1)
    overlap = vectors.T @ replicates
    variability = np.zeros(largest + 1)
    for k in range(1, largest + 1):
        variability[k] = np.mean(1.0 - np.abs(np.linalg.det(overlap[:, :k, :k])))
    following = eigenvalues[: largest + 1]
    # The eigenvalues are taken relative to their sum, so that the unit of the output does not matter.
    score = following / following.sum() + variability / (1.0 + variability.sum())
    # Equal up to rounding: the smaller dimension.
    return int(np.argmax(score <= score.min() + 1e-12))


def gap_dimension(eigenvalues, replicates, largest, level=0.95):
    """Dimension by the largest gap of log eigenvalues among those that the bootstrap separates.

    Parameters
    ----------
    eigenvalues : ndarray (d,)
    replicates : ndarray (size, d)
    largest : int
        Largest dimension that is considered.
    level : float
        Level of the bands that must not overlap.

    Returns
    -------
    int
        0 when no gap is separated.
    """
    if not eigenvalues[0] > 0.0:
        return 0
    d = len(eigenvalues)
    # Singular values are known to rounding of the largest: below it every eigenvalue is the same zero.
    floor = (d * np.finfo(float).eps) ** 2 * eigenvalues[0]
    lower, upper = _bands(np.maximum(replicates, floor), level)
    logarithm = np.log(np.maximum(eigenvalues, floor))
    gaps = [(logarithm[k - 1] - logarithm[k], k) for k in range(1, min(largest, d - 1) + 1) if lower[k - 1] > upper[k]]
    if not gaps:
        # One input: its eigenvalue is not 0 and there is nothing to separate it from.
        return 1 if d == 1 else 0
    return max(gaps)[1]


def cross_validated_error(points, values, gradients, dimension, scales, weights, folds=5):
    """Nested cross-validation of the polynomial surrogate: the subspace is estimated anew in every fold.

    Returns
    -------
    ndarray (N,)
        Squared errors of prediction, summed over the outputs in units of their scale.
    """
    count = len(points)
    generator = np.random.default_rng(ot.RandomGenerator.IntegerGenerate(2**31 - 1))
    order = generator.permutation(count)
    errors = np.empty(count)
    for fold in np.array_split(order, min(folds, count)):
        kept = np.setdiff1d(order, fold)
        used = None if weights is None else weights[kept]
        _, vectors = estimate_subspace(gradients[kept], scales, used)
        directions = vectors[:, :dimension]
        degree = surrogate_degree(len(kept), dimension)
        basis = PolynomialBasis(dimension, degree)
        fit = fit_polynomial(basis, points[kept] @ directions, values[kept], used, allow_deficient=True)
        error = values[fold] - fit.predict(points[fold] @ directions)
        errors[fold] = (error**2 / scales).sum(axis=1)
    return errors


def estimate_noise(function, point, direction, spacing=1e-6):
    """Level of the noise of a computed function along a line (Moré and Wild, SIAM J. Sci. Comput. 33, 2011).

    Parameters
    ----------
    function : callable
        (n, d) ndarray to (n, p) ndarray.
    point, direction : ndarray (d,)
    spacing : float
        First distance of the nine points along the line; it is adapted.

    Returns
    -------
    noise : ndarray (p,)
        Standard deviation of the noise of each output; rounding level where none is seen.
    evaluations : int
    """
    order = 8
    evaluations = 0
    rounding = noise = None
    for _ in range(4):
        line = point + spacing * (np.arange(order + 1) - order / 2)[:, None] * direction
        values = function(line)
        evaluations += len(line)
        if rounding is None:
            rounding = np.finfo(float).eps * np.abs(values).max(axis=0)
            noise = np.full(values.shape[1], np.nan)
        differences = values
        levels, changes = [], []
        for k in range(1, order + 1):
            differences = np.diff(differences, axis=0)
            gamma = math.factorial(k) ** 2 / math.factorial(2 * k)
            levels.append(np.sqrt(gamma * np.mean(differences**2, axis=0)))
            changes.append((differences.min(axis=0) < 0.0) & (differences.max(axis=0) > 0.0))
        levels, changes = np.array(levels), np.array(changes)
        for k in range(order - 3):
            window = levels[k : k + 3]
            agree = (window.max(axis=0) <= 4.0 * window.min(axis=0)) & changes[k]
            fresh = np.isnan(noise) & agree
            noise[fresh] = window[0][fresh]
        still = np.mean(np.diff(values, axis=0) == 0.0, axis=0) > 0.5
        if not np.isnan(noise).any():
            break
        # Too close when values repeat, too far when the smooth part dominates every difference.
        spacing *= 100.0 if still[np.isnan(noise)].any() else 0.01
    return np.maximum(np.where(np.isnan(noise), rounding, noise), rounding), evaluations


def _bands(replicates, level):
    tail = 0.5 * (1.0 - level)
    return np.quantile(replicates, [tail, 1.0 - tail], axis=0)


def _check_level(level):
    if not 0.0 < level < 1.0:
        raise ValueError(f"The confidence level must be in (0, 1), got {level}.")


class ActiveSubspaceAlgorithm:
    """Active subspace of a function under a distribution, from gradients in the standard space.

    Parameters
    ----------
    function : :py:class:`openturns.Function`
        Physical inputs to outputs. A Python model that offers ``computeGradientSample(X)``, ndarray (N, d) to
        ndarray (N, d, p), may be given itself; its method is then used for all gradients at once.
    distribution : :py:class:`openturns.Distribution`
        Of the physical inputs; see :class:`~satsep_ot.methods.standard_space.StandardSpace` for what is refused.

    Notes
    -----
    With one output the matrix is E[grad g grad g^T]; with several it is the sum of theirs, each divided by the
    output's variance over the sample. The gradient in U follows from that in X through the transformation's own.

    Where OpenTURNS would take differences with its fixed absolute step, differences in the standard space are
    taken here, with a step from the estimated noise of the function.

    The default dimension is that of the ladle; when the separated log-gap disagrees, nested cross-validation of
    the polynomial surrogate decides between the two, and the result tells.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.active_subspace import ActiveSubspaceAlgorithm
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

    def __init__(self, function, distribution):
        self._space = StandardSpace(distribution)
        batched = getattr(function, "computeGradientSample", None)
        self._function = None if function is None else ot.Function(function)
        d = self._space.getDimension()
        if self._function is not None and self._function.getInputDimension() != d:
            raise ValueError(
                f"The function has {self._function.getInputDimension()} inputs but the distribution has dimension {d}."
            )
        self._gradientSampleFunction = batched
        # alpha k log d with alpha = 10 and k = 6 eigenvalues (Constantine 2015, section 3.1).
        self._samplingSize = max(20, math.ceil(60.0 * math.log(max(d, 2))))
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
    def FromGradientSample(cls, distribution, standardSample, outputSample, gradientSample, weights=None):
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

    def __repr__(self):
        return (
            f"ActiveSubspaceAlgorithm(inputs={self._space.getDimension()}, samplingSize={self._samplingSize}, "
            f"gradientMethod={self._gradientMethod})"
        )

    def getDistribution(self):
        """Distribution of the physical inputs."""
        return self._space.getDistribution()

    def setSamplingSize(self, samplingSize):
        """Number M of points at which gradients are taken, at least 1; fewer than inputs is allowed."""
        self._samplingSize = _integer("sampling size", samplingSize, 1)

    def getSamplingSize(self):
        """Number of points at which gradients are taken."""
        return self._samplingSize

    def setGradientMethod(self, method):
        """How gradients are obtained: "Automatic", "Exact", "CentralDifference" or "ForwardDifference".

        "Automatic" takes the function's own gradient unless OpenTURNS would take differences for it.
        """
        if method not in GRADIENT_METHODS:
            raise ValueError(f"The gradient method must be one of {', '.join(GRADIENT_METHODS)}, got {method!r}.")
        self._gradientMethod = method

    def getGradientMethod(self):
        """How gradients are obtained."""
        return self._gradientMethod

    def setGradientSampleFunction(self, callable_):
        """A callable X (N, d) -> (N, d, p) of dg_j/dx_i at physical points, used for "Automatic" and "Exact"."""
        if not callable(callable_):
            raise TypeError(f"The gradient sample function must be callable, got {type(callable_).__name__}.")
        self._gradientSampleFunction = callable_

    def setFiniteDifferenceStep(self, step):
        """Step in the standard space, in standard deviations; None (default) takes it from the estimated noise."""
        if step is not None and not 0.0 < step < math.inf:
            raise ValueError(f"The finite difference step must be positive and finite, got {step}.")
        self._step = step

    def setBootstrapSize(self, bootstrapSize):
        """Number of bootstrap replicates, at least 2 (default 1000)."""
        self._bootstrapSize = _integer("bootstrap size", bootstrapSize, 2)

    def getBootstrapSize(self):
        """Number of bootstrap replicates."""
        return self._bootstrapSize

    def setDimension(self, dimension):
        """Active dimension, 1 to the number of inputs, or None (default) to choose it."""
        if dimension is not None:
            dimension = _integer("dimension", dimension, 1)
            if dimension > self._space.getDimension():
                raise ValueError(f"The dimension must be 1 to {self._space.getDimension()}, got {dimension}.")
        self._dimension = dimension

    def getDimension(self):
        """Active dimension that was asked for, None for the automatic choice."""
        return self._dimension

    def setWeightFunction(self, weightFunction):
        """A callable of the outputs, (M, p) -> (M,), that weights the points, for instance near a limit state."""
        if weightFunction is not None and not callable(weightFunction):
            raise TypeError(f"The weight function must be callable, got {type(weightFunction).__name__}.")
        self._weightFunction = weightFunction

    def setTargetSubspaceError(self, target, maximumSamplingSize=None):
        """Add gradients until the upper 95 % band of the subspace distance is at most ``target``.

        Parameters
        ----------
        target : float or None
            In (0, 1); None (default) takes the sampling size as it is.
        maximumSamplingSize : int, optional
            Where to stop anyhow; the result's :meth:`~ActiveSubspaceResult.getRemarks` then says so.
        """
        if target is not None and not 0.0 < target < 1.0:
            raise ValueError(f"The target of the subspace error must be in (0, 1), got {target}.")
        self._targetSubspaceError = target
        if maximumSamplingSize is not None:
            self._maximumSamplingSize = _integer("maximum sampling size", maximumSamplingSize, 1)

    def getEvaluationCallsNumber(self):
        """Evaluations of the function so far, those of finite differences and of the noise included."""
        return self._evaluations

    def getGradientCallsNumber(self):
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
            return self._gradientSampleFunction is None and "DifferenceGradient" in repr(self._function.getGradient())
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

    def run(self):
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

    def getResult(self):
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


class ActiveSubspaceResult:
    """Result of :class:`ActiveSubspaceAlgorithm`.

    Intervals are bootstrap quantiles over the gradient sample, all outputs of a point together.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.active_subspace import ActiveSubspaceAlgorithm
    >>> ot.RandomGenerator.SetSeed(0)
    >>> function = ot.SymbolicFunction(["a", "b", "c"], ["(a + b)^2 + 0.1 * c"])
    >>> algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(3))
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> result.getTransformation().getOutputDimension()
    2
    >>> graph = result.drawEigenvalues()
    """

    def __init__(self, space, points, values, gradients, weights, bootstrapSize, dimension, gradientNoise=0.0):
        self._space = space
        self._points = points
        self._values = values
        self._gradients = gradients
        self._weights = weights
        self._remarks = []
        count, d, p = gradients.shape
        self._variances = np.cov(values.T, ddof=1).reshape(p, -1).diagonal() if count > 1 else np.zeros(p)
        self._scales = np.ones(p)
        if p > 1:
            # An output that does not vary has no gradient either: any scale leaves it out.
            self._scales = np.where(self._variances > 0.0, self._variances, 1.0)
        self._eigenvalues, self._vectors = estimate_subspace(gradients, self._scales, weights)
        self._resolved = min(count * p, d)
        # A dimension above half of the points is never determined by them.
        self._largest = max(1, min(d, LARGEST_DIMENSION, count // 2))
        self._counts, self._eigenvalueReplicates, self._vectorReplicates = bootstrap_subspace(
            gradients, bootstrapSize, max(self._largest, dimension or 0), self._scales, weights
        )
        self._distances = bootstrap_distances(self._vectors, self._vectorReplicates)
        if self._resolved < d:
            self._remarks.append(
                f"{count} gradients of {p} output(s) resolve {self._resolved} of {d} eigenvalues: the others are "
                "reported as 0 and the error bound does not see them."
            )
        # What rounding of the outputs, and the largest eigenvalue of pure noise in the gradients, can look like.
        rounding = 1e-14 * np.abs(values).max(axis=0) / np.sqrt(self._scales)
        edge = 2.0 * (1.0 + math.sqrt(d / count)) * gradientNoise / np.sqrt(self._scales)
        self._constant = not self._eigenvalues[0] > max((rounding**2).max(), (edge**2).sum())
        self._choices = self._chooseDimension()
        if dimension is not None and self._constant:
            raise ValueError(f"Dimension {dimension} was asked for, but the function is constant: all gradients are 0.")
        self._dimension = self._choices["chosen"] if dimension is None else dimension
        self._setCost(0, 0, None, None)

    def __repr__(self):
        return (
            f"ActiveSubspaceResult(inputs={len(self._eigenvalues)}, outputs={self._values.shape[1]}, "
            f"gradients={len(self._points)}, dimension={self._dimension})"
        )

    def _setCost(self, evaluations, gradients, step, noise):
        self._evaluations = evaluations
        self._gradientCalls = gradients
        self._step = step
        self._noise = noise

    def _chooseDimension(self):
        vectors = self._vectorReplicates[:, :, : self._largest]
        ladle = ladle_dimension(self._eigenvalues, self._vectors, vectors)
        gap = gap_dimension(self._eigenvalues, self._eigenvalueReplicates, self._largest)
        if self._constant:
            return {"ladle": 0, "gap": 0, "chosen": 0, "agree": True}
        choices = {"ladle": ladle, "gap": gap, "chosen": ladle, "agree": ladle == gap}
        if ladle == gap:
            return choices
        low, high = sorted((ladle, gap))
        if len(self._points) >= 3 * (high + 2):
            scales = np.where(self._variances > 0.0, self._variances, 1.0)
            errors = [
                cross_validated_error(self._points, self._values, self._gradients, r, scales, self._weights)
                for r in (low, high)
            ]
            gain = errors[0] - errors[1]
            # The larger one has to be better by a standard error of the paired difference.
            better = gain.mean() > gain.std(ddof=1) / math.sqrt(len(gain))
            choices["crossValidation"] = high if better else low
            choices["chosen"] = choices["crossValidation"]
        self._remarks.append(
            f"The ladle gives dimension {ladle}, the separated log-gap {gap}"
            + (f", cross-validation {choices['crossValidation']}" if "crossValidation" in choices else "")
            + f": {choices['chosen']} is taken."
        )
        return choices

    def getEigenvalues(self):
        """All d eigenvalues, decreasing (in units of the output squared; without unit for several outputs)."""
        return ot.Point(self._eigenvalues)

    def getEigenvaluesInterval(self, level=0.95):
        """Bootstrap quantile interval of each eigenvalue, an :py:class:`openturns.Interval`."""
        _check_level(level)
        return ot.Interval(*_bands(self._eigenvalueReplicates, level))

    def getResolvedEigenvaluesNumber(self):
        """How many eigenvalues the gradients can resolve; the others are reported as 0."""
        return self._resolved

    def getEigenvectors(self):
        """All eigenvectors as the columns of a (d, d) :py:class:`openturns.Matrix`, largest component positive."""
        return ot.Matrix(self._vectors)

    def getSubspaceError(self):
        """Bootstrap mean of the distance ||W W^T - V V^T||_2 for the dimensions 1, 2, ..."""
        return ot.Point(self._distances.mean(axis=0))

    def getSubspaceErrorInterval(self, level=0.95):
        """Bootstrap quantile interval of the subspace distance for the dimensions 1, 2, ..."""
        _check_level(level)
        return ot.Interval(*_bands(self._distances, level))

    def _subspaceErrorUpper(self):
        if self._dimension == 0:
            return 1.0
        return float(_bands(self._distances, 0.95)[1][self._dimension - 1])

    def getDimension(self):
        """Active dimension; 0 for a constant function and where no gap separates any direction."""
        return self._dimension

    def getDimensionChoices(self):
        """What each criterion says: a dict with "ladle", "gap", perhaps "crossValidation", "chosen" and "agree"."""
        return dict(self._choices)

    def getRemarks(self):
        """Sentences on what a reader should know: unresolved eigenvalues, criteria that disagree, a target missed."""
        return list(self._remarks)

    def isConstant(self):
        """Whether the gradients are 0 up to rounding and up to the noise of the differences."""
        return self._constant

    def getRepeatedGroups(self, level=0.95):
        """Runs of eigenvalues whose bands overlap: within a run the single vectors mean nothing, their span does.

        Returns
        -------
        list of list of int
            Positions from 0; groups of at least two among the resolved eigenvalues that are not 0.
        """
        _check_level(level)
        lower, upper = _bands(self._eigenvalueReplicates, level)
        groups, group = [], []
        floor = (len(lower) * np.finfo(float).eps) ** 2 * self._eigenvalues[0]
        for i in range(self._resolved):
            if not self._eigenvalues[i] > floor:
                break
            if group and upper[i] < lower[i - 1]:
                groups.append(group)
                group = []
            group.append(i)
        groups.append(group)
        return [group for group in groups if len(group) > 1]

    def getDirections(self):
        """Active directions W1 as orthonormal columns, (d, r) :py:class:`openturns.Matrix`."""
        return ot.Matrix(self._active())

    def _active(self):
        return self._vectors[:, : self._dimension]

    def _needDirections(self):
        if self._dimension == 0:
            reason = "the function is constant" if self._constant else "no gap separates any direction"
            raise ValueError(f"There is no active variable: {reason}; setDimension() of the algorithm forces one.")

    def getTransformation(self):
        """Physical inputs to active variables, y = W1^T T(x), a native :py:class:`openturns.Function`."""
        self._needDirections()
        return activeTransformation(self._space, self._active())

    def getInverseTransformation(self):
        """Active variables to the physical inputs with inactive variables 0, x = T^-1(W1 y), a native function."""
        self._needDirections()
        return inverseActiveTransformation(self._space, self._active())

    def getStandardSpace(self):
        """The :class:`~satsep_ot.methods.standard_space.StandardSpace` that was used."""
        return self._space

    def getStandardSample(self):
        """Points in the standard space, :py:class:`openturns.Sample` (M, d)."""
        return ot.Sample(self._points)

    def getOutputSample(self):
        """Outputs at the points, :py:class:`openturns.Sample` (M, p)."""
        return ot.Sample(self._values)

    def getGradientSample(self):
        """Gradients in the standard space, ndarray (M, d, p)."""
        return self._gradients.copy()

    def getWeights(self):
        """Weights of the points, which sum to 1."""
        if self._weights is None:
            return ot.Point(len(self._points), 1.0 / len(self._points))
        return ot.Point(self._weights / self._weights.sum())

    def getAverageGradient(self):
        """Unit vector along the mean gradient (one output): exact for a ridge that rises everywhere."""
        if self._gradients.shape[2] != 1:
            raise ValueError(f"The average gradient needs one output, there are {self._gradients.shape[2]}.")
        mean = np.array(self.getWeights()) @ self._gradients[:, :, 0]
        length = np.linalg.norm(mean)
        if not length > 0.0:
            raise ValueError("The mean gradient is 0: it has no direction.")
        return ot.Point(mean / length)

    def getActivityScores(self, dimension=None):
        """Activity score of each input, sum_{j <= n} lambda_j w_ij^2 (Constantine and Diaz 2017).

        Parameters
        ----------
        dimension : int, optional
            n; by default the active dimension. With n = d they are the derivative-based measures.

        Notes
        -----
        They belong to the standard variables. For dependent inputs the i-th standard variable is the i-th input
        given those before it (Rosenblatt), so the scores depend on the order of the inputs.
        """
        n = self._scoreDimension(dimension, len(self._eigenvalues))
        return ot.Point((self._vectors[:, :n] ** 2) @ self._eigenvalues[:n])

    def getActivityScoresInterval(self, level=0.95, dimension=None):
        """Bootstrap quantile interval of the activity scores."""
        _check_level(level)
        if dimension == len(self._eigenvalues):
            return self.getDerivativeBasedIndicesInterval(level)
        n = self._scoreDimension(dimension, self._vectorReplicates.shape[2])
        replicates = np.einsum("bij,bj->bi", self._vectorReplicates[:, :, :n] ** 2, self._eigenvalueReplicates[:, :n])
        return ot.Interval(*_bands(replicates, level))

    def _scoreDimension(self, dimension, largest):
        if dimension is None:
            return self._dimension
        if not 0 <= dimension <= largest:
            raise ValueError(f"Activity scores exist here for dimensions 0 to {largest}, got {dimension}.")
        return dimension

    def _squares(self):
        return ((self._gradients**2) / self._scales).sum(axis=2)

    def getDerivativeBasedIndices(self):
        """Derivative-based sensitivity nu_i = E[(dg/du_i)^2], summed over outputs in units of their scale."""
        return ot.Point(np.array(self.getWeights()) @ self._squares())

    def getDerivativeBasedIndicesInterval(self, level=0.95):
        """Bootstrap quantile interval of the derivative-based sensitivity."""
        _check_level(level)
        weights = self._counts * np.array(self.getWeights())
        total = weights.sum(axis=1, keepdims=True)
        replicates = (weights / np.where(total > 0.0, total, 1.0)) @ self._squares()
        return ot.Interval(*_bands(replicates, level))

    def getTotalSobolBound(self):
        """Upper bounds nu_i / Var g of the total Sobol indices in U (Poincare inequality; one output).

        Reference: Sobol and Kucherenko, Math. Comput. Simul. 79 (2009).
        """
        if self._values.shape[1] != 1:
            raise ValueError(f"The bound on total Sobol indices needs one output, there are {self._values.shape[1]}.")
        if self._constant or not self._variances[0] > 0.0:
            raise ValueError("The function is constant over the sample: it has no Sobol indices.")
        return ot.Point(np.array(self.getDerivativeBasedIndices()) / self._variances[0])

    def getErrorBound(self):
        """Bound on the root mean square error of E[g | y]: square root of the trailing sum of eigenvalues.

        It follows from the Poincare inequality of the standard normal law, whose constant is 1
        (Constantine, Dow and Wang, SIAM J. Sci. Comput. 36, 2014).
        """
        return float(np.sqrt(self._eigenvalues[self._dimension :].sum()))

    def getErrorBoundInterval(self, level=0.95):
        """Bootstrap quantile interval (1-dimensional) of the error bound."""
        _check_level(level)
        lower, upper = _bands(np.sqrt(self._eigenvalueReplicates[:, self._dimension :].sum(axis=1)), level)
        return ot.Interval(float(lower), float(upper))

    def getEvaluationCallsNumber(self):
        """Evaluations of the function, those of finite differences and of the noise included."""
        return self._evaluations

    def getGradientCallsNumber(self):
        """Gradients of the function (of all outputs at a point); 0 when differences were taken."""
        return self._gradientCalls

    def getFiniteDifferenceStep(self):
        """Step of the differences in the standard space, None when there were none."""
        return self._step

    def getNoise(self):
        """Estimated noise of each output (standard deviation), None when it was not needed."""
        return None if self._noise is None else ot.Point(self._noise)

    def getActiveSample(self):
        """Active variables at the points, :py:class:`openturns.Sample` (M, r)."""
        self._needDirections()
        return ot.Sample(self._points @ self._active())

    def drawEigenvalues(self, level=0.95):
        """Eigenvalues on a logarithmic scale with their bootstrap band, :py:class:`openturns.Graph`."""
        _check_level(level)
        number = min(self._resolved, len(self._eigenvalues))
        # A zero has no logarithm: it is drawn at the rounding level of the largest.
        floor = max((len(self._eigenvalues) * np.finfo(float).eps) ** 2 * self._eigenvalues[0], np.finfo(float).tiny)
        graph = ot.Graph(
            "Eigenvalues with bootstrap band",
            "number",
            "eigenvalue",
            True,
            "upper right",
            1.0,
            ot.GraphImplementation.LOGY,
        )
        lower, upper = (np.maximum(band[:number], floor) for band in _bands(self._eigenvalueReplicates, level))
        _add_band(graph, np.maximum(self._eigenvalues[:number], floor), lower, upper, level)
        return graph

    def drawSubspaceError(self, level=0.95):
        """Bootstrap mean and band of the subspace distance by dimension, :py:class:`openturns.Graph`."""
        _check_level(level)
        graph = ot.Graph("Subspace distance with bootstrap band", "dimension", "distance", True, "upper right")
        number = min(self._distances.shape[1], max(1, len(self._eigenvalues) - 1))
        lower, upper = _bands(self._distances[:, :number], level)
        _add_band(graph, self._distances[:, :number].mean(axis=0), lower, upper, level)
        return graph

    def drawActivityScores(self, level=0.95, names=None):
        """Activity scores with bootstrap intervals, largest first, :py:class:`openturns.Graph`."""
        scores = np.array(self.getActivityScores())
        interval = self.getActivityScoresInterval(level)
        lower, upper = np.array(interval.getLowerBound()), np.array(interval.getUpperBound())
        order = np.argsort(-scores, kind="stable")
        names = list(names or self._space.getDistribution().getDescription())
        ranked = ", ".join(names[i] for i in order[:5])
        graph = ot.Graph(f"Activity scores, largest: {ranked}", "input", "score", True, "")
        for position, i in enumerate(order):
            # Polygons rather than a BarPlot, whose bars cannot be told apart by input.
            graph.add(
                ot.Polygon(
                    [
                        [position + 0.6, 0.0],
                        [position + 1.4, 0.0],
                        [position + 1.4, scores[i]],
                        [position + 0.6, scores[i]],
                    ],
                    "steelblue",
                    "steelblue",
                )
            )
            whisker = ot.Curve([position + 1.0] * 2, [lower[i], upper[i]])
            whisker.setColor("black")
            graph.add(whisker)
        labels = ot.Text([[k + 1.0, 0.0] for k in range(len(order))], [names[i] for i in order], "bottom")
        labels.setColor("black")
        labels.setRotation(90)
        graph.add(labels)
        return graph

    def drawSufficientSummary(self, output=0, level=0.95):
        """Output against the first active variables with the regression on them.

        Parameters
        ----------
        output : int
            Which output.
        level : float
            Level of the band of prediction (one active variable).

        Returns
        -------
        :py:class:`openturns.Graph`
            One active variable: points, regression and its band. More: points in the plane of the first two over
            the contours of the regression on these two.
        """
        self._needDirections()
        _check_level(level)
        if not 0 <= output < self._values.shape[1]:
            raise ValueError(f"The output must be 0 to {self._values.shape[1] - 1}, got {output}.")
        active = self._points @ self._active()
        return drawSufficientSummary(active, self._values[:, output], self._weights, f"output {output}", level)

    def compareDirections(self, directions):
        """Distance ||W W^T - V V^T||_2 of the active subspace to another one given by (d, r) columns."""
        other = linalg.qr(np.array(directions, dtype=float), mode="economic")[0]
        return subspace_distance(self._active(), other)


def _add_band(graph, middle, lower, upper, level):
    """Points joined by a line, and the dashed edges of a band, over 1, 2, ..."""
    number = np.arange(1.0, len(middle) + 1.0)
    curve = ot.Curve(number, middle)
    curve.setColor("steelblue")
    curve.setPointStyle("fcircle")
    graph.add(curve)
    for place, bound in enumerate((lower, upper)):
        edge = ot.Curve(number, bound)
        edge.setLineStyle("dashed")
        edge.setColor("black")
        edge.setLegend("" if place else f"{100 * level:g} % band")
        graph.add(edge)
