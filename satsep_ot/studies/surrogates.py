"""Surrogates of the smooth components of a case: fitted to runs with gradients, sampled in place of the simulator."""

import numpy as np
import openturns as ot

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.methods.subspaces.dimension import energy_dimension
from satsep_ot.methods.subspaces.gradients import StandardModel
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem
from satsep_ot.studies.telling.results import Component

# Share of the gradients' energy in the directions of a surrogate: the gaps between the eigenvalues of a noise-free
# simulator show directions that hardly matter to the output as well. The band of the regression shows what is left out.
_ENERGY = 0.95
# Points of standard space at once: those of all inputs together would be the largest array of a study.
_CHUNK = 20_000


def sample_gradients(
    model: SeparationFunction, distribution: ot.Distribution, size: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Runs with gradients at random points.

    Parameters
    ----------
    model : :class:`satsep_ot.model.separation_function.SeparationFunction`
    distribution : :class:`openturns.Distribution`
        Of the inputs.
    size : int
        Number of runs, drawn from OpenTURNS' generator.

    Returns
    -------
    points, values, gradients : ndarray, shapes (size, d), (size, p) and (size, d, p)
        Points of standard space, and gradients there.
    """
    space = StandardSpace(distribution)
    standard = StandardModel(model, space, model.computeGradientSample)
    points = space.generateSample(size)
    return points, standard.evaluate(points), standard.exactGradients(points)


def fit_component(
    distribution: ot.Distribution, points: np.ndarray, values: np.ndarray, gradients: np.ndarray
) -> Component | None:
    """The active subspace of one output and the polynomial regression on its active variables.

    Parameters
    ----------
    distribution : :class:`openturns.Distribution`
        Of the inputs.
    points : ndarray, shape (N, d)
        Of standard space.
    values : ndarray, shape (N,)
    gradients : ndarray, shape (N, d)
        In standard space.

    Returns
    -------
    component : Component, or None
        None where the output is constant.
    """
    algorithm = ActiveSubspaceAlgorithm.FromGradientSample(distribution, points, values[:, None], gradients[:, :, None])
    # Bands are of the subspace whose dimension is known by then.
    replicates = algorithm.getBootstrapSize()
    algorithm.setBootstrapSize(2)
    algorithm.run()
    if algorithm.getResult().getDimension() == 0:
        return None
    algorithm.setBootstrapSize(replicates)
    algorithm.setDimension(energy_dimension(algorithm.getResult().getEigenvalues(), _ENERGY))
    algorithm.run()
    subspace = algorithm.getResult()
    active = points @ np.array(subspace.getDirections())
    regression = MultivariatePolynomialRegression(
        ot.Sample(active), ot.Sample(values[:, None]), ot.Normal(active.shape[1])
    )
    regression.run()
    return Component(subspace, active, values, regression.getResult())


def sample_surrogates(problem: SeparationProblem, components: dict[str, Component], size: int) -> dict[str, np.ndarray]:
    """The smooth components, and the quantities of the requirements, by the surrogates alone from one sample.

    Parameters
    ----------
    problem : :class:`satsep_ot.model.separation_problem.SeparationProblem`
    components : dict of str to Component
    size : int
        Points, drawn from OpenTURNS' generator.

    Returns
    -------
    values : dict of str to ndarray, shape (size,)
        By quantity; without those that need a component that is not there.
    """
    normal = ot.Normal(problem.getDistribution().getDimension())
    active: dict[str, list[np.ndarray]] = {name: [] for name in components}
    for start in range(0, size, _CHUNK):
        points = np.asarray(normal.getSample(min(_CHUNK, size - start)))
        for name, part in components.items():
            active[name].append(points @ np.array(part.subspace.getDirections()))
    values = {
        name: np.asarray(part.regression.getMetaModel()(ot.Sample(np.concatenate(active[name]))))[:, 0]
        for name, part in components.items()
    }
    quantities = {}
    for entry in problem.getRequirements():
        names = problem.getSmoothComponentNames(entry)
        if all(name in values for name in names):
            _, _, _, composition = problem.getComponents(entry)
            parts = np.column_stack([values[name] for name in names])
            quantities[entry.quantity] = np.asarray(composition(parts))[:, 0]
    return values | quantities
