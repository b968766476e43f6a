"""Feeds the live page from the status file and the plans of an autopilot, and from the lines of a harness.

Only files are read, so that the autopilot is never delayed.
"""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final

from firmware_py.system.status_file import FoundStatus, Freshness
from firmware_py.view.history import History, Mark

Status = Mapping[str, Any]
MAX_SEEN: Final = 500
MAX_LINE_BYTES: Final = 1 << 14
MAX_TITLE: Final = 300
MAX_NUMBER: Final = 1e15

# Column of the page: section of the status (empty: top level), key, factor.
FROM_STATUS: Final[Mapping[str, tuple[str, str, float]]] = {
    "lat_deg": ("position", "lat_deg", 1.0),
    "lon_deg": ("position", "lon_deg", 1.0),
    "compass_deg": ("", "heading_deg", 1.0),
    "heading_deg": ("estimate", "heading_deg", 1.0),
    "goal_deg": ("", "goal_deg", 1.0),
    "error_deg": ("", "error_deg", -1.0),  # the page shows heading minus goal
    "yaw_rate_deg_s": ("", "yaw_rate_deg_s", 1.0),
    "rudder_deg": ("rudder", "angle_deg", 1.0),
    "command_deg": ("rudder", "command_deg", 1.0),
    "cross_track_m": ("navigation", "cross_track_m", 1.0),
    "fence_margin_m": ("navigation", "fence_margin_m", 1.0),
    "ground_m_s": ("position", "sog_m_s", 1.0),
    "water_m_s": ("estimate", "speed_m_s", 1.0),
    "current_m_s": ("estimate", "current_m_s", 1.0),
    "wave_period_s": ("estimate", "wave_period_s", 1.0),
    "wave_sd_deg": ("estimate", "wave_sd_deg", 1.0),
    "battery_v": ("power", "battery_v", 1.0),
    "charge_percent": ("power", "charge_percent", 1.0),
    "servo_w": ("energy", "servo_power_w", 1.0),
    "solar_w": ("power", "solar_w", 1.0),
    "load_w": ("power", "load_w", 1.0),
}

# Columns that are empty while their sensor has timed out, with the validity flag in the status.
VALID: Final[Mapping[str, tuple[str, str]]] = {
    **dict.fromkeys(("lat_deg", "lon_deg", "ground_m_s", "water_m_s", "current_m_s"), ("position", "ok")),
    **dict.fromkeys(("compass_deg", "heading_deg", "error_deg", "wave_period_s", "wave_sd_deg"), ("", "heading_ok")),
    "rudder_deg": ("rudder", "ok"),
}


class Feed:
    """Reads the newest data at each `poll`; `look` returns the status, `read_plans` the plans for the page."""

    def __init__(
        self,
        history: History,
        look: Callable[[], FoundStatus],
        read_plans: Callable[[], Mapping[str, Any]],
        remedies: Mapping[str, str] = MappingProxyType({}),
    ) -> None:
        """`remedies` are texts by fault name."""
        self._history, self._look, self._read_plans, self._remedies = history, look, read_plans, remedies
        self._truth: dict[str, Any] = {}
        self._plan_key: object = None
        self._plans: Mapping[str, Any] = {}
        self._voyage: object = None
        self._begin_s: float | None = None
        self._last: object = None
        self._seen: deque[tuple[Any, ...]] = deque(maxlen=MAX_SEEN)

    def take_line(self, line: bytes) -> None:
        """Take a JSON line of the harness, with keys such as time_s and true_heading_deg."""
        try:
            values = json.loads(line) if len(line) <= MAX_LINE_BYTES else None
        except (ValueError, RecursionError):
            return
        for name, value in values.items() if isinstance(values, dict) else ():
            if isinstance(value, str) and len(value) <= MAX_TITLE:
                self._truth[name] = value
            elif isinstance(value, (int, float)) and abs(value) <= MAX_NUMBER:  # False for NaN
                self._truth[name] = float(value)

    def poll(self) -> bytes | None:
        """Return new data as JSON for the readers; None without any."""
        if self._truth and "time_s" not in self._truth:
            return None  # the harness has not begun
        found = self._look()
        key = (found.freshness, found.reason, found.content.get("written_machine_s"), self._truth.get("time_s"))
        if key == self._last:
            return None
        self._last = key
        try:
            return self._take(found)
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

    def _take(self, found: FoundStatus) -> bytes:
        # Numbers that JSON lacks become null: a forged status must not stop the page.
        status = json.loads(json.dumps(found.content), parse_constant=lambda _: None)
        for fault in status.get("faults", ()):
            fault["remedy"] = self._remedies.get(str(fault.get("fault")), "")
        time_s = self._truth.get("time_s")
        marks: tuple[Mark, ...] = ()
        plans_before = self._plans
        if status and found.freshness is Freshness.RUNNING:
            if time_s is None:
                self._note_voyage(status)
                time_s = status["written_machine_s"] - (self._begin_s or 0.0)
            marks = tuple(self._marks(status, time_s))
            self._update_plans(status)
        # A stale status adds no row; the harness may still add its own.
        current = status if found.freshness is Freshness.RUNNING else {}
        columns = {name: _value(current, *place) for name, place in FROM_STATUS.items()}
        columns |= {name: None for name, flag in VALID.items() if _entry(current, *flag) is False}
        if (current.get("navigation") or {}).get("activity") != "LINE":
            columns["cross_track_m"] = None  # no line: on a circle or toward home
        columns |= {"faults": len(current["faults"]) if current else None, "time_s": time_s}
        columns |= {name: value for name, value in self._truth.items() if isinstance(value, (int, float))}
        now = {
            "freshness": found.freshness.value,
            "reason": found.reason,
            "age_s": found.age_s,
            "status": status,
            "title": self._truth.get("title") or status.get("vehicle", ""),
            **({} if self._plans is plans_before else {"plans": self._plans}),
            "item": _value(status, "navigation", "item"),
            "first_item": _value(status, "navigation", "first_item"),
            "target": _target(status),
        }
        if "time_s" not in self._truth and status:
            now["begin_utc_s"] = status["utc_s"] - status["written_machine_s"] + (self._begin_s or 0.0)
        return self._history.add(columns if current or self._truth else {}, marks, now)

    def _note_voyage(self, status: Status) -> None:
        """Count the time from the first status; an earlier time means that the computer has restarted."""
        written_s = status["written_machine_s"]
        if self._begin_s is None or written_s < self._begin_s:
            self._begin_s = written_s
            self._history.restart()

    def _marks(self, status: Status, time_s: float) -> list[Mark]:
        marks = []
        for event in status.get("events", ()):
            key = (status["pid"], event["t_s"], event["text"])
            if key not in self._seen:
                self._seen.append(key)
                ago_s = status["uptime_s"] - event["t_s"]
                event_s = time_s - ago_s
                # A run begins at 0: earlier reports are from the start of the autopilot.
                event_s = max(0.0, event_s) if "time_s" in self._truth else event_s
                marks.append((round(event_s, 1), int(event["severity"]), str(event["text"])[:MAX_TITLE]))
        return marks

    def _update_plans(self, status: Status) -> None:
        key = (status.get("plan_identities"), status.get("home"))
        if key != self._plan_key:
            self._plan_key = key
            home = [_value(status, "home", key) for key in ("lat_deg", "lon_deg")]
            self._plans = {**self._read_plans(), **({} if None in home else {"home": home})}


def _entry(status: Status, section: str, key: str) -> Any:
    return (status.get(section) or {} if section else status).get(key)


def _value(status: Status, section: str, key: str, factor: float = 1.0) -> float | None:
    value = _entry(status, section, key)
    return value * factor if isinstance(value, (int, float)) and abs(value) <= MAX_NUMBER else None


def _target(status: Status) -> list[float | None] | None:
    place = [_value(status, "navigation", key) for key in ("target_lat_deg", "target_lon_deg", "radius_m")]
    return None if place[0] is None or place[1] is None else place
