"""Active subspace of given gradients: eigenvalues, directions, bootstrap."""

import numpy as np
import openturns as ot
from scipy import linalg

# Below this many rows for each input, a bootstrap replicate may span less than the whole sample.
ROWS_FOR_CHOLESKY = 4
# Singular values below this share of the largest are not known from eigenvalues of a Gram matrix to eight digits.
CERTAIN_SHARE = 1e-4
# A quantile below this share of the estimate comes from replicates with too few different rows to resolve it.
LEAST_REFLECTED = 1e-2


def orient(directions: np.ndarray) -> np.ndarray:
    """Columns with their largest component positive.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.subspaces.estimation import orient
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
    >>> from satsep_ot.methods.subspaces.estimation import subspace_distance
    >>> round(subspace_distance(np.array([[1.0], [0.0]]), np.array([[0.8], [0.6]])), 12)
    0.6
    """
    if first.shape != second.shape:
        return 1.0
    if first.shape[1] == 0:
        return 0.0
    # The sine from the residual of the projection is exact for small angles; from the cosine it is not.
    return float(min(linalg.norm(second - first @ (first.T @ second), 2), 1.0))


def estimate_subspace(
    gradients: np.ndarray, scales: np.ndarray | None = None, weights: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
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
    >>> from satsep_ot.methods.subspaces.estimation import estimate_subspace
    >>> eigenvalues, vectors = estimate_subspace(np.array([[[3.0], [4.0]], [[6.0], [8.0]]]))
    >>> eigenvalues.round(12).tolist(), vectors[:, 0].round(12).tolist()
    ([62.5, 0.0], [0.6, 0.8])
    """
    rows = stacked_rows(gradients, scales, weights)
    if len(rows) > rows.shape[1]:
        rows = linalg.qr(rows, mode="r", check_finite=False)[0][: rows.shape[1]]
    _, singular, vectors = np.linalg.svd(rows, full_matrices=True)
    eigenvalues = np.zeros(rows.shape[1])
    eigenvalues[: len(singular)] = singular**2
    return eigenvalues, orient(vectors.T)


def stacked_rows(gradients: np.ndarray, scales: np.ndarray | None, weights: np.ndarray | None) -> np.ndarray:
    """Rows (M p, d), the outputs of a point together, with rows^T rows the matrix of the active subspace."""
    count, d, p = gradients.shape
    scale = np.ones(p) if scales is None else 1.0 / np.sqrt(scales)
    weight = np.full(count, 1.0 / count) if weights is None else weights / weights.sum()
    return (gradients.transpose(0, 2, 1) * scale[:, None] * np.sqrt(weight)[:, None, None]).reshape(count * p, d)


def bootstrap_subspace(
    gradients: np.ndarray, size: int, largest: int, scales: np.ndarray | None = None, weights: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
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
    rows = stacked_rows(gradients, scales, weights)
    factors = np.repeat(factors, p, axis=1)
    eigenvalues = np.zeros((size, d))
    vectors = np.empty((size, d, largest))
    if len(rows) >= ROWS_FOR_CHOLESKY * d and count >= 2 * d:
        replicates = _triangular_replicates(rows, factors)
    else:
        replicates = _small_side_replicates(rows, factors, largest)
    for b, (singular, leading) in enumerate(replicates):
        eigenvalues[b, : len(singular)] = singular**2
        vectors[b] = leading[:, :largest]
    return counts, eigenvalues, vectors


def _triangular_replicates(rows, factors):
    """Singular values and right vectors of sqrt(factor) times the rows, for each row of factors: many more rows than
    inputs."""
    count, d = rows.shape
    whitened, triangle = linalg.qr(rows, mode="economic", check_finite=False)
    products = (whitened[:, :, None] * whitened[:, None, :]).reshape(count, d * d)
    block = max(1, 4_000_000 // (count * d))
    for start in range(0, len(factors), block):
        factor = factors[start : start + block]
        try:
            # The replicate is sqrt(D) Q R with Q^T D Q = L L^T well conditioned, so its singular values are
            # those of L^T R: no squaring of R, whose range of scales is the interesting one.
            lower = np.linalg.cholesky((factor @ products).reshape(-1, d, d))
            replicates = lower.transpose(0, 2, 1) @ triangle
        except np.linalg.LinAlgError:
            replicates = np.sqrt(factor)[:, :, None] * rows
        _, singular, right = np.linalg.svd(replicates, full_matrices=False)
        yield from zip(singular, right.transpose(0, 2, 1), strict=True)


def _small_side_replicates(rows, factors, largest):
    """Singular values and right vectors of sqrt(factor) times the rows, for each row of factors: few rows.

    A replicate has about 63 % of the rows, and what it spans lies in the span of all of them.
    """
    span = None
    if len(rows) < rows.shape[1]:
        span, triangle = linalg.qr(rows.T, mode="economic", check_finite=False)
        rows = np.ascontiguousarray(triangle.T)
    for factor in factors:
        drawn = factor > 0.0
        singular, right = small_side_svd(np.sqrt(factor[drawn])[:, None] * rows[drawn])
        missing = largest - right.shape[1]
        if span is not None:
            right = span @ right[:, :largest]
        if missing > 0:
            # Directions that the replicate leaves open: any that complete its own.
            right = np.hstack([right, linalg.qr(right)[0][:, right.shape[1] :]])
        yield singular, right


def small_side_svd(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values and right singular vectors by the eigenvectors of the Gram matrix of the smaller side.

    A symmetric matrix takes a fourth of the time of a singular value decomposition. Squaring loses what is small
    beside the largest, so that what it leaves uncertain is decomposed anew without the rest: the values are as exact
    as by a singular value decomposition.

    Parameters
    ----------
    matrix : ndarray (n, m)

    Returns
    -------
    singular : ndarray (k,)
        Decreasing and positive; k is at most min(n, m).
    right : ndarray (m, k)
        Orthonormal columns.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.subspaces.estimation import small_side_svd
    >>> singular, right = small_side_svd(np.array([[3.0, 0.0, 0.0], [0.0, 1e-9, 0.0]]))
    >>> singular.tolist(), np.abs(right).tolist()
    ([3.0, 1e-09], [[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]])
    """
    tall = len(matrix) > matrix.shape[1]
    rest = matrix.T if tall else matrix
    left, found = np.eye(len(rest)), np.empty((rest.shape[1], 0))
    values, lefts = [np.empty(0)], [np.empty((len(rest), 0))]
    while len(rest) and (scale := np.abs(rest).max()) > 0.0:
        rest = rest / scale
        turn = np.linalg.eigh(rest @ rest.T)[1][:, ::-1]
        rest = turn.T @ rest
        singular = np.sqrt(np.einsum("ij,ij->i", rest, rest))
        certain = singular >= CERTAIN_SHARE * singular[0]
        number = len(rest) if certain.all() else int(certain.argmin())
        values.append(scale * singular[:number])
        found = np.hstack([found, (rest[:number] / singular[:number, None]).T])
        if tall:
            lefts.append(left @ turn[:, :number])
            left = left @ turn[:, number:]
        rest = scale * rest[number:]
        rest -= (rest @ found) @ found.T
    # The left vectors of the transposed matrix are the right ones of a tall matrix.
    return np.concatenate(values), np.hstack(lefts) if tall else found


def bootstrap_distances(vectors: np.ndarray, replicates: np.ndarray) -> np.ndarray:
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


def quantile_bands(replicates: np.ndarray, level: float) -> np.ndarray:
    """Lower and upper quantiles over the first axis that hold the middle ``level``."""
    tail = 0.5 * (1.0 - level)
    return np.quantile(replicates, [tail, 1.0 - tail], axis=0)


def reflected_bands(estimate: np.ndarray, replicates: np.ndarray, level: float) -> tuple[np.ndarray, np.ndarray]:
    """Bootstrap bands of positive quantities: quantiles on the logarithmic scale, reflected at the estimate.

    Replicates lie off the estimate as the estimate lies off the truth: large eigenvalues are overestimated, small ones
    underestimated. The basic bootstrap interval takes that back (Davison and Hinkley, Bootstrap Methods and their
    Application, 1997, section 5.2); where the error is large the estimate itself may be outside.

    Parameters
    ----------
    estimate : ndarray (k,)
    replicates : ndarray (size, k)
    level : float

    Returns
    -------
    lower, upper : ndarray (k,)
        Plain quantiles if the lower one is below 1 % of the estimate.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.subspaces.estimation import reflected_bands
    >>> lower, upper = reflected_bands(np.array([1.0]), np.linspace(0.5, 4.5, 101)[:, None], 0.5)
    >>> lower.round(3).tolist(), upper.round(3).tolist()
    ([0.286], [0.667])
    """
    lower, upper = quantile_bands(replicates, level)
    possible = lower > LEAST_REFLECTED * estimate
    square = estimate**2
    return (
        np.where(possible, square / np.where(possible, upper, 1.0), lower),
        np.where(possible, square / np.where(possible, lower, 1.0), upper),
    )
