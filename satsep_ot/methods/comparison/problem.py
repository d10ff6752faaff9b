"""A reliability problem whose probability of failure is known."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import openturns as ot

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.openturns_object import OpenTURNSObject


class BenchmarkProblem:
    """A failure event with a known probability.

    The event is ``composition(components(X)) <= 0``.

    Parameters
    ----------
    name : str
        Short unique name.
    distribution : :py:class:`openturns.Distribution`
        Distribution of the d inputs.
    components : callable
        Maps an ``(n, d)`` array on an ``(n, p)`` array of smooth outputs.
    outputDimension : int
        p.
    composition : callable, optional
        Maps an ``(n, p)`` array on the ``(n,)`` values of the limit state function. By default p is 1 and the component
        is the limit state function.
    probability : float
        Reference probability of failure.
    source : str
        Where the reference comes from.
    probabilityError : float
        Relative standard error of the probability, where that comes from sampling.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.problems import getBenchmarkProblem
    >>> problem = getBenchmarkProblem("P1")
    >>> problem.getEvent().getFunction().getInputDimension()
    100
    >>> print(f"{problem.getProbability():.4e}")
    2.3263e-04
    """

    def __init__(
        self,
        name: str,
        distribution: ot.Distribution,
        components: Callable,
        probability: float,
        source: str,
        outputDimension: int = 1,
        composition: Callable | None = None,
        probabilityError: float = 0.0,
    ) -> None:
        self._name = name
        self._distribution = distribution
        self._components = components
        self._outputDimension = outputDimension
        self._composition = composition
        self._probability = probability
        self._source = source
        self._probabilityError = probabilityError

    def __repr__(self) -> str:
        return f"BenchmarkProblem(name={self._name}, probability={self._probability:.4e})"

    def getName(self) -> str:
        """Accessor to the short name."""
        return self._name

    def getProbability(self) -> float:
        """Accessor to the reference probability of failure."""
        return self._probability

    def getProbabilityError(self) -> float:
        """Accessor to the relative standard error of the reference probability."""
        return self._probabilityError

    def getSource(self) -> str:
        """Where the reference probability comes from."""
        return self._source

    def getDistribution(self) -> ot.Distribution:
        """Accessor to the distribution of the inputs."""
        return self._distribution

    def evaluate(self, inputs: np.ndarray) -> np.ndarray:
        """The limit state function, at most 0 in failure.

        Parameters
        ----------
        inputs : array (n, d)

        Returns
        -------
        values : array (n,)
        """
        values = self._components(np.asarray(inputs, dtype=float))
        return values.reshape(-1) if self._composition is None else self._composition(values)

    def getFunction(self) -> ot.Function:
        """The limit state function as an OpenTURNS function with one output."""
        return _batchFunction(self._distribution.getDimension(), 1, lambda x: self.evaluate(x)[:, None])

    def getEvent(self) -> ot.ThresholdEvent:
        """The event: limit state function at most 0."""
        vector = ot.CompositeRandomVector(self.getFunction(), ot.RandomVector(self._distribution))
        return ot.ThresholdEvent(vector, ot.LessOrEqual(), 0.0)

    def getComponents(self) -> tuple[ot.Function, ot.Function]:
        """The smooth components and the composition that turns them into the limit state function.

        Returns
        -------
        function, composition : pair of :py:class:`openturns.Function`
        """
        p = self._outputDimension
        function = _batchFunction(self._distribution.getDimension(), p, lambda x: self._components(x).reshape(-1, p))
        compose = self._composition
        if compose is None:
            return function, ot.IdentityFunction(1)
        return function, _batchFunction(p, 1, lambda y: compose(y)[:, None])

    def rotated(self, seed: int = 0) -> "BenchmarkProblem":
        """The same problem turned in its standard space, so that no input is special: standard normal inputs u, of
        which Q u are the standard normal inputs of this problem, with a random orthogonal Q.

        Parameters
        ----------
        seed : int
            Of Q, which is uniform over all orthogonal matrices (QR of a Gaussian matrix: Stewart, SIAM J. Numer.
            Anal. 17, 1980).

        Returns
        -------
        problem : BenchmarkProblem
            Of the same probability.

        Examples
        --------
        >>> from satsep_ot.methods.comparison.problems import getBenchmarkProblem
        >>> print(getBenchmarkProblem("RP8").rotated().getDistribution().getMean())
        [0,0,0,0,0,0]
        """
        space = StandardSpace(self._distribution)
        factor, triangle = np.linalg.qr(np.random.default_rng(seed).standard_normal((space.getDimension(),) * 2))
        transposed = (factor * np.sign(np.diag(triangle))).T
        return self.varied(
            "rotated",
            distribution=ot.Normal(space.getDimension()),
            components=lambda u: self._components(space.toPhysical(u @ transposed)),
        )

    def rescaled(self, seed: int = 0) -> "BenchmarkProblem":
        """The same problem in other units: every input, every component and the limit state function times a power
        of 10 of its own.

        Parameters
        ----------
        seed : int
            Of the exponents, whole numbers from -6 to 6.

        Returns
        -------
        problem : BenchmarkProblem
            Of the same probability.

        Examples
        --------
        >>> from satsep_ot.methods.comparison.problems import getBenchmarkProblem
        >>> print(getBenchmarkProblem("RP54").rescaled().getDistribution().getMean()[:3])
        [100000,100,1]
        """
        d, p = self._distribution.getDimension(), self._outputDimension
        powers = 10.0 ** np.random.default_rng(seed).integers(-6, 7, d + p + 1)
        inputUnits, outputUnits, limitUnit = powers[:d], powers[d:-1], powers[-1]
        marginals = [self._distribution.getMarginal(i) * float(unit) for i, unit in enumerate(inputUnits)]
        composition = self._composition
        return self.varied(
            "rescaled",
            distribution=ot.JointDistribution(marginals, self._distribution.getCopula()),
            components=lambda x: outputUnits * self._components(x / inputUnits).reshape(-1, p),
            composition=None if composition is None else lambda y: limitUnit * composition(y / outputUnits),
        )

    def varied(self, variant: str, **changes: Any) -> "BenchmarkProblem":
        """The same problem with other arguments of the constructor, its variant behind its name."""
        given = {
            "distribution": self._distribution,
            "components": self._components,
            "probability": self._probability,
            "source": self._source,
            "outputDimension": self._outputDimension,
            "composition": self._composition,
            "probabilityError": self._probabilityError,
        }
        return BenchmarkProblem(f"{self._name}-{variant}", **(given | changes))


def _batchFunction(inputDimension: int, outputDimension: int, evaluate: Callable) -> ot.Function:
    return ot.PythonFunction(
        inputDimension, outputDimension, func_sample=lambda x: evaluate(np.asarray(x, dtype=float))
    )


@dataclasses.dataclass(frozen=True, eq=False, repr=False)
class BenchmarkTask(OpenTURNSObject):
    """An event of known probability.

    Attributes
    ----------
    name : str
    event : :py:class:`openturns.ThresholdEvent`, UnionEvent, IntersectionEvent or DomainEvent
    probability : float
    components : tuple, optional
        Arguments of :meth:`ActiveSubspaceReliability.setComponents`.
    gradientCost : float
        Evaluations that one gradient is worth in time.
    probabilityError : float
        Relative standard error of ``probability``, where that is itself an estimate.

    Examples
    --------
    >>> from satsep_ot.methods.comparison.problems import getBenchmarkProblem
    >>> from satsep_ot.methods.comparison.problem import BenchmarkTask
    >>> print(f"{BenchmarkTask.of(getBenchmarkProblem('RP54')).probability:.4e}")
    9.9060e-04
    """

    name: str
    event: object
    probability: float
    components: tuple | None = None
    gradientCost: float = 1.0
    probabilityError: float = 0.0

    def _shown(self):
        return {"name": repr(self.name), "probability": self.probability, "probabilityError": self.probabilityError}

    @staticmethod
    def of(problem: BenchmarkProblem) -> "BenchmarkTask":
        """The task of a published problem."""
        function, composition = problem.getComponents()
        components = (function, composition) if function.getOutputDimension() > 1 else None
        return BenchmarkTask(
            problem.getName(),
            problem.getEvent(),
            problem.getProbability(),
            components,
            probabilityError=problem.getProbabilityError(),
        )
