"""What every kind of active subspace offers: maps to and from its variables."""

import math

import numpy as np
import openturns as ot

from satsep_ot.methods.common.standard_space import StandardSpace


def activeTransformation(space: StandardSpace, directions: np.ndarray) -> ot.Function:
    """Physical inputs to active variables, y = W^T T(x), as a native function.

    Parameters
    ----------
    space : :class:`~satsep_ot.methods.common.standard_space.StandardSpace`
    directions : ndarray (d, r)
        Orthonormal columns, r at least 1.

    Returns
    -------
    :py:class:`openturns.Function`

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.subspaces.variables import activeTransformation
    >>> from satsep_ot.methods.common.standard_space import StandardSpace
    >>> space = StandardSpace(ot.Normal([1.0, 2.0], [3.0, 4.0]))
    >>> print(activeTransformation(space, np.array([[0.0], [1.0]]))([0.0, 6.0]))
    [1]
    """
    d, r = directions.shape
    linear = ot.LinearFunction([0.0] * d, [0.0] * r, ot.Matrix(np.ascontiguousarray(directions.T)))
    transformation = ot.ComposedFunction(linear, space.getTransformation())
    transformation.setInputDescription(space.getDistribution().getDescription())
    transformation.setOutputDescription([f"active variable {i + 1}" for i in range(r)])
    return transformation


def inverseActiveTransformation(space: StandardSpace, directions: np.ndarray) -> ot.Function:
    """Active variables to physical inputs, the inactive ones at 0: x = T^-1(W y), as a native function.

    Parameters
    ----------
    space, directions
        As in :func:`activeTransformation`.

    Returns
    -------
    :py:class:`openturns.Function`
    """
    d, r = directions.shape
    linear = ot.LinearFunction([0.0] * r, [0.0] * d, ot.Matrix(np.ascontiguousarray(directions)))
    transformation = ot.ComposedFunction(space.getInverseTransformation(), linear)
    transformation.setInputDescription([f"active variable {i + 1}" for i in range(r)])
    transformation.setOutputDescription(space.getDistribution().getDescription())
    return transformation


def surrogate_degree(count: int, dimension: int, largest: int = 4) -> int:
    """The highest degree up to ``largest`` with at least two points for each polynomial term.

    Examples
    --------
    >>> from satsep_ot.methods.subspaces.variables import surrogate_degree
    >>> surrogate_degree(100, 2), surrogate_degree(8, 2)
    (4, 1)
    """
    degree = largest
    while degree > 0 and 2 * math.comb(dimension + degree, degree) > count:
        degree -= 1
    return degree
