"""How probable it is that a quantity lies beyond a limit, for every limit: from a Monte Carlo sample, with a band."""

from collections.abc import Iterable

import numpy as np

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.studies.telling.results import Exceedance, QuantityValues, RequirementEntry, main_quantities

_POINTS = 48
# A quantity that varies by less than this part of its size has no curve.
_SMALLEST_SPREAD = 1e-9


def exceedance_curve(values: np.ndarray, is_maximum: bool = True) -> Exceedance | None:
    """The probability that a quantity is above a limit, or below it, against the limit.

    Parameters
    ----------
    values : array_like, shape (n,)
        Of a Monte Carlo sample.
    is_maximum : bool
        Whether values above the limit count, or those below.

    Returns
    -------
    curve : Exceedance, or None
        At limits between which the number of the runs beyond changes by the same factor, from all to 1. The bounds at
        each limit are those of Clopper and Pearson at 95 %. None where the values do not vary.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.studies.exceedance import exceedance_curve
    >>> curve = exceedance_curve(np.random.default_rng(0).standard_normal(100_000))
    >>> print(f"{np.interp(1.6449, curve.limits, curve.probabilities):.2f}")
    0.05
    """
    ordered = np.sort(np.asarray(values, dtype=float))
    size = len(ordered)
    if not size or not np.isfinite(ordered).all():
        return None
    if ordered[-1] - ordered[0] <= _SMALLEST_SPREAD * np.abs(ordered[[0, -1]]).max():
        return None
    # Beyond the limit lie exactly so many runs.
    counts = np.unique(np.r_[np.linspace(0.5 * size, size - 1, 12), np.geomspace(1, 0.5 * size, _POINTS)].astype(int))
    limits = ordered[size - 1 - counts] if is_maximum else ordered[counts]
    bounds = np.array([clopperPearson(int(count), size) for count in counts])
    order = np.argsort(limits, kind="stable")
    return Exceedance(
        is_maximum, *(tuple(column[order].tolist()) for column in (limits, counts / size, bounds[:, 0], bounds[:, 1]))
    )


def exceedance_curves(
    sample: np.ndarray, quantities: dict[str, QuantityValues], requirements: Iterable[RequirementEntry]
) -> dict[str, Exceedance]:
    """A curve of each main quantity that varies, on the side that its requirement limits.

    Parameters
    ----------
    sample : ndarray, shape (n, q)
        Of all quantities, in their order.
    quantities : dict of str to QuantityValues
    requirements : sequence of RequirementEntry

    Returns
    -------
    curves : dict of str to Exceedance
        By quantity, those with a requirement first.
    """
    below = {entry.quantity for entry in requirements if not entry.is_maximum}
    limited = [entry.quantity for entry in requirements]
    names = dict.fromkeys([*limited, *main_quantities(quantities)])
    places = {name: column for column, name in enumerate(quantities)}
    curves = {name: exceedance_curve(sample[:, places[name]], name not in below) for name in names}
    return {name: curve for name, curve in curves.items() if curve is not None}
