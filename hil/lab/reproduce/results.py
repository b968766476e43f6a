"""Results of the chain: comparison with the paper, its table 2, and its equations with coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from firmware_py.common.angles import METRES_PER_SECOND_PER_KNOT
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.lab import similarity
from hil.lab.reproduce.chain import Chain
from hil.lab.reproduce.equations import Equation, equations
from hil.lab.reproduce.rows import NOT_PRINTED, Row, rows
from hil.ship.regressions import FLOAT, sway_model

SPEEDS_KN = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
TABLE_2_COLUMNS = ("speed kn", "m/s", "K 1/s", "T s", "alpha s^2", "K 1/s *", "T s *", "alpha s^2 *", "paper")
UNBOUNDED = "-"


@dataclass(frozen=True, slots=True)
class Scaled:
    """K [1/s], T [s], alpha [s^2] at a speed; at rest K is 0, and T and alpha are None (infinite)."""

    K: float
    T: float | None
    alpha: float | None


@dataclass(frozen=True, slots=True)
class TableRow:
    """A speed with both models; `printed` is the model of the paper (0.4 m/s), scaled to this speed."""

    speed_kn: float
    speed_m_s: float
    printed: Scaled
    ours: Scaled


def speed_table(model: KtModel) -> tuple[TableRow, ...]:
    """Return the table at SPEEDS_KN for our model and for that of the paper."""
    rows = []
    for speed_kn in SPEEDS_KN:
        speed_m_s = speed_kn * METRES_PER_SECOND_PER_KNOT
        rows.append(TableRow(speed_kn, speed_m_s, _scaled(OCEAN_RAMBLER, speed_m_s), _scaled(model, speed_m_s)))
    return tuple(rows)


def _scaled(model: KtModel, speed_m_s: float) -> Scaled:
    return Scaled(*model.at_speed(speed_m_s)[:3]) if speed_m_s > 0.0 else Scaled(0.0, None, None)


def table_2_cells(table: Sequence[TableRow]) -> list[tuple[str, ...]]:
    """Return the table as texts, starting with the column names."""
    rows: list[tuple[str, ...]] = [TABLE_2_COLUMNS]
    for row in table:
        numbers = [
            UNBOUNDED if value is None else f"{value:.4g}"
            for scaled in (row.ours, row.printed)
            for value in (scaled.K, scaled.T, scaled.alpha)
        ]
        rows.append((f"{row.speed_kn:g}", f"{row.speed_m_s:.3f}", *numbers, NOT_PRINTED))
    return rows


def table_2_note(model: KtModel, length_m: float) -> str:
    """Return the explanation of the table."""
    printed, same = OCEAN_RAMBLER, similarity.dimensionless(model, length_m)
    return (
        f"By similarity (equation 7). With L = {length_m:g} m, our model has K' = K L/U = {same.turning_ability:.4g}, "
        f"T' = T U/L = {same.turning_lag:.4g}, alpha' = alpha (U/L)^2 = {same.norrbin:.4g} at all speeds. "
        "At rest K is 0; T and alpha are infinite. *: from the model of the paper, "
        f"K {printed.turning_ability_1_s:g} 1/s, T {printed.turning_lag_s:g} s, alpha {printed.norrbin_s2:g} s^2 at "
        f"{printed.speed_m_s:g} m/s."
    )


def table_2_json(table: Sequence[TableRow]) -> list[dict[str, Any]]:
    """Return the rows for JSON."""
    return [{**asdict(row), "paper": NOT_PRINTED} for row in table]


COLUMNS = ("quantity", "paper", "ours", "")
TABLE_2_TITLE = "Table 2: K, T and alpha at typical speeds"
EQUATIONS_TITLE = "Equations 1 to 3 with their coefficients, in SI units"


@dataclass(frozen=True, slots=True)
class Results:
    """The reported results."""

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
        "float of the same class; the text of the paper that we have does not contain its main particulars"
    )
    return Results(
        rows(chain),
        speed_table(model),
        table_2_note(model, FLOAT.length_m),
        equations(FLOAT, model),
        (dimensions, *sway_model(FLOAT).warnings),
    )


def text(found: Results) -> str:
    """Return the text for the terminal."""
    lines = [rows_text(found.rows), "", TABLE_2_TITLE, *_columns(table_2_cells(found.table_2)), found.table_2_note]
    lines += ["", EQUATIONS_TITLE]
    for equation in found.equations:
        lines += [equation.title, *(f"    {line}" for line in equation.lines)]
    return "\n".join([*lines, *found.equations_notes])


def rows_text(table: Sequence[Row]) -> str:
    """Return the rows, each with its note below."""
    lines = _columns([COLUMNS, *((row.quantity, row.paper, row.ours, row.verdict.value) for row in table)])
    below = [lines[0]]
    for line, row in zip(lines[1:], table, strict=True):
        below += [line, *([f"    {row.note}"] if row.note else [])]
    return "\n".join(below)


def _columns(cells: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]
