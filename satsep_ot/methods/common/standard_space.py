"""The standard normal space of a distribution, checked before it is trusted."""

import math

import numpy as np
import openturns as ot
from numpy.typing import ArrayLike

from satsep_ot.openturns_adapter import callFunction

# Points of the check: the centre and two off it, where a Student space differs from the normal one by 8 % or more.
CHECK_LEVELS = (0.5, 0.84, 0.05)
# On the logarithm of the density: a Student space of 200 degrees of freedom is off by more than this.
CHECK_TOLERANCE = 1e-3
# A transformation that does not lead back to the point by more than this is inexact; up to this error of the density
# its results are still of use.
ROUND_TRIP_TOLERANCE = 1e-6
LARGEST_INEXACTNESS = 0.1


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

    Independent inputs are taken one by one, whatever standard space the distribution has of its own. For others T is
    Nataf's transformation where the copula is normal, else Rosenblatt's, whose result depends on the order of the
    inputs.

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
        self._refuseAtoms()
        self._independent = self._distribution.hasIndependentCopula()
        law = self._distribution
        if self._independent:
            # Its own transformation may be none to normals (Student), or take d^3 numbers (Normal).
            law = ot.JointDistribution([law.getMarginal(i) for i in range(self.getDimension())])
        else:
            self._refuseOtherStandardSpaces()
        self._transformation = law.getIsoProbabilisticTransformation()
        self._inverse = law.getInverseIsoProbabilisticTransformation()
        self._remarks: list[str] = []
        self._check()

    def __repr__(self) -> str:
        return f"StandardSpace(dimension={self.getDimension()})"

    def _refuseAtoms(self):
        if self._distribution.isContinuous():
            return
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
            "no smooth map to a normal exists; condition on its values, as ConditionalReliability does."
        )

    def _refuseOtherStandardSpaces(self):
        """Refuse without a transformation: to build one for a Student copula can end the interpreter."""
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

    def _check(self):
        """Refuse a transformation that is none to independent standard normals; remark on one that is inexact."""
        signs = (-1.0) ** np.arange(self.getDimension())
        # Alternating signs, so that a wrong block cannot hide behind a symmetric one.
        points = np.array([ot.Normal().computeQuantile(level)[0] * signs for level in CHECK_LEVELS])
        roundTrip = float(np.abs(self.toStandard(self.toPhysical(points)) - points).max())
        density = 0.0 if self._independent else self._densityError(points)
        if density <= CHECK_TOLERANCE and roundTrip <= ROUND_TRIP_TOLERANCE:
            return
        if not (roundTrip > ROUND_TRIP_TOLERANCE and max(density, roundTrip) <= LARGEST_INEXACTNESS):
            raise ValueError(
                "The transformation of this distribution does not lead to independent standard normals: the density "
                f"that it gives is off by a factor of {math.exp(min(density, 700.0)):.4g}, and a point comes back off "
                f"by {roundTrip:.2g} standard deviations; give its marginals and a normal or Archimedean copula."
            )
        self._remarks.append(
            f"OpenTURNS' transformation of this distribution is inexact: a point comes back off by {roundTrip:.2g} "
            f"standard deviations, and densities are off by up to {100.0 * math.expm1(density):.2g} %; all results "
            "carry an error of this kind."
        )

    def _densityError(self, points):
        """Change of variables: density of X at T^-1(u) times |det dX/dU| must be the normal density at u.

        Returns
        -------
        float
            Largest difference of the logarithms at these points (n, d); infinite where they are not finite.
        """
        errors = []
        for u, x in zip(points, self.toPhysical(points), strict=True):
            sign, logarithm = np.linalg.slogdet(np.array(self._inverse.gradient(u)))
            found = self._distribution.computeLogPDF(x) + logarithm
            expected = -0.5 * (u @ u) - 0.5 * len(u) * np.log(2.0 * np.pi)
            errors.append(abs(found - expected) if sign != 0.0 and np.isfinite(found) else np.inf)
        return max(errors)

    def getRemarks(self) -> list[str]:
        """Sentences on what a reader should know: a transformation that is inexact."""
        return list(self._remarks)

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

    def refuseOutside(self, physicalSample: np.ndarray) -> None:
        """Refuse points (n, d) outside the range of the distribution, for which T would return some large number.

        Raises
        ------
        ValueError
            A shape that does not fit, or the first such row.
        """
        if physicalSample.ndim != 2 or physicalSample.shape[1] != self.getDimension():
            raise ValueError(f"The inputs have shape {physicalSample.shape}; it must be (n, {self.getDimension()}).")
        inside = np.array(self._distribution.computeLogPDF(physicalSample))[:, 0] > -1e300
        if not inside.all():
            row = int((~inside).argmax())
            raise ValueError(
                f"Row {row} of the inputs is outside the range of the distribution: {physicalSample[row].tolist()}."
            )

    def toStandard(self, physicalSample: ArrayLike) -> np.ndarray:
        """Standard points (n, d) of physical points (n, d), both ndarrays."""
        return callFunction(self._transformation, np.asarray(physicalSample, dtype=float))

    def toPhysical(self, standardSample: ArrayLike) -> np.ndarray:
        """Physical points (n, d) of standard points (n, d), both ndarrays."""
        return callFunction(self._inverse, np.asarray(standardSample, dtype=float))

    def generateSample(self, size: int) -> np.ndarray:
        """Independent standard normal points (size, d) from ``ot.RandomGenerator``."""
        # A point becomes an array number by number, a sample at once.
        numbers = ot.Sample.BuildFromPoint(ot.DistFunc.rNormal(size * self.getDimension()))
        return np.array(numbers).reshape(size, self.getDimension())

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
        standard = np.asarray(standardSample, dtype=float)
        if self._independent:
            return self._slopes(standard)[:, :, None] * physicalGradient
        return np.stack(
            [
                np.array(self._inverse.gradient(u)) @ gradient
                for u, gradient in zip(standard, physicalGradient, strict=True)
            ]
        )

    def _slopes(self, standard):
        """dx_i/du_i of independent inputs, phi(u_i) / f_i(x_i), ndarray (n, d)."""
        slopes = np.empty_like(standard)
        physical = self.toPhysical(standard)
        logarithm = -0.5 * standard**2 - 0.5 * math.log(2.0 * math.pi)
        for i in range(self.getDimension()):
            marginal = self._distribution.getMarginal(i)
            if isinstance(marginal.getImplementation(), ot.Normal):
                slopes[:, i] = marginal.getStandardDeviation()[0]
            else:
                density = np.array(marginal.computeLogPDF(ot.Sample(physical[:, i : i + 1])))[:, 0]
                slopes[:, i] = np.exp(logarithm[:, i] - density)
        return slopes

    def shiftedPhysical(self, standardSample: ArrayLike, step: float) -> np.ndarray:
        """Physical points (n, d, d): those of each standard point, moved by the step along one axis after the other.

        Examples
        --------
        >>> import openturns as ot
        >>> from satsep_ot.methods.common.standard_space import StandardSpace
        >>> StandardSpace(ot.Normal([0.0, 0.0], [1.0, 2.0])).shiftedPhysical([[1.0, 1.0]], 0.5).tolist()
        [[[1.5, 2.0], [1.0, 3.0]]]
        """
        standard = np.asarray(standardSample, dtype=float)
        count, d = standard.shape
        if not self._independent:
            return self.toPhysical((standard[:, None, :] + step * np.eye(d)).reshape(-1, d)).reshape(count, d, d)
        physical = np.repeat(self.toPhysical(standard)[:, None, :], d, axis=1)
        physical[:, range(d), range(d)] = self.toPhysical(standard + step)
        return physical
