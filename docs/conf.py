"""Sphinx: docs/*.md to HTML.  make docs, or: sphinx-build -W -b html docs docs/_build/html"""

import re
from pathlib import Path

project = "microslip"
copyright = "the microslip developers, MIT licence"
_text = Path(__file__).parent.parent.joinpath("solver", "microslip", "__init__.py").read_text(encoding="utf-8")
release = re.search(r'__version__ = "(.+?)"', _text)[1]

extensions = ["myst_parser"]
myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 3  # [text](guide.md#a-heading) is a link
myst_dmath_double_inline = True
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]

html_theme = "alabaster"
html_theme_options = {"description": "Vibration of jointed structures with friction contact", "page_width": "1100px"}
html_show_sourcelink = False
