"""One correspondent on one transport, and all of them together."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from firmware_py.link.security.access import Admitted, Gate
from firmware_py.link.telemetry.statustext import TextLimiter
from firmware_py.link.telemetry.streams import Streams
from firmware_py.link.wire.bulk import BulkShare
from firmware_py.link.wire.framing import Splitter
from firmware_py.link.wire.outbox import Outbox, Sealer
from firmware_py.link.wire.token_bucket import TokenBucket
from firmware_py.link.wire.transport import Address, Transport
from firmware_py.link.wire.url_options import LinkClass

MAX_PEERS = 8  # that have spoken on a datagram transport
QUIET_S = 10.0  # a datagram peer silent for this long makes room for a new one
FORGET_S = 300.0  # and silent for this long it is forgotten in any case
DENIALS = 20  # answered at once to who has no right to what he asks
DENIALS_HZ = 5.0  # and in the long run
LATE_HEARTBEATS = 4  # signed heartbeats at once to strangers whose timestamps are behind
LATE_HEARTBEATS_HZ = 1.0  # and in the long run


class Peer:
    """A correspondent: the parser of its bytes, the queue to it, the rates it has asked for."""

    __slots__ = (
        "address",
        "bulk",
        "denial_tokens",
        "ground_station_s",
        "last_frame_s",
        "link_class",
        "notices",
        "outbox",
        "parameter_list_row",
        "parameter_rows_due",
        "splitter",
        "streams",
        "transport",
    )

    def __init__(self, transport: Transport, address: Address, sealer: Sealer, now_s: float) -> None:
        """Start with nothing heard and the rates of the transport's class."""
        self.transport = transport
        self.address = address
        self.splitter = Splitter(transport.byte_rate)
        self.outbox = Outbox(lambda data: transport.send(address, data), transport.byte_rate, sealer)
        usual = LinkClass.RADIO if transport.radio else LinkClass.FAST
        self.link_class = transport.options.link_class or usual
        self.streams = Streams(self.link_class, now_s)
        self.notices = TextLimiter()
        self.denial_tokens = TokenBucket(DENIALS, DENIALS_HZ)
        self.parameter_list_row: int | None = None  # the next row of the parameter list it gets
        self.parameter_rows_due: dict[int, None] = {}  # rows of the parameter table that it is owed, in order
        self.bulk = BulkShare(transport.byte_rate)
        self.last_frame_s = now_s  # a valid frame came from it, or it was taken up
        self.ground_station_s: float | None = None  # its latest heartbeat of a ground station

    @property
    def quiet(self) -> bool:
        """Whether it gets only what it has asked for: a satellite's bytes are paid for one by one."""
        return self.link_class is LinkClass.SATELLITE


class Peers:
    """All peers; bounded, and nobody gets on it with noise.

    A stranger on a datagram transport is taken up with its first whole frame that the
    gate admits, so that a stray or forged packet does not draw telemetry. One who has the
    key but an old timestamp (the boat was restarted, and is ahead) gets a heartbeat to go by,
    since nobody's timestamp stays behind what he has heard; so does who replays a frame,
    and that is all he gets.
    """

    def __init__(
        self,
        transports: Sequence[Transport],
        gate: Gate,
        sealer: Callable[[int], Sealer],
        greet: Callable[[Peer, float], None],
        send_heartbeat: Callable[[Peer, float], None],
    ) -> None:
        """Take the transports, who judges their frames, who signs for each, what is to be done with a new peer.

        `send_heartbeat` sends a heartbeat to one that is not taken up.
        """
        self._send_heartbeat = send_heartbeat
        self._late_heartbeats = TokenBucket(LATE_HEARTBEATS, LATE_HEARTBEATS_HZ)
        self._gate = gate
        self._sealer = sealer
        self._transports = tuple(transports)
        self._greet = greet
        self._peers: dict[tuple[int, Address], Peer] = {}  # by index of the transport and address
        self.rejected = 0  # datagrams of strangers without a frame, or without room for them
        self._gone_rejected = 0

    def __iter__(self) -> Iterator[Peer]:
        """Go through the peers as they are now."""
        return iter(tuple(self._peers.values()))

    def __len__(self) -> int:
        """Return the number of peers."""
        return len(self._peers)

    def has(self, index: int, address: Address) -> bool:
        """Return whether somebody is a peer."""
        return (index, address) in self._peers

    def refused_frames(self) -> int:
        """Return the number of broken frames from all peers since start."""
        return self._gone_rejected + sum(peer.splitter.rejected for peer in self._peers.values())

    def update(self, now_s: float) -> None:
        """Take up who is connected, forget who has gone."""
        for index, transport in enumerate(self._transports):
            for address in transport.addresses():
                if (index, address) not in self._peers:
                    self._add(index, address, now_s)
        for key, peer in tuple(self._peers.items()):
            permanent = key[1] in peer.transport.addresses()
            if not permanent and (not peer.transport.datagrams or now_s - peer.last_frame_s > FORGET_S):
                self._remove(key)

    def frames(self, index: int, address: Address, data: bytes, now_s: float) -> tuple[Peer, list[Admitted]] | None:
        """Return the peer that sent these bytes and the frames they complete; None for a stranger's noise."""
        options = self._transports[index].options
        peer = self._peers.get((index, address))
        if peer is not None:
            admitted = self._gate.admit(peer.splitter.feed(data, now_s), options)
            if admitted:
                peer.last_frame_s = now_s
            return peer, admitted
        late_before = self._gate.late_frames
        splitter = Splitter()
        admitted = self._gate.admit(splitter.feed(data, now_s), options)
        if not admitted and self._gate.late_frames > late_before and self._late_heartbeats.spend_one(now_s):
            self._send_heartbeat(self._new_peer(index, address, now_s), now_s)
        if not admitted or not self._make_room(index, now_s):
            self.rejected += 1
            return None
        peer = self._add(index, address, now_s)
        peer.splitter = splitter  # it may hold the beginning of a frame whose rest follows
        return peer, admitted

    def _add(self, index: int, address: Address, now_s: float) -> Peer:
        peer = self._new_peer(index, address, now_s)
        self._peers[(index, address)] = peer
        self._greet(peer, now_s)
        return peer

    def _new_peer(self, index: int, address: Address, now_s: float) -> Peer:
        return Peer(self._transports[index], address, self._sealer(index), now_s)

    def _remove(self, key: tuple[int, Address]) -> None:
        self._gone_rejected += self._peers.pop(key).splitter.rejected

    def _make_room(self, index: int, now_s: float) -> bool:
        permanent = self._transports[index].addresses()
        guests = [key for key in self._peers if key[0] == index and key[1] not in permanent]
        if len(guests) < MAX_PEERS:
            return True
        oldest = min(guests, key=lambda key: self._peers[key].last_frame_s)
        if now_s - self._peers[oldest].last_frame_s <= QUIET_S:
            return False
        self._remove(oldest)
        return True
