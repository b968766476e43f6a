"""Interface of the link to the loop: reception and replies between ticks, telemetry after each tick."""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Protocol

from firmware_py.common.interfaces import Calibrator, RequestHandler, Vault
from firmware_py.common.link_status import LinkStatus
from firmware_py.common.records import Event, Progress, Severity, Stored
from firmware_py.common.reports import Output, Snapshot
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.access import RADIO_STATUS, AdmittedFrame, Gate, Permission, is_open_to_anyone, make_reading_test
from firmware_py.link.commands.requests import request_data_stream
from firmware_py.link.commands.server import CommandServer
from firmware_py.link.commands.steering import ManualControl, Setpoints
from firmware_py.link.commands.table import TABLE as COMMANDS
from firmware_py.link.context import Handler, LinkContext, Suppliers
from firmware_py.link.files.server import FileServer
from firmware_py.link.files.tree import PACKED_PARAMETERS, FileRoot, build_tree
from firmware_py.link.logs import LogServer
from firmware_py.link.mission.plan_file import PlanFiles
from firmware_py.link.mission.server import MissionServer
from firmware_py.link.parameters.server import ExtendedParameters, ParameterServer
from firmware_py.link.peers import DuplicateSystemId, Peer, Peers
from firmware_py.link.routing import Router
from firmware_py.link.services import CompanionBattery, KeySetup, Shell, Timesync, adapt_to_radio_status, deny
from firmware_py.link.signing import NO_VAULT, LinkSealer, Signing
from firmware_py.link.telemetry.identity import Version
from firmware_py.link.telemetry.publisher import SatelliteReports, TelemetryPublisher
from firmware_py.link.telemetry.statustext import RecentWarnings
from firmware_py.link.telemetry.table import ROWS_OF
from firmware_py.link.wire.dialect import Message
from firmware_py.link.wire.outbox import Priority
from firmware_py.link.wire.transport import Address, Satellite, Transport
from firmware_py.link.wire.worker import Worker

_HEARTBEAT = 0
_GROUND_STATION = 6  # MAV_TYPE_GCS
_MAX_EVENTS_PER_TICK = 16
# Limits of one call, which must take at most half a millisecond. A piece is longer than the longest frame, so that the
# first frame of an unknown sender is complete.
_MAX_FRAMES_PER_CALL = 4
_MAX_BYTES_PER_CALL = 256  # searched for frames; the last piece may exceed it
_MAX_PIECE_BYTES = 320
_NEW_PEER_BYTES = 64  # whose search takes as long as the creation of a peer
_MAX_BURST_NOTICES, _MAX_NOTICES_HZ = 4, 1.0 / 30.0  # of `notify`
NO_STORAGE = FileRoot()
_FALSE_SIGNATURE = "Signature refused: wrong key or old timestamp"

_DATA_STREAM = 66

Source = tuple[int, Address]  # index of the transport, address on it
MAX_SHARE_BYTES = 16_384  # queued for one peer, unless it is one datagram
_UNKNOWN_SENDERS: Source = (-1, None)  # they have one common share


def _no_load() -> float:
    return 0.0


def _nothing_written() -> None:
    return None


class Endpoint:
    """MAVLink component on several transports; implements interfaces.Link."""

    def __init__(
        self,
        transports: Sequence[Transport],
        request_handler: RequestHandler,
        *,
        utc_s: Callable[[], float],
        version: Version,
        load: Callable[[], float] = _no_load,
        vault: Vault = NO_VAULT,
        offer_utc: Callable[[float, float], None] | None = None,
        calibrator: Calibrator | None = None,
        storage: FileRoot = NO_STORAGE,
        written: Callable[[], tuple[int, int] | None] = _nothing_written,
        start_events: Sequence[Event] = (),
    ) -> None:
        """Store opened transports and the functions of the rest of the program.

        `load` returns the load of a processor core, 0 to 1. `vault` stores the signing key and its timestamps.
        `offer_utc` takes the UTC of a ground station and the time of its reception, both in seconds. `calibrator` is
        the compass, if it can calibrate itself. `storage` names the files for file transfer and log download. `written`
        returns the number of versions of the state that were written since the start and their bytes, None without
        storage. `start_events` are sent to every station that connects later.
        """
        self._transports = tuple(transports)
        self._context = LinkContext(request_handler, Suppliers(utc_s, load, offer_utc, calibrator, written), version)
        self._signing = Signing(utc_s, vault.save)
        self._signing.restore(vault.load())
        self._gate = Gate(self._signing)
        for satellite in (transport for transport in transports if isinstance(transport, Satellite)):
            satellite.attach(request_handler.parameters, self._signing.compute_hmac, self._gate.mark_signed)
        self._only_reads = make_reading_test(frozenset(row.command for row in COMMANDS if row.repeatable))
        self._notices = TokenBucket(_MAX_BURST_NOTICES, _MAX_NOTICES_HZ)
        self._peers = Peers(
            self._transports,
            self._gate,
            lambda index: LinkSealer(self._signing, index),
            self,
        )
        self._context.peers = self._peers
        self._context.all_peers = self._peers.all_peers
        self._router = Router((self._context.system, self._context.component), self._peers, self.notify)
        self._worker = Worker(background=storage.background)
        self._services = Services(self._context, KeySetup(self._context, self._signing, vault), storage, self._worker)
        self._telemetry = TelemetryPublisher(self._context)
        self._duplicate_system_id = DuplicateSystemId(
            self._context.system,
            self._context.autopilot,
            utc_s,
            lambda text: self._context.send_text_all(Severity.WARNING, text),
        )
        self.start_events = (*start_events, *self._open_links())[:_MAX_EVENTS_PER_TICK]
        self._recent = RecentWarnings()
        self._receive_queue = ReceiveQueue(self._peers.has)
        self._unread: deque[tuple[Peer, AdmittedFrame]] = deque()  # frames not dispatched yet
        self._station_s: float | None = None
        self._handlers = {**self._services.handlers(), _HEARTBEAT: self._register_ground_station}

    def _open_links(self) -> Iterator[Event]:
        for transport in self._transports:
            if is_open_to_anyone(self._gate, transport):
                yield Event(Severity.WARNING, f"Open link: anyone on {transport.name} can command; set a signing key")

    @property
    def handlers(self) -> Mapping[int, Handler]:
        """The handler of each message, by its number."""
        return self._handlers

    # ------------------------------------------------------------------ interfaces.Link

    def descriptors(self) -> Sequence[int]:
        """Return the descriptors that `service` reads."""
        descriptors = [descriptor for transport in self._transports for descriptor in transport.descriptors()]
        return descriptors if self._worker.fileno() < 0 else [*descriptors, self._worker.fileno()]

    @property
    def busy(self) -> bool:
        """Whether `service` has work even when no descriptor is ready."""
        if self._unread or self._receive_queue or self._services.is_pumping:
            return True
        for peer in self._peers:  # called at each wake-up: no generator
            if peer.bulk.can_continue and peer.is_proven and not peer.outbox.queued_count(Priority.REPLY):
                return True
        return False

    @property
    def station_s(self) -> float | None:
        """Time of the latest heartbeat of a ground station that may command; None before the first."""
        return self._station_s

    def restore_late_key(self, stored: Stored) -> bool:
        """Use the signing key of a disk that is available late; return False if a key was set or removed before."""
        return self._signing.restore_late(stored)

    @property
    def key_problem(self) -> str:
        """Reason why the signing key was lost; empty if it was not."""
        return self._signing.problem

    def status(self, now_s: float) -> Sequence[LinkStatus]:
        """Return the status of each link and its peers."""
        return self._peers.status(now_s)

    def service(self, now_s: float, ready: Sequence[int]) -> None:
        """Read from each ready transport, unless bytes of its stream are still queued; dispatch some frames."""
        self._context.now_s = now_s
        if self._worker.fileno() in ready:
            self._worker.poll()
        for index, transport in enumerate(self._transports):
            if not transport.is_datagram and self._receive_queue.has_bytes_of(index):
                continue
            for descriptor in transport.descriptors():
                if descriptor in ready:
                    for address, data in transport.receive(descriptor):
                        self._receive_queue.offer(index, address, data)
        self._process_queue(now_s)
        self._peers.flush(now_s)  # acknowledgements first
        self._peers.update(now_s)
        self._services.pump(self._peers.all_peers(), now_s)
        self._peers.flush(now_s)

    def publish(self, output: Output, now_s: float) -> None:
        """Send the due telemetry and the events of the tick."""
        self._context.now_s = now_s
        if self._worker.has_pending_jobs:
            self._worker.poll()
        for transport in self._transports:
            transport.poll(now_s)
        self._report_changes(output.snapshot, now_s)
        self._process_queue(now_s)
        self._services.update(now_s)
        self._peers.update(now_s)
        self._send_events(output.events)
        self._telemetry.send_due(self._peers, 1.0 / max(output.snapshot.rate_hz, 1.0), now_s)
        self._services.pump(self._peers.all_peers(), now_s)
        self._peers.flush(now_s)

    def progress(self) -> Sequence[Progress]:
        """Return the progress of the thread for disk work."""
        return self._worker.progress()

    def close(self) -> None:
        """Send all queued frames and close the transports."""
        self._worker.close()
        self._signing.store_exactly()
        self._context.flush_all()
        for transport in self._transports:
            transport.close()

    # ------------------------------------------------------------------ in

    def _search(self, index: int, address: Address, data: bytes, now_s: float) -> None:
        """Queue and route the frames in received bytes."""
        false_signatures = self._gate.false_signatures
        received = self._peers.receive(index, address, data[:_MAX_PIECE_BYTES], now_s)
        if received is None:
            return
        peer, frames = received
        peer.rest_follows = len(data) > _MAX_PIECE_BYTES
        if peer.rest_follows:
            self._receive_queue.put_back(index, address, data[_MAX_PIECE_BYTES:])
        self._router.route(peer, frames, now_s)
        self._unread.extend((peer, admitted) for admitted in frames if admitted.frame.number in self._handlers)
        if self._gate.false_signatures > false_signatures:
            self._context.send_text_limited(peer, Severity.WARNING, _FALSE_SIGNATURE, now_s)

    def _process_queue(self, now_s: float) -> None:
        """Search queued bytes for frames and dispatch frames, within the limits of one call."""
        searched = 0
        while self._receive_queue and searched < _MAX_BYTES_PER_CALL and len(self._unread) < _MAX_FRAMES_PER_CALL:
            piece = self._receive_queue.pop()
            self._search(*piece, now_s)
            new_peer_bytes = 0 if self._peers.has(*piece[:2]) else _NEW_PEER_BYTES
            searched += max(new_peer_bytes, min(len(piece[2]), _MAX_PIECE_BYTES))
        for _ in range(min(_MAX_FRAMES_PER_CALL, len(self._unread))):
            self._dispatch(*self._unread.popleft(), now_s)

    def _dispatch(self, peer: Peer, admitted: AdmittedFrame, now_s: float) -> None:
        frame, permission, is_verified = admitted
        # If a key is set, an unsigned heartbeat may be that of another station.
        if frame.number == _HEARTBEAT and not self._gate.is_owner(peer.transport.options, is_verified=is_verified):
            return
        message = self._context.codec.decode(frame.data)
        if message is None or not self._context.is_addressee(message):
            return
        if self._from_self(message):
            self._duplicate_system_id.check(message, now_s)
            return
        # A station that may not command cannot recover the boat: its heartbeat does not clear STATION_SILENT.
        if frame.number == _HEARTBEAT and permission is not Permission.COMMANDER:
            return
        if permission is Permission.COMMANDER or self._only_reads(frame.number, message):
            self._handlers[frame.number](peer, message, now_s)
        else:
            deny(self._context, peer, message, now_s)

    def _from_self(self, message: Message) -> bool:
        """Return whether a message has the ids of the boat: an echo of a loop, or another vehicle."""
        sender = (message.get_srcSystem(), message.get_srcComponent())
        return sender == (self._context.system, self._context.component)

    def _register_ground_station(self, peer: Peer, message: Message, now_s: float) -> None:
        """Store the time of the heartbeat of a ground station; exclude programs with the system id of the boat."""
        if message.type == _GROUND_STATION and message.get_srcSystem() != self._context.system:
            peer.ground_station_s = self._station_s = now_s

    # ------------------------------------------------------------------ out

    def greet(self, peer: Peer, now_s: float) -> None:
        """Send a new active peer a heartbeat, the start events and the recent warnings.

        A satellite peer is sent none of them, but HIGH_LATENCY2 if it is requested.
        """
        if peer.is_satellite:
            if self._context.high_latency:
                peer.streams.set_high_latency(self._context.request_handler.parameters()["LNK_SAT_S"], now_s)
            return
        self.announce(peer)
        if self._context.snapshot is not None:
            peer.streams.schedule_next(ROWS_OF[_HEARTBEAT][0], now_s)
        for event in (*self.start_events, *self._recent.recent_events(now_s)):
            self._context.send_text(peer, event.severity, event.text)

    def announce(self, peer: Peer) -> None:
        """Queue a heartbeat, and before it the arming checks if the peer may need them (see `introduce`)."""
        self._context.introduce(peer)
        self.send_heartbeat(peer)

    def send_heartbeat(self, peer: Peer) -> None:
        """Queue a heartbeat only."""
        self._context.send(peer, self._context.heartbeat(), Priority.URGENT)

    def notify(self, text: str, now_s: float) -> None:
        """Report an event of peers, links or routing to all stations, at a limited rate."""
        if self._notices.spend_one(now_s):
            self._context.send_text_all(Severity.NOTICE, text)

    def _report_changes(self, snapshot: Snapshot, now_s: float) -> None:
        """Store the snapshot after a tick, and make changed messages due."""
        previous = self._context.snapshot
        self._context.refused_frames = self._peers.damaged_frames() + self._peers.rejected + self._gate.refused_frames
        self._gate.accepts_mavlink1 = bool(self._context.request_handler.parameters()["LNK_MAVLINK1"])
        self._context.update_snapshot(snapshot)
        self._services.report_changes(previous, snapshot, now_s)
        self._telemetry.report_changes(previous, snapshot, self._peers, now_s)

    def _send_events(self, events: Sequence[Event]) -> None:
        for event in events[:_MAX_EVENTS_PER_TICK]:
            self._context.send_text_all(event.severity, event.text)
            if event not in self.start_events:
                self._recent.add(event, self._context.now_s)


class Service(Protocol):
    """Part of the link that handles messages."""

    def handlers(self) -> Mapping[int, Handler]:
        """Return the handler of each message, by its number."""


class TickedService(Service, Protocol):
    """Service that is updated after each tick."""

    def update(self, now_s: float) -> None:
        """Update the service after a tick."""


class PumpedService(Service, Protocol):
    """Service with long transfers."""

    def pump(self, peer: Peer, now_s: float) -> None:
        """Send the next part of a transfer within the free capacity of the line."""


class Services:
    """All services of one link."""

    def __init__(self, context: LinkContext, key_setup: KeySetup, root: FileRoot, worker: Worker) -> None:
        """Create the services with the context, the visible files and the worker for disk operations."""
        commands = CommandServer(context, COMMANDS)
        parameters = ParameterServer(context)
        extended = ExtendedParameters(context, parameters)
        plan_files = PlanFiles(context, worker)
        sinks = {PACKED_PARAMETERS: parameters.apply_file, **plan_files.sinks()}
        self.tree = build_tree(root, context.metadata, context.request_handler, plan_files.generated(), sinks)
        files = FileServer(context, self.tree, worker)
        logs = LogServer(context, root.catalogue, worker, logging=root.logging)
        self._mission = MissionServer(context)
        self._all: tuple[Service, ...] = (
            *(commands, parameters, extended, self._mission, files, logs),
            *(
                Setpoints(context),
                ManualControl(context),
                Timesync(context),
                CompanionBattery(context),
                Shell(context),
                key_setup,
            ),
        )
        self._ticked: tuple[TickedService, ...] = (self._mission, commands, logs, SatelliteReports(context))
        self._pumped: tuple[PumpedService, ...] = (parameters, extended, files, logs)
        self._next_peer = 0  # index of the peer whose transfer continues next
        self.is_pumping = False  # whether a transfer continued in the last call

    def handlers(self) -> dict[int, Handler]:
        """Return the handler of each message, by its number."""
        handlers: dict[int, Handler] = {_DATA_STREAM: request_data_stream, RADIO_STATUS: adapt_to_radio_status}
        for service in self._all:
            handlers.update(service.handlers())
        return handlers

    def report_changes(self, previous: Snapshot | None, snapshot: Snapshot, now_s: float) -> None:
        """Report changes after a tick that are not in the telemetry table."""
        self._mission.report_progress(previous, snapshot, now_s)

    def update(self, now_s: float) -> None:
        """Update each service after a tick."""
        for service in self._ticked:
            service.update(now_s)

    def pump(self, peers: Iterable[Peer], now_s: float) -> None:
        """Continue the transfers to one peer; the next calls continue those to the others."""
        present = tuple(peers)
        self.is_pumping = False
        for number in range(len(present)):
            peer = present[(self._next_peer + number) % len(present)]
            queued_before = peer.outbox.queued_count(Priority.REPLY)
            peer.bulk.can_continue = False
            for service in self._pumped:
                service.pump(peer, now_s)
            if peer.outbox.queued_count(Priority.REPLY) > queued_before:
                self._next_peer = (self._next_peer + number + 1) % len(present)
                self.is_pumping = True
                return


class ReceiveQueue:
    """Received bytes by peer with an equal share for each, processed in turn.

    All senders share a datagram socket, which is read faster than frames are processed. Bytes beyond the share of their
    sender are dropped here; otherwise the system would drop those of other senders. A stream is read only while none of
    its bytes are queued, so that its sender has to wait.
    """

    def __init__(self, is_peer: Callable[[int, Address], bool]) -> None:
        """Store the function that identifies active peers."""
        self._is_peer = is_peer
        self._pieces: OrderedDict[Source, deque[tuple[int, Address, bytes]]] = OrderedDict()
        self._bytes: dict[Source, int] = {}
        self.dropped = 0  # datagrams beyond the share of their sender

    def __bool__(self) -> bool:
        """Return whether bytes are queued."""
        return bool(self._pieces)

    def has_bytes_of(self, index: int) -> bool:
        """Return whether bytes of a transport are queued."""
        return any(source[0] == index for source in self._pieces)

    def offer(self, index: int, address: Address, data: bytes) -> None:
        """Queue a piece; if the share of its sender is exceeded, drop and count it."""
        source = (index, address) if self._is_peer(index, address) else _UNKNOWN_SENDERS
        queued_bytes = self._bytes.get(source, 0)
        if queued_bytes and queued_bytes + len(data) > MAX_SHARE_BYTES:
            self.dropped += 1
            return
        self._pieces.setdefault(source, deque()).append((index, address, data))
        self._bytes[source] = queued_bytes + len(data)

    def put_back(self, index: int, address: Address, data: bytes) -> None:
        """Queue the rest of a piece before the other bytes of its peer."""
        source = (index, address)
        self._pieces.setdefault(source, deque()).appendleft((index, address, data))
        self._bytes[source] = self._bytes.get(source, 0) + len(data)

    def pop(self) -> tuple[int, Address, bytes]:
        """Return the next piece, of another peer than before if possible; raise KeyError if the queue is empty."""
        source, queue = self._pieces.popitem(last=False)
        piece = queue.popleft()
        if queue:
            self._pieces[source] = queue
            self._bytes[source] -= len(piece[2])
        else:
            del self._bytes[source]
        return piece
