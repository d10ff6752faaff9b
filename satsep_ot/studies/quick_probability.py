"""The probability of a violation of a case that was changed, by as few new runs as decide it."""

import dataclasses
import zlib

import numpy as np
import openturns as ot

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.model.case import SYSTEM, Case
from satsep_ot.model.inputs import ParameterMap, joint_distribution
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.openturns_adapter import raiseInterrupt
from satsep_ot.studies.true_violations import true_violations

_BLOCK = 2_048
_MOST_CRUDE_RUNS = 16_384
# So many violations give a coefficient of variation of 10 %; with fewer than some in the first block, crude Monte Carlo
# is not the way.
_ENOUGH, _FEW = 100, 6
_MOST_RUNS = 5_000
# Crude runs that bound a probability of which no method has found a violation: 3e-5 with 95 %.
_MOST_BOUNDING_RUNS = 131_072


@dataclasses.dataclass(frozen=True)
class QuickProbability:
    """The probability of a violation of a changed case.

    Attributes
    ----------
    probability, lower95, upper95 : float or None
        None where no estimate could be made.
    runs : int
        Of the simulator.
    converged : bool
    """

    probability: float | None
    lower95: float | None
    upper95: float | None
    runs: int
    converged: bool


def quick_probability(case: Case, requirement: str, seed: int, target: float = 0.1) -> QuickProbability:
    """The probability of a violation by crude Monte Carlo where that is quick, else by importance sampling.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
    requirement : str
        Its name, or "any requirement".
    seed : int
        Crude runs of changed cases with the same seed and inputs have common random numbers.
    target : float
        Coefficient of variation at which the runs end.

    Returns
    -------
    estimate : QuickProbability
    """
    ot.RandomGenerator.SetSeed(seed)
    blocks = _violations(case, requirement)
    crude = _crude(blocks, target)
    if crude.converged:
        return crude
    problem = SeparationProblem(case)
    given = None if requirement == SYSTEM else requirement
    try:
        algorithm = ActiveSubspaceReliability(problem.getSystemEvent() if given is None else problem.getEvent(given))
        algorithm.setComponents(*problem.getComponents(given))
        algorithm.setTargetCoefficientOfVariation(target)
        algorithm.setMaximumEvaluations(_MOST_RUNS)
        algorithm.run()
    except Exception as error:
        raiseInterrupt(error)
        return crude
    result = algorithm.getResult()
    interval, allowed = result.getConfidenceInterval(0.95), _allowed(case, requirement)
    if result.getProbabilityEstimate() <= 0.0 and interval.getUpperBound()[0] > allowed:
        return _bounded(blocks, crude, result.getEvaluationNumber(), allowed)
    return QuickProbability(
        result.getProbabilityEstimate(),
        interval.getLowerBound()[0],
        interval.getUpperBound()[0],
        crude.runs + result.getEvaluationNumber(),
        result.getConverged(),
    )


def _violations(case, requirement):
    """The number of violations in one block of crude runs after the other."""
    distribution = joint_distribution(case.inputs, case.copula)
    scatter = ParameterMap(case.inputs, case.separation)
    entries = [entry for entry in case.requirements if requirement in (SYSTEM, entry.name)]
    while True:
        parameters = scatter.parameters(np.asarray(distribution.getSample(_BLOCK)))
        yield int(true_violations(case.separation, entries, parameters)[:, -1].sum())


def _crude(blocks, target):
    """The estimate by crude Monte Carlo; converged where it has reached the target."""
    enough, runs, count = _ENOUGH * (0.1 / target) ** 2, 0, 0
    most = _MOST_CRUDE_RUNS * max(1.0, (0.1 / target) ** 2)
    while runs < most and count < enough and (runs == 0 or count >= _FEW):
        count += next(blocks)
        runs += _BLOCK
    return QuickProbability(count / runs, *clopperPearson(count, runs), runs, count >= enough)


def _allowed(case, requirement):
    """The allowed probability; 1 where there is none."""
    entries = {entry.name: entry.allowed_probability for entry in case.requirements}
    return entries.get(requirement) or 1.0


def _bounded(blocks, crude, further, allowed):
    """The bounds by crude runs, which go on until they tell whether the allowed probability is met.

    A method that finds no violation bounds the probability by its own few runs alone.
    """
    runs, count = crude.runs, round(crude.probability * crude.runs)
    while runs < _MOST_BOUNDING_RUNS and count < _ENOUGH and clopperPearson(count, runs)[1] > allowed:
        count += next(blocks)
        runs += _BLOCK
    lower, upper = clopperPearson(count, runs)
    return QuickProbability(count / runs, lower, upper, runs + further, upper <= allowed)


def step_seed(*names: object) -> int:
    """A seed from the names of what it is for.

    Examples
    --------
    >>> from satsep_ot.studies.quick_probability import step_seed
    >>> step_seed("spin", 7) == step_seed("spin", 7), step_seed("spin", 7) == step_seed("spin", 8)
    (True, False)
    """
    return zlib.crc32("/".join(map(str, names)).encode()) >> 1
