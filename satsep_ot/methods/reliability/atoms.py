"""Discrete inputs and atoms: the values that they take one by one, and what is continuous."""

import dataclasses
import itertools
import math
from collections.abc import Iterator

import openturns as ot

# Combinations of values that are treated one by one.
LARGEST_NUMBER = 64
# Values that are rarer than this share of all are left out, and added to the upper bound.
_NEGLIGIBLE = 1e-12


@dataclasses.dataclass(frozen=True, eq=False)
class Branch:
    """A value that an input takes, or its continuous part.

    Attributes
    ----------
    probability : float
    value : float or None
        None for a continuous part.
    law : :py:class:`openturns.Distribution` or None
        Of a continuous part, given that the input is there.
    """

    probability: float
    value: float | None
    law: ot.Distribution | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class Combination:
    """One branch of each input that has atoms.

    Attributes
    ----------
    probability : float
    fixed : dict of int to float
        Value of each input that has one.
    law : :py:class:`openturns.Distribution` or None
        Of the other inputs, in their order; None where there is none.
    """

    probability: float
    fixed: dict[int, float]
    law: ot.Distribution | None


class AtomicInputs:
    """The inputs of a distribution that are discrete or have atoms.

    Parameters
    ----------
    distribution : :py:class:`openturns.Distribution`

    Attributes
    ----------
    branches : dict of int to list of Branch
        Of each such input.
    omitted : float
        At most this probability have the values that are left out.

    Raises
    ------
    ValueError
        There is none, one is no mixture of discrete and continuous parts, depends on others, or there are more than 64
        combinations.

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.reliability.atoms import AtomicInputs
    >>> inputs = AtomicInputs(ot.JointDistribution([ot.Bernoulli(0.25), ot.Normal()]))
    >>> [(part.probability, part.fixed) for part in inputs.combinations()]
    [(0.75, {0: 0.0}), (0.25, {0: 1.0})]
    """

    def __init__(self, distribution: ot.Distribution) -> None:
        self._distribution = distribution
        names = distribution.getDescription()
        marginals = [distribution.getMarginal(i) for i in range(distribution.getDimension())]
        self.branches = {
            i: _branches(marginal, names[i]) for i, marginal in enumerate(marginals) if not marginal.isContinuous()
        }
        if not self.branches:
            raise ValueError("no input is discrete or has atoms; use ActiveSubspaceReliability")
        number = math.prod(map(len, self.branches.values()))
        if number > LARGEST_NUMBER:
            counts = ", ".join(f"{names[i]}: {len(found)}" for i, found in self.branches.items())
            raise ValueError(
                f"the values of the inputs with atoms have {number} combinations ({counts}), of which each would be "
                f"estimated; at most {LARGEST_NUMBER} are: take fewer values, or continuous laws"
            )
        dependent = [names[i] for i in self.branches if self._depends(i)]
        if dependent:
            raise ValueError(
                f"{', '.join(dependent)} may depend on other inputs, which would have another distribution for each "
                "of its values; an input with atoms must be independent of all others"
            )
        self.omitted = sum(1.0 - sum(branch.probability for branch in found) for found in self.branches.values())

    def _depends(self, i):
        """Whether an input with atoms depends on others, or may."""
        if self._distribution.hasIndependentCopula():
            return False
        copula = self._distribution.getCopula()
        if copula.getImplementation().getClassName() not in ("NormalCopula", "BlockIndependentCopula"):
            return True
        others = [j for j in range(copula.getDimension()) if j != i]
        return not all(copula.getMarginal([i, j]).hasIndependentCopula() for j in others)

    def combinations(self) -> Iterator[Combination]:
        """All combinations, each with the law of the inputs that remain."""
        for choice in itertools.product(*self.branches.values()):
            branches = dict(zip(self.branches, choice, strict=True))
            fixed = {i: branch.value for i, branch in branches.items() if branch.value is not None}
            laws = {i: branch.law for i, branch in branches.items() if branch.law is not None}
            yield Combination(math.prod(branch.probability for branch in choice), fixed, self._remaining(fixed, laws))

    def _remaining(self, fixed, laws):
        """The joint law of the inputs without a value: those with atoms are independent of all others."""
        free = [i for i in range(self._distribution.getDimension()) if i not in fixed]
        if not free:
            return None
        marginals = [laws.get(i, self._distribution.getMarginal(i)) for i in free]
        joint = ot.JointDistribution(marginals)
        if not self._distribution.hasIndependentCopula():
            joint = ot.JointDistribution(marginals, self._distribution.getCopula().getMarginal(free))
        names = self._distribution.getDescription()
        joint.setDescription([names[i] for i in free])
        return joint


def _branches(marginal, name):
    if marginal.isDiscrete():
        values = zip(marginal.getSupport(), marginal.getProbabilities(), strict=True)
        found = [Branch(probability, float(value[0])) for value, probability in values if probability > _NEGLIGIBLE]
        return found
    mixture = marginal.getImplementation()
    if not isinstance(mixture, ot.Mixture):
        raise ValueError(
            f"{name} ({mixture.getClassName()}) is neither continuous nor discrete; give an ot.Mixture of continuous "
            "and discrete parts"
        )
    atoms: dict[float, float] = {}
    laws, weights = [], []
    for part, weight in zip(mixture.getDistributionCollection(), mixture.getWeights(), strict=True):
        if part.isContinuous():
            laws.append(part)
            weights.append(weight)
            continue
        for branch in _branches(part, name):
            if branch.value is None:
                laws.append(branch.law)
                weights.append(weight * branch.probability)
            else:
                atoms[branch.value] = atoms.get(branch.value, 0.0) + weight * branch.probability
    found = [Branch(probability, value) for value, probability in atoms.items()]
    if laws:
        found.append(Branch(sum(weights), None, laws[0] if len(laws) == 1 else ot.Mixture(laws, weights)))
    return found
