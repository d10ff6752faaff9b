"""The whole chain on one separation: a sample, active subspaces and regressions, and the probability of each violation.

This is the study of Hu et al. (2017): propagate the uncertainties through a polynomial on an active subspace and
estimate the failure probability, here corrected by true runs and held against the methods of OpenTURNS.
"""

import dataclasses
import json
import os
import platform
import time
from importlib import metadata
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.methods.active_dimension import energy_dimension
from satsep_ot.methods.active_subspace import ActiveSubspaceAlgorithm
from satsep_ot.methods.comparison import METHODS, ReliabilityComparison, ReliabilityMethod, Row
from satsep_ot.methods.polynomial_regression import MultivariatePolynomialRegression
from satsep_ot.methods.reliability_result import clopperPearson
from satsep_ot.model.case import SYSTEM
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.studies import figures

STUDY_METHODS = ("ActiveSubspace", "FORM", "SORM", "SubsetSampling", "MonteCarlo")

# What FORM and SORM cannot see, by the quantity of a requirement.
_BLIND_SPOTS = {
    "lateral_rate": "the limit state is a circle around the mean, which no tangent plane or paraboloid follows",
    "spin": "there are two design points of opposite sign, and the search ends in one",
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

    Raises
    ------
    ValueError
        If a method is unknown or a size is not positive.

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

    def __init__(self, problem, methods=STUDY_METHODS, seed=0, sampleSize=500_000, gradientSize=300):
        unknown = [name for name in methods if name not in STUDY_METHODS]
        if unknown or not methods:
            raise ValueError(f"methods = {list(methods)}; some of {', '.join(STUDY_METHODS)} are allowed")
        for name, value in (("sampleSize", sampleSize), ("gradientSize", gradientSize)):
            if int(value) != value or value < 1:
                raise ValueError(f"{name} = {value}; a positive whole number is allowed")
        self._problem = problem
        self._methods = [name for name in STUDY_METHODS if name in methods]
        self._seed = int(seed)
        self._sampleSize = int(sampleSize)
        self._gradientSize = int(gradientSize)
        self._names = [*problem.getRequirementNames(), SYSTEM]
        self._progress = lambda label, share: None
        self._sample = None
        self._sampleSeconds = 0.0
        self._components = {}
        self._rows = []
        self._results = {}

    def __repr__(self):
        return (
            f"SeparationStudy(case={self._problem.getCase().name}, methods={self._methods}, seed={self._seed}, "
            f"sampleSize={self._sampleSize})"
        )

    def setProgressCallback(self, callback):
        """Called with what is being done and the share of the whole study that is done, from 0 to 1."""
        self._progress = callback

    def run(self):
        """The whole chain: sample, subspaces, methods."""
        self.computeSample()
        self.computeSubspaces()
        self.compareMethods()

    def _start(self, *names):
        """Seed of one step, from the study's seed and the step's name."""
        digits = np.frombuffer("/".join(names).encode(), dtype=np.uint8)
        ot.RandomGenerator.SetSeed(int(np.random.SeedSequence([self._seed, *digits]).generate_state(1)[0] >> 1))

    # The steps. -------------------------------------------------------------------------------------------------------

    def computeSample(self):
        """Run the Monte Carlo sample; it gives the distributions of the quantities, and a row for each requirement."""
        self._progress("compiling the simulator, if this has not been done before", 0.0)
        model = SeparationFunction(self._problem.getCase())
        distribution = self._problem.getDistribution()
        self._start("sample")
        model.evaluate([distribution.getMean()])
        begin = time.perf_counter()
        self._sample = np.empty((self._sampleSize, model.getOutputDimension()))
        block = 50_000
        for start in range(0, self._sampleSize, block):
            self._progress(f"{self._sampleSize:,} Monte Carlo runs", 0.25 * start / self._sampleSize)
            end = min(start + block, self._sampleSize)
            self._sample[start:end] = model.evaluate(np.asarray(distribution.getSample(end - start)))
        self._sampleSeconds = time.perf_counter() - begin

    def computeSubspaces(self):
        """Active subspace and polynomial regression of each smooth component of the requirements."""
        self._progress("active subspaces from gradients", 0.25)
        function, _, smooth, _ = self._problem.getComponents(None)
        labels = [function.getOutputDescription()[index] for index in smooth]
        names = [label.split(" [")[0] for label in labels]
        model = SeparationFunction(self._problem.getCase(), quantities=names)
        distribution = self._problem.getDistribution()
        self._start("subspaces")
        together = ActiveSubspaceAlgorithm(model, distribution)
        together.setSamplingSize(self._gradientSize)
        together.run()
        found = together.getResult()
        points, values = np.array(found.getStandardSample()), np.array(found.getOutputSample())
        for column, name in enumerate(names):
            self._progress(f"active subspace and regression of {name}", 0.25 + 0.1 * column / len(names))
            algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
                distribution, points, values[:, [column]], found.getGradientSample()[:, :, [column]]
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

    def compareMethods(self):
        """Run the methods on each requirement."""
        self._rows, self._results = [], {}
        for index, requirement in enumerate(self._names):
            for place, name in enumerate(self._methods):
                done = (index + place / len(self._methods)) / len(self._names)
                self._progress(f"{requirement}: {name}", 0.35 + 0.6 * done)
                row = self._runMethod(requirement, name)
                self._rows.append({"requirement": requirement, **dataclasses.asdict(row)})

    def _runMethod(self, requirement, name):
        arguments = () if requirement == SYSTEM else (requirement,)
        event = self._problem.getEvent(*arguments) if arguments else self._problem.getSystemEvent()
        method = _SharedSample(self._violations(requirement)) if name == "MonteCarlo" else METHODS[name]()
        self._start(requirement, name)
        comparison = ReliabilityComparison(event, [method])
        comparison.setComponents(*self._problem.getComponents(*arguments))
        comparison.run()
        row = comparison.getResult().getRows()[0]
        if name == "MonteCarlo":
            row.seconds = self._sampleSeconds
        elif name == "ActiveSubspace" and row.probability is not None:
            self._results[requirement] = method.getLastResult()
        return row

    def _violations(self, requirement):
        """Whether each run of the sample violates the requirement."""
        if self._sample is None:
            self.computeSample()
        columns = list(quantity_table(self._problem.getCase().separation))
        violated = np.zeros(len(self._sample), dtype=bool)
        for entry in self._problem.getRequirements():
            if requirement in (entry.name, SYSTEM):
                violated |= ~entry.is_met(self._sample[:, columns.index(entry.quantity)])
        return violated

    # What came out. ---------------------------------------------------------------------------------------------------

    def getRows(self):
        """One dictionary for each requirement and method, as in results.json."""
        return list(self._rows)

    def getComponents(self):
        """Active subspace and regression by the name of the smooth component."""
        return dict(self._components)

    def getReliabilityResult(self, requirement):
        """The `ActiveSubspaceReliabilityResult` of a requirement, with its runs, diagnostics and drawings."""
        if requirement not in self._results:
            raise ValueError(f"there is no ActiveSubspace result of '{requirement}'; there are {list(self._results)}")
        return self._results[requirement]

    def getRemarks(self):
        """Sentences on where FORM and SORM contradict the best estimate with an interval, by how much, and why."""
        quantities = {entry.name: entry.quantity for entry in self._problem.getRequirements()}
        remarks = []
        for requirement in self._names:
            rows = {row["method"]: row for row in self._rows if row["requirement"] == requirement}
            best = _best_row(rows)
            if best is None:
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

    def getResults(self):
        """All numbers as plain data: case, seed, versions, rows, as they stand in results.json."""
        return {
            "case": self._problem.getCase().name,
            "seed": self._seed,
            "versions": {
                **{name: metadata.version(name) for name in ("satsep-ot", "openturns", "numpy", "scipy", "numba")},
                "python": platform.python_version(),
            },
            "rows": self.getRows(),
        }

    def save(self, directory):
        """Write results.json and the figures; each file appears whole or not at all.

        Parameters
        ----------
        directory : str or path
            Made where it does not exist.

        Returns
        -------
        paths : list of :class:`pathlib.Path`
        """
        directory = Path(directory)
        directory.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.getResults(), indent=2, allow_nan=False) + "\n"
        paths = [_write_whole(directory / "results.json", lambda path: path.write_text(text, encoding="utf-8"))]
        for name, figure in self.drawFigures().items():
            paths.append(
                _write_whole(directory / f"{name}.png", lambda path, figure=figure: figures.save_figure(figure, path))
            )
        return paths

    def drawFigures(self):
        """The figures of the steps that were run, by name: :class:`matplotlib.figure.Figure`."""
        table = quantity_table(self._problem.getCase().separation)
        units = {name: quantity.unit for name, quantity in table.items()}
        drawn = {"separation": figures.separation_figure(self._problem.getCase().separation)}
        if self._components:
            subspaces = {name: component.subspace for name, component in self._components.items()}
            drawn["eigenvalues"] = figures.eigenvalues_figure(subspaces, units)
            drawn["sufficient_summary"] = figures.sufficient_summary_figure(
                {name: (part.active, part.values, part.regression) for name, part in self._components.items()}, units
            )
        if self._sample is not None:
            drawn["densities"] = figures.density_figure(self._densities(units))
        if self._rows:
            drawn["probabilities"] = figures.probabilities_figure(self._rows)
        return drawn

    def _densities(self, units):
        """Arguments of `draw_density` for each requirement's quantity, then for the other quantities of interest."""
        columns = list(units)
        law = {name: figures.sample_density(values) for name, values in self._surrogateSample(200_000).items()}
        densities, drawn = {}, set()
        for entry in self._problem.getRequirements():
            rows = {row["method"]: row for row in self._rows if row["requirement"] == entry.name}
            best = _best_row(rows)
            # A second limit on a quantity has a panel of its own.
            label = f"{entry.quantity} ({entry.name})" if entry.quantity in drawn else entry.quantity
            drawn.add(entry.quantity)
            densities[label] = {
                "sample": self._sample[:200_000, columns.index(entry.quantity)],
                "density": law.get(entry.quantity),
                "unit": units[entry.quantity],
                "limit": entry.limit,
                "is_maximum": entry.is_maximum,
                "probability": best["probability"] if best else None,
            }
        for name in columns:
            values = self._sample[:200_000, columns.index(name)]
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
        points = np.asarray(ot.Normal(self._problem.getDistribution().getDimension()).getSample(size))
        predictions = {}
        for name, part in self._components.items():
            active = points @ np.array(part.subspace.getDirections())
            predictions[name] = np.asarray(part.regression.getMetaModel()(ot.Sample(active)))[:, 0]
        law = dict(predictions)
        for entry in self._problem.getRequirements():
            function, _, smooth, composition = self._problem.getComponents(entry)
            names = [function.getOutputDescription()[index].split(" [")[0] for index in smooth]
            if all(name in predictions for name in names):
                law[entry.quantity] = np.asarray(composition(np.column_stack([predictions[name] for name in names])))[
                    :, 0
                ]
        return law


def _write_whole(path, write):
    """Let `write` make a temporary file and give it its name when it is complete; returns the path."""
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        write(temporary)
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def _best_row(rows):
    """The row that others are judged by: the narrowest interval of ActiveSubspace and MonteCarlo, or None."""
    candidates = [
        row
        for name, row in rows.items()
        if name in ("ActiveSubspace", "MonteCarlo") and row["probability"] and row["converged"]
    ]
    return min(candidates, key=lambda row: row["upper95"] / max(row["lower95"], 1e-300), default=None)


class _SharedSample(ReliabilityMethod):
    """Monte Carlo on a sample that is there already."""

    name = "MonteCarlo"

    def __init__(self, violated):
        self._violated = violated

    def run(self, problem):
        size, failures = len(self._violated), int(np.count_nonzero(self._violated))
        problem.counter.evaluations += size
        share = failures / size
        lower, upper = clopperPearson(failures, size)
        variation = float(np.sqrt((1.0 - share) / failures)) if failures else None
        note = f"{failures} violations; all requirements share these runs"
        return Row(self.name, share, lower, upper, variation, converged=True, note=note)
