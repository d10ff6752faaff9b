"""`satsep-ot ask`."""

import argparse
from pathlib import Path
from typing import Any

from satsep_ot.commands import options as types
from satsep_ot.commands.printing import RUNS_NEEDED, fail

NAME = "ask"
SUMMARY = "ask for the next heavy runs of a probability, or print it where none are needed any more"
EXAMPLES = (
    '  satsep-ot ask state --case mine.toml --requirement "lateral rate" --block 50     begins\n'
    "  satsep-ot ask state block.csv          the runs that are needed next, also in a file of that name\n"
    "  satsep-ot tell state outputs.csv       what your program has made of them\n"
    "  satsep-ot ask other --model beam.py    a Python file that defines algorithm, an ActiveSubspaceReliability"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    add_state(parser)
    parser.add_argument("block_file", nargs="?", type=Path, metavar="BLOCK.csv", help="write the inputs there, too")
    group = parser.add_mutually_exclusive_group()
    group.add_argument("--case", metavar="CASE.toml", help=f"begin with {types.CASE_HELP}")
    group.add_argument("--model", type=Path, metavar="MODEL.py", help="begin with a Python file, which is executed")
    parser.add_argument(
        "--requirement", metavar="NAME", help='a requirement of the case (default: "any requirement" of them)'
    )
    parser.add_argument(
        "--seed", type=types.seed, default=0, metavar="N", help="seed of the random generator (default: 0)"
    )
    parser.add_argument(
        "--precision", type=types.precision, default=0.1, metavar="X",
        help="coefficient of variation at which the runs end (default: 0.1)",
    )  # fmt: skip
    parser.add_argument(
        "--most-runs", type=types.positive, default=5000, metavar="N",
        help="number of heavy runs at which they end in any case (default: 5000)",
    )  # fmt: skip
    parser.add_argument(
        "--alone", action="store_true", help="without this package's simulator, which else saves heavy runs of a case"
    )
    types.add_block(parser)


def add_state(parser: argparse.ArgumentParser) -> None:
    """The directory that a question is kept in."""
    parser.add_argument(
        "state", type=Path, metavar="STATE", help="directory that keeps what was asked and told, of its own"
    )


def run(options: argparse.Namespace) -> int | None:
    """Begin where a case or a model is given; write the next block, or print the result."""
    if options.case is not None or options.model is not None:
        begin(options)
    return print_next(options.state, options.block_file)


def begin(options: argparse.Namespace) -> None:
    """Keep a question in its directory."""
    from satsep_ot.model.case import SYSTEM, load_uncertain_case
    from satsep_ot.model.separation_problem import SeparationProblem
    from satsep_ot.studies.heavy_runs import HeavyQuestion, begin_question, python_algorithm, telling_errors

    name = options.requirement or SYSTEM if options.model is None else str(options.model.resolve())
    question = HeavyQuestion(
        name,
        options.seed,
        options.precision,
        options.most_runs,
        options.block,
        options.non_finite,
        options.alone,
    )
    case = None
    with telling_errors():
        if options.model is None:
            case = load_uncertain_case(options.case)
            # A question that cannot be asked is refused before it is kept.
            question.algorithm(SeparationProblem(case))
        else:
            python_algorithm(options.model)
        begin_question(options.state, question, case)


def print_next(state: Path, block_file: Path | None = None) -> int | None:
    """Print what is needed next, or the result."""
    from satsep_ot.methods.common.storage import writeWhole
    from satsep_ot.methods.reliability.run_files import RunFiles, RunsNeeded
    from satsep_ot.studies.heavy_runs import load_question, telling_errors

    with telling_errors():
        question, study = load_question(state)
        try:
            result = RunFiles(state).advance(study)
        except RunsNeeded as needed:
            path = needed.inputs if block_file is None else block_file
            if block_file is not None:
                content = needed.inputs.read_bytes()
                writeWhole(block_file, lambda stream: stream.write(content))
            print(
                f"{needed.size} runs are needed: their inputs are in {path}; give a CSV file with the columns "
                f"{', '.join(needed.columns)} to `satsep-ot tell {state}`"
            )
            return RUNS_NEEDED
    print_result(question.requirement, result)
    return None if result.getConverged() else fail(f"the estimate has not converged: {result.getReason()}", 0)


def print_result(name: str, result: Any) -> None:
    """Print a probability with its interval."""
    interval = result.getConfidenceInterval(0.95)
    lower, upper = interval.getLowerBound()[0], interval.getUpperBound()[0]
    print(
        f"{name}: probability {result.getProbabilityEstimate():.3e}, 95 % interval {lower:.3e} to {upper:.3e}, "
        f"{result.getEvaluationNumber()} heavy runs\n{result.getReason()}"
    )


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    return f"all that was told is kept in {options.state}"
