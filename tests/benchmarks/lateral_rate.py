"""What FORM, SORM and a Rayleigh law say of a lateral rate above 2 deg/s, and which inputs drive the rate about x.

    python tests/benchmarks/lateral_rate.py

The limit state is a circle in the plane of the two lateral rates, so FORM is started from several points around it.
"""

from importlib import metadata

import numpy as np
import openturns as ot

from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.model.case import Requirement
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem


def main(size=1_000_000):
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("satsep-ot", "openturns", "numpy", "numba"))
    print(f"{versions}; seed 0")
    ot.RandomGenerator.SetSeed(0)
    problem = SeparationProblem("reference")
    distribution = problem.getDistribution()
    model = SeparationFunction("reference", quantities=["rate_x", "rate_z"])
    blocks = [model.evaluate(np.asarray(distribution.getSample(50_000))) for _ in range(size // 50_000)]
    rates = np.concatenate(blocks)
    share = np.mean(np.linalg.norm(rates, axis=1) > 2.0)
    print(f"Monte Carlo, {size:,} runs: {share:.3e} +- {1.96 * np.sqrt(share / size):.1e} (95 %)")
    variance = rates.var()
    print(f"Rayleigh law with the mean variance of the two rates, ({np.sqrt(variance):.4f} deg/s)^2: ", end="")
    print(f"{np.exp(-2.0 / variance):.3e}")
    event = problem.getEvent(Requirement("lateral rate", "lateral_rate", 2.0, True))
    inverse = distribution.getInverseIsoProbabilisticTransformation()
    gradient = model.computeGradientSample([distribution.getMean()])[0]
    deviation = np.array(distribution.getStandardDeviation())[:, None]
    toward = (gradient * deviation) / np.linalg.norm(gradient * deviation, axis=0)
    for angle in range(0, 360, 45):
        start = np.cos(np.radians(angle)) * toward[:, 0] + np.sin(np.radians(angle)) * toward[:, 1]
        solver = ot.AbdoRackwitz()
        solver.setStartingPoint(inverse(start))
        solver.setMaximumIterationNumber(200)
        algorithm = ot.SORM(solver, event)
        algorithm.run()
        result = algorithm.getResult()
        try:
            second = f"{result.getEventProbabilityBreitung():.2e}"
        except RuntimeError:
            second = "not defined: a curvature is below -1 / index"
        point = model.evaluate([result.getPhysicalSpaceDesignPoint()])[0]
        print(
            f"start at {angle:3d} deg: FORM index {result.getHasoferReliabilityIndex():.4f}, "
            f"{ot.Normal().computeComplementaryCDF(result.getHasoferReliabilityIndex()):.2e}; design point at rates "
            f"{point[0]:+.3f}, {point[1]:+.3f} deg/s; SORM (Breitung) {second}"
        )
    algorithm = ActiveSubspaceAlgorithm(SeparationFunction("reference", quantities=["rate_x"]), distribution)
    algorithm.setSamplingSize(300)
    algorithm.setDimension(1)
    algorithm.run()
    weights = np.array(algorithm.getResult().getDirections())[:, 0] ** 2
    groups = {}
    for name, weight in zip(problem.getInputNames(), weights, strict=True):
        name = name.rstrip("_1234")
        groups[name] = groups.get(name, 0.0) + weight
    shares = sorted(groups.items(), key=lambda item: -item[1])
    print("share of each input in the active direction of rate_x (squared weights, springs together):")
    print(", ".join(f"{name} {100.0 * weight:.0f} %" for name, weight in shares if weight > 5e-3))


if __name__ == "__main__":
    main()
