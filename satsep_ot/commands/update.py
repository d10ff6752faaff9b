"""`satsep-ot update`."""

import argparse
import json
from pathlib import Path

from satsep_ot.commands import options as types
from satsep_ot.commands.printing import console, fail, progress

NAME = "update"
SUMMARY = "learn from ground tests: the probabilities before and after them, and what more tests would buy"
EXAMPLES = (
    "  satsep-ot update mine.toml tests.csv\n"
    "  satsep-ot update mine.toml tests.csv --json\n"
    "  satsep-ot update mine.toml tests.csv --study results     and a section in the report of a study"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    types.add_case(parser, required=True)
    parser.add_argument(
        "tests", type=Path, metavar="TESTS.csv",
        help="the columns test, quantity, value, sigma, and one for each key of the case in which a test differed",
    )  # fmt: skip
    parser.add_argument(
        "--next", metavar="TEST", help="the test that further tests would repeat (default: the last one of the file)"
    )
    parser.add_argument(
        "--size", type=types.draws, default=1000, metavar="N",
        help="values of what is not known at which the probabilities are computed (default: 1000)",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=types.seed, default=0, metavar="N", help="seed of the random generator (default: 0)"
    )
    parser.add_argument(
        "--study", type=Path, metavar="DIR", help="results of a study: a section is added to its report"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(options: argparse.Namespace) -> int | None:
    """Update, and print what was found."""
    from satsep_ot.methods.common.storage import writeWhole
    from satsep_ot.model.case import load_uncertain_case
    from satsep_ot.studies.separation_update import SeparationUpdate
    from satsep_ot.studies.telling.document import ReportError
    from satsep_ot.studies.telling.plain_data import to_plain
    from satsep_ot.studies.telling.report import UPDATE, write_report
    from satsep_ot.studies.telling.update_tables import print_update

    if options.study is not None and not (options.study / "results.json").exists():
        return fail(f"{options.study} holds no results.json; give what `satsep-ot study --output` wrote", 2)
    update = SeparationUpdate(load_uncertain_case(options.case), options.tests, options.size, options.seed)
    if options.next is not None:
        update.setNextTest(options.next)
    with progress() as show:
        update.setProgressCallback(show)
        update.run()
    result = update.getResult()
    text = json.dumps(to_plain(result), indent=2, allow_nan=False)
    if options.json:
        print(text)
    else:
        print_update(console(), result)
    if options.study is not None:
        writeWhole(options.study / UPDATE, lambda stream: stream.write(text.encode()))
        try:
            path = write_report(options.study)
        except ReportError as error:
            return fail(error, 2)
        if not options.json:
            print(f"\n{path} written: open it in a browser")
    return None


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    return "nothing was written"
