"""What `satsep-ot check` computes by hand, and what it suggests for a key that is none."""

import json

import numpy as np
import pytest
from small_cases import BODIES, LINEAR

from satsep_ot import cli
from satsep_ot.dynamics.separation import Body, Separation, Springs
from satsep_ot.model.case import CaseError, load_case, parse_case
from satsep_ot.model.hand_formulas import hand_formulas


def test_formulas_of_a_free_push_are_those_of_the_run():
    """Springs in the plane of both centres of mass, so soft that they do not turn the satellite back."""
    springs = Springs([0.0], radius=0.0, stiffness=100.0, deformation=0.02, stroke=0.01)
    separation = Separation(Body(10.0, [1.0, 1.0, 1.0]), Body(1.0, [5.0, 5.0, 5.0]), springs)
    rows = {row.name: row for row in hand_formulas(separation)}
    assert rows["spring energy"].by_hand == pytest.approx(0.5 * 100.0 * (0.02**2 - 0.01**2))
    for name, row in rows.items():
        assert row.by_run == pytest.approx(row.by_hand, rel=1e-3), name
    velocity = rows["separation velocity"].by_hand
    assert rows["satellite's change of velocity"].by_hand == pytest.approx(velocity * 10.0 / 11.0)
    assert rows["platform's change of velocity"].by_hand == pytest.approx(velocity / 11.0)
    assert rows["tip-off per mm of offset"].by_hand == pytest.approx(
        np.degrees(velocity * 10.0 / 11.0 * 1e-3 / 5.0), rel=1e-12
    )


def test_check_needs_no_case_and_shows_both(capsys):
    assert cli.main(["check"]) == 0
    out = capsys.readouterr().out
    assert "reference" in out
    assert "By hand, beside the nominal run" in out
    assert "tip-off per mm of offset" in out
    assert cli.main(["check", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["case"] == "reference"
    by_hand = {row["name"]: row for row in document["by_hand"]}
    assert by_hand["momentum"]["by_hand"] == pytest.approx(by_hand["momentum"]["by_run"], rel=1e-3)
    assert document["violations"] == []


def test_check_says_what_a_failed_spring_violates(tmp_path, capsys):
    path = tmp_path / "failed.toml"
    text = load_case("reference").text.replace("# failed = [3]", "failed = [3]", 1)
    # What a spring that has failed scatters by plays no part.
    path.write_text(text.replace("stiffness.each", "stiffness", 1), encoding="utf-8")
    assert cli.main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert "! violated  lateral rate: the case violates this requirement, lateral_rate <= 2.5 deg/s, in all of" in out
    assert "implausible  requirement" not in out
    assert cli.main(["check", str(path), "--json"]) == 0
    violations = json.loads(capsys.readouterr().out)["violations"]
    assert "in all of 1,024 runs" in violations[0]


TABLE = "table = [[0, 2.0], [10, 1.0]]\n"


@pytest.mark.parametrize(
    ("quantity", "suggested"),
    [
        ("springs.stiffness.each", "'springs.scale.each'"),
        ("springs.deformation", "'springs.scale'"),
        ("springs.stiffness.2", "'springs.scale.2'"),
    ],
)
def test_the_stiffness_of_a_table_suggests_its_factor(quantity, suggested):
    with pytest.raises(CaseError) as caught:
        parse_case(f'{BODIES}{TABLE}[inputs]\nk = {{ quantity = "{quantity}", sigma = "1 %" }}\n')
    assert f"{suggested}, the factor of the force, scatters instead" in str(caught.value)
    assert parse_case(f"{BODIES}{TABLE}[inputs]\nk = {{ quantity = {suggested}, sigma = 0.01 }}\n").inputs


def test_a_near_miss_suggests_a_name_of_the_right_kind():
    inputs = """[inputs]
stiffness = { quantity = "springs.stiffness.each", sigma = "1 %" }
mass = { quantity = "satellite.mass", sigma = 0.01 }
[[correlation]]
inputs = ["stifness", "mass"]
coefficient = 0.5
"""
    with pytest.raises(CaseError, match="did you mean 'stiffness'"):
        parse_case(BODIES + LINEAR + inputs)
    text = load_case("reference").text.replace('"springs.stiffness.each"', '"springs.stifness.each"', 1)
    with pytest.raises(CaseError, match=r"did you mean 'springs\.stiffness\.each'"):
        parse_case(text)
