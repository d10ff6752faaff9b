"""Whether a requirement is met, from a probability with its interval and the allowed probability."""

import dataclasses
import enum
import math
from collections.abc import Iterable, Sequence

from satsep_ot.model.case import SYSTEM
from satsep_ot.studies.telling.results import Estimate, HalvedTolerance, Interval, StudyResult
from satsep_ot.studies.telling.words import (
    DECIDING_METHODS,
    StudyMethod,
    capitalized,
    fewer_than,
    in_words,
    interval_text,
    probability_text,
)

# The finest coefficient of variation that a study can be asked for.
SMALLEST_PRECISION = 0.01
# Standard deviations to the limit with which a 95 % interval excludes it in four of five cases: 1.96 + 0.84.
_DECIDING_DEVIATIONS = 2.8


class Status(enum.StrEnum):
    """What is known of a requirement; the value is what people read."""

    MET = "met"
    NOT_MET = "not met"
    UNDECIDED = "undecided"
    NO_ALLOWANCE = "no allowed probability"
    UNKNOWN = "no estimate"


_HEADLINES = {
    Status.NOT_MET: "Not met: {}.",
    Status.UNDECIDED: "Undecided with these runs: {}.",
    Status.UNKNOWN: "Without an estimate: {}.",
    Status.MET: "Met with 95 % confidence: {}.",
    Status.NO_ALLOWANCE: "Without an allowed probability to compare with: {}.",
}


@dataclasses.dataclass(frozen=True)
class Verdict:
    """What is known of one requirement.

    Attributes
    ----------
    requirement : str
    status : Status
    sentence : str
        Why.
    row : Estimate or None
        The estimate that it rests on.
    doubt : bool
        Whether the intervals of two methods do not overlap.
    is_met_together : bool or None
        Whether it is met at the level at which all requirements are met at once with 95 % confidence; None where that
        is not known.
    """

    requirement: str
    status: Status
    sentence: str
    row: Estimate | None
    doubt: bool = False
    is_met_together: bool | None = None

    @property
    def is_plain(self) -> bool:
        """Whether probability, interval and status say all that the sentence says."""
        return self.status in (Status.MET, Status.NOT_MET) and not self.doubt


def best_estimate(rows: Iterable[Estimate]) -> Estimate | None:
    """The estimate that others are judged by: by ActiveSubspace if it has converged, else by MonteCarlo.

    Chosen by the method, not by the width of the interval: the narrower of two may hold the truth less often than each
    does.

    Parameters
    ----------
    rows : sequence of Estimate
        Of one requirement.

    Returns
    -------
    row : Estimate or None
        None where none of them has converged to a probability with an interval.

    Examples
    --------
    >>> from satsep_ot.studies.telling.results import Estimate
    >>> from satsep_ot.studies.telling.verdicts import best_estimate
    >>> from satsep_ot.studies.telling.words import StudyMethod
    >>> row = Estimate("spin", StudyMethod.MONTE_CARLO, 0.0, 0.0, 3e-5, converged=True)
    >>> best_estimate([row]).upper95
    3e-05
    """
    return next((row for row, _ in _deciding(rows)), None)


def estimate_by(method: StudyMethod, rows: Iterable[Estimate]) -> Estimate | None:
    """The estimate by a method, None where it was not run."""
    return next((row for row in rows if row.method == method), None)


def contradiction(rows: Iterable[Estimate]) -> str:
    """A clause where the intervals of ActiveSubspace and MonteCarlo have no probability in common.

    Chance does that at most 1 time in 20 (1 in 180 where both are as wide); else one of them has missed failures.

    Parameters
    ----------
    rows : sequence of Estimate
        Of one requirement.

    Returns
    -------
    clause : str
        Empty where they overlap or one of them is missing.

    Examples
    --------
    >>> from satsep_ot.studies.telling.results import Estimate
    >>> from satsep_ot.studies.telling.verdicts import contradiction
    >>> from satsep_ot.studies.telling.words import StudyMethod
    >>> row = Estimate("spin", StudyMethod.MONTE_CARLO, 2.5e-3, 2e-3, 3e-3, converged=True)
    >>> other = Estimate("spin", StudyMethod.ACTIVE_SUBSPACE, 1.3e-3, 1.2e-3, 1.4e-3, converged=True)
    >>> contradiction([row, other])
    'the intervals of ActiveSubspace (1.2e-3 to 1.4e-3) and MonteCarlo (2e-3 to 3e-3) do not overlap'
    """
    found = _deciding(rows)
    if len(found) < 2 or found[0][1].overlaps(found[1][1]):
        return ""
    texts = [f"{row.method} ({interval_text(interval.lower, interval.upper)})" for row, interval in found]
    return f"the intervals of {' and '.join(texts)} do not overlap"


def _deciding(rows: Iterable[Estimate]) -> list[tuple[Estimate, Interval]]:
    """The estimates that a verdict may rest on, with their intervals, the best one first."""
    found = {row.method: (row, row.interval) for row in rows if row.interval is not None and row.converged}
    return [found[method] for method in DECIDING_METHODS if method in found]


def judge(requirement: str, rows: Sequence[Estimate], allowed: float | None = None) -> Verdict:
    """The verdict on one requirement.

    Parameters
    ----------
    requirement : str
    rows : sequence of Estimate
        Of this requirement.
    allowed : float, optional
        Largest accepted probability of violation.

    Returns
    -------
    verdict : Verdict
        "met" only where the whole 95 % interval of `best_estimate` is at most the allowed probability, "not met" only
        where all of it is above. Where the intervals of ActiveSubspace and MonteCarlo do not overlap, both must be.

    Examples
    --------
    >>> from satsep_ot.studies.telling.results import Estimate
    >>> from satsep_ot.studies.telling.verdicts import judge
    >>> from satsep_ot.studies.telling.words import StudyMethod
    >>> row = Estimate("spin", StudyMethod.MONTE_CARLO, 2e-4, 1e-4, 4e-4, converged=True)
    >>> print(judge("spin", [row], 1e-3).status, "and", judge("spin", [row], 3e-4).status)
    met and undecided
    """
    found = _deciding(rows)
    if not found:
        return Verdict(requirement, Status.UNKNOWN, _why_unknown(rows), None)
    row, (probability, lower, upper) = found[0]
    doubt = contradiction(rows)
    known = (
        f"{in_words(probability)}; with 95 % confidence between {probability_text(lower)} and {probability_text(upper)}"
        if probability > 0.0
        else f"none in {row.evaluations:,} runs; with 95 % confidence {fewer_than(upper)}"
    )
    if doubt:
        lower, upper = min(interval.lower for _, interval in found), max(interval.upper for _, interval in found)
        known = f"{doubt}; taken together they reach from {interval_text(lower, upper)}"
    known = capitalized(known)
    if allowed is None:
        sentence = f"{known}. The case file names no allowed probability."
        return Verdict(requirement, Status.NO_ALLOWANCE, sentence, row)
    limit = probability_text(allowed)
    if upper <= allowed:
        together = None if doubt or row.upper_together is None else row.upper_together <= allowed
        return Verdict(requirement, Status.MET, f"{known}: within the allowed {limit}.", row, bool(doubt), together)
    if lower > allowed:
        return Verdict(requirement, Status.NOT_MET, f"{known}: above the allowed {limit}.", row, bool(doubt))
    cure = "More runs, or another seed, show which of the two is right." if doubt else what_decides(row, allowed)
    sentence = f"{known}: the allowed {limit} lies in between. {cure}"
    return Verdict(requirement, Status.UNDECIDED, sentence, row)


def deciding_precision(row: Estimate, allowed: float) -> float:
    """The coefficient of variation at which an estimate would decide in four of five cases, if it stays as it is.

    Parameters
    ----------
    row : Estimate
        With a probability above 0.
    allowed : float
        Largest accepted probability of violation.

    Returns
    -------
    precision : float
        From 0.01, which no estimate of a study goes below, to 0.5.

    Examples
    --------
    >>> from satsep_ot.studies.telling.results import Estimate
    >>> from satsep_ot.studies.telling.verdicts import deciding_precision
    >>> from satsep_ot.studies.telling.words import StudyMethod
    >>> round(deciding_precision(Estimate("spin", StudyMethod.ACTIVE_SUBSPACE, 9e-4), 1e-3), 3)
    0.038
    """
    return min(max(_distance(row, allowed) / _DECIDING_DEVIATIONS, SMALLEST_PRECISION), 0.5)


def _distance(row, allowed):
    return abs(math.log(row.probability / allowed))


def what_decides(row: Estimate, allowed: float) -> str:
    """The command, and about how many runs of it, that decide an undecided requirement in four of five cases.

    Examples
    --------
    >>> from satsep_ot.studies.telling.results import Estimate
    >>> from satsep_ot.studies.telling.verdicts import what_decides
    >>> from satsep_ot.studies.telling.words import StudyMethod
    >>> row = Estimate("spin", StudyMethod.ACTIVE_SUBSPACE, 9e-4, 8e-4, 1.1e-3, 0.05, evaluations=1000)
    >>> what_decides(row, 1e-3)
    'About 4,800 runs would decide it: satsep-ot study case.toml --precision 0.037.'
    >>> what_decides(Estimate("spin", StudyMethod.MONTE_CARLO, 0.0, 0.0, 3e-3, evaluations=1000), 1e-3)
    'About 3,000 runs without a violation would decide it: satsep-ot study case.toml --runs 3000.'
    """
    command = "would decide it: satsep-ot study case.toml"
    interval = row.interval
    if interval is None or interval.probability == 0.0:
        needed = math.ceil(math.log(0.05) / math.log1p(-allowed) / 100.0) * 100
        return f"About {needed:,} runs without a violation {command} --runs {needed}."
    wanted = math.floor(1000.0 * _distance(row, allowed) / _DECIDING_DEVIATIONS) / 1000.0
    precision = min(max(wanted, SMALLEST_PRECISION), 0.5)
    # The same ratio of the interval's ends would be that of an estimate of this coefficient of variation.
    reached = math.log(interval.upper / max(interval.lower, 1e-3 * interval.probability)) / 3.92
    needed = _rounded(row.evaluations * (reached / precision) ** 2)
    if wanted < precision:
        command = "may still leave it open, so near is the estimate: satsep-ot study case.toml"
    option = f"--runs {needed}" if row.method == StudyMethod.MONTE_CARLO else f"--precision {precision:g}"
    return f"About {needed:,} runs {command} {option}."


def _rounded(number):
    """A number of runs, to two digits."""
    return int(float(f"{number:.2g}"))


def judge_all(result: StudyResult) -> list[Verdict]:
    """The verdict on each requirement of a study, in the order of the case file, failures of parts included."""
    return [
        _with_failures(
            judge(entry.name, result.rows_of(entry.name), entry.allowed_probability),
            result.failures.get(entry.name),
            entry.allowed_probability,
        )
        for entry in result.requirements
    ]


def _with_failures(verdict, mixture, allowed):
    """The verdict on the sum over all failures of parts, where the case names any."""
    if mixture is None:
        return verdict
    sentence = f"{verdict.sentence} With failures of parts: {mixture.sentence}."
    if allowed is None:
        return dataclasses.replace(verdict, sentence=sentence)
    status = Status.MET if mixture.upper95 <= allowed else Status.UNDECIDED
    status = Status.NOT_MET if mixture.lower95 > allowed else status
    return dataclasses.replace(verdict, status=status, sentence=f"{sentence} The sum decides.", is_met_together=None)


def headline(verdicts: Sequence[Verdict]) -> str:
    """All verdicts in one sentence, the worst first.

    Parameters
    ----------
    verdicts : sequence of Verdict

    Returns
    -------
    text : str

    Examples
    --------
    >>> from satsep_ot.studies.telling.verdicts import Status, Verdict, headline
    >>> headline([Verdict("spin", Status.MET, "", None), Verdict("clearance", Status.NOT_MET, "", None)])
    'Not met: clearance. Met with 95 % confidence: spin.'
    """
    if not verdicts:
        return "The case has no requirements."
    groups: dict[Status, list[str]] = {}
    for verdict in verdicts:
        groups.setdefault(verdict.status, []).append(verdict.requirement)
    if list(groups) == [Status.MET]:
        if len(verdicts) == 1:
            return "The requirement is met with 95 % confidence."
        return f"Each requirement is met with 95 % confidence{_together(verdicts)}."
    return " ".join(text.format(", ".join(groups[status])) for status, text in _HEADLINES.items() if status in groups)


def _together(verdicts):
    """Whether requirements that are met one by one are met at once, with 95 % confidence for that."""
    known = [verdict.is_met_together for verdict in verdicts]
    if None in known:
        return "; whether all are met at once was not computed"
    if all(known):
        return ", and so are all at once"
    names = ", ".join(verdict.requirement for verdict in verdicts if not verdict.is_met_together)
    return f"; that all are met at once is not shown with 95 % (more runs for {names} can show it)"


@dataclasses.dataclass(frozen=True)
class AnyViolation:
    """The probability that any requirement is violated, as it is told: never below that of one of them.

    Attributes
    ----------
    row : Estimate
        The estimate of the event, or what it was combined to.
    remark : str
        Where it is not the estimate of the event itself; empty otherwise.
    """

    row: Estimate
    remark: str = ""


def any_violation(result: StudyResult) -> AnyViolation | None:
    """The probability that any requirement is violated; None where it was not estimated.

    Parameters
    ----------
    result : StudyResult

    Returns
    -------
    told : AnyViolation or None
        Where the estimate is below that of a requirement, the estimates are combined: the violation of the requirement
        is part of the event, so that its lower bound holds for both, and the larger upper bound holds too.
    """
    best = {name: best_estimate(rows) for name, rows in result.rows_by_requirement().items()}
    row = best.pop(SYSTEM, None)
    own = None if row is None else row.interval
    if row is None or own is None:
        return None
    parts = {name: one.interval for name, one in best.items() if one is not None and one.interval is not None}
    name, largest = max(parts.items(), key=lambda item: item[1].probability, default=("", own))
    if largest.probability <= own.probability:
        return AnyViolation(row)
    told = Interval(largest.probability, max(largest.lower, own.lower), max(largest.upper, own.upper))
    apart = "" if own.overlaps(largest) else " Their intervals do not overlap: one of the two has missed violations."
    return AnyViolation(
        dataclasses.replace(row, probability=told.probability, lower95=told.lower, upper95=told.upper),
        f"{SYSTEM}: its own estimate, {probability_text(own.probability)} ({interval_text(own.lower, own.upper)}), is "
        f"below that of {name}, which is part of it. The two were combined: {probability_text(told.probability)} "
        f"({interval_text(told.lower, told.upper)}).{apart}",
    )


def _why_unknown(rows):
    """What kept a requirement from an interval that a verdict may rest on."""
    found = [row for row in rows if row.method in DECIDING_METHODS]
    texts = [
        f"{row.method} gave no probability"
        if row.upper95 is None
        else f"{row.method} did not converge ({interval_text(row.lower95, row.upper95)})"
        for row in found
    ]
    why = " and ".join(texts) or f"Only {' or '.join(DECIDING_METHODS)} can decide, and neither was run"
    advice = " or ".join(method for method in DECIDING_METHODS if estimate_by(method, rows) is None)
    return f"{why}: nothing can be said." + (f" Run {advice}." if advice else "")


class Effect(enum.Enum):
    """What tightening a tolerance does to a probability, as far as the runs tell; the value is said in a table."""

    UNKNOWN = ""
    NO_ESTIMATE = "the estimate failed"
    TOO_RARE = "too rare to resolve with these runs"
    NONE_LEFT = "no violation left in these runs"
    NO_DIFFERENCE = "no difference that these runs show"
    LESS = "times less"
    MORE = "times more"


@dataclasses.dataclass(frozen=True)
class Gain:
    """What halving a tolerance does to the probability of a violation.

    Attributes
    ----------
    effect : Effect
    factor : float
        The larger probability over the smaller one, where the effect is LESS or MORE.
    """

    effect: Effect
    factor: float = 1.0

    @property
    def is_resolved(self) -> bool:
        """Whether the estimate of the changed case is worth showing."""
        return self.effect not in (Effect.NO_ESTIMATE, Effect.TOO_RARE)

    def __str__(self) -> str:
        if self.effect not in (Effect.LESS, Effect.MORE):
            return self.effect.value
        return f"{self.factor:.2g} {self.effect.value}" if self.factor < 100.0 else f"more than 100 {self.effect.value}"


def compute_gain(now: Estimate | None, then: HalvedTolerance) -> Gain:
    """How much less probable a violation becomes.

    Parameters
    ----------
    now : Estimate or None
        The estimate that the requirement is judged by.
    then : HalvedTolerance
        The estimate of the changed case.

    Returns
    -------
    gain : Gain
        Not resolved where the runs of the changed case saw no violation, or did not converge to fewer violations, and
        their interval reaches further up than the present one: the lack of runs, not the change, has made it so wide.

    Examples
    --------
    >>> from satsep_ot.studies.telling.results import Estimate, HalvedTolerance
    >>> from satsep_ot.studies.telling.verdicts import compute_gain
    >>> from satsep_ot.studies.telling.words import StudyMethod
    >>> now = Estimate("spin", StudyMethod.ACTIVE_SUBSPACE, 5e-6, 4e-6, 6e-6, converged=True)
    >>> print(compute_gain(now, HalvedTolerance("mass", 0.5, 1e-6, 0.9e-6, 1.1e-6, converged=True)))
    5 times less
    >>> print(compute_gain(now, HalvedTolerance("mass", 0.5, 0.0, 0.0, 4e-3)))
    too rare to resolve with these runs
    """
    after = then.interval
    if after is None:
        return Gain(Effect.NO_ESTIMATE)
    before = None if now is None else now.interval
    if before is None:
        return Gain(Effect.UNKNOWN)
    fewer = after.probability == 0.0 or (not then.converged and after.probability < before.probability)
    if fewer and after.upper > before.upper:
        return Gain(Effect.TOO_RARE)
    if before.probability == 0.0:
        return Gain(Effect.UNKNOWN)
    if after.probability == 0.0:
        return Gain(Effect.NONE_LEFT)
    if after.overlaps(before):
        return Gain(Effect.NO_DIFFERENCE)
    ratio = before.probability / after.probability
    return Gain(Effect.LESS, ratio) if ratio > 1.0 else Gain(Effect.MORE, 1.0 / ratio)
