"""`ActiveSubspaceReliability` among the methods that are compared."""

import math
from typing import Any

from satsep_ot.methods.comparison.method import CountedProblem, ReliabilityMethod, Row
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.conditional import ConditionalReliability


class ActiveSubspace(ReliabilityMethod):
    """`ActiveSubspaceReliability`, with the components of the comparison where there are any; where inputs are discrete
    or have atoms, `ConditionalReliability`.

    Parameters
    ----------
    targetCoefficientOfVariation : float
    maximumEvaluations : int
    mode : str
        ``"fast"`` or ``"safe"``.
    allowedProbability, verdictCoefficientOfVariation : float
        As for :meth:`ActiveSubspaceReliability.setAllowedProbability`; None, by default, for no stop at a verdict.

    Notes
    -----
    `getLastResult` has all that the row does not.
    """

    name = "ActiveSubspace"

    def __init__(
        self,
        targetCoefficientOfVariation: float = 0.05,
        maximumEvaluations: int = 5000,
        mode: str = "fast",
        allowedProbability: float | None = None,
        verdictCoefficientOfVariation: float = math.inf,
    ) -> None:
        self.targetCoefficientOfVariation = targetCoefficientOfVariation
        self.maximumEvaluations = maximumEvaluations
        self.mode = mode
        self.allowedProbability = allowedProbability
        self.verdictCoefficientOfVariation = verdictCoefficientOfVariation
        self._result: Any = None

    def getLastResult(self) -> Any:
        """The `ActiveSubspaceReliabilityResult` of the last run; a `ConditionalReliabilityResult` of one with atoms."""
        if self._result is None:
            raise RuntimeError("there is no result yet; a comparison has to run the method first")
        return self._result

    def run(self, problem: CountedProblem) -> Row:
        atoms = not problem.distribution.isContinuous()
        task = ConditionalReliability(problem.event) if atoms else ActiveSubspaceReliability(problem.event)
        algorithm = task.getAlgorithm() if isinstance(task, ConditionalReliability) else task
        if problem.components is not None:
            algorithm.setComponents(*problem.components)
        algorithm.setTargetCoefficientOfVariation(self.targetCoefficientOfVariation)
        algorithm.setMaximumEvaluations(self.maximumEvaluations)
        algorithm.setMode(self.mode)
        algorithm.setAllowedProbability(self.allowedProbability, self.verdictCoefficientOfVariation)
        percentage = [0.0]
        algorithm.setProgressCallback(lambda value: percentage.__setitem__(0, value))
        algorithm.setStopCallback(lambda: problem.report(percentage[0]))
        task.run()
        self._result = result = task.getResult()
        interval = result.getConfidenceInterval(0.95)
        variation = result.getCoefficientOfVariation()
        return Row(
            self.name,
            result.getProbabilityEstimate(),
            interval.getLowerBound()[0],
            interval.getUpperBound()[0],
            variation if math.isfinite(variation) else None,
            converged=result.getConverged(),
            note=result.getReason(),
        )


class SafeActiveSubspace(ActiveSubspace):
    """`ActiveSubspace` in its mode ``"safe"``: with two to three times the wide runs, for failure regions that the
    function near the mean does not show.
    """

    name = "SafeActiveSubspace"

    def __init__(self, targetCoefficientOfVariation: float = 0.05, maximumEvaluations: int = 20_000) -> None:
        super().__init__(targetCoefficientOfVariation, maximumEvaluations, "safe")
