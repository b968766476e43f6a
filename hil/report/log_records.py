"""Records of onboard logs for a page, read by name, from logs of any length, also from damaged ones."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from firmware_py.log.dataflash import Buffer, Format, Parser, text_of
from firmware_py.log.log_time import utc_offset_s
from firmware_py.log.message_rows import TEXT
from hil.report.orders import Orders

BETWEEN_S = 0.1  # between logs without dates
SAME_START_S = 60.0  # the clock of a process and that of the receiver differ by less in a month
_MIN_GAP_S = 5.0  # a shorter time without ticks is not reported
_MAX_SKIPPED = 1e9  # ticks between two: more is damage
_WITH_TEXT = ("MSG", "PARM", "CHK", "REQ")
_MAX_PARTS = 1 << 12  # of a state: more is damage
_MAX_PROCESS_S = 1e9  # later times are damage
_FIX_COLUMNS = ("time_s", "latitude_rad", "longitude_rad", "speed_m_s")
_READ_BY_TICK: Final[Mapping[str, Mapping[str, str]]] = {
    "NAV": {"Hdg": "heading", "YawR": "yaw_rate", "Goal": "goal", "Err": "error"},
    "EST": {"Hdg": "hull", "WT": "wave_period", "WSd": "wave_sd"},
    "CTL": {"RudC": "command", "Rud": "rudder", "Mode": "mode", "Arm": "armed", "Flt": "faults"},
    "GDN": {"Do": "activity", "XTrk": "cross_track", "Fnc": "fence_margin", "MItm": "item"},
    "WTR": {"U": "water", "CN": "current_north", "CE": "current_east"},
    "SUPL": {"Volt": "battery_v", "SoC": "charge", "Sun": "solar_w", "Load": "load_w"},
}
# Speed of a fix, servo power and raw compass heading are columns of their tick, too.
_TICK_COLUMNS: Final = (
    "time_s",
    "ground",
    "servo_w",
    "compass",
    *(name for row in _READ_BY_TICK.values() for name in row.values()),
)
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
    """One log on the page: its name, its start there, and the UTC of the page's time 0 by this log's date.

    `gap_s` is the time without ticks before it, NaN for a log without a date.
    """

    name: str
    begin_s: float
    utc_s: float | None
    gap_s: float

    @property
    def is_apart(self) -> bool:
        """Whether the log does not continue the previous one."""
        return not self.gap_s < _MIN_GAP_S


@dataclass(slots=True)
class Gathered:
    """Content of logs in order: a row for one of `every` ticks, fixes, texts, parameters; times are the page's."""

    every: int = 1
    ticks: int = 0
    orders: Orders = field(default_factory=Orders)

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
    end_s: float = 0.0  # of the records so far
    shift_s: float = 0.0  # from the time of the process to that of the page
    start_s: float = 0.0  # of the process, at the first tick: time 0 of the page
    utc_s: float | None = None  # of time 0 of the page, by the first log with a date
    segments: list[Segment] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def records(data: Buffer, columns: Mapping[str, Sequence[str]]) -> Iterator[tuple[str, tuple[Any, ...]]]:
    """Yield name and columns of each record named in `columns`, in order; a column that a log lacks is NaN."""
    places: dict[Format, tuple[int | None, ...]] = {}
    for found, at in Parser(data):
        labels = columns.get(found.name)
        if labels is None:
            continue
        if found not in places:
            places[found] = tuple(found.labels.index(label) if label in found.labels else None for label in labels)
        values = found.unpack(data, at)
        yield found.name, tuple(math.nan if place is None else values[place] for place in places[found])


class LogFile:
    """Reads the records of one file."""

    def __init__(self, path: Path, got: Gathered) -> None:
        """Add the records of a file to those of earlier files."""
        self._path, self._got = path, got
        self._row: dict[str, float] = {}
        self._first_s: float | None = None
        self._utc_shift_s: float | None = None  # from the time of the process to UTC
        self._texts: list[tuple[float, int, str]] = []
        self._energy: tuple[float, float] | None = None
        self._pieces: list[bytes] = []
        self._readers: Mapping[str, Callable[..., None]] = {
            "TICK": self._tick, "FIX": self._fix, "MSG": self._text, "PARM": self._parameter, "ENRG": self._steering,
            "CHK": partial(self._join, "CHK"), "REQ": partial(self._join, "REQ"), "HDG": self._compass,
        }  # fmt: skip

    def read(self, data: Buffer) -> None:
        """Read all records."""
        self._utc_shift_s = utc_offset_s(data)
        columns = _COLUMNS | {name: tuple(row) for name, row in _READ_BY_TICK.items()}
        for name, values in records(data, columns):
            if name in _READ_BY_TICK:
                self._row.update(zip(_READ_BY_TICK[name].values(), map(_number, values), strict=True))
            elif name in _WITH_TEXT:
                self._readers[name](*values)
            else:
                self._readers[name](*map(_number, values))
        self._flush()
        shift_s = self._got.shift_s  # known from the first tick on
        self._got.texts += [(t_s + shift_s, severity, text) for t_s, severity, text in self._texts]
        if self._energy is not None:
            self._got.steering_j += self._energy[1] - self._energy[0]
        if self._first_s is None:
            self._got.notes.append(f"{self._path.name}: no tick")

    def _tick(self, t_s: float, late_s: float, skipped: float) -> None:
        self._flush()
        if not 0.0 <= t_s < _MAX_PROCESS_S:
            return
        got = self._got
        if self._first_s is None:
            self._first_s = t_s
            self._begin(t_s)
        self._row = {"time_s": t_s + got.shift_s}
        got.late_s.append(late_s)
        got.skipped += int(skipped) if skipped < _MAX_SKIPPED else 0

    def _begin(self, t_s: float) -> None:
        """Place the log on the page: at its date, or directly behind the previous log."""
        got, shift_s = self._got, self._utc_shift_s
        gap_s = 0.0
        if not got.segments:
            got.shift_s, got.start_s = -t_s, t_s
        else:
            dated_s = math.nan if shift_s is None or got.utc_s is None else shift_s - got.utc_s
            if t_s + got.shift_s <= got.end_s or abs(dated_s - got.shift_s) > SAME_START_S:  # another start
                got.shift_s = max(got.end_s + BETWEEN_S - t_s, dated_s)  # NaN is not greater
                gap_s = math.nan if got.shift_s != dated_s else gap_s
            elif shift_s is None and got.segments[-1].utc_s is not None:
                shift_s = got.segments[-1].utc_s + got.shift_s
            gap_s += t_s + got.shift_s - got.end_s
        utc_s = None if shift_s is None else shift_s - got.shift_s
        got.utc_s = utc_s if got.utc_s is None else got.utc_s
        got.segments.append(segment := Segment(self._path.name, t_s + got.shift_s, utc_s, gap_s))
        if segment.is_apart:
            gap = f"{gap_s:.0f} s without a log before it" if gap_s >= 0.0 else "unknown time since the previous log"
            got.notes.append(f"{segment.name}: {gap}")

    def _flush(self) -> None:
        row, got = self._row, self._got
        if "time_s" in row and (row["time_s"] > got.end_s or not got.columns["time_s"]):
            if got.ticks % got.every == 0:
                for name, column in got.columns.items():
                    column.append(row.get(name, math.nan))
            got.ticks += 1
            got.end_s = row["time_s"]
        self._row = {}

    def _fix(self, t_s: float, latitude_rad: float, longitude_rad: float, speed_m_s: float) -> None:
        if self._first_s is None or not (abs(latitude_rad) <= math.pi and abs(longitude_rad) <= math.tau):
            return
        got = self._got
        self._row["ground"] = speed_m_s
        for column, value in zip(
            got.fixes.values(), (t_s + got.shift_s, latitude_rad, longitude_rad, speed_m_s), strict=True
        ):
            column.append(value)

    def _text(self, time_us: Any, message: Any, severity: Any) -> None:
        if not isinstance(message, bytes):  # damaged format record
            return
        text = text_of(message)
        if not self._got.software and text.startswith("rambler"):
            self._got.software = text
        self._texts.append((_number(time_us) / 1e6, int(np.nan_to_num(_number(severity))), text))

    def _parameter(self, name: Any, value: Any) -> None:
        if isinstance(name, bytes):
            self._got.settings[text_of(name)] = _number(value)

    def _join(self, kind: str, part: Any, parts: Any, length: Any, piece: Any) -> None:
        """Add a part of a text, and process the complete text: a state, or a request."""
        if part == 0:
            self._pieces = []
        if not isinstance(piece, bytes) or part != len(self._pieces) or len(self._pieces) >= _MAX_PARTS:
            return
        self._pieces.append(piece[: int(length)])
        if part + 1 != parts:
            return
        text = b"".join(self._pieces).decode("utf-8", "replace")
        if kind == "CHK":
            self._got.orders.add_state(text)
        else:
            self._got.orders.add_request(text, {name: column[-1] for name, column in self._got.fixes.items() if column})

    def _compass(self, source: float, heading_rad: float) -> None:
        if source == 0:
            self._row["compass"] = heading_rad

    def _steering(self, energy_j: float, power_w: float) -> None:
        self._row["servo_w"] = power_w
        self._energy = (energy_j if self._energy is None else self._energy[0], energy_j)


def _number(value: Any) -> float:
    """Return a number unchanged, and NaN for another type, which a damaged log may contain."""
    return value if isinstance(value, (int, float)) else math.nan
