"""Time of the regression beside other packages: fit, prediction, exact probability, bootstrap.

Every contender gets the same data and one BLAS thread, and the contenders take turns. A turn of a short one is the mean
of several calls, some milliseconds of them, so that none pays for what another one left in the caches. What is counted
is processor time, since the machine may be busy.
Ratios are given twice, of medians and of minima over the rounds. scikit-learn and chaospy take part when they are
installed. Run as

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/regression_speed.py
"""

import gc
import importlib.util
import math
import os
import platform
import time

import numpy as np
import openturns as ot
import scipy
from numpy.polynomial import hermite_e
from scipy.linalg import lapack

from satsep_ot.methods.polynomials.basis import PolynomialBasis
from satsep_ot.methods.polynomials.distribution import PolynomialDistribution
from satsep_ot.methods.polynomials.fit import fit_polynomial
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspaces.estimation import bootstrap_distances, bootstrap_subspace, estimate_subspace

ot.TBB.SetThreadsNumber(1)

SEED = 0
DEGREE = 4
PREDICTIONS = (1_000, 10_000)
# A contender leaves the rounds when it has had this many seconds, but not before two of them.
PATIENCE = 0.5
# Seconds of a call whose first one counts.
LONG = 0.3
# Seconds that a turn takes at least, with this number of calls at most.
TURN = 0.002
CALLS = 50
ROUNDS = 200


def take_turns(contenders, rounds=ROUNDS):
    """Seconds of a call in each turn, a dict of name to list; the first turn of a short one is not counted."""
    calls, seconds = {}, {}
    for name, contender in contenders.items():
        first = timed(contender, 1)
        if first < LONG:
            first = timed(contender, 1)
        calls[name] = min(CALLS, math.ceil(TURN / first))
        seconds[name] = [first] if first >= LONG else []
    for _ in range(rounds):
        for name, contender in contenders.items():
            if len(seconds[name]) < 2 or calls[name] * sum(seconds[name]) < PATIENCE:
                seconds[name].append(timed(contender, calls[name]))
    return seconds


def timed(contender, calls):
    """Seconds of a call, without the garbage collector, as timeit does: the garbage may be that of others."""
    gc.disable()
    start = time.process_time()
    for _ in range(calls):
        contender()
    seconds = (time.process_time() - start) / calls
    gc.enable()
    return seconds


def ratio(seconds, reference):
    return f"{np.median(seconds) / np.median(reference):.2f} ({min(seconds) / min(reference):.2f})"


def table(title, header, rows):
    print(f"\n{title}\n")
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    for row in [header, *rows]:
        print("  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)))


class Numpy:
    """Products of numpy's Hermite Vandermonde matrices and its lstsq."""

    def __init__(self, basis, points, values):
        self.basis, self.points, self.values = basis, points, values

    def design(self, points):
        design = np.ones((len(points), self.basis.size))
        for variable, column in enumerate(points.T):
            design *= hermite_e.hermevander(column, DEGREE)[:, self.basis.indices[:, variable]]
        return design

    def fit(self):
        self.coefficients = np.linalg.lstsq(self.design(self.points), self.values, rcond=None)[0]

    def predict(self, points):
        return self.design(points) @ self.coefficients


class OpenTURNS:
    def __init__(self, basis, points, values):
        self.size = basis.size
        self.sample, self.outputs = ot.Sample(points), ot.Sample(values[:, None])
        self.law = ot.Normal(basis.dimension)
        self.family = ot.OrthogonalProductPolynomialFactory([ot.HermiteFactory()] * basis.dimension)

    def fit(self):
        expansion = ot.LeastSquaresExpansion(self.sample, self.outputs, self.law, self.family, self.size, "QR")
        expansion.run()
        self.metaModel = expansion.getResult().getMetaModel()

    def predict(self, points):
        return self.metaModel(points)


class ScikitLearn:
    def __init__(self, basis, points, values):
        from sklearn.linear_model import LinearRegression
        from sklearn.pipeline import make_pipeline
        from sklearn.preprocessing import PolynomialFeatures

        self.points, self.values = points, values
        self.model = make_pipeline(PolynomialFeatures(DEGREE), LinearRegression(fit_intercept=False))

    def fit(self):
        self.model.fit(self.points, self.values)

    def predict(self, points):
        return self.model.predict(points)


class Chaospy:
    def __init__(self, basis, points, values):
        import chaospy

        self.chaospy = chaospy
        self.nodes, self.values = np.ascontiguousarray(points.T), values
        law = chaospy.J(*[chaospy.Normal(0, 1) for _ in range(basis.dimension)])
        self.expansion = chaospy.generate_expansion(DEGREE, law, normed=True)

    def fit(self):
        self.model = self.chaospy.fit_regression(self.expansion, self.nodes, self.values)

    def predict(self, points):
        return self.model(*points.T)


def peers(dimension):
    found = {"numpy": Numpy, "OpenTURNS": OpenTURNS}
    for module, name, peer in (("sklearn", "scikit-learn", ScikitLearn), ("chaospy", "chaospy", Chaospy)):
        # chaospy needs minutes to set its 1001 polynomials of ten variables up.
        if importlib.util.find_spec(module) is not None and not (module == "chaospy" and dimension > 6):
            found[name] = peer
    return found


def data_of(dimension, size):
    random = np.random.default_rng(SEED)
    points = random.standard_normal((size, dimension))
    values = np.exp(0.3 * points.sum(axis=1) / np.sqrt(dimension)) + 0.01 * random.standard_normal(size)
    return points, values


def regression_of(points, values):
    regression = MultivariatePolynomialRegression(points, values[:, None], ot.Normal(points.shape[1]))
    regression.run()
    return regression.getResult()


def fit_row(dimension, size):
    points, values = data_of(dimension, size)
    basis = PolynomialBasis(dimension, DEGREE)
    others = {name: peer(basis, points, values) for name, peer in peers(dimension).items()}

    def householder():
        lapack.dgeqrf(basis.evaluate(points).T, lwork=64 * basis.size, overwrite_a=1)

    def recursive():
        lapack.dgeqrt(max(2, min(basis.size // 3, 32)), basis.evaluate(points).T, overwrite_a=1)

    seconds = take_turns(
        {
            "dgeqrf": householder,
            "dgeqrt": recursive,
            "ours": lambda: fit_polynomial(basis, points, values),
            "whole class": lambda: regression_of(points, values),
        }
        | {name: other.fit for name, other in others.items()}
    )
    expected = fit_polynomial(basis, points, values).predict(points)
    for name, other in others.items():
        if not np.allclose(np.ravel(other.predict(points)), expected, rtol=1e-6, atol=1e-6):
            raise RuntimeError(f"{name} fits another polynomial in {dimension} variables.")
    floor = min((seconds["dgeqrf"], seconds["dgeqrt"]), key=np.median)
    row = [str(dimension), str(basis.size), str(size), f"{1e6 * np.median(floor):.0f}"]
    return row + [ratio(seconds[name], floor) if name in seconds else "-" for name in ["ours", "whole class", *PEERS]]


def prediction_rows(dimension):
    basis = PolynomialBasis(dimension, DEGREE)
    points, values = data_of(dimension, max(1000, 3 * basis.size))
    result = regression_of(points, values)
    others = {name: peer(basis, points, values) for name, peer in peers(dimension).items()}
    for other in others.values():
        other.fit()
    rows = []
    for count in PREDICTIONS:
        fresh = np.random.default_rng(SEED + 1).standard_normal((count, dimension))
        sample = ot.Sample(fresh)
        contenders = {"ours": lambda fresh=fresh: result.evaluate(fresh)}
        for name, other in others.items():
            given = sample if name == "OpenTURNS" else fresh
            contenders[name] = lambda other=other, given=given: other.predict(given)
            if not np.allclose(np.ravel(other.predict(given)), result.evaluate(fresh)[:, 0], rtol=1e-6, atol=1e-6):
                raise RuntimeError(f"{name} predicts something else in {dimension} variables.")
        seconds = take_turns(contenders)
        row = [str(dimension), str(basis.size), str(count), f"{1e6 * np.median(seconds['ours']):.0f}"]
        rows.append(row + [ratio(seconds[name], seconds["ours"]) if name in seconds else "-" for name in PEERS])
    return rows


PEERS = ["numpy", "OpenTURNS", "scikit-learn", "chaospy"]


def probability_rows():
    rows = []
    for dimension, inner in ((1, 60), (2, 150), (3, 300)):
        inputs = np.array(ot.Normal(dimension).getSample(inner))
        outputs = (np.exp(0.5 * inputs.sum(axis=1)) + inputs[:, 0] ** 4 / 20.0)[:, None]
        regression = MultivariatePolynomialRegression(inputs, outputs, ot.Normal(dimension))
        regression.run()
        result = regression.getResult()
        threshold = 8.0
        law = PolynomialDistribution(result)
        seconds = take_turns(
            {
                "first": lambda result=result: PolynomialDistribution(result).computeComplementaryCDF(8.0),
                "next": lambda law=law: law.computeComplementaryCDF(8.0),
            },
            50,
        )
        probability = law.computeComplementaryCDF(threshold)
        rows.append(
            [
                str(dimension),
                f"{probability:.6e}",
                f"{law.computeCDFError(threshold):.1e}",
                *(f"{1e3 * np.median(seconds[name]):.2f} ({1e3 * min(seconds[name]):.2f})" for name in seconds),
            ]
        )
    return rows


def bootstrap():
    gradients = np.random.default_rng(SEED).standard_normal((200, 35, 1)) * np.linspace(1.0, 0.05, 35)[:, None]
    vectors = estimate_subspace(gradients)[1]

    def run():
        _, _, replicates = bootstrap_subspace(gradients, 1000, 10)
        bootstrap_distances(vectors, replicates)

    seconds = take_turns({"run": run}, 10)["run"]
    print(
        f"\nBootstrap of 1,000 replicates, 35 inputs, 200 gradients, with the subspace distances of dimension 1 to 10: "
        f"median {np.median(seconds):.3f} s, minimum {min(seconds):.3f} s"
    )


def main():
    ot.RandomGenerator.SetSeed(SEED)
    if os.environ.get("OPENBLAS_NUM_THREADS") != "1" or os.environ.get("OMP_NUM_THREADS") != "1":
        raise SystemExit("Set OMP_NUM_THREADS=1 and OPENBLAS_NUM_THREADS=1: the comparison is on one thread.")
    print("Command: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/regression_speed.py")
    print(
        f"Seed {SEED}; Python {platform.python_version()}, numpy {np.__version__}, scipy {scipy.__version__}, "
        f"OpenTURNS {ot.__version__}"
    )
    for module, name in (("sklearn", "scikit-learn"), ("chaospy", "chaospy")):
        if importlib.util.find_spec(module) is None:
            print(f"{name} is not installed: it is left out.")
        else:
            print(f"{name} {importlib.import_module(module).__version__}")
    table(
        "Fit of a quartic. Floor in microseconds: basis evaluation and the faster of LAPACK's dgeqrf and dgeqrt. "
        "The others are multiples of it: medians (minima)",
        ["r", "terms", "points", "floor", "ours", "whole class", *PEERS],
        [
            fit_row(dimension, size)
            for dimension in (1, 2, 3, 4, 5, 6, 10)
            for size in (1_000, 10_000)
            if size > 2 * PolynomialBasis(dimension, DEGREE).size
        ],
    )
    table(
        "Prediction by MultivariatePolynomialRegressionResult.evaluate in microseconds, the others as multiples of it: "
        "medians (minima)",
        ["r", "terms", "points", "ours", *PEERS],
        [row for dimension in range(1, 11) for row in prediction_rows(dimension)],
    )
    table(
        "Probability that a fitted quartic exceeds 8: milliseconds with and without the set-up, medians (minima)",
        ["r", "probability", "stated error", "first", "next"],
        probability_rows(),
    )
    bootstrap()


if __name__ == "__main__":
    main()
