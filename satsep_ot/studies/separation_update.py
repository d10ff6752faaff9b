"""Update the probabilities of a case by ground tests."""

import math
import os
import time
from collections.abc import Callable, Sequence

import numpy as np
import openturns as ot

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.methods.updating.algorithm import TwoLevelUpdating
from satsep_ot.methods.updating.experiments import Experiment, Measurement
from satsep_ot.methods.updating.failure_probability import FailureProbabilities, Limit, ProbabilityDistribution
from satsep_ot.methods.updating.next_experiments import NextExperiments, Outlook, failureFreeNumber, neededNumber
from satsep_ot.methods.updating.posterior import UpdatingError
from satsep_ot.methods.updating.two_level import TwoLevelInputs
from satsep_ot.model.case import SYSTEM, Case, CaseError, load_uncertain_case
from satsep_ot.model.ground_tests import (
    GroundTest,
    SeparationModel,
    changed_inputs,
    load_ground_tests,
    measured_inputs,
)
from satsep_ot.model.inputs import joint_distribution
from satsep_ot.openturns_object import OpenTURNSObject
from satsep_ot.studies.telling.update_results import (
    LEVELS,
    LearntParameter,
    ProbabilityRange,
    RequirementOutlook,
    Sampling,
    UpdatedProbability,
    UpdateResult,
)

SIZE = 1000  # draws of what is not known, at which the probabilities are computed


class SeparationUpdate(OpenTURNSObject):
    """From ground tests to the probability in flight.

    The keys `in_tests`, `mean_uncertainty` and `sigma_uncertainty` of the uncertain inputs say what tests and flight
    share; by default nothing.

    Parameters
    ----------
    case : Case, str or path
        As for :func:`satsep_ot.model.case.load_case`.
    tests : str, path or list of :class:`~satsep_ot.model.ground_tests.GroundTest`
        A CSV file with the columns test, quantity, value, sigma, and one for each key of the case in which a test
        differed.
    size : int
        Draws of what is not known, at which the probabilities are computed.
    seed : int, optional
        Of OpenTURNS' random generator, set when `run` begins. By default the generator goes on as it is.

    Raises
    ------
    CaseError
        In one sentence, if the case or the tests cannot be used.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.ground_tests import parse_ground_tests
    >>> from satsep_ot.studies.separation_update import SeparationUpdate
    >>> case = load_case("reference")
    >>> tests = parse_ground_tests("test,quantity,value,sigma\\nscale,satellite.mass,100.4,0.05", case)
    >>> update = SeparationUpdate(case, tests, size=100)
    >>> update.run()
    >>> mass = update.getResult().learnt[0]
    >>> print(mass.name, mass.kind, f"{mass.after:.3f} {mass.after_sigma:.3f}")
    satellite_mass value 100.396 0.050
    """

    def __init__(
        self,
        case: Case | str | os.PathLike,
        tests: str | os.PathLike | Sequence[GroundTest],
        size: int = SIZE,
        seed: int | None = None,
    ) -> None:
        self._case = load_uncertain_case(case)
        if isinstance(tests, (str, os.PathLike)):
            self._tests, self._file = load_ground_tests(tests, self._case), f"{tests}: "
        else:
            self._tests, self._file = list(tests), ""
        if size < 1:
            raise ValueError(f"size = {size}; it must be at least 1")
        self._size, self._seed = size, seed
        self._nextTest: str | None = None
        self._progress: Callable[[str, float], None] = _tellNobody
        self._result: UpdateResult | None = None
        self._draws: dict[str, tuple[np.ndarray, np.ndarray]] = {}
        rows = self._case.inputs
        try:
            self._inputs = TwoLevelInputs(
                joint_distribution(rows, self._case.copula),
                [i for i, row in enumerate(rows) if row.is_shared_by_tests],
                [row.mean_uncertainty for row in rows],
                [row.sigma_uncertainty / row.distribution.getStandardDeviation()[0] for row in rows],
                [row.entry or row.name for row in rows],
            )
            self._experiments = self._made()
            self._updating = TwoLevelUpdating(self._inputs, self._experiments)
        except ValueError as error:
            raise CaseError(f"{self._file or self._case.name + ': '}{error}") from error

    def _shown(self):
        return {"case": self._case.name, "tests": len(self._tests), "size": self._size}

    def setNextTest(self, name: str) -> None:
        """The test that further tests would repeat; by default the last one in which more than inputs was measured."""
        names = [experiment.name for experiment in self._experiments if experiment.measuresOutputs]
        if name not in names:
            raise CaseError(f"{self._file}{name!r} is no test with a measured velocity or rate; there are {names}")
        self._nextTest = name

    def setProgressCallback(self, callback: Callable[[str, float], None]) -> None:
        """Called with what is being done, and the share that is done."""
        self._progress = callback

    def run(self) -> None:
        """Check the tests, learn from them, and compute the probabilities before and after.

        Raises
        ------
        CaseError
            The tests lie far outside what the case predicts, or contradict each other.
        """
        begin = time.perf_counter()
        if self._seed is not None:
            ot.RandomGenerator.SetSeed(self._seed)
        self._progress("tests against the case, and what they teach", 0.0)
        try:
            self._updating.run()
        except UpdatingError as error:
            raise CaseError(f"{self._file}{error}") from error
        learnt = self._updating.getResult()
        limits, flight = self._limits()
        probabilities = FailureProbabilities(self._inputs, flight, limits)
        # Without anything that is not known there is one probability.
        size = self._size if self._inputs.getParameters() else 1
        self._progress("probabilities before the tests", 0.3)
        before = probabilities.compute(learnt.drawPrior(size))
        self._progress("probabilities after the tests", 0.5)
        parameters = learnt.drawParameters(size)
        after = probabilities.compute(parameters)
        self._draws = {limit.name: (before[:, j], after[:, j]) for j, limit in enumerate(limits)}
        self._progress("what more tests would teach", 0.8)
        outlooks, name = self._outlooks(NextExperiments(self._inputs, parameters, after, limits), limits)
        posterior, (runs, gradients) = learnt.getPosterior(), learnt.getEvaluations()
        self._result = UpdateResult(
            case=self._case.name,
            tests={test.name: dict(test.conditions) for test in self._tests},
            probabilities=tuple(
                UpdatedProbability(
                    limit.name,
                    str(entry) if entry else "any of them",
                    limit.allowed,
                    _range(before[:, j]),
                    _range(after[:, j]),
                )
                for j, (limit, entry) in enumerate(zip(limits, [*self._case.requirements, None], strict=False))
            ),
            learnt=tuple(self._learnt(learnt)),
            misfits=tuple(learnt.getMisfits()),
            outlooks=outlooks,
            next_test=name,
            sampling=Sampling(
                posterior.method.value,
                posterior.effectiveSize,
                posterior.rhat,
                posterior.converged,
                runs + probabilities.evaluations,
                gradients,
                time.perf_counter() - begin,
            ),
            remarks=tuple(learnt.getRemarks()),
        )
        self._progress("done", 1.0)

    def getResult(self) -> UpdateResult:
        """What `run` found, as data."""
        if self._result is None:
            raise RuntimeError("There is no result yet; call run() first.")
        return self._result

    def getProbabilities(self, requirement: str) -> tuple[ot.Sample, ot.Sample]:
        """Equally likely values of the probability of violating a requirement, before and after the tests.

        Parameters
        ----------
        requirement : str
            By its name; "any requirement" stands for the violation of any.
        """
        if requirement not in self._draws:
            raise ValueError(f"{requirement!r} is no requirement with a result; there are {list(self._draws)}")
        before, after = self._draws[requirement]
        return ot.Sample.BuildFromPoint(before), ot.Sample.BuildFromPoint(after)

    def drawProbability(self, requirement: str) -> ot.Graph:
        """The distribution functions of the probability of violating a requirement, before and after the tests."""
        graph = ot.Graph(requirement, "probability of violation", "credibility of at most this", True, "lower right")
        for sample, legend in zip(self.getProbabilities(requirement), ("before", "after"), strict=True):
            values = np.sort(np.array(sample)[:, 0])
            shares = (np.arange(len(values)) + 0.5) / len(values)
            positive = values > 0.0
            curve = ot.Curve(values[positive], shares[positive])
            curve.setLegend(legend)
            graph.add(curve)
        graph.setLogScale(ot.GraphImplementation.LOGX)
        graph.setColors(ot.Drawable.BuildDefaultPalette(2))
        return graph

    def _made(self):
        """The experiments: one for each test, and one for each further piece that was measured."""
        models: dict[int, tuple[SeparationModel, list[str]]] = {}
        experiments = []
        for test in self._tests:
            if id(test.separation) not in models:
                same = [other for other in self._tests if other.separation is test.separation]
                table = quantity_table(test.separation)
                names = list(
                    dict.fromkeys(row.quantity for other in same for row in other.rows if row.quantity in table)
                )
                models[id(test.separation)] = SeparationModel(self._case.inputs, test.separation, names), names
            model, names = models[id(test.separation)]
            own = changed_inputs(self._case, test.separation)
            together = []
            for row in test.rows:
                if row.quantity in names:
                    together.append(Measurement(row.quantity, names.index(row.quantity), row.value, row.sigma))
                    continue
                members = measured_inputs(self._case, row.quantity)
                measurement = Measurement(row.quantity, members[0], row.value, row.sigma, isInput=True)
                if len(members) == 1:
                    together.append(measurement)
                else:
                    experiments.append(Experiment(test.name, model, (measurement,)))
            if together:
                experiments.append(Experiment(test.name, model, tuple(together), own))
        return experiments

    def _limits(self):
        """The limits of the case, and what computes the quantities that they need."""
        table, requirements = quantity_table(self._case.separation), self._case.requirements
        parts = {}
        for entry in requirements:
            quantity = table[entry.quantity]
            members = [name for name, one in table.items() if one.part_of == entry.quantity]
            parts[entry.quantity] = list(quantity.norm_of) or members or [entry.quantity]
        names = list(dict.fromkeys([*parts, *(name for some in parts.values() for name in some)]))
        nominal = simulate(self._case.separation)
        limits, scales = [], []
        for entry in requirements:
            column = names.index(entry.quantity)
            columns = [names.index(name) for name in parts[entry.quantity]]
            isNorm = bool(table[entry.quantity].norm_of)
            limits.append(
                Limit(
                    entry.name,
                    _margin(entry, lambda outputs, column=column: outputs[:, column]),
                    _margin(
                        entry, lambda outputs, columns=columns, isNorm=isNorm: _composed(outputs[:, columns], isNorm)
                    ),
                    entry.allowed_probability,
                )
            )
            scales.append(
                abs(float(entry.compared(nominal.quantity(entry.quantity)[0])) - entry.limit) or abs(entry.limit) or 1.0
            )
        if len(limits) > 1:
            limits.append(
                Limit(
                    SYSTEM,
                    _smallest([limit.margin for limit in limits], scales),
                    _smallest([limit.smoothMargin for limit in limits], scales),
                )
            )
        return limits, SeparationModel(self._case.inputs, self._case.separation, names)

    def _learnt(self, learnt):
        parameters = self._inputs.getParameters()
        if not parameters:
            return
        mean, sigma = learnt.getMoments()
        interval = learnt.getInterval()
        for k, row in enumerate(parameters):
            known = self._case.inputs[row.input]
            centre, scatter = known.distribution.getMean()[0], known.distribution.getStandardDeviation()[0]
            before = {
                "value": (centre, math.hypot(scatter, known.mean_uncertainty)),
                "mean": (centre, known.mean_uncertainty),
                "sigma": (scatter, known.sigma_uncertainty),
            }[row.kind]
            after = (float(mean[k]), float(sigma[k]), *map(float, interval[k]))
            name = known.name if row.kind == "value" else row.name
            yield LearntParameter(name, row.kind, known.unit, *before, *after)

    def _outlooks(self, futures, limits):
        """What further tests would teach, by requirement, and the test that they repeat."""
        measuring = {experiment.name: experiment for experiment in self._experiments if experiment.measuresOutputs}
        name = self._nextTest or (list(measuring)[-1] if measuring else "")
        measured: dict[str, list[Outlook]] = {}
        if name and self._inputs.getParameters():
            measured = futures.measured(measuring[name])
        counted = futures.counted() if self._inputs.getParameters() else {}
        found = []
        for limit in limits:
            first, second = measured.get(limit.name, []), counted.get(limit.name, [])
            allowed = limit.allowed
            found.append(
                RequirementOutlook(
                    limit.name,
                    tuple(first),
                    neededNumber(first),
                    tuple(second),
                    neededNumber(second),
                    None if allowed is None else failureFreeNumber(allowed),
                )
            )
        return tuple(found), name


def _tellNobody(label, share):
    """Nothing is shown."""


def _margin(entry, value):
    sign = 1.0 if entry.is_maximum else -1.0
    return lambda outputs: sign * (entry.limit - entry.compared(value(outputs)))


def _composed(values, isNorm):
    """A quantity from its smooth parts (N, m): their norm, or the smallest of them."""
    return np.linalg.norm(values, axis=1) if isNorm else values.min(axis=1)


def _smallest(margins, scales):
    return lambda outputs: np.min(
        [margin(outputs) / scale for margin, scale in zip(margins, scales, strict=True)], axis=0
    )


def _range(values):
    distribution = ProbabilityDistribution(values)
    return ProbabilityRange(
        distribution.mean,
        distribution.meanError,
        tuple(distribution.quantile(level) for level in LEVELS),
        distribution.quantile(0.05),
        distribution.quantile(0.95),
    )
