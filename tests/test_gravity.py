"""The expansion of the orbit about its anchor, against the inverse square law."""

import numpy as np
import pytest

from satsep_ot.dynamics.gravity import EARTH_GRAVITATIONAL_PARAMETER
from satsep_ot.dynamics.kernels.gravity import ANCHOR_LIFE, earth_vector
from satsep_ot.dynamics.kernels.records import ANCHOR

RADIAL_SPEED = 2000.0  # m/s: of an eccentric orbit


def anchor_record(position, velocity):
    """An anchor at t = 0, by the law of gravity."""
    radius = np.linalg.norm(position)
    anchor = np.zeros(1, ANCHOR)[0]
    anchor.mu, anchor.position, anchor.velocity = EARTH_GRAVITATIONAL_PARAMETER, position, velocity
    anchor.acceleration = -EARTH_GRAVITATIONAL_PARAMETER / radius**3 * position
    anchor.rate = EARTH_GRAVITATIONAL_PARAMETER / radius**3
    anchor.rate_slope = -3.0 * anchor.rate * (position @ velocity) / radius**2
    return anchor


@pytest.mark.parametrize("time", [-0.5 * ANCHOR_LIFE, 0.5 * ANCHOR_LIFE])
def test_rate_and_place_between_anchors(time):
    """Its errors are of the second order of the time for mu / r^3, of the third one for the place."""
    position = np.array([6.9e6, 1e5, -3e5])
    across = np.cross(position, [0.0, 0.0, 1.0])
    velocity = RADIAL_SPEED * position / np.linalg.norm(position) + 7500.0 * across / np.linalg.norm(across)
    anchor = anchor_record(position, velocity)
    found, rate = earth_vector(time, anchor, (1.0, 0.0, 0.0, 0.0))
    place = position + time * velocity - 0.5 * time**2 * anchor.rate * position
    np.testing.assert_allclose(found, place, rtol=1e-13)
    truth = EARTH_GRAVITATIONAL_PARAMETER / np.linalg.norm(place) ** 3
    change = abs(truth / anchor.rate - 1.0)
    assert change > 1e-4
    assert rate == pytest.approx(truth, rel=20.0 * change**2)
