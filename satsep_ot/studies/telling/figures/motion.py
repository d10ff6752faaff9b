"""One separation over time: velocity and gap, body rates, spring strokes."""

import numpy as np
from matplotlib.axes import Axes

from satsep_ot.studies.telling.figures.axes import (
    BLACK,
    BLUE,
    COLOURS,
    FONT_SIZE,
    MARKERS,
    STYLES,
    label_axes,
    make_axes,
)
from satsep_ot.studies.telling.motion import Motion

# Part of the largest stroke that a picture shows.
_SEEN = 2e-3


def draw_separation_velocity(motion: Motion, ax: Axes | None = None) -> Axes:
    """Axial velocity and gap over time, the gap on an axis of its own at the right.

    Parameters
    ----------
    motion : Motion
    ax : :class:`matplotlib.axes.Axes`, optional

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
        The axes of the velocity.
    """
    ax = _time_axes(motion, ax, "axial velocity [m/s]")
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
    ax = _time_axes(motion, ax, "satellite body rate [deg/s]")
    for k, axis in enumerate("xyz"):
        # Markers far apart tell lines that lie on each other.
        ax.plot(1e3 * motion.times, motion.rates[:, k], STYLES[k], color=COLOURS[k], marker=MARKERS[k], markersize=5,
                markevery=(20 * k, 60), label=f"about {axis}")  # fmt: skip
    _mark_releases(motion, ax)
    # Rates of a symmetric separation are rounding errors, which would fill the panel.
    low, high = min(motion.rates.min(), -0.1), max(motion.rates.max(), 0.1)
    # Space for the legend above the lines.
    ax.set_ylim(low - 0.05 * (high - low), high + 0.35 * (high - low))
    ax.legend(fontsize=FONT_SIZE, loc="upper left", ncols=2)
    return ax


def draw_strokes(motion: Motion, ax: Axes | None = None) -> Axes:
    """Stroke of each spring while it pushes, with marks where it is released and where pins leave their socket.

    Parameters
    ----------
    motion : Motion
    ax : :class:`matplotlib.axes.Axes`, optional

    Returns
    -------
    ax : :class:`matplotlib.axes.Axes`
    """
    ax = _time_axes(motion, ax, "spring stroke [mm]")
    groups = _alike(motion)
    for place, springs in enumerate(groups):
        style, colour = STYLES[place % len(STYLES)], COLOURS[place % len(COLOURS)]
        first = springs[0]
        failed = " (failed)" if np.isnan(motion.release_times[first]) else ""
        names = motion.names[first] if len(springs) == 1 else f"{len(springs)} springs, alike"
        ax.plot(1e3 * motion.times, 1e3 * motion.strokes[:, first], style, color=colour,
                marker=MARKERS[place % len(MARKERS)], markersize=5,
                markevery=(12 * place + 5, 12 * min(len(groups), 8)),
                # Beyond eight springs a legend hides more than it tells.
                label=f"{names}{failed}" if len(groups) <= 8 else None)  # fmt: skip
    for kind, marker, label in ((~motion.pins, "*", "release"), (motion.pins, "X", "pins leave their socket")):
        if kind.any():
            ax.plot(1e3 * motion.release_times[kind], 1e3 * motion.release_strokes[kind], marker, color=BLACK,
                    markersize=13 if marker == "*" else 9, markerfacecolor="white", label=label,
                    linestyle="none")  # fmt: skip
    ax.set_ylim(0.0, 1.15e3 * np.nanmax(motion.release_strokes))
    ax.legend(fontsize=FONT_SIZE, loc="best")
    return ax


def _alike(motion):
    """The springs that push, in groups whose strokes nobody can tell apart in a picture."""
    groups: list[list[int]] = []
    for i in np.flatnonzero(~motion.pins):
        stroke = motion.strokes[:, i]
        for group in groups:
            if np.allclose(stroke, motion.strokes[:, group[0]], atol=_SEEN * np.nanmax(motion.release_strokes),
                           rtol=0.0, equal_nan=True):  # fmt: skip
                group.append(i)
                break
        else:
            groups.append([i])
    return groups


def _time_axes(motion, ax, vertical):
    ax = label_axes(make_axes(ax), "time [ms]", vertical)
    ax.set_xlim(0.0, 1e3 * motion.times[-1])
    return ax


def _mark_releases(motion, ax):
    """A thin line at each release."""
    for time in motion.release_times[np.isfinite(motion.release_times)]:
        line = ax.axvline(1e3 * time, color="0.45", linestyle=":", linewidth=1.2)
    line.set_label("release")
    return line
