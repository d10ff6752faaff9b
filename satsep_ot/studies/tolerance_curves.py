"""The probability of a violation against the size of each of the strongest tolerances, and what size meets a limit."""

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence

from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.model.case import Case
from satsep_ot.openturns_adapter import raiseInterrupt
from satsep_ot.studies.drivers import scaled_case, scaled_distribution
from satsep_ot.studies.quick_probability import quick_probability, step_seed
from satsep_ot.studies.telling.tolerance_curves import CurvePoint, RequirementCurves, ToleranceCurve, TolerancePair

# Runs of the study carry a point whose coefficient of variation is at most this.
_CARRIED = 0.2
SCALES = (0.3, 0.5, 0.7, 0.85, 1.0, 1.2, 1.5, 2.0)
# The loosest size is confirmed by new runs, each time this much smaller until they do.
_STEP, _MOST_STEPS = 0.95, 4


def requirement_curves(
    case: Case,
    requirement: str,
    allowed: float | None,
    now: CurvePoint,
    tolerances: Sequence[str],
    result: ActiveSubspaceReliabilityResult | None,
    makes_runs: bool,
    halved: Mapping[str, CurvePoint] | None = None,
    seed: int = 0,
    progress: Callable[[str, float], None] = lambda label, share: None,
    spread: Callable[..., Iterable] = map,
) -> RequirementCurves:
    """Curves of the probability of violating a requirement, and the loosest size of each tolerance that meets it.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
    requirement : str
    allowed : float or None
        Allowed probability.
    now : CurvePoint
        With the scatter of the case file, at scale 1.
    tolerances : sequence of str
        The strongest ones.
    result : :class:`satsep_ot.methods.reliability.result.ActiveSubspaceReliabilityResult` or None
        Whose runs are re-weighted where they carry it.
    makes_runs : bool
        Whether points that re-weighting does not carry are made by new runs, and sizes that meet the limit confirmed.
    halved : dict of str to CurvePoint, optional
        Points at half the scatter that new runs have made already, by tolerance.
    seed : int
    progress : callable
        Called with what is being done and the share of it that is done.
    spread : callable
        As the built-in ``map``; it may make new runs of several sizes side by side.

    Returns
    -------
    curves : RequirementCurves
    """
    by_runs = _Runs(case, requirement, seed)
    is_met = allowed is not None and now.meets(allowed)
    found: dict[str, dict[float, CurvePoint | None]] = {}
    for name in tolerances:
        progress(f"{requirement}: sizes of {name}", 0.0)
        found[name] = {scale: now if scale == 1.0 else _reweighted(case, result, name, scale) for scale in SCALES}
        if halved and name in halved:
            found[name][0.5] = found[name][0.5] or halved[name]
    if makes_runs:
        lacking = [(name, scale) for name, points in found.items() for scale in SCALES if points[scale] is None]
        made = by_runs.points(lacking, spread)
        for place, ((name, scale), point) in enumerate(zip(lacking, made, strict=True)):
            found[name][scale] = point
            progress(f"{requirement}: sizes of {name} by new runs", (place + 1) / len(lacking))
    points = [tuple(point for point in found[name].values() if point is not None) for name in tolerances]
    sizes: Iterable[CurvePoint | None] = itertools.repeat(None)
    if allowed is not None:
        find = functools.partial(_loosest, allowed=allowed, by_runs=by_runs if makes_runs else None)
        sizes = (spread if makes_runs else map)(find, points, tolerances)
    curves = [ToleranceCurve(*curve) for curve in zip(tolerances, points, sizes, strict=False)]
    lacks = allowed is not None and not is_met and makes_runs and not any(curve.loosest for curve in curves)
    pair = _pair(curves, allowed, by_runs) if lacks else None
    return RequirementCurves(allowed, is_met, tuple(curves), pair, lacks and len(curves) > 1)


class _Runs:
    """New runs of a case with tolerances scaled; all with the same seed, so that crude ones have common numbers."""

    def __init__(self, case, requirement, seed):
        self._case, self._requirement, self._seed = case, requirement, step_seed("curves", requirement, seed)

    def point(self, names, scale, is_confirmation=False):
        """The point with some tolerances scaled alike; a confirmation has a seed of its own."""
        case = self._case
        for name in names:
            case = scaled_case(case, name, scale)
        return _point(scale, quick_probability(case, self._requirement, self._seed + is_confirmation))

    def points(self, scaled, spread):
        """The points with one tolerance scaled, of pairs of its name and the scale."""
        cases = [scaled_case(self._case, name, scale) for name, scale in scaled]
        run = functools.partial(quick_probability, requirement=self._requirement, seed=self._seed)
        made = spread(run, cases)
        yield from (_point(scale, found) for (_, scale), found in zip(scaled, made, strict=True))


def _point(scale, found):
    """A point of a curve from a quick probability."""
    return CurvePoint(scale, found.probability, found.lower95, found.upper95, found.runs, found.converged)


def _reweighted(case, result, name, scale):
    """The point by the runs of the study with new weights; None where these do not carry it."""
    if result is None:
        return None
    try:
        answer = result.computeProbability(scaled_distribution(case, name, scale))
    except (RuntimeError, ValueError) as error:
        raiseInterrupt(error)
        return None
    if answer.warning or answer.coefficientOfVariation > _CARRIED:
        return None
    return CurvePoint(scale, answer.probability, answer.lower, answer.upper)


def _loosest(points, name, allowed, by_runs):
    """The loosest size that meets the limit: between the points around it, confirmed where runs may be made."""
    meeting = list(itertools.takewhile(lambda point: point.meets(allowed), points))
    if not meeting:
        return None
    last = meeting[-1]
    if len(meeting) == len(points):
        return last
    further = points[len(meeting)]
    scale = _crossing(last, further, allowed)
    if by_runs is None:
        return last
    for _ in range(_MOST_STEPS):
        if scale <= last.scale:
            break
        point = by_runs.point([name], scale, is_confirmation=True)
        if point.meets(allowed):
            return point
        scale *= _STEP
    return last


def _crossing(below, above, allowed):
    """The scale between two points at which the upper bound is the allowed probability, rounded down to 1 %."""
    if above.upper95 is None:
        return below.scale
    low, high = (math.log(max(point.upper95, 1e-300)) for point in (below, above))
    share = (math.log(allowed) - low) / (high - low) if high > low else 0.0
    return math.floor(100.0 * (below.scale + min(max(share, 0.0), 1.0) * (above.scale - below.scale))) / 100.0


def _pair(curves, allowed, by_runs):
    """The pair of tolerances that meets the limit where no single one does, at the loosest of the scales below 1."""
    known = [curve for curve in curves if curve.points and curve.points[0].probability is not None]
    known.sort(key=lambda curve: curve.points[0].probability)
    for first, second in itertools.combinations(known, 2):
        names, best = (first.tolerance, second.tolerance), None
        for scale in (scale for scale in SCALES if scale < 1.0):
            point = by_runs.point(names, scale, is_confirmation=True)
            if not point.meets(allowed):
                break
            best = point
        if best is not None:
            return TolerancePair(names, best)
    return None
