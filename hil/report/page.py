"""The parts of a self-contained HTML page: plots of voyages, embedded images, tables."""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape

from firmware_py.view.document import data_block, document
from firmware_py.view.model import Voyage

WARNING = 4  # MAV_SEVERITY; texts of this and higher severity are red, except the end by a signal (view/panels.js)


@dataclass(frozen=True, slots=True)
class Cell:
    """A table cell with style classes and a note below its text."""

    text: str
    classes: str = "words"
    note: str = ""


def page(title: str, parts: Iterable[str], scripts: tuple[str, ...] = ()) -> str:
    """Return a page of HTML parts under a plain-text title; the scripts draw voyages."""
    return document(title, parts, scripts)


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
    """Return preformatted text."""
    return f"<pre>{escape(text)}</pre>"


def image(png: bytes, description: str) -> str:
    """Return an embedded image."""
    data = base64.b64encode(png).decode("ascii")
    return f'<img alt="{escape(description)}" src="data:image/png;base64,{data}">'


def images(pictures: Iterable[tuple[bytes, str]]) -> str:
    """Return images with their descriptions, side by side if the page is wide enough."""
    return '<div class="pictures">' + "".join(image(png, description) for png, description in pictures) + "</div>"


def table(rows: Iterable[Sequence[str | Cell]], *, head: bool = True) -> str:
    """Return a table; with `head` the first row is its header."""
    lines = []
    for number, row in enumerate(rows):
        tag = "th" if head and number == 0 else "td"
        lines.append("<tr>" + "".join(_cell(tag, cell) for cell in row) + "</tr>")
    return '<div class="scroll"><table>' + "\n".join(lines) + "</table></div>"


def voyage(content: Voyage) -> list[str]:
    """Return the plots of a voyage, and their replacement without scripts."""
    return [data_block("voyage", content), "<noscript><p>The plots need a browser with scripts.</p></noscript>"]


def events(texts: Iterable[tuple[float, int, str]], format_time: Callable[[float], str]) -> str:
    """Return times, severities and texts as a table whose rows link to the plots; severe texts are highlighted."""
    rows = [
        f'<tr data-time="{t_s:.2f}"><td>{escape(format_time(t_s))}</td>'
        f'<td class="words{" bad" if severity <= WARNING and text[:3] != "SIG" else ""}">{escape(text)}</td></tr>'
        for t_s, severity, text in texts
    ]
    head = '<tr><th>time</th><th class="words">text</th></tr>'
    return f'<div class="scroll"><table>{head}{"".join(rows)}</table></div>'


def _cell(tag: str, cell: str | Cell) -> str:
    if isinstance(cell, str):
        return f"<{tag}>{escape(cell)}</{tag}>"
    note = f'<br><span class="note">{escape(cell.note)}</span>' if cell.note else ""
    return f'<{tag} class="{cell.classes}">{escape(cell.text)}{note}</{tag}>'
