"""The command `satsep-ot`: argument parsing and printing only."""

import argparse
import json
import os
import shlex
import sys
import threading
from contextlib import contextmanager
from pathlib import Path

from satsep_ot import __version__
from satsep_ot.interruption import INTERRUPTED, supervise

METHODS = ("ActiveSubspace", "FORM", "SORM", "SubsetSampling", "MonteCarlo")
_EXIT_CODES = (
    "exit codes: 0 success, 1 a separation could not be simulated, 2 bad input,\n"
    "  3 a requirement is not met (study with --fail-unless-met), 130 interrupted"
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
        0 success, 1 a separation could not be simulated, 2 bad input, 3 a requirement is not met where that was asked
        for, 130 interrupted.

    Examples
    --------
    >>> from satsep_ot.cli import main
    >>> main(["new", "."])
    2
    """
    options = _parser().parse_args(arguments)
    options.typed = shlex.join(["satsep-ot", *(sys.argv[1:] if arguments is None else arguments)])
    if arguments is None:
        # This process is ours.
        supervise(lambda: _kept(options))
    try:
        return options.command(options) or 0
    except KeyboardInterrupt:
        return _fail(f"interrupted; {_kept(options)}", INTERRUPTED)
    except BrokenPipeError:
        # The reader of our output (head, less) has left: nothing remains to be said.
        sys.stderr.close()
        return 0
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _fail(f"{where}{error.strerror or error}", 2)
    except (ValueError, RuntimeError) as error:
        # Our own errors say in one sentence what is wrong; anything else is a defect and keeps its traceback.
        from satsep_ot.methods.parallel.scheduler import ChunkError
        from satsep_ot.model.case import CaseError
        from satsep_ot.model.separation_function import SeparationError
        from satsep_ot.studies.results_directory import DirectoryError

        if isinstance(error, (CaseError, DirectoryError)):
            return _fail(error, 2)
        if isinstance(error, ChunkError):
            return _fail(f"{error}; {_kept(options)}", 1)
        if isinstance(error, SeparationError):
            return _fail(error, 1)
        raise


def _kept(options):
    """What an interrupted command leaves, in words; only the disk is asked."""
    if options.command is _new:
        return f"{options.file} is {'there' if os.path.exists(options.file) else 'not written'}"
    if options.command is _report:
        return f"the results in {options.directory} are kept"
    if options.command not in (_study, _benchmark) or not os.path.exists(options.output / "origin.json"):
        return "nothing was written"
    table = "; benchmark.md has a table of all but the latest" if options.command is _benchmark else ""
    return f"what was finished is kept in {options.output}: the same command with --resume continues from there{table}"


def _parser():
    parser = argparse.ArgumentParser(
        prog="satsep-ot",
        description="Reliability of the separation of a small satellite from its launch vehicle.",
        epilog="examples:\n"
        "  satsep-ot new mine.toml            write an annotated case to start from\n"
        "  satsep-ot check mine.toml          see what the program understands\n"
        "  satsep-ot simulate mine.toml       one nominal run\n"
        "  satsep-ot study mine.toml          probabilities, and a report that one reads\n"
        "  satsep-ot study                    the same for the reference case of the package\n\n" + _EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"satsep-ot {__version__}")
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)

    def command(name, function, summary, examples):
        added = commands.add_parser(
            name,
            help=summary,
            description=summary[0].upper() + summary[1:] + ".",
            epilog=f"examples:\n{examples}\n\n{_EXIT_CODES}",
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        added.set_defaults(command=function)
        return added

    case_help = "a case file, or the name of a case in the package (default: reference)"
    new = command(
        "new",
        _new,
        "write an annotated case file to start from",
        "  satsep-ot new mine.toml\n  satsep-ot new mine.toml --like cubesat",
    )
    new.add_argument("file", type=Path, metavar="FILE", help="the file to write; an existing one is not overwritten")
    new.add_argument(
        "--like", default="reference", metavar="NAME",
        help="the case of the package to start from (default: reference, which explains every key)",
    )  # fmt: skip

    check = command(
        "check",
        _check,
        "print a case as it is understood, the range of each uncertain input, and the nominal run",
        "  satsep-ot check mine.toml\n  satsep-ot check reference\n  satsep-ot check mine.toml --json",
    )
    check.add_argument("case", metavar="CASE.toml", help=case_help.removesuffix(" (default: reference)"))
    check.add_argument("--json", action="store_true", help="print JSON: inputs, warnings, nominal run, requirements")

    run = command(
        "simulate",
        _simulate,
        "simulate the nominal separation of a case",
        "  satsep-ot simulate\n  satsep-ot simulate mine.toml --json",
    )
    run.add_argument("case", nargs="?", default="reference", metavar="CASE.toml", help=case_help)
    run.add_argument("--json", action="store_true", help="print JSON, in full precision")
    run.add_argument(
        "--at", nargs="+", type=_time, default=[], metavar="T",
        help="print the motion at these times too [s after the start], beside that at the last release",
    )  # fmt: skip
    run.add_argument(
        "--tolerance", type=_tolerance, default=1e-8, metavar="X", help="relative accuracy of the run (default: 1e-8)"
    )

    study = command(
        "study",
        _study,
        "estimate the probability of violating each requirement, by several methods",
        "  satsep-ot study\n"
        "  satsep-ot study mine.toml --output results --seed 7\n"
        "  satsep-ot study mine.toml --output results --seed 7 --resume     after an interruption\n"
        "  satsep-ot study mine.toml --methods ActiveSubspace MonteCarlo",
    )
    study.add_argument("case", nargs="?", default="reference", metavar="CASE.toml", help=case_help)
    study.add_argument(
        "--output",
        type=Path,
        default=Path("satsep-study"),
        metavar="DIR",
        help="where to write (default: satsep-study)",
    )
    _add_directory_options(study)
    study.add_argument("--seed", type=_seed, default=0, metavar="N", help="seed of the random generator (default: 0)")
    study.add_argument(
        "--methods", nargs="+", choices=METHODS, default=list(METHODS), metavar="METHOD",
        help=f"which methods to run (default: all): {', '.join(METHODS)}",
    )  # fmt: skip
    study.add_argument(
        "--runs", type=_positive, default=500_000, metavar="N",
        help="runs of the Monte Carlo sample, which all requirements share (default: 500000)",
    )  # fmt: skip
    _add_worker_options(study, "make the Monte Carlo sample in N processes of this machine (default: threads of one)")
    study.add_argument(
        "--tolerances", type=_count, default=2, metavar="N",
        help="of each requirement, halve the N strongest tolerances to see what that buys (default: 2)",
    )  # fmt: skip
    study.add_argument(
        "--precision", type=_precision, default=0.05, metavar="X",
        help="coefficient of variation at which ActiveSubspace ends, from 0.01 to 0.5 (default: 0.05, a 95 %% interval "
        "of +-10 %% or less); half of it takes up to four times as many runs",
    )  # fmt: skip
    study.add_argument(
        "--fail-unless-met", action="store_true",
        help="exit with 3 unless every requirement is met with 95 %% confidence",
    )  # fmt: skip
    study.add_argument("--json", action="store_true", help="print what is in results.json instead of tables")

    benchmark = command(
        "benchmark",
        _benchmark,
        "compare reliability methods where the probability is known",
        "  satsep-ot benchmark --problems P1 RP8 --methods ActiveSubspace SubsetSampling --repetitions 20\n"
        "  satsep-ot benchmark --problems RP54 RP54-rotated RP54-rescaled P1-d20 --methods ActiveSubspace FORM\n"
        "  satsep-ot benchmark --problems reference --output results\n\n"
        "Every repetition is kept in DIR/runs.jsonl and counts from then on; benchmark.md shows what there is so far.\n"
        "After an interruption the same command with --resume continues, or adds problems, methods and repetitions.",
    )
    benchmark.add_argument(
        "--problems", nargs="+", default=["published", "reference"], metavar="PROBLEM",
        help="names of problems, published (all of these), reference (all requirements of the reference case) or "
        "variants (published ones rotated, rescaled, with other numbers of inputs); an unknown name lists them "
        "(default: published reference, which takes hours with all methods)",
    )  # fmt: skip
    benchmark.add_argument(
        "--methods", nargs="+", metavar="METHOD", help="which methods; an unknown name lists them (default: all)"
    )
    benchmark.add_argument(
        "--repetitions", type=_repetitions, default=10, metavar="N", help="of each method and problem (default: 10)"
    )
    benchmark.add_argument("--seed", type=_seed, default=0, metavar="N", help="of the first repetition (default: 0)")
    benchmark.add_argument(
        "--output", type=Path, default=Path("satsep-benchmark"), metavar="DIR",
        help="where to write (default: satsep-benchmark)",
    )  # fmt: skip
    _add_worker_options(benchmark, "make N repetitions at a time, in processes of this machine (default: one)")
    _add_directory_options(benchmark)
    benchmark.add_argument("--json", action="store_true", help="print JSON instead of a table")

    report = command(
        "report",
        _report,
        "write report.html again from the results of a study, without running anything",
        "  satsep-ot report satsep-study",
    )
    report.add_argument("directory", type=Path, metavar="RESULTS_DIR", help="what `satsep-ot study --output` wrote")
    return parser


def _add_directory_options(command):
    group = command.add_mutually_exclusive_group()
    group.add_argument(
        "--resume", action="store_true",
        help="continue from what is finished in DIR, to the result of an uninterrupted run; begin where nothing is",
    )  # fmt: skip
    group.add_argument(
        "--overwrite", action="store_true", help="remove the results in DIR, of this or another case, and begin anew"
    )


def _add_worker_options(command, what):
    group = command.add_mutually_exclusive_group()
    group.add_argument(
        "--workers", type=_workers_number, metavar="N", help=f"{what}; the numbers are the same"
    )  # fmt: skip
    group.add_argument(
        "--dask", metavar="ADDRESS",
        help="the same on the Dask cluster of the scheduler at ADDRESS, such as tcp://192.168.0.1:8786",
    )  # fmt: skip


def _positive(text):
    return _whole(text, 1, 10**9)


def _workers_number(text):
    return _whole(text, 1, 1024)


def _repetitions(text):
    return _whole(text, 1, 100_000)


def _count(text):
    return _whole(text, 0, 100)


def _seed(text):
    return _whole(text, 0, 2**31 - 1)


def _time(text):
    return _number_between(text, 0.0, 1000.0, "time in s")


def _precision(text):
    return _number_between(text, 0.01, 0.5, "coefficient of variation")


def _tolerance(text):
    return _number_between(text, 1e-13, 1e-2, "tolerance")


def _number_between(text, least, most, what):
    try:
        value = float(text)
    except ValueError:
        value = least - 1.0
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f"{text} is not a {what}, a number from {least:g} to {most:g}")
    return value


def _whole(text, least, most):
    if not text.isdecimal() or not least <= int(text) <= most:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number from {least} to {most}")
    return int(text)


def _fail(message, code):
    print(f"satsep-ot: {message}", file=sys.stderr)
    return code


def _new(options):
    import re

    from satsep_ot.model.case import load_case, shipped_cases
    from satsep_ot.model.inputs import did_you_mean

    known = shipped_cases()
    if options.like not in known:
        hint = did_you_mean(options.like, known)
        return _fail(f"{options.like} is no case of the package; there are {', '.join(known)}{hint}", 2)
    text = load_case(options.like).text
    try:
        # "x" leaves no moment in which a file that appears meanwhile could be lost.
        with options.file.open("x", encoding="utf-8") as stream:
            name = json.dumps(options.file.stem)
            stream.write(re.sub(r"^name = .*$", lambda _: f"name = {name}", text, count=1, flags=re.MULTILINE))
    except FileExistsError:
        return _fail(f"{options.file} exists already and is not overwritten; give another name", 2)
    print(f"{options.file} written: edit it, then run\n  satsep-ot check {options.file}")
    return 0


def _check(options):
    from satsep_ot.dynamics.separation import Status
    from satsep_ot.model.case import load_case
    from satsep_ot.model.inputs import umbilical_springs
    from satsep_ot.model.plausibility import implausibilities, requirement_scatter

    case = load_case(options.case)
    outcome, quantities = _nominal_run(case)
    warnings = implausibilities(case)
    scatter = requirement_scatter(case)
    if options.json:
        print(json.dumps(_check_document(case, quantities, scatter, warnings), indent=2, allow_nan=False))
        return _report_status(Status(int(outcome.status[0])).name, outcome.explain(0))
    console = _console()
    separation = case.separation
    console.print(f"[bold]{_plain(case.name)}[/bold]  {_plain(case.description)}")
    console.print(_bodies(separation))
    console.print(_springs(separation))
    console.print()
    if umbilical_springs(separation):
        console.print(_umbilicals(separation))
        console.print()
    for line in _conditions(separation):
        console.print(line)
    console.print(_inputs(case.inputs))
    console.print()
    for first, second, coefficient in _correlated(case):
        console.print(f"{_plain(first)} and {_plain(second)} are correlated: {coefficient:g}")
    console.print(_quantities(quantities))
    if scatter:
        console.print(_requirements(scatter))
        console.print()
        runs = f"The nominal run and {scatter[0].runs:,} scattered ones only show" if case.inputs else "This run shows"
        console.print(
            f"{runs} where the limits lie: how likely each requirement is violated, "
            f"`satsep-ot study {_plain(options.case)}` answers."
        )
    for warning in warnings:
        console.print(f"[bold]! implausible[/bold]  {_plain(warning)}")
    return _report_status(Status(int(outcome.status[0])).name, outcome.explain(0))


def _check_document(case, quantities, scatter, warnings):
    """What `check` understood, as plain data; a number that a failed run does not have is null."""
    from satsep_ot.model.inputs import quantile_range

    return {
        "case": case.name,
        "description": case.description,
        "inputs": [
            {
                "name": row.name,
                "unit": row.unit,
                "distribution": str(row.distribution),
                "nominal": row.reference,
                "range": list(quantile_range(row.distribution)),
                "description": row.description,
            }
            for row in case.inputs
        ],
        "correlation": [
            {"inputs": [first, second], "coefficient": coefficient} for first, second, coefficient in _correlated(case)
        ],
        "nominal": {
            name: {"value": value if value == value else None, "unit": unit}
            for name, (value, unit, _) in quantities.items()
        },
        "requirements": [
            {
                "name": row.requirement.name,
                "quantity": row.requirement.quantity,
                "maximum" if row.requirement.is_maximum else "minimum": row.requirement.limit,
                "unit": row.unit,
                "allowed_probability": row.requirement.allowed_probability,
                "met_by_nominal_run": row.requirement.is_met(row.nominal) if row.nominal == row.nominal else None,
                "scattered_runs": {
                    "runs": row.runs,
                    "met": row.met,
                    "smallest": row.smallest if row.runs else None,
                    "largest": row.largest if row.runs else None,
                },
            }
            for row in scatter
        ],
        "warnings": warnings,
    }


def _correlated(case):
    """(name, name, coefficient of the normal copula) of each pair that is correlated."""
    if case.copula is None:
        return
    matrix = case.copula.getParameter()
    names = [row.name for row in case.inputs]
    place = 0
    # The parameter of a NormalCopula is the lower triangle of its matrix, row by row.
    for i in range(1, len(names)):
        for j in range(i):
            if matrix[place]:
                yield names[j], names[i], matrix[place]
            place += 1


def _simulate(options):
    from satsep_ot.dynamics.quantities import quantity_table
    from satsep_ot.model.case import load_case
    from satsep_ot.model.run_document import run_document

    case = load_case(options.case)
    with _patience():
        document = run_document(case, options.at, options.tolerance)
    if options.json:
        print(json.dumps(document, indent=2, allow_nan=False))
    else:
        table = quantity_table(case.separation)
        console = _console()
        console.print(f"[bold]{_plain(case.name)}[/bold]  {_plain(case.description)}")
        console.print(
            _quantities(
                {name: (_or_nan(document["quantities"][name]), q.unit, q.description) for name, q in table.items()}
            )
        )
        for line in _accounts(case.separation, document):
            console.print(line)
        if document["at_last_release"] and options.at:
            console.print(_motions(document))
    return _report_status(document["status"], document["message"])


def _accounts(separation, document):
    """What each spring did, and how well the run keeps energy and angular momentum."""
    from satsep_ot.model.run_document import spring_names

    energy, momentum = document["energy"], document["angular_momentum"]
    for i, (name, time) in enumerate(zip(spring_names(separation), document["release_times"], strict=True)):
        if time is None and document["status"] == "OK":
            yield f"{name} has failed"
        else:
            work = f", work {energy['spring_work'][i]:.6g} J" if energy else ""
            yield f"{name} released at {1e3 * _or_nan(time):.6f} ms{work}"
    if energy and momentum:
        gravity = "" if separation.orbit is None else " (gravity has a small part in both)"
        yield (
            f"Kinetic energy gained {energy['gained']:.9g} J, {energy['error']:.1e} J beside the work of the springs; "
            f"angular momentum changed by {momentum['change']:.1e} N m s{gravity}"
        )


def _or_nan(value):
    return float("nan") if value is None else value


def _motions(document):
    """The vectors of the motion, column by column: the last release, and the times asked for."""
    motions = [document["at_last_release"], *document["at"]]
    titles = ["last release", *(f"{motion['t']:g} s" for motion in document["at"])]
    table = _table("Motion [SI, rad/s]", "", *(f">{title}" for title in titles))
    for name in motions[0]:
        if name != "t":
            table.add_row(name, *(_numbers(motion[name]) for motion in motions))
    return table


def _study(options):
    from satsep_ot.model.case import load_uncertain_case

    # A case that cannot be used is refused before the study's libraries are loaded.
    case = load_uncertain_case(options.case)
    from satsep_ot.methods.common.standard_space import StandardSpace
    from satsep_ot.model.separation_problem import SeparationProblem
    from satsep_ot.studies.separation_study import SeparationStudy

    problem = SeparationProblem(case)
    try:
        StandardSpace(problem.getDistribution())
    except ValueError as error:
        return _fail(f"{case.name}: {error}", 2)
    study = SeparationStudy(
        problem,
        options.methods,
        options.seed,
        options.runs,
        toleranceSize=options.tolerances,
        targetCoefficientOfVariation=options.precision,
    )

    with _executor(options) as executor:
        study.setExecutor(executor)
        # A directory that cannot be written to is refused before the work, not after it.
        study.setDirectory(options.output, options.resume, options.overwrite, options.typed)
        try:
            with _progress() as show:
                study.setProgressCallback(show)
                study.run()
                show("figures and report", 0.95)
                paths = study.save()
                show("done", 1.0)
        finally:
            study.close()
    verdicts = study.getVerdicts()
    if options.json:
        print((options.output / "results.json").read_text(encoding="utf-8"), end="")
    else:
        _print_study(case.name, study, verdicts, paths)
    if options.fail_unless_met and any(verdict.status != "met" for verdict in verdicts):
        return _fail("not every requirement is met with 95 % confidence", 3)
    return 0


@contextmanager
def _executor(options):
    """What makes the runs: processes, a Dask cluster, or (None) this process."""
    if options.dask is None:
        from satsep_ot.methods.parallel.executors import processes

        yield None if options.workers is None else processes(options.workers)
        return
    from importlib.util import find_spec

    if find_spec("distributed") is None:
        raise ConnectionError("--dask needs the package distributed, which satsep-ot[distributed] installs")
    from satsep_ot.methods.parallel.executors import daskExecutor

    with daskExecutor(options.dask) as executor:
        yield executor


def _print_study(name, study, verdicts, paths):
    from satsep_ot.studies.telling.verdicts import NO_ESTIMATE, TOO_RARE, best_row, headline, is_resolved

    console = _console()
    console.print(f"[bold]{_plain(headline(verdicts))}[/bold]")
    for verdict in verdicts:
        console.print(f"  {_plain(verdict.requirement)}: {_plain(verdict.sentence)}")
    console.print()
    console.print(_study_table(name, study.getRows()))
    console.print("[bold]Remarks[/bold]")
    for line in _study_remarks(study.getRows()):
        console.print(line)
    console.print()
    for remark in study.getRemarks():
        console.print(f"[bold]![/bold] {_plain(remark)}")
    for requirement, halved in study.getTolerances().items():
        now = best_row(row for row in study.getRows() if row["requirement"] == requirement)
        for row in halved:
            if row["probability"] is None:
                found = f"{NO_ESTIMATE}: {row['note']}"
            else:
                found = f"{row['probability']:.2e} ({row['lower95']:.2e}..{row['upper95']:.2e})"
                found = (found if is_resolved(now, row) else TOO_RARE) + (
                    "" if row["converged"] else f", not converged: {row['note']}"
                )
            console.print(_plain(f"{requirement} with half the scatter of {row['tolerance']}: {found}"))
    # Not through the console, which would fold a long path.
    print(f"\nwritten to {paths[-1].parent}: open {paths[-1]} in a browser")


def _report(options):
    from satsep_ot.studies.telling.report import ReportError, write_report

    try:
        path = write_report(options.directory)
    except ReportError as error:
        return _fail(error, 2)
    print(f"{path} written: open it in a browser")
    return 0


def _benchmark(options):
    from satsep_ot.methods.comparison.benchmark import ReliabilityBenchmark
    from satsep_ot.studies.method_benchmark import benchmark_tasks, open_benchmark_directory, table_keeper

    try:
        tasks = benchmark_tasks(options.problems)
        benchmark = ReliabilityBenchmark(tasks, options.methods, options.repetitions, options.seed)
    except ValueError as error:
        return _fail(error, 2)
    with _executor(options) as executor:
        benchmark.setExecutor(executor)
        directory = open_benchmark_directory(options.output, options.resume, options.overwrite, options.typed)
        benchmark.setFile(options.output / "runs.jsonl")
        try:
            with _progress() as show:
                keep_table = table_keeper(benchmark, options.output)
                benchmark.setProgressCallback(lambda label, share: (show(label, share), keep_table()))
                benchmark.run()
            _print_benchmark(benchmark.getResult(), options)
        finally:
            directory.close()


def _print_benchmark(result, options):
    from satsep_ot.studies.method_benchmark import save_benchmark

    paths = save_benchmark(result, options.output)
    if options.json:
        print(json.dumps(result.getTable(), indent=2, allow_nan=False))
    else:
        print(result.toText())
        print(f"\nright on all of these: {', '.join(result.getRightMethods()) or 'none'}")
        if any(row.verdict == "open" for row in result.getRows()):
            print("open: the repetitions are too few to call the method right or wrong there")
        print(f"written to {options.output}: {', '.join(path.name for path in paths)}, runs.jsonl")


@contextmanager
def _progress():
    """A function that shows what is being done and which share of all is done: a bar, or lines off a terminal."""
    if not sys.stderr.isatty():
        shown = []

        def show_line(label, share):
            if shown[-1:] != [label]:
                shown.append(label)
                print(f"{100.0 * share:3.0f} %  {label}", file=sys.stderr, flush=True)

        yield show_line
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        Progress,
        TaskProgressColumn,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        BarColumn(), TaskProgressColumn(), TimeElapsedColumn(), TextColumn("remaining"), TimeRemainingColumn(),
        TextColumn("{task.description}"),
    )  # fmt: skip
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=1.0)
        yield lambda label, share: bar.update(task, description=label, completed=share)


def _study_table(name, rows):
    table = _narrow(_table(f"Probability of violating a requirement: {_plain(name)}", "method"))
    for column in ("probability", "95 % interval", "evaluations", "gradients", "seconds"):
        table.add_column(_plain(column), justify="right", no_wrap=True)
    for row in rows:
        if row["method"] == rows[0]["method"]:
            table.add_row(f"[bold]{_plain(row['requirement'])}[/bold]")
        probability, lower = row["probability"], row["lower95"]
        table.add_row(
            row["method"],
            "none" if probability is None else f"{probability:.3e}",
            "none" if lower is None else f"{_in_eight(lower)}..{_in_eight(row['upper95'])}",
            f"{row['evaluations']:,}",
            f"{row['gradients']:,}",
            f"{row['seconds']:.1f}",
        )
    return table


def _in_eight(probability):
    """Three digits, or two where the exponent has three: no line of a table is longer for it."""
    text = f"{probability:.2e}"
    return text if len(text) <= 8 else f"{probability:.1e}"


def _study_remarks(rows):
    """What each row's numbers do not say, a line each, requirement by requirement."""
    for row in rows:
        if row["method"] == rows[0]["method"]:
            yield f"[bold]{_plain(row['requirement'])}[/bold]"
        text = "" if row["converged"] else "[bold]not converged[/bold]: "
        yield f"  {row['method']}: {text}{_plain(row['note'])}"


@contextmanager
def _patience(seconds=2.0):
    """Say why it takes so long where it does: only the first run of all compiles."""
    text = "compiling the simulator, which the first run of all does once ..."
    timer = threading.Timer(seconds, lambda: print(text, file=sys.stderr, flush=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def _nominal_run(case):
    """The outcome of the nominal run, and value, unit and description of each quantity by name."""
    from satsep_ot.dynamics.quantities import quantity_table
    from satsep_ot.dynamics.simulation import simulate

    with _patience():
        outcome = simulate(case.separation)
    values = {
        name: (float(quantity.value(outcome.base)[0]), quantity.unit, quantity.description)
        for name, quantity in quantity_table(case.separation).items()
    }
    return outcome, values


def _report_status(status, sentence):
    return 0 if status == "OK" else _fail(f"the nominal separation cannot be simulated: {sentence}", 1)


def _console():
    from rich.console import Console

    # Off a terminal (a file, a pipe) nothing is to be folded at an arbitrary 80 columns.
    return Console(highlight=False, width=None if sys.stdout.isatty() else 160)


def _plain(text):
    from rich.markup import escape

    return escape(text)


def _table(title, *columns):
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, title_style="bold")
    # On a narrow terminal texts fold, and neither a name nor a number is cut.
    for name in columns:
        right = name.startswith(">")
        # The unit stands in a line of its own; a column of numbers is as wide as its longest word.
        title = name.removeprefix(">").replace(" [", "\n[")
        table.add_column(
            _plain(title), justify="right" if right else "left", overflow="fold", no_wrap=right and "\n" in title
        )
    table.columns[0].no_wrap = True
    return table


def _narrow(table):
    """The same table with as little between its columns as a terminal of 80 columns needs."""
    table.pad_edge, table.show_edge, table.collapse_padding = False, False, True
    return table


def _bodies(separation):
    table = _table("Bodies", "", ">mass [kg]", "inertia xx, yy, zz, xy, xz, yz [kg m2]", "centre of mass [mm]")
    for name in ("platform", "satellite"):
        mass, *rest = getattr(separation, name).parameters()
        inertia, center = rest[:6], rest[6:]
        table.add_row(name, f"{mass:g}", _numbers(inertia), _numbers(center, 1e3))
    return table


def _springs(separation):
    from math import degrees

    from satsep_ot.dynamics.springs import ForceLaw
    from satsep_ot.model.inputs import umbilical_springs

    springs, connectors = separation.springs, umbilical_springs(separation)
    table = _table(
        f"Springs ({separation.force_line.name.lower()})", ">", ">angle [deg]", ">radius [mm]", ">stiffness [N/m]",
        ">deformation [mm]", ">stroke [mm]", ">cant [deg]", ">delay [ms]", ">scale", "force",
    )  # fmt: skip
    for i in range(len(springs)):
        if {i, i - 1} & set(connectors):
            continue
        force = "failed" if springs.scale[i] == 0.0 else ForceLaw(springs.laws[i]).name.lower()
        if springs.tables[i] is not None:
            force += f" of {len(springs.tables[i])} rows, {springs.tables[i][0, 1]:g} to {springs.tables[i][-1, 1]:g} N"
        linear = springs.laws[i] == ForceLaw.LINEAR
        row = (
            degrees(springs.angle[i]), 1e3 * springs.radius[i], springs.stiffness[i] if linear else None,
            1e3 * springs.deformation[i] if linear else None, 1e3 * springs.stroke[i], degrees(springs.cant[i]),
            1e3 * springs.delay[i], springs.scale[i],
        )  # fmt: skip
        table.add_row(str(i + 1), *("–" if value is None else f"{value:g}" for value in row), force)
    return _narrow(table)


def _umbilicals(separation):
    from math import degrees

    from satsep_ot.model.inputs import umbilical_springs

    springs = separation.springs
    table = _table(
        "Umbilical connectors", ">", ">angle [deg]", ">radius [mm]", ">stiffness [N/m]", ">deformation [mm]",
        ">stroke [mm]", ">pin friction [N]", ">engagement [mm]",
    )  # fmt: skip
    for number, i in enumerate(umbilical_springs(separation), start=1):
        row = (
            degrees(springs.angle[i]), 1e3 * springs.radius[i], springs.stiffness[i], 1e3 * springs.deformation[i],
            1e3 * springs.stroke[i], springs.scale[i + 1], 1e3 * springs.stroke[i + 1],
        )  # fmt: skip
        table.add_row(str(number), *(f"{value:g}" for value in row))
    return _narrow(table)


def _conditions(separation):
    from math import degrees, sqrt

    from satsep_ot.model.plausibility import push_energy

    energy = push_energy(separation)
    reduced = 1.0 / (1.0 / separation.platform.mass + 1.0 / separation.satellite.mass)
    yield f"Spring energy {energy:.6g} J, enough for {sqrt(max(2.0 * energy / reduced, 0.0)):.6g} m/s"
    if separation.stowed_length:
        yield f"Stowed length {1e3 * separation.stowed_length:g} mm"
    yield f"Initial rates {_numbers(map(degrees, separation.rates))} deg/s about the {separation.pivot.name.lower()}"
    if separation.guide_friction:
        yield f"Friction coefficient of the guides {separation.guide_friction:g}"
    if any(separation.impulse) or any(separation.angular_impulse):
        yield (
            f"Impulse at the start {_numbers(separation.impulse)} N s at the ring centre, and "
            f"{_numbers(separation.angular_impulse)} N m s"
        )
    if any(separation.mounting_error):
        yield f"Mounting error {_numbers(map(degrees, separation.mounting_error))} deg"
    if separation.orbit is None:
        yield "No gravity"
    else:
        torque, j2 = ("on" if given else "off" for given in (separation.gradient_torque, separation.orbit.j2))
        position, velocity = separation.orbit.position, separation.orbit.velocity
        yield f"Orbit: position {_numbers(position, 1e-3)} km, velocity {_numbers(velocity, 1e-3)} km/s"
        yield f"Period {separation.orbit.period / 60.0:.6g} min; J2 {j2} in the coast"
        yield f"Gravity-gradient torque: {torque}"
        yield f"Attitude quaternion {_numbers(separation.attitude)} (w, x, y, z)"
    if separation.recontact is not None:
        window = separation.recontact
        yield f"Re-contact: looked for from {window.start_orbits:g} to {window.end_orbits:g} orbits after the release"
    if separation.envelope is None:
        yield "No envelope: no clearance"
    else:
        radius = f"radius {1e3 * separation.recess_radius:g} mm and " if separation.recess_radius else ""
        yield (
            f"Envelope of {len(separation.envelope)} points, {len(separation.recess_points())} of them in a recess "
            f"of {radius}depth {1e3 * separation.recess_depth:g} mm"
        )
        for number, plane in enumerate(separation.recess_planes, start=1):
            yield f"Plane wall {number}: normal {_numbers(plane[:3])}, offset {1e3 * plane[3]:g} mm"


def _inputs(inputs):
    from satsep_ot.model.inputs import interval_digits, quantile_range

    table = _narrow(
        _table(f"Uncertain inputs ({len(inputs)})", "name", "unit", ">0.1 %", ">99.9 %", "distribution", "what")
    )
    for column in table.columns[:4]:
        column.no_wrap = True
    for row in inputs:
        low, high = quantile_range(row.distribution)
        digits = interval_digits(low, high, 6)
        table.add_row(
            _plain(row.name),
            "" if row.unit == "1" else row.unit,
            f"{low:.{digits}g}",
            f"{high:.{digits}g}",
            _plain(str(row.distribution)),
            _plain(row.description),
        )
    return table


def _quantities(quantities):
    table = _table("Nominal run", "quantity", ">value", "unit", "what")
    for name, (value, unit, description) in quantities.items():
        table.add_row(name, _rounded(value, 9), unit, description)
    return table


def _requirements(scatter):
    table = _narrow(
        _table(f"Requirements ({len(scatter)})", "limit", ">nominal run", ">scattered runs", ">met by", ">allowed")
    )
    for row in scatter:
        entry = row.requirement
        verdict = "unknown" if row.nominal != row.nominal else "met" if entry.is_met(row.nominal) else "violated"
        table.add_row(f"[bold]{_plain(entry.name)}[/bold]")
        table.add_row(
            f"{entry} {row.unit}",
            f"{_rounded(row.nominal, 3)} {verdict}",
            f"{_rounded(row.smallest, 3)}..{_rounded(row.largest, 3)}" if row.runs else "none",
            f"{row.met} of {row.runs}" if row.runs else "",
            "" if entry.allowed_probability is None else f"{entry.allowed_probability:g}",
        )
    return table


def _rounded(value, digits):
    """A number for people, to whom a rounding error is 0; JSON has all digits."""
    return "0" if abs(value) < 1e-9 else f"{value:.{digits}g}"


def _numbers(values, scale=1.0):
    return ", ".join(f"{value * scale:.6g}" for value in values)
