"""Reliability problems whose probability of failure is known, to test methods on.

A problem is a vectorised function of an ``(n, d)`` array, an input distribution, a limit and a reference probability
with its source. `getBenchmarkProblems` lists them all; to add one, write a function that returns a `BenchmarkProblem`
and name it in ``_FACTORIES``. Each is also there rotated, in other units and, where its probability is known for any
number of inputs, with another number of them: see `getBenchmarkProblem`.

RP problems: A. Rozsas and A. Slobbe, Repository and Black-box Reliability Challenge 2019 (the RPRepo), as in
otbenchmark. FourBranch: P.-H. Waarts, Structural reliability using finite element methods, TU Delft (2000). P2:
I. Papaioannou et al., Probabilistic Engineering Mechanics 41 (2015). UndampedOscillator, Rastrigin, FourBranch6:
B. Echard, N. Gayton and M. Lemaire, Structural Safety 33 (2011); with GaytonHat: B. Echard et al., Reliability
Engineering and System Safety 111 (2013). DampedOscillator: A. Der Kiureghian and M. de Stefano, Journal of Engineering
Mechanics 117 (1991); J.-M. Bourinet, F. Deheeger and M. Lemaire, Structural Safety 33 (2011). LogNormalSum:
R. Rackwitz, Structural Safety 23 (2001). FourBranch100, Duffing: J. Demange-Chryst et al. (2023).
"""

import math
from collections.abc import Callable

import numpy as np
import openturns as ot
from scipy.fft import irfft, rfft
from scipy.integrate import quad
from scipy.special import erf, ndtr
from scipy.stats import ncx2

from satsep_ot.methods.comparison.problem import BenchmarkProblem

__all__ = ["BenchmarkProblem", "getBenchmarkProblem", "getBenchmarkProblemNames", "getBenchmarkProblems"]


def _cosineDirection(dimension: int, index: int) -> np.ndarray:
    """Unit vectors in general position, orthonormal for different indices from 1: the basis of the cosine transform."""
    return math.sqrt(2.0 / dimension) * np.cos(math.pi * index * (np.arange(dimension) + 0.5) / dimension)


def _gaussianExpectation(function: Callable) -> float:
    """E[function(Z)] for a standard normal Z, by the trapezoidal rule on [-12, 12]."""
    z = np.linspace(-12.0, 12.0, 24001)
    return float(np.sum(function(z) * np.exp(-0.5 * z**2)) * (z[1] - z[0]) / math.sqrt(2.0 * math.pi))


def _normalProbability(z):
    return np.asarray(ot.DistFunc.pNormal(np.atleast_1d(z).tolist()))


def _linear(dimension: int = 100) -> BenchmarkProblem:
    return BenchmarkProblem(
        "P1",
        ot.Normal(dimension),
        lambda u: 3.5 - u.sum(axis=1) / math.sqrt(dimension),
        ot.DistFunc.pNormal(-3.5),
        "closed form Phi(-3.5)",
    )


def _quadratic(dimension: int = 40) -> BenchmarkProblem:
    probability = _gaussianExpectation(lambda t: _normalProbability(-(4.0 + 2.5 * t**2)))
    return BenchmarkProblem(
        "P2",
        ot.Normal(dimension),
        lambda u: 4.0 + 1.25 * (u[:, 0] - u[:, 1]) ** 2 - u.sum(axis=1) / math.sqrt(dimension),
        probability,
        "quadrature of Phi(-(4 + 5/2 t^2)); Papaioannou et al. (2015) give 6.62e-6",
    )


def _noisyRidge() -> BenchmarkProblem:
    w = _cosineDirection(30, 1)

    def evaluate(u):
        y = u @ w
        return 3.6 - y - 0.05 * y**2 - 0.01 * y**3 + 0.35 * np.sin(3.0 * u).sum(axis=1) / math.sqrt(30.0)

    return BenchmarkProblem(
        "P3",
        ot.Normal(30),
        evaluate,
        NOISY_RIDGE_PROBABILITY,
        "importance sampling shifted by 3 along the ridge, 2e7 points, coefficient of variation 0.05 %",
        probabilityError=5e-4,
    )


def _twoModes(dimension: int = 50) -> BenchmarkProblem:
    q1, q2, q3 = (_cosineDirection(dimension, k) for k in (1, 2, 3))
    w2 = math.cos(2.2) * q1 + math.sin(2.2) * q2

    def components(u):
        return np.column_stack([3.2 - u @ q1, 3.4 - u @ w2 + 0.2 * (u @ q3) ** 2])

    # P(both safe) = E over t = u.q3 of the bivariate normal distribution function of correlation cos(2.2).
    pair = ot.Normal([0.0] * 2, [1.0] * 2, ot.CorrelationMatrix([[1.0, math.cos(2.2)], [math.cos(2.2), 1.0]]))
    t = np.linspace(-8.0, 8.0, 401)
    safe = np.array([pair.computeCDF([3.2, 3.4 + 0.2 * tau**2]) for tau in t])
    density = np.exp(-0.5 * t**2) / math.sqrt(2.0 * math.pi)
    probability = float(np.sum((1.0 - safe) * density) * (t[1] - t[0]))
    return BenchmarkProblem(
        "P4",
        ot.Normal(dimension),
        components,
        probability,
        "quadrature of the bivariate normal distribution function",
        outputDimension=2,
        composition=lambda y: y.min(axis=1),
    )


def _radial(dimension: int = 20) -> BenchmarkProblem:
    squaredRadius = ot.ChiSquare(dimension).computeQuantile(1e-3, True)[0]
    return BenchmarkProblem(
        "P5",
        ot.Normal(dimension),
        lambda u: squaredRadius - (u**2).sum(axis=1),
        1e-3,
        "closed form: chi-square quantile",
    )


def _hiddenFailure(dimension: int = 20) -> BenchmarkProblem:
    q1, q2 = (_cosineDirection(dimension, k) for k in (1, 2))
    probability = _gaussianExpectation(lambda a: _normalProbability(-(3.0 + np.maximum(5.0 - 0.5 * a, 0.0) / 10.0)))
    return BenchmarkProblem(
        "P6",
        ot.Normal(dimension),
        lambda u: 5.0 - 0.5 * (u @ q1) - 10.0 * np.maximum(u @ q2 - 3.0, 0.0),
        probability,
        "quadrature of Phi(-(3 + max(5 - a/2, 0)/10))",
    )


def _norm1() -> BenchmarkProblem:
    # Each |u_i| rounded to a grid, and twenty of them added by Fourier convolution.
    step, size = 0.005, 2**15
    cells = np.diff(erf((np.arange(size) + 0.5) * step / math.sqrt(2.0)), prepend=0.0)
    total = irfft(rfft(cells) ** 20, size)
    limit = round(29.5 / step)
    return BenchmarkProblem(
        "P7",
        ot.Normal(20),
        lambda u: 29.5 - np.abs(u).sum(axis=1),
        float(total[limit + 1 :].sum() + 0.5 * total[limit]),
        "convolution of twenty half-normal densities",
    )


def _rp8() -> BenchmarkProblem:
    logNormal = [
        ot.LogNormalMuSigma(mu, sigma).getDistribution() for mu, sigma in [(120, 12)] * 4 + [(50, 10), (40, 8)]
    ]
    return BenchmarkProblem(
        "RP8",
        ot.JointDistribution(logNormal),
        lambda x: x @ np.array([1.0, 2.0, 2.0, 1.0, -5.0, -5.0]),
        7.89793e-4,
        "convolution of the six densities by OpenTURNS; the RPRepo gives 7.84e-4",
    )


def _rp14() -> BenchmarkProblem:
    distribution = ot.JointDistribution(
        [
            ot.Uniform(70.0, 80.0),
            ot.Normal(39.0, 0.1),
            ot.GumbelMuSigma(1500.0, 350.0).getDistribution(),
            ot.Normal(400.0, 0.1),
            ot.Normal(250000.0, 35000.0),
        ]
    )

    def evaluate(x):
        stress = 32.0 / (math.pi * x[:, 1] ** 3) * np.sqrt(x[:, 2] ** 2 * x[:, 3] ** 2 / 16.0 + x[:, 4] ** 2)
        return x[:, 0] - stress

    # The uniform input fails below the stress; the two that hardly vary need few nodes.
    nodes, weights = np.polynomial.hermite_e.hermegauss(3)
    z = np.linspace(-8.0, 8.0, 321)
    density = np.exp(-0.5 * z**2) * (z[1] - z[0]) / math.sqrt(2.0 * math.pi)
    force = np.asarray(distribution.getMarginal(2).computeQuantile(ndtr(z).tolist())).reshape(-1)
    grid = np.meshgrid(0.0, 39.0 + 0.1 * nodes, force, 400.0 + 0.1 * nodes, 250000.0 + 35000.0 * z, indexing="ij")
    stress = -evaluate(np.column_stack([axis.reshape(-1) for axis in grid])).reshape(3, 321, 3, 321)
    failed = np.clip((stress - 70.0) / 10.0, 0.0, 1.0)
    probability = float(np.einsum("ijkl,i,j,k,l", failed, weights, density, weights, density, optimize=True))
    return BenchmarkProblem(
        "RP14",
        distribution,
        evaluate,
        probability / (2.0 * math.pi),
        "quadrature; otbenchmark gives 7.7285e-4",
    )


def _rp22() -> BenchmarkProblem:
    # In the rotated axes a, b: failure when a >= 2.5 + 0.2 b^2.
    return BenchmarkProblem(
        "RP22",
        ot.Normal(2),
        lambda x: 2.5 - (x[:, 0] + x[:, 1]) / math.sqrt(2.0) + 0.1 * (x[:, 0] - x[:, 1]) ** 2,
        _gaussianExpectation(lambda b: _normalProbability(-(2.5 + 0.2 * b**2))),
        "quadrature; otbenchmark gives 4.207305e-3",
    )


def _rp54() -> BenchmarkProblem:
    return BenchmarkProblem(
        "RP54",
        ot.JointDistribution([ot.Exponential(1.0)] * 20),
        lambda x: x.sum(axis=1) - 8.951,
        ot.Gamma(20.0, 1.0).computeCDF(8.951),
        "closed form: Gamma distribution; otbenchmark gives 9.98e-4",
    )


def _rp63() -> BenchmarkProblem:
    chiSquare = ot.ChiSquare(99.0)
    grid = np.linspace(30.0, 200.0, 20001)
    density = np.asarray(chiSquare.computePDF(ot.Sample(grid[:, None]))).reshape(-1)
    probability = float(np.sum(density * _normalProbability(4.5 - 0.1 * grid)) * (grid[1] - grid[0]))
    return BenchmarkProblem(
        "RP63",
        ot.Normal(100),
        lambda x: 0.1 * (x[:, 1:] ** 2).sum(axis=1) - x[:, 0] - 4.5,
        probability,
        "quadrature over the chi-square; otbenchmark gives 3.79e-4",
    )


def _rp91() -> BenchmarkProblem:
    mean, deviation = (0.07433, 0.1, 13.0, 4751.0, -684.0), (0.005, 0.01, 60.0, 48.0, 11.0)

    def components(x):
        x1, x2, x3, x4, x5 = x.T
        first = 0.847 + 0.96 * x2 + 0.986 * x3 - 0.216 * x4 + 0.077 * x2**2 + 0.11 * x3**2 + 7.0 / 378.0 * x4**2
        first += -x3 * x2 - 0.106 * x2 * x4 - 0.11 * x3 * x4
        return np.column_stack(
            [
                first,
                84000.0 * x1 / np.sqrt(x3**2 + x4**2 - x3 * x4 + 3.0 * x5**2) - 1.0,
                84000.0 * x1 / np.abs(x4) - 1.0,
            ]
        )

    # The first component stays above 3e5, so it fails where x1 is below the larger of two stresses over 84000.
    nodes, weights = np.polynomial.hermite_e.hermegauss(12)
    z = np.linspace(-8.0, 8.0, 1601)
    x3, x4, x5 = np.meshgrid(13.0 + 60.0 * z, 4751.0 + 48.0 * nodes, -684.0 + 11.0 * nodes, indexing="ij")
    stress = np.maximum(np.sqrt(x3**2 + x4**2 - x3 * x4 + 3.0 * x5**2), np.abs(x4))
    conditional = ndtr((stress / 84000.0 - 0.07433) / 0.005)
    density = np.exp(-0.5 * z**2) * (z[1] - z[0]) / math.sqrt(2.0 * math.pi)
    probability = float(np.einsum("ijk,i,j,k", conditional, density, weights, weights)) / (2.0 * math.pi)
    return BenchmarkProblem(
        "RP91",
        ot.Normal(mean, deviation, ot.CorrelationMatrix(5)),
        components,
        probability,
        "quadrature; otbenchmark gives 6.97e-4",
        outputDimension=3,
        composition=lambda y: y.min(axis=1),
    )


def _rp107(dimension: int = 10) -> BenchmarkProblem:
    return BenchmarkProblem(
        "RP107",
        ot.Normal(dimension),
        lambda x: 5.0 * math.sqrt(dimension) - x.sum(axis=1),
        ot.DistFunc.pNormal(-5.0),
        "closed form Phi(-5); otbenchmark gives 2.92e-7",
    )


def _fourBranch(name: str = "FourBranch", width: float = 7.0) -> BenchmarkProblem:
    limit = width / math.sqrt(2.0)

    def components(x):
        total, difference = (x[:, 0] + x[:, 1]) / math.sqrt(2.0), x[:, 0] - x[:, 1]
        curved = 3.0 + 0.1 * difference**2
        return np.column_stack([curved - total, curved + total, limit + difference, limit - difference])

    # In the rotated axes a = total, b = difference / sqrt(2): safe when |a| < 3 + 0.2 b^2 and |b| < width / 2.
    edge = 0.5 * width
    curvedFailure, _ = quad(lambda b: 2.0 * ndtr(-(3.0 + 0.2 * b**2)) * ot.DistFunc.dNormal(b), -edge, edge)
    probability = float(curvedFailure + 2.0 * ndtr(-edge))
    return BenchmarkProblem(
        name,
        ot.Normal(2),
        components,
        probability,
        "quadrature" + ("; otbenchmark gives 2.222795e-3" if width == 7.0 else "; definition: Echard et al. (2011)"),
        outputDimension=4,
        composition=lambda y: y.min(axis=1),
    )


def _lognormal(mean: float, deviation: float) -> ot.Distribution:
    """Log-normal law of a mean and a deviation."""
    return ot.LogNormalMuSigma(mean, deviation).getDistribution()


def _undampedOscillator(force: float, forceDeviation: float) -> BenchmarkProblem:
    """Displacement of a spring-supported mass under a rectangular pulse; inputs m, c1, c2, r, t, F."""

    def amplitude(m, stiffness, t):
        return 2.0 / stiffness * np.sin(0.5 * np.sqrt(stiffness / m) * t)

    def components(x):
        m, c1, c2, r, t, f = x.T
        displacement = f * amplitude(m, c1 + c2, t)
        return np.column_stack([3.0 * r - displacement, 3.0 * r + displacement])

    # 3 r -+ F K is normal where m, c1 + c2 and t are given; both limits at once need r below -10 deviations.
    z = np.linspace(-8.0, 8.0, 65)
    density = np.exp(-0.5 * z**2) * (z[1] - z[0]) / math.sqrt(2.0 * math.pi)
    k = amplitude((1.0 + 0.05 * z)[:, None, None], (1.1 + math.hypot(0.1, 0.01) * z)[:, None], 1.0 + 0.2 * z)
    deviation = np.hypot(0.15, k * forceDeviation)
    conditional = ndtr((k * force - 1.5) / deviation) + ndtr((-k * force - 1.5) / deviation)
    return BenchmarkProblem(
        f"UndampedOscillator{force:g}",
        ot.Normal(
            [1.0, 1.0, 0.1, 0.5, 1.0, force], [0.05, 0.1, 0.01, 0.05, 0.2, forceDeviation], ot.CorrelationMatrix(6)
        ),
        components,
        float(np.einsum("ijk,i,j,k", conditional, density, density, density)),
        "quadrature over m, c1 + c2 and t, closed form in r and F; definition: Echard et al. (2011, 2013)",
        outputDimension=2,
        composition=lambda y: y.min(axis=1),
    )


def _dampedOscillator(force: float) -> BenchmarkProblem:
    """Force in the spring of a secondary oscillator on a primary one under white noise (Der Kiureghian and de Stefano,
    1991); inputs mp, ms, kp, ks, zp, zs, S, Fs."""

    def evaluate(x):
        mp, ms, kp, ks, zp, zs, s, fs = x.T
        wp, ws = np.sqrt(kp / mp), np.sqrt(ks / ms)
        wa, za, ga = 0.5 * (wp + ws), 0.5 * (zp + zs), ms / mp
        th = (wp - ws) / wa
        square = math.pi * s / (4.0 * zs * ws**3) * za * zs / (zp * zs * (4.0 * za**2 + th**2) + ga * za**2)
        return fs - 3.0 * ks * np.sqrt(square * (zp * wp**3 + zs * ws**3) * wp / (4.0 * za * wa**4))

    moments = (1.5, 0.15), (0.01, 0.001), (1.0, 0.2), (0.01, 0.002), (0.05, 0.02), (0.02, 0.01), (100.0, 10.0)
    probability, error = DAMPED_OSCILLATOR_PROBABILITIES[force]
    return BenchmarkProblem(
        f"DampedOscillator{force:g}",
        ot.JointDistribution([_lognormal(*pair) for pair in (*moments, (force, 0.1 * force))]),
        evaluate,
        probability,
        "importance sampling, closed form in Fs and S, 8e6 points; definition: Bourinet et al. (2011)",
        probabilityError=error,
    )


def _gaytonHat() -> BenchmarkProblem:
    # Failure where x2 >= 5 + ((x1 - 2)^2 / 2 - 3) / 1.5 to the power 1/3, which is vertical at two x1.
    def integrand(x):
        return ndtr(-5.0 - np.cbrt((0.5 * (x - 2.0) ** 2 - 3.0) / 1.5)) * ot.DistFunc.dNormal(x)

    kinks = [2.0 - math.sqrt(6.0), 2.0 + math.sqrt(6.0)]
    probability = quad(integrand, -10.0, 10.0, points=kinks, limit=500, epsabs=0.0, epsrel=1e-9)[0]
    return BenchmarkProblem(
        "GaytonHat",
        ot.Normal(2),
        lambda x: 0.5 * (x[:, 0] - 2.0) ** 2 - 1.5 * (x[:, 1] - 5.0) ** 3 - 3.0,
        float(probability),
        "quadrature; definition: Echard et al. (2013)",
    )


def _rastrigin() -> BenchmarkProblem:
    def wave(x):
        return x**2 - 5.0 * np.cos(2.0 * math.pi * x)

    # P(wave(X2) >= 10 - wave(x1)) from the crossings of wave with a level, found by linear interpolation.
    x = np.linspace(-8.0, 8.0, 6401)
    heights, density = wave(x), np.exp(-0.5 * x**2) * (x[1] - x[0]) / math.sqrt(2.0 * math.pi)
    probability = 0.0
    for level, weight in zip(10.0 - heights, density, strict=True):
        above = heights >= level
        (cells,) = np.nonzero(above[1:] != above[:-1])
        crossings = x[cells] + (level - heights[cells]) / (heights[cells + 1] - heights[cells]) * (x[1] - x[0])
        rises = np.where(above[cells], -1.0, 1.0)
        probability += weight * ((1.0 if above[-1] else 0.0) - (rises * ndtr(crossings)).sum())
    return BenchmarkProblem(
        "Rastrigin",
        ot.Normal(2),
        lambda x: 10.0 - wave(x).sum(axis=1),
        float(probability),
        "quadrature over x1, crossings in x2; definition: Echard et al. (2011)",
    )


def _rp38() -> BenchmarkProblem:
    means = np.array([350.0, 50.8, 3.81, 173.0, 9.38, 33.1, 0.036])

    def evaluate(x):
        a, b, c, d, e, f, h = x.T
        ratio = (d**2 - 4.0 * e * f * h**2 + d * (f + 4.0 * e + 2.0 * f * h)) / (d * e * (d + f + 2.0 * f * h))
        return 15.59e4 - a * b**3 / (2.0 * c**3) * ratio

    probability, error = RP38_PROBABILITY
    return BenchmarkProblem(
        "RP38",
        ot.Normal(means.tolist(), (0.1 * means).tolist(), ot.CorrelationMatrix(7)),
        evaluate,
        probability,
        "importance sampling, closed form in the first input, 8e6 points; definition: the RPRepo",
        probabilityError=error,
    )


def _rp53() -> BenchmarkProblem:
    def evaluate(x):
        return np.sin(2.5 * x[:, 0]) + 2.0 - (x[:, 0] ** 2 + 4.0) * (x[:, 1] - 1.0) / 20.0

    def conditional(z):
        x1 = 1.5 + z
        return ndtr(1.5 - 20.0 * (np.sin(2.5 * x1) + 2.0) / (x1**2 + 4.0))

    return BenchmarkProblem(
        "RP53",
        ot.Normal([1.5, 2.5], [1.0, 1.0], ot.CorrelationMatrix(2)),
        evaluate,
        _gaussianExpectation(conditional),
        "quadrature over x1, closed form in x2; definition: the RPRepo",
    )


def _leaf() -> BenchmarkProblem:
    def components(x):
        return np.column_stack([((x - centre) ** 2).sum(axis=1) - 1.0 for centre in (3.8, -3.8)])

    return BenchmarkProblem(
        "Leaf",
        ot.Normal(2),
        components,
        float(2.0 * ncx2.cdf(1.0, 2, 2.0 * 3.8**2)),
        "closed form: two discs of radius 1, non-central chi-square distribution",
        outputDimension=2,
        composition=lambda y: y.min(axis=1),
    )


def _lognormalSum(dimension: int) -> BenchmarkProblem:
    limit = dimension + 0.6 * math.sqrt(dimension)
    law = _lognormal(1.0, 0.2)
    # Each input rounded to a grid, and all of them added by Fourier convolution; the limit lies between two nodes.
    step, size = limit / 120_000.5, 2**18
    edges = (np.arange(size) + 0.5) * step
    cells = np.diff(ndtr((np.log(edges) - law.getParameter()[0]) / law.getParameter()[1]), prepend=0.0)
    total = irfft(rfft(cells) ** dimension, size)
    return BenchmarkProblem(
        f"LogNormalSum{dimension}",
        ot.JointDistribution([law] * dimension),
        lambda x: limit - x.sum(axis=1),
        float(total[120_001:].sum()),
        f"convolution of {dimension} log-normal densities; definition: Rackwitz (2001)",
    )


def _fourBranchOfSums() -> BenchmarkProblem:
    def components(x):
        a, b = x[:, :50].sum(axis=1) / 10.0, x[:, 50:].sum(axis=1) / 10.0
        return np.column_stack([3.5 + sign * (a + other * b) for sign in (1.0, -1.0) for other in (1.0, -1.0)])

    # (a + b) / 10 and (a - b) / 10 are independent standard normal.
    return BenchmarkProblem(
        "FourBranch100",
        ot.Normal(100),
        components,
        1.0 - (1.0 - 2.0 * ot.DistFunc.pNormal(-3.5)) ** 2,
        "closed form 1 - (1 - 2 Phi(-3.5))^2; definition: Demange-Chryst et al. (2023)",
        outputDimension=4,
        composition=lambda y: y.min(axis=1),
    )


def _duffing() -> BenchmarkProblem:
    """Displacement at the end of a Duffing oscillator under white noise of 200 normal amplitudes, by explicit Euler on
    the 500 times 0, 0.004, ..., 1.996 s. The published probability, 4.256e-4, belongs to these 499 steps; 500 steps
    would give 6.2e-4."""
    timeStep, steps = 0.004, 499
    spacing = 30.0 * math.pi / 200.0
    phase = np.outer(spacing * np.arange(100), timeStep * np.arange(steps))
    noise = -math.sqrt(0.01 * spacing) * np.vstack([np.cos(phase), np.sin(phase)])

    def displacement(u):
        z, v = np.zeros(len(u)), np.full(len(u), 1.5)
        for force in (u @ noise).T:
            acceleration = -0.2 * math.pi * v - (2.0 * math.pi) ** 2 * (z + z**3) + force
            z, v = z + timeStep * v, v + timeStep * acceleration
        return z

    probability, error = DUFFING_PROBABILITY
    return BenchmarkProblem(
        "Duffing",
        ot.Normal(200),
        displacement,
        probability,
        "importance sampling around the two most likely failures, 4e5 points; definition: Demange-Chryst et al. (2023)",
        composition=lambda y: np.minimum(0.1 - y.reshape(-1), y.reshape(-1) + 0.06),
        probabilityError=error,
    )


# Eight outputs of 35 inputs, each a slightly curved ridge with a little variation outside of it.
_RIDGE_NAMES = ("speed", "rate_x", "rate_y", "rate_z", "gap_1", "gap_2", "gap_3", "gap_4")


def _ridgeOutputs(u: np.ndarray) -> np.ndarray:
    directions = np.array([_cosineDirection(35, k) for k in range(1, 9)])
    y = u @ directions.T
    remainder = 0.01 * np.sin(2.0 * u).sum(axis=1) / math.sqrt(35.0)
    speed = 0.598 + 0.0025 * (y[:, 0] - 0.02 * y[:, 0] ** 2 + remainder)
    rateX, rateY, rateZ = (
        scale * (y[:, k] + 0.02 * y[:, 0] * y[:, k] + 0.01 * y[:, k] ** 2 + remainder)
        for k, scale in ((1, 0.614), (2, 0.371), (3, 0.6))
    )
    gaps = []
    for k, angle in enumerate(np.pi / 4.0 + np.arange(4) * np.pi / 2.0):
        drift = 0.8 * (math.cos(angle) * y[:, 1] + math.sin(angle) * y[:, 3]) + 0.6 * y[:, 4 + k]
        gaps.append(30.0 - 3.4 * (drift + 0.02 * drift**2 + remainder))
    return np.column_stack([speed, rateX, rateY, rateZ, *gaps])


_RIDGE_LIMITS: dict[str, Callable] = {
    "Speed35": lambda q: (q[:, 0] - 0.590) / 0.0025,
    "Norm35": lambda q: 2.5 - np.hypot(q[:, 1], q[:, 3]),
    "Absolute35": lambda q: 1.0 - np.abs(q[:, 2]),
    "Minimum35": lambda q: (q[:, 4:].min(axis=1) - 18.0) / 3.4,
}
_RIDGE_LIMITS["System35"] = lambda q: np.min([limit(q) for limit in list(_RIDGE_LIMITS.values())[:4]], axis=0)


def _ridgeFactory(name: str) -> Callable[[], BenchmarkProblem]:
    return lambda: BenchmarkProblem(
        name,
        ot.Normal(35),
        _ridgeOutputs,
        RIDGE_PROBABILITIES[name],
        "Monte Carlo, 1e8 points",
        outputDimension=len(_RIDGE_NAMES),
        composition=_RIDGE_LIMITS[name],
        probabilityError=1e-4 / math.sqrt(RIDGE_PROBABILITIES[name]),
    )


NOISY_RIDGE_PROBABILITY = 1.9643e-3
# Probabilities and relative standard errors of tests/benchmarks/reference_probabilities.py --sample.
DAMPED_OSCILLATOR_PROBABILITIES = {15.0: (4.7732e-3, 3e-4), 21.5: (4.4141e-5, 3e-4), 27.5: (3.7843e-7, 3e-4)}
RP38_PROBABILITY = 8.0508e-3, 3e-4
DUFFING_PROBABILITY = 4.255e-4, 4e-3
RIDGE_PROBABILITIES = {
    "Speed35": 1.27951e-3,
    "Norm35": 2.4002e-4,
    "Absolute35": 7.17186e-3,
    "Minimum35": 1.86184e-3,
    "System35": 1.044157e-2,
}

_FACTORIES: dict[str, Callable[..., BenchmarkProblem]] = {
    "P1": _linear,
    "P2": _quadratic,
    "P3": _noisyRidge,
    "P4": _twoModes,
    "P5": _radial,
    "P6": _hiddenFailure,
    "P7": _norm1,
    "RP8": _rp8,
    "RP14": _rp14,
    "RP22": _rp22,
    "RP54": _rp54,
    "RP63": _rp63,
    "RP91": _rp91,
    "RP107": _rp107,
    "FourBranch": _fourBranch,
    "FourBranch6": lambda: _fourBranch("FourBranch6", 6.0),
    "FourBranch100": _fourBranchOfSums,
    "UndampedOscillator1": lambda: _undampedOscillator(1.0, 0.2),
    "UndampedOscillator0.6": lambda: _undampedOscillator(0.6, 0.1),
    "UndampedOscillator0.45": lambda: _undampedOscillator(0.45, 0.075),
    "DampedOscillator15": lambda: _dampedOscillator(15.0),
    "DampedOscillator21.5": lambda: _dampedOscillator(21.5),
    "DampedOscillator27.5": lambda: _dampedOscillator(27.5),
    "GaytonHat": _gaytonHat,
    "Rastrigin": _rastrigin,
    "RP38": _rp38,
    "RP53": _rp53,
    "Leaf": _leaf,
    "LogNormalSum40": lambda: _lognormalSum(40),
    "LogNormalSum100": lambda: _lognormalSum(100),
    "Duffing": _duffing,
    **{name: _ridgeFactory(name) for name in _RIDGE_LIMITS},
}


# Problems whose probability is known for any number of inputs, and the least number that they need.
_SMALLEST_DIMENSIONS = {"P1": 1, "P2": 2, "P4": 4, "P5": 1, "P6": 3, "RP107": 1}


def getBenchmarkProblem(name: str) -> BenchmarkProblem:
    """The benchmark problem of that name.

    Parameters
    ----------
    name : str
        One of `getBenchmarkProblemNames`, and after it, joined by hyphens and applied in this order from the left:
        ``d`` and a number of inputs (P1, P2, P4, P5, P6 and RP107), ``rotated``, ``rescaled``.

    Raises
    ------
    ValueError
        When there is no such problem.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.problems import getBenchmarkProblem
    >>> getBenchmarkProblem("RP107")
    BenchmarkProblem(name=RP107, probability=2.8665e-07)
    >>> getBenchmarkProblem("P1-d20-rotated").getDistribution().getDimension()
    20
    """
    base, *variants = name.split("-")
    if base not in _FACTORIES:
        raise ValueError(f"no benchmark problem is called {name!r}; there are {', '.join(_FACTORIES)}")
    problem = _FACTORIES[base]()
    for place, variant in enumerate(variants):
        if variant == "rotated":
            problem = problem.rotated()
        elif variant == "rescaled":
            problem = problem.rescaled()
        elif place == 0 and variant.startswith("d") and variant[1:].isdecimal():
            problem = _resized(base, int(variant[1:]))
        else:
            raise ValueError(
                f"{name!r} is no variant of a benchmark problem; after {base} there can be d and a number of inputs, "
                "rotated, rescaled, in this order and joined by hyphens"
            )
    return problem


def _resized(name: str, dimension: int) -> BenchmarkProblem:
    if name not in _SMALLEST_DIMENSIONS:
        raise ValueError(
            f"{name} has one number of inputs; another one can be had of {', '.join(_SMALLEST_DIMENSIONS)}"
        )
    least = _SMALLEST_DIMENSIONS[name]
    if not least <= dimension <= 1000:
        raise ValueError(f"{name} is there with {least} to 1000 inputs, not with {dimension}")
    return _FACTORIES[name](dimension).varied(f"d{dimension}")


def getBenchmarkProblemNames() -> list[str]:
    """Names of all benchmark problems.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.problems import getBenchmarkProblemNames
    >>> getBenchmarkProblemNames()[:3]
    ['P1', 'P2', 'P3']
    """
    return list(_FACTORIES)


def getBenchmarkProblems() -> list[BenchmarkProblem]:
    """All benchmark problems.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.problems import getBenchmarkProblems
    >>> [problem.getName() for problem in getBenchmarkProblems()][:3]
    ['P1', 'P2', 'P3']
    """
    return [factory() for factory in _FACTORIES.values()]
