"""How often the intervals that claim 95 % hold the truth: 200 repetitions each.

Active subspaces: quadratics g = sum_i c_i u_i^2 / 2 + l.u, whose matrix diag(c^2) + l l^T is known, and functions of
one direction whose gradients have heavy tails: an exponential, a cube, a fifth power, and a piece ten times as steep on
2 % of the points. There upper bounds are infinite where the result says so ("heavy" is the share of these repetitions).
Polynomial regression: a quartic of two variables with normal noise, and with Student noise that the intervals do not
assume; exp of two variables without noise, which is no quartic; "cross-validated" is the interval that assumes none.
Four standard errors of 200 repetitions at 95 % are 6 %. Run as

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/interval_coverage.py
"""

import platform

import numpy as np
import openturns as ot

from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.methods.subspaces.estimation import subspace_distance

SEED = 0
REPETITIONS = 200
LEVEL = 0.95


def quadratic(curvatures, slopes):
    """Gradients at points, and the matrix of the active subspace."""
    return lambda u: curvatures * u + slopes, np.diag(curvatures**2) + np.outer(slopes, slopes)


def exponential(direction):
    matrix = np.outer(direction, direction) * np.exp(2.0 * direction @ direction)
    return lambda u: np.exp(u @ direction)[:, None] * direction, matrix


def ridge(direction, slope, square):
    """A function of the unit direction with this slope, the mean square of which is known."""
    return lambda u: slope(u @ direction)[:, None] * direction, square * np.outer(direction, direction)


UNIT = np.array([0.8, 0.6, 0.0, 0.0, 0.0, 0.0])
# Beyond it 2 % of a standard normal.
RARE = 2.0537489106318225


# Name: gradients and matrix, active dimension, number of eigenvalues that stand alone.
SUBSPACES = {
    "quadratic, d = 6": (
        quadratic(np.array([2.0, 1.0, 0.5, 0.25, 0.1, 0.05]), np.array([1.0, 0.0, 0.0, 0.2, 0.0, 0.0])),
        2,
        4,
    ),
    "nearly linear, d = 6": (
        quadratic(np.array([0.3, 0.1, 0.03, 0.01, 0.003, 0.001]), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])),
        1,
        3,
    ),
    "quadratic, d = 25": (quadratic(np.r_[3.0, 1.0, 0.1 * 0.9 ** np.arange(23)], np.zeros(25)), 2, 2),
    "exponential, d = 6": (exponential(np.array([0.4, 0.2, 0.1, 0.0, 0.0, 0.0])), 1, 1),
    "exponential, |w| = 1": (exponential(UNIT), 1, 1),
    "cube": (ridge(UNIT, lambda y: 3.0 * y**2, 27.0), 1, 1),
    "quintic": (ridge(UNIT, lambda y: 5.0 * y**4, 2625.0), 1, 1),
    "steep on 2 %": (ridge(UNIT, lambda y: np.where(y > RARE, 10.0, 1.0), 0.98 + 100.0 * 0.02), 1, 1),
}


def inside(interval, truth):
    """Which of the first components the interval holds."""
    lower, upper = (np.array(bound)[: len(truth)] for bound in (interval.getLowerBound(), interval.getUpperBound()))
    return ((lower <= truth) & (truth <= upper)).tolist()


def subspace_coverage(gradient, matrix, dimension, alone, size, random, repetitions=REPETITIONS):
    """Fraction of repetitions in which each kind of interval holds the truth; of several components the mean."""
    values, vectors = np.linalg.eigh(matrix)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    scores = (vectors[:, :dimension] ** 2) @ values[:dimension]
    relevant = np.flatnonzero(scores > 1e-3 * scores.max())
    bound = np.sqrt(values[dimension:].sum())
    hits = {}
    for _ in range(repetitions):
        points = random.standard_normal((size, len(matrix)))
        algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
            ot.Normal(len(matrix)), points, np.zeros((size, 1)), gradient(points)
        )
        algorithm.setDimension(dimension)
        algorithm.setBootstrapSize(500)
        algorithm.run()
        result = algorithm.getResult()
        found = result.getActivityScoresInterval(LEVEL)
        held = (np.array(found.getLowerBound()) <= scores) & (scores <= np.array(found.getUpperBound()))
        distance = subspace_distance(np.array(result.getDirections()), vectors[:, :dimension])
        upper = result.getSubspaceErrorInterval(LEVEL).getUpperBound()[dimension - 1]
        answers = {
            "eigenvalues": inside(result.getEigenvaluesInterval(LEVEL), values[:alone]),
            "activity scores": held[relevant].tolist(),
            "derivative-based": inside(result.getDerivativeBasedIndicesInterval(LEVEL), np.diag(matrix)[:alone]),
            "error below its band": [distance <= max(upper, 1e-12)],
            "heavy": [result.hasHeavyTail()],
        }
        if bound > 1e-6:
            answers["error bound"] = inside(result.getErrorBoundInterval(LEVEL), [bound])
        for name, answer in answers.items():
            hits.setdefault(name, []).append(np.mean(answer))
    return {name: float(np.mean(answer)) for name, answer in hits.items()}


def quartic(x):
    return 1.0 + x[:, :1] - 2.0 * x[:, :1] * x[:, 1:] + 0.3 * (x[:, 1:] ** 4 - 6.0 * x[:, 1:] ** 2 + 3.0)


def regression_coverage(size, noise, random, repetitions=REPETITIONS, truth=quartic):
    """The same for the regression on 15 terms, with noise drawn by ``noise(shape)`` of deviation 1."""
    indices = None
    hits = {}
    for _ in range(repetitions):
        inputs, fresh = random.standard_normal((size, 2)), random.standard_normal((20, 2))

        regression = MultivariatePolynomialRegression(inputs, truth(inputs) + 0.5 * noise((size, 1)), ot.Normal(2))
        regression.run()
        result = regression.getResult()
        indices = result.getIndices().tolist()
        coefficients = np.zeros(len(indices))
        for exponents, value in (([0, 0], 1.0), ([1, 0], 1.0), ([1, 1], -2.0), ([0, 4], 0.3 * np.sqrt(24.0))):
            coefficients[indices.index(exponents)] = value
        observed = truth(fresh) + 0.5 * noise((20, 1))
        mean = result.getPredictionInterval(fresh, LEVEL, noise=False)
        observation = result.getPredictionInterval(fresh, LEVEL)
        held = result.getCrossValidatedInterval(fresh, LEVEL)
        answers = {
            "coefficients": inside(result.getCoefficientsInterval(LEVEL), coefficients),
            "cross-validated": (held[0] <= observed) & (observed <= held[1]),
            "mean": (mean[0] <= truth(fresh)) & (truth(fresh) <= mean[1]),
            "observation": (observation[0] <= observed) & (observed <= observation[1]),
        }
        if truth is not quartic:
            # The coefficients of its projection are others.
            del answers["coefficients"]
        for name, answer in answers.items():
            hits.setdefault(name, []).append(np.mean(answer))
    return {name: float(np.mean(answer)) for name, answer in hits.items()}


def exponential_of_the_sum(x):
    return np.exp(0.5 * x.sum(axis=1, keepdims=True))


def table(title, rows):
    names = list(dict.fromkeys(name for _, _, answers in rows for name in answers))
    print(
        f"\n{title}: percentage of {REPETITIONS} repetitions in which the {100 * LEVEL:g} % interval holds the truth\n"
    )
    print(f"{'':24}{'size':>6}" + "".join(f"{name:>22}" for name in names))
    for label, size, answers in rows:
        cells = (f"{100.0 * answers[name]:22.1f}" if name in answers else f"{'-':>22}" for name in names)
        print(f"{label:24}{size:>6}" + "".join(cells))


def main():
    ot.RandomGenerator.SetSeed(SEED)
    random = np.random.default_rng(SEED)
    print("Command: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/interval_coverage.py")
    print(f"Seed {SEED}; Python {platform.python_version()}, numpy {np.__version__}, OpenTURNS {ot.__version__}")
    table(
        "Active subspace",
        [
            (name, size, subspace_coverage(*case, dimension, alone, size, random))
            for name, (case, dimension, alone) in SUBSPACES.items()
            for size in (50, 100, 300)
        ],
    )
    noises = {
        "normal noise": random.standard_normal,
        "Student 5 noise": lambda n: random.standard_t(5, n) / np.sqrt(5 / 3),
    }
    table(
        "Polynomial regression",
        [
            (name, size, regression_coverage(size, noise, random))
            for name, noise in noises.items()
            for size in (30, 60, 300)
        ]
        + [
            ("exp without noise", size, regression_coverage(size, np.zeros, random, truth=exponential_of_the_sum))
            for size in (100, 400)
        ],
    )


if __name__ == "__main__":
    main()
