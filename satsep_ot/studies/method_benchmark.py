"""Reliability methods on published problems and on the reference case, whose probabilities are known."""

import json
import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from matplotlib.figure import Figure
from openturns.viewer import View

from satsep_ot.methods.common.storage import writeWhole
from satsep_ot.methods.comparison.benchmark import ReliabilityBenchmark
from satsep_ot.methods.comparison.benchmark_result import ReliabilityBenchmarkResult
from satsep_ot.methods.comparison.problem import BenchmarkTask
from satsep_ot.methods.comparison.problems import getBenchmarkProblem, getBenchmarkProblemNames
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.results_directory import ResultsDirectory, package_versions

# Violations in Monte Carlo runs of the reference case (tests/benchmarks/reference_truth.py, seeds 0 to 39).
REFERENCE_RUNS = 10_000_000
REFERENCE_VIOLATIONS = {
    "lateral rate": 2530,
    "spin": 67595,
    "axial velocity": 6217,
    "clearance": 9404,
    "any requirement": 84013,
}
# The same probabilities and their deviations by importance sampling (tests/benchmarks/reference_importance.py).
REFERENCE_IMPORTANCE = {
    "lateral rate": (2.56023e-04, 2.1e-06),
    "spin": (6.76007e-03, 2.9e-05),
    "axial velocity": (6.02112e-04, 2.7e-06),
    "clearance": (9.42259e-04, 6.7e-06),
    "any requirement": (8.38326e-03, 3.0e-05),
}
# Time of the gradient of the components over that of a run (tests/benchmarks/simulator_speed.txt).
REFERENCE_GRADIENT_COST = 6.2
# Names that stand for several problems.
PUBLISHED, VARIANTS, REFERENCE = "published", "variants", "reference"
# What a benchmark writes.
_WRITTEN = ("runs.jsonl", "benchmark.md", "benchmark.csv", "benchmark.json", "cost.png", "errors.png")
# Published problems turned, in other units and with other numbers of inputs.
_VARIANT_NAMES = (
    "P1-rotated", "P1-rescaled", "P2-rotated", "P2-rescaled", "P3-rotated", "P3-rescaled", "P4-rotated", "P4-rescaled",
    "P5-rotated", "P5-rescaled", "RP8-rotated", "RP8-rescaled", "RP54-rotated", "RP54-rescaled", "P1-d20", "P1-d300",
    "P2-d10", "P2-d150", "P4-d10", "P4-d200", "P5-d5", "P5-d60", "P4-d25-rotated-rescaled",
)  # fmt: skip


def _reference_names():
    return {f"{REFERENCE}-{requirement.replace(' ', '-')}": requirement for requirement in REFERENCE_VIOLATIONS}


def benchmark_names() -> list[str]:
    """Names of all problems: the published ones, then the requirements of the reference case.

    Examples
    --------
    >>> from satsep_ot.studies.method_benchmark import benchmark_names
    >>> benchmark_names()[0], benchmark_names()[-1]
    ('P1', 'reference-any-requirement')
    """
    return [*getBenchmarkProblemNames(), *_reference_names()]


def benchmark_tasks(names: Sequence[str]) -> list[BenchmarkTask]:
    """The problems of these names, ready for :class:`satsep_ot.methods.comparison.benchmark.ReliabilityBenchmark`.

    Parameters
    ----------
    names : sequence of str
        Of `benchmark_names`, or ``published`` or ``reference`` for all of them, or a variant of a published one as
        :func:`satsep_ot.methods.comparison.problems.getBenchmarkProblem` knows it, or ``variants`` for some.

    Returns
    -------
    tasks : list of :class:`satsep_ot.methods.comparison.benchmark.BenchmarkTask`

    Raises
    ------
    ValueError
        If there is no such problem.
    """
    groups = {PUBLISHED: getBenchmarkProblemNames(), VARIANTS: _VARIANT_NAMES, REFERENCE: list(_reference_names())}
    wanted = list(dict.fromkeys(single for name in names for single in groups.get(name, [name])))
    for name in wanted:
        if name not in _reference_names() and name.split("-")[0] not in getBenchmarkProblemNames():
            raise ValueError(
                f"'{name}' is no benchmark problem; there are {', '.join([*groups, *benchmark_names()])}, and variants "
                "of the published ones such as P1-d20-rotated and RP8-rescaled"
            )
    return [_reference_task(name) if name in _reference_names() else _published_task(name) for name in wanted]


def reference_probability(requirement: str) -> tuple[float, float]:
    """Probability of violating a requirement of the reference case, from Monte Carlo and importance sampling together.

    Parameters
    ----------
    requirement : str
        A key of `REFERENCE_VIOLATIONS`.

    Returns
    -------
    probability, deviation : pair of float
        The mean of both, weighted by their precision, and its standard deviation.

    Examples
    --------
    >>> from satsep_ot.studies.method_benchmark import reference_probability
    >>> probability, deviation = reference_probability("axial velocity")
    >>> print(f"{probability:.3e} +- {deviation:.0e}")
    6.042e-04 +- 3e-06
    """
    share = REFERENCE_VIOLATIONS[requirement] / REFERENCE_RUNS
    estimate, deviation = REFERENCE_IMPORTANCE[requirement]
    precisions = REFERENCE_RUNS / (share * (1.0 - share)), deviation**-2
    return (precisions[0] * share + precisions[1] * estimate) / sum(precisions), sum(precisions) ** -0.5


def _published_task(name):
    return BenchmarkTask.of(getBenchmarkProblem(name))


def _reference_task(name):
    requirement = _reference_names()[name]
    problem = SeparationProblem("reference")
    system = requirement not in problem.getRequirementNames()
    probability, deviation = reference_probability(requirement)
    return BenchmarkTask(
        name,
        problem.getSystemEvent() if system else problem.getEvent(requirement),
        probability,
        problem.getComponents(None if system else requirement),
        REFERENCE_GRADIENT_COST,
        deviation / probability,
    )


def open_benchmark_directory(
    path: str | os.PathLike, resume: bool = False, overwrite: bool = False, command: str = ""
) -> ResultsDirectory:
    """Take a directory for a benchmark.

    Repetitions are kept one by one, each with its problem, method, settings and seed: those of other problems, methods
    and seeds may be added to them, but not those of other versions of the packages.

    Parameters
    ----------
    path : str or path
    resume : bool
        Continue from, or add to, the repetitions that are there.
    overwrite : bool
        Remove them.
    command : str
        What the user has typed, for `origin.json`.

    Returns
    -------
    directory : :class:`satsep_ot.studies.results_directory.ResultsDirectory`

    Raises
    ------
    DirectoryError
        The directory holds something else, or a benchmark and neither `resume` nor `overwrite` is given.
    """
    return ResultsDirectory(
        path, "benchmark", {"versions": package_versions()}, _WRITTEN, None, resume, overwrite, {"command": command}
    )


def table_keeper(benchmark: ReliabilityBenchmark, directory: str | os.PathLike) -> Callable[[], None]:
    """Keep the tables of a benchmark that runs up to date, in a twentieth of the time at most.

    Parameters
    ----------
    benchmark : :class:`satsep_ot.methods.comparison.benchmark.ReliabilityBenchmark`
    directory : path
        Exists.

    Returns
    -------
    keep : callable
        To be called after each repetition; writes as `save_benchmark` does, without graphs, unless it did so just now.
    """
    due = 0.0

    def keep():
        nonlocal due
        begin = time.monotonic()
        if begin >= due:
            save_benchmark(benchmark.getResult(), directory, drawn=False)
            end = time.monotonic()
            due = end + 20.0 * (end - begin)

    return keep


def save_benchmark(result: ReliabilityBenchmarkResult, directory: str | os.PathLike, drawn: bool = True) -> list[Path]:
    """Write the tables as Markdown, CSV and JSON and the graphs as PNG, each file whole or not at all.

    Parameters
    ----------
    result : :class:`satsep_ot.methods.comparison.benchmark.ReliabilityBenchmarkResult`
    directory : path
        Exists.
    drawn : bool
        Whether to draw the graphs too, which takes a second.

    Returns
    -------
    paths : list of Path
    """
    texts = {
        "benchmark.md": f"{result.toMarkdown()}\n".encode(),
        "benchmark.csv": result.toCSV().encode(),
        "benchmark.json": f"{json.dumps(result.getTable(), indent=2, allow_nan=False)}\n".encode(),
    }
    directory = Path(directory)
    paths = [writeWhole(directory / name, partial(_write, text)) for name, text in texts.items()]
    if not drawn:
        return paths
    height = max(2.0 + 0.35 * len({row.problem for row in result.getRows()}), 4.5)
    graphs = {"cost.png": (result.drawCost(), height), "errors.png": (result.drawErrors(), 6.0)}
    for name, (graph, size) in graphs.items():
        if not graph.getDrawables():
            continue
        figure = Figure(figsize=(9.0, size))
        View(graph, figure=figure)
        paths.append(writeWhole(directory / name, partial(_save, figure)))
    return paths


def _write(text, stream):
    stream.write(text)


def _save(figure, stream):
    # The legend stands beside the axes.
    figure.savefig(stream, format="png", dpi=120, bbox_inches="tight")
