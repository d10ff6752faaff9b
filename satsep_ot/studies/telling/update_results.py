"""What an update by ground tests found, as data; and the sentences on it."""

import math
from dataclasses import dataclass

from satsep_ot.methods.updating.misfit import Misfit
from satsep_ot.methods.updating.next_experiments import Outlook

LEVELS = (0.01, 0.05, 0.25, 0.5, 0.75, 0.95, 0.99)


@dataclass(frozen=True)
class LearntParameter:
    """What the tests say of one parameter that tests and flight share.

    Attributes
    ----------
    name : str
        Of an uncertain input, or of an entry with `.each`.
    kind : str
        "value", "mean" or "sigma".
    unit : str
    before, before_sigma, after, after_sigma : float
        Mean and standard deviation before and after the tests.
    lower95, upper95 : float
        Credible interval after the tests.
    """

    name: str
    kind: str
    unit: str
    before: float
    before_sigma: float
    after: float
    after_sigma: float
    lower95: float
    upper95: float


@dataclass(frozen=True)
class ProbabilityRange:
    """A probability as a distribution: how likely it is, by what is not known, to be that large.

    Attributes
    ----------
    mean : float
        The probability that a decision may use: of what scatters and what is not known together.
    mean_error : float
        Standard error of the mean, by the number of draws.
    quantiles : tuple of float
        At `LEVELS`.
    lower95, upper95 : float
        One-sided credible bounds at 95 %.
    """

    mean: float
    mean_error: float
    quantiles: tuple[float, ...]
    lower95: float
    upper95: float


@dataclass(frozen=True)
class UpdatedProbability:
    """The probability of one violation before and after the tests.

    Attributes
    ----------
    requirement, limit : str
    allowed : float or None
    before, after : ProbabilityRange
    """

    requirement: str
    limit: str
    allowed: float | None
    before: ProbabilityRange
    after: ProbabilityRange

    @property
    def verdict(self) -> str:
        """What the tests decide, in a few words."""
        if self.allowed is None:
            return "no probability is allowed"
        if self.after.upper95 <= self.allowed:
            return "met with 95 % credibility"
        if self.after.lower95 > self.allowed:
            return "not met with 95 % credibility"
        return "undecided"


@dataclass(frozen=True)
class RequirementOutlook:
    """What further tests let expect of one requirement.

    Attributes
    ----------
    requirement : str
    measured : tuple of Outlook
        After so many more tests as the one named.
    measured_needed : int or None
        So many decide in 80 % of the futures; None where none of the numbers tried does.
    counted : tuple of Outlook
        After so many more tests of which only failures are counted, and none is seen.
    counted_needed : int or None
        As above, by the chance that they are free of failures and decide.
    model_free : int or None
        Failure-free tests that show the allowed probability without any model.
    """

    requirement: str
    measured: tuple[Outlook, ...]
    measured_needed: int | None
    counted: tuple[Outlook, ...]
    counted_needed: int | None
    model_free: int | None


@dataclass(frozen=True)
class Sampling:
    """How the posterior was sampled.

    Attributes
    ----------
    method : str
        What the draws of the posterior are of.
    effective_size : float
        So many independent draws would be worth the same.
    rhat : float or None
        Of chains: near 1 where they agree.
    converged : bool
    runs, gradients : int
        Of the simulator, in all.
    seconds : float
    """

    method: str
    effective_size: float
    rhat: float | None
    converged: bool
    runs: int
    gradients: int
    seconds: float


@dataclass(frozen=True)
class UpdateResult:
    """What an update found.

    Attributes
    ----------
    case : str
    tests : dict of str to (dict of str to str)
        How each test differed from the case, by key.
    probabilities : tuple of UpdatedProbability
        Of the violation of each requirement, and of any.
    learnt : tuple of LearntParameter
    misfits : tuple of Misfit
        How each quantity and each measurement fits the model.
    outlooks : tuple of RequirementOutlook
    next_test : str
        The test that the outlooks repeat; empty where only inputs were measured.
    sampling : Sampling
    remarks : tuple of str
    """

    case: str
    tests: dict[str, dict[str, str]]
    probabilities: tuple[UpdatedProbability, ...]
    learnt: tuple[LearntParameter, ...]
    misfits: tuple[Misfit, ...]
    outlooks: tuple[RequirementOutlook, ...]
    next_test: str
    sampling: Sampling
    remarks: tuple[str, ...]

    @property
    def contradictions(self) -> tuple[Misfit, ...]:
        """The measurements, and the quantities, that contradict the model."""
        return tuple(row for row in self.misfits if row.contradicts)

    @property
    def headline(self) -> str:
        """The answer in one sentence."""
        count = f"{len(self.tests)} test{'s' if len(self.tests) > 1 else ''}"
        if self.contradictions:
            return f"Contradiction between the case and {count}: what is learnt is not to be trusted."
        if not self.sampling.converged:
            return f"The posterior from {count} could not be computed: no number after the tests is to be trusted."
        agreed = f"No contradiction between the case and {count}"
        judged = [row for row in self.probabilities if row.allowed is not None]
        if not judged:
            return f"{agreed}."
        words = ", ".join(f"{row.requirement} {row.verdict}" for row in judged)
        return f"{agreed}; after: {words}."


def misfit_sentence(row: Misfit) -> str:
    """One sentence on a measurement, or on a quantity, that contradicts the model."""
    where = f"test {row.experiment}: {row.quantity}" if row.experiment else f"the mean of {row.quantity} over the tests"
    others = "" if row.fromOthers is None else f", and {row.fromOthers:+.1f} from what the other tests let expect"
    kind = "measurements" if row.experiment else "quantities"
    chance = chance_text(row.probability)
    return (
        f"{where} = {row.value:.6g} lies {row.deviation:+.1f} standard deviations from the {row.predicted:.6g} that "
        f"the case predicts{others}; so much is found among all {kind} of a right model in {chance}"
    )


def shown_value(value: float, sigma: float) -> str:
    """A number with as many decimal places as its standard deviation deserves: two figures of it."""
    if not 0.0 < sigma < math.inf:
        return f"{value:.6g}"
    return f"{value:.{min(max(1 - math.floor(math.log10(sigma)), 0), 12)}f}"


def sampling_sentence(result: UpdateResult) -> str:
    """How the numbers came about, in one sentence."""
    one = result.sampling
    rhat = "" if one.rhat is None else f", R-hat {one.rhat:.3f}"
    return (
        f"The posterior by {one.method}, worth {one.effective_size:.0f} independent draws{rhat}; {one.runs:,} runs "
        f"and {one.gradients:,} gradients of the simulator in {one.seconds:.0f} s; probabilities have a numerical "
        "error of some 10 %"
    )


def chance_text(probability: float) -> str:
    """A share of made-up campaigns in words."""
    return "less than 0.1 % of campaigns" if probability < 1e-3 else f"{100.0 * probability:.1f} % of campaigns"


def outlook_sentences(row: RequirementOutlook, next_test: str) -> list[str]:
    """What further tests would buy for one requirement, a sentence each."""
    found = []
    if row.measured:
        first, last = row.measured[0], row.measured[-1]
        found.append(
            f"{last.number} more tests like {next_test} are expected to bring the 95 % bound from {first.bound:.2e} to "
            f"{last.bound:.2e}, and its distance from the 5 % bound from {first.width:.2e} to {last.width:.2e}"
        )
    if row.model_free is None:
        return found
    if row.measured and row.measured[0].decided == 1.0:
        found.append("the tests made so far decide")
    else:
        if row.measured:
            found.append(_needed(row.measured, row.measured_needed, f"more tests like {next_test} decide"))
        if row.counted:
            found.append(
                _needed(row.counted, row.counted_needed, "tests without a failure, and nothing measured, decide")
            )
    found.append(f"without any model it takes {row.model_free} tests without a failure to show the allowed probability")
    return found


def _needed(outlooks, needed, what):
    if needed is not None:
        return f"{needed} {what} in 80 % of the futures"
    best = max(outlooks, key=lambda outlook: outlook.decided or 0.0)
    share = 100.0 * (best.decided or 0.0)
    return f"up to {outlooks[-1].number} {what} in at most {share:.0f} % of the futures"
