"""Densities of quantities: true runs, the surrogate, and the limit."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import ArrayLike
from scipy.fft import dct, idct

from satsep_ot.studies.telling.figures.axes import (
    BLACK,
    BLUE,
    FONT_SIZE,
    GREY,
    ORANGE,
    grouped_unit,
    label_axes,
    label_decades,
    make_axes,
    quantity_label,
)
from satsep_ot.studies.telling.results import Exceedance
from satsep_ot.studies.telling.words import probability_text


def sample_density(values: np.ndarray, size: int = 512) -> tuple[np.ndarray, np.ndarray]:
    """A kernel density of a large sample: Gaussian kernel of Silverman's width, by fast cosine transform.

    Parameters
    ----------
    values : array_like, shape (N,)
        At least two different finite numbers.
    size : int
        Points of the grid.

    Returns
    -------
    grid, density : ndarray, shape (size,)
        From the smallest to the largest value, reflected there, so that nothing leaks below 0 where nothing is. NaN
        where fewer than ten values lie under the kernel: that would be a drawing of single values. Silverman, *Density
        Estimation for Statistics and Data Analysis* (1986), equation 3.31 and sections 2.10 and 3.5.

    Raises
    ------
    ValueError
        If the sample has no spread or is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.studies.telling.figures import sample_density
    >>> grid, density = sample_density(np.random.default_rng(0).standard_normal(100_000))
    >>> print(f"{np.interp(0.0, grid, density):.1f}")
    0.4
    """
    values = np.asarray(values, dtype=float).reshape(-1)
    spread = values.std() if np.isfinite(values).all() and len(values) > 1 else 0.0
    if not spread > 0.0:
        raise ValueError(f"a density needs at least two different finite values; {len(values)} are given")
    quartiles = np.quantile(values, [0.25, 0.75])
    width = 0.9 * min(spread, (quartiles[1] - quartiles[0]) / 1.34 or spread) * len(values) ** -0.2
    fine = 16 * size
    counts, edges = np.histogram(values, bins=fine)
    length = edges[-1] - edges[0]
    damping = np.exp(-0.5 * (math.pi * np.arange(fine) * width / length) ** 2)
    density = idct(dct(counts * (fine / (len(values) * length))) * damping)
    grid = np.linspace(edges[0], edges[-1], size)
    density = np.interp(grid, 0.5 * (edges[1:] + edges[:-1]), density)
    density[density * len(values) * width * math.sqrt(2.0 * math.pi) < 10.0] = np.nan
    return grid, density


def draw_density(
    sample: ArrayLike,
    ax: Axes | None = None,
    density: tuple[np.ndarray, np.ndarray] | None = None,
    label: str = "",
    unit: str = "",
    limit: float | tuple[float, ...] | None = None,
    is_maximum: bool = True,
    probability: float | None = None,
    bins: int = 60,
) -> Axes:
    """Density of a quantity: a histogram of true runs beside the density by the surrogate, and the limit.

    Parameters
    ----------
    sample : array_like, shape (N,)
        A Monte Carlo sample of the quantity.
    ax : :class:`matplotlib.axes.Axes`, optional
    density : (grid, density) of arrays, optional
        By the surrogate.
    label, unit : str
        Of the quantity.
    limit : float or (float, float), optional
        Of the requirement: one, or the two ends of a range.
    is_maximum : bool
        Whether values above the limit violate the requirement, or those below; of a range, those outside, or inside.
    probability : float, optional
        Probability of violation; by default the share of the sample.
    bins : int
        Of the histogram.

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
        The density is on a logarithmic axis, since the limit lies where a linear one shows nothing.

    Raises
    ------
    ValueError
        If the sample has no finite spread.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.studies.telling.figures import draw_density, sample_density
    >>> sample = np.random.default_rng(0).standard_normal(10_000)
    >>> ax = draw_density(sample, density=sample_density(sample), label="spin", unit="deg/s", limit=3.0)
    >>> ax.get_ylabel()
    'probability density [1/(deg/s)]'
    """
    ax = make_axes(ax)
    sample = np.asarray(sample, dtype=float).reshape(-1)
    if not (len(sample) > 1 and np.isfinite(sample).all() and np.ptp(sample) > 0.0):
        raise ValueError(f"a density needs at least two different finite values; {len(sample)} are given")
    label_axes(
        ax,
        quantity_label(label, unit),
        f"probability density [1/{grouped_unit(unit)}]" if unit else "probability density",
    )
    heights, edges = np.histogram(sample, bins=bins, density=True)
    ax.set_yscale("log")
    label_decades(ax.yaxis)
    # A floor under the sparsest bin, so that its top is seen.
    floor = 0.3 * heights[heights > 0.0].min()
    ax.stairs(heights, edges, baseline=floor, fill=True, color=GREY, label=f"{len(sample):,} true runs")
    top = heights.max()
    low, high = edges[0], edges[-1]
    if density is not None:
        grid, values = (np.asarray(column, dtype=float) for column in density)
        shown = (values > floor) & (grid > low - 0.3 * (high - low)) & (grid < high + 0.3 * (high - low))
        # Gaps stay gaps: a line across them would be invented.
        ax.plot(grid, np.where(shown, values, np.nan), "-", color=BLACK, linewidth=1.5, label="surrogate")
        if shown.any():
            top = max(top, values[shown].max())
            low, high = min(low, grid[shown].min()), max(high, grid[shown].max())
    margin = 0.04 * (high - low)
    low, high = low - margin, high + margin
    if limit is not None:
        ends = np.atleast_1d(limit)
        low, high = min(low, ends[0] - 3.0 * margin), max(high, ends[-1] + 3.0 * margin)
        outside = [(low, ends[0]), (ends[-1], high)]
        violated = (
            [tuple(ends)]
            if len(ends) > 1 and not is_maximum
            else outside
            if len(ends) > 1
            else outside[is_maximum:][:1]
        )
        if probability is None:
            probability = float(sum(np.mean((sample > start) & (sample < end)) for start, end in violated))
        for place, end in enumerate(ends):
            label = f"limit {', '.join(f'{end:g}' for end in ends)}" if place == 0 else None
            ax.axvline(end, color=ORANGE, linestyle="--", label=label)
        for place, span in enumerate(violated):
            label = f"violated: {probability_text(probability, 2)}" if place == 0 else None
            ax.axvspan(*span, facecolor="none", edgecolor=ORANGE, alpha=0.5, hatch="//", linewidth=0, label=label)
    ax.set_xlim(low, high)
    # Numbers with more zeros would run into each other.
    ax.ticklabel_format(axis="x", scilimits=(-4, 6))
    # Space above the curves for the legend.
    ax.set_ylim(floor, top * (top / floor) ** 0.55)
    ax.legend(fontsize=FONT_SIZE, loc="upper center", ncols=2, columnspacing=1.0, handlelength=1.6, framealpha=1.0)
    return ax


def draw_exceedance(
    curve: Exceedance,
    ax: Axes | None = None,
    label: str = "",
    unit: str = "",
    limits: Sequence[float] = (),
    allowed: float | None = None,
) -> Axes:
    """The probability that a quantity lies beyond a limit, against the limit, with its 95 % band.

    Parameters
    ----------
    curve : Exceedance
    ax : :class:`matplotlib.axes.Axes`, optional
    label, unit : str
        Of the quantity.
    limits : sequence of float
        Of requirements on the quantity.
    allowed : float, optional
        Their allowed probability.

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.studies.exceedance import exceedance_curve
    >>> from satsep_ot.studies.telling.figures import draw_exceedance
    >>> curve = exceedance_curve(np.random.default_rng(0).standard_normal(1000))
    >>> draw_exceedance(curve, label="spin", unit="deg/s").get_ylabel()
    'probability of more'
    """
    ax = make_axes(ax)
    side = "more" if curve.is_maximum else "less"
    label_axes(ax, quantity_label(label, unit), f"probability of {side}")
    ax.set_yscale("log")
    label_decades(ax.yaxis)
    ax.fill_between(curve.limits, curve.lower95, curve.upper95, color=GREY, alpha=0.7, linewidth=0, label="95 % band")
    ax.plot(curve.limits, curve.probabilities, "-", color=BLACK, linewidth=1.5, label="share of the runs")
    for limit in limits:
        ax.axvline(limit, color=ORANGE, linestyle="--", label=f"limit {limit:g}")
    if allowed is not None:
        ax.axhline(allowed, color=BLUE, linestyle=":", label=f"allowed {probability_text(allowed)}")
    ax.set_ylim(0.5 * min(curve.probabilities), 2.0)
    ax.ticklabel_format(axis="x", scilimits=(-4, 6))
    ax.legend(fontsize=FONT_SIZE - 1, loc="lower left" if curve.is_maximum else "lower right")
    return ax
