"""Sphinx configuration of the manual. `make docs` builds it from the pages that a code-hosting site displays."""

import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

HERE = Path(__file__).parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(HERE / "extensions")]

from firmware_py import __version__  # noqa: E402 - found by the path above

project = "Rambler"
author = "The Rambler authors"
project_copyright = "The Rambler authors, Apache-2.0"
version = release = __version__
extensions = ["myst_parser", "mathml", "tables"]
exclude_patterns = ["_build"]

highlight_language = "none"
html_theme = "furo"
html_title = f"Rambler {release}"
html_static_path = ["_static"]
html_css_files = ["rambler.css"]
html_math_renderer = "mathml"
html_copy_source = False
html_show_sourcelink = False

myst_fence_as_directive = ["math"]
myst_heading_anchors = 3

GENERATED = re.compile(r"This page is \[.*?\]\((.*?)\)")
LINK = re.compile(r"\]\((\w[\w-]*|[\w-]+/index)\.md\)")
NAMES = ("FAULTS", "MESSAGES", "TEXTS")
# Generated pages below params/ link to one another, and to pages of the manual.
PAGES = {"REFERENCE.md": "parameters.md", **{f"{name}.md": f"{name.lower()}.md" for name in NAMES}}
GENERATED_LINK = re.compile(rf"(?<=\]\()(?:\.\./docs/|{'|'.join(map(re.escape, PAGES))})")


def complete_page(_app: Sphinx, page: str, source: list[str]) -> None:
    """Replace a link to a page below params/ by that page; add the pages that an index page links to the sidebar."""
    if match := GENERATED.search(source[0]):
        text = (HERE / page).parent.joinpath(match[1]).read_text(encoding="utf-8")
        source[0] = GENERATED_LINK.sub(lambda link: PAGES.get(link[0], "../"), text)
    elif page.endswith("index"):
        entries = "\n".join(dict.fromkeys(LINK.findall(source[0])))
        source[0] += f"\n```{{toctree}}\n:hidden:\n\n{entries}\n```\n"


def setup(app: Sphinx) -> None:
    """Complete each page after it is read."""
    app.connect("source-read", complete_page)
