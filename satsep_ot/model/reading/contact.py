"""Contact, late bolts and rails, from their tables."""

from typing import Any

import numpy as np

from satsep_ot.dynamics.contact import Contact, HoldDowns, Rails
from satsep_ot.dynamics.separation import Springs
from satsep_ot.model.reading.table import Table
from satsep_ot.model.rows import CaseTable


def _parameters(table: Table, rows: CaseTable, owner: str) -> dict[str, Any]:
    """The fields of a part of contact that are parameters, as the file gives them or by default."""
    fields = {row.parameter: table.read(row.key) for row in rows.rows if row.holder == owner}
    if "damping" in table:
        if "restitution" in table:
            raise table.problem(f"{table.path} has both restitution and damping; give one of them")
        fields["restitution"] = 1.0
    return {name: value for name, value in fields.items() if value is not None}


def read_contact(table: Table | None, springs: Springs) -> Contact | None:
    """The contact of the satellite's foot.

    Parameters
    ----------
    table : Table or None
        [contact]
    springs : Springs
        Their largest radius is that of the ring's edge where the file says no other.

    Returns
    -------
    contact : Contact or None
    """
    if table is None:
        return None
    given = {"radius": float(springs.radius.max()), **_parameters(table, table.rows, "contact")}
    if given["radius"] <= 0.0:
        raise table.problem("contact.radius is missing; it must be positive, and all springs are on the axis")
    _check_restitution(table)
    return Contact(**given, points=table.read("points"), walls=table.read("walls"))


def read_rails(table: Table | None) -> Rails | None:
    """The rails of a dispenser; `table` is [rails]."""
    if table is None:
        return None
    _check_restitution(table)
    return Rails(**_parameters(table, table.rows, "rails"))


def read_hold_downs(tables: list[Table]) -> HoldDowns | None:
    """The late bolts and segments of a clamp band: one joint each, or several along its arc."""
    found: HoldDowns | None = None
    for table in tables:
        given, count = _parameters(table, table.rows, "hold_downs"), table.read("points")
        if int(count) != count:
            raise table.error("points", "a whole number from 1 to 40")
        arc = table.read("arc")
        offsets = arc * (np.arange(int(count)) / max(count - 1.0, 1.0) - 0.5) * (count > 1)
        part = HoldDowns(**{**given, "angle": given["angle"] + offsets})
        found = part if found is None else found.joined(part)
    return found


def _check_restitution(table):
    if not 0.0 < table.read("restitution") <= 1.0:
        raise table.error("restitution", "above 0 and at most 1")
