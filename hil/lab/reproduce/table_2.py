"""The paper's table 2: K, T and alpha at typical speeds, by similarity."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from firmware_py.common.angles import METRES_PER_SECOND_PER_KNOT
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.lab import similarity
from hil.lab.reproduce.rows import NOT_PRINTED

SPEEDS_KN = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
COLUMNS = ("speed kn", "m/s", "K 1/s", "T s", "alpha s^2", "K 1/s *", "T s *", "alpha s^2 *", "paper")
UNBOUNDED = "-"


@dataclass(frozen=True, slots=True)
class Scaled:
    """K [1/s], T [s], alpha [s^2] at a speed; at rest K is 0, and T and alpha are None, as they have no bound."""

    K: float
    T: float | None
    alpha: float | None


@dataclass(frozen=True, slots=True)
class TableRow:
    """A speed with both models: printed is the paper's K, T, alpha at 0.4 m/s, brought to this speed."""

    speed_kn: float
    speed_m_s: float
    printed: Scaled
    ours: Scaled


def table_2(model: KtModel) -> tuple[TableRow, ...]:
    """Return the table at SPEEDS_KN for our model, beside that of the model which the paper prints."""
    rows = []
    for speed_kn in SPEEDS_KN:
        speed_m_s = speed_kn * METRES_PER_SECOND_PER_KNOT
        rows.append(TableRow(speed_kn, speed_m_s, _scaled(OCEAN_RAMBLER, speed_m_s), _scaled(model, speed_m_s)))
    return tuple(rows)


def _scaled(model: KtModel, speed_m_s: float) -> Scaled:
    return Scaled(*model.at_speed(speed_m_s)[:3]) if speed_m_s > 0.0 else Scaled(0.0, None, None)


def cells(table: Sequence[TableRow]) -> list[tuple[str, ...]]:
    """Return the table as texts, its columns' names first."""
    rows: list[tuple[str, ...]] = [COLUMNS]
    for row in table:
        numbers = [
            UNBOUNDED if value is None else f"{value:.4g}"
            for scaled in (row.ours, row.printed)
            for value in (scaled.K, scaled.T, scaled.alpha)
        ]
        rows.append((f"{row.speed_kn:g}", f"{row.speed_m_s:.3f}", *numbers, NOT_PRINTED))
    return rows


def note(model: KtModel, length_m: float) -> str:
    """Explain the table."""
    printed, same = OCEAN_RAMBLER, similarity.dimensionless(model, length_m)
    return (
        f"By similarity (equation 7). With L = {length_m:g} m, our model has K' = K L/U = {same.turning_ability:.4g}, "
        f"T' = T U/L = {same.turning_lag:.4g}, alpha' = alpha (U/L)^2 = {same.norrbin:.4g} at all speeds. "
        "At rest K is 0; T and alpha have no bound. *: from the model that the paper prints, "
        f"K {printed.turning_ability_1_s:g} 1/s, T {printed.turning_lag_s:g} s, alpha {printed.norrbin_s2:g} s^2 at "
        f"{printed.speed_m_s:g} m/s."
    )


def as_json(table: Sequence[TableRow]) -> list[dict[str, Any]]:
    """Return the rows for other programs."""
    return [{**asdict(row), "paper": NOT_PRINTED} for row in table]
