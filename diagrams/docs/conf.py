"""Sphinx: the pages beside the code. ``sphinx-build -W diagrams/docs DIR`` builds them (extra ``docs``)."""

import sys
from pathlib import Path

import saphari_drake

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "_ext"), str(HERE.parent)]

project, author = "saphari_drake", "The saphari_drake authors"
release = version = saphari_drake.__version__
extensions = [
    "sphinx.ext.autodoc", "sphinx.ext.napoleon", "myst_parser", "pydrake_system", "public_names", "block_diagram",
]  # fmt: skip
exclude_patterns = ["_ext"]
html_title = "saphari_drake"
html_theme = "pydata_sphinx_theme"
html_theme_options = {"show_prev_next": False, "secondary_sidebar_items": ["page-toc"]}
html_static_path = ["_static"]
html_css_files = ["ports.css"]
autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_class_signature = "mixed"
napoleon_google_docstring = False
napoleon_custom_sections = [("Ports", "params_style")]
default_role = "code"
suppress_warnings = ["myst.header"]  # results begin with the headings of the README


def _literal_bars(app, what, name, obj, options, lines):
    """Keep |x| what it is: an absolute value, no substitution."""
    for i, line in enumerate(lines):
        if "`" not in line and not line.startswith((" ", "|")):
            lines[i] = line.replace("|", "\\|")


def setup(app):
    """Add the hook to Sphinx."""
    app.connect("autodoc-process-docstring", _literal_bars, priority=900)
