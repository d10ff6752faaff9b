"""What `import satsep_ot` offers, and what it must not do."""

import ast
import importlib
import inspect
import re
import subprocess
import sys
from pathlib import Path

import pytest

import satsep_ot

PUBLIC = [name for name in satsep_ot.__all__ if name != "__version__"]


@pytest.mark.parametrize("name", PUBLIC)
def test_public_names_are_there_and_documented_with_an_example(name):
    member = getattr(satsep_ot, name)
    assert inspect.getdoc(member)
    assert name in dir(satsep_ot)
    if inspect.isclass(member):
        assert ">>> " in inspect.getdoc(member), name


def test_unknown_names_are_refused():
    with pytest.raises(AttributeError, match="no attribute 'Rocket'"):
        satsep_ot.Rocket  # noqa: B018


def test_import_loads_nothing_heavy_and_changes_nothing():
    program = (
        "import sys, warnings; before = list(warnings.filters); import satsep_ot; "
        "heavy = {'openturns', 'numba', 'numpy', 'matplotlib', 'scipy'} & set(sys.modules); "
        "assert not heavy, heavy; assert list(warnings.filters) == before; "
        "import satsep_ot.studies.separation_study; assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


def test_the_api_page_lists_every_class_that_has_an_example():
    package = Path(satsep_ot.__file__).parent
    page = (package.parent / "docs" / "api.rst").read_text(encoding="utf-8").replace("~", "").split()
    classes = set()
    for path in sorted(package.rglob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and ">>> " in (ast.get_docstring(node) or ""):
                module = path.relative_to(package).with_suffix("").as_posix().replace("/", ".")
                if module not in page:
                    classes.add(f"{module}.{node.name}")
    assert classes <= set(page), classes - set(page)
    assert len(classes) > 40


def test_every_name_on_the_api_page_is_there():
    page = (Path(__file__).parents[1] / "docs" / "api.rst").read_text(encoding="utf-8")
    listed = re.findall(r"^   ~([\w.]+)\.(\w+)$", page, re.M)
    assert len(listed) > 100
    missing = [name for module, name in listed if not hasattr(importlib.import_module(f"satsep_ot.{module}"), name)]
    assert missing == []
