"""The probability of a violation against the size of tolerances."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from satsep_ot.studies.telling.figures.axes import (
    AS_WRITTEN,
    COLOURS,
    FONT_SIZE,
    MARKERS,
    ORANGE,
    STYLES,
    label_axes,
    make_axes,
)
from satsep_ot.studies.telling.tolerance_curves import RequirementCurves
from satsep_ot.studies.telling.words import probability_text


def draw_tolerance_curves(found: RequirementCurves, title: str = "", ax: Axes | None = None) -> Axes:
    """Probability of a violation against the size of each tolerance, with 95 % bands and the allowed probability.

    Parameters
    ----------
    found : :class:`satsep_ot.studies.telling.tolerance_curves.RequirementCurves`
    title : str
    ax : :class:`matplotlib.axes.Axes`, optional

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
        Filled markers are new runs, open ones runs of the study with new weights.

    Examples
    --------
    >>> from satsep_ot.studies.telling.figures import draw_tolerance_curves
    >>> from satsep_ot.studies.telling.tolerance_curves import CurvePoint, RequirementCurves, ToleranceCurve
    >>> points = (CurvePoint(0.5, 1e-4, 8e-5, 1.2e-4, 900), CurvePoint(1.0, 1e-3, 9e-4, 1.1e-3))
    >>> ax = draw_tolerance_curves(RequirementCurves(5e-4, False, (ToleranceCurve("cant", points),)), "spin")
    >>> ax.get_xlabel()
    'size of the tolerance over that of the case'
    """
    ax = label_axes(make_axes(ax), "size of the tolerance over that of the case", "probability of violation", title)
    ax.set_yscale("log")
    for place, curve in enumerate(found.curves):
        points = [point for point in curve.points if point.probability]
        if not points:
            continue
        colour, marker = COLOURS[place % len(COLOURS)], MARKERS[place % len(MARKERS)]
        scales, values, lower, upper = np.array(
            [(point.scale, point.probability, point.lower95 or 0.0, point.upper95) for point in points], dtype=float
        ).T
        label = curve.tolerance.replace("_", " ")
        ax.plot(scales, values, STYLES[place % len(STYLES)], color=colour, label=label)
        ax.fill_between(scales, np.maximum(lower, 0.1 * values), upper, color=colour, alpha=0.15, linewidth=0)
        for point, scale, value in zip(points, scales, values, strict=True):
            face = colour if point.runs else "white"
            ax.plot([scale], [value], marker, color=colour, markerfacecolor=face)
    if found.allowed is not None:
        label = f"allowed {found.allowed:g}"
        ax.axhline(found.allowed, color=ORANGE, linestyle="--", linewidth=2.0, label=label)
    ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: probability_text(value, 1)))
    ax.yaxis.set_minor_formatter(NullFormatter())
    if ax.get_legend_handles_labels()[0]:
        for text in ax.legend(fontsize=FONT_SIZE).get_texts():
            text.set(**AS_WRITTEN)
    return ax
