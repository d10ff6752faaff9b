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
    crude, known = _crude(case, requirement, target)
    if known:
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
        return dataclasses.replace(crude, converged=False)
    result = algorithm.getResult()
    interval = result.getConfidenceInterval(0.95)
    return QuickProbability(
        result.getProbabilityEstimate(),
        interval.getLowerBound()[0],
        interval.getUpperBound()[0],
        crude.runs + result.getEvaluationNumber(),
        result.getConverged(),
    )


def _crude(case, requirement, target):
    """The estimate by crude Monte Carlo, and whether it has reached the target."""
    distribution = joint_distribution(case.inputs, case.copula)
    scatter = ParameterMap(case.inputs, case.separation)
    entries = [entry for entry in case.requirements if requirement in (SYSTEM, entry.name)]
    enough, runs, count = _ENOUGH * (0.1 / target) ** 2, 0, 0
    most = _MOST_CRUDE_RUNS * max(1.0, (0.1 / target) ** 2)
    while runs < most and count < enough and (runs == 0 or count >= _FEW):
        parameters = scatter.parameters(np.asarray(distribution.getSample(_BLOCK)))
        count += int(true_violations(case.separation, entries, parameters)[:, -1].sum())
        runs += _BLOCK
    return QuickProbability(count / runs, *clopperPearson(count, runs), runs, count >= enough), count >= enough


def step_seed(*names: object) -> int:
    """A seed from the names of what it is for.

    Examples
    --------
    >>> from satsep_ot.studies.quick_probability import step_seed
    >>> step_seed("spin", 7) == step_seed("spin", 7), step_seed("spin", 7) == step_seed("spin", 8)
    (True, False)
    """
    return zlib.crc32("/".join(map(str, names)).encode()) >> 1
