"""How often each criterion finds the active dimension: known spectra, 30 repetitions each.

The gradients of g = u^T A u / 2 in a standard normal space are normal with the covariance A^2, so rows with a given
spectrum and a random rotation are those of such a function. With heavy tails every gradient has a random length as
well, as for exp(u^T A u). The constants of the default criterion were chosen on the spectra of the first group, with
both kinds of rows. The second group was written afterwards and has changed nothing: other numbers of inputs, decays and
tails, directions and components that depend on each other, and functions that are no such quadratics. Run as

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/dimension_trial.py
"""

import platform

import numpy as np
import openturns as ot

from satsep_ot.methods.subspaces.dimension import energy_dimension, gap_dimension, ladle_dimension
from satsep_ot.methods.subspaces.estimation import bootstrap_subspace, estimate_subspace

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


def rotated(rows, random):
    """Gradients (M, d, 1) of rows (M, d) in a random orientation."""
    return (rows @ np.linalg.qr(random.standard_normal((rows.shape[1],) * 2))[0].T)[:, :, None]


def rows_of(values, heavy):
    """Normal rows with this spectrum, of lognormal length if heavy."""

    def rows(size, random):
        length = np.exp(0.5 * random.standard_normal((size, 1))) if heavy else 1.0
        return length * random.standard_normal((size, len(values))) * np.sqrt(values)

    return rows


def student_rows(values, freedom):
    return lambda size, random: rows_of(values, False)(size, random) / np.sqrt(random.chisquare(freedom, (size, 1)))


def laplace_rows(values):
    return lambda size, random: random.laplace(size=(size, len(values))) * np.sqrt(values)


def oblique_rows(inputs, correlation):
    """Two directions at 45 degrees whose components depend on each other, over neighbours that do so too."""

    def rows(size, random):
        noise = random.standard_normal((size, inputs))
        for i in range(1, inputs):
            noise[:, i] = correlation * noise[:, i - 1] + np.sqrt(1.0 - correlation**2) * noise[:, i]
        first, second = random.standard_normal((2, size))
        second = correlation * first + np.sqrt(1.0 - correlation**2) * second
        rows = 0.05 * noise
        rows[:, 0] += first + np.sqrt(0.5) * second
        rows[:, 1] += np.sqrt(0.5) * second
        return rows

    return rows


def ripple(inputs, slopes):
    """Gradient of a function of the leading variables plus 0.05 sum_i sin(2 u_i)."""

    def rows(size, random):
        points = random.standard_normal((size, inputs))
        rows = 0.1 * np.cos(2.0 * points)
        leading = np.column_stack(slopes(points))
        rows[:, : leading.shape[1]] += leading
        return rows

    return rows


# Functions of the leading variables through their slopes.
def exponential(u):
    return [np.exp(0.7 * u[:, 0])]


def product(u):
    return [u[:, 1], u[:, 0]]


def kink(u):
    return [np.ones(len(u)), 2.0 * np.maximum(u[:, 1] - 0.5, 0.0)]


def three(u):
    return [np.cos(u[:, 0]), 2.0 * u[:, 1], np.exp(0.5 * u[:, 2])]


FIRST = {
    f"{name}{', heavy' if heavy else ''}": (rank, rows_of(values, heavy))
    for heavy in (False, True)
    for name, (rank, values) in SPECTRA.items()
}
SECOND = {
    "0: d = 10, 1 - k/20": (0, rows_of(1.0 - np.arange(10) / 20.0, False)),
    "0: d = 60, equal, Student 4": (0, student_rows(np.ones(60), 4)),
    "0: d = 15, equal, Laplace": (0, laplace_rows(np.ones(15))),
    "0: d = 40, 0.93^k, heavy": (0, rows_of(0.93 ** np.arange(40), True)),
    "1: d = 10, 1 | 0.04/k": (1, rows_of(np.r_[1.0, 0.04 / np.arange(1.0, 10.0)], False)),
    "1: d = 60, 1 | 0.02, Student 4": (1, student_rows(np.r_[1.0, np.full(59, 0.02)], 4)),
    "1: d = 35, 1 | 0.05 0.9^k, Laplace": (1, laplace_rows(np.r_[1.0, 0.05 * 0.9 ** np.arange(34)])),
    "1: d = 25, exponential": (1, ripple(25, exponential)),
    "2: d = 15, 1 0.2 | 0.01 0.85^k, heavy": (2, rows_of(np.r_[1.0, 0.2, 0.01 * 0.85 ** np.arange(13)], True)),
    "2: d = 40, 1 0.7 | 0.01/k, Student 4": (2, student_rows(np.r_[1.0, 0.7, 0.01 / np.arange(1.0, 39.0)], 4)),
    "2: d = 25, oblique, correlated": (2, oblique_rows(25, 0.6)),
    "2: d = 25, product": (2, ripple(25, product)),
    "2: d = 25, kink": (2, ripple(25, kink)),
    "3: d = 60, 1 0.6 0.4 | 0.01": (3, rows_of(np.r_[1.0, 0.6, 0.4, np.full(57, 0.01)], False)),
    "3: d = 15, 1 0.4 0.05 | 0.002, heavy": (3, rows_of(np.r_[1.0, 0.4, 0.05, np.full(12, 0.002)], True)),
    "3: d = 25, cosine, square, exponential": (3, ripple(25, three)),
}


def absolute_gap(eigenvalues):
    return int(np.argmax(-np.diff(eigenvalues[:11]))) + 1


def trial(rank, rows, size, random):
    """Percentage of right answers by criterion."""
    hits = {"default": 0, "ladle": 0, "energy": 0, "absolute": 0}
    for _ in range(REPETITIONS):
        gradients = rotated(rows(size, random), random)
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


def table(title, group, random):
    print(f"\n{title}: percentage of {REPETITIONS} repetitions that are right with M gradients\n")
    print(f"{'':41}{'default':>21}{'ladle':>24}{'energy 99 %':>24}{'absolute gap':>24}")
    print(f"{'active directions: spectrum      M':41}" + "      ".join(4 * ["".join(f"{size:6}" for size in SIZES)]))
    answers = []
    for name, (rank, rows) in group.items():
        hits = [trial(rank, rows, size, random) for size in SIZES]
        answers.append([[hit[criterion] for hit in hits] for criterion in hits[0]])
        line = "".join("".join(f"{hit:6.0f}" for hit in numbers) + 6 * " " for numbers in answers[-1])
        print(f"{name:41}{line}".rstrip(), flush=True)
    for label, number in (("mean", np.mean(answers, axis=0)), ("worst", np.min(answers, axis=0))):
        line = "".join("".join(f"{hit:6.1f}" for hit in numbers) + 6 * " " for numbers in number)
        print(f"{label:41}{line}".rstrip())


def main():
    ot.RandomGenerator.SetSeed(SEED)
    random = np.random.default_rng(SEED)
    print("Command: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/dimension_trial.py")
    print(f"Seed {SEED}; Python {platform.python_version()}, numpy {np.__version__}, OpenTURNS {ot.__version__}")
    table(f"First group, {INPUTS} inputs", FIRST, random)
    table("Second group", SECOND, random)


if __name__ == "__main__":
    main()
