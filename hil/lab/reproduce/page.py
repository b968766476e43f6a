"""reproduce.png, reproduce.html and reproduce.json: the pictures, all as a page, all for programs."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from hil.lab.reproduce import picture, table_2
from hil.lab.reproduce.chain import Chain
from hil.lab.reproduce.results import EQUATIONS_TITLE, TABLE_2_TITLE, Results
from hil.lab.reproduce.rows import Row, Verdict, all_match
from hil.report import page
from hil.report.page import Cell

COLUMNS = (Cell("quantity"), Cell("paper"), Cell("ours"), "")
CLASSES = {Verdict.MATCHES: "good", Verdict.MISSES: "bad"}
WHOLE = "words whole"  # a number is not broken in two
SOURCE = "Wang et al., J. Cent. South Univ. 25(9):2131-2142 (2018), on synthetic tank data"


def write(chain: Chain, results: Results, out: Path) -> Path:
    """Write everything to out; return the path of the page."""
    html = out / "reproduce.html"
    picture.draw(chain, out / "reproduce.png")
    html.write_text(_page(chain, results), encoding="utf-8")
    content = {
        "all_match": all_match(results.rows),
        "rows": [{**asdict(row), "verdict": row.verdict.value} for row in results.rows],
        "table_2": table_2.as_json(results.table_2),
        "equations": [asdict(equation) for equation in results.equations],
    }
    (out / "reproduce.json").write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    return html


def _page(chain: Chain, results: Results) -> str:
    equations = []
    for equation in results.equations:
        equations += [page.heading(equation.title, 3), page.verbatim("\n".join(equation.lines))]
    return page.page(
        "The paper against ours",
        [
            page.paragraph(SOURCE, "lead"),
            page.table([COLUMNS, *map(_cells, results.rows)]),
            page.heading("Figures"),
            page.images(picture.panels(chain)),
            page.heading(TABLE_2_TITLE),
            page.table(table_2.cells(results.table_2)),
            page.paragraph(results.table_2_note, "note"),
            page.heading(EQUATIONS_TITLE),
            *equations,
            page.bullets(results.equations_notes),
        ],
    )


def _cells(row: Row) -> tuple[Cell, ...]:
    verdict = Cell(row.verdict.value, CLASSES.get(row.verdict, "note"))
    return Cell(row.quantity, note=row.note), Cell(row.paper, WHOLE), Cell(row.ours, WHOLE), verdict
