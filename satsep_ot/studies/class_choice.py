"""The cheapest set of classes of tolerances that meets all limits, by a search in the order of the price."""

import itertools
import math
from collections.abc import Callable

from satsep_ot.model.case import Case
from satsep_ot.model.inputs import ToleranceClass
from satsep_ot.studies.drivers import scaled_case, tolerances
from satsep_ot.studies.quick_probability import quick_probability, step_seed
from satsep_ot.studies.telling.class_choice import ClassChoice, ClassRow, ClassSet
from satsep_ot.studies.telling.tolerance_curves import CurvePoint

# Of the confirmation: the coefficient of variation of a study by default.
_CONFIRMED = 0.05


def tolerance_classes(case: Case) -> dict[str, tuple[ToleranceClass, ...]]:
    """The classes of each tolerance that has any.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`

    Returns
    -------
    classes : dict of str to tuple of :class:`satsep_ot.model.inputs.ToleranceClass`

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.class_choice import tolerance_classes
    >>> tolerance_classes(load_case("reference"))
    {}
    """
    found = {name: next((row.classes for row in rows if row.classes), ()) for name, rows in tolerances(case).items()}
    return {name: classes for name, classes in found.items() if classes}


def class_choice(
    case: Case, seed: int = 0, progress: Callable[[str, float], None] = lambda label, share: None
) -> ClassChoice:
    """Evaluate each class alone, and search the cheapest set that meets the allowed probabilities of all requirements.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
        With classes, and requirements with an allowed probability.
    seed : int
    progress : callable
        Called with what is being done and the share of it that is done.

    Returns
    -------
    choice : ClassChoice

    Notes
    -----
    More scatter is taken not to help: a class that fails beside the tightest ones of the others is left out, and so is
    a set that is as loose in each tolerance as one that fails. The set that is chosen does not rest on that, it is
    confirmed by runs of its own.
    """
    classes = tolerance_classes(case)
    limits = {entry.name: entry.allowed_probability for entry in case.requirements if entry.allowed_probability}
    search = _Search(case, limits, seed)
    rows: list[ClassRow] = []
    for name, members in classes.items():
        for one in members:
            progress(f"class {one.label} of {name}", 0.5 * len(rows) / sum(map(len, classes.values())))
            points = search.points({name: one})
            rows.append(ClassRow(name, one.label, one.scale, one.price, points, search.meets(points)))
    sets = math.prod(map(len, classes.values()))
    chosen = search.cheapest(classes, progress)
    tightest = _class_set(*search.tightest(classes)) if chosen is None else None
    return ClassChoice(limits, tuple(rows), sets, search.tested, chosen, tightest)


class _Search:
    """Sets of classes of a case, tested by runs."""

    def __init__(self, case, limits, seed):
        self._case, self._limits, self._seed = case, limits, step_seed("classes", seed)
        # The requirement that failed last fails next, as a rule.
        self._order = list(limits)
        self.tested = 0

    def meets(self, points):
        """Whether all limits are met."""
        return all(name in points and points[name].meets(limit) for name, limit in self._limits.items())

    def points(self, chosen, stops=False, seed=0, target=0.1):
        """The probability of each violation with some classes; with `stops`, none after the first limit missed."""
        case, points = self._case, {}
        for name, one in chosen.items():
            case = scaled_case(case, name, one.scale)
        for requirement in list(self._order):
            found = quick_probability(case, requirement, self._seed + seed, target)
            point = CurvePoint(1.0, found.probability, found.lower95, found.upper95, found.runs, found.converged)
            points[requirement] = point
            if stops and not point.meets(self._limits[requirement]):
                self._order.remove(requirement)
                self._order.insert(0, requirement)
                break
        return {name: points[name] for name in self._limits if name in points}

    def tightest(self, classes):
        """The tightest class of each tolerance, and the probabilities then."""
        tight = {name: min(members, key=lambda one: one.scale) for name, members in classes.items()}
        return tight, self.points(tight)

    def cheapest(self, classes, progress):
        """The set with the lowest price that meets all limits; None where no set does."""
        progress("sets of classes", 0.5)
        tight, points = self.tightest(classes)
        self.tested = 1
        if not self.meets(points):
            return None
        possible = [self._possible(tight, name, members) for name, members in classes.items()]
        sets = [dict(zip(classes, chosen, strict=True)) for chosen in itertools.product(*possible)]
        # Of two at one price the looser one is tried first.
        sets.sort(key=lambda chosen: (_price(chosen), -sum(math.log(one.scale) for one in chosen.values())))
        failed: list[dict[str, ToleranceClass]] = []
        for place, chosen in enumerate(sets):
            progress(f"set {place + 1} of {len(sets)} of classes", 0.6 + 0.4 * place / len(sets))
            if any(all(chosen[name].scale >= one.scale for name, one in other.items()) for other in failed):
                continue
            self.tested += 1
            if self.meets(self.points(chosen, stops=True)):
                confirmed = self.points(chosen, stops=True, seed=1, target=_CONFIRMED)
                if self.meets(confirmed):
                    return _class_set(chosen, confirmed)
            failed.append(chosen)
        return None

    def _possible(self, tight, name, members):
        """The classes of a tolerance that meet all limits at least with the tightest classes of the others."""
        members = sorted(members, key=lambda one: -one.scale)
        while members[0] is not tight[name]:
            self.tested += 1
            if self.meets(self.points(tight | {name: members[0]}, stops=True)):
                break
            members = members[1:]
        return members


def _price(chosen):
    return sum(one.price for one in chosen.values())


def _class_set(chosen, points):
    return ClassSet({name: one.label for name, one in chosen.items()}, _price(chosen), points)
