"""`satsep-ot compare`."""

import argparse
import json
from pathlib import Path

from satsep_ot.commands import options as types
from satsep_ot.commands.printing import console, fail, progress

NAME = "compare"
SUMMARY = "compare designs: probabilities side by side, what differs, and which difference explains most"
EXAMPLES = (
    "  satsep-ot compare four_springs.toml six_springs.toml\n"
    "  satsep-ot compare reference one_spring_failed --runs 50000 --output compared\n"
    "  satsep-ot compare results-A results-B          two finished studies"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    parser.add_argument(
        "designs", nargs="+", metavar="DESIGN", help=f"{types.CASE_HELP}, or the directory of a finished study"
    )
    parser.add_argument(
        "--runs", type=types.positive, default=100_000, metavar="N",
        help="runs of each design with common random numbers (default: 100000)",
    )  # fmt: skip
    parser.add_argument(
        "--seed", type=types.seed, default=0, metavar="N", help="seed of the random generator (default: 0)"
    )
    parser.add_argument(
        "--output", type=Path, metavar="DIR", help="also write comparison.json and the page comparison.html there"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(options: argparse.Namespace) -> int | None:
    """Compare the designs."""
    from satsep_ot.methods.common.storage import writeWhole
    from satsep_ot.studies.design_comparison import Design, compare_designs
    from satsep_ot.studies.telling.design_comparison import change_lines, comparison_page, comparison_table
    from satsep_ot.studies.telling.plain_data import to_plain
    from satsep_ot.studies.telling.tables import escape

    try:
        with progress() as show:
            found = compare_designs([Design.load(one) for one in options.designs], options.runs, options.seed, show)
    except ValueError as error:
        return fail(error, 2)
    text = json.dumps(to_plain(found), indent=2, allow_nan=False) + "\n"
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
        page = comparison_page(found)
        writeWhole(options.output / "comparison.json", lambda stream: stream.write(text.encode()))
        writeWhole(options.output / "comparison.html", lambda stream: stream.write(page.encode()))
    if options.json:
        print(text, end="")
        return None
    screen = console()
    screen.print(comparison_table(found))
    for line in change_lines(found):
        screen.print(escape(line))
    if options.output is not None:
        print(f"\nwritten to {options.output}: open {options.output / 'comparison.html'} in a browser")
    return None


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    return "nothing was written"
