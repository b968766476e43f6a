"""The link as the loop sees it: reads and answers between ticks, publishes after each."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence

from firmware_py.common.interfaces import Calibrator, RequestHandler, Vault
from firmware_py.common.records import Event, Output, Severity, Snapshot
from firmware_py.link.commands.requests import request_data_stream
from firmware_py.link.commands.server import CommandServer
from firmware_py.link.commands.table import TABLE as COMMANDS
from firmware_py.link.context import Handler, LinkContext, Suppliers
from firmware_py.link.files.root import PACKED_PARAMETERS, FileRoot, tree_of
from firmware_py.link.files.server import Files
from firmware_py.link.logs import LogServer
from firmware_py.link.manual_control import ManualControl
from firmware_py.link.mission.home_setting import HomeSetting
from firmware_py.link.mission.plan_file import PlanFiles
from firmware_py.link.mission.server import MissionServer
from firmware_py.link.parameters.server import ParameterServer
from firmware_py.link.peer import Peer, Peers
from firmware_py.link.security.access import Admitted, Gate, Standing, reads_only
from firmware_py.link.security.denials import deny
from firmware_py.link.security.key_setup import KeySetup
from firmware_py.link.security.signing import LinkSealer, Signing
from firmware_py.link.setpoints import Setpoints
from firmware_py.link.telemetry import estimates, motion, table
from firmware_py.link.telemetry.context_fields import TelemetryContext
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.timesync import Timesync
from firmware_py.link.wire.dialect import Message, Packed
from firmware_py.link.wire.outbox import Priority
from firmware_py.link.wire.receive_queue import ReceiveQueue
from firmware_py.link.wire.transport import Address, Transport
from firmware_py.link.wire.worker import Worker

_HEARTBEAT, _CURRENT_MODE, _DATA_STREAM = 0, 436, 66
_GROUND_STATION = 6  # MAV_TYPE_GCS
_EVENTS_PER_TICK = 16
# In one call, which must be short even where the machine is slow for a moment: half a millisecond at the most. A piece
# has room for the longest frame, so that a stranger's first one is found whole.
_FRAMES_AT_ONCE = 4  # answered
_BYTES_AT_ONCE = 256  # searched for frames, and the rest of the last piece
_PIECE_BYTES = 320
_REMEMBERED_EVENTS = 5
NO_STORAGE = FileRoot()


_FALSE_SIGNATURE = "Signature refused: wrong key or old timestamp"


def _no_load() -> float:
    return 0.0


class _NoVault:
    """Keeps nothing."""

    def load(self) -> None:
        """Return that there is nothing."""

    def save(self, content: bytes) -> None:
        """Forget it."""


_NO_VAULT = _NoVault()


class Endpoint:
    """One MAVLink component on several transports; fulfils ports.Link."""

    def __init__(
        self,
        transports: Sequence[Transport],
        request_handler: RequestHandler,
        *,
        utc_s: Callable[[], float],
        version: Version,
        boot_text: str = "",
        load: Callable[[], float] = _no_load,
        vault: Vault = _NO_VAULT,
        offer_utc: Callable[[float, float], None] | None = None,
        calibrator: Calibrator | None = None,
        storage: FileRoot = NO_STORAGE,
    ) -> None:
        """Take opened transports and the loop's side.

        `boot_text` greets every new peer. `load` gives the share of a core in use, 0 to
        1. `vault` keeps the signing key and its timestamps over restarts. `offer_utc` takes
        the time that a ground station says, and when it came. `calibrator` is the compass,
        if it can calibrate itself. `storage` is what file transfer and log download show of
        the disk.
        """
        self._transports = tuple(transports)
        self._context = LinkContext(request_handler, Suppliers(utc_s, load, offer_utc, calibrator), version)
        self._signing = Signing(utc_s, vault.save)
        self.key_readable = self._signing.restore(vault.load() or b"")
        self._gate = Gate(self._signing)
        self._reads_only = reads_only(frozenset(row.command for row in COMMANDS if row.repeatable))
        self._peers = Peers(
            self._transports,
            self._gate,
            lambda index: LinkSealer(self._signing, index),
            self._greet,
            self._send_heartbeat,
        )
        self._context.peers = self._peers
        self._parameters = ParameterServer(self._context)
        self._mission = MissionServer(self._context)
        self._commands = CommandServer(self._context, COMMANDS)
        self._worker = Worker(background=storage.background)
        plan_files = PlanFiles(self._context, self._worker)
        sinks = {PACKED_PARAMETERS: self._parameters.put_in_force, **plan_files.sinks()}
        tree = tree_of(storage, self._context.metadata, request_handler, plan_files.generated(), sinks)
        self._files = Files(self._context, tree, self._worker)
        self._logs = LogServer(self._context, storage.catalogue, self._worker, logging=storage.logging)
        self._greeting = (Event(Severity.INFO, boot_text),) if boot_text else ()
        self._recent: deque[Event] = deque(maxlen=_REMEMBERED_EVENTS)
        self._receive_queue = ReceiveQueue(self._peers.has)
        self._unread: deque[tuple[Peer, Admitted]] = deque()  # frames not yet answered
        self._station_s: float | None = None
        self._turn = 0  # whose long answer goes on next
        self._pumping = False  # whether one did in the last call
        self._handlers = self._collect()

    def _collect(self) -> Mapping[int, Handler]:
        context = self._context
        services = (self._commands, Setpoints(context), ManualControl(context), self._parameters, self._mission)
        others = (self._files, self._logs, Timesync(context), HomeSetting(context), KeySetup(context, self._signing))
        found: dict[int, Handler] = {_DATA_STREAM: request_data_stream, _HEARTBEAT: self._note_ground_station}
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
        found = [descriptor for transport in self._transports for descriptor in transport.descriptors()]
        return found if self._worker.fileno() < 0 else [*found, self._worker.fileno()]

    @property
    def busy(self) -> bool:
        """Whether `service` has something to do even when no descriptor is ready."""
        if self._unread or self._receive_queue or self._pumping:
            return True
        return any(peer.bulk.can_continue and not peer.outbox.waiting(Priority.REPLY) for peer in self._peers)

    @property
    def station_s(self) -> float | None:
        """When a ground station was last heard, None when none has been."""
        return self._station_s

    def service(self, now_s: float, ready: Sequence[int]) -> None:
        """Read a bounded piece from each ready transport, unless the last one of a stream still waits; answer some."""
        self._context.now_s = now_s
        if self._worker.fileno() in ready:
            self._worker.poll()
        for index, transport in enumerate(self._transports):
            if not transport.datagrams and self._receive_queue.holds(index):
                continue
            for descriptor in transport.descriptors():
                if descriptor in ready:
                    for address, data in transport.receive(descriptor):
                        self._receive_queue.offer(index, address, data)
        self._answer(now_s)
        self._flush(now_s)  # acknowledgements first
        self._peers.update(now_s)
        self._pump(now_s)
        self._flush(now_s)

    def publish(self, output: Output, now_s: float) -> None:
        """Send the telemetry that is due and what the tick has to say."""
        self._context.now_s = now_s
        self._worker.poll()
        self._logs.new_tick()
        for transport in self._transports:
            transport.poll(now_s)
        self._note_changes(output.snapshot, now_s)
        self._answer(now_s)
        self._mission.update(now_s)
        self._commands.update(now_s)
        self._peers.update(now_s)
        self._announce(output.events)
        self._send_telemetry(1.0 / max(output.snapshot.rate_hz, 1.0), now_s)
        self._pump(now_s)
        self._flush(now_s)

    def close(self) -> None:
        """Send what waits and close the transports."""
        self._worker.close()
        self._signing.store_exactly()
        self._context.flush_all()
        for transport in self._transports:
            transport.close()

    # ------------------------------------------------------------------ in

    def _search(self, index: int, address: Address, data: bytes, now_s: float) -> None:
        false_before = self._gate.false_signatures
        heard = self._peers.frames(index, address, data[:_PIECE_BYTES], now_s)
        if heard is None:
            return
        if len(data) > _PIECE_BYTES:
            self._receive_queue.put_back(index, address, data[_PIECE_BYTES:])
        peer, found = heard
        self._unread.extend((peer, admitted) for admitted in found if admitted.frame.number in self._handlers)
        if self._gate.false_signatures > false_before:
            self._context.send_text_limited(peer, Severity.WARNING, _FALSE_SIGNATURE, now_s)

    def _answer(self, now_s: float) -> None:
        searched = 0
        while self._receive_queue and searched < _BYTES_AT_ONCE and len(self._unread) < _FRAMES_AT_ONCE:
            piece = self._receive_queue.pop()
            self._search(*piece, now_s)
            searched += min(len(piece[2]), _PIECE_BYTES)
        for _ in range(min(_FRAMES_AT_ONCE, len(self._unread))):
            self._dispatch(*self._unread.popleft(), now_s)

    def _dispatch(self, peer: Peer, admitted: Admitted, now_s: float) -> None:
        frame, standing = admitted
        message = self._context.codec.decode(frame.data)
        if message is None or not self._context.is_addressee(message) or self._from_self(message):
            return
        if standing is Standing.COMMANDER or self._reads_only(frame.number, message):
            self._handlers[frame.number](peer, message, now_s)
        else:
            deny(self._context, peer, message, now_s)

    def _from_self(self, message: Message) -> bool:
        """Return whether this is our own message, sent back by a loop in somebody's wiring."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        return sender == (self._context.system, self._context.component)

    def _note_ground_station(self, peer: Peer, message: Message, now_s: float) -> None:
        """Note that a ground station is there."""
        if message.type == _GROUND_STATION:
            peer.ground_station_s = self._station_s = now_s

    # ------------------------------------------------------------------ out

    def _greet(self, peer: Peer, now_s: float) -> None:
        if peer.quiet:
            if self._context.high_latency:
                peer.streams.set_high_latency(self._context.request_handler.parameters()["LNK_SAT_S"], now_s)
            return
        self._context.send(peer, self._context.heartbeat(), Priority.URGENT)
        if self._context.snapshot is not None:
            peer.streams.mark_sent(table.ROWS_OF[_HEARTBEAT][0], now_s)
        for event in (*self._greeting, *self._recent):
            self._context.send_text(peer, event.severity, event.text)

    def _send_heartbeat(self, stranger: Peer, now_s: float) -> None:
        self._context.send(stranger, self._context.heartbeat(), Priority.URGENT)
        stranger.outbox.flush(now_s)

    def _note_changes(self, snapshot: Snapshot, now_s: float) -> None:
        """Make what has changed due at once: mode, arming, home."""
        before = self._context.snapshot
        self._context.refused_frames = self._peers.refused_frames() + self._peers.rejected + self._gate.refused_frames
        self._gate.mavlink1 = bool(self._context.request_handler.parameters()["LNK_MAVLINK1"])
        self._context.snapshot = snapshot
        self._mission.report_progress(before, snapshot, now_s)
        if before is None or (before.mode, before.armed) != (snapshot.mode, snapshot.armed):
            for peer in self._peers:
                peer.streams.make_due(_HEARTBEAT, now_s)
                peer.streams.make_due(_CURRENT_MODE, now_s)
        telemetry = self._context.telemetry_context()
        moved = before is None or before.home != snapshot.home
        if telemetry is not None and snapshot.home is not None and (moved or self._context.home_report_due):
            self._context.home_report_due = False
            self._context.send_all(motion.home_position(telemetry))
            self._context.send_all(estimates.gps_global_origin(telemetry))

    def _announce(self, events: Sequence[Event]) -> None:
        for event in events[:_EVENTS_PER_TICK]:
            self._context.send_text_all(event.severity, event.text)
            if event.severity <= Severity.WARNING:
                self._recent.append(event)

    def _send_telemetry(self, tick_s: float, now_s: float) -> None:
        if not self._peers:
            return
        telemetry = self._context.telemetry_context()
        if telemetry is None:
            return
        packed: dict[int, Packed | None] = {}  # every row is built and packed once for all peers
        for peer in self._peers:
            room_bytes = peer.outbox.room_bytes(now_s)
            for row in peer.streams.due(now_s, tick_s):
                if row not in packed:
                    packed[row] = self._packed(row, telemetry)
                found = packed[row]
                urgent = table.TABLE[row].priority is Priority.URGENT
                if found is not None and not urgent:
                    room_bytes -= peer.outbox.size_of(found)
                    if room_bytes < 0.0:
                        # The rest stays due, and the longest due goes first next time.
                        continue
                if found is not None:
                    peer.outbox.push(found, table.TABLE[row].priority)
                peer.streams.mark_sent(row, now_s)

    def _packed(self, row: int, telemetry: TelemetryContext) -> Packed | None:
        message = table.TABLE[row].build(telemetry)
        return None if message is None else self._context.codec.pack(message)

    def _flush(self, now_s: float) -> None:
        for peer in self._peers:
            peer.outbox.flush(now_s)

    def _pump(self, now_s: float) -> None:
        """Go on with a long answer to one peer; the others have their turns in the next calls."""
        peers = tuple(self._peers)
        self._pumping = False
        for number in range(len(peers)):
            peer = peers[(self._turn + number) % len(peers)]
            before = peer.outbox.waiting(Priority.REPLY)
            peer.bulk.can_continue = False
            self._parameters.pump(peer)
            self._files.pump(peer, now_s)
            self._logs.pump(peer, now_s)
            if peer.outbox.waiting(Priority.REPLY) > before:
                self._turn = (self._turn + number + 1) % len(peers)
                self._pumping = True
                return
