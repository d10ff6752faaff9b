"""The flat parameter vector: its layout, and the separation that belongs to another vector."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from separation_cases import general_separation, mixed_springs, symmetric_separation

from satsep_ot.dynamics.parameter_vector import Sign
from satsep_ot.dynamics.separation import PARAMETERS, SPRING_PARAMETERS, Body, Springs, is_inertia
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.dynamics.springs import ForceLine

PLANES = [[-1.0, 0.05, 0.0, -0.36], [0.3, 0.0, 1.0, -0.5]]
SEPARATIONS = {
    "guided": general_separation(ForceLine.GUIDED, attitude=[0.1, 0.2, 0.3, 0.4], recess_planes=PLANES),
    "strut": general_separation(ForceLine.STRUT),
    "normal": general_separation(ForceLine.NORMAL, springs=mixed_springs(), recess_radius=0.0, recess_planes=PLANES),
    "without envelope": symmetric_separation(),
}


@pytest.mark.parametrize("separation", SEPARATIONS.values(), ids=SEPARATIONS)
def test_layout(separation):
    names, places = separation.parameter_names(), separation.parameter_places()
    assert len(set(names)) == len(names) == len(separation.parameters())
    for place, value in zip(places, separation.parameters(), strict=True):
        # The value is where the path says.
        owner, _, field = place.path.partition(".")
        held = getattr(separation, owner)
        if owner == "recess_planes":
            held = held[place.index, 3]
        elif field:
            held = getattr(held, field)
            held = held if place.index is None else held[place.index]
        if place.path.endswith("inertia"):
            held = held[tuple("xyz".index(axis) for axis in place.element)]
        elif place.element:
            held = held["xyz".index(place.element)]
        assert held == value, place.name


@pytest.mark.parametrize("separation", SEPARATIONS.values(), ids=SEPARATIONS)
@settings(max_examples=50, deadline=None)
@given(data=st.data())
def test_with_parameters_is_the_inverse_of_parameters(separation, data):
    """Every bit of the vector, and of all that the vector does not hold."""
    nominal = separation.parameters()
    factors = data.draw(st.lists(st.floats(0.9995, 1.0005), min_size=nominal.size, max_size=nominal.size))
    vector = nominal * factors
    changed = separation.with_parameters(vector)
    np.testing.assert_array_equal(changed.parameters(), vector)
    np.testing.assert_array_equal(separation.parameters(), nominal)
    np.testing.assert_array_equal(changed.attitude, separation.attitude)
    np.testing.assert_array_equal(changed.recess_planes[:, :3], separation.recess_planes[:, :3])
    assert changed.springs.laws.tolist() == separation.springs.laws.tolist()
    np.testing.assert_array_equal(changed.with_parameters(nominal).parameters(), nominal)


@pytest.mark.parametrize("separation", SEPARATIONS.values(), ids=SEPARATIONS)
def test_a_changed_separation_runs_as_a_row_of_parameters_does(separation):
    # Without gravity: the orbit of the platform is that of the separation, for every row of parameters.
    separation = replace(separation, orbit=None, gradient_torque=False)
    nominal = separation.parameters()
    vector = nominal * (1.0 + 1e-4 * np.random.default_rng(0).standard_normal(nominal.size))
    changed = separation.with_parameters(vector)
    np.testing.assert_array_equal(simulate(changed).base, simulate(separation, vector).base)


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("satellite.mass", -1.0, r"satellite\.mass = -1\.0; it must be positive"),
        ("springs[1].delay", -1.0, r"springs\[1\]\.delay = -1\.0; it must be not negative"),
        ("stowed_length", 0.1, r"stowed_length = 0\.1; it must be 0, since only struts"),
        ("guide_friction", 0.1, r"guide_friction = 0\.1; it must be 0, since only the force line NORMAL"),
        ("platform.inertia.xy", 1e6, r"platform\.inertia has the principal moments"),
        ("recess_depth", -1.0, r"no point lies in the recess"),
        ("rates.x", np.nan, r"rates\.x = nan; it must be a finite number"),
    ],
)
def test_vectors_that_make_no_sense(name, value, words):
    separation = SEPARATIONS["guided"]
    vector = separation.parameters()
    vector[separation.parameter_names().index(name)] = value
    with pytest.raises(ValueError, match=words):
        separation.with_parameters(vector)


def test_a_vector_of_another_length():
    separation = SEPARATIONS["strut"]
    size = separation.parameters().size
    with pytest.raises(ValueError, match=rf"shape \({size - 1},\); it must be \({size},\)"):
        separation.with_parameters(separation.parameters()[:-1])


def test_parameters_that_play_no_part():
    assert set(SEPARATIONS["without envelope"].unused_parameters()) == {
        "stowed_length", "guide_friction", "recess_radius", "recess_depth"
    }  # fmt: skip
    assert set(SEPARATIONS["strut"].unused_parameters()) == {"guide_friction"}
    laws = SEPARATIONS["normal"].springs.laws
    unused = {f"springs[{i}].{name}" for i in np.flatnonzero(laws) for name in ("stiffness", "deformation")}
    assert set(SEPARATIONS["normal"].unused_parameters()) == {"stowed_length", "recess_radius"} | unused
    assert unused


def test_inertia_of_a_mass_distribution():
    """A rod, a disc and a cube are bodies; what has more about one axis than about the two others is not."""
    moments = np.array([[1e-12, 1.0, 1.0], [1.0, 1.0, 2.0], [1.0, 1.0, 1.0], [1.0, 1.0, 2.1], [0.0, 1.0, 1.0]])
    assert is_inertia(moments).tolist() == [True, True, True, False, False]


def test_parts_are_inverted_too():
    body = Body(2.0, [[3.0, 0.1, 0.2], [0.1, 3.0, 0.3], [0.2, 0.3, 3.0]], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(body.with_parameters(body.parameters()).inertia, body.inertia)
    springs = mixed_springs()
    again = springs.with_parameters(springs.parameters())
    assert isinstance(again, Springs)
    assert again.tables is not None
    np.testing.assert_array_equal(again.parameters(), springs.parameters())


def test_signs():
    assert [[sign.allows(value) for value in (-1.0, 0.0, 1.0)] for sign in Sign] == [
        [True, True, True], [False, False, True], [False, True, True], [False, True, False],
    ]  # fmt: skip


@pytest.mark.parametrize("separation", SEPARATIONS.values(), ids=SEPARATIONS)
def test_the_records_of_the_kernels_hold_the_vector(separation):
    vector, size = separation.parameters(), PARAMETERS["x"].shape[0]
    (common,) = vector[:size].view(PARAMETERS)
    springs = vector[size : size + 8 * len(separation.springs)].view(SPRING_PARAMETERS)
    assert common.satellite.mass == separation.satellite.mass
    np.testing.assert_array_equal(common.platform.center_of_mass, separation.platform.center_of_mass)
    for name in ("rates", "mounting_error", "stowed_length", "recess_depth", "angular_impulse", "guide_friction"):
        np.testing.assert_array_equal(getattr(common, name), getattr(separation, name), err_msg=name)
    for name in ("angle", "stroke", "delay", "scale"):
        np.testing.assert_array_equal(springs[name], getattr(separation.springs, name), err_msg=name)


@pytest.mark.parametrize("separation", SEPARATIONS.values(), ids=SEPARATIONS)
def test_limits_are_those_of_the_signs_of_a_changed_separation_too(separation):
    limits = separation.parameter_limits
    changed = separation.with_parameters(separation.parameters())
    for each in (separation, changed):
        assert each.parameter_limits.tolist() == [list(sign.limits) for sign in each.parameter_signs()]
    assert limits.shape == (separation.parameters().size, 2)
