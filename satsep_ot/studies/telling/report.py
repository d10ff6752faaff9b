"""One page that says what a study found: self-contained, from the files that the study wrote."""

import base64
import json
import os
import re
from importlib import resources
from pathlib import Path

import jinja2
import markupsafe

from satsep_ot.methods.common.storage import writeWhole
from satsep_ot.model.case import SYSTEM
from satsep_ot.studies.drivers import with_space
from satsep_ot.studies.telling.verdicts import (
    MET,
    NO_ALLOWANCE,
    NO_ESTIMATE,
    NOT_MET,
    TOO_RARE,
    UNDECIDED,
    UNKNOWN,
    Verdict,
    best_row,
    contradiction,
    digits,
    headline,
    in_words,
    is_resolved,
)

_SYMBOLS = {MET: "✓", NOT_MET: "✗", UNDECIDED: "?", NO_ALLOWANCE: "–", UNKNOWN: "–"}
# How often the 95 % interval of ActiveSubspace held a probability that is known: (problem, repetitions, percent), as
# tests/benchmarks/reliability_coverage.py printed it.
COVERAGE = {
    "lateral rate": ("reference-lateral-rate", 200, 96.5),
    "spin": ("reference-spin", 200, 96.5),
    "any requirement": ("reference-any-requirement", 200, 98.5),
    "axial velocity": ("reference-axial-velocity", 60, 96.7),
    "clearance": ("reference-clearance", 16, 100.0),
}
# The sections of the page that show figures, and the heading of each group of them.
_SECTIONS = ("separation", "answer", "drivers", "tightened", "densities", "eigenvalues", "summaries", "methods")


class ReportError(ValueError):
    """A directory holds no results that a report can be made of; the message says what is missing.

    Examples
    --------
    >>> from satsep_ot.studies.telling.report import ReportError, render_report
    >>> try:
    ...     render_report("nowhere")
    ... except ReportError as error:
    ...     print("results.json" in str(error))
    True
    """


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
    results = _read_json(directory / "results.json")
    try:
        if not results["complete"]:
            raise ReportError(f"{directory}: the study was interrupted; run it to its end for a report")
        return _render(results, _read_json(directory / "motion.json"), _read(directory / "case.toml"), directory)
    except (KeyError, TypeError, AttributeError, jinja2.UndefinedError) as error:
        raise ReportError(
            f"{directory / 'results.json'} is not what this version's study writes ({error}); run the study again"
        ) from error


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


def _read(path):
    try:
        return path.read_text(encoding="utf-8")
    except FileNotFoundError as error:
        raise ReportError(
            f"{path}: there is no such file; a report is made from what `satsep-ot study` writes"
        ) from error
    except (OSError, UnicodeDecodeError) as error:
        raise ReportError(f"{path}: the file cannot be read ({getattr(error, 'strerror', None) or error})") from error


def _read_json(path):
    try:
        document = json.loads(_read(path))
    except json.JSONDecodeError as error:
        raise ReportError(f"{path}: not valid JSON: {error}") from error
    if not isinstance(document, dict):
        raise ReportError(f"{path}: it must hold an object, as `satsep-ot study` writes it")
    return document


def _render(results, motion, case_text, directory):
    environment = jinja2.Environment(
        autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["probability"] = digits
    environment.filters["keep"] = _keep_numbers
    environment.filters["behind"] = with_space
    environment.filters["words"] = lambda name: name.replace("_", " ")
    template = (resources.files("satsep_ot.studies.telling") / "report.html").read_text(encoding="utf-8")
    figures = {section: [] for section in _SECTIONS}
    for figure in results["figures"]:
        picture = base64.b64encode(_read(directory / "figures" / Path(figure["file"]).name).encode()).decode()
        figures[figure["section"]].append({**figure, "source": f"data:image/svg+xml;base64,{picture}"})
    by_requirement = {}
    for row in results["rows"]:
        by_requirement.setdefault(row["requirement"], []).append(row)
    best = {name: best_row(rows) for name, rows in by_requirement.items()}
    advice = _advice(results, best)
    return environment.from_string(template).render(
        **results,
        results=results,
        pictures=figures,
        by_requirement=by_requirement,
        best=best,
        system=SYSTEM,
        doubt=contradiction(by_requirement.get(SYSTEM, [])),
        symbols=_SYMBOLS,
        headline=headline([Verdict(**verdict, row=None) for verdict in results["verdicts"]]),
        in_words=in_words,
        advice=advice,
        # Nothing is to be tightened where no violation is known, or half of the tolerance could not be estimated.
        advised={
            name: rows[0]
            for name, rows in advice.items()
            if best.get(name) and best[name]["probability"] and rows[0]["half"] and rows[0]["factor"] != NO_ESTIMATE
        },
        coverage=_coverage(),
        extremes={name: _extremes(violation) for name, violation in results["violations"].items()},
        chosen=max(
            results["violations"], key=lambda name: best[name]["probability"] if best.get(name) else 0.0, default=""
        ),
        motion=_script_json(motion),
        case_text=case_text,
    )


def _coverage():
    """What was measured of the intervals, in words."""
    parts = [f"{name} {share:g} % of {repetitions}" for name, (_, repetitions, share) in COVERAGE.items()]
    return ", ".join(parts)


def _keep_numbers(text):
    """The text with numbers such as 2.4e-4 that no line breaks."""
    return markupsafe.Markup(
        re.sub(r"[0-9.]+e-[0-9]+", r'<span class="keep">\g<0></span>', str(markupsafe.escape(text)))
    )


def _script_json(data):
    """JSON that no closing tag inside can end."""
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")


def _advice(results, best):
    """What tightening each tolerance buys: requirement -> rows, the tolerance that buys most first."""
    advice = {}
    for requirement, ratios in results["ratios"].items():
        now = best.get(requirement)
        halved = {row["tolerance"]: row for row in results["tightened"].get(requirement, [])}
        names = dict.fromkeys([*list(ratios)[:5], *halved])
        advice[requirement] = [
            {
                "tolerance": name,
                "scatter": results["tolerances"][name]["scatter"],
                "ratio": ratios.get(name),
                "half": halved.get(name),
                "resolved": name in halved
                and halved[name]["probability"] is not None
                and is_resolved(now, halved[name]),
                "factor": _gain(now, halved.get(name)),
            }
            for name in names
        ]
    return {requirement: rows for requirement, rows in advice.items() if rows}


def _gain(now, then):
    """In words, how much less probable a violation has become."""
    if then is not None and then["probability"] is None:
        return NO_ESTIMATE
    if now is None or then is None or not now["probability"]:
        return ""
    if not is_resolved(now, then):
        return TOO_RARE
    if then["probability"] <= 0.0:
        return "no violation left in these runs"
    if then["upper95"] >= now["lower95"] and then["lower95"] <= now["upper95"]:
        return "no difference that these runs show"
    ratio = now["probability"] / then["probability"]
    times, word = (ratio, "less") if ratio > 1.0 else (1.0 / ratio, "more")
    return f"{times:.2g} times {word}" if times < 100.0 else f"more than 100 times {word}"


def _extremes(violation, count=6):
    """The inputs that are furthest from their means in the most likely violation."""
    return sorted(violation["inputs"], key=lambda row: -abs(row["standard"]))[:count]
