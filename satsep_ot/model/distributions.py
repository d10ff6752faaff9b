"""Distributions and copulas of uncertain inputs, from names and numbers."""

import math
from collections.abc import Sequence

import numpy as np
import openturns as ot

from satsep_ot.model.spelling import did_you_mean
from satsep_ot.openturns_adapter import REFUSALS, errorMessage, parameterNames, withoutWarnings


def build_distribution(name: str, parameters: dict[str, float]) -> ot.Distribution:
    """An OpenTURNS distribution from its name and its parameters by name.

    Parameters
    ----------
    name : str
        Class name in OpenTURNS, for example "Uniform".
    parameters : dict of str to float
        By the names of `getParameterDescription` without the trailing "_0" (a Normal has mu and sigma; "mean" is
        understood for mu). A shift "gamma" may be left out and is then 0.

    Returns
    -------
    distribution : :class:`openturns.Distribution`
        Univariate.

    Raises
    ------
    ValueError
        In one sentence, if the distribution or a parameter is unknown, missing or refused by OpenTURNS.

    Examples
    --------
    >>> from satsep_ot.model.distributions import build_distribution
    >>> print(build_distribution("Uniform", {"a": 0.0, "b": 2.0}))
    Uniform(a = 0, b = 2)
    """
    distribution, expected = _with_default_parameters(name)
    given = dict(parameters)
    if "mean" in given and "mu" in expected and "mu" not in given:
        given["mu"] = given.pop("mean")
    if "gamma" in expected:
        given.setdefault("gamma", 0.0)
    takes = f"{name} takes {', '.join(expected)}" if expected else f"{name} takes no parameters"
    for key in given:
        if key not in expected:
            raise ValueError(f"{key[:60]!r} is no parameter of the distribution; {takes}")
    for key in expected:
        if key not in given:
            raise ValueError(f"the parameter {key} of the distribution is missing; {takes}")
    try:
        distribution.setParameter([given[key] for key in expected])
    except REFUSALS as error:
        values = ", ".join(f"{key} = {given[key]:g}" for key in expected)
        raise ValueError(f"OpenTURNS refuses {name}({values}): {errorMessage(error)}") from error
    return ot.Distribution(distribution)


def _with_default_parameters(name):
    """The distribution of that name as OpenTURNS makes it, and the names of its parameters."""
    known = {
        key: value
        for key, value in vars(ot).items()
        if isinstance(value, type) and issubclass(value, ot.DistributionImplementation)
    }
    if name not in known:
        raise ValueError(f"{name[:60]!r} is no OpenTURNS distribution{did_you_mean(name, known)}")
    try:
        with withoutWarnings():
            distribution = known[name]()
        dimension = distribution.getDimension()
        expected = parameterNames(distribution)
    except REFUSALS as error:
        raise ValueError(f"the distribution {name} cannot be given by parameters with names") from error
    if dimension != 1 or distribution.isCopula():
        raise ValueError(f"{name} is not univariate (its dimension is {dimension}); an input has one dimension")
    return distribution, expected


def distribution_names() -> list[str]:
    """Names of the OpenTURNS distributions that `build_distribution` takes, in alphabetical order.

    Returns
    -------
    names : list of str

    Examples
    --------
    >>> from satsep_ot.model.distributions import distribution_names
    >>> "LogNormal" in distribution_names(), "ClaytonCopula" in distribution_names()
    (True, False)
    """
    names = []
    for name in dir(ot):
        try:
            _with_default_parameters(name)
        except ValueError:
            continue
        names.append(name)
    return names


def quantile_range(distribution: ot.Distribution) -> tuple[float, float]:
    """The 0.1 % and the 99.9 % quantile of a univariate distribution.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.model.distributions import quantile_range
    >>> [round(value, 4) for value in quantile_range(ot.Uniform(0.0, 2.0))]
    [0.002, 1.998]
    """
    return distribution.computeQuantile(0.001)[0], distribution.computeQuantile(0.999)[0]


def interval_digits(low: float, high: float, least: int = 3) -> int:
    """Significant digits in which the ends of an interval show its width to about three, however far from 0 it lies.

    Examples
    --------
    >>> from satsep_ot.model.distributions import interval_digits
    >>> f"{199.95:.{interval_digits(199.95, 200.05)}g}"
    '199.95'
    """
    width = high - low
    if not 0.0 < width < math.inf:
        return least
    # Beyond 15 digits there is only rounding.
    return min(max(least, 3 + math.ceil(math.log10(max(abs(low), abs(high)) / width))), 15)


def normal_copula(names: Sequence[str], correlations: dict[tuple[str, str], float]) -> ot.NormalCopula | None:
    """The normal copula of uncertain inputs from correlations of some of them.

    Parameters
    ----------
    names : sequence of str, length n
        Of all inputs.
    correlations : dict of (str, str) to float
        By pairs of different names; a coefficient lies between -1 and 1.

    Returns
    -------
    copula : :class:`openturns.NormalCopula`, or None
        Of dimension n; None where no pair is correlated.

    Raises
    ------
    ValueError
        If the coefficients contradict each other: their matrix is not positive definite. The message names the inputs.

    Examples
    --------
    >>> from satsep_ot.model.distributions import normal_copula
    >>> print(normal_copula(["a", "b"], {("a", "b"): 0.5}))
    NormalCopula(R = [[ 1   0.5 ]
     [ 0.5 1   ]])
    """
    if not any(correlations.values()):
        return None
    names = list(names)
    matrix = np.eye(len(names))
    for (first, second), coefficient in correlations.items():
        i, j = names.index(first), names.index(second)
        matrix[i, j] = matrix[j, i] = coefficient
    eigenvalues, vectors = np.linalg.eigh(matrix)
    if not eigenvalues[0] > 1e-10:
        involved = [name for name, share in zip(names, vectors[:, 0] ** 2, strict=True) if share > 1e-3]
        among = {pair: value for pair, value in correlations.items() if pair[0] in involved and pair[1] in involved}
        shown = ", ".join(f"{a} with {b} {value:g}" for (a, b), value in list(among.items())[:6])
        shown += f", ... ({len(among)} in all)" if len(among) > 6 else ""
        raise ValueError(
            f"the correlations of {', '.join(involved)} contradict each other ({shown}): their matrix must be positive "
            f"definite, and its smallest eigenvalue is {eigenvalues[0]:.3g}"
        )
    return ot.NormalCopula(ot.CorrelationMatrix(matrix.tolist()))


def correlated_pairs(names: Sequence[str], copula: ot.NormalCopula | None) -> list[tuple[str, str, float]]:
    """The pairs of inputs that a normal copula correlates.

    Parameters
    ----------
    names : sequence of str
        Of the inputs, in their order.
    copula : :class:`openturns.NormalCopula`, optional
        None for independent inputs.

    Returns
    -------
    pairs : list of (str, str, float)
        Two names and the coefficient of the copula, which is not 0.

    Examples
    --------
    >>> from satsep_ot.model.distributions import correlated_pairs, normal_copula
    >>> correlated_pairs(["a", "b", "c"], normal_copula(["a", "b", "c"], {("a", "c"): 0.5}))
    [('a', 'c', 0.5)]
    """
    if copula is None:
        return []
    # The parameter of a NormalCopula is the lower triangle of its matrix, row by row.
    places = [(j, i) for i in range(len(names)) for j in range(i)]
    found = zip(places, copula.getParameter(), strict=True)
    return [(names[j], names[i], coefficient) for (j, i), coefficient in found if coefficient]
