"""Peers of the link: identity of stations, capacity of links, paths and duplicate frames, duplicate system ids.

A peer is one address on one transport. It is pending until it is proven that it receives data, and active afterwards. A
station may use several peers: a router sends each frame over all links to the boat, and a NAT changes the port of a
station during a transfer. `PeerPaths` detects that two paths belong to one station, so that an exchange continues on
another path, and a frame is processed once.

Only ids and frame numbers identify a station, and two stations may have the same ids. Two paths belong to one station
after several identical frames, and to two stations after two different frames with the same number.
"""

from __future__ import annotations

import math
from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from typing import NamedTuple, Protocol, TypeAlias

from firmware_py.common.link_status import LinkStatus, PeerStatus
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.access import AdmittedFrame, Gate, Permission
from firmware_py.link.latest import keep_latest
from firmware_py.link.telemetry.fields import UINT32_MAX, boot_ms
from firmware_py.link.telemetry.statustext import TextLimiter
from firmware_py.link.telemetry.streams import Streams
from firmware_py.link.wire.dialect import Message, mavlink
from firmware_py.link.wire.frames import Frame, Splitter, VersionDetector
from firmware_py.link.wire.outbox import BulkShare, Outbox, Priority, RadioRate, Sealer
from firmware_py.link.wire.transport import Address, Satellite, Transport, link_class_of
from firmware_py.link.wire.urls import LinkClass

DUPLICATE_S = 10.0  # maximum delay of a frame on its second path
MIN_IDENTICAL_FRAMES = 3  # on two paths before the paths are assigned to one station
SPLIT_PENALTY_FRAMES = 10  # additional identical frames required after two paths were separated
MOVE_TIMEOUT_S = 10.0  # maximum silence of a station that changes its port
MAX_LOST_FRAMES = 16  # during that change
_MAX_SENDERS = 8
_FRAME_NUMBERS = 256
_MAVLINK2 = 0xFD

# Bytes that may be sent to an unproven address for each byte received from it. It limits the amplification of frames
# with a forged address to less than ten.
_CREDIT_PER_BYTE = 8
HEARTBEAT_GAP_S = 3.0  # after this silence a program may have restarted, since stations send a heartbeat every second
MAX_BURST_DENIALS = 20  # replies to refused requests
MAX_DENIALS_HZ = 5.0  # their average rate

Sender = tuple[int, int]  # MAVLink system and component

MAX_ACTIVE_PEERS = 8  # of one link, in addition to those in the vehicle file
MAX_UNKNOWN_PEERS = 4  # of them, if a signing key is set
QUIET_S = 10.0  # a peer that is silent for longer may be evicted
MAX_PENDING_PEERS = 16  # of one link

UNPROVEN_AFTER_S = 10.0  # silence after which a datagram peer without signatures must prove its address again
FORGET_S = 300.0  # silence after which a peer is removed
HEARTBEAT_S = 1.0  # interval of heartbeats to a pending peer
BLOCKED_REPORT_S = 10.0  # a link that is blocked for longer is reported over the other links
MAX_LATE_HEARTBEATS = 4  # burst of signed heartbeats to unknown senders with old timestamps
MAX_LATE_HEARTBEATS_HZ = 1.0  # their average rate

Key: TypeAlias = tuple[int, Address]  # index of the transport, address on it

_HEARTBEAT, _SYSTEM_TIME = 0, 2
_MIN_FOREIGN_FRAMES = 5  # in sequence, before a duplicate system id is reported
_CLOCK_TOLERANCE_S = 2.0  # difference between a clock and its received time
_MAX_ECHO_AGE_S = 60.0  # of an own frame that a loop sends back
_DUPLICATE_REPORT_S = 600.0  # minimum interval of reports


class PeerPath:
    """Path to the boat from one station; `origin` is the transport and the computer of the station.

    `station` is an object that all paths of one station share. `since_s` and `latest_s` are the times of the start and
    of the latest frame.
    """

    __slots__ = ("identical_frames", "latest_s", "origin", "since_s", "station")

    def __init__(self, origin: object, now_s: float) -> None:
        """Start as the path of a new station."""
        self.origin = origin
        self.since_s = self.latest_s = now_s
        self.station = object()
        self.identical_frames = 0  # number of frames that are identical to those of another path


class _FirstCopy(NamedTuple):
    """First copy of a frame."""

    frame_hash: int
    path: PeerPath
    t_s: float
    order: int  # number of the frames of its sender until then


class _SenderFrames:
    """Latest frame of each number of one sender."""

    __slots__ = ("by_number", "count", "latest_number")

    def __init__(self) -> None:
        self.by_number: dict[int, _FirstCopy] = {}
        self.count = 0
        self.latest_number = 0


class PeerPaths:
    """Latest frames of the latest senders with the path of their first copies; bounded."""

    def __init__(self) -> None:
        """Start without frames."""
        self._senders: OrderedDict[Sender, _SenderFrames] = OrderedDict()

    def is_duplicate(self, path: PeerPath, frame: bytes, now_s: float) -> bool:
        """Return whether a frame was received on another path of its station.

        After several identical frames on both, the path is assigned to the station of the other path.

        A frame that is received twice on one path is not a duplicate here: the services handle it.
        """
        sender, number = _sender_and_number(frame)
        frames = self._senders.get(sender)
        first = None if frames is None else frames.by_number.get(number)
        path.latest_s = now_s
        if first is None or first.path is path or now_s - first.t_s > DUPLICATE_S or first.frame_hash != hash(frame):
            return False
        if first.path.station is path.station:
            return True
        # A restarted program repeats its frames, but not on two paths at the same time.
        if first.path.latest_s > path.since_s:
            path.identical_frames += 1
            if path.identical_frames >= MIN_IDENTICAL_FRAMES:
                path.station = first.path.station
        return False

    def add(self, path: PeerPath, frame: bytes, now_s: float) -> None:
        """Store a frame. If its station has sent another frame with this number, separate the two paths."""
        sender, number = _sender_and_number(frame)
        frames = self._senders.get(sender) or _SenderFrames()
        frame_hash, first = hash(frame), frames.by_number.get(number)
        if first is not None and first.path is not path and now_s - first.t_s <= DUPLICATE_S:
            if first.frame_hash == frame_hash:
                return  # a copy on a path that is not assigned to the same station yet
            if first.path.station is path.station and frames.count - first.order < _FRAME_NUMBERS // 2:
                path.station, path.identical_frames = object(), -SPLIT_PENALTY_FRAMES
        frames.count += 1
        frames.latest_number = number
        frames.by_number[number] = _FirstCopy(frame_hash, path, now_s, frames.count)
        keep_latest(self._senders, sender, frames, _MAX_SENDERS)

    def assign_moved(self, path: PeerPath, frame: bytes, now_s: float, *, is_verified: bool) -> None:
        """Assign a new path to the station whose frame numbers it continues, from the same computer or signed.

        Number 0 is excluded: it is that of a program that has just started, such as a script beside the station.
        """
        sender, number = _sender_and_number(frame)
        frames = self._senders.get(sender)
        if frames is None or number == 0:
            return
        latest = frames.by_number[frames.latest_number]
        continues = 1 <= (number - frames.latest_number) % _FRAME_NUMBERS <= MAX_LOST_FRAMES
        is_allowed = is_verified or latest.path.origin == path.origin
        if continues and is_allowed and now_s - latest.t_s <= MOVE_TIMEOUT_S:
            path.station = latest.path.station


def _sender_and_number(frame: bytes) -> tuple[Sender, int]:
    """Return the sender and the number of a frame."""
    if frame[0] == _MAVLINK2:
        return (frame[5], frame[6]), frame[4]
    return (frame[3], frame[4]), frame[2]


class Peer:
    """Peer with the parser of its bytes, the queue to it, and the rates that it requested.

    It is proven that the peer receives frames after it has sent again after a reply, or signed a frame. Until then it
    is sent at most a few times the bytes received from its address.
    """

    __slots__ = (
        "_radio_rate",
        "_unproven_sent_bytes",
        "_version",
        "address",
        "bulk",
        "denial_tokens",
        "extended_rows_due",
        "frame_s",
        "ground_station_s",
        "heartbeat_s",
        "is_introduced",
        "is_verified",
        "last_frame_s",
        "link_class",
        "notices",
        "outbox",
        "parameter_list_row",
        "parameter_rows_due",
        "path",
        "rest_follows",
        "splitter",
        "streams",
        "transport",
        "version_reported",
    )

    def __init__(self, transport: Transport, address: Address, sealer: Sealer, now_s: float) -> None:
        """Start with the rates of the link class of the transport."""
        self.transport = transport
        self.address = address
        is_datagram = transport.is_datagram
        self.path = PeerPath((transport, transport.host(address)) if is_datagram else (transport, address), now_s)
        self.splitter = Splitter(transport.byte_rate)
        self.outbox = Outbox(lambda data: transport.send(address, data), transport.byte_rate, sealer)
        self.link_class = link_class_of(transport)
        self.streams = Streams(self.link_class, now_s)
        self.notices = TextLimiter()
        self.denial_tokens = TokenBucket(MAX_BURST_DENIALS, MAX_DENIALS_HZ)
        self.parameter_list_row: int | None = None  # next row of the requested parameter list
        self.parameter_rows_due: dict[int, None] = {}  # rows of the parameter table to be sent, in order
        self.extended_rows_due: dict[int, None] = {}  # rows to be sent as PARAM_EXT
        self.bulk = BulkShare(transport.byte_rate)
        self._radio_rate = RadioRate(transport.byte_rate)
        self._version = VersionDetector()
        self.last_frame_s = now_s  # time of the latest valid frame, or of the start
        self.frame_s: float | None = None  # time of the latest valid frame; None before the first
        self.ground_station_s: float | None = None  # time of its latest heartbeat of a ground station
        self.heartbeat_s = -math.inf  # time of the latest heartbeat to it while it was pending
        self.is_introduced = False  # whether the arming checks were sent before the first heartbeat
        self.version_reported = False  # whether the notice about MAVLink 1 was sent
        self.rest_follows = False  # whether the rest of the datagram is in the receive queue
        self.is_verified = False  # whether it has signed a frame with the boat's key
        self._unproven_sent_bytes = 0  # bytes sent before it became unproven

    @property
    def is_satellite(self) -> bool:
        """Whether its link is charged by data or by message, so that no telemetry is sent without a request."""
        return self.link_class is LinkClass.SATELLITE or self.has_paid_messages

    @property
    def has_paid_messages(self) -> bool:
        """Whether its link is charged by message. Reports and warnings are sent to it without a request."""
        return self.link_class is LinkClass.MESSAGES

    @property
    def is_routed(self) -> bool:
        """Whether messages between other systems are routed over its link."""
        route = self.transport.options.route
        if self.link_class is LinkClass.MESSAGES:
            return False
        return self.link_class is LinkClass.FAST if route is None else route

    @property
    def is_proven(self) -> bool:
        """Whether it is proven that frames to its address arrive."""
        return self.outbox.credit_bytes is None

    def copy_requests(self, other: Peer) -> None:
        """Copy the requests of another peer of the same station, which this peer replaces."""
        self.streams, self.ground_station_s = other.streams, other.ground_station_s
        self.is_introduced = other.is_introduced
        self.parameter_list_row = other.parameter_list_row
        self.parameter_rows_due, self.extended_rows_due = other.parameter_rows_due, other.extended_rows_due

    def status(self, now_s: float, *, has_place: bool) -> PeerStatus:
        """Return the status of the peer for reports; `has_place`: whether it is active."""
        host = self.transport.host(self.address)
        address = ":".join(map(str, self.address)) if isinstance(self.address, tuple) else str(host)
        return PeerStatus(
            address=address if isinstance(host, str) else self.transport.name,
            ground_station=self.ground_station_s is not None,
            has_place=has_place,
            signs=self.is_verified,
            heard_age_s=None if self.frame_s is None else now_s - self.frame_s,
            sent_bytes=self.outbox.sent_bytes,
            dropped=self.outbox.dropped,
            rejected=self.splitter.rejected,
        )

    def bulk_frames(self, frame_bytes: int, now_s: float) -> int:
        """Return the number of frames of a long transfer that may be queued now; 0 for an unproven peer."""
        queued_replies = self.outbox.queued_count(Priority.REPLY)
        return self.bulk.max_frames(frame_bytes, queued_replies, now_s) if self.is_proven else 0

    def update_version(self, frames: Iterable[Frame], now_s: float) -> None:
        """Send MAVLink 1 if the peer still uses it after the reception of MAVLink 2; not on a satellite link."""
        if self.outbox.sent_bytes and not self.is_satellite:
            self._version.update(frames, now_s)
            self.outbox.is_mavlink1_only = self._version.is_mavlink1_only

    def adapt_to_radio(self, free_percent: int, now_s: float) -> None:
        """Adapt the rate to the free buffer of the modem in the line."""
        self._radio_rate.update(free_percent, now_s)
        self._apply_radio_rate(now_s)

    def reset_radio_after_silence(self, now_s: float) -> None:
        """Return to the full rate of the line if RADIO_STATUS is missing."""
        if self._radio_rate.reset_after_silence(now_s):
            self._apply_radio_rate(now_s)

    def _apply_radio_rate(self, now_s: float) -> None:
        self.outbox.set_rate_share(self._radio_rate.share, now_s)
        self.bulk.set_rate_share(self._radio_rate.share, now_s)

    def may_need_introduction(self, now_s: float) -> bool:
        """Return whether the next heartbeat may be the first one that a program of the peer receives."""
        return not self.is_introduced or self.frame_s is None or now_s - self.frame_s > HEARTBEAT_GAP_S

    def mark_unproven(self) -> None:
        """Limit the bytes to the peer until its address is proven again."""
        self.outbox.credit_bytes = 0
        self._unproven_sent_bytes = self.outbox.sent_bytes

    def register_reception(self, count_bytes: int, now_s: float) -> bool:
        """Register received frames with this number of bytes; return whether the peer is proven."""
        self.frame_s = self.last_frame_s = now_s
        if self.outbox.credit_bytes is None:
            return True
        was_sent_data = self.is_satellite or self.outbox.sent_bytes > self._unproven_sent_bytes
        if self.is_verified or (was_sent_data and not self.rest_follows):
            return True
        self.outbox.credit_bytes += _CREDIT_PER_BYTE * count_bytes
        return False


class Station:
    """Station and the peer to which replies are sent. Two objects of one station on different paths are equal.

    The ids alone do not identify a station, since most use 255 and 190.
    """

    __slots__ = ("_key", "peer", "sender")

    def __init__(self, peer: Peer, sender: Sender) -> None:
        """Store the peer and the MAVLink ids."""
        self.peer = peer
        self.sender = sender
        self._key = (peer.path.station, sender)

    def __eq__(self, other: object) -> bool:
        """Compare the stations."""
        return isinstance(other, Station) and self._key == other._key

    def __hash__(self) -> int:
        """Hash the station."""
        return hash(self._key)


def sender_of(message: Message) -> Sender:
    """Return system and component of the sender of a message."""
    return message.get_srcSystem(), message.get_srcComponent()


def station_of(peer: Peer, message: Message) -> Station:
    """Return the station that sent a message."""
    return Station(peer, sender_of(message))


class Contender(NamedTuple):
    """Active or pending peer that competes for the capacity of a link."""

    key: tuple[int, Hashable]  # index of the transport, address on it
    host: Hashable  # its computer
    is_owner: bool  # whether it counts as the owner of the boat: see `Gate.is_owner`
    frame_s: float  # time of its latest frame


def select_evictions(newcomer: Contender, contenders: Sequence[Contender], now_s: float) -> Sequence[Contender] | None:
    """Return the peers to evict for a newcomer, empty if there is capacity; None if the newcomer is rejected.

    A peer of the owner evicts an unknown one, never the reverse. Among equals a silent peer is evicted, or a peer of a
    host with more peers than the host of the newcomer would have.
    """
    unknown = [contender for contender in contenders if not contender.is_owner]
    if len(contenders) < MAX_ACTIVE_PEERS and (newcomer.is_owner or len(unknown) < MAX_UNKNOWN_PEERS):
        return ()
    if newcomer.is_owner and unknown:
        return (_select_longest_silent(unknown),)
    equals = contenders if newcomer.is_owner else unknown
    if not equals:
        return None
    oldest = min(equals, key=lambda contender: contender.frame_s)
    if now_s - oldest.frame_s > QUIET_S:
        return (oldest,)
    peers_of_host = Counter(contender.host for contender in equals)
    candidate = _select_longest_silent(equals)
    return (candidate,) if peers_of_host[candidate.host] > peers_of_host[newcomer.host] + 1 else None


def select_pending_evictions(pending: Sequence[Contender]) -> Sequence[Contender]:
    """Return the pending peers to evict if there are too many: the oldest of the host with most peers."""
    return (_select_longest_silent(pending),) if len(pending) > MAX_PENDING_PEERS else ()


def _select_longest_silent(contenders: Sequence[Contender]) -> Contender:
    """Return the contender with the oldest frame of the host with most contenders."""
    peers_of_host = Counter(contender.host for contender in contenders)
    return min(contenders, key=lambda contender: (-peers_of_host[contender.host], contender.frame_s))


class PeerObserver(Protocol):
    """Actions of the link when the state of a peer changes."""

    def greet(self, peer: Peer, now_s: float) -> None:
        """Send a new active peer its first messages."""

    def announce(self, peer: Peer) -> None:
        """Queue a heartbeat, and before it the arming checks if the peer may need them."""

    def send_heartbeat(self, peer: Peer) -> None:
        """Queue a heartbeat only."""

    def notify(self, text: str, now_s: float) -> None:
        """Report a rejected or removed peer, or a blocked link, to the stations."""


class Peers:
    """All active and pending peers; bounded.

    Peers in the vehicle file are active from the start. Other peers are pending at first: on a datagram transport after
    the first admitted frame, on a connection when it is open. A pending peer is sent a heartbeat every second (not if
    it must sign) and replies within its credit. It becomes active when it is proven: by a second frame after a reply,
    on a connection by the first frame. A sender with the key and an old timestamp is sent one signed heartbeat, which
    contains the present timestamp, since the boat may have restarted with a fast clock. A sender that replays a frame
    is sent no more than that.
    """

    def __init__(
        self, transports: Sequence[Transport], gate: Gate, sealer: Callable[[int], Sealer], observer: PeerObserver
    ) -> None:
        """Store the transports, the gate, the function that returns the sealer of a transport, and the observer."""
        self._transports = tuple(transports)
        # Determined once, since isinstance with a protocol is slow.
        self._satellites = tuple(each if isinstance(each, Satellite) else None for each in self._transports)
        self._gate = gate
        self._sealer = sealer
        self._observer = observer
        self._late_heartbeats = TokenBucket(MAX_LATE_HEARTBEATS, MAX_LATE_HEARTBEATS_HZ)
        self._active: dict[Key, Peer] = {}
        self._pending: dict[Key, Peer] = {}
        self._paths = PeerPaths()
        self.rejected = 0  # datagrams of unknown senders without a frame, or beyond the capacity
        self._removed_peers_rejected = 0  # damaged frames of removed peers
        self._blocked_since_s: dict[int, float] = {}  # by transport; infinite after the report

    def __iter__(self) -> Iterator[Peer]:
        """Iterate over a copy of the active peers."""
        return iter(tuple(self._active.values()))

    def __len__(self) -> int:
        """Return the number of active peers."""
        return len(self._active)

    def all_peers(self) -> Iterable[Peer]:
        """Return active and pending peers."""
        return (*self._active.values(), *self._pending.values())

    def has(self, index: int, address: Address) -> bool:
        """Return whether there is an active peer with this address."""
        return (index, address) in self._active

    def damaged_frames(self) -> int:
        """Return the number of damaged frames from all peers since start."""
        return self._removed_peers_rejected + sum([peer.splitter.rejected for peer in self.all_peers()])

    def flush(self, now_s: float) -> None:
        """Send the queued frames of all peers."""
        for peer in self.all_peers():
            peer.outbox.flush(now_s)

    def status(self, now_s: float) -> tuple[LinkStatus, ...]:
        """Return the status of each transport with its active and then its pending peers."""
        active = [(key[0], peer.status(now_s, has_place=True)) for key, peer in self._active.items()]
        pending = [(key[0], peer.status(now_s, has_place=False)) for key, peer in self._pending.items()]
        return tuple(
            LinkStatus(
                transport.name,
                link_class_of(transport).value,
                tuple(peer for index, peer in (*active, *pending) if index == number),
                None if satellite is None else satellite.satellite_status(now_s),
                transport.blocked_reason,
            )
            for number, (transport, satellite) in enumerate(zip(self._transports, self._satellites, strict=True))
        )

    # ------------------------------------------------------------------ timeouts

    def update(self, now_s: float) -> None:
        """Add new connections, remove closed and silent peers, send heartbeats to pending peers."""
        permanent: dict[Key, None] = {}
        connected: dict[Key, None] = {}
        for index, transport in enumerate(self._transports):
            for address in transport.addresses():
                permanent[index, address] = None
            for address in transport.connections():
                connected[index, address] = None
        self._report_blocked_links(now_s)
        for key in permanent:
            if key not in self._active:
                self._activate(key, self._new_peer(key, now_s), now_s)
            else:
                self._active[key].reset_radio_after_silence(now_s)
        for key in connected:
            if key not in self._active and key not in self._pending:
                self._set_pending(key, self._new_peer(key, now_s), now_s)
        for key, peer in tuple(self._active.items()):
            if key in permanent:
                continue
            is_datagram, silent_s = peer.transport.is_datagram, now_s - peer.last_frame_s
            if silent_s > FORGET_S or not (is_datagram or key in connected):
                self._remove(key, now_s)
            elif is_datagram and peer.is_proven and not peer.is_verified and silent_s > UNPROVEN_AFTER_S:
                peer.mark_unproven()
        for key, peer in tuple(self._pending.items()):
            is_silent = now_s - peer.last_frame_s > QUIET_S
            if is_silent and key in connected:
                host = peer.transport.host(key[1])
                self._observer.notify(f"{host} on {peer.transport.name} dropped: no valid frame", now_s)
            if is_silent or not (peer.transport.is_datagram or key in connected):
                self._remove(key, now_s)
            else:
                self._announce_if_due(peer, now_s)

    def _report_blocked_links(self, now_s: float) -> None:
        """Report each link that is blocked for BLOCKED_REPORT_S, once until it recovers."""
        for index, transport in enumerate(self._transports):
            if not transport.blocked_reason:
                self._blocked_since_s.pop(index, None)
            elif now_s - self._blocked_since_s.setdefault(index, now_s) >= BLOCKED_REPORT_S:
                self._blocked_since_s[index] = math.inf
                self._observer.notify(f"Link blocked: {transport.name}: {transport.blocked_reason}", now_s)

    def _is_permanent(self, key: Key) -> bool:
        return key[1] in self._transports[key[0]].addresses()

    def _announce_if_due(self, peer: Peer, now_s: float) -> None:
        must_sign = self._gate.unsigned_permission(peer.transport.options) is Permission.NONE
        if not peer.is_satellite and not must_sign and now_s - peer.heartbeat_s >= HEARTBEAT_S:
            peer.heartbeat_s = now_s
            self._observer.announce(peer)

    # ------------------------------------------------------------------ received bytes

    def receive(
        self, index: int, address: Address, data: bytes, now_s: float
    ) -> tuple[Peer, list[AdmittedFrame]] | None:
        """Return the peer that sent these bytes and the frames that they complete.

        Return None if an unknown sender sent no valid frame, or if the peer is rejected.
        """
        key, transport = (index, address), self._transports[index]
        peer = self._active.get(key) or self._pending.get(key)
        splitter = Splitter() if peer is None else peer.splitter
        late_frames = self._gate.late_frames
        frames = splitter.feed(data, now_s)
        # Duplicates are removed before the gate, which would reject a signed duplicate for its timestamp.
        new_frames = frames if peer is None else self._without_duplicates(peer, frames, now_s)
        admitted = self._gate.admit(new_frames, transport.options, line=transport.byte_rate is not None)
        if not admitted and len(new_frames) == len(frames):
            if key not in self._active and self._gate.late_frames > late_frames:
                self._send_timestamp(peer or self._new_peer(key, now_s), now_s)
            if peer is None:
                self.rejected += 1
            return None if peer is None else (peer, admitted)
        if peer is None:
            peer = self._new_peer(key, now_s)
            peer.splitter = splitter  # it may contain the start of a frame
            if self._is_permanent(key):
                self._activate(key, peer, now_s)
            else:
                peer.mark_unproven()
                self._set_pending(key, peer, now_s)
            first = admitted[0]
            self._paths.assign_moved(peer.path, first.frame.data, now_s, is_verified=first.is_verified)
            new_frames = self._without_duplicates(peer, (each.frame for each in admitted), now_s)
            admitted = [each for each in admitted if each.frame in new_frames]
        for each in admitted:
            if each.permission is Permission.COMMANDER:
                self._paths.add(peer.path, each.frame.data, now_s)
        peer.update_version((each.frame for each in admitted), now_s)
        peer.is_verified = peer.is_verified or any(each.is_verified for each in admitted)
        if peer.register_reception(len(data), now_s):
            if not self.has(*key) and not (
                self._replace_moved(key, peer, now_s) or self._activate_if_admitted(key, peer, now_s)
            ):
                self.rejected += 1
                return None
            peer.outbox.credit_bytes = None
        else:
            self._announce_if_due(peer, now_s)
        return peer, admitted

    def _without_duplicates(self, peer: Peer, frames: Iterable[Frame], now_s: float) -> list[Frame]:
        return [frame for frame in frames if not self._paths.is_duplicate(peer.path, frame.data, now_s)]

    def _send_timestamp(self, peer: Peer, now_s: float) -> None:
        """Send a signed heartbeat, whose timestamp a sender with an old timestamp adopts."""
        if self._late_heartbeats.spend_one(now_s):
            self._observer.send_heartbeat(peer)
            peer.outbox.flush(now_s)

    # ------------------------------------------------------------------ capacity

    def _replace_moved(self, key: Key, peer: Peer, now_s: float) -> bool:
        """Replace the former peer of a station behind a NAT whose port has changed; return False without one."""
        for other_key, other in tuple(self._active.items()):
            path = other.path
            is_same = path.station is peer.path.station and path.origin == peer.path.origin
            if is_same and path.latest_s < peer.path.since_s and not self._is_permanent(other_key):
                peer.copy_requests(other)
                self._remove(other_key, now_s)
                self._set_active(key, peer)
                return True
        return False

    def _activate_if_admitted(self, key: Key, peer: Peer, now_s: float) -> bool:
        newcomer = self._contender(key, peer)
        active = [self._contender(*item) for item in self._active.items() if item[0][0] == key[0]]
        evictable = [contender for contender in active if not self._is_permanent(contender.key)]
        evictions = select_evictions(newcomer, evictable, now_s)
        if evictions is None:
            self._observer.notify(f"Station {newcomer.host} refused: {peer.transport.name} is full", now_s)
            return False
        for evicted in evictions:
            self._remove(evicted.key, now_s)
            self._observer.notify(
                f"Station {evicted.host} dropped from {peer.transport.name}: replaced by {newcomer.host}", now_s
            )
        self._activate(key, peer, now_s)
        return True

    def _activate(self, key: Key, peer: Peer, now_s: float) -> None:
        self._set_active(key, peer)
        self._observer.greet(peer, now_s)

    def _set_active(self, key: Key, peer: Peer) -> None:
        self._pending.pop(key, None)
        self._active[key] = peer
        peer.outbox.credit_bytes = None

    def _set_pending(self, key: Key, peer: Peer, now_s: float) -> None:
        self._pending[key] = peer
        pending = [self._contender(*item) for item in self._pending.items() if item[0][0] == key[0]]
        for evicted in select_pending_evictions(pending):
            self._remove(evicted.key, now_s)

    def _remove(self, key: Key, now_s: float) -> None:
        peer = self._pending.pop(key, None) or self._active.pop(key)
        peer.outbox.flush(now_s)
        self._removed_peers_rejected += peer.splitter.rejected
        peer.transport.drop(key[1])

    def _contender(self, key: Key, peer: Peer) -> Contender:
        is_owner = self._gate.is_owner(peer.transport.options, is_verified=peer.is_verified)
        return Contender(key, peer.transport.host(key[1]), is_owner, peer.last_frame_s)

    def _new_peer(self, key: Key, now_s: float) -> Peer:
        return Peer(self._transports[key[0]], key[1], self._sealer(key[0]), now_s)


class DuplicateSystemId:
    """Detection of another vehicle with the system id of the boat: both would execute each command of a station.

    An own frame that a loop in the wiring sends back is not counted.
    """

    def __init__(self, system: int, autopilot: int, utc_s: Callable[[], float], report: Callable[[str], None]) -> None:
        """Store the ids of the boat, its clock, and the function that sends a text to all ground stations."""
        self._system = system
        self._autopilot = autopilot
        self._utc_s = utc_s
        self._report = report
        self._foreign_frames = 0  # in sequence
        self._reported_s = -math.inf

    def check(self, message: Message, now_s: float) -> None:
        """Check a message with the boat's own system and component id."""
        number = type(message).id
        if number == _HEARTBEAT:
            if (message.type, message.autopilot) == (mavlink.MAV_TYPE_SURFACE_BOAT, self._autopilot):
                return  # equal to a heartbeat of the boat itself
        elif number != _SYSTEM_TIME:
            return
        elif self._is_own_time(message, now_s):
            self._foreign_frames = 0
            return
        self._foreign_frames += 1
        if self._foreign_frames >= _MIN_FOREIGN_FRAMES and now_s - self._reported_s >= _DUPLICATE_REPORT_S:
            self._reported_s = now_s
            self._report(f"Duplicate system id {self._system} on the link: change LNK_SYSID")

    def _is_own_time(self, message: Message, now_s: float) -> bool:
        """Return whether the boat may have sent this SYSTEM_TIME recently: both of its clocks match."""
        age_s = ((boot_ms(now_s + _CLOCK_TOLERANCE_S) - message.time_boot_ms) & UINT32_MAX) * 1e-3 - _CLOCK_TOLERANCE_S
        unix_s = message.time_unix_usec * 1e-6
        utc_matches = not unix_s or abs(self._utc_s() - age_s - unix_s) < _CLOCK_TOLERANCE_S
        return age_s <= _MAX_ECHO_AGE_S and utc_matches
