"""Gaussian process regression of few inputs: a linear and a squared linear trend, and a Matern 5/2 kernel.

Rasmussen and Williams, Gaussian Processes for Machine Learning, MIT Press 2006, chapters 2, 4 and 5.
"""

import math
from typing import Any

import numpy as np
from scipy import linalg, optimize

# Prior variance of the constant and of the linear coefficients, for values of unit spread.
_TREND = 30.0
_JITTER = 1e-9
# Largest number of points, and of those that the hyper-parameters are sought with.
_LARGEST, _LARGEST_OF_SEARCH = 360, 110
_FIRST_ITERATIONS, _LATER_ITERATIONS = 30, 12
_BLOCK = 1500  # points predicted at once
# Logarithms: lower and upper bounds of amplitude, lengths, noise and squared trend.
_BOUNDS = (-7.0, 5.0), (-3.0, 6.0), (math.log(1e-6), 1.0), (-9.0, 3.0)


class GaussianProcess:
    """Posterior of a function of k inputs of unit scale, known at n points.

    Parameters
    ----------
    x : array (n, k)
    values : array (n,)
    start : array (k + 3,), optional
        Hyper-parameters of an earlier process: logarithms of the amplitude, of the k lengths, of the noise and of the
        squared trend.
    search : bool
        Whether to look for the most probable hyper-parameters from the start; else these are kept.

    Attributes
    ----------
    hyper : array (k + 3,)

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.reliability.gaussian_process import GaussianProcess
    >>> x = np.linspace(-2.0, 2.0, 15)[:, None]
    >>> mean, deviation = GaussianProcess(x, np.sin(x[:, 0])).predict(np.array([[0.5]]))
    >>> bool(abs(mean[0] - np.sin(0.5)) < 1e-3), bool(deviation[0] < 0.05)
    (True, True)
    """

    def __init__(self, x: np.ndarray, values: np.ndarray, start: np.ndarray | None = None, search: bool = True) -> None:
        k = x.shape[1]
        self._x = np.ascontiguousarray(x)
        self._centre, self._scale = float(values.mean()), max(float(values.std()), 1e-300)
        self._values = (values - self._centre) / self._scale
        self._prior = np.concatenate(
            [[math.log(0.5)], np.full(k, math.log(2.0) + 0.35 * math.log(k)), [math.log(1e-3), math.log(0.1 / k**0.5)]]
        )
        self._priorDeviation = np.concatenate([[1.5], np.full(k, 0.9), [2.5, 1.5]])
        self.hyper = self._prior.copy() if start is None else start.copy()
        if search and len(x) > _LARGEST_OF_SEARCH:
            some = np.linspace(0, len(x) - 1, _LARGEST_OF_SEARCH).astype(int)
            self.hyper = GaussianProcess(x[some], values[some], start).hyper
        elif search:
            self._search(start is None)
        self._factorise()

    def _search(self, first):
        k = self._x.shape[1]
        self._squares = (self._x.T[:, :, None] - self._x.T[:, None, :]) ** 2
        self._inner = self._x @ self._x.T
        starts = [self.hyper]
        if first:
            shorter = self._prior.copy()
            shorter[1 : 1 + k] -= 0.9
            starts.append(shorter)
        iterations = _FIRST_ITERATIONS if first else _LATER_ITERATIONS
        amplitude, length, noise, trend = _BOUNDS
        found = [
            optimize.minimize(
                self._objective,
                hyper,
                jac=True,
                method="L-BFGS-B",
                bounds=[amplitude, *[length] * k, noise, trend],
                options={"maxiter": iterations, "maxfun": iterations + 10, "ftol": 1e-5, "gtol": 1e-2},
            )
            for hyper in starts
        ]
        self.hyper = min(found, key=lambda one: one.fun).x
        del self._squares, self._inner

    def _objective(self, hyper):
        """Minus the logarithm of the posterior density of hyper-parameters, and its gradient."""
        k = self._x.shape[1]
        amplitude, noise, trend = np.exp(2.0 * hyper[[0, k + 1, k + 2]])
        lengths = np.exp(hyper[1 : k + 1])
        r = np.sqrt(5.0 * np.tensordot(lengths**-2, self._squares, axes=1))
        decay = np.exp(-r)
        matern = amplitude * (1.0 + r + r * r / 3.0) * decay
        squared = trend * self._inner**2
        covariance = _TREND * (1.0 + self._inner) + matern + squared
        covariance[np.diag_indices_from(covariance)] += noise + _JITTER
        factor, failed = linalg.lapack.dpotrf(covariance, lower=1, clean=0)
        if failed:
            return 1e10, np.zeros_like(hyper)
        weights = linalg.lapack.dpotrs(factor, self._values, lower=1)[0]
        inverse = linalg.lapack.dpotri(factor, lower=1)[0]
        # The lower triangle counts twice and the diagonal once: sums over the symmetric matrix without its copy.
        slope = np.tril(2.0 * (inverse - np.outer(weights, weights)))
        slope[np.diag_indices_from(slope)] *= 0.5
        radial = slope * (amplitude * (5.0 / 3.0) * (1.0 + r) * decay)
        gradient = np.empty(k + 3)
        gradient[0] = (slope * matern).sum()
        gradient[1 : k + 1] = 0.5 * (self._squares.reshape(k, -1) @ radial.reshape(-1)) / lengths**2
        gradient[k + 1] = noise * np.diag(slope).sum()
        gradient[k + 2] = (slope * squared).sum()
        standard = (hyper - self._prior) / self._priorDeviation
        value = 0.5 * float(self._values @ weights) + float(np.log(np.diag(factor)).sum())
        return value + 0.5 * float(standard @ standard), gradient + standard / self._priorDeviation

    def _factorise(self):
        k = self._x.shape[1]
        self._amplitude, self._noise, self._trend = np.exp(2.0 * self.hyper[[0, k + 1, k + 2]])
        self._lengths = np.exp(self.hyper[1 : k + 1])
        self._scaled = self._x / self._lengths
        covariance = self._covariance(self._x)
        jitter = _JITTER
        while True:
            covariance[np.diag_indices_from(covariance)] += jitter + (self._noise if jitter == _JITTER else 0.0)
            factor, failed = linalg.lapack.dpotrf(covariance, lower=1, clean=1)
            if not failed:
                break
            jitter *= 100.0
        self._weights = linalg.lapack.dpotrs(factor, self._values, lower=1)[0]
        self._inverse = linalg.solve_triangular(factor, np.eye(len(factor)), lower=True, check_finite=False)

    def _covariance(self, x) -> Any:
        scaled = x / self._lengths
        r = (scaled**2).sum(axis=1)[:, None] + (self._scaled**2).sum(axis=1) - 2.0 * (scaled @ self._scaled.T)
        r = np.sqrt(5.0 * np.maximum(r, 0.0))
        inner = x @ self._x.T
        return self._amplitude * (1.0 + r + r * r / 3.0) * np.exp(-r) + _TREND * (1.0 + inner) + self._trend * inner**2

    def leaveOneOut(self) -> tuple[np.ndarray, np.ndarray]:
        """Error and standard deviation (n,) of each value by the others (Rasmussen and Williams, section 5.4.2)."""
        precision = np.einsum("ij,ij->j", self._inverse, self._inverse)
        return self._scale * self._weights / precision, self._scale / np.sqrt(precision)

    def predict(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard deviation (m,) of new values, their noise included, at points (m, k)."""
        mean, deviation = np.empty(len(x)), np.empty(len(x))
        for start in range(0, len(x), _BLOCK):
            rows = slice(start, start + _BLOCK)
            covariance = self._covariance(x[rows])
            mean[rows] = covariance @ self._weights
            explained = covariance @ self._inverse.T
            squared = (x[rows] ** 2).sum(axis=1)
            prior = _TREND * (1.0 + squared) + self._amplitude + self._trend * squared**2
            variance = np.maximum(prior - np.einsum("ij,ij->i", explained, explained), 0.0)
            deviation[rows] = np.sqrt(variance + self._noise + _JITTER * _TREND)
        return self._centre + self._scale * mean, self._scale * deviation

    def gradients(self, x: np.ndarray) -> np.ndarray:
        """Gradients (m, k) of the mean at points (m, k)."""
        scaled = x / self._lengths
        r = (scaled**2).sum(axis=1)[:, None] + (self._scaled**2).sum(axis=1) - 2.0 * (scaled @ self._scaled.T)
        r = np.sqrt(5.0 * np.maximum(r, 0.0))
        near = (self._amplitude * (5.0 / 3.0) * (1.0 + r) * np.exp(-r)) * self._weights
        matern = (near @ self._x - near.sum(axis=1)[:, None] * x) / self._lengths**2
        squared = 2.0 * self._trend * ((x @ self._x.T) * self._weights) @ self._x
        return self._scale * (matern + _TREND * (self._weights @ self._x) + squared)

    def predictMean(self, x: np.ndarray) -> np.ndarray:
        """Mean (m,) of new values at points (m, k)."""
        return self._centre + self._scale * np.concatenate(
            [self._covariance(x[start : start + _BLOCK]) @ self._weights for start in range(0, len(x), _BLOCK)]
        )


def chooseRows(values: np.ndarray) -> np.ndarray:
    """Rows of at most 360 points: two thirds nearest to the value 0, the others from all the rest."""
    n = len(values)
    if n <= _LARGEST:
        return np.arange(n)
    order = np.argsort(np.abs(values))
    near, rest = order[: 2 * _LARGEST // 3], np.sort(order[2 * _LARGEST // 3 :])
    spread = np.linspace(0, len(rest) - 1, _LARGEST - len(near)).astype(int)
    return np.sort(np.concatenate([near, rest[spread]]))
