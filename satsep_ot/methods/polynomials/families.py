"""Orthogonal polynomial families of independent inputs, and the map of the inputs to their variables."""

import dataclasses
import functools
import math

import numpy as np
import openturns as ot
from scipy.special import ndtr

from satsep_ot.methods.polynomials.basis import PolynomialBasis, hermite_recurrence
from satsep_ot.moved_modules import restoring
from satsep_ot.openturns_adapter import REFUSALS

# Moments are integrated by Gauss-Legendre between quantiles, whose levels are equidistant for a standard normal up to
# this many standard deviations.
FARTHEST_LEVEL = 9.0
INTERVALS = 100
INTERVAL_NODES = 20
# Between two quantiles the density may be concentrated, as between two modes: where its integral misses the probability
# by more than this share, the quantile function is integrated instead. Rarer intervals decide nothing.
MASS_TOLERANCE = 1e-3
RAREST_INTERVAL = 1e-10
# A polynomial whose mean square is this far from 1 is not normalised under the law.
MOMENT_TOLERANCE = 1e-2

# The most common bases: they are not changed by anyone, and take longer to set up than a small fit.
_hermite_basis = functools.lru_cache(maxsize=32)(PolynomialBasis)


@dataclasses.dataclass(frozen=True)
class PolynomialFamilies:
    """The families, orthonormal under a law with independent marginals, in the variables z = slope (x - centre).

    Attributes
    ----------
    law : :py:class:`openturns.Distribution`
        Of the inputs.
    members : list of :py:class:`openturns.OrthogonalUniVariatePolynomialFamily`
        Hermite for a normal marginal, for others what OpenTURNS has or computes.
    centre, slope : ndarray (d,)
    """

    law: ot.Distribution
    members: list
    centre: np.ndarray
    slope: np.ndarray

    __setstate__ = restoring(families="members")

    @staticmethod
    def of(law: ot.Distribution) -> "PolynomialFamilies":
        """The families of a law.

        Examples
        --------
        >>> import openturns as ot
        >>> from satsep_ot.methods.polynomials.families import PolynomialFamilies
        >>> PolynomialFamilies.of(ot.Normal([1.0, 2.0], [3.0, 4.0])).standardise([[4.0, 2.0]]).tolist()
        [[1.0, 0.0]]
        """
        law = ot.Distribution(law)
        centre, slope = _centre_and_slope(law)
        if _isNormal(law):
            return PolynomialFamilies(law, [ot.HermiteFactory()] * len(centre), centre, slope)
        members = []
        for i in range(len(centre)):
            marginal = law.getMarginal(i)
            if _isNormal(marginal):
                members.append(ot.HermiteFactory())
                continue
            member = ot.StandardDistributionPolynomialFactory(marginal)
            measure = member.getMeasure()
            # The mean and the standard deviation of z are then the ones of the family's own measure.
            slope[i] *= measure.getStandardDeviation()[0]
            centre[i] -= measure.getMean()[0] / slope[i]
            members.append(member)
        return PolynomialFamilies(law, members, centre, slope)

    def standardise(self, points: np.ndarray) -> np.ndarray:
        """Variables z (n, d) of inputs (n, d)."""
        return (np.asarray(points, dtype=float) - self.centre) * self.slope

    def basis(self, degree: int, norm: float) -> PolynomialBasis:
        """The basis of products of the families' polynomials."""
        if all(isinstance(member, ot.HermiteFactory) for member in self.members):
            return _hermite_basis(len(self.members), degree, norm)
        recurrence = np.array([_recurrence(member, degree) for member in self.members])
        return PolynomialBasis(len(self.members), degree, norm, recurrence)

    def checkMoments(self, basis: PolynomialBasis) -> None:
        """Refuse a basis that is not orthonormal under the law, whatever its recurrence says.

        Raises
        ------
        ValueError
            The distribution has no moments that high, as Student's with few degrees of freedom, or none that can be
            computed.
        """
        for variable, member in enumerate(self.members):
            degree = int(basis.indices[:, variable].max(initial=0))
            if isinstance(member, ot.HermiteFactory) or degree == 0:
                continue
            marginal = self.law.getMarginal(variable)
            univariate = PolynomialBasis(1, degree, recurrence=basis.recurrence[[variable], :degree])

            def highest(x, variable=variable, univariate=univariate):
                z = (x - self.centre[variable]) * self.slope[variable]
                return univariate.evaluate(z[:, None])[-1]

            with np.errstate(all="ignore"):
                square = _mean_square(highest, marginal)
            if not abs(square - 1.0) < MOMENT_TOLERANCE:
                raise ValueError(
                    f"Under the distribution {marginal} of input {variable} the polynomial of degree {degree} has the "
                    f"mean square {square:.3g} instead of 1: moments of order {2 * degree} do not exist or cannot be "
                    "computed. Lower the degree, or take the moments of getSample()."
                )


def _centre_and_slope(law):
    """Mean and reciprocal standard deviation of each marginal, or a sentence."""
    try:
        centre, deviation = np.array(law.getMean()), np.array(law.getStandardDeviation())
    except REFUSALS:
        centre = deviation = np.array(np.nan)
    if not (np.isfinite(centre).all() and np.isfinite(deviation).all()):
        raise ValueError(
            f"The distribution {law} has no finite mean and standard deviation, so that no polynomials are orthogonal "
            "under it: work in the standard space (ActiveSubspaceAlgorithm, RidgeApproximation), or leave it out."
        )
    return centre, 1.0 / deviation


def _isNormal(distribution):
    return isinstance(distribution.getImplementation(), ot.Normal)


def _recurrence(member, degree):
    if isinstance(member, ot.HermiteFactory):
        return hermite_recurrence(degree)
    return np.array([list(member.getRecurrenceCoefficients(order)) for order in range(degree)]).reshape(degree, 3)


def _mean_square(function, marginal):
    """E[f(X)^2] for a callable f, (n,) to (n,), and a univariate distribution of X."""
    levels = np.linspace(-FARTHEST_LEVEL, FARTHEST_LEVEL, INTERVALS + 1)
    edges = _normal_quantiles(marginal, levels)
    kept = np.isfinite(edges)
    levels, edges = levels[kept], edges[kept]
    nodes, weights = np.polynomial.legendre.leggauss(INTERVAL_NODES)
    half = 0.5 * np.diff(edges)[:, None]
    x = 0.5 * (edges[1:] + edges[:-1])[:, None] + half * nodes
    density = np.array(marginal.computePDF(ot.Sample(x.reshape(-1, 1)))).reshape(x.shape)
    mass = half * weights * density
    probability = np.diff(ndtr(levels))
    missed = np.abs(mass.sum(axis=1) - probability) > MASS_TOLERANCE * probability
    steep = np.flatnonzero(missed & (probability > RAREST_INTERVAL))
    if len(steep):
        half = 0.5 * np.diff(levels)[steep, None]
        inside = 0.5 * (levels[1:] + levels[:-1])[steep, None] + half * nodes
        x[steep] = _normal_quantiles(marginal, inside.ravel()).reshape(inside.shape)
        mass[steep] = half * weights * np.exp(-0.5 * inside**2) / math.sqrt(2.0 * math.pi)
    return float(function(x.ravel()) ** 2 @ mass.ravel())


def _normal_quantiles(marginal, levels):
    """Quantiles (n,) at increasing levels of a standard normal, each through the smaller tail."""
    tails = ot.Point(ndtr(-np.abs(levels)))
    below = np.count_nonzero(levels <= 0.0)
    lower, upper = marginal.computeQuantile(tails[:below]), marginal.computeQuantile(tails[below:], True)
    return np.concatenate([lower, upper])[:, 0]
