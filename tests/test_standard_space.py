"""The standard space: right where it exists, refused where it does not."""

import time

import numpy as np
import openturns as ot
import pytest
from scipy import special, stats

from satsep_ot.methods.common.standard_space import StandardSpace, nameInputs

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


def normal_conditional(u, v):
    return special.ndtr((special.ndtri(v) - 0.5 * special.ndtri(u)) / np.sqrt(0.75))


def clayton_conditional(u, v, theta=2.0):
    return u ** (-theta - 1.0) * (u**-theta + v**-theta - 1.0) ** (-1.0 / theta - 1.0)


def gumbel_conditional(u, v, theta=2.0):
    a, b = -np.log(u), -np.log(v)
    s = a**theta + b**theta
    return np.exp(-(s ** (1.0 / theta))) * s ** (1.0 / theta - 1.0) * a ** (theta - 1.0) / u


def frank_conditional(u, v, theta=3.0):
    a, b, c = np.expm1(-theta * u), np.expm1(-theta * v), np.expm1(-theta)
    return (a + 1.0) * b / (c + a * b)


@pytest.mark.parametrize(
    ("copula", "conditional"),
    [
        (ot.NormalCopula(CORRELATION), normal_conditional),
        (ot.ClaytonCopula(2.0), clayton_conditional),
        (ot.GumbelCopula(2.0), gumbel_conditional),
        (ot.FrankCopula(3.0), frank_conditional),
    ],
)
def test_transformation_and_gradient_are_those_of_the_conditional_law(copula, conditional):
    # Rosenblatt: U_1 = Phi^-1(F_1(x_1)), U_2 = Phi^-1(C(F_2(x_2) | F_1(x_1))), Nelsen (2006) for the copulas.
    space = StandardSpace(ot.JointDistribution([ot.Uniform(0.0, 1.0), ot.Uniform(1.0, 3.0)], copula))
    physical = np.random.default_rng(0).uniform([0.05, 1.1], [0.95, 2.9], (20, 2))

    def second(x):
        return special.ndtri(conditional(x[:, 0], (x[:, 1] - 1.0) / 2.0))

    expected = np.column_stack([special.ndtri(physical[:, 0]), second(physical)])
    points = space.toStandard(physical)
    np.testing.assert_allclose(points, expected, atol=1e-9)
    np.testing.assert_allclose(space.toPhysical(expected), physical, atol=1e-9)
    # The gradient of u_2(x) with respect to u is the second unit vector.
    step = 1e-6
    gradient = np.stack([(second(physical + step * e) - second(physical - step * e)) / (2.0 * step) for e in np.eye(2)])
    chained = space.chainGradient(points, gradient.T[:, :, None])[:, :, 0]
    np.testing.assert_allclose(chained, np.tile([0.0, 1.0], (20, 1)), atol=1e-6)


@pytest.mark.parametrize(
    "distribution",
    [
        ot.Student(3.0, [0.0] * 2, [1.0] * 2, CORRELATION),
        ot.JointDistribution(MARGINALS, ot.StudentCopula(3.0, CORRELATION)),
        ot.StudentCopula(3.0, CORRELATION),
    ],
)
def test_student_spaces_are_refused(distribution):
    with pytest.raises(ValueError, match="Student, not the independent standard normal"):
        StandardSpace(distribution)


def test_block_that_only_claims_a_normal_space_is_refused():
    # The one-dimensional Student block keeps its own standard space while the whole claims the normal one.
    claims = ot.BlockIndependentDistribution([ot.Student(3.0), ot.JointDistribution(MARGINALS, ot.ClaytonCopula(2.0))])
    with pytest.raises(ValueError, match="does not lead to independent standard normals"):
        StandardSpace(claims)


@pytest.mark.parametrize("marginal", [ot.Poisson(3.0), ot.Dirac(1.0), ot.Mixture([ot.Dirac(0.0), ot.Normal()])])
def test_inputs_with_atoms_are_refused_by_name(marginal):
    distribution = ot.JointDistribution([ot.Normal(), marginal])
    distribution.setDescription(["smooth", "lumpy"])
    with pytest.raises(ValueError, match="lumpy"):
        StandardSpace(distribution)


@pytest.mark.parametrize(
    "distribution",
    [
        ot.Student(3.0),
        ot.JointDistribution([ot.Student(3.0), ot.Normal()]),
        ot.BlockIndependentDistribution([ot.Student(3.0), ot.Normal(2)]),
    ],
)
def test_independent_inputs_are_taken_one_by_one_whatever_space_they_have_of_their_own(distribution):
    space = StandardSpace(distribution)
    assert space.getRemarks() == []
    levels = np.array([0.1, 0.5, 0.9, 0.999])
    physical = space.toPhysical(np.repeat(special.ndtri(levels)[:, None], space.getDimension(), axis=1))
    np.testing.assert_allclose(physical[:, 0], stats.t.ppf(levels, 3), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        physical[:, 1:], np.repeat(special.ndtri(levels)[:, None], physical.shape[1] - 1, axis=1)
    )


def test_normal_inputs_cost_no_more_than_their_marginals():
    # OpenTURNS' own transformation of ot.Normal(2000) takes 2000^3 numbers.
    law = ot.Normal(2000)
    start = time.perf_counter()
    ot.JointDistribution([law.getMarginal(i) for i in range(2000)]).getIsoProbabilisticTransformation()([0.5] * 2000)
    marginals = time.perf_counter() - start
    start = time.perf_counter()
    space = StandardSpace(law)
    assert time.perf_counter() - start < 20.0 * marginals
    points = space.generateSample(3)
    np.testing.assert_array_equal(space.toPhysical(points), points)


def test_an_inexact_transformation_is_used_with_a_remark_that_states_its_error():
    sample = ot.JointDistribution(MARGINALS, ot.ClaytonCopula(2.0)).getSample(200)
    copula = ot.EmpiricalBernsteinCopula(sample, 20)
    space = StandardSpace(ot.JointDistribution(MARGINALS, copula))
    (remark,) = space.getRemarks()
    assert "inexact: a point comes back off by" in remark
    stated = float(remark.split("off by ")[1].split()[0])
    points = np.array([[0.0, 0.0], [1.0, -1.0], [-1.6, 1.6]])
    found = np.abs(space.toStandard(space.toPhysical(points)) - points).max()
    assert 0.3 * stated < found < 3.0 * stated


def test_shifted_points_and_slopes_of_independent_inputs_are_those_of_the_transformation():
    marginals = [
        ot.Gumbel(1.0, 2.0),
        ot.LogNormal(0.0, 0.3),
        ot.Normal(1.0, 2.0),
        ot.Student(3.0),
        ot.Uniform(0.0, 2.0),
    ]
    space = StandardSpace(ot.JointDistribution(marginals))
    points = space.generateSample(4)
    shifted = space.shiftedPhysical(points, 0.1)
    for i in range(5):
        np.testing.assert_array_equal(shifted[:, i], space.toPhysical(points + 0.1 * np.eye(5)[i]))
    slopes = space.chainGradient(points, np.ones((4, 5, 1)))[:, :, 0]
    for u, slope in zip(points, slopes, strict=True):
        expected = np.array(space.getInverseTransformation().gradient(u)).diagonal()
        np.testing.assert_allclose(slope, expected, rtol=1e-10)


def test_names_of_the_function_are_taken_only_where_the_distribution_has_none():
    function = ot.SymbolicFunction(["mass", "rate"], ["mass * rate"])
    law = ot.Normal(2)
    assert list(nameInputs(law, function).getDescription()) == ["mass", "rate"]
    assert list(law.getDescription()) == ["X0", "X1"]
    named = ot.JointDistribution([ot.Normal(), ot.Normal()])
    named.setDescription(["a", "b"])
    assert list(nameInputs(named, function).getDescription()) == ["a", "b"]
    # Two inputs of one name, and a function of other inputs.
    twice = ot.Function(function)
    twice.setInputDescription(["mass", "mass"])
    assert list(nameInputs(law, twice).getDescription()) == ["X0", "X1"]
    assert list(nameInputs(ot.Normal(3), function).getDescription()) == ["X0", "X1", "X2"]
