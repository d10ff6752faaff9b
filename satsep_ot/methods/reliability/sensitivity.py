"""The failure distribution as weighted points: what the true runs of one probability say of any other expectation.

The sum of the weights times ``h`` estimates ``E[1_F h(X)]``. With ``h = 1`` that is the probability itself, with the
score of a parameter its derivative, with a ratio of densities the probability under other distributions of the inputs:
all from the same runs (Rubinstein, The score function approach for sensitivity analysis of computer simulation models,
Mathematics and Computers in Simulation 28, 1986).
"""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import openturns as ot
from scipy import stats
from scipy.special import ndtri

from satsep_ot.methods.common.intervals import ConfidenceInterval, logNormalInterval
from satsep_ot.openturns_adapter import parameterNames

# Change of the logarithm of a density between the two points of a difference: its square and the rounding are small.
_LOG_DENSITY_STEP = 1e-4
_LEVELS = np.array([0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.98])
# A bound that moves may carry this share of the largest density and still be no jump.
_SMALLEST_JUMP = 1e-3
_LEGENDRE_DEGREE = 3
# Re-weighted runs are trusted down to this effective number of failures.
_SMALLEST_EFFECTIVE_SIZE = 20.0


@dataclasses.dataclass
class FailureSample:
    """Weighted points, in groups of independent draws of one distribution.

    Attributes
    ----------
    x : array (n, d)
        Physical inputs.
    weights : array (n,)
        May be negative: a control variate is subtracted where the truth is added.
    leastVariances : array (n,)
        Smallest variance of each point's weight; 0 where the sample's own variance says all.
    groups : array (n,) of int
    inflation : array (g,)
        Factor on the sample variance of each group.
    common : array (g,)
        Squared coefficient of variation of a factor that all weights of a group share.
    failed : array (n,) of bool
        True runs that failed.
    ratios : array (n,)
        Density of the inputs over the density that a true run was drawn from; 0 for points that are no true runs.

    Examples
    --------
    >>> import numpy as np
    >>> from satsep_ot.methods.reliability.sensitivity import FailureSample
    >>> x = np.array([[1.0], [2.0], [3.0], [4.0]])
    >>> sample = FailureSample.ofMonteCarlo(x, np.array([False, False, True, True]))
    >>> sample.expectation(x[:, 0])[0]
    1.75
    """

    x: np.ndarray
    weights: np.ndarray
    leastVariances: np.ndarray
    groups: np.ndarray
    inflation: np.ndarray
    common: np.ndarray
    failed: np.ndarray
    ratios: np.ndarray

    @staticmethod
    def ofGroup(
        x: np.ndarray,
        weights: np.ndarray,
        leastVariances: np.ndarray,
        failed: np.ndarray,
        ratios: np.ndarray,
        inflation: float = 1.0,
        common: float = 0.0,
    ) -> "FailureSample":
        """A sample of one group."""
        groups = np.zeros(len(x), dtype=int)
        return FailureSample(
            x, weights, leastVariances, groups, np.array([inflation]), np.array([common]), failed, ratios
        )

    @staticmethod
    def ofMonteCarlo(x: np.ndarray, failed: np.ndarray) -> "FailureSample":
        """The sample of runs drawn from the inputs' own distribution."""
        n = len(x)
        return FailureSample.ofGroup(x, failed / n, np.zeros(n), failed, np.ones(n))

    @staticmethod
    def union(parts: Sequence["FailureSample"]) -> "FailureSample":
        """The groups of all parts, whose weights add up."""
        joined = {
            field.name: np.concatenate([getattr(part, field.name) for part in parts])
            for field in dataclasses.fields(FailureSample)
        }
        first = np.cumsum([0] + [len(part.inflation) for part in parts])
        joined["groups"] = np.concatenate([part.groups + start for part, start in zip(parts, first, strict=False)])
        return FailureSample(**joined)

    def expectation(self, h: np.ndarray) -> tuple[float, float, float]:
        """Estimate of ``E[1_F h(X)]``, its variance, and the degrees of freedom of that (Satterthwaite).

        Parameters
        ----------
        h : array (n,)
            Values at the points.
        """
        terms = self.weights * h
        variance, contributions = 0.0, []
        least = self.leastVariances * h**2
        observed = 0.0
        order = np.argsort(self.groups, kind="stable")
        ends = np.searchsorted(self.groups, np.arange(1, len(self.inflation)), sorter=order)
        members = zip(np.split(terms[order], ends), np.split(least[order], ends), strict=True)
        for (own, ownLeast), inflation, common in zip(members, self.inflation, self.common, strict=True):
            squares = (own - own.mean()) ** 2 * len(own) / max(len(own) - 1, 1)
            contributions.append(squares + ownLeast)
            if ownLeast.any():
                observed += float(squares.sum())
            else:
                variance += inflation * float(squares.sum())
            variance += common * float(own.sum()) ** 2
        # Runs that happened to agree with the surrogate do not make it more certain than it said that it was.
        variance += max(observed, float(least.sum()))
        contributions = np.concatenate(contributions)
        squared = float((contributions**2).sum())
        freedom = max(float(contributions.sum()) ** 2 / squared, 1.0) if squared > 0.0 else math.inf
        return float(terms.sum()), variance, freedom

    def interval(self, h: np.ndarray, level: float) -> tuple[float, float, float]:
        """Estimate and bounds of ``E[1_F h(X)]``."""
        value, variance, freedom = self.expectation(h)
        half = float(stats.t.ppf(0.5 + 0.5 * level, freedom)) * math.sqrt(variance)
        return value, value - half, value + half


@dataclasses.dataclass(frozen=True)
class ParameterSensitivity:
    """Derivative of the probability with respect to a parameter of an input's distribution.

    Attributes
    ----------
    input, parameter : str
    value : float
        Of the parameter.
    derivative, lower, upper : float or None
        Of the probability, per unit of the parameter, with its interval. None where ``note`` says why there is none.
    elasticity : float or None
        Relative change of the probability for a change of the parameter by one standard deviation of the input.
    note : str
    """

    input: str
    parameter: str
    value: float
    derivative: float | None = None
    lower: float | None = None
    upper: float | None = None
    elasticity: float | None = None
    note: str = ""


@dataclasses.dataclass(frozen=True)
class InputImportance:
    """What failure tells of one input, in standard deviations of its standard normal image ``Phi^-1(F(x))``.

    Attributes
    ----------
    input : str
    share : float
        Share in the sum, over the inputs, of the relative entropy between the input's distribution in failure and its
        distribution, both taken as normal, with a squared spread of at least its standard error. For a linear limit
        state of independent inputs these are about the squared importance factors of FORM; unlike these they see
        failures on both sides.
    shift, shiftLower, shiftUpper : float
        Mean in failure: 0 for an input that does not matter.
    spread, spreadLower, spreadUpper : float
        Standard deviation in failure: 1 for an input that does not matter, above 1 where both tails fail.
    """

    input: str
    share: float
    shift: float
    shiftLower: float
    shiftUpper: float
    spread: float
    spreadLower: float
    spreadUpper: float


@dataclasses.dataclass(frozen=True)
class ReweightedProbability:
    """The probability under another distribution of the inputs, from the runs made for the first one.

    Attributes
    ----------
    probability, lower, upper : float
    coefficientOfVariation : float
    effectiveSampleSize : float
        Of the failed true runs under the new weights.
    warning : str
        Why the runs do not carry the answer; empty when they do.
    """

    probability: float
    lower: float
    upper: float
    coefficientOfVariation: float
    effectiveSampleSize: float
    warning: str


def computeParameterSensitivity(
    sample: FailureSample, distribution: ot.Distribution, level: float
) -> list[ParameterSensitivity]:
    """Derivatives of the probability with respect to every parameter of every marginal, the copula held fixed.

    The derivative is ``E[1_F s(X)]`` with the score ``s``, the derivative of the logarithm of the joint density, by
    central differences. Where a parameter moves a bound at which the density jumps there is no score; the bounds of an
    independent uniform input are treated by the probability of failure at the bound, from the Legendre expansion of
    degree 3 of the input's distribution in failure.
    """
    probability = float(sample.weights.sum())
    names = distribution.getDescription()
    copula = None if distribution.hasIndependentCopula() else distribution.getCopula()
    uniforms = None if copula is None else _marginalLevels(distribution, sample.x)
    table = []
    for index in range(distribution.getDimension()):
        marginal = distribution.getMarginal(index)
        column = sample.x[:, [index]]
        deviation = marginal.getStandardDeviation()[0]
        for place, (name, value) in enumerate(
            zip(parameterNames(marginal, index), marginal.getParameter(), strict=True)
        ):
            try:
                score = _score(marginal, place, column, copula, uniforms, index)
            except ValueError as error:
                table.append(ParameterSensitivity(names[index], name, value, note=str(error)))
                continue
            derivative, lower, upper = sample.interval(score, level)
            elasticity = derivative * deviation / probability if probability > 0.0 else None
            table.append(ParameterSensitivity(names[index], name, value, derivative, lower, upper, elasticity))
    return table


def _score(marginal, place, column, copula, uniforms, index):
    """Derivative (n,) of the logarithm of the joint density; a ValueError says why it does not exist."""
    if isinstance(marginal.getImplementation(), ot.Uniform):
        if copula is not None:
            raise ValueError("the bound of a uniform input that depends on others has no score")
        return _uniformScore(marginal, place, column)
    low, high, step = _moved(marginal, place)
    jump = _jump(marginal, low, high)
    if jump:
        raise ValueError(jump)
    score = np.array(high.computeLogPDF(column))[:, 0] - np.array(low.computeLogPDF(column))[:, 0]
    if copula is not None:
        for sign, moved in ((1.0, high), (-1.0, low)):
            shifted = uniforms.copy()
            shifted[:, index] = np.clip(np.array(moved.computeCDF(column))[:, 0], 1e-15, 1.0 - 1e-15)
            score = score + sign * np.array(copula.computeLogPDF(shifted))[:, 0]
    # A point that leaves the support when a bound moves is no failure of the score but of the difference.
    return np.where(np.isfinite(score), score, 0.0) / (2.0 * step)


def _moved(marginal, place):
    """The marginal with the parameter a little smaller and larger, and the step: chosen by what it does."""
    values = np.array(marginal.getParameter())
    quantiles = [marginal.computeQuantile(level)[0] for level in _LEVELS]
    points = np.array(quantiles)[:, None]
    step = 1e-6 * max(abs(values[place]), marginal.getStandardDeviation()[0])
    for _ in range(3):
        pair = []
        for sign in (-1.0, 1.0):
            changed = ot.Distribution(marginal)
            parameter = values.copy()
            parameter[place] += sign * step
            try:
                changed.setParameter(parameter)
            except (TypeError, RuntimeError, ValueError) as error:
                raise ValueError("the parameter cannot be changed by itself") from error
            pair.append(changed)
        low, high = pair
        change = np.array(high.computeLogPDF(points)) - np.array(low.computeLogPDF(points))
        largest = np.abs(change[np.isfinite(change)]).max(initial=0.0)
        if largest == 0.0:
            raise ValueError("the density does not depend on the parameter")
        if 0.2 < largest / _LOG_DENSITY_STEP < 5.0:
            break
        step *= _LOG_DENSITY_STEP / largest
    return low, high, step


def _jump(marginal, low, high):
    """Why there is no score: a bound that moves, at which the density is not small; empty where there is one."""
    width = marginal.computeQuantile(0.99)[0] - marginal.computeQuantile(0.01)[0]
    largest = max(marginal.computePDF(marginal.computeQuantile(level)) for level in _LEVELS)
    ranges = [distribution.getRange() for distribution in (low, high)]
    for side, finite, sign in (("Lower", "getFiniteLowerBound", 1.0), ("Upper", "getFiniteUpperBound", -1.0)):
        if not getattr(marginal.getRange(), finite)()[0]:
            continue
        bounds = [getattr(both, f"get{side}Bound")()[0] for both in ranges]
        inside = getattr(marginal.getRange(), f"get{side}Bound")()[0] + sign * 1e-6 * width
        if bounds[0] != bounds[1] and marginal.computePDF(inside) > _SMALLEST_JUMP * largest:
            return f"the {side.lower()} bound moves with the parameter, and the density jumps there"
    return ""


def _uniformScore(marginal, place, column):
    a, b = marginal.getParameter()
    # The distribution of v in failure at its end: the sum of phi_k(end) E[phi_k(v) | F], phi_k orthonormal on [0, 1].
    v = 2.0 * (column[:, 0] - a) / (b - a) - 1.0
    end = (-1.0, 1.0)[place]
    coefficients = [(2 * k + 1) * end**k if k else 0.0 for k in range(_LEGENDRE_DEGREE + 1)]
    return end * np.polynomial.legendre.legval(v, coefficients) / (b - a)


def _marginalLevels(distribution, x):
    """``F_i(x_i)`` of every input, within (0, 1): (n, d)."""
    columns = [
        np.array(distribution.getMarginal(i).computeCDF(x[:, [i]]))[:, 0] for i in range(distribution.getDimension())
    ]
    return np.clip(np.column_stack(columns), 1e-15, 1.0 - 1e-15)


def _marginalNormals(distribution, x):
    """``Phi^-1(F_i(x_i))`` of every input, each tail through the function that does not round it: (n, d)."""
    columns = []
    for i in range(distribution.getDimension()):
        marginal = distribution.getMarginal(i)
        lower = np.maximum(np.array(marginal.computeCDF(x[:, [i]]))[:, 0], 1e-300)
        upper = 1.0 - lower
        high = lower > 0.49
        if high.any():
            upper[high] = np.maximum(np.array(marginal.computeComplementaryCDF(x[high, i][:, None]))[:, 0], 1e-300)
        columns.append(np.where(lower < upper, ndtri(lower), -ndtri(upper)))
    return np.column_stack(columns)


def computeImportance(sample: FailureSample, distribution: ot.Distribution, level: float) -> list[InputImportance]:
    """Importance of each input, see `InputImportance`; in the order of the inputs.

    Raises
    ------
    RuntimeError
        The corrections of the surrogate leave no positive estimate.
    """
    probability = float(sample.weights.sum())
    if not probability > 0.0:
        raise RuntimeError(f"there is no importance: the estimate, {probability:.3g}, is not positive")
    z = _marginalNormals(distribution, sample.x)
    found, entropies = [], []
    for index in range(z.shape[1]):
        # Deviations from the ratio's own value give its variance.
        shift = float((sample.weights * z[:, index]).sum()) / probability
        _, low, high = sample.interval(z[:, index] - shift, level)
        square = float((sample.weights * (z[:, index] - shift) ** 2).sum()) / probability
        deviations = (z[:, index] - shift) ** 2 - square
        _, squareLow, squareHigh = sample.interval(deviations, level)
        spreads = [math.sqrt(max(square + bound / probability, 0.0)) for bound in (0.0, squareLow, squareHigh)]
        found.append((shift, shift + low / probability, shift + high / probability, *spreads))
        # A squared spread below its own error is not known to be so small, and its logarithm would outweigh all else.
        error = math.sqrt(sample.expectation(deviations)[1]) / probability
        known = max(spreads[0], math.sqrt(error), 1e-3)
        entropies.append(0.5 * (shift**2 + known**2 - 1.0) - math.log(known))
    total = sum(entropies)
    shares = [entropy / total if total > 0.0 else 0.0 for entropy in entropies]
    names = distribution.getDescription()
    return [InputImportance(name, share, *row) for name, share, row in zip(names, shares, found, strict=True)]


def computeProbability(
    sample: FailureSample, distribution: ot.Distribution, other: ot.Distribution, level: float
) -> ReweightedProbability:
    """The probability under another distribution of the inputs by re-weighting, see `ReweightedProbability`.

    Raises
    ------
    ValueError
        The other distribution has another dimension, or values that the first one excludes.
    """
    d = distribution.getDimension()
    if other.getDimension() != d:
        raise ValueError(f"the distribution has {other.getDimension()} inputs; the event has {d}")
    _checkSupport(distribution, other)
    logRatio = _logRatio(distribution, other, sample.x)
    ratio = np.exp(np.minimum(np.where(np.isfinite(logRatio), logRatio, -np.inf), 700.0))
    value, variance, freedom = sample.expectation(ratio)
    value = min(value, 1.0)
    failures = (sample.ratios * ratio)[sample.failed]
    squared = float((failures**2).sum())
    effective = float(failures.sum()) ** 2 / squared if squared > 0.0 else 0.0
    warning = ""
    if effective < _SMALLEST_EFFECTIVE_SIZE:
        warning = (
            f"the {len(failures)} failed runs are worth {effective:.1f} under the new distribution, fewer than "
            f"{_SMALLEST_EFFECTIVE_SIZE:g}: run the algorithm with it"
        )
    elif value <= 0.0 or math.sqrt(variance) > 0.5 * value:
        warning = "the new weights leave an error of more than half of the probability: run the algorithm with it"
    if value <= 0.0:
        bounds = ConfidenceInterval(value, variance, freedom).bounds(level)
        return ReweightedProbability(0.0, *bounds, math.inf, effective, warning)
    variation = math.sqrt(variance) / value
    lower, upper = logNormalInterval(value, variation**2, level, freedom)
    return ReweightedProbability(value, lower, upper, variation, effective, warning)


def _logRatio(distribution, other, x):
    """Logarithm (n,) of one density over another; of independent inputs only those that differ count."""
    if not (distribution.hasIndependentCopula() and other.hasIndependentCopula()):
        return np.array(other.computeLogPDF(x))[:, 0] - np.array(distribution.computeLogPDF(x))[:, 0]
    logRatio = np.zeros(len(x))
    for index in range(distribution.getDimension()):
        old, new = distribution.getMarginal(index), other.getMarginal(index)
        if new != old:
            column = ot.Sample(x[:, [index]])
            logRatio += np.array(new.computeLogPDF(column))[:, 0] - np.array(old.computeLogPDF(column))[:, 0]
    return logRatio


def _checkSupport(distribution, other):
    for index, name in enumerate(distribution.getDescription()):
        old, new = distribution.getMarginal(index).getRange(), other.getMarginal(index).getRange()
        for side, sign in (("Lower", 1.0), ("Upper", -1.0)):
            if not getattr(old, f"getFinite{side}Bound")()[0]:
                continue
            bound, further = (getattr(both, f"get{side}Bound")()[0] for both in (old, new))
            if sign * further < sign * bound:
                raise ValueError(
                    f"the new distribution of {name} reaches to {further:g}, where no run can have been: the "
                    f"{side.lower()} bound of the first one is {bound:g}"
                )
