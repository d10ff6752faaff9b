"""Shares: which tolerance drives a violation."""

from matplotlib.axes import Axes

from satsep_ot.studies.telling.figures.axes import AS_WRITTEN, BLACK, FONT_SIZE, GREY, PANEL_SIZE, label_axes, make_axes


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
    ax = make_axes(ax, (PANEL_SIZE[0], 1.2 + 0.3 * len(bars)))
    label_axes(ax, f"{label} [%]", "", title)
    places = range(len(bars))
    ax.barh(places, [100.0 * share for share in bars.values()], color=GREY, edgecolor=BLACK, linewidth=1.0)
    for place, share in zip(places, bars.values(), strict=True):
        ax.text(100.0 * share, place, f" {100.0 * share:.1f}", va="center", fontsize=FONT_SIZE)
    ax.set_xlim(0.0, 115.0 * max(bars.values()))
    ax.set_yticks(places, [name.replace("_", " ") for name in bars], **AS_WRITTEN)
    ax.set_ylim(len(bars) - 0.4, -0.6)
    ax.tick_params(axis="y", length=0)
    return ax
