"""Multivariate orthonormal polynomials on arrays: evaluation and derivatives.

Everything is term-major: the basis at ``n`` points is an array (terms, points).
"""

import functools
import math

import numpy as np
from scipy import sparse

from satsep_ot.methods.polynomials.index_sets import multiplication_runs, total_degree_indices

# Numbers evaluated together: the tables of one block stay in the second-level cache.
BLOCK_NUMBERS = 1 << 17


def hermite_recurrence(degree: int) -> np.ndarray:
    """Recurrence of the Hermite polynomials that are orthonormal for the standard normal law.

    Parameters
    ----------
    degree : int
        Highest degree needed.

    Returns
    -------
    ndarray (degree, 3)
        Rows (a, b, c) of P_{k+1}(x) = (a x + b) P_k(x) + c P_{k-1}(x).

    Examples
    --------
    >>> from satsep_ot.methods.polynomials.basis import hermite_recurrence
    >>> hermite_recurrence(2).round(4).tolist()
    [[1.0, 0.0, -0.0], [0.7071, 0.0, -0.7071]]
    """
    order = np.arange(degree)
    return np.column_stack([1.0 / np.sqrt(order + 1.0), np.zeros(degree), -np.sqrt(order / (order + 1.0))])


class PolynomialBasis:
    """Tensor products of orthonormal polynomials over a downward closed index set.

    Parameters
    ----------
    dimension : int
        Number of variables; with 0 there is the constant alone.
    degree : int
        Highest degree, at least 0.
    norm : float
        1 for the total-degree set, in (0, 1) for a hyperbolic one.
    recurrence : ndarray (dimension, degree, 3), optional
        Three-term recurrence of each variable's family, see :func:`hermite_recurrence` (the default).

    Attributes
    ----------
    indices : ndarray of int (size, dimension)
        Exponents of each term; the first term is the constant.
    size : int
        Number of terms.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.polynomials.basis import PolynomialBasis
    >>> basis = PolynomialBasis(2, 2)
    >>> basis.evaluate(np.array([[2.0, 3.0]]))[:, 0].round(4).tolist()
    [1.0, 2.0, 3.0, 2.1213, 6.0, 5.6569]
    """

    def __init__(self, dimension: int, degree: int, norm: float = 1.0, recurrence: np.ndarray | None = None) -> None:
        if dimension < 0:
            raise ValueError(f"The dimension of a polynomial basis is {dimension}; it must be at least 0.")
        if degree < 0:
            raise ValueError(f"The degree of a polynomial basis is {degree}; it must be at least 0.")
        if not 0.0 < norm <= 1.0:
            raise ValueError(f"The norm of the index set is {norm}; it must be in (0, 1].")
        if recurrence is None:
            recurrence = np.broadcast_to(hermite_recurrence(degree), (dimension, degree, 3))
        recurrence = np.asarray(recurrence, dtype=float)
        if recurrence.shape != (dimension, degree, 3):
            raise ValueError(f"The recurrence has shape {recurrence.shape}; it must be {(dimension, degree, 3)}.")
        self.dimension = dimension
        self.degree = degree
        self.norm = norm
        self.recurrence = recurrence
        self.indices = total_degree_indices(dimension, degree, norm)
        self.size = len(self.indices)
        self._blocks = _product_runs(dimension, degree, norm)
        # Columns (dimension, 1) for each order; symmetric families have no constant part. One variable is a vector,
        # for which numpy needs half of the time.
        shape = () if dimension == 1 else (dimension, 1)
        self._steps = [
            (a.reshape(shape), b.reshape(shape) if b.any() else None, c.reshape(shape))
            for a, b, c in recurrence.transpose(1, 2, 0)
        ]

    def __repr__(self) -> str:
        return f"PolynomialBasis(dimension={self.dimension}, degree={self.degree}, size={self.size})"

    def _univariate(self, points, out=None):
        """Values (degree + 1, dimension, n) of each variable's polynomials at points (n, dimension).

        Without the middle axis for one variable.
        """
        x = np.ascontiguousarray(points[:, 0] if self.dimension == 1 else points.T)
        table = np.empty((self.degree + 1, *x.shape)) if out is None else out
        table[0] = 1.0
        for order, (a, b, c) in enumerate(self._steps):
            following = table[order + 1]
            np.multiply(x, a, out=following)
            if b is not None:
                following += b
            if order:
                following *= table[order]
                following += c * table[order - 1]
        return table

    def checked_points(self, points: np.ndarray) -> np.ndarray:
        """Points as floats; ValueError unless their shape is (n, dimension)."""
        points = np.asarray(points, dtype=float)
        if points.ndim != 2 or points.shape[1] != self.dimension:
            raise ValueError(f"The points have shape {points.shape}; it must be (n, {self.dimension}).")
        return points

    def evaluate(self, points: np.ndarray, out: np.ndarray | None = None) -> np.ndarray:
        """Values of all terms.

        Parameters
        ----------
        points : ndarray (n, dimension)
        out : ndarray (size, n), optional
            Where to write them.

        Returns
        -------
        ndarray (size, n)
        """
        points = self.checked_points(points)
        values = np.empty((self.size, len(points))) if out is None else out
        block = max(256, BLOCK_NUMBERS // self.size)
        for start in range(0, len(points), block):
            self.evaluate_block(points[start : start + block], values[:, start : start + block])
        return values

    def evaluate_block(self, points: np.ndarray, values: np.ndarray) -> None:
        """Write all terms (size, n) at so few points that the tables stay in the cache."""
        if self.dimension == 1:
            self._univariate(points, values)
            return
        table = self._univariate(points)
        values[0] = 1.0
        for first, last, parent, variable, order in self._blocks:
            if parent == 0:
                values[first] = table[order, variable]
            else:
                np.multiply(values[parent : parent + last - first], table[order, variable], out=values[first:last])

    @functools.cached_property
    def derivatives(self) -> list:
        """For each variable the sparse matrix D (size, size) with d psi / d x_j = D psi."""
        position = {tuple(alpha): term for term, alpha in enumerate(self.indices.tolist())}
        matrices = []
        for variable in range(self.dimension):
            univariate = self._univariate_derivative(variable)
            rows, columns, entries = [], [], []
            for term, alpha in enumerate(self.indices.tolist()):
                for order in np.flatnonzero(univariate[alpha[variable]]):
                    rows.append(term)
                    columns.append(position[tuple(alpha[:variable] + [int(order)] + alpha[variable + 1 :])])
                    entries.append(univariate[alpha[variable], order])
            matrices.append(sparse.csr_array((entries, (rows, columns)), shape=(self.size, self.size)))
        return matrices

    def _univariate_derivative(self, variable):
        """Matrix d with P_k' = sum_m d[k, m] P_m, by differentiating the recurrence."""
        a, b, c = self.recurrence[variable].T
        size = self.degree + 1
        # Multiplication by x in the basis; its last row is never used, since P_k' has degree k - 1.
        shift = np.zeros((size, size))
        for order in range(self.degree):
            shift[order, order + 1] = 1.0 / a[order]
            shift[order, order] = -b[order] / a[order]
            if order:
                shift[order, order - 1] = -c[order] / a[order]
        derivative = np.zeros((size, size))
        for order in range(self.degree):
            derivative[order + 1] = a[order] * (derivative[order] @ shift) + b[order] * derivative[order]
            derivative[order + 1, order] += a[order]
            if order:
                derivative[order + 1] += c[order] * derivative[order - 1]
        # What should vanish does so only up to rounding.
        derivative[np.abs(derivative) < 1e-13 * max(np.abs(derivative).max(initial=0.0), 1.0)] = 0.0
        return derivative

    def derivative_coefficients(self, coefficients: np.ndarray, variable: int) -> np.ndarray:
        """Coefficients, in this basis, of the polynomial's derivative in one variable (same shape)."""
        return self.derivatives[variable].T @ np.asarray(coefficients, dtype=float)


@functools.lru_cache(maxsize=256)
def _product_runs(dimension, degree, norm):
    """Runs (first, last, first parent, variable, exponent) of terms after the constant.

    The parent lacks the last variable of the term, whose polynomial is the factor.
    """
    indices = total_degree_indices(dimension, degree, norm)
    parents, factors = [], []
    for alpha in indices.tolist():
        variable = max((i for i, order in enumerate(alpha) if order), default=0)
        parents.append(tuple(alpha[:variable] + [0] * (dimension - variable)))
        factors.append((variable, alpha[variable] if dimension else 0))
    return multiplication_runs(indices, parents, factors, 1)


def number_of_terms(dimension: int, degree: int) -> int:
    """Number of terms of the total-degree basis: binomial(dimension + degree, degree)."""
    return math.comb(dimension + degree, degree)
