"""`satsep-ot check`."""

import argparse
import json

from satsep_ot.commands.options import add_case
from satsep_ot.commands.printing import console, report_status, say_if_compiling

NAME = "check"
SUMMARY = "print a case as it is understood, the range of each uncertain input, and the nominal run"
EXAMPLES = (
    "  satsep-ot check mine.toml\n"
    "  satsep-ot check                  the reference case of the package\n"
    "  satsep-ot check mine.toml --json"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    add_case(parser)
    parser.add_argument("--json", action="store_true", help="print JSON: inputs, warnings, nominal run, requirements")


def run(options: argparse.Namespace) -> int | None:
    """Print the case."""
    from satsep_ot.commands.case_tables import print_case
    from satsep_ot.model.case import load_case
    from satsep_ot.model.check_document import check_case, check_document

    case = load_case(options.case)
    with say_if_compiling():
        checked = check_case(case)
    if options.json:
        print(json.dumps(check_document(checked), indent=2, allow_nan=False))
    else:
        print_case(console(), checked, options.case)
    return report_status(checked.is_ok, checked.message)


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    return "nothing was written"
