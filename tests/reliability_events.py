"""Events on Python functions of arrays, and what the parts of the reliability algorithm need to run on them."""

import numpy as np
import openturns as ot

from satsep_ot.methods.comparison.problems import getBenchmarkProblem
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.limit_state import LimitStateEvent
from satsep_ot.methods.reliability.mode_sampling import ModeSampling
from satsep_ot.methods.reliability.recorder import RunRecorder
from satsep_ot.methods.reliability.settings import ReliabilitySettings
from satsep_ot.methods.reliability.surrogate_sampling import SurrogateSampling, Verdict


def event(evaluate, dimension=3, operator=None, threshold=0.0, distribution=None):
    """An event, by default values of at most 0, on a vectorised Python function of an array."""
    function = ot.PythonFunction(
        dimension, 1, func_sample=lambda x: np.asarray(evaluate(np.asarray(x)), dtype=float).reshape(-1, 1)
    )
    vector = ot.CompositeRandomVector(function, ot.RandomVector(distribution or ot.Normal(dimension)))
    return ot.ThresholdEvent(vector, operator or ot.LessOrEqual(), threshold)


def symbolicEvent(formula, dimension):
    """The event of values of at most 0 of a formula in x0, x1, ..., which has exact gradients."""
    function = ot.SymbolicFunction([f"x{i}" for i in range(dimension)], [formula])
    vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(dimension)))
    return ot.ThresholdEvent(vector, ot.LessOrEqual(), 0.0)


def run(theEvent, seed=0, **options):
    """The result of one run."""
    ot.RandomGenerator.SetSeed(seed)
    algorithm = ActiveSubspaceReliability(theEvent)
    for key, value in options.items():
        getattr(algorithm, f"set{key}")(value)
    algorithm.run()
    return algorithm.getResult()


def solve(name, seed=0, **options):
    """The result of one run on a benchmark problem, with its components, and the known probability."""
    problem = getBenchmarkProblem(name)
    ot.RandomGenerator.SetSeed(seed)
    algorithm = ActiveSubspaceReliability(problem.getEvent())
    if problem.getComponents()[0].getOutputDimension() > 1:
        algorithm.setComponents(*problem.getComponents())
    for key, value in options.items():
        getattr(algorithm, f"set{key}")(value)
    algorithm.run()
    return algorithm.getResult(), problem.getProbability()


def covers(result, truth, level=0.999):
    """Whether the confidence interval holds the true probability."""
    return result.getConfidenceInterval(level).contains([truth])


def recorded(theEvent, maximum=5000, seed=0):
    """Limit state, recorder and generator of a run that has not begun."""
    limitState, generator = LimitStateEvent(theEvent), np.random.default_rng(seed)
    return limitState, RunRecorder(limitState, ReliabilitySettings(maximumEvaluations=maximum), generator), generator


def findNothing(monkeypatch):
    """Neither surrogates nor searches find a failure: runs are handed over to subset simulation."""
    monkeypatch.setattr(SurrogateSampling, "step", lambda self: Verdict.NO_REGION)
    monkeypatch.setattr(ModeSampling, "explore", lambda self, failures: False)
