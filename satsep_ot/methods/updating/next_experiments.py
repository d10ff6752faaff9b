"""What more experiments would teach of a probability, found by simulating them before they are made."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from satsep_ot.methods.updating.experiments import Experiment, MeasurementModel
from satsep_ot.methods.updating.failure_probability import Limit
from satsep_ot.methods.updating.two_level import TwoLevelInputs, normals

NUMBERS = (0, 1, 2, 3, 5, 8, 12, 20, 30, 50, 80)
COUNTS = (0, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)  # of failure-free tests
FUTURES = 200
LEVEL = 0.95
DECIDED = 0.8  # share of the futures in which a number of tests must decide
LEAST_DRAWS = 20.0  # effective: with fewer, the draws are too coarse for a quantile


@dataclasses.dataclass(frozen=True)
class Outlook:
    """What a number of further experiments lets expect of one limit.

    Attributes
    ----------
    number : int
    bound : float
        Expected 95 % bound of the probability.
    width : float
        Expected difference between the 95 % and the 5 % bound.
    decided : float or None
        Share of the futures in which the probability is then known to be allowed, or not allowed, with 95 %
        credibility; None where no probability is allowed.
    """

    number: int
    bound: float
    width: float
    decided: float | None


def neededNumber(outlooks: Sequence[Outlook]) -> int | None:
    """The smallest number that decides in at least 80 % of the futures; None where none of them does."""
    return next((row.number for row in outlooks if row.decided is not None and row.decided >= DECIDED), None)


def failureFreeNumber(allowed: float, level: float = LEVEL) -> int:
    """Failure-free tests that show a probability to be at most the allowed one, without any model.

    Examples
    --------
    >>> from satsep_ot.methods.updating.next_experiments import failureFreeNumber
    >>> failureFreeNumber(1e-3)
    2995
    """
    return math.ceil(math.log(1.0 - level) / math.log1p(-allowed))


class NextExperiments:
    """Simulated futures: further experiments of a truth drawn from the posterior, and what they would teach.

    Parameters
    ----------
    inputs : :class:`~satsep_ot.methods.updating.two_level.TwoLevelInputs`
    parameters : ndarray (N, p)
        Equally likely draws of the posterior, standard normal values.
    probabilities : ndarray (N, L)
        Of each limit, at these.
    limits : sequence of Limit
    """

    def __init__(
        self,
        inputs: TwoLevelInputs,
        parameters: np.ndarray,
        probabilities: np.ndarray,
        limits: Sequence[Limit],
    ) -> None:
        self._inputs, self._parameters = inputs, parameters
        self._probabilities, self._limits = probabilities, list(limits)
        self._orders = np.argsort(probabilities, axis=0)

    def measured(self, experiment: Experiment, numbers: Sequence[int] = NUMBERS) -> dict[str, list[Outlook]]:
        """After experiments in which the same is measured as in a given one, under the same conditions.

        Parameters
        ----------
        experiment : Experiment
            Its values play no part.
        numbers : sequence of int

        Returns
        -------
        outlooks : dict of str to list of Outlook
            By the name of the limit; it ends where the draws of the posterior become too coarse.

        Notes
        -----
        Future measurements are true runs; what they teach is computed with the outputs linear in what is drawn anew.
        """
        single = MeasurementModel(self._inputs, [experiment])
        count, most = len(self._parameters), max(numbers)
        centres = single.outputs(experiment, self._inputs.centres(self._parameters, experiment.own))
        roots, logs = self._scatter(single, experiment)
        truths = np.arange(FUTURES) * count // FUTURES
        values = single.predict(np.repeat(self._parameters[truths], most, axis=0))
        values += single.errors * normals(*values.shape)
        # A future run that fails is left out: it is what the other runs let expect.
        values = np.where(np.isfinite(values), values, np.repeat(centres[truths], most, axis=0))
        values = values.reshape(FUTURES, most, -1)
        weights = np.empty((len(numbers), FUTURES, count))
        for f in range(FUTURES):
            residuals = values[f][:, None, :] - centres
            distances = (np.einsum("nkj,kij->nki", residuals, roots) ** 2).sum(axis=2)
            cumulative = np.cumsum(-0.5 * distances - logs, axis=0)
            for row, number in enumerate(numbers):
                weights[row, f] = cumulative[number - 1] if number else 0.0
        return self._outlooks(numbers, np.exp(weights - weights.max(axis=2, keepdims=True)))

    def counted(self, numbers: Sequence[int] = COUNTS) -> dict[str, list[Outlook]]:
        """After experiments under the conditions of interest of which only failures are counted, and none is seen.

        Parameters
        ----------
        numbers : sequence of int

        Returns
        -------
        outlooks : dict of str to list of Outlook
            As of `measured`; `decided` is the chance that the tests are free of failures and decide.
        """
        found = {}
        for j, limit in enumerate(self._limits):
            chances = self._probabilities[:, j]
            rows = []
            for number in numbers:
                weights = np.exp(number * np.log1p(-np.minimum(chances, 1.0 - 1e-12)))
                row = self._outlook(j, number, weights[None, :])
                if row is None:
                    break
                free = float(weights.mean())
                rows.append(row if row.decided is None else dataclasses.replace(row, decided=row.decided * free))
            found[limit.name] = rows
        return found

    def _scatter(self, single, experiment):
        """Inverse roots (N, k, k) of the covariance of a measurement, half the logarithm of its determinant (N,)."""
        middle = self._inputs.centres(self._parameters.mean(axis=0, keepdims=True), experiment.own)[0]
        moved = self._inputs.sigmaFactors(self._parameters, experiment.own)[:, None, :] * single.slopes(
            experiment, middle
        )
        covariances = np.einsum("nqi,ij,nrj->nqr", moved, self._inputs.covariance(experiment.own), moved)
        factors = np.linalg.cholesky(covariances + np.diag(single.errors**2))
        return np.linalg.inv(factors), np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)

    def _outlooks(self, numbers, weights):
        found = {}
        for j, limit in enumerate(self._limits):
            rows = []
            for row, number in enumerate(numbers):
                outlook = self._outlook(j, number, weights[row])
                if outlook is None:
                    break
                rows.append(outlook)
            found[limit.name] = rows
        return found

    def _outlook(self, j, number, weights):
        """Over futures (F, N) of weights; None where the draws are too coarse."""
        weights = weights / weights.sum(axis=1, keepdims=True)
        effective = 1.0 / (weights**2).sum(axis=1)
        if np.median(effective) < LEAST_DRAWS:
            return None
        order = self._orders[:, j]
        cumulative = np.cumsum(weights[:, order], axis=1)
        values = self._probabilities[order, j]
        low, high = (
            values[np.minimum((cumulative < level).sum(axis=1), len(values) - 1)] for level in (1.0 - LEVEL, LEVEL)
        )
        allowed = self._limits[j].allowed
        decided = None if allowed is None else float(np.mean((high <= allowed) | (low > allowed)))
        return Outlook(number, float(high.mean()), float((high - low).mean()), decided)
