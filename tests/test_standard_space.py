"""The standard space: right where it exists, refused where it does not."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.standard_space import StandardSpace

CORRELATION = ot.CorrelationMatrix([[1.0, 0.5], [0.5, 1.0]])
MARGINALS = [ot.Gumbel(1.0, 2.0), ot.LogNormal(0.0, 0.3)]


@pytest.mark.parametrize(
    "copula",
    [
        ot.IndependentCopula(2),
        ot.NormalCopula(CORRELATION),
        ot.ClaytonCopula(2.0),
        ot.GumbelCopula(2.0),
        ot.FrankCopula(3.0),
    ],
)
def test_chain_rule_matches_differences_in_the_standard_space(copula):
    space = StandardSpace(ot.JointDistribution(MARGINALS, copula))
    function = ot.SymbolicFunction(["a", "b"], ["a^2 * b", "sin(a) + b"])
    points = np.array(ot.Normal(2).getSample(6))
    physical = space.toPhysical(points)
    np.testing.assert_allclose(space.toStandard(physical), points, atol=1e-9)
    gradients = space.chainGradient(points, np.stack([np.array(function.gradient(x)) for x in physical]))
    for i in range(2):
        step = 1e-5 * np.eye(2)[i]
        ahead, behind = (np.array(function(space.toPhysical(points + s * step))) for s in (1.0, -1.0))
        np.testing.assert_allclose(gradients[:, i], (ahead - behind) / 2e-5, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    "distribution",
    [
        ot.Student(3.0, [0.0] * 2, [1.0] * 2, CORRELATION),
        ot.Student(3.0),
        ot.JointDistribution(MARGINALS, ot.StudentCopula(3.0, CORRELATION)),
        ot.StudentCopula(3.0, CORRELATION),
    ],
)
def test_student_spaces_are_refused(distribution):
    with pytest.raises(ValueError, match="Student, not the independent standard normal"):
        StandardSpace(distribution)


def test_block_that_only_claims_a_normal_space_is_refused():
    # The one-dimensional Student block keeps its own standard space while the whole claims the normal one.
    claims = ot.BlockIndependentDistribution([ot.Student(3.0), ot.Normal(2)])
    with pytest.raises(ValueError, match="does not lead to independent standard normals"):
        StandardSpace(claims)


@pytest.mark.parametrize("marginal", [ot.Poisson(3.0), ot.Dirac(1.0), ot.Mixture([ot.Dirac(0.0), ot.Normal()])])
def test_inputs_with_atoms_are_refused_by_name(marginal):
    distribution = ot.JointDistribution([ot.Normal(), marginal])
    distribution.setDescription(["smooth", "lumpy"])
    with pytest.raises(ValueError, match="lumpy"):
        StandardSpace(distribution)


def test_univariate_student_among_independent_marginals_is_fine():
    space = StandardSpace(ot.JointDistribution([ot.Student(3.0), ot.Normal()]))
    assert space.getDimension() == 2
    assert space.generateSample(5).shape == (5, 2)
