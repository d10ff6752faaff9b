"""Which characters a name may have, and what a terminal is shown of any text."""

import unicodedata

# Invisible, but part of words and of emoji: joiners, and the marks between texts of two directions.
_PART_OF_WORDS = "\u200c\u200d\u200e\u200f"


def is_printable(text: str) -> bool:
    """Whether a text is one line without control characters, in any script.

    Examples
    --------
    >>> from satsep_ot.model.printable import is_printable
    >>> is_printable("$5 % \U0001f680"), is_printable("two\\nlines"), is_printable("\\x1b[2J")
    (True, False, False)
    """
    # Control, format, half of a surrogate pair, ends of lines and of paragraphs.
    return all(
        character in _PART_OF_WORDS or unicodedata.category(character) not in ("Cc", "Cf", "Cs", "Zl", "Zp")
        for character in text
    )


def printable(text: str) -> str:
    """A text as a terminal may show it: each control character but the end of a line is replaced.

    Examples
    --------
    >>> from satsep_ot.model.printable import printable
    >>> print(printable("four\\x1b[2J springs"))
    four\ufffd[2J springs
    """
    return "".join(character if character == "\n" or is_printable(character) else "\ufffd" for character in text)
