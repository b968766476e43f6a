"""The context of all services: request handler, latest snapshot, and the functions that send."""

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

_IN_FIRST_VERSION = "MAVLink 1 in use: fence, rally and signing need MAVLink 2"
_UNASKED = 0xFFFF  # index of a parameter value outside a list

Handler = Callable[[Peer, Message, float], None]


class Suppliers(msgspec.Struct, frozen=True):
    """Sources outside the link."""

    utc_s: Callable[[], float]
    load: Callable[[], float]  # share of one core, 0 to 1
    offer_utc: Callable[[float, float], None] | None = None  # takes the UTC of a ground station and its reception time
    calibrator: Calibrator | None = None  # a compass that calibrates itself
    written: Callable[[], tuple[int, int] | None] = lambda: None  # stored versions of the state, and their bytes


class LinkContext:
    """The state that the services share, on the loop's thread."""

    def __init__(self, request_handler: RequestHandler, suppliers: Suppliers, version: Version) -> None:
        """Take the request handler; system id and identity are fixed until the next start."""
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
        self.refused_frames = 0
        self.intended_mode: int | None = None  # custom_mode of the latest accepted request
        self.home_report_due = False  # home was set, perhaps to the same position
        self.high_latency = False  # requested on the satellite links
        self.override_us: tuple[float, int] | None = None  # time and pulse of the latest override of channel 1
        self.fence_breaches: tuple[int, float] = (0, 0.0)  # number since start, time of the latest
        self.now_s = 0.0  # time of the latest call of the loop
        self.peers: Iterable[Peer] = ()
        self.all_peers: Callable[[], Iterable[Peer]] = lambda: self.peers  # with pending ones

    # ------------------------------------------------------------------ the state

    def update_snapshot(self, snapshot: Snapshot) -> None:
        """Take the state after a tick."""
        breached = snapshot.faults >> Fault.FENCE_BREACHED & 1
        if breached and (self.snapshot is None or not self.snapshot.faults >> Fault.FENCE_BREACHED & 1):
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
            override_us=self._override_in_force(),
            swing=self.request_handler.compass_swing.report,
        )

    def _override_in_force(self) -> int | None:
        """Return the pulse of a valid override of channel 1; None without one."""
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

    def send_all(self, message: Message, priority: Priority = Priority.REPLY, *, asker: Peer | None = None) -> None:
        """Queue a message to every active peer, but to a quiet one only if it is the asker."""
        packed = self.codec.pack(message)
        for peer in self.peers:
            if peer is asker or not peer.quiet:
                peer.outbox.push(packed, priority)

    def flush_all(self) -> None:
        """Send all queued frames, outside a call of the loop."""
        for peer in self.peers:
            peer.outbox.flush(self.now_s)

    def heartbeat(self) -> Message:
        """Return the heartbeat of this moment."""
        telemetry = self.telemetry_context()
        return identity.first_heartbeat(self.autopilot) if telemetry is None else identity.heartbeat(telemetry)

    def introduce(self, peer: Peer) -> None:
        """Send the arming check parameters before the first heartbeat of an armed boat.

        MAVProxy reads them then, before it has requested any, and reports disabled checks if it has none. A peer that
        is answered in MAVLink 1 gets a notice once.
        """
        if peer.outbox.is_mavlink1_only and not peer.version_reported:
            peer.version_reported = True
            self.send_text(peer, Severity.NOTICE, _IN_FIRST_VERSION)
        if self.snapshot is not None and self.snapshot.armed and peer.may_need_introduction(self.now_s):
            peer.introduced = True
            for name in ("ARMING_CHECK", "ARMING_SKIPCHK"):  # of ArduPilot before 4.7, and since
                self.send(peer, self.parameter_value(INDEX[name], _UNASKED), Priority.URGENT)

    def parameter_value(self, row: int, index: int) -> Message:
        """Return the value of a row of the parameter table."""
        value = self.request_handler.parameters().values()[row]
        name, kind = encode_text(TABLE[row].name, 16), declared_kind(TABLE[row], self.autopilot)
        return mavlink.MAVLink_param_value_message(name, value, int(kind), len(TABLE), index)

    def send_text_limited(self, peer: Peer, severity: Severity, text: str, now_s: float) -> None:
        """Send a text to one peer, unless the same text was sent just now or the rate is exceeded."""
        if peer.notices.admit(text, now_s):
            self.send_text(peer, severity, text)

    def send_text(self, peer: Peer, severity: Severity, text: str) -> None:
        """Send a text to one peer in any case."""
        for message in self._text(severity, text):
            self.send(peer, message)

    def send_text_all(self, severity: Severity, text: str) -> None:
        """Send a text to all active peers that are not quiet, and warnings also to those by message."""
        for message in self._text(severity, text):
            self.send_all(message)
            for peer in self.peers:
                if peer.by_message and severity <= Severity.WARNING:
                    self.send(peer, message)

    def _text(self, severity: Severity, text: str) -> list[Message]:
        self._text_number = self._text_number % 0xFFFF + 1
        return text_messages(severity, text, self._text_number)

    # ------------------------------------------------------------------ requests

    def request(self, message: Message, intent: Intent, now_s: float) -> Answer:
        """Return the decision of the request handler on an intent of the message's sender."""
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
        """Request the intent of an unacknowledged message; send a warning with the reason of a refusal."""
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
