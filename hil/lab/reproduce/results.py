"""What the chain results in: the rows beside the paper, its table 2, and its equations with coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from hil.lab.reproduce import table_2
from hil.lab.reproduce.chain import Chain
from hil.lab.reproduce.equations import Equation, equations
from hil.lab.reproduce.rows import Row, rows
from hil.lab.reproduce.table_2 import TableRow
from hil.ship.regressions import FLOAT, sway_model

COLUMNS = ("quantity", "paper", "ours", "")
TABLE_2_TITLE = "Table 2: K, T and alpha at typical speeds"
EQUATIONS_TITLE = "Equations 1 to 3 with their coefficients, in SI units"


@dataclass(frozen=True, slots=True)
class Results:
    """Everything that is reported."""

    rows: tuple[Row, ...]
    table_2: tuple[TableRow, ...]
    table_2_note: str
    equations: tuple[Equation, ...]
    equations_notes: tuple[str, ...]


def results(chain: Chain) -> Results:
    """Return the results of a chain."""
    model = chain.model
    dimensions = (
        f"L = {FLOAT.length_m:g} m, B = {FLOAT.beam_m:g} m, D = {FLOAT.draft_m:g} m, m = {FLOAT.mass_kg:g} kg, "
        f"Cb = {FLOAT.block_coefficient:.3g}, U = {model.speed_m_s:g} m/s. The dimensions are those of a published "
        "float of the same class; the paper's main particulars are not in the text that we have"
    )
    return Results(
        rows(chain),
        table_2.table_2(model),
        table_2.note(model, FLOAT.length_m),
        equations(FLOAT, model),
        (dimensions, *sway_model(FLOAT).warnings),
    )


def text(found: Results) -> str:
    """Return all of it for a terminal."""
    lines = [rows_text(found.rows), "", TABLE_2_TITLE, *_columns(table_2.cells(found.table_2)), found.table_2_note]
    lines += ["", EQUATIONS_TITLE]
    for equation in found.equations:
        lines += [equation.title, *(f"    {line}" for line in equation.lines)]
    return "\n".join([*lines, *found.equations_notes])


def rows_text(table: Sequence[Row]) -> str:
    """Return the rows, a note below its row."""
    lines = _columns([COLUMNS, *((row.quantity, row.paper, row.ours, row.verdict.value) for row in table)])
    below = [lines[0]]
    for line, row in zip(lines[1:], table, strict=True):
        below += [line, *([f"    {row.note}"] if row.note else [])]
    return "\n".join(below)


def _columns(cells: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]
