"""What `simulate --json` prints: every truth case said in a case file, against its 128-bit solution."""

import json
from dataclasses import replace

import numpy as np
import pytest
from separation_cases import TRUTH_CASES, general_separation, mixed_springs
from truth_cases import truth_case_file

from satsep_ot import cli
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.model.case import Case, load_case
from satsep_ot.model.run_document import run_document

VECTORS = ("dv_inertial", "dv_platform", "dr_inertial", "w_sat", "w_plat", "q_sat", "q_plat")


def assert_agrees(motion, truth, limit):
    assert motion["t"] == pytest.approx(truth["t"], rel=limit)
    for name in VECTORS:
        value, expected = np.array(motion[name]), np.array(truth[name])
        if name.startswith("q"):
            expected = expected * np.sign(value @ expected)
        assert np.linalg.norm(value - expected) < limit * max(np.linalg.norm(expected), 1e-3), name


@pytest.mark.parametrize("force_line", ["guided", "strut"])
@pytest.mark.parametrize("name", TRUTH_CASES)
def test_every_truth_case_through_the_command(name, force_line, tmp_path, capsys):
    path, truth = tmp_path / "truth.toml", TRUTH_CASES[name]["results"][force_line]
    path.write_text(truth_case_file(name, force_line), encoding="utf-8")
    for arguments, limit in (([], 1e-8), (["--tolerance", "1e-12"], 1e-11)):
        assert cli.main(["simulate", str(path), "--json", "--at", "0.5", "0", *arguments]) == 0
        document = json.loads(capsys.readouterr().out)
        assert document["case"] == name
        assert document["status"] == "OK"
        assert_agrees(document["at_last_release"], truth["at_last_release"], limit)
        assert_agrees(document["at"][0], truth["at_t_end"], limit)
        assert document["at"][1]["t"] == 0.0
        np.testing.assert_allclose(document["release_times"], truth["t_release"], rtol=limit)
        assert document["quantities"]["axial_velocity"] == document["at_last_release"]["dv_platform"][1]
        if TRUTH_CASES[name]["inputs"]["gravity"] is None:
            scale = np.linalg.norm(document["angular_momentum"]["at_start"]) + 1.0
            assert document["angular_momentum"]["change"] < 10.0 * limit * scale
            assert abs(document["energy"]["error"]) < limit * document["energy"]["gained"]
            assert sum(document["energy"]["spring_work"]) == pytest.approx(truth["spring_work"], rel=1e-8)


def test_times_come_in_the_order_asked_for_and_may_precede_the_last_release():
    document = run_document(load_case("reference"), [0.3, 0.01, 0.3])
    assert [motion["t"] for motion in document["at"]] == [0.3, 0.01, 0.3]
    assert document["at"][0] == document["at"][2]
    early = document["at"][1]
    # The push has only begun: a constant force of four springs on the reduced mass.
    force, inverse_mass = 4 * 5500.0 * 0.04, 1.0 / 1200.0 + 1.0 / 100.0
    assert early["dv_platform"][1] == pytest.approx(force * inverse_mass * 0.01, rel=5e-3)
    assert document["tolerance"] == 1e-8
    assert document["units"]["rate_x"] == "deg/s"


def test_a_tighter_tolerance_is_heard():
    loose, tight = (
        run_document(load_case("reference"), tolerance=tolerance)["at_last_release"]["t"] for tolerance in (1e-3, 1e-12)
    )
    assert loose != tight
    assert loose == pytest.approx(tight, rel=1e-3)


@pytest.mark.parametrize("force_line", ForceLine)
def test_energy_of_springs_of_every_kind(force_line):
    """Tables, a connector's friction, a failed spring and delays; friction in the guides takes its part."""
    separation = general_separation(force_line, springs=mixed_springs(), orbit=None, gradient_torque=False)
    document = run_document(Case("mixed", "", replace(separation, guide_friction=0.0)))
    assert document["status"] == "OK"
    assert document["energy"]["spring_work"][4] == 0.0
    assert abs(document["energy"]["error"]) < 1e-8 * document["energy"]["gained"]
    if force_line == ForceLine.NORMAL:
        for tolerance in (1e-8, 1e-12):
            rubbing = run_document(Case("rubbing", "", separation), tolerance=tolerance)["energy"]
            assert sum(rubbing["spring_work"]) < (1.0 - 1e-4) * sum(document["energy"]["spring_work"])
            assert abs(rubbing["error"]) < 1e-8 * rubbing["gained"]


@pytest.mark.parametrize("time", [-1.0, np.nan, np.inf, 1001.0])
def test_times_that_are_not_allowed(time):
    with pytest.raises(ValueError, match="between 0 and 1000 s after the start"):
        run_document(load_case("reference"), [time])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--tolerance", "0"], "between 1e-13 and 0.01"),
        (["--tolerance", "nan"], "between 1e-13 and 0.01"),
        (["--tolerance", "small"], "between 1e-13 and 0.01"),
        (["--at", "-1"], "between 0 and 1000"),
        (["--at", "0.1", "inf"], "between 0 and 1000"),
        (["--at", "late"], "between 0 and 1000"),
    ],
)
def test_arguments_that_are_not_allowed_are_named_with_exit_code_2(arguments, words, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(["simulate", "reference", "--json", *arguments])
    assert caught.value.code == 2
    captured = capsys.readouterr()
    assert not captured.out
    assert arguments[-1] in captured.err
    assert words in captured.err


def test_a_run_that_fails_has_no_motion(tmp_path, capsys):
    path = tmp_path / "slow.toml"
    text = truth_case_file("reference", "guided")
    path.write_text("horizon = 0.02\n" + text, encoding="utf-8")
    assert cli.main(["simulate", str(path), "--json", "--at", "0.01"]) == 1
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    assert document["status"] == "NO_RELEASE"
    assert document["message"] == "a spring was not released within the horizon"
    assert document["at_last_release"] is None
    assert document["at"] == [None]
    assert document["release_times"] == [None] * 4
    assert document["angular_momentum"] is None
    assert document["energy"] is None
    assert captured.err.count("\n") == 1


def test_the_motion_in_words(capsys):
    assert cli.main(["simulate", "reference", "--at", "0.25"]) == 0
    out = capsys.readouterr().out
    for words in ("0.25 s", "w_sat", "dv_platform", "last release"):
        assert words in out


def test_a_flight_that_is_cut_short_is_no_success(monkeypatch):
    """Were there no steps for times asked for, its numbers would be missing, not silently so."""
    monkeypatch.setattr("satsep_ot.dynamics.simulation.STEPS_PER_SECOND", 0)
    document = run_document(load_case("reference"), [1000.0])
    assert document["at"] == [None]
    assert document["status"] == "TOO_MANY_STEPS"
    assert document["message"].startswith("the flight until 1000 s: all steps that a run may take were used up")
