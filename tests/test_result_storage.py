"""Results of regression, ridges and subspaces in a file: everything that they answer comes back to the last bit."""

import inspect

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.common.storage import readResult, writeResult
from satsep_ot.methods.polynomials.regression import (
    MultivariatePolynomialRegression,
    MultivariatePolynomialRegressionResult,
)
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.subspaces.algorithm import ActiveSubspaceAlgorithm
from satsep_ot.methods.subspaces.result import ActiveSubspaceResult
from satsep_ot.methods.subspaces.ridge_approximation import RidgeApproximation, RidgeApproximationResult

CORRELATION = ot.CorrelationMatrix(3, [1.0, 0.4, 0.0, 0.4, 1.0, 0.0, 0.0, 0.0, 1.0])
LAWS = {
    "normal": ot.Normal([1.0, -2.0, 0.1], [2.0, 0.3, 1.0], ot.CorrelationMatrix(3)),
    "classic": ot.JointDistribution([ot.Uniform(1.0, 3.0), ot.Beta(2.0, 3.0, 0.0, 4.0), ot.Gamma(2.0, 3.0, 1.0)]),
    "other": ot.JointDistribution([ot.Gumbel(2.0, 1.0 / 3.0), ot.LogNormal(0.0, 0.2, 1.0), ot.Normal(10.0, 0.1)]),
}
FUNCTION = ot.SymbolicFunction(["a", "b", "c"], ["1 + a * b + 0.1 * c^2 * a", "sin(b) - a * c"])
ONE = ot.SymbolicFunction(["a", "b", "c"], ["exp(0.3 * a + 0.1 * b) + 0.01 * c"])


@pytest.fixture(autouse=True)
def seed():
    ot.RandomGenerator.SetSeed(5)


def bits(thing, law):
    """The numbers of an answer, for comparison to the last bit."""
    if isinstance(thing, MultivariatePolynomialRegressionResult):
        return answers(thing, thing.getDistribution())
    if isinstance(thing, ot.Interval):
        return np.array(thing.getLowerBound()).tobytes() + np.array(thing.getUpperBound()).tobytes()
    if isinstance(thing, ot.Function):
        sample = fresh(law if thing.getInputDimension() == law.getDimension() else ot.Normal(thing.getInputDimension()))
        return np.array(thing(sample)).tobytes() + repr(thing.getInputDescription()).encode()
    if isinstance(thing, (ot.Point, ot.Sample, ot.Matrix, np.ndarray)):
        return np.array(thing).tobytes()
    if isinstance(thing, ot.Graph):
        return [np.array(drawable.getData()).tobytes() for drawable in thing.getDrawables()]
    if isinstance(thing, ot.MetaModelResult):
        return bits(thing.getMetaModel(), law)
    if isinstance(thing, float):
        return float(thing).hex()
    # Distributions have a repr with six digits.
    if hasattr(thing, "getParameter"):
        return np.array(thing.getParameter()).tobytes()
    return repr(thing)


def fresh(law):
    ot.RandomGenerator.SetSeed(6)
    return law.getSample(40)


def answers(result, law):
    """What every method without required arguments says, or its refusal; and what is said at fresh points."""
    found = {"repr": repr(result)}
    for name, method in inspect.getmembers(result, callable):
        if name.startswith(("get", "is", "compute", "draw")):
            required = [
                entry
                for entry in inspect.signature(method).parameters.values()
                if entry.default is entry.empty and entry.name != "noise"
            ]
            arguments = [np.array(fresh(law)) if entry.name == "points" else 7 for entry in required]
            if [entry.name for entry in required] not in ([], ["points"], ["size"]):
                continue
            ot.RandomGenerator.SetSeed(7)
            try:
                value = method(*arguments)
            except ValueError as error:
                value = str(error)
            parts = value if isinstance(value, (tuple, list)) else [value]
            found[name] = [bits(part, law) for part in parts]
    return found


def assertSame(result, path, law):
    result.save(path)
    before = ot.RandomGenerator.GetState()
    again = type(result).load(path)
    assert ot.RandomGenerator.GetState() == before
    first, second = answers(result, law), answers(again, law)
    assert len(first) > 15
    assert [name for name in first if first[name] != second[name]] == []
    # A loaded one can be saved again.
    again.save(path)
    third = answers(type(result).load(path), law)
    assert [name for name in first if first[name] != third[name]] == []
    return again


@pytest.mark.parametrize("name", sorted(LAWS))
@pytest.mark.parametrize(("size", "weighted"), [(60, True), (400, False)])
def test_a_regression_comes_back_to_the_last_bit(name, size, weighted, tmp_path):
    law = LAWS[name]
    inputs = law.getSample(size)
    outputs = FUNCTION(inputs) + ot.Normal(2).getSample(size)
    regression = MultivariatePolynomialRegression(inputs, outputs, law)
    regression.setDegree(3)
    regression.setHyperbolicNorm(0.8)
    if weighted:
        regression.setWeights(np.linspace(0.1, 1.0, size))
    regression.run()
    assertSame(regression.getResult(), tmp_path / "regression.npz", law)


def test_a_regression_whose_law_was_estimated_on_transposed_arrays(tmp_path):
    points = np.array(ot.Normal(2).getSample(50)).T.copy().T
    regression = MultivariatePolynomialRegression(points, np.exp(points[:, :1]))
    regression.setRobust(True)
    regression.run()
    again = assertSame(regression.getResult(), str(tmp_path / "regression.npz"), ot.Normal(2))
    assert again.getMetaModel().getInputDescription() == ["x0", "x1"]


@pytest.mark.parametrize("name", sorted(LAWS))
def test_a_subspace_comes_back_to_the_last_bit(name, tmp_path):
    algorithm = ActiveSubspaceAlgorithm(FUNCTION, LAWS[name])
    algorithm.setSamplingSize(50)
    algorithm.setGradientMethod("CentralDifference")
    algorithm.setDimension(2)
    algorithm.run()
    assertSame(algorithm.getResult(), tmp_path / "subspace.npz", LAWS[name])


def test_a_subspace_with_weights_remarks_and_a_copula(tmp_path):
    law = ot.JointDistribution([ot.Uniform(0.0, 2.0), ot.Gumbel(1.0, 2.0), ot.Normal()], ot.NormalCopula(CORRELATION))
    law.setDescription(["a", "b", "c"])
    algorithm = ActiveSubspaceAlgorithm(ONE, law)
    algorithm.setSamplingSize(3)
    algorithm.setWeightFunction(lambda y: 1.0 + y[:, 0] ** 2)
    algorithm.setTargetSubspaceError(1e-9, 12)
    algorithm.run()
    result = algorithm.getResult()
    assert result.getRemarks()
    again = assertSame(result, tmp_path / "subspace.npz", law)
    assert list(again.getStandardSpace().getDistribution().getDescription()) == ["a", "b", "c"]


def test_gradients_of_ones_own_in_another_order_of_memory(tmp_path):
    points = np.array(ot.Normal(3).getSample(200))
    gradients = np.array([np.array(FUNCTION.gradient(u)).T for u in points]).transpose(0, 2, 1)
    assert not gradients.flags.c_contiguous
    algorithm = ActiveSubspaceAlgorithm.FromGradientSample(
        ot.Normal(3), points, np.array(FUNCTION(points)), gradients, np.linspace(0.0, 1.0, 200)
    )
    algorithm.run()
    assertSame(algorithm.getResult(), tmp_path / "subspace.npz", ot.Normal(3))


@pytest.mark.parametrize("dimension", [None, 0, 2])
def test_a_ridge_comes_back_to_the_last_bit(dimension, tmp_path):
    law = LAWS["classic"]
    inputs = law.getSample(80)
    algorithm = RidgeApproximation(inputs, FUNCTION(inputs), law)
    algorithm.setDimension(dimension)
    algorithm.setDegree(2)
    algorithm.setWeights(np.linspace(0.0, 1.0, 80))
    algorithm.run()
    again = assertSame(algorithm.getResult(), tmp_path / "ridge.npz", law)
    assert again.getQ2ByDimensionAndDegree() == algorithm.getResult().getQ2ByDimensionAndDegree()
    assert all(type(number) is int for pair in again.getQ2ByDimensionAndDegree() for number in pair)


def test_a_file_of_another_kind_is_refused_by_name(tmp_path):
    path = tmp_path / "regression.npz"
    inputs = ot.Normal(2).getSample(50)
    regression = MultivariatePolynomialRegression(inputs, inputs)
    regression.run()
    regression.getResult().save(path)
    for kind in (ActiveSubspaceResult, ActiveSubspaceReliabilityResult, RidgeApproximationResult):
        with pytest.raises(ValueError, match=rf"regression\.npz holds no {kind.__name__} of this version"):
            kind.load(path)
    path.write_text("nothing", encoding="utf-8")
    with pytest.raises(ValueError, match="holds no MultivariatePolynomialRegressionResult"):
        MultivariatePolynomialRegressionResult.load(path)
    np.savez(path, document=np.array("[]"))
    with pytest.raises(ValueError, match="holds no MultivariatePolynomialRegressionResult"):
        MultivariatePolynomialRegressionResult.load(path)
    with pytest.raises(ValueError, match=r"result\.xml; its name must end on \.npz"):
        regression.getResult().save(tmp_path / "result.xml")
    with pytest.raises(FileNotFoundError):
        MultivariatePolynomialRegressionResult.load(tmp_path / "nowhere.npz")


class Box(ot.PythonDistribution):
    """Uniform on the unit square, in Python."""

    def __init__(self):
        super().__init__(2)

    def getRange(self):
        return ot.Interval(2)

    def computeCDF(self, X):
        return float(np.prod(np.clip(X, 0.0, 1.0)))


def test_python_in_a_result_is_refused_before_anything_is_written(tmp_path):
    path = tmp_path / "result.npz"
    with pytest.raises(ValueError, match="the distribution is made of Python code, which is not stored"):
        writeResult(path, "Test 1", {"distribution": ot.Distribution(Box())})
    assert list(tmp_path.iterdir()) == []


def test_numbers_of_numpy_and_arrays_keep_their_order_of_memory(tmp_path):
    path = tmp_path / "result.npz"
    fields = {"count": np.int64(3), "share": np.float64(0.1), "flag": np.bool_(True), "none": None, "list": [1, "a"]}
    writeResult(path, "Test 1", fields | {"matrix": np.asfortranarray(np.arange(6.0).reshape(2, 3))})
    loaded = readResult(path, "Test 1")
    matrix = loaded.pop("matrix")
    assert loaded == {"count": 3, "share": 0.1, "flag": True, "none": None, "list": [1, "a"]}
    assert matrix.flags.f_contiguous
    np.testing.assert_array_equal(matrix, np.arange(6.0).reshape(2, 3))
