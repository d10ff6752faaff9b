"""The truth set of contacts as separations of the package."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from satsep_ot.dynamics.contact import Contact, HoldDowns, Rails
from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.separation import Body, Pivot, Separation, Springs
from satsep_ot.dynamics.springs import ForceLaw

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


def law(given):
    """Stiffness, damping and friction as the truth set has them."""
    return {
        "stiffness": given["k"], "restitution": 1.0, "damping": given["damping"], "friction": given["mu"],
        "sliding_speed": given["v_eps"],
    }  # fmt: skip


def contact_separation(name, **changes):
    """A case of the truth set with its contacts."""
    inputs = CONTACT_CASES[name]["inputs"]
    contact, free = inputs.get("contact", {}), free_separation(name)
    springs, level, platform = free.springs, 0.0, free.platform
    lift, kick = inputs.get("lift", 0.0), np.array(inputs.get("satellite_kick", [0.0, 0.0, 0.0]))
    if lift:
        # The satellite's ring starts above the deck: the ring centre of both is where it starts.
        platform, level = replace(platform, center_of_mass=platform.center_of_mass - [0.0, lift, 0.0]), -lift
    offset = np.array(inputs["springs"].get("offset", [0.0, 0.0, 0.0]))
    if offset.any():
        seat = springs.seats()[0] + offset
        springs = replace(springs, radius=np.hypot(seat[0], seat[2]), angle=np.arctan2(seat[2], seat[0]))
    arguments = {}
    for pin in inputs.get("pins", []):
        assert pin["T_t"] == 1e-4
        springs = springs.joined(
            Springs(
                pin["angle"], pin["radius"], pin["k_t"], 0.0, pin["engagement"], scale=pin["force"],
                laws=[ForceLaw.FRICTION],
            )
        )  # fmt: skip
    if "deck" in contact:
        deck = contact["deck"]
        arguments["contact"] = Contact(
            deck["radius"], level, points=deck["points"], first_angle=deck["angle0"], **law(deck)
        )  # fmt: skip
    if "recess" in contact:
        recess = contact["recess"]
        arguments["contact"] = Contact(0.3, points=0, walls=True, **law(recess))
        arguments |= {
            "envelope": recess["points"], "recess_depth": recess["depth"], "recess_radius": recess["radius"],
            "recess_planes": [[*normal, level] for normal, level in recess["planes"]] or None,
        }  # fmt: skip
    if "rails" in contact:
        rails = contact["rails"]
        arguments["rails"] = Rails(
            rails["half_width"], rails["clearance"], rails["satellite_y"], rails["mouth_y"], **law(rails)
        )  # fmt: skip
    if inputs.get("hold_down"):
        bolts = inputs["hold_down"]
        places = np.array([bolt["point"] for bolt in bolts])
        arguments["hold_downs"] = HoldDowns(
            np.arctan2(places[:, 2], places[:, 0]), np.hypot(places[:, 0], places[:, 2]),
            [bolt["release"] for bolt in bolts], [bolt["k"] for bolt in bolts], 0.0, [bolt["T"] for bolt in bolts],
        )  # fmt: skip
    if kick.any():
        arguments |= kicked(platform, free.satellite, kick, np.array(inputs["omega0"]))
    return replace(free, platform=platform, springs=springs, **{**arguments, **changes})


def kicked(platform, satellite, kick, rates):
    """The impulses and rates that add a velocity to the satellite's and change nothing else of the relative motion.

    An impulse turns both bodies: rates and angular impulse are such that both turn as before.
    """
    c_1, c_2 = platform.center_of_mass, satellite.center_of_mass
    inverse = 1.0 / platform.mass + 1.0 / satellite.mass

    def motion(x):
        impulse, angular, Omega = x[:3], x[3:6], x[6:]
        omega_1 = Omega + np.linalg.solve(platform.inertia, np.cross(c_1, impulse) - angular)
        omega_2 = Omega + np.linalg.solve(satellite.inertia, angular - np.cross(c_2, impulse))
        return np.concatenate([np.cross(Omega, c_2 - c_1) + inverse * impulse, omega_1, omega_2])

    matrix = np.stack([motion(row) for row in np.eye(9)], axis=1)
    wanted = np.concatenate([np.cross(rates, c_2 - c_1) + kick, rates, rates])
    x = np.linalg.solve(matrix, wanted)
    return {"impulse": x[:3], "angular_impulse": x[3:6], "rates": x[6:]}
