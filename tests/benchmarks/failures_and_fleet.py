"""Failures of parts and a fleet with shared inputs against brute-force Monte Carlo of 1,000,000 missions.

python tests/benchmarks/failures_and_fleet.py > tests/benchmarks/failures_and_fleet.txt
"""

import math
import sys
import time
from pathlib import Path

import numpy as np
import openturns as ot

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from brute_force import fleets_with_a_violation, violations_with_failures

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.methods.parallel.processor import processorDescription
from satsep_ot.model.case import SYSTEM, load_case, parse_case
from satsep_ot.model.inputs import ParameterMap, joint_distribution
from satsep_ot.studies.failure_mixture import failure_mixtures
from satsep_ot.studies.fleet import fleet_estimate
from satsep_ot.studies.true_violations import true_violations

MISSIONS = 1_000_000
RUNS = 500_000
FLEET = 4
# Of the reference case, as tests/benchmarks/reference_truth.py counted them.
COUNTS = {"lateral rate": 2530, "spin": 67_595, "axial velocity": 6217, "clearance": 9404, SYSTEM: 84_013}
KNOWN = {name: (count / 1e7, *clopperPearson(count, 10_000_000)) for name, count in COUNTS.items()}
REFERENCE = load_case("reference").text
FAILING = REFERENCE.replace("scale = 1.0 ", "").replace(
    "[springs] ", "[springs]\nfailure_probability = [2e-4, 1e-4, 0.0, 5e-5]  # "
)
SHARED = ("stage_mass", "stage_Ixx", "stage_cg_x", "stage_cg_z", "stiffness", "cant")


def fleet_case():
    """The reference case as a fleet that shares its stage, its rates and its batch of springs."""
    text = REFERENCE.replace('name = "reference"', f'name = "reference"\nfleet = {FLEET}')
    lines = [
        line.replace(" }", ", shared = true }", 1) if line.split(" = ")[0] in SHARED else line
        for line in text.splitlines()
    ]
    return parse_case("\n".join(lines))


def violating_runs(case):
    """Crude runs of one satellite that violate each requirement, and any."""
    ot.RandomGenerator.SetSeed(3)
    inputs = np.array(joint_distribution(case.inputs, case.copula).getSample(RUNS))
    parameters = ParameterMap(case.inputs, case.separation).parameters(inputs)
    violated = true_violations(case.separation, case.requirements, parameters)
    return [inputs[column] for column in violated.T]


def compare(title, case, found, brute):
    """Print the answers beside the share of the missions."""
    begin = time.perf_counter()
    ot.RandomGenerator.SetSeed(11)
    counts = brute(case, MISSIONS)
    print(f"\n{title}\nthe {MISSIONS:,} missions took {time.perf_counter() - begin:.0f} s")
    print(f"{'requirement':16s} {'answer':>10s} {'95 % interval':>22s} {'missions':>10s} {'95 % interval':>22s}"
          "  apart by (standard deviations)")  # fmt: skip
    for name, count in zip(KNOWN, counts, strict=True):
        one, share = found[name], count / MISSIONS
        lower, upper = clopperPearson(int(count), MISSIONS)
        apart = (one.probability - share) / math.hypot((one.upper95 - one.lower95) / 3.92, (upper - lower) / 3.92)
        inside = "inside" if lower <= one.probability <= upper and one.lower95 <= upper else "outside"
        print(f"{name:16s} {one.probability:10.4e} {one.lower95:10.3e}..{one.upper95:10.3e} {share:10.4e} "
              f"{lower:10.3e}..{upper:10.3e}  {apart:+.2f}, {inside}")  # fmt: skip


def main():
    """Both comparisons."""
    print(processorDescription())
    print("python tests/benchmarks/failures_and_fleet.py, seeds 0, 3, 11 and 7")
    print("probabilities of one satellite with all parts: 10,000,000 runs, reference_truth.txt")
    print("inside: the answer is in the 95 % interval of the missions")
    failing = parse_case(FAILING)
    parts = ", ".join(f"{failure.part} {failure.probability:g}" for failure in failing.failures)
    ot.RandomGenerator.SetSeed(0)
    compare(f"failures of parts: {parts}", failing, failure_mixtures(failing, KNOWN), violations_with_failures)
    case = fleet_case()
    shared = ", ".join(row.name for row in case.inputs if row.is_shared)
    runs = violating_runs(case)
    fleet = {
        name: fleet_estimate(case, name, known, inputs, np.ones(len(inputs)))
        for (name, known), inputs in zip(KNOWN.items(), runs, strict=True)
    }
    for name, one in fleet.items():
        print(f"{name}: {one.failures} runs that violate it; {one.sentence}")
    compare(f"a fleet of {FLEET} that shares {shared}", case, fleet, fleets_with_a_violation)


if __name__ == "__main__":
    main()
