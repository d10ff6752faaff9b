"""Over random separations: energy, angular momentum, and how the error falls with the tolerance."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from separation_cases import general_separation, symmetric_separation

from satsep_ot.dynamics import simulation
from satsep_ot.dynamics.invariants import angular_momentum, kinetic_energy, spring_strokes, spring_work
from satsep_ot.dynamics.separation import Body, Separation, Springs, Status
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients, trajectory
from satsep_ot.dynamics.springs import ForceLine


def random_body(rng, mass, size):
    """A full tensor that a cloud of eight points has, and a CG a few centimetres off the axis."""
    points = size * rng.standard_normal((8, 3))
    points -= points.mean(axis=0)
    inertia = mass / 8.0 * (np.sum(points**2) * np.eye(3) - points.T @ points)
    return Body(mass, 0.5 * (inertia + inertia.T), [*rng.uniform(-0.03, 0.03, 1), rng.uniform(-1.0, 1.0), 0.01])


def random_separation(seed, force_line):
    """One to eight springs, linear or measured, with cants and delays, on bodies that turn by some deg/s."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 9))
    stroke = rng.uniform(0.02, 0.03, count)
    measured = rng.uniform(size=count) < 0.3
    rows = np.linspace(0.0, 0.03, 5)
    tables = [np.stack([rows, np.sort(rng.uniform(50.0, 400.0, 5))[::-1]], axis=1) if m else None for m in measured]
    springs = Springs(
        angle=rng.uniform(0.0, 2.0 * np.pi, count), radius=rng.uniform(0.1, 0.4),
        stiffness=np.where(measured, 0.0, rng.uniform(3e3, 9e3, count)),
        deformation=np.where(measured, 0.0, rng.uniform(0.02, 0.05, count)),
        stroke=stroke, cant=rng.uniform(-0.02, 0.02, count), delay=rng.choice([0.0, 1e-3, 4e-3], count),
        scale=rng.uniform(0.8, 1.2, count), tables=tables,
    )  # fmt: skip
    return Separation(
        random_body(rng, rng.uniform(50.0, 2000.0), 1.5), random_body(rng, rng.uniform(50.0, 400.0), 0.7), springs,
        force_line, stowed_length=0.05 if force_line == ForceLine.STRUT else 0.0,
        rates=np.radians(rng.uniform(-5.0, 5.0, 3)), mounting_error=1e-3 * rng.standard_normal(3),
        impulse=rng.standard_normal(3), angular_impulse=0.1 * rng.standard_normal(3),
    )  # fmt: skip


@pytest.mark.parametrize("force_line", ForceLine)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None, derandomize=True)
def test_energy_and_angular_momentum(force_line, seed):
    """The kinetic energy gained is the springs' work to 1e-9, the angular momentum stays to 1e-10 of what is exchanged.

    Momentum needs no test: only the relative motion is integrated, with a force and its reaction.
    """
    separation = random_separation(seed, force_line)
    first = trajectory(separation, [], tolerance=1e-12)
    if first.status != Status.OK:
        # A single spring may turn a body so far that another one never comes to its stroke, or pushes through it.
        assert first.status in (Status.NO_RELEASE, Status.PENETRATION)
        return
    times = np.unique([0.0, *separation.springs.delay, *first.release_times])
    states = trajectory(separation, times, tolerance=1e-12).states
    strokes, count = spring_strokes(separation, states), range(len(separation.springs))
    starts, ends = (
        [strokes[np.searchsorted(times, instants[i]), i] for i in count]
        for instants in (separation.springs.delay, first.release_times)
    )
    energy = kinetic_energy(separation, states)
    work = spring_work(separation, starts, ends).sum()
    assert abs(energy[-1] - energy[0] - work) < 1e-9 * (abs(work) + energy[0])
    momentum = angular_momentum(separation, states)
    spin = np.linalg.norm(states[:, 9:12] @ separation.satellite.inertia, axis=1).max()
    assert np.linalg.norm(momentum - momentum[0], axis=1).max() < 1e-10 * (spin + np.linalg.norm(momentum[0]))


@pytest.mark.parametrize("force_line", ForceLine)
def test_the_error_falls_with_the_tolerance_across_releases(force_line):
    """Four starts, four releases, four exits at different instants: from 1e-8 down to 1e-12."""
    separation = general_separation(force_line, orbit=None, gradient_torque=False)
    exact = simulate(separation, tolerance=1e-13).base[0]
    tolerances, blocks = 10.0 ** -np.arange(8.0, 13.0), (slice(3, 6), slice(9, 12), slice(20, 21))
    errors = np.array(
        [
            [np.linalg.norm(base[block] - exact[block]) / np.linalg.norm(exact[block]) for block in blocks]
            for base in (simulate(separation, tolerance=tolerance).base[0] for tolerance in tolerances)
        ]
    )
    assert (errors < 2.0 * tolerances[:, None]).all()
    assert (errors[-1] < np.maximum(1e-2 * errors[0], 1e-13)).all()


def test_the_order_on_smooth_motion():
    """A tumbling satellite flies 30 m: the error falls with the eighth power of the step at least."""
    separation = symmetric_separation(
        satellite=Body(100.0, [9.35, 8.0, 9.0], [0.0, 0.4, 0.0]), rates=[0.4, 1.0, -0.3], envelope=[[0.1, 0.0, 0.05]],
        recess_radius=60.0, recess_depth=30.0, horizon=100.0,
    )  # fmt: skip
    exact = simulate(separation, tolerance=1e-13).quantity("exit_clearance_1")[0]
    # At looser tolerances the steps are held to 0.3 rad instead; at tighter ones rounding is as large, 1e-10 mm.
    outcomes = [simulate(separation, tolerance=tolerance) for tolerance in 10.0 ** -np.arange(9.0, 11.5, 0.5)]
    steps = np.log([outcome.steps[0] for outcome in outcomes])
    errors = np.log([abs(outcome.quantity("exit_clearance_1")[0] - exact) for outcome in outcomes])
    assert -10.0 < np.polyfit(steps, errors, 1)[0] < -8.0


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_a_run_depends_neither_on_its_batch_nor_on_threads(monkeypatch, threads):
    separation = general_separation(orbit=None, gradient_torque=False)
    rng = np.random.default_rng(2)
    rows = separation.parameters() * (1.0 + 1e-3 * rng.standard_normal((2200, separation.parameters().size)))
    single = simulate(separation, rows[1500])
    monkeypatch.setattr(simulation.numba, "get_num_threads", lambda: threads)
    outcome = simulate(separation, rows)
    np.testing.assert_array_equal(outcome.base[1500], single.base[0])
    np.testing.assert_array_equal(simulate(separation, rows[::-1]).base[::-1], outcome.base)
    gradients = simulate_with_gradients(separation, rows[:150], ["axial_velocity", "clearance"])
    np.testing.assert_array_equal(gradients.base, outcome.base[:150])
    alone = simulate_with_gradients(separation, rows[100], ["axial_velocity", "clearance"])
    np.testing.assert_array_equal(gradients.gradients[100], alone.gradients[0])


@pytest.mark.parametrize("force_line", ForceLine)
def test_a_dense_trajectory_is_that_of_runs_to_each_time(force_line):
    separation = general_separation(force_line)
    times = np.linspace(0.0, 0.6, 61)
    path = trajectory(separation, times, tolerance=1e-12)
    for i in (0, 3, 8, 9, 30, 60):
        alone = trajectory(separation, times[i : i + 1], tolerance=1e-12)
        np.testing.assert_allclose(path.states[i], alone.states[0], rtol=0, atol=1e-11)
        np.testing.assert_array_equal(path.last_release, alone.last_release)
