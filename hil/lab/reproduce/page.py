"""reproduce.png, reproduce.html and reproduce.json: the picture, the table as a page, the table for programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from hil.lab.reproduce import picture
from hil.lab.reproduce.chain import Chain
from hil.lab.reproduce.rows import Row, Verdict, all_match
from hil.report import page
from hil.report.page import Cell

COLUMNS = (Cell("quantity"), Cell("paper"), Cell("ours"), Cell(""))
CLASSES = {Verdict.MATCHES: "words good", Verdict.MISSES: "words bad"}


def write(chain: Chain, table: Sequence[Row], out: Path) -> Path:
    """Write everything to out; return the path of the page."""
    png, html = out / "reproduce.png", out / "reproduce.html"
    picture.draw(chain, png)
    html.write_text(_page(table, png.read_bytes()), encoding="utf-8")
    rows = [{**asdict(row), "verdict": row.verdict.value} for row in table]
    text = json.dumps({"all_match": all_match(tuple(table)), "rows": rows}, indent=2, ensure_ascii=False)
    (out / "reproduce.json").write_text(text + "\n", encoding="utf-8")
    return html


def _page(table: Sequence[Row], png: bytes) -> str:
    source = "Wang et al., J. Cent. South Univ. 25(9):2131-2142 (2018), on synthetic tank data"
    return page.page(
        "The paper against ours",
        [
            page.paragraph(source, "lead"),
            page.image(png, "prediction, headings and errors"),
            page.table([COLUMNS, *map(_cells, table)]),
        ],
    )


def _cells(row: Row) -> tuple[Cell, ...]:
    verdict = Cell(row.verdict.value, CLASSES.get(row.verdict, "words note"))
    return Cell(row.quantity, note=row.note), Cell(row.paper), Cell(row.ours), verdict
