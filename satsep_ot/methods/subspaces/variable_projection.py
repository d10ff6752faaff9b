"""Polynomial ridge approximation by variable projection: f(u) ~ p(W^T u), W and p fitted together."""

import copy
import dataclasses
import functools
import math

import numpy as np
import openturns as ot
from scipy import linalg

from satsep_ot.methods.common.units import output_units
from satsep_ot.methods.polynomials.basis import PolynomialBasis
from satsep_ot.methods.polynomials.fit import PolynomialFit, fit_polynomial, shuffled_folds
from satsep_ot.methods.subspaces.estimation import orient

# The minimum-norm quadratic of the starting directions costs the cube of the number of points.
STARTING_POINTS = 600
# Gauss-Newton steps given to every start before only the best one is finished.
SCREENING_STEPS = 4
# Points for each unknown that are enough to tell good starts from bad ones.
SCREENING_RATIO = 3
# Points, and points for each unknown, beyond which further ones move the directions by less than their own error: the
# iteration starts with as many, and cross-validation, which compares models, ends with them.
REFINING_POINTS = 2000
REFINING_RATIO = 50
SMALL_BASIS = 100


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
        Weighted residual over weighted total sum of squares, averaged over the outputs.
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

    def predict(self, points: np.ndarray) -> np.ndarray:
        """Values at points (n, d): ndarray (n,) or (n, p)."""
        return self.polynomial.predict(np.asarray(points, dtype=float) @ self.directions)

    def predict_gradient(self, points: np.ndarray) -> np.ndarray:
        """Gradients in u at points (n, d): ndarray (n, d) or (n, d, p)."""
        active = self.polynomial.predict_gradient(np.asarray(points, dtype=float) @ self.directions)
        return np.einsum("ij,nj...->ni...", self.directions, active)


def starting_directions(
    points: np.ndarray, values: np.ndarray, dimension: int, weights: np.ndarray | None = None
) -> list[np.ndarray]:
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


@functools.lru_cache(maxsize=64)
def _basis(dimension, degree):
    """The Hermite basis of a ridge and its derivative matrices: small ones dense, for sparse products take longer."""
    basis = PolynomialBasis(dimension, degree)
    return basis, [matrix.toarray() if basis.size <= SMALL_BASIS else matrix for matrix in basis.derivatives]


class _VariableProjection:
    """Loss, gradient and Gauss-Newton matrix on the Grassmann manifold (Hokanson and Constantine 2018).

    The polynomial is eliminated: for given W its coefficients follow by least squares, with the Jacobian of the
    residual by Golub and Pereyra (1973).
    """

    def __init__(self, points, values, dimension, degree, weights):
        self.basis, self.derivatives = _basis(dimension, degree)
        self.points = points
        self.scale = None if weights is None else np.sqrt(weights)
        self.target = values if weights is None else values * self.scale[:, None]

    def thinned(self, size):
        """The same problem on so many of its points, evenly through the sample; itself if it has no more."""
        if len(self.points) <= size:
            return self
        kept = np.linspace(0, len(self.points) - 1, size).astype(int)
        thinner = copy.copy(self)
        thinner.points, thinner.target = self.points[kept], self.target[kept]
        thinner.scale = None if self.scale is None else self.scale[kept]
        return thinner

    def loss(self, directions):
        """Residual sum of squares, and what the linearisation needs."""
        design = self.basis.evaluate(self.points @ directions)
        weighted = design if self.scale is None else design * self.scale
        rows, triangle = np.linalg.qr(weighted.T)
        projected = rows.T @ self.target
        residual = self.target - rows @ projected
        return float((residual**2).sum()), (design, rows, triangle, projected, residual)

    def linearise(self, directions, state):
        """Basis (d, d - r) of the tangent space, half gradient and Gauss-Newton matrix in it."""
        design, rows, triangle, projected, residual = state
        dimension = directions.shape[1]
        complement = np.linalg.qr(directions, mode="complete")[0][:, dimension:]
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
            slopes = [coefficients[:, output] @ derivative @ design for derivative in self.derivatives]
            first = -np.hstack([moved * slope[:, None] for slope in slopes])
            correlation = design @ (moved * residual[:, output, None])
            second = -linalg.solve_triangular(
                triangle,
                np.hstack([derivative @ correlation for derivative in self.derivatives]),
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
                trial = np.linalg.qr(directions + move)[0]
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
    thorough: bool = True,
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
        Random subspaces (from ``ot.RandomGenerator``) tried beside the subspaces of the quadratic fit.
    initial : ndarray (d, r), optional
        A subspace to start from: then no other start is tried.
    steps : int
        Largest number of Gauss-Newton steps.
    tolerance : float
        Step length (radians) below which the iteration has converged.
    thorough : bool
        Whether all points take part in the search for the directions, where 2000 and 50 for each unknown would do.
        The polynomial is fitted to all in any case.

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
    >>> from satsep_ot.methods.subspaces.variable_projection import fit_ridge
    >>> points = np.array(ot.Normal(3).getSample(60))
    >>> fit = fit_ridge(points, np.exp(0.3 * points @ [0.6, 0.0, 0.8]), dimension=1)
    >>> bool(abs(fit.directions[:, 0] - [0.6, 0.0, 0.8]).max() < 1e-2)
    True
    """
    points = np.ascontiguousarray(points, dtype=float)
    values = np.asarray(values, dtype=float)
    if points.ndim != 2:
        raise ValueError(f"The points have shape {points.shape}; it must be (n, d).")
    n, d = points.shape
    if values.ndim not in (1, 2) or len(values) != n:
        raise ValueError(f"The values have shape {values.shape}; it must be ({n},) or ({n}, p).")
    if not 0 <= dimension <= d:
        raise ValueError(f"The dimension of a ridge in {d} inputs is {dimension}; it must be 0 to {d}.")
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
    columns = _columns(values)
    centred = columns - np.average(columns, axis=0, weights=weights)
    variance = np.average(centred**2, axis=0, weights=weights)
    magnitude = np.abs(columns).max(axis=0)
    varying = variance > (1e-14 * magnitude) ** 2
    if dimension == 0 or not varying.any():
        # A constant has no direction of its own: any will do, and the loss is the loss of the mean.
        directions = np.eye(d, dimension)
        return _finish(directions, points, values, degree, weights, varying, True, 0)
    scaled = centred[:, varying] / np.sqrt(variance[varying])
    problem = _VariableProjection(points, scaled, dimension, degree, weights)
    if initial is not None:
        initial = np.asarray(initial, dtype=float)
        if initial.shape != (d, dimension):
            raise ValueError(f"The initial directions have shape {initial.shape}; it must be ({d}, {dimension}).")
        directions, _, converged, iterations = problem.minimise(
            linalg.qr(initial, mode="economic")[0], steps, tolerance
        )
        return _finish(directions, points, values, degree, weights, varying, converged, iterations)
    candidates = starting_directions(points, scaled, dimension, weights)
    for _ in range(starts):
        normal = np.array(ot.DistFunc.rNormal(d * dimension)).reshape(d, dimension)
        candidates.append(linalg.qr(normal, mode="economic")[0])
    unknowns = d * dimension + terms
    rough = problem.thinned(max(STARTING_POINTS, SCREENING_RATIO * unknowns))
    screened = [rough.minimise(candidate, SCREENING_STEPS, tolerance) for candidate in candidates]
    best, _, _, iterations = min(screened, key=lambda trial: trial[1])
    fewer = problem.thinned(max(REFINING_POINTS, REFINING_RATIO * unknowns))
    for some in [fewer, problem] if thorough and fewer is not problem else [fewer]:
        best, _, converged, more = some.minimise(best, steps, tolerance)
        iterations += more
    return _finish(best, points, values, degree, weights, varying, converged, iterations)


def _finish(directions, points, values, degree, weights, varying, converged, iterations):
    """The fit on the final subspace, its axes ordered by how much the polynomial varies along them."""
    dimension = directions.shape[1]
    basis, _ = _basis(dimension, degree)
    polynomial = fit_polynomial(basis, points @ directions, values, weights, allow_deficient=True)
    weight = np.ones(len(points)) if weights is None else weights
    if dimension:
        slopes = polynomial.predict_gradient(points @ directions).reshape(len(points), dimension, -1)
        slopes /= output_units(values.reshape(len(points), -1))
        covariance = np.einsum("nip,njp,n->ij", slopes, slopes, weight)
        directions = orient(directions @ linalg.eigh(covariance)[1][:, ::-1])
        polynomial = fit_polynomial(basis, points @ directions, values, weights, allow_deficient=True)
    residuals = _columns(polynomial.residuals, output_units(values.reshape(len(points), -1)))
    residual = (residuals**2 * weight[:, None]).sum(axis=0)
    columns = _columns(values)
    spread = ((columns - np.average(columns, axis=0, weights=weights)) ** 2 * weight[:, None]).sum(axis=0)
    loss = float(np.mean(residual[varying] / spread[varying])) if varying.any() else 0.0
    return RidgeFit(directions, polynomial, loss, converged, iterations)


def _columns(values, units=None):
    """Values (n,) or (n, p) as columns (n, p) in units of their own, or those given, in which they can be squared."""
    columns = values.reshape(len(values), -1)
    return columns / (output_units(columns) if units is None else units)


def cross_validate_ridge(
    points: np.ndarray,
    values: np.ndarray,
    dimension: int,
    degree: int = 4,
    weights: np.ndarray | None = None,
    folds: int | list[np.ndarray] = 5,
    starts: int = 2,
) -> np.ndarray:
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
    >>> from satsep_ot.methods.subspaces.variable_projection import cross_validate_ridge
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
        fit = fit_ridge(points[kept], values[kept], dimension, degree, fold_weights, starts, thorough=False)
        errors[block] = values[block] - fit.predict(points[block])
    return errors
