"""The maps to and from the active variables are native: they survive a Study and a pickle bit for bit."""

import pickle

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.common.standard_space import StandardSpace
from satsep_ot.methods.subspaces.ridge_approximation import RidgeApproximation
from satsep_ot.methods.subspaces.variables import activeTransformation, inverseActiveTransformation, surrogate_degree

MARGINALS = [ot.Uniform(0.0, 2.0), ot.Gumbel(1.0, 2.0), ot.Normal(3.0, 0.1)]
LAWS = {
    "independent": ot.JointDistribution(MARGINALS),
    "normal copula": ot.JointDistribution(
        MARGINALS, ot.NormalCopula(ot.CorrelationMatrix([[1.0, 0.4, 0.0], [0.4, 1.0, -0.3], [0.0, -0.3, 1.0]]))
    ),
    "Clayton block": ot.JointDistribution(
        MARGINALS, ot.BlockIndependentCopula([ot.ClaytonCopula(2.0), ot.IndependentCopula(1)])
    ),
    "Frank block": ot.JointDistribution(
        MARGINALS, ot.BlockIndependentCopula([ot.IndependentCopula(1), ot.FrankCopula(4.0)])
    ),
}


def throughStudy(function, path):
    study = ot.Study()
    study.setStorageManager(ot.XMLStorageManager(str(path)))
    study.add("function", function)
    study.save()
    reader = ot.Study()
    reader.setStorageManager(ot.XMLStorageManager(str(path)))
    reader.load()
    loaded = ot.Function()
    reader.fillObject("function", loaded)
    return loaded


@pytest.mark.parametrize("name", sorted(LAWS))
def test_maps_survive_study_and_pickle_bit_for_bit(name, tmp_path):
    ot.RandomGenerator.SetSeed(1)
    space = StandardSpace(LAWS[name])
    directions = np.linalg.qr(np.array(ot.Normal(3).getSample(2)).T)[0]
    forward, backward = activeTransformation(space, directions), inverseActiveTransformation(space, directions)
    physical, active = LAWS[name].getSample(40), ot.Normal(2).getSample(40)
    for function, sample in ((forward, physical), (backward, active)):
        expected = np.array(function(sample))
        for copy in (throughStudy(function, tmp_path / "study.xml"), pickle.loads(pickle.dumps(function))):
            assert np.array_equal(np.array(copy(sample)), expected)
            assert np.array_equal(np.array(copy.gradient(sample[0])), np.array(function.gradient(sample[0])))
    np.testing.assert_allclose(np.array(forward(backward(active))), np.array(active), atol=1e-8)
    np.testing.assert_allclose(np.array(forward(physical)), space.toStandard(physical) @ directions, atol=1e-12)


def test_ridge_surrogate_survives_study_bit_for_bit(tmp_path):
    ot.RandomGenerator.SetSeed(2)
    law = LAWS["normal copula"]
    inputs = law.getSample(120)
    algorithm = RidgeApproximation(inputs, ot.SymbolicFunction(["a", "b", "c"], ["exp(a) + b * c"])(inputs), law)
    algorithm.setDimension(2)
    algorithm.run()
    metaModel = algorithm.getResult().getMetaModel()
    fresh = law.getSample(30)
    loaded = throughStudy(metaModel, tmp_path / "study.xml")
    assert np.array_equal(np.array(loaded(fresh)), np.array(metaModel(fresh)))


def test_degree_needs_two_points_for_each_term():
    assert [surrogate_degree(count, 2) for count in (1, 2, 6, 12, 20, 30)] == [0, 0, 1, 2, 3, 4]
