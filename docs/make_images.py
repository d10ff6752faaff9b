"""Make the pictures of the README and of the pages here, from real runs of the reference case (about a minute).

python docs/make_images.py [DIRECTORY] [RUNS]
"""

import re
import sys
from functools import partial
from pathlib import Path

import numpy as np
import openturns as ot
from matplotlib.figure import Figure

from satsep_ot.methods.polynomials.distribution import PolynomialDistribution
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.model.inputs import ParameterMap
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.telling import figures
from satsep_ot.studies.telling.motion import compute_motion

BLOCK = 100_000
AGREEMENT = Path(__file__).parent.parent / "tests" / "benchmarks" / "truth_agreement.txt"
COMPONENTS = {"axial_velocity": "m/s", "rate_x": "deg/s", "rate_y": "deg/s", "exit_clearance_1": "mm"}


def form_design_rates(problem, function):
    """Body rates about x and z at FORM's design point of the lateral rate, and FORM's probability."""
    solver = ot.AbdoRackwitz()
    start = problem.getDistribution().getMean()
    # Off the mean, where the lateral rate is 0 and has no gradient.
    start[9] += 0.5
    solver.setStartingPoint(start)
    algorithm = ot.FORM(solver, problem.getEvent("lateral rate"))
    algorithm.run()
    result = algorithm.getResult()
    return function.evaluate([result.getPhysicalSpaceDesignPoint()])[0], result.getEventProbability()


def draw_rate_plane(rates, design, form, limit):
    """Monte Carlo runs in the plane of the lateral rates, the circle that they must not leave, and what FORM sees."""
    failed = np.hypot(*rates.T) > limit
    ax = Figure(figsize=(8.9, 5.2), layout="constrained").add_subplot()
    ax.plot(*rates[~failed].T, ",", color="0.55")
    (safe,) = ax.plot([], [], "o", color="0.55", markersize=3)
    violated, = ax.plot(*rates[failed].T, "o", color=figures.ORANGE, markersize=4.5, markeredgecolor="black",
                        markeredgewidth=0.5)  # fmt: skip
    angle = np.linspace(0.0, 2.0 * np.pi, 400)
    (circle,) = ax.plot(limit * np.cos(angle), limit * np.sin(angle), "-", color="black", linewidth=1.8)
    across = np.array([-design[1], design[0]])
    (tangent,) = ax.plot(*np.stack([design - 2.0 * across, design + 2.0 * across]).T, "--", color=figures.BLUE, lw=2.0)
    (point,) = ax.plot(*design, "s", color=figures.BLUE, markersize=9)
    ax.set_xlabel("satellite body rate about x [deg/s]", fontsize=figures.FONT_SIZE)
    ax.set_ylabel("satellite body rate about z [deg/s]", fontsize=figures.FONT_SIZE)
    ax.tick_params(labelsize=figures.FONT_SIZE)
    ax.grid(True, color="0.88", linewidth=0.8)
    ax.set_box_aspect(1.0)
    ax.set_anchor("W")
    ax.set_xlim(-1.35 * limit, 1.35 * limit)
    ax.set_ylim(-1.35 * limit, 1.35 * limit)
    share = failed.mean()
    ax.legend(
        [safe, violated, circle, point, tangent],
        [
            f"{len(rates):,} Monte Carlo runs",
            f"{failed.sum()} of them violate:\nprobability {share:.1e}",
            f"limit, {limit:g} deg/s",
            "FORM's design point",
            f"FORM's limit, a straight line:\nprobability {form:.1e}",
        ],
        bbox_to_anchor=(1.02, 1.0),
        loc="upper left",
        fontsize=figures.FONT_SIZE,
        labelspacing=1.2,
        frameon=False,
    )
    return ax.figure


def component_figures(distribution, sample):
    """Eigenvalues, sufficient summaries and densities of smooth components."""
    results, summaries, densities = {}, {}, {}
    for name, unit in COMPONENTS.items():
        function = SeparationFunction("reference", quantities=[name])
        algorithm = ActiveSubspaceAlgorithm(function, distribution)
        algorithm.setDimension(1)
        algorithm.run()
        results[name] = algorithm.getResult()
        active, values = results[name].getActiveSample(), results[name].getOutputSample()
        regression = MultivariatePolynomialRegression(active, values, ot.Normal(1))
        regression.run()
        law = PolynomialDistribution(regression.getResult())
        summaries[name] = (np.array(active), np.array(values)[:, 0], regression.getResult())
        true = function.evaluate(sample)[:, 0]
        grid = np.linspace(true.min(), true.max(), 150)
        densities[name] = {"sample": true, "density": (grid, [law.computePDF(t) for t in grid]), "unit": unit}
    densities["axial_velocity"].update(limit=0.590, is_maximum=False)
    return (
        panels(
            [partial(figures.draw_eigenvalues, results[name], label=name, unit=COMPONENTS[name]) for name in results]
        ),
        panels(
            [
                partial(figures.draw_sufficient_summary, *summaries[name], label=name, unit=COMPONENTS[name])
                for name in summaries
            ]
        ),
        panels([partial(figures.draw_density, label=name, **densities[name]) for name in densities]),
    )


def panels(draws):
    """A figure with a panel of each."""
    figure, axes = figures.make_panels(len(draws))
    for draw, ax in zip(draws, axes, strict=True):
        draw(ax=ax)
    return figure


def agreement_figure(text):
    """Errors of the simulator against the 128-bit solutions, case by case, from what truth_agreement.py printed."""
    ax = Figure(figsize=(9.2, 5.6), layout="constrained").add_subplot()
    tables = re.findall(r"^Relative error at tolerance (\S+),.*\n(case .*)\n((?:.+\n)+?)worst", text, re.MULTILINE)
    names = []
    for (tolerance, _, body), face in zip(tables, ("white", figures.GREY), strict=True):
        rows = [line.split() for line in body.splitlines()]
        names = [f"{name}, {line}" for name, line, *_ in rows]
        errors = np.array([[float(value) for value in row[2:]] for row in rows])
        for column, (label, marker) in enumerate(
            zip(("velocity, position", "rates", "attitude", "release times"), "osD^", strict=True)
        ):
            ax.plot(np.maximum(errors[:, column], 1e-17), range(len(rows)), marker, color="black",
                    markerfacecolor=face, markersize=6, label=f"{label}, tolerance {tolerance}")  # fmt: skip
    ax.axvline(1e-8, color=figures.ORANGE, linestyle="--", label="limit of the test, 1e-8")
    ax.set_xscale("log")
    ax.set_yticks(range(len(names)), names, fontsize=9)
    ax.set_ylim(len(names) - 0.4, -0.6)
    ax.set_xlabel("relative error", fontsize=figures.FONT_SIZE)
    ax.grid(True, color="0.88", linewidth=0.8)
    ax.set_axisbelow(True)
    ax.figure.legend(fontsize=9, loc="outside right upper")
    return ax.figure


def main(directory, runs):
    """Write every picture."""
    ot.RandomGenerator.SetSeed(0)
    directory.mkdir(parents=True, exist_ok=True)
    problem = SeparationProblem("reference")
    case, distribution = problem.getCase(), problem.getDistribution()
    lateral = SeparationFunction("reference", quantities=["rate_x", "rate_z"])
    design, form = form_design_rates(problem, lateral)
    # In blocks: a million rows of all inputs are not to be kept.
    sizes = [min(BLOCK, runs - done) for done in range(0, runs, BLOCK)]
    sample = np.array(distribution.getSample(sizes[0]))
    rates = [lateral.evaluate(sample), *(lateral.evaluate(distribution.getSample(size)) for size in sizes[1:])]
    motion = compute_motion(case.separation, ParameterMap(case.inputs, case.separation).parameters(sample[:1])[0])
    eigenvalues, summaries, densities = component_figures(distribution, sample)
    pictures = {
        "lateral_rate": draw_rate_plane(np.concatenate(rates), design, form, 2.5),
        "eigenvalues": eigenvalues,
        "sufficient_summary": summaries,
        "densities": densities,
        "separation": panels(
            [
                partial(draw, motion)
                for draw in (figures.draw_separation_velocity, figures.draw_rates, figures.draw_strokes)
            ]
        ),
        "agreement": agreement_figure(AGREEMENT.read_text(encoding="utf-8")),
    }
    for name, figure in pictures.items():
        figures.save_figure(figure, directory / f"{name}.png")


if __name__ == "__main__":
    main(
        Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent / "images",
        int(sys.argv[2]) if len(sys.argv) > 2 else 1_000_000,
    )
