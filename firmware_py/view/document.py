"""Builds self-contained HTML pages with a content security policy that forbids external resources."""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from html import escape
from pathlib import Path
from typing import Any

_HERE = Path(__file__).parent
PLOTS = ("axes.js", "panels.js", "track.js", "voyage.js")  # in this order, joined to one script
LIVE = (*PLOTS, "live.js")


@cache
def asset(*names: str) -> str:
    """Return the joined text of files of this folder."""
    return "\n".join((_HERE / name).read_text(encoding="utf-8") for name in names)


def data_block(kind: str, content: Mapping[str, Any]) -> str:
    """Return data as a block of JSON in a page; the scripts find it by its class `kind`."""
    text = json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")
    return f'<script type="application/json" class="{kind}">{text}</script>'


def policy(scripts: tuple[str, ...], *, connect: bool = False) -> str:
    """Return the content security policy of a page with these scripts; with `connect` the page may load updates."""
    rules = [
        "default-src 'none'",
        f"style-src '{_hash(asset('view.css'))}'",
        "img-src data:",
        *([f"script-src '{_hash(asset(*scripts))}'"] if scripts else []),
        *(["connect-src 'self'"] if connect else []),
        "base-uri 'none'",
        "form-action 'none'",
    ]
    return "; ".join(rules)


def document(title: str, parts: Iterable[str], scripts: tuple[str, ...] = (), *, connect: bool = False) -> str:
    """Return a page with a title (plain text), parts (HTML) and scripts (files of this folder)."""
    head = [
        '<meta charset="utf-8">',
        f'<meta http-equiv="Content-Security-Policy" content="{policy(scripts, connect=connect)}">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        '<meta name="color-scheme" content="light dark">',
        '<link rel="icon" href="data:,">',
        f"<title>{escape(title)}</title><style>{asset('view.css')}</style>",
    ]
    script = [f"<script>{asset(*scripts)}</script>"] if scripts else []
    body = "\n".join([f"<h1>{escape(title)}</h1>", *parts, *script])
    return f'<!doctype html>\n<html lang="en"><head>{"".join(head)}</head>\n<body>{body}</body></html>\n'


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
