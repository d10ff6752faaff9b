"""Contact, late bolts, pins and rails against the truth set, its gradients and closed forms."""

import numpy as np
import pytest
from contact_cases import CONTACT_CASES, CONTACT_TRUTH, contact_separation
from contact_reference import fresh_case, solve
from scipy.integrate import solve_ivp
from separation_cases import SQUARE, symmetric_separation

from satsep_ot.dynamics import simulation
from satsep_ot.dynamics.contact import Contact, HoldDowns, Rails
from satsep_ot.dynamics.kernels import contact_setup
from satsep_ot.dynamics.parameter_vector import Sign
from satsep_ot.dynamics.quantities import CONTACT_QUANTITIES, QUANTITIES, scaled
from satsep_ot.dynamics.separation import Body, Separation, Springs, Status
from satsep_ot.dynamics.simulation import contact_events, simulate, simulate_with_gradients, trajectory
from satsep_ot.dynamics.springs import ForceLaw
from satsep_ot.model.case import load_case
from satsep_ot.model.inputs import ParameterMap

RATTLING = [name for name in CONTACT_CASES if name.startswith("rails")]


def error(state, truth):
    """Of velocity and rates, with floors of 0.1 m/s and 0.1 rad/s."""
    return max(
        np.linalg.norm(state[3:6] - truth["dv_platform"]) / max(0.1, np.linalg.norm(truth["dv_platform"])),
        np.linalg.norm(state[9:12] - truth["w_sat"]) / max(0.1, np.linalg.norm(truth["w_sat"])),
    )


@pytest.mark.parametrize("name", CONTACT_CASES)
@pytest.mark.parametrize(("tolerance", "allowed"), [(1e-8, 1e-6), (1e-13, 1e-8)])
def test_truth(name, tolerance, allowed):
    """States at the end and at the last release; rails that rattle multiply errors with each bounce."""
    case, separation = CONTACT_CASES[name], contact_separation(name)
    results, last = case["results"], case["results"]["at_last_release"]
    stops = sorted({case["t_end"], *([last["t"]] if last else [])})
    path = trajectory(separation, stops, tolerance=tolerance)
    allowed = 1e-3 if name in RATTLING else allowed
    assert error(path.states[stops.index(case["t_end"])], results["at_t_end"]) < allowed
    if last:
        assert error(path.states[stops.index(last["t"])], last) < max(allowed, 1e-7)
        for mine, time in zip(path.release_times, results["t_release"], strict=False):
            assert (time is None) == (not mine <= case["t_end"])
            assert time is None or mine == pytest.approx(time, abs=1e-6 if name in RATTLING else 3e-9)
    assert path.status == (Status.STUCK if results["status"] == "stuck" else Status.OK)


@pytest.mark.parametrize("name", [name for name in CONTACT_CASES if name.endswith("elastic")])
def test_contacts_without_damping_take_shorter_steps(name):
    """Nothing damps what a step errs: at the default tolerance the error is a tenth of that of other contacts."""
    case = CONTACT_CASES[name]
    (state,) = trajectory(contact_separation(name), [case["t_end"]]).states
    assert error(state, case["results"]["at_t_end"]) < 1e-7


@pytest.mark.parametrize("name", CONTACT_CASES)
def test_events_come_in_the_same_order(name):
    """Those of contacts, but what is left of a gap that is still negative, which the truth set does not list."""
    case, separation = CONTACT_CASES[name], contact_separation(name)
    truth = [
        (entry[1], entry[2]) for entry in case["results"]["events"] if entry[2] in ("engage", "let go") and entry[0] > 0
    ]
    events = contact_events(separation, tolerance=1e-11)
    mine = [(event.name, event.what) for event in events if event.what in ("engages", "lets go")]
    mine = [(name, {"engages": "engage", "lets go": "let go"}[what]) for name, what in mine][: len(truth)]
    # At the same instant, within its rounding, symmetric points come in any order.
    times = [entry[0] for entry in case["results"]["events"] if entry[2] in ("engage", "let go") and entry[0] > 0]
    groups = np.cumsum([0, *(np.diff(times) > 1e-7)]) if times else []

    def by_group(pairs):
        return [sorted(pair for pair, g in zip(pairs, groups, strict=True) if g == k) for k in set(groups)]

    names = [name.replace("cyl", "recess") for name, _ in mine]
    assert len(names) == len(truth)
    assert by_group(mine) == by_group(truth)


def parameter(separation, name):
    """The parameter that an input of the truth set's gradients is."""
    first, *_, last = name.split(".")
    plain = {"k": "stiffness", "mu": "friction", "force": "scale", "engagement": "stroke", "k_t": "stiffness"}
    if name.startswith("satellite.cg"):
        return f"satellite.center_of_mass.{'xyz'[int(last)]}"
    if name == "contact.recess.radius":
        return "recess_radius"
    if first == "springs":
        what, which = name.split(".")[1:]
        return f"springs[{which}].{ {'K': 'stiffness'}.get(what, what) }"
    if first == "pins":
        return f"springs[{len(separation.springs) - 1}].{plain[last]}"
    if first == "hold_down":
        return f"hold_downs[{name.split('.')[1]}].{plain.get(last, last)}"
    if first == "contact":
        return f"{'rails' if '.rails.' in name else 'contact'}.{plain.get(last, last)}"
    return name


def free_flight(separation, state, time):
    """Velocity and rates after a flight without forces."""
    platform, satellite = separation.platform.inertia, separation.satellite.inertia

    def slope(_, y):
        w, omega_1, omega_2 = y[:3], y[3:6], y[6:]
        turns = (np.linalg.solve(J, -np.cross(o, J @ o)) for J, o in ((platform, omega_1), (satellite, omega_2)))
        return np.concatenate([-np.cross(omega_1, w), *turns])

    return solve_ivp(slope, (0.0, time), state, rtol=1e-12, atol=1e-14).y[:, -1]


@pytest.mark.parametrize("name", CONTACT_TRUTH["gradients"])
def test_truth_gradients(name, monkeypatch):
    """At the end, to which the bodies fly without forces from the instant that the quantities are taken at."""
    for axis in "xyz":
        monkeypatch.setitem(QUANTITIES, f"stage_{axis}", scaled("rad/s", "of the stage", f"omega_1_{axis}"))
        monkeypatch.setitem(QUANTITIES, f"w_{axis}", scaled("m/s", "velocity", f"w_{axis}"))
    case, separation = CONTACT_CASES[name], contact_separation(name)
    outcome = simulate_with_gradients(separation, tolerance=1e-11)
    end = case["t_end"] - outcome.base[0, 20]
    start, jacobian = outcome.base[0, 3:12], outcome.gradients[0]
    step, names = 1e-6, separation.parameter_names()
    transition = np.stack(
        [
            (free_flight(separation, start + change, end) - free_flight(separation, start - change, end)) / (2.0 * step)
            for change in step * np.eye(9)
        ],
        axis=1,
    )
    slope = (free_flight(separation, start, end + step) - free_flight(separation, start, end - step)) / (2.0 * step)
    for which, truth in CONTACT_TRUTH["gradients"][name].items():
        column = jacobian[:, names.index(parameter(separation, which))]
        found = transition @ column[3:12] - slope * column[20]
        expected = np.concatenate([truth["d_dv_platform"], truth["d_w_sat"]])
        difference = np.concatenate([found[:3], found[6:]]) - expected
        assert np.linalg.norm(difference) < 1e-4 * np.linalg.norm(expected), which


GRADIENT_CASES = {
    "late bolts": symmetric_separation(
        contact=Contact(0.31, points=12),
        hold_downs=HoldDowns([0.2, 2.0], [0.3, 0.31], [4e-3, 6e-3], damping_time=1e-4),
    ),
    "mounting error": symmetric_separation(
        satellite=Body(100.0, [4.0, 6.0, 4.0], [0.003, 0.1, -0.002]),
        springs=Springs(SQUARE, 0.35, 5500.0, 0.04, 0.03, scale=[0.0, 0.0, 1.0, 1.02]),
        mounting_error=[1e-3, 0.0, -2e-3],
        contact=Contact(0.36, points=[[0.36, 0.0, 0.1], [-0.2, 0.0, 0.3], [0.1, 0.0, 0.36], [0.3, 0.0, -0.2]]),
    ),
    "rails": symmetric_separation(
        satellite=Body(4.0, [0.04, 0.0075, 0.04], [0.004, 0.17, -0.003]),
        springs=Springs([0.0], 0.004, 30.0, 0.6, 0.34),
        rails=Rails(0.05, 1e-3, (0.0, 0.34), 0.36, stiffness=1e4, friction=0.15),
    ),
    "walls": symmetric_separation(
        satellite=Body(100.0, [9.35, 8.0, 9.35], [0.03, 0.4, 0.0]),
        springs=Springs(SQUARE, 0.3, 5500.0, 0.04, [0.03, 0.0301, 0.0298, 0.0304]),
        contact=Contact(0.3, walls=True, stiffness=1e5, points=0),
        envelope=[[0.34, 0.02, 0.34], [0.34, 0.02, -0.34], [-0.34, 0.02, 0.34], [-0.34, 0.02, -0.34]],
        recess_planes=[[-1.0, 0.0, 0.0, -0.342], [1.0, 0.0, 0.0, -0.342]], recess_depth=0.25,
    ),
    "pins": symmetric_separation(
        springs=Springs(
            SQUARE, 0.3, 5500.0, 0.04, [0.03, 0.0301, 0.0298, 0.0304], cant=0.01, delay=[0.0, 3e-3, 0.0, 1e-3]
        ).joined(
            Springs([0.3], 0.25, 1e6, 0.0, 0.005, cant=0.02, scale=150.0, laws=[ForceLaw.FRICTION])
        ),
        contact=Contact(0.3),
    ),
}  # fmt: skip


# Two points press equally hard by symmetry; the deck is touched at rest, and left or pressed by any impulse.
KINKED = {("rails", "contact_force"), ("walls", "contact_force"), ("pins", "last_contact")}


@pytest.mark.parametrize("name", GRADIENT_CASES)
def test_every_gradient_against_central_differences(name):
    separation = GRADIENT_CASES[name]
    names, nominal = separation.parameter_names(), separation.parameters()
    outcome = simulate_with_gradients(separation, tolerance=1e-12)
    assert outcome.status[0] == Status.OK
    scales = {".mass": 1e-3, "inertia": 1e-6, "delay": 1e-7, "deformation": 1e-7, "stroke": 1e-7, "release": 1e-7}
    relative = ("stiffness", "friction", "damping", "restitution", "speed", "scale")

    def step_of(name, value):
        if any(word in name for word in relative):
            return 1e-5 * value
        return next((step for word, step in scales.items() if word in name), 1e-7)

    steps = np.array([step_of(name, value) for name, value in zip(names, nominal, strict=True)])
    # The surfaces were matched on the ground: bodies that are mounted without error are at a kink of it.
    unused = set(separation.unused_parameters())
    if not separation.mounting_error.any():
        unused |= {one for one in names if "mounting" in one or "level" in one}
    # What is 0 and must not be negative cannot be lowered.
    signs = separation.parameter_signs()
    free = nominal != 0.0
    free |= np.array([sign == Sign.ANY for sign in signs])
    varied = [i for i, one in enumerate(names) if one not in unused and steps[i] > 0.0 and free[i]]
    rows = np.concatenate([nominal + sign * np.diag(steps)[varied] for sign in (1.0, -1.0)])
    around = simulate(separation, rows, tolerance=1e-13)
    assert (around.status == Status.OK).all()
    quantities = ("axial_velocity", "rate_x", "rate_y", "rate_z", "lateral_velocity", "release_time")
    for quantity in (*quantities, *(one for one in CONTACT_QUANTITIES if (name, one) not in KINKED)):
        values = around.quantity(quantity).reshape(2, -1)
        difference = (values[0] - values[1]) / 2.0
        change = outcome.quantity_gradient(quantity)[0][varied] * steps[varied]
        wrong = np.abs(change - difference) > 5e-3 * np.abs(difference) + 2e-4 * np.abs(difference).max() + 1e-11
        assert not wrong.any(), (
            quantity,
            [names[varied[k]] for k in np.flatnonzero(wrong)],
            change[wrong],
            difference[wrong],
        )


def test_damping_of_hunt_and_crossley():
    law = contact_setup.hunt_crossley_damping
    damping_of = getattr(law, "py_func", law)
    assert damping_of(0.5, 5e-3)[0] == pytest.approx(286.55, rel=1e-4)
    for restitution in (0.05, 0.3, 0.7, 0.99):
        value, by_restitution, by_speed = damping_of(restitution, 0.01)
        u, step = 0.01 * value, 1e-6
        left = -restitution * u - np.log1p(-restitution * u)
        assert left == pytest.approx(u - np.log1p(u), rel=1e-6)
        higher, lower = (damping_of(restitution + s, 0.01)[0] for s in (step, -step))
        assert by_restitution == pytest.approx((higher - lower) / (2.0 * step), rel=1e-4)
        assert by_speed == pytest.approx(-value / 0.01)
    assert damping_of(1.0, 5e-3)[0] == 0.0


def test_flat_bounce():
    separation = contact_separation("bounce_flat")
    outcome = simulate(separation, tolerance=1e-11)
    assert outcome.quantity("axial_velocity")[0] == pytest.approx(0.025000005, abs=1e-9)
    # The largest force by the deepest penetration: elastic, since it is small.
    assert outcome.quantity("contact_impulse")[0] == pytest.approx(0.075000005 / (1 / 1200 + 1 / 100), rel=1e-8)


def test_off_centre_bounce():
    """J = (1 + e) m_e v with 1 / m_e = 1 / m + R^2 / I, for a heavy platform and one stiff point."""
    separation = Separation(
        Body(1e9, [1e9, 1e9, 1e9]), Body(100.0, [9.35, 8.0, 9.35]), Springs([0.0], 0.3, 5500.0, 0.04, 0.03, scale=0.0),
        impulse=[0.0, -5.0, 0.0],
        contact=Contact(0.3, -1e-3, 1e9, 0.5, 0.05, friction=0.0, points=[[0.3, 0.0, 0.0]]),
    )  # fmt: skip
    path = trajectory(separation, [0.1], tolerance=1e-11)
    assert path.states[0, 4] == pytest.approx(-0.01178474, abs=2e-7)
    assert path.states[0, 11] == pytest.approx(0.1226158, abs=2e-6)


def test_rails_with_interference():
    """v = sqrt(2 (E - mu sum(N) L) / m) while all 16 contacts drag over their way; to 1e-3, which the text's L is."""
    interference, friction = 2e-6, 0.1
    separation = symmetric_separation(
        platform=Body(1e9, [1e9, 1e9, 1e9]), satellite=Body(4.0, [0.04, 0.0075, 0.04], [0.0, 0.17, 0.0]),
        springs=Springs([0.0], 0.0, 30.0, 0.6, 0.34),
        rails=Rails(0.05, -interference, (0.0, 0.34), 0.36, friction=friction, sliding_speed=1e-6),
    )  # fmt: skip
    path = trajectory(separation, [], tolerance=1e-10)
    energy = 30.0 * 0.34 * (0.6 - 0.17)
    lost = friction * 16 * 1e6 * interference * 0.34
    assert path.last_release.shape == (20,)
    state = trajectory(separation, [path.release_times[0]], tolerance=1e-10).states[0]
    assert state[4] == pytest.approx(np.sqrt(2.0 * (energy - lost) / 4.0), rel=1e-4)


@pytest.mark.parametrize(("shift", "stuck"), [(0.04, False), (0.06, True)])
def test_a_drawer_jams_where_the_push_is_far_enough_off(shift, stuck):
    """e >= b / (2 mu): 0.05 for rails 0.05 long and a friction of 0.5."""
    name = "rails_12U_drawer_jam"
    separation = contact_separation(name)
    springs = Springs([0.0], shift, 75.0, 0.6, 0.34)
    outcome = simulate(symmetric_separation(
        platform=separation.platform, satellite=separation.satellite, springs=springs, rails=separation.rails
    ))  # fmt: skip
    assert (outcome.status[0] == Status.STUCK) == stuck


def test_through_the_pins():
    """v = sqrt(2 (E - F e + F^2 / (2 k_t)) / m_r)."""
    pins = Springs([0.0], 0.0, 1e8, 0.0, 0.005, scale=150.0, laws=[ForceLaw.FRICTION])
    springs = Springs(SQUARE, 0.3, 5500.0, 0.04, 0.03).joined(pins)
    velocity = simulate(symmetric_separation(springs=springs), tolerance=1e-11).quantity("axial_velocity")[0]
    reduced = 1.0 / (1.0 / 1200.0 + 1.0 / 100.0)
    expected = np.sqrt(2.0 * (16.5 - 150.0 * 0.005 + 150.0**2 / 2e8) / reduced)
    assert velocity == pytest.approx(expected, rel=3e-6)


def test_pins_stall_midway():
    """At 2 (xi - F / K), 25 mm for 110 N and 4,000 N/m."""
    pins = Springs([0.0], 0.0, 1e8, 0.0, 0.04, scale=110.0, laws=[ForceLaw.FRICTION])
    springs = Springs(SQUARE, 0.3, 1000.0, 0.04, 0.03).joined(pins)
    separation = symmetric_separation(springs=springs)
    path = trajectory(separation, [1.0], tolerance=1e-10)
    assert path.status == Status.STUCK
    assert path.states[0, 1] - 2.0 == pytest.approx(2.0 * (0.04 - 110.0 / 4000.0), abs=2e-6)


def test_the_sliding_friction_of_before_is_the_limit_of_hard_pins():
    """Where the push exceeds it from the start on."""
    velocities = []
    for stiffness in (0.0, 1e8):
        pins = Springs([0.4], 0.22, stiffness, 0.0, 0.006, scale=30.0, laws=[ForceLaw.FRICTION])
        springs = Springs(SQUARE, 0.3, 5500.0, 0.04, 0.03).joined(pins)
        velocities.append(simulate(symmetric_separation(springs=springs)).quantity("axial_velocity")[0])
    assert velocities[0] == pytest.approx(velocities[1], rel=1e-6)


def test_a_run_depends_neither_on_its_batch_nor_on_threads(monkeypatch):
    separation = contact_separation("deck_full_inertia_rates")
    rows = separation.parameters() * (1.0 + 1e-3 * np.random.default_rng(0).standard_normal((300, 1)))
    monkeypatch.setattr(simulation.numba, "get_num_threads", lambda: 2)
    together = simulate(separation, rows)
    assert (together.status == Status.OK).all()
    np.testing.assert_array_equal(simulate(separation, rows[217]).base[0], together.base[217])
    gradients = simulate_with_gradients(separation, rows[:9], ["rate_x"])
    np.testing.assert_array_equal(gradients.base, together.base[:9])


def test_without_a_touch_the_run_is_that_without_contact():
    free = symmetric_separation(rates=[0.003, 0.0, -0.002])
    touching = symmetric_separation(rates=[0.003, 0.0, -0.002], contact=Contact(0.3))
    expected, outcome = simulate(free), simulate(touching)
    for name in ("axial_velocity", "rate_x", "rate_z", "release_time"):
        assert outcome.quantity(name)[0] == pytest.approx(expected.quantity(name)[0], rel=1e-7, abs=1e-7)
    assert outcome.quantity("contact_force")[0] == 0.0
    assert outcome.quantity("last_contact")[0] == 0.0


@pytest.mark.parametrize("name", ["contact_impulse", "contact_force", "last_contact"])
def test_where_nothing_touches_the_gradients_of_contact_are_0(name):
    outcome = simulate_with_gradients(symmetric_separation(contact=Contact(0.3)))
    assert not outcome.quantity_gradient(name).any()


def test_more_points_than_there_is_room_for():
    with pytest.raises(ValueError, match="they must be at most 160"):
        symmetric_separation(contact=Contact(0.3, points=120), rails=Rails(0.05, 1e-4, (0.0, 0.3), 0.3, 1e5),
                             hold_downs=HoldDowns(np.arange(20.0), 0.3, 0.01))  # fmt: skip


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: symmetric_separation(contact=Contact(0.0)), "contact.radius = 0.0; it must be positive"),
        (
            lambda: symmetric_separation(contact=Contact(0.3, stiffness=-1.0)),
            "contact.stiffness = -1.0; it must be positive",
        ),
        (lambda: Contact(0.3, restitution=1.1), "contact.restitution = 1.1; it must be above 0 and at most 1"),
        (
            lambda: symmetric_separation(contact=Contact(0.3, friction=-0.1)),
            "contact.friction = -0.1; it must be not negative",
        ),
        (lambda: HoldDowns([0.0], 0.3, np.inf), "it is never released"),
        (lambda: Rails(0.05, 1e-4, (0.4, 0.7), 0.36), "the channel does not overlap"),
        (lambda: Contact(0.3, points=-1), "contact.points = -1; it must be a number from 0 to 120, or places"),
        (lambda: symmetric_separation(contact=Contact(0.3, walls=True)), "contact.walls is on without an envelope"),
    ],
)
def test_bad_input_is_refused_in_one_sentence(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_a_condition_that_only_just_fails_late_in_a_step_ends_no_run():
    """Straight lines between the ends of ever the same step came nearer to it by less than a thousandth each."""
    case = load_case("deployer_3u")
    names = [row.name for row in case.inputs]
    values = dict(
        satellite_cg_x=-2.02038816, satellite_cg_z=1.87920539, push_radius=2.72313635, push_angle=-0.665983249,
        stiffness=44.4156695, clearance=0.263435194, friction=0.106081089, rate_x=-0.441740425, rate_y=0.065702574,
        rate_z=0.366888956,
    )  # fmt: skip
    row = ParameterMap(case.inputs, case.separation).parameters(np.array([[values[name] for name in names]]))
    assert simulate(case.separation, row).status[0] == Status.OK


@pytest.mark.parametrize(("seed", "kind"), [(1, "deck"), (6, "bolt")])
def test_cases_that_no_list_holds(seed, kind, monkeypatch):
    """Against another solution of the same laws, which shares nothing with the package and is good to some 1e-9."""
    case = fresh_case(np.random.default_rng(seed), kind)
    monkeypatch.setitem(CONTACT_CASES, "fresh", {"inputs": case})
    separation = contact_separation("fresh")
    outcome = simulate(separation)
    assert outcome.quantity("contact_force")[0] > 0.0
    end = float(np.nanmax(outcome.release_times[0])) + 0.02
    dv, w, releases = solve(case, end, rtol=1e-10)
    for tolerance, allowed in ((1e-8, 1e-6), (1e-12, 1e-8)):
        path = trajectory(separation, [end], tolerance=tolerance)
        assert error(path.states[0], {"dv_platform": dv, "w_sat": w}) < allowed
        assert np.nanmax(np.abs(path.release_times - releases)) < 1e-7
