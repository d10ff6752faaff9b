"""How often each criterion finds the active dimension: 25 inputs, known spectra, 30 repetitions each.

The gradients of g = u^T A u / 2 in a standard normal space are normal with the covariance A^2, so rows with a given
spectrum and a random rotation are those of such a function. With heavy tails every gradient has a random length as
well, as for exp(u^T A u). Run as

    python tests/benchmarks/dimension_trial.py
"""

import platform

import numpy as np
import openturns as ot

from satsep_ot.methods.active_dimension import energy_dimension, gap_dimension, ladle_dimension
from satsep_ot.methods.subspace_estimation import bootstrap_subspace, estimate_subspace

SEED = 0
INPUTS = 25
REPETITIONS = 30
SIZES = (40, 80, 160)
REPLICATES = 200
STEPS = np.arange(INPUTS)


def spectrum(leading, trailing):
    return np.r_[leading, trailing[: INPUTS - len(leading)]]


SPECTRA = {
    "0: equal": (0, np.ones(INPUTS)),
    "0: 0.95^k": (0, 0.95**STEPS),
    "0: 0.9^k": (0, 0.9**STEPS),
    "1: 1 | 0.1": (1, spectrum([1.0], 0.1 * np.ones(INPUTS))),
    "1: 1 | 0.01": (1, spectrum([1.0], 0.01 * np.ones(INPUTS))),
    "1: 1 | 0.03 0.8^k": (1, spectrum([1.0], 0.03 * 0.8**STEPS)),
    "1: 1 | 0": (1, spectrum([1.0], np.zeros(INPUTS))),
    "2: 1 0.5 | 0.02 0.9^k": (2, spectrum([1.0, 0.5], 0.02 * 0.9**STEPS)),
    "2: 1 0.1 | 0.01": (2, spectrum([1.0, 0.1], 0.01 * np.ones(INPUTS))),
    "2: 1 0.1 | 0.001": (2, spectrum([1.0, 0.1], 0.001 * np.ones(INPUTS))),
    "3: 1 0.5 0.3 | 0.01": (3, spectrum([1.0, 0.5, 0.3], 0.01 * np.ones(INPUTS))),
    "3: 1 0.1 0.01 | 0.001": (3, spectrum([1.0, 0.1, 0.01], 1e-3 * np.ones(INPUTS))),
    "3: 1 0.1 0.01 | 0.0001": (3, spectrum([1.0, 0.1, 0.01], 1e-4 * np.ones(INPUTS))),
    "3: 1 0.3 0.1 | 0.005 0.8^k": (3, spectrum([1.0, 0.3, 0.1], 0.005 * 0.8**STEPS)),
}


def absolute_gap(eigenvalues):
    return int(np.argmax(eigenvalues[:10] - eigenvalues[1:11])) + 1


def trial(eigenvalues, size, heavy, random):
    """Percentage of right answers by criterion."""
    rank, values = eigenvalues
    hits = {"separated log-gap (default)": 0, "ladle": 0, "energy 99 %": 0, "absolute gap": 0}
    for _ in range(REPETITIONS):
        rotation = np.linalg.qr(random.standard_normal((INPUTS, INPUTS)))[0]
        rows = (random.standard_normal((size, INPUTS)) * np.sqrt(values)) @ rotation.T
        if heavy:
            rows *= np.exp(0.5 * random.standard_normal((size, 1)))
        gradients = rows[:, :, None]
        found, vectors = estimate_subspace(gradients)
        _, _, replicates = bootstrap_subspace(gradients, REPLICATES, 10)
        answers = (
            gap_dimension(gradients),
            ladle_dimension(found, vectors, replicates),
            energy_dimension(found),
            absolute_gap(found),
        )
        for name, answer in zip(hits, answers, strict=True):
            hits[name] += answer == rank
    return {name: 100.0 * hit / REPETITIONS for name, hit in hits.items()}


def main():
    ot.RandomGenerator.SetSeed(SEED)
    random = np.random.default_rng(SEED)
    print(f"Command: python tests/benchmarks/dimension_trial.py (seed {SEED})")
    print(f"Python {platform.python_version()}, numpy {np.__version__}, OpenTURNS {ot.__version__}")
    for heavy in (False, True):
        print(
            f"\nPercentage of {REPETITIONS} repetitions that are right, {'heavy-tailed' if heavy else 'normal'} rows\n"
        )
        total = {}
        for name, eigenvalues in SPECTRA.items():
            for size in SIZES:
                hits = trial(eigenvalues, size, heavy, random)
                if not total:
                    print(f"{'spectrum':28}{'M':>4}" + "".join(f"{criterion:>29}" for criterion in hits))
                print(f"{name:28}{size:>4}" + "".join(f"{hit:29.0f}" for hit in hits.values()), flush=True)
                for criterion, hit in hits.items():
                    total.setdefault(criterion, []).append(hit)
        print(f"{'mean':28}{'':>4}" + "".join(f"{np.mean(hits):29.1f}" for hits in total.values()))


if __name__ == "__main__":
    main()
