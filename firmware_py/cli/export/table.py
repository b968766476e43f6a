"""Write CSV or Parquet: one row per tick, in degrees, metres and seconds. A value without a message is empty."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from firmware_py.cli.export.messages import read_messages
from firmware_py.common.angles import compass_degrees, degrees
from firmware_py.common.mode_table import Mode
from firmware_py.log.dataflash import Buffer

Converter = Callable[[Any], Any]
_BATCH_ROWS: Final = 20_000  # rows per write


def _identity(value: Any) -> Any:
    return value


def _mode_name(value: int) -> str:
    return Mode(value).name if value in set(Mode) else str(value)


# message -> log column -> table column and converter
_COLUMNS: Final[Mapping[str, Mapping[str, tuple[str, Converter]]]] = {
    "TICK": {"Tick": ("tick", _identity), "T": ("time_s", _identity), "Late": ("late_s", _identity)},
    "FIX": {
        "Utc": ("utc_s", _identity),
        "LatR": ("latitude_deg", degrees),
        "LngR": ("longitude_deg", degrees),
        "Sog": ("speed_over_ground_m_s", _identity),
        "Cog": ("course_over_ground_deg", compass_degrees),
        "NSat": ("satellites", _identity),
        "HDop": ("hdop", _identity),
    },
    "RFB": {"Temp": ("servo_c", _identity), "Volt": ("servo_v", _identity), "Curr": ("servo_a", _identity)},
    "CTL": {
        "Mode": ("mode", _mode_name),
        "Arm": ("armed", bool),
        "Flt": ("faults", _identity),
        "RudC": ("rudder_command_deg", degrees),
        "Rud": ("rudder_deg", degrees),
    },
    "NAV": {
        "Hdg": ("heading_deg", compass_degrees),
        "YawR": ("yaw_rate_deg_s", degrees),
        "Roll": ("roll_deg", degrees),
        "Pitch": ("pitch_deg", degrees),
        "Goal": ("goal_deg", compass_degrees),
        "Err": ("error_deg", degrees),
        "Dist": ("distance_m", _identity),
    },
    "EST": {
        "Hdg": ("estimated_heading_deg", compass_degrees),
        "Bias": ("rudder_bias_deg", degrees),
        "WT": ("wave_period_s", _identity),
        "WSd": ("wave_sd_deg", degrees),
    },
    "GDN": {
        "XTrk": ("cross_track_m", _identity),
        "Fnc": ("fence_margin_m", _identity),
        "MItm": ("mission_index", _identity),
    },
    "WTR": {
        "U": ("water_speed_m_s", _identity),
        "CN": ("current_north_m_s", _identity),
        "CE": ("current_east_m_s", _identity),
    },
    "SUPL": {
        "Volt": ("battery_v", _identity),
        "Curr": ("battery_a", _identity),
        "SoC": ("charge", _identity),
        "Sun": ("solar_w", _identity),
        "Load": ("load_w", _identity),
    },
    "WNDG": {
        "Spd": ("wind_m_s", _identity),
        "Dir": ("wind_from_deg", compass_degrees),
        "Mean": ("mean_wind_m_s", _identity),
        "Gust": ("gust_m_s", _identity),
    },
    "DEP": {"Depth": ("water_depth_m", _identity)},
}
NAMES: Final = tuple(name for columns in _COLUMNS.values() for name, _ in columns.values())
_TEXT_COLUMNS, _BOOL_COLUMNS = frozenset({"mode"}), frozenset({"armed"})


def read_rows(buffer: Buffer) -> Iterator[dict[str, Any]]:
    """Yield a row for each complete tick."""
    row: dict[str, Any] = {}
    for message in read_messages(buffer, {*_COLUMNS, "END"}):
        if message.name == "END":
            if "time_s" in row:
                yield row
            row = {}
            continue
        for label, (name, convert) in _COLUMNS[message.name].items():
            value = message.values.get(label)
            if value is not None and (not isinstance(value, float) or math.isfinite(value)):
                row[name] = convert(value)


def write(kind: str, buffer: Buffer, path: Path, _out: Path) -> str:
    """Write the table; return a summary, empty without rows."""
    count = (_write_csv if kind == "csv" else _write_parquet)(read_rows(buffer), path)
    return f"{count} rows" if count else ""


def _write_csv(table: Iterator[dict[str, Any]], path: Path) -> int:
    count = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, NAMES, restval="")
        writer.writeheader()
        for row in table:
            writer.writerow(
                {name: f"{value:.10g}" if isinstance(value, float) else value for name, value in row.items()}
            )
            count += 1
    return count


def _write_parquet(table: Iterator[dict[str, Any]], path: Path) -> int:
    import pyarrow as pa  # type: ignore[import-not-found,unused-ignore] # noqa: PLC0415 - an extra
    from pyarrow import parquet  # type: ignore[import-not-found,unused-ignore] # noqa: PLC0415

    kinds = {
        name: pa.string() if name in _TEXT_COLUMNS else pa.bool_() if name in _BOOL_COLUMNS else pa.float64()
        for name in NAMES
    }
    schema, count, batch = pa.schema(list(kinds.items())), 0, []
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for row in table:
            batch.append(row)
            count += 1
            if len(batch) == _BATCH_ROWS:
                writer.write_table(pa.Table.from_pylist(batch, schema))
                batch = []
        writer.write_table(pa.Table.from_pylist(batch, schema))
    return count
