"""What `check` warns of: each kind of wrong unit once, and silence for the cases of the package."""

import math

import openturns as ot
import pytest

from satsep_ot.model.case import load_case, parse_case, shipped_cases
from satsep_ot.model.plausibility import implausibilities, push_energy, requirement_scatter

REFERENCE = load_case("reference").text
FAST = ("stiffness = 5500.0", "stiffness = 5500.0e3")


@pytest.mark.parametrize("name", shipped_cases())
def test_the_cases_of_the_package_look_as_they_are_meant(name):
    assert implausibilities(load_case(name)) == []


def test_50_metres_a_second_are_named_with_the_energy_that_gives_them():
    # v = sqrt(2 E / mu): 7000 times the energy of 16.5 J and 0.5979 m/s.
    case = parse_case(REFERENCE.replace("stiffness = 5500.0", "stiffness = 38.5e6"))
    assert push_energy(case.separation) == pytest.approx(7000 * 16.5)
    assert f"gives {0.597913 * math.sqrt(7000):.3g} m/s" in implausibilities(case)[0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (*FAST, "897 g"),
        ("stiffness = 5500.0 ", "stiffness = 5.5 ", "gives 0.0189 m/s"),
        ("stroke = 30.0", "stroke = 50.0", "a stroke is longer than the deformation"),
        ("rates = [0.0, 0.0, 0.0]", "rates = [0.0, 1000.0, 0.0]", "1000 deg/s is 167 rpm"),
        ("inertia = [9.35, 8.0, 9.35]", "inertia = [9.35e6, 8.0e6, 9.35e6]", "satellite: its inertia is that of"),
        ("center_of_mass = [0.0, 400.0, 0.0]", "center_of_mass = [0.0, 0.4, 400.0]", "400 mm off the axis"),
        ('"satellite.mass", sigma = 0.5', '"satellite.mass", sigma = 30.0', "a scatter of 93 % of its mean"),
        ('"platform.mass", sigma = 12.0', '"platform.mass", mean = 1.3e3, sigma = 12.0', "is not typical"),
        (
            '"satellite.inertia.yy", sigma = "1.5 %"',
            '"satellite.inertia.yy", mean = 18.0, sigma = 0.5',
            "% of the combinations a tensor that no body has",
        ),
        ("# horizon = 10.0 ", "horizon = 0.42 ", "did not leave the recess"),
    ],
)  # fmt: skip
def test_what_is_hardly_meant_is_said(old, new, words):
    assert old in REFERENCE
    assert any(words in sentence for sentence in implausibilities(parse_case(REFERENCE.replace(old, new, 1))))


def test_share_of_impossible_tensors_is_that_of_the_law():
    # Ixx = Izz = 1, Iyy uniform on 1.5 to 2.5: half of it is above the sum of the other two.
    text = (
        "[platform]\nmass = 10\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[satellite]\nmass = 1\ninertia = [1, 2, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[springs]\ncount = 2\nradius = 1000\nstiffness = 100\ndeformation = 20\nstroke = 10\n"
        '[inputs]\nIyy = { quantity = "satellite.inertia.yy", plus_minus = 0.5 }\n'
    )
    (sentence,) = implausibilities(parse_case(text))
    assert "gives 50 % of the combinations" in sentence


def test_the_random_generator_is_left_alone():
    ot.RandomGenerator.SetSeed(4)
    before = ot.RandomGenerator.Generate()
    ot.RandomGenerator.SetSeed(4)
    implausibilities(load_case("reference"))
    assert ot.RandomGenerator.Generate() == before


def test_a_stroke_that_scatters_beyond_its_table():
    text = load_case("reference").text.replace(
        "stroke = 30.0", "stroke = 30.0\ntable = { 2 = [[0, 220], [30.2, 55]] }", 1
    )
    sentences = implausibilities(parse_case(text))
    assert len(sentences) == 1
    assert sentences[0] == (
        "stroke: the stroke of spring 2 reaches 30.46 mm at the 99.9 % quantile, but its force-stroke table ends at "
        "30.2 mm"
    )


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "minimum = 18.0", "minimum = 0.018",
            "requirement clearance: clearance >= 0.018 mm, but the nominal run has 25, 1,024 scattered ones 18.2 to "
            "25, and all of these meet it (0.018 m? That is 18 mm)",
        ),
        ("maximum = 1.0", "maximum = 0.0175", "of these meet it (0.0175 rad/s? That is 1 deg/s)"),
        ("maximum = 2.5", "maximum = 0.417", "of these meet it (0.417 rpm? That is 2.5 deg/s)"),
        ("minimum = 0.590", "minimum = 590.0", "and none of these meet it (590 mm/s? That is 0.59 m/s)"),
        ("minimum = 0.590", "maximum = 650.0", "and all of these meet it (650 mm/s? That is 0.65 m/s)"),
        ("minimum = 0.590", "minimum = 0.00059", "(0.00059 km/s? That is 0.59 m/s)"),
        ('"axial_velocity"\nminimum = 0.590', '"release_time"\nmaximum = 100.0', "(100 ms? That is 0.1 s)"),
        # No unit explains these: they are violated by most separations.
        ("minimum = 18.0", "minimum = 24.0", "18.2 to 25, and 133 of these meet it"),
        ("minimum = 18.0", "minimum = 18000.0", "18.2 to 25, and none of these meet it"),
    ],
)  # fmt: skip
def test_a_limit_in_a_wrong_unit_is_named_with_the_unit_that_it_seems_to_be_in(old, new, sentence):
    assert old in REFERENCE
    (said,) = implausibilities(parse_case(REFERENCE.replace(old, new, 1)))
    assert sentence in said


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("minimum = 0.590", "minimum = 0.3"),
        ("minimum = 0.590", "minimum = 0.0"),
        ("minimum = 0.590", "maximum = 2.0"),
        ("minimum = 18.0", "minimum = 1.0"),
        ("minimum = 18.0", "minimum = 0.0"),
        ("maximum = 2.5", "maximum = 20.0"),
        ("maximum = 1.0", "maximum = 100.0"),
    ],
)
def test_a_generous_limit_is_no_wrong_unit(old, new):
    assert old in REFERENCE
    assert implausibilities(parse_case(REFERENCE.replace(old, new, 1))) == []


def test_scatter_of_a_requirement_is_that_of_its_quantity():
    # Guided springs without gravity: v^2 = 2 E (1 / m1 + 1 / m2) rises with the one stiffness, uniform within 10 %.
    text = (
        "[platform]\nmass = 10\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[satellite]\nmass = 1\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[springs]\ncount = 2\nradius = 1000\nstiffness = 1000\ndeformation = 20\nstroke = 10\n"
        '[inputs]\nK = { quantity = "springs.stiffness", plus_minus = "10 %" }\n'
        '[[requirements]]\nquantity = "axial_velocity"\nminimum = {limit}\n'
    )
    velocity = math.sqrt(2.0 * 2 * 1000 * 0.01 * 0.015 * 1.1)
    (row,) = requirement_scatter(parse_case(text.replace("{limit}", str(velocity))))
    assert row.nominal == pytest.approx(velocity)
    assert row.median == pytest.approx(velocity, rel=1e-3)
    assert row.smallest == pytest.approx(velocity * math.sqrt(0.9), rel=1e-3)
    assert row.largest == pytest.approx(velocity * math.sqrt(1.1), rel=1e-3)
    assert (row.unit, row.runs) == ("m/s", 1024)
    # Half of a Sobol' sequence lies above the median, give or take the point on it.
    assert abs(row.met - 512) <= 1


def test_a_case_without_scatter_is_judged_by_its_nominal_run():
    text = REFERENCE[: REFERENCE.index("[inputs]")] + '[[requirements]]\nquantity = "axial_velocity"\nminimum = 590\n'
    case = parse_case(text)
    (row,) = requirement_scatter(case)
    assert (row.met, row.runs) == (0, 0)
    assert row.smallest == row.largest == row.nominal
    assert implausibilities(case) == [
        "requirement axial_velocity: axial_velocity >= 590 m/s, but the nominal run has 0.598 (590 mm/s? That is 0.59 "
        "m/s)"
    ]
