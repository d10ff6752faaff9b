"""`satsep-ot benchmark`."""

import argparse
import json
from pathlib import Path

from satsep_ot.commands import options as types
from satsep_ot.commands.printing import fail, progress
from satsep_ot.commands.study import finished_steps

NAME = "benchmark"
SUMMARY = "compare reliability methods where the probability is known"
EXAMPLES = (
    "  satsep-ot benchmark --problems P1 RP8 --methods ActiveSubspace SubsetSampling --repetitions 20\n"
    "  satsep-ot benchmark --problems RP54 RP54-rotated RP54-rescaled P1-d20 --methods ActiveSubspace FORM\n"
    "  satsep-ot benchmark --problems reference --output results\n\n"
    "Every repetition is kept in DIR/runs.jsonl and counts from then on; benchmark.md shows what there is so far.\n"
    "After an interruption the same command with --resume continues, or adds problems, methods and repetitions."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its arguments."""
    parser.add_argument(
        "--problems", nargs="+", default=["published", "reference"], metavar="PROBLEM",
        help="names of problems, published (all of these), reference (all requirements of the reference case) or "
        "variants (published ones rotated, rescaled, with other numbers of inputs); an unknown name lists them "
        "(default: published reference, which takes hours with all methods)",
    )  # fmt: skip
    parser.add_argument(
        "--methods", nargs="+", metavar="METHOD", help="which methods; an unknown name lists them (default: all)"
    )
    parser.add_argument(
        "--repetitions",
        type=types.repetitions,
        default=10,
        metavar="N",
        help="of each method and problem (default: 10)",
    )
    parser.add_argument("--seed", type=types.seed, default=0, metavar="N", help="of the first repetition (default: 0)")
    parser.add_argument(
        "--output", type=Path, default=Path("satsep-benchmark"), metavar="DIR",
        help="where to write (default: satsep-benchmark)",
    )  # fmt: skip
    types.add_worker_options(parser, "make N repetitions at a time, in processes of this machine (default: one)")
    types.add_directory_options(parser)
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def run(options: argparse.Namespace) -> int | None:
    """Run the benchmark, and print its table."""
    from satsep_ot.methods.comparison.benchmark import ReliabilityBenchmark
    from satsep_ot.studies.method_benchmark import benchmark_tasks, open_benchmark_directory, table_keeper

    try:
        tasks = benchmark_tasks(options.problems)
        benchmark = ReliabilityBenchmark(tasks, options.methods, options.repetitions, options.seed)
    except ValueError as error:
        return fail(error, 2)
    with types.executor(options) as executor:
        benchmark.setExecutor(executor)
        directory = open_benchmark_directory(options.output, options.resume, options.overwrite, options.typed)
        benchmark.setFile(options.output / "runs.jsonl")
        try:
            with progress() as show:
                keep_table = table_keeper(benchmark, options.output)

                def report(label: str, share: float) -> None:
                    show(label, share)
                    keep_table()

                benchmark.setProgressCallback(report)
                benchmark.run()
            _print(benchmark.getResult(), options)
        finally:
            directory.close()
    return None


def _print(result, options):
    from satsep_ot.studies.method_benchmark import save_benchmark

    paths = save_benchmark(result, options.output)
    if options.json:
        print(json.dumps(result.getTable(), indent=2, allow_nan=False))
        return
    print(result.toText())
    print(f"\nright on all of these: {', '.join(result.getRightMethods()) or 'none'}")
    if any(row.verdict == "open" for row in result.getRows()):
        print("open: the repetitions are too few to call the method right or wrong there")
    print(f"written to {options.output}: {', '.join(path.name for path in paths)}, runs.jsonl")


def left_behind(options: argparse.Namespace) -> str:
    """What an interrupted command leaves."""
    kept = finished_steps(options.output)
    begun = (options.output / "origin.json").exists()
    return f"{kept}; benchmark.md has a table of all but the latest" if begun else kept
