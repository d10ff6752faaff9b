"""Designs compared: probabilities of violating the same requirements, what differs, and which difference matters."""

import copy
import dataclasses
import math
import tomllib
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.model.case import SYSTEM, Case, CaseError, case_from_data, load_uncertain_case
from satsep_ot.model.inputs import ParameterMap, joint_distribution
from satsep_ot.studies.quick_probability import quick_probability
from satsep_ot.studies.telling.design_comparison import DesignChange, DesignComparison, DesignEstimate
from satsep_ot.studies.telling.document import read_results
from satsep_ot.studies.telling.results import StudyResult
from satsep_ot.studies.telling.verdicts import best_estimate
from satsep_ot.studies.true_violations import true_violations

_BLOCK = 16_384
# With fewer violations among the runs with common numbers, runs that look for violations give the probability.
_FEW = 100
# What two case files may say otherwise of the same design.
_NOT_COMPARED = ("name", "description", "requirements")


@dataclasses.dataclass(frozen=True)
class Design:
    """A design: its case, and the study of it where that is finished.

    Attributes
    ----------
    name : str
    case : :class:`satsep_ot.model.case.Case`
    file : str
        Of the case; its tables are beside it.
    result : StudyResult or None
    """

    name: str
    case: Case
    file: str
    result: StudyResult | None = None

    @staticmethod
    def load(source: str) -> "Design":
        """From a case file, the name of a case in the package, or the directory of a finished study.

        Raises
        ------
        CaseError, ReportError
            In one sentence, if it cannot be used.
        """
        path = Path(source)
        if path.is_dir():
            result = read_results(path / "results.json")
            case = load_uncertain_case(path / "case.toml")
            return Design(path.name or str(path), case, str(path / "case.toml"), result)
        return Design(path.stem if path.suffix else source, load_uncertain_case(source), str(path))


def compare_designs(
    designs: Sequence[Design],
    runs: int = 100_000,
    seed: int = 0,
    progress: Callable[[str, float], None] = lambda label, share: None,
) -> DesignComparison:
    """Compare designs by runs with common random numbers.

    Parameters
    ----------
    designs : sequence of Design
        At least two; the others are compared with the first.
    runs : int
        Of each design, and of the first one with each difference alone.
    seed : int
    progress : callable
        Called with what is being done and the share of it that is done.

    Returns
    -------
    comparison : DesignComparison

    Raises
    ------
    ValueError
        There are fewer than two designs, or their requirements differ.
    """
    _check(designs)
    names = [one.name for one in designs]
    if len(set(names)) < len(names):
        names = [one.file for one in designs]
    first = designs[0]
    units = quantity_table(first.case.separation)
    labels = [*(entry.name for entry in first.case.requirements), SYSTEM]
    violated = []
    for place, one in enumerate(designs):
        progress(f"{runs:,} runs of {names[place]}", 0.5 * place / len(designs))
        violated.append(_violations(one.case, runs, seed))
    estimates = {}
    for column, label in enumerate(labels):
        row = []
        for one, flags in zip(designs, violated, strict=True):
            progress(f"{label}: {one.name}", 0.5)
            estimate = _estimate(one, label, int(flags[:, column].sum()), runs, seed)
            if one is not first:
                estimate = dataclasses.replace(estimate, **_difference(violated[0][:, column], flags[:, column]))
            row.append(estimate)
        estimates[label] = tuple(row)
    changes = {}
    for place, one in enumerate(designs[1:], start=1):
        progress(f"what differs in {names[place]}", 0.6 + 0.4 * place / len(designs))
        changes[names[place]] = tuple(_changes(first, one, labels, runs, seed))
    return DesignComparison(
        tuple(names),
        {entry.name: f"{entry} {units[entry.quantity].unit}" for entry in first.case.requirements},
        {entry.name: entry.allowed_probability for entry in first.case.requirements},
        runs,
        estimates,
        changes,
    )


def _check(designs):
    if len(designs) < 2:
        raise ValueError("there is nothing to compare one design with; give at least two")
    first = designs[0]
    if not first.case.requirements:
        raise ValueError(f"{first.name}: the case has no requirements; give at least one [[requirements]]")
    for other in designs[1:]:
        one, two = ([(entry.name, str(entry), entry.allowed_probability) for entry in design.case.requirements]
                    for design in (first, other))  # fmt: skip
        differing = [entry for entry in (*one, *two) if (entry in one) != (entry in two)]
        if differing:
            name, text, _ = differing[0]
            raise ValueError(
                f"the requirements of {first.name} and {other.name} differ, for example {name} ({text}); designs are "
                "compared by the same requirements, with the same limits and allowed probabilities"
            )


def _violations(case, runs, seed):
    """Which requirements each run violates; an input has the same numbers in every design that has it."""
    distribution = joint_distribution(case.inputs, case.copula)
    inverse = distribution.getInverseIsoProbabilisticTransformation()
    scatter = ParameterMap(case.inputs, case.separation)
    streams = [np.random.default_rng([seed, zlib.crc32(row.name.encode())]) for row in case.inputs]
    found = []
    for start in range(0, runs, _BLOCK):
        size = min(_BLOCK, runs - start)
        standard = np.column_stack([stream.standard_normal(size) for stream in streams])
        inputs = np.array(inverse(ot.Sample(standard)))
        found.append(true_violations(case.separation, case.requirements, scatter.parameters(inputs)))
    return np.concatenate(found)


def _estimate(design, label, count, runs, seed):
    """The probability by the finished study, by the runs, or by more runs that look for violations."""
    row = None if design.result is None else best_estimate(design.result.rows_of(label))
    if row is not None:
        return DesignEstimate(row.probability, row.lower95, row.upper95, f"its study, {row.method}", row.evaluations)
    lower, upper = clopperPearson(count, runs)
    if count < _FEW:
        found = quick_probability(design.case, label, seed)
        # Few runs that violate nothing bound a probability less than the many that are common.
        is_sharper = found.upper95 is not None and (bool(found.probability) or found.upper95 < upper)
        if found.converged and is_sharper:
            return DesignEstimate(
                found.probability, found.lower95, found.upper95, f"{found.runs:,} runs of its own", found.runs
            )
    return DesignEstimate(count / runs, lower, upper, f"{runs:,} common runs", runs)


def _difference(first, other):
    """The difference of two probabilities from paired runs: only those that differ tell of it."""
    runs = len(first)
    more, less = int(np.count_nonzero(other & ~first)), int(np.count_nonzero(first & ~other))
    (more_low, more_high), (less_low, less_high) = clopperPearson(more, runs), clopperPearson(less, runs)
    value = (more - less) / runs
    return {
        "difference": value,
        "difference_lower95": value - math.hypot(more / runs - more_low, less_high - less / runs),
        "difference_upper95": value + math.hypot(more_high - more / runs, less / runs - less_low),
    }


def _changes(first, other, labels, runs, seed):
    """What differs, with what each difference alone does to the first design."""
    one, two = _said(first), _said(other)
    keys = [key for key in dict.fromkeys([*one, *two]) if one.get(key) != two.get(key)]
    alone = {key: _changed(first, other, [key]) for key in keys}
    # Keys that make no case alone are changed together with the others of their table.
    joined: dict[str, list[str]] = {}
    for key in (key for key in keys if alone[key] is None):
        joined.setdefault(key.split(".")[0], []).append(key)
    parts = [([key], case) for key, case in alone.items() if case is not None]
    parts += [(members, _changed(first, other, members)) for members in joined.values()]
    for members, case in parts:
        pairs = [_shown_pair(one.get(key), two.get(key)) for key in members]
        texts = [", ".join(side) for side in zip(*pairs, strict=True)]
        yield DesignChange(tuple(members), *texts, {} if case is None else _probabilities(case, labels, runs, seed))


def _probabilities(case, labels, runs, seed):
    counts = _violations(case, runs, seed).sum(axis=0)
    found = {}
    for label, count in zip(labels, counts.tolist(), strict=True):
        quick = quick_probability(case, label, seed) if count < _FEW else None
        found[label] = count / runs if quick is None or not quick.converged else quick.probability
    return found


def _said(design: Design) -> dict[str, Any]:
    """What a case file says, by key; a table of several and an uncertain input stand for themselves."""
    said: dict[str, Any] = {}
    for name, value in tomllib.loads(design.case.text).items():
        if name in _NOT_COMPARED:
            continue
        if isinstance(value, dict):
            said |= {f"{name}.{key}": inner for key, inner in value.items()}
        else:
            said[name] = value
    for name, text in design.case.files.items():
        # The same name of a file may hold other numbers.
        said[f"springs.table of {name}"] = text
    return said


def _changed(first, other, keys):
    """The first case with some keys as the other one has them; None where that is no case."""
    data, source = copy.deepcopy(tomllib.loads(first.case.text)), tomllib.loads(other.case.text)
    file = first.file
    for key in keys:
        table, _, inner = key.partition(".")
        if table == "springs" and inner.startswith("table"):
            inner, file = "table", other.file
        holder, origin = (data, source) if not inner else (data.setdefault(table, {}), source.get(table, {}))
        name = inner or table
        if name in origin:
            holder[name] = origin[name]
        else:
            holder.pop(name, None)
    try:
        return case_from_data(data, file)
    except CaseError:
        return None


def _shown_pair(first, other):
    """Two values in words; of an input only the keys that differ."""
    if isinstance(first, dict) and isinstance(other, dict):
        keys = [key for key in dict.fromkeys([*first, *other]) if first.get(key) != other.get(key)]
        first, other = (", ".join(f"{key} {_shown(value.get(key))}" for key in keys) for value in (first, other))
    return _shown(first), _shown(other)


def _shown(value):
    text = "nothing" if value is None else str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."
