"""Orbits from classical elements, against rotations, invariants and a flown revolution."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from satsep_ot.dynamics.gravity import EARTH_GRAVITATIONAL_PARAMETER as MU
from satsep_ot.dynamics.gravity import EARTH_RADIUS
from satsep_ot.dynamics.orbit import Orbit

angle = st.floats(-np.pi, np.pi)


@settings(max_examples=50, deadline=None, derandomize=True)
@given(st.floats(1.0, 6.0), st.floats(0.0, 0.8), st.floats(0.0, np.pi), angle, angle, angle)
def test_elements_against_three_turns_and_the_invariants(size, e, inclination, node, perigee, anomaly):
    """The turns of the orbital plane by scipy, energy and angular momentum by the vis-viva equation."""
    a = size * EARTH_RADIUS / (1.0 - e) * 1.0001
    orbit = Orbit.from_elements(a, e, inclination, node, perigee, anomaly)
    turn = Rotation.from_euler("ZXZ", [node, inclination, perigee])
    radius = a * (1.0 - e**2) / (1.0 + e * np.cos(anomaly))
    position = turn.apply(radius * np.array([np.cos(anomaly), np.sin(anomaly), 0.0]))
    np.testing.assert_allclose(orbit.position, position, atol=1e-12 * a)
    r, v = orbit.position, orbit.velocity
    assert 0.5 * v @ v - MU / np.linalg.norm(r) == pytest.approx(-0.5 * MU / a, rel=1e-12)
    momentum = turn.apply([0.0, 0.0, np.sqrt(MU * a * (1.0 - e**2))])
    np.testing.assert_allclose(np.cross(r, v), momentum, atol=1e-12 * np.linalg.norm(momentum))
    # The eccentricity vector points to the perigee.
    eccentricity = np.cross(v, np.cross(r, v)) / MU - r / np.linalg.norm(r)
    np.testing.assert_allclose(eccentricity, turn.apply([e, 0.0, 0.0]), atol=1e-12)


@pytest.mark.parametrize("e", [0.0, 0.1])
def test_one_revolution_closes(e):
    orbit = Orbit.from_elements(6878.137e3 / (1.0 - e), e, 0.9, 0.3, -0.4, 0.7)
    flown = solve_ivp(
        lambda t, x: np.concatenate([x[3:], -MU * x[:3] / np.linalg.norm(x[:3]) ** 3]),
        (0.0, orbit.period), np.concatenate([orbit.position, orbit.velocity]), method="DOP853", rtol=1e-13, atol=1e-6,
    )  # fmt: skip
    assert np.linalg.norm(flown.y[:3, -1] - orbit.position) < 1e-3


def test_an_orbit_that_is_not_closed_has_no_period():
    assert Orbit([7e6, 0.0, 0.0], [0.0, 1.2e4, 0.0]).period == np.inf


@pytest.mark.parametrize(
    ("elements", "message"),
    [
        ((-7e6, 0.0, 0.0), "semi_major_axis = -7000000.0 m; it must be positive and finite"),
        ((np.nan, 0.0, 0.0), "semi_major_axis = nan"),
        ((7e6, 1.0, 0.0), "eccentricity = 1.0; it must be at least 0 and below 1"),
        ((7e6, -0.1, 0.0), "eccentricity = -0.1"),
        ((7e6, 0.1, 0.0), "the perigee is 6300 km from the centre of the Earth"),
        ((7e6, 0.0, np.inf), "the angles of the orbit are (inf,"),
    ],
)
def test_elements_that_are_no_orbit_are_refused(elements, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Orbit.from_elements(*elements, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([7e6, 0.0], [0.0, 7e3, 0.0]), "orbit.position = [7000000.0, 0.0]; it must be 3 finite coordinates"),
        (([7e6, 0.0, 0.0], [0.0, np.nan, 0.0]), "orbit.velocity"),
        (([0.0, 0.0, 0.0], [0.0, 7e3, 0.0]), "orbit.position is the centre of the Earth"),
        (([7e6, 0.0, 0.0], [0.0, 7e3, 0.0], -1.0), "orbit.mu = -1.0 m3/s2"),
    ],
)
def test_states_that_are_no_orbit_are_refused(arguments, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        Orbit(*arguments)
