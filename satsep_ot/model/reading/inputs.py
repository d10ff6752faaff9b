"""Uncertain inputs and their correlations, from [inputs] and [[correlation]]."""

import itertools
import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import openturns as ot

from satsep_ot.dynamics.parameter_vector import Sign
from satsep_ot.dynamics.separation import Separation
from satsep_ot.model.distributions import build_distribution, normal_copula
from satsep_ot.model.inputs import (
    Target,
    ToleranceClass,
    UncertainInput,
    check_range,
    nominal_parameters,
    scatter_targets,
)
from satsep_ot.model.parameters import INPUT, SCATTER_KEYS, parameter_rows
from satsep_ot.model.reading.table import CaseError, Table, example_of, shown, shown_key
from satsep_ot.model.spelling import did_you_mean
from satsep_ot.model.text import parsed_number
from satsep_ot.model.values import Name, Number, Unit
from satsep_ot.openturns_adapter import REFUSALS

# Springs with a force-stroke table do not have these.
_LINEAR_ONLY = ("springs.stiffness", "springs.deformation")


def read_inputs(file: str, entries: Any, separation: Separation) -> tuple[UncertainInput, ...]:
    """The uncertain inputs, in the order of the file.

    Parameters
    ----------
    file : str
        Name of the file, for messages.
    entries : dict
        What [inputs] holds.
    separation : Separation
        The nominal one.

    Returns
    -------
    inputs : tuple of UncertainInput

    Raises
    ------
    CaseError
        If an entry is not allowed.
    """
    if not isinstance(entries, dict):
        raise CaseError(
            f"{file}: inputs = {shown(entries)}, but it must be a table with one entry for each uncertain input"
        )
    nominal, targets = nominal_parameters(separation), scatter_targets(separation)
    inputs: dict[str, UncertainInput] = {}
    for name, entry in entries.items():
        path = f"inputs.{shown_key(name)}"
        if not Name().accepts(name):
            raise CaseError(f"{file}: {path} must have {Name().allowed()}")
        if not isinstance(entry, dict):
            raise CaseError(
                f'{file}: {path} = {shown(entry)}, but it must be a table such as {{ quantity = "...", sigma = 1.0 }}'
            )
        # The parameters of a distribution are further keys: checked where it is built.
        table = Table(file, INPUT, entry, path, is_open="distribution" in entry)
        for input_name, target in _targets(table, name, targets):
            if input_name in inputs:
                raise table.problem(f"{path} gives a second input the name '{input_name}'; names must differ")
            row = _input(table, input_name, target, nominal)
            inputs[input_name] = replace(
                row, entry=name, group=table.read("group") or "", is_shared=table.read("shared")
            )
    groups = _default_groups(inputs.values())
    rows = tuple(replace(row, group=row.group or groups[row.entry]) for row in inputs.values())
    _check_classes(file, rows)
    return rows


def _check_classes(file, rows):
    """Refuse two inputs of one group that have classes of their own: a group is bought as a whole."""
    entries: dict[str, str] = {}
    for row in rows:
        if row.classes and entries.setdefault(row.group, row.entry) != row.entry:
            raise CaseError(
                f"{file}: inputs.{shown_key(entries[row.group])} and inputs.{shown_key(row.entry)} are of the group "
                f"{row.group} and both have classes; give them in one of the two, or take the other out by its `group`"
            )


def _default_groups(inputs):
    """The group of each entry that names none: its own, or that of x and z of one physical tolerance."""
    groups = {row.entry: row.entry for row in inputs}
    lateral = {f"{table.name}.{row.key}" for table, row in parameter_rows() if row.is_lateral}
    for key in sorted(lateral):
        entries = {row.parameters[0][-1:]: row.entry for row in inputs if row.key == key and not row.group}
        if "x" in entries and "z" in entries:
            name = _common_name(entries["x"], entries["z"])
            groups |= {entries[axis]: name for axis in "xz"}
    return groups


def _common_name(first, second):
    """One name for two: "cg_x" and "cg_z" are "cg_xz"."""
    stem = first[:-1]
    return f"{stem}xz" if (first, second) == (f"{stem}x", f"{stem}z") else f"{first} and {second}"


def read_copula(tables: Iterable[Table], inputs: tuple[UncertainInput, ...]) -> ot.NormalCopula | None:
    """The copula of the tables [[correlation]]; None where nothing is correlated."""
    names = [row.name for row in inputs]
    correlations: dict[tuple[str, str], float] = {}
    file = ""
    for table in tables:
        file = table.file
        members = [name for one in table.read("inputs") for name in _input_names(table, one, inputs)]
        if len(members) < 2 or len(set(members)) < len(members):
            raise table.error("inputs", f"{table.rows['inputs'].value.allowed()}, each once")
        kind = table.exactly_one_of(("coefficient", "rank"), "neither coefficient nor rank")
        value = table.read(kind)
        # Spearman's coefficient of a normal copula is 6 / pi arcsin(R / 2).
        value = 2.0 * math.sin(math.pi / 6.0 * value) if kind == "rank" else value
        for pair in itertools.combinations(sorted(members, key=names.index), 2):
            if pair in correlations:
                raise table.problem(f"{table.path} correlates {' and '.join(pair)} a second time")
            correlations[pair] = value
    try:
        return normal_copula(names, correlations)
    except ValueError as error:
        raise CaseError(f"{file}: correlation cannot be used: {error}") from error


def _targets(table, name, targets):
    """The (name, target) pairs of one entry: one, or one for each spring or connector."""
    quantity = table.read("quantity")
    each = {f"{key}.each": target.entries for key, target in targets.items() if target.entries}
    if quantity in each:
        return [(f"{name}_{number}", targets[key]) for number, key in each[quantity].items()]
    if quantity not in targets:
        numbered = {key for entries in each.values() for key in entries.values()}
        general = [key for key in targets if key not in numbered]
        hint = did_you_mean(quantity, [*general, *each]) or f" such as {example_of(general)}"
        if quantity.startswith(_LINEAR_ONLY) and "springs.scale" in targets:
            ending = quantity[quantity.rindex(".") :] if quantity.count(".") > 1 else ""
            hint = (
                f"; springs with a force-stroke table have no such number: 'springs.scale{ending}', the factor of the "
                "force, scatters instead"
            )
        raise table.error("quantity", f"a quantity of this case{hint}")
    return [(name, targets[quantity])]


def _input(table, name, target: Target, nominal):
    # Springs that differ have no common value: moved together, their input is the deviation from it.
    values = {float(f"{nominal[parameter][0] / target.unit.factor:.15g}") for parameter in target.parameters}
    reference = values.pop() if len(values) == 1 else 0.0
    description, series, number = table.read("description"), "", 0
    if description is None:
        description, series, number = target.description, target.series, target.number
    if len(values) > 0:
        description = f"deviation of the {description}"
    # Next to `distribution`, sigma is a parameter of it.
    keys = ("distribution",) if "distribution" in table else SCATTER_KEYS
    given = " and ".join(key for key in keys if key in table)
    kind = table.exactly_one_of(keys, "no scatter", given)
    try:
        distribution = _distribution(table, kind, target.unit, reference)
        row = UncertainInput(
            name=name,
            description=description,
            unit=target.unit.label,
            distribution=distribution,
            parameters=target.parameters,
            factor=target.unit.factor,
            reference=reference,
            key=target.key,
            classes=_classes(table, kind, target.unit, reference),
            series=series,
            number=number,
            is_shared_by_tests=table.read("in_tests"),
            mean_uncertainty=_scatter_size(table, "mean_uncertainty", target.unit, reference)
            if "mean_uncertainty" in table
            else 0.0,
            sigma_uncertainty=_scatter_size(table, "sigma_uncertainty", target.unit, _sigma(table, distribution))
            if "sigma_uncertainty" in table
            else 0.0,
        )
        check_range(row, nominal)
    except CaseError:
        raise
    except ValueError as error:
        raise table.problem(f"{table.path} cannot be used: {error}") from error
    return row


def _distribution(table, kind, unit, reference):
    # An uncertain input stays in the unit of the file.
    number = Number(Unit(unit.name))
    if kind == "distribution":
        fixed = {key for key in table.rows.keys if key not in SCATTER_KEYS or key == "distribution"} - {"mean"}
        parameters = {key: table.read_as(number, key) for key in table.data if key not in fixed}
        return build_distribution(table.read("distribution"), parameters)
    size = _scatter_size(table, kind, unit, reference)
    mean = table.read_as(number, "mean") if "mean" in table else reference
    if kind == "plus_minus":
        return build_distribution("Uniform", {"a": mean - size, "b": mean + size})
    return build_distribution("Normal", {"mu": mean, "sigma": size / 3.0 if kind == "three_sigma" else size})


def _sigma(table, distribution):
    try:
        return distribution.getStandardDeviation()[0]
    except REFUSALS as error:
        raise table.problem(f"{table.path} has a sigma_uncertainty, but its distribution has no sigma") from error


def _classes(table, kind, unit, reference):
    """The classes of a tolerance, by their size over the one that the input has."""
    labels = table.read("classes")
    if labels is None:
        if "prices" in table:
            raise table.problem(f"{table.path}.prices needs `classes`")
        return ()
    if kind == "distribution":
        raise table.error("classes", "left out beside `distribution`, which has no size that could be another")
    size = _scatter_size(table, kind, unit, reference)
    sizes = [_scatter_size(table, "classes", unit, reference, label) for label in labels]
    prices = table.read("prices", len(labels))
    if prices is None:
        # The place from the loosest one on.
        prices = [sum(other > one for other in sizes) for one in sizes]
    found = zip(labels, sizes, prices, strict=True)
    return tuple(ToleranceClass(_label(label, unit), one / size, float(price)) for label, one, price in found)


def _label(label, unit):
    return label if isinstance(label, str) else f"{label:g} {unit.name}".strip()


def _scatter_size(table, kind, unit, reference, value=None):
    """The size of a scatter given as a number or as a percentage of the nominal value; `value` is one of a list."""
    value, size = table.data[kind] if value is None else value, Number(unit, Sign.POSITIVE)
    percent = _percent(value)
    if percent is not None:
        share = 0.01 * percent * abs(reference)
        if size.accepts(share):
            return share
        if reference == 0.0 and size.accepts(percent):
            what = f"a number in {unit.name}: the nominal value is 0, which has no percentage"
            raise table.error(kind, what, value)
    elif size.accepts(value):
        return float(value)
    raise table.error(kind, f"{size.allowed()}, or a percentage such as '1.5 %'", value)


def _percent(value):
    """The number of a percentage; NaN if there is none before the sign, None if it is no percentage."""
    return parsed_number(value[:-1]) if isinstance(value, str) and value.endswith("%") else None


def _input_names(table, name, inputs):
    """The inputs that a name stands for: one, or all of an entry that makes one for every spring."""
    found = [row.name for row in inputs if name in (row.name, row.entry)]
    if not found:
        # The name of an entry before those of its springs.
        known = list(dict.fromkeys([*(row.entry for row in inputs), *(row.name for row in inputs)]))
        hint = did_you_mean(name, known) or (
            f"; there are {', '.join(known[:4])}, ..." if known else "; there are none"
        )
        raise table.error("inputs", f"an uncertain input of the table [inputs]{hint}", name)
    return found
