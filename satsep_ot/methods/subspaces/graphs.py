"""Graphs of an active subspace: sufficient summary, numbers with bands, scores with intervals."""

from collections.abc import Sequence

import numpy as np
import openturns as ot

from satsep_ot.methods.polynomials.basis import PolynomialBasis
from satsep_ot.methods.polynomials.fit import fit_polynomial
from satsep_ot.methods.subspaces.variables import surrogate_degree

# Ten steps of the colour map viridis, that of OpenTURNS' contours (Smith and van der Walt, 2015).
COLOURS = (
    "#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725",
)  # fmt: skip


def drawSufficientSummary(
    active: np.ndarray, values: np.ndarray, weights: np.ndarray | None = None, name: str = "output", level: float = 0.95
) -> ot.Graph:
    """Output against the first one or two active variables with the regression on them.

    Parameters
    ----------
    active : ndarray (N, r)
        Active variables; the first two are drawn.
    values : ndarray (N,)
        Output.
    weights : ndarray (N,), optional
        Of the regression.
    name : str
        Of the output.
    level : float
        Level of the band of prediction.

    Returns
    -------
    :py:class:`openturns.Graph`
        One active variable: points, regression and its band. More: points in the plane of the first two, coloured by
        the output, over the contours of the regression on these two in the same colours.
    """
    shown = min(active.shape[1], 2)
    active = active[:, :shown]
    basis = PolynomialBasis(shown, surrogate_degree(len(active), shown))
    fit = fit_polynomial(basis, active, values, weights, allow_deficient=True)
    lower, upper = active.min(axis=0), active.max(axis=0)
    if shown == 2:
        graph = ot.Graph(f"Sufficient summary of {name}", "active variable 1", "active variable 2", True, "")
        first, second = (np.linspace(low, high, 41) for low, high in zip(lower, upper, strict=True))
        # OpenTURNS' contour takes the first variable as the fast one.
        mesh = np.column_stack([np.tile(first, 41), np.repeat(second, 41)])
        surface = fit.predict(mesh)
        # Lines and points share their colours: where they differ, other variables matter.
        # The colours span the range of the runs: corners without points, where the regression extrapolates, would
        # take them all.
        edges = np.linspace(values.min(), values.max(), len(COLOURS) + 1)
        levels = [level_ for level_ in edges if surface.min() < level_ < surface.max()]
        if levels:
            contour = ot.Contour(*(ot.Sample(column[:, None]) for column in (first, second, surface)))
            contour.setLevels(levels)
            contour.setLabels([f"{level_:.3g}" for level_ in levels])
            contour.setColorMap("viridis")
            contour.setVmin(edges[0])
            contour.setVmax(edges[-1])
            graph.add(contour)
        classes = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(COLOURS) - 1)
        for number, colour in enumerate(COLOURS):
            if (classes == number).any():
                graph.add(ot.Cloud(active[classes == number], colour, "fcircle"))
        return graph
    graph = ot.Graph(f"Sufficient summary of {name}", "active variable 1", name, True, "upper left")
    cloud = ot.Cloud(np.column_stack([active, values]))
    cloud.setPointStyle("fcircle")
    cloud.setLegend("runs")
    graph.add(cloud)
    grid = np.linspace(lower, upper, 101)
    curve = fit.predict(grid)
    line = ot.Curve(grid[:, 0], curve)
    line.setLegend(f"degree {basis.degree}")
    line.setColor("black")
    graph.add(line)
    deviation = fit.noise_deviation
    if deviation is not None:
        quantile = ot.Student(float(len(values) - fit.rank)).computeQuantile(0.5 + 0.5 * level)[0]
        half = quantile * deviation * np.sqrt(1.0 + fit.relative_variance(grid))
        for bound, legend in ((curve - half, f"{100 * level:g} % band"), (curve + half, "")):
            edge = ot.Curve(grid[:, 0], bound)
            edge.setLineStyle("dashed")
            edge.setColor("black")
            edge.setLegend(legend)
            graph.add(edge)
    return graph


def addBand(graph: ot.Graph, middle: np.ndarray, lower: np.ndarray, upper: np.ndarray | None, level: float) -> None:
    """Points joined by a line, and the dashed edges of a band, over 1, 2, ...; no upper edge where it is None."""
    number = np.arange(1.0, len(middle) + 1.0)
    curve = ot.Curve(number, middle)
    curve.setColor("steelblue")
    graph.add(curve)
    points = ot.Cloud(number, middle)
    points.setColor("steelblue")
    points.setPointStyle("fcircle")
    graph.add(points)
    for place, bound in enumerate((lower,) if upper is None else (lower, upper)):
        edge = ot.Curve(number, bound)
        edge.setLineStyle("dashed")
        edge.setColor("black")
        edge.setLegend("" if place else f"{100 * level:g} % band")
        graph.add(edge)


def drawScores(scores: np.ndarray, lower: np.ndarray, upper: np.ndarray | None, names: Sequence[str]) -> ot.Graph:
    """Scores (d,) of inputs as bars with whiskers, the largest first; without upper bounds from the bar down."""
    upper = np.maximum(scores, lower) if upper is None else upper
    order = np.argsort(-scores, kind="stable")
    ranked = ", ".join(names[i] for i in order[:5])
    graph = ot.Graph(f"Activity scores, largest: {ranked}", "input", "score", True, "")
    for position, i in enumerate(order):
        # Polygons rather than a BarPlot, whose bars cannot be told apart by input.
        left, right = position + 0.6, position + 1.4
        corners = [[left, 0.0], [right, 0.0], [right, scores[i]], [left, scores[i]]]
        graph.add(ot.Polygon(corners, "steelblue", "steelblue"))
        whisker = ot.Curve([position + 1.0] * 2, [lower[i], upper[i]])
        whisker.setColor("black")
        graph.add(whisker)
    # Above the whiskers, where nothing is in the way; the axis itself carries numbers only.
    gap = 0.02 * max(upper.max(), scores.max())
    tops = [[k + 1.0, max(upper[i], scores[i]) + gap] for k, i in enumerate(order)]
    labels = ot.Text(tops, [names[i] for i in order], "top")
    labels.setColor("black")
    labels.setRotation(90)
    graph.add(labels)
    return graph
