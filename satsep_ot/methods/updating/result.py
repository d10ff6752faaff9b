"""The result of two-level updating."""

import numpy as np

from satsep_ot.methods.updating.misfit import Misfit
from satsep_ot.methods.updating.posterior import Posterior
from satsep_ot.methods.updating.two_level import TwoLevelInputs, normals
from satsep_ot.openturns_object import OpenTURNSObject


class TwoLevelUpdatingResult(OpenTURNSObject):
    """Posterior of the parameters, and how the measurements fit the model.

    Parameters
    ----------
    inputs : :class:`~satsep_ot.methods.updating.two_level.TwoLevelInputs`
    posterior : :class:`~satsep_ot.methods.updating.posterior.Posterior`
    misfits : list of :class:`~satsep_ot.methods.updating.misfit.Misfit`
    evaluations, gradients : int
        Runs of the model that it took.
    """

    def __init__(
        self, inputs: TwoLevelInputs, posterior: Posterior, misfits: list[Misfit], evaluations: int, gradients: int
    ) -> None:
        self._inputs, self._posterior, self._misfits = inputs, posterior, misfits
        self._evaluations, self._gradients = evaluations, gradients

    def _shown(self):
        return {
            "parameters": len(self._inputs.getParameters()),
            "effective size": round(self._posterior.effectiveSize),
            "contradictions": sum(row.contradicts for row in self._misfits),
            "evaluations": self._evaluations,
        }

    def getRemarks(self) -> list[str]:
        """Sentences on what a reader should know."""
        found = []
        if not self._inputs.getParameters():
            found.append(
                "No input is shared and no mean or sigma is uncertain: the experiments can teach nothing, they can "
                "only contradict the model."
            )
        if not self._posterior.converged:
            found.append(
                f"The Markov chains do not agree: R-hat is {self._posterior.rhat:.3f} where at most 1.01 is good, and "
                f"the draws are worth {self._posterior.effectiveSize:.0f} independent ones; larger errors of the "
                "measurements would help."
            )
        if any(row.contradicts for row in self._misfits):
            found.append("The measurements contradict the model; what it learns from them is not to be trusted.")
        return found

    def getPosterior(self) -> Posterior:
        """Draws, weights, effective size and R-hat."""
        return self._posterior

    def getMisfits(self) -> list[Misfit]:
        """How each quantity and each measurement fits the model, quantities first."""
        return list(self._misfits)

    def getMoments(self) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation of each parameter in its unit, ndarray (p,) each."""
        return self._posterior.moments(self._inputs)

    def getInterval(self, level: float = 0.95) -> np.ndarray:
        """Credible interval of each parameter in its unit, ndarray (p, 2)."""
        values = self._inputs.valuesOf(self._posterior.resampled(len(self._posterior.draws)))
        tail = 0.5 * (1.0 - level)
        return np.quantile(values, (tail, 1.0 - tail), axis=0).T

    def drawParameters(self, size: int) -> np.ndarray:
        """Equally likely draws of the parameters, standard normal values (size, p)."""
        return self._posterior.resampled(size)

    def drawPrior(self, size: int) -> np.ndarray:
        """The same before the measurements."""
        return normals(size, len(self._inputs.getParameters()))

    def getEvaluations(self) -> tuple[int, int]:
        """Evaluations and gradients of the model."""
        return self._evaluations, self._gradients
