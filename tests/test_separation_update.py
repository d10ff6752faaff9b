"""Ground tests of a case: their table, what they teach, the command, the section of the report."""

import dataclasses
import json
import math

import numpy as np
import openturns as ot
import pytest
from small_cases import MASS_AND_RATE, ROLLING, SMALL

from satsep_ot import cli
from satsep_ot.dynamics.simulation import simulate
from satsep_ot.methods.updating.experiments import MeasurementModel
from satsep_ot.methods.updating.two_level import normals
from satsep_ot.model.case import CaseError, load_case, parse_case
from satsep_ot.model.ground_tests import changed_inputs, parse_ground_tests
from satsep_ot.studies.separation_update import SeparationUpdate
from satsep_ot.studies.telling.plain_data import from_plain, to_plain
from satsep_ot.studies.telling.update_results import UpdateResult

HEADER = "test,quantity,value,sigma"
UPDATED = MASS_AND_RATE.replace("sigma = 0.03 }", 'sigma = 0.03, in_tests = "shared" }').replace(
    "sigma = 0.4 }", "sigma = 0.4, mean_uncertainty = 0.2, sigma_uncertainty = '10 %' }"
)
CASE = f"{SMALL}{UPDATED}{ROLLING}allowed_probability = 0.05\n"


def table(*rows, columns=""):
    return "\n".join([HEADER + columns, *rows])


@pytest.fixture
def case():
    return parse_case(CASE, "small.toml")


def test_keys_of_an_update_are_read_and_change_no_distribution(case):
    mass, rate = case.inputs
    assert (mass.is_shared_by_tests, mass.mean_uncertainty) == (True, 0.0)
    assert (rate.is_shared_by_tests, rate.mean_uncertainty) == (False, 0.2)
    assert rate.sigma_uncertainty == pytest.approx(0.04)
    plain = parse_case(f"{SMALL}{MASS_AND_RATE}{ROLLING}")
    assert [row.distribution for row in case.inputs] == [row.distribution for row in plain.inputs]
    assert not any(row.is_shared_by_tests or row.mean_uncertainty or row.sigma_uncertainty for row in plain.inputs)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ('in_tests = "often"', "in_tests = 'often', but it must be one of 'anew', 'shared'"),
        ("mean_uncertainty = -1.0", "mean_uncertainty = -1.0, but it must be"),
        ("sigma_uncertainty = 'many'", "sigma_uncertainty = 'many', but it must be"),
    ],
)
def test_wrong_keys_are_refused(keys, message):
    with pytest.raises(CaseError, match=message):
        parse_case(f"{SMALL}{MASS_AND_RATE.replace('sigma = 0.03', 'sigma = 0.03, ' + keys)}")


def test_a_sigma_that_is_not_there_cannot_be_uncertain():
    entry = 'distribution = "Student", nu = 1.5, mu = 1.0, sigma = 0.001, sigma_uncertainty = "10 %"'
    with pytest.raises(CaseError, match="sigma_uncertainty, but its distribution has no sigma"):
        parse_case(f'{SMALL}[inputs]\nmass = {{ quantity = "satellite.mass", {entry} }}')


def test_a_test_has_the_conditions_of_its_columns():
    case = load_case("reference")
    text = table(
        "dummy,axial_velocity,0.6,0.001,95,none,,0.5",
        "dummy,rate_x,0.1,0.01,95,none,,0.5",
        'three,axial_velocity,0.5,0.001,,,[4],""',
        "flight-like,axial_velocity,0.6,0.001,,,,",
        columns=",satellite.mass,orbit,springs.failed,initial.rates.x",
    ).replace('""', "")
    dummy, three, last = parse_ground_tests(text, case)
    assert dummy.separation.satellite.mass == 95.0
    assert dummy.separation.orbit is None
    assert dummy.separation.rates[0] == pytest.approx(math.radians(0.5))
    assert [row.quantity for row in dummy.rows] == ["axial_velocity", "rate_x"]
    assert list(three.separation.springs.scale) == [1.0, 1.0, 1.0, 0.0]
    assert last.separation is case.separation
    assert [case.inputs[i].name for i in changed_inputs(case, dummy.separation)] == ["satellite_mass", "rate_x"]


def test_a_test_may_have_fewer_springs_than_the_case():
    case = load_case("reference")
    [test] = parse_ground_tests(table("t,axial_velocity,0.5,0.01,3", columns=",springs.count"), case)
    assert len(test.separation.springs) == 3
    update = SeparationUpdate(case, [test], size=100)
    [experiment] = update._experiments
    found = experiment.model.evaluate([[row.reference for row in case.inputs]])[0, 0]
    assert found == pytest.approx(simulate(test.separation).quantity("axial_velocity")[0], rel=1e-12)


BAD_TABLES = {
    "": "the file is empty; it must have a header that begins",
    "test,quantity,value\nt,spin,1": "the column sigma is missing",
    "test,test,quantity,value,sigma\nt,t,rate_y,1,1": "the column test stands there twice",
    HEADER: "there is no test; give a row for each measured number",
    table("t,rate_y,0.1"): "row 2 has 3 cells, but it must have 4",
    table("t,rate_y,fast,0.1"): "row 2: value = 'fast', but it must be a finite number",
    table("t,rate_y,nan,0.1"): "row 2: value = 'nan', but it must be a finite number",
    table("t,rate_y,0.1,"): "row 2: sigma is missing",
    table("t,rate_y,0.1,0"): "row 2: sigma = '0', but it must be positive",
    table("t,rate_y,0.1,-1"): "row 2: sigma = '-1', but it must be positive",
    table(",rate_y,0.1,0.1"): "row 2: test = '', but it must be a name",
    table("t,rate_yy,0.1,0.1"): "is neither a quantity of this case nor an uncertain input; did you mean 'rate_y'",
    table("t,rate_y,0.1,0.1", "t,rate_y,0.2,0.1"): "row 3: quantity = 'rate_y' stands in row 2 too, for the same test",
    table("t,rate_y,0.1,0.1,x", columns=",springs"): "springs = 'x', but a whole table can only be none",
    table("t,rate_y,0.1,0.1,3", columns=",inputs.mean"): "inputs.mean is no key of the case",
    table("t,lateral_velocity,0.1,0.1"): "give axial_velocity and direction_x and direction_z",
    table("t,spin,0.1,0.1"): "'spin' has lost the signs of what it is made of, which the update needs; give rate_y",
    table("t,rate_y,0.1,0.1,5", columns=",satelite.mass"): "satelite.mass is no key of the case; did you mean",
    table("t,rate_y,0.1,0.1,heavy", columns=",satellite.mass"): "'heavy', but it must be a finite number",
    table("t,rate_y,0.1,0.1,-3", columns=",satellite.mass"): "the conditions are not possible",
    table("t,rate_y,0.1,0.1,2", "t,rate_y,0.1,0.1,3", columns=",satellite.mass"): "must have the same conditions",
    table("t,rate_y,0.1,0.1,[7]", columns=",springs.failed"): "springs.failed = [7], but it must be",
}  # fmt: skip


@pytest.mark.parametrize(("text", "message"), BAD_TABLES.items())
def test_bad_tables_are_refused_in_a_sentence(case, text, message):
    with pytest.raises(CaseError) as error:
        parse_ground_tests(text, case, "tests.csv")
    assert message in str(error.value)
    assert str(error.value).startswith("tests.csv: ")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (["t,rate_y,99,0.1"], "lies .* standard deviations from .* check its unit"),
        (["a,mass,0.99,0.0001", "b,mass,1.02,0.0001"], r"test [ab]: mass = .* contradicts the other tests \([ab]\)"),
    ],
)
def test_impossible_and_contradictory_tests_are_refused(case, rows, message):
    update = SeparationUpdate(case, parse_ground_tests(table(*rows), case), size=100)
    with pytest.raises(CaseError, match=message):
        update.run()


def made_up_campaign(case, text, seed):
    """The same tests with values that the case makes up, and the parameters that they were made up with."""
    ot.RandomGenerator.SetSeed(seed)
    update = SeparationUpdate(case, parse_ground_tests(text, case), size=200)
    model = MeasurementModel(update._inputs, update._experiments)
    truth = normals(1, model.parameterNumber)
    values = model.predict(truth)[0] + model.errors * normals(len(model.errors))
    rows = [
        f"{name},{quantity},{value!r},{error!r}"
        for (name, quantity), value, error in zip(
            model.labels, map(float, values), map(float, model.errors), strict=True
        )
    ]
    return table(*rows), update._inputs.valuesOf(truth)[0]


@pytest.fixture(scope="module")
def updated():
    case = parse_case(CASE, "small.toml")
    rows = [
        f"drop {k},{name},0,{sigma}" for k in range(8) for name, sigma in (("rate_y", 0.01), ("axial_velocity", 1e-4))
    ]
    text, truth = made_up_campaign(case, table(*rows), 3)
    update = SeparationUpdate(case, parse_ground_tests(text, case), size=200)
    update.run()
    return update, truth, text


def test_an_update_finds_the_truth_of_a_made_up_campaign(updated):
    update, truth, _ = updated
    result = update.getResult()
    assert [(row.name, row.kind) for row in result.learnt] == [
        ("mass", "value"),
        ("rate_y", "mean"),
        ("rate_y", "sigma"),
    ]
    for row, true in zip(result.learnt, truth, strict=True):
        assert abs(row.after - true) < 3.5 * row.after_sigma
        assert row.lower95 < row.after < row.upper95
    mass, rate, _ = result.learnt
    assert mass.after_sigma < 0.2 * mass.before_sigma
    assert rate.after_sigma < 0.9 * rate.before_sigma
    assert result.contradictions == ()
    assert result.sampling.converged


def test_probabilities_are_those_of_crude_monte_carlo_from_the_posterior(updated):
    update, _, _ = updated
    limits, flight = update._limits()
    [limit] = limits
    result = update.getResult().probabilities[0]
    for values, found in zip(update.getProbabilities("rolling"), (result.before, result.after), strict=True):
        assert np.mean(values) == pytest.approx(found.mean)
        assert np.quantile(np.array(values), 0.95) == pytest.approx(found.upper95)
        assert list(found.quantiles) == sorted(found.quantiles)
    parameters = update._updating.getResult().drawParameters(20_000)
    physical = update._inputs.toPhysical(parameters, normals(20_000, 1))
    crude = np.mean(limit.margin(flight.evaluate(physical)) < 0.0)
    assert result.after.mean == pytest.approx(crude, abs=0.15 * crude + 3.0 * math.sqrt(crude / 20_000))


def test_a_result_survives_json(updated):
    result = updated[0].getResult()
    text = json.dumps(to_plain(result), allow_nan=False)
    assert from_plain(UpdateResult, json.loads(text)) == result


def test_more_tests_and_counts_are_told(updated):
    [row] = updated[0].getResult().outlooks
    assert row.model_free == 59
    assert row.measured[0].number == row.counted[0].number == 0
    assert row.measured[-1].width < row.measured[0].width
    assert updated[0].getResult().next_test == "drop 7"


def test_a_graph_shows_both_distributions(updated):
    graph = updated[0].drawProbability("rolling")
    assert [drawable.getLegend() for drawable in graph.getDrawables()] == ["before", "after"]
    with pytest.raises(ValueError, match="is no requirement with a result"):
        updated[0].drawProbability("spinning")


def test_by_default_tests_teach_nothing_and_the_update_says_so():
    case = parse_case(f"{SMALL}{MASS_AND_RATE}{ROLLING}")
    update = SeparationUpdate(case, parse_ground_tests(table("t,rate_y,0.3,0.01", "t,mass,1.01,0.001"), case))
    update.run()
    result = update.getResult()
    assert result.learnt == ()
    assert "can teach nothing" in result.remarks[0]
    [probability] = result.probabilities
    assert probability.after.mean == probability.after.upper95
    assert probability.after.mean == pytest.approx(probability.before.mean, rel=0.1)


def test_further_pieces_teach_the_mean_of_their_batch():
    """Conjugate: twelve springs of sigma 55 N/m about a mean known to 55 N/m, measured to 5 N/m."""
    text = load_case("reference").text.replace(
        'stiffness = { quantity = "springs.stiffness.each", sigma = "1 %" }',
        'stiffness = { quantity = "springs.stiffness.each", sigma = "1 %", mean_uncertainty = "1 %" }',
    )
    case = parse_case(text)
    values = 5500.0 + 20.0 * np.arange(12)
    rows = [f"spring {k},stiffness,{value},5" for k, value in enumerate(values)]
    update = SeparationUpdate(case, parse_ground_tests(table(*rows), case), size=100)
    update._updating.run()
    k = [(row.name, row.kind) for row in update._inputs.getParameters()].index(("stiffness", "mean"))
    mean, sigma = (found[k] for found in update._updating.getResult().getMoments())
    precision = 1.0 / 55.0**2 + 12.0 / (55.0**2 + 25.0)
    assert sigma == pytest.approx(precision**-0.5, rel=1e-6)
    assert mean == pytest.approx((5500.0 / 55.0**2 + values.sum() / (55.0**2 + 25.0)) / precision, rel=1e-6)


def test_command_prints_tables_and_json_and_says_what_is_wrong(tmp_path, capsys, updated):
    case, tests = tmp_path / "small.toml", tmp_path / "tests.csv"
    case.write_text(CASE)
    tests.write_text(updated[2])
    assert cli.main(["update", str(case), str(tests), "--size", "100"]) == 0
    printed = capsys.readouterr().out
    for words in (
        "No contradiction between the case and 8 tests",
        "rolling",
        "mass value",
        "rate_y sigma",
        "more tests like drop 7",
    ):
        assert words in printed
    assert cli.main(["update", str(case), str(tests), "--size", "100", "--json", "--next", "drop 2"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["next_test"] == "drop 2"
    assert document["probabilities"][0]["after"]["upper95"] >= document["probabilities"][0]["after"]["lower95"]
    assert cli.main(["update", str(case), str(tmp_path / "none.csv")]) == 2
    assert "there is no such file" in capsys.readouterr().err
    assert cli.main(["update", str(case), str(tests), "--next", "drop 9"]) == 2
    assert "'drop 9' is no test with a measured velocity or rate" in capsys.readouterr().err
    assert cli.main(["update", str(case), str(tests), "--study", str(tmp_path)]) == 2
    assert "holds no results.json" in capsys.readouterr().err


def test_the_same_seed_gives_the_same_numbers(updated):
    case = parse_case(CASE)
    results = []
    for _ in range(2):
        update = SeparationUpdate(case, parse_ground_tests(updated[2], case), size=100, seed=5)
        update.run()
        results.append(update.getResult())
    assert results[0].probabilities == results[1].probabilities
    assert results[0].learnt == results[1].learnt


def test_the_report_of_a_study_has_a_section_on_the_tests(tmp_path, updated):
    case, tests = tmp_path / "small.toml", tmp_path / "tests.csv"
    case.write_text(CASE)
    tests.write_text(updated[2])
    study = str(tmp_path / "study")
    options = ["--runs", "2000", "--methods", "MonteCarlo", "--tolerances", "0"]
    assert cli.main(["study", str(case), "--output", study, *options]) == 0
    report = tmp_path / "study" / "report.html"
    assert 'id="ground-tests"' not in report.read_text()
    assert cli.main(["update", str(case), str(tests), "--size", "100", "--study", study]) == 0
    page = report.read_text()
    assert page.count('id="ground-tests"') == 1
    assert "What more tests would buy" in page
    assert cli.main(["report", study]) == 0
    assert 'id="ground-tests"' in report.read_text()
    (tmp_path / "study" / "update.json").write_text("{}")
    assert cli.main(["report", study]) == 2


def test_a_posterior_that_was_not_found_is_not_told_as_an_answer(updated):
    result = updated[0].getResult()
    failed = dataclasses.replace(result, sampling=dataclasses.replace(result.sampling, converged=False))
    assert failed.headline == (
        "The posterior from 8 tests could not be computed: no number after the tests is to be trusted."
    )
