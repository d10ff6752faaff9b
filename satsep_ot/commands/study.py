"""`satsep-ot study`."""

import argparse
from pathlib import Path

from satsep_ot.commands import options as types
from satsep_ot.commands.printing import console, fail, progress
from satsep_ot.studies.telling.words import DEFAULT_METHODS, StudyMethod

NAME = "study"
SUMMARY = "estimate the probability of violating each requirement, by several methods"
EXAMPLES = (
    "  satsep-ot study\n"
    "  satsep-ot study mine.toml --output results --seed 7\n"
    "  satsep-ot study mine.toml --output results --seed 7 --resume     after an interruption\n"
    "  satsep-ot study mine.toml --methods ActiveSubspace MonteCarlo"
)
METHODS = tuple(method.value for method in StudyMethod)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    types.add_case(parser)
    parser.add_argument(
        "--output", type=Path, default=Path("satsep-study"), metavar="DIR",
        help="where to write (default: satsep-study)",
    )  # fmt: skip
    types.add_directory_options(parser)
    parser.add_argument(
        "--seed", type=types.seed, default=0, metavar="N", help="seed of the random generator (default: 0)"
    )
    parser.add_argument(
        "--methods", nargs="+", choices=METHODS, default=[*DEFAULT_METHODS], metavar="METHOD",
        help=f"which methods to run (default: all but PaperChain): {', '.join(METHODS)}",
    )  # fmt: skip
    parser.add_argument(
        "--runs", type=types.positive, default=500_000, metavar="N",
        help="runs of the Monte Carlo sample, which all requirements share (default: 500000)",
    )  # fmt: skip
    types.add_worker_options(
        parser, "make the Monte Carlo sample in N processes of this machine (default: threads of one)"
    )
    parser.add_argument(
        "--mixed-processors", action="store_true",
        help="accept workers with other processors or versions: the last digits may differ, which the report says",
    )  # fmt: skip
    parser.add_argument(
        "--tolerances", type=types.count, default=2, metavar="N",
        help="for each requirement, halve the scatter of the N strongest tolerances to see what that buys (default: 2)",
    )  # fmt: skip
    parser.add_argument(
        "--precision", type=types.precision, default=0.05, metavar="X",
        help="coefficient of variation at which ActiveSubspace ends, from 0.01 to 0.5 (default: 0.05, a 95 %% interval "
        "of +-10 %% or less); half of it takes up to four times as many runs",
    )  # fmt: skip
    parser.add_argument(
        "--fail-unless-met", action="store_true",
        help="exit with 3 unless every requirement is met with 95 %% confidence",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print what is in results.json instead of tables")


def run(options: argparse.Namespace) -> int | None:
    """Run the study, and print what it found."""
    from satsep_ot.model.case import load_uncertain_case

    # A case that cannot be used is refused before the study's libraries are loaded.
    case = load_uncertain_case(options.case)
    from satsep_ot.methods.common.standard_space import StandardSpace
    from satsep_ot.model.separation_problem import SeparationProblem
    from satsep_ot.studies.separation_study import SeparationStudy
    from satsep_ot.studies.telling.tables import print_study
    from satsep_ot.studies.telling.verdicts import Status, judge_all

    problem = SeparationProblem(case)
    try:
        StandardSpace(problem.getDistribution())
    except ValueError as error:
        return fail(f"{case.name}: {error}", 2)
    study = SeparationStudy(
        problem,
        options.methods,
        options.seed,
        options.runs,
        toleranceSize=options.tolerances,
        targetCoefficientOfVariation=options.precision,
    )
    with types.executor(options) as executor:
        study.setExecutor(executor, options.mixed_processors)
        # A directory that cannot be written to is refused before the work, not after it.
        study.setDirectory(options.output, options.resume, options.overwrite, options.typed)
        for path in study.getChangedFiles():
            fail(f"{path} is not as it was written; what is in it is made again", 0)
        try:
            with progress() as show:
                study.setProgressCallback(show)
                study.run()
                show("figures and report", 0.95)
                paths = study.save()
                show("done", 1.0)
        finally:
            study.close()
    result = study.getResult()
    if options.json:
        print((options.output / "results.json").read_text(encoding="utf-8"), end="")
    else:
        print_study(console(), result)
        # Not through the console, which would fold a long path.
        print(f"\nwritten to {paths[-1].parent}: open {paths[-1]} in a browser")
    if options.fail_unless_met and any(verdict.status is not Status.MET for verdict in judge_all(result)):
        return fail("not every requirement is met with 95 % confidence", 3)
    return None


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    return finished_steps(options.output)


def finished_steps(directory: Path) -> str:
    """What an interrupted command leaves in its directory."""
    if not (directory / "origin.json").exists():
        return "nothing was written"
    return f"what was finished is kept in {directory}: the same command with --resume continues from there"
