"""Common context of the services of the link: request handler, latest snapshot, and functions that send."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable

import msgspec

from firmware_py.common.angles import radians
from firmware_py.common.intents import Answer, Intent, Request, SetHome, SetMode, SteerHeading, SteerPosition, Verdict
from firmware_py.common.interfaces import Calibrator, RequestHandler
from firmware_py.common.mode_table import Mode
from firmware_py.common.parameter_table import INDEX, TABLE
from firmware_py.common.records import Severity
from firmware_py.common.reports import Home, Snapshot
from firmware_py.faults.table import Fault
from firmware_py.link.parameters.files import Metadata, declared_kind
from firmware_py.link.peers import Peer
from firmware_py.link.telemetry import identity
from firmware_py.link.telemetry.fields import TelemetryContext
from firmware_py.link.telemetry.identity import COMPONENT, Version
from firmware_py.link.telemetry.statustext import text_messages
from firmware_py.link.wire.dialect import Message, encode_text, mavlink
from firmware_py.link.wire.frames import Codec
from firmware_py.link.wire.outbox import Priority

_MAVLINK1_NOTICE = "MAVLink 1 in use: fence, rally and signing need MAVLink 2"
_UNLISTED_INDEX = 0xFFFF  # of a parameter value that was not requested

Handler = Callable[[Peer, Message, float], None]


class Suppliers(msgspec.Struct, frozen=True):
    """Functions of the rest of the program that the link calls."""

    utc_s: Callable[[], float]
    load: Callable[[], float]  # of one processor core, 0 to 1
    offer_utc: Callable[[float, float], None] | None = None  # UTC of a ground station, time of reception [s]
    calibrator: Calibrator | None = None  # of a compass that calibrates itself
    # Number of versions of the state written since the start, and their bytes; None without storage.
    written: Callable[[], tuple[int, int] | None] = lambda: None


class LinkContext:
    """State that the services share, used on the thread of the loop only."""

    def __init__(self, request_handler: RequestHandler, suppliers: Suppliers, version: Version) -> None:
        """Store the arguments; system id and identity remain fixed until the next start."""
        values = request_handler.parameters()
        self.request_handler = request_handler
        self.suppliers = suppliers
        self.version = version
        self.system = int(values["LNK_SYSID"])
        self.component = int(COMPONENT)
        self.autopilot = int(values["LNK_IDENTITY"])
        self.metadata = Metadata(version, self.autopilot)
        self.codec = Codec(self.system, self.component)
        self._text_number = 0
        self.snapshot: Snapshot | None = None
        self.refused_frames = 0  # damaged, rejected and ignored ones on all links, for telemetry
        self.intended_mode: int | None = None  # custom_mode of the latest accepted request
        self.home_report_due = False  # after a request to set home, even to the same position
        self.high_latency = False  # whether HIGH_LATENCY2 is requested on satellite links
        self.override_us: tuple[float, int] | None = None  # time [s], pulse width [us] of the latest one
        self.fence_breaches: tuple[int, float] = (0, 0.0)  # number since start, time of the latest [s]
        self.now_s = 0.0  # time of the latest call of the loop
        self.peers: Iterable[Peer] = ()
        self.all_peers: Callable[[], Iterable[Peer]] = lambda: self.peers  # active and pending

    # ------------------------------------------------------------------ the state

    def update_snapshot(self, snapshot: Snapshot) -> None:
        """Store the snapshot after a tick, and count fence breaches."""
        is_breached = snapshot.faults >> Fault.FENCE_BREACHED & 1
        if is_breached and (self.snapshot is None or not self.snapshot.faults >> Fault.FENCE_BREACHED & 1):
            self.fence_breaches = (self.fence_breaches[0] + 1, snapshot.t_s)
        self.snapshot = snapshot

    @property
    def home(self) -> Home | None:
        """Origin of local coordinates; None before the first fix."""
        return None if self.snapshot is None else self.snapshot.home

    def telemetry_context(self) -> TelemetryContext | None:
        """Return the input of the telemetry builders; None before the first tick."""
        if self.snapshot is None:
            return None
        return TelemetryContext(
            snapshot=self.snapshot,
            utc_s=self.suppliers.utc_s(),
            rudder_limit_rad=radians(self.request_handler.parameters()["RUD_LIMIT_DEG"]),
            autopilot=self.autopilot,
            intended_mode=self.intended_mode,
            load=self.suppliers.load(),
            refused_frames=self.refused_frames,
            written=self.suppliers.written(),
            fence_breaches=self.fence_breaches,
            override_us=self._valid_override_us(),
            swing=self.request_handler.compass_swing.report,
        )

    def _valid_override_us(self) -> int | None:
        """Return the pulse width of the override of channel 1; None without one or after its timeout."""
        if self.override_us is None:
            return None
        since_s, pulse_us = self.override_us
        return pulse_us if self.now_s - since_s <= self.request_handler.parameters()["MAN_TIMEOUT_S"] else None

    # ------------------------------------------------------------------ addressee

    def is_addressee(self, message: Message) -> bool:
        """Return whether a message is addressed to this system and component, or to all."""
        system = getattr(message, "target_system", getattr(message, "target", 0))
        component = getattr(message, "target_component", 0)
        return system in (0, self.system) and component in (0, self.component)

    # ------------------------------------------------------------------ sending

    def send(self, peer: Peer, message: Message, priority: Priority = Priority.REPLY) -> None:
        """Queue a message to one peer."""
        peer.outbox.push(self.codec.pack(message), priority)

    def send_all(self, message: Message, priority: Priority = Priority.REPLY) -> None:
        """Queue a message to all active peers except satellite peers."""
        packed = self.codec.pack(message)
        for peer in self.peers:
            if not peer.is_satellite:
                peer.outbox.push(packed, priority)

    def flush_all(self) -> None:
        """Send the queued frames of the active peers at once, for callbacks between two calls of the loop."""
        for peer in self.peers:
            peer.outbox.flush(self.now_s)

    def heartbeat(self) -> Message:
        """Build HEARTBEAT of the present state."""
        telemetry = self.telemetry_context()
        return identity.first_heartbeat(self.autopilot) if telemetry is None else identity.heartbeat(telemetry)

    def introduce(self, peer: Peer) -> None:
        """Send the arming check parameters before the first heartbeat of an armed boat.

        MAVProxy reads them at that heartbeat, before it requests parameters, and reports disabled checks if they are
        missing. A peer that uses MAVLink 1 receives a notice once.
        """
        if peer.outbox.is_mavlink1_only and not peer.version_reported:
            peer.version_reported = True
            self.send_text(peer, Severity.NOTICE, _MAVLINK1_NOTICE)
        if self.snapshot is not None and self.snapshot.armed and peer.may_need_introduction(self.now_s):
            peer.is_introduced = True
            for name in ("ARMING_CHECK", "ARMING_SKIPCHK"):  # of ArduPilot before 4.7, and from 4.7 on
                self.send(peer, self.parameter_value(INDEX[name], _UNLISTED_INDEX), Priority.URGENT)

    def parameter_value(self, row: int, index: int) -> Message:
        """Build PARAM_VALUE of a row of the parameter table; `index` is its number in a list."""
        value = self.request_handler.parameters().values()[row]
        name, kind = encode_text(TABLE[row].name, 16), declared_kind(TABLE[row], self.autopilot)
        return mavlink.MAVLink_param_value_message(name, value, int(kind), len(TABLE), index)

    def send_text_limited(self, peer: Peer, severity: Severity, text: str, now_s: float) -> None:
        """Send a text to one peer, unless it is a recent repetition or exceeds the rate."""
        if peer.notices.admit(text, now_s):
            self.send_text(peer, severity, text)

    def send_text(self, peer: Peer, severity: Severity, text: str) -> None:
        """Send a text to one peer."""
        for message in self._text_messages(severity, text):
            self.send(peer, message)

    def send_text_all(self, severity: Severity, text: str) -> None:
        """Send a text to all active peers except satellite peers, and warnings also to peers with paid messages."""
        for message in self._text_messages(severity, text):
            self.send_all(message)
            for peer in self.peers:
                if peer.has_paid_messages and severity <= Severity.WARNING:
                    self.send(peer, message)

    def _text_messages(self, severity: Severity, text: str) -> list[Message]:
        self._text_number = self._text_number % 0xFFFF + 1
        return text_messages(severity, text, self._text_number)

    # ------------------------------------------------------------------ requests

    def request(self, message: Message, intent: Intent, now_s: float) -> Answer:
        """Return the decision of the request handler on an intent of the sender of a message."""
        sender, component = message.get_srcSystem(), message.get_srcComponent()
        answer = self.request_handler.decide(Request(now_s, intent, sender, component))
        if answer.verdict is Verdict.ACCEPTED:
            if isinstance(intent, SetMode):
                self.intended_mode = intent.mode
            elif isinstance(intent, (SteerHeading, SteerPosition)) and intent.change_mode:
                self.intended_mode = int(Mode.GUIDED)
            elif isinstance(intent, SetHome):
                self.home_report_due = True
        return answer

    def request_or_warn(self, peer: Peer, message: Message, intent: Intent | str, now_s: float) -> None:
        """Request the intent of a message without acknowledgement; send the reason of a refusal as a warning.

        `intent` is a text if the message is invalid: the reason of its refusal.
        """
        name = type(message).msgname
        if isinstance(intent, str):
            self.send_text_limited(peer, Severity.WARNING, f"{name}: {intent}", now_s)
            return
        answer = self.request(message, intent, now_s)
        if answer.verdict is not Verdict.ACCEPTED:
            self.send_text_limited(peer, Severity.WARNING, answer.text or f"{name} refused", now_s)


def within(value: float, low: float, high: float) -> bool:
    """Return whether a received number is finite and in [low, high]."""
    return math.isfinite(value) and low <= value <= high
