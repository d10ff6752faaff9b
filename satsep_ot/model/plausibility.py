"""Warnings of what a case file allows but its author hardly means: sentences for a person to read, never an error."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import openturns as ot

from satsep_ot.dynamics.gravity import EARTH_GRAVITATIONAL_PARAMETER, EARTH_RADIUS
from satsep_ot.dynamics.parameter_vector import TENSOR, Sign
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.separation import Status, inertia_tensor, is_inertia
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.dynamics.springs import Interpolation, force_functions
from satsep_ot.model.case import Case, Requirement
from satsep_ot.model.distributions import interval_digits, quantile_range
from satsep_ot.model.hand_formulas import push_energy, push_velocity, table_energies
from satsep_ot.model.inputs import ParameterMap, joint_distribution
from satsep_ot.model.parameters import BODIES, parameter_rows
from satsep_ot.model.values import KILOGRAM, KILOGRAM_SQUARE_METRE, MILLIMETRE, NEWTON_PER_METRE

# Launchers separate satellites at 0.3 to 1 m/s, deployers at up to 2 m/s; a factor of some beyond is a wrong unit.
_SLOWEST, _FASTEST = 0.02, 5.0  # m/s
_LARGEST_ACCELERATION = 50.0 * 9.80665  # m/s2
_LARGEST_RATE = 720.0  # deg/s, twice the 60 rpm of a spinning stage
_LARGEST_RELATIVE_SCATTER = 0.2
_KNOWN_RELATIVELY = (KILOGRAM, KILOGRAM_SQUARE_METRE, NEWTON_PER_METRE)  # units of what is known to some per cent
_USUAL_ENVELOPE = (5.0, 5e4)  # mm
_SAMPLE_SIZE = 1024
_CONTACT_SAMPLE_SIZE = 128  # of cases with contact, whose runs take longer
_INTERPOLATION_SHARE = 0.1  # of the scatter of the velocity
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
        Scattered runs that meet the requirement, and scattered runs that did not fail; 0 without uncertain inputs.
    """

    requirement: Requirement
    unit: str
    nominal: float
    smallest: float
    median: float
    largest: float
    met: int
    runs: int


def plausibility_warnings(case: Case) -> list[str]:
    """Warnings of what is hardly meant in a case, usually a value in a wrong unit.

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
    >>> from satsep_ot.model.plausibility import plausibility_warnings
    >>> plausibility_warnings(load_case("reference"))
    []
    >>> fast = load_case("reference").text.replace("stiffness = 5500.0", "stiffness = 5500.0e3")
    >>> print(plausibility_warnings(parse_case(fast))[0])
    springs: their energy of 1.65e+04 J gives 18.9 m/s; separations have 0.02 to 5 m/s (N/m and mm?)
    """
    return [
        *_push_warnings(case.separation),
        *_size_warnings(case.separation),
        *_body_warnings(case.separation),
        *_arrangement_warnings(case.separation),
        *_orbit_warnings(case.separation),
        *_input_warnings(case),
        *_run_warnings(case),
        *_interpolation_warnings(case),
        *_requirement_warnings(case),
        *_wall_warnings(case),
    ]


def requirement_scatter(case: Case) -> list[RequirementScatter]:
    """Each requirement beside the nominal run and 1,024 well-spread combinations of the uncertain inputs.

    With contact, whose runs take longer, 128.

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


def _push_warnings(separation):
    energy = push_energy(separation)
    speed = push_velocity(separation)
    if not _SLOWEST <= speed <= _FASTEST:
        yield (
            f"springs: their energy of {energy:.3g} J gives {speed:.3g} m/s; separations have {_SLOWEST:g} to "
            f"{_FASTEST:g} m/s (N/m and mm?)"
        )
    force = sum(max(float(force_of_spring(0.0)), 0.0) for force_of_spring in force_functions(separation.springs))
    acceleration = force / separation.satellite.mass
    if acceleration > _LARGEST_ACCELERATION:
        yield f"springs: they accelerate the satellite by {acceleration / 9.80665:.3g} g at the start (N/m?)"
    springs = separation.springs
    if np.any(springs.law_property("has_stiffness") & (springs.stroke > springs.deformation)):
        yield "springs: a stroke is longer than the deformation; that spring lets go where it is relaxed"
    for axis, rate in zip("xyz", np.degrees(separation.rates), strict=True):
        if abs(rate) > _LARGEST_RATE:
            yield f"initial rate about {axis}: {rate:.4g} deg/s is {abs(rate) / 6.0:.3g} rpm (deg/s?)"


def _size_warnings(separation):
    """Lengths and stiffnesses that are far from those of any separation; 0 is left out, there is no such thing then."""
    unused = separation.unused_parameters()
    values: dict[str, list[float]] = {}
    for place, value in zip(separation.parameter_places(), separation.parameters(), strict=True):
        if place.name not in unused and value != 0.0:
            values.setdefault(place.path, []).append(value)
    for table, row in parameter_rows():
        if row.usual is not None and row.field in values:
            what = f"{table.name}: a {row.parameter.replace('_', ' ')}"
            yield from _unusual(what, values[row.field], row.unit, *row.usual)
    if separation.envelope is not None:
        yield from _unusual("envelope: a size", [np.abs(separation.envelope).max()], MILLIMETRE, *_USUAL_ENVELOPE)


def _unusual(what, values, unit, smallest, largest):
    values = np.array(values) / unit.factor
    usual = f"separations have {smallest:g} to {largest:g} {unit.name}"
    if values.min() < smallest:
        yield f"{what} of {values.min():.3g} {unit.name}; {usual} ({unit.name}; written in {unit.mistaken}?)"
    if values.max() > largest:
        yield f"{what} of {values.max():.3g} {unit.name}; {usual} ({unit.name}?)"


def _body_warnings(separation):
    ring = float(np.max(separation.springs.radius))
    for name in BODIES:
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


def _arrangement_warnings(separation):
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


def _orbit_warnings(separation):
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


def _wall_warnings(case):
    """A nominal run through a wall where no requirement limits the clearance."""
    table = quantity_table(case.separation)
    if "clearance" not in table or any(entry.quantity == "clearance" for entry in case.requirements):
        return
    clearance = float(simulate(case.separation).quantity("clearance")[0])
    if clearance < 0.0:
        yield (
            f"walls: the nominal run leaves through one, by {-clearance:.3g} mm; walls do not hold the satellite, its "
            "rates are those of a free body"
        )


def _input_warnings(case):
    rows = {f"{table.name}.{row.key}": row for table, row in parameter_rows()}
    places = {place.name: place for place in case.separation.parameter_places()}
    for entry in case.inputs:
        moved = [places[name] for name in entry.parameters]
        low, high = quantile_range(entry.distribution)
        digits = interval_digits(low, high, 4)
        likely = f"{low:.{digits}g} to {high:.{digits}g} {entry.unit}"
        yield from _beyond_a_table(case.separation, entry, moved, high)
        # An input that was not made from the table of parameters has no row.
        if entry.key in rows:
            yield from _unusual_scatter(entry, rows[entry.key], moved[0].sign, 0.5 * (high - low), likely)
        # The end of a one-sided law, such as a delay of 0, may well be the nominal value.
        if abs(entry.reference - 0.5 * (low + high)) > high - low:
            yield (
                f"{entry.name}: its nominal value, {entry.reference:.{digits}g} {entry.unit}, is not among the likely "
                f"ones, {likely}: the nominal run is not typical"
            )


def _unusual_scatter(entry, row, sign, half, likely):
    """A scatter that is much wider or much narrower than any such parameter has."""
    mean = abs(entry.distribution.getMean()[0])
    is_known = row.unit in _KNOWN_RELATIVELY and sign is Sign.POSITIVE
    if is_known and half > 3.0 * _LARGEST_RELATIVE_SCATTER * mean:
        yield (
            f"{entry.name}: 99.8 % of its values lie within {likely}, a scatter of {100.0 * half / mean:.0f} % of its "
            "mean"
        )
    smallest = row.unit.smallest_scatter if row.smallest_scatter is None else row.smallest_scatter
    if half < smallest:
        yield (
            f"{entry.name}: 99.8 % of its values lie within {likely}, closer than anyone measures "
            f"({entry.unit}; written in {row.unit.mistaken}?)"
        )


def _beyond_a_table(separation, entry, moved, high):
    """A stroke that scatters beyond the last row of its spring's table: nothing is known of the force there."""
    for place in moved:
        table = separation.springs.tables[place.index] if place.path == "springs.stroke" else None
        if table is None:
            continue
        stroke = separation.springs.stroke[place.index] + entry.factor * (high - entry.reference)
        if stroke > table[-1, 0]:
            yield (
                f"{entry.name}: the stroke of spring {place.index + 1} reaches {1e3 * stroke:.4g} mm at the 99.9 % "
                f"quantile, but its force-stroke table ends at {1e3 * table[-1, 0]:g} mm"
            )


def _scattered_runs(case):
    """A well-spread sample of the parameters and its runs, without touching the random generator."""
    distribution = joint_distribution(case.inputs, case.copula)
    size = _CONTACT_SAMPLE_SIZE if case.separation.has_contact() else _SAMPLE_SIZE
    points = ot.LowDiscrepancyExperiment(ot.SobolSequence(), distribution, size, False).generate()
    parameters = ParameterMap(case.inputs, case.separation).parameters(np.array(points))
    return parameters, simulate(case.separation, parameters)


def _requirement_warnings(case):
    """Limits that would be likely ones in another unit."""
    for row in requirement_scatter(case):
        if not math.isfinite(row.median) or row.requirement.center is not None:
            continue
        requirement, hint = row.requirement, _other_unit(row)
        far = max(abs(row.median), abs(requirement.limit)) > _FAR * min(abs(row.median), abs(requirement.limit))
        within = row.smallest <= requirement.limit <= row.largest
        violated = not requirement.is_met(row.median)
        # A case with a failed spring violates limits that are meant as they are.
        if hint is None or not (violated or (far and not within)):
            continue
        yield (
            f"requirement {requirement.name}: {requirement} {row.unit}, but the nominal run has {_short(row.nominal)}"
            f"{_scattered(row)} ({hint})"
        )


def _scattered(row):
    """What the scattered runs have, in words."""
    if not row.runs:
        return ""
    met = "all" if row.met == row.runs else f"{row.met:,}" if row.met else "none"
    return (
        f", {row.runs:,} scattered ones {_short(row.smallest)} to {_short(row.largest)}, and {met} of these "
        f"meet{'s' if row.met == 1 else ''} it"
    )


def violation_sentences(case: Case) -> list[str]:
    """Requirements that most of the scattered runs violate, where no other unit of the limit would explain that.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`

    Returns
    -------
    sentences : list of str

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.plausibility import violation_sentences
    >>> violation_sentences(load_case("reference"))
    []
    """
    return [
        _violation(row)
        for row in requirement_scatter(case)
        if _is_violated(row) and (row.requirement.center is not None or _other_unit(row) is None)
    ]


def _is_violated(row):
    """Whether most runs violate a requirement; not where there are none that ended well."""
    if not math.isfinite(row.median):
        return False
    return 2 * row.met < row.runs if row.runs else not row.requirement.is_met(row.nominal)


def _violation(row):
    entry, missed = row.requirement, row.runs - row.met
    case = f"{entry.name}: the case violates this requirement, {entry} {row.unit},"
    if not row.runs:
        return f"{case} in its nominal run ({_short(row.nominal)})"
    share = f"all of {row.runs:,}" if missed == row.runs else f"{missed:,} of {row.runs:,}"
    return f"{case} in {share} runs ({_short(row.smallest)} to {_short(row.largest)})"


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


def _run_warnings(case):
    """Runs of a well-spread sample of the inputs that fail."""
    nominal = simulate(case.separation)
    if nominal.status[0] == Status.PENETRATION:
        yield f"nominal run: {nominal.explain(0)}"
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


def _interpolation_warnings(case):
    """Tables with so few rows that the velocity depends on what is between them."""
    energies = table_energies(case.separation)
    if not energies or not case.inputs:
        return
    _, outcome = _scattered_runs(case)
    velocities = outcome.quantity("axial_velocity")[outcome.status == Status.OK]
    if not velocities.size:
        # The warning of runs that fail says so.
        return
    scatter = float(np.std(velocities))
    energy, velocity = push_energy(case.separation), push_velocity(case.separation)
    by_lines, by_cubics = energies[Interpolation.LINES], energies[Interpolation.MONOTONE]
    change = 0.5 * velocity * abs(by_lines - by_cubics) / abs(energy) if energy else 0.0
    if change > _INTERPOLATION_SHARE * scatter:
        yield (
            f"springs.table: straight lines between the rows give {by_lines:.6g} J and monotone cubics "
            f"{by_cubics:.6g} J: the velocity differs by {change:.3g} m/s, where its scatter is {scatter:.3g} m/s; "
            "measure more rows, or choose by springs.interpolation"
        )


def _broken_tensors(case, parameters):
    """Whether each combination gives a body a tensor that no body has, by body."""
    columns = dict(zip(case.separation.parameter_names(), parameters.T, strict=True))
    return {
        body: ~is_inertia(
            np.linalg.eigvalsh(inertia_tensor(*(columns[f"{body}.inertia.{element}"] for element in TENSOR)))
        )
        for body in BODIES
    }


def _share(flags):
    return f"{float(f'{100.0 * flags.mean():.2g}'):g} %"
