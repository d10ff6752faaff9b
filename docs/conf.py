"""Settings of Sphinx: these pages are built with warnings as errors by .ci/run."""

from importlib import metadata

project = "satsep-ot"
author = "the satsep-ot developers"
copyright = author
release = version = metadata.version("satsep-ot")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
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

html_theme = "alabaster"
html_theme_options = {
    "description": "Reliability of small satellite separation with OpenTURNS",
    # A window that is narrower has the navigation above each page.
    "page_width": "1040px",
    "font_family": "system-ui, 'Liberation Sans', Arial, sans-serif",
    "sidebar_width": "220px",
    "fixed_sidebar": True,
    "show_powered_by": False,
}
html_static_path = ["_static"]
