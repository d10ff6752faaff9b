"""What a misspelt word was meant to be."""

import difflib
import re
from collections.abc import Iterable

# What people write, without case and separators, for a word that is spelt otherwise: another one would be nearer.
_SYNONYMS = dict.fromkeys(("3sigma", "3s", "sigma3"), "three_sigma") | dict.fromkeys(
    ("rate", "totalrate", "angularrate", "bodyrate", "tumble", "tumblerate", "tumbling", "tumblingrate"), "tip_off_rate"
)


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """The end of a sentence that names the nearest of the known words, or nothing.

    Examples
    --------
    >>> from satsep_ot.model.spelling import did_you_mean
    >>> did_you_mean("mas", ["mass", "inertia"])
    "; did you mean 'mass'?"
    """
    lower = {word.lower(): word for word in known}
    synonym = _SYNONYMS.get(re.sub(r"[\W_]", "", given.lower()))
    nearest = [synonym] if synonym in lower else difflib.get_close_matches(given.lower(), lower, n=1)
    return f"; did you mean '{lower[nearest[0]]}'?" if nearest else ""
