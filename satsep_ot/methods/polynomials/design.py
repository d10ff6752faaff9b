"""Designs on which polynomial least squares is well conditioned."""

import numpy as np
import openturns as ot
from scipy import linalg

from satsep_ot.methods.polynomials.basis import PolynomialBasis

# An exchange must raise the determinant by more than this factor to be made.
LEAST_GAIN = 1e-9
# The law of one variable under phi(x) psi_k(x)^2 is tabulated on this grid; for degree 10 it ends near 6.5.
GRID = np.linspace(-12.0, 12.0, 4801)


def christoffelDesign(dimension: int, degree: int, size: int) -> tuple[np.ndarray, np.ndarray]:
    """Random points in the standard normal space, and weights, for total-degree least squares.

    The points follow the density phi(x) K(x) / P, with K(x) = sum_k psi_k(x)^2 over the P terms, and carry the
    weight P / K(x): with these weights the normal matrix is the identity on average, and well conditioned from
    about P log P points on (Cohen and Migliorati, SMAI J. Comput. Math. 3, 2017).

    Parameters
    ----------
    dimension : int
        Number of variables, at least 1.
    degree : int
        Total degree, at least 0.
    size : int
        Number of points, at least 1.

    Returns
    -------
    points : ndarray (size, dimension)
    weights : ndarray (size,)

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.polynomials.design import christoffelDesign
    >>> ot.RandomGenerator.SetSeed(0)
    >>> points, weights = christoffelDesign(2, 4, 100)
    >>> points.shape, weights.shape
    ((100, 2), (100,))
    """
    if dimension < 1 or size < 1:
        raise ValueError(f"A design needs at least one variable and one point, got {dimension} and {size}.")
    basis = PolynomialBasis(dimension, degree)
    # The density is the mixture of the products phi psi_k^2, each term with the same share.
    orders = basis.indices[np.array(ot.RandomGenerator.IntegerGenerate(size, basis.size), dtype=int)]
    uniform = np.array(ot.RandomGenerator.Generate(size * dimension)).reshape(size, dimension)
    values = PolynomialBasis(1, degree).evaluate(GRID[:, None])
    density = np.exp(-0.5 * GRID**2) * values**2
    points = np.empty((size, dimension))
    for order in range(degree + 1):
        cumulated = np.cumsum(density[order])
        chosen = orders == order
        points[chosen] = np.interp(uniform[chosen] * cumulated[-1], cumulated, GRID)
    return points, basis.size / (basis.evaluate(points) ** 2).sum(axis=0)


def dOptimalDesign(candidates: np.ndarray, degree: int, size: int) -> np.ndarray:
    """Points out of candidates for which det(sum psi psi^T) of total-degree least squares is largest (locally).

    The first points are those of a pivoted QR of the candidates (approximate Fekete points of Sommariva and
    Vianello, Comput. Math. Appl. 57, 2009), the next ones those of largest variance; then single points are
    exchanged while that raises the determinant (Fedorov, Theory of Optimal Experiments, 1972). Points may repeat.

    Parameters
    ----------
    candidates : ndarray (m, dimension)
        At least as many different points as the polynomial has terms.
    degree : int
        Total degree.
    size : int
        Number of points, at least the number of terms.

    Returns
    -------
    ndarray of int (size,)
        Positions among the candidates, increasing.

    Raises
    ------
    ValueError
        Fewer points than terms, or candidates that do not determine the polynomial; the rank is named.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.polynomials.design import dOptimalDesign
    >>> dOptimalDesign(np.linspace(-1.0, 1.0, 21)[:, None], 2, 3).tolist()
    [0, 10, 20]
    """
    candidates = np.asarray(candidates, dtype=float)
    if candidates.ndim != 2 or not np.isfinite(candidates).all():
        raise ValueError(f"The candidates must be finite and of shape (m, dimension), got {candidates.shape}.")
    basis = PolynomialBasis(candidates.shape[1], degree)
    if size < basis.size:
        raise ValueError(f"A polynomial of {basis.size} terms needs at least {basis.size} points, got {size}.")
    rows = basis.evaluate(candidates).T
    # Another basis scales all determinants alike, and a basis orthonormal on the candidates is well-conditioned.
    left, singular, _ = linalg.svd(rows, full_matrices=False)
    rank = int((singular > singular[0] * max(rows.shape) * np.finfo(float).eps).sum())
    if rank < basis.size:
        raise ValueError(f"The polynomial has {basis.size} terms but the candidates give rank {rank} only.")
    chosen = list(linalg.qr(left.T, mode="r", pivoting=True)[1][: basis.size])
    while len(chosen) < size:
        chosen.append(int(_leverages(left, chosen).argmax()))
    chosen = np.array(chosen)
    while True:
        inverse = np.linalg.inv(left[chosen].T @ left[chosen])
        cross = left @ inverse @ left[chosen].T
        inner = np.einsum("ij,jk,ik->i", left, inverse, left)
        # Factor of the determinant when candidate i replaces design point j.
        factor = (1.0 + inner[:, None]) * (1.0 - inner[chosen]) + cross**2
        entering, leaving = np.unravel_index(factor.argmax(), factor.shape)
        if factor[entering, leaving] <= 1.0 + LEAST_GAIN:
            return np.sort(chosen)
        chosen[leaving] = entering


def _leverages(rows, chosen):
    return np.einsum("ij,jk,ik->i", rows, np.linalg.inv(rows[chosen].T @ rows[chosen]), rows)
