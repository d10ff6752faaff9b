"""Designs on which polynomial least squares is well conditioned."""

import numpy as np
import openturns as ot

from satsep_ot.methods.polynomial_basis import PolynomialBasis

# The law of one variable under phi(x) psi_k(x)^2 is tabulated on this grid; for degree 10 it ends near 6.5.
GRID = np.linspace(-12.0, 12.0, 4801)


def christoffelDesign(dimension, degree, size):
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
    >>> from satsep_ot.methods.polynomial_design import christoffelDesign
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
