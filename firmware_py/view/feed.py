"""Reads the data of the live page: status file and plans of an autopilot, and lines of the simulation harness.

Only files are read, so that the autopilot is never delayed.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final

from firmware_py.system.status_file import Freshness, StatusReading
from firmware_py.view.history import History, Mark

Status = Mapping[str, Any]
MAX_KNOWN_EVENTS: Final = 500
MAX_LINE_BYTES: Final = 1 << 14
MAX_TEXT_CHARACTERS: Final = 300
MAX_NUMBER: Final = 1e15

# Column of the page: section of the status (empty: top level) and key.
STATUS_COLUMNS: Final[Mapping[str, tuple[str, str]]] = {
    "lat_deg": ("position", "lat_deg"),
    "lon_deg": ("position", "lon_deg"),
    "compass_deg": ("", "heading_deg"),
    "heading_deg": ("estimate", "heading_deg"),
    "goal_deg": ("", "goal_deg"),
    "error_deg": ("", "error_deg"),
    "yaw_rate_deg_s": ("", "yaw_rate_deg_s"),
    "rudder_deg": ("rudder", "angle_deg"),
    "rudder_estimated_deg": ("rudder", "estimated_deg"),
    "command_deg": ("rudder", "command_deg"),
    "cross_track_m": ("navigation", "cross_track_m"),
    "fence_margin_m": ("navigation", "fence_margin_m"),
    "ground_m_s": ("position", "sog_m_s"),
    "water_m_s": ("estimate", "speed_m_s"),
    "current_m_s": ("estimate", "current_m_s"),
    "wave_period_s": ("estimate", "wave_period_s"),
    "wave_sd_deg": ("estimate", "wave_sd_deg"),
    "battery_v": ("power", "battery_v"),
    "charge_percent": ("power", "charge_percent"),
    "servo_w": ("energy", "servo_power_w"),
    "solar_w": ("power", "solar_w"),
    "load_w": ("power", "load_w"),
    "wind_m_s": ("wind", "wind_m_s"),
    "gust_m_s": ("wind", "gust_m_s"),
    "depth_m": ("depth", "depth_m"),
}

# Columns that are empty while their sensor has timed out, with the validity flag in the status.
VALIDITY_FLAGS: Final[Mapping[str, tuple[str, str]]] = {
    **dict.fromkeys(("lat_deg", "lon_deg", "ground_m_s", "water_m_s", "current_m_s"), ("position", "ok")),
    **dict.fromkeys(("compass_deg", "heading_deg", "error_deg", "wave_period_s", "wave_sd_deg"), ("", "heading_ok")),
    **dict.fromkeys(("rudder_deg", "rudder_estimated_deg"), ("rudder", "ok")),
    **dict.fromkeys(("wind_m_s", "gust_m_s"), ("wind", "ok")),
    "depth_m": ("depth", "ok"),
}


class Feed:
    """Reads the newest data at each `poll`."""

    def __init__(
        self,
        history: History,
        read_status: Callable[[], StatusReading],
        read_plans: Callable[[], Mapping[str, Any]],
        remedies: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """Store the functions that return the status and the plans for the page, and the remedies by fault name."""
        self._history, self._read_status, self._read_plans, self._remedies = history, read_status, read_plans, remedies
        self._harness_values: dict[str, Any] = {}
        self._plan_key: object = None
        self._plans: Mapping[str, Any] = {}
        self._voyage: object = None
        self._begin_s: float | None = None
        self._last_key: object = None
        self._known_events: deque[tuple[Any, ...]] = deque(maxlen=MAX_KNOWN_EVENTS)

    def add_line(self, line: bytes) -> None:
        """Store the values of a JSON line of the harness, with keys such as time_s and true_heading_deg."""
        try:
            values = json.loads(line) if len(line) <= MAX_LINE_BYTES else None
        except (ValueError, RecursionError):
            return
        for name, value in values.items() if isinstance(values, dict) else ():
            if isinstance(value, str) and len(value) <= MAX_TEXT_CHARACTERS:
                self._harness_values[name] = value
            elif isinstance(value, (int, float)) and abs(value) <= MAX_NUMBER:  # False for NaN
                self._harness_values[name] = float(value)

    def poll(self) -> bytes | None:
        """Return the new data as JSON for the readers; None if nothing has changed."""
        if self._harness_values and "time_s" not in self._harness_values:
            return None  # the simulation has not started
        reading = self._read_status()
        key = (
            reading.freshness,
            reading.reason,
            reading.content.get("written_machine_s"),
            self._harness_values.get("time_s"),
        )
        if key == self._last_key:
            return None
        self._last_key = key
        try:
            return self._update(reading)
        except (
            KeyError,
            TypeError,
            ValueError,
            AttributeError,
            OverflowError,
            RecursionError,
        ):  # of another version than this program
            return self._history.add(
                {}, (), {"freshness": Freshness.STALE.value, "reason": "status of another version"}
            )

    def _update(self, reading: StatusReading) -> bytes:
        # NaN and infinity become null, because the page cannot read them, and a status may be forged.
        status = json.loads(json.dumps(reading.content), parse_constant=lambda _: None)
        for fault in status.get("faults", ()):
            fault["remedy"] = self._remedies.get(str(fault.get("fault")), "")
        time_s = self._harness_values.get("time_s")
        marks: tuple[Mark, ...] = ()
        plans_before = self._plans
        if reading.freshness is Freshness.RUNNING:
            if time_s is None:
                time_s = status["written_machine_s"] - self._detect_new_voyage(status)
            marks = tuple(self._new_marks(status, time_s))
            self._update_plans(status)
        # A stale status adds no values; the harness may still add its own.
        current = status if reading.freshness is Freshness.RUNNING else {}
        columns = {name: _value(current, *source) for name, source in STATUS_COLUMNS.items()}
        if (error_deg := columns["error_deg"]) is not None:
            columns["error_deg"] = -error_deg  # the page shows heading minus goal
        columns |= {name: None for name, flag in VALIDITY_FLAGS.items() if _entry(current, *flag) is False}
        if (current.get("navigation") or {}).get("activity") != "LINE":
            columns["cross_track_m"] = None  # the boat does not follow a line
        columns |= {"faults": len(current["faults"]) if current else None, "time_s": time_s}
        columns |= {name: value for name, value in self._harness_values.items() if isinstance(value, (int, float))}
        now = {
            "freshness": reading.freshness.value,
            "reason": reading.reason,
            "age_s": reading.age_s,
            "status": status,
            "title": self._harness_values.get("title") or status.get("vehicle", ""),
            **({} if self._plans is plans_before else {"plans": self._plans}),
            "item": _value(status, "navigation", "item"),
            "first_item": _value(status, "navigation", "first_item"),
            "target": _target(status),
        }
        if "time_s" not in self._harness_values and status:
            now["begin_utc_s"] = status["utc_s"] - status["written_machine_s"] + (self._begin_s or 0.0)
        return self._history.add(columns if current or self._harness_values else {}, marks, now)

    def _detect_new_voyage(self, status: Status) -> float:
        """Start a new voyage at the first status and after a restart of the computer, which resets the machine time.

        Return the machine time at the beginning of the voyage.
        """
        written_s: float = status["written_machine_s"]
        if self._begin_s is None or written_s < self._begin_s:
            self._begin_s = written_s
            self._history.restart()
        return self._begin_s

    def _new_marks(self, status: Status, time_s: float) -> list[Mark]:
        marks = []
        for event in status.get("events", ()):
            key = (status["pid"], event["t_s"], event["text"])
            if key not in self._known_events:
                self._known_events.append(key)
                age_s = status["uptime_s"] - event["t_s"]
                event_s = time_s - age_s
                # In a simulation, events before time 0 are from the start of the autopilot.
                event_s = max(0.0, event_s) if "time_s" in self._harness_values else event_s
                marks.append((round(event_s, 1), int(event["severity"]), str(event["text"])[:MAX_TEXT_CHARACTERS]))
        return marks

    def _update_plans(self, status: Status) -> None:
        key = (status.get("plan_identities"), status.get("home"))
        if key != self._plan_key:
            self._plan_key = key
            home = [_value(status, "home", key) for key in ("lat_deg", "lon_deg")]
            self._plans = {**self._read_plans(), **({} if None in home else {"home": home})}


def _entry(status: Status, section: str, key: str) -> Any:
    return (status.get(section) or {} if section else status).get(key)


def _value(status: Status, section: str, key: str) -> float | None:
    value = _entry(status, section, key)
    return value if isinstance(value, (int, float)) and abs(value) <= MAX_NUMBER else None


def _target(status: Status) -> list[float | None] | None:
    position = [_value(status, "navigation", key) for key in ("target_lat_deg", "target_lon_deg", "radius_m")]
    return None if position[0] is None or position[1] is None else position
