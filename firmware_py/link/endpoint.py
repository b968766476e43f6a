"""The link as the loop sees it: reads and answers between ticks, publishes after each."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence

from firmware_py.link import estimates, motion, telemetry
from firmware_py.link.command_requests import request_data_stream
from firmware_py.link.command_table import TABLE as COMMANDS
from firmware_py.link.commands import Commands
from firmware_py.link.dialect import Message, Packed
from firmware_py.link.files import Files
from firmware_py.link.framing import Frame
from firmware_py.link.goals import Goals
from firmware_py.link.home_setting import HomeSetting
from firmware_py.link.identity import Version
from firmware_py.link.logs import Logs
from firmware_py.link.manual import Manual
from firmware_py.link.mission import Mission
from firmware_py.link.outbox import Priority
from firmware_py.link.parameters import Parameters
from firmware_py.link.peer import Peer, Roster
from firmware_py.link.scene import Scene
from firmware_py.link.session import Handler, Session, Suppliers
from firmware_py.link.timing import Timing
from firmware_py.link.transport import Transport
from firmware_py.ports import Authority, Calibrator
from firmware_py.records import Event, Output, Severity, Snapshot

_HEARTBEAT, _CURRENT_MODE, _DATA_STREAM = 0, 436, 66
_GROUND_STATION = 6  # MAV_TYPE_GCS
_EVENTS_PER_TICK = 16
_FRAMES_AT_ONCE = 8  # answered in one call, about half a millisecond
_REMEMBERED_EVENTS = 5


def _no_load() -> float:
    return 0.0


class Endpoint:
    """One MAVLink component on several transports; fulfils ports.Link."""

    def __init__(
        self,
        transports: Sequence[Transport],
        authority: Authority,
        *,
        utc_s: Callable[[], float],
        version: Version,
        boot_text: str = "",
        load: Callable[[], float] = _no_load,
        heard_utc: Callable[[float, float], None] | None = None,
        calibrator: Calibrator | None = None,
    ) -> None:
        """Take opened transports and the loop's side.

        `boot_text` greets every new peer. `load` gives the share of a core in use, 0 to
        1. `heard_utc` takes the time that a ground station says, and when it came.
        `calibrator` is the compass, if it can calibrate itself.
        """
        self._transports = tuple(transports)
        self._session = Session(authority, Suppliers(utc_s, load, heard_utc, calibrator), version)
        self._roster = Roster(self._transports, self._welcome)
        self._session.peers = self._roster
        self._parameters = Parameters(self._session)
        self._commands = Commands(self._session, COMMANDS)
        self._greeting = (Event(Severity.INFO, boot_text),) if boot_text else ()
        self._recent: deque[Event] = deque(maxlen=_REMEMBERED_EVENTS)
        self._unread: deque[tuple[Peer, Frame]] = deque()  # what one round of reads has brought
        self._handlers = self._collect()

    def _collect(self) -> Mapping[int, Handler]:
        session = self._session
        services = (self._commands, Goals(session), Manual(session), self._parameters)
        others = (Mission(session), Files(session), Logs(session), Timing(session), HomeSetting(session))
        found: dict[int, Handler] = {_DATA_STREAM: request_data_stream, _HEARTBEAT: self._heard}
        for service in (*services, *others):
            found.update(service.handlers())
        return found

    @property
    def handlers(self) -> Mapping[int, Handler]:
        """Who hears which message, by its number."""
        return self._handlers

    # ------------------------------------------------------------------ ports.Link

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors whose readability `service` wants."""
        return [descriptor for transport in self._transports for descriptor in transport.descriptors()]

    @property
    def busy(self) -> bool:
        """Whether `service` has something to do even when no descriptor is ready."""
        return bool(self._unread)

    def service(self, now_s: float, ready: Sequence[int]) -> None:
        """Read one bounded piece from each ready transport, unless the last ones wait still; answer some of it."""
        self._session.now_s = now_s
        if not self._unread:
            for index, transport in enumerate(self._transports):
                for descriptor in transport.descriptors():
                    if descriptor in ready:
                        self._receive(index, transport, descriptor, now_s)
        self._answer(now_s)
        self._roster.update(now_s)
        self._send(now_s)

    def publish(self, output: Output, now_s: float) -> None:
        """Send the telemetry that is due and what the tick has to say."""
        self._session.now_s = now_s
        for transport in self._transports:
            transport.poll(now_s)
        self._note_changes(output.snapshot, now_s)
        self._answer(now_s)
        self._commands.pump(now_s)
        self._roster.update(now_s)
        self._announce(output.events)
        self._send_telemetry(1.0 / max(output.snapshot.rate_hz, 1.0), now_s)
        self._send(now_s)

    def close(self) -> None:
        """Send what waits and close the transports."""
        self._session.flush_all()
        for transport in self._transports:
            transport.close()

    # ------------------------------------------------------------------ in

    def _receive(self, index: int, transport: Transport, descriptor: int, now_s: float) -> None:
        for address, data in transport.receive(descriptor):
            heard = self._roster.frames(index, address, data, now_s)
            if heard is not None:
                peer, frames = heard
                self._unread.extend((peer, frame) for frame in frames if frame.number in self._handlers)

    def _answer(self, now_s: float) -> None:
        for _ in range(min(_FRAMES_AT_ONCE, len(self._unread))):
            self._dispatch(*self._unread.popleft(), now_s)

    def _dispatch(self, peer: Peer, frame: Frame, now_s: float) -> None:
        message = self._session.codec.decode(frame.data)
        if message is not None and self._session.addressed(message) and not self._from_self(message):
            self._handlers[frame.number](peer, message, now_s)

    def _from_self(self, message: Message) -> bool:
        """Return whether this is our own message, sent back by a loop in somebody's wiring."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        return sender == (self._session.system, self._session.component)

    @staticmethod
    def _heard(peer: Peer, message: Message, now_s: float) -> None:
        """Note that a ground station is there."""
        if message.type == _GROUND_STATION:
            peer.ground_station_s = now_s

    # ------------------------------------------------------------------ out

    def _welcome(self, peer: Peer, now_s: float) -> None:
        if peer.quiet:
            if self._session.high_latency:
                peer.streams.set_high_latency(self._session.authority.parameters()["LNK_SAT_S"], now_s)
            return
        self._session.send(peer, self._session.heartbeat(), Priority.URGENT)
        if self._session.snapshot is not None:
            peer.streams.sent(telemetry.ROWS_OF[_HEARTBEAT][0], now_s)
        for event in (*self._greeting, *self._recent):
            self._session.tell(peer, event.severity, event.text)

    def _note_changes(self, snapshot: Snapshot, now_s: float) -> None:
        """Make what has changed due at once: mode, arming, home."""
        before = self._session.snapshot
        self._session.refused_frames = self._roster.refused_frames() + self._roster.rejected
        self._session.see(snapshot)
        if before is None or (before.mode, before.armed) != (snapshot.mode, snapshot.armed):
            for peer in self._roster:
                peer.streams.hasten(_HEARTBEAT, now_s)
                peer.streams.hasten(_CURRENT_MODE, now_s)
        scene = self._session.scene()
        if scene is not None and snapshot.home is not None and (before is None or before.home != snapshot.home):
            self._session.send_all(motion.home_position(scene))
            self._session.send_all(estimates.gps_global_origin(scene))

    def _announce(self, events: Sequence[Event]) -> None:
        for event in events[:_EVENTS_PER_TICK]:
            self._session.announce(event.severity, event.text)
            if event.severity <= Severity.WARNING:
                self._recent.append(event)

    def _send_telemetry(self, tick_s: float, now_s: float) -> None:
        if not self._roster:
            return
        scene = self._session.scene()
        if scene is None:
            return
        packed: dict[int, Packed | None] = {}  # every row is built and packed once for all peers
        for peer in self._roster:
            room_bytes = peer.outbox.room_bytes(now_s)
            for row in peer.streams.due(now_s, tick_s):
                if row not in packed:
                    packed[row] = self._packed(row, scene)
                found = packed[row]
                urgent = telemetry.TABLE[row].priority is Priority.URGENT
                if found is not None and not urgent:
                    room_bytes -= len(found.frame)
                    if room_bytes < 0.0:
                        # The rest stays due, and the longest due goes first next time.
                        continue
                if found is not None:
                    peer.outbox.push(found, telemetry.TABLE[row].priority)
                peer.streams.sent(row, now_s)

    def _packed(self, row: int, scene: Scene) -> Packed | None:
        message = telemetry.TABLE[row].build(scene)
        return None if message is None else self._session.codec.pack(message)

    def _send(self, now_s: float) -> None:
        for peer in self._roster:
            self._parameters.pump(peer)
            peer.outbox.flush(now_s)
