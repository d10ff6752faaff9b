"""The whole chain on one separation: a sample, active subspaces and regressions, and the probability of each violation.

This is the study of Hu et al. (2017): propagate the uncertainties through a polynomial on an active subspace and
estimate the failure probability, here corrected by true runs and held against the methods of OpenTURNS.
"""

import contextlib
import dataclasses
import datetime
import functools
import json
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
from satsep_ot.methods.parallel.processor import processorDescription
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.model.case import SYSTEM
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.openturns_object import OpenTURNSObject
from satsep_ot.studies import drivers
from satsep_ot.studies.class_choice import class_choice, tolerance_classes
from satsep_ot.studies.deprecated_accessors import DeprecatedAccessors
from satsep_ot.studies.drivers import Violation
from satsep_ot.studies.exceedance import exceedance_curves
from satsep_ot.studies.failure_mixture import failure_mixtures
from satsep_ot.studies.fleet import fleet_estimate
from satsep_ot.studies.heavy_runs import HeavyRuns
from satsep_ot.studies.results_directory import DirectoryError, ResultsDirectory, digest, file_stem, package_versions
from satsep_ot.studies.sample import SampleSummary, run_sample, sample_inputs
from satsep_ot.studies.screening import screened
from satsep_ot.studies.step_processes import StepProcesses
from satsep_ot.studies.steps import Made, Step, StudySteps
from satsep_ot.studies.surrogates import sample_gradients, sample_surrogates
from satsep_ot.studies.telling.animation import animation_data
from satsep_ot.studies.telling.class_choice import ClassChoice
from satsep_ot.studies.telling.document import partial_document, results_document
from satsep_ot.studies.telling.failure_mixture import FailureMixture
from satsep_ot.studies.telling.fleet import FleetEstimate
from satsep_ot.studies.telling.panels import StudyRuns, drawn_result_panels, run_panels
from satsep_ot.studies.telling.plain_data import from_plain, to_plain
from satsep_ot.studies.telling.remarks import assumptions
from satsep_ot.studies.telling.report import write_report
from satsep_ot.studies.telling.results import (
    Component,
    ComponentSummary,
    Diagnostics,
    DriverMeasure,
    Estimate,
    Exceedance,
    FigureFile,
    HalvedTolerance,
    InputEntry,
    MostLikelyViolation,
    QuantityValues,
    RequirementEntry,
    Sizes,
    StudyResult,
    Tolerance,
)
from satsep_ot.studies.telling.tolerance_curves import CurvePoint, Curves, RequirementCurves
from satsep_ot.studies.telling.verdicts import SMALLEST_PRECISION, best_estimate
from satsep_ot.studies.telling.words import DEFAULT_METHODS, StudyMethod
from satsep_ot.studies.tolerance_curves import requirement_curves

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
_SUBSPACES_BEGIN, _METHODS_BEGIN, _TOLERANCES_BEGIN, _VIOLATIONS_BEGIN, _FIGURES_BEGIN = 0.3, 0.38, 0.65, 0.85, 0.88
_CURVES_BEGIN, _CLASSES_BEGIN, _FAILURES_BEGIN = 0.855, 0.86, 0.87
_STAGES = (
    (_SUBSPACES_BEGIN, "active subspaces"), (_METHODS_BEGIN, "methods"), (_TOLERANCES_BEGIN, "halved tolerances"),
    (_FIGURES_BEGIN, "figures and report"),
)  # fmt: skip


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
        Gradients for the active subspaces; 0 for no subspaces.
    toleranceSize : int
        How many of the strongest tolerances of each requirement are halved to see what that buys; 0 for none. It takes
        ActiveSubspace among the methods.
    targetCoefficientOfVariation : float, optional
        At which ActiveSubspace ends, from 0.01 to 0.5. Its runs grow with 1 / square of it, and so does their limit,
        which is 5,000 at 0.05 and above. By default it asks whether a requirement is met: it ends as soon as that is
        decided and the coefficient of variation at most 0.05, which advice on tolerances needs (0.1 without), and goes
        on until it is decided, or 5,000 runs are spent or would not decide it.
    screening : bool
        Whether a requirement that the sample shows to be met by a factor of ten is left at that: no other method runs
        on it, no tolerance of it is halved.
    curves : :class:`satsep_ot.studies.telling.tolerance_curves.Curves`
        For which requirements the probability against the size of their strongest tolerances is made by new runs:
        NEEDED for those that are not known to be met, ALL, or NONE for no curves at all.
    groups : sequence of str
        Tolerances, groups of inputs, that are halved and varied in size; by default the strongest of each requirement.

    Raises
    ------
    ValueError
        If a method or a group is unknown, a size is not positive, or the target is out of its range; a CaseError if the
        case has no requirements.

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
        targetCoefficientOfVariation: float | None = None,
        screening: bool = True,
        curves: Curves = Curves.NEEDED,
        groups: Sequence[str] = (),
    ) -> None:
        unknown = [name for name in methods if name not in STUDY_METHODS]
        if unknown or not methods:
            raise ValueError(f"methods = {list(methods)}; give one or more of {', '.join(STUDY_METHODS)}")
        if int(sampleSize) != sampleSize or sampleSize < 1:
            raise ValueError(f"sampleSize = {sampleSize}; it must be a positive whole number")
        for name, value in (("gradientSize", gradientSize), ("toleranceSize", toleranceSize)):
            if int(value) != value or value < 0:
                raise ValueError(f"{name} = {value}; it must be a whole number of at least 0")
        target = targetCoefficientOfVariation
        if target is not None and not SMALLEST_PRECISION <= target <= 0.5:
            raise ValueError(
                f"targetCoefficientOfVariation = {target}; it must be between {SMALLEST_PRECISION} and 0.5"
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
        self._target = None if target is None else float(target)
        self._screening = bool(screening)
        self._curveRuns = Curves(curves)
        drivers.check_tolerances(problem.getCase(), groups)
        self._groups = list(groups)
        self._steps = StudySteps(problem, self._seed, self._target, self._toleranceSize > 0)
        self._processes = StepProcesses(1)
        self._names = [*problem.getRequirementNames(), SYSTEM]
        self._progress: Callable[[str, float], None] = _reportNothing
        self._directory: ResultsDirectory | None = None
        self._executor: Executor | Callable[[], Executor] | None = None
        self._mixedProcessors = False
        self._heavy: HeavyRuns | None = None
        self._sample: np.ndarray | None = None
        self._exceedances: dict[str, Exceedance] = {}
        self._summary: SampleSummary | None = None
        self._components: dict[str, Component] = {}
        self._complete = False
        self._forgetEstimates()

    def _forgetEstimates(self):
        """All that follows from the methods' runs."""
        self._rows: list[Estimate] = []
        self._screened: dict[str, str] = {}
        self._results: dict[str, ActiveSubspaceReliabilityResult] = {}
        self._importances: dict[str, dict[str, float]] = {}
        self._shares: dict[str, tuple[DriverMeasure, dict[str, float]]] = {}
        self._ratios: dict[str, dict[str, float]] = {}
        self._halved: dict[str, tuple[HalvedTolerance, ...]] = {}
        self._violations: dict[str, Violation] = {}
        self._curves: dict[str, RequirementCurves] = {}
        self._classes: ClassChoice | None = None
        self._mixtures: dict[str, FailureMixture] = {}
        self._fleet: dict[str, FleetEstimate] = {}

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
            "screening": self._screening,
            "curves": self._curveRuns.value,
            "groups": self._groups,
            "methods": to_plain(self._methods),
            "versions": package_versions(),
        }
        if self._heavy is not None:
            identity["heavy"] = [self._heavy.block, self._heavy.policy]
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

    def setHeavyRuns(
        self, directory: str | os.PathLike, blockSize: int | None = None, nonFinitePolicy: str = "raise"
    ) -> None:
        """Take the probabilities from a heavy simulator, whose runs are exchanged through a directory.

        `run` raises a :class:`satsep_ot.methods.reliability.run_files.RunsNeeded` where it needs runs that are not
        there yet: the exception names the file of their inputs and that in which it looks for their outputs, the
        quantities of all requirements. Called again, also by another process, it goes on. To be set before
        `setDirectory`. Of the methods only ActiveSubspace is left then, with this package's simulator as its cheap
        model; no requirement is screened, no tolerance is halved or varied, and no class, failure or fleet is computed.

        Parameters
        ----------
        directory : str or path
            Of its own, for one separation with its inputs.
        blockSize : int, optional
            As for :meth:`satsep_ot.methods.reliability.algorithm.ActiveSubspaceReliability.setBlockSize`.
        nonFinitePolicy : str
            What a run with an output that is not finite is: "raise" (refused), "failure" or "safe".
        """
        self._heavy = HeavyRuns(Path(directory), blockSize, nonFinitePolicy)
        self._methods, self._screening = [StudyMethod.ACTIVE_SUBSPACE], False
        self._toleranceSize, self._curveRuns, self._groups = 0, Curves.NONE, []

    def setProcessNumber(self, number: int) -> None:
        """How many processes make estimates and figures side by side (default 1: this one).

        The numbers do not depend on it. A script needs its own work below ``if __name__ == "__main__":`` for more than
        one. `close` ends them.
        """
        if int(number) != number or number < 1:
            raise ValueError(f"the number of processes is {number}; it must be a whole number of at least 1")
        self._processes.close()
        self._processes = StepProcesses(int(number))

    def close(self) -> None:
        """Let other processes use the directory, and end those of this study."""
        self._processes.close()
        if self._directory is not None:
            self._directory.close()

    def run(self) -> None:
        """The whole chain: sample, subspaces, methods, drivers, tolerances, most likely violations."""
        self._complete = False
        if self._heavy is not None:
            self._heavy.check(self._problem.getCase(), self._problem.getDistribution())
        self.computeSample()
        self.computeSubspaces()
        self.compareMethods()
        self.computeDrivers()
        self.computeTolerances()
        self.computeViolations()
        self.computeCurves()
        if self._heavy is None:
            self.computeClasses()
            self.computeFailures()
            self.computeFleet()
        self._complete = True

    def _tell(self, label, share):
        """Report the progress: what is done, and what comes then."""
        later = ", ".join(name for begin, name in _STAGES if begin > share)
        self._progress(f"{label}; then {later}" if later else label, share)

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

    def _makeSteps(self, steps, begin, end):
        """Make the steps that are not finished; each with what was made, as soon as it is there."""
        new = []
        for step in steps:
            if self._directory is None or self._directory.finished(*step.names) is None:
                new.append(step)
            else:
                value = self._step(step.names, step.kind, None)
                yield step, Made(value, result=self._loadResult(step.names, value))
        done = len(steps) - len(new)

        def report(label, number):
            share = begin + (end - begin) * (done + number) / len(steps)
            self._tell(f"{label} ({done + number + 1} of {len(steps)})", share)

        for step, made in self._processes.make(self._steps, new, report):
            yield step, self._keepMade(step.names, made)

    def _makeHeavySteps(self, steps, begin, end):
        """The same by heavy runs, one after the other: each one uses the runs of those before it."""
        for number, step in enumerate(steps):
            kept = None if self._directory is None else self._directory.finished(*step.names)
            if kept is not None:
                value = self._step(step.names, step.kind, None)
                yield step, Made(value, result=self._loadResult(step.names, value))
                continue
            self._tell(f"{step.label} by heavy runs", begin + (end - begin) * number / len(steps))
            made = self._heavy.estimate(
                self._problem, step.names[0], self._seed, self._target, self._steps.level_together
            )
            yield step, self._keepMade(step.names, made)

    def _keepMade(self, names, made):
        """Keep what a step has made, its value last; and give back what there is of it after an interruption."""
        if self._directory is None:
            return made
        if made.result is not None:
            path = self._directory.file("steps", names, ".npz")
            made.result.save(path)
            self._directory.record(path)
        if made.runs is not None:
            self._keepRuns(names, lambda: made.runs)
        self._directory.keep(names, to_plain(made.value))
        return Made(made.value, result=self._loadResult(names, made.value))

    def _loadResult(self, names, value):
        """The result that a step has kept, without its surrogates, which take memory; None where there is none."""
        path = self._directory.file("steps", names, ".npz")
        if not path.exists() or value.probability is None:
            return None
        try:
            return ActiveSubspaceReliabilityResult.load(path, self._steps.event(names[0]))
        except ValueError as error:
            cure = "remove it and the file beside it that ends on .json, and their step is made again"
            raise DirectoryError(f"{path} cannot be used ({error}); {cure}") from error

    # The steps. -------------------------------------------------------------------------------------------------------

    def computeSample(self) -> None:
        """Run the Monte Carlo sample; it gives the distributions of the quantities, and a row for each requirement."""
        with contextlib.ExitStack() as stack:
            if self._directory is None:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            else:
                folder = self._directory.folder("runs")
            path = folder / "sample.npy"
            self._exceedances = {}
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
        self._tell("compiling the simulator, once", 0.0)
        # The run of the means must separate: nothing else of a study would mean anything.
        means = self._problem.getDistribution().getMean()
        SeparationFunction(self._problem.getCase()).evaluate([means])
        self._processes.begin(self._steps)
        summary = run_sample(
            self._problem,
            self._sampleSize,
            lambda: self._steps.start("sample"),
            path,
            checkpoint,
            self._executor,
            lambda label, share: self._tell(label, share * _SUBSPACES_BEGIN),
            self._mixedProcessors,
        )
        if self._directory is not None and path.exists():
            self._directory.record(path)
        return summary

    def computeSubspaces(self) -> None:
        """Active subspace and polynomial regression of each smooth component of the requirements."""
        if self._gradientSize == 0:
            return
        self._tell("active subspaces from gradients", _SUBSPACES_BEGIN)
        names, distribution = self._problem.getSmoothComponentNames(), self._problem.getDistribution()
        found = self._step(["gradients"], dict[str, Any], lambda: self._runGradients(names, distribution))
        points, values, gradients = (np.array(found[key]) for key in ("points", "values", "gradients"))
        fit = functools.partial(self._steps.fit_component, points=points)
        outputs = (names, values.T, np.moveaxis(gradients, 2, 0))
        fitted = self._processes.map(fit, *outputs)
        for column, (name, component) in enumerate(zip(names, fitted, strict=True)):
            done = (_METHODS_BEGIN - _SUBSPACES_BEGIN) * (column + 1) / len(names)
            self._tell(f"active subspace and regression of {name}", _SUBSPACES_BEGIN + done)
            if component is not None:
                self._components[name] = component

    def _runGradients(self, names, distribution):
        self._steps.start("subspaces")
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
        """Run the methods on each requirement that the sample has not decided; side by side in the processes."""
        if self._summary is None and StudyMethod.MONTE_CARLO in self._methods:
            self.computeSample()
        self._forgetEstimates()
        crude = [method for method in self._methods if method == StudyMethod.MONTE_CARLO]
        if crude and self._screening and self._summary is not None:
            requirements = self._problem.getRequirements()
            self._screened = screened(requirements, self._summary.violations, self._sampleSize)
            if len(self._screened) == len(requirements):
                self._screened[SYSTEM] = "every requirement is decided by these runs: no other method was run"
        wanted = [
            (name, method) for name in self._names for method in (crude if name in self._screened else self._methods)
        ]
        rows = {names: self._estimateBySample(names[0]) for names in wanted if names[1] in crude}
        steps = [
            Step(names, Estimate, "estimate", names, f"{names[0]}: {names[1]}")
            for names in sorted(wanted, key=self._expectedLength, reverse=True)
            if names not in rows
        ]
        makes = self._makeSteps if self._heavy is None else self._makeHeavySteps
        for step, made in makes(steps, _METHODS_BEGIN, _TOLERANCES_BEGIN):
            rows[step.names] = made.value
            if made.result is not None:
                requirement = step.names[0]
                self._results[requirement] = made.result
                if requirement != SYSTEM:
                    # While the other processes go on.
                    self._importances[requirement] = drivers.importance_shares(self._problem.getCase(), made.result)
            self._rows = [rows[names] for names in wanted if names in rows]
            if self._directory is not None:
                self.saveRows()
        self._rows = [rows[names] for names in wanted]
        # Not in the order in which they ended.
        self._results = {name: self._results[name] for name in self._names if name in self._results}

    def _expectedLength(self, names):
        """What the longest steps have most of, to begin them first: components of a requirement to make surrogates of.

        The end of one long step would otherwise wait for while the other processes have nothing to do.
        """
        requirement, method = names
        given = None if requirement == SYSTEM else requirement
        return len(self._problem.getSmoothComponentNames(given)) if method == StudyMethod.ACTIVE_SUBSPACE else 0

    def _estimateBySample(self, requirement):
        """Monte Carlo on the sample that is there already."""
        violations, size = self._summary.violations[requirement], self._sampleSize
        share = violations / size
        note = f"{violations:,} violations; all requirements share these runs"
        if requirement in self._screened:
            note = f"{violations:,} violations: {self._screened[requirement]}"
        return Estimate(
            requirement,
            StudyMethod.MONTE_CARLO,
            share,
            *clopperPearson(violations, size),
            coefficient_of_variation=float(np.sqrt((1.0 - share) / violations)) if violations else None,
            evaluations=size,
            seconds=self._summary.seconds,
            converged=True,
            note=note,
            upper_together=clopperPearson(violations, size, self._steps.level_together)[1],
        )

    def _openRequirements(self):
        """The requirements that the sample has not decided."""
        return [name for name in self._problem.getRequirementNames() if name not in self._screened]

    def computeDrivers(self) -> None:
        """The share of each tolerance in the violations of each requirement.

        By its importance in the violations that ActiveSubspace saw; without these, by the mean squared derivatives of
        the smooth components.
        """
        case = self._problem.getCase()
        for requirement in self._openRequirements():
            shares = self._importances.get(requirement, {})
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
        case, steps = self._problem.getCase(), []
        for requirement in self._openRequirements():
            self._halved[requirement] = ()
            _, shares = self._shares[requirement]
            if self._toleranceSize == 0 or not shares:
                continue
            self._tell(f"{requirement}: tolerances", _TOLERANCES_BEGIN)
            strong = [name for name, share in shares.items() if share >= _SMALLEST_SHARE]
            result = self._results.get(requirement)
            ratios = {} if result is None else drivers.tightened_probabilities(case, result, strong)
            self._ratios[requirement] = ratios
            for name in self._groups or (list(ratios) or strong)[: self._toleranceSize]:
                label = f"{requirement}: half the scatter of {name}"
                steps.append(Step((requirement, "half", name), HalvedTolerance, "halve", (requirement, name), label))
        made = {step.names: one.value for step, one in self._makeSteps(steps, _TOLERANCES_BEGIN, _VIOLATIONS_BEGIN)}
        for step in steps:
            self._halved[step.names[0]] += (made[step.names],)

    def computeViolations(self) -> None:
        """The most likely violation of each requirement."""
        for requirement in self._openRequirements():
            self._tell(f"{requirement}: most likely violation", _VIOLATIONS_BEGIN)
            found = self._step(
                [requirement, "violation"], dict[str, Any], lambda name=requirement: self._findViolation(name)
            )
            if found:
                self._violations[requirement] = Violation(
                    np.array(found["inputs"]), np.array(found["standard"]), found["distance"]
                )

    def _findViolation(self, requirement):
        """Of a violation its inputs, in their units and in standard space, and its distance; empty for none."""
        self._steps.start(requirement, "violation")
        result = self._results.get(requirement)
        sample = None
        if result is not None:
            runs = result.getTrueRuns()
            sample = runs.inputs[runs.failed & np.isfinite(runs.outputs).all(axis=1)]
        violation = drivers.most_likely_violation(self._problem, requirement, sample)
        if violation is None:
            return {}
        return {name: np.asarray(value).tolist() for name, value in dataclasses.asdict(violation).items()}

    def _known(self):
        """The probability of each violation with its bounds, of those that a verdict may rest on."""
        best = {name: best_estimate(row for row in self._rows if row.requirement == name) for name in self._names}
        return {name: tuple(row.interval) for name, row in best.items() if row is not None and row.interval is not None}

    def computeCurves(self) -> None:
        """The probability of each violation against the size of its strongest tolerances, and what size is allowed."""
        if not self._shares:
            self.computeDrivers()
        case, known = self._problem.getCase(), self._known()
        for index, entry in enumerate(case.requirements):
            wanted = self._curveRuns is not Curves.NONE and self._toleranceSize > 0
            if not wanted or entry.name not in known or entry.name in self._screened:
                continue
            interval, result = known[entry.name], self._results.get(entry.name)
            now = CurvePoint(1.0, *interval)
            is_open = entry.allowed_probability is not None and not now.meets(entry.allowed_probability)
            makes_runs = self._curveRuns is Curves.ALL or (self._curveRuns is Curves.NEEDED and is_open)
            _, shares = self._shares[entry.name]
            halved = sorted(self._halved.get(entry.name, ()), key=lambda row: row.probability or 0.0)
            strongest = list(dict.fromkeys([*(row.tolerance for row in halved), *shares]))
            names = self._groups or strongest[: max(2, self._toleranceSize)]
            begin = _CURVES_BEGIN + (_CLASSES_BEGIN - _CURVES_BEGIN) * index / len(case.requirements)
            self._curves[entry.name] = self._step(
                [entry.name, "curves"],
                RequirementCurves,
                functools.partial(
                    requirement_curves,
                    case,
                    entry.name,
                    entry.allowed_probability,
                    now,
                    names,
                    result,
                    makes_runs,
                    {row.tolerance: _half_point(row) for row in halved},
                    self._seed,
                    functools.partial(self._tellAt, begin),
                    self._processes.map,
                ),
            )

    def _tellAt(self, begin, label, share):
        """Report the progress of what takes no share of the whole that is worth counting."""
        self._tell(label, begin)

    def computeClasses(self) -> None:
        """The cheapest set of classes that meets all limits; nothing where the case has none."""
        case = self._problem.getCase()
        if tolerance_classes(case) and any(entry.allowed_probability for entry in case.requirements):
            span = _FAILURES_BEGIN - _CLASSES_BEGIN
            self._classes = self._step(
                ["classes"],
                ClassChoice,
                lambda: class_choice(
                    case, self._seed, lambda label, share: self._tell(label, _CLASSES_BEGIN + span * share)
                ),
            )

    def computeFailures(self) -> None:
        """The probability of each violation with the failures of parts that the case names; nothing without any."""
        case = self._problem.getCase()
        if case.failures:
            self._mixtures = self._step(["failures"], dict[str, FailureMixture], lambda: self._mixFailures(case))

    def _mixFailures(self, case):
        self._steps.start("failures")
        return failure_mixtures(case, self._known(), lambda label, share: self._tell(label, _FAILURES_BEGIN))

    def computeFleet(self) -> None:
        """The probability that any satellite of the fleet violates a requirement; nothing for a single satellite."""
        case = self._problem.getCase()
        if case.fleet > 1:
            self._tell(f"fleet of {case.fleet}", _FAILURES_BEGIN)
            self._fleet = self._step(["fleet"], dict[str, FleetEstimate], lambda: self._estimateFleet(case))

    def _estimateFleet(self, case):
        self._steps.start("fleet")
        return {
            name: fleet_estimate(case, name, known, *self._violatingRuns(name)) for name, known in self._known().items()
        }

    def _violatingRuns(self, requirement):
        """Inputs of runs that violate a requirement, and their weights."""
        result = self._results.get(requirement)
        if result is not None:
            with contextlib.suppress(RuntimeError):
                sample = result.getFailureSample()
                rows = sample.failed & (sample.ratios > 0.0)
                return sample.x[rows], sample.ratios[rows]
        dimension = self._problem.getDistribution().getDimension()
        if self._sample is None or self._summary is None:
            return np.empty((0, dimension)), np.empty(0)
        limits = self._summary.limits.values() if requirement == SYSTEM else [self._summary.limits[requirement]]
        violated = np.any([limit.violated(self._sample) for limit in limits], axis=0)
        size = len(self._sample)
        inputs = sample_inputs(self._problem.getDistribution(), self._summary.seed, self._sampleSize, size)
        return inputs[violated], np.ones(np.count_nonzero(violated))

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
        quantities = {
            name: QuantityValues.of(quantity, nominal[name], mean, deviation)
            for (name, quantity), mean, deviation in zip(table.items(), means, deviations, strict=True)
        }
        requirements = tuple(
            RequirementEntry.of(entry, table[entry.quantity].unit) for entry in self._problem.getRequirements()
        )
        if self._sample is not None and not self._exceedances:
            self._exceedances = exceedance_curves(self._sample, quantities, requirements)
        return StudyResult(
            case=case.name,
            description=case.description,
            seed=self._seed,
            complete=self._complete,
            finished=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            versions={**package_versions(), "python": platform.python_version()},
            sizes=Sizes(
                self._sampleSize,
                self._gradientSize,
                self._toleranceSize,
                self._target,
                tuple(self._methods),
                self._screening,
            ),
            rows=tuple(self._rows),
            requirements=requirements,
            quantities=quantities,
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
            curves=dict(self._curves),
            classes=self._classes,
            failures=dict(self._mixtures),
            fleet=dict(self._fleet),
            correlated=case.copula is not None,
            assumptions=(*(() if self._heavy is None else (self._heavy.assumption(),)), *assumptions(case)),
            processors=() if self._summary is None else self._summary.processors,
            sunk=None if self._summary is None else self._summary.sunk,
            touched=None if self._summary is None else self._summary.touched,
            inputs=tuple(InputEntry.of(row, case.text) for row in case.inputs),
            force_tables=dict(case.files),
            exceedances=dict(self._exceedances),
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
        self._tell("figures and report", _FIGURES_BEGIN)
        result, paths, entries = self.getResult(), [], []
        # Whatever becomes of the figures, the numbers are there.
        _writeResults(taken, results_document(result))
        for section, name, text, picture in self._drawnPanels(result):
            path = taken.folder("figures") / (file_stem([section, name]) + ".svg")
            paths.append(writeWhole(path, functools.partial(_put, picture)))
            entries.append(FigureFile(section, name, text, path.name))
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

    def _drawnPanels(self, result):
        """Every figure as a picture: those from runs in this process, the others beside it where there are more."""
        others = self._processes.beside(drawn_result_panels, result, self._problem.getCase().separation)
        yield from [panel.drawn() for panel in run_panels(result, self._drawnRuns())]
        yield from others()

    def _drawnRuns(self):
        """What the figures are drawn from."""
        self._steps.start("surrogate")
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


def _half_point(row):
    """A halved tolerance as a point of its curve."""
    return CurvePoint(row.scale, row.probability, row.lower95, row.upper95, row.evaluations or 0, row.converged)


def _put(content, stream):
    stream.write(content)


def _writeResults(directory, document):
    return directory.writeText("results.json", json.dumps(document, indent=2, allow_nan=False) + "\n")
