"""CSV and Parquet: one row per tick, in degrees, metres and seconds; values missing in a tick are empty."""

from __future__ import annotations

import csv
import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from firmware_py.cli.export.messages import messages
from firmware_py.common.angles import compass_degrees, degrees
from firmware_py.common.mode_table import Mode
from firmware_py.log.dataflash import Buffer

Convert = Callable[[Any], Any]
_BATCH: Final = 20_000  # rows per write


def _same(value: Any) -> Any:
    return value


def _mode(value: int) -> str:
    return Mode(value).name if value in set(Mode) else str(value)


# message -> log column -> table column and conversion
_COLUMNS: Final[Mapping[str, Mapping[str, tuple[str, Convert]]]] = {
    "TICK": {"Tick": ("tick", _same), "T": ("time_s", _same), "Late": ("late_s", _same)},
    "FIX": {
        "Utc": ("utc_s", _same),
        "LatR": ("latitude_deg", degrees),
        "LngR": ("longitude_deg", degrees),
        "Sog": ("speed_over_ground_m_s", _same),
        "Cog": ("course_over_ground_deg", compass_degrees),
        "NSat": ("satellites", _same),
        "HDop": ("hdop", _same),
    },
    "RFB": {"Temp": ("servo_c", _same), "Volt": ("servo_v", _same), "Curr": ("servo_a", _same)},
    "CTL": {
        "Mode": ("mode", _mode),
        "Arm": ("armed", bool),
        "Flt": ("faults", _same),
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
        "Dist": ("distance_m", _same),
    },
    "EST": {
        "Hdg": ("estimated_heading_deg", compass_degrees),
        "Bias": ("rudder_bias_deg", degrees),
        "WT": ("wave_period_s", _same),
        "WSd": ("wave_sd_deg", degrees),
    },
    "GDN": {"XTrk": ("cross_track_m", _same), "Fnc": ("fence_margin_m", _same), "MItm": ("mission_index", _same)},
    "WTR": {"U": ("water_speed_m_s", _same), "CN": ("current_north_m_s", _same), "CE": ("current_east_m_s", _same)},
    "SUPL": {
        "Volt": ("battery_v", _same),
        "Curr": ("battery_a", _same),
        "SoC": ("charge", _same),
        "Sun": ("solar_w", _same),
        "Load": ("load_w", _same),
    },
}
NAMES: Final = tuple(name for columns in _COLUMNS.values() for name, _ in columns.values())
_TEXTS, _FLAGS = frozenset({"mode"}), frozenset({"armed"})


def rows(buffer: Buffer) -> Iterator[dict[str, Any]]:
    """Yield a row for each complete tick."""
    row: dict[str, Any] = {}
    for message in messages(buffer, {*_COLUMNS, "END"}):
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
    count = (_write_csv if kind == "csv" else _write_parquet)(rows(buffer), path)
    return f"{count} rows" if count else ""


def _write_csv(table: Iterator[dict[str, Any]], path: Path) -> int:
    count = 0
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, NAMES, restval="")
        writer.writeheader()
        for row in table:
            writer.writerow({name: f"{v:.10g}" if isinstance(v, float) else v for name, v in row.items()})
            count += 1
    return count


def _write_parquet(table: Iterator[dict[str, Any]], path: Path) -> int:
    import pyarrow as pa  # type: ignore[import-not-found,unused-ignore] # noqa: PLC0415 - an extra
    from pyarrow import parquet  # type: ignore[import-not-found,unused-ignore] # noqa: PLC0415

    kinds = {name: pa.string() if name in _TEXTS else pa.bool_() if name in _FLAGS else pa.float64() for name in NAMES}
    schema, count, batch = pa.schema(list(kinds.items())), 0, []
    with parquet.ParquetWriter(path, schema, compression="zstd") as writer:
        for row in table:
            batch.append(row)
            count += 1
            if len(batch) == _BATCH:
                writer.write_table(pa.Table.from_pylist(batch, schema))
                batch = []
        writer.write_table(pa.Table.from_pylist(batch, schema))
    return count
