"""Reliability of small satellite separation: an OpenTURNS plugin.

The public names below are loaded when they are first used, so that `import satsep_ot` is quick and compiles nothing.
"""

from importlib import import_module

from satsep_ot.moved_modules import install as _install_moved_modules

__version__ = "0.1.0"

_install_moved_modules()

_HOMES = {
    "ActiveSubspaceAlgorithm": "methods.subspaces.algorithm",
    "ActiveSubspaceResult": "methods.subspaces.result",
    "ActiveSubspaceReliability": "methods.reliability.algorithm",
    "ActiveSubspaceReliabilityResult": "methods.reliability.result",
    "AskTellReliability": "methods.reliability.ask_tell",
    "CaseError": "model.case",
    "ConditionalReliability": "methods.reliability.conditional",
    "ConditionalReliabilityResult": "methods.reliability.conditional",
    "MonteCarloStream": "methods.parallel.monte_carlo_stream",
    "MultivariatePolynomialRegression": "methods.polynomials.regression",
    "MultivariatePolynomialRegressionResult": "methods.polynomials.regression_result",
    "ParallelFunction": "methods.parallel.function",
    "PolynomialDistribution": "methods.polynomials.distribution",
    "BenchmarkTask": "methods.comparison.problem",
    "ReliabilityBenchmark": "methods.comparison.benchmark",
    "ReliabilityBenchmarkResult": "methods.comparison.benchmark_result",
    "ReliabilityComparison": "methods.comparison.comparison",
    "ReliabilityComparisonResult": "methods.comparison.comparison",
    "RidgeApproximation": "methods.subspaces.ridge_approximation",
    "RidgeApproximationResult": "methods.subspaces.ridge_approximation",
    "SeparationFunction": "model.separation_function",
    "SeparationProblem": "model.separation_problem",
    "SeparationStudy": "studies.separation_study",
    "SeparationUpdate": "studies.separation_update",
    "addToStudy": "openturns_object",
    "readFromStudy": "openturns_object",
    "TrueRuns": "methods.reliability.true_runs",
    "list_runs": "studies.study_runs",
    "load_case": "model.case",
    "load_runs": "studies.study_runs",
}

__all__ = ["__version__", *_HOMES]


def __getattr__(name):
    if name not in _HOMES:
        raise AttributeError(f"module 'satsep_ot' has no attribute '{name}'")
    return getattr(import_module(f"satsep_ot.{_HOMES[name]}"), name)


def __dir__():
    return sorted([*globals(), *_HOMES])
