"""Requirements, from [[requirements]]."""

from collections.abc import Iterable

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.separation import Separation
from satsep_ot.model.reading.table import Table
from satsep_ot.model.requirement import SYSTEM, Requirement
from satsep_ot.model.spelling import did_you_mean
from satsep_ot.model.values import Number, Unit

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
            hint = _NEEDS.get(quantity) or did_you_mean(quantity, known)
            raise table.error("quantity", f"one of {', '.join(known)}{hint}")
        limit = table.exactly_one_of(("maximum", "minimum"), "neither maximum nor minimum")
        name = table.read("name") or quantity
        if name in requirements:
            raise table.error("name", "different from the names of the other requirements", name)
        if name == SYSTEM:
            raise table.error("name", "another name: this one stands for the violation of any of them")
        requirements[name] = Requirement(
            name=name,
            quantity=quantity,
            limit=table.read_as(Number(Unit(known[quantity].unit)), limit),
            is_maximum=limit == "maximum",
            allowed_probability=table.read("allowed_probability"),
        )
    return tuple(requirements.values())
