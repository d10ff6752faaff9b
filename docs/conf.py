"""Settings of Sphinx: these pages are built with warnings as errors by .ci/run."""

from importlib import metadata

from docutils import nodes
from latex2mathml.converter import convert

project = "satsep-ot"
author = "the satsep-ot developers"
copyright = author
release = version = metadata.version("satsep-ot")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "myst_parser",
    "sphinx_gallery.gen_gallery",
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "images", "auto_examples/*.ipynb", "auto_examples/*.py", "auto_examples/*.json"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 3
autosummary_generate = True
# The templates in _templates show the members, with all that their docstrings say.
numpydoc_show_class_members = False
templates_path = ["_templates"]
# OpenTURNS' and numpy's pages would be asked for over the network: names of their classes stay text.
nitpicky = False

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "auto_examples",
    "filename_pattern": r"\.py$",
    "image_scrapers": ("matplotlib",),
    "download_all_examples": False,
    "show_memory": False,
    "abort_on_example_error": True,
    "reset_modules": ("matplotlib",),
}

# A table of contents in each page, light and dark, and nothing from the network.
html_theme = "furo"
html_title = f"satsep-ot {release}"
html_static_path = ["_static"]
html_math_renderer = "mathml"


def visit_math(translator, node):
    """An equation in a line, as MathML, which browsers draw without a script."""
    translator.body.append(convert(node.astext()))
    raise nodes.SkipNode


def visit_displayed_math(translator, node):
    """An equation of its own."""
    translator.body.append(f'<div class="math">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def setup(app):
    """Draw equations as MathML."""
    app.add_html_math_renderer("mathml", (visit_math, None), (visit_displayed_math, None))
