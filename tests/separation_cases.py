"""Separations that several tests use."""

import json
import re
from pathlib import Path

import numpy as np

from satsep_ot.dynamics.orbit import Orbit
from satsep_ot.dynamics.separation import Body, ForceLine, Pivot, Separation, Springs, umbilical

TRUTH = json.loads((Path(__file__).parent / "data" / "separation_truth.json").read_text(encoding="utf-8"))
TRUTH_CASES = {case["name"]: case for case in TRUTH["cases"]}
SQUARE = np.pi * np.array([1.0, 3.0, 5.0, 7.0]) / 4.0
BOX = np.array([[0.35 * a, y, 0.35 * b] for a in (-1, 1) for b in (-1, 1) for y in (0.0, 0.8)])


def symmetric_separation(**changes):
    """The means of the reference case: 16.5 J in four springs, no offsets."""
    arguments = {
        "platform": Body(1200.0, [1500.0, 600.0, 1500.0], [0.0, -1.6, 0.0]),
        "satellite": Body(100.0, [9.35, 8.0, 9.35], [0.0, 0.4, 0.0]),
        "springs": Springs(angle=SQUARE, radius=0.3, stiffness=5500.0, deformation=0.04, stroke=0.03),
    }
    return Separation(**{**arguments, **changes})


def general_separation(force_line=ForceLine.GUIDED, **changes):
    """Nothing symmetric, nothing zero: every parameter matters."""
    arguments = {
        "platform": Body(1200.0, [[1500.0, 20.0, -15.0], [20.0, 600.0, 9.0], [-15.0, 9.0, 1450.0]], [0.01, -1.6, 0.02]),
        "satellite": Body(100.0, [[9.35, 0.1, -0.2], [0.1, 8.0, 0.15], [-0.2, 0.15, 9.1]], [0.002, 0.4, -0.003]),
        "springs": Springs(
            angle=SQUARE + np.array([0.01, -0.02, 0.0, 0.03]),
            radius=[0.3, 0.301, 0.299, 0.3],
            stiffness=[5500.0, 5400.0, 5620.0, 5580.0],
            deformation=[0.04, 0.0402, 0.0397, 0.0401],
            stroke=[0.03, 0.0303, 0.0297, 0.03],
            cant=[0.004, -0.006, 0.003, 0.002],
            delay=[1.1e-3, 0.2e-3, 0.0, 1.7e-3],
        ),
        "force_line": force_line,
        "stowed_length": 0.04 if force_line == ForceLine.STRUT else 0.0,
        "guide_friction": 0.15 if force_line == ForceLine.NORMAL else 0.0,
        "impulse": [0.4, -1.1, 0.7],
        "angular_impulse": [0.02, -0.03, 0.05],
        "attitude": [0.8, 0.2, -0.5, 0.3],
        "rates": np.radians([0.2, -0.3, 0.15]),
        "mounting_error": [1e-3, -2e-3, 1.5e-3],
        "orbit": Orbit([6.878e6, 1.0e5, -2.0e5], [100.0, 7500.0, 900.0]),
        "gradient_torque": True,
        "envelope": BOX,
        "recess_radius": 0.52,
        "recess_depth": 0.25,
    }
    return Separation(**{**arguments, **changes})


def mixed_springs():
    """Linear springs, measured tables, an umbilical connector and a spring that has failed."""
    stroke = np.linspace(0.0, 0.032, 6)
    table = np.stack([stroke, 210.0 - 3000.0 * stroke - 4e4 * stroke**2], axis=1)
    springs = Springs(
        angle=np.append(SQUARE, 1.0),
        radius=0.3,
        stiffness=[5500.0, 0.0, 5620.0, 0.0, 5500.0],
        deformation=[0.04, 0.0, 0.0397, 0.0, 0.04],
        stroke=[0.03, 0.0303, 0.0297, 0.03, 0.03],
        cant=0.003,
        delay=[1.1e-3, 0.2e-3, 0.4e-3, 1.7e-3, 0.0],
        scale=[1.0, 1.01, 1.0, 0.97, 0.0],
        tables=[None, table, None, table * [1.0, 1.05], None],
    )
    return springs.joined(umbilical(0.4, 0.22, 1500.0, 0.008, 0.0075, friction=18.0, engagement=0.006))


def truth_separation(case, force_line):
    """The separation of a truth case, by its name and "guided" or "strut"."""
    inputs, stowed = TRUTH_CASES[case]["inputs"], TRUTH_CASES[case]["results"][force_line]["stowed_length"]
    platform, satellite = (
        Body(inputs[body]["mass"], np.array(inputs[body]["inertia"]), inputs[body]["cg"])
        for body in ("platform", "satellite")
    )
    springs, gravity = inputs["springs"], inputs["gravity"]
    orbit = None
    if gravity is not None:
        orbit = Orbit(gravity["r_eci"], np.array(gravity["v_eci"]) + inputs["velocity0"], gravity["mu"])
    return Separation(
        platform,
        satellite,
        Springs(springs["alpha"], springs["R"], springs["K"], springs["xi"], springs["L"]),
        ForceLine[force_line.upper()],
        stowed_length=stowed,
        attitude=inputs["attitude0"],
        rates=inputs["omega0"],
        pivot=Pivot.PLATFORM,
        orbit=orbit,
        gradient_torque=bool(gravity and gravity["gradient"]),
    )


def truth_parameters(name, spring_number):
    """The flat parameters that an input of the truth set's gradients moves."""
    body = re.fullmatch(r"(platform|satellite)\.(inertia|cg)\[(\d)\]", name)
    spring = re.fullmatch(r"springs\.(alpha|K|xi|L)\[(\d)\]", name)
    if body:
        owner, what, axis = body.groups()
        axis = "xyz"[int(axis)]
        return [f"{owner}.inertia.{axis}{axis}" if what == "inertia" else f"{owner}.center_of_mass.{axis}"]
    if spring:
        names = {"alpha": "angle", "K": "stiffness", "xi": "deformation", "L": "stroke"}
        return [f"springs[{spring[2]}].{names[spring[1]]}"]
    if name == "springs.R":
        return [f"springs[{i}].radius" for i in range(spring_number)]
    if name.startswith("omega0"):
        return [f"rates.{'xyz'[int(name[-2])]}"]
    return [{"l_c": "stowed_length"}.get(name, name)]
