"""Settings of the documentation; `make docs` builds it strictly into docs/_build/html."""

import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE.parent), str(HERE / "extensions")]

from figures import substitutions  # noqa: E402 - found by the path above

from firmware_py import __version__  # noqa: E402

project = "Rambler"
author = "The Rambler authors"
project_copyright = "The Rambler authors, Apache-2.0"
version = release = __version__
extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "mathml",
    "command_help",
    "driver_table",
    "tables",
]
exclude_patterns = ["_build"]

highlight_language = "none"
html_theme = "furo"
html_title = f"Rambler {release}"
html_static_path = ["_static"]
html_css_files = ["rambler.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sourcelink = False

myst_enable_extensions = ["dollarmath", "substitution", "deflist", "colon_fence"]
myst_heading_anchors = 3
myst_dmath_double_inline = True
myst_substitutions = substitutions(HERE / "figures.json")

autodoc_member_order = "bysource"
autodoc_typehints = "description"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
