"""What in a case is allowed but hardly meant: sentences for a person to read, never an error."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import openturns as ot

from satsep_ot.dynamics.gravity import EARTH_GRAVITATIONAL_PARAMETER, EARTH_RADIUS
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.separation import Status
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.dynamics.springs import ForceLaw
from satsep_ot.model.case import Case, Requirement
from satsep_ot.model.hand_formulas import push_energy, push_velocity
from satsep_ot.model.inputs import ParameterMap, interval_digits, joint_distribution, quantile_range

# Launchers separate satellites at 0.3 to 1 m/s, deployers at up to 2 m/s; a factor of some beyond is a wrong unit.
_SLOWEST, _FASTEST = 0.02, 5.0  # m/s
_LARGEST_ACCELERATION = 50.0 * 9.80665  # m/s2
_LARGEST_RATE = 720.0  # deg/s, twice the 60 rpm of a spinning stage
_LARGEST_RELATIVE_SCATTER = 0.2
_SAMPLE_SIZE = 1024
# Units in which a document may give what the case file wants in another: how many of ours one of them is. Only those
# that are far enough from ours to be told from a generous limit.
_OTHER_UNITS = {
    "m/s": {"mm/s": 1e-3, "km/s": 1e3},
    "deg/s": {"rad/s": math.degrees(1.0), "rpm": 6.0},
    "mm": {"m": 1e3},
    "s": {"ms": 1e-3},
}
_FAR, _NEAR = 20.0, 5.0  # factors between a limit and the values of its quantity
# A centre of mass this close to the ring centre, and this small a part of its body's radius of gyration, is in m.
_NEAREST_CENTER, _NEAREST_CENTER_SHARE = 5e-3, 0.02  # m
# Nobody knows a length or a delay as well as this, half of the range of 99.8 % of its values; least a centre of mass.
_SMALLEST_SCATTER = {"mm": (0.005, "m"), "ms": (0.005, "s")}  # unit of the case file: size, the unit that it may be in
_SMALLEST_CENTER_SCATTER = 0.05  # mm
_SMALLEST_CANT_SCATTER = 0.02  # deg, 0.03 mm in the length of a spring
_HELD_AROUND = 0.7  # radii of gyration
# A heavy satellite on a kick stage or an adapter weighs up to 7 times as much.
_LARGEST_MASS_RATIO = 10.0
_WIDEST_RING = 1.5  # times the widest point of the envelope
_HIGHEST = 1e5  # km, a quarter of the way to the Moon
_SLOWEST_FLIGHT, _FASTEST_FLIGHT = 0.1, 20.0  # km/s


class RequirementScatter(NamedTuple):
    """How a requirement lies to the nominal run and to a few scattered ones: an impression, not a probability.

    Attributes
    ----------
    requirement : :class:`satsep_ot.model.case.Requirement`
    unit : str
    nominal : float
        Value of the quantity in the nominal run; NaN where that failed.
    smallest, median, largest : float
        Of the scattered runs; those of the nominal run for a case without uncertain inputs.
    met, runs : int
        Scattered runs that meet the requirement, and those that did not fail; 0 where there are none.
    """

    requirement: Requirement
    unit: str
    nominal: float
    smallest: float
    median: float
    largest: float
    met: int
    runs: int


def implausibilities(case: Case) -> list[str]:
    """Sentences on what in a case is hardly meant: usually a wrong unit.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`

    Returns
    -------
    sentences : list of str
        Empty where nothing looks wrong.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case, parse_case
    >>> from satsep_ot.model.plausibility import implausibilities
    >>> implausibilities(load_case("reference"))
    []
    >>> fast = load_case("reference").text.replace("stiffness = 5500.0", "stiffness = 5500.0e3")
    >>> print(implausibilities(parse_case(fast))[0])
    springs: their energy of 1.65e+04 J gives 18.9 m/s; separations have 0.02 to 5 m/s (N/m and mm?)
    """
    return [
        *_of_the_push(case.separation),
        *_of_the_sizes(case.separation),
        *_of_the_bodies(case.separation),
        *_of_the_arrangement(case.separation),
        *_of_the_orbit(case.separation),
        *_of_the_inputs(case),
        *_of_runs(case),
        *_of_the_requirements(case),
        *_of_the_walls(case),
    ]


def requirement_scatter(case: Case) -> list[RequirementScatter]:
    """Each requirement beside the nominal run and 1,024 well-spread combinations of the uncertain inputs.

    The combinations are points of a Sobol' sequence, the same each time; the random generator is left alone.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`

    Returns
    -------
    rows : list of RequirementScatter
        In the order of the case.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.plausibility import requirement_scatter
    >>> for row in requirement_scatter(load_case("reference"))[2:]:
    ...     print(row.requirement, f"{row.unit}: {row.smallest:.3g} to {row.largest:.3g}, {row.met} of {row.runs}")
    axial_velocity >= 0.59 m/s: 0.591 to 0.606, 1024 of 1024
    clearance >= 18 mm: 18.2 to 25, 1024 of 1024
    """
    if not case.requirements:
        return []
    table = quantity_table(case.separation)
    nominal = simulate(case.separation)
    scattered = _scattered_runs(case)[1] if case.inputs else None
    rows = []
    for requirement in case.requirements:
        value = float(nominal.quantity(requirement.quantity)[0])
        values = np.array([]) if scattered is None else scattered.quantity(requirement.quantity)
        values = values[np.isfinite(values)]
        met = int(np.count_nonzero(requirement.is_met(values)))
        shown = values if len(values) else np.array([value])
        rows.append(
            RequirementScatter(
                requirement,
                table[requirement.quantity].unit,
                value,
                float(shown.min()),
                float(np.median(shown)),
                float(shown.max()),
                met,
                len(values),
            )
        )
    return rows


def _of_the_push(separation):
    energy = push_energy(separation)
    speed = push_velocity(separation)
    if not _SLOWEST <= speed <= _FASTEST:
        yield (
            f"springs: their energy of {energy:.3g} J gives {speed:.3g} m/s; separations have {_SLOWEST:g} to "
            f"{_FASTEST:g} m/s (N/m and mm?)"
        )
    force = float(np.sum(separation.springs.scale * separation.springs.stiffness * separation.springs.deformation))
    acceleration = force / separation.satellite.mass
    if acceleration > _LARGEST_ACCELERATION:
        yield f"springs: they accelerate the satellite by {acceleration / 9.80665:.3g} g at the start (N/m?)"
    springs = separation.springs
    if np.any((springs.laws == ForceLaw.LINEAR) & (springs.stroke > springs.deformation)):
        yield "springs: a stroke is longer than the deformation; that spring lets go where it is relaxed"
    for axis, rate in zip("xyz", np.degrees(separation.rates), strict=True):
        if abs(rate) > _LARGEST_RATE:
            yield f"initial rate about {axis}: {rate:.4g} deg/s is {abs(rate) / 6.0:.3g} rpm (deg/s?)"


def _of_the_sizes(separation):
    """Lengths and stiffnesses that are far from those of any separation; 0 is left out, there is no such thing then."""
    springs = separation.springs
    linear = springs.laws == ForceLaw.LINEAR
    envelope = np.array([]) if separation.envelope is None else np.abs(separation.envelope).max(keepdims=True)
    rules = (
        ("springs: a radius", 1e3 * springs.radius, 5.0, 1e4, "mm", "m"),
        ("springs: a deformation", 1e3 * springs.deformation[linear], 1.0, 2e3, "mm", "m"),
        ("springs: a stroke", 1e3 * springs.stroke, 1.0, 2e3, "mm", "m"),
        ("springs: a stowed length", 1e3 * np.array([separation.stowed_length]), 1.0, 5e3, "mm", "m"),
        ("springs: a stiffness", springs.stiffness[linear], 5.0, 1e8, "N/m", "N/mm"),
        ("envelope: a size", 1e3 * envelope, 5.0, 5e4, "mm", "m"),
        ("envelope: a recess radius", 1e3 * np.array([separation.recess_radius]), 5.0, 5e4, "mm", "m"),
        ("envelope: a recess depth", 1e3 * np.array([separation.recess_depth]), 1.0, 5e4, "mm", "m"),
    )
    for what, values, smallest, largest, unit, other in rules:
        values = values[values != 0.0]
        usual = f"separations have {smallest:g} to {largest:g} {unit}"
        if len(values) and values.min() < smallest:
            yield f"{what} of {values.min():.3g} {unit}; {usual} ({unit}; written in {other}?)"
        if len(values) and values.max() > largest:
            yield f"{what} of {values.max():.3g} {unit}; {usual} ({unit}?)"


def _of_the_bodies(separation):
    ring = float(np.max(separation.springs.radius))
    for name in ("platform", "satellite"):
        body = getattr(separation, name)
        gyration = np.sqrt(np.linalg.eigvalsh(body.inertia) / body.mass)
        # Of a homogeneous box of side a it is 0.41 a.
        reach = max(ring, float(np.abs(body.center_of_mass).max()))
        if name == "satellite" and separation.envelope is not None:
            reach = max(reach, float(np.abs(separation.envelope).max()))
        large, small = gyration[2] > 10.0 * reach, gyration[0] < 0.05 * reach
        if large or small:
            hint = "inertia in kg m2? mass in kg?" if large else "mass in kg; written in g? inertia in kg m2?"
            yield (
                f"{name}: its mass of {body.mass:.6g} kg and its inertia are those of a body with radii of gyration "
                f"from {1e3 * gyration[0]:.3g} to {1e3 * gyration[2]:.3g} mm, beside a ring and a centre of mass "
                f"within {1e3 * reach:.3g} mm ({hint})"
            )
        # A ring around the centre of mass has y = 0, and an offset across the axis may well be small.
        distance = float(np.linalg.norm(body.center_of_mass))
        if body.center_of_mass[1] and distance < min(_NEAREST_CENTER, _NEAREST_CENTER_SHARE * gyration[2]):
            yield (
                f"{name}: its centre of mass is {1e3 * distance:.3g} mm from the ring centre, its radius of gyration "
                f"{1e3 * gyration[2]:.3g} mm (mm; written in m?)"
            )
        offset = float(np.hypot(body.center_of_mass[0], body.center_of_mass[2]))
        if ring > 0.0 and offset > ring:
            yield f"{name}: its centre of mass is {1e3 * offset:.3g} mm off the axis, outside of the spring ring (mm?)"


def _of_the_arrangement(separation):
    """Bodies on the wrong side of the springs, exchanged bodies, and springs away from what they push."""
    platform, satellite = separation.platform, separation.satellite
    # Of a body that stands on its ring the centre of mass is above it by 1.2 (cube) to 1.7 (rod) times the radius of
    # gyration; one that is held around its middle has it in the plane of the ring.
    height, depth = satellite.center_of_mass[1], platform.center_of_mass[1]
    below = height < -_HELD_AROUND * _gyration(satellite)
    above = depth > max(_HELD_AROUND * _gyration(platform), separation.recess_depth)
    if below or above:
        yield (
            f"centres of mass: the satellite's is at y = {1e3 * height:g} mm and the platform's at {1e3 * depth:g} mm; "
            "the push is along y, so that the satellite is pushed into the platform (a wrong sign, or the bodies "
            "swapped?)"
        )
    if satellite.mass > _LARGEST_MASS_RATIO * platform.mass:
        yield (
            f"satellite: its mass of {satellite.mass:g} kg is {satellite.mass / platform.mass:.3g} times the "
            f"platform's, {platform.mass:g} kg (masses or bodies swapped?)"
        )
    points = separation.envelope
    # What protrudes below the plane of the springs may well be beside them.
    if points is None or points[:, 1].min() < 0.0:
        return
    seat, wall = 1e3 * separation.springs.radius.max(), 1e3 * separation.recess_radius
    width = 1e3 * np.hypot(points[:, 0], points[:, 2]).max()
    if 0.0 < wall < seat:
        yield f"springs: a radius of {seat:g} mm is outside of the recess, whose radius is {wall:g} mm"
    if seat > _WIDEST_RING * width > 0.0:
        yield (
            f"springs: a radius of {seat:g} mm is outside of the satellite, whose envelope is within {width:.3g} mm of "
            "the axis"
        )


def _gyration(body):
    """The largest radius of gyration."""
    return math.sqrt(np.linalg.eigvalsh(body.inertia)[-1] / body.mass)


def _of_the_orbit(separation):
    orbit = separation.orbit
    if orbit is None or not math.isclose(orbit.mu, EARTH_GRAVITATIONAL_PARAMETER, rel_tol=0.01):
        return
    altitude, speed = 1e-3 * (np.linalg.norm(orbit.position) - EARTH_RADIUS), 1e-3 * np.linalg.norm(orbit.velocity)
    if not 0.0 <= altitude <= _HIGHEST:
        yield f"orbit: an altitude of {altitude:.6g} km; separations have 0 to {_HIGHEST:g} km (km?)"
    if not _SLOWEST_FLIGHT <= speed <= _FASTEST_FLIGHT:
        yield (
            f"orbit: a velocity of {speed:.6g} km/s; separations have {_SLOWEST_FLIGHT:g} to {_FASTEST_FLIGHT:g} km/s "
            "(km/s?)"
        )


def _of_the_walls(case):
    """A nominal run through a wall, which no requirement tells of."""
    table = quantity_table(case.separation)
    if "clearance" not in table or any(entry.quantity == "clearance" for entry in case.requirements):
        return
    clearance = float(simulate(case.separation).quantity("clearance")[0])
    if clearance < 0.0:
        yield (
            f"walls: the nominal run leaves through one, by {-clearance:.3g} mm; walls do not hold the satellite, its "
            "rates are those of a free body"
        )


def _of_the_inputs(case):
    for row in case.inputs:
        low, high = quantile_range(row.distribution)
        digits = interval_digits(low, high, 4)
        likely = f"{low:.{digits}g} to {high:.{digits}g} {row.unit}"
        half = 0.5 * (high - low)
        mean = row.distribution.getMean()[0]
        yield from _beyond_a_table(case.separation, row, high)
        positive = row.unit in ("kg", "N/m") or row.parameters[0].endswith(("inertia.xx", "inertia.yy", "inertia.zz"))
        if positive and half > 3.0 * _LARGEST_RELATIVE_SCATTER * abs(mean):
            yield (
                f"{row.name}: 99.8 % of its values lie within {likely}, a scatter of "
                f"{100.0 * half / abs(mean):.0f} % of its mean"
            )
        smallest, other = _SMALLEST_SCATTER.get(row.unit, (0.0, ""))
        if ".center_of_mass." in row.parameters[0]:
            smallest = _SMALLEST_CENTER_SCATTER
        if row.parameters[0].endswith(".cant"):
            smallest, other = _SMALLEST_CANT_SCATTER, "rad"
        if half < smallest:
            yield (
                f"{row.name}: 99.8 % of its values lie within {likely}, closer than anyone measures "
                f"({row.unit}; written in {other}?)"
            )
        # The end of a one-sided law, such as a delay of 0, may well be the nominal value.
        if abs(row.reference - 0.5 * (low + high)) > 2.0 * half:
            yield (
                f"{row.name}: its nominal value, {row.reference:.{digits}g} {row.unit}, is not among the likely ones, "
                f"{likely}: the nominal run is not typical"
            )


def _beyond_a_table(separation, row, high):
    """A stroke that scatters beyond the last row of its spring's table: nothing is known of the force there."""
    for parameter in row.parameters:
        if parameter.startswith("springs[") and parameter.endswith(".stroke"):
            i = int(parameter[8 : parameter.index("]")])
            stroke = separation.springs.stroke[i] + row.factor * (high - row.reference)
            table = separation.springs.tables[i]
            if table is not None and stroke > table[-1, 0]:
                yield (
                    f"{row.name}: the stroke of spring {i + 1} reaches {1e3 * stroke:.4g} mm at the 99.9 % quantile, "
                    f"but its force-stroke table ends at {1e3 * table[-1, 0]:g} mm"
                )


def _scattered_runs(case):
    """A well-spread sample of the parameters and its runs, without touching the random generator."""
    distribution = joint_distribution(case.inputs, case.copula)
    points = ot.LowDiscrepancyExperiment(ot.SobolSequence(), distribution, _SAMPLE_SIZE, False).generate()
    parameters = ParameterMap(case.inputs, case.separation).parameters(np.array(points))
    return parameters, simulate(case.separation, parameters)


def _of_the_requirements(case):
    for row in requirement_scatter(case):
        if not math.isfinite(row.median):
            continue
        requirement = row.requirement
        violated = not requirement.is_met(row.median)
        hint = _other_unit(row)
        far = max(abs(row.median), abs(requirement.limit)) > _FAR * min(abs(row.median), abs(requirement.limit))
        within = row.smallest <= requirement.limit <= row.largest
        if not violated and (hint is None or within or not far):
            continue
        runs = ""
        if row.runs:
            met = "all" if row.met == row.runs else f"{row.met:,}" if row.met else "none"
            runs = (
                f", {row.runs:,} scattered ones {_short(row.smallest)} to {_short(row.largest)}, and {met} of these "
                f"meet{'s' if row.met == 1 else ''} it"
            )
        yield (
            f"requirement {requirement.name}: {requirement} {row.unit}, but the nominal run has {_short(row.nominal)}"
            + runs
            + (f" ({hint})" if hint else "")
        )


def _short(value):
    """Three digits of a number in a quantity's unit; a rounding error is 0."""
    return "0" if abs(value) < 1e-9 else f"{value:.3g}"


def _other_unit(row):
    """The unit in which the limit would be a likely one: met by most runs, and of their size."""
    sizes = np.abs([row.smallest, row.largest])
    smallest = 0.0 if row.smallest <= 0.0 <= row.largest else sizes.min()
    for name, factor in _OTHER_UNITS.get(row.unit, {}).items():
        limit = factor * row.requirement.limit
        likely = replace(row.requirement, limit=limit).is_met(row.median)
        if likely and smallest / _NEAR <= abs(limit) <= sizes.max() * _NEAR:
            return f"{row.requirement.limit:g} {name}? That is {limit:.3g} {row.unit}"
    return None


def _of_runs(case):
    """What a well-spread sample of the inputs runs into."""
    if not case.inputs:
        return
    parameters, outcome = _scattered_runs(case)
    status = outcome.status
    tensors = _broken_tensors(case, parameters)
    for name, broken in tensors.items():
        if broken.any():
            yield (
                f"{name}: the scatter of its inertia gives {_share(broken)} of the combinations a tensor that no body "
                "has (a principal moment above the sum of the other two, or below 0); such runs fail"
            )
    explained = np.logical_or.reduce(list(tensors.values()))
    for value in np.unique(status):
        failed = (status == value) & ~explained
        if value != Status.OK and failed.any():
            yield f"runs: {_share(failed)} of the combinations of the inputs fail: {Status(int(value)).sentence}"


def _broken_tensors(case, parameters):
    """Whether each combination breaks the triangle inequality, by body."""
    index = {name: k for k, name in enumerate(case.separation.parameter_names())}
    broken = {}
    for body in ("platform", "satellite"):
        xx, yy, zz, xy, xz, yz = (
            parameters[:, index[f"{body}.inertia.{key}"]] for key in ("xx", "yy", "zz", "xy", "xz", "yz")
        )
        tensors = np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)
        moments = np.linalg.eigvalsh(tensors)
        excess = moments[:, 2] - moments[:, 0] - moments[:, 1]
        broken[body] = (moments[:, 0] <= 0.0) | (excess > 1e-9 * moments[:, 2])
    return broken


def _share(flags):
    return f"{float(f'{100.0 * flags.mean():.2g}'):g} %"
