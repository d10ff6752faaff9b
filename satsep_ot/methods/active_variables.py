"""What every kind of active subspace offers: maps to and from its variables, and the sufficient summary plot."""

import math

import numpy as np
import openturns as ot

from satsep_ot.methods.polynomial_basis import PolynomialBasis, fit_polynomial


def activeTransformation(space, directions):
    """Physical inputs to active variables, y = W^T T(x), as a native function.

    Parameters
    ----------
    space : :class:`~satsep_ot.methods.standard_space.StandardSpace`
    directions : ndarray (d, r)
        Orthonormal columns, r at least 1.

    Returns
    -------
    :py:class:`openturns.Function`

    Examples
    --------
    >>> import numpy as np
    >>> import openturns as ot
    >>> from satsep_ot.methods.active_variables import activeTransformation
    >>> from satsep_ot.methods.standard_space import StandardSpace
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


def inverseActiveTransformation(space, directions):
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


def surrogate_degree(count, dimension, largest=4):
    """The highest degree up to ``largest`` with at least two points for each polynomial term.

    Examples
    --------
    >>> from satsep_ot.methods.active_variables import surrogate_degree
    >>> surrogate_degree(100, 2), surrogate_degree(8, 2)
    (4, 1)
    """
    degree = largest
    while degree > 0 and 2 * math.comb(dimension + degree, degree) > count:
        degree -= 1
    return degree


def drawSufficientSummary(active, values, weights=None, name="output", level=0.95):
    """Output against the first one or two active variables with the regression on them.

    Parameters
    ----------
    active : ndarray (N, r)
        Active variables; the first two are drawn.
    values : ndarray (N,)
        Output.
    weights : ndarray (N,), optional
        Of the regression.
    name : str
        Of the output.
    level : float
        Level of the band of prediction.

    Returns
    -------
    :py:class:`openturns.Graph`
        One active variable: points, regression and its band. More: points in the plane of the first two over the
        contours of the regression on these two.
    """
    shown = min(active.shape[1], 2)
    active = active[:, :shown]
    basis = PolynomialBasis(shown, surrogate_degree(len(active), shown))
    fit = fit_polynomial(basis, active, values, weights, allow_deficient=True)
    lower, upper = active.min(axis=0), active.max(axis=0)
    cloud = ot.Cloud(active if shown == 2 else np.column_stack([active, values]))
    cloud.setPointStyle("fcircle")
    if shown == 2:
        graph = ot.Graph(f"Sufficient summary of {name}", "active variable 1", "active variable 2", True, "")
        first, second = (np.linspace(low, high, 41) for low, high in zip(lower, upper, strict=True))
        # OpenTURNS' contour takes the first variable as the fast one.
        mesh = np.column_stack([np.tile(first, 41), np.repeat(second, 41)])
        graph.add(ot.Contour(*(ot.Sample(column[:, None]) for column in (first, second, fit.predict(mesh)))))
        cloud.setColor("black")
        graph.add(cloud)
        return graph
    graph = ot.Graph(f"Sufficient summary of {name}", "active variable 1", name, True, "upper left")
    cloud.setLegend("runs")
    graph.add(cloud)
    grid = np.linspace(lower, upper, 101)
    curve = fit.predict(grid)
    line = ot.Curve(grid[:, 0], curve)
    line.setLegend(f"degree {basis.degree}")
    line.setColor("black")
    graph.add(line)
    variance = fit.noise_variance
    if np.isfinite(variance):
        quantile = ot.Student(float(len(values) - fit.rank)).computeQuantile(0.5 + 0.5 * level)[0]
        half = quantile * np.sqrt(variance * (1.0 + fit.relative_variance(grid)))
        for bound, legend in ((curve - half, f"{100 * level:g} % band"), (curve + half, "")):
            edge = ot.Curve(grid[:, 0], bound)
            edge.setLineStyle("dashed")
            edge.setColor("black")
            edge.setLegend(legend)
            graph.add(edge)
    return graph
