import re
import time
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from separation_cases import (
    BOX,
    SQUARE,
    TRUTH_CASES,
    general_separation,
    mixed_springs,
    symmetric_separation,
    truth_separation,
)

from satsep_ot.dynamics import simulation
from satsep_ot.dynamics.kernels import records
from satsep_ot.dynamics.relative_orbit import Recontact
from satsep_ot.dynamics.rotations import quaternion_product, rotation_matrix
from satsep_ot.dynamics.separation import Body, ForceLine, Separation, Springs, Status
from satsep_ot.dynamics.simulation import inertial_motion, simulate, simulate_with_gradients, trajectory
from satsep_ot.dynamics.springs import ForceLaw


def relative_error(value, truth, floor=1e-3):
    value, truth = np.asarray(value), np.asarray(truth)
    return np.linalg.norm(value - truth) / max(np.linalg.norm(truth), floor)


def quaternion_error(value, truth):
    return min(np.linalg.norm(value - np.asarray(truth)), np.linalg.norm(value + np.asarray(truth)))


@pytest.mark.parametrize("tolerance", [1e-8, 1e-12])
@pytest.mark.parametrize("force_line", ["guided", "strut"])
@pytest.mark.parametrize("case", TRUTH_CASES)
def test_truth(case, force_line, tolerance):
    """128-bit reference solutions: at the last release and half a second after the start."""
    truth = TRUTH_CASES[case]["results"][force_line]
    path = trajectory(truth_separation(case, force_line), [0.5], tolerance=tolerance)
    limit = {1e-8: 1e-8, 1e-12: 1e-11}[tolerance]
    for state, expected in ((path.last_release, truth["at_last_release"]), (path.states[0], truth["at_t_end"])):
        velocity, position = inertial_motion(state[None])
        assert relative_error(state[3:6], expected["dv_platform"]) < limit
        assert relative_error(velocity[0], expected["dv_inertial"]) < limit
        assert relative_error(position[0], expected["dr_inertial"]) < limit
        assert relative_error(state[6:9], expected["w_plat"]) < limit
        assert relative_error(state[9:12], expected["w_sat"]) < limit
        assert quaternion_error(state[16:20], expected["q_plat"]) < limit
        assert quaternion_error(quaternion_product(state[16:20], state[12:16]), expected["q_sat"]) < limit
    np.testing.assert_allclose(path.release_times, truth["t_release"], rtol=limit)


@pytest.mark.parametrize("force_line", ForceLine)
def test_axial_push_has_a_closed_form(force_line):
    """v = sqrt(2 E / mu_r), t = arccos(1 - L / xi) / Omega: 16.5 J, 0.597913 m/s, 85.381 ms."""
    stowed = 0.04 if force_line == ForceLine.STRUT else 0.0
    separation = symmetric_separation(force_line=force_line, stowed_length=stowed)
    outcome = simulate(separation)
    inverse_mass = 1.0 / 1200.0 + 1.0 / 100.0
    energy = 4.0 * 5500.0 * 0.03 * (0.04 - 0.015)
    assert energy == pytest.approx(16.5)
    velocity, time = np.sqrt(2.0 * energy * inverse_mass), np.arccos(0.25) / np.sqrt(22000.0 * inverse_mass)
    assert (velocity, time) == pytest.approx((0.597913, 0.085381), rel=1e-5)
    assert outcome.quantity("axial_velocity")[0] == pytest.approx(velocity, rel=1e-8)
    np.testing.assert_allclose(outcome.release_times[0], time, rtol=1e-8)


def test_symmetric_push_does_not_turn_the_bodies():
    base = simulate(symmetric_separation()).base[0]
    assert np.abs(base[6:12]).max() < 1e-12


def angular_momentum(separation, state):
    """Total angular momentum about the common CG, in inertial axes."""
    platform, satellite = separation.platform, separation.satellite
    reduced = platform.mass * satellite.mass / (platform.mass + satellite.mass)
    turn, relative = rotation_matrix(state[16:20]), rotation_matrix(state[12:16])
    spin = platform.inertia @ state[6:9] + relative @ satellite.inertia @ state[9:12]
    return turn @ (spin + reduced * np.cross(state[0:3], state[3:6]))


def kinetic_energy(separation, state):
    """Energy of the relative motion and of both rotations."""
    platform, satellite = separation.platform, separation.satellite
    reduced = platform.mass * satellite.mass / (platform.mass + satellite.mass)
    rotation = state[6:9] @ platform.inertia @ state[6:9] + state[9:12] @ satellite.inertia @ state[9:12]
    return 0.5 * (reduced * state[3:6] @ state[3:6] + rotation)


@pytest.mark.parametrize("force_line", ForceLine)
def test_angular_momentum_and_energy(force_line):
    """Without gravity: H is constant, and the kinetic energy gained is the work of the springs."""
    # A spring that waits starts from where the others have moved its seats, a mounting error shifts them: neither here.
    springs = replace(general_separation().springs, delay=0.0)
    separation = general_separation(
        force_line,
        orbit=None,
        gradient_torque=False,
        springs=springs,
        mounting_error=[0.0, 0.0, 0.0],
        guide_friction=0.0,
    )
    path = trajectory(separation, [0.0, 0.04, 0.3], tolerance=1e-12)
    momenta = [angular_momentum(separation, state) for state in path.states]
    for momentum in momenta[1:]:
        np.testing.assert_allclose(momentum, momenta[0], rtol=0, atol=1e-10 * np.linalg.norm(momenta[0]))
    work = np.sum(springs.stiffness * springs.stroke * (springs.deformation - 0.5 * springs.stroke))
    gain = kinetic_energy(separation, path.states[-1]) - kinetic_energy(separation, path.states[0])
    assert gain == pytest.approx(work, rel=1e-9)


def test_a_run_does_not_depend_on_its_batch():
    separation = general_separation()
    rng = np.random.default_rng(1)
    rows = separation.parameters() * (1.0 + 1e-3 * rng.standard_normal((300, separation.parameters().size)))
    together = simulate(separation, rows)
    assert (together.status == Status.OK).all()
    for row in (0, 63, 64, 299):
        np.testing.assert_array_equal(simulate(separation, rows[row]).base[0], together.base[row])


def test_a_gradient_does_not_depend_on_the_runs_before_it_in_the_same_memory():
    separation = general_separation(springs=mixed_springs())
    rng = np.random.default_rng(2)
    rows = separation.parameters() * (1.0 + 1e-3 * rng.standard_normal((150, separation.parameters().size)))
    rows[60:70, 0] = -1.0  # runs that leave the memory as it was
    together = simulate_with_gradients(separation, rows)
    for row in (0, 63, 64, 127, 128, 149):
        alone = simulate_with_gradients(separation, rows[row])
        np.testing.assert_array_equal(alone.gradients[0], together.gradients[row])


@pytest.mark.parametrize(
    ("dtype", "number"), [(records.CHAIN_ADJOINT, 1), (records.SPRING_ADJOINT, 5)], ids=["chain", "springs"]
)
def test_no_row_of_lanes_lies_across_two_cache_lines(dtype, number):
    """A sweep would take a tenth more time."""
    array = records.aligned_records(number, dtype)
    assert array.dtype == dtype
    assert array.shape == (number,)
    assert array[number - 1 :].ctypes.data % records.CACHE_LINE == 0
    with_lanes = set(dtype.names) - {"row", "column"}
    assert all(dtype.fields[name][1] % records.CACHE_LINE == 0 for name in with_lanes)


def test_a_spring_never_pulls():
    """With a stroke above the deformation it is released where its force is zero."""
    short, long = (
        simulate(symmetric_separation(springs=Springs(SQUARE, 0.3, 5500.0, 0.04, stroke))).quantity("axial_velocity")
        for stroke in (0.04, 0.07)
    )
    np.testing.assert_allclose(long, short, rtol=1e-12)


def test_delay_of_all_springs_shifts_everything():
    late = symmetric_separation(springs=Springs(SQUARE, 0.3, 5500.0, 0.04, 0.03, delay=0.25))
    outcome, reference = simulate(late), simulate(symmetric_separation())
    np.testing.assert_allclose(outcome.release_times, reference.release_times + 0.25, rtol=1e-8)
    np.testing.assert_allclose(outcome.base[0, 3:12], reference.base[0, 3:12], atol=1e-9)


@pytest.mark.parametrize("delays", [(1.001e-3, 1e-3, 1e-3, 1e-3), (1e-4, 0.0, 0.0, 0.0), (1e-12, 0.0, 1e-15, 0.0)])
def test_releases_that_nearly_coincide(delays):
    outcome = simulate(symmetric_separation(springs=Springs(SQUARE, 0.3, 5500.0, 0.04, 0.03, delay=delays)))
    assert outcome.status[0] == Status.OK
    shifted = simulate(symmetric_separation()).release_times[0] + np.mean(delays)
    np.testing.assert_allclose(outcome.release_times[0], shifted, atol=5e-5)


def test_equal_cants_spin_up_the_satellite():
    """Guides tilted towards increasing angle push the satellite that way, a turn about -y, and the stage about +y."""
    cant = np.radians(0.3)
    base = simulate(symmetric_separation(springs=Springs(SQUARE, 0.3, 5500.0, 0.04, 0.03, cant))).base[0]
    # Impulse of the axial push times tan(cant) on the arm R, about the satellite's axis.
    impulse = base[4] / (1.0 / 1200.0 + 1.0 / 100.0)
    assert base[10] == pytest.approx(-impulse * np.tan(cant) * 0.3 / 8.0, rel=1e-3)
    assert base[7] == pytest.approx(impulse * np.tan(cant) * 0.3 / 600.0, rel=1e-2)


def reference_clearance(separation, times):
    """Smallest clearance over a fine grid of states, with the simplest code that does it."""
    points, platform_cg = separation.envelope, separation.platform.center_of_mass
    inside = (points[:, 1] >= 0.0) & (points[:, 1] < separation.recess_depth)
    smallest = np.inf
    for state in trajectory(separation, times, tolerance=1e-12).states:
        turn = rotation_matrix(state[12:16])
        place = platform_cg + state[0:3] + (points[inside] - separation.satellite.center_of_mass) @ turn.T
        here = place[place[:, 1] < separation.recess_depth]
        if len(here):
            smallest = min(smallest, (separation.recess_radius - np.hypot(here[:, 0], here[:, 2])).min())
    return 1e3 * smallest


@pytest.mark.parametrize("rates", [(0.2, -0.3, 0.15), (3.0, 5.0, -4.0), (0.0, 40.0, 0.0)])
def test_clearance_against_a_fine_grid(rates):
    separation = general_separation(rates=np.radians(rates))
    clearance = simulate(separation).quantity("clearance")[0]
    grid = reference_clearance(separation, np.linspace(0.0, 0.6, 20001))
    assert clearance == pytest.approx(grid, abs=2e-3)  # the grid misses the exit by up to 30 us at 0.05 m/s
    assert clearance <= grid + 1e-4


def test_clearance_inside_the_stay_is_located():
    """A satellite whose corner swings out and back: the minimum is neither at the start nor at the exit."""
    separation = symmetric_separation(
        satellite=Body(100.0, [9.35, 8.0, 9.35], [0.02, 0.4, 0.0]),
        mounting_error=[0.0, 0.3, 0.0],
        envelope=[[0.45, 0.0, 0.0]],
        recess_radius=0.52,
        recess_depth=0.25,
        rates=[0.0, 0.0, np.radians(-6.0)],
    )
    outcome = simulate(separation)
    smallest, at_exit = outcome.quantity("clearance")[0], outcome.quantity("exit_clearance_1")[0]
    times = np.linspace(0.0, outcome.release_times.max() + 1.0, 40001)
    assert smallest == pytest.approx(reference_clearance(separation, times), abs=2e-3)
    assert smallest <= at_exit


def test_a_centred_satellite_keeps_its_clearance():
    outcome = simulate(symmetric_separation(envelope=BOX, recess_radius=0.52, recess_depth=0.25))
    nominal = 1e3 * (0.52 - 0.35 * np.sqrt(2.0))
    assert outcome.quantity("clearance")[0] == pytest.approx(nominal, abs=1e-9)
    for i in range(1, 5):
        assert outcome.quantity(f"exit_clearance_{i}")[0] == pytest.approx(nominal, abs=1e-6)


def test_each_way_to_fail_has_its_status():
    separation = symmetric_separation(envelope=BOX, recess_radius=0.52, recess_depth=0.25, horizon=0.3)
    outcome = simulate(separation)
    assert outcome.status[0] == Status.NO_EXIT
    assert np.isnan(outcome.base).all()
    assert "did not leave the recess" in outcome.explain(0)
    assert simulate(symmetric_separation(horizon=0.05)).status[0] == Status.NO_RELEASE
    names = separation.parameter_names()
    rows = np.tile(separation.parameters(), (4, 1))
    rows[1, names.index("satellite.mass")] = -1.0
    rows[2, names.index("satellite.inertia.yy")] = 30.0
    rows[3, names.index("springs[2].delay")] = np.nan
    outcome = simulate(symmetric_separation(envelope=BOX, recess_radius=0.52, recess_depth=0.25), rows)
    assert outcome.status.tolist() == [Status.OK, *[Status.INVALID_PARAMETERS] * 3]
    assert outcome.explain(1) == "satellite.mass = -1.0; it must be positive"
    assert "triangle" in outcome.explain(2)
    assert "springs[2].delay = nan" in outcome.explain(3)


@pytest.mark.parametrize("rates", [(1e6, 0.0, 1e6), (0.0, 1e9, 0.0), (1e29, 1e29, 1e29)])
def test_absurd_rates_end_in_bounded_steps(rates):
    """Finite numbers or a status: never a hang, never a NaN that looks like a number."""
    outcome = simulate(symmetric_separation(rates=np.radians(rates)))
    assert np.isfinite(outcome.base[0, :21]).all() == (outcome.status[0] == Status.OK)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"force_line": ForceLine.STRUT}, "stowed_length = 0.0; it must be positive"),
        ({"stowed_length": 0.04}, "only struts have a stowed length"),
        ({"attitude": [0.0, 0.0, 0.0, 0.0]}, "a quaternion of norm above 0"),
        ({"rates": [0.0, np.inf, 0.0]}, "rates.y = inf"),
        ({"gradient_torque": True}, "without an orbit"),
        ({"envelope": [[0.0, 1.0, 0.0]], "recess_radius": 0.5, "recess_depth": 0.25}, "no point lies in the recess"),
        ({"horizon": -1.0}, "horizon = -1.0 s"),
        ({"rates": [0.0, 1.0]}, "rates = [0.0, 1.0]; it must be 3 numbers"),
        ({"attitude": [1.0, 0.0, 0.0]}, "attitude = [1.0, 0.0, 0.0]; it must be 4 numbers"),
        ({"recontact": Recontact()}, "recontact is asked for without an orbit"),
    ],
)
def test_what_is_not_allowed_is_named(changes, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        symmetric_separation(**changes)


def test_arguments_of_simulate_are_checked():
    separation = symmetric_separation()
    with pytest.raises(ValueError, match=r"parameters has shape \(1, 3\)"):
        simulate(separation, [1.0, 2.0, 3.0])
    with pytest.raises(ValueError, match=r"tolerance = 0\.5"):
        simulate(separation, tolerance=0.5)
    with pytest.raises(ValueError, match="ascending"):
        trajectory(separation, [0.2, 0.1])
    with pytest.raises(ValueError, match="inertia"):
        Body(1.0, [1.0, 2.0])
    with pytest.raises(ValueError, match=r"springs.stroke has shape \(2,\)"):
        Springs(SQUARE, 0.3, 5500.0, 0.04, [0.03, 0.03])
    with pytest.raises(ValueError, match="springs"):
        Separation(Body(1.0, [1.0, 1.0, 1.0]), Body(1.0, [1.0, 1.0, 1.0]), Springs([], 0.3, 1.0, 1.0, 1.0))


def test_tables_and_laws_that_do_not_fit_the_springs_are_named():
    table = [[0.0, 200.0], [0.03, 100.0]]
    with pytest.raises(
        ValueError, match=r"springs\.tables has 3 entries; it must have one \(or None\) for each of 4 springs"
    ):
        Springs(SQUARE, 0.3, 0.0, 0.0, 0.03, tables=[table] * 3)
    with pytest.raises(
        ValueError, match=r"springs\.laws = .*they must be one for each spring, and one with a table where"
    ):
        Springs(SQUARE, 0.3, 5500.0, 0.04, 0.03, laws=[ForceLaw.TABLE] * 4)
    # A spring with a table has no stiffness of its own.
    with pytest.raises(ValueError, match=r"springs\[1\]\.stiffness = 5500.0; it must be 0, since another law"):
        symmetric_separation(springs=Springs(SQUARE, 0.3, [0.0, 5500.0, 0.0, 0.0], 0.0, 0.03, tables=[table] * 4))


def tumbling(count):
    """A small cube that one spring pushes off its centre: its points turn back on their way out of a deep recess."""
    half, height = 0.05, 0.1135
    separation = Separation(
        Body(5.96, [0.063, 0.01, 0.063], [-0.00086, -0.17025, -0.00008]),
        Body(2.01, [0.00377, 0.00325, 0.00393], [0.0056, 0.05675, 0.0035]),
        Springs([np.pi / 4.0], 0.034, 880.0, 0.0047, 0.00407),
        envelope=[[a * half, y, b * half] for a in (-1, 1) for b in (-1, 1) for y in (0.0, height)],
        recess_radius=0.085,
        horizon=20.0,
        recess_depth=0.25,
    )
    generator = np.random.default_rng(0)
    rows, names = np.repeat(separation.parameters()[None], count, axis=0), separation.parameter_names()
    rows *= 1.0 + 0.02 * generator.standard_normal(rows.shape)
    for axis in "xyz":
        rows[:, names.index(f"rates.{axis}")] = np.radians(2.0) * generator.standard_normal(count)
        rows[:, names.index(f"satellite.center_of_mass.{axis}")] += 0.003 * generator.standard_normal(count)
    return separation, rows


def test_points_that_turn_back_on_their_way_out_leave_where_they_first_do():
    """Against states on a fine grid of times, and their positions without the code of the package."""
    separation, rows = tumbling(20)
    outcome = simulate(separation, rows)
    points, times, names = separation.envelope, np.arange(0.0, 8.0, 2e-4), separation.parameter_names()
    inside = np.flatnonzero((points[:, 1] >= 0.0) & (points[:, 1] < separation.recess_depth))
    turning = 0
    for row, parameters in enumerate(rows):
        named = dict(zip(names, parameters, strict=True))
        mass_centres = [
            [named[f"{body}.center_of_mass.{axis}"] for axis in "xyz"] for body in ("platform", "satellite")
        ]
        states = trajectory(separation, times, parameters).states
        turns = Rotation.from_quat(states[:, [13, 14, 15, 12]]).as_matrix()
        arms = points[inside] - mass_centres[1]
        place = states[:, None, :3] + np.einsum("tij,pj->tpi", turns, arms) + mass_centres[0]
        out = place[:, :, 1] >= named["recess_depth"]
        room = named["recess_radius"] - np.hypot(place[:, :, 0], place[:, :, 2])
        first = out.argmax(axis=0)
        assert out.any(axis=0).all()
        for point, last in enumerate(first):
            turning += (np.diff(place[: last + 1, point, 1]) < 0.0).any() or not out[last:, point].all()
            # Between two instants of the grid.
            low, high = sorted(room[last - 1 : last + 1, point])
            assert low - 1e-6 < 1e-3 * outcome.quantity(f"exit_clearance_{point + 1}")[row] < high + 1e-6
        smallest = min(room[: last + 1, point].min() for point, last in enumerate(first))
        assert 1e-3 * outcome.quantity("clearance")[row] == pytest.approx(smallest, abs=2e-4)
    assert turning > 20


def test_clearances_of_tumbling_bodies_are_as_exact_as_asked_for():
    separation, rows = tumbling(2000)
    exact = simulate(separation, rows, tolerance=1e-12)
    assert np.mean(exact.status == Status.OK) > 0.99
    for tolerance in (1e-6, 1e-8, 1e-10):
        outcome = simulate(separation, rows, tolerance=tolerance)
        np.testing.assert_array_equal(outcome.status, exact.status)
        np.testing.assert_allclose(outcome.base[:, 21:], exact.base[:, 21:], rtol=0.0, atol=100.0 * tolerance)


def test_an_error_in_a_thread_ends_the_batch(monkeypatch):
    monkeypatch.setattr(simulation.numba, "get_num_threads", lambda: 2)
    done = []

    def job(first, end):
        if first == 20:
            raise MemoryError("no room for a tape")
        time.sleep(0.01)
        done.append(end - first)

    simulation._in_threads(15, 10, job)
    assert sorted(done) == [5, 10]
    with pytest.raises(MemoryError, match="no room for a tape"):
        simulation._in_threads(1000, 10, job)
    assert len(done) < 50


def test_the_tolerance_is_1e_8_where_none_is_given():
    separation = general_separation()
    times = [0.05, 0.2]
    for run in (
        lambda **tolerance: simulate(separation, **tolerance).base,
        lambda **tolerance: simulate_with_gradients(separation, **tolerance).gradients,
        lambda **tolerance: trajectory(separation, times, **tolerance).states,
    ):
        np.testing.assert_array_equal(run(), run(tolerance=1e-8))
        assert not np.array_equal(run(), run(tolerance=2e-8))
