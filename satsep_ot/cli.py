"""The command `satsep-ot`: its parser, its exit codes, and one line for each error. The commands are in `commands`."""

import argparse
import shlex
import sys

from satsep_ot import __version__
from satsep_ot.commands import ask, benchmark, check, compare, new, report, simulate, study, tell, update
from satsep_ot.commands.printing import fail
from satsep_ot.commands.streams import open_standard_streams
from satsep_ot.interruption import INTERRUPTED, supervise

COMMANDS = (new, check, simulate, study, compare, update, ask, tell, benchmark, report)
_EXIT_CODES = (
    "exit codes: 0 success, 1 a separation could not be simulated,\n"
    "  2 bad input, or a file that cannot be read or written,\n"
    "  3 a requirement is not met (study with --fail-unless-met),\n"
    "  4 heavy runs are needed (ask, study with --heavy), 130 interrupted"
)


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit code.

    Parameters
    ----------
    arguments : list of str, optional
        Default: those of the process.

    Returns
    -------
    code : int
        0 success, 1 a separation could not be simulated, 2 bad input, or a file that cannot be read or written, 3 a
        requirement is not met where that was asked for, 4 heavy runs are needed, 130 interrupted.

    Examples
    --------
    >>> from satsep_ot.cli import main
    >>> main(["new", "."])
    2
    """
    if arguments is None:
        open_standard_streams()
    options = make_parser().parse_args(arguments)
    options.typed = shlex.join(["satsep-ot", *(sys.argv[1:] if arguments is None else arguments)])
    if arguments is None:
        # This process is ours.
        supervise(lambda: options.command.left_behind(options))
    try:
        code = options.command.run(options) or 0
        # What a full disk does not take is told here, not after the end.
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        return fail(f"interrupted; {options.command.left_behind(options)}", INTERRUPTED)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return fail(f"{where}{error.strerror or error}", 2)
    except (ValueError, RuntimeError) as error:
        # Our own errors say in one sentence what is wrong; anything else is a defect and keeps its traceback.
        from satsep_ot.methods.parallel.chunks import ChunkError
        from satsep_ot.methods.parallel.processor import MixedProcessorsError
        from satsep_ot.model.case import CaseError
        from satsep_ot.model.separation_function import SeparationError
        from satsep_ot.studies.results_directory import DirectoryError
        from satsep_ot.studies.step_processes import StepError

        if isinstance(error, (CaseError, DirectoryError)):
            return fail(error, 2)
        if isinstance(error, MixedProcessorsError):
            return fail(f"{error} (study --mixed-processors)", 2)
        if isinstance(error, (ChunkError, StepError)):
            return fail(f"{error}; {options.command.left_behind(options)}", 1)
        if isinstance(error, SeparationError):
            return fail(error, 1)
        raise


def make_parser() -> argparse.ArgumentParser:
    """The parser of all commands; `command` of what it parses is the module of one."""
    parser = argparse.ArgumentParser(
        prog="satsep-ot",
        description="Reliability of the separation of a small satellite from its launch vehicle.",
        epilog="examples:\n"
        "  satsep-ot new mine.toml            write an annotated case to start from\n"
        "  satsep-ot check mine.toml          see what the program understands\n"
        "  satsep-ot simulate mine.toml       one nominal run\n"
        "  satsep-ot study mine.toml          probabilities, and a report that one reads\n"
        "  satsep-ot study                    the same for the reference case of the package\n"
        "  satsep-ot compare a.toml b.toml    two designs side by side\n\n" + _EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"satsep-ot {__version__}")
    added = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        one = added.add_parser(
            command.NAME,
            help=command.SUMMARY,
            description=command.SUMMARY[0].upper() + command.SUMMARY[1:] + ".",
            epilog=f"examples:\n{command.EXAMPLES}\n\n{_EXIT_CODES}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        command.add_arguments(one)
        one.set_defaults(command=command)
    return parser
