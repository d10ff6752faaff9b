"""Searches from single points: how near to the limit they come, and what they do where it has no slope."""

import numpy as np
import openturns as ot
import pytest
from reliability_events import event, recorded, symbolicEvent

from satsep_ot.methods.reliability.limit_search import DistantPlanes, LimitSearch, orthonormalBasis

ROOT = np.array([0.6, 0.8, 0.0])


def searchOf(theEvent, seed=0):
    limitState, recorder, generator = recorded(theEvent, seed=seed)
    return LimitSearch(recorder, limitState, generator), recorder


def test_a_bisection_ends_at_a_failing_point_next_to_the_limit():
    search, recorder = searchOf(event(lambda u: 2.0 - u @ ROOT))
    failing = search.bisect(np.zeros(3), 5.0 * ROOT, 7)
    assert 2.0 <= failing @ ROOT <= 2.0 + 5.0 / 2**7
    assert recorder.phases == {"search": 7}
    # Without steps there is nothing to find.
    np.testing.assert_array_equal(search.bisect(np.zeros(3), 5.0 * ROOT, 0), 5.0 * ROOT)


def test_points_without_a_value_are_safe_and_a_function_that_raises_ends_no_search():
    def broken(u):
        if (u[:, 0] > 4.0).any():
            raise ArithmeticError("no steady state")
        return np.where(u[:, 1] > 2.0, np.nan, 1.0 - u[:, 0])

    search, _ = searchOf(event(broken))
    points = np.array([[2.0, 0.0, 0.0], [5.0, 0.0, 0.0], [2.0, 3.0, 0.0], [0.0, 0.0, 0.0]])
    assert search.fails(points).tolist() == [True, False, False, False]


def test_the_direction_of_steepest_descent_is_found_by_differences_and_by_gradients():
    formula = "exp(2 - 0.6*x0 - 0.8*x1) - 1"
    exact, recorder = searchOf(symbolicEvent(formula, 3))
    point = 2.5 * ROOT
    np.testing.assert_allclose(exact.steepestDescent(point), ROOT, atol=1e-5)
    assert exact.gradients == 1
    assert recorder.used() == 1
    differences, recorder = searchOf(event(lambda u: np.exp(2.0 - u @ ROOT) - 1.0))
    np.testing.assert_allclose(differences.steepestDescent(point), ROOT, atol=0.02)
    assert differences.gradients == 0
    assert recorder.used() == 4


def test_a_gradient_in_physical_inputs_is_one_of_standard_space():
    function = ot.SymbolicFunction(["a", "b"], ["30 - a - b"])
    distribution = ot.JointDistribution([ot.Normal(10.0, 3.0), ot.LogNormal(1.0, 0.5, 0.0)])
    vector = ot.CompositeRandomVector(function, ot.RandomVector(distribution))
    search, _ = searchOf(ot.ThresholdEvent(vector, ot.LessOrEqual(), 0.0))
    found = search.steepestDescent(np.array([1.0, 2.0]))
    # d/du of a = 10 + 3 u and of b = exp(1 + 0.5 u).
    expected = np.array([3.0, 0.5 * np.exp(2.0)])
    np.testing.assert_allclose(found, expected / np.linalg.norm(expected), atol=1e-4)


def test_a_difference_across_a_kink_is_taken_on_the_side_that_fails():
    # One side falls along the first direction; beyond the limit another, much steeper component holds the value.
    def evaluate(u):
        return np.where(u[:, 0] <= 2.01, 2.0 - u[:, 0] - 0.1, 1000.0 * (u[:, 1] + 1.0) + u[:, 0])

    search, _ = searchOf(event(evaluate))
    normal = search.steepestDescent(np.array([2.0, 0.0, 0.0]))
    np.testing.assert_allclose(normal, [1.0, 0.0, 0.0], atol=1e-6)


@pytest.mark.parametrize("value", [-1.0, np.nan])
def test_a_flat_limit_state_has_no_direction(value):
    search, _ = searchOf(event(lambda u: np.where(u[:, 0] > 1.0, value, 1.0)))
    assert search.steepestDescent(np.array([3.0, 0.0, 0.0])) is None


def test_a_limit_state_that_is_flat_has_no_exact_gradient():
    search, _ = searchOf(symbolicEvent("-1 + 0 * x0", 2))
    assert search.steepestDescent(np.array([3.0, 0.0])) is None


LINKS = {
    "as it is": lambda g: g,
    "cubed": lambda g: g**3,
    "compressed": lambda g: np.arcsinh(1e6 * g),
    "on two scales": lambda g: np.where(g > 0.0, 1e9 * g, g),
}


@pytest.mark.parametrize("link", LINKS.values(), ids=LINKS.keys())
def test_a_design_point_is_the_same_through_any_increasing_link(link):
    def margin(u):
        return 3.0 - u @ ROOT - 0.05 * u[:, 2] ** 2 + 0.1 * (u[:, 0] - 1.8) ** 2

    search, recorder = searchOf(event(lambda u: link(margin(u))))
    start = np.array([1.0, 4.0, 2.5])
    assert margin(start[None]) < 0.0
    inside = search.bisect(np.zeros(3), start, 7)
    inside, normals = search.approachDesignPoint(inside)
    # The nearest point of this limit is 3 along the root's direction, near (1.8, 2.4, 0).
    assert margin(inside[None])[0] <= 0.0
    assert np.linalg.norm(inside) < 3.15
    assert normals[-1] @ ROOT > 0.95
    assert recorder.used() < 120


def test_a_search_keeps_to_the_evaluations_that_are_left():
    limitState, recorder, generator = recorded(event(lambda u: 3.0 - u @ ROOT), maximum=20)
    search, start = LimitSearch(recorder, limitState, generator), np.array([0.0, 5.0, 1.0])
    search.fails(np.zeros((14, 3)))
    # Six are left: too few for differences to both sides, and for all of a chain or of a bisection.
    assert search.steepestDescent(start) is None
    inside, normals = search.approachDesignPoint(start)
    assert normals == []
    np.testing.assert_array_equal(inside, start)
    assert recorder.used() == 14
    for search_more in (
        lambda: search.descend(start, 30),
        lambda: search.designPoint(np.eye(3), start),
        lambda: search.bisect(np.zeros(3), start, 50),
    ):
        search_more()
        assert recorder.used() <= 20


@pytest.mark.parametrize("seed", range(4))
def test_a_chain_of_failures_comes_to_where_they_are_likely(seed):
    search, recorder = searchOf(event(lambda u: np.where(u @ ROOT > 2.5, -1.0, 1.0)), seed)
    start = np.array([3.0, 3.0, 4.0])
    last, failing = search.descend(start, 30)
    assert recorder.used() == 90
    assert np.linalg.norm(last) < 0.75 * np.linalg.norm(start)
    assert (failing @ ROOT > 2.5).all()
    np.testing.assert_array_equal(failing[0], start)


@pytest.mark.parametrize("seed", range(4))
def test_the_nearest_failing_point_of_a_corner_is_its_tip(seed):
    # Labels alone: the corner has no slopes.
    search, _ = searchOf(event(lambda u: np.where((u[:, 0] > 1.5) & (u[:, 1] > 1.0), -1.0, 1.0)), seed)
    point = search.designPoint(np.eye(3)[:, :2], np.array([3.0, 2.8, 0.0]))
    assert np.linalg.norm(point) < np.hypot(1.5, 1.0) + 0.25
    assert point[2] == 0.0
    assert search.fails(point[None])[0]


def test_a_basis_keeps_the_order_and_leaves_out_what_is_known():
    a, b = np.array([1.0, 0.0, 0.0]), np.array([1.0, 0.05, 0.0])
    c = np.array([0.0, 3.0, 4.0])
    basis = orthonormalBasis([a, b, c, ROOT], 4, 0.1)
    np.testing.assert_allclose(basis.T @ basis, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(basis[:, :2], np.array([[1.0, 0.0, 0.0], [0.0, 0.6, 0.8]]).T, atol=1e-12)
    assert orthonormalBasis([a, c, ROOT], 2, 0.1).shape == (3, 2)


def test_few_distant_planes_do_not_matter_and_many_do():
    planes = DistantPlanes()
    directions = np.eye(5)
    # Beyond a distance of 5 the normal law has 3e-7.
    for direction in directions[:3]:
        assert planes.takes(5.0 * direction, [direction], 1e-3)
        # The same plane again is not one more.
        assert planes.takes(5.1 * direction, [direction], 1e-3)
    assert not planes.takes(5.0 * directions[3], [directions[3]], 1e-3)


def test_planes_of_a_share_of_the_probability_and_curved_limits_are_never_distant():
    planes, direction = DistantPlanes(), np.eye(3)[0]
    assert not planes.takes(3.0 * direction, [direction], 1e-3)
    # The normal does not lead to the point: it is no nearest one.
    assert not planes.takes(5.0 * direction, [np.eye(3)[1]], 1e-3)
    assert not planes.takes(5.0 * direction, [], 1e-3)
