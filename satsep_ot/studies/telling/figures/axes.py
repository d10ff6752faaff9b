"""The axes of all figures: sizes, colours, labels, panels side by side, and the file that a figure is written to."""

import math
import os
import unicodedata
import warnings
from typing import IO, Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter, NullFormatter

FONT_SIZE = 11
DOTS_PER_INCH = 150
PANEL_SIZE = (5.2, 3.9)  # inches
BLACK, GREY, BLUE, ORANGE = "#000000", "#b5b5b5", "#1f5f9f", "#c85a00"
STYLES = ("-", "--", "-.", ":")
COLOURS = (BLACK, BLUE, ORANGE, "#5a5a5a")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<")
# Of texts that may hold names: matplotlib would take what stands between two dollar signs for mathematics.
AS_WRITTEN: dict[str, Any] = {"parse_math": False, "usetex": False}
# Matplotlib draws letters by their outlines, one after the other from the left to the right, with its own font.
_OUTLINES = "DejaVu Sans"


def make_axes(ax: Axes | None = None, size: tuple[float, float] = PANEL_SIZE) -> Axes:
    """The axes given, or those of a new figure.

    Parameters
    ----------
    ax : :class:`matplotlib.axes.Axes`, optional
    size : (width, height)
        Of the new figure [inches].

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
    """
    return Figure(figsize=size, layout="constrained").add_subplot() if ax is None else ax


def label_axes(ax: Axes, horizontal: str, vertical: str, title: str = "") -> Axes:
    """Labels, ticks, grid and title in readable sizes; `matplotlib.rcParams` stay as they are.

    Parameters
    ----------
    ax : :class:`matplotlib.axes.Axes`
    horizontal, vertical : str
        Quantity and unit of each axis.
    title : str

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
        The same.
    """
    ax.set_xlabel(horizontal, fontsize=FONT_SIZE, **AS_WRITTEN)
    ax.set_ylabel(vertical, fontsize=FONT_SIZE, **AS_WRITTEN)
    if title:
        ax.set_title(title, fontsize=FONT_SIZE + 1, **AS_WRITTEN)
    ax.tick_params(which="both", labelsize=FONT_SIZE)
    ax.grid(True, color="0.88", linewidth=0.8)
    ax.set_axisbelow(True)
    return ax


def quantity_label(name: str, unit: str) -> str:
    """Name and unit of a quantity, as an axis shows them; what stands behind the name is kept as it is.

    Examples
    --------
    >>> from satsep_ot.studies.telling.figures import quantity_label
    >>> quantity_label("axial_velocity", "m/s")
    'axial velocity [m/s]'
    """
    name, space, rest = name.partition(" ")
    name = name.replace("_", " ") + space + rest
    return f"{name} [{unit}]" if unit else name


def grouped_unit(unit: str) -> str:
    """A unit that a power or a quotient can be taken of: a compound one in brackets.

    Examples
    --------
    >>> from satsep_ot.studies.telling.figures.axes import grouped_unit
    >>> grouped_unit("deg/s"), grouped_unit("mm")
    ('(deg/s)', 'mm')
    """
    return f"({unit})" if "/" in unit else unit


def label_decades(axis: Axis) -> None:
    """Label powers of ten on a logarithmic axis, as 10⁻³: matplotlib's own labels take most of the time of a figure.

    Parameters
    ----------
    axis : :class:`matplotlib.axis.Axis`
    """
    axis.set_major_formatter(FuncFormatter(lambda value, _: power_of_ten(value)))
    axis.set_minor_formatter(NullFormatter())


def power_of_ten(value: float) -> str:
    """A number that is a power of ten, with a raised exponent; another one in its shortest form.

    Examples
    --------
    >>> from satsep_ot.studies.telling.figures.axes import power_of_ten
    >>> power_of_ten(1e-3), power_of_ten(100.0), power_of_ten(0.02)
    ('10⁻³', '10²', '0.02')
    """
    exponent = round(math.log10(value))
    if not math.isclose(value, 10.0**exponent, rel_tol=1e-9):
        return f"{value:g}"
    return "10" + str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def make_panels(
    count: int, columns: int | None = None, size: tuple[float, float] = PANEL_SIZE
) -> tuple[Figure, list[Axes]]:
    """A figure with several panels.

    Parameters
    ----------
    count : int
        Number of panels, at least 1.
    columns : int, optional
        Panels side by side; by default at most 3.
    size : (width, height)
        Of one panel [inches].

    Returns
    -------
    figure : :class:`matplotlib.figure.Figure`
    axes : list of :class:`matplotlib.axes.Axes`
        Row by row; no empty panel is left.

    Raises
    ------
    ValueError
        If there is no panel to draw.
    """
    if count < 1:
        raise ValueError(f"there are {count} panels to draw; a figure needs at least 1")
    columns = columns or (count if count < 4 else 2 if count == 4 else 3)
    rows = math.ceil(count / columns)
    figure = Figure(figsize=(size[0] * columns, size[1] * rows), layout="constrained")
    return figure, [figure.add_subplot(rows, columns, k + 1) for k in range(count)]


def save_figure(figure: Figure, path: str | os.PathLike | IO[bytes], form: str | None = None) -> None:
    """Write a figure.

    Parameters
    ----------
    figure : :class:`matplotlib.figure.Figure`
    path : str, path or binary stream
    form : str, optional
        "png", "svg" or "pdf"; by default what the path ends on. In an SVG with a name that matplotlib cannot draw
        (emoji, Hebrew, Arabic, Chinese) all text is left to the fonts of the reader.
    """
    is_svg = form == "svg" or str(path).endswith(".svg")
    # Names inside an SVG follow from its content, and nothing in it from the day: the same study, the same file.
    settings: dict[Any, Any] = {"svg.hashsalt": "satsep-ot", "svg.fonttype": "path"}
    if not all(_has_outlines(text.get_text()) for text in figure.findobj(Text)):
        settings["svg.fonttype"] = "none"
    with matplotlib.rc_context(settings), warnings.catch_warnings():
        # An outline that is missing only widens the space for its text, or leaves a box in a picture of pixels.
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        figure.savefig(path, dpi=DOTS_PER_INCH, metadata={"Date": None} if is_svg else None, format=form)


def _has_outlines(text):
    """Whether matplotlib draws a text as it is written."""
    if text.isascii():
        return True
    outlines = get_font(findfont(_OUTLINES)).get_charmap()
    return all(
        character == "\n" or (ord(character) in outlines and unicodedata.bidirectional(character) not in ("R", "AL"))
        for character in text
    )
