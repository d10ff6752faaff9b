"""The pages name files that are there, and the picture of the architecture is made of today's sources."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def missing(names, folders):
    return sorted(name for name in names if not any((folder / name).exists() for folder in folders))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_files_that_a_page_names_exist(page):
    named = re.findall(r"`((?:satsep_ot|tests|docs|examples)/[\w/.-]*)`", page.read_text(encoding="utf-8"))
    assert missing(named, [ROOT]) == []


def test_files_that_the_architecture_names_exist():
    named = re.findall(r"`((?:\w+/)+(?:\w+\.py)?|\w+\.py)`", (ROOT / "docs" / "architecture.md").read_text("utf-8"))
    assert len(set(named)) > 20
    assert missing(named, [ROOT / "satsep_ot", ROOT]) == []


def test_the_picture_shows_the_folders_and_imports_of_today():
    made, package = runpy.run_path(str(ROOT / "docs" / "make_architecture.py")), ROOT / "satsep_ot"
    assert made["PICTURE"].read_text(encoding="utf-8") == made["picture"](), "run docs/make_architecture.py"
    folders = {path.parent.name for path in package.glob("*/*.py")} - {"methods"}
    inner = {f"methods.{path.parent.name}" for path in package.glob("methods/*/*.py")}
    assert folders | inner <= set(made["BOXES"])
