"""The status of a running autopilot: put together after a tick, now and then, and written where others look."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
from msgspec.structs import asdict, fields

from firmware_py.common.angles import compass_degrees, degrees
from firmware_py.common.link_status import LinkStatus, PeerStatus
from firmware_py.common.records import DeviceHealth, DeviceRole
from firmware_py.common.reports import Output, Snapshot, SwingReport
from firmware_py.faults.latch import LatchState
from firmware_py.faults.table import TABLE as FAULTS
from firmware_py.system.readings import Values, device_values, rounded
from firmware_py.system.status_file import StatusFile
from firmware_py.system.status_sections import SECTIONS, calibration

INTERVAL_S = 1.0
MOST_EVENTS = 30  # the newest
RATE_OVER = 10  # intervals that a device's rate is averaged over
_PEER = tuple(field.name for field in fields(PeerStatus))


class StatusSources(msgspec.Struct, frozen=True):
    """What a status is made of beside the snapshot; `about` is what does not change while the process runs.

    `ports` names driver and port of each device.
    """

    about: Mapping[str, Any]
    ports: Mapping[DeviceRole, tuple[str, str]]
    devices: Callable[[], Mapping[DeviceRole, DeviceHealth]]
    links: Callable[[float], Sequence[LinkStatus]]
    faults: Callable[[], LatchState]
    starts: Callable[[], int]
    written: Callable[[], tuple[int, int]]  # versions of the state put on disk since the start, and their bytes
    load: Callable[[], float]
    utc_s: Callable[[], float]
    machine_s: Callable[[], float]
    swing: Callable[[], SwingReport]
    update: Callable[[], str]  # of a version on trial, or one that was taken back; empty else


class StatusReporter:
    """Writes the status every INTERVAL_S; whatever goes wrong with that is told once and is no concern of the loop."""

    def __init__(self, sources: StatusSources, file: StatusFile, say: Callable[[str], None]) -> None:
        """Take what it is made of, where it goes, and what takes a line for the operator."""
        self._sources, self._file, self._say = sources, file, say
        self._due_s = -math.inf
        self._complaint = ""
        self._events: deque[Values] = deque(maxlen=MOST_EVENTS)
        self._spoken_s: dict[DeviceRole, tuple[int, float]] = {}  # messages counted, and when their number last grew
        self._counts: deque[tuple[float, Mapping[DeviceRole, int]]] = deque(maxlen=RATE_OVER + 1)

    def update(self, output: Output, now_s: float) -> None:
        """Write a status when one is due."""
        for event in output.events:
            self._events.append({"t_s": round(now_s, 1), "severity": int(event.severity), "text": event.text})
        if now_s < self._due_s:
            return
        self._due_s = now_s + INTERVAL_S
        try:
            self._file.write(json.dumps(self._status(output.snapshot, now_s), allow_nan=False).encode())
            self._complaint = ""
        except Exception as error:  # noqa: BLE001 - who looks on does not end a voyage
            self._complain(f"rambler status has nothing to show: {getattr(error, 'strerror', None) or repr(error)}")

    def close(self) -> None:
        """Take the status away: nothing runs any more."""
        self._file.remove()

    def _complain(self, text: str) -> None:
        if text != self._complaint:
            self._complaint = text
            self._say(text)

    def _status(self, snapshot: Snapshot, now_s: float) -> Values:
        sources = self._sources
        versions, written_bytes = sources.written()
        return {
            **sources.about,
            "written_machine_s": round(sources.machine_s(), 3),
            "utc_s": round(sources.utc_s(), 3),
            "uptime_s": round(now_s, 1),
            "starts": sources.starts(),
            "update": sources.update(),
            **_condition(snapshot),
            "faults": _faults(snapshot, sources.faults()),
            "events": list(self._events),
            "plan_identities": list(snapshot.mission.identities),
            "devices": self._devices(now_s),
            **{name: make(snapshot) for name, make in SECTIONS.items()},
            "calibration": calibration(sources.swing()),
            "links": [_link(link) for link in sources.links(now_s)],
            "state_written": {"versions": versions, "bytes": written_bytes},
            "loop": {
                "rate_hz": rounded(snapshot.rate_hz, 3),
                "ticks": snapshot.tick + 1,
                "skipped": snapshot.skipped_total,
                "late_ms": rounded(1e3 * snapshot.late_s, 3),
                "processor_percent": rounded(100.0 * sources.load(), 2),
            },
        }

    def _devices(self, now_s: float) -> list[Values]:
        devices = self._sources.devices()
        self._counts.append((now_s, {role: health.accepted for role, health in devices.items()}))
        begun_s, before = self._counts[0]
        told = []
        for role, health in devices.items():
            if role is DeviceRole.LINK:
                continue  # its peers are told one by one
            driver, port = self._sources.ports.get(role, ("", ""))
            counts = role in self._sources.ports and role in before and now_s > begun_s
            rate_hz = max(0, health.accepted - before[role]) / (now_s - begun_s) if counts else None
            if role in self._sources.ports and health.accepted != self._spoken_s.get(role, (0, 0.0))[0]:
                self._spoken_s[role] = (health.accepted, now_s)
            values = device_values(role.name.lower(), driver, port, health, rate_hz)
            if role in self._spoken_s:
                values["age_s"] = round(now_s - self._spoken_s[role][1], 1)  # to INTERVAL_S
            told.append(values)
        return told


def _condition(snapshot: Snapshot) -> Values:
    return {
        "mode": snapshot.mode.name,
        "armed": snapshot.armed,
        "arming_refused": snapshot.prearm_refusal,
        "goal_deg": rounded(snapshot.goal_heading_rad, 2, compass_degrees),
        "heading_deg": rounded(snapshot.heading_rad, 2, compass_degrees),
        "heading_ok": snapshot.heading_ok,
        "heading_age_s": rounded(snapshot.heading_age_s, 1),
        "error_deg": rounded(snapshot.heading_error_rad, 2, degrees),
        "yaw_rate_deg_s": rounded(snapshot.yaw_rate_rad_s, 3, degrees),
    }


def _faults(snapshot: Snapshot, latch: LatchState) -> list[Values]:
    return [
        {
            "fault": fault.name,
            "severity": row.severity.name.lower(),
            "text": row.text,
            "since_s": None if (since_s := latch.since_s[fault]) is None else round(snapshot.t_s - since_s, 1),
        }
        for fault, row in FAULTS.items()
        if snapshot.faults >> fault & 1
    ]


def _link(link: LinkStatus) -> Values:
    peer_values = [{name: getattr(peer, name) for name in _PEER} for peer in link.peers]
    peers = [peer | {"heard_age_s": rounded(peer["heard_age_s"], 1)} for peer in peer_values]
    values: Values = {"url": link.url, "rates": link.rates, "hindrance": link.blocked_reason, "peers": peers}
    if (satellite := link.satellite) is not None:
        fields = asdict(satellite) | {"session_age_s": rounded(satellite.session_age_s, 0)}
        values["satellite"] = {
            "hindrance" if name == "blocked_reason" else name: field for name, field in fields.items()
        }
    return values
