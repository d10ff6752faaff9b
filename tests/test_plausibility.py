"""What `check` warns of: each kind of wrong unit once, and silence for the cases of the package."""

import math
import re

import openturns as ot
import pytest

from satsep_ot.model.case import load_case, parse_case, shipped_cases
from satsep_ot.model.plausibility import plausibility_warnings, push_energy, requirement_scatter, violation_sentences

REFERENCE = load_case("reference").text
FAST = ("stiffness = 5500.0", "stiffness = 5500.0e3")


@pytest.mark.parametrize("name", shipped_cases())
def test_the_cases_of_the_package_look_as_they_are_meant(name):
    assert plausibility_warnings(load_case(name)) == []


def test_50_metres_a_second_are_named_with_the_energy_that_gives_them():
    # v = sqrt(2 E / mu): 7000 times the energy of 16.5 J and 0.5979 m/s.
    case = parse_case(REFERENCE.replace("stiffness = 5500.0", "stiffness = 38.5e6"))
    assert push_energy(case.separation) == pytest.approx(7000 * 16.5)
    assert f"gives {0.597913 * math.sqrt(7000):.3g} m/s" in plausibility_warnings(case)[0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (*FAST, "897 g"),
        ("stiffness = 5500.0 ", "stiffness = 5.5 ", "gives 0.0189 m/s"),
        ("stroke = 30.0", "stroke = 50.0", "a stroke is longer than the deformation"),
        ("rates = [0.0, 0.0, 0.0]", "rates = [0.0, 1000.0, 0.0]", "1000 deg/s is 167 rpm"),
        ("inertia = [9.35, 8.0, 9.35]", "inertia = [9.35e6, 8.0e6, 9.35e6]", "kg and its inertia are those of"),
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
    assert any(words in sentence for sentence in plausibility_warnings(parse_case(REFERENCE.replace(old, new, 1))))


CUBESAT = re.sub(r" *#.*", "", load_case("cubesat").text)
# Without the inputs, whose scatter a nominal value in a wrong unit does not bear.
BARE = re.sub(r" *#.*", "", REFERENCE[: REFERENCE.index("[inputs]")])
STRUT = BARE.replace('force_line = "guided"', 'force_line = "strut"\nstowed_length = 40.0')


def test_the_push_of_a_force_stroke_table_counts():
    text = re.sub(r"^(stiffness|deformation) = .*\n", "", BARE, flags=re.MULTILINE)
    text = text.replace("[springs]", "[springs]\ntable = [[0, 220e3], [30, 55e3]]")
    assert any("accelerate the satellite by 897 g" in sentence for sentence in plausibility_warnings(parse_case(text)))


@pytest.mark.parametrize(
    ("text", "old", "new", "sentence"),
    [
        (
            CUBESAT, "radius = 65.0", "radius = 0.065",
            "springs: a radius of 0.065 mm; separations have 5 to 10000 mm (mm; written in m?)",
        ),
        (CUBESAT, "radius = 65.0", "radius = 65e3", "springs: a radius of 6.5e+04 mm; separations have 5 to 10000 mm"),
        (BARE, "stroke = 30.0", "stroke = 0.03", "springs: a stroke of 0.03 mm; separations have 1 to 2000 mm (mm; wr"),
        (BARE, "deformation = 40.0", "deformation = 0.04", "springs: a deformation of 0.04 mm; separations"),
        (STRUT, "stowed_length = 40.0", "stowed_length = 0.04", "springs: a stowed length of 0.04 mm; separations"),
        (
            CUBESAT, "stiffness = 850.0", "stiffness = 0.85",
            "springs: a stiffness of 0.85 N/m; separations have 5 to 1e+08 N/m (N/m; written in N/mm?)",
        ),
        (BARE, "350.0\nheight = 800.0", "0.35\nheight = 0.8", "envelope: a size of 0.8 mm"),
        (BARE, "recess_radius = 520.0", "recess_radius = 0.52", "envelope: a recess radius of 0.52 mm"),
        (BARE, "recess_depth = 250.0", "recess_depth = 0.25", "envelope: a recess depth of 0.25 mm"),
        (
            CUBESAT, "[0.0, 56.75, 0.0]", "[0.0, 0.05675, 0.0]",
            "satellite: its centre of mass is 0.0568 mm from the ring centre, its radius of gyration 43.6 mm (mm; wri",
        ),
        (REFERENCE, "[0.0, -1600.0, 0.0]", "[0.0, -1.6, 0.02]", "platform: its centre of mass is 1.6 mm from the"),
        (CUBESAT, "mass = 2.0\n", "mass = 2000.0\n", "satellite: its mass of 2000 kg and its inertia are those of"),
        (CUBESAT, "mass = 2.0\n", "mass = 2000.0\n", "(mass in kg; written in g? inertia in kg m2?)"),
        (
            CUBESAT, 'center_of_mass.x", three_sigma = 6.0', 'center_of_mass.x", three_sigma = 0.006',
            "satellite_cg_x: 99.8 % of its values lie within -0.00618 to 0.00618 mm, closer than anyone measures (mm; "
            "written in m?)",
        ),
        (
            REFERENCE, '"springs.stroke", sigma = 0.15', '"springs.stroke", sigma = 0.15e-3',
            "within 29.999536 to 30.000464 mm",
        ),
        (REFERENCE, "a = 0.0, b = 2.0", "a = 0.0, b = 0.002", "measures (ms; written in s?)"),
    ],
)  # fmt: skip
def test_a_unit_a_thousand_times_larger_is_named(text, old, new, sentence):
    assert old in text
    sentences = plausibility_warnings(parse_case(text.replace(old, new, 1)))
    assert any(sentence in said for said in sentences), sentences
    # The right value is not.
    assert not any(sentence[:20] in said for said in plausibility_warnings(parse_case(text)))


@pytest.mark.parametrize(
    ("old", "new"),
    [
        # One spring in the middle, a ring around the centre of mass, and machining to a hundredth.
        ("angles = [45.0, 225.0]\nradius = 65.0", "count = 1\nradius = 0.0"),
        ("[0.0, 56.75, 0.0]", "[0.4, 0.0, -0.3]"),
        ("plus_minus = 0.1", "plus_minus = 0.01"),
    ],
)  # fmt: skip
def test_small_numbers_that_are_meant(old, new):
    assert old in CUBESAT
    said = plausibility_warnings(parse_case(CUBESAT.replace(old, new)))
    assert not any("written in" in sentence for sentence in said), said


ALTITUDE = 'altitude = 500.0\n\n\n\npush = "along-track"'
WIDE = "half_width = 350.0\nheight = 800.0"
SMALL = "recess_radius = 520.0\nrecess_depth = 250.0"


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        (
            "[0.0, 400.0, 0.0]", "[0.0, -400.0, 0.0]",
            "centres of mass: the satellite's is at y = -400 mm and the platform's at -1600 mm; the push is along y, "
            "so that the satellite is pushed into the platform (a wrong sign, or the bodies swapped?)",
        ),
        ("[0.0, -1600.0, 0.0]", "[0.0, 1600.0, 0.0]", "centres of mass: the satellite's is at y = 400 mm and the plat"),
        (
            "mass = 100.0", "mass = 12100.0",
            "satellite: its mass of 12100 kg is 10.1 times the platform's, 1200 kg (masses or bodies swapped?)",
        ),
        ("altitude = 500.0", "altitude = 500e3", "orbit: an altitude of 500000 km; separations have 0 to 100000 km"),
        (
            ALTITUDE, "position = [6878137.0, 0, 0]\nvelocity = [0, 7612.0, 0]",
            "orbit: a velocity of 7612 km/s; separations have 0.1 to 20 km/s (km/s?)",
        ),
        (
            "radius = 300.0", "radius = 560.0",
            "springs: a radius of 560 mm is outside of the recess, whose radius is 520 mm",
        ),
        (
            WIDE, "half_width = 100.0\nheight = 800.0",
            "springs: a radius of 300 mm is outside of the satellite, whose envelope is within 141 mm of the axis",
        ),
        (
            "half_width = 350.0", "half_width = 400.0",
            "walls: the nominal run leaves through one, by 45.7 mm; walls do not hold the satellite, its rates are "
            "those of a free body",
        ),
    ],
)  # fmt: skip
def test_an_arrangement_that_is_hardly_meant_is_said(old, new, sentence):
    assert old in BARE
    said = plausibility_warnings(parse_case(BARE.replace(old, new, 1)))
    assert any(one.startswith(sentence) for one in said), said
    assert plausibility_warnings(parse_case(BARE)) == []


@pytest.mark.parametrize(
    ("old", "new"),
    [
        # A satellite that is held around its middle, and one that is heavier than an empty stage.
        ("[0.0, 400.0, 0.0]", "[0.0, -50.0, 0.0]"),
        ("mass = 100.0", "mass = 2400.0"),
        # A platform around a deep recess.
        (f"[0.0, -1600.0, 0.0]|{SMALL}", "[0.0, 700.0, 0.0]|recess_radius = 520.0\nrecess_depth = 800.0"),
        # A nozzle within a ring of springs around its own recess.
        (
            f"{WIDE}\n{SMALL}",
            "points = [[80, -100, 0], [80, 0, 0], [0, 0, 80]]\nrecess_radius = 200.0\nrecess_depth = 10.0",
        ),
        # An orbit of the Moon, and the way to it.
        (ALTITUDE, "gravitational_parameter = 4902.8\nposition = [1837.4, 0, 0]\nvelocity = [0, 1.633, 0]"),
        (ALTITUDE, "position = [6578.0, 0, 0]\nvelocity = [0, 11.1, 0]"),
    ],
)
def test_an_arrangement_that_is_meant(old, new):
    text = BARE
    for was, now in zip(old.split("|"), new.split("|"), strict=True):
        assert was in text
        text = text.replace(was, now, 1)
    assert plausibility_warnings(parse_case(text)) == []


def test_walls_are_left_to_their_requirement():
    text = BARE.replace("half_width = 350.0", "half_width = 400.0", 1)
    requirement = '[[requirements]]\nquantity = "clearance"\nminimum = 0.0\n'
    case = parse_case(text + requirement)
    assert plausibility_warnings(case) == []
    assert [one.split(":")[0] for one in violation_sentences(case)] == ["clearance"]


@pytest.mark.parametrize(("sigma", "warned"), [(0.3, False), (0.01, False), (0.005, True)])
def test_a_cant_in_rad_is_named(sigma, warned):
    text = REFERENCE.replace('"springs.cant.each", sigma = 0.3', f'"springs.cant.each", sigma = {sigma}', 1)
    said = plausibility_warnings(parse_case(text))
    assert len(said) == 4 * warned
    assert all("closer than anyone measures (deg; written in rad?)" in one for one in said)


def test_all_runs_are_100_percent():
    (sentence,) = plausibility_warnings(parse_case(REFERENCE.replace("# horizon = 10.0 ", "horizon = 0.1 ", 1)))
    assert sentence.startswith("runs: 100 % of the combinations of the inputs fail")


def test_share_of_impossible_tensors_is_that_of_the_law():
    # Ixx = Izz = 1, Iyy uniform on 1.5 to 2.5: half of it is above the sum of the other two.
    text = (
        "[platform]\nmass = 10\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[satellite]\nmass = 1\ninertia = [1, 2, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[springs]\ncount = 2\nradius = 1000\nstiffness = 100\ndeformation = 20\nstroke = 10\n"
        '[inputs]\nIyy = { quantity = "satellite.inertia.yy", plus_minus = 0.5 }\n'
    )
    (sentence,) = plausibility_warnings(parse_case(text))
    assert "gives 50 % of the combinations" in sentence


def test_the_random_generator_is_left_alone():
    ot.RandomGenerator.SetSeed(4)
    before = ot.RandomGenerator.Generate()
    ot.RandomGenerator.SetSeed(4)
    plausibility_warnings(load_case("reference"))
    assert ot.RandomGenerator.Generate() == before


def test_a_stroke_that_scatters_beyond_its_table():
    text = load_case("reference").text.replace(
        "stroke = 30.0", "stroke = 30.0\ntable = { 2 = [[0, 220], [30.2, 55]] }", 1
    )
    sentences = plausibility_warnings(parse_case(text))
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
    ],
)  # fmt: skip
def test_a_limit_in_a_wrong_unit_is_named_with_the_unit_that_it_seems_to_be_in(old, new, sentence):
    assert old in REFERENCE
    (said,) = plausibility_warnings(parse_case(REFERENCE.replace(old, new, 1)))
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
    assert plausibility_warnings(parse_case(REFERENCE.replace(old, new, 1))) == []


@pytest.mark.parametrize(
    ("limit", "share"),
    [("24.0", "891 of 1,024"), ("18000.0", "all of 1,024")],
)
def test_a_limit_that_no_unit_explains_is_violated_not_implausible(limit, share):
    case = parse_case(REFERENCE.replace("minimum = 18.0", f"minimum = {limit}", 1))
    assert plausibility_warnings(case) == []
    assert violation_sentences(case) == [
        f"clearance: the case violates this requirement, clearance >= {float(limit):g} mm, in {share} runs (18.2 to 25)"
    ]


def test_a_failed_spring_violates_its_requirements_and_looks_as_it_is_meant():
    case = parse_case(REFERENCE.replace("# failed = [3]", "failed = [3]", 1).replace("stiffness.each", "stiffness", 1))
    violated = violation_sentences(case)
    assert violated[0].startswith(
        "lateral rate: the case violates this requirement, lateral_rate <= 2.5 deg/s, in all of"
    )
    assert not any(one.startswith("requirement") for one in plausibility_warnings(case))


def test_a_case_whose_nominal_run_fails_violates_nothing_yet():
    case = parse_case(BARE.replace("# horizon = 10.0 ", "") + "")
    late = parse_case("horizon = 0.01\n" + BARE + '[[requirements]]\nquantity = "axial_velocity"\nminimum = 0.1\n')
    assert violation_sentences(case) == violation_sentences(late) == []


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
    assert plausibility_warnings(case) == [
        "requirement axial_velocity: axial_velocity >= 590 m/s, but the nominal run has 0.598 (590 mm/s? That is 0.59 "
        "m/s)"
    ]
