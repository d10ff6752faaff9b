"""The whole chain on one separation: a sample, active subspaces and regressions, and the probability of each violation.

This is the study of Hu et al. (2017): propagate the uncertainties through a polynomial on an active subspace and
estimate the failure probability, here corrected by true runs and held against the methods of OpenTURNS.
"""

import dataclasses
import datetime
import json
import os
import platform
import time
from importlib import metadata
from pathlib import Path

import numpy as np
import openturns as ot

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.methods.active_dimension import energy_dimension
from satsep_ot.methods.active_subspace import ActiveSubspaceAlgorithm
from satsep_ot.methods.comparison import METHODS, ReliabilityComparison, ReliabilityMethod, Row
from satsep_ot.methods.polynomial_regression import MultivariatePolynomialRegression
from satsep_ot.methods.reliability_result import clopperPearson
from satsep_ot.model.case import SYSTEM
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.studies import drivers, figures
from satsep_ot.studies.animation import animation_data
from satsep_ot.studies.report import write_report
from satsep_ot.studies.verdicts import best_row, judge

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
    toleranceSize : int
        How many of the strongest tolerances of each requirement are halved to see what that buys; 0 for none. It takes
        ActiveSubspace among the methods.

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

    def __init__(self, problem, methods=STUDY_METHODS, seed=0, sampleSize=500_000, gradientSize=300, toleranceSize=2):
        unknown = [name for name in methods if name not in STUDY_METHODS]
        if unknown or not methods:
            raise ValueError(f"methods = {list(methods)}; some of {', '.join(STUDY_METHODS)} are allowed")
        for name, value in (("sampleSize", sampleSize), ("gradientSize", gradientSize)):
            if int(value) != value or value < 1:
                raise ValueError(f"{name} = {value}; a positive whole number is allowed")
        if int(toleranceSize) != toleranceSize or toleranceSize < 0:
            raise ValueError(f"toleranceSize = {toleranceSize}; a whole number from 0 on is allowed")
        self._problem = problem
        self._methods = [name for name in STUDY_METHODS if name in methods]
        self._seed = int(seed)
        self._sampleSize = int(sampleSize)
        self._gradientSize = int(gradientSize)
        self._toleranceSize = int(toleranceSize)
        self._names = [*problem.getRequirementNames(), SYSTEM]
        self._progress = lambda label, share: None
        self._sample = None
        self._sampleSeconds = 0.0
        self._components = {}
        self._rows = []
        self._results = {}
        self._tolerances, self._tightened = {}, {}
        self._violations = {}
        self._complete = False

    def __repr__(self):
        return (
            f"SeparationStudy(case={self._problem.getCase().name}, methods={self._methods}, seed={self._seed}, "
            f"sampleSize={self._sampleSize})"
        )

    def setProgressCallback(self, callback):
        """Called with what is being done and the share of the whole study that is done, from 0 to 1."""
        self._progress = callback

    def run(self):
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

    # The steps. -------------------------------------------------------------------------------------------------------

    def computeSample(self):
        """Run the Monte Carlo sample; it gives the distributions of the quantities, and a row for each requirement."""
        self._progress("compiling the simulator, once", 0.0)
        model = SeparationFunction(self._problem.getCase())
        distribution = self._problem.getDistribution()
        self._start("sample")
        model.evaluate([distribution.getMean()])
        begin = time.perf_counter()
        self._sample = np.empty((self._sampleSize, model.getOutputDimension()))
        # An interrupt is seen between two chunks: they take a fraction of a second.
        block, chunk = 50_000, 5_000
        for start in range(0, self._sampleSize, block):
            end = min(start + block, self._sampleSize)
            inputs = np.asarray(distribution.getSample(end - start))
            for first in range(start, end, chunk):
                self._progress(f"{self._sampleSize:,} Monte Carlo runs", 0.2 * first / self._sampleSize)
                last = min(first + chunk, end)
                self._sample[first:last] = model.evaluate(inputs[first - start : last - start])
        self._sampleSeconds = time.perf_counter() - begin

    def computeSubspaces(self):
        """Active subspace and polynomial regression of each smooth component of the requirements."""
        self._progress("active subspaces from gradients", 0.2)
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
            self._progress(f"active subspace and regression of {name}", 0.2 + 0.1 * column / len(names))
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
        self._tolerances, self._tightened, self._violations = {}, {}, {}
        for index, requirement in enumerate(self._names):
            for place, name in enumerate(self._methods):
                done = (index + place / len(self._methods)) / len(self._names)
                self._progress(f"{requirement}: {name}", 0.3 + 0.35 * done)
                row = self._runMethod(requirement, name)
                self._rows.append({"requirement": requirement, **dataclasses.asdict(row)})

    def _runMethod(self, requirement, name):
        arguments = () if requirement == SYSTEM else (requirement,)
        event = self._problem.getEvent(*arguments) if arguments else self._problem.getSystemEvent()
        method = _SharedSample(self._violated(requirement)) if name == "MonteCarlo" else METHODS[name]()
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

    def computeTolerances(self):
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
                self._start(requirement, "half", name)
                result = drivers.changed_probability(drivers.scaled_case(case, name, 0.5), requirement)
                interval = result.getConfidenceInterval(0.95)
                self._tolerances[requirement].append(
                    {
                        "tolerance": name,
                        "scale": 0.5,
                        "probability": result.getProbabilityEstimate(),
                        "lower95": interval.getLowerBound()[0],
                        "upper95": interval.getUpperBound()[0],
                        "evaluations": result.getEvaluationNumber(),
                        "converged": result.getConverged(),
                    }
                )

    def computeViolations(self):
        """The most likely violation of each requirement."""
        for requirement in self._problem.getRequirementNames():
            self._progress(f"{requirement}: most likely violation", 0.93)
            result = self._results.get(requirement)
            sample = None if result is None else result.getInputSample()
            violation = drivers.most_likely_violation(self._problem, requirement, sample)
            if violation is not None:
                self._violations[requirement] = violation

    def _violated(self, requirement):
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

    def _rowsOf(self, requirement):
        return [row for row in self._rows if row["requirement"] == requirement]

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
            best = best_row(rows.values())
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

    def getVerdicts(self):
        """Whether each requirement is met: :class:`satsep_ot.studies.verdicts.Verdict`, requirement by requirement."""
        return [
            judge(
                entry.name, [row for row in self._rows if row["requirement"] == entry.name], entry.allowed_probability
            )
            for entry in self._problem.getRequirements()
        ]

    def getDriverShares(self, requirement):
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

    def getTolerances(self):
        """What halving a tolerance buys: for each requirement, a dictionary for each tolerance tried."""
        return {requirement: list(rows) for requirement, rows in self._tolerances.items()}

    def getTightenedRatios(self):
        """What a tenth less scatter does to each probability: for each requirement, its factor by tolerance."""
        return {requirement: dict(ratios) for requirement, ratios in self._tightened.items()}

    def getViolations(self):
        """The most likely :class:`satsep_ot.studies.drivers.Violation` of each requirement, where one was found."""
        return dict(self._violations)

    def getResults(self):
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
            "versions": {
                **{name: metadata.version(name) for name in ("satsep-ot", "openturns", "numpy", "scipy", "numba")},
                "python": platform.python_version(),
            },
            "sizes": {
                "sample": self._sampleSize,
                "gradients": self._gradientSize,
                "tolerances": self._toleranceSize,
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
                    "scatter": drivers.describe_scatter(rows[0]),
                    "inputs": [row.name for row in rows],
                    "description": rows[0].description,
                }
                for name, rows in drivers.tolerances(case).items()
            },
            "drivers": {name: self.getDriverShares(name) for name in self._problem.getRequirementNames()},
            "ratios": self.getTightenedRatios(),
            "tightened": self.getTolerances(),
            "violations": {name: self._violationData(violation) for name, violation in self._violations.items()},
            "components": {name: self._componentData(part) for name, part in self._components.items()},
            "diagnostics": {name: self._diagnostics(result) for name, result in self._results.items()},
            "correlated": case.copula is not None,
            "assumptions": self._assumptions(),
        }

    def _moments(self, column):
        """Mean and standard deviation of a quantity in the sample, where there is one."""
        if self._sample is None:
            return {}
        values = self._sample[:, column]
        return {"mean": float(values.mean()), "deviation": float(values.std())}

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

    @staticmethod
    def _diagnostics(result):
        finite = {name: value if np.isfinite(value) else None for name, value in result.getDiagnostics().items()}
        return {
            **finite,
            "method": result.getMethod(),
            "reason": result.getReason(),
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
            f"The springs are {line}: each pushes {push}, without mass or friction of its own unless the case says so, "
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

    def save(self, directory):
        """Write report.html and what it is made of: results.json, motion.json, case.toml and figures.

        Each file appears whole or not at all.

        Parameters
        ----------
        directory : str or path
            Made where it does not exist.

        Returns
        -------
        paths : list of :class:`pathlib.Path`
        """
        directory = Path(directory)
        (directory / "figures").mkdir(parents=True, exist_ok=True)
        results, paths = self.getResults(), []
        results["figures"] = []
        for section, name, text, figure in self._panels():
            path = directory / "figures" / f"{section}-{name}.svg".replace(" ", "_").replace("/", "_")
            paths.append(_write_whole(path, lambda path, figure=figure: figures.save_figure(figure, path)))
            results["figures"].append({"section": section, "name": name, "text": text, "file": path.name})
        case = self._problem.getCase()
        runs = {"nominal": case.separation.parameters()}
        for name, violation in self._violations.items():
            runs[name] = drivers.run_parameters(case, violation.inputs)
        for name, text in (
            ("case.toml", case.text),
            ("motion.json", json.dumps(animation_data(case.separation, runs), allow_nan=False) + "\n"),
            ("results.json", json.dumps(results, indent=2, allow_nan=False) + "\n"),
        ):
            paths.append(
                _write_whole(directory / name, lambda path, text=text: path.write_text(text, encoding="utf-8"))
            )
        return [*paths[::-1], write_report(directory)]

    def saveRows(self, directory):
        """Write results.json alone, with the rows that are finished so far.

        Parameters
        ----------
        directory : str or path

        Returns
        -------
        path : :class:`pathlib.Path`
        """
        directory = Path(directory)
        directory.mkdir(parents=True, exist_ok=True)
        text = json.dumps(self.getResults(), indent=2, allow_nan=False) + "\n"
        return _write_whole(directory / "results.json", lambda path: path.write_text(text, encoding="utf-8"))

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
                rows += [{**row, "method": f"half of\n{row['tolerance'].replace('_', ' ')}"} for row in halved]
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
        law = {name: figures.sample_density(values) for name, values in self._surrogateSample(200_000).items()}
        densities, drawn = {}, set()
        for entry in self._problem.getRequirements():
            best = best_row(self._rowsOf(entry.name))
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
