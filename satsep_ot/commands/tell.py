"""`satsep-ot tell`."""

import argparse
from pathlib import Path

from satsep_ot.commands.ask import add_state, left_behind

NAME = "tell"
SUMMARY = "take the outputs of heavy runs that were asked for"
EXAMPLES = "  satsep-ot tell state outputs.csv"
__all__ = ["EXAMPLES", "NAME", "SUMMARY", "add_arguments", "left_behind", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    add_state(parser)
    parser.add_argument(
        "outputs", type=Path, metavar="OUTPUTS.csv",
        help="a row for each run of the block, with the name of the run and the outputs that were asked for",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int | None:
    """Take the outputs."""
    from satsep_ot.methods.reliability.run_files import RunFiles
    from satsep_ot.studies.heavy_runs import load_question, telling_errors

    with telling_errors():
        _, study = load_question(options.state)
        kept = RunFiles(options.state).tell(study, options.outputs)
    print(f"taken, and kept as {kept}; `satsep-ot ask {options.state}` has what is next")
    return None
