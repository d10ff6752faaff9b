"""What a case says and its nominal run, checked: what `satsep-ot check` prints, and its JSON."""

import dataclasses
import math
from typing import Any

from satsep_ot.dynamics.quantities import Quantity, quantity_table
from satsep_ot.dynamics.separation import Status
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.model.case import Case
from satsep_ot.model.distributions import correlated_pairs, quantile_range
from satsep_ot.model.hand_formulas import HandFormula, hand_formulas
from satsep_ot.model.plausibility import (
    RequirementScatter,
    plausibility_warnings,
    requirement_scatter,
    violation_sentences,
)


@dataclasses.dataclass(frozen=True)
class CheckedCase:
    """A case, its nominal run, and what looks wrong.

    Attributes
    ----------
    case : :class:`satsep_ot.model.case.Case`
    is_ok : bool
        Whether the nominal run succeeded.
    message : str
        How it failed.
    quantities : dict of str to (float, Quantity)
        Value in the nominal run, NaN where that failed, and what it is.
    scatter : list of :class:`satsep_ot.model.plausibility.RequirementScatter`
    correlations : list of (str, str, float)
        Correlated inputs with the coefficient of their normal copula.
    warnings : list of str
        What is hardly meant.
    violations : list of str
        Requirements that most runs violate, where nothing speaks for a slip in the file.
    by_hand : list of :class:`satsep_ot.model.hand_formulas.HandFormula`
        What can be computed without a simulator.
    """

    case: Case
    is_ok: bool
    message: str
    quantities: dict[str, tuple[float, Quantity]]
    scatter: list[RequirementScatter]
    correlations: list[tuple[str, str, float]]
    warnings: list[str]
    violations: list[str]
    by_hand: list[HandFormula]


def check_case(case: Case) -> CheckedCase:
    """Simulate the nominal run of a case and a few scattered ones, and look for what is hardly meant.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`

    Returns
    -------
    checked : CheckedCase

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.check_document import check_case
    >>> checked = check_case(load_case("reference"))
    >>> checked.is_ok, len(checked.scatter), checked.warnings
    (True, 4, [])
    """
    outcome = simulate(case.separation)
    return CheckedCase(
        case,
        int(outcome.status[0]) == Status.OK,
        outcome.explain(0),
        {
            name: (float(outcome.quantity(name)[0]), quantity)
            for name, quantity in quantity_table(case.separation).items()
        },
        requirement_scatter(case),
        correlated_pairs([row.name for row in case.inputs], case.copula),
        plausibility_warnings(case),
        violation_sentences(case),
        hand_formulas(case.separation),
    )


def check_document(checked: CheckedCase) -> dict[str, Any]:
    """What was understood of a case as plain data for JSON.

    Parameters
    ----------
    checked : CheckedCase

    Returns
    -------
    document : dict
        A number that a failed run does not have is None.
    """
    case = checked.case
    return {
        "case": case.name,
        "description": case.description,
        "inputs": [
            {
                "name": row.name,
                "unit": row.unit,
                "distribution": str(row.distribution),
                "nominal": row.reference,
                "range": list(quantile_range(row.distribution)),
                "description": row.description,
            }
            for row in case.inputs
        ],
        "failures": [{"part": failure.part, "probability": failure.probability} for failure in case.failures],
        "fleet": case.fleet,
        "correlation": [
            {"inputs": [first, second], "coefficient": coefficient}
            for first, second, coefficient in checked.correlations
        ],
        "nominal": {
            name: {"value": _finite(value), "unit": quantity.unit}
            for name, (value, quantity) in checked.quantities.items()
        },
        "by_hand": [
            {"name": row.name, "unit": row.unit, "by_hand": _finite(row.by_hand), "by_run": _finite(row.by_run)}
            for row in checked.by_hand
        ],
        "requirements": [_requirement(row) for row in checked.scatter],
        "violations": checked.violations,
        "warnings": checked.warnings,
    }


def _finite(value):
    return value if math.isfinite(value) else None


def _requirement(row):
    entry = row.requirement
    return {
        "name": entry.name,
        "quantity": entry.quantity,
        **entry.keys(),
        "unit": row.unit,
        "allowed_probability": entry.allowed_probability,
        "met_by_nominal_run": None if math.isnan(row.nominal) else entry.is_met(row.nominal),
        "scattered_runs": {
            "runs": row.runs,
            "met": row.met,
            "smallest": row.smallest if row.runs else None,
            "largest": row.largest if row.runs else None,
        },
    }
