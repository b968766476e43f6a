"""reproduce.png, reproduce.html and reproduce.json: the picture, the table as a page, the table for programs."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path

from hil.lab.reproduce import picture
from hil.lab.reproduce.chain import Chain
from hil.lab.reproduce.rows import Row, Verdict, all_match
from hil.report.page import STYLE

COLOUR = {Verdict.MATCHES: "#2e7d4f", Verdict.MISSES: "#b3261e"}
PLAIN = "#66717d"


def write(chain: Chain, table: Sequence[Row], out: Path) -> Path:
    """Write everything to out; return the path of the page."""
    image, page = out / "reproduce.png", out / "reproduce.html"
    picture.draw(chain, image)
    page.write_text(_page(table, image.read_bytes()), encoding="utf-8")
    rows = [{**asdict(row), "verdict": row.verdict.value} for row in table]
    text = json.dumps({"all_match": all_match(tuple(table)), "rows": rows}, indent=2, ensure_ascii=False)
    (out / "reproduce.json").write_text(text + "\n", encoding="utf-8")
    return page


def _page(table: Sequence[Row], image: bytes) -> str:
    encoded = base64.b64encode(image).decode("ascii")
    title = "The paper against ours"
    lines = ["<tr>" + "".join(f"<th>{name}</th>" for name in ("quantity", "paper", "ours", "")) + "</tr>"]
    for row in table:
        note = f'<br><span class="note">{escape(row.note)}</span>' if row.note else ""
        colour = COLOUR.get(row.verdict, PLAIN)
        lines.append(
            f"<tr><td>{escape(row.quantity)}{note}</td><td>{escape(row.paper)}</td><td>{escape(row.ours)}</td>"
            f'<td style="color:{colour}">{escape(row.verdict.value)}</td></tr>'
        )
    return "\n".join(
        [
            f'<!doctype html><html lang="en"><head><meta charset="utf-8"><title>{title}</title>',
            f"<style>{STYLE} td {{ text-align: left; vertical-align: top; }} th {{ text-align: left; }}</style></head>",
            f"<body><h1>{title}</h1>",
            '<p class="lead">Wang et al., J. Cent. South Univ. 25(9):2131-2142 (2018), on synthetic tank data</p>',
            f'<img alt="prediction, headings and errors" src="data:image/png;base64,{encoded}">',
            "<table>" + "\n".join(lines) + "</table></body></html>\n",
        ]
    )
