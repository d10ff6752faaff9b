"""Figures: what they show, that one can read them, and that nothing global changes."""

import html
import io
import itertools
import subprocess
import sys
import warnings
from functools import partial

import numpy as np
import openturns as ot
import pytest
from matplotlib.figure import Figure
from matplotlib.text import Text
from separation_cases import general_separation, symmetric_separation
from small_cases import ODD_NAMES

from satsep_ot.dynamics.separation import ForceLine, Springs, umbilical
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.model.case import load_case
from satsep_ot.studies.telling import figures
from satsep_ot.studies.telling.animation import animation_data
from satsep_ot.studies.telling.figures import ProbabilityBar
from satsep_ot.studies.telling.motion import compute_motion


def row(method, probability, lower=None, upper=None, **more):
    return ProbabilityBar(method, probability, lower, upper, **{"evaluations": 1000, **more})


ROWS = [
    row("ActiveSubspace", 2e-4, 1.8e-4, 2.2e-4),
    row("FORM", 2e-5, gradients=12),
    row("MonteCarlo", 0.0, 0.0, 3e-3, evaluations=123_456),
    row("SubsetSampling", 2.1e-4, 1e-4, 4e-4, converged=False),
    row("SORM", None),
]


@pytest.fixture(scope="module")
def all_figures(subspace):
    return every_figure(subspace)


@pytest.fixture(scope="module")
def subspace():
    ot.RandomGenerator.SetSeed(0)
    function = ot.SymbolicFunction(["a", "b", "c"], ["exp(0.3 * a + 0.4 * b) + 0.01 * a * b"])
    algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(3))
    algorithm.setDimension(1)
    algorithm.run()
    return algorithm.getResult()


def regression(active, values):
    fit = MultivariatePolynomialRegression(active, np.reshape(values, (-1, 1)), ot.Normal(np.shape(active)[1]))
    fit.run()
    return fit.getResult()


def every_figure(subspace):
    """One figure of each kind, with the awkward cases that occur."""
    active, values = np.array(subspace.getActiveSample()), np.array(subspace.getOutputSample())[:, 0]
    generator = np.random.default_rng(0)
    plane = generator.standard_normal((80, 2))
    bilinear = plane[:, 0] * plane[:, 1]
    sample = generator.standard_normal(5000)
    density = {"sample": sample, "density": figures.sample_density(sample), "unit": "deg/s", "limit": 2.5}
    below = {"sample": sample, "limit": -9.0, "is_maximum": False, "probability": 1e-19, "unit": "mm"}
    springs = Springs(np.linspace(0.0, 6.0, 12), 0.3, 2000.0, 0.04, 0.03)
    return [
        panels(
            lambda ax: figures.draw_eigenvalues(subspace, ax, "rate_x", "deg/s"),
            lambda ax: figures.draw_eigenvalues(subspace, ax, "axial_velocity"),
        ),
        panels(
            lambda ax: figures.draw_sufficient_summary(active, values, regression(active, values), ax, "g", "mm"),
            lambda ax: figures.draw_sufficient_summary(plane, bilinear, regression(plane, bilinear), ax, "h"),
        ),
        panels(
            lambda ax: figures.draw_density(ax=ax, label="rate_x", **density),
            lambda ax: figures.draw_density(ax=ax, label="clearance", **below),
        ),
        figures.draw_probabilities(ROWS, title="spin <= 1 deg/s").figure,
        figures.draw_shares({"mass": 0.7, "stroke": 0.2, "cant": 0.1}, title="spin").figure,
        motion_figure(symmetric_separation()),
        motion_figure(general_separation(ForceLine.STRUT)),
        motion_figure(symmetric_separation(springs=springs)),
    ]


def panels(*draws):
    """A figure with a panel of each."""
    figure, axes = figures.make_panels(len(draws))
    for draw, ax in zip(draws, axes, strict=True):
        draw(ax)
    return figure


def motion_figure(separation):
    motion = compute_motion(separation)
    draws = figures.draw_separation_velocity, figures.draw_rates, figures.draw_strokes
    return panels(*(partial(draw, motion) for draw in draws))


def test_every_figure_is_readable_and_drawn_without_a_warning(all_figures, tmp_path):
    for number, figure in enumerate(all_figures):
        assert isinstance(figure, Figure)
        path = tmp_path / f"{number}.{('png', 'svg')[number % 2]}"
        figures.save_figure(figure, path)
        assert path.stat().st_size > 5000
        for text in figure.findobj(Text):
            if text.get_text():
                assert text.get_fontsize() >= 11, text
        for ax in figure.axes:
            assert ax.get_xlabel() or ax.get_ylabel()
            assert ax.has_data()


def test_text_stays_within_the_picture_and_does_not_overlap(all_figures):
    for figure in all_figures:
        figure.draw_without_rendering()
        page = figure.bbox.padded(1.0)
        for ax in figure.axes:
            ticks = [label for label in ax.get_xticklabels() if label.get_text()]
            boxes = sorted((label.get_window_extent() for label in ticks), key=lambda box: box.x0)
            inside = [box for box in boxes if ax.bbox.x0 - 1 <= 0.5 * (box.x0 + box.x1) <= ax.bbox.x1 + 1]
            assert all(left.x1 <= right.x0 for left, right in itertools.pairwise(inside))
            for text in [ax.xaxis.label, ax.yaxis.label, ax.title, *ax.texts]:
                if text.get_text():
                    box = text.get_window_extent()
                    assert page.contains(box.x0, box.y0), text
                    assert page.contains(box.x1, box.y1), text


def test_importing_and_drawing_change_nothing_global():
    # Reading the backend of the rcParams would load pyplot by itself.
    code = """
import io, sys, matplotlib
def parameters():
    return {key: matplotlib.rcParams[key] for key in matplotlib.rcParams if key != "backend"}
before = parameters()
from satsep_ot.studies.telling import figures
figures.save_figure(figures.draw_density([1.0, 2.0], limit=1.5).figure, io.BytesIO())
assert "matplotlib.pyplot" not in sys.modules
assert parameters() == before
"""
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True)


def test_panels_draw_into_the_axes_given(subspace):
    motion = compute_motion(symmetric_separation())
    calls = [
        (figures.draw_eigenvalues, subspace),
        (figures.draw_density, [1.0, 2.0]),
        (figures.draw_probabilities, ROWS),
        (figures.draw_rates, motion),
        (figures.draw_strokes, motion),
        (figures.draw_separation_velocity, motion),
    ]
    for draw, data in calls:
        ax = Figure().add_subplot()
        assert draw(data, ax) is ax


def test_eigenvalues_shown_are_those_of_the_result(subspace):
    ax = figures.draw_eigenvalues(subspace, label="rate_x", unit="deg/s")
    line = next(line for line in ax.lines if line.get_label() == "estimate")
    np.testing.assert_array_equal(line.get_ydata(), np.array(subspace.getEigenvalues())[:2])
    assert ax.get_yscale() == "log"
    assert ax.get_ylabel() == "eigenvalue [(deg/s)²]"
    assert ax.get_title() == "rate x"


def test_constant_function_has_no_eigenvalues_to_draw():
    algorithm = ActiveSubspaceAlgorithm(ot.SymbolicFunction(["a", "b"], ["1 + 0 * a"]), ot.Normal(2))
    algorithm.run()
    ax = figures.draw_eigenvalues(algorithm.getResult())
    assert [text.get_text() for text in ax.texts] == ["all eigenvalues are 0"]


def test_summary_shows_runs_and_regression():
    active = np.linspace(-2.0, 2.0, 40)[:, None]
    values = 1.0 + active[:, 0] ** 3
    ax = figures.draw_sufficient_summary(active, values, regression(active, values), label="gap", unit="mm")
    lines = {line.get_label(): line for line in ax.lines}
    np.testing.assert_array_equal(lines["true runs"].get_ydata(), values)
    np.testing.assert_allclose(lines["degree 4"].get_ydata(), 1.0 + lines["degree 4"].get_xdata() ** 3, atol=1e-10)
    assert ax.get_ylabel() == "gap [mm]"


def test_kernel_density_of_a_known_law():
    grid, density = figures.sample_density(np.random.default_rng(2).standard_normal(400_000))
    known = np.isfinite(density)
    assert (np.abs(grid[~known]) > 3.0).all()
    np.testing.assert_allclose(density[known], np.exp(-0.5 * grid[known] ** 2) / np.sqrt(2.0 * np.pi), atol=6e-3)
    assert np.nansum(density) * (grid[1] - grid[0]) == pytest.approx(1.0, abs=1e-3)
    with pytest.raises(ValueError, match="two different finite values"):
        figures.sample_density([1.0, 1.0])


def test_kernel_density_does_not_leak_below_zero():
    """A half normal law: the density at 0 is twice that of the normal, and nothing is below."""
    grid, density = figures.sample_density(np.abs(np.random.default_rng(2).standard_normal(400_000)))
    assert grid[0] >= 0.0
    assert density[0] == pytest.approx(2.0 / np.sqrt(2.0 * np.pi), rel=0.02)


@pytest.mark.parametrize(("is_maximum", "share"), [(True, 0.25), (False, 0.5)])
def test_density_annotates_the_share_that_violates(is_maximum, share):
    ax = figures.draw_density([0.0, 1.0, 2.0, 4.0], limit=2.0, is_maximum=is_maximum, unit="mm", label="clearance")
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert f"violated: {share:g}" in labels
    assert "limit 2" in labels
    assert ax.get_xlabel() == "clearance [mm]"
    assert ax.get_ylabel() == "probability density [1/mm]"


def test_density_of_a_constant_is_refused():
    with pytest.raises(ValueError, match="two different finite values"):
        figures.draw_density([3.0, 3.0])


def test_small_numbers_below_a_density_have_room():
    ax = figures.draw_density(1e-4 * np.linspace(-1.0, 1.0, 50), unit="deg/s", label="rate_x")
    figures.save_figure(ax.figure, io.BytesIO())
    texts = [label.get_text() for label in ax.get_xticklabels()]
    assert len(texts) > 3
    assert max(map(len, texts)) <= 5
    assert ax.xaxis.get_offset_text().get_text() == "1e−4"


def test_probabilities_show_every_method_with_its_cost():
    ax = figures.draw_probabilities(ROWS)
    assert [label.get_text() for label in ax.get_yticklabels()] == [bar.label for bar in ROWS]
    texts = [text.get_text() for text in ax.texts]
    assert texts == ["1,000 runs", "1,000 runs\n12 gradients", "123,456 runs", "1,000 runs", "1,000 runs", "no result"]
    low, high = ax.get_xlim()
    assert 0.0 < low < 2e-5
    assert high > 3e-3
    segments = [line.get_xdata() for line in ax.lines if line.get_linestyle() == "-" and len(line.get_xdata()) == 2]
    # An interval each for the methods that have one; that of Monte Carlo begins at 0, off the axis.
    np.testing.assert_allclose(segments, [[1.8e-4, 2.2e-4], [low, 3e-3], [1e-4, 4e-4]])
    hollow = [line.get_xdata()[0] for line in ax.lines if line.get_markerfacecolor() == "white"]
    assert hollow == [2.1e-4]


def test_probability_far_below_the_others_does_not_squeeze_them():
    ax = figures.draw_probabilities([row("FORM", 1e-40), row("MonteCarlo", 1e-3, 0.9e-3, 1.1e-3)])
    assert ax.get_xlim()[0] > 1e-10
    assert any(text.get_text().startswith("< ") for text in ax.texts)


def test_probabilities_without_any_number():
    ax = figures.draw_probabilities([row("FORM", None), row("MonteCarlo", 0.0)])
    assert "no result" in [text.get_text() for text in ax.texts]


def test_a_message_stands_in_place_of_a_probability():
    ax = figures.draw_probabilities([row("as it is", 1e-3, 5e-4, 2e-3), row("half", None, message="too rare")])
    assert "too rare" in [text.get_text() for text in ax.texts]
    assert ax.get_xlim()[1] < 1e-2
    failed = row("half", None, message="failed", evaluations=None)
    assert [text.get_text() for text in figures.draw_probabilities([failed]).texts] == ["", "failed"]


@pytest.mark.parametrize(
    "call",
    [
        lambda: figures.draw_probabilities([]),
        lambda: figures.make_panels(0),
        lambda: figures.draw_shares({}),
    ],
)
def test_nothing_to_draw_is_an_error(call):
    with pytest.raises(ValueError, match="to draw"):
        call()


def test_motion_of_the_axial_push_has_a_closed_form():
    """s = xi (1 - cos(Omega t)) and v = xi Omega sin(Omega t) until the release."""
    motion = compute_motion(symmetric_separation())
    frequency = np.sqrt(22000.0 * (1.0 / 1200.0 + 1.0 / 100.0))
    pushing = motion.times <= motion.release_times[0]
    times = motion.times[pushing]
    expected = 0.04 * (1.0 - np.cos(frequency * times))
    np.testing.assert_allclose(motion.gap[pushing], expected, atol=1e-10)
    for stroke in motion.strokes[pushing].T:
        np.testing.assert_allclose(stroke, expected, atol=1e-10)
    np.testing.assert_allclose(motion.velocity[pushing], 0.04 * frequency * np.sin(frequency * times), atol=1e-8)
    np.testing.assert_allclose(motion.velocity[~pushing], 0.597913, rtol=1e-6)
    assert np.isnan(motion.strokes[~pushing]).all()
    np.testing.assert_allclose(motion.release_strokes, 0.03, rtol=1e-9)


@pytest.mark.parametrize("force_line", ForceLine)
def test_motion_of_a_general_separation_releases_at_the_strokes(force_line):
    separation = general_separation(force_line)
    motion = compute_motion(separation)
    np.testing.assert_allclose(motion.release_strokes, separation.springs.stroke, rtol=1e-8)
    assert np.isnan(motion.strokes[motion.times < separation.springs.delay[3], 3]).all()
    outcome = simulate(separation)
    last = motion.times == motion.release_times.max()
    np.testing.assert_allclose(motion.velocity[last], outcome.quantity("axial_velocity"), rtol=1e-9)
    np.testing.assert_allclose(motion.rates[last, 1], outcome.quantity("rate_y"), rtol=1e-7)


def test_motion_of_other_parameters_than_the_nominal_ones():
    separation = symmetric_separation()
    parameters = separation.parameters()
    parameters[[name.endswith("stiffness") for name in separation.parameter_names()]] *= 4.0
    slow, fast = compute_motion(separation), compute_motion(separation, parameters)
    assert fast.velocity[-1] == pytest.approx(2.0 * slow.velocity[-1], rel=1e-7)


def test_motion_of_a_run_whose_stroke_ends_beyond_its_table():
    springs = Springs(np.array([0.8, 2.4, 3.9, 5.5]), 0.3, 0.0, 0.0, 0.03, tables=[[[0.0, 220.0], [0.03, 55.0]]] * 4)
    separation = symmetric_separation(springs=springs)
    parameters = separation.parameters()
    parameters[[name.endswith("stroke") for name in separation.parameter_names()]] = 0.0305
    motion = compute_motion(separation, parameters)
    np.testing.assert_allclose(motion.release_strokes, 0.0305, rtol=1e-8)


def test_run_that_fails_is_not_drawn():
    with pytest.raises(RuntimeError, match="a spring was not released within the horizon"):
        compute_motion(symmetric_separation(horizon=0.05))


def test_motion_with_a_failed_spring_leaves_it_out():
    separation = load_case("one_spring_failed").separation
    motion = compute_motion(separation)
    assert np.isnan(motion.release_times[2])
    assert np.isnan(motion.strokes[:, 2]).all()
    np.testing.assert_allclose(np.delete(motion.release_strokes, 2), 0.03, atol=1e-7)
    labels = figures.draw_strokes(motion).get_legend_handles_labels()[1]
    assert "spring 3 (failed)" in labels


def test_pins_of_a_connector_are_not_drawn_as_a_spring():
    connector = umbilical(0.4, 0.22, 1500.0, 0.008, 0.0075, friction=18.0, engagement=0.006)
    separation = symmetric_separation(springs=symmetric_separation().springs.joined(connector))
    motion = compute_motion(separation)
    assert motion.names[-2:] == ("umbilical connector 1", "pins of connector 1")
    assert motion.pins.tolist() == [False] * 5 + [True]
    ax = figures.draw_strokes(motion)
    labels = ax.get_legend_handles_labels()[1]
    assert labels == [*motion.names[:5], "release", "pins leave their socket"]
    leaving = next(line for line in ax.get_lines() if line.get_label() == "pins leave their socket")
    np.testing.assert_allclose(leaving.get_ydata(), [6.0], rtol=1e-8)
    run = animation_data(separation, {"nominal": separation.parameters()})["runs"]["nominal"]
    assert len(run["seats"]) == len(run["releases"]) == 5


@pytest.mark.parametrize("form", ["svg", "png", "pdf"])
def test_names_are_drawn_as_they_are(form, tmp_path):
    shares = {name: 1.0 / len(ODD_NAMES) for name in ODD_NAMES}
    bars = [figures.ProbabilityBar(name, 1e-3, message=name) for name in ODD_NAMES]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for number, name in enumerate(ODD_NAMES):
            for ax in (
                figures.draw_shares(shares, title=name, label=name, largest=20),
                figures.draw_probabilities(bars, title=name),
                figures.draw_density([1.0, 2.0], label=f"spin ({name})"),
            ):
                figures.save_figure(ax.figure, tmp_path / f"{number}.{form}")
            if form == "svg" and not name.isascii() and not name.startswith("é"):
                text = html.unescape((tmp_path / f"{number}.svg").read_text(encoding="utf-8"))
                assert f"spin ({name})" in text


def test_plain_names_are_drawn_as_outlines_as_ever(tmp_path):
    path = tmp_path / "plain.svg"
    figures.save_figure(figures.draw_shares({"mass": 1.0}, title="§ été $5").figure, path)
    assert "<text" not in path.read_text(encoding="utf-8")
