"""The likelihood of parameters from one experiment, with what is drawn anew in it integrated out."""

import math

import numpy as np
import openturns as ot
from scipy.special import logsumexp

from satsep_ot.methods.updating.experiments import Experiment, MeasurementModel
from satsep_ot.methods.updating.two_level import normals

POOL = 5000  # deviations of inputs that are not normal, from which each value of the parameters takes some
POINTS = 128  # of them
RUNS = 4  # true runs for each value of the parameters
EDGE = 0.01  # a linear model is made no nearer to the end of a distribution than at this quantile


class ExperimentLikelihood:
    """The likelihood from one experiment.

    The measurements are linear in the inputs but for little: the linear model about the most likely inputs gives the
    likelihood in closed form in the normal inputs, and by points in the others. True runs at draws of the inputs given
    the measurements correct it by the ratio of both models, so that the estimate has no bias (importance sampling
    squared, Tran et al. 2013). Without such nonlinearity it is exact.

    Parameters
    ----------
    model : MeasurementModel
    experiment : Experiment
    """

    def __init__(self, model: MeasurementModel, experiment: Experiment) -> None:
        self.model, self.experiment = model, experiment
        self._inputs, self._own = model.inputs, experiment.own
        self._values, self._errors = experiment.values, experiment.errors
        self._sampled, self._normal = self._inputs.sampledInputs(self._own), self._inputs.normalInputs(self._own)
        self._covariance = self._inputs.covariance(self._own)
        block = self._covariance[np.ix_(self._normal, self._normal)]
        self._root = np.linalg.cholesky(block) if self._normal else np.empty((0, 0))
        # The noise of the linear model, larger than that of the measurements by what it neglects.
        self._widths = self._errors.copy()
        self.linearize(self._inputs.centres(np.zeros((1, model.parameterNumber)), self._own)[0])

    def linearize(self, physical: np.ndarray) -> None:
        """Make the linear model at these inputs (d,)."""
        self.at = physical
        self._outputs = self.model.outputs(self.experiment, physical[None, :])[0]
        self._slopes = self.model.slopes(self.experiment, physical)

    @property
    def isPossible(self) -> bool:
        """Whether the run at which the linear model was made was possible."""
        return bool(np.isfinite(self._outputs).all() and np.isfinite(self._slopes).all())

    def normalLogarithm(self, parameters: np.ndarray) -> np.ndarray:
        """Logarithm of the likelihood (N,) as if all that is drawn anew were normal."""
        residuals, _ = self._residuals(parameters)
        moved = self._inputs.sigmaFactors(parameters, self._own)[:, None, :] * self._slopes
        covariances = np.einsum("nqi,ij,nrj->nqr", moved, self._covariance, moved) + np.diag(self._errors**2)
        return _logDensity(residuals[:, None, :], covariances)[:, 0]

    def likelyInputs(self, parameters: np.ndarray) -> np.ndarray:
        """The inputs (d,) that the measurements and parameters (p,) let expect, away from the ends of distributions."""
        residuals, centres = self._residuals(parameters[None, :])
        factor = self._inputs.sigmaFactors(parameters[None, :], self._own)[0]
        moved = factor[:, None] * self._covariance * factor @ self._slopes.T
        total = self._slopes @ moved + np.diag(self._errors**2)
        likely = centres[0] + moved @ np.linalg.solve(total, residuals[0])
        for i in self._sampled:
            marginal = self._inputs.getDistribution().getMarginal(i)
            low, high = (marginal.computeQuantile(level)[0] for level in (EDGE, 1.0 - EDGE))
            likely[i] = min(max(likely[i], low), high)
        return likely

    def logarithms(self, parameters: np.ndarray, learn: bool = False) -> np.ndarray:
        """Estimates of the logarithm of the likelihood (N,) at parameters (N, p).

        Parameters
        ----------
        parameters : ndarray (N, p)
        learn : bool
            Whether the noise of the linear model is set to what these runs say of it.
        """
        count = len(parameters)
        residuals, centres = self._residuals(parameters)
        factors = self._inputs.sigmaFactors(parameters, self._own)
        roots = (factors[:, None, self._normal] * self._slopes[:, self._normal]) @ self._root
        covariances = roots @ roots.transpose(0, 2, 1) + np.diag(self._widths**2)
        pool = self._pool()
        rows = (self._offsets(count, len(pool)) + np.arange(min(POINTS, len(pool)))) % len(pool)
        moved = pool[rows] * factors[:, None, self._sampled]
        left = residuals[:, None, :] - moved @ self._slopes[:, self._sampled].T
        logs = _logDensity(left, covariances)
        linear = logsumexp(logs, axis=1) - math.log(logs.shape[1])
        if not self.experiment.measuresOutputs:
            # Inputs are linear in themselves.
            return linear
        picked = _pick(np.exp(logs - logs.max(axis=1, keepdims=True)), RUNS)
        index = np.arange(count)[:, None]
        left, moved = left[index, picked], moved[index, picked]
        standard = normals(count, RUNS, len(self._normal))
        noise = self._widths * normals(count, RUNS, len(self._values))
        gap = left - np.einsum("nqi,nki->nkq", roots, standard) - noise
        standard += np.einsum("nqi,nkq->nki", roots, np.linalg.solve(covariances[:, None], gap[..., None])[..., 0])
        physical = np.repeat(centres[:, None, :], RUNS, axis=1)
        physical[:, :, self._sampled] += moved
        physical[:, :, self._normal] += factors[:, None, self._normal] * (standard @ self._root.T)
        physical = physical.reshape(count * RUNS, -1)
        true = self._values - self.model.outputs(self.experiment, physical)
        found = self._values - self._outputs - (physical - self.at) @ self._slopes.T
        if learn:
            neglected = np.sqrt(np.nanmean((true - found) ** 2, axis=0))
            # Rounding is not neglected by the linear model.
            significant = neglected > 1e-6 * self._errors
            self._widths = np.where(significant, np.hypot(self._errors, neglected), self._errors)
        ratios = 0.5 * ((found / self._widths) ** 2 - (true / self._errors) ** 2) + np.log(self._widths / self._errors)
        ratios = np.where(np.isfinite(ratios), ratios, -np.inf).sum(axis=1).reshape(count, RUNS)
        with np.errstate(divide="ignore"):
            return linear + logsumexp(ratios, axis=1) - math.log(RUNS)

    def _residuals(self, parameters):
        """What the linear model leaves of the measurements (N, k) at the centres (N, d)."""
        centres = self._inputs.centres(parameters, self._own)
        return self._values - self._outputs - (centres - self.at) @ self._slopes.T, centres

    def _pool(self):
        if not self._slopes[:, self._sampled].any():
            return np.zeros((1, len(self._sampled)))
        return self._inputs.drawDeviations(POOL, self._own)[:, self._sampled]

    @staticmethod
    def _offsets(count, size):
        if size == 1:
            return np.zeros((count, 1), dtype=int)
        return (size * np.array(ot.RandomGenerator.Generate(count))).astype(int)[:, None]


def _logDensity(residuals, covariances):
    """Logarithm of the normal density (N, M) of residuals (N, M, k) with covariances (N, k, k)."""
    factors = np.linalg.cholesky(covariances)
    scaled = np.linalg.solve(factors, residuals.transpose(0, 2, 1))
    logDeterminants = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    size = residuals.shape[2]
    return -0.5 * (scaled**2).sum(axis=1) - logDeterminants[:, None] - 0.5 * size * math.log(2.0 * math.pi)


def _pick(weights, size):
    """Columns (N, size) of each row of weights (N, M), each as often as its weight says."""
    shares = np.cumsum(weights, axis=1)
    shares /= shares[:, -1:]
    starts = np.array(ot.RandomGenerator.Generate(len(weights)))
    places = (np.arange(size) + starts[:, None]) / size
    return np.minimum((shares[:, None, :] < places[:, :, None]).sum(axis=2), weights.shape[1] - 1)
