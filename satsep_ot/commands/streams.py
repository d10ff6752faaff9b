"""The standard streams of a command: closed ones, readers that leave, terminals without the characters printed.

What a command prints changes neither what it does nor its exit code.
"""

import io
import os
import sys
from typing import Any, TextIO


class _Stream(io.FileIO):
    """A standard stream: from the first failure on nothing is written, and only a loss of output is an error."""

    def __init__(self, descriptor: int) -> None:
        super().__init__(descriptor, "w", closefd=False)

    def write(self, data: Any) -> int:
        try:
            return super().write(data)
        except OSError as error:
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, self.fileno())
            os.close(nothing)
            # A reader that has left (head, less, a script) wants no more; messages are not what a command is for.
            if isinstance(error, BrokenPipeError) or self.fileno() == 2:
                return len(data)
            error.filename = "standard output"
            raise


def open_standard_streams() -> None:
    """Make standard output and error of this process such that printing fails for no reason but a full disk.

    A stream that was closed when the process began is the null device: the next file that is opened would otherwise
    take its number, and what is printed with it. A reader that leaves is told nothing more. A character that the
    encoding of the stream lacks is replaced.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            # The lowest free number is this one.
            os.open(os.devnull, os.O_RDWR)
    sys.stdout = _text_stream(sys.stdout, 1)
    sys.stderr = _text_stream(sys.stderr, 2)


def _text_stream(stream: TextIO | None, descriptor):
    if stream is not None:
        stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(_Stream(descriptor)),
        encoding="utf-8" if stream is None else stream.encoding,
        errors="replace",
        line_buffering=descriptor == 2 or os.isatty(descriptor),
    )
