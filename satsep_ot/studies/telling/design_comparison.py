"""Designs side by side: a table for a terminal, lines, and a page."""

import base64
import dataclasses
import io
from collections.abc import Iterator
from importlib import resources

import jinja2
from rich.table import Table

from satsep_ot.studies.telling import figures
from satsep_ot.studies.telling.figures import ProbabilityBar
from satsep_ot.studies.telling.tables import escape, make_table, narrow
from satsep_ot.studies.telling.words import interval_text, probability_text


@dataclasses.dataclass(frozen=True)
class DesignEstimate:
    """The probability of violating a requirement with one design.

    Attributes
    ----------
    probability, lower95, upper95 : float or None
    source : str
        By which runs.
    runs : int
        How many.
    difference, difference_lower95, difference_upper95 : float or None
        To the first design, by runs with common random numbers; None for the first design.
    """

    probability: float | None
    lower95: float | None
    upper95: float | None
    source: str
    runs: int
    difference: float | None = None
    difference_lower95: float | None = None
    difference_upper95: float | None = None

    @property
    def difference_text(self) -> str:
        """The difference in words."""
        if self.difference is None or self.difference_lower95 is None or self.difference_upper95 is None:
            return ""
        bounds = f"{self.difference:+.2g} ({self.difference_lower95:+.2g} to {self.difference_upper95:+.2g})"
        if self.difference_lower95 > 0.0:
            return f"more: {bounds}"
        return f"less: {bounds}" if self.difference_upper95 < 0.0 else f"no difference shown: {bounds}"


@dataclasses.dataclass(frozen=True)
class DesignChange:
    """What differs between a design and the first one, and what that alone does to the first one.

    Attributes
    ----------
    keys : tuple of str
        Of the case file; several where they can only be changed together.
    first, other : str
        What the two case files say.
    probabilities : dict of str to float or None
        By requirement, the probability of the first design with this change alone; empty where it cannot be made alone.
    """

    keys: tuple[str, ...]
    first: str
    other: str
    probabilities: dict[str, float | None]

    @property
    def text(self) -> str:
        """What has changed."""
        return f"{', '.join(self.keys)}: {self.first} -> {self.other}"


@dataclasses.dataclass(frozen=True)
class DesignComparison:
    """Several designs, judged by the same requirements.

    Attributes
    ----------
    designs : tuple of str
    requirements : dict of str to str
        Their limits in words, with units.
    allowed : dict of str to float or None
    runs : int
        Runs of each design with common random numbers.
    estimates : dict of str to tuple of DesignEstimate
        By requirement, and "any requirement", one for each design.
    changes : dict of str to tuple of DesignChange
        By design, from the second on.
    """

    designs: tuple[str, ...]
    requirements: dict[str, str]
    allowed: dict[str, float | None]
    runs: int
    estimates: dict[str, tuple[DesignEstimate, ...]]
    changes: dict[str, tuple[DesignChange, ...]]

    def explanation(self, design: str, requirement: str) -> str:
        """Which change explains most of the difference of a design from the first one, in words; empty for none."""
        place = self.designs.index(design)
        first, other = self.estimates[requirement][0], self.estimates[requirement][place]
        if other.difference is None or not (first.probability or other.probability):
            return ""
        now = first.probability or 0.0
        known = [
            (change, value - now)
            for change in self.changes[design]
            if (value := change.probabilities.get(requirement)) is not None
        ]
        sign = 1.0 if other.difference >= 0.0 else -1.0
        change, effect = max(known, key=lambda item: sign * item[1], default=(None, 0.0))
        if change is None or sign * effect <= 0.0:
            return f"{design}, {requirement}: no single change explains the difference"
        return (
            f"{design}, {requirement}: {change.text} explains most; alone it changes "
            f"{probability_text(now)} to {probability_text(now + effect)}"
        )

    def explanations(self) -> Iterator[str]:
        """One sentence for each design and requirement that differ by more than chance."""
        for place, design in enumerate(self.designs[1:], start=1):
            for requirement, row in self.estimates.items():
                lower, upper = row[place].difference_lower95, row[place].difference_upper95
                if lower is not None and upper is not None and (lower > 0.0 or upper < 0.0):
                    yield self.explanation(design, requirement)


def comparison_table(found: DesignComparison) -> Table:
    """Probability and interval of each design, and the difference from the first one."""
    table = narrow(make_table(f"Designs, {found.runs:,} runs of each with common random numbers", "design"))
    for column in ("probability", "95 % interval", "by", "difference from the first"):
        table.add_column(column, overflow="fold")
    for requirement, row in found.estimates.items():
        limit = found.requirements.get(requirement, "")
        table.add_row(f"[bold]{escape(requirement)}[/bold]", escape(limit))
        for design, one in zip(found.designs, row, strict=True):
            table.add_row(
                escape(design),
                probability_text(one.probability),
                interval_text(one.lower95, one.upper95),
                one.source,
                one.difference_text,
            )
    return table


def change_lines(found: DesignComparison) -> Iterator[str]:
    """What differs between the designs, then what explains most."""
    for design, changes in found.changes.items():
        if not changes:
            yield f"{design}: nothing differs from {found.designs[0]}"
        for change in changes:
            alone = ", ".join(f"{name} {probability_text(value)}" for name, value in change.probabilities.items())
            yield f"{design}: {change.text}; alone: {alone}" if alone else f"{design}: {change.text}; not alone"
    yield from found.explanations()


def comparison_page(found: DesignComparison) -> str:
    """A page of its own: it loads nothing."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True)
    template = (resources.files("satsep_ot.studies.telling") / "comparison.html").read_text(encoding="utf-8")
    return environment.from_string(template).render(
        found=found,
        probability=probability_text,
        interval=interval_text,
        pictures={name: _picture(found, name) for name in found.estimates},
        lines=list(change_lines(found)),
    )


def _picture(found, requirement):
    bars = [
        ProbabilityBar(design, one.probability, one.lower95, one.upper95, one.runs, 0, True)
        for design, one in zip(found.designs, found.estimates[requirement], strict=True)
    ]
    stream = io.BytesIO()
    figures.save_figure(figures.draw_probabilities(bars, title=requirement).figure, stream, "svg")
    return f"data:image/svg+xml;base64,{base64.b64encode(stream.getvalue()).decode()}"
