"""What in a case is allowed but hardly meant: sentences for a person to read, never an error."""

import math

import numpy as np
import openturns as ot

from satsep_ot.dynamics.invariants import spring_work
from satsep_ot.dynamics.separation import Separation, Status
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.dynamics.springs import ForceLaw
from satsep_ot.model.case import Case
from satsep_ot.model.inputs import ParameterMap, joint_distribution, quantile_range

# Launchers separate satellites at 0.3 to 1 m/s, deployers at up to 2 m/s; a factor of some beyond is a wrong unit.
_SLOWEST, _FASTEST = 0.02, 5.0  # m/s
_LARGEST_ACCELERATION = 50.0 * 9.80665  # m/s2
_LARGEST_RATE = 720.0  # deg/s, twice the 60 rpm of a spinning stage
_LARGEST_RELATIVE_SCATTER = 0.2
_SAMPLE_SIZE = 1024


def push_energy(separation: Separation) -> float:
    """Work of all springs on their way, without losses [J].

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    energy : float

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.plausibility import push_energy
    >>> round(push_energy(load_case("reference").separation), 9)
    16.5
    """
    springs = separation.springs
    linear = springs.laws == ForceLaw.LINEAR
    way = np.where(linear, np.minimum(springs.stroke, springs.deformation), springs.stroke)
    return float(spring_work(separation, np.zeros(len(springs)), way).sum())


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
    return [*_of_the_push(case.separation), *_of_the_bodies(case.separation), *_of_the_inputs(case), *_of_runs(case)]


def _of_the_push(separation):
    energy = push_energy(separation)
    inverse = 1.0 / separation.platform.mass + 1.0 / separation.satellite.mass
    speed = math.sqrt(max(2.0 * energy * inverse, 0.0))
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


def _of_the_bodies(separation):
    ring = float(np.max(separation.springs.radius))
    for name in ("platform", "satellite"):
        body = getattr(separation, name)
        gyration = np.sqrt(np.linalg.eigvalsh(body.inertia) / body.mass)
        # Of a homogeneous box of side a it is 0.41 a.
        reach = max(ring, float(np.abs(body.center_of_mass).max()))
        if name == "satellite" and separation.envelope is not None:
            reach = max(reach, float(np.abs(separation.envelope).max()))
        if gyration[2] > 10.0 * reach or gyration[0] < 0.05 * reach:
            yield (
                f"{name}: its inertia is that of a body with radii of gyration from {1e3 * gyration[0]:.3g} to "
                f"{1e3 * gyration[2]:.3g} mm, beside a ring and a centre of mass within {1e3 * reach:.3g} mm (kg m2?)"
            )
        offset = float(np.hypot(body.center_of_mass[0], body.center_of_mass[2]))
        if ring > 0.0 and offset > ring:
            yield f"{name}: its centre of mass is {1e3 * offset:.3g} mm off the axis, outside of the spring ring (mm?)"


def _of_the_inputs(case):
    for row in case.inputs:
        low, high = quantile_range(row.distribution)
        half = 0.5 * (high - low)
        mean = row.distribution.getMean()[0]
        yield from _beyond_a_table(case.separation, row, high)
        positive = row.unit in ("kg", "N/m") or row.parameters[0].endswith(("inertia.xx", "inertia.yy", "inertia.zz"))
        if positive and half > 3.0 * _LARGEST_RELATIVE_SCATTER * abs(mean):
            yield (
                f"{row.name}: 99.8 % of its values lie within {low:.4g} to {high:.4g} {row.unit}, a scatter of "
                f"{100.0 * half / abs(mean):.0f} % of its mean"
            )
        # The end of a one-sided law, such as a delay of 0, may well be the nominal value.
        if abs(row.reference - 0.5 * (low + high)) > 2.0 * half:
            yield (
                f"{row.name}: its nominal value, {row.reference:.4g} {row.unit}, is not among the likely ones, "
                f"{low:.4g} to {high:.4g}: the nominal run is not typical"
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


def _of_runs(case):
    """What a well-spread sample of the inputs runs into, without touching the random generator."""
    if not case.inputs:
        return
    distribution = joint_distribution(case.inputs, case.copula)
    points = ot.LowDiscrepancyExperiment(ot.SobolSequence(), distribution, _SAMPLE_SIZE, False).generate()
    status = simulate(case.separation, ParameterMap(case.inputs, case.separation).parameters(np.array(points))).status
    tensors = _broken_tensors(case, np.array(points))
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


def _broken_tensors(case, points):
    """Whether each combination breaks the triangle inequality, by body."""
    parameters = ParameterMap(case.inputs, case.separation).parameters(points)
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
    return f"{100.0 * flags.mean():.2g} %"
