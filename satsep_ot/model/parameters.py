"""THE table of the case file: each of its keys once, with unit, range, default, meaning, and where it may scatter.

The reader of case files, the targets of uncertain inputs, the checks of ranges, what `satsep-ot check` prints, the
tables of docs/case-files.md and the JSON Schema of a case file are all made from it. A key that names a `field` is a
parameter: it stands in the flat parameter vector of the separation under that path, with the sign that the
annotation of the field says.
"""

import math
from collections.abc import Iterator

import numpy as np

from satsep_ot.dynamics.contact import Contact, HoldDowns, Rails
from satsep_ot.dynamics.gravity import EARTH_GRAVITATIONAL_PARAMETER
from satsep_ot.dynamics.parameter_vector import Sign, parameter_fields
from satsep_ot.dynamics.quantities import CONTACT_QUANTITIES, LONGEST_COAST, QUANTITIES
from satsep_ot.dynamics.relative_orbit import Recontact
from satsep_ot.dynamics.separation import Body, Pivot, Separation, Springs
from satsep_ot.dynamics.springs import ForceLine, Interpolation
from satsep_ot.model.rows import ABSENT, CaseTable, Row
from satsep_ot.model.values import (
    CUBIC_KILOMETRE_PER_SQUARE_SECOND,
    DEGREE,
    DEGREE_PER_SECOND,
    KILOGRAM,
    KILOGRAM_SQUARE_METRE,
    KILOMETRE,
    KILOMETRE_PER_SECOND,
    METRE_PER_SECOND,
    MILLIMETRE,
    MILLIMETRE_PER_SECOND,
    MILLISECOND,
    NEWTON,
    NEWTON_METRE_SECOND,
    NEWTON_PER_METRE,
    NEWTON_SECOND,
    ONE,
    ORBITS,
    SECOND,
    SECOND_PER_METRE,
    Angles,
    Attitude,
    Choice,
    Direction,
    DistributionName,
    Ends,
    Flag,
    ForceTables,
    Name,
    Names,
    Number,
    PerSpring,
    Points,
    PointsOrNumber,
    Prices,
    Scatter,
    Scatters,
    Share,
    SpringCount,
    SpringNumbers,
    Tensor,
    Text,
    Times,
    Vector,
    Whole,
    Word,
)

_HOLDERS = {
    "": Separation, "platform": Body, "satellite": Body, "springs": Springs, "contact": Contact, "rails": Rails,
    "hold_downs": HoldDowns,
}  # fmt: skip
ZERO = (0.0, 0.0, 0.0)
# Where the push, along y, points -> where the position and the horizontal part of the velocity point in body axes at
# t = 0.
PUSHES = {
    "along-track": ((1, 0, 0), (0, 1, 0)),
    "against-track": ((1, 0, 0), (0, -1, 0)),
    "up": ((0, 1, 0), (0, 0, 1)),
    "down": ((0, -1, 0), (0, 0, 1)),
    "normal": ((0, 0, 1), (1, 0, 0)),
    "anti-normal": ((0, 0, 1), (-1, 0, 0)),
}
# The ways to say a scatter: an input has exactly one of them.
SCATTER_KEYS = ("sigma", "three_sigma", "plus_minus", "distribution")
# The ways to limit a quantity: a requirement has exactly one of them.
LIMIT_KEYS = ("maximum", "minimum", "between", "maximum_absolute", "minimum_absolute")


def _annotation(field):
    """What the annotation of a parameter's field says."""
    holder, _, name = field.rpartition(".")
    return parameter_fields(_HOLDERS[holder])[name]


def _number(field, unit, below=math.inf):
    """One number, with the sign that the annotation of the parameter's field says."""
    return Number(unit, _annotation(field).signs()[0], below)


def _parameter(key, field, unit, meaning, *default, **more):
    """A row for a parameter that is one number."""
    return Row(key, _number(field, unit), meaning, *default, field=field, **more)


def _per_spring(key, unit, meaning, *default, below=math.inf, **more):
    """A row for a parameter of each spring."""
    field = f"springs.{key}"
    return Row(key, PerSpring(_number(field, unit, below)), meaning, *default, field=field, **more)


def _of_connector(key, name, springs, unit, scatters, meaning):
    """A row for a parameter of an umbilical connector."""
    return _parameter(key, f"springs.{name}", unit, meaning, scatters=scatters, of_connector=springs)


def _one_of(keys):
    """The JSON Schema of a table that has exactly one of some keys."""
    return {"oneOf": [{"required": [key]} for key in keys]}


# fmt: off
TOP = CaseTable("", "A case of satsep-ot.", (
    Row("name", Name(), "how reports call the case", ABSENT, "name of the file"),
    Row("description", Text(), "free text", "", "empty"),
    Row("fleet", Whole(), "number of satellites, none of which may violate a requirement; see `shared` of an input", 1),
    Row("horizon", Number(SECOND, Sign.POSITIVE, 1e3), "a run that is not over by then fails", Separation.horizon),
))


def _body(name, meaning):
    return CaseTable(name, meaning, (
        _parameter("mass", f"{name}.mass", KILOGRAM, "mass of the body", scatters=f"mass of the {name}"),
        Row("inertia", Tensor(KILOGRAM_SQUARE_METRE),
            "inertia about the body's own centre of mass: three principal moments, or a symmetric 3 x 3 matrix of "
            "tensor elements (`Ixy = -sum m x y`); positive definite, no principal moment above the sum of the others",
            field=f"{name}.inertia", scatters=f"inertia {{element}} of the {name} about its centre of mass"),
        Row("center_of_mass", Vector(MILLIMETRE), "centre of mass, `[x, y, z]` from the ring centre",
            field=f"{name}.center_of_mass",
            scatters=f"centre of mass of the {name} along {{element}} from the ring centre", smallest_scatter=0.05,
            is_lateral=True),
    ), is_needed=True)


BODIES = {
    "platform": _body("platform", "The stage that stays."),
    "satellite": _body("satellite", "The body that leaves."),
}

SPRINGS = CaseTable("springs", "The separation springs: one number for all of them, or a list with one for each.", (
    Row("count", SpringCount(),
        "number of springs, 1 to 1000, equally spaced, spring i at `(2 i - 1) 180 / count` deg", ABSENT,
        "needed without `angles`"),
    Row("angles", Angles(), "angle of each spring; the seat is at `R (cos, 0, sin)`", ABSENT, "from `count`",
        field="springs.angle", scatters="angle of the seat"),
    _per_spring("radius", MILLIMETRE, "distance of the seats from the ring centre", scatters="ring radius",
                usual=(5.0, 1e4)),
    _per_spring("stiffness", NEWTON_PER_METRE, "stiffness of a linear spring", ABSENT, "needed without `table`",
                scatters="stiffness", usual=(5.0, 1e8)),
    _per_spring("deformation", MILLIMETRE, "compression at the start", ABSENT, "needed without `table`",
                scatters="initial deformation", usual=(1.0, 2e3)),
    _per_spring("stroke", MILLIMETRE,
                "length of the push; the spring lets go after the smaller of stroke and deformation",
                scatters="stroke", usual=(1.0, 2e3)),
    # 0.02 deg are 0.03 mm in the length of a spring.
    _per_spring("cant", DEGREE,
                "tangential tilt of the guide, towards increasing angle; positive cant turns the satellite about -y",
                0.0, below=90.0, scatters="tangential cant", smallest_scatter=0.02),
    _per_spring("delay", MILLISECOND, "time from the command to the spring's start", 0.0, scatters="release delay"),
    _per_spring("scale", ONE, "factor of the force; 0 is a spring that has failed", 1.0,
                scatters="factor of the force"),
    Row("failed", SpringNumbers(), "numbers of the springs that have failed, from 1", ABSENT),
    Row("failure_probability", PerSpring(Share()),
        "probability that the spring does not push, independent of the other parts", 0.0),
    Row("table", ForceTables(), "measured force-stroke table instead of stiffness and deformation", ABSENT),
    Row("interpolation", Choice({kind.name.lower(): kind for kind in Interpolation}),
        'between the rows of the tables: `"monotone"` cubics, or straight `"lines"`', "monotone"),
    Row("force_line", Choice({line.name.lower(): line for line in ForceLine}),
        "how each spring pushes: " + "; ".join(f'`"{line.name.lower()}"`, {line.push}' for line in ForceLine),
        "guided"),
    # In the file, 0 stands for springs without one.
    Row("stowed_length", Number(MILLIMETRE, Sign.NOT_NEGATIVE),
        "length between the ball ends at the start; only for struts, and positive there", 0.0,
        "`0`, needed for struts", field="stowed_length", scatters="stowed length of the springs", only="struts only",
        usual=(1.0, 5e3)),
    _parameter("guide_friction", "guide_friction", ONE,
               'friction coefficient of the guides; only with `"normal"`, which alone loads them laterally', 0.0,
               scatters="friction coefficient of the guides", only='`"normal"` only'),
), is_needed=True, conditions={"allOf": [
    {"anyOf": [{"required": ["count"]}, {"required": ["angles"]}]},
    {"anyOf": [{"required": ["stiffness", "deformation"]}, {"required": ["table"]}]},
]})

UMBILICAL = CaseTable(
    "umbilical", "A connector: its spring pushes off-centre over a short stroke, its pins hold the bodies back.", (
    _of_connector("angle", "angle", (0, 1), DEGREE, "angle", "angle of its seat, as of a spring"),
    _of_connector("radius", "radius", (0, 1), MILLIMETRE, "radius", "distance of its seat from the ring centre"),
    _of_connector("stiffness", "stiffness", (0,), NEWTON_PER_METRE, "stiffness", "stiffness of its spring"),
    _of_connector("deformation", "deformation", (0,), MILLIMETRE, "initial deformation",
                  "compression of its spring at the start"),
    _of_connector("stroke", "stroke", (0,), MILLIMETRE, "stroke", "length of the push of its spring"),
    _of_connector("friction", "scale", (1,), NEWTON, "pin friction",
                  "friction of the pins, from the first push of any spring on"),
    _of_connector("engagement", "stroke", (1,), MILLIMETRE, "engagement of the pins",
                  "stroke at which the pins leave the socket"),
    Row("pin_stiffness", Number(NEWTON_PER_METRE, Sign.NOT_NEGATIVE),
        "stiffness of the pins while they stick; 0: they only slide, with a constant force", ABSENT,
        "`0`; `1e8` with `[contact]`, `[[hold_down]]` or `[rails]`",
        field="springs.stiffness", scatters="stiffness of the pins", of_connector=(1,)),
    Row("failure_probability", Share(), "probability that its spring does not push, independent of the other parts",
        0.0),
), is_list=True)


def _law(owner, stiffness, friction):
    """The rows of a law of contact."""
    return (
        _parameter("stiffness", f"{owner}.stiffness", NEWTON_PER_METRE, "stiffness of each point", stiffness,
                   scatters="stiffness of a point of contact"),
        _parameter("restitution", f"{owner}.restitution", ONE,
                   "share of the speed of an impact that is left after it; above 0, at most 1", 0.5,
                   scatters="coefficient of restitution"),
        _parameter("impact_speed", f"{owner}.impact_speed", MILLIMETRE_PER_SECOND,
                   "speed of the impact at which `restitution` holds", 5.0, scatters="impact speed of the restitution"),
        _parameter("damping", f"{owner}.damping", SECOND_PER_METRE,
                   "damping of the contact instead of `restitution`", 0.0, scatters="damping of the contact"),
        _parameter("friction", f"{owner}.friction", ONE, "coefficient of friction", friction,
                   scatters="coefficient of friction"),
        _parameter("v_eps", f"{owner}.sliding_speed", MILLIMETRE_PER_SECOND,
                   "sliding speed below which friction fades", 1.0, scatters="sliding speed of the friction"),
    )


CONTACT = CaseTable(
    "contact", "What the satellite's foot touches, the deck and the walls of the recess; else they hold nothing.", (
    _parameter("radius", "contact.radius", MILLIMETRE, "radius of the edge of the satellite's ring", ABSENT,
               "largest radius of the springs", scatters="radius of the ring's edge", only="with contact only"),
    Row("points", PointsOrNumber(MILLIMETRE),
        "number of points on that edge, or their places from the ring centre; 0: the deck holds nothing", 48),
    _parameter("level", "contact.level", MILLIMETRE, "height of the deck over the ring plane", 0.0,
               scatters="height of the deck", only="with contact only"),
    *_law("contact", 1e7, 0.2),
    Row("walls", Flag(), "whether the walls of the recess hold the points of the envelope", False),
))

HOLD_DOWN = CaseTable(
    "hold_down", "A bolt, or a segment of a clamp band, that lets go late: a ball joint until then.", (
    _parameter("angle", "hold_downs.angle", DEGREE, "angle of its place, as of a spring",
               scatters="angle of hold-down {number}"),
    _parameter("radius", "hold_downs.radius", MILLIMETRE, "distance of its place from the ring centre",
               scatters="radius of hold-down {number}"),
    _parameter("release", "hold_downs.release", MILLISECOND, "when it lets go",
               scatters="release time of hold-down {number}"),
    _parameter("stiffness", "hold_downs.stiffness", NEWTON_PER_METRE, "its stiffness", 1e8,
               scatters="stiffness of hold-down {number}"),
    _parameter("damping_ratio", "hold_downs.damping_ratio", ONE, "its damping ratio", 0.2,
               scatters="damping ratio of hold-down {number}"),
    _parameter("damping_time", "hold_downs.damping_time", MILLISECOND, "damping time beside that of `damping_ratio`",
               0.0, scatters="damping time of hold-down {number}"),
    Row("points", Number(ONE, Sign.POSITIVE, 41.0), "number of joints along `arc`, for a segment of a clamp band", 1),
    Row("arc", Number(DEGREE, Sign.NOT_NEGATIVE), "length of the segment, centred on `angle`", 0.0),
    Row("failure_probability", Share(),
        "probability that it lets go at `failed_release` instead, independent of the other parts", 0.0),
    Row("failed_release", Number(MILLISECOND, Sign.NOT_NEGATIVE), "when it lets go where it fails", ABSENT,
        "needed with `failure_probability`"),
), is_list=True)

RAILS = CaseTable("rails", "The square channel of a dispenser and the satellite's rails in it.", (
    _parameter("half_width", "rails.half_width", MILLIMETRE, "half of the width of the satellite across its rails",
               scatters="half width across the rails", only="with rails only"),
    _parameter("clearance", "rails.clearance", MILLIMETRE,
               "clearance of each rail from its wall; negative for an interference",
               scatters="clearance of the rails", only="with rails only"),
    Row("satellite", Ends(MILLIMETRE), "ends of the satellite's rails, `[y, y]` from its ring centre",
        field="rails.satellite", scatters="{element} of the satellite's rails", only="with rails only"),
    _parameter("mouth", "rails.mouth", MILLIMETRE, "end of the channel, from the platform's ring centre",
               scatters="end of the channel", only="with rails only"),
    *_law("rails", 1e6, 0.1),
))

IMPULSE = CaseTable(
    "impulse",
    "What bolts or a clamp band give the satellite at t = 0, and the platform the opposite of; platform axes.", (
    Row("momentum", Vector(NEWTON_SECOND), "momentum given at the ring centre", ZERO, field="impulse",
        scatters="impulse at t = 0 along {element}"),
    Row("angular_momentum", Vector(NEWTON_METRE_SECOND), "angular momentum given beside the moment of `momentum`",
        ZERO, field="angular_impulse", scatters="angular impulse at t = 0 about {element}"),
))

INITIAL = CaseTable("initial", "The joined stack at t = 0.", (
    Row("attitude", Attitude(),
        "roll, pitch, yaw (3-2-1), or a quaternion `[w, x, y, z]` of norm 1, body to inertial", ZERO,
        "`[0, 0, 0]`, or from `orbit.push`"),
    Row("rates", Vector(DEGREE_PER_SECOND), "rates of the stack in platform axes", ZERO, field="rates",
        scatters="initial rate about {element}", is_lateral=True),
    Row("velocity", Vector(METRE_PER_SECOND),
        "velocity of the pivot in inertial axes, beside that of the orbit; without gravity it changes nothing in the "
        "relative motion", ZERO),
    Row("mounting_error", Vector(DEGREE), "rotation vector of the satellite on the platform", ZERO,
        field="mounting_error", scatters="mounting error of the satellite about {element}", is_lateral=True),
    Row("pivot", Choice({"stack": Pivot.STACK, "platform": Pivot.PLATFORM}),
        'the point that the stack turns about and that is on the orbit: the centre of mass of the `"stack"`, or of the '
        '`"platform"`', "stack"),
))

_ABOVE = "above 6378.137 km"
ORBIT = CaseTable("orbit", "The orbit, in one of four ways; without this table there is no gravity.", (
    Row("altitude", Number(KILOMETRE, Sign.POSITIVE), f"altitude of a circular orbit {_ABOVE}", ABSENT),
    Row("perigee_altitude", Number(KILOMETRE, Sign.POSITIVE),
        f"altitude of the perigee {_ABOVE}; with `apogee_altitude`", ABSENT),
    Row("apogee_altitude", Number(KILOMETRE, Sign.POSITIVE),
        f"altitude of the apogee {_ABOVE}; with `perigee_altitude`", ABSENT),
    Row("semi_major_axis", Number(KILOMETRE, Sign.POSITIVE), "semi-major axis; with `eccentricity`", ABSENT),
    Row("eccentricity", Number(ONE, Sign.NOT_NEGATIVE, 1.0),
        "eccentricity, with `semi_major_axis` only; the perigee must be above the surface", 0.0),
    Row("inclination", Number(DEGREE),
        "inclination; needed with all but `position`, and left out with `altitude` alone", ABSENT, "see there"),
    *(Row(key, Number(DEGREE), f"{key.replace('_', ' ')} at t = 0; with `inclination`", 0.0)
      for key in ("right_ascension", "argument_of_perigee", "true_anomaly")),
    Row("position", Vector(KILOMETRE), "position, `[x, y, z]` in inertial axes; with `velocity`", ABSENT),
    Row("velocity", Vector(KILOMETRE_PER_SECOND), "velocity, `[x, y, z]` in inertial axes; with `position`", ABSENT),
    Row("push", Choice(PUSHES), f"where y points at t = 0: {', '.join(f'`{push}`' for push in PUSHES)}",
        "along-track"),
    Row("gravitational_parameter", Number(CUBIC_KILOMETRE_PER_SQUARE_SECOND, Sign.POSITIVE),
        "gravitational parameter, by default the Earth's",
        EARTH_GRAVITATIONAL_PARAMETER / CUBIC_KILOMETRE_PER_SQUARE_SECOND.factor),
    Row("gradient_torque", Flag(), "whether the gravity-gradient torque acts on both bodies", False),
    Row("j2", Flag(),
        "whether the Earth's oblateness acts on the coast after the release; needs more than `altitude` alone", False),
), conditions={"oneOf": [
    {"required": ["altitude"]},
    {"required": ["perigee_altitude", "apogee_altitude", "inclination"]},
    {"required": ["semi_major_axis", "inclination"]},
    {"required": ["position", "velocity"]},
]})

RECONTACT = CaseTable(
    "recontact", "The window after the last release in which the smallest distance is looked for; it needs [orbit].", (
    Row("start_orbits", Number(ORBITS), "start of the window, not negative: leaves out the separation itself",
        Recontact.start_orbits),
    Row("end_orbits", Number(ORBITS), "end of the window, above `start_orbits`, at most 100", Recontact.end_orbits),
))

COAST = CaseTable(
    "coast", "The free flight after the last release, in which distance and attitude are quantities of interest.", (
    Row("times", Times(SECOND, LONGEST_COAST),
        "times after the last release: `distance_at_10_s`, `attitude_error_at_10_s` and its parts `turn_x_at_10_s`, "
        "`turn_y_at_10_s`, `turn_z_at_10_s` are quantities then; gravity is left out"),
))

_ENVELOPE_ONLY = "with an envelope only"
ENVELOPE = CaseTable(
    "envelope", "Points of the satellite and the recess that they leave; without this table there is no clearance.", (
    Row("half_width", Number(MILLIMETRE, Sign.POSITIVE),
        "half of the width of a square box on the satellite's ring plane", ABSENT,
        "needed without `points`"),
    Row("height", Number(MILLIMETRE, Sign.POSITIVE), "height of that box", ABSENT, "needed without `points`"),
    Row("points", Points(MILLIMETRE),
        "points instead of the box: `[[x, y, z], ...]` from the satellite's ring centre", ABSENT),
    _parameter("recess_radius", "recess_radius", MILLIMETRE, "radius of a cylinder about y in the platform", ABSENT,
               "needed without `planes`", scatters="radius of the recess", only=_ENVELOPE_ONLY, usual=(5.0, 5e4)),
    _parameter("recess_depth", "recess_depth", MILLIMETRE, "depth of the recess above the ring plane",
               scatters="depth of the recess",
               only=_ENVELOPE_ONLY, usual=(1.0, 5e4)),
), conditions={"allOf": [
    {"oneOf": [{"required": ["half_width", "height"]}, {"required": ["points"]}]},
    {"anyOf": [{"required": ["recess_radius"]}, {"required": ["planes"]}]},
]})
PLANES = CaseTable("envelope.planes", "A plane wall of the recess, from the platform's ring centre.", (
    Row("normal", Direction(), "normal of any length into the free side, where `normal . r >= offset` for length 1"),
    Row("offset", Number(MILLIMETRE), "distance of the plane from the ring centre along the normal",
        field="recess_planes.offset", scatters="offset of plane {number} of the recess", only=_ENVELOPE_ONLY),
), is_list=True)

INPUT = CaseTable("inputs", "An uncertain input.", (
    Row("quantity", Text(), "which key scatters"),
    Row("sigma", Scatter(),
        'standard deviation of a Normal, in the key\'s unit, or text such as `"1.5 %"` of the nominal value', ABSENT),
    Row("three_sigma", Scatter(), "three times that", ABSENT),
    Row("plus_minus", Scatter(), "half the width of a Uniform", ABSENT),
    Row("distribution", DistributionName(),
        "any univariate OpenTURNS distribution by name, with its parameters as further keys, named as "
        "`getParameterDescription` names them (a shift `gamma` is 0 by default)", ABSENT),
    Row("mean", Number(), "with the first three, where it is not the nominal value", ABSENT, "nominal value"),
    Row("in_tests", Choice({"anew": False, "shared": True}),
        '`satsep-ot update` only: `"shared"` if tests and flight have the same value, because they use the same piece',
        "anew"),
    Row("mean_uncertainty", Scatter(),
        "`satsep-ot update` only: standard deviation of the mean, which is known only roughly and is the same in tests "
        'and flight, or text such as `"1 %"` of the nominal value; one mean for all springs with `.each`', ABSENT,
        "`0`"),
    Row("sigma_uncertainty", Scatter(),
        '`satsep-ot update` only: standard deviation of the sigma likewise, or text such as `"30 %"` of sigma', ABSENT,
        "`0`"),
    Row("description", Text(), "free text", ABSENT, "description of the quantity"),
    Row("group", Name(),
        "name of the tolerance that the input belongs to: inputs of one group are tightened together. By default "
        "`.each` makes one group, and so do x and z of a centre of mass, of rates and of a mounting error", ABSENT,
        "see there"),
    Row("classes", Scatters(),
        "sizes that can be bought in place of that of `sigma`, `three_sigma` or `plus_minus`: a study searches the "
        "cheapest set of classes that meets all allowed probabilities; in one input of a group, for all of it", ABSENT),
    Row("prices", Prices(), "prices of the classes", ABSENT, "each step to a tighter class costs 1"),
    Row("shared", Flag(),
        "whether all satellites of a `fleet` share the value, as one stage or one batch of springs does", False),
    # The distribution's parameters, sigma among them, are further keys.
), conditions={"anyOf": [{"required": ["distribution"]}, _one_of(SCATTER_KEYS[:3])]})

CORRELATION = CaseTable("correlation", "Inputs that are correlated with each other, all pairs by the same number.", (
    Row("inputs", Names(), "names of at least two inputs; an entry with `.each` stands for all its springs"),
    Row("coefficient", Number(below=1.0),
        "the parameter of the normal copula, which for Normal inputs is their linear correlation", ABSENT),
    Row("rank", Number(below=1.0), "instead: Spearman's rank correlation", ABSENT),
), is_list=True, conditions=_one_of(("coefficient", "rank")))

REQUIREMENT = CaseTable("requirements", "A limit on a quantity of interest.", (
    Row("name", Name(), "different for each requirement", ABSENT, "the quantity"),
    Row("quantity", Word(
        (*QUANTITIES, *CONTACT_QUANTITIES, "clearance", "recontact_distance"),
        "^(exit_clearance_[1-9][0-9]*|(distance|turn_[xyz]|attitude_error)_at_[0-9.]+_s)$",
    ), "a quantity of interest"),
    *(Row(key, Number(), f"the {key} allowed, in the quantity's unit; the limit itself meets the requirement", ABSENT,
          "exactly one of these five") for key in ("maximum", "minimum")),
    Row("between", Ends(ONE), "the least and the most allowed, `[least, most]`", ABSENT, "exactly one of these five"),
    *(Row(f"{key}_absolute", Number(ONE, Sign.POSITIVE), f"the {key} allowed of the absolute value", ABSENT,
          "exactly one of these five") for key in ("maximum", "minimum")),
    Row("allowed_probability", Number(ONE, Sign.POSITIVE, 1.0), "largest accepted probability of violation", ABSENT),
), is_list=True, conditions=_one_of(LIMIT_KEYS))
# fmt: on

TABLES = {
    table.name: table
    for table in (
        TOP, *BODIES.values(), SPRINGS, UMBILICAL, CONTACT, HOLD_DOWN, RAILS, IMPULSE, INITIAL, ORBIT, RECONTACT,
        COAST, ENVELOPE, PLANES, INPUT, CORRELATION, REQUIREMENT,
    )
}  # fmt: skip


def elements(row: Row) -> tuple[str, ...]:
    """Names of the numbers of a parameter, such as ("x", "y", "z"); ("",) for a single number."""
    return _annotation(row.field).elements


def nominal_values(row: Row, separation: Separation) -> np.ndarray:
    """The nominal values of a parameter in the unit of the file.

    Parameters
    ----------
    row : Row
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    values : ndarray
        One for each element, or for each spring, or for each plane of the recess.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.parameters import SPRINGS, nominal_values
    >>> print(nominal_values(SPRINGS["stroke"], load_case("reference").separation))
    [30. 30. 30. 30.]
    """
    places = zip(separation.parameter_places(), separation.parameters(), strict=True)
    return np.array([value for place, value in places if place.path == row.field]) / row.unit.factor


def scatter_keys() -> tuple[list[str], list[str]]:
    """What may scatter in any case: the keys that stand for one number, and those that stand for one of each spring.

    Returns
    -------
    single, each : list of str

    Examples
    --------
    >>> from satsep_ot.model.parameters import scatter_keys
    >>> single, each = scatter_keys()
    >>> single[0], single[1], each[0]
    ('platform.mass', 'platform.inertia.xx', 'springs.angles')
    """
    single, each = [], []
    for table, row in parameter_rows():
        key = f"{table.name}.{row.key}"
        if row.holder == "springs":
            each.append(key)
        elif row.holder not in ("recess_planes", "hold_downs"):
            single += [f"{key}.{element}" if element else key for element in elements(row)]
    return single, each


def parameter_rows() -> Iterator[tuple[CaseTable, Row]]:
    """The rows of all parameters, each with the table that it is in.

    Yields
    ------
    table : CaseTable
    row : Row

    Examples
    --------
    >>> from satsep_ot.model.parameters import parameter_rows
    >>> [f"{table.name}.{row.key}" for table, row in parameter_rows() if row.field == "springs.stroke"]
    ['springs.stroke', 'umbilical.stroke', 'umbilical.engagement']
    """
    for table in TABLES.values():
        for row in table.rows:
            if row.field:
                yield table, row
