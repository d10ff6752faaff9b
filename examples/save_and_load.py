"""
Save and load with ot.Study
===========================

The problem, the surrogate and the result survive in a file: the function is a Python object that the reader can import,
the surrogate is native to OpenTURNS, and the whole reliability result has a file of its own.
"""

import tempfile
from pathlib import Path

import openturns as ot

from satsep_ot.methods.reliability import ActiveSubspaceReliability
from satsep_ot.methods.reliability_result import ActiveSubspaceReliabilityResult
from satsep_ot.model.separation_problem import SeparationProblem

ot.RandomGenerator.SetSeed(0)
problem = SeparationProblem("reference")
event = problem.getEvent("spin")
algorithm = ActiveSubspaceReliability(event)
algorithm.setComponents(*problem.getComponents("spin"))
algorithm.run()
result = algorithm.getResult()

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

    # Everything that our own result knows, diagnostics and runs included.
    result.save(Path(directory) / "spin.npz")
    whole = ActiveSubspaceReliabilityResult.load(Path(directory) / "spin.npz")

point = problem.getDistribution().getMean()
same_spin = event_again.getFunction()(point) == event.getFunction()(point)
same_surrogate = surrogate(point) == result.getMetaModelResult().getMetaModel()(point)
print(
    f"distribution of dimension {distribution.getDimension()}, same spin {same_spin}, same surrogate {same_surrogate}"
)
print(
    f"probability {result_again.getProbabilityEstimate():.4e} from ot.Study, {whole.getProbabilityEstimate():.4e} whole"
)
