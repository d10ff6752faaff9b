"""Exponents of multivariate polynomials, ordered so that whole blocks of terms come from one multiplication."""

import functools
from collections.abc import Sequence

import numpy as np


@functools.lru_cache(maxsize=256)
def total_degree_indices(dimension: int, degree: int, norm: float = 1.0) -> np.ndarray:
    """Exponents alpha with (sum alpha_i^norm)^(1/norm) <= degree, by total degree.

    ``norm`` = 1 is the total-degree set, ``norm`` < 1 the hyperbolic set of Blatman and Sudret (2011).

    Returns
    -------
    ndarray of int (terms, dimension)
        Not writeable.

    Examples
    --------
    >>> from satsep_ot.methods.polynomials.index_sets import total_degree_indices
    >>> total_degree_indices(2, 2).tolist()
    [[0, 0], [1, 0], [0, 1], [2, 0], [1, 1], [0, 2]]
    >>> len(total_degree_indices(2, 4, norm=0.5))
    10
    """
    indices = [((), 0.0)]
    budget = degree**norm * (1.0 + 1e-12)
    for _ in range(dimension):
        indices = [
            (alpha + (order,), used + order**norm)
            for alpha, used in indices
            for order in range(degree + 1)
            if used + (order**norm if order else 0.0) <= budget
        ]
    alphas = [alpha for alpha, _ in indices]

    def position(alpha):
        # By degree, then by the last variable used, then by its exponent, then as the parent: so the parents of
        # consecutive terms are consecutive too, and whole blocks of terms are one multiplication.
        key = [sum(alpha)]
        for variable in reversed(range(dimension)):
            if alpha[variable]:
                key += [variable, alpha[variable]]
                alpha = alpha[:variable] + (0,) * (dimension - variable)
        return key

    array = np.array(sorted(alphas, key=position), dtype=np.int64).reshape(len(alphas), dimension)
    array.flags.writeable = False
    return array


def multiplication_runs(
    indices: np.ndarray, parents: Sequence[tuple[int, ...]], factors: Sequence[tuple[int, ...]], first: int
) -> list[tuple]:
    """Runs of consecutive terms that come from consecutive parents by the same factor.

    Parameters
    ----------
    indices : ndarray of int (terms, dimension)
    parents : sequence of tuple of int
        Exponents of the term that each term is made from.
    factors : sequence of tuple of int
        What it is multiplied by.
    first : int
        Terms before this one are left out.

    Returns
    -------
    list of tuple
        (first term, last term + 1, first parent, *factor).

    Examples
    --------
    >>> from satsep_ot.methods.polynomials.index_sets import multiplication_runs, total_degree_indices
    >>> multiplication_runs(total_degree_indices(1, 3), [(0,), (0,), (1,), (2,)], [(0,)] * 4, 2)
    [(2, 3, 1, 0), (3, 4, 2, 0)]
    """
    position = {tuple(alpha): term for term, alpha in enumerate(indices.tolist())}
    runs: list[tuple] = []
    for term in range(first, len(indices)):
        parent = position[parents[term]]
        if runs:
            begin, end, first_parent, *factor = runs[-1]
            # A run must not need its own results.
            if tuple(factor) == factors[term] and parent == first_parent + end - begin < begin:
                runs[-1] = (begin, term + 1, first_parent, *factor)
                continue
        runs.append((term, term + 1, parent, *factors[term]))
    return runs
