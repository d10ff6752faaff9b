"""A case and its nominal run on a terminal."""

import math
from collections.abc import Iterable, Iterator
from typing import Any

from rich.console import Console
from rich.table import Table

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.separation import Separation, Status
from satsep_ot.dynamics.springs import ForceLaw, Interpolation
from satsep_ot.model.case import Case
from satsep_ot.model.check_document import CheckedCase
from satsep_ot.model.distributions import interval_digits, quantile_range
from satsep_ot.model.hand_formulas import push_energy, push_velocity, table_energies
from satsep_ot.model.inputs import umbilical_springs
from satsep_ot.model.parameters import (
    BODIES,
    CONTACT,
    HOLD_DOWN,
    ORBIT,
    PLANES,
    RAILS,
    SPRINGS,
    UMBILICAL,
    elements,
    nominal_values,
    parameter_rows,
)
from satsep_ot.model.run_document import spring_names
from satsep_ot.studies.telling.tables import escape, make_table, narrow

# A smaller number is a rounding error to people, who read 0; JSON has all digits.
_ROUNDING_ERROR = 1e-9
_NOT_KNOWN = "–"
_INTERPOLATIONS = {Interpolation.MONOTONE: "monotone cubics", Interpolation.LINES: "straight lines (trapezoids)"}


def print_case(console: Console, checked: CheckedCase, given: str) -> None:
    """Print what `satsep-ot check` understood.

    Parameters
    ----------
    console : :class:`rich.console.Console`
    checked : :class:`satsep_ot.model.check_document.CheckedCase`
    given : str
        The case as the user has named it.
    """
    case, separation, scatter = checked.case, checked.case.separation, checked.scatter
    _print_title(console, case)
    console.print(_bodies(separation))
    console.print(_springs(separation))
    console.print()
    if umbilical_springs(separation):
        console.print(_umbilicals(separation))
        console.print()
    for line in [*_conditions(separation), *_failures_and_fleet(case)]:
        console.print(line)
    console.print(_inputs(case.inputs))
    console.print()
    for first, second, coefficient in checked.correlations:
        console.print(f"{escape(first)} and {escape(second)} are correlated: {coefficient:g}")
    console.print(_quantities(checked.quantities))
    console.print(_hand_formulas(checked.by_hand))
    if scatter:
        console.print(_requirements(scatter))
        console.print()
        runs = (
            f"The nominal run and {scatter[0].runs:,} scattered runs only show"
            if case.inputs
            else "The nominal run shows"
        )
        console.print(
            f"{runs} where the limits are. For the probability of violating each requirement run "
            f"`satsep-ot study {escape(given)}`."
        )
    for sentence in checked.violations:
        console.print(f"[bold]! violated[/bold]  {escape(sentence)}")
    for warning in checked.warnings:
        console.print(f"[bold]! implausible[/bold]  {escape(warning)}")


def print_run(console: Console, case: Case, document: dict[str, Any]) -> None:
    """Print what `satsep-ot simulate` found.

    Parameters
    ----------
    console : :class:`rich.console.Console`
    case : :class:`satsep_ot.model.case.Case`
    document : dict
        As `run_document` makes it.
    """
    _print_title(console, case)
    values, table = document["quantities"], quantity_table(case.separation)
    console.print(_quantities({name: (_or_nan(values[name]), quantity) for name, quantity in table.items()}))
    for line in _accounts(case.separation, document):
        console.print(line)
    if document["at_last_release"] and document["at"]:
        console.print(_motions(document))


def _print_title(console, case):
    console.print(f"[bold]{escape(case.name)}[/bold]  {escape(case.description)}")


def _bodies(separation: Separation) -> Table:
    rows = BODIES["platform"].rows
    titles = (f"{row.key} {', '.join(elements(row))}".rstrip() for row in rows)
    table = make_table("Bodies", "", *(f"{title} [{row.unit.name}]" for title, row in zip(titles, rows, strict=True)))
    for name, body in BODIES.items():
        table.add_row(name, *(_numbers(nominal_values(row, separation)) for row in body.rows))
    return table


def _springs(separation: Separation) -> Table:
    springs, connectors = separation.springs, umbilical_springs(separation)
    rows = [row for row in SPRINGS.rows if row.holder == "springs"]
    names = [row.parameter for row in rows]
    columns = [nominal_values(row, separation) for row in rows]
    unused = separation.unused_parameters()
    table = make_table(f"Springs ({separation.force_line.name.lower()})", ">", *_titles(names, rows), "force")
    for i in range(len(springs)):
        if {i, i - 1} & set(connectors):
            continue
        force = "failed" if springs.scale[i] == 0.0 else ForceLaw(springs.laws[i]).name.lower()
        if springs.tables[i] is not None:
            force += f" of {len(springs.tables[i])} rows, {springs.tables[i][0, 1]:g} to {springs.tables[i][-1, 1]:g} N"
        cells = (
            _NOT_KNOWN if f"springs[{i}].{name}" in unused else f"{values[i]:g}"
            for name, values in zip(names, columns, strict=True)
        )
        table.add_row(str(i + 1), *cells, force)
    return narrow(table)


def _umbilicals(separation: Separation) -> Table:
    connectors = umbilical_springs(separation)
    # Pins that only slide have no stiffness.
    sticks = any(separation.springs.stiffness[i + 1] > 0.0 for i in connectors)
    rows = [row for row in UMBILICAL.rows if row.field and (sticks or row.key != "pin_stiffness")]
    table = make_table("Umbilical connectors", ">", *_titles([row.key for row in rows], rows))
    for number, i in enumerate(connectors, start=1):
        values = (nominal_values(row, separation)[i + row.of_connector[0]] for row in rows)
        table.add_row(str(number), *(f"{value:g}" for value in values))
    return narrow(table)


def _titles(names, rows):
    """Titles of columns of numbers, with their units."""
    units = (f" [{row.unit.name}]" if row.unit.name else "" for row in rows)
    return (f">{name}{unit}" for name, unit in zip(names, units, strict=True))


def _conditions(separation: Separation) -> Iterator[str]:
    """What else acts on the bodies, a line each."""
    energy, velocity = push_energy(separation), push_velocity(separation)
    yield f"Spring energy {energy:.6g} J, enough for {velocity:.6g} m/s"
    energies = table_energies(separation)
    if energies:
        by = ", ".join(f"{value:.6g} J by {_INTERPOLATIONS[kind]}" for kind, value in energies.items())
        used = _INTERPOLATIONS[separation.springs.interpolation]
        yield f"Tables: {by}; {used} are used between the rows"
    for table, row in parameter_rows():
        # What is not here stands in the tables of bodies and springs, or is 0.
        if row.is_of_separation and nominal_values(row, separation).any():
            words, values = row.key.replace("_", " "), _numbers(nominal_values(row, separation))
            yield f"{table.name.capitalize()}: {words} {values} {row.unit.name}".rstrip()
    yield f"The joined bodies turn about the centre of mass of the {separation.pivot.name.lower()}"
    yield from _orbit(separation)
    yield from _envelope(separation)
    yield from _contact(separation)


def _failures_and_fleet(case):
    """Which parts may fail, and what the satellites of a fleet share."""
    for failure in case.failures:
        yield f"{failure.part} fails with a probability of {failure.probability:g}"
    if case.fleet > 1:
        shared = ", ".join(row.name for row in case.inputs if row.is_shared)
        yield escape(f"A fleet of {case.fleet} satellites, which share {shared or 'no input'}")


def _orbit(separation):
    if separation.orbit is None:
        yield "No gravity"
    else:
        torque, j2 = ("on" if given else "off" for given in (separation.gradient_torque, separation.orbit.j2))
        state = {"position": separation.orbit.position, "velocity": separation.orbit.velocity}
        units = {key: ORBIT[key].unit for key in state}
        said = (f"{key} {_numbers(value / units[key].factor)} {units[key].name}" for key, value in state.items())
        yield f"Orbit: {', '.join(said)}"
        yield f"Period {separation.orbit.period / 60.0:.6g} min; J2 {j2} in the coast"
        yield f"Gravity-gradient torque: {torque}"
        yield f"Attitude quaternion {_numbers(separation.attitude)} (w, x, y, z)"
    if separation.recontact is not None:
        window = separation.recontact
        yield f"Re-contact: looked for from {window.start_orbits:g} to {window.end_orbits:g} orbits after the release"


def _contact(separation):
    """What the bodies touch and what holds them."""
    names = separation.contact_elements()[1]
    if not separation.has_contact():
        yield "No contact: the deck holds nothing"
        return
    kinds = {"deck": "points on the deck", "cyl": "walls", "plane": "walls", "hold": "hold-downs", "pin": "pins"}
    counts: dict[str, int] = {}
    for name in names:
        kind = next((words for start, words in kinds.items() if name.startswith(start)), "rails")
        counts[kind] = counts.get(kind, 0) + 1
    yield "Contact: " + ", ".join(f"{count} x {kind}" for kind, count in counts.items())
    for table in (CONTACT, RAILS, HOLD_DOWN):
        for row in table.rows:
            values = nominal_values(row, separation) if row.field else []
            if len(values) and any(values):
                name, words = table.name.replace("_", "-").capitalize(), row.key.replace("_", " ")
                yield f"{name}: {words} {_numbers(values)} {row.unit.name}".rstrip()


def _envelope(separation):
    if separation.envelope is None:
        yield "No envelope: no clearance"
        return
    followed = len(separation.recess_points())
    yield f"Envelope of {len(separation.envelope)} points, {followed} of them in the recess"
    offset = PLANES["offset"]
    for number, value in enumerate(nominal_values(offset, separation), start=1):
        normal = _numbers(separation.recess_planes[number - 1, :3])
        yield f"Plane wall {number}: normal {normal}, offset {value:g} {offset.unit.name}"


def _inputs(inputs) -> Table:
    title = f"Uncertain inputs ({len(inputs)})"
    table = narrow(make_table(title, "name", "unit", ">0.1 %", ">99.9 %", "distribution", "what"))
    for column in table.columns[:4]:
        column.no_wrap = True
    for row in inputs:
        low, high = quantile_range(row.distribution)
        digits = interval_digits(low, high, 6)
        table.add_row(
            escape(row.name),
            "" if row.unit == "1" else row.unit,
            f"{low:.{digits}g}",
            f"{high:.{digits}g}",
            escape(str(row.distribution)),
            escape(row.description),
        )
    return table


def _quantities(quantities) -> Table:
    table = make_table("Nominal run", "quantity", ">value", "unit", "what")
    for name, (value, quantity) in quantities.items():
        table.add_row(name, _rounded(value, 9), quantity.unit, quantity.description)
    return table


def _hand_formulas(rows) -> Table:
    table = narrow(make_table("By hand, beside the nominal run", "what", ">by hand", ">in the run", "unit", "formula"))
    for row in rows:
        table.add_row(row.name, _rounded(row.by_hand, 6), _rounded(row.by_run, 6), row.unit, row.formula)
    return table


def _requirements(scatter) -> Table:
    title = f"Requirements ({len(scatter)})"
    table = narrow(make_table(title, "limit", ">nominal run", ">scattered runs", ">met by", ">allowed"))
    for row in scatter:
        entry = row.requirement
        verdict = "unknown" if math.isnan(row.nominal) else "met" if entry.is_met(row.nominal) else "violated"
        table.add_row(f"[bold]{escape(entry.name)}[/bold]")
        table.add_row(
            f"{entry} {row.unit}",
            f"{_rounded(row.nominal, 3)} {verdict}",
            f"{_rounded(row.smallest, 3)}..{_rounded(row.largest, 3)}" if row.runs else "none",
            f"{row.met} of {row.runs}" if row.runs else "",
            "" if entry.allowed_probability is None else f"{entry.allowed_probability:g}",
        )
    return table


def _accounts(separation, document) -> Iterator[str]:
    """What each spring did, and how well the run keeps energy and angular momentum."""
    energy, momentum = document["energy"], document["angular_momentum"]
    is_ok = document["status"] == Status.OK.name
    for i, (name, time) in enumerate(zip(spring_names(separation), document["release_times"], strict=True)):
        if time is None and is_ok:
            yield f"{name} has failed"
        else:
            work = f", work {energy['spring_work'][i]:.6g} J" if energy else ""
            yield f"{name} released at {1e3 * _or_nan(time):.6f} ms{work}"
    if energy and momentum:
        gravity = "" if separation.orbit is None else " (gravity has a small part in both)"
        if energy["error"] is None:
            yield (
                f"Kinetic energy gained {energy['gained']:.9g} J, {energy['contact_work']:.3g} J of it by contact, "
                f"bolts and pins. The angular momentum changed by {momentum['change']:.1e} N m s{gravity}"
            )
            return
        yield (
            f"Kinetic energy gained {energy['gained']:.9g} J; it differs from the work of the springs by "
            f"{energy['error']:.1e} J. The angular momentum changed by {momentum['change']:.1e} N m s{gravity}"
        )


def _motions(document) -> Table:
    """The vectors of the motion, column by column: the last release, and the times asked for."""
    motions = [document["at_last_release"], *document["at"]]
    titles = ["last release", *(f"{motion['t']:g} s" for motion in document["at"])]
    table = make_table("Motion [SI, rad/s]", "", *(f">{title}" for title in titles))
    for name in motions[0]:
        if name != "t":
            table.add_row(name, *(_numbers(motion[name]) for motion in motions))
    return table


def _or_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _rounded(value: float, digits: int) -> str:
    return "0" if abs(value) < _ROUNDING_ERROR else f"{value:.{digits}g}"


def _numbers(values: Iterable[float]) -> str:
    return ", ".join(f"{value:.6g}" for value in values)
