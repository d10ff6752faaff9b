"""The truth set of contacts as separations of the package."""

import json
from pathlib import Path

import numpy as np

from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.separation import Body, Pivot, Separation, Springs

CONTACT_TRUTH = json.loads((Path(__file__).parent / "data" / "contact_truth.json").read_text(encoding="utf-8"))
CONTACT_CASES = {case["name"]: case for case in CONTACT_TRUTH["cases"]}


def free_separation(name, **changes):
    """A case of the truth set without its contacts."""
    inputs = CONTACT_CASES[name]["inputs"]
    springs, gravity = inputs["springs"], inputs["gravity"]
    scale = np.ones(len(springs["K"]))
    scale[springs["failed"]] = 0.0
    orbit = None
    if gravity is not None:
        orbit = Orbit(gravity["r_eci"], np.array(gravity["v_eci"]) + inputs["velocity0"], gravity["mu"])
    arguments = {
        **{
            body: Body(inputs[body]["mass"], np.array(inputs[body]["inertia"]), inputs[body]["cg"])
            for body in ("platform", "satellite")
        },
        "springs": Springs(
            springs["alpha"], springs["R"], springs["K"], springs["xi"], springs["L"], scale=scale,
            delay=springs.get("delay", 0.0),
        ),
        "attitude": inputs["attitude0"],
        "rates": inputs["omega0"],
        "pivot": Pivot.PLATFORM,
        "orbit": orbit,
        "gradient_torque": bool(gravity and gravity["gradient"]),
    }  # fmt: skip
    return Separation(**{**arguments, **changes})
