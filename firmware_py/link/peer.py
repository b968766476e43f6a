"""One correspondent on one transport, and the roster of all of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from firmware_py.link.bulk import Allowance
from firmware_py.link.framing import Frame, Splitter
from firmware_py.link.outbox import Outbox
from firmware_py.link.statustext import Notices
from firmware_py.link.streams import Streams
from firmware_py.link.transport import Address, Transport

MAX_PEERS = 8  # that have spoken on a datagram transport
QUIET_S = 10.0  # a datagram peer silent for this long makes room for a new one
FORGET_S = 300.0  # and silent for this long it is forgotten in any case


class Peer:
    """A correspondent: the parser of its bytes, the queue to it, the rates it has asked for."""

    __slots__ = (
        "address",
        "bulk",
        "ground_station_s",
        "heard_s",
        "list_row",
        "notices",
        "outbox",
        "owed_rows",
        "splitter",
        "streams",
        "transport",
    )

    def __init__(self, transport: Transport, address: Address, now_s: float) -> None:
        """Start with nothing heard and the rates of the transport's kind."""
        self.transport = transport
        self.address = address
        self.splitter = Splitter()
        self.outbox = Outbox(lambda data: transport.send(address, data), transport.byte_rate)
        self.streams = Streams(radio=transport.radio, now_s=now_s)
        self.notices = Notices()
        self.list_row: int | None = None  # the next row of the parameter list it gets
        self.owed_rows: dict[int, None] = {}  # rows of the parameter table that it is to be told, in this order
        self.bulk = Allowance(transport.byte_rate)
        self.heard_s = now_s  # a valid frame came from it, or it was taken up
        self.ground_station_s: float | None = None  # its latest heartbeat of a ground station


class Roster:
    """All peers; bounded, and nobody gets on it with noise.

    A stranger on a datagram transport is taken up with its first whole frame, so that
    a stray or forged packet does not draw telemetry.
    """

    def __init__(self, transports: Sequence[Transport], welcome: Callable[[Peer, float], None]) -> None:
        """Take the transports, and what is to be done with a new peer."""
        self._transports = tuple(transports)
        self._welcome = welcome
        self._peers: dict[tuple[int, Address], Peer] = {}  # by index of the transport and address
        self.rejected = 0  # datagrams of strangers without a frame, or without room for them
        self._gone_rejected = 0

    def __iter__(self) -> Iterator[Peer]:
        """Go through the peers as they are now."""
        return iter(tuple(self._peers.values()))

    def __len__(self) -> int:
        """Return the number of peers."""
        return len(self._peers)

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
            if not permanent and (not peer.transport.datagrams or now_s - peer.heard_s > FORGET_S):
                self._remove(key)

    def frames(self, index: int, address: Address, data: bytes, now_s: float) -> tuple[Peer, list[Frame]] | None:
        """Return the peer that sent these bytes and the frames they complete; None for a stranger's noise."""
        peer = self._peers.get((index, address))
        if peer is not None:
            found = peer.splitter.feed(data, now_s)
            if found:
                peer.heard_s = now_s
            return peer, found
        found = Splitter().feed(data, now_s)
        if not found or not self._make_room(index, now_s):
            self.rejected += 1
            return None
        return self._add(index, address, now_s), found

    def _add(self, index: int, address: Address, now_s: float) -> Peer:
        peer = Peer(self._transports[index], address, now_s)
        self._peers[(index, address)] = peer
        self._welcome(peer, now_s)
        return peer

    def _remove(self, key: tuple[int, Address]) -> None:
        self._gone_rejected += self._peers.pop(key).splitter.rejected

    def _make_room(self, index: int, now_s: float) -> bool:
        permanent = self._transports[index].addresses()
        guests = [key for key in self._peers if key[0] == index and key[1] not in permanent]
        if len(guests) < MAX_PEERS:
            return True
        oldest = min(guests, key=lambda key: self._peers[key].heard_s)
        if now_s - self._peers[oldest].heard_s <= QUIET_S:
            return False
        self._remove(oldest)
        return True
