"""Each layer imports only downwards: dynamics knows no OpenTURNS, methods know no satellite."""

import ast
from pathlib import Path

import pytest

import satsep_ot

PACKAGE = Path(satsep_ot.__file__).parent
ALLOWED = {
    "dynamics": {"numpy", "numba", "scipy", "satsep_ot.dynamics"},
    "deprecation.py": set(),
    # dill is optional.
    "openturns_adapter.py": {"numpy", "openturns", "dill"},
    "model": {
        "numpy",
        "openturns",
        "satsep_ot.deprecation",
        "satsep_ot.dynamics",
        "satsep_ot.model",
        "satsep_ot.openturns_adapter",
    },
    # cloudpickle and distributed are optional: they are imported where they are there.
    "methods": {
        "numpy",
        "scipy",
        "openturns",
        "threadpoolctl",
        "cloudpickle",
        "distributed",
        "satsep_ot.deprecation",
        "satsep_ot.methods",
        "satsep_ot.openturns_adapter",
    },
    "studies": {"numpy", "scipy", "openturns", "matplotlib", "jinja2", "markupsafe", "satsep_ot"},
}
STANDARD_LIBRARY = {
    "abc", "base64", "collections", "concurrent", "contextlib", "copy", "csv", "ctypes", "dataclasses", "datetime",
    "difflib", "enum", "faulthandler", "fcntl", "functools", "gc", "hashlib", "importlib", "io", "itertools", "json",
    "math", "multiprocessing", "os", "pathlib", "pickle", "platform", "re", "signal", "subprocess", "sys", "tempfile",
    "threading", "time", "tomllib", "traceback", "types", "typing", "warnings", "weakref", "xml", "zipfile", "zlib",
}  # fmt: skip


def imported_modules(path: Path):
    """The full names of the modules that a source file imports."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            yield node.module


@pytest.mark.parametrize("layer", sorted(ALLOWED))
def test_layer_imports_only_downwards(layer):
    place = PACKAGE / layer
    files = [place] if place.suffix else sorted(place.rglob("*.py"))
    assert files
    for path in files:
        for module in imported_modules(path):
            if module.split(".")[0] in STANDARD_LIBRARY:
                continue
            permitted = any(module == name or module.startswith(name + ".") for name in ALLOWED[layer])
            assert permitted, f"{path.relative_to(PACKAGE)} imports {module}, which {layer} must not know"


def test_methods_know_no_satellite():
    for path in sorted((PACKAGE / "methods").rglob("*.py")):
        assert "satellite" not in path.read_text(encoding="utf-8").lower(), path
