"""`satsep-ot report`."""

import argparse
from pathlib import Path

from satsep_ot.commands.printing import fail

NAME = "report"
SUMMARY = "write report.html again from the results of a study, without running anything"
EXAMPLES = "  satsep-ot report satsep-study"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    parser.add_argument("directory", type=Path, metavar="RESULTS_DIR", help="what `satsep-ot study --output` wrote")


def run(options: argparse.Namespace) -> int | None:
    """Write the report."""
    from satsep_ot.studies.telling.document import ReportError
    from satsep_ot.studies.telling.report import write_report

    try:
        path = write_report(options.directory)
    except ReportError as error:
        return fail(error, 2)
    print(f"{path} written: open it in a browser")
    return None


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    return f"the results in {options.directory} are kept"
