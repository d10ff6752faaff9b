"""Every example, and every Python block of the README and of the pages in docs, runs as it stands."""

import re
import runpy
from pathlib import Path

import openturns as ot
import pytest

from satsep_ot.dynamics.quantities import QUANTITIES
from satsep_ot.model import case
from satsep_ot.model.inputs import _SPRING_KEYS

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


def test_every_example_is_tested():
    tested = {name.removeprefix("test_") for name in globals() if name.startswith("test_")}
    assert {path.stem for path in EXAMPLES} <= tested


def python_blocks(page):
    """The Python code of a page, block by block."""
    return re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", [page for page in PAGES if python_blocks(page)], ids=lambda page: page.name)
def test_python_blocks_run(page, capsys):
    quantities = dict(QUANTITIES)
    state = ot.RandomGenerator.GetState()
    names = {"__name__": page.stem}
    try:
        for block in python_blocks(page):
            exec(compile(block, str(page), "exec"), names)
    finally:
        # A page may show how to add a quantity.
        QUANTITIES.clear()
        QUANTITIES.update(quantities)
        ot.RandomGenerator.SetState(state)
    assert capsys.readouterr().out


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


def test_the_page_on_case_files_names_every_key_and_quantity():
    text = (ROOT / "docs" / "case-files.md").read_text(encoding="utf-8")
    keys = [key for table in case._TABLE_KEYS.values() for key in table]
    keys += [*case._SCATTER_KEYS, *case._PUSHES, "allowed_probability", "horizon", *QUANTITIES, *_SPRING_KEYS]
    missing = [key for key in keys if not re.search(rf"[`\".]{key}[`\"]", text)]
    assert not missing
