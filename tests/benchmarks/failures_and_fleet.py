"""Failures of parts and a fleet with shared inputs against brute-force Monte Carlo of 1,000,000 missions.

python tests/benchmarks/failures_and_fleet.py > tests/benchmarks/failures_and_fleet.txt
"""

import sys
import time
from pathlib import Path

import openturns as ot

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from brute_force import fleets_with_a_violation, violations_with_failures

from satsep_ot.methods.common.intervals import clopperPearson
from satsep_ot.methods.parallel.processor import processorDescription
from satsep_ot.model.case import SYSTEM, load_case, parse_case
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.separation_study import SeparationStudy

MISSIONS = 1_000_000
FLEET = 4
REFERENCE = load_case("reference").text
FAILING = REFERENCE.replace("scale = 1.0 ", "").replace(
    "[springs] ", "[springs]\nfailure_probability = [2e-4, 1e-4, 0.0, 5e-5]  # "
)
SHARED = ("stage_mass", "stage_Ixx", "stage_cg_x", "stage_cg_z", "stiffness", "rate_x", "rate_z")


def fleet_case():
    """The reference case as a fleet that shares its stage, its rates and its batch of springs."""
    text = REFERENCE.replace('name = "reference"', f'name = "reference"\nfleet = {FLEET}')
    lines = [
        line.replace(" }", ", shared = true }", 1) if line.split(" = ")[0] in SHARED else line
        for line in text.splitlines()
    ]
    return parse_case("\n".join(lines))


def compare(title, case, study_of, brute):
    """Print the answer of a study beside the share of the missions."""
    study = SeparationStudy(SeparationProblem(case), ["ActiveSubspace", "MonteCarlo"], 0, 500_000, toleranceSize=0)
    begin = time.perf_counter()
    study.computeSample()
    study.compareMethods()
    known = time.perf_counter()
    found = study_of(study)
    end = time.perf_counter()
    ot.RandomGenerator.SetSeed(11)
    counts = brute(case, MISSIONS)
    last = time.perf_counter()
    print(f"\n{title}\nthe estimates of one satellite took {known - begin:.0f} s, the answer {end - known:.0f} s more, "
          f"the {MISSIONS:,} missions {last - end:.0f} s")  # fmt: skip
    print(f"{'requirement':16s} {'study':>10s} {'95 % interval':>22s} {'missions':>10s} {'95 % interval':>22s}  each in"
          " the interval of the other")  # fmt: skip
    for name, count in zip([*(entry.name for entry in case.requirements), SYSTEM], counts, strict=True):
        one, share = found[name], count / MISSIONS
        lower, upper = clopperPearson(int(count), MISSIONS)
        inside = one.lower95 <= share <= one.upper95 and lower <= one.probability <= upper
        print(f"{name:16s} {one.probability:10.4e} {one.lower95:10.3e}..{one.upper95:10.3e} {share:10.4e} "
              f"{lower:10.3e}..{upper:10.3e}  {'yes' if inside else 'no'}")  # fmt: skip


def main():
    """Both comparisons."""
    print(processorDescription())
    print("python tests/benchmarks/failures_and_fleet.py, seeds 0 of the study, 11 and 7 of the missions")
    failing = parse_case(FAILING)

    def failures(study):
        study.computeFailures()
        return study.getResult().failures

    def fleet(study):
        study.computeFleet()
        return study.getResult().fleet

    parts = ", ".join(f"{failure.part} {failure.probability:g}" for failure in failing.failures)
    compare(f"failures of parts: {parts}", failing, failures, violations_with_failures)
    case = fleet_case()
    shared = ", ".join(row.name for row in case.inputs if row.is_shared)
    compare(f"a fleet of {FLEET} that shares {shared}", case, fleet, fleets_with_a_violation)


if __name__ == "__main__":
    main()
