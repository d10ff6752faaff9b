"""Ridge approximation on functions whose directions are known."""

import functools
import pickle

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.polynomials.fit import fit_polynomial
from satsep_ot.methods.polynomials.regression import MultivariatePolynomialRegression
from satsep_ot.methods.subspaces import ridge_approximation, variable_projection
from satsep_ot.methods.subspaces.estimation import orient, subspace_distance
from satsep_ot.methods.subspaces.ridge_approximation import RidgeApproximation, RidgeApproximationResult
from satsep_ot.methods.subspaces.variable_projection import _VariableProjection, cross_validate_ridge, fit_ridge


@pytest.fixture
def random():
    ot.RandomGenerator.SetSeed(4)
    return np.random.default_rng(4)


def directions_in(random, d, r):
    return np.linalg.qr(random.standard_normal((d, r)))[0]


@pytest.mark.parametrize(
    ("d", "size", "degree", "r", "profile"),
    [
        (20, 200, 4, 1, lambda y: y[:, 0] ** 4 - y[:, 0]),
        (30, 200, 2, 1, lambda y: y[:, 0] ** 2),
        (15, 300, 3, 1, lambda y: y[:, 0] ** 3 - 3.0 * y[:, 0]),
        (20, 400, 4, 2, lambda y: y[:, 0] * y[:, 1] ** 2 + y[:, 1]),
        (20, 400, 4, 3, lambda y: y[:, 0] * y[:, 1] + y[:, 2] ** 3),
        (60, 80, 2, 1, lambda y: y[:, 0] + 0.1 * y[:, 0] ** 2),
    ],
)
def test_polynomial_ridge_is_recovered_exactly(random, d, size, degree, r, profile):
    w = directions_in(random, d, r)
    points = random.standard_normal((size, d))
    fit = fit_ridge(points, profile(points @ w), r, degree)
    assert fit.converged
    assert subspace_distance(fit.directions, w) < 1e-8
    fresh = random.standard_normal((50, d))
    np.testing.assert_allclose(fit.predict(fresh), profile(fresh @ w), rtol=1e-6, atol=1e-6)
    assert fit.loss < 1e-16


def test_noisy_ridge_in_25_inputs_from_260_runs(random):
    w = directions_in(random, 25, 2)
    points = random.standard_normal((260, 25))
    y = points @ w
    values = y[:, 0] + y[:, 1] ** 2 + 0.3 * y[:, 0] * y[:, 1]
    values += 0.1 * values.std() * random.standard_normal(260)
    fit = fit_ridge(points, values, 2)
    assert subspace_distance(fit.directions, w) < 0.1


def test_outputs_share_their_directions_whatever_their_units(random):
    w = directions_in(random, 12, 2)
    points = random.standard_normal((200, 12))
    y = points @ w
    values = np.column_stack([1e6 * y[:, 0], 1e-6 * (y[:, 1] ** 2 + y[:, 1]), np.full(200, 3.0)])
    fit = fit_ridge(points, values, 2, 2)
    assert subspace_distance(fit.directions, w) < 1e-7
    np.testing.assert_allclose(fit.predict(points), values, rtol=1e-6, atol=1e-9)


def test_gauss_newton_matrix_is_the_one_of_differences(random):
    points = random.standard_normal((60, 5))
    values = np.sin(points[:, :2].sum(axis=1) + points[:, 2] ** 2)[:, None]
    weights = random.uniform(0.5, 2.0, 60)
    problem = _VariableProjection(points, values, 2, 3, weights)
    w = directions_in(random, 5, 2)
    loss, state = problem.loss(w)
    complement, gradient, matrix = problem.linearise(w, state)

    def residual(parameters):
        move = complement @ parameters.reshape(2, -1).T
        trial = np.linalg.qr(w + move)[0]
        return problem.loss(trial)[1][4][:, 0]

    size = len(gradient)
    step = 1e-6
    jacobian = np.column_stack([(residual(step * e) - residual(-step * e)) / (2.0 * step) for e in np.eye(size)])
    np.testing.assert_allclose(gradient, jacobian.T @ state[4][:, 0], atol=1e-6 * np.abs(gradient).max())
    np.testing.assert_allclose(matrix, jacobian.T @ jacobian, atol=1e-6 * np.abs(matrix).max())
    assert loss == pytest.approx((state[4] ** 2).sum())


def test_weights_pick_the_region_that_is_fitted(random):
    points = random.standard_normal((600, 6))
    # Two ridges: along the first axis where it is negative, along the second elsewhere.
    left = points[:, 0] < 0.0
    values = np.where(left, 2.0 * points[:, 0], 3.0 * points[:, 1])
    axis = np.eye(6)
    assert subspace_distance(fit_ridge(points, values, 1, 1, left.astype(float)).directions, axis[:, :1]) < 1e-6
    assert subspace_distance(fit_ridge(points, values, 1, 1, (~left).astype(float)).directions, axis[:, 1:2]) < 1e-6


def test_gradient_of_the_fit(random):
    points = random.standard_normal((150, 4))
    fit = fit_ridge(points, np.exp(0.3 * points[:, 0] - 0.2 * points[:, 3]), 1)
    step = 1e-6
    ahead, behind = (np.array([fit.predict(points[:5] + s * step * e) for e in np.eye(4)]) for s in (1.0, -1.0))
    np.testing.assert_allclose(fit.predict_gradient(points[:5]), ((ahead - behind) / (2.0 * step)).T, atol=1e-7)


def test_constant_and_dimension_zero(random):
    points = random.standard_normal((30, 3))
    assert fit_ridge(points, np.full(30, 2.0), 1).predict(points) == pytest.approx(np.full(30, 2.0))
    fit = fit_ridge(points, points[:, 0], 0)
    assert fit.directions.shape == (3, 0)
    assert fit.predict(points) == pytest.approx(np.full(30, points[:, 0].mean()))
    assert fit.loss == pytest.approx(1.0)


def test_one_input():
    points = np.linspace(-2.0, 2.0, 30)[:, None]
    fit = fit_ridge(points, points[:, 0] ** 3, 1)
    assert fit.directions.tolist() == [[1.0]]
    assert fit.loss < 1e-20


def test_cross_validation_refits_the_directions(random):
    # Pure noise in many inputs: directions frozen from all the data seem to predict it.
    points = random.standard_normal((60, 40))
    noise = random.standard_normal(60)
    fit = fit_ridge(points, noise, 1, 1)
    frozen = np.empty(60)
    for block in np.array_split(np.arange(60), 5):
        kept = np.setdiff1d(np.arange(60), block)
        active = points @ fit.directions
        refit = fit_polynomial(fit.polynomial.basis, active[kept], noise[kept])
        frozen[block] = noise[block] - refit.predict(active[block])
    nested = cross_validate_ridge(points, noise, 1, 1)
    assert 1.0 - (frozen**2).mean() / noise.var() > 0.3
    assert 1.0 - (nested**2).mean() / noise.var() < 0.0


def test_helpers():
    w = np.eye(4)[:, :2]
    assert subspace_distance(w, w) == 0.0
    assert subspace_distance(w, w @ np.array([[0.6, -0.8], [0.8, 0.6]])) < 1e-15
    assert subspace_distance(w, np.eye(4)[:, 2:]) == pytest.approx(1.0)
    assert subspace_distance(w, np.eye(4)[:, :1]) == 1.0
    assert orient(-w).tolist() == w.tolist()


def test_bad_data_is_refused(random):
    points = random.standard_normal((20, 3))
    with pytest.raises(ValueError, match="is 4; it must be 0 to 3"):
        fit_ridge(points, points[:, 0], 4)
    with pytest.raises(ValueError, match="35 polynomial terms needs at least 35 points, got 20"):
        fit_ridge(points, points[:, 0], 3)
    with pytest.raises(ValueError, match="finite"):
        fit_ridge(points, np.full(20, np.nan), 1)
    with pytest.raises(ValueError, match="20 finite numbers"):
        fit_ridge(points, points[:, 0], 1, weights=-np.ones(20))
    with pytest.raises(ValueError, match="needs at least 5 points, got 3"):
        fit_ridge(points, points[:, 0], 1, weights=np.r_[np.ones(3), np.zeros(17)])
    with pytest.raises(ValueError, match=r"shape \(2, 2\); it must be \(3, 1\)"):
        fit_ridge(points, points[:, 0], 1, initial=np.eye(2))


class TestRidgeApproximation:
    distribution = ot.JointDistribution(
        [ot.Uniform(0.0, 1.0), ot.Gumbel(1.0, 2.0), ot.LogNormal(0.0, 0.2), ot.Normal(5.0, 3.0)], ot.NormalCopula(4)
    )
    direction = np.array([[0.1], [0.7], [-0.1], [0.7]])

    def sample(self, size):
        space = ot.Normal(4).getSample(size)
        inputs = self.distribution.getInverseIsoProbabilisticTransformation()(space)
        y = np.array(space) @ self.direction
        return inputs, y**2 + y

    def test_chooses_and_exports(self):
        ot.RandomGenerator.SetSeed(9)
        inputs, outputs = self.sample(150)
        algorithm = RidgeApproximation(inputs, outputs, self.distribution)
        algorithm.run()
        result = algorithm.getResult()
        assert (result.getDimension(), result.getDegree()) == (1, 2)
        assert result.getConverged()
        assert result.getRemarks() == []
        assert subspace_distance(np.array(result.getDirections()), self.direction) < 1e-7
        assert result.getQ2() == pytest.approx(1.0, abs=1e-9)
        fresh, truth = self.sample(50)
        metaModel = pickle.loads(pickle.dumps(result.getMetaModel()))
        np.testing.assert_allclose(np.array(metaModel(fresh)), truth, atol=1e-7)
        y = np.array(result.getTransformation()(inputs))
        np.testing.assert_allclose(y, np.array(result.getActiveSample()), atol=1e-12)
        back = result.getTransformation()(result.getInverseTransformation()(y))
        np.testing.assert_allclose(np.array(back), y, atol=1e-8)
        assert isinstance(result.getMetaModelResult(), ot.MetaModelResult)
        assert isinstance(result.drawSufficientSummary(), ot.Graph)
        assert result.getRegressionResult().getQ2LeaveOneOut()[0] > 0.999999

    def test_noise_alone_has_no_direction(self):
        ot.RandomGenerator.SetSeed(2)
        inputs, _ = self.sample(60)
        outputs = ot.Normal().getSample(60)
        algorithm = RidgeApproximation(inputs, outputs, self.distribution)
        algorithm.run()
        result = algorithm.getResult()
        assert result.getDimension() == 0
        assert result.getMetaModel()(inputs[0])[0] == pytest.approx(outputs.computeMean()[0])
        with pytest.raises(ValueError, match="no active variable"):
            result.getTransformation()

    def test_few_points_are_remarked(self):
        ot.RandomGenerator.SetSeed(2)
        inputs, outputs = self.sample(20)
        algorithm = RidgeApproximation(inputs, outputs, self.distribution)
        algorithm.setDimension(2)
        algorithm.setDegree(2)
        algorithm.run()
        assert "20 points for 14 unknowns: 42 are recommended" in algorithm.getResult().getRemarks()[0]

    def test_points_of_weight_zero_take_no_part(self):
        ot.RandomGenerator.SetSeed(6)
        inputs, outputs = self.sample(120)
        outputs = np.array(outputs)
        outputs[100:] = 1e3
        algorithm = RidgeApproximation(inputs, outputs, self.distribution)
        algorithm.setDegree(2)
        algorithm.setWeights(np.r_[np.ones(100), np.zeros(20)])
        algorithm.run()
        result = algorithm.getResult()
        assert result.getDimension() == 1
        assert subspace_distance(np.array(result.getDirections()), self.direction) < 1e-7
        assert result.getQ2() == pytest.approx(1.0, abs=1e-9)
        for weights in (np.zeros(120), -np.ones(120), np.ones(7)):
            with pytest.raises(ValueError, match="120 finite numbers >= 0, at least one"):
                algorithm.setWeights(weights)

    def twoDirections(self, size):
        ot.RandomGenerator.SetSeed(3)
        inputs = ot.Normal(4).getSample(size)
        return inputs, ot.SymbolicFunction(["a", "b", "c", "e"], ["a * b + 0.5 * (a + c)"])(inputs)

    def test_largest_dimension_bounds_the_choice(self):
        algorithm = RidgeApproximation(*self.twoDirections(120), ot.Normal(4))
        algorithm.setDegree(2)
        algorithm.setStartsNumber(0)
        for largest, tried in ((1, [0, 1]), (4, [0, 1, 2, 3, 4])):
            algorithm.setLargestDimension(largest)
            algorithm.run()
            result = algorithm.getResult()
            assert sorted(r for r, _ in result.getQ2ByDimensionAndDegree()) == tried
            assert result.getDimension() <= largest
        # a b and a + c need three directions: (1, 1, 0), (1, -1, 0) and c.
        assert result.getDimension() == 3
        assert result.getQ2() == pytest.approx(1.0, abs=1e-9)
        for wrong in (-1, 5):
            with pytest.raises(ValueError, match=f"largest dimension is {wrong}; it must be 0 to 4"):
                algorithm.setLargestDimension(wrong)

    def resultWithSeed(self, seed, folds, starts, size=60):
        algorithm = RidgeApproximation(*self.twoDirections(size), ot.Normal(4))
        algorithm.setDimension(1)
        algorithm.setDegree(3)
        algorithm.setFoldsNumber(folds)
        algorithm.setStartsNumber(starts)
        ot.RandomGenerator.SetSeed(seed)
        algorithm.run()
        return algorithm.getResult(), ot.RandomGenerator.Generate()

    def test_as_many_folds_as_points_leave_nothing_to_chance(self):
        alone = [self.resultWithSeed(seed, 30, 0, 30)[0].getQ2() for seed in (1, 2)]
        halves = [self.resultWithSeed(seed, 2, 0, 30)[0].getQ2() for seed in (1, 2)]
        assert alone[0] == pytest.approx(alone[1], rel=1e-9)
        assert abs(halves[0] - halves[1]) > 1e-3
        algorithm = RidgeApproximation(*self.twoDirections(60), ot.Normal(4))
        for wrong in (1, 61):
            with pytest.raises(ValueError, match=f"number of folds is {wrong}; it must be 2 to 60"):
                algorithm.setFoldsNumber(wrong)

    def test_random_starts_are_drawn_as_asked_and_never_make_the_fit_worse(self):
        none, following = self.resultWithSeed(1, 5, 0)
        again, same = self.resultWithSeed(1, 5, 0)
        assert following == same
        assert np.array_equal(np.array(none.getDirections()), np.array(again.getDirections()))
        many, other = self.resultWithSeed(1, 5, 6)
        # The random subspaces come from OpenTURNS' generator, which has moved on by them.
        assert other != following
        assert many.getRelativeError() <= none.getRelativeError() + 1e-9
        algorithm = RidgeApproximation(*self.twoDirections(60), ot.Normal(4))
        with pytest.raises(ValueError, match="random starts is -1; it must be at least 0"):
            algorithm.setStartsNumber(-1)

    def test_bad_input_is_refused(self):
        inputs, outputs = self.sample(20)
        with pytest.raises(ValueError, match="shapes"):
            RidgeApproximation(inputs, outputs[:5], self.distribution)
        outside = np.array(inputs)
        outside[3, 2] = -1.0
        with pytest.raises(ValueError, match="Row 3 of the inputs"):
            RidgeApproximation(outside, outputs, self.distribution)
        outputs[4] = np.nan
        with pytest.raises(ValueError, match="first is row 4"):
            RidgeApproximation(inputs, outputs, self.distribution)


def test_fewer_points_than_unknowns_end_without_warning(random):
    points = random.standard_normal((40, 50))
    fit = fit_ridge(points, np.sin(points[:, 0]) + points[:, 1], 2, 3)
    assert np.isfinite(fit.predict(points)).all()
    assert fit.directions.shape == (50, 2)
    np.testing.assert_allclose(fit.directions.T @ fit.directions, np.eye(2), atol=1e-12)


def test_what_is_out_of_range_is_refused(random):
    points = random.standard_normal((40, 3))
    approximation = RidgeApproximation(points, points[:, :1], ot.Normal(3))
    for setter, value, message in (
        ("Dimension", 4, "dimension is 4; it must be 0 to 3"),
        ("Dimension", -1, "dimension is -1; it must be 0 to 3"),
        ("LargestDimension", 4, "largest dimension is 4; it must be 0 to 3"),
        ("Degree", 0, "degree is 0; it must be 1 to 10"),
        ("Degree", 11, "degree is 11; it must be 1 to 10"),
        ("FoldsNumber", 1, "folds is 1; it must be 2 to 40"),
    ):
        with pytest.raises(ValueError, match=message):
            getattr(approximation, f"set{setter}")(value)
    with pytest.raises(RuntimeError, match=r"call run\(\) first"):
        approximation.getResult()
    with pytest.raises(ValueError, match=r"points have shape \(40,\); it must be \(n, d\)"):
        fit_ridge(points[:, 0], points[:, 0], 1)
    with pytest.raises(ValueError, match=r"values have shape \(39,\); it must be \(40,\) or \(40, p\)"):
        fit_ridge(points, points[:39, 0], 1)


def test_directions_that_have_not_converged_are_remarked(random, monkeypatch):
    points = random.standard_normal((60, 6))
    values = np.sin(points @ np.ones(6))[:, None] + random.standard_normal((60, 1))
    approximation = RidgeApproximation(points, values, ot.Normal(6))
    approximation.setDimension(2)
    approximation.setDegree(3)
    monkeypatch.setattr(ridge_approximation, "fit_ridge", functools.partial(ridge_approximation.fit_ridge, steps=1))
    approximation.run()
    assert any("had not converged after" in remark for remark in approximation.getResult().getRemarks())


def test_a_matrix_that_is_not_definite_gets_more_damping(random, monkeypatch):
    points = random.standard_normal((100, 6))
    values = np.exp(0.5 * points[:, 0])
    expected = fit_ridge(points, values, 1)
    original, calls = variable_projection.linalg.cho_factor, []

    def reluctant(matrix, **options):
        calls.append(matrix.diagonal().mean())
        if len(calls) < 3:
            raise np.linalg.LinAlgError("not positive definite")
        return original(matrix, **options)

    monkeypatch.setattr(variable_projection.linalg, "cho_factor", reluctant)
    fit = fit_ridge(points, values, 1)
    assert calls[0] < calls[1] < calls[2]
    assert fit.converged
    assert subspace_distance(fit.directions, expected.directions) < 1e-6


def test_a_start_that_no_point_lies_beside_is_kept():
    points = np.column_stack([np.linspace(-2.0, 2.0, 9), np.zeros(9)])
    fit = fit_ridge(points, points[:, 0] ** 2, 1, 2, initial=np.array([[1.0], [0.0]]))
    assert fit.converged
    np.testing.assert_array_equal(np.abs(fit.directions), [[1.0], [0.0]])
    assert fit.loss < 1e-28


def test_an_output_that_is_not_there_is_not_drawn(random):
    points = random.standard_normal((40, 3))
    approximation = RidgeApproximation(points, points[:, :1], ot.Normal(3))
    approximation.setDimension(1)
    approximation.setDegree(1)
    approximation.run()
    for output in (-1, 1):
        with pytest.raises(ValueError, match=f"output is {output}; it must be 0 to 0"):
            approximation.getResult().drawSufficientSummary(output)


@pytest.mark.parametrize("scale", [1e-300, 1e300])
def test_ridges_and_regressions_do_not_depend_on_the_size_of_the_output(random, scale):
    inputs = random.standard_normal((100, 3))
    outputs = np.exp(0.2 * inputs.sum(axis=1))[:, None]
    algorithm = RidgeApproximation(inputs, scale * outputs, ot.Normal(3))
    algorithm.run()
    result = algorithm.getResult()
    assert result.getDimension() == 1
    np.testing.assert_allclose(np.array(result.getDirections())[:, 0], 3**-0.5, atol=1e-3)
    assert result.getQ2() > 0.999
    regression = MultivariatePolynomialRegression(inputs, scale * outputs, ot.Normal(3))
    regression.selectDegree()
    regression.run()
    other = MultivariatePolynomialRegression(inputs, outputs, ot.Normal(3))
    other.setDegree(regression.getDegree())
    other.run()
    assert regression.getResult().getQ2LeaveOneOut()[0] == pytest.approx(other.getResult().getQ2LeaveOneOut()[0])
    assert regression.getResult().getSobolTotalIndex(0) == pytest.approx(other.getResult().getSobolTotalIndex(0))
    for scaled, plain in zip(
        regression.getResult().getPredictionInterval(inputs),
        other.getResult().getPredictionInterval(inputs),
        strict=True,
    ):
        np.testing.assert_allclose(scaled / scale, plain, rtol=1e-9)


@pytest.mark.parametrize("dimension", [0, 1])
def test_names_of_inputs_and_outputs_survive(tmp_path, dimension):
    law = ot.JointDistribution([ot.Uniform(0.0, 1.0), ot.Normal()])
    law.setDescription(["length", "force"])
    function = ot.SymbolicFunction(["a", "b"], ["a + b", "exp(a + b)"])
    function.setOutputDescription(["stress", "gap"])
    inputs = law.getSample(60)
    algorithm = RidgeApproximation(inputs, function(inputs), law)
    algorithm.setDimension(dimension)
    algorithm.run()
    algorithm.getResult().save(tmp_path / "ridge.npz")
    for result in (algorithm.getResult(), RidgeApproximationResult.load(tmp_path / "ridge.npz")):
        metaModel = result.getMetaModelResult()
        for function_ in (result.getMetaModel(), metaModel.getMetaModel()):
            assert list(function_.getInputDescription()) == ["length", "force"]
            assert list(function_.getOutputDescription()) == ["stress", "gap"]
        assert list(metaModel.getInputSample().getDescription()) == ["length", "force"]
        assert list(metaModel.getOutputSample().getDescription()) == ["stress", "gap"]
    if dimension:
        assert algorithm.getResult().drawSufficientSummary(1).getTitle() == "Sufficient summary of gap"
