"""What a study found, as dataclasses: the study fills them in; verdicts, tables, figures and the report take them."""

import dataclasses
import enum
import math
import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from satsep_ot.dynamics.quantities import QUANTITIES, Quantity
from satsep_ot.methods.comparison.method import Row
from satsep_ot.methods.polynomials.regression_result import MultivariatePolynomialRegressionResult
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult
from satsep_ot.model.case import Case, Requirement
from satsep_ot.model.inputs import UncertainInput
from satsep_ot.studies.telling.class_choice import ClassChoice
from satsep_ot.studies.telling.failure_mixture import FailureMixture
from satsep_ot.studies.telling.fleet import FleetEstimate
from satsep_ot.studies.telling.scatter import describe_inputs, describe_scatters
from satsep_ot.studies.telling.tolerance_curves import RequirementCurves
from satsep_ot.studies.telling.words import StudyMethod


class DriverMeasure(enum.StrEnum):
    """What the share of a tolerance is a share of."""

    VIOLATIONS = "violations"
    SENSITIVITY = "squared sensitivity"


class Interval(NamedTuple):
    """A probability with the bounds of its 95 % interval."""

    probability: float
    lower: float
    upper: float

    def overlaps(self, other: "Interval") -> bool:
        """Whether some probability is in both."""
        return self.lower <= other.upper and other.lower <= self.upper


def _interval(row):
    if row.probability is None or row.lower95 is None or row.upper95 is None:
        return None
    return Interval(row.probability, row.lower95, row.upper95)


@dataclasses.dataclass(frozen=True)
class Estimate:
    """The probability of violating one requirement, or any of them, by one method.

    Attributes
    ----------
    requirement : str
    method : StudyMethod
    probability, lower95, upper95, coefficient_of_variation : float or None
        None where the method gives no such number.
    evaluations, gradients : int
        Runs of the simulator and gradients.
    seconds : float
    converged : bool
    note : str
        Why the method ended, or what went wrong.
    audits : int
        Wide runs that looked in all directions for failures that the estimate lacks; 0 for a method without any.
    audit_spread : float
        Standard deviation of the last of them, in standard space.
    upper_together : float or None
        Upper bound at the level at which the bounds of all requirements hold at once with 95 % (Bonferroni).
    """

    requirement: str
    method: StudyMethod
    probability: float | None = None
    lower95: float | None = None
    upper95: float | None = None
    coefficient_of_variation: float | None = None
    evaluations: int = 0
    gradients: int = 0
    seconds: float = 0.0
    converged: bool = False
    note: str = ""
    audits: int = 0
    audit_spread: float = 0.0
    upper_together: float | None = None

    @property
    def interval(self) -> Interval | None:
        """The probability with its bounds; None for a method without an interval."""
        return _interval(self)

    @staticmethod
    def of(requirement: str, row: Row) -> "Estimate":
        """The row of a comparison as an estimate of a requirement."""
        values = dataclasses.asdict(row)
        return Estimate(requirement, StudyMethod(values.pop("method")), **values)


@dataclasses.dataclass(frozen=True)
class HalvedTolerance:
    """The probability of violating a requirement with the scatter of one tolerance scaled.

    Attributes
    ----------
    tolerance : str
    scale : float
        Of the scatter.
    probability, lower95, upper95 : float or None
        None where no estimate could be made; the note says why.
    evaluations : int or None
    converged : bool
    note : str
    """

    tolerance: str
    scale: float
    probability: float | None = None
    lower95: float | None = None
    upper95: float | None = None
    evaluations: int | None = None
    converged: bool = False
    note: str = ""

    @property
    def interval(self) -> Interval | None:
        """The probability with its bounds; None where no estimate could be made."""
        return _interval(self)


@dataclasses.dataclass(frozen=True)
class Sizes:
    """The settings of a study: runs of the sample, gradients, tolerances halved, target precision, methods.

    The precision is None where runs were made until each requirement was decided. `screening` says whether what the
    sample decides was left at that.
    """

    sample: int
    gradients: int
    tolerances: int
    precision: float | None
    methods: tuple[StudyMethod, ...]
    screening: bool = False


@dataclasses.dataclass(frozen=True)
class RequirementEntry:
    """A requirement of the case: a limit on a quantity, and the accepted probability of violating it."""

    name: str
    quantity: str
    limit: float
    is_maximum: bool
    allowed_probability: float | None
    text: str
    unit: str
    center: float | None = None

    @property
    def ends(self) -> tuple[float, ...]:
        """The values of the quantity on the limit."""
        return self._requirement().ends

    @property
    def words(self) -> str:
        """The limit in words, with its unit."""
        name, (low, *high) = self.quantity.replace("_", " "), self.ends
        if self.center is None or self.center == 0.0:
            name = name if self.center is None else f"absolute value of {name}"
            return f"{name} {'at most' if self.is_maximum else 'at least'} {self.limit:g} {self.unit}"
        return f"{name} between {low:g} and {high[0]:g} {self.unit}"

    def _requirement(self):
        return Requirement(self.name, self.quantity, self.limit, self.is_maximum, self.allowed_probability, self.center)

    @staticmethod
    def of(requirement: Requirement, unit: str) -> "RequirementEntry":
        """The entry of a requirement whose quantity has a unit."""
        return RequirementEntry(**dataclasses.asdict(requirement), text=str(requirement), unit=unit)


@dataclasses.dataclass(frozen=True)
class QuantityValues:
    """A quantity of interest: its nominal value, and mean and standard deviation in the Monte Carlo sample.

    `part_of` is the quantity that this one is a part of, such as the clearance of one point; empty for the others.
    `norm_of` are the quantities that this one is the norm of.
    """

    unit: str
    description: str
    nominal: float
    mean: float | None = None
    deviation: float | None = None
    part_of: str = ""
    norm_of: tuple[str, ...] = ()

    @staticmethod
    def of(quantity: Quantity, nominal: float, mean: float | None, deviation: float | None) -> "QuantityValues":
        """The values of a quantity."""
        return QuantityValues(
            quantity.unit, quantity.description, nominal, mean, deviation, quantity.part_of, quantity.norm_of
        )


def main_quantities(quantities: dict[str, QuantityValues]) -> list[str]:
    """The quantities that are no part of another and not only there to be required."""
    return [
        name
        for name, values in quantities.items()
        if not values.part_of and (name not in QUANTITIES or QUANTITIES[name].is_main)
    ]


@dataclasses.dataclass(frozen=True)
class Exceedance:
    """The probability that a quantity lies beyond a limit, at rising limits, with its 95 % bounds at each of them."""

    is_maximum: bool
    limits: tuple[float, ...]
    probabilities: tuple[float, ...]
    lower95: tuple[float, ...]
    upper95: tuple[float, ...]


@dataclasses.dataclass(frozen=True)
class InputEntry:
    """An uncertain input: its tolerance in the case file, its distribution, and the comment there, such as a source."""

    name: str
    tolerance: str
    unit: str
    description: str
    distribution: str
    source: str

    @staticmethod
    def of(row: UncertainInput, case_text: str) -> "InputEntry":
        """The entry of an input of the case with this text."""
        tolerance = row.entry or row.name
        table = case_text.partition("\n[inputs]")[2].partition("\n[")[0]
        line = re.search(rf"^[ \t]*\"?{re.escape(tolerance)}\"?[ \t]*=(.*)$", table, re.MULTILINE)
        _, _, source = line[1].rpartition("#") if line and "#" in line[1] else ("", "", "")
        return InputEntry(row.name, tolerance, row.unit, row.description, str(row.distribution), source.strip())


@dataclasses.dataclass(frozen=True)
class Tolerance:
    """A tolerance of the case file: its scatter in words, its inputs, and what these are."""

    scatter: str
    inputs: tuple[str, ...]
    description: str

    @staticmethod
    def of(rows: Sequence[UncertainInput]) -> "Tolerance":
        """The tolerance whose inputs these are."""
        return Tolerance(describe_scatters(rows), tuple(row.name for row in rows), describe_inputs(rows))


@dataclasses.dataclass(frozen=True)
class ViolationInput:
    """One input of a run: its value, and in standard deviations from the median."""

    name: str
    unit: str
    value: float
    standard: float


@dataclasses.dataclass(frozen=True)
class MostLikelyViolation:
    """The most likely violation that was found: distance in standard space, quantities and inputs of the run."""

    distance: float
    quantities: dict[str, float]
    inputs: tuple[ViolationInput, ...]

    def extremes(self, count: int = 6) -> list[ViolationInput]:
        """The inputs that are furthest from their medians."""
        return sorted(self.inputs, key=lambda entry: -abs(entry.standard))[:count]

    @staticmethod
    def of(
        case: Case, quantities: dict[str, float], inputs: np.ndarray, standard: np.ndarray, distance: float
    ) -> "MostLikelyViolation":
        """The violation at a point, given in units of the inputs and in standard space, shape (d,) each."""
        values = zip(case.inputs, inputs, standard, strict=True)
        return MostLikelyViolation(
            distance, quantities, tuple(ViolationInput(row.name, row.unit, float(x), float(u)) for row, x, u in values)
        )


@dataclasses.dataclass(frozen=True)
class Component:
    """A smooth component on its active subspace, and the polynomial regression on its active variables.

    Attributes
    ----------
    subspace : :class:`satsep_ot.methods.subspaces.result.ActiveSubspaceResult`
    active, values : ndarray, shapes (N, r) and (N,)
        Active variables and values of the true runs.
    regression : :class:`satsep_ot.methods.polynomials.regression_result.MultivariatePolynomialRegressionResult`
    """

    subspace: ActiveSubspaceResult
    active: np.ndarray
    values: np.ndarray
    regression: MultivariatePolynomialRegressionResult


@dataclasses.dataclass(frozen=True)
class ComponentSummary:
    """The numbers of a `Component`: directions, largest eigenvalues, degree, Q2 leave-one-out, error bound.

    Q2 and the bound are None where too few gradients tell nothing of them.
    """

    dimension: int
    eigenvalues: tuple[float, ...]
    degree: int
    Q2: float | None
    error_bound: float | None

    @staticmethod
    def of(component: Component) -> "ComponentSummary":
        """The numbers of a component."""
        quality = component.regression.getQ2LeaveOneOut()[0]
        bound = component.subspace.getErrorBound()
        return ComponentSummary(
            component.subspace.getDimension(),
            tuple(component.subspace.getEigenvalues())[:10],
            component.regression.getDegree(),
            # Minus infinity where as many coefficients as runs were fitted: then nothing was left out.
            quality if math.isfinite(quality) else None,
            bound if math.isfinite(bound) else None,
        )


@dataclasses.dataclass(frozen=True)
class Diagnostics:
    """What ActiveSubspace says of its own estimate.

    Attributes
    ----------
    method, reason : str
        By what the probability was estimated at last, and why it ended.
    surrogate_probability : float or None
        By the surrogate alone.
    numbers : dict of str to float or None
        As :meth:`ActiveSubspaceReliabilityResult.getDiagnostics` names them.
    """

    method: str
    reason: str
    surrogate_probability: float | None
    numbers: dict[str, float | None]

    # The keys of results.json since version 0.1.0, beside the numbers.
    _KEYS = {"method": "method", "reason": "reason", "surrogate_probability": "surrogate probability"}

    @property
    def pareto_shape(self) -> float | None:
        """Shape of the tail of the corrections' weights; above 0.7 the interval is not reliable."""
        return self.numbers.get("Pareto k")

    @staticmethod
    def of(result: ActiveSubspaceReliabilityResult) -> "Diagnostics":
        """The diagnostics of a result; a number that is not finite is None."""
        numbers = {name: value if math.isfinite(value) else None for name, value in result.getDiagnostics().items()}
        return Diagnostics(result.getMethod(), result.getEndingSentence(), result.getSurrogateProbability(), numbers)

    def to_plain(self) -> dict[str, Any]:
        """As it stands in results.json."""
        return {**self.numbers, **{key: getattr(self, name) for name, key in self._KEYS.items()}}

    @staticmethod
    def from_plain(data: dict[str, Any]) -> "Diagnostics":
        """From what stands in results.json."""
        missing = [key for key in Diagnostics._KEYS.values() if key not in data]
        if missing:
            raise ValueError(f"{missing[0]} is missing")
        known = {name: data[key] for name, key in Diagnostics._KEYS.items()}
        return Diagnostics(**known, numbers={k: v for k, v in data.items() if k not in Diagnostics._KEYS.values()})


class Section(enum.StrEnum):
    """The groups of figures in a report."""

    SEPARATION = "separation"
    ANSWER = "answer"  # of results of version 0.1.0 alone
    DRIVERS = "drivers"
    TIGHTENED = "tightened"
    SIZES = "sizes"
    DENSITIES = "densities"
    EXCEEDANCES = "exceedances"
    EIGENVALUES = "eigenvalues"
    SUMMARIES = "summaries"
    METHODS = "methods"


@dataclasses.dataclass(frozen=True)
class FigureFile:
    """A figure of the report: the section that shows it, its name, its text alternative, its file."""

    section: Section
    name: str
    text: str
    file: str


@dataclasses.dataclass(frozen=True)
class StudyResult:
    """All that a study found.

    Attributes
    ----------
    case, description : str
    seed : int
    complete : bool
        Whether the study has run to its end.
    finished : str
        When, in the format of ISO 8601.
    versions : dict of str to str
        Of the packages that the numbers rest on.
    sizes : Sizes
    rows : tuple of Estimate
        Requirement by requirement, at last those of any requirement.
    requirements : tuple of RequirementEntry
    quantities : dict of str to QuantityValues
    tolerances : dict of str to Tolerance
    drivers : dict of str to dict of str to float
        By requirement, the share of each tolerance in its violations, the largest first.
    driver_measures : dict of str to DriverMeasure
        What these shares are shares of.
    ratios : dict of str to dict of str to float
        By requirement and tolerance, the factor of the probability with a tenth less scatter.
    tightened : dict of str to tuple of HalvedTolerance
    violations : dict of str to MostLikelyViolation
    components : dict of str to ComponentSummary
    diagnostics : dict of str to Diagnostics
    correlated : bool
        Whether the inputs are.
    assumptions : tuple of str
        What the numbers rest on, a sentence each.
    figures : tuple of FigureFile
    processors : tuple of str
        Of the machines that made the Monte Carlo sample, with versions.
    sunk : int or None
        Runs of the sample in which the satellite sinks into the deck or, with contact, does not come free: they violate
        every requirement. None where there is no sample.
    touched : float or None
        Share of the runs of the sample in which the bodies touched each other; None without contact.
    curves : dict of str to RequirementCurves
        By requirement, the probability against the size of its strongest tolerances.
    classes : ClassChoice or None
        The cheapest set of classes of tolerances; None where the case has no classes.
    failures : dict of str to FailureMixture
        By requirement, the probability with failures of parts; empty where the case names none.
    fleet : dict of str to FleetEstimate
        By requirement, the probability that any satellite of a fleet violates it; empty for a single satellite.
    inputs : tuple of InputEntry
        Every uncertain input.
    force_tables : dict of str to str
        The force-stroke tables of the case by the names of their files, as they were read.
    exceedances : dict of str to Exceedance
        By quantity.
    """

    case: str
    description: str
    seed: int
    complete: bool
    finished: str
    versions: dict[str, str]
    sizes: Sizes
    rows: tuple[Estimate, ...]
    requirements: tuple[RequirementEntry, ...]
    quantities: dict[str, QuantityValues]
    tolerances: dict[str, Tolerance]
    drivers: dict[str, dict[str, float]]
    ratios: dict[str, dict[str, float]]
    tightened: dict[str, tuple[HalvedTolerance, ...]]
    violations: dict[str, MostLikelyViolation]
    components: dict[str, ComponentSummary]
    diagnostics: dict[str, Diagnostics]
    correlated: bool
    assumptions: tuple[str, ...]
    figures: tuple[FigureFile, ...] = ()
    driver_measures: dict[str, DriverMeasure] = dataclasses.field(default_factory=dict)
    sunk: int | None = None
    touched: float | None = None
    processors: tuple[str, ...] = ()
    curves: dict[str, RequirementCurves] = dataclasses.field(default_factory=dict)
    classes: ClassChoice | None = None
    failures: dict[str, FailureMixture] = dataclasses.field(default_factory=dict)
    fleet: dict[str, FleetEstimate] = dataclasses.field(default_factory=dict)
    inputs: tuple[InputEntry, ...] = ()
    force_tables: dict[str, str] = dataclasses.field(default_factory=dict)
    exceedances: dict[str, Exceedance] = dataclasses.field(default_factory=dict)

    def rows_of(self, requirement: str) -> tuple[Estimate, ...]:
        """The estimates of one requirement, or of "any requirement"."""
        return tuple(row for row in self.rows if row.requirement == requirement)

    def rows_by_requirement(self) -> dict[str, tuple[Estimate, ...]]:
        """The estimates of each requirement that has any, in the order of the rows."""
        return {name: self.rows_of(name) for name in dict.fromkeys(row.requirement for row in self.rows)}
