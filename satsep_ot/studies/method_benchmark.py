"""Reliability methods on published problems and on the reference case, whose probabilities are known."""

import json
import os
import tempfile
from pathlib import Path

from satsep_ot.methods.benchmark_problems import getBenchmarkProblem, getBenchmarkProblemNames
from satsep_ot.methods.reliability_benchmark import BenchmarkTask
from satsep_ot.model.separation_problem import SeparationProblem

# Violations in Monte Carlo runs of the reference case (tests/benchmarks/reference_truth.py, seeds 0 to 39).
REFERENCE_RUNS = 10_000_000
REFERENCE_VIOLATIONS = {
    "lateral rate": 2530,
    "spin": 67595,
    "axial velocity": 6217,
    "clearance": 9404,
    "any requirement": 84013,
}
# Time of the gradient of the components over that of a run (tests/benchmarks/simulator_speed.txt).
REFERENCE_GRADIENT_COST = 5.6
# Names that stand for several problems.
PUBLISHED, REFERENCE = "published", "reference"


def _reference_names():
    return {f"{REFERENCE}-{requirement.replace(' ', '-')}": requirement for requirement in REFERENCE_VIOLATIONS}


def benchmark_names():
    """Names of all problems: the published ones, then the requirements of the reference case.

    Examples
    --------
    >>> from satsep_ot.studies.method_benchmark import benchmark_names
    >>> benchmark_names()[0], benchmark_names()[-1]
    ('P1', 'reference-any-requirement')
    """
    return [*getBenchmarkProblemNames(), *_reference_names()]


def benchmark_tasks(names):
    """The problems of these names, ready for :class:`satsep_ot.methods.reliability_benchmark.ReliabilityBenchmark`.

    Parameters
    ----------
    names : sequence of str
        Of `benchmark_names`, or ``published`` or ``reference`` for all of them.

    Returns
    -------
    tasks : list of :class:`satsep_ot.methods.reliability_benchmark.BenchmarkTask`

    Raises
    ------
    ValueError
        If there is no such problem.
    """
    groups = {PUBLISHED: getBenchmarkProblemNames(), REFERENCE: list(_reference_names())}
    wanted = list(dict.fromkeys(single for name in names for single in groups.get(name, [name])))
    unknown = [name for name in wanted if name not in benchmark_names()]
    if unknown:
        raise ValueError(
            f"'{unknown[0]}' is no benchmark problem; there are {', '.join([*groups, *benchmark_names()])}"
        )
    return [_reference_task(name) if name in _reference_names() else _published_task(name) for name in wanted]


def _published_task(name):
    return BenchmarkTask.of(getBenchmarkProblem(name))


def _reference_task(name):
    requirement = _reference_names()[name]
    problem = SeparationProblem("reference")
    system = requirement not in problem.getRequirementNames()
    return BenchmarkTask(
        name,
        problem.getSystemEvent() if system else problem.getEvent(requirement),
        REFERENCE_VIOLATIONS[requirement] / REFERENCE_RUNS,
        problem.getComponents(None if system else requirement),
        REFERENCE_GRADIENT_COST,
    )


def save_benchmark(result, directory):
    """Write the table as Markdown, CSV and JSON, each file whole or not at all.

    Parameters
    ----------
    result : :class:`satsep_ot.methods.reliability_benchmark.ReliabilityBenchmarkResult`
    directory : path
        Exists.

    Returns
    -------
    paths : list of Path
    """
    texts = {
        "benchmark.md": result.toMarkdown() + "\n",
        "benchmark.csv": result.toCSV(),
        "benchmark.json": json.dumps(result.getTable(), indent=2, allow_nan=False) + "\n",
    }
    paths = []
    for name, text in texts.items():
        handle, temporary = tempfile.mkstemp(dir=directory, suffix=".part")
        try:
            with os.fdopen(handle, "w", encoding="utf-8") as stream:
                stream.write(text)
            paths.append(Path(directory) / name)
            os.replace(temporary, paths[-1])
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
    return paths
