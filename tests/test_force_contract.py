"""What every force law owes on every force line: a law or a line that is added is picked up here by itself."""

import numpy as np
import pytest
from separation_cases import general_separation

from satsep_ot.dynamics.invariants import (
    angular_momentum,
    guide_loss,
    kinetic_energy,
    push_starts,
    spring_strokes,
    spring_work,
)
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.separation import Springs, Status
from satsep_ot.dynamics.simulation import simulate, simulate_with_gradients, trajectory
from satsep_ot.dynamics.springs import ForceLaw, ForceLine

# What a spring of a law needs beside its seat, its stroke and its scale; a new law needs nothing.
NEEDS = {
    ForceLaw.LINEAR: dict(stiffness=4000.0, deformation=0.035),
    ForceLaw.TABLE: dict(tables=[[[0.0, 180.0], [0.008, 171.0], [0.02, 90.0], [0.03, 40.0]]]),
    ForceLaw.FRICTION: dict(scale=15.0),
}
CONTRACTS = [(law, line) for law in ForceLaw for line in ForceLine]


def separation_with(law, line, **changes):
    """Four linear springs that push apart, and one of the law off-centre."""
    given = {**dict(stiffness=0.0, deformation=0.0, scale=1.1, cant=0.01, delay=4e-4), **NEEDS.get(law, {})}
    if law == ForceLaw.FRICTION:
        given |= dict(cant=0.0, delay=0.0)
    spring = Springs([0.3], radius=0.2, stroke=0.025, laws=[law], **given)
    return general_separation(line, springs=general_separation().springs.joined(spring), **changes)


@pytest.mark.parametrize(("law", "line"), CONTRACTS)
def test_energy_is_work_and_angular_momentum_stays(law, line):
    separation = separation_with(law, line, orbit=None, gradient_torque=False)
    releases = trajectory(separation, [], tolerance=1e-12).release_times
    times = np.unique([0.0, *push_starts(separation), *releases])
    path = trajectory(separation, times, tolerance=1e-12)
    assert path.status == Status.OK
    strokes = spring_strokes(separation, path.states)
    start, end = (
        [strokes[np.searchsorted(times, time), i] for i, time in enumerate(instants)]
        for instants in (push_starts(separation), releases)
    )
    work = spring_work(separation, start, end)
    assert work[-1] != 0.0
    work -= guide_loss(separation, releases, tolerance=1e-12)
    energy = kinetic_energy(separation, path.states)
    assert energy[-1] - energy[0] == pytest.approx(work.sum(), rel=1e-9)
    momentum = angular_momentum(separation, path.states)
    assert np.linalg.norm(momentum[-1] - momentum[0]) < 1e-10 * np.linalg.norm(momentum[0])


@pytest.mark.parametrize(("law", "line"), CONTRACTS)
def test_gradients_against_differences(law, line):
    """Every quantity with respect to every number of the spring that it takes."""
    separation = separation_with(law, line)
    names, nominal = separation.parameter_names(), separation.parameters()
    varied = [i for i, name in enumerate(names) if name.startswith("springs[4].") and nominal[i] != 0.0]
    steps = 1e-4 * np.abs(nominal[varied])
    rows = np.repeat(nominal[None], 2 * len(varied), axis=0)
    for k, i in enumerate(varied):
        rows[2 * k : 2 * k + 2, i] += [steps[k], -steps[k]]
    around, outcome = simulate(separation, rows, tolerance=1e-13), simulate_with_gradients(separation, tolerance=1e-12)
    assert (around.status == Status.OK).all()
    for name in quantity_table(separation):
        values = around.quantity(name).reshape(-1, 2)
        change = outcome.quantity_gradient(name)[0, varied] * steps
        difference = 0.5 * (values[:, 0] - values[:, 1])
        # Coordinates of some metres are rounded to 2e-13 mm.
        largest = max(1e-6 * np.abs(difference).max(), 1e-12 * (name == "deck_height"))
        np.testing.assert_allclose(change, difference, rtol=1e-5, atol=largest, err_msg=name)


@pytest.mark.parametrize(("law", "line"), CONTRACTS)
def test_numbers_are_finite_over_a_wide_scatter(law, line):
    separation = separation_with(law, line)
    rng = np.random.default_rng(1)
    rows = separation.parameters() * (1.0 + 0.02 * rng.standard_normal((200, separation.parameters().size)))
    outcome = simulate_with_gradients(separation, rows)
    finished = outcome.status == Status.OK
    assert finished.mean() > 0.9
    assert np.isfinite(outcome.base[finished]).all()
    assert np.isfinite(outcome.gradients[finished]).all()
    assert (np.diff(np.sort(outcome.release_times[finished], axis=1)) >= 0.0).all()
