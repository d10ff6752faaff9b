"""Graphs of a result: convergence, limit state, weights, importance."""

from collections.abc import Sequence

import numpy as np
import openturns as ot

from satsep_ot.methods.reliability.limit_state import Runs
from satsep_ot.methods.reliability.sensitivity import FailureSample, InputImportance
from satsep_ot.methods.reliability.surrogate_view import SurrogateView


def drawConvergence(history: Sequence[tuple[float, float, float, float]]) -> ot.Graph:
    """Estimate and 95 % interval against the number of true runs."""
    graph = ot.Graph("Convergence of the probability", "true runs", "probability", True, "upper right")
    if not history:
        return graph
    runs, probability, lower, upper = (list(column) for column in zip(*history, strict=True))
    graph.add(_curve(runs, probability, "estimate", "solid"))
    graph.add(_curve(runs, lower, "95 % interval", "dashed"))
    graph.add(_curve(runs, upper, "", "dashed"))
    return graph


def drawLimitState(view: SurrogateView, runs: Runs) -> ot.Graph:
    """Limit state of the surrogate in the first two active directions, with the true runs on it."""
    active = view.active
    if active.shape[1] < 2:
        active = np.column_stack([active, runs.margins])[:, :2]
        graph = ot.Graph("Limit state along the active direction", "active variable", "limit state", True, "")
        edges = [float(active[:, 0].min()), float(active[:, 0].max())]
        limit = ot.Curve(edges, [0.0, 0.0])
    else:
        graph = ot.Graph("Limit state in the active plane", "active variable 1", "active variable 2", True, "")
        size = view.axes.shape[1]
        limit = ot.Contour(size, size, ot.Sample(view.contour[:, None]))
        limit.setX(ot.Sample(view.axes[0][:, None]))
        limit.setY(ot.Sample(view.axes[1][:, None]))
        limit.setLevels([0.0])
        limit.setDrawLabels(False)
    limit.setColor("black")
    limit.setLegend("limit")
    for failed, color, legend in ((False, "blue", "safe runs"), (True, "red", "failed runs")):
        rows = (runs.failed == failed) & runs.finite
        if rows.any():
            graph.add(ot.Cloud(ot.Sample(active[rows][:, :2]), color, "fcircle" if failed else "circle", legend))
    graph.add(limit)
    graph.setLegendPosition("upper right")
    _extendVertically(graph, above=0.3)
    return graph


def drawWeights(sample: FailureSample) -> ot.Graph:
    """Share of the estimate that the failed runs of largest weight carry: the nearer to the diagonal, the better."""
    weights = np.sort(sample.ratios[sample.failed])[::-1]
    share = np.concatenate([[0.0], np.cumsum(weights) / weights.sum()])
    runs = np.arange(len(share), dtype=float)
    graph = ot.Graph("Weights of the failed runs", "failed runs, largest weight first", "share", True, "lower right")
    graph.add(_curve(runs, share, "of the sum of the weights", "solid"))
    graph.add(_curve(runs, runs / runs[-1], "all equal", "dashed"))
    return graph


def _curve(runs, values, legend, style):
    curve = ot.Curve(runs, values)
    curve.setLegend(legend)
    curve.setLineStyle(style)
    curve.setColor("black")
    return curve


def drawImportance(rows: Sequence[InputImportance], number: int) -> ot.Graph:
    """Mean and spread in failure of the most important inputs, in standard deviations, with intervals."""
    rows = sorted(rows, key=lambda row: -row.share)[:number][::-1]
    vertical = "inputs, the most important at the top"
    graph = ot.Graph("Inputs in failure", "standard deviations of the input", vertical, True, "lower right")
    # The heights are no numbers.
    graph.setTickLocation(ot.GraphImplementation.TICKX)
    heights = np.arange(1.0, len(rows) + 1.0)
    for color, style, offset, name, values in (
        (
            "blue",
            "fcircle",
            0.12,
            "mean (0: does not matter)",
            [(r.shift, r.shiftLower, r.shiftUpper) for r in rows],
        ),
        (
            "red",
            "square",
            -0.12,
            "spread (1: does not matter)",
            [(r.spread, r.spreadLower, r.spreadUpper) for r in rows],
        ),
    ):
        points = [[value, height + offset] for (value, _, _), height in zip(values, heights, strict=True)]
        for (_, lower, upper), height in zip(values, heights, strict=True):
            bar = ot.Curve([lower, upper], [height + offset, height + offset])
            bar.setColor(color)
            graph.add(bar)
        graph.add(ot.Cloud(ot.Sample(points), color, style, name))
    for row, height in zip(rows, heights, strict=True):
        text = ot.Text([[0.5, height + 0.35]], [f"{row.input}: {100.0 * row.share:.0f} %"])
        text.setColor("black")
        text.setTextSize(1.1)
        graph.add(text)
    _extendVertically(graph, below=0.25, above=0.05)
    return graph


def _extendVertically(graph, below=0.0, above=0.0):
    """Extend the vertical axis by shares of its length, for the legend."""
    box = graph.getBoundingBox()
    lower, upper = box.getLowerBound(), box.getUpperBound()
    height = upper[1] - lower[1]
    graph.setBoundingBox(ot.Interval([lower[0], lower[1] - below * height], [upper[0], upper[1] + above * height]))
