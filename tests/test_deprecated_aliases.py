"""Old names of methods warn and do what the new ones do."""

import importlib
import inspect
import pkgutil

import pytest

import satsep_ot


def aliases():
    """Every class with a deprecated alias, the alias and the name that it stands for."""
    found = []
    for module in pkgutil.walk_packages(satsep_ot.__path__, "satsep_ot."):
        if module.name.endswith("__main__"):
            continue
        for name, value in vars(importlib.import_module(module.name)).items():
            if inspect.isclass(value) and value.__module__ == module.name:
                for old, method in vars(value).items():
                    text = getattr(method, "__doc__", None) or ""
                    if text.startswith("Deprecated name of `"):
                        found.append(pytest.param(value, old, text.split("`")[1], id=f"{name}.{old}"))
    return found


def test_there_are_aliases():
    assert len(aliases()) >= 5


@pytest.mark.parametrize(("owner", "old", "new"), aliases())
def test_an_alias_warns_and_calls_the_new_name(owner, old, new, monkeypatch):
    monkeypatch.setattr(owner, new, lambda self, *arguments: (new, arguments))
    thing = owner.__new__(owner)
    with pytest.warns(DeprecationWarning, match=f"^{old} is deprecated since .* use {new}$") as caught:
        assert getattr(thing, old)(1, 2) == (new, (1, 2))
    assert caught[0].filename == __file__
