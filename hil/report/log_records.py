"""Reader of the records of onboard logs for a page, by name, from logs of any length and from damaged ones."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from firmware_py.log.dataflash import Buffer, Format, Parser, decode_text
from firmware_py.log.log_time import utc_offset_s
from firmware_py.log.message_rows import TEXT
from hil.report.orders import LoggedPlans

UNDATED_GAP_S = 0.1  # time between logs without dates
SAME_START_S = 60.0  # clocks of process and receiver differ by less than this in a month
_MIN_GAP_S = 5.0  # a shorter time without ticks is not reported
_MAX_SKIPPED = 1e9  # ticks; more is damage
_WITH_TEXT = ("MSG", "PARM", "CHK", "REQ")  # records with values that are not numbers
_MAX_PARTS = 1 << 12  # of a text in CHK or REQ records; more is damage
_MAX_PROCESS_S = 1e9  # later times are damage
# Records that belong to a tick: their labels and the columns for them (angles in radians).
_TICK_RECORDS: Final[Mapping[str, Mapping[str, str]]] = {
    "NAV": {"Hdg": "heading", "YawR": "yaw_rate", "Goal": "goal", "Err": "error"},
    "EST": {"Hdg": "hull", "WT": "wave_period", "WSd": "wave_sd"},
    "CTL": {"RudC": "command", "Rud": "rudder", "Mode": "mode", "Arm": "armed", "Flt": "faults"},
    "GDN": {"Do": "activity", "XTrk": "cross_track", "Fnc": "fence_margin", "MItm": "item"},
    "WTR": {"U": "water", "CN": "current_north", "CE": "current_east"},
    "SUPL": {"Volt": "battery_v", "SoC": "charge", "Sun": "solar_w", "Load": "load_w"},
    "WNDG": {"Spd": "wind", "Gust": "gust"},
    "DEP": {"Depth": "depth"},
}
# Speed of a fix, servo power and raw compass heading are also columns of their tick.
_TICK_COLUMNS: Final = (
    "time_s",
    "ground",
    "servo_w",
    "compass",
    *(name for row in _TICK_RECORDS.values() for name in row.values()),
)
# Labels of the other records, as arguments of their readers.
_COLUMNS: Final[dict[str, Sequence[str]]] = {
    "TICK": ("T", "Late", "Skip"),
    "FIX": ("T", "LatR", "LngR", "Sog"),
    "MSG": ("TimeUS", "Message", "Sev"),
    "PARM": ("Name", "Value"),
    "ENRG": ("Enrg", "Pow"),
    "CHK": tuple(column.label for column in TEXT),
    "REQ": tuple(column.label for column in TEXT),
    "HDG": ("I", "Hdg"),
}


class Segment(NamedTuple):
    """One log on the page: its name, its start in page time, and UTC at page time 0 by the date of this log.

    `gap_s` is the time without ticks before it, NaN for a log without a date.
    """

    name: str
    begin_s: float
    utc_s: float | None
    gap_s: float

    @property
    def is_apart(self) -> bool:
        """True if the log does not continue the previous one."""
        return not self.gap_s < _MIN_GAP_S


@dataclass(slots=True)
class LogContents:
    """Content of logs in order: a row for one of `every` ticks, fixes, texts, parameters; in page time."""

    every: int = 1
    ticks: int = 0
    orders: LoggedPlans = field(default_factory=LoggedPlans)
    columns: dict[str, array[float]] = field(default_factory=lambda: {name: array("d") for name in _TICK_COLUMNS})
    fixes: dict[str, array[float]] = field(
        default_factory=lambda: {name: array("d") for name in ("t", "lat", "lng", "v")}
    )
    late_s: array[float] = field(default_factory=lambda: array("d"))
    texts: list[tuple[float, int, str]] = field(default_factory=list)
    settings: dict[str, float] = field(default_factory=dict)
    software: str = ""
    skipped: int = 0
    steering_j: float = 0.0
    end_s: float = 0.0  # time of the last tick so far
    shift_s: float = 0.0  # page time minus time of the process
    start_s: float = 0.0  # time of the process at page time 0, the first tick
    utc_s: float | None = None  # UTC at page time 0, by the first log with a date
    segments: list[Segment] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def records(data: Buffer, columns: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """Yield name and columns of each record named in `columns`, in order; a missing column is NaN."""
    indices: dict[Format, tuple[int | None, ...]] = {}
    for record_format, offset in Parser(data):
        labels = columns.get(record_format.name)
        if labels is None:
            continue
        if record_format not in indices:
            indices[record_format] = tuple(
                record_format.labels.index(label) if label in record_format.labels else None for label in labels
            )
        values = record_format.unpack(data, offset)
        row = tuple(math.nan if index is None else values[index] for index in indices[record_format])
        yield record_format.name, row


class LogFile:
    """Reader of the records of one file."""

    def __init__(self, path: Path, contents: LogContents) -> None:
        """Set the contents to which `read` adds the records; the path only names the log."""
        self._path, self._contents = path, contents
        self._row: dict[str, float] = {}
        self._first_s: float | None = None
        self._utc_shift_s: float | None = None  # UTC minus time of the process
        self._texts: list[tuple[float, int, str]] = []
        self._energy: tuple[float, float] | None = None
        self._text_parts: list[bytes] = []
        self._readers: Mapping[str, Callable[..., None]] = {
            "TICK": self._add_tick, "FIX": self._add_fix, "MSG": self._add_text, "PARM": self._add_parameter,
            "ENRG": self._add_energy, "CHK": partial(self._add_text_part, "CHK"),
            "REQ": partial(self._add_text_part, "REQ"), "HDG": self._add_compass,
        }  # fmt: skip

    def read(self, data: Buffer) -> None:
        """Read all records."""
        self._utc_shift_s = utc_offset_s(data)
        columns = _COLUMNS | {name: tuple(row) for name, row in _TICK_RECORDS.items()}
        for name, values in records(data, columns):
            if name in _TICK_RECORDS:
                self._row.update(zip(_TICK_RECORDS[name].values(), map(_number, values), strict=True))
            elif name in _WITH_TEXT:
                self._readers[name](*values)
            else:
                self._readers[name](*map(_number, values))
        self._store_row()
        shift_s = self._contents.shift_s  # known from the first tick on
        self._contents.texts += [(t_s + shift_s, severity, text) for t_s, severity, text in self._texts]
        if self._energy is not None:
            self._contents.steering_j += self._energy[1] - self._energy[0]
        if self._first_s is None:
            self._contents.notes.append(f"{self._path.name}: no tick")

    def _add_tick(self, t_s: float, late_s: float, skipped: float) -> None:
        self._store_row()
        if not 0.0 <= t_s < _MAX_PROCESS_S:
            return
        contents = self._contents
        if self._first_s is None:
            self._first_s = t_s
            self._set_time_shift(t_s)
        self._row = {"time_s": t_s + contents.shift_s}
        contents.late_s.append(late_s)
        contents.skipped += int(skipped) if skipped < _MAX_SKIPPED else 0

    def _set_time_shift(self, t_s: float) -> None:
        """Set the time shift of the log: to its date, or directly after the previous log."""
        contents, shift_s = self._contents, self._utc_shift_s
        gap_s = 0.0
        if not contents.segments:
            contents.shift_s, contents.start_s = -t_s, t_s
        else:
            dated_s = math.nan if shift_s is None or contents.utc_s is None else shift_s - contents.utc_s
            is_other_start = t_s + contents.shift_s <= contents.end_s
            if is_other_start or abs(dated_s - contents.shift_s) > SAME_START_S:
                contents.shift_s = max(contents.end_s + UNDATED_GAP_S - t_s, dated_s)  # ignores a date of NaN
                gap_s = math.nan if contents.shift_s != dated_s else gap_s
            elif shift_s is None and contents.segments[-1].utc_s is not None:
                shift_s = contents.segments[-1].utc_s + contents.shift_s
            gap_s += t_s + contents.shift_s - contents.end_s
        utc_s = None if shift_s is None else shift_s - contents.shift_s
        contents.utc_s = utc_s if contents.utc_s is None else contents.utc_s
        contents.segments.append(segment := Segment(self._path.name, t_s + contents.shift_s, utc_s, gap_s))
        if segment.is_apart:
            gap = f"{gap_s:.0f} s without a log before it" if gap_s >= 0.0 else "unknown time since the previous log"
            contents.notes.append(f"{segment.name}: {gap}")

    def _store_row(self) -> None:
        row, contents = self._row, self._contents
        if "time_s" in row and (row["time_s"] > contents.end_s or not contents.columns["time_s"]):
            if contents.ticks % contents.every == 0:
                for name, column in contents.columns.items():
                    column.append(row.get(name, math.nan))
            contents.ticks += 1
            contents.end_s = row["time_s"]
        self._row = {}

    def _add_fix(self, t_s: float, latitude_rad: float, longitude_rad: float, speed_m_s: float) -> None:
        if self._first_s is None or not (abs(latitude_rad) <= math.pi and abs(longitude_rad) <= math.tau):
            return
        contents = self._contents
        self._row["ground"] = speed_m_s
        for column, value in zip(
            contents.fixes.values(), (t_s + contents.shift_s, latitude_rad, longitude_rad, speed_m_s), strict=True
        ):
            column.append(value)

    def _add_text(self, time_us: Any, message: Any, severity: Any) -> None:
        if not isinstance(message, bytes):  # damaged format record
            return
        text = decode_text(message)
        if not self._contents.software and text.startswith("rambler"):
            self._contents.software = text
        self._texts.append((_number(time_us) / 1e6, int(np.nan_to_num(_number(severity))), text))

    def _add_parameter(self, name: Any, value: Any) -> None:
        if isinstance(name, bytes):
            self._contents.settings[decode_text(name)] = _number(value)

    def _add_text_part(self, kind: str, part: Any, parts: Any, length: Any, content: Any) -> None:
        """Add a part of a text; process the complete text, a state or a request."""
        if part == 0:
            self._text_parts = []
        if not isinstance(content, bytes) or part != len(self._text_parts) or len(self._text_parts) >= _MAX_PARTS:
            return
        self._text_parts.append(content[: int(length)])
        if part + 1 != parts:
            return
        text = b"".join(self._text_parts).decode("utf-8", "replace")
        if kind == "CHK":
            self._contents.orders.add_state(text)
        else:
            self._contents.orders.add_request(
                text, {name: column[-1] for name, column in self._contents.fixes.items() if column}
            )

    def _add_compass(self, source: float, heading_rad: float) -> None:
        if source == 0:
            self._row["compass"] = heading_rad

    def _add_energy(self, energy_j: float, power_w: float) -> None:
        self._row["servo_w"] = power_w
        self._energy = (energy_j if self._energy is None else self._energy[0], energy_j)


def _number(value: Any) -> float:
    """Return a number unchanged, and NaN for any other type, which a damaged log may contain."""
    return value if isinstance(value, (int, float)) else math.nan
