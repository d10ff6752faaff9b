"""What an algorithm takes for an event, and what it refuses before it has begun."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.comparison.comparison import ReliabilityComparison
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.limit_state import LimitStateEvent, checkedKind
from satsep_ot.openturns_adapter import errorMessage

FUNCTION = ot.SymbolicFunction(["load", "length"], ["load * length"])
VECTOR = ot.CompositeRandomVector(FUNCTION, ot.RandomVector(ot.Normal(2)))
EVENT = ot.ThresholdEvent(VECTOR, ot.Greater(), 3.0)


@pytest.mark.parametrize("algorithm", [ActiveSubspaceReliability, ReliabilityComparison])
@pytest.mark.parametrize(
    ("thing", "kind"),
    [
        (FUNCTION, "SymbolicFunction"),
        (ot.Function(FUNCTION), "Function"),
        (VECTOR, "CompositeRandomVector"),
        (ot.Normal(2), "Normal"),
        (lambda x: x, "function"),
        (None, "NoneType"),
        (3.0, "float"),
    ],
)
def test_what_is_no_event_is_refused_when_it_is_given(algorithm, thing, kind):
    with pytest.raises(TypeError, match=rf"^the event is a {kind}; give a ThresholdEvent, .*CompositeRandomVector"):
        algorithm(thing)


@pytest.mark.parametrize(
    ("event", "kind"),
    [
        (EVENT, "ThresholdEvent"),
        (ot.RandomVector(EVENT), "ThresholdEvent"),
        (ot.UnionEvent([EVENT, EVENT]), "UnionEvent"),
        (ot.IntersectionEvent([EVENT, EVENT]), "IntersectionEvent"),
        (ot.DomainEvent(VECTOR, ot.Interval([1.0], [2.0])), "DomainEvent"),
    ],
)
def test_events_are_told_apart_and_taken(event, kind):
    assert checkedKind(event) == kind
    ActiveSubspaceReliability(event)


def names(event):
    return list(LimitStateEvent(event).distribution.getDescription())


def test_inputs_have_the_names_that_the_user_gave_wherever_that_was():
    assert names(EVENT) == ["load", "length"]
    assert names(ot.DomainEvent(VECTOR, ot.Interval([1.0], [2.0]))) == ["load", "length"]
    law = ot.Normal(2)
    law.setDescription(["p", "q"])
    assert names(ot.ThresholdEvent(ot.CompositeRandomVector(FUNCTION, ot.RandomVector(law)), ot.Less(), 3.0)) == [
        "p",
        "q",
    ]
    # The user's own distribution keeps its names.
    assert list(VECTOR.getAntecedent().getDistribution().getDescription()) == ["X0", "X1"]


def test_sensitivities_carry_the_names_of_the_functions_inputs():
    ot.RandomGenerator.SetSeed(0)
    vector = ot.CompositeRandomVector(
        ot.SymbolicFunction(["load", "length"], ["load + 0.5 * length"]), ot.RandomVector(ot.Normal(2))
    )
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 2.5))
    algorithm.run()
    result = algorithm.getResult()
    assert [row.input for row in result.computeImportance()] == ["load", "length"]
    assert {row.input for row in result.computeParameterSensitivity()} == {"load", "length"}
    assert list(result.getInputSample().getDescription()) == ["load", "length"]
    assert result.getTrueRuns().inputNames == ("load", "length")
    drawables = [drawable.getImplementation() for drawable in result.drawImportance().getDrawables()]
    texts = [list(drawable.getTextAnnotations()) for drawable in drawables if drawable.getClassName() == "Text"]
    assert any(text.startswith("load: ") for row in texts for text in row)


def test_events_within_events_and_wrapped_ones_are_taken():
    vector = ot.RandomVector(ot.Normal(2))
    parts = [
        ot.ThresholdEvent(ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], [name]), vector), ot.Greater(), 1.0)
        for name in ("a", "b", "a + b")
    ]
    nested = ot.UnionEvent([ot.IntersectionEvent(parts[:2]), parts[2]])
    for event in (nested, ot.RandomVector(nested)):
        runs = LimitStateEvent(event).evaluate(np.array([[1.5, 1.5], [1.5, -1.0], [0.6, 0.6]]))
        assert runs.failed.tolist() == [True, False, True]


def test_a_comparison_without_a_side_is_refused():
    vector = ot.CompositeRandomVector(ot.SymbolicFunction("x", "x"), ot.RandomVector(ot.Normal()))
    event = ot.ThresholdEvent(vector, ot.Equal(), 3.0)
    with pytest.raises(ValueError, match="the comparison of the event is Equal; give one with a side"):
        ActiveSubspaceReliability(event).run()
    comparison = ReliabilityComparison(event, ["MonteCarlo"])
    comparison.setMaximumEvaluations(1000)
    comparison.run()
    assert "the comparison of the event is Equal" in comparison.getResult().getRows()[0].note


def test_components_are_for_a_threshold_only():
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(["x", "y"], ["x", "y"]), ot.RandomVector(ot.Normal(2)))
    both = ot.SymbolicFunction(["x", "y"], ["x", "y"])
    event = ot.DomainEvent(vector, ot.Interval([3.0, 3.0], [9.0, 9.0]))
    algorithm, total = ActiveSubspaceReliability(event), ot.SymbolicFunction(["x", "y"], ["x + y"])
    algorithm.setComponents(both, total)
    with pytest.raises(TypeError, match="components can be given for a ThresholdEvent only, not for a DomainEvent"):
        algorithm.run()
    with pytest.raises(TypeError, match="components can be given for a ThresholdEvent only, not for a DomainEvent"):
        ReliabilityComparison(event).setComponents(both, total)


def test_a_composition_is_compared_at_the_size_of_its_values():
    vector = ot.CompositeRandomVector(
        ot.SymbolicFunction(["x", "y"], ["1e-12 * (x + y)"]), ot.RandomVector(ot.Normal(2))
    )
    algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(vector, ot.Greater(), 4e-12))
    both = ot.SymbolicFunction(["x", "y"], ["x", "y"])
    algorithm.setComponents(both, ot.SymbolicFunction(["u", "v"], ["5e-12 + 0 * u"]))
    with pytest.raises(ValueError, match="does not give the event's variable"):
        algorithm.run()
    algorithm.setComponents(both, ot.SymbolicFunction(["u", "v"], ["1e-12 * (u + v)"]))
    algorithm.run()
    assert algorithm.getResult().getConverged()


def test_an_error_inside_of_functions_is_told_without_their_tracebacks():
    def fail(x):
        raise ValueError("mass = -1 kg: a positive number is allowed")

    inner = ot.PythonFunction(1, 1, fail)
    outer = ot.PythonFunction(1, 1, lambda x: inner(x))
    with pytest.raises(RuntimeError) as error:
        outer([0.0])
    assert str(error.value).count("Traceback") > 1
    sentence = "mass = -1 kg: a positive number is allowed"
    assert errorMessage(error.value) == sentence
