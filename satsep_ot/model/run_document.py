"""One run of a case as a document: what `satsep-ot simulate --json` prints."""

import math
from collections.abc import Sequence

import numpy as np

from satsep_ot.dynamics.invariants import (
    angular_momentum,
    guide_loss,
    kinetic_energy,
    push_starts,
    spring_strokes,
    spring_work,
)
from satsep_ot.dynamics.kernels.records import STATE_SIZE
from satsep_ot.dynamics.quantities import quantity_table
from satsep_ot.dynamics.rotations import quaternion_product
from satsep_ot.dynamics.separation import Separation, Status
from satsep_ot.dynamics.simulation import contact_events, inertial_motion, simulate, trajectory
from satsep_ot.model.case import Case
from satsep_ot.model.inputs import umbilical_springs

LONGEST_TIME = 1000.0  # s after the start


def run_document(case: Case, times: Sequence[float] = (), tolerance: float = 1e-8) -> dict:
    """Simulate the nominal run of a case and say what came out, in SI units, radians and the quantities' own units.

    Parameters
    ----------
    case : Case
    times : sequence of float
        When the motion is wanted beside the last release [s after t = 0], in any order; from 0 to 1000.
    tolerance : float
        Relative accuracy of the run, from 1e-13 to 1e-2.

    Returns
    -------
    document : dict
        Made for JSON; None where a run that failed has no number. `at_last_release` and the elements of `at`, one for
        each time, hold t, dv_inertial (v_2 - v_1), dv_platform (the same in platform axes), dr_inertial (r_2 - r_1),
        w_sat and w_plat (in the body's own axes), q_sat and q_plat ([w, x, y, z], body to inertial).

    Raises
    ------
    ValueError
        If a time or the tolerance is not allowed.

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.run_document import run_document
    >>> document = run_document(load_case("reference"), times=[0.05])
    >>> print(document["status"], len(document["at"]), document["units"]["axial_velocity"])
    OK 1 m/s
    """
    times = [float(time) for time in times]
    for time in times:
        if not 0.0 <= time <= LONGEST_TIME:
            raise ValueError(f"time = {time} s; it must be between 0 and {LONGEST_TIME:g} s after the start")
    separation = case.separation
    outcome = simulate(separation, tolerance=tolerance)
    status = Status(int(outcome.status[0]))
    quantities = quantity_table(separation)
    at_last = float(outcome.base[0, STATE_SIZE]) if separation.has_contact() else np.nan
    events = [*push_starts(separation), *outcome.release_times[0]]
    stops = np.unique([0.0, *times, *(time for time in events if math.isfinite(time))])
    path = trajectory(separation, stops, tolerance=tolerance)
    # The flight to the last of the times may need more steps than there are, where the separation needed few.
    ending = status if status != Status.OK else Status(int(path.status))
    at = dict(zip(stops, path.states if ending == Status.OK else np.full_like(path.states, np.nan), strict=True))
    return {
        "case": case.name,
        "status": ending.name,
        "message": outcome.explain(0) if ending == status else f"the flight until {stops[-1]:g} s: {ending.sentence}",
        "tolerance": tolerance,
        "quantities": {name: _number(outcome.quantity(name)[0]) for name in quantities},
        "units": {name: quantity.unit for name, quantity in quantities.items()},
        "release_times": [_number(time) for time in outcome.release_times[0]],
        "at_last_release": _motion(
            at_last if math.isfinite(at_last) else np.nanmax(path.release_times, initial=0.0), path.last_release
        ),
        "at": [_motion(time, at[time]) for time in times],
        "energy": _energy(separation, path, at, tolerance),
        "angular_momentum": _momentum(separation, path),
        **_contacts(separation, tolerance),
    }


def _contacts(separation, tolerance):
    """The events of a separation with contact."""
    if not separation.has_contact():
        return {}
    return {
        "events": [
            {"t": event.time, "name": event.name, "what": event.what, "speed": event.speed}
            for event in contact_events(separation, tolerance=tolerance)
        ]
    }


def spring_names(separation: Separation) -> list[str]:
    """What a person calls each spring; the last ones may be those of umbilical connectors.

    Parameters
    ----------
    separation : :class:`satsep_ot.dynamics.separation.Separation`

    Returns
    -------
    names : list of str

    Examples
    --------
    >>> from satsep_ot.model.case import load_case
    >>> from satsep_ot.model.run_document import spring_names
    >>> spring_names(load_case("cubesat").separation)
    ['spring 1', 'spring 2']
    """
    names = [f"spring {number}" for number in range(1, len(separation.springs) + 1)]
    for number, i in enumerate(umbilical_springs(separation), start=1):
        names[i : i + 2] = [f"umbilical connector {number}", f"pins of connector {number}"]
    return names


def _energy(separation, path, at, tolerance):
    """The work of each spring on the bodies, the kinetic energy gained by the last release, and the difference [J].

    It is the error of the run, and what gravity did.
    """
    if not np.isfinite(path.last_release).all():
        return None

    def strokes_at(times):
        # A spring that has failed stays where it is.
        times = np.where(np.isnan(times), 0.0, times)
        return [spring_strokes(separation, at[time][None])[0, i] for i, time in enumerate(times)]

    work = spring_work(separation, strokes_at(push_starts(separation)), strokes_at(path.release_times))
    work -= guide_loss(separation, path.release_times, tolerance)
    start, end = kinetic_energy(separation, np.array([path.states[0], path.last_release]))
    if separation.has_contact():
        # The work of pins is not that of a constant force; it is in that of contact.
        work[separation.springs.law_property("holds_back") & (separation.springs.stiffness > 0.0)] = 0.0
        rest = end - start - work.sum()
        return {"spring_work": work.tolist(), "gained": end - start, "contact_work": rest, "error": None}
    return {"spring_work": work.tolist(), "gained": end - start, "error": end - start - work.sum()}


def _momentum(separation, path):
    """The angular momentum about the common CG at the start, and how far it has moved by the last release [N m s].

    Springs do not change it, gravity does.
    """
    if not np.isfinite(path.last_release).all():
        return None
    start, end = angular_momentum(separation, np.array([path.states[0], path.last_release]))
    change = np.linalg.norm(end - start)
    return {"at_start": start.tolist(), "change": float(change)} if np.isfinite(change) else None


def _number(value):
    return float(value) if math.isfinite(value) else None


def _motion(time, state):
    """The motion at one instant; None if the run did not get there."""
    if not np.isfinite(state).all():
        return None
    velocity, position = inertial_motion(state[None])
    vectors = {
        "dv_inertial": velocity[0],
        "dv_platform": state[3:6],
        "dr_inertial": position[0],
        "w_sat": state[9:12],
        "w_plat": state[6:9],
        "q_sat": quaternion_product(state[16:20], state[12:16]),
        "q_plat": state[16:20],
    }
    return {"t": float(time), **{name: vector.tolist() for name, vector in vectors.items()}}
