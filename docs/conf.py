"""Sphinx: docs/*.md and the docstrings to HTML.  make docs, or: sphinx-build -W -b html docs docs/_build/html"""

import re
import sys
from pathlib import Path

_root = Path(__file__).parent.parent
sys.path.insert(0, str(_root / "solver"))

project = "microslip"
copyright = "the microslip developers, MIT licence"
release = re.search(r'__version__ = "(.+?)"', (_root / "solver" / "microslip" / "__init__.py").read_text(encoding="utf-8"))[1]

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
