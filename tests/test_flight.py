"""What a run costs and how exact it is for that: steps and errors over a scatter of all parameters."""

import numpy as np
import pytest
from separation_cases import general_separation, mixed_springs

from satsep_ot.dynamics.separation import Body, ForceLine, Status
from satsep_ot.dynamics.simulation import simulate


def scattered(separation, count):
    """Every parameter by one per cent of its value."""
    nominal = separation.parameters()
    return nominal * (1.0 + 0.01 * np.random.default_rng(0).standard_normal((count, len(nominal))))


SEPARATIONS = {
    **{line.name: general_separation(line) for line in ForceLine},
    "mixed springs": general_separation(springs=mixed_springs()),
}
# Steps of 8 runs at a tolerance of 1e-8, and of 200 at 1e-5, 1e-8 and 1e-11.
STEPS = {
    "GUIDED": (100, 1826, 2516, 3086),
    "STRUT": (104, 1911, 2609, 3576),
    "NORMAL": (104, 1812, 2619, 3259),
    "mixed springs": (191, 4078, 4943, 5480),
}


@pytest.mark.parametrize("name", SEPARATIONS)
def test_a_few_runs_take_the_steps_that_they_took(name):
    outcome = simulate(SEPARATIONS[name], scattered(SEPARATIONS[name], 8))
    assert (outcome.status == Status.OK).all()
    assert outcome.steps.sum() == STEPS[name][0]


@pytest.mark.parametrize("name", SEPARATIONS)
def test_runs_take_the_steps_that_they_took(name):
    """More of them are slower, fewer of them less exact: whoever changes the numbers looks at speed and error."""
    rows = scattered(SEPARATIONS[name], 200)
    steps = [simulate(SEPARATIONS[name], rows, tolerance=tolerance).steps.sum() for tolerance in (1e-5, 1e-8, 1e-11)]
    # Rounding on another processor may decide for one step more or less.
    np.testing.assert_allclose(steps, STEPS[name][1:], atol=3)


# In units of the tolerance: struts turn fast, and friction bends where a seat changes its direction.
ERRORS = {"GUIDED": 0.5, "STRUT": 10.0, "NORMAL": 100.0, "mixed springs": 0.5}


@pytest.mark.parametrize("name", SEPARATIONS)
@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8, 1e-10])
def test_the_error_of_a_run_is_of_the_size_of_its_tolerance(name, tolerance):
    rows = scattered(SEPARATIONS[name], 200)
    exact = simulate(SEPARATIONS[name], rows, tolerance=1e-13)
    error = np.abs(simulate(SEPARATIONS[name], rows, tolerance=tolerance).base - exact.base).max(axis=0)
    # Distances in m, velocities of 0.6 m/s, rates of 0.01 rad/s, quaternions, a time of 0.1 s, clearances in m.
    size = np.repeat([1.0, 0.6, 0.01, 1.0, 0.1, 1.0], [3, 3, 6, 8, 1, len(error) - 21])
    assert (error / size).max() < ERRORS[name] * tolerance


def test_a_run_whose_parameters_are_barely_physical_flies_and_one_beyond_does_not():
    separation = general_separation()
    names = separation.parameter_names()
    nominal = separation.parameters()

    def status(**changes):
        row = nominal.copy()
        for name, value in changes.items():
            row[names.index(name.replace("__", "."))] = value
        return Status(simulate(separation, row[None]).status[0])

    def inertia(body, xx, yy, zz, xy=0.0, xz=0.0, yz=0.0):
        axes = {"xx": xx, "yy": yy, "zz": zz, "xy": xy, "xz": xz, "yz": yz}
        return {f"{body}__inertia__{axis}": value for axis, value in axes.items()}

    for body in ("platform", "satellite"):
        # A plate has the sum of two moments for the third one; more no body has.
        for order in ((50.0, 30.0, 20.0), (20.0, 50.0, 30.0), (30.0, 20.0, 50.0)):
            assert status(**inertia(body, *order)) == Status.OK
            assert status(**inertia(body, *(value * 1.001 if value == 50.0 else value for value in order))) == (
                Status.INVALID_PARAMETERS
            )
        # Products of inertia as large as they can be: a rod along the diagonal of two axes, with a ball on it.
        for axis in ("xy", "xz", "yz"):
            third = {"xy": (30.0, 30.0, 40.0), "xz": (30.0, 40.0, 30.0), "yz": (40.0, 30.0, 30.0)}[axis]
            for sign in (1.0, -1.0):
                assert status(**inertia(body, *third, **{axis: sign * 19.9})) == Status.OK
                assert status(**inertia(body, *third, **{axis: sign * 20.1})) == Status.INVALID_PARAMETERS
        assert status(**{f"{body}__mass": 0.0}) == Status.INVALID_PARAMETERS


def test_a_body_that_is_a_plate_is_allowed_and_one_beyond_is_named():
    for largest in range(3):
        moments = np.roll([50.0, 30.0, 20.0], largest)
        plate = general_separation(platform=Body(1200.0, moments, [0.0, -1.6, 0.0]))
        assert simulate(plate).status[0] == Status.OK
        with pytest.raises(ValueError, match=r"platform\.inertia has the principal moments .*triangle inequality"):
            simulate(general_separation(platform=Body(1200.0, moments * np.where(moments == 50.0, 1.001, 1.0))))
