"""What drives a violation, which tolerance to tighten, and what the most likely violation looks like."""

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult
from satsep_ot.model.case import SYSTEM, Case
from satsep_ot.model.inputs import ParameterMap, UncertainInput, joint_distribution
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.model.spelling import did_you_mean
from satsep_ot.openturns_adapter import raiseInterrupt


def tolerances(case: Case) -> dict[str, list[UncertainInput]]:
    """The inputs of a case by the tolerance, the group of inputs that is tightened as one, that they belong to.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`

    Returns
    -------
    rows : dict of str to list of :class:`satsep_ot.model.inputs.UncertainInput`

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.drivers import tolerances
    >>> len(tolerances(load_case("reference"))), len(tolerances(load_case("reference"))["stiffness"])
    (20, 4)
    """
    rows: dict[str, list[UncertainInput]] = {}
    for row in case.inputs:
        rows.setdefault(row.group or row.entry or row.name, []).append(row)
    return rows


def check_tolerances(case: Case, names: Iterable[str]) -> None:
    """Refuse a name that is no tolerance of a case, with a ValueError that names those that are."""
    known = tolerances(case)
    for name in names:
        if name not in known:
            hint = did_you_mean(name, known)
            raise ValueError(f"'{name}' is no tolerance of this case; it has {', '.join(known)}{hint}")


def driver_shares(case: Case, subspaces: Sequence[ActiveSubspaceResult]) -> dict[str, float]:
    """The share of each tolerance in what moves the smooth components of a requirement.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
    subspaces : sequence of :class:`satsep_ot.methods.subspaces.result.ActiveSubspaceResult`
        Of the components, one output each.

    Returns
    -------
    shares : dict of str to float
        By tolerance, the largest first; they sum to 1. Mean squared derivatives with respect to the standardised
        inputs (Sobol and Kucherenko 2009), each component over its sum, and the mean over the components.
    """
    total = np.zeros(len(case.inputs))
    for subspace in subspaces:
        squares = np.array(subspace.getDerivativeBasedIndices())
        total += squares / (squares.sum() * len(subspaces))
    by_input = dict(zip((row.name for row in case.inputs), total, strict=True))
    shares = {name: float(sum(by_input[row.name] for row in rows)) for name, rows in tolerances(case).items()}
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def importance_shares(case: Case, result: ActiveSubspaceReliabilityResult) -> dict[str, float]:
    """The share of each tolerance in the violations themselves.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
    result : :class:`satsep_ot.methods.reliability.result.ActiveSubspaceReliabilityResult`

    Returns
    -------
    shares : dict of str to float
        By tolerance, the largest first; they sum to 1. How much the distribution of each input among the violations
        differs from its distribution among all runs (`computeImportance`), summed over the inputs of a tolerance.
        Empty where the result cannot tell.
    """
    try:
        rows = result.computeImportance()
    except RuntimeError:
        return {}
    by_input = {row.name: one.share for row, one in zip(case.inputs, rows, strict=True)}
    shares = {name: float(sum(by_input[row.name] for row in members)) for name, members in tolerances(case).items()}
    return dict(sorted(shares.items(), key=lambda item: -item[1]))


def scaled_distribution(case: Case, tolerance: str, scale: float) -> ot.JointDistribution:
    """The joint distribution of the inputs with the scatter of one tolerance scaled about its mean.

    Parameters
    ----------
    case, tolerance, scale
        As for `scaled_case`; a scale below 1.

    Returns
    -------
    distribution : :class:`openturns.JointDistribution`

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.drivers import scaled_distribution
    >>> print(scaled_distribution(load_case("reference"), "satellite_mass", 0.5).getMarginal(0))
    Normal(mu = 100, sigma = 0.25)
    """
    names = {row.name for row in tolerances(case)[tolerance]}
    rows = [
        dataclasses.replace(row, distribution=_scaled_marginal(row.distribution, scale)) if row.name in names else row
        for row in case.inputs
    ]
    return joint_distribution(rows, case.copula)


def _scaled_marginal(marginal, scale):
    mean = marginal.getMean()[0]
    scaled = marginal * scale + mean * (1.0 - scale)
    # The sum of one variable and a constant is a distribution of that variable's kind where OpenTURNS knows it.
    return ot.Distribution(scaled)


def tightened_probabilities(
    case: Case, result: ActiveSubspaceReliabilityResult, names: Sequence[str], scale: float = 0.9
) -> dict[str, float]:
    """The probability of a violation under each tolerance tightened a little, from the runs that are there already.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
    result : :class:`satsep_ot.methods.reliability.result.ActiveSubspaceReliabilityResult`
    names : sequence of str
        Of the tolerances.
    scale : float
        Of the scatter of the tolerance, near 1, so that the runs still carry the answer.

    Returns
    -------
    ratios : dict of str to float
        Probability then over probability now, the smallest first. Empty where the result cannot tell.
    """
    ratios = {}
    for name in names:
        try:
            answer = result.computeProbability(scaled_distribution(case, name, scale))
        except (RuntimeError, ValueError) as error:
            raiseInterrupt(error)
            continue
        if not answer.warning and result.getProbabilityEstimate() > 0.0:
            ratios[name] = max(answer.probability, 0.0) / result.getProbabilityEstimate()
    return dict(sorted(ratios.items(), key=lambda item: item[1]))


def scaled_case(case: Case, tolerance: str, scale: float) -> Case:
    """The case with the scatter of one tolerance scaled about its mean.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
    tolerance : str
        A key of `tolerances`.
    scale : float
        Positive; 0.5 halves every deviation.

    Returns
    -------
    case : :class:`satsep_ot.model.case.Case`

    Raises
    ------
    ValueError
        If there is no such tolerance.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.studies.drivers import scaled_case
    >>> scaled_case(load_case("reference"), "satellite_mass", 0.5).inputs[0].factor
    0.5
    """
    check_tolerances(case, [tolerance])
    names = {row.name for row in tolerances(case)[tolerance]}
    # It is not what the case file says any more.
    inputs = tuple(row.scaled(scale) if row.name in names else row for row in case.inputs)
    return dataclasses.replace(case, inputs=inputs, text="", files={})


def changed_probability(
    case: Case, requirement: str, target: float = 0.1, maximum: int = 5000
) -> ActiveSubspaceReliabilityResult:
    """The probability of a violation of a changed case, by new true runs.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
    requirement : str
        A requirement, or "any requirement".
    target : float
        Coefficient of variation at which the runs end.
    maximum : int
        Number of runs at which they end in any case.

    Returns
    -------
    result : :class:`satsep_ot.methods.reliability.result.ActiveSubspaceReliabilityResult`
    """
    problem = SeparationProblem(case)
    given = None if requirement == SYSTEM else requirement
    algorithm = ActiveSubspaceReliability(problem.getSystemEvent() if given is None else problem.getEvent(given))
    algorithm.setComponents(*problem.getComponents(given))
    algorithm.setTargetCoefficientOfVariation(target)
    algorithm.setMaximumEvaluations(maximum)
    algorithm.run()
    return algorithm.getResult()


@dataclasses.dataclass
class Violation:
    """The most likely violation of a requirement that was found.

    Attributes
    ----------
    inputs, standard : ndarray, shape (d,)
        The run, in the units of the inputs and in standard space.
    distance : float
        Distance from the origin of standard space, the reliability index of Hasofer and Lind if there is none nearer.
    """

    inputs: np.ndarray
    standard: np.ndarray
    distance: float


def most_likely_violation(
    problem: SeparationProblem, requirement: str, sample: np.ndarray | None = None
) -> Violation | None:
    """The violation nearest to the origin of standard space.

    Parameters
    ----------
    problem : :class:`satsep_ot.model.separation_problem.SeparationProblem`
    requirement : str
    sample : array_like, shape (n, d), optional
        Inputs of true runs, some of which violate the requirement: the search starts at the nearest of these.

    Returns
    -------
    violation : Violation, or None
        A true run that violates the requirement. None where no search reached the limit.
    """
    entry = next(entry for entry in problem.getRequirements() if entry.name == requirement)
    distribution = problem.getDistribution()
    transformation = distribution.getIsoProbabilisticTransformation()
    inverse = distribution.getInverseIsoProbabilisticTransformation()
    model = SeparationFunction(problem.getCase(), quantities=[entry.quantity], countsEndings=True)

    def violation(standard):
        # A design point lies on the limit, on either side of it within rounding: the first step beyond is a violation.
        for stretch in (1.0, 1.0001, 1.001, 1.01):
            inputs = np.array(inverse(ot.Point(stretch * standard)))
            if not entry.is_met(model.evaluate(inputs[None])[0, 0]):
                return Violation(inputs, stretch * standard, float(np.linalg.norm(stretch * standard)))
        return None

    starts = [np.full(distribution.getDimension(), 0.1)]
    found = []
    if sample is not None and len(sample):
        sample = np.asarray(sample)
        failed = sample[[not entry.is_met(value) for value in model.evaluate(sample)[:, 0]]]
        if len(failed):
            standard = np.array(transformation(ot.Sample(failed)))
            nearest = standard[np.argmin(np.linalg.norm(standard, axis=1))]
            found.append(violation(nearest))
            starts.insert(0, nearest)
    event = problem.getEvent(requirement)
    for start in starts:
        solver = ot.AbdoRackwitz()
        solver.setStartingPoint(inverse(ot.Point(start)))
        solver.setMaximumIterationNumber(50)
        try:
            search = ot.FORM(solver, event)
            search.run()
            found.append(violation(np.array(search.getResult().getStandardSpaceDesignPoint())))
        except RuntimeError as error:
            # Neither the search nor every run succeeds: the nearest true violation then stands.
            raiseInterrupt(error)
            continue
        if found[-1] is not None:
            break
    found = [one for one in found if one is not None]
    return min(found, key=lambda one: one.distance, default=None)


def run_parameters(case: Case, inputs: ArrayLike) -> np.ndarray:
    """The separation's flat parameter vector of one run.

    Parameters
    ----------
    case : :class:`satsep_ot.model.case.Case`
    inputs : array_like, shape (d,)
        In the units of the inputs.

    Returns
    -------
    parameters : ndarray, shape (P,)
    """
    return ParameterMap(case.inputs, case.separation).parameters(np.atleast_2d(np.asarray(inputs, dtype=float)))[0]
