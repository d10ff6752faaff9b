"""Figures of a study. Nothing here shows itself, loads pyplot or changes a global setting.

Each `draw_...` draws one panel into the axes given, or into those of a new figure, and returns the axes. `make_panels`
puts several into one figure, `save_figure` writes it. Lines differ by style and marker, not by colour alone, and
letters are at least 11 points high, so that a figure can be read in grey and from the back of a room.
"""

from satsep_ot.studies.telling.figures.axes import (
    BLACK,
    BLUE,
    COLOURS,
    FONT_SIZE,
    GREY,
    MARKERS,
    ORANGE,
    PANEL_SIZE,
    STYLES,
    label_axes,
    make_axes,
    make_panels,
    quantity_label,
    save_figure,
)
from satsep_ot.studies.telling.figures.curves import draw_tolerance_curves
from satsep_ot.studies.telling.figures.densities import draw_density, draw_exceedance, sample_density
from satsep_ot.studies.telling.figures.motion import draw_rates, draw_separation_velocity, draw_strokes
from satsep_ot.studies.telling.figures.probabilities import ProbabilityBar, draw_probabilities
from satsep_ot.studies.telling.figures.shares import draw_shares
from satsep_ot.studies.telling.figures.subspaces import draw_eigenvalues, draw_spectra, draw_sufficient_summary

__all__ = [
    "BLACK",
    "BLUE",
    "COLOURS",
    "FONT_SIZE",
    "GREY",
    "MARKERS",
    "ORANGE",
    "PANEL_SIZE",
    "STYLES",
    "ProbabilityBar",
    "draw_density",
    "draw_eigenvalues",
    "draw_exceedance",
    "draw_probabilities",
    "draw_rates",
    "draw_separation_velocity",
    "draw_shares",
    "draw_spectra",
    "draw_strokes",
    "draw_sufficient_summary",
    "draw_tolerance_curves",
    "label_axes",
    "make_axes",
    "make_panels",
    "quantity_label",
    "sample_density",
    "save_figure",
]
