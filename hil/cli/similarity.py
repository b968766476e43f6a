"""`rambler-hil similarity`: the model of the ship at other speeds."""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import asdict
from pathlib import Path

from firmware_py.model.kt import KtModel
from firmware_py.vehicle import Hull
from hil.errors import UsageError
from hil.lab import similarity
from hil.ship.regressions import FLOAT, HullForm, sway_model
from hil.sim.vehicle_file import load, model_of, standard_vehicle

DEFAULT_SPEEDS = "0.2,0.4,0.6,0.8,1.0,1.2"
MAX_SPEEDS = 1000
COLUMNS = (
    "U m/s",
    "K 1/s",
    "T s",
    "alpha s^2",
    *(f"r {rudder:g} deg" for rudder in similarity.RUDDERS_DEG),
    "radius m",
    "with sway",
    "drift deg",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Define the command line."""
    parser.add_argument(
        "--speeds", default=DEFAULT_SPEEDS, metavar="U,...", help=f"speeds through the water in m/s ({DEFAULT_SPEEDS})"
    )
    parser.add_argument("--vehicle", type=Path, metavar="FILE", help="a vehicle file: model and hull")
    parser.add_argument("--json", action="store_true", help="one JSON object instead of a table")


def run(arguments: argparse.Namespace) -> int:
    """Print the model at each speed, the constants and the warnings."""
    speeds = read_speeds(arguments.speeds)
    vehicle = load(arguments.vehicle) if arguments.vehicle is not None else standard_vehicle()
    model = model_of(vehicle)
    try:
        hull = read_hull(vehicle.hull)
        rows = similarity.table(model, hull, speeds)
    except ValueError as error:
        raise UsageError(f"{arguments.vehicle or 'default hull'}: {error}") from None
    constants = similarity.dimensionless(model, hull.length_m)
    warnings = sway_model(hull).warnings
    if arguments.json:
        print(json.dumps(as_json(model, hull, constants, rows, warnings), indent=2))
    else:
        print(as_text(model, hull, constants, rows, warnings))
    return 0


def read_speeds(text: str) -> tuple[float, ...]:
    """Parse speeds between commas; raise UsageError for an invalid text."""
    speeds = []
    for word in text.split(",")[: MAX_SPEEDS + 1]:
        try:
            speed = float(word)
        except ValueError:
            speed = math.nan
        if not 0.01 <= speed <= 100.0:
            raise UsageError(f"--speeds: {word.strip()[:30]!r} is not a speed; give 0.01 to 100 m/s, as in 0.2,0.4")
        speeds.append(speed)
    if len(speeds) > MAX_SPEEDS:
        raise UsageError(f"--speeds: the maximum is {MAX_SPEEDS} speeds")
    return tuple(speeds)


def read_hull(hull: Hull) -> HullForm:
    """Return the hull of a vehicle file, or the default float; raise ValueError for an invalid one."""
    if hull == Hull():
        return FLOAT
    numbers = {name: _number(hull, name) for name in ("length_m", "beam_m", "draft_m", "mass_kg")}
    if hull.block_coefficient is None:
        return HullForm.from_mass(**numbers)
    return HullForm(**numbers, block_coefficient=hull.block_coefficient)


def _number(hull: Hull, name: str) -> float:
    value: float | None = getattr(hull, name)
    if value is None:
        raise ValueError(f"[hull] {name}: give a number")
    return value


def as_json(
    model: KtModel,
    hull: HullForm,
    constants: similarity.Dimensionless,
    rows: tuple[similarity.SpeedRow, ...],
    warnings: tuple[str, ...],
) -> dict[str, object]:
    """Return all results for JSON."""
    return {
        "model": model._asdict(),
        "hull": asdict(hull),
        "dimensionless": asdict(constants),
        "rudders_deg": similarity.RUDDERS_DEG,
        "radius_rudder_deg": similarity.RADIUS_RUDDER_DEG,
        "rows": [asdict(row) for row in rows],
        "warnings": warnings,
    }


def as_text(
    model: KtModel,
    hull: HullForm,
    constants: similarity.Dimensionless,
    rows: tuple[similarity.SpeedRow, ...],
    warnings: tuple[str, ...],
) -> str:
    """Return the table with its notes."""
    cells = [COLUMNS, *(row_cells(row) for row in rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(COLUMNS))]
    lines = ["  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True)) for row in cells]
    origin = (
        f"from K {model.turning_ability_1_s:g} 1/s, T {model.turning_lag_s:g} s, alpha {model.norrbin_s2:g} s^2 "
        f"at {model.speed_m_s:g} m/s; the same at all speeds, with L = {hull.length_m:g} m:"
    )
    dimensionless_text = (
        f"K' = K L/U = {constants.turning_ability:.4g}, T' = T U/L = {constants.turning_lag:.4g}, "
        f"alpha' = alpha (U/L)^2 = {constants.norrbin:.4g}"
    )
    legend = (
        f"r: steady yaw rate in deg/s at that rudder; radius: U/r at {similarity.RADIUS_RUDDER_DEG:g} deg of rudder"
    )
    lines += ["", origin, dimensionless_text, legend]
    lines += [f"warning: {warning}" for warning in warnings]
    return "\n".join(lines)


def row_cells(row: similarity.SpeedRow) -> tuple[str, ...]:
    """Return the cells of the row of a speed."""
    return (
        f"{row.speed_m_s:g}",
        f"{row.turning_ability_1_s:.4g}",
        f"{row.turning_lag_s:.4g}",
        f"{row.norrbin_s2:.4g}",
        *(f"{rate:.4f}" for rate in row.steady_rates_deg_s),
        f"{row.radius_m:.2f}",
        f"{row.radius_with_sway_m:.2f}",
        f"{row.drift_deg:.1f}",
    )
