"""The separation as an OpenTURNS function: values, names, batches, exact gradients, failures, copies."""

import copy
import pickle

import numpy as np
import openturns as ot
import pytest

from satsep_ot.dynamics.simulation import simulate
from satsep_ot.model.case import CaseError, load_case, parse_case
from satsep_ot.model.inputs import joint_distribution
from satsep_ot.model.separation_function import SeparationError, SeparationFunction

CASE = load_case("reference")
DISTRIBUTION = joint_distribution(CASE.inputs)


def draw(size, seed=1):
    ot.RandomGenerator.SetSeed(seed)
    return np.array(DISTRIBUTION.getSample(size))


@pytest.fixture(scope="module")
def model():
    return SeparationFunction("reference")


def column(model, name):
    return [label.split(" ")[0] for label in model.getOutputDescription()].index(name)


def test_names_and_units(model):
    function = ot.Function(model)
    assert list(function.getInputDescription()) == list(DISTRIBUTION.getDescription())
    outputs = list(function.getOutputDescription())
    for label in (
        "axial_velocity [m/s]", "rate_x [deg/s]", "rate_y [deg/s]", "rate_z [deg/s]", "lateral_rate [deg/s]",
        "spin [deg/s]", "release_time [s]", "clearance [mm]", "exit_clearance_4 [mm]",
    ):  # fmt: skip
        assert label in outputs


def test_the_nominal_run(model):
    # The reference inputs are the nominal values, with no delay: closed form v = sqrt(2 E / mu_r) without gravity.
    nominal = model.evaluate([[row.reference for row in CASE.inputs]])[0]
    assert nominal[column(model, "axial_velocity")] == pytest.approx(0.597913, abs=5e-7)
    assert nominal[column(model, "release_time")] == pytest.approx(85.381e-3, abs=5e-7)
    assert nominal[column(model, "clearance")] == pytest.approx(25.0, abs=0.1)
    assert nominal[column(model, "rate_x")] == simulate(CASE.separation).quantity("rate_x")[0]


def test_fewer_quantities_in_another_order(model):
    x = draw(3)
    few = SeparationFunction("reference", quantities=["clearance", "rate_z"])
    columns = [column(model, "clearance"), column(model, "rate_z")]
    assert list(few.getOutputDescription()) == ["clearance [mm]", "rate_z [deg/s]"]
    assert np.array_equal(few.evaluate(x), model.evaluate(x)[:, columns])
    assert np.allclose(few.computeGradientSample(x), model.computeGradientSample(x)[:, :, columns], rtol=1e-13, atol=0)
    with pytest.raises(ValueError, match="'colour' is no quantity of this case; it has axial_velocity, "):
        SeparationFunction("reference", quantities=["colour"])


def test_scatter_agrees_with_a_separate_program(model):
    y = model.evaluate(draw(4000))
    mean, deviation = y.mean(axis=0), y.std(axis=0)
    assert mean[column(model, "axial_velocity")] == pytest.approx(0.5978, abs=2e-4)
    assert deviation[column(model, "axial_velocity")] == pytest.approx(0.0025, rel=0.06)
    assert deviation[column(model, "rate_x")] == pytest.approx(0.62, rel=0.04)
    assert deviation[column(model, "rate_z")] == pytest.approx(0.62, rel=0.04)
    assert deviation[column(model, "rate_y")] == pytest.approx(0.37, rel=0.04)
    assert mean[column(model, "release_time")] == pytest.approx(86.8e-3, abs=5e-5)


def test_a_row_does_not_depend_on_its_batch_or_its_caller(model):
    x = draw(200)
    y = model.evaluate(x)
    function = ot.Function(model)
    assert np.array_equal(np.array(function(ot.Sample(x))), y)
    for i in (0, 63, 64, 199):
        assert np.array_equal(model.evaluate(x[i : i + 1])[0], y[i])
        assert np.array_equal(np.array(function(x[i])), y[i])


def test_chunks_are_put_together_in_order(model, monkeypatch):
    x = draw(25)
    y, gradients = model.evaluate(x), model.computeGradientSample(x[:7])
    monkeypatch.setattr("satsep_ot.model.separation_function._CHUNK", 10)
    monkeypatch.setattr("satsep_ot.model.separation_function._GRADIENT_CHUNK", 3)
    assert np.array_equal(model.evaluate(x), y)
    assert np.array_equal(model.computeGradientSample(x[:7]), gradients)


def test_no_rows(model):
    assert model.evaluate(np.empty((0, 35))).shape == (0, model.getOutputDimension())


def test_gradients_agree_with_differences_of_values(model):
    x = draw(3, seed=2)
    gradients = model.computeGradientSample(x)
    assert gradients.shape == (3, 35, model.getOutputDimension())
    precise = SeparationFunction("reference", tolerance=1e-12)
    sigma = np.array(DISTRIBUTION.getStandardDeviation())
    for row in range(3):
        step = np.diag(1e-3 * sigma)
        differences = (precise.evaluate(x[row] + step) - precise.evaluate(x[row] - step)) / (2e-3 * sigma[:, None])
        scale = np.abs(gradients[row] * sigma[:, None]).max(axis=0)
        error = np.abs((gradients[row] - differences) * sigma[:, None]).max(axis=0) / scale
        assert error.max() < 1e-5


def test_openturns_sees_the_exact_gradient_through_marginals_and_compositions(model):
    x = draw(1, seed=3)[0]
    exact = model.computeGradientSample([x])[0]
    function = ot.Function(model)
    assert np.array_equal(np.array(function.gradient(x)), exact)
    indices = [column(model, "rate_z"), column(model, "rate_x")]
    assert np.array_equal(np.array(function.getMarginal(indices).gradient(x)), exact[:, indices])
    norm = ot.ComposedFunction(ot.SymbolicFunction(["a", "b"], ["sqrt(a^2 + b^2)"]), function.getMarginal(indices))
    lateral = exact[:, [column(model, "lateral_rate")]]
    assert np.allclose(np.array(norm.gradient(x)), lateral, rtol=1e-10, atol=1e-12 * np.abs(lateral).max())


def test_hessian_agrees_with_second_differences(model):
    x = draw(1, seed=4)[0]
    velocity = ot.Function(SeparationFunction("reference", quantities=["axial_velocity"]))
    hessian = velocity.hessian(x)
    sigma = np.array(DISTRIBUTION.getStandardDeviation())
    precise = SeparationFunction("reference", tolerance=1e-12)
    for i, j in ((0, 14), (14, 18), (18, 18), (14, 26)):
        steps = [np.zeros(35), np.zeros(35)]
        steps[0][i], steps[1][j] = 0.1 * sigma[i], 0.1 * sigma[j]
        corners = [x + a * steps[0] + b * steps[1] for a, b in ((1, 1), (1, -1), (-1, 1), (-1, -1))]
        y = precise.evaluate(corners)[:, column(model, "axial_velocity")]
        second = (y[0] - y[1] - y[2] + y[3]) / (4.0 * steps[0][i] * steps[1][j])
        assert hessian[i, j, 0] == pytest.approx(second, rel=1e-4)
        assert hessian[j, i, 0] == hessian[i, j, 0]


def test_a_failed_run_names_row_inputs_and_reason(model):
    x = draw(5)
    x[3, 0] = -1.0
    x[4, 0] = -2.0
    with pytest.raises(SeparationError) as caught:
        model.evaluate(x)
    message = str(caught.value)
    assert "row 3 could not be simulated (nor could 1 other of the 5 rows)" in message
    assert "satellite.mass = -1" in message
    assert "satellite_mass = -1 kg" in message
    with pytest.raises((RuntimeError, SeparationError), match="could not be simulated"):
        ot.Function(model)(ot.Sample(x))


def test_the_row_named_counts_through_chunks(model, monkeypatch):
    monkeypatch.setattr("satsep_ot.model.separation_function._CHUNK", 2)
    x = draw(5)
    x[3, 0] = -1.0
    with pytest.raises(SeparationError, match=r"^row 3 could not be simulated"):
        model.evaluate(x)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_inputs_that_are_not_finite(model, value, monkeypatch):
    """In the second chunk, too."""
    monkeypatch.setattr("satsep_ot.model.separation_function._CHUNK", 2)
    x = draw(3)
    x[2, 28] = value
    with pytest.raises(SeparationError, match=rf"rate_x = {value} in row 2"):
        model.evaluate(x)


def test_a_sample_of_another_shape(model):
    with pytest.raises(ValueError, match=r"shape \(2, 34\); it must be \(N, 35\)"):
        model.evaluate(np.zeros((2, 34)))


def test_copies_and_pickles_are_equal_and_small(model):
    x = draw(3)
    y = model.evaluate(x)
    stored = pickle.dumps(model)
    assert len(stored) < 20_000
    assert np.array_equal(pickle.loads(stored).evaluate(x), y)
    assert np.array_equal(copy.deepcopy(model).evaluate(x), y)


def test_a_study_keeps_it(model, tmp_path):
    function = ot.Function(model)
    study = ot.Study(str(tmp_path / "study.xml"))
    study.add("separation", function)
    study.save()
    loaded = ot.Study(str(tmp_path / "study.xml"))
    loaded.load()
    again = ot.Function()
    loaded.fillObject("separation", again)
    x = draw(2)
    assert np.array_equal(np.array(again(x)), model.evaluate(x))


def test_tolerance_sets_the_accuracy():
    x = draw(20)
    precise = SeparationFunction("reference", tolerance=1e-12).evaluate(x)
    for tolerance in (1e-6, 1e-8):
        error = np.abs(SeparationFunction("reference", tolerance=tolerance).evaluate(x) / precise - 1.0)[:, 0].max()
        assert error < 10.0 * tolerance


def test_a_case_without_uncertain_inputs_is_refused():
    text = (
        "[platform]\nmass = 10\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[satellite]\nmass = 1\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[springs]\ncount = 2\nradius = 100\nstiffness = 100\ndeformation = 20\nstroke = 10\n"
    )
    with pytest.raises(CaseError, match=r"no uncertain inputs"):
        SeparationFunction(parse_case(text))


def test_sobol_indices_can_be_computed(model):
    ot.RandomGenerator.SetSeed(0)
    velocity = ot.Function(model).getMarginal(column(model, "axial_velocity"))
    size = 100
    experiment = ot.SobolIndicesExperiment(DISTRIBUTION, size, False).generate()
    indices = ot.SaltelliSensitivityAlgorithm(experiment, velocity(experiment), size)
    first = np.array(indices.getFirstOrderIndices())
    # The energy of the springs decides on the velocity: their deformation and the stroke lead, inertia has no part.
    assert first[2:8].max() < 0.1 < np.array(indices.getTotalOrderIndices())[26]
