"""Inputs on two levels: what stays the same in all experiments, what is drawn anew in each, what is known roughly."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.openturns_object import OpenTURNSObject


def normals(*shape: int) -> np.ndarray:
    """Standard normals of this shape from ``ot.RandomGenerator``."""
    count = math.prod(shape)
    numbers = ot.Sample.BuildFromPoint(ot.DistFunc.rNormal(max(1, count)))
    return np.array(numbers)[:count, 0].reshape(shape)


class Parameter(NamedTuple):
    """One number that is not known and that experiments can teach.

    Attributes
    ----------
    name : str
        Of the input, or of the group of inputs.
    kind : str
        "value" of a shared input, "mean" or "sigma" of the inputs of a group.
    input : int
        The input, or the first one of the group.
    """

    name: str
    kind: str
    input: int


class TwoLevelInputs(OpenTURNSObject):
    """How the inputs of one experiment relate to those of another.

    Input i is ``x_i = m_i + f_g (Q_i(z_i) - m_i) + M_g e_g``: its distribution has the mean m_i and turns a standard
    normal z_i into Q_i(z_i); the mean of its group g is off by M_g e_g, and its sigma by the factor f_g, which is
    log-normal with mean 1. Of a shared input z_i is drawn once, of the others anew in each experiment; e_g and f_g are
    drawn once. All of these are independent standard normals beforehand, but for the correlations of the z.

    Parameters
    ----------
    distribution : :py:class:`openturns.Distribution`
        Of the d inputs, with independent inputs or a normal copula.
    shared : sequence of int
        Inputs that have one value in all experiments.
    meanUncertainty : sequence of float, optional
        Standard deviation M of the mean of each input; 0: the mean is known.
    sigmaUncertainty : sequence of float, optional
        Coefficient of variation of the sigma of each input; 0: sigma is known.
    groups : sequence of str, optional
        Inputs of one name have one unknown mean and one unknown sigma. Default: each input is a group.

    Raises
    ------
    ValueError
        Sizes that do not match, an uncertainty that is negative or differs within a group, a copula that is not
        normal, or a correlation of a shared input with one that is not.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.updating.two_level import TwoLevelInputs
    >>> inputs = TwoLevelInputs(ot.Normal(2), shared=[0], meanUncertainty=[0.0, 0.5])
    >>> [(parameter.name, parameter.kind) for parameter in inputs.getParameters()]
    [('X0', 'value'), ('X1', 'mean')]
    """

    def __init__(
        self,
        distribution: ot.Distribution,
        shared: Sequence[int] = (),
        meanUncertainty: ArrayLike | None = None,
        sigmaUncertainty: ArrayLike | None = None,
        groups: Sequence[str] | None = None,
    ) -> None:
        self._distribution = ot.Distribution(distribution)
        size = self._distribution.getDimension()
        names = list(self._distribution.getDescription())
        self._shared = sorted(set(shared))
        if self._shared and not 0 <= self._shared[0] <= self._shared[-1] < size:
            raise ValueError(f"The shared inputs are {self._shared}; they must be indices from 0 to {size - 1}.")
        self._groups = names if groups is None else list(groups)
        self._meanUncertainty = self._checked("mean", meanUncertainty, size)
        self._sigmaUncertainty = self._checked("sigma", sigmaUncertainty, size)
        self._anew = [i for i in range(size) if i not in self._shared]
        marginals = [self._distribution.getMarginal(i) for i in range(size)]
        self._mean = np.array([marginal.getMean()[0] for marginal in marginals])
        self._sigma = np.array([marginal.getStandardDeviation()[0] for marginal in marginals])
        if not (np.isfinite(self._mean).all() and np.isfinite(self._sigma).all()):
            bad = names[int((~np.isfinite(self._mean + self._sigma)).argmax())]
            raise ValueError(f"The input {bad} has no finite mean and sigma; give a distribution that has both.")
        self._isNormal = np.array([type(m.getImplementation()) is ot.Normal for m in marginals], dtype=bool)
        others = [marginals[i] for i in range(size) if not self._isNormal[i]]
        self._space = StandardSpace(ot.JointDistribution(others)) if others else None
        self._factor = self._correlation()
        first = {name: i for i, name in reversed(list(enumerate(self._groups)))}
        self._parameters = [Parameter(names[i], "value", i) for i in self._shared]
        for kind, known in (("mean", self._meanUncertainty), ("sigma", self._sigmaUncertainty)):
            self._parameters += [Parameter(name, kind, i) for name, i in sorted(first.items(), key=_second) if known[i]]

    def _shown(self):
        counts = {kind: sum(row.kind == kind for row in self._parameters) for kind in ("value", "mean", "sigma")}
        return {
            "inputs": self.getDimension(),
            "shared": counts["value"],
            "uncertain means": counts["mean"],
            "uncertain sigmas": counts["sigma"],
        }

    def _checked(self, what, values, size):
        values = np.zeros(size) if values is None else np.array(values, dtype=float)
        if values.shape != (size,) or not (np.isfinite(values) & (values >= 0.0)).all() or len(self._groups) != size:
            raise ValueError(f"The uncertainties of the {what} must be {size} finite numbers >= 0, one for each input.")
        for name in set(self._groups):
            members = values[[i for i in range(size) if self._groups[i] == name]]
            if np.ptp(members):
                raise ValueError(f"The inputs of the group {name} must have one uncertainty of the {what}.")
        return values

    def _correlation(self):
        """Cholesky factor of the correlations of the z, or None where they are independent."""
        if self._distribution.hasIndependentCopula():
            return None
        copula = self._distribution.getCopula().getImplementation()
        if type(copula) is not ot.NormalCopula:
            raise ValueError(f"The copula is a {copula.getClassName()}; give a normal copula or independent inputs.")
        size = self.getDimension()
        matrix = np.eye(size)
        places = [(j, i) for j in range(size) for i in range(j)]
        for (j, i), value in zip(places, copula.getParameter(), strict=True):
            matrix[i, j] = matrix[j, i] = value
        mixed = np.argwhere(matrix[np.ix_(self._shared, self._anew)] != 0.0)
        if len(mixed):
            names = self._distribution.getDescription()
            pair = f"{names[self._shared[mixed[0, 0]]]} and {names[self._anew[mixed[0, 1]]]}"
            raise ValueError(f"{pair} are correlated, but only one of them is shared; share both of them or neither.")
        return np.linalg.cholesky(matrix)

    def getDimension(self) -> int:
        """Number of inputs, d."""
        return self._distribution.getDimension()

    def getDistribution(self) -> ot.Distribution:
        """Distribution of the inputs of one experiment with known means and sigmas."""
        return self._distribution

    def getParameters(self) -> list[Parameter]:
        """What is not known and the same in all experiments, p parameters."""
        return list(self._parameters)

    def getAnew(self) -> list[int]:
        """Indices of the inputs that are drawn anew in each experiment."""
        return list(self._anew)

    def toPhysical(self, parameters: np.ndarray, drawn: np.ndarray, own: Sequence[int] = ()) -> np.ndarray:
        """Inputs of experiments.

        Parameters
        ----------
        parameters : ndarray (N, p)
            Standard normal values of the parameters.
        drawn : ndarray (N, a)
            Standard normal values of what is drawn anew: `getAnew`, then `own`.
        own : sequence of int
            Inputs that are of another piece in these experiments: drawn anew, with all their uncertainty in one.

        Returns
        -------
        ndarray (N, d)
        """
        standard, shift, factor = self._parts(parameters, drawn, own)
        return self._mean + factor * (self._quantiles(standard) - self._mean) + shift

    def sampledInputs(self, own: Sequence[int] = ()) -> list[int]:
        """Inputs drawn anew that are not normal, or are correlated with such ones."""
        drawn = [i for i in range(self.getDimension()) if i in self._anew or i in own]
        odd = {i for i in drawn if not self._isNormal[i]}
        if self._factor is not None:
            matrix = self._factor @ self._factor.T
            odd |= {i for i in drawn if i not in own and any(matrix[i, j] != 0.0 for j in odd if j not in own)}
        return sorted(odd)

    def normalInputs(self, own: Sequence[int] = ()) -> list[int]:
        """The other inputs drawn anew, which are normal."""
        odd = self.sampledInputs(own)
        return [i for i in range(self.getDimension()) if (i in self._anew or i in own) and i not in odd]

    def centres(self, parameters: np.ndarray, own: Sequence[int] = ()) -> np.ndarray:
        """Inputs (N, d) where what is drawn anew has its mean, at parameters (N, p)."""
        standard, shift, factor = self._parts(parameters, self._noneDrawn(parameters, own), own)
        centre = self._mean + factor * (self._quantiles(standard) - self._mean)
        drawn = [*self._anew, *own]
        centre[:, drawn] = self._mean[drawn]
        return centre + shift

    def drawDeviations(self, size: int, own: Sequence[int] = ()) -> np.ndarray:
        """Deviations (size, d) from the mean of what is drawn anew, where sigmas are as in the distribution."""
        drawn = normals(size, len(self._anew) + len(own))
        standard, _, factor = self._parts(np.zeros((size, len(self._parameters))), drawn, own)
        factor[:, [i for i in range(self.getDimension()) if i not in own]] = 1.0
        return factor * (self._quantiles(standard) - self._mean)

    def covariance(self, own: Sequence[int] = ()) -> np.ndarray:
        """Covariance (d, d) of `drawDeviations`, 0 for what is shared; correlations are those of the z."""
        size = self.getDimension()
        drawn = [i for i in self._anew if i not in own]
        matrix = np.zeros((size, size))
        correlation = np.eye(size) if self._factor is None else self._factor @ self._factor.T
        matrix[np.ix_(drawn, drawn)] = correlation[np.ix_(drawn, drawn)]
        known = np.zeros((1, len(self._parameters)))
        widths = self._sigma * self._parts(known, self._noneDrawn(known, own), own)[2][0]
        widths[drawn] = self._sigma[drawn]
        matrix[list(own), list(own)] = 1.0
        return matrix * np.outer(widths, widths)

    def sigmaFactors(self, parameters: np.ndarray, own: Sequence[int] = ()) -> np.ndarray:
        """The factors f of the sigma of each input (N, d); 1 for those of another piece."""
        factor = self._parts(parameters, self._noneDrawn(parameters, own), own)[2]
        factor[:, list(own)] = 1.0
        return factor

    def _noneDrawn(self, parameters, own):
        return np.zeros((len(parameters), len(self._anew) + len(own)))

    def valuesOf(self, parameters: np.ndarray) -> np.ndarray:
        """The parameters in the units of their inputs, ndarray (N, p), from their standard normal values (N, p)."""
        centre = self.centres(parameters)
        _, shift, factor = self._parts(parameters, self._noneDrawn(parameters, ()), ())
        values = np.empty((len(parameters), len(self._parameters)))
        for k, row in enumerate(self._parameters):
            found = {"value": centre, "mean": self._mean + shift, "sigma": self._sigma * factor}[row.kind]
            values[:, k] = found[:, row.input]
        return values

    def deviations(self, drawn: np.ndarray) -> np.ndarray:
        """How far what is drawn anew moves the inputs where their sigmas are as in the distribution, ndarray (N, d)."""
        known = np.zeros((len(drawn), len(self._parameters)))
        standard = self._parts(known, drawn, ())[0]
        return self._quantiles(standard) - self._quantiles(np.zeros((1, self.getDimension())))

    def _logSigma(self, i):
        return math.sqrt(math.log1p(self._sigmaUncertainty[i] ** 2))

    def _members(self, row, own):
        group = self._groups[row.input]
        return [i for i, name in enumerate(self._groups) if name == group and i not in own]

    def _parts(self, parameters, drawn, own):
        """The z (N, d), the shifts of the means (N, d) and the factors of the sigmas (N, d)."""
        count, size = len(parameters), self.getDimension()
        standard, shift, factor = np.zeros((count, size)), np.zeros((count, size)), np.ones((count, size))
        standard[:, self._anew] = drawn[:, : len(self._anew)]
        for k, row in enumerate(self._parameters):
            column = parameters[:, k]
            if row.kind == "value":
                standard[:, row.input] = column
            elif row.kind == "mean":
                shift[:, self._members(row, own)] = (self._meanUncertainty[row.input] * column)[:, None]
            else:
                width = self._logSigma(row.input)
                factor[:, self._members(row, own)] = np.exp(width * column - 0.5 * width**2)[:, None]
        if self._factor is not None:
            standard = standard @ self._factor.T
        for place, i in enumerate(own, start=len(self._anew)):
            standard[:, i] = drawn[:, place]
            spread = math.hypot(1.0, self._meanUncertainty[i] / self._sigma[i])
            factor[:, i] = spread * math.hypot(1.0, self._sigmaUncertainty[i])
        return standard, shift, factor

    def _quantiles(self, standard):
        values = self._mean + self._sigma * standard
        if self._space is not None:
            values[:, ~self._isNormal] = self._space.toPhysical(standard[:, ~self._isNormal])
        return values


def _second(item):
    return item[1]
