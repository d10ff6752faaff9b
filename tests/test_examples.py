"""Every example, and every Python block of the README and of the pages in docs, runs as it stands."""

import re
import runpy
from pathlib import Path

import numpy as np
import openturns as ot
import pytest
from scipy.special import ndtr

from satsep_ot.dynamics.quantities import QUANTITIES
from satsep_ot.model.separation_function import SeparationFunction
from satsep_ot.model.separation_problem import SeparationProblem

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def run(example, capsys):
    """The names that an example leaves behind, and what it printed."""
    names = runpy.run_path(str(ROOT / "examples" / f"{example}.py"), run_name="__main__")
    return names, capsys.readouterr().out


def test_form_on_our_function(capsys):
    names, printed = run("form_on_our_function", capsys)
    # Nearly normal: mean and deviation of the velocity are 0.59788 and 0.00244 m/s.
    assert names["result"].getEventProbability() == pytest.approx(5e-4, rel=0.1)
    assert "satellite_mass" in printed


def test_active_subspace_of_a_borehole(capsys):
    names, printed = run("active_subspace_of_a_borehole", capsys)
    assert names["result"].getQ2LeaveOneOut()[0] > 0.95
    assert "activity score of rw" in printed.splitlines()[1]


def test_failure_probability_of_a_beam(capsys):
    names, printed = run("failure_probability_of_a_beam", capsys)
    interval, share = names["interval"], names["share"]
    assert interval.getLowerBound()[0] < share < interval.getUpperBound()[0]
    assert names["result"].getConverged()
    assert "95 % interval" in printed


def test_active_subspaces_of_use_cases(capsys):
    names, printed = run("active_subspaces_of_use_cases", capsys)
    assert all(score > 0.9 for _, score in names["results"].values())
    assert printed.count("Q2 of one active variable") == 3


def test_external_simulator(capsys):
    names, printed = run("external_simulator", capsys)
    result = names["result"]
    assert result.getConverged()
    probability, failures, mean, spread = oscillator_failures()
    error = np.hypot(result.getCoefficientOfVariation(), 1.0 / np.sqrt(failures))
    assert abs(result.getProbabilityEstimate() / probability - 1.0) < 4.0 * error
    rows = result.computeImportance(0.999)
    assert [row.input for row in rows] == ["mass", "stiffness", "damping", "force", "duration"]
    # What the failures of the sample say, with the error of the sample itself.
    for row, shift, sigma in zip(rows, mean, spread, strict=True):
        slack = 4.0 * sigma / np.sqrt(failures)
        assert row.shiftLower - slack < shift < row.shiftUpper + slack
        assert row.spreadLower - slack < sigma < row.spreadUpper + slack
    entropies = 0.5 * (mean**2 + spread**2 - 1.0) - np.log(spread)
    np.testing.assert_allclose([row.share for row in rows], entropies / entropies.sum(), atol=0.1)
    # The force drives more than half of it, more than twice as much as any other input.
    assert "force" in printed.splitlines()[2]


def oscillator_failures(size=300_000):
    """Of the oscillator of the example by crude Monte Carlo: P(peak > 0.15 m), the number of failures, and mean and
    deviation of the inputs' standard normal images in failure."""
    z = np.random.default_rng(0).standard_normal((size, 5))
    spread = np.sqrt(np.log1p(0.025**2))
    mass = 2.0 * np.exp(spread * z[:, 0] - 0.5 * spread**2)
    stiffness, force = 200.0 + 10.0 * z[:, 1], 15.0 + z[:, 3]
    damping, duration = 1.0 + 2.0 * ndtr(z[:, 2]), 0.18 + 0.04 * ndtr(z[:, 4])
    x, v, peak, step = np.zeros(size), np.zeros(size), np.zeros(size), 2e-3
    # The first half period holds the peak.
    for k in range(300):
        v += step * (np.where(k * step < duration, force, 0.0) - stiffness * x - damping * v) / mass
        x += step * v
        np.maximum(peak, x, out=peak)
    failed = z[peak > 0.15]
    return len(failed) / size, len(failed), failed.mean(axis=0), failed.std(axis=0)


def test_other_distributions_and_copula(capsys):
    names, printed = run("other_distributions_and_copula", capsys)
    independent, clayton = (names["probabilities"][label] for label in ("independent", "Clayton"))
    # Springs that are weak together make slow separations more likely.
    assert clayton.getConfidenceInterval().getLowerBound()[0] > independent.getConfidenceInterval().getUpperBound()[0]
    assert "Clayton" in printed


def test_anything_that_goes_wrong(capsys):
    names, printed = run("anything_that_goes_wrong", capsys)
    problem, results = names["problem"], names["results"]
    assert list(results) == ["lateral rate", "spin", "axial velocity", "any requirement"]
    # Every requirement counted by its own limit, on runs of our own.
    ot.RandomGenerator.SetSeed(1)
    outputs = problem.getFunction()(problem.getDistribution().getSample(100_000))
    columns = {name.split(" ")[0]: k for k, name in enumerate(outputs.getDescription())}
    values = np.array(outputs)
    violated = {
        entry.name: [not entry.is_met(value) for value in values[:, columns[entry.quantity]]]
        for entry in problem.getRequirements()
    }
    violated["any requirement"] = np.any(list(violated.values()), axis=0)
    for name, result in results.items():
        probability = result.getProbabilityEstimate()
        assert abs(np.mean(violated[name]) - probability) < 4.0 * np.sqrt(probability / 100_000), name
    assert "components: rate_x [deg/s], rate_z [deg/s], rate_y [deg/s], axial_velocity [m/s]" in printed


def test_save_and_load(capsys):
    names, printed = run("save_and_load", capsys)
    assert names["same_spin"]
    assert names["same_surrogate"]
    assert names["whole"].getProbabilityEstimate() == names["result"].getProbabilityEstimate()
    assert names["result_again"].getProbabilityEstimate() == names["result"].getProbabilityEstimate()
    assert "dimension 35" in printed
    assert "same intervals True" in printed
    assert "same coefficients True" in printed


def test_sensitivity_analysis(capsys):
    names, printed = run("sensitivity_analysis", capsys)
    first = {names["names"][index] for index in names["strongest"]}
    assert {"satellite_cg_x", "satellite_cg_z"} <= first
    # Four corners share one minimum: first-order effects leave a part to interactions, which total indices count twice.
    assert sum(names["sobol"].getFirstOrderIndices()) < 1.0 < sum(names["total"])
    assert "HSIC" in printed


def test_calibration_of_the_springs(capsys):
    names, printed = run("calibration_of_the_springs", capsys)
    for true, found, deviation in names["found"].values():
        assert abs(true - found) < 3.0 * deviation
    assert names["found"]["1 - 3"][2] < 2.0
    assert printed.count("before 5500 +- 55") == 4


def test_ground_tests_of_a_separation(capsys):
    names, printed = run("ground_tests_of_a_separation", capsys)
    learnt = {(row.name, row.kind): row for row in names["result"].learnt}
    for (name, _), row in learnt.items():
        assert abs(row.after - names["truth"][name]) < 3.0 * row.after_sigma
    assert learnt["stiffness", "mean"].after_sigma < 0.6 * learnt["stiffness", "mean"].before_sigma
    assert learnt["satellite_cg_x", "value"].after_sigma < 0.6 * learnt["satellite_cg_x", "value"].before_sigma
    for row in names["result"].probabilities[:4]:
        assert f"{row.requirement:15} before" in printed
    assert names["result"].contradictions == ()


def test_benchmark_study(capsys):
    names, _ = run("benchmark_study", capsys)
    errors = {(problem, method): error for problem, method, _, error, _ in names["table"]}
    assert errors["P5", "ActiveSubspace"] < 0.2
    # The failure of P5 is the outside of a sphere: one design point sees next to nothing of it.
    assert errors["P5", "FORM"] > 0.9


def test_pandas_in_and_out(capsys):
    names, printed = run("pandas_in_and_out", capsys)
    assert names["both"].shape == (500, 35 + len(names["outputs"].columns))
    assert names["correlations"].index[0].startswith("satellite_cg_x")
    assert "fitted to 500 masses: Normal(mu = 10" in printed


@pytest.mark.slow
def test_three_limits_of_an_optical_bench(capsys):
    names, printed = run("three_limits_of_an_optical_bench", capsys)
    assert names["killed"]
    assert names["kept"] > 20
    model = {}
    exec(names["MODEL"].replace("time.sleep", "abs"), model)
    ot.RandomGenerator.SetSeed(0)
    values = model["bench"](np.array(model["law"]().getSample(1_000_000)))
    truths = {
        "tilt": (np.hypot(values[:, 0], values[:, 1]) > 33.0).mean(),
        "focus": (np.abs(values[:, 2]) > 10.0).mean(),
        "stress": (values[:, 3] > 32.0).mean(),
    }
    ratios = {}
    for limit, truth in truths.items():
        row = names["table"].loc[(limit, "ActiveSubspace")]
        slack = 4.0 * np.sqrt(truth / 1e6)
        assert row["lower95"] - slack < truth < row["upper95"] + slack
        ratios[limit] = names["table"].loc[(limit, "FORM"), "probability"] / truth
    # What the title says.
    assert ratios["tilt"] < 0.3
    assert ratios["focus"] < 0.8
    assert 0.8 < ratios["stress"] < 1.25
    assert r"coefficient\_of\_variation" in names["latex"]
    assert printed.count("FORM gives") == 3


@pytest.mark.slow
def test_slow_model_on_many_workers(capsys):
    names, printed = run("slow_model_on_many_workers", capsys)
    assert all(np.array_equal(values, names["values"][1]) for values in names["values"].values())
    assert names["seconds"][8] < 0.5 * names["seconds"][1]
    generator = np.random.default_rng(0)
    spread = np.sqrt(np.log1p(np.array([0.1, 3.0 / 67.0, 0.02]) ** 2))
    logarithms = generator.normal(np.log([30e3, 6.7e10, 1.5e-5]) - 0.5 * spread**2, spread, (400_000, 3))
    force, modulus, inertia = np.exp(logarithms).T
    failed = force * generator.normal(2.5, 0.01, 400_000) ** 3 / (3.0 * modulus * inertia) > 0.21
    result = names["result"]
    error = np.hypot(result.getCoefficientOfVariation(), 1.0 / np.sqrt(np.count_nonzero(failed)))
    assert abs(result.getProbabilityEstimate() / failed.mean() - 1.0) < 4.0 * error
    assert "rows 40 to 43 could not be computed in 3 attempts" in printed


def test_fine_and_coarse_model(capsys):
    names, printed = run("fine_and_coarse_model", capsys)
    alone, both = (names["results"][name] for name in ("fine model alone", "fine and coarse model"))
    assert both.getConverged()
    assert both.getEvaluationNumber() < alone.getEvaluationNumber()
    # The highest point in closed form, where the speed is 0.
    ot.RandomGenerator.SetSeed(1)
    z0, v0, m, c = np.array(names["fall"].distribution.getSample(4_000_000)).T
    tau, end = m / c, -names["GRAVITY"] * m / c
    failures = np.count_nonzero(z0 + tau * v0 + end * tau * np.log1p(-v0 / end) > names["THRESHOLD"])
    error = np.hypot(both.getCoefficientOfVariation(), 1.0 / np.sqrt(failures))
    assert abs(both.getProbabilityEstimate() / (failures / 4_000_000) - 1.0) < 4.0 * error
    assert "correlation of the two models 0.9998" in printed


@pytest.mark.slow
def test_mujoco_second_simulator(capsys):
    pytest.importorskip("mujoco")
    names, printed = run("mujoco_second_simulator", capsys)
    alone, both = names["results"].values()
    assert both.getConverged()
    assert both.getEvaluationNumber() < 0.6 * alone.getEvaluationNumber()
    difference = np.log(both.getProbabilityEstimate() / alone.getProbabilityEstimate())
    assert abs(difference) < 3.0 * np.hypot(both.getCoefficientOfVariation(), alone.getCoefficientOfVariation())
    assert "rate_x [deg/s]: correlation of the two simulators 0.99" in printed
    # Without stiffness across the springs the two simulators are one, but for the impacts.
    case, rates = names["SeparationProblem"]("reference").getCase(), names["satellite_rates"]
    rates.__globals__["LATERAL"] = 0.0
    model = SeparationFunction(case, quantities=["rate_x", "rate_z"], countsEndings=True)
    ot.RandomGenerator.SetSeed(2)
    sample = np.array(SeparationProblem(case).getDistribution().getSample(10))
    parameters = names["ParameterMap"](case.inputs, case.separation).parameters(sample)
    found = np.array([rates(case.separation.with_parameters(row)) for row in parameters])
    np.testing.assert_allclose(found, model.evaluate(sample), atol=5e-3)


def test_mujoco_second_simulator_without_mujoco(capsys, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name, *rest: None)
    names, printed = run("mujoco_second_simulator", capsys)
    assert names["results"] == {}
    assert "MuJoCo is not installed, and this example needs it" in printed


def test_every_example_is_tested():
    tested = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    assert {path.stem for path in EXAMPLES} <= tested


def python_blocks(page):
    """The Python code of a page, block by block."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


CONTINUES = "# continues the block above\n"


def python_sessions(page):
    """The blocks of a page, joined where one says that it continues the block above: each stands alone."""
    sessions = []
    for block in python_blocks(page):
        if block.startswith(CONTINUES):
            sessions[-1].append(block)
        else:
            sessions.append([block])
    return sessions


SESSIONS = [
    pytest.param(page, session, id=f"{page.name}-{place}")
    for page in PAGES
    for place, session in enumerate(python_sessions(page), start=1)
]


@pytest.mark.parametrize(("page", "session"), SESSIONS)
def test_python_blocks_run(page, session, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    quantities = dict(QUANTITIES)
    state = ot.RandomGenerator.GetState()
    names = {"__name__": page.stem}
    try:
        for block in session:
            exec(compile(block, str(page), "exec"), names)
    finally:
        # A page may show how to add a quantity.
        QUANTITIES.clear()
        QUANTITIES.update(quantities)
        ot.RandomGenerator.SetState(state)
    assert capsys.readouterr().out or "print(" not in "".join(session)


def test_readme_has_the_two_commands_on_a_line_each():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    for command in (
        "python3 -m venv .venv && .venv/bin/pip install . && .venv/bin/satsep-ot study",
        "python3 -m venv .venv && .venv/bin/pip install '.[test]' && .venv/bin/pytest",
    ):
        assert command in lines


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
        if not target.startswith("https://"):
            assert (page.parent / target).exists(), f"{page.name} links to {target}, which does not exist"


def test_the_page_on_benchmarks_names_every_script():
    text = (ROOT / "docs" / "benchmarks.md").read_text(encoding="utf-8")
    assert [path.name for path in (ROOT / "tests" / "benchmarks").glob("*.py") if path.name not in text] == []


def assert_same_estimate(found, shown):
    """Two rows (probability, lower and upper bound, runs) of the same estimate on machines that round differently.

    Rounding decides where the next runs go, so that the two are as far from each other as two seeds may be.
    """
    (p, lower, upper, runs), (shown_p, shown_lower, shown_upper, shown_runs) = found, shown
    # Three standard deviations of the difference.
    assert abs(p - shown_p) < 3.0 / 1.96 * 0.5 * np.hypot(upper - lower, shown_upper - shown_lower)
    assert upper / lower == pytest.approx(shown_upper / shown_lower, rel=0.05)
    assert runs == pytest.approx(shown_runs, rel=0.2)


def test_the_script_of_the_readme_prints_what_the_readme_says(capsys):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    exec(compile(python_blocks(ROOT / "README.md")[0], "README.md", "exec"), {})
    number = r"([\d.]+(?:e-\d+)?)"
    pattern = re.compile(
        rf"ActiveSubspaceReliabilityResult\n  probability: {number}\n  interval: \[{number}, {number}\]\n"
        r"  evaluations: (\d+)\n  converged: True\n"
    )
    found, shown = (
        [float(entry) for entry in pattern.search(part).groups()] for part in (capsys.readouterr().out, text)
    )
    assert_same_estimate(found, shown)


def test_what_is_said_of_ten_studies_is_what_they_gave(capsys):
    """In the README and in docs/validation.md, from the intervals that are stored."""
    path = ROOT / "tests" / "benchmarks" / "study_overlap"
    study_overlap = runpy.run_path(str(path.with_suffix(".py")))
    study_overlap["print_truth"](study_overlap["stored_estimates"](path.with_suffix(".txt")))
    printed = capsys.readouterr().out
    readme, validation = (ROOT / page for page in ("README.md", "docs/validation.md"))
    counts = re.findall(r"^(\w+): (\d+) of 50 .* probability (\S+)\n((?:  .*\n)*)", printed, re.MULTILINE)
    assert [method for method, *_ in counts] == ["ActiveSubspace", "MonteCarlo"]
    for method, count, chance, misses in counts:
        assert f"{count} of 50 of {method}" in " ".join(readme.read_text(encoding="utf-8").split())
        found = re.findall(r"seed (\d+), (.*): it lies (\w+),", misses)
        cases = "; ".join(f"{seed} {requirement}, {side}" for seed, requirement, side in found)
        assert f"| {method} | {count} | {cases} | {chance} |" in validation.read_text(encoding="utf-8")
    assert printed in path.with_suffix(".txt").read_text(encoding="utf-8")


def test_the_readme_says_which_of_its_intervals_hold_the_truth():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    screen = re.search(r"<!-- screen: begin -->\n```text\n(.*?)\n```", text, re.DOTALL)[1]
    table = runpy.run_path(str(ROOT / "docs" / "update_readme.py"))["truth_table"](screen)
    assert f"<!-- truth: begin -->\n{table}\n<!-- truth: end -->" in text


@pytest.mark.slow
def test_the_screen_of_the_readme_is_what_a_study_prints():
    """The rows of ActiveSubspace, which do not depend on the other rows of the table."""
    from satsep_ot.model.separation_problem import SeparationProblem
    from satsep_ot.studies.separation_study import SeparationStudy
    from satsep_ot.studies.telling.tolerance_curves import Curves

    screen = re.search(r"<!-- screen: begin -->(.*?)<!-- screen: end -->", (ROOT / "README.md").read_text(), re.DOTALL)[
        1
    ]
    shown = re.findall(r"ActiveSubspace +(\S+) +([^.\s]+\.[^.\s]+)\.\.(\S+) +([\d,]+)", screen)
    # Advice on tolerances takes more precision than a verdict; the rest of what it takes is not looked at here.
    study = SeparationStudy(
        SeparationProblem("reference"),
        ["ActiveSubspace"],
        seed=0,
        sampleSize=10_000,
        toleranceSize=1,
        curves=Curves.NONE,
    )
    study.run()
    rows = [
        (row.probability, row.lower95, row.upper95, float(row.evaluations))
        for row in study.getResult().rows
        if row.method == "ActiveSubspace"
    ]
    assert len(rows) == len(shown) == 5
    for row, numbers in zip(rows, shown, strict=True):
        assert_same_estimate(row, [float(number.replace(",", "")) for number in numbers])
