"""The words of a study, each stated once: its methods, what they miss, and probabilities.

This module loads no library, so that the command's help can name the methods.
"""

import enum
import math


class StudyMethod(enum.StrEnum):
    """The methods of a study; the value is the name that tables, files and the command line show.

    Examples
    --------
    >>> from satsep_ot.studies.telling.words import StudyMethod
    >>> print(StudyMethod.MONTE_CARLO)
    MonteCarlo
    """

    ACTIVE_SUBSPACE = "ActiveSubspace"
    FORM = "FORM"
    SORM = "SORM"
    SUBSET_SAMPLING = "SubsetSampling"
    MONTE_CARLO = "MonteCarlo"
    PAPER_CHAIN = "PaperChain"


# PaperChain runs where it is asked for: to see what a surrogate's own probability is worth.
DEFAULT_METHODS = tuple(method for method in StudyMethod if method != StudyMethod.PAPER_CHAIN)
# The methods whose intervals a verdict rests on, the first one before the other: settled before a study, not by the
# widths of the intervals, since the narrower of two may hold the truth less often than each does.
DECIDING_METHODS = (StudyMethod.ACTIVE_SUBSPACE, StudyMethod.MONTE_CARLO)
# The methods that replace the limit state by a plane or a paraboloid, and have no interval.
DESIGN_POINT_METHODS = (StudyMethod.FORM, StudyMethod.SORM)

METHOD_DESCRIPTIONS = {
    StudyMethod.ACTIVE_SUBSPACE: "a surrogate that learns from every run says where violations are likely, and "
    "weighted runs of the simulator there give an unbiased estimate",
    StudyMethod.FORM: "a plane through the most likely violation stands for the limit",
    StudyMethod.SORM: "a paraboloid through the most likely violation stands for the limit",
    StudyMethod.SUBSET_SAMPLING: "subset simulation: runs approach the limit in levels of growing rarity",
    StudyMethod.MONTE_CARLO: "crude Monte Carlo: the share of violations in one sample, which all requirements share",
    StudyMethod.PAPER_CHAIN: "the probability of a quartic polynomial on the active subspace of 100 gradients, which "
    "no run of the simulator corrects",
}
# What limits the trust in each method's numbers, where the report lists it.
METHOD_LIMITS = {
    StudyMethod.FORM: "FORM has no interval: it does not tell how far the limit is from the plane.",
    StudyMethod.SORM: "SORM has no interval: it does not tell how far the limit is from the paraboloid.",
    StudyMethod.SUBSET_SAMPLING: "The interval of SubsetSampling takes an upper bound of the error, as if its levels "
    "were fully dependent: no verdict rests on it.",
    StudyMethod.MONTE_CARLO: "The interval of MonteCarlo is the interval of Clopper and Pearson, which holds the truth "
    "in at least 95 % of samples. Where no violation is seen it is one-sided; this lowers the 95 % to 93.8 % at worst, "
    "near three expected violations.",
    StudyMethod.PAPER_CHAIN: "PaperChain has no interval: it is the probability of a polynomial, which may be off by "
    "any factor where the gradients saw no violation.",
}
# Why a plane or a paraboloid at one design point misses violations: of the norm of so many smooth quantities, of the
# smallest of several quantities, and of any requirement.
NORM_BLIND_SPOTS = {
    1: "there are two design points of opposite sign, and the search ends in one",
    2: "the limit state is a circle around the mean, which no tangent plane or paraboloid follows",
    3: "the limit state is a sphere around the mean, which no tangent plane or paraboloid follows",
}
TWO_SIDED_BLIND_SPOT = "each of the two ends of the range has a design point, and the search ends in one"
MINIMUM_BLIND_SPOT = "every point of the envelope has a design point of its own, and the search ends in one"
SYSTEM_BLIND_SPOT = "every requirement has design points of its own, and the search ends in one"


def probability_text(probability: float | None, figures: int = 3) -> str:
    """A probability in few characters.

    Parameters
    ----------
    probability : float or None
        None stands for a probability that is not known.
    figures : int
        Significant figures.

    Returns
    -------
    text : str

    Examples
    --------
    >>> from satsep_ot.studies.telling.words import probability_text
    >>> probability_text(2.654e-4), probability_text(0.005), probability_text(0.0123), probability_text(0.0)
    ('2.65e-4', '5e-3', '0.0123', '0')
    >>> probability_text(2.654e-4, 2), probability_text(None)
    ('2.7e-4', 'none')
    """
    if probability is None:
        return "none"
    if probability >= 0.01 or probability <= 0.0 or not math.isfinite(probability):
        return f"{probability:.{figures}g}"
    mantissa, exponent = f"{probability:.{figures - 1}e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def interval_text(lower: float | None, upper: float | None) -> str:
    """Both ends of an interval of probabilities.

    Examples
    --------
    >>> from satsep_ot.studies.telling.words import interval_text
    >>> interval_text(1e-3, 2e-3), interval_text(None, None)
    ('1e-3 to 2e-3', 'none')
    """
    return "none" if upper is None else f"{probability_text(lower)} to {probability_text(upper)}"


def in_words(probability: float) -> str:
    """A probability as a number of separations.

    Examples
    --------
    >>> from satsep_ot.studies.telling.words import in_words
    >>> in_words(2.654e-4), in_words(0.3), in_words(0.0)
    ('about 1 separation in 3,800', '30 % of the separations', 'no violation in these runs')
    """
    if probability <= 0.0:
        return "no violation in these runs"
    if probability > 0.1:
        return f"{100.0 * probability:.3g} % of the separations"
    return f"about 1 separation in {float(f'{1.0 / probability:.2g}'):,.0f}"


def fewer_than(bound: float) -> str:
    """An upper bound of a probability as a number of separations, on the safe side.

    Examples
    --------
    >>> from satsep_ot.studies.telling.words import fewer_than
    >>> fewer_than(5.99e-6), fewer_than(0.5)
    ('fewer than 1 in 160,000', 'fewer than 50 % of the separations')
    """
    if bound > 0.1:
        return f"fewer than {100.0 * bound:.3g} % of the separations"
    power = 10.0 ** (math.floor(math.log10(1.0 / bound)) - 1)
    return f"fewer than 1 in {power * math.floor(1.0 / bound / power):,.0f}"


def number_text(value: float, figures: int = 4) -> str:
    """A number that is no probability, in the format of all of them: powers of ten as 2.4e-5.

    Examples
    --------
    >>> from satsep_ot.studies.telling.words import number_text
    >>> number_text(0.59845), number_text(2.4e-5), number_text(123456.0), number_text(0.0)
    ('0.5985', '2.4e-5', '123456', '0')
    """
    if value == 0.0 or not math.isfinite(value) or 1e-3 <= abs(value) < 10.0**figures:
        return f"{value:.{figures}g}"
    if 10.0**figures <= abs(value) < 1e7:
        return f"{value:.0f}"
    mantissa, exponent = f"{value:.{figures - 1}e}".split("e")
    return f"{float(mantissa):g}e{int(exponent)}"


def with_space(unit: str) -> str:
    """A unit as it stands behind a number: nothing for a pure number.

    Examples
    --------
    >>> from satsep_ot.studies.telling.words import with_space
    >>> "0.03" + with_space("1"), "5" + with_space("kg")
    ('0.03', '5 kg')
    """
    return "" if unit == "1" else f" {unit}"


def capitalized(text: str) -> str:
    """The text with a capital first letter; the others stay as they are.

    Examples
    --------
    >>> from satsep_ot.studies.telling.words import capitalized
    >>> capitalized("the intervals of FORM")
    'The intervals of FORM'
    """
    return text[:1].upper() + text[1:]
