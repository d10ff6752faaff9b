"""What every kind of active subspace offers: maps to and from its variables, and the sufficient summary plot."""

import math

import numpy as np
import openturns as ot

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.polynomials.basis import PolynomialBasis
from satsep_ot.methods.polynomials.fit import fit_polynomial

# Ten steps of the colour map viridis, that of OpenTURNS' contours (Smith and van der Walt, 2015).
COLOURS = (
    "#440154", "#482878", "#3e4989", "#31688e", "#26828e", "#1f9e89", "#35b779", "#6ece58", "#b5de2b", "#fde725",
)  # fmt: skip


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


def drawSufficientSummary(
    active: np.ndarray, values: np.ndarray, weights: np.ndarray | None = None, name: str = "output", level: float = 0.95
) -> ot.Graph:
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
        One active variable: points, regression and its band. More: points in the plane of the first two, coloured by
        the output, over the contours of the regression on these two in the same colours.
    """
    shown = min(active.shape[1], 2)
    active = active[:, :shown]
    basis = PolynomialBasis(shown, surrogate_degree(len(active), shown))
    fit = fit_polynomial(basis, active, values, weights, allow_deficient=True)
    lower, upper = active.min(axis=0), active.max(axis=0)
    if shown == 2:
        graph = ot.Graph(f"Sufficient summary of {name}", "active variable 1", "active variable 2", True, "")
        first, second = (np.linspace(low, high, 41) for low, high in zip(lower, upper, strict=True))
        # OpenTURNS' contour takes the first variable as the fast one.
        mesh = np.column_stack([np.tile(first, 41), np.repeat(second, 41)])
        surface = fit.predict(mesh)
        # Lines and points share their colours: where they differ, other variables matter.
        # What the regression makes of corners without points would take all the colours: the range is that of the runs.
        edges = np.linspace(values.min(), values.max(), len(COLOURS) + 1)
        levels = [level_ for level_ in edges if surface.min() < level_ < surface.max()]
        if levels:
            contour = ot.Contour(*(ot.Sample(column[:, None]) for column in (first, second, surface)))
            contour.setLevels(levels)
            contour.setLabels([f"{level_:.3g}" for level_ in levels])
            contour.setColorMap("viridis")
            contour.setVmin(edges[0])
            contour.setVmax(edges[-1])
            graph.add(contour)
        classes = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(COLOURS) - 1)
        for number, colour in enumerate(COLOURS):
            if (classes == number).any():
                graph.add(ot.Cloud(active[classes == number], colour, "fcircle"))
        return graph
    graph = ot.Graph(f"Sufficient summary of {name}", "active variable 1", name, True, "upper left")
    cloud = ot.Cloud(np.column_stack([active, values]))
    cloud.setPointStyle("fcircle")
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
