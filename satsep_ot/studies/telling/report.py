"""One page that says what a study found: self-contained, from the files that the study wrote."""

import base64
import json
import os
import re
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
from satsep_ot.studies.telling.fleet import fleet_lines
from satsep_ot.studies.telling.remarks import limits, remarks
from satsep_ot.studies.telling.results import Estimate, Section, StudyResult
from satsep_ot.studies.telling.verdicts import Status, best_estimate, contradiction, headline, judge_all
from satsep_ot.studies.telling.words import (
    METHOD_DESCRIPTIONS,
    in_words,
    interval_text,
    probability_text,
    with_space,
)

_SYMBOLS = {
    Status.MET: "✓", Status.NOT_MET: "✗", Status.UNDECIDED: "?", Status.NO_ALLOWANCE: "–", Status.UNKNOWN: "–",
}  # fmt: skip

_CURE = "the command of the study with --resume makes it again"


def render_report(directory: str | os.PathLike) -> str:
    """The page, as text, from the results of a study.

    Parameters
    ----------
    directory : str or path
        With results.json, motion.json, case.toml and figures, as `SeparationStudy.save` writes them.

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
        return _render(result, pictures, motion, case_text)
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


def _render(result: StudyResult, pictures: dict[str, list], motion: dict[str, Any], case_text: str) -> str:
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["probability"] = probability_text
    environment.filters["keep"] = _keep_numbers
    environment.filters["behind"] = with_space
    environment.filters["words"] = lambda name: name.replace("_", " ")
    template = (resources.files("satsep_ot.studies.telling") / "report.html").read_text(encoding="utf-8")
    by_requirement = result.rows_by_requirement()
    best = {name: best_estimate(rows) for name, rows in by_requirement.items()}
    advice, verdicts = tightening_advice(result), judge_all(result)
    return environment.from_string(template).render(
        result=result,
        pictures=pictures,
        answers=list(zip(result.requirements, verdicts, strict=True)),
        headline=headline(verdicts),
        symbols=_SYMBOLS,
        by_requirement=by_requirement,
        best=best,
        any_requirement=best.get(SYSTEM),
        doubt=contradiction(by_requirement.get(SYSTEM, ())),
        interval=interval_text,
        in_words=in_words,
        advice=advice,
        mixture=list(mixture_lines(result.failures)),
        fleet=list(fleet_lines(result.fleet)),
        advised=advice_sentences(result),
        remarks=remarks(result),
        descriptions={method: METHOD_DESCRIPTIONS[method] for method in result.sizes.methods},
        limits=limits(result),
        chosen=max(result.violations, key=lambda name: _probability(best.get(name)), default=""),
        motion=_script_json(motion),
        case_text=case_text,
    )


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
