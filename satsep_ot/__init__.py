"""Reliability of small satellite separation: an OpenTURNS plugin.

The public names below are loaded when they are first used, so that `import satsep_ot` is quick and compiles nothing.
"""

from importlib import import_module

__version__ = "0.1.0"

_HOMES = {
    "ActiveSubspaceAlgorithm": "methods.active_subspace",
    "ActiveSubspaceResult": "methods.active_subspace_result",
    "ActiveSubspaceReliability": "methods.reliability",
    "ActiveSubspaceReliabilityResult": "methods.reliability_result",
    "CaseError": "model.case",
    "MonteCarloStream": "methods.monte_carlo_stream",
    "MultivariatePolynomialRegression": "methods.polynomial_regression",
    "MultivariatePolynomialRegressionResult": "methods.polynomial_regression",
    "ParallelFunction": "methods.parallel_function",
    "PolynomialDistribution": "methods.polynomial_distribution",
    "BenchmarkTask": "methods.reliability_benchmark",
    "ReliabilityBenchmark": "methods.reliability_benchmark",
    "ReliabilityBenchmarkResult": "methods.reliability_benchmark",
    "ReliabilityComparison": "methods.comparison",
    "ReliabilityComparisonResult": "methods.comparison",
    "RidgeApproximation": "methods.ridge_approximation",
    "RidgeApproximationResult": "methods.ridge_approximation",
    "SeparationFunction": "model.separation_function",
    "SeparationProblem": "model.separation_problem",
    "SeparationStudy": "studies.separation_study",
    "TrueRuns": "methods.true_runs",
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
