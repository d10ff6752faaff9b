"""The command line: what it prints, its exit codes, and one sentence instead of a traceback."""

import io
import json
import re
import signal
import subprocess
import sys
import time

import pytest
from small_cases import SMALL

import satsep_ot
from satsep_ot import cli
from satsep_ot.commands import printing, simulate
from satsep_ot.methods.parallel.chunks import ChunkError
from satsep_ot.model.case import load_case
from satsep_ot.model.schema import case_schema
from satsep_ot.model.separation_function import SeparationError


def small(tmp_path, extra=""):
    path = tmp_path / "small.toml"
    path.write_text(SMALL + extra, encoding="utf-8")
    return str(path)


def refused(arguments, capsys, code=2):
    """The one line on stderr of a command that is refused."""
    assert cli.main(arguments) == code
    captured = capsys.readouterr()
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("satsep-ot: ")
    return captured.err


def test_new_writes_a_case_that_loads_and_never_overwrites(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    assert cli.main(["new", str(path)]) == 0
    assert "satsep-ot check" in capsys.readouterr().out
    case = load_case(path)
    assert case.name == "mine"
    assert len(case.inputs) == 35
    path.write_text("precious", encoding="utf-8")
    assert "exists already and is not overwritten" in refused(["new", str(path)], capsys)
    assert path.read_text(encoding="utf-8") == "precious"


def test_new_writes_the_schema_beside_the_case_and_names_it_there(tmp_path, capfd):
    path, schema = tmp_path / "mine.toml", tmp_path / "mine.schema.json"
    assert cli.main(["new", str(path)]) == 0
    printed = capfd.readouterr()
    assert "mine.schema.json" in printed.out
    assert printed.err == ""
    assert path.read_text(encoding="utf-8").startswith("#:schema ./mine.schema.json\n")
    assert json.loads(schema.read_text(encoding="utf-8")) == case_schema()
    # The schema of a case that was deleted is taken as it is; a file of another kind is left alone.
    path.unlink()
    assert cli.main(["new", str(path)]) == 0
    path.unlink()
    schema.write_bytes(b"\xff precious")
    assert "mine.schema.json exists already and is not overwritten" in refused(["new", str(path)], capfd)
    assert schema.read_bytes() == b"\xff precious"
    assert not path.exists()


def test_new_where_nothing_can_be_written(tmp_path, capsys):
    assert "nowhere" in refused(["new", str(tmp_path / "nowhere" / "mine.toml")], capsys)


def test_check_prints_the_case_as_understood(capsys):
    assert cli.main(["check", "reference"]) == 0
    out = capsys.readouterr().out
    for words in (
        "inertia xx, yy, zz, xy, xz, yz", "1500, 600, 1500, 0, 0, 0", "0, -1600, 0", "Springs (guided)", "315",
        "Spring energy 16.5 J", "enough for 0.597913 m/s", "Orbit: position 6878.14, 0, 0 km",
        "Period 94.6163 min; J2 off in the coast", "8 points, 4 of them in the recess",
        "Envelope: recess radius 520 mm",
        "Uncertain inputs (35)", "satellite_Ixx", "Normal(mu = 1500, sigma = 45)", "1360.94", "1639.06",
        "0.597912", "lateral_rate <= 2.5 deg/s", "axial_velocity >= 0.59 m/s", "18.2..25", "1014 of 1024",
        "1,024 scattered runs only show where the limits are. For the probability of violating each requirement run "
        "`satsep-ot study reference`.",
    ):  # fmt: skip
        assert words in out, words
    assert "598 met" in out
    assert not re.search(r"[0-9] violated", out)


def test_check_says_which_requirement_the_nominal_run_violates(tmp_path, capsys):
    extra = '[[requirements]]\nname = "fast"\nquantity = "axial_velocity"\nminimum = 5\nallowed_probability = 1e-3\n'
    assert cli.main(["check", small(tmp_path, extra)]) == 0
    out = capsys.readouterr().out
    assert re.search(r"0\.257 violated +none +0\.001", out)
    assert "The nominal run shows where the limits are" in out
    assert "No gravity" in out


def test_names_with_brackets_are_printed_as_they_are(tmp_path, capsys):
    extra = '[inputs]\n"mass [red]" = { quantity = "satellite.mass", sigma = 0.01 }\n'
    assert cli.main(["check", small(tmp_path, extra)]) == 0
    assert "mass [red]" in capsys.readouterr().out


def test_simulate_in_words(capsys):
    assert cli.main(["simulate"]) == 0
    out = capsys.readouterr().out
    assert "0.59791" in out
    assert "spring 4 released at 85.381" in out
    # K L (xi - L / 2) of one spring; gravity adds a part in ten million.
    assert out.count("work 4.125 J") == 4
    assert "Kinetic energy gained 16.49" in out


def test_simulate_as_json(tmp_path, capsys):
    assert cli.main(["simulate", small(tmp_path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["case"] == "small"
    assert document["status"] == "OK"
    # E = sum K L (xi - L / 2) = 0.03 J and v = sqrt(2 E / mu_r).
    assert document["quantities"]["axial_velocity"] == pytest.approx((0.06 * 1.1) ** 0.5, rel=1e-8)
    assert document["units"]["axial_velocity"] == "m/s"
    assert len(document["release_times"]) == 2


def test_a_separation_that_cannot_be_simulated(tmp_path, capsys):
    path = small(tmp_path).replace("small", "slow")
    with open(path, "w", encoding="utf-8") as stream:
        stream.write("horizon = 0.01\n" + SMALL)
    assert cli.main(["simulate", path, "--json"]) == 1
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    assert document["status"] == "NO_RELEASE"
    assert document["quantities"]["axial_velocity"] is None
    assert captured.err.startswith("satsep-ot: the nominal separation cannot be simulated: ")


def test_check_of_a_separation_that_cannot_be_simulated(tmp_path, capsys):
    extra = '[[requirements]]\nquantity = "axial_velocity"\nminimum = 0.1\n'
    path = small(tmp_path, extra)
    with open(path, encoding="utf-8") as stream:
        text = stream.read()
    with open(path, "w", encoding="utf-8") as stream:
        stream.write("horizon = 0.01\n" + text)
    assert cli.main(["check", path]) == 1
    captured = capsys.readouterr()
    assert "unknown" in captured.out
    assert "cannot be simulated" in captured.err


@pytest.mark.parametrize("command", ["check", "simulate", "study"])
def test_bad_cases_are_one_sentence(command, tmp_path, capsys):
    assert "there is no such file" in refused([command, "nothing.toml"], capsys)
    path = small(tmp_path).replace("small", "bad")
    with open(path, "w", encoding="utf-8") as stream:
        stream.write(SMALL.replace("mass = 10", "mas = 10"))
    assert "platform.mas is not a known key; did you mean 'mass'?" in refused([command, path], capsys)


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["compare"],
        ["report"],
        ["study", "--seed", "-1"],
        ["study", "--runs", "0"],
        ["study", "--precision", "0.001"],
        ["study", "--precision", "fine"],
        ["study", "--methods", "Guess"],
    ],
)
def test_wrong_arguments(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(arguments)
    assert caught.value.code == 2
    assert "usage: satsep-ot" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["new"], ["check"], ["simulate"], ["study"], ["report"]])
def test_help_has_examples(arguments, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main([*arguments, "--help"])
    assert caught.value.code == 0
    out = capsys.readouterr().out
    assert "examples:\n  satsep-ot " in out
    assert "exit codes: 0 success" in out


def test_version(capsys):
    with pytest.raises(SystemExit):
        cli.main(["--version"])
    assert capsys.readouterr().out == f"satsep-ot {satsep_ot.__version__}\n"


def test_study_writes_results_and_says_where_form_fails(tmp_path, capsys):
    """Two cheap methods on a small case: a table, results.json with the documented keys, and figures."""
    scatter = (
        '[inputs]\nmass = { quantity = "satellite.mass", sigma = 0.05 }\n'
        'rate_y = { quantity = "initial.rates.y", sigma = 0.4 }\n'
        '[[requirements]]\nname = "rolling"\nquantity = "spin"\nmaximum = 1.0\n'
    )
    output = tmp_path / "results"
    arguments = ["study", small(tmp_path, scatter), "--output", str(output), "--seed", "7"]
    assert cli.main([*arguments, "--runs", "20000", "--methods", "FORM", "MonteCarlo"]) == 0
    captured = capsys.readouterr()
    # The limit of +-2.5 standard deviations has two sides, of which FORM sees one.
    assert "rolling: FORM gives 6.21e-3 (2." in captured.out
    assert "times too low" in captured.out
    assert "20,000 Monte Carlo runs" in captured.err
    results = json.loads((output / "results.json").read_text(encoding="utf-8"))
    assert results["case"] == "small"
    assert results["seed"] == 7
    assert [(row["requirement"], row["method"]) for row in results["rows"]] == [
        (requirement, method) for requirement in ("rolling", "any requirement") for method in ("FORM", "MonteCarlo")
    ]
    assert list(results["rows"][0]) == [
        "requirement", "method", "probability", "lower95", "upper95", "coefficient_of_variation", "evaluations",
        "gradients", "seconds", "converged", "note", "audits", "audit_spread",
        "upper_together",
    ]  # fmt: skip
    assert {path.name for path in output.iterdir()} == {
        "results.json", "motion.json", "case.toml", "figures", "report.html", "origin.json", "manifest.json", "runs",
        "steps",
    }  # fmt: skip
    figures = {figure["file"] for figure in results["figures"]}
    assert {path.name for path in (output / "figures").iterdir()} == figures
    assert "open " + str(output / "report.html") in captured.out
    # The same directory again: refused, with what can be done, before anything is run or changed.
    settings = ["--runs", "20000", "--methods", "FORM", "MonteCarlo"]
    before = {path: path.read_bytes() for path in output.rglob("*") if path.is_file()}
    assert "holds this study already: --resume continues" in refused([*arguments, *settings], capsys)
    assert "with seed = 7 instead of 8" in refused([*arguments[:-1], "8", *settings, "--resume"], capsys)
    assert "with methods = FORM MonteCarlo instead of FORM" in refused([*arguments, *settings[:-1]], capsys)
    other = small(tmp_path, scatter.replace("0.4", "0.5"))
    refusal = refused(["study", other, *arguments[2:], *settings, "--resume"], capsys)
    assert "of another case: give another directory, or --overwrite to lose that one" in refusal
    refusal = refused(["study", other, "--output", str(tmp_path)], capsys)
    assert "holds other files, such as" in refusal
    assert {path: path.read_bytes() for path in output.rglob("*") if path.is_file()} == before
    with pytest.raises(SystemExit):
        cli.main([*arguments, "--resume", "--overwrite"])
    assert "not allowed with argument --resume" in capsys.readouterr().err
    # Another case in its place, only when that is said.
    assert cli.main(["study", other, *arguments[2:], *settings[:-1], "--overwrite"]) == 0
    results = json.loads((output / "results.json").read_text(encoding="utf-8"))
    assert [row["method"] for row in results["rows"]] == ["FORM", "FORM"]
    assert "0.5" in (output / "case.toml").read_text(encoding="utf-8")


ROLLING = (
    '[inputs]\nmass = { quantity = "satellite.mass", sigma = 0.05 }\n'
    'rate_y = { quantity = "initial.rates.y", sigma = 0.4 }\n'
    '[[requirements]]\nname = "rolling"\nquantity = "spin"\nmaximum = 1.0\nallowed_probability = 1e-3\n'
)


def test_study_says_by_its_exit_code_that_a_requirement_is_not_met(tmp_path, capsys):
    output = tmp_path / "results"
    arguments = [
        "study",
        small(tmp_path, ROLLING),
        "--output",
        str(output),
        "--runs",
        "5000",
        "--methods",
        "MonteCarlo",
    ]
    assert cli.main([*arguments, "--fail-unless-met", "--json"]) == 3
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    assert document == json.loads((output / "results.json").read_text(encoding="utf-8"))
    assert document["verdicts"][0]["status"] == "not met"
    assert "not every requirement is met" in captured.err


def test_interrupted_study_stops_and_says_what_it_kept(tmp_path, monkeypatch, capsys):
    from satsep_ot.studies.separation_study import SeparationStudy
    from satsep_ot.studies.steps import StudySteps

    run, done = StudySteps.estimate, []

    def interrupt_the_second(study, *arguments):
        if done:
            raise KeyboardInterrupt
        done.append(arguments)
        return run(study, *arguments)

    monkeypatch.setattr(StudySteps, "estimate", interrupt_the_second)
    output = tmp_path / "results"
    arguments = ["study", small(tmp_path, ROLLING), "--output", str(output), "--runs", "1000", "--methods"]
    assert cli.main([*arguments, "FORM", "SORM"]) == 130
    said = capsys.readouterr().err.splitlines()[-1]
    kept = f"what was finished is kept in {output}: the same command with --resume continues from there"
    assert said == f"satsep-ot: interrupted; {kept}"
    results = json.loads((output / "results.json").read_text(encoding="utf-8"))
    assert results["complete"] is False
    assert [(row["requirement"], row["method"]) for row in results["rows"]] == [("rolling", "FORM")]
    assert cli.main(["report", str(output)]) == 2
    # What was finished is not made again.
    monkeypatch.undo()
    monkeypatch.setattr(SeparationStudy, "_runSample", None)
    assert cli.main([*arguments, "FORM", "SORM", "--resume"]) == 0
    results = json.loads((output / "results.json").read_text(encoding="utf-8"))
    assert results["complete"] is True
    assert len(results["rows"]) == 4


def test_ctrl_c_stops_the_program(tmp_path):
    """A signal in the middle of the Monte Carlo sample, to the program as a user runs it."""
    command = [sys.executable, "-m", "satsep_ot", "study", small(tmp_path, ROLLING), "--output", str(tmp_path / "out")]
    with subprocess.Popen(
        [*command, "--runs", "100000000"], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        while "Monte Carlo runs" not in process.stderr.readline():
            assert process.poll() is None
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        said = process.stderr.readline()
        _, errors = process.communicate(timeout=60)
    assert process.returncode == 130
    assert said.startswith(f"satsep-ot: interrupted; what was finished is kept in {tmp_path / 'out'}: ")
    assert errors == ""


def test_check_cuts_nothing_at_80_columns(capsys, monkeypatch):
    from rich.console import Console

    monkeypatch.setattr("satsep_ot.commands.check.console", lambda: Console(width=80, highlight=False))
    assert cli.main(["check", "reference"]) == 0
    out = capsys.readouterr().out
    assert "…" not in out
    assert max(map(len, out.splitlines())) <= 80
    rows = [line.split() for line in out.splitlines()]
    for row in load_case("reference").inputs:
        assert [row.name, *row.unit.split()] in [words[: 1 + len(row.unit.split())] for words in rows], row.name
    assert ["satellite_mass", "kg", "98.4549", "101.545"] in [words[:4] for words in rows]


def test_no_header_breaks_within_a_word_at_80_columns(tmp_path, capsys, monkeypatch):
    from rich.console import Console

    monkeypatch.setattr("satsep_ot.commands.check.console", lambda: Console(width=80, highlight=False))
    path = tmp_path / "mine.toml"
    text = load_case("reference").text.replace("stroke = 30.0", "stroke = 30.0\ntable = [[0, 220], [30, 55]]", 1)
    connector = (
        "[umbilical]\nangle = 20.0\nradius = 250.0\nstiffness = 2500.0\ndeformation = 10.0\nstroke = 8.0\n"
        "friction = 25.0\nengagement = 6.0\n"
    )
    inputs = re.sub(r"^(stiffness|deformation) = \{.*\n", "", text, flags=re.MULTILINE)
    inputs = re.sub(r"^(stiffness|deformation) = \d.*\n", "", inputs, flags=re.MULTILINE)
    path.write_text(inputs.replace("[inputs]", connector + "[inputs]", 1), encoding="utf-8")
    assert cli.main(["check", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith("Springs"))
    assert lines[start + 1].split() == [
        "angle", "radius", "stiffness", "deformation", "stroke", "cant", "delay",
    ]  # fmt: skip
    # A force from a table has neither stiffness nor deformation.
    assert lines[start + 4].split()[:5] == ["1", "45", "300", "–", "–"]
    start = next(k for k, line in enumerate(lines) if line.startswith("Umbilical"))
    assert lines[start + 1].split() == [
        "angle", "radius", "stiffness", "deformation", "stroke", "friction", "engagement",
    ]  # fmt: skip
    assert max(map(len, lines)) <= 80


def test_study_refuses_a_directory_that_cannot_be_made(tmp_path, capsys):
    scatter = (
        '[inputs]\nmass = { quantity = "satellite.mass", sigma = 0.01 }\n'
        '[[requirements]]\nname = "speed"\nquantity = "axial_velocity"\nminimum = 0.1\n'
    )
    path = small(tmp_path, scatter)
    assert "Not a directory" in refused(["study", path, "--output", path + "/below"], capsys)


def test_study_refuses_a_file_as_its_directory(tmp_path, capsys):
    scatter = (
        '[inputs]\nmass = { quantity = "satellite.mass", sigma = 0.01 }\n'
        '[[requirements]]\nname = "speed"\nquantity = "axial_velocity"\nminimum = 0.1\n'
    )
    path = small(tmp_path, scatter)
    assert "is not a directory" in refused(["study", path, "--output", path], capsys)


def test_interruption_has_its_exit_code(monkeypatch, capsys):
    def interrupt(options):
        raise KeyboardInterrupt

    monkeypatch.setattr(simulate, "run", interrupt)
    assert refused(["simulate"], capsys, 130) == "satsep-ot: interrupted; nothing was written\n"


def test_what_an_interrupted_command_leaves_is_what_the_disk_says(tmp_path):
    def kept(*arguments):
        options = cli.make_parser().parse_args(list(map(str, arguments)))
        return options.command.left_behind(options)

    assert kept("check", "reference") == "nothing was written"
    assert kept("study", "--output", tmp_path) == "nothing was written"
    (tmp_path / "origin.json").touch()
    resumed = f"what was finished is kept in {tmp_path}: the same command with --resume continues from there"
    assert kept("study", "--output", tmp_path) == resumed
    assert kept("benchmark", "--output", tmp_path).startswith(resumed)
    assert kept("report", tmp_path) == f"the results in {tmp_path} are kept"
    assert kept("new", tmp_path / "mine.toml") == f"{tmp_path / 'mine.toml'} is not written"
    assert kept("new", tmp_path / "origin.json") == f"{tmp_path / 'origin.json'} is there"


def test_help_loads_none_of_the_heavy_libraries():
    program = (
        "import sys\nfrom satsep_ot import cli\n"
        "try:\n    cli.main(['--help'])\nexcept SystemExit:\n    pass\n"
        "print(sorted({'numpy', 'openturns', 'numba', 'matplotlib', 'rich', 'scipy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout.endswith("[]\n")


def test_the_module_runs_as_a_program():
    done = subprocess.run([sys.executable, "-m", "satsep_ot", "check", "nothing"], capture_output=True, text=True)
    assert done.returncode == 2
    assert done.stderr.startswith("satsep-ot: nothing: there is no such file")
    assert "Traceback" not in done.stderr


def test_check_warns_of_the_implausible(tmp_path, capsys):
    path = tmp_path / "fast.toml"
    path.write_text(load_case("reference").text.replace("stiffness = 5500.0", "stiffness = 38.5e6"), encoding="utf-8")
    assert cli.main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    assert "! implausible  springs: their energy of 1.16e+05 J gives 50 m/s" in out


def test_check_as_json(tmp_path, capsys):
    text = load_case("ring_400kg").text
    path = tmp_path / "mine.toml"
    path.write_text(text, encoding="utf-8")
    assert cli.main(["check", str(path), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["case"] == "ring_400kg"
    assert document["inputs"][0]["name"] == "satellite_mass"
    assert document["inputs"][0]["range"] == pytest.approx([400 - 2.0603, 400 + 2.0603], rel=1e-6)
    assert document["nominal"]["axial_velocity"]["unit"] == "m/s"
    assert document["requirements"][2]["minimum"] == 0.494
    assert document["requirements"][2]["unit"] == "m/s"
    assert document["requirements"][2]["met_by_nominal_run"] is True
    runs = document["requirements"][2]["scattered_runs"]
    assert (runs["met"], runs["runs"]) == (1023, 1024)
    assert runs["smallest"] < 0.494 < document["nominal"]["axial_velocity"]["value"] < runs["largest"]
    assert document["warnings"] == []
    pairs = {tuple(entry["inputs"]): entry["coefficient"] for entry in document["correlation"]}
    assert pairs[("satellite_Ixx", "satellite_Izz")] == 0.7
    # Eight springs, every pair of them, and one pair of moments.
    assert len(pairs) == 8 * 7 // 2 + 1
    assert pairs[("stiffness_1", "stiffness_8")] == 0.5


def test_new_like_another_case(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    assert cli.main(["new", str(path), "--like", "cubesat"]) == 0
    case = load_case(path)
    assert case.name == "mine"
    assert case.separation.satellite.mass == 2.0
    assert "there are cubesat, " in refused(["new", str(tmp_path / "other.toml"), "--like", "cube"], capsys)


EFFECTS = """
failed = [1]
table = { 2 = [[0, 2], [5, 1.5], [10, 1]] }
force_line = "normal"
guide_friction = 0.2
[umbilical]
angle = 30
radius = 90
stiffness = 50
deformation = 8
stroke = 6
friction = 0.1
engagement = 5
[impulse]
momentum = [0.0, 0.25, 0.0]
[orbit]
altitude = 500
[recontact]
[envelope]
half_width = 50
height = 100
recess_depth = 60
planes = [{ normal = [0, 0, -2], offset = -125 }]
"""


def test_check_and_simulate_tell_every_effect(tmp_path, capsys):
    path = small(tmp_path, EFFECTS)
    assert cli.main(["check", path]) == 0
    out = capsys.readouterr().out
    for words in (
        "Springs (normal)", "failed", "table of 3 rows, 2 to 1 N", "Umbilical connectors", "friction",
        "Springs: guide friction 0.2", "Impulse: momentum 0, 0.25, 0 N s",
        "Re-contact: looked for from 0.1 to 1 orbits", "Envelope: recess depth 60 mm",
        "Plane wall 1: normal 0, 0, -1, offset -125 mm",
    ):  # fmt: skip
        assert words in out, words
    # The table's work, less that of the pins: 15 N mm, and K L (xi - L / 2) of the connector.
    assert "Spring energy 0.016 J" in out
    assert cli.main(["simulate", path]) == 0
    out = capsys.readouterr().out
    for words in (
        "spring 1 has failed",
        "spring 2 released at",
        "umbilical connector 1 released",
        "pins of connector 1",
        "work -0.0004",
    ):
        assert words in out, words


def test_a_first_run_says_why_it_takes_long(capsys):
    with printing.say_if_compiling(0.01):
        time.sleep(0.2)
    assert "compiling the simulator" in capsys.readouterr().err
    with printing.say_if_compiling(5.0):
        pass
    assert capsys.readouterr().err == ""


def test_a_study_of_discrete_inputs_is_refused(tmp_path, capsys):
    extra = '[inputs]\nworks = { quantity = "springs.scale.2", distribution = "Bernoulli", p = 0.9 }\n'
    extra += '[[requirements]]\nquantity = "spin"\nmaximum = 1\n'
    error = refused(["study", small(tmp_path, extra), "--output", str(tmp_path / "results")], capsys)
    assert "needs continuous inputs, but works [1] (Bernoulli) has atoms" in error
    assert "condition on its values" in error
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("error", "words"),
    [
        (ChunkError(20, 30, [("process 7", "OSError: disk full")]), "rows 20 to 29 .*disk full.*; nothing was written"),
        (SeparationError("row 3 was not released"), "row 3 was not released$"),
    ],
)
def test_errors_of_the_runs_are_one_sentence(error, words, monkeypatch, capsys):
    def fail(options):
        raise error

    monkeypatch.setattr(simulate, "run", fail)
    assert re.search(words, refused(["simulate"], capsys, 1).strip())


def test_a_defect_keeps_its_traceback(monkeypatch):
    def fail(options):
        raise ValueError("shapes do not match")

    monkeypatch.setattr(simulate, "run", fail)
    with pytest.raises(ValueError, match="shapes do not match"):
        cli.main(["simulate"])


def test_a_terminal_shows_a_bar_and_nothing_of_it_stays(monkeypatch):
    class Terminal(io.StringIO):
        def isatty(self):
            return True

    stream = Terminal()
    monkeypatch.setattr(sys, "stderr", stream)
    monkeypatch.setenv("TERM", "xterm")
    with printing.progress() as show:
        show("gradients", 0.25)
        show("figures", 0.75)
    assert "75%" in stream.getvalue()
    assert "figures" in stream.getvalue()


def test_check_tells_correlations_struts_and_mounting_errors(tmp_path, capsys):
    text = SMALL.replace("stroke = 10", 'stroke = 10\nforce_line = "strut"\nstowed_length = 50') + (
        "[initial]\nmounting_error = [0.1, 0.2, 0.3]\n"
        '[inputs]\na = { quantity = "satellite.mass", sigma = 0.01 }\n'
        'b = { quantity = "platform.mass", sigma = 0.01 }\n'
        '[[correlation]]\ninputs = ["a", "b"]\ncoefficient = 0.5\n'
    )
    path = tmp_path / "case.toml"
    path.write_text(text, encoding="utf-8")
    assert cli.main(["check", str(path)]) == 0
    out = capsys.readouterr().out
    for words in (
        "a and b are correlated: 0.5",
        "Springs: stowed length 50 mm",
        "Initial: mounting error 0.1, 0.2, 0.3 deg",
    ):
        assert words in out


def test_a_study_without_requirements_is_refused_before_it_begins(tmp_path, capsys):
    path = tmp_path / "mine.toml"
    path.write_text(load_case("reference").text.split("[[requirements]]")[0], encoding="utf-8")
    assert cli.main(["study", str(path), "--output", str(tmp_path / "results")]) == 2
    assert capsys.readouterr().err == (
        "satsep-ot: reference: the case has no requirements; give at least one [[requirements]]\n"
    )
    assert not (tmp_path / "results").exists()


def test_what_is_not_compiled_is_told(monkeypatch, capsys):
    monkeypatch.setenv("NUMBA_DISABLE_JIT", "1")
    with printing.say_if_compiling(0.01):
        time.sleep(0.3)
    assert capsys.readouterr().err == f"{printing.NOT_COMPILED}\n"
