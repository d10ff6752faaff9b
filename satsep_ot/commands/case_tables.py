"""A case and its nominal run on a terminal."""

import math
from collections.abc import Iterable, Iterator
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.separation import Separation, Status
from satsep_ot.dynamics.springs import ForceLaw
from satsep_ot.model.case import Case
from satsep_ot.model.check_document import CheckedCase
from satsep_ot.model.hand_formulas import push_energy, push_velocity
from satsep_ot.model.inputs import interval_digits, quantile_range, umbilical_springs
from satsep_ot.model.run_document import spring_names
from satsep_ot.studies.telling.tables import make_table, narrow

# A smaller number is a rounding error to people, who read 0; JSON has all digits.
_ROUNDING_ERROR = 1e-9
_NOT_KNOWN = "–"


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
    for line in _conditions(separation):
        console.print(line)
    console.print(_inputs(case.inputs))
    console.print()
    for first, second, coefficient in checked.correlations:
        console.print(f"{escape(first)} and {escape(second)} are correlated: {coefficient:g}")
    console.print(_quantities(checked.quantities))
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
    table = make_table("Bodies", "", ">mass [kg]", "inertia xx, yy, zz, xy, xz, yz [kg m2]", "centre of mass [mm]")
    for name in ("platform", "satellite"):
        mass, *rest = getattr(separation, name).parameters()
        table.add_row(name, f"{mass:g}", _numbers(rest[:6]), _numbers(rest[6:], 1e3))
    return table


def _springs(separation: Separation) -> Table:
    springs, connectors = separation.springs, umbilical_springs(separation)
    table = make_table(
        f"Springs ({separation.force_line.name.lower()})", ">", ">angle [deg]", ">radius [mm]", ">stiffness [N/m]",
        ">deformation [mm]", ">stroke [mm]", ">cant [deg]", ">delay [ms]", ">scale", "force",
    )  # fmt: skip
    for i in range(len(springs)):
        if {i, i - 1} & set(connectors):
            continue
        force = "failed" if springs.scale[i] == 0.0 else ForceLaw(springs.laws[i]).name.lower()
        if springs.tables[i] is not None:
            force += f" of {len(springs.tables[i])} rows, {springs.tables[i][0, 1]:g} to {springs.tables[i][-1, 1]:g} N"
        linear = springs.laws[i] == ForceLaw.LINEAR
        row = (
            math.degrees(springs.angle[i]), 1e3 * springs.radius[i], springs.stiffness[i] if linear else None,
            1e3 * springs.deformation[i] if linear else None, 1e3 * springs.stroke[i], math.degrees(springs.cant[i]),
            1e3 * springs.delay[i], springs.scale[i],
        )  # fmt: skip
        table.add_row(str(i + 1), *(_NOT_KNOWN if value is None else f"{value:g}" for value in row), force)
    return narrow(table)


def _umbilicals(separation: Separation) -> Table:
    springs = separation.springs
    table = make_table(
        "Umbilical connectors", ">", ">angle [deg]", ">radius [mm]", ">stiffness [N/m]", ">deformation [mm]",
        ">stroke [mm]", ">pin friction [N]", ">engagement [mm]",
    )  # fmt: skip
    for number, i in enumerate(umbilical_springs(separation), start=1):
        row = (
            math.degrees(springs.angle[i]), 1e3 * springs.radius[i], springs.stiffness[i], 1e3 * springs.deformation[i],
            1e3 * springs.stroke[i], springs.scale[i + 1], 1e3 * springs.stroke[i + 1],
        )  # fmt: skip
        table.add_row(str(number), *(f"{value:g}" for value in row))
    return narrow(table)


def _conditions(separation: Separation) -> Iterator[str]:
    """What else acts on the bodies, a line each."""
    energy, velocity = push_energy(separation), push_velocity(separation)
    yield f"Spring energy {energy:.6g} J, enough for {velocity:.6g} m/s"
    if separation.stowed_length:
        yield f"Stowed length {1e3 * separation.stowed_length:g} mm"
    rates = _numbers(map(math.degrees, separation.rates))
    yield f"Initial rates {rates} deg/s about the {separation.pivot.name.lower()}"
    if separation.guide_friction:
        yield f"Friction coefficient of the guides {separation.guide_friction:g}"
    if any(separation.impulse) or any(separation.angular_impulse):
        yield (
            f"Impulse at the start {_numbers(separation.impulse)} N s at the ring centre, and "
            f"{_numbers(separation.angular_impulse)} N m s"
        )
    if any(separation.mounting_error):
        yield f"Mounting error {_numbers(map(math.degrees, separation.mounting_error))} deg"
    yield from _orbit(separation)
    yield from _envelope(separation)


def _orbit(separation):
    if separation.orbit is None:
        yield "No gravity"
    else:
        torque, j2 = ("on" if given else "off" for given in (separation.gradient_torque, separation.orbit.j2))
        position, velocity = separation.orbit.position, separation.orbit.velocity
        yield f"Orbit: position {_numbers(position, 1e-3)} km, velocity {_numbers(velocity, 1e-3)} km/s"
        yield f"Period {separation.orbit.period / 60.0:.6g} min; J2 {j2} in the coast"
        yield f"Gravity-gradient torque: {torque}"
        yield f"Attitude quaternion {_numbers(separation.attitude)} (w, x, y, z)"
    if separation.recontact is not None:
        window = separation.recontact
        yield f"Re-contact: looked for from {window.start_orbits:g} to {window.end_orbits:g} orbits after the release"


def _envelope(separation):
    if separation.envelope is None:
        yield "No envelope: no clearance"
        return
    radius = f"radius {1e3 * separation.recess_radius:g} mm and " if separation.recess_radius else ""
    yield (
        f"Envelope of {len(separation.envelope)} points, {len(separation.recess_points())} of them in a recess "
        f"of {radius}depth {1e3 * separation.recess_depth:g} mm"
    )
    for number, plane in enumerate(separation.recess_planes, start=1):
        yield f"Plane wall {number}: normal {_numbers(plane[:3])}, offset {1e3 * plane[3]:g} mm"


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


def _numbers(values: Iterable[float], scale: float = 1.0) -> str:
    return ", ".join(f"{value * scale:.6g}" for value in values)
