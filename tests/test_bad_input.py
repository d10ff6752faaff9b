"""What makes no sense is an error or the status of a run, by name: no hang, and no NaN that looks like a number."""

import re

import numpy as np
import pytest
from case_mutations import EVERY_TABLE
from separation_cases import BOX, SQUARE, general_separation, mixed_springs, symmetric_separation

from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.quantities import base_fields
from satsep_ot.dynamics.relative_orbit import Recontact
from satsep_ot.dynamics.separation import Body, Springs, Status, invalid_parameter, umbilical
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients, trajectory
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.model.case import CaseError, load_case, parse_case
from satsep_ot.model.separation_function import SeparationError, SeparationFunction

NAN, INF = float("nan"), float("inf")
CONNECTOR = dict(angle=0.0, radius=0.2, stiffness=1e3, deformation=8e-3, stroke=6e-3, friction=10.0, engagement=5e-3)


def springs(**changes):
    return Springs(**{**dict(angle=SQUARE, radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03), **changes})


def measured(rows):
    return symmetric_separation(springs=springs(stiffness=0.0, deformation=0.0, tables=[rows] * 4))


def in_recess(**changes):
    return symmetric_separation(**{**dict(envelope=BOX, recess_radius=0.52, recess_depth=0.25), **changes})


def second(value):
    return [1.0, value, 1.0, 1.0]


# What is given a value, the name that the error must hold, and the values that make no sense there.
NEVER, POSITIVE, NOT_NEGATIVE = (NAN, INF, -INF), (NAN, INF, -INF, 0.0, -1.0), (NAN, INF, -INF, -1.0)
INTERFACE = {
    "satellite.mass": (lambda v: symmetric_separation(satellite=Body(v, [1.0, 1.0, 1.0])), POSITIVE),
    "inertia": (lambda v: symmetric_separation(satellite=Body(1.0, [1.0, v, 1.0])), POSITIVE),
    "platform.center_of_mass.x": (
        lambda v: symmetric_separation(platform=Body(1.0, [1.0, 1.0, 1.0], [v, 0.0, 0.0])), NEVER
    ),
    **{
        f"springs[1].{key}": (lambda v, key=key: symmetric_separation(springs=springs(**{key: second(v)})), values)
        for key, values in (
            ("angle", NEVER), ("radius", NOT_NEGATIVE), ("stiffness", POSITIVE), ("deformation", POSITIVE),
            ("stroke", POSITIVE), ("cant", NEVER), ("delay", NOT_NEGATIVE), ("scale", NOT_NEGATIVE),
        )
    },
    **{
        f"springs[{i}].{name}": (
            lambda v, key=key: symmetric_separation(springs=springs().joined(umbilical(**{**CONNECTOR, key: v}))),
            values,
        )
        for i, name, key, values in (
            (4, "radius", "radius", NOT_NEGATIVE), (4, "stiffness", "stiffness", POSITIVE),
            (4, "deformation", "deformation", POSITIVE), (4, "stroke", "stroke", POSITIVE),
            (5, "stroke", "engagement", POSITIVE),
        )
    },
    "friction": (lambda v: umbilical(**{**CONNECTOR, "friction": v}), NOT_NEGATIVE),
    **{
        f"{key}.y": (lambda v, key=key: symmetric_separation(**{key: [0.0, v, 0.0]}), NEVER)
        for key in ("rates", "mounting_error", "impulse", "angular_impulse")
    },
    "attitude": (lambda v: symmetric_separation(attitude=[v] * 4), (*NEVER, 0.0)),
    "horizon": (lambda v: symmetric_separation(horizon=v), POSITIVE),
    # Coincident seats: a strut of no length has no direction.
    "stowed_length": (lambda v: symmetric_separation(force_line=ForceLine.STRUT, stowed_length=v), POSITIVE),
    "guide_friction": (lambda v: symmetric_separation(force_line=ForceLine.NORMAL, guide_friction=v), NOT_NEGATIVE),
    "recess": (lambda v: in_recess(recess_radius=v), POSITIVE),
    "envelope": (lambda v: in_recess(envelope=[[0.0, v, 0.0]]), (*NEVER, -1.0)),
    "recess_planes": (lambda v: in_recess(recess_planes=[[v, 0.0, 0.0, -0.5]]), (*NEVER, 0.0)),
    "position": (lambda v: Orbit([v, 0.0, 0.0], [0.0, 7.5e3, 0.0]), (*NEVER, 0.0)),
    "velocity": (lambda v: Orbit([7e6, 0.0, 0.0], [0.0, v, 0.0]), NEVER),
    "mu": (lambda v: Orbit([7e6, 0.0, 0.0], [0.0, 7.5e3, 0.0], v), POSITIVE),
    "re-contact": (lambda v: Recontact(0.1, v), POSITIVE),
    "springs.tables[0]": (lambda v: measured([[0.0, 200.0], [v, 100.0], [0.03, 50.0]]), POSITIVE),
    "tolerance": (lambda v: simulate(symmetric_separation(), tolerance=v), POSITIVE),
    "times": (lambda v: trajectory(symmetric_separation(), [v]), NOT_NEGATIVE),
}  # fmt: skip


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, (_, values) in INTERFACE.items() for value in values]
)
def test_python_interface(name, value):
    with pytest.raises(ValueError, match=re.escape(name)) as caught:
        INTERFACE[name][0](value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([[0.0, 200.0], [0.02, 90.0], [0.01, 50.0], [0.03, 9.0]], "stroke 0.01 m follows 0.02 m; strokes must ascend"),
        ([[0.0, 200.0], [0.01, 90.0], [0.01, 50.0], [0.03, 9.0]], "stroke 0.01 m follows 0.01 m; strokes must ascend"),
        ([[0.0, 200.0], [0.02, 90.0]], "goes from 0.0 to 0.02 m; it must cover 0 to 0.03 m"),
        ([[0.01, 200.0], [0.03, 90.0]], "goes from 0.01 to 0.03 m"),
        ([[0.0, 200.0]], "two or more"),
        ([0.0, 200.0], "two or more"),
    ],
)
def test_tables_of_the_python_interface(rows, words):
    with pytest.raises(ValueError, match=re.escape(words)):
        measured(rows)


def test_no_spring_at_all():
    with pytest.raises(ValueError, match="at least 1"):
        symmetric_separation(springs=springs(angle=[]))
    outcome = simulate(symmetric_separation(springs=springs(scale=0.0)))
    assert outcome.status[0] == Status.NO_SPRING
    assert outcome.explain(0) == "every spring has failed: nothing pushes the bodies apart"
    assert np.isnan(outcome.base[0]).all()


# Not finite: refused by name. Beyond all sense: a run with finite numbers, or a status.
VALUES = (NAN, INF, -INF, 0.0, -1.0, 1e6, 9e29, -9e29, 1e30, -1e30)


@pytest.mark.parametrize("force_line", ForceLine)
def test_every_parameter_of_a_run_at_every_absurd_value(force_line):
    separation = general_separation(
        force_line, springs=mixed_springs(), recess_planes=[[-1.0, 0.05, 0.0, -0.36]], recontact=Recontact(0.1, 0.2)
    )
    names, count = separation.parameter_names(), len(VALUES)
    rows = np.repeat(separation.parameters()[None], len(names) * count, axis=0)
    for i in range(len(names)):
        rows[i * count : (i + 1) * count, i] = VALUES
    outcome = simulate(separation, rows)
    finished = outcome.status == Status.OK
    # The kernels refuse what Python names, and nothing else.
    named = [invalid_parameter(separation, row) is not None for row in rows]
    np.testing.assert_array_equal(outcome.status == Status.INVALID_PARAMETERS, named)
    assert np.isfinite(outcome.base[finished]).all()
    sunk = outcome.status == Status.PENETRATION
    assert np.isnan(outcome.base[~finished & ~sunk]).all()
    # How deep it sank is all that such a run tells.
    depths = outcome.base[sunk][:, base_fields(separation).index("deck_height")]
    assert (depths < -1e-4).all()
    assert np.isnan(outcome.base[sunk]).sum() == np.count_nonzero(sunk) * (outcome.base.shape[1] - 1)
    # Each spring may take steps more for its guide friction, and for the knots of its table.
    assert outcome.steps.max() <= 1000 + 310 * len(separation.springs.stiffness)
    for row in np.flatnonzero(~finished):
        name, value = names[row // count], VALUES[row % count]
        if not abs(value) < 1e30:
            assert outcome.explain(row) == f"{name} = {value}; it must be a finite number of size below 1e+30"
        elif outcome.status[row] == Status.INVALID_PARAMETERS:
            assert name.split(".")[0].split("[")[0] in outcome.explain(row), (name, value)
            assert outcome.explain(row) != Status.INVALID_PARAMETERS.sentence
    assert {Status.INVALID_PARAMETERS, Status.TOO_MANY_STEPS, Status.PENETRATION} <= set(outcome.status)
    # The neighbours of a bad row are what they are alone, and so are its gradients.
    sample = rows[:: 2 * count + 1][:40]
    together = simulate_with_gradients(separation, sample, ["rate_x"])
    gradients = together.quantity_gradient("rate_x")
    good = together.status == Status.OK
    assert good.any()
    assert not good.all()
    assert np.isfinite(gradients[good]).all()
    assert np.isnan(gradients[~good]).all()


@pytest.mark.parametrize("rate", [1e6, 1e12, 1e29])
@pytest.mark.parametrize("force_line", ForceLine)
def test_a_million_degrees_a_second(force_line, rate):
    stowed = 0.04 if force_line == ForceLine.STRUT else 0.0
    separation = in_recess(rates=np.radians([rate, -rate, rate]), force_line=force_line, stowed_length=stowed)
    outcome = simulate(separation)
    assert outcome.steps[0] <= 1000
    assert np.isfinite(outcome.base[0]).all() == (outcome.status[0] == Status.OK)
    assert outcome.explain(0) == Status(outcome.status[0]).sentence


def test_a_recess_that_is_none():
    """A run whose recess has no depth or no wall is no run, as it is no separation."""
    separation = in_recess()
    rows = np.tile(separation.parameters(), (5, 1))
    names = separation.parameter_names()
    rows[:4, names.index("recess_radius")] = [0.0, -0.1, 0.52, 0.52]
    rows[:4, names.index("recess_depth")] = [0.25, 0.25, 0.0, -0.1]
    outcome = simulate(separation, rows)
    assert outcome.status.tolist() == [Status.INVALID_PARAMETERS] * 4 + [Status.OK]
    assert outcome.explain(1) == "recess_radius = -0.1; it must be positive"
    assert outcome.explain(3) == "recess_depth = -0.1; it must be positive"


def test_forces_too_large_for_the_resolution_of_time():
    """A push that would be over within 1e-15 s is not taken for one that did no work."""
    separation = general_separation()
    rows = np.tile(separation.parameters(), (2, 1))
    names = separation.parameter_names()
    rows[0, [names.index("springs[0].scale"), names.index("springs[0].stiffness")]] = 1e29
    outcome = simulate(separation, rows)
    assert outcome.status.tolist() == [Status.STEP_UNDERFLOW, Status.OK]


def test_gradients_beside_a_run_that_is_too_violent():
    """What a run leaves in the memory that the runs share never reaches another run."""
    separation = general_separation(ForceLine.STRUT)
    names = separation.parameter_names()
    rows = np.tile(separation.parameters(), (3, 1))
    rows[2, [names.index("platform.mass"), names.index("angular_impulse.x")]] = 5e-324, 1e16
    outcome = simulate_with_gradients(separation, rows, ["rate_x"])
    alone = simulate_with_gradients(separation, quantities=["rate_x"]).quantity_gradient("rate_x")[0]
    assert outcome.status[2] != Status.OK
    assert np.isnan(outcome.quantity_gradient("rate_x")[2]).all()
    for row in (0, 1):
        np.testing.assert_array_equal(outcome.quantity_gradient("rate_x")[row], alone)


def test_a_sample_names_row_input_and_value():
    function = SeparationFunction("reference", quantities=["rate_x"])
    mean = np.array([row.reference for row in load_case("reference").inputs])
    sample = np.tile(mean, (4, 1))
    sample[2, 5] = np.nan
    with pytest.raises(SeparationError, match="stage_Ixx = nan in row 2"):
        function.evaluate(sample)
    sample[2, 5] = mean[5]
    sample[3, 0] = -100.0
    for evaluate in (function.evaluate, function.computeGradientSample):
        with pytest.raises(SeparationError, match=r"row 3 .*satellite\.mass = -100\.0.*satellite_mass = -100 kg"):
            evaluate(sample)


CASE = EVERY_TABLE.partition("[inputs]")[0]
NUMBERS = [
    (line.split(" = ")[0], start + match.start(), start + match.end())
    for line, start in ((m.group(), m.start()) for m in re.finditer("^.* = .*$", CASE, re.MULTILINE))
    for match in re.finditer(r"-?\d+\.\d+", line)
]


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", '"1.0"', "true", "[]", "1e400"])
def test_every_number_of_a_case_file(value):
    """Whatever stands in its place is refused in one sentence that names the key."""
    assert len(NUMBERS) > 60
    for key, start, end in NUMBERS:
        text = CASE[:start] + value + CASE[end:]
        with pytest.raises(CaseError) as caught:
            parse_case(text, "mine.toml")
        message = str(caught.value)
        assert message.startswith("mine.toml: ")
        assert key in message, (key, message)
        assert "\n" not in message


def parsed(text):
    """Why a case is refused, or its separation."""
    try:
        return None, parse_case(text, "mine.toml").separation
    except CaseError as error:
        return str(error), None


@pytest.mark.parametrize("value", ["0.0", "-1.0", "-1e29", "1e29", "1e-29"])
def test_every_number_of_a_case_file_at_its_extremes(value):
    """Refused in one sentence that names the key, or a run with finite numbers or a status."""
    seen = set()
    for key, start, end in NUMBERS:
        text = CASE[:start] + value + CASE[end:]
        message, separation = parsed(text)
        if separation is None:
            assert message.startswith("mine.toml: ")
            assert "\n" not in message
            seen.add("refused")
            continue
        outcome = simulate(separation)
        finite = np.isfinite(outcome.base[0]).all()
        assert finite == (outcome.status[0] == Status.OK), key
        assert finite or outcome.explain(0)
        seen.add("finished" if finite else "failed")
    assert {"refused", "finished"} <= seen
