"""Each layer and each folder of methods imports only downwards, and no module imports itself by way of others."""

import ast
from pathlib import Path

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components

import satsep_ot

PACKAGE = Path(satsep_ot.__file__).parent
BELOW_STUDIES = {
    "numpy",
    "openturns",
    "satsep_ot.dynamics",
    "satsep_ot.methods",
    "satsep_ot.model",
    "satsep_ot.openturns_adapter",
}
ALLOWED = {
    "dynamics": {"numpy", "numba", "scipy", "satsep_ot.dynamics"},
    "deprecation.py": set(),
    # dill is optional.
    "openturns_adapter.py": {"numpy", "openturns", "dill"},
    "openturns_object.py": {"numpy", "openturns", "satsep_ot.openturns_adapter"},
    "model": {
        "numpy",
        "openturns",
        "satsep_ot.deprecation",
        "satsep_ot.dynamics",
        "satsep_ot.model",
        "satsep_ot.openturns_adapter",
        "satsep_ot.openturns_object",
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
        "satsep_ot.moved_modules",
        "satsep_ot.openturns_adapter",
        "satsep_ot.openturns_object",
    },
    "studies": {
        *BELOW_STUDIES,
        "scipy",
        "matplotlib",
        "jinja2",
        "markupsafe",
        "rich",
        "satsep_ot.deprecation",
        "satsep_ot.openturns_object",
        "satsep_ot.studies",
    },
    # What tells of a study takes result objects, and knows nothing of what makes them.
    "studies/telling": {
        *BELOW_STUDIES,
        "scipy",
        "matplotlib",
        "jinja2",
        "markupsafe",
        "rich",
        "satsep_ot.studies.telling",
    },
    "commands": {"rich", "satsep_ot"},
}
# The folders of methods, and those that each one may import beside itself.
FOLDERS = {
    "common": set(),
    "polynomials": {"common"},
    "subspaces": {"common", "polynomials"},
    "reliability": {"common", "polynomials", "subspaces"},
    "parallel": {"common"},
    "updating": {"common"},
    "comparison": {"common", "polynomials", "subspaces", "reliability", "parallel"},
}
STANDARD_LIBRARY = {
    "abc", "argparse", "base64", "collections", "concurrent", "contextlib", "copy", "csv", "ctypes", "dataclasses",
    "datetime", "difflib", "enum", "faulthandler", "fcntl", "functools", "gc", "hashlib", "html", "importlib", "io",
    "itertools", "json", "logging", "math", "multiprocessing", "os", "pathlib", "pickle", "platform", "re", "runpy",
    "signal", "stat", "statistics", "subprocess", "sys", "tempfile", "threading", "time", "tomllib", "traceback",
    "types", "typing", "unicodedata", "warnings", "weakref", "xml", "zipfile", "zlib",
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


def test_rooms_of_methods_import_only_what_they_may():
    methods = PACKAGE / "methods"
    assert {path.name for path in methods.iterdir() if path.is_dir() and path.name != "__pycache__"} == set(FOLDERS)
    for folder, permitted in FOLDERS.items():
        for path in sorted((methods / folder).rglob("*.py")):
            for module in imported_modules(path):
                other = module.split(".")[2] if module.startswith("satsep_ot.methods.") else folder
                assert other in permitted | {folder}, f"{path.relative_to(PACKAGE)} imports {module}"


def module_imports():
    """The modules of the package that each one imports, at its top or inside of a function."""
    paths = {
        ".".join(("satsep_ot", *path.relative_to(PACKAGE).with_suffix("").parts)).removesuffix(".__init__"): path
        for path in sorted(PACKAGE.rglob("*.py"))
    }
    graph = {}
    for name, path in paths.items():
        found = set()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                # A package is asked for a module of its own, or for a name.
                members = {f"{node.module}.{alias.name}" for alias in node.names}
                found |= members & set(paths) or {node.module}
        graph[name] = found & set(paths) - {name}
    return graph


def test_no_module_imports_itself_by_way_of_others():
    graph = module_imports()
    names = sorted(graph)
    assert len(names) > 60
    matrix = [[other in graph[name] for other in names] for name in names]
    number, labels = connected_components(np.array(matrix, dtype=float), connection="strong")
    circles = [{name for name, label in zip(names, labels, strict=True) if label == k} for k in range(number)]
    assert [circle for circle in circles if len(circle) > 1] == []


def test_kernels_import_nothing_of_the_package_from_outside():
    """The key of the compile cache is a digest of their folder."""
    for path in sorted((PACKAGE / "dynamics" / "kernels").rglob("*.py")):
        for module in imported_modules(path):
            assert not module.startswith("satsep_ot") or module.startswith("satsep_ot.dynamics.kernels"), path


def test_methods_know_no_satellite():
    for path in sorted((PACKAGE / "methods").rglob("*.py")):
        assert "satellite" not in path.read_text(encoding="utf-8").lower(), path
