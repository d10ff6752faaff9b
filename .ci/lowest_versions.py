"""Print the lowest version that pyproject.toml allows of each package that users and tests need, as pip's constraints.

python .ci/lowest_versions.py > constraints.txt
"""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def lowest_versions():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    found = {}
    for requirement in project["dependencies"] + extras["distributed"] + extras["test"]:
        name, bound = re.fullmatch(r"([\w-]+)>=([\d.]+)(?:,<[\d.]+)?", requirement).groups()
        if found.setdefault(name, bound) != bound:
            raise ValueError(f"{name} has two lower bounds in pyproject.toml, {found[name]} and {bound}: give it one")
    return found


if __name__ == "__main__":
    for name, bound in lowest_versions().items():
        print(f"{name}=={bound}")
