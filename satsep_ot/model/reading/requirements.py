"""Requirements, from [[requirements]]."""

from collections.abc import Iterable

from satsep_ot.dynamics.parameter_vector import Sign
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.separation import Separation
from satsep_ot.model.parameters import LIMIT_KEYS
from satsep_ot.model.reading.table import Table
from satsep_ot.model.requirement import SYSTEM, Requirement
from satsep_ot.model.spelling import did_you_mean
from satsep_ot.model.values import Ends, Number, Unit

# What a case needs to have a quantity.
_NEEDS = {
    "clearance": "; a clearance needs the table [envelope]",
    "recontact_distance": "; a re-contact distance needs the table [recontact]",
}


def read_requirements(tables: Iterable[Table], separation: Separation) -> tuple[Requirement, ...]:
    """The requirements, in the order of the file.

    Parameters
    ----------
    tables : iterable of Table
        Each [[requirements]].
    separation : Separation
        Whose quantities may be limited.

    Returns
    -------
    requirements : tuple of Requirement

    Raises
    ------
    CaseError
        If one is not allowed.
    """
    known = quantity_table(separation)
    requirements: dict[str, Requirement] = {}
    for table in tables:
        quantity = table.read("quantity")
        if quantity not in known:
            hint = (
                _NEEDS.get(quantity)
                or ("; a time needs the table [coast]" if "_at_" in quantity else "")
                or did_you_mean(quantity, known)
            )
            raise table.error("quantity", f"one of {', '.join(known)}{hint}")
        key = table.exactly_one_of(LIMIT_KEYS, "no limit", "more than one limit")
        name = table.read("name") or quantity
        if name in requirements:
            raise table.error("name", "different from the names of the other requirements", name)
        if name == SYSTEM:
            raise table.error("name", "another name: this one stands for the violation of any of them")
        requirements[name] = Requirement(
            name=name,
            quantity=quantity,
            **_limit(table, key, Unit(known[quantity].unit)),
            is_maximum=not key.startswith("minimum"),
            allowed_probability=table.read("allowed_probability"),
        )
    return tuple(requirements.values())


def _limit(table, key, unit):
    """Limit and center of a requirement."""
    if key == "between":
        least, most = (float(value) for value in table.read_as(Ends(unit), key))
        if least + most == 0.0:
            return {"limit": most, "center": 0.0}
        return {"limit": 0.5 * (most - least), "center": 0.5 * (least + most)}
    if key.endswith("_absolute"):
        return {"limit": table.read_as(Number(unit, Sign.POSITIVE), key), "center": 0.0}
    return {"limit": table.read_as(Number(unit), key)}
