"""Read a table of headings, with optional rudder angle, position, speeds and goal.

The columns are found by name as in a manoeuvre file (hil/lab/identify/columns.py), with units in the names: time_s,
heading_deg, rudder_deg, yaw_rate_deg_s, speed_m_s through the water, sog_m_s and cog_deg over ground, lat_deg, lon_deg,
goal_deg. Cells may be empty. Repeated values of a slower sensor count once.
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
from hil.lab.identify.table import Raw, Table, spread_evenly
from hil.lab.identify.table_text import read_text

ANGLES = ("heading_rad", "rudder_rad", "cog_rad", "goal_rad")
PLACES = ("lat_rad", "lon_rad")
MAX_RUDDER_RAD = radians(90.0)


def read(path: Path) -> Recording:
    """Read a file, or raise UsageError with line and remedy."""
    text = read_text(path, MOTION)
    if len(text.cells) < MIN_ROWS:
        raise UsageError(f"{path}: {len(text.cells)} rows below the column names; give a recording of several minutes")
    table = Table(path, text.numbers, text.places, text.notes, detects_milliseconds=False)
    raw = {name: table.column(name, [row[column.place] for row in text.cells]) for name, column in text.places.items()}
    table, raw = rows.in_order(table, raw)
    time_s = _times(table, raw)
    columns = _converted(table, raw, time_s)
    return _recording(table, time_s, columns)


def _times(table: Table, raw: Raw) -> Floats:
    """Return increasing times in seconds."""
    time_s = raw["time_s"]
    if time_s is None:
        raise UsageError(f"{table.path}:{table.numbers[0]}: column time_s is empty; fill it")
    if (spread := spread_evenly(time_s)) is not None:
        table.notes.append(f"{table.places['time_s'].label} is too coarse to tell rows apart: spread evenly")
        time_s = spread
    rows.check_order(table, time_s)
    return time_s * table.unit("time_s", 1.0)


def _converted(table: Table, raw: Raw, time_s: Floats) -> dict[str, Floats]:
    """Return the columns that contain values, in radians and metres per second; missing cells are NaN."""
    raw = rows.without_repeats(raw, {name: column.label for name, column in table.places.items()}, table.notes)
    columns = {name: values for name, values in raw.items() if values is not None and name != "time_s"}
    heading = columns.get("heading_rad")
    if heading is None or np.count_nonzero(np.isfinite(heading)) < MIN_ROWS:
        count = 0 if heading is None else np.count_nonzero(np.isfinite(heading))
        label = table.places["heading_rad"].label
        raise UsageError(f"{table.path}:{table.numbers[0]}: {label} has {count} headings; give at least {MIN_ROWS}")
    known = heading[np.isfinite(heading)]
    if table.places["heading_rad"].known and table.unit("heading_rad", 1.0) == 1.0 and units.goes_round_at_360(known):
        label = table.places["heading_rad"].label
        raise UsageError(f"{table.path}: {label} jumps by 360, so its unit is degrees; name the column heading_deg")
    if "rudder_rad" in columns:
        _check_rudder(table)
    for name in ANGLES:
        if name in columns:
            columns[name] = columns[name] * _angle(table, name, columns[name])
    for name in PLACES:
        if name in columns:
            columns[name] = columns[name] * _unit(table, name, radians(1.0), "degrees")
    for name in ("speed_m_s", "sog_m_s"):
        if name in columns:
            columns[name] = columns[name] * _unit(table, name, 1.0, "metres per second")
    if (rate := columns.get("yaw_rate_rad_s")) is not None:
        both = np.isfinite(rate) & np.isfinite(heading)
        usual = 1.0
        if not table.places["yaw_rate_rad_s"].known and np.count_nonzero(both) >= MIN_ROWS:
            usual = units.rate_unit(time_s[both], columns["heading_rad"][both], rate[both])
        columns["yaw_rate_rad_s"] = rate * _unit(table, "yaw_rate_rad_s", usual, f"units of {usual:.3g} rad/s")
        table.check("yaw_rate_rad_s", np.where(np.isnan(rate), 0.0, columns["yaw_rate_rad_s"]))
    _check_range(table, columns.get("rudder_rad"))
    return columns


def _check_rudder(table: Table) -> None:
    column = table.places["rudder_rad"]
    if column.unit == NO_ANGLE:
        raise UsageError(
            f"{table.path}: {column.label} is not an angle; convert it to rudder_deg, or remove the column"
        )
    if column.is_command:
        table.notes.append(f"column {column.label} is a rudder command; used as rudder angle")


def _check_range(table: Table, rudder_rad: Floats | None) -> None:
    if rudder_rad is None:
        return
    wrong = np.flatnonzero(np.abs(rudder_rad) > MAX_RUDDER_RAD * (1.0 + 1e-6))
    if wrong.size:
        at = int(wrong[0])
        label, angle_deg = table.places["rudder_rad"].label, degrees(float(rudder_rad[at]))
        raise UsageError(
            f"{table.path}:{table.numbers[at]}: {label} is {angle_deg:.4g} deg, beyond 90 deg; name the column by its "
            "unit, rudder_deg or rudder_rad"
        )


def _angle(table: Table, name: str, values: Floats) -> float:
    """Return the unit of an angle; without one in the name, values too large for radians are degrees."""
    known = values[np.isfinite(values)]
    beyond = units.TURN_RAD if name != "rudder_rad" else units.MAX_RUDDER_RAD
    degree = known.size > 0 and float(np.max(np.abs(known))) > beyond
    return _unit(table, name, radians(1.0) if degree else 1.0, "degrees" if degree else "radians")


def _unit(table: Table, name: str, usual: float, unit_name: str) -> float:
    column = table.places[name]
    if not column.known:
        table.notes.append(f"column {column.label} has no unit: {unit_name} assumed")
    return table.unit(name, usual)


def _recording(table: Table, time_s: Floats, columns: dict[str, Floats]) -> Recording:
    """Return the samples."""
    heading = columns["heading_rad"]
    begin_s = float(time_s[np.isfinite(heading)][0])
    since_s = (time_s - begin_s).tolist()
    rate = _cells(columns, "yaw_rate_rad_s", len(since_s))
    headings = [
        HeadingSample(t_s, angle % math.tau, NorthReference.TRUE, yaw_rate_rad_s=turn)
        for t_s, angle, turn in zip(since_s, heading.tolist(), rate, strict=True)
        if math.isfinite(angle)
    ]
    rudder = [
        RudderFeedback(t_s, angle)
        for t_s, angle in zip(since_s, _cells(columns, "rudder_rad", len(since_s)), strict=True)
        if angle is not None
    ]
    goal_rad = columns.get("goal_rad", np.zeros(0))
    return Recording(
        str(table.path),
        begin_s,
        time_s[np.isfinite(heading)],
        tuple(headings),
        tuple(_positions(since_s, columns)),
        tuple(rudder),
        np.array(since_s[: goal_rad.size]),
        goal_rad,
        water_m_s=_mean(columns.get("speed_m_s")),
        ground_m_s=_mean(columns.get("sog_m_s")),
        notes=tuple(table.notes),
    )


def _positions(since_s: list[float], columns: dict[str, Floats]) -> list[PositionSample]:
    """Return a fix for each row with a new position or velocity."""
    cells = [_cells(columns, name, len(since_s)) for name in (*PLACES, "sog_m_s", "cog_rad")]
    fixes, before = [], None
    for t_s, *row in zip(since_s, *cells, strict=True):
        latitude_rad, longitude_rad, speed_m_s, course_rad = row
        if latitude_rad is None or longitude_rad is None:
            latitude_rad = longitude_rad = None
        if (latitude_rad is None and speed_m_s is None) or row == before:
            continue
        before = row
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
    known = np.zeros(0) if values is None else values[np.isfinite(values)]
    return float(np.mean(known)) if known.size else None
