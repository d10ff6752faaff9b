"""The nominal separation, from the tables of the case file."""

from dataclasses import replace
from typing import Any

import numpy as np

from satsep_ot.dynamics.relative_orbit import check_orbit
from satsep_ot.dynamics.separation import Body, Separation, is_inertia
from satsep_ot.model.parameters import BODIES, TABLES, parameter_rows
from satsep_ot.model.reading.contact import read_contact, read_hold_downs, read_rails
from satsep_ot.model.reading.orbit import read_orbit, read_recontact
from satsep_ot.model.reading.springs import read_force_line, read_springs, read_umbilicals
from satsep_ot.model.reading.table import CaseError, Table, tables

# The tables that a separation is read from, and those of them without which there is no such thing.
_ABSENT = ("orbit", "recontact", "coast", "envelope", "contact", "rails")
_PIN_STIFFNESS = 1e8  # N/m, of pins in a case with contact
_ONE_EACH = ("platform", "satellite", "springs", "impulse", "initial", *_ABSENT)


def read_separation(top: Table, files: dict[str, str]) -> Separation:
    """The nominal separation [SI].

    Parameters
    ----------
    top : Table
        The whole file.
    files : dict of str to str
        As for `read_springs`.

    Returns
    -------
    separation : Separation

    Raises
    ------
    CaseError
        If a key is not known, missing or not allowed.
    """
    # Misspelt keys are reported before missing ones: the first usually explains the second.
    table = {name: _inner_table(top, name) for name in _ONE_EACH}
    springs = read_springs(table["springs"], files)
    connectors = tables(top.file, TABLES["umbilical"], top.data.get("umbilical", []), "umbilical", one=True)
    touches = any(name in top for name in ("contact", "hold_down", "rails"))
    for connector in read_umbilicals(connectors, _PIN_STIFFNESS if touches else 0.0):
        springs = springs.joined(connector)
    held = tables(top.file, TABLES["hold_down"], top.data.get("hold_down", []), "hold_down", one=True)
    force_line = read_force_line(table["springs"])
    initial = table["initial"]
    orbit, attitude = read_orbit(table["orbit"], initial)
    velocity = initial.read("velocity")
    if orbit is not None:
        orbit = replace(orbit, velocity=orbit.velocity + velocity)
    recontact = read_recontact(table["recontact"], orbit)
    try:
        separation = Separation(
            **{name: _read_body(table[name]) for name in BODIES},
            springs=springs,
            force_line=force_line,
            attitude=tuple(attitude),
            pivot=initial.read("pivot"),
            orbit=orbit,
            gradient_torque=orbit is not None and table["orbit"].read("gradient_torque"),
            **_read_envelope(table["envelope"]),
            recontact=recontact,
            coast_times=() if table["coast"] is None else table["coast"].read("times"),
            horizon=top.read("horizon"),
            contact=read_contact(table["contact"], springs),
            rails=read_rails(table["rails"]),
            hold_downs=read_hold_downs(held),
            **_read_parameters(table),
        )
        if recontact is not None:
            # The CG of the stack may be on another orbit than the platform's.
            check_orbit(separation.stack_orbit())
    except CaseError:
        raise
    except ValueError as error:
        raise top.problem(str(error)) from error
    return separation


def _read_parameters(table) -> dict[str, Any]:
    """The parameters that are fields of the separation itself, of those that the file gives or that have a default."""
    given = {}
    for rows, row in parameter_rows():
        if row.is_of_separation and table[rows.name] is not None:
            given[row.field] = table[rows.name].read(row.key)
    return {name: value for name, value in given.items() if value is not None}


def _inner_table(top, name):
    """A table of the file; where it is left out, one with the defaults, or None."""
    rows = TABLES[name]
    if rows.is_needed and name not in top:
        raise top.problem(f"{name} is missing; it must be a table, [{name}]")
    if name not in top and name in _ABSENT:
        return None
    data = top.data.get(name, {})
    if not isinstance(data, dict):
        raise top.error(name, f"a table, [{name}]")
    return Table(top.file, rows, data, inner=("planes",) if name == "envelope" else ())


def _read_body(table):
    mass, center_of_mass = table.read("mass"), table.read("center_of_mass")
    inertia = table.read("inertia")
    moments = np.linalg.eigvalsh(inertia)
    given = ", ".join(f"{moment:.6g}" for moment in moments)
    if moments[0] <= 0.0:
        raise table.error("inertia", f"positive definite (its principal moments are {given} kg m2)")
    if not is_inertia(moments):
        raise table.error(
            "inertia", f"such that no principal moment exceeds the sum of the other two ({given} kg m2 are given)"
        )
    return Body(mass=mass, inertia=inertia, center_of_mass=center_of_mass)


def _read_envelope(table) -> dict[str, Any]:
    """The points of the envelope and the planes of the recess."""
    if table is None:
        return {}
    if "points" in table:
        for key in ("half_width", "height"):
            if key in table:
                raise table.problem(f"envelope.points and envelope.{key} are both given; give one of them")
        points = table.read("points")
    else:
        half_width, height = table.read("half_width", is_needed=True), table.read("height", is_needed=True)
        sides = (-half_width, half_width)
        points = np.array([[x, y, z] for y in (0.0, height) for x in sides for z in sides])
    planes = [
        [*plane.read("normal"), plane.read("offset")]
        for plane in tables(table.file, TABLES["envelope.planes"], table.data.get("planes", []), "envelope.planes")
    ]
    if not planes:
        table.read("recess_radius", is_needed=True)
    return {"envelope": points, "recess_planes": planes or None}
