"""The standard normal space of a distribution, checked before it is trusted."""

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

# Points of the check: the centre and two off it, where a Student space differs from the normal one by 8 % or more.
CHECK_LEVELS = (0.5, 0.84, 0.05)
# On the logarithm of the density: a Student space of 200 degrees of freedom is off by more than this.
CHECK_TOLERANCE = 1e-3


def nameInputs(distribution: ot.Distribution, function: ot.Function) -> ot.Distribution:
    """The distribution, under the names of the function's inputs where it has none of its own but X0, X1, ...

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.common.standard_space import nameInputs
    >>> print(nameInputs(ot.Normal(2), ot.SymbolicFunction(["mass", "rate"], ["mass * rate"])).getDescription())
    [mass,rate]
    """
    distribution = ot.Distribution(distribution)
    names = function.getInputDescription()
    default = ot.Description.BuildDefault(distribution.getDimension(), "X")
    if distribution.getDescription() == default and len(set(names)) == len(names) == len(default):
        distribution.setDescription(names)
    return distribution


class StandardSpace:
    """Standard space U of a distribution through its iso-probabilistic transformation T, U = T(X).

    T is Nataf's transformation where the copula is normal, else Rosenblatt's, whose
    result depends on the order of the inputs.

    Parameters
    ----------
    distribution : :py:class:`openturns.Distribution`
        Continuous, and such that T maps it to independent standard normals.

    Raises
    ------
    ValueError
        A discrete input, or a standard space that is not the independent standard normal one (elliptical
        Student, Student copula, a block whose own transformation is not normal).

    Examples
    --------
    >>> import openturns as ot
    >>> from satsep_ot.methods.common.standard_space import StandardSpace
    >>> space = StandardSpace(ot.JointDistribution([ot.Uniform(0.0, 2.0), ot.Normal(5.0, 3.0)]))
    >>> space.toPhysical([[0.0, 1.0]]).tolist()
    [[1.0, 8.0]]
    """

    def __init__(self, distribution: ot.Distribution) -> None:
        self._distribution = ot.Distribution(distribution)
        self._check()
        self._transformation = self._distribution.getIsoProbabilisticTransformation()
        self._inverse = self._distribution.getInverseIsoProbabilisticTransformation()
        self._checkDensity()

    def __repr__(self) -> str:
        return f"StandardSpace(dimension={self.getDimension()})"

    def _check(self):
        """Refusals that need no transformation: to build one for a Student copula can end the interpreter."""
        if not self._distribution.isContinuous():
            atoms = [
                f"{name} ({type(marginal.getImplementation()).__name__})"
                for name, marginal in zip(
                    self._distribution.getDescription(),
                    map(self._distribution.getMarginal, range(self.getDimension())),
                    strict=True,
                )
                if not marginal.isContinuous()
            ]
            raise ValueError(
                f"The standard space needs continuous inputs, but {', '.join(atoms) or 'the distribution'} has atoms: "
                "no smooth map to a normal exists; condition on its values instead."
            )
        standard = self._distribution.getStandardDistribution()
        name = standard.getImplementation().getClassName()
        independent = name == "Normal" and np.array_equal(
            np.array(standard.getCovariance()), np.eye(self.getDimension())
        )
        if not independent:
            raise ValueError(
                f"The standard space of this distribution is {name}, not the independent standard normal one that "
                "is needed: give its marginals and a normal or Archimedean copula instead of a Student one."
            )

    def _checkDensity(self):
        """Change of variables: density of X at T^-1(u) times |det dX/dU| must be the normal density at u."""
        d = self.getDimension()
        for level in CHECK_LEVELS:
            # Alternating signs, so that a wrong block cannot hide behind a symmetric one.
            u = ot.Normal().computeQuantile(level)[0] * (-1.0) ** np.arange(d)
            x = self._inverse(u)
            sign, logarithm = np.linalg.slogdet(np.array(self._inverse.gradient(u)))
            found = self._distribution.computeLogPDF(x) + logarithm
            expected = -0.5 * (u @ u) - 0.5 * d * np.log(2.0 * np.pi)
            if not (sign != 0.0 and abs(found - expected) <= CHECK_TOLERANCE):
                raise ValueError(
                    "The transformation of this distribution does not lead to independent standard normals: its "
                    f"density at T^-1(u) has logarithm {found:.4g} where {expected:.4g} is right (u_1 = {u[0]:.3g}); "
                    "give its marginals and a normal or Archimedean copula."
                )

    def getDistribution(self) -> ot.Distribution:
        """The distribution of the physical inputs."""
        return self._distribution

    def getDimension(self) -> int:
        """Number of inputs."""
        return self._distribution.getDimension()

    def getTransformation(self) -> ot.Function:
        """T, physical to standard, as a native :py:class:`openturns.Function`."""
        return self._transformation

    def getInverseTransformation(self) -> ot.Function:
        """T^-1, standard to physical, as a native :py:class:`openturns.Function`."""
        return self._inverse

    def toStandard(self, physicalSample: ArrayLike) -> np.ndarray:
        """Standard points (n, d) of physical points (n, d), both ndarrays."""
        return np.array(self._transformation(np.asarray(physicalSample, dtype=float)))

    def toPhysical(self, standardSample: ArrayLike) -> np.ndarray:
        """Physical points (n, d) of standard points (n, d), both ndarrays."""
        return np.array(self._inverse(np.asarray(standardSample, dtype=float)))

    def generateSample(self, size: int) -> np.ndarray:
        """Independent standard normal points (size, d) from ``ot.RandomGenerator``."""
        return np.array(ot.DistFunc.rNormal(size * self.getDimension())).reshape(size, self.getDimension())

    def chainGradient(self, standardSample: ArrayLike, physicalGradient: np.ndarray) -> np.ndarray:
        """Gradients with respect to U from those with respect to X.

        Parameters
        ----------
        standardSample : ndarray (n, d)
            Where.
        physicalGradient : ndarray (n, d, p)
            dg_j/dx_i at the physical points of ``standardSample``.

        Returns
        -------
        ndarray (n, d, p)
        """
        return np.stack(
            [
                np.array(self._inverse.gradient(u)) @ gradient
                for u, gradient in zip(np.asarray(standardSample, dtype=float), physicalGradient, strict=True)
            ]
        )
