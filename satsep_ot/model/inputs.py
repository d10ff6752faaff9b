"""Uncertain inputs: a table of name, unit, distribution, and the parameters of the separation that each one moves."""

import difflib
import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import openturns as ot

from satsep_ot.dynamics.separation import Separation
from satsep_ot.dynamics.springs import ForceLaw, ForceLine
from satsep_ot.openturns_adapter import REFUSALS, endsInterpreter, errorMessage, parameterNames

_DEGREE = math.pi / 180.0
_AXES = ("x", "y", "z")
_TENSOR = ("xx", "yy", "zz", "xy", "xz", "yz")
# key of [springs] -> (parameter of one spring, unit in the case file, its size in SI, description)
_SPRING_KEYS = {
    "angles": ("angle", "deg", _DEGREE, "angle of the seat"),
    "radius": ("radius", "mm", 1e-3, "ring radius"),
    "stiffness": ("stiffness", "N/m", 1.0, "stiffness"),
    "deformation": ("deformation", "mm", 1e-3, "initial deformation"),
    "stroke": ("stroke", "mm", 1e-3, "stroke"),
    "cant": ("cant", "deg", _DEGREE, "tangential cant"),
    "delay": ("delay", "ms", 1e-3, "release delay"),
    "scale": ("scale", "1", 1.0, "factor of the force"),
}
# key of [umbilical] -> (which of its two springs, parameter of it, unit, its size in SI, description)
_UMBILICAL_KEYS = {
    "angle": ((0, 1), "angle", "deg", _DEGREE, "angle"),
    "radius": ((0, 1), "radius", "mm", 1e-3, "radius"),
    "stiffness": ((0,), "stiffness", "N/m", 1.0, "stiffness"),
    "deformation": ((0,), "deformation", "mm", 1e-3, "initial deformation"),
    "stroke": ((0,), "stroke", "mm", 1e-3, "stroke"),
    "friction": ((1,), "scale", "N", 1.0, "pin friction"),
    "engagement": ((1,), "stroke", "mm", 1e-3, "engagement of the pins"),
}
# Parameters that make no sense below zero, by the end of their names; the first ones not at zero either.
_POSITIVE = (
    ".mass",
    ".inertia.xx",
    ".inertia.yy",
    ".inertia.zz",
    ".stiffness",
    ".deformation",
    ".stroke",
    "stowed_length",
    "recess_radius",
    "recess_depth",
)
# What people write, without case and separators, for a word that is spelt otherwise: another one would be nearer.
_SYNONYMS = dict.fromkeys(("3sigma", "3s", "sigma3"), "three_sigma") | dict.fromkeys(
    ("rate", "totalrate", "angularrate", "bodyrate", "tumble", "tumblerate", "tumbling", "tumblingrate"), "tip_off_rate"
)
_NOT_NEGATIVE = (".radius", ".delay", ".scale", "guide_friction")


@dataclass(frozen=True)
class Target:
    """What one quantity of a case file stands for in the separation's flat parameter vector.

    Parameters
    ----------
    parameters : tuple of str
        Names of the parameters that move together.
    unit : str
        Unit in the case file.
    factor : float
        Size of that unit in SI.
    description : str
        What it is, in words.
    """

    parameters: tuple[str, ...]
    unit: str
    factor: float
    description: str


@dataclass(frozen=True)
class UncertainInput:
    """One uncertain input: parameter = nominal parameter + factor * (input - reference), for each of its parameters.

    Parameters
    ----------
    name, description, unit : str
        How people read it.
    distribution : :class:`openturns.Distribution`
        Univariate, in `unit`.
    parameters : tuple of str
        Names in the separation's flat parameter vector.
    factor : float
        Size of the unit in SI.
    reference : float
        Value of the input at which the parameters have their nominal values, in `unit`.
    entry : str
        Name of the entry of the case file that it comes from: one tolerance may make an input for every spring.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> row = load_case("reference").inputs[0]
    >>> print(row.name, row.unit, row.distribution)
    satellite_mass kg Normal(mu = 100, sigma = 0.5)
    """

    name: str
    description: str
    unit: str
    distribution: ot.Distribution
    parameters: tuple[str, ...]
    factor: float
    reference: float
    entry: str = ""

    @property
    def label(self) -> str:
        """The name with its unit."""
        return f"{self.name} [{self.unit}]"

    def scaled(self, scale: float) -> "UncertainInput":
        """The same input with the scatter of its parameters about their means scaled, whatever its distribution is.

        Parameters
        ----------
        scale : float
            Positive; 0.5 halves every deviation from the mean.

        Returns
        -------
        scaled : UncertainInput
            With the same distribution, but a factor and a reference that let it move its parameters less, or more.

        Raises
        ------
        ValueError
            If the scale is not positive.

        Examples
        --------
        >>> from satsep_ot.model.case import load_case
        >>> row = load_case("reference").inputs[0].scaled(0.5)
        >>> row.factor, row.reference
        (0.5, 100.0)
        """
        if not 0.0 < scale < math.inf:
            raise ValueError(f"scale = {scale}; a positive number is allowed")
        mean = self.distribution.getMean()[0]
        return replace(self, factor=scale * self.factor, reference=mean - (mean - self.reference) / scale)


def scatter_targets(separation: Separation) -> dict[str, Target]:
    """Every quantity of a case file that may be uncertain, by its key.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    targets : dict of str to Target
        Only those that this separation has: a stowed length needs struts, a recess an envelope.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.inputs import scatter_targets
    >>> scatter_targets(load_case("reference").separation)["springs.cant.2"]
    Target(parameters=('springs[1].cant',), unit='deg', factor=0.017453292519943295, description='tangential cant ...')
    """
    targets = {}
    for body in ("satellite", "platform"):
        targets[f"{body}.mass"] = Target((f"{body}.mass",), "kg", 1.0, f"mass of the {body}")
        for element in _TENSOR:
            key = f"{body}.inertia.{element}"
            targets[key] = Target((key,), "kg m2", 1.0, f"inertia {element} of the {body} about its centre of mass")
        for axis in _AXES:
            key = f"{body}.center_of_mass.{axis}"
            targets[key] = Target((key,), "mm", 1e-3, f"centre of mass of the {body} along {axis} from the ring centre")
    targets |= _spring_targets(separation)
    for axis in _AXES:
        targets[f"initial.rates.{axis}"] = Target((f"rates.{axis}",), "deg/s", _DEGREE, f"initial rate about {axis}")
        targets[f"initial.mounting_error.{axis}"] = Target(
            (f"mounting_error.{axis}",), "deg", _DEGREE, f"mounting error of the satellite about {axis}"
        )
        targets[f"impulse.momentum.{axis}"] = Target((f"impulse.{axis}",), "N s", 1.0, f"impulse at t = 0 along {axis}")
        targets[f"impulse.angular_momentum.{axis}"] = Target(
            (f"angular_impulse.{axis}",), "N m s", 1.0, f"angular impulse at t = 0 about {axis}"
        )
    if separation.force_line == ForceLine.STRUT:
        targets["springs.stowed_length"] = Target(("stowed_length",), "mm", 1e-3, "stowed length of the springs")
    if separation.force_line == ForceLine.NORMAL:
        targets["springs.guide_friction"] = Target(("guide_friction",), "1", 1.0, "friction coefficient of the guides")
    if separation.envelope is not None:
        # Radius 0 is a recess without a cylinder.
        for size in ("radius", "depth") if separation.recess_radius > 0.0 else ("depth",):
            targets[f"envelope.recess_{size}"] = Target((f"recess_{size}",), "mm", 1e-3, f"{size} of the recess")
        for i in range(1, len(separation.recess_planes) + 1):
            targets[f"envelope.planes.{i}.offset"] = Target(
                (f"recess_planes[{i - 1}].offset",), "mm", 1e-3, f"offset of plane {i} of the recess"
            )
    return targets


def umbilical_springs(separation: Separation) -> list[int]:
    """Index of the spring of each umbilical connector: its pins, a friction at the same seat, follow it.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    indices : list of int

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.inputs import umbilical_springs
    >>> umbilical_springs(load_case("reference").separation)
    []
    """
    springs = separation.springs
    return [
        i
        for i in range(len(springs) - 1)
        if (springs.laws[i], springs.laws[i + 1]) == (ForceLaw.LINEAR, ForceLaw.FRICTION)
        and (springs.angle[i], springs.radius[i]) == (springs.angle[i + 1], springs.radius[i + 1])
    ]


def _spring_targets(separation):
    """The targets of springs and umbilical connectors: of all together, and of each by its number."""
    connectors = umbilical_springs(separation)
    springs = [i for i in range(len(separation.springs)) if not {i, i - 1} & set(connectors)]
    linear = [i for i in springs if separation.springs.laws[i] == ForceLaw.LINEAR]
    targets = {}
    for key, (parameter, unit, factor, description) in _SPRING_KEYS.items():
        # Another law than the linear one has neither stiffness nor deformation.
        members = linear if key in ("stiffness", "deformation") else springs
        named = {i + 1: (f"springs[{i}].{parameter}",) for i in members}
        targets |= _numbered(f"springs.{key}", named, unit, factor, description, "spring")
    for key, (places, parameter, unit, factor, description) in _UMBILICAL_KEYS.items():
        named = {n: tuple(f"springs[{i + k}].{parameter}" for k in places) for n, i in enumerate(connectors, start=1)}
        targets |= _numbered(f"umbilical.{key}", named, unit, factor, description, "umbilical connector")
    return targets


def _numbered(key, named, unit, factor, description, what):
    """One target for what moves together, and one for each by its number; none where there is nothing."""
    if not named:
        return {}
    every = tuple(parameter for parameters in named.values() for parameter in parameters)
    targets = {key: Target(every, unit, factor, f"{description} of all {what}s")}
    for number, parameters in named.items():
        targets[f"{key}.{number}"] = Target(parameters, unit, factor, f"{description} of {what} {number}")
    return targets


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
    >>> from satsep_ot.model.inputs import build_distribution
    >>> print(build_distribution("Uniform", {"a": 0.0, "b": 2.0}))
    Uniform(a = 0, b = 2)
    """
    distribution_class = vars(ot).get(name)
    if not _is_distribution_class(distribution_class):
        known = [key for key, value in vars(ot).items() if _is_distribution_class(value)]
        raise ValueError(f"{name[:60]!r} is no OpenTURNS distribution{did_you_mean(name, known)}")
    try:
        distribution = distribution_class()
        dimension = distribution.getDimension()
        expected = parameterNames(distribution)
    except REFUSALS as error:
        raise ValueError(f"the distribution {name} cannot be given by parameters with names") from error
    if dimension != 1 or distribution.isCopula():
        raise ValueError(f"{name} is not univariate (its dimension is {dimension}); an input has one dimension")
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


def _is_distribution_class(value) -> bool:
    return isinstance(value, type) and issubclass(value, ot.DistributionImplementation)


def did_you_mean(given: str, known: Iterable[str]) -> str:
    """The end of a sentence that names the nearest of the known words, or nothing.

    Examples
    --------
    >>> from satsep_ot.model.inputs import did_you_mean
    >>> did_you_mean("mas", ["mass", "inertia"])
    "; did you mean 'mass'?"
    """
    lower = {word.lower(): word for word in known}
    synonym = _SYNONYMS.get(re.sub(r"[\W_]", "", given.lower()))
    nearest = [synonym] if synonym in lower else difflib.get_close_matches(given.lower(), lower, n=1)
    return f"; did you mean '{lower[nearest[0]]}'?" if nearest else ""


def quantile_range(distribution: ot.Distribution) -> tuple[float, float]:
    """The 0.1 % and the 99.9 % quantile of a univariate distribution.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.model.inputs import quantile_range
    >>> [round(value, 4) for value in quantile_range(ot.Uniform(0.0, 2.0))]
    [0.002, 1.998]
    """
    return distribution.computeQuantile(0.001)[0], distribution.computeQuantile(0.999)[0]


def interval_digits(low: float, high: float, least: int = 3) -> int:
    """Significant digits in which the ends of an interval show its width to about three, however far from 0 it lies.

    Examples
    --------
    >>> from satsep_ot.model.inputs import interval_digits
    >>> f"{199.95:.{interval_digits(199.95, 200.05)}g}"
    '199.95'
    """
    width = high - low
    if not 0.0 < width < math.inf:
        return least
    # Beyond 15 digits there is only rounding.
    return min(max(least, 3 + math.ceil(math.log10(max(abs(low), abs(high)) / width))), 15)


def check_range(uncertain_input: UncertainInput, nominal: dict[str, float]) -> None:
    """Refuse an input whose 0.1 % quantile gives a parameter a value without physical sense.

    Parameters
    ----------
    uncertain_input : UncertainInput
    nominal : dict of str to float
        Nominal value of every parameter [SI].

    Raises
    ------
    ValueError
        With the value that would be reached.
    """
    try:
        low, high = quantile_range(uncertain_input.distribution)
        _spread(uncertain_input.distribution)
    except REFUSALS as error:
        raise ValueError(
            f"OpenTURNS finds no quantiles of {uncertain_input.distribution}: {errorMessage(error)}"
        ) from error
    if not (math.isfinite(low) and math.isfinite(high)):
        raise ValueError(f"its 0.1 % to 99.9 % range, {low:g} to {high:g} {uncertain_input.unit}, is not finite")
    for parameter in uncertain_input.parameters:
        lowest = nominal[parameter] / uncertain_input.factor + low - uncertain_input.reference
        positive = parameter.endswith(_POSITIVE)
        if (positive and lowest <= 0.0) or (parameter.endswith(_NOT_NEGATIVE) and lowest < 0.0):
            allowed = "positive" if positive else "not negative"
            raise ValueError(
                f"its scatter brings the {uncertain_input.description} to {lowest:g} {uncertain_input.unit} "
                f"at the 0.1 % quantile; it must stay {allowed}"
            )


class ParameterMap:
    """The linear map from samples of the uncertain inputs to parameters of the separation.

    Parameters
    ----------
    inputs : sequence of UncertainInput
        In the order of the columns of a sample.
    separation : :class:`satsep_ot.dynamics.separation.Separation`
        With the nominal parameters.

    Attributes
    ----------
    names, units : tuple of str, length n
        Of the inputs.
    nominal : ndarray, shape (P,)
        Nominal parameters [SI].
    reference : ndarray, shape (n,)
        Inputs at which the parameters are nominal.
    spread : ndarray, shape (n,)
        Half of the middle 68 % of each input: the standard deviation of a Normal, and finite where there is none.

    Notes
    -----
    parameters = nominal + matrix (x - reference). The sums run over single columns rather than through a matrix
    product, so that a row's result does not depend, in the last bit, on the batch that it is in.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.inputs import ParameterMap
    >>> case = load_case("reference")
    >>> ParameterMap(case.inputs, case.separation).matrix.shape == (len(case.separation.parameters()), 35)
    True
    """

    def __init__(self, inputs: Sequence[UncertainInput], separation: Separation) -> None:
        index = {name: k for k, name in enumerate(separation.parameter_names())}
        self.names = tuple(row.name for row in inputs)
        self.units = tuple(row.unit for row in inputs)
        self.nominal = np.array(separation.parameters())
        self.reference = np.array([row.reference for row in inputs])
        self.spread = np.array([_spread(row.distribution) for row in inputs])
        self._moves = [
            (index[name], column, row.factor) for column, row in enumerate(inputs) for name in row.parameters
        ]

    @property
    def matrix(self) -> np.ndarray:
        """Derivative of the parameters with respect to the inputs, shape (P, n)."""
        matrix = np.zeros((len(self.nominal), len(self.names)))
        for parameter, column, factor in self._moves:
            matrix[parameter, column] = factor
        return matrix

    def parameters(self, sample: np.ndarray) -> np.ndarray:
        """Parameters of each row of a sample.

        Parameters
        ----------
        sample : ndarray, shape (N, n)
            In the units of the inputs.

        Returns
        -------
        parameters : ndarray, shape (N, P)
            SI.
        """
        parameters = np.tile(self.nominal, (len(sample), 1))
        for parameter, column, factor in self._moves:
            parameters[:, parameter] += factor * (sample[:, column] - self.reference[column])
        return parameters

    def gradient(self, by_parameters: np.ndarray) -> np.ndarray:
        """Derivatives with respect to the inputs from derivatives with respect to the parameters.

        Parameters
        ----------
        by_parameters : ndarray, shape (N, P)

        Returns
        -------
        gradient : ndarray, shape (N, n)
        """
        gradient = np.zeros((len(by_parameters), len(self.names)))
        for parameter, column, factor in self._moves:
            gradient[:, column] += factor * by_parameters[:, parameter]
        return gradient


def _spread(distribution):
    return 0.5 * (distribution.computeQuantile(0.8413)[0] - distribution.computeQuantile(0.1587)[0])


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
    >>> from satsep_ot.model.inputs import normal_copula
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
    >>> from satsep_ot.model.inputs import correlated_pairs, normal_copula
    >>> correlated_pairs(["a", "b", "c"], normal_copula(["a", "b", "c"], {("a", "c"): 0.5}))
    [('a', 'c', 0.5)]
    """
    if copula is None:
        return []
    # The parameter of a NormalCopula is the lower triangle of its matrix, row by row.
    places = [(j, i) for i in range(len(names)) for j in range(i)]
    found = zip(places, copula.getParameter(), strict=True)
    return [(names[j], names[i], coefficient) for (j, i), coefficient in found if coefficient]


def joint_distribution(inputs: Sequence[UncertainInput], copula: ot.Distribution | None = None) -> ot.JointDistribution:
    """The joint distribution of uncertain inputs, independent unless a copula is given.

    Parameters
    ----------
    inputs : sequence of UncertainInput, length n
        At least one.
    copula : :class:`openturns.Distribution`, optional
        A copula of dimension n.

    Returns
    -------
    distribution : :class:`openturns.JointDistribution`
        Its description holds the name and unit of each input.

    Raises
    ------
    ValueError
        If the copula is none, or has another dimension, or is a Student copula (building a joint distribution with
        one ends the interpreter in OpenTURNS 1.27).

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.inputs import joint_distribution
    >>> joint_distribution(load_case("reference").inputs).getDescription()[34]
    'delay_4 [ms]'
    """
    marginals = [row.distribution for row in inputs]
    if copula is None:
        joint = ot.JointDistribution(marginals)
    else:
        copula = ot.Distribution(copula)
        kind = copula.getImplementation().getClassName()
        if not copula.isCopula() or copula.getDimension() != len(marginals):
            raise ValueError(
                f"the copula given is a {kind} of dimension {copula.getDimension()}; "
                f"a copula of dimension {len(marginals)} is needed, one for each uncertain input"
            )
        if endsInterpreter(copula):
            raise ValueError(f"a {kind} is not supported by OpenTURNS 1.27; a NormalCopula, for one, is")
        joint = ot.JointDistribution(marginals, copula)
    joint.setDescription([row.label for row in inputs])
    return joint
