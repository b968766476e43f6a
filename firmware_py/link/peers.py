"""Peers of the link: identity of stations, capacity of links, paths and duplicate frames, duplicate system ids.

A peer is one address on one transport. It is pending until it has proven that it receives what is sent to it, then
active. A station may use several peers: a router sends each frame over all links that lead to the boat, and a NAT
changes the port of a station in the middle of a transfer. `PeerPaths` finds that two paths belong to one station, so
that a service continues on one path what began on the other, and a frame counts once.

Only ids and frame counters identify a station, and two stations may have the same ids. Two paths belong to one station
after several frames that are identical to the byte, and to two stations after two different frames with one number.
"""

from __future__ import annotations

import math
from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from typing import NamedTuple, Protocol, TypeAlias

from firmware_py.common.link_status import LinkStatus, PeerStatus
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.access import Admitted, Gate, Permission
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
MIN_IDENTICAL_FRAMES = 3  # before two paths are taken for one station's
SPLIT_PENALTY_FRAMES = 10  # additional ones after the paths were found to be those of two stations
MOVE_TIMEOUT_S = 10.0  # maximum silence of a station that changes its port
MAX_LOST_FRAMES = 16  # meanwhile
_SENDERS = 8
_NUMBERS = 256
_MAVLINK2 = 0xFD

# Bytes that may be sent to an unproven address for each byte received from it: a forged address draws less than ten
# times the bytes that were spent on it.
_CREDIT = 8
HEARTBEAT_GAP_S = 3.0  # stations send a heartbeat every second
DENIALS = 20  # replies to refused requests in a burst
DENIALS_HZ = 5.0  # and on average

Sender = tuple[int, int]  # MAVLink system and component

MAX_ACTIVE_PEERS = 8  # on one link, beside those that the vehicle file names
MAX_UNKNOWN_PEERS = 4  # of them, if a signing key is set
QUIET_S = 10.0  # a peer that is silent for longer may be evicted
MAX_PENDING_PEERS = 16  # in addition

UNPROVEN_AFTER_S = 10.0  # of silence: a datagram peer must prove its address again, unless it signs
FORGET_S = 300.0  # of silence: the peer is removed
HEARTBEAT_S = 1.0  # between heartbeats to a pending peer
BLOCKED_REPORT_S = 10.0  # a link that is blocked for longer is reported over the other links
LATE_HEARTBEATS = 4  # signed heartbeats in a burst to unknown senders with old timestamps
LATE_HEARTBEATS_HZ = 1.0  # and on average

Key: TypeAlias = tuple[int, Address]  # index of the transport, address on it

_HEARTBEAT, _SYSTEM_TIME = 0, 2
_FOREIGN_FRAMES = 5  # in a row, before a duplicate system id is reported
_CLOCK_TOLERANCE_S = 2.0  # between a clock and the same clock as sent
_ECHO_S = 60.0  # maximum age of an own frame that a loop sends back
_DUPLICATE_REPORT_S = 600.0


class PeerPath:
    """One path to the boat, and the station at its end; `origin` is the transport and the station's computer."""

    __slots__ = ("heard_s", "identical_frames", "origin", "since_s", "station")

    def __init__(self, origin: object, now_s: float) -> None:
        """Start as the path of a new station."""
        self.origin = origin
        self.since_s = self.heard_s = now_s
        self.station = object()
        self.identical_frames = 0  # to those of another path


class _FirstCopy(NamedTuple):
    """The first copy of a frame."""

    mark: int
    path: PeerPath
    t_s: float
    order: int  # among its sender's frames


class _Sender:
    """The latest frame of each number of one sender."""

    __slots__ = ("by_number", "count", "last_number")

    def __init__(self) -> None:
        self.by_number: dict[int, _FirstCopy] = {}
        self.count = 0
        self.last_number = 0


class PeerPaths:
    """The latest frames of the latest senders, and the path on which each came first; bounded."""

    def __init__(self) -> None:
        """Start without frames."""
        self._senders: OrderedDict[Sender, _Sender] = OrderedDict()

    def is_duplicate(self, path: PeerPath, frame: bytes, now_s: float) -> bool:
        """Return whether a frame has come already on another path of its station; learn whose path this is.

        A frame that comes twice on one path is left to the services.
        """
        sender, number = _address(frame)
        known = self._senders.get(sender)
        before = None if known is None else known.by_number.get(number)
        path.heard_s = now_s
        if before is None or before.path is path or now_s - before.t_s > DUPLICATE_S or before.mark != hash(frame):
            return False
        if before.path.station is path.station:
            return True
        # A program that was restarted repeats its frames, but not on two paths at once.
        if before.path.heard_s > path.since_s:
            path.identical_frames += 1
            if path.identical_frames >= MIN_IDENTICAL_FRAMES:
                path.station = before.path.station
        return False

    def note(self, path: PeerPath, frame: bytes, now_s: float) -> None:
        """Store a frame. If the same station has sent another frame with its number, the two paths are separated."""
        sender, number = _address(frame)
        known = self._senders.get(sender) or _Sender()
        mark, before = hash(frame), known.by_number.get(number)
        if before is not None and before.path is not path and now_s - before.t_s <= DUPLICATE_S:
            if before.mark == mark:
                return  # it belongs to the other path, which is not known to be the same station's yet
            if before.path.station is path.station and known.count - before.order < _NUMBERS // 2:
                path.station, path.identical_frames = object(), -SPLIT_PENALTY_FRAMES
        known.count += 1
        known.last_number = number
        known.by_number[number] = _FirstCopy(mark, path, now_s, known.count)
        keep_latest(self._senders, sender, known, _SENDERS)

    def follow(self, path: PeerPath, frame: bytes, now_s: float, *, verified: bool) -> None:
        """Assign a new path to the station whose frame numbers it continues, from the same computer or signed.

        Number 0 is that of a program that was started just now, such as a script beside the station.
        """
        sender, number = _address(frame)
        known = self._senders.get(sender)
        if known is None or number == 0:
            return
        last = known.by_number[known.last_number]
        goes_on = 1 <= (number - known.last_number) % _NUMBERS <= MAX_LOST_FRAMES
        if goes_on and (verified or last.path.origin == path.origin) and now_s - last.t_s <= MOVE_TIMEOUT_S:
            path.station = last.path.station


def _address(frame: bytes) -> tuple[Sender, int]:
    """Return the sender and the number of a frame."""
    if frame[0] == _MAVLINK2:
        return (frame[5], frame[6]), frame[4]
    return (frame[3], frame[4]), frame[2]


class Peer:
    """A peer: the parser of its bytes, the queue to it, the rates that it has requested.

    It is proven when frames that are sent to its address are known to arrive: it has sent again after a reply, or its
    frames are signed. Until then it gets at most a few times the bytes that came from its address.
    """

    __slots__ = (
        "_radio_rate",
        "_unanswered_bytes",
        "_version",
        "address",
        "bulk",
        "denial_tokens",
        "extended_rows_due",
        "ground_station_s",
        "heard_s",
        "heartbeat_s",
        "introduced",
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
        "verified",
        "version_reported",
    )

    def __init__(self, transport: Transport, address: Address, sealer: Sealer, now_s: float) -> None:
        """Start with the rates of the transport's class."""
        self.transport = transport
        self.address = address
        is_datagram = transport.is_datagram
        self.path = PeerPath((transport, transport.host(address)) if is_datagram else (transport, address), now_s)
        self.splitter = Splitter(transport.byte_rate)
        self.outbox = Outbox(lambda data: transport.send(address, data), transport.byte_rate, sealer)
        self.link_class = link_class_of(transport)
        self.streams = Streams(self.link_class, now_s)
        self.notices = TextLimiter()
        self.denial_tokens = TokenBucket(DENIALS, DENIALS_HZ)
        self.parameter_list_row: int | None = None  # the next row of the parameter list it gets
        self.parameter_rows_due: dict[int, None] = {}  # rows of the parameter table to be sent, in order
        self.extended_rows_due: dict[int, None] = {}  # and those to be sent as PARAM_EXT
        self.bulk = BulkShare(transport.byte_rate)
        self._radio_rate = RadioRate(transport.byte_rate)
        self._version = VersionDetector()
        self.last_frame_s = now_s  # time of the latest valid frame, or of the start
        self.heard_s: float | None = None  # its latest valid frame
        self.ground_station_s: float | None = None  # its latest heartbeat of a ground station
        self.heartbeat_s = -math.inf  # of the latest one that was sent while it was pending
        self.introduced = False  # the arming checks were sent before the first heartbeat
        self.version_reported = False  # the notice that it is answered in MAVLink 1 was sent
        self.rest_follows = False  # the rest of the datagram is still in the receive queue
        self.verified = False  # it has signed a frame with the boat's key
        self._unanswered_bytes = 0  # sent before it became unproven

    @property
    def quiet(self) -> bool:
        """Whether it gets only what it has requested: every byte over a satellite is paid for."""
        return self.link_class is LinkClass.SATELLITE or self.by_message

    @property
    def by_message(self) -> bool:
        """Whether it gets reports and warnings as single messages, each of which is paid for."""
        return self.link_class is LinkClass.MESSAGES

    @property
    def routes(self) -> bool:
        """Whether messages between other systems are routed over its link."""
        route = self.transport.options.route
        if self.link_class is LinkClass.MESSAGES:
            return False
        return self.link_class is LinkClass.FAST if route is None else route

    @property
    def proven(self) -> bool:
        """Whether frames that are sent to its address are known to arrive."""
        return self.outbox.credit_bytes is None

    def take_over(self, other: Peer) -> None:
        """Replace another peer of the same station: its requests are served here from now on."""
        self.streams, self.introduced, self.ground_station_s = other.streams, other.introduced, other.ground_station_s
        self.parameter_list_row = other.parameter_list_row
        self.parameter_rows_due, self.extended_rows_due = other.parameter_rows_due, other.extended_rows_due

    def status(self, now_s: float, *, has_place: bool) -> PeerStatus:
        """Return the status of the peer for reports."""
        host = self.transport.host(self.address)
        where = ":".join(map(str, self.address)) if isinstance(self.address, tuple) else str(host)
        return PeerStatus(
            address=where if isinstance(host, str) else self.transport.name,
            ground_station=self.ground_station_s is not None,
            has_place=has_place,
            signs=self.verified,
            heard_age_s=None if self.heard_s is None else now_s - self.heard_s,
            sent_bytes=self.outbox.sent_bytes,
            dropped=self.outbox.dropped,
            rejected=self.splitter.rejected,
        )

    def bulk_frames(self, frame_bytes: int, now_s: float) -> int:
        """Return the number of frames of a long transfer that may be queued now; 0 for an unproven peer."""
        return self.bulk.max_frames(frame_bytes, self.outbox.queued_count(Priority.REPLY), now_s) if self.proven else 0

    def update_version(self, frames: Iterable[Frame], now_s: float) -> None:
        """Answer in MAVLink 1 if the peer continues to use it; not by satellite, where the cause is not known."""
        if self.outbox.sent_bytes and not self.quiet:
            self._version.update(frames, now_s)
            self.outbox.is_mavlink1_only = self._version.is_mavlink1_only

    def keep_pace(self, free_percent: int, now_s: float) -> None:
        """Adapt the rate to the free buffer of a modem in the line."""
        self._radio_rate.update(free_percent, now_s)
        self._pace(now_s)

    def forget_silent_radio(self, now_s: float) -> None:
        """Return to the full rate of the line if its modem reports no more."""
        if self._radio_rate.reset_after_silence(now_s):
            self._pace(now_s)

    def _pace(self, now_s: float) -> None:
        self.outbox.set_rate_share(self._radio_rate.share, now_s)
        self.bulk.set_rate_share(self._radio_rate.share, now_s)

    def may_need_introduction(self, now_s: float) -> bool:
        """Whether the next heartbeat may be the first one that a program there receives."""
        return not self.introduced or self.heard_s is None or now_s - self.heard_s > HEARTBEAT_GAP_S

    def mark_unproven(self) -> None:
        """Limit what is sent until the address is proven again."""
        self.outbox.credit_bytes = 0
        self._unanswered_bytes = self.outbox.sent_bytes

    def note_reception(self, count_bytes: int, now_s: float) -> bool:
        """Note the reception of frames with this number of bytes; return whether the peer is proven."""
        self.heard_s = self.last_frame_s = now_s
        if self.outbox.credit_bytes is None:
            return True
        answered = self.quiet or self.outbox.sent_bytes > self._unanswered_bytes
        if self.verified or (answered and not self.rest_follows):
            return True
        self.outbox.credit_bytes += _CREDIT * count_bytes
        return False


class Station:
    """A station and the peer through which it is answered; equal for one station on all of its paths.

    The ids alone do not identify a station, since most use 255 and 190.
    """

    __slots__ = ("_key", "peer", "sender")

    def __init__(self, peer: Peer, sender: Sender) -> None:
        """Take the peer and the MAVLink ids."""
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
    """Return the station that sent a message, with the peer through which it came."""
    return Station(peer, sender_of(message))


class Contender(NamedTuple):
    """An active or pending peer in the competition for capacity."""

    key: tuple[int, Hashable]  # index of the transport, address on it
    host: Hashable  # its computer
    known: bool  # it belongs to the owner, as far as that can be verified
    heard_s: float


def select_evictions(newcomer: Contender, contenders: Sequence[Contender], now_s: float) -> Sequence[Contender] | None:
    """Return the peers to evict for a newcomer: none while there is capacity; None if the newcomer is rejected.

    A known peer evicts an unknown one, never the reverse. Among equals a silent one is evicted, or one of the host that
    has more peers than the newcomer's host would have.
    """
    unknown = [contender for contender in contenders if not contender.known]
    if len(contenders) < MAX_ACTIVE_PEERS and (newcomer.known or len(unknown) < MAX_UNKNOWN_PEERS):
        return ()
    if newcomer.known and unknown:
        return (_select_longest_silent(unknown),)
    rivals = contenders if newcomer.known else unknown
    if not rivals:
        return None
    silent = min(rivals, key=lambda contender: contender.heard_s)
    if now_s - silent.heard_s > QUIET_S:
        return (silent,)
    peers_of_host = Counter(contender.host for contender in rivals)
    candidate = _select_longest_silent(rivals)
    return (candidate,) if peers_of_host[candidate.host] > peers_of_host[newcomer.host] + 1 else None


def select_pending_evictions(pending: Sequence[Contender]) -> Sequence[Contender]:
    """Return the pending peers to evict if there are too many: the oldest of the host with the most."""
    return (_select_longest_silent(pending),) if len(pending) > MAX_PENDING_PEERS else ()


def _select_longest_silent(contenders: Sequence[Contender]) -> Contender:
    peers_of_host = Counter(contender.host for contender in contenders)
    return min(contenders, key=lambda contender: (-peers_of_host[contender.host], contender.heard_s))


class PeerObserver(Protocol):
    """Actions of the link when the state of a peer changes."""

    def greet(self, peer: Peer, now_s: float) -> None:
        """Send a new active peer its first messages."""

    def announce(self, peer: Peer) -> None:
        """Queue the periodic messages to a pending peer."""

    def send_heartbeat(self, peer: Peer) -> None:
        """Queue a heartbeat, and nothing else."""

    def notify(self, text: str, now_s: float) -> None:
        """Report a rejected peer to the stations."""


class Peers:
    """All active and pending peers; bounded.

    Peers that the vehicle file names are active from the start. Any other is pending first: on a datagram transport
    after its first admitted frame, on a connection as soon as it is open. A pending peer gets a heartbeat every second
    (none where it must sign) and replies within its credit. It becomes active when it is proven: by a second frame
    after a reply, on a connection by the first frame. A sender with the key and an old timestamp (after a
    restart of the boat its own clock may be ahead) gets one signed heartbeat, from which it learns the timestamp; a
    sender that replays a frame gets no more than that.
    """

    def __init__(
        self, transports: Sequence[Transport], gate: Gate, sealer: Callable[[int], Sealer], observer: PeerObserver
    ) -> None:
        """Take the transports, the gate that judges frames, the signer of each transport, and the observer."""
        self._transports = tuple(transports)
        # Checked once: isinstance of a protocol took a tenth of every status.
        self._satellites = tuple(each if isinstance(each, Satellite) else None for each in self._transports)
        self._gate = gate
        self._sealer = sealer
        self._observer = observer
        self._late_heartbeats = TokenBucket(LATE_HEARTBEATS, LATE_HEARTBEATS_HZ)
        self._active: dict[Key, Peer] = {}
        self._pending: dict[Key, Peer] = {}
        self._paths = PeerPaths()
        self.rejected = 0  # datagrams of unknown senders without a frame, or beyond the capacity
        self._gone_rejected = 0
        self._blocked_since_s: dict[int, float] = {}  # by transport; infinite once it was reported

    def __iter__(self) -> Iterator[Peer]:
        """Iterate over the active peers of this moment."""
        return iter(tuple(self._active.values()))

    def __len__(self) -> int:
        """Return the number of active peers."""
        return len(self._active)

    def all_peers(self) -> Iterable[Peer]:
        """Return active and pending peers."""
        return (*self._active.values(), *self._pending.values())

    def has(self, index: int, address: Address) -> bool:
        """Return whether an address is that of an active peer."""
        return (index, address) in self._active

    def refused_frames(self) -> int:
        """Return the number of broken frames from all peers since start."""
        return self._gone_rejected + sum([peer.splitter.rejected for peer in self.all_peers()])

    def flush(self, now_s: float) -> None:
        """Hand all queued frames to the transports."""
        for peer in self.all_peers():
            peer.outbox.flush(now_s)

    def status(self, now_s: float) -> tuple[LinkStatus, ...]:
        """Return the status of each transport with its peers, pending ones last."""
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
        """Add new connections, remove closed and silent peers, send heartbeats to pending ones."""
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
                self._active[key].forget_silent_radio(now_s)
        for key in connected:
            if key not in self._active and key not in self._pending:
                self._set_pending(key, self._new_peer(key, now_s), now_s)
        for key, peer in tuple(self._active.items()):
            if key in permanent:
                continue
            is_datagram, silent_s = peer.transport.is_datagram, now_s - peer.last_frame_s
            if silent_s > FORGET_S or not (is_datagram or key in connected):
                self._remove(key, now_s)
            elif is_datagram and peer.proven and not peer.verified and silent_s > UNPROVEN_AFTER_S:
                peer.mark_unproven()
        for key, peer in tuple(self._pending.items()):
            silent = now_s - peer.last_frame_s > QUIET_S
            if silent and key in connected:
                host = peer.transport.host(key[1])
                self._observer.notify(f"{host} on {peer.transport.name} dropped: no valid frame", now_s)
            if silent or not (peer.transport.is_datagram or key in connected):
                self._remove(key, now_s)
            else:
                self._announce_if_due(peer, now_s)

    def _report_blocked_links(self, now_s: float) -> None:
        """Report each link that stays blocked, once each time."""
        for index, transport in enumerate(self._transports):
            if not transport.blocked_reason:
                self._blocked_since_s.pop(index, None)
            elif now_s - self._blocked_since_s.setdefault(index, now_s) >= BLOCKED_REPORT_S:
                self._blocked_since_s[index] = math.inf
                self._observer.notify(f"Link blocked: {transport.name}: {transport.blocked_reason}", now_s)

    def _permanent(self, key: Key) -> bool:
        return key[1] in self._transports[key[0]].addresses()

    def _announce_if_due(self, peer: Peer, now_s: float) -> None:
        silent = peer.quiet or self._gate.unsigned(peer.transport.options) is Permission.NONE
        if not silent and now_s - peer.heartbeat_s >= HEARTBEAT_S:
            peer.heartbeat_s = now_s
            self._observer.announce(peer)

    # ------------------------------------------------------------------ received bytes

    def frames(self, index: int, address: Address, data: bytes, now_s: float) -> tuple[Peer, list[Admitted]] | None:
        """Return the peer that sent these bytes and the frames they complete; None for noise of an unknown sender."""
        key, transport = (index, address), self._transports[index]
        peer = self._active.get(key) or self._pending.get(key)
        splitter = Splitter() if peer is None else peer.splitter
        late_before = self._gate.late_frames
        frames = splitter.feed(data, now_s)
        # Before the gate: a signed frame that has come on another path fails there for its timestamp.
        fresh = frames if peer is None else self._fresh(peer, frames, now_s)
        admitted = self._gate.admit(fresh, transport.options, line=transport.byte_rate is not None)
        if not admitted and len(fresh) == len(frames):
            if key not in self._active and self._gate.late_frames > late_before:
                self._help_stale_timestamp(peer or self._new_peer(key, now_s), now_s)
            if peer is None:
                self.rejected += 1
            return None if peer is None else (peer, admitted)
        if peer is None:
            peer = self._new_peer(key, now_s)
            peer.splitter = splitter  # it may hold the first part of a frame
            if self._permanent(key):
                self._activate(key, peer, now_s)
            else:
                peer.mark_unproven()
                self._set_pending(key, peer, now_s)
            first = admitted[0]
            self._paths.follow(peer.path, first.frame.data, now_s, verified=first.verified)
            fresh = self._fresh(peer, (each.frame for each in admitted), now_s)
            admitted = [each for each in admitted if each.frame in fresh]
        for each in admitted:
            if each.permission is Permission.COMMANDER:
                self._paths.note(peer.path, each.frame.data, now_s)
        peer.update_version((each.frame for each in admitted), now_s)
        peer.verified = peer.verified or any(frame.verified for frame in admitted)
        if peer.note_reception(len(data), now_s):
            if not self.has(*key) and not (
                self._take_over(key, peer, now_s) or self._activate_if_admitted(key, peer, now_s)
            ):
                self.rejected += 1
                return None
            peer.outbox.credit_bytes = None
        else:
            self._announce_if_due(peer, now_s)
        return peer, admitted

    def _fresh(self, peer: Peer, frames: Iterable[Frame], now_s: float) -> list[Frame]:
        return [frame for frame in frames if not self._paths.is_duplicate(peer.path, frame.data, now_s)]

    def _help_stale_timestamp(self, peer: Peer, now_s: float) -> None:
        if self._late_heartbeats.spend_one(now_s):
            self._observer.send_heartbeat(peer)
            peer.outbox.flush(now_s)

    # ------------------------------------------------------------------ capacity

    def _take_over(self, key: Key, peer: Peer, now_s: float) -> bool:
        """Replace the peer of a station whose port has changed behind a NAT; False if there is none."""
        for other_key, other in tuple(self._active.items()):
            path = other.path
            same = path.station is peer.path.station and path.origin == peer.path.origin
            if same and path.heard_s < peer.path.since_s and not self._permanent(other_key):
                peer.take_over(other)
                self._remove(other_key, now_s)
                self._set_active(key, peer)
                return True
        return False

    def _activate_if_admitted(self, key: Key, peer: Peer, now_s: float) -> bool:
        newcomer = self._contender(key, peer)
        active = [self._contender(*item) for item in self._active.items() if item[0][0] == key[0]]
        leaving = select_evictions(newcomer, [evicted for evicted in active if not self._permanent(evicted.key)], now_s)
        if leaving is None:
            self._observer.notify(f"Station {newcomer.host} refused: {peer.transport.name} is full", now_s)
            return False
        for evicted in leaving:
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
        queue = [self._contender(*item) for item in self._pending.items() if item[0][0] == key[0]]
        for evicted in select_pending_evictions(queue):
            self._remove(evicted.key, now_s)

    def _remove(self, key: Key, now_s: float) -> None:
        peer = self._pending.pop(key, None) or self._active.pop(key)
        peer.outbox.flush(now_s)
        self._gone_rejected += peer.splitter.rejected
        peer.transport.drop(key[1])

    def _contender(self, key: Key, peer: Peer) -> Contender:
        known = self._gate.knows(peer.transport.options, verified=peer.verified)
        return Contender(key, peer.transport.host(key[1]), known, peer.last_frame_s)

    def _new_peer(self, key: Key, now_s: float) -> Peer:
        return Peer(self._transports[key[0]], key[1], self._sealer(key[0]), now_s)


class DuplicateSystemId:
    """Detects another vehicle with the boat's own system id: both would obey every order of a station.

    A frame of the boat's own that a loop in the wiring sends back is no sign of one.
    """

    def __init__(self, system: int, autopilot: int, utc_s: Callable[[], float], report: Callable[[str], None]) -> None:
        """Take the ids that the boat sends, its clock, and what reports a text to all ground stations."""
        self._system = system
        self._autopilot = autopilot
        self._utc_s = utc_s
        self._report = report
        self._foreign_frames = 0  # in a row
        self._reported_s = -math.inf

    def check(self, message: Message, now_s: float) -> None:
        """Check a message with the boat's own system and component id."""
        number = type(message).id
        if number == _HEARTBEAT:
            if (message.type, message.autopilot) == (mavlink.MAV_TYPE_SURFACE_BOAT, self._autopilot):
                return  # may be either boat's
        elif number != _SYSTEM_TIME:
            return
        elif self._is_own_time(message, now_s):
            self._foreign_frames = 0
            return
        self._foreign_frames += 1
        if self._foreign_frames >= _FOREIGN_FRAMES and now_s - self._reported_s >= _DUPLICATE_REPORT_S:
            self._reported_s = now_s
            self._report(f"Duplicate system id {self._system} on the link: change LNK_SYSID")

    def _is_own_time(self, message: Message, now_s: float) -> bool:
        """Whether this boat may have sent a SYSTEM_TIME lately: both of its clocks match."""
        age_s = ((boot_ms(now_s + _CLOCK_TOLERANCE_S) - message.time_boot_ms) & UINT32_MAX) * 1e-3 - _CLOCK_TOLERANCE_S
        unix_s = message.time_unix_usec * 1e-6
        matches = not unix_s or abs(self._utc_s() - age_s - unix_s) < _CLOCK_TOLERANCE_S
        return age_s <= _ECHO_S and matches
