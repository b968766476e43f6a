"""What every microservice works with: the request handler, the latest state, the ways to answer."""

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
from firmware_py.link.wire.dialect import Message, mavlink, text_of
from firmware_py.link.wire.frames import Codec
from firmware_py.link.wire.outbox import Priority

_IN_FIRST_VERSION = "You speak MAVLink 1: fence, rally points and signing need MAVLink 2"
_UNASKED = 0xFFFF  # the index of a value that is none of a list

Handler = Callable[[Peer, Message, float], None]


class Suppliers(msgspec.Struct, frozen=True):
    """What the link asks of its surroundings."""

    utc_s: Callable[[], float]
    load: Callable[[], float]  # of one core, 0 to 1
    offer_utc: Callable[[float, float], None] | None = None  # takes a ground station's time and when it came
    calibrator: Calibrator | None = None  # a compass that calibrates itself
    written: Callable[[], tuple[int, int] | None] = lambda: None  # versions of the state put on disk, and their bytes


class LinkContext:
    """The link's own state, on the loop's thread."""

    def __init__(self, request_handler: RequestHandler, suppliers: Suppliers, version: Version) -> None:
        """Take the loop's side; the system id and the identity hold until the next start."""
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
        self.intended_mode: int | None = None  # custom_mode that was last asked for and entered
        self.home_report_due = False  # since it was last told; whoever sets it is told also where it was there before
        self.high_latency = False  # asked for on the satellite links
        self.override_us: tuple[float, int] | None = None  # when channel 1 was overridden last, and by what
        self.fence_breaches: tuple[int, float] = (0, 0.0)  # how many since start, and when the last one began
        self.now_s = 0.0  # of the latest call of the loop
        self.peers: Iterable[Peer] = ()
        self.all_peers: Callable[[], Iterable[Peer]] = lambda: self.peers  # those without a place, too

    # ------------------------------------------------------------------ the state

    def update_snapshot(self, snapshot: Snapshot) -> None:
        """Take the state after a tick."""
        breached = snapshot.faults >> Fault.FENCE_BREACHED & 1
        if breached and (self.snapshot is None or not self.snapshot.faults >> Fault.FENCE_BREACHED & 1):
            self.fence_breaches = (self.fence_breaches[0] + 1, snapshot.t_s)
        self.snapshot = snapshot

    @property
    def home(self) -> Home | None:
        """Where local coordinates begin, None before the first fix."""
        return None if self.snapshot is None else self.snapshot.home

    def telemetry_context(self) -> TelemetryContext | None:
        """Return what the telemetry builders look at; None before the first tick."""
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
        """Return the pulse on channel 1 that a station overrides it with; None when none does."""
        if self.override_us is None:
            return None
        since_s, pulse_us = self.override_us
        return pulse_us if self.now_s - since_s <= self.request_handler.parameters()["MAN_TIMEOUT_S"] else None

    # ------------------------------------------------------------------ who is meant

    def is_addressee(self, message: Message) -> bool:
        """Return whether a message is for this system and component, or for all."""
        system = getattr(message, "target_system", getattr(message, "target", 0))
        component = getattr(message, "target_component", 0)
        return system in (0, self.system) and component in (0, self.component)

    # ------------------------------------------------------------------ answering

    def send(self, peer: Peer, message: Message, priority: Priority = Priority.REPLY) -> None:
        """Queue a message to one peer."""
        peer.outbox.push(self.codec.pack(message), priority)

    def send_all(self, message: Message, priority: Priority = Priority.REPLY, *, asker: Peer | None = None) -> None:
        """Queue a message to every peer, to the quiet ones only when they have asked for it."""
        packed = self.codec.pack(message)
        for peer in self.peers:
            if peer is asker or not peer.quiet:
                peer.outbox.push(packed, priority)

    def flush_all(self) -> None:
        """Send what waits, outside a call of the loop."""
        for peer in self.peers:
            peer.outbox.flush(self.now_s)

    def heartbeat(self) -> Message:
        """Return the heartbeat that a new peer gets at once."""
        telemetry = self.telemetry_context()
        return identity.first_heartbeat(self.autopilot) if telemetry is None else identity.heartbeat(telemetry)

    def introduce(self, peer: Peer) -> None:
        """Send the checks before arming to a station, before the first heartbeat that it sees of an armed boat.

        MAVProxy looks for it then, before it has asked for any, and says that checks are disabled if it has none.
        Who is answered in MAVLink 1 is told once.
        """
        if peer.outbox.mavlink1_only and not peer.version_reported:
            peer.version_reported = True
            self.send_text(peer, Severity.NOTICE, _IN_FIRST_VERSION)
        if self.snapshot is not None and self.snapshot.armed and peer.may_need_introduction(self.now_s):
            peer.introduced = True
            for name in ("ARMING_CHECK", "ARMING_SKIPCHK"):  # of ArduPilot before 4.7, and since
                self.send(peer, self.parameter_value(INDEX[name], _UNASKED), Priority.URGENT)

    def parameter_value(self, row: int, index: int) -> Message:
        """Return the value of a row of the parameter table."""
        value = self.request_handler.parameters().values()[row]
        name, kind = text_of(TABLE[row].name, 16), declared_kind(TABLE[row], self.autopilot)
        return mavlink.MAVLink_param_value_message(name, value, int(kind), len(TABLE), index)

    def send_text_limited(self, peer: Peer, severity: Severity, text: str, now_s: float) -> None:
        """Tell one peer something, unless the same was said just now or too much was said."""
        if peer.notices.admit(text, now_s):
            self.send_text(peer, severity, text)

    def send_text(self, peer: Peer, severity: Severity, text: str) -> None:
        """Tell one peer something in any case."""
        for message in self._text(severity, text):
            self.send(peer, message)

    def send_text_all(self, severity: Severity, text: str) -> None:
        """Tell every peer something, except the quiet ones; those who are paid by the message, what is a warning."""
        for message in self._text(severity, text):
            self.send_all(message)
            for peer in self.peers:
                if peer.by_message and severity <= Severity.WARNING:
                    self.send(peer, message)

    def _text(self, severity: Severity, text: str) -> list[Message]:
        self._text_number = self._text_number % 0xFFFF + 1
        return text_messages(severity, text, self._text_number)

    # ------------------------------------------------------------------ asking the loop

    def request(self, message: Message, intent: Intent, now_s: float) -> Answer:
        """Put an intent of a message's sender to the request handler."""
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
        """Put the goal of an unacknowledged message to the request handler, or warn of why not."""
        name = type(message).msgname
        if isinstance(intent, str):
            self.send_text_limited(peer, Severity.WARNING, f"{name}: {intent}", now_s)
            return
        answer = self.request(message, intent, now_s)
        if answer.verdict is not Verdict.ACCEPTED:
            self.send_text_limited(peer, Severity.WARNING, answer.text or f"{name} refused", now_s)


def within(value: float, low: float, high: float) -> bool:
    """Return whether a number from outside is finite and in [low, high]."""
    return math.isfinite(value) and low <= value <= high
