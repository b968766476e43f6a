"""Peers."""

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
from firmware_py.link.wire.outbox import BulkShare, Outbox, Priority, RadioPace, Sealer
from firmware_py.link.wire.transport import Address, Satellite, Transport, usual_class
from firmware_py.link.wire.urls import LinkClass

DUPLICATE_S = 10.0  # a frame that comes by another way does so within this
MIN_IDENTICAL_FRAMES = 3  # so many frames alike make two ways one station's
SPLIT_PENALTY_FRAMES = 10  # and so many more where they were found to be two's
MOVE_TIMEOUT_S = 10.0  # a station that comes by another port goes on within this
MAX_LOST_FRAMES = 16  # its frames that may be lost meanwhile
_SENDERS = 8
_NUMBERS = 256
_MAVLINK2 = 0xFD

# What goes to who may not be where he says he is, in bytes for each that came from there: whoever forges an address
# draws less than ten times of what he spends.
_CREDIT = 8
HEARTBEAT_GAP_S = 3.0  # stations send a heartbeat each second
DENIALS = 20  # answered at once to who has no right to what he asks
DENIALS_HZ = 5.0  # and in the long run

Sender = tuple[int, int]  # MAVLink system and component

MAX_ACTIVE_PEERS = 8  # on one link, beside those whom the vehicle file names
MAX_UNKNOWN_PEERS = 4  # of them, once there is a key to tell strangers by
QUIET_S = 10.0  # one who is silent for this long makes room for a new one
MAX_PENDING_PEERS = 16  # who have not shown yet that they are there; not counted among the places

UNPROVEN_AFTER_S = 10.0  # a datagram peer silent for this long has to prove anew that it is there, unless it signs
FORGET_S = 300.0  # and whoever is silent for this long loses his place
HEARTBEAT_S = 1.0  # between heartbeats to one who waits
BLOCKED_REPORT_S = 10.0  # a link by which nothing has left for this long is told to whom there are others to
LATE_HEARTBEATS = 4  # signed heartbeats at once to strangers whose timestamps are behind
LATE_HEARTBEATS_HZ = 1.0  # and in the long run

Key: TypeAlias = tuple[int, Address]  # index of the transport, and who

_HEARTBEAT, _SYSTEM_TIME = 0, 2
_FOREIGN_FRAMES = 5  # in a row, before a duplicate system id is reported
_CLOCK_TOLERANCE_S = 2.0  # between a clock and the same clock as sent
_ECHO_S = 60.0  # maximum age of an own frame that a loop sends back
_DUPLICATE_REPORT_S = 600.0


class Way:
    """One way to the boat, and the station that comes by it; `place` is the transport and the computer it is of."""

    __slots__ = ("alike", "heard_s", "place", "since_s", "station")

    def __init__(self, place: object, now_s: float) -> None:
        """Begin as the way of a station of its own."""
        self.place = place
        self.since_s = self.heard_s = now_s
        self.station = object()
        self.alike = 0  # frames that another station was heard to send, too


class _Heard(NamedTuple):
    """A frame as it came first."""

    mark: int
    way: Way
    t_s: float
    order: int  # among its sender's frames


class _Sender:
    """The latest frame of each number of one sender."""

    __slots__ = ("by_number", "count", "last_number")

    def __init__(self) -> None:
        self.by_number: dict[int, _Heard] = {}
        self.count = 0
        self.last_number = 0


class PeerPaths:
    """The latest frames of the latest few senders, and by which way each came first; bounded."""

    def __init__(self) -> None:
        """Start with nothing heard."""
        self._senders: OrderedDict[Sender, _Sender] = OrderedDict()

    def is_duplicate(self, way: Way, frame: bytes, now_s: float) -> bool:
        """Return whether a frame has come already by another way of its station; learn whose way this is.

        What comes twice by one way is not judged: each service knows what to do with it.
        """
        sender, number = _address(frame)
        known = self._senders.get(sender)
        before = None if known is None else known.by_number.get(number)
        way.heard_s = now_s
        if before is None or before.way is way or now_s - before.t_s > DUPLICATE_S or before.mark != hash(frame):
            return False
        if before.way.station is way.station:
            return True
        # A program that was started again says what it said before, but not by two ways at once.
        if before.way.heard_s > way.since_s:
            way.alike += 1
            if way.alike >= MIN_IDENTICAL_FRAMES:
                way.station = before.way.station
        return False

    def note(self, way: Way, frame: bytes, now_s: float) -> None:
        """Note a frame that was heard; a number that another frame of the same station bears parts the two ways."""
        sender, number = _address(frame)
        known = self._senders.get(sender) or _Sender()
        mark, before = hash(frame), known.by_number.get(number)
        if before is not None and before.way is not way and now_s - before.t_s <= DUPLICATE_S:
            if before.mark == mark:
                return  # it stays the other way's, which is not known to be the same station's yet
            if before.way.station is way.station and known.count - before.order < _NUMBERS // 2:
                way.station, way.alike = object(), -SPLIT_PENALTY_FRAMES
        known.count += 1
        known.last_number = number
        known.by_number[number] = _Heard(mark, way, now_s, known.count)
        keep_latest(self._senders, sender, known, _SENDERS)

    def follow(self, way: Way, frame: bytes, now_s: float, *, verified: bool) -> None:
        """Take a new way for that of a station whose frames it goes on with: from the same computer, or signed.

        Who begins with 0 is a program that was started just now, such as a script beside the station.
        """
        sender, number = _address(frame)
        known = self._senders.get(sender)
        if known is None or number == 0:
            return
        last = known.by_number[known.last_number]
        goes_on = 1 <= (number - known.last_number) % _NUMBERS <= MAX_LOST_FRAMES
        if goes_on and (verified or last.way.place == way.place) and now_s - last.t_s <= MOVE_TIMEOUT_S:
            way.station = last.way.station


def _address(frame: bytes) -> tuple[Sender, int]:
    """Return who sent a frame, and its number."""
    if frame[0] == _MAVLINK2:
        return (frame[5], frame[6]), frame[4]
    return (frame[3], frame[4]), frame[2]


class Peer:
    """A correspondent: the parser of its bytes, the queue to it, the rates it has asked for.

    One is proven when what is sent to its address is known to arrive: it was answered, and then spoke again, or its
    frames are signed. Until then it gets a few times the bytes that came from there and no more.
    """

    __slots__ = (
        "_radio_pace",
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
        "rest_follows",
        "splitter",
        "streams",
        "transport",
        "verified",
        "version_reported",
        "way",
    )

    def __init__(self, transport: Transport, address: Address, sealer: Sealer, now_s: float) -> None:
        """Start with nothing heard and the rates of the transport's class."""
        self.transport = transport
        self.address = address
        datagrams = transport.datagrams
        self.way = Way((transport, transport.host(address)) if datagrams else (transport, address), now_s)
        self.splitter = Splitter(transport.byte_rate)
        self.outbox = Outbox(lambda data: transport.send(address, data), transport.byte_rate, sealer)
        self.link_class = usual_class(transport)
        self.streams = Streams(self.link_class, now_s)
        self.notices = TextLimiter()
        self.denial_tokens = TokenBucket(DENIALS, DENIALS_HZ)
        self.parameter_list_row: int | None = None  # the next row of the parameter list it gets
        self.parameter_rows_due: dict[int, None] = {}  # rows of the parameter table that it is owed, in order
        self.extended_rows_due: dict[int, None] = {}  # and those by PARAM_EXT
        self.bulk = BulkShare(transport.byte_rate)
        self._radio_pace = RadioPace(transport.byte_rate)
        self._version = VersionDetector()
        self.last_frame_s = now_s  # a valid frame came from it, or it was taken up
        self.heard_s: float | None = None  # its latest valid frame
        self.ground_station_s: float | None = None  # its latest heartbeat of a ground station
        self.heartbeat_s = -math.inf  # it was sent one while it had no place
        self.introduced = False  # it was sent what must come before the heartbeat of an armed boat
        self.version_reported = False  # that it is answered in MAVLink 1
        self.rest_follows = False  # the next bytes are of a datagram of which a part was looked at
        self.verified = False  # it has signed a frame with the boat's key
        self._unanswered_bytes = 0  # sent to it when it was doubted

    @property
    def quiet(self) -> bool:
        """Whether it gets only what it has asked for: a satellite's bytes are paid for one by one."""
        return self.link_class is LinkClass.SATELLITE or self.by_message

    @property
    def by_message(self) -> bool:
        """Whether reports and warnings go there unasked, and each is paid for."""
        return self.link_class is LinkClass.MESSAGES

    @property
    def routes(self) -> bool:
        """Whether what others say to one another passes over its link."""
        route = self.transport.options.route
        if self.link_class is LinkClass.MESSAGES:
            return False
        return self.link_class is LinkClass.FAST if route is None else route

    @property
    def proven(self) -> bool:
        """Whether what is sent to its address is known to arrive there."""
        return self.outbox.credit_bytes is None

    def take_over(self, other: Peer) -> None:
        """Take the place of one that its station has left: what it has asked for is sent here from now on."""
        self.streams, self.introduced, self.ground_station_s = other.streams, other.introduced, other.ground_station_s
        self.parameter_list_row = other.parameter_list_row
        self.parameter_rows_due, self.extended_rows_due = other.parameter_rows_due, other.extended_rows_due

    def status(self, now_s: float, *, has_place: bool) -> PeerStatus:
        """Return how the correspondence with it fares."""
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
        """Return how many frames of a long transfer may be queued now; none to one who may be elsewhere."""
        return self.bulk.frames(frame_bytes, self.outbox.waiting(Priority.REPLY), now_s) if self.proven else 0

    def update_version(self, frames: Iterable[Frame], now_s: float) -> None:
        """Answer in MAVLink 1 who goes on in it though she was there to be heard; by satellite nobody can tell."""
        if self.outbox.sent_bytes and not self.quiet:
            self._version.hear(frames, now_s)
            self.outbox.mavlink1_only = self._version.version1_only

    def keep_pace(self, free_percent: int, now_s: float) -> None:
        """Take how much of its buffer a modem in the line has free."""
        self._radio_pace.hear(free_percent, now_s)
        self._pace(now_s)

    def forget_silent_radio(self, now_s: float) -> None:
        """Send as fast as the line carries again where there is no modem any more."""
        if self._radio_pace.forget(now_s):
            self._pace(now_s)

    def _pace(self, now_s: float) -> None:
        self.outbox.pace(self._radio_pace.share, now_s)
        self.bulk.pace(self._radio_pace.share, now_s)

    def may_need_introduction(self, now_s: float) -> bool:
        """Whether the next heartbeat may be the first one that somebody there sees."""
        return not self.introduced or self.heard_s is None or now_s - self.heard_s > HEARTBEAT_GAP_S

    def mark_unproven(self) -> None:
        """Take it for one who may not be where he says he is."""
        self.outbox.credit_bytes = 0
        self._unanswered_bytes = self.outbox.sent_bytes

    def hear(self, count_bytes: int, now_s: float) -> bool:
        """Note that frames came from it, in so many bytes; return whether that proves it."""
        self.heard_s = self.last_frame_s = now_s
        if self.outbox.credit_bytes is None:
            return True
        answered = self.quiet or self.outbox.sent_bytes > self._unanswered_bytes
        if self.verified or (answered and not self.rest_follows):
            return True
        self.outbox.credit_bytes += _CREDIT * count_bytes
        return False


class Station:
    """A station and the way by which it was heard; equal are those of one station, by whatever way.

    Its numbers alone do not tell a station, since 255 and 190 are everybody's: `ways` says which ways are one's.
    """

    __slots__ = ("_key", "peer", "sender")

    def __init__(self, peer: Peer, sender: Sender) -> None:
        """Take the way, and the numbers."""
        self.peer = peer
        self.sender = sender
        self._key = (peer.way.station, sender)

    def __eq__(self, other: object) -> bool:
        """Compare the stations."""
        return isinstance(other, Station) and self._key == other._key

    def __hash__(self) -> int:
        """Hash the station."""
        return hash(self._key)


def sender_of(message: Message) -> Sender:
    """Return who sent a message."""
    return message.get_srcSystem(), message.get_srcComponent()


def station_of(peer: Peer, message: Message) -> Station:
    """Return who sent a message, and by which way."""
    return Station(peer, sender_of(message))


class Contender(NamedTuple):
    """One who has, or wants, a place."""

    key: tuple[int, Hashable]  # index of the transport, and who
    host: Hashable  # the computer it comes from
    known: bool  # the owner's, as far as can be told
    heard_s: float


def select_evictions(newcomer: Contender, connections: Sequence[Contender], now_s: float) -> Sequence[Contender] | None:
    """Return who has to leave for a newcomer: nobody while there is room; None when there is none for him.

    One of the owner's takes a stranger's place, a stranger never one of the owner's. Among equals the silent one
    leaves, or one of the address that has more places than the newcomer's would.
    """
    strangers = [guest for guest in connections if not guest.known]
    if len(connections) < MAX_ACTIVE_PEERS and (newcomer.known or len(strangers) < MAX_UNKNOWN_PEERS):
        return ()
    if newcomer.known and strangers:
        return (_select_longest_silent(strangers),)
    rivals = connections if newcomer.known else strangers
    if not rivals:
        return None
    silent = min(rivals, key=lambda guest: guest.heard_s)
    if now_s - silent.heard_s > QUIET_S:
        return (silent,)
    places = Counter(guest.host for guest in rivals)
    candidate = _select_longest_silent(rivals)
    return (candidate,) if places[candidate.host] > places[newcomer.host] + 1 else None


def select_pending_evictions(waiting: Sequence[Contender]) -> Sequence[Contender]:
    """Return who has to leave when too many wait: of the address with the most, who has waited longest."""
    return (_select_longest_silent(waiting),) if len(waiting) > MAX_PENDING_PEERS else ()


def _select_longest_silent(connections: Sequence[Contender]) -> Contender:
    places = Counter(guest.host for guest in connections)
    return min(connections, key=lambda guest: (-places[guest.host], guest.heard_s))


class PeerObserver(Protocol):
    """What the link does for its correspondents."""

    def greet(self, peer: Peer, now_s: float) -> None:
        """Tell one who has got a place what it must know."""

    def announce(self, peer: Peer) -> None:
        """Queue what one who waits for a place gets now and then."""

    def send_heartbeat(self, peer: Peer) -> None:
        """Queue a heartbeat, and nothing else, to one without a place."""

    def tell(self, text: str, now_s: float) -> None:
        """Tell the owner what was refused to somebody."""


class Peers:
    """All peers; bounded, and nobody gets on it with noise.

    Whom the vehicle file names is a peer from the start. Anybody else waits at first: on a datagram transport once a
    whole frame of his was admitted, on a connection once it is there. While he waits he gets a heartbeat now and then
    (none where he must sign), and answers within his credit. He gets a place when he has proven that he is there:
    by a second frame in answer, over a connection by the first. One who has the key but an old timestamp (the boat
    was restarted, and is ahead) gets a heartbeat to go by, since nobody's timestamp stays behind what he has heard; so
    does who replays a frame, and that is all he gets.
    """

    def __init__(
        self, transports: Sequence[Transport], gate: Gate, sealer: Callable[[int], Sealer], host: PeerObserver
    ) -> None:
        """Take the transports, who judges their frames, who signs for each, and who speaks to a new peer."""
        self._transports = tuple(transports)
        # Asked once: Python looks each method up, which took a tenth of every status.
        self._satellites = tuple(each if isinstance(each, Satellite) else None for each in self._transports)
        self._gate = gate
        self._sealer = sealer
        self._host = host
        self._late_heartbeats = TokenBucket(LATE_HEARTBEATS, LATE_HEARTBEATS_HZ)
        self._peers: dict[Key, Peer] = {}
        self._pending: dict[Key, Peer] = {}
        self._paths = PeerPaths()
        self.rejected = 0  # datagrams of strangers without a frame, or without room for them
        self._gone_rejected = 0
        self._blocked_since_s: dict[int, float] = {}  # transports by which nothing leaves; infinite when that was told

    def __iter__(self) -> Iterator[Peer]:
        """Go through those who have a place, as they are now."""
        return iter(tuple(self._peers.values()))

    def __len__(self) -> int:
        """Return the number of those who have a place."""
        return len(self._peers)

    def all_peers(self) -> Iterable[Peer]:
        """Go through those who wait, too."""
        return (*self._peers.values(), *self._pending.values())

    def has(self, index: int, address: Address) -> bool:
        """Return whether somebody has a place."""
        return (index, address) in self._peers

    def refused_frames(self) -> int:
        """Return the number of broken frames from all peers since start."""
        return self._gone_rejected + sum([peer.splitter.rejected for peer in self.all_peers()])

    def flush(self, now_s: float) -> None:
        """Hand what waits for anybody to the transports."""
        for peer in self.all_peers():
            peer.outbox.flush(now_s)

    def status(self, now_s: float) -> tuple[LinkStatus, ...]:
        """Return who is on each transport, those who wait for a place last."""
        seated = [(key[0], peer.status(now_s, has_place=True)) for key, peer in self._peers.items()]
        waiting = [(key[0], peer.status(now_s, has_place=False)) for key, peer in self._pending.items()]
        return tuple(
            LinkStatus(
                transport.name,
                usual_class(transport).value,
                tuple(peer for index, peer in (*seated, *waiting) if index == number),
                None if satellite is None else satellite.satellite_status(now_s),
                transport.blocked_reason,
            )
            for number, (transport, satellite) in enumerate(zip(self._transports, self._satellites, strict=True))
        )

    # ------------------------------------------------------------------ as time passes

    def update(self, now_s: float) -> None:
        """Take up who is connected, forget who has gone or says nothing, send heartbeats to those who wait."""
        permanent: dict[Key, None] = {}
        connected: dict[Key, None] = {}
        for index, transport in enumerate(self._transports):
            for address in transport.addresses():
                permanent[index, address] = None
            for address in transport.connections():
                connected[index, address] = None
        self._report_blocked_links(now_s)
        for key in permanent:
            if key not in self._peers:
                self._activate(key, self._new_peer(key, now_s), now_s)
            else:
                self._peers[key].forget_silent_radio(now_s)
        for key in connected:
            if key not in self._peers and key not in self._pending:
                self._wait(key, self._new_peer(key, now_s), now_s)
        for key, peer in tuple(self._peers.items()):
            if key in permanent:
                continue
            datagrams, silent_s = peer.transport.datagrams, now_s - peer.last_frame_s
            if silent_s > FORGET_S or not (datagrams or key in connected):
                self._remove(key, now_s)
            elif datagrams and peer.proven and not peer.verified and silent_s > UNPROVEN_AFTER_S:
                peer.mark_unproven()
        for key, peer in tuple(self._pending.items()):
            silent = now_s - peer.last_frame_s > QUIET_S
            if silent and key in connected:
                host = peer.transport.host(key[1])
                self._host.tell(f"{host} on {peer.transport.name} dropped: no valid frame", now_s)
            if silent or not (peer.transport.datagrams or key in connected):
                self._remove(key, now_s)
            else:
                self._announce_if_due(peer, now_s)

    def _report_blocked_links(self, now_s: float) -> None:
        """Tell those who can be reached that a link has been dumb for a while, once for each time."""
        for index, transport in enumerate(self._transports):
            if not transport.blocked_reason:
                self._blocked_since_s.pop(index, None)
            elif now_s - self._blocked_since_s.setdefault(index, now_s) >= BLOCKED_REPORT_S:
                self._blocked_since_s[index] = math.inf
                self._host.tell(f"Nothing leaves by {transport.name}: {transport.blocked_reason}", now_s)

    def _permanent(self, key: Key) -> bool:
        return key[1] in self._transports[key[0]].addresses()

    def _announce_if_due(self, peer: Peer, now_s: float) -> None:
        silent = peer.quiet or self._gate.unsigned(peer.transport.options) is Permission.NONE
        if not silent and now_s - peer.heartbeat_s >= HEARTBEAT_S:
            peer.heartbeat_s = now_s
            self._host.announce(peer)

    # ------------------------------------------------------------------ as bytes come

    def frames(self, index: int, address: Address, data: bytes, now_s: float) -> tuple[Peer, list[Admitted]] | None:
        """Return the peer that sent these bytes and the frames they complete; None for a stranger's noise."""
        key, transport = (index, address), self._transports[index]
        peer = self._peers.get(key) or self._pending.get(key)
        splitter = Splitter() if peer is None else peer.splitter
        late_before = self._gate.late_frames
        frames = splitter.feed(data, now_s)
        # Before they are judged: the timestamp of a signed one that has come by another way is not new.
        fresh = frames if peer is None else self._fresh(peer, frames, now_s)
        admitted = self._gate.admit(fresh, transport.options, line=transport.byte_rate is not None)
        if not admitted and len(fresh) == len(frames):
            if key not in self._peers and self._gate.late_frames > late_before:
                self._help_stale_timestamp(peer or self._new_peer(key, now_s), now_s)
            if peer is None:
                self.rejected += 1
            return None if peer is None else (peer, admitted)
        if peer is None:
            peer = self._new_peer(key, now_s)
            peer.splitter = splitter  # it may hold the beginning of a frame whose rest follows
            if self._permanent(key):
                self._activate(key, peer, now_s)
            else:
                peer.mark_unproven()
                self._wait(key, peer, now_s)
            first = admitted[0]
            self._paths.follow(peer.way, first.frame.data, now_s, verified=first.verified)
            fresh = self._fresh(peer, (each.frame for each in admitted), now_s)
            admitted = [each for each in admitted if each.frame in fresh]
        for each in admitted:
            if each.standing is Permission.COMMANDER:
                self._paths.note(peer.way, each.frame.data, now_s)
        peer.update_version((each.frame for each in admitted), now_s)
        peer.verified = peer.verified or any(frame.verified for frame in admitted)
        if peer.hear(len(data), now_s):
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
        return [frame for frame in frames if not self._paths.is_duplicate(peer.way, frame.data, now_s)]

    def _help_stale_timestamp(self, peer: Peer, now_s: float) -> None:
        if self._late_heartbeats.spend_one(now_s):
            self._host.send_heartbeat(peer)
            peer.outbox.flush(now_s)

    # ------------------------------------------------------------------ places

    def _take_over(self, key: Key, peer: Peer, now_s: float) -> bool:
        """Give a station that a NAT has moved to another port the place that it has left; False if it has none."""
        for other_key, other in tuple(self._peers.items()):
            way = other.way
            same = way.station is peer.way.station and way.place == peer.way.place
            if same and way.heard_s < peer.way.since_s and not self._permanent(other_key):
                peer.take_over(other)
                self._remove(other_key, now_s)
                self._set_active(key, peer)
                return True
        return False

    def _activate_if_admitted(self, key: Key, peer: Peer, now_s: float) -> bool:
        newcomer = self._contender(key, peer)
        seated = [self._contender(*item) for item in self._peers.items() if item[0][0] == key[0]]
        leaving = select_evictions(newcomer, [guest for guest in seated if not self._permanent(guest.key)], now_s)
        if leaving is None:
            self._host.tell(f"No place for {newcomer.host} on {peer.transport.name}", now_s)
            return False
        for guest in leaving:
            self._remove(guest.key, now_s)
            self._host.tell(f"Place of {guest.host} on {peer.transport.name} given to {newcomer.host}", now_s)
        self._activate(key, peer, now_s)
        return True

    def _activate(self, key: Key, peer: Peer, now_s: float) -> None:
        self._set_active(key, peer)
        self._host.greet(peer, now_s)

    def _set_active(self, key: Key, peer: Peer) -> None:
        self._pending.pop(key, None)
        self._peers[key] = peer
        peer.outbox.credit_bytes = None

    def _wait(self, key: Key, peer: Peer, now_s: float) -> None:
        self._pending[key] = peer
        queue = [self._contender(*item) for item in self._pending.items() if item[0][0] == key[0]]
        for guest in select_pending_evictions(queue):
            self._remove(guest.key, now_s)

    def _remove(self, key: Key, now_s: float) -> None:
        peer = self._pending.pop(key, None) or self._peers.pop(key)
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
            self._report(f"Another vehicle is system {self._system}, too: give one of them another LNK_SYSID")

    def _is_own_time(self, message: Message, now_s: float) -> bool:
        """Whether this boat may have sent a SYSTEM_TIME lately: both of its clocks match."""
        age_s = ((boot_ms(now_s + _CLOCK_TOLERANCE_S) - message.time_boot_ms) & UINT32_MAX) * 1e-3 - _CLOCK_TOLERANCE_S
        unix_s = message.time_unix_usec * 1e-6
        matches = not unix_s or abs(self._utc_s() - age_s - unix_s) < _CLOCK_TOLERANCE_S
        return age_s <= _ECHO_S and matches
