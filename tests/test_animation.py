"""The body that a report shows for a satellite."""

import numpy as np
import pytest
from separation_cases import BOX, symmetric_separation

from satsep_ot.dynamics.simulation import contact_events
from satsep_ot.model.case import load_case
from satsep_ot.studies.telling.animation import animation_data, satellite_shape


@pytest.mark.parametrize(
    ("points", "half", "height"),
    [
        # A plate at a height, a line along the axis, and one across it.
        ([[0.3, 0.5, 0.2], [-0.3, 0.5, 0.2], [0.3, 0.5, -0.2], [-0.3, 0.5, -0.2]], 0.3, 0.5),
        ([[0.0, 0.0, 0.0], [0.0, 0.4, 0.0]], 0.1, 0.4),
        ([[0.3, 0.0, 0.0], [-0.3, 0.0, 0.0]], 0.3, 0.6),
    ],
)
def test_points_without_a_volume_are_shown_as_a_box_around_them(points, half, height):
    separation = symmetric_separation(envelope=points, recess_radius=1.0, recess_depth=2.0)
    shape, faces = satellite_shape(separation)
    assert len(shape) == 8
    assert sorted(len(face) for face in faces) == [4] * 6
    np.testing.assert_allclose(np.abs(shape[:, [0, 2]]), half)
    np.testing.assert_allclose(sorted(set(shape[:, 1])), [0.0, height])


def test_a_box_is_shown_as_it_is():
    shape, faces = satellite_shape(symmetric_separation(envelope=BOX, recess_radius=1.0, recess_depth=2.0))
    np.testing.assert_array_equal(shape, BOX)
    assert sorted(len(face) for face in faces) == [4] * 6


def test_contacts_are_marked_where_and_when_they_are():
    case = load_case("deployer_3u")
    (run,) = animation_data(case.separation, {"nominal": case.separation.parameters()})["runs"].values()
    rails = case.separation.rails
    for touch in run["touches"]:
        half = rails.half_width + (rails.clearance if touch["onPlatform"] else 0.0)
        assert np.abs(np.abs(np.array(touch["place"])[[0, 2]]) - half).max() < 1e-6
        assert touch["to"] is None or touch["from"] <= touch["to"]
        assert touch["name"].startswith("mouth") == touch["onPlatform"]
    begun = [event for event in contact_events(case.separation) if event.what in ("is pressed", "engages")]
    assert [touch["from"] for touch in run["touches"]] == [pytest.approx(event.time, abs=1e-7) for event in begun]
    free = load_case("reference").separation
    assert animation_data(free, {"nominal": free.parameters()})["runs"]["nominal"]["touches"] == []
