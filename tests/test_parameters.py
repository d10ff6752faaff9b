"""The table of the keys of a case file, and what is made from it: the documentation and the JSON Schema."""

import copy
import re
import runpy
import tomllib
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest
from case_mutations import EVERY_TABLE, TOUCHING
from separation_cases import general_separation

from satsep_ot.dynamics.contact import Contact, HoldDowns, Rails
from satsep_ot.dynamics.quantities import QUANTITIES
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.model.case import CaseError, load_case, parse_case, shipped_cases
from satsep_ot.model.inputs import scatter_targets
from satsep_ot.model.parameters import PUSHES, SCATTER_KEYS, TABLES, parameter_rows
from satsep_ot.model.plausibility import plausibility_warnings
from satsep_ot.model.rows import NEEDED
from satsep_ot.model.schema import case_schema

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "case-files.md"
CASES = {name: load_case(name).text for name in shipped_cases()} | {"every table": EVERY_TABLE}


@pytest.fixture(scope="module")
def schema():
    return jsonschema.Draft7Validator(case_schema())


def test_every_parameter_has_a_row_and_every_row_a_parameter():
    separation = general_separation(
        recess_planes=[[0.0, 0.0, 1.0, -0.5]],
        contact=Contact(0.3),
        rails=Rails(0.05, 1e-4, (0.0, 0.34), 0.36),
        hold_downs=HoldDowns([0.0], 0.3, 5e-3),
    )
    fields = {place.path for place in separation.parameter_places()}
    assert {row.field for _, row in parameter_rows()} == fields
    # What can scatter anywhere is called something.
    assert all(row.scatters for _, row in parameter_rows())


def test_the_documentation_has_the_table_as_it_is():
    script = runpy.run_path(str(ROOT / "docs" / "update_case_files.py"))
    page = PAGE.read_text(encoding="utf-8")
    assert script["written"](page) == page, "run docs/update_case_files.py"


def test_the_documentation_names_every_choice_and_quantity():
    page = PAGE.read_text(encoding="utf-8")
    words = [*SCATTER_KEYS, *PUSHES, *QUANTITIES, "clearance", "recontact_distance"]
    assert [word for word in words if not re.search(rf"[`\"]{word}[`\"]", page)] == []


def test_the_annotated_case_explains_every_key():
    text = load_case("reference").text
    keys = [row.key for table in TABLES.values() for row in table.rows]
    assert [key for key in keys if not re.search(rf"\b{key}\b", text)] == []


def test_the_schema_is_one(schema):
    jsonschema.Draft7Validator.check_schema(schema.schema)


@pytest.mark.parametrize("name", CASES)
def test_cases_fit_the_schema(name, schema):
    assert list(schema.iter_errors(tomllib.loads(CASES[name]))) == []


@pytest.mark.parametrize(
    ("old", "new", "place"),
    [
        ("mass = 1200.0", "mas = 1200.0", ["platform"]),
        ("mass = 1200.0", "mass = 0.0", ["platform", "mass"]),
        ("mass = 1200.0", 'mass = "1200 kg"', ["platform", "mass"]),
        ("mass = 1200.0", "", ["platform"]),
        ("[envelope]", "[envelop]", []),
        ("[0.0, -1600.0, 0.0]", "[0.0, -1600.0]", ["platform", "center_of_mass"]),
        ("delay = 0.0 ", "delay = [0, 0, 0, -1]#", ["springs", "delay"]),
        ("cant = 0.0 ", "cant = 90#", ["springs", "cant"]),
        ('"guided"', '"glided"', ["springs", "force_line"]),
        ("count = 4 ", "count = 1001#", ["springs", "count"]),
        ("altitude = 500.0", "altitude = 500.0\nposition = [7000, 0, 0]\nvelocity = [0, 7, 0]", ["orbit"]),
        ("gradient_torque = false", 'gradient_torque = "no"', ["orbit", "gradient_torque"]),
        ("recess_radius = 520.0", "", ["envelope"]),
        ("half_width = 350.0", "half_width = 350.0\npoints = [[0, 0, 0]]", ["envelope"]),
        ('"satellite.mass"', '"satelite.mass"', ["inputs", "satellite_mass", "quantity"]),
        ('"springs.cant.each"', '"springs.cant.0"', ["inputs", "cant", "quantity"]),
        ("sigma = 0.5 }", "sigma = 0.5, plus_minus = 1 }", ["inputs", "satellite_mass"]),
        ("sigma = 0.5 }", "sgma = 0.5 }", ["inputs", "satellite_mass"]),
        ("sigma = 0.5 }", 'sigma = "half" }', ["inputs", "satellite_mass", "sigma"]),
        ('"Uniform", a = 0.0', '"Unifrm", a = 0.0', ["inputs", "delay", "distribution"]),
        ('quantity = "spin"', 'quantity = "spinn"', ["requirements", 1, "quantity"]),
        ("maximum = 2.5", "maximum = 2.5\nminimum = 1", ["requirements", 0]),
        ("allowed_probability = 5e-3", "allowed_probability = 1", ["requirements", 1, "allowed_probability"]),
    ],
)
def test_what_is_wrong_is_marked_where_it_is(old, new, place, schema):
    text = CASES["reference"]
    assert old in text
    text = text.replace(old, new, 1)
    with pytest.raises(CaseError):
        parse_case(text)
    assert place in [list(error.absolute_path) for error in schema.iter_errors(tomllib.loads(text))]


@pytest.mark.parametrize("name", CASES)
def test_a_key_that_is_needed_is_needed_by_the_schema_too(name, schema):
    data = tomllib.loads(CASES[name])
    for table, rows in TABLES.items():
        if not rows.is_needed:
            continue
        for row in rows.rows:
            if row.default is NEEDED:
                without = copy.deepcopy(data)
                del without[table][row.key]
                assert not schema.is_valid(without), row.key


def test_the_schema_offers_what_is_allowed(schema):
    properties = schema.schema["properties"]
    assert properties["springs"]["properties"]["force_line"]["enum"] == [line.name.lower() for line in ForceLine]
    entry = properties["inputs"]["additionalProperties"]["properties"]
    assert {"Normal", "Uniform", "LogNormal", "WeibullMin"} <= set(entry["distribution"]["enum"])
    assert properties["springs"]["properties"]["delay"]["description"].endswith("[ms], not negative.")
    # Every quantity that any case may scatter is a word or fits the pattern, and no word is unknown to all cases.
    quantity = jsonschema.Draft7Validator(entry["quantity"])
    offered, known = set(entry["quantity"]["anyOf"][0]["enum"]), set()
    for force_line in ForceLine:
        text = EVERY_TABLE.replace('"normal"', f'"{force_line.name.lower()}"', 1)
        if force_line is not ForceLine.NORMAL:
            text = text.replace("guide_friction = 0.1", "", 1)
        if force_line is ForceLine.STRUT:
            text = text.replace("stroke = 30.0", "stroke = 30.0\nstowed_length = 40.0", 1)
        targets = scatter_targets(parse_case(text[: text.index("[inputs]")] + TOUCHING).separation)
        assert all(quantity.is_valid(key) for key in targets)
        known |= set(targets) | {f"{key}.each" for key, target in targets.items() if target.entries}
    assert offered <= known
    requirement = properties["requirements"]["items"]["properties"]["quantity"]
    assert set(QUANTITIES) <= set(requirement["anyOf"][0]["enum"])


def test_defaults_are_allowed_where_they_stand(schema):
    for table in schema.schema["properties"].values():
        for key, entry in table.get("properties", {}).items():
            if "default" in entry:
                assert jsonschema.Draft7Validator(entry).is_valid(entry["default"]), key


def test_an_input_that_was_not_read_from_a_case_is_not_compared_with_the_table():
    case = load_case("reference")
    odd = replace(case.inputs[0], key="")
    assert plausibility_warnings(replace(case, inputs=(odd, *case.inputs[1:]))) == []
