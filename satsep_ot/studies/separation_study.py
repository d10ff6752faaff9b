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
import re
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.methods.common.storage import syncDirectory, writeWhole
from satsep_ot.methods.comparison.comparison import METHODS, ReliabilityComparison, ReliabilityMethod, Row
from satsep_ot.methods.comparison.methods import ActiveSubspace
from satsep_ot.methods.parallel.monte_carlo_stream import MonteCarloStream
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.methods.subspaces.dimension import energy_dimension
from satsep_ot.model.case import SYSTEM
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.openturns_adapter import errorMessage, raiseInterrupt, toXML
from satsep_ot.studies import drivers
from satsep_ot.studies.drivers import Violation
from satsep_ot.studies.results_directory import DirectoryError, ResultsDirectory, digest, file_stem, package_versions
from satsep_ot.studies.study_runs import BLOCK, inputs_digest, sample_inputs
from satsep_ot.studies.telling import figures
from satsep_ot.studies.telling.animation import animation_data
from satsep_ot.studies.telling.report import write_report
from satsep_ot.studies.telling.verdicts import (
    NO_ESTIMATE,
    TOO_RARE,
    Verdict,
    best_row,
    contradiction,
    is_resolved,
    judge,
    with_bound,
)

STUDY_METHODS = ("ActiveSubspace", "FORM", "SORM", "SubsetSampling", "MonteCarlo")
# What a study writes, beside the case and its tables.
_WRITTEN = (
    "results.json", "motion.json", "report.html", "figures/*.svg", "runs/*.npz", "runs/sample.npy*", "steps/*.json",
    "steps/*.npz", "steps/sample.checkpoint*",
)  # fmt: skip
# Runs of the sample that densities are drawn from, and as many runs of the surrogates.
_DRAWN = 200_000
# The outputs of so many runs of the sample are kept in a file: about 100 bytes a run.
_LARGEST_SAMPLE_FILE = 10_000_000

# What FORM and SORM cannot see, by the quantity of a requirement.
_BLIND_SPOTS = {
    "lateral_rate": "the limit state is a circle around the mean, which no tangent plane or paraboloid follows",
    "spin": "there are two design points of opposite sign, and the search ends in one",
    "tip_off_rate": "the limit state is a sphere around the mean, which no tangent plane or paraboloid follows",
    "clearance": "every corner of the envelope has a design point of its own, and the search ends in one",
    SYSTEM: "every requirement has design points of its own, and the search ends in one",
}


@dataclasses.dataclass
class Component:
    """A smooth component on its active subspace, and the polynomial regression on its active variables."""

    subspace: object
    active: np.ndarray
    values: np.ndarray
    regression: object


class SeparationStudy:
    """Probability of violating each requirement of a separation, and any of them, by several methods.

    Parameters
    ----------
    problem : :class:`satsep_ot.model.separation_problem.SeparationProblem`
    methods : sequence of str
        Among ActiveSubspace, FORM, SORM, SubsetSampling, MonteCarlo.
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
    >>> [row["requirement"] for row in study.getRows()]
    ['lateral rate', 'spin', 'axial velocity', 'clearance', 'any requirement']
    """

    def __init__(
        self,
        problem: SeparationProblem,
        methods: Sequence[str] = STUDY_METHODS,
        seed: int = 0,
        sampleSize: int = 500_000,
        gradientSize: int = 300,
        toleranceSize: int = 2,
        targetCoefficientOfVariation: float = 0.05,
    ) -> None:
        unknown = [name for name in methods if name not in STUDY_METHODS]
        if unknown or not methods:
            raise ValueError(f"methods = {list(methods)}; some of {', '.join(STUDY_METHODS)} are allowed")
        for name, value in (("sampleSize", sampleSize), ("gradientSize", gradientSize)):
            if int(value) != value or value < 1:
                raise ValueError(f"{name} = {value}; a positive whole number is allowed")
        if int(toleranceSize) != toleranceSize or toleranceSize < 0:
            raise ValueError(f"toleranceSize = {toleranceSize}; a whole number from 0 on is allowed")
        if not 0.01 <= targetCoefficientOfVariation <= 0.5:
            raise ValueError(
                f"targetCoefficientOfVariation = {targetCoefficientOfVariation}; a number from 0.01 to 0.5 is allowed"
            )
        if not problem.getRequirements():
            # Raises the sentence that says so.
            problem.getComponents()
        self._problem = problem
        self._methods = [name for name in STUDY_METHODS if name in methods]
        self._seed = int(seed)
        self._sampleSize = int(sampleSize)
        self._gradientSize = int(gradientSize)
        self._toleranceSize = int(toleranceSize)
        self._target = float(targetCoefficientOfVariation)
        self._names = [*problem.getRequirementNames(), SYSTEM]
        self._progress = lambda label, share: None
        self._directory: ResultsDirectory | None = None
        self._executor = None
        self._sample: np.ndarray | None = None
        self._summary: Any = None
        self._components = {}
        self._rows = []
        self._results = {}
        self._tolerances, self._tightened = {}, {}
        self._violations = {}
        self._complete = False

    def __repr__(self) -> str:
        return (
            f"SeparationStudy(case={self._problem.getCase().name}, methods={self._methods}, seed={self._seed}, "
            f"sampleSize={self._sampleSize})"
        )

    def setProgressCallback(self, callback: Callable[[str, float], None] | None) -> None:
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
            Continue from what is finished there; begin where there is nothing.
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
            "methods": self._methods,
            "versions": package_versions(),
        }
        before = self._directory
        if self._isHere(directory):
            # Our own lock, too, would keep us out.
            before.close()
        self._directory = ResultsDirectory(
            directory, "study", identity, _WRITTEN, {"case.toml": case.text, **case.files}, resume, overwrite,
            {"case": case.name, "command": command},
        )  # fmt: skip
        if before is not None:
            before.close()

    def _isHere(self, directory):
        """Whether a path is that of the study's directory."""
        return self._directory is not None and self._directory.path.resolve() == Path(directory).resolve()

    def setExecutor(self, executor: Executor | None) -> None:
        """What runs the Monte Carlo sample, as for
        :class:`satsep_ot.methods.parallel.monte_carlo_stream.MonteCarloStream`.

        The numbers do not depend on it. None (default) for the simulator's own threads.
        """
        self._executor = executor

    def close(self) -> None:
        """Let other processes use the directory."""
        if self._directory is not None:
            self._directory.close()

    def run(self) -> None:
        """The whole chain: sample, subspaces, methods, tolerances, most likely violations."""
        self._complete = False
        self.computeSample()
        self.computeSubspaces()
        self.compareMethods()
        self.computeTolerances()
        self.computeViolations()
        self._complete = True

    def _start(self, *names):
        """Seed of one step, from the study's seed and the step's name."""
        digits = np.frombuffer("/".join(names).encode(), dtype=np.uint8)
        ot.RandomGenerator.SetSeed(int(np.random.SeedSequence([self._seed, *digits]).generate_state(1)[0] >> 1))

    def _step(self, names, compute):
        """What a step gives, from the directory where it is finished there, otherwise computed and kept."""
        kept = None if self._directory is None else self._directory.finished(*names)
        if kept is None:
            kept = compute()
            if self._directory is not None:
                self._directory.keep(names, kept)
        return kept

    def _keepRuns(self, names, makeRuns):
        if self._directory is not None:
            makeRuns().save(self._directory.file("runs", names, ".npz"))

    # The steps. -------------------------------------------------------------------------------------------------------

    def computeSample(self) -> None:
        """Run the Monte Carlo sample; it gives the distributions of the quantities, and a row for each requirement."""
        with contextlib.ExitStack() as stack:
            if self._directory is None:
                folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
            else:
                folder = self._directory.folder("runs")
            path = folder / "sample.npy"
            self._summary = self._step(["sample"], lambda: self._runSample(path))
            if self._directory is not None:
                self._directory.file("steps", ["sample"], ".checkpoint").unlink(missing_ok=True)
            if path.exists():
                self._sample = np.array(np.load(path, mmap_mode="r", allow_pickle=False)[:_DRAWN])
            else:
                distribution = self._problem.getDistribution()
                size = min(_DRAWN, self._sampleSize)
                inputs = sample_inputs(distribution, self._summary["seed"], self._sampleSize, size)
                self._sample = SeparationFunction(self._problem.getCase()).evaluate(inputs)

    def _runSample(self, path):
        """Make the runs, with the outputs in a file, and say what they gave."""
        if self._directory is not None:
            # From here on results.json says that the study is not complete.
            self.saveRows()
        self._progress("compiling the simulator, once", 0.0)
        model = SeparationFunction(self._problem.getCase())
        distribution = self._problem.getDistribution()
        model.evaluate([distribution.getMean()])
        events = {
            entry.name: (entry.quantity, ot.Greater() if entry.is_maximum else ot.Less(), entry.limit)
            for entry in self._problem.getRequirements()
        }
        stream = MonteCarloStream(model, distribution, self._sampleSize)
        stream.setEvents(events)
        stream.setBlockSize(BLOCK)
        stream.setExecutor(self._executor)
        if self._sampleSize <= _LARGEST_SAMPLE_FILE:
            stream.setOutputFile(path)
        checkpoint = None
        if self._directory is not None:
            checkpoint = self._directory.file("steps", ["sample"], ".checkpoint")
            stream.setCheckpointFile(checkpoint)
        stream.setProgressCallback(
            lambda percentage: self._progress(f"{self._sampleSize:,} Monte Carlo runs", 0.002 * percentage)
        )
        self._progress(f"{self._sampleSize:,} Monte Carlo runs", 0.0)
        begin = time.perf_counter()
        self._start("sample")
        # The number that the stream, too, begins with.
        seed = ot.RandomGenerator.IntegerGenerate(2**31 - 1)
        self._start("sample")
        stream.run()
        result = stream.getResult()
        if checkpoint is not None:
            # The file has its name before the step is called finished.
            syncDirectory(path.parent)
        return {
            "seconds": time.perf_counter() - begin,
            "size": self._sampleSize,
            "seed": seed,
            "first block": inputs_digest(sample_inputs(distribution, seed, self._sampleSize, BLOCK)),
            "distribution": toXML(distribution),
            "mean": list(result.getMean()),
            "deviation": list(result.getStandardDeviation()),
            "violations": {name: result.getEventNumber(name) for name in events} | {SYSTEM: result.getEventNumber()},
            "limits": {entry.name: [entry.quantity, entry.is_maximum, entry.limit]
                       for entry in self._problem.getRequirements()},
            "outputs": list(model.getOutputDescription()),
            "inputs": list(model.getInputDescription()),
        }  # fmt: skip

    def computeSubspaces(self) -> None:
        """Active subspace and polynomial regression of each smooth component of the requirements."""
        self._progress("active subspaces from gradients", 0.2)
        function, _, smooth, _ = self._problem.getComponents(None)
        labels = [function.getOutputDescription()[index] for index in smooth]
        names = [label.split(" [")[0] for label in labels]
        distribution = self._problem.getDistribution()
        found = self._step(["gradients"], lambda: self._runGradients(names, distribution))
        points, values, gradients = (np.array(found[key]) for key in ("points", "values", "gradients"))
        for column, name in enumerate(names):
            self._progress(f"active subspace and regression of {name}", 0.2 + 0.1 * column / len(names))
            self._start("subspace", name)
            algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
                distribution, points, values[:, [column]], gradients[:, :, [column]]
            )
            algorithm.run()
            if algorithm.getResult().getDimension() == 0:
                continue
            # The gaps of a noise-free simulator show directions that hardly matter to the output: those that carry 95 %
            # of the gradient's energy are enough for the regression, and its band shows what they leave out.
            algorithm.setDimension(energy_dimension(algorithm.getResult().getEigenvalues(), 0.95))
            algorithm.run()
            subspace = algorithm.getResult()
            active = points @ np.array(subspace.getDirections())
            regression = MultivariatePolynomialRegression(
                ot.Sample(active), ot.Sample(values[:, [column]]), ot.Normal(active.shape[1])
            )
            regression.run()
            self._components[name] = Component(subspace, active, values[:, column], regression.getResult())

    def _runGradients(self, names, distribution):
        model = SeparationFunction(self._problem.getCase(), quantities=names)
        self._start("subspaces")
        algorithm = ActiveSubspaceAlgorithm(model, distribution)
        algorithm.setSamplingSize(self._gradientSize)
        # Only its gradients are wanted, not a subspace of all components together.
        algorithm.setBootstrapSize(2)
        algorithm.run()
        found = algorithm.getResult()
        points, values = np.array(found.getStandardSample()), np.array(found.getOutputSample())
        inputs = np.array(distribution.getInverseIsoProbabilisticTransformation()(ot.Sample(points)))
        labels = model.getInputDescription(), model.getOutputDescription()
        self._keepRuns(
            ["gradients"],
            lambda: TrueRuns.ofSample(
                inputs, values, np.zeros(len(inputs), dtype=bool), *labels, phase="gradients", weight=np.nan
            ),
        )
        arrays = {"points": points, "values": values, "gradients": found.getGradientSample()}
        return {name: array.tolist() for name, array in arrays.items()}

    def compareMethods(self) -> None:
        """Run the methods on each requirement."""
        if self._summary is None and "MonteCarlo" in self._methods:
            self.computeSample()
        self._rows, self._results = [], {}
        self._tolerances, self._tightened, self._violations = {}, {}, {}
        for index, requirement in enumerate(self._names):
            for place, name in enumerate(self._methods):
                done = (index + place / len(self._methods)) / len(self._names)
                self._progress(f"{requirement}: {name}", 0.3 + 0.35 * done)
                names = [requirement, name]
                new = self._directory is not None and self._directory.finished(*names) is None
                row = self._step(names, lambda names=names: dataclasses.asdict(self._runMethod(*names)))
                self._rows.append({"requirement": requirement, **row})
                if new:
                    self.saveRows()
                path = None if self._directory is None else self._directory.file("steps", names, ".npz")
                if path is not None and path.exists() and row["probability"] is not None:
                    # The same after an interruption; and without the surrogates, which take memory.
                    self._results[requirement] = ActiveSubspaceReliabilityResult.load(path, self._event(requirement))

    def _event(self, requirement):
        return self._problem.getSystemEvent() if requirement == SYSTEM else self._problem.getEvent(requirement)

    def _runMethod(self, requirement, name):
        components = self._problem.getComponents(*([] if requirement == SYSTEM else [requirement]))
        if name == "MonteCarlo":
            method = _SharedSample(self._summary["violations"][requirement], self._sampleSize)
        elif name == "ActiveSubspace":
            method = ActiveSubspace(self._target, math.ceil(5000 * max(1.0, (0.05 / self._target) ** 2)))
        else:
            method = METHODS[name]()
        self._start(requirement, name)
        event, parts = self._event(requirement), []
        comparison = ReliabilityComparison(event, [method])
        comparison.setComponents(*components)
        if self._directory is not None and name != "ActiveSubspace":
            comparison.setRunsCallback(lambda inputs, outputs: parts.append((inputs, outputs)))
        comparison.run()
        row, names = comparison.getResult().getRows()[0], [requirement, name]
        row.note = without_inputs(row.note)
        if name == "MonteCarlo":
            row.seconds = self._summary["seconds"]
        elif name == "ActiveSubspace" and row.probability is not None:
            self._results[requirement] = result = method.getLastResult()
            if self._directory is not None:
                result.save(self._directory.file("steps", names, ".npz"))
            self._keepRuns(names, lambda: result.getTrueRuns(components[0].getOutputDescription()))
        elif parts:
            self._keepRuns(names, lambda: _unweighted(name, event, parts))
        return row

    def computeTolerances(self) -> None:
        """Tighten the tolerances that drive each requirement.

        All of them by a tenth, by re-weighting the runs that are there; those that buy most, one by one, by half, and
        estimate anew.
        """
        if "ActiveSubspace" not in self._methods:
            return
        case = self._problem.getCase()
        for index, requirement in enumerate(self._problem.getRequirementNames()):
            shares = self.getDriverShares(requirement)
            self._tolerances[requirement] = []
            if self._toleranceSize == 0 or not shares:
                continue
            self._progress(f"{requirement}: tolerances", 0.65 + 0.27 * index / (len(self._names) - 1))
            strong = [name for name, share in shares.items() if share >= 0.01]
            result = self._results.get(requirement)
            ratios = {} if result is None else drivers.tightened_probabilities(case, result, strong)
            self._tightened[requirement] = ratios
            chosen = (list(ratios) or strong)[: self._toleranceSize]
            for place, name in enumerate(chosen):
                done = (index + place / len(chosen)) / (len(self._names) - 1)
                self._progress(f"{requirement}: half the scatter of {name}", 0.65 + 0.27 * done)
                row = self._step([requirement, "half", name], lambda names=(requirement, name): self._halve(*names))
                self._tolerances[requirement].append(row)

    def _halve(self, requirement, name):
        """The row of a requirement with half the scatter of one tolerance."""
        self._start(requirement, "half", name)
        case = drivers.scaled_case(self._problem.getCase(), name, 0.5)
        try:
            result = drivers.changed_probability(case, requirement)
        except Exception as error:
            # As with a method that fails: the study's other numbers stand without this one.
            raiseInterrupt(error)
            return {
                "tolerance": name,
                "scale": 0.5,
                **dict.fromkeys(("probability", "lower95", "upper95", "evaluations")),
                "converged": False,
                "note": without_inputs(f"{type(error).__name__}: {errorMessage(error)}"),
            }
        function = self._problem.getComponents(requirement)[0]
        self._keepRuns([requirement, "half", name], lambda: result.getTrueRuns(function.getOutputDescription()))
        interval = result.getConfidenceInterval(0.95)
        return {
            "tolerance": name,
            "scale": 0.5,
            "probability": result.getProbabilityEstimate(),
            "lower95": interval.getLowerBound()[0],
            "upper95": interval.getUpperBound()[0],
            "evaluations": result.getEvaluationNumber(),
            "converged": result.getConverged(),
            "note": result.getReason(),
        }

    def computeViolations(self) -> None:
        """The most likely violation of each requirement."""
        for requirement in self._problem.getRequirementNames():
            self._progress(f"{requirement}: most likely violation", 0.93)
            found = self._step([requirement, "violation"], lambda name=requirement: self._findViolation(name))
            if found:
                self._violations[requirement] = drivers.Violation(
                    np.array(found["inputs"]), np.array(found["standard"]), found["distance"]
                )

    def _findViolation(self, requirement):
        self._start(requirement, "violation")
        result = self._results.get(requirement)
        sample = None if result is None else result.getInputSample()
        violation = drivers.most_likely_violation(self._problem, requirement, sample)
        if violation is None:
            return {}
        return {name: np.asarray(value).tolist() for name, value in dataclasses.asdict(violation).items()}

    # What came out. ---------------------------------------------------------------------------------------------------

    def getRows(self) -> list[dict]:
        """One dictionary for each requirement and method, as in results.json."""
        return [{**row, "note": with_bound(row["note"], self._rowsOf(row["requirement"]))} for row in self._rows]

    def _rowsOf(self, requirement):
        return [row for row in self._rows if row["requirement"] == requirement]

    def getComponents(self) -> dict[str, Any]:
        """Active subspace and regression by the name of the smooth component."""
        return dict(self._components)

    def getReliabilityResult(self, requirement: str) -> ActiveSubspaceReliabilityResult:
        """The `ActiveSubspaceReliabilityResult` of a requirement, with its runs, diagnostics and drawings."""
        if requirement not in self._results:
            raise ValueError(f"there is no ActiveSubspace result of '{requirement}'; there are {list(self._results)}")
        return self._results[requirement]

    def getRemarks(self) -> list[str]:
        """Sentences on where methods contradict the best estimate with an interval: by how much, and why."""
        quantities = {entry.name: entry.quantity for entry in self._problem.getRequirements()}
        remarks = []
        for requirement in self._names:
            rows = {row["method"]: row for row in self._rows if row["requirement"] == requirement}
            best = best_row(rows.values())
            doubt = contradiction(rows.values())
            if doubt:
                remarks.append(
                    f"{requirement}: {doubt}: by chance, which does that at most 1 time in 20, or since one of "
                    "them has missed failures. More runs, or another seed, tell which."
                )
            if best is None or not best["probability"]:
                continue
            for name in ("FORM", "SORM"):
                row = rows.get(name)
                if row is None or not row["probability"] or best["lower95"] <= row["probability"] <= best["upper95"]:
                    continue
                ratio = row["probability"] / best["probability"]
                times = f"{1.0 / ratio:.1f} times too low" if ratio < 1.0 else f"{ratio:.1f} times too high"
                why = _BLIND_SPOTS.get(quantities.get(requirement, requirement))
                remarks.append(
                    f"{requirement}: {name} gives {row['probability']:.2e}, {times} against {best['probability']:.2e} "
                    f"[{best['lower95']:.2e}, {best['upper95']:.2e}] by {best['method']}"
                    + (f": {why}." if why else ".")
                )
        return remarks

    def getVerdicts(self) -> list[Verdict]:
        """Whether each requirement is met, requirement by requirement: a
        :class:`satsep_ot.studies.telling.verdicts.Verdict` for each."""
        return [
            judge(
                entry.name, [row for row in self._rows if row["requirement"] == entry.name], entry.allowed_probability
            )
            for entry in self._problem.getRequirements()
        ]

    def getDriverShares(self, requirement: str) -> dict[str, float]:
        """The share of each tolerance in a requirement's violations, the largest first; they sum to 1.

        By its importance in the violations that ActiveSubspace saw; without these, by the mean squared derivatives of
        the smooth components. Empty where neither is known.
        """
        shares = self._importanceShares(requirement)
        if shares:
            return shares
        function, _, smooth, _ = self._problem.getComponents(requirement)
        names = [function.getOutputDescription()[index].split(" [")[0] for index in smooth]
        subspaces = [self._components[name].subspace for name in names if name in self._components]
        return drivers.driver_shares(self._problem.getCase(), subspaces) if subspaces else {}

    def _importanceShares(self, requirement):
        result = self._results.get(requirement)
        return {} if result is None else drivers.importance_shares(self._problem.getCase(), result)

    def getTolerances(self) -> dict[str, list[dict]]:
        """What halving a tolerance buys: for each requirement, a dictionary for each tolerance tried.

        Where no estimate could be made its numbers are None, and its note says why.
        """
        return {requirement: list(rows) for requirement, rows in self._tolerances.items()}

    def getTightenedRatios(self) -> dict[str, dict[str, float]]:
        """What a tenth less scatter does to each probability: for each requirement, its factor by tolerance."""
        return {requirement: dict(ratios) for requirement, ratios in self._tightened.items()}

    def getViolations(self) -> dict[str, Violation]:
        """The most likely :class:`satsep_ot.studies.drivers.Violation` of each requirement, where one was found."""
        return dict(self._violations)

    def getResults(self) -> dict[str, Any]:
        """All numbers as plain data, as they stand in results.json."""
        case = self._problem.getCase()
        table = quantity_table(case.separation)
        nominal = SeparationFunction(case).evaluate([[row.reference for row in case.inputs]])[0]
        return {
            "case": case.name,
            "description": case.description,
            "seed": self._seed,
            "complete": self._complete,
            "finished": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "versions": {**package_versions(), "python": platform.python_version()},
            "sizes": {
                "sample": self._sampleSize,
                "gradients": self._gradientSize,
                "tolerances": self._toleranceSize,
                "precision": self._target,
                "methods": self._methods,
            },
            "rows": self.getRows(),
            "requirements": [
                {**dataclasses.asdict(entry), "text": str(entry), "unit": table[entry.quantity].unit}
                for entry in self._problem.getRequirements()
            ],
            "verdicts": [
                {"requirement": one.requirement, "status": one.status, "sentence": one.sentence}
                for one in self.getVerdicts()
            ],
            "remarks": self.getRemarks(),
            "quantities": {
                name: {
                    "unit": quantity.unit,
                    "description": quantity.description,
                    "nominal": float(value),
                    **self._moments(column),
                }
                for column, ((name, quantity), value) in enumerate(zip(table.items(), nominal, strict=True))
            },
            "tolerances": {
                name: {
                    "scatter": drivers.describe_scatters(rows),
                    "inputs": [row.name for row in rows],
                    "description": drivers.describe_inputs(rows),
                }
                for name, rows in drivers.tolerances(case).items()
            },
            "drivers": {name: self.getDriverShares(name) for name in self._problem.getRequirementNames()},
            "ratios": self.getTightenedRatios(),
            "tightened": self.getTolerances(),
            "violations": {name: self._violationData(violation) for name, violation in self._violations.items()},
            "components": {name: self._componentData(part) for name, part in self._components.items()},
            "diagnostics": {name: self._diagnostics(name, result) for name, result in self._results.items()},
            "correlated": case.copula is not None,
            "assumptions": self._assumptions(),
        }

    def _moments(self, column):
        """Mean and standard deviation of a quantity in the sample, where there is one."""
        if self._summary is None:
            return {}
        return {"mean": self._summary["mean"][column], "deviation": self._summary["deviation"][column]}

    def _violationData(self, violation):
        case = self._problem.getCase()
        quantities = SeparationFunction(case).evaluate(violation.inputs[None])[0]
        return {
            "distance": violation.distance,
            "quantities": dict(zip(quantity_table(case.separation), quantities.tolist(), strict=True)),
            "inputs": [
                {"name": row.name, "unit": row.unit, "value": float(value), "standard": float(standard)}
                for row, value, standard in zip(case.inputs, violation.inputs, violation.standard, strict=True)
            ],
        }

    @staticmethod
    def _componentData(part):
        return {
            "dimension": part.subspace.getDimension(),
            "eigenvalues": list(part.subspace.getEigenvalues())[:10],
            "degree": part.regression.getDegree(),
            "Q2": part.regression.getQ2LeaveOneOut()[0],
            "error_bound": part.subspace.getErrorBound(),
        }

    def _diagnostics(self, requirement, result):
        finite = {name: value if np.isfinite(value) else None for name, value in result.getDiagnostics().items()}
        return {
            **finite,
            "method": result.getMethod(),
            "reason": with_bound(result.getReason(), self._rowsOf(requirement)),
            "surrogate probability": result.getSurrogateProbability(),
        }

    def _assumptions(self):
        """Sentences on what the numbers rest on, for this case."""
        case = self._problem.getCase()
        separation = case.separation
        gravity = "Without gravity."
        if separation.orbit is not None:
            torque = "with" if separation.gradient_torque else "without"
            gravity = f"With the difference of gravity between the bodies, {torque} the gravity-gradient torque."
        push = {
            ForceLine.GUIDED: "along an axis fixed in the platform",
            ForceLine.STRUT: "along the line between its seats",
            ForceLine.NORMAL: "as a foot, square to the satellite's plate",
        }[separation.force_line]
        line = {ForceLine.GUIDED: "guided", ForceLine.STRUT: "struts", ForceLine.NORMAL: "feet"}[separation.force_line]
        return [
            "Both bodies are rigid; after the command they touch nothing but the springs and connectors of the case.",
            f"The springs are {line}: each pushes {push}, without mass, without friction unless the case says so, "
            "and lets go once and for all at the end of its stroke.",
            gravity,
            f"The {len(case.inputs)} uncertain inputs have the distributions of the case file "
            + (
                "and are independent."
                if case.copula is None
                else "and the correlations named there, by a normal copula."
            )
            + " The probabilities are as good as these are: the tails of a distribution are rarely measured.",
            "Every quantity is that of the last release unless its description says otherwise.",
        ]

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
        self._takeDirectory(directory)
        results, paths = self.getResults(), []
        results["figures"] = []
        for section, name, text, figure in self._panels():
            path = self._directory.folder("figures") / (file_stem([section, name]) + ".svg")
            paths.append(writeWhole(path, lambda stream, figure=figure: figures.save_figure(figure, stream, "svg")))
            results["figures"].append({"section": section, "name": name, "text": text, "file": path.name})
        case = self._problem.getCase()
        runs = {"nominal": case.separation.parameters()}
        for name, violation in self._violations.items():
            runs[name] = drivers.run_parameters(case, violation.inputs)
        motion = json.dumps(animation_data(case.separation, runs), allow_nan=False) + "\n"
        paths.append(self._directory.writeText("motion.json", motion))
        paths.append(self._writeResults(results))
        return [*paths[::-1], write_report(self._directory.path)]

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
        self._takeDirectory(directory)
        return self._writeResults(
            {"case": self._problem.getCase().name, "seed": self._seed, "complete": False, "rows": self.getRows()}
        )

    def _takeDirectory(self, directory):
        if self._directory is None and directory is None:
            raise ValueError("there is no directory to write to; give one, or call setDirectory() before run()")
        if directory is not None and not self._isHere(directory):
            self.setDirectory(directory)

    def _writeResults(self, results):
        return self._directory.writeText("results.json", json.dumps(results, indent=2, allow_nan=False) + "\n")

    def _panels(self):
        """(section, name, text alternative, figure) of each panel of the report."""
        case = self._problem.getCase()
        units = {name: quantity.unit for name, quantity in quantity_table(case.separation).items()}
        motion = figures.compute_motion(case.separation)
        for name, draw in (
            ("velocity", figures.draw_separation_velocity),
            ("rates", figures.draw_rates),
            ("strokes", figures.draw_strokes),
        ):
            ax = draw(motion)
            ax.set_xlim(0.0, 1e3 * motion.times[-1])
            yield "separation", name, f"{name} of the nominal run over time", ax.figure
        for verdict in self.getVerdicts():
            if verdict.row is not None:
                allowed = self._problem.getCase().requirements[self._names.index(verdict.requirement)]
                ax = figures.draw_answer(verdict.row, allowed.allowed_probability)
                yield "answer", verdict.requirement, verdict.sentence, ax.figure
        for requirement in self._problem.getRequirementNames():
            shares = self.getDriverShares(requirement)
            if shares:
                seen = self._importanceShares(requirement)
                label = "share in the violations" if seen else "share in the squared sensitivity"
                ax = figures.draw_shares(shares, title=requirement, label=label)
                yield "drivers", requirement, f"shares of the tolerances in {requirement}", ax.figure
        for requirement, halved in self._tolerances.items():
            best = best_row(self._rowsOf(requirement))
            if best is not None and halved:
                rows = [{**best, "method": "as it is"}]
                for row in halved:
                    row = {**row, "method": f"half of\n{row['tolerance'].replace('_', ' ')}"}
                    if row["probability"] is None:
                        row["message"] = NO_ESTIMATE
                    elif not is_resolved(best, row):
                        # No bar: it would show how few the runs are.
                        row |= {"probability": None, "lower95": None, "upper95": None, "message": TOO_RARE}
                    rows.append(row)
                yield (
                    "tightened",
                    requirement,
                    f"{requirement} with halved tolerances",
                    figures.draw_probabilities(rows, title=requirement).figure,
                )
        if self._sample is not None:
            for name, arguments in self._densities(units).items():
                ax = figures.draw_density(label=name, **arguments)
                yield "densities", name, f"probability density of {name}", ax.figure
        for name, part in self._components.items():
            ax = figures.draw_eigenvalues(part.subspace, label=name, unit=units[name])
            yield "eigenvalues", name, f"eigenvalues of {name}", ax.figure
            ax = figures.draw_sufficient_summary(
                part.active, part.values, part.regression, label=name, unit=units[name]
            )
            yield "summaries", name, f"{name} against its active variable, with the regression", ax.figure
        for requirement in dict.fromkeys(row["requirement"] for row in self._rows):
            rows = self._rowsOf(requirement)
            ax = figures.draw_probabilities(rows, title=requirement)
            yield "methods", requirement, f"probability of {requirement} by each method", ax.figure

    def _densities(self, units):
        """Arguments of `draw_density` for each requirement's quantity, then for the other quantities of interest."""
        columns = list(units)
        law = {name: figures.sample_density(values) for name, values in self._surrogateSample(_DRAWN).items()}
        densities, drawn = {}, set()
        for entry in self._problem.getRequirements():
            best = best_row(self._rowsOf(entry.name))
            # A second limit on a quantity has a panel of its own.
            label = f"{entry.quantity} ({entry.name})" if entry.quantity in drawn else entry.quantity
            drawn.add(entry.quantity)
            densities[label] = {
                "sample": self._sample[:, columns.index(entry.quantity)],
                "density": law.get(entry.quantity),
                "unit": units[entry.quantity],
                "limit": entry.limit,
                "is_maximum": entry.is_maximum,
                "probability": best["probability"] if best else None,
            }
        for name in columns:
            values = self._sample[:, columns.index(name)]
            # The clearances of single points are parts of the clearance; a quantity that does not vary has no density.
            if (
                name not in drawn
                and not name.startswith("exit_clearance")
                and np.ptp(values) > 1e-9 * np.abs(values).max()
            ):
                densities[name] = {"sample": values, "density": law.get(name), "unit": units[name]}
        return densities

    def _surrogateSample(self, size):
        """Components and quantities of the requirements by the surrogates alone, from one sample of standard space."""
        self._start("surrogate")
        normal = ot.Normal(self._problem.getDistribution().getDimension())
        active = {name: [] for name in self._components}
        # In parts: the points of all inputs at once would be the largest array of the study.
        for start in range(0, size, 20_000):
            points = np.asarray(normal.getSample(min(20_000, size - start)))
            for name, part in self._components.items():
                active[name].append(points @ np.array(part.subspace.getDirections()))
        predictions = {
            name: np.asarray(part.regression.getMetaModel()(ot.Sample(np.concatenate(active[name]))))[:, 0]
            for name, part in self._components.items()
        }
        law = dict(predictions)
        for entry in self._problem.getRequirements():
            function, _, smooth, composition = self._problem.getComponents(entry)
            names = [function.getOutputDescription()[index].split(" [")[0] for index in smooth]
            if all(name in predictions for name in names):
                law[entry.quantity] = np.asarray(composition(np.column_stack([predictions[name] for name in names])))[
                    :, 0
                ]
        return law


def without_inputs(message: str) -> str:
    """The message of an error without all inputs of the run that it names.

    Examples
    --------
    >>> from satsep_ot.studies.separation_study import without_inputs
    >>> without_inputs("row 7 could not be simulated: it is too violent; its inputs are mass = 3 kg, rate = 9 deg/s")
    'row 7 could not be simulated: it is too violent'
    """
    return re.sub("; its inputs are [^;]*", "", message)


def _unweighted(phase, event, parts):
    """Runs of a method that gives its runs no weights."""
    inputs, outputs = (np.concatenate(arrays) for arrays in zip(*parts, strict=True))
    happens, threshold = event.getOperator(), event.getThreshold()
    failed = np.array([happens.compare(value, threshold) for value in outputs[:, 0].tolist()])
    function = event.getFunction()
    return TrueRuns.ofSample(
        inputs, outputs, failed, function.getInputDescription(), function.getOutputDescription(), phase, np.nan
    )


class _SharedSample(ReliabilityMethod):
    """Monte Carlo on a sample that is there already."""

    name = "MonteCarlo"

    def __init__(self, violations, size):
        self._violations, self._size = violations, size

    def run(self, problem):
        problem.counter.evaluations += self._size
        share = self._violations / self._size
        lower, upper = clopperPearson(self._violations, self._size)
        variation = float(np.sqrt((1.0 - share) / self._violations)) if self._violations else None
        note = f"{self._violations} violations; all requirements share these runs"
        return Row(self.name, share, lower, upper, variation, converged=True, note=note)
