"""Probabilities with their intervals, by method or by tolerance."""

import dataclasses
import math
from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from satsep_ot.studies.telling.figures.axes import (
    AS_WRITTEN,
    COLOURS,
    FONT_SIZE,
    MARKERS,
    label_axes,
    make_axes,
)
from satsep_ot.studies.telling.words import probability_text


@dataclasses.dataclass(frozen=True)
class ProbabilityBar:
    """A probability as `draw_probabilities` shows it.

    Attributes
    ----------
    label : str
        What stands at the axis, such as the method.
    probability : float or None
        None draws no point.
    lower95, upper95 : float or None
        Bounds of the 95 % interval; None for a method without one.
    evaluations : int or None
        Runs of the simulator; None where they are not known.
    gradients : int
    converged : bool
    message : str
        What stands in place of a probability.
    """

    label: str
    probability: float | None = None
    lower95: float | None = None
    upper95: float | None = None
    evaluations: int | None = None
    gradients: int = 0
    converged: bool = True
    message: str = "no result"

    @property
    def cost(self) -> str:
        """Evaluations and gradients in words, a line each; empty where they are not known."""
        if self.evaluations is None:
            return ""
        text = f"{self.evaluations:,} runs"
        return f"{text}\n{self.gradients:,} gradients" if self.gradients else text


def draw_probabilities(bars: Sequence[ProbabilityBar], ax: Axes | None = None, title: str = "") -> Axes:
    """Probabilities of one event, such as by several methods, with their 95 % intervals and the runs that they took.

    Parameters
    ----------
    bars : sequence of ProbabilityBar
        From top to bottom.
    ax : :class:`matplotlib.axes.Axes`, optional
    title : str

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
        A hollow marker: not converged. An arrow to the left: the interval begins at 0.

    Raises
    ------
    ValueError
        If there are no bars.

    Examples
    --------
    >>> from satsep_ot.studies.telling.figures import ProbabilityBar, draw_probabilities
    >>> bars = [ProbabilityBar("FORM", 1e-4), ProbabilityBar("MonteCarlo", 2e-4, 1e-4, 4e-4, evaluations=100_000)]
    >>> [label.get_text() for label in draw_probabilities(bars).get_yticklabels()]
    ['FORM', 'MonteCarlo']
    """
    if not bars:
        raise ValueError("there are no probabilities to draw")
    ax = make_axes(ax, (6.6, 1.4 + 0.5 * len(bars)))
    label_axes(ax, "probability of violation", "", title)
    ax.set_xscale("log")
    low, high = _axis_range([number for bar in bars for number in (bar.probability, bar.lower95, bar.upper95)])
    ax.set_xlim(low, high)
    _set_probability_ticks(ax, low, high)
    ax.set_ylim(len(bars) - 0.4, -0.6)
    ax.set_yticks(range(len(bars)), [bar.label for bar in bars], **AS_WRITTEN)
    ax.tick_params(axis="y", length=0)
    for place, bar in enumerate(bars):
        _draw_bar(ax, place, bar, low)
    return ax


def _draw_bar(ax, place, bar, low):
    def write(x, text, **options):
        ax.text(
            x, place, text, transform=ax.get_yaxis_transform(), va="center", fontsize=FONT_SIZE, **AS_WRITTEN, **options
        )

    # The cost beside the axes, in the row of its method.
    write(1.02, bar.cost)
    colour, marker = COLOURS[place % len(COLOURS)], MARKERS[place % len(MARKERS)]
    if bar.probability is None or not math.isfinite(bar.probability):
        write(0.5, bar.message, ha="center")
        return
    if bar.lower95 is not None and bar.upper95 is not None:
        start, inside = max(bar.lower95, low), bar.lower95 >= low
        ax.plot([start, bar.upper95], [place, place], "-", color=colour, linewidth=2.0)
        ax.plot([bar.upper95], [place], "|", color=colour, markersize=11, markeredgewidth=2.0)
        # An interval that begins at 0 leaves the axis.
        ax.plot([start], [place], "|" if inside else "<", color=colour, markersize=11 if inside else 8,
                markeredgewidth=2.0, clip_on=False)  # fmt: skip
    if bar.probability >= low:
        ax.plot([bar.probability], [place], marker, color=colour, markersize=8, markeredgewidth=1.8,
                markerfacecolor=colour if bar.converged else "white")  # fmt: skip
    elif bar.upper95 is None:
        write(0.03, f"< {probability_text(low, 2)}")


def _set_probability_ticks(ax, low, high):
    # Within a decade or two there may be no power of ten to label.
    ax.xaxis.set_major_locator(LogLocator(subs=(1.0,) if high > 100.0 * low else (1.0, 2.0, 5.0)))
    ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: probability_text(value, 1)))
    ax.xaxis.set_minor_formatter(NullFormatter())


def _axis_range(numbers):
    """Limits of a logarithmic axis that hold every number above 0, and half a decade at least."""
    positive = [number for number in numbers if number is not None and math.isfinite(number) and number > 0.0]
    if not positive:
        return 1e-6, 1.0
    # A number far below all others would squeeze these into a corner.
    high = max(positive)
    low = max(min(positive), 1e-6 * high)
    return 10.0 ** (math.log10(low) - 0.3), 10.0 ** (math.log10(high) + 0.3)
