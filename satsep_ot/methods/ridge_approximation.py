"""Polynomial ridge approximation without gradients: f(u) ~ p(W^T u), W and p fitted together."""

import dataclasses
import math

import numpy as np
import openturns as ot
from scipy import linalg

from satsep_ot.methods.active_variables import (
    activeTransformation,
    drawSufficientSummary,
    inverseActiveTransformation,
)
from satsep_ot.methods.polynomial_basis import PolynomialBasis, PolynomialFit, fit_polynomial
from satsep_ot.methods.polynomial_regression import MultivariatePolynomialRegression, shuffled_folds
from satsep_ot.methods.standard_space import StandardSpace

# The minimum-norm quadratic of the starting directions costs the cube of the number of points.
STARTING_POINTS = 600
# Gauss-Newton steps given to every start before only the best one is finished.
SCREENING_STEPS = 4
# Points for each unknown that are enough to tell good starts from bad ones.
SCREENING_RATIO = 3


@dataclasses.dataclass
class RidgeFit:
    """A fitted ridge function; made by :func:`fit_ridge`.

    Attributes
    ----------
    directions : ndarray (d, r)
        Orthonormal columns W.
    polynomial : PolynomialFit
        Fit on the active variables W^T u.
    loss : float
        Weighted residual sum of squares over that of the weighted mean, averaged over the outputs.
    converged : bool
        Whether the last step fell below the tolerance.
    iterations : int
        Gauss-Newton steps of the best start.
    """

    directions: np.ndarray
    polynomial: PolynomialFit
    loss: float
    converged: bool
    iterations: int

    def predict(self, points):
        """Values at points (n, d): ndarray (n,) or (n, p)."""
        return self.polynomial.predict(np.asarray(points, dtype=float) @ self.directions)

    def predict_gradient(self, points):
        """Gradients in u at points (n, d): ndarray (n, d) or (n, d, p)."""
        active = self.polynomial.predict_gradient(np.asarray(points, dtype=float) @ self.directions)
        return np.einsum("ij,nj...->ni...", self.directions, active)


def orient(directions: np.ndarray) -> np.ndarray:
    """Columns with their largest component positive.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.ridge_approximation import orient
    >>> orient(np.array([[0.6], [-0.8]])).tolist()
    [[-0.6], [0.8]]
    """
    largest = np.take_along_axis(directions, np.abs(directions).argmax(axis=0)[None, :], axis=0)
    return directions * np.where(largest < 0.0, -1.0, 1.0)


def subspace_distance(first: np.ndarray, second: np.ndarray) -> float:
    """Spectral norm of the difference of two orthogonal projectors, in [0, 1].

    It is the sine of the largest angle between the subspaces (1 when their dimensions differ).

    Parameters
    ----------
    first, second : ndarray (d, r)
        Orthonormal columns.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.ridge_approximation import subspace_distance
    >>> round(subspace_distance(np.array([[1.0], [0.0]]), np.array([[0.8], [0.6]])), 12)
    0.6
    """
    if first.shape != second.shape:
        return 1.0
    if first.shape[1] == 0:
        return 0.0
    # The sine from the residual of the projection is exact for small angles; from the cosine it is not.
    return float(min(linalg.norm(second - first @ (first.T @ second), 2), 1.0))


def starting_directions(points, values, dimension, weights=None):
    """Candidate subspaces from the quadratic of minimum norm through (at most 600 of) the data.

    The quadratic m + b.u + u^T A u / 2 has the gradient covariance b b^T + A A for standard normal u.

    Returns
    -------
    list of ndarray (d, dimension), best guess first
    """
    scale = np.ones(len(points)) if weights is None else np.sqrt(weights)
    kept = np.arange(len(points))
    if len(kept) > STARTING_POINTS:
        # Evenly through the sample rather than its head, which may be one block of a sequential design.
        kept = np.linspace(0, len(points) - 1, STARTING_POINTS).astype(int)
    u, y, s = points[kept], values[kept], scale[kept]
    d = points.shape[1]
    y = (y - np.average(y, axis=0, weights=s**2 if s.any() else None)) * s[:, None]
    inner = u @ u.T
    # The kernel of the features (1, u, u u^T / sqrt(2 d)): its cost does not grow with their number d^2.
    kernel = (1.0 + inner + 0.5 * inner**2 / d) * s[:, None] * s
    kernel[np.diag_indices_from(kernel)] += 1e-3 * np.trace(kernel) / len(kernel)
    dual = linalg.solve(kernel, y, assume_a="pos") * s[:, None]
    linear = np.zeros((d, d))
    curved = np.zeros((d, d))
    for output in range(y.shape[1]):
        slope = u.T @ dual[:, output]
        hessian = (u.T * dual[:, output]) @ u / d
        linear += np.outer(slope, slope)
        curved += hessian @ hessian
    _, vectors = linalg.eigh(linear + curved)
    candidates = [vectors[:, ::-1][:, :dimension]]
    # The slopes come first, curvature fills what they leave; then curvature alone.
    _, slopes = linalg.eigh(linear)
    count = min(dimension, y.shape[1], d)
    slopes = slopes[:, ::-1][:, :count]
    projector = np.eye(d) - slopes @ slopes.T
    _, bends = linalg.eigh(projector @ curved @ projector)
    candidates.append(np.hstack([slopes, bends[:, ::-1][:, : dimension - count]]))
    _, bends = linalg.eigh(curved)
    candidates.append(bends[:, ::-1][:, :dimension])
    return [linalg.qr(candidate, mode="economic")[0] for candidate in candidates]


class _VariableProjection:
    """Loss, gradient and Gauss-Newton matrix on the Grassmann manifold (Hokanson and Constantine 2018).

    The polynomial is eliminated: for given W its coefficients are those of least squares, and the
    Jacobian of the residual is that of Golub and Pereyra (1973).
    """

    def __init__(self, points, values, dimension, degree, weights):
        self.basis = PolynomialBasis(dimension, degree)
        self.points = points
        self.values = values
        self.scale = None if weights is None else np.sqrt(weights)
        self.target = values if weights is None else values * self.scale[:, None]

    def loss(self, directions):
        """Residual sum of squares, and what the linearisation needs."""
        design = self.basis.evaluate(self.points @ directions)
        weighted = design if self.scale is None else design * self.scale
        rows, triangle, *_ = linalg.qr(weighted.T, mode="economic", check_finite=False)
        projected = rows.T @ self.target
        residual = self.target - rows @ projected
        return float((residual**2).sum()), (design, rows, triangle, projected, residual)

    def linearise(self, directions, state):
        """Basis (d, d - r) of the tangent space, half gradient and Gauss-Newton matrix in it."""
        design, rows, triangle, projected, residual = state
        dimension = directions.shape[1]
        complement = linalg.qr(directions)[0][:, dimension:]
        moved = self.points @ complement
        if self.scale is not None:
            moved = moved * self.scale[:, None]
        # A nearly singular triangle occurs on the way only; a tiny shift keeps the solve finite.
        diagonal = np.abs(np.diag(triangle))
        triangle = triangle + np.diag((diagonal < 1e-12 * diagonal.max()) * 1e-12 * diagonal.max())
        coefficients = linalg.solve_triangular(triangle, projected, check_finite=False)
        size = complement.shape[1] * dimension
        gradient = np.zeros(size)
        matrix = np.zeros((size, size))
        for output in range(self.target.shape[1]):
            slopes = [self.basis.derivative_coefficients(coefficients[:, output], j) @ design for j in range(dimension)]
            first = -np.hstack([moved * slope[:, None] for slope in slopes])
            correlation = design @ (moved * residual[:, output, None])
            second = -linalg.solve_triangular(
                triangle,
                np.hstack([self.basis.derivatives[j] @ correlation for j in range(dimension)]),
                trans="T",
                check_finite=False,
            )
            overlap = rows.T @ first
            gradient += first.T @ residual[:, output]
            matrix += first.T @ first - overlap.T @ overlap + second.T @ second
        return complement, gradient, matrix

    def minimise(self, directions, steps, tolerance):
        """Levenberg-Marquardt from ``directions``: directions, loss, converged, iterations."""
        loss, state = self.loss(directions)
        total = float((self.target**2).sum())
        damping = 1e-4
        converged = directions.shape[0] == directions.shape[1]
        iteration = 0
        while not converged and iteration < steps:
            iteration += 1
            complement, gradient, matrix = self.linearise(directions, state)
            spread = np.trace(matrix) / len(matrix)
            if not spread > 0.0:
                converged = True
                break
            accepted = False
            length = promised = np.inf
            for _ in range(12):
                damped = matrix + damping * spread * np.eye(len(matrix))
                try:
                    step = -linalg.cho_solve(linalg.cho_factor(damped, check_finite=False), gradient)
                except linalg.LinAlgError:
                    # Fewer points than unknowns: definite only with more damping.
                    damping = max(8.0 * damping, 1e-10)
                    continue
                move = complement @ step.reshape(directions.shape[1], -1).T
                trial = linalg.qr(directions + move, mode="economic")[0]
                trial_loss, trial_state = self.loss(trial)
                length = linalg.norm(step)
                promised = -step @ gradient
                if trial_loss <= loss:
                    accepted = True
                    break
                if length < tolerance:
                    break
                damping *= 8.0
            if not accepted:
                # No descent: converged where what the model promised is below the rounding of the loss.
                converged = length < tolerance or promised <= 1e-10 * loss
                break
            drop = loss - trial_loss
            directions, loss, state = trial, trial_loss, trial_state
            damping = max(damping / 8.0, 1e-12)
            converged = length < tolerance or drop <= 1e-12 * loss or loss <= 1e-28 * total
        return directions, loss, converged, iteration


def fit_ridge(
    points: np.ndarray,
    values: np.ndarray,
    dimension: int,
    degree: int = 4,
    weights: np.ndarray | None = None,
    starts: int = 2,
    initial: np.ndarray | None = None,
    steps: int = 60,
    tolerance: float = 1e-9,
) -> RidgeFit:
    """Polynomial ridge approximation by variable projection (Hokanson and Constantine 2018).

    Parameters
    ----------
    points : ndarray (n, d)
        Points in a space where the inputs are comparable, best the standard normal one.
    values : ndarray (n,) or (n, p)
        Several outputs share the directions; each is scaled by its standard deviation in the loss.
    dimension : int
        r, number of directions, 0 (a constant) to d.
    degree : int
        Total degree of the polynomial.
    weights : ndarray (n,), optional
        Not negative.
    starts : int
        Random subspaces (from ``ot.RandomGenerator``) tried beside those of the quadratic fit.
    initial : ndarray (d, r), optional
        A subspace to start from: then no other start is tried.
    steps : int
        Largest number of Gauss-Newton steps.
    tolerance : float
        Step length (radians) below which the iteration has converged.

    Returns
    -------
    RidgeFit

    Raises
    ------
    ValueError
        Shapes, non-finite data, or fewer points (of positive weight) than polynomial terms.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.ridge_approximation import fit_ridge
    >>> points = np.array(ot.Normal(3).getSample(60))
    >>> fit = fit_ridge(points, np.exp(0.3 * points @ [0.6, 0.0, 0.8]), dimension=1)
    >>> bool(abs(fit.directions[:, 0] - [0.6, 0.0, 0.8]).max() < 1e-2)
    True
    """
    points = np.ascontiguousarray(points, dtype=float)
    values = np.asarray(values, dtype=float)
    if points.ndim != 2:
        raise ValueError(f"The points must have shape (n, d), got {points.shape}.")
    n, d = points.shape
    if values.ndim not in (1, 2) or len(values) != n:
        raise ValueError(f"The values must have shape ({n},) or ({n}, p), got {values.shape}.")
    if not 0 <= dimension <= d:
        raise ValueError(f"The dimension of a ridge in {d} inputs must be 0 to {d}, got {dimension}.")
    if not (np.isfinite(points).all() and np.isfinite(values).all()):
        raise ValueError("A ridge approximation needs finite points and values.")
    if weights is not None:
        weights = np.asarray(weights, dtype=float)
        if weights.shape != (n,) or not (np.isfinite(weights).all() and (weights >= 0.0).all()):
            raise ValueError(f"The weights must be {n} finite numbers >= 0.")
    used = n if weights is None else int((weights > 0.0).sum())
    terms = math.comb(dimension + degree, degree)
    if used < terms:
        raise ValueError(f"A ridge of {terms} polynomial terms needs at least {terms} points, got {used}.")
    columns = values.reshape(n, -1)
    centred = columns - np.average(columns, axis=0, weights=weights)
    variance = np.average(centred**2, axis=0, weights=weights)
    magnitude = np.abs(columns).max(axis=0)
    varying = variance > (1e-14 * magnitude) ** 2
    if dimension == 0 or not varying.any():
        # A constant has no direction of its own: any will do and the loss is that of the mean.
        directions = np.eye(d, dimension)
        return _finish(directions, points, values, degree, weights, varying, True, 0)
    scaled = centred[:, varying] / np.sqrt(variance[varying])
    problem = _VariableProjection(points, scaled, dimension, degree, weights)
    if initial is not None:
        initial = np.asarray(initial, dtype=float)
        if initial.shape != (d, dimension):
            raise ValueError(f"The initial directions must have shape ({d}, {dimension}), got {initial.shape}.")
        directions, _, converged, iterations = problem.minimise(
            linalg.qr(initial, mode="economic")[0], steps, tolerance
        )
        return _finish(directions, points, values, degree, weights, varying, converged, iterations)
    candidates = starting_directions(points, scaled, dimension, weights)
    for _ in range(starts):
        normal = np.array(ot.DistFunc.rNormal(d * dimension)).reshape(d, dimension)
        candidates.append(linalg.qr(normal, mode="economic")[0])
    enough = max(STARTING_POINTS, SCREENING_RATIO * (d * dimension + terms))
    kept = np.linspace(0, n - 1, enough).astype(int) if n > enough else slice(None)
    rough = _VariableProjection(
        points[kept], scaled[kept], dimension, degree, None if weights is None else weights[kept]
    )
    screened = [rough.minimise(candidate, SCREENING_STEPS, tolerance) for candidate in candidates]
    best, _, _, iterations = min(screened, key=lambda trial: trial[1])
    best, _, converged, more = problem.minimise(best, steps, tolerance)
    iterations += more
    return _finish(best, points, values, degree, weights, varying, converged, iterations)


def _finish(directions, points, values, degree, weights, varying, converged, iterations):
    """The fit on the final subspace, its axes ordered by how much the polynomial varies along them."""
    dimension = directions.shape[1]
    basis = PolynomialBasis(dimension, degree)
    polynomial = fit_polynomial(basis, points @ directions, values, weights, allow_deficient=True)
    weight = np.ones(len(points)) if weights is None else weights
    if dimension:
        slopes = polynomial.predict_gradient(points @ directions).reshape(len(points), dimension, -1)
        covariance = np.einsum("nip,njp,n->ij", slopes, slopes, weight)
        directions = orient(directions @ linalg.eigh(covariance)[1][:, ::-1])
        polynomial = fit_polynomial(basis, points @ directions, values, weights, allow_deficient=True)
    residual = (polynomial.residuals.reshape(len(points), -1) ** 2 * weight[:, None]).sum(axis=0)
    columns = values.reshape(len(points), -1)
    spread = ((columns - np.average(columns, axis=0, weights=weights)) ** 2 * weight[:, None]).sum(axis=0)
    loss = float(np.mean(residual[varying] / spread[varying])) if varying.any() else 0.0
    return RidgeFit(directions, polynomial, loss, converged, iterations)


def cross_validate_ridge(points, values, dimension, degree=4, weights=None, folds=5, starts=2):
    """Prediction errors of ridge fits that have not seen the point: the directions are refitted in every fold.

    With directions frozen from all the data the errors look far smaller than they are.

    Parameters
    ----------
    points, values, dimension, degree, weights, starts
        As in :func:`fit_ridge`.
    folds : int or list of int ndarrays
        Number of random blocks, or the blocks.

    Returns
    -------
    ndarray, same shape as ``values``
        Observed minus predicted.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.ridge_approximation import cross_validate_ridge
    >>> points = np.array(ot.Normal(2).getSample(40))
    >>> errors = cross_validate_ridge(points, (points @ [0.6, 0.8]) ** 2, dimension=1, degree=2)
    >>> bool(np.abs(errors).max() < 1e-8)
    True
    """
    points = np.asarray(points, dtype=float)
    values = np.asarray(values, dtype=float)
    errors = np.empty_like(values)
    blocks = shuffled_folds(len(points), folds) if isinstance(folds, int) else folds
    for block in blocks:
        kept = np.ones(len(points), dtype=bool)
        kept[block] = False
        fold_weights = None if weights is None else np.asarray(weights)[kept]
        fit = fit_ridge(points[kept], values[kept], dimension, degree, fold_weights, starts)
        errors[block] = values[block] - fit.predict(points[block])
    return errors


class RidgeApproximation:
    """Active subspace and polynomial surrogate without gradients, f(x) ~ p(W^T T(x)).

    Parameters
    ----------
    inputSample : :py:class:`openturns.Sample` or array (N, d)
        Physical inputs.
    outputSample : :py:class:`openturns.Sample` or array (N, p)
        Outputs; several share the directions.
    distribution : :py:class:`openturns.Distribution`
        Of the inputs; T is its iso-probabilistic transformation.

    Notes
    -----
    Variable projection of Hokanson and Constantine, SIAM J. Sci. Comput. 40 (2018). Dimension and degree are chosen
    by nested cross-validation unless they are set: the simplest pair (fewest unknowns) whose mean squared prediction
    error is within one standard error of the best. At least 3 (d r + P) points are recommended; with fewer the
    result's remarks say so.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.ridge_approximation import RidgeApproximation
    >>> ot.RandomGenerator.SetSeed(0)
    >>> distribution = ot.Normal(4)
    >>> function = ot.SymbolicFunction(["a", "b", "c", "e"], ["(a + b + c + e)^2"])
    >>> inputs = distribution.getSample(100)
    >>> algorithm = RidgeApproximation(inputs, function(inputs), distribution)
    >>> algorithm.run()
    >>> result = algorithm.getResult()
    >>> print(result.getDimension(), result.getDegree(), round(result.getDirections()[0, 0], 6))
    1 2 0.5
    """

    def __init__(self, inputSample, outputSample, distribution):
        self._space = StandardSpace(distribution)
        physical = np.array(inputSample, dtype=float)
        self._values = np.array(outputSample, dtype=float)
        d = self._space.getDimension()
        if physical.ndim != 2 or self._values.ndim != 2 or len(physical) != len(self._values) or physical.shape[1] != d:
            raise ValueError(
                f"The samples must have shapes (N, {d}) and (N, p), got {physical.shape} and {self._values.shape}."
            )
        finite = np.isfinite(physical).all(axis=1) & np.isfinite(self._values).all(axis=1)
        if not finite.all():
            raise ValueError(
                f"A fit needs finite data, but {int((~finite).sum())} of {len(finite)} rows are not, "
                f"the first is row {int((~finite).argmax())}."
            )
        # Outside its support T would return some large number instead of refusing.
        inside = np.array(self._space.getDistribution().computeLogPDF(physical))[:, 0] > -1e300
        if not inside.all():
            row = int((~inside).argmax())
            raise ValueError(
                f"Row {row} of the inputs is outside the range of the distribution: {physical[row].tolist()}."
            )
        self._physical = physical
        self._points = self._space.toStandard(physical)
        self._dimension = None
        self._degree = None
        self._largestDimension = min(3, d)
        self._largestDegree = 4
        self._weights = None
        self._starts = 2
        self._folds = 5
        self._result = None

    def __repr__(self):
        return (
            f"RidgeApproximation(size={len(self._points)}, inputs={self._points.shape[1]}, "
            f"dimension={self._dimension}, degree={self._degree})"
        )

    def setDimension(self, dimension):
        """Number of directions, 0 to d, or None (default) to choose it up to the largest."""
        if dimension is not None and not 0 <= dimension <= self._points.shape[1]:
            raise ValueError(f"The dimension must be 0 to {self._points.shape[1]}, got {dimension}.")
        self._dimension = dimension

    def setLargestDimension(self, dimension):
        """Largest dimension of the automatic choice (default 3)."""
        if not 0 <= dimension <= self._points.shape[1]:
            raise ValueError(f"The largest dimension must be 0 to {self._points.shape[1]}, got {dimension}.")
        self._largestDimension = dimension

    def setDegree(self, degree):
        """Total degree, 1 to 10, or None (default) to choose it up to 4."""
        if degree is not None and not 1 <= degree <= 10:
            raise ValueError(f"The degree must be 1 to 10, got {degree}.")
        self._degree = degree

    def setWeights(self, weights):
        """Weights (N,), positive; None for equal ones."""
        if weights is not None:
            weights = np.array(weights, dtype=float).reshape(-1)
            if weights.shape != (len(self._points),) or not (np.isfinite(weights).all() and (weights > 0.0).all()):
                raise ValueError(f"The weights must be {len(self._points)} finite positive numbers.")
        self._weights = weights

    def setStartsNumber(self, starts):
        """Random starts beside those of the quadratic fit (default 2)."""
        if starts < 0:
            raise ValueError(f"The number of random starts must be at least 0, got {starts}.")
        self._starts = starts

    def setFoldsNumber(self, folds):
        """Folds of the cross-validation (default 5)."""
        if not 2 <= folds <= len(self._points):
            raise ValueError(f"The number of folds must be 2 to {len(self._points)}, got {folds}.")
        self._folds = folds

    def run(self):
        """Choose dimension and degree by cross-validation where they are open, and fit."""
        n, d = self._points.shape
        blocks = shuffled_folds(n, self._folds)
        smallest = n - max(len(block) for block in blocks)
        dimensions = range(self._largestDimension + 1) if self._dimension is None else [self._dimension]
        degrees = range(1, self._largestDegree + 1) if self._degree is None else [self._degree]
        pairs = [(r, k) for r in dimensions for k in degrees if (r > 0 or k == degrees[0]) and not 1 == k < r]
        # Twice as many points as terms, or the fit of a fold is noise.
        pairs = [(r, k) for r, k in pairs if 2 * math.comb(r + k, k) <= smallest] or pairs[:1]
        weight = np.ones(n) if self._weights is None else self._weights
        mean = np.average(self._values, axis=0, weights=self._weights)
        spread = np.average((self._values - mean) ** 2, axis=0, weights=self._weights)
        scale = np.where(spread > 0.0, spread, 1.0)
        scores = {}
        for r, k in pairs:
            errors = cross_validate_ridge(self._points, self._values, r, k, self._weights, blocks, self._starts)
            squared = (errors**2 / scale).mean(axis=1)
            scores[r, k] = np.array([np.average(squared[block], weights=weight[block]) for block in blocks])
        best = min(scores, key=lambda pair: scores[pair].mean())
        allowed = scores[best].mean() + scores[best].std(ddof=1) / math.sqrt(len(blocks))
        # Errors at rounding level are equal.
        good = [pair for pair in scores if scores[pair].mean() <= max(allowed, 1e-16)]
        r, k = min(good, key=lambda pair: d * pair[0] + math.comb(pair[0] + pair[1], pair[1]))
        fit = fit_ridge(self._points, self._values, r, k, self._weights, self._starts)
        q2 = {pair: 1.0 - float(score.mean()) for pair, score in scores.items()}
        self._result = RidgeApproximationResult(
            self._space, self._physical, self._points, self._values, self._weights, fit, k, q2
        )

    def getResult(self):
        """The :class:`RidgeApproximationResult` of the last run."""
        if self._result is None:
            raise RuntimeError("There is no result yet: call run() first.")
        return self._result


class RidgeApproximationResult:
    """Result of :class:`RidgeApproximation`.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.ridge_approximation import RidgeApproximation
    >>> ot.RandomGenerator.SetSeed(0)
    >>> inputs = ot.Normal(3).getSample(80)
    >>> outputs = ot.SymbolicFunction(["a", "b", "c"], ["exp(0.1 * (a + 2 * b + 2 * c))"])(inputs)
    >>> algorithm = RidgeApproximation(inputs, outputs, ot.Normal(3))
    >>> algorithm.setDimension(1)
    >>> algorithm.run()
    >>> metaModel = algorithm.getResult().getMetaModel()
    >>> bool(abs(metaModel([1.0, 1.0, 1.0])[0] - np.exp(0.5)) < 1e-3)
    True
    """

    def __init__(self, space, physical, points, values, weights, fit, degree, q2):
        self._space = space
        self._physical = physical
        self._points = points
        self._values = values
        self._weights = weights
        self._fit = fit
        self._degree = degree
        self._q2 = q2
        self._regression = None

    def __repr__(self):
        return (
            f"RidgeApproximationResult(inputs={self._points.shape[1]}, dimension={self.getDimension()}, "
            f"degree={self._degree})"
        )

    def getDimension(self):
        """Number of directions."""
        return self._fit.directions.shape[1]

    def getDegree(self):
        """Total degree of the polynomial."""
        return self._degree

    def getDirections(self):
        """Orthonormal columns W, (d, r) :py:class:`openturns.Matrix`, the largest component of each positive."""
        return ot.Matrix(self._fit.directions)

    def getStandardSpace(self):
        """The :class:`~satsep_ot.methods.standard_space.StandardSpace` that was used."""
        return self._space

    def isConverged(self):
        """Whether the Gauss-Newton iteration converged."""
        return self._fit.converged

    def getIterationNumber(self):
        """Gauss-Newton steps of the best start."""
        return self._fit.iterations

    def getRelativeError(self):
        """Weighted residual over total sum of squares, averaged over the outputs, on the training sample."""
        return self._fit.loss

    def getQ2(self):
        """Nested cross-validated Q2 of what was chosen: the directions were refitted in every fold."""
        return self._q2[self.getDimension(), self._degree]

    def getQ2ByDimensionAndDegree(self):
        """Nested cross-validated Q2 of everything that was tried, a dict by (dimension, degree)."""
        return dict(self._q2)

    def getRemarks(self):
        """Sentences on what a reader should know: few points for the unknowns, an iteration that did not converge."""
        d, r = self._fit.directions.shape
        unknowns = d * r + self._fit.polynomial.basis.size
        remarks = []
        if len(self._points) < 3 * unknowns:
            remarks.append(
                f"{len(self._points)} points for {unknowns} unknowns: {3 * unknowns} are recommended (3 for each)."
            )
        if not self._fit.converged:
            remarks.append(f"The directions had not converged after {self._fit.iterations} Gauss-Newton steps.")
        return remarks

    def _needDirections(self):
        if self.getDimension() == 0:
            raise ValueError(
                "There is no active variable: a constant predicts as well as any ridge; set the dimension."
            )

    def getTransformation(self):
        """Physical inputs to active variables, y = W^T T(x), a native :py:class:`openturns.Function`."""
        self._needDirections()
        return activeTransformation(self._space, self._fit.directions)

    def getInverseTransformation(self):
        """Active variables to the physical inputs with inactive variables 0, x = T^-1(W y), a native function."""
        self._needDirections()
        return inverseActiveTransformation(self._space, self._fit.directions)

    def getActiveSample(self):
        """Active variables of the sample, :py:class:`openturns.Sample` (N, r)."""
        self._needDirections()
        return ot.Sample(self._points @ self._fit.directions)

    def getRegressionResult(self):
        """Regression on the active variables,
        a :class:`~satsep_ot.methods.polynomial_regression.MultivariatePolynomialRegressionResult`.

        Its intervals and cross-validation take the directions as known: :meth:`getQ2` does not.
        """
        self._needDirections()
        if self._regression is None:
            regression = MultivariatePolynomialRegression(
                self.getActiveSample(), self._values, ot.Normal(self.getDimension())
            )
            regression.setDegree(self._degree)
            regression.setWeights(self._weights)
            regression.run()
            self._regression = regression.getResult()
        return self._regression

    def getMetaModel(self):
        """The surrogate of the physical inputs, a native :py:class:`openturns.Function` with exact derivatives."""
        if self.getDimension() == 0:
            d, p = self._points.shape[1], self._values.shape[1]
            return ot.LinearFunction([0.0] * d, self._fit.polynomial.coefficients[0], ot.Matrix(p, d))
        return ot.ComposedFunction(self.getRegressionResult().getMetaModel(), self.getTransformation())

    def getMetaModelResult(self):
        """An :py:class:`openturns.MetaModelResult` of the physical sample and the surrogate."""
        return ot.MetaModelResult(ot.Sample(self._physical), ot.Sample(self._values), self.getMetaModel())

    def drawSufficientSummary(self, output=0, level=0.95):
        """One output against the first one or two active variables, :py:class:`openturns.Graph`."""
        self._needDirections()
        if not 0 <= output < self._values.shape[1]:
            raise ValueError(f"The output must be 0 to {self._values.shape[1] - 1}, got {output}.")
        active = self._points @ self._fit.directions
        return drawSufficientSummary(active, self._values[:, output], self._weights, f"output {output}", level)
