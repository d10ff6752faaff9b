"""Options that several commands have, and the values that they take."""

import argparse
import importlib.util
import re
from collections.abc import Callable, Iterator
from concurrent.futures import Executor
from contextlib import contextmanager

from satsep_ot.model.text import parsed_number

CASE_HELP = "a case file, or the name of a case in the package"


def positive(text: str) -> int:
    """A number of runs."""
    return _whole(text, 1, 10**9)


def count(text: str) -> int:
    """A number of things that may be none."""
    return _whole(text, 0, 100)


def gradients(text: str) -> int:
    """A number of gradients."""
    return _whole(text, 0, 100_000)


def repetitions(text: str) -> int:
    """A number of repetitions."""
    return _whole(text, 1, 100_000)


def draws(text: str) -> int:
    """A number of draws from which quantiles are taken."""
    return _whole(text, 100, 100_000)


def seed(text: str) -> int:
    """A seed of the random generator."""
    return _whole(text, 0, 2**31 - 1)


def time(text: str) -> float:
    """A time after the start [s]."""
    return _between(text, 0.0, 1000.0, "time in s")


def precision(text: str) -> float:
    """A coefficient of variation."""
    return _between(text, 0.01, 0.5, "coefficient of variation")


def tolerance(text: str) -> float:
    """A relative accuracy."""
    return _between(text, 1e-13, 1e-2, "tolerance")


def _workers(text):
    return _whole(text, 1, 1024)


def _between(text, least, most, what):
    value = parsed_number(text)
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text} is no {what}: it must be a number between {least:g} and {most:g}")
    return value


def _whole(text, least, most):
    if not re.fullmatch("[0-9]{1,20}", text) or not least <= int(text) <= most:
        raise argparse.ArgumentTypeError(f"{text} must be a whole number between {least} and {most}")
    return int(text)


def add_case(parser: argparse.ArgumentParser, required: bool = False) -> None:
    """The case that a command is about; the reference case unless it is required."""
    if required:
        parser.add_argument("case", metavar="CASE.toml", help=CASE_HELP)
    else:
        text = f"{CASE_HELP} (default: reference)"
        parser.add_argument("case", nargs="?", default="reference", metavar="CASE.toml", help=text)


def add_block(parser: argparse.ArgumentParser) -> None:
    """How many heavy runs are made at once, and what one without a value is."""
    parser.add_argument(
        "--block", type=positive, metavar="N",
        help="ask for at least N heavy runs at once where their number is free (default: as few as are worth it)",
    )  # fmt: skip
    parser.add_argument(
        "--non-finite", choices=("raise", "failure", "safe"), default="raise", metavar="WHAT",
        help="what a heavy run without a value is: failure, safe, or raise, by which it is refused (default: raise)",
    )  # fmt: skip


def add_directory_options(parser: argparse.ArgumentParser) -> None:
    """What to do with results that are there already."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--resume", action="store_true",
        help="continue from the finished steps in DIR, to the numbers of an uninterrupted run; without any, begin",
    )  # fmt: skip
    group.add_argument(
        "--overwrite", action="store_true", help="remove the results in DIR, of this or another case, and begin anew"
    )


def add_worker_options(parser: argparse.ArgumentParser, what: str) -> None:
    """What makes the runs."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--workers", type=_workers, metavar="N", help=f"{what}; the numbers are the same")
    group.add_argument(
        "--dask", metavar="ADDRESS",
        help="the same on the Dask cluster of the scheduler at ADDRESS, such as tcp://192.168.0.1:8786, whose workers "
        "need the processor and the versions of this machine",
    )  # fmt: skip


@contextmanager
def executor(options: argparse.Namespace) -> Iterator[Executor | Callable[[], Executor] | None]:
    """What makes the runs: processes, which a callable starts, a Dask cluster, or (None) this process."""
    if options.dask is None:
        from satsep_ot.methods.parallel.executors import processes

        yield None if options.workers is None else processes(options.workers)
        return
    if importlib.util.find_spec("distributed") is None:
        raise ConnectionError("--dask needs the package distributed, which satsep-ot[distributed] installs")
    from satsep_ot.methods.parallel.executors import daskExecutor

    with daskExecutor(options.dask) as cluster:
        yield cluster
