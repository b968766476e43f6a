"""Marks the columns of tables that hold sentences, so that they keep a readable width on a phone."""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

SENTENCE = 48  # characters; what is shorter fits beside others


def mark(_app: Sphinx, doctree: nodes.document) -> None:
    """Give all cells of a column the class `sentence` when one of them holds one."""
    for body in doctree.findall(nodes.tbody):
        for column in zip(*(row.children for row in body.children), strict=False):
            if any(len(cell.astext()) > SENTENCE for cell in column):
                for cell in column:
                    cell["classes"].append("sentence")


def setup(app: Sphinx) -> ExtensionMetadata:
    """Look at each page once it is read."""
    app.connect("doctree-read", mark)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
