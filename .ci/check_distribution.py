"""What was built holds what it should and nothing more, and the wheel, installed here, works from an empty directory.

python .ci/check_distribution.py DIRECTORY    # of the wheel and the source distribution
"""

import json
import os
import re
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TRACKED = set(
    subprocess.run(["git", "ls-files"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()
)
PACKAGE = {name for name in TRACKED if name.startswith("satsep_ot/")}
# What only the repository needs: the dot files.
SOURCES = {name for name in TRACKED if not name.startswith(".")}
BESIDE_THE_PACKAGE = r"METADATA|WHEEL|RECORD|entry_points\.txt|top_level\.txt|licenses/(LICENSE|COPYING)"
BESIDE_THE_SOURCES = r"PKG-INFO|setup\.cfg|satsep_ot\.egg-info/[\w-]+(\.txt)?"
SMOKE_TEST = """
import satsep_ot
from importlib.metadata import version
from satsep_ot.model.case import shipped_cases
assert satsep_ot.__version__ == version("satsep-ot")
assert len(shipped_cases()) >= 5
for name in satsep_ot.__all__:
    getattr(satsep_ot, name)
problem = satsep_ot.SeparationProblem("reference")
speed = problem.getFunction()(problem.getDistribution().getMean())[0]
assert abs(speed - 0.5979) < 1e-4, speed
from satsep_ot.studies.telling import report
from importlib import resources
assert "<html" in (resources.files("satsep_ot.studies.telling") / "report.html").read_text(encoding="utf-8")
assert (resources.files("satsep_ot") / "py.typed").is_file()
print(satsep_ot.__file__)
"""


def check_contents(wheel, source):
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if not name.endswith("/")}
    information = {name for name in names if re.fullmatch(rf"satsep_ot-[^/]+\.dist-info/({BESIDE_THE_PACKAGE})", name)}
    differ(f"{wheel.name}", names - information, PACKAGE)
    assert {name.split("/", 1)[1] for name in information} >= {"METADATA", "licenses/LICENSE", "licenses/COPYING"}
    with tarfile.open(source) as archive:
        names = {member.name.split("/", 1)[1] for member in archive.getmembers() if member.isfile()}
    differ(f"{source.name}", {name for name in names if not re.fullmatch(BESIDE_THE_SOURCES, name)}, SOURCES)


def differ(name, found, expected):
    assert found == expected, f"{name} lacks {sorted(expected - found)}, and should not hold {sorted(found - expected)}"


def check_use():
    """In an empty directory, with this interpreter's environment alone."""
    binaries = Path(sys.executable).parent
    environment = {"PATH": f"{binaries}:{os.defpath}", "HOME": os.environ.get("HOME", "/")}
    with tempfile.TemporaryDirectory() as folder:

        def run(*command):
            done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=600)
            assert done.returncode == 0, f"{command}: {done.stdout}\n{done.stderr}"
            return done.stdout

        home = Path(run(sys.executable, "-W", "error", "-c", SMOKE_TEST).strip())
        assert not home.is_relative_to(ROOT), f"{home} is not the installed package"
        run("satsep-ot", "new", "mine.toml")
        run("satsep-ot", "check", "mine.toml")
        assert json.loads(run("satsep-ot", "simulate", "mine.toml", "--json"))["status"] == "OK"
        assert json.loads(run(sys.executable, "-m", "satsep_ot", "simulate", "cubesat", "--json"))["status"] == "OK"


if __name__ == "__main__":
    directory = Path(sys.argv[1])
    (built_wheel,), (built_source,) = directory.glob("*.whl"), directory.glob("*.tar.gz")
    check_contents(built_wheel, built_source)
    check_use()
    print(f"{built_wheel.name} and {built_source.name} hold what they should, and the wheel works")
