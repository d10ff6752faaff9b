"""The recipes of docs/extending.md, done: the page's own code is put into a copy of the package."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


class Recipe:
    """One section of docs/extending.md, and a copy of the package and its tests that it is done in."""

    def __init__(self, title, folder):
        page = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
        self.section = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", page, re.MULTILINE | re.DOTALL)[1]
        self.folder = folder
        for part in ("satsep_ot", "tests"):
            shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))

    def python_blocks(self):
        """The fenced blocks of Python."""
        return re.findall(r"^```python\n(.*?)^```", self.section, re.MULTILINE | re.DOTALL)

    def rows(self):
        """The indented lines."""
        return re.findall(r"^ {4}(\S.*)$", re.sub(r"```.*?```", "", self.section, flags=re.DOTALL), re.MULTILINE)

    def insert(self, path, code, before=None):
        """Put code into a file of the copy, in front of the only line that starts with `before`, or at its end."""
        file = self.folder / path
        text = file.read_text(encoding="utf-8")
        place = len(text)
        if before is not None:
            (match,) = re.finditer(rf"^{re.escape(before)}", text, re.MULTILINE)
            place = match.start()
        file.write_text(f"{text[:place]}{code}\n{text[place:]}", encoding="utf-8")

    def run(self, *arguments):
        """What Python prints with these arguments, where the copy is imported and compiled anew."""
        environment = {**os.environ, "PYTHONPATH": str(self.folder), "NUMBA_CACHE_DIR": str(self.folder / "cache")}
        done = subprocess.run(
            [sys.executable, *arguments], cwd=self.folder, env=environment, text=True, capture_output=True
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        return done.stdout
