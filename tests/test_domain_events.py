"""Domains made of others, limits that are steps, and plateaus around the mean."""

import numpy as np
import openturns as ot
import pytest
from reliability_events import covers, event, run
from scipy.stats import norm

from satsep_ot.methods.reliability.limit_state import Limit, LimitStateEvent
from satsep_ot.methods.reliability.outcome import Ending
from satsep_ot.openturns_adapter import domainMembers

BOX = ot.Interval([0.0, 0.0], [1.0, 2.0])
STRIP = ot.Interval([-1.0, -9.0], [0.5, 9.0], [True, False], [True, False])
DISC = ot.LevelSet(ot.SymbolicFunction(["p", "q"], ["p^2 + q^2"]), ot.LessOrEqual(), 1.0)
OPEN = ot.LevelSet(ot.SymbolicFunction(["p", "q"], ["p + q"]), ot.Less(), 1.0)
DOMAINS = {
    "union": ot.DomainUnion([BOX, DISC]),
    "union of three": ot.DomainUnion([BOX, DISC, STRIP]),
    "intersection": ot.DomainIntersection([BOX, DISC, OPEN]),
    "complement": ot.DomainComplement(BOX),
    "complement of an open one": ot.DomainComplement(OPEN),
    "difference": ot.DomainDifference(BOX, DISC),
    "nested": ot.DomainComplement(
        ot.DomainUnion([ot.DomainDifference(BOX, DISC), ot.DomainIntersection([STRIP, OPEN])])
    ),
}


def vector():
    return ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["a", "b"]), ot.RandomVector(ot.Normal(2)))


@pytest.mark.parametrize("name", DOMAINS)
def test_a_run_fails_where_it_is_in_the_domain(name):
    domain = DOMAINS[name]
    # Corners and limits among them.
    grid = np.array([[p, q] for p in np.linspace(-2.0, 2.0, 17) for q in np.linspace(-2.5, 2.5, 21)])
    points = np.vstack([grid, np.random.default_rng(0).normal(0.0, 1.5, (300, 2))])
    margin = Limit.of(ot.DomainEvent(vector(), domain)).margin(points)
    np.testing.assert_array_equal(margin <= 0.0, [domain.contains(point) for point in points])
    assert 0 < np.count_nonzero(margin <= 0.0) < len(points)
    # A limit state, not a label.
    assert len(np.unique(margin)) > 50


@pytest.mark.parametrize("name", ["union", "complement", "difference"])
def test_its_probability(name):
    u, v = (
        ot.Interval([2.5, -9.0], [9.0, 9.0]),
        ot.LevelSet(ot.SymbolicFunction(["p", "q"], ["q - 0.5 * p"]), ot.GreaterOrEqual(), 3.0),
    )
    domains = {
        "union": ot.DomainUnion([u, v]),
        "complement": ot.DomainComplement(ot.Interval([-3.0, -3.0], [3.0, 3.0])),
        "difference": ot.DomainDifference(u, ot.Interval([-9.0, 0.0], [9.0, 9.0])),
    }
    tail = norm.sf(3.0 / 1.25**0.5)
    # P(a > 2.5 and b - a / 2 > 3): their correlation is -0.5 / sqrt(1.25).
    both = ot.Normal(
        [0.0, 0.0], [1.0, 1.25**0.5], ot.CorrelationMatrix([[1.0, -0.5 / 1.25**0.5], [-0.5 / 1.25**0.5, 1.0]])
    ).computeProbability(ot.Interval([2.5, 3.0], [40.0, 40.0]))
    truths = {
        "union": norm.sf(2.5) + tail - both,
        "complement": 1.0 - (1.0 - 2.0 * norm.sf(3.0)) ** 2,
        "difference": 0.5 * norm.sf(2.5),
    }
    result = run(ot.DomainEvent(vector(), domains[name]))
    assert result.getConverged()
    assert covers(result, truths[name])


def test_members_of_domains_of_python_functions():
    square = ot.PythonFunction(2, 1, lambda x: [x[0] ** 2])
    domain = ot.DomainUnion([ot.LevelSet(square, ot.Greater(), 4.0), BOX])
    level, box = domainMembers(domain)
    assert level.getFunction()([3.0, 0.0])[0] == 9.0
    assert level.getLevel() == 4.0
    assert box == BOX


def test_what_has_no_limit_state_is_refused_inside_too():
    mesh = ot.MeshDomain(ot.IntervalMesher([2, 2]).build(ot.Interval(2)))
    for domain in (ot.DomainComplement(mesh), ot.DomainDisjunctiveUnion([BOX, DISC])):
        with pytest.raises(
            TypeError, match=r"has no limit state function; give .* or a union, intersection, difference"
        ):
            LimitStateEvent(ot.DomainEvent(vector(), domain))


@pytest.mark.parametrize("dimension", [3, 12])
def test_an_indicator_is_estimated_and_says_what_would_be_better(dimension):
    result = run(event(lambda u: np.where(u[:, 0] > 2.5, -1.0, 1.0), dimension))
    assert covers(result, norm.sf(2.5))
    assert "takes only two values" in result.getReason()
    assert "a margin, or components (setComponents)" in result.getReason()
    smooth = run(event(lambda u: 2.5 - u[:, 0], dimension))
    assert smooth.getEvaluationNumber() < result.getEvaluationNumber()
    assert "two values" not in smooth.getReason()


@pytest.mark.parametrize("dimension", [3, 12])
@pytest.mark.parametrize("width", [2.0, 2.8])
def test_learning_resumes_beyond_a_plateau(dimension, width):
    """The first runs are all alike."""
    result = run(event(lambda u: 3.0 - np.maximum(u[:, 0], width), dimension))
    assert result.getEnding() is Ending.TARGET_REACHED
    assert covers(result, norm.sf(3.0))
    # Crude Monte Carlo would take 300,000 for this.
    assert result.getEvaluationNumber() < 2500
    assert "two values" not in result.getReason()
