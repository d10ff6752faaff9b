"""What an algorithm takes for an event, and what it refuses before it has begun."""

import openturns as ot
import pytest

from satsep_ot.methods.comparison import ReliabilityComparison
from satsep_ot.methods.limit_state_event import LimitStateEvent, checkedKind
from satsep_ot.methods.reliability import ActiveSubspaceReliability

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
