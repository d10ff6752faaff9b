"""Random reliability problems whose probability of failure is known: a family that no method was tuned on.

    python tests/benchmarks/random_systems.py [--seeds 0 150] [--check] [--points 40000]

lists systems, a line each; with ``--check`` each probability is computed a second time, by importance sampling of the
OpenTURNS event itself.

**Construction.** A system is made in the space of independent standard normal inputs u. Its parts depend on orthogonal
directions, hence they are independent, and the probability is ``1 - prod(1 - p_k)`` for a series system (the smallest
value of all parts) and ``prod p_k`` for a parallel one (the largest). A part is a margin of one to four active
coordinates, seen through an increasing link T with T(0) = 0 and a scale: only the sign of a value matters, so that
neither changes the probability. The result may be multiplied by a positive function of another direction, which does
not change the probability either. Inputs are standard normal, normal in units of their own, or of many laws, with or
without a normal copula; the system takes them back to u by their distribution functions.

**Kinds of systems** and their share:

========== ===== ====================================================================================================
single      19 % one smooth part
steep       24 % a gentle smooth part and one to three others, 5 to 1e6 times as steep, which carry 30 to 95 % of P
pair        13 % two limits at an angle of 60 to 180 degrees, the second maybe curved along a third direction and
                 often 5 to 1e4 times as steep
series      12 % two to four parts, smooth, two-sided or radial, at scales from 1e-3 to 1e3
parallel     5 % the larger of two smooth parts
abrupt       8 % a gentle linear part, and a ramp, step, band, corner or island that carries 30 to 90 % of P
plateau      6 % one or two parts that are flat where inputs are likely
two-sided    6 % one part: two-sided, the absolute value, or a norm, maybe off centre
direct       7 % limits of the inputs themselves: of one, of any of several, of a product of lognormal ones, of a sum of
                 exponential ones; mainly bounded or skewed laws
========== ===== ====================================================================================================

Smooth parts: linear; quadratic (a ridge curved along a second direction); cubic; radial (2 to 4 directions). Links:
identity, asinh, root, cube root, square, cube (of signed values), exponential, saturating exponential, logarithm,
tanh, and two with a slope that changes by 20 at the limit. P is log-uniform from 1e-9 to 1e-1 and d log-uniform from 2
to 100, but at least the number of active coordinates. One system in three has directions along inputs, one in three in
a part of the inputs, one in three in all of them. Three in ten have standard normal inputs, two in ten normal ones in
units of their own, the others inputs of all `LAWS`, one in seven of all with a normal copula. Where an input
that is not normal is as unlikely as 8.2 standard deviations it no longer matters, since distribution functions have no
more digits.

**Two halves.** Seeds of `DESIGN` are there to design with. Seeds of `HELD_OUT` are opened once: a version of an
estimator is run on them one time, when it is finished, and the first result is the one that counts, whatever it is.
What is changed afterwards needs fresh seeds.
"""

import argparse
import dataclasses
import math
from collections.abc import Callable
from importlib import metadata

import numpy as np
import openturns as ot
from scipy.optimize import brentq
from scipy.special import ndtr, ndtri
from scipy.stats import chi2, gamma, ncx2

DESIGN = range(150)
HELD_OUT = range(100_000, 100_150)
KINDS = {
    "single": 0.19,
    "steep": 0.24,
    "pair": 0.13,
    "series": 0.12,
    "parallel": 0.05,
    "abrupt": 0.08,
    "plateau": 0.06,
    "two-sided": 0.06,
    "direct": 0.07,
}
LARGEST_DIMENSION = 100
# Distribution functions of bounded laws are exactly 0 or 1 beyond this many standard deviations.
LARGEST_NORMAL = 8.2

# Links: increasing, 0 at 0. -------------------------------------------------------------------------------------------


def _signed(power: float) -> Callable:
    return lambda m: np.sign(m) * np.abs(m) ** power


LINKS: dict[str, Callable] = {
    "identity": lambda m: m,
    "asinh": lambda m: np.arcsinh(5.0 * m),
    "root": _signed(0.5),
    "cube root": _signed(1.0 / 3.0),
    "square": _signed(2.0),
    "cube": _signed(3.0),
    "exponential": lambda m: np.expm1(np.minimum(m, 300.0)),
    "saturating": lambda m: -np.expm1(-np.maximum(m, -300.0)),
    "logarithm": lambda m: np.sign(m) * np.log1p(10.0 * np.abs(m)),
    "tanh": np.tanh,
    "steeper in failure": lambda m: np.where(m > 0.0, m, 20.0 * m),
    "steeper in safety": lambda m: np.where(m > 0.0, 20.0 * m, m),
}


# Parts. ---------------------------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Part:
    """A margin of some coordinates, at most 0 in failure.

    Attributes
    ----------
    kind : str
    size : int
        Number of its coordinates r.
    value : callable
        Maps an ``(n, r)`` array of independent standard normal coordinates on ``(n,)`` values.
    probability : float
        That the value is at most 0.
    """

    kind: str
    size: int
    value: Callable
    probability: float

    def seen(self, link: str, scale: float) -> "Part":
        """The same part through a link and at a scale."""
        kind = self.kind + ("" if link == "identity" else f" ({link})") + ("" if scale == 1.0 else f" x{scale:.2g}")
        return dataclasses.replace(self, kind=kind, value=lambda y: scale * LINKS[link](self.value(y)))


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(400)


def _integral(function, low, high):
    """Gauss-Legendre quadrature over the last axis, 400 points."""
    nodes = 0.5 * (high - low) * _NODES + 0.5 * (high + low)
    return (function(nodes) * _WEIGHTS).sum(axis=-1) * 0.5 * (high - low)


def _expectation(function):
    """E[function(Z)] of a standard normal Z."""
    return _integral(lambda z: function(z) * np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi), -10.0, 10.0)


def _solve(probability: Callable, p: float, low: float, high: float) -> float:
    """Parameter between bounds at which a probability is p."""
    return float(brentq(lambda b: math.log(max(probability(b), 1e-300) / p), low, high, xtol=1e-12))


def linear(rng, p):
    b = -ndtri(p)
    return Part("linear", 1, lambda y: b - y[:, 0], float(ndtr(-b)))


def quadratic(rng, p):
    curvature = rng.uniform(-0.06, 0.6)

    def probability(b):
        return float(_expectation(lambda t: ndtr(-(b + curvature * t**2))))

    b = _solve(probability, p, -6.0, 9.0)
    return Part("quadratic", 2, lambda y: b + curvature * y[:, 1] ** 2 - y[:, 0], probability(b))


def cubic(rng, p):
    b, c = -ndtri(p), rng.uniform(0.02, 0.3)
    slope = 1.0 + 3.0 * c * b**2
    return Part("cubic", 1, lambda y: (b + c * b**3 - y[:, 0] - c * y[:, 0] ** 3) / slope, float(ndtr(-b)))


def radial(rng, p):
    size = int(rng.integers(2, 5))
    radius = math.sqrt(chi2.isf(p, size))
    return Part("radial", size, lambda y: radius - np.sqrt((y**2).sum(axis=1)), float(chi2.sf(radius**2, size)))


def norm_off_centre(rng, p):
    size, centre = int(rng.integers(2, 4)), rng.uniform(0.5, 1.5)

    def probability(radius):
        return float(ncx2.sf(radius**2, size, centre**2))

    radius = _solve(probability, p, 0.1, 12.0)

    def value(y):
        return radius - np.sqrt((y[:, 0] - centre) ** 2 + (y[:, 1:] ** 2).sum(axis=1))

    return Part("norm", size, value, probability(radius))


def absolute(rng, p):
    b = -ndtri(0.5 * p)
    return Part("absolute", 1, lambda y: b - np.abs(y[:, 0]), float(2.0 * ndtr(-b)))


def two_sided(rng, p):
    share, slope = rng.uniform(0.2, 0.8), 10.0 ** rng.uniform(0.0, 3.0)
    upper, lower = -ndtri(share * p), -ndtri((1.0 - share) * p)

    def value(y):
        return np.minimum(upper - y[:, 0], slope * (lower + y[:, 0]))

    return Part("two-sided", 1, value, float(ndtr(-upper) + ndtr(-lower)))


def ramp(rng, p):
    """Fails where t exceeds t0 and the ramp eats the margin of the other direction."""
    slope, steepness, b = rng.uniform(0.1, 0.5), rng.uniform(5.0, 20.0), rng.uniform(2.0, 4.0)

    def probability(t0):
        return float(_integral(lambda a: _ramp_density(a, t0), -10.0, b / slope) + ndtr(-b / slope))

    def _ramp_density(a, t0):
        return ndtr(-(t0 + (b - slope * a) / steepness)) * np.exp(-0.5 * a**2) / math.sqrt(2.0 * math.pi)

    # A limit that the other direction alone does not reach.
    b = max(b, slope * -ndtri(0.1 * p))
    t0 = _solve(probability, p, -4.0, 9.0)

    def value(y):
        return b - slope * y[:, 0] - steepness * np.maximum(y[:, 1] - t0, 0.0)

    return Part("ramp", 2, value, probability(t0))


def step(rng, p):
    """The margin of one direction drops where another one exceeds a threshold."""
    b = -ndtri(rng.uniform(0.1, 0.5) * p)
    drop = b + rng.uniform(0.5, 2.0)

    def probability(t0):
        return float(ndtr(-b) * ndtr(t0) + ndtr(drop - b) * ndtr(-t0))

    t0 = _solve(probability, p, -4.0, 9.0)
    return Part("step", 2, lambda y: b - y[:, 0] - drop * (y[:, 1] > t0), probability(t0))


def band(rng, p):
    width = rng.uniform(0.8, 1.6)

    def probability(low):
        return float(ndtr(-low) - ndtr(-low - width))

    low = _solve(probability, p, 0.0, 8.0)
    return Part("band", 1, lambda y: np.abs(y[:, 0] - low - 0.5 * width) - 0.5 * width, probability(low))


def corner(rng, p):
    share = rng.uniform(0.3, 0.7)
    first, second = -ndtri(p**share), -ndtri(p ** (1.0 - share))
    slope = 10.0 ** rng.uniform(-1.0, 1.0)

    def value(y):
        return np.maximum(first - y[:, 0], slope * (second - y[:, 1]))

    return Part("corner", 2, value, float(ndtr(-first) * ndtr(-second)))


def island(rng, p):
    radius = rng.uniform(1.0, 1.6)

    def probability(distance):
        return float(ncx2.cdf(radius**2, 2, distance**2))

    distance = _solve(probability, p, 0.01, 9.0)
    return Part("island", 2, lambda y: np.hypot(y[:, 0] - distance, y[:, 1]) - radius, probability(distance))


def plateau(rng, p):
    part = (linear, quadratic)[rng.integers(2)](rng, p)
    height = rng.uniform(0.15, 0.5) * max(-ndtri(p), 1.0)
    return dataclasses.replace(part, kind=f"plateau of {part.kind}", value=lambda y: np.minimum(part.value(y), height))


def pair(rng, p):
    """Two limits at an angle, each through its link; P by quadrature over one or two coordinates."""
    share = rng.uniform(0.1, 0.7)
    first, second = -ndtri(share * p), -ndtri((1.0 - share) * p)
    angle = math.radians(rng.uniform(60.0, 175.0))
    curvature = rng.uniform(0.0, 0.3) if rng.random() < 0.4 else 0.0
    opposite = rng.random() < 0.25
    cosine, sine = (-1.0, 0.0) if opposite else (math.cos(angle), math.sin(angle))
    factor = 10.0 ** rng.uniform(math.log10(5.0), 4.0) if rng.random() < 0.7 else 1.0
    links = _link(rng), _link(rng)
    curved = curvature > 0.0
    size = 1 + (not opposite) + curved

    def value(y):
        along = cosine * y[:, 0] + (0.0 if opposite else sine * y[:, 1])
        bend = curvature * y[:, -1] ** 2 if curved else 0.0
        return np.minimum(LINKS[links[0]](first - y[:, 0]), factor * LINKS[links[1]](second + bend - along))

    def later(bend):
        """Probability that the second limit alone is violated, for a bend of it."""
        if opposite:
            return ndtr(-(second + bend))
        b = np.asarray(second + bend)[..., None]
        density = lambda a: ndtr(-(b - cosine * a) / sine) * np.exp(-0.5 * a**2) / math.sqrt(2.0 * math.pi)  # noqa: E731
        return _integral(density, -10.0, first)

    alone = _expectation(lambda t: later(curvature * t**2)) if curved else later(0.0)
    degrees = 180 if opposite else round(math.degrees(angle))
    kind = f"{links[0]} and {'curved ' if curved else ''}{links[1]} at {degrees} degrees, x{factor:.2g}"
    return Part(kind, size, value, float(ndtr(-first) + alone))


SMOOTH = linear, quadratic, cubic, radial
ABRUPT = ramp, step, band, corner, island
TWO_SIDED = absolute, two_sided, norm_off_centre


def _link(rng) -> str:
    """Every other part is seen as it is."""
    return "identity" if rng.random() < 0.45 else str(rng.choice(list(LINKS)))


def _any_of(rng, factories, p) -> Part:
    return factories[rng.integers(len(factories))](rng, p)


# Parts of each kind of system. ----------------------------------------------------------------------------------------


def _single(rng, p):
    return [_any_of(rng, SMOOTH, p).seen(_link(rng), 1.0)]


def _steep(rng, p):
    number = int(rng.choice([1, 2, 3], p=[0.6, 0.25, 0.15]))
    share = rng.uniform(0.3, 0.95)
    parts = [_any_of(rng, (linear, quadratic, cubic), (1.0 - share) * p).seen(_link(rng), 1.0)]
    for part in rng.dirichlet(np.full(number, 3.0)) * share * p:
        factor = 10.0 ** rng.uniform(math.log10(5.0), 3.0 if rng.random() < 0.8 else 6.0)
        parts.append(_any_of(rng, (*SMOOTH, linear, quadratic), part).seen(_link(rng), factor))
    return parts


def _series(rng, p):
    number = int(rng.choice([2, 3, 4], p=[0.6, 0.25, 0.15]))
    factories = (*SMOOTH, absolute, two_sided)
    return [
        _any_of(rng, factories, part).seen(_link(rng), 10.0 ** rng.uniform(-3.0, 3.0))
        for part in rng.dirichlet(np.full(number, 1.5)) * p
    ]


def _parallel(rng, p):
    share = rng.uniform(0.3, 0.7)
    factories = linear, quadratic, cubic
    return [_any_of(rng, factories, p**part).seen(_link(rng), 1.0) for part in (share, 1.0 - share)]


def _abrupt(rng, p):
    share = rng.uniform(0.3, 0.9)
    factor = 10.0 ** rng.uniform(0.0, 2.0)
    return [linear(rng, (1.0 - share) * p), _any_of(rng, ABRUPT, share * p).seen("identity", factor)]


def _plateau(rng, p):
    parts = [plateau(rng, p)] if rng.random() < 0.6 else [plateau(rng, 0.6 * p), plateau(rng, 0.4 * p)]
    return [part.seen(_link(rng), 10.0 ** rng.uniform(-1.0, 1.0)) for part in parts]


PARTS = {
    "single": _single,
    "steep": _steep,
    "pair": lambda rng, p: [pair(rng, p)],
    "series": _series,
    "parallel": _parallel,
    "abrupt": _abrupt,
    "plateau": _plateau,
    "two-sided": lambda rng, p: [_any_of(rng, TWO_SIDED, p).seen(_link(rng), 1.0)],
}


# Inputs. --------------------------------------------------------------------------------------------------------------


def _mixture(rng):
    """Two clusters with nothing between them, or two normal laws."""
    if rng.random() < 0.5:
        laws = [ot.Uniform(0.0, 1.0), ot.Uniform(3.0, 3.0 + rng.uniform(0.5, 2.0))]
    else:
        laws = [ot.Normal(-2.0, 0.5), ot.Normal(rng.uniform(1.0, 3.0), 1.0)]
    share = rng.uniform(0.2, 0.8)
    return ot.Mixture(laws, [share, 1.0 - share])


LAWS: dict[str, Callable] = {
    "normal": lambda rng: ot.Normal(rng.normal() * 10.0 ** rng.uniform(-2.0, 3.0), 10.0 ** rng.uniform(-2.0, 2.0)),
    "lognormal": lambda rng: ot.LogNormal(rng.uniform(-3.0, 5.0), rng.uniform(0.1, 1.0)),
    "uniform": lambda rng: ot.Uniform(*np.cumsum(rng.uniform(0.1, 2.0, 2)).tolist()),
    "gumbel": lambda rng: ot.Gumbel(rng.uniform(0.1, 10.0), rng.uniform(-10.0, 10.0)),
    "exponential": lambda rng: ot.Exponential(10.0 ** rng.uniform(-2.0, 2.0)),
    "beta": lambda rng: ot.Beta(0.3, 2.0, 0.0, float(rng.uniform(0.5, 2.0))),
    "weibull": lambda rng: ot.WeibullMin(rng.uniform(0.5, 2.0), rng.uniform(1.0, 3.0)),
    "student": lambda rng: ot.Student(rng.uniform(3.0, 6.0), rng.normal(), rng.uniform(0.5, 2.0)),
    "mixture": _mixture,
}
# Quantiles of a mixture are searched for, which takes time.
_MOST_MIXTURES = 3


def random_inputs(rng, dimension: int) -> tuple[str, ot.Distribution]:
    """What the inputs are called, and their distribution."""
    kind = rng.random()
    if kind < 0.3:
        return "standard", ot.Normal(dimension)
    if kind < 0.5:
        return "normal", ot.JointDistribution([LAWS["normal"](rng) for _ in range(dimension)])
    names = rng.choice(list(LAWS), dimension)
    for place in np.flatnonzero(names == "mixture")[_MOST_MIXTURES:]:
        names[place] = "lognormal"
    marginals = [LAWS[name](rng) for name in names]
    if kind < 0.85:
        return "mixed", ot.JointDistribution(marginals)
    coefficient = rng.uniform(-0.3, 0.7)
    correlation = ot.CorrelationMatrix(dimension)
    for i in range(dimension):
        for j in range(i):
            correlation[i, j] = coefficient ** (i - j)
    return "mixed, correlated", ot.JointDistribution(marginals, ot.NormalCopula(correlation))


def standard_normal_map(distribution: ot.Distribution) -> Callable:
    """From inputs to independent standard normal ones: distribution functions, then the inverse Cholesky factor.

    Both tails keep their digits: the complementary function is used above the median.
    """
    marginals = [distribution.getMarginal(i) for i in range(distribution.getDimension())]
    copula = distribution.getCopula()
    factor = None
    if not copula.hasIndependentCopula():
        factor = np.linalg.inv(np.linalg.cholesky(np.array(copula.getShapeMatrix())))

    def forward(x):
        z = np.empty_like(x)
        for i, marginal in enumerate(marginals):
            if marginal.getImplementation().getName() == "Normal":
                mean, deviation = marginal.getParameter()
                z[:, i] = (x[:, i] - mean) / deviation
                continue
            column = ot.Sample(x[:, i : i + 1])
            below = np.asarray(marginal.computeCDF(column))[:, 0]
            above = np.asarray(marginal.computeComplementaryCDF(column))[:, 0]
            normal = np.where(below < 0.5, ndtri(below), -ndtri(above))
            z[:, i] = np.clip(normal, -LARGEST_NORMAL, LARGEST_NORMAL)
        return z if factor is None else z @ factor.T

    return forward


# Systems. -------------------------------------------------------------------------------------------------------------


class RandomSystem:
    """A failure event of known probability.

    Attributes
    ----------
    seed : int
    kind : str
        One of `KINDS`.
    dimension : int
        Number of inputs d.
    probability : float
    parts : list of Part
        Of orthogonal coordinates.
    directions : array (d, r)
        Of the coordinates of all parts, in the space of independent standard normal inputs.
    distribution : openturns.Distribution
        Of the inputs.
    """

    def __init__(self, seed, kind, parts, directions, inputs, distribution, rng):
        self.seed, self.kind, self.parts, self.directions = seed, kind, parts, directions
        self.inputs, self.distribution = inputs, distribution
        self.dimension = distribution.getDimension()
        probabilities = np.array([part.probability for part in parts])
        self.parallel = kind == "parallel"
        self.probability = float(probabilities.prod() if self.parallel else -math.expm1(np.log1p(-probabilities).sum()))
        self._forward = standard_normal_map(distribution)
        # A positive factor of another direction, the unit and the side of the event, a limit that is not 0.
        self._modulation = rng.normal(size=self.dimension) if rng.random() < 0.2 else None
        if self._modulation is not None:
            self._modulation *= 0.4 / np.linalg.norm(self._modulation)
        self._unit = float(10.0 ** rng.uniform(-5.0, 5.0) * rng.choice([-1.0, 1.0]))
        self._limit = float(rng.normal() * abs(self._unit)) if rng.random() < 0.5 else 0.0
        self._memoized = rng.random() < 0.3

    def __repr__(self) -> str:
        return f"RandomSystem({self.describe()})"

    def describe(self) -> str:
        """One line: seed, kind, number of inputs, probability, parts and inputs."""
        parts = "; ".join(part.kind for part in self.parts)
        return (
            f"{self.seed:6d} {self.kind:9s} d = {self.dimension:3d}  P = {self.probability:.4e}  {parts}; "
            f"{self.inputs} inputs"
        )

    def splitCoordinates(self, y: np.ndarray) -> list[np.ndarray]:
        """Coordinates of each part."""
        return np.split(y, np.cumsum([part.size for part in self.parts])[:-1], axis=1)

    def evaluateStandard(self, u: np.ndarray) -> np.ndarray:
        """Limit state function of independent standard normal inputs, at most 0 in failure: (n, d) to (n,)."""
        values = [part.value(y) for part, y in zip(self.parts, self.splitCoordinates(u @ self.directions), strict=True)]
        value = np.max(values, axis=0) if self.parallel else np.min(values, axis=0)
        return value if self._modulation is None else value * np.exp(u @ self._modulation)

    def evaluate(self, x: np.ndarray) -> np.ndarray:
        """Output of the black box: (n, d) to (n,)."""
        return self._limit + self._unit * self.evaluateStandard(self._forward(x))

    def event(self) -> ot.ThresholdEvent:
        """The event, of one output that says nothing of its parts."""
        function = ot.PythonFunction(
            self.dimension, 1, func_sample=lambda x: self.evaluate(np.array(x, dtype=float))[:, None]
        )
        if self._memoized:
            function = ot.MemoizeFunction(function)
        vector = ot.CompositeRandomVector(function, ot.RandomVector(self.distribution))
        return ot.ThresholdEvent(vector, ot.LessOrEqual() if self._unit > 0.0 else ot.GreaterOrEqual(), self._limit)


def random_system(seed: int) -> RandomSystem:
    """The system of a seed.

    Parameters
    ----------
    seed : int
        At least 0.

    Returns
    -------
    system : RandomSystem
    """
    rng = np.random.default_rng([seed, 20_240_117])
    kind = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    p = 10.0 ** rng.uniform(-9.0, -1.0)
    dimension = round(math.exp(rng.uniform(math.log(2.0), math.log(LARGEST_DIMENSION))))
    if kind == "direct":
        return _direct_system(seed, rng, p, dimension)
    parts = PARTS[kind](rng, p)
    size = sum(part.size for part in parts)
    dimension = max(dimension, size)
    inputs, distribution = random_inputs(rng, dimension)
    return RandomSystem(seed, kind, parts, random_directions(rng, dimension, size), inputs, distribution, rng)


def random_directions(rng, dimension: int, size: int) -> np.ndarray:
    """Orthonormal columns, along inputs, in a part of the inputs, or in all of them."""
    support = (size, int(rng.integers(size, dimension + 1)), dimension)[rng.integers(3)]
    places = rng.permutation(dimension)[:support]
    directions = np.zeros((dimension, size))
    if support == size:
        directions[places, np.arange(size)] = rng.choice([-1.0, 1.0], size)
    else:
        directions[places] = np.linalg.qr(rng.normal(size=(support, size)))[0]
    return directions


def _direct_system(seed, rng, p, dimension):
    """Limits of the inputs themselves, in their own units."""
    kind = str(rng.choice(["one", "any", "product", "sum"]))
    law = {"product": "lognormal", "sum": "exponential"}.get(kind) or str(rng.choice(["uniform", "beta", "gumbel"]))
    used = 1 if kind == "one" else int(rng.integers(2, min(4, dimension) + 1))
    inputs = [LAWS[law](rng) for _ in range(used)]
    inputs += [LAWS[str(rng.choice(list(LAWS)[:-1]))](rng) for _ in range(dimension - used)]
    if kind == "sum":
        inputs[:used] = [ot.Exponential(1.0)] * used
    quantiles = [marginal.computeQuantile for marginal in inputs[:used]]

    def physical(y):
        x, tails = np.empty_like(y), ndtr(-np.abs(y))
        for i, quantile in enumerate(quantiles):
            for above in (False, True):
                mine = (y[:, i] > 0.0) == above
                x[mine, i] = np.asarray(quantile(tails[mine, i].tolist(), above)).reshape(-1)
        return x

    if kind == "product":
        means, deviations = np.array([marginal.getParameter()[:2] for marginal in inputs[:used]]).T
        limit = float(np.exp(means.sum() - ndtri(p) * np.linalg.norm(deviations)))
        name, value = "a product of lognormal", lambda y: limit - physical(y).prod(axis=1)
    elif kind == "sum":
        limit = float(gamma.isf(p, used))
        name, value = "a sum of exponential", lambda y: limit - physical(y).sum(axis=1)
    else:
        each = -math.expm1(math.log1p(-p) / used)
        limits = np.array([marginal.computeQuantile(each, True)[0] for marginal in inputs[:used]])
        name, value = f"{kind} of {used} {law}", lambda y: (limits - physical(y)).min(axis=1)
    part = Part(f"limit of {name} inputs", used, value, p)
    directions = np.eye(dimension)[:, :used]
    return RandomSystem(seed, "direct", [part], directions, "mixed", ot.JointDistribution(inputs), rng)


# A second way to each probability. ------------------------------------------------------------------------------------


class _Kernels:
    """Density of a part's coordinates around failures that a pilot of a wide normal law has found."""

    def __init__(self, part, rng, pilot=200_000):
        size = part.size
        self.scale = max(1.5, -ndtri(part.probability) / 1.5)
        y = self.scale * rng.normal(size=(pilot, size))
        failed = y[part.value(y) <= 0.0]
        logs = -0.5 * (1.0 - self.scale**-2) * (failed**2).sum(axis=1)
        weights = np.exp(logs - logs.max())
        self.centres = rng.choice(failed, 80, p=weights / weights.sum())
        self.width = 0.6

    def sample(self, rng, points):
        kernel = self.centres[rng.integers(len(self.centres), size=points)]
        y = kernel + self.width * rng.normal(size=kernel.shape)
        wide = rng.random(points) < 0.2
        y[wide] = self.scale * rng.normal(size=(wide.sum(), y.shape[1]))
        return y

    def ratio(self, y):
        """Density over the standard normal density."""
        size, squared = y.shape[1], (y**2).sum(axis=1)
        wide = 0.2 * self.scale**-size * np.exp(0.5 * (1.0 - self.scale**-2) * squared)
        total = np.zeros(len(y))
        for centre in self.centres:
            total += np.exp(0.5 * squared - 0.5 * ((y - centre) ** 2).sum(axis=1) / self.width**2)
        return wide + 0.8 * total / len(self.centres) * self.width**-size


def importance_sampling(system: RandomSystem, points: int, seed: int = 0) -> tuple[float, float]:
    """Probability and its standard error from the OpenTURNS event: points around failures of each part, taken to
    inputs by OpenTURNS' own transformation, and judged by the event's function, operator and threshold."""
    rng = np.random.default_rng(seed)
    kernels = [_Kernels(part, rng) for part in system.parts]
    u = rng.normal(size=(points, system.dimension))
    y = system.splitCoordinates(u @ system.directions)
    chosen = rng.integers(len(kernels), size=points)
    for k, kernel in enumerate(kernels):
        mine = np.full(points, True) if system.parallel else chosen == k
        y[k] = np.where(mine[:, None], kernel.sample(rng, points), y[k])
    ratios = [kernel.ratio(coordinates) for kernel, coordinates in zip(kernels, y, strict=True)]
    density = np.prod(ratios, axis=0) if system.parallel else np.mean(ratios, axis=0)
    u += (np.column_stack(y) - u @ system.directions) @ system.directions.T
    event = system.event()
    x = system.distribution.getInverseIsoProbabilisticTransformation()(ot.Sample(u))
    values = np.array(event.getFunction()(x))[:, 0]
    operator, threshold = event.getOperator(), event.getThreshold()
    failed = values <= threshold if operator.compare(threshold - 1.0, threshold) else values >= threshold
    weights = failed / density
    return float(weights.mean()), float(weights.std() / math.sqrt(points))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", nargs=2, type=int, default=(DESIGN.start, DESIGN.stop), help="first, and one beyond")
    parser.add_argument("--check", action="store_true", help="compute each probability a second time")
    parser.add_argument("--points", type=int, default=40_000, help="of each second computation")
    options = parser.parse_args()
    versions = ", ".join(f"{name} {metadata.version(name)}" for name in ("openturns", "numpy", "scipy"))
    print(f"seeds {options.seeds[0]} to {options.seeds[1] - 1}; {versions}")
    deviations = []
    for seed in range(*options.seeds):
        system = random_system(seed)
        line = system.describe()
        if options.check:
            mean, error = importance_sampling(system, options.points)
            deviations.append((mean - system.probability) / error)
            line += f"; sampled {mean:.4e} +- {100.0 * error / mean:.1f} %, {deviations[-1]:+.1f} deviations"
        print(line, flush=True)
    if deviations:
        squared = float(np.mean(np.square(deviations)))
        print(f"largest deviation {np.abs(deviations).max():.1f}, root of the mean square {math.sqrt(squared):.2f}")


if __name__ == "__main__":
    main()
