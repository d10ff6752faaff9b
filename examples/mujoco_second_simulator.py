"""
A second simulator of the separation: MuJoCo
============================================

The reference case once more, in MuJoCo: the satellite's feet stand on the stage and can strike it, with friction, and
each spring resists sideways motion of its seat. In half of all runs a foot strikes the stage. A run takes a thousand
times as long as one of this package's simulator, which is the cheap model beside it. Without MuJoCo
(``pip install 'satsep-ot[examples]'``) the example says so and ends.
"""

import importlib.util

import numpy as np
import openturns as ot

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.model.inputs import ParameterMap
from satsep_ot.model.separation_problem import SeparationProblem

STEP = 2e-4  # s
END = 0.2  # s, after the last release of any run
LATERAL = 0.15  # stiffness of a spring sideways over that along its axis
SPHERE = 1e-5  # m, radius of the spheres that stand for the feet
# Contact as stiff as ten steps allow; the friction coefficient is 0.2.
SURFACE = f'condim="3" friction="0.2 0 0" solref="{10 * STEP} 1"'


def text(values):
    return " ".join(f"{value:.17g}" for value in np.ravel(values))


def inertial(body):
    J = body.inertia
    moments = text([J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]])
    return f'<inertial pos="{text(body.center_of_mass)}" mass="{body.mass}" fullinertia="{moments}"/>'


def mujoco_model(separation):
    """The two bodies, whose frames are those of their ring centres, with a foot at each seat."""
    feet = "".join(
        f'<geom type="sphere" size="{SPHERE}" pos="{text(seat + [0.0, SPHERE, 0.0])}" {SURFACE}/>'
        for seat in separation.springs.seats()
    )
    return mujoco.MjModel.from_xml_string(f"""
<mujoco>
  <option timestep="{STEP}" gravity="0 0 0" cone="elliptic"/>
  <worldbody>
    <body name="stage"><freejoint/>{inertial(separation.platform)}
      <geom type="box" size="2 0.5 2" pos="0 -0.5 0" {SURFACE}/></body>
    <body name="satellite"><freejoint/>{inertial(separation.satellite)}{feet}</body>
  </worldbody>
</mujoco>""")


def rotated(R, vectors):
    return vectors @ R.T


def satellite_rates(separation):
    """Rates of the satellite about x and z [deg/s] after the last release."""
    model = mujoco_model(separation)
    data = mujoco.MjData(model)
    stage, satellite = (model.body(name).id for name in ("stage", "satellite"))
    masses = np.array([separation.platform.mass, separation.satellite.mass])
    centres = np.array([separation.platform.center_of_mass, separation.satellite.center_of_mass])
    # The stack turns about its own centre of mass.
    for k in (0, 6):
        data.qvel[k : k + 3] = np.cross(separation.rates, -(masses @ centres) / masses.sum())
        data.qvel[k + 3 : k + 6] = separation.rates
    springs, seats, guides = separation.springs, separation.springs.seats(), separation.springs.guides()
    ends, before, pushing = springs.release_strokes(), np.zeros(len(springs)), np.ones(len(springs), dtype=bool)
    while pushing.any() and data.time < END:
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        R_1, R_2 = (data.xmat[body].reshape(3, 3) for body in (stage, satellite))
        places = data.xpos[satellite] + rotated(R_2, seats)
        shifts = places - data.xpos[stage] - rotated(R_1, seats)
        axes = rotated(R_1, guides)
        strokes = (shifts * axes).sum(axis=1)
        pushing &= strokes < ends
        along = springs.scale * springs.stiffness * (springs.deformation - strokes)
        sideways = -LATERAL * springs.stiffness[:, None] * (shifts - strokes[:, None] * axes)
        # The part of the step in which a spring pushes: it starts and lets go within one.
        started = np.clip((data.time + STEP - springs.delay) / STEP, 0.0, 1.0)
        left = np.clip((ends - strokes) / np.maximum(strokes - before, 1e-12), 0.0, 1.0)
        forces = (pushing * started * left)[:, None] * (along[:, None] * axes + sideways)
        before = strokes
        for body, sign in ((satellite, 1.0), (stage, -1.0)):
            arms = places - data.xipos[body]
            data.xfrc_applied[body, :3] = sign * forces.sum(axis=0)
            data.xfrc_applied[body, 3:] = sign * np.cross(arms, forces).sum(axis=0)
        mujoco.mj_step(model, data)
    return np.degrees(data.qvel[[9, 11]])


def main():
    """The probability that MuJoCo's satellite turns too fast across its axis, without and with our simulator."""
    problem = SeparationProblem("reference")
    case = problem.getCase()
    scatter = ParameterMap(case.inputs, case.separation)
    cheap, composition = problem.getMeasuredComponents("lateral rate")

    def simulate(sample):
        return [satellite_rates(case.separation.with_parameters(row)) for row in scatter.parameters(np.array(sample))]

    heavy = ot.PythonFunction(cheap.getInputDimension(), cheap.getOutputDimension(), func_sample=simulate)
    heavy.setInputDescription(cheap.getInputDescription())
    heavy.setOutputDescription(cheap.getOutputDescription())
    ot.RandomGenerator.SetSeed(0)
    sample = problem.getDistribution().getSample(20)
    ours, theirs = np.array(cheap(sample)), np.array(heavy(sample))
    for k, name in enumerate(heavy.getOutputDescription()):
        print(f"{name}: correlation of the two simulators {np.corrcoef(ours[:, k], theirs[:, k])[0, 1]:.4f}")

    variable = ot.CompositeRandomVector(
        ot.ComposedFunction(composition, heavy), ot.RandomVector(problem.getDistribution())
    )
    results = {}
    for name, low_fidelity in (("MuJoCo alone", None), ("with this package's simulator", cheap)):
        algorithm = ActiveSubspaceReliability(ot.ThresholdEvent(variable, ot.Greater(), 2.5))
        algorithm.setComponents(heavy, composition)
        algorithm.setLowFidelity(low_fidelity)
        algorithm.setTargetCoefficientOfVariation(0.1)
        ot.RandomGenerator.SetSeed(0)
        algorithm.run()
        results[name] = result = algorithm.getResult()
        interval = result.getConfidenceInterval(0.95)
        print(
            f"{name}: P(lateral rate > 2.5 deg/s) = {result.getProbabilityEstimate():.2e}, 95 % interval "
            f"{interval.getLowerBound()[0]:.2e} to {interval.getUpperBound()[0]:.2e}, {result.getEvaluationNumber()} "
            "runs of MuJoCo"
        )
    return results


if importlib.util.find_spec("mujoco") is None:
    print("MuJoCo is not installed, and this example needs it: pip install 'satsep-ot[examples]'")
    results = {}
else:
    import mujoco

    results = main()
