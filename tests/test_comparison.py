"""ReliabilityComparison: what is counted, what is reported, what an error becomes."""

import math

import numpy as np
import openturns as ot
import pytest

from satsep_ot.methods.comparison import methods as c
from satsep_ot.methods.comparison.comparison import ReliabilityComparison
from satsep_ot.methods.comparison.problems import getBenchmarkProblem


@pytest.fixture(autouse=True)
def _seed():
    ot.RandomGenerator.SetSeed(0)


class Recorder:
    """A linear limit state that counts its calls in a list: failure above 2.9 standard deviations."""

    def __init__(self, dimension=4, gradient=True, scale=1.0):
        self.points = [0]
        self.gradients = [0]

        def evaluate(x):
            x = np.asarray(x)
            self.points[0] += len(x)
            return x.sum(axis=1, keepdims=True) / (scale * math.sqrt(dimension))

        def differentiate(x):
            self.gradients[0] += 1
            return np.full((dimension, 1), 1.0 / (scale * math.sqrt(dimension)))

        function = ot.PythonFunction(dimension, 1, func_sample=evaluate, gradient=differentiate if gradient else None)
        distribution = ot.Normal([0.0] * dimension, [scale] * dimension, ot.CorrelationMatrix(dimension))
        vector = ot.CompositeRandomVector(function, ot.RandomVector(distribution))
        self.event = ot.ThresholdEvent(vector, ot.Greater(), 2.9)


def run(event, methods, **options):
    comparison = ReliabilityComparison(event, methods)
    comparison.setMaximumEvaluations(None)
    for name, value in options.items():
        getattr(comparison, f"set{name}")(*value) if name == "Components" else getattr(comparison, f"set{name}")(value)
    comparison.run()
    return comparison.getResult()


METHODS = [
    c.ActiveSubspace(),
    c.SafeActiveSubspace(),
    c.FORM(),
    c.MultiFORM(2),
    c.SORM(),
    c.SORMHohenbichler(),
    c.SORMTvedt(),
    c.SubsetSampling(1000),
    c.MonteCarlo(20_000),
    c.LatinHypercube(maximumEvaluations=30_000),
    c.QuasiMonteCarlo(maximumEvaluations=30_000),
    c.AKMCS(0.3, populationSize=5000),
    c.AKMCSFeasibility(0.3, populationSize=5000),
    c.PaperChain(),
    c.InverseRegressionChaos(),
    c.ChaosMonteCarlo(),
    c.ImportanceSampling(maximumEvaluations=2000),
    c.ControlledImportanceSampling(maximumEvaluations=2000),
    c.CrossEntropy(2000),
    c.NAIS(1000),
    c.DirectionalSampling(maximumDirections=200),
    c.LineSampling(maximumLines=100),
    c.ActiveLineSampling(maximumLines=100),
]
TRUTH = ot.DistFunc.pNormal(-2.9)


@pytest.mark.parametrize("gradient", [True, False])
@pytest.mark.parametrize("method", METHODS, ids=lambda method: method.name)
def test_every_call_is_counted_and_the_answer_is_right(method, gradient):
    recorder = Recorder(gradient=gradient)
    row = run(recorder.event, [method]).getRow(method.name)
    assert (row.evaluations, row.gradients) == (recorder.points[0], recorder.gradients[0])
    assert row.evaluations > 0
    assert row.converged, row.note
    if row.lower95 is None:
        # Only two surrogates that have no interval carry a sampling error.
        sampled = isinstance(method, (c.ChaosMonteCarlo, c.InverseRegressionChaos))
        assert row.probability == pytest.approx(TRUTH, rel=0.3 if sampled else 1e-4)
    else:
        assert row.lower95 < row.probability < row.upper95
        assert abs(math.log(row.probability / TRUTH)) < 5.0 * row.coefficient_of_variation + 1e-9
    if isinstance(method, c.FORM):
        assert (row.gradients > 0) == gradient
        assert (row.lower95, row.upper95, row.coefficient_of_variation) == (None, None, None)


def test_the_last_block_of_monte_carlo_ends_at_the_size():
    recorder = Recorder()
    row = run(recorder.event, [c.MonteCarlo(size=2500, blockSize=1000)]).getRows()[0]
    assert row.evaluations == recorder.points[0] == 2500


def test_lines_find_a_limit_state_at_a_whole_distance():
    # OpenTURNS' root search steps by 1 and loses a root that a step hits.
    problem = getBenchmarkProblem("RP107")
    row = run(problem.getEvent(), [c.ActiveLineSampling()]).getRows()[0]
    assert row.probability == pytest.approx(problem.getProbability(), rel=1e-6)
    assert row.evaluations < 500


def test_finite_difference_steps_follow_the_spread_of_the_inputs():
    # OpenTURNS' own absolute step of 1e-5 spans thousands of these standard deviations.
    recorder = Recorder(gradient=False, scale=1e-9)
    assert run(recorder.event, ["FORM"]).getRow("FORM").probability == pytest.approx(TRUTH, rel=1e-3)


def test_components_reach_the_active_subspace_and_are_counted():
    problem = getBenchmarkProblem("FourBranch")
    row = run(problem.getEvent(), [c.ActiveSubspace()], Components=problem.getComponents()).getRow("ActiveSubspace")
    assert row.lower95 < problem.getProbability() < row.upper95
    assert row.evaluations < 2000


def test_an_exception_is_a_row_with_its_message_and_the_others_still_run():
    def explode(x):
        raise ArithmeticError("spring 3 is broken")

    function = ot.PythonFunction(1, 1, func_sample=explode)
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal())), ot.Greater(), 1.0)
    rows = run(event, None).getRows()
    assert [row.method for row in rows] == ["ActiveSubspace", "FORM", "SORM", "SubsetSampling", "MonteCarlo"]
    for row in rows:
        assert row.probability is None
        assert not row.converged
        assert "spring 3 is broken" in row.note


def test_no_failure_in_monte_carlo_has_an_interval_and_no_variation():
    vector = ot.CompositeRandomVector(ot.SymbolicFunction("x", "x"), ot.RandomVector(ot.Normal()))
    row = run(ot.ThresholdEvent(vector, ot.Greater(), 30.0), [c.MonteCarlo(1000)]).getRows()[0]
    assert (row.probability, row.lower95, row.coefficient_of_variation) == (0.0, 0.0, None)
    assert row.upper95 == pytest.approx(3e-3, rel=0.01)


@pytest.mark.parametrize("method", [m for m in METHODS if not isinstance(m, c.FORM)], ids=lambda method: method.name)
def test_a_value_that_is_not_a_number_is_an_error_and_not_a_run_without_failure(method):
    def evaluate(x):
        x = np.asarray(x)
        return np.where(x[:, :1] > 0.5, np.nan, x[:, :1])

    function = ot.PythonFunction(2, 1, func_sample=evaluate)
    event = ot.ThresholdEvent(ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(2))), ot.Greater(), 0.4)
    row = run(event, [method]).getRows()[0]
    assert row.probability is None
    assert "not finite" in row.note


def test_nais_and_lines_take_bounded_inputs():
    """OpenTURNS' NAIS refuses them where they are; in standard space nothing is bounded."""
    distribution = ot.JointDistribution([ot.Uniform(0.0, 1.0), ot.Uniform(0.0, 2.0)])
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], ["2 * a + b"]), ot.RandomVector(distribution))
    # The corner above 2 a + b = 3.9 is a triangle of legs 0.05 and 0.1 in an area of 2.
    for row in run(ot.ThresholdEvent(vector, ot.Greater(), 3.9), [c.NAIS(4000), c.LineSampling()]).getRows():
        assert row.probability == pytest.approx(0.5 * 0.05 * 0.1 / 2.0, rel=5.0 * row.coefficient_of_variation), row


def test_union_event_is_compared_by_its_limit_state():
    x = ot.RandomVector(ot.Normal(2))
    events = [
        ot.ThresholdEvent(ot.CompositeRandomVector(ot.SymbolicFunction(["a", "b"], [f]), x), ot.Greater(), 2.5)
        for f in ("a", "b")
    ]
    rows = run(ot.UnionEvent(events), [c.ActiveSubspace(), c.MonteCarlo(50_000)]).getRows()
    truth = 1.0 - ot.DistFunc.pNormal(2.5) ** 2
    for row in rows:
        assert abs(row.probability - truth) < 4.0 * row.coefficient_of_variation * truth, row


def test_callbacks_can_be_lambdas_and_stop_the_run():
    seen, rows = [], []
    comparison = ReliabilityComparison(Recorder().event, [c.MonteCarlo(1000, blockSize=100), "FORM"])
    comparison.setProgressCallback(lambda name, percentage: seen.append((name, percentage)))
    comparison.setRowCallback(lambda row: rows.append(row.method))
    comparison.setStopCallback(lambda: len(seen) > 3)
    comparison.run()
    assert seen[0] == ("MonteCarlo", 0.0)
    assert rows == ["MonteCarlo"]
    row = comparison.getResult().getRows()[0]
    assert row.evaluations < 1000
    assert not row.converged


def test_tables_and_graph_hold_every_row():
    result = run(Recorder().event, ["FORM", c.MonteCarlo(20_000)])
    assert result.toCSV().splitlines()[1].startswith("FORM,0.00186")
    assert len(result.toMarkdown().splitlines()) == 4
    text = result.toText().splitlines()
    assert [line.split()[0] for line in text[:3]] == ["method", "FORM", "MonteCarlo"]
    assert len({len(line) for line in text[:3]}) == 1
    assert text[-1].startswith("MonteCarlo: ")
    assert [row["method"] for row in result.getTable()] == ["FORM", "MonteCarlo"]
    assert len(result.drawProbabilities().getDrawables()) == 3
    with pytest.raises(ValueError, match="no row"):
        result.getRow("SORM")


def test_unknown_method_is_refused():
    with pytest.raises(ValueError, match="MonteCarlo"):
        ReliabilityComparison(Recorder().event, ["Magic"])


def test_subset_sampling_that_stops_short_of_the_event_has_no_probability():
    """The variable never comes near the threshold: the product of the levels is not the probability of the event."""
    vector = ot.CompositeRandomVector(ot.SymbolicFunction(["x"], ["1e-14 * sin(x)"]), ot.RandomVector(ot.Normal()))
    comparison = ReliabilityComparison(ot.ThresholdEvent(vector, ot.Greater(), 2.0), ["SubsetSampling"])
    comparison.run()
    row = comparison.getResult().getRow("SubsetSampling")
    assert row.probability is None
    assert not row.converged


def test_an_interrupt_inside_form_ends_the_comparison():
    def interrupted(x):
        raise KeyboardInterrupt

    vector = ot.CompositeRandomVector(ot.PythonFunction(2, 1, interrupted), ot.RandomVector(ot.Normal(2)))
    comparison = ReliabilityComparison(ot.ThresholdEvent(vector, ot.Greater(), 2.0), ["FORM"])
    with pytest.raises(KeyboardInterrupt):
        comparison.run()


class Shown:
    """A SORM result that has no formula but those that it is given."""

    def __init__(self, **values):
        self.values = values

    def __getattr__(self, name):
        formula = name.removeprefix("getEventProbability")

        def probability():
            if formula not in self.values:
                raise RuntimeError("NotDefinedException : a curvature is too large")
            return self.values[formula]

        return probability


def test_a_formula_that_is_not_defined_is_noted_and_one_that_is_asked_for_is_an_error(monkeypatch):
    monkeypatch.setattr(c.SORM, "solve", lambda self, problem, algorithm: (Shown(Breitung=1e-3), True, "told"))
    event = Recorder().event
    row = run(event, [c.SORM()]).getRow("SORM")
    assert row.probability == 1e-3
    assert row.note == "told; Hohenbichler not defined here; Tvedt not defined here"
    row = run(event, [c.SORMTvedt()]).getRow("SORMTvedt")
    assert row.probability is None
    assert "a curvature is too large" in row.note


@pytest.mark.parametrize("method", [c.ImportanceSampling(), c.LineSampling()], ids=lambda method: method.name)
def test_without_a_design_point_there_is_nothing_to_sample_around(method, monkeypatch):
    monkeypatch.setattr(c.FORM, "solve", lambda self, problem, algorithm: (None, False, "it went round in circles"))
    row = run(Recorder().event, [method]).getRow(method.name)
    assert row.probability is None
    assert "FORM has no design point" in row.note
    assert "it went round in circles" in row.note


@pytest.mark.parametrize(("probability", "variation"), [(0.0, 0.1), (1e-3, math.inf), (1e-3, -1.0)])
def test_an_estimate_without_a_number_is_none(probability, variation, monkeypatch):
    class Algorithm:
        def run(self):
            pass

        def getResult(self):
            return self

        def getProbabilityEstimate(self):
            return probability

        def getCoefficientOfVariation(self):
            return variation

    monkeypatch.setattr(c.NAIS, "build", lambda self, problem: Algorithm())
    row = run(Recorder().event, [c.NAIS()]).getRow("NAIS")
    assert row.probability is None
    assert row.note.startswith("no usable estimate: probability")


@pytest.mark.parametrize("method", [c.AKMCS(0.3), c.AKMCSFeasibility(0.3)], ids=lambda method: method.name)
def test_active_learning_on_four_branches_meets_the_population_or_says_that_nothing_failed(method):
    problem = getBenchmarkProblem("FourBranch")
    found = []
    for seed in range(2):
        ot.RandomGenerator.SetSeed(seed)
        row = run(problem.getEvent(), [method]).getRow(method.name)
        assert row.evaluations <= method.maximumEvaluations
        if row.probability is None:
            # The criterion is met before a failure is found: nothing is claimed.
            assert "no point of the population fails: that is no probability" in row.note
        else:
            assert "the interval is that of the population of" in row.note
            found.append(row.probability / problem.getProbability())
    assert found
    assert all(0.2 < ratio < 1.7 for ratio in found)


def test_active_learning_ends_at_its_limit_and_at_the_callback():
    row = run(Recorder(2).event, [c.AKMCS(maximumEvaluations=14)]).getRows()[0]
    assert row.evaluations == 14
    assert not row.converged
    assert row.note.startswith("the limit of 14 evaluations was reached")
    row = run(
        Recorder(2).event, [c.AKMCS()], StopCallback=lambda: comparisonBegan.append(1) or len(comparisonBegan) > 4
    )
    assert not row.getRows()[0].converged
    assert row.getRows()[0].note.startswith("stopped by the stop callback")


comparisonBegan: list[int] = []


def test_active_learning_of_a_constant_is_an_error():
    vector = ot.CompositeRandomVector(ot.PythonFunction(1, 1, lambda x: [1.0]), ot.RandomVector(ot.Normal()))
    row = run(ot.ThresholdEvent(vector, ot.Greater(), 2.0), ["AKMCS"]).getRows()[0]
    assert "the limit state is 1 at all of the first 12 runs" in row.note


def test_the_chain_of_the_paper_is_exact_for_a_quartic_of_one_direction_and_wrong_where_it_sees_no_failure():
    # g = y^4 / 10 + y, y = (a + 2 b + 2 c) / 3.
    function = ot.SymbolicFunction(["a", "b", "c"], ["((a + 2 * b + 2 * c) / 3)^4 / 10 + (a + 2 * b + 2 * c) / 3"])
    vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(3)))
    row = run(ot.ThresholdEvent(vector, ot.Greater(), 20.0), ["PaperChain"]).getRows()[0]
    roots = np.roots([0.1, 0.0, 0.0, 1.0, -20.0])
    low, high = sorted(roots[np.isreal(roots)].real)
    probability = ot.Normal().computeCDF(low) + ot.Normal().computeComplementaryCDF(high)
    assert row.probability == pytest.approx(probability, rel=1e-4)
    assert (row.evaluations, row.gradients, row.lower95, row.coefficient_of_variation) == (100, 100, None, None)
    assert row.note == (
        "the probability of the surrogate, not corrected by true runs, and without an interval: "
        "1 variables, degree 4, Q2 1.0000"
    )
    # A steep second part beyond all points: the chain never fails, and says that this is no answer.
    steep = ot.SymbolicFunction(["a", "b"], ["a + 100 * max(b - 4, 0)"])
    vector = ot.CompositeRandomVector(steep, ot.RandomVector(ot.Normal(2)))
    row = run(ot.ThresholdEvent(vector, ot.Greater(), 50.0), ["PaperChain"]).getRows()[0]
    assert row.probability is None or row.probability < 1e-12
    constant = ot.SymbolicFunction(["a"], ["2"])
    vector = ot.CompositeRandomVector(constant, ot.RandomVector(ot.Normal(1)))
    row = run(ot.ThresholdEvent(vector, ot.Greater(), 50.0), ["PaperChain"]).getRows()[0]
    assert row.note == "all gradients are 0: there is no active subspace"


def test_no_method_spends_more_than_the_budget():
    recorder = Recorder(3)
    budget = 700
    others = sorted(set(c.METHODS) - {"AKMCS", "AKMCSFeasibility"})
    comparison = ReliabilityComparison(recorder.event, [*others, c.AKMCS(0.3), c.AKMCSFeasibility(0.3)])
    comparison.setMaximumEvaluations(budget)
    spent = []
    comparison.setRowCallback(lambda row: spent.append((row.method, recorder.points[0] + recorder.gradients[0])))
    comparison.run()
    before = 0
    for name, after in spent:
        assert after - before <= budget, name
        before = after
    rows = {row.method: row for row in comparison.getResult().getRows()}
    assert (rows["MonteCarlo"].evaluations, rows["MonteCarlo"].converged) == (700, True)
    assert rows["MonteCarlo"].upper95 is not None
    # What cannot be bounded by its settings ends without a probability.
    assert rows["SubsetSampling"].probability is None
    assert "the limit of 700 evaluations does not allow" in rows["SubsetSampling"].note
    # Sampling around the design point takes what FORM has left.
    assert rows["ImportanceSampling"].probability == pytest.approx(1.87e-3, rel=0.3)


def test_what_a_comparison_may_spend_is_said_before_it_begins():
    recorder = Recorder(2)
    comparison = ReliabilityComparison(recorder.event, [c.MonteCarlo(150_000), c.LatinHypercube(), "FORM"])
    with pytest.warns(UserWarning, match="MonteCarlo up to 150,000, LatinHypercube up to 1,000,000; setMaximumEval"):
        comparison.run()
    comparison = ReliabilityComparison(recorder.event, [c.MonteCarlo(150_000)])
    comparison.setMaximumEvaluations(None)
    comparison.run()
    assert comparison.getResult().getRows()[0].evaluations == 150_000
    for wrong in (0, 1.5):
        with pytest.raises(ValueError, match="the maximum of evaluations is"):
            comparison.setMaximumEvaluations(wrong)


def test_the_error_of_subset_sampling_is_that_of_repetitions():
    # Two modes far from each other: chains of one do not reach the other.
    function = ot.SymbolicFunction(["a", "b"], ["max(a, -a - 0.1)"])
    vector = ot.CompositeRandomVector(function, ot.RandomVector(ot.Normal(2)))
    event = ot.ThresholdEvent(vector, ot.Greater(), 3.5)
    rows = run(event, [c.SubsetSampling(1000)] * 40).getRows()
    probability = ot.Normal().computeComplementaryCDF(3.5) + ot.Normal().computeCDF(-3.6)
    errors = np.array([row.probability / probability - 1.0 for row in rows])
    claimed = np.mean([row.coefficient_of_variation for row in rows])
    assert 0.7 < claimed / np.sqrt(np.mean(errors**2)) < 2.5
    assert np.mean([row.lower95 <= probability <= row.upper95 for row in rows]) >= 0.9
    # A single level is crude Monte Carlo.
    row = run(ot.ThresholdEvent(vector, ot.Greater(), 0.5), [c.SubsetSampling(1000)]).getRows()[0]
    assert row.coefficient_of_variation == pytest.approx(np.sqrt((1.0 / row.probability - 1.0) / 1000.0), rel=0.05)
