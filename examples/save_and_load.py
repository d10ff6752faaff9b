"""
Save and load with ot.Study
===========================

The problem, the surrogate and the result survive in a file: the function is a Python object that the reader can import,
the surrogate is native to OpenTURNS. The whole results, of reliability, of an active subspace and of a regression, with
their samples, intervals and diagnostics, have files of their own: ``save`` and ``load``, to the last bit.
"""

import tempfile
from pathlib import Path

import openturns as ot

from satsep_ot.methods.polynomials.regression_result import MultivariatePolynomialRegressionResult
from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult
from satsep_ot.model.separation_problem import SeparationProblem

ot.RandomGenerator.SetSeed(0)
problem = SeparationProblem("reference")
event = problem.getEvent("spin")
algorithm = ActiveSubspaceReliability(event)
algorithm.setComponents(*problem.getComponents("spin"))
algorithm.run()
result = algorithm.getResult()

search = ActiveSubspaceAlgorithm(event.getFunction(), problem.getDistribution())
search.setSamplingSize(150)
search.run()
subspace = search.getResult()
regression = subspace.getRegressionResult()

with tempfile.TemporaryDirectory() as directory:
    path = Path(directory) / "study.xml"
    study = ot.Study()
    study.setStorageManager(ot.XMLStorageManager(str(path)))
    study.add("distribution", problem.getDistribution())
    study.add("event", event)
    study.add("surrogate", result.getMetaModelResult().getMetaModel())
    study.add("result", result.getProbabilitySimulationResult())
    study.save()

    loaded = ot.Study()
    loaded.setStorageManager(ot.XMLStorageManager(str(path)))
    loaded.load()
    distribution, surrogate = ot.JointDistribution(), ot.Function()
    event_again, result_again = ot.ThresholdEvent(), ot.ProbabilitySimulationResult()
    for name, thing in (
        ("distribution", distribution),
        ("event", event_again),
        ("surrogate", surrogate),
        ("result", result_again),
    ):
        loaded.fillObject(name, thing)

    # Everything that our own results know, diagnostics and runs included.
    result.save(Path(directory) / "spin.npz")
    whole = ActiveSubspaceReliabilityResult.load(Path(directory) / "spin.npz")
    subspace.save(Path(directory) / "subspace.npz")
    subspace_again = ActiveSubspaceResult.load(Path(directory) / "subspace.npz")
    regression.save(Path(directory) / "regression.npz")
    regression_again = MultivariatePolynomialRegressionResult.load(Path(directory) / "regression.npz")

point = problem.getDistribution().getMean()
same_spin = event_again.getFunction()(point) == event.getFunction()(point)
same_surrogate = surrogate(point) == result.getMetaModelResult().getMetaModel()(point)
print(
    f"distribution of dimension {distribution.getDimension()}, same spin {same_spin}, same surrogate {same_surrogate}"
)
print(
    f"probability {result_again.getProbabilityEstimate():.4e} from ot.Study, {whole.getProbabilityEstimate():.4e} whole"
)
print(
    f"active subspace of dimension {subspace_again.getDimension()}, same intervals "
    f"{subspace_again.getEigenvaluesInterval() == subspace.getEigenvaluesInterval()}; regression with Q2 "
    f"{regression_again.getQ2LeaveOneOut()[0]:.3f}, same coefficients "
    f"{regression_again.getCoefficients() == regression.getCoefficients()}"
)
