"""How a run can end."""

import enum

from satsep_ot.dynamics.kernels.compilation import integers


class Status(enum.IntEnum):
    """How a run ended; `sentence` says it in words."""

    OK = 0
    NO_RELEASE = 1
    NO_EXIT = 2
    STEP_UNDERFLOW = 3
    TOO_MANY_STEPS = 4
    PENETRATION = 5
    INVALID_PARAMETERS = 6
    NO_SPRING = 7
    STUCK = 8
    TOO_MANY_EVENTS = 9

    @property
    def sentence(self) -> str:
        return _SENTENCES[self]


_SENTENCES = {
    Status.OK: "the separation completed",
    Status.NO_RELEASE: "a spring was not released within the horizon",
    Status.NO_EXIT: "an envelope point did not leave the recess within the horizon",
    Status.STEP_UNDERFLOW: (
        "no step of any length had an error that is allowed: the motion is not finite, or far too quick"
    ),
    Status.TOO_MANY_STEPS: (
        "all steps that a run may take were used up before its end: give a shorter horizon, or a larger tolerance"
    ),
    Status.PENETRATION: (
        "the satellite sinks more than 0.1 mm below the deck, where nothing stops it: the case has no contact"
    ),
    Status.INVALID_PARAMETERS: "a parameter is not finite or not physical",
    Status.NO_SPRING: "every spring has failed: nothing pushes the bodies apart",
    Status.STUCK: "the satellite is stuck: something still pushes or holds, and nothing moves any more",
    Status.TOO_MANY_EVENTS: "the motion had more than 500 events: the bodies rattle against each other",
}

# For the kernels, which take plain integers as constants.
(
    OK,
    NO_RELEASE,
    NO_EXIT,
    STEP_UNDERFLOW,
    TOO_MANY_STEPS,
    PENETRATION,
    INVALID_PARAMETERS,
    NO_SPRING,
    STUCK,
    TOO_MANY_EVENTS,
) = integers(*Status)
