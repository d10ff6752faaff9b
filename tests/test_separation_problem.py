"""A separation as a reliability problem: its events are right, and OpenTURNS' algorithms run on them as on any."""

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.reliability.algorithm import ActiveSubspaceReliability
from satsep_ot.model.case import CaseError, Requirement, load_case, parse_case
from satsep_ot.model.separation_problem import SeparationProblem

NAMES = ["lateral rate", "spin", "axial velocity", "clearance"]
VIOLATED = {
    "lateral rate": lambda q: q["lateral_rate"] > 2.5,
    "spin": lambda q: q["spin"] > 1.0,
    "axial velocity": lambda q: q["axial_velocity"] < 0.590,
    "clearance": lambda q: q["clearance"] < 18.0,
}


@pytest.fixture(scope="module")
def problem():
    return SeparationProblem("reference")


@pytest.fixture(scope="module")
def sample(problem):
    """Points twice as widely scattered as the inputs, so that every requirement is violated somewhere."""
    ot.RandomGenerator.SetSeed(3)
    x = np.array(problem.getDistribution().getSample(1500))
    reference = np.array(problem.getDistribution().getMean())
    x[:, :31] = reference[:31] + 2.0 * (x[:, :31] - reference[:31])
    return x


@pytest.fixture(scope="module")
def quantities(problem, sample):
    function = problem.getFunction()
    names = [label.split(" ")[0] for label in function.getOutputDescription()]
    return dict(zip(names, np.array(function(sample)).T, strict=True))


def event_rows(event, x):
    """Which rows of x are in an event, by its function, operator and threshold alone."""
    values = np.array(event.getFunction()(x))[:, 0]
    return np.array([event.getOperator().compare(value, event.getThreshold()) for value in values])


def test_names_and_units_are_those_of_the_description():
    problem = SeparationProblem("reference")
    pairs = zip(problem.getInputNames(), problem.getInputUnits(), strict=True)
    assert [f"{name} [{unit}]" for name, unit in pairs] == list(problem.getDistribution().getDescription())


def test_what_a_problem_holds(problem):
    assert problem.getRequirementNames() == NAMES
    assert [requirement.name for requirement in problem.getRequirements()] == NAMES
    assert problem.getCase().name == "reference"
    assert problem.getDistribution().getDimension() == 35
    assert isinstance(problem.getDistribution(), ot.JointDistribution)
    assert isinstance(problem.getFunction(), ot.Function)
    assert "reference" in repr(problem)


@pytest.mark.parametrize("name", NAMES)
def test_an_event_is_the_violation_of_its_requirement(problem, sample, quantities, name):
    event = problem.getEvent(name)
    assert isinstance(event, ot.ThresholdEvent)
    assert event.getName() == name
    violated = VIOLATED[name](quantities)
    assert 0 < violated.sum() < len(violated)
    assert np.array_equal(event_rows(event, sample), violated)
    requirement = problem.getRequirements()[NAMES.index(name)]
    assert event.getFunction().getOutputDescription()[0].startswith(f"{requirement.quantity} [")
    assert event.getFunction().getInputDescription() == problem.getDistribution().getDescription()
    values = np.array(event.getFunction()(sample))[:, 0]
    assert np.allclose(values, quantities[requirement.quantity], rtol=1e-14, atol=0)


def test_the_system_event_is_the_union(problem, sample, quantities):
    event = problem.getSystemEvent()
    assert isinstance(event, ot.ThresholdEvent)
    violated = np.any([rule(quantities) for rule in VIOLATED.values()], axis=0)
    assert np.array_equal(event_rows(event, sample), violated)


def test_the_smallest_margin_is_1_at_the_nominal_run(problem):
    reference = [row.reference for row in problem.getCase().inputs]
    assert problem.getSystemEvent().getFunction()(reference)[0] == pytest.approx(1.0, abs=1e-6)


def test_a_nominal_run_at_or_beyond_the_limit_keeps_the_system_event_right(sample, quantities):
    case = load_case("reference")
    requirements = (
        Requirement("slow", "axial_velocity", 0.6, False),
        Requirement("still", "spin", 0.0, True),
    )
    problem = SeparationProblem(type(case)(case.name, "", case.separation, case.inputs, requirements))
    violated = (quantities["axial_velocity"] < 0.6) | (quantities["spin"] > 0.0)
    assert np.array_equal(event_rows(problem.getSystemEvent(), sample), violated)
    assert np.array_equal(event_rows(problem.getEvent("slow"), sample), quantities["axial_velocity"] < 0.6)


@pytest.mark.parametrize("name", [*NAMES, None])
def test_components_make_up_the_variable_of_the_event(problem, sample, name):
    event = problem.getSystemEvent() if name is None else problem.getEvent(name)
    function, composition, smooth, surrogate_composition = problem.getComponents(name)
    components = function(sample)
    exact = np.array(event.getFunction()(sample))[:, 0]
    assert np.array_equal(np.array(composition(components))[:, 0], exact)
    assert surrogate_composition.getInputDimension() == len(smooth)
    assert list(surrogate_composition.getInputDescription()) == [components.getDescription()[k] for k in smooth]
    by_smooth = np.array(surrogate_composition(np.array(components)[:, smooth]))[:, 0]
    # The clearance at the exit is that over time but for rare points, where it is larger.
    assert np.mean(np.abs(by_smooth - exact) < 1e-6 * np.abs(exact)) > 0.9
    assert np.all(by_smooth - exact > -1e-6 * np.abs(exact))
    for native in (composition, surrogate_composition):
        assert "Python" not in repr(native.getImplementation())


def test_which_components(problem):
    def outputs(name):
        return [label.split(" ")[0] for label in problem.getComponents(name)[0].getOutputDescription()]

    exits = [f"exit_clearance_{k}" for k in (1, 2, 3, 4)]
    assert outputs("lateral rate") == ["rate_x", "rate_z"]
    assert outputs("spin") == ["rate_y"]
    assert outputs("axial velocity") == ["axial_velocity"]
    assert outputs("clearance") == ["clearance", *exits]
    assert outputs(None) == ["rate_x", "rate_z", "rate_y", "axial_velocity", "clearance", *exits]
    assert problem.getComponents("clearance")[2] == [1, 2, 3, 4]
    assert problem.getComponents(None)[2] == [0, 1, 2, 3, 5, 6, 7, 8]


@pytest.mark.parametrize("name", [*NAMES, None])
def test_compositions_have_exact_derivatives(problem, sample, name):
    function, composition, smooth, surrogate_composition = problem.getComponents(name)
    for y, native in (
        (np.array(function(sample[0])), composition),
        (np.array(function(sample[1]))[smooth], surrogate_composition),
    ):
        gradient = np.array(native.gradient(y))[:, 0]
        step = 1e-5 * np.diag(np.abs(y))
        differences = (np.array(native(y + step)) - np.array(native(y - step)))[:, 0] / (2e-5 * np.abs(y))
        assert np.allclose(gradient, differences, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("name", ["lateral rate", "spin"])
def test_at_a_kink_the_gradient_is_a_subgradient(problem, name):
    composition = problem.getComponents(name)[1]
    zero = [0.0] * composition.getInputDimension()
    assert composition(zero)[0] < 1e-100
    assert np.array_equal(np.array(composition.gradient(zero))[:, 0], [1.0, *zero[1:]])


@pytest.mark.parametrize("size", [1, 2, 3, 4, 5, 8, 13])
def test_minimum_of_any_number_of_requirements(size):
    case = load_case("reference")
    limits = [0.58 + 0.002 * k for k in range(size)]
    requirements = tuple(Requirement(f"r{k}", "axial_velocity", limit, False) for k, limit in enumerate(limits))
    problem = SeparationProblem(type(case)(case.name, "", case.separation, case.inputs, requirements))
    composition = problem.getComponents(None)[1]
    nominal = 0.5979129
    for velocity in (0.57, 0.5995, 0.62):
        margins = [(velocity - limit) / abs(nominal - limit) for limit in limits]
        assert composition([velocity])[0] == pytest.approx(min(margins), rel=1e-3)
        slope = 1.0 / abs(nominal - limits[int(np.argmin(margins))])
        assert composition.gradient([velocity])[0, 0] == pytest.approx(slope, rel=1e-3)


def test_any_other_limit(problem, sample, quantities):
    event = problem.getEvent(Requirement("late", "release_time", 0.088, True))
    assert np.array_equal(event_rows(event, sample), quantities["release_time"] > 0.088)
    with pytest.raises(ValueError, match="'colour' is no quantity of this case"):
        problem.getEvent(Requirement("colour", "colour", 1.0, True))


def test_a_limit_on_the_whole_rate(problem, sample, quantities):
    requirement = Requirement("tip-off", "tip_off_rate", 2.0, True)
    violated = np.sqrt(sum(quantities[f"rate_{axis}"] ** 2 for axis in "xyz")) > 2.0
    assert 0 < violated.sum() < len(violated)
    assert np.array_equal(event_rows(problem.getEvent(requirement), sample), violated)
    function, composition, smooth, surrogate_composition = problem.getComponents(requirement)
    assert list(function.getOutputDescription()) == ["rate_x [deg/s]", "rate_y [deg/s]", "rate_z [deg/s]"]
    assert smooth == [0, 1, 2]
    for native in (composition, surrogate_composition):
        assert native([3.0, -4.0, 12.0])[0] == pytest.approx(13.0)
        assert np.allclose(np.array(native.gradient([3.0, -4.0, 12.0]))[:, 0], np.array([3.0, -4.0, 12.0]) / 13.0)
        # At the kink, one of the subgradients.
        assert np.array_equal(np.array(native.gradient([0.0, 0.0, 0.0]))[:, 0], [1.0, 0.0, 0.0])


def test_unknown_requirements(problem):
    with pytest.raises(ValueError, match=r"'spinn' is no requirement of this case; .*did you mean 'spin'\?"):
        problem.getEvent("spinn")
    with pytest.raises(ValueError, match="no requirement"):
        problem.getComponents(3)


def test_a_case_without_inputs_or_requirements():
    case = load_case("reference")
    with pytest.raises(CaseError, match="no uncertain inputs"):
        SeparationProblem(type(case)(case.name, "", case.separation, (), case.requirements))
    bare = SeparationProblem(type(case)(case.name, "", case.separation, case.inputs, ()))
    assert bare.getRequirements() == []
    with pytest.raises(CaseError, match="no requirements"):
        bare.getSystemEvent()


def test_a_copula_arrives_in_the_events():
    correlation = ot.CorrelationMatrix(35)
    for i in range(14, 18):
        for j in range(14, i):
            correlation[i, j] = 0.9
    problem = SeparationProblem("reference", ot.NormalCopula(correlation))
    distribution = problem.getEvent("spin").getAntecedent().getDistribution()
    assert distribution.getMarginal([14, 17]).getCopula().getParameter()[0] == pytest.approx(0.9)


def form(problem, event):
    optimizer = ot.AbdoRackwitz()
    optimizer.setMaximumIterationNumber(100)
    optimizer.setStartingPoint(problem.getDistribution().getMean())
    algorithm = ot.FORM(optimizer, event)
    algorithm.run()
    return algorithm.getResult()


def test_form_finds_the_design_points(problem):
    velocity = form(problem, problem.getEvent("axial velocity"))
    assert velocity.getEventProbability() == pytest.approx(6e-4, rel=0.25)
    spin = form(problem, problem.getEvent("spin"))
    # Both signs of the rate fail, and FORM sees one of them.
    assert 2.0 * spin.getEventProbability() == pytest.approx(7e-3, rel=0.2)
    lateral = form(problem, problem.getEvent(Requirement("lateral", "lateral_rate", 2.0, True)))
    # Its limit state is a circle: the tangent plane misses nearly all of the true 5.1e-3, wherever it touches.
    assert lateral.getEventProbability() == pytest.approx(7e-4, rel=0.4)
    for result, name in ((velocity, "axial_velocity"), (spin, "spin"), (lateral, "lateral_rate")):
        limit = {"axial_velocity": 0.590, "spin": 1.0, "lateral_rate": 2.0}[name]
        function = problem.getFunction()
        index = [label.split(" ")[0] for label in function.getOutputDescription()].index(name)
        point = result.getPhysicalSpaceDesignPoint()
        assert function(point)[index] == pytest.approx(limit, rel=1e-4)


def test_form_finds_the_design_points_of_the_clearance_and_of_the_system(problem):
    clearance = form(problem, problem.getEvent("clearance"))
    # One of four corners, of which several come close.
    assert 1e-4 < clearance.getEventProbability() < 2e-3
    system = form(problem, problem.getSystemEvent())
    # The nearest of several modes at most, out of 8e-3 in all.
    assert 1e-5 < system.getEventProbability() < 4e-3
    assert problem.getSystemEvent().getFunction()(system.getPhysicalSpaceDesignPoint())[0] == pytest.approx(0, abs=1e-4)


def test_sorm_runs(problem):
    event = problem.getEvent("axial velocity")
    optimizer = ot.AbdoRackwitz()
    optimizer.setStartingPoint(problem.getDistribution().getMean())
    algorithm = ot.SORM(optimizer, event)
    algorithm.run()
    assert algorithm.getResult().getEventProbabilityBreitung() == pytest.approx(6e-4, rel=0.3)


def test_subset_sampling_runs_on_the_system_event(problem):
    ot.RandomGenerator.SetSeed(0)
    algorithm = ot.SubsetSampling(problem.getSystemEvent())
    algorithm.setMaximumOuterSampling(10)
    algorithm.setBlockSize(200)
    algorithm.setConditionalProbability(0.1)
    algorithm.run()
    assert algorithm.getResult().getProbabilityEstimate() == pytest.approx(8.0e-3, rel=0.4)


def test_monte_carlo_runs_on_an_event(problem):
    ot.RandomGenerator.SetSeed(0)
    event = problem.getEvent(Requirement("lateral", "lateral_rate", 2.0, True))
    algorithm = ot.ProbabilitySimulationAlgorithm(event, ot.MonteCarloExperiment())
    algorithm.setMaximumOuterSampling(10)
    algorithm.setBlockSize(2000)
    algorithm.setMaximumCoefficientOfVariation(-1.0)
    algorithm.run()
    result = algorithm.getResult()
    assert result.getOuterSampling() * result.getBlockSize() == 20000
    # A million runs gave 5.14e-3 (tests/benchmarks/reference_scatter.txt).
    assert result.getProbabilityEstimate() == pytest.approx(5.1e-3, abs=4.0 * result.getStandardDeviation())


def test_requirements_from_a_file_without_an_envelope():
    text = (
        "[platform]\nmass = 10\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[satellite]\nmass = 1\ninertia = [1, 1, 1]\ncenter_of_mass = [0, 0, 0]\n"
        "[springs]\ncount = 2\nradius = 100\nstiffness = 100\ndeformation = 20\nstroke = 10\n"
        '[inputs]\nmass = { quantity = "satellite.mass", plus_minus = 0.1 }\n'
        '[[requirements]]\nquantity = "axial_velocity"\nminimum = 0.1\n'
    )
    problem = SeparationProblem(parse_case(text))
    function, composition, smooth, _ = problem.getComponents("axial_velocity")
    assert (function.getInputDimension(), composition.getInputDimension(), smooth) == (1, 1, [0])
    # E = sum K L (xi - L / 2) = 0.03 J and v = sqrt(2 E / mu_r).
    velocity = problem.getEvent("axial_velocity").getFunction()([1.0])[0]
    assert velocity == pytest.approx(np.sqrt(2.0 * 0.03 * 1.1), rel=1e-8)


def test_events_have_the_whole_hessian(problem):
    x = problem.getDistribution().getMean()
    x[31], x[32], x[33] = 0.3, 0.8, 1.2
    function = problem.getEvent("axial velocity").getFunction()
    sigma = problem.getDistribution().getStandardDeviation()[18]
    hessian = function.hessian(x)
    values = []
    for k in (-1, 0, 1):
        moved = ot.Point(x)
        moved[18] += 0.3 * k * sigma
        values.append(function(moved)[0])
    second = (values[0] - 2.0 * values[1] + values[2]) / (0.3 * sigma) ** 2
    assert hessian[18, 18, 0] == pytest.approx(second, rel=1e-3)


def recontact_problem():
    text = load_case("reference").text.replace("[envelope]", "[recontact]\nend_orbits = 0.4\n[envelope]", 1)
    row = '[[requirements]]\nname = "re-contact"\nquantity = "recontact_distance"\nminimum = 324.0\n'
    return SeparationProblem(parse_case(text + row))


def test_a_re_contact_distance_can_be_required():
    problem = recontact_problem()
    function, _, smooth, _ = problem.getComponents("re-contact")
    assert list(function.getOutputDescription()) == ["recontact_distance [m]"]
    assert smooth == [0]
    ot.RandomGenerator.SetSeed(4)
    x = problem.getDistribution().getSample(200)
    distances = np.array(function(x))[:, 0]
    event = problem.getEvent("re-contact")
    assert np.array_equal(event_rows(event, np.array(x)), distances < 324.0)
    system = event_rows(problem.getSystemEvent(), np.array(x))
    assert system[distances < 324.0].all()
    mean, gradient = problem.getDistribution().getMean(), np.array(function.gradient(x[0]))[:, 0]
    for i in (0, 9, 14, 30):
        step = 1e-2 * float(problem.getDistribution().getStandardDeviation()[i])
        values = [function(np.array(x[0]) + sign * step * np.eye(35)[i])[0] for sign in (1.0, -1.0)]
        assert (values[0] - values[1]) / (2.0 * step) == pytest.approx(gradient[i], rel=1e-4, abs=1e-6)
    assert np.isfinite(np.array(function.gradient(mean))).all()


@pytest.mark.slow
def test_the_probability_of_a_short_re_contact_distance():
    """The corrected probability against 20,000 runs."""
    problem = recontact_problem()
    ot.RandomGenerator.SetSeed(5)
    sample = problem.getDistribution().getSample(20_000)
    count = event_rows(problem.getEvent("re-contact"), np.array(sample)).sum()
    algorithm = ActiveSubspaceReliability(problem.getEvent("re-contact"))
    algorithm.setComponents(*problem.getComponents("re-contact"))
    algorithm.run()
    probability = algorithm.getResult().getProbabilityEstimate()
    assert count > 100
    assert probability == pytest.approx(count / 20_000, abs=4.0 * np.sqrt(count) / 20_000)
    assert algorithm.getResult().getEvaluationNumber() < 2000


def test_names_of_smooth_components_are_those_of_the_smooth_indices():
    problem = SeparationProblem("reference")
    for requirement in [None, *problem.getRequirementNames()]:
        function, _, smooth, _ = problem.getComponents(requirement)
        labels = [function.getOutputDescription()[index] for index in smooth]
        names = problem.getSmoothComponentNames(requirement)
        assert len(names) == len(labels) > 0
        assert all(label.startswith(f"{name} [") for name, label in zip(names, labels, strict=True))
