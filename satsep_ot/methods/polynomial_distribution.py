"""Law of a polynomial of up to three standard normals, from its roots instead of from samples."""

import numpy as np
import openturns as ot
from scipy import optimize, special

from satsep_ot.methods.polynomial_basis import PolynomialBasis, hermite_recurrence

# Outer nodes are z = s + OUTER_STRETCH s^3 for equal steps of s up to OUTER_RANGE: dense where the law has its mass,
# and out to 8.5, beyond which it carries less than 2e-17.
OUTER_RANGE = 4.5
OUTER_STRETCH = 0.0439
# Nodes of each outer variable: odd, so that every second node is a grid of its own, which gives the error.
OUTER_NODES = {1: 1, 2: 801, 3: 121}
# A pair of complex roots this close to the real axis is a double root up to rounding.
IMAGINARY_TOLERANCE = 1e-8
# Leading coefficients below this share of the largest only move roots beyond any probability.
LEADING_TOLERANCE = 1e-13


class PolynomialDistribution:
    """Distribution of p(Y), p a polynomial and Y independent standard normals, at most three.

    For one variable the sets {p <= t} are intervals between roots, and the probability is exact. For two or three
    the first variable is treated so, and the others by the trapezoidal rule, whose error is estimated.

    Parameters
    ----------
    result : :class:`~satsep_ot.methods.polynomial_regression.MultivariatePolynomialRegressionResult`
        A regression with the law ``ot.Normal(r)``, r = 1 to 3.
    output : int
        Which output.

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.polynomial_distribution import PolynomialDistribution
    >>> from satsep_ot.methods.polynomial_regression import MultivariatePolynomialRegression
    >>> inputs = np.linspace(-3.0, 3.0, 20)[:, None]
    >>> regression = MultivariatePolynomialRegression(inputs, inputs**2, ot.Normal(1))
    >>> regression.run()
    >>> law = PolynomialDistribution(regression.getResult())
    >>> print(round(law.computeCDF(1.0), 9), round(ot.ChiSquare(1.0).computeCDF(1.0), 9))
    0.682689492 0.682689492
    """

    def __init__(self, result, output=0):
        law = result.getDistribution()
        r = law.getDimension()
        if r > 3:
            raise ValueError(f"The law of a polynomial is computed for 1 to 3 variables, got {r}: use sampling.")
        if law != ot.Normal(r) and law != ot.JointDistribution([ot.Normal()] * r):
            raise ValueError(
                f"The polynomial must have independent standard normal variables, got {law}: "
                "give ot.Normal(r) to the regression."
            )
        coefficients = np.array(result.getCoefficients())
        if not 0 <= output < coefficients.shape[1]:
            raise ValueError(f"The output must be 0 to {coefficients.shape[1] - 1}, got {output}.")
        self._setUp(result.getIndices(), coefficients[:, output])

    def _setUp(self, indices, coefficients):
        """Power coefficients (nodes, degree + 1) in the first variable at each outer node, and node weights."""
        self._mean = float(coefficients[0])
        self._deviation = float(np.sqrt((coefficients[1:] ** 2).sum()))
        r, degree = indices.shape[1], int(indices.max())
        steps = np.linspace(-OUTER_RANGE, OUTER_RANGE, OUTER_NODES[r])
        nodes = steps + OUTER_STRETCH * steps**3
        weights = np.exp(-0.5 * nodes**2) * (1.0 + 3.0 * OUTER_STRETCH * steps**2)
        places = np.zeros((1, 0), dtype=int) if r == 1 else np.indices((len(nodes),) * (r - 1)).reshape(r - 1, -1).T
        grid = nodes[places]
        self._weights = weights[places].prod(axis=1)
        self._weights /= self._weights.sum()
        self._coarse = (places % 2 == 0).all(axis=1)
        outer = PolynomialBasis(r - 1, degree)
        position = {tuple(alpha): term for term, alpha in enumerate(outer.indices.tolist())}
        table = np.zeros((degree + 1, outer.size))
        for alpha, coefficient in zip(indices.tolist(), coefficients, strict=True):
            table[alpha[0], position[tuple(alpha[1:])]] = coefficient
        # Hermite to power basis by the recurrence itself.
        powers = np.zeros((degree + 1, degree + 1))
        powers[0, 0] = 1.0
        for order, (a, _, c) in enumerate(hermite_recurrence(degree)):
            powers[order + 1, 1:] = a * powers[order, :-1]
            if order:
                powers[order + 1] += c * powers[order - 1]
        self._power = (table @ outer.evaluate(grid)).T @ powers

    def __repr__(self):
        return f"PolynomialDistribution(mean={self._mean:.6g}, standardDeviation={self._deviation:.6g})"

    def getMean(self):
        """Mean of the polynomial."""
        return self._mean

    def getStandardDeviation(self):
        """Standard deviation of the polynomial."""
        return self._deviation

    def _roots(self, threshold):
        """Real roots (nodes, degree) of p - threshold in increasing order, filled up with inf."""
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
            roots[rows, :degree] = np.where(real, found.real, np.inf)
        roots.sort(axis=1)
        return roots, power

    def _integrate(self, values):
        """Weighted mean over the outer nodes, and the change that halving the grid makes."""
        fine = float(self._weights @ values)
        if len(self._weights) == 1:
            return fine, 0.0
        coarse = self._weights[self._coarse]
        return fine, abs(fine - float(coarse @ values[self._coarse]) / coarse.sum())

    def _probability(self, threshold, below):
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
        # The upper tail through the lower one, which keeps its digits.
        mass = np.where(
            left > 0.0, special.ndtr(-left) - special.ndtr(-right), special.ndtr(right) - special.ndtr(left)
        )
        inside = (value <= 0.0) if below else (value > 0.0)
        # An interval between two infinite fill-ins is empty.
        return self._integrate(np.where(inside & (left < np.inf), mass, 0.0).sum(axis=1))

    def computeCDF(self, threshold):
        """P(p(Y) <= threshold)."""
        return self._probability(threshold, True)[0]

    def computeComplementaryCDF(self, threshold):
        """P(p(Y) > threshold), not as a difference from 1."""
        return self._probability(threshold, False)[0]

    def computeCDFError(self, threshold):
        """Estimated error of both probabilities: what halving the outer grid changes; 0 for one variable."""
        return self._probability(threshold, True)[1]

    def computePDF(self, threshold):
        """Density at the threshold: sum over the roots of phi(root) / |p'(root)|, averaged over the outer variables.

        It is infinite where a root is double, as at the edge of the range of a square.
        """
        roots, power = self._roots(threshold)
        finite = np.isfinite(roots)
        place = np.where(finite, roots, 0.0)
        slope = np.zeros_like(place)
        for order in range(power.shape[1] - 1, 0, -1):
            slope = slope * place + order * power[:, order, None]
        with np.errstate(divide="ignore"):
            density = np.exp(-0.5 * place**2) / np.sqrt(2.0 * np.pi) / np.abs(slope)
        return self._integrate(np.where(finite, density, 0.0).sum(axis=1))[0]

    def computeQuantile(self, probability):
        """Smallest value that p(Y) does not exceed with the given probability, in (0, 1)."""
        if not 0.0 < probability < 1.0:
            raise ValueError(f"The probability of a quantile must be in (0, 1), got {probability}.")
        if self._deviation == 0.0:
            return self._mean
        width = self._deviation
        # Through the smaller tail, so that extreme quantiles keep their digits.
        upper = probability > 0.5

        def excess(t):
            return (1.0 - probability) - self.computeComplementaryCDF(t) if upper else self.computeCDF(t) - probability

        low, high = self._mean - width, self._mean + width
        while excess(low) > 0.0:
            width *= 2.0
            low -= width
        width = self._deviation
        while excess(high) < 0.0:
            width *= 2.0
            high += width
        return float(optimize.brentq(excess, low, high, xtol=1e-13 * (abs(low) + abs(high)), rtol=1e-13))
