"""Mark the table columns that contain sentences, so that they have a readable width on a phone."""

from __future__ import annotations

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

MIN_SENTENCE_LENGTH = 48  # characters


def _visible_text(cell: nodes.Element) -> str:
    """Return the visible text of a cell, without HTML comments."""
    return "".join(text for text in cell.findall(nodes.Text) if not isinstance(text.parent, nodes.raw))


def mark_sentences(_app: Sphinx, doctree: nodes.document) -> None:
    """Give all cells of a column the class `sentence` if one of them contains a sentence."""
    for body in doctree.findall(nodes.tbody):
        for column in zip(*(row.children for row in body.children), strict=False):
            if any(len(_visible_text(cell)) > MIN_SENTENCE_LENGTH for cell in column):
                for cell in column:
                    cell["classes"].append("sentence")


def setup(app: Sphinx) -> ExtensionMetadata:
    """Process each page after it is read."""
    app.connect("doctree-read", mark_sentences)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
