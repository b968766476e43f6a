"""Routes messages between other systems over the boat's links, such as a companion computer and a ground station.

The route to a system and component leads to the peer from which it sent last. A message with an address goes to that
peer, a broadcast to all. Only frames of senders that may command are routed, and only over links that route: fast ones,
others if their URL says so. Loops are cut: a frame is routed only from the peer of its sender, and never twice.
"""

from __future__ import annotations

import re
import struct
from collections import OrderedDict
from collections.abc import Callable, Iterable, Mapping

from firmware_py.common.token_bucket import TokenBucket
from firmware_py.link.access import Admitted, Permission
from firmware_py.link.latest import keep_latest
from firmware_py.link.peers import Peer
from firmware_py.link.wire.dialect import mavlink
from firmware_py.link.wire.frames import Frame, Packed
from firmware_py.link.wire.outbox import Priority

ROUTES = 64  # to the components that sent last
MOVES_S = 10.0  # of silence before a route changes to another peer
SEEN_S = 3.0  # identical bytes within this are one frame, since frames are numbered
SEEN = 1024
BURST, RATE_HZ = 100, 200.0  # routed messages, of all senders together
_WAITING = 32  # queued messages of a peer before more are dropped
_OVERLOAD = f"Routing overload: over {RATE_HZ:g} messages/s, some dropped"
_MAVLINK2, _HEADER2, _HEADER1 = 0xFD, 10, 6

Address = tuple[int, int]  # MAVLink system and component
ALL: Address = (0, 0)


class Router:
    """Learns routes, and passes frames on unchanged, with signature and number."""

    def __init__(self, own: Address, peers: Iterable[Peer], notify: Callable[[str, float], None]) -> None:
        """Take the boat's own address, the active peers, and the function that notifies the operator."""
        self._own = own
        self._peers = peers
        self.notify = notify
        self._routes: OrderedDict[Address, tuple[Peer, float]] = OrderedDict()
        self._seen: OrderedDict[int, float] = OrderedDict()
        self._tokens = TokenBucket(BURST, RATE_HZ)

    def pass_on(self, peer: Peer, frames: Iterable[Admitted], now_s: float) -> None:
        """Learn routes from the frames of a peer, and pass on those for others."""
        if not peer.routes:
            return
        present = [other for other in self._peers if other.routes and other.proven]
        if len(present) < 2 or peer not in present:
            return
        for frame, permission, _ in frames:
            if permission is Permission.COMMANDER and self._learn(_source(frame.data), peer, present, now_s):
                self._pass(peer, frame, present, now_s)

    def _learn(self, source: Address, peer: Peer, present: Iterable[Peer], now_s: float) -> bool:
        """Learn the route to a sender; False for the boat's own frame, and for one from another peer than its route."""
        if source == self._own:
            return False
        known, heard_s = self._routes.get(source, (peer, now_s))
        if known is not peer and known in present and now_s - heard_s < MOVES_S:
            return False
        keep_latest(self._routes, source, (peer, now_s), ROUTES)
        return True

    def _pass(self, peer: Peer, frame: Frame, present: Iterable[Peer], now_s: float) -> None:
        target = _target(frame)
        if target == self._own:
            return
        hearers = [other for other in self._recipients(target, present) if other is not peer]
        if not hearers or self._is_known(frame.data, now_s):
            return
        if not self._tokens.spend_one(now_s):
            self.notify(_OVERLOAD, now_s)
            return
        priority = Priority.REPLY if target[0] else Priority.TELEMETRY
        for other in hearers:
            if other.outbox.queued_count(priority) < _WAITING:
                other.outbox.push(Packed(frame.data, b""), priority)

    def _recipients(self, target: Address, present: Iterable[Peer]) -> Iterable[Peer]:
        """Return the peers that a message is for: all, or those with a route to its target."""
        system, component = target
        if not system:
            return present
        of_target = {
            id(peer)
            for (route_system, route_component), (peer, _) in self._routes.items()
            if route_system == system and component in (0, route_component)
        }
        return [other for other in present if id(other) in of_target]

    def _is_known(self, data: bytes, now_s: float) -> bool:
        while self._seen and (len(self._seen) >= SEEN or now_s - next(iter(self._seen.values())) > SEEN_S):
            self._seen.popitem(last=False)
        mark = hash(data)
        if mark in self._seen:
            return True
        self._seen[mark] = now_s
        return False


def _source(data: bytes) -> Address:
    return (data[5], data[6]) if data[0] == _MAVLINK2 else (data[3], data[4])


def _target(frame: Frame) -> Address:
    """Return the address of a frame; a message without one, or with a part of one, is for all."""
    data, places = frame.data, _TARGETS.get(frame.number, ())
    start = _HEADER2 if data[0] == _MAVLINK2 else _HEADER1
    # MAVLink 2 omits zeros at the end of a payload.
    system, component = ((*(data[start + place] if place < data[1] else 0 for place in places), 0, 0))[:2]
    return system, component


def _places(kind: type) -> tuple[int, ...]:
    """Return the payload offsets of target system and component, as far as a message has them."""
    layout = re.findall(r"\d*[a-zA-Z]", kind.unpacker.format.lstrip("<"))  # type: ignore[attr-defined]
    names, place, found = kind.ordered_fieldnames, 0, {}  # type: ignore[attr-defined]
    for name, part in zip(names, layout, strict=True):
        found[name] = place
        place += struct.calcsize(f"<{part}")
    system = found.get("target_system", found.get("target"))
    if system is None:
        return ()
    component = found.get("target_component")
    return (system,) if component is None else (system, component)


_TARGETS: Mapping[int, tuple[int, ...]] = {
    number: places for number, kind in mavlink.mavlink_map.items() if (places := _places(kind))
}
