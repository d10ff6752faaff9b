"""Make images/architecture.svg: the folders of the package with their modules, and which folder imports which.

    python docs/make_architecture.py

Folders, modules and arrows are read from the sources. An import that others imply (A -> B -> C implies A -> C) has no
arrow of its own. An arrow that starts at the frame around the methods stands for all that leave it for that box.
"""

import ast
import functools
import textwrap
from html import escape
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "docs" / "images" / "architecture.svg"
# Folder or module of the package -> left, width, the boxes that it stands below, and what it is about.
BOXES = {
    "cli": (20, 960, (), "the arguments of all commands"),
    "commands": (20, 960, ("cli",), "one module for each command: what it runs, and what it prints"),
    "studies": (20, 470, ("commands",), "run a whole job, and keep every finished step"),
    "studies.telling": (510, 470, ("commands",), "judge, word and draw what a study found"),
    "model": (
        20,
        370,
        ("studies", "studies.telling"),
        "the case: file, inputs, OpenTURNS' function and events",
    ),
    "dynamics": (20, 270, ("model",), "the motion in SI units; knows no OpenTURNS"),
    "dynamics.kernels": (20, 270, ("dynamics",), "the equations, compiled, and their derivatives"),
    "methods.comparison": (450, 187, ("studies", "studies.telling"), "methods side by side, on known problems"),
    "methods.reliability": (450, 187, ("methods.comparison",), "a failure probability with its interval"),
    "methods.subspaces": (450, 187, ("methods.reliability",), "active directions of any function"),
    "methods.polynomials": (450, 187, ("methods.subspaces",), "regression; a polynomial's distribution"),
    "methods.parallel": (647, 152, ("methods.comparison",), "any number of runs on any workers"),
    "methods.updating": (809, 165, ("methods.comparison",), "what experiments teach of inputs and of failures"),
    "methods.common": (450, 510, ("methods.polynomials",), "intervals, the standard space, files of results"),
    "openturns_object": (320, 240, ("methods.common", "dynamics.kernels"), "what every public class inherits"),
    "openturns_adapter": (320, 660, ("openturns_object",), "every workaround for OpenTURNS"),
}
METHODS = "methods: for any OpenTURNS function or event; no file here knows a satellite"
GAP, PANEL, LINE = 34, 36, 15
CHARACTER = 6.3  # width of one, in a text of 12 px
STYLE = """
text { font: 12px system-ui, 'Liberation Sans', Arial, sans-serif; fill: #222 }
.name { font-weight: bold; font-size: 14px }
.contents { fill: #666; font-size: 11px }
rect { fill: #fff; stroke: #444 }
.layer { fill: #f3f5f8; stroke: #bbb }
line { stroke: #444; stroke-width: 1.3; marker-end: url(#arrow) }
"""


def contents(box):
    """The names of the modules in a folder, and of the folders in it that have no box; none for a module."""
    folder = ROOT / "satsep_ot" / box.replace(".", "/")
    modules = sorted(path.stem for path in folder.glob("*.py") if path.stem != "__init__")
    folders = sorted(path.parent.name for path in folder.glob("*/*.py") if path.stem == "__init__")
    return modules + [f"{name}/" for name in folders if f"{box}.{name}" not in BOXES]


def box_of(name):
    """The folder that a module is in, or the module itself where it is in none: satsep_ot.model.case is in model."""
    parts = name.split(".")[1:]
    while parts and ".".join(parts) not in BOXES:
        parts.pop()
    return ".".join(parts)


def imports():
    """All pairs (importing box, imported box)."""
    found = set()
    for path in (ROOT / "satsep_ot").rglob("*.py"):
        importing = box_of(".".join(path.relative_to(ROOT).with_suffix("").parts))
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.module.startswith("satsep_ot"):
                found |= {(importing, box_of(f"{node.module}.{alias.name}")) for alias in node.names}
    return {(a, b) for a, b in found if a and b and a != b}


def arrows():
    """The imports that no others imply."""
    pairs = imports()

    def reached(start, without):
        seen, left = set(), [start]
        while left:
            here = left.pop()
            for a, b in pairs - {without}:
                if a == here and b not in seen:
                    seen.add(b)
                    left.append(b)
        return seen

    return sorted(pair for pair in pairs if pair[1] not in reached(pair[0], pair))


def lines_of(name):
    """The kinds and texts of the lines in a box."""
    _, width, _, about = BOXES[name]
    inside = contents(name)
    lines = [("name", name.replace(".", "/") + ("" if inside else ".py"))]
    for kind, text in (("about", about), ("contents", ", ".join(inside))):
        lines += [(kind, line) for line in textwrap.wrap(text, int((width - 20) / CHARACTER))]
    return lines


@functools.cache
def rectangle(name):
    """The left, the top, the width and the height of a box."""
    left, width, above, _ = BOXES[name]
    top = max([bottom(box) + GAP for box in above], default=16)
    if name.startswith("methods.") != any(box.startswith("methods.") for box in above):
        # The frame around the methods begins or ends here.
        top += PANEL
    return left, top, width, LINE * len(lines_of(name)) + 14


def bottom(name):
    _, top, _, height = rectangle(name)
    return top + height


def drawn_box(name):
    left, top, width, height = rectangle(name)
    parts = [f'<rect x="{left}" y="{top}" width="{width}" height="{height}" rx="4"/>']
    for i, (kind, line) in enumerate(lines_of(name)):
        parts.append(f'<text class="{kind}" x="{left + 10}" y="{top + 19 + LINE * i}">{escape(line)}</text>')
    return parts


def frame():
    """The left, the top, the width and the height of the frame around the methods."""
    left, top, *_ = rectangle("methods.comparison")
    return left - 20, top - PANEL, 550, bottom("methods.common") - top + PANEL + 16


def drawn_arrow(start, end):
    # What leaves the methods starts at their frame: it would cross their boxes.
    leaves = start.startswith("methods.") and not end.startswith("methods.")
    (x0, y0, w0, h0), (x1, y1, w1, h1) = frame() if leaves else rectangle(start), rectangle(end)
    if y1 >= y0 + h0:
        # Straight down, where one is above the other; else from middle to middle.
        low, high = max(x0, x1), min(x0 + w0, x1 + w1)
        a, b = ((low + high) / 2,) * 2 if high - low > 20 else (x0 + w0 / 2, x1 + w1 / 2)
        ends = a, y0 + h0, b, y1 - 2
    elif x1 > x0:
        ends = x0 + w0, y0 + h0 / 2, x1 - 2, y1 + h1 / 2
    else:
        ends = x0, y0 + h0 / 2, x1 + w1 + 2, y1 + h1 / 2
    return '<line x1="{:g}" y1="{:g}" x2="{:g}" y2="{:g}"/>'.format(*ends)


def picture():
    """The text of the picture."""
    width, height = 1000, max(map(bottom, BOXES)) + 16
    x, y, w, h = frame()
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}">',
        f"<style>{STYLE}</style>",
        '<defs><marker id="arrow" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0,0 L8,4 L0,8 z" fill="#444"/></marker></defs>',
        f'<rect x="0" y="0" width="{width}" height="{height}" style="stroke: none"/>',
        f'<rect class="layer" x="{x}" y="{y}" width="{w}" height="{h}" rx="6"/>',
    ]
    right, wide = rectangle("methods.parallel")[::2]
    for i, line in enumerate(textwrap.wrap(METHODS, int(wide / CHARACTER))):
        parts.append(f'<text x="{right}" y="{y + PANEL + 19 + LINE * i}">{line}</text>')
    for name in BOXES:
        parts += drawn_box(name)
    parts += sorted({drawn_arrow(start, end) for start, end in arrows()})
    return "\n".join([*parts, "</svg>"]) + "\n"


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
