"""Active subspaces: eigenvalues with their bands, and an output against its active variables."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator
from numpy.typing import ArrayLike

from satsep_ot.methods.polynomials.regression_result import MultivariatePolynomialRegressionResult
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult
from satsep_ot.studies.telling.figures.axes import (
    AS_WRITTEN,
    BLACK,
    BLUE,
    COLOURS,
    FONT_SIZE,
    GREY,
    MARKERS,
    STYLES,
    grouped_unit,
    label_axes,
    label_decades,
    make_axes,
    quantity_label,
)


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
    result : :class:`satsep_ot.methods.subspaces.result.ActiveSubspaceResult`
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
    ax = make_axes(ax)
    values = np.array(result.getEigenvalues())
    interval = result.getEigenvaluesInterval(level)
    lower, upper = np.array(interval.getLowerBound()), np.array(interval.getUpperBound())
    # A logarithmic axis has no place for the zeros of a constant function and of directions without gradients.
    count = min(largest, int((values > 0.0).sum()))
    squared = f" [{grouped_unit(unit)}²]" if unit else ""
    label_axes(ax, "index of the eigenvalue", f"eigenvalue{squared}", label.replace("_", " "))
    if count == 0:
        ax.text(0.5, 0.5, "all eigenvalues are 0", transform=ax.transAxes, ha="center", fontsize=FONT_SIZE)
        return ax
    index = np.arange(1, count + 1)
    values, lower, upper = values[:count], lower[:count], upper[:count]
    # Where an upper bound is not known, the band ends at the estimate.
    upper = np.where(np.isfinite(upper), upper, values)
    ax.set_yscale("log")
    label_decades(ax.yaxis)
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


def draw_spectra(results: dict[str, ActiveSubspaceResult], ax: Axes | None = None, largest: int = 10) -> Axes:
    """Eigenvalues of several active subspaces in one picture, each over its largest one.

    Parameters
    ----------
    results : dict of str to :class:`satsep_ot.methods.subspaces.result.ActiveSubspaceResult`
        By the name of the output; at least one.
    ax : :class:`matplotlib.axes.Axes`, optional
    largest : int
        How many eigenvalues are drawn at most.

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
    >>> from satsep_ot.studies.telling.figures import draw_spectra
    >>> algorithm = ActiveSubspaceAlgorithm(ot.SymbolicFunction(["a", "b"], ["exp(0.3 * a + 0.4 * b)"]), ot.Normal(2))
    >>> algorithm.run()
    >>> draw_spectra({"g": algorithm.getResult()}).get_ylabel()
    'eigenvalue over the largest one'
    """
    ax = label_axes(make_axes(ax), "index of the eigenvalue", "eigenvalue over the largest one")
    ax.set_yscale("log")
    label_decades(ax.yaxis)
    for place, (name, result) in enumerate(results.items()):
        values = np.array(result.getEigenvalues())[:largest]
        values = values[values > 0.0] / values[0]
        ax.plot(
            np.arange(1, len(values) + 1), values, STYLES[place // len(COLOURS) % len(STYLES)],
            color=COLOURS[place % len(COLOURS)], marker=MARKERS[place % len(MARKERS)], markersize=5,
            label=name.replace("_", " "),
        )  # fmt: skip
    ax.xaxis.set_major_locator(MaxNLocator(integer=True))
    ax.legend(fontsize=FONT_SIZE - 2, ncols=1 + len(results) // 5, loc="best")
    return ax


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
    ax = make_axes(ax)
    active, values = np.asarray(active, dtype=float), np.asarray(values, dtype=float).reshape(-1)
    low, high = active.min(axis=0), active.max(axis=0)
    if active.shape[1] == 1:
        label_axes(ax, "active variable [standard deviations]", quantity_label(label, unit))
        grid = np.linspace(low, high, 201)
        if np.isfinite(regression.getQ2LeaveOneOut()[0]):
            # As many coefficients as runs leave nothing to tell a band from.
            lower, upper = regression.getPredictionInterval(grid, level)
            ax.fill_between(
                grid[:, 0], lower[:, 0], upper[:, 0], color=GREY, alpha=0.6, linewidth=0,
                label=f"{100.0 * level:g} % of new runs",
            )  # fmt: skip
        ax.plot(active[:, 0], values, "o", color=BLUE, markersize=3.5, alpha=0.7, label="true runs")
        ax.plot(grid[:, 0], regression.evaluate(grid)[:, 0], "-", color=BLACK, label=f"degree {regression.getDegree()}")
        ax.legend(fontsize=FONT_SIZE)
        return ax
    label_axes(ax, "active variable 1 [standard deviations]", "active variable 2 [standard deviations]")
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
    bar.set_label(quantity_label(label, unit), fontsize=FONT_SIZE, **AS_WRITTEN)
    bar.ax.tick_params(labelsize=FONT_SIZE)
    return ax
