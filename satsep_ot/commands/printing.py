"""What the commands print with: errors, the console, progress. Only what is called loads a library."""

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from satsep_ot.model.text import printable

COMPILING = "compiling the simulator, which the first run of all does once ..."
NOT_COMPILED = "NUMBA_DISABLE_JIT is set: the simulator runs as plain Python, thousands of times slower ..."


def fail(message: object, code: int) -> int:
    """Print one line on stderr, and give the exit code back."""
    print(f"satsep-ot: {printable(str(message))}", file=sys.stderr)
    return code


# Exit code of a command that waits for heavy runs.
RUNS_NEEDED = 4


def report_status(is_ok: bool, sentence: str) -> int:
    """The exit code of a nominal run, with a line on stderr where it failed."""
    return 0 if is_ok else fail(f"the nominal separation cannot be simulated: {sentence}", 1)


def console() -> Any:
    """A :class:`rich.console.Console` on stdout."""
    from rich.console import Console

    # Off a terminal (a file, a pipe) nothing is to be folded at an arbitrary 80 columns.
    return Console(highlight=False, emoji=False, width=None if sys.stdout.isatty() else 160)


@contextmanager
def say_if_compiling(seconds: float = 2.0) -> Iterator[None]:
    """Say after some seconds why it takes so long: the first run of all compiles, or nothing is compiled."""
    reason = COMPILING if os.environ.get("NUMBA_DISABLE_JIT", "0") == "0" else NOT_COMPILED
    timer = threading.Timer(seconds, lambda: print(reason, file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def progress() -> Iterator[Callable[[str, float], None]]:
    """A function that shows what is being done and which share of all is done: a bar, or lines off a terminal."""
    if not sys.stderr.isatty():
        shown: list[str] = []

        def show_line(label: str, share: float) -> None:
            if shown[-1:] != [label]:
                shown.append(label)
                print(f"{100.0 * share:3.0f} %  {label}", file=sys.stderr, flush=True)

        yield show_line
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("remaining"), TimeRemainingColumn(),
        TextColumn("{task.description}", markup=False),
    )  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda label, share: bar.update(task, description=label, completed=share)
