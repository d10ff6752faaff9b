"""One page that says what a study found: self-contained, from the files that the study wrote."""

import base64
import dataclasses
import json
import math
import os
import re
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import Any

import jinja2
import markupsafe

from satsep_ot.methods.common.manifest import Manifest
from satsep_ot.methods.common.storage import writeWhole
from satsep_ot.model.case import SYSTEM
from satsep_ot.studies.telling.advice import advice_sentences, tightening_advice
from satsep_ot.studies.telling.document import ReportError, read_json, read_results, read_text
from satsep_ot.studies.telling.failure_mixture import mixture_lines
from satsep_ot.studies.telling.figures.axes import power_of_ten
from satsep_ot.studies.telling.fleet import fleet_lines
from satsep_ot.studies.telling.plain_data import from_plain, to_plain
from satsep_ot.studies.telling.remarks import audit_remarks, limits, remarks
from satsep_ot.studies.telling.results import Estimate, RequirementEntry, Section, StudyResult, main_quantities
from satsep_ot.studies.telling.tolerance_curves import curve_lines, curve_rows
from satsep_ot.studies.telling.update_results import (
    UpdateResult,
    misfit_sentence,
    outlook_sentences,
    sampling_sentence,
    shown_value,
)
from satsep_ot.studies.telling.verdicts import (
    Status,
    Verdict,
    any_violation,
    best_estimate,
    contradiction,
    headline,
    judge_all,
)
from satsep_ot.studies.telling.words import (
    METHOD_DESCRIPTIONS,
    fewer_than,
    in_words,
    interval_text,
    number_text,
    probability_text,
    with_space,
)

_SYMBOLS = {
    Status.MET: "✓", Status.NOT_MET: "✗", Status.UNDECIDED: "?", Status.NO_ALLOWANCE: "–", Status.UNKNOWN: "–",
}  # fmt: skip

UPDATE = "update.json"  # what `satsep-ot update --study` keeps beside the results of a study
_CURE = "the command of the study with --resume makes it again"


def render_report(directory: str | os.PathLike) -> str:
    """The page, as text, from the results of a study.

    Parameters
    ----------
    directory : str or path
        With results.json, motion.json, case.toml and figures, as `SeparationStudy.save` writes them, and update.json
        where `satsep-ot update` has written it.

    Returns
    -------
    html : str
        Figures, data and script are inside; it loads nothing.

    Raises
    ------
    ReportError
        If a file is missing or is not what a study writes.
    """
    directory = Path(directory)
    _check(directory, "results.json", "motion.json", "case.toml")
    result = read_results(directory / "results.json")
    motion, case_text = read_json(directory / "motion.json"), read_text(directory / "case.toml")
    _check(directory, *(f"figures/{Path(figure.file).name}" for figure in result.figures))
    pictures: dict[str, list] = {section: [] for section in Section}
    for figure in result.figures:
        picture = base64.b64encode(read_text(directory / "figures" / Path(figure.file).name).encode()).decode()
        pictures[figure.section].append(
            {"name": figure.name, "text": figure.text, "source": f"data:image/svg+xml;base64,{picture}"}
        )
    try:
        return _render(result, pictures, motion, case_text, _ground_tests(directory / UPDATE))
    except (KeyError, TypeError, jinja2.UndefinedError) as error:
        raise ReportError(
            f"{directory / 'results.json'}: its parts do not belong together ({error}); run the study again"
        ) from error


def _check(directory, *names):
    """Refuse a file that is not as the study wrote it; version 0.1.0 kept no checksums."""
    try:
        manifest = Manifest(directory)
    except ValueError as error:
        raise ReportError(f"{error}; {_CURE}") from error
    for path in (directory / name for name in names):
        if manifest.isThere() and path.exists() and manifest.isChanged(path):
            raise ReportError(f"{path}: it is not as the study wrote it; {_CURE}")


def write_report(directory: str | os.PathLike) -> Path:
    """Write report.html beside the results of a study; it appears whole or not at all.

    Parameters
    ----------
    directory : str or path

    Returns
    -------
    path : :class:`pathlib.Path`

    Raises
    ------
    ReportError
        As for `render_report`.
    """
    text = render_report(directory).encode()
    return writeWhole(Path(directory) / "report.html", lambda stream: stream.write(text))


def _ground_tests(path):
    """The section on ground tests; empty where there are none."""
    if not path.exists():
        return ""
    try:
        update = from_plain(UpdateResult, read_json(path))
    except ValueError as error:
        raise ReportError(f"{path}: it is not what `satsep-ot update` writes ({error}); make it again") from error
    template = (resources.files("satsep_ot.studies.telling") / "update.html").read_text(encoding="utf-8")
    return markupsafe.Markup(
        _environment()
        .from_string(template)
        .render(
            update=update,
            misfit_sentence=misfit_sentence,
            outlook_sentences=outlook_sentences,
            sampling_sentence=sampling_sentence,
            shown_value=shown_value,
        )
    )


def _environment():
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["probability"] = probability_text
    environment.filters["keep"] = _keep_numbers
    environment.filters["behind"] = with_space
    environment.filters["number"] = number_text
    environment.filters["words"] = lambda name: name.replace("_", " ")
    return environment


def _render(
    result: StudyResult,
    pictures: dict[str, list],
    motion: dict[str, Any],
    case_text: str,
    ground_tests: str,
) -> str:
    template = (resources.files("satsep_ot.studies.telling") / "report.html").read_text(encoding="utf-8")
    by_requirement = result.rows_by_requirement()
    best = {name: best_estimate(rows) for name, rows in by_requirement.items()}
    advice, verdicts, told = tightening_advice(result), judge_all(result), any_violation(result)
    page = _environment().from_string(template)
    return page.render(
        result=result,
        pictures=pictures,
        answers=list(zip(result.requirements, verdicts, strict=True)),
        headline=headline(verdicts),
        symbols=_SYMBOLS,
        chart=IntervalChart.of(result.requirements, verdicts),
        big=_big,
        small=_small,
        caution=audit_remarks(result),
        main=main_quantities(result.quantities),
        files=["results.json", "motion.json", "case.toml", *result.force_tables, "origin.json", "manifest.json"],
        units=_script_json({name: result.quantities[name].unit for name in result.exceedances}),
        exceedances=_script_json(to_plain(result.exceedances)),
        by_requirement=by_requirement,
        best=best,
        any_requirement=None if told is None else told.row,
        doubt=contradiction(by_requirement.get(SYSTEM, ())),
        interval=interval_text,
        in_words=in_words,
        advice=advice,
        sizes=list(curve_lines(result.curves)),
        curve_rows={name: curve_rows(found) for name, found in result.curves.items()},
        classes=[] if result.classes is None else list(result.classes.lines()),
        mixture=list(mixture_lines(result.failures)),
        fleet=list(fleet_lines(result.fleet)),
        advised=advice_sentences(result),
        remarks=remarks(result),
        descriptions={method: METHOD_DESCRIPTIONS[method] for method in result.sizes.methods},
        limits=limits(result),
        chosen=max(result.violations, key=lambda name: _probability(best.get(name)), default=""),
        motion=_script_json(motion),
        case_text=case_text,
        ground_tests=ground_tests,
    )


@dataclasses.dataclass(frozen=True)
class IntervalChart:
    """The intervals of all requirements on one logarithmic axis, in percent of its width.

    Attributes
    ----------
    low, high : int
        Powers of ten at its ends.
    """

    low: int
    high: int

    @staticmethod
    def of(requirements: Iterable[RequirementEntry], verdicts: Iterable[Verdict]) -> "IntervalChart":
        """The axis that holds every interval and every allowed probability."""
        numbers = [entry.allowed_probability for entry in requirements]
        for verdict in verdicts:
            if verdict.row is not None:
                numbers += [verdict.row.lower95 or verdict.row.upper95, verdict.row.upper95]
        positive = [number for number in numbers if number] or [1e-3]
        # What is far below all others would squeeze these into a corner.
        low = max(math.floor(math.log10(min(positive))), -12)
        return IntervalChart(low, max(math.ceil(math.log10(max(positive))), low + 1))

    def place(self, probability: float) -> float:
        """Where a probability stands."""
        if probability <= 0.0:
            return 0.0
        return min(max(100.0 * (math.log10(probability) - self.low) / (self.high - self.low), 0.0), 100.0)

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Place and text of each label."""
        step = 1 + (self.high - self.low) // 6
        return [(self.place(10.0**power), power_of_ten(10.0**power)) for power in range(self.low, self.high + 1, step)]


def _big(row: Estimate) -> str:
    """The answer in a few characters: never a bare 0."""
    if row.probability == 0.0 and row.upper95 is not None:
        return fewer_than(row.upper95)
    return probability_text(row.probability)


def _small(row: Estimate) -> str:
    """What stands below the answer."""
    if row.probability == 0.0:
        return f"with 95 % confidence; none in {row.evaluations:,} runs"
    return f"{interval_text(row.lower95, row.upper95)} (95 %)"


def _probability(row: Estimate | None) -> float:
    return 0.0 if row is None or row.probability is None else row.probability


def _keep_numbers(text):
    """The text with numbers such as 2.4e-4 that no line breaks."""
    return markupsafe.Markup(
        re.sub(r"[0-9.]+e-[0-9]+", r'<span class="keep">\g<0></span>', str(markupsafe.escape(text)))
    )


def _script_json(data):
    """JSON that no closing tag inside can end."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")
