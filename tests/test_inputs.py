"""Uncertain inputs: the table of the reference case, and the map from samples to parameters and back."""

import math
import re
from dataclasses import replace

import numpy as np
import openturns as ot
import pytest

from satsep_ot.dynamics.parameter_vector import parameter_fields
from satsep_ot.dynamics.separation import Springs
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.model import inputs
from satsep_ot.model.case import CaseError, load_case, parse_case
from satsep_ot.model.distributions import build_distribution, interval_digits, quantile_range
from satsep_ot.model.inputs import ParameterMap, joint_distribution, nominal_parameters, scatter_targets
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

# Name, unit, mean, standard deviation of the 35 inputs of the reference case.
TABLE = [
    ("satellite_mass", "kg", 100.0, 0.5), ("stage_mass", "kg", 1200.0, 12.0),
    ("satellite_Ixx", "kg m2", 9.35, 0.14025), ("satellite_Iyy", "kg m2", 8.0, 0.12),
    ("satellite_Izz", "kg m2", 9.35, 0.14025),
    ("stage_Ixx", "kg m2", 1500.0, 45.0), ("stage_Iyy", "kg m2", 600.0, 18.0), ("stage_Izz", "kg m2", 1500.0, 45.0),
    ("satellite_cg_x", "mm", 0.0, 1.5), ("satellite_cg_z", "mm", 0.0, 1.5), ("satellite_cg_y", "mm", 400.0, 2.0),
    ("stage_cg_x", "mm", 0.0, 10.0), ("stage_cg_z", "mm", 0.0, 10.0), ("stage_cg_y", "mm", -1600.0, 20.0),
    *((f"stiffness_{i}", "N/m", 5500.0, 55.0) for i in (1, 2, 3, 4)),
    *((f"deformation_{i}", "mm", 40.0, 0.2) for i in (1, 2, 3, 4)),
    *((f"cant_{i}", "deg", 0.0, 0.3) for i in (1, 2, 3, 4)),
    ("stroke", "mm", 30.0, 0.15), ("ring_radius", "mm", 300.0, 0.5),
    ("rate_x", "deg/s", 0.0, 0.15), ("rate_z", "deg/s", 0.0, 0.15), ("rate_y", "deg/s", 0.0, 0.20),
    *((f"delay_{i}", "ms", 1.0, 1.0 / math.sqrt(3.0)) for i in (1, 2, 3, 4)),
]  # fmt: skip


@pytest.fixture(scope="module")
def case():
    return load_case("reference")


@pytest.fixture(scope="module")
def parameter_map(case):
    return ParameterMap(case.inputs, case.separation)


def test_the_35_inputs_of_the_reference_case(case):
    assert len(TABLE) == 35
    assert [(row.name, row.unit) for row in case.inputs] == [row[:2] for row in TABLE]
    for row, (_, _, mean, sigma) in zip(case.inputs, TABLE, strict=True):
        assert row.distribution.getMean()[0] == pytest.approx(mean, rel=1e-14, abs=1e-14), row.name
        assert row.distribution.getStandardDeviation()[0] == pytest.approx(sigma, rel=1e-12), row.name
        kind = "Uniform" if row.name.startswith("delay") else "Normal"
        assert row.distribution.getImplementation().getClassName() == kind
        assert row.description


def test_joint_distribution_is_named_and_independent(case):
    joint = joint_distribution(case.inputs)
    assert isinstance(joint, ot.JointDistribution)
    assert list(joint.getDescription()) == [f"{name} [{unit}]" for name, unit, _, _ in TABLE]
    assert joint.hasIndependentCopula()


def test_joint_distribution_with_a_copula(case):
    correlation = ot.CorrelationMatrix(35)
    correlation[14, 15] = 0.8
    joint = joint_distribution(case.inputs, ot.NormalCopula(correlation))
    assert joint.getMarginal([14, 15]).getCopula().getParameter()[0] == pytest.approx(0.8)


@pytest.mark.parametrize(
    ("copula", "words"),
    [
        (ot.NormalCopula(3), "dimension 3"),
        (ot.Normal(35), "a copula of dimension 35"),
        (ot.StudentCopula(3.0, ot.CorrelationMatrix(35)), "StudentCopula"),
    ],
)
def test_copulas_that_do_not_fit(case, copula, words):
    with pytest.raises(ValueError, match=words):
        joint_distribution(case.inputs, copula)


def test_the_reference_inputs_give_the_nominal_parameters(case, parameter_map):
    nominal = case.separation.parameters()
    assert np.array_equal(parameter_map.parameters(parameter_map.reference[None, :])[0], nominal)


def test_units_and_places(case, parameter_map):
    names = case.separation.parameter_names()
    x = parameter_map.reference.copy()
    column = {name: k for k, name in enumerate(parameter_map.names)}
    for name, value in {
        "satellite_mass": 101.0, "satellite_Iyy": 8.5, "stage_cg_y": -1610.0, "stiffness_3": 5600.0,
        "deformation_2": 41.0, "cant_4": 0.5, "stroke": 29.0, "ring_radius": 302.0, "rate_y": -0.4, "delay_1": 1.5,
    }.items():  # fmt: skip
        x[column[name]] = value
    moved = dict(zip(names, parameter_map.parameters(x[None, :])[0], strict=True))
    expected = dict(zip(names, case.separation.parameters(), strict=True))
    expected |= {
        "satellite.mass": 101.0, "satellite.inertia.yy": 8.5, "platform.center_of_mass.y": -1.61,
        "springs[2].stiffness": 5600.0, "springs[1].deformation": 0.041, "springs[3].cant": math.radians(0.5),
        **{f"springs[{i}].stroke": 0.029 for i in range(4)}, **{f"springs[{i}].radius": 0.302 for i in range(4)},
        "rates.y": math.radians(-0.4), "springs[0].delay": 0.0015,
    }  # fmt: skip
    assert moved == pytest.approx(expected, rel=1e-14, abs=1e-18)


def test_the_map_is_the_matrix(case, parameter_map):
    ot.RandomGenerator.SetSeed(5)
    sample = np.array(joint_distribution(case.inputs).getSample(50))
    by_matrix = parameter_map.nominal + (sample - parameter_map.reference) @ parameter_map.matrix.T
    assert np.allclose(parameter_map.parameters(sample), by_matrix, rtol=1e-13, atol=1e-15)
    rng = np.random.default_rng(1)
    by_parameters = rng.normal(size=(3, len(parameter_map.nominal)))
    assert np.allclose(parameter_map.gradient(by_parameters), by_parameters @ parameter_map.matrix)


def test_a_row_does_not_depend_on_its_batch(case, parameter_map):
    ot.RandomGenerator.SetSeed(6)
    sample = np.array(joint_distribution(case.inputs).getSample(100))
    whole = parameter_map.parameters(sample)
    for i in (0, 41, 99):
        assert np.array_equal(parameter_map.parameters(sample[i : i + 1])[0], whole[i])


def test_springs_that_differ_move_together_by_a_deviation():
    text = (
        "[platform]\nmass = 10\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[satellite]\nmass = 1\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[springs]\ncount = 2\nradius = 100\nstiffness = [100, 200]\ndeformation = 20\nstroke = 10\n"
        '[inputs]\nbatch = { quantity = "springs.stiffness", sigma = 5 }\n'
        'single = { quantity = "springs.stiffness.2", sigma = "1 %" }\n'
    )
    case = parse_case(text)
    batch, single = case.inputs
    assert batch.reference == 0.0
    assert batch.description == "deviation of the stiffness of all springs"
    assert batch.distribution == ot.Distribution(ot.Normal(0.0, 5.0))
    assert single.distribution == ot.Distribution(ot.Normal(200.0, 2.0))
    # The effects of two inputs on one parameter add.
    moved = ParameterMap(case.inputs, case.separation).parameters(np.array([[7.0, 203.0]]))[0]
    names = case.separation.parameter_names()
    assert moved[names.index("springs[0].stiffness")] == 107.0
    assert moved[names.index("springs[1].stiffness")] == 210.0


def test_every_parameter_of_a_spring_and_of_a_body_can_be_scattered(case):
    targets = scatter_targets(case.separation)
    reached = {parameter for target in targets.values() for parameter in target.parameters}
    # What only struts have, or only rods that slide on a plate, is not offered for guided springs.
    assert set(case.separation.parameter_names()) - reached == {"stowed_length", "guide_friction"}
    assert len([key for key in targets if key.startswith("springs.")]) == len(parameter_fields(Springs)) * (1 + 4)


EFFECTS = """
[umbilical]
angle = 30
radius = 250
stiffness = 2000
deformation = 8
stroke = 6
friction = 15
engagement = 5
[impulse]
momentum = [0, 1, 0]
"""


def test_every_parameter_of_every_effect_can_be_scattered():
    """A rod with friction, a table, a connector, an impulse, a plane wall: each under a name of its own."""
    text = load_case("reference").text.replace('"guided"', '"normal"\nguide_friction = 0.1', 1)
    text = text.replace("stroke = 30.0", "stroke = 30\ntable = { 2 = [[0, 200], [30, 60]] }", 1)
    text = text.replace("recess_depth", "planes = [{ normal = [0, 0, 1], offset = -400 }]\nrecess_depth", 1)
    text = text[: text.index("[inputs]")] + EFFECTS
    separation = parse_case(text).separation
    targets = scatter_targets(separation)
    names = separation.parameter_names()
    reached = {parameter for target in targets.values() for parameter in target.parameters}
    never = {"stowed_length", *(f"springs[{i}].{key}" for i in (1, 5) for key in ("stiffness", "deformation"))}
    # The springs of the connector act along the axis, from the start, and its pins are all that may be missing.
    never |= {f"springs[{i}].{key}" for i in (4, 5) for key in ("cant", "delay")} | {"springs[4].scale"}
    assert set(names) - reached == never
    rows = "[inputs]\n" + "\n".join(
        f'{name} = {{ quantity = "{quantity}", sigma = {sigma} }}'
        for name, quantity, sigma in (
            ("a", "springs.guide_friction", 0.02), ("b", "umbilical.friction", 2), ("c", "umbilical.engagement.1", 0.1),
            ("d", "impulse.momentum.x", 0.3), ("e", "impulse.angular_momentum.z", 1),
            ("f", "envelope.planes.1.offset", 3), ("g", "springs.scale.2", '"2 %"'), ("h", "umbilical.radius", 1),
            ("i", "springs.stiffness.each", 10),
        )
    )  # fmt: skip
    case = parse_case(text + rows)
    assert [row.name for row in case.inputs] == [*"abcdefgh", "i_1", "i_3", "i_4"]
    assert [row.unit for row in case.inputs][:8] == ["1", "N", "mm", "N s", "N m s", "mm", "1", "mm"]
    parameter_map = ParameterMap(case.inputs, separation)
    x = parameter_map.reference.copy()
    x[:8] = 0.2, 17.0, 5.5, 0.1, 0.2, -390.0, 0.9, 255.0
    moved = dict(zip(names, parameter_map.parameters(x[None, :])[0], strict=True))
    changed = {name: value for name, value in moved.items() if value != parameter_map.nominal[names.index(name)]}
    assert changed == pytest.approx(
        {
            "guide_friction": 0.2, "springs[5].scale": 17.0, "springs[5].stroke": 0.0055, "impulse.x": 0.1,
            "angular_impulse.z": 0.2, "recess_planes[0].offset": -0.39, "springs[1].scale": 0.9,
            "springs[4].radius": 0.255, "springs[5].radius": 0.255,
        }
    )  # fmt: skip
    function = SeparationFunction(parse_case(text + rows))
    assert np.isfinite(function.evaluate([x])).all()
    assert np.isfinite(function.computeGradientSample([x])).all()


def test_a_spring_fails_with_a_probability():
    """A Bernoulli on the factor of its force: the runs are those of all springs and of all but that one."""
    row = '\n[inputs]\nworks = { quantity = "springs.scale.3", distribution = "Bernoulli", p = 0.9 }\n'
    text = load_case("reference").text
    start, end = text.index("[inputs]"), text.index("[[requirements]]")
    case = parse_case(text[:start] + row + text[end:])
    ot.RandomGenerator.SetSeed(0)
    sample = SeparationProblem(case).getDistribution().getSample(500)
    values = np.array(ot.Function(SeparationFunction(case))(sample))
    works = np.array(sample)[:, 0] == 1.0
    assert 0.85 < works.mean() < 0.95
    failed = parse_case(text.replace("stroke = 30.0", "stroke = 30\nfailed = [3]", 1)).separation
    for selected, separation in ((works, case.separation), (~works, failed)):
        expected = simulate(separation)
        assert (values[selected, 0] == expected.quantity("axial_velocity")[0]).all()
    assert values[~works, 0].max() < 0.9 * values[works, 0].min()
    # The failure probability of the separation includes that of the spring.
    event = SeparationProblem(case).getEvent("axial velocity")
    algorithm = ot.ProbabilitySimulationAlgorithm(event, ot.MonteCarloExperiment())
    algorithm.setMaximumOuterSampling(100)
    algorithm.setBlockSize(50)
    algorithm.run()
    assert algorithm.getResult().getProbabilityEstimate() == pytest.approx(0.1, abs=0.02)


def test_distributions_by_name():
    assert build_distribution("Exponential", {"lambda": 2.0}) == ot.Distribution(ot.Exponential(2.0, 0.0))
    with pytest.raises(ValueError, match="'Normal'"):
        build_distribution("normal", {})
    with pytest.raises(ValueError, match="no OpenTURNS distribution"):
        build_distribution("__builtins__", {})


def test_quantile_range_of_a_normal():
    low, high = quantile_range(ot.Normal(10.0, 2.0))
    assert (low, high) == (
        pytest.approx(10.0 - 2.0 * 3.0902323, rel=1e-7),
        pytest.approx(10.0 + 2.0 * 3.0902323, rel=1e-7),
    )


def test_scaled_input_moves_its_parameters_half_as_far_about_the_same_mean(case):
    for name in ("satellite_mass", "delay_2"):
        row = next(row for row in case.inputs if row.name == name)
        # A reference away from the mean: the mean must stay where it is all the same.
        row = replace(row, reference=row.reference - 0.3)
        scaled = row.scaled(0.5)
        mean = row.distribution.getMean()[0]
        for value in (mean - 0.7, mean, mean + 0.4):
            moved = row.factor * (value - row.reference)
            at_mean = row.factor * (mean - row.reference)
            expected = at_mean + 0.5 * (moved - at_mean)
            assert scaled.factor * (value - scaled.reference) == pytest.approx(expected, abs=1e-15)
    with pytest.raises(ValueError, match="scale = 0"):
        row.scaled(0.0)


CORRELATED = """
[[correlation]]
inputs = ["satellite_Ixx", "satellite_mass"]
coefficient = 0.6

[[correlation]]
inputs = ["stiffness"]
rank = 0.5
"""


def test_correlations_of_a_case_are_those_of_its_sample():
    case = parse_case(load_case("reference").text + CORRELATED)
    ot.RandomGenerator.SetSeed(1)
    sample = SeparationProblem(case).getDistribution().getSample(20_000)
    linear, rank = sample.computeLinearCorrelation(), sample.computeSpearmanCorrelation()
    assert linear[0, 2] == pytest.approx(0.6, abs=0.02)
    for i, j in ((14, 15), (14, 17), (16, 17)):
        assert rank[i, j] == pytest.approx(0.5, abs=0.02)
    assert abs(linear[0, 3]) < 0.03
    assert SeparationProblem(case, ot.IndependentCopula(35)).getDistribution().hasIndependentCopula()
    assert load_case("reference").copula is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ('inputs = ["stifness", "stroke"]\nrank = 0.1', "did you mean 'stiffness"),
        ('inputs = ["stroke"]\nrank = 0.1', "at least two"),
        ('inputs = ["stroke", "stroke"]\nrank = 0.1', "each once"),
        ('inputs = "stroke"\nrank = 0.1', "a list of at least two"),
        ('inputs = ["stroke", "ring_radius"]', "neither coefficient nor rank"),
        ('inputs = ["stroke", "ring_radius"]\nrank = 0.1\ncoefficient = 0.1', "has both"),
        ('inputs = ["stroke", "ring_radius"]\nrank = 1.0', "size below 1"),
        ('inputs = ["stiffness"]\ncoefficient = -0.5', "smallest eigenvalue is -0.5"),
        (
            'inputs = ["stroke", "ring_radius"]\nrank = 0.1\n[[correlation]]\ninputs = ["ring_radius", "stroke"]\n'
            "rank = 0.2",
            "correlates stroke and ring_radius a second time",
        ),
    ],
)
def test_correlations_that_cannot_be_are_one_sentence(text, words):
    with pytest.raises(CaseError) as caught:
        parse_case(load_case("reference").text + "\n[[correlation]]\n" + text, "mine.toml")
    assert words in str(caught.value)
    assert str(caught.value).startswith("mine.toml: correlation")


@pytest.mark.parametrize(
    ("quantiles", "words"),
    [
        (
            RuntimeError("NotDefinedException : no quantile here"),
            "OpenTURNS finds no quantiles of .*: no quantile here",
        ),
        ((0.0, math.inf), "0.1 % to 99.9 % range, 0 to inf kg, is not finite"),
    ],
)
def test_a_distribution_without_quantiles_is_refused(case, quantiles, words, monkeypatch):
    def range_of(distribution):
        if isinstance(quantiles, Exception):
            raise quantiles
        return quantiles

    monkeypatch.setattr(inputs, "quantile_range", range_of)
    with pytest.raises(ValueError, match=words):
        inputs.check_range(case.inputs[0], nominal_parameters(case.separation))


@pytest.mark.parametrize("word", ["total_rate", "rate", "angular_rate", "tumbling", "Tip-off rate"])
def test_a_word_for_the_whole_rate_is_answered_with_its_quantity(word):
    # Of the names that are spelt like these, lateral_rate would leave out the spin, and rate_z all but one axis.
    with pytest.raises(CaseError, match=r"did you mean 'tip_off_rate'\?$"):
        parse_case(load_case("reference").text.replace('quantity = "spin"', f'quantity = "{word}"', 1))


@pytest.mark.parametrize(
    ("old", "new", "meant"),
    [
        # The nearest spelling of the first is "sigma", which would be three times the scatter.
        ("three_sigma = 3.0", "3sigma = 3.0", "three_sigma"),
        ("three_sigma = 3.0", '"3 Sigma" = 3.0', "three_sigma"),
        ("three_sigma = 3.0", "sgma = 3.0", "sigma"),
        ("springs.stiffness.each", "springs.stifness.each", "springs.stiffness.each"),
        ("springs.stiffness.each", "springs.stifness", "springs.stiffness"),
    ],
)
def test_the_suggested_word_means_what_was_meant(old, new, meant):
    text = load_case("reference").text
    text = text[: text.index("[inputs]")] + (
        '[inputs]\nstiffness = { quantity = "springs.stiffness.each", three_sigma = 3.0 }\n'
    )
    assert parse_case(text).inputs
    with pytest.raises(CaseError, match=rf"did you mean '{re.escape(meant)}'\?$"):
        parse_case(text.replace(old, new))


def test_digits_of_an_interval_without_a_width():
    assert interval_digits(2.0, 2.0) == interval_digits(-math.inf, 1.0) == 3
    assert interval_digits(2.0, 2.0, least=6) == 6
