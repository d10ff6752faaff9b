"""Every public function and method says the types of what it takes and gives; mypy checks that they fit."""

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "satsep_ot"
KERNELS = PACKAGE / "dynamics" / "kernels"
# Numba types the kernels.
MODULES = [path for path in sorted(PACKAGE.rglob("*.py")) if path.parent != KERNELS or path.name == "compilation.py"]


def public_functions(body, path=""):
    """The public functions and methods of a module or class, but for compiled ones."""
    for node in body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield from public_functions(node.body, f"{node.name}.")
        is_public = isinstance(node, ast.FunctionDef) and (not node.name.startswith("_") or node.name == "__init__")
        if is_public and "inline" not in map(ast.unparse, node.decorator_list):
            yield path + node.name, node


def unannotated(text):
    for name, node in public_functions(ast.parse(text).body):
        arguments = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs, node.args.vararg, node.args.kwarg]
        given = [argument for argument in arguments if argument is not None and argument.arg not in ("self", "cls")]
        if node.returns is None or any(argument.annotation is None for argument in given):
            yield name


def test_what_is_missing_is_found():
    assert list(unannotated("class A:\n    def f(self, x): pass\n    def _g(self, x): pass")) == ["A.f"]
    assert list(unannotated("def f(x: int): pass\ndef g(*x) -> int: pass\ndef h(x: int) -> int: pass")) == ["f", "g"]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_public_functions_are_annotated(path):
    assert not list(unannotated(path.read_text(encoding="utf-8")))
    assert (PACKAGE / "py.typed").is_file()
