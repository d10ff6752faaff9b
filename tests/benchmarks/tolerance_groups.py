"""What halving each group of tolerances buys for the lateral rate of the reference case, from a study.

python tests/benchmarks/tolerance_groups.py > tests/benchmarks/tolerance_groups.txt
"""

import dataclasses

from satsep_ot.methods.parallel.processor import processorDescription
from satsep_ot.model.case import load_case
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.separation_study import SeparationStudy
from satsep_ot.studies.telling.advice import advice_sentences
from satsep_ot.studies.telling.tables import tightened_lines
from satsep_ot.studies.telling.tolerance_curves import Curves
from satsep_ot.studies.telling.words import StudyMethod, interval_text, probability_text


def main():
    """The study of one requirement."""
    case = load_case("reference")
    lateral = dataclasses.replace(case, requirements=case.requirements[:1])
    study = SeparationStudy(
        SeparationProblem(lateral), [StudyMethod.ACTIVE_SUBSPACE], seed=0, gradientSize=0, toleranceSize=3,
        curves=Curves.NONE,
    )  # fmt: skip
    study.compareMethods()
    study.computeDrivers()
    study.computeTolerances()
    result = study.getResult()
    print(processorDescription())
    print("python tests/benchmarks/tolerance_groups.py, seed 0")
    row = result.rows_of("lateral rate")[0]
    print(f"as is: {probability_text(row.probability)} ({interval_text(row.lower95, row.upper95)})")
    for line in tightened_lines(result):
        print(line)
    for requirement, sentence in advice_sentences(result).items():
        print(f"{requirement}: {sentence}")


if __name__ == "__main__":
    main()
