"""Names that OpenTURNS 1.27 calls deprecated, which its next version removes, are not used anywhere."""

import ast
import functools
import re
from pathlib import Path

import openturns as ot
import pytest

ROOT = Path(__file__).resolve().parents[1]
# What the compiled library of 1.27 warns of when it is called; its Python modules are asked below.
WARNED_OF = {
    "GeneralLinearModelAlgorithm", "KrigingAlgorithm", "KrigingRandomVector", "SoizeGhanemFactory", "Wilks", "IsNormal",
    "getConfidenceLength", "getPhysicalStartingPoint", "setPhysicalStartingPoint", "inputDistribution",
    "a starting point",  # the third argument of FORM and SORM
}  # fmt: skip


@functools.cache
def deprecated_names():
    """The classes whose Python code says that they are deprecated, and those above."""
    folder = Path(ot.__file__).parent
    texts = (path.read_text(encoding="utf-8") for path in folder.glob("*.py"))
    return WARNED_OF | {name for text in texts for name in re.findall(r"'class (\w+) is deprecated", text)}


def names_of(text):
    """Every name and attribute that a program uses."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Attribute):
            yield node.attr
        elif isinstance(node, ast.Name):
            yield node.id
        elif isinstance(node, ast.alias):
            yield node.name
        if isinstance(node, ast.Call) and getattr(node.func, "attr", "") in ("FORM", "SORM") and len(node.args) > 2:
            yield "a starting point"


def programs():
    for folder in ("satsep_ot", "tests", "examples", "docs"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            if not path.is_relative_to(ROOT / "docs" / "auto_examples"):
                yield path


def test_the_list_is_that_of_the_library():
    assert "UserDefined" in deprecated_names()
    with pytest.raises(AssertionError, match="KrigingAlgorithm"):
        assert_current("import openturns as ot\not.KrigingAlgorithm")
    with pytest.raises(AssertionError, match="starting point"):
        assert_current("import openturns as ot\not.FORM(solver, event, point)")


def assert_current(text, name="a program"):
    old = set(names_of(text)) & deprecated_names()
    assert not old, f"{name} uses {old}"


def test_no_deprecated_name():
    for path in programs():
        assert_current(path.read_text(encoding="utf-8"), path.name)
