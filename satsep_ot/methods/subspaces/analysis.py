"""All numbers of an active subspace, from gradients: spectrum, bootstrap, dimension, and what a reader should know."""

import dataclasses
import functools
import math
from typing import Any

import numpy as np

from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.common.units import output_units
from satsep_ot.methods.subspaces.dimension import (
    LARGEST_DIMENSION,
    cross_validated_dimension,
    energy_dimension,
    gap_dimension,
    ladle_dimension,
)
from satsep_ot.methods.subspaces.estimation import (
    bootstrap_distances,
    bootstrap_subspace,
    estimate_subspace,
    quantile_bands,
)
from satsep_ot.methods.subspaces.gradients import GradientSample

# Where no gap says how many directions matter, surrogates of 1 to this many variables are compared.
LARGEST_COMPARED = 5
# Squared gradient lengths have a heavy tail where their effective number is below this share of their number and below
# this number: exp(u) and steeper, not a square (a third of them count) and not a direction of a tenth of 300 points.
# Bootstrap bands miss the truth above them there (tests/benchmarks/interval_coverage.py).
HEAVY_SHARE, HEAVY_NUMBER = 0.2, 60.0


@dataclasses.dataclass(eq=False)
class SubspaceAnalysis:
    """What gradients say of a subspace; made by :func:`analyse_gradients`.

    Attributes
    ----------
    points : ndarray (M, d)
        In the standard space.
    values : ndarray (M, p)
    gradients : ndarray (M, d, p)
        Both, and what follows from them, in ``units``.
    weights : ndarray (M,) or None
    variances, scales : ndarray (p,)
        Variance of each output, and the divisor of its part of the matrix.
    eigenvalues : ndarray (d,)
    vectors : ndarray (d, d)
    resolved : int
        How many eigenvalues the gradients can resolve.
    counts : ndarray (size, M)
        How often each point was drawn in each bootstrap replicate.
    eigenvalueReplicates : ndarray (size, d)
    vectorReplicates : ndarray (size, d, k)
    distances : ndarray (size, k)
        Distance ||W W^T - V V^T||_2 of the replicates' subspaces of dimension 1 to k from the estimate.
    constant : bool
        Whether the gradients are 0 up to rounding and noise.
    choices : dict
        Dimension by each criterion, the one "chosen", and whether they "agree".
    dimension : int
    remarks : list of str
    evaluations, gradientCalls : int
        What the gradients have cost.
    step : float or None
        Of the differences, where there were any.
    noise : ndarray (p,) or None
        Of the outputs, where it was estimated.
    units : ndarray (p,) or None
        Of the outputs: powers of two; None for 1.
    """

    points: np.ndarray
    values: np.ndarray
    gradients: np.ndarray
    weights: np.ndarray | None
    variances: np.ndarray
    scales: np.ndarray
    eigenvalues: np.ndarray
    vectors: np.ndarray
    resolved: int
    counts: np.ndarray
    eigenvalueReplicates: np.ndarray
    vectorReplicates: np.ndarray
    distances: np.ndarray
    constant: bool
    choices: dict[str, Any]
    dimension: int
    remarks: list[str]
    evaluations: int = 0
    gradientCalls: int = 0
    step: float | None = None
    noise: np.ndarray | None = None
    units: np.ndarray | None = None

    @property
    def reduced(self) -> bool:
        """Whether fewer directions than inputs were found or asked for."""
        return self.dimension < len(self.eigenvalues)

    @functools.cached_property
    def effective_gradients(self) -> float:
        """How many gradients decide: the squared sum of their squared lengths over the sum of the squares of these."""
        lengths = ((self.gradients**2) / self.scales).sum(axis=(1, 2))
        if self.weights is not None:
            lengths = lengths * (self.weights / self.weights.max())
        largest = lengths.max()
        if not largest > 0.0:
            return float(len(lengths))
        shares = lengths / largest
        return float(shares.sum() ** 2 / (shares**2).sum())

    @property
    def heavy_tailed(self) -> bool:
        """Whether few long gradients decide the eigenvalues, so that nothing bounds them from above."""
        used = len(self.gradients) if self.weights is None else np.count_nonzero(self.weights)
        return bool(used > 1 and self.effective_gradients < min(HEAVY_SHARE * used, HEAVY_NUMBER))

    @property
    def upper_distance(self) -> float:
        """Upper 95 % band of the distance between the active subspace and its replicates."""
        if self.dimension == 0 or self.choices["gap"] is None:
            return 1.0
        return float(quantile_bands(self.distances, 0.95)[1][self.dimension - 1])


@singleThread()
def analyse_gradients(
    sample: GradientSample,
    bootstrap_size: int,
    dimension: int | None = None,
    gradient_noise: float | np.ndarray = 0.0,
) -> SubspaceAnalysis:
    """Estimate the subspace, its errors and its dimension.

    Parameters
    ----------
    sample : GradientSample
    bootstrap_size : int
    dimension : int, optional
        The one to take; by default it is chosen.
    gradient_noise : float or ndarray (p,)
        Standard deviation of the noise in each component of a gradient; 0 where it is exact.

    Raises
    ------
    ValueError
        A dimension is asked of a constant function.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.subspaces.analysis import analyse_gradients
    >>> from satsep_ot.methods.subspaces.gradients import GradientSample
    >>> points = np.random.default_rng(0).standard_normal((50, 2))
    >>> sample = GradientSample.of(points, points[:, 0] ** 2, 2.0 * points * [1.0, 0.0])
    >>> analysis = analyse_gradients(sample, bootstrap_size=100)
    >>> analysis.dimension, analysis.vectors[:, 0].tolist()
    (1, [1.0, 0.0])
    """
    units = output_units(sample.values, sample.gradients)
    points, values, weights = sample.points, sample.values / units, sample.weights
    # In the order in which a file keeps them, so that sums over them are the same to the last bit.
    gradients = np.ascontiguousarray(sample.gradients / units)
    count, d, p = gradients.shape
    variances = np.cov(values.T, ddof=1).reshape(p, -1).diagonal() if count > 1 else np.zeros(p)
    # An output that does not vary has no gradient either: any scale leaves it out.
    scales = np.where(variances > 0.0, variances, 1.0) if p > 1 else np.ones(p)
    eigenvalues, vectors = estimate_subspace(gradients, scales, weights)
    # A dimension above half of the points is never determined by them.
    largest = max(1, min(d, LARGEST_DIMENSION, count // 2))
    counts, eigenvalueReplicates, vectorReplicates = bootstrap_subspace(
        gradients, bootstrap_size, max(largest, dimension or 0), scales, weights
    )
    # A change that the outputs cannot show, and the largest eigenvalue of pure noise in the gradients.
    rounding = np.finfo(float).eps * np.abs(values).max(axis=0) / np.sqrt(scales)
    edge = 2.0 * (1.0 + math.sqrt(d / count)) * gradient_noise / units / np.sqrt(scales)
    analysis = SubspaceAnalysis(
        points=points,
        values=values,
        gradients=gradients,
        weights=weights,
        variances=variances,
        scales=scales,
        eigenvalues=eigenvalues,
        vectors=vectors,
        resolved=min(count * p, d),
        counts=counts,
        eigenvalueReplicates=eigenvalueReplicates,
        vectorReplicates=vectorReplicates,
        distances=bootstrap_distances(vectors, vectorReplicates),
        constant=not eigenvalues[0] > max((rounding**2).max(), (edge**2).sum()),
        choices={},
        dimension=0,
        remarks=_remarks(values, gradients, units),
        units=None if np.all(units == 1.0) else units,
    )
    analysis.choices = _choices(analysis, largest)
    if dimension is not None and analysis.constant:
        raise ValueError(f"Dimension {dimension} was asked for, but the function is constant: all gradients are 0.")
    analysis.dimension = analysis.choices["chosen"] if dimension is None else dimension
    if analysis.heavy_tailed:
        analysis.remarks.append(
            f"the gradients have a heavy tail: about {analysis.effective_gradients:.0f} of {count} decide the "
            "eigenvalues; upper bounds of eigenvalues, scores and error bound are not known; take more gradients, or a "
            "smoother scale of the output such as its logarithm"
        )
    if analysis.choices["gap"] is None:
        analysis.remarks.append(_noReduction(analysis))
    elif not analysis.choices["agree"]:
        analysis.remarks.append(_disagreement(analysis.choices))
    return analysis


def _remarks(values, gradients, units):
    """What a reader should know of the gradients."""
    count, d, p = gradients.shape
    remarks = []
    if count * p < d:
        remarks.append(
            f"{count} gradients of {p} output(s) resolve {count * p} of {d} eigenvalues: the others are "
            "reported as 0 and the error bound does not see them."
        )
    if p == 1 and units[0] != 1.0:
        remarks.append(
            "the squares of outputs of this size cannot be represented: eigenvalues, scores and derivative-based "
            f"indices are in units of the square of {units[0]:.6g}"
        )
    flat = flat_outputs(values, gradients)
    if flat.any():
        remarks.append(
            f"all gradients of output(s) {', '.join(map(str, np.flatnonzero(flat)))} are 0, though the values "
            "vary: they are wrong, or these outputs are steps; take differences (setGradientMethod) or another unit."
        )
    return remarks


def flat_outputs(values: np.ndarray, gradients: np.ndarray) -> np.ndarray:
    """Whether the values (M, p) of each output vary, but all of its gradients (M, d, p) are 0: ndarray of bool (p,)."""
    return (gradients == 0.0).all(axis=(0, 1)) & (np.ptp(values, axis=0) > 1e-9 * np.abs(values).max(axis=0))


def _choices(analysis, largest):
    """Dimension by each criterion; where they disagree and the points suffice, by cross-validation too."""
    names = ("gap", "ladle", "energy")
    if analysis.constant:
        return dict.fromkeys((*names, "chosen"), 0) | {"agree": True}
    # 0 of these criteria means that no direction stands out.
    gap = gap_dimension(analysis.gradients, analysis.scales, analysis.weights, largest) or None
    ladle = ladle_dimension(analysis.eigenvalues, analysis.vectors, analysis.vectorReplicates[:, :, :largest]) or None
    choices: dict[str, Any] = dict(zip(names, (gap, ladle, energy_dimension(analysis.eigenvalues)), strict=True))
    choices["chosen"] = gap or len(analysis.eigenvalues)
    choices["agree"] = len({gap, ladle, choices["energy"]}) == 1
    if choices["agree"]:
        return choices
    # A surrogate needs points: three for each coefficient of its linear part.
    candidates = [r for r in {gap, ladle, choices["energy"]} - {None} if r <= largest]
    if gap is None:
        candidates = list(range(1, min(largest, LARGEST_COMPARED) + 1))
    candidates = [r for r in candidates if len(analysis.points) >= 3 * (r + 2)]
    if len(candidates) > 1:
        scales = np.where(analysis.variances > 0.0, analysis.variances, 1.0)
        choices["crossValidation"] = cross_validated_dimension(
            analysis.points, analysis.values, analysis.gradients, candidates, scales, analysis.weights
        )
    return choices


def _noReduction(analysis):
    choices, d = analysis.choices, len(analysis.eigenvalues)
    best = choices.get("crossValidation")
    return (
        f"no reduction found: no gap separates the eigenvalues, so all {d} directions count"
        + ("" if best is None else f"; a polynomial predicts as well in {best} of them, by cross-validation")
        + ("" if analysis.dimension == d else f"; the dimension {analysis.dimension} was asked for")
    )


def _disagreement(choices):
    return (
        f"The criteria for the dimension disagree: separated log-gap {choices['gap']}, "
        f"ladle {'none' if choices['ladle'] is None else choices['ladle']}, "
        f"99 % of the energy {choices['energy']}"
        + (f", cross-validation {choices['crossValidation']}" if "crossValidation" in choices else "")
        + f"; the log-gap's {choices['gap']} is taken."
    )
