"""Sphinx: docs/*.md and the docstrings to HTML.  make docs, or: sphinx-build -W -b html docs docs/_build/html"""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

from docutils import nodes

_root = Path(__file__).parent.parent
sys.path.insert(0, str(_root / "solver"))

project = "microslip"
copyright = "the microslip developers, MIT licence"
release = re.search(r'__version__ = "(.+?)"', (_root / "solver" / "microslip" / "version.py").read_text(encoding="utf-8"))[1]

# The equations are set by a MathJax that pip brings and the build copies, so that pages need no network.
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "sphinx.ext.mathjax", "sphinx-mathjax-offline"]
myst_enable_extensions = ["dollarmath", "amsmath", "attrs_inline", "colon_fence"]
myst_heading_anchors = 3  # [text](guide.md#a-heading) is a link
myst_dmath_double_inline = True
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]

html_theme = "furo"
html_title = f"microslip {release}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_show_sourcelink = False

napoleon_google_docstring = False
napoleon_use_rtype = False
autodoc_default_options = {"members": True, "exclude-members": "model_config"}
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # docstrings state shapes and units ...
suppress_warnings = ["ref.python"]  # ... in words, which name no class
autodoc_mock_imports = [
    name for name in ("petsc4py", "slepc4py", "mpi4py", "h5py", "pymetis", "shapely", "greenlet") if find_spec(name) is None
]


def setup(app):
    app.connect("autodoc-process-docstring", _as_written, priority=400)  # before napoleon
    app.connect("doctree-read", _pictures_open)


def _as_written(app, what, name, obj, options, lines):
    """Take |T| and hb_ for what they are, not for a substitution and a link; add what a scene's keys say of themselves."""
    lines[:] = [re.sub(r"\||(?<=\w)_(?![\w`])", r"\\\g<0>", line) for line in lines]
    if fields := what == "class" and getattr(obj, "model_fields", None):
        lines += ["", "Parameters", "----------"]
        lines += [line for key, field in fields.items() for line in (key, "    " + (field.description or "").replace("*", r"\*"))]


def _pictures_open(app, doctree):
    """Let a touch show a picture in full: Sphinx links those that state a width (pages.css takes it back)."""
    for image in doctree.findall(nodes.image):
        image["width"] = "100%"
