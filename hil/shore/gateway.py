"""Gateway between satellite messages and a ground station: forwards MAVLink frames of the boat and commands to it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, Protocol

from pymavlink.dialects.v20 import common as mavlink

from hil.shore.short_form import MessageNumbers, encode

MAX_BYTES: Final = 270  # of a message to the boat
REPEAT_S: Final = 300.0  # a command repeated within this time is acknowledged as in progress and not sent again
COMPONENT: Final = 1
_COMMANDS = frozenset({"COMMAND_LONG", "COMMAND_INT"})
# Messages that are sent by satellite. Parameter lists, missions, logs and files are for other links.
_SUPPORTED = _COMMANDS | {
    "SET_MODE",
    "PARAM_SET",
    "MISSION_SET_CURRENT",
    "SET_ATTITUDE_TARGET",
    "SET_POSITION_TARGET_GLOBAL_INT",
}
# Commands that stations send automatically, from MAV_CMD_GET_HOME_POSITION (410) and GET_MESSAGE_INTERVAL (510) to the
# requests of versions, cameras and storage (519 to 528).
_REQUESTS = frozenset({410, 510, 511, 512, 519, 520, 521, 522, 524, 525, 526, 527, 528})
# Periodic messages of stations, ignored without a report.
_PERIODIC = frozenset({"HEARTBEAT", "SYSTEM_TIME", "TIMESYNC", "PING", "REQUEST_DATA_STREAM"})


class Station(Protocol):
    """Link to the ground station."""

    def send(self, message: Any, system: int, component: int) -> None:
        """Send a message with this system and component id."""


@dataclass(slots=True)
class _PendingCommand:
    """A command without acknowledgement: when it was sent, and its MAV_CMD (None for messages such as SET_MODE)."""

    sent_s: float
    command: int | None


class Gateway:
    """Process messages and commands one by one; time is an argument; output goes to `station` and `deliver`.

    `deliver` takes the modem's IMEI and a message for it. The boat's system id is that of its first frame. Frames of
    another system and of an unknown kind are dropped, counted and reported.
    """

    def __init__(
        self,
        station: Station,
        deliver: Callable[[str, bytes], None],
        log: Callable[[str], None],
        *,
        key: bytes | None = None,
        imei: str = "",
    ) -> None:
        """Take both sides; without a key commands are sent as plain MAVLink."""
        self._station, self._deliver, self._log = station, deliver, log
        self._key = key
        self.imei = imei
        self.system = 1
        self.dropped: Counter[str] = Counter()
        self._has_system_id = False  # after its first frame, which has its system id
        self._numbers = MessageNumbers()
        self._pending: dict[bytes, _PendingCommand] = {}
        self._last_frames: dict[str, Any] = {}
        self._reported_kinds: set[str] = set()

    # ------------------------------------------------------------------ from the boat

    def receive_message(self, imei: str, content: bytes) -> int:
        """Forward the frames of a message; return their number."""
        if self.imei and imei != self.imei:
            self._drop("message of another modem", f"{imei}; the boat's is {self.imei}")
            return 0
        forwarded = [frame for frame in parse(content) if self._is_of_boat(frame)]
        for frame in forwarded:
            self.imei = imei
            if frame.get_type() == "COMMAND_ACK":
                self._pending = {key: row for key, row in self._pending.items() if row.command != frame.command}
            self._station.send(frame, frame.get_srcSystem(), frame.get_srcComponent())
            self._last_frames[frame.get_type()] = frame
        self._log(f"message of {len(content)} bytes: {', '.join(frame.get_type() for frame in forwarded) or 'nothing'}")
        return len(forwarded)

    def _is_of_boat(self, frame: Any) -> bool:
        if isinstance(frame, mavlink.MAVLink_unknown):
            self._drop("frame of unknown kind", frame.get_type().removeprefix("UNKNOWN_"))
            return False
        if not self._has_system_id:
            self._has_system_id, self.system = True, frame.get_srcSystem()
        if frame.get_srcSystem() != self.system:
            self._drop("frame of another system", f"{frame.get_srcSystem()}; the boat is system {self.system}")
            return False
        return True

    def _drop(self, kind: str, detail: str) -> None:
        self.dropped[kind] += 1
        self._log(f"{kind} {detail}: dropped ({self.dropped[kind]} so far)")

    def send_last_report(self) -> None:
        """Send the last report to a station that has just connected."""
        if (report := self._last_frames.get("HIGH_LATENCY2")) is not None:
            self._station.send(report, report.get_srcSystem(), report.get_srcComponent())

    # ------------------------------------------------------------------ from the station

    def receive_command(self, message: Any, now_s: float, utc_s: float) -> None:
        """Send a command to the boat as a message, or report the reason if it is not sent."""
        name = message.get_type()
        target = getattr(message, "target_system", 0)
        if name in _PERIODIC or target not in (0, self.system) or isinstance(message, mavlink.MAVLink_unknown):
            return
        if name not in _SUPPORTED:
            self._report_unsupported(name)
            return
        command = int(message.command) if name in _COMMANDS else None
        if command in _REQUESTS:
            self._acknowledge(command, mavlink.MAV_RESULT_UNSUPPORTED, message)
            return
        key = _command_key(message)
        self._pending = {
            pending_key: row for pending_key, row in self._pending.items() if now_s - row.sent_s < REPEAT_S
        }
        if key in self._pending:
            self._acknowledge(command, mavlink.MAV_RESULT_IN_PROGRESS, message)
            return
        problem = self._send(message, utc_s)
        if problem:
            self._log(f"{name} not sent: {problem}")
            self._report(mavlink.MAV_SEVERITY_WARNING, f"Not sent: {problem}")
            self._acknowledge(command, mavlink.MAV_RESULT_TEMPORARILY_REJECTED, message)
            return
        self._pending[key] = _PendingCommand(now_s, command)
        self._acknowledge(command, mavlink.MAV_RESULT_IN_PROGRESS, message)

    def _send(self, message: Any, utc_s: float) -> str:
        if not self.imei:
            return "modem unknown; give --imei"
        sender = (message.get_srcSystem(), message.get_srcComponent())
        if self._key is None:
            content = message.pack(mavlink.MAVLink(None, srcSystem=sender[0], srcComponent=sender[1]))
        else:
            content = encode(message, sender, self._numbers.next(utc_s), self._key, self.imei)
        if len(content) > MAX_BYTES:
            return f"{len(content)} bytes exceed {MAX_BYTES}"
        self._deliver(self.imei, bytes(content))
        self._log(f"sent to the boat: {message.get_type()}, {len(content)} bytes")
        return ""

    def report_problem(self, text: str) -> None:
        """Report a problem with a message to the operator and the station."""
        self._log(text)
        self._report(mavlink.MAV_SEVERITY_WARNING, text)

    # ------------------------------------------------------------------

    def _acknowledge(self, command: int | None, result: int, message: Any) -> None:
        if command is not None:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            reply = mavlink.MAVLink_command_ack_message(command, result, 255, 0, *sender)
            self._station.send(reply, self.system, COMPONENT)

    def _report_unsupported(self, name: str) -> None:
        if name not in self._reported_kinds:
            self._reported_kinds.add(name)
            self._report(mavlink.MAV_SEVERITY_NOTICE, f"Not supported by satellite: {name}")

    def _report(self, severity: int, text: str) -> None:
        self._station.send(mavlink.MAVLink_statustext_message(severity, text.encode()[:50]), self.system, COMPONENT)


def parse(content: bytes) -> list[Any]:
    """Return the frames of a message; other bytes are skipped."""
    decoder = mavlink.MAVLink(None)
    decoder.robust_parsing = True
    return [frame for frame in decoder.parse_buffer(content) or () if frame.get_type() != "BAD_DATA"]


def _command_key(message: Any) -> bytes:
    """Return the identity of a command for the detection of repetitions: its payload without the confirmation."""
    fields: Mapping[str, Any] = message.to_dict()
    return repr(sorted((name, str(value)) for name, value in fields.items() if name != "confirmation")).encode()
