"""Read a table of headings, with optional rudder angle, position, speeds and goal.

The columns are found by name as in a manoeuvre file (hil/lab/identify/columns.py), with units in the names: time_s,
heading_deg, rudder_deg, yaw_rate_deg_s, speed_m_s through the water, sog_m_s and cog_deg over ground, lat_deg, lon_deg,
goal_deg. Cells may be empty. Repeated values of a slower sensor are used once.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from firmware_py.common.angles import degrees, radians
from firmware_py.common.records import FixType, HeadingSample, NorthReference, PositionSample, RudderFeedback
from hil.errors import UsageError
from hil.lab.estimate.recording import Recording
from hil.lab.identify import rows, units
from hil.lab.identify.columns import MOTION, NO_ANGLE
from hil.lab.identify.recording import MIN_ROWS, Floats
from hil.lab.identify.table import Raw, Table, spread_shared_times
from hil.lab.identify.table_text import read_text

ANGLE_COLUMNS = ("heading_rad", "rudder_rad", "cog_rad", "goal_rad")
POSITION_COLUMNS = ("lat_rad", "lon_rad")
MAX_RUDDER_RAD = radians(90.0)


def read(path: Path) -> Recording:
    """Read a file, or raise UsageError with line and remedy."""
    text = read_text(path, MOTION)
    if len(text.cells) < MIN_ROWS:
        raise UsageError(f"{path}: {len(text.cells)} rows below the column names; give a recording of several minutes")
    table = Table(path, text.line_numbers, text.columns, text.notes, detects_milliseconds=False)
    raw = {name: table.column(name, [row[column.index] for row in text.cells]) for name, column in text.columns.items()}
    table, raw = rows.clean_rows(table, raw)
    time_s = _read_times(table, raw)
    columns = _convert_columns(table, raw, time_s)
    return _recording(table, time_s, columns)


def _read_times(table: Table, raw: Raw) -> Floats:
    """Return increasing times in seconds."""
    time_s = raw["time_s"]
    if time_s is None:
        raise UsageError(f"{table.path}:{table.line_numbers[0]}: column time_s is empty; fill it")
    if (spread := spread_shared_times(time_s)) is not None:
        table.notes.append(f"{table.columns['time_s'].label} is too coarse to tell rows apart: spread evenly")
        time_s = spread
    rows.check_time_order(table, time_s)
    return time_s * table.unit("time_s", 1.0)


def _convert_columns(table: Table, raw: Raw, time_s: Floats) -> dict[str, Floats]:
    """Convert the columns that contain values to radians and metres per second; missing cells are NaN."""
    raw = rows.remove_repeated_values(raw, {name: column.label for name, column in table.columns.items()}, table.notes)
    columns = {name: values for name, values in raw.items() if values is not None and name != "time_s"}
    heading = columns.get("heading_rad")
    if heading is None or np.count_nonzero(np.isfinite(heading)) < MIN_ROWS:
        count = 0 if heading is None else np.count_nonzero(np.isfinite(heading))
        label = table.columns["heading_rad"].label
        raise UsageError(
            f"{table.path}:{table.line_numbers[0]}: {label} has {count} headings; give at least {MIN_ROWS}"
        )
    known_values = heading[np.isfinite(heading)]
    if (
        table.columns["heading_rad"].has_unit
        and table.unit("heading_rad", 1.0) == 1.0
        and units.jumps_at_360(known_values)
    ):
        label = table.columns["heading_rad"].label
        raise UsageError(f"{table.path}: {label} jumps by 360, so its unit is degrees; name the column heading_deg")
    if "rudder_rad" in columns:
        _check_rudder(table)
    for name in ANGLE_COLUMNS:
        if name in columns:
            columns[name] = columns[name] * _angle(table, name, columns[name])
    for name in POSITION_COLUMNS:
        if name in columns:
            columns[name] = columns[name] * _unit(table, name, radians(1.0), "degrees")
    for name in ("speed_m_s", "sog_m_s"):
        if name in columns:
            columns[name] = columns[name] * _unit(table, name, 1.0, "metres per second")
    if (rate := columns.get("yaw_rate_rad_s")) is not None:
        has_both = np.isfinite(rate) & np.isfinite(heading)
        default = 1.0
        if not table.columns["yaw_rate_rad_s"].has_unit and np.count_nonzero(has_both) >= MIN_ROWS:
            default = units.rate_unit(time_s[has_both], columns["heading_rad"][has_both], rate[has_both])
        columns["yaw_rate_rad_s"] = rate * _unit(table, "yaw_rate_rad_s", default, f"units of {default:.3g} rad/s")
        table.check("yaw_rate_rad_s", np.where(np.isnan(rate), 0.0, columns["yaw_rate_rad_s"]))
    _check_range(table, columns.get("rudder_rad"))
    return columns


def _check_rudder(table: Table) -> None:
    column = table.columns["rudder_rad"]
    if column.unit == NO_ANGLE:
        raise UsageError(
            f"{table.path}: {column.label} is not an angle; convert it to rudder_deg, or remove the column"
        )
    if column.is_command:
        table.notes.append(f"column {column.label} is a rudder command; used as rudder angle")


def _check_range(table: Table, rudder_rad: Floats | None) -> None:
    if rudder_rad is None:
        return
    invalid = np.flatnonzero(np.abs(rudder_rad) > MAX_RUDDER_RAD * (1.0 + 1e-6))
    if invalid.size:
        first = int(invalid[0])
        label, angle_deg = table.columns["rudder_rad"].label, degrees(float(rudder_rad[first]))
        raise UsageError(
            f"{table.path}:{table.line_numbers[first]}: {label} is {angle_deg:.4g} deg, beyond 90 deg; name the column "
            "by its unit, rudder_deg or rudder_rad"
        )


def _angle(table: Table, name: str, values: Floats) -> float:
    """Return the unit of an angle; without a unit in the name, values that are too large for radians are degrees."""
    known_values = values[np.isfinite(values)]
    max_radians = units.MAX_HEADING_RAD if name != "rudder_rad" else units.MAX_RUDDER_RAD
    is_in_degrees = known_values.size > 0 and float(np.max(np.abs(known_values))) > max_radians
    return _unit(table, name, radians(1.0) if is_in_degrees else 1.0, "degrees" if is_in_degrees else "radians")


def _unit(table: Table, name: str, default: float, unit_name: str) -> float:
    column = table.columns[name]
    if not column.has_unit:
        table.notes.append(f"column {column.label} has no unit: {unit_name} assumed")
    return table.unit(name, default)


def _recording(table: Table, time_s: Floats, columns: dict[str, Floats]) -> Recording:
    """Convert columns to samples."""
    heading = columns["heading_rad"]
    begin_s = float(time_s[np.isfinite(heading)][0])
    times_s = (time_s - begin_s).tolist()
    rate = _cells(columns, "yaw_rate_rad_s", len(times_s))
    headings = [
        HeadingSample(t_s, angle % math.tau, NorthReference.TRUE, yaw_rate_rad_s=rate_rad_s)
        for t_s, angle, rate_rad_s in zip(times_s, heading.tolist(), rate, strict=True)
        if math.isfinite(angle)
    ]
    rudder = [
        RudderFeedback(t_s, angle)
        for t_s, angle in zip(times_s, _cells(columns, "rudder_rad", len(times_s)), strict=True)
        if angle is not None
    ]
    goal_rad = columns.get("goal_rad", np.zeros(0))
    return Recording(
        str(table.path),
        begin_s,
        time_s[np.isfinite(heading)],
        tuple(headings),
        tuple(_positions(times_s, columns)),
        tuple(rudder),
        np.array(times_s[: goal_rad.size]),
        goal_rad,
        water_m_s=_mean(columns.get("speed_m_s")),
        ground_m_s=_mean(columns.get("sog_m_s")),
        notes=tuple(table.notes),
    )


def _positions(times_s: list[float], columns: dict[str, Floats]) -> list[PositionSample]:
    """Return a fix for each row whose position or velocity differs from that of the previous row."""
    cells = [_cells(columns, name, len(times_s)) for name in (*POSITION_COLUMNS, "sog_m_s", "cog_rad")]
    fixes, previous_row = [], None
    for t_s, *row in zip(times_s, *cells, strict=True):
        latitude_rad, longitude_rad, speed_m_s, course_rad = row
        if latitude_rad is None or longitude_rad is None:
            latitude_rad = longitude_rad = None
        if (latitude_rad is None and speed_m_s is None) or row == previous_row:
            continue
        previous_row = row
        course_rad = None if course_rad is None else course_rad % math.tau
        fixes.append(
            PositionSample(
                t_s,
                FixType.FIX_3D,
                latitude_rad,
                longitude_rad,
                speed_over_ground_m_s=speed_m_s,
                course_over_ground_rad=course_rad,
            )
        )
    return fixes


def _cells(columns: dict[str, Floats], name: str, count: int) -> list[float | None]:
    values = columns.get(name)
    if values is None:
        return [None] * count
    return [value if math.isfinite(value) else None for value in values.tolist()]


def _mean(values: Floats | None) -> float | None:
    known_values = np.zeros(0) if values is None else values[np.isfinite(values)]
    return float(np.mean(known_values)) if known_values.size else None
