"""The whole chain on one separation: a sample, active subspaces and regressions, and the probability of each violation.

This is the study of Hu et al. (2017): propagate the uncertainties through a polynomial on an active subspace and
estimate the failure probability, here corrected by true runs and held against the methods of OpenTURNS.
"""

import contextlib
import dataclasses
import datetime
import json
import math
import os
import platform
import tempfile
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.methods.common.storage import writeWhole
from satsep_ot.methods.comparison.active_subspace import ActiveSubspace
from satsep_ot.methods.comparison.comparison import ReliabilityComparison
from satsep_ot.methods.comparison.method import ReliabilityMethod
from satsep_ot.methods.comparison.methods import METHODS
from satsep_ot.methods.parallel.processor import processorDescription
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.model.case import SYSTEM
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.openturns_adapter import errorMessage, raiseInterrupt
from satsep_ot.openturns_object import OpenTURNSObject
from satsep_ot.studies import drivers
from satsep_ot.studies.deprecated_accessors import DeprecatedAccessors
from satsep_ot.studies.drivers import Violation
from satsep_ot.studies.results_directory import DirectoryError, ResultsDirectory, digest, file_stem, package_versions
from satsep_ot.studies.sample import SampleSummary, run_sample, sample_inputs
from satsep_ot.studies.surrogates import fit_component, sample_gradients, sample_surrogates
from satsep_ot.studies.telling.animation import animation_data
from satsep_ot.studies.telling.document import partial_document, results_document
from satsep_ot.studies.telling.panels import StudyRuns, study_panels
from satsep_ot.studies.telling.plain_data import from_plain, to_plain
from satsep_ot.studies.telling.remarks import assumptions
from satsep_ot.studies.telling.report import write_report
from satsep_ot.studies.telling.results import (
    Component,
    ComponentSummary,
    Diagnostics,
    DriverMeasure,
    Estimate,
    FigureFile,
    HalvedTolerance,
    MostLikelyViolation,
    QuantityValues,
    RequirementEntry,
    Sizes,
    StudyResult,
    Tolerance,
)
from satsep_ot.studies.telling.words import DEFAULT_METHODS, StudyMethod

STUDY_METHODS = tuple(StudyMethod)
# What a study writes, beside the case and its tables.
_WRITTEN = (
    "results.json", "motion.json", "report.html", "figures/*.svg", "runs/*.npz", "runs/sample.npy*", "steps/*.json",
    "steps/*.npz", "steps/sample.checkpoint*",
)  # fmt: skip
# Runs of the sample that densities are drawn from, and as many runs of the surrogates.
_DRAWN = 200_000
# A tolerance with a smaller share in the violations is not tightened.
_SMALLEST_SHARE = 0.01
# Where each step of a study begins, as a share of the whole.
_SUBSPACES_BEGIN, _METHODS_BEGIN, _TOLERANCES_BEGIN, _VIOLATIONS_BEGIN = 0.2, 0.3, 0.65, 0.92


def _reportNothing(label, share):
    """What is called where nobody asks for the progress."""


class SeparationStudy(DeprecatedAccessors, OpenTURNSObject):
    """Probability of violating each requirement of a separation, and any of them, by several methods.

    Parameters
    ----------
    problem : :class:`satsep_ot.model.separation_problem.SeparationProblem`
    methods : sequence of str
        Among ActiveSubspace, FORM, SORM, SubsetSampling, MonteCarlo, by default these; and PaperChain.
    seed : int
        Every method starts from a seed made of this one, its own name and the requirement, so that its row does not
        depend on which others run.
    sampleSize : int
        Runs of the Monte Carlo sample, which all requirements share.
    gradientSize : int
        Gradients for the active subspaces.
    toleranceSize : int
        How many of the strongest tolerances of each requirement are halved to see what that buys; 0 for none. It takes
        ActiveSubspace among the methods.
    targetCoefficientOfVariation : float
        At which ActiveSubspace ends, from 0.01 to 0.5. Its runs grow with 1 / square of it, and so does their limit,
        which is 5,000 at 0.05 and above.

    Raises
    ------
    ValueError
        If a method is unknown, a size is not positive, or the target is out of its range; a CaseError if the case has
        no requirements.

    Examples
    --------
    >>> from satsep_ot.model.separation_problem import SeparationProblem
    >>> from satsep_ot.studies.separation_study import SeparationStudy
    >>> study = SeparationStudy(SeparationProblem("reference"), methods=["MonteCarlo"], sampleSize=20000)
    >>> study.computeSample()
    >>> study.compareMethods()
    >>> [row.requirement for row in study.getResult().rows]
    ['lateral rate', 'spin', 'axial velocity', 'clearance', 'any requirement']
    """

    def __init__(
        self,
        problem: SeparationProblem,
        methods: Sequence[str] = DEFAULT_METHODS,
        seed: int = 0,
        sampleSize: int = 500_000,
        gradientSize: int = 300,
        toleranceSize: int = 2,
        targetCoefficientOfVariation: float = 0.05,
    ) -> None:
        unknown = [name for name in methods if name not in STUDY_METHODS]
        if unknown or not methods:
            raise ValueError(f"methods = {list(methods)}; give one or more of {', '.join(STUDY_METHODS)}")
        for name, value in (("sampleSize", sampleSize), ("gradientSize", gradientSize)):
            if int(value) != value or value < 1:
                raise ValueError(f"{name} = {value}; it must be a positive whole number")
        if int(toleranceSize) != toleranceSize or toleranceSize < 0:
            raise ValueError(f"toleranceSize = {toleranceSize}; it must be a whole number of at least 0")
        if not 0.01 <= targetCoefficientOfVariation <= 0.5:
            raise ValueError(
                f"targetCoefficientOfVariation = {targetCoefficientOfVariation}; it must be between 0.01 and 0.5"
            )
        if not problem.getRequirements():
            # Raises the sentence that says so.
            problem.getComponents()
        self._problem = problem
        self._methods = [method for method in STUDY_METHODS if method in methods]
        self._seed = int(seed)
        self._sampleSize = int(sampleSize)
        self._gradientSize = int(gradientSize)
        self._toleranceSize = int(toleranceSize)
        self._target = float(targetCoefficientOfVariation)
        self._names = [*problem.getRequirementNames(), SYSTEM]
        self._progress: Callable[[str, float], None] = _reportNothing
        self._directory: ResultsDirectory | None = None
        self._executor: Executor | Callable[[], Executor] | None = None
        self._mixedProcessors = False
        self._sample: np.ndarray | None = None
        self._summary: SampleSummary | None = None
        self._components: dict[str, Component] = {}
        self._complete = False
        self._forgetEstimates()

    def _forgetEstimates(self):
        """All that follows from the methods' runs."""
        self._rows: list[Estimate] = []
        self._results: dict[str, ActiveSubspaceReliabilityResult] = {}
        self._shares: dict[str, tuple[DriverMeasure, dict[str, float]]] = {}
        self._ratios: dict[str, dict[str, float]] = {}
        self._halved: dict[str, tuple[HalvedTolerance, ...]] = {}
        self._violations: dict[str, Violation] = {}

    def _shownRemarks(self):
        # getRemarks() is deprecated.
        return []

    def _shown(self):
        return {
            "case": self._problem.getCase().name,
            "methods": to_plain(self._methods),
            "seed": self._seed,
            "sampleSize": self._sampleSize,
        }

    def setProgressCallback(self, callback: Callable[[str, float], None]) -> None:
        """Called with what is being done and the share of the whole study that is done, from 0 to 1."""
        self._progress = callback

    def setDirectory(
        self, directory: str | os.PathLike, resume: bool = False, overwrite: bool = False, command: str = ""
    ) -> None:
        """Keep every finished step, and the true runs, in a directory from the start on.

        An interrupted study is continued by the same study with `resume`: each step's random numbers follow from the
        seed and the step's name alone, so that the numbers are those of a study that was not interrupted.

        Parameters
        ----------
        directory : str or path
            Made where it does not exist.
        resume : bool
            Continue from the finished steps; an empty directory begins a new study.
        overwrite : bool
            Remove the study that is there, this one or another, and begin anew.
        command : str
            What the user has typed, for `origin.json`.

        Raises
        ------
        DirectoryError
            The directory holds other files, or another study: of another case, with other settings, another seed or
            other versions of the packages; or this one, and neither `resume` nor `overwrite` is given.
        """
        case = self._problem.getCase()
        if "case.toml" in case.files:
            raise DirectoryError("a force-stroke table is called case.toml, as the case in the directory; rename it")
        identity = {
            "case": digest(dataclasses.replace(case, text="", files={}), self._problem.getDistribution()),
            "seed": self._seed,
            "runs": self._sampleSize,
            "gradients": self._gradientSize,
            "tolerances": self._toleranceSize,
            "precision": self._target,
            "methods": to_plain(self._methods),
            "versions": package_versions(),
        }
        before = self._directory
        if before is not None and self._isHere(directory):
            # The lock of this study would refuse it, too.
            before.close()
        self._directory = ResultsDirectory(
            directory, "study", identity, _WRITTEN, {"case.toml": case.text, **case.files}, resume, overwrite,
            {"case": case.name, "command": command, "processor": processorDescription()},
        )  # fmt: skip
        if before is not None:
            before.close()

    def _isHere(self, directory):
        """Whether a path is that of the study's directory."""
        return self._directory is not None and self._directory.path.resolve() == Path(directory).resolve()

    def getChangedFiles(self) -> list[Path]:
        """Files of the directory that were not as they had been written when it was continued.

        Those of a step were removed: the step is made again, and so are results, figures and report.
        """
        return [] if self._directory is None else list(self._directory.changed)

    def setExecutor(self, executor: Executor | Callable[[], Executor] | None, mixedProcessors: bool = False) -> None:
        """What runs the Monte Carlo sample, as for
        :class:`satsep_ot.methods.parallel.monte_carlo_stream.MonteCarloStream`.

        The numbers do not depend on it, as long as the workers have the processor and the versions of this process;
        where they have not, a :class:`satsep_ot.methods.parallel.processor.MixedProcessorsError` ends the run, unless
        `mixedProcessors` accepts that: the report then says so. None (default) for the simulator's own threads.
        """
        self._executor, self._mixedProcessors = executor, bool(mixedProcessors)

    def close(self) -> None:
        """Let other processes use the directory."""
        if self._directory is not None:
            self._directory.close()

    def run(self) -> None:
        """The whole chain: sample, subspaces, methods, drivers, tolerances, most likely violations."""
        self._complete = False
        self.computeSample()
        self.computeSubspaces()
        self.compareMethods()
        self.computeDrivers()
        self.computeTolerances()
        self.computeViolations()
        self._complete = True

    def _start(self, *names):
        """Seed of one step, from the study's seed and the step's name."""
        digits = np.frombuffer("/".join(names).encode(), dtype=np.uint8)
        ot.RandomGenerator.SetSeed(int(np.random.SeedSequence([self._seed, *digits]).generate_state(1)[0] >> 1))

    def _step(self, names, kind, compute):
        """What a step gives, of the kind: from the directory where it is finished there, else computed and kept."""
        kept = None if self._directory is None else self._directory.finished(*names)
        if kept is None:
            made = compute()
            if self._directory is not None:
                self._directory.keep(names, to_plain(made))
            return made
        try:
            return from_plain(kind, kept)
        except ValueError as error:
            path = self._directory.file("steps", names, ".json")
            raise DirectoryError(f"{path} cannot be used ({error}); remove it, and its step is made again") from error

    def _keepRuns(self, names, makeRuns):
        if self._directory is not None:
            path = self._directory.file("runs", names, ".npz")
            makeRuns().save(path)
            self._directory.record(path)

    def _isFinished(self, *names):
        return self._directory is not None and self._directory.finished(*names) is not None

    # The steps. -------------------------------------------------------------------------------------------------------

    def computeSample(self) -> None:
        """Run the Monte Carlo sample; it gives the distributions of the quantities, and a row for each requirement."""
        with contextlib.ExitStack() as stack:
            if self._directory is None:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            else:
                folder = self._directory.folder("runs")
            path = folder / "sample.npy"
            self._summary = self._step(["sample"], SampleSummary, lambda: self._runSample(path))
            if self._directory is not None:
                self._directory.file("steps", ["sample"], ".checkpoint").unlink(missing_ok=True)
            if path.exists():
                self._sample = np.array(np.load(path, mmap_mode="r", allow_pickle=False)[:_DRAWN])
            else:
                distribution = self._problem.getDistribution()
                size = min(_DRAWN, self._sampleSize)
                inputs = sample_inputs(distribution, self._summary.seed, self._sampleSize, size)
                self._sample = SeparationFunction(self._problem.getCase(), countsEndings=True).evaluate(inputs)

    def _runSample(self, path):
        checkpoint = None
        if self._directory is not None:
            # From here on results.json says that the study is not complete.
            self.saveRows()
            checkpoint = self._directory.file("steps", ["sample"], ".checkpoint")
        summary = run_sample(
            self._problem,
            self._sampleSize,
            lambda: self._start("sample"),
            path,
            checkpoint,
            self._executor,
            lambda label, share: self._progress(label, share * _SUBSPACES_BEGIN),
            self._mixedProcessors,
        )
        if self._directory is not None and path.exists():
            self._directory.record(path)
        return summary

    def computeSubspaces(self) -> None:
        """Active subspace and polynomial regression of each smooth component of the requirements."""
        self._progress("active subspaces from gradients", _SUBSPACES_BEGIN)
        names, distribution = self._problem.getSmoothComponentNames(), self._problem.getDistribution()
        found = self._step(["gradients"], dict[str, Any], lambda: self._runGradients(names, distribution))
        points, values, gradients = (np.array(found[key]) for key in ("points", "values", "gradients"))
        for column, name in enumerate(names):
            done = (_METHODS_BEGIN - _SUBSPACES_BEGIN) * column / len(names)
            self._progress(f"active subspace and regression of {name}", _SUBSPACES_BEGIN + done)
            self._start("subspace", name)
            component = fit_component(distribution, points, values[:, column], gradients[:, :, column])
            if component is not None:
                self._components[name] = component

    def _runGradients(self, names, distribution):
        self._start("subspaces")
        model = SeparationFunction(self._problem.getCase(), quantities=names, countsEndings=True)
        points, values, gradients = sample_gradients(model, distribution, self._gradientSize)
        inputs = np.array(distribution.getInverseIsoProbabilisticTransformation()(ot.Sample(points)))
        labels = model.getInputDescription(), model.getOutputDescription()
        self._keepRuns(
            ["gradients"],
            lambda: TrueRuns.ofSample(
                inputs, values, np.zeros(len(inputs), dtype=bool), *labels, phase="gradients", weight=np.nan
            ),
        )
        return {"points": points.tolist(), "values": values.tolist(), "gradients": gradients.tolist()}

    def compareMethods(self) -> None:
        """Run the methods on each requirement."""
        if self._summary is None and StudyMethod.MONTE_CARLO in self._methods:
            self.computeSample()
        self._forgetEstimates()
        span = (_TOLERANCES_BEGIN - _METHODS_BEGIN) / len(self._names)
        for index, requirement in enumerate(self._names):
            for place, method in enumerate(self._methods):
                done = span * (index + place / len(self._methods))
                self._progress(f"{requirement}: {method}", _METHODS_BEGIN + done)
                names = [requirement, method]
                new = self._directory is not None and not self._isFinished(*names)
                row = self._step(names, Estimate, lambda names=names: self._runMethod(*names))
                self._rows.append(row)
                if new:
                    self.saveRows()
                path = None if self._directory is None else self._directory.file("steps", names, ".npz")
                if path is not None and path.exists() and row.probability is not None:
                    # The same after an interruption; and without the surrogates, which take memory.
                    try:
                        found = ActiveSubspaceReliabilityResult.load(path, self._event(requirement))
                    except ValueError as error:
                        cure = "remove it and the file beside it that ends on .json, and their step is made again"
                        raise DirectoryError(f"{path} cannot be used ({error}); {cure}") from error
                    self._results[requirement] = found

    def _event(self, requirement):
        return self._problem.getSystemEvent() if requirement == SYSTEM else self._problem.getEvent(requirement)

    def _runMethod(self, requirement, name):
        """The estimate of a method for a requirement."""
        self._start(requirement, name)
        if name == StudyMethod.MONTE_CARLO:
            return self._estimateBySample(requirement)
        if name == StudyMethod.ACTIVE_SUBSPACE:
            return self._estimateByActiveSubspace(requirement)
        event, parts, names = self._event(requirement), [], [requirement, name]
        comparison = self._comparison(requirement, event, METHODS[name]())
        if self._directory is not None:
            comparison.setRunsCallback(lambda inputs, outputs: parts.append((inputs, outputs)))
        comparison.run()
        if parts:
            self._keepRuns(names, lambda: _unweighted(name, event, parts))
        return Estimate.of(requirement, comparison.getResult().getRows()[0])

    def _comparison(self, requirement, event, method: ReliabilityMethod):
        comparison = ReliabilityComparison(event, [method])
        comparison.setMaximumEvaluations(None)
        comparison.setComponents(*self._problem.getComponents(None if requirement == SYSTEM else requirement))
        return comparison

    def _estimateBySample(self, requirement):
        """Monte Carlo on the sample that is there already."""
        violations, size = self._summary.violations[requirement], self._sampleSize
        share = violations / size
        return Estimate(
            requirement,
            StudyMethod.MONTE_CARLO,
            share,
            *clopperPearson(violations, size),
            coefficient_of_variation=float(np.sqrt((1.0 - share) / violations)) if violations else None,
            evaluations=size,
            seconds=self._summary.seconds,
            converged=True,
            note=f"{violations:,} violations; all requirements share these runs",
        )

    def _estimateByActiveSubspace(self, requirement):
        method = ActiveSubspace(self._target, math.ceil(5000 * max(1.0, (0.05 / self._target) ** 2)))
        comparison = self._comparison(requirement, self._event(requirement), method)
        comparison.run()
        estimate = Estimate.of(requirement, comparison.getResult().getRows()[0])
        if estimate.probability is None:
            return estimate
        self._results[requirement] = result = method.getLastResult()
        names = [requirement, StudyMethod.ACTIVE_SUBSPACE]
        if self._directory is not None:
            path = self._directory.file("steps", names, ".npz")
            result.save(path)
            self._directory.record(path)
        self._keepRuns(names, lambda: result.getTrueRuns(self._outputDescription(requirement)))
        # A table says once for all requirements what their wide runs would have missed.
        return dataclasses.replace(
            estimate,
            note=result.getEndingSentence(),
            audits=result.getAuditNumber(),
            audit_spread=result.getAuditSpread(),
        )

    def _outputDescription(self, requirement):
        function, _, _, _ = self._problem.getComponents(None if requirement == SYSTEM else requirement)
        return function.getOutputDescription()

    def computeDrivers(self) -> None:
        """The share of each tolerance in the violations of each requirement.

        By its importance in the violations that ActiveSubspace saw; without these, by the mean squared derivatives of
        the smooth components.
        """
        case = self._problem.getCase()
        for requirement in self._problem.getRequirementNames():
            result = self._results.get(requirement)
            shares = {} if result is None else drivers.importance_shares(case, result)
            measure = DriverMeasure.VIOLATIONS
            if not shares:
                names = self._problem.getSmoothComponentNames(requirement)
                subspaces = [self._components[name].subspace for name in names if name in self._components]
                shares = drivers.driver_shares(case, subspaces) if subspaces else {}
                measure = DriverMeasure.SENSITIVITY
            self._shares[requirement] = measure, shares

    def computeTolerances(self) -> None:
        """Tighten the tolerances that drive each requirement.

        All of them by a tenth, by re-weighting the runs that are there; those that buy most, one by one, by half, and
        estimate anew.
        """
        if StudyMethod.ACTIVE_SUBSPACE not in self._methods:
            return
        if not self._shares:
            self.computeDrivers()
        case, names = self._problem.getCase(), self._problem.getRequirementNames()
        span = (_VIOLATIONS_BEGIN - _TOLERANCES_BEGIN) / len(names)
        for index, requirement in enumerate(names):
            self._halved[requirement] = ()
            _, shares = self._shares[requirement]
            if self._toleranceSize == 0 or not shares:
                continue
            self._progress(f"{requirement}: tolerances", _TOLERANCES_BEGIN + span * index)
            strong = [name for name, share in shares.items() if share >= _SMALLEST_SHARE]
            result = self._results.get(requirement)
            ratios = {} if result is None else drivers.tightened_probabilities(case, result, strong)
            self._ratios[requirement] = ratios
            chosen = (list(ratios) or strong)[: self._toleranceSize]
            for place, name in enumerate(chosen):
                done = span * (index + place / len(chosen))
                self._progress(f"{requirement}: half the scatter of {name}", _TOLERANCES_BEGIN + done)
                step = [requirement, "half", name]
                row = self._step(step, HalvedTolerance, lambda names=(requirement, name): self._halve(*names))
                self._halved[requirement] += (row,)

    def _halve(self, requirement, name):
        """The probability of violating a requirement with half the scatter of one tolerance."""
        self._start(requirement, "half", name)
        case = drivers.scaled_case(self._problem.getCase(), name, 0.5)
        try:
            result = drivers.changed_probability(case, requirement)
        except Exception as error:
            # As with a method that fails: the study's other numbers stand without this one.
            raiseInterrupt(error)
            return HalvedTolerance(name, 0.5, note=f"{type(error).__name__}: {errorMessage(error)}")
        self._keepRuns([requirement, "half", name], lambda: result.getTrueRuns(self._outputDescription(requirement)))
        interval = result.getConfidenceInterval(0.95)
        return HalvedTolerance(
            name,
            0.5,
            result.getProbabilityEstimate(),
            interval.getLowerBound()[0],
            interval.getUpperBound()[0],
            result.getEvaluationNumber(),
            result.getConverged(),
            result.getEndingSentence(),
        )

    def computeViolations(self) -> None:
        """The most likely violation of each requirement."""
        for requirement in self._problem.getRequirementNames():
            self._progress(f"{requirement}: most likely violation", _VIOLATIONS_BEGIN)
            found = self._step(
                [requirement, "violation"], dict[str, Any], lambda name=requirement: self._findViolation(name)
            )
            if found:
                self._violations[requirement] = Violation(
                    np.array(found["inputs"]), np.array(found["standard"]), found["distance"]
                )

    def _findViolation(self, requirement):
        """Of a violation its inputs, in their units and in standard space, and its distance; empty for none."""
        self._start(requirement, "violation")
        result = self._results.get(requirement)
        sample = None
        if result is not None:
            runs = result.getTrueRuns()
            sample = runs.inputs[runs.failed & np.isfinite(runs.outputs).all(axis=1)]
        violation = drivers.most_likely_violation(self._problem, requirement, sample)
        if violation is None:
            return {}
        return {name: np.asarray(value).tolist() for name, value in dataclasses.asdict(violation).items()}

    # What came out. ---------------------------------------------------------------------------------------------------

    def getResult(self) -> StudyResult:
        """All that was found so far.

        Returns
        -------
        result : :class:`satsep_ot.studies.telling.results.StudyResult`
        """
        case = self._problem.getCase()
        table = quantity_table(case.separation)
        nominal = self._quantities([row.reference for row in case.inputs])
        none = [None] * len(table)
        means, deviations = (none, none) if self._summary is None else (self._summary.mean, self._summary.deviation)
        return StudyResult(
            case=case.name,
            description=case.description,
            seed=self._seed,
            complete=self._complete,
            finished=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            versions={**package_versions(), "python": platform.python_version()},
            sizes=Sizes(self._sampleSize, self._gradientSize, self._toleranceSize, self._target, tuple(self._methods)),
            rows=tuple(self._rows),
            requirements=tuple(
                RequirementEntry.of(entry, table[entry.quantity].unit) for entry in self._problem.getRequirements()
            ),
            quantities={
                name: QuantityValues.of(quantity, nominal[name], mean, deviation)
                for (name, quantity), mean, deviation in zip(table.items(), means, deviations, strict=True)
            },
            tolerances={name: Tolerance.of(rows) for name, rows in drivers.tolerances(case).items()},
            drivers={name: shares for name, (_, shares) in self._shares.items()},
            driver_measures={name: measure for name, (measure, _) in self._shares.items()},
            ratios=dict(self._ratios),
            tightened=dict(self._halved),
            violations={
                name: MostLikelyViolation.of(
                    case, self._quantities(found.inputs), found.inputs, found.standard, found.distance
                )
                for name, found in self._violations.items()
            },
            components={name: ComponentSummary.of(part) for name, part in self._components.items()},
            diagnostics={name: Diagnostics.of(result) for name, result in self._results.items()},
            correlated=case.copula is not None,
            assumptions=tuple(assumptions(case)),
            processors=() if self._summary is None else self._summary.processors,
            sunk=None if self._summary is None else self._summary.sunk,
            touched=None if self._summary is None else self._summary.touched,
        )

    def _quantities(self, inputs):
        """Every quantity of one run, by name."""
        case = self._problem.getCase()
        values = SeparationFunction(case, countsEndings=True).evaluate(np.asarray(inputs)[None])[0]
        return dict(zip(quantity_table(case.separation), values.tolist(), strict=True))

    def getComponents(self) -> dict[str, Component]:
        """Active subspace and regression by the name of the smooth component."""
        return dict(self._components)

    def getReliabilityResult(self, requirement: str) -> ActiveSubspaceReliabilityResult:
        """The `ActiveSubspaceReliabilityResult` of a requirement, with its runs, diagnostics and drawings."""
        if requirement not in self._results:
            raise ValueError(f"there is no ActiveSubspace result of '{requirement}'; there are {list(self._results)}")
        return self._results[requirement]

    def getViolations(self) -> dict[str, Violation]:
        """The most likely :class:`satsep_ot.studies.drivers.Violation` of each requirement, where one was found."""
        return dict(self._violations)

    def save(self, directory: str | os.PathLike | None = None) -> list[Path]:
        """Write report.html and what it is made of: results.json, motion.json, case.toml and figures.

        Each file appears whole or not at all.

        Parameters
        ----------
        directory : str or path, optional
            Made where it does not exist; one that holds other files or another study is refused. By default that of
            `setDirectory`, which keeps the steps and the true runs too.

        Returns
        -------
        paths : list of :class:`pathlib.Path`
            results.json first, report.html last.

        Raises
        ------
        DirectoryError
            As by `setDirectory`.
        RuntimeError
            The study has not run to its end; `saveRows` writes what there is.
        """
        if not self._complete:
            raise RuntimeError("the study has not run to its end: call run() first, or saveRows() for what there is")
        taken = self._takeDirectory(directory)
        result, paths, entries = self.getResult(), [], []
        # Whatever becomes of the figures, the numbers are there.
        _writeResults(taken, results_document(result))
        for panel in study_panels(result, self._drawnRuns()):
            path = taken.folder("figures") / (file_stem([panel.section, panel.name]) + ".svg")
            paths.append(writeWhole(path, panel.write))
            entries.append(FigureFile(panel.section, panel.name, panel.text, path.name))
        case = self._problem.getCase()
        runs = {"nominal": case.separation.parameters()}
        for name, violation in self._violations.items():
            runs[name] = drivers.run_parameters(case, violation.inputs)
        motion = json.dumps(animation_data(case.separation, runs), allow_nan=False) + "\n"
        paths.append(taken.writeText("motion.json", motion))
        paths.append(_writeResults(taken, results_document(dataclasses.replace(result, figures=tuple(entries)))))
        taken.record(*paths)
        paths = [*paths[::-1], write_report(taken.path)]
        taken.record(paths[-1])
        return paths

    def _drawnRuns(self):
        """What the figures are drawn from."""
        self._start("surrogate")
        surrogate = sample_surrogates(self._problem, self._components, _DRAWN)
        return StudyRuns(self._problem.getCase().separation, self._sample, self._components, surrogate)

    def saveRows(self, directory: str | os.PathLike | None = None) -> Path:
        """Write results.json alone, with the rows that are finished so far and nothing that takes time.

        Parameters
        ----------
        directory : str or path, optional
            As for `save`.

        Returns
        -------
        path : :class:`pathlib.Path`
        """
        document = partial_document(self._problem.getCase().name, self._seed, self._rows)
        return _writeResults(self._takeDirectory(directory), document)

    def _takeDirectory(self, directory: str | os.PathLike | None) -> ResultsDirectory:
        """The directory to write to."""
        if directory is not None and not self._isHere(directory):
            self.setDirectory(directory)
        if self._directory is None:
            raise ValueError("there is no directory to write to; give one, or call setDirectory() before run()")
        return self._directory


def _writeResults(directory, document):
    return directory.writeText("results.json", json.dumps(document, indent=2, allow_nan=False) + "\n")


def _unweighted(phase, event, parts):
    """Runs of a method that gives its runs no weights."""
    inputs, outputs = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    happens, threshold = event.getOperator(), event.getThreshold()
    failed = np.array([happens.compare(value, threshold) for value in outputs[:, 0].tolist()])
    function = event.getFunction()
    return TrueRuns.ofSample(
        inputs, outputs, failed, function.getInputDescription(), function.getOutputDescription(), phase, np.nan
    )
