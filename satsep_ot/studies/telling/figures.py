"""Figures of a study. Nothing here shows itself, loads pyplot or changes a global setting.

A panel draws into the axes given, or into those of a new figure, and returns the axes:

* ``draw_eigenvalues(result, ax=None, label="", unit="", level=0.95, largest=10)``
* ``draw_sufficient_summary(active, values, regression, ax=None, label="", unit="", level=0.95)``
* ``draw_density(sample, ax=None, density=None, label="", unit="", limit=None, is_maximum=True, probability=None)``
* ``draw_probabilities(rows, ax=None, title="")``, ``draw_answer(row, allowed=None, ax=None)``
* ``draw_shares(shares, ax=None, title="", largest=8, label="share")``
* ``draw_separation_velocity(motion, ax=None)``, ``draw_rates(motion, ax=None)``, ``draw_strokes(motion, ax=None)``

A figure puts panels of one kind together and is returned; ``save_figure(figure, path)`` writes it:

* ``eigenvalues_figure(results, units)``: dicts by component
* ``sufficient_summary_figure(summaries, units)``: summaries[component] = (active, values, regression)
* ``density_figure(densities)``: densities[label] = dict of the arguments of ``draw_density``
* ``probabilities_figure(rows, titles=None)``: rows as in results.json; titles[requirement] = text of its panel
* ``separation_figure(separation, parameters=None, end=None)``: simulates one run

``motion`` is what ``compute_motion(separation, parameters=None, end=None)`` returns; ``sample_density(values)`` gives
the ``density`` of a large sample of a surrogate. Lines differ by style and marker, not by colour alone, and letters
are at least 11 points high, so that a figure can be read in grey and from the back of a room.
"""

import math
import os
from collections.abc import Sequence
from typing import NamedTuple

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter
from numpy.typing import ArrayLike
from scipy.fft import dct, idct

from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.separation import Separation, Status
from satsep_ot.dynamics.simulation import trajectory
from satsep_ot.dynamics.springs import ForceLaw, ForceLine
from satsep_ot.methods.polynomials.regression_result import MultivariatePolynomialRegressionResult
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult
from satsep_ot.model.run_document import spring_names

FONT_SIZE = 11
DOTS_PER_INCH = 150
PANEL_SIZE = (5.2, 3.9)  # inches
BLACK, GREY, BLUE, ORANGE = "#000000", "#b5b5b5", "#1f5f9f", "#c85a00"
STYLES = ("-", "--", "-.", ":")
COLOURS = (BLACK, BLUE, ORANGE, "#5a5a5a")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")


def _axes(ax, size=PANEL_SIZE):
    return Figure(figsize=size, layout="constrained").add_subplot() if ax is None else ax


def _dress(ax, horizontal, vertical, title=""):
    """Labels, ticks and title in readable sizes; rcParams stay as they are."""
    ax.set_xlabel(horizontal, fontsize=FONT_SIZE)
    ax.set_ylabel(vertical, fontsize=FONT_SIZE)
    if title:
        ax.set_title(title, fontsize=FONT_SIZE + 1)
    ax.tick_params(which="both", labelsize=FONT_SIZE)
    ax.grid(True, color="0.88", linewidth=0.8)
    ax.set_axisbelow(True)
    return ax


def _label(name, unit):
    name = name.replace("_", " ")
    return f"{name} [{unit}]" if unit else name


def _grouped(unit):
    return f"({unit})" if "/" in unit else unit


def _panels(count, columns=None, size=PANEL_SIZE):
    """A figure with `count` panels and their axes, row by row; no empty panel is left."""
    if count < 1:
        raise ValueError("a figure needs at least one panel, and there is nothing to draw")
    columns = columns or (count if count < 4 else 2 if count == 4 else 3)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
    return figure, [figure.add_subplot(rows, columns, k + 1) for k in range(count)]


def save_figure(figure: Figure, path: str | os.PathLike, form: str | None = None) -> None:
    """Write a figure.

    Parameters
    ----------
    figure : :class:`matplotlib.figure.Figure`
    path : str, path or binary stream
    form : str, optional
        "png", "svg" or "pdf"; by default what the path ends on.
    """
    # Names inside an SVG follow from its content, and nothing in it from the day: the same study, the same file.
    with matplotlib.rc_context({"svg.hashsalt": "satsep-ot"}):
        metadata = {"Date": None} if form == "svg" or str(path).endswith(".svg") else None
        figure.savefig(path, dpi=DOTS_PER_INCH, metadata=metadata, format=form)


# Active subspaces. --------------------------------------------------------------------------------------------------


def draw_eigenvalues(
    result: ActiveSubspaceResult,
    ax: Axes | None = None,
    label: str = "",
    unit: str = "",
    level: float = 0.95,
    largest: int = 10,
) -> Axes:
    """Eigenvalues of an active subspace with their bootstrap bands, on a logarithmic axis.

    Parameters
    ----------
    result : :class:`satsep_ot.methods.subspaces.algorithm.ActiveSubspaceResult`
    ax : :class:`matplotlib.axes.Axes`, optional
    label, unit : str
        The output, and its unit.
    level : float
        Of the bands.
    largest : int
        How many eigenvalues are drawn at most.

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
    >>> from satsep_ot.studies.telling.figures import draw_eigenvalues
    >>> function = ot.SymbolicFunction(["a", "b"], ["exp(0.3 * a + 0.4 * b) + 0.01 * a^2"])
    >>> algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(2))
    >>> algorithm.run()
    >>> draw_eigenvalues(algorithm.getResult(), label="g").get_xlabel()
    'index of the eigenvalue'
    """
    ax = _axes(ax)
    values = np.array(result.getEigenvalues())
    interval = result.getEigenvaluesInterval(level)
    lower, upper = np.array(interval.getLowerBound()), np.array(interval.getUpperBound())
    # A logarithmic axis has no place for the zeros of a constant function and of directions without gradients.
    count = min(largest, int((values > 0.0).sum()))
    squared = f" [{_grouped(unit)}²]" if unit else ""
    _dress(ax, "index of the eigenvalue", f"eigenvalue{squared}", label.replace("_", " "))
    if count == 0:
        ax.text(0.5, 0.5, "all eigenvalues are 0", transform=ax.transAxes, ha="center", fontsize=FONT_SIZE)
        return ax
    index = np.arange(1, count + 1)
    values, lower, upper = values[:count], lower[:count], upper[:count]
    ax.set_yscale("log")
    ax.fill_between(
        index, np.where(lower > 0.0, lower, values), upper, color=GREY, alpha=0.6, linewidth=0,
        label=f"{100.0 * level:g} % band",
    )  # fmt: skip
    ax.plot(index, values, "o-", color=BLACK, markersize=5, label="estimate")
    dimension = result.getDimension()
    if 0 < dimension < count:
        ax.axvline(dimension + 0.5, color=BLUE, linestyle="--", label=f"active dimension {dimension}")
    ax.set_xlim(0.7, count + 0.3)
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(fontsize=FONT_SIZE, loc="upper right")
    return ax


def eigenvalues_figure(results: dict[str, ActiveSubspaceResult], units: dict[str, str]) -> Figure:
    """One panel of `draw_eigenvalues` for each component.

    Parameters
    ----------
    results : dict of str to :class:`satsep_ot.methods.subspaces.algorithm.ActiveSubspaceResult`
    units : dict of str to str

    Returns
    -------
    figure : :class:`matplotlib.figure.Figure`

    Raises
    ------
    ValueError
        If there is no result.
    """
    figure, axes = _panels(len(results))
    for ax, (name, result) in zip(axes, results.items(), strict=True):
        draw_eigenvalues(result, ax, name, units.get(name, ""))
    return figure


def draw_sufficient_summary(
    active: ArrayLike,
    values: np.ndarray,
    regression: MultivariatePolynomialRegressionResult,
    ax: Axes | None = None,
    label: str = "",
    unit: str = "",
    level: float = 0.95,
) -> Axes:
    """An output against its active variables, with the polynomial regression on them.

    Parameters
    ----------
    active : array_like, shape (N, r)
        Active variables, r at least 1; the first two are drawn.
    values : array_like, shape (N,)
        True runs.
    regression : :class:`satsep_ot.methods.polynomials.regression_result.MultivariatePolynomialRegressionResult`
        Of the first output on the r active variables.
    ax : :class:`matplotlib.axes.Axes`, optional
    label, unit : str
        Of the output.
    level : float
        Of the band in which a new run lies.

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
        One active variable: points, regression and band. More: the plane of the first two, with the regression's
        contours at 0 of the others.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
    >>> from satsep_ot.studies.telling.figures import draw_sufficient_summary
    >>> active = np.linspace(-2.0, 2.0, 30)[:, None]
    >>> regression = MultivariatePolynomialRegression(active, np.sin(active))
    >>> regression.run()
    >>> draw_sufficient_summary(active, np.sin(active[:, 0]), regression.getResult(), label="g", unit="m").get_ylabel()
    'g [m]'
    """
    ax = _axes(ax)
    active, values = np.asarray(active, dtype=float), np.asarray(values, dtype=float).reshape(-1)
    low, high = active.min(axis=0), active.max(axis=0)
    if active.shape[1] == 1:
        _dress(ax, "active variable [standard deviations]", _label(label, unit))
        grid = np.linspace(low, high, 201)
        lower, upper = regression.getPredictionInterval(grid, level)
        ax.fill_between(
            grid[:, 0], lower[:, 0], upper[:, 0], color=GREY, alpha=0.6, linewidth=0,
            label=f"{100.0 * level:g} % of new runs",
        )  # fmt: skip
        ax.plot(active[:, 0], values, "o", color=BLUE, markersize=3.5, alpha=0.7, label="true runs")
        ax.plot(grid[:, 0], regression.evaluate(grid)[:, 0], "-", color=BLACK, label=f"degree {regression.getDegree()}")
        ax.legend(fontsize=FONT_SIZE)
        return ax
    _dress(ax, "active variable 1 [standard deviations]", "active variable 2 [standard deviations]")
    # Beyond the points, so that none is cut by the frame.
    low, high = low - 0.04 * (high - low), high + 0.04 * (high - low)
    first, second = np.meshgrid(np.linspace(low[0], high[0], 61), np.linspace(low[1], high[1], 61))
    grid = np.zeros((first.size, active.shape[1]))
    grid[:, 0], grid[:, 1] = first.ravel(), second.ravel()
    contours = ax.contour(
        first, second, regression.evaluate(grid)[:, 0].reshape(first.shape), colors=BLACK, linewidths=1.0
    )
    ax.clabel(contours, fontsize=FONT_SIZE)
    points = ax.scatter(active[:, 0], active[:, 1], c=values, s=14, cmap="cividis")
    bar = ax.figure.colorbar(points, ax=ax)
    bar.set_label(_label(label, unit), fontsize=FONT_SIZE)
    bar.ax.tick_params(labelsize=FONT_SIZE)
    return ax


def sufficient_summary_figure(summaries: dict[str, tuple], units: dict[str, str]) -> Figure:
    """One panel of `draw_sufficient_summary` for each component.

    Parameters
    ----------
    summaries : dict of str to (active, values, regression)
    units : dict of str to str

    Returns
    -------
    figure : :class:`matplotlib.figure.Figure`

    Raises
    ------
    ValueError
        If there is no summary.
    """
    figure, axes = _panels(len(summaries))
    for ax, (name, (active, values, regression)) in zip(axes, summaries.items(), strict=True):
        draw_sufficient_summary(active, values, regression, ax, name, units.get(name, ""))
    return figure


# Distributions and probabilities. -----------------------------------------------------------------------------------


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
    limit: float | None = None,
    is_maximum: bool = True,
    probability: float | None = None,
    bins: int = 60,
) -> Axes:
    """Density of a quantity: a histogram of true runs beside the surrogate's law, and the limit.

    Parameters
    ----------
    sample : array_like, shape (N,)
        A Monte Carlo sample of the quantity.
    ax : :class:`matplotlib.axes.Axes`, optional
    density : (grid, density) of arrays, optional
        The law of the surrogate.
    label, unit : str
        Of the quantity.
    limit : float, optional
        Of the requirement.
    is_maximum : bool
        Whether values above the limit violate the requirement, or those below.
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
    ax = _axes(ax)
    sample = np.asarray(sample, dtype=float).reshape(-1)
    if not (len(sample) > 1 and np.isfinite(sample).all() and np.ptp(sample) > 0.0):
        raise ValueError(f"a density needs at least two different finite values; {len(sample)} are given")
    _dress(ax, _label(label, unit), f"probability density [1/{_grouped(unit)}]" if unit else "probability density")
    heights, edges = np.histogram(sample, bins=bins, density=True)
    ax.set_yscale("log")
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
        low, high = min(low, limit - 3.0 * margin), max(high, limit + 3.0 * margin)
        if probability is None:
            probability = float(np.mean(sample > limit if is_maximum else sample < limit))
        ax.axvline(limit, color=ORANGE, linestyle="--", label=f"limit {limit:g}")
        ax.axvspan(
            *((limit, high) if is_maximum else (low, limit)), facecolor="none", edgecolor=ORANGE, alpha=0.5,
            hatch="//", linewidth=0, label=f"violated: {_short(probability)}",
        )  # fmt: skip
    ax.set_xlim(low, high)
    # Numbers with more zeros would run into each other.
    ax.ticklabel_format(axis="x", scilimits=(-4, 6))
    # Room above the curves for the legend.
    ax.set_ylim(floor, top * (top / floor) ** 0.55)
    ax.legend(fontsize=FONT_SIZE, loc="upper center", ncols=2, columnspacing=1.0, handlelength=1.6, framealpha=1.0)
    return ax


def density_figure(densities: dict[str, dict]) -> Figure:
    """One panel of `draw_density` for each quantity.

    Parameters
    ----------
    densities : dict of str to dict
        By label, the other arguments of `draw_density`; `sample` must be among them.

    Returns
    -------
    figure : :class:`matplotlib.figure.Figure`

    Raises
    ------
    ValueError
        If there is none.
    """
    figure, axes = _panels(len(densities))
    for ax, (name, arguments) in zip(axes, densities.items(), strict=True):
        draw_density(ax=ax, label=name, **arguments)
    return figure


def _short(probability, digits=2):
    """A probability in few characters: 0.12, 2.4e-4."""
    if probability >= 0.01 or probability == 0.0:
        return f"{probability:.{digits}g}"
    return f"{probability:.{digits - 1}e}".replace("e-0", "e-")


def _runs(row):
    """The cost of a row in words, a line each for evaluations and gradients; nothing where it is not known."""
    if row["evaluations"] is None:
        return ""
    text = f"{row['evaluations']:,} runs"
    return f"{text}\n{row['gradients']:,} gradients" if row.get("gradients") else text


def draw_probabilities(rows: Sequence[dict], ax: Axes | None = None, title: str = "") -> Axes:
    """Probabilities of one event by method, with 95 % intervals where the method has one, and the runs it took.

    Parameters
    ----------
    rows : sequence of dict
        With the keys "method", "probability" (None where there is none to draw), "lower95", "upper95" (None for FORM
        and SORM, which have no interval), "evaluations" (None where nobody knows them), and perhaps "gradients",
        "converged" and "message", which stands where there is no probability.
    ax : :class:`matplotlib.axes.Axes`, optional
    title : str

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
        A hollow marker: not converged. An arrow to the left: the interval begins at 0.

    Raises
    ------
    ValueError
        If there are no rows.

    Examples
    --------
    >>> from satsep_ot.studies.telling.figures import draw_probabilities
    >>> rows = [
    ...     {"method": "FORM", "probability": 1e-4, "lower95": None, "upper95": None, "evaluations": 30},
    ...     {"method": "MonteCarlo", "probability": 2e-4, "lower95": 1e-4, "upper95": 4e-4, "evaluations": 100_000},
    ... ]
    >>> [label.get_text() for label in draw_probabilities(rows).get_yticklabels()]
    ['FORM', 'MonteCarlo']
    """
    if not rows:
        raise ValueError("there are no rows to draw the probabilities of")
    ax = _axes(ax, (6.6, 1.4 + 0.5 * len(rows)))
    _dress(ax, "probability of violation", "", title)
    ax.set_xscale("log")
    low, high = _probability_range(rows)
    ax.set_xlim(low, high)
    _probability_ticks(ax, low, high)
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_yticks(range(len(rows)), [row["method"] for row in rows])
    ax.tick_params(axis="y", length=0)
    for place, row in enumerate(rows):
        # The cost beside the axes, in the row of its method.
        ax.text(1.02, place, _runs(row), transform=ax.get_yaxis_transform(), va="center", fontsize=FONT_SIZE)
        colour, marker = COLOURS[place % len(COLOURS)], MARKERS[place % len(MARKERS)]
        face = colour if row.get("converged", True) else "white"
        probability, lower, upper = row["probability"], row.get("lower95"), row.get("upper95")
        if probability is None or not math.isfinite(probability):
            ax.text(0.5, place, row.get("message", "no result"), transform=ax.get_yaxis_transform(), ha="center",
                    va="center", fontsize=FONT_SIZE)  # fmt: skip
            continue
        if lower is not None and upper is not None:
            start = max(lower, low)
            ax.plot([start, upper], [place, place], "-", color=colour, linewidth=2.0)
            ax.plot([upper], [place], "|", color=colour, markersize=11, markeredgewidth=2.0)
            # An interval that begins at 0 leaves the axis.
            ax.plot([start], [place], "|" if lower >= low else "<", color=colour, markersize=11 if lower >= low else 8,
                    markeredgewidth=2.0, clip_on=False)  # fmt: skip
        if probability >= low:
            ax.plot([probability], [place], marker, color=colour, markerfacecolor=face, markersize=8,
                    markeredgewidth=1.8)  # fmt: skip
        elif upper is None:
            ax.text(0.03, place, f"< {_short(low)}", transform=ax.get_yaxis_transform(), va="center",
                    fontsize=FONT_SIZE)  # fmt: skip
    return ax


def draw_answer(row: dict, allowed: float | None = None, ax: Axes | None = None) -> Axes:
    """One probability with its 95 % interval, beside the allowed one.

    Parameters
    ----------
    row : dict
        As for `draw_probabilities`, with a probability and an interval.
    allowed : float, optional
        The allowed probability.
    ax : :class:`matplotlib.axes.Axes`, optional

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
        Everything above the allowed probability is hatched.

    Examples
    --------
    >>> from satsep_ot.studies.telling.figures import draw_answer
    >>> row = {"method": "MonteCarlo", "probability": 2e-4, "lower95": 1e-4, "upper95": 4e-4}
    >>> draw_answer(row, 1e-3).get_xlabel()
    'probability of violation'
    """
    ax = _axes(ax, (5.2, 1.7))
    _dress(ax, "probability of violation", "")
    low, high = _probability_range([row, {"probability": allowed}])
    ax.set_xscale("log")
    ax.set_xlim(low, high)
    ax.set_ylim(-1.0, 1.4)
    _probability_ticks(ax, low, high)
    ax.set_yticks([])
    start = max(row["lower95"], low)
    ax.plot([start, row["upper95"]], [0.0, 0.0], "-", color=BLACK, linewidth=3.0, label="95 % interval")
    ax.plot([start, row["upper95"]], [0.0, 0.0], "|", color=BLACK, markersize=14, markeredgewidth=2.0)
    if row["probability"] >= low:
        ax.plot([row["probability"]], [0.0], "o", color=BLACK, markersize=9, label="estimate")
    if allowed is not None:
        ax.axvspan(allowed, high, facecolor="none", edgecolor=ORANGE, alpha=0.5, hatch="//", linewidth=0)
        ax.axvline(allowed, color=ORANGE, linestyle="--", linewidth=2.0, label=f"allowed {allowed:g}")
    ax.legend(fontsize=FONT_SIZE, loc="upper center", ncols=3, columnspacing=1.0, handlelength=1.6, framealpha=1.0)
    return ax


def draw_shares(
    shares: dict[str, float], ax: Axes | None = None, title: str = "", largest: int = 8, label: str = "share"
) -> Axes:
    """Shares as horizontal bars, the largest at the top, what is left over in one bar.

    Parameters
    ----------
    shares : dict of str to float
        By name, the largest first; they sum to 1.
    ax : :class:`matplotlib.axes.Axes`, optional
    title : str
    largest : int
        How many have bars of their own.
    label : str
        What they are shares of.

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`

    Raises
    ------
    ValueError
        If there are none.

    Examples
    --------
    >>> from satsep_ot.studies.telling.figures import draw_shares
    >>> [label.get_text() for label in draw_shares({"mass": 0.75, "stroke": 0.25}).get_yticklabels()]
    ['mass', 'stroke']
    """
    if not shares:
        raise ValueError("there are no shares to draw")
    # A bar that cannot be seen tells nothing.
    bars = {name: share for name, share in list(shares.items())[:largest] if share >= 5e-4}
    rest = list(shares.values())[len(bars) :]
    if rest:
        bars[f"{len(rest)} others"] = sum(rest)
    ax = _axes(ax, (PANEL_SIZE[0], 1.2 + 0.3 * len(bars)))
    _dress(ax, f"{label} [%]", "", title)
    places = range(len(bars))
    ax.barh(places, [100.0 * share for share in bars.values()], color=GREY, edgecolor=BLACK, linewidth=1.0)
    for place, share in zip(places, bars.values(), strict=True):
        ax.text(100.0 * share, place, f" {100.0 * share:.1f}", va="center", fontsize=FONT_SIZE)
    ax.set_xlim(0.0, 115.0 * max(bars.values()))
    ax.set_yticks(places, [name.replace("_", " ") for name in bars])
    ax.set_ylim(len(bars) - 0.4, -0.6)
    ax.tick_params(axis="y", length=0)
    return ax


def _probability_ticks(ax, low, high):
    # Within a decade or two there may be no power of ten to label.
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 100.0 * low else (1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _short(value, 1)))
    ax.xaxis.set_minor_formatter(NullFormatter())


def _probability_range(rows):
    """Limits of a logarithmic axis that hold every number of the rows above 0, and half a decade at least."""
    numbers = [row.get(key) for row in rows for key in ("probability", "lower95", "upper95")]
    positive = [number for number in numbers if number is not None and math.isfinite(number) and number > 0.0]
    if not positive:
        return 1e-6, 1.0
    # A number far below all others would squeeze these into a corner.
    high = max(positive)
    low = max(min(positive), 1e-6 * high)
    return 10.0 ** (math.log10(low) - 0.3), 10.0 ** (math.log10(high) + 0.3)


def probabilities_figure(rows: Sequence[dict], titles: dict[str, str] | None = None) -> Figure:
    """One panel of `draw_probabilities` for each requirement, in the order of the rows.

    Parameters
    ----------
    rows : sequence of dict
        As for `draw_probabilities`, with the key "requirement" as well.
    titles : dict of str to str, optional
        Title of the panel of a requirement; by default its name.

    Returns
    -------
    figure : :class:`matplotlib.figure.Figure`

    Raises
    ------
    ValueError
        If there are no rows.
    """
    requirements = list(dict.fromkeys(row["requirement"] for row in rows))
    tallest = max((sum(row["requirement"] == name for row in rows) for name in requirements), default=0)
    figure, axes = _panels(len(requirements), min(len(requirements), 2), (7.2, 1.3 + 0.5 * tallest))
    for ax, name in zip(axes, requirements, strict=True):
        title = (titles or {}).get(name, name)
        draw_probabilities([row for row in rows if row["requirement"] == name], ax, title)
    return figure


# One separation over time. ------------------------------------------------------------------------------------------


class Motion(NamedTuple):
    """One run over time."""

    times: np.ndarray  # [s] (T,)
    gap: np.ndarray  # distance of the bodies' ring centres along the platform's y axis, 0 when stowed [m] (T,)
    velocity: np.ndarray  # axial separation velocity of the CGs [m/s] (T,)
    rates: np.ndarray  # body rates of the satellite [deg/s] (T, 3)
    strokes: np.ndarray  # of each spring while it pushes, NaN before and after [m] (T, N)
    release_times: np.ndarray  # [s] (N,); NaN for a spring that has failed
    release_strokes: np.ndarray  # [m] (N,)
    centres: np.ndarray  # satellite's ring centre from the platform's, in platform axes [m] (T, 3)
    attitudes: np.ndarray  # rotation matrices from satellite to platform axes (T, 3, 3)
    names: tuple  # of the springs, str (N,)
    pins: np.ndarray  # whether it is the pins of a connector, which hold back and do not push, bool (N,)


def compute_motion(
    separation: Separation, parameters: ArrayLike | None = None, end: float | None = None, size: int = 400
) -> Motion:
    """Simulate one run and read off what the figures over time show.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`
    parameters : array_like, shape (P,), optional
        The run; by default the nominal one.
    end : float, optional
        Until when [s]; by default half as long again as the last release.
    size : int
        Points in time, beside the releases.

    Returns
    -------
    motion : Motion

    Raises
    ------
    RuntimeError
        If the run fails; the message says how.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.telling.figures import compute_motion
    >>> motion = compute_motion(load_case("reference").separation)
    >>> print(f"{motion.velocity[-1]:.3f} m/s, {1e3 * motion.release_strokes[0]:.3f} mm")
    0.598 m/s, 30.000 mm
    """
    run = trajectory(separation, [0.0], parameters)
    if run.status != Status.OK:
        raise RuntimeError(f"the separation cannot be drawn: {run.status.sentence}")
    releases = run.release_times
    if end is None:
        end = 1.5 * np.nanmax(releases)
    times = np.unique(np.concatenate([np.linspace(0.0, end, size), releases[releases <= end]]))
    states = trajectory(separation, times, parameters).states
    vector = separation.parameters() if parameters is None else np.asarray(parameters, dtype=float)
    named = dict(zip(separation.parameter_names(), vector, strict=True))
    turns = np.array([rotation_matrix(quaternion) for quaternion in states[:, 12:16]])
    platform, satellite = (
        np.array([named[f"{body}.center_of_mass.{axis}"] for axis in "xyz"]) for body in ("platform", "satellite")
    )
    stowed, y = named["stowed_length"], np.array([0.0, 1.0, 0.0])
    # The satellite's ring centre from the platform's, in platform axes.
    centre = states[:, 0:3] - turns @ satellite + platform
    strokes = np.full((len(times), len(releases)), np.nan)
    for i, release in enumerate(releases):
        angle, radius, cant, delay = (named[f"springs[{i}].{name}"] for name in ("angle", "radius", "cant", "delay"))
        seat = radius * np.array([math.cos(angle), 0.0, math.sin(angle)])
        guide = np.array([-math.sin(cant) * math.sin(angle), math.cos(cant), math.sin(cant) * math.cos(angle)])
        # A stowed strut lies along its guide: its platform seat is recessed so.
        delta = centre + turns @ seat - (seat + stowed * (y - guide))
        if separation.force_line == ForceLine.GUIDED:
            along = delta @ guide
        elif separation.force_line == ForceLine.STRUT:
            along = np.linalg.norm(delta, axis=1) - stowed
        else:
            plate = turns[:, :, 1]
            along = np.sum(delta * plate, axis=1) / (plate @ guide)
        pushing = (times >= delay) & (times <= release)
        strokes[pushing, i] = along[pushing]
    return Motion(
        times=times,
        gap=centre[:, 1] - centre[0, 1],
        velocity=states[:, 4],
        rates=np.degrees(states[:, 9:12]),
        strokes=strokes,
        release_times=releases,
        # A spring that has failed never pushes.
        release_strokes=np.array([np.nanmax(column) if np.isfinite(column).any() else np.nan for column in strokes.T]),
        centres=centre,
        attitudes=turns,
        names=tuple(spring_names(separation)),
        pins=np.array([law == ForceLaw.FRICTION for law in separation.springs.laws]),
    )


def draw_separation_velocity(motion: Motion, ax: Axes | None = None) -> Axes:
    """Axial velocity and gap over time, the gap on an axis of its own at the right.

    Parameters
    ----------
    motion : Motion
    ax : :class:`matplotlib.axes.Axes`, optional

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
        That of the velocity.
    """
    ax = _axes(ax)
    _dress(ax, "time [ms]", "axial velocity [m/s]")
    lines = ax.plot(1e3 * motion.times, motion.velocity, "-", color=BLACK, label="velocity")
    other = ax.twinx()
    other.set_ylabel("axial gap [mm]", fontsize=FONT_SIZE)
    other.tick_params(labelsize=FONT_SIZE)
    lines += other.plot(1e3 * motion.times, 1e3 * motion.gap, "--", color=BLUE, label="gap")
    lines.append(_mark_releases(motion, ax))
    ax.set_ylim(bottom=0.0, top=1.15 * motion.velocity.max())
    other.set_ylim(bottom=0.0, top=1.15e3 * motion.gap.max())
    ax.legend(handles=lines, fontsize=FONT_SIZE, loc="lower right")
    return ax


def draw_rates(motion: Motion, ax: Axes | None = None) -> Axes:
    """Body rates of the satellite over time.

    Parameters
    ----------
    motion : Motion
    ax : :class:`matplotlib.axes.Axes`, optional

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
    """
    ax = _axes(ax)
    _dress(ax, "time [ms]", "satellite body rate [deg/s]")
    for k, axis in enumerate("xyz"):
        # Markers far apart tell lines that lie on each other.
        ax.plot(1e3 * motion.times, motion.rates[:, k], STYLES[k], color=COLOURS[k], marker=MARKERS[k], markersize=5,
                markevery=(20 * k, 60), label=f"about {axis}")  # fmt: skip
    _mark_releases(motion, ax)
    # Rates of a symmetric separation are rounding errors, which are not to fill the panel.
    low, high = min(motion.rates.min(), -0.1), max(motion.rates.max(), 0.1)
    # Room for the legend above the lines.
    ax.set_ylim(low - 0.05 * (high - low), high + 0.35 * (high - low))
    ax.legend(fontsize=FONT_SIZE, loc="upper left", ncols=2)
    return ax


def draw_strokes(motion: Motion, ax: Axes | None = None) -> Axes:
    """Stroke of each spring while it pushes, with its release marked, and where the pins of connectors leave theirs.

    Parameters
    ----------
    motion : Motion
    ax : :class:`matplotlib.axes.Axes`, optional

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
    """
    ax = _axes(ax)
    _dress(ax, "time [ms]", "spring stroke [mm]")
    pushers = np.flatnonzero(~motion.pins)
    count = len(pushers)
    for place, i in enumerate(pushers):
        style, colour = STYLES[place % len(STYLES)], COLOURS[place % len(COLOURS)]
        # Beyond eight springs a legend hides more than it tells.
        failed = " (failed)" if np.isnan(motion.release_times[i]) else ""
        label = f"{motion.names[i]}{failed}" if count <= 8 else None
        ax.plot(1e3 * motion.times, 1e3 * motion.strokes[:, i], style, color=colour,
                marker=MARKERS[place % len(MARKERS)], markersize=5, markevery=(12 * place + 5, 12 * min(count, 8)),
                label=label)  # fmt: skip
    for kind, marker, label in ((~motion.pins, "*", "release"), (motion.pins, "X", "pins leave their socket")):
        if kind.any():
            ax.plot(1e3 * motion.release_times[kind], 1e3 * motion.release_strokes[kind], marker, color=BLACK,
                    markersize=13 if marker == "*" else 9, markerfacecolor="white", label=label,
                    linestyle="none")  # fmt: skip
    ax.set_ylim(0.0, 1.15e3 * np.nanmax(motion.release_strokes))
    ax.legend(fontsize=FONT_SIZE, loc="best")
    return ax


def _mark_releases(motion, ax):
    """A thin line at each release."""
    for time in motion.release_times[np.isfinite(motion.release_times)]:
        line = ax.axvline(1e3 * time, color="0.45", linestyle=":", linewidth=1.2)
    line.set_label("release")
    return line


def separation_figure(separation: Separation, parameters: ArrayLike | None = None, end: float | None = None) -> Figure:
    """One run over time: velocity and gap, body rates, spring strokes.

    Parameters
    ----------
    separation, parameters, end
        As for `compute_motion`.

    Returns
    -------
    figure : :class:`matplotlib.figure.Figure`

    Raises
    ------
    RuntimeError
        If the run fails.
    """
    motion = compute_motion(separation, parameters, end)
    figure, axes = _panels(3, 3)
    for ax, draw in zip(axes, (draw_separation_velocity, draw_rates, draw_strokes), strict=True):
        draw(motion, ax)
        ax.set_xlim(0.0, 1e3 * motion.times[-1])
    return figure
