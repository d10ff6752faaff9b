import numpy as np
import pytest
from separation_cases import (
    SQUARE,
    TRUTH,
    general_separation,
    mixed_springs,
    symmetric_separation,
    truth_parameters,
    truth_separation,
)

from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.parameter_vector import Sign
from satsep_ot.dynamics.quantities import base_fields, quantity_table
from satsep_ot.dynamics.relative_orbit import Recontact
from satsep_ot.dynamics.separation import Body, ForceLine, Springs, Status
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients


@pytest.mark.parametrize("reference", TRUTH["gradients"], ids=lambda reference: reference["force_line"])
def test_truth_gradients(reference):
    """Velocity, rates and last release time at the moving instant of the last release."""
    separation = truth_separation(reference["case"], reference["force_line"])
    outcome = simulate_with_gradients(separation, tolerance=1e-11)
    names = separation.parameter_names()
    last = 6 + int(np.argmax(outcome.release_times[0]))
    for name, truth in reference["derivatives"].items():
        columns = [names.index(parameter) for parameter in truth_parameters(name, len(separation.springs))]
        gradient = outcome.gradients[0][:, columns].sum(axis=1)
        for block, expected in (
            (slice(3, 6), truth[:3]),
            (slice(9, 12), truth[3:6]),
            (slice(20, 21), truth[last : last + 1]),
        ):
            error = np.linalg.norm(gradient[block] - expected) / np.linalg.norm(expected)
            assert error < 1e-7, name


def test_gradient_of_the_axial_push_by_calculus():
    """v = sqrt(2 sum K L (xi - L / 2) / mu_r), with the force jump at release (xi > L)."""
    separation = symmetric_separation()
    gradient = simulate_with_gradients(separation, quantities=["axial_velocity"]).quantity_gradient("axial_velocity")[0]
    names = separation.parameter_names()
    inverse_mass = 1.0 / 1200.0 + 1.0 / 100.0
    velocity = np.sqrt(2.0 * 16.5 * inverse_mass)
    expected = {
        "springs[1].stiffness": inverse_mass * 0.03 * 0.025 / velocity,
        "springs[0].deformation": inverse_mass * 5500.0 * 0.03 / velocity,
        "springs[3].stroke": inverse_mass * 5500.0 * 0.01 / velocity,
        "satellite.mass": -16.5 / (100.0**2 * velocity),
        "platform.mass": -16.5 / (1200.0**2 * velocity),
    }
    for name, value in expected.items():
        assert gradient[names.index(name)] == pytest.approx(value, rel=1e-8), name


def test_the_time_of_a_release_at_zero_force_does_not_depend_on_the_deformation():
    """Springs that end at their deformation: a quarter of a period, pi / 2 sqrt(mu_r / sum K)."""
    separation = symmetric_separation(springs=Springs(SQUARE, 0.3, 5500.0, 0.03, 0.04), orbit=None)
    outcome = simulate_with_gradients(separation, tolerance=1e-12)
    names = separation.parameter_names()
    reduced_mass = 1.0 / (1.0 / 1200.0 + 1.0 / 100.0)
    period = 0.5 * np.pi * np.sqrt(reduced_mass / 22000.0)
    assert outcome.release_times.max() == pytest.approx(period, rel=1e-9)
    by_time = outcome.gradients[0][base_fields(separation).index("time")]
    by_deformation = by_time[[names.index(f"springs[{i}].deformation") for i in range(4)]].sum()
    by_stiffness = by_time[[names.index(f"springs[{i}].stiffness") for i in range(4)]].sum()
    assert abs(by_deformation) * 0.03 < 1e-8 * period
    assert by_stiffness == pytest.approx(-0.5 * period / 5500.0, rel=1e-7)


@pytest.mark.parametrize("angle", [1e-3, 0.3])
def test_gradients_with_respect_to_a_large_mounting_error(angle):
    """Of the velocity and the rates that springs and an impulse give."""
    separation = symmetric_separation(
        springs=Springs(SQUARE, 0.02, 5500.0, 0.04, 0.03),
        satellite=Body(100.0, [9.35, 8.0, 7.0], [0.01, 0.4, -0.02]),
        mounting_error=angle * np.array([0.8, -0.5, 0.6]),
        impulse=[0.4, 1.1, 0.7],
        angular_impulse=[0.2, -0.3, 0.5],
    )
    nominal, names = separation.parameters(), separation.parameter_names()
    gradients = simulate_with_gradients(separation, tolerance=1e-12).gradients[0][3:12]
    step = 1e-5
    for axis in "xyz":
        column = names.index(f"mounting_error.{axis}")
        change = step * (np.arange(len(nominal)) == column)
        ends = simulate(separation, [nominal + change, nominal - change], tolerance=1e-13).base[:, 3:12]
        expected = (ends[0] - ends[1]) / (2.0 * step)
        np.testing.assert_allclose(gradients[:, column], expected, atol=1e-6 * np.abs(expected).max())


PLANES = [[-1.0, 0.05, 0.0, -0.36], [0.1, 0.02, 0.9, -0.4]]  # two walls near the envelope
GRADIENT_CASES = {
    **{line.name: general_separation(line, rates=np.radians([0.8, -0.5, 0.6])) for line in ForceLine},
    "planes": general_separation(rates=np.radians([0.8, -0.5, 0.6]), recess_planes=PLANES),
    "no cylinder": general_separation(recess_radius=0.0, recess_planes=PLANES),
    **{f"mixed springs {line.name}": general_separation(line, springs=mixed_springs()) for line in ForceLine},
    "recontact": general_separation(recontact=Recontact()),
    "no orbit": general_separation(orbit=None, gradient_torque=False),
}


@pytest.mark.parametrize("case", GRADIENT_CASES)
def test_every_gradient_against_central_differences(case):
    """Every quantity, every parameter: delays, cants, mounting error, clearances and their moving exits, gravity."""
    separation = GRADIENT_CASES[case]
    table = quantity_table(separation)
    nominal, names = separation.parameters(), separation.parameter_names()
    outcome = simulate_with_gradients(separation, tolerance=1e-12)
    assert outcome.status[0] == Status.OK
    scales = {".mass": 1e-2, "inertia": 1e-3, "stiffness": 0.5, "delay": 1e-6, "deformation": 1e-6, "stroke": 1e-6}
    steps = np.array([next((step for key, step in scales.items() if key in name), 1e-5) for name in names])
    # What is 0 and may not have every sign cannot be lowered.
    signs = separation.parameter_signs()
    varied = [i for i, sign in enumerate(signs) if nominal[i] != 0.0 or sign == Sign.ANY]
    rows = np.concatenate([nominal + sign * np.diag(steps)[varied] for sign in (1.0, -1.0)])
    around = simulate(separation, rows, tolerance=1e-13)
    assert (around.status == Status.OK).all()
    for quantity in table:
        values = around.quantity(quantity).reshape(2, -1)
        difference = (values[0] - values[1]) / 2.0
        change = outcome.quantity_gradient(quantity)[0][varied] * steps[varied]
        np.testing.assert_allclose(
            change, difference, rtol=2e-5, atol=1e-7 * np.abs(difference).max(), err_msg=quantity
        )


def test_gradients_come_with_the_same_values():
    separation = general_separation()
    plain, outcome = simulate(separation), simulate_with_gradients(separation)
    np.testing.assert_array_equal(plain.base, outcome.base)
    np.testing.assert_array_equal(plain.release_times, outcome.release_times)


def test_a_failed_run_has_no_gradient():
    separation = symmetric_separation()
    rows = np.tile(separation.parameters(), (2, 1))
    rows[0, 0] = -1.0
    gradient = simulate_with_gradients(separation, rows).quantity_gradient("axial_velocity")
    assert np.isnan(gradient[0]).all()
    assert np.isfinite(gradient[1]).all()


def test_unknown_quantity_is_named():
    with pytest.raises(ValueError, match=r"\['speed'\] is unknown"):
        simulate_with_gradients(symmetric_separation(), quantities=["speed"])


WALL, LEANING = [[-1.0, 0.0, 0.0, -0.52]], [[-1.0, 0.5, 0.0, -0.36]]
DIRECTION_CASES = {
    **{line.name: general_separation(line) for line in ForceLine},
    "large mounting error": general_separation(mounting_error=[2e-3, -0.02, 1e-3]),
    "nearest on the way": general_separation(
        rates=[0.01, 2.0, -0.02], recess_radius=0.0, recess_planes=WALL, recess_depth=0.4
    ),
    "nearest at the start": general_separation(
        recess_radius=0.0, recess_planes=LEANING, impulse=[0.0, 1.0, 0.0], rates=[0.0, 0.0, 0.0]
    ),
    # A planet that weighs as much as ten thousand Earths: its torque counts beside that of the springs.
    "strong gravity": general_separation(
        platform=Body(
            1200.0, [[900.0, 200.0, -150.0], [200.0, 700.0, 100.0], [-150.0, 100.0, 800.0]], [0.0, -1.6, 0.0]
        ),
        satellite=Body(100.0, [[9.0, 2.0, -1.5], [2.0, 8.0, 1.2], [-1.5, 1.2, 7.5]], [0.0, 0.4, 0.0]),
        orbit=Orbit([4.0e6, 3.0e6, -4.7e6], [1.0e4, 5.0e5, 1.4e5], 3e18),
        mounting_error=[1e-3, 0.3, -1e-3],
    ),
    "nearest at the exit": general_separation(rates=np.radians([0.8, -0.5, 0.6])),
}


@pytest.mark.parametrize("case", DIRECTION_CASES)
def test_gradients_in_the_direction_of_a_scatter(case):
    """Every quantity, all parameters at once: few runs, so that the kernels are checked without compilation, too."""
    separation = DIRECTION_CASES[case]
    nominal, names = separation.parameters(), separation.parameter_names()
    size = np.where([name.startswith("mounting") for name in names], 1.0, nominal)
    step = 3e-6 * size * np.random.default_rng(0).uniform(0.5, 1.5, len(nominal))
    outcome = simulate_with_gradients(separation, tolerance=1e-12)
    around = simulate(separation, [nominal + step, nominal - step], tolerance=1e-12)
    assert (around.status == Status.OK).all()
    for quantity, row in quantity_table(separation).items():
        values = around.quantity(quantity)
        change = outcome.quantity_gradient(quantity)[0] @ step
        # Degrees of a direction are a hundred times the velocity's components.
        allowed = 1e-9 if row.unit == "deg" else 1e-11
        assert change == pytest.approx((values[0] - values[1]) / 2.0, rel=1e-4, abs=allowed), quantity
    if case.startswith("nearest"):
        planes = [i for i, name in enumerate(names) if name.startswith("recess_planes")]
        wall = planes[0] if planes else names.index("recess_radius")
        assert abs(outcome.quantity_gradient("clearance")[0, wall]) > 0.1
        # Where the bodies stand at the start does not depend on what pushes them.
        moved = outcome.quantity_gradient("clearance")[0, names.index("impulse.y")] != 0.0
        assert moved == (case != "nearest at the start")
