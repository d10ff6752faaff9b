"""Uncertain inputs: a table of name, unit, distribution, and the parameters of the separation that each one moves."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import openturns as ot

from satsep_ot.dynamics.parameter_vector import Sign
from satsep_ot.dynamics.separation import Separation
from satsep_ot.model.distributions import quantile_range
from satsep_ot.model.parameters import parameter_rows
from satsep_ot.model.values import Unit
from satsep_ot.openturns_adapter import REFUSALS, endsInterpreter, errorMessage


@dataclass(frozen=True)
class Target:
    """What one quantity of a case file stands for in the separation's flat parameter vector.

    Parameters
    ----------
    key : str
        Table and key of its row in `satsep_ot.model.parameters`, for example "springs.cant".
    parameters : tuple of str
        Names of the parameters that move together.
    unit : :class:`satsep_ot.model.values.Unit`
        Unit in the case file.
    description : str
        What it is, in words.
    entries : dict of int to str
        The names of the targets that `.each` stands for, by the number of their spring or connector.
    series : str
        What such a target is with others of its kind, for example "stiffness of springs"; empty for the others.
    number : int
        Number of its spring or connector; 0 for the others.
    """

    key: str
    parameters: tuple[str, ...]
    unit: Unit
    description: str
    entries: dict[int, str] = field(default_factory=dict)
    series: str = ""
    number: int = 0


@dataclass(frozen=True)
class ToleranceClass:
    """A size of a tolerance that can be bought.

    Parameters
    ----------
    label : str
        As the case file has it.
    scale : float
        Its size over the size of the case.
    price : float
    """

    label: str
    scale: float
    price: float


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
        Name of the entry of the case file that it comes from, which may make an input for every spring.
    group : str
        Name of the tolerance that it belongs to: the inputs of one are tightened together.
    key : str
        Table and key of its row in `satsep_ot.model.parameters`, for example "springs.cant".
    series, number : str, int
        As of its `Target`; empty and 0 for an input that has a description of its own.
    is_shared : bool
        Whether all satellites of a fleet share its value.
    classes : tuple of ToleranceClass
        Sizes of its tolerance that can be bought.
    is_shared_by_tests : bool
        Whether ground tests and flight have the same value.
    mean_uncertainty, sigma_uncertainty : float
        Standard deviations of the mean and of the standard deviation of the distribution, in `unit`; 0 if known.

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
    key: str = ""
    series: str = ""
    number: int = 0
    group: str = ""
    is_shared: bool = False
    classes: tuple[ToleranceClass, ...] = ()
    is_shared_by_tests: bool = False
    mean_uncertainty: float = 0.0
    sigma_uncertainty: float = 0.0

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
            raise ValueError(f"scale = {scale}; it must be positive and finite")
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
    >>> target = scatter_targets(load_case("reference").separation)["springs.cant.2"]
    >>> print(target.parameters, target.unit.name, target.description)
    ('springs[1].cant',) deg tangential cant of spring 2
    """
    unused, connectors = separation.unused_parameters(), umbilical_springs(separation)
    places = [place for place in separation.parameter_places() if place.name not in unused]
    of_connectors = {i for first in connectors for i in (first, first + 1)}
    targets: dict[str, Target] = {}
    for table, row in parameter_rows():
        key, members = f"{table.name}.{row.key}", [place for place in places if place.path == row.field]
        if row.of_connector:
            named = {
                number: tuple(place.name for place in members if place.index in {first + k for k in row.of_connector})
                for number, first in enumerate(connectors, start=1)
            }
            targets |= _numbered(key, row, named, "umbilical connector")
        elif row.holder == "springs":
            of_springs = {place.index: place for place in members if place.index is not None}
            named = {i + 1: (place.name,) for i, place in of_springs.items() if i not in of_connectors}
            targets |= _numbered(key, row, named, "spring")
        elif row.holder == "hold_downs":
            for place in members:
                number = (place.index or 0) + 1
                description = row.scatters.format(number=number)
                targets[f"{table.name}.{number}.{row.key}"] = Target(key, (place.name,), row.unit, description)
        elif row.holder == "recess_planes":
            for number, place in enumerate(members, start=1):
                description = row.scatters.format(number=number)
                targets[f"{table.name}.{number}.{row.key}"] = Target(key, (place.name,), row.unit, description)
        else:
            for place in members:
                name = f"{key}.{place.element}" if place.element else key
                targets[name] = Target(key, (place.name,), row.unit, row.scatters.format(element=place.element))
    return targets


def _numbered(key, row, named, what):
    """One target for what moves together, and one for each by its number; none where there is nothing."""
    if not named:
        return {}
    entries = {number: f"{key}.{number}" for number in named}
    every = tuple(parameter for parameters in named.values() for parameter in parameters)
    targets = {key: Target(key, every, row.unit, f"{row.scatters} of all {what}s", entries)}
    for number, parameters in named.items():
        description, series = f"{row.scatters} of {what} {number}", f"{row.scatters} of {what}s"
        targets[entries[number]] = Target(key, parameters, row.unit, description, series=series, number=number)
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
    pushes, holds_back = springs.law_property("has_stiffness"), springs.law_property("holds_back")
    return [
        i
        for i in range(len(springs) - 1)
        if pushes[i]
        and holds_back[i + 1]
        and (springs.angle[i], springs.radius[i]) == (springs.angle[i + 1], springs.radius[i + 1])
    ]


def check_range(uncertain_input: UncertainInput, nominal: dict[str, tuple[float, Sign]]) -> None:
    """Refuse an input whose 0.1 % quantile gives a parameter a value without physical sense.

    Parameters
    ----------
    uncertain_input : UncertainInput
    nominal : dict of str to (float, Sign)
        Nominal value [SI] and sign of each parameter, as `nominal_parameters` gives them.

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
        value, sign = nominal[parameter]
        lowest = value / uncertain_input.factor + low - uncertain_input.reference
        if not sign.allows(lowest):
            raise ValueError(
                f"its scatter brings the {uncertain_input.description} to {lowest:g} {uncertain_input.unit} "
                f"at the 0.1 % quantile; it must stay {sign.value}"
            )


def nominal_parameters(separation: Separation) -> dict[str, tuple[float, Sign]]:
    """Nominal value [SI] and sign of each parameter, by its name.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    nominal : dict of str to (float, Sign)
    """
    places = separation.parameter_places()
    return {place.name: (value, place.sign) for place, value in zip(places, separation.parameters(), strict=True)}


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
        Half of the middle 68 % of each input: the standard deviation of a normal input, and finite for a
        distribution without a standard deviation.

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
                f"it must be a copula of dimension {len(marginals)}, one for each uncertain input"
            )
        if endsInterpreter(copula):
            raise ValueError(f"a {kind} is not supported by OpenTURNS 1.27; a NormalCopula, for one, is")
        joint = ot.JointDistribution(marginals, copula)
    joint.setDescription([row.label for row in inputs])
    return joint
