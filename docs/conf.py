"""Sphinx: the site from hand-written pages, executed notebooks, docstrings and parsers."""

import re
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import corridor

project = "corridor"
author = "corridor contributors"
copyright = "2026, corridor contributors"
version = release = corridor.__version__
html_title = "corridor"

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx_copybutton",
    "mathml",
]
exclude_patterns = ["jupyter_execute"]
templates_path = []

# The notebooks are shown as they were executed and tested, never run again.
nb_execution_mode = "off"
nb_merge_streams = True
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
suppress_warnings = ["mystnb.unknown_mime_type"]

# Shapes and units stand in the docstrings.
autodoc_typehints = "none"
default_role = "code"
autodoc_member_order = "bysource"
add_module_names = False

html_theme = "furo"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
html_show_sourcelink = False
# No script from elsewhere: the site is read without a network.
html_math_renderer = "mathml"


_NAMED = re.compile(r"([a-z_]\w*(?:, [a-z_]\w*)*|Returns|Raises \w+): (.*)")


def lists_of_names(app, what, name, obj, options, lines):
    """Docstrings say `name: what it is` a line, and go on indented: a list on the page."""
    out = []
    for line in lines:
        line = line.replace("|", r"\|")
        named = _NAMED.fullmatch(line)
        if named:
            out += ["", f"- **{named[1]}**: {named[2]}"]
        elif line.startswith("    ") and out and out[-1]:
            out[-1] += " " + line.strip()
        else:
            if out and out[-1].startswith("- ") and line:
                out.append("")
            out.append(line)
    lines[:] = [*out, ""]


def setup(app):
    """Docstrings are read as they are written."""
    app.connect("autodoc-process-docstring", lists_of_names)
