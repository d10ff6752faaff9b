"""Time of the regression beside other packages: fit, prediction, exact probability, bootstrap.

Every contender gets the same data and one BLAS thread, and the contenders take turns: one call of each in a round.
Ratios are given twice, of medians and of minima over the rounds. scikit-learn and chaospy take part when they are
installed. Run as

    OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/regression_speed.py
"""

import importlib.util
import os
import platform
import time

import numpy as np
import openturns as ot
import scipy
from numpy.polynomial import hermite_e
from scipy.linalg import lapack

from satsep_ot.methods.polynomial_basis import PolynomialBasis, fit_polynomial
from satsep_ot.methods.polynomial_distribution import PolynomialDistribution
from satsep_ot.methods.polynomial_regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspace_estimation import bootstrap_distances, bootstrap_subspace, estimate_subspace

ot.TBB.SetThreadsNumber(1)

SEED = 0
DEGREE = 4
PREDICTIONS = 10_000
# A contender leaves the rounds when it has had this many seconds, but not before three of them.
PATIENCE = 1.5
ROUNDS = 200


def take_turns(contenders, rounds=ROUNDS):
    """Seconds of each call, a dict of name to list; a first call of each is not counted."""
    for call in contenders.values():
        call()
    seconds = {name: [] for name in contenders}
    for _ in range(rounds):
        for name, call in contenders.items():
            if sum(seconds[name]) > PATIENCE and len(seconds[name]) >= 3:
                continue
            start = time.perf_counter()
            call()
            seconds[name].append(time.perf_counter() - start)
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


def compare(dimension, size):
    """Rows of the fit and of the prediction table."""
    random = np.random.default_rng(SEED)
    points = random.standard_normal((size, dimension))
    values = np.exp(0.3 * points.sum(axis=1) / np.sqrt(dimension)) + 0.01 * random.standard_normal(size)
    fresh = random.standard_normal((PREDICTIONS, dimension))
    basis = PolynomialBasis(dimension, DEGREE)
    fitted = fit_polynomial(basis, points, values)
    others = {name: peer(basis, points, values) for name, peer in peers(dimension).items()}

    def floor():
        design = basis.evaluate(points)
        lapack.dgeqrf(design.T, lwork=64 * basis.size, overwrite_a=1)

    fits = {"floor": floor, "ours": lambda: fit_polynomial(basis, points, values)}
    seconds = take_turns(fits | {name: other.fit for name, other in others.items()})
    expected = fitted.predict(fresh)
    for name, other in others.items():
        if not np.allclose(np.ravel(other.predict(fresh)), expected, rtol=1e-6, atol=1e-6):
            raise RuntimeError(f"{name} fits another polynomial in {dimension} variables.")
    fit_row = [str(dimension), str(basis.size), str(size), f"{1e6 * np.median(seconds['floor']):.0f}"]
    fit_row += [ratio(seconds[name], seconds["floor"]) if name in seconds else "-" for name in NAMES]
    predictions = {"ours": lambda: fitted.predict(fresh)}
    given = {name: ot.Sample(fresh) if name == "OpenTURNS" else fresh for name in others}
    for name, other in others.items():
        predictions[name] = lambda other=other, points=given[name]: other.predict(points)
    seconds = take_turns(predictions)
    row = [str(dimension), str(basis.size), f"{1e6 * np.median(seconds['ours']):.0f}"]
    row += [ratio(seconds[name], seconds["ours"]) if name in seconds else "-" for name in NAMES[1:]]
    return fit_row, row


NAMES = ["ours", "numpy", "OpenTURNS", "scikit-learn", "chaospy"]


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
    fits, predictions = [], []
    for dimension in (1, 2, 3, 6, 10):
        for size in sorted({1_000, 10_000, 10 * PolynomialBasis(dimension, DEGREE).size}):
            if not 2 * PolynomialBasis(dimension, DEGREE).size <= size <= 10_010 or size < 1000:
                continue
            fit_row, row = compare(dimension, size)
            fits.append(fit_row)
        predictions.append(row)
    for dimension in (4, 5, 7, 8, 9):
        predictions.append(compare(dimension, 3 * PolynomialBasis(dimension, DEGREE).size)[1])
    table(
        "Fit of a quartic. Floor: basis evaluation and LAPACK dgeqrf in place, microseconds. "
        "Others as multiples of it: medians (minima)",
        ["r", "terms", "points", "floor", *NAMES],
        fits,
    )
    table(
        f"Prediction at {PREDICTIONS} points. Ours in microseconds, the others as multiples of it: medians (minima)",
        ["r", "terms", "ours", *NAMES[1:]],
        sorted(predictions, key=lambda row: int(row[0])),
    )
    table(
        "Probability that a fitted quartic exceeds 8: milliseconds with and without the set-up, medians (minima)",
        ["r", "probability", "stated error", "first", "next"],
        probability_rows(),
    )
    bootstrap()


if __name__ == "__main__":
    main()
