"""Read the manoeuvre CSV; errors name file, line and remedy.

Columns by name, in any order: time_s, rudder_rad, heading_rad, yaw_rate_rad_s, speed_m_s, or other common names
(columns.py), with the unit in the name or below it: heading_deg, Rudder [deg], SOG (kn). Heading or yaw rate is
required; columns and single cells may be empty (rows.py). Separators are commas, semicolons, tabs or spaces. Numbers
may have a decimal comma, except in a table with commas. Times are seconds, or in a format of table.py. Other columns,
and lines above and below the table, are ignored (table_text.py).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from firmware_py.common.angles import degrees, radians
from hil.errors import UsageError
from hil.lab.identify import rows, units
from hil.lab.identify.columns import NAMES, NO_ANGLE
from hil.lab.identify.recording import Floats, Recording
from hil.lab.identify.table import Raw, Table, spread_shared_times
from hil.lab.identify.table_text import read_text

RUDDER_UNITS = ("rad", "deg", "any")
MAX_COMMAND = 1e6
MAX_GUESSED_RUDDER_DEG = 60.0  # larger values without a unit are not assumed to be degrees
ANGLE_UNITS = {1.0: "radians", radians(1.0): "degrees"}
YAW_RATE_UNITS = {
    1.0: "radians per second",
    radians(1.0): "degrees per second",
    radians(1.0) / 60.0: "degrees per minute",
}


def read(path: Path, rudder_unit: str = "rad") -> Recording:
    """Read a file, or raise UsageError with line and remedy.

    rudder_unit: "rad", "deg", or "any" for a signed command of any unit, such as the difference of two thrusters; K is
    then per this unit.
    """
    text = read_text(path)
    if len(text.cells) < 2:
        count = "one row" if text.cells else "no rows"
        raise UsageError(f"{path}: {count} below the column names; record at least a zigzag")
    table = Table(path, text.line_numbers, text.columns, text.notes)
    _check_rudder(table, rudder_unit)
    raw = {name: table.column(name, [row[column.index] for row in text.cells]) for name, column in text.columns.items()}
    return _recording(*_clean_columns(*rows.clean_rows(table, raw)), rudder_unit)


def _check_rudder(table: Table, unit: str) -> None:
    """Raise UsageError if the name of the rudder column excludes an angle; add a note for a rudder command."""
    column = table.columns["rudder_rad"]
    if column.unit == NO_ANGLE and unit != "any":
        raise UsageError(
            f"{table.path}: {column.label} is not an angle; use --rudder-unit any (K is then per its unit, without a "
            "parameter file), or convert it to rudder_deg with the maximum rudder angle"
        )
    if column.is_command:
        table.notes.append(f"column {column.label} is a rudder command, so T includes the servo lag")


def _clean_columns(table: Table, raw: Raw) -> tuple[Table, dict[str, Floats]]:
    """Spread rows with the same coarse time, check the order, and interpolate or remove missing cells."""
    time_s = raw["time_s"]
    if time_s is None or raw["rudder_rad"] is None:
        missing = "time_s" if time_s is None else "rudder_rad"
        raise UsageError(f"{table.path}:{table.line_numbers[0]}: column {missing} is empty; fill it")
    if raw.get("heading_rad") is None and raw.get("yaw_rate_rad_s") is None:
        where = f"{table.path}:{table.line_numbers[0]}"
        raise UsageError(f"{where}: heading_rad and yaw_rate_rad_s are both empty; fill one of them")
    spread = spread_shared_times(time_s)
    if spread is not None:
        table.notes.append(f"{table.columns['time_s'].label} is too coarse to distinguish rows: times spread evenly")
        time_s = spread
    rows.check_time_order(table, time_s)
    changed_values = rows.remove_repeated_values(
        raw, {name: column.label for name, column in table.columns.items()}, table.notes
    )
    filled_columns, valid_rows = rows.fill_gaps(table.path, time_s, changed_values | {"time_s": time_s}, table.notes)
    table, columns = rows.select_rows(table, filled_columns, valid_rows)
    return table, {name: values for name, values in columns.items() if values is not None}


def _recording(table: Table, raw: dict[str, Floats], unit: str) -> Recording:
    """Convert columns to seconds, radians and metres per second."""
    path, line_numbers = table.path, table.line_numbers
    time_s, rudder = raw["time_s"] * table.unit("time_s", 1.0), raw["rudder_rad"]
    heading, rate = raw.get("heading_rad"), raw.get("yaw_rate_rad_s")
    without_unit = {name: values for name, values in raw.items() if not table.columns[name].has_unit}
    in_degrees = units.are_degrees(
        without_unit.get("rudder_rad") if unit == "rad" else None, without_unit.get("heading_rad")
    )
    angle = radians(1.0) if in_degrees or unit == "deg" else 1.0
    if unit == "rad" and in_degrees and "rudder_rad" in without_unit:
        _check_degrees(table, rudder)
    assumed_units = dict.fromkeys(NAMES[1:3], ANGLE_UNITS[angle]) | {"speed_m_s": "metres per second"}
    if unit == "any":
        assumed_units.pop("rudder_rad")
    if heading is not None:
        heading = heading * table.unit("heading_rad", angle)
    if rate is not None:
        default = angle if heading is None else units.rate_unit(time_s, heading, rate)
        assumed_units["yaw_rate_rad_s"] = YAW_RATE_UNITS[default]
        rate = rate * table.unit("yaw_rate_rad_s", default)
    notes = table.notes + [
        _note(table, name, assumed_units[name]) for name in NAMES if name in without_unit and name in assumed_units
    ]
    speed = raw.get("speed_m_s")
    speed = None if speed is None else speed * table.unit("speed_m_s", 1.0)
    unit_size = table.unit("rudder_rad", angle)
    rudder, rudder_notes = _rudder(path, line_numbers, rudder, "deg" if unit == "rad" and unit_size != 1.0 else unit)
    table.check("yaw_rate_rad_s", rate)
    if unit != "any":
        all_units_named = (
            all(table.columns[name].has_unit for name in table.columns if name != "time_s") and unit_size != 1.0
        )
        angles = units.convert_angles(
            str(path),
            time_s,
            heading,
            rate,
            speed,
            is_rudder_in_degrees=unit == "deg" and not all_units_named,
            are_units_named=not without_unit,
        )
        heading, rate = angles.heading_rad, angles.yaw_rate_rad_s
        rudder_notes += angles.notes
        table.warnings.extend(angles.warnings)
    return Recording(str(path), time_s, rudder, heading, rate, speed, (*notes, *rudder_notes), tuple(table.warnings))


def _note(table: Table, name: str, unit: str) -> str:
    return f"column {table.columns[name].label} has no unit: {unit} assumed"


def _check_degrees(table: Table, rudder: Floats) -> None:
    """Raise UsageError for a rudder without unit whose values are unlikely for degrees."""
    label, max_size = table.columns["rudder_rad"].label, float(np.max(np.abs(rudder)))
    if units.MAX_RUDDER_RAD < max_size <= MAX_GUESSED_RUDDER_DEG:
        return
    raise UsageError(
        f"{table.path}: {label} has values up to {max_size:.3g} and no unit: name it rudder_rad or rudder_deg, or use "
        "--rudder-unit any for a command that is not an angle"
    )


def _rudder(path: Path, line_numbers: list[int], rudder: Floats, unit: str) -> tuple[Floats, tuple[str, ...]]:
    """Return the rudder in radians, or the unchanged command."""
    if unit == "any":
        limit, label = MAX_COMMAND, f"{MAX_COMMAND:g}"
    else:
        limit, label = (90.0, "90 deg") if unit == "deg" else (radians(90.0), "90 deg (1.5708 rad)")
    invalid = np.flatnonzero(np.abs(rudder) > limit * (1.0 + 1e-6))
    if invalid.size:
        first = int(invalid[0])
        guess = "" if unit == "any" else "; "
        if unit == "rad":
            guess += "for degrees use --rudder-unit deg; "
        if unit != "any":
            guess += "for a command that is not an angle use --rudder-unit any"
        raise UsageError(
            f"{path}:{line_numbers[first]}: rudder_rad {rudder[first]:g} is beyond {label}{guess or '; scale it'}"
        )
    if unit == "deg":
        return rudder * radians(1.0), (f"rudder converted from degrees (up to {np.max(np.abs(rudder)):.0f} deg)",)
    if unit == "any":
        return rudder, ("the rudder column is a command of unknown unit: K is per this unit, delta0 in it",)
    if degrees(float(np.max(np.abs(rudder)))) > 60.0:
        return rudder, ("rudder angles beyond 60 deg: use --rudder-unit deg or any if these are not radians",)
    return rudder, ()
