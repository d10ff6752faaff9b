"""`satsep-ot study`."""

import argparse
import os
import sys
from pathlib import Path
from typing import Any

from satsep_ot.commands import options as types
from satsep_ot.commands.printing import RUNS_NEEDED, console, fail, progress
from satsep_ot.studies.telling.tolerance_curves import Curves
from satsep_ot.studies.telling.words import DEFAULT_METHODS, StudyMethod

NAME = "study"
SUMMARY = "estimate the probability of violating each requirement, by several methods"
EXAMPLES = (
    "  satsep-ot study\n"
    "  satsep-ot study mine.toml --output results --seed 7\n"
    "  satsep-ot study mine.toml --output results --seed 7 --resume     after an interruption\n"
    "  satsep-ot study mine.toml --methods ActiveSubspace MonteCarlo\n"
    "  satsep-ot study mine.toml --heavy runs --block 50                by the runs of another simulator, step by step"
)
# What --quick sets where it is not given.
QUICK: dict[str, Any] = {
    "runs": 100_000,
    "methods": [StudyMethod.ACTIVE_SUBSPACE.value, StudyMethod.MONTE_CARLO.value],
    "tolerances": 0,
    "gradients": 0,
}
_FULL: dict[str, Any] = {
    "runs": 500_000,
    "methods": [*DEFAULT_METHODS],
    "tolerances": 2,
    "gradients": 300,
    "precision": None,
}
# A study with a smaller sample is done before other processes have begun.
_WORTH_PROCESSES = 50_000
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
        "--methods", nargs="+", choices=METHODS, metavar="METHOD",
        help=f"which methods to run (default: all but PaperChain): {', '.join(METHODS)}",
    )  # fmt: skip
    parser.add_argument(
        "--runs", type=types.positive, metavar="N",
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
        "--tolerances", type=types.count, metavar="N",
        help="for each requirement, halve the scatter of the N strongest tolerances to see what that buys (default: 2)",
    )  # fmt: skip
    parser.add_argument(
        "--gradients", type=types.gradients, metavar="N",
        help="gradients for the active subspaces and surrogates in the report; 0 for none (default: 300)",
    )  # fmt: skip
    parser.add_argument(
        "--groups", nargs="+", default=[], metavar="GROUP",
        help="tolerances to halve and to vary in size; an unknown name lists them (default: the strongest)",
    )  # fmt: skip
    parser.add_argument(
        "--curves", type=Curves, choices=list(Curves), default=Curves.NEEDED, metavar="WHICH",
        help="the probability against the size of the strongest tolerances by new runs: needed (default), for "
        "requirements that are not known to be met; all; or none",
    )  # fmt: skip
    parser.add_argument(
        "--precision", type=types.precision, metavar="X",
        help="coefficient of variation at which ActiveSubspace ends, from 0.01 to 0.5: 0.05 is a 95 %% interval of "
        "+-10 %%, half of it takes up to four times as many runs (default: as soon as each requirement is decided, and "
        "the probability known to +-10 %%)",
    )  # fmt: skip
    parser.add_argument(
        "--no-screening", action="store_true",
        help="run all methods also on requirements that the sample shows to be met by a factor of ten",
    )  # fmt: skip
    parser.add_argument(
        "--quick", action="store_true",
        help=f"probabilities and verdicts only, in some seconds: {_options_text(QUICK)}",
    )  # fmt: skip
    parser.add_argument(
        "--heavy", type=Path, metavar="DIR",
        help="take the probabilities from another simulator: write DIR/block-N-inputs.csv, end with 4 where "
        "DIR/block-N-outputs.csv is not there yet, and go on when called again",
    )  # fmt: skip
    types.add_block(parser)
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
    from satsep_ot.methods.reliability.run_files import RunsNeeded
    from satsep_ot.model.separation_problem import SeparationProblem
    from satsep_ot.studies.drivers import check_tolerances
    from satsep_ot.studies.separation_study import SeparationStudy
    from satsep_ot.studies.telling.tables import print_study
    from satsep_ot.studies.telling.verdicts import Status, judge_all

    left_out: dict[str, Any] = {"methods": None, "tolerances": None, "groups": []}
    if options.heavy is not None and any(getattr(options, name) != none for name, none in left_out.items()):
        return fail("--heavy takes no --methods, --tolerances or --groups; leave them out", 2)
    sizes: dict[str, Any] = _FULL | (QUICK if options.quick else {})
    sizes |= {name: value for name in sizes if (value := getattr(options, name)) is not None}
    problem = SeparationProblem(case)
    try:
        StandardSpace(problem.getDistribution())
    except ValueError as error:
        return fail(f"{case.name}: {error}", 2)
    try:
        check_tolerances(case, options.groups)
    except ValueError as error:
        return fail(f"{case.name}: {error}", 2)
    study = SeparationStudy(
        problem,
        sizes["methods"],
        options.seed,
        sizes["runs"],
        sizes["gradients"],
        sizes["tolerances"],
        sizes["precision"],
        not options.no_screening,
        options.curves,
        options.groups,
    )
    if options.heavy is not None:
        study.setHeavyRuns(options.heavy, options.block, options.non_finite)
    if sizes["runs"] >= _WORTH_PROCESSES:
        study.setProcessNumber(options.workers or len(os.sched_getaffinity(0)))
    # With heavy runs the same command goes on each time.
    resumes = options.resume or (options.heavy is not None and not options.overwrite)
    with types.executor(options) as executor:
        study.setExecutor(executor, options.mixed_processors)
        # A directory that cannot be written to is refused before the work, not after it.
        study.setDirectory(options.output, resumes, options.overwrite, options.typed)
        for path in study.getChangedFiles():
            fail(f"{path} is not as it was written; what is in it is made again", 0)
        try:
            with progress() as show:
                study.setProgressCallback(show)
                study.run()
            result = study.getResult()
            if not options.json:
                # The answer does not wait for the pictures.
                print_study(console(), result)
                sys.stdout.flush()
            with progress() as show:
                study.setProgressCallback(show)
                paths = study.save()
                show("done", 1.0)
        except RunsNeeded as needed:
            columns = ", ".join(needed.columns)
            return fail(f"{needed}, with the columns {columns}, and give the same command again", RUNS_NEEDED)
        finally:
            study.close()
    if options.json:
        print((options.output / "results.json").read_text(encoding="utf-8"), end="")
    else:
        # Not through the console, which would fold a long path.
        print(f"\nwritten to {paths[-1].parent}: open {paths[-1]} in a browser")
    if options.fail_unless_met and any(verdict.status is not Status.MET for verdict in judge_all(result)):
        return fail("not every requirement is met with 95 % confidence", 3)
    return None


def _options_text(sizes):
    texts = ((name, " ".join(value) if isinstance(value, list) else f"{value}") for name, value in sizes.items())
    return " ".join(f"--{name} {text}" for name, text in texts)


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    return finished_steps(options.output)


def finished_steps(directory: Path) -> str:
    """What an interrupted command leaves in its directory."""
    if not (directory / "origin.json").exists():
        return "nothing was written"
    return f"what was finished is kept in {directory}: the same command with --resume continues from there"
