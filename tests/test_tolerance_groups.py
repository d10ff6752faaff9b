"""Tolerances as they are bought: which inputs form one group, and which group the advice names."""

import dataclasses

import pytest
from small_cases import SMALL
from test_study_tables import EMPTY

from satsep_ot.model.case import load_case, parse_case
from satsep_ot.studies.drivers import scaled_case, tolerances
from satsep_ot.studies.telling.advice import advice_sentences, tightening_advice
from satsep_ot.studies.telling.results import Estimate, HalvedTolerance, RequirementEntry, Tolerance
from satsep_ot.studies.telling.words import StudyMethod


def groups(inputs):
    return {name: [row.name for row in rows] for name, rows in tolerances(parse_case(SMALL + inputs)).items()}


@pytest.mark.parametrize("key", ["satellite.center_of_mass", "platform.center_of_mass", "initial.rates",
                                 "initial.mounting_error"])  # fmt: skip
def test_x_and_z_of_one_tolerance_are_one_group_and_y_is_not(key):
    entries = "".join(f'a_{axis} = {{ quantity = "{key}.{axis}", sigma = 0.1 }}\n' for axis in "xyz")
    assert groups(f"[inputs]\n{entries}") == {"a_xz": ["a_x", "a_z"], "a_y": ["a_y"]}


def test_names_without_a_common_stem_are_joined_and_one_axis_stands_alone():
    entries = """[inputs]
forward = { quantity = "satellite.center_of_mass.x", sigma = 0.1 }
aside = { quantity = "satellite.center_of_mass.z", sigma = 0.1 }
pitch = { quantity = "initial.rates.z", sigma = 0.1 }
"""
    assert groups(entries) == {"forward and aside": ["forward", "aside"], "pitch": ["pitch"]}


def test_the_key_group_says_otherwise():
    entries = """[inputs]
cg_x = { quantity = "satellite.center_of_mass.x", sigma = 0.1, group = "forward" }
cg_z = { quantity = "satellite.center_of_mass.z", sigma = 0.1 }
mass = { quantity = "satellite.mass", distribution = "Normal", mu = 10.0, sigma = 0.1, group = "balance" }
Iyy = { quantity = "satellite.inertia.yy", sigma = "1 %", group = "balance" }
"""
    assert groups(entries) == {"forward": ["cg_x"], "cg_z": ["cg_z"], "balance": ["mass", "Iyy"]}


def test_all_inputs_of_a_group_are_scaled_together():
    scaled = scaled_case(load_case("reference"), "satellite_cg_xz", 0.5)
    factors = {row.name: row.factor for row in scaled.inputs}
    assert (factors["satellite_cg_x"], factors["satellite_cg_z"], factors["satellite_cg_y"]) == (5e-4, 5e-4, 1e-3)
    with pytest.raises(ValueError, match=r"'stifness' is no tolerance .*; did you mean 'stiffness'"):
        scaled_case(load_case("reference"), "stifness", 0.5)


def advised(allowed):
    entry = RequirementEntry("lateral", "lateral_rate", 2.5, True, allowed, "lateral_rate <= 2.5", "deg/s")
    halved = (
        HalvedTolerance("stiffness", 0.5, 5.4e-5, 4.5e-5, 6.5e-5, 900, True),
        HalvedTolerance("cg", 0.5, 4.6e-6, 4e-6, 5.5e-6, 900, True),
    )
    return dataclasses.replace(
        EMPTY,
        requirements=(entry,),
        rows=(Estimate("lateral", StudyMethod.ACTIVE_SUBSPACE, 2.47e-4, 2.3e-4, 2.7e-4, converged=True),),
        tolerances={name: Tolerance("sigma 1", (name,), name) for name in ("stiffness", "cg")},
        # The ratios of a tenth less scatter have them in the other order.
        ratios={"lateral": {"stiffness": 0.6, "cg": 0.7}},
        tightened={"lateral": halved},
    )


def test_the_group_that_buys_most_is_advised_and_none_where_the_requirement_is_met():
    result = advised(1e-4)
    assert [row.tolerance for row in tightening_advice(result)["lateral"]] == ["cg", "stiffness"]
    assert advice_sentences(result)["lateral"] == (
        "tighten cg (now sigma 1). Half of its scatter changes the probability from 2.47e-4 to 4.6e-6 (4e-6 to 5.5e-6)"
        ": 54 times less."
    )
    text = advice_sentences(advised(1e-3))["lateral"]
    assert text.startswith("met, nothing has to be tightened. cg (now sigma 1) would buy most. Half of its scatter")
