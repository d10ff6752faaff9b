"""Law of a polynomial of up to three standard normals, from its roots instead of from samples."""

import functools
import math

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike
from scipy import optimize, special

from satsep_ot.methods.polynomials.basis import hermite_recurrence
from satsep_ot.methods.polynomials.regression_result import MultivariatePolynomialRegressionResult
from satsep_ot.openturns_object import OpenTURNSObject

# Lines through the origin, evenly over the half circle, for two variables; a multiple of 4.
PLANE_LINES = 512
# Gauss-Legendre nodes of the polar and trapezoidal nodes of the azimuthal angle for three variables.
POLAR_NODES = 56
AZIMUTH_NODES = 112
# Half width, in standard deviations, of the difference that stands in for a density.
DENSITY_STEP = 0.02
# A density with a smaller relative error needs no other way.
CERTAIN_DENSITY = 1e-9
DRAWN_POINTS = 129
# Probability on each side of what is called the range.
RANGE_TAIL = 1e-15
# No probability that a double can hold lies beyond; roots there would only spoil the signs between them.
FARTHEST = 40.0
# A pair of complex roots this close to the real axis is a double root up to rounding.
IMAGINARY_TOLERANCE = 1e-8
# Leading coefficients below this share of the largest only move roots beyond any probability.
LEADING_TOLERANCE = 1e-13


def _each(method):
    """A method of a number that takes arrays too: an array of the same shape comes out."""

    @functools.wraps(method)
    def every(self, value, *others):
        if np.ndim(value) == 0:
            return method(self, float(value), *others)
        values = np.asarray(value, dtype=float)
        return np.array([method(self, float(one), *others) for one in values.ravel()]).reshape(values.shape)

    return every


class PolynomialDistribution(OpenTURNSObject):
    """Distribution of p(Y), p a polynomial and Y independent standard normals, at most three.

    On every line through the origin the sets {p <= t} are intervals between roots, whose probability given the
    line is known. For one variable that is all; for two or three the lines are averaged: by the trapezoidal rule on
    the half circle, by Gauss-Legendre times trapezoidal rule on the half sphere. Both converge fast unless lines
    touch the set's boundary where it matters.

    The error stated is the largest deviation of coarser rules from the result: four interleaved rules of a quarter
    of the lines in the plane, three with half the resolution and the poles on different axes in space.

    Notes
    -----
    It is the integral that directional simulation (Bjerager, J. Eng. Mech. 114, 1988) samples.

    Parameters
    ----------
    result : :class:`~satsep_ot.methods.polynomials.regression_result.MultivariatePolynomialRegressionResult`
        A regression with the law ``ot.Normal(r)``, r = 1 to 3.
    output : int
        Which output.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.polynomials.distribution import PolynomialDistribution
    >>> from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
    >>> inputs = np.linspace(-3.0, 3.0, 20)[:, None]
    >>> regression = MultivariatePolynomialRegression(inputs, inputs**2, ot.Normal(1))
    >>> regression.run()
    >>> law = PolynomialDistribution(regression.getResult())
    >>> print(round(law.computeCDF(1.0), 9), round(ot.ChiSquare(1.0).computeCDF(1.0), 9))
    0.682689492 0.682689492
    """

    def __init__(self, result: MultivariatePolynomialRegressionResult, output: int = 0) -> None:
        law = result.getDistribution()
        r = law.getDimension()
        if r > 3:
            raise ValueError(
                f"The distribution of a polynomial is computed for 1 to 3 variables, got {r}: use sampling."
            )
        if law != ot.Normal(r) and law != ot.JointDistribution([ot.Normal()] * r):
            raise ValueError(
                f"The polynomial must have independent standard normal variables, got {law}: "
                "give ot.Normal(r) to the regression."
            )
        self._polynomial, self._output = result, output
        coefficients = np.array(result.getCoefficients())
        if not 0 <= output < coefficients.shape[1]:
            raise ValueError(f"The output is {output}; it must be 0 to {coefficients.shape[1] - 1}.")
        indices, coefficients = result.getIndices(), coefficients[:, output]
        self._mean = float(coefficients[0])
        self._deviation = float(np.sqrt((coefficients[1:] ** 2).sum()))
        self._dimension = r
        directions, self._rules = _lines(r)
        self._power = _line_powers(indices, coefficients, directions)

    def _shown(self):
        return {"mean": f"{self._mean:.6g}", "standardDeviation": f"{self._deviation:.6g}"}

    def getMean(self) -> float:
        """Mean of the polynomial."""
        return self._mean

    def getStandardDeviation(self) -> float:
        """Standard deviation of the polynomial."""
        return self._deviation

    def _roots(self, threshold):
        """Real roots (lines, degree) of p - threshold along each line in increasing order, filled up with inf."""
        if math.isnan(threshold):
            raise ValueError("The threshold of a probability is nan; it must be a number.")
        power = self._power.copy()
        power[:, 0] -= threshold
        count, size = power.shape
        roots = np.full((count, max(size - 1, 1)), np.inf)
        significant = np.abs(power) > LEADING_TOLERANCE * np.abs(power).max(axis=1, keepdims=True)
        degrees = np.where(significant.any(axis=1), size - 1 - significant[:, ::-1].argmax(axis=1), 0)
        for degree in range(1, size):
            rows = np.flatnonzero(degrees == degree)
            if not len(rows):
                continue
            companion = np.zeros((len(rows), degree, degree))
            companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
            companion[:, :, -1] = -power[rows, :degree] / power[rows, degree, None]
            found = np.linalg.eigvals(companion)
            real = np.abs(found.imag) <= IMAGINARY_TOLERANCE * (1.0 + np.abs(found.real))
            real &= np.abs(found.real) < FARTHEST
            roots[rows, :degree] = np.where(real, found.real, np.inf)
        roots.sort(axis=1)
        return roots, power

    def _average(self, values):
        """Mean over the lines by the finest rule, and the largest deviation of the coarser ones."""
        fine, *coarse = (float(weights @ values[lines]) for lines, weights in self._rules)
        return fine, max((abs(other - fine) for other in coarse), default=0.0)

    def _tail(self, radius):
        """Probability of one side of a line beyond a radius >= 0: half the tail of a chi variable."""
        if self._dimension == 2:
            return 0.5 * np.exp(-0.5 * radius**2)
        tail = special.ndtr(-radius)
        if self._dimension == 3:
            with np.errstate(invalid="ignore"):
                tail += np.where(np.isinf(radius), 0.0, radius * np.exp(-0.5 * radius**2) / math.sqrt(2.0 * math.pi))
        return tail

    def _probability(self, threshold, below):
        return self._average(self._masses(threshold, below))

    def _masses(self, threshold, below):
        """Probability (lines,) of {p <= t} or of {p > t} given each line."""
        roots, power = self._roots(threshold)
        edges = np.concatenate([np.full((len(roots), 1), -np.inf), roots, np.full((len(roots), 1), np.inf)], axis=1)
        left, right = edges[:, :-1], edges[:, 1:]
        # A point inside each interval, where the sign of p - t is safe.
        with np.errstate(invalid="ignore"):
            middle = np.where(np.isinf(left), np.where(np.isinf(right), 0.0, right - 1.0), 0.5 * (left + right))
            middle = np.where(np.isinf(right) & ~np.isinf(left), left + 1.0, middle)
        value = np.zeros_like(middle)
        for coefficient in power.T[::-1]:
            value = value * middle + coefficient[:, None]
        # As differences of tails, which keep their digits, unless the interval contains the origin.
        tails = self._tail(np.abs(edges))
        first, last = tails[:, :-1], tails[:, 1:]
        mass = np.where((left < 0.0) & (right > 0.0), 1.0 - first - last, np.abs(first - last))
        inside = (value <= 0.0) if below else (value > 0.0)
        # An interval between two infinite fill-ins is empty.
        return np.where(inside & (left < np.inf), mass, 0.0).sum(axis=1)

    @_each
    def computeCDF(self, threshold: ArrayLike) -> float | np.ndarray:
        """P(p(Y) <= threshold) for a number, or for each one of an array."""
        return self._probability(threshold, True)[0]

    @_each
    def computeComplementaryCDF(self, threshold: ArrayLike) -> float | np.ndarray:
        """P(p(Y) > threshold), not as a difference from 1."""
        return self._probability(threshold, False)[0]

    @_each
    def computeSurvivalFunction(self, threshold: ArrayLike) -> float | np.ndarray:
        """P(p(Y) > threshold), as :meth:`computeComplementaryCDF`."""
        return self._probability(threshold, False)[0]

    @_each
    def computeCDFError(self, threshold: ArrayLike) -> float | np.ndarray:
        """Error of both probabilities, the largest deviation of coarser rules; for one variable 0, up to rounding."""
        probability, error = self._probability(threshold, True)
        # The deviations of the smaller probability, where they are not lost beside 1.
        return error if probability < 0.5 else self._probability(threshold, False)[1]

    @_each
    def computePDF(self, threshold: ArrayLike) -> float | np.ndarray:
        """Density at the threshold.

        It is the sum over the roots of their density along the line / ``|p'(root)|``, averaged over the lines. Where
        that converges badly, since lines touch the boundary, it is a centred difference of the probability over
        0.02 standard deviations instead. It is infinite where a root is double for one variable, as at the edge of
        the range of a square.
        """
        return self._density(threshold)[0]

    @_each
    def computePDFError(self, threshold: ArrayLike) -> float | np.ndarray:
        """Error of the density, the largest deviation of coarser rules; for one variable 0, up to rounding."""
        return self._density(threshold)[1]

    def _density(self, threshold):
        roots, power = self._roots(threshold)
        finite = np.isfinite(roots)
        place = np.where(finite, roots, 0.0)
        slope = np.zeros_like(place)
        for order in range(power.shape[1] - 1, 0, -1):
            slope = slope * place + order * power[:, order, None]
        scale = 2.0 if self._dimension == 2 else math.sqrt(2.0 * math.pi)
        along = np.abs(place) ** (self._dimension - 1) * np.exp(-0.5 * place**2) / scale
        with np.errstate(divide="ignore"):
            density = np.where(finite & (along > 0.0), along / np.abs(slope), 0.0)
        density, error = self._average(density.sum(axis=1))
        step = DENSITY_STEP * self._deviation
        if self._dimension == 1 or not step > 0.0 or error <= CERTAIN_DENSITY * density:
            return density, error
        below = threshold < self._mean
        near, far = (
            self._masses(threshold + width, below) - self._masses(threshold - width, below)
            for width in (step, 2.0 * step)
        )
        sign = 1.0 if below else -1.0
        difference, differenceError = self._average(sign * near / (2.0 * step))
        # Richardson: the error of the difference is a third of what doubling its step changes.
        differenceError += abs(difference - self._average(sign * far / (4.0 * step))[0]) / 3.0
        return (density, error) if error <= differenceError else (difference, differenceError)

    def computeQuantile(self, probability: ArrayLike, tail: bool = False) -> float | np.ndarray:
        """Smallest value that p(Y) does not exceed with the given probability, in (0, 1).

        Parameters
        ----------
        probability : float or array of float
        tail : bool
            Whether it is the probability of larger values.
        """
        return self._quantile(probability, tail)

    @_each
    def _quantile(self, probability, tail):
        if not 0.0 < probability < 1.0:
            raise ValueError(f"The probability of a quantile is {probability}; it must be in (0, 1).")
        if self._deviation == 0.0:
            return self._mean
        width = self._deviation
        # Through the smaller tail, so that extreme quantiles keep their digits.
        upper = (probability > 0.5) != tail
        smaller = 1.0 - probability if probability > 0.5 else probability

        def excess(t):
            return smaller - self._probability(t, False)[0] if upper else self._probability(t, True)[0] - smaller

        low, high = self._mean - width, self._mean + width
        while excess(low) > 0.0:
            width *= 2.0
            low -= width
        width = self._deviation
        while excess(high) < 0.0:
            width *= 2.0
            high += width
        return float(optimize.brentq(excess, low, high, xtol=1e-13 * (abs(low) + abs(high)), rtol=1e-13))

    def getMoment(self, order: int) -> float:
        """E[p(Y)^order], exact but for rounding, for a whole number >= 0."""
        return self._moment(order, 0.0)

    def getCentralMoment(self, order: int) -> float:
        """E[(p(Y) - mean)^order], exact but for rounding, for a whole number >= 0."""
        return self._moment(order, self._mean)

    def _moment(self, order, centre):
        if int(order) != order or order < 0:
            raise ValueError(f"The order of a moment is {order}; it must be a whole number of at least 0.")
        # Gauss' rule of n nodes is exact up to the degree 2 n - 1.
        nodes, weights = np.polynomial.hermite_e.hermegauss(self._polynomial.getDegree() * int(order) // 2 + 1)
        grids = np.meshgrid(*[nodes] * self._dimension, indexing="ij")
        shares = functools.reduce(np.multiply.outer, [weights / weights.sum()] * self._dimension)
        values = self._polynomial.evaluate(np.column_stack([grid.ravel() for grid in grids]))[:, self._output]
        return float((values - centre) ** int(order) @ shares.ravel())

    def getSkewness(self) -> float:
        """Third central moment over the cube of the standard deviation."""
        return self._shape(3)

    def getKurtosis(self) -> float:
        """Fourth central moment over the fourth power of the standard deviation."""
        return self._shape(4)

    def _shape(self, order):
        if self._deviation == 0.0:
            raise ValueError("The polynomial is constant: it has no skewness and no kurtosis.")
        return self.getCentralMoment(order) / self._deviation**order

    def getSample(self, size: int) -> ot.Sample:
        """Values of the polynomial at standard normal points from ``ot.RandomGenerator``, a Sample (size, 1)."""
        points = np.array(ot.DistFunc.rNormal(size * self._dimension)).reshape(size, self._dimension)
        return ot.Sample(self._polynomial.evaluate(points)[:, [self._output]])

    def getRange(self) -> ot.Interval:
        """Interval outside of which p(Y) is with a probability of 2e-15."""
        return ot.Interval(self.computeQuantile(RANGE_TAIL), self.computeQuantile(RANGE_TAIL, True))

    def getDistribution(self) -> ot.Distribution:
        """The same as an :py:class:`openturns.Distribution`: for random vectors, joint distributions, Sobol indices.

        It is a Dirac distribution where the polynomial is constant.

        Examples
        --------
        >>> import numpy as np
        >>> import openturns as ot
        >>> from satsep_ot import MultivariatePolynomialRegression, PolynomialDistribution
        >>> inputs = np.linspace(-3.0, 3.0, 20)[:, None]
        >>> regression = MultivariatePolynomialRegression(inputs, inputs**2, ot.Normal(1))
        >>> regression.run()
        >>> law = PolynomialDistribution(regression.getResult()).getDistribution()
        >>> joint = ot.JointDistribution([law, ot.Normal()])
        >>> print(round(joint.computeCDF([1.0, 0.0]), 9))
        0.341344746
        """
        return ot.Distribution(ot.Dirac(self._mean) if self._deviation == 0.0 else _PolynomialLaw(self))

    def drawPDF(self, level: float = 0.999) -> ot.Graph:
        """Density between the quantiles that hold the middle ``level``, :py:class:`openturns.Graph`."""
        # Midpoints of cells: at the edge of its range the density of a square is infinite.
        points = self._cells(level)
        return _curve("Density of the polynomial", "density", points, self.computePDF(points))

    def drawCDF(self, level: float = 0.999) -> ot.Graph:
        """Probability not to exceed each value between the quantiles of the middle ``level``."""
        points = self._cells(level)
        return _curve("Distribution of the polynomial", "probability", points, self.computeCDF(points))

    def _cells(self, level):
        """Midpoints of equal cells between the quantiles of the middle level, ndarray (n,)."""
        if not 0.0 < level < 1.0:
            raise ValueError(f"The level is {level}; it must be in (0, 1).")
        lower, upper = (self.computeQuantile(0.5 * (1.0 + sign * level)) for sign in (-1.0, 1.0))
        return lower + (np.arange(DRAWN_POINTS) + 0.5) * (upper - lower) / DRAWN_POINTS


def _curve(title, axis, points, values):
    graph = ot.Graph(title, "value", axis, True, "")
    graph.add(ot.Curve(points, values))
    return graph


class _PolynomialLaw(ot.PythonDistribution):
    """What OpenTURNS asks of a distribution, of a :class:`PolynomialDistribution`."""

    def __init__(self, law):
        super().__init__(1)
        self._law = law

    def getRange(self):
        return self._law.getRange()

    def computeCDF(self, X):
        return self._law.computeCDF(X[0])

    def computeComplementaryCDF(self, X):
        return self._law.computeComplementaryCDF(X[0])

    def computeSurvivalFunction(self, X):
        return self._law.computeComplementaryCDF(X[0])

    def computePDF(self, X):
        return self._law.computePDF(X[0])

    def computeScalarQuantile(self, probability, tail=False):
        return self._law.computeQuantile(probability, tail)

    def computeQuantile(self, probability, tail=False):
        return [self._law.computeQuantile(probability, tail)]

    def getRealization(self):
        return self._law.getSample(1)[0]

    def getSample(self, size):
        return self._law.getSample(size)

    def getMean(self):
        return [self._law.getMean()]

    def getStandardDeviation(self):
        return [self._law.getStandardDeviation()]

    def getSkewness(self):
        return [self._law.getSkewness()]

    def getKurtosis(self):
        return [self._law.getKurtosis()]

    def getMoment(self, order):
        return [self._law.getMoment(order)]

    def getCentralMoment(self, order):
        return [self._law.getCentralMoment(order)]

    def isContinuous(self):
        return True

    def isDiscrete(self):
        return False

    def isIntegral(self):
        return False


def _line_powers(indices, coefficients, directions):
    """Power coefficients (lines, degree + 1) of a Hermite polynomial along each line through the origin."""
    dimension, degree = indices.shape[1], int(indices.max())
    # Hermite to power basis by the recurrence itself.
    powers = np.zeros((degree + 1, degree + 1))
    powers[0, 0] = 1.0
    for order, (a, _, c) in enumerate(hermite_recurrence(degree)):
        powers[order + 1, 1:] = a * powers[order, :-1]
        if order:
            powers[order + 1] += c * powers[order - 1]
    monomials = np.zeros((degree + 1,) * dimension)
    monomials[tuple(indices.T)] = coefficients
    for _ in range(dimension):
        # The first axis is transformed and goes last: after as many turns every axis is back in its place.
        monomials = np.tensordot(monomials, powers, axes=(0, 0))
    exponents = np.indices(monomials.shape).reshape(dimension, -1).T
    total = exponents.sum(axis=1)
    result = np.zeros((len(directions), degree + 1))
    for exponent, order, value in zip(
        exponents[total <= degree], total[total <= degree], monomials.ravel()[total <= degree], strict=True
    ):
        result[:, order] += value * (directions**exponent).prod(axis=1)
    return result


@functools.cache
def _lines(dimension):
    """Directions (lines, dimension) and rules, the finest first: pairs of a selection of lines and its weights."""
    if dimension == 1:
        return np.ones((1, 1)), [(slice(None), np.ones(1))]
    if dimension == 2:
        # Off the axes: functions of one variable alone have boundaries that the axes never meet.
        angles = (np.arange(PLANE_LINES) + 0.5) * math.pi / PLANE_LINES
        rules = [(slice(None), np.full(PLANE_LINES, 1.0 / PLANE_LINES))]
        rules += [(slice(i, None, 4), np.full(PLANE_LINES // 4, 4.0 / PLANE_LINES)) for i in range(4)]
        return np.column_stack([np.cos(angles), np.sin(angles)]), rules
    directions, rules = [], []
    start = 0
    for polar, azimuth, axis in (
        (POLAR_NODES, AZIMUTH_NODES, 0),
        *((POLAR_NODES // 2, AZIMUTH_NODES // 2, k) for k in range(3)),
    ):
        heights, weights = np.polynomial.legendre.leggauss(polar)
        heights, weights = heights[polar // 2 :], weights[polar // 2 :]
        angles = (np.arange(azimuth) + 0.5) * 2.0 * math.pi / azimuth
        height, angle = (grid.ravel() for grid in np.meshgrid(heights, angles, indexing="ij"))
        radius = np.sqrt(1.0 - height**2)
        some = np.column_stack([height, radius * np.cos(angle), radius * np.sin(angle)])
        directions.append(np.roll(some, axis, axis=1))
        rules.append((slice(start, start + len(some)), np.repeat(weights / azimuth, azimuth)))
        start += len(some)
    return np.concatenate(directions), rules
