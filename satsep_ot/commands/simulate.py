"""`satsep-ot simulate`."""

import argparse
import json

from satsep_ot.commands import options as types
from satsep_ot.commands.printing import console, report_status, say_if_compiling

NAME = "simulate"
SUMMARY = "simulate the nominal separation of a case"
EXAMPLES = "  satsep-ot simulate\n  satsep-ot simulate mine.toml --json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    types.add_case(parser)
    parser.add_argument("--json", action="store_true", help="print JSON, in full precision")
    parser.add_argument(
        "--at", nargs="+", type=types.time, default=[], metavar="T",
        help="print the motion at these times too [s after the start], beside that at the last release",
    )  # fmt: skip
    parser.add_argument(
        "--tolerance", type=types.tolerance, default=1e-8, metavar="X",
        help="relative accuracy of the run (default: 1e-8)",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int | None:
    """Simulate, and print the run."""
    from satsep_ot.commands.case_tables import print_run
    from satsep_ot.dynamics.separation import Status
    from satsep_ot.model.case import load_case
    from satsep_ot.model.run_document import run_document

    case = load_case(options.case)
    with say_if_compiling():
        document = run_document(case, options.at, options.tolerance)
    if options.json:
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        print_run(console(), case, document)
    return report_status(document["status"] == Status.OK.name, document["message"])


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    return "nothing was written"
