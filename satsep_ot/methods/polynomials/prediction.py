"""Polynomials with given coefficients, arranged so that many points are evaluated fast."""

import dataclasses
import functools

import numpy as np

from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.polynomials.basis import BLOCK_NUMBERS, PolynomialBasis
from satsep_ot.methods.polynomials.index_sets import multiplication_runs, total_degree_indices

# Up to this number of coefficients Horner's rule is faster than matrix products.
HORNER_COEFFICIENTS = 40
# Above this number of entries the product of the two halves is done by degree instead of as one dense product.
DENSE_SPLIT_SIZE = 400


class PolynomialPrediction:
    """Values of polynomials sum_k coefficients[k] psi_k on arrays of points.

    The polynomials are those of a :class:`~satsep_ot.methods.polynomials.basis.PolynomialBasis`, converted to powers
    of the standardised variables (the first polynomial of each family). Few coefficients go through Horner's rule.
    For many the variables are split in two halves, each with its own monomials, one multiplication each, and the sum
    over all pairs is one matrix product.

    Powers cost digits, and the standardised variable few of them: relative to sum_k abs(coefficients[k] psi_k) at the
    same point the error is below 1e-14 for a degree of 4 and below 1e-12 for one of 10, where the variables have
    their mass.

    Parameters
    ----------
    basis : :class:`~satsep_ot.methods.polynomials.basis.PolynomialBasis`
    coefficients : ndarray (size, p)
    centre, slope : ndarray (dimension,), optional
        The points that are given later are turned to the variables of the basis first, z = slope (x - centre).

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.polynomials.basis import PolynomialBasis
    >>> from satsep_ot.methods.polynomials.prediction import PolynomialPrediction
    >>> prediction = PolynomialPrediction(PolynomialBasis(2, 1), np.array([[1.0], [2.0], [3.0]]))
    >>> prediction.evaluate(np.array([[10.0, 100.0], [0.0, 0.0]])).tolist()
    [[321.0, 1.0]]
    """

    def __init__(
        self,
        basis: PolynomialBasis,
        coefficients: np.ndarray,
        centre: np.ndarray | None = None,
        slope: np.ndarray | None = None,
    ) -> None:
        self._dimension = basis.dimension
        columns = np.asarray(coefficients, dtype=float).T
        self._rule: _Constants | _Horner | _SplitProduct
        if basis.size == 1:
            self._rule = _Constants(columns)
            return
        standardisation = _Standardisation.of(basis.recurrence, centre, slope)
        few = basis.dimension == 1 or columns.size <= HORNER_COEFFICIENTS
        self._rule = (_Horner if few else _SplitProduct)(basis, columns, standardisation)

    def evaluate(self, points: np.ndarray) -> np.ndarray:
        """Values (p, n) at points (n, dimension)."""
        points = np.asarray(points, dtype=float)
        if points.ndim != 2 or points.shape[1] != self._dimension:
            raise ValueError(f"The points have shape {points.shape}; it must be (n, {self._dimension}).")
        return self._rule.evaluate(points)


def predict(basis: PolynomialBasis, coefficients: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values of the polynomials sum_k coefficients[k] psi_k.

    Parameters
    ----------
    basis : :class:`~satsep_ot.methods.polynomials.basis.PolynomialBasis`
    coefficients : ndarray (size,) or (size, p)
    points : ndarray (n, dimension)

    Returns
    -------
    ndarray (n,) or (n, p)
    """
    coefficients = np.asarray(coefficients, dtype=float)
    values = PolynomialPrediction(basis, coefficients.reshape(basis.size, -1)).evaluate(points)
    return values[0] if coefficients.ndim == 1 else np.ascontiguousarray(values.T)


def predict_gradient(basis: PolynomialBasis, coefficients: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Gradients of the polynomials, see :func:`predict`.

    Returns
    -------
    ndarray (n, dimension) for coefficients (size,), (n, dimension, p) for (size, p)
    """
    slopes = _slopes(basis, np.asarray(coefficients, dtype=float))
    values = predict(basis, slopes.reshape(basis.size, -1), points)
    return values.reshape(len(values), *slopes.shape[1:])


def predict_hessian(basis: PolynomialBasis, coefficients: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Second derivatives of the polynomials: ndarray (n, dimension, dimension) or (n, dimension, dimension, p)."""
    slopes = _slopes(basis, np.asarray(coefficients, dtype=float))
    bends = np.stack([_slopes(basis, slopes[:, j]) for j in range(basis.dimension)], axis=1)
    values = predict(basis, bends.reshape(basis.size, -1), points)
    return values.reshape(len(values), *bends.shape[1:])


def _slopes(basis, coefficients):
    """Coefficients (size, dimension) or (size, dimension, p) of the derivatives in each variable."""
    return np.stack([basis.derivative_coefficients(coefficients, j) for j in range(basis.dimension)], axis=1)


@dataclasses.dataclass
class _Standardisation:
    """Standardised variables t = slope (x - centre): columns (dimension, 1), None where they change nothing."""

    centre: np.ndarray | None
    slope: np.ndarray | None

    @staticmethod
    def of(recurrence, centre, slope):
        first, constant = recurrence[:, 0, 0], recurrence[:, 0, 1]
        slope = first if slope is None else slope * first
        centre = (0.0 if centre is None else centre) - constant / slope
        return _Standardisation(
            centre[:, None] if centre.any() else None, slope[:, None] if (slope != 1.0).any() else None
        )

    def apply(self, points, variables, out):
        """Write the standardised variables of points (n, dimension) as rows."""
        out[:] = points[:, variables].T
        if self.centre is not None:
            out -= self.centre[variables]
        if self.slope is not None:
            out *= self.slope[variables]


class _Constants:
    """Polynomials of one term."""

    def __init__(self, columns):
        self._columns = columns

    def evaluate(self, points):
        return np.repeat(self._columns, len(points), axis=1)


class _Horner:
    """Horner's rule, nested over the variables."""

    def __init__(self, basis, columns, standardisation):
        self._dimension = basis.dimension
        self._standardisation = standardisation
        positions = _horner_positions(basis.dimension, basis.degree, basis.norm)
        converted = columns @ _conversion(basis.indices, _power_coefficients(basis.recurrence))
        self._schemes = [_horner_scheme(positions, row) for row in converted]

    def evaluate(self, points):
        return _evaluate_blocks(self._evaluate_block, points, len(self._schemes), 2 * self._dimension)

    def _evaluate_block(self, points, out):
        variables = np.empty((self._dimension, len(points)))
        self._standardisation.apply(points, slice(None), variables)
        inner = np.empty((self._dimension - 1, len(points)))
        for row, scheme in zip(out, self._schemes, strict=True):
            _horner(scheme, variables, inner, row)


class _SplitProduct:
    """Monomials of both halves of the variables, and a matrix product over all pairs of them."""

    def __init__(self, basis, columns, standardisation):
        self._standardisation = standardisation
        self._left, self._right, rows, positions, self._groups = _halves(basis.dimension, basis.degree, basis.norm)
        left, right = self._left[0], self._right[0]
        tables = np.zeros((len(columns), len(left), len(right)))
        tables[:, rows, positions] = columns
        self._half = left.shape[1]
        powers = _power_coefficients(basis.recurrence)
        tables = _conversion(left, powers[: self._half]).T @ tables @ _conversion(right, powers[self._half :])
        self._tables = [
            [np.ascontiguousarray(t[first:last, :width]) for first, last, width in self._groups] for t in tables
        ]

    @singleThread()
    def evaluate(self, points):
        rows = 2 * len(self._left[0]) + len(self._right[0])
        return _evaluate_blocks(self._evaluate_block, points, len(self._tables), rows)

    def _evaluate_block(self, points, out):
        left = self._monomials(points, slice(0, self._half), *self._left)
        right = self._monomials(points, slice(self._half, None), *self._right)
        inner = np.empty_like(left)
        for row, tables in zip(out, self._tables, strict=True):
            for (first, last, width), table in zip(self._groups, tables, strict=True):
                np.matmul(table, right[:width], out=inner[first:last])
            np.einsum("ij,ij->j", inner, left, out=row)

    def _monomials(self, points, variables, indices, runs):
        values = np.empty((len(indices), len(points)))
        values[0] = 1.0
        self._standardisation.apply(points, variables, values[1 : indices.shape[1] + 1])
        for first, last, parent, variable in runs:
            np.multiply(values[parent : parent + last - first], values[1 + variable], out=values[first:last])
        return values


def _evaluate_blocks(evaluate_block, points, outputs, rows):
    """Values (outputs, n), by blocks of points for which ``rows`` numbers each stay in the cache."""
    result = np.empty((outputs, len(points)))
    size = max(256, BLOCK_NUMBERS // rows)
    for start in range(0, len(points), size):
        evaluate_block(points[start : start + size], result[:, start : start + size])
    return result


def _power_coefficients(recurrence):
    """Matrices (dimension, degree + 1, degree + 1) of polynomials in powers of the first one, t = a_0 x + b_0."""
    dimension, degree, _ = recurrence.shape
    matrices = np.zeros((dimension, degree + 1, degree + 1))
    matrices[:, 0, 0] = 1.0
    first, constant = recurrence[:, 0, 0, None], recurrence[:, 0, 1, None]
    for order in range(degree):
        a, b, c = recurrence[:, order, :, None].swapaxes(0, 1)
        following, last = matrices[:, order + 1], matrices[:, order]
        following[:, 1:] = a / first * last[:, :-1]
        following += (b - a * constant / first) * last
        if order:
            following += c * matrices[:, order - 1]
    return matrices


def _conversion(indices, powers):
    """Matrix (terms, terms) of products of the families' polynomials in monomials."""
    matrix = np.ones((len(indices), len(indices)))
    for column, family in zip(indices.T, powers, strict=True):
        matrix *= family[column[:, None], column]
    return matrix


@functools.lru_cache(maxsize=64)
def _horner_positions(dimension, degree, norm):
    """For each power of the first variable, the highest first, the positions of its factor in the other variables."""

    def nest(indices, positions):
        if indices.shape[1] == 0:
            return int(positions[0])
        chosen = (indices[:, 0] == order for order in range(indices[:, 0].max(), -1, -1))
        return [nest(indices[some, 1:], positions[some]) for some in chosen]

    indices = total_degree_indices(dimension, degree, norm)
    return nest(indices, np.arange(len(indices)))


def _horner_scheme(positions, coefficients):
    # Numbers as arrays, which numpy adds and multiplies faster than floats.
    if isinstance(positions, int):
        return np.array(coefficients[positions])
    return [_horner_scheme(some, coefficients) for some in positions]


def _horner(scheme, variables, inner, out):
    """Value of a scheme at variables (k, n) into ``out`` (n,), with memory (k - 1, n) for the inner values."""
    variable = variables[0]
    if len(variables) == 1:
        if len(scheme) == 1:
            out[:] = scheme[0]
            return
        np.multiply(variable, scheme[0], out=out)
        for coefficient in scheme[1:-1]:
            out += coefficient
            out *= variable
        out += scheme[-1]
        return
    _horner(scheme[0], variables[1:], inner[1:], out)
    for factor in scheme[1:]:
        out *= variable
        _horner(factor, variables[1:], inner[1:], inner[0])
        out += inner[0]


@functools.lru_cache(maxsize=64)
def _halves(dimension, degree, norm):
    """Monomials of both halves of the variables, where each term sits in their product, and the blocks of it."""
    half = (dimension + 1) // 2
    whole = total_degree_indices(dimension, degree, norm)
    left, right = (total_degree_indices(count, degree, norm) for count in (half, dimension - half))
    rows, columns = (
        np.array([position[tuple(alpha)] for alpha in part.tolist()])
        for part, position in (
            (whole[:, :half], {tuple(alpha): term for term, alpha in enumerate(left.tolist())}),
            (whole[:, half:], {tuple(alpha): term for term, alpha in enumerate(right.tolist())}),
        )
    )
    if len(left) * len(right) <= DENSE_SPLIT_SIZE:
        groups = [(0, len(left), len(right))]
    else:
        left_degree = left.sum(axis=1)
        groups = []
        for order in range(degree + 1):
            first, last = np.searchsorted(left_degree, [order, order + 1])
            if last > first:
                width = int(columns[(rows >= first) & (rows < last)].max()) + 1
                groups.append((int(first), int(last), width))
    return (left, _monomial_runs(left)), (right, _monomial_runs(right)), rows, columns, groups


def _monomial_runs(indices):
    """Runs (first, last, first parent, variable) of monomials of degree 2 and more, each a parent times a variable."""
    parents, factors = [], []
    for alpha in indices.tolist():
        variable = max((i for i, order in enumerate(alpha) if order), default=0)
        parents.append(tuple(alpha[:variable] + [alpha[variable] - 1] + alpha[variable + 1 :]))
        factors.append((variable,))
    return multiplication_runs(indices, parents, factors, indices.shape[1] + 1)
