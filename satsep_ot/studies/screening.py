"""Which requirements the Monte Carlo sample of a study decides, so that nothing else is estimated on them."""

from collections.abc import Sequence

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.model.requirement import Requirement
from satsep_ot.studies.telling.words import probability_text

# A requirement is decided by the sample where its upper bound is below the allowed probability by this factor.
_MARGIN = 10.0


def screened(requirements: Sequence[Requirement], violations: dict[str, int], size: int) -> dict[str, str]:
    """The requirements that a sample shows to be met by far, each with the reason in words.

    Parameters
    ----------
    requirements : sequence of :class:`satsep_ot.model.requirement.Requirement`
        Those without an allowed probability are never decided.
    violations : dict of str to int
        Runs of the sample that violate each requirement.
    size : int
        Runs of the sample.

    Returns
    -------
    reasons : dict of str to str

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.screening import screened
    >>> spin = [entry for entry in load_case("reference").requirements if entry.name == "spin"]
    >>> screened(spin, {"spin": 0}, 500_000)["spin"].partition(":")[0]
    'at most 6e-6 with 95 % confidence, less than a tenth of the allowed 5e-3, which decides it'
    >>> screened(spin, {"spin": 3500}, 500_000)
    {}
    """
    reasons = {}
    for entry in requirements:
        allowed = entry.allowed_probability
        _, upper = clopperPearson(violations[entry.name], size)
        if allowed is not None and _MARGIN * upper <= allowed:
            reasons[entry.name] = (
                f"at most {probability_text(upper, 2)} with 95 % confidence, less than a tenth of the allowed "
                f"{probability_text(allowed)}, which decides it: no other method was run"
            )
    return reasons
