"""The shell of a self-contained HTML page: its style, pictures within it, tables."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #333b44; max-width: 1180px; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.5rem; margin-bottom: .2rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
p.lead { color: #66717d; margin-top: 0; } img { width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { text-align: right; vertical-align: top; padding: .3rem .9rem; border-bottom: 1px solid #dde3e8; }
th { color: #66717d; font-weight: 600; } td:first-child, th:first-child { text-align: left; padding-left: 0; }
td.words, th.words { text-align: left; } .good { color: #1d7a46; } .bad { color: #b3402f; }
.note { color: #66717d; font-size: .9rem; max-width: 60rem; } pre { white-space: pre-wrap; font-size: .85rem; }
"""


@dataclass(frozen=True, slots=True)
class Cell:
    """A cell of a table that is more than a figure: the classes of its style, and a note below its text."""

    text: str
    classes: str = "words"
    note: str = ""


def page(title: str, parts: Iterable[str]) -> str:
    """Return a whole page of parts, which are HTML, under a title, which is plain text."""
    head = f'<meta charset="utf-8">\n<title>{escape(title)}</title><style>{STYLE}</style>'
    return "\n".join(
        [f'<!doctype html><html lang="en"><head>{head}</head><body>', heading(title, 1), *parts, "</body></html>\n"]
    )


def heading(text: str, level: int = 2) -> str:
    """Return a heading of a level."""
    return f"<h{level}>{escape(text)}</h{level}>"


def paragraph(text: str, kind: str = "") -> str:
    """Return a paragraph; its kind is "", "lead" or "note"."""
    return f'<p class="{kind}">{escape(text)}</p>' if kind else f"<p>{escape(text)}</p>"


def bullets(lines: Iterable[str]) -> str:
    """Return a list of lines."""
    return "<ul>" + "".join(f"<li>{escape(line)}</li>" for line in lines) + "</ul>"


def verbatim(text: str) -> str:
    """Return text as it stands on a terminal."""
    return f"<pre>{escape(text)}</pre>"


def image(png: bytes, description: str) -> str:
    """Return a picture that is within the page itself."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img alt="{escape(description)}" src="data:image/png;base64,{data}">'


def table(rows: Iterable[Sequence[str | Cell]], *, head: bool = True) -> str:
    """Return a table, its first row as the head."""
    lines = []
    for number, row in enumerate(rows):
        tag = "th" if head and number == 0 else "td"
        lines.append("<tr>" + "".join(_cell(tag, cell) for cell in row) + "</tr>")
    return "<table>" + "\n".join(lines) + "</table>"


def _cell(tag: str, cell: str | Cell) -> str:
    if isinstance(cell, str):
        return f"<{tag}>{escape(cell)}</{tag}>"
    note = f'<br><span class="note">{escape(cell.note)}</span>' if cell.note else ""
    return f'<{tag} class="{cell.classes}">{escape(cell.text)}{note}</{tag}>'
