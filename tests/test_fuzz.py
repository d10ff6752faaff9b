"""Random damage to case files and random physical inputs: a result with a status, or one clear error, nothing else.

Warnings are errors in all tests, so that none passes here either.
"""

import copy
import faulthandler
import os
import random
import re
import tomllib
from collections import Counter

import numpy as np
import pytest
from case_mutations import EVERY_TABLE, damage_data, damage_text, written
from separation_cases import general_separation, mixed_springs

from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.relative_orbit import Recontact
from satsep_ot.dynamics.separation import Status
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.model.case import CaseError, load_case, parse_case, shipped_cases
from satsep_ot.model.inputs import joint_distribution
from satsep_ot.model.plausibility import plausibility_warnings
from satsep_ot.model.run_document import run_document
from satsep_ot.model.separation_function import SeparationError, SeparationFunction

pytestmark = pytest.mark.slow

TEXTS = {name: load_case(name).text for name in shipped_cases()} | {"every table": EVERY_TABLE}
MUTATIONS = 2000  # of each
PATIENCE = 100.0  # s after which a trial hangs


@pytest.fixture(scope="module")
def compiled():
    """All that trials run, compiled."""
    simulate_with_gradients(placed("mixed", ForceLine.NORMAL, "re-contact", "planes"))
    run_document(load_case("reference"))


@pytest.fixture
def guard(compiled, capfd):
    """Call it before each trial: a trial that hangs, in compiled code even, ends the tests with a traceback."""
    with capfd.disabled():
        stream = os.fdopen(os.dup(2), "w")
    yield lambda: faulthandler.dump_traceback_later(PATIENCE, exit=True, file=stream)
    faulthandler.cancel_dump_traceback_later()
    stream.close()


def damaged(name, generator):
    """The text of a case file with one or some things wrong."""
    if generator.random() < 0.25:
        text = TEXTS[name]
        for _ in range(generator.choice([1, 1, 2])):
            text = damage_text(text, generator)
        return text
    data = copy.deepcopy(tomllib.loads(TEXTS[name]))
    for _ in range(generator.choice([1, 1, 1, 2, 4])):
        damage_data(data, generator)
    return written(data)


def outcome_of(text, thoroughly):
    """What becomes of a case file: the name of a status, or "refused"."""
    try:
        case = parse_case(text, "mine.toml")
    except CaseError as error:
        message = str(error)
        assert message.startswith("mine.toml: ")
        assert message.isprintable()
        assert len(message) < 1500
        return "refused"
    outcome = simulate(case.separation)
    check_outcome(outcome)
    if case.inputs:
        joint_distribution(case.inputs, case.copula)
        # By quantiles: no random generator is touched, and the tails are met.
        points = [[row.distribution.computeQuantile(level)[0] for row in case.inputs] for level in (0.01, 0.6)]
        reason = values = None
        try:
            values = SeparationFunction(case).evaluate(points)
        except SeparationError as error:
            reason = str(error)
        assert np.isfinite(values).all() if reason is None else re.match(r"row \d could not be|\S+ = ", reason)
    if thoroughly:
        assert all(sentence.isprintable() for sentence in plausibility_warnings(case))
        assert run_document(case)["status"] == Status(outcome.status[0]).name
    return Status(outcome.status[0]).name


def check_outcome(outcome):
    """Every run has a status; one that finished has finite quantities, any other none at all and a sentence.

    How deep it sank is all that a run tells whose satellite sinks into the deck.
    """
    finished = outcome.status == Status.OK
    sunk = outcome.status == Status.PENETRATION
    for name in quantity_table(outcome.separation):
        values = outcome.quantity(name)
        assert np.isfinite(values[finished]).all(), name
        assert np.isnan(values[~finished & ~(sunk & (name == "deck_height"))]).all(), name
    springs = len(outcome.separation.springs.stiffness)
    assert outcome.steps.max() <= (60_000 if outcome.separation.has_contact() else 1000 + 310 * springs)
    for row in np.flatnonzero(~finished):
        sentence = outcome.explain(row)
        assert sentence.isprintable()
        assert (outcome.status[row] == Status.INVALID_PARAMETERS) == bool(re.search(" = |principal moments", sentence))


@pytest.mark.parametrize("name", TEXTS)
def test_cases_are_read_back_as_they_are_written(name):
    case, again = parse_case(TEXTS[name], "mine.toml"), parse_case(written(tomllib.loads(TEXTS[name])), "mine.toml")
    assert simulate(case.separation).status[0] == Status.OK
    np.testing.assert_array_equal(case.separation.parameters(), again.separation.parameters())
    assert (case.inputs, case.requirements) == (again.inputs, again.requirements)


@pytest.mark.parametrize("name", TEXTS)
def test_damaged_case_files(name, guard, capfd):
    generator = random.Random(f"damage to {name}")
    seen = Counter()
    for trial in range(MUTATIONS):
        guard()
        text = damaged(name, generator)
        try:
            seen[outcome_of(text, thoroughly=trial % 10 == 0)] += 1
        except Exception as error:
            error.add_note(f"trial {trial} of {name}:\n{text}")
            raise
    assert seen["refused"] > MUTATIONS / 3
    assert seen["OK"] > MUTATIONS / 20
    # What OpenTURNS says of a Student law without a variance is all that anything prints.
    printed = "".join(capfd.readouterr())
    assert not re.sub(r".*the covariance of the distribution will not be defined.*\n", "", printed)


def placed(spring_choice, force_line, gravity, walls):
    """A separation with the springs, the force line, the gravity and the recess asked for."""
    changes = dict(springs=mixed_springs()) if spring_choice == "mixed" else {}
    if not gravity:
        changes |= dict(orbit=None, gradient_torque=False)
    if gravity == "re-contact":
        changes |= dict(recontact=Recontact(0.1, 0.2))
    if walls == "planes":
        changes |= dict(recess_radius=0.0, recess_planes=[[-1.0, 0.05, 0.0, -0.36], [0.3, 0.0, 1.0, -0.5]])
    if walls is None:
        changes |= dict(envelope=None)
    return general_separation(force_line, **changes)


SETTINGS = [
    ("linear", ForceLine.GUIDED, None, None),
    ("linear", ForceLine.STRUT, "orbit", "cylinder"),
    ("linear", ForceLine.NORMAL, "re-contact", "planes"),
    ("mixed", ForceLine.GUIDED, "re-contact", "cylinder"),
    ("mixed", ForceLine.STRUT, None, "planes"),
    ("mixed", ForceLine.NORMAL, "orbit", "cylinder"),
]
ROWS = 2000  # of each


def absurd_rows(separation, generator):
    """Parameter vectors with one, some or all parameters beyond sense, or beyond what a float holds."""
    rows = np.tile(separation.parameters(), (ROWS, 1))
    special = [0.0, -0.0, np.nan, np.inf, -np.inf, 1e308, -1e308, 5e-324, 1e-160, 1e160, 1e16, -1.0]
    for row in rows:
        chosen = generator.random(row.size) < generator.choice([1.0 / row.size, 3.0 / row.size, 0.3, 1.0])
        how = generator.integers(4)
        count = np.count_nonzero(chosen)
        if how == 0:
            row[chosen] = generator.choice(special, count)
        elif how == 1:
            row[chosen] *= 10.0 ** generator.uniform(-9.0, 9.0, count) * generator.choice([1.0, 1.0, 1.0, -1.0], count)
        elif how == 2:
            row[chosen] *= 10.0 ** (generator.choice([0.03, 0.3, 1.0, 70.0]) * generator.uniform(-4.0, 4.0, count))
        else:
            row[chosen] += 10.0 ** generator.uniform(-9.0, 3.0, count) * generator.normal(size=count)
    return rows


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda setting: "-".join(map(str, setting)))
def test_absurd_runs(setting, guard, capfd):
    separation = placed(*setting)
    generator = np.random.default_rng([*map(ord, str(setting))])
    rows = absurd_rows(separation, generator)
    guard()
    outcome = simulate(separation, rows)
    check_outcome(outcome)
    with_gradients = simulate_with_gradients(separation, rows)
    np.testing.assert_array_equal(with_gradients.status, outcome.status)
    np.testing.assert_array_equal(with_gradients.base, outcome.base)
    finished = outcome.status == Status.OK
    for name in quantity_table(separation):
        gradients = with_gradients.quantity_gradient(name)
        assert np.isfinite(gradients[finished]).all(), name
        if name != "deck_height":
            assert np.isnan(gradients[~finished]).all(), name
    assert {Status.OK, Status.INVALID_PARAMETERS, Status.PENETRATION} <= set(outcome.status)
    assert not "".join(capfd.readouterr())
