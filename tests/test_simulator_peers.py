"""Peers that share no code with the simulator find the same: scipy's solve_ivp, and a loop in C."""

import numpy as np
import pytest
from benchmarks import simulator_peers as peers
from separation_cases import TRUTH_CASES, truth_separation

from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.separation import Body, Separation, Springs
from satsep_ot.dynamics.springs import ForceLine


@pytest.mark.parametrize("case", [peers.guided_case, peers.reference_case])
def test_scipy_finds_the_same(case):
    separation, rows = case(2, seed=1)
    ours, scipy = peers.our_summary(separation, rows, 1e-12), peers.scipy_summary(separation, rows, rtol=1e-11)
    assert peers.largest_difference(ours, scipy) < 1e-9


@pytest.mark.parametrize("force_line", ["guided", "strut"])
@pytest.mark.parametrize("case", TRUTH_CASES)
def test_scipy_finds_the_reference_solutions(case, force_line):
    """Those in 128-bit arithmetic, whose program is not here: scipy's integrator vouches for the stored numbers."""
    truth = TRUTH_CASES[case]["results"][force_line]
    velocity, rates = (np.array(truth["at_last_release"][name])[None] for name in ("dv_platform", "w_sat"))
    expected = peers.summary(
        velocity[:, 1], np.hypot(velocity[:, 0], velocity[:, 2]), rates, np.array(truth["t_release"])[None],
        np.empty((1, 0)),
    )  # fmt: skip
    separation = truth_separation(case, force_line)
    scipy = peers.scipy_summary(separation, separation.parameters()[None], rtol=1e-12, atol=1e-13)
    assert peers.largest_difference(expected, scipy) < 1e-10


def random_body(rng, mass):
    """A body with a full inertia tensor, that of masses spread about it, and a CG off the axis."""
    masses, places = rng.uniform(0.5, 1.5, 6), rng.standard_normal((6, 3)) * np.cbrt(mass) / 15.0
    masses *= mass / masses.sum()
    places -= masses @ places / mass
    inertia = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, places, strict=True))
    return Body(mass, 0.5 * (inertia + inertia.T), rng.uniform(-0.02, 0.02, 3) + [0.0, np.cbrt(mass) / 15.0, 0.0])


def random_separation(seed):
    """Anything: one to eight springs in an irregular ring, a light platform, fast spins, 30 ms between the springs."""
    rng = np.random.default_rng(seed)
    count, strut = int(rng.integers(1, 9)), bool(rng.integers(2))
    platform, satellite = (random_body(rng, mass) for mass in np.exp(rng.uniform(np.log(5.0), np.log(1500.0), 2)))
    reduced = 1.0 / (1.0 / platform.mass + 1.0 / satellite.mass)
    direction = rng.standard_normal(3)
    orbit = Orbit.from_elements(6.9e6, 0.01, *rng.uniform(0.0, 3.0, 4)) if rng.integers(2) else None
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi / count, count) + 2.0 * np.pi * np.arange(count) / count)
    return Separation(
        platform,
        satellite,
        Springs(
            angle,
            radius=rng.uniform(0.05, 0.3, count),
            stiffness=reduced * rng.uniform(150.0, 250.0, count) / count,
            deformation=rng.uniform(0.05, 0.06, count),
            stroke=rng.uniform(0.02, 0.07, count),
            cant=rng.uniform(-0.05, 0.05, count),
            delay=np.concatenate([[0.0], rng.uniform(0.0, 0.03, count - 1)]) * rng.integers(2),
        ),
        ForceLine.STRUT if strut else ForceLine.GUIDED,
        stowed_length=0.04 if strut else 0.0,
        attitude=rng.standard_normal(4),
        rates=np.radians(rng.choice([0.0, 1.0, 11.0, 32.0])) * direction / np.linalg.norm(direction),
        orbit=orbit,
        gradient_torque=orbit is not None and bool(rng.integers(2)),
    )


# In the others of the first 24 the satellite sinks into the deck.
@pytest.mark.parametrize("seed", [0, *range(2, 12), *range(13, 23), 76, 84, 128, 194, 258])
def test_anything_at_the_default_tolerance(seed):
    """Within 1e-8 of scipy at a tolerance a thousand times finer, whatever the case."""
    separation = random_separation(seed)
    rows = separation.parameters()[None]
    scipy = peers.scipy_summary(separation, rows, rtol=1e-12, atol=1e-13)
    assert peers.largest_difference(peers.our_summary(separation, rows), scipy) < 1e-8


def test_the_c_loop_finds_the_same(tmp_path):
    run = peers.compile_c(tmp_path)
    if run is None:
        pytest.skip("there is no C compiler (gcc or cc) here")
    separation, rows = peers.guided_case(200, seed=1)
    exact = peers.our_summary(separation, rows, 1e-12)
    for tolerance, limit in ((1e-8, 1e-7), (1e-12, 1e-11)):
        assert peers.largest_difference(exact, peers.c_summary(run, separation, rows, tolerance)) < limit
