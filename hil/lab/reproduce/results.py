"""Results of the reproduction: comparison with the paper, its table 2, and its equations 1 to 3 with coefficients."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from firmware_py.common.angles import METRES_PER_SECOND_PER_KNOT
from firmware_py.model.kt import OCEAN_RAMBLER, KtModel
from hil.lab import similarity
from hil.lab.reproduce.chain import Chain
from hil.lab.reproduce.rows import NOT_PRINTED, Row, rows
from hil.ship.manoeuvring import sway_ratios
from hil.ship.regressions import (
    FLOAT,
    HullForm,
    surge_added_mass_ratio,
    sway_acceleration_derivative,
    sway_model,
    sway_velocity_derivative,
)

SPEEDS_KN = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0)
TABLE_2_COLUMNS = ("speed kn", "m/s", "K 1/s", "T s", "alpha s^2", "K 1/s *", "T s *", "alpha s^2 *", "paper")
UNBOUNDED = "-"


@dataclass(frozen=True, slots=True)
class ScaledModel:
    """K [1/s], T [s] and alpha [s^2] at a speed; at rest K is 0, and T and alpha are None (infinite)."""

    K: float
    T: float | None
    alpha: float | None


@dataclass(frozen=True, slots=True)
class TableRow:
    """A speed with both models; `printed` is the model that the paper prints for 0.4 m/s, scaled to this speed."""

    speed_kn: float
    speed_m_s: float
    printed: ScaledModel
    ours: ScaledModel


def speed_table(model: KtModel) -> tuple[TableRow, ...]:
    """Return the rows of table 2, at SPEEDS_KN, for our model and for that of the paper."""
    rows = []
    for speed_kn in SPEEDS_KN:
        speed_m_s = speed_kn * METRES_PER_SECOND_PER_KNOT
        rows.append(TableRow(speed_kn, speed_m_s, _scaled(OCEAN_RAMBLER, speed_m_s), _scaled(model, speed_m_s)))
    return tuple(rows)


def _scaled(model: KtModel, speed_m_s: float) -> ScaledModel:
    return ScaledModel(*model.at_speed(speed_m_s)[:3]) if speed_m_s > 0.0 else ScaledModel(0.0, None, None)


def table_2_cells(table: Sequence[TableRow]) -> list[tuple[str, ...]]:
    """Return the table as texts; the first row contains the column names."""
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
    """Return the note below table 2."""
    printed, numbers = OCEAN_RAMBLER, similarity.dimensionless(model, length_m)
    return (
        f"By similarity (equation 7). With L = {length_m:g} m, our model has K' = K L/U = {numbers.turning_ability:.4g}"
        f", T' = T U/L = {numbers.turning_lag:.4g}, alpha' = alpha (U/L)^2 = {numbers.norrbin:.4g} at all speeds. "
        "At rest K is 0; T and alpha are infinite. *: from the model of the paper, "
        f"K {printed.turning_ability_1_s:g} 1/s, T {printed.turning_lag_s:g} s, alpha {printed.norrbin_s2:g} s^2 at "
        f"{printed.speed_m_s:g} m/s."
    )


def table_2_json(table: Sequence[TableRow]) -> list[dict[str, Any]]:
    """Return the rows for JSON."""
    return [{**asdict(row), "paper": NOT_PRINTED} for row in table]


@dataclass(frozen=True, slots=True)
class Equation:
    """An equation: lines with symbols, lines with numbers in SI units, and the numbers by name."""

    number: int
    name: str
    symbols: tuple[str, ...]
    numbers: tuple[str, ...]
    coefficients: dict[str, float]

    @property
    def title(self) -> str:
        """Return number and name."""
        return f"({self.number}) {self.name}"

    @property
    def lines(self) -> tuple[str, ...]:
        """Return the lines with symbols, then those with numbers."""
        return self.symbols + tuple(f"    {line}" for line in self.numbers)


def equations(hull: HullForm, model: KtModel) -> tuple[Equation, ...]:
    """Return the equations for a hull and its model, at the speed of the model."""
    return _kinematics(model), _dynamics(hull, model), _regressions(hull, model)


def _kinematics(model: KtModel) -> Equation:
    speed = f"{model.speed_m_s:.4g}"
    return Equation(
        1,
        "track and heading",
        ("dx/dt = U cos psi - v sin psi", "dy/dt = U sin psi + v cos psi", "dpsi/dt = r"),
        (f"dx/dt = {speed} cos psi - v sin psi", f"dy/dt = {speed} sin psi + v cos psi", "dpsi/dt = r"),
        {"U_m_s": model.speed_m_s},
    )


def _dynamics(hull: HullForm, model: KtModel) -> Equation:
    sway, speed_m_s = sway_model(hull), model.speed_m_s
    damping_kg_s = sway.sway_damping_kg_s(speed_m_s)
    drive_m_s, damping_1_s = sway_ratios(sway, speed_m_s)
    ability_1_s, lag_s, norrbin_s2 = model[:3]
    return Equation(
        2,
        "sway and yaw",
        ("m22 dv/dt = -m11 U r + Yv v", "T dr/dt + r + alpha r^3 = K (delta - delta0)"),
        (
            f"{sway.sway_mass_kg:.4g} dv/dt = -{sway.surge_mass_kg:.4g} x {speed_m_s:.4g} r - {-damping_kg_s:.4g} v",
            f"dv/dt = -{-drive_m_s:.4g} r - {-damping_1_s:.4g} v",
            f"{lag_s:.4g} dr/dt + r + {norrbin_s2:.4g} r^3 = {ability_1_s:.4g} (delta - delta0)",
        ),
        {
            "m11_kg": sway.surge_mass_kg,
            "m22_kg": sway.sway_mass_kg,
            "Yv_kg_s": damping_kg_s,
            "K_1_s": ability_1_s,
            "T_s": lag_s,
            "alpha_s2": norrbin_s2,
        },
    )


def _regressions(hull: HullForm, model: KtModel) -> Equation:
    sway = sway_model(hull)
    cb, l_b = hull.block_coefficient, hull.length_m / hull.beam_m
    d_b, b_d = hull.draft_m / hull.beam_m, hull.beam_m / hull.draft_m
    d_l, b_l = hull.draft_m / hull.length_m, hull.beam_m / hull.length_m
    surge_ratio = surge_added_mass_ratio(hull)
    acceleration, velocity = sway_acceleration_derivative(hull), sway_velocity_derivative(hull)
    damping_kg_s = sway.sway_damping_kg_s(model.speed_m_s)
    added_sway_kg = sway.sway_mass_kg - hull.mass_kg
    return Equation(
        3,
        "added masses and sway damping (Zhou; Clarke et al. 1982)",
        (
            (
                "m11 = m (1 + mx/m), 100 mx/m = 0.398 + 11.97 Cb (1 + 3.73 D/B) - 2.89 Cb L/B (1 + 1.13 D/B) "
                "+ 0.175 Cb (L/B)^2 (1 + 0.541 D/B) - 1.107 L/B D/B"
            ),
            "m22 = m - (rho/2) L^3 Y'vdot, Y'vdot = -pi (D/L)^2 (1 + 0.16 Cb B/D - 5.1 (B/L)^2)",
            "Yv = (rho/2) L^2 U Y'v, Y'v = -pi (D/L)^2 (1 + 0.40 Cb B/D)",
        ),
        (
            (
                f"100 mx/m = 0.398 + {11.97 * cb * (1.0 + 3.73 * d_b):.4g} "
                f"- {2.89 * cb * l_b * (1.0 + 1.13 * d_b):.4g} "
                f"+ {0.175 * cb * l_b**2 * (1.0 + 0.541 * d_b):.4g} - {1.107 * l_b * d_b:.4g} "
                f"= {100.0 * surge_ratio:.4g}; m11 = {sway.surge_mass_kg:.4g} kg"
            ),
            (
                f"Y'vdot = -{math.pi * d_l**2:.4g} (1 + {0.16 * cb * b_d:.4g} - {5.1 * b_l**2:.4g}) "
                f"= {acceleration:.4g}; m22 = {hull.mass_kg:g} + {added_sway_kg:.4g} = {sway.sway_mass_kg:.4g} kg"
            ),
            (
                f"Y'v = -{math.pi * d_l**2:.4g} (1 + {0.40 * cb * b_d:.4g}) = {velocity:.4g}; "
                f"Yv = {sway.sway_damping_kg_m:.4g} U = {damping_kg_s:.4g} kg/s"
            ),
        ),
        {
            "L_m": hull.length_m,
            "B_m": hull.beam_m,
            "D_m": hull.draft_m,
            "m_kg": hull.mass_kg,
            "Cb": cb,
            "mx_over_m": surge_ratio,
            "Yvdot_dimensionless": acceleration,
            "Yv_dimensionless": velocity,
        },
    )


COLUMNS = ("quantity", "paper", "ours", "")
TABLE_2_TITLE = "Table 2: K, T and alpha at typical speeds"
EQUATIONS_TITLE = "Equations 1 to 3 with their coefficients, in SI units"


@dataclass(frozen=True, slots=True)
class Results:
    """All reported results."""

    rows: tuple[Row, ...]
    table_2: tuple[TableRow, ...]
    table_2_note: str
    equations: tuple[Equation, ...]
    equations_notes: tuple[str, ...]


def results(chain: Chain) -> Results:
    """Compute the reported results of a chain."""
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


def text(reported: Results) -> str:
    """Return the text for the terminal."""
    lines = [
        rows_text(reported.rows),
        "",
        TABLE_2_TITLE,
        *_columns(table_2_cells(reported.table_2)),
        reported.table_2_note,
    ]
    lines += ["", EQUATIONS_TITLE]
    for equation in reported.equations:
        lines += [equation.title, *(f"    {line}" for line in equation.lines)]
    return "\n".join([*lines, *reported.equations_notes])


def rows_text(table: Sequence[Row]) -> str:
    """Return the rows as text, each with its note in the next line."""
    lines = _columns([COLUMNS, *((row.quantity, row.paper, row.ours, row.verdict.value) for row in table)])
    lines_with_notes = [lines[0]]
    for line, row in zip(lines[1:], table, strict=True):
        lines_with_notes += [line, *([f"    {row.note}"] if row.note else [])]
    return "\n".join(lines_with_notes)


def _columns(cells: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.ljust, row, widths)).rstrip() for row in cells]
