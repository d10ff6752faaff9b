"""A separation as a reliability problem: distribution, function, events, and the smooth components behind them."""

import functools
import os

import openturns as ot

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.model.case import SYSTEM, Case, CaseError, Requirement, load_uncertain_case
from satsep_ot.model.inputs import joint_distribution
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.spelling import did_you_mean
from satsep_ot.openturns_adapter import minimumFunction
from satsep_ot.openturns_object import OpenTURNSObject

# Added to the argument of a norm and of an absolute value: their gradient at 0 is then one of the subgradients instead
# of 0/0, so that a search for a design point can start at the nominal point. It changes no digit of any rate that
# matters, and its square is still a number.
_KINK = 1e-150


class SeparationProblem(OpenTURNSObject):
    """Reliability of a separation: the joint distribution of its inputs, its function, an event for each requirement.

    Parameters
    ----------
    case : Case, str or path, default "reference"
        As for :func:`satsep_ot.model.case.load_case`.
    copula : :class:`openturns.Distribution`, optional
        Dependence of the uncertain inputs, in their order. Default: the copula of the case; without correlations in
        the case the inputs are independent.

    Raises
    ------
    CaseError
        If the case cannot be used or has no uncertain inputs.
    ValueError
        If the copula does not fit.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.model.separation_problem import SeparationProblem
    >>> problem = SeparationProblem("reference")
    >>> problem.getRequirementNames()
    ['lateral rate', 'spin', 'axial velocity', 'clearance']
    >>> event = problem.getEvent("axial velocity")
    >>> solver = ot.AbdoRackwitz()
    >>> solver.setStartingPoint(problem.getDistribution().getMean())
    >>> algorithm = ot.FORM(solver, event)
    >>> algorithm.run()
    >>> round(algorithm.getResult().getHasoferReliabilityIndex(), 1)
    3.3
    """

    def __init__(
        self, case: Case | str | str | os.PathLike = "reference", copula: ot.Distribution | None = None
    ) -> None:
        self._case = load_uncertain_case(case)
        self._distribution = joint_distribution(self._case.inputs, self._case.copula if copula is None else copula)

    @functools.cached_property
    def _quantities(self):
        return quantity_table(self._case.separation)

    def _shown(self):
        return {
            "case": self._case.name,
            "inputs": self._distribution.getDimension(),
            # By the names that `getEvent` takes.
            "requirements": {entry.name: str(entry) for entry in self._case.requirements},
        }

    def getCase(self) -> Case:
        """The case.

        Returns
        -------
        case : :class:`satsep_ot.model.case.Case`
        """
        return self._case

    def getDistribution(self) -> ot.JointDistribution:
        """Joint distribution of the uncertain inputs.

        Returns
        -------
        distribution : :class:`openturns.JointDistribution`
            In the units that its description names.
        """
        return ot.JointDistribution(self._distribution)

    def getFunction(self) -> ot.Function:
        """All quantities of interest as a function of the uncertain inputs.

        Returns
        -------
        function : :class:`openturns.Function`
            A :class:`satsep_ot.model.separation_function.SeparationFunction` as an OpenTURNS function.
        """
        return ot.Function(SeparationFunction(self._case))

    def getInputNames(self) -> list[str]:
        """Names of the uncertain inputs, without their units.

        Returns
        -------
        names : list of str
            In the order of the distribution.
        """
        return [row.name for row in self._case.inputs]

    def getInputUnits(self) -> list[str]:
        """Units of the uncertain inputs.

        Returns
        -------
        units : list of str
            In the order of the distribution; "1" for a pure number.
        """
        return [row.unit for row in self._case.inputs]

    def getRequirements(self) -> list[Requirement]:
        """The requirements, in the order of the case file.

        Returns
        -------
        requirements : list of :class:`satsep_ot.model.case.Requirement`
        """
        return list(self._case.requirements)

    def getRequirementNames(self) -> list[str]:
        """Names of the requirements.

        Returns
        -------
        names : list of str
        """
        return [requirement.name for requirement in self._case.requirements]

    def getEvent(self, requirement: str | Requirement) -> ot.ThresholdEvent:
        """The event that a requirement is violated.

        Parameters
        ----------
        requirement : str or Requirement
            One of the case by its name, or any other limit on a quantity of interest.

        Returns
        -------
        event : :class:`openturns.ThresholdEvent`
            On the quantity of interest itself, against the limit.

        Raises
        ------
        ValueError
            If there is no such requirement or quantity.
        """
        requirement = self._requirement(requirement)
        function, composition, _, _ = self.getComponents(requirement)
        comparison = ot.Greater() if requirement.is_maximum else ot.Less()
        return self._event(ot.ComposedFunction(composition, function), comparison, requirement.limit, requirement.name)

    def getSystemEvent(self) -> ot.ThresholdEvent:
        """The event that any requirement of the case is violated.

        Returns
        -------
        event : :class:`openturns.ThresholdEvent`
            The smallest margin is below 0: one run decides on all requirements. A margin is the distance from the
            limit divided by the distance of the nominal run, so that all requirements count alike in an algorithm that
            approaches the failure in levels.

        Raises
        ------
        CaseError
            If the case has no requirements.
        """
        function, composition, _, _ = self.getComponents(None)
        return self._event(ot.ComposedFunction(composition, function), ot.Less(), 0.0, SYSTEM)

    def getComponents(
        self, requirement: str | Requirement | None = None
    ) -> tuple[ot.Function, ot.Function, list[int], ot.Function]:
        """The smooth components behind an event, and how they make up the variable that the event compares.

        A surrogate of a norm, of an absolute value or of a minimum over time is poor at the kinks; surrogates of their
        arguments are not. The smallest distance of a re-contact stands for itself: it is smooth as long as a
        push along the track opens distance, and bends where the bodies come back to each other, as after a push across
        the track; algorithms with surrogates need more runs there, or do not converge and say so.

        Parameters
        ----------
        requirement : str or Requirement, optional
            None stands for the system event.

        Returns
        -------
        function : :class:`openturns.Function`
            From the inputs to p components, by one true run.
        composition : :class:`openturns.Function`
            Native; from the p components to the variable of the event.
        smoothIndices : list of int
            The components that are smooth.
        surrogateComposition : :class:`openturns.Function`
            Native; from the smooth components alone to the variable of the event. For the clearance: the minimum over
            the points of their clearance at the exit, which is where the minimum over time nearly always lies.

        Raises
        ------
        ValueError
            If there is no such requirement or quantity; a CaseError if the case has no requirements at all.
        """
        requirements = self._requirements(requirement)
        names, smooth_names = self._component_names(requirements)
        # Not getMarginal, whose Hessian has no diagonal in OpenTURNS 1.27: SORM would be wrong.
        function = ot.Function(SeparationFunction(self._case, quantities=names, countsEndings=True))
        return (
            function,
            self._composition(requirement, requirements, names, True),
            [names.index(name) for name in smooth_names],
            self._composition(requirement, requirements, smooth_names, False),
        )

    def getMeasuredComponents(
        self, requirement: str | Requirement | None = None, ofAll: bool = False
    ) -> tuple[ot.Function, ot.Function]:
        """The components behind an event that another simulator can give, too: no more than a requirement is about.

        Parameters
        ----------
        requirement : str or Requirement, optional
            None stands for the system event.
        ofAll : bool
            Whether the components are those of all requirements, so that one run serves all events.

        Returns
        -------
        function : :class:`openturns.Function`
            From the inputs to p components, by a run of this package's simulator: the parts of a norm, or the quantity
            of the requirement itself.
        composition : :class:`openturns.Function`
            Native; from the p components to the variable of the event.

        Raises
        ------
        ValueError
            As for `getComponents`.

        Examples
        --------
        >>> from satsep_ot.model.separation_problem import SeparationProblem
        >>> function, composition = SeparationProblem("reference").getMeasuredComponents("lateral rate")
        >>> function.getOutputDescription(), composition([3.0, 4.0])[0]
        ([rate_x [deg/s],rate_z [deg/s]], 5.0)
        """
        requirements = self._requirements(requirement)
        wanted = self._requirements(None) if ofAll else requirements
        parts = [self._quantities[entry.quantity].norm_of or (entry.quantity,) for entry in wanted]
        names = list(dict.fromkeys(name for group in parts for name in group))
        function = ot.Function(SeparationFunction(self._case, quantities=names, countsEndings=True))
        return function, self._composition(requirement, requirements, names, True)

    def getSmoothComponentNames(self, requirement: str | Requirement | None = None) -> list[str]:
        """Names of the smooth components behind an event, in the order of the smooth indices of `getComponents`.

        Parameters
        ----------
        requirement : str or Requirement, optional
            As for `getComponents`.

        Returns
        -------
        names : list of str
            Quantities of interest.
        """
        return self._component_names(self._requirements(requirement))[1]

    def _requirements(self, requirement):
        """The requirement, or all of the case for None."""
        if requirement is not None:
            return [self._requirement(requirement)]
        if not self._case.requirements:
            raise CaseError(f"{self._case.name}: the case has no requirements; give at least one [[requirements]]")
        return list(self._case.requirements)

    def _composition(self, requirement, requirements, variables, exact):
        """What an event compares, of these variables: a quantity, or for None the smallest margin of all."""
        values = [self._compared(entry, variables, exact) for entry in requirements]
        if requirement is not None:
            return values[0]
        margins = ot.ComposedFunction(self._margins(), ot.AggregatedFunction(values))
        return _described(
            ot.ComposedFunction(minimumFunction(len(values)), margins), self._labels(variables), "smallest margin [1]"
        )

    def _component_names(self, requirements):
        """Names of all components of requirements, and of those that are smooth."""
        names, smooth = [], set()
        for quantity in (entry.quantity for entry in requirements):
            parts = self._smooth_components(quantity)
            names += parts if self._quantities[quantity].norm_of else [quantity, *parts]
            smooth |= set(parts)
        names = list(dict.fromkeys(names))
        return names, [name for name in names if name in smooth]

    def _event(self, function, comparison, threshold, name):
        variable = ot.CompositeRandomVector(function, ot.RandomVector(self.getDistribution()))
        variable.setDescription(function.getOutputDescription())
        event = ot.ThresholdEvent(variable, comparison, threshold)
        event.setName(name)
        return event

    def _requirement(self, requirement):
        if isinstance(requirement, Requirement):
            if requirement.quantity not in self._quantities:
                raise ValueError(
                    f"'{requirement.quantity}' is no quantity of this case; it has {', '.join(self._quantities)}"
                )
            return requirement
        names = self.getRequirementNames()
        if requirement not in names:
            hint = did_you_mean(str(requirement), names)
            raise ValueError(
                f"'{requirement}' is no requirement of this case; it has {', '.join(names)}, and all of them as "
                f"getSystemEvent(){hint}"
            )
        return self._case.requirements[names.index(requirement)]

    def _labels(self, names):
        return [f"{name} [{self._quantities[name].unit}]" for name in names]

    def _smooth_components(self, quantity):
        """Names of the smooth quantities that this one is, or nearly always is, made of."""
        if self._quantities[quantity].norm_of:
            return list(self._quantities[quantity].norm_of)
        return [name for name, entry in self._quantities.items() if entry.part_of == quantity] or [quantity]

    def _quantity(self, quantity, variables, exact):
        """A quantity as a native function of the variables: its smooth components, or (exact) the clearance itself."""
        parts = self._quantities[quantity].norm_of
        if parts:
            outer = _norm(len(parts)) if len(parts) > 1 else _absolute_value()
        elif quantity == "clearance" and not exact:
            parts = self._smooth_components(quantity)
            outer = minimumFunction(len(parts))
        else:
            parts, outer = [quantity], None
        select = ot.Matrix(len(parts), len(variables))
        for row, part in enumerate(parts):
            select[row, variables.index(part)] = 1.0
        selection = ot.LinearFunction([0.0] * len(variables), [0.0] * len(parts), select)
        function = selection if outer is None else ot.ComposedFunction(outer, selection)
        return _described(function, self._labels(variables), self._labels([quantity])[0])

    def _compared(self, entry, variables, exact):
        """What a requirement holds against its limit, as a native function of the variables."""
        value = self._quantity(entry.quantity, variables, exact)
        if entry.center is None:
            return value
        distance = ot.ComposedFunction(_distance(entry.center), value)
        unit = self._quantities[entry.quantity].unit
        return _described(distance, self._labels(variables), f"|{entry.quantity} - {entry.center:g}| [{unit}]")

    def _margins(self):
        """The linear map from the requirements' quantities to margins: 0 at the limit, of size 1 at the nominal run."""
        nominal = simulate(self._case.separation)
        requirements = self._case.requirements
        slopes = ot.Matrix(len(requirements), len(requirements))
        for k, entry in enumerate(requirements):
            scale = abs(entry.compared(nominal.quantity(entry.quantity)[0]) - entry.limit) or abs(entry.limit) or 1.0
            slopes[k, k] = (-1.0 if entry.is_maximum else 1.0) / scale
        return ot.LinearFunction([entry.limit for entry in requirements], [0.0] * len(requirements), slopes)


def _described(function, inputs, output):
    function = ot.Function(function)
    function.setInputDescription(inputs)
    function.setOutputDescription([output])
    return function


def _norm(size):
    first, *others = (f"v{k}" for k in range(size))
    squares = "".join(f" + {name}^2" for name in others)
    formula = ot.SymbolicFunction([first, *others, "kink"], [f"sqrt(({first} + kink)^2{squares})"])
    return ot.ParametricFunction(formula, [size], [_KINK])


def _absolute_value():
    return ot.ParametricFunction(ot.SymbolicFunction(["x", "kink"], ["abs(x + kink)"]), [1], [_KINK])


def _distance(center):
    """The distance from a number, which the center of a requirement is."""
    formula = ot.SymbolicFunction(["x", "center", "kink"], ["abs((x - center) + kink)"])
    return ot.ParametricFunction(formula, [1, 2], [center, _KINK])
