"""Weighted least squares on a polynomial basis, with what is needed to judge the fit.

The design is term-major as the basis is: the transpose of an array (terms, points) is the column-major matrix that
LAPACK factorises in place.
"""

import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import openturns as ot
from scipy import linalg

from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.common.units import output_units
from satsep_ot.methods.polynomials.basis import BLOCK_NUMBERS, PolynomialBasis
from satsep_ot.methods.polynomials.prediction import PolynomialPrediction, predict_gradient
from satsep_ot.moved_modules import restoring

# Points of a block of the factorisation for each of its columns: more only need memory, fewer cost time.
ROWS_PER_COLUMN = 64
# What is left of 1 - leverage when the fit depends on the point alone.
LOST_SLACK = 1e-12
# Widest panel of the factorisation.
PANEL_COLUMNS = 32

# The normal equations lose the square of the condition number: they are tried with this many points for each term, and
# taken when the estimate of it (1-norm) is below this multiple of the square root of the number of terms. It is then
# below about 30 in the 2-norm, and the relative error of the coefficients below 1e-12.
POINTS_PER_TERM = 4
NORMAL_CONDITION = 30.0
# Threads help from this number of terms on. Below they cost up to a hundred times the work on a machine that others use
# as well, and for so few products the libraries start none.
THREADED_SIZE = 300
UNTHREADED_WORK = 1 << 17
# From this size on a symmetric product is faster than a general one.
SYMMETRIC_PRODUCT_SIZE = 16

# The recursive Householder QR of LAPACK 3.4 (Elmroth and Gustavson, 2000), up to twice as fast as dgeqrf.
_GEQRT, _POSV, _TRCON, _TRTRS = linalg.get_lapack_funcs(("geqrt", "posv", "trcon", "trtrs"), (np.empty((1, 1)),))


# Arguments of the two constructors, in their order, that are kept in a file.
_BASIS_FIELDS = ("dimension", "degree", "norm", "recurrence")
_FIT_FIELDS = ("weights", "coefficients", "factor", "rank", "condition", "residual_share")


@dataclasses.dataclass(eq=False)
class PolynomialFit:
    """A polynomial fitted by weighted least squares; made by :func:`fit_polynomial`.

    Attributes
    ----------
    basis : PolynomialBasis
    points : ndarray (n, dimension)
        Training points.
    values : ndarray (n,) or (n, p)
        What was fitted there.
    weights : ndarray (n,) or None
    coefficients : ndarray (size,) or (size, p)
    factor : ndarray
        At full rank the upper triangle R of the weighted design (below its diagonal there is something else);
        otherwise the matrix (size, rank) that turns a basis vector psi into the row psi^T factor of Q.
    rank : int
        Numerical rank of the weighted design; less than ``basis.size`` means the minimum-norm solution.
    condition : float
        Condition number of the weighted design (an estimate in the 1-norm unless the rank is deficient).
    residual_share : float
        Share of the noise variance that the weighted residuals keep: less than 1 if the weights follow from the
        residuals, as in a robust fit; 1 for weights that are given.
    """

    basis: PolynomialBasis
    points: np.ndarray
    values: np.ndarray
    weights: np.ndarray | None
    coefficients: np.ndarray
    factor: np.ndarray
    rank: int
    condition: float
    residual_share: float = 1.0

    __setstate__ = restoring(_points="points", _values="values", _prediction=None)

    def fields(self) -> dict[str, Any]:
        """Numbers and arrays that make it again with :meth:`of`, but for the training points."""
        fields = {name: getattr(self.basis, name) for name in _BASIS_FIELDS}
        return fields | {name: getattr(self, name) for name in _FIT_FIELDS}

    @staticmethod
    def of(fields: dict[str, Any], points: np.ndarray, values: np.ndarray) -> "PolynomialFit":
        """The fit of :meth:`fields`, which may hold other names as well, to its training points and values.

        Examples
        --------
        >>> import numpy as np
        >>> from satsep_ot.methods.polynomials.basis import PolynomialBasis
        >>> from satsep_ot.methods.polynomials.fit import PolynomialFit, fit_polynomial
        >>> points = np.linspace(-2.0, 2.0, 9)[:, None]
        >>> fit = fit_polynomial(PolynomialBasis(1, 2), points, np.exp(points[:, 0]))
        >>> again = PolynomialFit.of(fit.fields(), points, np.exp(points[:, 0]))
        >>> bool(np.all(again.leave_one_out() == fit.leave_one_out()))
        True
        """
        basis = PolynomialBasis(*(fields[name] for name in _BASIS_FIELDS))
        return PolynomialFit(basis, points, values, *(fields[name] for name in _FIT_FIELDS))

    @functools.cached_property
    def residuals(self) -> np.ndarray:
        """Values minus predictions at the training points, not weighted."""
        return self.values - self.predict(self.points)

    @functools.cached_property
    def _prediction(self):
        return PolynomialPrediction(self.basis, self.coefficients.reshape(self.basis.size, -1))

    def predict(self, points: np.ndarray) -> np.ndarray:
        """Values at points (n, dimension): ndarray (n,) or (n, p)."""
        values = self._prediction.evaluate(points)
        return values[0] if self.coefficients.ndim == 1 else np.ascontiguousarray(values.T)

    def predict_gradient(self, points: np.ndarray) -> np.ndarray:
        """Gradients at points: ndarray (n, dimension) or (n, dimension, p)."""
        return predict_gradient(self.basis, self.coefficients, points)

    def orthonormal_rows(self, points: np.ndarray) -> np.ndarray:
        """Rows q (n, rank) with |q|^2 the variance of the prediction over the noise variance (weight 1)."""
        values = self.basis.evaluate(points)
        if self.rank < self.basis.size:
            return values.T @ self.factor
        return linalg.solve_triangular(self.factor, values, trans="T", check_finite=False).T

    @functools.cached_property
    def _training_rows(self):
        rows = self.orthonormal_rows(self.points)
        if self.weights is not None:
            rows *= np.sqrt(self.weights)[:, None]
        return rows

    @functools.cached_property
    def leverages(self) -> np.ndarray:
        """Diagonal (n,) of the hat matrix of the weighted problem."""
        return np.einsum("ij,ij->i", self._training_rows, self._training_rows)

    @property
    def freedom(self) -> int:
        """Degrees of freedom of the residuals: points of positive weight, less the rank."""
        points = len(self.points) if self.weights is None else np.count_nonzero(self.weights)
        return int(points) - self.rank

    @property
    def noise_deviation(self) -> np.ndarray | None:
        """Standard deviation of the noise of each output; None without degrees of freedom.

        Its square is the weighted residual sum of squares over them.
        """
        if self.freedom <= 0:
            return None
        residuals = self.residuals.reshape(len(self.points), -1)
        units = output_units(residuals)
        squares = (residuals / units) ** 2
        if self.weights is not None:
            squares *= self.weights[:, None]
        deviation = units * np.sqrt(squares.sum(axis=0) / (self.freedom * self.residual_share))
        return deviation.reshape(self.residuals.shape[1:])

    def relative_covariance(self) -> np.ndarray:
        """Covariance (size, size) of the coefficients over the noise variance."""
        half = self.factor
        if self.rank == self.basis.size:
            half = linalg.solve_triangular(self.factor, np.eye(self.rank), check_finite=False)
        return half @ half.T

    def relative_variance(self, points: np.ndarray) -> np.ndarray:
        """Variance (n,) of the fitted mean over the noise variance."""
        points, variance = np.asarray(points), np.empty(len(points))
        # The rows of all points at once can be the largest array of a whole study.
        block = max(256, BLOCK_NUMBERS // self.basis.size)
        for start in range(0, len(points), block):
            rows = self.orthonormal_rows(points[start : start + block])
            variance[start : start + block] = np.einsum("ij,ij->i", rows, rows)
        return variance

    def leave_one_out(self) -> np.ndarray:
        """Prediction errors of the fits without each point, e_i / (1 - h_i): same shape as the residuals.

        A point of leverage 1 cannot be predicted by the others: its error is infinite.
        """
        slack = 1.0 - self.leverages
        lost = slack < LOST_SLACK
        slack[lost] = np.nan
        errors = (self.residuals.T / slack).T
        errors[lost] = np.inf
        return errors

    def k_fold(self, folds: Sequence[np.ndarray]) -> np.ndarray:
        """Prediction errors of the fits without each fold, (I - H_kk)^-1 e_k.

        Parameters
        ----------
        folds : sequence of int ndarrays
            Disjoint sets of positions; positions in none of them get nan.

        Returns
        -------
        ndarray, same shape as the residuals; a fold that the others cannot predict gets inf.
        """
        errors = np.full_like(self.residuals, np.nan)
        for fold in folds:
            rows = self._training_rows[fold]
            scale = np.ones(len(fold)) if self.weights is None else np.sqrt(self.weights[fold])
            shape = (len(fold),) + (1,) * (self.residuals.ndim - 1)
            matrix = np.eye(len(fold)) - rows @ rows.T
            try:
                factor = linalg.cholesky(matrix, lower=True)
            except linalg.LinAlgError:
                factor = np.zeros((1, 1))
            if factor.diagonal().min() ** 2 < LOST_SLACK:
                errors[fold] = np.inf
                continue
            weighted = scale.reshape(shape) * self.residuals[fold]
            # A weight of 0 contributes nothing to the fit, so such a point is always out of sample.
            solved = linalg.cho_solve((factor, True), weighted)
            with np.errstate(divide="ignore", invalid="ignore"):
                held_out = solved / scale.reshape(shape)
            errors[fold] = np.where(scale.reshape(shape) > 0.0, held_out, self.residuals[fold])
        return errors


def shuffled_folds(size: int, folds: int) -> list[np.ndarray]:
    """Positions 0 to ``size`` - 1 in random blocks of nearly equal size, from ``ot.RandomGenerator``.

    Examples
    --------
    >>> from satsep_ot.methods.polynomials.fit import shuffled_folds
    >>> [len(block) for block in shuffled_folds(5, 2)]
    [3, 2]
    """
    order = np.array(ot.RandomGenerator.Generate(size)).argsort(kind="stable")
    return [np.sort(block) for block in np.array_split(order, min(folds, size))]


def fit_polynomial(
    basis: PolynomialBasis,
    points: np.ndarray,
    values: np.ndarray,
    weights: np.ndarray | None = None,
    allow_deficient: bool = False,
) -> PolynomialFit:
    """Weighted least squares on a polynomial basis.

    By Householder QR (LAPACK), and SVD when that is deficient. Where the design is conditioned well (an estimate of
    the condition number below about 30), as it is with orthonormal polynomials on points of their own law, the
    normal equations give the same to about 1e-13 and take less than half of the time (Bjorck, Numerical Methods for
    Least Squares Problems, 1996, section 2.2).

    Parameters
    ----------
    basis : PolynomialBasis
    points : ndarray (n, dimension)
    values : ndarray (n,) or (n, p)
    weights : ndarray (n,), optional
        Not negative; the sum of weights * residual^2 is minimised.
    allow_deficient : bool
        False: a rank below the number of terms is refused. True: the solution of minimum norm is returned.

    Raises
    ------
    ValueError
        Shapes, non-finite data, negative weights, rank below the number of terms.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.polynomials.basis import PolynomialBasis
    >>> from satsep_ot.methods.polynomials.fit import fit_polynomial
    >>> points = np.linspace(-2.0, 2.0, 9)[:, None]
    >>> fit = fit_polynomial(PolynomialBasis(1, 2), points, points[:, 0] ** 2)
    >>> (fit.coefficients.round(4) + 0.0).tolist()
    [1.0, 0.0, 1.4142]
    """
    points = basis.checked_points(points)
    values = np.asarray(values, dtype=float)
    if values.ndim not in (1, 2) or len(values) != len(points):
        raise ValueError(f"The values have shape {values.shape}; it must be ({len(points)},) or ({len(points)}, p).")
    if weights is not None:
        weights = np.asarray(weights, dtype=float)
        if weights.shape != (len(points),) or not (np.isfinite(weights).all() and (weights >= 0.0).all()):
            raise ValueError(f"The weights must be {len(points)} finite numbers >= 0.")
    size = basis.size
    if len(points) < size and not allow_deficient:
        raise ValueError(
            f"A polynomial of {size} terms needs at least {size} points, got {len(points)}: "
            "give more points or lower the degree."
        )
    if size >= THREADED_SIZE or size * size * len(points) < UNTHREADED_WORK:
        return _least_squares(basis, points, values, weights, allow_deficient)
    with singleThread():
        return _least_squares(basis, points, values, weights, allow_deficient)


def _least_squares(basis, points, values, weights, allow_deficient):
    """The fit of data whose shapes are checked."""
    size = basis.size
    columns = values.reshape(len(values), -1)
    # A constant does not look at the points, so only the slow way refuses those that are not finite.
    if basis.degree > 0 and len(points) >= POINTS_PER_TERM * size:
        normal = _normal_equations(basis, points, columns, weights)
        triangle, coefficients, failed = _POSV(normal[:, :size], normal[:, size:])
        if not failed:
            condition = _triangle_condition(triangle)
            # An output with a value that is not finite has no finite coefficient.
            if condition < NORMAL_CONDITION * math.sqrt(size) and all(map(math.isfinite, coefficients[0])):
                coefficients = coefficients.reshape(size, *values.shape[1:])
                return PolynomialFit(basis, points, values, weights, coefficients, triangle, size, condition)
    factored = _factorise(basis, points, columns, weights)
    # One number that is not finite spreads through the whole factorisation; a constant does not look at the points.
    if not np.isfinite(factored).all() or (basis.degree == 0 and not np.isfinite(points).all()):
        _refuse_not_finite(points, values)
    triangle = factored[:size, :size]
    if len(triangle) == size:
        condition = _triangle_condition(triangle)
        if condition < 1.0 / (size * np.finfo(float).eps):
            coefficients, _ = _TRTRS(triangle, factored[:size, size:])
            coefficients = coefficients.reshape(size, *values.shape[1:])
            return PolynomialFit(basis, points, values, weights, coefficients, triangle, size, condition)
    # The triangle has the singular values of the design.
    factored = np.triu(factored)
    left, singular, right = linalg.svd(factored[:, :size], full_matrices=False, check_finite=False)
    rank = int((singular > singular[0] * max(len(points), size) * np.finfo(float).eps).sum())
    # The two norms need not agree at the edge, where the triangle has been refused.
    rank = min(rank, size - 1)
    if rank < size and not allow_deficient:
        raise ValueError(
            f"The polynomial has {size} terms but the {len(points)} points give rank {rank} only: "
            "points are repeated, lie in a lower dimension or have weight 0; give more points or lower the degree."
        )
    factor = right[:rank].T / singular[:rank]
    coefficients = (factor @ (left[:, :rank].T @ factored[:, size:])).reshape(size, *values.shape[1:])
    condition = singular[0] / singular[-1] if singular[-1] > 0.0 else np.inf
    return PolynomialFit(basis, points, values, weights, coefficients, factor, rank, condition)


def _normal_equations(basis, points, columns, weights):
    """Normal matrix (size, size) of the weighted design, and beside it its products (size, p) with the outputs.

    By blocks of points: the design is never stored as a whole, and a block of it stays in the cache.
    """
    width = basis.size + columns.shape[1]
    scale = None if weights is None else np.sqrt(weights)
    block = max(256, BLOCK_NUMBERS // width)
    if len(points) <= block:
        return _normal_part(basis, points, columns, scale, np.empty((width, len(points))))
    buffer = np.empty((width, block))
    normal = np.zeros((basis.size, width))
    for start in range(0, len(points), block):
        some = slice(start, start + block)
        system = buffer[:, : len(points) - start]
        normal += _normal_part(basis, points[some], columns[some], None if scale is None else scale[some], system)
    return normal


def _normal_part(basis, points, columns, scale, system):
    """The normal equations of a block; ``system`` (size + p, n) is memory for the scaled design and outputs."""
    size = basis.size
    design = system[:size]
    basis.evaluate_block(points, design)
    system[size:] = columns.T
    if scale is not None:
        system *= scale
    if size < SYMMETRIC_PRODUCT_SIZE:
        return design.dot(system.T)
    part = np.empty((size, len(system)))
    np.matmul(design, design.T, out=part[:, :size])
    np.matmul(design, system[size:].T, out=part[:, size:])
    return part


def _factorise(basis, points, columns, weights):
    """Triangular factor of the weighted design with the outputs as further columns, so that Q^T y comes with it.

    Long designs are factorised in blocks of points, each on top of the factor of those before it: the memory does
    not grow with the number of points. Below the diagonal stand the reflectors, not zeros.
    """
    width = basis.size + columns.shape[1]
    scale = None if weights is None else np.sqrt(weights)
    block = max(BLOCK_NUMBERS // width, ROWS_PER_COLUMN * width)
    factored = None
    for start in range(0, len(points), block):
        some = slice(start, start + block)
        carried = 0 if factored is None else len(factored)
        # Terms by points: the transpose is the column-major matrix that LAPACK overwrites.
        system = np.empty((width, carried + len(points[some])))
        if carried:
            system[:, :carried] = np.triu(factored).T
        basis.evaluate(points[some], out=system[: basis.size, carried:])
        system[basis.size :, carried:] = columns[some].T
        if scale is not None:
            system[:, carried:] *= scale[some]
        panel = min(max(2, width // 3), PANEL_COLUMNS, *system.shape)
        factored = _GEQRT(panel, system.T, overwrite_a=1)[0]
        # A copy lets go of the design.
        factored = factored[:width].copy(order="F")
    return factored


def _triangle_condition(triangle):
    """Estimate of the condition number of an upper triangle in the 1-norm (both are trcon's defaults)."""
    reciprocal, _ = _TRCON(triangle)
    return 1.0 / reciprocal if reciprocal > 0.0 else np.inf


def _refuse_not_finite(points, values):
    bad = ~(np.isfinite(points).all(axis=1) & np.isfinite(values.reshape(len(values), -1)).all(axis=1))
    if bad.any():
        raise ValueError(f"A fit needs finite data, but {bad.sum()} rows are not, the first is row {bad.argmax()}.")
    raise ValueError(
        f"The polynomials overflow at points as large as {np.abs(points).max():.3g}: scale the inputs to order 1."
    )
