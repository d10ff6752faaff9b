"""Active subspaces against closed forms, brute force, and the cases in which others fail."""

import itertools
import math
import pickle

import numpy as np
import openturns as ot
import pytest
from time_ratio import time_ratio

from satsep_ot.methods.common.single_thread import singleThread
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.methods.subspaces.estimation import (
    bootstrap_distances,
    bootstrap_subspace,
    estimate_subspace,
    reflected_bands,
    small_side_svd,
    subspace_distance,
)
from satsep_ot.methods.subspaces.noise import estimate_noise
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult


@pytest.fixture(autouse=True)
def seed():
    ot.RandomGenerator.SetSeed(20)


def result_of(function, distribution, **options):
    algorithm = ActiveSubspaceAlgorithm(function, distribution)
    algorithm.setBootstrapSize(200)
    for name, value in options.items():
        getattr(algorithm, name)(value)
    algorithm.run()
    return algorithm.getResult()


def test_linear_function_of_correlated_normals_in_closed_form():
    # g = a.x, X = mu + L U: the gradient in U is L^T a everywhere, so lambda_1 = a^T Sigma a = Var g.
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 2.0, -0.3], [0.5, -0.3, 1.0]])
    law = ot.Normal([1.0, 2.0, 3.0], ot.CovarianceMatrix(covariance))
    a = np.array([1.0, -2.0, 3.0])
    result = result_of(ot.SymbolicFunction(["x", "y", "z"], ["x - 2 * y + 3 * z"]), law)
    assert result.getDimension() == 1
    assert result.getEigenvalues()[0] == pytest.approx(a @ covariance @ a)
    expected = np.linalg.cholesky(covariance).T @ a
    direction = np.array(result.getDirections())
    assert subspace_distance(direction, expected[:, None] / np.linalg.norm(expected)) < 1e-10
    assert direction[np.abs(direction).argmax()] > 0.0
    assert np.array(result.getTotalSobolBound()).sum() == pytest.approx(
        a @ covariance @ a / result.getOutputSample().computeVariance()[0]
    )


@pytest.mark.parametrize(
    "copula", [ot.NormalCopula(2), ot.ClaytonCopula(2.0), ot.GumbelCopula(2.0), ot.FrankCopula(4.0)]
)
@pytest.mark.parametrize("method", ["Exact", "CentralDifference"])
def test_ridge_behind_a_copula(copula, method):
    # g = exp(w.T(x)): the subspace in U is w and the eigenvalue E[exp(2 w.U)] |w|^2 = |w|^2 exp(2 |w|^2).
    law = ot.JointDistribution([ot.Gumbel(1.0, 2.0), ot.Uniform(-1.0, 3.0)], copula)
    ridge = ot.ComposedFunction(
        ot.SymbolicFunction(["u", "v"], ["exp(0.3 * u - 0.4 * v)"]), law.getIsoProbabilisticTransformation()
    )
    result = result_of(ridge, law, setSamplingSize=400, setGradientMethod=method)
    assert result.getDimension() == 1
    assert subspace_distance(np.array(result.getDirections()), np.array([[-0.6], [0.8]])) < 1e-5
    interval = result.getEigenvaluesInterval(0.999)
    assert interval.getLowerBound()[0] < 0.25 * math.exp(0.5) < interval.getUpperBound()[0]


def test_svd_agrees_with_the_matrix_and_keeps_small_eigenvalues():
    random = np.random.default_rng(0)
    gradients = random.standard_normal((50, 6, 2))
    weights = random.uniform(0.0, 1.0, 50)
    scales = np.array([2.0, 0.1])
    eigenvalues, vectors = estimate_subspace(gradients, scales, weights)
    matrix = np.einsum("nip,njp,n,p->ij", gradients, gradients, weights / weights.sum(), 1.0 / scales)
    np.testing.assert_allclose(matrix @ vectors, vectors * eigenvalues, atol=1e-12 * eigenvalues[0])
    # Eigenvalues over 24 decades: those of the product matrix would drown in rounding below 1e-16.
    graded = random.standard_normal((200, 4)) * [1.0, 1e-4, 1e-8, 1e-12]
    found = estimate_subspace(graded[:, :, None])[0]
    np.testing.assert_allclose(found / [1.0, 1e-8, 1e-16, 1e-24], 1.0, rtol=0.5)


def test_vector_output_is_weighted_by_variance():
    function = ot.SymbolicFunction(["a", "b", "c"], ["1e4 * a", "1e-4 * b^2", "5"])
    result = result_of(function, ot.Normal(3), setSamplingSize=2000)
    # a: 1; b: E[4 b^2] / Var(b^2) = 4 / 2 = 2; the constant output does not count.
    np.testing.assert_allclose(np.array(result.getEigenvalues()), [2.0, 1.0, 0.0], rtol=0.25, atol=1e-12)
    assert result.getDimension() == 2


def test_bootstrap_equals_brute_force():
    random = np.random.default_rng(3)
    # Fewer rows than inputs, the direct way, the way through the triangle, and two outputs of a point together.
    for count, outputs in ((6, 1), (30, 1), (100, 1), (20, 2), (60, 2)):
        gradients = random.standard_normal((count, 8, outputs)) * np.linspace(1.0, 0.1, 8)[:, None]
        weights = random.uniform(0.1, 1.0, count)
        counts, eigenvalues, vectors = bootstrap_subspace(gradients, 20, 3, weights=weights)
        assert (counts.sum(axis=1) == count).all()
        vectors0 = estimate_subspace(gradients, weights=weights)[1]
        distances = bootstrap_distances(vectors0, vectors)
        for b in range(20):
            drawn = np.repeat(np.arange(count), counts[b])
            reference, basis = estimate_subspace(gradients[drawn], weights=weights[drawn])
            np.testing.assert_allclose(eigenvalues[b], reference, atol=1e-10 * reference[0])
            for r in (1, 2):
                projector = vectors0[:, :r] @ vectors0[:, :r].T - basis[:, :r] @ basis[:, :r].T
                assert distances[b, r - 1] == pytest.approx(np.linalg.norm(projector, 2), abs=1e-7)


def test_a_replicate_of_the_bootstrap_costs_no_more_than_three_estimates():
    gradients = np.random.default_rng(1).standard_normal((200, 35, 1))
    vectors0 = estimate_subspace(gradients)[1]

    def replicates():
        _, _, vectors = bootstrap_subspace(gradients, 100, 10)
        bootstrap_distances(vectors0, vectors)

    def estimates():
        for _ in range(100):
            estimate_subspace(gradients)

    # About as much, where nothing else runs.
    assert time_ratio(replicates, estimates) < 3.0


@pytest.mark.parametrize(
    ("formula", "inputs", "scores"), [("a * b", 2, [1.0, 1.0]), ("a^2 + b^2 + c^2 + e^2", 4, [4.0] * 4)]
)
def test_where_no_gap_separates_any_direction_all_count(formula, inputs, scores):
    names = ["a", "b", "c", "e"][:inputs]
    result = result_of(ot.SymbolicFunction(names, [formula]), ot.Normal(inputs), setSamplingSize=2000)
    assert not result.isConstant()
    assert not result.hasReduction()
    assert result.getDimension() == inputs
    choices = result.getDimensionChoices()
    assert choices["gap"] is None
    assert choices["crossValidation"] == inputs
    (remark,) = result.getRemarks()
    assert f"no reduction found: no gap separates the eigenvalues, so all {inputs} directions count" in remark
    assert f"a polynomial predicts as well in {inputs} of them" in remark
    # In closed form: E[(dg/da)^2] of each.
    np.testing.assert_allclose(np.array(result.getActivityScores()), scores, rtol=0.15)
    assert result.getActivityScoresInterval().contains(result.getActivityScores())
    assert result.getErrorBound() == 0.0
    assert result.getTransformation().getOutputDimension() == inputs
    assert result.getRegressionResult().getQ2LeaveOneOut()[0] == pytest.approx(1.0)
    for graph in (result.drawSufficientSummary(), result.drawActivityScores(), result.drawEigenvalues()):
        assert graph.getDrawables().getSize() > 1


@pytest.mark.parametrize("scale", [1e-300, 1e-150, 1.0, 1e150, 1e300])
@pytest.mark.parametrize("method", ["Exact", "CentralDifference"])
def test_directions_do_not_depend_on_the_size_of_the_output(scale, method):
    def values(points):
        u = np.asarray(points, dtype=float)
        return scale * np.exp(0.3 * u @ [0.6, 0.8])[:, None]

    def gradients(points):
        return (0.3 * values(points) * [0.6, 0.8])[:, :, None]

    algorithm = ActiveSubspaceAlgorithm(ot.PythonFunction(2, 1, func_sample=values), ot.Normal(2))
    algorithm.setGradientSampleFunction(gradients)
    algorithm.setGradientMethod(method)
    algorithm.setSamplingSize(60)
    algorithm.run()
    result = algorithm.getResult()
    assert (result.isConstant(), result.getDimension()) == (False, 1)
    np.testing.assert_allclose(np.array(result.getDirections())[:, 0], [0.6, 0.8], atol=1e-6)
    # E[(0.3 exp(0.3 z))^2], in units of the square of what the remark names.
    unit = 1.0
    if abs(math.log10(scale)) > 120.0:
        (remark,) = (remark for remark in result.getRemarks() if "cannot be represented" in remark)
        unit = float(remark.split()[-1])
    eigenvalue = 0.09 * math.exp(2.0 * 0.3**2)
    assert result.getEigenvalues()[0] * (unit / scale) ** 2 == pytest.approx(eigenvalue, rel=0.5)
    assert 0.0 <= result.getErrorBound() < 1e-3 * scale
    assert result.getRegressionResult().getQ2LeaveOneOut()[0] > 0.99
    lower, upper = result.getRegressionResult().getPredictionInterval(np.zeros((1, 1)))
    assert lower[0, 0] < scale < upper[0, 0]
    np.testing.assert_allclose(np.array(result.getOutputSample()), values(result.getStandardSample()), rtol=1e-15)


@pytest.mark.parametrize(
    "distribution", [ot.Normal([0.0] * 2, [1e-12] * 2), ot.JointDistribution([ot.Uniform(0.0, 1e-12)] * 2)]
)
@pytest.mark.parametrize("python", [False, True])
def test_directions_do_not_depend_on_the_size_of_the_inputs(distribution, python):
    function = ot.SymbolicFunction(["a", "b"], ["3e12 * a + 4e12 * b"])
    if python:
        function = ot.PythonFunction(2, 1, lambda x: [3e12 * x[0] + 4e12 * x[1]])
    result = result_of(function, distribution)
    assert result.getDimension() == 1
    np.testing.assert_allclose(np.array(result.getDirections())[:, 0], [0.6, 0.8], atol=0.1)


def test_what_varies_little_beside_its_mean_is_no_constant():
    result = result_of(ot.SymbolicFunction(["a", "b"], ["1e6 + 1e-9 * a"]), ot.Normal(2))
    assert (result.isConstant(), result.getDimension()) == (False, 1)
    assert result.getEigenvalues()[0] == pytest.approx(1e-18)


@pytest.mark.parametrize(
    "function",
    [
        ot.SymbolicFunction(["a", "b"], ["3"]),
        ot.PythonFunction(2, 1, lambda x: [3.0]),
        ot.PythonFunction(2, 1, lambda x: [3.0 + 1e-15 * math.sin(1e9 * x[0])]),
    ],
)
def test_constant_function_has_dimension_zero(function):
    result = result_of(function, ot.Normal(2))
    assert result.isConstant()
    assert result.getDimension() == 0
    assert tuple(np.array(result.getDirections()).shape) in {(2, 0), (0,)}
    with pytest.raises(ValueError, match="constant"):
        result.getTransformation()
    with pytest.raises(ValueError, match="Dimension 1 was asked for, but the function is constant"):
        result_of(function, ot.Normal(2), setDimension=1)


def test_one_input_one_gradient_and_fewer_gradients_than_inputs():
    assert result_of(ot.SymbolicFunction(["a"], ["a^2"]), ot.Uniform(0.0, 1.0)).getDimension() == 1
    single = result_of(ot.SymbolicFunction(["a", "b", "c"], ["a + b^2 + c"]), ot.Normal(3), setSamplingSize=1)
    assert single.getDimension() == 1
    assert single.getResolvedEigenvaluesNumber() == 1
    assert "resolve 1 of 3" in single.getRemarks()[0]
    names = [f"a{i}" for i in range(30)]
    few = result_of(ot.SymbolicFunction(names, ["a1 + 2 * a2 + a3 * a4"]), ot.Normal(30), setSamplingSize=12)
    vectors = np.array(few.getEigenvectors())
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(30), atol=1e-12)
    assert few.getDimension() in (1, 3)
    for graph in (
        few.drawEigenvalues(),
        few.drawSubspaceError(),
        few.drawActivityScores(),
        few.drawSufficientSummary(),
    ):
        assert isinstance(graph, ot.Graph)


def test_repeated_eigenvalues_are_named_as_a_group():
    function = ot.SymbolicFunction(["a", "b", "c"], ["2 * a^2 + 2 * b^2 + 0.1 * c"])
    result = result_of(function, ot.Normal(3), setSamplingSize=300)
    assert result.getRepeatedGroups() == [[0, 1]]
    assert result.getDimension() == 2
    # Inside the group only the plane means anything.
    assert result.compareDirections(np.eye(3)[:, :2]) < 1e-2


def test_scores_and_bounds_in_closed_form():
    # g = 3 a + 0.1 b + c^2: nu = (9, 0.01, 4), Var g = 9.01 + 2.
    function = ot.SymbolicFunction(["a", "b", "c"], ["3 * a + 0.1 * b + c^2"])
    result = result_of(function, ot.Normal(3), setSamplingSize=4000)
    nu = np.array(result.getDerivativeBasedIndices())
    np.testing.assert_allclose(nu, [9.0, 0.01, 4.0], rtol=0.1)
    np.testing.assert_allclose(np.array(result.getActivityScores(3)), nu, rtol=1e-10)
    interval = result.getDerivativeBasedIndicesInterval()
    assert interval.getLowerBound()[2] < 4.0 < interval.getUpperBound()[2]
    assert np.array(result.getActivityScoresInterval(0.95, 3).getUpperBound()) == pytest.approx(
        np.array(interval.getUpperBound())
    )
    np.testing.assert_allclose(np.array(result.getTotalSobolBound()), nu / 11.01, rtol=0.1)
    scores = result.getActivityScoresInterval()
    assert (np.array(scores.getLowerBound()) <= np.array(result.getActivityScores())).all()
    assert result.getErrorBound() == pytest.approx(
        math.sqrt(np.array(result.getEigenvalues())[result.getDimension() :].sum())
    )
    assert result.getErrorBoundInterval().getLowerBound()[0] <= result.getErrorBound()


def test_error_bound_holds():
    # g = sin(a) + 0.1 b^2 with y = a: E[(g - E[g|y])^2] = Var(0.1 b^2) = 0.02, bounded by E[(0.2 b)^2] = 0.04.
    function = ot.SymbolicFunction(["a", "b"], ["sin(a) + 0.1 * b^2"])
    result = result_of(function, ot.Normal(2), setSamplingSize=2000, setDimension=1)
    assert math.sqrt(0.02) < result.getErrorBound()
    assert result.getErrorBound() == pytest.approx(0.2, rel=0.1)


def test_average_gradient():
    result = result_of(ot.SymbolicFunction(["a", "b"], ["exp(0.3 * a + 0.4 * b)"]), ot.Normal(2))
    assert np.array(result.getAverageGradient()) == pytest.approx([0.6, 0.8])
    assert result.getAverageTransformation()([1.0, 2.0])[0] == pytest.approx(2.2)
    with pytest.raises(ValueError, match="one output"):
        result_of(ot.SymbolicFunction(["a", "b"], ["a", "b"]), ot.Normal(2)).getAverageGradient()


class Model(ot.OpenTURNSPythonFunction):
    """exp(w.x) with inputs of very different scale, and all gradients at once."""

    slope = np.array([3e-7, 4e4])

    def __init__(self):
        super().__init__(2, 1)

    def _exec_sample(self, x):
        return np.exp(np.asarray(x, dtype=float) @ self.slope)[:, None]

    def _exec(self, x):
        return [math.exp(np.dot(x, self.slope))]

    def computeGradientSample(self, x):
        return np.exp(x @ self.slope)[:, None, None] * self.slope[:, None]


LAW = ot.JointDistribution([ot.Normal(0.0, 1e6), ot.Normal(0.0, 1e-5)])


def test_batched_gradients_are_used_and_counted():
    algorithm = ActiveSubspaceAlgorithm(Model(), LAW)
    algorithm.setSamplingSize(60)
    algorithm.run()
    result = algorithm.getResult()
    assert subspace_distance(np.array(result.getDirections()), np.array([[0.6], [0.8]])) < 1e-12
    assert (result.getEvaluationNumber(), result.getGradientNumber()) == (60, 60)
    assert (algorithm.getEvaluationNumber(), algorithm.getGradientNumber()) == (60, 60)
    handed = ActiveSubspaceAlgorithm(ot.Function(Model()), LAW)
    handed.setGradientSampleFunction(Model().computeGradientSample)
    handed.run()
    assert handed.getResult().getGradientNumber() == handed.getSamplingSize()
    handed.setGradientSampleFunction(lambda x: x)
    with pytest.raises(ValueError, match="must return an array of shape"):
        handed.run()


@pytest.mark.parametrize("method", ["Automatic", "CentralDifference", "ForwardDifference"])
def test_differences_are_scaled_by_each_input(method):
    # OpenTURNS' own step of 1e-5 is as large as the second input's standard deviation.
    result = result_of(ot.Function(Model()), LAW, setGradientMethod=method, setSamplingSize=50)
    assert subspace_distance(np.array(result.getDirections()), np.array([[0.6], [0.8]])) < 1e-6
    evaluations = result.getEvaluationNumber() - 50
    line = evaluations % 50 or 50
    assert line % 9 == 0
    assert (evaluations - line) // 50 in ((2,) if method == "ForwardDifference" else (4,))
    assert result.getGradientNumber() == 0


def test_noise_is_estimated_and_the_step_follows():
    random = np.random.default_rng(8)
    level = 1e-5

    def noisy(x):
        x = np.asarray(x, dtype=float)
        return np.sin(x @ [0.3, 0.4, 0.0])[:, None] + level * random.standard_normal((len(x), 1))

    found, evaluations = estimate_noise(noisy, np.array([0.1, 0.2, 0.3]), np.array([1.0, 0.0, 0.0]))
    assert level / 4.0 < found[0] < 4.0 * level
    assert evaluations % 9 == 0
    result = result_of(ot.PythonFunction(3, 1, func_sample=noisy), ot.Normal(3))
    assert level / 4.0 < result.getNoise()[0] < 4.0 * level
    assert 0.01 < result.getFiniteDifferenceStep() < 0.1
    assert result.getDimension() == 1
    assert subspace_distance(np.array(result.getDirections()), np.array([[0.6], [0.8], [0.0]])) < 1e-3


def test_given_gradients_and_weights():
    random = np.random.default_rng(2)
    points = random.standard_normal((80, 4))
    near = points[:, 0] > 0.0
    gradients = np.where(near[:, None], [1.0, 2.0, 0.0, 0.0], [0.0, 0.0, 5.0, 0.0]) * random.uniform(0.5, 1.0, (80, 1))
    algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
        ot.Normal(4), points, points[:, 0], gradients, near.astype(float)
    )
    algorithm.run()
    result = algorithm.getResult()
    assert result.getDimension() == 1
    expected = np.array([[1.0], [2.0], [0.0], [0.0]]) / math.sqrt(5.0)
    assert subspace_distance(np.array(result.getDirections()), expected) < 1e-12
    assert result.getEvaluationNumber() == result.getGradientNumber() == 0
    gradients[7, 1] = np.nan
    with pytest.raises(ValueError, match="gradients must be finite, but 1 of 80 rows are not, the first is row 7"):
        ActiveSubspaceAlgorithm.FromGradientSample(ot.Normal(4), points, points[:, 0], gradients)
    with pytest.raises(ValueError, match="do not match"):
        ActiveSubspaceAlgorithm.FromGradientSample(ot.Normal(4), points[:5], points[:, 0], gradients)


def test_weight_function_of_the_outputs():
    function = ot.SymbolicFunction(["a", "b"], ["exp(a) + 0.1 * b"])
    result = result_of(function, ot.Normal(2), setWeightFunction=lambda y: 1.0 / (1.0 + (y[:, 0] / 0.1) ** 2))
    assert sum(result.getWeights()) == pytest.approx(1.0)
    assert result.getEigenvalues()[0] < 2.0  # 7.4 without weights: near 0 the exponential is flat


def test_scores_and_maps_name_the_inputs_as_the_function_does():
    result = result_of(ot.SymbolicFunction(["mass", "rate"], ["exp(0.5 * mass + 0.1 * rate)"]), ot.Normal(2))
    assert result.drawActivityScores().getTitle() == "Activity scores, largest: mass, rate"
    assert list(result.getTransformation().getInputDescription()) == ["mass", "rate"]


def test_functions_are_native_and_survive_pickle():
    law = ot.JointDistribution([ot.Uniform(0.0, 2.0), ot.Gumbel(1.0, 2.0), ot.Normal()], ot.NormalCopula(3))
    result = result_of(ot.SymbolicFunction(["a", "b", "c"], ["a + b^2 + c"]), law, setDimension=2)
    forward = pickle.loads(pickle.dumps(result.getTransformation()))
    backward = pickle.loads(pickle.dumps(result.getInverseTransformation()))
    sample = law.getSample(30)
    expected = np.array(law.getIsoProbabilisticTransformation()(sample)) @ np.array(result.getDirections())
    np.testing.assert_allclose(np.array(forward(sample)), expected, atol=1e-12)
    np.testing.assert_allclose(np.array(forward(backward(expected))), expected, atol=1e-8)


def test_sequential_use_reaches_the_target_or_says_so():
    function = ot.SymbolicFunction(["a", "b", "c"], ["exp(0.5 * a) + 0.3 * sin(b) * c"])
    algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(3))
    algorithm.setDimension(1)
    algorithm.setBootstrapSize(200)
    algorithm.setSamplingSize(20)
    algorithm.setTargetSubspaceError(0.1)
    algorithm.run()
    result = algorithm.getResult()
    assert result.getSubspaceErrorInterval().getUpperBound()[0] <= 0.1
    assert result.getGradientNumber() == result.getStandardSample().getSize() > 20
    algorithm.setTargetSubspaceError(1e-4, maximumSamplingSize=40)
    algorithm.run()
    assert "above the target" in algorithm.getResult().getRemarks()[-1]
    assert algorithm.getResult().getStandardSample().getSize() == 40


def test_disagreeing_criteria_are_reported():
    names = [f"x{i}" for i in range(6)]
    # lambda = (1, 0.02, 0.02, ...): one direction stands out, but five small ones hold 9 % of the energy.
    function = ot.SymbolicFunction(names, ["x0 + 0.1 * (x1^2 + x2^2 + x3^2 + x4^2 + x5^2) / sqrt(2)"])
    result = result_of(function, ot.Normal(6), setSamplingSize=200)
    choices = result.getDimensionChoices()
    assert (choices["gap"], choices["energy"], choices["agree"]) == (1, 6, False)
    # Every quadratic term helps the surrogate.
    assert choices["crossValidation"] == 6
    assert choices["chosen"] == result.getDimension() == 1
    assert result.getRemarks()[-1] == (
        f"The criteria for the dimension disagree: separated log-gap 1, ladle {choices['ladle']}, "
        "99 % of the energy 6, cross-validation 6; the log-gap's 1 is taken."
    )


def test_regression_on_the_active_variable_gives_mean_and_spread():
    # g = a^2 + (1 + a^2) b / 10 under N(0, I): E[g | a] = a^2, standard deviation (1 + a^2) / 10.
    function = ot.SymbolicFunction(["a", "b"], ["a^2 + (1 + a^2) * b / 10"])
    result = result_of(function, ot.Normal(2), setSamplingSize=2000, setDimension=1)
    regression = result.getRegressionResult()
    y = np.array([[-1.0], [0.0], [1.0]])
    np.testing.assert_allclose(regression.evaluate(y)[:, 0], y[:, 0] ** 2, atol=0.1)
    np.testing.assert_allclose(regression.computeSpread(y)[:, 0], (1.0 + y[:, 0] ** 2) / 10.0, rtol=0.3)


def test_not_finite_outputs_and_bad_options_are_refused():
    with pytest.raises(ValueError, match="returned \\[nan\\] at the physical point"):
        result_of(ot.PythonFunction(1, 1, lambda x: [math.nan if x[0] > 0.0 else x[0]]), ot.Normal())
    with pytest.raises(ValueError, match="2 inputs but the distribution has dimension 3"):
        ActiveSubspaceAlgorithm(ot.SymbolicFunction(["a", "b"], ["a"]), ot.Normal(3))
    algorithm = ActiveSubspaceAlgorithm(ot.SymbolicFunction(["a"], ["a"]), ot.Normal())
    for setter, value, message in (
        ("setSamplingSize", 0, "at least 1"),
        ("setBootstrapSize", 1, "at least 2"),
        ("setDimension", 2, "1 to 1"),
        ("setGradientMethod", "guess", "must be one of"),
        ("setFiniteDifferenceStep", -1.0, "positive"),
        ("setTargetSubspaceError", 2.0, r"\(0, 1\)"),
    ):
        with pytest.raises(ValueError, match=message):
            getattr(algorithm, setter)(value)
    with pytest.raises(RuntimeError, match=r"call run\(\) first"):
        algorithm.getResult()


def test_sufficient_summary_in_one_and_two_dimensions():
    one = result_of(
        ot.SymbolicFunction(["a", "b"], ["exp(0.3 * a + 0.4 * b) + 0.01 * a"]), ot.Normal(2), setDimension=1
    )
    assert len(one.drawSufficientSummary().getDrawables()) == 4
    two = result_of(ot.SymbolicFunction(["a", "b", "c"], ["a * b + c"]), ot.Normal(3), setDimension=2)
    drawables = list(two.drawSufficientSummary().getDrawables())
    assert drawables[0].getImplementation().getClassName() == "Contour"
    # Every run is a point of one of the colours, and steeper colours are larger outputs.
    clouds = [np.array(drawable.getData()) for drawable in drawables[1:]]
    shown = np.concatenate(clouds)
    active, outputs = np.array(two.getActiveSample()), np.array(two.getOutputSample())[:, 0]
    assert sorted(map(tuple, shown)) == sorted(map(tuple, active))
    output_of = dict(zip(map(tuple, active), outputs, strict=True))
    levels = [[output_of[tuple(point)] for point in cloud] for cloud in clouds]
    assert all(max(low) <= min(high) for low, high in itertools.pairwise(levels))
    with pytest.raises(ValueError, match="output is 1; it must be 0 to 0"):
        two.drawSufficientSummary(output=1)


def test_intervals_cover_at_their_level():
    # g = sum c_i u_i^2 / 2 + l.u has the matrix diag(c^2) + l l^T; bands of plain quantiles hold the third eigenvalue
    # and the error bound in 80 % only.
    curvature, slope = np.array([2.0, 1.0, 0.5, 0.25]), np.array([1.0, 0.0, 0.0, 0.2])
    matrix = np.diag(curvature**2) + np.outer(slope, slope)
    truth = np.linalg.eigvalsh(matrix)[::-1]
    first = np.linalg.eigh(matrix)[1][:, -2:] ** 2 @ truth[1::-1]
    random = np.random.default_rng(6)
    inside = {"eigenvalues": [], "scores": [], "bound": [], "distance": []}
    for _ in range(100):
        points = random.standard_normal((60, 4))
        algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
            ot.Normal(4), points, np.zeros((60, 1)), curvature * points + slope
        )
        algorithm.setDimension(2)
        algorithm.setBootstrapSize(300)
        algorithm.run()
        result = algorithm.getResult()
        for name, interval, expected in (
            ("eigenvalues", result.getEigenvaluesInterval(0.9), truth),
            ("scores", result.getActivityScoresInterval(0.9), first),
            ("bound", result.getErrorBoundInterval(0.9), [math.sqrt(truth[2:].sum())]),
        ):
            lower, upper = np.array(interval.getLowerBound()), np.array(interval.getUpperBound())
            inside[name].append(((lower <= expected) & (expected <= upper))[:2].mean())
        distance = result.compareDirections(np.linalg.eigh(matrix)[1][:, -2:])
        inside["distance"].append(distance <= result.getSubspaceErrorInterval(0.9).getUpperBound()[1])
    # Three standard errors of 100 binomial trials are 0.09; the upper band alone leaves 5 % out.
    for name, hits in inside.items():
        assert abs(np.mean(hits) - (0.95 if name == "distance" else 0.9)) < 0.09, (name, np.mean(hits))


def test_eigenvalues_that_are_rounding_are_not_drawn():
    graph = result_of(ot.SymbolicFunction(["a", "b", "c"], ["exp(a) + b^2"]), ot.Normal(3)).drawEigenvalues()
    assert graph.getTitle() == "Eigenvalues with bootstrap band, 1 of 3 are 0"
    assert graph.getLogScale() == ot.GraphImplementation.LOGY
    for drawable in graph.getDrawables():
        assert np.array(drawable.getData()).shape == (2, 2)
    constant = result_of(ot.SymbolicFunction(["a", "b"], ["3"]), ot.Normal(2)).drawEigenvalues()
    assert constant.getLogScale() == ot.GraphImplementation.NONE


def test_scores_are_drawn_largest_first_with_their_names():
    names = ["small", "large", "middle"]
    function = ot.SymbolicFunction(names, ["0.1 * small + 3 * large + middle"])
    law = ot.Normal(3)
    law.setDescription(names)
    graph = result_of(function, law).drawActivityScores()
    assert graph.getTitle() == "Activity scores, largest: large, middle, small"
    bars = [d for d in graph.getDrawables() if d.getImplementation().getClassName() == "Polygon"]
    assert [np.array(bar.getData())[:, 1].max() for bar in bars] == pytest.approx([9.0, 1.0, 0.01])
    text = graph.getDrawables()[-1]
    assert list(text.getTextAnnotations()) == ["large", "middle", "small"]


def test_the_subspace_error_lies_in_its_band_and_is_nothing_for_a_ridge():
    law = ot.Normal(4)
    plain = result_of(ot.SymbolicFunction(list("abcd"), ["exp(a + 0.5*b) + 0.3*c^2 + 0.1*d"]), law, setSamplingSize=60)
    error, band = np.array(plain.getSubspaceError()), plain.getSubspaceErrorInterval()
    assert (np.array(band.getLowerBound()) <= error).all()
    assert (error <= np.array(band.getUpperBound())).all()
    assert 0.0 < error[0] < 1.0
    ridge = result_of(ot.SymbolicFunction(list("abcd"), ["exp(a + 0.5*b - d)"]), law, setSamplingSize=60)
    assert ridge.getSubspaceError()[0] < 1e-7


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_the_drawn_eigenvalues_are_the_same_in_any_unit(scale):
    """What counts as rounding on the logarithmic scale is relative to the largest eigenvalue."""
    gradients = scale * np.random.default_rng(0).normal(size=(50, 3, 1)) * [[1.0], [1e-3], [1e-6]]
    algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
        ot.Normal(3), np.zeros((50, 3)), np.zeros((50, 1)), gradients
    )
    algorithm.run()
    graph = algorithm.getResult().drawEigenvalues()
    assert max(drawable.getData().getSize() for drawable in graph.getDrawables()) >= 3
    assert "are 0" not in graph.getTitle()


def test_the_point_whose_output_is_not_finite_is_named():
    """Also where it is one of several outputs."""
    function = ot.PythonFunction(1, 2, lambda x: [x[0], float("nan") if x[0] > 1.5 else 1.0])
    algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(1))
    algorithm.setGradientMethod("CentralDifference")
    ot.RandomGenerator.SetSeed(0)
    with pytest.raises(ValueError, match=r"returned \[[\d.e-]+, nan\] at the physical point \[[\d.e-]+\]"):
        algorithm.run()


@pytest.mark.parametrize(("inputs", "size"), [(1, 42), (2, 42), (10, 139), (35, 214)])
def test_ten_times_six_eigenvalues_times_the_logarithm_of_the_inputs_are_sampled(inputs, size):
    law = ot.Normal(inputs)
    algorithm = ActiveSubspaceAlgorithm(ot.SymbolicFunction(law.getDescription(), ["X0"]), law)
    assert algorithm.getSamplingSize() == size


def test_gradients_are_added_by_halves_up_to_the_largest_number():
    sizes = []

    def weigh(values):
        sizes.append(len(values))
        return np.ones(len(values))

    function = ot.SymbolicFunction(["a", "b", "c"], ["exp(0.5 * a) + 0.3 * sin(b) * c"])
    algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(3))
    algorithm.setDimension(1)
    algorithm.setBootstrapSize(20)
    algorithm.setSamplingSize(30)
    algorithm.setWeightFunction(weigh)
    algorithm.setTargetSubspaceError(1e-6)
    algorithm.run()
    # 60 log 3 = 66 points by default, and ten times as many at most.
    assert sizes == [30, 45, 68, 102, 153, 230, 345, 518, 660]
    assert algorithm.getEvaluationNumber() == 660
    assert "after 660 gradients, above the target 1e-06" in algorithm.getResult().getRemarks()[-1]


def test_a_target_that_no_dimension_can_reach_is_said_to_be_missed():
    names = ["a", "b", "c", "e"]
    function = ot.SymbolicFunction(names, ["a^2 + b^2 + c^2 + e^2"])
    algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(4))
    algorithm.setTargetSubspaceError(0.5, maximumSamplingSize=200)
    algorithm.setSamplingSize(200)
    algorithm.run()
    assert "upper band is 1 after 200 gradients" in algorithm.getResult().getRemarks()[-1]


def noisyFunction(level, slope=1.0):
    random = np.random.default_rng(8)
    return ot.PythonFunction(
        3,
        1,
        func_sample=lambda x: (
            slope * np.sin(np.asarray(x) @ [0.3, 0.4, 0.0])[:, None] + level * random.standard_normal((len(x), 1))
        ),
    )


@pytest.mark.parametrize(("method", "level"), [("CentralDifference", 1e-5), ("ForwardDifference", 1e-5)])
def test_the_step_balances_noise_and_truncation(method, level):
    result = result_of(noisyFunction(level), ot.Normal(3), setGradientMethod=method)
    relative = result.getNoise()[0] / np.std(np.array(result.getOutputSample()))
    # For unit third or second derivatives: (3 eta)^(1/3), 1.68 eta^(1/2) (More and Wild, 2012).
    expected = (3.0 * relative) ** (1.0 / 3.0) if method == "CentralDifference" else 1.68 * math.sqrt(relative)
    assert result.getFiniteDifferenceStep() == pytest.approx(expected, rel=1e-6)
    assert result.getGradientSample() == pytest.approx(
        np.cos(np.array(result.getStandardSample()) @ [0.3, 0.4, 0.0])[:, None, None]
        * np.array([0.3, 0.4, 0.0])[:, None],
        abs=0.05,
    )


def test_a_step_is_never_longer_than_half_a_standard_deviation():
    assert result_of(noisyFunction(1.0), ot.Normal(3)).getFiniteDifferenceStep() == 0.5
    exact = result_of(ot.SymbolicFunction(["a", "b"], ["sin(a)"]), ot.Normal(2), setGradientMethod="CentralDifference")
    # Without noise the rounding counts.
    assert (3.0 * np.finfo(float).eps) ** (1.0 / 3.0) <= exact.getFiniteDifferenceStep() < 1e-4


@pytest.mark.parametrize("method", ["CentralDifference", "ForwardDifference"])
@pytest.mark.parametrize(("slope", "constant"), [(0.0, True), (0.05, True), (3.0, False)])
def test_gradients_that_noise_alone_could_give_are_none(method, slope, constant):
    """Steps of 0.1 turn noise of 0.02 into gradients of 0.14 or 0.28, whose matrix has eigenvalues of their square."""
    result = result_of(noisyFunction(0.02, slope), ot.Normal(3), setGradientMethod=method, setFiniteDifferenceStep=0.1)
    # A step that is given takes no estimate of the noise: all of it is then taken for slope.
    assert result.getNoise() is None
    assert not result.isConstant()
    result = result_of(noisyFunction(0.02, slope), ot.Normal(3), setGradientMethod=method)
    assert result.isConstant() == constant
    assert result.getDimension() == int(not constant)


def test_dimensions_are_considered_up_to_half_of_the_points_and_ten():
    points = np.random.default_rng(0).standard_normal((100, 20))
    for count, inputs, largest in ((100, 20, 10), (11, 20, 5), (100, 4, 4), (1, 4, 1)):
        algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
            ot.Normal(inputs), points[:count, :inputs], points[:count, :1], points[:count, :inputs]
        )
        algorithm.setBootstrapSize(10)
        algorithm.run()
        assert len(algorithm.getResult().getSubspaceError()) == largest


def test_cross_validation_is_asked_where_three_points_for_each_coefficient_are_there():
    names = [f"x{i}" for i in range(4)]
    function = ot.SymbolicFunction(names, ["x0 + 0.15 * (x1^2 + x2^2 + x3^2) / sqrt(2)"])
    for size, asked in ((18, True), (17, False)):
        choices = result_of(function, ot.Normal(4), setSamplingSize=size).getDimensionChoices()
        # The energy says 4, for whose linear part and a residual 18 points are needed.
        assert (choices["gap"], choices["energy"]) == (1, 4)
        assert ("crossValidation" in choices) == asked


def test_scores_of_all_dimensions_are_the_derivative_based_indices():
    function = ot.SymbolicFunction(["a", "b", "c"], ["exp(0.3 * a) + 0.5 * b^2 + 0.1 * c * a"])
    result = result_of(function, ot.Normal(3), setDimension=1)
    np.testing.assert_allclose(result.getActivityScores(3), result.getDerivativeBasedIndices(), rtol=1e-12)
    assert result.getActivityScoresInterval(0.9, 3) == result.getDerivativeBasedIndicesInterval(0.9)
    assert list(result.getActivityScores()) == list(result.getActivityScores(1))
    assert list(result.getActivityScores(0)) == [0.0, 0.0, 0.0]
    with pytest.raises(ValueError, match="dimensions 0 to 3, got 4"):
        result.getActivityScores(4)
    with pytest.raises(ValueError, match="dimensions 0 to 3, got -1"):
        result.getActivityScores(-1)


def test_bars_stand_at_their_rank_and_names_above_the_whiskers():
    law = ot.Normal(2)
    law.setDescription(["a", "b"])
    result = result_of(ot.SymbolicFunction(["a", "b"], ["exp(0.3 * a) + 2 * b"]), law, setDimension=1)
    graph = result.drawActivityScores(0.9)
    bars = [np.array(d.getData()) for d in graph.getDrawables() if d.getImplementation().getClassName() == "Polygon"]
    for rank, bar in enumerate(bars, 1):
        assert bar[:, 0].min() == pytest.approx(rank - 0.4)
        assert bar[:, 0].max() == pytest.approx(rank + 0.4)
        assert bar[:, 1].min() == 0.0
    whiskers = [np.array(d.getData()) for d in graph.getDrawables() if d.getImplementation().getClassName() == "Curve"]
    interval = result.getActivityScoresInterval(0.9)
    for whisker, index in zip(whiskers, (1, 0), strict=True):
        assert whisker[:, 1] == pytest.approx([interval.getLowerBound()[index], interval.getUpperBound()[index]])
    highest = max(whisker[:, 1].max() for whisker in whiskers)
    for text, whisker, bar in zip(np.array(graph.getDrawables()[-1].getData()), whiskers, bars, strict=True):
        assert text[0] == pytest.approx(whisker[0, 0])
        top = max(whisker[:, 1].max(), bar[:, 1].max())
        assert top < text[1] < top + 0.05 * highest


def test_bands_are_reflected_unless_too_few_replicates_resolve_the_value():
    estimate = np.array([1.0, 1.0])
    # The lower quantile of the second one is below a hundredth of the estimate.
    replicates = np.column_stack([np.linspace(0.02, 2.0, 1001), np.linspace(0.005, 2.0, 1001)])
    lower, upper = reflected_bands(estimate, replicates, 0.999)
    plain = np.quantile(replicates, [0.0005, 0.9995], axis=0)
    assert [lower[0], upper[0]] == pytest.approx([1.0 / plain[1, 0], 1.0 / plain[0, 0]])
    assert [lower[1], upper[1]] == pytest.approx(plain[:, 1].tolist())


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_equal_eigenvalues_are_a_group_in_any_unit_and_those_that_are_rounding_are_none(scale):
    directions = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0]
    slopes = np.random.default_rng(1).normal(size=(200, 4)) * [3.0, 1.0, 1.0, 0.0]
    points = np.random.default_rng(2).normal(size=(200, 4))
    algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
        ot.Normal(4), points, points[:, :1], scale * slopes @ directions
    )
    algorithm.run()
    result = algorithm.getResult()
    assert result.getRepeatedGroups() == [[1, 2]]
    assert 0.0 < result.getEigenvalues()[3] < 1e-25 * result.getEigenvalues()[0]
    assert "1 of 4 are 0" in result.drawEigenvalues().getTitle()


BAD_WEIGHTS = [[1.0, 1.0, math.nan], [1.0, math.inf, 1.0], [1.0, -1.0, 1.0], [0.0, 0.0, 0.0], [1.0, 1.0]]


@pytest.mark.parametrize("weights", BAD_WEIGHTS)
def test_weights_that_are_none_are_refused(weights):
    points = np.eye(3)
    with pytest.raises(ValueError, match="weights must be 3 finite numbers >= 0"):
        ActiveSubspaceAlgorithm.FromGradientSample(ot.Normal(3), points, points[:, :1], points, weights)
    algorithm = ActiveSubspaceAlgorithm(ot.SymbolicFunction(["a"], ["a"]), ot.Normal())
    algorithm.setSamplingSize(3)
    algorithm.setWeightFunction(lambda values: weights)
    with pytest.raises(ValueError, match="one finite number >= 0 for each point"):
        algorithm.run()


def test_subspaces_of_different_dimensions_are_as_far_from_each_other_as_can_be():
    assert subspace_distance(np.eye(3)[:, :1], np.eye(3)[:, :2]) == 1.0
    assert subspace_distance(np.eye(3)[:, :1], np.eye(3)[:, 1:2]) == 1.0
    assert subspace_distance(np.eye(3)[:, :0], np.eye(3)[:, :0]) == 0.0


@pytest.mark.parametrize("method", ["CentralDifference", "ForwardDifference"])
def test_a_single_gradient_by_differences(method):
    law = ot.Normal(2)
    result = result_of(
        ot.SymbolicFunction(["a", "b"], ["3 * a + 4 * b"]), law, setGradientMethod=method, setSamplingSize=1
    )
    np.testing.assert_allclose(result.getGradientSample()[0, :, 0], [3.0, 4.0], rtol=1e-5)
    assert result.getNoise() is not None


def test_what_is_no_callable_or_no_level_is_refused():
    algorithm = ActiveSubspaceAlgorithm(ot.SymbolicFunction(["a"], ["a"]), ot.Normal())
    assert algorithm.getDistribution() == ot.Normal()
    assert algorithm.getGradientMethod() == "Automatic"
    for setter in ("setGradientSampleFunction", "setWeightFunction"):
        with pytest.raises(TypeError, match="is of type float; it must be callable"):
            getattr(algorithm, setter)(1.0)
    algorithm.run()
    for level in (0.0, 1.0, math.nan):
        with pytest.raises(ValueError, match=r"level is .*; it must be in \(0, 1\)"):
            algorithm.getResult().getEigenvaluesInterval(level)


def test_a_constant_has_no_average_direction_and_no_sobol_bound():
    result = result_of(ot.SymbolicFunction(["a", "b"], ["3"]), ot.Normal(2))
    with pytest.raises(ValueError, match="mean gradient is 0"):
        result.getAverageGradient()
    with pytest.raises(ValueError, match="no Sobol indices"):
        result.getTotalSobolBound()
    # Noise has a variance, but nothing that an input could explain.
    with pytest.raises(ValueError, match="no Sobol indices"):
        result_of(noisyFunction(0.02, 0.0), ot.Normal(3)).getTotalSobolBound()


def test_rounding_beside_a_single_direction_is_no_group():
    direction = np.linalg.qr(np.random.default_rng(0).normal(size=(4, 4)))[0][:, 0]
    points = np.random.default_rng(2).normal(size=(60, 4))
    algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
        ot.Normal(4), points, points[:, :1], np.exp(points[:, :1]) * direction
    )
    algorithm.run()
    result = algorithm.getResult()
    assert result.getRepeatedGroups() == []
    assert "3 of 4 are 0" in result.drawEigenvalues().getTitle()


@pytest.mark.parametrize("method", ["CentralDifference", "ForwardDifference"])
def test_differences_of_several_outputs_are_those_of_each(method):
    function = ot.SymbolicFunction(["a", "b"], ["3 * a", "a - 2 * b", "b"])
    result = result_of(function, ot.Normal(2), setGradientMethod=method, setSamplingSize=5)
    expected = [[3.0, 1.0, 0.0], [0.0, -2.0, 1.0]]
    np.testing.assert_allclose(result.getGradientSample(), np.broadcast_to(expected, (5, 2, 3)), atol=1e-6)


def test_gradients_that_are_0_where_the_values_vary_are_remarked():
    """OpenTURNS drops constants of about 1e-11 from the derivatives of a formula."""
    function = ot.SymbolicFunction(["a", "b"], ["exp(a)", "1e-12 * exp(0.3 * a + 0.4 * b)"])
    algorithm = ActiveSubspaceAlgorithm(function, ot.Normal(2))
    algorithm.setSamplingSize(30)
    algorithm.run()
    # By itself it takes differences.
    assert "own gradients of output(s) 1 are 0, though the values vary" in algorithm.getResult().getRemarks()[-1]
    assert algorithm.getResult().getEigenvalues()[1] > 0.1
    algorithm.setGradientMethod("Exact")
    algorithm.run()
    remarks = algorithm.getResult().getRemarks()
    assert any("all gradients of output(s) 1 are 0, though the values vary" in remark for remark in remarks)
    assert algorithm.getResult().getEigenvalues()[1] == 0.0
    algorithm.setGradientMethod("CentralDifference")
    algorithm.run()
    assert not any("though the values vary" in remark for remark in algorithm.getResult().getRemarks())
    assert algorithm.getResult().getEigenvalues()[1] > 0.1


@pytest.mark.parametrize(("rows", "columns"), [(30, 50), (50, 30)])
@pytest.mark.parametrize("spread", [0.0, 3.0, 12.0, 40.0])
@pytest.mark.parametrize("size", [1e-300, 1.0, 1e300])
def test_the_small_side_knows_what_a_singular_value_decomposition_knows(rows, columns, spread, size):
    random = np.random.default_rng(4)
    spectrum = 10.0 ** -np.linspace(0.0, spread, 30)
    left, right = (np.linalg.qr(random.standard_normal((n, 30)))[0] for n in (rows, columns))
    matrix = left * spectrum @ right.T
    singular, vectors = small_side_svd(size * matrix)
    np.testing.assert_allclose(singular / size, np.linalg.svd(matrix)[1][: len(singular)], atol=1e-14)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(len(singular)), atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(matrix @ vectors, axis=0), singular / size, atol=1e-5)


def test_a_matrix_of_zeros_has_no_singular_vectors():
    singular, vectors = small_side_svd(np.zeros((3, 5)))
    assert singular.shape == (0,)
    assert vectors.shape == (5, 0)


def test_a_replicate_of_few_rows_takes_less_than_a_singular_value_decomposition():
    matrix = np.random.default_rng(1).standard_normal((150, 250))
    decompose = singleThread()(lambda: np.linalg.svd(matrix, full_matrices=False))
    assert time_ratio(singleThread()(lambda: small_side_svd(matrix)), decompose) < 0.8


def test_differences_in_many_inputs_come_in_blocks_that_hold_in_the_cache():
    sizes = []

    def linear(points):
        sizes.append(len(points))
        return np.asarray(points, dtype=float).sum(axis=1, keepdims=True)

    result = result_of(ot.PythonFunction(120, 1, func_sample=linear), ot.Normal(120), setSamplingSize=20)
    assert result.getEvaluationNumber() == sum(sizes)
    assert max(sizes) == 4 * 120
    assert result.getDimension() == 1
    np.testing.assert_allclose(np.array(result.getDirections()), np.full((120, 1), 120**-0.5), atol=1e-8)


def test_a_step_is_no_constant_and_has_no_active_variable():
    result = result_of(
        ot.PythonFunction(1, 1, lambda x: [float(x[0] > 0.0)]), ot.Normal(1), setFiniteDifferenceStep=1e-6
    )
    assert not result.isConstant()
    with pytest.raises(ValueError, match="all gradients are 0, though the values vary"):
        result.getTransformation()


def test_names_of_the_outputs_survive(tmp_path):
    function = ot.SymbolicFunction(["a", "b"], ["exp(a)", "a + b^2"])
    function.setOutputDescription(["stress", "gap"])
    result = result_of(function, ot.Normal(2), setDimension=1)
    result.save(tmp_path / "subspace.npz")
    for one in (result, ActiveSubspaceResult.load(tmp_path / "subspace.npz")):
        assert list(one.getOutputSample().getDescription()) == ["stress", "gap"]
        assert list(one.getRegressionResult().getMetaModel().getOutputDescription()) == ["stress", "gap"]
        assert one.drawSufficientSummary(1).getTitle() == "Sufficient summary of gap"


@pytest.mark.parametrize(
    ("formula", "heavy"),
    [("a^2", False), ("exp(0.4 * a)", False), ("exp(a)", True), ("a^5", True), ("a + 100 * max(a - 2, 0)", True)],
)
def test_few_long_gradients_leave_no_upper_bound(formula, heavy):
    function = ot.SymbolicFunction(["a", "b"], [f"{formula} + 0.001 * b"])
    result = result_of(function, ot.Normal(2), setSamplingSize=100, setDimension=1)
    assert result.hasHeavyTail() == heavy
    assert (result.getEffectiveGradientNumber() < 20.0) == heavy
    assert any("heavy tail" in remark for remark in result.getRemarks()) == heavy
    for interval in (
        result.getEigenvaluesInterval(),
        result.getActivityScoresInterval(),
        result.getDerivativeBasedIndicesInterval(),
        result.getErrorBoundInterval(),
    ):
        assert list(interval.getFiniteUpperBound()) == [not heavy] * interval.getDimension()
        assert np.isinf(np.array(interval.getUpperBound())).all() == heavy
        assert np.isfinite(np.array(interval.getLowerBound())).all()
    for graph in (result.drawEigenvalues(), result.drawActivityScores()):
        assert np.isfinite(np.array(graph.getBoundingBox().getUpperBound())).all()


def test_the_effective_number_of_gradients_is_that_of_the_weights_too():
    points = np.random.default_rng(0).standard_normal((40, 2))
    gradients = np.ones((40, 2))
    search = ActiveSubspaceAlgorithm.FromGradientSample(
        ot.Normal(2), points, points[:, :1], gradients, np.r_[np.ones(4), np.zeros(36)]
    )
    search.run()
    assert search.getResult().getEffectiveGradientNumber() == pytest.approx(4.0)
    assert not search.getResult().hasHeavyTail()


def test_gradients_of_physical_runs_are_those_of_the_transformed_ones():
    law = ot.JointDistribution(
        [ot.LogNormal(0.0, 0.3), ot.Normal(1.0, 2.0)], ot.NormalCopula(ot.CorrelationMatrix([[1.0, 0.5], [0.5, 1.0]]))
    )
    function = ot.SymbolicFunction(["a", "b"], ["a^2 * b"])
    inputs = np.array(law.getSample(30))
    gradients = np.stack([np.array(function.gradient(x)) for x in inputs])
    search = ActiveSubspaceAlgorithm.FromPhysicalGradientSample(law, inputs, function(inputs), gradients)
    search.setBootstrapSize(20)
    search.run()
    result = search.getResult()
    space = result.getStandardSpace()
    points = np.array(result.getStandardSample())
    np.testing.assert_allclose(space.toPhysical(points), inputs, rtol=1e-9)
    for i in range(2):
        step = 1e-5 * np.eye(2)[i]
        slope = (
            np.array(function(space.toPhysical(points + step))) - np.array(function(space.toPhysical(points - step)))
        ) / 2e-5
        np.testing.assert_allclose(result.getGradientSample()[:, i], slope, rtol=1e-5, atol=1e-6)
    assert list(result.getOutputSample().getDescription()) == ["y0"]
    with pytest.raises(ValueError, match=r"Row 1 of the inputs is outside the range"):
        ActiveSubspaceAlgorithm.FromPhysicalGradientSample(
            law, [[1.0, 1.0], [-1.0, 1.0]], [[1.0], [1.0]], np.ones((2, 2))
        )
    with pytest.raises(ValueError, match=r"inputs have shape .*; it must be \(n, 2\)"):
        ActiveSubspaceAlgorithm.FromPhysicalGradientSample(law, [[1.0]], [[1.0]], np.ones((1, 1)))
    with pytest.raises(ValueError, match=r"gradients have shape \(2, 2, 1\)"):
        ActiveSubspaceAlgorithm.FromPhysicalGradientSample(law, [[1.0, 1.0]], [[1.0]], np.ones((2, 2)))


def test_dimensions_are_compared_before_the_transformation_is_made(monkeypatch):
    monkeypatch.setattr("satsep_ot.methods.subspaces.algorithm.StandardSpace", lambda distribution: 1 / 0)
    with pytest.raises(ValueError, match="The function has 1 inputs but the distribution has dimension 2"):
        ActiveSubspaceAlgorithm(ot.SymbolicFunction("x", "x"), ot.Normal(2))


@pytest.mark.parametrize(
    ("inputs", "replicates"), [(1, 1000), (50, 1000), (51, 980), (100, 500), (500, 100), (800, 100)]
)
def test_many_inputs_have_fewer_replicates_by_default(inputs, replicates):
    function = ot.SymbolicFunction([f"x{i}" for i in range(inputs)], ["x0"])
    assert ActiveSubspaceAlgorithm(function, ot.Normal(inputs)).getBootstrapSize() == replicates
