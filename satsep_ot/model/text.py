"""Texts of users: the characters of a name, what a terminal is shown of any text, numbers, and the files of texts."""

import io
import math
import os
import re
import stat
import unicodedata

# Invisible, but part of words and of emoji: joiners, and the marks between texts of two directions.
_PART_OF_WORDS = "\u200c\u200d\u200e\u200f"
_NUMBER = re.compile(r"[ \t]*[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?[ \t]*")
_KINDS = {
    stat.S_IFDIR: "a directory", stat.S_IFIFO: "a pipe", stat.S_IFCHR: "a device", stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}  # fmt: skip


def is_printable(text: str) -> bool:
    """Whether a text is one line without control characters, in any script.

    Examples
    --------
    >>> from satsep_ot.model.text import is_printable
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
    >>> from satsep_ot.model.text import printable
    >>> print(printable("four\\x1b[2J springs"))
    four\ufffd[2J springs
    """
    return "".join(character if character == "\n" or is_printable(character) else "\ufffd" for character in text)


def parsed_number(text: str) -> float:
    """The number that a text is, in digits, with a point and an exponent; NaN where it is none.

    Examples
    --------
    >>> from satsep_ot.model.text import parsed_number
    >>> parsed_number(" -1.5e3"), parsed_number("1_0"), parsed_number("inf")
    (-1500.0, nan, nan)
    """
    # float() takes underscores between digits and the digits of any script.
    return float(text) if _NUMBER.fullmatch(text) else math.nan


def read_text_file(path: str | os.PathLike, longest: int, newline: str | None = None) -> str:
    """The text of a file in UTF-8, without a byte order mark.

    Parameters
    ----------
    path : str or path
    longest : int
        So many characters are allowed.
    newline : str, optional
        As for `open`.

    Returns
    -------
    text : str

    Raises
    ------
    FileNotFoundError
        There is no such file.
    ValueError
        With the path and the reason in one sentence: it is no regular file (a pipe would be waited for, a device may
        never end), it cannot be read, it is too long, or it is not UTF-8.

    Examples
    --------
    >>> from satsep_ot.model.text import read_text_file
    >>> try:
    ...     read_text_file("/dev/zero", 100)
    ... except ValueError as error:
    ...     print(error)
    /dev/zero: it is a device; give a regular file
    """
    try:
        with _open_regular(path) as binary, io.TextIOWrapper(binary, "utf-8-sig", newline=newline) as stream:
            text = stream.read(longest + 1)
    except FileNotFoundError:
        raise
    except UnicodeDecodeError as error:
        raise ValueError(f"{path}: the file is not UTF-8 text") from error
    except OSError as error:
        raise ValueError(f"{path}: the file cannot be read ({error.strerror})") from error
    if len(text) > longest:
        raise ValueError(f"{path}: the file has more than {longest} characters; give a shorter one")
    return text


def _open_regular(path):
    if "\0" in os.fspath(path):
        raise ValueError(f"{path}: the file cannot be read (embedded null byte)")
    kind = stat.S_IFMT(os.stat(path).st_mode)
    if kind != stat.S_IFREG:
        raise ValueError(f"{path}: it is {_KINDS.get(kind, 'of another kind')}; give a regular file")
    # Without waiting, should it be another file by now.
    return os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY), "rb")
