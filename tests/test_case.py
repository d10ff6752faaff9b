"""Case files: what they say arrives in SI, and whatever is wrong is one sentence with file, key and what is allowed."""

import math
import random
import re
from importlib import resources

import numpy as np
import openturns as ot
import pytest

from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.relative_orbit import Recontact
from satsep_ot.dynamics.rotations import rotation_matrix
from satsep_ot.dynamics.separation import Pivot, umbilical
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.dynamics.springs import ForceLaw, ForceLine
from satsep_ot.model.case import Case, CaseError, load_case, parse_case, shipped_cases

REFERENCE = (resources.files("satsep_ot.model") / "cases" / "reference.toml").read_text(encoding="utf-8")


def changed(old, new):
    """The reference case with one piece of text replaced."""
    assert old in REFERENCE
    return REFERENCE.replace(old, new, 1)


def refusal(text):
    """The one sentence that says why a text is refused."""
    with pytest.raises(CaseError) as caught:
        parse_case(text, "mine.toml")
    message = str(caught.value)
    assert message.startswith("mine.toml: ")
    assert "\n" not in message
    return message


def test_the_reference_case_says_what_the_specification_says():
    case = load_case("reference")
    separation = case.separation
    assert separation.platform.mass == 1200.0
    assert np.array_equal(separation.platform.inertia, np.diag([1500.0, 600.0, 1500.0]))
    assert np.allclose(separation.platform.center_of_mass, [0.0, -1.6, 0.0], rtol=0, atol=1e-15)
    assert separation.satellite.mass == 100.0
    assert np.array_equal(separation.satellite.inertia, np.diag([9.35, 8.0, 9.35]))
    assert np.allclose(separation.satellite.center_of_mass, [0.0, 0.4, 0.0], rtol=0, atol=1e-15)
    assert np.allclose(np.degrees(separation.springs.angle), [45.0, 135.0, 225.0, 315.0])
    for name, value in dict(radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03, cant=0.0, delay=0.0).items():
        assert np.allclose(getattr(separation.springs, name), np.full(4, value), rtol=1e-15, atol=0), name
    assert separation.force_line is ForceLine.GUIDED
    assert separation.pivot is Pivot.STACK
    radius = 6378137.0 + 500e3
    assert np.allclose(separation.orbit.position, [radius, 0.0, 0.0])
    assert np.allclose(separation.orbit.velocity, [0.0, math.sqrt(3.986004418e14 / radius), 0.0])
    assert len(separation.envelope) == 8
    assert len(separation.recess_points()) == 4
    assert (separation.recess_radius, separation.recess_depth) == (0.52, 0.25)
    limits = [(entry.quantity, entry.limit, entry.is_maximum) for entry in case.requirements]
    assert limits == [
        ("lateral_rate", 2.5, True), ("spin", 1.0, True), ("axial_velocity", 0.590, False), ("clearance", 18.0, False),
    ]  # fmt: skip


def test_a_case_is_found_by_name_by_path_and_as_itself(tmp_path):
    assert shipped_cases() == sorted(shipped_cases())
    path = tmp_path / "mine.toml"
    path.write_text(changed('name = "reference"', ""), encoding="utf-8")
    case = load_case(path)
    assert case.name == "mine"
    assert load_case(str(path)).name == "mine"
    assert load_case(case) is case
    assert isinstance(load_case(), Case)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(
        CaseError, match=r"there is no such file, and no case of that name in the package \(.*reference.*\)"
    ):
        load_case("nothing")
    with pytest.raises(CaseError, match=r"; did you mean 'reference'\?$"):
        load_case("referense")
    with pytest.raises(CaseError, match="it is a directory; give a regular file"):
        load_case(tmp_path)
    path = tmp_path / "binary.toml"
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(CaseError, match="not UTF-8"):
        load_case(path)
    with pytest.raises(CaseError, match="cannot be read"):
        load_case("a\0b")
    path.write_text("#" * 4_100_000, encoding="utf-8")
    with pytest.raises(CaseError, match="more than 4000000 characters; give a shorter one"):
        load_case(path)


def test_every_spring_may_differ():
    text = changed("count = 4 ", "angles = [0, 90, 200] #").replace("stiffness = 5500.0", "stiffness = [1, 2, 3]")
    text = text.replace("cant = 0.0 ", "cant = [0, 1.5, -2] #")
    springs = parse_case(text).separation.springs
    assert np.allclose(np.degrees(springs.angle), [0.0, 90.0, 200.0])
    assert springs.stiffness.tolist() == [1.0, 2.0, 3.0]
    assert np.allclose(np.degrees(springs.cant), [0.0, 1.5, -2.0])
    assert np.allclose(springs.radius, 0.3)


def test_a_strut_with_its_stowed_length():
    case = parse_case(changed('force_line = "guided"', 'force_line = "strut"\nstowed_length = 40.0'))
    assert case.separation.force_line is ForceLine.STRUT
    assert case.separation.stowed_length == pytest.approx(0.04, rel=1e-15)


def test_a_rod_that_slides_on_the_plate():
    separation = parse_case(changed('"guided"', '"normal"\nguide_friction = 0.15')).separation
    assert separation.force_line is ForceLine.NORMAL
    assert separation.guide_friction == 0.15


def test_springs_that_have_failed_or_are_weak():
    assert parse_case(changed("stroke = 30.0", "stroke = 30\nfailed = [3]")).separation.springs.scale.tolist() == [
        1,
        1,
        0,
        1,
    ]
    text = changed("stroke = 30.0", "stroke = 30\nfailed = [4, 1]\nscale = [1, 0.9, 1.1, 1]")
    assert parse_case(text).separation.springs.scale.tolist() == [0.0, 0.9, 1.1, 0.0]


UMBILICAL = "angle = 30\nradius = 250\nstiffness = 2000\ndeformation = 8\nstroke = 6\nfriction = 15\nengagement = 5\n"


def test_an_umbilical_connector_or_several():
    expected = umbilical(math.radians(30.0), 0.25, 2000.0, 0.008, 0.006, friction=15.0, engagement=0.005)
    springs = parse_case(changed("[initial]", f"[umbilical]\n{UMBILICAL}[initial]")).separation.springs
    assert len(springs) == 6
    np.testing.assert_allclose(springs.parameters()[-16:], expected.parameters(), rtol=1e-15)
    assert springs.laws[-2:].tolist() == [ForceLaw.LINEAR, ForceLaw.FRICTION]
    two = f"[[umbilical]]\n{UMBILICAL}[[umbilical]]\n{UMBILICAL.replace('angle = 30', 'angle = 200')}[initial]"
    springs = parse_case(changed("[initial]", two)).separation.springs
    assert np.allclose(np.degrees(springs.angle[4:]), [30.0, 30.0, 200.0, 200.0])


def test_impulses_at_the_start():
    text = changed("[initial]", "[impulse]\nmomentum = [1, -2, 3]\nangular_momentum = [0.1, 0.2, -0.3]\n[initial]")
    separation = parse_case(text).separation
    assert separation.impulse.tolist() == [1.0, -2.0, 3.0]
    assert separation.angular_impulse.tolist() == [0.1, 0.2, -0.3]
    assert not load_case("reference").separation.impulse.any()


def test_plane_walls_beside_the_cylinder_or_instead():
    walls = "planes = [{ normal = [0, 0, -2], offset = -400.0 }]"
    separation = parse_case(changed("recess_radius = 520.0", f"recess_radius = 520.0\n{walls} #")).separation
    np.testing.assert_allclose(separation.recess_planes, [[0.0, 0.0, -1.0, -0.4]])
    text = changed("recess_radius = 520.0", "#").replace(
        "[inputs]", "[[envelope.planes]]\nnormal = [-3, 0, 4]\noffset = -800.0\n[inputs]", 1
    )
    separation = parse_case(text).separation
    np.testing.assert_allclose(separation.recess_planes, [[-0.6, 0.0, 0.8, -0.8]])
    assert separation.recess_radius == 0.0
    # Of the four corners the one farthest against the normal is 800 - 0.6 350 - 0.8 350 mm from it.
    assert simulate(separation).quantity("clearance")[0] == pytest.approx(310.0, abs=1e-3)


def test_full_inertia_tensor_and_initial_state():
    text = changed("[9.35, 8.0, 9.35]", "[[9.35, 0.1, 0.2], [0.1, 8.0, 0.3], [0.2, 0.3, 9.35]]")
    text = text.replace("rates = [0.0, 0.0, 0.0]", "rates = [1.0, -2.0, 3.0]")
    text = text.replace("mounting_error = [0.0, 0.0, 0.0]", "mounting_error = [0.1, 0.2, 0.3]")
    text = text.replace('pivot = "stack"', 'pivot = "platform"')
    separation = parse_case(text).separation
    assert separation.satellite.inertia[0].tolist() == [9.35, 0.1, 0.2]
    assert np.allclose(np.degrees(separation.rates), [1.0, -2.0, 3.0])
    assert np.allclose(np.degrees(separation.mounting_error), [0.1, 0.2, 0.3])
    assert separation.pivot is Pivot.PLATFORM


@pytest.mark.parametrize("attitude", ["[10.0, 20.0, 30.0]", "[0.5, 0.5, 0.5, 0.5]"])
@pytest.mark.parametrize(
    ("push", "direction"),
    [
        ("along-track", lambda r, v: v),
        ("against-track", lambda r, v: -v),
        ("up", lambda r, v: r),
        ("down", lambda r, v: -r),
        ("normal", lambda r, v: np.cross(r, v)),
        ("anti-normal", lambda r, v: -np.cross(r, v)),
    ],
)
def test_the_separation_axis_points_where_the_push_says(push, direction, attitude):
    text = changed('"along-track"', f'"{push}"').replace("# attitude = [0.0, 0.0, 0.0]", f"attitude = {attitude}")
    separation = parse_case(text).separation
    r, v = separation.orbit.position, separation.orbit.velocity
    assert r @ v == pytest.approx(0.0, abs=1e-3)
    assert np.linalg.norm(v) ** 2 * np.linalg.norm(r) == pytest.approx(separation.orbit.mu, rel=1e-14)
    axis = direction(r, v)
    y = rotation_matrix(separation.attitude)[:, 1]
    assert np.allclose(y, axis / np.linalg.norm(axis), rtol=0, atol=1e-14)


def test_orbit_by_position_and_velocity_or_none():
    text = changed("altitude = 500.0", "position = [7000.0, 1.0, 2.0]\nvelocity = [0.1, 7.5, 0.3]")
    separation = parse_case(text.replace('push = "along-track"', "")).separation
    orbit = separation.orbit
    assert separation.attitude.tolist() == [1.0, 0.0, 0.0, 0.0]
    assert orbit.position.tolist() == [7000e3, 1e3, 2e3]
    assert np.allclose(orbit.velocity, [100.0, 7500.0, 300.0])
    start, end = REFERENCE.index("[orbit]"), REFERENCE.index("[envelope]")
    assert parse_case(REFERENCE[:start] + REFERENCE[end:]).separation.orbit is None


ELEMENTS = "right_ascension = 20.0\nargument_of_perigee = 30.0\ntrue_anomaly = 40.0\ninclination = 97.4\nj2 = true\n"


@pytest.mark.parametrize(
    ("size", "axis", "eccentricity"),
    [
        ("altitude = 500.0", 6878.137e3, 0.0),
        ("perigee_altitude = 500.0\napogee_altitude = 700.0", 6978.137e3, 100.0 / 6978.137),
        ("semi_major_axis = 7000.0\neccentricity = 0.05", 7000e3, 0.05),
        ("semi_major_axis = 7000.0", 7000e3, 0.0),
    ],
)
def test_orbit_by_elements(size, axis, eccentricity):
    """The push is along the track unless an attitude is given."""
    text = changed("altitude = 500.0 ", size + "\n" + ELEMENTS + "#").replace("push = ", "#")
    separation = parse_case(text).separation
    expected = Orbit.from_elements(axis, eccentricity, *np.radians([97.4, 20.0, 30.0, 40.0]))
    assert np.allclose(separation.orbit.position, expected.position, rtol=1e-14)
    assert np.allclose(separation.orbit.velocity, expected.velocity, rtol=1e-14)
    assert separation.orbit.j2
    y = rotation_matrix(separation.attitude)[:, 1]
    assert y @ expected.position == pytest.approx(0.0, abs=1e-6)
    assert y @ np.cross(expected.position, expected.velocity) == pytest.approx(0.0, abs=1e-1)
    assert y @ expected.velocity > 0.0
    turned = parse_case(text.replace("# attitude = [0.0, 0.0, 0.0]", "attitude = [0.6, 0.0, 0.0, 0.8]")).separation
    assert np.allclose(turned.attitude, [0.6, 0.0, 0.0, 0.8])
    assert np.array_equal(turned.orbit.position, separation.orbit.position)
    twice = text.replace("# attitude", "attitude").replace('#"along-track"', 'push = "up" #')
    assert "orbit.push and initial.attitude are both given" in refusal(twice)


@pytest.mark.parametrize("orbit", ["position = [6000, 3000, 2000]\nvelocity = [1, -2, 7]", "altitude = 9\n" + ELEMENTS])
@pytest.mark.parametrize(
    ("push", "direction"),
    [
        ("along-track", lambda r, v: np.cross(np.cross(r, v), r)),
        ("against-track", lambda r, v: np.cross(r, np.cross(r, v))),
        ("up", lambda r, v: r),
        ("down", lambda r, v: -r),
        ("normal", lambda r, v: np.cross(r, v)),
        ("anti-normal", lambda r, v: -np.cross(r, v)),
    ],
)
def test_the_push_has_a_meaning_on_every_orbit(push, direction, orbit):
    text = changed("altitude = 500.0 ", orbit + "#").replace('"along-track"', f'"{push}"')
    separation = parse_case(text).separation
    axis = direction(separation.orbit.position, separation.orbit.velocity)
    y = rotation_matrix(separation.attitude)[:, 1]
    assert np.allclose(y, axis / np.linalg.norm(axis), rtol=0, atol=1e-14)


def test_a_window_of_re_contact():
    assert load_case("reference").separation.recontact is None
    assert parse_case(changed("[envelope]", "[recontact]\n[envelope]")).separation.recontact == Recontact()
    text = changed("[envelope]", "[recontact]\nstart_orbits = 0\nend_orbits = 3\n[envelope]")
    separation = parse_case(text.replace('quantity = "spin"', 'quantity = "recontact_distance"')).separation
    assert separation.recontact == Recontact(0.0, 3.0)
    orbit, end = text.index("[orbit]"), text.index("# [recontact]")
    assert "[recontact] needs the table [orbit]" in refusal(text[:orbit] + text[end:])
    escape = "position = [7000, 0, 0]\nvelocity = [0, 12, 0] #"
    assert "[recontact] cannot be used: the orbit is not closed" in refusal(text.replace("altitude = 500.0 ", escape))


def test_without_envelope_inputs_and_requirements():
    case = parse_case(REFERENCE[: REFERENCE.index("[envelope]")])
    assert case.separation.envelope is None
    assert case.inputs == ()
    assert case.requirements == ()


def test_envelope_points():
    text = changed("half_width = 350.0", "points = [[1.0, 2.0, 3.0], [4.0, 500.0, 6.0]] #").replace(
        "height = 800.0", ""
    )
    separation = parse_case(text).separation
    assert np.allclose(separation.envelope, [[1e-3, 2e-3, 3e-3], [4e-3, 0.5, 6e-3]])
    assert len(separation.recess_points()) == 1


SCATTER = 'quantity = "satellite.mass", sigma = 0.5'


@pytest.mark.parametrize(
    ("scatter", "expected"),
    [
        ("sigma = 2", ot.Normal(100.0, 2.0)),
        ('sigma = "1.5 %"', ot.Normal(100.0, 1.5)),
        ("sigma = 2, mean = 101", ot.Normal(101.0, 2.0)),
        ("three_sigma = 6", ot.Normal(100.0, 2.0)),
        ("plus_minus = 5", ot.Uniform(95.0, 105.0)),
        ('plus_minus = "2%"', ot.Uniform(98.0, 102.0)),
        ('distribution = "Normal", mean = 99, sigma = 3', ot.Normal(99.0, 3.0)),
        ('distribution = "Normal", mu = 99, sigma = 3', ot.Normal(99.0, 3.0)),
        ('distribution = "Uniform", a = 90, b = 101', ot.Uniform(90.0, 101.0)),
        ('distribution = "LogNormal", muLog = 4.6, sigmaLog = 0.01', ot.LogNormal(4.6, 0.01, 0.0)),
        ('distribution = "Triangular", a = 95, m = 99, b = 102', ot.Triangular(95.0, 99.0, 102.0)),
        ('distribution = "TruncatedNormal", mu = 100, sigma = 1, a = 98, b = 102', ot.TruncatedNormal(100, 1, 98, 102)),
        ('distribution = "Student", nu = 5, mu = 100, sigma = 1', ot.Student(5.0, 100.0, 1.0)),
        ('distribution = "WeibullMin", beta = 2, alpha = 3, gamma = 95', ot.WeibullMin(2.0, 3.0, 95.0)),
    ],
)
def test_ways_to_say_a_scatter(scatter, expected):
    case = parse_case(changed(SCATTER, f'quantity = "satellite.mass", {scatter}'))
    assert case.inputs[0].distribution == ot.Distribution(expected)
    assert case.inputs[0].label == "satellite_mass [kg]"


# (what to replace, by what, words that the one sentence must hold)
UNIFORM = '"Uniform", a = 0.0'
REFUSALS = {
    "unknown key": ("mass = 1200.0", "mas = 1200.0", ["platform.mas ", "'mass'"]),
    "unknown key without a near one": ("mass = 1200.0", "colour = 1", ["platform.colour", "mass, inertia"]),
    "unknown table": ("[envelope]", "[envelop]", ["envelop ", "'envelope'"]),
    "unknown key of an input": ("sigma = 0.5 }", "sgma = 0.5 }", ["inputs.satellite_mass.sgma", "'sigma'"]),
    "unknown key of a requirement": ("maximum = 2.5", "maxmum = 2.5", ["requirements[1].maxmum", "'maximum'"]),
    "missing table": ("[satellite] ", "[platform.x] ", ["platform.x"]),
    "missing key": ("mass = 1200.0", "", ["platform.mass is missing", "kg"]),
    "missing stroke": ("stroke = 30.0", "", ["springs.stroke is missing", "mm"]),
    "a requirement without a name": ('"lateral rate"', '""', ["requirements[1].name = ''", "a name of 1"]),
    "a name that cannot be printed": ("[inputs]", '[inputs]\n"a\\u0007b" = 3', ["inputs.", "printable characters"]),
    "no list of points": (
        re.search("half_width = .*\nheight = .*\n", REFERENCE)[0],
        "points = 3\n",
        ["envelope.points = 3", "a list of points"],
    ),
    "text for a number": ("mass = 1200.0", 'mass = "1200 kg"', ["platform.mass = '1200 kg'", "positive number in kg"]),
    "boolean for a number": ("mass = 1200.0", "mass = true", ["platform.mass", "positive number in kg"]),
    "negative mass": ("mass = 1200.0", "mass = -1.0", ["platform.mass = -1.0", "positive"]),
    "zero mass": ("mass = 1200.0", "mass = 0", ["platform.mass = 0", "positive"]),
    "NaN": ("mass = 1200.0", "mass = nan", ["platform.mass = nan", "finite"]),
    "infinity": ("mass = 1200.0", "mass = inf", ["platform.mass = inf", "finite"]),
    "too long for a float": ("mass = 1200.0", "mass = 1" + "0" * 400, ["platform.mass", "finite"]),
    "infinity in a vector": ("[0.0, -1600.0, 0.0]", "[0.0, -inf, 0.0]", ["platform.center_of_mass", "finite"]),
    "short vector": ("[0.0, -1600.0, 0.0]", "[0.0, 1.0]", ["platform.center_of_mass", "three finite numbers in mm"]),
    "inertia of two numbers": ("[9.35, 8.0, 9.35]", "[9.35, 8.0]", ["satellite.inertia", "three principal moments"]),
    "skew inertia": ("[9.35, 8.0, 9.35]", "[[9, 1, 0], [0, 8, 0], [0, 0, 9]]", ["satellite.inertia", "symmetric"]),
    "ragged inertia": ("[9.35, 8.0, 9.35]", "[[9, 1, 0], [0, 8], [0, 0, 9]]", ["satellite.inertia", "3 x 3"]),
    "negative inertia": ("[9.35, 8.0, 9.35]", "[9.35, -8.0, 9.35]", ["satellite.inertia", "positive definite", "-8"]),
    "triangle": ("[9.35, 8.0, 9.35]", "[1.0, 2.0, 3.5]", ["satellite.inertia", "sum of the other two", "1, 2, 3.5"]),
    "triangle of principal moments": (
        "[9.35, 8.0, 9.35]",
        "[[2, 1.5, 0], [1.5, 2, 0], [0, 0, 1]]",
        ["satellite.inertia", "0.5, 1, 3.5"],
    ),
    "no springs": ("count = 4 ", "count = 0 #", ["springs.count = 0", "1 to 1000"]),
    "a broken number of springs": ("count = 4 ", "count = 3.5 #", ["springs.count = 3.5", "whole number"]),
    "neither count nor angles": ("count = 4 ", "#", ["springs.count is missing", "angles"]),
    "no angles": ("count = 4 ", "angles = [] #", ["springs.angles", "1 to 1000"]),
    "count against angles": ("count = 4 ", "count = 4\nangles = [1, 2] #", ["springs.count = 4", "2,"]),
    "list too short": ("stiffness = 5500.0", "stiffness = [1, 2]", ["springs.stiffness", "list of 4"]),
    "negative in a list": ("stiffness = 5500.0", "stiffness = [1, 2, 3, -4]", ["springs.stiffness", "positive"]),
    "negative delay": ("delay = 0.0 ", "delay = -1.0 #", ["springs.delay", "not negative"]),
    "cant of a right angle": ("cant = 0.0 ", "cant = 90 #", ["springs.cant", "below 90"]),
    "strut without length": ('"guided" ', '"strut" #', ["springs.stowed_length is missing", "mm"]),
    "strut of no length": ('"guided" ', '"strut"\nstowed_length = 0 #', ["springs.stowed_length = 0", "buckles"]),
    "guide with length": ('"guided" ', '"guided"\nstowed_length = 4 #', ["springs.stowed_length", "strut"]),
    "quaternion of norm 0": (
        "# attitude = [0.0, 0.0, 0.0]",
        "attitude = [0, 0, 0, 0]",
        ["initial.attitude", "norm is 0"],
    ),
    "unknown pivot": ('"stack"', '"ring"', ["initial.pivot", "'platform'"]),
    "negative altitude": ("altitude = 500.0", "altitude = -5", ["orbit.altitude = -5", "km"]),
    "altitude and position": (
        "altitude = 500.0",
        "altitude = 500.0\nposition = [1, 2, 3]",
        ["altitude", "position", "one"],
    ),
    "position without velocity": ("altitude = 500.0", "position = [7000, 2, 3]", ["orbit.velocity is missing", "km/s"]),
    "parallel position and velocity": (
        "altitude = 500.0",
        "position = [7000, 0, 0]\nvelocity = [1, 0, 0]",
        ["orbit.push", "parallel"],
    ),
    "centre of the Earth": (
        "altitude = 500.0",
        "position = [0, 0, 0]\nvelocity = [1, 0, 0]",
        ["orbit.position", "centre of the Earth"],
    ),
    "no orbit": ("altitude = 500.0", "", ["orbit.altitude is missing", "semi_major_axis"]),
    "position with angles": (
        "altitude = 500.0",
        "position = [7000, 0, 0]\nvelocity = [0, 8, 0]\ninclination = 3",
        ["orbit.position and orbit.inclination"],
    ),
    "elements without inclination": ("altitude = 500.0", "semi_major_axis = 7000", ["orbit.inclination is missing"]),
    "true anomaly without inclination": (
        "altitude = 500.0",
        "altitude = 9\ntrue_anomaly = 3",
        ["orbit.inclination is missing"],
    ),
    "perigee without apogee": (
        "altitude = 500.0",
        "perigee_altitude = 500\ninclination = 97",
        ["orbit.apogee_altitude is missing"],
    ),
    "apogee below perigee": (
        "altitude = 500.0",
        "perigee_altitude = 500\napogee_altitude = 400\ninclination = 97",
        ["orbit.apogee_altitude = 400", "perigee_altitude"],
    ),
    "eccentricity of an altitude": ("altitude = 500.0", "altitude = 500.0\neccentricity = 0.1", ["semi_major_axis"]),
    "eccentricity of 1": (
        "altitude = 500.0",
        "semi_major_axis = 7000\neccentricity = 1\ninclination = 9",
        ["orbit.eccentricity = 1", "below 1"],
    ),
    "perigee below the surface": (
        "altitude = 500.0",
        "semi_major_axis = 7000\neccentricity = 0.1\ninclination = 9",
        ["the perigee is 6300 km", "above the surface, 6378.14 km"],
    ),
    "j2 without a plane": ("altitude = 500.0", "altitude = 500.0\nj2 = true", ["orbit.inclination is missing", "j2"]),
    "window that ends before it starts": (
        "[envelope]",
        "[recontact]\nend_orbits = 0.05\n[envelope]",
        ["[recontact]", "0.1 to 0.05 orbits", "0 <= start_orbits < end_orbits <= 100"],
    ),
    "window in words": ("[envelope]", "[recontact]\nend_orbits = 'one'\n[envelope]", ["recontact.end_orbits = 'one'"]),
    "re-contact distance without a window": (
        'quantity = "spin"',
        'quantity = "recontact_distance"',
        ["needs the table [recontact]"],
    ),
    "unknown push": ('"along-track"', '"forward"', ["orbit.push", "'against-track'"]),
    "text for a flag": (
        "gradient_torque = false",
        'gradient_torque = "no"',
        ["orbit.gradient_torque", "true or false"],
    ),
    "envelope twice": (
        "half_width = 350.0",
        "half_width = 350.0\npoints = [[0, 0, 0]]",
        ["points", "half_width", "one"],
    ),
    "envelope above the recess": ("recess_depth = 250.0", "recess_depth = 0", ["envelope.recess_depth", "positive"]),
    "horizon of 0": ('name = "reference"', "horizon = 0", ["horizon = 0", "positive number", "in s"]),
    "unknown quantity of an input": (
        '"satellite.mass"',
        '"satelite.mass"',
        ["inputs.satellite_mass.quantity", "'satellite.mass'"],
    ),
    "recess without envelope is no quantity": (
        '"springs.stroke"',
        '"springs.stowed_length"',
        ["inputs.stroke.quantity"],
    ),
    "each of something else": ('"satellite.mass"', '"satellite.mass.each"', ["inputs.satellite_mass.quantity"]),
    "no scatter": (", sigma = 0.5 }", " }", ["inputs.satellite_mass has no scatter", "sigma, three_sigma"]),
    "two scatters": (
        "sigma = 0.5 }",
        "sigma = 0.5, plus_minus = 1 }",
        ["inputs.satellite_mass", "sigma and plus_minus"],
    ),
    "sigma of 0": ("sigma = 0.5 }", "sigma = 0 }", ["inputs.satellite_mass.sigma = 0", "positive"]),
    "not a percentage": ("sigma = 0.5 }", 'sigma = "half %" }', ["inputs.satellite_mass.sigma", "percentage"]),
    "percentage of 0": ("sigma = 0.3 }", 'sigma = "3 %" }', ["inputs.cant.sigma", "nominal value is 0"]),
    "scatter below 0": ("sigma = 0.5 }", "sigma = 60 }", ["inputs.satellite_mass", "-85.4", "positive"]),
    "early delay": ("a = 0.0, b = 2.0", "a = -1.0, b = 2.0", ["inputs.delay", "not negative"]),
    "input is a number": (
        'satellite_mass = { in_tests = "shared", ' + SCATTER + " }",
        "satellite_mass = 0.5",
        ["inputs.satellite_mass", "sigma"],
    ),
    "names that collide": ("rate_x = {", "delay_1 = {", ["delay_1", "differ"]),
    "unknown distribution": (UNIFORM, '"Unifrm", a = 0.0', ["inputs.delay", "'Unifrm'", "'Uniform'"]),
    "not a distribution": (UNIFORM, '"Sample", a = 0.0', ["inputs.delay", "'Sample'", "no OpenTURNS distribution"]),
    "copula": (UNIFORM, '"StudentCopula", a = 0.0', ["StudentCopula", "not univariate"]),
    "joint distribution": (UNIFORM, '"ClaytonCopula", a = 0.0', ["ClaytonCopula", "not univariate"]),
    "distribution without parameters": (UNIFORM, '"ArchimedeanCopula", a = 0.0', ["ArchimedeanCopula"]),
    "bad parameters": (
        "a = 0.0, b = 2.0",
        "a = 3.0, b = 2.0",
        ["OpenTURNS refuses Uniform(a = 3, b = 2)", "less than"],
    ),
    "missing parameter": ("a = 0.0, b = 2.0", "a = 0.0", ["parameter b", "missing", "a, b"]),
    "unknown parameter": ("a = 0.0, b = 2.0", "a = 0.0, b = 2.0, c = 1", ["'c'", "a, b"]),
    "infinite parameter": ("a = 0.0, b = 2.0", "a = 0.0, b = inf", ["inputs.delay.b = inf", "finite"]),
    "unknown force line": ('"guided"', '"slider"', ["springs.force_line = 'slider'", "'guided', 'strut', 'normal'"]),
    "friction of a guided spring": (
        '"guided"',
        '"guided"\nguide_friction = 0.1',
        ["springs.guide_friction = 0.1", "'normal'"],
    ),
    "negative friction": (
        '"guided"',
        '"normal"\nguide_friction = -0.1',
        ["springs.guide_friction = -0.1", "not negative"],
    ),
    "stowed rod": ('"guided"', '"normal"\nstowed_length = 4', ["springs.stowed_length = 4", "normal springs"]),
    "spring 0 failed": ("stroke = 30.0", "stroke = 30\nfailed = [0]", ["springs.failed = [0]", "from 1 to 4"]),
    "spring 5 failed": ("stroke = 30.0", "stroke = 30\nfailed = [5]", ["springs.failed = [5]", "from 1 to 4"]),
    "failed twice": ("stroke = 30.0", "stroke = 30\nfailed = [2, 2]", ["springs.failed = [2, 2]", "different"]),
    "failed in words": ("stroke = 30.0", "stroke = 30\nfailed = true", ["springs.failed = True", "list"]),
    "negative scale": ("stroke = 30.0", "stroke = 30\nscale = -1", ["springs.scale = -1", "not negative"]),
    "connector without stroke": (
        "[initial]",
        "[umbilical]\n" + UMBILICAL.replace("stroke", "strike") + "[initial]",
        ["umbilical.strike", "'stroke'"],
    ),
    "connector with negative friction": (
        "[initial]",
        "[[umbilical]]\n" + UMBILICAL.replace("15", "-15") + "[initial]",
        ["umbilical[1].friction = -15", "not negative number in N"],
    ),
    "connector that never leaves": (
        "[initial]",
        "[umbilical]\n" + UMBILICAL.replace("engagement = 5", "engagement = 0") + "[initial]",
        ["umbilical.engagement = 0", "positive number in mm"],
    ),
    "impulse in one number": ("[initial]", "[impulse]\nmomentum = 3\n[initial]", ["impulse.momentum = 3", "N s"]),
    "infinite impulse": (
        "[initial]",
        "[impulse]\nangular_momentum = [0, inf, 0]\n[initial]",
        ["impulse.angular_momentum", "N m s"],
    ),
    "wall without normal": (
        "recess_depth = 250.0",
        "planes = [{ normal = [0, 0, 0], offset = 3 }]\nrecess_depth = 250.0",
        ["envelope.planes[1].normal = [0, 0, 0]", "not all 0"],
    ),
    "wall without offset": (
        "recess_depth = 250.0",
        "planes = [{ normal = [0, 0, 1] }]\nrecess_depth = 250.0",
        ["envelope.planes[1].offset is missing", "mm"],
    ),
    "no limit": ("maximum = 2.5", "", ["requirements[1] has no limit", "maximum, minimum, between"]),
    "two limits": ("maximum = 2.5", "maximum = 2.5\nminimum = 1", ["requirements[1] has more than one limit"]),
    "limit is NaN": ("maximum = 2.5", "maximum = nan", ["requirements[1].maximum = nan", "deg/s"]),
    "unknown quantity": ('quantity = "spin"', 'quantity = "spinn"', ["requirements[2].quantity", "'spin'"]),
    "names twice": ('name = "spin"', 'name = "lateral rate"', ["requirements[2].name", "different"]),
    "impossible probability": (
        "allowed_probability = 5e-3",
        "allowed_probability = 2",
        ["allowed_probability", "below 1"],
    ),
    "requirements are one table": ("[[requirements]]", "[requirements]", ["not valid TOML"]),
    "not TOML": ("[inputs]", "[inputs", ["not valid TOML", "line"]),
}


@pytest.mark.parametrize("name", REFUSALS)
def test_what_is_wrong_is_one_sentence(name):
    old, new, words = REFUSALS[name]
    message = refusal(changed(old, new))
    for word in words:
        assert word in message


def test_shapes_of_whole_tables():
    assert "platform = 3" in refusal("platform = 3")
    assert "platform is missing" in refusal("")
    assert "inputs = 3" in refusal("inputs = 3\n" + REFERENCE[: REFERENCE.index("[inputs]")])
    assert "requirements = 3" in refusal("requirements = 3\n" + REFERENCE[: REFERENCE.index("[[requirements]]")])
    without_envelope = REFERENCE[: REFERENCE.index("[envelope]")] + REFERENCE[REFERENCE.index("[inputs]") :]
    assert "needs the table [envelope]" in refusal(without_envelope)


def test_nesting_without_end_is_refused():
    assert "nested too deep" in refusal("a = " + "[" * 100_000)


def test_mutated_cases_are_read_or_refused():
    values = [
        "0", "-1", "1e308", "nan", "inf", "true", "[]", "{}", "'x'", "[1, 2, 3]", "[[1, 0, 0], [0, 1, 0], [0, 0, 1]]",
        "99999999999999999999", '"Mixture"', '"Wishart"', '"Dirac"', '"strut"', '"50 %"', "1979-05-27", "",
    ]  # fmt: skip
    generator = random.Random(0)
    outcomes = set()
    for _ in range(300):
        text = REFERENCE[REFERENCE.index("name =") :]
        token = generator.choice(list(re.finditer(r'-?\d+\.?\d*|"[^"\n]*"|\w+', text)))
        text = text[: token.start()] + generator.choice(values) + text[token.end() :]
        try:
            outcomes.add(type(parse_case(text, "mine.toml")))
        except CaseError:
            outcomes.add(CaseError)
    assert outcomes == {Case, CaseError}


def test_an_envelope_that_never_was_in_the_recess():
    text = changed("half_width = 350.0", "points = [[0.0, 300.0, 0.0]] #").replace("height = 800.0", "")
    assert "no point lies in the recess" in refusal(text)


def test_the_name_of_the_system_event_is_taken():
    text = changed('name = "spin"', 'name = "any requirement"')
    assert "name = 'any requirement'" in refusal(text).replace('"', "'")
