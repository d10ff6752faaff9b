"""What stands for a force-stroke table: the interpolant of few rows, a fit to many; and runs with either."""

import itertools
import time

import numpy as np
import pytest
from scipy.integrate import quad, trapezoid
from scipy.interpolate import PchipInterpolator
from separation_cases import general_separation, mixed_springs, symmetric_separation

from satsep_ot import cli
from satsep_ot.dynamics import force_interpolation, simulation
from satsep_ot.dynamics.force_interpolation import MOST_ROWS, Interpolation, force_pieces, interpolant
from satsep_ot.dynamics.separation import ForceLine, Springs, Status
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients, trajectory
from satsep_ot.model.case import load_case, parse_case
from satsep_ot.model.check_document import check_case

STROKE = 0.03


def measured(rows, noise=0.5, seed=0, end=STROKE, stiffness=5500.0):
    strokes = np.linspace(0.0, end, rows)
    force = stiffness * (0.04 - strokes) + noise * np.random.default_rng(seed).standard_normal(rows)
    return np.column_stack([strokes, np.maximum(force, 0.0)])


def with_tables(tables, interpolation=Interpolation.MONOTONE, delay=0.0):
    springs = load_case("reference").separation.springs
    return symmetric_separation(
        springs=Springs(springs.angle, 0.3, 0.0, 0.0, STROKE, delay=delay, tables=tables, interpolation=interpolation)
    )


def noisy(rows, noise=0.5, **options):
    return with_tables([measured(rows, noise, seed) for seed in range(4)], **options)


def work(pieces, low, high):
    starts, coefficients = pieces

    def force(stroke):
        k = max(np.searchsorted(starts, stroke, side="right") - 1, 0)
        return np.polyval(coefficients[k, ::-1], stroke - starts[k])

    inside = [low, *starts[(starts > low) & (starts < high)], high]
    return sum(quad(force, a, b, epsabs=1e-13)[0] for a, b in itertools.pairwise(inside))


@pytest.mark.parametrize("rows", [2, 3, MOST_ROWS])
@pytest.mark.parametrize("interpolation", Interpolation)
def test_few_rows_are_met_exactly(rows, interpolation):
    table = measured(rows)
    starts, coefficients = force_pieces(table, STROKE, interpolation)
    assert np.array_equal(starts, table[:-1, 0])
    assert np.allclose(coefficients[:, 0], table[:-1, 1])
    middle = 0.5 * (table[:-1, 0] + table[1:, 0])
    values = [np.polyval(c[::-1], s - start) for c, s, start in zip(coefficients, middle, starts, strict=True)]
    expected = (
        np.interp(middle, *table.T) if interpolation is Interpolation.LINES else PchipInterpolator(*table.T)(middle)
    )
    assert np.allclose(values, expected, rtol=1e-12)


@pytest.mark.parametrize("rows", [MOST_ROWS + 1, 1000])
@pytest.mark.parametrize("end", [STROKE, 0.041])
def test_many_rows_keep_their_work(rows, end):
    table = measured(rows, 2.0, end=end)
    pieces, rows = force_pieces(table, STROKE), interpolant(table)
    ends = [*pieces[0], end]
    assert STROKE in pieces[0] or end == STROKE
    for low, high in itertools.pairwise(ends):
        assert work(pieces, low, high) == pytest.approx(rows.integrate(low, high), rel=1e-9)
    # Continuous, and nearer to the truth than the rows are.
    starts, coefficients = pieces
    left = [np.polyval(c[::-1], b - a) for c, a, b in zip(coefficients, starts, ends[1:], strict=True)]
    assert np.allclose(left[:-1], coefficients[1:, 0], rtol=1e-9)
    assert np.sqrt(np.mean((coefficients[:, 0] - 5500.0 * (0.04 - starts)) ** 2)) < 2.0


def test_a_cubic_in_many_rows_comes_back():
    strokes = np.linspace(0.0, STROKE, 1000)
    starts, coefficients = force_pieces(np.column_stack([strokes, 220.0 - 7e3 * strokes + 1e6 * strokes**3]), STROKE)
    for start, cubic in zip(starts, coefficients, strict=True):
        z = np.linspace(0.0, 1e-3, 5)
        expected = 220.0 - 7e3 * (start + z) + 1e6 * (start + z) ** 3
        assert np.allclose(np.polyval(cubic[::-1], z), expected, rtol=1e-6)


def test_a_step_in_many_rows_gets_more_cubics():
    table = measured(1000, 0.0)
    table[500:, 1] *= 0.5
    assert len(force_pieces(table, STROKE)[0]) > len(force_pieces(measured(1000), STROKE)[0])
    assert simulate(with_tables([table] * 4)).status[0] == Status.OK


@pytest.mark.parametrize("tolerance", [1e-2, 1e-8, 1e-13])
@pytest.mark.parametrize("rows", [2, 101, 240, 300, 1000])
def test_tables_of_any_length_run_at_any_tolerance(rows, tolerance):
    outcome = simulate(noisy(rows), tolerance=tolerance)
    assert outcome.status[0] == Status.OK
    finest = simulate(noisy(rows), tolerance=1e-13)
    assert outcome.quantity("axial_velocity") == pytest.approx(
        finest.quantity("axial_velocity"), rel=10 * tolerance + 1e-12
    )


@pytest.mark.parametrize("interpolation", Interpolation)
def test_the_fit_moves_the_run_by_less_than_its_rows_are_known(interpolation, monkeypatch):
    fitted = noisy(300, interpolation=interpolation)
    monkeypatch.setattr(force_interpolation, "MOST_ROWS", 10_000)
    rows = noisy(300, interpolation=interpolation)
    assert len(rows.springs.force_pieces()[0][0]) == 299
    found, exact = simulate(fitted, tolerance=1e-11), simulate(rows, tolerance=1e-11)
    assert exact.status[0] == Status.OK
    assert exact.steps[0] > simulation.MAXIMUM_STEPS
    assert found.quantity("axial_velocity") == pytest.approx(exact.quantity("axial_velocity"), rel=1e-9)
    # What the noise gives, to some per cent.
    assert found.quantity("lateral_rate") == pytest.approx(exact.quantity("lateral_rate"), rel=0.05)
    assert found.release_times == pytest.approx(exact.release_times, rel=1e-5)


@pytest.mark.parametrize("tolerance", [1e-8, 1e-13])
def test_a_thousand_noisy_rows_take_at_most_twenty_times_the_time_of_linear_springs(tolerance, monkeypatch):
    monkeypatch.setattr("numba.get_num_threads", lambda: 1)
    cases = [load_case("reference").separation, noisy(1000)]
    parameters = [np.tile(case.parameters(), (200, 1)) for case in cases]
    times = np.empty((2, 7))
    for trial in range(7):
        for number, (case, rows) in enumerate(zip(cases, parameters, strict=True)):
            begin = time.thread_time()
            simulate(case, rows, tolerance)
            times[number, trial] = time.thread_time() - begin
    assert times[1].min() < 20.0 * times[0].min()


@pytest.mark.parametrize("interpolation", Interpolation)
@pytest.mark.parametrize("rows", [2, 4, 7, 1000])
def test_knots_are_located_so_that_tables_keep_the_tolerance(rows, interpolation):
    """Springs that differ, so that no two reach their knots together."""
    tables = [measured(rows, 20.0 / rows, seed) * [1.0, 1.0 + 0.1 * seed] for seed in range(4)]
    separation = with_tables(tables, interpolation)
    rough, fine = simulate(separation, tolerance=1e-8), simulate(separation, tolerance=1e-12)
    scale = np.abs(fine.quantity("tip_off_rate"))
    assert np.abs(rough.quantity("axial_velocity") / fine.quantity("axial_velocity") - 1.0) < 1e-8
    for name in ("rate_x", "rate_y", "rate_z"):
        assert np.abs(rough.quantity(name) - fine.quantity(name)) < 2e-7 * scale


@pytest.mark.parametrize("interpolation", Interpolation)
@pytest.mark.parametrize("rows", [3, 6, 400])
def test_derivatives_through_knots_are_those_of_differences(rows, interpolation):
    tables = [measured(rows, 20.0 / rows, seed) * [1.0, 1.0 + 0.1 * seed] for seed in range(4)]
    separation = with_tables(tables, interpolation, [0.004, 0.0, 0.0, 0.0])
    exact = simulate_with_gradients(separation, tolerance=1e-12)
    names, nominal = separation.parameter_names(), separation.parameters()
    for quantity in ("axial_velocity", "rate_x", "release_time"):
        gradient = exact.quantity_gradient(quantity)[0]
        for name in (
            "satellite.mass",
            "springs[1].scale",
            "springs[2].stroke",
            "springs[0].delay",
            "satellite.center_of_mass.x",
        ):
            place = names.index(name)
            step = 1e-4 * max(abs(nominal[place]), 1e-2)
            moved = np.tile(nominal, (2, 1))
            moved[:, place] += [step, -step]
            values = simulate(separation, moved, tolerance=1e-13).quantity(quantity)
            difference = (values[0] - values[1]) / (2.0 * step)
            assert gradient[place] == pytest.approx(difference, rel=1e-5, abs=1e-7 * np.abs(gradient).max()), name


def test_a_coast_of_a_thousand_seconds_is_followed():
    for name in ("reference", "spinning_stage"):
        for tolerance in (1e-2, 1e-8, 1e-13):
            path = trajectory(load_case(name).separation, [0.0, 600.0, 1000.0], tolerance=tolerance)
            assert path.status == Status.OK
            assert np.isfinite(path.states).all()
    assert cli.main(["simulate", "--at", "1000"]) == 0


def test_a_run_that_has_used_up_its_steps_says_so(monkeypatch):
    monkeypatch.setattr(simulation, "MAXIMUM_STEPS", 2)
    outcome = simulate(symmetric_separation())
    assert outcome.status[0] == Status.TOO_MANY_STEPS
    assert outcome.explain(0) == (
        "all steps that a run may take were used up before its end: give a shorter horizon, or a larger tolerance "
        f"({outcome.steps[0]} steps; 0 of 4 springs were released by then)"
    )
    assert "violent" not in outcome.explain(0)


COARSE = "table = [[0, 220], [8, 215], [15, 120], [30, 55]]\n"


def reference_with(table, interpolation=""):
    text = load_case("reference").text.replace("stroke = 30.0", f"stroke = 30.0\n{table}{interpolation}", 1)
    lines = [line for line in text.splitlines() if not line.startswith(("stiffness", "deformation"))]
    return parse_case("\n".join(lines))


def test_check_shows_the_energy_by_both_interpolations_and_warns_where_it_matters(tmp_path, capsys):
    case = reference_with(COARSE)
    lines = reference_with(COARSE, 'interpolation = "lines"\n')
    trapezoids = 4.0 * trapezoid([220.0, 215.0, 120.0, 55.0], [0.0, 8e-3, 15e-3, 30e-3])
    path = tmp_path / "mine.toml"
    path.write_text(lines.text, encoding="utf-8")
    assert cli.main(["check", str(path)]) == 0
    said = capsys.readouterr().out
    assert f"Spring energy {trapezoids:.6g} J" in said
    assert f"{trapezoids:.6g} J by straight lines (trapezoids); straight lines (trapezoids) are used" in said
    warning = [sentence for sentence in check_case(case).warnings if "springs.table" in sentence]
    assert len(warning) == 1
    assert "choose by springs.interpolation" in warning[0]
    fine = "table = [" + ", ".join(f"[{s}, {220.0 - 5.5 * s}]" for s in range(31)) + "]\n"
    assert not [sentence for sentence in check_case(reference_with(fine)).warnings if "springs.table" in sentence]
    velocity = [simulate(one.separation).quantity("axial_velocity")[0] for one in (case, lines)]
    assert abs(velocity[0] / velocity[1] - 1.0) > 1e-3


def test_parameters_of_a_run_leave_the_fit_as_it_is():
    separation = noisy(500)
    vector = separation.parameters()
    vector[separation.parameter_names().index("springs[0].stroke")] *= 0.99
    moved = separation.with_parameters(vector)
    assert np.array_equal(simulate(moved).base, simulate(separation, vector).base)


@pytest.mark.parametrize(
    ("line", "largest"), [(ForceLine.GUIDED, 1e-8), (ForceLine.STRUT, 1e-8), (ForceLine.NORMAL, 2e-6)]
)
def test_the_tolerance_is_kept_by_every_force_line_and_law(line, largest):
    """The kink of the guides' friction is not located."""
    rng = np.random.default_rng(7)
    for options in ({}, {"springs": mixed_springs()}):
        separation = general_separation(line, **options)
        rows = separation.parameters() * (1.0 + 0.05 * rng.standard_normal((300, len(separation.parameters()))))
        rough, fine = simulate(separation, rows, 1e-8), simulate(separation, rows, 1e-13)
        assert (fine.status == Status.OK).all()
        for name, floor in (("axial_velocity", 0.0), ("tip_off_rate", 0.1)):
            exact = fine.quantity(name)
            assert (np.abs(rough.quantity(name) - exact) / np.maximum(np.abs(exact), floor)).max() < largest


@pytest.mark.parametrize("what", ["no force", "no force at first", "ends far beyond the stroke", "rows apart", "tiny"])
def test_odd_tables_of_many_rows_are_fitted_too(what):
    table, stroke = measured(400), STROKE
    if what == "no force":
        table[:, 1] = 0.0
    elif what == "no force at first":
        table[:200, 1] = 0.0
    elif what == "ends far beyond the stroke":
        stroke = 1e-5
    elif what == "rows apart":
        table[1:, 0] = np.linspace(0.0299, STROKE, 399)
    else:
        table *= [1.0, 1e-9]
    starts, coefficients = force_pieces(table, stroke)
    assert len(starts) <= 256
    assert np.isfinite(coefficients).all()
    ends = [*starts, table[-1, 0]]
    for low, high in itertools.pairwise(ends):
        expected = interpolant(table).integrate(low, high)
        assert work((starts, coefficients), low, high) == pytest.approx(
            expected, rel=1e-6, abs=1e-9 * table[:, 1].max()
        )
