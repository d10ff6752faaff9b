"""What the tolerance of a run means: random cases at 1e-8 against 1e-13, for each force line.

PYTHONPATH=.:tests python tests/benchmarks/tolerance.py > tests/benchmarks/tolerance.txt
"""

import sys

import numpy as np
from separation_cases import general_separation, mixed_springs

from satsep_ot.dynamics.separation import Status
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.dynamics.springs import ForceLine
from satsep_ot.studies.results_directory import package_versions

NUMBER, SEED, SCATTER = 1500, 5, 0.05
FLOOR = 0.1  # deg/s


def main():
    print(f"command: PYTHONPATH=.:tests python {' '.join(sys.argv)}")
    print(f"versions: {package_versions()}")
    print(
        f"{NUMBER} cases each, every parameter scattered by {SCATTER:.0%}, seed {SEED}; relative errors, of rates with "
        f"a floor of {FLOOR} deg/s"
    )
    rng = np.random.default_rng(SEED)
    for line in ForceLine:
        for kind in ("linear", "mixed"):
            options = {} if kind == "linear" else {"springs": mixed_springs()}
            separation = general_separation(line, **options)
            nominal = separation.parameters()
            rows = nominal * (1.0 + SCATTER * rng.standard_normal((NUMBER, nominal.size)))
            rough, fine = simulate(separation, rows, 1e-8), simulate(separation, rows, 1e-13)
            failed = [int(np.count_nonzero(outcome.status != Status.OK)) for outcome in (rough, fine)]
            both = (rough.status == Status.OK) & (fine.status == Status.OK)
            errors = []
            for name, floor in (("axial_velocity", 0.0), ("tip_off_rate", FLOOR)):
                exact = fine.quantity(name)[both]
                errors.append(np.abs(rough.quantity(name)[both] - exact) / np.maximum(np.abs(exact), floor))
            worst = [f"{one.max():.1e} (99 %: {np.quantile(one, 0.99):.1e})" for one in errors]
            print(
                f"{line.name.lower()}, {kind}: velocity {worst[0]}, rates {worst[1]}; failed at 1e-8 and 1e-13: "
                f"{failed[0]}, {failed[1]}; most steps {rough.steps.max()}, {fine.steps.max()}"
            )


if __name__ == "__main__":
    main()
