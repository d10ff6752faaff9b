"""The figures of a report: which there are, from what a study found and from its runs."""

import dataclasses
import io
from collections.abc import Iterator
from typing import IO, NamedTuple, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from satsep_ot.dynamics.separation import Separation
from satsep_ot.studies.telling import figures
from satsep_ot.studies.telling.advice import tightening_advice
from satsep_ot.studies.telling.figures import ProbabilityBar
from satsep_ot.studies.telling.motion import compute_motion
from satsep_ot.studies.telling.results import (
    Component,
    DriverMeasure,
    Estimate,
    HalvedTolerance,
    Section,
    StudyResult,
    main_quantities,
)
from satsep_ot.studies.telling.verdicts import Gain, best_estimate

# A quantity that varies by less than this part of its size has no density to draw.
_SMALLEST_SPREAD = 1e-9
# [deg/s]; a nominal run that turns by less has no rates to draw.
_SMALLEST_RATE = 1e-3


@dataclasses.dataclass(frozen=True)
class StudyRuns:
    """What the figures are drawn from, beside the `StudyResult`.

    Attributes
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`
        The nominal one.
    sample : ndarray, shape (n, q), or None
        Quantities of interest of Monte Carlo runs, in the order of the result's `quantities`.
    components : dict of str to Component
    surrogate_sample : dict of str to ndarray, shape (m,)
        Quantities by the surrogates alone.
    """

    separation: Separation
    sample: np.ndarray | None
    components: dict[str, Component]
    surrogate_sample: dict[str, np.ndarray]


@dataclasses.dataclass(frozen=True)
class Panel:
    """One figure of the report: the section that shows it, its name, its text alternative."""

    section: Section
    name: str
    text: str
    figure: Figure

    def write(self, stream: IO[bytes]) -> None:
        """Write it as SVG."""
        figures.save_figure(self.figure, stream, "svg")

    def drawn(self) -> "DrawnPanel":
        """The same as a picture."""
        stream = io.BytesIO()
        self.write(stream)
        return DrawnPanel(self.section, self.name, self.text, stream.getvalue())

    @staticmethod
    def of(section: Section, name: str, text: str, ax: Axes) -> "Panel":
        """The figure that these axes fill."""
        # It is a figure of its own, and no part of another.
        return Panel(section, name, text, cast(Figure, ax.figure))


class DrawnPanel(NamedTuple):
    """A panel as a picture in SVG."""

    section: Section
    name: str
    text: str
    picture: bytes


def result_panels(result: StudyResult, separation: Separation) -> Iterator[Panel]:
    """The figures that need no runs but the nominal one, in the order of each section."""
    yield from _motion_panels(separation)
    yield from _driver_panels(result)
    yield from _tightened_panels(result)
    for requirement, found in result.curves.items():
        if any(sum(bool(point.probability) for point in curve.points) > 1 for curve in found.curves):
            ax = figures.draw_tolerance_curves(found, title=requirement)
            yield Panel.of(Section.SIZES, requirement, f"{requirement} against the size of its tolerances", ax)
    yield from _exceedance_panels(result)
    for name, rows in result.rows_by_requirement().items():
        if len(rows) < 2:
            # One method compares with nothing.
            continue
        ax = figures.draw_probabilities([_bar(row, row.method) for row in rows], title=name)
        yield Panel.of(Section.METHODS, name, f"probability of violating {name} by each method", ax)


def run_panels(result: StudyResult, runs: StudyRuns) -> Iterator[Panel]:
    """The figures that are drawn from runs."""
    if runs.sample is not None:
        yield from _density_panels(result, runs.sample, runs.surrogate_sample)
    yield from _component_panels(result, runs.components)


def drawn_result_panels(result: StudyResult, separation: Separation) -> list[DrawnPanel]:
    """The same as `result_panels`, drawn: what a process gives to another one."""
    return [panel.drawn() for panel in result_panels(result, separation)]


def _motion_panels(separation):
    motion = compute_motion(separation)
    drawn = [("velocity", figures.draw_separation_velocity), ("strokes", figures.draw_strokes)]
    if np.abs(motion.rates).max() > _SMALLEST_RATE:
        drawn.insert(1, ("rates", figures.draw_rates))
    for name, draw in drawn:
        yield Panel.of(Section.SEPARATION, name, f"{name} of the nominal run over time", draw(motion))


def _driver_panels(result):
    for requirement, shares in result.drivers.items():
        if shares:
            measure = result.driver_measures.get(requirement, DriverMeasure.VIOLATIONS)
            ax = figures.draw_shares(shares, title=requirement, label=f"share in the {measure}")
            yield Panel.of(Section.DRIVERS, requirement, f"shares of the tolerances in {requirement}", ax)


def _tightened_panels(result):
    for requirement, advice in tightening_advice(result).items():
        now = best_estimate(result.rows_of(requirement))
        halved = [_halved_bar(row.half, row.gain) for row in advice if row.half is not None]
        if now is not None and halved:
            bars = [_bar(now, "as it is"), *halved]
            ax = figures.draw_probabilities(bars, title=requirement)
            yield Panel.of(Section.TIGHTENED, requirement, f"{requirement} with halved tolerances", ax)


def _density_panels(result, sample, surrogate_sample):
    """A density for each requirement's quantity, then for the other quantities that vary."""
    columns = dict(zip(result.quantities, sample.T, strict=True))
    surrogate = {name: figures.sample_density(values) for name, values in surrogate_sample.items()}

    def panel(label, quantity, **limit):
        unit = result.quantities[quantity].unit
        ax = figures.draw_density(columns[quantity], density=surrogate.get(quantity), label=label, unit=unit, **limit)
        return Panel.of(Section.DENSITIES, label, f"probability density of {label}", ax)

    drawn = set()
    for entry in result.requirements:
        best = best_estimate(result.rows_of(entry.name))
        # A second limit on a quantity has a panel of its own.
        label = f"{entry.quantity} ({entry.name})" if entry.quantity in drawn else entry.quantity
        drawn.add(entry.quantity)
        yield panel(
            label,
            entry.quantity,
            limit=entry.ends if entry.center is not None else entry.limit,
            is_maximum=entry.is_maximum,
            probability=best.probability if best else None,
        )
    for name, values in columns.items():
        varies = np.ptp(values) > _SMALLEST_SPREAD * np.abs(values).max()
        if name not in drawn and name in main_quantities(result.quantities) and varies:
            yield panel(name, name)


def _exceedance_panels(result: StudyResult) -> Iterator[Panel]:
    """The probability of each quantity to lie beyond a limit, against the limit."""
    for name, curve in result.exceedances.items():
        entries = [
            entry
            for entry in result.requirements
            if entry.quantity == name and entry.center is None and entry.is_maximum == curve.is_maximum
        ]
        ax = figures.draw_exceedance(
            curve,
            label=name,
            unit=result.quantities[name].unit,
            limits=[entry.limit for entry in entries],
            allowed=entries[0].allowed_probability if len(entries) == 1 else None,
        )
        side = "above" if curve.is_maximum else "below"
        yield Panel.of(Section.EXCEEDANCES, name, f"probability of {name} {side} a limit, against the limit", ax)


def _component_panels(result: StudyResult, components: dict[str, Component]) -> Iterator[Panel]:
    if components:
        ax = figures.draw_spectra({name: part.subspace for name, part in components.items()})
        yield Panel.of(Section.EIGENVALUES, "eigenvalues", "eigenvalues of all components over the largest ones", ax)
    shown = set()
    for name, part in components.items():
        whole = result.quantities[name].part_of
        if whole in shown:
            # The parts of a quantity look alike: one stands for all.
            continue
        shown.update({whole} - {""})
        unit = result.quantities[name].unit
        ax = figures.draw_sufficient_summary(part.active, part.values, part.regression, label=name, unit=unit)
        yield Panel.of(Section.SUMMARIES, name, f"{name} against its active variable, with the regression", ax)


def _bar(row: Estimate, label: str) -> ProbabilityBar:
    return ProbabilityBar(
        label, row.probability, row.lower95, row.upper95, row.evaluations, row.gradients, row.converged
    )


def _halved_bar(half: HalvedTolerance, gain: Gain) -> ProbabilityBar:
    label = f"half the scatter:\n{half.tolerance.replace('_', ' ')}"
    if not gain.is_resolved:
        # No bar: it would show how few the runs are.
        return ProbabilityBar(label, evaluations=half.evaluations, message=str(gain))
    return ProbabilityBar(
        label, half.probability, half.lower95, half.upper95, half.evaluations, converged=half.converged
    )
