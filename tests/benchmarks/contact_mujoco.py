"""Contact beside MuJoCo, whose contacts are nearly rigid, on five cases of the truth set.

    pip install mujoco    # 3.x; the package itself does not need it
    python tests/benchmarks/contact_mujoco.py

MuJoCo has its own model of contact (constraints with a compliance, here as stiff as ten of its steps allow, and no
rebound) and its own bolt (an equality constraint); springs are forces on its bodies. Its steps are of 1e-5 s, with the
forces held within each, so that it errs by some 1e-4. What it shares with the package are masses, places and the
springs' law. Its friction depends on its own settings: with `impratio`, `solimp` and the cone varied the rate of the
case of 500 mm with friction is 40.4 to 41.2 deg/s. Here they are its defaults, but for the elliptic cone.
"""

import platform
import sys
from importlib import metadata
from pathlib import Path

import mujoco
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from contact_cases import CONTACT_CASES, contact_separation

from satsep_ot.dynamics.simulation import trajectory

CASES = (
    "deck_1of3_e03", "deck_1of3_e03_friction", "deck_2of4_R500_e05_friction", "deck_3of4_R400_e03",
    "hold_1of4_late_20ms",
)  # fmt: skip
STEP = 1e-5  # s
SPHERE = 1e-5  # radius of the spheres that stand for points [m]


def numbers(values):
    return " ".join(f"{value:.17g}" for value in values)


def model_of(inputs):
    """The two bodies; their frames are those of their ring centres."""
    deck = inputs["contact"]["deck"]
    angles = deck["angle0"] + 2.0 * np.pi * np.arange(deck["points"]) / deck["points"]
    feet = np.stack([np.cos(angles), 0.0 * angles, np.sin(angles)], axis=1) * deck["radius"] + [0.0, SPHERE, 0.0]
    surface = f'condim="{3 if deck["mu"] else 1}" friction="{deck["mu"]} 0 0" solref="{10 * STEP} 1"'

    def inertial(body):
        J = np.array(inputs[body]["inertia"], dtype=float)
        J = np.diag(J) if J.ndim == 1 else J
        full = numbers([J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]])
        return f'<inertial pos="{numbers(inputs[body]["cg"])}" mass="{inputs[body]["mass"]}" fullinertia="{full}"/>'

    spheres = "".join(f'<geom type="sphere" size="{SPHERE}" pos="{numbers(foot)}" {surface}/>' for foot in feet)
    bolts = "".join(
        f'<connect body1="satellite" body2="platform" anchor="{numbers(bolt["point"])}" solref="{10 * STEP} 1" '
        'solimp="0.9999 0.9999 1e-6"/>'
        for bolt in inputs.get("hold_down", [])
    )
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="{STEP}" gravity="0 0 0" cone="elliptic" tolerance="1e-12"/>
  <worldbody>
    <body name="platform"><freejoint/>{inertial("platform")}
      <geom type="box" size="2 0.5 2" pos="0 -0.5 0" {surface}/></body>
    <body name="satellite"><freejoint/>{inertial("satellite")}{spheres}</body>
  </worldbody>
  <equality>{bolts}</equality>
</mujoco>""")


def fly(inputs, end):
    """Velocity of the satellite against the platform, in its axes, and the satellite's rates, at `end` [s]."""
    model = model_of(inputs)
    data = mujoco.MjData(model)
    springs = inputs["springs"]
    radius = np.broadcast_to(springs["R"], len(springs["K"]))
    seats = np.stack([radius * np.cos(springs["alpha"]), 0.0 * radius, radius * np.sin(springs["alpha"])], axis=1)
    pushing = np.ones(len(seats), bool)
    pushing[springs["failed"]] = False
    K, xi = np.array(springs["K"]), np.array(springs["xi"])
    L = np.minimum(springs["L"], xi)
    one, two = (mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name) for name in ("platform", "satellite"))
    releases = [bolt["release"] for bolt in inputs.get("hold_down", [])]
    for _ in range(round(end / STEP)):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        R_1, R_2 = (data.xmat[body].reshape(3, 3) for body in (one, two))
        places = data.xpos[two] + seats @ R_2.T
        strokes = (places - data.xpos[one] - seats @ R_1.T) @ R_1[:, 1]
        pushing &= strokes < L
        forces = (np.where(pushing, K * (xi - strokes), 0.0))[:, None] * R_1[:, 1]
        for body, sign in ((two, 1.0), (one, -1.0)):
            arms = places - data.xipos[body]
            data.xfrc_applied[body, :3] = sign * forces.sum(axis=0)
            data.xfrc_applied[body, 3:] = sign * np.cross(arms, forces).sum(axis=0)
        for which, release in enumerate(releases):
            data.eq_active[which] = data.time < release - 0.5 * STEP
        mujoco.mj_step(model, data)
    R_1, R_2 = (data.xmat[body].reshape(3, 3).copy() for body in (one, two))
    velocities = [
        v[:3] + R @ np.cross(v[3:], np.array(inputs[body]["cg"], dtype=float))
        for v, R, body in ((data.qvel[:6], R_1, "platform"), (data.qvel[6:], R_2, "satellite"))
    ]
    return R_1.T @ (velocities[1] - velocities[0]), data.qvel[9:12].copy()


def main():
    print("$ python tests/benchmarks/contact_mujoco.py")
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("mujoco", "numpy", "numba"))
    print(f"{versions}, Python {platform.python_version()}")
    print("case                            velocity [m/s]         largest rate [deg/s]   difference of vectors")
    print("                                here      MuJoCo       here      MuJoCo       velocity  rates")
    for name in CASES:
        case = CONTACT_CASES[name]
        last = case["results"]["at_last_release"]
        end = min(case["t_end"], 0.05 + max([last["t"], *(b["release"] for b in case["inputs"].get("hold_down", []))]))
        end = round(end / STEP) * STEP
        velocity, rates = fly(case["inputs"], end)
        state = trajectory(contact_separation(name), [end], tolerance=1e-10).states[0]
        k = np.abs(state[9:12]).argmax()
        v_error = np.linalg.norm(state[3:6] - velocity) / np.linalg.norm(velocity)
        w_error = np.linalg.norm(state[9:12] - rates) / np.linalg.norm(rates)
        print(
            f"{name:30s} {state[4]:9.5f} {velocity[1]:9.5f}    {np.degrees(state[9 + k]):9.3f} "
            f"{np.degrees(rates[k]):9.3f}      {v_error:8.1e} {w_error:8.1e}",
            flush=True,
        )


if __name__ == "__main__":
    main()
