"""All correspondents: who has a place, who waits for one, and who is nobody."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Protocol, TypeAlias

from firmware_py.common.link_status import LinkStatus
from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.peer import Peer
from firmware_py.link.security.access import Admitted, Gate, Standing
from firmware_py.link.security.places import QUIET_S, Guest, who_leaves, who_waits_no_more
from firmware_py.link.ways import Ways
from firmware_py.link.wire.frames import Frame, Splitter
from firmware_py.link.wire.outbox import Sealer
from firmware_py.link.wire.transport import Address, Satellite, Transport, usual_class

DOUBT_S = 10.0  # a datagram peer silent for this long has to prove anew that it is there, unless it signs
FORGET_S = 300.0  # and whoever is silent for this long loses his place
HEARTBEAT_S = 1.0  # between heartbeats to one who waits
DUMB_S = 10.0  # a link by which nothing has left for this long is told to whom there are others to
LATE_HEARTBEATS = 4  # signed heartbeats at once to strangers whose timestamps are behind
LATE_HEARTBEATS_HZ = 1.0  # and in the long run

Key: TypeAlias = tuple[int, Address]  # index of the transport, and who


class Host(Protocol):
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
        self, transports: Sequence[Transport], gate: Gate, sealer: Callable[[int], Sealer], host: Host
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
        self._waiting: dict[Key, Peer] = {}
        self._ways = Ways()
        self.rejected = 0  # datagrams of strangers without a frame, or without room for them
        self._gone_rejected = 0
        self._dumb_since_s: dict[int, float] = {}  # transports by which nothing leaves; infinite when that was told

    def __iter__(self) -> Iterator[Peer]:
        """Go through those who have a place, as they are now."""
        return iter(tuple(self._peers.values()))

    def __len__(self) -> int:
        """Return the number of those who have a place."""
        return len(self._peers)

    def everybody(self) -> Iterable[Peer]:
        """Go through those who wait, too."""
        return (*self._peers.values(), *self._waiting.values())

    def has(self, index: int, address: Address) -> bool:
        """Return whether somebody has a place."""
        return (index, address) in self._peers

    def refused_frames(self) -> int:
        """Return the number of broken frames from all peers since start."""
        return self._gone_rejected + sum([peer.splitter.rejected for peer in self.everybody()])

    def flush(self, now_s: float) -> None:
        """Hand what waits for anybody to the transports."""
        for peer in self.everybody():
            peer.outbox.flush(now_s)

    def status(self, now_s: float) -> tuple[LinkStatus, ...]:
        """Return who is on each transport, those who wait for a place last."""
        seated = [(key[0], peer.status(now_s, has_place=True)) for key, peer in self._peers.items()]
        waiting = [(key[0], peer.status(now_s, has_place=False)) for key, peer in self._waiting.items()]
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
            for address in transport.guests():
                connected[index, address] = None
        self._report_blocked_links(now_s)
        for key in permanent:
            if key not in self._peers:
                self._seat(key, self._new_peer(key, now_s), now_s)
            else:
                self._peers[key].forget_silent_radio(now_s)
        for key in connected:
            if key not in self._peers and key not in self._waiting:
                self._wait(key, self._new_peer(key, now_s), now_s)
        for key, peer in tuple(self._peers.items()):
            if key in permanent:
                continue
            datagrams, silent_s = peer.transport.datagrams, now_s - peer.last_frame_s
            if silent_s > FORGET_S or not (datagrams or key in connected):
                self._dismiss(key, now_s)
            elif datagrams and peer.proven and not peer.verified and silent_s > DOUBT_S:
                peer.doubt()
        for key, peer in tuple(self._waiting.items()):
            silent = now_s - peer.last_frame_s > QUIET_S
            if silent and key in connected:
                host = peer.transport.host(key[1])
                self._host.tell(f"{host} on {peer.transport.name} dropped: no valid frame", now_s)
            if silent or not (peer.transport.datagrams or key in connected):
                self._dismiss(key, now_s)
            else:
                self._show_presence(peer, now_s)

    def _report_blocked_links(self, now_s: float) -> None:
        """Tell those who can be reached that a link has been dumb for a while, once for each time."""
        for index, transport in enumerate(self._transports):
            if not transport.blocked_reason:
                self._dumb_since_s.pop(index, None)
            elif now_s - self._dumb_since_s.setdefault(index, now_s) >= DUMB_S:
                self._dumb_since_s[index] = math.inf
                self._host.tell(f"Nothing leaves by {transport.name}: {transport.blocked_reason}", now_s)

    def _permanent(self, key: Key) -> bool:
        return key[1] in self._transports[key[0]].addresses()

    def _show_presence(self, peer: Peer, now_s: float) -> None:
        silent = peer.quiet or self._gate.unsigned(peer.transport.options) is Standing.NONE
        if not silent and now_s - peer.heartbeat_s >= HEARTBEAT_S:
            peer.heartbeat_s = now_s
            self._host.announce(peer)

    # ------------------------------------------------------------------ as bytes come

    def frames(self, index: int, address: Address, data: bytes, now_s: float) -> tuple[Peer, list[Admitted]] | None:
        """Return the peer that sent these bytes and the frames they complete; None for a stranger's noise."""
        key, transport = (index, address), self._transports[index]
        peer = self._peers.get(key) or self._waiting.get(key)
        splitter = Splitter() if peer is None else peer.splitter
        late_before = self._gate.late_frames
        frames = splitter.feed(data, now_s)
        # Before they are judged: the timestamp of a signed one that has come by another way is not new.
        fresh = frames if peer is None else self._fresh(peer, frames, now_s)
        admitted = self._gate.admit(fresh, transport.options, line=transport.byte_rate is not None)
        if not admitted and len(fresh) == len(frames):
            if key not in self._peers and self._gate.late_frames > late_before:
                self._help_late(peer or self._new_peer(key, now_s), now_s)
            if peer is None:
                self.rejected += 1
            return None if peer is None else (peer, admitted)
        if peer is None:
            peer = self._new_peer(key, now_s)
            peer.splitter = splitter  # it may hold the beginning of a frame whose rest follows
            if self._permanent(key):
                self._seat(key, peer, now_s)
            else:
                peer.doubt()
                self._wait(key, peer, now_s)
            first = admitted[0]
            self._ways.follow(peer.way, first.frame.data, now_s, verified=first.verified)
            fresh = self._fresh(peer, (each.frame for each in admitted), now_s)
            admitted = [each for each in admitted if each.frame in fresh]
        for each in admitted:
            if each.standing is Standing.COMMANDER:
                self._ways.note(peer.way, each.frame.data, now_s)
        peer.note_version((each.frame for each in admitted), now_s)
        peer.verified = peer.verified or any(frame.verified for frame in admitted)
        if peer.hear(len(data), now_s):
            if not self.has(*key) and not (self._succeed(key, peer, now_s) or self._find_place(key, peer, now_s)):
                self.rejected += 1
                return None
            peer.outbox.credit_bytes = None
        else:
            self._show_presence(peer, now_s)
        return peer, admitted

    def _fresh(self, peer: Peer, frames: Iterable[Frame], now_s: float) -> list[Frame]:
        return [frame for frame in frames if not self._ways.is_double(peer.way, frame.data, now_s)]

    def _help_late(self, peer: Peer, now_s: float) -> None:
        if self._late_heartbeats.spend_one(now_s):
            self._host.send_heartbeat(peer)
            peer.outbox.flush(now_s)

    # ------------------------------------------------------------------ places

    def _succeed(self, key: Key, peer: Peer, now_s: float) -> bool:
        """Give a station that a NAT has moved to another port the place that it has left; False if it has none."""
        for other_key, other in tuple(self._peers.items()):
            way = other.way
            same = way.station is peer.way.station and way.place == peer.way.place
            if same and way.heard_s < peer.way.since_s and not self._permanent(other_key):
                peer.succeed(other)
                self._dismiss(other_key, now_s)
                self._seat_in(key, peer)
                return True
        return False

    def _find_place(self, key: Key, peer: Peer, now_s: float) -> bool:
        newcomer = self._guest(key, peer)
        seated = [self._guest(*item) for item in self._peers.items() if item[0][0] == key[0]]
        leaving = who_leaves(newcomer, [guest for guest in seated if not self._permanent(guest.key)], now_s)
        if leaving is None:
            self._host.tell(f"No place for {newcomer.host} on {peer.transport.name}", now_s)
            return False
        for guest in leaving:
            self._dismiss(guest.key, now_s)
            self._host.tell(f"Place of {guest.host} on {peer.transport.name} given to {newcomer.host}", now_s)
        self._seat(key, peer, now_s)
        return True

    def _seat(self, key: Key, peer: Peer, now_s: float) -> None:
        self._seat_in(key, peer)
        self._host.greet(peer, now_s)

    def _seat_in(self, key: Key, peer: Peer) -> None:
        self._waiting.pop(key, None)
        self._peers[key] = peer
        peer.outbox.credit_bytes = None

    def _wait(self, key: Key, peer: Peer, now_s: float) -> None:
        self._waiting[key] = peer
        queue = [self._guest(*item) for item in self._waiting.items() if item[0][0] == key[0]]
        for guest in who_waits_no_more(queue):
            self._dismiss(guest.key, now_s)

    def _dismiss(self, key: Key, now_s: float) -> None:
        peer = self._waiting.pop(key, None) or self._peers.pop(key)
        peer.outbox.flush(now_s)
        self._gone_rejected += peer.splitter.rejected
        peer.transport.drop(key[1])

    def _guest(self, key: Key, peer: Peer) -> Guest:
        known = self._gate.knows(peer.transport.options, verified=peer.verified)
        return Guest(key, peer.transport.host(key[1]), known, peer.last_frame_s)

    def _new_peer(self, key: Key, now_s: float) -> Peer:
        return Peer(self._transports[key[0]], key[1], self._sealer(key[0]), now_s)
