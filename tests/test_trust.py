"""A case file is data: nothing in it is executed, and nothing is read or written that it does not name."""

import ast
import os
import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from small_cases import BODIES, LINEAR

from satsep_ot import cli
from satsep_ot.methods.reliability.result import ActiveSubspaceReliabilityResult
from satsep_ot.methods.reliability.true_runs import TrueRuns
from satsep_ot.model.case import CaseError, load_case, parse_case
from satsep_ot.model.distributions import build_distribution
from satsep_ot.studies.telling.document import ReportError
from satsep_ot.studies.telling.report import render_report

TABLE = "stroke_mm,force_N\n0,2\n10,1\n"


class Bomb:
    """Unpickling it makes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return open, (str(self.path), "w")


@pytest.mark.parametrize(
    "name",
    ["PythonDistribution", "OpenTURNSPythonFunction", "PythonFunction", "Study", "SymbolicFunction", "RandomGenerator",
     "ResourceMap", "os", "sys", "__builtins__", "__dict__", "__class__", "Normal.__init__", "Normal()", "Platform",
     "coupling_tools", "XMLStorageManager", "Distribution", "JointDistribution", "UserDefined", "MemoizeFunction"],
)  # fmt: skip
def test_only_univariate_distributions_are_found_by_name(name):
    with pytest.raises(ValueError, match=r"is no OpenTURNS distribution|is not univariate|is missing|by parameters"):
        build_distribution(name, {})


@pytest.mark.parametrize("value", ['"${HOME}"', '"$(touch made)"', '"`touch made`"', "\"__import__('os')\"", '"{0.x}"'])
def test_texts_stay_texts(value, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    text = f"name = {value}\ndescription = {value}\n{BODIES}{LINEAR}"
    case = parse_case(text)
    assert case.name == case.description == value[1:-1]
    Path("mine.toml").write_text(text, encoding="utf-8")
    assert cli.main(["check", "mine.toml"]) == 0
    assert value[1:-1] in capsys.readouterr().out
    assert os.listdir() == ["mine.toml"]


@pytest.mark.parametrize(
    "name", ["../secret.csv", "/etc/passwd", "tables/../../secret.csv", "tables/..", "..", "/dev/zero", "//secret.csv"]
)
def test_tables_outside_of_the_folder_of_the_case_are_not_read(name, tmp_path, monkeypatch):
    (tmp_path / "secret.csv").write_text(TABLE, encoding="utf-8")
    folder = tmp_path / "case"
    (folder / "tables").mkdir(parents=True)
    path = folder / "mine.toml"
    path.write_text(f'{BODIES}table = "{name}"\n', encoding="utf-8")
    opened = []
    real = os.open
    monkeypatch.setattr(os, "open", lambda file, *rest, **more: opened.append(str(file)) or real(file, *rest, **more))
    with pytest.raises(CaseError, match="must be in the folder of the case file or below"):
        load_case(path)
    assert opened == [str(path)]


def test_a_case_reads_what_it_names_and_keeps_it(tmp_path):
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "push.csv").write_text(TABLE, encoding="utf-8")
    path = tmp_path / "mine.toml"
    path.write_text(f'{BODIES}table = "tables/push.csv"\n', encoding="utf-8")
    assert load_case(path).files == {"tables/push.csv": TABLE}
    assert load_case("reference").files == {}


def test_loading_and_simulating_a_case_opens_its_files_and_starts_nothing(tmp_path):
    """Seen by the interpreter's own audit: in a process of its own, since a hook cannot be taken off."""
    for name in ("first", "second"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / "push.csv").write_text(TABLE, encoding="utf-8")
        (folder / "mine.toml").write_text(
            f'{BODIES}table = "push.csv"\n'
            '[inputs]\nrate_y = { quantity = "initial.rates.y", distribution = "Uniform", a = -1, b = 1 }\n'
            '[[requirements]]\nquantity = "spin"\nmaximum = 0.5\n',
            encoding="utf-8",
        )
    program = """
import sys
from satsep_ot.model.case import load_case
from satsep_ot.model.separation_problem import SeparationProblem
def use(path):
    problem = SeparationProblem(load_case(path))
    problem.getFunction()(problem.getDistribution().getSample(10))
    problem.getSystemEvent()
seen = []
def hear(event, arguments):
    if event.startswith(("os.", "subprocess.", "socket.", "pickle.", "import", "exec", "open", "shutil.", "ctypes.dl")):
        seen.append([event, *map(str, arguments[:2])])
use(sys.argv[1])
sys.addaudithook(hear)
use(sys.argv[2])
print([event for event in seen])
"""
    paths = [str(tmp_path / name / "mine.toml") for name in ("first", "second")]
    done = subprocess.run([sys.executable, "-c", program, *paths], capture_output=True, text=True, check=True)
    events = [tuple(event) for event in ast.literal_eval(done.stdout)]
    # Whether it is the name of a case in the package is looked up in the list of those.
    events = [event for event in events if not event[1].endswith(os.path.join("model", "cases"))]
    # A file is opened once by its name, and once more by the number that this gave.
    named = [event for event in events if not (event[0] == "open" and event[1].isdigit())]
    assert [event[:2] for event in named] == [("open", paths[1]), ("open", paths[1].replace("mine.toml", "push.csv"))]


def test_pickles_in_results_are_not_loaded(tmp_path):
    trap = tmp_path / "sprung"
    path = tmp_path / "runs.npz"
    np.savez(path, document=np.array([Bomb(trap)], dtype=object), inputs=np.array([Bomb(trap)], dtype=object))
    with pytest.raises(ValueError, match="holds no true runs"):
        TrueRuns.load(path)
    with pytest.raises(ValueError, match="holds no ActiveSubspaceReliabilityResult"):
        ActiveSubspaceReliabilityResult.load(path)
    for name in ("results.json", "motion.json", "case.toml"):
        (tmp_path / name).write_bytes(pickle.dumps(Bomb(trap)))
    with pytest.raises(ReportError):
        render_report(tmp_path)
    with pytest.raises(CaseError):
        load_case(tmp_path / "case.toml")
    assert not trap.exists()
    # The trap is one.
    pickle.loads(pickle.dumps(Bomb(trap))).close()
    assert trap.exists()
