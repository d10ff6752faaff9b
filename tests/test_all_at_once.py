"""Whether requirements are met one by one or at once, and the probability of any of them beside each."""

import dataclasses

import pytest
from small_cases import MASS_AND_RATE, ROLLING, SMALL
from test_study_tables import EMPTY

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.model.case import SYSTEM, parse_case
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.separation_study import SeparationStudy
from satsep_ot.studies.telling.remarks import remarks
from satsep_ot.studies.telling.results import Estimate, QuantityValues, RequirementEntry
from satsep_ot.studies.telling.verdicts import Status, any_violation, headline, judge, judge_all
from satsep_ot.studies.telling.words import StudyMethod


def row(name, probability, lower, upper, together=None):
    return Estimate(
        name, StudyMethod.ACTIVE_SUBSPACE, probability, lower, upper, converged=True, upper_together=together
    )


def test_met_each_and_all_at_once():
    met = judge("spin", [row("spin", 1e-4, 0.8e-4, 1.2e-4, 1.3e-4)], 1e-3)
    near = judge("clearance", [row("clearance", 8e-4, 7e-4, 9.8e-4, 1.1e-3)], 1e-3)
    old = judge("old", [row("old", 1e-4, 0.8e-4, 1.2e-4)], 1e-3)
    assert (met.is_met_together, near.is_met_together, old.is_met_together) == (True, False, None)
    assert near.status is Status.MET
    each = "Each requirement is met with 95 % confidence"
    assert headline([met, met]) == f"{each}, and so are all at once."
    assert headline([met, near]) == (
        f"{each}; that all are met at once is not shown with 95 % (more runs for clearance can show it)."
    )
    assert headline([met, old]) == f"{each}; whether all are met at once was not computed."


def test_the_bounds_of_a_study_hold_at_once():
    text = f"{SMALL}{MASS_AND_RATE}{ROLLING}allowed_probability = 0.05\n"
    text += '[[requirements]]\nname = "slow"\nquantity = "axial_velocity"\nminimum = 0.1\nallowed_probability = 0.05\n'
    study = SeparationStudy(SeparationProblem(parse_case(text)), ["ActiveSubspace", "MonteCarlo"], 1, 5000, 20, 0)
    study.computeSample()
    study.compareMethods()
    result = study.getResult()
    for one in result.rows:
        if one.method == StudyMethod.MONTE_CARLO:
            count = round(one.probability * 5000)
            # Two requirements: each at 97.5 %.
            assert one.upper_together == clopperPearson(count, 5000, 0.975)[1]
        assert one.upper_together > one.upper95
    assert [verdict.is_met_together for verdict in judge_all(result)] == [True, True]


def with_rows(*rows):
    entry = RequirementEntry("spin", "spin", 1.0, True, 1e-2, "spin <= 1", "deg/s")
    quantities = {"spin": QuantityValues("deg/s", "rate", 0.0)}
    return dataclasses.replace(EMPTY, requirements=(entry,), rows=rows, quantities=quantities)


def test_any_requirement_is_never_told_below_one_of_them():
    spin = row("spin", 8e-3, 7e-3, 9e-3)
    above = any_violation(with_rows(spin, row(SYSTEM, 8.5e-3, 7.5e-3, 9.5e-3)))
    assert (above.row.probability, above.remark) == (8.5e-3, "")
    below = with_rows(spin, row(SYSTEM, 7.8e-3, 7.2e-3, 8.4e-3))
    told = any_violation(below)
    assert (told.row.probability, told.row.lower95, told.row.upper95) == (8e-3, 7.2e-3, 9e-3)
    assert told.remark == remarks(below)[0]
    assert "is below that of spin, which is part of it" in told.remark
    apart = any_violation(with_rows(spin, row(SYSTEM, 2e-3, 1e-3, 3e-3)))
    assert "do not overlap: one of the two has missed violations" in apart.remark
    assert any_violation(with_rows(spin)) is None
    assert any_violation(with_rows(spin, row(SYSTEM, 8e-3, 7e-3, 9e-3))).row.probability == pytest.approx(8e-3)
