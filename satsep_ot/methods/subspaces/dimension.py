"""How many directions are active: several criteria on the same gradients."""

import math

import numpy as np
import openturns as ot

from satsep_ot.methods.polynomials.basis import PolynomialBasis
from satsep_ot.methods.polynomials.fit import fit_polynomial
from satsep_ot.methods.subspaces.estimation import estimate_subspace, stacked_rows
from satsep_ot.methods.subspaces.variables import surrogate_degree

# Candidates for the dimension are 0 to this: a surrogate of more active variables is no gain.
LARGEST_DIMENSION = 10
# What makes a gap: its least factor, and its least share of the widest one on the logarithmic scale. Chosen on the
# first group of spectra of tests/benchmarks/dimension_trial.py; the second group tests the choice.
LEAST_GAP = 1.8
LEAST_GAP_SHARE = 0.3
# Eigenvalues below this share of the largest are not worth a direction.
EIGENVALUE_FLOOR = 1e-4
ISOTROPY_REPLICATES = 200


def ladle_dimension(eigenvalues: np.ndarray, vectors: np.ndarray, replicates: np.ndarray) -> int:
    """Dimension by the ladle estimator of Luo and Li, Biometrika 103 (2016).

    The k that minimises the sum of the next eigenvalue and of the bootstrap variability
    ``1 - |det(W_k^T V_k)|`` of the first k vectors, each normalised by its sum over k (the latter plus 1).

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


def gap_dimension(
    gradients: np.ndarray,
    scales: np.ndarray | None = None,
    weights: np.ndarray | None = None,
    largest: int = LARGEST_DIMENSION,
    level: float = 0.95,
) -> int:
    """Dimension by the gaps of log eigenvalues that gradients without preferred directions do not show.

    The leading directions are taken away one after the other. What is left of each gradient is shortened to the
    median length where it is longer, so that a few steep points do not decide (points where nothing is left do not
    count for the median). The directions of an elliptical law stay the same: it is the Winsor function of Raymaekers
    and Rousseeuw, J. Multivar. Anal. 171 (2019). The k-th gap is then that between the two largest eigenvalues.

    The dimension is the last gap before ``largest`` + 1 that is at least a factor of 1.8, at least 0.3 of the widest
    one on the logarithmic scale, and wider than what resampling under isotropy explains: what is left of every
    gradient is turned at random, keeping its length, and the gap of such samples has the k-th gap beyond its quantile
    of the given level. Eigenvalues below 1e-4 of the largest count as equal. The idea comes from parallel analysis
    (Horn, Psychometrika 30, 1965), with the lengths of the actual gradients instead of normal data.

    Parameters
    ----------
    gradients, scales, weights
        As in :func:`~satsep_ot.methods.subspaces.estimation.estimate_subspace`.
    largest : int
        Largest dimension that is considered; no more than half of the points are either.
    level : float
        Quantile of the gaps under isotropy.

    Returns
    -------
    int
        0 where no direction stands out; 1 for a single input and for a single gradient, which cannot be tested.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.subspaces.dimension import gap_dimension
    >>> scales = np.array([1.0, 0.3, 0.01, 0.01, 0.01, 0.01])
    >>> gap_dimension((np.random.default_rng(0).standard_normal((40, 6)) * scales)[:, :, None])
    2
    """
    count, d, p = gradients.shape
    if not np.any(gradients):
        return 0
    if d == 1 or count == 1:
        return 1
    rows = stacked_rows(gradients, scales, None).reshape(count, p, d)
    share = np.ones(count) if weights is None else np.sqrt(weights)
    # A gradient (or its remainder) below this length counts as 0: the function does not vary there.
    negligible = math.sqrt(EIGENVALUE_FLOOR * (rows**2).sum() / count)
    gaps: list[float] = []
    remainders = []
    floor = 0.0
    for _ in range(min(largest, d - 1, count // 2)):
        remainder = _shortened(rows, share > 0.0, negligible) * share[:, None, None]
        # As many zeros as eigenvalues that the rows leave unresolved.
        _, singular, vectors = np.linalg.svd(remainder.reshape(count * p, -1), full_matrices=True)
        first, second = (np.r_[singular, 0.0][:2]) ** 2
        floor = max(floor, EIGENVALUE_FLOOR * first)
        if first <= floor and gaps:
            break
        gaps.append(math.log(first / max(second, floor)))
        remainders.append(remainder)
        rows = rows @ vectors[1:].T
    least = max(math.log(LEAST_GAP), LEAST_GAP_SHARE * max(gaps))
    generator = np.random.default_rng(ot.RandomGenerator.IntegerGenerate(2**31 - 1))
    for k in range(len(gaps), 0, -1):
        if gaps[k - 1] >= least and gaps[k - 1] > np.quantile(_isotropic_gaps(remainders[k - 1], generator), level):
            return k
    return 0


def _shortened(rows, used, negligible):
    """Rows (M, p, m) of each point, made shorter where they are longer than the median.

    The median is taken over the used points whose length is not negligible.
    """
    lengths = np.sqrt((rows**2).sum(axis=(1, 2)))
    measured = lengths[used & (lengths > negligible)]
    if not len(measured):
        return rows
    return rows * np.minimum(1.0, np.median(measured) / np.maximum(lengths, negligible))[:, None, None]


def _isotropic_gaps(rows, generator):
    """Log-gaps between the two largest eigenvalues when the rows (M, p, m) of each point are turned at random."""
    count, p, m = rows.shape
    left, singular, _ = np.linalg.svd(rows, full_matrices=False)
    shapes = left * singular[:, None, :]
    gaps = np.empty(ISOTROPY_REPLICATES)
    for b in range(len(gaps)):
        frames = generator.standard_normal((count, m, shapes.shape[2]))
        if p == 1:
            frames /= np.linalg.norm(frames, axis=1, keepdims=True)
        else:
            frames = np.linalg.qr(frames)[0]
        turned = (shapes @ frames.transpose(0, 2, 1)).reshape(count * p, m)
        gram = turned.T @ turned if len(turned) >= m else turned @ turned.T
        second, first = np.linalg.eigvalsh(gram)[-2:]
        gaps[b] = math.log(first / max(second, EIGENVALUE_FLOOR * first)) if first > 0.0 else 0.0
    return gaps


def energy_dimension(eigenvalues: np.ndarray, share: float = 0.99) -> int:
    """The smallest dimension whose eigenvalues make up this share of their sum.

    Examples
    --------
    >>> from satsep_ot.methods.subspaces.dimension import energy_dimension
    >>> energy_dimension([90.0, 9.5, 0.5])
    2
    """
    cumulated = np.cumsum(eigenvalues)
    if not cumulated[-1] > 0.0:
        return 0
    return int(np.argmax(cumulated >= share * cumulated[-1])) + 1


def cross_validated_dimension(
    points: np.ndarray,
    values: np.ndarray,
    gradients: np.ndarray,
    candidates: np.ndarray,
    scales: np.ndarray,
    weights: np.ndarray,
) -> int:
    """The smallest candidate whose nested cross-validated error is within a standard error of the best one.

    Parameters
    ----------
    points, values, gradients, scales, weights
        As in :func:`cross_validated_error`.
    candidates : sequence of int
        Dimensions to compare.
    """
    candidates = sorted(set(candidates))
    errors = [cross_validated_error(points, values, gradients, r, scales, weights) for r in candidates]
    best = min(errors, key=np.mean)
    # Paired differences: hard points are hard for all. The best candidate has none.
    excesses = [error - best for error in errors]
    close = [excess.mean() <= excess.std(ddof=1) / math.sqrt(len(excess)) for excess in excesses]
    return candidates[close.index(True)]


def cross_validated_error(
    points: np.ndarray,
    values: np.ndarray,
    gradients: np.ndarray,
    dimension: int,
    scales: np.ndarray,
    weights: np.ndarray,
    folds: int = 5,
) -> np.ndarray:
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
