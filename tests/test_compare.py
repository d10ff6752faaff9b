"""Designs side by side: common random numbers, what differs, which difference explains most."""

import json

import pytest
from scipy import stats
from small_cases import BODIES, LINEAR

from satsep_ot import cli
from satsep_ot.model.case import parse_case
from satsep_ot.studies.design_comparison import Design, compare_designs
from satsep_ot.studies.telling.design_comparison import change_lines

UNIT = 0.01 * 3.141592653589793 / 180.0


def text_with(rate=0.4, kick=0.3, mass=1, limit=1.0, extra=""):
    """The rate about y is the sum of two normal ones; the mass plays no part in it."""
    bodies = BODIES.replace("mass = 1\n", f"mass = {mass}\n")
    return (
        f"{bodies}{LINEAR}[inputs]\n"
        f'rate = {{ quantity = "initial.rates.y", sigma = {rate} }}\n'
        f'kick = {{ quantity = "impulse.angular_momentum.y", sigma = {kick * UNIT} }}\n'
        f'[[requirements]]\nname = "rolling"\nquantity = "spin"\nmaximum = {limit}\nallowed_probability = 0.1\n{extra}'
    )


def truth(rate, kick):
    return 2.0 * stats.norm.sf(1.0 / (rate**2 + kick**2) ** 0.5)


def design(name, **changes):
    return Design(name, parse_case(text_with(**changes), f"{name}.toml"), f"{name}.toml")


@pytest.fixture(scope="module")
def found():
    others = (design("calm", rate=0.3), design("heavy", mass=2), design("both", rate=0.3, kick=0.29, mass=2))
    return compare_designs([design("first"), *others], runs=20_000)


def test_probabilities_and_paired_differences(found):
    assert found.designs == ("first", "calm", "heavy", "both")
    first, calm, heavy, _ = found.estimates["rolling"]
    for one, sizes in ((first, (0.4, 0.3)), (calm, (0.3, 0.3))):
        assert one.lower95 <= truth(*sizes) <= one.upper95
    assert calm.difference_lower95 <= truth(0.3, 0.3) - truth(0.4, 0.3) <= calm.difference_upper95 < 0.0
    # With numbers of its own, the difference would have an interval this wide; common ones are much better.
    apart = 3.92 * (2.0 * truth(0.4, 0.3) / 20_000) ** 0.5
    assert calm.difference_upper95 - calm.difference_lower95 < 0.75 * apart
    # The mass plays no part: the same runs violate.
    assert heavy.difference == 0.0
    assert heavy.difference_text.startswith("no difference shown")


def test_what_nothing_violates_is_bounded_by_all_common_runs():
    texts = [text_with(rate=rate, kick=0.01).replace("= 0.1\n", "= 1e-3\n") for rate in (0.01, 0.005)]
    assert "allowed_probability = 1e-3" in texts[0]
    designs = [Design(name, parse_case(text), name) for name, text in zip(("calm", "calmer"), texts, strict=True)]
    for one in compare_designs(designs, 20_000).estimates["rolling"]:
        assert one.probability == 0.0
        assert one.upper95 < 2e-4


def test_what_differs_and_what_explains_most(found):
    changes = {change.keys: change for change in found.changes["both"]}
    assert set(changes) == {("satellite.mass",), ("inputs.rate",), ("inputs.kick",)}
    assert changes[("satellite.mass",)].text == "satellite.mass: 1 -> 2"
    explained = found.explanation("both", "rolling")
    assert explained.startswith("both, rolling: inputs.rate: sigma 0.4 -> sigma 0.3 explains most")
    assert "explains most; alone it changes" in explained
    lines = list(change_lines(found))
    assert any(line.startswith("heavy: satellite.mass: 1 -> 2; alone: rolling") for line in lines)
    assert any(line.startswith("calm, rolling: inputs.rate") for line in lines)


def test_keys_that_make_no_case_alone_are_changed_together():
    other = (
        text_with()
        .replace("count = 2\n", "angles = [45, 135, 225, 315]\n")
        .replace("deformation = 20", "deformation = 21")
    )
    found = compare_designs([design("two"), Design("four", parse_case(other, "four.toml"), "four.toml")], runs=2_000)
    keys = [change.keys for change in found.changes["four"]]
    assert ("springs.deformation",) in keys
    assert any(set(members) == {"springs.count", "springs.angles"} for members in keys)


def test_designs_of_other_requirements_and_single_ones_are_refused(tmp_path, capsys):
    with pytest.raises(
        ValueError, match=r"the requirements of first and strict differ, for example rolling \(spin <= "
    ):
        compare_designs([design("first"), design("strict", limit=0.5)])
    path = tmp_path / "one.toml"
    path.write_text(text_with(), encoding="utf-8")
    assert cli.main(["compare", str(path)]) == 2
    assert "give at least two" in capsys.readouterr().err
    assert cli.main(["compare", str(path), str(tmp_path / "none.toml")]) == 2
    assert "there is no such file" in capsys.readouterr().err


def test_the_command_compares_files_and_finished_studies(tmp_path, capsys):
    for name, rate in (("a", 0.4), ("b", 0.3)):
        (tmp_path / f"{name}.toml").write_text(text_with(rate=rate), encoding="utf-8")
    files = [str(tmp_path / "a.toml"), str(tmp_path / "b.toml")]
    study = ["study", files[1], "--quick", "--runs", "5000", "--output", str(tmp_path / "done")]
    assert cli.main(study) == 0
    capsys.readouterr()
    output = tmp_path / "compared"
    assert cli.main(["compare", *files, str(tmp_path / "done"), "--runs", "5000", "--output", str(output)]) == 0
    text = capsys.readouterr().out
    assert "5,000 common runs" in text
    assert "its study, " in text
    assert "b: inputs.rate: " in text
    page = (output / "comparison.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml;base64,") == 2
    assert "What differs, and what explains most" in page
    assert "spin &lt;= 1 deg/s" in page
    assert cli.main(["compare", *files, "--runs", "5000", "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    kept = json.loads((output / "comparison.json").read_text(encoding="utf-8"))
    assert printed["estimates"]["rolling"] == kept["estimates"]["rolling"][:2]
    # Fewer than 100 runs violate the second design.
    assert printed["estimates"]["rolling"][0]["runs"] == 5000 < printed["estimates"]["rolling"][1]["runs"]
    assert printed["changes"]["b"][0]["keys"] == ["inputs.rate"]
